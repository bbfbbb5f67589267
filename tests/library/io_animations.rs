//! Animations of glTF files: which poses of links they give, and what is refused.

use std::fs;

use base64::{Engine as _, engine::general_purpose::STANDARD};
use dermatome::contact::ContactIndex;
use dermatome::id::IdVec;
use dermatome::io::{IoError, MotionFile, read_draft, read_motion, write_skin};
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::skin::{AssembleOptions, Link, LinkId, Motion, assemble};
use glam::{DAffine3, DQuat, DVec3};
use serde_json::{Value, json};

/// Node, path, interpolation, times (s) and values.
type Channel<'a> = (usize, &'a str, &'a str, &'a [f32], &'a [f32]);

/// A glTF file with these nodes, a mesh of one triangle, and the animation `up`.
fn gltf(nodes: Value, channels: &[Channel<'_>]) -> Value {
    let mut bytes = Vec::new();
    let (mut views, mut accessors) = (Vec::new(), Vec::new());
    let mut array = |numbers: &[f32], width: usize| {
        views.push(json!({"buffer": 0, "byteOffset": bytes.len(), "byteLength": 4 * numbers.len()}));
        bytes.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][width - 1];
        let count = numbers.len() / width;
        accessors.push(
            json!({"bufferView": views.len() - 1, "componentType": 5126, "count": count, "type": kind}),
        );
        accessors.len() - 1
    };
    array(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0], 3);
    let (mut json_channels, mut samplers) = (Vec::new(), Vec::new());
    for &(node, path, interpolation, times, values) in channels {
        let (input, output) = (array(times, 1), array(values, if path == "rotation" { 4 } else { 3 }));
        json_channels.push(json!({"sampler": samplers.len(), "target": {"node": node, "path": path}}));
        samplers.push(json!({"input": input, "output": output, "interpolation": interpolation}));
    }
    accessors[0]["min"] = json!([0, 0, 0]);
    accessors[0]["max"] = json!([1, 1, 0]);
    let data = STANDARD.encode(&bytes);
    json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "buffers": [{"uri": format!("data:application/octet-stream;base64,{data}"), "byteLength": bytes.len()}],
        "bufferViews": views, "accessors": accessors,
        "animations": [{"name": "up", "channels": json_channels, "samplers": samplers}],
    })
}

/// A base, and an arm on it that carries the mesh.
fn arm() -> Value {
    json!([{"name": "base", "children": [1]}, {"name": "arm", "mesh": 0, "translation": [0, 0, 1]}])
}

fn link(name: &str, parent: Option<usize>) -> Link {
    Link { name: name.into(), parent: parent.map(LinkId::new), pose: DAffine3::IDENTITY }
}

/// A base, and an arm on it.
fn robot() -> IdVec<LinkId, Link> {
    [link("base", None), link("arm", Some(0))].into_iter().collect()
}

fn read_into(links: &IdVec<LinkId, Link>, file: &Value) -> Result<MotionFile, IoError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("up.gltf");
    fs::write(&path, file.to_string()).unwrap();
    read_motion(&path, None, links)
}

fn read(file: &Value) -> Result<Motion, IoError> {
    Ok(read_into(&robot(), file)?.motion)
}

/// Where the arm is at a time.
fn pose(motion: &Motion, time: f64) -> DAffine3 {
    let mut map = SkinMap::flat(shapes::square(), 0.001);
    map.links = robot();
    map.patches.iter_mut().for_each(|patch| patch.link = LinkId::new(1));
    let mut index = ContactIndex::new(&map).unwrap();
    index.set_motion(motion, time).unwrap();
    index.poses()[LinkId::new(1)]
}

/// From 1 s to 3 s the arm rises along `z = t^2`, whose slopes are 2 and 6 m/s, and stays turned.
const PARABOLA: [f32; 18] = [
    9.0, 9.0, 9.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.0, // at 1 s: in-tangent, value, out-tangent
    0.0, 0.0, 6.0, 0.0, 0.0, 9.0, 9.0, 9.0, 9.0,
];

