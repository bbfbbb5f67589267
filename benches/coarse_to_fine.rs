//! `dermatome bench` on maps of named skins and sizes, built with all their levels: see
//! `dermatome::contact::measure`.
//!
//! ```sh
//! cargo bench --bench coarse_to_fine -- cap 10000 100000    # default: cap forearm robot, 10000 100000 1000000
//! cargo bench --bench coarse_to_fine -- cap 10000 peers=FOLDER
//! ```
//!
//! Prints the tables of each skin and size, and writes a picture of error against time to
//! `meshes/coarse_to_fine.svg`: the sizes of the first skin. With `peers=FOLDER` it writes, instead of the
//! picture, what other engines need to answer the same contacts: `mesh.obj`, `scattered.f32` and `path.f32`, in
//! world coordinates (`tools/compare/compare.py coarse` runs them in turn).
#![allow(clippy::cast_possible_truncation, reason = "decades of an axis are small numbers")]

use std::{
    collections::BTreeMap,
    fmt::Write,
    fs,
    path::{Path, PathBuf},
};

use dermatome::{
    contact::{ContactIndex, Query, SampleContacts, measure},
    id::VertexId,
    io::read_draft,
    map::SkinMap,
    mesh::{TriMesh, shapes},
    pipeline::{BuildOptions, build},
    pyramid::LevelId,
    skin::{AssembleOptions, Patch, Skin, assemble},
};

const SKINS: [&str; 3] = ["cap", "forearm", "robot"];
const SIZES: [usize; 3] = [10_000, 100_000, 1_000_000];

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    let peers: Option<PathBuf> = words.iter().find_map(|word| Some(word.strip_prefix("peers=")?.into()));
    let sizes: Vec<usize> = words.iter().filter_map(|word| word.parse().ok()).collect();
    let sizes = if sizes.is_empty() { SIZES.to_vec() } else { sizes };
    let named: Vec<&str> = SKINS.into_iter().filter(|name| words.iter().any(|word| word == name)).collect();
    let names = if named.is_empty() { SKINS.to_vec() } else { named };
    let mut curves: BTreeMap<usize, Vec<[f64; 2]>> = BTreeMap::new();
    for name in names.iter().copied() {
        let mut of_skin = BTreeMap::new();
        sizes.iter().for_each(|&faces| measure_skin(name, faces, peers.as_deref(), &mut of_skin));
        if curves.is_empty() {
            curves = of_skin;
        }
    }
    if peers.is_some() {
        return;
    }
    curves.values_mut().for_each(|points| points.sort_by(|a, b| a[0].total_cmp(&b[0])));
    let title = format!("Contacts on one level of the {} alone: {sizes:?} triangles", names[0]);
    fs::write("meshes/coarse_to_fine.svg", picture(&title, &curves)).unwrap();
}

/// Error against time of each level, on logarithmic axes, as SVG.
fn picture(title: &str, curves: &BTreeMap<usize, Vec<[f64; 2]>>) -> String {
    const COLOURS: [&str; 8] =
        ["#440154", "#3b528b", "#21918c", "#5eaa3c", "#cc7814", "#b4283c", "#787878", "#141414"];
    let logs = |p: &[f64; 2]| p.map(f64::log10);
    let all: Vec<[f64; 2]> = curves.values().flatten().map(logs).filter(|p| p[1].is_finite()).collect();
    let along = |axis: usize| all.iter().map(move |p| p[axis]);
    let least = [0, 1].map(|axis| along(axis).fold(f64::INFINITY, f64::min).floor());
    let most = [0, 1].map(|axis| along(axis).fold(f64::NEG_INFINITY, f64::max).ceil().max(least[axis] + 1.0));
    let place = |p: [f64; 2]| {
        let [x, y] = [0, 1].map(|axis| (p[axis] - least[axis]) / (most[axis] - least[axis]));
        [90.0 + 690.0 * x, 496.0 - 440.0 * y]
    };
    let text = |[x, y]: [f64; 2], anchor: &str, words: &str| {
        format!("<text x='{x:.1}' y='{y:.1}' text-anchor='{anchor}'>{words}</text>\n")
    };
    let line = |points: &[[f64; 2]], style: &str| {
        let points: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        format!("<polyline points='{}' fill='none' {style}/>\n", points.join(" "))
    };
    let mut svg = "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 900 560' \
                   font-family='sans-serif' font-size='15'>\n<rect width='900' height='560' fill='white'/>\n"
        .to_owned();
    svg += &text([90.0, 30.0], "start", title);
    svg += &text([90.0, 48.0], "start", "99th percentile of the error, mm");
    svg += &text([780.0, 541.0], "end", "time of a contact, ns");
    for axis in 0..2 {
        for decade in (0..=(most[axis] - least[axis]) as i32).map(|k| least[axis] + f64::from(k)) {
            let ends = [least, most].map(|mut end| {
                end[axis] = decade;
                place(end)
            });
            let [x, y] = ends[0];
            let (at, anchor) =
                if axis == 0 { ([x, y + 21.0], "middle") } else { ([x - 7.0, y + 5.0], "end") };
            svg += &line(&ends, "stroke='#ccc'");
            svg += &text(at, anchor, &10_f64.powf(decade).to_string());
        }
    }
    for ((level, points), colour) in curves.iter().zip(COLOURS.iter().cycle()) {
        let points: Vec<[f64; 2]> = points.iter().map(logs).filter(|p| p[1].is_finite()).map(place).collect();
        let Some([x, y]) = points.last() else { continue };
        svg += &line(&points, &format!("stroke='{colour}' stroke-width='2'"));
        for [x, y] in &points {
            svg += &format!("<circle cx='{x:.1}' cy='{y:.1}' r='4' fill='{colour}'/>\n");
        }
        svg += &text([x + 10.0, y + 5.0], "start", &format!("level {level}"));
    }
    svg + "</svg>\n"
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
    let mut positions = mesh.positions.to_vec();
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

fn measure_skin(name: &str, faces: usize, peers: Option<&Path>, curves: &mut BTreeMap<usize, Vec<[f64; 2]>>) {
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
    for level in &costs.levels {
        assert_eq!(level.violations, 0, "every bound holds");
        curves.entry(level.level).or_default().push([level.ns, level.error_mm[1]]);
    }
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
