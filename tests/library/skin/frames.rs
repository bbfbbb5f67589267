//! A skin is the same in any frame, unit and order, and beside others.

use std::collections::BTreeSet;
use std::f64::consts::{PI, TAU};

use dermatome::mesh::shapes;
use dermatome::pipeline;
use dermatome::skin::{Draft, Link, Motion, MotionFrame, Sheet, TaxelId};
use glam::{DAffine3, DQuat, DVec3};

use super::drafts::{assemble, draft_of, sheet_of, topology};

/// Taxels, and the triangles of their skin where they are known.
struct Cover {
    name: String,
    positions: Vec<DVec3>,
    triangles: Option<usize>,
}

/// A small generator of numbers in 0..1.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn turn(&mut self) -> DQuat {
        let axis = DVec3::new(self.next() - 0.5, self.next() - 0.5, self.next() - 0.5).normalize_or(DVec3::X);
        DQuat::from_axis_angle(axis, TAU * self.next())
    }
}

/// A kind of lattice, its points, and how many triangles they make where that is known.
type Plane = (&'static str, Vec<[f64; 2]>, Option<usize>);

/// The plane as a square lattice, a triangular one, and a random one with a distance of 0.7 spacings; 5 mm.
fn planes(columns: u32, rows: u32) -> [Plane; 3] {
    let cells = || (0..rows).flat_map(move |j| (0..columns).map(move |i| [f64::from(i), f64::from(j)]));
    let square = cells().map(|x| x.map(|x| 0.005 * x)).collect();
    let slanted = |[i, j]: [f64; 2]| [0.005 * (i + 0.5 * (j % 2.0)), 0.005 * 3.0_f64.sqrt() / 2.0 * j];
    let mut random = Random(7);
    let mut scattered: Vec<[f64; 2]> = Vec::new();
    while scattered.len() < (columns * rows) as usize {
        let [x, y] = [columns, rows].map(|count| 0.005 * f64::from(count) * random.next());
        let is_apart = |o: &[f64; 2]| (o[0] - x).hypot(o[1] - y) > 0.0033;
        if scattered.iter().all(is_apart) {
            scattered.push([x, y]);
        }
    }
    let squares = 2 * (columns as usize - 1) * (rows as usize - 1);
    [
        ("square", square, Some(squares)),
        ("triangular", cells().map(slanted).collect(), None),
        ("random", scattered, None),
    ]
}

fn covers() -> Vec<Cover> {
    let mut covers = Vec::new();
    let mut add =
        |name: String, positions: Vec<DVec3>, triangles| covers.push(Cover { name, positions, triangles });
    for (kind, plane, triangles) in planes(12, 20) {
        let mut bent = |name: &str, bend: &dyn Fn(f64, f64) -> DVec3| {
            add(format!("{kind} {name}"), plane.iter().map(|&[x, y]| bend(x, y)).collect(), triangles);
        };
        bent("plane", &|x, y| DVec3::new(x, y, 0.0));
        bent("wave", &|x, y| DVec3::new(x, y, 0.006 * (x / 0.012).sin() * (y / 0.015).cos()));
        for radius in [0.02, 0.05, 0.1, 0.3] {
            bent(&format!("cylinder of {radius} m"), &|x, y| {
                DVec3::new(radius * (x / radius).cos(), radius * (x / radius).sin(), y)
            });
        }
    }
    for (kind, plane, triangles) in planes(5, 20) {
        for radius in [0.008, 0.012] {
            let bend =
                |&[x, y]: &[f64; 2]| DVec3::new(radius * (x / radius).cos(), radius * (x / radius).sin(), y);
            add(format!("{kind} cylinder of {radius} m"), plane.iter().map(bend).collect(), triangles);
        }
    }
    for (around, along) in [(12, 30), (20, 12), (40, 10)] {
        let tube = shapes::tube(around, along, 0.005 * f64::from(around) / TAU, 0.005 * f64::from(along - 1));
        let square =
            (0..along).flat_map(|j| (0..around).map(move |i| (TAU * f64::from(i) / f64::from(around), j)));
        let radius = 0.005 * f64::from(around) / TAU;
        let square =
            square.map(|(a, j)| DVec3::new(radius * a.cos(), radius * a.sin(), 0.005 * f64::from(j)));
        let triangles = Some(2 * (around * (along - 1)) as usize);
        add(format!("triangular tube {around} x {along}"), tube.positions.as_slice().to_vec(), triangles);
        add(format!("square tube {around} x {along}"), square.collect(), triangles);
    }
    for count in [300, 1000] {
        let golden = PI * (3.0 - 5.0_f64.sqrt());
        let point = |k: usize| {
            let z = 1.0 - (2.0 * k as f64 + 1.0) / count as f64;
            let (sin, cos) = (golden * k as f64).sin_cos();
            0.05 * DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
        };
        add(format!("ball of {count}"), (0..count).map(point).collect(), Some(2 * count - 4));
    }
    // Two triangular modules of ten taxels, 12 mm apart: nine faces each, and a strip between.
    let module =
        (0..4).flat_map(|j| (0..4 - j).map(move |i| [f64::from(i) + 0.5 * f64::from(j), f64::from(j)]));
    let module = module.map(|[i, j]| DVec3::new(0.006 * i, 0.006 * 3.0_f64.sqrt() / 2.0 * j, 0.0));
    let other = module.clone().map(|p| DVec3::new(0.048 - p.x, p.y, p.z));
    add("modules".into(), module.chain(other).collect(), None);
    covers
}

/// Taxels in use, triangles, and Euler characteristic and boundary loops of each patch.
type Counts = (usize, usize, BTreeSet<(i64, usize)>);

fn counts(positions: Vec<DVec3>, ids: Vec<u32>) -> Counts {
    let ids = Some(ids.into_iter().map(TaxelId).collect());
    let assembled =
        assemble(&draft_of(Sheet { name: "s".into(), positions, ids, ..Sheet::default() })).unwrap();
    let patches = &assembled.skin.patches;
    let taxels = patches.iter().map(|patch| patch.mesh.positions.len()).sum();
    let triangles = patches.iter().map(|patch| patch.mesh.triangles.len()).sum();
    (taxels, triangles, patches.iter().map(|patch| topology(&patch.mesh)).collect())
}

#[test]
fn covers_are_the_same_skin_in_any_frame() {
    let mut wrong = Vec::new();
    for Cover { name, positions, triangles } in covers() {
        let ids = |count: usize| (1..).take(count).collect::<Vec<u32>>();
        let straight = counts(positions.clone(), ids(positions.len()));
        let (taxels, found, _) = &straight;
        if *taxels != positions.len() || triangles.is_some_and(|needed| needed != *found) {
            wrong.push(format!("{name}: {straight:?} of {} taxels, needed {triangles:?}", positions.len()));
        }
        let mut random = Random(3);
        let mut differ = Vec::new();
        for k in 0..20 {
            let (turn, scale) = (random.turn(), [1.0, 3.0, 1e-3][k % 3]);
            let mut rows: Vec<(DVec3, u32)> =
                positions.iter().map(|&p| scale * (turn * p + 0.1 * DVec3::ONE)).zip(1..).collect();
            if k % 2 == 1 {
                let mut keyed: Vec<(f64, (DVec3, u32))> =
                    rows.into_iter().map(|row| (random.next(), row)).collect();
                keyed.sort_by(|a, b| a.0.total_cmp(&b.0));
                rows = keyed.into_iter().map(|(_, row)| row).collect();
            }
            let (positions, ids) = rows.into_iter().unzip();
            let turned = counts(positions, ids);
            if turned != straight {
                differ.push((turned.0, turned.1, turned.2));
            }
        }
        if !differ.is_empty() {
            wrong.push(format!("{name}: {straight:?}, turned {differ:?}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A dome as a file without ids has it, its vertices in another order.
fn shuffled(seed: u64) -> Sheet {
    let dome = shapes::cap(900, 0.1, 1.2);
    let count = u32::try_from(dome.positions.len()).unwrap();
    let mut random = Random(seed);
    let mut keyed: Vec<(f64, u32)> = (0..count).map(|v| (random.next(), v)).collect();
    keyed.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut place = vec![0; count as usize];
    (0..).zip(&keyed).for_each(|(new, &(_, old))| place[old as usize] = new);
    Sheet {
        name: "s".into(),
        positions: keyed.iter().map(|&(_, v)| dome.positions[v.into()]).collect(),
        triangles: dome.triangles.iter().map(|t| t.map(|v| place[v.index()])).collect(),
        ..Sheet::default()
    }
}

/// The places of the centres of each level.
fn levels(sheet: Sheet) -> Vec<BTreeSet<[u64; 3]>> {
    let skin = assemble(&draft_of(sheet)).unwrap().skin;
    let map = pipeline::build(&skin, &pipeline::BuildOptions::default()).unwrap();
    let bits = |p: &DVec3| p.to_array().map(f64::to_bits);
    map.patches
        .iter()
        .flat_map(|p| &p.levels)
        .map(|l| l.level.mesh.positions.iter().map(bits).collect())
        .collect()
}

#[test]
fn levels_without_ids_do_not_depend_on_the_order_of_vertices() {
    let expected = levels(shuffled(1));
    assert!(expected.len() > 2);
    for seed in 2..5 {
        assert!(levels(shuffled(seed)) == expected, "order {seed}");
    }
    let sizes = |levels: &[BTreeSet<_>]| levels.iter().map(BTreeSet::len).collect::<Vec<_>>();
    for scale in [3.0, 1e-3] {
        let mut sheet = shuffled(1);
        sheet.positions.iter_mut().for_each(|p| *p = scale * (*p + 0.3));
        assert_eq!(sizes(&levels(sheet)), sizes(&expected), "scaled by {scale}");
    }
}

#[test]
fn an_acuity_of_one_for_all_is_none() {
    let even = Sheet { acuities: Some(vec![1.0; shuffled(1).positions.len()]), ..shuffled(1) };
    let [with, without] = [even, shuffled(1)].map(|sheet| {
        let skin = assemble(&draft_of(sheet)).unwrap().skin;
        pipeline::build(&skin, &pipeline::BuildOptions::default()).unwrap()
    });
    assert!(with == without);
    let mut uneven = vec![1.0; shuffled(1).positions.len()];
    uneven[0] = 2.0;
    let uneven = Sheet { acuities: Some(uneven), ..shuffled(1) };
    assert!(assemble(&draft_of(uneven)).unwrap().skin.patches[0.into()].taxels.acuities.is_some());
}

#[test]
fn sheets_without_ids_count_on_after_the_largest() {
    let with_ids = |ids: std::ops::Range<u32>| Sheet {
        ids: Some(ids.map(TaxelId).collect()),
        ..sheet_of("a", &shapes::lattice(6, 6, 0.005))
    };
    let without = Sheet { name: "b".into(), ids: None, ..with_ids(0..36) };
    let draft = Draft { sheets: vec![without, with_ids(37..73)], ..Draft::default() };
    let skin = assemble(&draft).unwrap().skin;
    let ids: Vec<u32> = skin.patches.iter().flat_map(|p| &p.taxels.ids).map(|id| id.0).collect();
    assert_eq!(ids, (73..109).chain(37..73).collect::<Vec<_>>());
    assert_eq!([0, 1].map(|k| skin.patches[k.into()].taxels.are_counted), [true, false]);
}

/// Two unnamed links of one file are two, and what moves one of another file does not move them.
#[test]
fn links_of_several_files_become_one_only_if_they_are_the_same() {
    let file = |name: &str, links: u32, moved: &[u32]| {
        let link = Link { name: name.into(), parent: None, pose: DAffine3::IDENTITY };
        let mut motion = Motion::default();
        for &link in moved {
            let to = DAffine3::from_translation(DVec3::X * f64::from(link + 1));
            motion.set(link.into(), MotionFrame::World, &[(0.0, DAffine3::IDENTITY), (1.0, to)]).unwrap();
        }
        let sheets = (0..links).map(|link| Sheet { link: Some(link.into()), ..Sheet::default() });
        let animations = if moved.is_empty() { Vec::new() } else { vec![motion] };
        Draft {
            links: (0..links).map(|_| link.clone()).collect(),
            sheets: sheets.collect(),
            animations,
            ..Draft::default()
        }
    };
    let joined = |first: Draft, second: Draft| {
        let mut both = first;
        both.append(second);
        both.sheets.iter().map(|sheet| sheet.link.unwrap().index()).collect::<Vec<_>>()
    };
    assert_eq!(joined(file("", 1, &[]), file("", 2, &[0, 1])), [0, 1, 2]);
    assert_eq!(joined(file("", 1, &[0]), file("", 1, &[])), [0, 1]);
    assert_eq!(joined(file("", 1, &[]), file("", 1, &[])), [0, 0]);
    assert_eq!(joined(file("hand", 1, &[0]), file("hand", 1, &[])), [0, 0]);
    assert_eq!(joined(file("hand", 1, &[]), file("hand", 2, &[])), [0, 0, 1]);
}

#[test]
fn bare_taxels_of_one_file_stay_beside_a_mesh_of_another() {
    let mesh = shapes::lattice(6, 6, 0.005);
    let bare = |at: f64| Sheet {
        name: "bare".into(),
        positions: mesh.positions.iter().map(|p| *p + at * DVec3::Z).collect(),
        ..Sheet::default()
    };
    for is_first in [true, false] {
        let [mut both, other] = if is_first {
            [draft_of(bare(0.1)), draft_of(sheet_of("mesh", &mesh))]
        } else {
            [draft_of(sheet_of("mesh", &mesh)), draft_of(bare(0.1))]
        };
        both.append(other);
        let patches = assemble(&both).unwrap().skin.patches;
        assert!(patches.iter().all(|patch| patch.mesh.positions.len() == 36) && patches.len() == 2);
    }
}

/// A sheet in the frame of a palm that hangs upside down faces the same side of the world as one that does not.
#[test]
fn the_outside_is_that_of_the_world() {
    let positions: Vec<DVec3> =
        (0..48).map(|k| 0.005 * DVec3::new(f64::from(k % 8), f64::from(k / 8), 0.0)).collect();
    let turned = DAffine3::from_quat(DQuat::from_rotation_x(PI));
    let links = [("arm", None, turned), ("palm", Some(0_u32), turned)];
    let links =
        links.map(|(name, parent, pose)| Link { name: name.into(), parent: parent.map(Into::into), pose });
    let sheet = |link: u32| Sheet {
        name: format!("s{link}"),
        link: Some(link.into()),
        positions: positions.clone(),
        ..Sheet::default()
    };
    let draft = Draft { links: links.to_vec().into(), sheets: vec![sheet(0), sheet(1)], ..Draft::default() };
    for (outside, z) in [(None, 1.0), (Some(DVec3::Z), 1.0), (Some(DVec3::new(0.1, 0.0, -2.0)), -1.0)] {
        let options = dermatome::skin::AssembleOptions { outside, ..Default::default() };
        let skin = dermatome::skin::assemble(&draft, &options).unwrap().skin;
        for patch in &skin.patches {
            let pose = dermatome::skin::world_pose(&skin.links, patch.link);
            for normal in &patch.taxels.normals {
                let normal = pose.transform_vector3(*normal);
                assert!((normal.z - z).abs() < 1e-12, "{outside:?}: {} faces {normal}", patch.name);
            }
        }
    }
}
