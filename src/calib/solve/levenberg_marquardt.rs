//! The optimiser: Gauss-Newton steps, with Levenberg-Marquardt damping when one fails to lower the cost
//! `(nielsen1999)`, on weights that are fixed or follow from a loss function or from the schedule of graduated
//! non-convexity ([`Weighting`]).
//!
//! It does not detect outliers. It finds a local minimum, which depends on the start.

use std::fmt;

use crate::calib::{
    BlockLayout, CalibError, CalibOptions, FreeBody, PerObservation, Poses, Problem, Weighting, free_under,
};
use crate::run::Run;
use crate::sparse::{BlockMatrix, SparseError};

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

/// Why the optimisation ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Termination {
    /// The cost no longer falls.
    Converged,
    /// Nothing moves: every taxel is fixed.
    NothingToSolve,
    /// All iterations were used.
    OutOfIterations,
    /// No step lowers the cost although the gradient does not vanish.
    Stuck,
    /// The cost is not a finite number: squares of disagreements overflow.
    Overflow,
}

impl Termination {
    /// Whether the result is a minimum.
    pub const fn is_converged(self) -> bool {
        matches!(self, Self::Converged | Self::NothingToSolve)
    }
}

impl fmt::Display for Termination {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Converged => "converged",
            Self::NothingToSolve => "nothing to solve: every taxel is fixed",
            Self::OutOfIterations => "not converged: out of iterations",
            Self::Stuck => "not converged: no step lowers the cost",
            Self::Overflow => "not converged: the cost is not a finite number",
        })
    }
}

/// First damping after a failed undamped step, over the diagonal: long chains of taxels are so flexible that
/// more would stop them from moving.
const FIRST_DAMPING: f64 = 1e-9;

/// Growth of the damping at the first failure; it doubles at every further one.
const FIRST_GROWTH: f64 = 4.0;

/// Damping beyond which a step is too short to matter.
const LARGEST_DAMPING: f64 = 1e12;

/// Relative rounding error of a sum of squares: a step that raises the cost by less has not failed.
const COST_ROUNDING: f64 = 1e-13;

/// Growth of the control of graduated non-convexity from step to step. The 1.4 of `(yang2020)` takes
/// three times as many steps to the same accuracy, at 5, 20 and 30 % outliers.
const GRADUATION: f64 = 2.0;

/// Control at which the graduated loss and the truncated one differ for one observation in thirty.
const LAST_CONTROL: f64 = 30.0;

/// A cost below this, over the number of observations, counts as zero: it is far below the rounding of the
/// sums.
const EXACT_FIT: f64 = 1e-20;

/// Ratio of two decreases below which the next one is predicted instead of computed, which would
/// cost a factorization: a quarter of the time of most graphs.
const PREDICTED_RATIO: f64 = 0.1;

/// Smallest assumed ratio: near a minimum with residuals, Gauss-Newton converges linearly.
const SMALLEST_RATIO: f64 = 1e-3;

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
pub(crate) struct LinearSystem<'p> {
    pub(crate) matrix: BlockMatrix<'p>,
    pub(crate) gradient: Vec<f64>,
    columns: usize,
}

impl<'p> LinearSystem<'p> {
    pub(crate) fn new(
        problem: &'p Problem<'_>,
        free: &[FreeBody],
        poses: &Poses,
        weights: &PerObservation,
    ) -> Self {
        let (mut matrix, gradient) = problem.linearise(poses, weights);
        for body in free {
            body.fix_gauge(problem, poses, &mut matrix);
        }
        Self { matrix, gradient, columns: problem.layout.columns() }
    }

    /// The step to the minimum of the quadratic, with `damping` times the diagonal added.
    fn newton_step(&self, damping: f64) -> Result<Vec<f64>, SparseError> {
        let factor = if damping > 0.0 {
            let mut damped = self.matrix.clone();
            let more: Vec<f64> = self.matrix.diagonal().iter().map(|d| damping * d).collect();
            damped.add_diagonal(&more);
            damped.factor()?
        } else {
            self.matrix.factor()?
        };
        let mut step: Vec<f64> = self.gradient.iter().map(|g| -g).collect();
        factor.solve(&mut step, self.columns)?;
        Ok(step)
    }

