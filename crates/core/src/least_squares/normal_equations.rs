//! Sparse normal equations `J'WJ x = -J'We` in blocks, and columns of their inverse: the joint covariance of some unknowns.

use crate::sparse::{BlockFactor, BlockMatrix, SparseError};

/// Normal equations; one matrix may serve several columns of unknowns, which then follow one another in the gradient.
pub(crate) struct NormalEquations<'s> {
    /// `J'WJ`.
    pub(crate) matrix: BlockMatrix<'s>,
    /// `J'We`.
    pub(crate) gradient: Vec<f64>,
    /// Columns of unknowns.
    pub(crate) columns: usize,
}

impl NormalEquations<'_> {
    /// The step to the minimum of the quadratic, with `damping` times the diagonal added.
    pub(crate) fn step(&self, damping: f64) -> Result<Vec<f64>, SparseError> {
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
    pub(crate) fn predicted_decrease(&self, step: &[f64], damping: f64) -> f64 {
        let diagonal = if damping > 0.0 { self.matrix.diagonal() } else { vec![0.0] };
        let damped: f64 = step.iter().zip(diagonal.iter().cycle()).map(|(x, d)| damping * d * x * x).sum();
        let slope: f64 = step.iter().zip(&self.gradient).map(|(x, g)| x * g).sum();
        0.5 * (damped - slope)
    }
}

/// Columns of the inverse of normal equations, which at a minimum is the covariance of all unknowns to first order.
pub(crate) struct InverseColumns {
    values: Vec<f64>,
    unknowns: usize,
}

impl InverseColumns {
    /// The columns of the unknowns `wanted`, of `unknowns` in all in `columns` columns; zero for one that is fixed.
    pub(crate) fn of(
        factor: &BlockFactor<'_>,
        (unknowns, columns): (usize, usize),
        wanted: &[Option<usize>],
    ) -> Result<Self, SparseError> {
        let mut values = vec![0.0; unknowns * wanted.len()];
        for (k, unknown) in wanted.iter().enumerate() {
            if let Some(unknown) = unknown {
                values[k * unknowns + unknown] = 1.0;
            }
        }
        factor.solve(&mut values, wanted.len() * columns)?;
        Ok(Self { values, unknowns })
    }

    /// The covariance of an unknown with the wanted unknown number `k`.
    pub(crate) fn entry(&self, unknown: usize, k: usize) -> f64 {
        self.values[k * self.unknowns + unknown]
    }
}
