//! The path of a contact: its ends, its reach, its length and its turns.
//!
//! Centres of pressure are averaged over blocks of time. The motion over many blocks takes long to measure, so it is
//! measured only where a word or a report depends on it: not while all blocks are in a box that is smaller than a stroke.

use glam::{DVec2, DVec3};

use crate::numeric::symmetric_eigen;
use crate::signal::ContactRegion;
use crate::signal::clock::SAME_S;
use crate::signal::events::EventPlace;
use crate::skin::PatchId;

/// Centres of pressure are averaged over blocks of this time, in s; when there are more than [`BLOCKS`], of twice the time.
const BLOCK_S: f64 = 0.02;
const BLOCKS: usize = 256;

/// Blocks with less than this share of the largest load do not count: their centres are noise.
const LOADED: f64 = 0.25;

/// Steps of a path, in m, and the cosine of the angle from which one turns.
const STEP: f64 = 0.004;
const TURN_COSINE: f64 = -0.5;

/// Share of the first and the last blocks whose medoid is an end of the path, and of the places within its reach: a place
/// beside the others does not count.
const END: usize = 8;
const REACH: f64 = 0.95;

/// The mean of the frames of a block.
#[derive(Debug, Clone, Copy, Default)]
struct Block {
    begin: f64,
    frames: f64,
    /// All are on this patch.
    patch: PatchId,
    /// Sums over the frames: the load, and centres times load.
    load: f64,
    point: DVec3,
    map: DVec2,
}

/// How a contact has moved.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Motion {
    pub(super) from: EventPlace,
    pub(super) to: EventPlace,
    pub(super) net: f64,
    pub(super) reach: f64,
}

/// The path of a contact so far.
#[derive(Debug, Clone)]
pub(super) struct Path {
    block_s: f64,
    blocks: Vec<Block>,
    /// Blocks to which no frame is added any more, and the largest of their mean loads.
    complete: usize,
    largest: f64,
    /// Of the complete blocks, if `is_measured`.
    motion: Motion,
    is_measured: bool,
    /// A box that has all complete blocks that count: its corners.
    low: DVec3,
    high: DVec3,
    anchor: Option<DVec3>,
    last_step: DVec3,
    pub(super) length: f64,
    pub(super) turns: usize,
    places: Vec<EventPlace>,
    scratch: Vec<f64>,
}

impl Path {
    pub(super) fn new() -> Self {
        Self {
            block_s: BLOCK_S,
            blocks: Vec::with_capacity(BLOCKS + 1),
            complete: 0,
            largest: 0.0,
            motion: Motion::default(),
            is_measured: true,
            low: DVec3::INFINITY,
            high: DVec3::NEG_INFINITY,
            anchor: None,
            last_step: DVec3::ZERO,
            length: 0.0,
            turns: 0,
            places: Vec::with_capacity(BLOCKS + 1),
            scratch: Vec::with_capacity(BLOCKS + 1),
        }
    }

    /// Takes the contact in a frame, with its centre in the frame of the path.
    pub(super) fn add(&mut self, time: f64, region: &ContactRegion, centre: DVec3) {
        let load = region.peak.max(f64::MIN_POSITIVE);
        let is_new = self
            .blocks
            .last()
            .is_none_or(|block| time - block.begin >= self.block_s - SAME_S || block.patch != region.patch);
        if is_new {
            self.complete_block();
            self.blocks.push(Block { begin: time, patch: region.patch, ..Block::default() });
        }
        if let Some(block) = self.blocks.last_mut() {
            block.frames += 1.0;
            block.load += load;
            block.point += load * centre;
            block.map += load * region.map;
        }
    }

    /// Completes the last block: when another begins, and after the last frame.
    pub(super) fn complete_block(&mut self) {
        let Some(&block) = self.blocks.last() else { return };
        (self.complete, self.is_measured) = (self.blocks.len(), false);
        self.largest = self.largest.max(block.mean());
        if block.mean() >= LOADED * self.largest {
            let at = block.place().point;
            (self.low, self.high) = (self.low.min(at), self.high.max(at));
            match self.anchor {
                None => self.anchor = Some(at),
                Some(anchor) if at.distance(anchor) >= STEP => {
                    let step = at - anchor;
                    self.length += step.length();
                    let cosine = step.normalize_or_zero().dot(self.last_step);
                    self.turns += usize::from(cosine < TURN_COSINE);
                    (self.last_step, self.anchor) = (step.normalize_or_zero(), Some(at));
                }
                Some(_) => {}
            }
        }
        if self.blocks.len() >= BLOCKS {
            self.join_blocks();
        }
    }

