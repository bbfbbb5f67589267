//! The scale of relative pressures, and the exponent that all taxels share, from touches of known force.
//!
//! The force of a touch is the sum of pressure times area over the taxels that it touches and those next to them; a taxel
//! that is not known has the mean pressure of its neighbours. Of each touch the median over its frames counts, and the
//! scale is the median over touches. The exponent is the one for which the forces of touches agree best; light and
//! strong touches are needed for it.

use crate::mesh::neighbours;
use crate::numeric::{Csr, DEVIATION_OF_MEDIAN, median_of};
use crate::response::ResponseError;
use crate::response::press::{HOT, confirmed, least_noise, median_noise};
use crate::signal::{Frame, RunningNoise, SignalError};
use crate::skin::Skin;

/// Touches that a scale needs at least, and an exponent.
pub const SCALE_TOUCHES: usize = 3;
/// See [`SCALE_TOUCHES`].
pub const EXPONENT_TOUCHES: usize = 100;

/// Largest forces of touches, in N: others are in another unit.
const FORCES: [f64; 2] = [0.05, 1000.0];

/// A frame counts above this share of the largest force of its touch.
const SHARE: f64 = 0.2;

/// A touch ends after this time without a force, in s.
const PAUSE_S: f64 = 0.1;

/// How far the forces of single touches may be from the scale (the median of the logarithm's distance).
const MOST_DISAGREEMENT: f64 = 0.5;

/// Exponents that are tried.
const EXPONENTS: [f64; 2] = [0.4, 2.5];

/// What is known of the scale from touches of known force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScaleReport {
    /// Pressure in Pa over relative pressure.
    pub scale: f64,
    /// The standard deviation of its logarithm.
    pub sigma: f64,
    /// The exponent that all taxels share; NaN if it is not found.
    pub exponent: f64,
    /// The touches that were used.
    pub touches: usize,
}

/// Finds the scale of relative pressures from a recording of touches of known force.
pub struct ScaleEstimator {
    finds_exponent: bool,
    neighbours: Csr<u32>,
    areas: Vec<f64>,
    /// Times in s, and forces in N.
    forces: Vec<[f64; 2]>,
    noise: Vec<RunningNoise>,
    largest: f64,
    touches: Vec<Touch>,
    times: [f64; 2],
    /// Whether times went back, so that forces are of several frames.
    goes_back: bool,
}

/// The frames of one touch: the force, and area and linear relative pressure of each taxel.
struct Touch {
    end: f64,
    frames: Vec<(f64, Vec<[f64; 2]>)>,
}

impl ScaleEstimator {
    /// An estimator for forces: rows of a time in s and the force on the whole skin in N, interpolated between
    /// them. It finds the exponent of pressures too if these are proportional to readings, and there are
    /// [`EXPONENT_TOUCHES`].
    ///
    /// # Errors
    /// If times do not grow, a force is not a number or negative, or the largest is too small or too large for one in N.
    pub fn new(skin: &Skin, finds_exponent: bool, forces: Vec<[f64; 2]>) -> Result<Self, ResponseError> {
        skin.validate()?;
        let late = |k: &usize| !forces[*k][0].is_finite() || (*k > 0 && forces[*k][0] < forces[*k - 1][0]);
        if let Some(row) = (0..forces.len()).find(late) {
            return Err(ResponseError::ForceTime { row: row + 1, found: forces[row][0] });
        }
        if let Some(row) = forces.iter().position(|[_, force]| !(force.is_finite() && *force >= 0.0)) {
            return Err(ResponseError::Force { row: row + 1, found: forces[row][1] });
        }
        let most = forces.iter().map(|[_, force]| *force).fold(0.0, f64::max);
        if !(FORCES[0]..=FORCES[1]).contains(&most) {
            return Err(ResponseError::ForceUnit { most });
        }
        let areas: Vec<f64> =
            skin.patches.iter().flat_map(|patch| patch.taxels.areas.iter().copied()).collect();
        let taxels = areas.len();
        Ok(Self {
            finds_exponent,
            neighbours: neighbours(skin.patches.iter().map(|patch| &patch.mesh)),
            areas,
            forces,
            noise: vec![RunningNoise::UNKNOWN; taxels],
            largest: 0.0,
            touches: Vec::new(),
            times: [f64::INFINITY, f64::NEG_INFINITY],
            goes_back: false,
        })
    }

