//! The README's commands, run as a newcomer would.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use std::{fs, path::Path};

use assert_cmd::Command;

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

#[test]
fn every_command_of_the_readme_works() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let readme = fs::read_to_string(root.join("README.md")).unwrap();
    let commands = commands(&readme);
    assert!(commands.len() >= 6, "the tour shows at least six subcommands, found {commands:?}");

    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("meshes")).unwrap();
    for entry in fs::read_dir(root.join("meshes")).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), folder.path().join("meshes").join(entry.file_name())).unwrap();
    }
    let binary = assert_cmd::cargo::cargo_bin!("dermatome");
    let path =
        std::env::join_paths([binary.parent().unwrap(), Path::new("/usr/bin"), Path::new("/bin")]).unwrap();
    for line in commands {
        let line = line.split(" #").next().unwrap().to_owned();
        Command::new("sh")
            .args(["-euc", &line])
            .current_dir(folder.path())
            .env("PATH", &path)
            .assert()
            .success();
    }
}
