//! What `build` promises of surfaces that no map fits as they are: pin-holes, area ratios, long tubes,
//! seams from a table, surfaces with one side.

use std::{f64::consts::PI, fs, path::Path};

use crate::common::{dermatome, notes, refuses};
use dermatome::id::FaceId;
use dermatome::io::{read_map, write_skin};
use dermatome::mesh::{TriMesh, shapes};
use dermatome::skin::{PatchId, Skin};
use glam::DVec3;
use predicates::{prelude::PredicateBooleanExt, str::contains};
use serde_json::Value;

fn write(folder: &Path, name: &str, mesh: TriMesh) {
    write_skin(&folder.join(name), &Skin::from_mesh("s", mesh)).unwrap();
}

/// The levels of the first patch in the report of `build` with these words, and its notes.
fn levels(folder: &Path, words: &str) -> (Vec<Value>, String) {
    let made = dermatome(folder, &format!("build {words} --json")).assert().success();
    let output = made.get_output();
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let levels = report["patches"][0]["levels"].as_array().unwrap().clone();
    (levels, String::from_utf8(output.stderr.clone()).unwrap())
}

/// A lattice without two triangles here and there, so with holes of four edges.
fn sieve() -> TriMesh {
    let mut mesh = shapes::lattice(40, 40, 0.005);
    let rows = 2 * 39;
    let is_hole = |face: usize| {
        let (row, k) = (face / rows, face % rows);
        row % 5 == 2 && k % 10 / 2 == 2
    };
    mesh.triangles =
        mesh.triangles.enumerate().filter(|(f, _)| !is_hole(f.index())).map(|(_, t)| *t).collect();
    mesh
}

/// Pin-holes keep three vertices each on every level, so they stall a pyramid: by default they are
/// closed, and the map file marks the triangles that do it. No taxel is added.
#[test]
fn pin_holes_are_closed_and_marked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let mesh = sieve();
    let faces = mesh.triangles.len();
    write(path, "sieve.csv", mesh);
    let (open, _) = levels(path, "sieve.csv -o open --fill-holes 0");
    let (closed, notes) = levels(path, "sieve.csv -o closed");
    assert!(notes.contains("holes"), "{notes}");
    let number = |level: &Value, what: &str| level[what].as_u64().unwrap();
    let holes = number(&open[0], "boundary_loops") - 1;
    assert!(holes > 20, "{holes}");
    assert_eq!(number(&closed[0], "boundary_loops"), 1);
    assert_eq!(number(&closed[0], "vertices"), number(&open[0], "vertices"), "no taxel is added");
    let last = |levels: &[Value]| number(&levels[levels.len() - 1], "vertices");
    assert!(last(&open) > 3 * holes && last(&closed) < 60, "{} and {} fields", last(&open), last(&closed));
    let filled = |name: &str| read_map(&path.join(name)).unwrap().patches[PatchId::new(0)].filled;
    assert_eq!(filled("open/map.glb"), 0);
    assert_eq!(filled("closed/map.glb"), 2 * usize::try_from(holes).unwrap());
    let map = read_map(&path.join("closed/map.glb")).unwrap();
    let finest = &map.patches[PatchId::new(0)].levels.iter().next().unwrap().level.mesh;
    assert_eq!(finest.triangles.len(), faces + filled("closed/map.glb"));
    assert!(
        finest.triangles.ids().all(|f| finest.face_cross(f).length() > 0.0)
            && finest.triangles.get(FaceId::new(faces)).is_some()
    );
}

/// A closed body with one triangle missing is hardly a disk: its pin-hole is closed too, and the body cut.
#[test]
fn a_body_with_a_pin_hole_is_closed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let mut ball = shapes::ball(12, 0.05);
    ball.triangles = ball.triangles.iter().skip(1).copied().collect();
    write(path, "ball.csv", ball);
    let (open, _) = levels(path, "ball.csv -o M --fill-holes 0 --cut none");
    let (closed, _) = levels(path, "ball.csv -o M");
    assert_eq!((&open[0]["seam"] == 0.0, closed[0]["seam"].as_f64() > Some(0.05)), (true, true));
    let energy = |levels: &[Value]| levels[0]["symmetric_dirichlet"].as_f64().unwrap();
    assert!(energy(&open) > 2.0 * energy(&closed), "{} and {}", energy(&open), energy(&closed));
    // A disk of few edges stays one.
    for (name, mesh) in [("square.csv", shapes::square()), ("fan.csv", shapes::fan(5))] {
        write(path, name, mesh);
        assert_eq!(levels(path, &format!("{name} -o M")).0[0]["seam"], 0.0, "{name}");
    }
}

