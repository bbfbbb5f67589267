use glam::{DMat3, DVec3};

use crate::{
    calib::{
        CalibError, ContactMeasurement, ContactObservationId, Displacement, DisplacementId,
        DisplacementMeasurement, Model, Observations, Pose, PosePrior, ResidualConvention,
        geometry::pose::hat,
        solve::residual::{EdgeTerm, error, linearised},
    },
    id::{IdVec, VertexId},
    numeric::{Matrix6, Twist, dot},
    parallel::par_map,
    sparse::{BlockMatrix, BlockSlot, BlockSystem, Pattern, SparseError},
};

/// Where every taxel is thought to be.
pub(crate) type State = IdVec<VertexId, Pose>;

/// One value for every observation.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PerObservation<T = f64> {
    pub(crate) edges: IdVec<DisplacementId, T>,
    pub(crate) contacts: IdVec<ContactObservationId, T>,
}

impl<T: Copy> PerObservation<T> {
    pub(crate) fn map<U>(&self, f: impl Fn(T) -> U) -> PerObservation<U> {
        PerObservation { edges: self.edges.map(|&x| f(x)), contacts: self.contacts.map(|&x| f(x)) }
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = T> {
        self.edges.iter().chain(&self.contacts).copied()
    }
}

/// How much of a taxel shares one block of the system.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shape {
    /// Positions whose information is the same in every direction: one matrix serves x, y and z.
    Scalar,
    /// Positions.
    Vector,
    /// Poses.
    Pose,
}

impl Shape {
    /// Rows of a block.
    pub(crate) const fn size(self) -> usize {
        match self {
            Self::Scalar => 1,
            Self::Vector => 3,
            Self::Pose => 6,
        }
    }

    /// Right-hand sides.
    pub(crate) const fn columns(self) -> usize {
        if matches!(self, Self::Scalar) { 3 } else { 1 }
    }
}

/// Edges linearised at a time: bounds the memory, and the order of sums does not depend on threads.
const EDGES_PER_CHUNK: usize = 4096;

/// The observations with the places of their contributions in the linear system.
#[derive(Debug)]
pub(crate) struct Problem<'o> {
    pub(crate) observations: &'o Observations,
    pub(crate) convention: ResidualConvention,
    pub(crate) shape: Shape,
    /// How many numbers every observation observes.
    pub(crate) ranks: PerObservation<usize>,
    /// The block row of every taxel that moves.
    pub(crate) rows: IdVec<VertexId, Option<u32>>,
    pub(crate) system: BlockSystem,
    /// The block of every edge between two taxels that move; `true` where it is that of (to, from).
    slots: IdVec<DisplacementId, Option<(BlockSlot, bool)>>,
}

impl<'o> Problem<'o> {
    pub(crate) fn new(
        observations: &'o Observations,
        convention: ResidualConvention,
    ) -> Result<Self, CalibError> {
        let (rows, count) = number_rows(observations, |v| !observations.taxels[v].fixed);
        let pairs = row_pairs(observations, &rows);
        let shape = shape_of(observations);
        let system =
            BlockSystem::new(Pattern::new(count, pairs), shape.size()).map_err(CalibError::Sparse)?;
        let slots = observations
            .edges
            .map(|e| pair_of(e, &rows).and_then(|(i, j)| Some((system.slot(i.max(j), i.min(j))?, j > i))));
        let ranks = PerObservation {
            edges: observations.edges.map(Displacement::rank),
            contacts: observations.contacts.map(|c| c.measurement.rank(observations.model)),
        };
        Ok(Self { observations, convention, shape, ranks, rows, system, slots })
    }

    /// Number of taxels that move.
    pub(crate) fn moving(&self) -> usize {
        self.system.blocks()
    }

    /// The taxel of a block row.
    pub(crate) fn taxel_of(&self, row: usize) -> Option<VertexId> {
        self.rows.enumerate().find(|(_, r)| r.is_some_and(|r| r as usize == row)).map(|(v, _)| v)
    }

    /// Says which taxel makes the system singular.
    pub(crate) fn explain(&self, error: SparseError) -> CalibError {
        match error {
            SparseError::NotPositiveDefinite { row } | SparseError::NotFinite { row } => {
                let id = self.taxel_of(row).map_or_else(Default::default, |v| self.observations.taxels[v].id);
                CalibError::Undetermined { id }
            }
            other => CalibError::Sparse(other),
        }
    }

    /// Squared error of every observation, over its variance.
    pub(crate) fn squares(&self, state: &State) -> PerObservation {
        let Observations { edges, contacts, .. } = self.observations;
        let square = |e: &Displacement| self.square(e, state);
        PerObservation {
            edges: par_map(edges.as_slice(), square).into(),
            contacts: contacts.map(|c| self.touch_square(&c.measurement, &state[c.taxel])),
        }
    }

    /// Squared error of one edge, over its variance.
    pub(crate) fn edge_square(&self, edge: DisplacementId, state: &State) -> f64 {
        self.square(&self.observations.edges[edge], state)
    }

