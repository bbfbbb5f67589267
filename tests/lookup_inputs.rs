//! Bad input of the `lookup` command: what is refused, what is answered all the same, and how it is
//! named.
#![cfg(feature = "cli")]
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

mod common;

use std::{collections::HashMap, fs, path::PathBuf};

use dermatome::contact::{ContactError, ContactIndex};
use dermatome::id::FaceId;
use dermatome::io::{read_map, write_map};
use dermatome::map::SkinMap;
use dermatome::mesh::{TriMesh, shapes};
use dermatome::pipeline::{BuildOptions, build};
use dermatome::skin::{Link, LinkId, Patch, PatchId, Skin};
use glam::{DAffine3, DVec3};
use tempfile::TempDir;

/// A map of two caps on an arm 1 m above a base; the name of the second one has to be quoted.
fn folder() -> TempDir {
    let mut skin = Skin::default();
    let base = skin.links.push(Link { name: "base".into(), parent: None, pose: DAffine3::IDENTITY });
    let pose = DAffine3::from_translation(DVec3::Z);
    let arm = skin.links.push(Link { name: "arm".into(), parent: Some(base), pose });
    let mut aside = shapes::cap(200, 0.1, 0.6);
    aside.positions.iter_mut().for_each(|p| p.x += 1.0);
    skin.patches.push(Patch::from_mesh("cap", arm, shapes::cap(200, 0.1, 0.6)));
    skin.patches.push(Patch::from_mesh("the \"other\", aside", arm, aside));
    let folder = tempfile::tempdir().unwrap();
    write_map(&folder.path().join("map.glb"), &build(&skin, &BuildOptions::default()).unwrap()).unwrap();
    folder
}

struct Run {
    code: i32,
    error: String,
    rows: Vec<HashMap<String, String>>,
}

impl Run {
    fn number(&self, row: usize, column: &str) -> f64 {
        self.rows[row][column].parse().unwrap()
    }

    fn contacts(&self) -> Vec<&str> {
        self.rows.iter().map(|row| row["contact"].as_str()).collect()
    }
}

/// Answers a table at level 0, unless the options say otherwise.
fn lookup(folder: &TempDir, table: &str, options: &[&str]) -> Run {
    let path = |name: &str| -> PathBuf { folder.path().join(name) };
    fs::write(path("in.csv"), table).unwrap();
    _ = fs::remove_file(path("out.csv"));
    let mut command = common::command();
    command.current_dir(folder).args(["lookup", "map.glb", "in.csv", "-o", "out.csv"]).args(options);
    let output = command.timeout(std::time::Duration::from_secs(60)).output().unwrap();
    let text = fs::read(path("out.csv")).unwrap_or_default();
    let mut reader = csv::Reader::from_reader(text.as_slice());
    let rows = reader.deserialize().map(Result::unwrap).collect();
    Run { code: output.status.code().unwrap(), error: String::from_utf8(output.stderr).unwrap(), rows }
}

const LEVEL_0: &[&str] = &["--level", "0"];

#[test]
fn a_quote_that_is_not_closed_costs_its_row_alone() {
    let folder = folder();
    let rows = ["0,0,0.9,", "\"0,0,0.9,", "0,0,0.9,\"arm", "0,0,-0.1,\"arm\"", "", "  ", "0,\"0\",\"0.9\","];
    let run = lookup(&folder, &format!("x,y,\"z\",link\r\n{}\r\n", rows.join("\r\n")), LEVEL_0);
    assert_eq!((run.code, run.contacts()), (2, vec!["0", "3", "4"]), "{}", run.error);
    for part in [r#"line 3, column `x`: found "\"0""#, r#"line 4, column `link`: found "\"arm""#] {
        assert!(run.error.contains(part), "{part} in {}", run.error);
    }
    assert!((0..3).all(|row| run.number(row, "distance").abs() < 1e-3), "{:?}", run.rows);
}

#[test]
fn names_that_have_to_be_quoted_come_back() {
    let folder = folder();
    let run = lookup(&folder, "x,y,z\n1,0,0.9\n", &[]);
    assert!(run.rows.iter().all(|row| row["patch"] == "the \"other\", aside"), "{:?}", run.rows);
    let text = fs::read_to_string(folder.path().join("out.csv")).unwrap();
    let back = lookup(&folder, &text, &["--from-map"]);
    assert_eq!((back.code, back.rows.len()), (0, run.rows.len()), "{}", back.error);
    assert!((back.number(0, "x") - run.number(0, "x")).abs() < 1e-9);
}

