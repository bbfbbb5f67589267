//! Rigid frames, and the exponential and logarithm of rotations with their Jacobians (section 7.1 of
//! `(barfoot2017)`).

use glam::{DMat3, DQuat, DVec3};

use crate::mesh::is_within_reach;

/// Below this angle functions of rotations use their series: closed forms lose half of their digits there.
const SMALL_ANGLE: f64 = 1e-2;

/// How far the squared length of a quaternion may be from 1: files write few digits.
const UNIT_TOLERANCE: f64 = 1e-6;

/// A rigid frame: position and orientation.
///
/// A pose maps coordinates of its own frame to the frame in which it is given: `x -> rotation x + position`.
/// The default is the identity.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pose {
    /// Origin of the frame, in m.
    pub position: DVec3,
    /// Orientation, a unit quaternion.
    pub rotation: DQuat,
}

impl Pose {
    /// A frame at `position`, without rotation.
    #[doc(hidden)]
    pub const fn at(position: DVec3) -> Self {
        Self { position, rotation: DQuat::IDENTITY }
    }

    /// The inverse: `inverse() * self` is the identity.
    pub(crate) fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { position: -(rotation * self.position), rotation }
    }

    pub(crate) fn apply(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.position
    }

    /// The pose moved by `translation` and turned by the rotation vector `turn`, both in its own
    /// frame.
    pub(crate) fn moved(&self, translation: DVec3, turn: DVec3) -> Self {
        Self {
            position: self.position + self.rotation * translation,
            rotation: (self.rotation * exp(turn)).normalize(),
        }
    }

    /// Whether the position is finite and within reach, and the quaternion has unit length.
    pub(crate) fn is_valid(&self) -> bool {
        is_within_reach(self.position) && is_unit(self.rotation)
    }
}

/// Whether a quaternion has unit length; one with NaN has not.
pub(super) fn is_unit(q: DQuat) -> bool {
    (q.length_squared() - 1.0).abs() < UNIT_TOLERANCE
}

impl std::ops::Mul for Pose {
    type Output = Self;

    /// First `other`, then `self`.
    fn mul(self, other: Self) -> Self {
        Self { position: self.apply(other.position), rotation: (self.rotation * other.rotation).normalize() }
    }
}

/// The rotation by `|turn|` radians about `turn`.
///
/// Sines come from `libm`, so that simulated observations have the same bytes on every system.
pub(crate) fn exp(turn: DVec3) -> DQuat {
    let angle = turn.length();
    // sin(x / 2) / x.
    let factor = if angle < SMALL_ANGLE {
        let x2 = angle * angle;
        0.5 - x2 / 48.0 + x2 * x2 / 3840.0
    } else {
        libm::sin(0.5 * angle) / angle
    };
    let v = factor * turn;
    DQuat::from_xyzw(v.x, v.y, v.z, libm::cos(0.5 * angle))
}

/// The rotation vector of `rotation`, of at most pi radians.
pub(crate) fn log(rotation: DQuat) -> DVec3 {
    let q = if rotation.w < 0.0 { -rotation } else { rotation };
    let v = q.xyz();
    let sine = v.length();
    // 2 atan2(s, w) / s; for small s the series of asin, since w is close to 1.
    let factor = if sine < SMALL_ANGLE {
        let t = sine / q.w;
        let t2 = t * t;
        2.0 / q.w * (1.0 - t2 / 3.0 + t2 * t2 / 5.0 - t2 * t2 * t2 / 7.0)
    } else {
        2.0 * sine.atan2(q.w) / sine
    };
    factor * v
}

/// The matrix `a b'`.
pub(crate) fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// The matrix of `x -> v x x`.
pub(crate) fn hat(v: DVec3) -> DMat3 {
    DMat3::from_cols_array(&[0.0, v.z, -v.y, -v.z, 0.0, v.x, v.y, -v.x, 0.0])
}

/// `c` of `J_r^-1 = I + hat/2 + c hat^2`, and `dc/dangle / angle`.
///
/// `c = 1/a^2 - cot(a/2)/(2a)` (section 7.1 of `(barfoot2017)`): smooth up to, not including, a full turn.
fn inverse_jacobian_coefficient(angle: f64) -> (f64, f64) {
    let a2 = angle * angle;
    if angle < 0.1 {
        let c = 1.0 / 12.0 + a2 * (1.0 / 720.0 + a2 * (1.0 / 30_240.0 + a2 / 1_209_600.0));
        let slope = 1.0 / 360.0 + a2 * (1.0 / 7560.0 + a2 * (1.0 / 201_600.0 + a2 / 5_987_520.0));
        return (c, slope);
    }
    let (sin, cos) = (0.5 * angle).sin_cos();
    let cotangent = cos / sin;
    let c = 1.0 / a2 - cotangent / (2.0 * angle);
    let slope = -2.0 / (a2 * angle) + cotangent / (2.0 * a2) + 1.0 / (4.0 * angle * sin * sin);
    (c, slope / angle)
}

/// Derivative of `log(R exp(x))` with respect to `x` at 0, where `turn = log(R)`: the inverse right
/// Jacobian.
pub(crate) fn right_jacobian_inverse(turn: DVec3) -> DMat3 {
    let k = hat(turn);
    DMat3::IDENTITY + 0.5 * k + inverse_jacobian_coefficient(turn.length()).0 * (k * k)
}

/// The translation part of the SE(3) logarithm: `V(turn)^-1 y`, with `V` the left Jacobian.
pub(crate) fn left_jacobian_inverse_times(turn: DVec3, y: DVec3) -> DVec3 {
    let k = turn.cross(y);
    y - 0.5 * k + inverse_jacobian_coefficient(turn.length()).0 * turn.cross(k)
}

/// Derivatives of [`left_jacobian_inverse_times`] with respect to `turn` and to `y`.
pub(crate) fn left_jacobian_inverse_times_derivatives(turn: DVec3, y: DVec3) -> (DMat3, DMat3) {
    let (c, slope) = inverse_jacobian_coefficient(turn.length());
    let k = hat(turn);
    let twice = turn.cross(turn.cross(y));
    let by_turn = 0.5 * hat(y)
        + c * (DMat3::from_diagonal(DVec3::splat(turn.dot(y))) + outer(turn, y) - 2.0 * outer(y, turn))
        + slope * outer(twice, turn);
    (by_turn, DMat3::IDENTITY - 0.5 * k + c * (k * k))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn vector(length: f64) -> impl Strategy<Value = DVec3> {
        (-1.0..1.0, -1.0..1.0, -1.0..1.0_f64).prop_map(move |(x, y, z)| DVec3::new(x, y, z) * length)
    }

    proptest! {
        #[test]
        fn log_undoes_exp(turn in prop_oneof![vector(1.8), vector(1e-2), vector(1e-8)]) {
            let back = log(exp(turn));
            prop_assert!(back.distance(turn) <= 1e-14 + 1e-14 * turn.length(), "{turn} came back as {back}");
        }

        #[test]
        fn inverse_undoes_a_pose(p in vector(3.0), turn in vector(1.8)) {
            let pose = Pose { position: p, rotation: exp(turn) };
            let one = pose.inverse() * pose;
            prop_assert!(one.position.length() < 1e-14 && log(one.rotation).length() < 1e-14);
        }
    }

    #[test]
    fn half_a_turn_has_a_logarithm() {
        let half = log(DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0));
        assert!(half.distance(DVec3::X * std::f64::consts::PI) < 1e-15, "{half}");
    }
}
