//! Laws of the other questions: fields near a contact, rays, the way back from the map, and forces spread
//! over taxels, for links in any pose.

use std::sync::LazyLock;

use dermatome::contact::{ContactError, ContactIndex, MapIndex, Query};
use dermatome::cut::Cut;
use dermatome::id::{FaceId, VertexId};
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::pipeline::{BuildOptions, build};
use dermatome::pyramid::LevelId;
use dermatome::signal::{Frame, Press, SignalError, Spreader};
use dermatome::skin::{Link, LinkId, Motion, MotionFrame, Patch, PatchId, Presence, Skin};
use glam::{DAffine3, DQuat, DVec2, DVec3};
use proptest::prelude::*;

use super::{BOTH, FIELDS, any_pose, finest, posed, skin_of, soup};

fn robot() -> SkinMap {
    static MAP: LazyLock<SkinMap> = LazyLock::new(|| {
        let mut cover = shapes::cap(700, 0.1, 0.7);
        cover.positions.iter_mut().for_each(|p| p.x *= 1.3);
        let pose =
            |k: f64| DAffine3::from_rotation_translation(DQuat::from_rotation_x(k), DVec3::X * (0.3 * k));
        let meshes = [cover, shapes::lattice(20, 15, 0.007), shapes::tube(24, 12, 0.03, 0.15)];
        let skin = skin_of(meshes.into_iter().zip([0.0, 1.0, 2.0].map(pose)));
        build(&skin, &BuildOptions::default()).unwrap()
    });
    MAP.clone()
}

/// A torus on a map with slits, and a disk with a hole.
fn atlas() -> SkinMap {
    let mut disk = shapes::tube(24, 12, 0.03, 0.05);
    disk.positions.iter_mut().for_each(|p| *p = p.with_z(0.0) * (1.0 + p.z / 0.03));
    let meshes = [shapes::torus(30, 14, 0.1, 0.04), disk];
    let skin = skin_of(meshes.map(|mesh| (mesh, DAffine3::from_translation(DVec3::Y))));
    build(&skin, &BuildOptions { cut: Cut::AreaRatio(1.1), ..BuildOptions::default() }).unwrap()
}

