//! `sample` and `plot --readings` as a user runs them.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use std::{collections::HashMap, fs, path::Path};

use assert_cmd::{Command, assert::Assert};
use dermatome::{
    io::{read_map, write_map},
    mesh::shapes,
    pipeline::{BuildOptions, build},
    skin::Skin,
};
use predicates::{prelude::*, str::contains};
use tempfile::TempDir;

fn dermatome(folder: &Path, words: &str) -> Assert {
    let mut command = Command::new(assert_cmd::cargo::cargo_bin!("dermatome"));
    command.current_dir(folder).args(words.split_whitespace()).assert()
}

/// A map of a cap, and a recording of a press in which this share of the taxels is dead.
fn folder_with_a_recording(dead: f64) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let skin = Skin::from_mesh("cap", shapes::cap(400, 0.05, 1.0));
    write_map(&folder.path().join("map.glb"), &build(&skin, &BuildOptions::default()).unwrap()).unwrap();
    dermatome(folder.path(), &format!("touch map.glb -o touch.csv --presses 1 --dead {dead} --rate-hz 40"))
        .success();
    folder
}

/// The rows of a table of one channel: level and taxel id to value; of level 0 alone.
fn taxels(folder: &Path, table: &str) -> HashMap<String, String> {
    let text = fs::read_to_string(folder.join(table)).unwrap();
    let rows = text.lines().skip(1).map(|row| row.split(',').map(str::to_owned).collect::<Vec<_>>());
    rows.filter(|row| row[1] == "0").map(|row| (row[3].clone(), row[4].clone())).collect()
}

#[test]
fn rendered_frames_give_back_the_readings() {
    let folder = folder_with_a_recording(0.0);
    for how in ["", "--pack", "--interpolate natural --pixel-mm 0.7", "--interpolate field --size 90 100"] {
        let name = if how == "--pack" { "L0" } else { "cap.L0" };
        dermatome(folder.path(), &format!("render map.glb touch.csv -o frames --from 25 --to 25 {how}"))
            .success();
        let sample = format!("sample map.glb frames/{name}.000025.exr -o out.csv {how}");
        let output = dermatome(folder.path(), &format!("{sample} --json")).success();
        let report: serde_json::Value = serde_json::from_slice(&output.get_output().stdout).unwrap();
        let of_channel = &report["channels"][0];
        let number = |key: &str| of_channel[key].as_f64().unwrap();
        assert_eq!(of_channel["name"], "force");
        assert_eq!((&of_channel["unit"], &of_channel["pixel_unit"]), (&"N".into(), &"N/m^2".into()));
        assert!(number("residual") < 1e-5 * number("largest_pixel"), "{how}: {report}");
        let found = taxels(folder.path(), "out.csv");
        let text = fs::read_to_string(folder.path().join("touch.csv")).unwrap();
        let mut lines = text.lines();
        let ids: Vec<&str> = lines.next().unwrap().split(',').skip(1).collect();
        let truth: Vec<&str> = lines.nth(25).unwrap().split(',').skip(1).collect();
        let largest =
            truth.iter().filter_map(|x| x.parse::<f64>().ok()).filter(|x| !x.is_nan()).fold(0.0, f64::max);
        for (id, truth) in ids.iter().zip(&truth) {
            let found = &found[id.split('.').next().unwrap()];
            let off = (found.parse::<f64>().unwrap() - truth.parse::<f64>().unwrap()).abs();
            assert!(off < 1e-3 * largest, "{how}: taxel {id}: {found} for {truth}");
        }
        fs::remove_dir_all(folder.path().join("frames")).unwrap();
    }
}

/// Positions are linear on every triangle, so an image of them samples to the positions.
#[test]
fn images_of_positions_give_the_positions_of_the_taxels() {
    let folder = tempfile::tempdir().unwrap();
    let skin = Skin::from_mesh("cap", shapes::cap(200, 0.05, 1.0));
    dermatome::io::write_skin(&folder.path().join("cap.glb"), &skin).unwrap();
    dermatome(folder.path(), "build cap.glb -o .").success();
    dermatome(folder.path(), "sample map.glb map.exr -o out.csv --image cap/L0 --channel position.X")
        .success()
        .stdout(contains("position.X: ").and(contains("round-trip residual")));
    let map = read_map(&folder.path().join("map.glb")).unwrap();
    let patch = map.patches.iter().next().unwrap();
    let found = taxels(folder.path(), "out.csv");
    for (id, place) in patch.taxels.ids.iter().zip(&skin.patches.iter().next().unwrap().mesh.positions) {
        let x: f64 = found[&id.to_string()].parse().unwrap();
        assert!((x - place.x).abs() < 1e-6, "taxel {id}: {x} for {}", place.x);
    }
}

