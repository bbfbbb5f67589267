//! The threshold of contacts: given, or estimated from the readings of the first frames.
//!
//! The deviation of each reading from the mean of its taxel over `K` frames is scaled by
//! `sqrt(K / (K - 1))`, so that Gaussian noise of standard deviation `s` gives Gaussian deviations of
//! the same `s`; 1.4826 times the median of their sizes, the median absolute deviation
//! (rousseeuw1987), then is `s`, whatever a few taxels do that are touched or broken. Taxels that
//! never change say nothing of the noise and are left out: many sensors clip their readings at zero.

use crate::{
    numeric::quantile,
    signal::{Frame, TrackerOptions},
};

/// What makes the median absolute deviation of Gaussian numbers their standard deviation.
const GAUSSIAN: f64 = 1.4826;

/// Frames in which noise lifts one taxel of the skin above the threshold once: more than an hour at
/// 250 Hz. It takes two taxels to make a region.
const FRAMES_PER_FALSE_ALARM: f64 = 1e6;

/// Threshold over the largest reading so far, for readings without noise. *Heuristic*: what is a
/// hundredth of a full press is no longer felt as touch by sensors of eight bits.
const SHARE_OF_LARGEST: f64 = 0.01;

/// The threshold of contacts, as it is known by now.
#[derive(Debug, Clone)]
pub(super) enum Threshold {
    Known(f64),
    /// The readings of the first frames, one frame after the other.
    Learning {
        frames: usize,
        kept: Vec<f64>,
    },
    /// There is no noise: the largest reading so far.
    Noiseless {
        largest: f64,
    },
}

impl Threshold {
    pub(super) fn new(options: &TrackerOptions) -> Self {
        let learning = Self::Learning { frames: options.noise_frames, kept: Vec::new() };
        options.threshold.map_or(learning, Self::Known)
    }

    /// The threshold, in the unit of the channel, if it is known by now.
    pub(super) fn known(&self) -> Option<f64> {
        match self {
            Self::Known(threshold) => Some(*threshold),
            Self::Learning { .. } => None,
            Self::Noiseless { largest } => (*largest > 0.0).then(|| SHARE_OF_LARGEST * largest),
        }
    }

    /// The threshold for this frame; `None` while it is not known.
    pub(super) fn update(&mut self, frame: &Frame, channel: usize) -> Option<f64> {
        let readings = || frame.values.iter().flat_map(|patch| &patch[channel]).copied();
        match self {
            Self::Known(_) => {}
            Self::Noiseless { largest } => *largest = self::largest(*largest, readings()),
            Self::Learning { frames, kept } => {
                kept.extend(readings());
                let taxels = readings().count();
                if kept.len() >= *frames * taxels {
                    let noise = noise(kept, *frames, taxels);
                    *self = if noise > 0.0 {
                        Self::Known(noise * quantiles(*frames, taxels))
                    } else {
                        Self::Noiseless { largest: self::largest(0.0, kept.iter().copied()) }
                    };
                }
                return None;
            }
        }
        self.known()
    }
}

/// The largest finite reading, at least `so_far`.
fn largest(so_far: f64, readings: impl Iterator<Item = f64>) -> f64 {
    readings.filter(|x| x.is_finite()).fold(so_far, f64::max)
}

/// Standard deviation of the readings of `taxels` taxels in `frames` frames; 0 if none varies.
fn noise(kept: &[f64], frames: usize, taxels: usize) -> f64 {
    let mut deviations = Vec::with_capacity(kept.len());
    for taxel in 0..taxels {
        let of_taxel = || kept.iter().skip(taxel).step_by(taxels).take(frames).filter(|x| x.is_finite());
        let count = of_taxel().count() as f64;
        let Some(first) = of_taxel().next() else { continue };
        if of_taxel().any(|x| x != first) {
            let mean = of_taxel().sum::<f64>() / count;
            let scale = (count / (count - 1.0)).sqrt();
            deviations.extend(of_taxel().map(|x| scale * (x - mean).abs()));
        }
    }
    let middle = deviations.len() / 2;
    if deviations.is_empty() {
        return 0.0;
    }
    GAUSSIAN * *deviations.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Threshold over noise. A baseline that is the mean of `frames` frames has a share of the noise
/// itself.
fn quantiles(frames: usize, taxels: usize) -> f64 {
    let chance = (taxels as f64 * FRAMES_PER_FALSE_ALARM).recip();
    // The square of a Gaussian number: it is above this with twice the chance, on either side.
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
    fn the_noise_is_found_beside_spikes_and_clipped_taxels() {
        let (frames, taxels) = (5, 600);
        let mut random = Random::new(3, 0);
        let mut readings: Vec<f64> = (0..frames * taxels).map(|_| 100.0 + 2.5 * random.normal()).collect();
        for (k, x) in readings.iter_mut().enumerate() {
            match k % taxels {
                0..60 => *x *= 1.0 + (k / taxels) as f64,
                60..300 => *x = 0.0,
                300..320 => *x = f64::NAN,
                _ => {}
            }
        }
        let found = noise(&readings, frames, taxels);
        assert!((found / 2.5 - 1.0).abs() < 0.3, "{found} is not 2.5");
        readings.iter_mut().for_each(|x| *x = x.round().clamp(100.0, 100.0));
        assert_eq!(noise(&readings, frames, taxels), 0.0, "nothing varies");
    }
}
