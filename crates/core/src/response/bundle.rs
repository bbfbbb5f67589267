//! The bundle adjustment: all presses and all taxels at once, by Gauss-Newton with bounded steps.
//!
//! Unknown are, for each taxel, the logarithm of its reading over the depth; for each press a shape; for each of its
//! frames a place and a depth; and for all the blur of the cover and the power with which readings grow with depth. The
//! unknowns of a press are eliminated (`elimination`), which leaves a sparse system of the taxels.
//!
//! A press is of one patch. So presses say nothing of how the gains of two patches compare but by how deep they seem: bodies
//! press all patches alike, on average. The gains of a patch are therefore pulled towards their own mean, and their sigma
//! has a part for that of their patch: how much depths vary, over the root of the number of presses.
//!
//! It ends when the steps of the taxels are small against what is known of them, never after a number of steps: long
//! waves over the skin come last.

use crate::parallel::par_map;
use crate::response::ResponseError;
use crate::response::collect::Spike;
use crate::response::contact::{Pose, Shape};
use crate::response::elimination::{Common, Reduced, SHARED, State, USUAL_RADIUS, reduce};
use crate::response::press::Press;
use crate::run::Run;
use crate::sparse::{BlockFactor, BlockSlot, BlockSystem, Pattern};

/// Standard deviation of the logarithm of gains before anything is known.
const GAIN: f64 = 0.4;

/// The blur of a cover: its usual value in m, the standard deviation of its logarithm, and its bounds.
const USUAL_BLUR: f64 = 1.3e-3;
const LOG_BLUR: f64 = 0.4;
const BLURS: [f64; 2] = [4e-4, 5e-3];

/// The power of the depth: the standard deviation from 1, and its bounds.
const POWER: f64 = 0.3;
const POWERS: [f64; 2] = [0.35, 2.0];

/// Most and least steps, and the rms step of taxels over their sigma at which it ends.
const MOST_STEPS: usize = 40;
const LEAST_STEPS: usize = 6;
const SMALL_STEP: f64 = 0.05;

/// Steps after which the depths of presses say what is usual, and the bounds of the standard deviation of their logarithms.
/// Where readings say little of depths, the estimated ones are closer to each other than the true ones: learned from
/// them without a lower bound, the deviation would become smaller with each step, and the power would take the place of depths.
const STEPS_TO_LEARN: usize = 4;
const DEPTH_DEVIATIONS: [f64; 2] = [0.2, 1.0];

/// The largest steps: of a logarithm of a gain, of shared numbers, of a place in m, of logarithms of a depth and of a
/// radius, and of a shape.
const GAIN_STEP: f64 = 0.4;
const SHARED_STEP: f64 = 0.15;
const PLACE_STEP: f64 = 2e-3;
const DEPTH_STEP: f64 = 0.4;
const RADIUS_STEP: f64 = 0.3;
const OVAL_STEP: f64 = 0.2;

/// Bounds: of a place in m, of depths and radii in m, of the shape.
const FARTHEST: f64 = 0.015;
const DEPTHS: [f64; 2] = [5e-5, 0.02];
const RADII: [f64; 2] = [0.003, 0.3];
const MOST_OVAL: f64 = 0.85;

/// Depths at which presses may start, in m, and over the largest reading of a frame.
const START_DEPTHS: [f64; 2] = [2e-4, 0.012];
const START_FACTOR: f64 = 1.15;

/// Taxels known better than this count for the end and are usable.
pub(super) const USABLE: f64 = 0.2;

/// Sigma is this factor times that of the equations, joined with what the model of contacts leaves.
const SIGMA_FACTOR: f64 = 1.1;
const SIGMA_FLOOR: f64 = 0.02;

/// Few presses agree by chance: their disagreement counts `n / (n - 1.5)` times, at most this.
const MOST_FEW: f64 = 4.0;

/// How gains were found.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GainReport {
    /// Presses that were used; those left out since several bodies touched at once; and since they touched less than
    /// three taxels.
    pub presses: usize,
    /// See [`Self::presses`].
    pub several: usize,
    /// See [`Self::presses`].
    pub small: usize,
    /// Readings that were left out, each far larger than those around it and before and after it; and the first.
    pub spikes: usize,
    /// See [`Self::spikes`].
    pub first_spike: Option<Spike>,
    /// Patches with presses. How the gains of several compare is known only as far as bodies press all of them alike.
    pub patches: usize,
    /// Steps of the adjustment.
    pub steps: usize,
    /// Whether steps became small.
    pub has_converged: bool,
    /// The blur of the cover, in m.
    pub blur: f64,
    /// Readings grow with this power of the depth of a touch.
    pub power: f64,
    /// Mean squared residual over its variance, of which each counts up to 6.25.
    pub misfit: f64,
}

