//! Named regions, sums of a trial and layouts of streams, as a user of the command meets them.

use std::fs;
use std::path::Path;

use crate::common::{dermatome, json, notes, refuses};
use dermatome::io::{read_map, write_skin};
use dermatome::mesh::shapes;
use dermatome::skin::Skin;

/// A map of a cap of 300 taxels, and a recording of one press on it.
fn folder_with_a_map() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let skin = Skin::from_mesh("cap", shapes::cap(300, 0.05, 1.0));
    write_skin(&folder.path().join("cap.glb"), &skin).unwrap();
    let ids: Vec<String> = (1..=40).map(|id| format!("{id},tip\n")).collect();
    fs::write(folder.path().join("tip.csv"), format!("taxel_id,region\n{}", ids.concat())).unwrap();
    dermatome(&folder, "build cap.glb -o map -q --regions tip.csv").assert().success();
    dermatome(&folder, "touch cap.glb -o touch.npz --presses 1 --rate-hz 20 -q").assert().success();
    folder
}

/// The cells of a column of a table.
fn column(folder: &Path, file: &str, name: &str) -> Vec<String> {
    let text = fs::read_to_string(folder.join(file)).unwrap();
    let at = text.lines().next().unwrap().split(',').position(|found| found == name).unwrap();
    text.lines().skip(1).map(|row| row.split(',').nth(at).unwrap().to_owned()).collect()
}

