//! The noise of touches: `a^2 I + f^2 S`, `S` the stated covariance of a touch. What a table states is a shape; `a` and `f`
//! are its scale.
//!
//! Both follow from the likelihood of Student's t distribution with 4 degrees of freedom `(lange1989)`, whose heavy tails
//! keep wrong touches from widening the noise, and from a weak belief that the table is right. A fit shrinks the
//! residuals, more the fewer touches a body has, so each is divided by the share of the noise that is left in it.

use glam::{DMat3, DVec3};

use crate::numeric::symmetric_eigen;

/// Degrees of freedom of Student's t.
pub(super) const STUDENT: f64 = 4.0;

/// Variance of the scale of that distribution over the variance of three normal numbers to which it is fitted: the
/// solution of `E[7 x / (4 k + x)] = 3`, `x` of the chi-square distribution with 3 degrees of freedom.
const SCALE_OF_NORMAL: f64 = 0.755_889;

/// `a` in m at the start; the search never begins below `LEAST_START`, where it would not change the likelihood.
const START: f64 = 2e-3;
const LEAST_START: f64 = 2e-4;

/// Bounds of the logarithms of `a` in m and of `f`: `f` is at least a tenth, so that exact touches keep a noise.
const BOUNDS: [[f64; 2]; 2] = [[-16.1, 0.0], [-2.3, 9.2]];

/// The belief in the table: a standard deviation of 3 of the logarithm of `f`.
const BELIEF: f64 = 0.1;

/// Steps of the search in the logarithms, from the first to the last, halved where none helps.
const STEPS: [f64; 2] = [1.0, 0.03];

/// Likelihoods of more touches than this are sums over every second, third ... of them.
const MOST_TOUCHES: usize = 1000;

/// The noise of all touches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Noise {
    /// Standard deviation per axis of what no table states, in m.
    pub(super) own: f64,
    /// Standard deviations over the stated ones.
    pub(super) factor: f64,
}

/// The stated covariance of a touch, by its principal axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stated {
    axes: [DVec3; 3],
    /// In m^2; infinite where the touch says nothing.
    variances: [f64; 3],
}

impl Stated {
    pub(super) fn of_information(information: &DMat3) -> Self {
        let (values, vectors) = symmetric_eigen(&information.to_cols_array_2d());
        let axes = [0, 1, 2].map(|k| DVec3::from_array([0, 1, 2].map(|row| vectors[row][k])));
        let most = values.into_iter().fold(0.0, f64::max);
        // What rounding leaves of a direction without information.
        let variance = |value: f64| if value > 1e-12 * most { value.recip() } else { f64::INFINITY };
        Self { axes, variances: values.map(variance) }
    }

    pub(super) fn isotropic(sigma: f64) -> Self {
        Self { axes: DVec3::AXES, variances: [sigma * sigma; 3] }
    }

    /// The geometric mean of its standard deviations, in m, without infinite ones; `None` if all are.
    pub(super) fn sigma(&self) -> Option<f64> {
        typical(self.variances)
    }
}

fn typical(variances: [f64; 3]) -> Option<f64> {
    let finite: Vec<f64> = variances.into_iter().filter(|variance| variance.is_finite()).collect();
    let mean = finite.iter().map(|variance| libm::log(*variance)).sum::<f64>() / finite.len() as f64;
    (!finite.is_empty()).then(|| libm::exp(0.5 * mean))
}

impl Noise {
    /// Before anything is known.
    pub(super) const START: Self = Self { own: START, factor: 1.0 };

    fn variances(self, stated: &Stated) -> [f64; 3] {
        stated.variances.map(|variance| self.own * self.own + self.factor * self.factor * variance)
    }

    /// The information of a touch.
    pub(super) fn information(self, stated: &Stated) -> DMat3 {
        let terms = stated.axes.into_iter().zip(self.variances(stated));
        terms.fold(DMat3::ZERO, |sum, (axis, variance)| {
            sum + DMat3::from_cols(axis.x * axis, axis.y * axis, axis.z * axis) * variance.recip()
        })
    }

