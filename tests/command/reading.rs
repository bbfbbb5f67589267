//! Reading what other people hold: other units, some patches of a file, other formats.

use std::{fs, path::Path};

use crate::common::{self, dermatome, notes, refuses};
use dermatome::io::{read_draft, read_map, write_skin};
use dermatome::mesh::{TriMesh, shapes};
use dermatome::skin::Skin;
use glam::DVec3;
use predicates::{prelude::PredicateBooleanExt, str::contains};

fn info(folder: &Path, words: &str) -> serde_json::Value {
    let output = dermatome(folder, words).assert().success();
    serde_json::from_slice(&output.get_output().stdout).unwrap()
}

fn scaled(mut mesh: TriMesh, factor: f64) -> TriMesh {
    mesh.positions.iter_mut().for_each(|p| *p *= factor);
    mesh
}

/// A cap in metres and the same in millimetres.
fn folder_of_caps() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let cap = shapes::cap(300, 0.1, 0.6);
    for (name, factor) in [("m.obj", 1.0), ("mm.obj", 1e3), ("in.obj", 1.0 / 0.0254)] {
        let skin = Skin::from_mesh("cap", scaled(cap.clone(), factor));
        write_skin(&folder.path().join(name), &skin).unwrap();
    }
    folder
}

#[test]
fn a_unit_makes_the_same_skin() {
    let folder = folder_of_caps();
    let metres = info(folder.path(), "info m.obj --json");
    for words in ["info mm.obj --unit mm --json", "info in.obj --unit in --json"] {
        let found = info(folder.path(), words);
        for what in ["area_m2", "spacing_mm"] {
            let [a, b] = [&metres, &found].map(|v| v["patches"][0][what].as_f64().unwrap());
            assert!((a - b).abs() < 1e-12 * a.abs(), "{words}: {what} {a} {b}");
        }
        assert_eq!(metres["patches"][0]["faces"], found["patches"][0]["faces"]);
    }
    notes(folder.path(), "info mm.obj", &["--unit mm"]);
    dermatome(folder.path(), "info mm.obj --unit mm").assert().success().stderr(contains("--unit").not());
    dermatome(folder.path(), "check mm.obj --unit mm").assert().success();
    dermatome(folder.path(), "build mm.obj --unit mm -o M").assert().success();
    dermatome(folder.path(), "flatten mm.obj --unit mm -o f.npz").assert().success();
    dermatome(folder.path(), "coarsen mm.obj --unit mm -o l.glb").assert().success();
    dermatome(folder.path(), "convert mm.obj back.ply --unit mm").assert().success();
    let back = read_draft(&folder.path().join("back.ply")).unwrap().sheets.remove(0);
    assert!(back.positions.iter().all(|p| p.length() < 0.11), "written in metres");
}

/// Two good sheets and one that lies on itself.
const THREE: &str = "o palm\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n\
                     o tip left\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf 5 6 7\n\
                     o broken\nv 9 0 0\nv 9.5 0 0\nv 9 1 0\nv 9 -1 0\nv 9 0 1\nf 8 9 10\nf 8 9 11\nf 8 9 12\n";

#[test]
fn patches_are_chosen_by_name() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("three.obj"), THREE).unwrap();
    dermatome(folder.path(), "build three.obj -o M").assert().code(2);
    let built = info(folder.path(), "build three.obj --patch palm -o M --json");
    assert_eq!(built["patches"].as_array().unwrap().len(), 1, "faults of other patches do not matter");
    assert_eq!(built["patches"][0]["name"], "palm");
    let built = info(folder.path(), "build three.obj --patch p?lm --patch t* -o M --json");
    let names: Vec<_> = built["patches"].as_array().unwrap().iter().map(|p| &p["name"]).collect();
    assert_eq!(names, ["palm", "tip left"]);
    dermatome(folder.path(), "flatten three.obj --patch palm -o p.obj").assert().success();
    dermatome(folder.path(), "convert three.obj p.ply --patch palm").assert().success();
    dermatome(folder.path(), "coarsen three.obj --patch palm -o p.glb").assert().success();
    fs::write(folder.path().join("two.obj"), &THREE[..THREE.find("o broken").unwrap()]).unwrap();
    refuses(folder.path(), "build two.obj --patch thumb -o M", &["palm, tip left"]);
    refuses(folder.path(), "build two.obj --patch [ -o M", &["a name"]);
}

