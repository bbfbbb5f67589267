//! Indefinite information: what public pose graphs hold, made usable on request.

use crate::calib::{ContactMeasurement, Displacement, DisplacementMeasurement, Observations};

impl Observations {
    /// How many edges have finite information that is not positive semi-definite.
    #[must_use]
    pub fn indefinite_edges(&self) -> usize {
        self.edges.iter().filter(|edge| edge.is_indefinite()).count()
    }

    /// Replaces the information of edges and contacts that is not positive semi-definite by the
    /// nearest matrix that is; returns how many were replaced.
    pub fn clip_information(&mut self) -> usize {
        let mut clipped = 0;
        for edge in self.edges.iter_mut().filter(|edge| edge.is_indefinite()) {
            clipped += 1;
            match &mut edge.measurement {
                DisplacementMeasurement::Offset { information, .. } => *information = information.clipped(),
                DisplacementMeasurement::Relative(m) => m.information = m.information.clipped(),
            }
        }
        for contact in self.contacts.iter_mut() {
            let (ContactMeasurement::Position { information, .. }
            | ContactMeasurement::PositionNormal { information, .. }) = &mut contact.measurement
            else {
                continue;
            };
            if information.is_indefinite() {
                clipped += 1;
                *information = information.clipped();
            }
        }
        clipped
    }
}

impl Displacement {
    fn is_indefinite(&self) -> bool {
        match &self.measurement {
            DisplacementMeasurement::Offset { information, .. } => information.is_indefinite(),
            DisplacementMeasurement::Relative(m) => m.information.is_indefinite(),
        }
    }
}