    /// The trace of the covariance of a touch, in m^2.
    pub(super) fn trace(self, stated: &Stated) -> f64 {
        self.variances(stated).into_iter().sum()
    }

    /// A standard deviation per axis of a touch, in m.
    pub(super) fn sigma(self, stated: &Stated) -> Option<f64> {
        typical(self.variances(stated))
    }

    /// The noise that makes errors with weights most likely, from this one on.
    pub(super) fn learned(self, errors: &[(DVec3, f64, Stated)]) -> Self {
        let stride = errors.len() / MOST_TOUCHES + 1;
        // Squared errors along the axes, variances, weight.
        let terms: Vec<([f64; 3], [f64; 3], f64)> = errors
            .iter()
            .step_by(stride)
            .map(|(error, weight, stated)| {
                (stated.axes.map(|axis| axis.dot(*error).powi(2)), stated.variances, *weight)
            })
            .collect();
        let cost = |at: [f64; 2]| {
            let [own, factor] = at.map(|log| libm::exp(2.0 * log));
            let one = |(squares, variances, weight): &([f64; 3], [f64; 3], f64)| {
                let (mut volume, mut chi2) = (1.0, 0.0);
                for (square, variance) in squares.iter().zip(variances).filter(|(_, v)| v.is_finite()) {
                    let variance = own + factor * variance;
                    volume *= variance;
                    chi2 += square / variance;
                }
                let tail = (STUDENT + 3.0) * (chi2 / (STUDENT * SCALE_OF_NORMAL)).ln_1p();
                0.5 * weight * (libm::log(volume) + tail)
            };
            terms.iter().map(one).sum::<f64>() + BELIEF * 0.5 * at[1] * at[1]
        };
        let mut at = [libm::log(self.own.max(LEAST_START)), libm::log(self.factor)];
        let (mut best, mut step) = (cost(at), STEPS[0]);
        while step >= STEPS[1] {
            let mut is_better = false;
            for (k, sign) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)] {
                let mut next = at;
                next[k] = (next[k] + sign * step).clamp(BOUNDS[k][0], BOUNDS[k][1]);
                let found = cost(next);
                if found < best {
                    (at, best, is_better) = (next, found, true);
                }
            }
            if !is_better {
                step *= 0.5;
            }
        }
        Self { own: libm::exp(at[0]), factor: libm::exp(at[1]) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::Random;

    fn stated(sigmas: [f64; 3]) -> Stated {
        let information = DMat3::from_diagonal(DVec3::from_array(sigmas.map(|sigma| sigma.powi(-2))));
        Stated::of_information(&information)
    }

    /// Normal errors three times as large as stated, a tenth of them wrong: the scale is that of the others. Stated as
    /// exact, the own noise takes its place.
    #[test]
    fn the_scale_of_the_noise_is_found() {
        let mut random = Random::new(5, 0);
        let uneven = [1e-3, 2e-3, 0.5e-3];
        for (sigmas, unit) in [(uneven, uneven), ([1e-6; 3], [1e-3; 3])] {
            let stated = stated(sigmas);
            let error = |k: usize| {
                let scale = if k.is_multiple_of(10) { 30.0 } else { 3.0 };
                (scale * random.vector(1.0) * DVec3::from_array(unit), 1.0, stated)
            };
            let errors: Vec<_> = (0..600).map(error).collect();
            let found = Noise::START.learned(&errors);
            let sigma = found.sigma(&stated).unwrap();
            assert!((sigma / 3e-3 - 1.0).abs() < 0.25, "{found:?}: {sigma} for 3e-3 m");
        }
    }

    #[test]
    fn a_direction_without_information_has_none() {
        let plane = stated([f64::INFINITY, 1e-3, f64::INFINITY]);
        let information = Noise { own: 0.0, factor: 2.0 }.information(&plane);
        assert_eq!(information.x_axis, DVec3::ZERO);
        assert!((information.y_axis.y - 2.5e5).abs() < 1e-3, "{information}");
    }
}