/// A cap of more than a hemisphere cannot be flat without a cut: slits go in until every triangle
/// keeps the ratio, and a note says what is reached where none keeps it.
#[test]
fn an_area_ratio_is_kept_by_slits_or_a_note_says_what_is_reached() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write(path, "cap.csv", shapes::cap(600, 0.05, 2.0));
    let ratio = |levels: &[Value]| levels[0]["area_max"].as_f64().unwrap();
    let mut seam = 0.0;
    for (wanted, is_kept) in [(1.3, true), (1.2, true), (1.04, false)] {
        let (cut, notes) = levels(path, &format!("cap.csv -o M --max-area-ratio {wanted}"));
        assert_eq!(ratio(&cut) <= wanted, is_kept, "{} for {wanted}", ratio(&cut));
        assert!(cut[0]["seam"].as_f64().unwrap() > seam, "{wanted}");
        seam = cut[0]["seam"].as_f64().unwrap();
        let reached = format!("the largest area ratio of the map is {:.4}", ratio(&cut));
        assert_eq!(notes.contains(&reached), !is_kept, "{notes}");
        assert!(cut.iter().all(|level| level["flips"] == 0), "{cut:?}");
    }
    let with =
        |words: &str| dermatome(path, &format!("flatten cap.csv -o f.obj --max-area-ratio {words}")).assert();
    with("1.2").success();
    with("1.2 --cut none").code(2).stderr(contains("changes nothing"));
    for bad in ["1", "0.5", "NaN", "-2", "x"] {
        with(bad).code(2).stderr(contains("a number above 1"));
    }
}

/// A tube of forty radii, closed at one end, whose coarse levels have no map in 64 bits: they are left
/// out, with a note, and the build goes on.
#[test]
fn levels_without_a_map_are_left_out_with_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let (around, along, radius) = (24_u32, 40_u32, 0.01);
    let tube = shapes::tube(around, along, radius, 40.0 * radius);
    let mut mesh = tube.clone();
    let height = tube.positions.iter().map(|p| p.z).fold(f64::MIN, f64::max);
    let tip = mesh.positions.push(DVec3::new(0.0, 0.0, height + radius));
    let rim: Vec<_> = tube.positions.ids().filter(|&v| tube.positions[v].z > height - 1e-9).collect();
    let angle = |v| f64::atan2(tube.positions[v].y, tube.positions[v].x);
    let mut rim = rim;
    rim.sort_by(|&a, &b| angle(a).total_cmp(&angle(b)));
    for (k, &a) in rim.iter().enumerate() {
        mesh.triangles.push([a, rim[(k + 1) % rim.len()], tip]);
    }
    write(path, "finger.csv", mesh);
    let (levels, notes) = levels(path, "finger.csv -o M --cut none");
    assert!(notes.contains("s: left out the coarsest levels"), "{notes}");
    assert!(levels.iter().all(|level| level["flips"] == 0), "{levels:?}");
    dermatome(path, "info M/map.glb").assert().success();
}

/// Every bad row of a table of seams is refused with what is wrong.
#[test]
fn bad_seams_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write(path, "sheet.csv", shapes::lattice(9, 9, 0.01));
    // Taxels count from 1, nine a row; this closed walk cuts a piece out.
    let around = "31,32\n32,41\n41,40\n40,31";
    for (rows, what) in [
        ("40,9999", "9999"),
        ("40,60", "no edge joins them"),
        ("1,2", "on the boundary already"),
        (around, "pieces"),
        ("40,40", "another taxel than `from`"),
        ("a,40", "the number of a taxel"),
        ("-1,40", "the number of a taxel"),
    ] {
        fs::write(path.join("cut.csv"), format!("from,to\n{rows}\n")).unwrap();
        for words in ["build sheet.csv -o M", "flatten sheet.csv -o f.obj"] {
            refuses(path, &format!("{words} --cut cut.csv"), &[what]);
        }
    }
    fs::write(path.join("cut.csv"), "a,b\n1,2\n").unwrap();
    refuses(path, "build sheet.csv -o M --cut cut.csv", &["a column `from`"]);
    refuses(path, "build sheet.csv -o M --cut none.csv", &["none.csv"]);
    fs::write(path.join("cut.csv"), "from,to,why\n5,14,\n14,23,x\n").unwrap();
    let (slit, noted) = levels(path, "sheet.csv -o M --cut cut.csv");
    assert!(noted.contains("column `why` is not used"), "{noted}");
    assert!(
        (slit[0]["seam"].as_f64().unwrap() - 0.02).abs() < 2e-3,
        "a slit from the boundary: {}",
        slit[0]["seam"]
    );
}

