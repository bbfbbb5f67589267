//! Least squares: one minimiser for all damped Gauss-Newton loops, losses by formula, components of variance and
//! covariances.
//!
//! A problem has points, a cost and normal equations; `minimise` goes from point to point:
//!
//! ```text
//! linearise -- solve (damped where needed) -- moved -- accept or damp more -- after_step -- ended?
//! ```
//!
//! Steps are those of Gauss and Newton. `Descent` says which are accepted: with a fixed cost those that lower it, damped as
//! Levenberg and Marquardt do where a step fails `(nielsen1999)`; with a cost that changes from step to step all. Each
//! reason to end is a function, whose limit is in [`Options`]: `cost_overflows`, `step_is_small`,
//! `decrease_is_negligible`, `next_decrease_is_negligible`, `no_step_descends`. The problem itself may end it, or
//! keep it from ending (`Schedule`).
//!
//! Rows may eliminate unknowns of their own: a problem linearises what is left, and moves its own unknowns in `moved`.
//!
//! Guaranteed: a point that is returned has the lowest cost of those seen, where the cost is fixed. Not guaranteed: the
//! global minimum.

mod loss;
mod normal_equations;
mod variance;

pub use loss::LossFunction;
pub(crate) use loss::{INLIER_SHARE, SMALLEST_WEIGHT, inlier_bound2};
pub(crate) use normal_equations::{InverseColumns, NormalEquations};
pub(crate) use variance::share_left;

use crate::run::{Cancelled, Run};

/// Limits of the minimiser. The defaults are those of [`calibrate`](crate::calib::calibrate()).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Most steps of one minimisation. Default 100.
    pub max_iterations: usize,
    /// Ends after a step of at most this size, in the problem's unit (poses: the largest number, in m or rad). Default 0:
    /// never.
    pub small_step: f64,
    /// Ends when a step lowers the cost by at most this share of it, or the next one is predicted to. Default 1e-9.
    pub relative_decrease: f64,
    /// Ends when a step lowers the cost by at most this much, in the unit of the cost. Default 0; pose graphs add 1e-20 for
    /// each observation, far below the rounding of the sums.
    pub absolute_decrease: f64,
    /// First damping after a failed undamped step, over the diagonal of the normal equations. Default 1e-9: long chains of
    /// taxels are so flexible that more stops them from moving.
    pub first_damping: f64,
    /// Growth of the damping at the first failure; it doubles at every further one. Default 4 `(nielsen1999)`.
    pub damping_growth: f64,
    /// Damping beyond which a step is too short to matter. Default 1e12.
    pub largest_damping: f64,
    /// A step that raises the cost by less than this share has not failed. Default 1e-13: the rounding of a sum of squares.
    pub cost_rounding: f64,
    /// Two decreases in this ratio or a lower one predict the next instead of a further step, which costs a factorization: a
    /// quarter of the time of most pose graphs. Default 0.1.
    pub predicted_ratio: f64,
    /// Smallest ratio that is assumed of the next two decreases: near a minimum with residuals Gauss-Newton converges
    /// linearly. Default 1e-3.
    pub smallest_ratio: f64,
}

impl Options {
    /// The defaults.
    pub const DEFAULT: Self = Self {
        max_iterations: 100,
        small_step: 0.0,
        relative_decrease: 1e-9,
        absolute_decrease: 0.0,
        first_damping: 1e-9,
        damping_growth: 4.0,
        largest_damping: 1e12,
        cost_rounding: 1e-13,
        predicted_ratio: 0.1,
        smallest_ratio: 1e-3,
    };
}

impl Default for Options {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Why a minimisation ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::Display)]
pub enum Termination {
    /// The cost no longer falls, or steps are small.
    #[strum(to_string = "converged")]
    Converged,
    /// Nothing moves: every taxel is fixed.
    #[strum(to_string = "nothing to solve: every taxel is fixed")]
    NothingToSolve,
    /// All iterations were used.
    #[strum(to_string = "not converged: out of iterations")]
    OutOfIterations,
    /// No step lowers the cost although the gradient does not vanish.
    #[strum(to_string = "not converged: no step lowers the cost")]
    Stuck,
    /// The cost is not a finite number: squares of disagreements overflow.
    #[strum(to_string = "not converged: the cost is not a finite number")]
    Overflow,
}

impl Termination {
    /// Whether the result is a minimum.
    pub const fn is_converged(self) -> bool {
        matches!(self, Self::Converged | Self::NothingToSolve)
    }
}

