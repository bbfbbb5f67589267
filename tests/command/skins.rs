//! What must not matter to a skin, tried on every command that takes one: the frame, the unit, the order of rows, faces and
//! files, and names. Bare taxels and a mesh; each has two patches on two links, a square lattice around a cylinder and a
//! triangular one on a wave with an absent taxel.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use dermatome::io::read_map;
use glam::{DQuat, DVec3};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;
use serde_json::Value;

use crate::common::{dermatome, json};

/// Taxels along u and v of the two patches, 5 mm apart.
const SHEETS: [(usize, usize); 2] = [(8, 12), (7, 9)];
const SPACING: f64 = 0.005;
/// The absent taxel.
const ABSENT: u32 = 121;

#[derive(Clone)]
struct Row {
    id: u32,
    at: DVec3,
    patch: usize,
    module: usize,
}

fn rows() -> Vec<Row> {
    let mut rows = Vec::new();
    for (patch, (width, height)) in SHEETS.into_iter().enumerate() {
        for k in 0..width * height {
            let (i, j) = ((k % width) as f64, (k / width) as f64);
            let at = if patch == 0 {
                let angle = SPACING * i / 0.05;
                DVec3::new(0.05 * angle.cos(), 0.05 * angle.sin(), SPACING * j)
            } else {
                let (x, y) = (SPACING * (i + 0.5 * (j % 2.0)), SPACING * j * 0.75_f64.sqrt());
                DVec3::new(x + 0.3, y, 0.004 * (x / 0.012).sin() * (y / 0.015).cos())
            };
            let module = 100 * patch + 10 * (k / width / 4) + k % width / 3;
            rows.push(Row { id: u32::try_from(rows.len()).unwrap() + 1, at, patch, module });
        }
    }
    rows
}

/// The corners of each triangle, by id.
fn triangles() -> Vec<[u32; 3]> {
    let mut all = Vec::new();
    let mut first = 1;
    for (patch, (width, height)) in SHEETS.into_iter().enumerate() {
        for (i, j) in (0..height - 1).flat_map(|j| (0..width - 1).map(move |i| (i, j))) {
            let a = u32::try_from(first + j * width + i).unwrap();
            let [b, c, d] = [1, width, width + 1].map(|step| a + u32::try_from(step).unwrap());
            all.extend(if patch == 1 && j % 2 == 1 {
                [[a, b, d], [a, d, c]]
            } else {
                [[a, b, c], [b, d, c]]
            });
        }
        first += width * height;
    }
    all
}

/// Files of other kinds.
const CONVERTED: [(&str, &str); 4] = [
    ("convert to glb", "c.glb"),
    ("convert to csv", "c.csv"),
    ("convert to json", "c.json"),
    ("convert to ply", "c.ply"),
];

/// What is done to a skin.
#[derive(Clone, Copy, Default)]
struct Altered {
    /// A turn about an axis without a lattice direction, in rad.
    turn: f64,
    /// 0 is as it is.
    scale: f64,
    /// The order of rows and of faces, if it is another one.
    order: Option<u64>,
    names: Names,
}

#[derive(Clone, Copy, Default, PartialEq)]
enum Names {
    #[default]
    Given,
    Others,
    None,
}

impl Altered {
    fn scale(&self) -> f64 {
        if self.scale == 0.0 { 1.0 } else { self.scale }
    }
}

const ALTERED: [(&str, Altered); 9] = {
    const SAME: Altered = Altered { turn: 0.0, scale: 0.0, order: None, names: Names::Given };
    [
        ("as it is", SAME),
        ("turned", Altered { turn: 1.1, ..SAME }),
        ("turned further", Altered { turn: 2.9, ..SAME }),
        ("3 times as large", Altered { scale: 3.0, ..SAME }),
        ("1000 times as small", Altered { scale: 1e-3, ..SAME }),
        ("in another order", Altered { order: Some(3), ..SAME }),
        ("with other names", Altered { names: Names::Others, ..SAME }),
        ("without names", Altered { names: Names::None, ..SAME }),
        ("all at once", Altered { turn: 0.7, scale: 3.0, order: Some(9), names: Names::Others }),
    ]
};

