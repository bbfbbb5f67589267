//! `render` as a user runs it.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use std::{fmt::Write, fs, path::Path};

use assert_cmd::Command;
use predicates::{prelude::*, str::contains};

fn dermatome(folder: &Path) -> Command {
    let mut command = Command::new(assert_cmd::cargo::cargo_bin!("dermatome"));
    command.current_dir(folder);
    command
}

/// A folder with the map of a sheet of 12 x 10 taxels, ids from 1 on, and a recording of five frames:
/// frame `t` reads `t` everywhere.
fn sheet() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut obj = String::new();
    for k in 0..120 {
        writeln!(obj, "v {} {} 0", 0.004 * f64::from(k % 12), 0.004 * f64::from(k / 12)).unwrap();
    }
    for (x, y) in (0..9).flat_map(|y| (0..11).map(move |x| (x, y))) {
        let a = 12 * y + x + 1;
        writeln!(obj, "f {a} {} {}\nf {a} {} {}", a + 1, a + 13, a + 13, a + 12).unwrap();
    }
    fs::write(folder.path().join("sheet.obj"), obj).unwrap();
    dermatome(folder.path()).args(["build", "sheet.obj", "-o", "map", "--quiet"]).assert().success();
    fs::write(folder.path().join("r.csv"), table(1..=120, 5)).unwrap();
    folder
}

/// A recording of `frames` frames, 10 a second.
fn table(ids: impl Iterator<Item = u32>, frames: u32) -> String {
    let ids: Vec<String> = ids.map(|id| format!("{id}.pressure[Pa]")).collect();
    let mut text = format!("time,{}\n", ids.join(","));
    for t in 0..frames {
        let row = vec![t.to_string(); ids.len()];
        writeln!(text, "{},{}", 0.1 * f64::from(t), row.join(",")).unwrap();
    }
    text
}

fn json(output: &[u8]) -> serde_json::Value {
    serde_json::from_slice(output).unwrap()
}

/// The numbers of the `f32` array of a `.npy`.
fn numbers(bytes: &[u8]) -> Vec<f32> {
    let header = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    bytes[header..].chunks_exact(4).map(|x| f32::from_le_bytes(x.try_into().unwrap())).collect()
}

#[test]
fn a_constant_pressure_is_a_constant_image() {
    let folder = sheet();
    let run = dermatome(folder.path())
        .args(["render", "map/map.glb", "r.csv", "-o", "out.npy", "--level", "0", "--json"])
        .assert()
        .success()
        .stderr(predicate::str::is_empty());
    let report = json(&run.get_output().stdout);
    assert_eq!(report["frames"], 5);
    assert_eq!(
        (&report["matched"], &report["unknown"], &report["masked"]),
        (&120.into(), &0.into(), &0.into())
    );
    assert_eq!(report["channels"][0]["unit"], "Pa");
    let size = &report["size"]["sheet/L0"];
    let pixels = usize::try_from(size[0].as_u64().unwrap() * size[1].as_u64().unwrap()).unwrap();
    let values = numbers(&fs::read(folder.path().join("out.npy")).unwrap());
    assert_eq!(values.len(), 5 * pixels);
    for (t, frame) in values.chunks(pixels).enumerate() {
        let known: Vec<f32> = frame.iter().copied().filter(|x| !x.is_nan()).collect();
        assert!(known.len() > pixels / 2, "the sheet covers its image");
        assert!(known.iter().all(|x| (x - t as f32).abs() < 1e-5), "frame {t} is {t} everywhere");
    }
}

/// The raw frames of a pipe are those of the arrays, and a stream is answered like a file.
#[test]
fn a_pipe_has_the_frames_of_the_arrays() {
    let folder = sheet();
    let args = ["--level", "1", "--from", "1", "--every", "2"];
    dermatome(folder.path())
        .args(["render", "map/map.glb", "r.csv", "-o", "out.npy"])
        .args(args)
        .assert()
        .success();
    let array = fs::read(folder.path().join("out.npy")).unwrap();
    let recording = fs::read_to_string(folder.path().join("r.csv")).unwrap();
    for drop in [None, Some("--rate=5")] {
        let piped = dermatome(folder.path())
            .args(["render", "map/map.glb", "-", "-o", "-"])
            .args(args)
            .args(drop)
            .write_stdin(recording.clone())
            .assert()
            .success();
        let pipe = &piped.get_output().stdout;
        assert!(array.ends_with(pipe) && array.len() - pipe.len() < 1000, "frames 1 and 3, after the header");
    }
}