#[test]
fn cubic_splines_go_through_their_keys_with_their_slopes() {
    let turns = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 0.0]
        .into_iter()
        .chain([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let turns: Vec<f32> = turns.collect();
    let channels: [Channel<'_>; 2] = [
        (1, "translation", "CUBICSPLINE", &[1.0, 3.0], &PARABOLA),
        (1, "rotation", "CUBICSPLINE", &[0.0, 4.0], &turns),
    ];
    let motion = read(&gltf(arm(), &channels)).unwrap();
    assert_eq!(motion.times(), Some([0.0, 4.0]));
    // Halfway the weights are 1/2 and 1/2, and 1/8 of 4 s for the out-tangent.
    let halfway = DQuat::from_xyzw(0.25, 0.0, 0.5, 0.5).normalize();
    for (time, z) in [(0.0, 1.0), (1.0, 1.0), (1.5, 2.25), (2.0, 4.0), (3.0, 9.0), (7.0, 9.0)] {
        let found = pose(&motion, time);
        assert!((found.translation - DVec3::Z * z).length() < 1e-12, "{found} at {time} s");
    }
    for (time, turn) in [(0.0, DQuat::IDENTITY), (2.0, halfway), (4.0, DQuat::from_xyzw(0.0, 0.0, 1.0, 0.0))]
    {
        let found = pose(&motion, time);
        assert!(found.matrix3.abs_diff_eq(DAffine3::from_quat(turn).matrix3, 1e-12), "{found} at {time} s");
    }
}

/// The spline of a skin in mm is one in m, and is written as the spline that it is.
#[test]
fn cubic_splines_are_written_and_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let (first, second) = (folder.path().join("a.gltf"), folder.path().join("b.glb"));
    let channel: Channel<'_> = (1, "translation", "CUBICSPLINE", &[1.0, 3.0], &PARABOLA);
    fs::write(&first, gltf(arm(), &[channel]).to_string()).unwrap();
    let mut draft = read_draft(&first).unwrap();
    draft.scale(1e-3);
    write_skin(&second, &assemble(&draft, &AssembleOptions::default()).unwrap().skin).unwrap();
    for motion in [&draft.animations[0], &read_draft(&second).unwrap().animations[0]] {
        for (time, z) in [(1.5, 2.25e-3), (2.0, 4e-3), (4.0, 9e-3)] {
            let found = pose(motion, time).translation;
            assert!(found.distance(DVec3::Z * z) < 1e-9, "{found} at {time} s");
        }
    }
}