/// Which of [`ALTERED`] are tried on all commands, of bare taxels and of a mesh: each of them once.
const ON_ALL: [&[usize]; 2] = [&[0, 1, 3, 7], &[0, 4, 6, 8]];

/// Items in an order of this seed.
fn shuffled<T>(mut items: Vec<T>, order: Option<u64>) -> Vec<T> {
    if let Some(seed) = order {
        let mut random = Pcg64Mcg::new((u128::from(seed) << 1) | 1);
        for k in (1..items.len()).rev() {
            items.swap(k, usize::try_from(random.next_u64() % (k as u64 + 1)).unwrap());
        }
    }
    items
}

/// Writes the rows of these patches as `NAME.csv`, with their triangles if it is a mesh.
fn write(folder: &Path, name: &str, rows: &[Row], patches: &[usize], is_mesh: bool, how: Altered) {
    let turn = DQuat::from_axis_angle(DVec3::new(0.3, -0.5, 0.8).normalize(), how.turn);
    let chosen = rows.iter().filter(|row| patches.contains(&row.patch)).cloned().collect();
    let rows: Vec<Row> = shuffled(chosen, how.order);
    let mut text = String::from("id,x,y,z,present,module");
    text += if how.names == Names::None { "\n" } else { ",patch,on_link\n" };
    for row in &rows {
        let at = how.scale() * (turn * row.at);
        let (present, id, module) = (u8::from(row.id != ABSENT), row.id, row.module);
        write!(text, "{id},{},{},{},{present},m{module}", at.x, at.y, at.z).unwrap();
        let names = match how.names {
            Names::Given => ["upper arm,arm 1", "left palm,palm 2"][row.patch],
            Names::Others => ["zz,q 7", "aa,b"][row.patch],
            Names::None => "",
        };
        text += &if names.is_empty() { "\n".to_owned() } else { format!(",{names}\n") };
    }
    fs::write(folder.join(format!("{name}.csv")), text).unwrap();
    if is_mesh {
        let numbers: BTreeMap<u32, usize> = rows.iter().enumerate().map(|(k, row)| (row.id, k)).collect();
        let mut text = String::from("row0,row1,row2\n");
        for (k, corners) in shuffled(triangles(), how.order).into_iter().enumerate() {
            let mut corners = corners.map(|id| numbers.get(&id));
            corners.rotate_left(if how.order.is_some() { k % 3 } else { 0 });
            if let [Some(a), Some(b), Some(c)] = corners {
                writeln!(text, "{a},{b},{c}").unwrap();
            }
        }
        fs::write(folder.join(format!("{name}.triangles.csv")), text).unwrap();
    }
}

/// What a command says: what must be the same, and numbers that must be so but for rounding.
type Outcome = (String, Vec<f64>);

