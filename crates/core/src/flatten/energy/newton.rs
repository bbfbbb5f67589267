//! Projected Newton with a line search that cannot flip a face (`(teran2005)`, `(smith2015)`).
//!
//! Each step solves the Newton system of the convex model, directly or by truncated conjugate gradients with
//! block Jacobi: in single precision as long as that finds a descent. The line search starts at 0.9 of the
//! first step that collapses a face, and halves the step until the energy falls (`(armijo1966)`). It reaches
//! a local minimum, which need not be the global one.
//!
//! Where steps stay too short, because the convex model leaves out negative curvatures of faces, most of
//! these are kept; they are left out again for a few steps if the Hessian is not positive with them (after
//! `(longva2023)`; *heuristic*: when, and how many): 45 steps instead of 184 at 4400 vertices of a head with
//! sharp features.

use glam::{DMat2, DVec2, Mat2};

use crate::flatten::energy::assembly::Assembly;
use crate::flatten::energy::elements::{ElementMesh, Uv};
use crate::flatten::energy::objective::Objective;
use crate::id::VertexId;
use crate::parallel::par_ids;
use crate::sparse::{Block, CgOptions, Cholesky, Matrix, SparseError, conjugate_gradients, dot};

/// Added to the diagonal of the Hessian, over its mean: the energy does not depend on the position and
/// rotation of the whole map, so the Hessian alone is singular. It fixes the gauge without pinning a vertex.
const GAUGE: f64 = 1e-9;

/// Largest mean of that diagonal over the energy: about that of well-shaped faces. That of needles is larger
/// by their aspect, and a gauge term of that size would slow all other faces down.
const WELL_SHAPED: f64 = 4.0;

/// How much the gauge term grows when rounding still makes a pivot negative.
const GAUGE_GROWTH: f64 = 1e3;

/// Ratio of the predicted decrease of a step to that of the step before: the largest, and the one of the first step.
const MOST_RATIO: f64 = 0.9;
const FIRST_RATIO: f64 = 0.5;

/// Least factor by which that ratio changes at the next step.
const LEAST_FALL: f64 = 0.3;

/// Decrement over the energy below which negative curvatures may be kept: the Hessian is probably positive
/// there.
const KEPT_BELOW: f64 = 1e-2;

/// Slow steps in a row before negative curvature is kept.
const SLOW_STEPS: u32 = 2;

/// Share of the negative curvature that is removed at first; each further step removes a tenth of the share
/// of the last.
const LEFT_OUT_FACTOR: f64 = 0.1;

/// The minimisation ends if this many more steps like the last one would not reach the wanted energy.
const MAX_STEPS_TO_WANTED: f64 = 4.0;

/// Share of the decrease predicted by the gradient that a step must reach.
const ARMIJO: f64 = 1e-4;

/// Relative rise of the energy that is rounding error: the last steps to the optimum are below it.
const ENERGY_ROUNDING: f64 = 4e-15;

/// Predicted decrease over the energy below which a map that cannot be improved counts as a minimum.
const STATIONARY: f64 = 1e-6;

/// Halvings of a step before the minimisation ends: the map is then optimal up to rounding.
const MAX_HALVINGS: usize = 30;

/// Conjugate gradients stop at this relative residual (truncated Newton).
const RESIDUAL: f64 = 1e-2;

/// Iterations of the first steps: a start from the optimum of a coarser level needs only short-range
/// corrections.
const FIRST_ITERATIONS: usize = 20;

/// Most iterations.
const MOST_ITERATIONS: usize = 640;

/// If the predicted decrease of a step is more than this share of the last one, the last step was solved too
/// coarsely: the iterations are doubled.
const SLOW_RATIO: f64 = 0.3;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Solver {
    /// By a Cholesky factorisation: few exact steps.
    Direct,
    /// By conjugate gradients, with more iterations where steps are too short.
    Iterative,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct NewtonLimits {
    /// The minimisation ends if the expected decrease of all further steps, over the energy, is below this.
    pub(crate) rest: f64,
    pub(crate) steps: usize,
    /// Relative decrease of the energy in a round with fillers at which the rounds end.
    pub(crate) gain: f64,
    /// The wanted energy: the minimisation ends if it will probably not get below it.
    pub(crate) most: f64,
}

/// How a minimisation ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Ended {
    /// At a minimum, up to the limits.
    Converged,
    /// At the limit of steps, where no step lowers the energy although the gradient is large, or where the
    /// Hessian overflows.
    Short,
    /// Where the caller stopped it.
    Stopped,
    /// Far above the wanted energy.
    Hopeless,
}

