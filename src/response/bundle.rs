//! The bundle adjustment: all presses and all taxels at once, by Gauss-Newton with bounded steps.
//!
//! Unknown are, for each taxel, the logarithm of its reading over the depth; for each press a shape; for each of its
//! frames a place and a depth; and for all the blur of the cover and the power with which readings grow with depth. The
//! unknowns of a press are eliminated (`elimination`), which leaves a sparse system of the taxels.
//!
//! It ends when the steps of the taxels are small against what is known of them, never after a number of steps: long
//! waves over the skin come last.

use crate::least_squares::{Descent, Options, Problem, Schedule, Step, minimise};
use crate::parallel::par_map;
use crate::response::ResponseError;
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

/// All presses and what is known of the taxels, as a problem of the minimiser.
struct Bundle<'p> {
    presses: &'p [Press],
    noise: &'p [f64],
    /// The mean of the logarithms at the start, which the prior of gains keeps.
    centre: f64,
    is_pressed: Vec<bool>,
    system: &'p BlockSystem,
    /// The equations of the last step.
    last: Option<Equations<'p>>,
    steps: usize,
}

/// All unknowns: of presses, the logarithms of taxels, and what is shared.
struct At {
    states: Vec<State>,
    logs: Vec<f64>,
    common: Common,
}

/// The factored system of taxels and shared numbers, without the unknowns of presses.
struct Equations<'s> {
    reduced: Vec<Reduced>,
    factor: BlockFactor<'s>,
    gradient: Vec<f64>,
    /// Of the taxels and the shared numbers.
    variances: Vec<f64>,
}

