use crate::{
    calib::{
        CalibError,
        solve::gauge::{Anchoring, Free},
        solve::loss::Kernels,
        solve::normal_equations::{PerObservation, Problem, Shape, State},
    },
    sparse::{BlockMatrix, SparseError},
};

/// How a step is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Plain Gauss-Newton: ends where the cost stops falling.
    GaussNewton,
    /// Levenberg-Marquardt, undamped as long as the cost falls: Gauss-Newton with a safety net.
    #[default]
    LevenbergMarquardt,
    /// Powell's dogleg in a trust region.
    Dogleg,
}

/// One step of the optimisation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Iteration {
    /// Cost after the step: half of the (robust) sum of squares.
    pub cost: f64,
    /// Largest change of an unknown, in m or rad.
    pub step: f64,
    /// What the step was taken with: damping (Levenberg-Marquardt), radius of the trust region (dogleg) or how close the
    /// cost is to the truncated one (graduated non-convexity); 0 without.
    pub control: f64,
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
    /// A plain Gauss-Newton step raised the cost.
    Diverged,
    /// The cost is no finite number: observations disagree by more than squares can hold.
    Overflow,
}

impl Termination {
    /// Whether the result is a minimum.
    #[must_use]
    pub const fn is_converged(self) -> bool {
        matches!(self, Self::Converged | Self::NothingToSolve)
    }

    /// In words.
    #[must_use]
    pub const fn describe(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::NothingToSolve => "nothing to solve: every taxel is fixed",
            Self::OutOfIterations => "not converged: out of iterations",
            Self::Stuck => "not converged: no step lowers the cost",
            Self::Diverged => "not converged: a Gauss-Newton step raised the cost",
            Self::Overflow => "not converged: the cost is no finite number",
        }
    }
}

/// When to end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StopCriteria {
    /// Most iterations.
    pub iterations: usize,
    /// The cost has converged when a step lowers it by less than this share, or the next one is sure to.
    pub relative_decrease: f64,
}

impl Default for StopCriteria {
    fn default() -> Self {
        Self { iterations: 100, relative_decrease: 1e-9 }
    }
}

/// First damping after an undamped step that failed, over the diagonal: long chains of taxels bend under so little
/// that more would stop them from moving at all.
const FIRST_DAMPING: f64 = 1e-9;

/// Growth of the damping at the first failure; it doubles at every further one (Nielsen 1999).
const FIRST_GROWTH: f64 = 4.0;

/// Damping beyond which a step is too short to matter.
const LARGEST_DAMPING: f64 = 1e12;

/// A cost this far below what rounding of the sums can resolve is as good as none, over the number of observations.
const EXACT_FIT: f64 = 1e-20;

/// Factor from decrease to decrease below which the next one is foretold instead of computed, which would cost a
/// factorization: a quarter of the time of most graphs.
const STEADY: f64 = 0.1;

/// No factor is believed to be smaller: near a minimum where errors remain, Gauss-Newton converges linearly.
const LEAST_FACTOR: f64 = 1e-3;

/// What weights the squares get while the optimisation runs.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Weighting<'w> {
    /// From kernels, at every step anew.
    Kernels(&'w Kernels),
    /// Given.
    Fixed(&'w PerObservation),
}

impl Weighting<'_> {
    pub(crate) fn cost(&self, squares: &PerObservation) -> f64 {
        let sum: f64 = match self {
            Self::Kernels(kernels) => kernels.costs(squares).iter().sum(),
            Self::Fixed(weights) => weights.iter().zip(squares.iter()).map(|(w, s)| w * s).sum(),
        };
        0.5 * sum
    }

    pub(crate) fn weights(&self, squares: &PerObservation) -> PerObservation {
        match self {
            Self::Kernels(kernels) => kernels.weights(squares),
            Self::Fixed(weights) => (*weights).clone(),
        }
    }
}

/// A state with its squares and cost.
#[derive(Debug, Clone)]
pub(crate) struct Point {
    pub(crate) state: State,
    pub(crate) squares: PerObservation,
    pub(crate) cost: f64,
}

impl Point {
    pub(crate) fn new(problem: &Problem<'_>, weighting: &Weighting<'_>, state: State) -> Self {
        let squares = problem.squares(&state);
        let cost = weighting.cost(&squares);
        Self { state, squares, cost }
    }
}

/// The linear system at a point.
pub(crate) struct Linear<'p> {
    pub(crate) matrix: BlockMatrix<'p>,
    pub(crate) gradient: Vec<f64>,
    columns: usize,
}

impl<'p> Linear<'p> {
    pub(crate) fn new(
        problem: &'p Problem<'_>,
        free: &[Free],
        state: &State,
        weights: &PerObservation,
    ) -> Self {
        let (mut matrix, gradient) = problem.linearise(state, weights);
        for component in free {
            component.stiffen(problem, state, &mut matrix);
        }
        Self { matrix, gradient, columns: problem.shape.columns() }
    }

