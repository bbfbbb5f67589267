//! The commands of the README and of each `--help`, run as a newcomer would.

use std::{fs, path::Path};

use assert_cmd::Command;
use tempfile::TempDir;

use crate::common;

/// Lines of `sh` blocks that call the command; `cargo run --release -- X` is `dermatome X`. With each the lines of the
/// `text` block that follows its own, if one does before the next `sh` block.
fn commands(readme: &str) -> Vec<(String, Vec<String>)> {
    let mut block = "";
    let mut found: Vec<(String, Vec<String>)> = Vec::new();
    for line in readme.lines() {
        if let Some(fence) = line.strip_prefix("```") {
            block = fence;
        } else if block == "sh" {
            let line = line.replace("cargo run --release -- ", "dermatome ");
            if line.starts_with("dermatome ") || line.contains("| dermatome ") {
                found.push((line, Vec::new()));
            }
        } else if let ("text", Some((_, printed))) = (block, found.last_mut())
            && !line.starts_with("cargo ")
        {
            printed.push(line.into());
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

/// Runs a line of a shell, without its comment: what it prints, notes included.
fn run(folder: &Path, line: &str) -> String {
    let binary = assert_cmd::cargo::cargo_bin!("dermatome");
    let path = [binary.parent().unwrap(), Path::new("/usr/bin"), Path::new("/bin")];
    let run = Command::new("sh")
        .args(["-euc", line.split(" #").next().unwrap()])
        .current_dir(folder)
        .env("PATH", std::env::join_paths(path).unwrap())
        .assert()
        .success();
    let output = run.get_output();
    [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text)).concat()
}

#[test]
fn every_command_of_the_readme_works() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let pages = ["README.md", "docs/experiment.md", "docs/design.md", "meshes/README.md"];
    let pages = pages.map(|page| fs::read_to_string(root.join(page)).unwrap());
    let commands = commands(&pages.concat());
    assert!(commands.len() >= 6, "the tour shows at least six subcommands, found {commands:?}");
    let folder = checkout();
    let mut printed = String::new();
    for (line, expected) in &commands {
        printed += &run(folder.path(), line);
        let missing: Vec<_> =
            expected.iter().filter(|line| !printed.lines().any(|other| other == *line)).collect();
        assert!(missing.is_empty(), "after {line} the page has {missing:#?}, printed was {printed}");
        if !expected.is_empty() {
            printed.clear();
        }
    }
    // What they write lies in one folder, which git ignores.
    assert_eq!(common::listing(folder.path()), ["meshes", "out"]);
}

/// The numbers of docs/experiment.md, as the page rounds them.
#[test]
fn the_experiment_gives_the_numbers_of_its_page() {
    let page = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/experiment.md")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let json = |words: &str| {
        let run = common::dermatome(&folder, words).assert().success();
        common::json(&run.get_output().stdout)
    };
    let calibrated = |simulated: &str, words: &str| {
        let simulate = format!("simulate {simulated} --truth t.csv -o o.csv");
        common::dermatome(&folder, &simulate).assert().success();
        json(&format!("calibrate o.csv --truth t.csv -o s.glb --json {words}"))
    };
    let arm = "simulate --arm --arm-noise-mm 1 --truth t.csv --triangles tri.csv -o log.csv";
    common::dermatome(&folder, arm).assert().success();
    common::dermatome(&folder, "touches log.csv -o c.csv").assert().success();
    let fit = json("calibrate c.csv --truth t.csv --triangles tri.csv -o s.glb --json");
    let built = json("build s.glb -o b --json");
    let level = |key: &str| built["patches"][0]["levels"][0][key].as_f64().unwrap();
    let said = format!(
        "the RMSE is {:.2} mm, {:.2} mm after rigid alignment, and the map has a mean `s1/s2` of {:.3}, at most {:.3}.",
        fit["rmse_mm"].as_f64().unwrap(),
        fit["rmse_aligned_mm"].as_f64().unwrap(),
        level("qc_mean"),
        level("qc_max"),
    );
    assert!(page.contains(&said), "{said}");
    for (noise, name) in [("0", "none"), ("1", "1 mm")] {
        let fit = calibrated(&format!("--noise-mm {noise}"), "");
        let built = json("build s.glb -o b --json");
        let level = &built["patches"][0]["levels"][0];
        let of = |key: &str| level[key].as_f64().unwrap();
        let row = format!(
            "| {name} | {:.2} mm | {:.0} | {:.3} | {:.3} | {:.3} | {} |",
            fit["rmse_aligned_mm"].as_f64().unwrap().abs(),
            fit["chi2"].as_f64().unwrap().abs(),
            of("qc_mean"),
            of("qc_max"),
            of("area_mean"),
            level["flips"]
        );
        assert!(page.contains(&row), "{row}");
    }
    for (robust, name) in [("none", "least squares (`--robust none`)"), ("auto", "default")] {
        let mean = |outliers: &str| {
            let of_seed = |seed: u32| {
                let simulated = format!("--noise-mm 1 --seed {seed} --outliers {outliers}");
                calibrated(&simulated, &format!("--robust {robust}"))["rmse_aligned_mm"].as_f64().unwrap()
            };
            (0..20).map(of_seed).sum::<f64>() / 20.0
        };
        let row =
            format!("| {name} | {:.2} mm | {:.2} mm | {:.2} mm |", mean("0"), mean("0.05"), mean("0.2"));
        assert!(page.contains(&row), "{row}");
    }
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

/// The commands of docs/recordings.md on the samples of other programs, with the layouts of the project.
#[test]
fn every_command_of_the_page_of_recordings_works() {
    let Some(samples) = common::data("recordings") else { return };
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    fs::create_dir_all(at.join("skin")).unwrap();
    fs::create_dir_all(at.join("layouts")).unwrap();
    for (sample, name) in [
        ("vendor/fscan_testL.asf", "walk.asf"),
        ("vendor/pliance_test.asc", "seat.asc"),
        ("numpy/glove.npz", "glove.npz"),
        ("xela/xr1944.jsonl", "fingertip.jsonl"),
        ("yarp/skin/data.log", "skin/data.log"),
    ] {
        fs::write(at.join(name), fs::read(samples.join(sample)).unwrap()).unwrap();
    }
    for entry in fs::read_dir(root.join("docs/layouts")).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), at.join("layouts").join(entry.file_name())).unwrap();
    }
    // Skins that the reader of the page has: a sheet of taxels, some mm apart.
    for (name, columns, ids) in [("glove", 16, 0..256), ("fingertip", 4, 1..17), ("forearm", 12, 1..193)] {
        let row = |id: u32| {
            format!("{id},{},{},0\n", 0.004 * f64::from(id % columns), 0.004 * f64::from(id / columns))
        };
        let rows: String = ids.map(row).collect();
        fs::write(at.join(format!("{name}.csv")), format!("id,x,y,z\n{rows}")).unwrap();
    }
    let pages = ["docs/recordings.md", "docs/pressure_mapping.md"];
    let pages = pages.map(|page| fs::read_to_string(root.join(page)).unwrap());
    let masks = pages[1].split("```json\n").nth(1).and_then(|rest| rest.split("```").next()).unwrap();
    fs::write(at.join("masks.json"), masks).unwrap();
    let commands = commands(&pages.concat());
    assert!(commands.len() > 10, "{commands:?}");
    let printed: String = commands.iter().map(|(line, _)| run(at, line)).collect();
    for part in ["\"source\":\"file\"", "\"matched\":955", "null"] {
        assert!(printed.replace(": ", ":").contains(part), "{part} is missing in {printed}");
    }
    let sums = fs::read_to_string(at.join("sums.csv")).unwrap();
    assert!(sums.contains("\nregion,forefoot,") && sums.contains("\nregion,heel,"), "{sums}");
}
