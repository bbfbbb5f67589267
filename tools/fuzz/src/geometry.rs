//! Arbitrary triangles through every room: assembled, remeshed, cut, coarsened, flattened, located, drawn, written.
//!
//! An input is the text of an OBJ file, so that it can be made smaller by lines; options follow from the seed.

use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::sync::Arc;

use dermatome::atlas::{Atlas, AtlasOptions, Pack, Resolution};
use dermatome::contact::IndexOptions;
use dermatome::flatten::{Boundary, Energy, FlattenOptions, Method, Overlap, distortion};
use dermatome::io::{self, map_to_bytes};
use dermatome::map::SkinMap;
use dermatome::mesh::{Adjacency, FillHoles, TriMesh, shapes};
use dermatome::pyramid::{CoarsenOptions, coarsen};
use dermatome::run::Run;
use dermatome::skin::{Patch, Sheet, TaxelId, Weld, check as check_draft, world_pose};
use dermatome::unfold::Unfolding;
use dermatome::{
    AssembleOptions, BuildOptions, ContactIndex, Draft, LevelId, MapIndex, Query, Skin, assemble, build, cut,
    remesh,
};
use glam::{DQuat, DVec3};
use mutate::Random;

use crate::{Counts, Outcome, in_two_threads, text};

/// Larger skins are not built: an execution takes milliseconds.
const MAX_TRIANGLES: usize = 2000;

/// Farther skins have maps beyond 1e12 m, which are refused late, as they are written.
const FARTHEST: f64 = 1e11;

type Soup = (Vec<DVec3>, Vec<[u32; 3]>);

fn point(random: &mut Random) -> DVec3 {
    DVec3::new(random.signed(), random.signed(), random.signed())
}

fn number(random: &mut Random, low: u32, bound: usize) -> u32 {
    low + u32::try_from(random.below(bound)).unwrap_or(0)
}

pub(crate) fn generate(random: &mut Random) -> (String, Vec<u8>) {
    let mut soup = shape(random);
    for _ in 0..if random.chance(0.35) { 0 } else { 1 + random.below(4) } {
        if !soup.1.is_empty() {
            damage(&mut soup, random);
        }
    }
    let mut text = String::new();
    for p in &soup.0 {
        let _ = writeln!(text, "v {:?} {:?} {:?}", p.x, p.y, p.z);
    }
    for [a, b, c] in &soup.1 {
        let _ = writeln!(text, "f {a} {b} {c}");
    }
    ("soup.obj".to_owned(), text.into_bytes())
}

/// A named shape, a band with twists, two sheets that may share a vertex or an edge, a prism, or faces without order.
fn shape(random: &mut Random) -> Soup {
    let of = |mesh: TriMesh| {
        (mesh.positions.as_slice().to_vec(), mesh.triangles.iter().map(|t| t.map(|v| v.raw())).collect())
    };
    let fine = random.unit();
    match random.below(12) {
        0 | 1 => {
            let (count, faces) = (3 + random.below(10), 1 + random.below(14));
            let positions = (0..count).map(|_| point(random)).collect();
            (positions, (0..faces).map(|_| [0; 3].map(|_: u32| number(random, 0, count))).collect())
        }
        2 | 3 => {
            let [columns, rows] = [0; 2].map(|_| number(random, 2, 7));
            let bend = |i: u32, j: u32| fine * (1.3 * f64::from(i) + 6.0 * fine).sin() * f64::from(j).cos();
            of(shapes::sheet(columns, rows, |i, j| DVec3::new(i.into(), j.into(), bend(i, j)) * 0.01))
        }
        4 => of(shapes::tube(
            number(random, 3, 8),
            number(random, 2, 6),
            0.01 + 0.05 * fine,
            0.01 + 0.2 * random.unit(),
        )),
        5 => of(shapes::torus(number(random, 3, 6), number(random, 3, 5), 0.05, 0.01 + 0.03 * fine)),
        6 => of(shapes::ball(number(random, 1, 4), 0.05)),
        7 => of(shapes::frame(number(random, 1, 2), number(random, 1, 2), 0.05)),
        8 => of(shapes::cap(10 + random.below(120), 0.05, 0.2 + 2.8 * fine)),
        9 => band(random),
        10 => {
            let mut sheet = || of(shapes::lattice(number(random, 2, 4), number(random, 2, 4), 0.01));
            let (mut soup, other): (Soup, Soup) = (sheet(), sheet());
            let (first, shared) = (u32::try_from(soup.0.len()).unwrap_or(0), number(random, 0, 3));
            let turn = DQuat::from_rotation_y(3.0 * fine);
            soup.0.extend(other.0.iter().map(|&p| turn * p));
            soup.1.extend(other.1.iter().map(|face| face.map(|v| if v < shared { v } else { v + first })));
            soup
        }
        _ => prism(random),
    }
}

