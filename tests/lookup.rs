//! The `lookup` command: tables in, tables out, and what it refuses.
#![cfg(feature = "cli")]
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

mod common;

use std::borrow::BorrowMut;
use std::collections::HashMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use dermatome::{
    contact::{ContactIndex, Query},
    id::VertexId,
    io::{read_draft, read_map, write_map, write_skin},
    map::SkinMap,
    mesh::shapes,
    pipeline::{BuildOptions, build},
    pyramid::LevelId,
    skin::{AssembleOptions, Link, LinkId, Motion, MotionFrame, Patch, PatchId, Presence, Skin, assemble},
};
use glam::{DAffine3, DQuat, DVec3};
use tempfile::TempDir;

const HEADER: &str = "contact,level,patch,face,b0,b1,b2,u,v,px,py,field,taxel_id,distance,link,x,y,z,nx,ny,nz,fields,presence,live_taxel_id,frame";

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
        let mut command = common::command();
        command.arg("lookup").arg(self.path("map.glb")).arg(contacts);
        command
    }
}

/// The table and the notes of a command that succeeds.
fn said(mut command: impl BorrowMut<Command>) -> (String, String) {
    let run = command.borrow_mut().assert().success().get_output().clone();
    (String::from_utf8(run.stdout).unwrap(), String::from_utf8(run.stderr).unwrap())
}

fn output(command: impl BorrowMut<Command>) -> String {
    said(command).0
}

