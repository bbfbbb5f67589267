//! Faces, links and taxels that are chosen: a part of a skin is as it is in the whole, whatever the file says of its outside.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use crate::common::{dermatome, json, notes, refuses};
use dermatome::io::{read_draft, read_map, write_skin};
use dermatome::mesh::shapes;
use dermatome::skin::{Link, LinkId, Patch, Skin};
use glam::{DAffine3, DQuat, DVec3};
use predicates::{prelude::PredicateBooleanExt, str::contains};

/// How the faces and normals of a ball are written.
#[derive(Clone, Copy, PartialEq)]
enum Normals {
    None,
    Outward,
    /// The same for all, as programs write that have none.
    Constant,
}

/// A ball of 50 mm radius around the origin, in m.
fn write_ball(path: &Path, normals: Normals, is_turned: impl Fn(usize) -> bool) {
    let ball = shapes::ball(8, 0.05);
    let mut text = String::new();
    for p in &ball.positions {
        writeln!(text, "v {} {} {}", p.x, p.y, p.z).unwrap();
        let n = if normals == Normals::Constant { DVec3::Z } else { p.normalize() };
        writeln!(text, "vn {} {} {}", n.x, n.y, n.z).unwrap();
    }
    for (face, t) in ball.triangles.iter().enumerate() {
        let mut t = t.map(|v| v.raw() + 1);
        if is_turned(face) {
            t.swap(1, 2);
        }
        let corner = |v: u32| if normals == Normals::None { format!(" {v}") } else { format!(" {v}//{v}") };
        writeln!(text, "f{}", t.map(corner).concat()).unwrap();
    }
    fs::write(path, text).unwrap();
}

/// The centres of the faces that are left, sorted; each face and each normal must point away from the origin.
fn outward(folder: &Path, words: &str) -> Vec<[i64; 3]> {
    dermatome(folder, &format!("convert {words} o.obj")).assert().success();
    let mut centres = Vec::new();
    for sheet in read_draft(&folder.join("o.obj")).unwrap().sheets {
        for (p, n) in sheet.positions.iter().zip(sheet.normals.as_ref().unwrap()) {
            assert!(p.dot(*n) > 0.0, "{words}: the normal at {p} is {n}");
        }
        for t in &sheet.triangles {
            let [a, b, c] = t.map(|v| sheet.positions[v as usize]);
            let centre = (a + b + c) / 3.0;
            assert!((b - a).cross(c - a).dot(centre) > 0.0, "{words}: the face at {centre} is inside out");
            #[expect(clippy::cast_possible_truncation, reason = "some thousandths of a micrometre")]
            centres.push((centre * 1e9).round().to_array().map(|x| x as i64));
        }
    }
    centres.sort_unstable();
    centres
}

