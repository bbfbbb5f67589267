//! What the commands print as JSON, against `docs/json.md`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use crate::common::dermatome;
use dermatome::{io::write_skin, mesh::shapes, skin::Skin};
use serde_json::Value;

fn run(folder: &Path, words: &str) -> Vec<u8> {
    dermatome(folder, words).output().unwrap().stdout
}

/// The keys of each schema as the page lists them, and whether they are always there.
fn documented() -> BTreeMap<String, BTreeMap<String, bool>> {
    let page = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/json.md")).unwrap();
    let mut schemas = BTreeMap::new();
    for section in page.split("\n## ").skip(1) {
        let (name, text) = section.split_once('\n').unwrap();
        let mut keys = BTreeMap::new();
        for row in text.lines().filter(|line| line.starts_with("| `")) {
            let cells: Vec<&str> = row.trim_matches('|').split(" | ").map(str::trim).collect();
            let when = row.trim_end_matches(" |").rsplit('|').next().unwrap().trim();
            for key in cells[0].split('`').skip(1).step_by(2) {
                keys.insert(key.to_owned(), when == "always");
            }
        }
        schemas.insert(name.to_owned(), keys);
    }
    schemas
}

/// The paths of all values that are neither objects nor lists of objects.
fn paths(value: &Value, at: &str, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(object) => {
            for (key, inner) in object {
                // The names of images, of columns of sums and of coordinates are keys too.
                let key = if ["size", "fill", "groups[]", "steps[]", "from", "to"].contains(&at) {
                    "*"
                } else {
                    key
                };
                paths(inner, &if at.is_empty() { key.to_owned() } else { format!("{at}.{key}") }, found);
            }
        }
        Value::Array(list) if list.first().is_some_and(Value::is_object) => {
            list.iter().for_each(|inner| paths(inner, &format!("{at}[]"), found));
        }
        _ => {
            found.insert(at.to_owned());
        }
    }
}

/// Every object says its schema, holds the keys that are documented as always there, and no others
/// than are documented.
#[test]
fn every_object_keeps_to_its_schema() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    write_skin(&at.join("cap.glb"), &Skin::from_mesh("cap", shapes::cap(300, 0.1, 1.2))).unwrap();
    write_skin(&at.join("larger.glb"), &Skin::from_mesh("cap", shapes::cap(300, 0.11, 1.2))).unwrap();
    write_skin(&at.join("ring.obj"), &Skin::from_mesh("ring", shapes::torus(12, 8, 0.05, 0.02))).unwrap();
    fs::write(
        at.join("two.obj"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 -1 0\nv 0 0 1\nf 1 2 3\nf 1 4 2\nf 1 2 5\n",
    )
    .unwrap();
    run(at, "simulate -o o.g2o --truth t.csv --taxels 30 --anchors 10");
    run(at, "simulate --arm --taxels 30 -o log.csv");
    let mut printed = BTreeMap::new();
    let mut keep = |name: &str, bytes: &[u8]| {
        let text = std::str::from_utf8(bytes).unwrap();
        assert!(text.starts_with("{\n  \"schema\": \"dermatome."), "{name} begins with its schema: {text}");
        let value: Value = serde_json::from_slice(bytes).unwrap();
        let schema = value["schema"].as_str().unwrap().to_owned();
        assert!(schema.starts_with(&format!("dermatome.{name}/")), "{schema}");
        printed.insert(schema, value);
    };
    keep("build", &run(at, "build cap.glb -o map --json"));
    keep("bench", &run(at, "bench map/map.glb --json"));
    keep("timings", &fs::read(at.join("map/timings.json")).unwrap());
    run(at, "touch map/map.glb -o r.csv --presses 1 --rate-hz 20");
    keep("calibrate", &run(at, "calibrate o.g2o -o s.csv --truth t.csv --json"));
    let rows = "0,0,0,0,0,0,0,0,1\n1,0.01,0,0,1,0,0,0,1\n2,0,0.01,0,2,0,0,0,1\n3,0.01,0.01,0,3,0,0,0,1\n";
    fs::write(at.join("p.csv"), format!("i,x,y,z,contact,qx,qy,qz,qw\n{rows}")).unwrap();
    let drawn = "0,0,0,0,a\n1,0.01,0,0,a\n2,0,0.01,0,a\n3,0.01,0.01,0,a\n";
    fs::write(at.join("d.csv"), format!("taxel_id,x,y,z,module\n{drawn}")).unwrap();
    keep("bodies", &run(at, "calibrate p.csv --cad d.csv --fit-probe --folds 2 -o b.csv --json"));
    keep("touches", &run(at, "touches log.csv -o contacts.csv --json"));
    keep("carry", &run(at, "carry map/map.glb r.csv --to map/map.glb -o carried.csv --json"));
    keep("check", &run(at, "check two.obj --json"));
    keep("coarsen", &run(at, "coarsen ring.obj -o c.glb --json"));
    keep("design", &run(at, "design cap.glb -o d --module triangle:15mm --bend-radius 20mm --json"));
    keep("diff", &run(at, "diff cap.glb larger.glb --json"));
    keep("flatten", &run(at, "flatten ring.obj -o f.obj --json"));
    keep("info", &run(at, "info cap.glb --json"));
    keep("render", &run(at, "render map/map.glb r.csv -o frames --contacts c.csv --json"));
    keep("summary", &run(at, "summary map/map.glb r.csv -o sums.csv --by step --json"));

    run(
        at,
        "touch map/map.glb -o large.csv --presses 1 --rate-hz 20 --sphere-mm 60 --depth-mm 6 --roll-mm 0",
    );
    run(at, "render map/map.glb large.csv -o e.npz --values-only --events e.jsonl");
    let events = fs::read_to_string(at.join("e.jsonl")).unwrap();
    printed.insert(
        "dermatome.event/1".to_owned(),
        serde_json::from_str(events.lines().last().unwrap()).unwrap(),
    );
    let followed = run(at, "calibrate p.csv --follow -o b.csv");
    let line = std::str::from_utf8(&followed).unwrap().lines().next().unwrap();
    printed.insert("dermatome.touch/1".to_owned(), serde_json::from_str(line).unwrap());

    let documented = documented();
    assert_eq!(printed.keys().collect::<Vec<_>>(), documented.keys().collect::<Vec<_>>());
    for (schema, value) in printed {
        let keys = &documented[&schema];
        let mut found = BTreeSet::new();
        paths(&value, "", &mut found);
        found.remove("schema");
        for (key, _) in keys.iter().filter(|(_, always)| **always) {
            assert!(found.contains(key), "{schema} has no {key}");
        }
        for key in found {
            let is_empty =
                value.pointer(&format!("/{key}")).is_some_and(|list| list == &Value::Array(vec![]));
            assert!(keys.contains_key(&key) || is_empty, "{key} of {schema} is not in docs/json.md");
        }
    }
}

/// What differs from run to run is in `timings.json` alone.
#[test]
fn the_same_input_gives_the_same_report() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    write_skin(&at.join("cap.glb"), &Skin::from_mesh("cap", shapes::cap(300, 0.1, 1.2))).unwrap();
    run(at, "build cap.glb -o a --threads 1");
    run(at, "build cap.glb -o b --threads 2");
    for name in ["map.glb", "map.exr", "report.json"] {
        assert!(
            fs::read(at.join("a").join(name)).unwrap() == fs::read(at.join("b").join(name)).unwrap(),
            "{name}"
        );
    }
}
