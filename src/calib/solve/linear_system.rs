//! The linear system of one Gauss-Newton or Levenberg-Marquardt step, its gauge fixed.

use crate::{
    calib::{FreeBody, PerObservation, Poses, Problem},
    sparse::{BlockMatrix, SparseError},
};

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
    pub(super) fn newton_step(&self, damping: f64) -> Result<Vec<f64>, SparseError> {
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
    pub(super) fn predicted_decrease(&self, step: &[f64], damping: f64) -> f64 {
        let diagonal = if damping > 0.0 { self.matrix.diagonal() } else { vec![0.0] };
        let damped: f64 = step.iter().zip(diagonal.iter().cycle()).map(|(x, d)| damping * d * x * x).sum();
        let slope: f64 = step.iter().zip(&self.gradient).map(|(x, g)| x * g).sum();
        0.5 * (damped - slope)
    }
}
