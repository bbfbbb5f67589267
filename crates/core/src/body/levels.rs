//! The levels of the whole body and of modalities: centres by distances along it, and rows that keep places.

use std::array::from_fn;
use std::cmp::Reverse;

use glam::DVec3;

use crate::body::graph::Graph;
use crate::body::rest::Rest;
use crate::body::{BodyLevel, BodyTaxel, Modality};
use crate::id::{IdVec, VertexId};
use crate::mesh::{TriMesh, boundary_edges};
use crate::numeric::{each_by_distance, hash, nearest_sources, place_hash, solve_system};
use crate::pyramid::{Level, LevelId, Prolongation, cells};
use crate::skin::{PatchId, Skin};

/// Two fields conflict within this many mean spacings, as on the levels of a patch.
const SEPARATION: f64 = 1.35;

/// By how much the separation grows until a level has less than two thirds of the fields of the one before.
const GROWTH: f64 = 1.15;
const LEAST_RATIO: f64 = 1.5;

/// The spacing of a field is its mean distance from this many others.
const NEIGHBOURS: usize = 4;

/// A level with fewer fields than this takes the most central ones first: a rim or an id says little of so few.
const FEW: usize = 12;

/// Sums of distances that differ by less, as a share of the largest, are equal.
const SAME_SHARE: f64 = 1e-9;

/// A field is a combination of some of this many nearest centres.
const NEAREST: usize = 5;

/// Weights of the sum, which is 1, and of distances in the fit of a row, over that of places: the sum is nearly exact, and of
/// combinations that keep a place as well the nearer centres have more weight. Both are those of the measurement in the module.
const SUM_WEIGHT: f64 = 10.0;
const DAMPING: f64 = 0.05;

/// The levels of the whole body above the coarsest levels of its patches, to one field; none of one patch. `links` are its
/// [gap links](crate::body::gap_links).
///
/// # Panics
/// If there is not one level for each patch, or one is not of this skin.
pub fn body_levels(
    skin: &Skin,
    links: &[[BodyTaxel; 2]],
    coarsest: &IdVec<PatchId, &Level>,
) -> IdVec<LevelId, BodyLevel> {
    let mut levels = IdVec::default();
    if skin.patches.len() < 2 {
        return levels;
    }
    let rest = Rest::new(skin);
    let graph = Graph::new(skin, &rest, links, coarsest);
    let places: Vec<DVec3> = graph.origins.iter().map(|&at| rest.positions[rest.number(at)]).collect();
    let priorities = priorities(skin, coarsest.iter().map(|level| &level.mesh), &graph);
    coarsen(&graph, &places, &priorities, (0..graph.origins.len()).collect(), &mut levels);
    levels
}

/// The fields of each modality besides touch, of each patch: level 0 has one for each sensor, the last level has one. Where
/// several patches have sensors of one, then those of the whole body. `links` are its [gap links](crate::body::gap_links).
///
/// # Panics
/// If there is not one level for each patch, or one is not level 0 of this skin.
pub fn modalities(skin: &Skin, links: &[[BodyTaxel; 2]], finest: &IdVec<PatchId, &Level>) -> Vec<Modality> {
    let mut all = Vec::new();
    for (id, patch) in skin.patches.enumerate() {
        let names = patch.taxels.other_modalities();
        if names.is_empty() {
            continue;
        }
        let graph = Graph::of_patch(id, &patch.mesh);
        let places = patch.mesh.positions.as_slice();
        let priorities = priorities(skin, [&patch.mesh].into_iter(), &graph);
        for name in names {
            let sensors: Vec<usize> = patch.taxels.sensors(name).into_iter().map(VertexId::index).collect();
            let mut levels = IdVec::default();
            let origins = sensors.iter().map(|&sensor| graph.origins[sensor]).collect();
            levels.push(BodyLevel { origins, rows: sensor_rows(&graph, &sensors, places) });
            coarsen(&graph, places, &priorities, sensors, &mut levels);
            all.push(Modality { patch: Some(id), name: name.to_owned(), levels });
        }
    }
    let of_body = of_body(skin, links, finest, &all);
    all.extend(of_body);
    all
}

/// The fields of the whole body of each modality that several patches have, above all sensors of it.
fn of_body(
    skin: &Skin,
    links: &[[BodyTaxel; 2]],
    finest: &IdVec<PatchId, &Level>,
    of_patches: &[Modality],
) -> Vec<Modality> {
    // Each at its second patch.
    let is_second = |(k, part): &(usize, &Modality)| {
        of_patches[..*k].iter().filter(|other| other.name == part.name).count() == 1
    };
    let names: Vec<&String> =
        of_patches.iter().enumerate().filter(is_second).map(|(_, part)| &part.name).collect();
    if names.is_empty() {
        return Vec::new();
    }
    let rest = Rest::new(skin);
    let graph = Graph::new(skin, &rest, links, finest);
    let priorities = priorities(skin, skin.patches.iter().map(|patch| &patch.mesh), &graph);
    let of_name = |name: &String| {
        let parts = of_patches.iter().filter(|part| part.name == *name);
        let sensors = parts.flat_map(Modality::sensors).map(|at| rest.number(at)).collect();
        let mut levels = IdVec::default();
        coarsen(&graph, &rest.positions, &priorities, sensors, &mut levels);
        Modality { patch: None, name: name.clone(), levels }
    };
    names.into_iter().map(of_name).collect()
}

