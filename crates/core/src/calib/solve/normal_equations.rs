//! The normal equations of equation 1: squared residuals, Gauss-Newton matrix and gradient, at
//! given poses and weights.
//!
//! `J' W Omega J x = -J' W Omega e`, summed over edges and contacts into blocks of 1, 3 or 6 rows
//! ([`BlockLayout`]). The sums run in the order of the observations, so that the result does not
//! depend on the number of threads.

use glam::{DMat3, DVec3};

use crate::calib::pose::hat;
use crate::calib::solve::residual::{EdgeTerm, error, linearised};
use crate::calib::{
    CalibError, ContactMeasurement, Displacement, DisplacementId, DisplacementMeasurement, Model,
    Observations, PerObservation, Pose, PoseMeasurement, Poses, ResidualConvention,
};
use crate::id::{IdVec, VertexId};
use crate::numeric::{Matrix6, Twist, dot};
use crate::parallel::par_map;
use crate::sparse::{BlockMatrix, BlockSlot, BlockSystem, Pattern, SparseError};

/// Number of edges that are linearised together: bounds the memory, and fixes the order of sums.
const EDGES_PER_CHUNK: usize = 4096;

/// How the unknowns of a taxel are arranged in blocks of the system.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum BlockLayout {
    /// Positions whose information is the same in every direction: one matrix serves x, y and z.
    Scalar,
    Vector,
    Pose,
}

impl BlockLayout {
    /// The smallest blocks that can represent the information of all observations.
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

    pub(crate) const fn unknowns(self) -> usize {
        self.size() * self.columns()
    }

    pub(crate) const fn columns(self) -> usize {
        if matches!(self, Self::Scalar) { 3 } else { 1 }
    }

    /// The index of unknown `k` of block `row` in a vector of all unknowns, of `blocks` blocks.
    #[inline]
    pub(crate) const fn index(self, blocks: usize, row: u32, k: usize) -> usize {
        match self {
            Self::Scalar => k * blocks + row as usize,
            Self::Vector => 3 * row as usize + k,
            Self::Pose => 6 * row as usize + k,
        }
    }
}

/// Block rows of the taxels for which `moves` is true, in their order, and their number.
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

/// The observations with the slots of their contributions to the linear system.
#[derive(Debug)]
pub(crate) struct Problem<'o> {
    pub(crate) observations: &'o Observations,
    pub(crate) convention: ResidualConvention,
    pub(crate) layout: BlockLayout,
    /// Number of measured numbers of every observation.
    pub(crate) dimensions: PerObservation<usize>,
    /// The block row of every taxel that moves.
    pub(crate) rows: IdVec<VertexId, Option<u32>>,
    pub(crate) system: BlockSystem,
    /// The block of every edge between two moving taxels; `true` if it is that of (to, from).
    slots: IdVec<DisplacementId, Option<(BlockSlot, bool)>>,
}

impl<'o> Problem<'o> {
    pub(crate) fn new(
        observations: &'o Observations,
        convention: ResidualConvention,
    ) -> Result<Self, CalibError> {
        let (rows, count) = number_rows(observations, |v| !observations.taxels[v].fixed);
        let pairs = row_pairs(observations, &rows);
        let layout = BlockLayout::of(observations);
        let system =
            BlockSystem::new(Pattern::new(count, pairs), layout.size()).map_err(CalibError::Sparse)?;
        let slots = observations
            .edges
            .map(|e| pair_of(e, &rows).and_then(|(i, j)| Some((system.slot(i.max(j), i.min(j))?, j > i))));
        let dimensions = PerObservation {
            edges: observations.edges.map(Displacement::rank),
            contacts: observations.contacts.map(|c| c.measurement.rank(observations.model)),
        };
        Ok(Self { observations, convention, layout, dimensions, rows, system, slots })
    }

    pub(crate) fn moving(&self) -> usize {
        self.system.blocks()
    }

    /// The index of unknown `k` of a taxel in a vector of all; `None` if it is fixed.
    pub(crate) fn unknown(&self, taxel: VertexId, k: usize) -> Option<usize> {
        self.rows[taxel].map(|row| self.layout.index(self.moving(), row, k))
    }

    /// Names the taxel that makes the system singular.
    pub(crate) fn explain(&self, error: SparseError) -> CalibError {
        match error {
            SparseError::NotPositiveDefinite { row } | SparseError::NotFinite { row } => {
                let mut taxels = self.rows.iter().zip(&self.observations.taxels);
                let found = taxels.find(|(r, _)| r.is_some_and(|r| r as usize == row));
                CalibError::Undetermined { id: found.map(|(_, taxel)| taxel.id).unwrap_or_default() }
            }
            other => CalibError::Sparse(other),
        }
    }

