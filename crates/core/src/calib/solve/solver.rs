//! Calibration as a problem of [`least_squares`]: weights that are fixed or follow from a loss function or from the schedule
//! of graduated non-convexity ([`Weighting`]), and the log of all steps.
//!
//! It does not detect outliers. It finds a local minimum, which depends on the start.

use crate::calib::{
    BlockLayout, CalibError, CalibOptions, FreeBody, PerObservation, Poses, Problem, Weighting, free_under,
};
use crate::least_squares::{self, Descent, NormalEquations, Options, Schedule, Step, Termination, minimise};
use crate::run::Run;

/// One step of the optimisation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Iteration {
    /// Cost after the step: half of the weighted sum of squares, or of the sum of losses.
    pub cost: f64,
    /// Largest change of an unknown, in m or rad.
    pub step: f64,
    /// The damping that shortened the step, over the diagonal of the system (Levenberg and
    /// Marquardt); 0 for a Gauss-Newton step.
    pub damping: f64,
    /// The control of the graduated loss, which approaches the truncated loss as it grows; `None`
    /// for other losses.
    pub graduation: Option<f64>,
}

/// Growth of the control of graduated non-convexity from step to step. The 1.4 of `(yang2020)` takes
/// three times as many steps to the same accuracy, at 5, 20 and 30 % outliers.
const GRADUATION: f64 = 2.0;

/// Control at which the graduated loss and the truncated one differ for one observation in thirty.
const LAST_CONTROL: f64 = 30.0;

/// A decrease below this, over the number of observations, counts as zero: it is far below the rounding of the
/// sums.
const EXACT_FIT: f64 = 1e-20;

/// Poses with their squared residuals and cost.
#[derive(Debug, Clone)]
pub(crate) struct Iterate {
    pub(crate) poses: Poses,
    pub(crate) chi2: PerObservation,
    pub(crate) cost: f64,
}

impl Iterate {
    fn new(problem: &Problem<'_>, weighting: &Weighting<'_>, poses: Poses) -> Self {
        let chi2 = problem.chi2(&poses);
        let cost = weighting.cost(&chi2);
        Self { poses, chi2, cost }
    }
}

/// The normal equations with their gauge fixed.
pub(crate) fn normal_equations<'p>(
    problem: &'p Problem<'_>,
    free: &[FreeBody],
    poses: &Poses,
    weights: &PerObservation,
) -> NormalEquations<'p> {
    let (mut matrix, gradient) = problem.linearise(poses, weights);
    for body in free {
        body.fix_gauge(problem, poses, &mut matrix);
    }
    NormalEquations { matrix, gradient, columns: problem.layout.columns() }
}

/// The optimiser for one problem, with the log of its iterations.
pub(crate) struct Solver<'s> {
    pub(crate) problem: &'s Problem<'s>,
    pub(crate) options: &'s CalibOptions,
    pub(crate) run: Run<'s>,
    pub(crate) iterations: Vec<Iteration>,
}

impl Solver<'_> {
    /// Minimises from `start`. Returns the best iterate and the reason for the end.
    pub(crate) fn minimise(
        &mut self,
        weighting: Weighting<'_>,
        start: Poses,
    ) -> Result<(Iterate, Termination), CalibError> {
        let problem = self.problem;
        let limits = self.options.limits;
        let exact = EXACT_FIT * problem.dimensions.iter().count() as f64;
        let limits = Options { absolute_decrease: limits.absolute_decrease + exact, ..limits };
        let start = Iterate::new(problem, &weighting, start);
        minimise(&mut Weighted { problem, weighting, log: &mut self.iterations }, start, &limits, self.run)
    }
}

/// A problem with the weights of its observations.
struct Weighted<'w> {
    problem: &'w Problem<'w>,
    weighting: Weighting<'w>,
    log: &'w mut Vec<Iteration>,
}

impl<'w> least_squares::Problem for Weighted<'w> {
    type Point = Iterate;
    type Linear = NormalEquations<'w>;
    type Error = CalibError;

    fn unknowns(&self) -> usize {
        self.problem.moving() * self.problem.layout.unknowns()
    }

    fn descent(&self) -> Descent {
        match self.weighting {
            Weighting::Graduated { .. } => Descent::Free,
            Weighting::Loss(_) => Descent::Doubled,
            Weighting::Fixed(_) if self.problem.layout != BlockLayout::Pose => Descent::Linear,
            Weighting::Fixed(_) => Descent::Lower,
        }
    }

    fn cost(&self, at: &Iterate) -> f64 {
        at.cost
    }

    fn linearise(&self, at: &Iterate) -> Result<NormalEquations<'w>, CalibError> {
        let weights = self.weighting.weights(&at.chi2);
        let free = free_under(self.problem, &at.poses, &weights);
        Ok(normal_equations(self.problem, &free, &at.poses, &weights))
    }

    /// Damping hides a taxel that is not determined: without it, such a taxel is an error.
    fn solve(
        &self,
        _at: &Iterate,
        linear: &NormalEquations<'w>,
        damping: f64,
    ) -> Result<Option<Vec<f64>>, CalibError> {
        match linear.step(damping) {
            Err(error) if damping == 0.0 => Err(self.problem.explain(error)),
            step => Ok(step.ok()),
        }
    }

    fn predicted_decrease(&self, linear: &NormalEquations<'w>, step: &[f64], damping: f64) -> f64 {
        linear.predicted_decrease(step, damping)
    }

    fn moved(&self, at: &Iterate, _linear: &NormalEquations<'w>, step: &[f64]) -> Iterate {
        Iterate::new(self.problem, &self.weighting, self.problem.advanced(&at.poses, step))
    }

    fn after_step(
        &mut self,
        _at: &mut Iterate,
        _linear: NormalEquations<'w>,
        step: &Step,
    ) -> Result<Schedule, CalibError> {
        let &Step { cost, size, damping, .. } = step;
        let (graduation, schedule) = match &mut self.weighting {
            Weighting::Graduated { mu, .. } => {
                let now = *mu;
                *mu *= GRADUATION;
                (Some(now), if *mu > LAST_CONTROL { Schedule::Ended } else { Schedule::Open })
            }
            Weighting::Fixed(_) | Weighting::Loss(_) => (None, Schedule::Settled),
        };
        self.log.push(Iteration { cost, step: size, damping, graduation });
        Ok(schedule)
    }
}