#[test]
fn contacts_may_be_in_millimetres() {
    let folder = folder();
    let options = ["--level", "0", "--within", "0.03"];
    let metres = lookup(&folder, "x,y,z,radius\n0.01,0.02,0.9,0.005\n", &options);
    let millimetres =
        lookup(&folder, "x,y,z,radius\n10,20,900,5\n", &["--level", "0", "--within", "0.03", "--unit", "mm"]);
    assert!(metres.rows.len() > 3 && metres.rows.len() == millimetres.rows.len(), "{}", millimetres.error);
    for row in 0..metres.rows.len() {
        let [a, b] = [&metres, &millimetres].map(|run| run.number(row, "distance"));
        assert!((a - b).abs() < 1e-12, "{a} and {b} m");
    }
    let back = ["--from-map", "--unit", "cm"];
    let [u, v] = ["u", "v"].map(|column| 100.0 * metres.number(0, column));
    let back = lookup(&folder, &format!("patch,u,v\ncap,{u},{v}\n"), &back);
    let [a, b] = [&metres, &back].map(|run| run.number(0, "u"));
    assert!((a - b).abs() < 1e-9, "{a} and {b} m");
}

#[test]
fn some_patches_of_a_map_answer() {
    let folder = folder();
    let table = "x,y,z\n0,0,0.9\n1,0,0.9\n";
    let run = lookup(&folder, table, &["--level", "0", "--patch", "the*", "--max-distance", "inf"]);
    assert_eq!((run.code, run.rows.len()), (0, 2), "{}", run.error);
    assert!(run.rows.iter().all(|row| row["patch"] == "the \"other\", aside"), "{:?}", run.rows);
    let table = "x,y,z,only_link\n0,0,0,arm\n0,0,0,base\n";
    let run = lookup(&folder, table, &["--patch", "cap", "--level", "0", "--max-distance", "inf"]);
    assert!(run.error.contains("\"base\", which carries no patch"), "{}", run.error);
    let file = folder.path().join("map.glb");
    let mut map = read_map(&file).unwrap();
    map.patches[PatchId::new(1)].link = LinkId::new(0);
    write_map(&file, &map).unwrap();
    let run = lookup(&folder, table, &["--patch", "cap", "--level", "0", "--max-distance", "inf"]);
    assert!(run.error.contains("\"base\", which carries none of the patches of --patch"), "{}", run.error);
    let run = lookup(&folder, table, &["--patch", "palm"]);
    assert!(
        run.code == 2 && run.error.contains("no patch of a name in --patch; it has cap"),
        "{}",
        run.error
    );
}

/// Numbers that are none, too large, or of the wrong sign: each is named by line and column.
#[test]
fn wrong_numbers_are_named() {
    let folder = folder();
    for (columns, cells, options, expected) in [
        ("x,y,z", "NaN,0,0", LEVEL_0, "column `x`: found \"NaN\""),
        ("x,y,z", "0,,0", LEVEL_0, "column `y`: found \"\""),
        ("x,y,z", "0,0", LEVEL_0, "found 2 cells"),
        ("x,y,z", "0,0,1e13", LEVEL_0, "coordinates within 1e12 m"),
        ("x,y,z,radius", "0,0,0,-1", LEVEL_0, "column `radius`: found \"-1\""),
        ("x,y,z,force", "0,0,0,1e300", LEVEL_0, "column `force`"),
        ("x,y,z,nx,ny,nz", "0,0,0,0,0,0", &["--ray"], "columns nx,ny,nz: found no direction"),
        ("u,v,patch", "1e300,0,cap", &["--from-map"], "columns u,v"),
        ("u,v", "0,0", &["--from-map"], "column `patch`"),
        ("px,py,patch", "0,4294967295,cap", &["--from-map"], "columns px,py"),
        ("px,py,patch", "0,4294967296,cap", &["--from-map"], "a whole number, 0 to 4294967295"),
        ("u,v,patch,level", "0,0,cap,9", &["--from-map"], "column `level`"),
    ] {
        let run = lookup(&folder, &format!("{columns}\n{cells}\n"), options);
        let named = run.error.contains("in.csv: line 2") && run.error.contains(expected);
        assert!(run.code == 2 && named && run.rows.is_empty(), "{cells}: {}", run.error);
    }
    for (columns, expected) in [
        ("x,y", "line 1: found columns \"x,y\"; needed: a column `z`"),
        ("x,y,z,x", "column 4: found \"x\" again"),
        ("1,-2.5,3e0", "line 1: found the numbers \"1,-2.5,3e0\"; the header is missing"),
        ("x\ty\tz", "separated by tabs, \"x\\ty\\tz\"; needed: columns separated by commas"),
    ] {
        let run = lookup(&folder, &format!("{columns}\n0,0,0\n"), LEVEL_0);
        assert!(run.code == 2 && run.error.contains(expected), "{columns}: {}", run.error);
    }
}

