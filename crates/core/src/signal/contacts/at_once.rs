//! How many contacts there are at once, voted over the frames of a touch.
//!
//! A touch is what happens on a link from the first frame with a contact until there was none for 0.15 s. Each frame
//! votes for its number of contacts with its load, the sum of the twelve largest readings in contact, if that is above 0.7
//! of the largest load of the touch; of frames with a contact there are at least two. Loads are kept as counts in bins
//! of a fiftieth each, so that a touch of any length needs the same memory.

use crate::id::{IdVec, VertexId};
use crate::map::{PatchMap, SkinMap};
use crate::signal::Tick;
use crate::signal::clock::{SAME_S, visit_count};
use crate::signal::contacts::{ContactEvent, ContactRegion};
use crate::skin::{LinkId, PatchId};

/// Readings that add up to the load.
const LARGEST: usize = 12;

/// Frames with less than this share of the largest load do not vote: this many bins below the largest.
const BINS: i32 = 18;
const BIN_RATIO: f64 = 1.02;

/// Largest number of contacts that is counted.
const MOST: usize = 31;

/// How long nothing touches before a touch has ended, in s.
const REST_S: f64 = 0.15;

/// Counts the contacts of touches.
#[derive(Debug, Clone)]
pub(super) struct AtOnce {
    touches: IdVec<LinkId, Touch>,
    links: IdVec<PatchId, LinkId>,
    now: f64,
    /// Load and count of the strongest touch that has ended.
    strongest: (f64, usize),
    values: Vec<f64>,
}

/// A touch of a link.
#[derive(Debug, Clone)]
struct Touch {
    frames: usize,
    load: f64,
    bin: i32,
    until: f64,
    /// For each bin, by its number modulo their count, the load of the frames with each number of contacts.
    votes: Vec<[f64; MOST + 1]>,
}

impl AtOnce {
    pub(super) fn new(map: &SkinMap) -> Self {
        let touch = Touch {
            frames: 0,
            load: 0.0,
            bin: i32::MIN,
            until: 0.0,
            votes: vec![[0.0; MOST + 1]; BINS.unsigned_abs() as usize],
        };
        Self {
            touches: map.links.map(|_| touch.clone()),
            links: map.patches.map(|patch: &PatchMap| patch.link),
            now: 0.0,
            strongest: (0.0, 0),
            values: Vec::new(),
        }
    }

    /// Takes the contacts of a frame, what its time says and how long the step to it was, in s; the values are those of
    /// the taxels.
    pub(super) fn see<'v>(
        &mut self,
        tick: Tick,
        elapsed: f64,
        regions: &[ContactRegion],
        values: impl Fn(PatchId) -> &'v IdVec<VertexId, f64>,
    ) {
        self.now += elapsed;
        for (link, touch) in self.touches.iter_mut().enumerate() {
            let is_here = |region: &&ContactRegion| {
                region.event != ContactEvent::Release && self.links[region.patch].index() == link
            };
            if tick.is_cut() {
                touch.end(&mut self.strongest);
            }
            self.values.clear();
            let mut count = 0;
            for region in regions.iter().filter(is_here) {
                count += 1;
                let read = region.all_taxels().map(|at| values(at.patch)[at.taxel]);
                self.values.extend(read.filter(|x| *x > 0.0));
            }
            if count > 0 {
                let place = LARGEST.min(self.values.len());
                if place < self.values.len() {
                    self.values.select_nth_unstable_by(place, |a, b| b.total_cmp(a));
                }
                touch.add(self.values[..place].iter().sum(), count.min(MOST));
                touch.until = self.now;
            } else if self.now - touch.until > REST_S + SAME_S {
                touch.end(&mut self.strongest);
            }
        }
    }

    /// All that it remembers, number by number, to be read or set.
    pub(super) fn visit(&mut self, visit: &mut dyn FnMut(&mut f64)) {
        visit(&mut self.now);
        visit(&mut self.strongest.0);
        visit_count(&mut self.strongest.1, visit);
        for touch in &mut self.touches {
            visit_count(&mut touch.frames, visit);
            visit(&mut touch.load);
            touch.bin = if touch.load > 0.0 { bin_of(touch.load) } else { i32::MIN };
            visit(&mut touch.until);
            touch.votes.iter_mut().flatten().for_each(&mut *visit);
        }
    }

    /// The number of contacts of the strongest touch so far; 0 if there was none.
    pub(super) fn strongest(&self) -> usize {
        let going_on = self.touches.iter().filter(|touch| touch.frames > 1);
        let of_now = going_on.map(|touch| (touch.load, touch.voted()));
        of_now.fold(self.strongest, |best, touch| if touch.0 > best.0 { touch } else { best }).1
    }
}

/// The bin of a load above 0.
#[expect(clippy::cast_possible_truncation, reason = "the logarithm of a number has few digits")]
fn bin_of(load: f64) -> i32 {
    (load.ln().min(1e3) / BIN_RATIO.ln()).floor() as i32
}

impl Touch {
    fn add(&mut self, load: f64, count: usize) {
        self.frames += 1;
        if !(load.is_finite() && load > 0.0) {
            return;
        }
        let bin = bin_of(load);
        let slot = |bin: i32| bin.rem_euclid(BINS).unsigned_abs() as usize;
        if self.load == 0.0 {
            self.bin = bin;
        }
        for emptied in (self.bin + 1..=bin).rev().take(self.votes.len()) {
            self.votes[slot(emptied)] = [0.0; MOST + 1];
        }
        self.bin = self.bin.max(bin);
        self.load = self.load.max(load);
        if bin > self.bin - BINS {
            self.votes[slot(bin)][count] += load;
        }
    }

    /// The number with most votes; of several the smallest.
    fn voted(&self) -> usize {
        let sum = |count: usize| self.votes.iter().map(|bin| bin[count]).sum::<f64>();
        (0..=MOST)
            .fold((0, 0.0), |best, count| if sum(count) > best.1 { (count, sum(count)) } else { best })
            .0
    }

    /// Ends it, if it has begun.
    fn end(&mut self, strongest: &mut (f64, usize)) {
        if self.frames == 0 {
            return;
        }
        if self.load > strongest.0 && self.frames > 1 {
            *strongest = (self.load, self.voted());
        }
        (self.frames, self.load, self.bin) = (0, 0.0, i32::MIN);
        self.votes.iter_mut().for_each(|bin| *bin = [0.0; MOST + 1]);
    }
}
