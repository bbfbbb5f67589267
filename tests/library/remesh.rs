//! Remeshing: triangles of one size, on the surface, with its edges, rims, holes and handles.

use dermatome::id::FaceId;
use dermatome::mesh::{Adjacency, FillHoles, TriMesh, mean_edge_length, shapes};
use dermatome::remesh::{RemeshError, clip, drop_crumbs, keep_outer, remesh, remesh_skin};
use dermatome::run::Run;
use dermatome::skin::{Draft, Link, LinkId, PatchId, Sheet, Skin};
use dermatome::{AssembleOptions, assemble};
use glam::{DAffine3, DQuat, DVec3};

/// The smallest angle of each triangle, in degrees, sorted.
fn angles(mesh: &TriMesh) -> Vec<f64> {
    let least = |[a, b, c]: [DVec3; 3]| {
        let at = |at: DVec3, p: DVec3, q: DVec3| (p - at).angle_between(q - at).to_degrees();
        at(a, b, c).min(at(b, c, a)).min(at(c, a, b))
    };
    let mut angles: Vec<f64> = mesh.triangles.ids().map(|face| least(mesh.corners(face))).collect();
    angles.sort_by(f64::total_cmp);
    angles
}

/// A block of 0.2 x 0.1 x 0.05 m, as CAD has it: two triangles a side.
fn block() -> TriMesh {
    let p =
        |k: u32| DVec3::new(f64::from(k & 1) * 0.2, f64::from(k >> 1 & 1) * 0.1, f64::from(k >> 2) * 0.05);
    let triangles = [
        [0, 2, 3],
        [0, 3, 1],
        [4, 5, 7],
        [4, 7, 6],
        [0, 1, 5],
        [0, 5, 4],
        [2, 6, 7],
        [2, 7, 3],
        [0, 4, 6],
        [0, 6, 2],
        [1, 3, 7],
        [1, 7, 5],
    ];
    TriMesh::from_arrays((0..8).map(p).collect(), &triangles)
}

/// A cylinder of long thin triangles, as CAD has it: open at both ends.
fn tube() -> TriMesh {
    shapes::tube(96, 2, 0.05, 0.3)
}

fn surfaces() -> [(&'static str, TriMesh, f64); 7] {
    [
        // Its edges are alike: all are short, or none.
        ("rod", shapes::tube(48, 17, 0.04, 0.24), 0.009),
        ("ball", shapes::ball(30, 0.1), 0.005),
        ("ball of small triangles", shapes::ball(120, 0.1), 0.01),
        ("tube", tube(), 0.004),
        ("block", block(), 0.005),
        ("torus", shapes::torus(120, 60, 0.1, 0.04), 0.005),
        ("saddle", shapes::saddle(60), 0.004),
    ]
}

#[test]
fn triangles_are_well_shaped_and_of_one_size() {
    for (name, mesh, spacing) in surfaces() {
        let made = remesh(&mesh, spacing).unwrap();
        let adjacency = Adjacency::new(&made).unwrap();
        let length = mean_edge_length(&made, &adjacency);
        assert!((length / spacing - 1.0).abs() < 0.03, "{name}: edges of {length} m, not {spacing}");
        let angles = angles(&made);
        let hundredth = angles[angles.len() / 100];
        assert!(hundredth > 30.0, "{name}: 1 % of the triangles have angles below {hundredth} degrees");
        assert!(angles[0] > 10.0, "{name}: an angle of {} degrees", angles[0]);
        let old = Adjacency::new(&mesh).unwrap();
        assert_eq!(adjacency.euler_characteristic(), old.euler_characteristic(), "{name}");
        assert_eq!(adjacency.boundary_loops().len(), old.boundary_loops().len(), "{name}");
        assert!(
            (made.area() / mesh.area() - 1.0).abs() < 0.01,
            "{name}: {} m^2, not {}",
            made.area(),
            mesh.area()
        );
    }
}

/// Vertices lie on the triangles of the surface: on a block, in one of its six planes; its edges and corners
/// stay what they were.
#[test]
fn vertices_lie_on_the_surface_and_sharp_edges_stay() {
    let made = remesh(&block(), 0.005).unwrap();
    let size = DVec3::new(0.2, 0.1, 0.05);
    for p in &made.positions {
        let gap = p.abs().min((*p - size).abs()).min_element();
        assert!(gap < 1e-12, "{p} is {gap} m from the block");
    }
    for k in 0..8 {
        let corner = DVec3::new(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2)) * size;
        assert!(made.positions.iter().any(|p| p.distance(corner) < 1e-12), "the corner {corner} is lost");
    }
    assert!((made.area() - 0.07).abs() < 1e-12, "the sides are flat up to their edges: {} m^2", made.area());
    let made = remesh(&shapes::saddle(200), 0.004).unwrap();
    let old = shapes::saddle(200);
    for p in &made.positions {
        let near = old.positions.iter().map(|q| q.distance(*p)).fold(f64::INFINITY, f64::min);
        assert!(near < 1e-3, "{p} is {near} m from all vertices of the saddle");
    }
}

