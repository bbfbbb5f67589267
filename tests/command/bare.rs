//! Bare taxels as a user has them: iCub positions, tables and clouds of points.

use std::{fmt::Write, fs, path::PathBuf};

use crate::common::{dermatome, notes, refuses};
use dermatome::io::read_draft;
use dermatome::skin::{Presence, RemarkKind};
use predicates::{prelude::*, str::contains};
use tempfile::TempDir;

/// A folder with one file.
fn folder_with(name: &str, content: impl AsRef<[u8]>) -> (TempDir, PathBuf) {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, content).unwrap();
    (folder, path)
}

/// Two modules of twelve slots side by side, with a thermal pad at slots 6 and 10; the second
/// module has no pads.
fn positions() -> String {
    let mut text = String::from("name\tl_shin\nspatial_sampling taxel\ntaxel2Repr ( ");
    for slot in 0..24 {
        let code = match slot {
            6 | 10 => -2,
            18 | 22 => -1,
            slot => slot / 12 * 12 + 3,
        };
        write!(text, "{code}  ").unwrap();
    }
    text += ")\n\n[calibration]\n";
    for slot in 0..24 {
        let (i, j) = (f64::from(slot % 4 + slot / 12 * 4), f64::from(slot % 12 / 4));
        if slot == 18 || slot == 22 {
            text += "0.0 0.0 0.0\t0 0 0\n";
        } else {
            writeln!(text, "{} {}\t0.02   0 0 1", 0.0065 * (i + 0.5 * (j % 2.0)), 0.0056 * j).unwrap();
        }
    }
    text
}

#[test]
fn positions_of_the_icub_keep_slots_pads_and_modules() {
    let (_folder, path) = folder_with("shin.txt", positions());
    let draft = read_draft(&path).unwrap();
    let sheet = &draft.sheets[0];
    assert_eq!((sheet.name.as_str(), sheet.positions.len()), ("l_shin", 24));
    assert_eq!(sheet.ids.as_ref().unwrap()[17].0, 17, "the number of the slot");
    let presence = sheet.presence.as_ref().unwrap();
    let expected = |slot| match slot {
        6 | 10 => Presence::ThermalPad,
        18 | 22 => Presence::Absent,
        _ => Presence::Present,
    };
    assert!((0..24).all(|slot| presence[slot] == expected(slot)));
    assert_eq!(sheet.modules.as_ref().unwrap()[11..13], [0, 1]);
    assert_eq!(draft.remarks, []);
}

#[test]
fn convert_and_build_take_positions_and_tell_what_was_assumed() {
    let (folder, _) = folder_with("shin.txt", positions());
    notes(&folder, "convert shin.txt skin.glb", &["22 bare taxels were joined by", "2 empty slots"]);
    notes(&folder, "check skin.glb", &[]);
    let bare = "note: l_shin: bare: its taxels have no triangles";
    notes(&folder, "check shin.txt", &[]).stdout("no findings\n").stderr(predicate::str::starts_with(bare));
    notes(&folder, "build shin.txt -o out", &[]);
    assert!(folder.path().join("out/map.glb").exists());
}

#[test]
fn a_list_of_another_length_is_told() {
    let (_folder, path) = folder_with("shin.txt", positions().replace("-1  ", ""));
    let draft = read_draft(&path).unwrap();
    assert_eq!(draft.remarks.len(), 1);
    let RemarkKind::PassedOver { what } = &draft.remarks[0].kind else { panic!("{}", draft.remarks[0]) };
    assert!(what.contains("22 entries for 24 rows"), "{what}");
}

#[test]
fn a_file_that_was_cut_is_told() {
    let cut = positions().lines().map(|line| format!("{line}\n")).take(5 + 22).collect::<String>();
    let (_folder, path) = folder_with("shin.txt", cut.replacen("( 3  ", "( 999  ", 1));
    let remarks: Vec<String> = read_draft(&path).unwrap().remarks.iter().map(ToString::to_string).collect();
    for said in
        ["22 rows are not a whole number of modules", "1 entries of taxel2Repr name slots beyond the 22 rows"]
    {
        assert!(remarks.iter().any(|r| r.contains(said)), "{said}: {remarks:?}");
    }
}

/// Each broken line, what replaces it, and what the error says.
#[test]
fn other_texts_are_refused_with_their_line() {
    for (from, to, said) in [
        ("name\tl_shin", "Dear reader,", "line 1"),
        ("[calibration]", "[contacts]", "line 5"),
        ("0.02   0 0 1", "0.02   0 0", "line 6"),
        ("0.02   0 0 1", "0.02   0 0 1 1", "line 6"),
        ("0.02   0 0 1", "nan   0 0 1", "line 6"),
        ("0.02   0 0 1", "1e400 0 0 1", "line 6"),
        ("0.02   0 0 1", "two   0 0 1", "line 6"),
        ("( 3  ", "( -7  ", "entry 1 of taxel2Repr"),
        (")\n", "\n", "line 3"),
        ("spatial_sampling taxel", "name\tother", "line 2"),
    ] {
        let (_folder, path) = folder_with("shin.txt", positions().replacen(from, to, 1));
        let error = read_draft(&path).unwrap_err().to_string();
        assert!(error.contains(said) && error.len() < 400, "{from} -> {to}: {error}");
    }
    for content in
        [b"\xff\xfe\x00binary".to_vec(), b"[calibration]\n".to_vec(), vec![b'x'; 1 << 20], b"\n\n\n".to_vec()]
    {
        let (_folder, path) = folder_with("shin.txt", content);
        assert!(read_draft(&path).unwrap_err().to_string().len() < 400);
    }
}

