//! The first pass: range, noise and repetitions of each taxel's readings as they come.

use crate::numeric::{DEVIATION_OF_MEDIAN, median};
use crate::signal::noise::{QUANTISATION, QUIETER_SHARE};

/// Bins of the histogram of differences: four for each power of 2 from `2^-40` to `2^40`.
const BINS: usize = 320;
const LEAST_EXPONENT: i32 = -40;

/// The median size of the difference of two readings with normal noise, over its standard deviation.
const MEDIAN_DIFFERENCE: f64 = std::f64::consts::SQRT_2 / DEVIATION_OF_MEDIAN;

/// A taxel is stuck where it repeats a reading for this many frames, and this many times longer than most others do.
const STUCK_FRAMES: u32 = 50;
const STUCK_TIMES: u32 = 4;

/// Frames at the largest reading, and in a row, from which on a taxel is saturated; the range of its readings over its
/// noise, at least, beyond the threshold of touches.
const SATURATED_FRAMES: u32 = 5;
const SATURATED_ROW: u32 = 2;
const SATURATED_NOISE: f64 = 8.0;

/// Noise over the median noise from which on a taxel is noisy; in standard deviations of its logarithm over all taxels.
const NOISY: f64 = 3.0;
const NOISY_DEVIATIONS: f64 = 6.0;
/// Share of the taxels that repeat one reading for ever from which on that is not a fault where it is the reading that most of
/// them repeat, and the least one of this share of those that vary: readings are cut off at 0.
const MOST_CONSTANT: f64 = 0.2;
const REACH_REST: f64 = 0.05;

/// Threshold of touches over the noise of [`QUIETER_SHARE`] of the taxels.
const THRESHOLD: f64 = 4.0;

/// What one taxel read so far.
#[derive(Debug, Clone)]
pub(in crate::signal) struct Seen {
    pub(in crate::signal) frames: u32,
    pub(in crate::signal) least: f64,
    pub(in crate::signal) most: f64,
    last: f64,
    run: u32,
    pub(in crate::signal) longest_run: u32,
    pub(in crate::signal) repeated: f64,
    pub(in crate::signal) at_most: u32,
    most_row: u32,
    equal: u32,
    differences: Vec<u32>,
    quantum: f64,
}

const UNSEEN: Seen = Seen {
    frames: 0,
    least: f64::INFINITY,
    most: f64::NEG_INFINITY,
    last: f64::NAN,
    run: 0,
    longest_run: 0,
    repeated: f64::NAN,
    at_most: 0,
    most_row: 0,
    equal: 0,
    differences: Vec::new(),
    quantum: f64::INFINITY,
};

/// What the first pass says of each taxel.
#[derive(Debug, Clone)]
pub(in crate::signal) struct Survey {
    pub(in crate::signal) seen: Vec<Seen>,
    /// Standard deviation of the noise.
    pub(in crate::signal) sigma: Vec<f64>,
    pub(in crate::signal) median_sigma: f64,
    /// A reading above it is a touch.
    pub(in crate::signal) threshold: f64,
    pub(in crate::signal) is_dead: Vec<bool>,
    pub(in crate::signal) is_stuck: Vec<bool>,
    pub(in crate::signal) is_noisy: Vec<bool>,
    pub(in crate::signal) is_saturated: Vec<bool>,
    /// Neither dead nor stuck nor noisy.
    pub(in crate::signal) is_ok: Vec<bool>,
}

impl Survey {
    pub(in crate::signal) fn new(taxels: usize) -> Self {
        let no = vec![false; taxels];
        Self {
            seen: vec![UNSEEN; taxels],
            sigma: vec![0.0; taxels],
            median_sigma: 0.0,
            threshold: 0.0,
            is_dead: no.clone(),
            is_stuck: no.clone(),
            is_noisy: no.clone(),
            is_saturated: no.clone(),
            is_ok: no,
        }
    }

    pub(in crate::signal) fn see(&mut self, readings: impl Iterator<Item = f64>) {
        self.seen.iter_mut().zip(readings).filter(|(_, c)| c.is_finite()).for_each(|(seen, c)| seen.see(c));
    }

    pub(in crate::signal) fn end_recording(&mut self) {
        self.seen.iter_mut().for_each(|seen| (seen.last, seen.run) = (f64::NAN, 0));
    }

