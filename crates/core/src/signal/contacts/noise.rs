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
//! Zeros that are followed begin in these frames, too: reading `k` is less the mean of the first `k`, and so has the variance
//! `1 - 1/k`. All readings of the first frame are then 0, which shows it ([`restore`]); without that the noise of five frames
//! comes out as 0.74 of what it is.
//!
//! The frames must be at rest. Where readings are not about 0, three taxels next to each other whose readings move
//! together, much more than from frame to frame, show that they are not ([`is_moving`]), which is said. Where readings are
//! about 0, two such taxels far above 0 show it ([`is_loaded`]): then the noise is that of the readings below 0.

use crate::id::{IdVec, VertexId};
use crate::numeric::{Csr, median, quantile};
use crate::signal::contacts::Rest;
use crate::signal::noise::{QUANTISATION, QUIETER_SHARE};
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

/// A taxel jumps if the largest difference of two successive readings is this many times the size of its others, and of those of
/// most taxels. Three that are next to each other do so in one frame in none of 8000 recordings of five frames of uneven normal
/// noise on 640 taxels, and in one of 2000 of noise with heavy tails (Student's t, 3 degrees of freedom).
const JUMPS: f64 = 6.0;

/// A taxel is loaded if its mean is above this many times its noise.
const LOADED: f64 = 6.0;

/// Moving readings about 0 are pressed, if their noise is this many times that of the readings below 0. *Heuristic*: the noise of a
/// capacitive cover moves taxels together, too, and was taken for a press without this limit.
const PRESSED: f64 = 3.0;

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
        let is_moving = is_moving(kept, neighbours);
        if !is_about_zero {
            let of_all = rest.iter_mut().flat_map(|patch| patch.iter_mut());
            of_all.enumerate().for_each(|(taxel, rest)| *rest = mean(kept, taxel, taxels));
        }
        let below = if is_about_zero { noise_below_zero(kept) } else { 0.0 };
        let noise = if is_about_zero && is_loaded(kept, neighbours) {
            below
        } else {
            if is_about_zero {
                restore(kept, taxels);
            }
            let all = noise(kept, frames, taxels);
            let is_pressed = is_about_zero && is_moving && (all > PRESSED * below);
            // Without readings below 0 that show noise, a press is where most taxels read one and the same.
            if is_pressed && (below > 0.0 || is_mostly_still(kept, taxels)) { below } else { all }
        };
        *self = Self::Known(if noise > 0.0 {
            noise * quantiles(frames, taxels)
        } else {
            let finite = kept.iter().filter(|x| x.is_finite());
            SHARE_OF_REST * finite.fold(0.0, |largest, x| x.abs().max(largest))
        });
        is_moving && !is_about_zero
    }
}

/// The mean of the finite readings of one of `taxels` taxels; NaN if it has none: nobody knows where it is at rest.
fn mean(kept: &[f64], taxel: usize, taxels: usize) -> f64 {
    let finite = kept.iter().skip(taxel).step_by(taxels).filter(|x| x.is_finite());
    let (sum, count) = finite.fold((0.0, 0.0), |(sum, count), x| (sum + x, count + 1.0));
    if count > 0.0 { sum / count } else { f64::NAN }
}

