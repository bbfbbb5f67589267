//! The threshold of contacts: given, or estimated from the readings of the first frames.
//!
//! The standard deviation of every taxel over the first frames is estimated. The noise is the 95 % quantile
//! over the taxels, divided by the same quantile for Gaussian noise of standard deviation 1 (from the
//! chi-square distribution). So uniform noise gives its own standard deviation, uneven noise that of the
//! noisiest taxels, and a twentieth of the taxels may be touched or broken. *Heuristic*: on a cover of 642
//! capacitive taxels, a median over all taxels (the median absolute deviation, `(rousseeuw1987)`) finds 90 counts
//! although a tenth of the taxels has more than 260; with it the untouched cover had regions of up to four
//! taxels in most frames.
//!
//! Taxels that never change are left out: many sensors clip their readings at zero. Separate noise for each
//! taxel does not change the result on recordings of that cover: false contacts came from taxels whose
//! readings at rest are not zero, so each taxel's mean over these frames counts as its zero, unless readings are about 0
//! at rest already ([`Rest::AtZero`]).
//!
//! The frames must be at rest. Where readings are not about 0, three taxels next to each other whose readings move
//! together, much more than from frame to frame, show that they are not ([`is_moving`]), which is said. Where readings are
//! about 0, two such taxels far above 0 show it ([`is_loaded`]): then the noise is that of the readings below 0.

use crate::id::{IdVec, VertexId};
use crate::numeric::{Csr, quantile};
use crate::signal::contacts::Rest;
use crate::signal::noise::QUIETER_SHARE;
use crate::signal::{Frame, TrackerOptions};
use crate::skin::PatchId;

/// Number of frames in which noise raises one taxel of the skin above the threshold once: more than an hour
/// at 250 Hz. A region needs two taxels.
const FRAMES_PER_FALSE_ALARM: f64 = 1e6;

/// Threshold over the largest reading at rest, for readings without noise: above the rounding of a subtracted
/// baseline. *Heuristic*.
const SHARE_OF_REST: f64 = 1e-6;

/// A taxel moves if the variance of its readings is this many times that which their differences from frame to frame
/// show; of five frames of noise one in a hundred has that, of a steady rise the ratio is 5.
const MOVES: f64 = 3.0;

/// A taxel is loaded if its mean is above this many times its noise.
const LOADED: f64 = 6.0;

/// Readings below 0, of all, from which on these show the noise: a half are, where all is at rest.
const LEAST_BELOW: f64 = 0.05;

/// The threshold of contacts, as far as it is known.
#[derive(Debug, Clone)]
pub(super) enum Threshold {
    Known(f64),
    /// The readings of some frames, one frame after the other.
    Learning(Vec<f64>),
    /// There were too few frames.
    Unknown,
}

impl Threshold {
    pub(super) fn new(options: &TrackerOptions) -> Self {
        options.threshold.map_or(Self::Learning(Vec::new()), Self::Known)
    }

    /// The threshold, in the unit of the channel, if it is known.
    pub(super) fn known(&self) -> Option<f64> {
        match self {
            Self::Known(threshold) => Some(*threshold),
            Self::Learning(_) | Self::Unknown => None,
        }
    }

    /// The readings of the frames that were kept.
    pub(super) fn kept(&self) -> &[f64] {
        if let Self::Learning(kept) = self { kept } else { &[] }
    }

    /// Goes on from a threshold, or from frames that were kept.
    pub(super) fn resume(&mut self, threshold: Option<f64>, kept: Vec<f64>) {
        *self = threshold.map_or(Self::Learning(kept), Self::Known);
    }

    /// Keeps the readings of a frame. True as soon as there are as many frames as the options require.
    pub(super) fn learn(&mut self, frame: &Frame, options: &TrackerOptions, taxels: usize) -> bool {
        let Self::Learning(kept) = self else { return true };
        kept.extend(frame.values.iter().flat_map(|patch| &patch[options.channel]));
        kept.len() >= options.noise_frames * taxels
    }

