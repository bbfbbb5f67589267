//! Loss functions of squared residuals, by formula: `(huber1964)`, Cauchy's, Tukey's biweight `(beaton1974)`, the truncated
//! square, and its graduated form `(yang2020)`.

use crate::numeric::quantile;

/// A loss `rho(s)` of the squared whitened residual `s`, with the square `c2` at which it departs from the square or
/// becomes constant. Iteratively reweighted least squares minimises its sum with the weights `rho'(s)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LossFunction {
    /// `rho = s`.
    Squared,
    /// `s <= c2`: `rho = s`; beyond: `rho = 2 sqrt(c2 s) - c2`. Convex; outliers keep a bounded influence.
    Huber {
        /// The squared bound.
        c2: f64,
    },
    /// `rho = c2 ln(1 + s / c2)`. The influence of outliers falls with their distance.
    Cauchy {
        /// The squared scale.
        c2: f64,
    },
    /// `s <= c2`: `rho = c2/3 (1 - (1 - s/c2)^3)`; beyond: `c2/3`. Outliers have no influence.
    Tukey {
        /// The squared bound.
        c2: f64,
    },
    /// `rho = min(s, c2)`.
    Truncated {
        /// The squared bound.
        c2: f64,
    },
    /// The truncated loss, nearly convex for small `mu` and itself as `mu` grows (equation 14 of `(yang2020)`):
    /// `s <= mu/(mu+1) c2`: `rho = s`; `s >= (mu+1)/mu c2`: `rho = c2`; between: `rho = 2 sqrt(c2 mu (mu+1) s) - mu (c2 + s)`.
    Graduated {
        /// The squared bound.
        c2: f64,
        /// The control, above 0.
        mu: f64,
    },
}

/// Share of normal residuals below the bound of Huber's loss, which does not change their weight.
const HUBER_SHARE: f64 = 0.95;

/// Share of normal residuals below the outlier bound: three standard deviations of a normal variable. With 0.99 the
/// lost inliers cost 2 % of the accuracy at 5 % outliers.
pub(crate) const INLIER_SHARE: f64 = 0.997;

/// Tukey's bound over Huber's: with 3 degrees of freedom, weights vanish at 6 standard deviations.
const TUKEY_OVER_HUBER: f64 = 2.147;

/// No weight falls below this: an unknown whose observations are all rejected stays where it is instead of making the
/// system singular.
pub(crate) const SMALLEST_WEIGHT: f64 = 1e-8;

impl LossFunction {
    /// Huber's loss of residuals of as many numbers: the same share of inliers is affected in every model.
    pub(crate) fn huber(degrees: usize) -> Self {
        Self::Huber { c2: quantile(HUBER_SHARE, degrees.max(1) as f64) }
    }

    /// Tukey's loss of residuals of as many numbers.
    pub(crate) fn tukey(degrees: usize) -> Self {
        Self::Tukey { c2: quantile(HUBER_SHARE, degrees.max(1) as f64) * TUKEY_OVER_HUBER * TUKEY_OVER_HUBER }
    }

    /// The truncated loss of residuals of as many numbers.
    pub(crate) fn truncated(degrees: usize) -> Self {
        Self::Truncated { c2: inlier_bound2(degrees) }
    }

    /// `rho(s)`, `rho'(s)` and `rho''(s)`.
    #[inline]
    pub fn derivatives(self, s: f64) -> [f64; 3] {
        match self {
            Self::Huber { c2 } if s > c2 => {
                let slope = (c2 / s).sqrt();
                [2.0 * (c2 * s).sqrt() - c2, slope, -0.5 * slope / s]
            }
            Self::Squared | Self::Huber { .. } => [s, 1.0, 0.0],
            Self::Cauchy { c2 } => {
                let slope = c2 / (c2 + s);
                [c2 * (s / c2).ln_1p(), slope, -slope * slope / c2]
            }
            Self::Tukey { c2 } if s < c2 => {
                let rest = 1.0 - s / c2;
                [c2 / 3.0 * (1.0 - rest.powi(3)), rest * rest, -2.0 * rest / c2]
            }
            Self::Tukey { c2 } => [c2 / 3.0, 0.0, 0.0],
            Self::Truncated { c2 } if s <= c2 => [s, 1.0, 0.0],
            Self::Truncated { c2 } => [c2, 0.0, 0.0],
            Self::Graduated { c2, mu } => {
                if s <= mu / (mu + 1.0) * c2 {
                    [s, 1.0, 0.0]
                } else if s >= (mu + 1.0) / mu * c2 {
                    [c2, 0.0, 0.0]
                } else {
                    let root = (c2 * mu * (mu + 1.0) / s).sqrt();
                    [2.0 * root * s - mu * (c2 + s), root - mu, -0.5 * root / s]
                }
            }
        }
    }

