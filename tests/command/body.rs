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

/// The rows of a table as maps from its columns.
fn rows(path: &Path) -> Vec<std::collections::HashMap<String, String>> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
    let names = lines.next().unwrap();
    lines.map(|cells| names.iter().cloned().zip(cells).collect()).collect()
}

/// Sums, contacts and pictures of the fields of the whole body; what a map does not have is refused.
#[test]
fn levels_of_the_body_are_levels_of_summary_lookup_plot_and_info() {
    let folder = folder();
    let at = folder.path();
    let info = json(&dermatome(at, "info map/map.glb --json").output().unwrap().stdout);
    let levels = info["body_levels"].as_array().unwrap();
    assert_eq!((&levels[0]["level"], &levels.last().unwrap()["fields"]), (&"body.L0".into(), &1.into()));
    let fields = levels[0]["fields"].as_u64().unwrap();
    dermatome(at, "summary map/map.glb r.csv -o s.csv --threshold 1000 --by body.L0 -q").assert().success();
    let sums = rows(&at.join("s.csv"));
    let number =
        |row: &std::collections::HashMap<String, String>, column: &str| row[column].parse::<f64>().unwrap();
    let whole = sums.iter().find(|row| row["group"] == "whole").unwrap();
    let of_fields: Vec<_> = sums.iter().filter(|row| row["group"] == "field").collect();
    assert_eq!(of_fields.len() as u64, fields);
    for column in ["impulse", "area"] {
        let sum: f64 = of_fields.iter().map(|row| number(row, column)).sum();
        assert!((sum / number(whole, column) - 1.0).abs() < 1e-12, "{column}: {sum}");
    }
    dermatome(at, "summary map/map.glb r.csv -o plain.csv --threshold 1000 -q").assert().success();
    let without: Vec<_> = sums.iter().filter(|row| row["group"] != "field").cloned().collect();
    assert_eq!(rows(&at.join("plain.csv")), without, "the groups are the same");

    fs::write(at.join("p.csv"), "x,y,z\n0.0365,0.011,0.001\n0.09,0.01,0\n0,0,9\n").unwrap();
    dermatome(at, "lookup map/map.glb p.csv -o all.csv -q").assert().success();
    dermatome(at, "lookup map/map.glb p.csv -o found.csv --level 0 --level body.L0 -q").assert().success();
    let found = rows(&at.join("found.csv"));
    assert_eq!(found.iter().map(|row| &*row["level"]).collect::<Vec<_>>(), ["0", "body.L0"].repeat(3));
    assert!(rows(&at.join("all.csv")).iter().all(|row| row["level"].parse::<u32>().is_ok()));
    for row in found.iter().filter(|row| row["level"] == "body.L0" && row["patch"] != "off skin") {
        let parts = row["fields"].split(';').map(|part| part.split_once(':').unwrap());
        let parts: Vec<(u64, f64)> = parts.map(|(k, w)| (k.parse().unwrap(), w.parse().unwrap())).collect();
        assert!((parts.iter().map(|part| part.1).sum::<f64>() - 1.0).abs() < 1e-12, "{row:?}");
        let most = parts.iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        assert_eq!(row["field"], most.0.to_string());
        assert!(["u", "v", "px", "py"].iter().all(|column| row[*column].is_empty()), "{row:?}");
    }
    // The answer about some patches is that about all.
    dermatome(at, "lookup map/map.glb p.csv -o part.csv --level body.L0 --patch body -q").assert().success();
    let part = rows(&at.join("part.csv"));
    assert_eq!(part[1]["fields"], found[3]["fields"]);

    dermatome(at, "plot map/map.glb --readings r.csv --frame 30 --level 0 --level body.L0 -o o.svg -q")
        .assert()
        .success();
    let svg = fs::read_to_string(at.join("o.svg")).unwrap();
    assert!(svg.contains("body.L0") && svg.contains(" fields"), "captions");
    let missing = format!("body.L{}", levels.len());
    let last = format!("body.L0 to body.L{}", levels.len() - 1);
    for command in [
        format!("summary map/map.glb r.csv -o wrong.csv --by {missing}"),
        format!("lookup map/map.glb p.csv --level {missing}"),
        format!("plot map/map.glb --readings r.csv -o wrong.svg --level {missing}"),
    ] {
        refuses(at, &command, &[&missing, &last]);
    }
    refuses(at, "plot map/map.glb -o wrong.svg --level body.L0", &["--readings"]);
    refuses(at, "lookup map/map.glb p.csv --level body.L0 --nearest 2", &["--nearest"]);
    refuses(at, "summary map/map.glb r.csv -o wrong.csv --by body.L-1", &["body.L0"]);
    dermatome(at, "build arm.glb -o one --patch left -q").assert().success();
    refuses(at, "lookup one/map.glb p.csv --level body.L0", &["several patches"]);
}