#[test]
fn off_is_read_and_written() {
    let folder = folder_of_caps();
    notes(folder.path(), "convert m.obj m.off", &["OFF keeps"]);
    let [obj, off] =
        ["m.obj", "m.off"].map(|name| read_draft(&folder.path().join(name)).unwrap().sheets.remove(0));
    assert_eq!(obj.positions, off.positions, "every decimal is read back");
    assert_eq!(obj.triangles, off.triangles);
    let write = |text: &str| fs::write(folder.path().join("t.off"), text).unwrap();
    let sheet = || read_draft(&folder.path().join("t.off")).unwrap().sheets.remove(0);
    write(
        "# a square\nCOFF 4 1 0\n\n0 0 0 255 0 0\n1 0 0 0 0 0 # corner\n1 1 0 0 0 0\n0 1 0 1 1 1\n4 0 1 2 3 9 9 9\n",
    );
    assert_eq!(sheet().triangles, [[0, 1, 2], [0, 2, 3]], "polygons become fans, colours are left out");
    write("NOFF\n3 1 0\n0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n3 0 1 2\n");
    assert_eq!(sheet().normals.unwrap().len(), 3);
    write("3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
    assert_eq!(sheet().triangles.len(), 1, "without the word OFF");
    write("OFF\n4 1 0\n0 0 0\n1 0\n0\n1 1 0\n0 1 0\n4 0 1\n2 # goes on\n\n3\n");
    assert_eq!(sheet().triangles, [[0, 1, 2], [0, 2, 3]], "a vertex and a face over several lines");
    for (text, said) in [
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n", "vertex 2 of 3: found the end of the file"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "line 6"),
        ("OFF\n3 1 0\n0 0 nan\n1 0 0\n0 1 0\n3 0 1 2\n", "a finite number"),
        ("4OFF\n1 0 0\n0 0 0 0\n", "uses \"4OFF\""),
        ("ply\n", "numbers of vertices"),
    ] {
        write(text);
        refuses(folder.path(), "info t.off", &[said]);
    }
}

#[test]
fn other_formats_are_named_with_what_converts_them() {
    let folder = tempfile::tempdir().unwrap();
    for (name, said) in [
        ("a.step", "FreeCAD"),
        ("a.fbx", "Blender"),
        ("a.usd", "glTF"),
        ("a.msh", "Gmsh with `meshio convert`"),
        ("a.xacro", "`xacro"),
        ("a.sdf", "a .urdf"),
    ] {
        fs::write(folder.path().join(name), "x").unwrap();
        refuses(folder.path(), &format!("info {name}"), &[said]);
    }
}

/// Of four patches two are not valid: both are named, and the others are mapped if that is asked for.
#[test]
fn all_bad_patches_are_named_and_the_good_ones_mapped() {
    let folder = tempfile::tempdir().unwrap();
    let second =
        "o worse\nv 19 0 0\nv 19.5 0 0\nv 19 1 0\nv 19 -1 0\nv 19 0 1\nf 13 14 15\nf 13 14 16\nf 13 14 17\n";
    fs::write(folder.path().join("four.obj"), THREE.to_owned() + second).unwrap();
    let both = contains("broken").and(contains("worse")).and(contains("--keep-going"));
    dermatome(folder.path(), "build four.obj -o M").assert().code(2).stderr(both);
    let output = dermatome(folder.path(), "build four.obj -o M --keep-going --json").assert().code(1);
    let output =
        output.stderr(contains("broken: left out").and(contains("worse: left out"))).get_output().clone();
    let built: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let names: Vec<_> = built["patches"].as_array().unwrap().iter().map(|p| &p["name"]).collect();
    assert_eq!(names, ["palm", "tip left"]);
    dermatome(folder.path(), "build four.obj --patch palm -o M --keep-going").assert().success();
}

/// Faces of a file are chosen by a list, by material and by a box.
#[test]
fn faces_are_chosen() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    // A strip of three squares, the middle one of another material.
    let text = "v 0 0 0\nv 1 0 0\nv 2 0 0\nv 3 0 0\nv 0 1 0\nv 1 1 0\nv 2 1 0\nv 3 1 0\nusemtl shell\n\
                f 1 2 6 5\nusemtl rubber skin\nf 2 3 7 6\nusemtl shell\nf 3 4 8 7\n";
    fs::write(path.join("strip.obj"), text).unwrap();
    let size = |words: &str| {
        dermatome(path, &format!("convert strip.obj out.off {words}")).assert().success();
        let sheet = read_draft(&path.join("out.off")).unwrap().sheets.remove(0);
        (sheet.positions.len(), sheet.triangles.len())
    };
    assert_eq!(size("--material rubber*"), (4, 2));
    assert_eq!(size("--material shell --box 3,2,1,1,-1,-1"), (4, 2), "the last square");
    assert_eq!(size("--box 0,0,0,1.5,1,0"), (5, 3), "centres in the box");
    assert_eq!(size("--facing z,0deg"), (8, 6), "all faces");
    for (words, said) in [
        ("--facing -z,179", "no face is left"),
        ("--facing z,200", "degrees from 0 to 180"),
        ("--facing up", "x, -x, y"),
        ("--box hand:0,0,0,1,1,1", "no link of the name hand"),
        ("--material wood", "shell, rubber skin"),
        ("--box 0,0,0,1,1", "six numbers"),
        ("--box 5,5,5,6,6,6", "no face is left"),
        ("--facing 0,0,1,20deg,x", "x, -x, y"),
        ("--facing 0,0,1,20rad", "degrees from 0 to 180"),
        ("--box 0,0,0,1,1,1x", "six numbers"),
    ] {
        refuses(path, &format!("build strip.obj -o M {words}"), &[said]);
    }
    dermatome(path, "convert strip.obj strip.glb").assert().success();
    dermatome(path, "info strip.glb").assert().success();
    refuses(path, "convert strip.glb x.off --material a", &["it has none"]);
    dermatome(path, "build strip.obj -o M --material rubber*").assert().success();
    dermatome(path, "flatten strip.obj -o f.obj --material rubber*").assert().success();
}

