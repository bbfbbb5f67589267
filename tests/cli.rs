//! The command as a user runs it: what it writes, what it prints, how it fails.

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use common::{command, data, dermatome, listing};
use dermatome::id::VertexId;
use dermatome::io::write_skin;
use dermatome::mesh::shapes;
use dermatome::skin::{Patch, PatchId, Presence, Skin};
use predicates::{prelude::*, str::contains};
use serde_json::Value;
use tempfile::TempDir;

/// A folder with `cap.glb`, a curved disk of about 400 triangles.
fn folder_with_a_cap() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cap.glb");
    write_skin(&path, &Skin::from_mesh("cap", shapes::cap(400, 0.1, 1.2))).unwrap();
    (folder, path)
}

#[test]
fn build_writes_its_four_files_and_nothing_else() {
    let (folder, skin) = folder_with_a_cap();
    let out = folder.path().join("new/out");
    command().arg("build").arg(&skin).arg("-o").arg(&out).assert().success().stdout(contains("cap/L0"));
    assert_eq!(listing(&out), ["map.exr", "map.glb", "report.html", "report.json", "timings.json"]);
}

#[test]
fn build_gives_the_same_bytes_for_any_number_of_threads() {
    let (folder, skin) = folder_with_a_cap();
    let bytes = |threads: &str| {
        let out = folder.path().join(threads);
        command().args(["build", "--threads", threads]).arg(&skin).arg("-o").arg(&out).assert().success();
        (fs::read(out.join("map.glb")).unwrap(), fs::read(out.join("map.exr")).unwrap())
    };
    let one = bytes("1");
    for threads in ["2", "7"] {
        assert!(bytes(threads) == one, "bytes with {threads} threads differ from those with one");
    }
}

#[test]
fn the_report_is_printed_as_it_is_written() {
    let (folder, skin) = folder_with_a_cap();
    let out = folder.path().join("out");
    let printed = command().args(["build", "--json"]).arg(&skin).arg("-o").arg(&out).assert().success();
    let printed: serde_json::Value = serde_json::from_slice(&printed.get_output().stdout).unwrap();
    let written: serde_json::Value =
        serde_json::from_slice(&fs::read(out.join("report.json")).unwrap()).unwrap();
    assert_eq!(printed, written, "--json prints report.json");
}

#[test]
fn errors_say_what_why_and_what_to_do_and_exit_with_2() {
    let folder = tempfile::tempdir().unwrap();
    for (name, content) in [("none.glb", None), ("empty.glb", Some("")), ("odd.xyz", Some("0 0 0"))] {
        let path = folder.path().join(name);
        if let Some(content) = content {
            fs::write(&path, content).unwrap();
        }
        let out = folder.path().join("out");
        command().arg("build").arg(&path).arg("-o").arg(&out).assert().code(2).stderr(
            contains("error:").and(contains(name)).and(contains("help:")).and(contains("panicked").not()),
        );
        assert!(!out.exists(), "no folder is left behind by {name}");
    }
}

#[test]
fn a_closed_skin_is_cut_open_unless_that_is_forbidden() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.glb");
    write_skin(&path, &Skin::from_mesh("ball", shapes::tetrahedron())).unwrap();
    let build = || {
        let mut command = command();
        command.arg("build").arg(&path).arg("-o").arg(folder.path().join("out"));
        command
    };
    build()
        .args(["--cut", "none"])
        .assert()
        .code(2)
        .stderr(contains("Euler characteristic 2").and(contains("ball")).and(contains("--cut")));
    build().assert().success();
}

#[test]
fn seams_are_given_as_pairs_of_taxels() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, seams) = (folder.path().join("tube.obj"), folder.path().join("seams.csv"));
    write_skin(&mesh, &Skin::from_mesh("tube", shapes::tube(8, 4, 0.05, 0.1))).unwrap();
    let flatten = |table: &str| {
        fs::write(&seams, table).unwrap();
        let out = folder.path().join("flat.npz");
        let mut command = command();
        command.arg("flatten").arg(&mesh).arg("-o").arg(out).arg("--cut").arg(&seams).arg("--json");
        command.assert()
    };
    let printed = flatten("from,to\n1,9\n9,17\n17,25\n").success();
    let level: serde_json::Value = serde_json::from_slice(&printed.get_output().stdout).unwrap();
    assert_eq!(level["boundary_loops"], 1, "{level}");
    assert_eq!(level["vertices"], 32, "taxels, not places");
    assert!(level["seam"].as_f64().unwrap() >= 0.1, "{level}");
    for (table, said) in [
        ("from,to\n1,20\n", "from taxel 1 to taxel 20"),
        ("from,to\n1,2\n", "on the boundary"),
        ("from,to\n9,10\n10,11\n11,12\n12,13\n13,14\n14,15\n15,16\n16,9\n", "2 pieces"),
        ("from,to\n1,1\n", "another taxel"),
        ("from,to\n1,77\n", "taxel 77"),
        ("from,on\n1,2\n", "to"),
    ] {
        flatten(table).code(2).stderr(contains(said).and(contains("help:")));
    }
}

