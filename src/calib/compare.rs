use glam::{DMat3, DQuat, DVec3};

use crate::{
    calib::{CalibError, Pose, geometry::pose::outer, solve::initial::nearest_rotation},
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

/// Compares taxel poses with the truth, before and after the rigid motion that fits positions best (Horn 1987).
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
    let count = truth.len() as f64;
    let centre = |poses: &IdVec<VertexId, Pose>| poses.iter().map(|p| p.position).sum::<DVec3>() / count;
    let (from, to) = (centre(found), centre(truth));
    let pairs = || found.iter().zip(truth);
    let correlation =
        pairs().map(|(f, t)| outer(t.position - to, f.position - from)).fold(DMat3::ZERO, |sum, m| sum + m);
    let rotation = if correlation == DMat3::ZERO { DQuat::IDENTITY } else { nearest_rotation(&correlation) };
    let alignment = Pose { position: to - rotation * from, rotation };
    let root_mean = |sum: f64| (sum / count).sqrt();
    Ok(Comparison {
        absolute: root_mean(pairs().map(|(f, t)| f.position.distance_squared(t.position)).sum()),
        rigid: root_mean(
            pairs().map(|(f, t)| alignment.apply(f.position).distance_squared(t.position)).sum(),
        ),
        alignment,
    })
}