proptest! {
    #![proptest_config(soup::fixed(60, 6))]

    #[test]
    fn fields_are_those_of_brute_force(
        poses in [any_pose(0.2), any_pose(0.2), any_pose(0.2)],
        at in prop::array::uniform3(-0.2_f64..0.2),
        radius in 0.0_f64..0.1,
        level in 0_usize..3,
        count in 0_usize..12,
        link in prop::option::of(0_usize..3),
    ) {
        let map = robot();
        let mut index = ContactIndex::with_options(&map, &FIELDS).unwrap();
        index.set_motion(&posed([0, 1, 2].map(|k| (LinkId::new(k), poses[k]))), 0.0).unwrap();
        let (at, link, level) = (DVec3::from(at), link.map(LinkId::new), LevelId::new(level));
        let mut all = Vec::new();
        for (id, patch) in map.patches.enumerate() {
            // A patch without the level answers with its coarsest.
            let fields = &patch.levels[patch.nearest_level(level)];
            if link.is_some_and(|link| link != patch.link) {
                continue;
            }
            let pose = if link.is_some() { DAffine3::IDENTITY } else { poses[patch.link.index()] };
            for (field, p) in fields.level.mesh.positions.enumerate() {
                all.push((pose.transform_point3(*p).distance(at), id, field));
            }
        }
        all.sort_by(|a, b| a.partial_cmp(b).unwrap());
        let query = Query { point: at, link, only_link: link };
        let found = index.nearest_fields(query, count, level).unwrap();
        prop_assert_eq!(found.len(), count.min(all.len()));
        for (hit, (distance, ..)) in found.iter().zip(&all) {
            prop_assert!((hit.distance - distance).abs() < 1e-12 && (hit.position.distance(at) - distance).abs() < 1e-12);
            let patch = &map.patches[hit.patch];
            prop_assert_eq!(hit.level, patch.nearest_level(level));
            let cell = index.cell(hit, hit.level).unwrap();
            prop_assert_eq!((cell.field, cell.level, cell.taxel), (hit.field, hit.level, hit.taxel));
            prop_assert_eq!(cell.uv, patch.levels[hit.level].opened_uv()[hit.field]);
        }
        let within = index.fields_within(query, radius, level).unwrap();
        prop_assert_eq!(within.len(), all.iter().filter(|(d, ..)| *d <= radius).count());
        prop_assert!(within.iter().all(|hit| hit.distance <= radius && hit.position.distance(at) <= radius + 1e-12));
    }

    /// What a ray meets is on the ray and on the skin, and the skin is not met before.
    #[test]
    fn rays_end_on_the_skin(
        poses in [any_pose(0.2), any_pose(0.2), any_pose(0.2)],
        from in prop::array::uniform3(-0.5_f64..0.5),
        patch in 0_usize..3,
        vertex in any::<prop::sample::Index>(),
    ) {
        let map = robot();
        let mut index = ContactIndex::with_options(&map, &FIELDS).unwrap();
        index.set_motion(&posed([0, 1, 2].map(|k| (LinkId::new(k), poses[k]))), 0.0).unwrap();
        let mesh = finest(&map, patch);
        let face = mesh.triangles.ids().nth(vertex.index(mesh.triangles.len())).unwrap();
        let target = poses[patch].transform_point3(mesh.corners(face).into_iter().sum::<DVec3>() / 3.0);
        let from = DVec3::from(from);
        let hit = index.first_hit(from, target - from, f64::INFINITY).unwrap().unwrap();
        prop_assert!(hit.distance <= from.distance(target) + 1e-9);
        let end = from + (target - from).normalize() * hit.distance;
        prop_assert!(end.distance(hit.position) < 1e-9);
        prop_assert!(index.locate(end).unwrap().distance.abs() < 1e-9);
        prop_assert_eq!(index.first_hit(from, target - from, 0.5 * hit.distance).unwrap(), None);
        prop_assert!(index.first_hit(from, DVec3::ZERO, 1.0).is_err());
    }

    /// Every place of a map leads to its point of the surface, and from there back, on every level;
    /// seams and holes included.
    #[test]
    fn map_index_is_the_inverse_of_cells(
        (is_atlas, patch) in prop_oneof![3 => (Just(false), 0_usize..3), 2 => (Just(true), 0_usize..2)],
        faces in prop::collection::vec((any::<prop::sample::Index>(), 0.0_f64..1.0, 0.0_f64..1.0, prop::bool::ANY), 40),
    ) {
        type Indexed = (SkinMap, ContactIndex, MapIndex);
        static MAPS: LazyLock<[Indexed; 2]> = LazyLock::new(|| {
            [robot(), atlas()].map(|map| {
                let index = ContactIndex::with_options(&map, &BOTH).unwrap();
                let maps = MapIndex::new(&map).unwrap();
                (map, index, maps)
            })
        });
        let (map, index, maps) = &MAPS[usize::from(is_atlas)];
        let id = PatchId::new(patch);
        for (level, flat) in map.patches[id].levels.enumerate() {
            let mesh = &flat.level.mesh;
            for (face, s, t, on_side) in &faces {
                let face = mesh.triangles.ids().nth(face.index(mesh.triangles.len())).unwrap();
                let [a, b, c] = if *on_side { [*s, 1.0 - s, 0.0] } else { [1.0 - s.max(*t), (s - t).abs(), s.min(*t)] };
                let mix3 = |p: [DVec3; 3]| p[0] * a + p[1] * b + p[2] * c;
                let corners = flat.places(face);
                let uv = flat.uv[corners[0]] * a + flat.uv[corners[1]] * b + flat.uv[corners[2]] * c;
                let place = mix3(mesh.corners(face));
                let mut found = Vec::new();
                maps.places(id, level, uv, &mut found).unwrap();
                prop_assert!(found.iter().any(|p| p.position.distance(place) < 1e-9), "{:?} {} in {:?}", level, place, found);
                for p in &found {
                    prop_assert!(p.off_chart == 0.0 && p.cell.uv.distance(uv) < 1e-9);
                    prop_assert_eq!(mesh.point(&p.cell.point), p.position);
                }
                let query = Query::on_link(LinkId::new(patch), place);
                let hit = index.locate(query).unwrap();
                if level == LevelId::new(0) {
                    let back = index.cell(&hit, level).unwrap().uv;
                    found.clear();
                    maps.places(id, level, back, &mut found).unwrap();
                    let is_same = found.iter().any(|p| p.position.distance(place) < 1e-8);
                    // Along a seam a point of the skin has two places on the map.
                    let is_cut = flat.cut.is_some();
                    prop_assert!(back.distance(uv) < 1e-8 || is_cut && is_same, "skin to map");
                }
            }
        }
    }

    /// A ray that starts on the skin meets it there, wherever rounding puts its start.
    #[test]
    fn a_ray_from_the_skin_meets_it_at_once(
        at in any::<prop::sample::Index>(),
        weights in prop::array::uniform2(0.0_f64..1.0),
        up in -1.0_f64..1.0,
        away in prop::array::uniform3(-10.0_f64..10.0),
    ) {
        let mut mesh = shapes::cap(200, 0.1, 0.8);
        mesh.positions.iter_mut().for_each(|p| *p += DVec3::from_array(away));
        let map = SkinMap::flat(mesh.clone(), 1e-2);
        let index = ContactIndex::new(&map).unwrap();
        let face = FaceId::new(at.index(mesh.triangles.len()));
        let [a, b, c] = mesh.corners(face);
        let (s, t) = (weights[0].max(weights[1]), weights[0].min(weights[1]));
        let start = a * (1.0 - s) + b * (s - t) + c * t;
        let direction = DVec3::new(0.3, 0.1, if up < 0.0 { -1.0 } else { 1.0 });
        let hit = index.first_hit(start, direction, f64::INFINITY).unwrap();
        prop_assert!(hit.is_some_and(|hit| hit.distance < 1e-12), "{hit:?}");
    }

    /// Whatever presses, the readings add up to its force.
    #[test]
    fn readings_add_up_to_the_force(
        at in any::<prop::sample::Index>(),
        offset in prop::array::uniform3(-0.01_f64..0.01),
        radius in 0.001_f64..0.03,
        force in 0.01_f64..20.0,
        dead in prop::collection::vec(any::<prop::sample::Index>(), 0..300),
        is_point in prop::bool::ANY,
    ) {
        let mut map = robot();
        let id = PatchId::new(0);
        let mesh = finest(&map, 0).clone();
        let taxels = mesh.positions.len();
        for taxel in dead {
            map.patches[id].taxels.presence[VertexId::new(taxel.index(taxels))] = Presence::Absent;
        }
        let index = ContactIndex::with_options(&map, &FIELDS).unwrap();
        let centre = mesh.positions[VertexId::new(at.index(taxels))] + DVec3::from(offset);
        let radius = if is_point { 0.0 } else { radius };
        let spreader = Spreader { disc: 0.002, max_distance: None };
        let mut frame = spreader.frame(&index, 1.5);
        let touched = spreader.add(&index, &Press { at: Query::on_link(LinkId::new(0), centre), radius, force }, &mut frame).unwrap();
        let live = |v: &&f64| !v.is_nan();
        let felt = frame.values[id][0].iter().filter(live);
        let sums: [f64; 2] = [felt.clone().sum(), felt.rev().sum()];
        prop_assert_eq!(sums, [if touched { force } else { 0.0 }; 2], "to the last bit, in any order");
        prop_assert!(frame.values[id][0].iter().filter(live).all(|f| *f >= -1e-15));
        prop_assert!(touched || !is_point, "a point 1 cm off touches");
    }
}