#[test]
fn options_that_answer_nothing_are_refused() {
    let folder = folder();
    for options in [
        ["--nearest", "0"],
        ["--nearest", "-1"],
        ["--within", "inf"],
        ["--within", "nan"],
        ["--taxel-radius-mm", "inf"],
        ["--max-distance", "nan"],
        ["--level", "99"],
        ["--pose", "absent.csv"],
        ["--animation", "wave"],
    ] {
        let run = lookup(&folder, "x,y,z\n0,0,0.9\n", &options);
        assert!(run.code == 2 && run.rows.is_empty(), "{options:?}: {}", run.error);
    }
}

/// Very far contacts are answered, with any question.
#[test]
fn contacts_far_away_are_answered() {
    let folder = folder();
    let table = "x,y,z,nx,ny,nz\n1e9,0,0,-1e300,0,1e291\n-1e12,1e12,1e12,1e-310,0,0\n0,0,0,0,0,1e-320\n";
    for options in [&["--max-distance", "inf"][..], &["--reactive"], &["--nearest", "2"], &["--within", "1"]]
    {
        let run = lookup(&folder, table, options);
        assert_eq!(run.code, 0, "{options:?}: {}", run.error);
        let far = run.rows.iter().filter(|row| row["contact"] == "0");
        let distances: Vec<f64> = far.map(|row| row["distance"].parse().unwrap()).collect();
        let is_right = |d: &f64| (d.abs() - 1e9).abs() < 2.0;
        assert!(!distances.is_empty() && distances.iter().all(is_right), "{options:?}: {distances:?}");
        assert_eq!(run.rows.last().unwrap()["contact"], "2");
    }
    let run = lookup(&folder, table, &["--ray", "--level", "0"]);
    assert_eq!((run.code, run.rows[2]["patch"].as_str()), (0, "cap"), "{}", run.error);
    assert!((run.number(2, "distance") - 0.9).abs() < 1e-3, "the length of the direction does not count");
}

/// An empty column is as none; the frame of the one link with skin takes the names of others too.
#[test]
fn contacts_without_a_link_are_in_the_world() {
    let folder = folder();
    let run = lookup(&folder, "x,y,z,link,radius,force\n0,0,0.89,,,\n", LEVEL_0);
    assert_eq!((run.code, run.error.contains("note")), (0, false), "{}", run.error);
    assert_eq!((run.rows[0]["frame"].as_str(), run.rows[0]["link"].as_str()), ("world", "arm"));
    let run = lookup(&folder, "x,y,z,link\n0,0,-0.11,\n", &["--level", "0", "--frame", "link"]);
    assert!((run.number(0, "distance") - 0.01).abs() < 1e-3, "{:?}", run.rows);
    let table = "x,y,z,link\n0,0,0,leg\n0,0,0,\"l,eg\"\n0,0,0.9,\n0,0,0,leg\n";
    let run = lookup(&folder, table, LEVEL_0);
    assert_eq!((run.code, run.contacts()), (2, vec!["2"]));
}