impl Objective<'_> {
    /// Minimises the energy by projected Newton. An energy with a barrier needs a map without flips to start
    /// from, and no step flips a face. `go_on` gets the map after every step; the minimisation ends where it
    /// returns `false`.
    pub(crate) fn minimise(
        &self,
        uv: &mut Uv,
        solver: Solver,
        limits: NewtonLimits,
        go_on: &mut dyn FnMut(&Uv) -> bool,
    ) -> Result<Ended, SparseError> {
        if solver == Solver::Direct {
            return self.descend(uv, solver, limits, go_on);
        }
        // A large system is bound by memory: in the order of a file it may take three times as long.
        let (elements, order) = self.elements.along_curve();
        let mut moved = order.map(|&v| uv[v]);
        let mut back = |moved: &Uv| {
            order.iter().zip(moved).for_each(|(&v, &at)| uv[v] = at);
            go_on(uv)
        };
        self.on(&elements).descend(&mut moved, solver, limits, &mut back)
    }

    /// As [`Self::minimise`], in the order of the elements.
    fn descend(
        &self,
        uv: &mut Uv,
        solver: Solver,
        limits: NewtonLimits,
        go_on: &mut dyn FnMut(&Uv) -> bool,
    ) -> Result<Ended, SparseError> {
        let mut system = System::new(self.elements, solver)?;
        let mut energy = self.energy(uv);
        let (mut iterations, mut last, mut before) = (FIRST_ITERATIONS, f64::INFINITY, f64::INFINITY);
        let mut kept = Kept::default();
        for _ in 0..limits.steps {
            let step = self.step(uv, &mut system, (energy, iterations), &mut kept);
            let NewtonStep { downhill, d, .. } = match step {
                // The curvature of a face that is nearly a line exceeds 64-bit numbers.
                Err(SparseError::NotFinite { .. }) => return Ok(Ended::Short),
                step => step?,
            };
            let decrement = dot(&downhill, &d);
            match self.line_search(uv, &d, energy, decrement) {
                Some(reached) => energy = reached,
                None if kept.is_on() => {
                    kept.pause();
                    continue;
                }
                None if system.widen() => continue,
                None if decrement <= STATIONARY * energy => return Ok(Ended::Converged),
                None => return Ok(Ended::Short),
            }
            if !go_on(uv) {
                return Ok(Ended::Stopped);
            }
            if expected_rest(decrement, last, before) <= limits.rest * energy {
                return Ok(Ended::Converged);
            }
            if energy - MAX_STEPS_TO_WANTED * decrement > limits.most {
                return Ok(Ended::Hopeless);
            }
            if decrement.is_nan() {
                break;
            }
            if decrement > SLOW_RATIO * last {
                iterations = (2 * iterations).min(MOST_ITERATIONS);
            }
            kept.after(decrement > SLOW_RATIO * last && decrement < KEPT_BELOW * energy);
            (last, before) = (decrement, last);
        }
        Ok(Ended::Short)
    }

    /// The step from `uv`, where the energy is `energy`; at most `iterations` unless the system is factored.
    fn step(
        &self,
        uv: &Uv,
        system: &mut System<'_>,
        (energy, iterations): (f64, usize),
        kept: &mut Kept,
    ) -> Result<NewtonStep, SparseError> {
        loop {
            let System { assembly, method } = system;
            let step = match method {
                Method::Factored(cholesky, hessian) => {
                    let downhill = self.assemble(uv, assembly, hessian, kept.share());
                    factored_step(cholesky, hessian, downhill, energy, kept.gauge())
                }
                Method::Single(hessian) => {
                    let downhill = self.assemble(uv, assembly, hessian, kept.share());
                    Ok(iterated_step(hessian, downhill, iterations))
                }
                Method::Double(hessian) => {
                    let downhill = self.assemble(uv, assembly, hessian, kept.share());
                    Ok(iterated_step(hessian, downhill, iterations))
                }
            };
            match step {
                Ok(NewtonStep { is_convex: false, .. }) | Err(SparseError::NotPositiveDefinite { .. })
                    if kept.is_on() =>
                {
                    kept.pause();
                }
                Ok(NewtonStep { is_convex: false, .. }) if system.widen() => {}
                step => return step,
            }
        }
    }

    /// Moves `uv` along `d` by a step that lowers the energy enough, and returns the new energy; `None` if
    /// there is no such step.
    fn line_search(&self, uv: &mut Uv, d: &[DVec2], energy: f64, decrement: f64) -> Option<f64> {
        let mut step = self.largest_step(uv, d);
        for _ in 0..MAX_HALVINGS {
            let moved = |v: VertexId| uv[v] + d.get(v.index()).map_or(DVec2::ZERO, |d| step * *d);
            let trial = par_ids(uv.len(), moved);
            let reached = self.energy(&trial);
            if reached <= energy * (1.0 + ENERGY_ROUNDING) - ARMIJO * step * decrement {
                *uv = trial;
                return Some(reached);
            }
            step *= 0.5;
        }
        None
    }
}