/// What numpy users have, and what they get back.
#[test]
fn arrays_of_numpy_are_read_and_flat_meshes_written() {
    let folder = folder_of_caps();
    let path = folder.path();
    dermatome(path, "flatten m.obj -o flat.npz -o flat.obj").assert().success();
    refuses(path, "flatten m.obj -o flat.ply", &["obj, npz"]);
    let of = |name: &str| read_draft(&path.join(name)).unwrap().sheets.remove(0);
    let obj = of("m.obj");
    for name in ["flat.npz", "flat.obj"] {
        assert_eq!(
            (of(name).positions, of(name).triangles),
            (obj.positions.clone(), obj.triangles.clone()),
            "{name}"
        );
    }
    dermatome(path, "build flat.npz -o M").assert().success();
    fs::write(path.join("not.npz"), "x").unwrap();
    refuses(path, "info not.npz", &["zip"]);
}

/// `V` and `F` as libigl saves them, quadrangles, and faces that name vertices that do not exist.
#[test]
fn arrays_are_judged() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.npz");
    let save = |arrays: [Vec<u8>; 2]| {
        let mut zip = zip::ZipWriter::new(fs::File::create(&path).unwrap());
        let options =
            zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
        for (name, array) in ["V.npy", "F.npy"].into_iter().zip(arrays) {
            zip.start_file(name, options).unwrap();
            std::io::Write::write_all(&mut zip, &array).unwrap();
        }
        zip.finish().unwrap();
    };
    let write = |v: &[[f64; 3]], f: &[i32], corners: usize| {
        let v_bytes: Vec<u8> = v.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
        let f_bytes: Vec<u8> = f.iter().flat_map(|x| x.to_le_bytes()).collect();
        let shape = [f.len() / corners, corners];
        save([common::npy("<f8", &[v.len(), 3], &v_bytes), common::npy("<i4", &shape, &f_bytes)]);
    };
    let square = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
    write(&square, &[0, 1, 2, 3], 4);
    assert_eq!(read_draft(&path).unwrap().sheets[0].triangles, [[0, 1, 2], [0, 2, 3]]);
    // Column by column, as Eigen keeps matrices.
    let column = |k: usize| square.iter().map(move |p| p[k]);
    let columns: Vec<u8> = (0..3).flat_map(column).flat_map(f64::to_le_bytes).collect();
    let faces: Vec<u8> = [0, 0, 1, 2, 2, 3_i32].iter().flat_map(|x| x.to_le_bytes()).collect();
    save([
        common::npy_ordered("<f8", &[4, 3], &columns, "True"),
        common::npy_ordered("<i4", &[2, 3], &faces, "True"),
    ]);
    let sheet = read_draft(&path).unwrap().sheets.remove(0);
    assert_eq!(sheet.positions, square.map(glam::DVec3::from_array));
    assert_eq!(sheet.triangles, [[0, 1, 2], [0, 2, 3]]);
    for (f, said) in [([0, 1, 4], "from 0 to 3"), ([0, -1, 2], "-1")] {
        write(&square, &f, 3);
        refuses(folder.path(), "info m.npz", &[said]);
    }
    write(&[[0., 0., f64::NAN], [1., 0., 0.], [0., 1., 0.]], &[0, 1, 2], 3);
    refuses(folder.path(), "info m.npz", &["finite"]);
}

