//! The walk of an insole of another program, from heel strike to toe-off: sums, steps and the page say what its cells say.

use std::fs;
use std::io::Read as _;
use std::path::Path;

use base64::{Engine as _, engine::general_purpose::STANDARD};
use serde_json::Value;

use crate::common::{self, dermatome};

/// Copies a recording of Tekscan here and builds the map of its cells in `mat`.
fn mat(folder: &Path, sample: &Path) {
    fs::copy(sample, folder.join("walk.asf")).unwrap();
    dermatome(folder, "convert walk.asf mat.glb").assert().success();
    dermatome(folder, "build mat.glb -o mat").assert().success();
}

/// What a command prints with `--json`.
fn said(folder: &Path, words: &str) -> Value {
    let made = dermatome(folder, words).assert().success();
    serde_json::from_slice(&made.get_output().stdout).unwrap()
}

/// Force in N, and impulse in N s, that the cells of the file have: pressures in kPa times the area of a cell, by the trapezoidal
/// rule.
fn of_cells(sample: &Path) -> (Vec<f64>, f64) {
    let text = fs::read_to_string(sample).unwrap();
    let head = |key: &str| {
        let line = text.lines().find(|line| line.starts_with(key)).unwrap();
        line[key.len()..].split_whitespace().next().unwrap().trim_matches('"').parse::<f64>().unwrap()
    };
    let area = head("ROW_SPACING") * head("COL_SPACING") * 1e-6;
    let seconds = head("SECONDS_PER_FRAME");
    let mut forces = Vec::new();
    for line in text.lines().skip_while(|line| !line.starts_with("ASCII_DATA")).skip(1) {
        if line.starts_with("Frame") {
            forces.push(0.0);
        } else if let Some(force) = forces.last_mut() {
            *force +=
                line.split(',').filter_map(|cell| cell.trim().parse::<f64>().ok()).sum::<f64>() * 1e3 * area;
        }
    }
    let impulse = forces.windows(2).map(|pair| 0.5 * (pair[0] + pair[1]) * seconds).sum();
    (forces, impulse)
}

/// The contacts of each frame of a page: how many there are, and their force together.
fn contacts_of_page(page: &Path) -> Vec<(usize, f64)> {
    let text = fs::read_to_string(page).unwrap();
    let data = text.split("id=\"data\">").nth(1).and_then(|rest| rest.split('<').next()).unwrap();
    let mut bytes = Vec::new();
    let packed = STANDARD.decode(data.trim()).unwrap();
    flate2::read::GzDecoder::new(&packed[..]).read_to_end(&mut bytes).unwrap();
    let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
    let header: Value = serde_json::from_slice(&bytes[4..4 + length]).unwrap();
    let recording = &header["recording"];
    let mut found = vec![(0, 0.0); recording["times"].as_array().unwrap().len()];
    for row in recording["contacts"].as_array().unwrap().iter().filter(|row| row[2] != 2) {
        let frame = usize::try_from(row[0].as_u64().unwrap()).unwrap();
        found[frame] = (found[frame].0 + 1, found[frame].1 + row[6].as_f64().unwrap());
    }
    found
}

/// A step that begins under load, without any option: nothing is subtracted, the whole load is in contacts, and a foot is one.
#[test]
fn a_step_that_begins_under_load_has_the_force_of_its_cells() {
    let Some(sample) = common::data("recordings/vendor/fscan_testL.asf") else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    mat(folder, &sample);
    let (forces, impulse) = of_cells(&sample);
    assert_eq!(forces.len(), 20);
    let near = |found: f64, needed: f64| (found / needed - 1.0).abs() < 1e-6;
    let whole = &said(folder, "summary mat/map.glb walk.asf -o sums.csv --json")["groups"][0];
    let [peak, found] = ["force_peak", "impulse"].map(|key| whole[key].as_f64().unwrap());
    assert!((peak - 909.7).abs() < 0.05 && near(peak, forces[16]), "{peak} N");
    assert!((found - 442.2).abs() < 0.05 && near(found, impulse), "{found} N s");
    for (probe, most) in [("any", 6), ("foot", 1)] {
        dermatome(folder, &format!("report mat/map.glb walk.asf --probe {probe} -o report.html"))
            .assert()
            .success();
        let contacts = contacts_of_page(&folder.join("report.html"));
        for (frame, (&(count, force), needed)) in contacts.iter().zip(&forces).enumerate() {
            // A single cell is no contact.
            let is_all = (0.999..1.0 + 1e-9).contains(&(force / needed));
            assert!((1..=most).contains(&count) && is_all, "frame {frame}: {count}, {force} of {needed} N");
        }
    }
}

/// Five whole steps and a part of one: a row for each whole one, and the sums of all.
#[test]
fn a_walk_has_a_row_for_each_step() {
    let Some(sample) = common::data("recordings/vendor/footpress_left.asf") else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    mat(folder, &sample);
    let (forces, impulse) = of_cells(&sample);
    let near = |found: f64, needed: f64| (found / needed - 1.0).abs() < 1e-6;
    let made = said(folder, "summary mat/map.glb walk.asf --by step -o steps.csv --json");
    let number = |row: &Value, key: &str| row[key].as_f64().unwrap();
    let whole = &made["groups"][0];
    assert!(
        (number(whole, "force_peak") - 924.4).abs() < 0.05
            && (number(whole, "impulse") - 2591.6).abs() < 0.05
    );
    assert!(near(number(whole, "force_peak"), forces.iter().copied().fold(0.0, f64::max)));
    assert!(near(number(whole, "impulse"), impulse));
    let steps = made["steps"].as_array().unwrap();
    assert_eq!(steps.len(), 5);
    assert_eq!(fs::read_to_string(folder.join("steps.csv")).unwrap().lines().count(), 6);
    for step in steps {
        let [begin, duration] = ["begin", "duration"].map(|key| number(step, key));
        let is_in = |frame: usize| (begin - 1e-9..begin + duration + 1e-9).contains(&(0.032 * frame as f64));
        let part = forces.iter().enumerate().filter(|(frame, _)| is_in(*frame));
        let peak = part.map(|(_, force)| *force).fold(0.0, f64::max);
        assert!(near(number(step, "force_peak"), peak), "{peak} N in {step}");
        assert!((0.6..0.9).contains(&duration) && number(step, "impulse") > 300.0, "{step}");
    }
}