    /// Estimates the threshold from the stored frames, and the readings of taxels at rest. Returns whether taxels next to
    /// each other moved together in these frames.
    pub(super) fn settle(
        &mut self,
        rest: &mut IdVec<PatchId, IdVec<VertexId, f64>>,
        options: &TrackerOptions,
        neighbours: &Csr<u32>,
    ) -> bool {
        let Self::Learning(kept) = self else { return false };
        let taxels = neighbours.len();
        let frames = kept.len() / taxels.max(1);
        if frames < 2 {
            *self = Self::Unknown;
            return false;
        }
        let is_about_zero = options.rest == Rest::AtZero;
        let is_moving = !is_about_zero && is_moving(kept, neighbours);
        if !is_about_zero {
            let of_all = rest.iter_mut().flat_map(|patch| patch.iter_mut());
            of_all.enumerate().for_each(|(taxel, rest)| *rest = mean(kept, taxel, taxels));
        }
        let noise = if is_about_zero && is_loaded(kept, neighbours) {
            noise_below_zero(kept)
        } else {
            noise(kept, frames, taxels)
        };
        *self = Self::Known(if noise > 0.0 {
            noise * quantiles(frames, taxels)
        } else {
            let finite = kept.iter().filter(|x| x.is_finite());
            SHARE_OF_REST * finite.fold(0.0, |largest, x| x.abs().max(largest))
        });
        is_moving
    }
}

/// The mean of the finite readings of one of `taxels` taxels; 0 if it has none.
fn mean(kept: &[f64], taxel: usize, taxels: usize) -> f64 {
    let finite = kept.iter().skip(taxel).step_by(taxels).filter(|x| x.is_finite());
    let (sum, count) = finite.fold((0.0, 0.0), |(sum, count), x| (sum + x, count + 1.0));
    if count > 0.0 { sum / count } else { 0.0 }
}

/// Mean and variance of the readings of a taxel, the variance that differences from frame to frame show, and how far the
/// last reading is from the first.
fn spread(kept: &[f64], taxel: usize, taxels: usize) -> [f64; 4] {
    let of_taxel = || kept.iter().skip(taxel).step_by(taxels).copied().filter(|x| x.is_finite());
    let count = of_taxel().count() as f64;
    let mean = of_taxel().sum::<f64>() / count;
    let variance = of_taxel().map(|x| (x - mean).powi(2)).sum::<f64>() / (count - 1.0);
    let differences = of_taxel().zip(of_taxel().skip(1)).map(|(a, b)| (b - a).powi(2)).sum::<f64>();
    let moved = of_taxel().next_back().unwrap_or(f64::NAN) - of_taxel().next().unwrap_or(f64::NAN);
    [mean, variance, 0.5 * differences / (count - 1.0), moved]
}

/// Whether three taxels next to each other move together.
fn is_moving(kept: &[f64], neighbours: &Csr<u32>) -> bool {
    let taxels = neighbours.len();
    let direction = |taxel: usize| {
        let [_, variance, of_noise, moved] = spread(kept, taxel, taxels);
        if variance > MOVES * of_noise { moved } else { 0.0 }
    };
    let moved: Vec<f64> = (0..taxels).map(direction).collect();
    let is_with = |k: usize, other: u32| moved[other as usize] * moved[k] > 0.0;
    (0..taxels).any(|k| neighbours[k].iter().filter(|&&other| is_with(k, other)).count() >= 2)
}

/// Whether two taxels next to each other are far above 0.
fn is_loaded(kept: &[f64], neighbours: &Csr<u32>) -> bool {
    let taxels = neighbours.len();
    let is_high = |taxel: usize| {
        let [mean, _, of_noise, _] = spread(kept, taxel, taxels);
        mean > LOADED * of_noise.sqrt()
    };
    let is_high: Vec<bool> = (0..taxels).map(is_high).collect();
    (0..taxels).any(|k| is_high[k] && neighbours[k].iter().any(|&other| is_high[other as usize]))
}

