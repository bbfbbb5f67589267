use std::collections::HashMap;

use glam::DVec3;
use rayon::prelude::*;

use crate::{
    id::{IdVec, VertexId},
    mesh::morton,
    skin::{Presence, Sheet},
};

/// Two taxels are at one place if they are, up to this part of the median distance from the middle of the sheet: 40 of the 53
/// bits of a number, far below what any sensor can be mounted to, and far above the rounding of a change of frame. Unlike the
/// extent, the median does not mind a number that stands for none among the coordinates.
const RESOLUTION: f64 = 1.0 / (1_u64 << 40) as f64;

/// The places of the taxels of a sheet, each once.
///
/// They are numbered along a Morton curve, equal codes by coordinate, so that no result depends on the order of the
/// file, and neighbours lie close together in memory.
#[derive(Debug)]
pub(super) struct Places {
    /// Moved and scaled so that the longest side of their box is 1: the largest coordinates do not overflow when squared.
    pub positions: IdVec<VertexId, DVec3>,
    /// The taxel of the sheet that lies there.
    pub taxel: IdVec<VertexId, usize>,
    /// How long 1 is, in m.
    pub unit: f64,
    /// Taxels of the sheet that lie where an earlier one lies.
    pub merged: Vec<usize>,
    /// Slots of the sheet that hold nothing and have no place.
    pub absent: usize,
}

impl Places {
    /// Finds them. All positions must be finite.
    ///
    /// Of several taxels at one place the first stays that has a pressure reading, else the first.
    pub(super) fn new(sheet: &Sheet) -> Self {
        let is_empty = |k: usize| {
            let has_normal = sheet.normals.as_ref().is_some_and(|n| n[k] != DVec3::ZERO);
            let presence = sheet.presence.as_ref().map_or(Presence::Present, |p| p[k]);
            presence == Presence::Absent && sheet.positions[k] == DVec3::ZERO && !has_normal
        };
        let count = sheet.positions.len();
        let mut taxels: Vec<usize> = (0..count).filter(|&k| !is_empty(k)).collect();
        let absent = count - taxels.len();
        let frame = Frame::around(taxels.iter().map(|&k| sheet.positions[k]));
        let resolution =
            RESOLUTION * median_distance(taxels.iter().map(|&k| frame.scaled(sheet.positions[k])).collect());
        let cell = |k: usize| cell(frame.scaled(sheet.positions[k]), resolution);
        let reads = |k: usize| sheet.presence.as_ref().is_none_or(|p| p[k] == Presence::Present);
        let mut first: HashMap<[i64; 3], usize> = HashMap::with_capacity(taxels.len());
        for wanted in [true, false] {
            for &k in taxels.iter().filter(|&&k| reads(k) == wanted) {
                first.entry(cell(k)).or_insert(k);
            }
        }
        let is_first = |k: usize| first.get(&cell(k)) == Some(&k);
        let merged = taxels.iter().copied().filter(|&k| !is_first(k)).collect();
        taxels.retain(|&k| is_first(k));
        let mut places: Vec<(u64, DVec3, usize)> = taxels
            .into_par_iter()
            .map(|k| (frame.scaled(sheet.positions[k]), k))
            .map(|(p, k)| (morton(p), p, k))
            .collect();
        places.par_sort_unstable_by(|a, b| {
            let by = |axis: usize| a.1[axis].total_cmp(&b.1[axis]);
            a.0.cmp(&b.0).then(by(0)).then(by(1)).then(by(2)).then(a.2.cmp(&b.2))
        });
        Self {
            positions: places.iter().map(|&(_, p, _)| p).collect(),
            taxel: places.iter().map(|&(.., k)| k).collect(),
            unit: frame.unit,
            merged,
            absent,
        }
    }
}

/// The box of a sheet.
struct Frame {
    /// Numbers beyond the square root of the largest are brought down before they are subtracted.
    down: f64,
    low: DVec3,
    /// Longest side, in m; 1 where there is none.
    unit: f64,
    /// Longest side after `down`.
    side: f64,
}

impl Frame {
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
    reason = "a cast saturates, and only beyond 2^23 median distances"
)]
fn cell(p: DVec3, resolution: f64) -> [i64; 3] {
    (p / resolution).to_array().map(|x| x.round() as i64)
}
