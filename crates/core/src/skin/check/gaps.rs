//! *Heuristic*: boundaries so close that they look like a seam that was not joined.

use std::collections::HashSet;

use glam::DVec3;

use crate::bvh::{Aabb, BoxTree};
use crate::id::{IdVec, VertexId};
use crate::skin::check::FindingKind;
use crate::skin::check::finding::{Report, Subject};

/// Two boundaries closer than this share of the local spacing look like a seam that was not joined.
/// Modules that are not to be joined are at least one spacing apart.
const SEAM: f64 = 0.5;

/// Edges this much longer than a vertex's spacing (as a power of two) are not searched around it.
const MAX_LEVELS_UP: i32 = 8;

/// At most this many edges are tested around a vertex: many coincident faces would take quadratic time. A
/// seam has some ten edges around each vertex.
const MOST_CANDIDATES: usize = 2048;

/// A boundary edge.
type Ends = [VertexId; 2];

/// Reports boundary vertices that are close to a boundary edge that they are not joined to.
pub(super) fn check_gaps(subject: &Subject<'_>, report: &mut Report<'_>) {
    let mesh = &subject.surface.mesh;
    // Both sides of a cut are one position.
    let place = |v| subject.surface.place_of(v);
    let mut boundary: Vec<Ends> = Vec::new();
    let mut on_boundary = IdVec::<VertexId, bool>::filled(false, mesh.positions.len());
    for uses in subject.surface.edges.iter() {
        if let &[h] = uses {
            let ends = [h.start(mesh), h.end(mesh)];
            ends.iter().for_each(|&v| on_boundary[v] = true);
            boundary.push(ends);
        }
    }
    // Mean length of the edges at each boundary vertex, and which of these vertices are neighbours.
    let mut lengths = IdVec::<VertexId, (f64, u32)>::filled((0.0, 0), mesh.positions.len());
    let mut joined: HashSet<Ends> = HashSet::new();
    for uses in subject.surface.edges.iter() {
        let ends = [uses[0].start(mesh), uses[0].end(mesh)];
        let length = mesh.positions[ends[0]].distance(mesh.positions[ends[1]]);
        for v in ends {
            lengths[v].0 += length;
            lengths[v].1 += 1;
        }
        if ends.iter().all(|&v| on_boundary[v]) {
            let ends = ends.map(place);
            joined.insert(ends);
            joined.insert([ends[1], ends[0]]);
        }
    }
    let edges = BoundaryEdges::new(&mesh.positions, &boundary);
    let mut close = Vec::new();
    let mut narrowest = f64::INFINITY;
    for v in mesh.positions.ids().filter(|&v| on_boundary[v]) {
        let reach = SEAM * lengths[v].0 / f64::from(lengths[v].1);
        let is_apart =
            |e: Ends| e.map(place).iter().all(|&w| w != place(v) && !joined.contains(&[place(v), w]));
        if let Some(distance) = edges.nearest(mesh.positions[v], reach, is_apart) {
            close.push(v);
            narrowest = narrowest.min(distance);
        }
    }
    let close = close.into_iter().map(|v| subject.surface.in_file(v));
    report.add_vertices(FindingKind::Gap { nearest: narrowest }, close);
}

/// The boundary edges in a tree over their boxes.
struct BoundaryEdges<'a> {
    positions: &'a IdVec<VertexId, DVec3>,
    /// Those with a usable length.
    edges: Vec<Edge>,
    tree: BoxTree,
}

struct Edge {
    ends: Ends,
    level: i32,
}

impl<'a> BoundaryEdges<'a> {
    fn new(positions: &'a IdVec<VertexId, DVec3>, boundary: &[Ends]) -> Self {
        let edge = |&ends: &Ends| {
            let [a, b] = ends.map(|v| positions[v]);
            Some(Edge { ends, level: level_of(a.distance(b))? })
        };
        let edges: Vec<Edge> = boundary.iter().filter_map(edge).collect();
        let boxes: Vec<Aabb> =
            edges.iter().map(|edge| Aabb::around(edge.ends.map(|v| positions[v]))).collect();
        Self { positions, edges, tree: BoxTree::new(&boxes).expect("the edges are finite") }
    }

    /// Distance of `point` to the nearest edge for which `allowed` holds, if that is below `reach`.
    fn nearest(&self, point: DVec3, reach: f64, allowed: impl Fn(Ends) -> bool) -> Option<f64> {
        // Shorter edges belong to much denser skin, whose vertices find this gap from their side.
        let own = level_of(reach)?;
        let levels = own..=own + MAX_LEVELS_UP;
        let mut nearest = reach;
        let mut candidates = 0;
        self.tree.each_near(point, reach, |edge| {
            let Edge { ends, level } = self.edges[edge];
            candidates += 1;
            if candidates > MOST_CANDIDATES {
                return f64::NEG_INFINITY;
            }
            let [a, b] = ends.map(|v| self.positions[v]);
            let distance = distance_to_segment(point, a, b);
            if distance < nearest && levels.contains(&level) && allowed(ends) {
                nearest = distance;
            }
            nearest
        });
        (nearest < reach).then_some(nearest)
    }
}

/// The exponent of the power of two below a length; `None` for a length that is not usable.
fn level_of(length: f64) -> Option<i32> {
    // Outside of this range squares of lengths overflow or underflow.
    let is_usable = length > 1e-100 && length < 1e100;
    #[expect(clippy::cast_possible_truncation, reason = "the logarithm is within 333 of zero")]
    is_usable.then(|| length.log2().floor() as i32)
}

fn distance_to_segment(point: DVec3, a: DVec3, b: DVec3) -> f64 {
    let along = b - a;
    let t = ((point - a).dot(along) / along.length_squared()).clamp(0.0, 1.0);
    // NaN for edges without length, so that they are near nothing.
    point.distance(a + t * along)
}