/// Pin-holes and holes that three taxels cannot surround are closed, others stay.
#[test]
fn small_holes_are_closed() {
    let whole = shapes::lattice(40, 40, 0.001);
    // A triangle, two that share an edge, and a strip of six.
    let removed: Vec<usize> = [500, 1000, 1001].into_iter().chain(1500..1506).collect();
    let kept = whole.triangles.enumerate().filter(|(face, _)| !removed.contains(&face.index()));
    let kept: Vec<[u32; 3]> = kept.map(|(_, t)| t.map(|v| v.raw())).collect();
    let mesh = TriMesh::from_arrays(whole.positions.as_slice().to_vec(), &kept);
    let loops = |mesh: &TriMesh| Adjacency::new(mesh).unwrap().boundary_loops().len();
    let made = [0.0009, 0.0028].map(|spacing| loops(&remesh(&mesh, spacing).unwrap()));
    assert_eq!((loops(&mesh), made), (4, [2, 1]), "holes of 3, 4 and 8 mm around");
}

/// Narrow ribs, whose edges cannot change, do not make the flat area next to them coarser.
#[test]
fn details_do_not_change_the_spacing_elsewhere() {
    let position = |i: u32, j: u32| {
        let (rib, flat) = (f64::from(i.min(80)), f64::from(i.saturating_sub(80)));
        DVec3::new(
            0.004 * rib + 0.04 * flat,
            0.01 * f64::from(j),
            if i < 80 { 0.006 * f64::from(i % 2) } else { 0.0 },
        )
    };
    let made = remesh(&shapes::sheet(90, 41, position), 0.01).unwrap();
    let flat = made.triangles.iter().filter(|t| t.iter().all(|&v| made.positions[v].x > 0.34));
    let lengths = flat.flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    let lengths: Vec<f64> = lengths.map(|[a, b]| made.positions[a].distance(made.positions[b])).collect();
    let mean = lengths.iter().sum::<f64>() / lengths.len() as f64;
    assert!((mean / 0.01 - 1.0).abs() < 0.06, "edges of {mean} m, not 0.01");
}