/// Standard deviation of the noise about 0 of readings under load, from those below 0; 0 where these are too few, since
/// readings are cut off at 0.
fn noise_below_zero(kept: &[f64]) -> f64 {
    let known = kept.iter().filter(|x| x.is_finite()).count() as f64;
    let mut below: Vec<f64> = kept.iter().copied().filter(|x| *x < 0.0).map(f64::abs).collect();
    if (below.len() as f64) < LEAST_BELOW * known || below.is_empty() {
        return 0.0;
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a length")]
    let place = (QUIETER_SHARE * (below.len() - 1) as f64) as usize;
    *below.select_nth_unstable_by(place, f64::total_cmp).1 / quantile(QUIETER_SHARE, 1.0).sqrt()
}

/// Standard deviation of the readings of the noisiest taxels, of `taxels` in `frames` frames; 0 if
/// none varies.
fn noise(kept: &[f64], frames: usize, taxels: usize) -> f64 {
    let mut deviations = Vec::with_capacity(taxels);
    for taxel in 0..taxels {
        let of_taxel = || kept.iter().skip(taxel).step_by(taxels).take(frames).filter(|x| x.is_finite());
        let count = of_taxel().count() as f64;
        let Some(first) = of_taxel().next() else { continue };
        if of_taxel().any(|x| x != first) {
            let mean = of_taxel().sum::<f64>() / count;
            let variance = of_taxel().map(|x| (x - mean) * (x - mean)).sum::<f64>() / (count - 1.0);
            deviations.push(variance.sqrt());
        }
    }
    if deviations.is_empty() {
        return 0.0;
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a length")]
    let place = (QUIETER_SHARE * (deviations.len() - 1) as f64) as usize;
    let noisiest = *deviations.select_nth_unstable_by(place, f64::total_cmp).1;
    // The same quantile for uniform noise.
    let freedom = frames as f64 - 1.0;
    noisiest / (quantile(QUIETER_SHARE, freedom) / freedom).sqrt()
}

/// Threshold over noise. A baseline that is the mean of `frames` frames is itself noisy.
fn quantiles(frames: usize, taxels: usize) -> f64 {
    let chance = (taxels as f64 * FRAMES_PER_FALSE_ALARM).recip();
    // The square of a Gaussian number exceeds it with twice the probability, since there are two sides.
    quantile(1.0 - 2.0 * chance.min(0.25), 1.0).sqrt() * (1.0 + (frames as f64).recip()).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::Random;

    /// Tails of the Gaussian distribution from tables: 2.87e-7 above 5, 9.87e-10 above 6.
    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (tail, expected) in [(2.866_5e-7, 5.0), (9.866e-10, 6.0)] {
            let found = quantile(1.0 - 2.0 * tail, 1.0).sqrt();
            assert!((found - expected).abs() < 1e-3, "{found} is not {expected}");
        }
        assert!((6.0..7.5).contains(&quantiles(5, 642)), "{}", quantiles(5, 642));
    }

    #[test]
    fn the_noise_is_found_despite_spikes_and_clipped_taxels() {
        let (frames, taxels) = (5, 600);
        let mut random = Random::new(3, 0);
        let mut readings: Vec<f64> = (0..frames * taxels).map(|_| 100.0 + 2.5 * random.normal()).collect();
        for (k, x) in readings.iter_mut().enumerate() {
            match k % taxels {
                0..10 => *x *= 1.0 + (k / taxels) as f64,
                10..300 => *x = 0.0,
                300..320 => *x = f64::NAN,
                _ => {}
            }
        }
        let found = noise(&readings, frames, taxels);
        assert!((found / 2.5 - 1.0).abs() < 0.3, "{found} is not 2.5");
        let even: Vec<f64> = (0..frames * taxels).map(|_| 2.5 * random.normal()).collect();
        let found = noise(&even, frames, taxels);
        assert!((found / 2.5 - 1.0).abs() < 0.1, "{found} is not 2.5");
        readings.iter_mut().for_each(|x| *x = x.round().clamp(100.0, 100.0));
        assert_eq!(noise(&readings, frames, taxels), 0.0, "nothing varies");
    }
}