/// Along the seam of a cut map a taxel has its normal from the faces on both sides.
#[test]
fn normals_on_a_seam_are_those_of_the_skin() {
    let skin = Skin::from_mesh("torus", shapes::torus(30, 14, 0.1, 0.04));
    let map = build(&skin, &BuildOptions { cut: Cut::AreaRatio(1.1), ..BuildOptions::default() }).unwrap();
    let (index, maps) = (ContactIndex::new(&map).unwrap(), MapIndex::new(&map).unwrap());
    let (patch, level) = (PatchId::new(0), LevelId::new(0));
    let flat = &map.patches[patch].levels[level];
    assert!(flat.cut.is_some());
    for (face, corners) in flat.level.mesh.triangles.enumerate() {
        for (&vertex, &place) in corners.iter().zip(&flat.places(face)) {
            let mut found = Vec::new();
            maps.places(patch, level, flat.uv[place], &mut found).unwrap();
            let position = flat.level.mesh.positions[vertex];
            let here = found.iter().find(|other| other.position.distance(position) < 1e-9).unwrap();
            let expected = index.locate(position).unwrap().normal;
            assert!(here.normal.distance(expected) < 1e-6, "{} instead of {expected}", here.normal);
        }
    }
}

/// A ball of 10 mm pressed in by 2 mm: taxels share its force as the volumes that it takes of the skin
/// under them, nothing beyond its contact.
#[test]
fn a_ball_presses_the_taxels_under_it() {
    let map = SkinMap::flat(shapes::lattice(30, 30, 0.004), 1e-3);
    let index = ContactIndex::with_options(&map, &FIELDS).unwrap();
    let spreader = Spreader { disc: 0.002, max_distance: None };
    let mut frame = spreader.frame(&index, 0.0);
    let positions = &finest(&map, 0).positions;
    let middle = positions.iter().copied().sum::<DVec3>() / positions.len() as f64;
    let ball = |height: f64| Press { at: (middle + DVec3::Z * height).into(), radius: 0.01, force: 2.0 };
    let press = ball(0.008);
    assert!(spreader.add(&index, &press, &mut frame).unwrap());
    let forces = &frame.values[PatchId::new(0)][0];
    for (v, &force) in forces.enumerate() {
        // The contact has a radius of 6 mm, a disc of 2 mm.
        let away = positions[v].distance(middle);
        assert_eq!(force > 0.0, away < 0.0079999, "{force} N at {away} m");
    }
    let add = |spreader: &Spreader, force: f64| {
        let press = Press { at: middle.into(), radius: 0.0, force };
        spreader.add(&index, &press, &mut spreader.frame(&index, 0.0))
    };
    assert_eq!(add(&spreader, 2.0), Ok(true));
    for length in [-1.0, f64::NAN] {
        let refused = add(&Spreader { disc: length, ..spreader }, 2.0);
        assert!(matches!(refused, Err(SignalError::Contact(_))), "{refused:?}");
        let refused = add(&Spreader { max_distance: Some(length), ..spreader }, 2.0);
        assert!(matches!(refused, Err(SignalError::Contact(ContactError::NoDistance { .. }))), "{refused:?}");
    }
    for force in [f64::NAN, f64::INFINITY] {
        assert!(matches!(add(&spreader, force), Err(SignalError::Option { .. })));
    }
    for height in [0.02, 0.0101] {
        let before = frame.clone();
        assert!(!spreader.add(&index, &ball(height), &mut frame).unwrap(), "{height} m above the skin");
        assert_eq!(frame, before, "it presses nothing");
    }
}

