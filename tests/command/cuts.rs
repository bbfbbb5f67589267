//! Meshes that their files cut open: which cuts are kept, and which broken edges are split.

use std::{collections::BTreeMap, fs, path::Path};

use crate::common::{dermatome, notes, refuses};
use dermatome::io::{read_draft, read_map, write_skin};
use dermatome::mesh::{TriMesh, shapes};
use dermatome::skin::Skin;
use glam::DVec3;
use predicates::str::contains;

/// Vertices, faces and boundary loops of the first patch.
fn size(folder: &Path, words: &str) -> [u64; 3] {
    let output = dermatome(folder, &format!("info {words} --json")).assert().success();
    let info: serde_json::Value = serde_json::from_slice(&output.get_output().stdout).unwrap();
    ["vertices", "faces", "boundary_loops"].map(|what| info["patches"][0][what].as_u64().unwrap())
}

fn write(folder: &Path, name: &str, mesh: TriMesh) {
    write_skin(&folder.join(name), &Skin::from_mesh("s", mesh)).unwrap();
}

/// The corners of the faces, and how many vertices lie at each place; coordinates as bits.
type Places = (Vec<[[u64; 3]; 3]>, BTreeMap<[u64; 3], usize>);

/// The triangles of a file by the positions of their corners, and how many vertices each place has.
fn places(path: &Path) -> Places {
    let sheet = read_draft(path).unwrap().sheets.remove(0);
    #[allow(clippy::cast_possible_truncation, reason = "glTF rounds to f32, so that is what is compared")]
    let place = |p: &DVec3| p.to_array().map(|x| u64::from((x as f32 + 0.0).to_bits()));
    let triangles = sheet.triangles.iter().map(|t| t.map(|v| place(&sheet.positions[v as usize]))).collect();
    let mut copies = BTreeMap::new();
    sheet.positions.iter().for_each(|p| *copies.entry(place(p)).or_default() += 1);
    (triangles, copies)
}

/// A torus, closed and with a handle, is flattened; what was written is the same disk when it is
/// read back, and in every format it is converted to.
#[test]
fn a_cut_that_was_written_is_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write(path, "torus.obj", shapes::torus(24, 12, 0.05, 0.02));
    assert_eq!(size(path, "torus.obj"), [288, 576, 0]);
    dermatome(path, "flatten torus.obj -o cut.obj").assert().success();
    let [vertices, faces, loops] = size(path, "cut.obj");
    assert_eq!((vertices > 288, faces, loops), (true, 576, 1));
    notes(path, "info cut.obj", &["cuts it open", "--weld all"]);
    let first = places(&path.join("cut.obj"));
    for kind in ["obj", "ply", "off", "glb", "csv", "json"] {
        dermatome(path, &format!("convert cut.obj back.{kind}")).assert().success();
        assert_eq!(size(path, &format!("back.{kind}")), [vertices, faces, loops], "{kind}");
        assert_eq!(places(&path.join(format!("back.{kind}"))), first, "{kind}");
    }
    assert_eq!(size(path, "cut.obj --weld all"), [288, 576, 0]);
    assert_eq!(size(path, "cut.obj --weld none"), [vertices, faces, loops]);
    dermatome(path, "convert cut.obj welded.stl").assert().success();
    assert_eq!(size(path, "welded.stl"), [288, 576, 0], "STL has no indices");
    dermatome(path, "check cut.obj").assert().success();
    // In a map the two sides of a seam are the same taxels, by their ids.
    dermatome(path, "build torus.obj -o M").assert().success();
    assert_eq!(size(path, "M/map.glb"), [288, 576, 0]);
}

