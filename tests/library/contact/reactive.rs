//! Laws of reactive answers: the skin is as far as the interval says, and the interval is narrow.

use std::path::Path;

use dermatome::contact::{ContactError, ContactIndex, Query, Reactive, Refine};
use dermatome::id::FaceId;
use dermatome::io::{read_draft, read_map};
use dermatome::map::SkinMap;
use dermatome::mesh::{TriMesh, shapes};
use dermatome::pipeline::{BuildOptions, build};
use dermatome::pyramid::LevelId;
use dermatome::skin::{AssembleOptions, LinkId, PatchId, Skin, assemble};
use glam::{DAffine3, DQuat, DVec3};
use proptest::prelude::*;
use rayon::prelude::*;

use super::{REACTIVE, finest, posed, skin_of, soup};

/// Two patches on two links, 4 mm apart where they are nearest.
fn robot(first: TriMesh, second: TriMesh) -> SkinMap {
    let turned = DAffine3::from_rotation_translation(DQuat::from_rotation_y(3.0), DVec3::Z * -0.204);
    build(&skin_of([(first, DAffine3::IDENTITY), (second, turned)]), &BuildOptions::default()).unwrap()
}

fn shape(k: usize) -> TriMesh {
    match k {
        0 => shapes::cap(1500, 0.1, 0.6),
        1 => shapes::lattice(25, 20, 0.006),
        2 => {
            let mut saddle = shapes::saddle(24);
            saddle.positions.iter_mut().for_each(|p| *p *= 0.1);
            saddle
        }
        3 => shapes::tube(40, 16, 0.03, 0.1),
        // Folded to a right angle every fourth row, with two columns in the same place.
        4 => shapes::sheet(30, 24, |i, j| {
            let (up, across) = if j / 4 % 2 == 0 { (j % 4, 0) } else { (4, j % 4) };
            let x = f64::from(i.saturating_sub(u32::from(i > 14)));
            DVec3::new(x, f64::from(j / 8 * 4 + across), f64::from(up)) * 0.004
        }),
        _ => {
            let mut rough = shapes::cap(900, 0.1, 0.8);
            for (k, p) in rough.positions.iter_mut().enumerate() {
                *p *= 1.0 + 0.01 * (17.0 * k as f64).sin();
            }
            rough
        }
    }
}

proptest! {
    #![proptest_config(soup::fixed(12, 6))]

    /// From near and far, in the world and on a link: the skin is between `least` and `most` away, and the point of the answer
    /// is a point of the skin that is no farther.
    #[test]
    fn every_interval_holds(
        kinds in (0_usize..6, 0_usize..6),
        turn in prop::array::uniform3(-1.0_f64..1.0),
        aims in prop::collection::vec((prop::array::uniform3(-1.0_f64..1.0), -4_i32..2, any::<prop::sample::Index>(), 0_usize..2, prop::bool::ANY), 60),
    ) {
        let map = robot(shape(kinds.0), shape(kinds.1));
        let mut index = ContactIndex::with_options(&map, &REACTIVE).unwrap();
        let turn = DVec3::from(turn);
        let pose = DAffine3::from_rotation_translation(DQuat::from_scaled_axis(turn), turn * 0.1);
        index.set_motion(&posed([(LinkId::new(1), pose)]), 0.0).unwrap();
        for (direction, exponent, vertex, patch, on_link) in aims {
            let link = map.patches[PatchId::new(patch)].link;
            let at = *vertex.get(finest(&map, patch).positions.as_slice()) + DVec3::from(direction) * 10_f64.powi(exponent);
            let query = if on_link { Query::on_link(link, at) } else { Query::from(index.poses()[link].transform_point3(at)) };
            let away = index.locate(query).unwrap().distance.abs();
            let answer = index.reactive(query).unwrap();
            let is_held = answer.least <= away + 1e-12 && away <= answer.most + 1e-12;
            prop_assert!(is_held, "{away} is not from {} to {}", answer.least, answer.most);
            for distance in [0.5 * away, 1.5 * away] {
                prop_assert!(answer.is_within(distance).is_none_or(|within| within == (away <= distance)));
            }
            let [face, walk] = [Refine::Face, Refine::Walk].map(|refine| index.hit_of(query, &answer, refine).unwrap());
            prop_assert!((walk.patch, walk.link) == (answer.patch, answer.link));
            prop_assert!(face.distance.abs() <= answer.most + 1e-9 && walk.distance.abs() <= answer.most + 1e-9);
            prop_assert!(away <= walk.distance.abs() + 1e-12 && walk.distance.abs() <= face.distance.abs() + 1e-12);
            let narrowed = answer.narrowed(&walk);
            prop_assert!(narrowed.error() <= answer.error() + 1e-12 && away <= narrowed.most + 1e-12);
            for level in 0..map.patches[walk.patch].levels.len() {
                prop_assert!(index.cell(&walk, LevelId::new(level)).is_some());
            }
        }
    }
}