/// Strips of triangles in PLY: every second one is turned, and -1 starts again.
#[test]
fn strips_of_ply_are_triangles() {
    let folder = tempfile::tempdir().unwrap();
    let strip = |numbers: &str| {
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n\
             element tristrips 1\nproperty list int int vertex_indices\nend_header\n\
             0 0 0\n1 0 0\n0 1 0\n1 1 0.2\n0 2 0\n1 2 0.1\n{numbers}\n"
        );
        fs::write(folder.path().join("strip.ply"), text).unwrap();
    };
    let triangles = || read_draft(&folder.path().join("strip.ply")).unwrap().sheets.remove(0).triangles;
    strip("6 0 1 2 3 4 5");
    assert_eq!(triangles(), [[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5]]);
    strip("7 0 1 2 -1 3 4 5");
    assert_eq!(triangles(), [[0, 1, 2], [3, 4, 5]]);
    strip("3 0 1 6");
    refuses(folder.path(), "info strip.ply", &["tristrips 0"]);
}

/// The taxels of a fingertip of 12, with normals: too few for planes, but the normals bend with them.
#[test]
fn a_fingertip_of_few_taxels_is_meshed() {
    let folder = tempfile::tempdir().unwrap();
    let text = "id,x,y,z,nx,ny,nz\n11,-0.0209,0,0,-1,0,0\n10,-0.0187,0.0016,0.0025,-0.5,0.471671,0.72631\n\
        9,-0.0187,0.00315,0,-0.5,0.866025,0\n8,-0.0187,0.0016,-0.0025,-0.5,0.471671,-0.72631\n\
        7,-0.0141,0.0022,-0.0038,0,0.5,-0.866025\n6,-0.0141,0.0044,0,0,1,0\n\
        5,-0.0141,0.0022,0.0038,0,0.5,0.866025\n4,-0.0125,-0.0014,-0.0044,0,0,-1\n\
        3,-0.0125,-0.0014,0.0044,0,0,1\n2,-0.0103,0.0022,0.0038,0,0.5,0.866025\n\
        1,-0.0103,0.0044,0,0,1,0\n0,-0.0103,0.0022,-0.0038,0,0.5,-0.866025\n";
    fs::write(folder.path().join("tip.csv"), text).unwrap();
    let found = info(folder.path(), "info tip.csv --json");
    let patches = found["patches"].as_array().unwrap();
    assert_eq!((patches.len(), patches[0]["vertices"].as_u64()), (1, Some(12)), "{found}");
    dermatome(folder.path(), "build tip.csv -o M").assert().success();
}

