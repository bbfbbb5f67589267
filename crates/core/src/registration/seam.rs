//! The seam of an atlas, carried to a closed skin: a rough match of both surfaces in space.
//!
//! A closed skin that is cut along another seam than its atlas has other neighbours on the map: of two gloves whose seams
//! were 4.5 mm apart in the median, taxels missed their places by 9.5 mm, and by 1.6 mm with the seam of the atlas.
//!
//! The atlas is bent in space, as rigidly as possible `(sorkine2007)`: its landmarks are held at those of the skin, and
//! other vertices are drawn to the nearest place of the skin that faces their way, more and more. Where the vertices of its
//! seam come to, the skin is cut, along shortest paths of its edges.

use std::collections::BTreeSet;

use glam::{DMat3, DQuat, DVec3};

use crate::calib::nearest_rotation;
use crate::id::{IdVec, VertexId};
use crate::map::{MapLevel, PatchMap, SkinMap};
use crate::mesh::{TriMesh, boundary_edges, cotangent, edges, neighbours, surface_normals};
use crate::nearest::NearestFaces;
use crate::numeric::{Csr, DisjointSets, each_by_distance};
use crate::pyramid::LevelId;
use crate::registration::RegistrationError;
use crate::registration::landmarks::{FEWEST, Landmarks, nearest_in_space};
use crate::skin::{Patch, PatchId, Skin, TaxelId};
use crate::sparse::{Cholesky, Matrix, Pattern, SparseError};

/// The atlas is bent on its finest level with at most this many vertices: the match is rough.
const MOST_VERTICES: usize = 4000;

/// Rounds of the match: in the first ones landmarks alone hold it.
const ROUNDS: u32 = 25;
const HELD_ALONE: u32 = 8;

/// How often rotations and positions are found in turn in a round.
const TURNS: usize = 4;

/// How much stiffer landmarks are than an edge.
const HOLD: f64 = 1e3;

/// How strongly a vertex is drawn to the skin at first, as a share of an edge; it doubles every three rounds.
const DRAW: f64 = 0.02;

/// The seams of the atlas on the closed patches of a skin, as pairs of ids of taxels that an edge joins: see
/// [`Cut::Along`](crate::cut::Cut::Along). Nothing for patches that have a boundary, whose patch of the atlas has no seam, or
/// that have fewer than four landmarks.
///
/// # Errors
/// If the system of a match does not fit into memory.
pub fn carried_seams(
    skin: &Skin,
    atlas: &SkinMap,
    landmarks: &Landmarks,
) -> Result<Vec<[TaxelId; 2]>, RegistrationError> {
    let mut seams = Vec::new();
    for (id, patch) in skin.patches.enumerate() {
        if !boundary_edges(&patch.mesh).is_empty() {
            continue;
        }
        let pairs = pairs_of(skin, id, atlas, landmarks);
        // In the patch of the atlas that has most landmarks.
        let count = |other: PatchId| pairs.iter().filter(|(at, ..)| *at == other).count();
        let Some(of) = pairs.iter().map(|&(at, ..)| at).max_by_key(|&at| (count(at), std::cmp::Reverse(at)))
        else {
            continue;
        };
        let own: Vec<(DVec3, DVec3)> =
            pairs.into_iter().filter(|(at, ..)| *at == of).map(|(_, from, to)| (from, to)).collect();
        if own.len() >= FEWEST {
            let system = |source| RegistrationError::System { patch: patch.name.clone(), source };
            let seam = carried_seam(patch, &atlas.patches[of], &own).map_err(system)?;
            seams.extend(seam.into_iter().map(|ends| ends.map(|v| patch.taxels.ids[v])));
        }
    }
    Ok(seams)
}

/// The landmarks of a patch: the patch of the atlas, and the place on it and on the skin, in the frames of their links.
fn pairs_of(
    skin: &Skin,
    id: PatchId,
    atlas: &SkinMap,
    landmarks: &Landmarks,
) -> Vec<(PatchId, DVec3, DVec3)> {
    let at_taxel = |patch: &PatchMap, v: VertexId| patch.levels[LevelId::new(0)].level.mesh.positions[v];
    match landmarks {
        Landmarks::Taxels(all) => {
            let own = all.iter().filter(|landmark| landmark.taxel.0 == id);
            let pair = |landmark: &crate::registration::Landmark| {
                let (other, v) = landmark.atlas;
                let own = skin.patches[id].mesh.positions[landmark.taxel.1];
                (other, at_taxel(&atlas.patches[other], v), own)
            };
            own.map(pair).collect()
        }
        Landmarks::Regions => {
            let own = nearest_in_space(&skin.patches[id].mesh, &skin.patches[id].taxels);
            let mut pairs = Vec::new();
            for (other, patch) in atlas.patches.enumerate() {
                let theirs = nearest_in_space(&patch.levels[LevelId::new(0)].level.mesh, &patch.taxels);
                for (name, v) in &theirs {
                    if let Some((_, w)) = own.iter().find(|(known, _)| known == name) {
                        pairs.push((other, at_taxel(patch, *v), skin.patches[id].mesh.positions[*w]));
                    }
                }
            }
            pairs
        }
    }
}

