//! The `lookup` command: tables in, tables out, and what it refuses.

mod inputs;
mod readings;

use std::collections::HashMap;
use std::path::PathBuf;
use std::{fs, time::Duration};

use dermatome::contact::{ContactIndex, Query};
use dermatome::id::VertexId;
use dermatome::io::{read_draft, read_map, write_map, write_skin};
use dermatome::map::SkinMap;
use dermatome::mesh::{TriMesh, shapes};
use dermatome::pipeline::{BuildOptions, build};
use dermatome::pyramid::LevelId;
use dermatome::skin::{
    AssembleOptions, Link, LinkId, Motion, MotionFrame, Patch, PatchId, Presence, Skin, assemble,
};
use glam::{DAffine3, DQuat, DVec3};
use tempfile::TempDir;

use crate::common;

const HEADER: &str = "contact,level,patch,face,b0,b1,b2,u,v,px,py,field,taxel_id,distance,link,x,y,z,nx,ny,nz,fields,presence,live_taxel_id,region,frame";

/// A map in a folder of its own, as its file holds it.
struct Fixture {
    folder: TempDir,
    skin: Skin,
    map: SkinMap,
}

impl Fixture {
    /// A cap on an arm that is 1 m above a base without skin.
    fn new() -> Self {
        Self::caps(&["cap"])
    }

    /// Caps on that arm, 1 m apart.
    fn caps(names: &[&str]) -> Self {
        let mut skin = Skin::default();
        let base = skin.links.push(Link { name: "base".into(), parent: None, pose: DAffine3::IDENTITY });
        let pose = DAffine3::from_translation(DVec3::Z);
        let arm = skin.links.push(Link { name: "arm".into(), parent: Some(base), pose });
        for (k, name) in names.iter().enumerate() {
            let mut cap = shapes::cap(600, 0.1, 0.6);
            cap.positions.iter_mut().for_each(|p| p.x += k as f64);
            skin.patches.push(Patch::from_mesh(*name, arm, cap));
        }
        Self::of(skin)
    }