/// Which steps are accepted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Descent {
    /// Those that lower the cost.
    Lower,
    /// Those that lower the cost; residuals are linear and weights fixed, so that one undamped step leads to the minimum.
    Linear,
    /// Those that lower the cost, doubled as long as that lowers it further (*heuristic*). Weights that follow from a loss
    /// replace it by a parabola above it, whose minimum is nearer than that of the loss: where weights are small, so near
    /// that hundreds of steps are needed.
    Doubled,
    /// The cost changes with every step, so that costs are not compared: all steps.
    Free,
}

/// What a problem says after a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Schedule {
    /// Its weights or its noise still change: it cannot have converged.
    Open,
    /// It has converged if the step or the decrease was small.
    Settled,
    /// It has converged.
    Ended,
}

/// An accepted step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Step {
    /// Number of the step, from 1.
    pub(crate) number: usize,
    /// Cost after it.
    pub(crate) cost: f64,
    /// [`Problem::size`] of it.
    pub(crate) size: f64,
    /// Damping that shortened it; 0 for a Gauss-Newton step.
    pub(crate) damping: f64,
}

/// What [`minimise`] minimises.
pub(crate) trait Problem {
    /// Values of all unknowns, with what is evaluated there once.
    type Point;
    /// The normal equations at a point, with the current weights.
    type Linear;
    type Error: From<Cancelled>;

    /// Number of unknowns that move.
    fn unknowns(&self) -> usize;

    fn descent(&self) -> Descent;

    /// Half of the weighted sum of squares, or of the sum of losses.
    fn cost(&self, at: &Self::Point) -> f64;

    fn linearise(&self, at: &Self::Point) -> Result<Self::Linear, Self::Error>;

    /// The step to the minimum of the quadratic under `damping`; `None` asks for more damping.
    fn solve(
        &self,
        at: &Self::Point,
        linear: &Self::Linear,
        damping: f64,
    ) -> Result<Option<Vec<f64>>, Self::Error>;

    /// How much the quadratic falls by a step.
    fn predicted_decrease(&self, linear: &Self::Linear, step: &[f64], damping: f64) -> f64;

    /// The point after a step.
    fn moved(&self, at: &Self::Point, linear: &Self::Linear, step: &[f64]) -> Self::Point;

    /// The size of a step, for the end and for logs: its largest number.
    fn size(&self, _linear: &Self::Linear, step: &[f64]) -> f64 {
        step.iter().fold(0.0_f64, |most, x| most.max(x.abs()))
    }

    /// Learns from an accepted step, which led to `at` from where it was linearised: weights, noise, a log.
    fn after_step(
        &mut self,
        _at: &mut Self::Point,
        _linear: Self::Linear,
        _step: &Step,
    ) -> Result<Schedule, Self::Error> {
        Ok(Schedule::Settled)
    }
}

/// Minimises from `start`: the last point, and why it ended there.
pub(crate) fn minimise<P: Problem>(
    problem: &mut P,
    start: P::Point,
    options: &Options,
    run: Run<'_>,
) -> Result<(P::Point, Termination), P::Error> {
    let (mut cost, mut at) = (problem.cost(&start), start);
    if problem.unknowns() == 0 {
        return Ok((at, Termination::NothingToSolve));
    }
    if cost_overflows(cost) {
        return Ok((at, Termination::Overflow));
    }
    let mut control = Damping { now: 0.0, growth: options.damping_growth };
    let mut last_decrease = None;
    for number in 1..=options.max_iterations {
        run.step()?;
        let linear = problem.linearise(&at)?;
        let Some((next, mut step)) = control.advance(problem, &at, cost, &linear, options)? else {
            let is_minimum = no_step_descends(problem, &at, cost, &linear, options)?;
            return Ok((at, if is_minimum { Termination::Converged } else { Termination::Stuck }));
        };
        step.number = number;
        let decrease = cost - step.cost;
        (at, cost) = (next, step.cost);
        let schedule = problem.after_step(&mut at, linear, &step)?;
        if cost_overflows(cost) {
            return Ok((at, Termination::Overflow));
        }
        let has_converged = match problem.descent() {
            _ if schedule == Schedule::Ended => true,
            _ if schedule == Schedule::Open => false,
            _ if step_is_small(&step, options) => true,
            Descent::Free => false,
            Descent::Linear if step.damping == 0.0 => true,
            Descent::Lower if step.damping == 0.0 => {
                let last = last_decrease.replace(decrease);
                next_decrease_is_negligible(decrease, last, cost, options)
            }
            Descent::Lower | Descent::Linear | Descent::Doubled => {
                last_decrease = None;
                decrease_is_negligible(decrease, cost, options)
            }
        };
        if has_converged {
            return Ok((at, Termination::Converged));
        }
    }
    Ok((at, Termination::OutOfIterations))
}

