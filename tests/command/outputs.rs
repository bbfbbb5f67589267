//! Where the command writes: never over an input, never twice to one place, and nothing is left of
//! a run that is stopped.

use std::{fs, path::Path};

use crate::common::{self, dermatome, listing, notes, refuses};
use dermatome::io::{IoError, Outputs, ReadParts, draft_from_bytes, write_map, write_skin};
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::pipeline::{BuildOptions, build, build_file};
use dermatome::skin::Skin;
use predicates::{prelude::PredicateBooleanExt, str::contains};
use rayon::prelude::*;
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

#[test]
fn a_lookup_writes_tables_and_replaces_no_input() {
    let folder = folder();
    fs::write(folder.path().join("p.csv"), "link,x,y,z,qx,qy,qz,qw\n").unwrap();
    let before: Vec<_> =
        ["map.glb", "c.csv", "p.csv"].map(|n| fs::read(folder.path().join(n)).unwrap()).into();
    for (output, said) in [
        ("map.glb", "would replace an input, map.glb"),
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
    dermatome(folder.path(), "lookup map.glb c.csv -o /dev/null").assert().success();
}

/// Nor files that an input names, or tables of options.
#[test]
fn meshes_of_a_robot_and_tables_of_joints_are_not_replaced() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let link = |name: &str, more: &str| format!("<link name='{name}'>{more}</link>");
    let visual = "<visual><geometry><mesh filename='cap.obj'/></geometry></visual>";
    let joint = "<joint name='j' type='revolute'><parent link='a'/><child link='cap'/><axis xyz='0 0 1'/>\
                 <limit lower='-1' upper='1'/></joint>";
    let robot = format!("<robot name='r'>{}{}{joint}</robot>", link("a", ""), link("cap", visual));
    fs::write(at("r.urdf"), robot).unwrap();
    fs::write(at("j.csv"), "j\n0.5\n").unwrap();
    for (words, input) in [
        ("convert r.urdf cap.obj", "cap.obj"),
        ("lookup map.glb c.csv --pose r.urdf --joints j.csv -o j.csv", "j.csv"),
    ] {
        let before = fs::read(at(input)).unwrap();
        refuses(folder.path(), words, &["would replace an input", input, "write to another file"]);
        assert!(fs::read(at(input)).unwrap() == before, "{input}");
    }
    let error = draft_from_bytes(&at("r.urdf"), fs::read(at("r.urdf")).unwrap(), ReadParts::default());
    let error = error.unwrap_err().to_string();
    assert!(error.contains("cap.obj") && error.contains("not in a file itself"), "{error}");
}

/// A reader that leaves, as `| head` does, ends neither the run nor its other outputs.
#[test]
fn a_closed_pipe_loses_no_other_output() {
    let folder = folder();
    let rows = (0..2000).map(|k| format!("0,0,-0.1,{k},1\n")).collect::<String>();
    fs::write(folder.path().join("c.csv"), format!("x,y,z,time,force\n{rows}")).unwrap();
    for (words, output) in [
        ("lookup map.glb c.csv --readings r.csv", "r.csv"),
        ("render map.glb r.csv -o - --contacts k.csv --threshold 0.1", "k.csv"),
        ("simulate -o - --truth t.csv", "t.csv"),
    ] {
        let mut command = std::process::Command::new(assert_cmd::cargo::cargo_bin!("dermatome"));
        command.current_dir(folder.path()).args(words.split_whitespace());
        let mut run = command.stdout(std::process::Stdio::piped()).spawn().unwrap();
        drop(run.stdout.take());
        assert!(run.wait().unwrap().success(), "{words}");
        assert!(folder.path().join(output).is_file(), "{words}");
    }
}

/// Each transaction is its own, also where threads of one pool work for several.
#[test]
fn builds_side_by_side_write_all_files() {
    let folder = folder();
    let outs: Vec<_> = (0..6).map(|k| folder.path().join(format!("out{k}"))).collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    let build = |out: &std::path::PathBuf| {
        let skin = folder.path().join("cap.obj");
        build_file(&skin, out, &BuildOptions::default()).map(|_| (out.join("map.glb").exists(), listing(out)))
    };
    let built: Vec<_> = pool.install(|| outs.par_iter().map(build).collect());
    for built in built {
        assert_eq!(built.unwrap(), (true, vec!["map.exr".to_owned(), "map.glb".to_owned()]));
    }
}

