//! The options of [`calibrate`](crate::calib::calibrate()): plain data.

use crate::calib::{CalibError, Loss};
use crate::least_squares::Options;

/// Options of [`calibrate`](crate::calib::calibrate()).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibOptions {
    /// How the error of a relative pose is expressed as six numbers; unused in the positions model.
    pub residual: ResidualConvention,
    /// The loss function that is minimised. It determines the weight of outliers: observations that their
    /// stated noise does not explain.
    ///
    /// `None`: least squares first. If its chi-square is too large, or one residual is an outlier,
    /// refit with [`Loss::Truncated`]. The refit is kept only if some rejected observation is an
    /// outlier relative to the median residual of its kind, and at most half of the edges and of the
    /// contacts are rejected.
    pub robust: Option<Loss>,
    /// The start of the optimisation.
    pub initialization: Initialization,
    /// Limits of one minimisation; robust estimation minimises several times.
    pub limits: Options,
    /// Whether to compute the covariance of every taxel.
    pub covariances: bool,
}

impl Default for CalibOptions {
    fn default() -> Self {
        Self {
            residual: ResidualConvention::default(),
            robust: None,
            initialization: Initialization::default(),
            limits: Options::default(),
            covariances: true,
        }
    }
}

impl CalibOptions {
    pub(super) fn validate(&self) -> Result<(), CalibError> {
        if self.limits.max_iterations == 0 {
            return Err(CalibError::BadOption {
                option: "the number of iterations",
                found: 0.0,
                needed: "at least 1",
            });
        }
        Ok(())
    }
}

/// How the error `E = Z^-1 T_i^-1 T_j` of a relative pose is expressed as six numbers.
///
/// Each convention has its own minimum, so every printed cost names its convention.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, strum::Display)]
#[strum(serialize_all = "lowercase")]
pub enum ResidualConvention {
    /// `[dt; Log dR]`: translation and rotation separately.
    #[default]
    Split,
    /// The full logarithm of SE(3), as in GTSAM.
    Log,
    /// `[dt; vec(quaternion of dR)]`, half the angle: as in g2o.
    Quaternion,
}

/// The start of the optimisation. The positions model is linear and needs none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Initialization {
    /// Rotations as if they were free matrices, projected to rotations, then translations: two linear systems
    /// (`(martinec2007)`, `(carlone2015)`). Falls back to a spanning tree if that has no solution.
    #[default]
    Chordal,
    /// The initial values of the taxels.
    InitialValues,
}