#[test]
fn the_same_surface_gives_the_same_mesh_with_any_threads() {
    let mesh = shapes::torus(60, 30, 0.1, 0.04);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| remesh(&mesh, 0.006).unwrap())
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn skins_get_ids_of_their_own_and_lose_crumbs() {
    let mut skin = Skin::from_mesh("ball", shapes::ball(10, 0.1));
    let ball = skin.patches.iter().next().unwrap().clone();
    for (name, radius) in [("crumb", 0.001), ("second", 0.05)] {
        let mesh = shapes::ball(10, radius);
        skin.patches.push(dermatome::skin::Patch::from_mesh(name, ball.link, mesh));
    }
    let made = remesh_skin(&skin, &[0.01; 3], Run::default()).unwrap();
    made.skin.validate().unwrap();
    assert_eq!(made.left_out, ["crumb"]);
    let ids: Vec<u32> = made.skin.patches.iter().flat_map(|p| p.taxels.ids.iter().map(|id| id.0)).collect();
    assert!((1..).zip(&ids).all(|(k, id)| k == *id));
    // Two edges are 1700 km long and at most a millimetre apart.
    let needle = dermatome::mesh::TriMesh::from_arrays(
        [[0.0, 0.0], [1.7e6, 0.0], [0.0, 1e-3]].map(|[x, y]| DVec3::new(x, y, 0.0)).to_vec(),
        &[[0, 1, 2]],
    );
    let error = remesh(&needle, 1.0).unwrap_err();
    assert!(matches!(error, RemeshError::Needles { .. }), "{error}");
    for (spacing, is_expected) in [(0.0, true), (f64::NAN, true), (1e-7, false), (-1.0, true)] {
        let error = remesh(&ball.mesh, spacing).unwrap_err();
        assert_eq!(matches!(error, RemeshError::Spacing { .. }), is_expected, "{error}");
        assert!(is_expected || matches!(error, RemeshError::TooFine { .. }), "{error}");
    }
}

/// Small pieces are left out as long as they are little together; of like ones all stay or none.
#[test]
fn crumbs_are_little_of_their_link_together() {
    let mut skin = Skin::from_mesh("ball", shapes::ball(10, 0.1));
    let link = skin.patches.iter().next().unwrap().link;
    let mut add = |name: &str, radius: f64| {
        skin.patches.push(dermatome::skin::Patch::from_mesh(name, link, shapes::ball(10, radius)));
    };
    // Of 0.04 and 0.58 % of the area.
    ["logo", "screw"].into_iter().for_each(|name| add(name, 0.002));
    (0..12).for_each(|k| add(&format!("drive {k}"), 0.0079));
    let dropped = |least: f64, spacings: Option<&[f64]>| drop_crumbs(&mut skin.clone(), least, spacings);
    assert_eq!(dropped(0.01, None), ["logo", "screw"]);
    assert_eq!(dropped(0.0005, None), [""; 0], "one of two like pieces");
    assert_eq!(dropped(0.1, None).len(), 14);
    assert_eq!(dropped(0.01, Some(&[0.01; 15])).len(), 14, "with less than twelve taxels");
    assert_eq!(dropped(0.0, Some(&[0.01; 15])), [""; 0]);
}

fn sheet(mesh: &TriMesh) -> Sheet {
    let triangles = mesh.triangles.iter().map(|t| t.map(|v| v.raw())).collect();
    Sheet { positions: mesh.positions.as_slice().to_vec(), triangles, ..Sheet::default() }
}

/// A block of two triangles a side, cut by a box in a turned frame: the rim of the new mesh lies in the sides of the
/// box, and the area is that of the block within it, also where no two triangles share a vertex.
#[test]
fn a_box_cuts_a_straight_rim() {
    let block = block();
    let apart: Vec<DVec3> = block.triangles.ids().flat_map(|face| block.corners(face)).collect();
    let own = (0_u32..).step_by(3).take(apart.len() / 3).map(|first| [first, first + 1, first + 2]).collect();
    let apart = Sheet { positions: apart, triangles: own, ..Sheet::default() };
    let pose = DAffine3::from_rotation_translation(DQuat::from_rotation_z(0.5), DVec3::new(0.3, 0.0, 0.1));
    let corners = [0.05, 0.13].map(|x| DVec3::new(x, (x - 0.09) * 25.0, (x - 0.09) * 25.0));
    let to_box = |p: DVec3| pose.inverse().transform_point3(p);
    for sheet in [sheet(&block), apart] {
        let positions: Vec<DVec3> = sheet.positions.iter().map(|&p| pose.transform_point3(p)).collect();
        let clipped = clip(&Sheet { positions, ..sheet }, pose.inverse(), corners);
        let skin =
            assemble(&Draft { sheets: vec![clipped], ..Draft::default() }, &AssembleOptions::default());
        let mesh = skin.unwrap().skin.patches[PatchId::new(0)].mesh.clone();
        assert!((mesh.area() - 0.08 * 2.0 * (0.1 + 0.05)).abs() < 1e-12, "{}", mesh.area());
        let made = remesh(&mesh, 0.01).unwrap();
        let rims = Adjacency::new(&made).unwrap().boundary_loops();
        assert_eq!(rims.len(), 2);
        for &v in rims.iter().flatten() {
            let x = to_box(made.positions[v]).x;
            assert!((x - 0.05).abs().min((x - 0.13).abs()) < 1e-9, "{x}");
        }
    }
}