#[test]
fn an_output_that_cannot_be_written_leaves_the_older_one() {
    let (folder, skin) = folder_with_a_cap();
    let out = folder.path().join("out");
    fs::write(&out, "a file, not a folder").unwrap();
    command().arg("build").arg(&skin).arg("-o").arg(&out).assert().code(2).stderr(contains("cannot write"));
    assert_eq!(fs::read_to_string(&out).unwrap(), "a file, not a folder");

    let out = folder.path().join("blocked");
    fs::create_dir_all(out.join("map.exr")).unwrap();
    fs::write(out.join("map.glb"), "older").unwrap();
    command().arg("build").arg(&skin).arg("-o").arg(&out).assert().code(2).stderr(contains("map.exr"));
    assert_eq!(
        fs::read_to_string(out.join("map.glb")).unwrap(),
        "older",
        "files change together or not at all"
    );
    assert_eq!(listing(&out), ["map.exr", "map.glb"], "no temporary is left");
}

#[test]
fn a_full_disk_is_an_error() {
    let (_folder, skin) = folder_with_a_cap();
    let full = Path::new("/dev/full");
    if !full.exists() {
        println!("skipped: /dev/full");
        return;
    }
    let link = skin.with_file_name("full.obj");
    std::os::unix::fs::symlink(full, &link).unwrap();
    command().arg("flatten").arg(&skin).arg("-o").arg(&link).assert().code(2).stderr(contains("space"));
    for words in [&["info"][..], &["plot", "-o", "-"]] {
        let output = std::process::Command::new(assert_cmd::cargo::cargo_bin!("dermatome"))
            .args(words)
            .arg(&skin)
            .stdout(fs::OpenOptions::new().write(true).open(full).unwrap())
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap()
            .wait_with_output()
            .unwrap();
        assert_eq!(output.status.code(), Some(2));
        let told = String::from_utf8_lossy(&output.stderr);
        for said in ["cannot write standard output", "space", "help:"] {
            assert!(told.contains(said), "{said:?} in {told:?} of {words:?}");
        }
    }
}

#[test]
fn a_merge_that_is_no_surface_is_refused_with_a_pointer_to_check() {
    let Some(path) = data("cyskin/broken_link1_patches_1_2.json") else { return };
    let out = tempfile::tempdir().unwrap();
    command()
        .arg("build")
        .arg(&path)
        .arg("-o")
        .arg(out.path())
        .assert()
        .code(2)
        .stderr(contains("dermatome check"));
    command()
        .arg("check")
        .arg(&path)
        .assert()
        .code(1)
        .stdout(contains(": non-manifold-edge: ").and(contains(": isolated-taxel: ")));
}

#[test]
fn a_real_cover_is_mapped_almost_without_distortion() {
    let Some(path) = data("cyskin/ur10e_link1_patch1_isomap.json") else { return };
    let out = tempfile::tempdir().unwrap();
    let run = command().args(["build", "--json"]).arg(&path).arg("-o").arg(out.path()).assert().success();
    let report: serde_json::Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
    let levels = report["patches"][0]["levels"].as_array().unwrap();
    assert!(levels.iter().all(|l| l["flips"] == 0), "no level flips");
    let measure = |key: &str| levels[0][key].as_f64().unwrap();
    assert!(measure("qc_mean") <= 1.005, "mean s1/s2 {}", measure("qc_mean"));
    assert!(measure("qc_max") <= 1.1, "max s1/s2 {}", measure("qc_max"));
    assert!(measure("area_mean") <= 1.01, "mean area ratio {}", measure("area_mean"));
}

