//! The command as a user runs it: what it writes, what it prints, how it fails.

use std::fs;
use std::path::Path;

use crate::common::{self, command, data, dermatome, listing, notes, refuses};
use dermatome::id::VertexId;
use dermatome::io::write_skin;
use dermatome::mesh::{TriMesh, shapes};
use dermatome::skin::{Patch, PatchId, Presence, Skin};
use predicates::{prelude::*, str::contains};
use serde_json::Value;
use tempfile::TempDir;

/// A folder with the skin of a mesh.
fn folder_with(name: &str, mesh: TriMesh) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let title = name.split('.').next().unwrap();
    write_skin(&folder.path().join(name), &Skin::from_mesh(title, mesh)).unwrap();
    folder
}

/// A folder with `cap.glb`, a curved disk of about 400 triangles.
fn folder_with_a_cap() -> TempDir {
    folder_with("cap.glb", shapes::cap(400, 0.1, 1.2))
}

/// A file of the folder `meshes`.
fn shipped(name: &str) -> String {
    format!("{}/meshes/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// What a command that succeeds prints as JSON.
fn printed(folder: impl AsRef<Path>, words: &str) -> Value {
    common::json(&dermatome(folder, words).assert().success().get_output().stdout)
}

#[test]
fn build_writes_its_four_files_and_nothing_else() {
    let folder = folder_with_a_cap();
    dermatome(&folder, "build cap.glb -o new/out").assert().success().stdout(contains("cap/L0"));
    let written = listing(&folder.path().join("new/out"));
    assert_eq!(written, ["map.exr", "map.glb", "report.html", "report.json", "timings.json"]);
}

#[test]
fn build_gives_the_same_bytes_for_any_number_of_threads() {
    let folder = folder_with_a_cap();
    let bytes = |threads: &str| {
        let out = folder.path().join(threads);
        dermatome(&folder, &format!("build cap.glb --threads {threads} -o {threads}")).assert().success();
        (fs::read(out.join("map.glb")).unwrap(), fs::read(out.join("map.exr")).unwrap())
    };
    let one = bytes("1");
    for threads in ["2", "7"] {
        assert!(bytes(threads) == one, "bytes with {threads} threads differ from those with one");
    }
}

#[test]
fn the_report_is_printed_as_it_is_written() {
    let folder = folder_with_a_cap();
    let printed = printed(&folder, "build cap.glb -o out --json");
    let written = common::json(&fs::read(folder.path().join("out/report.json")).unwrap());
    assert_eq!(printed, written, "--json prints report.json");
}

#[test]
fn errors_say_what_why_and_what_to_do_and_exit_with_2() {
    let folder = tempfile::tempdir().unwrap();
    for (name, content) in [("none.glb", None), ("empty.glb", Some("")), ("odd.xyz", Some("0 0 0"))] {
        if let Some(content) = content {
            fs::write(folder.path().join(name), content).unwrap();
        }
        let run = refuses(&folder, &format!("build {name} -o out"), &["error:", name, "help:"]);
        run.stderr(contains("panicked").not());
        assert!(!folder.path().join("out").exists(), "no folder is left behind by {name}");
    }
}

#[test]
fn a_closed_skin_is_cut_open_unless_that_is_forbidden() {
    let folder = folder_with("ball.glb", shapes::tetrahedron());
    refuses(&folder, "build ball.glb -o out --cut none", &["Euler characteristic 2", "ball", "--cut"]);
    notes(&folder, "build ball.glb -o out", &[]);
}

/// An export of Tekscan is known by its content: where none is, its kind is not what is wrong.
#[test]
fn what_is_not_there_cannot_be_read_whatever_its_kind() {
    let folder = folder_with("cap.obj", shapes::cap(200, 0.05, 1.0));
    notes(&folder, "build cap.obj -o M", &[]);
    for words in [
        "convert walk.asf mat.glb",
        "build walk.asf -o N",
        "render M/map.glb walk.asf -o r.npz",
        "layout walk.lst -o l.json",
        "calibrate touches.txt -o c.csv",
    ] {
        let run = refuses(&folder, words, &["cannot read", "check that the file exists"]);
        assert!(!String::from_utf8_lossy(&run.get_output().stderr).contains("unknown kind"), "{words}");
    }
    fs::write(folder.path().join("walk.asf"), "nothing of these").unwrap();
    refuses(&folder, "convert walk.asf mat.glb", &["unknown kind", "Tekscan"]);
}

#[test]
fn seams_are_given_as_pairs_of_taxels() {
    let folder = folder_with("tube.obj", shapes::tube(8, 4, 0.05, 0.1));
    let table = |table: &str| fs::write(folder.path().join("seams.csv"), table).unwrap();
    let words = "flatten tube.obj -o flat.npz --cut seams.csv --json";
    table("from,to\n1,9\n9,17\n17,25\n");
    let level = printed(&folder, words);
    assert_eq!(level["boundary_loops"], 1, "{level}");
    assert_eq!(level["vertices"], 32, "taxels, not places");
    assert!(level["seam"].as_f64().unwrap() >= 0.1, "{level}");
    for (pairs, said) in [
        ("from,to\n1,20\n", "from taxel 1 to taxel 20"),
        ("from,to\n1,2\n", "on the boundary"),
        ("from,to\n9,10\n10,11\n11,12\n12,13\n13,14\n14,15\n15,16\n16,9\n", "2 pieces"),
        ("from,to\n1,1\n", "another taxel"),
        ("from,to\n1,77\n", "taxel 77"),
        ("from,on\n1,2\n", "to"),
    ] {
        table(pairs);
        refuses(&folder, words, &[said, "help:"]);
    }
}

#[test]
fn an_output_that_cannot_be_written_leaves_the_older_one() {
    let folder = folder_with_a_cap();
    let out = folder.path().join("out");
    fs::write(&out, "a file, not a folder").unwrap();
    refuses(&folder, "build cap.glb -o out", &["cannot write"]);
    assert_eq!(fs::read_to_string(&out).unwrap(), "a file, not a folder");

    let out = folder.path().join("blocked");
    fs::create_dir_all(out.join("map.exr")).unwrap();
    fs::write(out.join("map.glb"), "older").unwrap();
    refuses(&folder, "build cap.glb -o blocked", &["map.exr"]);
    let left = fs::read_to_string(out.join("map.glb")).unwrap();
    assert_eq!(left, "older", "files change together or not at all");
    assert_eq!(listing(&out), ["map.exr", "map.glb"], "no temporary is left");
}

#[test]
fn a_full_disk_is_an_error() {
    let folder = folder_with_a_cap();
    let full = Path::new("/dev/full");
    if !full.exists() {
        println!("skipped: /dev/full");
        return;
    }
    std::os::unix::fs::symlink(full, folder.path().join("full.obj")).unwrap();
    refuses(&folder, "flatten cap.glb -o full.obj", &["space"]);
    for words in [&["info", "cap.glb"][..], &["plot", "cap.glb", "-o", "-"]] {
        let output = std::process::Command::new(assert_cmd::cargo::cargo_bin!("dermatome"))
            .args(words)
            .current_dir(&folder)
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

/// A file in the place of another is named by what it is, and help fits it.
#[test]
fn files_of_another_kind_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let cap = env!("CARGO_MANIFEST_DIR").to_owned() + "/meshes/sphere_cap.glb";
    dermatome(path, &format!("build {cap} -o M -q")).assert().success();
    for (name, text) in [
        ("touch.csv", "x,y,z\n0,0,0\n"),
        ("linked.csv", "x,y,z,link\n0,0,0,sphere_cap\n"),
        ("r.csv", "time,1,2\n0,1,2\n"),
        ("comma.csv", "time;1;2\n0,0;1,5;2\n"),
        ("cross.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 3 2 4\n"),
        ("x.g2o", "x"),
        ("x.mcap", "x"),
        ("x.h5", "x"),
    ] {
        fs::write(path.join(name), text).unwrap();
    }
    for (words, said) in [
        ("lookup touch.csv M/map.glb", &["touch.csv is not a map", "the map comes first"][..]),
        ("render r.csv M/map.glb -o o.npz", &["r.csv is not a map"]),
        ("lookup M touch.csv", &["name the map.glb in it"]),
        ("info r.csv", &["a recording of readings, not a skin", "dermatome render"]),
        ("build M/map.exr -o N", &["has images, not a skin"]),
        ("check x.g2o", &["observations", "dermatome calibrate"]),
        ("info cross.obj", &["line 5, `f`", "crosses or touches itself"]),
        ("lookup M/map.glb linked.csv", &["needed: the name of a link, or nothing: `"]),
        ("render M/map.glb x.mcap -o o.npz", &["dermatome.ros"]),
        ("render M/map.glb x.h5 -o o.npz", &["numpy.savez"]),
    ] {
        refuses(path, words, said);
    }
    let comma = refuses(path, "render M/map.glb comma.csv -o o.npz", &["a decimal point"]);
    comma.stderr(contains("dermatome check").not());
    refuses(path, &format!("build {cap} -o N --spacing 8"), &["8 m apart", "as 8mm"]);
}

#[test]
fn a_merge_that_is_no_surface_is_refused_with_a_pointer_to_check() {
    let Some(path) = data("cyskin/broken_link1_patches_1_2.json") else { return };
    let (folder, path) = (tempfile::tempdir().unwrap(), path.display());
    refuses(&folder, &format!("build {path} -o out"), &["dermatome check"]);
    let found = dermatome(&folder, &format!("check {path}")).assert().code(1);
    found.stdout(contains(": non-manifold-edge: ").and(contains(": isolated-taxel: ")));
}

#[test]
fn a_real_cover_is_mapped_almost_without_distortion() {
    let Some(path) = data("cyskin/ur10e_link1_patch1_isomap.json") else { return };
    let folder = tempfile::tempdir().unwrap();
    let report = printed(&folder, &format!("build {} -o out --json", path.display()));
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
    refuses(".", "man bild", &["no subcommand", "build,"]);
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
    let build = |words: &str| dermatome(&folder, &format!("build copies.gltf -o out {words}")).assert();
    let pixels = |text: &str| -> f64 {
        let side = text.split("--pixel-mm ").nth(1).unwrap();
        side.split([' ', ':']).next().unwrap().parse().unwrap()
    };
    let by_default = build("").success().stderr(contains("pixels of ").and(contains("megapixels")));
    let side = pixels(&String::from_utf8_lossy(&by_default.get_output().stderr));
    assert!(side > 1.0 && side < 80.0, "{side} mm");
    let before = fs::read(out.join("map.exr")).unwrap();
    let small = build("--pixel-mm 1").code(2);
    let small = small.stderr(contains("400 images").and(contains("bytes of samples")));
    assert_eq!(
        pixels(&String::from_utf8_lossy(&small.get_output().stderr)),
        side,
        "the advice is the default"
    );
    build(&format!("--pixel-mm {side}")).success().stderr(contains("note").not());
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
    let skin = Skin::from_mesh(&"n".repeat(70_000), shapes::triangle());
    write_skin(&folder.path().join("long.gltf"), &skin).unwrap();
    let run = dermatome(&folder, "info long.gltf").assert().success();
    assert!(run.get_output().stdout.len() < 1000, "the table stays narrow");
}

#[test]
fn a_compressed_file_is_refused_with_the_way_out() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["KHR_draco_mesh_compression", "EXT_meshopt_compression"] {
        let text = format!(
            r#"{{"asset":{{"version":"2.0"}},"extensionsUsed":["{name}"],"extensionsRequired":["{name}"]}}"#
        );
        fs::write(folder.path().join("small.gltf"), text).unwrap();
        refuses(&folder, "info small.gltf", &[name, "gltf-transform"]);
    }
}

#[test]
fn a_skin_too_far_away_for_f32_is_refused() {
    let mut mesh = shapes::lattice(5, 5, 1e-3);
    mesh.positions.iter_mut().for_each(|p| p.x += 1e6);
    let folder = folder_with("far.ply", mesh);
    let said = ["without area after rounding", "patch \"far\""];
    refuses(&folder, "build far.ply -o out", &said).stderr(contains(".dermatome").not());
}

#[test]
fn a_linear_map_that_flips_is_written_and_said() {
    let folder = tempfile::tempdir().unwrap();
    let said = ["note: forearm: the map overlaps itself (L0: flips ", "--area 0"];
    notes(&folder, &format!("build {} -o out --method linear", shipped("forearm.glb")), &said);
}

/// No triangle of this map flips, but its boundary crosses itself.
#[test]
fn a_map_that_only_crosses_itself_is_said_to() {
    let folder = tempfile::tempdir().unwrap();
    let flatten = |extra: &str| {
        let hand = shipped("hand.glb");
        notes(&folder, &format!("flatten {hand} -o hand.npz --method linear {extra}"), &[])
    };
    flatten("").stderr(contains("(L0: flips 0, crossings "));
    flatten("--quiet").stderr("");
    flatten("--area 0").stderr(predicate::str::starts_with("wrote ").and(contains("note").not()));
}

#[test]
fn what_a_format_cannot_keep_is_said() {
    let folder = tempfile::tempdir().unwrap();
    for (name, said) in [("r.json", true), ("r.ply", true), ("r.glb", false)] {
        let run = notes(&folder, &format!("convert {} {name}", shipped("robot.glb")), &[]);
        let note = String::from_utf8_lossy(&run.get_output().stderr).contains("keeps everything");
        assert_eq!(note, said, "{name}");
    }
}

#[test]
fn extensions_and_options_out_of_range_are_refused() {
    let folder = folder_with_a_cap();
    refuses(&folder, "coarsen cap.glb -o levels.obj", &["glb"]);
    refuses(&folder, "info cap.glb --threads 100000", &["512"]);
    refuses(&folder, "coarsen cap.glb -o x.glb --coarsest 2.5", &[]);
}

#[test]
fn options_that_would_change_nothing_are_refused() {
    let folder = folder_with_a_cap();
    let flatten = |words: &str| format!("flatten cap.glb -o f.npz {words}");
    for (words, idle) in [
        ("--method conformal --magnify 0.5", "--magnify"),
        ("--method conformal --area 2", "--area"),
        ("--method linear --energy sum", "--energy"),
        ("--energy symmetric-dirichlet --area 1", "--area"),
    ] {
        refuses(&folder, &flatten(words), &[&format!("{idle} changes nothing with")]);
    }
    for words in
        ["--method conformal", "--method linear --area 0", "--energy symmetric-dirichlet --magnify 0.5"]
    {
        notes(&folder, &flatten(words), &[]);
    }
}

/// CAD and scanners write millimetres; no format but glTF tells.
#[test]
fn a_skin_in_millimetres_is_suspected() {
    let folder = folder_with("mm.obj", shapes::lattice(10, 10, 10.0));
    let suspected = "across: is the file in millimetres?";
    notes(&folder, "info mm.obj", &[suspected]);
    let found = notes(&folder, "check mm.obj", &[]);
    found.stdout(contains(suspected).and(predicate::str::starts_with("warning: mm: doubtful-unit: ")));
    let folder = folder_with("m.obj", shapes::lattice(10, 10, 0.01));
    notes(&folder, "info m.obj", &[]).stderr("");
    notes(&folder, "check m.obj", &[]);
}

/// The parser of PLY tells its insides after the first line.
#[test]
fn a_file_that_is_no_ply_is_told_of_in_plain_words() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("wrong.ply"), "v 0.0 0.0 0\nv 1.0 0.0 0\n").unwrap();
    let run = refuses(&folder, "info wrong.ply", &["found \"v 0.0 0.0 0\": Expected magic number 'ply'"]);
    run.stderr(contains("ParseError").not());
}

