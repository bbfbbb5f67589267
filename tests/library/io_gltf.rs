//! Laws of glTF: what is written reads back the same, and nothing that a file says is believed
//! unseen.

use std::{fs, path::Path};

use crate::common::data;
use crate::gltf_files::{Glb, f32s, u16s};
use dermatome::cut::PlaceId;
use dermatome::id::VertexId;
use dermatome::io::{
    IoError, ReadParts, draft_from_bytes, lost_in, map_from_bytes, map_to_bytes, read_draft, read_map,
    skin_to_bytes, write_map, write_pyramids, write_skin,
};
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::pipeline::{BuildOptions, build};
use dermatome::pyramid::{CoarsenOptions, coarsen};
use dermatome::run::Run;
use dermatome::skin::{
    AssembleOptions, Covariance, Link, LinkId, Motion, MotionFrame, Patch, PatchId, Presence, RemarkKind,
    Sheet, Skin, TaxelId, Taxels, assemble,
};
use glam::{DAffine3, DQuat, DVec3, Vec3};
use serde_json::json;

/// Three links in a chain and beside it, one without a patch; two patches with everything a patch
/// can have.
fn robot() -> Skin {
    let pose = |angle: f64, at: DVec3| DAffine3::from_rotation_translation(DQuat::from_rotation_x(angle), at);
    let mut skin = Skin::default();
    let mut link = |name: &str, parent, pose| skin.links.push(Link { name: name.into(), parent, pose });
    let base = link("base", None, pose(0.0, DVec3::ZERO));
    let arm = link("arm", Some(base), pose(0.5, DVec3::new(0.0, 0.25, 1.0)));
    link("tool", Some(arm), pose(-1.0, DVec3::X));
    let other = link("", None, pose(3.0, DVec3::NEG_Y));
    let mut palm = Patch::from_mesh("palm", arm, shapes::cap(200, 0.125, 0.75));
    for (id, k) in palm.taxels.ids.iter_mut().zip(0_u32..) {
        *id = TaxelId(if k % 5 == 0 { 0 } else { 0xFFFF_0000 + k });
    }
    palm.taxels.presence[VertexId::new(3)] = Presence::Absent;
    palm.taxels.presence[VertexId::new(4)] = Presence::ThermalPad;
    palm.taxels.tangents = Some(palm.taxels.normals.map(|n| n.any_orthonormal_vector()));
    palm.taxels.densities = Some(palm.taxels.areas.map(|a| 1.0 / a));
    // Exact in `f32`.
    let covariance = [4.0, -1.0, 0.5, 2.0, 0.25, 1.0].map(|x: f64| x / f64::from(1 << 20));
    let mut covariances = palm.taxels.areas.map(|_| Some(Covariance::from(covariance)));
    // One that is exact and one that is not known.
    (covariances[VertexId::new(5)], covariances[VertexId::new(6)]) = (Some(Covariance::default()), None);
    palm.taxels.covariances = Some(covariances);
    skin.patches.push(palm);
    skin.patches.push(Patch::from_mesh("back", other, shapes::lattice(5, 4, 0.0078125)));
    skin
}

#[expect(clippy::cast_possible_truncation, reason = "the narrowing that the file does")]
fn rounded(x: f64) -> f64 {
    f64::from(x as f32)
}

/// The skin that `f32` can tell.
fn narrowed(mut skin: Skin) -> Skin {
    for patch in skin.patches.iter_mut() {
        let round = |p: &DVec3| DVec3::from_array(p.to_array().map(rounded));
        patch.mesh.positions = patch.mesh.positions.map(round);
        patch.taxels.normals = patch.taxels.normals.map(round);
        patch.taxels.tangents = patch.taxels.tangents.as_ref().map(|all| all.map(round));
        patch.taxels.areas = patch.taxels.areas.map(|&a| rounded(a));
        patch.taxels.densities = patch.taxels.densities.as_ref().map(|d| d.map(|&x| rounded(x)));
    }
    skin
}

fn read_skin(path: &Path) -> Skin {
    let assembled = assemble(&read_draft(path).unwrap(), &AssembleOptions::default()).unwrap();
    assert!(assembled.remarks.is_empty(), "nothing to repair: {:?}", assembled.remarks);
    assembled.skin
}

/// The same tangents but for rounding, or none in both.
fn assert_tangents(got: &Taxels, want: &Taxels) {
    assert_eq!(got.tangents.is_some(), want.tangents.is_some());
    for (got, want) in got.tangents.iter().flatten().zip(want.tangents.iter().flatten()) {
        assert!(got.abs_diff_eq(*want, 2e-7), "{got} is {want} but for rounding");
    }
}

#[test]
fn a_skin_reads_back_the_same_in_both_forms() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["skin.glb", "skin.gltf"] {
        let (first, second) = (folder.path().join(name), folder.path().join(format!("again-{name}")));
        write_skin(&first, &robot()).unwrap();
        let mut back = read_skin(&first);
        for (link, want) in back.links.iter_mut().zip(&robot().links) {
            assert!(link.pose.abs_diff_eq(want.pose, 1e-7), "{name}: pose of {:?}", want.name);
            link.pose = want.pose;
        }
        let want = narrowed(robot());
        assert_eq!(back.links, want.links, "{name}");
        for (got, want) in back.patches.iter().zip(&want.patches) {
            let whose = format!("{name}: {}", want.name);
            assert_eq!((&got.name, got.link, &got.mesh), (&want.name, want.link, &want.mesh), "{whose}");
            let (got, want) = (&got.taxels, &want.taxels);
            let close = |(a, b): (&DVec3, &DVec3)| a.abs_diff_eq(*b, 1e-7);
            assert!(got.normals.iter().zip(&want.normals).all(close), "{whose}: normals");
            assert_tangents(got, want);
            assert_eq!((&got.areas, &got.densities), (&want.areas, &want.densities), "{whose}");
            assert_eq!((&got.ids, &got.presence), (&want.ids, &want.presence), "{whose}");
        }
        write_skin(&second, &robot()).unwrap();
        assert_eq!(fs::read(&first).unwrap(), fs::read(&second).unwrap(), "{name}: the same bytes again");
    }
}

/// A file of ours keeps acuities and animations, a map has all of its skin, and other kinds of files say what they lose.
#[test]
fn acuities_and_animations_are_kept_or_said_to_be_lost() {
    let folder = tempfile::tempdir().unwrap();
    let mut skin = robot();
    let palm = &mut skin.patches[PatchId::new(0)].taxels;
    palm.acuities = Some(palm.areas.ids().map(|v| 1.0 + f64::from(v.raw() % 3)).collect());
    let mut motion = Motion::default();
    let to = DAffine3::from_translation(DVec3::X);
    motion.set(LinkId::from(1), MotionFrame::Parent, &[(0.0, DAffine3::IDENTITY), (1.0, to)]).unwrap();
    motion.name = "wave".into();
    skin.animations = vec![motion];
    let path = folder.path().join("skin.glb");
    write_skin(&path, &skin).unwrap();
    let back = read_skin(&path);
    let acuities = |skin: &Skin| skin.patches[PatchId::new(0)].taxels.acuities.clone();
    assert_eq!((acuities(&back), back.animations.len()), (acuities(&skin), 1));
    assert_eq!(back.animations[0].name, "wave");
    let map = build(&back, &BuildOptions::default()).unwrap();
    let (whole, map_file) = (map.skin(), folder.path().join("map.glb"));
    for kept in [&whole, &map_from_bytes(map_to_bytes(&map).unwrap()).unwrap().skin()] {
        assert_eq!((acuities(kept), kept.animations.len()), (acuities(&skin), 1));
    }
    write_map(&map_file, &map).unwrap();
    let again = assemble(&read_draft(&map_file).unwrap(), &AssembleOptions::default()).unwrap().skin;
    assert_eq!(acuities(&again), acuities(&skin), "a map is a skin, too");
    assert!(lost_in(&path, &skin).is_empty());
    for kind in ["obj", "off", "ply", "stl", "csv", "json"] {
        let lost = lost_in(&folder.path().join(format!("skin.{kind}")), &skin).join("; ");
        assert!(lost.contains("acuities") && lost.contains("animations"), "{kind}: {lost}");
    }
}