/// A frame of another map has no place for the force: of other patches, fewer taxels or no channel.
#[test]
fn frames_of_another_map_are_refused() {
    let map = SkinMap::flat(shapes::lattice(9, 9, 0.004), 1e-3);
    let index = ContactIndex::with_options(&map, &FIELDS).unwrap();
    let spreader = Spreader { disc: 0.002, max_distance: None };
    let press = Press { at: DVec3::new(0.01, 0.01, 0.001).into(), radius: 0.0, force: 1.0 };
    let mut short = spreader.frame(&index, 0.0);
    short.values[PatchId::new(0)][0] = (0..80).map(f64::from).collect();
    let mut bare = spreader.frame(&index, 0.0);
    bare.values[PatchId::new(0)].clear();
    for mut frame in [Frame::default(), short, bare, Frame::new(&robot(), 1)] {
        let before = format!("{frame:?}");
        let refused = spreader.add(&index, &press, &mut frame);
        assert!(matches!(refused, Err(SignalError::ForeignFrame { .. })), "{refused:?}");
        assert_eq!(format!("{frame:?}"), before);
    }
}

/// Off the map the nearest place is answered, and where sheets overlap each of them.
#[test]
fn places_off_the_map_and_on_overlaps_are_answered() {
    let mut map = SkinMap::flat(shapes::lattice(10, 10, 0.01), 1e-3);
    let (patch, level) = (PatchId::new(0), LevelId::new(0));
    // Fold the right half of the map over the left one.
    let middle = 0.045;
    map.patches[patch].levels[level].uv.iter_mut().for_each(|uv| uv.x = middle - (uv.x - middle).abs());
    let maps = MapIndex::new(&map).unwrap();
    let mut found = Vec::new();
    maps.places(patch, level, DVec2::new(0.021, 0.033), &mut found).unwrap();
    let mut xs: Vec<f64> = found.iter().map(|place| place.position.x).collect();
    xs.sort_by(f64::total_cmp);
    assert!(xs.len() == 2 && (xs[0] - 0.021).abs() < 1e-12 && (xs[1] - 0.069).abs() < 1e-12, "{xs:?}");
    found.clear();
    maps.places(patch, level, DVec2::new(-0.5, 0.033), &mut found).unwrap();
    assert_eq!(found.len(), 1);
    assert!((found[0].off_chart - 0.495).abs() < 1e-3 && found[0].cell.uv.x < 0.0, "{found:?}");
    assert!(matches!(
        maps.places(patch, level, DVec2::NAN, &mut found),
        Err(ContactError::NotOnPlane { .. })
    ));
    let unknown = maps.places(patch, LevelId::new(9), DVec2::ZERO, &mut found);
    assert!(matches!(unknown, Err(ContactError::NoMap { .. })));
    let frame = map.patches[patch].levels[level].frame;
    assert_eq!(frame.pixel(frame.centre([3, 5])), [3, 5]);
    let index = ContactIndex::new(&map).unwrap();
    assert_eq!(maps.posed(&index, &found[0]), Some(found[0]));
    let (mut level, mut face) = (found[0], found[0]);
    level.cell.level = LevelId::new(9);
    face.cell.point.face = FaceId::new(1 << 20);
    assert_eq!([level, face].map(|place| maps.posed(&index, &place)), [None; 2], "there is no such place");
}

