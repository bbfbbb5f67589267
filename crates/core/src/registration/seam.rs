//! The seam of an atlas, carried to a closed skin: a rough match of both surfaces in space.
//!
//! A closed skin that is cut along another seam than its atlas has other neighbours on the map: of two gloves whose seams
//! were 4.5 mm apart in the median, taxels missed their places by 9.5 mm, and by 1.6 mm with the seam of the atlas.
//!
//! The atlas is bent in space, as rigidly as possible `(sorkine2007)`: its landmarks are held at those of the skin, and
//! other vertices are drawn to the nearest place of the skin that faces their way, more and more. The ends and branches of its
//! seam come to vertices of the skin, and each path between two of them to edges near it.
//!
//! Constants were measured at half and at double, on a closed hand of five fingers on one with other triangles, 20
//! landmarks. Its seam has 40 edges; taxels miss their places by 0.0561 of the radius of the ball in the median, 99 % of
//! them by 0.2124 at most. The seam is the same, edge by edge, but for:
//!
//! ```text
//! constant                         | value | half                         | double
//! ---------------------------------|-------|------------------------------|--------------------------
//! `ROUNDS`                         | 25    | 39 edges, 0.0588, 0.2124     | 40 edges, 0.0563, 0.2355
//! spacings at which an edge counts |       |                              |
//! twice (`carried_paths`)          | 1     | 41 edges, 0.0563, 0.2563     | 39 edges, 0.0563, 0.2124
//! ```

use std::collections::BTreeMap;

use glam::{DMat3, DQuat, DVec3};

use crate::calib::{Correlation, nearest_rotation, outer};
use crate::id::{IdVec, VertexId};
use crate::map::{PatchMap, SkinMap};
use crate::mesh::{TriMesh, boundary_edges, cotangent, edges, neighbours, surface_normals};
use crate::nearest::NearestFaces;
use crate::numeric::{Csr, each_by_distance, nearest_sources};
use crate::pyramid::LevelId;
use crate::registration::landmarks::{FEWEST, Landmarks, nearest_in_space};
use crate::registration::{Onto, RegistrationError};
use crate::skin::{Patch, PatchId, Skin};
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

/// How strongly a vertex is drawn to the skin at first, as a share of an edge, and after how many rounds twice as much.
const DRAW: f64 = 0.02;
const DOUBLING: f64 = 3.0;

/// The least weight of an edge, as a share of the mean: of obtuse triangles cotangents are below 0.
const LEAST_WEIGHT: f64 = 1e-3;

/// The seams of the atlas on the closed patches of a skin, as edges of each patch: see
/// [`Cut::Edges`](crate::cut::Cut::Edges). Nothing for patches that have a boundary, whose patch of the atlas has no seam, or
/// that have fewer than four landmarks.
///
/// # Errors
/// If the system of a match does not fit into memory.
pub fn carried_seams(
    skin: &Skin,
    onto: &Onto<'_>,
) -> Result<IdVec<PatchId, Vec<[VertexId; 2]>>, RegistrationError> {
    let &Onto { atlas, landmarks, is_mirrored, .. } = onto;
    let mut seams = skin.patches.map(|_| Vec::new());
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
        let image = |at: DVec3| if is_mirrored { mirror_image(at) } else { at };
        let own: Vec<(DVec3, VertexId)> =
            pairs.into_iter().filter(|(at, ..)| *at == of).map(|(_, from, to)| (image(from), to)).collect();
        if own.len() >= FEWEST {
            let system = |source| RegistrationError::System { patch: patch.name.clone(), source };
            seams[id] = carried_seam(patch, &atlas.patches[of], &own, is_mirrored).map_err(system)?;
        }
    }
    Ok(seams)
}

/// The mirror image of a place in space; which mirror does not matter.
fn mirror_image(at: DVec3) -> DVec3 {
    DVec3::new(-at.x, at.y, at.z)
}