/// A Möbius strip is refused, with the faces once around it.
#[test]
fn a_surface_with_one_side_is_refused_with_the_loop() {
    let folder = tempfile::tempdir().unwrap();
    let n = 12_u32;
    let at = |i: u32, side: f64| {
        let turn = 2.0 * PI * f64::from(i) / f64::from(n);
        let r = 0.05 + 0.01 * side * (0.5 * turn).cos();
        DVec3::new(r * turn.cos(), r * turn.sin(), 0.01 * side * (0.5 * turn).sin())
    };
    let positions = (0..n).flat_map(|i| [at(i, -1.0), at(i, 1.0)]);
    let mut text: String = positions.map(|p| format!("v {} {} {}\n", p.x, p.y, p.z)).collect();
    for i in 1..=n {
        let [a, b] = [2 * i - 1, 2 * i];
        let [c, d] = if i == n { [2, 1] } else { [a + 2, b + 2] };
        text += &format!("f {a} {c} {d}\nf {a} {d} {b}\n");
    }
    fs::write(folder.path().join("m.obj"), text).unwrap();
    let refused = dermatome(folder.path(), "build m.obj -o M").assert().code(2);
    refused.stderr(
        contains("cannot be wound consistently")
            .and(contains("closed strip of the faces"))
            .and(contains("and 16 more")),
    );
}

/// A flat sheet of T-junctions closed by triangles without area, some of them ears along an edge: the curvature
/// of the energy of such a face exceeded 64-bit numbers, and the build ended.
#[test]
fn slivers_without_area_do_not_end_a_build() {
    let places: [[f64; 2]; 21] = [
        [0.0, 0.0],
        [0.03333333333333333, 0.0],
        [0.06666666666666667, 0.0],
        [0.1, 0.0],
        [0.0, 0.05],
        [0.03333333333333333, 0.05],
        [0.06666666666666667, 0.05],
        [0.1, 0.05],
        [0.03333333333333333, 0.1],
        [0.06666666666666667, 0.1],
        [0.03333333333333333, 5e-14],
        [0.03333333, 0.05],
        [0.06666666666666667, 0.0125],
        [0.06666666666666667, 0.07500000000000001],
        [0.05, 0.025],
        [0.09166666666666667, 0.037500000000000006],
        [0.016666666666666666, 0.05],
        [0.03333333666666667, 0.05000000500000001],
        [0.03333333333333333, 5e-21],
        [0.033299999999999996, 0.04995],
        [0.06666666666666667, 1.25e-14],
    ];
    let faces: [[u32; 3]; 22] = [
        [3, 8, 7],
        [2, 6, 11],
        [6, 12, 1],
        [12, 5, 1],
        [6, 5, 12],
        [13, 7, 2],
        [3, 7, 13],
        [14, 10, 6],
        [2, 15, 6],
        [2, 7, 15],
        [8, 16, 4],
        [8, 3, 16],
        [5, 17, 9],
        [17, 6, 9],
        [5, 6, 17],
        [6, 18, 9],
        [18, 10, 9],
        [6, 10, 18],
        [2, 11, 19],
        [6, 20, 11],
        [6, 1, 20],
        [3, 13, 21],
    ];
    let folder = tempfile::tempdir().unwrap();
    let lines = places.iter().map(|[x, y]| format!("v {x:?} {y:?} 0\n"));
    let lines = lines.chain(faces.iter().map(|[a, b, c]| format!("f {a} {b} {c}\n")));
    fs::write(folder.path().join("sheet.obj"), lines.collect::<String>()).unwrap();
    let refused = dermatome(folder.path(), "build sheet.obj -o M --weld none --repair").assert().code(2);
    refused.stderr(contains("without area after rounding").and(contains("not finite").not()));
    // 64-bit numbers hold such faces.
    dermatome(folder.path(), "flatten sheet.obj -o flat.npz --weld none --repair").assert().success();
}