/// A sleeve, cut open along a line, has fewer loops than welded.
#[test]
fn a_sleeve_stays_cut() {
    let folder = tempfile::tempdir().unwrap();
    let mut text = String::new();
    for i in 0..=12 {
        let (sin, cos) = (f64::from(i % 12) * std::f64::consts::TAU / 12.0).sin_cos();
        for z in 0..4 {
            text += &format!("v {cos:?} {sin:?} {z}\n");
        }
    }
    for i in 0..12 {
        for z in 0..3 {
            let v = 4 * i + z + 1;
            text += &format!("f {v} {} {}\nf {v} {} {}\n", v + 4, v + 5, v + 5, v + 1);
        }
    }
    fs::write(folder.path().join("sleeve.obj"), text).unwrap();
    assert_eq!(size(folder.path(), "sleeve.obj"), [52, 72, 1]);
    assert_eq!(size(folder.path(), "sleeve.obj --weld all"), [48, 72, 2]);
}

/// A tetrahedron whose corners are split at its sharp edges is one closed surface, and a slit in a disk that
/// an exporter made closes.
#[test]
fn splits_for_normals_are_welded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let cube = shapes::tetrahedron();
    let corners: Vec<DVec3> = cube.triangles.ids().flat_map(|f| cube.corners(f)).collect();
    let text: String = corners.iter().map(|p| format!("v {:?} {:?} {:?}\n", p.x, p.y, p.z)).collect();
    let faces: String =
        (0..corners.len() / 3).map(|f| format!("f {} {} {}\n", 3 * f + 1, 3 * f + 2, 3 * f + 3)).collect();
    fs::write(path.join("soup.obj"), text + &faces).unwrap();
    assert_eq!(size(path, "soup.obj"), [cube.positions.len() as u64, cube.triangles.len() as u64, 0]);
    notes(path, "info soup.obj", &["were welded"]);
    // Four triangles around a vertex, slit from it to the rim.
    let slit = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv -1 0 0\nv 0 -1 0\nv 1 0 0\nf 1 2 3\nf 1 3 4\nf 1 4 5\nf 1 5 6\n";
    fs::write(path.join("slit.obj"), slit).unwrap();
    assert_eq!(size(path, "slit.obj"), [5, 4, 1]);
    assert_eq!(size(path, "slit.obj --weld none"), [6, 4, 1]);
}