/// Where all presses and taxels are, and how they are linked.
struct Bundle<'p> {
    presses: &'p [Press],
    noise: &'p [f64],
    /// The patch of each taxel.
    patches: &'p [usize],
    states: Vec<State>,
    logs: Vec<f64>,
    /// The mean of the logarithms at the start, which the prior of gains keeps.
    centre: f64,
    common: Common,
    is_pressed: Vec<bool>,
}

/// Solves for the taxels: the logarithms of reading over depth, relative to their mean, and their sigma.
///
/// `start` are first guesses of the logarithms, `noise` the standard deviations of readings, `patches` the patch of each
/// taxel, counted from 0.
pub(super) fn adjust(
    presses: &[Press],
    start: Vec<f64>,
    noise: &[f64],
    patches: &[usize],
    run: Run<'_>,
) -> Result<(Vec<f64>, Vec<f64>, GainReport), ResponseError> {
    let taxels = start.len();
    let mut bundle = Bundle::new(presses, start, noise, patches);
    let system = BlockSystem::new(pattern(presses, taxels), 1)?;
    let mut report = GainReport { presses: presses.len(), ..GainReport::default() };
    loop {
        run.step().map_err(|_| ResponseError::Cancelled)?;
        let reduced = bundle.reduced()?;
        let (factor, gradient) = bundle.assemble(&system, &reduced)?;
        let variances = factor.selected_inverse();
        let variance = |row: usize| variances.diagonal::<1>(row)[0][0];
        let small = bundle.step(&factor, gradient, &reduced, variance)?;
        report.steps += 1;
        let has_ended = small < SMALL_STEP && report.steps >= LEAST_STEPS;
        if !has_ended && report.steps < MOST_STEPS {
            bundle.learn(report.steps);
            continue;
        }
        report.has_converged = has_ended;
        let sum = |k: usize| reduced.iter().map(|one| one.misfit[k]).sum::<f64>();
        report.misfit = sum(0) / sum(1).max(1.0);
        report.blur = bundle.common.log_blur.exp();
        report.power = bundle.common.power;
        report.patches = bundle.presses_of_patches().iter().filter(|count| **count > 0).count();
        let sigma = bundle.sigma(&factor, &reduced, variance)?;
        let mean = bundle.mean(&bundle.logs);
        return Ok((bundle.logs.iter().map(|log| log - mean).collect(), sigma, report));
    }
}

/// Refuses a solution whose blur or power is at a bound: these contacts are not those of the model.
pub(super) fn check_bounds(report: &GainReport) -> Result<(), ResponseError> {
    let GainReport { blur, power, .. } = *report;
    if blur < 1.1 * BLURS[0] {
        return Err(ResponseError::ForeignContacts { blur });
    }
    if power <= POWERS[0] || power >= POWERS[1] {
        return Err(ResponseError::ForeignPower { power });
    }
    Ok(())
}

/// The taxels of a press are joined with each other, and all with what is shared.
fn pattern(presses: &[Press], taxels: usize) -> Pattern {
    let pairs = presses.iter().flat_map(|press| {
        let of = move |k: usize| press.taxels[k] as usize;
        (0..press.taxels.len()).flat_map(move |a| (0..a).map(move |b| (of(a), of(b))))
    });
    let shared = (0..taxels + SHARED).flat_map(|row| (0..SHARED).map(move |k| (row, taxels + k)));
    let mut pairs: Vec<(usize, usize)> = pairs.map(|(a, b)| (a.max(b), a.min(b))).collect();
    pairs.sort_unstable();
    pairs.dedup();
    Pattern::new(taxels + SHARED, pairs.into_iter().chain(shared))
}