/// A band around an axis with 0 to 3 half turns: with 1 or 3 it has one side.
fn band(random: &mut Random) -> Soup {
    let (count, turns) = (number(random, 4, 12), number(random, 0, 4));
    let at = |i: u32, side: f64| {
        let angle = f64::from(i) / f64::from(count) * TAU;
        let tilt = angle * f64::from(turns) / 2.0;
        let radius = 0.05 + 0.01 * side * tilt.cos();
        DVec3::new(radius * angle.cos(), radius * angle.sin(), 0.01 * side * tilt.sin())
    };
    let last = if turns % 2 == 1 { [1, 0] } else { [0, 1] };
    let faces = |i: u32| {
        let (a, b) = (2 * i, 2 * i + 1);
        let [c, d] = if i + 1 < count { [a + 2, b + 2] } else { last };
        [[a, c, b], [b, c, d]]
    };
    ((0..count).flat_map(|i| [at(i, -1.0), at(i, 1.0)]).collect(), (0..count).flat_map(faces).collect())
}

/// A closed prism, as CAD has them.
fn prism(random: &mut Random) -> Soup {
    let (count, height) = (number(random, 3, 8), 0.01 + 0.3 * random.unit());
    let rim = |k: u32| {
        let angle = f64::from(k % count) / f64::from(count) * TAU;
        DVec3::new(0.05 * angle.cos(), 0.05 * angle.sin(), if k < count { 0.0 } else { height })
    };
    let faces = |i: u32| {
        let (j, n) = ((i + 1) % count, count);
        [[i, j, n + i], [j, n + j, n + i], [2 * n, j, i], [2 * n + 1, n + i, n + j]]
    };
    (
        (0..2 * count).map(rim).chain([DVec3::ZERO, DVec3::Z * height]).collect(),
        (0..count).flat_map(faces).collect(),
    )
}

/// One fault of a mesh.
fn damage((positions, faces): &mut Soup, random: &mut Random) {
    let (face, vertex, other) =
        (random.below(faces.len()), random.below(positions.len()), random.below(positions.len()));
    let last = u32::try_from(positions.len()).unwrap_or(0);
    let [a, b, c] = faces[face];
    match random.below(16) {
        0 => drop(faces.remove(face)),
        1 => faces[face] = [b, a, c],
        2 => faces.push([a, b, c]),
        3 => positions[vertex] = positions[other],
        // Two vertices become one: edges of more than two faces, faces with a corner twice.
        4 => faces
            .iter_mut()
            .flatten()
            .filter(|v| **v as usize == vertex)
            .for_each(|v| *v = number(random, 0, 1)),
        5 => faces[face] = [0; 3].map(|_: u32| number(random, 0, positions.len())),
        6 => positions[vertex] += 0.02 * point(random),
        7 => positions[vertex] *= *random.pick(&[1e-9, 1e3, -1.0, 1.0 + 1e-15]),
        8 => {
            // A face without area on a side.
            positions.push(positions[a as usize].lerp(positions[b as usize], random.unit()));
            faces.push([b, a, last]);
        }
        9 => {
            positions.push((positions[a as usize] + positions[b as usize] + positions[c as usize]) / 3.0);
            faces[face] = [a, b, last];
            faces.extend([[b, c, last], [c, a, last]]);
        }
        10 => positions.iter_mut().for_each(|p| p.z = 0.0),
        11 => {
            positions.iter_mut().for_each(|p| *p = DVec3::X * p.x);
            positions[vertex].y = 0.01;
        }
        12 => {
            let scale = *random.pick(&[1e-6, 1e-3, 1e3, 1e6, 1e9]);
            positions.iter_mut().for_each(|p| *p *= scale);
        }
        13 => positions.iter_mut().for_each(|p| *p = (*p * 200.0).round() / 200.0),
        14 => {
            let thin = *random.pick(&[1e-3, 1e-6, 30.0]);
            positions.iter_mut().for_each(|p| p.y *= thin);
        }
        _ => {
            let away = DVec3::splat(*random.pick(&[1e3, 1e6, 1e9]));
            positions.iter_mut().for_each(|p| *p += away);
        }
    }
}

