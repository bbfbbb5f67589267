//! `simulate` and `calibrate` as a user runs them.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use std::{fs, path::Path};

use assert_cmd::Command;
use predicates::{prelude::*, str::contains};

fn dermatome(folder: &Path) -> Command {
    let mut command = Command::new(assert_cmd::cargo::cargo_bin!("dermatome"));
    command.current_dir(folder);
    command
}

fn json(output: &[u8]) -> serde_json::Value {
    serde_json::from_slice(output).unwrap()
}

#[test]
fn a_simulated_skin_is_calibrated_and_built() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    dermatome(folder)
        .args(["simulate", "-o", "obs.g2o", "--truth", "t.csv", "--triangles", "tri.csv", "--seed", "1"])
        .assert()
        .success()
        .stderr(contains("500 taxels, 1419 displacements (0 wrong), 0 contacts, 920 triangles"));
    let calibrated = dermatome(folder)
        .args(["calibrate", "obs.g2o", "-o", "skin.glb", "-o", "skin.csv", "-o", "solved.g2o"])
        .args(["--truth", "t.csv", "--triangles", "tri.csv", "--json"])
        .assert()
        .success()
        .stderr(contains("taxel 0 keeps its start"));
    let summary = json(&calibrated.get_output().stdout);
    assert_eq!(summary["model"], "positions");
    assert_eq!(summary["dof"], 2760);
    assert_eq!(summary["converged"], true);
    let (cost, chi2) = (summary["cost"].as_f64().unwrap(), summary["chi2"].as_f64().unwrap());
    assert!((2.0 * cost - chi2).abs() < 1e-9 * chi2, "cost is half of chi2");
    let rmse = summary["rmse_aligned_mm"].as_f64().unwrap();
    assert!((0.9..1.4).contains(&rmse), "{rmse} mm");
    assert_eq!(fs::read_to_string(folder.join("skin.csv")).unwrap().lines().count(), 501);
    dermatome(folder).args(["build", "skin.glb", "-o", "map"]).assert().success();

    // The solved graph starts where it ends.
    let again = dermatome(folder)
        .args(["calibrate", "solved.g2o", "-o", "again.csv", "--initial", "file", "--json"])
        .assert()
        .success();
    let again = json(&again.get_output().stdout);
    assert!((again["cost"].as_f64().unwrap() / cost - 1.0).abs() < 1e-9);
}

#[test]
fn the_same_seed_gives_the_same_bytes_for_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for threads in ["1", "3"] {
        let (obs, out) = (format!("{threads}.g2o"), format!("{threads}.csv"));
        dermatome(folder)
            .args(["simulate", "--model", "poses", "--seed", "5", "--threads", threads, "-o", &obs])
            .assert()
            .success();
        dermatome(folder).args(["calibrate", "--threads", threads, &obs, "-o", &out]).assert().success();
    }
    for kind in ["g2o", "csv"] {
        let read = |threads: &str| fs::read(folder.join(format!("{threads}.{kind}"))).unwrap();
        assert!(read("1") == read("3"), "{kind}");
    }
}

#[test]
fn contacts_come_in_a_table_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    dermatome(folder)
        .args(["simulate", "--model", "poses", "--taxels", "60", "--anchors", "9", "--normal-noise-deg", "2"])
        .args(["-o", "obs.g2o", "--contacts", "c.csv", "--truth", "t.csv"])
        .assert()
        .success();
    dermatome(folder)
        .args(["calibrate", "obs.g2o", "--contacts", "c.csv", "-o", "skin.glb", "--truth", "t.csv"])
        .assert()
        .success()
        .stdout(contains("the stated noise is believable").and(contains("RMSE")))
        .stderr(contains("keeps its start").not());
}

#[test]
fn every_observation_has_a_line_in_the_report_of_inliers() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    dermatome(folder)
        .args(["simulate", "-o", "o.g2o", "--outliers", "0.1", "--anchors", "5", "--contacts", "c.csv"])
        .assert()
        .success();
    let done = dermatome(folder)
        .args(["calibrate", "o.g2o", "--contacts", "c.csv", "-o", "s.csv", "--robust", "gnc", "--json"])
        .args(["--inliers", "i.csv"])
        .assert()
        .success()
        .stderr(contains("noise does not explain"));
    let table = fs::read_to_string(folder.join("i.csv")).unwrap();
    let rows: Vec<Vec<&str>> = table.lines().map(|l| l.split(',').collect()).collect();
    assert_eq!(rows[0], ["i", "j", "sigmas", "weight", "inlier"]);
    assert_eq!(rows.len(), 1 + 1419 + 5);
    assert!(rows[1..=1419].iter().all(|r| !r[1].is_empty()) && rows[1420..].iter().all(|r| r[1].is_empty()));
    let rejected = rows[1..].iter().filter(|r| r[4] == "0").count();
    assert_eq!(json(&done.get_output().stdout)["rejected"], rejected);
    assert!((100..220).contains(&rejected), "{rejected} of some 142 wrong ones");
}

#[test]
fn a_solve_that_does_not_converge_writes_nothing_unless_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    dermatome(folder)
        .args(["simulate", "--model", "poses", "--taxels", "60", "-o", "o.g2o"])
        .assert()
        .success();
    let unfinished = ["calibrate", "o.g2o", "-o", "s.csv", "--iterations", "1", "--initial", "tree"];
    dermatome(folder)
        .args(unfinished)
        .assert()
        .code(2)
        .stderr(contains("out of iterations").and(contains("--keep")));
    assert!(!folder.join("s.csv").exists());
    dermatome(folder).args(unfinished).arg("--keep").assert().code(2);
    assert!(folder.join("s.csv").exists());
}

#[test]
fn what_is_wrong_is_named_in_three_lines() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let line = "VERTEX_TRACKXYZ 0 0 0 0\nVERTEX_TRACKXYZ 1 0 0 0\nVERTEX_TRACKXYZ 2 0 0 0\n";
    fs::write(folder.join("a.g2o"), format!("{line}EDGE_POINTXYZ 0 1 1 0 0 1 0 0 -1 0 1\n")).unwrap();
    dermatome(folder)
        .args(["calibrate", "a.g2o", "-o", "s.csv"])
        .assert()
        .code(2)
        .stderr(contains("line 4").and(contains("edge 0 to 1")));
    fs::write(folder.join("b.g2o"), format!("{line}EDGE_POINTXYZ 0 1 1 0 0 1 0 0 1 0 1\n")).unwrap();
    dermatome(folder).args(["calibrate", "b.g2o", "-o", "s.csv"]).assert().code(2).stderr(
        contains("cannot calibrate b.g2o")
            .and(contains("taxel 2 is in no observation"))
            .and(contains("help:")),
    );
    dermatome(folder)
        .args(["simulate", "-o", "s.g2o", "--taxels", "100000"])
        .assert()
        .code(2)
        .stderr(contains("smaller spacing"));
}
