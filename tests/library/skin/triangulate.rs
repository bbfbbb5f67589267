//! Laws of triangulating bare taxels: shapes without their triangles, and taxels that lie on no
//! surface.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::{PI, TAU};

use dermatome::id::VertexId;
use dermatome::mesh::{TriMesh, shapes};
use dermatome::skin::{
    self, AssembleOptions, Assembled, Draft, Patch, Presence, Remark, RemarkKind, Sheet, SkinError, TaxelId,
    Taxels,
};
use dermatome::{io, pipeline, report};
use glam::{DAffine3, DQuat, DVec3};
use proptest::prelude::*;

use super::drafts::{assemble, draft_of, kinds, only, topology};
use super::{elements, found_in};
use crate::common::data;

/// The taxels of a shape alone, numbered from 0.
fn bare(positions: &[DVec3]) -> Sheet {
    Sheet {
        name: "s".into(),
        positions: positions.to_vec(),
        ids: Some((0..).take(positions.len()).map(TaxelId).collect()),
        ..Sheet::default()
    }
}

fn taxels_of(mesh: &TriMesh) -> Sheet {
    bare(mesh.positions.as_slice())
}

fn with_normals(mesh: &TriMesh) -> Sheet {
    Sheet { normals: Some(Vec::from(Taxels::from(mesh).normals)), ..taxels_of(mesh) }
}

/// The taxels that were merged with another one.
fn merged(assembled: &Assembled) -> &[VertexId] {
    let of = |r| {
        if let &Remark { kind: RemarkKind::Merged { ref vertices, .. }, .. } = r {
            Some(&vertices[..])
        } else {
            None
        }
    };
    assembled.remarks.iter().find_map(of).unwrap()
}

fn meshed(sheet: Sheet) -> Assembled {
    assemble(&draft_of(sheet)).unwrap()
}

/// What comes of a sheet whose taxels are joined within this gap.
fn within(sheet: Sheet, gap: f64) -> Result<Assembled, SkinError> {
    skin::assemble(&draft_of(sheet), &AssembleOptions { gap, ..AssembleOptions::default() })
}

/// The triangles of all patches, by the ids of their taxels, each from its smallest on.
fn faces(assembled: &Assembled) -> BTreeSet<[u32; 3]> {
    let of_patch = |p: &Patch| -> Vec<[u32; 3]> {
        p.mesh
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|v| p.taxels.ids[v].0);
                [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap()
            })
            .collect()
    };
    assembled.skin.patches.iter().flat_map(of_patch).collect()
}

/// A lattice bent round a cylinder of `radius` about the z axis, `turn` rad wide: seen from
/// outside.
fn bent(columns: u32, rows: u32, spacing: f64, radius: f64) -> TriMesh {
    let mut mesh = shapes::lattice(columns, rows, spacing);
    for p in mesh.positions.iter_mut() {
        let (sin, cos) = (p.x / radius).sin_cos();
        *p = DVec3::new(radius * cos, radius * sin, p.y);
    }
    mesh
}

/// A number in 0..1 that depends on `k` alone.
fn scatter(k: usize) -> f64 {
    (k as f64 * 0.754_877_666_246_692_7).fract()
}

/// Positions moved by up to `amount`, each its own way.
fn shaken(mesh: &TriMesh, amount: f64) -> TriMesh {
    let mut mesh = mesh.clone();
    for (k, p) in mesh.positions.iter_mut().enumerate() {
        let [x, y, z] = [3 * k, 3 * k + 1, 3 * k + 2].map(|k| scatter(k + 7) - 0.5);
        *p += 2.0 * amount * DVec3::new(x, y, z);
    }
    mesh
}

#[test]
fn shapes_are_recovered_from_their_vertices() {
    for (name, mesh) in [
        ("lattice", shapes::lattice(12, 9, 0.005)),
        ("cap", shapes::cap(2000, 0.1, 1.9)),
        ("300 degrees round a cylinder", bent(40, 12, 0.0065, 40.0 * 0.0065 / (TAU * 300.0 / 360.0))),
        ("tube", shapes::tube(30, 20, 0.04, 0.12)),
        ("saddle", shapes::saddle(40)),
        ("noise", shaken(&shapes::lattice(20, 20, 0.005), 0.0005)),
    ] {
        let (euler, _) = topology(&mesh);
        let truth = Taxels::from(&mesh).normals;
        for sheet in [taxels_of(&mesh), with_normals(&mesh)] {
            let has_normals = sheet.normals.is_some();
            let assembled = meshed(sheet);
            let patch = only(&assembled);
            assert_eq!(patch.mesh.positions.len(), mesh.positions.len(), "{name}: every taxel is used");
            assert_eq!(topology(&patch.mesh).0, euler, "{name}: Euler characteristic");
            let side = |f| {
                patch
                    .mesh
                    .face_cross(f)
                    .dot(truth[VertexId::from(patch.taxels.ids[patch.mesh.triangles[f][0]].0)])
            };
            let outward = patch.mesh.triangles.ids().filter(|&f| side(f) > 0.0).count();
            let count = patch.mesh.triangles.len();
            if has_normals || !["lattice", "saddle", "noise"].contains(&name) {
                assert_eq!(outward, count, "{name}: every triangle faces outward");
            } else {
                assert!(outward == 0 || outward == count, "{name}: all triangles face one side");
            }
        }
    }
}

