//! The rotation, and the rigid motion, that align two sets of points or directions best (`(horn1987)`,
//! `(wahba1965)`); and [`compare`], which measures the error after such a motion.

use glam::{DMat3, DQuat, DVec3};

use crate::calib::pose::outer;
use crate::calib::{CalibError, Pose};
use crate::id::{IdVec, VertexId};
use crate::numeric::symmetric_eigen;

/// Two sets of points about their centroids.
pub(crate) struct Correlation {
    pub(crate) from: DVec3,
    pub(crate) to: DVec3,
    /// `sum (to_k - to) (from_k - from)'`.
    pub(crate) matrix: DMat3,
}

impl Correlation {
    /// Each pair counts by its weight, or as much as every other.
    pub(crate) fn new(pairs: &[(DVec3, DVec3)], weights: Option<&[f64]>) -> Self {
        let weight = |k: usize| weights.map_or(1.0, |weights| weights[k]);
        let total: f64 = (0..pairs.len()).map(weight).sum();
        let weighted = || pairs.iter().enumerate().map(|(k, &(from, to))| (weight(k), from, to));
        let from = weighted().map(|(w, from, _)| w * from).sum::<DVec3>() / total;
        let to = weighted().map(|(w, _, to)| w * to).sum::<DVec3>() / total;
        let matrix = weighted().fold(DMat3::ZERO, |sum, (w, a, b)| sum + outer(w * (b - to), a - from));
        Self { from, to, matrix }
    }
}

/// The rotation nearest to a matrix in the sum of squares: the largest eigenvector of Horn's
/// matrix, which cannot become a reflection.
pub(crate) fn nearest_rotation(m: &DMat3) -> DQuat {
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
    let (xx, xy, xz) = (x.x, y.x, z.x);
    let (yx, yy, yz) = (x.y, y.y, z.y);
    let (zx, zy, zz) = (x.z, y.z, z.z);
    let k = [
        [xx - yy - zz, xy + yx, xz + zx, zy - yz],
        [xy + yx, yy - xx - zz, yz + zy, xz - zx],
        [xz + zx, yz + zy, zz - xx - yy, yx - xy],
        [zy - yz, xz - zx, yx - xy, xx + yy + zz],
    ];
    let (values, vectors) = symmetric_eigen(&k);
    let best = (0..4).max_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(3);
    let q = DQuat::from_xyzw(vectors[0][best], vectors[1][best], vectors[2][best], vectors[3][best]);
    if q.w < 0.0 { -q } else { q }.normalize()
}

/// How far a calibration is from the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// Root mean square distance without alignment, in m.
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
    let Correlation { from, to, matrix } = Correlation::new(&pairs, None);
    let rotation = if matrix == DMat3::ZERO { DQuat::IDENTITY } else { nearest_rotation(&matrix) };
    let alignment = Pose { position: to - rotation * from, rotation };
    let rms = |motion: &Pose| {
        let sum: f64 = pairs.iter().map(|(f, t)| motion.apply(*f).distance_squared(*t)).sum();
        (sum / pairs.len() as f64).sqrt()
    };
    Ok(Comparison { absolute: rms(&Pose::default()), rigid: rms(&alignment), alignment })
}
