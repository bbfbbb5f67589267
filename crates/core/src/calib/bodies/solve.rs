//! The fit: Gauss-Newton under the loss of Student's t, whose noise is estimated before each step, so that the scale
//! shrinks by itself from what the start leaves; then Tukey's loss, under which outliers lose their influence. Last the
//! tolerances of patches and modules are learned: by expectation and maximisation, from how far those bodies moved
//! `(dempster1977)`.

use glam::{DMat3, DVec3};

use super::noise::{Noise, STUDENT, Stated};
use super::options::{BodyLevel, BodyOptions, Tolerance};
use super::placement::{Hierarchy, Placement, precision};
use super::system::{BLOCK, BodySystem, Weighted, deviation};
use super::touches::{Touch, TouchId, Touches};
use crate::calib::CalibError;
use crate::id::IdVec;
use crate::least_squares::{
    Descent, LossFunction, NormalEquations, Options, Problem, Schedule, Step, inlier_bound2, minimise,
    share_left,
};
use crate::run::Run;

/// Steps under the loss of Student's t, before each of which the noise is estimated, and those of a start.
const STUDENT_STEPS: usize = 8;
const START_STEPS: usize = 10;

/// Stages under Tukey's loss, after each of which the noise is estimated; and their steps.
const STAGES: usize = 4;
const STEPS_PER_STAGE: usize = 6;

/// Rounds in which tolerances are learned, each of so many estimates with two steps after them.
const TOLERANCE_ROUNDS: usize = 3;
const TOLERANCE_ESTIMATES: usize = 4;

/// Stages and steps of a fit that begins at the fit of other contacts of the same skin.
const CONTINUED_STAGES: usize = 3;
const CONTINUED_STEPS: usize = 4;

/// Most steps of the last stage. It converges by a half with each where touches say little of some direction: 28 are usual then.
const MOST_LAST_STEPS: usize = 100;

/// A step below this, in m and rad, ends a stage.
const SMALL_STEP: f64 = 1e-6;

/// A step below this, in m and rad, ends the fit.
const LAST_STEP: f64 = 1e-11;

/// Least share of its variance that is left in a residual: of touches that the fit follows almost wholly nothing is known.
const LEAST_SHARE: f64 = 0.15;

/// What is believed of tolerances before they are learned: half the given ones, seen six times.
const BELIEVED_SHARE: f64 = 0.5;
const BELIEVED_COUNT: f64 = 6.0;

/// Standard deviations of their squares by which tolerances of the covariances are above the learned ones. Errors of taxels, after rigid
/// alignment, are 0.78 to 1.18 of their standard deviations on simulated logs with every trouble; 0.84 to 1.38 with the learned ones, 0.64 to 1.14
/// with the larger of these and the given ones.
const CERTAIN: f64 = 2.0;

/// A solved fit.
#[derive(Clone)]
pub(super) struct Solved {
    pub(super) placement: Placement,
    /// Squared whitened errors.
    pub(super) chi2: IdVec<TouchId, f64>,
    /// Weight of each touch, without that of its contact: 1 or almost 0.
    pub(super) inliers: IdVec<TouchId, bool>,
    pub(super) weights: IdVec<TouchId, Weighted>,
    pub(super) noise: Noise,
    /// The options with learned tolerances, and with those of the covariances.
    pub(super) learned: BodyOptions,
    pub(super) certain: BodyOptions,
    pub(super) steps: usize,
    pub(super) converged: bool,
}

/// The fit of a system whose noise and loss change from stage to stage.
struct Fit<'f> {
    system: &'f BodySystem<'f>,
    noise: Noise,
    loss: LossFunction,
    steps: usize,
}

/// A placement with the squared whitened errors and the information of all touches.
struct At {
    placement: Placement,
    errors: IdVec<TouchId, (f64, DMat3)>,
}

impl<'f> Fit<'f> {
    fn new(system: &'f BodySystem<'f>, noise: Noise) -> Self {
        Self { system, noise, loss: LossFunction::tukey(3), steps: 0 }
    }

    fn at(&self, placement: Placement) -> At {
        let errors = self.system.touches.all.map(|touch| {
            let error = placement.error(self.system.hierarchy, touch).0;
            let information = self.noise.information(&touch.stated);
            (error.dot(information * error), information)
        });
        At { placement, errors }
    }

    fn weights(&self, at: &At) -> IdVec<TouchId, Weighted> {
        let weighed = at.errors.iter().zip(&self.system.touches.all);
        weighed.map(|(&(chi2, info), touch)| (touch.weight * self.loss.weight(chi2), info)).collect()
    }

    /// At most so many steps, from a placement.
    fn advance(
        &mut self,
        from: Placement,
        steps: usize,
        small: f64,
        run: Run<'_>,
    ) -> Result<(At, bool), CalibError> {
        let limits = Options { max_iterations: steps, small_step: small, ..Options::default() };
        let from = self.at(from);
        let (at, termination) = minimise(self, from, &limits, run)?;
        Ok((at, termination.is_converged()))
    }

