//! Joints and weights of files: a tube that bends between two links, from glTF to answers.
#![allow(clippy::cast_possible_truncation, reason = "numbers of the tube are small")]

use std::{fmt::Write as _, fs};

use assert_cmd::Command;
use dermatome::contact::{ContactIndex, Query};
use dermatome::id::{IdVec, VertexId};
use dermatome::io::{read_draft, read_map, write_map, write_skin};
use dermatome::map::SkinMap;
use dermatome::mesh::{TriMesh, shapes};
use dermatome::pipeline::{BuildOptions, build};
use dermatome::skin::{AssembleOptions, Joints, LinkId, PatchId, Skin, assemble, world_pose};
use glam::{DAffine3, DQuat, DVec3};
use serde_json::json;
use tempfile::TempDir;

use super::{distance_to, finest, posed};
use crate::common;
use crate::gltf_files::{Glb, f32s, u16s};

/// How the file stores weights.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Stored {
    Floats,
    Bytes,
    Shorts,
}

/// How much a point follows the lower link, which begins in the middle.
fn share(z: f64) -> f64 {
    ((z - 0.08) / 0.04).clamp(0.0, 1.0)
}

fn tube() -> TriMesh {
    shapes::tube(16, 24, 0.02, 0.2)
}

/// The tube on the joints `upper` and, below it, `lower`; the mesh was bound in the pose of the nodes.
fn file(stored: Stored) -> Glb {
    let mesh = tube();
    let mut glb = Glb::square();
    glb.json["accessors"] = json!([]);
    glb.json["bufferViews"] = json!([]);
    glb.bin.clear();
    let count = mesh.positions.len();
    let positions: Vec<f32> = mesh.positions.iter().flat_map(|p| p.as_vec3().to_array()).collect();
    let bound = |pick: fn(f32, f32) -> f32, from: f32| {
        (0..3).map(|k| positions.iter().skip(k).step_by(3).copied().fold(from, pick)).collect::<Vec<_>>()
    };
    let (lo, hi) = (bound(f32::min, f32::INFINITY), bound(f32::max, f32::NEG_INFINITY));
    let position = glb.array(5126, "VEC3", count, &f32s(&positions));
    glb.json["accessors"][position]["min"] = json!(lo);
    glb.json["accessors"][position]["max"] = json!(hi);
    let corners: Vec<u16> =
        mesh.triangles.iter().flatten().map(|v| u16::try_from(v.raw()).unwrap()).collect();
    let indices = glb.array(5123, "SCALAR", corners.len(), &u16s(&corners));
    let shares: Vec<[f64; 4]> =
        mesh.positions.iter().map(|p| [1.0 - share(p.z), share(p.z), 0.0, 0.0]).collect();
    let whole = |one: f64| shares.iter().flatten().map(move |w| (w * one).round());
    let joints = glb.array(5121, "VEC4", count, &[0, 1, 0, 0].repeat(count));
    let weights = match stored {
        Stored::Floats => {
            let floats: Vec<f32> = shares.iter().flatten().map(|w| *w as f32).collect();
            glb.array(5126, "VEC4", count, &f32s(&floats))
        }
        Stored::Bytes => glb.array(5121, "VEC4", count, &whole(255.0).map(|w| w as u8).collect::<Vec<_>>()),
        Stored::Shorts => {
            glb.array(5123, "VEC4", count, &u16s(&whole(65535.0).map(|w| w as u16).collect::<Vec<_>>()))
        }
    };
    if stored != Stored::Floats {
        glb.json["accessors"][weights]["normalized"] = json!(true);
    }
    // The lower joint begins at a height of 0.1.
    let columns = |z: f32| [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., z, 1.];
    let inverse = glb.array(5126, "MAT4", 2, &f32s(&[columns(0.0), columns(-0.1)].concat()));
    glb.json["skins"] = json!([{"joints": [0, 1], "inverseBindMatrices": inverse}]);
    glb.json["nodes"] = json!([
        {"name": "upper", "children": [1]},
        {"name": "lower", "translation": [0, 0, 0.1]},
        {"name": "tube", "mesh": 0, "skin": 0, "translation": [7, 7, 7]},
    ]);
    glb.json["scenes"] = json!([{"nodes": [0, 2]}]);
    let attributes = json!({"POSITION": position, "JOINTS_0": joints, "WEIGHTS_0": weights});
    glb.json["meshes"][0]["primitives"][0] = json!({"attributes": attributes, "indices": indices});
    glb
}