    /// Takes the next frame: the first channel, relative pressures by a response; NaN where that is not known.
    ///
    /// # Panics
    /// If it does not have the patches and taxels of the skin.
    pub fn see(&mut self, frame: &Frame) {
        let time = frame.time;
        self.goes_back |= time < self.times[1];
        self.times = [self.times[0].min(time), self.times[1].max(time)];
        let read: Vec<f64> = frame.values.iter().flat_map(|channels| channels[0].iter().copied()).collect();
        let force = self.force_at(time);
        if force <= 0.0 {
            // Noise is that of untouched frames.
            for (noise, &x) in self.noise.iter_mut().zip(&read) {
                if x.is_finite() {
                    noise.see(x, f64::NAN);
                } else {
                    noise.interrupt();
                }
            }
            return;
        }
        self.noise.iter_mut().for_each(RunningNoise::interrupt);
        let around = |k: usize| self.neighbours[k].iter().map(|&w| read[w as usize]).fold(0.0, f64::max);
        self.largest = self.largest.max(confirmed(&read, around));
        let median = median_noise(self.noise.iter());
        let is_hot = |(x, noise): (&f64, &RunningNoise)| *x > HOT * least_noise(noise, median, self.largest);
        let is_hot: Vec<bool> = read.iter().zip(&self.noise).map(is_hot).collect();
        let mut is_in = is_hot.clone();
        for k in (0..is_hot.len()).filter(|&k| is_hot[k]) {
            self.neighbours[k].iter().for_each(|&w| is_in[w as usize] = true);
        }
        // Noise below zero belongs to the sum, or noise would add to every force.
        let relative = |k: usize| Some(read[k]).filter(|x| x.is_finite());
        let felt = (0..read.len()).filter(|&k| is_in[k]).filter_map(|k| {
            let around = || self.neighbours[k].iter().filter_map(|&w| relative(w as usize));
            let mean = || around().sum::<f64>() / around().count() as f64;
            let pressure = relative(k).unwrap_or_else(mean);
            pressure.is_finite().then_some([self.areas[k], pressure])
        });
        let felt: Vec<[f64; 2]> = felt.collect();
        match self.touches.last_mut() {
            Some(touch) if time - touch.end <= PAUSE_S => {
                touch.end = time;
                touch.frames.push((force, felt));
            }
            _ => self.touches.push(Touch { end: time, frames: vec![(force, felt)] }),
        }
    }

    /// The scale.
    ///
    /// # Errors
    /// If there are too few touches, or forces and readings do not fit.
    pub fn solve(self) -> Result<ScaleReport, ResponseError> {
        let at = |exponent: f64| -> Vec<f64> {
            self.touches.iter().filter_map(|touch| touch.log_ratio(exponent)).collect()
        };
        let [from, to] = self.times;
        if from > to {
            return Err(SignalError::NoTimes.into());
        }
        if self.goes_back {
            return Err(ResponseError::ForceClocks);
        }
        let touches = at(1.0).len();
        if touches < SCALE_TOUCHES {
            return Err(ResponseError::TooFewForces { found: touches, needed: SCALE_TOUCHES, from, to });
        }
        let spread = |exponent: f64| {
            let mut logs = at(exponent);
            let middle = median_of(&mut logs).unwrap_or(f64::NAN);
            let mut sizes: Vec<f64> = logs.iter().map(|log| (log - middle).abs()).collect();
            [middle, median_of(&mut sizes).unwrap_or(f64::NAN)]
        };
        let exponent = if touches >= EXPONENT_TOUCHES && self.finds_exponent {
            least(|exponent| spread(exponent)[1])
        } else {
            f64::NAN
        };
        let [log, disagreement] = spread(if exponent.is_nan() { 1.0 } else { exponent });
        if disagreement.is_nan() || disagreement >= MOST_DISAGREEMENT {
            return Err(ResponseError::ForcesDoNotFit { touches, disagreement });
        }
        // The median of n numbers is known to 1.25 times their standard deviation over the root of n.
        let sigma = 1.2533 * DEVIATION_OF_MEDIAN * disagreement / (touches as f64).sqrt();
        Ok(ScaleReport { scale: log.exp(), sigma, exponent, touches })
    }

    /// The force at a time, linear between rows; 0 before the first and after the last.
    fn force_at(&self, time: f64) -> f64 {
        let next = self.forces.partition_point(|[at, _]| *at < time);
        match (next.checked_sub(1).and_then(|k| self.forces.get(k)), self.forces.get(next)) {
            (_, Some([at, force])) if *at == time => *force,
            (Some([a, f]), Some([b, g])) if b - a <= PAUSE_S => f + (g - f) * (time - a) / (b - a),
            _ => 0.0,
        }
    }
}

impl Touch {
    /// The logarithm of force over relative force, at an exponent.
    fn log_ratio(&self, exponent: f64) -> Option<f64> {
        let most = self.frames.iter().map(|(force, _)| *force).fold(0.0, f64::max);
        let ratio = |(force, felt): &(f64, Vec<[f64; 2]>)| {
            let sum: f64 = felt.iter().map(|[area, p]| area * p.signum() * p.abs().powf(exponent)).sum();
            (*force > SHARE * most && sum > 0.0).then(|| (force / sum).ln())
        };
        median_of(&mut self.frames.iter().filter_map(ratio).collect::<Vec<_>>())
    }
}

/// Where a function of an exponent with one minimum is least: a grid, and then a golden section.
fn least(of: impl Fn(f64) -> f64) -> f64 {
    /// Steps of the grid; the golden section finds the minimum between two of them.
    const STEPS: u32 = 42;
    const GOLDEN: f64 = 0.618_033_988_749_895;
    let step = (EXPONENTS[1] - EXPONENTS[0]) / f64::from(STEPS);
    let grid = (0..=STEPS).map(|k| EXPONENTS[0] + step * f64::from(k));
    let best = grid.min_by(|a, b| of(*a).total_cmp(&of(*b))).unwrap_or(1.0);
    let (mut low, mut high) = (best - step, best + step);
    while high - low > 1e-4 {
        let width = GOLDEN * (high - low);
        if of(high - width) < of(low + width) { high = low + width } else { low = high - width }
    }
    0.5 * (low + high)
}