/// Solves for the taxels: the logarithms of reading over depth, relative to their mean, and their sigma.
///
/// `start` are first guesses of the logarithms, `noise` the standard deviations of readings.
pub(super) fn adjust(
    presses: &[Press],
    start: Vec<f64>,
    noise: &[f64],
    run: Run<'_>,
) -> Result<(Vec<f64>, Vec<f64>, GainReport), ResponseError> {
    let system = BlockSystem::new(pattern(presses, start.len()), 1)?;
    let (mut bundle, start) = Bundle::new(presses, start, noise, &system);
    let limits = Options { max_iterations: MOST_STEPS, small_step: SMALL_STEP, ..Options::DEFAULT };
    let (At { logs, common, .. }, termination) = minimise(&mut bundle, start, &limits, run)?;
    let last = bundle.last.as_ref().ok_or(ResponseError::Singular)?;
    let sum = |k: usize| last.reduced.iter().map(|one| one.misfit[k]).sum::<f64>();
    let report = GainReport {
        presses: presses.len(),
        steps: bundle.steps,
        has_converged: termination.is_converged(),
        blur: common.log_blur.exp(),
        power: common.power,
        misfit: sum(0) / sum(1).max(1.0),
        ..GainReport::default()
    };
    let sigma = bundle.sigma(last)?;
    let mean = bundle.mean(&logs);
    Ok((logs.iter().map(|log| log - mean).collect(), sigma, report))
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
    fn new(presses: &'p [Press], logs: Vec<f64>, noise: &'p [f64], system: &'p BlockSystem) -> (Self, At) {
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
        let states: Vec<State> = presses.iter().map(start).collect();
        let mut is_pressed = vec![false; logs.len()];
        for press in presses {
            for (k, &taxel) in press.taxels.iter().enumerate() {
                is_pressed[taxel as usize] |= press.frames.iter().any(|frame| !frame.readings[k].is_nan());
            }
        }
        let common = Common { log_blur: USUAL_BLUR.ln(), power: 1.0, depth: [depths(&states)[0], 0.5] };
        let mut bundle = Self { presses, noise, centre: 0.0, is_pressed, system, last: None, steps: 0 };
        bundle.centre = bundle.mean(&logs);
        (bundle, At { states, logs, common })
    }

    /// The mean over the taxels that were pressed.
    fn mean(&self, of: &[f64]) -> f64 {
        let pressed = || of.iter().zip(&self.is_pressed).filter(|(_, is)| **is).map(|(x, _)| x);
        pressed().sum::<f64>() / (pressed().count() as f64).max(1.0)
    }

    fn reduced(&self, at: &At) -> Result<Vec<Reduced>, ResponseError> {
        let presses: Vec<(&Press, &State)> = self.presses.iter().zip(&at.states).collect();
        let of = |&(press, state): &(&Press, &State)| {
            let pick = |of: &[f64]| -> Vec<f64> { press.taxels.iter().map(|&v| of[v as usize]).collect() };
            reduce(press, state, &at.common, &pick(&at.logs), &pick(self.noise))
        };
        par_map(&presses, of).into_iter().collect::<Option<_>>().ok_or(ResponseError::Singular)
    }

    /// The rows of the whole system that those of a press are.
    fn rows(&self, press: &Press) -> Vec<usize> {
        let shared = (0..SHARED).map(|k| self.is_pressed.len() + k);
        press.taxels.iter().map(|&v| v as usize).chain(shared).collect()
    }

    /// The factored system of taxels and shared numbers, and its gradient.
    fn assemble(&self, at: &At, reduced: &[Reduced]) -> Result<(BlockFactor<'p>, Vec<f64>), ResponseError> {
        let taxels = at.logs.len();
        let mut matrix = self.system.zero();
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
                        self.system.slot(row.max(column), row.min(column))
                    };
                    matrix.add(slot.ok_or(ResponseError::Singular)?, |_, _| entry);
                }
            }
        }
        let mut prior = vec![GAIN.powi(-2); taxels];
        prior.extend([LOG_BLUR.powi(-2), POWER.powi(-2)]);
        matrix.add_diagonal(&prior);
        for (row, log) in at.logs.iter().enumerate() {
            gradient[row] -= prior[row] * (log - self.centre);
        }
        gradient[taxels] -= prior[taxels] * (at.common.log_blur - USUAL_BLUR.ln());
        gradient[taxels + 1] -= prior[taxels + 1] * (at.common.power - 1.0);
        Ok((matrix.factor()?, gradient))
    }

    /// The sigma of the logarithms relative to their mean: of the equations, or of how much presses disagree with
    /// each other (the sandwich estimate of White 1982), whichever is larger.
    fn sigma(&self, equations: &Equations<'_>) -> Result<Vec<f64>, ResponseError> {
        const COLUMNS: usize = 64;
        let Equations { reduced, factor, variances, .. } = equations;
        let variance = |row: usize| variances[row];
        let (taxels, rows) = (self.is_pressed.len(), self.is_pressed.len() + SHARED);
        let pressed = self.is_pressed.iter().filter(|is| **is).count().max(1) as f64;
        // Covariances with the mean.
        let mut with_mean = vec![0.0; rows];
        with_mean
            .iter_mut()
            .zip(&self.is_pressed)
            .for_each(|(x, &is)| *x = f64::from(u8::from(is)) / pressed);
        factor.solve(&mut with_mean, 1)?;
        let of_mean = self.mean(&with_mean[..taxels]);
        let model: Vec<f64> =
            (0..taxels).map(|row| (variance(row) - 2.0 * with_mean[row] + of_mean).max(0.0)).collect();
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
                let mean = self.mean(&column[..taxels]);
                disagreement.iter_mut().zip(column).for_each(|(sum, x)| *sum += (x - mean).powi(2));
            }
        }
        let sigma = |row: usize| {
            if !self.is_pressed[row] {
                return GAIN;
            }
            let count: f64 = seen[row];
            let few = if count > 1.5 { (count / (count - 1.5)).min(MOST_FEW) } else { MOST_FEW };
            (SIGMA_FACTOR * model[row].max(few * disagreement[row]).sqrt()).hypot(SIGMA_FLOOR)
        };
        Ok((0..taxels).map(sigma).collect())
    }
}