    /// `rho(s)`.
    #[inline]
    pub(crate) fn cost(self, s: f64) -> f64 {
        self.derivatives(s)[0]
    }

    /// The weight `rho'(s)`, at least [`SMALLEST_WEIGHT`].
    #[inline]
    pub(crate) fn weight(self, s: f64) -> f64 {
        self.derivatives(s)[1].max(SMALLEST_WEIGHT)
    }

    /// The square at which it departs from the square or becomes constant.
    pub(crate) fn bound2(self) -> f64 {
        match self {
            Self::Squared => f64::INFINITY,
            Self::Huber { c2 } | Self::Cauchy { c2 } | Self::Tukey { c2 } => c2,
            Self::Truncated { c2 } | Self::Graduated { c2, .. } => c2,
        }
    }

    /// The loss with a squared bound that is larger by `factor`.
    pub(crate) fn scaled(mut self, factor: f64) -> Self {
        match &mut self {
            Self::Squared => {}
            Self::Huber { c2 } | Self::Cauchy { c2 } | Self::Tukey { c2 } => *c2 *= factor,
            Self::Truncated { c2 } | Self::Graduated { c2, .. } => *c2 *= factor,
        }
        self
    }
}

/// The square above which a residual of as many numbers is an outlier.
pub(crate) fn inlier_bound2(degrees: usize) -> f64 {
    quantile(INLIER_SHARE, degrees.max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    const C2: f64 = 7.8;
    const ALL: [LossFunction; 7] = [
        LossFunction::Squared,
        LossFunction::Huber { c2: C2 },
        LossFunction::Cauchy { c2: C2 },
        LossFunction::Tukey { c2: C2 },
        LossFunction::Truncated { c2: C2 },
        LossFunction::Graduated { c2: C2, mu: 0.3 },
        LossFunction::Graduated { c2: C2, mu: 20.0 },
    ];

    /// At 0 and on both sides of every bound.
    #[test]
    fn derivatives_are_those_of_the_formulas() {
        for loss in ALL {
            assert_eq!(loss.derivatives(0.0)[..2], [0.0, 1.0], "{loss:?}: least squares near 0");
            for s in [0.1, 1.5, 2.5, 7.0, 7.79, 7.81, 9.0, 20.0, 30.0, 50.0, 1e4] {
                let h = 1e-5 * s;
                let [_, slope, bend] = loss.derivatives(s);
                let [above, below] = [s + h, s - h].map(|s| loss.derivatives(s));
                for (k, found) in [(0, slope), (1, bend)] {
                    let expected = (above[k] - below[k]) / (2.0 * h);
                    assert!((found - expected).abs() < 1e-6, "{loss:?} at {s}: {found} is not {expected}");
                }
            }
        }
    }

    #[test]
    fn graduated_losses_end_in_truncation() {
        let truncated = LossFunction::truncated(3);
        let late = LossFunction::Graduated { c2: truncated.bound2(), mu: 1e6 };
        for s in [0.5 * truncated.bound2(), 2.0 * truncated.bound2()] {
            for k in 0..2 {
                let [found, expected] = [late, truncated].map(|loss| loss.derivatives(s)[k]);
                assert!((found - expected).abs() < 1e-5, "{found} at {s}");
            }
        }
    }
}