/// Distance of each taxel to the third nearest, and the median of these over it and the six
/// nearest.
fn spacing(positions: &[DVec3]) -> Vec<f64> {
    let nearest = |p: &DVec3| {
        let mut order: Vec<usize> = (0..positions.len()).collect();
        order.sort_by(|&a, &b| positions[a].distance(*p).total_cmp(&positions[b].distance(*p)));
        order.truncate(7);
        order
    };
    let around: Vec<Vec<usize>> = positions.iter().map(nearest).collect();
    let third: Vec<f64> =
        positions.iter().zip(&around).map(|(p, near)| p.distance(positions[near[3]])).collect();
    let median = |near: &Vec<usize>| {
        let mut of_near: Vec<f64> = near.iter().map(|&k| third[k]).collect();
        of_near.sort_by(f64::total_cmp);
        of_near[3]
    };
    around.iter().map(median).collect()
}

/// Islands at every distance from below to beyond the gap: each edge is held against the spacing at
/// its own ends.
#[test]
fn no_edge_is_longer_than_the_gap() {
    for gap in [1.5, 2.5, 4.0] {
        let mut longest = 0.0_f64;
        for apart in [0.5, 0.8, 0.95, 1.05, 1.4] {
            let mut sheet = two_islands(apart * gap);
            for (k, p) in sheet.positions.iter_mut().enumerate() {
                *p += 0.001 * DVec3::new(scatter(2 * k + 7) - 0.5, scatter(2 * k + 8) - 0.5, 0.0);
            }
            let spacing = spacing(&sheet.positions);
            let positions = sheet.positions.clone();
            let faces = faces(&within(sheet, gap).unwrap());
            let used: BTreeSet<u32> = faces.iter().flatten().copied().collect();
            assert_eq!(used.len(), 128, "gap {gap}: every taxel is in a face");
            for [a, b] in faces.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]) {
                let [a, b] = [a as usize, b as usize];
                let over = positions[a].distance(positions[b]) / (0.5 * (spacing[a] + spacing[b]));
                assert!(
                    over <= gap * (1.0 + 1e-12),
                    "gap {gap}, islands {apart} of it apart: an edge of {over} spacings"
                );
                longest = longest.max(over);
            }
        }
        assert!(longest > 0.9 * gap, "gap {gap}: edges reach it, not only {longest}");
    }
}

/// One mouth of a sleeve used to get a ring of slivers across it, and a thin one a lid.
#[test]
fn the_ends_of_tubes_stay_open() {
    for (around, along, cone) in [(12, 20, 0.0), (24, 12, 0.5), (36, 20, 0.0), (40, 20, -0.3)] {
        // Columns are 5 mm apart, rows too.
        let radius = 0.005 * f64::from(around) / TAU;
        let mut mesh = shapes::tube(around, along, radius, 0.005 * f64::from(along - 1));
        let top = mesh.positions.iter().fold(0.0, |most: f64, p| most.max(p.z.abs()));
        for p in mesh.positions.iter_mut() {
            let wide = 1.0 + cone * p.z / top;
            *p = DVec3::new(wide * p.x, wide * p.y, p.z);
        }
        for sheet in [taxels_of(&mesh), with_normals(&mesh)] {
            let assembled = meshed(sheet);
            let found = &only(&assembled).mesh;
            assert_eq!(found.triangles.len(), mesh.triangles.len(), "{around} around, {along} along");
            assert_eq!(topology(found), (0, 2), "{around} around, {along} along");
        }
    }
}

/// Two lattices, `gap` spacings of open skin between them.
fn two_islands(gap: f64) -> Sheet {
    let one = shapes::lattice(8, 8, 0.005);
    let apart = DVec3::X * 0.005 * (7.5 + gap);
    let positions: Vec<DVec3> =
        one.positions.iter().copied().chain(one.positions.iter().map(|&p| p + apart)).collect();
    bare(&positions)
}

#[test]
fn a_gap_wider_than_the_limit_stays_open_and_a_narrower_one_is_bridged() {
    assert_eq!(meshed(two_islands(2.0)).skin.patches.len(), 1);
    let open = meshed(two_islands(2.8));
    assert_eq!(open.skin.patches.len(), 2);
    assert!(kinds(&open).contains("Components"), "that there are two is told");
    let wide = within(two_islands(2.8), 3.5).unwrap();
    assert_eq!(wide.skin.patches.len(), 1, "a wider limit bridges it");
}

