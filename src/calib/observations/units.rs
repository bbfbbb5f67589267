//! Observations in another unit of length.

use crate::calib::{ContactMeasurement, DisplacementMeasurement, Information, Observations, PoseMeasurement};

impl Observations {
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