/// A transaction that is dropped leaves nothing, and one that is published neither replaces an input nor, with
/// it, anything else.
#[test]
fn outputs_appear_together_or_not_at_all() {
    let folder = folder();
    let skin = Skin::from_mesh("cap", shapes::cap(30, 0.1, 0.6));
    let at = |name: &str| folder.path().join(name);
    let before = listing(folder.path());
    for ending in [|_: &Outputs| (), |outputs: &Outputs| outputs.discard(|| ())] {
        let outputs = Outputs::default();
        write_skin(outputs.file(at("a.csv")), &skin).unwrap();
        write_skin(outputs.nested().file(at("b.ply")), &skin).unwrap();
        ending(&outputs);
        drop(outputs);
        assert_eq!(listing(folder.path()), before);
    }
    let outputs = Outputs::default();
    let old = fs::read(at("cap.obj")).unwrap();
    write_skin(outputs.file(at("a.ply")), &skin).unwrap();
    write_skin(outputs.file(at("cap.obj")), &skin).unwrap();
    outputs.add_input(&at("cap.obj"));
    assert!(outputs.has_files() && write_skin(outputs.file(at("cap.obj")), &skin).is_err());
    assert!(matches!(outputs.publish(), Err(IoError::ReplacesInput { .. })));
    // A name that the system does not take is noticed before the other file is in its place.
    let (long, outputs) = (format!("{}.obj", "n".repeat(300)), Outputs::default());
    write_skin(outputs.file(at("first.obj")), &skin).unwrap();
    assert!(write_skin(outputs.file(at(&long)), &skin).is_err());
    assert!(!at("first.obj").exists());
    drop(outputs);
    assert_eq!((fs::read(at("cap.obj")).unwrap(), listing(folder.path())), (old, before));
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
        let refused = refuses(folder.path(), words, &["two outputs"]);
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
    refuses(folder.path(), both, &["f.doc: unknown kind"]);
    assert_eq!(listing(folder.path()), ["c.csv", "cap.obj", "map.glb"]);
}

#[test]
fn no_command_replaces_what_it_reads() {
    let folder = folder();
    dermatome(folder.path(), "convert cap.obj t.csv").assert().success();
    dermatome(folder.path(), "build cap.obj -o M").assert().success();
    let before = listing(folder.path());
    for words in [
        "build M/map.glb -o M",
        "build M/map.glb -o ./M/",
        "flatten cap.obj -o cap.obj",
        "flatten cap.obj -o f.npz -o ../NAME/cap.obj",
        "coarsen map.glb -o map.glb",
        "convert cap.obj cap.obj",
        "convert t.csv t.triangles.csv",
        "convert t.csv t.CSV",
        "build cap.obj -o M --cut M/map.glb",
        "coarsen cap.obj -o table.glb --acuity table.glb",
        "flatten cap.obj -o f.obj --cut f.obj",
        "render map.glb c.csv -o o.npz --contacts gain.csv --gain gain.csv",
    ] {
        let name = folder.path().file_name().unwrap().to_str().unwrap();
        let run = dermatome(folder.path(), &words.replace("NAME", name)).assert();
        match words {
            // Another file where names differ by case, but with the same triangles.
            "convert t.csv t.CSV" => run.code(2),
            _ => run.code(2).stderr(contains("would replace an input")),
        };
        assert_eq!(listing(folder.path()), before, "{words}");
    }
}

/// The file of features has a name of its own, which `-o` does not show.
#[test]
fn features_of_a_recording_replace_no_input_either() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    dermatome(folder.path(), "touch cap.obj -o r.csv --presses 1").assert().success();
    fs::write(at("o.features.json"), "id,gain\n1,2\n").unwrap();
    let run = dermatome(folder.path(), "render map.glb r.csv -o o.npz --gain o.features.json").assert();
    run.code(2).stderr(contains("would replace an input, o.features.json"));
    assert_eq!(fs::read_to_string(at("o.features.json")).unwrap(), "id,gain\n1,2\n");
    assert!(!at("o.npz").exists());
}