#[test]
fn a_square_lattice_is_cut_along_one_diagonal_everywhere() {
    let positions: Vec<DVec3> =
        (0..400).map(|k| 0.005 * DVec3::new(f64::from(k % 20), f64::from(k / 20), 0.0)).collect();
    let assembled = meshed(bare(&positions));
    let patch = only(&assembled);
    assert_eq!(patch.mesh.triangles.len(), 2 * 19 * 19);
    assert_eq!(topology(&patch.mesh), (1, 1), "a disk without holes");
}

#[test]
fn taxels_at_one_place_are_merged_into_one_that_reads() {
    let mesh = shapes::lattice(6, 6, 0.005);
    let mut sheet = taxels_of(&mesh);
    let copies = [3, 3, 17];
    sheet.positions.extend(copies.map(|k| mesh.positions[VertexId::new(k)]));
    sheet.ids = Some((0..39).map(TaxelId).collect());
    sheet.presence =
        Some((0..39).map(|k| if k == 17 { Presence::ThermalPad } else { Presence::Present }).collect());
    let assembled = meshed(sheet);
    let patch = only(&assembled);
    assert_eq!(patch.mesh.positions.len(), 36);
    let ids: BTreeSet<u32> = patch.taxels.ids.iter().map(|id| id.0).collect();
    assert!(ids.contains(&3) && ids.contains(&38) && !ids.contains(&17), "{ids:?}");
    assert_eq!(merged(&assembled).len(), 3);
}

/// Dead taxels that a calibration left where it began, up to its rounding: more than the spacing
/// looks at.
#[test]
fn many_taxels_at_almost_one_place_are_merged() {
    let mut positions = shapes::lattice(6, 6, 0.005).positions.as_slice().to_vec();
    let noise = |k| 1e-10 * DVec3::new(scatter(k), scatter(k + 30), scatter(k + 60));
    let at = positions[14];
    positions.extend((0..30).map(|k| at + noise(k)));
    let assembled = meshed(bare(&positions));
    assert_eq!(only(&assembled).mesh.positions.len(), 36);
}

/// A module seventy times finer than the skin around it: its taxels are as close as copies of those
/// of the skin might be.
#[test]
fn dense_taxels_beside_sparse_ones_are_not_merged() {
    let coarse = shapes::lattice(12, 12, 0.01);
    let fine = shapes::lattice(4, 4, 0.00015).positions.map(|&p| p + DVec3::new(0.0312, 0.031, 0.0));
    let positions: Vec<DVec3> = coarse.positions.iter().chain(&fine).copied().collect();
    let assembled = meshed(bare(&positions));
    assert!(!kinds(&assembled).contains("Merged"), "{:?}", assembled.remarks);
    let used: usize = assembled.skin.patches.iter().map(|p| p.mesh.positions.len()).sum();
    assert_eq!(used, 160);
}

/// Copies rounded to `f32` used to stay, and the file of such a skin could not be read back.
#[test]
fn a_rounded_copy_changes_nothing_in_the_smallest_skin() {
    let corners = [DVec3::ZERO, 0.01 * DVec3::X, DVec3::new(0.005, 0.0087, 0.0)];
    for beside in [1e-17, 4e-9, 1e-5] {
        let [a, b, c] = corners;
        let assembled = meshed(bare(&[a, b, c, c + beside * DVec3::X]));
        assert_eq!(faces(&assembled).into_iter().collect::<Vec<_>>(), [[0, 1, 2]], "{beside} m");
        assert_eq!(merged(&assembled), [VertexId::new(3)]);
    }
}

#[test]
fn empty_slots_are_left_out_and_a_taxel_at_the_origin_stays() {
    let mesh = shapes::lattice(5, 5, 0.005);
    let mut sheet = with_normals(&mesh);
    assert_eq!(sheet.positions[0], DVec3::ZERO, "the lattice begins at the origin");
    let mut presence = vec![Presence::Present; 25];
    sheet.positions.extend([DVec3::ZERO; 4]);
    sheet.normals.as_mut().unwrap().extend([DVec3::ZERO; 4]);
    sheet.ids = Some((0..29).map(TaxelId).collect());
    presence.extend([Presence::Absent; 4]);
    presence[12] = Presence::ThermalPad;
    sheet.presence = Some(presence);
    let assembled = meshed(sheet);
    let patch = only(&assembled);
    assert_eq!(patch.mesh.positions.len(), 25, "the slots are gone, the first taxel is not");
    assert_eq!(
        patch.taxels.presence.iter().filter(|&&p| p == Presence::ThermalPad).count(),
        1,
        "pads have a place"
    );
}

