//! Where the unknowns of a taxel are in the linear system.

use crate::{
    calib::{ContactMeasurement, Displacement, DisplacementMeasurement, Model, Observations},
    id::{IdVec, VertexId},
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
