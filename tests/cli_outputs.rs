//! Where the command writes: never over an input, never twice to one place, and nothing is left of
//! a run that is stopped.
#![cfg(feature = "cli")]
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test may stop at a surprise and say what it skips"
)]

use std::{fs, path::Path};

use assert_cmd::Command;
use dermatome::{
    io::{write_map, write_skin},
    map::SkinMap,
    mesh::shapes,
    pipeline::{BuildOptions, build},
    skin::Skin,
};
use predicates::str::contains;
use tempfile::TempDir;

/// A folder with a skin `cap.obj`, its map `map.glb` and contacts `c.csv`.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let skin = Skin::from_mesh("cap", shapes::cap(300, 0.1, 0.6));
    write_skin(&folder.path().join("cap.obj"), &skin).unwrap();
    write_map(&folder.path().join("map.glb"), &map(&skin)).unwrap();
    fs::write(folder.path().join("c.csv"), "x,y,z\n0,0,-0.1\n").unwrap();
    folder
}

fn map(skin: &Skin) -> SkinMap {
    build(skin, &BuildOptions::default()).unwrap()
}

/// The command in a folder, with words that a user would type.
fn dermatome(folder: &Path, words: &str) -> Command {
    let mut command = Command::new(assert_cmd::cargo::cargo_bin!("dermatome"));
    command.current_dir(folder).args(words.split_whitespace());
    command
}

/// Names in a folder, hidden ones included.
fn listing(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn a_lookup_writes_tables_and_replaces_no_input() {
    let folder = folder();
    fs::write(folder.path().join("p.csv"), "link,x,y,z,qx,qy,qz,qw\n").unwrap();
    let before: Vec<_> =
        ["map.glb", "c.csv", "p.csv"].map(|n| fs::read(folder.path().join(n)).unwrap()).into();
    for (output, said) in [
        ("map.glb", ".csv"),
        ("other.glb", ".csv"),
        ("table", ".csv"),
        ("c.csv", "would replace an input, c.csv"),
        ("../NAME/p.csv", "would replace an input, p.csv"),
        ("no/folder.csv", "there is no folder no"),
    ] {
        let name = folder.path().file_name().unwrap().to_str().unwrap();
        let words = format!("lookup map.glb c.csv --pose p.csv -o {}", output.replace("NAME", name));
        dermatome(folder.path(), &words).assert().code(2).stderr(contains(said)).stderr(contains("help:"));
    }
    let after: Vec<_> =
        ["map.glb", "c.csv", "p.csv"].map(|n| fs::read(folder.path().join(n)).unwrap()).into();
    assert!(before == after, "inputs stay as they were");
    assert_eq!(listing(folder.path()), ["c.csv", "cap.obj", "map.glb", "p.csv"]);
    dermatome(folder.path(), "lookup map.glb c.csv -o t.CSV").assert().success();
}

#[test]
fn no_command_writes_twice_to_one_place() {
    let folder = folder();
    for words in [
        "flatten cap.obj -o flat.npz -o ./flat.npz",
        "plot map.glb -o p.svg -o ./p.svg",
        "plot map.glb -o - -o -",
        "simulate -o o.csv --truth ./o.csv",
    ] {
        let refused = dermatome(folder.path(), words).assert().code(2).stderr(contains("two outputs"));
        assert!(refused.get_output().stdout.is_empty(), "{words}: nothing is printed");
    }
    assert_eq!(listing(folder.path()), ["c.csv", "cap.obj", "map.glb"], "nothing is written");
    dermatome(folder.path(), "plot map.glb -o - -o p.svg").assert().success().stdout(contains("</svg>"));
    dermatome(folder.path(), "flatten cap.obj -o f.npz -o f.obj").assert().success();
    assert_eq!(listing(folder.path()), ["c.csv", "cap.obj", "f.npz", "f.obj", "map.glb", "p.svg"]);
}

#[test]
fn of_two_outputs_either_both_are_written_or_none() {
    let folder = folder();
    let both = "flatten cap.obj -o f.npz -o f.doc";
    dermatome(folder.path(), both).assert().code(2).stderr(contains("f.doc: unknown kind"));
    assert_eq!(listing(folder.path()), ["c.csv", "cap.obj", "map.glb"]);
}

#[cfg(target_os = "linux")]
mod stopped {
    use std::{
        io::Write,
        process::{Child, Stdio},
        thread,
        time::{Duration, Instant},
    };

    use super::*;

    /// Whether this test, and so every command it runs, ignores a signal: `nohup` has it so.
    fn is_ignored(signal: i32) -> bool {
        let status = fs::read_to_string("/proc/self/status").unwrap();
        let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:")).unwrap();
        u64::from_str_radix(ignored.trim(), 16).unwrap() >> (signal - 1) & 1 == 1
    }

    /// Sends a signal to a command as soon as there are more than `before` files in a folder.
    fn interrupt(child: &mut Child, signal: i32, folder: &Path, before: usize) {
        let patience = Instant::now() + Duration::from_secs(20);
        while listing(folder).len() == before {
            assert!(Instant::now() < patience && child.try_wait().unwrap().is_none(), "it writes");
            thread::sleep(Duration::from_millis(2));
        }
        let killed =
            std::process::Command::new("kill").args([format!("-{signal}"), child.id().to_string()]).status();
        assert!(killed.unwrap().success());
    }

    /// Hangup, ^C and `kill`, and `kill` of a run whose caller ignores the others.
    #[test]
    fn a_stopped_run_leaves_no_temporary_file() {
        for (signal, caller) in [(1, ""), (2, ""), (15, ""), (15, "trap '' HUP INT; ")] {
            if is_ignored(signal) {
                println!("skipped: signal {signal} is ignored here");
                continue;
            }
            let folder = folder();
            fs::write(folder.path().join(".dermatome-1-2-another-run"), "").unwrap();
            let before = listing(folder.path()).len();
            // Standard input that stays open keeps the run waiting in the middle of its output.
            let mut child = std::process::Command::new("sh")
                .args(["-c", &format!("{caller}exec \"$0\" lookup map.glb - -o out.csv")])
                .arg(assert_cmd::cargo::cargo_bin!("dermatome"))
                .current_dir(folder.path())
                .stdin(Stdio::piped())
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
                .unwrap();
            let mut input = child.stdin.take().unwrap();
            input.write_all(b"x,y,z\n0,0,-0.1\n").unwrap();
            interrupt(&mut child, signal, folder.path(), before);
            assert_eq!(child.wait().unwrap().code(), Some(128 + signal), "as shells know a stopped run");
            let left = listing(folder.path());
            assert_eq!(
                left,
                [".dermatome-1-2-another-run", "c.csv", "cap.obj", "map.glb"],
                "{signal} {caller}"
            );
        }
    }
}