#[test]
fn placeholder_normals_are_replaced_and_reliable_ones_kept() {
    let mesh = bent(20, 10, 0.0065, 0.03);
    let constant = Sheet { normals: Some(vec![DVec3::Z; 200]), ..taxels_of(&mesh) };
    let random =
        (0..200).map(|k| DVec3::new(scatter(k) - 0.5, scatter(k + 300) - 0.5, scatter(k + 600) - 0.5));
    let random = Sheet { normals: Some(random.map(DVec3::normalize).collect()), ..taxels_of(&mesh) };
    let expected = faces(&meshed(taxels_of(&mesh)));
    for sheet in [constant, random] {
        let assembled = meshed(sheet);
        assert_eq!(faces(&assembled), expected, "as if there were none");
        assert!(kinds(&assembled).contains("NormalsIgnored"), "and this is reported");
    }
    let inward: Vec<DVec3> = Taxels::from(&mesh).normals.iter().map(|&n| -n).collect();
    let assembled = meshed(Sheet { normals: Some(inward.clone()), ..taxels_of(&mesh) });
    assert!(!kinds(&assembled).iter().any(|kind| kind.starts_with("Normals")));
    let patch = only(&assembled);
    let kept = |(id, n): (&TaxelId, &DVec3)| n.distance(inward[id.0 as usize]) < 1e-12;
    assert!(patch.taxels.ids.iter().zip(&patch.taxels.normals).all(kept), "the file knows best");
}

#[test]
fn some_wrong_normals_change_no_topology() {
    let mesh = shapes::cap(1500, 0.1, 1.2);
    let mut normals = Vec::from(Taxels::from(&mesh).normals);
    for k in (0..normals.len()).step_by(17) {
        normals[k] = if k % 2 == 0 { -normals[k] } else { DVec3::ZERO };
    }
    let assembled = meshed(Sheet { normals: Some(normals), ..taxels_of(&mesh) });
    let patch = only(&assembled);
    assert_eq!(patch.mesh.positions.len(), mesh.positions.len());
    assert_eq!(topology(&patch.mesh), (1, 1));
}

/// What a file without normals becomes, one with normals of either side becomes too: they were
/// believed taxel by taxel once, and the skin fell into shreds.
#[test]
fn normals_with_random_signs_change_no_face() {
    for mesh in [shapes::cap(500, 0.1, 0.595), bent(40, 12, 0.0065, 40.0 * 0.0065 / (TAU * 300.0 / 360.0))] {
        let truth = Vec::from(Taxels::from(&mesh).normals);
        let expected = faces(&meshed(taxels_of(&mesh)));
        let turned = |is_turned: &dyn Fn(usize) -> bool| -> Vec<DVec3> {
            truth.iter().enumerate().map(|(k, &n)| if is_turned(k) { -n } else { n }).collect()
        };
        let shake = |k: usize| 1.2 * (DVec3::new(scatter(k), scatter(k + 700), scatter(k + 1400)) - 0.5);
        for (name, normals) in [
            ("a tenth turned", turned(&|k| scatter(k) < 0.1)),
            ("three tenths turned", turned(&|k| scatter(k) < 0.3)),
            ("half of them turned", turned(&|k| scatter(k) < 0.5)),
            ("one half turned", turned(&|k| mesh.positions[VertexId::new(k)].y < 0.0)),
            ("shaken", truth.iter().enumerate().map(|(k, n)| (*n + shake(k)).normalize()).collect()),
        ] {
            let assembled = meshed(Sheet { normals: Some(normals), ..taxels_of(&mesh) });
            assert_eq!(faces(&assembled), expected, "{name}");
            assert!(kinds(&assembled).contains("NormalsOpposed") || name == "shaken", "{name} is reported");
        }
    }
}

/// Two square lattices that meet in an edge, with the exact normals of their sides; the edge has
/// those of the first.
fn fold(degrees: f64) -> Sheet {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let side = |i: u32, j: u32| (0.005 * f64::from(i), 0.005 * f64::from(j));
    let first = (0..12)
        .flat_map(|i| (0..12).map(move |j| side(i, j)))
        .map(|(x, y)| (DVec3::new(x, y, 0.0), DVec3::Z));
    let second = (1..12)
        .flat_map(|i| (0..12).map(move |j| side(i, j)))
        .map(|(x, y)| (DVec3::new(-x * cos, y, -x * sin), DVec3::new(-sin, 0.0, cos)));
    let (positions, normals): (Vec<DVec3>, Vec<DVec3>) = first.chain(second).unzip();
    Sheet { normals: Some(normals), ..bare(&positions) }
}

