//! `touch` as a user runs it.

use std::{fs, path::Path};

use dermatome::{
    io::{read_response, write_skin},
    mesh::shapes,
    signal::TaxelState,
    skin::Skin,
};
use predicates::str::contains;

use crate::common;

fn touch(folder: &Path, arguments: &[&str]) -> assert_cmd::assert::Assert {
    let mut command = common::command();
    command.current_dir(folder).args(["touch", "cap.glb"]).args(arguments).assert()
}

fn folder_with_a_cap() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let skin = Skin::from_mesh("cap", shapes::cap(400, 0.1, 1.2));
    write_skin(&folder.path().join("cap.glb"), &skin).unwrap();
    folder
}

#[test]
fn a_recording_and_its_truth_are_written_the_same_every_time() {
    let folder = folder_with_a_cap();
    let noisy = ["--noise-kpa", "0.1", "--drift-kpa", "0.1", "--dead", "0.1", "--rate-hz", "20"];
    let run = |readings: &str, truth: &str, more: &[&str]| {
        let outputs = ["-o", readings, "--truth", truth];
        touch(folder.path(), &[&outputs, &noisy[..], more].concat()).success();
    };
    run("a.csv", "a_truth.csv", &["--threads", "1"]);
    run("b.csv", "b_truth.csv", &[]);
    run("c.csv", "c_truth.csv", &["--seed", "1"]);
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    assert_eq!((read("a.csv"), read("a_truth.csv")), (read("b.csv"), read("b_truth.csv")));
    assert_ne!(read("a_truth.csv"), read("c_truth.csv"));
    assert_eq!(read("a.csv").lines().count(), 1 + 130, "6.5 s at 20 Hz");
    run("a.npz", "a_truth.csv", &["--reads", "pressure"]);
    let mut names: Vec<_> =
        fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    let expected =
        ["a.csv", "a.npz", "a_truth.csv", "b.csv", "b_truth.csv", "c.csv", "c_truth.csv", "cap.glb"];
    assert_eq!(names, expected);
}

#[test]
fn bad_numbers_are_refused() {
    let folder = folder_with_a_cap();
    for (arguments, said) in [
        (&["-o", "a.csv", "--depth-mm", "20"][..], "less than the radius"),
        (&["-o", "a.csv", "--rate-hz", "0"], "rate"),
        (&["-o", "a.csv", "--dead", "1"], "dead"),
        (&["-o", "a.csv", "--noise-kpa=-1"], "noise"),
        (&["-o", "a.csv", "--faults", "broken=3"], "kinds are dead, silent"),
        (&["-o", "a.csv", "--faults", "swapped=300"], "at most 219"),
        (&["-o", "a.csv", "--faults", "turned=50"], "turned modules"),
        (&["-o", "a.csv", "--gain-spread=-1"], "spread of the gains"),
        (&["-o", "a.g2o"], ".csv, .npz"),
        (&["-o", "cap.glb"], "input"),
    ] {
        touch(folder.path(), arguments).code(2).stderr(contains(said));
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// Two touches on one link stay two from the simulated readings to the table of contacts.
#[test]
fn two_touches_at_once_are_two_contacts() {
    let folder = tempfile::tempdir().unwrap();
    let skin = Path::new(env!("CARGO_MANIFEST_DIR")).join("meshes/sphere_cap.glb");
    fs::copy(skin, folder.path().join("cap.glb")).unwrap();
    let two =
        ["-o", "two.csv", "--truth", "truth.csv", "--touches", "2", "--presses", "3", "--rate-hz", "50"];
    touch(folder.path(), &[&two[..], &["--noise-kpa", "0.2", "--seed", "4"]].concat())
        .success()
        .stderr(contains("6 presses"));
    let run = |arguments: &[&str]| {
        let mut command = common::command();
        command.current_dir(folder.path()).args(arguments).assert().success();
    };
    run(&["build", "cap.glb", "-o", "cap"]);
    run(&["render", "cap/map.glb", "two.csv", "-o", "two.npz", "--contacts", "contacts.csv"]);
    let column = |name: &str, of: &str| -> Vec<String> {
        let text = fs::read_to_string(folder.path().join(name)).unwrap();
        let at = text.lines().next().unwrap().split(',').position(|word| word == of).unwrap();
        text.lines().skip(1).map(|line| line.split(',').nth(at).unwrap().to_owned()).collect()
    };
    let events = column("contacts.csv", "event");
    let count = |event: &str| events.iter().filter(|found| *found == event).count();
    assert_eq!((count("onset"), count("release")), (6, 6), "three turns of two contacts");
    let distinct = |mut all: Vec<String>| {
        all.sort();
        all.dedup();
        all.len()
    };
    assert_eq!(distinct(column("contacts.csv", "track")), 6);
    assert_eq!(distinct(column("truth.csv", "press")), 6);
}

/// The true response has a row for each taxel, with what was done to it; the same every time.
#[test]
fn faults_are_written_with_their_truth() {
    let folder = folder_with_a_cap();
    let faults = ["--faults", "dead=2,swapped=1,crosstalk=1", "--gain-spread", "0.4", "--rate-hz", "10"];
    let run = |readings: &str, truth: &str| {
        touch(folder.path(), &[&["-o", readings, "--true-response", truth], &faults[..]].concat()).success();
    };
    run("a.csv", "a_response.csv");
    run("b.csv", "b_response.csv");
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    assert_eq!((read("a.csv"), read("a_response.csv")), (read("b.csv"), read("b_response.csv")));
    let truth = read_response(&folder.path().join("a_response.csv")).unwrap().0;
    let count = |state: TaxelState| truth.taxels.iter().filter(|known| known.state == state).count();
    assert_eq!((truth.taxels.len(), count(TaxelState::Dead), count(TaxelState::Swapped)), (219, 2, 2));
    assert_eq!((count(TaxelState::Crosstalk), count(TaxelState::Ok)), (1, 214));
}
