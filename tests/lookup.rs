//! The `lookup` command: tables in, tables out, and what it refuses.
#![cfg(feature = "cli")]
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use std::{
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
};

use assert_cmd::Command;
use dermatome::{
    contact::{ContactIndex, Query},
    io::{read_map, write_map, write_skin},
    map::SkinMap,
    mesh::shapes,
    pipeline::{BuildOptions, build},
    pyramid::LevelId,
    skin::{Link, Patch, PatchId, Presence, Skin},
};
use glam::{DAffine3, DVec3};
use tempfile::TempDir;

const HEADER: &str = "contact,level,patch,face,b0,b1,b2,u,v,px,py,field,taxel_id,distance";

/// A cap on an arm that is 1 m above a base without skin, and its map as a file holds it.
struct Fixture {
    folder: TempDir,
    skin: Skin,
    map: SkinMap,
}

impl Fixture {
    fn new() -> Self {
        let mut skin = Skin::default();
        let base = skin.links.push(Link { name: "base".into(), parent: None, pose: DAffine3::IDENTITY });
        let pose = DAffine3::from_translation(DVec3::Z);
        let arm = skin.links.push(Link { name: "arm".into(), parent: Some(base), pose });
        skin.patches.push(Patch::from_mesh("cap", arm, shapes::cap(600, 0.1, 0.6)));
        let map = build(&skin, &BuildOptions::default()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.glb");
        write_map(&path, &map).unwrap();
        Self { map: read_map(&path).unwrap(), folder, skin }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn file(&self, name: &str, text: &str) -> PathBuf {
        fs::write(self.path(name), text).unwrap();
        self.path(name)
    }

    fn lookup(&self, contacts: &Path) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_dermatome"));
        command.arg("lookup").arg(self.path("map.glb")).arg(contacts);
        command
    }
}

fn output(command: &mut Command) -> String {
    String::from_utf8(command.assert().success().get_output().stdout.clone()).unwrap()
}

/// Column `name` of row `row` of a table, as text.
fn cell<'a>(table: &'a str, row: usize, name: &str) -> &'a str {
    let column = HEADER.split(',').position(|c| c == name).unwrap();
    table.lines().nth(row + 1).unwrap().split(',').nth(column).unwrap()
}

#[test]
fn each_contact_has_a_row_on_each_level() {
    let fixture = Fixture::new();
    let index = ContactIndex::new(&fixture.map).unwrap();
    let levels = fixture.map.patches[PatchId::new(0)].levels.len();
    assert!(levels >= 3, "{levels} levels");
    let mut text = "x,y,z,force\n".to_owned();
    let points: Vec<_> = (0..50).map(|k| DVec3::new(0.001 * f64::from(k) - 0.02, 0.01, 0.9)).collect();
    points.iter().for_each(|p| writeln!(text, "{},{},{},1", p.x, p.y, p.z).unwrap());
    let contacts = fixture.file("contacts.csv", &text);

    let table = output(&mut fixture.lookup(&contacts));
    assert_eq!(table.lines().next().unwrap(), HEADER);
    assert_eq!(table.lines().count(), 1 + points.len() * levels);
    for (k, &point) in points.iter().enumerate() {
        let hit = index.locate(Query::from(point)).unwrap();
        for (level, expected) in index.cells(&hit).enumerate() {
            let row = k * levels + level;
            let number = |name: &str| cell(&table, row, name).parse::<f64>().unwrap();
            assert_eq!((number("contact"), number("level")), (k as f64, level as f64));
            assert_eq!(cell(&table, row, "patch"), "cap");
            assert_eq!(cell(&table, row, "face"), expected.point.face.to_string());
            assert_eq!([number("b0"), number("b1"), number("b2")], expected.point.barycentric);
            assert_eq!([number("u"), number("v")], expected.uv.to_array());
            assert_eq!(cell(&table, row, "taxel_id"), expected.taxel.to_string());
            assert_eq!(number("distance"), hit.distance);
            // On every level the weights are what the direct prolongation makes of the hit.
            let sum: f64 = expected.weights.iter().map(|(_, w)| w).sum();
            assert!((sum - 1.0).abs() < 1e-6, "weights of {expected:?}");
        }
    }

    let one = output(fixture.lookup(Path::new("-")).args(["--level", "1"]).write_stdin(text));
    assert_eq!(one.lines().count(), 1 + points.len());
    assert_eq!(one.lines().nth(1), table.lines().nth(2), "standard input gives the same row");
    let file = fixture.path("out.csv");
    output(fixture.lookup(&contacts).arg("-o").arg(&file));
    assert_eq!(fs::read_to_string(file).unwrap(), table, "a file holds what standard output shows");
}