    /// Joins pairs of blocks.
    fn join_blocks(&mut self) {
        self.motion();
        for k in 0..BLOCKS / 2 {
            let (a, b) = (self.blocks[2 * k], self.blocks[2 * k + 1]);
            let load = a.load + b.load;
            // Of two patches the one with the larger load.
            let main = if b.load > a.load { b } else { a };
            let is_on_one = a.patch == b.patch;
            self.blocks[k] = Block {
                begin: a.begin,
                frames: a.frames + b.frames,
                patch: main.patch,
                load,
                point: a.point + b.point,
                map: if is_on_one { a.map + b.map } else { main.map * (load / main.load) },
            };
        }
        self.blocks.truncate(BLOCKS / 2);
        self.complete = self.blocks.len();
        self.block_s *= 2.0;
        self.largest = self.blocks.iter().map(Block::mean).fold(0.0, f64::max);
        self.list_places();
    }

    /// Whether net or reach are longer than this, in m.
    pub(super) fn is_longer(&mut self, than: f64) -> bool {
        if !self.is_measured {
            if self.is_within(than) {
                return false;
            }
            // Blocks that counted before the largest load was reached may not count any more.
            self.list_places();
            if self.is_within(than) {
                return false;
            }
        }
        let Motion { net, reach, .. } = self.motion();
        net > than || reach > than
    }

    /// Whether the diagonal of the box is not longer than this: then net and reach are not either.
    fn is_within(&self, length: f64) -> bool {
        (self.high - self.low).max(DVec3::ZERO).length() <= length
    }

    /// The motion over all complete blocks.
    pub(super) fn motion(&mut self) -> Motion {
        if !self.is_measured {
            self.is_measured = true;
            self.list_places();
            self.measure();
        }
        self.motion
    }

    /// Lists the places of the complete blocks that count, and the box around them.
    fn list_places(&mut self) {
        let least = LOADED * self.largest;
        let loaded = self.blocks[..self.complete].iter().filter(|block| block.mean() >= least);
        self.places.clear();
        self.places.extend(loaded.map(Block::place));
        let points = || self.places.iter().map(|place| place.point);
        self.low = points().fold(DVec3::INFINITY, DVec3::min);
        self.high = points().fold(DVec3::NEG_INFINITY, DVec3::max);
    }

    /// Measures the motion over the listed places.
    fn measure(&mut self) {
        let Self { places, scratch, .. } = self;
        let count = places.len();
        if count == 0 {
            return;
        }
        let end = (count / END).max(1);
        let (from, to) = (medoid(&places[..end]), medoid(&places[count - end..]));
        let along = main_direction(places);
        scratch.clear();
        scratch.extend(places.iter().map(|p| p.point.dot(along)));
        scratch.sort_unstable_by(f64::total_cmp);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a length")]
        let beside = (0.5 * (1.0 - REACH) * count as f64) as usize;
        let reach = scratch[count - 1 - beside] - scratch[beside];
        self.motion = Motion { from, to, net: from.point.distance(to.point), reach };
    }
}

/// The place with the least sum of distances from the others: a median that depends on no axis, with the map
/// of the same time.
fn medoid(places: &[EventPlace]) -> EventPlace {
    let sum = |a: &EventPlace| places.iter().map(|b| a.point.distance(b.point)).sum::<f64>();
    let sums = places.iter().map(|place| (sum(place), place));
    sums.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, place)| *place).unwrap_or_default()
}

/// The direction in which places differ most.
fn main_direction(places: &[EventPlace]) -> DVec3 {
    let mean = places.iter().map(|p| p.point).sum::<DVec3>() / places.len().max(1) as f64;
    let mut sums = [[0.0; 3]; 3];
    for p in places {
        let d = (p.point - mean).to_array();
        for (row, x) in sums.iter_mut().zip(d) {
            row.iter_mut().zip(d).for_each(|(sum, y)| *sum += x * y);
        }
    }
    let (squares, axes) = symmetric_eigen(&sums);
    let largest = (0..3).max_by(|&a, &b| squares[a].total_cmp(&squares[b])).unwrap_or(0);
    DVec3::from_array(std::array::from_fn(|row| axes[row][largest]))
}

impl Block {
    fn mean(&self) -> f64 {
        self.load / self.frames.max(1.0)
    }

    fn place(&self) -> EventPlace {
        EventPlace { point: self.point / self.load, patch: self.patch, map: self.map / self.load }
    }
}