#[test]
fn regions_are_in_the_map_and_in_all_that_is_made_of_it() {
    let folder = folder_with_a_map();
    let path = folder.path();
    let map = read_map(&path.join("map/map.glb")).unwrap();
    assert_eq!(map.regions().names.iter().map(|name| &**name).collect::<Vec<_>>(), ["tip"]);
    dermatome(path, "convert cap.glb contacts.csv -q").assert().success();
    dermatome(path, "lookup map/map.glb contacts.csv -o found.csv --level 0 -q").assert().success();
    let (ids, regions) = (column(path, "found.csv", "taxel_id"), column(path, "found.csv", "region"));
    for (id, region) in ids.iter().zip(&regions) {
        assert_eq!(region == "tip", id.parse::<u32>().unwrap() <= 40, "taxel {id}: {region:?}");
    }
    dermatome(
        path,
        "render map/map.glb touch.npz -o touched.npz --contacts contacts_found.csv --threshold 0.001 -q",
    )
    .assert()
    .success();
    let peaks = column(path, "contacts_found.csv", "peak_taxel_id");
    for (peak, region) in peaks.iter().zip(column(path, "contacts_found.csv", "region")) {
        assert_eq!(region == "tip", peak.parse::<u32>().unwrap() <= 40);
    }
    let bytes = fs::read(path.join("touched.npz")).unwrap();
    for name in ["regions.npy", "cap.region.npy", "cap.L0.region.npy"] {
        assert!(bytes.windows(name.len()).any(|part| part == name.as_bytes()), "{name}");
    }
    dermatome(path, "plot map/map.glb -o regions.svg --level 0 --show regions").assert().success();
    assert!(fs::read_to_string(path.join("regions.svg")).unwrap().contains(">tip<"));
    refuses(path, "plot map/map.glb -o x.svg --show regions --regions missing.csv", &["missing.csv"]);
    refuses(path, "plot cap.glb -o x.svg --show regions", &["no patch has named regions"]);
    fs::write(path.join("other.csv"), "taxel_id,region\n5000,tip\n").unwrap();
    refuses(path, "lookup map/map.glb contacts.csv --regions other.csv", &["other.csv", "line 2", "5000"]);
    fs::write(path.join("far.json"), r#"[{"patch": "cap", "region": "x", "uv": [[0, 0], [9, 0], [0, 9]]}]"#)
        .unwrap();
    refuses(
        path,
        "summary map/map.glb touch.npz -o x.csv --regions far.json",
        &["far.json", "off the map of cap"],
    );
    refuses(path, "build cap.glb -o again --regions tip.txt", &["link, or a file"]);
}

/// A row for each group; the whole is the sum of the patch, and a stream gives the sums of the file.
#[test]
fn sums_of_a_trial_are_a_table() {
    let folder = folder_with_a_map();
    let path = folder.path();
    let run = dermatome(
        path,
        "summary map/map.glb touch.npz -o sums.csv --threshold 0.001 --over-time loads.csv --json",
    )
    .assert()
    .success();
    assert_eq!(column(path, "sums.csv", "group"), ["whole", "link", "patch", "region", "contact"]);
    assert_eq!(column(path, "sums.csv", "name")[2..4], ["cap", "tip"]);
    let impulses: Vec<f64> = column(path, "sums.csv", "impulse").iter().map(|x| x.parse().unwrap()).collect();
    assert!(impulses[0] > 0.0 && (impulses[0] - impulses[2]).abs() < 1e-12, "{impulses:?}");
    let found = json(&run.get_output().stdout);
    assert_eq!((&found["schema"], &found["contacts"]), (&"dermatome.summary/1".into(), &1.into()));
    assert_eq!(found["groups"][0]["impulse"].as_f64(), Some(impulses[0]));
    let forces = column(path, "loads.csv", "force").len();
    assert_eq!(found["frames"], forces / 4, "a row for each group, but contacts, and frame");
    dermatome(path, "touch cap.glb -o touch.csv --presses 1 --rate-hz 20 -q").assert().success();
    let text = fs::read(path.join("touch.csv")).unwrap();
    dermatome(path, "summary map/map.glb - -o stream.csv --threshold 0.001 -q")
        .write_stdin(text)
        .assert()
        .success();
    dermatome(path, "summary map/map.glb touch.csv -o file.csv --threshold 0.001 -q").assert().success();
    assert_eq!(fs::read(path.join("stream.csv")).unwrap(), fs::read(path.join("file.csv")).unwrap());
    refuses(path, "summary map/map.glb touch.npz -o x.csv --threshold -1", &["at least 0"]);
    refuses(path, "summary map/map.glb touch.npz -o x.txt", &["csv"]);
}

/// A layout takes the ids of an archive, and states what standard input has.
#[test]
fn layouts_are_of_archives_with_ids_and_of_streams() {
    let folder = folder_with_a_map();
    let path = folder.path();
    let layout = |taxels: &str, time: &str| {
        format!(
            r#"{{"dermatome_layout": 1, "axes": ["frame", "taxel"], "time": {time}, "channels":
               [{{"name": "force", "unit": "N"}}], "press": "raises", "zero": 0, "taxels": {taxels}}}"#
        )
    };
    let of_file = layout(r#"{"ids": "file"}"#, r#"{"stream": "timestamps", "unit": "s"}"#)
        .replace("\"axes\"", "\"stream\": \"values\", \"axes\"");
    fs::write(path.join("file.json"), of_file).unwrap();
    dermatome(path, "summary map/map.glb touch.npz -o plain.csv --threshold 0.001 -q").assert().success();
    notes(path, "summary map/map.glb touch.npz -o laid.csv --threshold 0.001 --layout file.json", &[]);
    assert_eq!(fs::read(path.join("plain.csv")).unwrap(), fs::read(path.join("laid.csv")).unwrap());
    fs::write(path.join("ids.json"), layout(r#"{"ids": [2, 3]}"#, r#"{"rate": 10}"#)).unwrap();
    let run = dermatome(path, "render map/map.glb - -o out.npz --values-only --layout ids.json --json")
        .write_stdin("2,3\n0.5,1\n0.25,2\n")
        .assert()
        .success();
    let found = json(&run.get_output().stdout);
    assert_eq!((&found["frames"], &found["channels"][0]["unit"]), (&2.into(), &"N".into()));
    let run = dermatome(path, "render map/map.glb - -o out.npz --values-only --layout ids.json")
        .write_stdin("1,2,3\n0.5,1,1\n")
        .assert();
    run.code(2);
    refuses(path, "render map/map.glb - -o out.npz --stream x", &["standard input is one stream"]);
}

/// One sensor of several is a skin, and the error about several says how.
#[test]
fn one_sensor_of_a_recording_is_converted() {
    let folder = tempfile::tempdir().unwrap();
    let sensor = |name: &str| {
        format!(
            "SENSOR,{name}\n,,,\nRows,2\nColumns,3\nSensel Width (cm),1\nSensel Height (cm),1\nEst. Load (N),2.1\n,,,\nSENSELS\n\
             ,,,\n1,2,3\n,,,\n4,5,6\n,,,\n"
        )
    };
    let text = format!(
        "File:,\"walk.XSN\",,\n,,,\nUnits:,kPa,,\n,,,\nThreshold:,1\nFRAME,5\n,,,\nDate, 2026 Jan 31\nTime, 23:59:59.1\n,,,\n{}{}",
        sensor("left"),
        sensor("right")
    );
    fs::write(folder.path().join("feet.csv"), text).unwrap();
    refuses(&folder, "convert feet.csv skin.glb", &["2 streams", "\"left\" of [2, 3]", "--stream NAME"]);
    refuses(&folder, "convert feet.csv skin.glb --stream middle", &["no stream \"middle\"", "--stream NAME"]);
    dermatome(&folder, "convert feet.csv skin.glb --stream right -q").assert().success();
    dermatome(&folder, "build skin.glb -o map -q").assert().success();
    dermatome(&folder, "summary map/map.glb feet.csv --stream right -o sums.csv --threshold 0 -q")
        .assert()
        .success();
    let force: f64 = column(folder.path(), "sums.csv", "force_peak")[0].parse().unwrap();
    assert!((force - 2.1).abs() < 1e-6, "{force} N");
}
