pub(crate) mod graph;
pub(crate) mod information;

use std::{collections::HashSet, fmt::Display};

use glam::DVec3;

use crate::{
    calib::{CalibError, Information, Pose},
    id::{IdVec, VertexId, define_id},
    skin::TaxelId,
};

define_id!(
    /// A displacement observed between two taxels.
    DisplacementId, "e"
);
define_id!(
    /// An observed position of one taxel.
    ContactObservationId, "c"
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

impl Model {
    /// `positions` or `poses`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Positions => "positions",
            Self::Poses => "poses",
        }
    }

    /// TaxelVariable numbers of one taxel.
    #[must_use]
    pub const fn unknowns(self) -> usize {
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
    Relative(Box<RelativePose>),
}

/// The pose of taxel `j` in the frame of taxel `i`, as it was observed.
#[derive(Debug, Clone, PartialEq)]
pub struct RelativePose {
    /// The pose of `j` in the frame of `i`.
    pub pose: Pose,
    /// Its information: `x y z` in 1/m^2, then the rotation vector in 1/rad^2, in the frame of `j` (order of g2o).
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
    /// Whether it says anything: zero information is no edge.
    pub(crate) fn is_observed(&self) -> bool {
        match &self.measurement {
            DisplacementMeasurement::Offset { information, .. } => {
                information.0.iter().flatten().any(|&x| x != 0.0)
            }
            DisplacementMeasurement::Relative(m) => m.information.0.iter().flatten().any(|&x| x != 0.0),
        }
    }

    /// How many numbers it observes.
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

/// What a contact says about a taxel.
#[derive(Debug, Clone, PartialEq)]
pub enum ContactMeasurement {
    /// Its position.
    Position {
        /// The position, in m.
        position: DVec3,
        /// Its information, in 1/m^2.
        information: Information<3>,
    },
    /// Its position and outward normal (the z axis of its frame); in the positions model the normal says nothing.
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
    /// The pose of a frame that is fixed to the taxel; poses model only.
    Pose(Box<PosePrior>),
}

impl ContactMeasurement {
    /// How many numbers it observes.
    pub(crate) fn rank(&self, model: Model) -> usize {
        match self {
            Self::Position { information, .. } => information.rank(),
            Self::PositionNormal { information, normal_information, .. } => {
                let says_normal = model == Model::Poses && *normal_information > 0.0;
                information.rank() + if says_normal { 2 } else { 0 }
            }
            Self::Pose(prior) => prior.information.rank(),
        }
    }
}

/// A known pose of a frame fixed to a taxel (g2o's `EDGE_SE3_PRIOR`).
#[derive(Debug, Clone, PartialEq)]
pub struct PosePrior {
    /// The observed pose of the fixed frame.
    pub pose: Pose,
    /// The fixed frame in that of the taxel.
    pub offset: Pose,
    /// Information as in [`RelativePose::information`], in the observed frame.
    pub information: Information<6>,
}

/// One unknown taxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TaxelVariable {
    /// The vendor's number; unique here.
    pub id: TaxelId,
    /// Where it is thought to be, if anyone knows. Orientation is the identity in the positions model.
    pub initial: Option<Pose>,
    /// Whether `initial` is known exactly: an anchor that does not move.
    pub fixed: bool,
}

/// All that was observed of the taxels of a skin: the graph of the source paper's equation 1.
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

impl Observations {
    /// Checks everything that [`crate::calib::calibrate`] relies on.
    ///
    /// # Errors
    /// The first broken promise: which element, what was found, what is needed.
    pub fn validate(&self) -> Result<(), CalibError> {
        let observations = self.edges.len() + self.contacts.len();
        if self.taxels.is_empty() || observations == 0 {
            return Err(CalibError::Empty { taxels: self.taxels.len(), observations });
        }
        self.check_taxels()?;
        for (edge, displacement) in self.edges.enumerate() {
            self.check_edge(edge, displacement)?;
        }
        for (id, contact) in self.contacts.enumerate() {
            self.check_contact(id, contact)?;
        }
        self.check_observed()
    }

    fn check_taxels(&self) -> Result<(), CalibError> {
        let mut seen = HashSet::with_capacity(self.taxels.len());
        for taxel in &self.taxels {
            if !seen.insert(taxel.id) {
                return Err(CalibError::DuplicateTaxel { id: taxel.id });
            }
            if taxel.initial.is_none() && taxel.fixed {
                return Err(CalibError::FixedNowhere { id: taxel.id });
            }
            if taxel.initial.is_some_and(|p| !p.is_valid()) {
                return Err(CalibError::InvalidInitial { id: taxel.id });
            }
        }
        Ok(())
    }