/// Levels of modalities have names in info, lookup, plot and arrays; one that a map does not have is refused.
#[test]
fn levels_of_modalities_are_levels_of_lookup_plot_and_arrays() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let pads = |k: usize| if k % 12 % 4 == 1 && k / 12 % 4 == 1 { "thermal" } else { "" };
    let place = |k: usize| {
        format!("{},{},{},0,{}\n", k + 1, (k % 12) as f64 * 0.005, (k / 12) as f64 * 0.005, pads(k))
    };
    let table: String = (0..144).map(place).collect();
    fs::write(at.join("arm.csv"), format!("id,x,y,z,modality\n{table}")).unwrap();
    let ids: Vec<String> = (1..=144).map(|id| id.to_string()).collect();
    fs::write(at.join("r.csv"), format!("time,{}\n0,{}\n", ids.join(","), vec!["30"; 144].join(",")))
        .unwrap();
    dermatome(at, "build arm.csv -o map -q").assert().success();
    let info = json(&dermatome(at, "info map/map.glb --json").output().unwrap().stdout);
    let modality = &info["modalities"][0];
    assert_eq!((&modality["name"], &modality["sensors"]), (&"thermal".into(), &9.into()));
    assert_eq!((&modality["fields"][0], &info["patches"][0]["thermal"]), (&9.into(), &9.into()));
    fs::write(at.join("p.csv"), "x,y,z\n0.0251,0.0249,0\n").unwrap();
    dermatome(at, "lookup map/map.glb p.csv -o l.csv --level 0 --level arm.thermal.L0 -q").assert().success();
    let found = rows(&at.join("l.csv"));
    assert_eq!(found.iter().map(|row| &*row["level"]).collect::<Vec<_>>(), ["0", "arm.thermal.L0"]);
    // The taxel of row 5 and column 5, a pad.
    assert_eq!((&*found[1]["taxel_id"], &*found[1]["presence"], &*found[1]["u"]), ("66", "thermal", ""));
    let readings = "map/map.glb r.csv --readings-unit degC -q";
    dermatome(at, &format!("render {readings} -o o.npz --values-only")).assert().success();
    let bytes = fs::read(at.join("o.npz")).unwrap();
    let key = b"arm.thermal.L1.values.npy";
    assert!(bytes.windows(key.len()).any(|part| part == key));
    let plot = "plot map/map.glb --readings r.csv --readings-unit degC -q";
    dermatome(at, &format!("{plot} --level arm.thermal.L0 -o o.svg")).assert().success();
    assert!(fs::read_to_string(at.join("o.svg")).unwrap().contains("9 fields"));
    refuses(at, "lookup map/map.glb p.csv --level arm.thermal.L7", &["arm.thermal.L7", "arm.thermal.L0"]);
    // A contact on a patch without these sensors has its row, too.
    let two: String = table
        .lines()
        .flat_map(|row| {
            [format!("{row},arm\n"), format!("{},leg\n", row.replace(",0,", ",0.3,").replace("thermal", ""))]
        })
        .collect();
    fs::write(at.join("two.csv"), format!("id,x,y,z,modality,patch\n{two}")).unwrap();
    fs::write(at.join("p2.csv"), "x,y,z\n0.0251,0.0249,0\n0.0251,0.0249,0.3\n").unwrap();
    dermatome(at, "build two.csv -o two -q").assert().success();
    dermatome(at, "lookup two/map.glb p2.csv -o l2.csv --level arm.thermal.L0 -q").assert().success();
    let found = rows(&at.join("l2.csv"));
    assert_eq!(found.iter().map(|row| &*row["taxel_id"]).collect::<Vec<_>>(), ["66", ""]);
    refuses(at, "lookup map/map.glb p.csv --level arm.heat.L0", &["arm.heat.L0"]);
    refuses(at, "plot map/map.glb -o x.svg --level arm.thermal.L0", &["--readings"]);
}

/// Levels without a mesh have images, named as their arrays are: where a patch has fields of them, or all in one image.
#[test]
fn levels_without_a_mesh_have_images() {
    let folder = folder();
    let at = folder.path();
    let has = |file: &str, key: &str| {
        let bytes = fs::read(at.join(file)).unwrap();
        bytes.windows(key.len()).any(|part| part == key.as_bytes())
    };
    let render = "render map/map.glb r.csv -q --from 30 --to 30 --level body.L0";
    dermatome(at, &format!("{render} -o apart.npz")).assert().success();
    for key in ["left.body.L0.image.npy", "%62ody.body.L0.image.npy", "body.L0.values.npy"] {
        assert!(has("apart.npz", key), "{key}");
    }
    for key in ["body.L1.values.npy", "left.L0.values.npy", "left.L0.image.npy"] {
        assert!(!has("apart.npz", key), "{key}");
    }
    dermatome(at, &format!("{render} -o one.npz --pack")).assert().success();
    assert!(has("one.npz", "body.L0.image.npy"));
    for pictures in ["exr", "png"] {
        dermatome(at, &format!("{render} -o {pictures} --pictures {pictures}")).assert().success();
        let name = format!("left.body.L0.000030.{pictures}");
        assert!(at.join(pictures).join(&name).exists(), "{name}");
    }
    refuses(at, &format!("{render} -o x.npz --contrast"), &["no contrast"]);
    refuses(at, "render map/map.glb r.csv -o x.npz --level body.L9", &["body.L9"]);
}