/// How many contacts are not as far from the skin as their answers say, and the widths of the intervals of those above or
/// below the skin, by how far off they are.
fn tried(index: &ContactIndex, map: &SkinMap, count: u32) -> (usize, [Vec<f64>; 4]) {
    const FAR_MM: [f64; 4] = [3.0, 10.0, 20.0, 50.0];
    let tries: Vec<(bool, Option<f64>, f64)> = (0..count)
        .into_par_iter()
        .map(|k| {
            let bits = |salt: u32| {
                let x = (k ^ salt.wrapping_mul(0x9e37_79b9)).wrapping_mul(0x85eb_ca6b);
                let x = (x ^ x >> 13).wrapping_mul(0xc2b2_ae35);
                x ^ x >> 16
            };
            let hash = |salt: u32| f64::from(bits(salt)) / f64::from(u32::MAX);
            let patch = &map.patches[PatchId::new(bits(1) as usize % map.patches.len())];
            let mesh = &patch.levels[LevelId::new(0)].level.mesh;
            let face = FaceId::new(bits(2) as usize % mesh.triangles.len());
            let [a, b, c] = mesh.corners(face);
            let (s, t) = (hash(3).sqrt(), hash(4));
            let [x, y, z] = [5, 6, 7].map(|salt| 2.0 * hash(salt) - 1.0);
            let reach = [1e-4, 0.003, 0.02, 0.1][k as usize % 4];
            // Along the normal, but a little tilted; or anywhere.
            let is_above = k % 8 < 4;
            let normal = (b - a).cross(c - a).normalize_or_zero() * if k % 16 < 8 { 1.0 } else { -1.0 };
            let tilted = normal + 0.3 * DVec3::new(x, y, z);
            let off = if is_above { tilted.normalize() * hash(8) } else { DVec3::new(x, y, z) };
            let at = a * (1.0 - s) + b * (s * (1.0 - t)) + c * (s * t) + off * reach;
            let query = Query::from(index.poses()[patch.link].transform_point3(at));
            let away = index.locate(query).unwrap().distance.abs();
            let answer = index.reactive(query).unwrap();
            let is_held = answer.least <= away + 1e-12 && away <= answer.most + 1e-12;
            (is_held, is_above.then_some(1e3 * away), 1e3 * (answer.most - answer.least))
        })
        .collect();
    let mut widths = [const { Vec::new() }; 4];
    for &(_, away, width) in &tries {
        if let Some(band) = FAR_MM.iter().position(|far| away.is_some_and(|away| away < *far)) {
            widths[band].push(width);
        }
    }
    widths.iter_mut().for_each(|widths| widths.sort_by(f64::total_cmp));
    (tries.iter().filter(|(is_held, ..)| !is_held).count(), widths)
}

fn named(name: &str) -> SkinMap {
    let options = BuildOptions { keep_going: true, ..BuildOptions::default() };
    let skin = match name {
        "cap" => Skin::from_mesh("cap", shapes::cap(20_000, 0.1, 1.92)),
        "large_cap" => Skin::from_mesh("cap", shapes::cap(100_000, 0.1, 1.92)),
        file => {
            let path = if file.contains('/') { file.into() } else { format!("meshes/{file}.glb") };
            let draft = read_draft(Path::new(&path)).unwrap();
            assemble(&draft, &AssembleOptions { keep_going: true, ..AssembleOptions::default() })
                .unwrap()
                .skin
        }
    };
    build(&skin, &options).unwrap()
}

