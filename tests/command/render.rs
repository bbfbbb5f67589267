//! `render` as a user runs it.

use std::fmt::Write;
use std::fs;
use std::io::Read;
use std::path::Path;
use std::process::{self, Stdio};
use std::time::Duration;

use crate::common::{dermatome, json, listing, notes, npy, refuses};
use predicates::{prelude::*, str::contains};

/// A folder with the map of a sheet of 12 x 10 taxels, ids from 1 on, and a recording of five frames:
/// frame `t` reads `t` everywhere.
fn sheet() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut obj = String::new();
    for k in 0..120 {
        writeln!(obj, "v {} {} 0", 0.004 * f64::from(k % 12), 0.004 * f64::from(k / 12)).unwrap();
    }
    for (x, y) in (0..9).flat_map(|y| (0..11).map(move |x| (x, y))) {
        let a = 12 * y + x + 1;
        writeln!(obj, "f {a} {} {}\nf {a} {} {}", a + 1, a + 13, a + 13, a + 12).unwrap();
    }
    fs::write(folder.path().join("sheet.obj"), obj).unwrap();
    dermatome(folder.path(), "build sheet.obj -o map --quiet").assert().success();
    fs::write(folder.path().join("r.csv"), table(1..=120, 5)).unwrap();
    folder
}

/// A recording of `frames` frames, 10 a second.
fn table(ids: impl Iterator<Item = u32>, frames: u32) -> String {
    let ids: Vec<String> = ids.map(|id| format!("{id}.pressure[Pa]")).collect();
    let mut text = format!("time,{}\n", ids.join(","));
    for t in 0..frames {
        let row = vec![t.to_string(); ids.len()];
        writeln!(text, "{},{}", 0.1 * f64::from(t), row.join(",")).unwrap();
    }
    text
}

/// The numbers of the `f32` array of a `.npy`.
fn numbers(bytes: &[u8]) -> Vec<f32> {
    let header = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    bytes[header..].chunks_exact(4).map(|x| f32::from_le_bytes(x.try_into().unwrap())).collect()
}

/// The numbers of an array of `all.npz`.
fn array(folder: &tempfile::TempDir, name: &str) -> Vec<f64> {
    let mut archive = zip::ZipArchive::new(fs::File::open(folder.path().join("all.npz")).unwrap()).unwrap();
    let mut bytes = Vec::new();
    archive.by_name(&format!("{name}.npy")).unwrap().read_to_end(&mut bytes).unwrap();
    let file = npyz::NpyFile::new(&bytes[..]).unwrap();
    match file.try_data::<f64>() {
        Ok(numbers) => numbers.map(Result::unwrap).collect(),
        Err(file) => file.data::<f32>().unwrap().map(|x| x.unwrap().into()).collect(),
    }
}

#[test]
fn a_constant_pressure_is_a_constant_image() {
    let folder = sheet();
    let run = dermatome(folder.path(), "render map/map.glb r.csv -o out.npy --level 0 --json")
        .assert()
        .success()
        .stderr("wrote out.npy\n");
    let report = json(&run.get_output().stdout);
    assert_eq!(report["frames"], 5);
    assert_eq!(
        (&report["matched"], &report["unknown"], &report["masked"]),
        (&120.into(), &0.into(), &0.into())
    );
    assert_eq!(report["channels"][0]["unit"], "Pa");
    let size = &report["size"]["sheet/L0"];
    let pixels = usize::try_from(size[0].as_u64().unwrap() * size[1].as_u64().unwrap()).unwrap();
    let values = numbers(&fs::read(folder.path().join("out.npy")).unwrap());
    assert_eq!(values.len(), 5 * pixels);
    for (t, frame) in values.chunks(pixels).enumerate() {
        let known: Vec<f32> = frame.iter().copied().filter(|x| !x.is_nan()).collect();
        assert!(known.len() > pixels / 2, "the sheet covers its image");
        assert!(known.iter().all(|x| (x - t as f32).abs() < 1e-5), "frame {t} is {t} everywhere");
    }
}

