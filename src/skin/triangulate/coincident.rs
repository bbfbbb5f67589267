use std::collections::HashMap;

use glam::DVec3;

use crate::{
    id::{IdVec, VertexId},
    numeric::DisjointSets,
    parallel::par_collect,
    skin::triangulate::{
        kd_tree::{KdTree, Near},
        neighbours::distance_around,
    },
};

/// Two taxels are at one place if they are, up to this part of the median distance from the middle of the sheet: the rounding of
/// an `f32`, far below what any sensor can be mounted to. Unlike the extent, the median does not mind a number that stands for
/// none among the coordinates.
const RESOLUTION: f64 = 1.0 / (1_u64 << 24) as f64;

/// They also are if they are closer than this share of the distance to the third nearest, and than [`MOST_BESIDE`], unless
/// the file says that they look to different sides: one of them was rounded to the digits of a text. A face with both would
/// be a sliver, fifty times longer than high. The taxels of an iCub keep 0.41 of it, those of a lattice with a noise of 0.3
/// spacings 0.1; of points strewn at random one in 1250 is that close to another.
const SAME_PLACE: f64 = 0.02;

/// Rounding to the digits of a text moves a taxel by no more than this, in m: what is farther off is another pad, or the other side
/// of a foil.
const MOST_BESIDE: f64 = 1e-4;

/// Taxels within the resolution of each other fill at most so many cells.
const CELLS: usize = 8;

/// For every taxel the first of those at its place. `normals` may be zero, and `unit` is the length of 1, in m.
///
/// Which are at one place does not depend on their order. What is close to a close one counts as close.
pub(super) fn first_at_place(
    positions: &IdVec<VertexId, DVec3>,
    normals: &IdVec<VertexId, DVec3>,
    unit: f64,
) -> IdVec<VertexId, VertexId> {
    let resolution = RESOLUTION * median_distance(positions.as_slice().to_vec());
    let mut sets = DisjointSets::<VertexId>::new(positions.len());
    // Of a heap of copies a search for the nearest taxels would see nothing else.
    let mut first_in_cell = HashMap::with_capacity(positions.len());
    let mut firsts = IdVec::<VertexId, VertexId>::new();
    for (v, &p) in positions.enumerate() {
        let first = *first_in_cell.entry(cell(p, resolution)).or_insert(v);
        if first == v {
            firsts.push(v);
        } else {
            sets.join(first, v);
        }
    }
    let most_beside = MOST_BESIDE / unit;
    for [a, b] in close_pairs(&firsts.map(|&v| positions[v]), resolution, most_beside) {
        let [a, b] = [firsts[a], firsts[b]];
        let is_rounding = positions[a].distance(positions[b]) < resolution;
        if is_rounding || normals[a].dot(normals[b]) >= 0.0 {
            sets.join(a, b);
        }
    }
    positions.ids().map(|v| sets.root(v)).collect()
}

/// Pairs closer than the resolution, or than a small share of the distance of the taxels around that is at most `most_beside`.
fn close_pairs(positions: &IdVec<VertexId, DVec3>, resolution: f64, most_beside: f64) -> Vec<[VertexId; 2]> {
    let tree = KdTree::new(positions);
    let ids: Vec<VertexId> = positions.ids().collect();
    let close = |found: &mut Vec<Near>, &v: &VertexId| {
        tree.nearest(positions[v], v, CELLS - 1, f64::INFINITY, found);
        let reach = resolution.max((SAME_PLACE * distance_around(found)).min(most_beside));
        // Squares that vanish, far from a number that stands for none, are not below zero.
        let close = found.iter().take_while(|near| near.0 < reach * reach);
        close.map(|near| [v, near.1]).collect::<Vec<_>>()
    };
    par_collect(ids.len(), |range, pairs| {
        let mut found = Vec::new();
        ids[range].iter().for_each(|v| pairs.extend(close(&mut found, v)));
    })
}

/// The median of the distances, by coordinate, from the middle: the median of each coordinate. 1, the longest side of the box, if
/// most lie there.
fn median_distance(mut places: Vec<DVec3>) -> f64 {
    if places.is_empty() {
        return 1.0;
    }
    let half = places.len() / 2;
    let median = [0, 1, 2]
        .map(|axis: usize| places.select_nth_unstable_by(half, |a, b| a[axis].total_cmp(&b[axis])).1[axis]);
    let mut distances: Vec<f64> =
        places.iter().map(|p| (*p - DVec3::from(median)).abs().max_element()).collect();
    let distance = *distances.select_nth_unstable_by(half, f64::total_cmp).1;
    if distance > 0.0 { distance } else { 1.0 }
}

/// A place rounded to the resolution; one far outside the others may share its cell with the like.
#[expect(
    clippy::cast_possible_truncation,
    reason = "a cast saturates, and only beyond 2^39 median distances"
)]
fn cell(p: DVec3, resolution: f64) -> [i64; 3] {
    (p / resolution).to_array().map(|x| x.round() as i64)
}