/// Every kind of output is written, and the files of a folder are numbered as the frames.
#[test]
fn folders_and_archives_hold_all_levels() {
    let folder = sheet();
    let render =
        |args: &[&str]| dermatome(folder.path()).args(["render", "map/map.glb", "r.csv"]).args(args).assert();
    render(&["-o", "all.npz"]).success();
    assert!(folder.path().join("features.json").is_file());
    render(&["-o", "exr", "--from", "2", "--to", "3"]).success();
    let mut names: Vec<_> = fs::read_dir(folder.path().join("exr"))
        .unwrap()
        .map(|f| f.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(names[..2], ["sheet.L0.000002.exr", "sheet.L0.000003.exr"]);
    assert_eq!(names.len() % 2, 0, "two frames of every level");
    render(&["-o", "png", "--pictures", "png", "--level", "0"]).success();
    assert_eq!(fs::read_dir(folder.path().join("png")).unwrap().count(), 5);
    for kind in ["nearest", "natural", "field"] {
        render(&["-o", &format!("{kind}.npz"), "--interpolate", kind, "--contrast"]).success();
    }
    render(&["-o", "edges.npz", "--edges"]).success();
    render(&["-o", "packed.npz", "--pack", "--size", "40", "60"]).success();
}

#[test]
fn readings_that_do_not_fit_are_named() {
    let folder = sheet();
    let refused = |text: String, what: &str, help: &str| {
        fs::write(folder.path().join("bad.csv"), text).unwrap();
        dermatome(folder.path())
            .args(["render", "map/map.glb", "bad.csv", "-o", "x.npz"])
            .assert()
            .code(2)
            .stderr(contains(what).and(contains(help)));
        assert!(!folder.path().join("x.npz").exists(), "nothing is left of a refused recording");
    };
    refused(table(500..=600, 2), "none of the 101 taxel ids", "500");
    refused(table([1, 2, 1].into_iter(), 2), "columns 0 and 2", "taxel id 1");
    refused(table(1..=3, 2) + "0.3,1,2\n", "line 4", "3 cells");
    refused(table(1..=3, 2) + "0.3,1,2,x\n", "line 4", "x");
    refused(table(1..=3, 0), "bad.csv", "");
    // Unknown and missing ids are counted, not refused.
    fs::write(folder.path().join("part.csv"), table(100..=125, 2)).unwrap();
    let run = dermatome(folder.path())
        .args(["render", "map/map.glb", "part.csv", "-o", "part.npz", "--json"])
        .assert()
        .success()
        .stderr(
            contains("5 columns are of no taxel of the map: 121, 122, 123, 124, 125")
                .and(contains("99 have none")),
        );
    let report = json(&run.get_output().stdout);
    assert_eq!(
        (&report["matched"], &report["unknown"], &report["masked"]),
        (&21.into(), &5.into(), &99.into())
    );
}

#[test]
fn outputs_that_cannot_be_are_refused_before_work() {
    let folder = sheet();
    for (args, what) in [
        (&["-o", "x.npy"][..], "--level"),
        (&["-o", "x.mp4"], ".npz"),
        (&["-o", "-", "--json"], "standard output"),
        (&["-o", "x.npz", "--level", "9"], "level 9"),
        (&["-o", "x.npz", "--size", "0", "5"], "canvas"),
        (&["-o", "x.npz", "--size", "4000", "4000", "--max-memory", "50"], "at most 50 MB"),
        (&["-o", "x.npz", "--unit", "Pa,K"], "2 units"),
        (&["-o", "x.npz", "--clip", "5,1"], "lower"),
    ] {
        dermatome(folder.path())
            .args(["render", "map/map.glb", "r.csv"])
            .args(args)
            .assert()
            .code(2)
            .stderr(contains(what));
    }
}

/// What is done to the readings is what arrives in the images.
#[test]
fn readings_are_conditioned() {
    let folder = sheet();
    let last = |args: &[&str]| {
        dermatome(folder.path())
            .args(["render", "map/map.glb", "r.csv", "-o", "c.npy", "--level", "0", "--from", "4", "--quiet"])
            .args(args)
            .assert()
            .success();
        let values = numbers(&fs::read(folder.path().join("c.npy")).unwrap());
        values.into_iter().find(|x| !x.is_nan()).unwrap()
    };
    assert_eq!(last(&[]), 4.0);
    assert_eq!(last(&["--baseline", "3"]), 3.0, "the mean of 0, 1 and 2 is subtracted");
    assert_eq!(last(&["--clip", "0,2.5"]), 2.5);
    let gains: String = (1..=120).fold("id,gain\n".into(), |text, id| text + &format!("{id},0.5\n"));
    fs::write(folder.path().join("g.csv"), gains).unwrap();
    assert_eq!(last(&["--gain", "g.csv"]), 2.0);
}

/// Presses of a simulated sphere are found one by one.
#[test]
fn contacts_are_written_with_their_place_and_force() {
    let folder = sheet();
    dermatome(folder.path())
        .args(["simulate", "--touch", "map/map.glb", "-o", "touch.csv", "--truth", "truth.csv"])
        .args(["--presses", "2", "--rate-hz", "20", "--sphere-mm", "20", "--noise-kpa", "0.1", "--quiet"])
        .assert()
        .success();
    let run = dermatome(folder.path())
        .args(["render", "map/map.glb", "touch.csv", "-o", "t.npz", "--contacts", "c.csv", "--json"])
        .assert()
        .success();
    assert_eq!(json(&run.get_output().stdout)["contacts"], 2, "two presses");
    let text = fs::read_to_string(folder.path().join("c.csv")).unwrap();
    assert!(text.starts_with("frame,time,track,event,patch,link,taxels,area,force,x,y,z,nx,ny,nz,u,v,"));
    assert_eq!(text.matches(",onset,").count(), 2);
    assert_eq!(text.matches(",release,").count(), 2);
    dermatome(folder.path())
        .args([
            "render",
            "map/map.glb",
            "touch.csv",
            "-o",
            "u.npz",
            "--contacts",
            "c.jsonl",
            "--channel",
            "heat",
        ])
        .assert()
        .code(2)
        .stderr(contains("no channel \"heat\"").and(contains("force")));
}