/// Where the features cannot be written there is no array either, and a user hears so at once.
#[test]
fn features_that_cannot_be_written_leave_no_array() {
    let folder = folder();
    dermatome(folder.path(), "touch cap.obj -o r.csv --presses 1").assert().success();
    fs::create_dir(folder.path().join("o.features.json")).unwrap();
    let before = listing(folder.path());
    let run = dermatome(folder.path(), "render map.glb r.csv -o o.npz").assert();
    run.code(2).stderr(contains("o.features.json: is a directory"));
    assert_eq!(listing(folder.path()), before);
}

/// Every file that a recording becomes is named.
#[test]
fn render_names_all_files_that_it_wrote() {
    let folder = folder();
    dermatome(folder.path(), "touch cap.obj -o r.csv --presses 1").assert().success();
    let run = "render map.glb r.csv -o o.npz --contacts t.csv";
    notes(folder.path(), run, &["wrote o.npz, o.features.json, t.csv"]);
}

/// A stream does not come again: what came before a line that cannot be read is written.
#[test]
fn a_stream_that_ends_badly_keeps_what_came_before() {
    let folder = folder();
    dermatome(folder.path(), "touch cap.obj -o r.csv --presses 1").assert().success();
    let mut text = fs::read_to_string(folder.path().join("r.csv")).unwrap();
    text.push_str("this is no reading\n");
    let run = "render map.glb - -o o.npz --contacts t.csv";
    let ended = dermatome(folder.path(), run).write_stdin(text.clone()).assert().code(2);
    ended.stderr(contains("wrote o.npz, o.features.json, t.csv").and(contains("this is no reading")));
    let run = "summary map.glb - -o sums.csv";
    let ended = dermatome(folder.path(), run).write_stdin(text).assert().code(2);
    ended.stderr(contains("added up; the stream ended badly").and(contains("this is no reading")));
    for name in ["o.npz", "t.csv", "sums.csv"] {
        assert!(fs::metadata(folder.path().join(name)).unwrap().len() > 0, "{name}");
    }
}

#[test]
fn a_file_in_place_of_a_folder_is_named() {
    let folder = folder();
    for words in ["build cap.obj -o c.csv", "render map.glb c.csv -o table"] {
        fs::write(folder.path().join("table"), "").unwrap();
        refuses(folder.path(), words, &["not a directory"]);
    }
}

/// A name of a file may hold what a terminal obeys: a control of C1 and a mark of direction.
#[test]
fn json_holds_nothing_that_a_terminal_obeys() {
    let folder = folder();
    let skin = Skin::from_mesh("a\u{9b}31m\u{202e}b", shapes::cap(30, 0.1, 0.6));
    write_skin(&folder.path().join("named.glb"), &skin).unwrap();
    let run = dermatome(folder.path(), "info named.glb --json").assert().success();
    let text = String::from_utf8(run.get_output().stdout.clone()).unwrap();
    assert!(text.contains("a\\u009b31m\\u202eb"), "{text}");
    assert_eq!(common::json(text.as_bytes())["patches"][0]["name"], "a\u{9b}31m\u{202e}b");
}

/// A map that lookups refuse is not without findings because it is a sound skin.
#[test]
fn check_refuses_a_map_that_is_none() {
    let folder = folder();
    dermatome(folder.path(), "check map.glb").assert().success();
    let mut bytes = fs::read(folder.path().join("map.glb")).unwrap();
    let (level, other) = (b"\"level\":0", b"\"level\":7");
    let at = bytes.windows(level.len()).position(|found| found == level).unwrap();
    bytes[at..at + level.len()].copy_from_slice(other);
    fs::write(folder.path().join("broken.glb"), bytes).unwrap();
    for words in ["lookup broken.glb c.csv", "check broken.glb"] {
        dermatome(folder.path(), words).assert().code(2).stderr(contains("level"));
    }
}

/// A sleeve that is not cut becomes a flat ring: one line says so, and what helps.
#[test]
fn a_poor_map_is_one_note_with_what_mends_it() {
    let folder = folder();
    let skin = Skin::from_mesh("sleeve", shapes::tube(12, 60, 0.03, 0.4));
    write_skin(&folder.path().join("sleeve.obj"), &skin).unwrap();
    for words in ["build sleeve.obj -o S --cut none", "flatten sleeve.obj -o s.obj --cut none"] {
        let run = dermatome(folder.path(), words).assert().success();
        let said = String::from_utf8(run.get_output().stderr.clone()).unwrap();
        assert_eq!(said.matches("poor").count(), 1, "{words}: {said}");
        assert!(said.contains("1 map is poor, `") && said.contains("--cut auto"), "{words}: {said}");
    }
    dermatome(folder.path(), "build cap.obj -o M").assert().success().stderr(contains("poor").not());
}