/// The expected decrease of all further steps after the decrements `before`, `last` and `decrement`: `decrement *
/// r / (1 - r)` with `r = (decrement / last) max((decrement / last) / (last / before), LEAST_FALL)`. Half of the time
/// of a level of a million faces went into two steps that lowered the energy by a millionth.
fn expected_rest(decrement: f64, last: f64, before: f64) -> f64 {
    let ratio = if last.is_finite() { decrement / last } else { FIRST_RATIO };
    let change = if before.is_finite() { (ratio * before / last).max(LEAST_FALL) } else { 1.0 };
    let next = (ratio * change).min(MOST_RATIO);
    decrement * next / (1.0 - next)
}

/// How the Newton systems of a minimisation are solved, with the memory for all steps.
enum Method<'e> {
    Factored(Box<Cholesky>, Matrix<'e, DMat2>),
    Single(Matrix<'e, Mat2>),
    Double(Matrix<'e, DMat2>),
}

/// The Newton systems of a minimisation.
struct System<'e> {
    assembly: Assembly,
    method: Method<'e>,
}

impl<'e> System<'e> {
    fn new(elements: &'e ElementMesh, solver: Solver) -> Result<Self, SparseError> {
        let pattern = elements.pattern();
        let method = match solver {
            Solver::Direct => Method::Factored(
                Box::new(Cholesky::of_blocks(pattern, &elements.positions)?),
                Matrix::zero(pattern),
            ),
            Solver::Iterative => Method::Single(Matrix::zero(pattern)),
        };
        Ok(Self { assembly: Assembly::new(elements), method })
    }

    /// Continues in double precision; `false` if it is in use already. Single precision does not resolve the
    /// curvatures of needles.
    fn widen(&mut self) -> bool {
        let Method::Single(hessian) = &self.method else { return false };
        self.method = Method::Double(Matrix::zero(hessian.pattern()));
        true
    }
}

/// A Newton step.
struct NewtonStep {
    /// Minus the gradient.
    downhill: Vec<DVec2>,
    d: Vec<DVec2>,
    /// Whether the step found the Hessian to be positive.
    is_convex: bool,
}

/// The share of the negative curvatures that the next step keeps.
#[derive(Debug, Default)]
struct Kept {
    /// The share that is left out; `None`: all.
    left_out: Option<f64>,
    /// Slow steps in a row.
    slow: u32,
    /// Steps until they may be kept again, and this number for the next pause.
    wait: u32,
    waits: u32,
}

impl Kept {
    fn is_on(&self) -> bool {
        self.left_out.is_some()
    }

    fn share(&self) -> f64 {
        self.left_out.map_or(0.0, |left_out| 1.0 - left_out)
    }

    /// The largest gauge term with which a Hessian may become positive.
    fn gauge(&self) -> f64 {
        if self.is_on() { GAUGE } else { 1.0 }
    }

    /// Leaves them out for some steps: the Hessian is not positive, or its step does not lower the energy.
    fn pause(&mut self) {
        self.waits = (2 * self.waits).max(1);
        (self.left_out, self.wait) = (None, self.waits);
    }

    fn after(&mut self, is_slow: bool) {
        self.slow = if is_slow { self.slow + 1 } else { 0 };
        self.wait = self.wait.saturating_sub(1);
        self.left_out = match self.left_out {
            Some(left_out) => Some(LEFT_OUT_FACTOR * left_out),
            None => (self.slow >= SLOW_STEPS && self.wait == 0).then_some(LEFT_OUT_FACTOR),
        };
    }
}

/// Adds `gauge` times the mean diagonal, or `most` if that is less, to the diagonal.
fn add_gauge(hessian: &mut Matrix<'_, DMat2>, gauge: f64, most: f64) {
    let rows = hessian.pattern().rows();
    let trace: f64 = (0..rows).map(|i| hessian.diagonal(i)).map(|b| b.x_axis.x + b.y_axis.y).sum();
    let added = gauge * (trace / (2 * rows) as f64).min(most);
    for i in 0..rows {
        *hessian.at(i, i) += DMat2::IDENTITY * added;
    }
}

/// The step that minimises the model, with a gauge term on its diagonal that may grow up to `largest`.
fn factored_step(
    cholesky: &Cholesky,
    hessian: &mut Matrix<'_, DMat2>,
    downhill: Vec<DVec2>,
    energy: f64,
    largest: f64,
) -> Result<NewtonStep, SparseError> {
    let (mut share, mut most) = (GAUGE, WELL_SHAPED * energy);
    loop {
        add_gauge(hessian, share, most);
        match cholesky.factor(hessian) {
            Ok(factor) => {
                let mut d = downhill.clone();
                factor.solve(&mut d)?;
                return Ok(NewtonStep { downhill, d, is_convex: true });
            }
            Err(SparseError::NotPositiveDefinite { .. }) if share < largest => {
                (share, most) = (share * GAUGE_GROWTH, f64::INFINITY);
            }
            Err(other) => return Err(other),
        }
    }
}

/// A step that lowers the model, by conjugate gradients. They start at zero and need no gauge: no component
/// of the step moves or turns the whole map.
fn iterated_step<B: Block>(hessian: &Matrix<'_, B>, downhill: Vec<DVec2>, iterations: usize) -> NewtonStep {
    let options = CgOptions { relative_residual: RESIDUAL, iterations };
    let (d, report) = conjugate_gradients(hessian, &downhill, options);
    // They end early along a direction of negative curvature.
    let ended = report.relative_residual <= RESIDUAL || report.iterations == iterations;
    let is_convex = ended && dot(&downhill, &d) > 0.0;
    NewtonStep { downhill, d, is_convex }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        flatten::{Energy, domain::FlattenDomain, start::tutte::tutte},
        mesh::shapes,
    };

    const LIMITS: NewtonLimits = NewtonLimits { rest: 1e-16, steps: 60, gain: 1e-3, most: f64::INFINITY };

    /// From a far start, with both solvers and every term.
    #[test]
    fn the_energy_never_rises_and_no_face_flips() {
        let mesh = shapes::cap(600, 0.1, 2.4);
        let domain = FlattenDomain::new(&mesh).unwrap();
        let start = tutte(&domain).unwrap();
        for energy in [
            Energy::SymmetricDirichlet,
            Energy::Sum { angle: 1.0, area: 0.5, perimeter: 0.3 },
            Energy::default(),
        ] {
            let objective = Objective::new(&domain.elements, energy);
            for solver in [Solver::Direct, Solver::Iterative] {
                let (mut uv, mut last) = (start.clone(), objective.energy(&start));
                let ended = objective.minimise(&mut uv, solver, LIMITS, &mut |uv| {
                    let reached = objective.energy(uv);
                    assert!(reached <= last * (1.0 + ENERGY_ROUNDING), "{last} rises to {reached}");
                    assert!(domain.elements.is_flip_free(uv));
                    last = reached;
                    true
                });
                assert!(solver == Solver::Iterative || ended == Ok(Ended::Converged), "{ended:?}");
                assert!(last < objective.energy(&start));
            }
        }
    }

    /// At sharp features faces have negative curvatures, without which steps are too short.
    #[test]
    fn spikes_take_few_steps() {
        let mut mesh = shapes::cap(900, 0.1, 2.6);
        let spikes = [glam::DVec3::X, glam::DVec3::Y, glam::DVec3::new(-0.6, 0.3, 0.7)];
        for p in mesh.positions.iter_mut() {
            let height = |spike: &glam::DVec3| 0.9 * (-p.angle_between(*spike) / 0.12).exp();
            *p *= 1.0 + spikes.iter().map(height).sum::<f64>();
        }
        let domain = FlattenDomain::new(&mesh).unwrap();
        let objective = Objective::new(&domain.elements, Energy::SymmetricDirichlet);
        let (mut uv, mut steps) = (tutte(&domain).unwrap(), 0);
        let mut count = |_: &Uv| {
            steps += 1;
            true
        };
        let limits = NewtonLimits { steps: 200, ..LIMITS };
        assert_eq!(objective.minimise(&mut uv, Solver::Direct, limits, &mut count), Ok(Ended::Converged));
        assert!(steps < 40, "{steps}");
        assert!(objective.relative_gradient(&uv) < 1e-6);
    }

    #[test]
    fn the_limit_of_steps_is_reported() {
        let mesh = shapes::cap(600, 0.1, 2.4);
        let domain = FlattenDomain::new(&mesh).unwrap();
        let objective = Objective::new(&domain.elements, Energy::SymmetricDirichlet);
        let mut uv = tutte(&domain).unwrap();
        let limits = NewtonLimits { steps: 2, ..LIMITS };
        assert_eq!(objective.minimise(&mut uv, Solver::Direct, limits, &mut |_| true), Ok(Ended::Short));
        assert!(objective.relative_gradient(&uv) > 1e-6);
        assert_eq!(objective.minimise(&mut uv, Solver::Direct, limits, &mut |_| false), Ok(Ended::Stopped));
        assert_eq!(objective.minimise(&mut uv, Solver::Direct, LIMITS, &mut |_| true), Ok(Ended::Converged));
        assert!(objective.relative_gradient(&uv) < 1e-6);
    }
}