/// Temperatures of two arms whose every fourth taxel of every fourth row is a thermal pad: sums and images are those of the
/// pads, on the levels of each arm and of the body; pressures have none.
#[test]
fn readings_of_heat_have_sums_and_images_of_pads() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let mut table = "id,x,y,z,patch,modality\n".to_owned();
    let mut ids = Vec::new();
    for (patch, first, right) in [("arm", 1, 0.0), ("fore", 501, 0.065)] {
        for k in 0..144_u32 {
            let (column, row) = (k % 12, k / 12);
            let senses = if column % 4 == 1 && row % 4 == 1 { "thermal" } else { "" };
            let [x, y] = [right + f64::from(column) * 0.005, f64::from(row) * 0.005];
            table += &format!("{},{x},{y},0,{patch},{senses}\n", first + k);
            ids.push(first + k);
        }
    }
    fs::write(at.join("arms.csv"), table).unwrap();
    let header: Vec<String> = ["temperature[degC]", "p[kPa]"]
        .iter()
        .flat_map(|of| ids.iter().map(move |id| format!("{id}.{of}")))
        .collect();
    let mut readings = format!("time,{}\n", header.join(","));
    for frame in 0..12 {
        let (heat, press) = (format!(",{}", 20 + frame), ",7".to_owned());
        readings += &format!("{}{}{}\n", 0.1 * f64::from(frame), heat.repeat(288), press.repeat(288));
    }
    fs::write(at.join("r.csv"), readings).unwrap();
    dermatome(at, "build arms.csv -o map -q").assert().success();
    let info = json(&dermatome(at, "info map/map.glb --json").output().unwrap().stdout);
    let whole = info["modalities"].as_array().unwrap().iter().find(|of| of["patch"].is_null()).unwrap();
    assert_eq!((&whole["name"], &whole["sensors"]), (&"thermal".into(), &18.into()));
    let text = String::from_utf8(dermatome(at, "info map/map.glb").output().unwrap().stdout).unwrap();
    assert!(text.contains("body.thermal: sensors 18, fields "), "{text}");

    let summary = "summary map/map.glb r.csv -q --channel temperature -o";
    for (level, most) in [("arm.thermal.L0", 9.0), ("body.thermal.L0", 18.0)] {
        dermatome(at, &format!("{summary} s.csv --by {level}")).assert().success();
        let sums = rows(&at.join("s.csv"));
        let whole = sums.iter().find(|row| row["group"] == "whole").unwrap();
        // Above the mean of the first frames.
        assert_eq!((&*whole["taxels"], &*whole["peak"]), ("18.0", "9.0"));
        let fields: Vec<_> = sums.iter().filter(|row| row["group"] == "field").collect();
        assert!(fields.len() as f64 <= most && fields.iter().all(|row| row["peak"] == "9.0"), "{level}");
        let area = |row: &std::collections::HashMap<String, String>| row["area"].parse::<f64>().unwrap();
        let sum: f64 = fields.iter().map(|row| area(row)).sum();
        let arm = sums.iter().find(|row| row["group"] == "patch" && row["name"] == "arm").unwrap();
        let all = if level.starts_with("arm") { arm } else { whole };
        assert!((sum / area(all) - 1.0).abs() < 1e-12, "{level}: {sum}");
    }
    refuses(
        at,
        "summary map/map.glb r.csv -o x.csv --channel p --by body.thermal.L0",
        &["body.thermal.L0", "readings of thermal"],
    );
    dermatome(at, "render map/map.glb r.csv -q -o o.npz --level arm.thermal.L0").assert().success();
    let bytes = fs::read(at.join("o.npz")).unwrap();
    let has = |key: &str| bytes.windows(key.len()).any(|part| part == key.as_bytes());
    assert!(has("arm.thermal.L0.image.npy") && has("arm.thermal.L0.values.npy") && !has("fore.thermal"));
    fs::write(at.join("p.csv"), "x,y,z\n0.026,0.026,0\n").unwrap();
    dermatome(at, "lookup map/map.glb p.csv -o l.csv --level body.thermal.L0 -q").assert().success();
    assert_eq!(rows(&at.join("l.csv"))[0]["level"], "body.thermal.L0");
}
