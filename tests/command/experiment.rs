//! The experiment of the README: its commands give its numbers and its pictures.

use std::{fs, path::Path};

use serde_json::Value;

use crate::common;

fn run(folder: &Path, args: &[&str], input: &[u8]) -> Vec<u8> {
    let mut command = common::command();
    command.current_dir(folder).args(args).write_stdin(input);
    command.assert().success().get_output().stdout.clone()
}

/// Simulates, calibrates, builds and draws; the row of the README's table.
fn experiment(folder: &Path, name: &str, noise_mm: &str) -> String {
    let file = |suffix: &str| format!("{name}{suffix}");
    let touches = run(folder, &["simulate", "-o", "-", "--truth", "truth.csv", "--noise-mm", noise_mm], b"");
    let (skin, map, png) = (file(".glb"), file("/map.glb"), file(".png"));
    let calibrated =
        run(folder, &["calibrate", "-", "-o", &skin, "--truth", "truth.csv", "--json"], &touches);
    run(folder, &["build", &skin, "-o", name], b"");
    run(folder, &["plot", &map, "--level", "0", "--view", "-66,-43", "--width", "1000", "-o", &png], b"");
    let calibrated: Value = serde_json::from_slice(&calibrated).unwrap();
    let report = fs::read(folder.join(name).join("report.json")).unwrap();
    let report: Value = serde_json::from_slice(&report).unwrap();
    let level = |key: &str| report["patches"][0]["levels"][0][key].as_f64().unwrap();
    format!(
        "| {:.2} mm | {:.0} | {:.3} | {:.3} | {:.3} | {} |",
        calibrated["rmse_aligned_mm"].as_f64().unwrap(),
        calibrated["chi2"].as_f64().unwrap(),
        level("qc_mean"),
        level("qc_max"),
        level("area_mean"),
        level("flips"),
    )
}

/// Width, height and pixels.
fn decode(path: &Path) -> (u32, u32, Vec<u8>) {
    let mut decoder = png::Decoder::new(std::io::Cursor::new(fs::read(path).unwrap()));
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    (info.width, info.height, pixels)
}

#[test]
fn the_experiment_gives_what_its_page_says() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = fs::read_to_string(root.join("docs/experiment.md")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for (name, noise) in [("exact", "0"), ("touched", "1")] {
        let row = experiment(folder.path(), name, noise);
        assert!(page.contains(&row), "{name}: {row}");
        let picture = format!("meshes/sphere_{name}.png");
        assert!(page.contains(&picture), "{picture}");
        let kept = root.join(picture);
        assert!(fs::metadata(&kept).unwrap().len() < 256 << 10, "small enough for a README");
        let (drawn, kept) = (decode(&folder.path().join(format!("{name}.png"))), decode(&kept));
        assert_eq!((drawn.0, drawn.1), (kept.0, kept.1), "{name}: size");
        let change: u64 = drawn.2.iter().zip(&kept.2).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
        assert!(change as f64 / (kept.2.len() as f64) < 1.0, "{name}: drawn again it is another picture");
    }
}