/// On real skins, up to 50 mm off: no violation, and the median of the widths is at most 1 mm.
#[test]
fn intervals_are_narrow() {
    for name in ["robot", "forearm"] {
        let map = named(name);
        let (wrong, widths) = tried(&ContactIndex::with_options(&map, &REACTIVE).unwrap(), &map, 40_000);
        assert_eq!(wrong, 0, "{name}");
        for (band, widths) in widths.iter().enumerate() {
            let [median, most] = [widths.len() / 2, widths.len() * 99 / 100].map(|k| widths[k]);
            let allowed = [5.0, 5.0, 5.0, 9.0][band];
            assert!(median <= 1.0 && most <= allowed, "{name}, band {band}: {median} mm, 99 % {most} mm");
        }
    }
}

/// `SKINS="robot hand cap FOLDER/FILE" cargo test --release --test library ten_million -- --ignored --nocapture`
#[test]
#[ignore = "takes minutes a skin"]
fn ten_million_intervals_hold() {
    for name in std::env::var("SKINS").unwrap_or("robot".into()).split(' ') {
        let map = if name.ends_with(".map.glb") { read_map(Path::new(name)).unwrap() } else { named(name) };
        let index = ContactIndex::with_options(&map, &REACTIVE).unwrap();
        let (wrong, widths) = tried(&index, &map, 10_000_000);
        let median = widths.map(|widths| [widths[widths.len() / 2], widths[widths.len() * 99 / 100]]);
        println!("{name}: {wrong} of 10^7 outside, mm wide {median:.2?}");
        assert_eq!(wrong, 0);
    }
}

/// Many links: whatever the pose, and one after the other as side by side.
#[test]
fn intervals_of_a_robot_hold_in_every_pose() {
    let pose = DAffine3::from_rotation_translation(DQuat::from_rotation_x(0.3), DVec3::new(0.02, 0.0, 0.06));
    let mut skin = skin_of((0..12).map(|_| (shapes::cap(300, 0.05, 0.9), pose)));
    for k in 1..12 {
        skin.links[LinkId::new(k)].parent = Some(LinkId::new(k - 1));
    }
    // Two patches of one link.
    skin.patches[PatchId::new(7)].link = LinkId::new(6);
    let map = build(&skin, &BuildOptions::default()).unwrap();
    let mut index = ContactIndex::with_options(&map, &REACTIVE).unwrap();
    for turn in 0..4 {
        let turned = DAffine3::from_rotation_y(0.4 * f64::from(turn)) * map.links[LinkId::new(3)].pose;
        index.set_motion(&posed([(LinkId::new(3), turned)]), 0.0).unwrap();
        assert_eq!(tried(&index, &map, 5000).0, 0, "turned {turn} times");
    }
    let queries: Vec<DVec3> =
        (0..3000).map(|k| DVec3::new(1.0, 7.0, 3.0).map(|f| (f * f64::from(k)).sin()) * 0.3).collect();
    let alone: Vec<_> = queries.iter().map(|q| index.reactive(*q).unwrap()).collect();
    let again = ContactIndex::with_options(&map, &REACTIVE).unwrap();
    assert_ne!(alone[0], again.reactive(queries[0]).unwrap(), "the links have moved");
    let beside: Vec<_> = queries.par_iter().map(|q| index.reactive(*q).unwrap()).collect();
    assert_eq!(alone, beside);
}

#[test]
fn reactive_answers_need_an_index_with_them() {
    let map = robot(shape(1), shape(1));
    let index = ContactIndex::new(&map).unwrap();
    assert_eq!(index.reactive(DVec3::ZERO), Err(ContactError::NotIndexed { what: "reactive answers" }));
    let index = ContactIndex::with_options(&map, &REACTIVE).unwrap();
    assert!(
        index.reactive(DVec3::NAN).is_err()
            && index.reactive(Query::in_link(LinkId::new(9), DVec3::ZERO)).is_err()
    );
    let far = index.reactive(DVec3::X * 9.0).unwrap();
    assert!(far.least > 8.0 && far.most < 9.3, "from beyond the octree: {far:?}");
    let answer = index.reactive(DVec3::ZERO).unwrap();
    for wrong in
        [Reactive { patch: PatchId::new(7), ..answer }, Reactive { face: FaceId::new(1 << 20), ..answer }]
    {
        assert_eq!(index.hit_of(DVec3::ZERO, &wrong, Refine::Walk), None);
    }
}
