//! The linear system of one Gauss-Newton or Levenberg-Marquardt step: where the unknowns of a taxel
//! are in it, its gauge, and its solution.

use crate::{
    calib::{
        ContactMeasurement, Displacement, DisplacementMeasurement, FreeBody, Model, Observations,
        PerObservation, Poses, Problem,
    },
    id::{IdVec, VertexId},
    sparse::{BlockMatrix, SparseError},
};

/// How the unknowns of a taxel share the blocks of the system.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum BlockLayout {
    /// Positions whose information is the same in every direction: one matrix serves x, y and z.
    Scalar,
    /// Positions.
    Vector,
    /// Poses.
    Pose,
}

impl BlockLayout {
    /// The smallest blocks that hold the information of all observations.
    pub(crate) fn of(observations: &Observations) -> Self {
        let round_edge = |e: &Displacement| match &e.measurement {
            DisplacementMeasurement::Offset { information, .. } => information.as_isotropic().is_some(),
            DisplacementMeasurement::Relative(_) => false,
        };
        let round_contact = |measurement: &ContactMeasurement| match measurement {
            ContactMeasurement::Position { information, .. }
            | ContactMeasurement::PositionNormal { information, .. } => information.as_isotropic().is_some(),
            ContactMeasurement::Pose { .. } => false,
        };
        match observations.model {
            Model::Poses => Self::Pose,
            Model::Positions
                if observations.edges.iter().all(round_edge)
                    && observations.contacts.iter().all(|c| round_contact(&c.measurement)) =>
            {
                Self::Scalar
            }
            Model::Positions => Self::Vector,
        }
    }

    pub(crate) const fn size(self) -> usize {
        match self {
            Self::Scalar => 1,
            Self::Vector => 3,
            Self::Pose => 6,
        }
    }

    /// Unknown numbers of a taxel.
    pub(crate) const fn unknowns(self) -> usize {
        self.size() * self.columns()
    }

    pub(crate) const fn columns(self) -> usize {
        if matches!(self, Self::Scalar) { 3 } else { 1 }
    }

    /// Where unknown `k` of block `row` is in a vector of all unknowns, of `blocks` blocks.
    #[inline]
    pub(crate) const fn index(self, blocks: usize, row: u32, k: usize) -> usize {
        match self {
            Self::Scalar => k * blocks + row as usize,
            Self::Vector => 3 * row as usize + k,
            Self::Pose => 6 * row as usize + k,
        }
    }
}

/// Block rows of the taxels that `moves` picks, in their order, and their number.
pub(crate) fn number_rows(
    observations: &Observations,
    moves: impl Fn(VertexId) -> bool,
) -> (IdVec<VertexId, Option<u32>>, usize) {
    let mut count = 0_u32;
    let number = |v| {
        moves(v).then(|| {
            count += 1;
            count - 1
        })
    };
    let rows = observations.taxels.ids().map(number).collect();
    (rows, count as usize)
}

/// The rows of an edge between two taxels that move.
pub(crate) fn pair_of(edge: &Displacement, rows: &IdVec<VertexId, Option<u32>>) -> Option<(usize, usize)> {
    Some((rows[edge.from]? as usize, rows[edge.to]? as usize))
}

/// The rows of all edges between two taxels that move.
pub(crate) fn row_pairs<'a>(
    observations: &'a Observations,
    rows: &'a IdVec<VertexId, Option<u32>>,
) -> impl Iterator<Item = (usize, usize)> + 'a {
    observations.edges.iter().filter_map(|e| pair_of(e, rows))
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
