//! Files of every kind but glTF and EXR: what is written reads back, what is broken is refused by
//! name, and nothing that a file says makes the readers panic.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use crate::common::{data, listing};
use dermatome::id::{IdVec, VertexId};
use dermatome::io::{
    IoError, ReadParts, draft_from_bytes, read_draft, replace_file, skin_to_bytes, write_flat, write_skin,
};
use dermatome::mesh::{TriMesh, shapes};
use dermatome::skin::{
    AssembleOptions, Covariance, Draft, Link, LinkId, Patch, PatchId, Presence, Sheet, Skin, TaxelId,
    assemble, world_pose,
};
use glam::{DAffine3, DMat3, DVec2, DVec3};
use proptest::prelude::*;
use tempfile::TempDir;

const KINDS: [&str; 5] = ["json", "obj", "ply", "stl", "csv"];

/// A skin on one link that is turned and shifted, with everything that a patch can have.
fn posed_skin() -> Skin {
    let mut skin = Skin::from_mesh("cap, \"bottom\"", shapes::cap(20, 0.1, 0.6));
    let link = LinkId::new(0);
    skin.links[link].name = "upper_arm".into();
    skin.links[link].pose = DAffine3::from_rotation_translation(
        glam::DQuat::from_rotation_y(0.3) * glam::DQuat::from_rotation_z(1.1),
        DVec3::new(0.1, -0.2, 1.0 / 3.0),
    );
    let patch = &mut skin.patches[PatchId::new(0)];
    patch.taxels.densities = Some(patch.taxels.areas.map(|a| 1.0 / a));
    patch.taxels.ids[VertexId::new(1)] = TaxelId(u32::MAX);
    patch.taxels.ids[VertexId::new(2)] = patch.taxels.ids[VertexId::new(3)];
    patch.taxels.presence[VertexId::new(4)] = Presence::Absent;
    patch.taxels.presence[VertexId::new(5)] = Presence::ThermalPad;
    skin
}

/// Two links in a chain, two patches on the first and one on the second.
fn robot() -> Skin {
    let mut skin = posed_skin();
    let hand = skin.links.push(Link {
        name: "hand".into(),
        parent: Some(LinkId::new(0)),
        pose: DAffine3::from_translation(DVec3::new(0.0, 0.5, 0.0)),
    });
    let mut tube = Patch::from_mesh("tube", LinkId::new(0), shapes::tube(5, 3, 0.05, 0.1));
    tube.taxels.densities = Some(vec![7.5; tube.taxels.areas.len()].into());
    skin.patches.push(tube);
    skin.patches.push(Patch::from_mesh("palm", hand, shapes::lattice(3, 3, 0.01)));
    skin
}

/// A skin on one link at the origin, like the meshes of formats without frames.
fn plain_skin() -> Skin {
    Skin::from_mesh("plain", shapes::lattice(4, 3, 0.01))
}

fn write_and_read(folder: &TempDir, kind: &str, skin: &Skin) -> Draft {
    let path = folder.path().join(format!("skin.{kind}"));
    write_skin(&path, skin).unwrap();
    read_draft(&path).unwrap()
}

fn triangles(patch: &Patch) -> Vec<[u32; 3]> {
    patch.mesh.triangles.iter().map(|t| t.map(VertexId::raw)).collect()
}

fn positions(patch: &Patch, pose: DAffine3) -> Vec<DVec3> {
    patch.mesh.positions.iter().map(|&p| pose.transform_point3(p)).collect()
}

/// What every reader promises: finite numbers, corners that exist, arrays of one length.
fn assert_sound(draft: &Draft) {
    for sheet in &draft.sheets {
        let count = sheet.positions.len();
        assert!(sheet.positions.iter().all(|p| p.is_finite()), "finite positions");
        assert!(sheet.triangles.iter().flatten().all(|&v| (v as usize) < count), "corners exist");
        assert!(sheet.normals.iter().flatten().all(|n| n.is_finite()), "finite normals");
        assert!(sheet.areas.iter().chain(&sheet.densities).flatten().all(|x| x.is_finite()), "finite areas");
        let lengths = [
            sheet.ids.as_ref().map(Vec::len),
            sheet.normals.as_ref().map(Vec::len),
            sheet.areas.as_ref().map(Vec::len),
            sheet.densities.as_ref().map(Vec::len),
            sheet.presence.as_ref().map(Vec::len),
        ];
        assert!(lengths.into_iter().flatten().all(|n| n == count), "one entry per vertex");
        assert!(sheet.link.is_none_or(|link| link.index() < draft.links.len()), "the link exists");
    }
}

#[test]
fn every_format_keeps_positions_and_triangles() {
    let folder = TempDir::new().unwrap();
    let skin = plain_skin();
    let patch = &skin.patches[PatchId::new(0)];
    for kind in KINDS.into_iter().filter(|&k| k != "stl") {
        let draft = write_and_read(&folder, kind, &skin);
        assert_sound(&draft);
        let [sheet] = draft.sheets.as_slice() else { panic!("{kind}: one sheet") };
        assert_eq!(sheet.positions, positions(patch, DAffine3::IDENTITY), "{kind}: to the last bit");
        assert_eq!(sheet.triangles, triangles(patch), "{kind}");
        assert_eq!(sheet.normals.as_deref(), Some(patch.taxels.normals.as_slice()), "{kind}: normals");
    }
}

#[test]
fn json_keeps_the_frame_of_its_link() {
    let folder = TempDir::new().unwrap();
    let skin = posed_skin();
    let patch = &skin.patches[PatchId::new(0)];
    let draft = write_and_read(&folder, "json", &skin);
    assert_eq!(draft.links, skin.links, "name and pose to the last bit");
    let sheet = Sheet {
        name: patch.name.clone(),
        link: Some(LinkId::new(0)),
        positions: positions(patch, DAffine3::IDENTITY),
        triangles: triangles(patch),
        ids: Some(patch.taxels.ids.as_slice().to_vec()),
        normals: Some(patch.taxels.normals.as_slice().to_vec()),
        presence: Some(patch.taxels.presence.as_slice().to_vec()),
        ..Sheet::default()
    };
    assert_eq!(draft.sheets, [sheet], "all but areas and densities");
}

#[test]
fn json_of_several_links_is_in_the_world() {
    let folder = TempDir::new().unwrap();
    let skin = robot();
    let draft = write_and_read(&folder, "json", &skin);
    let all: Vec<DVec3> =
        skin.patches.iter().flat_map(|p| positions(p, world_pose(&skin.links, p.link))).collect();
    assert_eq!(draft.sheets[0].positions, all);
    assert_eq!(draft.sheets[0].name, "skin", "several patches are called after the file");
    assert_eq!(draft.links[LinkId::new(0)].pose, DAffine3::IDENTITY);
}