/// A flat sheet of bare taxels bulges to neither side.
#[test]
fn the_outside_that_was_guessed_is_turned_over() {
    let folder = tempfile::tempdir().unwrap();
    let taxels: String = (0..36).map(|k| format!("{k},{},{},0\n", k % 6, k / 6)).collect();
    fs::write(folder.path().join("flat.csv"), format!("id,x,y,z\n{taxels}")).unwrap();
    let normal = |words: &str| {
        dermatome(folder.path(), &format!("convert flat.csv out.obj {words}")).assert().success();
        read_draft(&folder.path().join("out.obj")).unwrap().sheets[0].normals.as_ref().unwrap()[0].z
    };
    notes(folder.path(), "info flat.csv", &["--outside"]);
    assert_eq!(
        [normal(""), normal("--outside -z"), normal("--outside 0,0.1,-2"), normal("--outside z")],
        [1., -1., -1., 1.]
    );
    refuses(folder.path(), "info flat.csv --outside up", &["three numbers"]);
}

/// A part of 1e13 m, and one of which the area is no number.
#[test]
fn absurd_sizes_are_found_and_printed_short() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("big.obj");
    for (size, is_read) in [("1e11", true), ("1e13", false), ("1e100", false), ("1e300", false)] {
        fs::write(
            &path,
            format!("v 0 0 0\nv {size} 0 0\nv 0 {size} 0\nv {size} {size} 0\nf 1 2 3\nf 2 4 3\n"),
        )
        .unwrap();
        let code = i32::from(!is_read);
        let found =
            dermatome(folder.path(), "check big.obj").assert().code(code).stdout(contains("doubtful-unit"));
        assert!(found.get_output().stdout.len() < 600, "{size}");
        let read = dermatome(folder.path(), "info big.obj").assert();
        assert_eq!(read.get_output().status.success(), is_read, "{size}");
        assert!(read.get_output().stdout.len() < 400, "{size}");
    }
}

/// Many remarks of one kind are one note, and one of a kind is in the singular.
#[test]
fn notes_are_gathered() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    // Squares of two triangles whose corners are split, as for normals.
    let square = |k: usize| {
        let corners = [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]];
        let vertices: String = corners.iter().map(|[x, y]| format!("v {} {y} 0\n", x + 3 * k)).collect();
        let v = 6 * k;
        format!("o part{k}\n{vertices}f {} {} {}\nf {} {} {}\n", v + 1, v + 2, v + 3, v + 4, v + 5, v + 6)
    };
    fs::write(path.join("many.obj"), (0..6).map(square).collect::<String>()).unwrap();
    let notes = |words: &str| {
        let run = dermatome(path, words).assert().success();
        String::from_utf8(run.get_output().stderr.clone()).unwrap()
    };
    let gathered = notes("info many.obj");
    let welded = "note: part0: 6 vertices were welded into 4 taxels; 5 more such notes, -v lists them\n";
    assert!(gathered.contains(welded) && gathered.matches("welded").count() == 1, "{gathered}");
    assert_eq!(notes("info many.obj -v").matches("were welded into 4 taxels").count(), 6);
    fs::write(path.join("one.csv"), "id,x,y,z\n1,0,0,0\n2,.01,0,0\n3,0,.01,0\n4,.01,.01,0\n5,9,9,9\n")
        .unwrap();
    assert!(notes("info one.csv").contains("1 taxel was left out"));
}