#[test]
fn a_sharp_edge_with_correct_normals_stays_closed() {
    for degrees in [45.0, 89.0, 90.0, 91.0, 100.0] {
        let assembled = meshed(fold(degrees));
        let patch = only(&assembled);
        assert_eq!(patch.mesh.positions.len(), 276, "{degrees} degrees");
        assert_eq!(topology(&patch.mesh), (1, 1), "{degrees} degrees");
    }
}

/// Its neighbourhoods are as thick as wide, and were called a cloud whatever the normals said.
#[test]
fn a_thin_tube_with_normals_is_no_cloud() {
    let tube = shapes::tube(8, 12, 0.005 * 8.0 / TAU, 0.005 * 11.0);
    let tube = meshed(with_normals(&tube));
    assert_eq!(topology(&only(&tube).mesh), (0, 2));
}

/// Such a pair looks like the two sides of a thin part, and once turned a whole corner of a noisy
/// skin over.
#[test]
fn a_taxel_almost_above_another_turns_no_face_over() {
    let mesh = shaken(&shapes::lattice(10, 10, 0.005), 0.0004);
    for corner in [0, 5, 44] {
        let mut positions = mesh.positions.as_slice().to_vec();
        positions.push(positions[corner] + DVec3::new(0.0011, 0.0004, 0.0024));
        let assembled = meshed(bare(&positions));
        let patch = only(&assembled);
        let up = patch.mesh.triangles.ids().filter(|&f| patch.mesh.face_cross(f).z > 0.0).count();
        assert!(up == 0 || up == patch.mesh.triangles.len(), "beside {corner}: {up} faces up");
        assert!(patch.mesh.positions.len() >= 100, "beside {corner}");
    }
}

#[test]
fn normals_keep_the_two_sides_of_a_thin_part_apart() {
    let side = shapes::lattice(12, 12, 0.005);
    let below = side.positions.iter().map(|&p| p - 0.006 * DVec3::Z);
    let positions: Vec<DVec3> = side.positions.iter().copied().chain(below).collect();
    let normals = (0..288).map(|k| if k < 144 { DVec3::Z } else { DVec3::NEG_Z }).collect();
    let assembled = meshed(Sheet { normals: Some(normals), ..bare(&positions) });
    assert_eq!(assembled.skin.patches.len(), 2);
    for patch in &assembled.skin.patches {
        assert_eq!((patch.mesh.positions.len(), topology(&patch.mesh)), (144, (1, 1)));
    }
}

/// Modules of ten taxels and two pads, triangles that point up and down by turns, rigid and flat on
/// a cylinder of `radius`: rows of 12 slots, as the iCub has them.
fn modules(around: u32, along: u32, radius: f64, degrees: f64) -> Sheet {
    const SPACING: f64 = 0.0065;
    // Rows of 4, 3, 2 and 1 taxels.
    let row = SPACING * 0.75_f64.sqrt();
    let flat: Vec<(f64, f64)> = (0..4)
        .flat_map(|j| (0..4 - j).map(move |i| (i, j)))
        .map(|(i, j)| (SPACING * (f64::from(i) + 0.5 * f64::from(j) - 1.5), row * (f64::from(j) - 1.0)))
        .collect();
    let mut sheet = Sheet { name: "arm".into(), ..Sheet::default() };
    let (mut presence, mut modules) = (Vec::new(), Vec::new());
    for module in 0..around * along {
        let (i, j) = (module % around, module / around);
        let turn = degrees.to_radians() * f64::from(i) / f64::from(around);
        let frame = DAffine3::from_rotation_translation(
            DQuat::from_rotation_z(turn),
            DVec3::new(radius * turn.cos(), radius * turn.sin(), 0.026 * f64::from(j)),
        );
        let flip = if (i + j) % 2 == 0 { 1.0 } else { -1.0 };
        let mut taxels = flat.iter();
        for slot in 0..12 {
            let at = if slot == 6 || slot == 10 { None } else { taxels.next() };
            let place = at.map(|&(x, y)| frame.transform_point3(DVec3::new(0.0, flip * x, flip * y)));
            sheet.positions.push(place.unwrap_or_default());
            presence.push(if place.is_some() { Presence::Present } else { Presence::Absent });
            modules.push(module);
        }
    }
    sheet.ids = Some((0..).take(modules.len()).map(TaxelId).collect());
    (sheet.presence, sheet.modules) = (Some(presence), Some(modules));
    sheet
}

#[test]
fn modules_around_an_arm_become_one_disk() {
    // Neighbours are 37.5 degrees apart.
    let sheet = modules(8, 4, 0.032, 300.0);
    let positions = sheet.positions.clone();
    let assembled = meshed(sheet);
    let patch = only(&assembled);
    assert_eq!(patch.mesh.positions.len(), 320, "every taxel");
    let (euler, loops) = topology(&patch.mesh);
    assert_eq!(euler, 2 - i64::try_from(loops).unwrap(), "a disk with holes");
    for f in patch.mesh.triangles.ids() {
        let out = patch.mesh.face_cross(f).normalize();
        for v in patch.mesh.triangles[f] {
            let module = patch.taxels.ids[v].0 as usize / 12;
            let [a, b, c] = [0, 1, 4].map(|k| positions[12 * module + k]);
            let plane = (b - a).cross(c - a).normalize();
            let plane = plane * plane.dot(DVec3::new(a.x, a.y, 0.0)).signum();
            assert!(out.dot(plane) > 0.0, "face {f} against module {module}");
        }
    }
}