#[test]
fn completions_and_manual_name_every_subcommand() {
    for args in [vec!["completions", "bash"], vec!["man"]] {
        let mut all = command().args(&args).assert().success();
        for name in ["build", "check", "convert", "coarsen", "flatten", "info", "lookup", "plot"] {
            all = all.stdout(contains(name));
        }
    }
    let of_build = command().args(["man", "build"]).assert().success();
    of_build.stdout(contains("dermatome\\-build").and(contains("crossings")).and(contains("pixel")));
    command()
        .args(["man", "bild"])
        .assert()
        .code(2)
        .stderr(contains("no subcommand").and(contains("build,")));
}

/// Pixels are bounded by taxels: by default they grow, and smaller ones are refused.
#[test]
fn images_have_as_many_pixels_as_the_taxels_need() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("copies.gltf");
    let mut skin = Skin::from_mesh("0", shapes::triangle());
    let patch = skin.patches[PatchId::new(0)].clone();
    for k in 1..400 {
        skin.patches.push(Patch { name: k.to_string(), ..patch.clone() });
    }
    write_skin(&path, &skin).unwrap();
    let out = folder.path().join("out");
    let build = |pixel: &[&str]| command().arg("build").args(pixel).arg(&path).arg("-o").arg(&out).assert();
    let pixels = |text: &str| -> f64 {
        let side = text.split("--pixel-mm ").nth(1).unwrap();
        side.split([' ', ':']).next().unwrap().parse().unwrap()
    };
    let by_default = build(&[]).success().stderr(contains("pixels of ").and(contains("megapixels")));
    let side = pixels(&String::from_utf8_lossy(&by_default.get_output().stderr));
    assert!(side > 1.0 && side < 80.0, "{side} mm");
    let before = fs::read(out.join("map.exr")).unwrap();
    let small = build(&["--pixel-mm", "1"]).code(2);
    let small = small.stderr(contains("400 images").and(contains("bytes of samples")));
    assert_eq!(
        pixels(&String::from_utf8_lossy(&small.get_output().stderr)),
        side,
        "the advice is the default"
    );
    build(&["--pixel-mm", &side.to_string()]).success().stderr(contains("note").not());
    assert!(fs::read(out.join("map.exr")).unwrap() == before, "the pixel that the note names is the default");
    assert!(before.len() < 56 << 20, "{} bytes", before.len());
}

/// What each slot holds, and the range of densities where they are known.
#[test]
fn info_counts_absent_taxels() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("skin.csv");
    let mut skin = Skin::from_mesh("palm", shapes::lattice(5, 4, 0.01));
    let taxels = &mut skin.patches[PatchId::new(0)].taxels;
    for (v, presence) in [(3, Presence::Absent), (7, Presence::ThermalPad), (8, Presence::Absent)] {
        taxels.presence[VertexId::new(v)] = presence;
    }
    let info = |skin: &Skin, args: &[&str]| {
        write_skin(&path, skin).unwrap();
        let run = command().arg("info").arg(&path).args(args).assert().success();
        String::from_utf8(run.get_output().stdout.clone()).unwrap()
    };
    let row = info(&skin, &[]);
    let cells: Vec<_> = row.lines().nth(1).unwrap().split_whitespace().collect();
    assert!(cells.ends_with(&["17", "2", "1", "-"]), "{row}");
    let taxels = &mut skin.patches[PatchId::new(0)].taxels;
    taxels.densities = Some(taxels.areas.map(|_| 1e4));
    taxels.densities.as_mut().unwrap()[VertexId::new(2)] = 4e4;
    assert!(info(&skin, &[]).contains("10000.0000..40000.0000"));
    let json: serde_json::Value = serde_json::from_str(&info(&skin, &["--json"])).unwrap();
    let patch = &json["patches"][0];
    assert_eq!([&patch["present"], &patch["absent"], &patch["thermal"]], [17, 2, 1]);
    assert_eq!(patch["density_per_m2"], serde_json::json!([1e4, 4e4]));
}

#[test]
fn a_long_name_is_cut_in_tables() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.gltf");
    write_skin(&path, &Skin::from_mesh(&"n".repeat(70_000), shapes::triangle())).unwrap();
    let run = command().arg("info").arg(&path).assert().success();
    assert!(run.get_output().stdout.len() < 1000, "the table stays narrow");
}