/// Lines that are not whole are skipped: they occur while an input is made smaller.
fn parse(bytes: &[u8]) -> Soup {
    let (mut positions, mut faces) = (Vec::new(), Vec::new());
    for line in String::from_utf8_lossy(bytes).lines() {
        let words: Vec<&str> = line.split(' ').collect();
        if let [kind, a, b, c] = words[..] {
            let numbers = [a, b, c].map(|word| word.parse::<f64>().unwrap_or(f64::NAN));
            match (kind, [a, b, c].map(|word| word.parse::<u32>().ok())) {
                ("f", [Some(a), Some(b), Some(c)]) => faces.push([a, b, c]),
                ("v", _) if numbers.iter().all(|x| x.is_finite()) => positions.push(DVec3::from(numbers)),
                _ => {}
            }
        }
    }
    let count = positions.len();
    faces.retain(|face| face.iter().all(|&v| (v as usize) < count));
    (positions, faces)
}

pub(crate) fn check(_: &str, bytes: &[u8], random: &mut Random, counts: &mut Counts) -> Outcome {
    let mut draft = draft(parse(bytes), random);
    if random.chance(0.15) {
        remesh::keep_outer(&mut draft);
    }
    let options = AssembleOptions {
        gap: *random.pick(&[2.5, 1.0, 5.0, 20.0]),
        fill_holes: *random.pick(&[FillHoles::None, FillHoles::PinHoles, FillHoles::UpTo(8)]),
        weld: *random.pick(&[Weld::Auto, Weld::All, Weld::None]),
        repair: random.chance(0.7),
        outside: random.chance(0.1).then_some(DVec3::Z),
        keep_going: random.chance(0.7),
    };
    check_draft(&draft, &options).iter().for_each(|finding| drop(finding.message()));
    let Ok(assembled) = assemble(&draft, &options) else { return Ok(()) };
    *counts.entry("assembled").or_default() += 1;
    let mut skin = assembled.skin;
    check_skin("assembled", &skin)?;
    if random.chance(0.05) {
        let area: f64 = skin.patches.iter().map(|patch| patch.mesh.area()).sum();
        let corners =
            skin.patches.iter().flat_map(|p| p.mesh.triangles.ids().map(|face| p.mesh.corners(face)));
        let longest = corners.map(|[a, b, c]| a.distance(b).max(b.distance(c))).fold(0.0, f64::max);
        let spacing = (area / random.pick(&[3.0, 10.0, 40.0, 150.0])).sqrt();
        // The edges of a needle take long, and show nothing new.
        if longest <= 30.0 * spacing
            && let Ok(remeshed) =
                remesh::remesh_skin(&skin, &vec![spacing; skin.patches.len()], Run::default())
            && !remeshed.skin.patches.is_empty()
        {
            *counts.entry("remeshed").or_default() += 1;
            check_skin("remeshed", &remeshed.skin)?;
            skin = remeshed.skin;
        }
    }
    let is_far = |patch: &Patch| patch.mesh.positions.iter().any(|p| p.abs().max_element() > FARTHEST);
    let triangles: usize = skin.patches.iter().map(|patch| patch.mesh.triangles.len()).sum();
    if triangles > MAX_TRIANGLES || skin.patches.iter().any(is_far) {
        return Ok(());
    }
    check_maps(&skin, &build_options(random), random, counts)
}