#[test]
fn invalid_poses_are_refused() {
    let folder = folder();
    let header = "time,link,x,y,z,qx,qy,qz,qw\n";
    for (poses, expected) in [
        ("0,arm,0,0,0,0,0,0,2\n", "a unit quaternion"),
        (
            "0,arm,0,0,1e13,0,0,0,1\n",
            "p.csv: the poses at 0 s: found a pose of link \"arm\" that is not rigid",
        ),
        ("0,arm,0,0,1,0,0,0,1\n9,arm,0,0,1e13,0,0,0,1\n", "p.csv: the poses at 9 s: found a pose"),
        ("0,leg,0,0,0,0,0,0,1\n", "column `link`"),
        ("0,arm,0,0,0,0,0,0,1\n-0,arm,0,0,0,0,0,0,1\n", "line 3, column `link`"),
    ] {
        fs::write(folder.path().join("p.csv"), header.to_owned() + poses).unwrap();
        let run = lookup(&folder, "x,y,z,time\n0,0,0.9,0\n0,0,0.9,99\n", &["--pose", "p.csv"]);
        assert!(run.code == 2 && run.error.contains(expected), "{poses}: {}", run.error);
        assert!(run.rows.is_empty());
    }
    for name in ["scale", "sz"] {
        let poses = format!("time,link,x,y,z,qx,qy,qz,qw,{name}\n0,arm,0,0,1,0,0,0,1,2\n");
        fs::write(folder.path().join("p.csv"), poses).unwrap();
        let run = lookup(&folder, "x,y,z\n0,0,0.9\n", &["--pose", "p.csv"]);
        assert!(run.code == 2 && run.error.contains(&format!("column `{name}`")), "{}", run.error);
    }
    fs::write(folder.path().join("p.csv"), header).unwrap();
    let run = lookup(&folder, "x,y,z\n0,0,0.9\n", &["--pose", "p.csv"]);
    assert!(run.code == 2 && run.error.contains("p.csv: the table: found no row"), "{}", run.error);
    // One pose for all times.
    fs::write(folder.path().join("p.csv"), header.to_owned() + "5,arm,0,0,2,0,0,0,1\n").unwrap();
    let run = lookup(&folder, "x,y,z,time\n0,0,0.89,7\n", &["--pose", "p.csv", "--level", "0"]);
    assert!(run.code == 0 && (run.number(0, "distance") - 1.01).abs() < 1e-3, "{}", run.error);
}

#[test]
fn what_of_a_table_of_poses_is_not_used_is_named() {
    let folder = folder();
    for (columns, cells, expected) in [
        ("", "", None),
        (",scale", ",1", None),
        (",comment", ",2", Some("note: p.csv: column `comment` is not used\n")),
        (",t,Time", ",2,3", Some("note: p.csv: columns `t`, `Time` are not used\n")),
    ] {
        let poses = format!("link,x,y,z,qx,qy,qz,qw{columns}\narm,0,0,1,0,0,0,1{cells}\n");
        fs::write(folder.path().join("p.csv"), poses).unwrap();
        let run = lookup(&folder, "x,y,z\n0,0,0.9\n", &["--pose", "p.csv"]);
        let is_noted = expected.map_or(!run.error.contains("not used"), |note| run.error.contains(note));
        assert!(run.code == 0 && is_noted, "{columns}: {}", run.error);
    }
}

/// Tables as spreadsheets and loggers write them: a byte order mark, lines that end in two characters, times
/// in no order.
#[test]
fn tables_with_a_mark_and_times_in_no_order_are_read() {
    let folder = folder();
    let poses = "\u{feff}link,time,x,y,z,qx,qy,qz,qw\r\narm,2,0,0,3,0,0,0,1\r\narm,0,0,0,1,0,0,0,1\r\n";
    fs::write(folder.path().join("p.csv"), poses).unwrap();
    let table = "\u{feff}x,y,z,time\r\n0,0,2.89,2\r\n0,0,0.89,0\r\n0,0,1.89,1\r\n";
    let run = lookup(&folder, table, &["--pose", "p.csv", "--level", "0"]);
    assert_eq!((run.code, run.contacts()), (0, vec!["0", "1", "2"]), "{}", run.error);
    assert!((0..3).all(|row| (run.number(row, "distance") - 0.01).abs() < 1e-3), "{:?}", run.rows);
}