#[test]
fn tables_keep_patches_ids_and_link_names() {
    let folder = TempDir::new().unwrap();
    let skin = robot();
    let draft = write_and_read(&folder, "csv", &skin);
    assert_sound(&draft);
    assert_eq!(draft.sheets.len(), 3, "one sheet per patch");
    for (sheet, patch) in draft.sheets.iter().zip(&skin.patches) {
        let pose = world_pose(&skin.links, patch.link);
        assert_eq!(sheet.name, patch.name);
        assert_eq!(sheet.positions, positions(patch, pose), "{}: in the world", patch.name);
        assert_eq!(sheet.triangles, triangles(patch), "{}", patch.name);
        assert_eq!(sheet.ids.as_deref(), Some(patch.taxels.ids.as_slice()), "{}", patch.name);
        assert_eq!(sheet.areas.as_deref(), Some(patch.taxels.areas.as_slice()), "{}", patch.name);
        assert_eq!(sheet.presence.as_deref(), Some(patch.taxels.presence.as_slice()), "{}", patch.name);
        assert_eq!(
            sheet.densities,
            patch.taxels.densities.as_ref().map(|d| d.as_slice().to_vec()),
            "{}",
            patch.name
        );
        let link = &draft.links[sheet.link.unwrap()];
        assert_eq!(link.name, skin.links[patch.link].name);
        assert_eq!(link.pose, DAffine3::IDENTITY, "the table knows no frames");
    }
}

/// A covariance is turned from both sides.
#[test]
fn tables_keep_covariances_in_the_world() {
    let folder = TempDir::new().unwrap();
    let mut skin = robot();
    let told = DMat3::from_diagonal(DVec3::new(1e-6, 4e-6, 9e-6));
    for patch in skin.patches.iter_mut() {
        let mut covariances =
            patch.taxels.ids.map(|_| Some(Covariance::from([1e-6, 0.0, 0.0, 4e-6, 0.0, 9e-6])));
        // One that is exact and one that is not known.
        (covariances[VertexId::new(1)], covariances[VertexId::new(2)]) = (Some(Covariance::default()), None);
        patch.taxels.covariances = Some(covariances);
    }
    let draft = write_and_read(&folder, "csv", &skin);
    for (sheet, patch) in draft.sheets.iter().zip(&skin.patches) {
        let matrix = world_pose(&skin.links, patch.link).matrix3;
        let expected = matrix * told * matrix.transpose();
        let covariances = sheet.covariances.as_ref().unwrap();
        assert_eq!(covariances[1..3], [Some(Covariance::default()), None], "{}", patch.name);
        let [xx, xy, xz, yy, yz, zz] = covariances[0].unwrap().into();
        let found = DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]);
        assert!(found.abs_diff_eq(expected, 1e-18), "{}: {found} is not {expected}", patch.name);
    }
}

/// Tangents are kept by the quaternion of a taxel's frame, turned into the world; a patch without
/// them has empty cells. Even where all frames are the identity, since the normals say so too.
#[test]
fn tables_keep_tangents_in_the_world() {
    let folder = TempDir::new().unwrap();
    let mut skin = robot();
    let flat = skin.links.push(Link { name: "base".into(), parent: None, pose: DAffine3::IDENTITY });
    let mut upright = Patch::from_mesh("upright", flat, shapes::lattice(3, 3, 0.01));
    upright.taxels.tangents = Some(upright.taxels.ids.map(|_| DVec3::X));
    skin.patches.push(upright);
    for patch in skin.patches.iter_mut().take(2) {
        patch.taxels.tangents = Some(patch.taxels.normals.map(|n| n.any_orthonormal_vector()));
    }
    let draft = write_and_read(&folder, "csv", &skin);
    for (sheet, patch) in draft.sheets.iter().zip(&skin.patches) {
        let pose = world_pose(&skin.links, patch.link);
        assert_eq!(sheet.tangents.is_some(), patch.taxels.tangents.is_some(), "{}", patch.name);
        for (got, &want) in sheet.tangents.iter().flatten().zip(patch.taxels.tangents.iter().flatten()) {
            assert!(got.abs_diff_eq(pose.transform_vector3(want), 1e-14), "{}: {got}", patch.name);
        }
    }
    let assembled = assemble(&draft, &AssembleOptions::default()).unwrap();
    assert_eq!(assembled.skin.validate(), Ok(()));
}

/// Of a calibrated table the rotation is read whole, unless it is a placeholder.
#[test]
fn rotations_of_tables_are_frames() {
    let read = |header: &str, cells: &str| {
        let row = |id: u32, at: &str| format!("{id},{at},{cells}\n");
        let rows = row(1, "0,0,0") + &row(2, "1,0,0") + &row(3, "0,1,0");
        read_tables(&format!("id,x,y,z,{header}\n{rows}"), "row0,row1,row2\n0,1,2\n")
            .map(|mut d| d.sheets.remove(0))
    };
    let near = |got: &Option<Vec<DVec3>>, want: DVec3| got.as_ref().unwrap()[2].abs_diff_eq(want, 1e-15);
    let sheet = read("qx,qy,qz,qw", "0,0,0.6,0.8").unwrap();
    assert!(near(&sheet.normals, DVec3::Z) && near(&sheet.tangents, DVec3::new(0.28, 0.96, 0.0)));
    let sheet = read("qx,qy,qz,qw", "0,0,0,1").unwrap();
    assert_eq!((sheet.normals, sheet.tangents), (None, None), "a calibration of positions");
    let sheet = read("nx,ny,nz,qx,qy,qz,qw", "0,0.6,0.8,0,0,0,1").unwrap();
    assert!(near(&sheet.normals, DVec3::new(0.0, 0.6, 0.8)) && sheet.tangents.is_none());
    let sheet = read("nx,ny,nz,qx,qy,qz,qw", "0,0,1,0,0,0,1").unwrap();
    assert!(near(&sheet.normals, DVec3::Z) && near(&sheet.tangents, DVec3::X), "both say the same");
    let error = read("nx,ny,nz,qx,qy,qz,qw", "0,0,1,0,0,0,2").unwrap_err().to_string();
    assert!(error.contains("unit quaternion"), "{error}");
}

#[test]
fn ply_keeps_all_numbers_of_a_vertex() {
    let folder = TempDir::new().unwrap();
    let mut skin = posed_skin();
    skin.links[LinkId::new(0)].pose = DAffine3::IDENTITY;
    let patch = &skin.patches[PatchId::new(0)];
    let draft = write_and_read(&folder, "ply", &skin);
    let sheet = Sheet {
        name: "skin".into(),
        link: None,
        positions: positions(patch, DAffine3::IDENTITY),
        triangles: triangles(patch),
        ids: Some(patch.taxels.ids.as_slice().to_vec()),
        normals: Some(patch.taxels.normals.as_slice().to_vec()),
        areas: Some(patch.taxels.areas.as_slice().to_vec()),
        densities: patch.taxels.densities.as_ref().map(|d| d.as_slice().to_vec()),
        presence: Some(patch.taxels.presence.as_slice().to_vec()),
        ..Sheet::default()
    };
    assert_eq!(draft.sheets, [sheet]);
}