    /// How much the quadratic falls by the minimising `step` under `damping`.
    fn predicted_decrease(&self, step: &[f64], damping: f64) -> f64 {
        let diagonal = if damping > 0.0 { self.matrix.diagonal() } else { vec![0.0] };
        let damped: f64 = step.iter().zip(diagonal.iter().cycle()).map(|(x, d)| damping * d * x * x).sum();
        let slope: f64 = step.iter().zip(&self.gradient).map(|(x, g)| x * g).sum();
        0.5 * (damped - slope)
    }
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
        mut weighting: Weighting<'_>,
        start: Poses,
    ) -> Result<(Iterate, Termination), CalibError> {
        let problem = self.problem;
        let mut iterate = Iterate::new(problem, &weighting, start);
        if problem.moving() == 0 {
            return Ok((iterate, Termination::NothingToSolve));
        }
        if !iterate.cost.is_finite() {
            return Ok((iterate, Termination::Overflow));
        }
        let mut control = StepControl { damping: 0.0, growth: FIRST_GROWTH };
        let mut convergence = Convergence::new(problem);
        for _ in 0..self.options.max_iterations {
            self.run.check()?;
            let weights = weighting.weights(&iterate.chi2);
            let free = free_under(problem, &iterate.poses, &weights);
            let system = LinearSystem::new(problem, &free, &iterate.poses, &weights);
            let Some((next, iteration)) = control.advance(problem, &weighting, &system, &iterate)? else {
                // At a minimum rounding alone can prevent every step from lowering the cost.
                let step = system.newton_step(0.0).map_err(|e| problem.explain(e))?;
                let is_minimum = convergence.is_small(system.predicted_decrease(&step, 0.0), iterate.cost);
                let end = if is_minimum { Termination::Converged } else { Termination::Stuck };
                return Ok((iterate, end));
            };
            let decrease = iterate.cost - next.cost;
            iterate = next;
            self.iterations.push(iteration);
            if !iterate.cost.is_finite() {
                return Ok((iterate, Termination::Overflow));
            }
            let is_converged = match &mut weighting {
                Weighting::Graduated { mu, .. } => {
                    *mu *= GRADUATION;
                    *mu > LAST_CONTROL
                }
                Weighting::Fixed(_) if iteration.damping == 0.0 => {
                    convergence.is_reached_by_newton(decrease, iterate.cost)
                }
                Weighting::Fixed(_) | Weighting::Loss(_) => convergence.is_reached(decrease, iterate.cost),
            };
            if is_converged {
                return Ok((iterate, Termination::Converged));
            }
        }
        Ok((iterate, Termination::OutOfIterations))
    }
}

/// The state between steps.
struct StepControl {
    damping: f64,
    growth: f64,
}