/// The seam of a patch of the atlas on a closed patch; empty where it has none.
fn carried_seam(
    patch: &Patch,
    of: &PatchMap,
    landmarks: &[(DVec3, DVec3)],
) -> Result<Vec<[VertexId; 2]>, SparseError> {
    let level = of.levels.iter().find(|level| level.level.mesh.positions.len() <= MOST_VERTICES);
    let Some(level) = level.or(of.levels.iter().last()) else { return Ok(Vec::new()) };
    let seam = level.seam();
    let Ok(faces) = NearestFaces::new(patch.mesh.clone()) else { return Ok(Vec::new()) };
    if seam.is_empty() {
        return Ok(Vec::new());
    }
    let bent = bent_in_space(level, &faces, landmarks)?;
    let normals = surface_normals(&bent);
    // Where each vertex of the seam comes to.
    let place = |v: VertexId| {
        let (face, closest) = faces.nearest(bent.positions[v], normals[v], &mut None)?;
        let weights = closest.barycentric;
        let nearest = (0..3).fold(0, |best, k| if weights[k] > weights[best] { k } else { best });
        Some(patch.mesh.triangles[face][nearest])
    };
    let graph = lengths_of_edges(&patch.mesh);
    let mut distances = vec![f64::INFINITY; patch.mesh.positions.len()];
    let mut used: BTreeSet<[VertexId; 2]> = BTreeSet::new();
    let mut ends: BTreeSet<VertexId> = BTreeSet::new();
    let degree = |v: VertexId| seam.iter().flatten().filter(|&&other| other == v).count();
    let mut reached = Vec::new();
    for &[a, b] in &seam {
        let (Some(from), Some(to)) = (place(a), place(b)) else { continue };
        ends.extend([(a, from), (b, to)].into_iter().filter(|(v, _)| degree(*v) == 1).map(|(_, at)| at));
        each_by_distance(&graph, from.index(), &mut distances, &mut reached, |v, _| v != to.raw());
        let mut at = to;
        while at != from {
            let before = graph[at.index()].iter().min_by(|(v, x), (w, y)| {
                (distances[*v as usize] + x).total_cmp(&(distances[*w as usize] + y)).then(v.cmp(w))
            });
            let Some(&(before, _)) = before else { break };
            let before = VertexId::from(before);
            used.insert([at.min(before), at.max(before)]);
            at = before;
        }
    }
    Ok(tree_of(used, &ends, patch.mesh.positions.len()))
}

/// A tree of these edges without branches that end elsewhere than at `ends`.
fn tree_of(edges: BTreeSet<[VertexId; 2]>, ends: &BTreeSet<VertexId>, vertices: usize) -> Vec<[VertexId; 2]> {
    let mut sets = DisjointSets::<VertexId>::new(vertices);
    let mut tree: Vec<[VertexId; 2]> = Vec::new();
    for [a, b] in edges {
        if sets.root(a) != sets.root(b) {
            sets.join(a, b);
            tree.push([a, b]);
        }
    }
    loop {
        let mut degrees = IdVec::<VertexId, u32>::filled(0, vertices);
        tree.iter().flatten().for_each(|&v| degrees[v] += 1);
        let before = tree.len();
        let is_loose = |v: &VertexId| degrees[*v] == 1 && !ends.contains(v);
        tree.retain(|edge| !edge.iter().any(is_loose));
        if tree.len() == before {
            return tree;
        }
    }
}

/// The neighbours of each vertex, with the lengths of edges.
fn lengths_of_edges(mesh: &TriMesh) -> Csr<(u32, f64)> {
    let around = neighbours([mesh]);
    let at = |v: usize| mesh.positions[VertexId::new(v)];
    let mut graph = Csr::with_capacity(around.len(), around.items().len());
    for (v, others) in around.iter().enumerate() {
        graph.push(others.iter().map(|&w| (w, at(v).distance(at(w as usize)))));
    }
    graph
}

