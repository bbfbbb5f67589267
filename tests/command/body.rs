//! Gaps and the whole body, as a user of the command meets them.

use std::fs;
use std::path::Path;

use crate::common::{dermatome, json, refuses};
use dermatome::io::{read_map, write_skin};
use dermatome::mesh::shapes;
use dermatome::skin::{LinkId, Patch, Skin};
use serde_json::Value;

/// Two sheets of 8 x 6 taxels, 5 mm apart, with a gap of 10 mm, and a recording of a press on the gap: both rims at once.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut skin = Skin::from_mesh("left", shapes::lattice(8, 6, 0.005));
    let mut right = Patch::from_mesh("body", LinkId::new(0), shapes::lattice(8, 6, 0.005));
    right.mesh.positions.iter_mut().for_each(|x| x.x += 0.045);
    right.taxels.ids.iter_mut().for_each(|id| id.0 += 100);
    skin.patches.push(right);
    write_skin(&folder.path().join("arm.glb"), &skin).unwrap();
    dermatome(&folder, "build arm.glb -o map -q").assert().success();
    let map = read_map(&folder.path().join("map/map.glb")).unwrap();
    let ids: Vec<u32> = map.patches.iter().flat_map(|patch| patch.taxels.ids.iter().map(|id| id.0)).collect();
    let x = |k: usize| {
        let patch = map
            .patches
            .iter()
            .flat_map(|patch| patch.levels.iter().next().unwrap().level.mesh.positions.iter());
        patch.clone().nth(k).unwrap().x
    };
    let mut text =
        format!("time,{}\n", ids.iter().map(|id| format!("{id}.p[Pa]")).collect::<Vec<_>>().join(","));
    for frame in 0..60 {
        let height = if (20..50).contains(&frame) { 1e5 } else { 0.0 };
        let reading = |k| format!(",{}", height * (1.0 - (x(k) - 0.0395_f64).abs() / 0.012).max(0.0));
        text += &format!("{}{}\n", 0.02 * f64::from(frame), (0..ids.len()).map(reading).collect::<String>());
    }
    fs::write(folder.path().join("r.csv"), text).unwrap();
    folder
}

fn lines(folder: &Path, file: &str) -> Vec<Value> {
    fs::read_to_string(folder.join(file))
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

#[test]
fn gaps_are_listed_and_contacts_have_all_patches() {
    let folder = folder();
    let at = folder.path();
    for file in ["arm.glb", "map/map.glb"] {
        for command in ["info", "check"] {
            let found = json(&dermatome(at, &format!("{command} {file} --json")).output().unwrap().stdout);
            let gap = &found["gaps"][0];
            assert_eq!(gap["patches"], serde_json::json!(["left", "body"]), "{command} {file}: {found}");
            assert!(
                (gap["width_mm"][0].as_f64().unwrap() - 8.660254).abs() < 1e-4
                    && gap["links"].as_u64().unwrap() >= 6,
                "{command} {file}: {gap}"
            );
        }
    }
    let text = String::from_utf8(dermatome(at, "check arm.glb").output().unwrap().stdout).unwrap();
    assert!(text.contains("gap left - body: ") && text.contains(" links, 8.7 to 10.0"), "{text}");
    let rendered = "render map/map.glb r.csv -o o.npz --values-only --contacts c.csv --events e.jsonl --threshold 1000 -q";
    dermatome(at, rendered).assert().success();
    let contacts = fs::read_to_string(at.join("c.csv")).unwrap();
    assert!(contacts.lines().next().unwrap().ends_with(",region,patches"), "{contacts}");
    assert!(contacts.lines().skip(1).all(|row| row.ends_with(",left;body")), "{contacts}");
    let events = lines(at, "e.jsonl");
    let [event] = &events.iter().filter(|event| event["phase"] == "end").collect::<Vec<_>>()[..] else {
        panic!("{events:?}")
    };
    assert_eq!(event["patches"], serde_json::json!(["left", "body"]));
    let (own, other) = match event["patch"].as_str() {
        Some("left") => ("taxels", &event["beyond"]["body"]),
        _ => ("taxels", &event["beyond"]["left"]),
    };
    assert!(!event[own].as_array().unwrap().is_empty() && !other.as_array().unwrap().is_empty(), "{event}");
    let bytes = fs::read(at.join("o.npz")).unwrap();
    for name in ["body.L0.values.npy", "body.L0.valid.npy", "%62ody.L0.values.npy", "left.L0.values.npy"] {
        assert!(bytes.windows(name.len()).any(|part| part == name.as_bytes()), "{name}");
    }
}

/// With `--across 0` patches stay apart, and a part of a map has no gaps.
#[test]
fn gaps_can_be_left_open() {
    let folder = folder();
    let at = folder.path();
    dermatome(at, "build arm.glb -o apart -q --across 0").assert().success();
    assert!(json(&dermatome(at, "info apart/map.glb --json").output().unwrap().stdout)["gaps"].is_null());
    dermatome(at, "render apart/map.glb r.csv -o o.npz --values-only --contacts c.csv --threshold 1000 -q")
        .assert()
        .success();
    let contacts = fs::read_to_string(at.join("c.csv")).unwrap();
    assert!(contacts.lines().next().unwrap().ends_with(",region"), "{contacts}");
    assert_eq!(contacts.lines().filter(|row| row.contains(",onset,")).count(), 2, "{contacts}");
    dermatome(at, "convert arm.glb points.csv -q").assert().success();
    dermatome(at, "lookup map/map.glb points.csv -o found.csv --patch left -q").assert().success();
    refuses(at, "build arm.glb -o wrong --across -1mm", &["0.02, 20mm or 0"]);
    refuses(at, "build arm.glb -o wrong --across wide", &["0.02, 20mm or 0"]);
}