/// Two faces on the same corners, wound one way and the other, are a surface as any: its two sides are remeshed.
#[test]
fn coincident_faces_end_with_few_taxels() {
    let corners = [[0.0, 0.0], [2.2, 0.0], [0.6, 0.8]].map(|[x, y]| DVec3::new(x, y, 0.0)).to_vec();
    let mesh = TriMesh::from_arrays(corners, &[[0, 1, 2], [1, 0, 2]]);
    for spacing in [0.5, 0.4, 0.3, 0.25, 0.2, 0.1] {
        let made = remesh(&mesh, spacing).unwrap();
        assert!(Adjacency::new(&made).is_ok(), "{spacing}: two edges between the same vertices");
        let one_a_cell = 2.0 * 0.88 / (0.75_f64.sqrt() * spacing * spacing);
        assert!((made.positions.len() as f64) < 4.0 * one_a_cell);
    }
}

/// A square hole of one spacing has a rim of four edges, also in the new mesh: a pin-hole, which is closed as in a file.
#[test]
fn pin_holes_of_the_new_mesh_are_closed() {
    let corner = |k: u32| DVec3::new(f64::from(k % 6), f64::from(k / 6), 0.0);
    let cells = (0..25).filter(|&cell| cell != 12).map(|cell| cell / 5 * 6 + cell % 5);
    let triangles: Vec<[u32; 3]> = cells.flat_map(|k| [[k, k + 1, k + 7], [k, k + 7, k + 6]]).collect();
    let plate = TriMesh::from_arrays((0..36).map(corner).collect(), &triangles);
    let made = remesh(&plate, 1.0).unwrap();
    assert_eq!([&plate, &made].map(|mesh| Adjacency::new(mesh).unwrap().euler_characteristic()), [0, 1]);
}

/// Of a hollow body only the outer wall is kept, of a tube both ends of which are open too, and of a body in a
/// body nothing; which way the faces are wound does not matter.
#[test]
fn what_is_within_is_left_out() {
    let [outer, within] =
        [(0.1, 0.7), (0.03, 0.1)].map(|(r, l)| shapes::tube(32, 8, r, l)).map(|mesh| sheet(&mesh));
    // In the middle of the other, out of sight of its ends.
    let positions = within.positions.iter().map(|p| p + DVec3::Z * 0.3).collect();
    let within = Sheet { positions, ..within };
    let count = |sheet: &Sheet| sheet.triangles.len();
    let ball = sheet(&shapes::ball(8, 1.0));
    let inverted = Sheet {
        triangles: ball.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect(),
        ..sheet(&shapes::ball(8, 2.0))
    };
    let short = Sheet { ids: Some(vec![dermatome::skin::TaxelId(1)]), ..outer.clone() };
    // An unused vertex that is not a number, another far away.
    let mut broken = inverted.clone();
    broken.positions.extend([DVec3::NAN, DVec3::splat(1e200)]);
    for (sheets, kept) in [
        (vec![outer.clone()], vec![count(&outer)]),
        (vec![ball.clone(), inverted.clone()], vec![count(&inverted)]),
        (vec![outer.clone(), within.clone()], vec![count(&outer)]),
        // A sheet that is refused later stays, and changes nothing for those after it.
        (vec![short.clone(), inverted.clone(), ball.clone()], vec![count(&short), count(&inverted)]),
        (vec![broken.clone(), ball.clone()], vec![count(&broken)]),
    ] {
        let all: usize = sheets.iter().map(count).sum();
        let mut draft = Draft { sheets, ..Draft::default() };
        let dropped = keep_outer(&mut draft).faces;
        assert_eq!(draft.sheets.iter().map(count).collect::<Vec<_>>(), kept);
        // Faces are divided where a part of them may be seen.
        assert!(dropped + kept.iter().sum::<usize>() >= all);
    }
}