/// The same with other bytes for the joints or the weights of a vertex.
fn spoiled(name: &str, vertex: usize, bytes: &[u8]) -> Glb {
    let mut glb = file(Stored::Floats);
    let number = |value: &serde_json::Value| usize::try_from(value.as_u64().unwrap()).unwrap();
    let accessor = number(&glb.json["meshes"][0]["primitives"][0]["attributes"][name]);
    let size = if name == "JOINTS_0" { 4 } else { 16 };
    let at = number(&glb.json["bufferViews"][accessor]["byteOffset"]) + vertex * size;
    glb.bin[at..at + bytes.len()].copy_from_slice(bytes);
    glb
}

fn skin(glb: &Glb, folder: &TempDir) -> Skin {
    let draft = read_draft(&glb.write(folder.path())).unwrap();
    assemble(&draft, &AssembleOptions::default()).unwrap().skin
}

/// The map as its file holds it.
fn map(skin: &Skin, folder: &TempDir) -> SkinMap {
    let path = folder.path().join("map.glb");
    write_map(&path, &build(skin, &BuildOptions::default()).unwrap()).unwrap();
    read_map(&path).unwrap()
}

fn assert_shares(joints: &IdVec<VertexId, Joints>, positions: &IdVec<VertexId, DVec3>, rounding: f64) {
    for (joints, p) in joints.iter().zip(positions) {
        let of = |link: usize| {
            let joints = joints.iter().filter(|joint| joint.0 == LinkId::new(link));
            joints.map(|joint| joint.1).sum::<f64>()
        };
        assert!((of(0) + of(1) - 1.0).abs() < 1e-6, "{joints:?}");
        assert!((of(1) - share(p.z)).abs() < rounding, "{joints:?} at {p}");
    }
}

/// The links of the tube, the lower one turned by an angle about x.
fn turned(map: &SkinMap, angle: f64) -> IdVec<LinkId, DAffine3> {
    let bent = DAffine3::from_rotation_translation(DQuat::from_rotation_x(angle), DVec3::Z * 0.1);
    map.links.enumerate().map(|(id, link)| if id == LinkId::new(1) { bent } else { link.pose }).collect()
}

/// The mesh as glTF moves it: each joint takes a vertex as far as it has moved since the mesh was bound.
fn blended(map: &SkinMap, poses: &IdVec<LinkId, DAffine3>) -> TriMesh {
    let rest = turned(map, 0.0);
    let joints = map.patches[PatchId::new(0)].taxels.joints.as_ref().unwrap();
    let mesh = finest(map, 0);
    let place = |(v, p): (VertexId, &DVec3)| {
        let part = |&(j, w): &(LinkId, f64)| w * (poses[j] * rest[j].inverse()).transform_point3(*p);
        joints[v].iter().map(part).sum()
    };
    TriMesh { positions: mesh.positions.enumerate().map(place).collect(), ..mesh.clone() }
}

fn contacts() -> Vec<DVec3> {
    let at = |k: u32| {
        let k = f64::from(k);
        DVec3::new(0.03 * (1.7 * k).sin(), 0.06 * (0.9 * k).cos(), 0.09 + 0.09 * (0.53 * k).sin())
    };
    (0..60).map(at).collect()
}

/// A joint may carry a mesh that follows joints itself: it stays a link, and what follows it still does.
#[test]
fn a_joint_may_carry_a_bent_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let mut glb = file(Stored::Floats);
    glb.json["nodes"][1]["mesh"] = json!(0);
    glb.json["nodes"][1]["skin"] = json!(0);
    let skin = skin(&glb, &folder);
    let names: Vec<_> = skin.links.iter().map(|link| link.name.as_str()).collect();
    assert!(names.starts_with(&["upper", "lower"]), "{names:?}");
    assert!(skin.patches.iter().all(|patch| patch.taxels.joints.is_some()));
}

/// The node of a mesh that follows joints is the link of its patch, and no second one of its name.
#[test]
fn a_bent_mesh_has_one_link() {
    let folder = tempfile::tempdir().unwrap();
    let map = map(&skin(&file(Stored::Floats), &folder), &folder);
    let names: Vec<_> = map.links.iter().map(|link| link.name.as_str()).collect();
    assert_eq!(names, ["upper", "lower", "tube"]);
    fs::write(folder.path().join("c.csv"), "x,y,z,link\n0.03,0,0.05,tube\n").unwrap();
    let mut command = common::command();
    command.current_dir(&folder).args(["lookup", "map.glb", "c.csv", "--level", "0"]).assert().success();
}