/// What each command says of a file, patches sorted by what is said of them.
fn outcomes(folder: &Path, name: &str, scale: f64) -> BTreeMap<&'static str, Outcome> {
    let run = |words: &str| json(&dermatome(folder, words).assert().success().get_output().stdout);
    let patches = |found: &Value, of: &dyn Fn(&Value) -> Outcome| -> Outcome {
        let mut all: Vec<Outcome> = found["patches"].as_array().unwrap().iter().map(of).collect();
        all.sort_by(|a, b| a.0.cmp(&b.0));
        (all.iter().map(|x| x.0.clone() + "\n").collect(), all.into_iter().flat_map(|x| x.1).collect())
    };
    let number = |value: &Value| value.as_f64().unwrap();
    let size = |patch: &Value| -> Outcome {
        let counts =
            ["vertices", "faces", "boundary_loops", "euler", "absent"].map(|key| patch[key].to_string());
        let sizes = [number(&patch["area_m2"]) / scale / scale, number(&patch["spacing_mm"]) / scale];
        (counts.join(" "), sizes.to_vec())
    };
    let levels = |patch: &Value| -> Outcome {
        let counts =
            |level: &Value| ["vertices", "faces", "boundary_loops"].map(|key| level[key].to_string());
        let levels = patch["levels"].as_array().unwrap();
        (levels.iter().map(|level| counts(level).join(" ") + ", ").collect(), Vec::new())
    };
    let info = run(&format!("info {name}.csv --json"));
    let mut found = BTreeMap::from([("info", patches(&info, &size))]);
    let findings = run(&format!("check {name}.csv --json"));
    let kinds = findings["findings"].as_array().unwrap().iter().map(|finding| finding["kind"].to_string());
    // Sizes that are not those of a robot are remarked on.
    let kinds = kinds.filter(|kind| scale == 1.0 || !kind.contains("unit"));
    // Without names both patches are pieces of one sheet, which is remarked on.
    let mut kinds: Vec<String> = kinds.filter(|kind| !kind.contains("bare-pieces")).collect();
    kinds.sort();
    found.insert("check", (kinds.join(" "), Vec::new()));
    for (door, file) in CONVERTED {
        dermatome(folder, &format!("convert {name}.csv {file}")).assert().success();
        found.insert(door, patches(&run(&format!("info {file} --json")), &size));
    }
    found.insert("coarsen", patches(&run(&format!("coarsen {name}.csv -o c.glb --json")), &levels));
    let all = info["patches"].as_array().unwrap();
    let largest =
        all.iter().max_by_key(|patch| patch["vertices"].as_u64()).unwrap()["name"].as_str().unwrap();
    let words = ["flatten", &format!("{name}.csv"), "-o", "f.obj", "--json", "--patch", largest];
    let mut flatten = crate::common::command();
    let flat = json(&flatten.current_dir(folder).args(words).assert().success().get_output().stdout);
    let counts =
        ["vertices", "faces", "boundary_loops", "flips", "crossings"].map(|key| flat[key].to_string());
    let measures = ["area_max", "qc_max", "symmetric_dirichlet"].map(|key| number(&flat[key]));
    found.insert("flatten", (counts.join(" "), measures.to_vec()));
    let pixels = format!("build {name}.csv -o m --pixel-mm {}", 5.0 * scale);
    dermatome(folder, &pixels).assert().success();
    found.insert("build", map_of(&folder.join("m/map.glb")));
    found
}

/// The taxels of each level of a map, and how faithful it is.
fn map_of(path: &Path) -> Outcome {
    let map = read_map(path).unwrap();
    let mut all: Vec<Outcome> = Vec::new();
    for patch in &map.patches {
        let (mut text, mut measures) = (String::new(), Vec::new());
        for level in &patch.levels {
            let origins = &level.level.origins;
            let mut ids: Vec<u32> = origins.iter().map(|&v| patch.taxels.ids[v].0).collect();
            ids.sort_unstable();
            writeln!(text, "{} faces of {ids:?}", level.level.mesh.triangles.len()).unwrap();
            measures.extend([level.distortion.area_max, level.distortion.symmetric_dirichlet]);
        }
        all.push((text, measures));
    }
    all.sort_by(|a, b| a.0.cmp(&b.0));
    (all.iter().map(|x| x.0.clone()).collect(), all.into_iter().flat_map(|x| x.1).collect())
}

/// Compares what is said with what is expected; numbers to a thousandth.
fn compare(what: &str, door: &str, expected: &Outcome, found: &Outcome, wrong: &mut Vec<String>) {
    let is_near = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-3 * a.abs();
    if expected.0 != found.0 {
        wrong.push(format!("{what}, {door}: {} in place of {}", found.0, expected.0));
    } else if expected.1.len() != found.1.len() || !expected.1.iter().zip(&found.1).all(is_near) {
        wrong.push(format!("{what}, {door}: {:?} in place of {:?}", found.1, expected.1));
    }
}

