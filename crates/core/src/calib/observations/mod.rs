//! Observations of the taxels: plain data, the rules that a solve relies on, and the components of the graph
//! of taxels and displacements.

pub(super) mod information;
mod touch_row;
mod validate;

pub use touch_row::{JointMotion, TouchJoint, TouchRow, TouchingBody};

use std::collections::HashMap;
use std::fmt;

use glam::DVec3;

use crate::calib::{Information, Pose};
use crate::id::{IdVec, VertexId, define_id};
use crate::numeric::DisjointSets;
use crate::skin::TaxelId;

define_id!(
    /// A displacement observed between two taxels.
    pub DisplacementId, "e"
);
define_id!(
    /// An observed position of one taxel.
    pub ContactObservationId, "c"
);

/// An edge or a contact.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObservationId {
    /// A displacement between two taxels.
    Edge(DisplacementId),
    /// An absolute observation of one taxel.
    Contact(ContactObservationId),
}

impl fmt::Display for ObservationId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Edge(id) => write!(f, "edge {id}"),
            Self::Contact(id) => write!(f, "contact {id}"),
        }
    }
}

/// One value for every observation.
#[derive(Debug, Clone, PartialEq)]
pub struct PerObservation<T = f64> {
    /// Of every displacement.
    pub edges: IdVec<DisplacementId, T>,
    /// Of every contact.
    pub contacts: IdVec<ContactObservationId, T>,
}

impl<T: Copy> PerObservation<T> {
    pub(crate) fn map<U>(&self, f: impl Fn(T) -> U) -> PerObservation<U> {
        PerObservation { edges: self.edges.map(|&x| f(x)), contacts: self.contacts.map(|&x| f(x)) }
    }

    pub(crate) fn zip<S: Copy, U>(
        &self,
        other: &PerObservation<S>,
        of: impl Fn(T, S) -> U,
    ) -> PerObservation<U> {
        PerObservation {
            edges: self.edges.iter().zip(&other.edges).map(|(&x, &y)| of(x, y)).collect(),
            contacts: self.contacts.iter().zip(&other.contacts).map(|(&x, &y)| of(x, y)).collect(),
        }
    }

    /// Edges first, then contacts.
    pub(crate) fn iter(&self) -> impl Iterator<Item = T> {
        self.edges.iter().chain(&self.contacts).copied()
    }
}

/// The unknowns of a taxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, strum::Display)]
#[strum(serialize_all = "lowercase")]
pub enum Model {
    /// Its position: a linear problem.
    #[default]
    Positions,
    /// Its position and orientation, in SE(3).
    Poses,
}

impl Model {
    pub(crate) const fn unknowns(self) -> usize {
        match self {
            Self::Positions => 3,
            Self::Poses => 6,
        }
    }
}

/// The measurement between two taxels `i` and `j`.
#[derive(Debug, Clone, PartialEq)]
pub enum DisplacementMeasurement {
    /// `t_j - t_i`, in m, in the common frame: the positions model.
    Offset {
        /// The displacement, in m.
        offset: DVec3,
        /// Its information, in 1/m^2.
        information: Information<3>,
    },
    /// `T_i^-1 T_j`: the poses model. Boxed, since it is four times as large as an offset.
    Relative(Box<PoseMeasurement>),
}

/// An observed pose: of taxel `j` in the frame of taxel `i`, or of a fixed frame.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseMeasurement {
    /// The pose.
    pub pose: Pose,
    /// Its information: `x y z` in 1/m^2, then the rotation vector in 1/rad^2, in the observed frame
    /// (order of g2o).
    pub information: Information<6>,
}

/// The source paper's `delta_ji`: a displacement observed between two taxels.
#[derive(Debug, Clone, PartialEq)]
pub struct Displacement {
    /// Taxel `i`.
    pub from: VertexId,
    /// Taxel `j`.
    pub to: VertexId,
    /// The measurement.
    pub measurement: DisplacementMeasurement,
}