#[test]
fn a_compressed_file_is_refused_with_the_way_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.gltf");
    for name in ["KHR_draco_mesh_compression", "EXT_meshopt_compression"] {
        let text = format!(
            r#"{{"asset":{{"version":"2.0"}},"extensionsUsed":["{name}"],"extensionsRequired":["{name}"]}}"#
        );
        fs::write(&path, text).unwrap();
        let run = command().arg("info").arg(&path).assert().code(2);
        run.stderr(contains(name).and(contains("gltf-transform")));
    }
}

#[test]
fn a_skin_too_far_away_for_f32_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("far.ply");
    let mut mesh = shapes::lattice(5, 5, 1e-3);
    mesh.positions.iter_mut().for_each(|p| p.x += 1e6);
    write_skin(&path, &Skin::from_mesh("far", mesh)).unwrap();
    command().arg("build").arg(&path).arg("-o").arg(folder.path().join("out")).assert().code(2).stderr(
        contains("without area after rounding")
            .and(contains("patch \"far\""))
            .and(contains(".dermatome").not()),
    );
}

#[test]
fn a_linear_map_that_flips_is_written_and_said() {
    let out = tempfile::tempdir().unwrap();
    let forearm = Path::new(env!("CARGO_MANIFEST_DIR")).join("meshes/forearm.glb");
    let linear = ["--method", "linear"];
    command()
        .arg("build")
        .arg(&forearm)
        .arg("-o")
        .arg(out.path())
        .args(linear)
        .assert()
        .success()
        .stderr(contains("note: forearm: the map overlaps itself (L0: flips ").and(contains("--area 0")));
}

/// No triangle of this map flips, but its boundary crosses itself.
#[test]
fn a_map_that_only_crosses_itself_is_said_to() {
    let out = tempfile::tempdir().unwrap();
    let hand = Path::new(env!("CARGO_MANIFEST_DIR")).join("meshes/hand.glb");
    let flatten = |extra: &[&str]| {
        let mut command = command();
        command.arg("flatten").arg(&hand).arg("-o").arg(out.path().join("hand.npz"));
        command.args(["--method", "linear"]).args(extra).assert().success()
    };
    flatten(&[]).stderr(contains("(L0: flips 0, crossings "));
    flatten(&["--quiet"]).stderr("");
    flatten(&["--area", "0"]).stderr(predicate::str::starts_with("wrote ").and(contains("note").not()));
}

#[test]
fn what_a_format_cannot_keep_is_said() {
    let out = tempfile::tempdir().unwrap();
    let robot = Path::new(env!("CARGO_MANIFEST_DIR")).join("meshes/robot.glb");
    for (name, said) in [("r.json", true), ("r.ply", true), ("r.glb", false)] {
        let run = command().arg("convert").arg(&robot).arg(out.path().join(name)).assert().success();
        let note = String::from_utf8_lossy(&run.get_output().stderr).contains("keeps everything");
        assert_eq!(note, said, "{name}");
    }
}

#[test]
fn extensions_and_options_out_of_range_are_refused() {
    let (folder, skin) = folder_with_a_cap();
    let out = folder.path().join("levels.obj");
    command().arg("coarsen").arg(&skin).arg("-o").arg(&out).assert().code(2).stderr(contains("glb"));
    command().arg("info").arg(&skin).args(["--threads", "100000"]).assert().code(2).stderr(contains("512"));
    command().arg("coarsen").arg(&skin).args(["-o", "x.glb", "--ratio", "1.5"]).assert().code(2);
}

#[test]
fn options_that_would_change_nothing_are_refused() {
    let (folder, skin) = folder_with_a_cap();
    let flatten = |words: &str| {
        let mut command = command();
        command.arg("flatten").arg(&skin).arg("-o").arg(folder.path().join("f.npz"));
        command.args(words.split_whitespace());
        command
    };
    for (words, idle) in [
        ("--method conformal --magnify 0.5", "--magnify"),
        ("--method conformal --area 2", "--area"),
        ("--method linear --energy sum", "--energy"),
        ("--energy symmetric-dirichlet --area 1", "--area"),
    ] {
        flatten(words).assert().code(2).stderr(contains(format!("{idle} changes nothing with")));
    }
    for words in
        ["--method conformal", "--method linear --area 0", "--energy symmetric-dirichlet --magnify 0.5"]
    {
        flatten(words).assert().success();
    }
}