    /// Squared whitened residual of every observation.
    pub(crate) fn chi2(&self, poses: &Poses) -> PerObservation {
        let Observations { edges, contacts, .. } = self.observations;
        let edge = |e: &Displacement| self.edge_chi2(e, poses);
        PerObservation {
            edges: par_map(edges.as_slice(), edge).into(),
            contacts: contacts.map(|c| self.contact_chi2(&c.measurement, &poses[c.taxel])),
        }
    }

    fn edge_chi2(&self, e: &Displacement, poses: &Poses) -> f64 {
        match &e.measurement {
            DisplacementMeasurement::Offset { offset, information } => {
                information.quadratic_form(&offset_error(e, *offset, poses).to_array())
            }
            DisplacementMeasurement::Relative(m) => {
                let e = error(self.convention, &m.pose, &poses[e.from], &poses[e.to]);
                dot(e, m.information.matrix() * e)
            }
        }
    }

    fn contact_chi2(&self, measurement: &ContactMeasurement, at: &Pose) -> f64 {
        match measurement {
            ContactMeasurement::Position { position, information } => {
                information.quadratic_form(&(at.position - *position).to_array())
            }
            ContactMeasurement::PositionNormal { position, information, normal, normal_information } => {
                let square = information.quadratic_form(&(at.position - *position).to_array());
                let turned = match self.layout {
                    BlockLayout::Pose => (at.rotation * DVec3::Z).distance_squared(*normal),
                    BlockLayout::Scalar | BlockLayout::Vector => 0.0,
                };
                square + normal_information * turned
            }
            ContactMeasurement::Pose { offset, seen } => {
                let e = error(self.convention, &seen.pose, &Pose::default(), &(*at * *offset));
                dot(e, seen.information.matrix() * e)
            }
        }
    }

    /// The Gauss-Newton matrix and the gradient of half the weighted sum of squares.
    pub(crate) fn linearise(&self, poses: &Poses, weights: &PerObservation) -> (BlockMatrix<'_>, Vec<f64>) {
        let mut sums = Accumulator {
            matrix: self.system.zero(),
            gradient: vec![0.0; self.moving() * self.layout.unknowns()],
            layout: self.layout,
            rows: self.moving(),
        };
        let edges = self.observations.edges.as_slice();
        for (chunk, edges) in edges.chunks(EDGES_PER_CHUNK).enumerate() {
            let id = |k: usize| DisplacementId::new(chunk * EDGES_PER_CHUNK + k);
            if self.layout == BlockLayout::Pose {
                let term = |e: &Displacement| match &e.measurement {
                    DisplacementMeasurement::Relative(m) => {
                        Some(EdgeTerm::new(self.convention, m, &poses[e.from], &poses[e.to]))
                    }
                    DisplacementMeasurement::Offset { .. } => None,
                };
                let terms: Vec<Option<EdgeTerm>> = par_map(edges, term);
                for (k, term) in terms.iter().enumerate() {
                    if let Some(term) = term {
                        self.add_relative(&mut sums, id(k), term, weights.edges[id(k)]);
                    }
                }
            } else {
                for (k, edge) in edges.iter().enumerate() {
                    self.add_offset(&mut sums, id(k), edge, poses, weights.edges[id(k)]);
                }
            }
        }
        for (id, contact) in self.observations.contacts.enumerate() {
            if let Some(row) = self.rows[contact.taxel] {
                let (block, gradient) = self.contact_term(&contact.measurement, &poses[contact.taxel]);
                sums.add_block(BlockSlot::diagonal(row), &block, weights.contacts[id], false);
                sums.add_gradient(row, gradient, weights.contacts[id]);
            }
        }
        (sums.matrix, sums.gradient)
    }

    fn add_relative(&self, sums: &mut Accumulator<'_>, id: DisplacementId, term: &EdgeTerm, weight: f64) {
        let edge = &self.observations.edges[id];
        let from = (edge.from, &term.from_from, term.from_gradient);
        for (v, block, gradient) in [from, (edge.to, &term.to_to, term.to_gradient)] {
            if let Some(row) = self.rows[v] {
                sums.add_block(BlockSlot::diagonal(row), block, weight, false);
                sums.add_gradient(row, gradient, weight);
            }
        }
        if let Some((slot, transposed)) = self.slots[id] {
            sums.add_block(slot, &term.from_to, weight, transposed);
        }
    }