fn draft((positions, triangles): Soup, random: &mut Random) -> Draft {
    let count = positions.len();
    let mut column = |chance: f64, low: f64, high: f64| {
        random
            .chance(chance)
            .then(|| (0..count).map(|_| 10_f64.powf(low + (high - low) * random.unit())).collect())
    };
    let (densities, weights) = (column(0.1, -4.0, 4.0), column(0.1, -3.0, 3.0));
    let ids = random.chance(0.3).then(|| (0..count).map(|k| TaxelId(number(random, 0, k + 1))).collect());
    let sheet = Sheet { name: "a".into(), positions, triangles, densities, weights, ids, ..Sheet::default() };
    let mut draft = Draft { sheets: vec![sheet], ..Draft::default() };
    if random.chance(0.2) {
        let mut other = Sheet { name: "b".into(), ..draft.sheets[0].clone() };
        other.positions.iter_mut().for_each(|p| *p = *p * 0.7 + DVec3::new(0.003, 0.0, 0.004));
        draft.sheets.push(other);
    }
    draft
}

fn build_options(random: &mut Random) -> BuildOptions {
    let energy = Energy::Sum {
        angle: *random.pick(&[1.0, 1.0, 0.1, 0.0, 1e6]),
        area: *random.pick(&[1.0, 1.0, 0.1, 1e-6]),
        perimeter: *random.pick(&[0.0, 0.0, 0.1, 1.0]),
    };
    let energy = *random.pick(&[Energy::SymmetricDirichlet, energy]);
    let intrinsic = Method::Intrinsic { energy, magnify: *random.pick(&[0.0, 0.0, 0.5, 1.0, -1.0]) };
    let method = match random.below(8) {
        0 => Method::Conformal,
        1 => Method::Linear { angle: 1.0, area: 0.1 },
        _ => intrinsic,
    };
    let overlap = if random.chance(0.15) { Overlap::Allow } else { Overlap::Prevent };
    let boundary = if random.chance(0.1) { Boundary::Circle } else { Boundary::Free };
    BuildOptions {
        cut: random
            .pick(&[cut::Cut::Auto, cut::Cut::Auto, cut::Cut::All, cut::Cut::AreaRatio(1.5), cut::Cut::None])
            .clone(),
        coarsen: CoarsenOptions {
            ratio: random.chance(0.3).then(|| 1.5 + 4.0 * random.unit()),
            levels: random.chance(0.2).then(|| random.below(4)),
            coarsest: *random.pick(&[3, 4, 6, 12, 32]),
        },
        flatten: FlattenOptions { method, overlap, boundary },
        keep_going: random.chance(0.7),
        ..BuildOptions::default()
    }
}

fn check_skin(what: &str, skin: &Skin) -> Outcome {
    skin.validate().map_err(|error| format!("the {what} skin is not valid: {error}"))?;
    for patch in &skin.patches {
        Adjacency::new(&patch.mesh).map_err(|error| format!("a {what} patch is no manifold: {error}"))?;
    }
    Ok(())
}