/// Weights that change linearly along a body are those of its surface at new taxels, too.
#[test]
fn new_taxels_follow_the_links_of_the_old_ones() {
    let mut skin = Skin::from_mesh("arm", shapes::tube(48, 17, 0.04, 0.24));
    let link = |name: &str| Link { name: name.into(), parent: None, pose: DAffine3::IDENTITY };
    skin.links = ["a", "b", "c"].map(link).into_iter().collect();
    let [a, b, c] = [0, 1, 2].map(LinkId::from);
    let patch = &mut skin.patches[PatchId::new(0)];
    let [low, high] = [f64::min, f64::max].map(|of| patch.mesh.positions.iter().map(|p| p.z).fold(0.1, of));
    // All of the first link at one end, all of the third at the other.
    let weights = move |p: DVec3| {
        let share = 2.0 * (p.z - low) / (high - low);
        [(1.0 - share).max(0.0), 1.0 - (share - 1.0).abs(), (share - 1.0).max(0.0)]
    };
    let joints = |p: &DVec3| {
        let [x, y, z] = weights(*p);
        [(a, x), (b, y), (c, z), (a, 0.0)]
    };
    patch.taxels.joints = Some(patch.mesh.positions.map(joints));
    patch.taxels.binds = vec![(b, DAffine3::from_translation(DVec3::X))];
    skin.validate().unwrap();
    let made = remesh_skin(&skin, &[0.006], Run::default()).unwrap().skin;
    made.validate().unwrap();
    let fresh = &made.patches[PatchId::new(0)];
    assert_eq!(fresh.taxels.binds, skin.patches[PatchId::new(0)].taxels.binds);
    let joints = fresh.taxels.joints.as_ref().unwrap();
    for (v, &p) in fresh.mesh.positions.enumerate() {
        let found = [a, b, c].map(|link| joints[v].iter().filter(|x| x.0 == link).map(|x| x.1).sum::<f64>());
        // A row of the old mesh lies in the middle, where the weights have a kink. A taxel may lie 3 % of the spacing off.
        let off = found.iter().zip(weights(p)).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
        assert!(off < 1e-2, "{v} at {p}: {found:?}, not {:?}", weights(p));
    }
}

/// The surface that a profile of radii and heights sweeps around z, each of its sides in four.
fn swept(profile: &[[f64; 2]]) -> Sheet {
    let around = 48_u32;
    let fine: Vec<[f64; 2]> = profile
        .windows(2)
        .flat_map(|ends| {
            (0..4).map(|k| [0, 1].map(|a| ends[0][a] + (ends[1][a] - ends[0][a]) * f64::from(k) / 4.0))
        })
        .chain(profile.last().copied())
        .collect();
    let at = |&[r, z]: &[f64; 2]| {
        (0..around).map(move |k| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(around)).sin_cos();
            DVec3::new(r * cos, r * sin, z)
        })
    };
    let cell = |row: u32, k: u32| {
        let [a, b] = [k, (k + 1) % around].map(|k| row * around + k);
        [[a, b, b + around], [a, b + around, a + around]]
    };
    let rows = u32::try_from(fine.len()).unwrap() - 1;
    let triangles = (0..rows).flat_map(|row| (0..around).flat_map(move |k| cell(row, k))).collect();
    Sheet { positions: fine.iter().flat_map(at).collect(), triangles, ..Sheet::default() }
}