impl<'p> Bundle<'p> {
    fn new(presses: &'p [Press], logs: Vec<f64>, noise: &'p [f64], patches: &'p [usize]) -> Self {
        let start = |press: &Press| {
            let largest = |readings: &[f64]| {
                let depths = readings.iter().zip(&press.taxels).map(|(c, &v)| c * (-logs[v as usize]).exp());
                let depth = START_FACTOR * depths.fold(0.0, f64::max);
                depth.clamp(START_DEPTHS[0], START_DEPTHS[1]).ln()
            };
            let pose = |readings| Pose { at: [0.0; 2], log_depth: largest(readings) };
            State {
                poses: press.frames.iter().map(|frame| pose(&*frame.readings)).collect(),
                shape: Shape { log_radius: USUAL_RADIUS.ln(), oval: [0.0; 2] },
            }
        };
        let states = presses.iter().map(start).collect();
        let mut is_pressed = vec![false; logs.len()];
        for press in presses {
            for (k, &taxel) in press.taxels.iter().enumerate() {
                is_pressed[taxel as usize] |= press.frames.iter().any(|frame| !frame.readings[k].is_nan());
            }
        }
        let common = Common { log_blur: USUAL_BLUR.ln(), power: 1.0, depth: [0.0, 0.5] };
        let mut bundle = Self { presses, noise, patches, states, logs, centre: 0.0, common, is_pressed };
        bundle.centre = bundle.mean(&bundle.logs);
        bundle.common.depth[0] = bundle.depths()[0];
        bundle
    }

    /// The mean over the taxels that were pressed.
    fn mean(&self, of: &[f64]) -> f64 {
        let pressed = || of.iter().zip(&self.is_pressed).filter(|(_, is)| **is).map(|(x, _)| x);
        pressed().sum::<f64>() / (pressed().count() as f64).max(1.0)
    }

    /// The mean over the taxels of each patch that were pressed; that of all for a patch without any.
    fn means(&self, of: &[f64]) -> Vec<f64> {
        let mut sums = vec![[0.0; 2]; self.patch_count()];
        for ((x, &patch), _) in of.iter().zip(self.patches).zip(&self.is_pressed).filter(|(_, is)| **is) {
            sums[patch] = [sums[patch][0] + x, sums[patch][1] + 1.0];
        }
        let all = self.mean(of);
        sums.into_iter().map(|[sum, count]| if count > 0.0 { sum / count } else { all }).collect()
    }

    fn patch_count(&self) -> usize {
        self.patches.iter().max().map_or(0, |last| last + 1)
    }

    fn presses_of_patches(&self) -> Vec<usize> {
        let mut counts = vec![0; self.patch_count()];
        let of = self.presses.iter().filter_map(|press| press.taxels.first());
        of.for_each(|&taxel| counts[self.patches[taxel as usize]] += 1);
        counts
    }

    /// The variance of the mean logarithm of each patch relative to that of all.
    fn variances_of_patches(&self) -> Vec<f64> {
        let mut shares = vec![0.0; self.patch_count()];
        let pressed = self.is_pressed.iter().filter(|is| **is).count().max(1) as f64;
        for (&patch, _) in self.patches.iter().zip(&self.is_pressed).filter(|(_, is)| **is) {
            shares[patch] += pressed.recip();
        }
        let of_press = (self.common.power * self.common.depth[1]).powi(2);
        let own: Vec<f64> = (self.presses_of_patches().iter())
            .map(|&count| if count > 0 { of_press / count as f64 } else { GAIN * GAIN })
            .collect();
        let all: f64 = own.iter().zip(&shares).map(|(own, share)| share * share * own).sum();
        own.iter().zip(&shares).map(|(own, share)| all + (1.0 - 2.0 * share) * own).collect()
    }

    /// Mean and standard deviation of the mean logarithms of the depths of presses.
    fn depths(&self) -> [f64; 2] {
        let of = |state: &State| {
            state.poses.iter().map(|pose| pose.log_depth).sum::<f64>() / state.poses.len() as f64
        };
        let count = (self.states.len() as f64).max(1.0);
        let mean = self.states.iter().map(of).sum::<f64>() / count;
        let variance = self.states.iter().map(|state| (of(state) - mean).powi(2)).sum::<f64>() / count;
        [mean, variance.sqrt()]
    }

    /// Learns how deep presses are.
    fn learn(&mut self, steps: usize) {
        if steps >= STEPS_TO_LEARN {
            let [mean, deviation] = self.depths();
            self.common.depth = [mean, deviation.clamp(DEPTH_DEVIATIONS[0], DEPTH_DEVIATIONS[1])];
        }
    }