/// The landmarks of a patch: the patch of the atlas, the place on it in the frame of its link, and the vertex.
fn pairs_of(
    skin: &Skin,
    id: PatchId,
    atlas: &SkinMap,
    landmarks: &Landmarks,
) -> Vec<(PatchId, DVec3, VertexId)> {
    let at_taxel = |patch: &PatchMap, v: VertexId| patch.levels[LevelId::new(0)].level.mesh.positions[v];
    match landmarks {
        Landmarks::Taxels(all) => {
            let own = all.iter().filter(|landmark| landmark.taxel.0 == id);
            let pair = |landmark: &crate::registration::Landmark| {
                let (other, v) = landmark.atlas;
                (other, at_taxel(&atlas.patches[other], v), landmark.taxel.1)
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
                        pairs.push((other, at_taxel(patch, *v), *w));
                    }
                }
            }
            pairs
        }
    }
}

/// The seam of a patch of the atlas on a closed patch; empty where it has none. `landmarks` are places of the atlas, as seen in
/// a mirror where the patch is that of the other hand, and vertices.
fn carried_seam(
    patch: &Patch,
    of: &PatchMap,
    landmarks: &[(DVec3, VertexId)],
    is_mirrored: bool,
) -> Result<Vec<[VertexId; 2]>, SparseError> {
    let level = of.levels.iter().find(|level| level.level.mesh.positions.len() <= MOST_VERTICES);
    let Some(level) = level.or(of.levels.iter().last()) else { return Ok(Vec::new()) };
    let seam = of.levels[LevelId::new(0)].seam();
    let Ok(faces) = NearestFaces::new(patch.mesh.clone()) else { return Ok(Vec::new()) };
    if seam.is_empty() {
        return Ok(Vec::new());
    }
    let mut mesh = level.level.mesh.clone();
    if is_mirrored {
        mesh.positions.iter_mut().for_each(|at| *at = mirror_image(*at));
        mesh.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
    }
    let pairs: Vec<_> = landmarks.iter().map(|&(from, v)| (from, patch.mesh.positions[v])).collect();
    let bent = bent_in_space(&mesh, &faces, &pairs)?;
    let normals = surface_normals(&bent);
    // The vertex that a taxel of the atlas comes to.
    let place = |v: VertexId| {
        let row = level.level.to_finest.as_ref().map(|rows| (rows.indices[v], rows.weights[v]));
        let (of_level, weights) = row.unwrap_or(([v; 3], [1.0, 0.0, 0.0]));
        let mean = |values: &IdVec<VertexId, DVec3>| {
            of_level.into_iter().zip(weights).map(|(w, weight)| weight * values[w]).sum::<DVec3>()
        };
        let (face, closest) = faces.nearest(mean(&bent.positions), mean(&normals), &mut None)?;
        let weights = closest.barycentric;
        let nearest = (0..3).fold(0, |best, k| if weights[k] > weights[best] { k } else { best });
        Some(patch.mesh.triangles[face][nearest])
    };
    let mut is_taken = IdVec::filled(false, patch.mesh.positions.len());
    landmarks.iter().for_each(|&(_, v)| is_taken[v] = true);
    Ok(carried_paths(&patch.mesh, &paths_of(&seam), is_taken, &place))
}

/// The paths of a seam between its knots, where it ends or branches: vertices, both ends included. One that comes back to its
/// knot is three.
fn paths_of(seam: &[[VertexId; 2]]) -> Vec<Vec<VertexId>> {
    let mut around: BTreeMap<VertexId, Vec<VertexId>> = BTreeMap::new();
    for &[a, b] in seam {
        around.entry(a).or_default().push(b);
        around.entry(b).or_default().push(a);
    }
    let mut paths = Vec::new();
    for (&knot, firsts) in around.iter().filter(|(_, others)| others.len() != 2) {
        for &first in firsts {
            let (mut path, mut at) = (vec![knot, first], first);
            while let Some(&next) =
                around[&at].iter().find(|&&v| around[&at].len() == 2 && v != path[path.len() - 2])
            {
                path.push(next);
                at = next;
            }
            // Each path is found from both of its ends, one that comes back twice from one.
            let is_first = (knot, first) <= (at, path[path.len() - 2]);
            match (is_first, knot == at) {
                (false, _) => {}
                (true, false) => paths.push(path),
                (true, true) => {
                    let third = path.len() / 3;
                    paths.extend(
                        [&path[..=third], &path[third..=2 * third], &path[2 * third..]].map(<[_]>::to_vec),
                    );
                }
            }
        }
    }
    paths
}