    /// Steps under the loss of Student's t, the noise being estimated before each.
    fn begin(&mut self, mut at: Placement, steps: usize, run: Run<'_>) -> Result<Placement, CalibError> {
        self.loss = LossFunction::Cauchy { c2: STUDENT };
        for _ in 0..steps {
            self.learn(&at, None);
            at = self.advance(at, 1, 0.0, run)?.0.placement;
        }
        self.loss = LossFunction::tukey(3);
        Ok(at)
    }

    /// The shares of the variance of the noise that the fit leaves in each residual.
    fn shares(&self, at: &At) -> Result<IdVec<TouchId, f64>, CalibError> {
        let (weights, placement) = (self.weights(at), &at.placement);
        let factor = self.system.factor(&self.system.linearise(placement, &weights))?;
        let share = |(touch, weighted): (&Touch, &Weighted)| {
            let prediction = self.system.prediction(&factor, placement, touch)?;
            let trace = prediction.x_axis.x + prediction.y_axis.y + prediction.z_axis.z;
            let left = share_left(weighted.0 / touch.weight, trace, self.noise.trace(&touch.stated));
            Ok(left.clamp(LEAST_SHARE, 1.0))
        };
        self.system.touches.all.iter().zip(&weights).map(share).collect()
    }

    /// Learns the noise from residuals that have `shares` of its variance.
    fn learn(&mut self, at: &Placement, shares: Option<&IdVec<TouchId, f64>>) {
        let error = |(number, touch): (TouchId, &Touch)| {
            let error = at.error(self.system.hierarchy, touch).0;
            let share = shares.map_or(1.0, |shares| shares[number]);
            (error / share.sqrt(), touch.weight, touch.stated)
        };
        let errors: Vec<(DVec3, f64, Stated)> = self.system.touches.all.enumerate().map(error).collect();
        self.noise = self.noise.learned(&errors);
    }

    fn learn_from(&mut self, at: At) -> Result<Placement, CalibError> {
        let shares = self.shares(&at)?;
        self.learn(&at.placement, Some(&shares));
        Ok(at.placement)
    }

    /// The tolerances of patches and modules that explain best how far those moved that are touched: the mean square of the motions,
    /// with what is not known of them, and of what is believed before. And those with what few bodies leave open: a mean of `n` squares
    /// has the standard deviation `sqrt(2 / n)` of itself.
    fn tolerances(&self, at: &At, given: &BodyOptions) -> Result<[BodyOptions; 2], CalibError> {
        let factor = self.system.factor(&self.system.linearise(&at.placement, &self.weights(at)))?;
        let inverse = factor.selected_inverse();
        let is_touched = self.system.hierarchy.touched();
        let learned = |level: BodyLevel, given: Tolerance| {
            let believed = BELIEVED_SHARE * BELIEVED_SHARE * BELIEVED_COUNT;
            let mut squares = [given.translation, given.rotation].map(|sigma| believed * sigma * sigma);
            let (mut count, mut determined) = (BELIEVED_COUNT, [BELIEVED_COUNT; 2]);
            let tolerance = precision(self.system.options, level);
            let levels = self.system.hierarchy.levels.enumerate();
            let of_level = levels.filter(|&(body, of)| *of == level && is_touched[body]);
            for (body, row) in of_level.filter_map(|(body, _)| Some((body, self.system.row(body)?))) {
                let (moved, unknown) = (deviation(&at.placement, body), inverse.diagonal::<BLOCK>(row));
                for k in 0..BLOCK {
                    squares[k / 3] += moved[k] * moved[k] + unknown[k][k];
                    determined[k / 3] += (1.0 - unknown[k][k] * tolerance[k]).max(0.0);
                }
                count += 3.0;
            }
            let [translation, rotation] = squares.map(|sum| (sum / count).sqrt());
            let wider = determined.map(|n| (1.0 + CERTAIN * (2.0 / n).sqrt()).sqrt());
            let certain = Tolerance { translation: wider[0] * translation, rotation: wider[1] * rotation };
            [Tolerance { translation, rotation }, certain]
        };
        let (patch, module) =
            (learned(BodyLevel::Patch, given.patch), learned(BodyLevel::Module, given.module));
        Ok([0, 1].map(|k| BodyOptions { patch: patch[k], module: module[k], ..*given }))
    }

    fn solved(&self, at: At, [learned, certain]: [BodyOptions; 2], converged: bool) -> Solved {
        let outlier2 = inlier_bound2(3);
        Solved {
            chi2: at.errors.map(|error| error.0),
            inliers: at.errors.map(|error| error.0 <= outlier2),
            weights: self.weights(&at),
            placement: at.placement,
            noise: self.noise,
            learned,
            certain,
            steps: self.steps,
            converged,
        }
    }
}

