//! Laws of answers on coarse levels: every bound of the distance holds.

use dermatome::contact::{ContactError, ContactIndex, Query};
use dermatome::map::SkinMap;
use dermatome::mesh::{TriMesh, shapes};
use dermatome::pipeline::{BuildOptions, build};
use dermatome::pyramid::LevelId;
use dermatome::skin::{LinkId, PatchId, Skin};
use glam::{DAffine3, DQuat, DVec3};
use proptest::prelude::*;

use crate::{LEVELS, posed, skin_of, soup};

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

    /// On every level, from near and far, in the world and on a link: the skin is between `least` and `most`
    /// away.
    #[test]
    fn every_bound_holds(
        kinds in (0_usize..6, 0_usize..6),
        turn in prop::array::uniform3(-1.0_f64..1.0),
        aims in prop::collection::vec((prop::array::uniform3(-1.0_f64..1.0), -4_i32..1, any::<prop::sample::Index>(), 0_usize..2, prop::bool::ANY), 60),
    ) {
        let map = robot(shape(kinds.0), shape(kinds.1));
        let mut index = ContactIndex::with_options(&map, &LEVELS).unwrap();
        let turn = DVec3::from(turn);
        let pose = DAffine3::from_rotation_translation(DQuat::from_scaled_axis(turn), turn * 0.1);
        index.set_motion(&posed([(LinkId::new(1), pose)]), 0.0).unwrap();
        for (direction, exponent, vertex, patch, on_link) in aims {
            let patch = &map.patches[PatchId::new(patch)];
            let positions = &patch.levels[LevelId::new(0)].level.mesh.positions;
            let at = *vertex.get(positions) + DVec3::from(direction) * 10_f64.powi(exponent);
            let pose = index.poses()[patch.link];
            let query = if on_link { Query::on_link(patch.link, at) } else { Query::from(pose.transform_point3(at)) };
            let exact = index.locate(query).unwrap();
            for level in 0..patch.levels.len() + 1 {
                let answer = index.reactive(query, LevelId::new(level)).unwrap();
                let away = exact.distance.abs();
                let is_held = answer.least <= away + 1e-12 && away <= answer.most + 1e-12;
                prop_assert!(is_held, "level {level}: {away} is not from {} to {}", answer.least, answer.most);
                for distance in [0.5 * away, 1.5 * away] {
                    prop_assert!(answer.is_within(distance).is_none_or(|within| within == (away <= distance)));
                }
                let cell = index.cell(&answer, answer.level).unwrap();
                let mesh = &map.patches[answer.patch].levels[answer.level];
                let uv: glam::DVec2 = mesh.places(answer.point.face).iter()
                    .zip(answer.point.barycentric).map(|(&place, w)| mesh.uv[place] * w).sum();
                prop_assert!(cell.uv.distance(uv) < 1e-15 && cell.level == answer.level);
                if level == 0 {
                    prop_assert_eq!((answer.error(), answer.distance), (0.0, exact.distance));
                }
            }
        }
    }
}

/// The bound is not only right but useful: on a smooth cap it is near the largest true error, and
/// each coarser level costs about four times the error of the finer one.
#[test]
fn bounds_are_near_the_largest_error() {
    let map = build(&Skin::from_mesh("cap", shapes::cap(4000, 0.1, 0.6)), &BuildOptions::default()).unwrap();
    let index = ContactIndex::with_options(&map, &LEVELS).unwrap();
    let mut previous = 0.0;
    for level in 1..map.patches[PatchId::new(0)].levels.len() {
        let (mut largest, mut bounds) = (0.0_f64, Vec::new());
        for k in 0..2000 {
            let (x, y) = ((0.7 * f64::from(k)).sin(), (1.3 * f64::from(k)).sin());
            let q = DVec3::new(0.03 * x, 0.03 * y, -1.0).normalize() * 0.102;
            let answer = index.reactive(q, LevelId::new(level)).unwrap();
            let exact = index.locate(q).unwrap();
            largest = largest.max((answer.distance - exact.distance).abs());
            bounds.push(answer.error());
        }
        bounds.sort_by(f64::total_cmp);
        let median = bounds[bounds.len() / 2];
        assert!(median < 1.5 * largest, "level {level}: median bound {median}, error {largest}");
        assert!(median > previous);
        previous = median;
    }
}

#[test]
fn coarse_levels_need_an_index_with_levels() {
    let map = robot(shape(1), shape(1));
    let index = ContactIndex::new(&map).unwrap();
    assert_eq!(
        index.reactive(DVec3::ZERO, LevelId::new(1)),
        Err(ContactError::NotIndexed { what: "levels" })
    );
    let exact = index.locate(DVec3::ZERO).unwrap();
    let answer = index.reactive(DVec3::ZERO, LevelId::new(0)).unwrap();
    assert_eq!((answer.point, answer.error()), (exact.point, 0.0));
    assert!(index.reactive(DVec3::NAN, LevelId::new(0)).is_err());
}
