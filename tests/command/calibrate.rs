//! `simulate` and `calibrate` as a user runs them.

use std::fs;

use crate::common::{dermatome, json, listing, notes, refuses};
use predicates::{prelude::*, str::contains};

#[test]
fn a_simulated_skin_is_calibrated_and_built() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    notes(
        folder,
        "simulate -o obs.g2o --truth t.csv --triangles tri.csv --seed 1",
        &["500 taxels, 1419 displacements (0 wrong), 0 contacts, 920 triangles"],
    );
    let calibrated = notes(
        folder,
        "calibrate obs.g2o -o skin.glb -o skin.csv -o solved.g2o --truth t.csv --triangles tri.csv --json",
        &["taxel 0 keeps its start, and covariances are about the centroid"],
    );
    let summary = json(&calibrated.get_output().stdout);
    assert_eq!(summary["model"], "positions");
    assert_eq!(summary["dof"], 2760);
    assert_eq!(summary["converged"], true);
    let (cost, chi2) = (summary["cost"].as_f64().unwrap(), summary["chi2"].as_f64().unwrap());
    assert!((2.0 * cost - chi2).abs() < 1e-9 * chi2, "cost is half of chi2");
    let rmse = summary["rmse_aligned_mm"].as_f64().unwrap();
    assert!((0.9..1.4).contains(&rmse), "{rmse} mm");
    assert_eq!(fs::read_to_string(folder.join("skin.csv")).unwrap().lines().count(), 501);
    dermatome(folder, "build skin.glb -o map").assert().success();

    // The solved graph starts where it ends.
    let again =
        dermatome(folder, "calibrate solved.g2o -o again.csv --initial file --json").assert().success();
    let again = json(&again.get_output().stdout);
    assert!((again["cost"].as_f64().unwrap() / cost - 1.0).abs() < 1e-9);
}

/// Without a table of triangles the edges say where they are, and `-` joins the two commands.
#[test]
fn observations_go_through_a_pipe() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let simulated = dermatome(folder, "simulate -o - --seed 3").assert().success();
    let text = simulated.get_output().stdout.clone();
    dermatome(folder, "simulate -o obs.g2o --seed 3").assert().success();
    assert!(text == fs::read(folder.join("obs.g2o")).unwrap(), "the same bytes as in a file");
    dermatome(folder, "calibrate - -o skin.glb").write_stdin(text).assert().success();
    let info = dermatome(folder, "info skin.glb --json").assert().success();
    let patch = &json(&info.get_output().stdout)["patches"][0];
    assert_eq!((&patch["vertices"], &patch["faces"]), (&500.into(), &920.into()));
}

#[test]
fn the_same_seed_gives_the_same_bytes_for_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for threads in ["1", "3"] {
        let (obs, out) = (format!("{threads}.g2o"), format!("{threads}.csv"));
        dermatome(folder, "simulate --model poses --seed 5 --threads")
            .args([threads, "-o", &obs])
            .assert()
            .success();
        dermatome(folder, "calibrate --threads").args([threads, &obs, "-o", &out]).assert().success();
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
    dermatome(folder, "simulate --model poses --taxels 60 --anchors 9 --normal-noise-deg 2 -o obs.g2o --contacts c.csv --truth t.csv")
        .assert()
        .success();
    dermatome(folder, "calibrate obs.g2o --contacts c.csv -o skin.glb --truth t.csv")
        .assert()
        .success()
        .stdout(contains("the stated noise is believable").and(contains("RMSE")))
        .stderr(contains("keeps its start").not());
}

#[test]
fn every_observation_has_a_line_in_the_report_of_inliers() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    dermatome(folder, "simulate -o o.g2o --outliers 0.1 --anchors 5 --contacts c.csv").assert().success();
    let done = notes(
        folder,
        "calibrate o.g2o --contacts c.csv -o s.csv --robust gnc --json --inliers i.csv",
        &["rejected as outliers"],
    );
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
    dermatome(folder, "simulate --model poses --taxels 60 -o o.g2o").assert().success();
    let unfinished = "calibrate o.g2o -o s.csv --iterations 1 --initial file";
    refuses(folder, unfinished, &["out of iterations", "--keep"]);
    assert!(!folder.join("s.csv").exists());
    refuses(folder, &format!("{unfinished} --keep -q"), &["not a minimum"]);
    assert!(folder.join("s.csv").exists());
}