#[test]
fn keys_that_do_not_fit_their_interpolation_are_refused() {
    let nan = [&PARABOLA[..17], &[f32::NAN]].concat();
    let zero = [0.0; 24];
    let channels: [(Channel<'_>, &str); 7] = [
        (
            (1, "translation", "CUBICSPLINE", &[1.0, 3.0], &PARABOLA[..6]),
            "2 values at 2 times; needed: in-tangent",
        ),
        ((1, "translation", "CUBICSPLINE", &[1.0, 2.0, 3.0], &PARABOLA), "6 values at 3 times"),
        ((1, "translation", "CUBICSPLINE", &[1.0], &PARABOLA[..9]), "two or more rising times"),
        ((1, "translation", "CUBICSPLINE", &[3.0, 1.0], &PARABOLA), "rising times"),
        ((1, "translation", "LINEAR", &[1.0, 3.0], &PARABOLA), "6 values at 2 times; needed: one value"),
        ((1, "translation", "CUBICSPLINE", &[1.0, 3.0], &nan), "NaN or infinity in row 5"),
        ((1, "rotation", "CUBICSPLINE", &[1.0, 3.0], &zero), "a rotation of length 0"),
    ];
    for (channel, expected) in channels {
        let error = read(&gltf(arm(), &[channel])).unwrap_err().to_string();
        assert!(error.contains(expected), "{channel:?}: {error}");
    }
}

/// A node with a mesh and no transform belongs to the link above it, but not where it moves.
#[test]
fn an_animated_mesh_is_a_link() {
    let nodes = json!([{"name": "base", "children": [1]}, {"name": "arm", "mesh": 0}]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("up.gltf");
    for (part, values, links) in
        [("weights", &[][..], 1), ("translation", &[0.0, 0.0, 1.0, 0.0, 0.0, 3.0], 2)]
    {
        let channel: Channel<'_> = (1, part, "LINEAR", &[1.0, 3.0], values);
        let channels = if part == "weights" { vec![] } else { vec![channel] };
        let mut file = gltf(nodes.clone(), &channels);
        if part == "weights" {
            file["animations"][0]["channels"] = json!([{"sampler": 0, "target": {"node": 1, "path": part}}]);
            file["animations"][0]["samplers"] = json!([{"input": 0, "output": 0}]);
        }
        fs::write(&path, file.to_string()).unwrap();
        let draft = read_draft(&path).unwrap();
        assert_eq!(
            (draft.links.len(), draft.sheets[0].link),
            (links, Some(LinkId::new(links - 1))),
            "{part}"
        );
        let left_out = draft.remarks.iter().filter(|r| r.to_string().contains("nothing that moves a link"));
        assert_eq!((draft.animations.len(), left_out.count()), (links - 1, 2 - links), "{part}");
        if links == 2 {
            assert_eq!(pose(&draft.animations[0], 2.0).translation, DVec3::Z * 2.0);
        }
    }
}

/// Translations below a scaled node are in its units, as those of nodes at rest.
#[test]
fn movement_below_a_scaled_node_is_scaled() {
    let turns = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0];
    for (scale, is_even) in [([0.01, 0.01, 0.01], true), ([0.01, 0.02, 0.01], false)] {
        let mut nodes = arm();
        nodes[0]["scale"] = json!(scale);
        let rise: Channel<'_> = (1, "translation", "CUBICSPLINE", &[1.0, 3.0], &PARABOLA);
        let turn: Channel<'_> = (1, "rotation", "LINEAR", &[1.0, 3.0], &turns);
        let found = pose(&read(&gltf(nodes.clone(), &[rise])).unwrap(), 2.0);
        assert!(found.translation.distance(DVec3::Z * 0.04) < 1e-9, "{found}");
        match read(&gltf(nodes, &[rise, turn])) {
            Ok(motion) if is_even => {
                let turned = pose(&motion, 3.0).matrix3;
                assert!(turned.abs_diff_eq(DAffine3::from_rotation_z(std::f64::consts::PI).matrix3, 1e-9));
            }
            Err(error) if !is_even => assert!(error.to_string().contains("below an uneven scale"), "{error}"),
            other => panic!("{other:?}, scale {scale:?}"),
        }
    }
}

#[test]
fn a_channel_for_a_node_that_is_not_there_is_refused() {
    let file = gltf(arm(), &[(7, "translation", "LINEAR", &[1.0], &[0.0, 0.0, 1.0])]);
    let error = read(&file).unwrap_err().to_string();
    assert!(error.contains("found a channel for node 7; needed: one of the file's 2 nodes"), "{error}");
}

#[test]
fn two_channels_for_one_part_of_a_node_are_refused() {
    for (part, value) in [("translation", &[0.0, 0.0, 1.0][..]), ("rotation", &[0.0, 0.0, 0.0, 1.0])] {
        let channel: Channel<'_> = (1, part, "LINEAR", &[1.0], value);
        let error = read(&gltf(arm(), &[channel, channel])).unwrap_err().to_string();
        assert!(error.contains("two channels for one part of node 1"), "{error}");
    }
}

/// A camera and a cup are no links of the map, whatever else moves.
#[test]
fn animated_nodes_that_are_no_links_are_named() {
    let mut nodes = arm();
    nodes[1]["children"] = json!([2, 3]);
    nodes.as_array_mut().unwrap().push(json!({"name": "eye", "camera": 0}));
    nodes.as_array_mut().unwrap().push(json!({"name": "cup"}));
    let rise = |node| -> Channel<'_> { (node, "translation", "STEP", &[1.0], &[0.0, 0.0, 2.0]) };
    let mut file = gltf(nodes, &[rise(1), rise(2), rise(3)]);
    file["cameras"] = json!([{"type": "orthographic",
        "orthographic": {"xmag": 1.0, "ymag": 1.0, "zfar": 2.0, "znear": 1.0}}]);
    for (names, is_moved, unused) in
        [(["base", "arm"], true, vec!["eye", "cup"]), (["base", "leg"], false, vec!["eye", "arm", "cup"])]
    {
        let links = names.iter().map(|name| link(name, None)).collect();
        let found = read_into(&links, &file).unwrap();
        assert_eq!(found.motion.times().is_some(), is_moved, "{names:?}");
        assert_eq!(found.unused, unused, "{names:?}");
    }
}

#[test]
fn names_of_several_links_or_nodes_are_refused() {
    let rise = |node| -> Channel<'_> { (node, "translation", "STEP", &[1.0], &[0.0, 0.0, 2.0]) };
    let links = ["base", "arm", "arm", "arm"].map(|name| link(name, None)).into_iter().collect();
    let error = read_into(&links, &gltf(arm(), &[rise(1)])).unwrap_err().to_string();
    assert!(error.contains("node \"arm\": found 3 links of this name in the map; needed: one"), "{error}");
    let mut twins = arm();
    twins[0]["children"] = json!([1, 2]);
    twins.as_array_mut().unwrap().push(json!({"name": "arm"}));
    let error = read(&gltf(twins, &[rise(1), rise(2)])).unwrap_err().to_string();
    assert!(error.contains("found another animated node of this name"), "{error}");
    let still = read_into(&links, &gltf(arm(), &[rise(0)])).unwrap();
    assert!(still.unused.is_empty(), "names of links that do not move may be the same");
}

/// The map lacks the mount between base and arm, and the stand below the base.
#[test]
fn links_that_the_map_lacks_pose_those_that_it_has() {
    let nodes = json!([
        {"name": "stand", "children": [1], "translation": [5, 0, 0]},
        {"name": "base", "children": [2]},
        {"name": "mount", "children": [3], "translation": [0, 0, 2], "rotation": [0, 0, 0.6, 0.8]},
        {"name": "arm", "mesh": 0, "translation": [1, 0, 0]},
    ]);
    let parent = DAffine3::from_rotation_translation(DQuat::from_xyzw(0.0, 0.0, 0.6, 0.8), DVec3::Z * 2.0);
    let turns = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 0.0]
        .into_iter()
        .chain([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let turns: Vec<f32> = turns.collect();
    let rise: Channel<'_> = (3, "translation", "CUBICSPLINE", &[1.0, 3.0], &PARABOLA);
    let turn: Channel<'_> = (3, "rotation", "CUBICSPLINE", &[1.0, 3.0], &turns);
    let base: Channel<'_> = (1, "rotation", "STEP", &[1.0], &[0.0, 0.0, 0.0, 1.0]);
    let mount: Channel<'_> = (2, "rotation", "STEP", &[1.0], &[0.0, 0.0, 0.0, 1.0]);
    let links = robot();
    let read = |channels: &[Channel<'_>]| read_into(&links, &gltf(nodes.clone(), channels)).unwrap();
    let alone = [(1, rise.1, rise.2, rise.3, rise.4), (1, turn.1, turn.2, turn.3, turn.4)];
    let alone = self::read(&gltf(arm(), &alone)).unwrap();
    for time in [0.0, 1.5, 2.0, 3.0] {
        let expected = parent * pose(&alone, time);
        let found = pose(&read(&[rise, turn]).motion, time);
        assert!(found.abs_diff_eq(expected, 1e-9), "{found}, not {expected}, at {time} s");
        let found = pose(&read(&[base]).motion, time).translation;
        assert!(found.distance(DVec3::X * 5.0) < 1e-12, "the arm on the base on the stand, not {found}");
    }
    assert_eq!(read(&[rise, mount]).unused, ["mount"]);
}