#[test]
fn obj_has_an_object_per_patch() {
    let folder = TempDir::new().unwrap();
    let skin = robot();
    let draft = write_and_read(&folder, "obj", &skin);
    for (sheet, patch) in draft.sheets.iter().zip(&skin.patches) {
        assert_eq!(sheet.name, patch.name);
        assert_eq!(sheet.triangles, triangles(patch), "{}: counted within the sheet", patch.name);
        assert_eq!(sheet.positions, positions(patch, world_pose(&skin.links, patch.link)), "{}", patch.name);
    }
}

/// STL shares no corners and rounds to `f32`, so corners are joined by place and the triangles are
/// what is kept.
#[test]
fn stl_keeps_triangles_in_single_precision() {
    let folder = TempDir::new().unwrap();
    let skin = plain_skin();
    let patch = &skin.patches[PatchId::new(0)];
    let draft = write_and_read(&folder, "stl", &skin);
    let sheet = &draft.sheets[0];
    assert_eq!(sheet.positions.len(), patch.mesh.positions.len(), "joined again");
    for (found, face) in sheet.triangles.iter().zip(patch.mesh.triangles.ids()) {
        for (&v, wanted) in found.iter().zip(patch.mesh.corners(face)) {
            let rounded = wanted.as_vec3().as_dvec3();
            assert_eq!(sheet.positions[v as usize], rounded, "{face}: widened exactly");
        }
    }
}

/// Links are frames: no format writes a skin whose links change lengths.
#[test]
fn a_pose_that_scales_or_mirrors_is_refused() {
    let folder = TempDir::new().unwrap();
    for scale in [2.0, -1.0] {
        let mut skin = plain_skin();
        skin.links[LinkId::new(0)].pose = DAffine3::from_scale(DVec3::new(scale, 1.0, 1.0));
        for kind in KINDS {
            let path = folder.path().join(format!("skin.{kind}"));
            let error = write_skin(&path, &skin).unwrap_err().to_string();
            assert!(error.contains("link 0") && error.contains("rigid"), "{kind}: {error}");
        }
    }
}

/// Bytes of memory are those of a file.
#[test]
fn the_same_skin_gives_the_same_bytes() {
    let folder = TempDir::new().unwrap();
    for kind in ["glb", "gltf", "json", "obj", "off", "ply", "stl"] {
        let path = folder.path().join(format!("skin.{kind}"));
        write_skin(&path, &robot()).unwrap();
        let bytes = skin_to_bytes(&path, &robot()).unwrap();
        assert_eq!(fs::read(&path).unwrap(), bytes, "{kind}");
        let draft = draft_from_bytes(&path, bytes, ReadParts::default()).unwrap();
        assert_eq!(draft, read_draft(&path).unwrap(), "{kind}");
    }
    let error = skin_to_bytes(Path::new("skin.csv"), &robot()).unwrap_err();
    assert!(matches!(error, IoError::UnknownKind { .. }), "a skin as tables is two files: {error}");
}

#[test]
fn obj_reads_polygons_groups_and_backward_indices() {
    let draft = read_text(
        "obj",
        "# a quad with two normals, a triangle that counts backwards, a point that nothing uses\n\
         v 0 0 0\nv 1 0 0 1.0\nv 1 1 0 0.5 0.5 0.5\nv 0 1 0\nvn 0 0 1\nvn 0 1 0\nvt 0 0\n\
         g quad\nf 1/1/1 2//1 \\\n3//1 4//2\ng\no other\nv 5 5 5\nv 2 0 0\nf -1 -5 -4\n",
    )
    .unwrap();
    let [quad, other] = draft.sheets.as_slice() else { panic!("two sheets: {draft:?}") };
    assert_eq!((quad.name.as_str(), other.name.as_str()), ("quad", "other"));
    assert_eq!(quad.triangles, [[0, 1, 2], [0, 2, 3]], "a fan");
    assert_eq!(quad.normals.as_ref().unwrap()[3], DVec3::Y, "of its only corner");
    assert_eq!(other.positions, [DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::splat(5.0), 2.0 * DVec3::X]);
    assert_eq!(other.triangles, [[3, 0, 1]]);
    assert_eq!(other.normals, None, "corners without normals");
}

#[test]
fn ply_reads_text_and_big_endian() {
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment x\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
             property int id\nelement edge 1\nproperty int a\nelement face 1\n\
             property list uchar int vertex_index\nend_header\n"
        )
    };
    let text = header("ascii") + "0 0 0 -1\n1 0 0 5\n1 1 0 6\n0 1 0 7\n3\n4 0 1 2 3\n";
    let mut binary = header("binary_big_endian").into_bytes();
    for (x, y, id) in [(0.0f32, 0.0f32, -1i32), (1.0, 0.0, 5), (1.0, 1.0, 6), (0.0, 1.0, 7)] {
        for x in [x, y, 0.0] {
            binary.extend(x.to_be_bytes());
        }
        binary.extend(id.to_be_bytes());
    }
    binary.extend(3i32.to_be_bytes());
    binary.push(4);
    binary.extend((0..4i32).flat_map(i32::to_be_bytes));
    let shouted = text.replacen("ply", "PLY", 1);
    for bytes in [text.into_bytes(), shouted.into_bytes(), binary] {
        let sheet = &read_bytes("ply", &bytes).unwrap().sheets[0];
        assert_eq!(sheet.positions, [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y]);
        assert_eq!(sheet.triangles, [[0, 1, 2], [0, 2, 3]]);
        let ids = [u32::MAX, 5, 6, 7].map(TaxelId);
        assert_eq!(sheet.ids.as_deref(), Some(&ids[..]), "a negative id is a placeholder");
    }
}

#[test]
fn stl_reads_several_solids() {
    let facet =
        "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 -0.0\nendloop\nendfacet\n";
    let text =
        format!("solid left hand\n{facet}\nendsolid left hand\nSOLID\n{}ENDSOLID\n", facet.to_uppercase());
    let draft = read_text("stl", &text).unwrap();
    let names: Vec<&str> = draft.sheets.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names, ["left hand", "file"], "without a name the file's");
    assert_eq!(draft.sheets[1].triangles, [[0, 1, 2]]);
}

