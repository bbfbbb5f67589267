//! Candidate triangles: those of the stars of all taxels, ranked by the votes of their corners.
//!
//! The star of a taxel is that of the Delaunay triangulation of its neighbours in its tangent plane.
//! Stars of neighbours need not agree: the tangential Delaunay complex `(boissonnat2014)`.
//! *Heuristic*: the vote replaces star splaying `(shewchuk2005)`, which repeats until all stars
//! agree.

use glam::DVec2;
use rayon::prelude::*;

use crate::delaunay::{smallest_first, star};
use crate::id::{IdVec, VertexId};
use crate::numeric::Random;
use crate::parallel::{par_collect, par_ids};
use crate::skin::triangulate::neighbours::PointCloud;

/// Circumradii whose relative difference is smaller are equal, as those of the triangles of a square.
const SAME_SIZE: f64 = 1e-6;

/// A neighbour whose normal is turned by a right angle or more lies on another side of the body.
const SAME_SIDE: f64 = 0.0;

/// Circumcircles may be wider than the gap by this factor. At 1 the result is an alpha shape, and gaps
/// between rows of taxels slightly below the limit stay open; at larger factors slivers fill the notches of
/// every boundary.
const MAX_CIRCLE_FACTOR: f64 = 1.2;

/// Each taxel is displaced by this share of its spacing, so that no four taxels are on one circle: all stars see the
/// same displaced taxels, and the corners of a square choose the same diagonal in any frame. 1e-5 suffices on measured
/// covers, and 1e-6 leaves holes; `f32` rounds by less.
const DISPLACEMENT: f64 = 1e-4;

/// A triangle that is in the stars of some of its corners.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    /// Smallest first.
    pub corners: [VertexId; 3],
    /// How many of its corners have it in their star.
    pub votes: usize,
    /// Logarithm of its circumradius over the spacing, in steps of `SAME_SIZE`.
    size: i64,
}

/// The triangles of all stars: most votes first, then the smallest circumcircle over the spacing. `hashes` displace the
/// taxels.
pub(super) fn candidates(cloud: &PointCloud<'_>, hashes: &IdVec<VertexId, u64>) -> Vec<Candidate> {
    let displaced = par_ids(hashes.len(), |v: VertexId| {
        let amount = DISPLACEMENT * cloud.neighbours.spacing[v];
        cloud.positions[v] + amount * Random::new(hashes[v], 0).direction()
    });
    let cloud = &PointCloud { positions: &displaced, ..*cloud };
    let mut found: Vec<[VertexId; 3]> = par_collect(cloud.positions.len(), |range, found| {
        for v in range.map(VertexId::new) {
            found.extend(tangent_star(v, cloud).map(smallest_first));
        }
    });
    found.par_sort_unstable();
    let mut candidates: Vec<Candidate> = found
        .chunk_by(|a, b| a == b)
        .map(|same| Candidate { corners: same[0], votes: same.len(), size: size(same[0], cloud) })
        .collect();
    candidates.par_sort_unstable_by_key(|c| (usize::MAX - c.votes, c.size, c.corners));
    candidates
}

fn size(t: [VertexId; 3], cloud: &PointCloud<'_>) -> i64 {
    let spacing: f64 = t.iter().map(|&v| cloud.neighbours.spacing[v]).sum();
    size_class(cloud.circumradius(t) / spacing)
}

/// The logarithm of a length, in steps of [`SAME_SIZE`].
#[expect(clippy::cast_possible_truncation, reason = "a cast saturates, and logarithms are small")]
pub(super) fn size_class(length: f64) -> i64 {
    (length.ln() / SAME_SIZE).round() as i64
}

/// The triangles around `v` of the Delaunay triangulation of its neighbours in its tangent plane, without
/// those whose circle is too wide.
///
/// Neighbours are unrolled into the plane: they keep their distance and their direction in the
/// tangent plane.
fn tangent_star(v: VertexId, cloud: &PointCloud<'_>) -> impl Iterator<Item = [VertexId; 3]> {
    let PointCloud { positions, normals, neighbours, gap } = *cloud;
    let (n, spacing) = (normals[v], neighbours.spacing[v]);
    let (e, f) = n.any_orthonormal_pair();
    let mut candidates = Vec::new();
    let mut unrolled = Vec::new();
    for &w in neighbours.of(v).iter().filter(|&&w| normals[w].dot(n) > SAME_SIDE) {
        let d = (positions[w] - positions[v]) / spacing;
        candidates.push(w);
        unrolled.push(d.length() * DVec2::new(d.dot(e), d.dot(f)).normalize_or_zero());
    }
    let is_narrow = move |a: DVec2, b: DVec2| {
        a.length() * b.length() * a.distance(b) <= MAX_CIRCLE_FACTOR * gap * a.perp_dot(b)
    };
    // Cannot fail: positions are finite, and neighbours near.
    let around = star(&unrolled).unwrap_or_default().into_iter();
    let narrow = around.filter(move |&[a, b]| is_narrow(unrolled[a], unrolled[b]));
    narrow.map(move |[a, b]| [v, candidates[a], candidates[b]])
}