/// Whether a cost is not a number that can be lowered.
fn cost_overflows(cost: f64) -> bool {
    !cost.is_finite()
}

/// Whether a step is too small to continue.
fn step_is_small(step: &Step, options: &Options) -> bool {
    step.size <= options.small_step
}

/// Whether a decrease to `cost` is too small to continue.
fn decrease_is_negligible(decrease: f64, cost: f64, options: &Options) -> bool {
    decrease <= options.relative_decrease * cost + options.absolute_decrease
}

/// Whether the decrease of the step after this one is too small: those of undamped steps on fixed weights fall by about the
/// same ratio, except by chance after the first.
fn next_decrease_is_negligible(decrease: f64, last: Option<f64>, cost: f64, options: &Options) -> bool {
    let ratio = last.map_or(1.0, |last| (decrease / last).max(options.smallest_ratio));
    let next = if ratio < options.predicted_ratio { decrease * ratio } else { decrease };
    decrease_is_negligible(next, cost, options)
}

/// Whether a point that no step improves is a minimum, where rounding alone prevents steps from lowering the cost.
fn no_step_descends<P: Problem>(
    problem: &P,
    at: &P::Point,
    cost: f64,
    linear: &P::Linear,
    options: &Options,
) -> Result<bool, P::Error> {
    let step = problem.solve(at, linear, 0.0)?;
    let predicted = step.map_or(f64::INFINITY, |step| problem.predicted_decrease(linear, &step, 0.0));
    Ok(predicted <= options.relative_decrease * cost)
}

/// The damping between steps.
struct Damping {
    now: f64,
    growth: f64,
}

impl Damping {
    /// One accepted step; `None` if there is none.
    fn advance<P: Problem>(
        &mut self,
        problem: &P,
        from: &P::Point,
        cost: f64,
        linear: &P::Linear,
        options: &Options,
    ) -> Result<Option<(P::Point, Step)>, P::Error> {
        let attempt = |step: &[f64], damping: f64| {
            let next = problem.moved(from, linear, step);
            let (cost, size) = (problem.cost(&next), problem.size(linear, step));
            (next, Step { number: 0, cost, size, damping })
        };
        let descent = problem.descent();
        loop {
            if let Some(step) = problem.solve(from, linear, self.now)? {
                let next = attempt(&step, self.now);
                if descent == Descent::Free {
                    *self = Self { now: 0.0, growth: options.damping_growth };
                    return Ok(Some(next));
                }
                if next.1.cost <= cost + options.cost_rounding * cost {
                    let predicted = problem.predicted_decrease(linear, &step, self.now);
                    self.relax((cost - next.1.cost) / predicted, options);
                    let is_doubled = descent == Descent::Doubled;
                    return Ok(Some(if is_doubled { extrapolate(next, step, attempt) } else { next }));
                }
            }
            self.now = (self.growth * self.now).max(options.first_damping);
            self.growth *= 2.0;
            // Not a number is no damping either.
            if !(options.first_damping > 0.0 && self.now <= options.largest_damping) {
                return Ok(None);
            }
        }
    }

    /// Reduces the damping after a good step, the more the better the quadratic predicted it.
    fn relax(&mut self, quality: f64, options: &Options) {
        self.growth = options.damping_growth;
        let factor = (1.0 - (2.0 * quality - 1.0).powi(3)).clamp(0.1, 2.0);
        self.now *= if quality.is_finite() { factor } else { 1.0 };
        if self.now < options.first_damping {
            self.now = 0.0;
        }
    }
}