    fn square(&self, e: &Displacement, state: &State) -> f64 {
        match &e.measurement {
            DisplacementMeasurement::Offset { offset, information } => {
                information.square(&offset_error(e, *offset, state).to_array())
            }
            DisplacementMeasurement::Relative(m) => {
                let e = error(self.convention, &m.pose, &state[e.from], &state[e.to]);
                dot(e, Matrix6::from_rows(&m.information.0) * e)
            }
        }
    }

    pub(crate) fn touch_square(&self, touch: &ContactMeasurement, at: &Pose) -> f64 {
        match touch {
            ContactMeasurement::Position { position, information } => {
                information.square(&(at.position - *position).to_array())
            }
            ContactMeasurement::PositionNormal { position, information, normal, normal_information } => {
                let square = information.square(&(at.position - *position).to_array());
                let turned = match self.shape {
                    Shape::Pose => (at.rotation * DVec3::Z).distance_squared(*normal),
                    Shape::Scalar | Shape::Vector => 0.0,
                };
                square + normal_information * turned
            }
            ContactMeasurement::Pose(prior) => {
                let e = error(self.convention, &prior.pose, &Pose::IDENTITY, &(*at * prior.offset));
                dot(e, Matrix6::from_rows(&prior.information.0) * e)
            }
        }
    }

    /// The Gauss-Newton matrix and the gradient of half the weighted sum of squares.
    pub(crate) fn linearise(&self, state: &State, weights: &PerObservation) -> (BlockMatrix<'_>, Vec<f64>) {
        let mut sums = Sums {
            matrix: self.system.zero(),
            gradient: vec![0.0; self.moving() * self.shape.size() * self.shape.columns()],
            shape: self.shape,
            rows: self.moving(),
        };
        let edges = self.observations.edges.as_slice();
        for (chunk, edges) in edges.chunks(EDGES_PER_CHUNK).enumerate() {
            let id = |k: usize| DisplacementId::new(chunk * EDGES_PER_CHUNK + k);
            if self.shape == Shape::Pose {
                let terms: Vec<Option<EdgeTerm>> = par_map(edges, |e| self.relative_term(e, state));
                for (k, term) in terms.iter().enumerate() {
                    if let Some(term) = term {
                        self.add_relative(&mut sums, id(k), term, weights.edges[id(k)]);
                    }
                }
            } else {
                for (k, edge) in edges.iter().enumerate() {
                    self.add_offset(&mut sums, id(k), edge, state, weights.edges[id(k)]);
                }
            }
        }
        for (id, contact) in self.observations.contacts.enumerate() {
            if let Some(row) = self.rows[contact.taxel] {
                let weight = weights.contacts[id];
                self.add_touch(&mut sums, row, &contact.measurement, &state[contact.taxel], weight);
            }
        }
        (sums.matrix, sums.gradient)
    }

    fn relative_term(&self, edge: &Displacement, state: &State) -> Option<EdgeTerm> {
        match &edge.measurement {
            DisplacementMeasurement::Relative(m) => {
                Some(EdgeTerm::new(self.convention, m, &state[edge.from], &state[edge.to]))
            }
            DisplacementMeasurement::Offset { .. } => None,
        }
    }

    fn add_relative(&self, sums: &mut Sums<'_>, id: DisplacementId, term: &EdgeTerm, weight: f64) {
        let edge = &self.observations.edges[id];
        if let Some(row) = self.rows[edge.from] {
            sums.add_quarters(BlockSlot::diagonal(row), &term.from_from, weight, false);
            sums.add_twist(row, term.from_gradient, weight);
        }
        if let Some(row) = self.rows[edge.to] {
            sums.add_quarters(BlockSlot::diagonal(row), &term.to_to, weight, false);
            sums.add_twist(row, term.to_gradient, weight);
        }
        if let Some((slot, transposed)) = self.slots[id] {
            sums.add_quarters(slot, &term.from_to, weight, transposed);
        }
    }

    fn add_offset(
        &self,
        sums: &mut Sums<'_>,
        id: DisplacementId,
        edge: &Displacement,
        state: &State,
        weight: f64,
    ) {
        let DisplacementMeasurement::Offset { offset, information } = &edge.measurement else { return };
        let omega = information.matrix();
        let gradient = omega * offset_error(edge, *offset, state);
        for (row, sign) in [(self.rows[edge.from], -1.0), (self.rows[edge.to], 1.0)] {
            if let Some(row) = row {
                sums.matrix.add(BlockSlot::diagonal(row), |a, b| weight * omega.col(b)[a]);
                sums.add_vector(row, 0, weight * sign * gradient);
            }
        }
        if let Some((slot, _)) = self.slots[id] {
            sums.matrix.add(slot, |a, b| -weight * omega.col(b)[a]);
        }
    }

    fn add_touch(&self, sums: &mut Sums<'_>, row: u32, touch: &ContactMeasurement, at: &Pose, weight: f64) {
        let (block, gradient) = self.touch_term(touch, at);
        sums.add_quarters(BlockSlot::diagonal(row), &block, weight, false);
        match self.shape {
            Shape::Pose => sums.add_twist(row, gradient, weight),
            Shape::Scalar | Shape::Vector => sums.add_vector(row, 0, weight * gradient[0]),
        }
    }