/// A part of the iCub; `None` without the data from outside the repository.
fn icub(part: &str) -> Option<Draft> {
    Some(io::read_draft(&data(&format!("icub/{part}.txt"))?).unwrap())
}

/// Normals of modules as the mean of the faces within them, for those that have any.
fn module_normals(patch: &Patch) -> BTreeMap<u32, DVec3> {
    let mut normals = BTreeMap::new();
    for (f, t) in patch.mesh.triangles.enumerate() {
        let [a, b, c] = t.map(|v| patch.taxels.ids[v].0 / 12);
        if a == b && b == c {
            *normals.entry(a).or_insert(DVec3::ZERO) += patch.mesh.face_cross(f);
        }
    }
    normals
}

#[test]
fn the_parts_of_the_icub_become_valid_skins() {
    for (part, taxels, pieces) in
        [("left_arm", 350, 4), ("left_forearm_V2", 148, 2), ("left_hand_V2_1", 48, 1), ("torso", 447, 1)]
    {
        let Some(draft) = icub(part) else { continue };
        let assembled = assemble(&draft).unwrap();
        let patches = &assembled.skin.patches;
        assert_eq!(patches.len(), pieces, "{part}");
        let used: usize = patches.iter().map(|p| p.mesh.positions.len()).sum();
        assert_eq!(used, taxels, "{part}: every place is used");
        for patch in patches {
            let (euler, loops) = topology(&patch.mesh);
            assert_eq!(euler, 2 - i64::try_from(loops).unwrap(), "{part}: a disk with holes");
            let normals = module_normals(patch);
            for (f, t) in patch.mesh.triangles.enumerate() {
                for module in t.map(|v| patch.taxels.ids[v].0 / 12) {
                    let cosine = normals.get(&module).map_or(1.0, |n| n.dot(patch.mesh.face_cross(f)));
                    assert!(cosine > 0.0, "{part}: face {f} against module {module}");
                }
            }
        }
        // Not only is it all there: its map has no flip.
        let options = pipeline::BuildOptions::default();
        let map = pipeline::build(&assembled.skin, &options).unwrap();
        assert!(
            report::measure(&map).iter().flat_map(|p| &p.levels).all(|l| l.distortion.flips == 0),
            "{part}"
        );
    }
}

#[test]
fn points_on_no_surface_are_refused() {
    let cloud: Vec<DVec3> = (0..3000)
        .map(|k| DVec3::new(scatter(k), (k as f64 * 0.569_840_290_998).fract(), (k as f64 * 0.4301).fract()))
        .collect();
    let line: Vec<DVec3> = (0..50).map(|k| f64::from(k) * DVec3::new(1.0, 2.0, 3.0)).collect();
    for (positions, expected) in [
        (cloud.clone(), "NoSurface"),
        (cloud.iter().map(|&p| 1e-9 * p).collect(), "NoSurface"),
        (line, "NoFace"),
        (vec![DVec3::ONE; 40], "TooFewPlaces"),
        (vec![DVec3::ZERO, DVec3::X], "TooFewPlaces"),
    ] {
        let error = assemble(&draft_of(bare(&positions))).unwrap_err();
        assert!(format!("{error:?}").starts_with(expected), "{error:?}");
    }
    let sheet = taxels_of(&shapes::lattice(3, 3, 1.0));
    for gap in [0.5, f64::NAN, f64::INFINITY, -1.0] {
        let error = within(sheet.clone(), gap).unwrap_err();
        assert!(matches!(error, SkinError::Gap { .. }));
    }
}

#[test]
fn a_sheet_of_one_taxel_is_left_out() {
    let lone = Sheet { name: "lone".into(), ..bare(&[DVec3::ONE]) };
    let mut draft = draft_of(taxels_of(&shapes::lattice(6, 6, 0.005)));
    draft.sheets.push(lone.clone());
    let assembled = assemble(&draft).unwrap();
    assert_eq!(only(&assembled).mesh.positions.len(), 36);
    let reports =
        |r: &Remark| matches!(r.kind, RemarkKind::SheetLeftOut { taxels: 1, .. }) && r.patch == "lone";
    assert!(assembled.remarks.iter().any(reports), "{:?}", assembled.remarks);
    assert!(assemble(&draft_of(lone)).is_err(), "but alone it is no skin");
}