fn area_where(sheet: &Sheet, holds: impl Fn(DVec3) -> bool) -> f64 {
    let at = |v: u32| sheet.positions[v as usize];
    let corners = sheet.triangles.iter().map(|t| t.map(at));
    corners
        .filter(|[a, b, c]| holds((a + b + c) / 3.0))
        .map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0)
        .sum()
}

/// A bottle, a cup and a tube with rounded rims are one smooth surface each: their outside is kept, and of their inside what
/// many directions see, at the mouth alone.
#[test]
fn vessels_keep_their_outside() {
    let rim = |inner: f64, outer: f64, z: f64| {
        let (middle, radius) = (0.5 * (inner + outer), 0.5 * (outer - inner));
        (0..=8).map(move |k| {
            let (sin, cos) = (std::f64::consts::PI * f64::from(k) / 8.0).sin_cos();
            [middle + radius * cos, z + radius * sin]
        })
    };
    let bottle =
        [[0.001, 0.0], [0.026, 0.0], [0.03, 0.004], [0.03, 0.1], [0.025, 0.12], [0.015, 0.14], [0.01, 0.155]];
    let within =
        [[0.008, 0.154], [0.013, 0.139], [0.023, 0.119], [0.028, 0.1], [0.028, 0.005], [0.025, 0.002]];
    let bottle: Vec<_> =
        bottle.into_iter().chain(rim(0.008, 0.01, 0.17)).chain(within).chain([[0.001, 0.002]]).collect();
    let cup = [[0.001, 0.0], [0.036, 0.0], [0.04, 0.004]].into_iter().chain(rim(0.037, 0.04, 0.1));
    let cup: Vec<_> = cup.chain([[0.037, 0.006], [0.034, 0.003], [0.001, 0.003]]).collect();
    let mut tube: Vec<_> =
        rim(0.02, 0.022, 0.15).chain(rim(-0.022, -0.02, 0.05).map(|[r, z]| [-r, 0.1 - z])).collect();
    tube.push(tube[0]);
    for (name, profile, deep) in [("bottle", bottle, 0.15), ("cup", cup, 0.04), ("tube", tube, 0.115)] {
        let sheet = swept(&profile);
        // Below the rim the wall is 2 to 3 mm thick, and its outside is the larger radius at each height.
        let reach = |p: DVec3| p.truncate().length();
        let is_outside = |p: DVec3| {
            let crossing = profile.windows(2).filter(|ends| (ends[0][1] - p.z) * (ends[1][1] - p.z) <= 0.0);
            let radius = |ends: &[[f64; 2]]| {
                let share = (p.z - ends[0][1]) / (ends[1][1] - ends[0][1]);
                if share.is_finite() { ends[0][0] + share * (ends[1][0] - ends[0][0]) } else { ends[0][0] }
            };
            crossing.map(radius).all(|r| r < reach(p) + 1.5e-3) || p.z < 5e-4
        };
        let is_deep = |p: DVec3| !is_outside(p) && p.z < deep && (name != "tube" || p.z > 0.085);
        let mut draft = Draft { sheets: vec![sheet.clone()], ..Draft::default() };
        let left_out = keep_outer(&mut draft);
        let [before, after] = [&sheet, &draft.sheets[0]].map(|sheet| area_where(sheet, is_outside));
        assert!(after > 0.995 * before, "{name}: {after} of {before} m^2 of the outside");
        let inside = area_where(&draft.sheets[0], is_deep);
        assert!(inside < 0.01 * area_where(&sheet, is_deep), "{name}: {inside} m^2 deep inside are kept");
        assert!(left_out.faces > 0 && left_out.notes()[0].contains("not seen from outside"), "{name}");
    }
}