#[test]
fn errors_say_what_where_and_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let line = "VERTEX_TRACKXYZ 0 0 0 0\nVERTEX_TRACKXYZ 1 0 0 0\nVERTEX_TRACKXYZ 2 0 0 0\n";
    fs::write(folder.join("a.g2o"), format!("{line}EDGE_POINTXYZ 0 1 1 0 0 1 0 0 -1 0 1\n")).unwrap();
    refuses(folder, "calibrate a.g2o -o s.csv", &["line 4", "edge 0 to 1"]);
    fs::write(folder.join("b.g2o"), format!("{line}EDGE_POINTXYZ 0 1 1 0 0 1 0 0 1 0 1\n")).unwrap();
    dermatome(folder, "calibrate b.g2o -o s.csv").assert().code(2).stderr(
        contains("cannot calibrate b.g2o")
            .and(contains("1 taxels are in no observation, first taxel 2"))
            .and(contains("help:")),
    );
    refuses(folder, "simulate -o s.g2o --taxels 100000", &["smaller spacing"]);
}

/// Three taxels on a triangle.
const TRIANGLE: &str = "i,j,dx,dy,dz\n1,2,0.005,0,0\n2,3,-0.005,0.005,0\n1,3,0,0.005,0\n";

#[test]
fn outputs_appear_together_or_not_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("e.csv"), TRIANGLE).unwrap();
    fs::write(folder.join("two.csv"), "i,j,dx,dy,dz\n1,2,0.005,0,0\n").unwrap();
    fs::write(folder.join("c.csv"), "i,x,y,z,nx,ny,nz\n1,0,0,0,0,0,1\n").unwrap();
    fs::create_dir(folder.join("dir.csv")).unwrap();
    let before = listing(folder);
    for (args, told) in [
        ("calibrate e.csv -o k.csv -o k.xyz", "known here: .csv, .g2o"),
        ("calibrate e.csv -o k.csv -o nodir/k.glb", "there is no folder nodir"),
        ("calibrate e.csv -o k.csv --inliers nodir/i.csv", "there is no folder nodir"),
        ("calibrate e.csv -o k.csv --inliers i.txt", "known here: .csv"),
        ("calibrate e.csv -o k.csv -o dir.csv", "cannot write dir.csv: is a directory"),
        ("calibrate two.csv -o k.csv -o k.glb", "no three taxels"),
        ("calibrate e.csv --contacts c.csv -o k.csv -o k.g2o", "a normal"),
        ("calibrate e.csv -o k.csv -o ./k.csv", "two outputs would be written to ./k.csv"),
        ("calibrate e.csv -o k.csv --inliers k.csv", "two outputs"),
        ("calibrate e.csv -o e.csv", "would replace an input, e.csv"),
        ("calibrate e.csv -o k.csv --contacts c.csv --inliers ./c.csv", "would replace"),
        ("calibrate e.csv -o k.csv --contacts ./e.csv", "given twice"),
        ("simulate --taxels 20 -o z.g2o --truth ./z.csv --triangles z.csv", "two outputs"),
        ("simulate --taxels 20 -o z.g2o --truth t.g2o", "known here: .csv"),
        ("simulate --taxels 20 --truth t.csv -o z.txt", "known here: .g2o, .csv"),
        ("simulate --taxels 20 --truth t.csv -o z.csv --model poses", "needed: a g2o file"),
    ] {
        refuses(folder, args, &[told]);
        assert_eq!(listing(folder), before, "{args}");
    }
    dermatome(folder, "calibrate e.csv -o k.csv -o k.glb -o k.g2o").assert().success();
    refuses(folder, "calibrate k.g2o -o k.g2o", &["replace an input"]);
    assert_eq!(listing(folder), ["c.csv", "dir.csv", "e.csv", "k.csv", "k.g2o", "k.glb", "two.csv"]);
}