/// The paths of a seam along edges of a skin: each joins the vertices that its ends come to, near those of its other vertices,
/// no two meet but at their ends, and none passes through a vertex that is taken, as those of landmarks. So the seam has the
/// same ends and branches. Empty where a path has no room.
fn carried_paths(
    mesh: &TriMesh,
    paths: &[Vec<VertexId>],
    mut is_taken: IdVec<VertexId, bool>,
    place: &dyn Fn(VertexId) -> Option<VertexId>,
) -> Vec<[VertexId; 2]> {
    let graph = lengths_of_edges(mesh);
    let mean =
        graph.items().iter().map(|(_, length)| length).sum::<f64>() / graph.items().len().max(1) as f64;
    let (mut distances, mut reached) = (vec![f64::INFINITY; graph.len()], Vec::new());
    let mut knots: BTreeMap<VertexId, VertexId> = BTreeMap::new();
    for knot in paths.iter().flat_map(|path| [path[0], path[path.len() - 1]]) {
        let Some(near) = place(knot).filter(|_| !knots.contains_key(&knot)) else { continue };
        let mut free = near;
        each_by_distance(&graph, near.index(), &mut distances, &mut reached, |v, _| {
            free = VertexId::from(v);
            is_taken[free]
        });
        is_taken[free] = true;
        knots.insert(knot, free);
    }
    // The longer ones have room to go around.
    let mut order: Vec<usize> = (0..paths.len()).collect();
    order.sort_by_key(|&k| paths[k].len());
    let mut seam = Vec::new();
    for path in order.into_iter().map(|k| &paths[k]) {
        let ends = [path[0], path[path.len() - 1]].map(|knot| knots.get(&knot).copied());
        let [Some(from), Some(to)] = ends else { return Vec::new() };
        let course = path[1..path.len() - 1].iter().filter_map(|&v| place(v)).chain([from, to]);
        let beside = nearest_sources(&graph, course.map(VertexId::raw), 1);
        let far = |v: u32| beside[v as usize].first().map_or(f64::INFINITY, |(_, far)| far / mean);
        let is_open = |v: u32| !is_taken[VertexId::from(v)] || v == from.raw() || v == to.raw();
        let mut open = Csr::with_capacity(graph.len(), graph.items().len());
        // An edge counts twice where the way to the path is as long as the spacing of the skin.
        for (v, others) in (0_u32..).zip(graph.iter()) {
            let others = others.iter().filter(|(w, _)| is_open(v) && is_open(*w));
            open.push(others.map(|&(w, length)| (w, length * (1.0 + (0.5 * (far(v) + far(w))).powi(2)))));
        }
        each_by_distance(&open, from.index(), &mut distances, &mut reached, |v, _| v != to.raw());
        let mut at = to;
        while at != from {
            let before = open[at.index()].iter().min_by(|(v, x), (w, y)| {
                (distances[*v as usize] + x).total_cmp(&(distances[*w as usize] + y)).then(v.cmp(w))
            });
            let before = before.filter(|(v, _)| distances[*v as usize] < distances[at.index()]);
            let Some(&(before, _)) = before else { return Vec::new() };
            let before = VertexId::from(before);
            seam.push([at.min(before), at.max(before)]);
            is_taken[before] = true;
            at = before;
        }
    }
    seam.sort_unstable();
    seam
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

/// The similarity of least squares of pairs of places.
fn similarity(pairs: &[(DVec3, DVec3)]) -> impl Fn(DVec3) -> DVec3 {
    let Correlation { from, to, matrix } = Correlation::new(pairs, None);
    let turn = nearest_rotation(&matrix);
    let squares: f64 = pairs.iter().map(|(p, _)| p.distance_squared(from)).sum();
    let scale = pairs.iter().map(|(p, q)| (turn * (*p - from)).dot(*q - to)).sum::<f64>() / squares;
    move |p| to + scale * (turn * (p - from))
}

/// A mesh of the atlas, bent onto the faces of a skin; `landmarks` are places of both.
fn bent_in_space(
    mesh: &TriMesh,
    faces: &NearestFaces,
    landmarks: &[(DVec3, DVec3)],
) -> Result<TriMesh, SparseError> {
    let placed = similarity(landmarks);
    let rest = mesh.positions.map(|&p| placed(p));
    let stiffness = stiffness(mesh, &rest);
    let mean = stiffness.iter().map(|(_, weight)| weight).sum::<f64>() / stiffness.len().max(1) as f64;
    // The nearest vertex is held where its landmark belongs.
    let hold = |&(p, q): &(DVec3, DVec3)| {
        let far = |v: &VertexId| mesh.positions[*v].distance_squared(p);
        let v = mesh.positions.ids().min_by(|a, b| far(a).total_cmp(&far(b)))?;
        Some((v, HOLD * mean, q + rest[v] - placed(p)))
    };
    let held: Vec<Pull> = landmarks.iter().filter_map(hold).collect();
    let pattern = Pattern::new(rest.len(), stiffness.iter().map(|([a, b], _)| (a.index(), b.index())));
    let springs = Springs {
        cholesky: Cholesky::new(&pattern, rest.as_slice())?,
        pattern: &pattern,
        rest: &rest,
        stiffness,
    };
    let mut bent = TriMesh { positions: rest.clone(), triangles: mesh.triangles.clone() };
    for round in 0..ROUNDS {
        let mut pulls = held.clone();
        if round >= HELD_ALONE {
            let draw = mean * DRAW * (f64::from(round - HELD_ALONE) / DOUBLING).exp2();
            let normals = surface_normals(&bent);
            for (v, &at) in bent.positions.enumerate() {
                let near = faces.nearest(at, normals[v], &mut None);
                pulls.extend(near.map(|(face, closest)| {
                    let corners = faces.mesh.corners(face).into_iter().zip(closest.barycentric);
                    (v, draw, corners.map(|(corner, weight)| weight * corner).sum())
                }));
            }
        }
        springs.relax(&mut bent.positions, &pulls)?;
    }
    Ok(bent)
}

/// A vertex that is drawn to a place with a stiffness.
type Pull = (VertexId, f64, DVec3);

/// The edges of a mesh, whose shape at rest is kept up to a rotation at each vertex.
struct Springs<'a> {
    rest: &'a IdVec<VertexId, DVec3>,
    stiffness: Vec<([VertexId; 2], f64)>,
    pattern: &'a Pattern,
    cholesky: Cholesky,
}

