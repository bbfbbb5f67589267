//! Patches that follow several links: a linear blend of their motions.

use dermatome::contact::{ContactError, ContactIndex, MapIndex, MapPlace, Query};
use dermatome::id::{IdVec, VertexId};
use dermatome::map::SkinMap;
use dermatome::mesh::{TriMesh, shapes};
use dermatome::pipeline::{BuildOptions, build};
use dermatome::pyramid::LevelId;
use dermatome::run::Run;
use dermatome::signal::{Press, Spreader};
use dermatome::skin::{Link, LinkId, Motion, Patch, PatchId, Skin};
use glam::{DAffine3, DQuat, DVec2, DVec3};
use proptest::prelude::*;

use super::{BOTH, FIELDS, any_pose, distance_to, finest, posed, soup};

/// Three links in a chain, and a patch on each of the last two.
fn robot() -> SkinMap {
    let mut skin = Skin::default();
    for k in 0..3_usize {
        let pose =
            DAffine3::from_rotation_translation(DQuat::from_rotation_x(0.3 * k as f64), DVec3::Z * 0.1);
        skin.links.push(Link { name: format!("{k}"), parent: k.checked_sub(1).map(LinkId::new), pose });
    }
    skin.patches.push(Patch::from_mesh("soft", LinkId::new(1), shapes::cap(150, 0.1, 0.6)));
    skin.patches.push(Patch::from_mesh("rigid", LinkId::new(2), shapes::cap(60, 0.05, 0.9)));
    build(&skin, &BuildOptions::default()).unwrap()
}

/// A motion that has each link at its pose in the world.
fn moves(poses: &IdVec<LinkId, DAffine3>) -> Motion {
    posed(poses.enumerate().map(|(link, pose)| (link, *pose)))
}

type Joints = IdVec<VertexId, [(LinkId, f64); 4]>;

/// The vertices of the first patch in the world, written down again.
fn blended(
    map: &SkinMap,
    joints: &Joints,
    [rest, posed]: [&IdVec<LinkId, DAffine3>; 2],
) -> IdVec<VertexId, DVec3> {
    let own = rest[LinkId::new(1)];
    let place = |(p, row): (&DVec3, &[(LinkId, f64); 4])| {
        let part = |&(j, w): &(LinkId, f64)| w * (posed[j] * rest[j].inverse() * own).transform_point3(*p);
        row.iter().map(part).sum::<DVec3>()
    };
    finest(map, 0).positions.iter().zip(joints).map(place).collect()
}

