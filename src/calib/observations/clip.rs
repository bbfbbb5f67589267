//! Indefinite information: what public pose graphs hold, made usable on request.

use crate::calib::{ContactMeasurement, Displacement, DisplacementMeasurement, Information, Observations};

impl Observations {
    /// How many edges have finite information that is not positive semi-definite.
    pub(super) fn indefinite_edges(&self) -> usize {
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

/// Whether information was indefinite; then it is clipped.
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