/// Readers would join the triangles of an older skin to the new taxels.
#[test]
fn an_older_table_of_triangles_goes_with_its_taxels() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("e.csv"), TRIANGLE).unwrap();
    fs::write(folder.join("k.csv"), "id,x,y,z\n1,0,0,0\n2,1,0,0\n3,0,1,0\n").unwrap();
    fs::write(folder.join("k.triangles.csv"), "row0,row1,row2\n0,1,2\n").unwrap();
    notes(folder, "calibrate e.csv -o k.csv", &["k.triangles.csv belonged to the table"]);
    assert_eq!(listing(folder), ["e.csv", "k.csv"]);
    dermatome(folder, "simulate -o a.g2o --truth k.csv --triangles k.triangles.csv").assert().success();
    assert_eq!(listing(folder), ["a.g2o", "e.csv", "k.csv", "k.triangles.csv"], "both are new");
    notes(folder, "simulate -o a.g2o --truth k.csv", &["belonged to the table"]);
    assert_eq!(listing(folder), ["a.g2o", "e.csv", "k.csv"]);
}

#[test]
fn simulated_displacements_may_be_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    dermatome(folder, "simulate --taxels 20 -o e.csv --anchors 3 --contacts c.csv").assert().success();
    assert!(fs::read_to_string(folder.join("e.csv")).unwrap().starts_with("i,j,dx,dy,dz,ixx,"));
    dermatome(folder, "calibrate e.csv --contacts c.csv -o k.glb")
        .assert()
        .success()
        .stderr(contains("keeps its start").not());
}

/// A file means the same by name and on standard input.
#[test]
fn standard_input_is_known_by_its_first_line() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let graph = "VERTEX_TRACKXYZ 1 0 0 0\nVERTEX_TRACKXYZ 2 0 0 0\nEDGE_POINTXYZ 1 2 1 0 0 1 0 0 1 0 1\n";
    for (name, text) in [
        ("a.csv", TRIANGLE.to_owned()),
        ("b.csv", format!("\u{feff}{TRIANGLE}")),
        ("c.csv", TRIANGLE.to_uppercase()),
        ("h.csv", TRIANGLE.replace(',', ";")),
        ("d.csv", format!("# touched by hand\n{TRIANGLE}")),
        ("e.csv", TRIANGLE.replacen("i,j,dx,dy,dz", "\"i\",\"j\",\"dx\",\"dy\",\"dz\"", 1)),
        ("f.g2o", format!("# touched by hand\n{graph}")),
        ("g.g2o", format!("\u{feff}{graph}")),
    ] {
        fs::write(folder.join(name), &text).unwrap();
        dermatome(folder, "calibrate").args([name, "-o", "named.csv"]).assert().success();
        dermatome(folder, "calibrate - -o piped.csv").write_stdin(text).assert().success();
        let read = |name: &str| fs::read_to_string(folder.join(name)).unwrap();
        assert_eq!(read("named.csv"), read("piped.csv"), "{name}");
    }
}

#[test]
fn the_help_fits_the_error() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("e.csv"), TRIANGLE).unwrap();
    fs::write(folder.join("t.csv"), "id,x,y,z\n77,0,0,0\n").unwrap();
    for (args, told, help) in [
        ("calibrate e.csv -o k.csv --iterations 0", "at least 1", "change the option"),
        ("simulate -o s.g2o --taxels 2", "needed: 3", "change the option"),
        ("calibrate e.csv -o k.csv --truth t.csv", "t.csv has none of the 3 taxels", "simulate --truth"),
    ] {
        refuses(folder, args, &[told, help]);
    }
    fs::write(folder.join("t.csv"), "id,x,y,z\n1,0,0,0\n77,0,0,0\n").unwrap();
    notes(folder, "calibrate e.csv -o k.csv --truth t.csv", &["t.csv has 1 of the 3 taxels"]);
}