/// Every file that is written here is one that the `gltf` crate reads and finds valid, down to its
/// bytes.
#[test]
fn what_is_written_is_read_by_the_gltf_crate() {
    use base64::{Engine as _, engine::general_purpose::STANDARD};
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write_skin(&at("skin.glb"), &robot()).unwrap();
    write_skin(&at("skin.gltf"), &robot()).unwrap();
    write_map(&at("map.glb"), &map()).unwrap();
    let skin = robot();
    let pyramid =
        |p: &Patch| coarsen(&p.mesh, &p.taxels, &CoarsenOptions::default(), Run::default()).unwrap();
    let pyramids: Vec<_> = skin.patches.iter().map(pyramid).collect();
    write_pyramids(&at("levels.glb"), &skin, &pyramids).unwrap();
    for name in ["skin.glb", "skin.gltf", "map.glb", "levels.glb"] {
        let gltf = gltf::Gltf::from_slice(&fs::read(at(name)).unwrap()).unwrap();
        let buffer = gltf.buffers().next().unwrap();
        let bytes = match buffer.source() {
            gltf::buffer::Source::Bin => gltf.blob.clone().unwrap(),
            gltf::buffer::Source::Uri(uri) => STANDARD.decode(uri.split_once(',').unwrap().1).unwrap(),
        };
        assert_eq!(bytes.len(), buffer.length(), "{name}: one buffer of the length it declares");
        for accessor in gltf.accessors() {
            let view = accessor.view().unwrap();
            let stride = view.stride().unwrap_or(accessor.size());
            let needed = accessor.offset() + stride * (accessor.count() - 1) + accessor.size();
            assert!(needed <= view.length(), "{name}: accessor {}", accessor.index());
            assert!(view.offset() + view.length() <= bytes.len(), "{name}: view {}", view.index());
        }
        for primitive in gltf.meshes().flat_map(|mesh| mesh.primitives().collect::<Vec<_>>()) {
            let reader = primitive.reader(|_| Some(&bytes));
            let positions: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
            let bounds = primitive.bounding_box();
            for (k, (low, high)) in bounds.min.into_iter().zip(bounds.max).enumerate() {
                assert!(positions.iter().all(|p| (low..=high).contains(&p[k])), "{name}: bounds");
            }
            let normals: Vec<_> = reader.read_normals().unwrap().map(Vec3::from_array).collect();
            assert_eq!(normals.len(), positions.len(), "{name}: a normal each");
            for ([x, y, z, w], n) in reader.read_tangents().into_iter().flatten().zip(normals) {
                let t = Vec3::new(x, y, z);
                assert!(t.dot(n).abs() < 1e-6 && (t.length() - 1.0).abs() < 1e-6 && w == 1.0, "{name}: {t}");
            }
            let mut corners = reader.read_indices().unwrap().into_u32();
            assert!(corners.all(|corner| (corner as usize) < positions.len()), "{name}: corners exist");
            let id = gltf::Semantic::Extras("TAXEL_ID".into());
            if let Some(ids) = primitive.get(&id) {
                assert_eq!(ids.count(), positions.len(), "{name}: an id each");
            }
            let is_map = name == "map.glb";
            assert_eq!(primitive.material().index(), is_map.then_some(0), "{name}: a map has one material");
        }
    }
}

/// A tangent of a file is a unit vector, or that is noted; one along the normal has no
/// direction on the skin, and its neighbours' stands in.
#[test]
fn invalid_tangents_are_noted_or_left_out() {
    let up = f32s(&[0., 0., 1.].repeat(4));
    let with = |tangents: [[f32; 4]; 4]| {
        let mut glb = Glb::square();
        glb.attribute("NORMAL", 5126, "VEC3", &up);
        glb.attribute("TANGENT", 5126, "VEC4", &f32s(tangents.as_flattened()));
        glb
    };
    let (x, y) = ([1., 0., 0., 1.], [0., 1., 0., -1.]);
    let sheet_of = |tangents| sheet(&with(tangents)).tangents.unwrap();
    assert_eq!(sheet_of([x, y, x, y]), [DVec3::X, DVec3::Y, DVec3::X, DVec3::Y], "whatever their sign");
    for odd in [[0.5, 0., 0., 1.], [0., 0., 0., 1.], [f32::NAN, 0., 0., 1.]] {
        let notes = read_bytes(&with([x, x, odd, x]).bytes()).unwrap().remarks;
        assert_eq!(notes.len(), 1, "{odd:?}: {notes:?}");
    }
    let mut short = with([x; 4]);
    let three = short.array(5126, "VEC4", 3, &f32s(&x.repeat(3)));
    short.json["meshes"][0]["primitives"][0]["attributes"]["TANGENT"] = json!(three);
    assert_eq!(sheet(&short).tangents, None, "one per vertex, or none");
    let mut flat = with([x; 4]);
    flat.json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("NORMAL");
    assert_eq!(sheet(&flat).tangents, None, "glTF ignores tangents without normals");

    let draft = read_bytes(&with([x, x, [0., 0., 1., 1.], x]).bytes()).unwrap();
    let assembled = assemble(&draft, &AssembleOptions::default()).unwrap();
    assert_eq!(assembled.remarks[0].kind, RemarkKind::TangentsReplaced { taxels: 1 });
    let tangents = assembled.skin.patches[PatchId::new(0)].taxels.tangents.as_ref().unwrap();
    assert!(tangents.iter().all(|t| t.abs_diff_eq(DVec3::X, 1e-15)), "{tangents:?}");
}

/// A mirror takes normals and tangents along; `n x t` comes out as the opposite of its image.
#[test]
fn a_mirrored_node_mirrors_tangents() {
    let mut glb = Glb::square().with("/nodes/0", json!({"mesh": 0, "scale": [-3, 1, 1]}));
    glb.attribute("NORMAL", 5126, "VEC3", &f32s(&[0., 0., 1.].repeat(4)));
    glb.attribute("TANGENT", 5126, "VEC4", &f32s(&[0.6, 0.8, 0., 1.].repeat(4)));
    let draft = read_bytes(&glb.bytes()).unwrap();
    let pose = draft.links[LinkId::new(0)].pose;
    let assembled = assemble(&draft, &AssembleOptions::default()).unwrap();
    let taxels = &assembled.skin.patches[PatchId::new(0)].taxels;
    let v = VertexId::new(2);
    let [n, t] = [taxels.normals[v], taxels.tangents.as_ref().unwrap()[v]];
    let [n, t] = [n, t].map(|axis| pose.transform_vector3(axis));
    assert!(n.abs_diff_eq(DVec3::Z, 1e-12), "{n}");
    let image = |x: f64, y: f64| DVec3::new(-3.0 * x, y, 0.0).normalize();
    assert!(t.abs_diff_eq(image(0.6, 0.8), 1e-7), "{t}");
    assert!(n.cross(t).dot(image(-0.8, 0.6)) < 0.0, "the other side of the tangent");
}

fn map() -> SkinMap {
    build(&robot(), &BuildOptions::default()).unwrap()
}

fn read_bytes(bytes: &[u8]) -> Result<dermatome::skin::Draft, IoError> {
    draft_from_bytes(Path::new("skin.glb"), bytes.into(), ReadParts::default())
}

/// A length in the header that ends within a chunk's header used to be subtracted from.
#[test]
fn a_stated_length_within_a_chunk_header_is_refused() {
    let json = br#"{"asset":{"version":"2.0"}} "#;
    for stated in [13_u32, 16, 19] {
        let mut bytes = b"glTF".to_vec();
        let words = [2, stated, u32::try_from(json.len()).unwrap(), 0x4E4F_534A];
        bytes.extend(words.into_iter().flat_map(u32::to_le_bytes).chain(json.iter().copied()));
        let error = read_bytes(&bytes).unwrap_err().to_string();
        let expected = format!("GLB chunk 0: found {} bytes", stated - 12);
        assert!(error.contains(&expected), "{stated}: {error}");
    }
}

