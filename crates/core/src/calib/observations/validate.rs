//! Checks of everything that a solve relies on, and a repair of information that is not positive
//! semi-definite, which public pose graphs contain.

use std::collections::HashSet;

use crate::calib::{
    CalibError, ContactMeasurement, ContactObservation, ContactObservationId, Displacement, DisplacementId,
    DisplacementMeasurement, Information, Model, ObservationId, Observations,
};
use crate::id::VertexId;
use crate::mesh::is_within_reach;
use crate::skin::TaxelId;

impl Observations {
    /// Checks everything that [`crate::calib::calibrate`] relies on.
    ///
    /// # Errors
    /// The first broken rule, with the element.
    pub fn validate(&self) -> Result<(), CalibError> {
        let observations = self.edges.len() + self.contacts.len();
        if self.taxels.is_empty() || observations == 0 {
            return Err(CalibError::Empty { taxels: self.taxels.len(), observations });
        }
        self.check_taxels()?;
        self.edges.enumerate().try_for_each(|(edge, displacement)| self.check_edge(edge, displacement))?;
        self.contacts.enumerate().try_for_each(|(id, contact)| self.check_contact(id, contact))?;
        self.check_touches()?;
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

    fn check_index(&self, observation: ObservationId, vertex: VertexId) -> Result<TaxelId, CalibError> {
        let dangling = || CalibError::Dangling { observation, vertex, taxels: self.taxels.len() };
        self.taxels.get(vertex).map(|t| t.id).ok_or_else(dangling)
    }

    fn check_edge(&self, edge: DisplacementId, displacement: &Displacement) -> Result<(), CalibError> {
        let observation = ObservationId::Edge(edge);
        let from = self.check_index(observation, displacement.from)?;
        let to = self.check_index(observation, displacement.to)?;
        if from == to {
            return Err(CalibError::SelfEdge { edge, id: from });
        }
        let (fits, finite, (symmetric, definite)) = match &displacement.measurement {
            DisplacementMeasurement::Offset { offset, information } => {
                (self.model == Model::Positions, is_within_reach(*offset), judged(information))
            }
            DisplacementMeasurement::Relative(m) => {
                (self.model == Model::Poses, m.pose.is_valid(), judged(&m.information))
            }
        };
        if !fits {
            let needed = "displacements t_j - t_i for positions, relative poses for poses";
            return Err(CalibError::WrongModel { observation, id: from, model: self.model, needed });
        }
        if !finite {
            return Err(CalibError::InvalidEdge { edge, from, to });
        }
        if !symmetric {
            return Err(CalibError::AsymmetricEdge { edge, from, to });
        }
        if !definite {
            let eigenvalue = match &displacement.measurement {
                DisplacementMeasurement::Offset { information, .. } => information.eigenvalues()[0],
                DisplacementMeasurement::Relative(m) => m.information.eigenvalues()[0],
            };
            let (count, of) = (self.indefinite_edges(), self.edges.len());
            return Err(CalibError::IndefiniteEdge { edge, from, to, eigenvalue, count, of });
        }
        Ok(())
    }

    fn check_contact(
        &self,
        contact: ContactObservationId,
        touched: &ContactObservation,
    ) -> Result<(), CalibError> {
        let observation = ObservationId::Contact(contact);
        let id = self.check_index(observation, touched.taxel)?;
        let invalid = |reason| Err(CalibError::InvalidContact { contact, id, reason });
        const NOT_A_POSE: &str = "it contains a number that is not finite, a length above 1e12 m or a quaternion not of unit length";
        let (symmetric, definite) = match &touched.measurement {
            ContactMeasurement::Position { position, information }
            | ContactMeasurement::PositionNormal { position, information, .. } => {
                if !is_within_reach(*position) {
                    return invalid("its position is not finite or not within 1e12 m");
                }
                judged(information)
            }
            ContactMeasurement::Pose { offset, seen } => {
                if self.model == Model::Positions {
                    let needed = "positions, with or without normal";
                    return Err(CalibError::WrongModel { observation, id, model: self.model, needed });
                }
                if !seen.pose.is_valid() || !offset.is_valid() {
                    return invalid(NOT_A_POSE);
                }
                judged(&seen.information)
            }
        };
        if !symmetric {
            return invalid("its information matrix is not symmetric");
        }
        if !definite {
            return invalid("its information matrix is not positive semi-definite");
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

    /// How many edges have finite information that is not positive semi-definite.
    fn indefinite_edges(&self) -> usize {
        self.edges.iter().filter(|edge| edge.is_indefinite()).count()
    }

    /// Replaces the information of edges and contacts that is not positive semi-definite by the
    /// nearest matrix that is; returns how many were replaced.
    pub fn clip_information(&mut self) -> usize {
        let mut clipped = 0;
        for edge in self.edges.iter_mut() {
            clipped += usize::from(match &mut edge.measurement {
                DisplacementMeasurement::Offset { information, .. } => clip(information),
                DisplacementMeasurement::Relative(m) => clip(&mut m.information),
            });
        }
        for contact in self.contacts.iter_mut() {
            match &mut contact.measurement {
                ContactMeasurement::Position { information, .. }
                | ContactMeasurement::PositionNormal { information, .. } => {
                    clipped += usize::from(clip(information));
                }
                ContactMeasurement::Pose { seen, .. } => clipped += usize::from(clip(&mut seen.information)),
            }
        }
        clipped
    }
}

/// Whether information is symmetric, and positive semi-definite.
fn judged<const N: usize>(information: &Information<N>) -> (bool, bool) {
    (information.is_symmetric(), information.is_positive_semidefinite())
}

/// Clips indefinite information; returns whether it was indefinite.
fn clip<const N: usize>(information: &mut Information<N>) -> bool {
    let is_indefinite = information.is_indefinite();
    if is_indefinite {
        *information = information.clipped();
    }
    is_indefinite
}

impl Displacement {
    fn is_indefinite(&self) -> bool {
        match &self.measurement {
            DisplacementMeasurement::Offset { information, .. } => information.is_indefinite(),
            DisplacementMeasurement::Relative(m) => m.information.is_indefinite(),
        }
    }
}