impl<'f> Problem for Fit<'f> {
    type Point = At;
    type Linear = NormalEquations<'f>;
    type Error = CalibError;

    fn unknowns(&self) -> usize {
        self.system.unknowns()
    }

    /// Weights and noise change too often for costs to be compared.
    fn descent(&self) -> Descent {
        Descent::Free
    }

    fn cost(&self, at: &At) -> f64 {
        let losses = at.errors.iter().zip(&self.system.touches.all);
        0.5 * losses.map(|((chi2, _), touch)| touch.weight * self.loss.cost(*chi2)).sum::<f64>()
    }

    fn linearise(&self, at: &At) -> Result<NormalEquations<'f>, CalibError> {
        Ok(self.system.linearise(&at.placement, &self.weights(at)))
    }

    fn solve(
        &self,
        _at: &At,
        linear: &NormalEquations<'f>,
        damping: f64,
    ) -> Result<Option<Vec<f64>>, CalibError> {
        linear.step(damping).map(Some).map_err(BodySystem::explain)
    }

    fn predicted_decrease(&self, linear: &NormalEquations<'f>, step: &[f64], damping: f64) -> f64 {
        linear.predicted_decrease(step, damping)
    }

    fn moved(&self, at: &At, _linear: &NormalEquations<'f>, step: &[f64]) -> At {
        self.at(self.system.advanced(&at.placement, step))
    }

    fn after_step(
        &mut self,
        _at: &mut At,
        _linear: NormalEquations<'f>,
        _step: &Step,
    ) -> Result<Schedule, CalibError> {
        self.steps += 1;
        Ok(Schedule::Settled)
    }
}

/// A start, refined with mount, probe and standoff.
pub(super) fn refined(
    options: &BodyOptions,
    hierarchy: &Hierarchy,
    touches: &Touches,
    from: Placement,
    run: Run<'_>,
) -> Result<Placement, CalibError> {
    let system = BodySystem::new(options, BodyLevel::Mount, hierarchy, touches)?;
    Fit::new(&system, Noise::START).begin(from, START_STEPS, run)
}

/// Fits all bodies down to `level`, from a placement.
pub(super) fn solve(
    options: &BodyOptions,
    level: BodyLevel,
    hierarchy: &Hierarchy,
    touches: &Touches,
    mut from: Placement,
    run: Run<'_>,
) -> Result<Solved, CalibError> {
    from.linear.resize(touches.linear(options).len(), 0.0);
    let system = BodySystem::new(options, level, hierarchy, touches)?;
    let mut fit = Fit::new(&system, Noise::START);
    let mut placement = fit.begin(from, STUDENT_STEPS, run)?;
    for _ in 0..STAGES {
        let at = fit.advance(placement, STEPS_PER_STAGE, SMALL_STEP, run)?.0;
        placement = fit.learn_from(at)?;
    }
    let (mut noise, mut steps, mut learned) = (fit.noise, fit.steps, [*options; 2]);
    let rounds = if level == BodyLevel::Mount { 0 } else { TOLERANCE_ROUNDS };
    for _ in 0..rounds {
        for _ in 0..TOLERANCE_ESTIMATES {
            let system = BodySystem::new(&learned[0], level, hierarchy, touches)?;
            let mut fit = Fit { steps, ..Fit::new(&system, noise) };
            let at = fit.advance(placement, 2, 0.0, run)?.0;
            let next = fit.tolerances(&at, options)?;
            (placement, steps) = (at.placement, fit.steps);
            learned = next;
        }
        let system = BodySystem::new(&learned[0], level, hierarchy, touches)?;
        let mut fit = Fit { steps, ..Fit::new(&system, noise) };
        let at = fit.advance(placement, 2, 0.0, run)?.0;
        placement = fit.learn_from(at)?;
        (noise, steps) = (fit.noise, fit.steps);
    }
    let system = BodySystem::new(&learned[0], level, hierarchy, touches)?;
    let mut fit = Fit { steps, ..Fit::new(&system, noise) };
    let (at, converged) = fit.advance(placement, MOST_LAST_STEPS, LAST_STEP, run)?;
    Ok(fit.solved(at, learned, converged))
}

/// Fits the bodies down to `level` to other touches of the same skin, from a fit and with its noise and tolerances.
pub(super) fn continued(
    fitted: &Solved,
    level: BodyLevel,
    hierarchy: &Hierarchy,
    touches: &Touches,
    from: Placement,
    run: Run<'_>,
) -> Result<Placement, CalibError> {
    let system = BodySystem::new(&fitted.learned, level, hierarchy, touches)?;
    let mut fit = Fit::new(&system, fitted.noise);
    let mut placement = from;
    for _ in 0..CONTINUED_STAGES {
        placement = fit.advance(placement, CONTINUED_STEPS, SMALL_STEP, run)?.0.placement;
        fit.learn(&placement, None);
    }
    Ok(placement)
}