/// Doubles `step` as long as that lowers the cost.
fn extrapolate<T>(
    mut best: (T, Step),
    mut step: Vec<f64>,
    attempt: impl Fn(&[f64], f64) -> (T, Step),
) -> (T, Step) {
    loop {
        step.iter_mut().for_each(|x| *x *= 2.0);
        let next = attempt(&step, best.1.damping);
        // Also ends if the cost is NaN.
        if next.1.cost < best.1.cost {
            best = next;
        } else {
            return best;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sparse::{BlockSystem, Pattern, SparseError};

    /// Why a test problem has no step.
    #[derive(Debug, thiserror::Error)]
    enum TestError {
        #[error(transparent)]
        Cancelled(#[from] Cancelled),
        #[error(transparent)]
        Sparse(#[from] SparseError),
    }

    /// A residual and its derivatives.
    type Row = (f64, [f64; 2]);

    /// Two unknowns, rows of unit variance under one loss.
    struct Rows<'p, F> {
        rows: F,
        loss: LossFunction,
        descent: Descent,
        system: &'p BlockSystem,
        steps: Vec<Step>,
    }

    fn one_block() -> BlockSystem {
        BlockSystem::new(Pattern::new(1, []), 2).unwrap()
    }

    impl<'p, F: Fn([f64; 2]) -> Vec<Row>> Rows<'p, F> {
        fn new(system: &'p BlockSystem, loss: LossFunction, descent: Descent, rows: F) -> Self {
            Self { rows, loss, descent, system, steps: Vec::new() }
        }

        fn solved(&mut self, start: [f64; 2], options: &Options) -> ([f64; 2], Termination) {
            minimise(self, start, options, Run::default()).unwrap()
        }
    }

    impl<'p, F: Fn([f64; 2]) -> Vec<Row>> Problem for Rows<'p, F> {
        type Point = [f64; 2];
        type Linear = NormalEquations<'p>;
        type Error = TestError;

        fn unknowns(&self) -> usize {
            2
        }

        fn descent(&self) -> Descent {
            self.descent
        }

        fn cost(&self, at: &[f64; 2]) -> f64 {
            0.5 * (self.rows)(*at).iter().map(|(e, _)| self.loss.cost(e * e)).sum::<f64>()
        }

        fn linearise(&self, at: &[f64; 2]) -> Result<NormalEquations<'p>, TestError> {
            let (mut matrix, mut gradient) = (self.system.zero(), vec![0.0; 2]);
            for (e, by) in (self.rows)(*at) {
                let weight = self.loss.weight(e * e);
                matrix.add(self.system.slot(0, 0).unwrap(), |a, b| weight * by[a] * by[b]);
                gradient.iter_mut().zip(by).for_each(|(sum, x)| *sum += weight * x * e);
            }
            Ok(NormalEquations { matrix, gradient, columns: 1 })
        }

        fn solve(
            &self,
            _at: &[f64; 2],
            linear: &NormalEquations<'p>,
            damping: f64,
        ) -> Result<Option<Vec<f64>>, TestError> {
            Ok(Some(linear.step(damping)?))
        }

        fn predicted_decrease(&self, linear: &NormalEquations<'p>, step: &[f64], damping: f64) -> f64 {
            linear.predicted_decrease(step, damping)
        }

        fn moved(&self, at: &[f64; 2], _linear: &NormalEquations<'p>, step: &[f64]) -> [f64; 2] {
            [at[0] + step[0], at[1] + step[1]]
        }

        fn after_step(
            &mut self,
            _at: &mut [f64; 2],
            _linear: NormalEquations<'p>,
            step: &Step,
        ) -> Result<Schedule, TestError> {
            self.steps.push(*step);
            Ok(Schedule::Settled)
        }
    }

    /// A curved valley from (-1.2, 1) to (1, 1), along which undamped steps climb.
    fn rosenbrock([x, y]: [f64; 2]) -> Vec<Row> {
        vec![(10.0 * (y - x * x), [-20.0 * x, 10.0]), (1.0 - x, [-1.0, 0.0])]
    }

    /// Deviations of a line from points at 0, 1, ..., of slope 2 and intercept -1.
    fn line(noise: &[f64]) -> impl Fn([f64; 2]) -> Vec<Row> {
        move |[slope, intercept]: [f64; 2]| {
            let row = |(k, noise): (usize, &f64)| {
                let t = k as f64;
                (slope * t + intercept - (2.0 * t - 1.0 + noise), [t, 1.0])
            };
            noise.iter().enumerate().map(row).collect()
        }
    }

    #[test]
    fn rosenbrocks_valley_is_followed_to_its_end() {
        let system = one_block();
        let mut problem = Rows::new(&system, LossFunction::Squared, Descent::Lower, rosenbrock);
        let (found, end) = problem.solved([-1.2, 1.0], &Options::DEFAULT);
        assert_eq!(end, Termination::Converged);
        assert!(found.iter().all(|x| (x - 1.0).abs() < 1e-9), "{found:?}");
        assert!(problem.steps.windows(2).all(|pair| pair[1].cost <= pair[0].cost), "costs fall");
        assert!(problem.steps.iter().any(|step| step.damping > 0.0), "the first step fails undamped");
    }

    /// Three of twenty points are wrong by up to 300 standard deviations.
    #[test]
    fn outliers_do_not_move_a_line_under_robust_losses() {
        let system = one_block();
        let mut noise: Vec<f64> = (0..20).map(|k| 0.1 * f64::from(k * 7 % 5 - 2)).collect();
        (noise[3], noise[11], noise[17]) = (300.0, -80.0, 40.0);
        let mut start = [0.0, 0.0];
        for (loss, most) in [
            (LossFunction::Huber { c2: 4.0 }, 0.8),
            (LossFunction::Cauchy { c2: 4.0 }, 0.2),
            (LossFunction::Tukey { c2: 20.0 }, 0.06),
        ] {
            let mut problem = Rows::new(&system, loss, Descent::Doubled, line(&noise));
            let (found, end) = problem.solved(start, &Options::DEFAULT);
            assert_eq!(end, Termination::Converged, "{loss:?}");
            let error = (found[0] - 2.0).abs().max(0.1 * (found[1] + 1.0).abs());
            assert!(error < most, "{loss:?}: {found:?}");
            // Each starts at the minimum of the loss before it.
            start = found;
        }
    }

    /// The covariance of slope and intercept of n points at 0, 1, ... is that of textbooks.
    #[test]
    fn the_covariance_of_a_line_is_known() {
        let system = one_block();
        let noise: Vec<f64> = (0..11).map(|k| f64::from(k * 3 % 7) - 3.0).collect();
        let mut problem = Rows::new(&system, LossFunction::Squared, Descent::Linear, line(&noise));
        let (found, end) = problem.solved([0.0, 0.0], &Options::DEFAULT);
        assert_eq!((end, problem.steps.len()), (Termination::Converged, 1), "one step suffices");
        let factor = problem.linearise(&found).unwrap().matrix.factor().unwrap();
        let columns = InverseColumns::of(&factor, (2, 1), &[Some(0), Some(1), None]).unwrap();
        // n = 11, sum t = 55, sum t^2 = 385.
        let determinant = 11.0 * 385.0 - 55.0 * 55.0;
        for (row, k, expected) in [(0, 0, 11.0), (0, 1, -55.0), (1, 1, 385.0), (0, 2, 0.0)] {
            let entry = columns.entry(row, k);
            assert!((entry - expected / determinant).abs() < 1e-14, "({row},{k}): {entry}");
        }
    }

    #[test]
    fn each_reason_to_end_has_its_name() {
        let system = one_block();
        let end = |descent, start, options: Options, rows: fn([f64; 2]) -> Vec<Row>| {
            Rows::new(&system, LossFunction::Squared, descent, rows).solved(start, &options).1
        };
        let few = Options { max_iterations: 3, ..Options::DEFAULT };
        assert_eq!(end(Descent::Lower, [-1.2, 1.0], few, rosenbrock), Termination::OutOfIterations);
        let far = |x: [f64; 2]| rosenbrock(x.map(|x| 1e200 * x));
        assert_eq!(end(Descent::Lower, [1.0, 1.0], Options::DEFAULT, far), Termination::Overflow);
        let long = Options { small_step: 10.0, ..Options::DEFAULT };
        assert_eq!(end(Descent::Free, [-1.2, 1.0], long, rosenbrock), Termination::Converged);
        // The derivative has the wrong sign, so that every step climbs.
        let climbs = |[x, y]: [f64; 2]| vec![(1.0 + x, [-1.0, 0.0]), (y, [0.0, 1.0])];
        assert_eq!(end(Descent::Lower, [0.0, 0.0], Options::DEFAULT, climbs), Termination::Stuck);
        let cancelled = std::sync::atomic::AtomicBool::new(true);
        let mut problem = Rows::new(&system, LossFunction::Squared, Descent::Lower, rosenbrock);
        let run = Run::default().cancelled_by(&cancelled);
        let error = minimise(&mut problem, [0.0, 0.0], &Options::DEFAULT, run).unwrap_err();
        assert!(matches!(error, TestError::Cancelled(_)));
    }
}
