//! The forward model of a contact with a fixed sphere (section IV of the source paper,
//! (cannata).

use glam::{DMat3, DQuat, DVec3};

use crate::{calib::geometry::pose::exp, numeric::Random};

/// The fixed sphere that the end effector touches, and how well its own pose is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Probe {
    /// Its centre, in m.
    pub centre: DVec3,
    /// Its radius, in m.
    pub radius: f64,
    /// How deep the elastic skin is pressed in, in m: contacts are observed that much below the
    /// taxel.
    pub indentation: f64,
    /// Noise of the end effector's position per axis, in m.
    pub position_noise: f64,
    /// Noise of the end effector's orientation per axis, in rad.
    pub rotation_noise: f64,
}

impl Default for Probe {
    fn default() -> Self {
        Self {
            centre: DVec3::new(0.4, 0.1, 0.3),
            radius: 0.01,
            indentation: 0.0,
            position_noise: 0.0,
            rotation_noise: 0.0,
        }
    }
}

/// A contact in the frame of the end effector, as the arm believes it.
pub(super) struct SimulatedContact {
    pub(super) position: DVec3,
    pub(super) normal: DVec3,
}

/// Touches the probe with the taxel of normal `n` from a random direction: the contact forward
/// model of section IV.
///
/// ContactObservation along `u` (from the probe to the end effector) means an end-effector rotation
/// with `Q n = -u` and centre `o = c_b + (R + r_b - depth) u`; the contact `c_b + r_b u` is
/// observed at `Q' (c_b + r_b u - o)`.
pub(super) fn simulate_contact(probe: &Probe, radius: f64, n: DVec3, arm: &mut Random) -> SimulatedContact {
    let u = arm.direction();
    let spin = exp(std::f64::consts::TAU * arm.uniform() * DVec3::Z);
    let rotation = frame_of(-u) * spin * frame_of(n).conjugate();
    let centre = probe.centre + (radius + probe.radius - probe.indentation) * u;
    let believed_centre = centre + arm.vector(probe.position_noise);
    let believed_rotation = exp(arm.vector(probe.rotation_noise)) * rotation;
    let contact = probe.centre + probe.radius * u;
    SimulatedContact {
        position: believed_rotation.conjugate() * (contact - believed_centre),
        normal: (believed_rotation.conjugate() * -u).normalize(),
    }
}

/// Some rotation that takes z to `direction`.
fn frame_of(direction: DVec3) -> DQuat {
    let x = direction.any_orthonormal_vector();
    DQuat::from_mat3(&DMat3::from_cols(x, direction.cross(x), direction)).normalize()
}
