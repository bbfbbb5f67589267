//! When a sequence of costs has converged: when the last decrease, or the predicted next one, is
//! small.

use crate::calib::{BlockLayout, Problem};

/// A cost this far below what rounding of the sums can resolve counts as zero, over the number of
/// observations.
const EXACT_FIT: f64 = 1e-20;

/// Ratio of two decreases below which the next one is predicted instead of computed, which would
/// cost a factorization: a quarter of the time of most graphs.
const STEADY: f64 = 0.1;

/// No ratio is taken to be smaller: near a minimum with residuals, Gauss-Newton converges linearly.
const SMALLEST_RATIO: f64 = 1e-3;

/// Decides from the decreases of the cost whether it has converged.
pub(super) struct Convergence {
    relative_decrease: f64,
    /// A decrease that is too small for any cost.
    negligible: f64,
    /// Whether the squared residuals are quadratic: their minimum is where one undamped step leads.
    is_quadratic: bool,
    /// The decrease by the last step, if that was an undamped step on fixed weights.
    last: Option<f64>,
}

impl Convergence {
    pub(super) fn new(problem: &Problem<'_>, relative_decrease: f64) -> Self {
        Self {
            relative_decrease,
            negligible: EXACT_FIT * problem.dimensions.iter().count() as f64,
            is_quadratic: problem.layout != BlockLayout::Pose,
            last: None,
        }
    }

    /// Whether a `decrease` to `cost` is too small to go on.
    pub(super) fn is_small(&self, decrease: f64, cost: f64) -> bool {
        decrease <= self.relative_decrease * cost
    }

    /// After a step that was damped, or on weights that change.
    pub(super) fn is_reached(&mut self, decrease: f64, cost: f64) -> bool {
        self.last = None;
        decrease <= self.relative_decrease * cost + self.negligible
    }

    /// After an undamped step on fixed weights: such steps gain ever less, by the same ratio again
    /// if that is not the chance of a first step.
    pub(super) fn is_reached_by_newton(&mut self, decrease: f64, cost: f64) -> bool {
        let ratio = self.last.map_or(1.0, |last| (decrease / last).max(SMALLEST_RATIO));
        let next = if ratio < STEADY { decrease * ratio } else { decrease };
        let reached = self.is_quadratic || self.is_reached(next, cost);
        self.last = Some(decrease);
        reached
    }
}
