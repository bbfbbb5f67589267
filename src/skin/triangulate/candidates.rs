//! Triangles on which the corners agree, and then whatever fits between them.

use rayon::prelude::*;

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::smallest_first,
    parallel::par_collect,
    skin::triangulate::{
        delaunay_star::DelaunayStar,
        growing_mesh::Front,
        point_cloud::Surroundings,
        repair::{close_leftovers, part_fans, take_in},
        tangent_star::tangent_star,
    },
};

/// Circles whose radii differ by less than this part are one size: corners of a square see all its triangles so.
const SAME_SIZE: f64 = 1e-6;

/// A triangle that some corners have in their star.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    /// Smallest first.
    corners: [VertexId; 3],
    /// How many corners have it.
    votes: usize,
    /// Steps of `SAME_SIZE` of the logarithm of the radius of its circle over the spacing.
    size: i64,
}

/// Joins the taxels with triangles: first those that two or three of their corners have in their star, most votes and smallest
/// circles first, then those of one corner that close what is left open, and last whatever takes a lonely taxel in.
pub(super) fn weave(around: &Surroundings<'_>) -> IdVec<FaceId, [VertexId; 3]> {
    let candidates = candidates(around);
    let doubted = candidates.partition_point(|c| c.votes > 1);
    let mut front = Front::new(around);
    for candidate in &candidates[..doubted] {
        front.take(candidate.corners);
    }
    for sides in [2, 1] {
        for candidate in &candidates[doubted..] {
            if front.sides_taken(candidate.corners) >= sides {
                front.take(candidate.corners);
            }
        }
    }
    close_leftovers(&mut front, around);
    part_fans(&mut front, around);
    take_in(&mut front, around);
    front.into_triangles()
}

/// The triangles of all stars, the best first.
fn candidates(around: &Surroundings<'_>) -> Vec<Candidate> {
    let ids: Vec<VertexId> = around.positions.ids().collect();
    let mut seen: Vec<[VertexId; 3]> = par_collect(ids.len(), |range, seen| {
        let mut star = DelaunayStar::default();
        for &v in &ids[range] {
            seen.extend(tangent_star(&mut star, v, around).into_iter().map(smallest_first));
        }
    });
    seen.par_sort_unstable();
    let mut candidates: Vec<Candidate> = seen
        .chunk_by(|a, b| a == b)
        .map(|same| Candidate { corners: same[0], votes: same.len(), size: size(same[0], around) })
        .collect();
    candidates.par_sort_unstable_by_key(|c| (usize::MAX - c.votes, c.size, c.corners));
    candidates
}

#[expect(clippy::cast_possible_truncation, reason = "a cast saturates, and logarithms are small")]
fn size(t: [VertexId; 3], around: &Surroundings<'_>) -> i64 {
    let spacing: f64 = t.iter().map(|&v| around.neighbours.spacing[v]).sum();
    ((around.circle(t) / spacing).ln() / SAME_SIZE).round() as i64
}
