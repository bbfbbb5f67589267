//! The fit: Gauss-Newton under Tukey's loss whose bound shrinks in stages, so that no good start is needed and
//! outliers lose their influence; last, least squares on the inliers. Where the noise is not stated it is estimated
//! after each stage, along the normal and in the tangent plane apart, and Tukey's loss is kept to the end: the tails of
//! such noise are not known. The fit shrinks the residuals, more the fewer touches a module has, so each is divided by
//! the share of the noise that is left in it.

use glam::{DMat3, DVec3};

use super::options::{BodyLevel, BodyOptions, TouchNoise};
use super::placement::{Hierarchy, Placement};
use super::system::{BodySystem, Weighted};
use super::touches::{Touch, TouchId, Touches};
use crate::calib::CalibError;
use crate::id::IdVec;
use crate::least_squares::{
    Descent, LossFunction, NormalEquations, Options, Problem, Schedule, Step, inlier_bound2, minimise,
    share_left,
};
use crate::numeric::{DEVIATION_OF_MEDIAN, MEDIAN_OF_MAXWELL, MEDIAN_OF_RAYLEIGH, median};
use crate::run::Run;

/// First factor of the bound of Tukey's loss, which halves from stage to stage; larger where the drawing is farther from
/// the touches, so that none is rejected before the mount has moved.
const FIRST_SCALE: f64 = 8.0;

/// Stages with the bound itself: each estimates the noise anew.
const LAST_STAGES: usize = 3;

/// Gauss-Newton steps of a stage, after which the weights follow.
const STEPS_PER_STAGE: usize = 4;

/// Most steps of the last stage. Its weights change a few times at most.
const MOST_LAST_STEPS: usize = 30;

/// A step below this, in m and rad, ends a stage.
const SMALL_STEP: f64 = 1e-5;

/// A step below this, in m and rad, ends the fit.
const LAST_STEP: f64 = 1e-11;

/// Standard deviation that the noise is assumed to have before it is estimated, in m.
const FIRST_SIGMA: f64 = 4e-3;

/// No estimated standard deviation is below this, in m.
const LEAST_SIGMA: f64 = 3e-4;

/// Least share of its variance that is left in a residual: of touches that the fit follows almost wholly nothing is known.
const LEAST_SHARE: f64 = 0.1;

/// Touches of the same number of taxels of which a standard deviation is estimated.
const LEAST_TOUCHES: usize = 8;

/// Classes of touches: one, two, three, and more taxels.
pub(super) const CLASSES: usize = 4;

/// Standard deviations along the normal and per axis of the tangent plane of each class, in m.
pub(super) type EstimatedNoise = [[f64; 2]; CLASSES];

/// A solved fit.
pub(super) struct Solved {
    pub(super) placement: Placement,
    /// Squared whitened errors.
    pub(super) chi2: IdVec<TouchId, f64>,
    /// Weight of each touch, without that of its contact: 1 or almost 0.
    pub(super) inliers: IdVec<TouchId, bool>,
    pub(super) weights: IdVec<TouchId, Weighted>,
    pub(super) noise: EstimatedNoise,
    pub(super) steps: usize,
    pub(super) converged: bool,
}

fn class(touch: &Touch) -> usize {
    touch.taxels.len().clamp(1, CLASSES) - 1
}

/// The information of a touch whose mean normal is known, or zero.
fn information(options: &BodyOptions, noise: &EstimatedNoise, touch: &Touch, normal: DVec3) -> DMat3 {
    if options.noise == TouchNoise::Stated {
        return touch.information;
    }
    let [along, across] = noise[class(touch)].map(|sigma| sigma.powi(-2));
    if normal == DVec3::ZERO {
        // Without normals the two cannot be distinguished.
        return DMat3::from_diagonal(DVec3::splat(across));
    }
    let outer = DMat3::from_cols(normal * normal.x, normal * normal.y, normal * normal.z);
    DMat3::from_diagonal(DVec3::splat(across)) + outer * (along - across)
}

/// The fit of a system whose noise and loss change from stage to stage.
struct Fit<'f> {
    system: &'f BodySystem<'f>,
    noise: EstimatedNoise,
    loss: LossFunction,
    steps: usize,
}

/// A placement with the squared whitened errors and the information of all touches.
struct At {
    placement: Placement,
    errors: IdVec<TouchId, (f64, DMat3)>,
}