/// Exporters write `solid` into the comment of binary files, too.
#[test]
fn binary_stl_with_a_comment_that_says_solid_is_binary() {
    let mut bytes = skin_to_bytes(Path::new("skin.stl"), &plain_skin()).unwrap();
    bytes[..12].copy_from_slice(b"solid skin\n ");
    assert_eq!(read_bytes("stl", &bytes).unwrap().sheets[0].triangles.len(), 12);
}

/// Colours, texture coordinates, bytes after the triangles and unusual ends of lines and files stop nothing.
#[test]
fn what_is_not_read_stops_nothing() {
    let facet =
        "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
    let text = format!("solid a\n{facet}endsolid a\n");
    let mut binary = skin_to_bytes(Path::new("skin.stl"), &plain_skin()).unwrap();
    binary[..5].copy_from_slice(b"solid");
    binary.extend([7; 3]);
    let deep = "<node>".repeat(300) + "<instance_geometry url='#g'/>" + &"</node>".repeat(300);
    let dae = format!(
        "<COLLADA><asset><unit meter='0,010'/></asset><library_geometries><geometry id='g'><mesh>\
         <source id='s'><float_array>0 0 0 1 0 0 0 1 0</float_array></source>\
         <vertices id='v'><input semantic='POSITION' source='#s'/></vertices>\
         <triangles count='1'><input semantic='VERTEX' source='#v' offset='0'/><p>0 1 2</p></triangles>\
         </mesh></geometry></library_geometries><library_visual_scenes><visual_scene>{deep}</visual_scene>\
         </library_visual_scenes></COLLADA>"
    );
    let gltf = String::from_utf8(skin_to_bytes(Path::new("skin.gltf"), &plain_skin()).unwrap()).unwrap();
    let copies = gltf.replacen('{', "{\"extensionsUsed\":[\"EXT_mesh_gpu_instancing\"],", 1);
    let ply = |normals: &str, row: &str| {
        format!(
            "ply\nformat ascii 1.0\ncomment Gr\u{f6}\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
             property float quality\n{normals}element face 1\nproperty list uchar int vertex_indices\nend_header\n\
             0 0 0 {row}\n1 0 0 {row}\n0 1 0 -inf {}\n3 0 1 2\n",
            row.split_once(' ').map_or("", |(_, rest)| rest)
        )
    };
    let latin = |text: String| text.chars().map(|c| u8::try_from(c).unwrap()).collect::<Vec<u8>>();
    let normals = "property float nx\nproperty float ny\nproperty float nz\n";
    let cases: [(&str, Vec<u8>, usize, usize); 14] = [
        ("ply", latin(ply("", "nan")), 1, 0),
        ("ply", latin(ply(normals, "1 nan 0 NaN")), 1, 1),
        ("obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvn nan nan nan\nf 1//1 2//1 3//1\n".into(), 1, 1),
        ("obj", b"# Gr\xf6\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".into(), 1, 0),
        ("gltf", copies.into(), 12, 1),
        ("obj", b"v 0 0 0 nan 0 1\nv 1 0 0 0.1 0.2 0.3\nv 0 1 0 1 0 0\nf 1 2 3\n".into(), 1, 0),
        ("obj", b"v 0 0 0 0.1 0.5 0.2 0.9\nv 1 0 0 1 1 1 1\nv 0 1 0\nf 1 2 3\n".into(), 1, 0),
        ("obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/7 2/8 3/9\n".into(), 1, 0),
        ("obj", b"v 0 0 0\rv 1 0 0\rv 0 1 0\rf 1 2 3\r".into(), 1, 0),
        ("stl", text.replace('\n', "\r").into(), 1, 0),
        ("stl", format!("\u{feff}{text}").into(), 1, 0),
        ("stl", format!("solid a\n{facet}").into(), 1, 1),
        ("stl", binary, 12, 1),
        ("dae", dae.into(), 1, 0),
    ];
    for (kind, bytes, triangles, remarks) in cases {
        let draft = read_bytes(kind, &bytes).unwrap_or_else(|e| panic!("{kind}: {e}"));
        let found: usize = draft.sheets.iter().map(|sheet| sheet.triangles.len()).sum();
        assert_eq!((found, draft.remarks.len()), (triangles, remarks), "{}", String::from_utf8_lossy(&bytes));
    }
    let short = read_text("stl", "solid a\nfacet normal 0 0 1\nouter loop\n").unwrap_err().to_string();
    assert!(short.contains("found the end"), "{short}");
}

/// Twice the area of all triangles of a draft.
fn twice_the_area(draft: &Draft) -> f64 {
    let of = |sheet: &Sheet| {
        let at = |v: u32| sheet.positions[v as usize];
        sheet.triangles.iter().map(|t| t.map(at)).map(|[a, b, c]| (b - a).cross(c - a).length()).sum::<f64>()
    };
    draft.sheets.iter().map(of).sum()
}

/// An L in every format that has polygons: a fan from its first corner would cover more. One that crosses itself
/// is refused with its name.
#[test]
fn polygons_of_any_shape_become_their_triangles() {
    let corners = [[3, 1], [1, 1], [1, 3], [0, 3], [0, 0], [3, 0]];
    let rows = |before: &str| corners.map(|[x, y]| format!("{before}{x} {y} 0\n")).concat();
    let flat = rows("").replace('\n', " ");
    let dae = |polygons: &str| {
        format!(
            "<COLLADA><library_geometries><geometry id='g'><mesh><source id='s'><float_array>{flat}</float_array></source>\
             <vertices id='v'><input semantic='POSITION' source='#s'/></vertices>{polygons}</mesh></geometry>\
             </library_geometries></COLLADA>"
        )
    };
    let input = "<input semantic='VERTEX' source='#v' offset='0'/>";
    let ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n\
         element face 1\nproperty list uchar int vertex_indices\nend_header\n{}6 0 1 2 3 4 5\n",
        rows("")
    );
    let obj = format!("usemtl a\nf 1 2 3 4 5 6\n{}f -6 -5 -4 -3 -2 -1\n", rows("v "));
    let off = format!("OFF\n6 1 0\n{}6 0 1 2 3 4 5\n", rows(""));
    let polygons = dae(&format!("<polygons count='1'>{input}<p>0 1 2 3 4 5</p></polygons>"));
    // The outline of the L, without a triangle.
    let holed = dae(&format!("<polygons>{input}<ph><p>5 0 1 2 3 4</p><h>4 1 5</h></ph></polygons>"));
    let polylist = format!("<polylist count='1'>{input}<p>0 1 2 3 4 5</p></polylist>");
    for (kind, text, twice) in [
        ("obj", &obj, 20.0),
        ("off", &off, 10.0),
        ("ply", &ply, 10.0),
        ("dae", &polygons, 10.0),
        ("dae", &dae(&polylist), 10.0),
    ] {
        assert_eq!(twice_the_area(&read_text(kind, text).unwrap()), twice, "{text}");
        // Two corners change places.
        let crossed = text.replace("0 1 2 3 4 5", "0 1 2 4 3 5").replace("f 1 2 3 4 5", "f 1 2 3 5 4");
        let refused = read_text(kind, &crossed).unwrap_err().to_string();
        assert!(refused.contains("crosses"), "{refused}");
    }
    let touching = read_text("dae", &holed).unwrap_err().to_string();
    assert!(touching.contains("polygon 0"), "{touching}");
}