/// A frame with static channels says itself what its pixels show, packed or not, and `sample` takes
/// its readings, with their units, not its places.
#[test]
fn frames_with_static_channels_show_where_the_taxels_are() {
    let folder = folder_with_a_recording(0.0);
    for (how, name) in [("", "cap.L0"), ("--pack --size 150 120", "L0"), ("--interpolate field", "cap.L1")] {
        let frames = format!("render map.glb touch.csv -o frames --from 25 --to 25 --static {how}");
        dermatome(folder.path(), &frames).success();
        let sample = format!("sample map.glb frames/{name}.000025.exr -o out.csv {how}");
        dermatome(folder.path(), &sample).success().stdout(contains("force: ").and(contains(" N/m^2")));
        let text = fs::read_to_string(folder.path().join("out.csv")).unwrap();
        assert!(text.starts_with("patch,level,vertex,taxel_id,force[N]\n"), "{text:.60}");
        if name.ends_with("L0") {
            dermatome(folder.path(), &format!("{sample} --channel position.X")).success();
            let map = read_map(&folder.path().join("map.glb")).unwrap();
            let patch = map.patches.iter().next().unwrap();
            let found = taxels(folder.path(), "out.csv");
            let finest = &patch.levels.iter().next().unwrap().level.mesh;
            for (id, place) in patch.taxels.ids.iter().zip(&finest.positions) {
                let x: f64 = found[&id.to_string()].parse().unwrap();
                assert!((x - place.x).abs() < 1e-6, "{how}: taxel {id}: {x} for {}", place.x);
            }
        }
        fs::remove_dir_all(folder.path().join("frames")).unwrap();
    }
    dermatome(folder.path(), "render map.glb touch.csv -o out.npz --static")
        .code(2)
        .stderr(contains("--static").and(contains("folder")));
}

/// A header that asks for more pixels than the file can hold is refused before any is read.
#[test]
fn absurd_sizes_in_headers_are_refused() {
    let folder = folder_with_a_recording(0.0);
    dermatome(folder.path(), "render map.glb touch.csv -o frames --from 25 --to 25").success();
    let path = folder.path().join("frames/cap.L0.000025.exr");
    let mut bytes = fs::read(&path).unwrap();
    for window in ["dataWindow", "displayWindow"] {
        let name = bytes.windows(window.len()).position(|w| w == window.as_bytes()).unwrap();
        // Behind the name, `box2i` and the size there are the least and the largest x and y.
        let largest = name + window.len() + 1 + "box2i".len() + 1 + 4 + 8;
        bytes[largest..largest + 8].copy_from_slice(&[0xff, 0xff, 0xff, 0x00, 0xff, 0xff, 0xff, 0x00]);
    }
    fs::write(&path, bytes).unwrap();
    dermatome(folder.path(), "sample map.glb frames/cap.L0.000025.exr -o out.csv")
        .code(2)
        .stderr(contains("16777216 x 16777216").and(contains("bytes")));
}

#[test]
fn images_that_do_not_fit_are_refused_with_what_makes_them_fit() {
    let folder = folder_with_a_recording(0.05);
    dermatome(folder.path(), "render map.glb touch.csv -o frames --from 25 --to 25 --size 40 50").success();
    dermatome(folder.path(), "render map.glb touch.csv -o image.npy --from 25 --to 25 --level 0").success();
    let image = "sample map.glb frames/cap.L0.000025.exr -o out.csv";
    for (words, said) in [
        (image.to_owned(), "50 x 40 pixels"),
        (format!("{image} --image nose/L0"), "nose/L0"),
        (format!("{image} --channel heat"), "channel heat"),
        (format!("{image} --size 40 50 --unit N,K"), "--unit"),
        (format!("{image} --size 40 50 frames/cap.L0.000025.exr"), "twice"),
        ("sample map.glb image.npy -o out.csv".to_owned(), "--image"),
        ("sample map.glb image.npy -o out.csv --image nose/L0".to_owned(), "cap/L0"),
        ("sample map.glb image.png -o out.csv".to_owned(), ".exr, .npy"),
        ("sample map.glb image.npy -o map.glb".to_owned(), "replace an input"),
    ] {
        dermatome(folder.path(), &words).code(2).stderr(contains(said).and(contains("help:")));
        assert!(!folder.path().join("out.csv").exists(), "{words}");
    }
    dermatome(folder.path(), "sample map.glb image.npy -o - --image cap/L0 --unit N")
        .success()
        .stdout(contains("patch,level,vertex,taxel_id,0[N]\ncap,0,0,"));
}

#[test]
fn a_frame_of_readings_is_drawn_on_the_map_and_in_space() {
    let folder = folder_with_a_recording(0.05);
    let plot = "plot map.glb --readings touch.csv --frame 25 --space -o";
    dermatome(folder.path(), &format!("{plot} a.svg -o a.png")).success();
    let text_of = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    for text in ["force per area, kPa", "cap, level 1 in space", "masked", "no reading", "0.625 s", " N<"] {
        assert!(text_of("a.svg").contains(text), "{text}");
    }
    dermatome(folder.path(), &format!("{plot} k.svg --unit m --readings-unit K")).success();
    assert!(text_of("k.svg").contains("force, K"));
    dermatome(folder.path(), &format!("{plot} b.png --threads 1")).success();
    let read = |name: &str| fs::read(folder.path().join(name)).unwrap();
    assert!(read("a.png") == read("b.png"), "the same bytes for any number of threads");
    for (words, said) in [
        ("--readings touch.csv --frame 9999", "ends before frame 9999"),
        ("--readings touch.csv --channel heat", "force"),
        ("--readings touch.csv --range 5,1", "lower one first"),
        ("--readings touch.csv --show angle", "cannot be used with"),
        ("--readings touch.csv --readings-unit N,K", "2 units for 1 channels"),
        ("--baseline 2", "--readings"),
        ("--frame 2", "--readings"),
    ] {
        dermatome(folder.path(), &format!("plot map.glb -o c.svg {words}")).code(2).stderr(contains(said));
    }
}
