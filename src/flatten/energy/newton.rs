use glam::{DMat2, DVec2};

use crate::{
    flatten::energy::objective::Problem,
    id::{IdVec, VertexId},
    sparse::{BlockJacobi, Cholesky, Matrix, SparseError, Stop, conjugate_gradients, dot},
};

/// Added to the diagonal of the Hessian, over its mean: moving and turning the whole map costs nothing, so
/// the Hessian alone is singular. It fixes the gauge without pinning a vertex.
const GAUGE: f64 = 1e-9;

/// How much the gauge term grows when rounding still makes a pivot negative.
const GAUGE_GROWTH: f64 = 1e3;

/// Share of the decrease promised by the gradient that a step must reach (Armijo 1966).
const ARMIJO: f64 = 1e-4;

/// Rise of the energy, over its value, that rounding explains: the last steps to the optimum are lost in it.
const ROUNDING: f64 = 4e-15;

/// Halvings of a step before it is given up: the map is then as good as rounding allows.
const HALVINGS: usize = 30;

/// Conjugate gradients stop at this residual: a truncated step needs no more, the next one has another Hessian.
const RESIDUAL: f64 = 1e-2;

/// Iterations of the first steps. From the optimum of a coarser level only details are missing, and twenty reach them.
const FIRST_ITERATIONS: usize = 20;

/// Iterations at most.
const MOST_ITERATIONS: usize = 640;

/// A step that promises more than this share of what the last one promised was too short: iterations are doubled.
const SLOW: f64 = 0.3;

/// How the Newton system is solved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Solver {
    /// By factoring it; the steps are exact and few.
    Direct,
    /// By conjugate gradients, as many iterations as pay off; nothing is factored.
    Iterative,
}

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Limits {
    /// Decrease promised by a step, over the energy.
    pub(crate) decrement: f64,
    /// Newton steps.
    pub(crate) steps: usize,
}

impl Problem<'_> {
    /// Minimises the energy by projected Newton. A density with a barrier needs a map without flips to start from, and
    /// no step flips a face.
    pub(crate) fn minimise(
        &self,
        uv: &mut IdVec<VertexId, DVec2>,
        solver: Solver,
        limits: Limits,
    ) -> Result<(), SparseError> {
        let mut hessian = Matrix::zero(&self.net.pattern);
        let direct = match solver {
            Solver::Direct => Some(Cholesky::of_blocks(&self.net.pattern, &self.net.places)?),
            Solver::Iterative => None,
        };
        let mut energy = self.energy(uv);
        let (mut iterations, mut last) = (FIRST_ITERATIONS, f64::INFINITY);
        for _ in 0..limits.steps {
            let gradient = self.assemble(uv, &mut hessian);
            let downhill: Vec<DVec2> = gradient.iter().map(|g| -*g).collect();
            let d = match &direct {
                Some(cholesky) => factored_step(cholesky, &mut hessian, &downhill)?,
                None => iterated_step(&mut hessian, &downhill, iterations),
            };
            let decrement = dot(&downhill, &d);
            match self.line_search(uv, &d, energy, decrement) {
                Some(reached) => energy = reached,
                None => break,
            }
            // After the step, not before: convergence is quadratic, so the last step squares the error.
            if decrement.is_nan() || decrement <= limits.decrement * energy {
                break;
            }
            if decrement > SLOW * last {
                iterations = (2 * iterations).min(MOST_ITERATIONS);
            }
            last = decrement;
        }
        Ok(())
    }

    /// Moves `uv` along `d` as far as the energy falls, and returns the new energy; `None` if it falls nowhere.
    fn line_search(
        &self,
        uv: &mut IdVec<VertexId, DVec2>,
        d: &[DVec2],
        energy: f64,
        decrement: f64,
    ) -> Option<f64> {
        let mut step = self.largest_step(uv, d);
        let mut trial = uv.clone();
        for _ in 0..HALVINGS {
            for ((t, u), d) in trial.iter_mut().zip(uv.iter()).zip(d) {
                *t = *u + step * *d;
            }
            let reached = self.energy(&trial);
            if reached <= energy * (1.0 + ROUNDING) - ARMIJO * step * decrement {
                *uv = trial;
                return Some(reached);
            }
            step *= 0.5;
        }
        None
    }
}

/// Adds `gauge` times the mean diagonal to the diagonal.
fn add_gauge(hessian: &mut Matrix<'_, DMat2>, gauge: f64) {
    let rows = hessian.pattern().rows();
    let trace: f64 = (0..rows).map(|i| hessian.diagonal(i)).map(|b| b.x_axis.x + b.y_axis.y).sum();
    let added = DMat2::IDENTITY * (gauge * trace / (2 * rows) as f64);
    for i in 0..rows {
        *hessian.at(i, i) += added;
    }
}

fn factored_step(
    cholesky: &Cholesky,
    hessian: &mut Matrix<'_, DMat2>,
    rhs: &[DVec2],
) -> Result<Vec<DVec2>, SparseError> {
    let mut gauge = GAUGE;
    loop {
        add_gauge(hessian, gauge);
        match cholesky.factor_blocks(hessian) {
            Ok(factor) => {
                let mut x: Vec<f64> = rhs.iter().flat_map(|v| v.to_array()).collect();
                factor.solve(&mut x)?;
                return Ok(x.chunks_exact(2).map(|c| DVec2::new(c[0], c[1])).collect());
            }
            Err(SparseError::NotPositiveDefinite { .. }) if gauge < 1.0 => gauge *= GAUGE_GROWTH,
            Err(other) => return Err(other),
        }
    }
}

fn iterated_step(hessian: &mut Matrix<'_, DMat2>, rhs: &[DVec2], iterations: usize) -> Vec<DVec2> {
    add_gauge(hessian, GAUGE);
    let stop = Stop { relative_residual: RESIDUAL, iterations };
    conjugate_gradients(hessian, &BlockJacobi::new(hessian), rhs, stop).0
}