#[test]
fn frames_units_orders_and_names_do_not_matter() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let rows = rows();
    let mut wrong = Vec::new();
    for is_mesh in [false, true] {
        let mut expected = None;
        for (what, how) in ON_ALL[usize::from(is_mesh)].iter().map(|&k| ALTERED[k]) {
            let name = format!("s{}", u8::from(is_mesh));
            write(folder, &name, &rows, &[0, 1], is_mesh, how);
            let found = outcomes(folder, &name, how.scale());
            let expected = expected.get_or_insert_with(|| found.clone());
            for (door, outcome) in &found {
                let what = format!("{what}, {}", if is_mesh { "a mesh" } else { "bare taxels" });
                compare(&what, door, &expected[door], outcome, &mut wrong);
            }
        }
        // Files in any order.
        for (name, patch) in [("first", 0), ("second", 1)] {
            write(folder, name, &rows, &[patch], is_mesh, Altered::default());
        }
        let expected = expected.unwrap();
        for files in ["first.csv second.csv", "second.csv first.csv"] {
            dermatome(folder, &format!("build {files} -o m --pixel-mm 5")).assert().success();
            compare(files, "build", &expected["build"], &map_of(&folder.join("m/map.glb")), &mut wrong);
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A module and a taxel that moved are named in any frame, unit, order and under any name.
#[test]
fn differences_are_the_same_in_any_frame() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let before = rows();
    let mut random = Pcg64Mcg::new(5);
    let mut noise = || {
        let mut uniform = || (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        let mut normal = || (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
        2e-4 * DVec3::new(normal(), normal(), normal())
    };
    let mut after = before.clone();
    for row in &mut after {
        row.at += noise();
        if row.module == 11 {
            row.at += DVec3::new(0.0, 0.0, 0.003);
        }
        if row.id == 130 {
            row.at += DVec3::new(0.0, 0.002, 0.0);
        }
    }
    let (mut expected, mut wrong) = (None, Vec::new());
    for (what, how) in ALTERED.into_iter().filter(|(_, how)| how.scale() >= 1.0) {
        write(folder, "a", &before, &[0, 1], false, how);
        write(folder, "b", &after, &[0, 1], false, Altered { order: how.order.map(|seed| seed + 1), ..how });
        let found = json(&dermatome(folder, "diff a.csv b.csv --json").assert().code(1).get_output().stdout);
        let change = |change: &Value| -> Outcome {
            let mut ids: Vec<u64> =
                change["taxels"].as_array().unwrap().iter().map(|id| id.as_u64().unwrap()).collect();
            ids.sort_unstable();
            let text = format!("{} {} {ids:?}\n", change["kind"], change["subject"]);
            (text, vec![change["distance_mm"].as_f64().unwrap() / how.scale()])
        };
        let mut changes: Vec<Outcome> = found["changes"].as_array().unwrap().iter().map(change).collect();
        changes.sort_by(|a, b| a.0.cmp(&b.0));
        let distances: Vec<f64> = changes.iter().flat_map(|x| x.1.clone()).collect();
        let found: String = changes.into_iter().map(|x| x.0).collect();
        let (first, known) = expected.get_or_insert_with(|| (found.clone(), distances.clone()));
        // Without names both patches are on one link, whose alignment is another one by a part of the noise.
        let is_near = |(a, b): (&f64, &f64)| (a - b).abs() < 0.1;
        if *first != found || !known.iter().zip(&distances).all(is_near) {
            wrong.push(format!("{what}: {found} {distances:?} in place of {first} {known:?}"));
        }
    }
    let first = expected.unwrap().0;
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert_eq!(first.lines().count(), 2, "{first}");
    assert!(first.contains("\"moved\" \"taxel\" [130]") && first.contains("\"moved\" \"module\""), "{first}");
}