fn check_maps(skin: &Skin, options: &BuildOptions, random: &mut Random, counts: &mut Counts) -> Outcome {
    for patch in &skin.patches {
        if let Ok(pyramid) = coarsen(&patch.mesh, &patch.taxels, &options.coarsen, Run::default()) {
            pyramid.validate().map_err(|error| format!("a pyramid is not valid: {error}"))?;
        }
    }
    let Ok(map) = build(skin, options) else { return Ok(()) };
    *counts.entry("built").or_default() += 1;
    let is_intrinsic = matches!(options.flatten.method, Method::Intrinsic { .. });
    check_map(&map, is_intrinsic, is_intrinsic && options.flatten.overlap == Overlap::Prevent)?;
    check_lookups(&map, random)?;
    let bytes = map_to_bytes(&map).map_err(|error| format!("a map cannot be written: {error}"))?;
    let back = io::map_from_bytes(bytes.clone())
        .map_err(|error| format!("a written map cannot be read: {error}"))?;
    back.validate().map_err(|error| format!("a written map is not valid: {error}"))?;
    if random.chance(0.1) {
        let again = in_two_threads(|| build(skin, options))?.map_err(text)?;
        if map_to_bytes(&again).map_err(text)? != bytes {
            return Err("two threads make another map than one".into());
        }
    }
    for patch in &map.patches {
        let unfolding = Unfolding::new(patch).map_err(|error| format!("no unfolding: {error}"))?;
        if [0.0, 0.25, 1.0].iter().any(|&time| unfolding.at(time).iter().any(|p| !p.is_finite())) {
            return Err("an unfolding is not finite".into());
        }
    }
    let resolution = match random.below(3) {
        0 => Resolution::Map,
        _ => Resolution::Canvas([number(random, 1, 60), number(random, 1, 60)]),
    };
    let pack = *random.pick(&[None, Some(Pack::Tight), Some(Pack::Body)]);
    if let Ok(atlas) = Atlas::new(&map, &AtlasOptions { resolution, pack }) {
        *counts.entry("packed").or_default() += 1;
        atlas.images(&Arc::new(map), None);
    }
    Ok(())
}

fn check_map(map: &SkinMap, never_flips: bool, never_overlaps: bool) -> Outcome {
    map.validate().map_err(|error| format!("a built map is not valid: {error}"))?;
    for patch in &map.patches {
        for (id, level) in patch.levels.enumerate() {
            let found = distortion(&level.opened(), &level.opened_uv());
            if never_flips && found.flips > 0 || never_overlaps && found.crossings > 0 {
                return Err(format!("{} flips, {} crossings on level {id:?}", found.flips, found.crossings));
            }
            if [found.qc_mean, found.area_mean, found.symmetric_dirichlet].iter().any(|x| x.is_nan()) {
                return Err("the distortion is NaN".into());
            }
            for rows in level.level.to_finest.iter().chain(&level.level.from_coarser) {
                let is_valid =
                    |w: &[f64]| (w.iter().sum::<f64>() - 1.0).abs() < 1e-9 && w.iter().all(|x| *x > -1e-12);
                if !rows.weights.iter().all(|weights| is_valid(&weights[..])) {
                    return Err("a row of weights whose sum is not 1".into());
                }
            }
            let [whole, sum] =
                [&patch.levels[LevelId::new(0)], level].map(|level| level.level.areas.iter().sum::<f64>());
            if (sum - whole).abs() > 1e-6 * whole {
                return Err("the areas of a level have another sum than those of the skin".into());
            }
        }
    }
    Ok(())
}

/// Distance to a triangle by cases.
fn distance(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let to_side = |a: DVec3, b: DVec3| {
        let t = (p - a).dot(b - a) / (b - a).length_squared();
        p.distance(a.lerp(b, if t > 0.0 { t.min(1.0) } else { 0.0 }))
    };
    let around = to_side(a, b).min(to_side(b, c)).min(to_side(c, a));
    let (cross, longest) =
        ((b - a).cross(c - a), a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a)));
    if cross.length() <= 1e-10 * longest {
        return around;
    }
    let normal = cross.normalize();
    let is_inner = |a: DVec3, b: DVec3| (b - a).cross(p - a).dot(normal) >= 0.0;
    let is_above = is_inner(a, b) && is_inner(b, c) && is_inner(c, a);
    if is_above { (p - a).dot(normal).abs().min(around) } else { around }
}