proptest! {
    #![proptest_config(soup::fixed(24, 6))]

    /// However links move, contacts are answered as brute force on the blended mesh answers them.
    #[test]
    fn answers_are_those_of_the_blended_mesh(
        weights in prop::collection::vec(prop::array::uniform4(0.0..1.0_f64), 150),
        poses in prop::array::uniform3(any_pose(0.2)),
        contacts in prop::collection::vec(prop::array::uniform3(-0.4..0.4_f64), 8),
    ) {
        let mut map = robot();
        let joints: Joints = finest(&map, 0).positions.ids().map(|v| {
            let row = weights[v.index() % weights.len()];
            let sum: f64 = row.iter().sum();
            [0, 1, 2, 1].map(LinkId::new).iter().zip(row).map(|(j, w)| (*j, w / sum)).collect::<Vec<_>>().try_into().unwrap()
        }).collect();
        map.patches[PatchId::new(0)].taxels.joints = Some(joints.clone());
        let mut index = ContactIndex::with_options(&map, &BOTH).unwrap();
        let rest = index.poses();
        let posed: IdVec<LinkId, DAffine3> = poses.to_vec().into();
        index.set_motion(&moves(&posed), 0.0).unwrap();
        let positions = blended(&map, &joints, [&rest, &posed]);
        let soft = TriMesh { positions, triangles: finest(&map, 0).triangles.clone() };
        let rigid = TriMesh {
            positions: finest(&map, 1).positions.map(|p| posed[LinkId::new(2)].transform_point3(*p)),
            triangles: finest(&map, 1).triangles.clone(),
        };
        for contact in contacts.into_iter().map(DVec3::from) {
            let distances = [&soft, &rigid].map(|mesh| distance_to(mesh, contact));
            let hit = index.locate(contact).unwrap();
            let expected = distances[0].min(distances[1]);
            prop_assert!((hit.distance.abs() - expected).abs() < 1e-9, "{} instead of {expected}", hit.distance);
            let on = [&soft, &rigid][hit.patch.index()].point(&hit.point);
            prop_assert!(hit.position.distance(on) < 1e-9);
            let first = index.reactive(contact).unwrap();
            prop_assert!(first.least <= expected + 1e-9 && expected <= first.most + 1e-9, "{:?}, {expected}", first);
            if first.patch == PatchId::new(0) {
                prop_assert!(first.error() == 0.0 || first.least < expected, "a patch that follows several links is searched");
            }
            let taxel = index.nearest_fields(contact, 1, LevelId::new(0)).unwrap()[0];
            let vertices = soft.positions.iter().chain(&rigid.positions);
            let nearest = vertices.map(|p| p.distance(contact)).fold(f64::INFINITY, f64::min);
            prop_assert!((taxel.distance - nearest).abs() < 1e-9);
        }
        let maps = MapIndex::new(&map).unwrap();
        for (level, flat) in map.patches[PatchId::new(0)].levels.enumerate() {
            let origins = &flat.level.origins;
            let bent = flat.level.mesh.positions.ids().map(|field| soft.positions[origins[field]]).collect();
            let bent = TriMesh { positions: bent, triangles: flat.level.mesh.triangles.clone() };
            for face in flat.level.mesh.triangles.ids().step_by(7) {
                let uv = flat.places(face).iter().map(|&place| flat.uv[place]).sum::<DVec2>() / 3.0;
                let mut found = Vec::new();
                maps.places(PatchId::new(0), level, uv, &mut found).unwrap();
                let place = found.iter().find(|place| place.cell.point.face == face).unwrap();
                let MapPlace { position, normal, .. } = maps.posed(&index, place).unwrap();
                let pose = posed[LinkId::new(1)];
                let (position, normal) = (pose.transform_point3(position), pose.transform_vector3(normal));
                prop_assert!(position.distance(bent.point(&place.cell.point)) < 1e-9);
                let [a, b, c] = bent.corners(face);
                prop_assert!(normal.dot((b - a).cross(c - a).normalize_or(normal)) > 1.0 - 1e-9);
            }
        }
        index.set_motion(&moves(&rest), 0.0).unwrap();
        let back = index.locate(DVec3::new(0.05, 0.0, 0.1)).unwrap();
        let new = ContactIndex::new(&map).unwrap().locate(DVec3::new(0.05, 0.0, 0.1)).unwrap();
        prop_assert!((back.distance - new.distance).abs() < 1e-12, "moved back");
    }
}