    fn reduced(&self) -> Result<Vec<Reduced>, ResponseError> {
        let all: Vec<usize> = (0..self.presses.len()).collect();
        let of = |&k: &usize| {
            let press = &self.presses[k];
            let pick = |of: &[f64]| -> Vec<f64> { press.taxels.iter().map(|&v| of[v as usize]).collect() };
            reduce(press, &self.states[k], &self.common, &pick(&self.logs), &pick(self.noise))
        };
        par_map(&all, of).into_iter().collect::<Option<_>>().ok_or(ResponseError::Singular)
    }

    /// The rows of the whole system that those of a press are.
    fn rows(&self, press: &Press) -> Vec<usize> {
        let shared = (0..SHARED).map(|k| self.logs.len() + k);
        press.taxels.iter().map(|&v| v as usize).chain(shared).collect()
    }

    /// The factored system of taxels and shared numbers, and its gradient.
    fn assemble<'s>(
        &self,
        system: &'s BlockSystem,
        reduced: &[Reduced],
    ) -> Result<(BlockFactor<'s>, Vec<f64>), ResponseError> {
        let taxels = self.logs.len();
        let mut matrix = system.zero();
        let mut gradient = vec![0.0; taxels + SHARED];
        for (press, one) in self.presses.iter().zip(reduced) {
            let rows = self.rows(press);
            for (a, &row) in rows.iter().enumerate() {
                gradient[row] += one.gradient[a];
                for (b, &column) in rows[..=a].iter().enumerate() {
                    let entry = one.matrix[a * rows.len() + b];
                    let slot = if row == column {
                        Some(BlockSlot::diagonal(narrow(row)))
                    } else {
                        system.slot(row.max(column), row.min(column))
                    };
                    matrix.add(slot.ok_or(ResponseError::Singular)?, |_, _| entry);
                }
            }
        }
        let mut prior = vec![GAIN.powi(-2); taxels];
        prior.extend([LOG_BLUR.powi(-2), POWER.powi(-2)]);
        matrix.add_diagonal(&prior);
        // The means of patches differ, and that of all stays.
        let (means, mean) = (self.means(&self.logs), self.mean(&self.logs));
        for (row, log) in self.logs.iter().enumerate() {
            let centre = self.centre + (means[self.patches[row]] - mean);
            gradient[row] -= prior[row] * (log - centre);
        }
        gradient[taxels] -= prior[taxels] * (self.common.log_blur - USUAL_BLUR.ln());
        gradient[taxels + 1] -= prior[taxels + 1] * (self.common.power - 1.0);
        Ok((matrix.factor()?, gradient))
    }

    /// Takes one step; returns its rms over usable taxels, over their sigma.
    fn step(
        &mut self,
        factor: &BlockFactor<'_>,
        mut step: Vec<f64>,
        reduced: &[Reduced],
        variance: impl Fn(usize) -> f64,
    ) -> Result<f64, ResponseError> {
        let taxels = self.logs.len();
        factor.solve(&mut step, 1)?;
        for (row, x) in step.iter_mut().enumerate() {
            let most = if row < taxels { GAIN_STEP } else { SHARED_STEP };
            *x = x.clamp(-most, most);
        }
        let mean = self.mean(&step[..taxels]);
        let (mut sum, mut count) = (0.0, 0.0);
        for row in (0..taxels).filter(|&row| self.is_pressed[row]) {
            let variance = variance(row);
            if variance < USABLE * USABLE {
                sum += (step[row] - mean).powi(2) / variance;
                count += 1.0;
            }
        }
        for (k, press) in self.presses.iter().enumerate() {
            let others: Vec<f64> = self.rows(press).into_iter().map(|row| step[row]).collect();
            self.states[k].move_by(&reduced[k].step(&others));
        }
        self.logs.iter_mut().zip(&step).for_each(|(log, x)| *log += x);
        let common = &mut self.common;
        common.log_blur = (common.log_blur + step[taxels]).clamp(BLURS[0].ln(), BLURS[1].ln());
        common.power = (common.power + step[taxels + 1]).clamp(POWERS[0], POWERS[1]);
        // Without a usable taxel there is nothing to wait for.
        Ok(if count > 0.0 { f64::sqrt(sum / count) } else { 0.0 })
    }

    /// The sigma of the logarithms relative to the mean of their patch, of the equations, or of how much presses disagree with
    /// each other (the sandwich estimate of White 1982), whichever is larger; joined with that of the mean of the patch.
    fn sigma(
        &self,
        factor: &BlockFactor<'_>,
        reduced: &[Reduced],
        variance: impl Fn(usize) -> f64,
    ) -> Result<Vec<f64>, ResponseError> {
        /// Columns of the inverse that are solved at once: they bound memory, and change no result.
        const COLUMNS: usize = 64;
        let (taxels, rows) = (self.logs.len(), self.logs.len() + SHARED);
        let mut model = vec![0.0; taxels];
        for patch in 0..self.patch_count() {
            let is_in = |row: usize| self.is_pressed[row] && self.patches[row] == patch;
            let pressed = (0..taxels).filter(|&row| is_in(row)).count();
            if pressed == 0 {
                continue;
            }
            // Covariances with the mean.
            let mut with_mean = vec![0.0; rows];
            (0..taxels).filter(|&row| is_in(row)).for_each(|row| with_mean[row] = (pressed as f64).recip());
            factor.solve(&mut with_mean, 1)?;
            let of_mean = self.means(&with_mean[..taxels])[patch];
            for row in (0..taxels).filter(|&row| is_in(row)) {
                model[row] = (variance(row) - 2.0 * with_mean[row] + of_mean).max(0.0);
            }
        }
        let of_patches = self.variances_of_patches();
        // The prior of gains is one more witness.
        let mut disagreement: Vec<f64> = (0..taxels).map(|row| (variance(row) / GAIN).powi(2)).collect();
        let mut seen = vec![0.0_f64; taxels];
        for first in (0..self.presses.len()).step_by(COLUMNS) {
            let block = first..self.presses.len().min(first + COLUMNS);
            let mut columns = vec![0.0; rows * block.len()];
            for (k, column) in block.clone().zip(columns.chunks_exact_mut(rows)) {
                let own = self.rows(&self.presses[k]);
                debug_assert_eq!(own.len(), reduced[k].rows());
                own.into_iter().zip(&reduced[k].gradient).for_each(|(row, x)| column[row] += x);
                self.presses[k].hot_taxels(self.noise).for_each(|taxel| seen[taxel] += 1.0);
            }
            factor.solve(&mut columns, block.len())?;
            for column in columns.chunks_exact(rows) {
                let means = self.means(&column[..taxels]);
                let all = disagreement.iter_mut().zip(column).zip(self.patches);
                all.for_each(|((sum, x), &patch)| *sum += (x - means[patch]).powi(2));
            }
        }
        let sigma = |row: usize| {
            if !self.is_pressed[row] {
                return GAIN;
            }
            let count: f64 = seen[row];
            let few = if count > 1.5 { (count / (count - 1.5)).min(MOST_FEW) } else { MOST_FEW };
            let own = SIGMA_FACTOR * model[row].max(few * disagreement[row]).sqrt();
            own.hypot(SIGMA_FLOOR).hypot(of_patches[self.patches[row]].sqrt())
        };
        Ok((0..taxels).map(sigma).collect())
    }
}

