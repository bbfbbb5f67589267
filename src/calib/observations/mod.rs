//! What was observed of the taxels: plain data, and the promises that a solve relies on.

pub(super) mod graph;
pub(super) mod information;
pub(super) mod per_observation;
mod clip;
mod units;
mod validate;

use std::fmt;

use glam::DVec3;

use crate::{
    calib::{Information, Pose},
    id::{IdVec, VertexId, define_id},
    skin::TaxelId,
};

define_id!(
    /// A displacement observed between two taxels.
    pub DisplacementId, "e"
);
define_id!(
    /// An observed position of one taxel.
    pub ContactObservationId, "c"
);

/// What is unknown of a taxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Model {
    /// Its position: a linear problem.
    #[default]
    Positions,
    /// Its position and orientation, in SE(3).
    Poses,
}

impl fmt::Display for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&format!("{self:?}").to_lowercase())
    }
}

impl Model {
    pub(crate) const fn unknowns(self) -> usize {
        match self {
            Self::Positions => 3,
            Self::Poses => 6,
        }
    }
}

/// What was observed between two taxels `i` and `j`.
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

/// A pose as it was observed: of taxel `j` in the frame of taxel `i`, or of a fixed frame.
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
    /// What was observed.
    pub measurement: DisplacementMeasurement,
}

impl Displacement {
    /// Whether it has any information; an edge without any joins nothing.
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

/// An absolute observation of one taxel: it touched something whose place is known.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactObservation {
    /// The taxel.
    pub taxel: VertexId,
    /// What was observed.
    pub measurement: ContactMeasurement,
}

/// What a contact measures of a taxel.
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
        /// Where the fixed frame was observed.
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
    /// The vendor's number; unique here.
    pub id: TaxelId,
    /// Its initial pose, if there is one. Orientation is the identity in the positions model.
    pub initial: Option<Pose>,
    /// Whether `initial` is known exactly: an anchor that does not move.
    pub fixed: bool,
}

/// All that was observed of the taxels of a skin: the graph of equation 1 of the source paper
/// (cannata).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Observations {
    /// What is unknown of every taxel.
    pub model: Model,
    /// The taxels.
    pub taxels: IdVec<VertexId, TaxelVariable>,
    /// Displacements between two taxels.
    pub edges: IdVec<DisplacementId, Displacement>,
    /// Absolute observations of one taxel.
    pub contacts: IdVec<ContactObservationId, ContactObservation>,
}
