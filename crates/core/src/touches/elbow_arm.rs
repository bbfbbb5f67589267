//! The arm of [`simulate_arm`](crate::touches::simulate_arm) with its joints: six that turn, the last three through one point, so that the values
//! of the joints follow from the pose of the link in closed form.
//!
//! At 0 the arm is straight along x: a shoulder at [`SHOULDER`] above the base turns about z, then about y, the elbow about y, the wrist about
//! x, y and x. The link with the skin hangs on the last joint, so that its z axis is up where the flange points down.

use glam::{DMat3, DQuat, DVec3};

use crate::calib::Pose;
use crate::touches::TouchesError;
use crate::touches::log::TouchLog;

/// The names of the joints of the simulated arm.
pub const ARM_JOINTS: [&str; 6] =
    ["shoulder_pan", "shoulder_lift", "elbow", "wrist_roll", "wrist_bend", "flange"];

/// Its robot description (URDF): the link with the skin is `end_effector`.
pub const ARM_DESCRIPTION: &str = r#"<robot name="simulated_arm">
  <link name="base"/><link name="shoulder"/><link name="upper_arm"/><link name="forearm"/><link name="wrist"/><link name="hand"/><link name="flange_link"/>
  <link name="end_effector"/>
  <joint name="shoulder_pan" type="continuous"><parent link="base"/><child link="shoulder"/><origin xyz="0 0 0.2"/><axis xyz="0 0 1"/></joint>
  <joint name="shoulder_lift" type="continuous"><parent link="shoulder"/><child link="upper_arm"/><axis xyz="0 1 0"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper_arm"/><child link="forearm"/><origin xyz="0.35 0 0"/><axis xyz="0 1 0"/></joint>
  <joint name="wrist_roll" type="continuous"><parent link="forearm"/><child link="wrist"/><origin xyz="0.4 0 0"/><axis xyz="1 0 0"/></joint>
  <joint name="wrist_bend" type="continuous"><parent link="wrist"/><child link="hand"/><axis xyz="0 1 0"/></joint>
  <joint name="flange" type="continuous"><parent link="hand"/><child link="flange_link"/><axis xyz="1 0 0"/></joint>
  <joint name="mount" type="fixed"><parent link="flange_link"/><child link="end_effector"/><origin xyz="0.08 0 0" rpy="0 -1.5707963267948966 0"/></joint>
</robot>
"#;

/// Height of the shoulder, lengths of upper arm and forearm, and distance of the link with the skin from the wrist, in m.
const SHOULDER: f64 = 0.2;
const UPPER_ARM: f64 = 0.35;
const FOREARM: f64 = 0.4;
const FLANGE: f64 = 0.08;

/// The rotation of the link with the skin on the flange.
fn mount() -> DMat3 {
    DMat3::from_cols(DVec3::Z, DVec3::Y, -DVec3::X)
}

/// The pose of the link with the skin, where the joints have these values (rad).
pub(super) fn pose_of(q: &[f64; 6]) -> Pose {
    let upper = DMat3::from_quat(DQuat::from_rotation_z(q[0]) * DQuat::from_rotation_y(q[1]));
    let fore = upper * DMat3::from_rotation_y(q[2]);
    let flange =
        fore * DMat3::from_rotation_x(q[3]) * DMat3::from_rotation_y(q[4]) * DMat3::from_rotation_x(q[5]);
    let position =
        DVec3::Z * SHOULDER + upper.x_axis * UPPER_ARM + fore.x_axis * FOREARM + flange.x_axis * FLANGE;
    Pose { position, rotation: DQuat::from_mat3(&(flange * mount())).normalize() }
}

/// The values of the joints (rad) with the elbow up, at which the link has a pose; `None` if the arm does not reach it.
pub(super) fn values_of(pose: &Pose) -> Option<[f64; 6]> {
    let flange = DMat3::from_quat(pose.rotation) * mount().transpose();
    let wrist = pose.position - FLANGE * flange.x_axis - SHOULDER * DVec3::Z;
    let (out, far) = (wrist.x.hypot(wrist.y), wrist.length());
    let cos = (far * far - UPPER_ARM * UPPER_ARM - FOREARM * FOREARM) / (2.0 * UPPER_ARM * FOREARM);
    if !(-1.0..=1.0).contains(&cos) {
        return None;
    }
    let (pan, elbow) = (libm::atan2(wrist.y, wrist.x), libm::acos(cos));
    let raised = libm::atan2(FOREARM * libm::sin(elbow), UPPER_ARM + FOREARM * cos);
    let lift = -libm::atan2(wrist.z, out) - raised;
    let fore = DMat3::from_rotation_z(pan) * DMat3::from_rotation_y(lift + elbow);
    let turn = fore.transpose() * flange;
    let bend = libm::acos(turn.x_axis.x.clamp(-1.0, 1.0));
    let roll = libm::atan2(turn.x_axis.y, -turn.x_axis.z);
    let spin = libm::atan2(turn.y_axis.x, turn.z_axis.x);
    Some([pan, lift, elbow, roll, bend, spin])
}

/// The values of the joints of the simulated arm in each frame of a log, in rad, at which its link has the pose of the log. From
/// one frame to the next they change by less than half a turn.
///
/// # Errors
/// The first row whose pose the arm does not reach.
pub fn arm_joint_values(log: &TouchLog) -> Result<Vec<[f64; 6]>, TouchesError> {
    let mut all: Vec<[f64; 6]> = Vec::with_capacity(log.frames.len());
    for frame in &log.frames {
        let (what, needed) =
            ("the pose of the link", "one that the simulated arm reaches, within 0.83 m of its shoulder");
        let mut q =
            values_of(&frame.link).ok_or(TouchesError::InvalidFrame { row: frame.row, what, needed })?;
        if let Some(before) = all.last() {
            for (value, before) in q.iter_mut().zip(before) {
                *value += std::f64::consts::TAU * ((before - *value) / std::f64::consts::TAU).round();
            }
        }
        all.push(q);
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::Random;
    use crate::touches::{ArmOptions, simulate_arm};

    /// Values of joints give the pose from which they follow, for all poses that the simulated arm has.
    #[test]
    fn values_and_poses_belong_together() {
        let log = simulate_arm(&ArmOptions::default()).unwrap().log;
        let values = arm_joint_values(&log).unwrap();
        for (q, frame) in values.iter().zip(&log.frames) {
            let found = pose_of(q);
            assert!(found.position.distance(frame.link.position) < 1e-12);
            assert!(found.rotation.dot(frame.link.rotation).abs() > 1.0 - 1e-12);
            assert!((0.1..3.0).contains(&q[4]), "the wrist is never straight: {}", q[4]);
        }
        let widest =
            values.windows(2).flat_map(|pair| [0, 1, 2, 3, 4, 5].map(|k| (pair[0][k] - pair[1][k]).abs()));
        assert!(widest.fold(0.0, f64::max) <= std::f64::consts::PI + 1e-9);
        let mut random = Random::new(1, 0);
        let q: [f64; 6] = [0.3, -1.0, 1.2, 0.4, 1.1, -2.0].map(|q| q + 0.1 * random.normal());
        let found = values_of(&pose_of(&q)).unwrap();
        assert!(found.iter().zip(q).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?} for {q:?}");
        assert_eq!(values_of(&Pose { position: DVec3::X * 2.0, ..Pose::default() }), None);
    }
}