impl State {
    fn move_by(&mut self, step: &[f64]) {
        let moved =
            |x: f64, by: f64, most: f64, [low, high]: [f64; 2]| (x + by.clamp(-most, most)).clamp(low, high);
        let depths = DEPTHS.map(f64::ln);
        for (pose, step) in self.poses.iter_mut().zip(step.chunks_exact(3)) {
            for (x, by) in pose.at.iter_mut().zip(step) {
                *x = moved(*x, *by, PLACE_STEP, [-FARTHEST, FARTHEST]);
            }
            pose.log_depth = moved(pose.log_depth, step[2], DEPTH_STEP, depths);
        }
        let last = &step[3 * self.poses.len()..];
        let Shape { log_radius, oval } = &mut self.shape;
        *log_radius = moved(*log_radius, last[0], RADIUS_STEP, RADII.map(f64::ln));
        for k in 0..2 {
            oval[k] = moved(oval[k], last[1 + k], OVAL_STEP, [-MOST_OVAL, MOST_OVAL]);
        }
        let size = oval[0].hypot(oval[1]);
        if size > MOST_OVAL {
            oval.iter_mut().for_each(|x| *x *= MOST_OVAL / size);
        }
    }
}

fn narrow(row: usize) -> u32 {
    u32::try_from(row).unwrap_or(u32::MAX)
}