/// A skin of one triangle, and one 1000 km from the origin of its link.
#[test]
fn the_smallest_and_the_farthest_skins_are_answered() {
    for (mesh, at) in [
        (shapes::triangle(), DVec3::new(0.2, 0.2, 0.01)),
        (shapes::lattice(8, 8, 0.5), DVec3::new(1e6 + 1.1, 1e6 + 1.2, 1e6 + 0.01)),
    ] {
        let away = if at.x > 1e5 { DVec3::splat(1e6) } else { DVec3::ZERO };
        let mesh = TriMesh { positions: mesh.positions.map(|p| *p + away), ..mesh };
        let folder = tempfile::tempdir().unwrap();
        let map = build(&Skin::from_mesh("far", mesh), &BuildOptions::default()).unwrap();
        write_map(&folder.path().join("map.glb"), &map).unwrap();
        let run = lookup(&folder, &format!("x,y,z\n{},{},{}\n", at.x, at.y, at.z), LEVEL_0);
        assert_eq!((run.code, run.rows.len()), (0, 1), "{}", run.error);
        assert!((run.number(0, "distance").abs() - 0.01).abs() < 1e-8, "{:?}", run.rows);
        assert!(run.rows[0]["patch"] == "far" && run.number(0, "nz").abs() == 1.0, "{:?}", run.rows);
    }
}

/// Places off every chart are answered with the nearest one, and say how far off they are.
#[test]
fn places_off_the_map_say_so() {
    let folder = folder();
    let table = "u,v,patch\n1e9,0,cap\n0,0,cap\n0,-1e12,cap\n";
    let run = lookup(&folder, table, &["--from-map"]);
    assert_eq!((run.code, run.contacts()), (0, vec!["0", "1", "2"]), "{}", run.error);
    assert!((run.number(0, "off_chart") - 1e9).abs() < 1.0 && run.number(1, "off_chart") == 0.0);
    assert!(run.error.contains("2 places are off the map"), "{}", run.error);
}

#[test]
fn a_file_without_a_map_is_refused() {
    let folder = folder();
    fs::write(folder.path().join("bare.gltf"), r#"{"asset":{"version":"2.0"}}"#).unwrap();
    fs::copy(folder.path().join("map.glb"), folder.path().join("kept.glb")).unwrap();
    for bad in ["bare.gltf", "in.csv"] {
        fs::copy(folder.path().join(bad), folder.path().join("map.glb")).unwrap_or_default();
        let run = lookup(&folder, "x,y,z\n0,0,0.9\n", &[]);
        assert!(run.code == 2 && run.error.contains("map.glb"), "{bad}: {}", run.error);
    }
}

/// The map of a mesh seen from above, as a file.
fn flat(mesh: TriMesh) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_map(&folder.path().join("map.glb"), &SkinMap::flat(mesh, 1e-3)).unwrap();
    folder
}

/// Triangles that are a side or a point are never nearer than one with an area.
#[test]
fn triangles_without_area_are_not_hit_first() {
    let mut mesh = shapes::lattice(6, 5, 0.01);
    let [a, b, c] = mesh.triangles[FaceId::new(0)];
    let [pa, pb, pc] = [a, b, c].map(|v| mesh.positions[v]);
    for corners in [[pa, pa.midpoint(pb), pb], [pc; 3]] {
        let corners = corners.map(|p| mesh.positions.push(p));
        mesh.triangles.push(corners);
    }
    let first = u32::try_from(mesh.triangles.len()).unwrap() - 2;
    let index = ContactIndex::new(&SkinMap::flat(mesh, 1e-3)).unwrap();
    for k in 0..50 {
        let q = DVec3::new(0.001 * f64::from(k), 0.0005 * f64::from(k), 0.002);
        let hit = index.locate(q).unwrap();
        assert!(hit.point.face.raw() < first && hit.normal.distance(DVec3::Z) < 1e-12, "{hit:?}");
    }
}