#[test]
fn joints_are_read_kept_and_written() {
    for (stored, rounding) in [(Stored::Floats, 1e-6), (Stored::Bytes, 0.003), (Stored::Shorts, 2e-5)] {
        let folder = tempfile::tempdir().unwrap();
        let skin = skin(&file(stored), &folder);
        let patch = &skin.patches[PatchId::new(0)];
        assert_eq!(skin.links[patch.link].pose, DAffine3::IDENTITY, "the pose of its node has no effect");
        assert_shares(patch.taxels.joints.as_ref().unwrap(), &patch.mesh.positions, rounding);
        let map = map(&skin, &folder);
        assert_shares(
            map.patches[PatchId::new(0)].taxels.joints.as_ref().unwrap(),
            &finest(&map, 0).positions,
            rounding,
        );
        // Skins keep them too, and a map is a skin.
        let path = folder.path().join("again.glb");
        write_skin(&path, &skin).unwrap();
        for path in [path, folder.path().join("map.glb")] {
            let again = assemble(&read_draft(&path).unwrap(), &AssembleOptions::default()).unwrap().skin;
            let patch = &again.patches[PatchId::new(0)];
            assert_shares(patch.taxels.joints.as_ref().unwrap(), &patch.mesh.positions, rounding);
        }
    }
}

/// Viewers bend our files: the skin of glTF takes the mesh where it lies, its nodes are roots, and readers find
/// the links again, none more and none less.
#[test]
fn files_have_skins_of_gltf() {
    let folder = tempfile::tempdir().unwrap();
    let moved = file(Stored::Floats).with("/nodes/0/translation", json!([1, 2, 3]));
    let bent = skin(&moved, &folder);
    // Two links without a common parent.
    let mut apart = bent.clone();
    apart.links.iter_mut().for_each(|link| link.parent = None);
    let path = folder.path().join("map.glb");
    for (skin, is_apart) in [(bent, false), (apart, true)] {
        write_map(&path, &build(&skin, &BuildOptions::default()).unwrap()).unwrap();
        let map = read_map(&path).unwrap();
        let draft = read_draft(&path).unwrap();
        assert!(draft.remarks.is_empty(), "{:?}", draft.remarks);
        for links in [&map.links, &draft.links] {
            assert_eq!(links.len(), skin.links.len());
            for (id, link) in links.enumerate() {
                let expected = &skin.links[id];
                assert_eq!((&link.name, link.parent), (&expected.name, expected.parent));
                assert!(link.pose.abs_diff_eq(expected.pose, 1e-6));
            }
        }
        let patch = &map.patches[PatchId::new(0)];
        assert_eq!(patch.link, skin.patches[PatchId::new(0)].link);
        assert!(patch.taxels.joints.is_some() && draft.sheets[0].joints.is_some());
        let json = Glb::parse(&fs::read(&path).unwrap()).json;
        let levels = patch.levels.len();
        assert_eq!(json["skins"].as_array().unwrap().len(), levels, "a skin for each level");
        for (scene, mesh) in json["scenes"].as_array().unwrap().iter().zip(json["meshes"].as_array().unwrap())
        {
            let nodes = scene["nodes"].as_array().unwrap();
            let patch = &json["nodes"][usize::try_from(nodes.last().unwrap().as_u64().unwrap()).unwrap()];
            assert!(patch["skin"].is_u64() && patch["extras"]["dermatome"]["link"].is_u64(), "{patch}");
            assert!(!is_apart || nodes.len() == 2, "all links under one root");
            let attributes = &mesh["primitives"][0]["attributes"];
            assert!(attributes["JOINTS_0"].is_u64() && attributes["WEIGHTS_0"].is_u64());
        }
    }
}

#[test]
fn contacts_on_the_bent_tube_are_those_of_the_blended_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let map = map(&skin(&file(Stored::Shorts), &folder), &folder);
    let mut index = ContactIndex::new(&map).unwrap();
    for angle in [0.0, 0.4, 1.2] {
        let poses = turned(&map, angle);
        index.set_motion(&posed(poses.enumerate().map(|(link, pose)| (link, *pose))), 0.0).unwrap();
        let mesh = blended(&map, &poses);
        for q in contacts() {
            let hit = index.locate(Query::from(q)).unwrap();
            assert!((hit.distance.abs() - distance_to(&mesh, q)).abs() < 1e-12, "bent by {angle}, from {q}");
            assert!(mesh.point(&hit.point).distance(hit.position) < 1e-12);
        }
    }
}