/// Faces of a ball are chosen by its outside, however they are wound, and stay wound as in the whole ball.
#[test]
fn what_is_chosen_has_the_outside_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_ball(&folder.join("good.obj"), Normals::None, |_| false);
    write_ball(&folder.join("inside_out.obj"), Normals::None, |_| true);
    write_ball(&folder.join("turned.obj"), Normals::Outward, |_| true);
    write_ball(&folder.join("mixed.obj"), Normals::Outward, |face| face % 3 == 0);
    write_ball(&folder.join("mixed_bare.obj"), Normals::None, |face| face % 3 == 0);
    write_ball(&folder.join("constant.obj"), Normals::Constant, |_| false);
    // Each face is there once outward, and once more as a back face before or after it.
    let text = fs::read_to_string(folder.join("inside_out.obj")).unwrap();
    let backs: String =
        text.lines().filter(|line| line.starts_with('f')).map(|line| format!("{line}\n")).collect();
    let good = fs::read_to_string(folder.join("good.obj")).unwrap();
    fs::write(folder.join("double.obj"), good + &backs).unwrap();
    dermatome(folder, "convert inside_out.obj inside_out.stl").assert().success();
    let chosen = ["--box -1,-1,0.02,1,1,1", "--facing z", "--facing -z,10", "--facing 1,1,0,30deg"];
    for words in chosen {
        let expected = outward(folder, &format!("good.obj {words}"));
        assert!(!expected.is_empty());
        for file in [
            "inside_out.obj",
            "turned.obj",
            "mixed.obj",
            "mixed_bare.obj",
            "constant.obj",
            "double.obj --repair",
        ] {
            assert_eq!(outward(folder, &format!("{file} {words}")), expected, "{file} {words}");
        }
    }
    for file in ["inside_out.obj", "turned.obj", "mixed.obj", "constant.obj"] {
        let words = format!("{file} --spacing 8mm --box -1,-1,-0.02,1,1,1");
        assert!(outward(folder, &words).len() > 100);
    }
    notes(
        folder,
        "convert inside_out.obj o.obj --box -1,-1,0.02,1,1,1",
        &["wound against the closed surface"],
    );
    // The half that is not hidden by a plate across the middle.
    let plate = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\n";
    let count = text.lines().filter(|line| line.starts_with("v ")).count();
    let cup = format!(
        "{text}{plate}f {} {} {}\nf {} {} {}\n",
        count + 1,
        count + 2,
        count + 3,
        count + 1,
        count + 3,
        count + 4
    );
    fs::write(folder.join("cup.obj"), cup).unwrap();
    assert!(!outward(folder, "cup.obj --repair --outer --box -0.1,-0.1,0.001,0.1,0.1,1").is_empty());
}

/// An inner wall is hidden by the whole outer one, also where that is not chosen.
#[test]
fn the_outside_is_found_before_faces_are_chosen() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let ball = shapes::ball(8, 0.05);
    let (mut text, count) = (String::new(), ball.positions.len());
    for (factor, name) in [(1.0, "skin"), (0.9, "lining")] {
        for p in &ball.positions {
            writeln!(text, "v {} {} {}", factor * p.x, factor * p.y, factor * p.z).unwrap();
        }
        writeln!(text, "usemtl {name}").unwrap();
        for &[a, b, c] in &ball.triangles {
            let corners = if name == "skin" { [a, b, c] } else { [a, c, b] };
            let first = if name == "skin" { 1 } else { 1 + count };
            let [a, b, c] = corners.map(|v| v.raw() as usize + first);
            writeln!(text, "f {a} {b} {c}").unwrap();
        }
    }
    fs::write(folder.join("shell.obj"), text).unwrap();
    for words in
        ["--box -1,-1,0.02,1,1,1", "--facing z", "--material skin", "--spacing 9mm --box -1,-1,0,1,1,1"]
    {
        let run = dermatome(folder, &format!("convert shell.obj o.obj --outer {words}")).assert().success();
        // The inner wall is wound as one, and nobody sees it.
        run.stderr(contains("turned over").not());
        let sheets = read_draft(&folder.join("o.obj")).unwrap().sheets;
        let least = sheets.iter().flat_map(|sheet| &sheet.positions).map(|p| p.length()).fold(1.0, f64::min);
        assert!(least > 0.047, "{words}: {least} m");
    }
    refuses(folder, "convert shell.obj o.obj --outer --material lining", &["no face is left"]);
}

/// Two hands of one name.
fn hands() -> Skin {
    let mut skin = Skin::from_mesh("left", shapes::lattice(6, 6, 0.005));
    skin.links[LinkId::new(0)].name = "hand".into();
    let pose = DAffine3::from_translation(DVec3::X);
    let other = skin.links.push(Link { name: "hand".into(), parent: None, pose });
    let mut right = Patch::from_mesh("right", other, shapes::lattice(6, 6, 0.005));
    right.taxels.ids.iter_mut().for_each(|id| id.0 += 100);
    skin.patches.push(right);
    skin
}