/// Mean and standard deviation of the mean logarithms of the depths of presses.
fn depths(states: &[State]) -> [f64; 2] {
    let of =
        |state: &State| state.poses.iter().map(|pose| pose.log_depth).sum::<f64>() / state.poses.len() as f64;
    let count = (states.len() as f64).max(1.0);
    let mean = states.iter().map(of).sum::<f64>() / count;
    let variance = states.iter().map(|state| (of(state) - mean).powi(2)).sum::<f64>() / count;
    [mean, variance.sqrt()]
}

impl<'p> Problem for Bundle<'p> {
    type Point = At;
    type Linear = Equations<'p>;
    type Error = ResponseError;

    fn unknowns(&self) -> usize {
        self.system.blocks()
    }

    /// Weights follow the predictions, and depths are learned: costs are not compared.
    fn descent(&self) -> Descent {
        Descent::Free
    }

    fn cost(&self, _at: &At) -> f64 {
        0.0
    }

    fn linearise(&self, at: &At) -> Result<Equations<'p>, ResponseError> {
        let reduced = self.reduced(at)?;
        let (factor, gradient) = self.assemble(at, &reduced)?;
        let inverse = factor.selected_inverse();
        let variances = (0..self.system.blocks()).map(|row| inverse.diagonal::<1>(row)[0][0]).collect();
        drop(inverse);
        Ok(Equations { reduced, factor, gradient, variances })
    }

    fn solve(
        &self,
        at: &At,
        linear: &Equations<'p>,
        _damping: f64,
    ) -> Result<Option<Vec<f64>>, ResponseError> {
        let mut step = linear.gradient.clone();
        linear.factor.solve(&mut step, 1)?;
        for (row, x) in step.iter_mut().enumerate() {
            let most = if row < at.logs.len() { GAIN_STEP } else { SHARED_STEP };
            *x = x.clamp(-most, most);
        }
        Ok(Some(step))
    }

    fn predicted_decrease(&self, _linear: &Equations<'p>, _step: &[f64], _damping: f64) -> f64 {
        0.0
    }

    fn moved(&self, at: &At, linear: &Equations<'p>, step: &[f64]) -> At {
        let mut states = at.states.clone();
        for ((state, press), reduced) in states.iter_mut().zip(self.presses).zip(&linear.reduced) {
            let others: Vec<f64> = self.rows(press).into_iter().map(|row| step[row]).collect();
            state.move_by(&reduced.step(&others));
        }
        let (taxels, mut common) = (at.logs.len(), at.common);
        common.log_blur = (common.log_blur + step[taxels]).clamp(BLURS[0].ln(), BLURS[1].ln());
        common.power = (common.power + step[taxels + 1]).clamp(POWERS[0], POWERS[1]);
        At { states, logs: at.logs.iter().zip(step).map(|(log, x)| log + x).collect(), common }
    }

    /// The rms step of usable taxels over their sigma; 0 without a usable taxel, when there is nothing to wait for.
    fn size(&self, linear: &Equations<'p>, step: &[f64]) -> f64 {
        let mean = self.mean(&step[..self.is_pressed.len()]);
        let (mut sum, mut count) = (0.0, 0.0);
        for (row, _) in self.is_pressed.iter().enumerate().filter(|(_, is)| **is) {
            let variance = linear.variances[row];
            if variance < USABLE * USABLE {
                sum += (step[row] - mean).powi(2) / variance;
                count += 1.0;
            }
        }
        if count > 0.0 { f64::sqrt(sum / count) } else { 0.0 }
    }

    /// Learns how deep presses are.
    fn after_step(
        &mut self,
        at: &mut At,
        linear: Equations<'p>,
        step: &Step,
    ) -> Result<Schedule, ResponseError> {
        (self.last, self.steps) = (Some(linear), step.number);
        if step.number >= STEPS_TO_LEARN {
            let [mean, deviation] = depths(&at.states);
            at.common.depth = [mean, deviation.clamp(DEPTH_DEVIATIONS[0], DEPTH_DEVIATIONS[1])];
        }
        Ok(if step.number >= LEAST_STEPS { Schedule::Settled } else { Schedule::Open })
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