impl Springs<'_> {
    /// Moves vertices towards their balance with the pulls.
    fn relax(&self, positions: &mut IdVec<VertexId, DVec3>, pulls: &[Pull]) -> Result<(), SparseError> {
        let Self { rest, stiffness, pattern, cholesky } = self;
        let mut matrix = Matrix::<f64>::zero(pattern);
        for &([a, b], weight) in stiffness {
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
            for &([a, b], weight) in stiffness {
                let spread = outer(positions[a] - positions[b], rest[a] - rest[b]) * weight;
                spreads[a] += spread;
                spreads[b] += spread;
            }
            let rotations: IdVec<VertexId, DQuat> = spreads.map(nearest_rotation);
            let mut right = rest.map(|_| DVec3::ZERO);
            for &([a, b], weight) in stiffness {
                let edge = rest[a] - rest[b];
                let by = 0.5 * weight * (rotations[a] * edge + rotations[b] * edge);
                right[a] += by;
                right[b] -= by;
            }
            pulls.iter().for_each(|&(v, weight, at)| right[v] += weight * at);
            for k in 0..3 {
                let mut column: Vec<f64> = right.iter().map(|at| at[k]).collect();
                factor.solve(&mut column)?;
                positions.iter_mut().zip(column).for_each(|(at, x)| at[k] = x);
            }
        }
        Ok(())
    }
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
    let least = LEAST_WEIGHT * weights.iter().map(|weight: &f64| weight.abs()).sum::<f64>()
        / weights.len().max(1) as f64;
    all.into_iter().zip(weights).map(|(edge, weight)| (edge, weight.max(least))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::id::Id;
    use crate::mesh::shapes;

    /// A tree of three paths on a ball, carried to one with other triangles: three ends, one branch, and no vertex of a landmark.
    #[test]
    fn a_carried_seam_has_the_same_ends_and_branches() {
        let (from, to) = (shapes::ball(12, 1.0), shapes::ball(17, 1.0));
        let graph = lengths_of_edges(&from);
        let nearest = |mesh: &TriMesh, at: DVec3| {
            let far = |v: &VertexId| mesh.positions[*v].distance_squared(at);
            mesh.positions.ids().min_by(|a, b| far(a).total_cmp(&far(b))).unwrap()
        };
        let mut seam = Vec::new();
        let middle = nearest(&from, DVec3::Z);
        for k in 0..3 {
            let end = nearest(&from, glam::DVec2::from_angle(2.0 * f64::from(k)).extend(0.2));
            let mut distances = vec![f64::INFINITY; graph.len()];
            each_by_distance(&graph, middle.index(), &mut distances, &mut Vec::new(), |_, _| true);
            let mut at = end;
            while at != middle {
                let far = |(v, _): &&(u32, f64)| distances[*v as usize];
                let before = graph[at.index()].iter().min_by(|a, b| far(a).total_cmp(&far(b))).unwrap();
                seam.push([at, VertexId::from(before.0)]);
                at = VertexId::from(before.0);
            }
        }
        let paths = paths_of(&seam);
        assert_eq!(paths.len(), 3);
        let mut is_taken = IdVec::filled(false, to.positions.len());
        let landmark = nearest(&to, from.positions[paths[0][4]]);
        is_taken[landmark] = true;
        let carried = carried_paths(&to, &paths, is_taken, &|v| Some(nearest(&to, from.positions[v])));
        let mut degrees = vec![0; to.positions.len()];
        carried.iter().flatten().for_each(|v| degrees[v.index()] += 1);
        let of_degree = |degree: usize| degrees.iter().filter(|found| **found == degree).count();
        assert_eq!((of_degree(1), of_degree(3), carried.len()), (3, 1, of_degree(2) + 3));
        assert_eq!(degrees[landmark.index()], 0);
        for v in to.positions.ids().filter(|v| degrees[v.index()] > 0) {
            let at = |w: &VertexId| from.positions[*w].distance(to.positions[v]);
            assert!(seam.iter().flatten().map(at).fold(f64::INFINITY, f64::min) < 0.2);
        }
    }

    /// A path that comes back to its start is three, so that each has two ends.
    #[test]
    fn a_path_that_comes_back_is_three() {
        let ids = |ends: &[[usize; 2]]| ends.iter().map(|ends| ends.map(VertexId::new)).collect::<Vec<_>>();
        let paths = paths_of(&ids(&[[0, 1], [1, 2], [2, 3], [3, 1]]));
        let mut ends: Vec<[usize; 2]> =
            paths.iter().map(|path| [path[0], path[path.len() - 1]].map(Id::index)).collect();
        ends.sort_unstable();
        assert_eq!(ends, [[0, 1], [1, 2], [2, 3], [3, 1]]);
    }
}