/// A level of the atlas, bent onto the faces of a skin; `landmarks` are places of both.
fn bent_in_space(
    level: &MapLevel,
    faces: &NearestFaces,
    landmarks: &[(DVec3, DVec3)],
) -> Result<TriMesh, SparseError> {
    let mesh = &level.level.mesh;
    let count = landmarks.len() as f64;
    let from = landmarks.iter().map(|(p, _)| *p).sum::<DVec3>() / count;
    let to = landmarks.iter().map(|(_, q)| *q).sum::<DVec3>() / count;
    let mut product = DMat3::ZERO;
    for (p, q) in landmarks {
        let (p, q) = (*p - from, *q - to);
        product += DMat3::from_cols(q * p.x, q * p.y, q * p.z);
    }
    let turn = nearest_rotation(&product);
    let squares: f64 = landmarks.iter().map(|(p, _)| p.distance_squared(from)).sum();
    let scale = landmarks.iter().map(|(p, q)| (turn * (*p - from)).dot(*q - to)).sum::<f64>() / squares;
    let placed = |p: DVec3| to + scale * (turn * (p - from));
    let rest = mesh.positions.map(|&p| placed(p));
    // The nearest vertex is held where its landmark belongs.
    let held: Vec<(VertexId, DVec3)> = landmarks
        .iter()
        .filter_map(|&(p, q)| {
            let far = |v: &VertexId| mesh.positions[*v].distance_squared(p);
            let v = mesh.positions.ids().min_by(|a, b| far(a).total_cmp(&far(b)))?;
            Some((v, q + rest[v] - placed(p)))
        })
        .collect();
    let stiffness = stiffness(mesh, &rest);
    let mean = stiffness.iter().map(|(_, weight)| weight).sum::<f64>() / stiffness.len().max(1) as f64;
    let pattern = Pattern::new(rest.len(), stiffness.iter().map(|([a, b], _)| (a.index(), b.index())));
    let cholesky = Cholesky::new(&pattern, rest.as_slice())?;
    let mut bent = TriMesh { positions: rest.clone(), triangles: mesh.triangles.clone() };
    for round in 0..ROUNDS {
        let mut pulls: Vec<(VertexId, f64, DVec3)> =
            held.iter().map(|&(v, at)| (v, HOLD * mean, at)).collect();
        if round >= HELD_ALONE {
            let draw = mean * DRAW * (f64::from(round - HELD_ALONE) / 3.0).exp2();
            let normals = surface_normals(&bent);
            for (v, &at) in bent.positions.enumerate() {
                let near = faces.nearest(at, normals[v], &mut None);
                pulls.extend(near.map(|(face, closest)| {
                    let corners = faces.mesh.corners(face).into_iter().zip(closest.barycentric);
                    (v, draw, corners.map(|(corner, weight)| weight * corner).sum())
                }));
            }
        }
        let mut matrix = Matrix::<f64>::zero(&pattern);
        for &([a, b], weight) in &stiffness {
            let [a, b] = [a.index(), b.index()];
            *matrix.at(a, a) += weight;
            *matrix.at(b, b) += weight;
            *matrix.at(a, b) -= weight;
            *matrix.at(b, a) -= weight;
        }
        pulls.iter().for_each(|&(v, weight, _)| *matrix.at(v.index(), v.index()) += weight);
        let factor = cholesky.factor(&matrix)?;
        for _ in 0..TURNS {
            let mut spreads = rest.map(|_| DMat3::ZERO);
            for &([a, b], weight) in &stiffness {
                let (p, q) = (rest[a] - rest[b], bent.positions[a] - bent.positions[b]);
                let spread = DMat3::from_cols(q * p.x, q * p.y, q * p.z) * weight;
                spreads[a] += spread;
                spreads[b] += spread;
            }
            let rotations: IdVec<VertexId, DQuat> = spreads.map(nearest_rotation);
            let mut right = rest.map(|_| DVec3::ZERO);
            for &([a, b], weight) in &stiffness {
                let edge = rest[a] - rest[b];
                let by = 0.5 * weight * (rotations[a] * edge + rotations[b] * edge);
                right[a] += by;
                right[b] -= by;
            }
            pulls.iter().for_each(|&(v, weight, at)| right[v] += weight * at);
            for k in 0..3 {
                let mut column: Vec<f64> = right.iter().map(|at| at[k]).collect();
                factor.solve(&mut column)?;
                bent.positions.iter_mut().zip(column).for_each(|(at, x)| at[k] = x);
            }
        }
    }
    Ok(bent)
}

/// The edges of a mesh with their cotangent weights, each at least a thousandth of the mean.
fn stiffness(mesh: &TriMesh, at: &IdVec<VertexId, DVec3>) -> Vec<([VertexId; 2], f64)> {
    let all = edges(mesh);
    let mut weights = vec![0.0; all.len()];
    for corners in &mesh.triangles {
        for k in 0..3 {
            let [a, b, c] = [corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]];
            let weight = 0.5 * cotangent(at[a], at[b], at[c]);
            let edge = all.binary_search(&[b.min(c), b.max(c)]);
            if let Some(sum) = edge.ok().and_then(|edge| weights.get_mut(edge)).filter(|_| weight.is_finite())
            {
                *sum += weight;
            }
        }
    }
    let least =
        1e-3 * weights.iter().map(|weight: &f64| weight.abs()).sum::<f64>() / weights.len().max(1) as f64;
    all.into_iter().zip(weights).map(|(edge, weight)| (edge, weight.max(least))).collect()
}
