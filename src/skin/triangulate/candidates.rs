//! Candidate triangles: those of the stars of all taxels, ranked by the votes of their corners.
//!
//! *Heuristic*: the vote replaces star splaying (shewchuk2005), which repeats until all stars
//! agree.

use rayon::prelude::*;

use crate::{
    id::VertexId,
    mesh::smallest_first,
    parallel::par_collect,
    skin::triangulate::{delaunay_star::DelaunayStar, point_cloud::PointCloud, tangent_star::tangent_star},
};

/// Circumradii that differ by less than this part are equal, as those of the triangles of a square
/// are.
const SAME_SIZE: f64 = 1e-6;

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

/// The triangles of all stars: most votes first, then the smallest circumcircle over the spacing.
pub(super) fn candidates(cloud: &PointCloud<'_>) -> Vec<Candidate> {
    let ids: Vec<VertexId> = cloud.positions.ids().collect();
    let mut found: Vec<[VertexId; 3]> = par_collect(ids.len(), |range, found| {
        let mut star = DelaunayStar::default();
        for &v in &ids[range] {
            found.extend(tangent_star(&mut star, v, cloud).into_iter().map(smallest_first));
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

#[expect(clippy::cast_possible_truncation, reason = "a cast saturates, and logarithms are small")]
fn size(t: [VertexId; 3], cloud: &PointCloud<'_>) -> i64 {
    let spacing: f64 = t.iter().map(|&v| cloud.neighbours.spacing[v]).sum();
    ((cloud.circumradius(t) / spacing).ln() / SAME_SIZE).round() as i64
}
