//! Every command takes every ugly skin of the zoo: nothing panics, and what is written is read back.

use std::fs;
use std::path::Path;

use crate::common::dermatome;
use crate::maps::zoo;
use dermatome::io::{read_map, write_skin};
use dermatome::{ContactIndex, LevelId};

/// Runs the command in a folder, which succeeds.
fn run(folder: &Path, words: &str) {
    let run = dermatome(folder, words).output().unwrap();
    let said = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.success(), "{words}: {said}");
    assert!(!said.contains("panicked"), "{words}: {said}");
}

/// A folder with the zoo as a skin and its map.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_skin(&folder.path().join("zoo.glb"), &zoo::skin()).unwrap();
    run(folder.path(), "build zoo.glb -o map");
    folder
}

#[test]
fn pictures_of_every_kind_are_drawn() {
    let folder = folder();
    run(folder.path(), "touch map/map.glb -o r.csv --presses 2 --rate-hz 5");
    for show in ["fields", "area", "angle"] {
        for level in 0..3 {
            run(folder.path(), &format!("plot map/map.glb --show {show} --level {level} -o a.svg"));
            run(folder.path(), &format!("plot map/map.glb --show {show} --level {level} --space -o a.svg"));
        }
        run(folder.path(), &format!("plot map/map.glb --show {show} --unfold 0,0.5,1 -o a.svg"));
    }
    for level in 0..3 {
        run(
            folder.path(),
            &format!("plot map/map.glb --readings r.csv --frame 3 --level {level} --space -o a.png"),
        );
    }
    run(folder.path(), "plot zoo.glb --space -o skin.svg");
    run(folder.path(), "report map/map.glb r.csv -o r.html");
}

#[test]
fn every_table_and_array_is_written() {
    let folder = folder();
    let at = folder.path();
    run(at, "touch map/map.glb -o r.csv --presses 2 --rate-hz 5 --truth t.csv");
    run(at, "render map/map.glb r.csv -o a.npz --contacts c.csv --size 40 50");
    run(at, "render map/map.glb r.csv -o b.npz --pack --level 1 --contrast --size 120 160");
    run(at, "render map/map.glb r.csv -o d.npz --edges --values-only");
    run(at, "render map/map.glb r.csv -o frames --static --every 9 --pixel-mm 2");
    fs::write(at.join("c.csv"), "x,y,z\n0,0,0\n1,0,0\n1,1,3\n1e3,0,0\n").unwrap();
    for options in
        ["", "--level 1", "--reactive --level 1", "--nearest 3", "--within 3mm", "--readings f.npz"]
    {
        dermatome(at, &format!("lookup map/map.glb c.csv -o l.csv {options}"))
            .assert()
            .code(predicates::ord::le(2));
    }
    for kind in ["xml", "usda", "csv", "npz", "json"] {
        run(at, &format!("export map/map.glb -o e.{kind}"));
    }
    for words in
        ["info zoo.glb --json", "info map/map.glb", "coarsen zoo.glb -o z.glb", "convert zoo.glb z.obj"]
    {
        run(at, words);
    }
}

/// Places of taxels are their own nearest skin on every patch, whatever its link; files keep the map.
#[test]
fn taxels_are_found_where_they_are() {
    let map = zoo::map();
    map.validate().unwrap();
    let index = ContactIndex::new(&map).unwrap();
    let poses = index.poses();
    for patch in &map.patches {
        let level = &patch.levels[LevelId::new(0)];
        for &position in &level.level.mesh.positions {
            let hit = index.locate(poses[patch.link].transform_point3(position)).unwrap();
            assert!(
                hit.distance < 1e-9 && map.patches[hit.patch].name == patch.name,
                "{}: {hit:?}",
                patch.name
            );
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.glb");
    dermatome::write_map(&path, &map).unwrap();
    read_map(&path).unwrap().validate().unwrap();
}
