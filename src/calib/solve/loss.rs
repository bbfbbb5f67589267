use crate::{
    calib::{
        ContactObservationId, DisplacementId,
        robust::length_prior::{LogOdds, stretch},
        solve::normal_equations::PerObservation,
    },
    id::IdVec,
    numeric::quantile,
};

/// How much an observation that does not fit may pull.
///
/// Kernels act on the whitened length of an error, so their bounds follow from its degrees of freedom: the same
/// share of good observations is affected in every model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Robust {
    /// Least squares; truncated least squares ([`Robust::Graduated`]) where those leave more than the stated noise explains
    /// or an observation stands out from the others, if what they let go stands out from the others of its kind at the scale
    /// of these, which may be larger than stated, and is less than half of them.
    #[default]
    Automatic,
    /// Least squares: one wrong observation moves everything.
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
            Self::Automatic => "auto",
            Self::None => "none",
            Self::Huber => "huber",
            Self::Cauchy => "cauchy",
            Self::Tukey => "tukey",
            Self::GemanMcClure => "geman-mcclure",
            Self::Graduated => "gnc",
        }
    }
}

/// Share of good observations within the bounds of Huber's, Cauchy's and Geman and McClure's kernels. Huber's leaves
/// them as they are.
const UNTOUCHED: f64 = 0.95;

/// Share of good observations that count as good: three standard deviations of a normal variable. Where truncated least
/// squares keeps 0.99, the good ones that are lost cost 2 % of the accuracy at 5 % outliers.
pub(crate) const KEPT: f64 = 0.997;

/// Tukey's bound over Huber's: with 3 degrees of freedom it lets go at 6 standard deviations.
const TUKEY_OVER_HUBER: f64 = 2.147;

/// No weight falls below this: a taxel whose observations are all rejected keeps its place instead of making the
/// system singular.
pub(crate) const SMALLEST_WEIGHT: f64 = 1e-8;

/// A kernel for errors of some degrees of freedom, with the squares of its bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Kernel {
    robust: Robust,
    bound2: f64,
    outlier2: f64,
}

impl Kernel {
    /// The kernel of an observation of `rank` numbers; nothing observed has no error, and any bound does.
    pub(crate) fn new(robust: Robust, rank: usize) -> Self {
        let degrees = rank.max(1) as f64;
        let bound2 = match robust {
            Robust::Automatic | Robust::None => f64::INFINITY,
            Robust::Huber | Robust::Cauchy | Robust::GemanMcClure => quantile(UNTOUCHED, degrees),
            Robust::Tukey => quantile(UNTOUCHED, degrees) * TUKEY_OVER_HUBER * TUKEY_OVER_HUBER,
            Robust::Graduated => quantile(KEPT, degrees),
        };
        let outlier2 = if bound2.is_finite() { quantile(KEPT, degrees) } else { f64::INFINITY };
        Self { robust, bound2, outlier2 }
    }

    /// Whether noise explains a squared error.
    pub(crate) fn keeps(&self, square: f64) -> bool {
        square <= self.outlier2
    }

    /// The kernel whose bounds are those of this one, squared, times `factor`.
    fn stretched(self, factor: f64) -> Self {
        Self { bound2: self.bound2 * factor, outlier2: self.outlier2 * factor, ..self }
    }