/// Adds to each reading the zero that was subtracted, up to that of the first frame, where zeros are the means of all frames so
/// far: the first frame, of which all readings are exactly 0, shows it.
fn restore(kept: &mut [f64], taxels: usize) {
    if kept.iter().take(taxels).any(|x| x.is_finite() && *x != 0.0) {
        return;
    }
    for taxel in 0..taxels {
        let (mut count, mut mean) = (0.0, 0.0);
        for x in kept.iter_mut().skip(taxel).step_by(taxels).filter(|x| x.is_finite()) {
            count += 1.0;
            // `x` is less the mean that it belongs to, which has moved by `x / (count - 1)`.
            mean += if count > 1.0 { *x / (count - 1.0) } else { 0.0 };
            *x += mean;
        }
    }
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

/// Whether three taxels next to each other move together: steadily, or in one and the same frame.
fn is_moving(kept: &[f64], neighbours: &Csr<u32>) -> bool {
    let taxels = neighbours.len();
    let direction = |taxel: usize| {
        let [_, variance, of_noise, moved] = spread(kept, taxel, taxels);
        if variance > MOVES * of_noise { moved } else { 0.0 }
    };
    let moved: Vec<f64> = (0..taxels).map(direction).collect();
    let jumps: Vec<Jump> = (0..taxels).map(|taxel| Jump::of(kept, taxel, taxels)).collect();
    let usual = median(jumps.iter().map(|jump| jump.others)).unwrap_or(f64::NAN);
    let digit = jumps.iter().map(|jump| jump.least).fold(f64::INFINITY, f64::min);
    let usual =
        usual.max(if digit.is_finite() { std::f64::consts::SQRT_2 * QUANTISATION * digit } else { 0.0 });
    let jumped = |jump: &Jump| jump.by.abs() > JUMPS * jump.others.max(usual);
    let is_with = |k: usize, other: u32| {
        let [own, other_jump] = [k, other as usize].map(|taxel| &jumps[taxel]);
        moved[other as usize] * moved[k] > 0.0
            || (own.frame == other_jump.frame
                && own.by * other_jump.by > 0.0
                && jumped(own)
                && jumped(other_jump))
    };
    (0..taxels).any(|k| neighbours[k].iter().filter(|&&other| is_with(k, other)).count() >= 2)
}

/// The largest difference of two successive readings of a taxel that has three or more.
#[derive(Debug, Clone, Copy)]
struct Jump {
    /// How many readings are before it.
    frame: usize,
    by: f64,
    /// The root mean square of the others.
    others: f64,
    /// The smallest difference other than 0; infinite without any.
    least: f64,
}

impl Jump {
    fn of(kept: &[f64], taxel: usize, taxels: usize) -> Self {
        let of_taxel = || kept.iter().skip(taxel).step_by(taxels).copied().filter(|x| x.is_finite());
        let differences = || of_taxel().zip(of_taxel().skip(1)).map(|(a, b)| b - a);
        let least = differences().map(f64::abs).filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
        let count = differences().count();
        if count < 3 {
            return Self { frame: 0, by: 0.0, others: f64::NAN, least };
        }
        let larger =
            |most: (usize, f64), next: (usize, f64)| if next.1.abs() > most.1.abs() { next } else { most };
        let (frame, by) = (1..).zip(differences()).fold((0, 0.0), larger);
        let squares: f64 = differences().map(|d| d * d).sum();
        let others = ((squares - by * by).max(0.0) / (count as f64 - 1.0)).sqrt();
        Self { frame, by, others, least }
    }
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

/// Whether most taxels read the same in all frames.
fn is_mostly_still(kept: &[f64], taxels: usize) -> bool {
    let is_still = |taxel: &usize| {
        let of_taxel = || kept.iter().skip(*taxel).step_by(taxels).filter(|x| x.is_finite());
        of_taxel().all(|x| Some(x) == of_taxel().next())
    };
    2 * (0..taxels).filter(is_still).count() > taxels
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

    /// Zeros that are the means of all frames so far hide a quarter of the noise of five frames.
    #[test]
    fn noise_is_the_same_where_zeros_are_followed() {
        let (frames, taxels) = (5, 40);
        let mut random = Random::new(8, 0);
        let raw: Vec<f64> = (0..frames * taxels)
            .map(|k| if k == 7 { f64::NAN } else { 100.0 + 2.5 * random.normal() })
            .collect();
        let of_taxel = |taxel: usize, last: usize| raw[..=last].iter().skip(taxel).step_by(taxels).copied();
        let mut followed: Vec<f64> = (0..raw.len())
            .map(|k| {
                let known = of_taxel(k % taxels, k).filter(|x| x.is_finite());
                let (sum, count) = known.fold((0.0, 0.0), |(sum, count), x| (sum + x, count + 1.0));
                raw[k] - sum / count
            })
            .collect();
        let (needed, hidden) = (noise(&raw, frames, taxels), noise(&followed, frames, taxels));
        assert!(hidden < 0.8 * needed, "{hidden} of {needed}");
        restore(&mut followed, taxels);
        let found = noise(&followed, frames, taxels);
        assert!((found / needed - 1.0).abs() < 1e-9, "{found} is not {needed}");
        let mut tared: Vec<f64> = raw.iter().map(|x| x - 100.0).collect();
        let before = tared.clone();
        restore(&mut tared, taxels);
        assert_eq!(
            before.iter().map(|x| x.to_bits()).collect::<Vec<_>>(),
            tared.iter().map(|x| x.to_bits()).collect::<Vec<_>>()
        );
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