fn sheet(glb: &Glb) -> Sheet {
    let mut draft = read_bytes(&glb.bytes()).unwrap();
    assert_eq!(draft.sheets.len(), 1, "one sheet");
    draft.sheets.remove(0)
}

/// The error of a file, as text.
fn refusal(glb: &Glb) -> String {
    match read_bytes(&glb.bytes()) {
        Ok(draft) => panic!("loaded {draft:?}"),
        Err(e) => format!("{e}\n{e:?}"),
    }
}

#[test]
fn a_map_reads_back_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.glb");
    let map = map();
    write_map(&path, &map).unwrap();
    let back = read_map(&path).unwrap();
    assert_eq!(back.patches.len(), 2);
    assert_eq!(back.links.len(), map.links.len(), "links without a patch stay");
    let close = |a: f64, b: f64| (a - b).abs() <= 1e-6 * a.abs().max(1e-2);
    for (got, want) in back.patches.iter().zip(&map.patches) {
        assert_eq!((&got.name, got.link, &got.taxels.ids), (&want.name, want.link, &want.taxels.ids));
        assert_eq!(got.taxels.covariances, want.taxels.covariances, "of {}", want.name);
        assert_eq!(got.taxels.presence, want.taxels.presence, "of {}", want.name);
        assert_tangents(&got.taxels, &want.taxels);
        assert_eq!(got.taxels.densities.is_some(), want.taxels.densities.is_some(), "of {}", want.name);
        for (a, b) in got.taxels.densities.iter().flatten().zip(want.taxels.densities.iter().flatten()) {
            assert!((a / b - 1.0).abs() < 1e-6, "density {a} is {b} but for rounding");
        }
        assert_eq!(got.levels.len(), want.levels.len(), "{}", want.name);
        for (got, want) in got.levels.iter().zip(&want.levels) {
            assert_eq!(got.level.mesh.triangles, want.level.mesh.triangles);
            assert_eq!(got.level.origins, want.level.origins, "centres are found again");
            assert_eq!(got.frame, want.frame);
            for (a, b) in got.uv.iter().zip(&want.uv) {
                assert!(a.distance(*b) < 1e-7, "{a} is {b} but for rounding");
            }
            assert!(got.level.areas.iter().zip(&want.level.areas).all(|(a, b)| close(*a, *b)));
            assert_eq!(got.distortion, want.distortion, "measured as the file holds it");
            for (got, want) in [
                (&got.level.from_coarser, &want.level.from_coarser),
                (&got.level.to_finest, &want.level.to_finest),
            ] {
                assert_eq!(got.is_some(), want.is_some());
                let (Some(got), Some(want)) = (got, want) else { continue };
                assert_eq!((got.coarse_len, &got.indices), (want.coarse_len, &want.indices));
                for (a, b) in got.weights.iter().zip(&want.weights) {
                    assert!((0..3).all(|k| (a[k] - b[k]).abs() < 1e-6), "{a:?} is {b:?} but for rounding");
                    assert!((a.iter().sum::<f64>() - 1.0).abs() < 1e-15, "{a:?} sums to 1 in f64 again");
                }
            }
        }
    }
    let again = folder.path().join("again.glb");
    write_map(&again, &back).unwrap();
    let skin = read_skin(&again);
    assert_eq!(skin.patches[PatchId::new(0)].name, "palm", "a map reads as its skin too");
    assert_eq!(skin.patches.len(), 2, "of which only level 0 is shown");
    assert!(skin.patches[PatchId::new(0)].taxels.covariances.is_some(), "that still knows its uncertainty");
}

/// Needles whose width is a few units of rounding, and skin so large that its pixels are enlarged after it is
/// mapped: the figures are those that a reader of the file finds.
#[test]
fn a_build_measures_what_its_file_holds() {
    let needles = |i: u32, j: u32| {
        let x = if i % 2 == 1 { f64::from(i) + 0.999_99 } else { f64::from(i) };
        DVec3::new(0.01 * x, 0.01 * f64::from(j), 0.0)
    };
    for mesh in [shapes::sheet(12, 9, needles), shapes::cap(300, 700.0, 1.0)] {
        let map = build(&Skin::from_mesh("skin", mesh), &BuildOptions::default()).unwrap();
        let bytes = map_to_bytes(&map).unwrap();
        let [want, got] = [map, map_from_bytes(bytes).unwrap()]
            .map(|map| map.patches[PatchId::new(0)].levels.map(|level| (level.distortion, level.frame)));
        assert_eq!(got, want);
    }
}

#[test]
fn a_file_that_is_no_map_says_so() {
    assert!(matches!(read_map_bytes(&Glb::square().bytes()), Err(IoError::NoMap { .. })));
}

/// Each row: what is changed in the square, and which element the error names.
#[test]
fn invalid_documents_are_refused_by_element() {
    let cases = [
        ("/asset/version", json!("3.0"), "asset.version"),
        ("/accessors/0/count", json!(u64::MAX), "accessor 0"),
        ("/accessors/0/count", json!(1.5), "accessors[0]"),
        ("/accessors/0/count", json!(0), "accessor 0"),
        ("/accessors/0/byteOffset", json!(u64::MAX - 3), "accessor 0"),
        // 2^32 more than 5126, which the crate would take.
        ("/accessors/0/componentType", json!(4_294_972_422_u64), "accessors[0].componentType"),
        ("/accessors/0/type", json!("VEC9"), "accessors[0].type"),
        ("/accessors/0/bufferView", json!(4_294_967_296_u64), "accessors[0].bufferView"),
        ("/bufferViews/0/buffer", json!(1), "bufferViews[0].buffer"),
        ("/buffers", json!([]), "bufferViews[0].buffer"),
        ("/bufferViews/0/byteOffset", json!(u64::MAX), "bufferView 0"),
        ("/bufferViews/0/byteStride", json!(8), "bufferView 0"),
        ("/buffers/0/byteLength", json!(4096), "buffer 0"),
        ("/buffers/0/uri", json!(7), "buffers[0]"),
        ("/meshes/0/primitives/0/mode", json!(7), "the scene"),
        ("/meshes/0/primitives/0/indices", json!(7), "mesh 0 primitive 0 indices"),
        ("/meshes/0/primitives/0/attributes/POSITION", json!(7), "mesh 0 primitive 0 POSITION"),
        ("/nodes/0/mesh", json!(3), "nodes[0].mesh"),
        ("/nodes/0/children", json!([5]), "nodes[0].children[0]"),
        ("/nodes/0/rotation", json!([0, 0, 0, 2]), "node 0"),
        ("/nodes/0/scale", json!([1, 0, 1]), "node 0"),
        ("/nodes/0/matrix", json!([1, 0, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]), "node 0"),
        ("/scenes/0/nodes", json!([1]), "scenes[0].nodes[0]"),
    ];
    for (pointer, value, element) in cases {
        match read_bytes(&Glb::square().with(pointer, value.clone()).bytes()) {
            Err(IoError::Invalid { element: found, .. }) => {
                assert_eq!(found.name, element, "{pointer} = {value}")
            }
            other => panic!("{pointer} = {value}: {other:?}"),
        }
    }
    for version in ["1.0", "1"] {
        let error = read_bytes(&Glb::square().with("/asset/version", json!(version)).bytes()).unwrap_err();
        assert!(matches!(error, IoError::Unsupported { feature, .. } if feature.to_string() == "glTF 1.0"));
    }
}