/// Taxels that belong to no face, beside a patch that is nearer than their own patch's faces.
#[test]
fn taxels_without_a_face_are_found() {
    let mut mesh = shapes::lattice(4, 3, 0.01);
    let loose = mesh.positions.push(DVec3::X);
    let mut map = SkinMap::flat(mesh, 1e-3);
    let mut near = SkinMap::flat(shapes::lattice(4, 3, 0.01), 1e-3).patches[PatchId::new(0)].clone();
    near.name = "near".into();
    near.link = map.links.push(Link {
        name: "near".into(),
        parent: None,
        pose: DAffine3::from_translation(DVec3::new(0.97, 0.0, 0.1)),
    });
    map.patches.push(near);
    let index = ContactIndex::with_options(&map, &FIELDS).unwrap();
    let (at, level) = (DVec3::new(1.0, 0.0, 0.01), LevelId::new(0));
    for link in [None, Some(LinkId::new(0))] {
        let found = index.fields_within(Query { point: at, link, only_link: link }, 0.02, level).unwrap();
        assert_eq!(found.iter().map(|hit| hit.field).collect::<Vec<_>>(), [loose], "{link:?}");
        let nearest = index.nearest_fields(Query { point: at, link, only_link: link }, 1, level).unwrap();
        assert_eq!(nearest, found);
        assert_eq!(index.cell(&found[0], level), None, "it has no face to be a cell of");
    }
}