/// The resolution was a part of the box, and most taxels fell into one cell.
#[test]
fn sentinel_coordinates_merge_no_taxels() {
    let mut positions = shapes::lattice(30, 30, 0.005).positions.as_slice().to_vec();
    positions.push(DVec3::splat(1e10));
    let assembled = meshed(bare(&positions));
    assert_eq!(only(&assembled).mesh.positions.len(), 900);
    assert!(!kinds(&assembled).contains("Merged"));
}

#[test]
fn a_wide_gap_joins_the_same_taxels() {
    let mesh = shaken(&shapes::cap(1500, 0.1, 1.2), 0.0005);
    for gap in [2.5, 20.0] {
        let assembled = within(taxels_of(&mesh), gap).unwrap();
        let patch = only(&assembled);
        assert_eq!(topology(&patch.mesh), (1, 1), "gap {gap}");
        let joined: BTreeSet<u32> = patch.taxels.ids.iter().map(|id| id.0).collect();
        let every: BTreeSet<u32> = (0..).take(mesh.positions.len()).collect();
        assert_eq!(joined, every, "gap {gap}: {:?}", assembled.remarks);
    }
}

#[test]
fn dense_and_sparse_skin_join() {
    // Spacing grows more than 80-fold outward, on a spiral of the golden angle.
    let positions: Vec<DVec3> = (0..6000)
        .map(|k| {
            let (u, turn) = ((f64::from(k) + 0.5) / 6000.0, f64::from(k) * PI * (3.0 - 5.0_f64.sqrt()));
            let r = 0.001 * (81.0_f64.powf(u) - 1.0);
            DVec3::new(r * turn.cos(), r * turn.sin(), 3.0 * r * r)
        })
        .collect();
    let assembled = meshed(bare(&positions));
    let patch = only(&assembled);
    assert_eq!(patch.mesh.positions.len(), 6000);
    assert_eq!(topology(&patch.mesh), (1, 1));
}

#[test]
fn bare_taxels_are_a_note_and_their_faults_are_findings() {
    let mut sheet = taxels_of(&shapes::lattice(6, 6, 0.005));
    assert_eq!(found_in(&draft_of(sheet.clone())), ["bare"], "and nothing is wrong with that");
    let lone: Vec<DVec3> = (0..30).map(|k| 0.01 * f64::from(k) * DVec3::X).collect();
    assert_eq!(found_in(&draft_of(bare(&lone))), ["bare", "no-skin"], "what assembly refuses");
    assert_eq!(found_in(&draft_of(two_islands(2.8))), ["bare", "bare-pieces"]);
    sheet.positions[5] = sheet.positions[4];
    assert_eq!(found_in(&draft_of(sheet.clone())), ["bare", "duplicate-position"]);
    sheet.positions[5] += DVec3::X * 4e-9;
    assert_eq!(elements(&draft_of(sheet), "duplicate-position"), [5]);
    assert_eq!(found_in(&Draft::default()), ["no-triangles"], "a draft without taxels is not bare");
}