    fn check_index(&self, element: impl Display, vertex: VertexId) -> Result<TaxelId, CalibError> {
        let dangling = || CalibError::Dangling {
            element: element.to_string(),
            vertex: vertex.index(),
            taxels: self.taxels.len(),
        };
        self.taxels.get(vertex).map(|t| t.id).ok_or_else(dangling)
    }

    fn check_edge(&self, edge: DisplacementId, displacement: &Displacement) -> Result<(), CalibError> {
        let from = self.check_index(format_args!("edge {edge}"), displacement.from)?;
        let to = self.check_index(format_args!("edge {edge}"), displacement.to)?;
        if from == to {
            return Err(CalibError::SelfEdge { edge, id: from });
        }
        let (fits, finite, definite) = match &displacement.measurement {
            DisplacementMeasurement::Offset { offset, information } => {
                (self.model == Model::Positions, offset.is_finite(), information.is_positive_semidefinite())
            }
            DisplacementMeasurement::Relative(m) => {
                (self.model == Model::Poses, m.pose.is_valid(), m.information.is_positive_semidefinite())
            }
        };
        if !fits {
            let needed = "displacements t_j - t_i for positions, relative poses for poses";
            let element = format!("edge {edge}");
            return Err(CalibError::WrongModel { element, id: from, model: self.model.name(), needed });
        }
        if !finite {
            return Err(CalibError::InvalidEdge { edge, from, to });
        }
        if !definite {
            let eigenvalue = match &displacement.measurement {
                DisplacementMeasurement::Offset { information, .. } => information.eigenvalues()[0],
                DisplacementMeasurement::Relative(m) => m.information.eigenvalues()[0],
            };
            return Err(CalibError::IndefiniteEdge { edge, from, to, eigenvalue });
        }
        Ok(())
    }

    fn check_contact(
        &self,
        contact: ContactObservationId,
        touched: &ContactObservation,
    ) -> Result<(), CalibError> {
        let id = self.check_index(format_args!("contact {contact}"), touched.taxel)?;
        let invalid = |reason| Err(CalibError::InvalidContact { contact, id, reason });
        const INDEFINITE: &str = "its information matrix is not positive semi-definite";
        match &touched.measurement {
            ContactMeasurement::Position { position, information }
            | ContactMeasurement::PositionNormal { position, information, .. } => {
                if !position.is_finite() {
                    return invalid("its position is not finite");
                }
                if !information.is_positive_semidefinite() {
                    return invalid(INDEFINITE);
                }
            }
            ContactMeasurement::Pose(prior) => {
                if self.model == Model::Positions {
                    let needed = "positions, with or without normal";
                    let element = format!("contact {contact}");
                    return Err(CalibError::WrongModel { element, id, model: self.model.name(), needed });
                }
                if !prior.pose.is_valid() || !prior.offset.is_valid() {
                    return invalid(
                        "it holds a number that is not finite or a quaternion not of unit length",
                    );
                }
                if !prior.information.is_positive_semidefinite() {
                    return invalid(INDEFINITE);
                }
            }
        }
        if let ContactMeasurement::PositionNormal { normal, normal_information, .. } = &touched.measurement {
            if !normal.is_normalized() {
                return invalid("its normal is not of unit length");
            }
            if !(*normal_information >= 0.0 && normal_information.is_finite()) {
                return invalid("the information of its normal is negative or not finite");
            }
        }
        Ok(())
    }

    fn check_observed(&self) -> Result<(), CalibError> {
        let mut observed = self.taxels.map(|t| t.fixed);
        for edge in self.edges.iter().filter(|e| e.is_observed()) {
            observed[edge.from] = true;
            observed[edge.to] = true;
        }
        for contact in self.contacts.iter().filter(|c| c.measurement.rank(self.model) > 0) {
            observed[contact.taxel] = true;
        }
        let mut unobserved = observed.enumerate().filter(|(_, seen)| !**seen).map(|(v, _)| v);
        match unobserved.next() {
            Some(v) => Err(CalibError::Unobserved { id: self.taxels[v].id, others: unobserved.count() }),
            None => Ok(()),
        }
    }
}