    /// Judges the taxels that are read; a threshold that is not given follows from the noise.
    pub(in crate::signal) fn settle(&mut self, is_read: &[bool], threshold: Option<f64>) {
        let read = || self.seen.iter().zip(is_read).filter(|(_, is_read)| **is_read).map(|(seen, _)| seen);
        let quantum = read().map(|seen| seen.quantum).fold(f64::INFINITY, f64::min);
        let step = if quantum.is_finite() { QUANTISATION * quantum } else { 0.0 };
        for (sigma, seen) in self.sigma.iter_mut().zip(&self.seen) {
            *sigma = seen.noise().max(step);
        }
        let varying = || read().filter(|seen| seen.least < seen.most);
        let (varies, all) = (varying().count(), read().count());
        let is_often_constant = ((all - varies) as f64) > MOST_CONSTANT * all as f64;
        let mut constants: Vec<f64> =
            read().filter(|seen| seen.least == seen.most).map(|seen| seen.least).collect();
        constants.sort_unstable_by(f64::total_cmp);
        let usual_constant =
            constants.chunk_by(|a, b| a == b).max_by_key(|same| same.len()).map(|same| same[0]);
        let reach_it = varying().filter(|seen| Some(seen.least) == usual_constant).count();
        let is_rest = reach_it as f64 >= REACH_REST * varies as f64;
        let mut runs: Vec<u32> = varying().map(|seen| seen.longest_run).collect();
        runs.sort_unstable();
        let usual_run = runs.get(runs.len() * 9 / 10).copied().unwrap_or(0);
        let longest = STUCK_FRAMES.max(STUCK_TIMES.saturating_mul(usual_run));
        let live = || {
            let of_taxels = self.sigma.iter().zip(&self.seen).zip(is_read);
            of_taxels.filter(|((_, seen), is_read)| **is_read && seen.least < seen.most).map(|((s, _), _)| *s)
        };
        self.median_sigma = median(live()).unwrap_or(0.0);
        let logarithm = |sigma: f64| (sigma / self.median_sigma).ln();
        let is_known = self.median_sigma > 0.0;
        let spread = median(live().filter(|_| is_known).map(|sigma| logarithm(sigma).abs())).unwrap_or(0.0);
        let mut sigmas: Vec<f64> = live().collect();
        sigmas.sort_unstable_by(f64::total_cmp);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a length")]
        let upper = sigmas.get((QUIETER_SHARE * sigmas.len() as f64) as usize).copied().unwrap_or(0.0);
        self.threshold = threshold.unwrap_or(THRESHOLD * upper);
        // Where none varies nothing says what a reading at rest is.
        let is_cut_off = |x: f64| is_often_constant && is_rest && (usual_constant == Some(x) || varies == 0);
        for (k, _) in is_read.iter().enumerate().filter(|(_, is_read)| **is_read) {
            let (seen, sigma) = (&self.seen[k], self.sigma[k]);
            self.is_dead[k] = seen.frames == 0 || (seen.least == seen.most && !is_cut_off(seen.least));
            self.is_stuck[k] = !self.is_dead[k] && seen.least < seen.most && seen.longest_run >= longest;
            self.is_noisy[k] = is_known
                && sigma > NOISY * self.median_sigma
                && logarithm(sigma) > NOISY_DEVIATIONS * DEVIATION_OF_MEDIAN * spread;
            self.is_saturated[k] = !self.is_stuck[k]
                && seen.at_most >= SATURATED_FRAMES
                && seen.most_row >= SATURATED_ROW
                && seen.most - seen.least > self.threshold + SATURATED_NOISE * sigma;
            self.is_ok[k] = !self.is_dead[k] && !self.is_stuck[k] && !self.is_noisy[k];
        }
    }

    /// The excess from which on a taxel is touched.
    pub(in crate::signal) fn hot(&self, taxel: usize) -> f64 {
        /// In standard deviations: of normal noise one reading in 3.5 million is beyond it, with half of it one in 160.
        const NOISE: f64 = 5.0;
        self.threshold.max(NOISE * self.sigma[taxel])
    }
}

impl Seen {
    fn see(&mut self, c: f64) {
        self.frames += 1;
        self.least = self.least.min(c);
        if c > self.most {
            (self.most, self.at_most, self.most_row) = (c, 0, 0);
        }
        let d = (c - self.last).abs();
        self.run = if d == 0.0 { self.run + 1 } else { 1 };
        if self.run > self.longest_run {
            (self.longest_run, self.repeated) = (self.run, c);
        }
        if c == self.most {
            self.at_most += 1;
            self.most_row = self.most_row.max(self.run);
        }
        self.last = c;
        if d == 0.0 {
            self.equal += 1;
        } else if d.is_finite() {
            self.quantum = self.quantum.min(d);
            self.differences.resize(BINS, 0);
            self.differences[bin(d)] += 1;
        }
    }

    /// Standard deviation of the noise, from the median size of the differences of successive readings.
    fn noise(&self) -> f64 {
        let all = f64::from(self.equal) + self.differences.iter().map(|n| f64::from(*n)).sum::<f64>();
        let mut left = 0.5 * all - f64::from(self.equal);
        if left <= 0.0 {
            return 0.0;
        }
        for (k, &count) in self.differences.iter().enumerate() {
            let count = f64::from(count);
            if left <= count {
                let [low, high] = [k, k + 1].map(edge);
                return (low + (high - low) * left / count) / MEDIAN_DIFFERENCE;
            }
            left -= count;
        }
        0.0
    }
}

/// The bin of a positive number.
fn bin(x: f64) -> usize {
    let quarters = 4.0 * (x.log2() - f64::from(LEAST_EXPONENT));
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "limited to the bins")]
    let bin = quarters.clamp(0.0, (BINS - 1) as f64) as usize;
    bin
}

/// The lower end of a bin.
fn edge(bin: usize) -> f64 {
    (f64::from(LEAST_EXPONENT) + 0.25 * bin as f64).exp2()
}