/// A lattice of 6 x 6 points, line by line.
fn points(line: impl Fn(f64, f64) -> String) -> String {
    (0..36).map(|k| line(0.005 * f64::from(k % 6), 0.005 * f64::from(k / 6))).collect()
}

/// The same points as a glTF primitive of points.
fn gltf_of_points() -> String {
    use base64::{Engine as _, engine::general_purpose::STANDARD};
    let place = |k: u8| [0.005 * f32::from(k % 6), 0.005 * f32::from(k / 6), 0.0];
    let bytes: Vec<u8> = (0..36).flat_map(place).flat_map(f32::to_le_bytes).collect();
    let data = STANDARD.encode(&bytes);
    let most = 0.005_f32 * 5.0;
    serde_json::json!({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 0}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 36,
                       "min": [0, 0, 0], "max": [most, most, 0]}],
        "bufferViews": [{"buffer": 0, "byteLength": bytes.len()}],
        "buffers": [{"byteLength": bytes.len(), "uri": format!("data:application/octet-stream;base64,{data}")}],
    })
    .to_string()
}

#[test]
fn points_without_faces_are_meshed_from_every_kind_of_file() {
    let header = "ply\nformat ascii 1.0\nelement vertex 36\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    for (name, content) in [
        ("p.csv", format!("x,y,z\n{}", points(|x, y| format!("{x},{y},0\n")))),
        ("p.ply", header.to_owned() + &points(|x, y| format!("{x} {y} 0\n"))),
        ("p.obj", points(|x, y| format!("v {x} {y} 0\n"))),
        ("p.gltf", gltf_of_points()),
    ] {
        let (folder, _) = folder_with(name, content);
        let run = notes(&folder, &format!("info {name} --json"), &[]);
        run.stdout(contains("\"faces\": 50").or(contains("\"faces\":50")));
    }
}

#[test]
fn the_gap_is_an_option_and_its_range_is_told() {
    let two = |x: f64, y: f64| format!("{x},{y},0\n{},{y},0\n", x + 0.025 + 0.016);
    let (folder, _) = folder_with("two.csv", format!("x,y,z\n{}", points(two)));
    let patches = |run: assert_cmd::assert::Assert| {
        let rows = String::from_utf8_lossy(&run.get_output().stdout).into_owned();
        rows.lines().filter(|row| row.starts_with("two")).count()
    };
    assert_eq!(patches(notes(&folder, "info two.csv", &["a larger --gap joins pieces"])), 2);
    assert_eq!(patches(notes(&folder, "info two.csv --gap 4", &[])), 1);
    let check = |words: &str| notes(&folder, &format!("check two.csv --quiet {words}"), &[]).stderr("");
    check("").stdout(predicate::str::starts_with("warning: two: bare-pieces: "));
    check("--gap 4").stdout("no findings\n");
    check("--gap 4 --json").stdout("{\n  \"schema\": \"dermatome.check/1\",\n  \"findings\": []\n}\n");
    refuses(&folder, "convert two.csv x.glb --gap 0.5", &["a number from 1 to 20"]);
}

#[test]
fn a_cloud_is_refused_in_three_lines() {
    let scatter = |k: f64, by: f64| (k * by).fract();
    let cloud: String = (0..500)
        .map(f64::from)
        .map(|k| format!("{},{},{}\n", scatter(k, 0.618), scatter(k, 0.7549), scatter(k, 0.5698)))
        .collect();
    let (folder, _) = folder_with("cloud.csv", format!("x,y,z\n{cloud}"));
    refuses(&folder, "convert cloud.csv x.glb", &["do not lie on a surface", "help: give the taxels"]);
    assert!(!folder.path().join("x.glb").exists());
}

/// A vendor's table in which a row of taxels stands again, rounded to the digits of an `f32`, a
/// printer or a ruler: what is written can be read back.
#[test]
fn rounded_copies_are_merged_and_the_skin_reads_back() {
    for digits in [4, 5, 9] {
        let line = |across: f64, along: f64| {
            let [x, y, z] = [across + 0.1 / 3.0, along + 0.1 / 7.0, 0.03 + across * along];
            let copy = format!("{x:.digits$},{y:.digits$},{z:.digits$}\n");
            format!("{x},{y},{z}\n{}", if along == 0.0 { &copy } else { "" })
        };
        let (folder, path) = folder_with("near.csv", format!("x,y,z\n{}", points(line)));
        let run = |words: &str| notes(&folder, words, &[]);
        let said = ["6 taxels lie at the position of another one (up to "];
        notes(&folder, "convert near.csv near.glb", &said).stderr(contains("without area").not());
        run("info --json near.glb").stdout(contains("\"vertices\": 36"));
        run("check near.glb");
        run("check near.csv").stdout(contains("duplicate-position: 6 taxels"));
        run("build near.glb -o of-glb");
        run(&format!("build {} -o of-csv", path.display()));
    }
}

/// A table of calibrated taxels is a table of bare taxels: they need no graph that is a
/// triangulation.
#[test]
fn calibrated_taxels_are_joined_and_keep_what_is_known_of_them() {
    let folder = tempfile::tempdir().unwrap();
    for model in ["positions", "poses"] {
        let run = |words: &str| dermatome(&folder, words).assert().success();
        run(&format!("simulate -o o.g2o --model {model} --taxels 80"));
        run("calibrate o.g2o -o t.csv");
        let joined = notes(&folder, "convert t.csv skin.glb", &["80 bare taxels were joined"]);
        let told = String::from_utf8_lossy(&joined.get_output().stderr);
        assert_eq!(told.contains("no normals determine the outside"), model == "positions", "{told}");
        run("plot skin.glb --show sigma -o s.svg");
    }
}
