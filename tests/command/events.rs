//! `render --events` and `--probe` as a user runs them.

use std::{fs, path::Path};

use crate::common::{self, dermatome, json, refuses};
use dermatome::io::write_skin;
use dermatome::mesh::shapes;
use dermatome::skin::Skin;

/// A flat skin, its map, and a recording of two presses of a second.
fn recording() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let skin = Skin::from_mesh("palm", shapes::lattice(20, 20, 0.007));
    write_skin(&folder.path().join("palm.glb"), &skin).unwrap();
    dermatome(&folder, "build palm.glb -o palm --quiet").assert().success();
    let touch = "touch palm.glb -o t.csv --presses 2 --roll-mm 0 --rate-hz 50 --noise-kpa 1 --reads pressure --pause-s 0.5";
    dermatome(&folder, touch).assert().success();
    folder
}

fn lines(folder: &Path, name: &str) -> Vec<serde_json::Value> {
    let text = fs::read_to_string(folder.join(name)).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// A file and a stream give the same lines, with the keys of the page, and the number of contacts.
#[test]
fn events_of_a_file_and_of_a_stream_are_the_same() {
    let folder = recording();
    let at = folder.path();
    fs::write(at.join("b.csv"), "link,x,y,z,word\n,1,0,0,right\n").unwrap();
    let info = json(&dermatome(at, "info palm/map.glb --json").output().unwrap().stdout);
    let link = info["patches"][0]["link"].as_str().unwrap_or_default().to_owned();
    fs::write(at.join("b.csv"), format!("link,x,y,z,word\n{link},1,0,0,right\n")).unwrap();
    let words = "render palm/map.glb t.csv -o o.npz --values-only --events e.jsonl --body-words b.csv --json";
    let output = dermatome(at, words).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report = json(&output.stdout);
    assert_eq!((&report["at_once"], &report["events"]), (&1.into(), &2.into()), "{report}");
    let text = fs::read_to_string(at.join("e.jsonl")).unwrap();
    assert!(text.lines().all(|line| line.starts_with(r#"{"schema":"dermatome.event/1","#)), "{text}");
    let events = lines(at, "e.jsonl");
    let said: Vec<_> =
        events.iter().map(|event| [&event["event"], &event["phase"]].map(|x| x.as_str().unwrap())).collect();
    let press = [["touch", "begin"], ["press", "end"]];
    assert_eq!(said, [press, press].concat());
    let page = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/json.md")).unwrap();
    for event in &events {
        assert_eq!(event["schema"], "dermatome.event/1");
        for key in event.as_object().unwrap().keys().filter(|key| *key != "schema") {
            assert!(page.contains(&format!("`{key}")), "{key} is not on the page");
        }
    }
    assert!(events[1]["force_peak"].as_f64().unwrap() > 1.0 && !events[1]["taxels"][0].is_null());
    let stream = "render palm/map.glb - -o o2.npz --values-only --events -";
    let output = dermatome(at, stream).write_stdin(fs::read(at.join("t.csv")).unwrap()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(String::from_utf8(output.stdout).unwrap(), fs::read_to_string(at.join("e.jsonl")).unwrap());
    // Sums have the same number.
    let sums = dermatome(at, "summary palm/map.glb t.csv -o s.csv --json").output().unwrap();
    assert_eq!(json(&sums.stdout)["at_once"], 1);
    // Fingers side by side.
    let made = "touch palm.glb -o w.csv --shape finger --sphere-mm 7 --length-mm 20 --touches 2 --apart-mm 16 \
                --presses 1 --roll-mm 0 --reads pressure --pause-s 0.5 --seed 3";
    dermatome(at, made).assert().success();
    let count = |probe: &str| {
        let mut sums = dermatome(at, &format!("summary palm/map.glb w.csv -o s.csv --json --probe {probe}"));
        json(&sums.output().unwrap().stdout)["at_once"].as_u64()
    };
    assert_eq!([count("any"), count("finger")], [Some(1), Some(2)]);
}

#[test]
fn what_does_not_fit_is_refused() {
    let folder = recording();
    let at = folder.path();
    fs::write(at.join("b.csv"), "link,x,y,z,word\nnowhere,1,0,0,up\n").unwrap();
    fs::write(at.join("n.csv"), "1,2\n0,0\n0,0\n").unwrap();
    let events = "render palm/map.glb t.csv -o o.npz --values-only --events e.jsonl";
    refuses(at, &format!("{events} --body-words b.csv"), &["nowhere", "the name of a link of the map"]);
    refuses(at, "render palm/map.glb t.csv -o o.npz --events e.txt", &["ends in .jsonl"]);
    refuses(at, "render palm/map.glb t.csv -o o.npz --hit-n 5", &["--events"]);
    refuses(at, "render palm/map.glb t.csv -o o.npz --probe finger", &["--contacts"]);
    refuses(at, "render palm/map.glb t.csv -o o.npz --json --events -", &["standard output"]);
    assert_eq!(common::listing(at).iter().filter(|name| *name == "o.npz" || *name == "e.jsonl").count(), 0);
}

/// Fingers at a given distance are apart, and a palm is one contact.
#[test]
fn laid_fingers_are_counted_and_palms_are_one() {
    let folder = recording();
    let at = folder.path();
    let touch = "--presses 1 --roll-mm 0 --rate-hz 25 --noise-kpa 1 --reads pressure --pause-s 0.5";
    for (shape, count, seed) in [
        ("--shape finger --sphere-mm 7 --length-mm 20 --touches 2 --apart-mm 35", 2, 3),
        ("--shape palm --length-mm 60", 1, 4),
        ("--touches 1", 1, 5),
    ] {
        let made = format!("touch palm.glb -o f.csv {touch} {shape} --seed {seed}");
        dermatome(at, &made).assert().success();
        let words =
            "render palm/map.glb f.csv -o f.npz --values-only --contacts f_c.csv --probe finger --json";
        let output = dermatome(at, words).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        assert_eq!(json(&output.stdout)["at_once"], count, "{shape}");
    }
}