impl StepControl {
    /// One accepted step; `None` if there is none.
    fn advance(
        &mut self,
        problem: &Problem<'_>,
        weighting: &Weighting<'_>,
        system: &LinearSystem<'_>,
        from: &Iterate,
    ) -> Result<Option<(Iterate, Iteration)>, CalibError> {
        let graduation = match weighting {
            Weighting::Graduated { mu, .. } => Some(*mu),
            Weighting::Fixed(_) | Weighting::Loss(_) => None,
        };
        let attempt = |step: &[f64], damping: f64| {
            let next = Iterate::new(problem, weighting, problem.advanced(&from.poses, step));
            let step = step.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            let iteration = Iteration { cost: next.cost, step, damping, graduation };
            (next, iteration)
        };
        if graduation.is_some() {
            // The loss changes with every step, so decreases are not compared.
            let step = system.newton_step(0.0).map_err(|e| problem.explain(e))?;
            return Ok(Some(attempt(&step, 0.0)));
        }
        loop {
            let damping = self.damping;
            match system.newton_step(damping) {
                Ok(step) => {
                    let (next, iteration) = attempt(&step, damping);
                    if next.cost <= from.cost + COST_ROUNDING * from.cost {
                        let predicted = system.predicted_decrease(&step, self.damping);
                        self.relax((from.cost - next.cost) / predicted);
                        return Ok(Some(match weighting {
                            Weighting::Loss(_) => extrapolate((next, iteration), step, attempt),
                            Weighting::Fixed(_) | Weighting::Graduated { .. } => (next, iteration),
                        }));
                    }
                }
                // Damping would hide a taxel that is not determined.
                Err(e) if self.damping == 0.0 => return Err(problem.explain(e)),
                Err(_) => {}
            }
            self.damping = (self.growth * self.damping).max(FIRST_DAMPING);
            self.growth *= 2.0;
            if self.damping > LARGEST_DAMPING {
                return Ok(None);
            }
        }
    }

    /// Reduces the damping after a good step, the more the better the quadratic predicted it.
    fn relax(&mut self, quality: f64) {
        self.growth = FIRST_GROWTH;
        let factor = (1.0 - (2.0 * quality - 1.0).powi(3)).clamp(0.1, 2.0);
        self.damping *= if quality.is_finite() { factor } else { 1.0 };
        if self.damping < FIRST_DAMPING {
            self.damping = 0.0;
        }
    }
}

/// The cost has converged when a step lowers it by less than this share, or the next step is predicted to.
const RELATIVE_DECREASE: f64 = 1e-9;

/// Decides from the decreases of the cost whether it has converged.
struct Convergence {
    /// A decrease that is negligible for any cost.
    negligible: f64,
    /// Whether the squared residuals are quadratic: then one undamped step leads to their minimum.
    is_quadratic: bool,
    /// The decrease by the last step, if that was an undamped step on fixed weights.
    last: Option<f64>,
}

impl Convergence {
    fn new(problem: &Problem<'_>) -> Self {
        Self {
            negligible: EXACT_FIT * problem.dimensions.iter().count() as f64,
            is_quadratic: problem.layout != BlockLayout::Pose,
            last: None,
        }
    }

    /// Whether a `decrease` to `cost` is too small to continue.
    fn is_small(&self, decrease: f64, cost: f64) -> bool {
        decrease <= RELATIVE_DECREASE * cost
    }

    /// Whether it has converged after a step that was damped, or on changing weights.
    fn is_reached(&mut self, decrease: f64, cost: f64) -> bool {
        self.last = None;
        decrease <= RELATIVE_DECREASE * cost + self.negligible
    }

    /// Whether it has converged after an undamped step on fixed weights: the decreases of such steps fall by
    /// about the same ratio, except by chance after the first.
    fn is_reached_by_newton(&mut self, decrease: f64, cost: f64) -> bool {
        let ratio = self.last.map_or(1.0, |last| (decrease / last).max(SMALLEST_RATIO));
        let next = if ratio < PREDICTED_RATIO { decrease * ratio } else { decrease };
        let reached = self.is_quadratic || self.is_reached(next, cost);
        self.last = Some(decrease);
        reached
    }
}

/// Doubles `step` as long as that lowers the cost (*heuristic*).
///
/// Reweighting replaces a loss by a parabola above it, whose minimum is nearer than that of the loss: where
/// weights are small, so near that hundreds of steps would be needed.
fn extrapolate(
    mut best: (Iterate, Iteration),
    mut step: Vec<f64>,
    attempt: impl Fn(&[f64], f64) -> (Iterate, Iteration),
) -> (Iterate, Iteration) {
    loop {
        step.iter_mut().for_each(|x| *x *= 2.0);
        let next = attempt(&step, best.1.damping);
        // Also ends if the cost is NaN.
        if next.0.cost < best.0.cost {
            best = next;
        } else {
            return best;
        }
    }
}