/// The raw frames of a pipe are those of the arrays, and a stream is answered like a file.
#[test]
fn a_pipe_has_the_frames_of_the_arrays() {
    let folder = sheet();
    let args = ["--level", "1", "--from", "1", "--every", "2"];
    dermatome(folder.path(), "render map/map.glb r.csv -o out.npy").args(args).assert().success();
    let array = fs::read(folder.path().join("out.npy")).unwrap();
    let recording = fs::read_to_string(folder.path().join("r.csv")).unwrap();
    for (drop, text) in [(None, recording.as_str()), (Some("--rate=5"), recording.trim_end())] {
        let piped = dermatome(folder.path(), "render map/map.glb - -o -")
            .args(args)
            .args(drop)
            .write_stdin(text)
            .timeout(Duration::from_secs(60))
            .assert()
            .success();
        let pipe = &piped.get_output().stdout;
        assert!(array.ends_with(pipe) && array.len() - pipe.len() < 1000, "frames 1 and 3, after the header");
    }
}

/// Every kind of output is written, and the files of a folder are numbered as the frames.
#[test]
fn folders_and_archives_hold_all_levels() {
    let folder = sheet();
    let render = |args: &[&str]| dermatome(folder.path(), "render map/map.glb r.csv").args(args).assert();
    render(&["-o", "all.npz"]).success();
    assert!(folder.path().join("all.features.json").is_file());
    render(&["-o", "exr", "--from", "2", "--to", "3"]).success();
    let mut names: Vec<_> = fs::read_dir(folder.path().join("exr"))
        .unwrap()
        .map(|f| f.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(names[..2], ["sheet.L0.000002.exr", "sheet.L0.000003.exr"]);
    assert_eq!(names.len() % 2, 0, "two frames of every level");
    render(&["-o", "whole", "--pictures", "png", "--level", "0"])
        .success()
        .stderr(contains("the colours go from"));
    let stream = "render map/map.glb - -o png --pictures png";
    dermatome(folder.path(), stream).write_stdin("").assert().code(2).stderr(contains("--range"));
    render(&["-o", "png", "--pictures", "png", "--range", "0,5", "--level", "0"]).success();
    assert_eq!(fs::read_dir(folder.path().join("png")).unwrap().count(), 5);
    render(&["-o", "contrast.npz", "--contrast"]).success();
    render(&["-o", "edges.npz", "--edges"]).success();
    let run = render(&["-o", "packed.npz", "--pack", "--size", "40", "60", "--json"]).success();
    let fill = json(&run.get_output().stdout)["fill"]["L0"].as_f64().unwrap();
    let said = format!("1 chart in one image: {:.0} % of the 60 x 40 pixels of L0 show skin", 100.0 * fill);
    render(&["-o", "body", "--pack", "body", "--pictures", "png", "--range", "0,5"]).success();
    render(&["-o", "b.npz", "--pack", "loose"]).code(2).stderr(contains("tight"));
    assert!(fill > 0.1 && String::from_utf8_lossy(&run.get_output().stderr).contains(&said), "{said}");
}

#[test]
fn readings_that_do_not_fit_are_named() {
    let folder = sheet();
    let refused = |text: String, what: &str, help: &str| {
        fs::write(folder.path().join("bad.csv"), text).unwrap();
        refuses(folder.path(), "render map/map.glb bad.csv -o x.npz", &[what, help]);
        assert!(!folder.path().join("x.npz").exists(), "nothing is left of a refused recording");
    };
    refused(table(500..=600, 2), "none of the 101 taxel ids", "500");
    refused(table([1, 2, 1].into_iter(), 2), "columns 0 and 2", "taxel id 1");
    refused(table(1..=3, 2) + "0.3,1,2\n", "line 4", "3 cells");
    refused(table(1..=3, 2) + "0.3,1,2,x\n", "line 4", "x");
    refused(table(1..=3, 0), "bad.csv", "");
    // Unknown and missing ids are counted, not refused.
    fs::write(folder.path().join("part.csv"), table(100..=125, 2)).unwrap();
    let run =
        dermatome(folder.path(), "render map/map.glb part.csv -o part.npz --json").assert().success().stderr(
            contains("5 columns are of no taxel of the map: 121, 122, 123, 124, 125")
                .and(contains("99 have none")),
        );
    let report = json(&run.get_output().stdout);
    assert_eq!(
        (&report["matched"], &report["unknown"], &report["masked"]),
        (&21.into(), &5.into(), &99.into())
    );
}

/// What is wrong with readings but can be worked with is counted, and the first ten are named.
#[test]
fn readings_with_gaps_are_counted() {
    let folder = sheet();
    let render = |name: &str, text: &[u8], args: &[&str]| {
        fs::write(folder.path().join(name), text).unwrap();
        dermatome(folder.path(), "render map/map.glb")
            .args([name, "-o", "out.npz", "--level", "0", "--json"])
            .args(args)
            .assert()
    };
    let report = |run: &assert_cmd::assert::Assert| json(&run.get_output().stdout);

    let run = render("unknown.csv", table(110..=140, 1).as_bytes(), &[]).success();
    let first_ten =
        "20 columns are of no taxel of the map: 121, 122, 123, 124, 125, 126, 127, 128, 129, 130, ...";
    assert!(String::from_utf8_lossy(&run.get_output().stderr).contains(first_ten));

    let run = render("gaps.csv", b"time,1,2,3\n0,nan,inf,1\n0.1,,-inf,2\n", &[]).success();
    assert_eq!((&report(&run)["missing"], &report(&run)["masked"]), (&4.into(), &117.into()));

    let run = render("back.csv", b"time,1\n0,1\n0.2,1\n0.1,1\n0.3,1\n", &[]).success();
    assert_eq!(report(&run)["backwards"], 1);
    run.stderr(contains("1 frame is earlier than the frame before"));

    let twice = b"time,1,2,1\n0,1,7,5\n";
    render("twice.csv", twice, &[]).code(2).stderr(contains("--duplicates first"));
    let words = "render map/map.glb twice.csv -o one.npy --level 0 --duplicates first";
    dermatome(&folder, words).assert().success();
    let drawn = numbers(&fs::read(folder.path().join("one.npy")).unwrap());
    assert!(drawn.contains(&1.0) && drawn.contains(&7.0));
    for empty in ["", "\n\n", "time,1,2\n"] {
        render("empty.csv", empty.as_bytes(), &[]).code(2).stderr(contains("empty.csv: line"));
    }
}

/// Tables as other programs write them: byte order marks, carriage returns, semicolons, tabs, quotes,
/// times in milliseconds.
#[test]
fn tables_of_other_programs_are_read() {
    let folder = sheet();
    for (name, text) in [
        ("marked.csv", "\u{feff}time,1.pressure[Pa],2.pressure[Pa]\r\n0.5,1,2\r\n1.5,3,4\r\n"),
        ("semicolons.csv", "time;1.pressure[Pa];2.pressure[Pa]\n0.5;1;2\n1.5;3;4\n"),
        ("tabs.csv", "time\t1.pressure[Pa]\t2.pressure[Pa]\n0.5\t1\t2\n1.5\t3\t4\n"),
        ("blanks.txt", "time 1.pressure[Pa] 2.pressure[Pa]\n0.5 1 2\n1.5 3 4\n"),
        ("quoted.csv", "\"time\",\"1.pressure[Pa]\",\"2.pressure[Pa]\"\n\"0.5\",\"1\",\"2\"\n1.5,3,4\n"),
        ("milliseconds.csv", "time[ms],1.pressure[Pa],2.pressure[Pa]\n500,1,2\n1500,3,4\n"),
    ] {
        fs::write(folder.path().join(name), text).unwrap();
        let words = format!("render map/map.glb {name} -o all.npz --level 0 --values-only");
        dermatome(&folder, &words).assert().success();
        let (values, times) = (array(&folder, "sheet.L0.values"), array(&folder, "timestamps"));
        assert!(values[120..122] == [3.0, 4.0] && values[122].is_nan(), "{name}: the second frame");
        assert_eq!(times, [0.5, 1.5], "{name}: the time is in seconds");
    }
    fs::write(folder.path().join("comma.csv"), "time;1;2\n0;1,5;2\n").unwrap();
    fs::write(folder.path().join("minutes.csv"), "time[min],1\n0,1\n").unwrap();
    for (name, said) in [("comma.csv", "1,5"), ("minutes.csv", "s, ms, us or ns")] {
        refuses(&folder, &format!("render map/map.glb {name} -o x.npz"), &[said]);
    }
}

/// Arrays without ids are in the order of the map; the errors about others say what to do.
#[test]
fn arrays_of_another_width_are_refused_with_both_numbers() {
    let folder = sheet();
    let render = |shape: &[usize], count: u16, args: &[&str]| {
        let values: Vec<u8> = (0..count).flat_map(|k| f32::from(k).to_le_bytes()).collect();
        fs::write(folder.path().join("a.npy"), npy("<f4", shape, &values)).unwrap();
        dermatome(folder.path(), "render map/map.glb a.npy -o a.npz").args(args).assert()
    };
    let both = contains("100 columns").and(contains("120 taxels")).and(contains("`ids`"));
    render(&[3, 100], 300, &[]).code(2).stderr(both);
    // As many frames as channels: only the layout tells the axes apart.
    render(&[2, 2, 120], 480, &[]).code(2).stderr(contains("2 columns").and(contains("--layout tcn")));
    render(&[2, 2, 120], 480, &["--layout", "tcn"]).success();
    render(&[2, 2, 120], 480, &["--layout", "tcn", "--channels", "force.N,heat", "--readings-unit", "N,K"])
        .success();
    let features = fs::read(folder.path().join("a.features.json")).unwrap();
    let features: serde_json::Value = serde_json::from_slice(&features).unwrap();
    let about = &features["observation.tactile.sheet.L0"]["info"];
    let known = serde_json::json!({"channels": ["force.N", "heat"], "units": ["N", "K"]});
    assert_eq!((&about["channels"], &about["units"]), (&known["channels"], &known["units"]));
    render(&[2, 2, 120], 480, &["--layout", "tcn", "--channels", "a,a"])
        .code(2)
        .stderr(contains("two channels are called \"a\""));
    render(&[2, 120], 240, &[]).success().stderr(contains("no times").and(contains("--rate")));
    render(&[2, 120], 240, &["--rate", "50"]).success().stderr("wrote a.npz, a.features.json\n");
}

/// Patches that the recording says nothing of are masked, with amounts too.
#[test]
fn patches_without_readings_are_masked() {
    let folder = tempfile::tempdir().unwrap();
    let meshes = Path::new(env!("CARGO_MANIFEST_DIR")).join("meshes/robot.glb");
    let run = |words: &str| dermatome(&folder, words).assert();
    run(&format!("build {} -o map --quiet", meshes.display())).success();
    // Ids of the shoulder alone.
    fs::write(folder.path().join("r.csv"), table(1001..=1050, 3).replace("pressure[Pa]", "force[N]"))
        .unwrap();
    for how in ["", "--pack", "--contrast", "--edges"] {
        let words = format!("render map/map.glb r.csv -o out.npz --pixel-mm 4 {how}");
        notes(&folder, &words, &["50 taxels have readings"]);
    }
    run("render map/map.glb r.csv -o png --pictures png --range 0,5 --pixel-mm 4 --every 2").success();
}

/// What cannot be written ends a sequence: the frames before it are whole, and the message counts them.
#[test]
fn a_sequence_that_breaks_off_says_how_far_it_came() {
    let folder = sheet();
    // A folder where the file of frame 2 belongs cannot be replaced, as on a disk that is full.
    fs::create_dir_all(folder.path().join("seq/sheet.L0.000002.exr")).unwrap();
    refuses(
        folder.path(),
        "render map/map.glb r.csv -o seq --level 0",
        &["2 frames are written; the next one could not be"],
    );
    let size = |k: u32| fs::metadata(folder.path().join(format!("seq/sheet.L0.{k:06}.exr"))).unwrap().len();
    assert!(size(0) > 1000 && size(1) > 1000, "two whole frames");
    let names = fs::read_dir(folder.path().join("seq")).unwrap();
    assert_eq!(names.count(), 3, "two frames and the folder, no temporary file");
    // A shorter run leaves nothing of a longer one behind.
    dermatome(folder.path(), "render map/map.glb r.csv -o all").assert().success();
    fs::write(folder.path().join("all/sheet.L0.txt"), "of another program").unwrap();
    let said = ["files are removed: frames of an earlier run"];
    notes(folder.path(), "render map/map.glb r.csv -o all --to 1", &said);
    let left = listing(&folder.path().join("all"));
    assert!(left.iter().all(|name| !name.contains(".000002")) && left.contains(&"sheet.L0.txt".to_owned()));
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_is_an_error_and_a_closed_pipe_is_not() {
    let folder = sheet();
    let render = || {
        let mut command = process::Command::new(assert_cmd::cargo::cargo_bin!("dermatome"));
        command.current_dir(folder.path()).args(["render", "map/map.glb", "r.csv", "-o", "-"]);
        command.stderr(Stdio::piped());
        command
    };
    if let Ok(full) = fs::OpenOptions::new().write(true).open("/dev/full") {
        let output = render().stdout(full).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && said.contains("standard output"), "{said}");
    }
    // More frames than a pipe holds, of which nobody reads more than the first bytes.
    fs::write(folder.path().join("r.csv"), table(1..=120, 300)).unwrap();
    let mut child = render().stdout(Stdio::piped()).spawn().unwrap();
    child.stdout.take().unwrap().read_exact(&mut [0; 100]).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn invalid_outputs_and_options_are_refused_before_work() {
    let folder = sheet();
    for (args, what) in [
        ("-o x.npy", "--level"),
        ("-o x.mp4", ".npz"),
        ("-o - --json", "standard output"),
        ("-o x.npz --level 9", "level 9"),
        ("-o x.npz --size 0 5", "canvas"),
        ("-o x.npz --size 4000 4000 --max-memory 50", "at most 50 MB"),
        ("-o x.npz --size 2000 2000 --max-disk 50", "on the disk; at most 50 MB"),
        ("-o x.npz --readings-unit Pa,K", "2 units"),
        ("-o x.npz --channels a,b", "2 names for 1 channels"),
        ("-o x.npz --clip 5,1", "lower"),
        ("-o x.npz --from 5 --to 2", "--to 2 is before --from 5"),
        ("-o x.npz --from 99", "the readings have 5 frames"),
        ("-o x.npz --contacts r.csv", "r.csv"),
    ] {
        refuses(&folder, &format!("render map/map.glb r.csv {args}"), &[what]);
    }
    assert!(!folder.path().join("x.npz").exists());
    // Large outputs are announced with what makes them smaller.
    let announced = ["5 frames are up to 105 MB, less where they can be compressed; --values-only"];
    notes(folder.path(), "render map/map.glb r.csv -o big.npz --level 0 --size 2300 2300", &announced);
    assert!(fs::read_to_string(folder.path().join("r.csv")).unwrap().starts_with("time,"), "an input");
    fs::write(folder.path().join("a.npy"), npy("<f4", &[1, 120], &1_f32.to_le_bytes().repeat(120))).unwrap();
    refuses(folder.path(), "render map/map.glb a.npy -o a.npy --level 0", &["a.npy"]);
}

/// What is done to the readings is what arrives in the images.
#[test]
fn readings_are_conditioned() {
    let folder = sheet();
    let last = |args: &[&str]| {
        dermatome(folder.path(), "render map/map.glb r.csv -o c.npy --level 0 --from 4 --quiet")
            .args(args)
            .assert()
            .success();
        let values = numbers(&fs::read(folder.path().join("c.npy")).unwrap());
        values.into_iter().find(|x| !x.is_nan()).unwrap()
    };
    assert_eq!(last(&[]), 4.0);
    assert_eq!(last(&["--zero", "first=3"]), 3.0, "the mean of 0, 1 and 2 is subtracted");
    assert_eq!(last(&["--zero", "1.5"]), 2.5);
    assert_eq!(last(&["--zero", "-1"]), 5.0);
    assert_eq!(
        last(&["--zero", "follow"]),
        4.0 - 2.0,
        "the mean of the first second, and of the five frames that there are"
    );
    refuses(folder.path(), "render map/map.glb r.csv -o d.npz --zero first=0", &["follow, stored, first=N"]);
    assert_eq!(last(&["--clip", "0,2.5"]), 2.5);
    let gains: String = (1..=120).fold("id,gain\n".into(), |text, id| text + &format!("{id},0.5\n"));
    fs::write(folder.path().join("g.csv"), gains).unwrap();
    assert_eq!(last(&["--gain", "g.csv"]), 2.0);
    notes(folder.path(), "render map/map.glb r.csv -o c.npz --zero first=99", &["frames, there are no 99"]);
}

/// Presses of a simulated sphere are found one by one.
#[test]
fn contacts_are_written_with_their_place_and_force() {
    let folder = sheet();
    dermatome(folder.path(), "touch map/map.glb -o touch.csv --truth truth.csv --presses 2 --rate-hz 20 --sphere-mm 20 --noise-kpa 0.1 --quiet")
        .assert()
        .success();
    let run = dermatome(folder.path(), "render map/map.glb touch.csv -o t.npz --contacts c.csv --json")
        .assert()
        .success();
    assert_eq!(json(&run.get_output().stdout)["contacts"], 2, "two presses");
    let text = fs::read_to_string(folder.path().join("c.csv")).unwrap();
    assert!(text.starts_with("frame,time,track,event,patch,link,taxels,area,force,x,y,z,nx,ny,nz,u,v,"));
    assert_eq!(text.matches(",onset,").count(), 2);
    assert_eq!(text.matches(",release,").count(), 2);
    refuses(
        folder.path(),
        "render map/map.glb touch.csv -o u.npz --contacts c.csv --channel heat",
        &["no channel \"heat\"", "force"],
    );
}

/// From a text of a vendor to images, through a draft of a layout that is completed; all that is known is stated.
#[test]
fn a_recording_with_its_sensors_becomes_images() {
    let folder = tempfile::tempdir().unwrap();
    let mut text = "DATA_TYPE MOVIE\nROWS 6\nCOLS 6\nROW_SPACING 5 mm\nCOL_SPACING 5 mm\nSECONDS_PER_FRAME 0.1\nUNITS raw\n\
                    MIRROR_ROW 1\nMIRROR_COL 0\nASCII_DATA @@\n"
        .to_owned();
    for frame in 0..2 {
        let row = format!("{}\n", ["7"; 6].join(","));
        text += &format!("Frame {frame}\nB,7,7,7,7,7\n{}", row.repeat(5));
    }
    fs::write(folder.path().join("walk.asf"), text + "@@\n").unwrap();
    notes(&folder, "layout walk.asf -o l.json", &["1 values are null"]);
    dermatome(&folder, "convert walk.asf skin.glb").assert().success();
    dermatome(&folder, "build skin.glb -o map --quiet").assert().success();
    let render = "render map/map.glb walk.asf -o a.npz --values-only --json";
    refuses(&folder, render, &["no statement about taxels, flip"]);
    refuses(&folder, &format!("{render} --layout l.json"), &["taxels, flip: found null"]);
    let draft = fs::read_to_string(folder.path().join("l.json")).unwrap();
    fs::write(folder.path().join("l.json"), draft.replace("null", "[]")).unwrap();
    let with_layout = format!("{render} --layout l.json");
    refuses(
        &folder,
        &format!("{with_layout} --rate 5"),
        &["--rate and the layout l.json state the same thing"],
    );
    refuses(&folder, &format!("{with_layout} --stream left"), &["no stream \"left\""]);
    refuses(&folder, "render map/map.glb - -o a.npz --layout l.json", &["standard input", "an empty file"]);
    refuses(&folder, &format!("{render} --layout l.txt"), &["a file that ends in .json"]);
    let said = json(&dermatome(&folder, &with_layout).output().unwrap().stdout);
    assert_eq!((&said["frames"], &said["matched"]), (&2.into(), &35.into()));
    let stated = said["statements"].as_array().unwrap();
    let source =
        |what: &str| stated.iter().find(|s| s["what"] == what).map(|s| s["source"].as_str().unwrap());
    assert_eq!((source("unit"), source("zero")), (Some("file"), Some("layout")), "{stated:?}");
    let plain = json(&dermatome(&folder, &format!("{with_layout} --zero first=1")).output().unwrap().stdout);
    let stated = plain["statements"].as_array().unwrap();
    assert!(stated.iter().any(|s| s["what"] == "zero" && s["source"] == "argument"), "{stated:?}");
}

/// Colours are of one channel each, from numbers of two digits around its values.
#[test]
fn pictures_of_each_channel_have_its_colours() {
    let folder = sheet();
    let ids: Vec<u32> = (1..=120).collect();
    let names: Vec<String> =
        ids.iter().flat_map(|id| [format!("{id}.pressure[Pa]"), format!("{id}.temp[degC]")]).collect();
    let mut text = format!("time,{}\n", names.join(","));
    for t in 0..2 {
        let row: Vec<String> = ids
            .iter()
            .flat_map(|id| [format!("{}", 45 * id), format!("{}", 30.0 + 0.01 * f64::from(*id))])
            .collect();
        writeln!(text, "{},{}", 0.1 * f64::from(t), row.join(",")).unwrap();
    }
    fs::write(folder.path().join("two.csv"), text).unwrap();
    dermatome(folder.path(), "render map/map.glb two.csv -o png --pictures png --level 0")
        .assert()
        .success()
        .stderr(contains("the colours of pressure go from 0.0000 to 5300.0000"))
        .stderr(contains("the colours of temp go from 30.0000 to 32.0000"));
}
