//! Readings of contacts: `lookup --readings`.
#![cfg(feature = "cli")]
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

mod common;

use std::{fs, process::Output};

use dermatome::{io::write_map, map::SkinMap, mesh::shapes};
use tempfile::TempDir;

/// A plane of 40 x 40 mm with a taxel every 5 mm, and its map.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let map = SkinMap::flat(shapes::lattice(9, 9, 0.005), 1e-3);
    write_map(&folder.path().join("map.glb"), &map).unwrap();
    folder
}

/// Looks up a table; answers go to standard output, readings to `touch.csv`.
fn lookup(folder: &TempDir, table: &str, options: &[&str]) -> Output {
    fs::write(folder.path().join("in.csv"), table).unwrap();
    _ = fs::remove_file(folder.path().join("touch.csv"));
    let mut command = common::command();
    command.current_dir(folder).args(["lookup", "map.glb", "in.csv", "--level", "0"]).args(options);
    command.output().unwrap()
}

fn notes(output: &Output) -> &str {
    std::str::from_utf8(&output.stderr).unwrap()
}

/// Time and sum of each frame of the readings.
fn frames(folder: &TempDir) -> Vec<(f64, f64)> {
    let text = fs::read_to_string(folder.path().join("touch.csv")).unwrap();
    let frame = |line: &str| {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        (cells[0], cells[1..].iter().sum())
    };
    text.lines().skip(1).map(frame).collect()
}

const READINGS: [&str; 2] = ["--readings", "touch.csv"];

/// A point farther from the skin than the largest distance touches no taxel, whatever is asked; a ball
/// presses where it touches the skin, wherever its centre is.
#[test]
fn points_off_the_skin_press_nothing() {
    let folder = folder();
    let table = "x,y,z,force,radius\n0.02,0.02,0.004,1,\n0.02,0.02,0.004,2,0.01\n0.02,0.02,0.06,4,0.08\n";
    for (options, sum, untouched) in [
        (&[][..], 7.0, None),
        (&["--max-distance", "0.003"], 6.0, Some(1)),
        (&["--max-distance", "inf"], 7.0, None),
        (&["--reactive", "--max-distance", "0.003"], 6.0, Some(1)),
        (&["--nearest", "1", "--max-distance", "0.003"], 6.0, Some(1)),
        (&["--within", "0.005"], 7.0, None),
    ] {
        let run = lookup(&folder, table, &[&READINGS, options].concat());
        let found = frames(&folder);
        assert!(found.len() == 1 && (found[0].1 - sum).abs() < 1e-12, "{options:?}: {found:?}");
        let note = untouched.map(|count| format!("{count} contact is off all taxels"));
        assert_eq!(notes(&run).contains("off all taxels"), note.is_some(), "{}", notes(&run));
        assert!(note.is_none_or(|note| notes(&run).contains(&note)), "{options:?}: {}", notes(&run));
    }
}

/// What the answers say of fields has no part in it: a point on the skin presses though no taxel is within
/// the distance asked for, and one that is far presses if it may be.
#[test]
fn points_press_by_their_distance_from_the_skin() {
    let folder = folder();
    for (table, options) in [
        ("0.0225,0.0225,0", &["--within", "0.0005"][..]),
        ("0.0225,0.0225,-3.7e-11", &["--nearest", "3", "--max-distance", "1e-9"]),
        ("0.02,0.02,0.3", &["--max-distance", "1"]),
        ("0.02,0.02,0.3", &["--max-distance", "inf"]),
    ] {
        let run = lookup(&folder, &format!("x,y,z,force\n{table},3\n"), &[&READINGS, options].concat());
        let found = frames(&folder);
        assert!(found.len() == 1 && (found[0].1 - 3.0).abs() < 1e-12, "{options:?}: {found:?}");
        assert!(!notes(&run).contains("off all taxels"), "{options:?}: {}", notes(&run));
    }
}

#[test]
fn readings_without_a_force_are_noted() {
    let folder = folder();
    for (table, is_noted) in [("x,y,z\n0.02,0.02,0\n", true), ("x,y,z,force\n0.02,0.02,0,0\n", false)] {
        let run = lookup(&folder, table, &READINGS);
        assert_eq!(notes(&run).contains("no contact has a force"), is_noted, "{}", notes(&run));
    }
}

#[test]
fn readings_of_rays_are_refused() {
    let folder = folder();
    let table = "x,y,z,nx,ny,nz,force\n0.02,0.02,0.01,0,0,-1,1\n";
    let run = lookup(&folder, table, &["--ray", "--readings", "touch.csv"]);
    assert_eq!(run.status.code(), Some(2), "{}", notes(&run));
    assert!(notes(&run).contains("cannot be used with") && !folder.path().join("touch.csv").exists());
}

/// Contacts of one time in a row are a frame; others of that time are another one, which a note counts.
#[test]
fn times_that_go_back_are_noted() {
    let folder = folder();
    for (times, expected, backwards) in [
        (&["0", "0", "1", "1"][..], &[0.0, 1.0][..], None),
        (&["0", "1", "0", "", "1", "0.5"], &[0.0, 1.0, 0.0, 1.0, 0.5], Some(2)),
    ] {
        let rows: String = times.iter().map(|time| format!("0.02,0.02,0,1,{time}\n")).collect();
        let run = lookup(&folder, &format!("x,y,z,force,time\n{rows}"), &READINGS);
        let found: Vec<_> = frames(&folder).into_iter().map(|(time, _)| time).collect();
        assert_eq!(found, expected, "{}", notes(&run));
        let note = backwards.map(|count| format!("note: {count} frame"));
        let found = notes(&run).matches("earlier in the readings").count();
        assert_eq!(found, usize::from(note.is_some()), "{}", notes(&run));
        assert!(note.is_none_or(|note| notes(&run).contains(&note)), "{}", notes(&run));
    }
}

/// A recording has a frame; a table of answers may be empty.
#[test]
fn a_table_without_contacts_makes_no_recording() {
    let folder = folder();
    let header = "x,y,z,force\n";
    for name in ["touch.csv", "touch.npz"] {
        let run = lookup(&folder, header, &["--readings", name, "-o", "out.csv"]);
        assert!(run.status.code() == Some(2) && notes(&run).contains("in.csv: the table: found no contact"));
        assert!(["out.csv", name].iter().all(|name| !folder.path().join(name).exists()));
    }
    let run = lookup(&folder, header, &[]);
    assert!(run.status.success() && run.stdout.starts_with(b"contact,level"), "{}", notes(&run));
}

#[test]
fn the_radius_of_taxels_needs_readings() {
    let folder = folder();
    let run = lookup(&folder, "x,y,z\n0.02,0.02,0\n", &["--taxel-radius-mm", "3"]);
    assert!(run.status.code() == Some(2) && notes(&run).contains("--readings"), "{}", notes(&run));
    let run = lookup(&folder, "x,y,z\n0.02,0.02,0\n", &[]);
    assert!(run.status.success(), "{}", notes(&run));
}