    /// What a squared error of `square` costs, twice: `square` itself under least squares.
    pub(crate) fn cost(&self, square: f64) -> f64 {
        let c2 = self.bound2;
        match self.robust {
            Robust::Automatic | Robust::None => square,
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
    pub(crate) fn weight(&self, square: f64) -> f64 {
        let c2 = self.bound2;
        let weight = match self.robust {
            Robust::Automatic | Robust::None => 1.0,
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
    pub(crate) fn graduated_weight(&self, mu: f64, square: f64) -> f64 {
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

/// A scale up to this is no sign of noise that is understated: the median doubles where 40 % are wrong.
const AS_STATED: f64 = 2.5;

/// How much larger squared errors are than the stated noise lets expect: 1 where it is right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scale {
    pub(crate) edges: f64,
    pub(crate) contacts: f64,
}

impl Scale {
    /// Whether the stated noise is right as far as a median can tell.
    pub(crate) fn is_as_stated(self) -> bool {
        self.is_as_stated_of_edges() && self.contacts <= AS_STATED
    }

    pub(crate) fn is_as_stated_of_edges(self) -> bool {
        self.edges <= AS_STATED
    }

    pub(crate) fn most(self, other: Self) -> Self {
        Self { edges: self.edges.max(other.edges), contacts: self.contacts.max(other.contacts) }
    }
}

/// The kernel of every observation.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Kernels {
    pub(crate) robust: Robust,
    pub(crate) edges: IdVec<DisplacementId, Kernel>,
    pub(crate) contacts: IdVec<ContactObservationId, Kernel>,
}

impl Kernels {
    /// Kernels whose bounds follow from how many numbers each observation observes.
    pub(crate) fn new(ranks: &PerObservation<usize>, robust: Robust) -> Self {
        // Quantiles take long, and there are few ranks.
        let most = ranks.iter().max().unwrap_or(0);
        let of_rank: Vec<Kernel> = (0..=most).map(|rank| Kernel::new(robust, rank)).collect();
        let kernel = |&rank: &usize| of_rank[rank];
        Self { robust, edges: ranks.edges.map(kernel), contacts: ranks.contacts.map(kernel) }
    }

    /// The same for edges that are attributed right with these `odds`.
    pub(crate) fn with_odds(&self, odds: &LogOdds) -> Self {
        let mut this = self.clone();
        for (kernel, &odds) in this.edges.iter_mut().zip(odds) {
            *kernel = kernel.stretched(stretch(odds, kernel.outlier2));
        }
        this
    }

    /// The same for errors whose squares are larger by `scale`.
    pub(crate) fn scaled(&self, scale: Scale) -> Self {
        Self {
            edges: self.edges.map(|k| k.stretched(scale.edges)),
            contacts: self.contacts.map(|k| k.stretched(scale.contacts)),
            ..*self
        }
    }

    pub(crate) fn costs(&self, squares: &PerObservation) -> PerObservation {
        self.each(squares, Kernel::cost)
    }

    pub(crate) fn weights(&self, squares: &PerObservation) -> PerObservation {
        self.each(squares, Kernel::weight)
    }

    /// Which observations noise explains.
    pub(crate) fn keep(&self, squares: &PerObservation) -> PerObservation<bool> {
        self.each(squares, Kernel::keeps)
    }

    /// The squares up to which it does.
    pub(crate) fn bounds(&self) -> PerObservation {
        PerObservation { edges: self.edges.map(|k| k.outlier2), contacts: self.contacts.map(|k| k.outlier2) }
    }

    /// [`Kernel::graduated_weight`] of every observation.
    pub(crate) fn graduated_weights(&self, mu: f64, squares: &PerObservation) -> PerObservation {
        self.each(squares, |kernel, square| kernel.graduated_weight(mu, square))
    }

    /// The largest square over its bound.
    pub(crate) fn worst(&self, squares: &PerObservation) -> f64 {
        self.each(squares, |kernel, square| square / kernel.bound2).iter().fold(0.0, f64::max)
    }

    fn each<T>(&self, squares: &PerObservation, f: impl Fn(&Kernel, f64) -> T) -> PerObservation<T> {
        PerObservation {
            edges: self.edges.iter().zip(&squares.edges).map(|(k, &s)| f(k, s)).collect(),
            contacts: self.contacts.iter().zip(&squares.contacts).map(|(k, &s)| f(k, s)).collect(),
        }
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
        for square in [0.5 * kernel.bound2, 2.0 * kernel.bound2] {
            let late = kernel.graduated_weight(1e6, square);
            assert!((late - kernel.weight(square)).abs() < 1e-6, "{late} at {square}");
        }
    }
}