    fn of(skin: Skin) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut fixture = Self { folder, map: build(&skin, &BuildOptions::default()).unwrap(), skin };
        fixture.write_map();
        fixture.map = read_map(&fixture.path("map.glb")).unwrap();
        fixture
    }

    /// A mesh seen from above.
    fn flat(mesh: TriMesh) -> Self {
        let (folder, skin) = (tempfile::tempdir().unwrap(), Skin::default());
        let fixture = Self { folder, skin, map: SkinMap::flat(mesh, 1e-3) };
        fixture.write_map();
        fixture
    }

    fn write_map(&self) {
        write_map(&self.path("map.glb"), &self.map).unwrap();
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn file(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    /// Answers a table, with options as a user types them.
    fn lookup(&self, table: &str, options: &str) -> Run {
        self.file("in.csv", table);
        let mut command = common::dermatome(&self.folder, &format!("lookup map.glb in.csv {options}"));
        let output = command.timeout(Duration::from_secs(60)).output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        let rows = csv::Reader::from_reader(text.as_bytes()).deserialize().map(Result::unwrap).collect();
        let (code, said) = (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap());
        Run { code, said, text, rows }
    }

    /// The same, which succeeds.
    fn answers(&self, table: &str, options: &str) -> Run {
        let run = self.lookup(table, options);
        assert_eq!(run.code, 0, "{options}: {}", run.said);
        run
    }

    /// What is said of a table that is refused.
    fn refusal(&self, table: &str, options: &str) -> String {
        let run = self.lookup(table, options);
        assert_eq!(run.code, 2, "{options}: {table}");
        run.said
    }
}

/// What a lookup said on standard error, and its answers.
struct Run {
    code: i32,
    said: String,
    text: String,
    rows: Vec<HashMap<String, String>>,
}

impl Run {
    fn cell(&self, row: usize, column: &str) -> &str {
        &self.rows[row][column]
    }

    fn number(&self, row: usize, column: &str) -> f64 {
        self.cell(row, column).parse().unwrap_or_else(|_| panic!("{column} of {:?}", self.rows[row]))
    }

    fn numbers<const N: usize>(&self, row: usize, columns: [&str; N]) -> [f64; N] {
        columns.map(|column| self.number(row, column))
    }

    fn point(&self, row: usize) -> DVec3 {
        DVec3::from_array(self.numbers(row, ["x", "y", "z"]))
    }

    fn column(&self, name: &str) -> Vec<&str> {
        self.rows.iter().map(|row| row[name].as_str()).collect()
    }
}

/// A table of contacts.
fn table(points: impl IntoIterator<Item = DVec3>) -> String {
    let rows = points.into_iter().map(|p| format!("{},{},{}\n", p.x, p.y, p.z));
    format!("x,y,z\n{}", rows.collect::<String>())
}

#[test]
fn each_contact_has_a_row_on_each_level() {
    let fixture = Fixture::new();
    let index = ContactIndex::new(&fixture.map).unwrap();
    let levels = fixture.map.patches[PatchId::new(0)].levels.len();
    assert!(levels >= 3, "{levels} levels");
    let points = (0..50).map(|k| DVec3::new(0.001 * f64::from(k) - 0.02, 0.01, 0.9));
    let contacts = table(points.clone());
    let run = fixture.answers(&contacts, "");
    assert_eq!(run.text.lines().next(), Some(HEADER));
    assert_eq!(run.rows.len(), points.len() * levels);
    for (k, point) in points.clone().enumerate() {
        let hit = index.locate(Query::from(point)).unwrap();
        for (level, expected) in (0..).map_while(|k| index.cell(&hit, LevelId::new(k))).enumerate() {
            let row = k * levels + level;
            assert_eq!(run.numbers(row, ["contact", "level"]), [k as f64, level as f64]);
            assert_eq!(run.cell(row, "face"), expected.point.face.to_string());
            assert_eq!(run.numbers(row, ["b0", "b1", "b2"]), expected.point.barycentric);
            assert_eq!(run.numbers(row, ["u", "v"]), expected.uv.to_array());
            assert_eq!(run.cell(row, "taxel_id"), expected.taxel.to_string());
            assert_eq!(run.number(row, "distance"), hit.distance);
            assert_eq!(["patch", "link", "frame"].map(|name| run.cell(row, name)), ["cap", "arm", "world"]);
            assert_eq!(run.point(row), hit.position);
            assert_eq!(run.numbers(row, ["nx", "ny", "nz"]), hit.normal.to_array());
            let fields = run.cell(row, "fields").split(';').map(|field| {
                let (field, weight) = field.split_once(':').unwrap();
                (VertexId::new(field.parse().unwrap()), weight.parse().unwrap())
            });
            assert!(fields.eq(expected.weights.iter()), "{expected:?}");
            // On every level the weights are what the direct prolongation makes of the hit.
            let sum: f64 = expected.weights.iter().map(|(_, w)| w).sum();
            assert!((sum - 1.0).abs() < 1e-6, "weights of {expected:?}");
        }
    }

    let mut piped = common::dermatome(&fixture.folder, "lookup map.glb - --level 1");
    let one = String::from_utf8(piped.write_stdin(contacts.clone()).output().unwrap().stdout).unwrap();
    assert_eq!(one.lines().count(), 1 + points.len());
    assert_eq!(one.lines().nth(1), run.text.lines().nth(2), "standard input gives the same row");
    fixture.answers(&contacts, "-o out.csv");
    let file = fs::read_to_string(fixture.path("out.csv")).unwrap();
    assert_eq!(file, run.text, "a file holds what standard output shows");
}

#[test]
fn contacts_are_in_the_frame_of_their_link_as_posed() {
    let fixture = Fixture::new();
    let contacts = "link,x,y,z\narm,0,0,-0.11\n,0,0,0.89\n";
    let run = fixture.answers(contacts, "--level 0");
    for row in 0..2 {
        let distance = run.number(row, "distance");
        assert!((distance - 0.01).abs() < 1e-6, "one centimetre off the pole, not {distance}");
    }
    // The arm follows its base half a metre up; its own frame does not notice.
    fixture.file("p.csv", "link,x,y,z,qx,qy,qz,qw\nbase,0,0,0.5,0,0,0,1\n");
    let moved = fixture.answers(contacts, "--level 0 --pose p.csv");
    assert_eq!(moved.cell(0, "distance"), run.cell(0, "distance"));
    let distance = moved.number(1, "distance");
    assert!((distance - 0.51).abs() < 1e-6, "{distance}");
}

/// Contacts in fields whose centre reads no pressure are counted in a note, level by level.
#[test]
fn contacts_on_absent_taxels_are_noted() {
    let mut fixture = Fixture::new();
    let contacts = "x,y,z\n0,0,0.9\n0.02,0.01,0.9\n0.02,0,0.9\n";
    assert_eq!(fixture.answers(contacts, "").said, "");
    let index = ContactIndex::new(&fixture.map).unwrap();
    let hit = index.locate(Query::from(DVec3::new(0.0, 0.0, 0.9))).unwrap();
    let cell = index.cell(&hit, LevelId::new(0)).unwrap();
    for presence in [Presence::Absent, Presence::ThermalPad] {
        fixture.map.patches[PatchId::new(0)].taxels.presence[cell.field] = presence;
        fixture.write_map();
        let said = fixture.answers(contacts, "--level 0").said;
        assert!(said.contains("absent taxel or a thermal pad: 1 on level 0\n"), "{said}");
    }
    let patch = &fixture.map.patches[PatchId::new(0)];
    let positions = &patch.levels[LevelId::new(0)].level.mesh.positions;
    let away = |v: &VertexId| positions[*v].distance(hit.position - DVec3::Z);
    let others = positions.ids().filter(|v| *v != cell.field);
    let nearest = others.min_by(|a, b| away(a).total_cmp(&away(b))).unwrap();
    let run = fixture.answers(contacts, "--level 0");
    let found = |row| ["presence", "taxel_id", "live_taxel_id"].map(|name| run.cell(row, name));
    let live = patch.taxels.ids[nearest].to_string();
    assert_eq!(found(0), ["thermal", &cell.taxel.to_string(), &live], "the nearest taxel that works");
    assert!(found(1)[0] == "present" && found(1)[1] == found(1)[2], "{:?}", found(1));
    let taxels = &mut fixture.map.patches[PatchId::new(0)].taxels;
    taxels.presence = taxels.presence.map(|_| Presence::Absent);
    fixture.write_map();
    let said = fixture.answers(contacts, "--level 1 --level 0").said;
    assert!(said.contains("3 on level 0, 3 on level 1\n"), "{said}");
    let run = fixture.answers(contacts, "--nearest 1");
    assert!(run.rows.iter().all(|row| row["presence"] == "absent" && row["live_taxel_id"].is_empty()));
    assert_eq!(fixture.answers(contacts, "--quiet").said, "");
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
    fixture.write_map();
    let at = DVec3::new(0.01, 0.02, 0.89);
    let [x, y, z] = to_wrist.transform_point3(at).to_array();
    let contacts = format!(
        "x,y,z,link,only_link\n{},{},{},,\n{x},{y},{z},wrist,\n{x},{y},{z},wrist,arm\n",
        at.x, at.y, at.z
    );
    let run = fixture.answers(&contacts, "--level 0");
    for row in 1..3 {
        let found = ["frame", "link", "face"].map(|name| run.cell(row, name));
        assert_eq!(found, ["wrist", "arm", run.cell(0, "face")]);
        assert!((run.number(row, "distance") - run.number(0, "distance")).abs() < 1e-6);
        assert!(run.point(row).distance(to_wrist.transform_point3(run.point(0))) < 1e-6, "row {row}");
    }
}

/// A column that changes nothing is named, whether it is known or not; an empty one is not.
#[test]
fn columns_without_effect_are_named() {
    let contacts = "x,y,z,force,radius,time,colour\n0,0,0.89,2,,0.1,red\n0,0,0.9,3,,0.2,blue\n";
    let notes = Fixture::new().answers(contacts, "").said;
    // Answers keep times.
    for (column, named) in [("force", true), ("time", false), ("colour", true), ("radius", false)] {
        let note = format!("column `{column}` is not used");
        assert_eq!(notes.matches(&note).count(), usize::from(named), "{column} in {notes}");
    }
}

/// A table of taxels is in the world, whatever links they are on: each is found where it is.
#[test]
fn taxels_of_a_table_are_found_on_the_map() {
    let fixture = Fixture::new();
    write_skin(&fixture.path("skin.csv"), &fixture.skin).unwrap();
    let run = fixture.answers(&fs::read_to_string(fixture.path("skin.csv")).unwrap(), "--level 0");
    let ids = fixture.skin.patches[PatchId::new(0)].taxels.ids.iter().map(ToString::to_string);
    assert_eq!(run.column("taxel_id"), ids.collect::<Vec<_>>());
    for row in 0..run.rows.len() {
        let distance = run.number(row, "distance");
        assert!(distance.abs() < 1e-6, "taxel {row} is {distance} m off the skin");
    }
}

/// A table without one good row leaves an older output as it was.
#[test]
fn tables_without_a_good_row_are_refused_with_their_line() {
    let fixture = Fixture::new();
    fixture.file("out.csv", "older");
    for (contacts, expected) in [
        ("x,y,z\n0,nan,0\n", "line 2, column `y`"),
        ("x,y,z\n0,1e15,0\n", "line 2"),
        ("x,y,z,link\n0,0,0,leg\n", "leg"),
        ("x,y,z,only_link\n0,0,0,base\n", "carries no patch"),
        ("x,y\n0,0\n", "column `z`"),
        ("", "line 1"),
    ] {
        let error = fixture.refusal(contacts, "-o out.csv");
        assert!(error.contains(expected), "{contacts:?}: {error}");
        let left = fs::read_to_string(fixture.path("out.csv")).unwrap();
        assert_eq!(left, "older", "an older output is left as it was");
    }
    fixture.file("p.csv", "link,x,y,z,qx,qy,qz,qw\nleg,0,0,0,0,0,0,1\n");
    for options in ["--level 40", "--max-distance -1", "--pose p.csv", "-o no/folder.csv"] {
        fixture.refusal("x,y,z\n0,0,0\n", options);
    }
    common::refuses(&fixture.folder, "lookup map.glb absent.csv", &[]);
}

/// Bad rows are listed and counted, and cost no good row its answer nor its number.
#[test]
fn a_bad_row_costs_no_good_row() {
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
    let run = Fixture::new().lookup(&format!("x,y,z,link\n{}\n", rows.join("\n")), "--level 0 --quiet");
    for part in
        ["7 of 10 rows", "line 3, column `x`", "line 5: found 2 cells", "found \"leg\"", "line 8, column `y`"]
    {
        assert!(run.said.contains(part), "{part} in {}", run.said);
    }
    assert_eq!((run.code, run.column("contact")), (2, vec!["0", "4", "9"]), "places in the table");
}

/// Contacts far from the skin say so, with their distance; when most are, a note asks why.
#[test]
fn contacts_far_off_are_off_the_skin() {
    let fixture = Fixture::new();
    let run = |options: &str| {
        fixture.answers("x,y,z\n0,0,0.89\n20,10,890\n20,12,890\n", &format!("--level 1 {options}"))
    };
    let found = run("");
    assert_eq!(found.column("patch"), ["cap", "off skin", "off skin"]);
    assert!((found.number(1, "distance").abs() - 889.4).abs() < 0.1, "{}", found.text);
    assert_eq!(["face", "x", "link"].map(|name| found.cell(1, name)), [""; 3]);
    let notes = found.said;
    assert!(notes.contains("2 of 3 contacts are off the skin") && notes.contains("in metres"), "{notes}");
    for (options, asked) in [
        ("--unit m", ": are they in the frame of the world? (--frame, --max-distance)\n"),
        ("--frame link", ": are they in metres? (--unit, --max-distance)\n"),
        ("--frame world --max-distance 0.01", "by more than 0.01 m: are they in metres? (--unit)\n"),
        ("--unit m --frame link", "10 spacings of its taxels\n"),
    ] {
        let notes = run(options).said;
        assert!(notes.contains(asked), "{options:?}: {asked} in {notes}");
    }
    let found = run("--max-distance inf");
    assert_eq!((found.column("patch"), found.said.as_str()), (vec!["cap"; 3], ""));
    assert_eq!(run("--max-distance 0.001").column("patch"), ["off skin"; 3]);
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
        let contacts = table(mesh.positions.iter().step_by(9).map(off));
        let notes = fixture.answers(&contacts, "--level 0").said;
        assert_eq!(notes.contains("more than 3 spacings of taxels from the skin"), is_noted, "{notes}");
        assert_eq!(fixture.answers(&contacts, "--max-distance inf").said, "", "the limit is given");
    }
}

