//! The positions of the taxels of a sheet, each once, in a frame and an order of their own.

use glam::DVec3;
use rayon::prelude::*;

use crate::{
    id::{IdVec, VertexId},
    numeric::morton,
    parallel::par_map,
    skin::{Presence, Sheet, triangulate::coincident::first_at_place},
};

/// The positions of the taxels of a sheet, each once.
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
    /// The taxel of the sheet that lies there.
    pub taxel: IdVec<VertexId, usize>,
    /// The length of 1, in m.
    pub unit: f64,
    /// Taxels of the sheet that were merged with another one, ascending.
    pub merged: Vec<VertexId>,
    /// The largest distance between merged taxels, in m.
    pub distance: f64,
    /// Slots of the sheet without taxel and position.
    pub absent: usize,
}

impl<'a> UniquePoints<'a> {
    /// Finds them. All positions must be finite.
    ///
    /// Of several taxels at one position the first stays that has a pressure reading, else the
    /// first.
    pub(in crate::skin) fn new(sheet: &'a Sheet) -> Self {
        let is_empty = |k: usize| {
            let has_normal = sheet.normals.as_ref().is_some_and(|n| n[k] != DVec3::ZERO);
            let presence = sheet.presence.as_ref().map_or(Presence::Present, |p| p[k]);
            presence == Presence::Absent && sheet.positions[k] == DVec3::ZERO && !has_normal
        };
        let count = sheet.positions.len();
        let taxels: Vec<usize> = (0..count).filter(|&k| !is_empty(k)).collect();
        let absent = count - taxels.len();
        let frame = Frame::around(taxels.iter().map(|&k| sheet.positions[k]));
        // Of several taxels at one place the first stays.
        let reads = |k: usize| sheet.presence.as_ref().is_none_or(|p| p[k] == Presence::Present);
        let (reading, others): (Vec<usize>, Vec<usize>) = taxels.into_iter().partition(|&k| reads(k));
        let taxels: IdVec<VertexId, usize> = [reading, others].concat().into();
        let positions = taxels.map(|&k| frame.scaled(sheet.positions[k]));
        let normals = taxels.map(|&k| sheet.normals.as_ref().map_or(DVec3::ZERO, |n| n[k]));
        let first = first_at_place(&positions, &normals, frame.unit);
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
            unit: frame.unit,
            merged,
            distance: farthest * frame.unit,
            absent,
        }
    }
}

struct Frame {
    /// Coordinates beyond the square root of the largest `f64` are scaled down before they are
    /// subtracted.
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