impl Fit<'_> {
    fn at(&self, placement: Placement) -> At {
        let errors = self.system.touches.all.map(|touch| {
            let (error, normal) = placement.error(self.system.hierarchy, touch);
            let information = information(self.system.options, &self.noise, touch, normal);
            (error.dot(information * error), information)
        });
        At { placement, errors }
    }

    fn weights(&self, at: &At) -> IdVec<TouchId, Weighted> {
        let weighed = at.errors.iter().zip(&self.system.touches.all);
        weighed.map(|(&(chi2, info), touch)| (touch.weight * self.loss.weight(chi2), info)).collect()
    }

    /// The shares of the variance of the noise that the fit leaves in each residual, along the normal and in the tangent
    /// plane.
    fn shares(&self, at: &At) -> Result<IdVec<TouchId, [f64; 2]>, CalibError> {
        let (weights, placement) = (self.weights(at), &at.placement);
        let factor = self.system.factor(&self.system.linearise(placement, &weights))?;
        let share = |(touch, weighted): (&Touch, &Weighted)| {
            let prediction = self.system.prediction(&factor, placement, touch)?;
            let normal = placement.error(self.system.hierarchy, touch).1;
            let trace = prediction.x_axis.x + prediction.y_axis.y + prediction.z_axis.z;
            let along = normal.dot(prediction * normal);
            let across = (trace - along) / if normal == DVec3::ZERO { 3.0 } else { 2.0 };
            let noise = self.noise[class(touch)].map(|sigma| sigma * sigma);
            let left = |k: usize, variance| share_left(weighted.0 / touch.weight, variance, noise[k]);
            Ok([left(0, along), left(1, across)].map(|share| share.max(LEAST_SHARE)))
        };
        self.system.touches.all.iter().zip(&weights).map(share).collect()
    }

    /// Standard deviations from medians, which half of the touches may spoil, of residuals that have `shares` of the
    /// variance. Both follow from the touches with a normal; from the lengths of all errors where few have one. A class
    /// of few touches takes the noise of all.
    fn estimate_noise(&mut self, at: &Placement, shares: Option<&IdVec<TouchId, [f64; 2]>>) {
        let error = |(number, touch): (TouchId, &Touch)| {
            let (error, normal) = at.error(self.system.hierarchy, touch);
            let along = error.dot(normal);
            let [one, two] = shares.map_or([1.0; 2], |shares| shares[number]).map(f64::sqrt);
            let across = (error - along * normal).length();
            (class(touch), normal != DVec3::ZERO, [along.abs() / one, across / two])
        };
        let errors: IdVec<TouchId, _> = self.system.touches.all.enumerate().map(error).collect();
        let sigmas = |takes: &dyn Fn(usize) -> bool| {
            let taken = || errors.iter().filter(|error| takes(error.0));
            let with_normal = || taken().filter(|error| error.1).map(|error| error.2);
            let is_isotropic = with_normal().count() < LEAST_TOUCHES && taken().any(|error| !error.1);
            let sigmas = if is_isotropic {
                [median(taken().map(|error| error.2[0].hypot(error.2[1])))? / MEDIAN_OF_MAXWELL; 2]
            } else {
                let across = median(with_normal().map(|error| error[1]))? / MEDIAN_OF_RAYLEIGH;
                [DEVIATION_OF_MEDIAN * median(with_normal().map(|error| error[0]))?, across]
            };
            Some(sigmas.map(|sigma| sigma.max(LEAST_SIGMA)))
        };
        let all = sigmas(&|_| true).unwrap_or([FIRST_SIGMA; 2]);
        for k in 0..CLASSES {
            let counts = [true, false].map(|has_normal| {
                errors.iter().filter(|error| error.0 == k && error.1 == has_normal).count()
            });
            let count = if counts[0] > 0 { counts[0] } else { counts[1] };
            let own = (count >= LEAST_TOUCHES).then(|| sigmas(&|class| class == k)).flatten();
            self.noise[k] = own.unwrap_or(all);
        }
    }
}

/// The factors of the bound in the stages, from one that leaves an error of `farthest` bounds some weight.
fn scales(farthest: f64) -> Vec<f64> {
    let mut scales = vec![1.0; LAST_STAGES];
    let mut next = 2.0;
    while next <= FIRST_SCALE || next < 2.0 * farthest && next.is_finite() {
        scales.push(next);
        next *= 2.0;
    }
    scales.reverse();
    scales
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

/// Fits all bodies down to `level`.
pub(super) fn solve(
    options: &BodyOptions,
    level: BodyLevel,
    hierarchy: &Hierarchy,
    touches: &Touches,
    run: Run<'_>,
) -> Result<Solved, CalibError> {
    let system = BodySystem::new(options, level, hierarchy, touches)?;
    let tukey = LossFunction::tukey(3);
    let noise = [[FIRST_SIGMA; 2]; CLASSES];
    let mut fit = Fit { system: &system, noise, loss: tukey, steps: 0 };
    let limits = |max_iterations, small_step| Options { max_iterations, small_step, ..Options::default() };
    let mut at = fit.at(Placement::drawn(hierarchy));
    let farthest = at.errors.iter().fold(0.0_f64, |most, (chi2, _)| most.max(*chi2));
    for scale in scales((farthest / tukey.bound2()).sqrt()) {
        fit.loss = tukey.scaled(scale * scale);
        at = minimise(&mut fit, at, &limits(STEPS_PER_STAGE, SMALL_STEP), run)?.0;
        if options.noise == TouchNoise::Estimated {
            // Before the last stages the bound is too wide for weights to mean something.
            fit.loss = tukey;
            let shares = (scale <= 1.0).then(|| fit.shares(&at)).transpose()?;
            fit.estimate_noise(&at.placement, shares.as_ref());
            at = fit.at(at.placement);
        }
    }
    let is_stated = options.noise == TouchNoise::Stated;
    fit.loss = if is_stated { LossFunction::truncated(3) } else { tukey };
    let (at, termination) = minimise(&mut fit, at, &limits(MOST_LAST_STEPS, LAST_STEP), run)?;
    let outlier2 = inlier_bound2(3);
    Ok(Solved {
        chi2: at.errors.map(|error| error.0),
        inliers: at.errors.map(|error| error.0 <= outlier2),
        weights: fit.weights(&at),
        placement: at.placement,
        noise: fit.noise,
        steps: fit.steps,
        converged: termination.is_converged(),
    })
}
