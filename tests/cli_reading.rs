//! Reading what other people hold: other units, some patches of a file, other formats.
#![cfg(feature = "cli")]
#![allow(clippy::unwrap_used, reason = "a test may stop at a surprise")]

use std::{fs, path::Path};

use assert_cmd::Command;
use dermatome::{
    io::{read_draft, write_skin},
    mesh::{TriMesh, shapes},
    skin::Skin,
};
use predicates::{prelude::PredicateBooleanExt, str::contains};

fn dermatome(folder: &Path, words: &str) -> Command {
    let mut command = Command::new(assert_cmd::cargo::cargo_bin!("dermatome"));
    command.current_dir(folder).args(words.split_whitespace());
    command
}

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
    dermatome(folder.path(), "info mm.obj").assert().success().stderr(contains("--unit mm"));
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
    dermatome(folder.path(), "build two.obj --patch thumb -o M")
        .assert()
        .code(2)
        .stderr(contains("palm, tip left"));
    dermatome(folder.path(), "build two.obj --patch [ -o M").assert().code(2).stderr(contains("a name"));
}

#[test]
fn off_is_read_and_written() {
    let folder = folder_of_caps();
    dermatome(folder.path(), "convert m.obj m.off").assert().success().stderr(contains("OFF keeps"));
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
    for (text, said) in [
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n", "vertex 2 of 3: found the end of the file"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "line 6"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n2 0 1\n", "at least 3"),
        ("OFF\n3 1 0\n0 0 nan\n1 0 0\n0 1 0\n3 0 1 2\n", "a finite number"),
        ("OFF\n99999999999999 1 0\n0 0 0\n", "the end of the file"),
        ("OFF BINARY\n", "text"),
        ("4OFF\n1 0 0\n0 0 0 0\n", "text"),
        ("ply\n", "numbers of vertices"),
    ] {
        write(text);
        dermatome(folder.path(), "info t.off").assert().code(2).stderr(contains(said));
    }
}

#[test]
fn other_formats_are_named_with_what_converts_them() {
    let folder = tempfile::tempdir().unwrap();
    for (name, said) in
        [("a.step", "FreeCAD"), ("a.dae", "Blender"), ("a.usd", "glTF"), ("a.urdf", "mesh files")]
    {
        fs::write(folder.path().join(name), "x").unwrap();
        dermatome(folder.path(), &format!("info {name}")).assert().code(2).stderr(contains(said));
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
    fs::write(path.join("two.txt"), "face\n0\n1\n\n").unwrap();
    let size = |words: &str| {
        dermatome(path, &format!("convert strip.obj out.off {words}")).assert().success();
        let sheet = read_draft(&path.join("out.off")).unwrap().sheets.remove(0);
        (sheet.positions.len(), sheet.triangles.len())
    };
    assert_eq!(size("--faces two.txt"), (4, 2));
    assert_eq!(size("--material rubber*"), (4, 2));
    assert_eq!(size("--material shell --box 3,2,1,1,-1,-1"), (4, 2), "the last square");
    assert_eq!(size("--box 0,0,0,1.5,1,0"), (5, 3), "centres in the box");
    for (words, said) in [
        ("--material wood", "shell, rubber skin"),
        ("--box 0,0,0,1,1", "six numbers"),
        ("--box 5,5,5,6,6,6", "no face is left"),
        ("--faces strip.obj", "the number of a face"),
    ] {
        dermatome(path, &format!("build strip.obj -o M {words}")).assert().code(2).stderr(contains(said));
    }
    fs::write(path.join("far.txt"), "6\n").unwrap();
    dermatome(path, "build strip.obj -o M --faces far.txt").assert().code(2).stderr(contains("6 triangles"));
    dermatome(path, "convert strip.obj strip.glb").assert().success();
    dermatome(path, "info strip.glb").assert().success();
    dermatome(path, "convert strip.glb x.off --material a").assert().code(2).stderr(contains("it has none"));
    dermatome(path, "build strip.obj -o M --material rubber*").assert().success();
    dermatome(path, "flatten strip.obj -o f.obj --faces two.txt").assert().success();
}