/// A backslash joins lines of numbers, and is a letter in comments and names.
#[test]
fn a_backslash_in_a_comment_of_obj_joins_nothing() {
    let text = "# C:\\\nv 0 0 0\nv 1 0 \\\n0\nmtllib a\\\nv 0 1 0\no C:\\b\\\nusemtl c\\\nf 1 2 \\\n3\n";
    let draft = read_text("obj", text).unwrap();
    let sheets: Vec<_> =
        draft.sheets.iter().map(|s| (s.name.as_str(), s.positions.len(), s.triangles.len())).collect();
    assert_eq!(sheets, [("C:\\b\\", 3, 1)]);
}

/// Faces may have properties that vertices have, too, and lists that nothing here needs.
#[test]
fn properties_of_ply_faces_are_passed_over() {
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty float nx\nproperty list uchar int vertex_indices\nproperty float area\n\
        property list uchar float id\nend_header\n0 0 0\n1 0 0\n0 1 0\n7 3 0 1 2 9 2 5 6\n";
    let sheet = read_text("ply", text).unwrap().sheets.remove(0);
    assert_eq!(sheet.triangles.len(), 1);
    assert!(sheet.normals.is_none() && sheet.areas.is_none() && sheet.ids.is_none());
}

/// Numbers of Fortran and of hands: no digit on one side of the point, or a plus.
#[test]
fn numbers_of_ply_need_no_digit_on_both_sides_of_the_point() {
    let text = "ply\nformat ascii 1.0\ncomment .5\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
        .25 -.5 1.\n+1 2.e-1 +.5\n0 1 0.\n3 0 1 2\n";
    let sheet = read_text("ply", text).unwrap().sheets.remove(0);
    let found: Vec<[f64; 3]> =
        sheet.positions.iter().map(|p| p.to_array().map(|x| (1e6 * x).round() / 1e6)).collect();
    assert_eq!(found, [[0.25, -0.5, 1.0], [1.0, 0.2, 0.5], [0.0, 1.0, 0.0]]);
}

fn read_bytes(kind: &str, bytes: &[u8]) -> Result<Draft, IoError> {
    draft_from_bytes(Path::new(&format!("file.{kind}")), bytes.into(), ReadParts::default())
}

fn read_text(kind: &str, text: &str) -> Result<Draft, IoError> {
    read_bytes(kind, text.as_bytes())
}

/// Counts and indices that no file of this length can mean, and what a format does not allow.
#[test]
fn broken_elements_are_named() {
    let ply = |rest: &str| format!("ply\nformat ascii 1.0\n{rest}end_header\n");
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    let faces = "element face 1\nproperty list int int vertex_indices\n";
    let cases: &[(&str, String, &str)] = &[
        ("ply", ply(&format!("element vertex 4000000000\n{xyz}")), "element \"vertex\""),
        ("ply", ply(&format!("element vertex 1\n{xyz}")) + "0 0 1e999\n", "vertex 0, property `z`"),
        ("ply", ply(&format!("element vertex 1\n{xyz}{faces}")) + "0 0 0\n3 0 0 -1\n", "face 0"),
        ("ply", ply(&format!("element vertex 0\n{xyz}{faces}")) + "4000000000 0 0 0\n", "line or record 10"),
        ("stl", "x".repeat(80) + "\u{1}\u{2}\u{3}\u{4}", "67305985 triangles in 84 bytes"),
        ("stl", "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 nan\n".into(), "line 1, facet 0"),
        ("obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4000000000\n".into(), "line 4"),
        ("obj", "v 0 0 0\nvn 0 0 1\nf 1//1 1//6148914691236517206 1//1\n".into(), "`vn` number"),
        ("obj", "v 0 0 0\nf 1 1 -9223372036854775808\n".into(), "line 2, corner"),
        ("obj", "v 0 0 0\nf \n".into(), "no corners"),
        ("obj", "v 0 0 0 0.5\n".into(), "weight"),
        ("json", "{\"skin\": {\"taxels\": [], \"faces\": [[0, 1, 2]]}}".into(), "skin.faces[0]"),
        (
            "json",
            "{\"skin\": {\"taxels\": [{\"id\": 1, \"x\": [0, 0, 1e999]}], \"faces\": []}}".into(),
            "column",
        ),
        ("json", "[".repeat(100_000), "line 1"),
    ];
    for (kind, text, place) in cases {
        let error = read_text(kind, text).expect_err(text).to_string();
        assert!(error.contains(place), "{kind}: {place:?} is named in {error:?}");
        assert!(error.contains(&format!("file.{kind}")), "{kind}: the file is named in {error:?}");
    }
}

/// Lines have no normals; those of the faces stay.
#[test]
fn lines_among_faces_take_no_normals() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\nf 1 2\n";
    let normals = read_text("obj", text).unwrap().sheets[0].normals.clone().unwrap();
    assert!(normals.iter().all(|normal| *normal == DVec3::Z), "{normals:?}");
}

/// Some programs write points and lines as faces of one and two corners.
#[test]
fn points_and_lines_among_faces_are_left_out() {
    let rows = "0 0 0\n1 0 0\n0 1 0\n";
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 3\nproperty list uchar int vertex_indices\nend_header\n";
    let dae = "<COLLADA><library_geometries><geometry id=\"g\"><mesh><source id=\"p\"><float_array id=\"a\" \
               count=\"9\">0 0 0 1 0 0 0 1 0</float_array><technique_common><accessor source=\"#a\" count=\"3\" \
               stride=\"3\"/></technique_common></source><vertices id=\"v\"><input semantic=\"POSITION\" \
               source=\"#p\"/></vertices><polylist count=\"3\"><input semantic=\"VERTEX\" source=\"#v\" \
               offset=\"0\"/><vcount>3 2 1</vcount><p>0 1 2 0 1 2</p></polylist></mesh></geometry>\
               </library_geometries></COLLADA>";
    let cases = [
        ("obj", rows.lines().map(|row| format!("v {row}\n")).collect::<String>() + "f 1 2 3\nf 1 2\nf 3\n"),
        ("off", format!("OFF\n3 3 0\n{rows}3 0 1 2\n2 0 1\n1 2\n")),
        ("ply", format!("{header}{rows}3 0 1 2\n2 0 1\n1 2\n")),
        ("dae", dae.into()),
    ];
    for (kind, text) in cases {
        let read = assemble(&read_text(kind, &text).expect(kind), &AssembleOptions::default()).expect(kind);
        assert_eq!(read.skin.patches[PatchId::new(0)].mesh.triangles.len(), 1, "{kind}");
        let remarks: Vec<String> = read.remarks.iter().map(ToString::to_string).collect();
        assert!(remarks.iter().any(|remark| remark.contains("2 faces were left out")), "{kind}: {remarks:?}");
    }
}

