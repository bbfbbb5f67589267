use crate::calib::chi_square::quantile;

/// How much an observation that does not fit may pull.
///
/// Kernels act on the whitened length of an error, so their bounds follow from its degrees of freedom: the same
/// share of good observations is affected in every model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Robust {
    /// Least squares: one wrong observation moves everything.
    #[default]
    None,
    /// Huber: the pull stops growing. Convex, but never lets go.
    Huber,
    /// Cauchy: the pull fades slowly.
    Cauchy,
    /// Tukey's biweight, started from Huber's solution: lets go completely.
    Tukey,
    /// Geman and McClure, started from Huber's solution: lets go quickly.
    GemanMcClure,
    /// Truncated least squares by graduated non-convexity (Yang, Antonante, Tzoumas and Carlone 2020): needs no good
    /// start. The one to choose against wrongly attributed contacts.
    Graduated,
}

impl Robust {
    /// `none`, `huber`, ...
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Huber => "huber",
            Self::Cauchy => "cauchy",
            Self::Tukey => "tukey",
            Self::GemanMcClure => "geman-mcclure",
            Self::Graduated => "gnc",
        }
    }
}

/// Share of good observations that Huber's and Cauchy's kernels leave as they are.
const UNTOUCHED: f64 = 0.95;

/// Share of good observations that truncated least squares keeps: three standard deviations of a normal variable.
/// With 0.99 the good ones that are lost cost 2 % of the accuracy at 5 % outliers.
const KEPT: f64 = 0.997;

/// Tukey's bound over Huber's: with 3 degrees of freedom it lets go at 6 standard deviations.
const TUKEY_OVER_HUBER: f64 = 2.147;

/// No weight falls below this: a taxel whose observations are all rejected keeps its place instead of making the
/// system singular.
pub(super) const SMALLEST_WEIGHT: f64 = 1e-8;

/// A kernel for errors of some degrees of freedom, with the squares of its bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Kernel {
    robust: Robust,
    bound2: f64,
}

impl Kernel {
    pub(super) fn new(robust: Robust, degrees: usize) -> Self {
        let degrees = degrees.max(1) as f64;
        let bound2 = match robust {
            Robust::None => f64::INFINITY,
            Robust::Huber | Robust::Cauchy | Robust::GemanMcClure => quantile(UNTOUCHED, degrees),
            Robust::Tukey => quantile(UNTOUCHED, degrees) * TUKEY_OVER_HUBER * TUKEY_OVER_HUBER,
            Robust::Graduated => quantile(KEPT, degrees),
        };
        Self { robust, bound2 }
    }

    /// The square of the length beyond which an observation counts as an outlier.
    pub(super) fn bound2(&self) -> f64 {
        self.bound2
    }

    /// What a squared error of `square` costs, twice: `square` itself under least squares.
    pub(super) fn cost(&self, square: f64) -> f64 {
        let c2 = self.bound2;
        match self.robust {
            Robust::None => square,
            Robust::Huber if square <= c2 => square,
            Robust::Huber => 2.0 * (c2 * square).sqrt() - c2,
            Robust::Cauchy => c2 * (square / c2).ln_1p(),
            Robust::Tukey if square >= c2 => c2 / 3.0,
            Robust::Tukey => c2 / 3.0 * (1.0 - (1.0 - square / c2).powi(3)),
            Robust::GemanMcClure => c2 * square / (c2 + square),
            Robust::Graduated => square.min(c2),
        }
    }

    /// Derivative of the cost with respect to `square`: the weight of the observation.
    pub(super) fn weight(&self, square: f64) -> f64 {
        let c2 = self.bound2;
        let weight = match self.robust {
            Robust::None => 1.0,
            Robust::Huber if square <= c2 => 1.0,
            Robust::Huber => (c2 / square).sqrt(),
            Robust::Cauchy => c2 / (c2 + square),
            Robust::Tukey => (1.0 - square / c2).max(0.0).powi(2),
            Robust::GemanMcClure => (c2 / (c2 + square)).powi(2),
            Robust::Graduated => f64::from(u8::from(square <= c2)),
        };
        weight.max(SMALLEST_WEIGHT)
    }

    /// Weight of truncated least squares at control `mu`: nearly convex for small `mu`, the truncation itself as it
    /// grows (equation 14 of the paper).
    pub(super) fn graduated_weight(&self, mu: f64, square: f64) -> f64 {
        let c2 = self.bound2;
        let weight = if square <= mu / (mu + 1.0) * c2 {
            1.0
        } else if square >= (mu + 1.0) / mu * c2 {
            0.0
        } else {
            (c2 * mu * (mu + 1.0) / square).sqrt() - mu
        };
        weight.max(SMALLEST_WEIGHT)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Robust; 6] =
        [Robust::None, Robust::Huber, Robust::Cauchy, Robust::Tukey, Robust::GemanMcClure, Robust::Graduated];

    #[test]
    fn weights_are_the_slopes_of_costs() {
        for robust in ALL {
            let kernel = Kernel::new(robust, 3);
            for square in [0.0, 0.1, 3.0, 7.0, 9.0, 20.0, 30.0, 50.0, 1e4] {
                let h = 1e-4 * (1.0 + square);
                let slope = (kernel.cost(square + h) - kernel.cost(square)) / h;
                let weight = kernel.weight(square + 0.5 * h);
                assert!((slope - weight).abs() < 1e-6, "{robust:?} at {square}: {slope} is not {weight}");
            }
        }
    }

    #[test]
    fn small_errors_count_as_in_least_squares() {
        for robust in ALL {
            let kernel = Kernel::new(robust, 6);
            assert!((kernel.weight(1e-12) - 1.0).abs() < 1e-9, "{robust:?}");
            assert!((kernel.cost(1e-6) - 1e-6).abs() < 1e-12, "{robust:?}");
        }
    }

    #[test]
    fn graduated_weights_end_in_truncation() {
        let kernel = Kernel::new(Robust::Graduated, 3);
        for square in [0.5 * kernel.bound2(), 2.0 * kernel.bound2()] {
            let late = kernel.graduated_weight(1e6, square);
            assert!((late - kernel.weight(square)).abs() < 1e-6, "{late} at {square}");
        }
    }
}
