//! What can be varied in the simulated experiment.

use glam::DVec3;

use crate::calib::{CalibError, Model};

/// The experiment of the source paper's section IV, with what can be varied.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulateOptions {
    /// What is unknown of every taxel.
    pub model: Model,
    /// Number of taxels.
    pub taxels: usize,
    /// Distance of lattice neighbours, in m.
    pub spacing: f64,
    /// Radius of the sphere that carries the taxels, in m.
    pub radius: f64,
    /// Noise of displacements per axis, in m.
    pub noise: f64,
    /// Noise of relative rotations per axis, in rad; poses model only.
    pub rotation_noise: f64,
    /// Number of taxels with an absolute contact observation, spread over the skin.
    pub anchors: usize,
    /// Noise of absolute contacts per axis, in m.
    pub anchor_noise: f64,
    /// Noise of the normals of absolute contacts per tangent axis, in rad; `None`: positions alone.
    pub normal_noise: Option<f64>,
    /// Centre of the fixed sphere that the taxels touch, in m.
    pub probe_centre: DVec3,
    /// Its radius, in m.
    pub probe_radius: f64,
    /// How deep the elastic skin is pressed in, in m: contacts are observed that much below the
    /// taxel.
    pub indentation: f64,
    /// Noise of the position of the arm that holds the skin, per axis, in m.
    pub arm_noise: f64,
    /// Noise of the orientation of the arm, per axis, in rad.
    pub arm_rotation_noise: f64,
    /// Chance that a displacement is attributed to a wrong taxel nearby.
    pub outliers: f64,
    /// Seed of everything that is drawn at random.
    pub seed: u64,
}

impl Default for SimulateOptions {
    fn default() -> Self {
        Self {
            model: Model::Positions,
            taxels: 500,
            spacing: 5e-3,
            radius: 0.1,
            noise: 1e-3,
            rotation_noise: 1_f64.to_radians(),
            anchors: 0,
            anchor_noise: 1e-3,
            normal_noise: None,
            probe_centre: DVec3::new(0.4, 0.1, 0.3),
            probe_radius: 0.01,
            indentation: 0.0,
            arm_noise: 0.0,
            arm_rotation_noise: 0.0,
            outliers: 0.0,
            seed: 0,
        }
    }
}

/// The largest noise and probe that are accepted, in m and rad.
const MOST_NOISE: f64 = 1e3;

impl SimulateOptions {
    pub(super) fn validate(&self) -> Result<(), CalibError> {
        let sizes = [
            ("the noise", self.noise),
            ("the rotation noise", self.rotation_noise),
            ("the anchor noise", self.anchor_noise),
            ("the noise of normals", self.normal_noise.unwrap_or(0.0)),
            ("the radius of the probe", self.probe_radius),
            ("the indentation", self.indentation),
            ("the position noise of the end effector", self.arm_noise),
            ("the rotation noise of the end effector", self.arm_rotation_noise),
        ];
        for (option, x) in sizes {
            if !(0.0..=MOST_NOISE).contains(&x) {
                return Err(CalibError::BadOption { option, found: x, needed: "0 to 1000 m or rad" });
            }
        }
        if !(0.0..=1.0).contains(&self.outliers) {
            let found = self.outliers;
            return Err(CalibError::BadOption { option: "the share of outliers", found, needed: "0 to 1" });
        }
        if self.anchors > self.taxels {
            let (option, found) = ("the number of anchors", self.anchors as f64);
            return Err(CalibError::BadOption { option, found, needed: "at most the number of taxels" });
        }
        Ok(())
    }
}
