//! Answers on each level alone against exact ones: time, error bound and true error, on maps built
//! with all their levels.
//!
//! ```sh
//! cargo bench --bench coarse_to_fine -- cap 10000 100000    # default: cap forearm robot, 10000 100000 1000000
//! cargo bench --bench coarse_to_fine -- cap 10000 peers=FOLDER
//! ```
//!
//! Contacts lie 0 to 3 mm off the skin, in no order, but for those of a path. A time is the mean over
//! 2^15 contacts, of the fastest of 13 passes for every 128 of them; works that are compared take turns
//! after every 128 contacts, on different ones. Map positions of all levels count from an answer with
//! its map position of level 0, cells of all levels from one with its cell of level 0. Prints a table
//! for each skin and size, and writes a picture of error against time to `meshes/coarse_to_fine.svg`:
//! the sizes of the first skin. With `peers=FOLDER` it writes, instead of the picture, what other
//! engines need to answer the same contacts: `mesh.obj`, `scattered.f32` and `path.f32`, in world
//! coordinates (`tools/compare/compare.py coarse` runs them in turn).
#![allow(missing_docs, clippy::print_stdout, clippy::unwrap_used, reason = "a bench prints what it measured")]
#![allow(clippy::cast_possible_truncation, reason = "shares of small numbers")]

mod numbers;

use std::{
    collections::BTreeMap,
    fmt::Write,
    fs,
    hint::black_box,
    path::{Path, PathBuf},
    time::Instant,
};

use dermatome::{
    contact::{ContactIndex, Hit, IndexOptions, MapIndex, Query, Reactive},
    id::VertexId,
    io::read_draft,
    map::{PatchMap, SkinMap},
    mesh::{TriMesh, shapes},
    pipeline::{BuildOptions, build},
    pyramid::LevelId,
    skin::{AssembleOptions, Patch, PatchId, Skin, assemble},
};
use glam::{DVec2, DVec3};
use numbers::numbers;

