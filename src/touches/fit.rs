//! The position of one taxel from all its readings: the distance of each position of the sphere from those that
//! would give exactly this reading.
//!
//! A taxel at `x` with the normal `n` reads `g D(p)` where the sphere's centre is at `p`; `D` is the mean depth on its
//! disc ([`Profile`]) and `g` its gain. Both the arm (standard deviation `a`) and the reading (`s`) are noisy, so
//! that the residual is the signed distance of `p` from the surface `g D = reading`, with the variance
//! `a^2 + (s / (g |grad D|))^2`: orthogonal distance regression. Unknown are `x` and `log g`; Levenberg and Marquardt,
//! Huber's weights. Depth and gain are both determined: one by the width of the profile, the other by its height.

use glam::DVec3;

use crate::least_squares::{Descent, LossFunction, Options, Problem, minimise};
use crate::numeric::solve_system;
use crate::run::{Cancelled, Run};
use crate::touches::gather::Sample;
use crate::touches::profile::Profile;

/// Standard deviations of positions and readings.
#[derive(Debug, Clone, Copy)]
pub(super) struct Noise {
    /// Of the position of the arm, in m.
    pub(super) arm: f64,
    /// Of a reading.
    pub(super) reading: f64,
    /// Readings are never taken to be more exact than this: the model is not.
    pub(super) least_reading: f64,
}

/// What is known about gains beforehand.
#[derive(Debug, Clone, Copy)]
pub(super) struct GainPrior {
    pub(super) log_gain: f64,
    /// Its standard deviation; infinite: nothing is known.
    pub(super) sigma: f64,
}

/// A first guess of a position, and its standard deviation, in m.
#[derive(Debug, Clone, Copy)]
pub(super) struct Guess {
    pub(super) position: DVec3,
    pub(super) sigma: f64,
}

/// A position and a gain.
#[derive(Debug, Clone, Copy)]
pub(super) struct Estimate {
    pub(super) position: DVec3,
    /// Of readings over mean depths, in 1/m.
    pub(super) log_gain: f64,
}

/// The residual of one sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct Residual {
    /// The signed distance, in m.
    pub(super) distance: f64,
    /// Derivative of the distance with respect to the position (a unit vector) and to the logarithm of the gain (m).
    pub(super) by_position: DVec3,
    pub(super) by_gain: f64,
    /// The noise of the reading as a distance, over its standard deviation.
    pub(super) per_reading: f64,
}

impl Residual {
    pub(super) fn variance(&self, noise: Noise) -> f64 {
        noise.arm * noise.arm + (noise.reading * self.per_reading).powi(2)
    }

    /// Its squared size over its variance.
    pub(super) fn square(&self, noise: Noise) -> f64 {
        self.distance * self.distance / self.variance(noise)
    }

    /// Its weight, which Huber's function lowers for outliers.
    pub(super) fn weight(&self, noise: Noise) -> f64 {
        HUBER.weight(self.square(noise)) / self.variance(noise)
    }
}

/// Residuals above 2.5 standard deviations count less.
pub(super) const HUBER: LossFunction = LossFunction::Huber { c2: 6.25 };

/// Ten steps, of which one that moves the taxel by less than a micrometre is the last: a start for the bundle adjustment,
/// which is exact. The first failure damps by a thousandth, since starts are half a contact off.
const LIMITS: Options = Options {
    max_iterations: 10,
    small_step: 1e-6,
    relative_decrease: 0.0,
    first_damping: 1e-3,
    largest_damping: 1e8,
    ..Options::DEFAULT
};

/// The largest step, in radii of the sphere.
const LARGEST_STEP: f64 = 0.3;

/// The largest step of the logarithm of a gain.
const LARGEST_GAIN_STEP: f64 = 0.5;

/// One taxel with all its samples.
pub(super) struct Taxel<'a> {
    pub(super) normal: DVec3,
    pub(super) guess: Guess,
    pub(super) samples: &'a [Sample],
    /// In ascending order of their radii.
    pub(super) profiles: &'a [Profile],
}