/// A patch that follows one link alone moves as if it were on that link.
#[test]
fn one_joint_is_a_rigid_pose() {
    let mut map = robot();
    let other = LinkId::new(2);
    let joints: Joints =
        finest(&map, 0).positions.map(|_| [(other, 1.0), (other, 0.0), (LinkId::new(99), 0.0), (other, 0.0)]);
    let contact = DVec3::new(0.02, 0.03, 0.25);
    let before = ContactIndex::new(&map).unwrap().locate(Query::on_link(LinkId::new(1), contact)).unwrap();
    map.patches[PatchId::new(0)].taxels.joints = Some(joints);
    let mut index = ContactIndex::with_options(&map, &FIELDS).unwrap();
    let rest = index.poses();
    let turned = DAffine3::from_rotation_translation(DQuat::from_rotation_y(1.0), DVec3::new(0.3, -0.2, 1.0));
    index.set_motion(&posed([(other, turned * rest[other])]), 0.0).unwrap();
    let world = rest[LinkId::new(1)].transform_point3(contact);
    // The link of the patch has not moved: it sees the contact elsewhere.
    let seen = rest[LinkId::new(1)].inverse().transform_point3(turned.transform_point3(world));
    let found = index.locate(Query::on_link(LinkId::new(1), seen)).unwrap();
    assert_eq!((found.patch, found.point.face), (before.patch, before.point.face));
    assert!((found.distance - before.distance).abs() < 1e-12, "{} {}", found.distance, before.distance);
    let left = index.locate(Query::on_link(LinkId::new(1), contact)).unwrap();
    assert!(left.distance.abs() > 0.1, "there is nothing left where it was");
    // Its taxels turn with it, and so does the force of a ball that rests on it.
    for (level, flat) in map.patches[PatchId::new(0)].levels.enumerate() {
        for (field, &origin) in flat.level.origins.enumerate() {
            let normal = map.patches[PatchId::new(0)].taxels.normals[origin];
            let expected = turned.transform_vector3(rest[LinkId::new(1)].transform_vector3(normal));
            let at = turned
                .transform_point3(rest[LinkId::new(1)].transform_point3(flat.level.mesh.positions[field]));
            let hit = index.nearest_fields(at, 1, level).unwrap()[0];
            assert!(hit.field == field && hit.normal.distance(expected) < 1e-12, "{hit:?}");
        }
    }
    let spreader = Spreader { disc: 0.002, max_distance: None };
    let felt = |index: &ContactIndex, centre: DVec3| {
        let mut frame = spreader.frame(index, 0.0);
        let press = Press { at: centre.into(), radius: 0.02, force: 1.0 };
        assert!(spreader.add(index, &press, &mut frame).unwrap());
        frame.values[PatchId::new(0)][0].as_slice().to_vec()
    };
    let ball = rest[LinkId::new(1)].transform_point3(DVec3::new(0.01, 0.02, -0.112));
    let pressed = felt(&index, turned.transform_point3(ball));
    index.set_motion(&moves(&rest), 0.0).unwrap();
    for (moved, still) in pressed.iter().zip(felt(&index, ball)) {
        assert!((moved - still).abs() < 1e-9, "{moved} instead of {still}");
    }
}

/// A clone that moves answers as an index made anew, and the other as if there were none.
#[test]
fn a_clone_moves_alone() {
    let mut map = robot();
    let half = [(LinkId::new(1), 0.5), (LinkId::new(2), 0.5), (LinkId::new(0), 0.0), (LinkId::new(0), 0.0)];
    map.patches[PatchId::new(0)].taxels.joints = Some(finest(&map, 0).positions.map(|_| half));
    let still = ContactIndex::with_options(&map, &FIELDS).unwrap();
    let queries: Vec<Query> =
        (0..40).map(|k| DVec3::new(0.01 * f64::from(k) - 0.2, 0.05, 0.1).into()).collect();
    let answers = |index: &ContactIndex| {
        let fields = index.nearest_fields(queries[7], 3, LevelId::new(1)).unwrap();
        (index.locate_all(&queries, Run::default()).unwrap(), fields)
    };
    let (before, mut moved) = (answers(&still), still.clone());
    for angle in [0.3, -0.7] {
        let turn =
            |id: LinkId, pose: &DAffine3| DAffine3::from_rotation_z(angle * f64::from(id.raw())) * *pose;
        let poses = moves(&still.poses().enumerate().map(|(id, pose)| turn(id, pose)).collect());
        moved = moved.clone();
        moved.set_motion(&poses, 0.0).unwrap();
        let mut fresh = ContactIndex::with_options(&map, &FIELDS).unwrap();
        fresh.set_motion(&poses, 0.0).unwrap();
        assert_eq!(answers(&moved), answers(&fresh));
        assert_ne!(answers(&moved), before);
        assert_eq!(answers(&still), before);
    }
}