#[test]
fn a_link_or_a_pose_moves_the_question() {
    let fixture = Fixture::new();
    let contacts = fixture.file("c.csv", "link,x,y,z\narm,0,0,-0.11\n,0,0,0.89\n");
    let table = output(&mut fixture.lookup(&contacts));
    let levels = fixture.map.patches[PatchId::new(0)].levels.len();
    for row in [0, levels] {
        let distance: f64 = cell(&table, row, "distance").parse().unwrap();
        assert!((distance - 0.01).abs() < 1e-6, "one centimetre off the pole, not {distance}");
    }
    // The arm follows its base half a metre up; its own frame does not notice.
    let poses = fixture.file("p.csv", "link,x,y,z,qx,qy,qz,qw\nbase,0,0,0.5,0,0,0,1\n");
    let moved = output(fixture.lookup(&contacts).arg("--pose").arg(&poses));
    assert_eq!(cell(&moved, 0, "distance"), cell(&table, 0, "distance"));
    let distance: f64 = cell(&moved, levels, "distance").parse().unwrap();
    assert!((distance - 0.51).abs() < 1e-6, "{distance}");
}

/// Contacts in fields whose centre reads no pressure are counted in a note, level by level.
#[test]
fn contacts_on_absent_taxels_are_noted() {
    let mut fixture = Fixture::new();
    let contacts = fixture.file("c.csv", "x,y,z\n0,0,0.9\n0.02,0.01,0.9\n0.02,0,0.9\n");
    let note = |fixture: &Fixture, levels: &[&str]| {
        let run = fixture.lookup(&contacts).args(levels).output().unwrap();
        String::from_utf8(run.stderr).unwrap()
    };
    assert_eq!(note(&fixture, &[]), "");
    let index = ContactIndex::new(&fixture.map).unwrap();
    let hit = index.locate(Query::from(DVec3::new(0.0, 0.0, 0.9))).unwrap();
    let cell = index.cell(&hit, LevelId::new(0)).unwrap();
    for presence in [Presence::Absent, Presence::ThermalPad] {
        fixture.map.patches[PatchId::new(0)].taxels.presence[cell.field] = presence;
        write_map(&fixture.path("map.glb"), &fixture.map).unwrap();
        let said = note(&fixture, &["--level", "0"]);
        assert!(said.contains("absent taxel or a thermal pad: 1 on level 0\n"), "{said}");
    }
    let taxels = &mut fixture.map.patches[PatchId::new(0)].taxels;
    taxels.presence = taxels.presence.map(|_| Presence::Absent);
    write_map(&fixture.path("map.glb"), &fixture.map).unwrap();
    let said = note(&fixture, &["--level", "1", "--level", "0"]);
    assert!(said.contains("3 on level 0, 3 on level 1\n"), "{said}");
    assert_eq!(note(&fixture, &["--quiet"]), "");
}

/// A column that changes nothing is named, whether it is known or not; an empty one is not.
#[test]
fn columns_without_effect_are_named() {
    let fixture = Fixture::new();
    let text = "x,y,z,force,radius,time,colour\n0,0,0.89,2,,0.1,red\n0,0,0.9,3,,0.2,blue\n";
    let contacts = fixture.file("c.csv", text);
    let output = fixture.lookup(&contacts).output().unwrap();
    let notes = String::from_utf8(output.stderr).unwrap();
    for (column, named) in [("force", true), ("time", true), ("colour", true), ("radius", false)] {
        let note = format!("column `{column}` is not used");
        assert_eq!(notes.matches(&note).count(), usize::from(named), "{column} in {notes}");
    }
}