fn read_tables(taxels: &str, triangles: &str) -> Result<Draft, IoError> {
    let folder = TempDir::new().unwrap();
    fs::write(folder.path().join("skin.csv"), taxels).unwrap();
    fs::write(folder.path().join("skin.triangles.csv"), triangles).unwrap();
    read_draft(&folder.path().join("skin.csv"))
}

#[test]
fn broken_tables_are_refused_by_line_and_column() {
    let taxels = "id,x,y,z\n1,0,0,0\n2,1,0,0\n3,0,1,0\n";
    let good = "row0,row1,row2\n0,1,2\n";
    assert_sound(&read_tables(taxels, good).unwrap());
    for same in [good, "id0,id1,id2\n1,2,3\n"] {
        assert_eq!(read_tables(taxels, same).unwrap().sheets[0].triangles, [[0, 1, 2]]);
    }
    let cases = [
        ("id,x,y\n1,0,0\n", good, "a column `z`"),
        ("id,x,y,z\n1,0,zero,0\n", good, "line 2, column `y`"),
        ("id,x,y,z\n1,0,0\n", good, "line 2"),
        ("id,x,y,z,area\n1,0,0,0,1\n2,0,0,0,\n", good, "line 3, column `area`"),
        ("id,x,y,z,patch,link\n1,0,0,0,p,a\n2,0,0,0,p,b\n", good, "line 3, column `link`"),
        ("id,x,y,z,patch\n1,0,0,0,p\n2,0,0,0,q\n3,0,0,0,q\n", good, "line 2, column `row1`"),
        (taxels, "row0,row1,row2\n0,1,3\n", "line 2, column `row2`"),
        ("id,x,y,z\n1,0,0,0\n1,1,0,0\n3,0,1,0\n", "id0,id1,id2\n1,1,3\n", "an id of one taxel, not of 2"),
    ];
    for (taxels, triangles, place) in cases {
        let error = read_tables(taxels, triangles).expect_err(taxels);
        let text = error.to_string();
        assert!(text.contains(place), "{place:?} is named in {text:?}");
        let IoError::Invalid { element, .. } = error else { panic!("{text:?} is about an element") };
        let line = element.line.expect("a table has lines");
        assert!(text.contains(&format!("line {line}")), "{line}: {text:?}");
    }
}

#[test]
fn frames_must_be_rotations() {
    let file = |matrix: &str| {
        format!(
            "{{\"skin\": {{\"taxels\": [], \"faces\": [], \"parent_frames\": [{{\"tf_matrix\": [{matrix}]}}]}}}}"
        )
    };
    for matrix in [
        "2,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1",
        "-1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1",
        "1,0,0,5, 0,1,0,0, 0,0,1,0, 0,0,0,1",
        "0,0,0,0, 0,0,0,0, 0,0,0,0, 0,0,0,1",
    ] {
        assert!(read_text("json", &file(matrix)).is_err(), "{matrix}");
    }
    let rounded = file("0.7071,0.7071,0,0, -0.7071,0.7071,0,0, 0,0,1,0, 0,0,0.024,1");
    let pose = read_text("json", &rounded).unwrap().links[LinkId::new(0)].pose;
    assert!(pose.matrix3.abs_diff_eq(DMat3::from_rotation_z(std::f64::consts::FRAC_PI_4), 1e-15), "{pose}");
    assert_eq!(pose.translation, DVec3::new(0.0, 0.0, 0.024), "the last column");
}

#[test]
fn taxels_of_an_unknown_type_count_as_none() {
    let taxels = r#"[{"id": 0, "x": [0, 0, 0], "type": "proximity"}, {"id": 1, "x": [1, 0, 0]}]"#;
    let draft = read_text("json", &format!(r#"{{"skin": {{"taxels": {taxels}, "faces": []}}}}"#)).unwrap();
    assert_eq!(draft.sheets[0].presence.as_deref(), Some(&[Presence::Absent, Presence::Present][..]));
}

/// A binary file has no end that a cut could leave valid.
#[test]
fn cut_binary_files_are_refused() {
    for kind in ["ply", "stl"] {
        let whole = skin_to_bytes(Path::new(&format!("skin.{kind}")), &plain_skin()).unwrap();
        for end in 0..whole.len() {
            assert!(read_bytes(kind, &whole[..end]).is_err(), "{kind}: {end} of {} bytes", whole.len());
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Decimals are the shortest that read back as the same number, of any size within reach.
    #[test]
    fn text_keeps_every_bit(x in prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL) {
        let x = x % 1e12;
        let folder = TempDir::new().unwrap();
        let mut skin = plain_skin();
        let v = VertexId::new(0);
        skin.patches[PatchId::new(0)].mesh.positions[v].x = x;
        for kind in ["obj", "json", "csv", "ply"] {
            let found = write_and_read(&folder, kind, &skin).sheets[0].positions[0].x;
            prop_assert_eq!(found.to_bits(), x.to_bits(), "{}", kind);
        }
    }
}

#[test]
fn empty_files_folders_and_other_text_are_refused() {
    let folder = TempDir::new().unwrap();
    for kind in KINDS {
        let empty = read_bytes(kind, b"").unwrap_err().to_string();
        assert!(empty.contains("0 bytes") || empty.contains("triangles"), "{kind}: {empty}");
        let latin = read_bytes(kind, b"solid M\xfcller\nv \xfc\nid,x,y,z,\xfc\n").unwrap_err();
        assert!(matches!(latin, IoError::Invalid { .. }), "{kind}: {latin}");
        let path = folder.path().join(format!("folder.{kind}"));
        fs::create_dir(&path).unwrap();
        fs::create_dir_all(path.with_extension("triangles.csv")).unwrap();
        assert!(matches!(read_draft(&path), Err(IoError::Read { .. })), "{kind}: a folder");
        assert!(
            matches!(write_skin(&path, &plain_skin()), Err(IoError::Write { .. })),
            "{kind}: onto a folder"
        );
        let missing = folder.path().join(format!("missing.{kind}"));
        assert!(read_draft(&missing).is_err(), "{kind}: no such file");
    }
    let step = folder.path().join("skin.step");
    fs::write(&step, "ISO-10303-21;").unwrap();
    let unknown = read_draft(&step).unwrap_err();
    assert!(matches!(unknown, IoError::UnknownKind { .. }), "{unknown}");
    assert!(read_bytes("OBJ", b"v 0 0 0\n").is_ok(), "extensions in capitals");
}

/// A device has no end that a reader could wait for; it is written to as it is, and this one is
/// always full.
#[cfg(target_os = "linux")]
#[test]
fn devices_are_not_read_and_never_replaced() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("full.obj");
    std::os::unix::fs::symlink("/dev/full", &path).unwrap();
    assert!(read_draft(&path).unwrap_err().to_string().contains("not a regular file"));
    let error = write_skin(&path, &plain_skin()).unwrap_err();
    assert!(error.to_string().contains("full.obj: No space left"), "{error}");
    assert_eq!(listing(folder.path()), ["full.obj"], "the link stays, and nothing is left beside it");
}

#[test]
fn a_failed_write_leaves_the_older_file_and_nothing_else() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("out.txt");
    fs::write(&path, "older").unwrap();
    let full = || std::io::Error::from(std::io::ErrorKind::StorageFull);
    let failed = replace_file(&path, |file| {
        file.write_all(&vec![b'x'; 1 << 20]).unwrap();
        Err(IoError::Write { path: path.clone(), source: full() })
    });
    assert!(failed.unwrap_err().to_string().contains("out.txt"));
    assert_eq!(fs::read_to_string(&path).unwrap(), "older");
    assert_eq!(listing(folder.path()), ["out.txt"], "no temporary file is left");
    replace_file(&path, |file| {
        file.write_all(b"newer").unwrap();
        Ok(())
    })
    .unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), "newer");
}