/// A user reads what is wrong and how the command is used, and the option's own error where a number is negative.
#[test]
fn bad_usage_is_an_error() {
    let folder = folder();
    for (words, said) in [
        ("info cap.obj --jsn", "--json"),
        ("flatten cap.obj", "--output"),
        ("flatten cap.obj -o f.obj --angle -1", "a number of at least 0"),
        ("build cap.obj -o M --gap -2", "a number from 1 to 20"),
        ("build cap.obj -o M --levels -2", "invalid digit"),
        ("nothing", "Usage:"),
    ] {
        refuses(folder.path(), words, &["error: ", said, "--help"]);
    }
    let refused = dermatome(folder.path(), "info cap.obj").env("RAYON_NUM_THREADS", "100000").assert();
    refused.code(2).stderr(contains("RAYON_NUM_THREADS is \"100000\"; needed: a number from 0 to 512"));
}

#[cfg(target_os = "linux")]
mod system {
    use std::fs::File;
    use std::os::unix::fs::{PermissionsExt, symlink};
    use std::process::Stdio;

    use super::*;

    fn full() -> Stdio {
        File::options().write(true).open("/dev/full").unwrap().into()
    }

    fn process(folder: &Path, words: &str) -> std::process::Command {
        let mut command = std::process::Command::new(assert_cmd::cargo::cargo_bin!("dermatome"));
        command.current_dir(folder).args(words.split_whitespace());
        command
    }

    #[test]
    fn notes_that_cannot_be_written_stop_no_run() {
        let folder = folder();
        // Bare taxels: the run prints a note.
        fs::write(folder.path().join("t.csv"), "x,y,z\n0,0,0\n1,0,0\n0,1,0\n1,1,0\n").unwrap();
        let status = process(folder.path(), "build t.csv -o M").stderr(full()).stdout(Stdio::null()).status();
        assert!(status.unwrap().success());
        assert!(folder.path().join("M/map.glb").is_file());
        let status = process(folder.path(), "info nothing.obj").stderr(full()).status();
        assert_eq!(status.unwrap().code(), Some(2), "an error that nobody reads is still one");
        let help = process(folder.path(), "help").stdout(full()).stderr(Stdio::piped()).output().unwrap();
        assert_eq!(help.status.code(), Some(2));
        assert!(String::from_utf8(help.stderr).unwrap().contains("standard output"));
    }

