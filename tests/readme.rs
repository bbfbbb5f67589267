//! The commands of the README and of each `--help`, run as a newcomer would.

mod common;

use std::{fs, path::Path};

use assert_cmd::Command;
use tempfile::TempDir;

/// Lines of `sh` blocks that call the command; `cargo run --release -- X` is `dermatome X`.
fn commands(readme: &str) -> Vec<String> {
    let mut in_shell = false;
    let mut found = Vec::new();
    for line in readme.lines() {
        if let Some(fence) = line.strip_prefix("```") {
            in_shell = fence == "sh";
        } else if in_shell {
            let line = line.replace("cargo run --release -- ", "dermatome ");
            if line.starts_with("dermatome ") || line.contains("| dermatome ") {
                found.push(line);
            }
        }
    }
    found
}

/// A folder with a copy of `meshes`.
fn checkout() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("meshes")).unwrap();
    for entry in fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("meshes")).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), folder.path().join("meshes").join(entry.file_name())).unwrap();
    }
    folder
}

/// Runs a line of a shell, without its comment.
fn run(folder: &Path, line: &str) {
    let binary = assert_cmd::cargo::cargo_bin!("dermatome");
    let path = [binary.parent().unwrap(), Path::new("/usr/bin"), Path::new("/bin")];
    Command::new("sh")
        .args(["-euc", line.split(" #").next().unwrap()])
        .current_dir(folder)
        .env("PATH", std::env::join_paths(path).unwrap())
        .assert()
        .success();
}

#[test]
fn every_command_of_the_readme_works() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let pages = ["README.md", "docs/experiment.md", "meshes/README.md"];
    let pages = pages.map(|page| fs::read_to_string(root.join(page)).unwrap());
    let commands = commands(&pages.concat());
    assert!(commands.len() >= 6, "the tour shows at least six subcommands, found {commands:?}");
    let folder = checkout();
    commands.iter().for_each(|line| run(folder.path(), line));
    // What they write lies in one folder, which git ignores.
    assert_eq!(common::listing(folder.path()), ["meshes", "out"]);
}

#[test]
fn every_help_ends_with_examples_that_work() {
    let help = |words: &str| {
        let output = common::dermatome(".", words).output().unwrap();
        String::from_utf8(output.stdout).unwrap()
    };
    let list = help("help");
    let names = list.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|l| !l.is_empty());
    let names: Vec<&str> = names.map(|line| line.split_whitespace().next().unwrap()).collect();
    assert!(names.len() > 10, "{names:?}");
    for name in names.into_iter().filter(|name| *name != "help") {
        let text = help(&format!("help {name}"));
        let (_, examples) = text.split_once("Examples:\n").unwrap_or_else(|| panic!("{name} has none"));
        let folder = checkout();
        for line in examples.lines() {
            run(folder.path(), line.trim());
        }
        assert!(examples.contains(&format!("dermatome {name}")), "{name}");
    }
}