/// A skin that breaks its promises is refused before a file is touched.
#[test]
fn a_broken_skin_is_not_written() {
    let folder = TempDir::new().unwrap();
    let mut skin = plain_skin();
    skin.patches[PatchId::new(0)].link = LinkId::new(7);
    for kind in KINDS {
        let path = folder.path().join(format!("skin.{kind}"));
        assert!(matches!(write_skin(&path, &skin), Err(IoError::Unfit { .. })), "{kind}");
    }
    assert_eq!(listing(folder.path()), [""; 0]);
}

#[test]
fn a_missing_or_forbidden_folder_is_named() {
    let folder = TempDir::new().unwrap();
    let mut forbidden = vec![folder.path().join("nowhere")];
    let file = folder.path().join("file");
    fs::write(&file, "no folder").unwrap();
    forbidden.push(file);
    // Nobody, root included, may make files here.
    forbidden.extend(Some(PathBuf::from("/proc")).filter(|p| p.is_dir()));
    for folder in forbidden {
        for kind in KINDS {
            let path = folder.join(format!("skin.{kind}"));
            let error = write_skin(&path, &plain_skin()).unwrap_err();
            assert!(matches!(error, IoError::Write { .. }), "{error}");
            assert!(error.to_string().contains(&folder.display().to_string()), "{error}");
        }
    }
}

#[cfg(unix)]
#[test]
fn a_link_to_a_file_stays_a_link() {
    let folder = TempDir::new().unwrap();
    let (real, link) = (folder.path().join("real.json"), folder.path().join("link.json"));
    fs::write(&real, "older").unwrap();
    std::os::unix::fs::symlink(&real, &link).unwrap();
    write_skin(&link, &plain_skin()).unwrap();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert!(fs::read_to_string(&real).unwrap().starts_with("{\n  \"info\""), "the target is replaced");
}

#[test]
fn flat_maps_read_back_as_they_were() {
    let folder = TempDir::new().unwrap();
    let mesh = shapes::fan(5);
    let uv = mesh.positions.map(|p| DVec2::new(p.x / 3.0, p.y * 1e-7));
    let path = folder.path().join("flat.npz");
    write_flat(&path, &mesh, &uv).unwrap();
    let mut archive = zip::ZipArchive::new(fs::File::open(&path).unwrap()).unwrap();
    let mut array = |name: &str| {
        let mut bytes = Vec::new();
        std::io::copy(&mut archive.by_name(name).unwrap(), &mut bytes).unwrap();
        bytes
    };
    let (v, f, map) = (array("V.npy"), array("F.npy"), array("UV.npy"));
    let npy = |bytes| npyz::NpyFile::new(bytes).unwrap();
    assert_eq!(npy(&v[..]).shape(), [6, 3]);
    assert_eq!(npy(&f[..]).shape(), [5, 3]);
    let faces: Vec<i64> = npy(&f[..]).into_vec().unwrap();
    assert_eq!(faces[..3], [0, 1, 2]);
    let found: Vec<f64> = npy(&map[..]).into_vec().unwrap();
    assert_eq!(found, uv.iter().flat_map(|p| p.to_array()).collect::<Vec<_>>());
    let positions: Vec<f64> = npy(&v[..]).into_vec().unwrap();
    assert_eq!(positions, mesh.positions.iter().flat_map(|p| p.to_array()).collect::<Vec<_>>());
    let again = folder.path().join("again.npz");
    write_flat(&again, &mesh, &uv).unwrap();
    assert_eq!(fs::read(path).unwrap(), fs::read(again).unwrap(), "no time of day in it");

    let path = folder.path().join("flat.obj");
    write_flat(&path, &mesh, &uv).unwrap();
    assert_eq!(read_draft(&path).unwrap().sheets[0].positions, mesh.positions.as_slice());
    let text = fs::read_to_string(&path).unwrap();
    let found: Vec<DVec2> = text
        .lines()
        .filter_map(|line| line.strip_prefix("vt "))
        .map(|line| line.split_once(' ').unwrap())
        .map(|(u, v)| DVec2::new(u.parse().unwrap(), v.parse().unwrap()))
        .collect();
    assert_eq!(found, uv.as_slice(), "to the last bit");
    assert!(text.contains("f 1/1 2/2 3/3\n"));
    let short = IdVec::from(vec![DVec2::ZERO; 2]);
    assert!(write_flat(&path, &mesh, &short).unwrap_err().to_string().contains("2 positions"));
}