/// A map may have a coarse level anywhere, here above another patch, on which it is the nearest.
#[test]
fn levels_away_from_their_skin_are_searched() {
    let mut skin = Skin::default();
    let link = skin.links.push(Link { name: "link".into(), parent: None, pose: DAffine3::IDENTITY });
    for (k, name) in ["lifted", "other"].into_iter().enumerate() {
        let mut mesh = shapes::lattice(9, 9, 0.005);
        mesh.positions.iter_mut().for_each(|p| *p += DVec3::Z * 0.05 * k as f64);
        skin.patches.push(Patch::from_mesh(name, link, mesh));
    }
    let mut map = build(&skin, &BuildOptions::default()).unwrap();
    let (lifted, level) = (PatchId::new(0), LevelId::new(1));
    let coarse = &mut map.patches[lifted].levels[level].level.mesh;
    coarse.positions.iter_mut().for_each(|p| p.z += 0.1);
    let centre = coarse.positions[VertexId::new(0)];
    let index = ContactIndex::with_options(&map, &BOTH).unwrap();
    for link in [None, Some(link)] {
        let query = Query { point: centre + DVec3::Z * 0.001, link, only_link: link };
        let field = index.nearest_fields(query, 1, level).unwrap()[0];
        assert_eq!((field.patch, field.field), (lifted, VertexId::new(0)), "{link:?}");
        let (answer, exact) = (index.reactive(query).unwrap(), index.locate(query).unwrap());
        assert!((answer.least..=answer.most).contains(&exact.distance.abs()), "{link:?}");
    }
}

#[test]
fn questions_that_the_index_is_not_made_for_are_refused() {
    let map = robot();
    let index = ContactIndex::new(&map).unwrap();
    let level = LevelId::new(0);
    let without = Err(ContactError::NotIndexed { what: "fields" });
    assert_eq!(index.nearest_fields(DVec3::ZERO, 3, level), without);
    assert_eq!(index.fields_within(DVec3::ZERO, 1.0, level), without);
    for radius in [-1.0, f64::NAN] {
        let refused = index.fields_within(DVec3::ZERO, radius, level);
        assert!(matches!(refused, Err(ContactError::NoDistance { .. })), "{refused:?}");
    }
}

/// A hand follows its arm, from the pose that it has in the map.
#[test]
fn motions_move_links_and_their_children() {
    let mut map = robot();
    map.links[LinkId::new(1)].parent = Some(LinkId::new(0));
    let mut index = ContactIndex::new(&map).unwrap();
    let rest = index.poses();
    let pose = |x| DAffine3::from_translation(DVec3::X * x);
    let mut motion = Motion::default();
    motion.set(LinkId::new(0), MotionFrame::World, &[(0.0, pose(0.0)), (2.0, pose(1.0))]).unwrap();
    motion.set(LinkId::new(2), MotionFrame::Parent, &[(1.0, pose(5.0))]).unwrap();
    for (time, x) in [(1.0, 0.5), (-3.0, 0.0), (9.0, 1.0)] {
        index.set_motion(&motion, time).unwrap();
        let poses = index.poses();
        assert!(poses[LinkId::new(0)].abs_diff_eq(pose(x), 1e-12));
        assert!(poses[LinkId::new(1)].abs_diff_eq(pose(x) * map.links[LinkId::new(1)].pose, 1e-12));
        assert!(poses[LinkId::new(2)].abs_diff_eq(pose(5.0), 1e-12));
    }
    index.set_motion(&Motion::default(), 0.0).unwrap();
    assert!(index.poses().iter().zip(&rest).all(|(a, b)| a.abs_diff_eq(*b, 1e-12)), "as in the map");
}