/// A closed sphere of which the texture has a seam from pole to pole.
#[test]
fn seams_of_the_texture_are_cuts() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    // An octahedron; its texture is cut along the meridian through vertices 5, 1, 6.
    let text = "v 1 0 0\nv 0 1 0\nv -1 0 0\nv 0 -1 0\nv 0 0 1\nv 0 0 -1\n\
                vt 0 .5\nvt .25 .5\nvt .5 .5\nvt .75 .5\nvt 1 .5\nvt .5 1\nvt .5 0\n\
                f 1/1 2/2 5/6\nf 2/2 3/3 5/6\nf 3/3 4/4 5/6\nf 4/4 1/5 5/6\n\
                f 2/2 1/1 6/7\nf 3/3 2/2 6/7\nf 4/4 3/3 6/7\nf 1/5 4/4 6/7\n";
    fs::write(path.join("o.obj"), text).unwrap();
    assert_eq!(size(path, "o.obj"), [6, 8, 0]);
    assert_eq!(size(path, "o.obj --seams uv"), [7, 8, 1], "vertex 1 has two texture coordinates");
    dermatome(path, "flatten o.obj --seams uv -o flat.obj").assert().success();
    // A coordinate that is only rounded is no seam.
    fs::write(path.join("r.obj"), text.replace("f 1/1 2/2 5/6", "vt .2500001 .5\nf 1/1 2/8 5/6")).unwrap();
    assert_eq!(size(path, "r.obj --seams uv"), [7, 8, 1]);
    dermatome(path, "info o.obj --seams uv --weld all").assert().code(2);
    fs::write(path.join("bare.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    refuses(path, "info bare.obj --seams uv", &["no texture coordinates"]);
}

/// Two planes that cross along an edge, a face that is there twice, and a bow tie.
#[test]
fn repair_splits_crowded_edges_into_sheets() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let cross = "v 0 0 0\nv 0 0 1\nv 1 .1 0\nv -1 0 0\nv 0 1 0\nv .1 -1 0\n\
                 f 1 2 3\nf 2 1 4\nf 1 2 5\nf 2 1 6\n";
    fs::write(path.join("cross.obj"), cross).unwrap();
    refuses(path, "info cross.obj", &["more than two faces", "--repair"]);
    dermatome(path, "check cross.obj").assert().code(1).stdout(contains("--repair repairs it"));
    let repaired = dermatome(path, "info cross.obj --repair --json").assert().success();
    let repaired = repaired.stderr(contains("smoothly")).get_output().stdout.clone();
    let info: serde_json::Value = serde_json::from_slice(&repaired).unwrap();
    let faces: Vec<_> = info["patches"].as_array().unwrap().iter().map(|p| &p["faces"]).collect();
    assert_eq!(faces, [2, 2], "each plane is a sheet");
    // The same as triangles of an .stl, which is repaired by default.
    let corners = |face: &str| {
        let vertices: Vec<&str> = cross.lines().filter_map(|line| line.strip_prefix("v ")).collect();
        let corner = |k: &str| format!("vertex {}\n", vertices[k.parse::<usize>().unwrap() - 1]);
        format!(
            "facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n",
            face.split(' ').map(corner).collect::<String>()
        )
    };
    let stl: String = cross.lines().filter_map(|line| line.strip_prefix("f ")).map(corners).collect();
    fs::write(path.join("cross.stl"), format!("solid s\n{stl}endsolid s\n")).unwrap();
    notes(path, "info cross.stl", &["smoothly"]);
    // Two such parts, and none that is valid.
    let again = &cross[..cross.find("f ").unwrap()];
    let two = format!("o a\n{cross}o b\n{again}f 7 8 9\nf 8 7 10\nf 7 8 11\nf 8 7 12\n");
    fs::write(path.join("two.obj"), two).unwrap();
    let refused = dermatome(path, "info two.obj").assert().code(2).get_output().stderr.clone();
    let refused = String::from_utf8(refused).unwrap();
    assert!(refused.contains("--repair") && !refused.contains("--keep-going"), "{refused}");
    // The third face at the edge is a copy of the first.
    fs::write(path.join("twice.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\nf 3 1 2\n")
        .unwrap();
    dermatome(path, "info twice.obj").assert().code(2);
    notes(path, "info twice.obj --repair", &["1 face was dropped"]);
    fs::write(path.join("bow.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nv -1 0 0\nv 0 -1 0\nf 1 2 3\nf 1 4 5\n")
        .unwrap();
    notes(path, "build bow.obj -o M", &["touched in a point"]);
}

/// Four faces at an edge that are all connected around its ends: the second sheet gets a taxel in the middle.
#[test]
fn sheets_that_meet_at_an_edge_alone_are_parted() {
    let folder = tempfile::tempdir().unwrap();
    let book = "v 0 0 0\nv 0 0 1\nv 1 .1 0\nv -1 0 0\nv .1 1 0\nv 0 -1 0\n\
                f 1 2 3\nf 2 1 4\nf 1 2 5\nf 2 1 6\nf 1 3 5\nf 1 4 6\nf 2 3 5\nf 2 4 6\n";
    fs::write(folder.path().join("book.obj"), book).unwrap();
    dermatome(folder.path(), "info book.obj").assert().code(2);
    notes(folder.path(), "info book.obj --repair", &["1 edge got a taxel in the middle"]);
}

/// A map is a skin too: its map is the same but for the rounding of the file's numbers.
#[test]
fn the_map_of_a_map_is_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write(path, "cap.obj", shapes::cap(500, 0.1, 1.0));
    dermatome(path, "build cap.obj -o A").assert().success();
    dermatome(path, "build A/map.glb -o B").assert().success();
    let [first, second] = ["A", "B"].map(|folder| read_map(&path.join(folder).join("map.glb")).unwrap());
    for (a, b) in first.patches.iter().zip(&second.patches) {
        assert_eq!((&a.name, &a.taxels.ids), (&b.name, &b.taxels.ids));
        let (a, b) = (&a.levels[0.into()], &b.levels[0.into()]);
        assert!(a.level.mesh == b.level.mesh, "the same mesh");
        let gap = a.uv.iter().zip(&b.uv).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        assert!(gap < 1e-4, "{gap} m");
    }
}