/// What is not read is not checked.
#[test]
fn faults_that_touch_no_triangle_are_passed_over() {
    let cases = [
        ("/accessors/0/max", json!([2, 1, 0])),
        ("/bufferViews/0/target", json!(34963)),
        // A stride that says what is the case, and one of 0 for none.
        ("/bufferViews/1/byteStride", json!(2)),
        ("/bufferViews/0/byteStride", json!(0)),
        ("/meshes/0/primitives/0/attributes/COLOUR", json!(9)),
        ("/meshes/0/primitives/0/targets", json!([{"NORMAL": 9}])),
        ("/nodes/0/skin", json!(3)),
        ("/scene", json!(4)),
        ("/scenes/0/nodes", json!([0, 0])),
        ("/materials", json!([{"pbrMetallicRoughness": 3}])),
        ("/extensionsUsed", json!(["A", "A"])),
        ("/extensionsRequired", json!(["FB_materials_modmap", "EXT_lights_image_based"])),
    ];
    for (pointer, value) in cases {
        let draft = read_bytes(&Glb::square().with(pointer, value.clone()).bytes());
        let draft = draft.unwrap_or_else(|e| panic!("{pointer} = {value}: {e}"));
        assert_eq!(draft.sheets[0].triangles, [[0, 1, 2], [0, 2, 3]], "{pointer}");
    }
    // An accessor and a view that nothing uses.
    let mut glb = Glb::square();
    glb.push("accessors", json!({"type": "VEC9", "count": 1, "componentType": 1, "bufferView": 77}));
    glb.push("bufferViews", json!({"buffer": 9, "byteLength": 1}));
    assert_eq!(sheet(&glb).triangles, [[0, 1, 2], [0, 2, 3]]);
    // Indices that start at an odd byte are the same indices.
    let mut glb = Glb::square();
    let view = glb.view(&[&[9], u16s(&[0, 1, 2, 0, 2, 3]).as_slice()].concat());
    glb.json["accessors"][1] = json!({
        "bufferView": view, "byteOffset": 1, "componentType": 5123, "type": "SCALAR", "count": 6
    });
    assert_eq!(sheet(&glb).triangles, [[0, 1, 2], [0, 2, 3]]);
}

/// Normals of any length say the same direction.
#[test]
fn normals_are_normalised() {
    let mut glb = Glb::square();
    glb.attribute("NORMAL", 5126, "VEC3", &f32s(&[0., 0., 7., 0., 0., 0., 0., 0., 0.5, 0., 0., 1.]));
    let draft = read_bytes(&glb.bytes()).unwrap();
    assert_eq!(draft.sheets[0].normals, Some(vec![DVec3::Z, DVec3::ZERO, DVec3::Z, DVec3::Z]));
    assert!(draft.remarks[0].to_string().contains("normal 0 of length 7"));
    let mut glb = Glb::square();
    glb.attribute("NORMAL", 5126, "VEC3", &f32s(&[f32::NAN; 12]));
    let draft = read_bytes(&glb.bytes()).unwrap();
    assert_eq!((draft.sheets[0].normals.as_ref(), draft.remarks.len()), (None, 1), "they are left out");
}

#[test]
fn invalid_trees_are_refused() {
    let nodes = |nodes| refusal(&Glb::square().with("/nodes", nodes));
    let error = nodes(json!([{"mesh": 0}, {"children": [2]}, {"children": [1]}]));
    assert!(error.contains("node 1") && error.contains("above itself"), "a circle: {error}");
    let error = nodes(json!([{"children": [2]}, {"children": [2]}, {"mesh": 0}]));
    assert!(error.contains("node 2") && error.contains("one parent"), "{error}");

    let mut chain = vec![json!({"mesh": 0})];
    chain.extend((1..50_000).map(|i| json!({"children": [i - 1]})));
    let deep = Glb::square().with("/nodes", json!(chain)).with("/scenes/0/nodes", json!([49_999]));
    let draft = read_bytes(&deep.bytes()).unwrap();
    assert_eq!(draft.links.len(), 49_999, "a deep chain is walked without a deep stack");
}

#[test]
fn a_scene_without_triangles_says_so() {
    let square = Glb::square();
    let error = refusal(&square.clone().with("/nodes/0", json!({})));
    assert!(error.contains("triangles"), "a mesh that no node carries: {error}");
    let error = refusal(&square.clone().with("/meshes/0/primitives/0/mode", json!(1)));
    assert!(error.contains("triangles"), "lines: {error}");
    let mut empty = square;
    for key in ["meshes", "nodes", "scenes", "scene"] {
        empty.json.as_object_mut().unwrap().remove(key);
    }
    assert!(refusal(&empty).contains("no mesh"), "nothing at all");
}

#[test]
fn invalid_positions_and_indices_are_refused() {
    for odd in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut glb = Glb::square();
        glb.bin[12..16].copy_from_slice(&odd.to_le_bytes());
        let error = refusal(&glb);
        assert!(error.contains("accessor 0") && error.contains("row 1"), "{odd}: {error}");
    }
    let mut glb = Glb::square();
    let indices = glb.bin.len() - 12;
    glb.bin[indices + 4..indices + 6].copy_from_slice(&7_u16.to_le_bytes());
    let error = refusal(&glb);
    assert!(error.contains("accessor 1") && error.contains("index 7 at row 2"), "past the end: {error}");
    glb.bin[indices + 4..indices + 6].copy_from_slice(&u16::MAX.to_le_bytes());
    assert!(refusal(&glb).contains("65535"), "primitive restart");
}

#[test]
fn ids_come_in_every_width() {
    let with = |component, kind, bytes: &[u8]| {
        let mut glb = Glb::square();
        glb.attribute("_TAXEL_ID", component, kind, bytes);
        glb
    };
    let ids = |glb: &Glb| sheet(glb).ids.unwrap().iter().map(|id| id.0).collect::<Vec<_>>();
    let mut bytes = with(5121, "SCALAR", &[1, 0, 0, 0, 2, 0, 0, 0, 2, 0, 0, 0, 255, 0, 0, 0]);
    bytes.json["bufferViews"][2]["byteStride"] = json!(4);
    assert_eq!(ids(&bytes), [1, 2, 2, 255], "u8, four bytes apart, duplicates and all");
    let mut shorts = with(5123, "SCALAR", &[1, 2, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 255, 255, 0, 0]);
    shorts.json["bufferViews"][2]["byteStride"] = json!(4);
    assert_eq!(ids(&shorts), [513, 2, 0, 65_535], "u16");
    let pairs = with(5123, "VEC2", &u16s(&[1, 0, 0, 1, 65_535, 65_535, 7, 0]));
    assert_eq!(ids(&pairs), [1, 65_536, u32::MAX, 7], "VEC2 of u16: low, high");
    let floats = with(5126, "SCALAR", &f32s(&[0., 1., 16_777_216., 3.]));
    assert_eq!(ids(&floats), [0, 1, 16_777_216, 3], "floats to 2^24");
    for odd in [0.5, -1.0, 16_777_218.0] {
        let error = refusal(&with(5126, "SCALAR", &f32s(&[0., 1., odd, 3.])));
        assert!(error.contains("row 2"), "{odd}: {error}");
    }
}

/// A map has ids as floats where all are below 2^24, and presence; skins have integers.
#[test]
fn maps_hold_small_ids_as_floats() {
    let accessor = |glb: &Glb, name: &str| {
        let at = glb.json["meshes"][0]["primitives"][0]["attributes"][name].as_u64().unwrap();
        let accessor = &glb.json["accessors"][usize::try_from(at).unwrap()];
        (accessor["componentType"].as_u64().unwrap(), accessor["type"].as_str().unwrap().to_owned())
    };
    for (last, id) in [((1 << 24) - 1, (5126, "SCALAR".to_owned())), (1 << 24, (5123, "VEC2".to_owned()))] {
        let mut map = map();
        let ids = &mut map.patches[PatchId::new(0)].taxels.ids;
        *ids = (0..).take(ids.len()).map(|k| TaxelId(if k == 3 { last } else { k })).collect();
        let ids = ids.clone();
        let bytes = map_to_bytes(&map).unwrap();
        let glb = Glb::parse(&bytes);
        assert_eq!(accessor(&glb, "_TAXEL_ID"), id, "up to {last}");
        assert_eq!(accessor(&glb, "_PRESENT"), (5126, "SCALAR".into()));
        assert_eq!(map_from_bytes(bytes).unwrap().patches[PatchId::new(0)].taxels.ids, ids);
    }
}