#[test]
fn a_name_of_several_links_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_skin(&folder.join("hands.glb"), &hands()).unwrap();
    let several = ["the name of 2 links", "one link alone"];
    for words in ["--box hand:-1,-1,-1,1,1,1", "--facing hand:z"] {
        refuses(folder, &format!("convert hands.glb o.obj {words}"), &several);
    }
    refuses(folder, "convert hands.glb o.obj --facing foot:z", &["no link", "foot"]);
    refuses(folder, "build hands.glb -o m --regions link", &several);
    dermatome(folder, "build hands.glb -o m").assert().success();
    fs::write(folder.join("words.csv"), "link,x,y,z,word\nhand,0,0,1,palmar\n").unwrap();
    let map = read_map(&folder.join("m/map.glb")).unwrap();
    let refused = dermatome::io::read_body_words(&folder.join("words.csv"), &map).unwrap_err();
    assert!(refused.to_string().contains("a name of one link: 2 links"), "{refused}");
}

/// A good sheet of taxels 1 to 36 and one whose faces lie three at an edge, taxels 101 to 105.
fn write_half_good(folder: &Path) {
    let (mut rows, mut faces) = ("id,x,y,z,patch\n".to_owned(), "row0,row1,row2\n".to_owned());
    for k in 0..36 {
        writeln!(rows, "{},{},{},0,good", k + 1, 0.005 * f64::from(k % 6), 0.005 * f64::from(k / 6)).unwrap();
    }
    for a in (0..30).filter(|a| a % 6 < 5) {
        writeln!(faces, "{a},{},{}\n{a},{},{}", a + 1, a + 7, a + 7, a + 6).unwrap();
    }
    for (k, [x, y, z]) in [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]].into_iter().enumerate() {
        let [x, y, z] = [x, y, z].map(|x| 0.005 * f64::from(x));
        writeln!(rows, "{},{},{y},{z},bad", 101 + k, 0.1 + x).unwrap();
    }
    faces += "36,37,38\n36,37,39\n36,37,40\n";
    fs::write(folder.join("s.csv"), rows).unwrap();
    fs::write(folder.join("s.triangles.csv"), faces).unwrap();
}