/// The command answers the contacts with their distances from the mesh.
fn assert_distances(command: &mut Command, mesh: &TriMesh) {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut reader = csv::Reader::from_reader(output.stdout.as_slice());
    let at = reader.headers().unwrap().iter().position(|name| name == "distance").unwrap();
    let distances: Vec<f64> = reader.records().map(|row| row.unwrap()[at].parse().unwrap()).collect();
    assert_eq!(distances.len(), contacts().len());
    for (found, q) in distances.iter().zip(contacts()) {
        assert!((found.abs() - distance_to(mesh, q)).abs() < 1e-9, "{found} from {q}");
    }
}

#[test]
fn the_command_poses_the_tube() {
    let folder = tempfile::tempdir().unwrap();
    let map = map(&skin(&file(Stored::Floats), &folder), &folder);
    let turn = DQuat::from_rotation_x(0.8);
    let poses =
        format!("link,x,y,z,qx,qy,qz,qw\nlower,0,0,0.1,{},{},{},{}\n", turn.x, turn.y, turn.z, turn.w);
    let mut table = "x,y,z\n".to_owned();
    contacts().iter().for_each(|q| writeln!(table, "{},{},{}", q.x, q.y, q.z).unwrap());
    fs::write(folder.path().join("poses.csv"), poses).unwrap();
    fs::write(folder.path().join("in.csv"), table).unwrap();
    let lookup = || {
        let mut command = common::command();
        command.current_dir(&folder).args(["lookup", "map.glb", "in.csv", "--level", "0"]);
        command.args(["--max-distance", "inf"]);
        command
    };
    assert_distances(lookup().args(["--pose", "poses.csv"]), &blended(&map, &turned(&map, 0.8)));
    // Without poses it lies as the map has it.
    assert_distances(&mut lookup(), finest(&map, 0));
}

#[test]
fn wrong_joints_and_weights_are_named() {
    let folder = tempfile::tempdir().unwrap();
    for (glb, expected) in [
        (spoiled("JOINTS_0", 5, &[9, 1, 0, 0]), "joint 9 of vertex 5"),
        (spoiled("WEIGHTS_0", 4, &f32s(&[1.5, -0.5, 0.0, 0.0])), "of vertex 4"),
        (spoiled("WEIGHTS_0", 6, &f32s(&[f32::NAN, 0.0, 0.0, 0.0])), "NaN or infinity in row 6"),
        (spoiled("WEIGHTS_0", 7, &f32s(&[0.0; 4])), "of vertex 7"),
    ] {
        let error = read_draft(&glb.write(folder.path())).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("skin.glb"), "{error}");
    }
    // What has no weight may be any number, and weights may be rounded.
    let glb = spoiled("JOINTS_0", 0, &[0, 1, 200, 200]);
    assert!(skin(&glb, &folder).patches[PatchId::new(0)].taxels.joints.is_some());
    let glb = spoiled("WEIGHTS_0", 0, &f32s(&[0.99, 0.0, 0.0, 0.0]));
    let joints = skin(&glb, &folder).patches[PatchId::new(0)].taxels.joints.clone().unwrap();
    assert!(joints.iter().all(|row| (row.iter().map(|joint| joint.1).sum::<f64>() - 1.0).abs() < 1e-12));
}

/// Weights that do not sum to 1 are scaled to it, with a note.
#[test]
fn weights_are_scaled_to_the_sum_1() {
    let folder = tempfile::tempdir().unwrap();
    let glb = spoiled("WEIGHTS_0", 0, &f32s(&[0.3, 0.1, 0.0, 0.0]));
    let draft = read_draft(&glb.write(folder.path())).unwrap();
    let row = draft.sheets[0].joints.as_ref().unwrap()[0];
    assert!((row[0].1 - 0.75).abs() < 1e-6 && (row[1].1 - 0.25).abs() < 1e-6, "{row:?}");
    assert_eq!(draft.remarks.len(), 1, "{:?}", draft.remarks);
}