/// A table of taxels is in the world, whatever links they are on: each is found where it is.
#[test]
fn taxels_of_a_table_are_found_on_the_map() {
    let fixture = Fixture::new();
    let table = fixture.path("skin.csv");
    write_skin(&table, &fixture.skin).unwrap();
    let answers = output(fixture.lookup(&table).args(["--level", "0"]));
    let ids: Vec<String> =
        fixture.skin.patches[PatchId::new(0)].taxels.ids.iter().map(ToString::to_string).collect();
    assert_eq!(answers.lines().count(), 1 + ids.len());
    for (row, id) in ids.iter().enumerate() {
        let distance: f64 = cell(&answers, row, "distance").parse().unwrap();
        assert!(distance.abs() < 1e-6, "taxel {id} is {distance} m off the skin");
        assert_eq!(cell(&answers, row, "taxel_id"), id);
    }
}

#[test]
fn what_cannot_be_answered_is_refused_with_its_line() {
    let fixture = Fixture::new();
    let out = fixture.file("out.csv", "older");
    for (contacts, expected) in [
        ("x,y,z\n0,0,0\n0,nan,0\n", "line 3"),
        ("x,y,z\n0,0,0\n0,1e15,0\n", "line 3"),
        ("x,y,z,link\n0,0,0,\n0,0,0,leg\n", "leg"),
        ("x,y,z,link\n0,0,0,\n0,0,0,base\n", "carries no patch"),
        ("x,y\n0,0\n", "column `z`"),
        ("", "line 1"),
    ] {
        let file = fixture.file("bad.csv", contacts);
        let run = fixture.lookup(&file).arg("-o").arg(&out).assert().code(2);
        let error = String::from_utf8(run.get_output().stderr.clone()).unwrap();
        assert!(error.contains(expected), "{contacts:?}: {error}");
        assert_eq!(fs::read_to_string(&out).unwrap(), "older", "an older output is left as it was");
    }
    let good = fixture.file("good.csv", "x,y,z\n0,0,0\n");
    fixture.lookup(&good).args(["--level", "40"]).assert().code(2);
    let poses = fixture.file("p.csv", "link,x,y,z,qx,qy,qz,qw\nleg,0,0,0,0,0,0,1\n");
    fixture.lookup(&good).arg("--pose").arg(&poses).assert().code(2);
    fixture.lookup(&fixture.path("absent.csv")).assert().code(2);
    fixture.lookup(&good).arg("-o").arg(fixture.path("no/folder.csv")).assert().code(2);
}

/// Weights of a hit and its cell are one sparse product, whatever the level.
#[test]
fn coarse_weights_are_the_product_with_the_direct_prolongation() {
    let fixture = Fixture::new();
    let index = ContactIndex::new(&fixture.map).unwrap();
    let patch = &fixture.map.patches[PatchId::new(0)];
    let hit = index.locate(DVec3::new(0.013, -0.021, 0.9)).unwrap();
    let corners = patch.levels[LevelId::new(0)].level.mesh.triangles[hit.point.face];
    for (id, level) in patch.levels.enumerate().skip(1) {
        let direct = level.level.to_finest.as_ref().unwrap();
        let mut expected = vec![0.0; level.level.mesh.positions.len()];
        for (corner, share) in corners.into_iter().zip(hit.point.barycentric) {
            for (field, weight) in direct.indices[corner].into_iter().zip(direct.weights[corner]) {
                expected[field.index()] += share * weight;
            }
        }
        let cell = index.cell(&hit, id).unwrap();
        for (field, &weight) in level.level.mesh.positions.ids().zip(&expected) {
            let found = cell.weights.iter().find(|(f, _)| *f == field).map_or(0.0, |(_, w)| w);
            assert!((found - weight).abs() < 1e-15, "{field:?} of {id:?}");
        }
        let strongest = expected.iter().copied().fold(0.0, f64::max);
        assert_eq!(expected[cell.field.index()], strongest);
        assert_eq!(cell.taxel, patch.taxels.ids[level.level.origins[cell.field]]);
    }
}