/// Tables about all taxels of a file are tables about some of them.
#[test]
fn tables_may_name_taxels_that_are_not_in_the_skin() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_half_good(folder);
    fs::write(folder.join("regions.csv"), "taxel_id,region\n1,tip\n2,tip\n103,tip\n").unwrap();
    fs::write(folder.join("acuity.csv"), "taxel_id,factor\n1,2\n101,3\n103,3\n").unwrap();
    fs::write(folder.join("cut.csv"), "from,to\n101,102\n").unwrap();
    dermatome(folder, "build s.csv -o m --patch good --acuity acuity.csv").assert().success();
    let frame = read_map(&folder.join("m/map.glb")).unwrap().patches[0.into()].levels[0.into()].frame;
    let (low, high) = (frame.origin, frame.origin + frame.size);
    let corners = format!("[[{}, {}], [{}, {}], [{}, {}]]", low.x, low.y, high.x, low.y, low.x, high.y);
    let polygon = |patch: &str| format!(r#"{{"patch": "{patch}", "region": "half", "uv": {corners}}}"#);
    fs::write(folder.join("polygons.json"), format!("[{}, {}]", polygon("good"), polygon("bad"))).unwrap();
    let tables = "--regions regions.csv --regions polygons.json --acuity acuity.csv --cut cut.csv";
    for (words, code) in [("--keep-going", 1), ("--patch good", 0)] {
        let run = dermatome(folder, &format!("build s.csv -o m {words} {tables}")).assert().code(code);
        let said = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
        for (table, rows) in [
            ("regions.csv", "1 row "),
            ("polygons.json", "1 row "),
            ("acuity.csv", "2 rows "),
            ("cut.csv", "1 row "),
        ] {
            let note = format!("{table}: {rows}of taxels or patches that the file has and the skin has not");
            assert!(said.contains(&note), "{words}: {note:?} is missing in {said}");
        }
        let map = read_map(&folder.join("m/map.glb")).unwrap();
        let names: Vec<String> = map.regions().names.iter().map(ToString::to_string).collect();
        assert!(names.contains(&"tip".to_owned()) && names.contains(&"half".to_owned()), "{names:?}");
    }
    for words in ["coarsen s.csv -o c.glb", "flatten s.csv -o f.obj"] {
        notes(folder, &format!("{words} --patch good --acuity acuity.csv"), &["acuity.csv: 2 rows "]);
    }
    // What no part of the file has is refused before the map is built.
    for (file, text, needed) in [
        ("bad.csv", "taxel_id,region\n1,tip\n500,tip\n", "the id of a taxel of the skin"),
        ("bad.json", r#"[{"patch": "foot", "region": "x", "uv": [[0, 0], [1, 0], [0, 1]]}]"#, "one of good"),
    ] {
        fs::write(folder.join(file), text).unwrap();
        let words = format!("build s.csv -o n --patch good --regions {file} --max-area-ratio 1.0001");
        refuses(folder, &words, &[file, needed]);
        assert!(!folder.join("n/map.glb").exists());
    }
}

/// A map in another unit has gaps of another width.
#[test]
fn widths_of_gaps_have_the_unit_of_the_map() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut skin = Skin::from_mesh("left", shapes::lattice(6, 6, 0.005));
    let mut right = Patch::from_mesh("right", LinkId::new(0), shapes::lattice(6, 6, 0.005));
    right.mesh.positions.iter_mut().for_each(|x| x.x += 0.035);
    right.taxels.ids.iter_mut().for_each(|id| id.0 += 100);
    skin.patches.push(right);
    write_skin(&folder.join("two.glb"), &skin).unwrap();
    dermatome(folder, "build two.glb -o m").assert().success();
    for command in ["info", "check"] {
        let widths = |unit: &str| {
            let run =
                dermatome(folder, &format!("{command} m/map.glb --json --unit {unit}")).output().unwrap();
            let gaps = json(&run.stdout)["gaps"].clone();
            [0, 1].map(|k| gaps[0]["width_mm"][k].as_f64().unwrap())
        };
        let [metres, inches] = ["m", "in"].map(widths);
        for (a, b) in metres.into_iter().zip(inches) {
            assert!((b / a - 0.0254).abs() < 1e-9, "{command}: {a} and {b}");
        }
    }
}

/// What closes pin-holes in a map is no skin in any file that is made of it.
#[test]
fn a_map_is_a_skin_with_its_pin_holes() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut mesh = shapes::lattice(8, 8, 0.005);
    let whole = mesh.triangles.len();
    mesh.triangles =
        mesh.triangles.iter().copied().enumerate().filter(|(k, _)| *k != 50).map(|(_, t)| t).collect();
    write_skin(&folder.join("holed.glb"), &Skin::from_mesh("s", mesh)).unwrap();
    dermatome(folder, "build holed.glb -o m").assert().success();
    for kind in ["csv", "glb", "obj"] {
        dermatome(folder, &format!("convert m/map.glb back.{kind}")).assert().success();
        let back = read_draft(&folder.join(format!("back.{kind}"))).unwrap();
        assert_eq!(back.sheets[0].triangles.len(), whole - 1, "{kind}");
    }
    dermatome(folder, "build m/map.glb -o again").assert().success();
    let filled = |file: &str| read_map(&folder.join(file)).unwrap().patches[0.into()].filled;
    assert_eq!((filled("m/map.glb"), filled("again/map.glb")), (1, 1));
}