/// The limit holds for the centres of fields too.
#[test]
fn nearest_fields_are_within_the_largest_distance() {
    let fixture = Fixture::new();
    let contacts = "x,y,z\n118,0,0\n";
    for (most, patch) in [("0.001", "off skin"), ("200", "cap")] {
        let run = fixture.answers(contacts, &format!("--nearest 2 --max-distance {most}"));
        assert_eq!(run.cell(0, "patch"), patch);
    }
    fixture.refusal(contacts, "--within 1 --max-distance 1");
}

/// Positions of taxels in the frame of their link are found with `--frame link`, though the link
/// has no name.
#[test]
fn contacts_may_be_in_the_frame_of_the_only_link_with_skin() {
    let mut fixture = Fixture::new();
    fixture.map.links.iter_mut().for_each(|link| link.name.clear());
    fixture.write_map();
    let points = fixture.skin.patches[PatchId::new(0)].mesh.positions.iter().copied().step_by(7);
    let run = fixture.answers(&table(points.clone()), "--level 0 --frame link");
    for (row, p) in points.enumerate() {
        assert!(run.number(row, "distance").abs() < 1e-6, "{}", run.text);
        assert!(run.point(row).distance(p) < 1e-6);
        assert_eq!(["link", "frame"].map(|name| run.cell(row, name)), ["link1"; 2]);
    }
    assert_eq!(fixture.answers("x,y,z,link\n0,0,-0.1,link1\n", "").cell(0, "frame"), "link1");
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

#[test]
fn reactive_answers_say_how_far_the_skin_is() {
    let fixture = Fixture::new();
    let contacts = "x,y,z\n0.01,0,0.89\n0.02,0.01,0.9\n-0.03,0.01,0.91\n";
    let [exact, run] = ["--level 0", "--reactive"].map(|options| fixture.answers(contacts, options));
    let levels = fixture.map.patches[PatchId::new(0)].levels.len();
    for row in 0..run.rows.len() {
        let [level, least, most] = run.numbers(row, ["level", "least", "most"]);
        assert_eq!(level, (row % levels) as f64);
        let away = exact.number(row / levels, "distance").abs();
        assert!(least <= away + 1e-12 && away <= most + 1e-12, "row {row}: {least}, {away}, {most}");
        assert!(most - least < 1e-3 && run.number(row, "distance").abs() - least.midpoint(most) < 1e-12);
    }
}

/// Where a patch has no such level, its coarsest one answers, once.
#[test]
fn a_patch_without_a_level_answers_all_the_same() {
    let mut skin = Fixture::new().skin;
    let mut small = shapes::triangle();
    small.positions.iter_mut().for_each(|p| *p = *p * 0.01 + DVec3::X);
    skin.patches.push(Patch::from_mesh("small", LinkId::new(1), small));
    let fixture = Fixture::of(skin);
    assert_eq!(fixture.map.patches[PatchId::new(1)].levels.len(), 1);
    let contacts = "x,y,z,nx,ny,nz\n1.002,0.002,1,0,0,-1\n0,0,0.9,0,0,-1\n";
    for question in ["--max-distance 1", "--reactive", "--ray", "--nearest 1"] {
        for (levels, expected) in [
            ("--level 2", &["0 0 small", "1 2 cap"][..]),
            ("--level 1 --level 2", &["0 0 small", "1 1 cap", "1 2 cap"]),
        ] {
            let run = fixture.answers(contacts, &format!("{question} {levels}"));
            let found = |row| ["contact", "level", "patch"].map(|name| run.cell(row, name)).join(" ");
            let found: Vec<_> = (0..run.rows.len()).map(found).collect();
            assert_eq!(found, expected, "{question} {levels}: {}", run.said);
        }
    }
}

/// The finest level counts contacts that are off the skin, each once.
#[test]
fn reactive_answers_count_far_contacts_once() {
    let fixture = Fixture::new();
    for levels in ["--level 0", ""] {
        let options = format!("--reactive --max-distance 0.009 {levels}");
        let notes = fixture.answers("x,y,z\n0,0,0.9\n0,0,0.89\n0,0,0.89\n", &options).said;
        let expected = "2 of 3 contacts are off the skin, by more than 0.009 m";
        assert!(notes.contains(expected), "{levels:?}: {notes}");
    }
}

#[test]
fn taxels_are_counted_or_found_within_a_distance() {
    let fixture = Fixture::new();
    let contacts = "x,y,z,radius\n0,0,0.899,\n0.02,0,0.9,0.002\n0,0,5,\n";
    let nearest = fixture.answers(contacts, "--nearest 4 --level 0 --level 1");
    assert_eq!(nearest.rows.len(), 3 * 2 * 4);
    let distances: Vec<f64> = (0..4).map(|row| nearest.number(row, "distance")).collect();
    assert!(distances.is_sorted() && distances[0] < 0.005, "{distances:?}");
    let within = fixture.answers(contacts, "--within 0.008 --level 0");
    for row in (0..within.rows.len()).filter(|&row| within.cell(row, "patch") == "cap") {
        let limit = if within.cell(row, "contact") == "1" { 0.01 } else { 0.008 };
        assert!(within.number(row, "distance") <= limit, "row {row} of {}", within.text);
        assert_eq!(within.cell(row, "fields"), format!("{}:1.0", within.cell(row, "field")));
    }
    let last = within.rows.last().unwrap();
    assert_eq!([&last["contact"], &last["patch"]], ["2", "off skin"]);
    fixture.refusal(contacts, "--within -1");
    fixture.refusal(contacts, "--within 1 --nearest 2");
}

#[test]
fn rays_follow_the_normal() {
    let contacts = "x,y,z,nx,ny,nz\n0,0,0,0,0,2\n0,0,0,0,0,-1\n0,0,0,0,0,0\n";
    let run = Fixture::new().lookup(contacts, "--ray --level 0");
    assert!(run.code == 2 && run.said.contains("line 4, columns nx,ny,nz"), "{}", run.said);
    assert!(!run.said.contains("is not used"), "{}", run.said);
    assert!((run.number(0, "distance") - 0.9).abs() < 1e-6, "from the base up to the cap: {}", run.text);
    assert_eq!(run.cell(1, "patch"), "off skin", "down there is nothing");
}

/// The answers of a lookup are places on maps; the way back finds the points of level 0 again.
#[test]
fn from_map_finds_the_points_of_a_lookup() {
    let fixture = Fixture::new();
    let there = fixture.answers("x,y,z\n0.01,0,0.9\n0.02,0.01,0.9\n-0.03,0.01,0.91\n", "");
    for (frame, up) in [("world", 0.0), ("link", -1.0)] {
        let here = fixture.answers(&there.text, &format!("--from-map --frame {frame}"));
        assert_eq!(here.rows.len(), there.rows.len());
        for row in 0..here.rows.len() {
            assert!((there.number(row, "u") - here.number(row, "u")).abs() < 1e-9, "row {row}");
            let allowed = if there.cell(row, "level") == "0" { 1e-9 } else { 0.02 };
            let off = (there.point(row) + DVec3::Z * up).distance(here.point(row));
            assert!(off < allowed, "row {row} is {off} m off");
        }
    }
    let pixels = "px,py,level,patch\n60,60,1,cap\n5,100000,0,cap\n5,9,0,leg\n5,9,77,cap\n1.5,9,0,cap\n";
    let run = fixture.lookup(pixels, "--from-map");
    for part in [
        "4 of 5",
        "line 3, columns px,py",
        "line 4, column `patch`",
        "line 5, column `level`",
        "line 6, column `px`",
    ] {
        assert!(run.said.contains(part), "{part} in {}", run.said);
    }
    assert_eq!((run.code, run.numbers(0, ["px", "py"])), (2, [60.0; 2]));
    let off = fixture.answers("u,v\n5,0\n", "--from-map");
    assert!(off.number(0, "off_chart") > 4.5 && off.said.contains("1 place is off the map"), "{}", off.said);
    fixture.refusal("u,px\n5,0\n", "--from-map");
}

/// A table of answers is one of contacts, in the frame that it names, and of places on maps: what is off
/// the skin has none.
#[test]
fn answers_are_contacts_and_places() {
    let mut fixture = Fixture::new();
    let answers = fixture.answers("x,y,z,link\n0.01,0,0.9,\n0.01,0,-0.1,arm\n0,0,9,\n", "--level 0");
    assert_eq!(answers.column("patch"), ["cap", "cap", "off skin"]);

    let again = fixture.answers(&answers.text, "--level 0");
    assert!(again.said.contains("1 row is without an answer"), "{}", again.said);
    assert_eq!((again.column("frame"), again.column("link")), (vec!["world", "arm"], vec!["arm"; 2]));
    assert_eq!(again.column("face"), answers.column("face")[..2]);
    assert!((0..2).all(|row| again.number(row, "distance").abs() < 1e-12), "{}", again.text);

    let back = fixture.answers(&answers.text, "--from-map");
    assert!(back.said.contains("1 row is without an answer"), "{}", back.said);
    assert_eq!(back.rows.len(), 2);
    let pixels = "patch,level,px,py\noff skin,0,,\ncap,0,60,60\n";
    assert_eq!(fixture.answers(pixels, "--from-map").rows.len(), 1);

    let notes = fixture.refusal("contact,frame,x,y,z\n0,leg,0,0,0.9\n1,world,0,0,0.9\n", "");
    assert!(notes.contains("line 2, column `frame`: found \"leg\"; needed: `world`, or the name"), "{notes}");

    // A link of that name is not the world.
    fixture.map.links[LinkId::new(1)].name = "world".into();
    fixture.write_map();
    let notes = fixture.refusal(&answers.text, "");
    assert!(notes.contains("also the name of a link"), "{notes}");
}

/// Every question is asked back when most contacts are far.
#[test]
fn far_contacts_of_fields_are_noted() {
    let fixture = Fixture::new();
    for options in ["--nearest 2", "--within 100"] {
        let notes = fixture.answers("x,y,z\n10,20,3\n", options).said;
        assert!(notes.contains("are they in metres"), "{options:?}: {notes}");
    }
}

/// Fields of no face have no cell; the contacts that they are near to are on the skin all the same.
#[test]
fn fields_without_a_face_are_counted() {
    let mut mesh = shapes::lattice(6, 5, 0.005);
    mesh.positions.push(DVec3::new(0.01, 0.01, 0.001));
    let fixture = Fixture::flat(mesh);
    for (options, count) in [("--nearest 1", 0), ("--nearest 2", 1), ("--within 0.0012", 0)] {
        let run = fixture.answers("x,y,z\n0.01,0.01,0.002\n", options);
        assert_eq!(run.rows.len(), count, "{options:?}: {}", run.text);
        assert!(run.said.contains("1 answer is without a row"), "{options:?}: {}", run.said);
        assert!(!run.said.contains("off the skin"), "{options:?}: {}", run.said);
    }
}

/// Only options that change it are named where contacts are off the skin.
#[test]
fn advice_names_only_options_that_help() {
    let fixture = Fixture::new();
    let contacts = "x,y,z,nx,ny,nz\n0,0,9,0,0,1\n";
    for (options, is_asked) in [("", true), ("--ray", false), ("--within 0.001", false)] {
        let notes = fixture.answers(contacts, options).said;
        assert!(notes.contains("(--unit, --frame"), "{notes}");
        assert_eq!(notes.contains("--max-distance"), is_asked, "{options:?}: {notes}");
    }
    fixture.file("p.csv", "link,x,y,z,qx,qy,qz,qw\narm,0,0,1000,0,0,0,1\n");
    let notes = fixture.answers(contacts, "--pose p.csv").said;
    assert!(notes.contains("p.csv in metres?"), "{notes}");
    let notes = fixture.refusal(contacts, "--animation wave");
    assert!(notes.contains("help: give a file with an animation"), "{notes}");
}

/// The arm goes up by 1 m/s from 1 s to 3 s, by a table or by an animation of a glTF file; contacts
/// and places on the map are matched by their time.
#[test]
fn contacts_are_matched_with_poses_by_their_time() {
    let fixture = Fixture::new();
    let poses = "time,link,x,y,z,qx,qy,qz,qw\n1,arm,0,0,1,0,0,0,1\n3,arm,0,0,3,0,0,0,1\n";
    fixture.file("poses.csv", poses);
    let floats = [1.0_f32, 3.0, 0.0, 0.0, 1.0, 0.0, 0.0, 3.0].map(f32::to_le_bytes);
    fs::write(fixture.path("moves.bin"), floats.concat()).unwrap();
    let gltf = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"name":"base","children":[1]},
        {"name":"arm"}],"buffers":[{"uri":"moves.bin","byteLength":32}],"bufferViews":[{"buffer":0,"byteLength":8},
        {"buffer":0,"byteOffset":8,"byteLength":24}],"accessors":[{"bufferView":0,"componentType":5126,"count":2,
        "type":"SCALAR","min":[1],"max":[3]},{"bufferView":1,"componentType":5126,"count":2,"type":"VEC3"}],
        "animations":[{"name":"up","channels":[{"sampler":0,"target":{"node":1,"path":"translation"}}],
        "samplers":[{"input":0,"output":1,"interpolation":"LINEAR"}]}]}"#;
    fixture.file("moves.gltf", gltf);
    let contacts = "time,x,y,z\n1,0,0,0.89\n1.5,0,0,1.39\n2,0,0,1.89\n7,0,0,2.89\n,0,0,0.89\n";
    for pose in ["poses.csv", "moves.gltf --animation up"] {
        let run = fixture.answers(contacts, &format!("--level 0 --pose {pose}"));
        assert!(run.said.contains("2 contacts are without a time or outside"), "{pose:?}: {}", run.said);
        assert!(!run.said.contains("is not used"), "{}", run.said);
        assert_eq!(run.rows.len(), 5, "{}", run.text);
        for row in 0..5 {
            assert!((run.number(row, "distance") - 0.01).abs() < 1e-6, "{pose:?}: row {row}");
        }
    }
    let places = "time,u,v\n1,0,0\n1.5,0,0\n2,0,0\n7,0,0\n,0,0\n";
    let run = fixture.answers(places, "--from-map --pose poses.csv");
    assert!(run.said.contains("2 places are without a time or outside"), "{}", run.said);
    for (row, up) in [0.0, 0.5, 1.0, 2.0, 0.0].into_iter().enumerate() {
        assert!((run.number(row, "z") - run.number(0, "z") - up).abs() < 1e-9, "{}", run.text);
    }
    let back = fixture.answers(places, "--from-map");
    assert!(!back.said.contains("column `time` is not used"), "{}", back.said);
    let times = |run: &Run| (0..5).map(|row| run.cell(row, "time").to_owned()).collect::<Vec<_>>();
    assert_eq!(times(&back), ["1.0", "1.5", "2.0", "7.0", ""]);
    // Answers are contacts again, at their times.
    let posed = "--level 0 --pose poses.csv";
    let first = fixture.answers(contacts, posed);
    let again = fixture.answers(&first.text, posed);
    assert_eq!(times(&again), ["1.0", "1.5", "2.0", "7.0", ""]);
    assert!((0..5).all(|row| again.number(row, "distance").abs() < 1e-9), "{}", again.text);
    for (options, expected) in [
        ("--animation up", "animations"),
        ("--pose poses.csv --animation up", "no animation"),
        ("--pose moves.gltf --animation down", "\"up\""),
    ] {
        let error = fixture.refusal(contacts, options);
        assert!(error.contains(expected), "{options:?}: {error}");
    }
    for (from, to) in [
        ("LINEAR", "CUBICSPLINE"),
        ("\"translation\"", "\"scale\""),
        ("\"input\":0", "\"input\":9"),
        ("\"output\":1", "\"output\":0"),
    ] {
        fixture.file("bad.gltf", &gltf.replace(from, to));
        fixture.refusal(contacts, "--pose bad.gltf");
    }
    fixture.file("other.gltf", &gltf.replace("\"arm\"", "\"leg\""));
    let notes = fixture.answers(contacts, "--pose other.gltf").said;
    assert!(notes.contains("other.gltf: the map has no link for the animated `leg`\n"), "{notes}");
    assert!(notes.contains("other.gltf: the animation moves no link of the map\n"), "{notes}");
}

