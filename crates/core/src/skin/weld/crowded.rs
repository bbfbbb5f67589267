//! Which faces belong together at an edge of more than two: the two sides of a solid that touches another
//! there, or those that continue each other most smoothly. *Heuristic*: by smoothness alone, 28 of 400 meshes
//! of robot links became one-sided surfaces.

use glam::DVec3;

use crate::mesh::{Edges, Halfedge, TriMesh};
use crate::numeric::{argsort, order_by};

/// More faces than this at one edge are not paired: each is a sheet of its own.
const MOST_PAIRED: usize = 16;

/// Whether two faces at an edge are wound differently.
pub(in crate::skin) fn is_turned(mesh: &TriMesh, a: Halfedge, b: Halfedge) -> bool {
    a.start(mesh) == b.start(mesh)
}

/// The winding of a file is taken as intended if at least this share of its edges of two faces is wound alike.
const MIN_ALIKE_SHARE: f64 = 0.9;

/// A file contains solids, not sheets, if at most this share of its edges has one face.
const MAX_OPEN_SHARE: f64 = 0.05;

/// The content of a file, which decides how faces are paired at an edge with more than two.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::skin) enum Content {
    /// Solids whose faces are wound outward, or, with `inward`, inward.
    Solids { inward: bool },
    /// Sheets that are wound consistently.
    Sheets,
    /// Faces in any winding.
    Faces,
}

impl Content {
    pub(in crate::skin) fn of(mesh: &TriMesh, edges: &Edges) -> Self {
        let (mut alike, mut turned, mut open) = (0, 0, 0);
        for uses in edges.iter() {
            match *uses {
                [_] => open += 1,
                [a, b] if is_turned(mesh, a, b) => turned += 1,
                [_, _] => alike += 1,
                _ => {}
            }
        }
        if f64::from(alike) < MIN_ALIKE_SHARE * f64::from(alike + turned) {
            return Self::Faces;
        }
        if f64::from(open) > MAX_OPEN_SHARE * f64::from(alike + turned + open) {
            return Self::Sheets;
        }
        Self::Solids { inward: mesh.enclosed_volume() < 0.0 }
    }
}

/// The pairs of faces that belong together at an edge of more than two. Those of solids that touch there, in
/// equal numbers in both directions, are the two sides of one solid each; others are paired by smoothness. If
/// there are too many, none are paired.
pub(in crate::skin) fn pairs(mesh: &TriMesh, uses: &[Halfedge], content: Content) -> Vec<[Halfedge; 2]> {
    if uses.len() > MOST_PAIRED {
        return Vec::new();
    }
    let forward = |h: Halfedge| h.start(mesh) < h.end(mesh);
    let is_balanced = 2 * uses.iter().filter(|h| forward(**h)).count() == uses.len();
    match content {
        Content::Solids { inward } if is_balanced => sides_of_solids(mesh, uses, |h| forward(h) != inward),
        content => smoothest(mesh, uses, content != Content::Faces),
    }
}

/// The direction from an edge into a face, at right angles to the edge.
fn away(mesh: &TriMesh, h: Halfedge) -> DVec3 {
    let [a, b, c] = [h, h.next(), h.next().next()].map(|h| mesh.positions[h.start(mesh)]);
    let along = (b - a).normalize_or_zero();
    (c - a).reject_from(if along == DVec3::ZERO { DVec3::X } else { along }).normalize_or_zero()
}

/// Pairs the faces with the inside of one solid between them, in the order around the edge. The
/// outside of an `opening` face comes after it, its inside before.
fn sides_of_solids(
    mesh: &TriMesh,
    uses: &[Halfedge],
    opening: impl Fn(Halfedge) -> bool,
) -> Vec<[Halfedge; 2]> {
    let (first, last) = (uses[0].start(mesh), uses[0].end(mesh));
    let axis = mesh.positions[first.max(last)] - mesh.positions[first.min(last)];
    let axis = axis.try_normalize().unwrap_or(DVec3::X);
    let x = axis.any_orthonormal_vector();
    let y = axis.cross(x);
    let angle = |h: Halfedge| {
        let away = away(mesh, h);
        away.dot(y).atan2(away.dot(x))
    };
    let angles: Vec<f64> = uses.iter().map(|&h| angle(h)).collect();
    let mut around: Vec<Halfedge> = argsort(&angles).into_iter().map(|k| uses[k]).collect();
    let mut pairs = Vec::new();
    // As with brackets: the face that closes an inside follows the one that opens it.
    while let Some(k) =
        (0..around.len()).find(|&k| !opening(around[k]) && opening(around[(k + 1) % around.len()]))
    {
        let next = (k + 1) % around.len();
        pairs.push([around[k], around[next]]);
        around.remove(k.max(next));
        around.remove(k.min(next));
    }
    pairs
}

/// Pairs the faces that continue each other most smoothly, the smoothest first; where the file `is_wound`,
/// pairs that are wound alike come first, since others would make one-sided surfaces.
fn smoothest(mesh: &TriMesh, uses: &[Halfedge], is_wound: bool) -> Vec<[Halfedge; 2]> {
    let mut candidates = Vec::new();
    for (i, &a) in uses.iter().enumerate() {
        for &b in &uses[i + 1..] {
            candidates.push((is_wound && is_turned(mesh, a, b), away(mesh, a).dot(away(mesh, b)), a, b));
        }
    }
    let order = order_by(candidates.len(), &|p, q| {
        let (p, q) = (&candidates[p], &candidates[q]);
        p.0.cmp(&q.0).then(p.1.total_cmp(&q.1))
    });
    let mut pairs: Vec<[Halfedge; 2]> = Vec::new();
    for (_, _, a, b) in order.into_iter().map(|k| candidates[k]) {
        if !pairs.iter().flatten().any(|h| *h == a || *h == b) {
            pairs.push([a, b]);
        }
    }
    pairs
}