/// A patch called `body` next to levels of the whole body has levels of another name, which `info` prints.
#[test]
fn names_that_info_prints_are_names_of_levels() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut table = "id,x,y,z,patch,modality\n".to_owned();
    for (patch, first, right) in [("body", 1, 0.0), ("fore", 501, 0.065)] {
        for k in 0..144_u32 {
            let (column, row) = (k % 12, k / 12);
            let senses = if column % 4 == 1 && row % 4 == 1 { "thermal" } else { "" };
            let [x, y] = [right + f64::from(column) * 0.005, f64::from(row) * 0.005];
            writeln!(table, "{},{x},{y},0,{patch},{senses}", first + k).unwrap();
        }
    }
    fs::write(folder.join("s.csv"), table).unwrap();
    fs::write(folder.join("p.csv"), "x,y,z\n0.0251,0.0249,0\n").unwrap();
    dermatome(folder, "build s.csv -o m -q").assert().success();
    let told = dermatome(folder, "info m/map.glb").assert().success();
    let told = String::from_utf8_lossy(&told.get_output().stdout).into_owned();
    for name in ["%62ody.thermal: sensors 9", "fore.thermal: sensors 9", "body.thermal: sensors 18"] {
        assert!(told.lines().any(|line| line.starts_with(name)), "{name:?} is missing in {told}");
    }
    let info = json(&dermatome(folder, "info m/map.glb --json").output().unwrap().stdout);
    for modality in info["modalities"].as_array().unwrap() {
        let (levels, fields) =
            (modality["levels"].as_array().unwrap(), modality["fields"].as_array().unwrap());
        assert!(levels.len() == fields.len() && !levels.is_empty(), "{modality}");
        for level in levels {
            let words = format!("lookup m/map.glb p.csv -o l.csv --level {} -q", level.as_str().unwrap());
            dermatome(folder, &words).assert().success();
        }
    }
    let bare = json(&dermatome(folder, "info s.csv --json").output().unwrap().stdout);
    assert_eq!(bare["modalities"][0]["levels"], serde_json::json!([]));
}

/// A pose of a robot is one value for each joint.
#[test]
fn joints_of_info_are_one_pose() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("meshes/arm.urdf"), folder.join("arm.urdf")).unwrap();
    let info = |joints: &str| format!("info arm.urdf --json --joints {joints}");
    refuses(folder, &info("elbow=0.1,elbow=1.2"), &["each joint once", "elbow"]);
    for (text, said) in
        [("time,elbow\n0,0.1\n1,1.2\n", "2 rows"), ("time,elbow\n0,0.1\n", "a column of times")]
    {
        fs::write(folder.join("q.csv"), text).unwrap();
        refuses(folder, &info("q.csv"), &[said, "one row without a time"]);
    }
    fs::write(folder.join("q.csv"), "elbow\n0.7\n").unwrap();
    let [a, b] = ["q.csv", "elbow=0.7"].map(|joints| {
        let run = dermatome(folder, &info(joints)).assert().success();
        json(&run.get_output().stdout)["links"].clone()
    });
    assert_eq!(a, b);
}

/// Areas that change on purpose are no reason for a note.
#[test]
fn magnification_is_no_fault_of_a_map() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_skin(&folder.join("s.csv"), &Skin::from_mesh("s", shapes::lattice(12, 12, 0.005))).unwrap();
    let rows: Vec<String> = (1..=40).map(|id| format!("{id},4\n")).collect();
    fs::write(folder.join("acuity.csv"), format!("taxel_id,factor\n{}", rows.concat())).unwrap();
    for words in ["build s.csv -o m", "flatten s.csv -o f.obj"] {
        let run = dermatome(folder, &format!("{words} --acuity acuity.csv --max-area-ratio 1.5"))
            .assert()
            .success();
        run.stderr(contains("area ratio").not().and(contains("poor").not()));
    }
    let turn = DQuat::from_rotation_z(0.3);
    let mut ball = shapes::ball(6, 0.05);
    ball.positions.iter_mut().for_each(|p| *p = turn * *p);
    write_skin(&folder.join("ball.csv"), &Skin::from_mesh("ball", ball)).unwrap();
    let words = "build ball.csv -o b --acuity acuity.csv --max-area-ratio 1.0001";
    notes(folder, words, &["largest area ratio of the map without acuities and magnification is"]);
}