/// The boundary of a first map, as a table, prescribes that of a second one.
#[test]
fn a_table_prescribes_the_boundary() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(
        folder.join("square.obj"),
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv .4 .5 .2\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n",
    )
    .unwrap();
    let table = "taxel_id,u,v\n1,0,0\n2,2,0\n3,2,1\n4,0,1\n";
    fs::write(folder.join("canvas.csv"), table).unwrap();
    let flatten = |boundary: &str| format!("flatten square.obj -o flat.obj --boundary {boundary}");
    notes(folder, &flatten("canvas.csv"), &[]);
    let flat = fs::read_to_string(folder.join("flat.obj")).unwrap();
    let corners: Vec<&str> = flat.lines().filter(|line| line.starts_with("vt ")).take(4).collect();
    assert_eq!(corners, ["vt 0.0 0.0", "vt 2.0 0.0", "vt 2.0 1.0", "vt 0.0 1.0"]);
    fs::write(folder.join("canvas.csv"), table.replace("4,0,1\n", "9,0,1\n")).unwrap();
    let said = ["0 taxels have the id 9", "help: correct --boundary"];
    refuses(folder, &flatten("canvas.csv"), &said);
    fs::write(folder.join("canvas.csv"), table.replace("4,0,1\n", "4,0,x\n")).unwrap();
    refuses(folder, &flatten("canvas.csv"), &["canvas.csv", "line 5"]);
    refuses(folder, &flatten("oval"), &["needed: free, circle or a table"]);
}