#[test]
fn a_sheet_among_others_with_triangles_is_not_meshed() {
    let mesh = shapes::lattice(5, 5, 0.005);
    let triangles = mesh.triangles.iter().map(|t| t.map(VertexId::raw)).collect();
    let sheets = vec![Sheet { triangles, ..taxels_of(&mesh) }, taxels_of(&mesh)];
    let draft = Draft { sheets, ..Draft::default() };
    assert!(draft.sheets.iter().any(|s| !s.triangles.is_empty()));
    assert_eq!(assemble(&draft).unwrap().skin.patches.len(), 1, "stray vertices of a mesh are no skin");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    /// The order in a file is nobody's intention.
    #[test]
    fn the_order_of_taxels_changes_no_face(
        order in Just((0_usize..400).collect::<Vec<_>>()).prop_shuffle(),
        modules in any::<bool>(),
    ) {
        let mesh = shaken(&shapes::saddle(20), 0.001);
        let mut sheet = taxels_of(&mesh);
        sheet.modules = modules.then(|| (0..400).map(|k| k / 20).collect());
        let expected = faces(&meshed(sheet.clone()));
        let mut mixed = Sheet { name: "s".into(), ..Sheet::default() };
        mixed.positions = order.iter().map(|&k| sheet.positions[k]).collect();
        mixed.ids = sheet.ids.as_ref().map(|ids| order.iter().map(|&k| ids[k]).collect());
        mixed.modules = sheet.modules.as_ref().map(|m| order.iter().map(|&k| m[k]).collect());
        prop_assert_eq!(faces(&meshed(mixed)), expected);
    }

    /// A place that is written twice, to other digits or in another frame, is one place.
    #[test]
    fn copies_of_taxels_change_no_face(
        // Powers of ten of the spacing; the first stands for none.
        decade in -20.0..-2.0_f64,
        copies in prop::collection::vec((0_usize..400, -1.0..1.0_f64, -1.0..1.0_f64, -1.0..1.0_f64), 1..300),
        which in 0_usize..3,
    ) {
        let mesh = [
            shaken(&shapes::saddle(20), 0.001),
            shapes::lattice(20, 20, 0.005),
            bent(20, 20, 0.0065, 0.03),
        ][which].clone();
        let beside = 10.0_f64.powf(decade) * [0.0105, 0.005, 0.0065][which] / 3.0_f64.sqrt();
        let mut positions = mesh.positions.as_slice().to_vec();
        let mut taken = BTreeMap::new();
        let mut count = 0;
        for &(k, x, y, z) in &copies {
            // A place in more than two roundings besides its own is no rounding any more.
            let of_k = taken.entry(k).or_insert(0);
            *of_k += 1;
            if *of_k <= 2 {
                positions.push(positions[k] + beside * DVec3::new(x, y, z));
                count += 1;
            }
        }
        let assembled = meshed(bare(&positions));
        prop_assert_eq!(faces(&assembled), faces(&meshed(taxels_of(&mesh))));
        prop_assert_eq!(merged(&assembled).len(), count);
    }

    #[test]
    fn frame_and_unit_change_no_face(
        axis in (-1.0..1.0_f64, -1.0..1.0_f64, 0.1..1.0_f64),
        angle in 0.0..TAU,
        shift in -10.0..10.0_f64,
        decade in -6..7,
    ) {
        let mesh = shaken(&bent(24, 12, 0.0065, 0.03), 0.0008);
        let axis = DVec3::from(axis).normalize();
        let unit = 10.0_f64.powi(decade);
        let moved = mesh.positions.iter().map(|&p| unit * (DQuat::from_axis_angle(axis, angle) * p + shift));
        let moved: Vec<DVec3> = moved.collect();
        prop_assert_eq!(faces(&meshed(bare(&moved))), faces(&meshed(taxels_of(&mesh))));
    }

    /// Whatever it is, it ends, and what comes out is sound: `assemble` validates it.
    #[test]
    fn any_taxels_become_a_valid_skin_or_are_refused(
        places in prop::collection::vec((0_i32..12, 0_i32..12, 0_i32..3), 0..120),
        thin in prop::sample::select(vec![0.0, 1e-12, 0.3, 1.0]),
        unit in prop::sample::select(vec![1e-200, 1e-3, 1e100, 1e308]),
        normals in prop::collection::vec((-1_i32..2, -1_i32..2, -1_i32..2), 120),
        has_normals in any::<bool>(),
    ) {
        let positions: Vec<DVec3> =
            places.iter().map(|&(x, y, z)| unit * 0.05 * DVec3::new(x.into(), y.into(), thin * f64::from(z))).collect();
        let mut sheet = bare(&positions);
        if has_normals {
            let unit = |&(x, y, z): &(i32, i32, i32)| DVec3::new(x.into(), y.into(), z.into()).normalize_or_zero();
            sheet.normals = Some(normals.iter().take(positions.len()).map(unit).collect());
        }
        match assemble(&draft_of(sheet)) {
            Ok(assembled) => prop_assert!(assembled.skin.validate().is_ok()),
            // At the ends of the range of numbers areas overflow and normals vanish.
            Err(_) if unit != 1e-3 => {}
            Err(e) => prop_assert!(
                matches!(
                    e,
                    SkinError::TooFewPlaces { .. } | SkinError::NoSurface { .. } | SkinError::NoFace { .. } | SkinError::NoTriangles
                ),
                "{}", e
            ),
        }
    }
}

/// Taxels on both sides of a foil, and three close together on pads far apart: none was rounded to
/// another's place.
#[test]
fn close_taxels_on_two_sides_are_not_merged() {
    let grid =
        || (0..12).flat_map(|i| (0..12).map(move |j| DVec3::new(f64::from(i), f64::from(j), 0.0) * 0.02));
    let back = grid().map(|p| p - DVec3::Z * 9e-5);
    let mut foil = bare(&grid().chain(back).collect::<Vec<_>>());
    foil.normals = Some((0..288).map(|k| if k < 144 { DVec3::Z } else { -DVec3::Z }).collect());
    let corners = [DVec3::ZERO, DVec3::X, DVec3::new(0.5, 0.75_f64.sqrt(), 0.0)];
    let pads = bare(&grid().flat_map(|p| corners.map(|c| 2.5 * p + 9e-4 * c)).collect::<Vec<_>>());
    for sheet in [foil, pads] {
        let taxels = sheet.positions.len();
        let found = found_in(&draft_of(sheet));
        assert!(!found.contains(&"duplicate-position".to_owned()), "of {taxels} taxels");
    }
}