/// A post in a block, each of two triangles a side: what is in the other solid is left out, to 1/128 of the body.
#[test]
fn solids_that_pierce_each_other_lose_what_is_buried() {
    let solid = |size: DVec3, at: DVec3| {
        let mut sheet = sheet(&block());
        sheet.positions.iter_mut().for_each(|p| *p = (*p / DVec3::new(0.2, 0.1, 0.05) - 0.5) * size + at);
        sheet
    };
    for out in [0.005, 0.01, 0.03] {
        let block = solid(DVec3::new(0.06, 0.06, 0.04), DVec3::ZERO);
        let post = solid(DVec3::new(0.01, 0.01, 0.035), DVec3::Z * (0.02 + out - 0.0175));
        let mut draft = Draft { sheets: vec![block, post], ..Draft::default() };
        let left_out = keep_outer(&mut draft);
        // The faces of the file count, not the parts that they are divided into.
        assert!(left_out.faces + left_out.parts <= 24, "{left_out:?}");
        let said = &left_out.notes()[0];
        assert!(left_out.parts > 0 && said.contains("a part"), "{said}");
        let area: f64 = draft.sheets.iter().map(|sheet| area_where(sheet, |_| true)).sum();
        let right = 2.0 * 0.06 * 0.06 + 4.0 * 0.06 * 0.04 + 4.0 * 0.01 * out;
        assert!((area / right - 1.0).abs() < 0.01, "{area} m^2, right {right}, {} mm out", 1e3 * out);
        let buried = area_where(&draft.sheets[1], |p| p.z < 0.0195);
        assert!(buried < 0.005 * area, "{buried} m^2 are in the block");
        let highest = draft.sheets[1].positions.iter().map(|p| p.z).fold(0.0, f64::max);
        assert!((highest - 0.02 - out).abs() < 1e-12);
    }
}

/// A mesh that a link has twice is kept once, also where its corners are numbered anew.
#[test]
fn faces_of_two_sheets_at_one_place_are_kept_once() {
    let block = sheet(&block());
    let again = Sheet {
        positions: block.positions.iter().rev().copied().collect(),
        triangles: block.triangles.iter().map(|&[a, b, c]| [7 - b, 7 - c, 7 - a]).collect(),
        ..Sheet::default()
    };
    let mut draft = Draft { sheets: vec![block.clone(), again], ..Draft::default() };
    let left_out = keep_outer(&mut draft);
    assert_eq!((draft.sheets.len(), left_out.faces), (1, 12));
    assert_eq!(draft.sheets[0].triangles, block.triangles);
}

/// A rod of 24 strips, each two triangles of 300 x 1 mm, whose middles lie in two blocks: most of what stands out of the blocks is kept.
#[test]
fn rods_of_long_triangles_keep_what_stands_out() {
    let rod = sheet(&shapes::tube(24, 2, 0.004, 0.3));
    let middle = rod.positions.iter().copied().sum::<DVec3>() / rod.positions.len() as f64;
    let cube = |at: f64| {
        let mut sheet = sheet(&block());
        let place = |p: DVec3| 0.05 * (p / DVec3::new(0.2, 0.1, 0.05) - 0.5) + middle + at * DVec3::Z;
        sheet.positions.iter_mut().for_each(|p| *p = place(*p));
        sheet
    };
    let is_out = |p: DVec3| ((p.z - middle.z).abs() - 0.05).abs() > 0.025;
    for (at, others) in [(0.05, vec![cube(0.05), cube(-0.05)]), (0.5, vec![cube(0.5)])] {
        let mut draft = Draft { sheets: vec![rod.clone()], ..Draft::default() };
        draft.sheets.extend(others);
        keep_outer(&mut draft);
        let out = area_where(&draft.sheets[0], |p| at > 0.1 || is_out(p));
        let right = std::f64::consts::TAU * 0.004 * if at > 0.1 { 0.3 } else { 0.2 };
        assert!(out > 0.8 * right && out < 1.01 * right, "{out} m^2, right {right}");
    }
}