/// A skin whose joints do not exist is read without joints.
#[test]
fn unknown_joints_are_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let draft =
        read_draft(&file(Stored::Floats).with("/skins/0/joints", json!([0, 77])).write(folder.path()));
    let draft = draft.unwrap();
    assert!(draft.sheets[0].joints.is_none());
    assert!(draft.remarks.iter().any(|r| r.kind.to_string().contains("skin 0")), "{:?}", draft.remarks);
}

/// A file whose joints stand elsewhere than when the mesh was bound shows each vertex where its joints
/// take it. It is read there, and follows its joints from there, through a written file as well.
#[test]
fn joints_away_from_the_bind_pose_move_the_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let glb = file(Stored::Floats)
        .with("/nodes/0/rotation", json!([0.6, 0, 0, 0.8]))
        .with("/nodes/1/rotation", json!([0, 0.28, 0, 0.96]))
        .with("/nodes/1/scale", json!([1, 1, 2]));
    let upper = DAffine3::from_quat(DQuat::from_xyzw(0.6, 0.0, 0.0, 0.8));
    let turn = DQuat::from_xyzw(0.0, 0.28, 0.0, 0.96);
    let lower = upper
        * DAffine3::from_scale_rotation_translation(DVec3::new(1.0, 1.0, 2.0), turn, DVec3::Z * 0.1)
        * DAffine3::from_translation(DVec3::Z * -0.1);
    let draft = read_draft(&glb.write(folder.path())).unwrap();
    assert!(draft.remarks.iter().any(|r| r.kind.to_string().contains("skin 0")), "{:?}", draft.remarks);
    let read = assemble(&draft, &AssembleOptions::default()).unwrap().skin;
    let path = folder.path().join("again.glb");
    write_skin(&path, &read).unwrap();
    let again = assemble(&read_draft(&path).unwrap(), &AssembleOptions::default()).unwrap();
    assert!(again.remarks.is_empty(), "its inverse bind matrices are those of its pose: {:?}", again.remarks);
    for skin in [&read, &again.skin] {
        let patch = &skin.patches[PatchId::new(0)];
        assert!(patch.taxels.joints.is_some());
        let pose = world_pose(&skin.links, patch.link);
        for (got, bound) in patch.mesh.positions.iter().zip(&tube().positions) {
            let got = pose.transform_point3(*got);
            let part = share(bound.z);
            let want = upper.transform_point3(*bound) * (1.0 - part) + lower.transform_point3(*bound) * part;
            assert!(got.distance(want) < 1e-6, "{got} is {want}");
        }
    }
}

/// A file that shows its elbow bent: at every other angle, points lie where the matrices of the file take them.
#[test]
fn a_mesh_that_is_shown_off_its_bind_pose_bends_as_its_file_says() {
    let folder = tempfile::tempdir().unwrap();
    let turn = DQuat::from_rotation_x(1.37);
    let read = skin(&file(Stored::Floats).with("/nodes/1/rotation", json!(turn.to_array())), &folder);
    let path = folder.path().join("again.glb");
    write_skin(&path, &read).unwrap();
    let again = assemble(&read_draft(&path).unwrap(), &AssembleOptions::default()).unwrap().skin;
    for skin in [read, again] {
        let map = map(&skin, &folder);
        let mut index = ContactIndex::new(&map).unwrap();
        for angle in [1.37, 0.9, 0.0, -0.4] {
            let poses = turned(&map, angle);
            index.set_motion(&posed(poses.enumerate().map(|(link, pose)| (link, *pose))), 0.0).unwrap();
            let lower = poses[LinkId::new(1)] * DAffine3::from_translation(DVec3::Z * -0.1);
            let shown = |p: &DVec3| p.lerp(lower.transform_point3(*p), share(p.z));
            let truth = TriMesh { positions: tube().positions.map(shown), ..tube() };
            for q in contacts() {
                let hit = index.locate(Query::from(q)).unwrap();
                assert!(
                    (hit.distance.abs() - distance_to(&truth, q)).abs() < 1e-7,
                    "bent by {angle}, from {q}"
                );
            }
        }
    }
}

/// A mesh goes where all of its joints go.
#[test]
fn joints_moved_by_the_same_move_the_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let glb = file(Stored::Floats).with("/nodes/0/translation", json!([1, 2, 3]));
    let skin = skin(&glb, &folder);
    let patch = &skin.patches[PatchId::new(0)];
    assert!(patch.taxels.joints.is_some());
    assert!(skin.links[patch.link].pose.translation.distance(DVec3::new(1.0, 2.0, 3.0)) < 1e-6);
}