impl Displacement {
    /// Whether it has any information; an edge without information joins nothing.
    pub(crate) fn is_observed(&self) -> bool {
        match &self.measurement {
            DisplacementMeasurement::Offset { information, .. } => {
                information.0.iter().flatten().any(|&x| x != 0.0)
            }
            DisplacementMeasurement::Relative(m) => m.information.0.iter().flatten().any(|&x| x != 0.0),
        }
    }

    pub(crate) fn rank(&self) -> usize {
        match &self.measurement {
            DisplacementMeasurement::Offset { information, .. } => information.rank(),
            DisplacementMeasurement::Relative(m) => m.information.rank(),
        }
    }
}

/// An absolute observation of one taxel: it touched an object of known position.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactObservation {
    /// The taxel.
    pub taxel: VertexId,
    /// The measurement.
    pub measurement: ContactMeasurement,
}

/// The measurement of a contact.
#[derive(Debug, Clone, PartialEq)]
pub enum ContactMeasurement {
    /// Its position.
    Position {
        /// The position, in m.
        position: DVec3,
        /// Its information, in 1/m^2.
        information: Information<3>,
    },
    /// Its position and outward normal (the z axis of its frame); the positions model does not use
    /// the normal.
    PositionNormal {
        /// The position, in m.
        position: DVec3,
        /// Its information, in 1/m^2.
        information: Information<3>,
        /// The unit normal.
        normal: DVec3,
        /// Information of the normal, in 1/rad^2.
        normal_information: f64,
    },
    /// The pose of a frame that is fixed to the taxel (g2o's `EDGE_SE3_PRIOR`); poses model only.
    Pose {
        /// The fixed frame in that of the taxel.
        offset: Pose,
        /// The observed pose of the fixed frame.
        seen: Box<PoseMeasurement>,
    },
}

impl ContactMeasurement {
    pub(crate) fn rank(&self, model: Model) -> usize {
        match self {
            Self::Position { information, .. } => information.rank(),
            Self::PositionNormal { information, normal_information, .. } => {
                let has_normal = model == Model::Poses && *normal_information > 0.0;
                information.rank() + if has_normal { 2 } else { 0 }
            }
            Self::Pose { seen, .. } => seen.information.rank(),
        }
    }
}

/// One unknown taxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TaxelVariable {
    /// The vendor's id; unique here.
    pub id: TaxelId,
    /// Its initial pose, if there is one. The orientation is the identity in the positions model.
    pub initial: Option<Pose>,
    /// Whether `initial` is exact: an anchor that does not move.
    pub fixed: bool,
}

/// All that was observed of the taxels of a skin: the graph of equation 1 of the source paper
/// `(cannata)`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Observations {
    /// The unknowns of every taxel.
    pub model: Model,
    /// The taxels.
    pub taxels: IdVec<VertexId, TaxelVariable>,
    /// Displacements between two taxels.
    pub edges: IdVec<DisplacementId, Displacement>,
    /// Absolute observations of one taxel.
    pub contacts: IdVec<ContactObservationId, ContactObservation>,
    /// The touch of every contact; empty if the observations do not name touches. Only
    /// [`fit_bodies`](crate::calib::fit_bodies()) uses it.
    pub touches: IdVec<ContactObservationId, TouchRow>,
    /// The joints with which touches move, if that is known ([`TouchRow::by_joints`]).
    pub joints: Vec<TouchJoint>,
}

impl Observations {
    /// Appends the observations of a touch. `vertices` has the taxels so far; those that are new join it.
    pub fn append(&mut self, touch: &Self, vertices: &mut HashMap<TaxelId, VertexId>) {
        let taxels = &mut self.taxels;
        let place =
            touch.taxels.map(|taxel| *vertices.entry(taxel.id).or_insert_with(|| taxels.push(*taxel)));
        for edge in &touch.edges {
            let (from, to) = (place[edge.from], place[edge.to]);
            self.edges.push(Displacement { from, to, ..edge.clone() });
        }
        for contact in &touch.contacts {
            self.contacts.push(ContactObservation { taxel: place[contact.taxel], ..contact.clone() });
        }
        if self.joints.is_empty() {
            self.joints.clone_from(&touch.joints);
        }
        if !(self.touches.is_empty() && touch.touches.is_empty()) {
            // Contacts without a row are touches of their own.
            let before = self.contacts.len() - touch.contacts.len();
            while self.touches.len() < before {
                self.touches.push(TouchRow::default());
            }
            for contact in touch.contacts.ids() {
                self.touches.push(touch.touch_of(contact));
            }
        }
    }

