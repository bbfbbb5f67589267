//! The residual of a relative pose in three conventions, with analytic Jacobians `(barfoot2017)`.

use glam::{DMat3, DVec3};

use crate::calib::pose::{
    hat, left_jacobian_inverse_times, left_jacobian_inverse_times_derivatives, log, right_jacobian_inverse,
};
use crate::calib::{Pose, PoseMeasurement, ResidualConvention};
use crate::numeric::{Matrix6, Twist};

/// The six numbers of `E = Z^-1 T_i^-1 T_j`.
pub(crate) fn error(convention: ResidualConvention, observed: &Pose, from: &Pose, to: &Pose) -> Twist {
    let step = from.rotation.conjugate() * (to.position - from.position);
    let dt = observed.rotation.conjugate() * (step - observed.position);
    let dr = observed.rotation.conjugate() * (from.rotation.conjugate() * to.rotation);
    match convention {
        ResidualConvention::Split => [dt, log(dr)],
        ResidualConvention::Log => {
            let turn = log(dr);
            [left_jacobian_inverse_times(turn, dt), turn]
        }
        ResidualConvention::Quaternion => [dt, if dr.w < 0.0 { -dr.xyz() } else { dr.xyz() }],
    }
}

/// The error, and its derivatives when `from` and `to` are moved in their own frames
/// ([`Pose::moved`]).
pub(crate) fn linearised(
    convention: ResidualConvention,
    observed: &Pose,
    from: &Pose,
    to: &Pose,
) -> (Twist, Matrix6, Matrix6) {
    let back = DMat3::from_quat(observed.rotation).transpose();
    let step = from.rotation.conjugate() * (to.position - from.position);
    let dt = back * (step - observed.position);
    let between = from.rotation.conjugate() * to.rotation;
    let dr = observed.rotation.conjugate() * between;
    let (turn, slope) = match convention {
        ResidualConvention::Split | ResidualConvention::Log => {
            let turn = log(dr);
            (turn, right_jacobian_inverse(turn))
        }
        ResidualConvention::Quaternion => {
            let q = if dr.w < 0.0 { -dr } else { dr };
            (q.xyz(), 0.5 * (DMat3::from_diagonal(DVec3::splat(q.w)) + hat(q.xyz())))
        }
    };
    let turn_by_from = -(slope * DMat3::from_quat(between).transpose());
    let by_from = [[-back, back * hat(step)], [DMat3::ZERO, turn_by_from]];
    let by_to = [[DMat3::from_quat(dr), DMat3::ZERO], [DMat3::ZERO, slope]];
    if convention != ResidualConvention::Log {
        return ([dt, turn], Matrix6(by_from), Matrix6(by_to));
    }
    // The translation depends on the rotation: chain rule.
    let (by_turn, by_dt) = left_jacobian_inverse_times_derivatives(turn, dt);
    let chain = Matrix6([[by_dt, by_turn], [DMat3::ZERO, DMat3::IDENTITY]]);
    ([left_jacobian_inverse_times(turn, dt), turn], chain * Matrix6(by_from), chain * Matrix6(by_to))
}

/// One relative pose in the normal equations, before any robust weight.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EdgeTerm {
    /// `J_from' Omega J_from`.
    pub(crate) from_from: Matrix6,
    /// `J_to' Omega J_to`.
    pub(crate) to_to: Matrix6,
    /// `J_from' Omega J_to`.
    pub(crate) from_to: Matrix6,
    /// `J_from' Omega e`.
    pub(crate) from_gradient: Twist,
    /// `J_to' Omega e`.
    pub(crate) to_gradient: Twist,
}

impl EdgeTerm {
    pub(crate) fn new(
        convention: ResidualConvention,
        observed: &PoseMeasurement,
        from: &Pose,
        to: &Pose,
    ) -> Self {
        let (e, j_from, j_to) = linearised(convention, &observed.pose, from, to);
        let omega = observed.information.matrix();
        let weighted = omega * e;
        let (t_from, t_to) = (j_from.transpose(), j_to.transpose());
        let w_to = omega * j_to;
        Self {
            from_from: t_from * (omega * j_from),
            to_to: t_to * w_to,
            from_to: t_from * w_to,
            from_gradient: t_from * weighted,
            to_gradient: t_to * weighted,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{calib::pose::exp, numeric::dot};

    fn vector(length: f64) -> impl Strategy<Value = DVec3> {
        (-1.0..1.0, -1.0..1.0, -1.0..1.0_f64).prop_map(move |(x, y, z)| DVec3::new(x, y, z) * length)
    }

    fn pose() -> impl Strategy<Value = Pose> {
        (vector(2.0), vector(1.8)).prop_map(|(position, turn)| Pose { position, rotation: exp(turn) })
    }

    proptest! {
        /// Analytic derivatives against central differences, in every convention, for closed forms and for
        /// series.
        #[test]
        fn jacobians_are_the_slopes_of_the_error(
            from in pose(), to in pose(), noise in (vector(0.3), prop_oneof![vector(1.7), vector(0.05), vector(1e-4)]), which in 0..3_usize,
        ) {
            let convention = [ResidualConvention::Split, ResidualConvention::Log, ResidualConvention::Quaternion][which];
            let observed = (from.inverse() * to).moved(noise.0, noise.1);
            let (e, by_from, by_to) = linearised(convention, &observed, &from, &to);
            prop_assert!(dot(e, e) > 0.0 || noise.0 == DVec3::ZERO);
            let h = 1e-6;
            for b in 0..6 {
                let mut step = [DVec3::ZERO; 2];
                step[b / 3][b % 3] = h;
                for (jacobian, moves_from) in [(by_from, true), (by_to, false)] {
                    let at = |sign: f64| {
                        let moved = |p: &Pose| p.moved(sign * step[0], sign * step[1]);
                        if moves_from {
                            error(convention, &observed, &moved(&from), &to)
                        } else {
                            error(convention, &observed, &from, &moved(&to))
                        }
                    };
                    let (plus, minus) = (at(1.0), at(-1.0));
                    for a in 0..6 {
                        let slope = (plus[a / 3][a % 3] - minus[a / 3][a % 3]) / (2.0 * h);
                        let found = jacobian.entry(a, b);
                        prop_assert!((found - slope).abs() < 1e-7, "{convention:?} ({a},{b}): {found} is not {slope}");
                    }
                }
            }
        }
    }
}
