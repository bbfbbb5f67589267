//! The readings of fingers: above zeros that follow drift, without faulty taxels, smoothed in time, and their noise.

use crate::id::{IdVec, VertexId};
use crate::map::SkinMap;
use crate::mesh::neighbours;
use crate::numeric::{Csr, median_of};
use crate::pyramid::LevelId;
use crate::signal::noise::QUIETER_SHARE;
use crate::signal::{Channel, Frame, Rest, Stage, Tick, ZeroTracker};
use crate::skin::PatchId;

/// The threshold over `sigma`.
pub(in crate::signal::contacts) const HIGH: f64 = 6.0;

/// Time constant of the smoothing, in s.
const SMOOTHING_S: f64 = 0.15;

/// Standard deviation of smoothed noise over that of noise at 10 Hz, for which the thresholds were chosen.
const USUAL_NOISE: f64 = 0.577;

/// A reading above this many `sigma` is a fault if the largest next to it is below this share of it: a touch that a
/// taxel feels is also felt next to it.
const SPIKE: f64 = 6.0;
const SPIKE_SHARE: f64 = 0.12;

/// Prepares frames; owns its buffers.
#[derive(Debug, Clone)]
pub(super) struct Live {
    /// Follows zeros and noise; `None` where readings are near 0 at rest already, because the threshold was given.
    zero: Option<ZeroTracker>,
    /// What of readings counts: above the zeros that are followed, or above 0.
    rest: Rest,
    input: Frame,
    /// The taxels next to each one.
    neighbours: IdVec<PatchId, Csr<u32>>,
    /// Above zero, and these without faults, smoothed.
    pub(super) excess: IdVec<PatchId, IdVec<VertexId, f64>>,
    pub(super) smooth: IdVec<PatchId, IdVec<VertexId, f64>>,
    /// Variance of smoothed noise over that of readings.
    variance: f64,
    /// Standard deviation of the noise of readings; 0 where it is not known.
    noise: f64,
    scratch: Vec<f64>,
}

impl Live {
    /// `first_frames`: the zero is estimated from this many frames and followed, unless readings are at zero at rest: then
    /// their noise alone is; `None`: it is 0.
    pub(super) fn new(map: &SkinMap, channel: &Channel, first_frames: Option<usize>, rest: Rest) -> Self {
        let zeros = map.patches.map(|patch| IdVec::filled(0.0, patch.taxels.ids.len()));
        let neighbours = map.patches.map(|patch| neighbours([&patch.levels[LevelId::new(0)].level.mesh]));
        let taxels = zeros.iter().map(|patch| patch.len()).sum();
        Self {
            zero: first_frames
                .map(|frames| ZeroTracker::starting(map, std::slice::from_ref(channel), 0.0, frames)),
            rest,
            input: Frame::new(map, 1),
            neighbours,
            excess: zeros.clone(),
            smooth: zeros,
            variance: 0.0,
            noise: 0.0,
            scratch: Vec::with_capacity(taxels),
        }
    }

    /// Takes the next frame, what its time says, and the time in s by which smoothing moves on. `threshold` is that of
    /// contacts by now, by which faults are found.
    pub(super) fn see(
        &mut self,
        frame: &Frame,
        (tick, elapsed): (Tick, f64),
        channel: usize,
        threshold: Option<f64>,
    ) {
        for (patch, channels) in frame.values.enumerate() {
            self.input.values[patch][0].as_mut_slice().copy_from_slice(channels[channel].as_slice());
        }
        self.input.time = frame.time;
        let above = match &mut self.zero {
            Some(zero) => {
                let above = zero.apply(&self.input);
                if self.rest == Rest::AtZero { &self.input } else { above }
            }
            None => &self.input,
        };
        for (excess, channels) in self.excess.iter_mut().zip(&above.values) {
            excess.as_mut_slice().copy_from_slice(channels[0].as_slice());
        }
        self.estimate_noise();
        let share = if tick.is_cut() { 1.0 } else { 1.0 - (-elapsed / SMOOTHING_S).exp() };
        self.variance = (1.0 - share).powi(2) * self.variance + share * share;
        let spike = self.sigma(threshold).map_or(f64::INFINITY, |sigma| SPIKE * sigma);
        for (patch, excess) in self.excess.enumerate() {
            for (taxel, &x) in excess.enumerate() {
                let around = &self.neighbours[patch][taxel.index()];
                let known = || around.iter().map(|&v| excess[v.into()]).filter(|x| x.is_finite());
                // Without a neighbour that reads there is nothing to compare it with.
                let is_lone = || known().reduce(f64::max).is_some_and(|largest| largest < SPIKE_SHARE * x);
                let is_fault = !x.is_finite() || (x > spike && is_lone());
                let x = if is_fault {
                    self.scratch.clear();
                    self.scratch.extend(known());
                    median_of(&mut self.scratch).unwrap_or(0.0)
                } else {
                    x
                };
                let smooth = &mut self.smooth[patch][taxel];
                *smooth += share * (x - *smooth);
            }
        }
    }

    fn estimate_noise(&mut self) {
        let Some(zero) = &self.zero else { return };
        self.scratch.clear();
        self.scratch.extend(zero.noise().filter(|sigma| sigma.is_finite()));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a length")]
        let place = (QUIETER_SHARE * self.scratch.len() as f64) as usize;
        if place < self.scratch.len() {
            self.noise = *self.scratch.select_nth_unstable_by(place, f64::total_cmp).1;
        }
    }

    /// Standard deviation that thresholds are multiples of: of the noise if it is followed, else a sixth of the
    /// threshold.
    pub(super) fn sigma(&self, threshold: Option<f64>) -> Option<f64> {
        let known = self.noise * self.variance.sqrt() / USUAL_NOISE;
        if known > 0.0 { Some(known) } else { threshold.map(|threshold| threshold / HIGH) }
    }
}