/// Lookups against brute force, alone and in a batch.
fn check_lookups(map: &SkinMap, random: &mut Random) -> Outcome {
    let mut triangles = Vec::new();
    for patch in &map.patches {
        let (pose, mesh) = (world_pose(&map.links, patch.link), &patch.levels[LevelId::new(0)].level.mesh);
        triangles
            .extend(mesh.triangles.ids().map(|face| mesh.corners(face).map(|p| pose.transform_point3(p))));
    }
    let corners = || triangles.iter().flatten().copied();
    let (low, high) =
        (corners().fold(DVec3::INFINITY, DVec3::min), corners().fold(DVec3::NEG_INFINITY, DVec3::max));
    let (size, far) = ((high - low).max_element(), low.abs().max(high.abs()).max_element());
    let index = ContactIndex::with_options(map, &IndexOptions { reactive: true, fields: true })
        .map_err(|error| format!("a map without an index: {error}"))?;
    let points: Vec<DVec3> = (0..12)
        .map(|_| match random.below(8) {
            0 => random.pick(&triangles)[0],
            1 => 1e3 * high,
            _ => (low + high) / 2.0 + 0.8 * (high - low) * point(random),
        })
        .filter(|p| p.abs().max_element() < 1e12)
        .collect();
    for &p in &points {
        let hit = index.locate(p).map_err(text)?;
        let expected = triangles.iter().map(|&t| distance(p, t)).fold(f64::INFINITY, f64::min);
        let tolerance = 1e-9 * (size + expected) + 1e-12 * (far + p.length());
        if (hit.distance.abs() - expected).abs() > tolerance
            || (hit.position.distance(p) - expected).abs() > tolerance
        {
            return Err(format!(
                "located at {:e}, the nearest face is at {expected:e}, from {p:?}",
                hit.distance
            ));
        }
        let bound = index.reactive(p).map_err(text)?;
        if bound.least > expected + tolerance || bound.most < expected - tolerance {
            return Err(format!(
                "the bounds {:e} and {:e} miss {expected:e} from {p:?}",
                bound.least, bound.most
            ));
        }
        let fields = index.nearest_fields(p, 3, LevelId::new(0)).map_err(text)?;
        let nearest = corners().map(|corner| corner.distance(p)).fold(f64::INFINITY, f64::min);
        if fields.first().is_none_or(|field| {
            (field.distance - nearest).abs() > 1e-9 * (size + nearest) + 1e-12 * (far + p.length())
        }) {
            return Err(format!("the nearest taxel is not at {nearest:e} from {p:?}: {fields:?}"));
        }
    }
    let all = index.locate_all(&points.iter().map(|&p| Query::from(p)).collect::<Vec<_>>(), Run::default());
    let all = all.map_err(text)?;
    if points.iter().enumerate().any(|(k, &p)| all.get(k) != index.locate(p).ok()) {
        return Err("a batch answers otherwise".into());
    }
    let places = MapIndex::new(map).map_err(|error| format!("a map without an index of places: {error}"))?;
    let mut found = Vec::new();
    for (id, patch) in map.patches.enumerate() {
        for (of, level) in patch.levels.enumerate() {
            let pixel = level.frame.size_px.map(|size| number(random, 0, size.max(1) as usize));
            let uv = level.frame.centre(pixel);
            found.clear();
            places.places(id, of, uv, &mut found).map_err(text)?;
            let on_map = level
                .level
                .mesh
                .triangles
                .ids()
                .map(|face| level.places(face).map(|v| level.uv[v].extend(0.0)));
            let expected = on_map.map(|t| distance(uv.extend(0.0), t)).fold(f64::INFINITY, f64::min);
            let size = level.uv.iter().map(|uv| uv.abs().max_element()).fold(0.0, f64::max);
            if found.first().is_none_or(|place| (place.off_chart - expected).abs() > 1e-8 * size) {
                let found = found.first().map(|place| place.off_chart);
                return Err(format!("a pixel is {expected:e} from a map of size {size:e}, not {found:?}"));
            }
        }
    }
    Ok(())
}