/// Every command names what it wrote, and `build` counts ids that say nothing.
#[test]
fn commands_name_what_they_wrote() {
    let folder = folder_of_caps();
    let path = folder.path();
    let wrote = |words: &str, names: &[&str]| {
        let run = dermatome(path, words).assert().success();
        let said = String::from_utf8(run.get_output().stderr.clone()).unwrap();
        let line = said.lines().find_map(|line| line.strip_prefix("wrote ")).unwrap_or_default();
        assert_eq!(line.split(", ").collect::<Vec<_>>(), names, "{words}: {said}");
        said
    };
    fs::write(path.join("a.csv"), "id,x,y,z\n0,0,0,0\n0,.01,0,0\n4294967295,0,.01,0\n7,.01,.01,0\n").unwrap();
    fs::write(path.join("c.csv"), "x,y,z\n0,0,0\n").unwrap();
    wrote("convert a.csv a.glb", &["a.glb"]);
    wrote("convert a.glb b.csv", &["b.csv", "b.triangles.csv"]);
    let said = wrote(
        "build a.csv -o M",
        &["M/map.glb", "M/map.exr", "M/report.html", "M/report.json", "M/timings.json"],
    );
    assert!(said.contains("3 of 4 taxels have a placeholder id"), "{said}");
    wrote("coarsen a.glb -o l.glb", &["l.glb"]);
    wrote("flatten a.glb -o f.obj -o f.npz", &["f.obj", "f.npz"]);
    wrote("lookup M/map.glb c.csv -o o.csv", &["o.csv"]);
    wrote("plot M/map.glb -o p.svg", &["p.svg"]);
    wrote("simulate -o s.g2o --taxels 20 --anchors 5", &["s.g2o"]);
    wrote("calibrate s.g2o -o s.csv", &["s.csv"]);
    dermatome(path, "convert a.glb q.ply --quiet").assert().success().stderr("");
}

/// A patch whose map the `f32` of a file cannot hold, here since a pixel is wider than it is by far, is
/// refused by name before anything is written, and left out on request.
#[test]
fn a_patch_that_a_map_file_cannot_hold_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let square = |name: &str, side: f64, z: f64, first: usize| {
        let mesh = shapes::sheet(12, 12, |i, j| DVec3::new(side * f64::from(i), side * f64::from(j), z));
        let vertices = mesh.positions.iter().map(|p| format!("v {} {} {}\n", p.x, p.y, p.z));
        let faces = mesh.triangles.iter().map(|t| t.map(|v| v.index() + first));
        let faces = faces.map(|[a, b, c]| format!("f {a} {b} {c}\n"));
        vertices.chain([format!("o {name}\n")]).chain(faces).collect::<String>()
    };
    let count = shapes::sheet(12, 12, |_, _| DVec3::ZERO).positions.len();
    let text = square("large", 1e5, 0.0, 1) + &square("small", 1e-6, 1.0, 1 + count);
    fs::write(folder.path().join("two.obj"), text).unwrap();
    let refused = dermatome(folder.path(), "build two.obj -o M --pixel-mm 1e7").assert().code(2);
    refused.stderr(contains("\"small\"").and(contains("--keep-going")));
    assert!(!folder.path().join("M/map.glb").exists());
    let kept = dermatome(folder.path(), "build two.obj -o M --pixel-mm 1e7 --keep-going").assert().code(1);
    kept.stderr(contains("\"small\"").and(contains("left out")));
    let map = read_map(&folder.path().join("M/map.glb")).unwrap();
    let names: Vec<&str> = map.patches.iter().map(|patch| patch.name.as_str()).collect();
    assert_eq!(names, ["large"]);
}