#[test]
fn presence_is_one_of_four() {
    let with = |values: [f32; 4]| {
        let mut glb = Glb::square();
        glb.attribute("_PRESENT", 5126, "SCALAR", &f32s(&values));
        glb
    };
    let presence = sheet(&with([0., 1., 2., 3.])).presence.unwrap();
    assert_eq!(presence, [Presence::Absent, Presence::Present, Presence::ThermalPad, Presence::Other]);
    assert!(refusal(&with([0., 1., 4., 1.])).contains("row 2"));
}

#[test]
fn quantized_integers_are_decoded() {
    let rows: [[i8; 4]; 4] = [[-127, 0, 0, 0], [127, 0, 0, 0], [127, 127, 0, 0], [-128, 127, 0, 0]];
    let bytes: Vec<u8> = rows.as_flattened().iter().map(|x| x.to_le_bytes()[0]).collect();
    let mut glb = Glb::square().with("/extensionsRequired", json!(["KHR_mesh_quantization"]));
    glb.attribute("POSITION", 5120, "VEC3", &bytes);
    glb.json["bufferViews"][2]["byteStride"] = json!(4);
    let raw = sheet(&glb).positions;
    assert_eq!(raw[3], DVec3::new(-128.0, 127.0, 0.0), "integers as they are");
    let normalized = sheet(&glb.with("/accessors/2/normalized", json!(true))).positions;
    assert_eq!(normalized[1], DVec3::X, "127 is 1");
    assert_eq!(normalized[3], DVec3::new(-1.0, 1.0, 0.0), "-128 is -1 too");
}

#[test]
fn sparse_rows_replace_those_of_the_view() {
    let mut glb = Glb::square();
    let numbers = glb.view(&[2, 0, 3, 0]);
    let values = glb.view(&f32s(&[2., 2., 0., 0., 3., 0.]));
    glb.json["accessors"][0]["sparse"] = json!({
        "count": 2,
        "indices": {"bufferView": numbers, "componentType": 5123},
        "values": {"bufferView": values},
    });
    glb.json["accessors"][0]["max"] = json!([2, 3, 0]);
    let positions = sheet(&glb).positions;
    assert_eq!(positions[1..], [DVec3::X, DVec3::new(2., 2., 0.), DVec3::new(0., 3., 0.)]);

    let refuse = |pointer: &str, value| refusal(&glb.clone().with(pointer, value));
    assert!(refuse("/accessors/0/sparse/count", json!(5)).contains("count 5"));
    assert!(refuse("/accessors/0/sparse/indices/componentType", json!(5126)).contains("accessors[0].sparse"));
    assert!(refuse("/accessors/0/sparse/values/bufferView", json!(77)).contains("accessors[0].sparse"));
    assert!(refuse("/accessors/0/sparse/values/byteOffset", json!(4)).contains("2 rows"));
    let mut falling = glb.clone();
    let at = falling.json["bufferViews"][numbers]["byteOffset"].as_u64().unwrap();
    let at = usize::try_from(at).unwrap();
    falling.bin[at] = 3;
    assert!(refusal(&falling).contains("strictly increasing"));
    falling.bin[at + 2] = 9;
    assert!(refusal(&falling).contains("below 4"));
}

/// Zeros need no bytes: only the budget stands between 4e9 of them and the memory.
#[test]
fn memory_of_accessors_without_bytes_is_bounded() {
    let mut glb = Glb::square();
    glb.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert_eq!(sheet(&glb).positions, [DVec3::ZERO; 4], "without bytes: zeros");
    let error = refusal(&glb.with("/accessors/0/count", json!(4_000_000_000_u64)));
    assert!(error.contains("accessor 0") && error.contains("4000000000"), "{error}");
}

#[test]
fn memory_of_a_mesh_of_many_nodes_is_bounded() {
    let mut glb = Glb::square();
    let count = 100_000;
    let rows = f32s(&vec![0.0; 3 * count]);
    let many = glb.array(5126, "VEC3", count, &rows);
    glb.json["accessors"][many]["min"] = json!([0, 0, 0]);
    glb.json["accessors"][many]["max"] = json!([0, 0, 0]);
    glb.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(many);
    let nodes: Vec<_> = (0..1000).map(|_| json!({"mesh": 0})).collect();
    let all: Vec<_> = (0..1000).collect();
    let error = refusal(&glb.with("/nodes", json!(nodes)).with("/scenes/0/nodes", json!(all)));
    assert!(error.contains("100000 rows"), "2.4 GB of positions from 1.2 MB: {error}");
}