#[test]
fn posing_a_blended_patch_allocates_nothing() {
    let mut map = robot();
    let half = [(LinkId::new(1), 0.5), (LinkId::new(2), 0.5), (LinkId::new(0), 0.0), (LinkId::new(0), 0.0)];
    map.patches[PatchId::new(0)].taxels.joints = Some(finest(&map, 0).positions.map(|_| half));
    let mut index = ContactIndex::with_options(&map, &FIELDS).unwrap();
    let poses = moves(&index.poses());
    let moved = moves(&index.poses().map(|pose| DAffine3::from_rotation_z(0.3) * *pose));
    let mut frame = || {
        index.set_motion(&moved, 0.0).unwrap();
        index.set_motion(&poses, 0.0).unwrap();
        assert!(index.locate(DVec3::ZERO).unwrap().distance.is_finite());
    };
    frame();
    assert_eq!(allocation_counter::measure(frame).count_total, 0);
}

/// Vertices between links that are too far apart are named, and no link moves.
#[test]
fn a_vertex_moved_too_far_is_refused() {
    let mut map = robot();
    let half = [(LinkId::new(1), 0.1), (LinkId::new(2), 0.9), (LinkId::new(0), 0.0), (LinkId::new(0), 0.0)];
    map.patches[PatchId::new(0)].taxels.joints = Some(finest(&map, 0).positions.map(|_| half));
    let mut index = ContactIndex::new(&map).unwrap();
    let (before, at) = (index.poses(), DVec3::new(0.02, 0.03, 0.2));
    let hit = index.locate(at).unwrap();
    let far = |x: f64| DAffine3::from_translation(DVec3::X * x);
    let torn = index.set_motion(&posed([(LinkId::new(1), far(-9e11)), (LinkId::new(2), far(9e11))]), 0.0);
    let name = map.patches[PatchId::new(0)].name.clone();
    assert!(matches!(&torn, Err(ContactError::TooLarge { patch, .. }) if *patch == name), "{torn:?}");
    assert_eq!((index.poses(), index.locate(at).unwrap()), (before, hit));
    let moved = index.poses().map(|pose| far(0.1) * *pose);
    index.set_motion(&moves(&moved), 0.0).unwrap();
    assert!((index.locate(at + DVec3::X * 0.1).unwrap().distance - hit.distance).abs() < 1e-12);
}

#[test]
fn invalid_joints_are_refused() {
    let mut map = robot();
    let (patch, link) = (PatchId::new(0), LinkId::new(1));
    let good: Joints =
        finest(&map, 0).positions.map(|_| [(link, 1.0), (link, 0.0), (link, 0.0), (link, 0.0)]);
    let mut refused = |joints: Joints| {
        map.patches[patch].taxels.joints = Some(joints);
        ContactIndex::new(&map).unwrap_err()
    };
    let few = refused(good.iter().copied().skip(1).collect());
    assert!(matches!(few, ContactError::Map(_)) && few.to_string().contains("joints"), "{few}");
    for row in [
        [(link, -0.5), (link, 1.5), (link, 0.0), (link, 0.0)],
        [(link, f64::NAN), (link, 1.0), (link, 0.0), (link, 0.0)],
        [(link, f64::INFINITY), (link, 0.0), (link, 0.0), (link, 0.0)],
        [(link, 0.4), (link, 0.4), (link, 0.0), (link, 0.0)],
        [(link, 0.0); 4],
        [(LinkId::new(3), 1.0), (link, 0.0), (link, 0.0), (link, 0.0)],
    ] {
        let mut bad = good.clone();
        bad[VertexId::new(5)] = row;
        let error = refused(bad);
        let is_named = matches!(error, ContactError::Map(_) | ContactError::Joints { .. });
        assert!(is_named && error.to_string().contains("vertex 5"), "{error}");
    }
    map.patches[patch].taxels.joints = Some(good);
    let mut index = ContactIndex::new(&map).unwrap();
    let far = DAffine3::from_translation(DVec3::splat(1e11));
    assert!(
        index.set_motion(&posed([(LinkId::new(0), far)]), 0.0).is_ok(),
        "what moves as a whole stays together"
    );
}
