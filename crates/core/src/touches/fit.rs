//! The position of one taxel from all its readings: the distance of each position of the sphere from those that
//! would give exactly this reading.
//!
//! A taxel at `x` with the normal `n` reads `g D(p)` where the sphere's centre is at `p`; `D` is the mean depth on its
//! disc ([`Profile`]) and `g` its gain. Both the arm (standard deviation `a`) and the reading (`s`) are noisy, so
//! that the residual is the signed distance of `p` from the surface `g D = reading`, with the variance
//! `a^2 + (s / (g |grad D|))^2`: orthogonal distance regression. Unknown are `x` and `log g`; Levenberg and Marquardt,
//! Huber's weights. Depth and gain are both determined: one by the width of the profile, the other by its height.

use glam::DVec3;

use crate::numeric::solve_system;
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

    /// Its weight, which Huber's function lowers for outliers.
    pub(super) fn weight(&self, noise: Noise) -> f64 {
        let variance = self.variance(noise);
        let sigmas = self.distance.abs() / variance.sqrt();
        (HUBER / sigmas).min(1.0) / variance
    }
}

/// Residuals above this many standard deviations count less.
pub(super) const HUBER: f64 = 2.5;

/// A mean depth that changes by less than this for each m, or a reading that is this many radii of the sphere away, says
/// nothing of a position. Both are far beyond what is used: they keep sums finite.
const LEAST_SLOPE: f64 = 1e-6;
const MOST_RADII: f64 = 1e3;

/// Most steps.
const MOST_STEPS: usize = 10;

/// A step that moves the taxel by less than this, in m, is the last.
const SMALLEST_STEP: f64 = 1e-6;

/// The largest step, in radii of the sphere.
const LARGEST_STEP: f64 = 0.3;

/// One taxel with all its samples.
pub(super) struct Taxel<'a> {
    pub(super) normal: DVec3,
    pub(super) guess: Guess,
    pub(super) samples: &'a [Sample],
    /// In ascending order of their radii.
    pub(super) profiles: &'a [Profile],
}

/// A sphere above a taxel: its profile, how far its centre is from the normal line and above the tangent plane, in m, and
/// the unit vector away from that line.
struct Placed<'p> {
    profile: &'p Profile,
    offset: f64,
    height: f64,
    lateral: DVec3,
}

impl Taxel<'_> {
    /// The residual of a sample; `None` if the body is no sphere.
    pub(super) fn residual(&self, sample: &Sample, at: &Estimate) -> Option<Residual> {
        let Placed { profile, offset, height, lateral } = self.placed(sample, at)?;
        let depth = sample.reading / libm::exp(at.log_gain);
        let nearest = profile.nearest(offset, height, depth);
        // Where the profile is flat, or the reading far beyond it, nothing follows from it.
        if !(nearest.slope > LEAST_SLOPE && nearest.distance.abs() < MOST_RADII * profile.radius) {
            return None;
        }
        let outward = nearest.outward.x * lateral + nearest.outward.y * self.normal;
        Some(Residual {
            distance: nearest.distance,
            by_position: -outward,
            by_gain: -depth / nearest.slope,
            per_reading: (libm::exp(at.log_gain) * nearest.slope).recip(),
        })
    }

    /// The mean depth on the disc where the sphere is, in m, and its derivative with respect to the sphere's position;
    /// `None` if the body is no sphere.
    pub(super) fn pressed(&self, sample: &Sample, at: &Estimate) -> Option<(f64, DVec3)> {
        let place = self.placed(sample, at)?;
        let value = place.profile.at(place.offset, place.height);
        Some((value.depth, value.gradient.x * place.lateral + value.gradient.y * self.normal))
    }

    fn placed(&self, sample: &Sample, at: &Estimate) -> Option<Placed<'_>> {
        let found =
            self.profiles.binary_search_by(|profile| profile.radius.total_cmp(&sample.radius)).ok()?;
        let q = sample.centre - at.position;
        let height = q.dot(self.normal);
        let across = q - height * self.normal;
        let offset = across.length();
        let lateral = if offset > 0.0 { across / offset } else { DVec3::ZERO };
        Some(Placed { profile: &self.profiles[found], offset, height, lateral })
    }

    pub(super) fn residuals(&self, at: &Estimate) -> impl Iterator<Item = (&Sample, Residual)> {
        self.samples.iter().filter_map(move |sample| Some((sample, self.residual(sample, at)?)))
    }

    fn cost(&self, at: &Estimate, noise: Noise, prior: GainPrior) -> f64 {
        let gain = (at.log_gain - prior.log_gain) / prior.sigma;
        let one = |residual: Residual| {
            let sigmas = residual.distance.abs() / residual.variance(noise).sqrt();
            if sigmas <= HUBER { sigmas * sigmas } else { HUBER * (2.0 * sigmas - HUBER) }
        };
        let off = (at.position - self.guess.position).length_squared() / self.guess.sigma.powi(2);
        self.residuals(at).map(|(_, residual)| one(residual)).sum::<f64>() + gain * gain + off
    }

    /// The estimate that explains the samples best, from a first guess.
    pub(super) fn fit(&self, start: Estimate, noise: Noise, prior: GainPrior) -> Estimate {
        let mut at = start;
        let mut cost = self.cost(&at, noise, prior);
        let mut damping = 1e-3;
        let radius = self.samples.iter().map(|sample| sample.radius).fold(0.0, f64::max);
        for _ in 0..MOST_STEPS {
            let normal = self.normal_equations(&at, noise, prior);
            let (mut moved, mut is_better) = (0.0, false);
            while damping < 1e8 {
                let mut system = normal.system;
                system.iter_mut().enumerate().for_each(|(k, line)| line[k] *= 1.0 + damping);
                let Some([x, y, z, gain]) = solve_system(system) else { break };
                let step = DVec3::new(x, y, z).clamp_length_max(LARGEST_STEP * radius);
                let next =
                    Estimate { position: at.position + step, log_gain: at.log_gain + gain.clamp(-0.5, 0.5) };
                let next_cost = self.cost(&next, noise, prior);
                if next_cost < cost {
                    (at, cost, moved, is_better) = (next, next_cost, step.length(), true);
                    damping = (0.1 * damping).max(1e-9);
                    break;
                }
                damping *= 10.0;
            }
            if !is_better || moved < SMALLEST_STEP {
                break;
            }
        }
        at
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
