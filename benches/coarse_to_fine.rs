//! `dermatome bench` on maps of named skins and sizes, built with all their levels: see
//! the module `measure` of the command.
//!
//! ```sh
//! cargo bench --bench coarse_to_fine -- cap 10000 100000    # default: cap forearm robot, 10000 100000 1000000
//! cargo bench --bench coarse_to_fine -- cap 10000 peers=FOLDER
//! ```
//!
//! Prints the tables of each skin and size, and writes a picture of times and of the share decided, by distance from the skin, to
//! `meshes/coarse_to_fine.svg`: of the first skin and size. With `peers=FOLDER` it writes, instead of the
//! picture, what other engines need to answer the same contacts: `mesh.obj`, `scattered.f32` and `path.f32`, in
//! world coordinates (`tools/compare/compare.py coarse` runs them in turn).

#[path = "../crates/command/src/bench/measure.rs"]
mod measure;

use std::{
    collections::BTreeMap,
    fmt::Write,
    fs,
    path::{Path, PathBuf},
};

use dermatome::{
    contact::{ContactIndex, Query},
    id::VertexId,
    io::read_draft,
    map::SkinMap,
    mesh::{TriMesh, shapes},
    pipeline::{BuildOptions, build},
    pyramid::LevelId,
    skin::{AssembleOptions, Patch, Skin, assemble},
};

use measure::{AnswerCosts, BandCosts, SampleContacts, measure};

const SKINS: [&str; 3] = ["cap", "forearm", "robot"];
const SIZES: [usize; 3] = [10_000, 100_000, 1_000_000];

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    let peers: Option<PathBuf> = words.iter().find_map(|word| Some(word.strip_prefix("peers=")?.into()));
    let sizes: Vec<usize> = words.iter().filter_map(|word| word.parse().ok()).collect();
    let sizes = if sizes.is_empty() { SIZES.to_vec() } else { sizes };
    let named: Vec<&str> = SKINS.into_iter().filter(|name| words.iter().any(|word| word == name)).collect();
    let names = if named.is_empty() { SKINS.to_vec() } else { named };
    let mut first = None;
    for name in names.iter().copied() {
        for &faces in &sizes {
            let costs = measure_skin(name, faces, peers.as_deref());
            first.get_or_insert((name, costs));
        }
    }
    if let Some((name, costs)) = first.filter(|_| peers.is_none()) {
        fs::write("meshes/coarse_to_fine.svg", picture(name, &costs)).unwrap();
    }
}