/// In every band, on both sides of the skin, intervals hold the exact distance and are narrow. Every level has a row.
#[test]
fn bench_measures_every_level() {
    let folder = folder_with_a_cap();
    let built = printed(&folder, "build cap.glb -o map --json");
    let costs = printed(&folder, "bench map/map.glb --json");
    let (built, bands) =
        (built["patches"][0]["levels"].as_array().unwrap(), costs["bands"].as_array().unwrap());
    assert_eq!(costs["faces"], built[0]["faces"]);
    let off: Vec<[f64; 2]> =
        bands.iter().map(|band| [0, 1].map(|k| band["off_mm"][k].as_f64().unwrap())).collect();
    assert_eq!(off, [[0.0, 3.0], [3.0, 10.0], [10.0, 20.0], [20.0, 50.0]]);
    for band in bands {
        assert!(band["violations"] == 0 && band["wrong_sides"].as_f64().unwrap() < 0.01, "{band}");
        let [interval, error] = ["interval_mm", "error_mm"].map(|key| band[key][2].as_f64().unwrap());
        assert!(error <= interval && band["interval_mm"][0].as_f64().unwrap() < 1.5, "{band}");
        assert!(band["decided"][3].as_f64().unwrap() > 0.8, "{band}");
        let faces = |levels: &[Value]| levels.iter().map(|level| level["faces"].clone()).collect::<Vec<_>>();
        let levels = band["levels"].as_array().unwrap();
        assert_eq!(faces(levels), faces(built));
        assert!(levels.iter().all(|level| level["same_field"][1].as_f64().unwrap() > 0.5), "{band}");
    }
    notes(&folder, "build cap.glb -o single --levels 0", &[]);
    let run = notes(&folder, "bench single/map.glb", &[]);
    let table = String::from_utf8_lossy(&run.get_output().stdout);
    let row = |start: &str| table.lines().filter(|line| line.starts_with(start)).count();
    assert_eq!((row("| single ns |"), row("| 20 to 50 |")), (1, 2), "{table}");
}