/// The laboratory's own covers, if they are here:
/// `(file, taxels, faces, frame, placeholders among the ids)`.
#[test]
fn real_covers_are_read() {
    let Some(folder) = data("cyskin") else { return };
    let covers = [
        ("broken_link1_patches_1_2.json", 1284, 2528, "ICRA2024 Demo", "upper_arm_link"),
        ("curved_gesture_patch_isomap.json", 642, 1232, "UR10_link1", ""),
        ("hexagon_isomap.json", 61, 98, "hexagon_cyskin", ""),
        ("two_components.json", 1048, 2018, "UR10_link2", "kFlange"),
        ("ur10e_link1_patch1_flatmap.json", 642, 1232, "UR10_link2", ""),
        ("ur10e_link1_patch1_isomap.json", 642, 1232, "UR10_link2", ""),
        ("ur10e_link1_patch2_isomap.json", 642, 1232, "UR10_link1", ""),
    ];
    for (name, taxels, faces, body, frame) in covers {
        let draft = read_draft(&folder.join(name)).unwrap();
        assert_sound(&draft);
        let [sheet] = draft.sheets.as_slice() else { panic!("{name}: one body") };
        assert_eq!((sheet.positions.len(), sheet.triangles.len()), (taxels, faces), "{name}");
        assert_eq!(sheet.name, body, "{name}");
        let link = &draft.links[sheet.link.unwrap()];
        assert_eq!(link.name, frame, "{name}");
        let squared = link.pose.matrix3.transpose() * link.pose.matrix3;
        assert!(squared.abs_diff_eq(DMat3::IDENTITY, 1e-15), "{name}: a rotation to the last digit");
        assert!(sheet.presence.iter().flatten().all(|&p| p == Presence::Present), "{name}");
    }
}

/// Columns that are not known are noted; ids go by either name, and those below zero are refused.
#[test]
fn tables_of_taxels_take_what_others_write() {
    let exported = "patch,link,taxel_id,x,y,z,nx,ny,nz,tx,ty,tz,u,v,area,presence\n\
                    palm,hand,7,0,0,0,0,0,1,1,0,0,0,0,1e-5,present\npalm,hand,9,1,0,0,0,0,1,1,0,0,1,0,1e-5,absent\n";
    for text in [exported.to_owned(), exported.replace(',', ";"), exported.replace("taxel_id", "id")] {
        let draft = read_text("csv", &text).unwrap();
        let sheet = &draft.sheets[0];
        assert_eq!(sheet.ids.as_deref(), Some(&[7, 9].map(TaxelId)[..]));
        assert_eq!(sheet.tangents.as_deref(), Some(&[DVec3::X; 2][..]));
        assert_eq!(sheet.presence.as_deref(), Some(&[Presence::Present, Presence::Absent][..]));
        let remarks: Vec<String> = draft.remarks.iter().map(ToString::to_string).collect();
        assert!(remarks.len() == 1 && remarks[0].contains("2 columns are not used: u, v"), "{remarks:?}");
    }
    // Tangents that are stated are kept, whatever the normals are.
    let below = exported.replace("0,0,1,1,0,0", "0,0,-1,1,0,0");
    assert_eq!(read_text("csv", &below).unwrap().sheets[0].tangents.as_deref(), Some(&[DVec3::X; 2][..]));
    let ids = |id: &str| {
        read_text("csv", &format!("id,x,y,z\n{id},0,0,0\n")).map(|draft| draft.sheets[0].ids.clone())
    };
    assert_eq!(ids("-1").unwrap(), Some(vec![TaxelId(u32::MAX)]));
    for id in ["-2", "1.5", "4294967296"] {
        assert!(ids(id).unwrap_err().to_string().contains("column `id`"), "{id}");
    }
    let comma = read_text("csv", "id;x;y;z\n1;0,5;0;0\n").unwrap_err().to_string();
    assert!(comma.contains("column `x`: found \"0,5\"; needed: a number with a decimal point"), "{comma}");
}

/// A 3MF file is a zip archive of XML: objects in a unit, used with transforms, also from other parts and in each other.
#[test]
fn models_of_3mf_are_read() {
    let mesh = "<mesh><vertices><vertex x='0' y='0' z='0'/><vertex x='1' y='0' z='0'/><vertex x='0' y='1' z='0'/>\
                <vertex x='0' y='0' z='1'/></vertices><triangles><triangle v1='0' v2='2' v3='1'/>\
                <triangle v1='0' v2='1' v3='3'/><triangle v1='1' v2='2' v3='3'/><triangle v1='2' v2='0' v3='3'/>\
                </triangles></mesh>";
    let model = |unit: &str, inner: &str| {
        format!(
            "<model unit='{unit}' xmlns:p='http://schemas.microsoft.com/3dmanufacturing/production/2015/06'>{inner}</model>"
        )
    };
    let main = |objects: &str, items: &str| {
        model("centimeter", &format!("<resources>{objects}</resources><build>{items}</build>"))
    };
    let archive = |main: &str| {
        let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        let other = format!("<resources><object id='1' name='tip'>{mesh}</object></resources>");
        for (name, text) in
            [("3D/Objects/o.model", model("centimeter", &other)), ("3D/3dmodel.model", main.to_owned())]
        {
            zip.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
            std::io::Write::write_all(&mut zip, text.as_bytes()).unwrap();
        }
        zip.finish().unwrap().into_inner()
    };
    let mirrored =
        "<component objectid='1' p:path='/3D/Objects/o.model' transform='-1 0 0 0 1 0 0 0 1 0 0 0'/>";
    let objects = format!(
        "<object id='2'><components>{mirrored}</components></object><object id='3' type='support'>{mesh}</object>"
    );
    let items = "<item objectid='2' transform='1 0 0 0 1 0 0 0 1 0 0 7'/><item objectid='3'/>";
    let draft = read_bytes("3mf", &archive(&main(&objects, items))).unwrap();
    let [sheet] = &draft.sheets[..] else { panic!("{:?}", draft.sheets) };
    assert_eq!((&*sheet.name, sheet.triangles.len()), ("tip", 4));
    assert!((sheet.positions[1] - glam::DVec3::new(-0.01, 0.0, 0.07)).length() < 1e-15);
    let solid = TriMesh::from_arrays(sheet.positions.clone(), &sheet.triangles);
    let volume: f64 = solid
        .triangles
        .ids()
        .map(|f| {
            let [a, b, c] = solid.corners(f);
            a.cross(b).dot(c) / 6.0
        })
        .sum();
    assert!((volume - 1e-6 / 6.0).abs() < 1e-15, "a mirror turns triangles over: {volume}");
    for (text, said) in [
        (main("", "<item objectid='9'/>"), "the id of an <object>"),
        (main(&objects, "").replace("<build></build>", ""), "no part with a <build>"),
        (main(&objects, items).replace("centimeter", "ell"), "micron"),
        (main(&objects, items).replace("transform='1", "transform='"), "12 finite numbers"),
        (
            main(
                "<object id='2'><components><component objectid='2'/></components></object>",
                "<item objectid='2'/>",
            ),
            "use themselves",
        ),
    ] {
        let refused = read_bytes("3mf", &archive(&text)).unwrap_err().to_string();
        assert!(refused.contains(said), "{refused}");
    }
    assert!(read_bytes("3mf", b"PK").unwrap_err().to_string().contains("zip"));
}
