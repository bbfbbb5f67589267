//! The different positions of the taxels of a sheet, up to rounding, in a normalised frame and order.
//!
//! *Heuristic*: `SAME_PLACE` and `MOST_APART` separate rounded copies from neighbouring taxels on
//! measured layouts.

use std::collections::{HashMap, HashSet};

use glam::DVec3;
use rayon::prelude::*;

use crate::id::{IdVec, VertexId};
use crate::numeric::{DisjointSets, hash, median, morton, place_hash};
use crate::parallel::{par_collect, par_map};
use crate::skin::triangulate::neighbours::{Neighbour, distance_around, nearest_others, tree_of};
use crate::skin::{Presence, Sheet};

/// The different positions of the taxels of a sheet.
///
/// They are numbered along a Morton curve, equal codes by coordinate, so that no result depends on
/// the order of the file, and neighbours lie close together in memory.
#[derive(Debug)]
pub(in crate::skin) struct UniquePoints<'a> {
    /// The sheet whose taxels they are.
    pub sheet: &'a Sheet,
    /// Moved and scaled so that the longest side of their box is 1: squares of the largest
    /// coordinates do not overflow.
    pub positions: IdVec<VertexId, DVec3>,
    /// The taxel of the sheet at each position.
    pub taxel: IdVec<VertexId, usize>,
    /// The unit of length, in m.
    pub unit: f64,
    /// Taxels of the sheet that were merged with another one, ascending.
    pub merged: Vec<VertexId>,
    /// The largest distance between merged taxels, in m.
    pub distance: f64,
    /// Slots of the sheet without taxel and position.
    pub absent: usize,
}

impl<'a> UniquePoints<'a> {
    /// Finds the positions of a sheet, all of which must be finite.
    ///
    /// Of coincident taxels the first with a pressure reading is kept, else the first.
    pub(in crate::skin) fn new(sheet: &'a Sheet) -> Self {
        let is_empty = |k: usize| {
            let has_normal = sheet.normals.as_ref().is_some_and(|n| n[k] != DVec3::ZERO);
            let presence = sheet.presence.as_ref().map_or(Presence::Present, |p| p[k]);
            presence == Presence::Absent && sheet.positions[k] == DVec3::ZERO && !has_normal
        };
        let count = sheet.positions.len();
        let taxels: Vec<usize> = (0..count).filter(|&k| !is_empty(k)).collect();
        let absent = count - taxels.len();
        let scaling = Scaling::around(taxels.iter().map(|&k| sheet.positions[k]));
        // Of coincident taxels the first is kept.
        let reads = |k: usize| sheet.presence.as_ref().is_none_or(|p| p[k] == Presence::Present);
        let (reading, others): (Vec<usize>, Vec<usize>) = taxels.into_iter().partition(|&k| reads(k));
        let taxels: IdVec<VertexId, usize> = [reading, others].concat().into();
        let positions = taxels.map(|&k| scaling.scaled(sheet.positions[k]));
        let normals = taxels.map(|&k| sheet.normals.as_ref().map_or(DVec3::ZERO, |n| n[k]));
        let first = first_at_place(&positions, &normals, scaling.unit);
        let distance = |(v, &first): (VertexId, &VertexId)| positions[v].distance(positions[first]);
        let farthest = first.enumerate().map(distance).fold(0.0, f64::max);
        let (stay, merged): (Vec<VertexId>, Vec<VertexId>) = positions.ids().partition(|&v| first[v] == v);
        let mut merged: Vec<VertexId> = merged.into_iter().map(|v| VertexId::new(taxels[v])).collect();
        merged.sort_unstable();
        let mut places: Vec<(u64, DVec3, usize)> =
            par_map(&stay, |&v| (morton(positions[v]), positions[v], taxels[v]));
        places.par_sort_unstable_by(|a, b| {
            let by = |axis: usize| a.1[axis].total_cmp(&b.1[axis]);
            a.0.cmp(&b.0).then(by(0)).then(by(1)).then(by(2)).then(a.2.cmp(&b.2))
        });
        Self {
            sheet,
            positions: places.iter().map(|&(_, p, _)| p).collect(),
            taxel: places.iter().map(|&(.., k)| k).collect(),
            unit: scaling.unit,
            merged,
            distance: farthest * scaling.unit,
            absent,
        }
    }

    /// A hash of each taxel: of its id where the file has one for each, else of its place.
    pub(super) fn hashes(&self) -> IdVec<VertexId, u64> {
        let ids = self.sheet.ids.as_ref().map(|ids| self.taxel.map(|&k| ids[k].0));
        let is_unique = |ids: &IdVec<VertexId, u32>| ids.iter().collect::<HashSet<_>>().len() == ids.len();
        match ids.filter(is_unique) {
            Some(ids) => ids.map(|&id| hash(u64::from(id))),
            None => self.positions.map(|&p| place_hash(p)),
        }
    }
}

struct Scaling {
    /// Factor that is applied before coordinates are subtracted: it scales down those beyond the square root
    /// of the largest `f64`.
    down: f64,
    low: DVec3,
    /// Longest side, in m; 1 where there is none.
    unit: f64,
    /// Longest side after `down`.
    side: f64,
}

impl Scaling {
    fn around(positions: impl Iterator<Item = DVec3> + Clone) -> Self {
        let largest = positions.clone().fold(0.0, |most: f64, p| most.max(p.abs().max_element()));
        let down = if largest > f64::MAX.sqrt() { f64::MAX.sqrt().recip() } else { 1.0 };
        let (low, high) = positions.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| {
            (low.min(p * down), high.max(p * down))
        });
        let side = (high - low).max_element();
        let side = if side > 0.0 && side.is_finite() { side } else { 1.0 };
        Self { down, low, unit: side / down, side }
    }

    fn scaled(&self, p: DVec3) -> DVec3 {
        (p * self.down - self.low) / self.side
    }
}

/// Two taxels coincide if they are closer than this fraction of the median distance from the centre of the
/// sheet: the rounding of an `f32`, far below the accuracy of any mounting. The median is robust against
/// sentinel coordinates such as -999; the bounding box is not.
const RESOLUTION: f64 = 1.0 / (1_u64 << 24) as f64;

/// They also coincide if they are closer than this share of the distance to the third nearest taxel, and than
/// [`MOST_APART`], unless the file's normals point to different sides: one of them was rounded to the digits
/// of a text. A face with both would be a sliver, fifty times longer than high. The share is at least 0.41
/// for the taxels of an iCub and 0.1 for a lattice with a noise of 0.3 spacings; of random points one in 1250
/// is below the limit.
const SAME_PLACE: f64 = 0.02;

/// Rounding to the digits of a text moves a taxel by at most this, in m: a taxel farther away is another pad,
/// or the other side of a foil.
const MOST_APART: f64 = 1e-4;

/// Taxels within the resolution of each other fill at most this many cells.
const CELLS: usize = 8;

/// For every taxel the first that coincides with it. `normals` may be zero, and `unit` is the unit of length,
/// in m.
///
/// Taxels that coincide through others count as coincident. Of more than `CELLS` taxels within the reach of
/// one, only the nearest are compared, and each cell by one taxel: there the order of the taxels can matter.
fn first_at_place(
    positions: &IdVec<VertexId, DVec3>,
    normals: &IdVec<VertexId, DVec3>,
    unit: f64,
) -> IdVec<VertexId, VertexId> {
    let resolution = RESOLUTION * median_distance(positions);
    let mut sets = DisjointSets::<VertexId>::new(positions.len());
    // Among many copies a search for the nearest taxels would find only copies.
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
        // If the square of the reach underflows, nothing is found.
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