impl Taxel<'_> {
    /// The residual of a sample; `None` if the body is no sphere.
    pub(super) fn residual(&self, sample: &Sample, at: &Estimate) -> Option<Residual> {
        let found =
            self.profiles.binary_search_by(|profile| profile.radius.total_cmp(&sample.radius)).ok()?;
        let profile = &self.profiles[found];
        let q = sample.centre - at.position;
        let height = q.dot(self.normal);
        let across = q - height * self.normal;
        let offset = across.length();
        let depth = sample.reading / libm::exp(at.log_gain);
        let nearest = profile.nearest(offset, height, depth);
        if nearest.slope <= 0.0 {
            return None;
        }
        let lateral = if offset > 0.0 { across / offset } else { DVec3::ZERO };
        let outward = nearest.outward.x * lateral + nearest.outward.y * self.normal;
        Some(Residual {
            distance: nearest.distance,
            by_position: -outward,
            by_gain: -depth / nearest.slope,
            per_reading: (libm::exp(at.log_gain) * nearest.slope).recip(),
        })
    }

    pub(super) fn residuals(&self, at: &Estimate) -> impl Iterator<Item = (&Sample, Residual)> {
        self.samples.iter().filter_map(move |sample| Some((sample, self.residual(sample, at)?)))
    }

    /// The estimate that explains the samples best, from a first guess.
    pub(super) fn fit(
        &self,
        start: Estimate,
        noise: Noise,
        prior: GainPrior,
        run: Run<'_>,
    ) -> Result<Estimate, Cancelled> {
        let radius = self.samples.iter().map(|sample| sample.radius).fold(0.0, f64::max);
        let mut fit = Fit { taxel: self, noise, prior, largest_step: LARGEST_STEP * radius };
        Ok(minimise(&mut fit, start, &LIMITS, run)?.0)
    }

    /// The normal equations of a step.
    pub(super) fn normal_equations(&self, at: &Estimate, noise: Noise, prior: GainPrior) -> NormalEquations {
        let mut system = [[0.0; 5]; 4];
        for (_, residual) in self.residuals(at) {
            let weight = residual.weight(noise);
            let p = residual.by_position;
            let row = [p.x, p.y, p.z, residual.by_gain, -residual.distance];
            for (line, a) in system.iter_mut().zip(row) {
                line.iter_mut().zip(row).for_each(|(cell, b)| *cell += weight * a * b);
            }
        }
        let (gain, guess) = (prior.sigma.powi(-2), self.guess.sigma.powi(-2));
        for (k, off) in (self.guess.position - at.position).to_array().into_iter().enumerate() {
            system[k][k] += guess;
            system[k][4] += guess * off;
        }
        system[3][3] += gain;
        system[3][4] += gain * (prior.log_gain - at.log_gain);
        NormalEquations { system }
    }
}

/// A taxel with what is assumed of its samples, as a problem of the minimiser.
struct Fit<'t> {
    taxel: &'t Taxel<'t>,
    noise: Noise,
    prior: GainPrior,
    /// In m.
    largest_step: f64,
}

impl Fit<'_> {
    fn bounded(&self, step: &[f64]) -> (DVec3, f64) {
        let gain = step[3].clamp(-LARGEST_GAIN_STEP, LARGEST_GAIN_STEP);
        (DVec3::from_slice(step).clamp_length_max(self.largest_step), gain)
    }
}

impl Problem for Fit<'_> {
    type Point = Estimate;
    type Linear = NormalEquations;
    type Error = Cancelled;

    fn unknowns(&self) -> usize {
        4
    }

    fn descent(&self) -> Descent {
        Descent::Lower
    }

    fn cost(&self, at: &Estimate) -> f64 {
        let Self { taxel, noise, prior, .. } = self;
        let gain = (at.log_gain - prior.log_gain) / prior.sigma;
        let off = (at.position - taxel.guess.position).length_squared() / taxel.guess.sigma.powi(2);
        let losses = taxel.residuals(at).map(|(_, residual)| HUBER.cost(residual.square(*noise)));
        0.5 * (losses.sum::<f64>() + gain * gain + off)
    }

    fn linearise(&self, at: &Estimate) -> Result<NormalEquations, Cancelled> {
        Ok(self.taxel.normal_equations(at, self.noise, self.prior))
    }

    fn solve(
        &self,
        _at: &Estimate,
        linear: &NormalEquations,
        damping: f64,
    ) -> Result<Option<Vec<f64>>, Cancelled> {
        let mut system = linear.system;
        system.iter_mut().enumerate().for_each(|(k, line)| line[k] *= 1.0 + damping);
        Ok(solve_system(system).map(|step| step.to_vec()))
    }

    fn predicted_decrease(&self, linear: &NormalEquations, step: &[f64], damping: f64) -> f64 {
        let lines = linear.system.iter().enumerate().zip(step);
        0.5 * lines.map(|((k, line), x)| x * (damping * line[k] * x + line[4])).sum::<f64>()
    }

    fn moved(&self, at: &Estimate, _linear: &NormalEquations, step: &[f64]) -> Estimate {
        let (position, gain) = self.bounded(step);
        Estimate { position: at.position + position, log_gain: at.log_gain + gain }
    }

    /// How far the taxel moves, in m.
    fn size(&self, _linear: &NormalEquations, step: &[f64]) -> f64 {
        self.bounded(step).0.length()
    }
}

/// Four unknowns and the right side.
pub(super) struct NormalEquations {
    system: [[f64; 5]; 4],
}

impl NormalEquations {
    /// The information about the logarithm of the gain where the position is unknown.
    pub(super) fn gain_information(&self) -> f64 {
        let s = &self.system;
        let system: [[f64; 4]; 3] = std::array::from_fn(|k| [s[k][0], s[k][1], s[k][2], s[k][3]]);
        let Some(x) = solve_system(system) else { return 0.0 };
        s[3][3] - (0..3).map(|k| x[k] * s[k][3]).sum::<f64>()
    }
}