/// CAD and scanners write millimetres; no format but glTF tells.
#[test]
fn a_skin_in_millimetres_is_suspected() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mm.obj");
    write_skin(&path, &Skin::from_mesh("mm", shapes::lattice(10, 10, 10.0))).unwrap();
    let suspected = contains("across: is the file in millimetres?");
    command().arg("info").arg(&path).assert().success().stderr(suspected.clone());
    command()
        .arg("check")
        .arg(&path)
        .assert()
        .success()
        .stdout(suspected.and(predicate::str::starts_with("warning: mm: doubtful-unit: ")));
    let path = folder.path().join("m.obj");
    write_skin(&path, &Skin::from_mesh("m", shapes::lattice(10, 10, 0.01))).unwrap();
    command().arg("info").arg(&path).assert().success().stderr("");
    command().arg("check").arg(&path).assert().success();
}

/// The parser of PLY tells its insides after the first line.
#[test]
fn a_file_that_is_no_ply_is_told_of_in_plain_words() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wrong.ply");
    fs::write(&path, "v 0.0 0.0 0\nv 1.0 0.0 0\n").unwrap();
    command().arg("info").arg(&path).assert().code(2).stderr(
        contains("found \"v 0.0 0.0 0\": Expected magic number 'ply'").and(contains("ParseError").not()),
    );
}

/// The boundary of a first map, as a table, prescribes that of a second one.
#[test]
fn a_table_prescribes_the_boundary() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::write(
        folder.join("square.obj"),
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv .4 .5 .2\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n",
    )
    .unwrap();
    let table = "taxel_id,u,v\n1,0,0\n2,2,0\n3,2,1\n4,0,1\n";
    std::fs::write(folder.join("canvas.csv"), table).unwrap();
    let flatten = |boundary: &str| {
        let args = ["flatten", "square.obj", "-o", "flat.obj", "--boundary", boundary];
        command().current_dir(folder).args(args).assert()
    };
    flatten("canvas.csv").success();
    let flat = std::fs::read_to_string(folder.join("flat.obj")).unwrap();
    let corners: Vec<&str> = flat.lines().filter(|line| line.starts_with("vt ")).take(4).collect();
    assert_eq!(corners, ["vt 0.0 0.0", "vt 2.0 0.0", "vt 2.0 1.0", "vt 0.0 1.0"]);
    flatten("rectangle:2:1").success();
    std::fs::write(folder.join("canvas.csv"), table.replace("4,0,1\n", "9,0,1\n")).unwrap();
    flatten("canvas.csv")
        .code(2)
        .stderr(contains("0 taxels have the id 9").and(contains("help: correct --boundary")));
    std::fs::write(folder.join("canvas.csv"), table.replace("4,0,1\n", "4,0,x\n")).unwrap();
    flatten("canvas.csv").code(2).stderr(contains("canvas.csv").and(contains("line 5")));
    flatten("oval").code(2).stderr(contains("needed: free, circle, rectangle"));
}

/// Of every level above level 0, answers within their bounds, which grow with the level; of a map without such
/// levels the exact answers alone.
#[test]
fn bench_measures_every_level() {
    let (folder, _) = folder_with_a_cap();
    let run = |words: &str| dermatome(folder.path(), words).assert().success().get_output().stdout.clone();
    let built: Value = serde_json::from_slice(&run("build cap.glb -o map --json")).unwrap();
    let costs: Value = serde_json::from_slice(&run("bench map/map.glb --json")).unwrap();
    let (built, levels) = (&built["patches"][0]["levels"], costs["levels"].as_array().unwrap());
    assert_eq!(costs["faces"], built[0]["faces"]);
    assert_eq!(levels.len() + 1, built.as_array().unwrap().len());
    let mut last = 0.0;
    for (level, built) in levels.iter().zip(built.as_array().unwrap().iter().skip(1)) {
        assert_eq!((&level["faces"], &level["violations"]), (&built["faces"], &0.into()));
        let [bound, error] = ["bound_mm", "error_mm"].map(|key| level[key][2].as_f64().unwrap());
        assert!(error <= bound && bound > last, "{level}");
        last = bound;
    }
    run("build cap.glb -o single --levels 0");
    let table = String::from_utf8(run("bench single/map.glb")).unwrap();
    assert!(table.contains("| single ns |") && table.trim_end().ends_with("|---|"), "{table}");
}