/// A plate of 0.2 m with a hole in its middle, as CAD has it: rings between corners at `radii` times a square, or a circle.
fn holed(corners: u32, is_round: bool) -> TriMesh {
    let at = |ring: u32, k: u32| {
        let (y, x) = (std::f64::consts::TAU * (f64::from(k) + 0.5) / f64::from(corners)).sin_cos();
        let on_square = DVec3::new(x, y, 0.0) / x.abs().max(y.abs());
        if ring == 1 {
            0.1 * on_square
        } else if is_round {
            DVec3::new(0.04 * x, 0.04 * y, 0.0)
        } else {
            0.04 * on_square
        }
    };
    let positions = (0..2).flat_map(|ring| (0..corners).map(move |k| at(ring, k))).collect();
    let cell = |k: u32| {
        let next = (k + 1) % corners;
        [[k, corners + k, corners + next], [k, corners + next, next]]
    };
    TriMesh::from_arrays(positions, &(0..corners).flat_map(cell).collect::<Vec<_>>())
}

/// What fills a hole is no skin: meshed anew it is filled again, without a taxel. It was covered with taxels.
#[test]
fn filled_holes_have_no_taxels_of_a_new_mesh() {
    for (name, mesh) in [("square", holed(4, false)), ("round", holed(32, true))] {
        let (corners, faces) = (mesh.positions.len() / 2, mesh.triangles.len());
        let mut draft = Draft::default();
        draft.sheets.push(sheet(&mesh));
        let options = AssembleOptions { fill_holes: FillHoles::UpTo(corners), ..AssembleOptions::default() };
        let skin = assemble(&draft, &options).unwrap().skin;
        assert_eq!(skin.patches[PatchId::new(0)].filled, corners - 2);
        let made = remesh_skin(&skin, &[0.005], Run::default()).unwrap();
        let patch = &made.skin.patches[PatchId::new(0)];
        let is_within = |p: &&DVec3| {
            let reach = if corners == 4 { p.x.abs().max(p.y.abs()) } else { p.truncate().length() };
            reach < 0.04 * 0.99
        };
        assert_eq!(patch.mesh.positions.iter().filter(is_within).count(), 0, "{name}: taxels in the hole");
        assert_eq!(Adjacency::new(&patch.mesh).unwrap().boundary_loops().len(), 1, "{name}");
        assert!(made.unfilled.is_empty(), "{name}");
        let own = patch.mesh.triangles.len() - patch.filled;
        let area = |faces: &mut dyn Iterator<Item = FaceId>| {
            faces.map(|face| 0.5 * patch.mesh.face_cross(face).length()).sum::<f64>()
        };
        let [skin_area, in_hole] = [
            area(&mut patch.mesh.triangles.ids().take(own)),
            area(&mut patch.mesh.triangles.ids().skip(own)),
        ];
        let before = |faces: std::ops::Range<usize>| {
            faces
                .map(|k| 0.5 * skin.patches[PatchId::new(0)].mesh.face_cross(FaceId::new(k)).length())
                .sum::<f64>()
        };
        assert!((skin_area / before(0..faces) - 1.0).abs() < 0.01, "{name}: {skin_area} m^2 of skin");
        assert!(
            (in_hole / before(faces..faces + corners - 2) - 1.0).abs() < 0.03,
            "{name}: {in_hole} m^2 in the hole"
        );
        let lowest = patch.mesh.triangles.ids().map(|face| {
            let [a, b, c] = patch.mesh.corners(face);
            (b - a).cross(c - a).length() / a.distance(b).max(b.distance(c)).max(c.distance(a))
        });
        assert!(lowest.fold(1.0, f64::min) > 1e-4, "{name}: a face without height");
    }
}