const CONTACTS: usize = 1 << 15;
const PASSES: usize = 13;
/// Contacts that are timed together.
const FEW: usize = 128;
const SKINS: [&str; 3] = ["cap", "forearm", "robot"];
const SIZES: [usize; 3] = [10_000, 100_000, 1_000_000];

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    let peers: Option<PathBuf> = words.iter().find_map(|word| Some(word.strip_prefix("peers=")?.into()));
    let sizes: Vec<usize> = words.iter().filter_map(|word| word.parse().ok()).collect();
    let sizes = if sizes.is_empty() { SIZES.to_vec() } else { sizes };
    let named: Vec<&str> = SKINS.into_iter().filter(|name| words.iter().any(|word| word == name)).collect();
    let names = if named.is_empty() { SKINS.to_vec() } else { named };
    let mut curves: BTreeMap<LevelId, Vec<[f64; 2]>> = BTreeMap::new();
    for name in names.iter().copied() {
        let mut of_skin = BTreeMap::new();
        sizes.iter().for_each(|&faces| measure(name, faces, peers.as_deref(), &mut of_skin));
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
fn picture(title: &str, curves: &BTreeMap<LevelId, Vec<[f64; 2]>>) -> String {
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
        svg += &text([x + 10.0, y + 5.0], "start", &format!("level {}", level.raw()));
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

/// Contacts 0 to 3 mm off the skin, in no order.
fn contacts(map: &SkinMap, index: &ContactIndex) -> Vec<Query> {
    let mut number = numbers();
    let patches: Vec<_> = map.patches.iter().collect();
    let poses = index.poses();
    let weights: Vec<usize> =
        patches.iter().map(|p| p.levels[LevelId::new(0)].level.mesh.triangles.len()).collect();
    let all: usize = weights.iter().sum();
    let contact = |_| {
        let mut left = ((number() * all as f64) as usize).min(all - 1);
        let k = weights.iter().position(|&n| {
            let here = left < n;
            left -= if here { 0 } else { n };
            here
        });
        let patch = patches[k.unwrap()];
        let mesh = &patch.levels[LevelId::new(0)].level.mesh;
        let [a, b, c] = mesh.corners(dermatome::id::FaceId::new(left));
        let (s, t) = (number().sqrt(), number());
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let at: DVec3 = a * (1.0 - s) + b * (s * (1.0 - t)) + c * (s * t) + normal * (0.003 * number());
        Query::from(poses[patch.link].transform_point3(at))
    };
    (0..CONTACTS).map(contact).collect()
}

/// Time of an item, in ns: of the fastest passes over every few items.
fn time<T>(items: &[T], mut work: impl FnMut(&T)) -> f64 {
    time_in_turn(items, [&mut work])[0]
}

/// The same of several works in turn: their differences hold on a busy machine too. What one has just
/// loaded into the cache is of no use to the next, which works elsewhere.
fn time_in_turn<T, const N: usize>(items: &[T], mut works: [&mut dyn FnMut(&T); N]) -> [f64; N] {
    let parts: Vec<&[T]> = items.chunks(FEW).collect();
    let mut fastest = vec![[f64::INFINITY; N]; parts.len()];
    for turn in 0..PASSES * parts.len() {
        for (k, work) in works.iter_mut().enumerate() {
            let part = (turn + k * parts.len() / N) % parts.len();
            let start = Instant::now();
            parts[part].iter().for_each(&mut *work);
            fastest[part][k] = fastest[part][k].min(start.elapsed().as_secs_f64());
        }
    }
    std::array::from_fn(|k| fastest.iter().map(|few| few[k]).sum::<f64>() * 1e9 / items.len() as f64)
}

/// Median, 99th percentile and largest, in mm.
fn spread(mut lengths: Vec<f64>) -> [f64; 3] {
    lengths.sort_by(f64::total_cmp);
    [0.5, 0.99, 1.0].map(|share| 1e3 * lengths[((lengths.len() - 1) as f64 * share) as usize])
}

fn measure(name: &str, faces: usize, peers: Option<&Path>, curves: &mut BTreeMap<LevelId, Vec<[f64; 2]>>) {
    let map = build(&skin(name, faces), &BuildOptions::default()).unwrap();
    let start = Instant::now();
    let plain = ContactIndex::new(&map).unwrap();
    let seconds = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let index =
        ContactIndex::with_options(&map, &IndexOptions { levels: true, ..IndexOptions::default() }).unwrap();
    let with_levels = start.elapsed().as_secs_f64();
    let found: usize = map.patches.iter().map(|p| p.levels[LevelId::new(0)].level.mesh.triangles.len()).sum();
    println!("\n{name}, {found} faces, index {seconds:.2} s, with levels {with_levels:.2} s");
    let contacts = contacts(&map, &index);
    let exact: Vec<Hit> = contacts.iter().map(|&q| index.locate(q).unwrap()).collect();
    let along = path(&index, &exact[0]);
    if let Some(folder) = peers {
        write_mesh(&folder.join("mesh.obj"), &map, &index);
        write_contacts(&folder.join("scattered.f32"), &contacts);
        write_contacts(&folder.join("path.f32"), &along);
    }
    measure_exact(&map, &plain, &contacts, &exact, &along);
    println!(
        "| level | faces | reactive ns | times faster | bound mm: median, 99 %, largest | error mm: median, 99 %, largest | bound within 2, 5, 10 mm |"
    );
    println!("|---|---|---|---|---|---|---|");
    let levels = map.patches.iter().map(|patch| patch.levels.len()).max().unwrap();
    for level in (1..levels).map(LevelId::new) {
        let count = |p: &PatchMap| p.levels.get(level).map_or(0, |l| l.level.mesh.triangles.len());
        print!("| {} | {} ", level.raw(), map.patches.iter().map(count).sum::<usize>());
        let point = measure_level(&index, level, &contacts, &exact);
        curves.entry(level).or_default().push(point);
    }
}

/// Exact answers, all levels of them, and the way back.
fn measure_exact(map: &SkinMap, index: &ContactIndex, contacts: &[Query], exact: &[Hit], near: &[Query]) {
    let finest = LevelId::new(0);
    let hit = |q: Query| index.locate(q).unwrap();
    let [locate, one, all] = time_in_turn(
        contacts,
        [&mut |&q| _ = black_box(hit(q)), &mut |&q| _ = black_box(index.cell(&hit(q), finest)), &mut |&q| {
            let hit = hit(q);
            (0..).map_while(|k| index.cell(&hit, LevelId::new(k))).for_each(|cell| _ = black_box(&cell));
        }],
    );
    let along = time(near, |&q| _ = black_box(hit(q)));
    let batch = time(&[()], |()| _ = black_box(index.locate_all(contacts).unwrap())) / CONTACTS as f64;
    let back = MapIndex::new(map).unwrap();
    let on_map: Vec<_> =
        exact.iter().filter_map(|hit| Some((hit.patch, index.cell(hit, finest)?.uv))).collect();
    let mut places = Vec::new();
    let mut answer = |&(patch, uv): &(PatchId, DVec2)| {
        places.clear();
        back.places(patch, finest, uv, &mut places).unwrap();
        black_box(&places).first().is_some_and(|place| place.off_chart == 0.0)
    };
    let mut pixels: Vec<_> = map.patches.enumerate().flat_map(|(id, patch)| pixels(id, patch)).collect();
    pixels.retain(&mut answer);
    let [way_back, by_pixels] = [&on_map[..], &pixels[..pixels.len().min(CONTACTS)]]
        .map(|places| time(places, |place| _ = answer(place)));
    println!(
        "level 0: {locate:.0} ns, with its cell {one:.0} ns; cells of all levels +{:.0} ns; near the last one {along:.0} ns; batch {batch:.0} ns; way back {way_back:.0} ns, from pixel to pixel {by_pixels:.0} ns\n",
        all - locate
    );
}

/// Answers of one level alone, compared with the exact ones. Returns their time in ns, and the 99th
/// percentile of their error in mm.
fn measure_level(index: &ContactIndex, level: LevelId, contacts: &[Query], exact: &[Hit]) -> [f64; 2] {
    let answers: Vec<Reactive> = contacts.iter().map(|&q| index.reactive(q, level).unwrap()).collect();
    let locate = time(contacts, |&q| _ = black_box(index.locate(q).unwrap()));
    let reactive = time(contacts, |&q| _ = black_box(index.reactive(q, level).unwrap()));
    let bounds: Vec<f64> = answers.iter().map(|answer| answer.error).collect();
    let errors = answers.iter().zip(exact).map(|(a, b)| (a.distance.abs() - b.distance.abs()).abs());
    let errors: Vec<f64> = errors.collect();
    assert!(errors.iter().zip(&bounds).all(|(error, bound)| *error <= bound + 1e-12), "every bound holds");
    let percent = |count: usize| 100.0 * count as f64 / CONTACTS as f64;
    let suffices = [0.002, 0.005, 0.01].map(|mm| percent(bounds.iter().filter(|b| **b <= mm).count()));
    let (bound, error) = (spread(bounds), spread(errors));
    println!(
        "| {reactive:.0} | {:.1} | {:.3}, {:.3}, {:.3} | {:.3}, {:.3}, {:.3} | {:.0} %, {:.0} %, {:.0} % |",
        locate / reactive,
        bound[0],
        bound[1],
        bound[2],
        error[0],
        error[1],
        error[2],
        suffices[0],
        suffices[1],
        suffices[2],
    );
    [reactive, error[1]]
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

/// The pixels of the image of level 0, row by row, from a quarter of its height on.
fn pixels(id: PatchId, patch: &PatchMap) -> impl Iterator<Item = (PatchId, DVec2)> {
    let frame = patch.levels[LevelId::new(0)].frame;
    let [columns, rows] = frame.size_px;
    (rows / 4..rows).flat_map(move |row| (0..columns).map(move |column| (id, frame.centre([column, row]))))
}

/// A walk over the skin in steps of half a millimetre, turning slowly and turning back at borders, 1 to
/// 1.1 mm off.
fn path(index: &ContactIndex, first: &Hit) -> Vec<Query> {
    let mut number = numbers();
    let (mut at, mut heading) = (first.position, DVec3::new(0.3, 0.8, 0.5).normalize());
    let step = |_| {
        let hit = index.locate(Query::from(at + heading * 0.0005)).unwrap();
        let is_stopped = hit.position.distance(at) < 0.0002;
        at = hit.position;
        let turn = if is_stopped { 2.0 + number() } else { 0.2 * (number() - 0.5) };
        let along = heading.reject_from(hit.normal).normalize_or(hit.normal.any_orthonormal_vector());
        heading = along * turn.cos() + hit.normal.cross(along) * turn.sin();
        Query::from(at + hit.normal * (0.001 + 0.0001 * number()))
    };
    (0..CONTACTS).map(step).collect()
}