/// Tens of thousands of triangles at one place: the first is the answer, there and back, in no time.
#[test]
fn triangles_at_one_place_are_answered() {
    const STACKED: u32 = 70_000;
    let corners: Vec<DVec3> = shapes::triangle().positions.iter().copied().collect();
    let stacked = (0..STACKED).flat_map(|_| corners.iter().map(|p| *p * 0.1)).collect();
    let triangles: Vec<_> = (0..STACKED).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    let folder = flat(TriMesh::from_arrays(stacked, &triangles));
    let run = lookup(
        &folder,
        "x,y,z\n0.02,0.02,0.001\n-1,0.3,0.2\n1e9,0,0\n",
        &["--level", "0", "--max-distance", "inf"],
    );
    assert_eq!((run.code, run.rows.len()), (0, 3), "{}", run.error);
    assert!((0..3).all(|row| run.rows[row]["face"] == "0"), "{:?}", run.rows);
    assert!((run.number(2, "distance").abs() / 1e9 - 1.0).abs() < 1e-6);
    let back = lookup(&folder, "level,u,v\n0,0.02,0.02\n0,-0.5,0.02\n", &["--from-map"]);
    assert_eq!((back.code, back.rows.len()), (0, 2), "{}", back.error);
    assert!((back.number(0, "x") - 0.02).abs() < 1e-9 && back.number(0, "off_chart") == 0.0);
    assert!((back.number(1, "off_chart") - 0.5).abs() < 1e-9);
}

#[test]
fn skins_without_a_patch_are_refused() {
    assert!(matches!(ContactIndex::new(&SkinMap::default()), Err(ContactError::NoSkin)));
    let mut empty = SkinMap::flat(shapes::square(), 1e-3);
    let patch = empty.patches.iter_mut().next().unwrap();
    patch.levels.iter_mut().for_each(|map| map.level.mesh = TriMesh::default());
    assert!(ContactIndex::new(&empty).is_err());
    let folder = folder();
    let run = lookup(&folder, "x,y,z\n", LEVEL_0);
    assert_eq!((run.code, run.rows.len()), (0, 0), "no contact, no answer: {}", run.error);
}

/// A row that is too long is refused by its line, like any other.
#[test]
fn a_row_that_is_too_long_costs_no_other_row() {
    let folder = folder();
    for (long, said) in [
        ("1".repeat(3 << 20), "found more than 1048576 bytes"),
        (format!("\"{}", ",".repeat(400_000)), "found 400001 cells"),
    ] {
        let table = format!("x,y,z\n0,0,0.9\n{long}\n0,0,0.9\n{long}\r\n\n0,0,0.9\n");
        let run = lookup(&folder, &table, LEVEL_0);
        assert_eq!((run.code, run.contacts()), (2, vec!["0", "2", "4"]), "{}", run.error);
        for part in ["2 of 5 rows".to_owned(), format!("line 3: {said}"), format!("line 5: {said}")] {
            assert!(run.error.contains(&part), "{part} in {}", run.error);
        }
    }
    let run = lookup(&folder, &format!("{}\n0,0,0.9\n", "x".repeat(2 << 20)), LEVEL_0);
    assert!(run.code == 2 && run.error.contains("line 1: found more than"), "{}", run.error);
}

/// A name of two links says neither.
#[test]
fn a_name_of_two_links_is_refused() {
    let folder = folder();
    let path = folder.path().join("map.glb");
    let mut map = read_map(&path).unwrap();
    map.links.iter_mut().for_each(|link| link.name = "arm".into());
    write_map(&path, &map).unwrap();
    let run = lookup(&folder, "x,y,z,link\n0,0,-0.11,arm\n0,0,0.89,\n", LEVEL_0);
    assert_eq!((run.code, run.contacts()), (2, vec!["1"]), "{}", run.error);
    assert!(run.error.contains("line 2, column `link`: found \"arm\", the name of 2 links"), "{}", run.error);
}

/// However many links are unknown and columns are not used, the first few are named and all are counted.
#[test]
fn unknown_columns_are_counted() {
    let folder = folder();
    for (count, note) in [
        (1, "column `c0` is not used"),
        (3, "columns `c0`, `c1`, `c2` are not used"),
        (9, "columns `c0`, `c1`, `c2`, `c3`, `c4` and 4 more are not used"),
    ] {
        let names: String = (0..count).map(|k| format!(",c{k}")).collect();
        let run = lookup(&folder, &format!("x,y,z{names}\n0,0,0.9{}\n", ",1".repeat(count)), LEVEL_0);
        assert_eq!((run.code, run.error), (0, format!("note: in.csv: {note}\nwrote out.csv\n")));
    }
}