    /// The step to the minimum of the quadratic, with `damping` times the diagonal added.
    pub(crate) fn newton_step(&self, damping: f64) -> Result<Vec<f64>, SparseError> {
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

    /// `x' M x`, summed over the right-hand sides.
    fn curvature(&self, x: &[f64]) -> f64 {
        let rows = x.len() / self.columns;
        x.chunks(rows.max(1)).map(|x| dot(x, &self.matrix.multiply(x))).sum()
    }
}

/// Minimises from `start`. Returns the best point, all iterations and the reason for the end.
pub(crate) fn minimise(
    problem: &Problem<'_>,
    anchoring: &Anchoring,
    weighting: Weighting<'_>,
    start: State,
    method: Method,
    limits: StopCriteria,
    watch: &mut dyn FnMut(Iteration),
) -> Result<(Point, Termination), CalibError> {
    let mut point = Point::new(problem, &weighting, start);
    if problem.moving() == 0 {
        return Ok((point, Termination::NothingToSolve));
    }
    let mut control = Control { method, damping: 0.0, growth: FIRST_GROWTH, radius: None };
    let mut last_decrease = 0.0;
    for _ in 0..limits.iterations {
        let weights = weighting.weights(&point.squares);
        let free = anchoring.free_under(problem, &point.state, &weights);
        let linear = Linear::new(problem, &free, &point.state, &weights);
        let Some((next, iteration)) = control.advance(problem, &weighting, &linear, &point)? else {
            let ending = if control.method == Method::GaussNewton {
                Termination::Diverged
            } else {
                Termination::Stuck
            };
            // At a minimum rounding alone can keep every step from lowering the cost.
            let at_minimum = linear.predicted_decrease().map_err(|e| problem.explain(e))?
                <= limits.relative_decrease * point.cost;
            return Ok((point, if at_minimum { Termination::Converged } else { ending }));
        };
        let decrease = point.cost - next.cost;
        let exact = EXACT_FIT * point.squares.iter().count() as f64;
        point = next;
        watch(iteration);
        if !point.cost.is_finite() {
            return Ok((point, Termination::Overflow));
        }
        // A quadratic has its minimum where one undamped step leads.
        let exact_model = problem.shape != Shape::Pose
            && matches!(weighting, Weighting::Fixed(_))
            && iteration.control == 0.0;
        // Gauss-Newton steps on fixed weights gain ever less: by the same factor again, if that is not the luck of a
        // first step.
        let is_newton = iteration.control == 0.0 && matches!(weighting, Weighting::Fixed(_));
        let factor = (decrease / last_decrease).max(LEAST_FACTOR);
        let next_decrease = if is_newton && factor < STEADY { decrease * factor } else { decrease };
        if exact_model || next_decrease <= limits.relative_decrease * point.cost + exact {
            return Ok((point, Termination::Converged));
        }
        last_decrease = if is_newton { decrease } else { 0.0 };
    }
    Ok((point, Termination::OutOfIterations))
}

impl Linear<'_> {
    /// How much the quadratic model would fall by its best step.
    fn predicted_decrease(&self) -> Result<f64, SparseError> {
        Ok(self.predicted(&self.newton_step(0.0)?, 0.0))
    }

    /// How much the quadratic falls by the minimising `step` under `damping`.
    fn predicted(&self, step: &[f64], damping: f64) -> f64 {
        let diagonal = if damping > 0.0 { self.matrix.diagonal() } else { vec![0.0] };
        let held: f64 = step.iter().zip(diagonal.iter().cycle()).map(|(x, d)| damping * d * x * x).sum();
        0.5 * (held - dot(step, &self.gradient))
    }
}

/// What a method remembers from step to step.
struct Control {
    method: Method,
    damping: f64,
    growth: f64,
    radius: Option<f64>,
}

impl Control {
    /// One accepted step; `None` if there is none.
    fn advance(
        &mut self,
        problem: &Problem<'_>,
        weighting: &Weighting<'_>,
        linear: &Linear<'_>,
        point: &Point,
    ) -> Result<Option<(Point, Iteration)>, CalibError> {
        let attempt = |step: &[f64], control: f64| {
            let next = Point::new(problem, weighting, problem.advanced(&point.state, step));
            let step = step.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            let iteration = Iteration { cost: next.cost, step, control };
            (next, iteration)
        };
        // Rounding of a sum of squares: a step that raises the cost by less has not failed.
        let slack = 1e-13 * point.cost;
        let falls = |next: &Point| next.cost <= point.cost + slack;
        if self.method == Method::Dogleg {
            return self.dogleg(linear, point, attempt, |e| problem.explain(e));
        }
        loop {
            match linear.newton_step(self.damping) {
                Ok(step) => {
                    let (next, iteration) = attempt(&step, self.damping);
                    if falls(&next) {
                        let predicted = linear.predicted(&step, self.damping);
                        self.relax((point.cost - next.cost) / predicted);
                        return Ok(Some(match weighting {
                            Weighting::Kernels(_) => stride((next, iteration), step, self.damping, attempt),
                            Weighting::Fixed(_) => (next, iteration),
                        }));
                    }
                }
                // Damping would hide a taxel that nothing determines.
                Err(e) if self.damping == 0.0 => return Err(problem.explain(e)),
                Err(_) => {}
            }
            if self.method == Method::GaussNewton {
                return Ok(None);
            }
            self.damping = (self.growth * self.damping).max(FIRST_DAMPING);
            self.growth *= 2.0;
            if self.damping > LARGEST_DAMPING {
                return Ok(None);
            }
        }
    }