    /// `check FILE | true`
    #[test]
    fn a_closed_output_changes_no_exit_code() {
        let folder = folder();
        fs::write(folder.path().join("t.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 3\n").unwrap();
        assert_eq!(process(folder.path(), "check t.obj").output().unwrap().status.code(), Some(1));
        let mut child = process(folder.path(), "check t.obj").stdout(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        assert_eq!(child.wait().unwrap().code(), Some(1));
    }

    #[test]
    fn outputs_respect_the_umask_and_links() {
        let folder = folder();
        symlink("real.ply", folder.path().join("link.ply")).unwrap();
        let run = "umask 077; \"$0\" convert cap.obj a.ply && \"$0\" convert cap.obj link.ply";
        let status = std::process::Command::new("sh")
            .args(["-c", run])
            .arg(assert_cmd::cargo::cargo_bin!("dermatome"))
            .current_dir(folder.path())
            .status();
        assert!(status.unwrap().success());
        let mode = fs::metadata(folder.path().join("a.ply")).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        let target = fs::symlink_metadata(folder.path().join("real.ply")).unwrap();
        assert!(
            target.is_file() && fs::symlink_metadata(folder.path().join("link.ply")).unwrap().is_symlink()
        );
        fs::create_dir(folder.path().join("M")).unwrap();
        symlink("../kept.glb", folder.path().join("M/map.glb")).unwrap();
        dermatome(folder.path(), "build cap.obj -o M").assert().success();
        assert!(folder.path().join("kept.glb").is_file(), "`build` follows a link to a file to come");
    }

    /// `ulimit -f` counts blocks of 512 or 1024 bytes.
    #[test]
    fn a_file_beyond_the_limit_of_sizes_is_an_error_and_leaves_nothing() {
        let folder = folder();
        let before = listing(folder.path());
        for words in ["convert cap.obj a.ply", "build cap.obj -o .", "lookup map.glb c.csv -o l.csv"] {
            let output = std::process::Command::new("sh")
                .args(["-c", "ulimit -f 0; exec \"$0\" \"$@\""])
                .arg(assert_cmd::cargo::cargo_bin!("dermatome"))
                .args(words.split(' '))
                .current_dir(folder.path())
                .output()
                .unwrap();
            let text = String::from_utf8(output.stderr).unwrap();
            assert_eq!(output.status.code(), Some(2), "{words}: {text}");
            assert!(
                text.contains("cannot write") && text.to_lowercase().contains("large"),
                "{words}: {text}"
            );
            assert_eq!(listing(folder.path()), before, "{words}");
        }
    }
}

#[cfg(target_os = "linux")]
mod stopped {
    use std::io::Write;
    use std::process::{Child, Stdio};
    use std::thread;
    use std::time::{Duration, Instant};

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

    /// A live stream that is stopped ends there: its arrays and its contacts are written.
    #[test]
    fn a_stopped_stream_keeps_what_came_before() {
        let folder = folder();
        dermatome(folder.path(), "touch cap.obj -o r.csv --presses 1").assert().success();
        let text = fs::read_to_string(folder.path().join("r.csv")).unwrap();
        let (header, rows) = text.split_once('\n').unwrap();
        for signal in [1, 2, 15].into_iter().filter(|signal| !is_ignored(*signal)) {
            let before = listing(folder.path()).len();
            let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin!("dermatome"))
                .args(["render", "map.glb", "-", "-o", "o.npz", "--contacts", "t.csv", "--values-only"])
                .current_dir(folder.path())
                .stdin(Stdio::piped())
                .stderr(Stdio::piped())
                .spawn()
                .unwrap();
            let mut input = child.stdin.take().unwrap();
            input.write_all(format!("{header}\n").as_bytes()).unwrap();
            // More than can be on its way when the last of it is taken: most of it is drawn by then.
            repeat(&mut input, rows, 2_000_000);
            interrupt(&mut child, signal, folder.path(), before);
            let output = child.wait_with_output().unwrap();
            let said = String::from_utf8(output.stderr).unwrap();
            assert_eq!(output.status.code(), Some(128 + signal), "{said}");
            assert!(said.contains("wrote o.npz, o.features.json, t.csv"), "{said}");
            let expected = ["c.csv", "cap.obj", "map.glb", "o.features.json", "o.npz", "r.csv", "t.csv"];
            assert_eq!(listing(folder.path()), expected);
            let mut written =
                zip::ZipArchive::new(fs::File::open(folder.path().join("o.npz")).unwrap()).unwrap();
            let times = written.by_name("timestamps.npy").unwrap().size();
            assert!(times > 200 * 8, "{times} bytes of times");
            for name in ["o.npz", "o.features.json", "t.csv"] {
                fs::remove_file(folder.path().join(name)).unwrap();
            }
            let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin!("dermatome"))
                .args(["summary", "map.glb", "-", "-o", "sums.csv", "--over-time", "loads.csv"])
                .current_dir(folder.path())
                .stdin(Stdio::piped())
                .stderr(Stdio::piped())
                .spawn()
                .unwrap();
            let mut input = child.stdin.take().unwrap();
            input.write_all(format!("{header}\n").as_bytes()).unwrap();
            repeat(&mut input, rows, 2_000_000);
            interrupt(&mut child, signal, folder.path(), before);
            let output = child.wait_with_output().unwrap();
            let said = String::from_utf8(output.stderr).unwrap();
            assert_eq!(output.status.code(), Some(128 + signal), "{said}");
            assert!(said.contains("added up; the stream was stopped"), "{said}");
            for name in ["sums.csv", "loads.csv"] {
                assert!(fs::metadata(folder.path().join(name)).unwrap().len() > 0, "{name}");
                fs::remove_file(folder.path().join(name)).unwrap();
            }
        }
    }

    /// Writes these rows again and again, `bytes` in all.
    fn repeat(input: &mut impl Write, rows: &str, bytes: usize) {
        for _ in 0..bytes.div_ceil(rows.len()) {
            input.write_all(rows.as_bytes()).unwrap();
        }
    }
}