/// Adds levels above these fields, by their numbers in the graph, to one field.
fn coarsen(
    graph: &Graph,
    places: &[DVec3],
    priorities: &[Priority],
    mut fields: Vec<usize>,
    levels: &mut IdVec<LevelId, BodyLevel>,
) {
    let mut scratch = Scratch::new(graph.origins.len());
    while fields.len() > 1 {
        let centres = choose(graph, &fields, priorities, &mut scratch);
        let rows = rows(graph, &fields, &centres, places, &mut scratch);
        let origins = centres.iter().map(|&field| graph.origins[field]).collect();
        levels.push(BodyLevel { origins, rows });
        fields = centres;
    }
}

/// The taxels of a patch in terms of some of them; each of those has a field of its own.
fn sensor_rows(graph: &Graph, sensors: &[usize], places: &[DVec3]) -> Prolongation {
    let numbers = sensors.iter().map(|&sensor| graph.origins[sensor].taxel.raw());
    let mut near = nearest_sources(&graph.ways, numbers, NEAREST);
    sensors.iter().enumerate().for_each(|(field, &sensor)| near[sensor] = vec![(field, 0.0)]);
    let (mut indices, mut weights) = (IdVec::default(), IdVec::default());
    for (near, &at) in near.iter().zip(places) {
        let row = row(at, near, |field| places[sensors[field]]);
        indices.push(row.map(|(field, _)| VertexId::new(field)));
        weights.push(row.map(|(_, weight)| weight));
    }
    Prolongation { indices, weights, coarse_len: sensors.len() }
}

/// Distances from a field; infinite but for those that were reached.
struct Scratch {
    distances: Vec<f64>,
    reached: Vec<u32>,
    /// The place of a field among those that are looked for.
    place: Vec<Option<usize>>,
}

impl Scratch {
    fn new(fields: usize) -> Self {
        Self { distances: vec![f64::INFINITY; fields], reached: Vec::new(), place: vec![None; fields] }
    }

    /// Looks for these fields from now on.
    fn seek(&mut self, fields: &[usize]) {
        self.place.fill(None);
        fields.iter().enumerate().for_each(|(k, &field)| self.place[field] = Some(k));
    }

    /// Visits the fields that are looked for by their distance, until `visit` is false.
    fn visit(&mut self, graph: &Graph, from: usize, mut visit: impl FnMut(usize, f64) -> bool) {
        let place = &self.place;
        each_by_distance(&graph.ways, from, &mut self.distances, &mut self.reached, |field, distance| {
            place[field as usize].is_none_or(|k| visit(k, distance))
        });
    }
}

/// The rank of a field, least first.
type Priority = (bool, bool, u64, Reverse<usize>);

/// For each field of the graph a key: rims first, then live taxels, then any order that depends on no axis; of patches that
/// share ids the one with more taxels first.
fn priorities<'a>(skin: &Skin, meshes: impl Iterator<Item = &'a TriMesh>, graph: &Graph) -> Vec<Priority> {
    let cells = skin.patches.map(|patch| patch.taxels.are_counted.then(|| cells(&patch.mesh.positions)));
    let mut is_inside = Vec::with_capacity(graph.origins.len());
    for mesh in meshes {
        let start = is_inside.len();
        is_inside.resize(start + mesh.positions.len(), true);
        boundary_edges(mesh).iter().flatten().for_each(|v| is_inside[start + v.index()] = false);
    }
    let key = |(field, at): (usize, &BodyTaxel)| {
        let patch = &skin.patches[at.patch];
        let is_silent = !patch.taxels.presence[at.taxel].reads_pressure();
        let any = match &cells[at.patch] {
            Some(cell) => place_hash(cell(patch.mesh.positions[at.taxel])),
            None => hash(u64::from(patch.taxels.ids[at.taxel].0)),
        };
        (is_inside[field], is_silent, any, Reverse(patch.taxels.ids.len()))
    };
    graph.origins.iter().enumerate().map(key).collect()
}