/// What a command says that refuses its input.
fn refusal(mut command: impl BorrowMut<Command>) -> String {
    let run = command.borrow_mut().assert().code(2).get_output().clone();
    String::from_utf8(run.stderr).unwrap()
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

    let table = output(fixture.lookup(&contacts));
    assert_eq!(table.lines().next().unwrap(), HEADER);
    assert_eq!(table.lines().count(), 1 + points.len() * levels);
    for (k, &point) in points.iter().enumerate() {
        let hit = index.locate(Query::from(point)).unwrap();
        for (level, expected) in (0..).map_while(|k| index.cell(&hit, LevelId::new(k))).enumerate() {
            let row = k * levels + level;
            let number = |name: &str| cell(&table, row, name).parse::<f64>().unwrap();
            assert_eq!((number("contact"), number("level")), (k as f64, level as f64));
            assert_eq!(cell(&table, row, "patch"), "cap");
            assert_eq!(cell(&table, row, "face"), expected.point.face.to_string());
            assert_eq!([number("b0"), number("b1"), number("b2")], expected.point.barycentric);
            assert_eq!([number("u"), number("v")], expected.uv.to_array());
            assert_eq!(cell(&table, row, "taxel_id"), expected.taxel.to_string());
            assert_eq!(number("distance"), hit.distance);
            assert_eq!((cell(&table, row, "link"), cell(&table, row, "frame")), ("arm", "world"));
            assert_eq!([number("x"), number("y"), number("z")], hit.position.to_array());
            assert_eq!([number("nx"), number("ny"), number("nz")], hit.normal.to_array());
            let fields = cell(&table, row, "fields").split(';').map(|field| {
                let (field, weight) = field.split_once(':').unwrap();
                (VertexId::new(field.parse().unwrap()), weight.parse().unwrap())
            });
            assert!(fields.eq(expected.weights.iter()), "{expected:?}");
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
fn contacts_are_in_the_frame_of_their_link_as_posed() {
    let fixture = Fixture::new();
    let contacts = fixture.file("c.csv", "link,x,y,z\narm,0,0,-0.11\n,0,0,0.89\n");
    let table = output(fixture.lookup(&contacts));
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
    let patch = &fixture.map.patches[PatchId::new(0)];
    let positions = &patch.levels[LevelId::new(0)].level.mesh.positions;
    let away = |v: &VertexId| positions[*v].distance(hit.position - DVec3::Z);
    let others = positions.ids().filter(|v| *v != cell.field);
    let nearest = others.min_by(|a, b| away(a).total_cmp(&away(b))).unwrap();
    let answers = output(fixture.lookup(&contacts).args(["--level", "0"]));
    let of = |row: &HashMap<&str, &str>| {
        ["presence", "taxel_id", "live_taxel_id"].map(|name| row[name].to_owned())
    };
    let found: Vec<_> = rows(&answers).iter().map(of).collect();
    let live = patch.taxels.ids[nearest].to_string();
    assert_eq!(found[0], ["thermal", &cell.taxel.to_string(), &live], "the nearest taxel that works");
    assert!(found[1][0] == "present" && found[1][1] == found[1][2], "{found:?}");
    let taxels = &mut fixture.map.patches[PatchId::new(0)].taxels;
    taxels.presence = taxels.presence.map(|_| Presence::Absent);
    write_map(&fixture.path("map.glb"), &fixture.map).unwrap();
    let said = note(&fixture, &["--level", "1", "--level", "0"]);
    assert!(said.contains("3 on level 0, 3 on level 1\n"), "{said}");
    let answers = output(fixture.lookup(&contacts).args(["--nearest", "1"]));
    assert!(rows(&answers).iter().all(|row| row["presence"] == "absent" && row["live_taxel_id"].is_empty()));
    assert_eq!(note(&fixture, &["--quiet"]), "");
}

/// The frame of a contact is that of any link, also of one without skin; `only_link` says whose skin it
/// is on.
#[test]
fn contacts_are_in_the_frame_of_any_link() {
    let mut fixture = Fixture::new();
    let wrist = Link {
        name: "wrist".into(),
        parent: Some(LinkId::new(1)),
        pose: DAffine3::from_rotation_translation(DQuat::from_rotation_x(0.4), DVec3::new(0.1, -0.2, 0.3)),
    };
    let to_wrist = (DAffine3::from_translation(DVec3::Z) * wrist.pose).inverse();
    fixture.map.links.push(wrist);
    write_map(&fixture.path("map.glb"), &fixture.map).unwrap();
    let at = DVec3::new(0.01, 0.02, 0.89);
    let [x, y, z] = to_wrist.transform_point3(at).to_array();
    let text = format!(
        "x,y,z,link,only_link\n{},{},{},,\n{x},{y},{z},wrist,\n{x},{y},{z},wrist,arm\n",
        at.x, at.y, at.z
    );
    let contacts = fixture.file("c.csv", &text);
    let answers = output(fixture.lookup(&contacts).args(["--level", "0"]));
    let found = rows(&answers);
    let point = |row| DVec3::new(number(row, "x"), number(row, "y"), number(row, "z"));
    for row in &found[1..] {
        assert_eq!((row["frame"], row["link"], row["face"]), ("wrist", "arm", found[0]["face"]));
        assert!((number(row, "distance") - number(&found[0], "distance")).abs() < 1e-6);
        assert!(point(row).distance(to_wrist.transform_point3(point(&found[0]))) < 1e-6, "{row:?}");
    }
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

/// A table without one good row leaves an older output as it was.
#[test]
fn tables_without_a_good_row_are_refused_with_their_line() {
    let fixture = Fixture::new();
    let out = fixture.file("out.csv", "older");
    for (contacts, expected) in [
        ("x,y,z\n0,nan,0\n", "line 2, column `y`"),
        ("x,y,z\n0,1e15,0\n", "line 2"),
        ("x,y,z,link\n0,0,0,leg\n", "leg"),
        ("x,y,z,only_link\n0,0,0,base\n", "carries no patch"),
        ("x,y\n0,0\n", "column `z`"),
        ("", "line 1"),
    ] {
        let file = fixture.file("bad.csv", contacts);
        let error = refusal(fixture.lookup(&file).arg("-o").arg(&out));
        assert!(error.contains(expected), "{contacts:?}: {error}");
        assert_eq!(fs::read_to_string(&out).unwrap(), "older", "an older output is left as it was");
    }
    let good = fixture.file("good.csv", "x,y,z\n0,0,0\n");
    fixture.lookup(&good).args(["--level", "40"]).assert().code(2);
    fixture.lookup(&good).args(["--max-distance", "-1"]).assert().code(2);
    let poses = fixture.file("p.csv", "link,x,y,z,qx,qy,qz,qw\nleg,0,0,0,0,0,0,1\n");
    fixture.lookup(&good).arg("--pose").arg(&poses).assert().code(2);
    fixture.lookup(&fixture.path("absent.csv")).assert().code(2);
    fixture.lookup(&good).arg("-o").arg(fixture.path("no/folder.csv")).assert().code(2);
}

/// Bad rows are listed and counted, and cost no good row its answer nor its number.
#[test]
fn a_bad_row_costs_no_good_row() {
    let fixture = Fixture::new();
    let rows = [
        "0,0,0.89,",
        "inf,0,0,",
        "0,0,0.89,leg",
        "1,2",
        "",
        "0,0,-0.11,arm",
        "0,\"zero\",0,",
        "0,0,0,leg",
        "0,1e13,0,",
        "0,0,nan,base",
        "0,0,0.89,",
    ];
    let contacts = fixture.file("c.csv", &format!("x,y,z,link\n{}\n", rows.join("\n")));
    let out = fixture.path("out.csv");
    let error = refusal(fixture.lookup(&contacts).args(["--level", "0", "--quiet", "-o"]).arg(&out));
    for part in
        ["7 of 10 rows", "line 3, column `x`", "line 5: found 2 cells", "found \"leg\"", "line 8, column `y`"]
    {
        assert!(error.contains(part), "{part} in {error}");
    }
    let table = fs::read_to_string(out).unwrap();
    let numbers: Vec<_> = (0..3).map(|row| cell(&table, row, "contact")).collect();
    assert_eq!((numbers, table.lines().count()), (vec!["0", "4", "9"], 4), "places in the table");
}

/// Contacts far from the skin say so, with their distance; when most are, a note asks why.
#[test]
fn contacts_far_off_are_off_the_skin() {
    let fixture = Fixture::new();
    let contacts = fixture.file("mm.csv", "x,y,z\n0,0,0.89\n20,10,890\n20,12,890\n");
    let run = |options: &[&str]| {
        let run = fixture.lookup(&contacts).args(["--level", "1"]).args(options).output().unwrap();
        (String::from_utf8(run.stdout).unwrap(), String::from_utf8(run.stderr).unwrap())
    };
    let (table, notes) = run(&[]);
    assert_eq!((cell(&table, 0, "patch"), cell(&table, 1, "patch")), ("cap", "off skin"));
    assert!((cell(&table, 1, "distance").parse::<f64>().unwrap().abs() - 889.4).abs() < 0.1, "{table}");
    assert_eq!([cell(&table, 1, "face"), cell(&table, 1, "x"), cell(&table, 1, "link")], [""; 3]);
    assert!(notes.contains("2 of 3 contacts are off the skin") && notes.contains("in metres"), "{notes}");
    for (options, asked) in [
        (&["--unit", "m"][..], ": are they in the frame of the world? (--frame, --max-distance)\n"),
        (&["--frame", "link"], ": are they in metres? (--unit, --max-distance)\n"),
        (
            &["--frame", "world", "--max-distance", "0.01"],
            "by more than 0.01 m: are they in metres? (--unit)\n",
        ),
        (&["--unit", "m", "--frame", "link"], "10 spacings of its taxels\n"),
    ] {
        let (_, notes) = run(options);
        assert!(notes.contains(asked), "{options:?}: {asked} in {notes}");
    }
    let (table, notes) = run(&["--max-distance", "inf"]);
    assert!((0..3).all(|row| cell(&table, row, "patch") == "cap") && notes.is_empty(), "{table}{notes}");
    let (table, _) = run(&["--max-distance", "0.001"]);
    assert!((0..3).all(|row| cell(&table, row, "patch") == "off skin"), "{table}");
}

/// Contacts of another frame may come near enough to be answered: a note asks whenever most are several
/// spacings away.
#[test]
fn a_note_asks_when_most_contacts_are_several_spacings_away() {
    let fixture = Fixture::new();
    let patch = PatchId::new(0);
    let spacing = ContactIndex::new(&fixture.map).unwrap().spacing(patch).unwrap();
    for (spacings, is_noted) in [(1.0, false), (5.0, true)] {
        let mesh = &fixture.skin.patches[patch].mesh;
        let off = |p: &DVec3| DVec3::Z + *p + p.normalize() * spacings * spacing;
        let points = mesh.positions.iter().step_by(9).map(off);
        let rows: Vec<_> = points.map(|p| format!("{},{},{}\n", p.x, p.y, p.z)).collect();
        let contacts = fixture.file("off.csv", &format!("x,y,z\n{}", rows.concat()));
        let notes = said(fixture.lookup(&contacts).args(["--level", "0"])).1;
        assert_eq!(notes.contains("more than 3 spacings of taxels from the skin"), is_noted, "{notes}");
        let run = fixture.lookup(&contacts).args(["--max-distance", "inf"]).output().unwrap();
        assert!(run.stderr.is_empty(), "no note where the limit is given");
    }
}

/// The limit holds for the centres of fields too.
#[test]
fn nearest_fields_are_within_the_largest_distance() {
    let fixture = Fixture::new();
    let contacts = fixture.file("far.csv", "x,y,z\n118,0,0\n");
    let run = |most: &str| output(fixture.lookup(&contacts).args(["--nearest", "2", "--max-distance", most]));
    assert_eq!(cell(&run("0.001"), 0, "patch"), "off skin");
    assert_eq!(cell(&run("200"), 0, "patch"), "cap");
    fixture.lookup(&contacts).args(["--within", "1", "--max-distance", "1"]).assert().code(2);
}

/// Positions of taxels in the frame of their link are found with `--frame link`, though the link
/// has no name.
#[test]
fn contacts_may_be_in_the_frame_of_the_only_link_with_skin() {
    let mut fixture = Fixture::new();
    let mesh = &fixture.skin.patches[PatchId::new(0)].mesh;
    let points: Vec<DVec3> = mesh.positions.iter().copied().step_by(7).collect();
    let rows: Vec<_> = points.iter().map(|p| format!("{},{},{}\n", p.x, p.y, p.z)).collect();
    let contacts = fixture.file("c.csv", &format!("x,y,z\n{}", rows.concat()));
    fixture.map.links.iter_mut().for_each(|link| link.name.clear());
    write_map(&fixture.path("map.glb"), &fixture.map).unwrap();
    let table = output(fixture.lookup(&contacts).args(["--level", "0", "--frame", "link"]));
    for (row, p) in points.iter().enumerate() {
        let number = |name: &str| cell(&table, row, name).parse::<f64>().unwrap();
        assert!(number("distance").abs() < 1e-6, "{table}");
        assert!(DVec3::new(number("x"), number("y"), number("z")).distance(*p) < 1e-6);
        assert_eq!((cell(&table, row, "link"), cell(&table, row, "frame")), ("link1", "link1"));
    }
    let named = fixture.file("n.csv", "x,y,z,link\n0,0,-0.1,link1\n");
    assert_eq!(cell(&output(fixture.lookup(&named)), 0, "frame"), "link1");
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

/// The rows of a table as maps from column to cell.
fn rows(table: &str) -> Vec<HashMap<&str, &str>> {
    let header: Vec<_> = table.lines().next().unwrap().split(',').collect();
    table.lines().skip(1).map(|line| header.iter().copied().zip(line.split(',')).collect()).collect()
}

fn number(row: &HashMap<&str, &str>, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column} of {row:?}"))
}

#[test]
fn reactive_answers_say_how_far_off_they_may_be() {
    let fixture = Fixture::new();
    let contacts = fixture.file("c.csv", "x,y,z\n0.01,0,0.89\n0.02,0.01,0.9\n-0.03,0.01,0.91\n");
    let exact = output(fixture.lookup(&contacts).args(["--level", "0"]));
    let table = output(fixture.lookup(&contacts).arg("--reactive"));
    let levels = fixture.map.patches[PatchId::new(0)].levels.len();
    for (k, row) in rows(&table).iter().enumerate() {
        let difference = number(row, "distance").abs() - number(&rows(&exact)[k / levels], "distance").abs();
        assert_eq!(number(row, "level"), (k % levels) as f64);
        assert!(difference.abs() <= number(row, "error") + 1e-12, "{row:?}");
        assert_eq!(number(row, "error") == 0.0, k % levels == 0, "level 0 is exact");
    }
}

/// Where a patch has no such level, its coarsest one answers, once.
#[test]
fn a_patch_without_a_level_answers_all_the_same() {
    let mut fixture = Fixture::new();
    let link = fixture.skin.patches[PatchId::new(0)].link;
    let mut small = shapes::triangle();
    small.positions.iter_mut().for_each(|p| *p = *p * 0.01 + DVec3::X);
    fixture.skin.patches.push(Patch::from_mesh("small", link, small));
    let map = build(&fixture.skin, &BuildOptions::default()).unwrap();
    assert_eq!(map.patches[PatchId::new(1)].levels.len(), 1);
    write_map(&fixture.path("map.glb"), &map).unwrap();
    let contacts = fixture.file("c.csv", "x,y,z\n1.002,0.002,1\n0,0,0.9\n");
    for (levels, expected) in [
        (&["--level", "2"][..], &["0 0 small", "1 2 cap"][..]),
        (&["--level", "1", "--level", "2"], &["0 0 small", "1 1 cap", "1 2 cap"]),
    ] {
        let table = output(fixture.lookup(&contacts).arg("--reactive").args(levels));
        let found = rows(&table);
        let found = found.iter().map(|row| format!("{} {} {}", row["contact"], row["level"], row["patch"]));
        assert_eq!(found.collect::<Vec<_>>(), expected, "{levels:?}");
    }
}

/// The finest level counts contacts that are off the skin, each once.
#[test]
fn reactive_answers_count_far_contacts_once() {
    let fixture = Fixture::new();
    let contacts = fixture.file("c.csv", "x,y,z\n0,0,0.9\n0,0,0.89\n0,0,0.89\n");
    for levels in [&["--level", "0"][..], &[]] {
        let mut command = fixture.lookup(&contacts);
        let notes = said(command.args(["--reactive", "--max-distance", "0.009"]).args(levels)).1;
        assert!(
            notes.contains("2 of 3 contacts are off the skin, by more than 0.009 m"),
            "{levels:?}: {notes}"
        );
    }
}

#[test]
fn taxels_are_counted_or_found_within_a_distance() {
    let fixture = Fixture::new();
    let contacts = fixture.file("c.csv", "x,y,z,radius\n0,0,0.899,\n0.02,0,0.9,0.002\n0,0,5,\n");
    let nearest = output(fixture.lookup(&contacts).args(["--nearest", "4", "--level", "0", "--level", "1"]));
    assert_eq!(rows(&nearest).len(), 3 * 2 * 4);
    let distances: Vec<f64> = rows(&nearest)[..4].iter().map(|row| number(row, "distance")).collect();
    assert!(distances.is_sorted() && distances[0] < 0.005, "{distances:?}");
    let within = output(fixture.lookup(&contacts).args(["--within", "0.008", "--level", "0"]));
    let table = rows(&within);
    for row in table.iter().filter(|row| row["patch"] == "cap") {
        let limit = if row["contact"] == "1" { 0.01 } else { 0.008 };
        assert!(
            number(row, "distance") <= limit && row["fields"] == format!("{}:1.0", row["field"]),
            "{row:?}"
        );
    }
    assert_eq!((table.last().unwrap()["contact"], table.last().unwrap()["patch"]), ("2", "off skin"));
    fixture.lookup(&contacts).args(["--within", "-1"]).assert().code(2);
    fixture.lookup(&contacts).args(["--within", "1", "--nearest", "2"]).assert().code(2);
}

#[test]
fn rays_follow_the_normal() {
    let fixture = Fixture::new();
    let text = "x,y,z,nx,ny,nz\n0,0,0,0,0,2\n0,0,0,0,0,-1\n0,0,0,0,0,0\n";
    let contacts = fixture.file("c.csv", text);
    let out = fixture.path("out.csv");
    let error = refusal(fixture.lookup(&contacts).args(["--ray", "--level", "0", "-o"]).arg(&out));
    assert!(error.contains("line 4, columns nx,ny,nz") && !error.contains("is not used"), "{error}");
    let text = fs::read_to_string(out).unwrap();
    let table = rows(&text);
    assert!((number(&table[0], "distance") - 0.9).abs() < 1e-6, "from the base up to the cap: {table:?}");
    assert_eq!(table[1]["patch"], "off skin", "down there is nothing");
}

/// The answers of a lookup are places on maps; the way back finds the points of level 0 again.
#[test]
fn from_map_finds_the_points_of_a_lookup() {
    let fixture = Fixture::new();
    let contacts = fixture.file("c.csv", "x,y,z\n0.01,0,0.9\n0.02,0.01,0.9\n-0.03,0.01,0.91\n");
    let answers = output(fixture.lookup(&contacts));
    let places = fixture.file("places.csv", &answers);
    for (frame, up) in [("world", 0.0), ("link", -1.0)] {
        let back = output(fixture.lookup(&places).args(["--from-map", "--frame", frame]));
        assert_eq!(rows(&back).len(), rows(&answers).len());
        for (there, here) in rows(&answers).iter().zip(rows(&back)) {
            assert!((number(there, "u") - number(&here, "u")).abs() < 1e-9, "{here:?}");
            let at = |row| DVec3::new(number(row, "x"), number(row, "y"), number(row, "z"));
            let allowed = if there["level"] == "0" { 1e-9 } else { 0.02 };
            assert!((at(there) + DVec3::Z * up).distance(at(&here)) < allowed, "{there:?} {here:?}");
        }
    }
    let text = "px,py,level,patch\n60,60,1,cap\n5,100000,0,cap\n5,9,0,leg\n5,9,77,cap\n1.5,9,0,cap\n";
    let pixels = fixture.file("pixels.csv", text);
    let out = fixture.path("back.csv");
    let error = refusal(fixture.lookup(&pixels).args(["--from-map", "-o"]).arg(&out));
    for part in [
        "4 of 5",
        "line 3, columns px,py",
        "line 4, column `patch`",
        "line 5, column `level`",
        "line 6, column `px`",
    ] {
        assert!(error.contains(part), "{part} in {error}");
    }
    let text = fs::read_to_string(&out).unwrap();
    assert_eq!((rows(&text)[0]["px"], rows(&text)[0]["py"]), ("60", "60"));
    let off = fixture.file("off.csv", "u,v\n5,0\n");
    let (table, notes) = said(fixture.lookup(&off).arg("--from-map"));
    assert!(
        number(&rows(&table)[0], "off_chart") > 4.5 && notes.contains("1 place is off the map"),
        "{notes}"
    );
    let none = fixture.file("none.csv", "u,px\n5,0\n");
    fixture.lookup(&none).arg("--from-map").assert().code(2);
}

/// A table of answers is one of contacts, in the frame that it names, and of places on maps: what is off
/// the skin has none.
#[test]
fn answers_are_contacts_and_places() {
    let fixture = Fixture::new();
    let contacts = fixture.file("c.csv", "x,y,z,link\n0.01,0,0.9,\n0.01,0,-0.1,arm\n0,0,9,\n");
    let answers = output(fixture.lookup(&contacts).args(["--level", "0"]));
    let patches: Vec<_> = rows(&answers).iter().map(|row| row["patch"].to_owned()).collect();
    assert_eq!(patches, ["cap", "cap", "off skin"]);
    let table = fixture.file("answers.csv", &answers);

    let (again, notes) = said(fixture.lookup(&table).args(["--level", "0"]));
    assert!(notes.contains("1 row is without an answer"), "{notes}");
    assert_eq!(rows(&again).len(), 2);
    for (row, (before, frame)) in rows(&again).iter().zip(rows(&answers).iter().zip(["world", "arm"])) {
        assert!(number(row, "distance").abs() < 1e-12 && row["frame"] == frame, "{row:?}");
        assert_eq!((row["face"], row["link"]), (before["face"], "arm"));
    }

    let (back, notes) = said(fixture.lookup(&table).arg("--from-map"));
    assert!(notes.contains("1 row is without an answer"), "{notes}");
    assert_eq!(rows(&back).len(), 2);
    let pixels = fixture.file("pixels.csv", "patch,level,px,py\noff skin,0,,\ncap,0,60,60\n");
    assert_eq!(rows(&output(fixture.lookup(&pixels).arg("--from-map"))).len(), 1);

    let unknown = fixture.file("c.csv", "contact,frame,x,y,z\n0,leg,0,0,0.9\n1,world,0,0,0.9\n");
    let notes = refusal(fixture.lookup(&unknown));
    assert!(notes.contains("line 2, column `frame`: found \"leg\"; needed: `world`, or the name"), "{notes}");

    // A link of that name is not the world.
    let mut map = fixture.map.clone();
    map.links[map.patches[PatchId::new(0)].link].name = "world".into();
    write_map(&fixture.path("map.glb"), &map).unwrap();
    let notes = refusal(fixture.lookup(&table));
    assert!(notes.contains("also the name of a link"), "{notes}");
}

/// Every question is asked back when most contacts are far.
#[test]
fn far_contacts_of_fields_are_noted() {
    let fixture = Fixture::new();
    let contacts = fixture.file("c.csv", "x,y,z\n10,20,3\n");
    for options in [["--nearest", "2"], ["--within", "100"]] {
        let notes = said(fixture.lookup(&contacts).args(options)).1;
        assert!(notes.contains("are they in metres"), "{options:?}: {notes}");
    }
}

/// Fields of no face have no cell; the contacts that they are near to are on the skin all the same.
#[test]
fn fields_without_a_face_are_counted() {
    let fixture = Fixture::new();
    let mut mesh = shapes::lattice(6, 5, 0.005);
    mesh.positions.push(DVec3::new(0.01, 0.01, 0.001));
    write_map(&fixture.path("map.glb"), &SkinMap::flat(mesh, 1e-3)).unwrap();
    let contacts = fixture.file("c.csv", "x,y,z\n0.01,0.01,0.002\n");
    for (options, count) in [(["--nearest", "1"], 0), (["--nearest", "2"], 1), (["--within", "0.0012"], 0)] {
        let (table, notes) = said(fixture.lookup(&contacts).args(options));
        assert_eq!(rows(&table).len(), count, "{options:?}: {table}");
        assert!(notes.contains("1 answer is without a row"), "{options:?}: {notes}");
        assert!(!notes.contains("off the skin"), "{options:?}: {notes}");
    }
}

/// Only options that change it are named where contacts are off the skin.
#[test]
fn advice_names_only_options_that_help() {
    let fixture = Fixture::new();
    let contacts = fixture.file("c.csv", "x,y,z,nx,ny,nz\n0,0,9,0,0,1\n");
    for (options, is_asked) in [(&[][..], true), (&["--ray"], false), (&["--within", "0.001"], false)] {
        let notes = said(fixture.lookup(&contacts).args(options)).1;
        assert!(notes.contains("(--unit, --frame"), "{notes}");
        assert_eq!(notes.contains("--max-distance"), is_asked, "{options:?}: {notes}");
    }
    let poses = fixture.file("p.csv", "link,x,y,z,qx,qy,qz,qw\narm,0,0,1000,0,0,0,1\n");
    let notes = said(fixture.lookup(&contacts).arg("--pose").arg(&poses)).1;
    assert!(notes.contains("p.csv in metres?"), "{notes}");
    let notes = refusal(fixture.lookup(&contacts).args(["--animation", "wave"]));
    assert!(notes.contains("help: give a file with an animation"), "{notes}");
}

/// The arm goes up by 1 m/s from 1 s to 3 s, by a table or by an animation of a glTF file; contacts
/// and places on the map are matched by their time.
#[test]
fn contacts_are_matched_with_poses_by_their_time() {
    let fixture = Fixture::new();
    let poses = "time,link,x,y,z,qx,qy,qz,qw\n1,arm,0,0,1,0,0,0,1\n3,arm,0,0,3,0,0,0,1\n";
    let table = fixture.file("poses.csv", poses);
    let floats = [1.0_f32, 3.0, 0.0, 0.0, 1.0, 0.0, 0.0, 3.0].map(f32::to_le_bytes);
    fs::write(fixture.path("moves.bin"), floats.concat()).unwrap();
    let gltf = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"name":"base","children":[1]},
        {"name":"arm"}],"buffers":[{"uri":"moves.bin","byteLength":32}],"bufferViews":[{"buffer":0,"byteLength":8},
        {"buffer":0,"byteOffset":8,"byteLength":24}],"accessors":[{"bufferView":0,"componentType":5126,"count":2,
        "type":"SCALAR","min":[1],"max":[3]},{"bufferView":1,"componentType":5126,"count":2,"type":"VEC3"}],
        "animations":[{"name":"up","channels":[{"sampler":0,"target":{"node":1,"path":"translation"}}],
        "samplers":[{"input":0,"output":1,"interpolation":"LINEAR"}]}]}"#;
    let moves = fixture.file("moves.gltf", gltf);
    let contacts =
        fixture.file("c.csv", "time,x,y,z\n1,0,0,0.89\n1.5,0,0,1.39\n2,0,0,1.89\n7,0,0,2.89\n,0,0,0.89\n");
    for pose in [vec![table.clone()], vec![moves.clone(), "--animation".into(), "up".into()]] {
        let (text, notes) = said(fixture.lookup(&contacts).args(["--level", "0", "--pose"]).args(&pose));
        assert!(notes.contains("2 contacts are without a time or outside"), "{pose:?}: {notes}");
        assert!(!notes.contains("is not used"), "{notes}");
        assert_eq!(rows(&text).len(), 5, "{text}{notes}");
        for row in rows(&text) {
            assert!((number(&row, "distance") - 0.01).abs() < 1e-6, "{pose:?}: {row:?}");
        }
    }
    let places = fixture.file("p.csv", "time,u,v\n1,0,0\n1.5,0,0\n2,0,0\n7,0,0\n,0,0\n");
    let (text, notes) = said(fixture.lookup(&places).arg("--from-map").arg("--pose").arg(&table));
    assert!(notes.contains("2 places are without a time or outside"), "{notes}");
    let heights: Vec<f64> = rows(&text).iter().map(|row| number(row, "z")).collect();
    for (height, up) in heights.iter().zip([0.0, 0.5, 1.0, 2.0, 0.0]) {
        assert!((height - heights[0] - up).abs() < 1e-9, "{heights:?}");
    }
    let notes = said(fixture.lookup(&places).arg("--from-map")).1;
    assert!(notes.contains("column `time` is not used"), "{notes}");
    for (options, expected) in [
        (vec!["--animation", "up"], "animations"),
        (vec!["--pose", table.to_str().unwrap(), "--animation", "up"], "no animation"),
        (vec!["--pose", moves.to_str().unwrap(), "--animation", "down"], "\"up\""),
    ] {
        let error = refusal(fixture.lookup(&contacts).args(&options));
        assert!(error.contains(expected), "{options:?}: {error}");
    }
    for (from, to) in [
        ("LINEAR", "CUBICSPLINE"),
        ("\"translation\"", "\"scale\""),
        ("\"input\":0", "\"input\":9"),
        ("\"output\":1", "\"output\":0"),
    ] {
        let bad = fixture.file("bad.gltf", &gltf.replace(from, to));
        fixture.lookup(&contacts).arg("--pose").arg(&bad).assert().code(2);
    }
    let other = fixture.file("other.gltf", &gltf.replace("\"arm\"", "\"leg\""));
    let notes = said(fixture.lookup(&contacts).arg("--pose").arg(&other)).1;
    assert!(notes.contains("other.gltf: the map has no link for the animated `leg`\n"), "{notes}");
    assert!(notes.contains("other.gltf: the animation moves no link of the map\n"), "{notes}");
}

/// An animation of the skin is in its map too: written, read, listed and looked up.
#[test]
fn animations_are_kept_in_skins_and_maps() {
    let mut fixture = Fixture::new();
    let arm = fixture.skin.links.ids().nth(1).unwrap();
    let up = |z: f64| DAffine3::from_translation(DVec3::Z * z);
    let turned = up(2.0) * DAffine3::from_rotation_z(0.5);
    let mut motion = Motion::default();
    motion.name = "up".into();
    // At 2 s it jumps.
    let keys = [(1.0, up(1.0)), (2.0, up(2.0)), (2.0, turned), (3.0, up(3.0))];
    motion.set(arm, MotionFrame::Parent, &keys).unwrap();
    fixture.skin.animations.push(motion);
    let glb = fixture.path("skin.glb");
    write_skin(&glb, &fixture.skin).unwrap();
    let draft = read_draft(&glb).unwrap();
    let skin = assemble(&draft, &AssembleOptions::default()).unwrap().skin;
    let map = build(&skin, &BuildOptions::default()).unwrap();
    write_map(&fixture.path("map.glb"), &map).unwrap();
    let map = read_map(&fixture.path("map.glb")).unwrap();
    let mut index = ContactIndex::new(&map).unwrap();
    for read in [&draft.animations, &skin.animations, &map.animations] {
        assert_eq!((read.len(), read[0].name.as_str()), (1, "up"));
        assert_eq!(read[0].times(), Some([1.0, 3.0]));
        for (time, expected) in [(0.0, up(1.0)), (1.75, up(1.75)), (2.0, turned), (9.0, up(3.0))] {
            index.set_motion(&read[0], time).unwrap();
            assert!(index.poses()[arm].abs_diff_eq(expected, 1e-5), "at {time} s");
        }
    }
    let contacts = fixture.file("c.csv", "time,x,y,z\n1.5,0,0,1.39\n3,0,0,2.89\n");
    for options in [vec!["--animation", "up"], vec!["--animation", "up", "--reactive"]] {
        let table = output(fixture.lookup(&contacts).args(["--level", "0"]).args(options));
        for row in rows(&table) {
            assert!((number(&row, "distance") - 0.01).abs() < 1e-5, "{row:?}");
        }
    }
    // The map's own animation means its own links, whatever their names.
    fixture.skin.links[arm].name = "base".into();
    write_map(&fixture.path("map.glb"), &build(&fixture.skin, &BuildOptions::default()).unwrap()).unwrap();
    let table = output(fixture.lookup(&contacts).args(["--level", "0", "--animation", "up"]));
    assert!(rows(&table).iter().all(|row| (number(row, "distance") - 0.01).abs() < 1e-5), "{table}");
    let poses = fixture.file("p.csv", "link,x,y,z,qx,qy,qz,qw\nbase,0,0,0.5,0,0,0,1\n");
    let error = refusal(fixture.lookup(&contacts).arg("--pose").arg(&poses));
    assert!(error.contains("2 links of the map have it"), "{error}");
    let mut info = common::command();
    let text = output(info.arg("info").arg(fixture.path("map.glb")));
    assert!(text.contains("animation up: 1 to 3 s"), "{text}");
    let mut in_world = Motion::default();
    in_world.set(arm, MotionFrame::World, &keys).unwrap();
    fixture.skin.animations[0] = in_world;
    assert!(write_skin(&glb, &fixture.skin).is_err(), "glTF has poses relative to the link above");
}

/// The forces of contacts become a recording that `render` reads, and none of them is lost.
#[test]
fn forces_become_readings() {
    let fixture = Fixture::new();
    let text =
        "time,x,y,z,force,radius\n0,0,0,0.9,2,\n0.1,0,0,0.891,3,0.01\n0.1,0.02,0,0.9,1,\n0.2,0,0,5,9,\n";
    let contacts = fixture.file("c.csv", text);
    let readings = fixture.path("touch.csv");
    let notes = said(fixture.lookup(&contacts).args(["--readings"]).arg(&readings)).1;
    assert!(notes.contains("1 contact is off all taxels") && !notes.contains("is not used"), "{notes}");
    let recording = fs::read_to_string(&readings).unwrap();
    let frames: Vec<(f64, f64)> = recording
        .lines()
        .skip(1)
        .map(|line| {
            let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
            (cells[0], cells[1..].iter().sum())
        })
        .collect();
    for ((time, sum), expected) in frames.iter().zip([(0.0, 2.0), (0.1, 4.0), (0.2, 0.0)]) {
        assert!(*time == expected.0 && (sum - expected.1).abs() < 1e-12, "{frames:?}");
    }
    let mut render = common::command();
    render.arg("render").arg(fixture.path("map.glb")).arg(&readings).arg("-o").arg(fixture.path("touch.npz"));
    render.assert().success();
    fixture.lookup(&contacts).arg("--readings").arg(fixture.path("touch.txt")).assert().code(2);
    fixture.lookup(&contacts).arg("--readings").arg(&contacts).assert().code(2);
}
