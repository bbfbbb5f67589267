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
use crate::calib::solve::loss::LossFunction;
use crate::calib::{CalibError, Loss};
use crate::id::IdVec;
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

struct Fit<'f> {
    options: &'f BodyOptions,
    hierarchy: &'f Hierarchy,
    touches: &'f Touches,
    noise: EstimatedNoise,
}

impl Fit<'_> {
    /// Squared whitened errors and information at a placement.
    fn chi2(&self, at: &Placement) -> IdVec<TouchId, (f64, DMat3)> {
        self.touches.all.map(|touch| {
            let (error, normal) = at.error(self.hierarchy, touch);
            let information = information(self.options, &self.noise, touch, normal);
            (error.dot(information * error), information)
        })
    }

    fn weights(&self, chi2: &IdVec<TouchId, (f64, DMat3)>, loss: LossFunction) -> IdVec<TouchId, Weighted> {
        let weighed = chi2.iter().zip(&self.touches.all);
        weighed.map(|(&(chi2, information), touch)| (touch.weight * loss.weight(chi2), information)).collect()
    }

    /// The shares of the variance of the noise that the fit leaves in each residual, along the normal and in the tangent
    /// plane: of a touch of weight `w` and information `R^-1` that of `R + (1 - 2w) J C J'`.
    fn shares(
        &self,
        system: &BodySystem<'_>,
        at: &Placement,
        weights: &IdVec<TouchId, Weighted>,
    ) -> Result<IdVec<TouchId, [f64; 2]>, CalibError> {
        let (factor, _) = system.linearise(self.hierarchy, at, self.touches, weights)?;
        let share = |(touch, weighted): (&Touch, &Weighted)| {
            let prediction = system.prediction(&factor, self.hierarchy, at, touch)?;
            let normal = at.error(self.hierarchy, touch).1;
            let trace = prediction.x_axis.x + prediction.y_axis.y + prediction.z_axis.z;
            let along = normal.dot(prediction * normal);
            let across = (trace - along) / if normal == DVec3::ZERO { 3.0 } else { 2.0 };
            let noise = self.noise[class(touch)];
            let change = 1.0 - 2.0 * weighted.0 / touch.weight;
            Ok([(along, noise[0]), (across, noise[1])]
                .map(|(variance, sigma)| (1.0 + change * variance / (sigma * sigma)).max(LEAST_SHARE)))
        };
        self.touches.all.iter().zip(weights).map(share).collect()
    }

    /// Standard deviations from medians, which half of the touches may spoil, of residuals that have `shares` of the
    /// variance. Both follow from the touches with a normal; from the lengths of all errors where few have one. A class
    /// of few touches takes the noise of all.
    fn estimate_noise(&mut self, at: &Placement, shares: Option<&IdVec<TouchId, [f64; 2]>>) {
        let error = |(number, touch): (TouchId, &Touch)| {
            let (error, normal) = at.error(self.hierarchy, touch);
            let along = error.dot(normal);
            let [one, two] = shares.map_or([1.0; 2], |shares| shares[number]).map(f64::sqrt);
            let across = (error - along * normal).length();
            (class(touch), normal != DVec3::ZERO, [along.abs() / one, across / two])
        };
        let errors: IdVec<TouchId, _> = self.touches.all.enumerate().map(error).collect();
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

/// Fits all bodies down to `level`.
pub(super) fn solve(
    options: &BodyOptions,
    level: BodyLevel,
    hierarchy: &Hierarchy,
    touches: &Touches,
    run: Run<'_>,
) -> Result<Solved, CalibError> {
    let system = BodySystem::new(options, level, hierarchy, touches)?;
    let mut fit = Fit { options, hierarchy, touches, noise: [[FIRST_SIGMA; 2]; CLASSES] };
    let mut placement = Placement::drawn(hierarchy);
    let (mut steps, mut converged) = (0, false);
    let step = |fit: &Fit<'_>, at: &mut Placement, weights: &IdVec<TouchId, Weighted>| {
        run.check()?;
        let (factor, mut step) = system.linearise(fit.hierarchy, at, fit.touches, weights)?;
        step.iter_mut().for_each(|x| *x = -*x);
        factor.solve(&mut step, 1).map_err(CalibError::Sparse)?;
        Ok::<f64, CalibError>(system.advance(at, &step))
    };
    let tukey = LossFunction::new(Loss::Tukey, 3);
    let farthest = fit.chi2(&placement).iter().fold(0.0_f64, |most, (chi2, _)| most.max(*chi2));
    for scale in scales((farthest / tukey.bound2()).sqrt()) {
        for _ in 0..STEPS_PER_STAGE {
            let weights = fit.weights(&fit.chi2(&placement), tukey.scaled(scale * scale));
            steps += 1;
            if step(&fit, &mut placement, &weights)? < SMALL_STEP {
                break;
            }
        }
        if options.noise == TouchNoise::Estimated {
            // Before the last stages the bound is too wide for weights to mean something.
            let weights = fit.weights(&fit.chi2(&placement), tukey);
            let shares = (scale <= 1.0).then(|| fit.shares(&system, &placement, &weights)).transpose()?;
            fit.estimate_noise(&placement, shares.as_ref());
        }
    }
    let last =
        LossFunction::new(if options.noise == TouchNoise::Stated { Loss::Truncated } else { Loss::Tukey }, 3);
    for _ in 0..MOST_LAST_STEPS {
        let weights = fit.weights(&fit.chi2(&placement), last);
        steps += 1;
        converged = step(&fit, &mut placement, &weights)? < LAST_STEP;
        if converged {
            break;
        }
    }
    let chi2 = fit.chi2(&placement);
    let weights = fit.weights(&chi2, last);
    let inliers = chi2.map(|&(chi2, _)| last.is_inlier(chi2));
    let chi2 = chi2.map(|&(chi2, _)| chi2);
    Ok(Solved { placement, chi2, inliers, weights, noise: fit.noise, steps, converged })
}