/// The curves of a panel: label, colour, and heights from 0 to 1.
type Curve = (String, &'static str, Vec<f64>);

/// Time of answers and share decided, by distance from the skin, as SVG.
fn picture(name: &str, costs: &AnswerCosts) -> String {
    const COLOURS: [&str; 7] = ["#440154", "#3b528b", "#21918c", "#5eaa3c", "#cc7814", "#b4283c", "#787878"];
    let bands: Vec<&BandCosts> = costs.bands.iter().collect();
    let off: Vec<String> =
        bands.iter().map(|band| format!("{} to {}", band.off_mm[0], band.off_mm[1])).collect();
    // 10 ns to 10 us.
    let times =
        |of: &dyn Fn(&BandCosts) -> f64| bands.iter().map(|band| (of(band).log10() - 1.0) / 3.0).collect();
    let time: Vec<Curve> = vec![
        ("exact".into(), COLOURS[0], times(&|band| band.exact_ns)),
        ("reactive".into(), COLOURS[5], times(&|band| band.reactive_ns)),
        (
            "with its cell on level 1".into(),
            COLOURS[4],
            times(&|band| band.levels.get(1).map_or(f64::NAN, |l| l.with_cell_ns[0])),
        ),
    ];
    let share: Vec<Curve> = bands
        .iter()
        .zip(&off)
        .zip(COLOURS)
        .map(|((band, off), colour)| (format!("{off} mm off"), colour, band.decided.to_vec()))
        .collect();
    let decades = [10, 100, 1000, 10_000].map(|ns| ns.to_string());
    let percents = [0, 25, 50, 75, 100].map(|percent| percent.to_string());
    let thresholds = [1, 2, 5, 10, 20].map(|mm| mm.to_string());
    let title = format!("{name}, {} triangles: ns a contact, by mm off the skin", costs.faces);
    let mut svg = "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 1180 460' \
                   font-family='sans-serif' font-size='14'>\n<rect width='1180' height='460' fill='white'/>\n"
        .to_owned();
    svg += &panel(70.0, &title, &off, &decades, &time);
    svg += &panel(
        680.0,
        "% of the contacts surely within 1 to 20 mm, or surely not",
        &thresholds,
        &percents,
        &share,
    );
    svg + "</svg>\n"
}

/// A panel at a position from the left, with words along both axes.
fn panel(left: f64, title: &str, along: &[String], up: &[String], curves: &[Curve]) -> String {
    let text = |[x, y]: [f64; 2], anchor: &str, words: &str| {
        format!("<text x='{x:.1}' y='{y:.1}' text-anchor='{anchor}'>{words}</text>\n")
    };
    let line = |points: &[[f64; 2]], style: &str| {
        let points: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        format!("<polyline points='{}' fill='none' {style}/>\n", points.join(" "))
    };
    let place = |k: usize, count: usize| (k as f64 + 0.5) / count as f64;
    let at = |x: f64, y: f64| [left + 320.0 * x, 410.0 - 350.0 * y];
    let mut svg = text([left, 30.0], "start", title);
    for (k, words) in up.iter().enumerate() {
        let y = k as f64 / (up.len() - 1) as f64;
        let [x, height] = at(0.0, y);
        svg += &line(&[at(0.0, y), at(1.0, y)], "stroke='#ccc'");
        svg += &text([x - 6.0, height + 5.0], "end", words);
    }
    for (k, words) in along.iter().enumerate() {
        svg += &text([at(place(k, along.len()), 0.0)[0], 432.0], "middle", words);
    }
    let mut labels: Vec<(f64, &str, &str)> = Vec::new();
    for (label, colour, heights) in curves {
        let points = heights.iter().enumerate().filter(|(_, y)| y.is_finite());
        let points: Vec<[f64; 2]> = points.map(|(k, y)| at(place(k, along.len()), *y)).collect();
        svg += &line(&points, &format!("stroke='{colour}' stroke-width='2'"));
        svg.extend(
            points
                .iter()
                .map(|[x, y]| format!("<circle cx='{x:.1}' cy='{y:.1}' r='3.5' fill='{colour}'/>\n")),
        );
        labels.extend(points.last().map(|[_, y]| (*y, label.as_str(), *colour)));
    }
    // Labels from the top, at least a line apart.
    labels.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut y = 0.0_f64;
    for (wanted, label, colour) in labels {
        y = wanted.max(y + 17.0);
        svg += &format!("<text x='{:.1}' y='{:.1}' fill='{colour}'>{label}</text>\n", left + 300.0, y + 5.0);
    }
    svg
}

/// A skin of at least this many faces: halved edges, where it is a file.
fn skin(name: &str, faces: usize) -> Skin {
    if name == "cap" {
        return Skin::from_mesh("cap", shapes::cap(faces, 0.1, 1.92));
    }
    let draft = read_draft(format!("meshes/{name}.glb").as_ref()).unwrap();
    let mut skin = assemble(&draft, &AssembleOptions::default()).unwrap().skin;
    let count = |skin: &Skin| skin.patches.iter().map(|p| p.mesh.triangles.len()).sum::<usize>();
    while count(&skin) * 2 < faces {
        skin.patches = skin.patches.map(|p| Patch::from_mesh(p.name.clone(), p.link, halved(&p.mesh)));
    }
    skin
}

/// Every triangle divided in four.
fn halved(mesh: &TriMesh) -> TriMesh {
    let mut positions = mesh.positions.as_slice().to_vec();
    let mut middles: BTreeMap<[VertexId; 2], u32> = BTreeMap::new();
    let mut triangles = Vec::new();
    for corners in &mesh.triangles {
        let [ab, bc, ca] = [0, 1, 2].map(|k| {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                positions.push(mesh.positions[a].midpoint(mesh.positions[b]));
                u32::try_from(positions.len() - 1).unwrap()
            })
        });
        let [a, b, c] = corners.map(VertexId::raw);
        triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    TriMesh::from_arrays(positions, &triangles)
}

fn measure_skin(name: &str, faces: usize, peers: Option<&Path>) -> AnswerCosts {
    let map = build(&skin(name, faces), &BuildOptions::default()).unwrap();
    if let Some(folder) = peers {
        let index = ContactIndex::new(&map).unwrap();
        let contacts = SampleContacts::new(&map, &index).unwrap();
        write_mesh(&folder.join("mesh.obj"), &map, &index);
        write_contacts(&folder.join("scattered.f32"), &contacts.scattered);
        write_contacts(&folder.join("path.f32"), &contacts.path);
    }
    let costs = measure(&map).unwrap();
    println!("\n{name}, {}", costs.to_markdown());
    assert!(costs.bands.iter().all(|band| band.violations == 0), "every interval holds");
    costs
}

/// Level 0 of all patches as one OBJ mesh, in world coordinates.
fn write_mesh(file: &Path, map: &SkinMap, index: &ContactIndex) {
    let (mut text, mut first) = (String::new(), 1);
    for patch in &map.patches {
        let mesh = &patch.levels[LevelId::new(0)].level.mesh;
        for p in &mesh.positions {
            let [x, y, z] = index.poses()[patch.link].transform_point3(*p).to_array();
            writeln!(text, "v {x} {y} {z}").unwrap();
        }
        for [a, b, c] in mesh.triangles.iter().map(|corners| corners.map(|v| v.index() + first)) {
            writeln!(text, "f {a} {b} {c}").unwrap();
        }
        first += mesh.positions.len();
    }
    fs::write(file, text).unwrap();
}

/// Points as `x y z` in little-endian `f32`.
fn write_contacts(file: &Path, contacts: &[Query]) {
    let points = contacts.iter().flat_map(|query| query.point.as_vec3().to_array());
    fs::write(file, points.flat_map(f32::to_le_bytes).collect::<Vec<u8>>()).unwrap();
}