    /// Multiplies every length by `factor`, which is above 0: metres for a file in millimetres are
    /// `scale(1e-3)`. Information of lengths is divided by its square.
    pub fn scale(&mut self, factor: f64) {
        let initial = self.taxels.iter_mut().filter_map(|taxel| taxel.initial.as_mut());
        initial.for_each(|pose| pose.position *= factor);
        for edge in self.edges.iter_mut() {
            match &mut edge.measurement {
                DisplacementMeasurement::Offset { offset, information } => {
                    *offset *= factor;
                    scale_lengths(information, factor);
                }
                DisplacementMeasurement::Relative(relative) => scale_pose(relative, factor),
            }
        }
        for contact in self.contacts.iter_mut() {
            match &mut contact.measurement {
                ContactMeasurement::Position { position, information }
                | ContactMeasurement::PositionNormal { position, information, .. } => {
                    *position *= factor;
                    scale_lengths(information, factor);
                }
                ContactMeasurement::Pose { offset, seen } => {
                    offset.position *= factor;
                    scale_pose(seen, factor);
                }
            }
        }
        for row in self.touches.iter_mut() {
            if let Some(body) = &mut row.body {
                (body.centre, body.radius) = (body.centre * factor, body.radius * factor);
            }
            for vector in [&mut row.path, &mut row.velocity].into_iter().flatten() {
                *vector *= factor;
            }
            // A joint that slides by a length moves the body by a length.
            let turning = self.joints.iter().map(|joint| joint.motion == JointMotion::Turns);
            for (column, _) in row.by_joints.iter_mut().zip(turning).filter(|(_, turns)| *turns) {
                *column *= factor;
            }
        }
    }
}

fn scale_pose(measured: &mut PoseMeasurement, factor: f64) {
    measured.pose.position *= factor;
    scale_lengths(&mut measured.information, factor);
}

/// The first three rows and columns are those of lengths, the others those of angles.
fn scale_lengths<const N: usize>(information: &mut Information<N>, factor: f64) {
    let unit = |k: usize| if k < 3 { factor } else { 1.0 };
    for (i, row) in information.0.iter_mut().enumerate() {
        row.iter_mut().enumerate().for_each(|(j, x)| *x /= unit(i) * unit(j));
    }
}

pub(crate) type Poses = IdVec<VertexId, Pose>;

/// Taxels that edges join.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Component {
    /// Its taxels, ascending.
    pub(crate) taxels: Vec<VertexId>,
    pub(crate) fixed: bool,
    /// The taxel that keeps its pose if no contact determines that of the component: the first with
    /// an initial value, else the first.
    pub(crate) gauge: VertexId,
}

/// The connected components of the graph of edges with information for which `counts` is true, in the order
/// of their first taxels; and the index of the component of every taxel.
pub(crate) fn components(
    observations: &Observations,
    counts: impl Fn(DisplacementId) -> bool,
) -> (Vec<Component>, IdVec<VertexId, usize>) {
    let taxels = &observations.taxels;
    let mut sets = DisjointSets::<VertexId>::new(taxels.len());
    for (_, edge) in observations.edges.enumerate().filter(|(id, e)| counts(*id) && e.is_observed()) {
        sets.join(edge.from, edge.to);
    }
    let of_taxel = sets.labels();
    let empty = |gauge| Component { taxels: Vec::new(), fixed: false, gauge };
    let mut components: Vec<Component> = of_taxel.firsts().into_iter().map(empty).collect();
    for (v, &number) in of_taxel.of.enumerate() {
        let component = &mut components[number];
        component.taxels.push(v);
        component.fixed |= taxels[v].fixed;
        if taxels[component.gauge].initial.is_none() && taxels[v].initial.is_some() {
            component.gauge = v;
        }
    }
    (components, of_taxel.of)
}