/// A tube must be cut, and its map depends on the levels above it.
#[test]
fn flatten_measures_the_map_that_build_makes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write(path, "tube.obj", shapes::tube(24, 16, 0.03, 0.1));
    let (levels, _) = levels(path, "tube.obj -o M");
    let run = dermatome(path, "flatten tube.obj -o f.npz --json").assert().success();
    let mut flat: Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
    flat.as_object_mut().unwrap().remove("schema");
    // That of `build` is measured as its file holds it, in 32-bit numbers.
    for (key, value) in levels[0].as_object().unwrap() {
        match (value.as_f64(), flat[key].as_f64()) {
            (Some(a), Some(b)) => assert!((a - b).abs() <= 1e-5 * a.abs(), "{key}: {a}, {b}"),
            _ => assert_eq!(&flat[key], value, "{key}"),
        }
    }
}

/// Positions of 64 bits are those of the skin however far from the origin, those of a map file are not.
#[test]
fn what_lies_far_away_keeps_its_shape_or_is_noted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let mut mesh = shapes::cap(200, 0.1, 0.6);
    write(path, "near.obj", mesh.clone());
    mesh.positions.iter_mut().for_each(|p| p.x += 65536.0);
    write(path, "far.obj", mesh.clone());
    mesh.positions.iter_mut().for_each(|p| p.x += 1e6);
    write(path, "farther.obj", mesh);
    let flat = |name: &str| {
        let run = dermatome(path, &format!("flatten {name} -o f.npz --json")).assert().success();
        let flat: Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
        flat["qc_mean"].as_f64().unwrap()
    };
    let near = flat("near.obj");
    for far in ["far.obj", "farther.obj"] {
        assert!((flat(far) - near).abs() < 1e-6, "{far}: {} instead of {near}", flat(far));
    }
    for words in ["build far.obj -o M", "convert far.obj far.glb", "coarsen far.obj -o far.glb"] {
        notes(path, words, &["rounded by up to"]);
    }
    refuses(path, "build farther.obj -o M", &["without area", "move it near the origin"]);
}

/// Several files and folders are one skin, a patch for each, in the order of the names; an OBJ names its
/// patches itself.
#[test]
fn several_files_are_one_skin() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::create_dir(path.join("parts")).unwrap();
    fs::write(path.join("parts/notes.txt"), "of these parts").unwrap();
    write(path, "parts/b.stl", shapes::cap(60, 0.05, 0.5));
    write(path, "parts/a.obj", shapes::lattice(6, 6, 0.005));
    let build = |words: &str| dermatome(path, &format!("build {words}")).assert();
    build("parts/a.obj parts/b.stl").code(2).stderr(contains("-o DIR"));
    build("parts/a.obj parts/b.stl -o named").success();
    build("parts").success();
    build("parts -o parts").code(2).stderr(contains("among the files of the skin"));
    let maps = ["named", "parts.map"].map(|folder| fs::read(path.join(folder).join("map.glb")).unwrap());
    assert!(maps[0] == maps[1], "the files of the folder");
    let map = read_map(&path.join("named/map.glb")).unwrap();
    assert_eq!(map.patches.iter().map(|patch| &*patch.name).collect::<Vec<_>>(), ["s", "b"]);
    fs::create_dir(path.join("empty")).unwrap();
    build("empty").code(2).stderr(contains("no file with triangles"));
}

/// A page of more taxels than a browser shows with ease is left to `report`.
#[test]
fn no_page_is_written_for_a_quarter_of_a_million_taxels() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write(path, "large.glb", shapes::lattice(501, 500, 0.001));
    let large = "build large.glb -o large --levels 1 --method conformal --pixel-mm 5";
    dermatome(path, large)
        .assert()
        .success()
        .stderr(contains("report.html is not written for 250500 taxels"));
    write(path, "small.glb", shapes::lattice(9, 9, 0.001));
    dermatome(path, "build small.glb -o small").assert().success().stderr(contains("not written").not());
    let has_page = ["large", "small"].map(|folder| path.join(folder).join("report.html").exists());
    assert_eq!(has_page, [false, true]);
}