    /// Less damping after a good step, the less the better the quadratic predicted it (Nielsen 1999).
    fn relax(&mut self, quality: f64) {
        self.growth = FIRST_GROWTH;
        let factor = (1.0 - (2.0 * quality - 1.0).powi(3)).clamp(0.1, 2.0);
        self.damping *= if quality.is_finite() { factor } else { 1.0 };
        if self.damping < FIRST_DAMPING {
            self.damping = 0.0;
        }
    }

    /// Powell 1970: along the steepest descent to its minimum, then towards the Gauss-Newton step, as far as the
    /// model is trusted.
    fn dogleg(
        &mut self,
        linear: &Linear<'_>,
        point: &Point,
        attempt: impl Fn(&[f64], f64) -> (Point, Iteration),
        explain: impl Fn(SparseError) -> CalibError,
    ) -> Result<Option<(Point, Iteration)>, CalibError> {
        let newton = linear.newton_step(0.0).map_err(explain)?;
        // Rotations and translations are made comparable by the diagonal of the system.
        let diagonal = linear.matrix.diagonal();
        let scale = |k: usize| diagonal[k % diagonal.len()].max(f64::MIN_POSITIVE);
        let length = |x: &[f64]| x.iter().enumerate().map(|(k, x)| scale(k) * x * x).sum::<f64>().sqrt();
        let steepest: Vec<f64> = linear.gradient.iter().enumerate().map(|(k, g)| -g / scale(k)).collect();
        let slope = -dot(&steepest, &linear.gradient);
        let along = slope / linear.curvature(&steepest);
        let cauchy: Vec<f64> = steepest.iter().map(|x| along * x).collect();
        let mut radius = self.radius.unwrap_or_else(|| length(&newton));
        loop {
            let step = blend(&cauchy, &newton, radius, length);
            let predicted = -dot(&step, &linear.gradient) - 0.5 * linear.curvature(&step);
            let (next, iteration) = attempt(&step, radius);
            let gained = point.cost - next.cost;
            let quality = gained / predicted;
            let noise = 1e-13 * point.cost;
            if quality > 0.25 || gained.abs() <= noise {
                self.radius = Some(if quality > 0.75 { radius.max(3.0 * length(&step)) } else { radius });
                return Ok(Some((next, iteration)));
            }
            radius *= 0.25;
            if quality > 0.0 {
                self.radius = Some(radius);
                return Ok(Some((next, iteration)));
            }
            if radius.is_nan() || radius <= 1e-12 * length(&newton) {
                return Ok(None);
            }
        }
    }
}

/// Doubles `step` as long as that lowers the cost.
///
/// Reweighting replaces a kernel by a parabola above it, whose minimum falls short of the kernel's own: where the weights
/// are small, so short that hundreds of steps would be needed.
fn stride(
    mut best: (Point, Iteration),
    mut step: Vec<f64>,
    control: f64,
    attempt: impl Fn(&[f64], f64) -> (Point, Iteration),
) -> (Point, Iteration) {
    loop {
        step.iter_mut().for_each(|x| *x *= 2.0);
        let next = attempt(&step, control);
        // Written so that a cost that is no number ends it, too.
        if next.0.cost < best.0.cost {
            best = next;
        } else {
            return best;
        }
    }
}

/// The point of the dogleg path at distance `radius`.
fn blend(cauchy: &[f64], newton: &[f64], radius: f64, length: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    if length(newton) <= radius {
        return newton.to_vec();
    }
    let first = length(cauchy);
    if first >= radius {
        return cauchy.iter().map(|x| radius / first * x).collect();
    }
    // The path leaves the region once; halving finds where.
    let at = |t: f64| -> Vec<f64> { cauchy.iter().zip(newton).map(|(c, n)| c + t * (n - c)).collect() };
    let (mut inside, mut outside) = (0.0, 1.0);
    for _ in 0..40 {
        let middle = 0.5 * (inside + outside);
        if length(&at(middle)) <= radius { inside = middle } else { outside = middle }
    }
    at(inside)
}

fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}