#[test]
fn many_components_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let rows: String = (0..30).map(|k| format!("{},{},1,0,0\n", 2 * k, 2 * k + 1)).collect();
    fs::write(folder.join("e.csv"), format!("i,j,dx,dy,dz\n{rows}")).unwrap();
    let pieces = |verbose: &[&str]| {
        let done = dermatome(folder, "calibrate e.csv -o k.csv").args(verbose).assert().success();
        let notes = String::from_utf8(done.get_output().stderr.clone()).unwrap();
        (notes.matches("keeps its start").count(), notes)
    };
    let (told, notes) = pieces(&[]);
    assert_eq!(told, 8);
    assert!(notes.contains("44 taxels in 22 more components"), "{notes}");
    assert_eq!(pieces(&["--verbose"]).0, 30);
}

/// The same observations in metres and in millimetres give the same taxels.
#[test]
fn observations_may_be_in_millimetres() {
    let folder = tempfile::tempdir().unwrap();
    let lengths = |unit: f64, noise: f64| {
        let place = |x: f64, y: f64| format!("{} {} 0", unit * x, unit * y);
        let stated = format!("{0} 0 0 {0} 0 {0}", 1.0 / (noise * unit).powi(2));
        let edge =
            |i: u32, j: u32, x: f64, y: f64| format!("EDGE_POINTXYZ {i} {j} {} {stated}\n", place(x, y));
        let vertices: String = [(0.0, 0.0), (5e-3, 0.0), (0.0, 5e-3)]
            .iter()
            .enumerate()
            .map(|(k, &(x, y))| format!("VERTEX_TRACKXYZ {k} {}\n", place(x, y)))
            .collect();
        vertices + "FIX 0\n" + &edge(0, 1, 5.1e-3, 0.0) + &edge(0, 2, 0.0, 5e-3) + &edge(1, 2, -5e-3, 5e-3)
    };
    let run = |text: String, unit: &str| {
        std::fs::write(folder.path().join("a.g2o"), text).unwrap();
        let run = dermatome(&folder, &format!("calibrate a.g2o -o a.csv --unit {unit} --json")).assert();
        let output = run.success().get_output().clone();
        let table = std::fs::read_to_string(folder.path().join("a.csv")).unwrap();
        let numbers = table.lines().skip(1).flat_map(|row| row.split(',').map(str::parse::<f64>));
        (json(&output.stdout)["chi2"].as_f64(), numbers.filter_map(Result::ok).collect::<Vec<_>>())
    };
    let (metres, millimetres) = (run(lengths(1.0, 1e-4), "m"), run(lengths(1e3, 1e-4), "mm"));
    let [a, b] = [metres.0.unwrap(), millimetres.0.unwrap()];
    assert!((a - b).abs() < 1e-6 * a && a > 0.1, "chi-square {a} and {b}");
    assert_eq!(metres.1.len(), millimetres.1.len());
    for (a, b) in metres.1.iter().zip(&millimetres.1) {
        assert!((a - b).abs() <= 1e-9 * a.abs().max(1e-3), "{a} and {b}");
    }
}

/// What is assumed is 1 mm, not a thousandth of the unit.
#[test]
fn another_unit_needs_a_stated_uncertainty() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.csv"), "i,j,dx,dy,dz\n0,1,5,0,0\n").unwrap();
    refuses(&folder, "calibrate a.csv -o b.csv --unit mm", &["add a column sigma"]);
}

/// One of three edges has the eigenvalues -1e6, 1e6 and 3e6: the refusal counts it, and on request
/// the nearest matrix without the negative one is taken.
#[test]
fn indefinite_information_is_counted_and_clipped() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let table = "i,j,dx,dy,dz,ixx,ixy,ixz,iyy,iyz,izz\n1,2,1,0,0,1e6,0,0,1e6,2e6,1e6\n\
                 2,3,-1,1,0,1e6,0,0,1e6,0,1e6\n3,1,0,-1,0,1e6,0,0,1e6,0,1e6\n";
    fs::write(folder.join("e.csv"), table).unwrap();
    refuses(folder, "calibrate e.csv -o k.csv", &["1 of 3 edges", "--clip-information"]);
    notes(folder, "calibrate e.csv -o k.csv --clip-information", &["1 information matrices"]);
}