#[test]
fn a_json_of_too_many_objects_is_refused() {
    let nodes = "{},".repeat(3_000_000);
    let text = format!(r#"{{"asset":{{"version":"2.0"}},"nodes":[{nodes}{{}}]}}"#);
    let error = read_bytes(&Glb::container(text.as_bytes(), b"")).unwrap_err().to_string();
    assert!(error.contains("braces"), "{error}");
    let text = format!(r#"{{"asset":{}"#, "[".repeat(100_000));
    assert!(read_bytes(&Glb::container(text.as_bytes(), b"")).is_err(), "deep nesting");
}

/// Braces, brackets, commas and colons of names are no structure; an escaped quote ends no name.
#[test]
fn punctuation_in_strings_is_no_structure() {
    let marks = "{[\",:]}".repeat(500_000);
    let named = sheet(&Glb::square().with("/meshes/0/name", json!(marks)));
    assert_eq!(named.name, marks);
    let text = r#"{"asset":{"version":"2.0","generator":"never closed \"#;
    assert!(read_bytes(&Glb::container(text.as_bytes(), b"")).is_err(), "a text that ends inside a string");
}

#[test]
fn buffers_come_from_the_own_folder_only() {
    let folder = tempfile::tempdir().unwrap();
    let inside = folder.path().join("inside");
    fs::create_dir_all(inside.join("sub dir")).unwrap();
    let square = Glb::square();
    for at in ["outside.bin", "inside/a b.bin", "inside/sub dir/c.bin"] {
        fs::write(folder.path().join(at), &square.bin).unwrap();
    }
    fs::write(inside.join("short.bin"), &square.bin[..8]).unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink(folder.path().join("outside.bin"), inside.join("link.bin")).unwrap();
    let path = inside.join("skin.gltf");
    let json = square.clone().with("/buffers/0/uri", json!("a b.bin")).json;
    let bytes = serde_json::to_vec(&json).unwrap();
    let error = draft_from_bytes(&path, bytes, ReadParts::default()).unwrap_err().to_string();
    assert!(error.contains("read from memory"), "they have no folder: {error}");
    let read = |uri: &str| {
        let json = square.clone().with("/buffers/0/uri", json!(uri)).json;
        fs::write(&path, serde_json::to_vec(&json).unwrap()).unwrap();
        read_draft(&path).map_err(|e| e.to_string())
    };
    for uri in ["a%20b.bin", "./a b.bin", "sub%20dir/c.bin"] {
        assert!(read(uri).is_ok(), "{uri}: {:?}", read(uri));
    }
    let absolute = folder.path().join("outside.bin").display().to_string();
    let cases = [
        ("../outside.bin", "leaves the folder"),
        ("%2e%2e/outside.bin", "leaves the folder"),
        (absolute.as_str(), "leaves the folder"),
        ("", "leaves the folder"),
        ("..\\outside.bin", "no file name"),
        ("a%00.bin", "no file name"),
        ("file:///etc/passwd", "scheme"),
        ("C:/a.bin", "scheme"),
        ("a%ff.bin", "not UTF-8"),
        ("a%2.bin", "escape"),
        ("missing.bin", "cannot read"),
        ("sub%20dir", "cannot read"),
        ("short.bin", "8 bytes of data"),
    ];
    for (uri, word) in cases {
        let error = read(uri).unwrap_err();
        assert!(error.contains(word), "{uri}: {word:?} is missing in {error}");
    }
    #[cfg(unix)]
    assert!(read("link.bin").unwrap_err().contains("link that leaves"), "a link to the outside");
}

#[test]
fn data_uris_are_decoded_and_measured() {
    use base64::{Engine as _, engine::general_purpose::STANDARD};
    let square = Glb::square();
    let data = STANDARD.encode(&square.bin);
    let read = |uri: String| {
        let json = square.clone().with("/buffers/0/uri", json!(uri)).json;
        read_bytes(&serde_json::to_vec(&json).unwrap()).map_err(|e| e.to_string())
    };
    for kind in ["application/octet-stream", "application/gltf-buffer"] {
        assert!(read(format!("data:{kind};base64,{data}")).is_ok(), "{kind}");
    }
    for uri in [
        format!("data:image/png;base64,{data}"),
        "data:".into(),
        format!("data:application/octet-stream;base64,{}", &data[..16]),
        format!("data:application/octet-stream;base64,!{}", &data[1..]),
    ] {
        assert!(read(uri.clone()).unwrap_err().contains("buffer 0"), "{uri}");
    }
    let mut none = square.clone();
    none.bin.clear();
    assert!(refusal(&none).contains("no uri and no binary chunk"));
}

#[test]
fn strips_and_fans_become_triangles() {
    let with = |mode: u32, corners: &[u16]| {
        let mut glb = Glb::square().with("/meshes/0/primitives/0/mode", json!(mode));
        let indices = glb.array(5123, "SCALAR", corners.len(), &u16s(corners));
        sheet(&glb.with("/meshes/0/primitives/0/indices", json!(indices))).triangles
    };
    assert_eq!(with(5, &[0, 1, 3, 2]), [[0, 1, 3], [3, 1, 2]], "every other one is turned");
    assert_eq!(with(5, &[0, 1, 3, 3, 2]), [[0, 1, 3]], "triangles that only turn a corner are left out");
    assert_eq!(with(6, &[0, 1, 2, 3]), [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(with(4, &[0, 1, 2, 3]), [[0, 1, 2]], "what fills no triangle is left out");
    let mut soup = Glb::square();
    soup.json["meshes"][0]["primitives"][0].as_object_mut().unwrap().remove("indices");
    assert_eq!(sheet(&soup).triangles, [[0, 1, 2]], "without indices: vertices in order");
}

#[test]
fn primitives_of_a_mesh_are_one_sheet() {
    let mut glb = Glb::square();
    let primitive = glb.json["meshes"][0]["primitives"][0].clone();
    let own = glb.array(5126, "VEC3", 4, &f32s(&[0., 0., 1., 1., 0., 1., 1., 1., 1., 0., 1., 1.]));
    glb.json["accessors"][own]["min"] = json!([0, 0, 1]);
    glb.json["accessors"][own]["max"] = json!([1, 1, 1]);
    let mut other = primitive.clone();
    other["attributes"]["POSITION"] = json!(own);
    let mut lines = other.clone();
    lines["mode"] = json!(1);
    glb.json["meshes"][0]["primitives"] = json!([primitive, other, lines, primitive]);
    let sheet = sheet(&glb);
    assert_eq!(sheet.positions.len(), 8, "vertices that two primitives share are taken once");
    assert_eq!(sheet.triangles[2..4], [[4, 5, 6], [4, 6, 7]], "corners are counted on");
    assert_eq!(sheet.triangles.len(), 6, "lines are passed over");

    let ids = glb.array(5126, "SCALAR", 4, &f32s(&[1., 2., 3., 4.]));
    let glb = glb.with("/meshes/0/primitives/1/attributes/_TAXEL_ID", json!(ids));
    assert!(refusal(&glb).contains("_TAXEL_ID"), "ids for some primitives and not for others");
}

/// Points are bare taxels, with all that is known of them, where no triangle is in the scene.
#[test]
fn a_scene_of_points_is_a_sheet_of_bare_taxels() {
    let mut glb = Glb::square();
    glb.attribute("_TAXEL_ID", 5126, "SCALAR", &f32s(&[5., 6., 7., 8.]));
    let points = glb.clone().with("/meshes/0/primitives/0/mode", json!(0));
    let all = sheet(&points);
    assert_eq!((all.positions.len(), all.triangles.len()), (4, 0));
    let some = glb.array(5123, "SCALAR", 3, &u16s(&[3, 0, 1]));
    let mut three = glb.clone().with("/meshes/0/primitives/0/mode", json!(0));
    three.json["meshes"][0]["primitives"][0]["indices"] = json!(some);
    let sheet_of_three = sheet(&three);
    assert_eq!(sheet_of_three.ids.unwrap(), [5, 6, 8].map(TaxelId), "the points that indices name");
    assert_eq!(sheet_of_three.positions[2], DVec3::Y);

    // Next to triangles, in the same mesh or in another one, points are passed over.
    let primitive = points.json["meshes"][0]["primitives"][0].clone();
    let mut both = glb.clone();
    both.json["meshes"][0]["primitives"].as_array_mut().unwrap().push(primitive.clone());
    assert_eq!(sheet(&both), sheet(&glb));
    let mut two = glb.clone().with("/nodes", json!([{"mesh": 0}, {"mesh": 1}]));
    two.json["scenes"][0]["nodes"] = json!([0, 1]);
    two.push("meshes", json!({"primitives": [primitive]}));
    assert_eq!(read_bytes(&two.bytes()).unwrap().sheets.len(), 1);

    let assembled = assemble(&read_bytes(&points.bytes()).unwrap(), &AssembleOptions::default()).unwrap();
    assert!(matches!(assembled.remarks[0].kind, RemarkKind::Triangulated { taxels: 4, triangles: 2, .. }));
}

#[test]
fn a_node_is_a_link_unless_it_only_carries_a_patch() {
    let glb = Glb::square()
        .with(
            "/nodes",
            json!([{"name": "arm", "children": [1, 2, 3]}, {"name": "pad", "mesh": 0},
            {"name": "hand", "mesh": 0, "translation": [0, 0, 1]}, {"name": "eye", "camera": 0}]),
        )
        .with("/cameras", json!([{"type": "perspective"}]));
    let draft = read_bytes(&glb.bytes()).unwrap();
    let names: Vec<_> = draft.links.iter().map(|l| l.name.as_str()).collect();
    assert_eq!(names, ["arm", "hand"], "the pad is a patch of the arm; a camera is no link");
    let [pad, hand] = draft.sheets.as_slice() else { panic!("two sheets") };
    assert_eq!((pad.name.as_str(), pad.link), ("pad", Some(LinkId::new(0))));
    assert_eq!((hand.name.as_str(), hand.link), ("patch", Some(LinkId::new(1))));
    assert_eq!(draft.links[LinkId::new(1)].parent, Some(LinkId::new(0)));
}

#[test]
fn scale_goes_into_the_positions_and_a_mirror_turns_the_winding() {
    let square = |node| {
        let mut glb = Glb::square().with("/nodes/0", node);
        glb.attribute("NORMAL", 5126, "VEC3", &f32s(&[0., 0., 1., 0., 0., 1., 0., 0., 1., 0., 0., 1.]));
        let draft = read_bytes(&glb.bytes()).unwrap();
        let pose = draft.links[LinkId::new(0)].pose;
        let orthonormal = pose.matrix3.transpose() * pose.matrix3;
        assert!(orthonormal.abs_diff_eq(glam::DMat3::IDENTITY, 1e-12), "a link's pose is rigid");
        assert!(pose.matrix3.determinant() > 0.0, "and no mirror");
        (pose, draft.sheets[0].clone())
    };
    // Millimetres, turned by a right angle about z.
    let turn = [0.0, 0.0, 0.5_f64.sqrt(), 0.5_f64.sqrt()];
    let node = json!({"mesh": 0, "scale": [0.001, 0.001, 0.001], "rotation": turn, "translation": [1, 0, 0]});
    let (pose, sheet) = square(node);
    assert!(sheet.positions[1].abs_diff_eq(DVec3::X * 1e-3, 1e-12), "{}", sheet.positions[1]);
    assert!(pose.transform_point3(sheet.positions[1]).abs_diff_eq(DVec3::new(1.0, 0.001, 0.0), 1e-12));

    // The same as a matrix, and mirrored at x = 0.
    let node = json!({"mesh": 0, "matrix": [0, -2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 5, 0, 0, 1]});
    let (pose, sheet) = square(node);
    let world: Vec<DVec3> = sheet.positions.iter().map(|&p| pose.transform_point3(p)).collect();
    assert!(world[1].abs_diff_eq(DVec3::new(5.0, -2.0, 0.0), 1e-12), "{}", world[1]);
    assert!(world[3].abs_diff_eq(DVec3::new(3.0, 0.0, 0.0), 1e-12), "{}", world[3]);
    let [a, b, c] = sheet.triangles[0].map(|v| world[v as usize]);
    let normal = pose.transform_vector3(sheet.normals.unwrap()[0]);
    assert!((b - a).cross(c - a).dot(normal) > 0.0, "counter-clockwise seen from the normal's side");
    assert!(normal.abs_diff_eq(DVec3::Z, 1e-12), "{normal}");

    // A scaled parent scales and shears what hangs below.
    let glb = Glb::square().with(
        "/nodes",
        json!([{"scale": [2, 1, 1], "children": [1]}, {"mesh": 0, "rotation": turn, "translation": [1, 0, 0]}]),
    );
    let draft = read_bytes(&glb.bytes()).unwrap();
    let sheet = &draft.sheets[0];
    let pose = dermatome::skin::world_pose(&draft.links, sheet.link.unwrap());
    let corner = pose.transform_point3(sheet.positions[3]);
    assert!(corner.abs_diff_eq(DVec3::ZERO, 1e-12), "(0, 1) turns to (-1, 0), moves to (0, 0): {corner}");
    let corner = pose.transform_point3(sheet.positions[1]);
    assert!(corner.abs_diff_eq(DVec3::new(2.0, 1.0, 0.0), 1e-12), "{corner}");
}

#[test]
fn extensions_that_hide_geometry_are_refused() {
    let require = |name: &str| {
        Glb::square().with("/extensionsUsed", json!([name])).with("/extensionsRequired", json!([name]))
    };
    for name in ["KHR_draco_mesh_compression", "EXT_meshopt_compression"] {
        let error = refusal(&require(name));
        assert!(error.contains(name) && error.contains("Unsupported"), "{error}");
    }
    assert!(refusal(&require("EXT_secret")).contains("EXT_secret"));
    assert_eq!(sheet(&require("KHR_materials_unlit")).triangles.len(), 2, "looks do not matter");
    let mut hidden = Glb::square().with("/extensionsUsed", json!(["KHR_draco_mesh_compression"])).with(
        "/meshes/0/primitives/0/extensions",
        json!({"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}),
    );
    assert_eq!(sheet(&hidden).triangles.len(), 2, "with an uncompressed copy beside it");
    hidden.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert!(refusal(&hidden).contains("Unsupported"), "without one");
}

#[test]
fn a_file_cut_anywhere_is_refused() {
    for name in ["skin.glb", "skin.gltf"] {
        let whole = skin_to_bytes(Path::new(name), &robot()).unwrap();
        for length in (0..whole.len() - 1).step_by(64) {
            let cut = whole[..length].to_vec();
            assert!(read_map_bytes(&cut).is_err(), "{name} cut at {length}");
            assert!(
                draft_from_bytes(Path::new(name), cut, ReadParts::default()).is_err(),
                "{name}: {length}"
            );
        }
    }
}

#[test]
fn broken_headers_are_refused() {
    let bytes = Glb::square().bytes();
    let with = |at: usize, word: u32| {
        let mut bytes = bytes.clone();
        bytes[at..at + 4].copy_from_slice(&word.to_le_bytes());
        read_bytes(&bytes).unwrap_err().to_string()
    };
    assert!(with(4, 1).contains("version 1"));
    assert!(with(8, u32::MAX).contains("length 4294967295"));
    assert!(with(12, u32::MAX - 3).contains("GLB chunk 0"));
    assert!(with(16, 7).contains("GLB chunk 0"));
    let mut tail = bytes.clone();
    tail.extend([0; 4]);
    assert_eq!(read_bytes(&tail).unwrap().remarks.len(), 1, "bytes after the end");
    assert!(read_bytes(&Glb::container(b"", b"")).is_err(), "an empty chunk");
    assert!(read_bytes(&Glb::container(b"\xEF\xBB\xBF{}", b"")).is_err(), "a byte order mark");
    assert!(read_bytes(&Glb::container(b"\xFF\xFE", b"")).is_err(), "no UTF-8");
}

/// One that f32 would turn over, though the map does not.
#[test]
fn a_needle_that_rounding_turns_over_is_written_upright() {
    let mut map = map();
    let level = &mut map.patches[PatchId::new(0)].levels[dermatome::pyramid::LevelId::new(1)];
    let [a, b, c] = level.places(dermatome::id::FaceId::new(0));
    level.uv[c] = level.uv[a] + (level.uv[b] - level.uv[a]).perp() * 1e-13;
    let read = read_map_bytes(&map_to_bytes(&map).unwrap()).unwrap();
    let uv = &read.patches[PatchId::new(0)].levels[dermatome::pyramid::LevelId::new(1)].uv;
    assert!((uv[b] - uv[a]).perp_dot(uv[c] - uv[a]) > 0.0, "{} {} {}", uv[a], uv[b], uv[c]);
}

/// What the writer cannot tell a reader, it says instead of writing it.
#[test]
fn unwritable_skins_and_maps_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("skin.glb");
    let check = |skin: Skin, word: &str| {
        let error = write_skin(&path, &skin).unwrap_err().to_string();
        assert!(error.contains(word), "{word:?} is missing in {error}");
        assert!(!path.exists(), "no half file");
    };
    check(Skin::default(), "no patch");
    let mut skin = robot();
    skin.links[LinkId::new(1)].pose.matrix3 *= 2.0;
    check(skin, "link 1");
    let mut skin = robot();
    skin.patches[PatchId::new(1)].mesh.positions[VertexId::new(2)] = DVec3::splat(1e300);
    check(skin, "vertex 2");
    let mut skin = robot();
    skin.patches[PatchId::new(0)].taxels.areas[VertexId::new(7)] = 1e-300;
    check(skin, "vertex 7");

    let write = |change: &dyn Fn(&mut SkinMap), words: &[&str]| {
        let mut map = map();
        change(&mut map);
        let error = write_map(&path, &map).unwrap_err().to_string();
        for word in words {
            assert!(error.contains(word), "{word:?} is missing in {error}");
        }
    };
    fn palm(map: &mut SkinMap) -> &mut dermatome::map::MapLevel {
        &mut map.patches[PatchId::new(0)].levels[dermatome::pyramid::LevelId::new(1)]
    }
    write(&|map| palm(map).uv[PlaceId::new(0)] += 10.0, &["palm/L1", "vertex 0"]);
    write(&|map| palm(map).level.to_finest = None, &["palm/L1", "to_finest has 0"]);
    write(
        &|map| palm(map).level.to_finest.as_mut().unwrap().weights[VertexId::new(3)] = [2.0, -1.0, 0.0],
        &["palm/L1", "to_finest", "row 3"],
    );
    // A map so small in its image that f32 cannot tell its corners apart.
    write(
        &|map| {
            let level = &mut map.patches[PatchId::new(0)].levels[dermatome::pyramid::LevelId::new(0)];
            let middle = level.uv[PlaceId::new(0)];
            level.uv.iter_mut().for_each(|p| *p = middle + (*p - middle) * 1e-12);
        },
        &["palm/L0", "face", "map area"],
    );
}

/// A small map, as a file.
fn map_file() -> Vec<u8> {
    map_to_bytes(&map()).unwrap()
}

fn read_map_bytes(bytes: &[u8]) -> Result<SkinMap, IoError> {
    map_from_bytes(bytes.into())
}

/// What is not known of taxels is left out of a file.
#[test]
fn a_map_reads_the_same_but_for_what_it_does_not_say() {
    let map = read_map_bytes(&map_file()).unwrap();
    let mut glb = Glb::parse(&map_file());
    for mesh in glb.json["meshes"].as_array_mut().unwrap() {
        let attributes = mesh["primitives"][0]["attributes"].as_object_mut().unwrap();
        attributes.retain(|name, _| !["_PRESENT", "_DENSITY", "TANGENT"].contains(&name.as_str()));
    }
    let mut bare = read_map_bytes(&glb.bytes()).unwrap();
    for (bare, patch) in bare.patches.iter_mut().zip(&map.patches) {
        assert!(bare.taxels.presence.iter().all(|&p| p == Presence::Present));
        assert_eq!(bare.taxels.tangents, None);
        bare.taxels.tangents = patch.taxels.tangents.clone();
        bare.taxels.presence = patch.taxels.presence.clone();
        bare.taxels.densities = patch.taxels.densities.clone();
    }
    assert_eq!(bare, map);
}

#[test]
fn broken_maps_are_refused() {
    let glb = Glb::parse(&map_file());
    let extras = |mesh: usize, key: &str| format!("/meshes/{mesh}/extras/dermatome/{key}");
    let level = |k: u64| {
        let of = |mesh: &serde_json::Value| mesh["extras"]["dermatome"].clone();
        let all = glb.json["meshes"].as_array().unwrap();
        all.iter().position(|m| of(m)["patch"] == "palm" && of(m)["level"] == k).unwrap()
    };
    let (finest, next) = (level(0), level(1));
    let mut along = glb.clone();
    let count = map().patches[PatchId::new(0)].taxels.ids.len();
    let rows = along.array(5126, "VEC4", count, &f32s(&[0., 0., 1., 1.].repeat(count)));
    along.json["meshes"][finest]["primitives"][0]["attributes"]["TANGENT"] = json!(rows);
    let error = read_map_bytes(&along.bytes()).unwrap_err().to_string();
    assert!(error.contains("palm") && error.contains("the tangent of vertex"), "{error}");
    // Two vertices of level 1 that changed their places.
    let mut swapped = glb.clone();
    let position = swapped.json["meshes"][next]["primitives"][0]["attributes"]["POSITION"].as_u64().unwrap();
    let view = &swapped.json["accessors"][usize::try_from(position).unwrap()]["bufferView"];
    let start = &swapped.json["bufferViews"][usize::try_from(view.as_u64().unwrap()).unwrap()]["byteOffset"];
    let start = usize::try_from(start.as_u64().unwrap_or(0)).unwrap();
    swapped.bin[start..start + 24].rotate_left(12);
    let error = read_map_bytes(&swapped.bytes()).unwrap_err().to_string();
    assert!(error.contains("palm/L1 origins") && error.contains("vertex 0"), "{error}");
    let count = glb.json["accessors"].as_array().unwrap().len();
    let up = glb.json.pointer(&extras(finest, "up")).unwrap().clone();
    let cases: &[(String, serde_json::Value, &[&str])] = &[
        (extras(next, "level"), json!(2), &["palm", "each level once"]),
        (extras(next, "level"), json!(-1), &["extras.dermatome", "-1"]),
        (extras(next, "up"), up.clone(), &["palm/L1", "from_coarser", "0 are needed"]),
        (extras(next, "direct"), json!(null), &["palm/L1", "to_finest has 0"]),
        (extras(finest, "up/indices"), json!(count), &["palm/L0 up", "accessor"]),
        (extras(finest, "up/weights"), up["indices"].clone(), &["palm/L0", "from_coarser", "weights"]),
        (extras(next, "origins"), up["indices"].clone(), &["VEC3"]),
        (extras(next, "origins"), json!(null), &["palm/L1 origins"]),
        (extras(finest, "map/size"), json!([0, 1]), &["palm/L0", "frame"]),
        ("/scenes/0/nodes".into(), json!([0]), &["node"]),
    ];
    for (pointer, value, words) in cases {
        let error = match read_map_bytes(&glb.clone().with(pointer, value.clone()).bytes()) {
            Ok(_) => panic!("{pointer} = {value} was read"),
            Err(e) => e.to_string(),
        };
        for word in *words {
            assert!(error.contains(word), "{pointer} = {value}: {word:?} is missing in {error}");
        }
    }
}

/// What another program broke is blamed on it, by its name; what it kept whole is read.
#[test]
fn rewritten_maps_are_refused_by_the_name_of_the_program() {
    let glb = Glb::parse(&map_file()).with("/asset/generator", json!("mesher 3.1"));
    assert_eq!(read_map_bytes(&glb.bytes()).unwrap(), read_map_bytes(&map_file()).unwrap());
    for (pointer, value) in [
        // An accessor of another type, as where arrays were put in another order.
        ("/meshes/0/extras/dermatome/up/indices", json!(0)),
        ("/meshes/0/extras/dermatome/map/size", json!([0, 1])),
    ] {
        let broken = glb.clone().with(pointer, value);
        let error = read_map_bytes(&broken.bytes()).unwrap_err();
        assert!(matches!(error, IoError::Rewritten { .. }), "{error}");
        assert!(error.to_string().contains("mesher 3.1"), "{error}");
        let ours = broken.with("/asset/generator", json!("dermatome 0.1.0"));
        assert!(!matches!(read_map_bytes(&ours.bytes()).unwrap_err(), IoError::Rewritten { .. }));
    }
}

/// Whether a file draws points, which are taxels without triangles.
fn draws_points(path: &Path) -> bool {
    let document: serde_json::Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap_or_default();
    let meshes = document["meshes"].as_array().into_iter().flatten();
    meshes.flat_map(|mesh| mesh["primitives"].as_array().into_iter().flatten()).any(|p| p["mode"] == 0)
}

/// The validator's own files: valid ones load or name what is missing; no file loads without triangles
/// or points.
#[test]
fn khronos_validator_files_are_read_or_refused() {
    let Some(root) = data("gltf-validator") else { return };
    let mut folders = vec![root];
    let mut wrong = Vec::new();
    while let Some(folder) = folders.pop() {
        for path in fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()) {
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            if !path.extension().is_some_and(|e| e == "gltf" || e == "glb") {
                continue;
            }
            let name = path.display().to_string();
            let report = fs::read(format!("{name}.report.json")).unwrap();
            let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
            let errors = report["issues"]["numErrors"].as_u64().unwrap();
            let triangles = report["info"]["totalTriangleCount"].as_u64().unwrap_or(0);
            let _ = read_map(&path);
            match read_draft(&path) {
                Ok(_) if triangles == 0 && !draws_points(&path) => {
                    wrong.push(format!("{name}: loaded without triangles"))
                }
                Ok(_) | Err(IoError::Unsupported { .. }) => {}
                Err(_) if errors > 0 || triangles == 0 => {}
                Err(e) => wrong.push(format!("{name} is valid, but: {e}")),
            }
        }
    }
    assert!(wrong.is_empty(), "{} surprises:\n{}", wrong.len(), wrong.join("\n"));
}

/// The weights of a node come before those of its mesh: a morph target that has an effect is refused, one that has none is not.
#[test]
fn morph_targets_have_the_weights_of_the_node() {
    let name = Path::new("skin.gltf");
    let bytes = skin_to_bytes(name, &Skin::from_mesh("m", shapes::lattice(3, 3, 0.01))).unwrap();
    let json: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
    for (of_mesh, of_node, is_read) in
        [(0.0, None, true), (0.5, None, false), (0.0, Some(0.5), false), (0.5, Some(0.0), true)]
    {
        let mut morphed = json.clone();
        let mesh = &mut morphed["meshes"][0];
        let position = mesh["primitives"][0]["attributes"]["POSITION"].clone();
        mesh["primitives"][0]["targets"] = json!([{ "POSITION": position }]);
        mesh["weights"] = json!([of_mesh]);
        let nodes = morphed["nodes"].as_array_mut().unwrap();
        let node = nodes.iter_mut().find(|node| node.get("mesh").is_some()).unwrap();
        if let Some(weight) = of_node {
            node["weights"] = json!([weight]);
        }
        let draft = draft_from_bytes(name, serde_json::to_vec(&morphed).unwrap(), ReadParts::default());
        assert_eq!(draft.is_ok(), is_read, "{of_mesh}, {of_node:?}: {draft:?}");
    }
}