/// The centres among some fields, ascending: in the order of priority those that are in no conflict.
fn choose(graph: &Graph, fields: &[usize], priorities: &[Priority], scratch: &mut Scratch) -> Vec<usize> {
    scratch.seek(fields);
    let (mut spacing, mut sums) = (Vec::new(), Vec::new());
    let is_few = fields.len() < FEW;
    for &field in fields {
        let (mut sum, mut nearest, mut count) = (0.0, 0.0, 0_usize);
        scratch.visit(graph, field, |_, distance| {
            // The first is the field itself.
            sum += distance;
            if count <= NEIGHBOURS {
                nearest = sum / count.max(1) as f64;
            }
            count += 1;
            is_few || count <= NEIGHBOURS
        });
        spacing.push(nearest);
        sums.push(if is_few { sum } else { 0.0 });
    }
    // Of two fields both sums are their distance: equal but for rounding, which follows the frame.
    let largest = sums.iter().copied().fold(0.0, f64::max);
    sums.iter_mut().filter(|_| largest > 0.0).for_each(|sum| *sum = (*sum / largest / SAME_SHARE).round());
    let mut order: Vec<usize> = (0..fields.len()).collect();
    let key = |k: usize| (priorities[fields[k]], fields[k]);
    order.sort_by(|&a, &b| sums[a].total_cmp(&sums[b]).then(key(a).cmp(&key(b))));
    let widest = spacing.iter().copied().fold(0.0, f64::max);
    let mut separation = SEPARATION;
    loop {
        let mut is_ruled_out = vec![false; fields.len()];
        let mut centres = Vec::new();
        for &k in &order {
            if std::mem::replace(&mut is_ruled_out[k], true) {
                continue;
            }
            centres.push(fields[k]);
            scratch.visit(graph, fields[k], |other, distance| {
                // Equality counts: fields at one place have no spacing.
                is_ruled_out[other] |= distance <= 0.5 * separation * (spacing[k] + spacing[other]);
                distance <= 0.5 * separation * (spacing[k] + widest)
            });
        }
        if centres.len() == 1 || LEAST_RATIO * centres.len() as f64 <= fields.len() as f64 {
            centres.sort_unstable();
            return centres;
        }
        separation *= GROWTH;
    }
}

/// Each of the fields in terms of centres.
fn rows(
    graph: &Graph,
    fields: &[usize],
    centres: &[usize],
    places: &[DVec3],
    scratch: &mut Scratch,
) -> Prolongation {
    scratch.seek(centres);
    let (mut indices, mut weights) = (IdVec::default(), IdVec::default());
    for &field in fields {
        let mut near: Vec<(usize, f64)> = Vec::with_capacity(NEAREST);
        scratch.visit(graph, field, |centre, distance| {
            near.push((centre, distance));
            near.len() < NEAREST
        });
        let [a, b, c] = row(places[field], &near, |centre| places[centres[centre]]);
        indices.push([a, b, c].map(|(centre, _)| VertexId::new(centre)));
        weights.push([a, b, c].map(|(_, weight)| weight));
    }
    Prolongation { indices, weights, coarse_len: centres.len() }
}

/// Up to three of some centres with their distances, and weights that sum to one: of all choices the one that keeps the
/// place best. Unused slots have the first centre and the weight 0.
fn row(at: DVec3, near: &[(usize, f64)], place: impl Fn(usize) -> DVec3) -> [(usize, f64); 3] {
    let scale = near.iter().map(|(_, distance)| *distance).fold(1e-9, f64::max);
    let nearest = near.first().map_or(0, |(centre, _)| *centre);
    let mut best = (f64::INFINITY, [(nearest, 1.0), (nearest, 0.0), (nearest, 0.0)]);
    // Of a centre at the very place there is nothing to fit.
    if near.first().is_none_or(|(_, distance)| *distance == 0.0) {
        return best.1;
    }
    let count = near.len();
    let choices = (1_u32..1 << count).filter(|choice| choice.count_ones() <= 3);
    for choice in choices {
        let mut chosen = [None; 3];
        let of_choice =
            near.iter().enumerate().filter(|(k, _)| choice >> k & 1 == 1).map(|(_, centre)| *centre);
        chosen.iter_mut().zip(of_choice).for_each(|(slot, centre)| *slot = Some(centre));
        // Normal equations; an unused slot has the weight 0.
        let column = |slot: Option<(usize, f64)>| {
            slot.map(|(centre, distance)| ((place(centre) - at) / scale, distance))
        };
        let columns = chosen.map(column);
        let entry = |i: usize, j: usize| match (columns[i], columns.get(j).copied().flatten()) {
            // The right side.
            (Some(_), None) if j == columns.len() => SUM_WEIGHT * SUM_WEIGHT,
            (Some((p, distance)), Some((q, _))) => {
                let damping = if i == j { (DAMPING * distance / scale).powi(2) } else { 0.0 };
                p.dot(q) + SUM_WEIGHT * SUM_WEIGHT + damping
            }
            _ => f64::from(u8::from(i == j)),
        };
        let system: [[f64; 4]; 3] = from_fn(|i| from_fn(|j| entry(i, j)));
        let Some(weights) = solve_system(system).filter(|weights| weights.iter().all(|w| *w >= 0.0)) else {
            continue;
        };
        let used = || columns.iter().zip(weights).filter_map(|(column, w)| Some(((*column)?, w)));
        let miss = used().map(|((p, _), w)| w * p).sum::<DVec3>().length_squared();
        let sum: f64 = weights.iter().sum();
        let damping: f64 = used().map(|((_, distance), w)| (DAMPING * distance / scale * w).powi(2)).sum();
        let squares = miss + (SUM_WEIGHT * (sum - 1.0)).powi(2) + damping;
        if squares < best.0 {
            let slot = |k: usize| chosen[k].map_or((nearest, 0.0), |(centre, _)| (centre, weights[k] / sum));
            best = (squares, [slot(0), slot(1), slot(2)]);
        }
    }
    best.1
}
