//! Compares taxel poses with the truth, before and after the best rigid motion (horn1987).

use glam::{DMat3, DQuat, DVec3};

use crate::{
    calib::{
        CalibError, Pose,
        geometry::align::{Correlation, nearest_rotation},
    },
    id::{IdVec, VertexId},
};

/// How far a calibration is from the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// Root mean square distance as it is, in m.
    pub absolute: f64,
    /// Root mean square distance after the best rigid motion, in m.
    pub rigid: f64,
    /// The best rigid motion from the calibration to the truth.
    pub alignment: Pose,
}

/// Compares taxel poses with the truth, before and after the rigid motion that fits positions best.
///
/// # Errors
/// [`CalibError::UnequalPoses`] if there is not one pose for every one of the truth, or none.
pub fn compare(
    found: &IdVec<VertexId, Pose>,
    truth: &IdVec<VertexId, Pose>,
) -> Result<Comparison, CalibError> {
    if found.len() != truth.len() || truth.is_empty() {
        return Err(CalibError::UnequalPoses { found: found.len(), needed: truth.len() });
    }
    let pairs: Vec<(DVec3, DVec3)> = found.iter().zip(truth).map(|(f, t)| (f.position, t.position)).collect();
    let Correlation { from, to, matrix } = Correlation::new(&pairs);
    let rotation = if matrix == DMat3::ZERO { DQuat::IDENTITY } else { nearest_rotation(&matrix) };
    let alignment = Pose { position: to - rotation * from, rotation };
    let rms = |motion: &Pose| {
        let sum: f64 = pairs.iter().map(|(f, t)| motion.apply(*f).distance_squared(*t)).sum();
        (sum / pairs.len() as f64).sqrt()
    };
    Ok(Comparison { absolute: rms(&Pose::default()), rigid: rms(&alignment), alignment })
}