    fn add_offset(
        &self,
        sums: &mut Accumulator<'_>,
        id: DisplacementId,
        edge: &Displacement,
        poses: &Poses,
        weight: f64,
    ) {
        let DisplacementMeasurement::Offset { offset, information } = &edge.measurement else { return };
        let omega = information.matrix();
        let gradient = omega * offset_error(edge, *offset, poses);
        for (row, sign) in [(self.rows[edge.from], -1.0), (self.rows[edge.to], 1.0)] {
            if let Some(row) = row {
                sums.matrix.add(BlockSlot::diagonal(row), |a, b| weight * omega.col(b)[a]);
                sums.add_gradient(row, [sign * gradient, DVec3::ZERO], weight);
            }
        }
        if let Some((slot, _)) = self.slots[id] {
            sums.matrix.add(slot, |a, b| -weight * omega.col(b)[a]);
        }
    }

    /// `J' Omega J` and `J' Omega e` of a contact, in the frame in which its taxel moves.
    pub(crate) fn contact_term(&self, measurement: &ContactMeasurement, at: &Pose) -> (Matrix6, Twist) {
        // The rotation is the identity in the positions model.
        let r = DMat3::from_quat(at.rotation);
        match measurement {
            ContactMeasurement::Position { position, information }
            | ContactMeasurement::PositionNormal { position, information, .. } => {
                let omega = information.matrix();
                let mut block = Matrix6::ZERO;
                block.0[0][0] = r.transpose() * omega * r;
                let mut gradient = [r.transpose() * (omega * (at.position - *position)), DVec3::ZERO];
                if let (
                    BlockLayout::Pose,
                    ContactMeasurement::PositionNormal { normal, normal_information, .. },
                ) = (self.layout, measurement)
                {
                    // e = R z - n with the derivative -R hat(z): a rotation about z has no effect.
                    block.0[1][1] = DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0)) * *normal_information;
                    gradient[1] = -*normal_information * DVec3::Z.cross(r.transpose() * *normal);
                }
                (block, gradient)
            }
            ContactMeasurement::Pose { offset, seen } => self.prior_term(offset, seen, at),
        }
    }

    fn prior_term(&self, offset: &Pose, seen: &PoseMeasurement, at: &Pose) -> (Matrix6, Twist) {
        let (e, _, by_frame) = linearised(self.convention, &seen.pose, &Pose::default(), &(*at * *offset));
        // Moving the taxel by (u, w) moves the fixed frame by (R' (u + w x p), R' w).
        let turned = DMat3::from_quat(offset.rotation).transpose();
        let carried = Matrix6([[turned, -(turned * hat(offset.position))], [DMat3::ZERO, turned]]);
        let jacobian = by_frame * carried;
        let omega = seen.information.matrix();
        let back = jacobian.transpose();
        (back * (omega * jacobian), back * (omega * e))
    }

    /// The poses after a step: one block per moving taxel, laid out as the gradient.
    pub(crate) fn advanced(&self, poses: &Poses, step: &[f64]) -> Poses {
        let (layout, moving) = (self.layout, self.moving());
        let vector = |row: u32, k: usize| {
            DVec3::from_array(std::array::from_fn(|c| step[layout.index(moving, row, k + c)]))
        };
        let mut next = poses.clone();
        for (v, pose) in self.rows.ids().zip(next.iter_mut()) {
            let Some(row) = self.rows[v] else { continue };
            if self.layout == BlockLayout::Pose {
                *pose = pose.moved(vector(row, 0), vector(row, 3));
            } else {
                pose.position += vector(row, 0);
            }
        }
        next
    }
}

/// `t_j - t_i - delta`.
fn offset_error(edge: &Displacement, offset: DVec3, poses: &Poses) -> DVec3 {
    poses[edge.to].position - poses[edge.from].position - offset
}

struct Accumulator<'s> {
    matrix: BlockMatrix<'s>,
    gradient: Vec<f64>,
    layout: BlockLayout,
    rows: usize,
}

impl Accumulator<'_> {
    fn add_block(&mut self, slot: BlockSlot, block: &Matrix6, weight: f64, transposed: bool) {
        if transposed {
            self.matrix.add(slot, |a, b| weight * block.entry(b, a));
        } else {
            self.matrix.add(slot, |a, b| weight * block.entry(a, b));
        }
    }

    /// Adds a gradient, for the unknowns of a taxel.
    fn add_gradient(&mut self, row: u32, gradient: Twist, weight: f64) {
        for k in 0..self.layout.unknowns() {
            self.gradient[self.layout.index(self.rows, row, k)] += weight * gradient[k / 3][k % 3];
        }
    }
}