/// An animation of the skin is in its map too: written, read, listed and looked up.
#[test]
fn animations_are_kept_in_skins_and_maps() {
    let mut skin = Fixture::new().skin;
    let arm = LinkId::new(1);
    let up = |z: f64| DAffine3::from_translation(DVec3::Z * z);
    let turned = up(2.0) * DAffine3::from_rotation_z(0.5);
    let mut motion = Motion::default();
    motion.name = "up".into();
    // At 2 s it jumps.
    let keys = [(1.0, up(1.0)), (2.0, up(2.0)), (2.0, turned), (3.0, up(3.0))];
    motion.set(arm, MotionFrame::Parent, &keys).unwrap();
    skin.animations.push(motion);
    let fixture = Fixture::of(skin);
    let glb = fixture.path("skin.glb");
    write_skin(&glb, &fixture.skin).unwrap();
    let draft = read_draft(&glb).unwrap();
    let mut skin = assemble(&draft, &AssembleOptions::default()).unwrap().skin;
    let mut index = ContactIndex::new(&fixture.map).unwrap();
    for read in [&draft.animations, &skin.animations, &fixture.map.animations] {
        assert_eq!((read.len(), read[0].name.as_str()), (1, "up"));
        assert_eq!(read[0].times(), Some([1.0, 3.0]));
        for (time, expected) in [(0.0, up(1.0)), (1.75, up(1.75)), (2.0, turned), (9.0, up(3.0))] {
            index.set_motion(&read[0], time).unwrap();
            assert!(index.poses()[arm].abs_diff_eq(expected, 1e-5), "at {time} s");
        }
    }
    let contacts = "time,x,y,z\n1.5,0,0,1.39\n3,0,0,2.89\n";
    let are_found = |fixture: &Fixture, options: &str| {
        let run = fixture.answers(contacts, &format!("--level 0 --animation up {options}"));
        let error = if options == "--reactive" { 5e-4 } else { 1e-5 };
        assert!((0..2).all(|row| (run.number(row, "distance") - 0.01).abs() < error), "{}", run.text);
    };
    are_found(&fixture, "");
    are_found(&fixture, "--reactive");
    let info = common::dermatome(&fixture.folder, "info map.glb").output().unwrap();
    let text = String::from_utf8(info.stdout).unwrap();
    assert!(text.contains("animation up: 1 to 3 s"), "{text}");
    let mut in_world = Motion::default();
    in_world.set(arm, MotionFrame::World, &keys).unwrap();
    let unwritable = Skin { animations: vec![in_world], ..skin.clone() };
    assert!(write_skin(&glb, &unwritable).is_err(), "glTF has poses relative to the link above");
    // The map's own animation means its own links, whatever their names.
    skin.links[arm].name = "base".into();
    let fixture = Fixture::of(skin);
    are_found(&fixture, "");
    fixture.file("p.csv", "link,x,y,z,qx,qy,qz,qw\nbase,0,0,0.5,0,0,0,1\n");
    let error = fixture.refusal(contacts, "--pose p.csv");
    assert!(error.contains("2 links of the map have it"), "{error}");
}