    /// `J' Omega J` and `J' Omega e` of a contact, in the frame in which its taxel moves.
    pub(crate) fn touch_term(&self, touch: &ContactMeasurement, at: &Pose) -> (Matrix6, Twist) {
        // The rotation is the identity in the positions model.
        let r = DMat3::from_quat(at.rotation);
        match touch {
            ContactMeasurement::Position { position, information }
            | ContactMeasurement::PositionNormal { position, information, .. } => {
                let omega = information.matrix();
                let mut block = Matrix6::ZERO;
                block.0[0][0] = r.transpose() * omega * r;
                let mut gradient = [r.transpose() * (omega * (at.position - *position)), DVec3::ZERO];
                if let (Shape::Pose, ContactMeasurement::PositionNormal { normal, normal_information, .. }) =
                    (self.shape, touch)
                {
                    // e = R z - n with the derivative -R hat(z): turning about z changes nothing.
                    block.0[1][1] = DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0)) * *normal_information;
                    gradient[1] = -*normal_information * DVec3::Z.cross(r.transpose() * *normal);
                }
                (block, gradient)
            }
            ContactMeasurement::Pose(prior) => self.prior_term(prior, at),
        }
    }

    fn prior_term(&self, prior: &PosePrior, at: &Pose) -> (Matrix6, Twist) {
        let (e, _, by_frame) =
            linearised(self.convention, &prior.pose, &Pose::IDENTITY, &(*at * prior.offset));
        // Moving the taxel by (u, w) moves the fixed frame by (R' (u + w x p), R' w).
        let turned = DMat3::from_quat(prior.offset.rotation).transpose();
        let carried = Matrix6([[turned, -(turned * hat(prior.offset.position))], [DMat3::ZERO, turned]]);
        let jacobian = by_frame * carried;
        let omega = Matrix6::from_rows(&prior.information.0);
        let back = jacobian.transpose();
        (back * (omega * jacobian), back * (omega * e))
    }

    /// The state after a step: one block per moving taxel, as the gradient is laid out.
    pub(crate) fn advanced(&self, state: &State, step: &[f64]) -> State {
        let vector = |row: usize, k: usize| match self.shape {
            Shape::Scalar => DVec3::from_array(std::array::from_fn(|c| step[c * self.moving() + row])),
            Shape::Vector => DVec3::from_slice(&step[3 * row..]),
            Shape::Pose => DVec3::from_slice(&step[6 * row + k..]),
        };
        let mut next = state.clone();
        for (v, pose) in self.rows.ids().zip(next.iter_mut()) {
            let Some(row) = self.rows[v] else { continue };
            let row = row as usize;
            if self.shape == Shape::Pose {
                *pose = pose.moved(vector(row, 0), vector(row, 3));
            } else {
                pose.position += vector(row, 0);
            }
        }
        next
    }
}

/// `t_j - t_i - delta`.
fn offset_error(edge: &Displacement, offset: DVec3, state: &State) -> DVec3 {
    state[edge.to].position - state[edge.from].position - offset
}

/// Numbers the taxels that `moves` in their order.
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

fn shape_of(observations: &Observations) -> Shape {
    let round_edge = |e: &Displacement| match &e.measurement {
        DisplacementMeasurement::Offset { information, .. } => information.as_isotropic().is_some(),
        DisplacementMeasurement::Relative(_) => false,
    };
    let round_touch = |touch: &ContactMeasurement| match touch {
        ContactMeasurement::Position { information, .. }
        | ContactMeasurement::PositionNormal { information, .. } => information.as_isotropic().is_some(),
        ContactMeasurement::Pose(_) => false,
    };
    match observations.model {
        Model::Poses => Shape::Pose,
        Model::Positions
            if observations.edges.iter().all(round_edge)
                && observations.contacts.iter().all(|c| round_touch(&c.measurement)) =>
        {
            Shape::Scalar
        }
        Model::Positions => Shape::Vector,
    }
}

/// The system while it is summed up.
struct Sums<'s> {
    matrix: BlockMatrix<'s>,
    gradient: Vec<f64>,
    shape: Shape,
    rows: usize,
}

impl Sums<'_> {
    fn add_quarters(&mut self, slot: BlockSlot, block: &Matrix6, weight: f64, transposed: bool) {
        if transposed {
            self.matrix.add(slot, |a, b| weight * block.entry(b, a));
        } else {
            self.matrix.add(slot, |a, b| weight * block.entry(a, b));
        }
    }

    fn add_twist(&mut self, row: u32, gradient: Twist, weight: f64) {
        self.add_vector(row, 0, weight * gradient[0]);
        self.add_vector(row, 3, weight * gradient[1]);
    }

    fn add_vector(&mut self, row: u32, k: usize, x: DVec3) {
        let row = row as usize;
        for (c, x) in x.to_array().into_iter().enumerate() {
            let at = match self.shape {
                Shape::Scalar => c * self.rows + row,
                Shape::Vector => 3 * row + c,
                Shape::Pose => 6 * row + k + c,
            };
            self.gradient[at] += x;
        }
    }
}
