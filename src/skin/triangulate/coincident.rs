//! Which taxels are at one position, up to rounding.
//!
//! *Heuristic*: `SAME_PLACE` and `MOST_APART` separate rounded copies from neighbouring taxels on
//! measured layouts.

use std::collections::HashMap;

use glam::DVec3;

use crate::{
    id::{IdVec, VertexId},
    numeric::{DisjointSets, median},
    parallel::par_collect,
    skin::triangulate::neighbours::{Neighbour, distance_around, nearest_others, tree_of},
};

/// Two taxels coincide if they are closer than this part of the median distance from the centre of
/// the sheet: the rounding of an `f32`, far below the accuracy of any mounting. The median is
/// robust against sentinel coordinates such as -999; the bounding box is not.
const RESOLUTION: f64 = 1.0 / (1_u64 << 24) as f64;

/// They also do if they are closer than this share of the distance to the third nearest, and than
/// [`MOST_APART`], unless the file's normals point to different sides: one of them was rounded to
/// the digits of a text. A face with both would be a sliver, fifty times longer than high. The
/// taxels of an iCub keep 0.41 of it, those of a lattice with a noise of 0.3 spacings 0.1; of
/// random points one in 1250 is that close to another.
const SAME_PLACE: f64 = 0.02;

/// Rounding to the digits of a text moves a taxel by at most this, in m: what is farther away is
/// another pad, or the other side of a foil.
const MOST_APART: f64 = 1e-4;

/// Taxels within the resolution of each other fill at most this many cells.
const CELLS: usize = 8;

/// For every taxel the first that coincides with it. `normals` may be zero, and `unit` is the
/// length of 1, in m.
///
/// The relation does not depend on the order of the taxels, and is transitive.
pub(super) fn first_at_place(
    positions: &IdVec<VertexId, DVec3>,
    normals: &IdVec<VertexId, DVec3>,
    unit: f64,
) -> IdVec<VertexId, VertexId> {
    let resolution = RESOLUTION * median_distance(positions);
    let mut sets = DisjointSets::<VertexId>::new(positions.len());
    // Among many copies a search for the nearest taxels would find nothing else.
    let mut first_in_cell = HashMap::with_capacity(positions.len());
    let mut firsts = IdVec::<VertexId, VertexId>::default();
    for (v, &p) in positions.enumerate() {
        let first = *first_in_cell.entry(cell(p, resolution)).or_insert(v);
        if first == v {
            firsts.push(v);
        } else {
            sets.join(first, v);
        }
    }
    let merge_distance = MOST_APART / unit;
    for [a, b] in close_pairs(&firsts.map(|&v| positions[v]), resolution, merge_distance) {
        let [a, b] = [firsts[a], firsts[b]];
        let is_rounding = positions[a].distance(positions[b]) < resolution;
        if is_rounding || normals[a].dot(normals[b]) >= 0.0 {
            sets.join(a, b);
        }
    }
    positions.ids().map(|v| sets.root(v)).collect()
}

/// Pairs closer than the resolution, or than `SAME_PLACE` times the local spacing but at most
/// `merge_distance`.
fn close_pairs(
    positions: &IdVec<VertexId, DVec3>,
    resolution: f64,
    merge_distance: f64,
) -> Vec<[VertexId; 2]> {
    let tree = tree_of(positions);
    let close = |found: &mut Vec<Neighbour>, v: VertexId| {
        nearest_others(&tree, v, CELLS - 1, f64::INFINITY, found);
        let reach = resolution.max((SAME_PLACE * distance_around(found)).min(merge_distance));
        // A reach whose square underflows finds nothing: no distance is below 0.
        let close = found.iter().take_while(|near| near.1 < reach * reach);
        close.map(|near| [v, near.0]).collect::<Vec<_>>()
    };
    par_collect(positions.len(), |range, pairs| {
        let mut found = Vec::new();
        range.map(VertexId::new).for_each(|v| pairs.extend(close(&mut found, v)));
    })
}

/// The median distance (maximum norm) from the centre, the median of each coordinate; 1, the
/// longest side of the box, if that is 0.
fn median_distance(places: &IdVec<VertexId, DVec3>) -> f64 {
    let middle = [0, 1, 2].map(|axis| median(places.iter().map(|p| p[axis])).unwrap_or(0.0));
    let distance = median(places.iter().map(|p| (*p - DVec3::from(middle)).abs().max_element()));
    distance.filter(|&distance| distance > 0.0).unwrap_or(1.0)
}

/// A position rounded to the resolution; positions far outside the others may share a cell.
#[expect(clippy::cast_possible_truncation, reason = "saturates, and only beyond 2^39 median distances")]
fn cell(p: DVec3, resolution: f64) -> [i64; 3] {
    (p / resolution).to_array().map(|x| x.round() as i64)
}
