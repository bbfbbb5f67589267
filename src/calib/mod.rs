//! Calibration: from noisy contacts to taxel poses with covariances.
//!
//! The method of Cannata, Denei and Mastrogiovanni, "On Internal Models for Representing Tactile
//! Information" (cannata), section III-A. A robot that touches its skin observes, for pairs
//! of taxels `i` and `j`, the displacement `delta_ji` with information (inverse covariance)
//! `Omega_ji`. The unknown poses `t_i` are those that minimise equation 1 of that paper,
//!
//! ```text
//! H(t) = 1/2 sum e_ji' Omega_ji e_ji,     e_ji = h_ji(t) - delta_ji
//! ```
//!
//! with `h_ji = t_j - t_i` for positions ([`Model::Positions`]: linear, one solve) or `T_i^-1 T_j`
//! for poses in SE(3) ([`Model::Poses`]: Gauss-Newton). Contacts with objects at known places add
//! absolute terms of one taxel.
//!
//! ```text
//! Observations -- initial poses --> Gauss-Newton on J' W Omega J x = -J' W Omega e --> Calibration --> Skin
//!                                        ^ weights W       | residuals             covariances
//!                                        +---- robust -----+
//! ```
//!
//! 1. [`Observations`] are plain data, from a file or from [`simulate()`].
//! 2. Initial poses: chordal relaxation, spanning tree, or given.
//! 3. Levenberg and Marquardt on sparse blocks, undamped while the cost falls.
//! 4. Robust estimation: truncated least squares finds the outliers (contacts that were attributed
//!    to a wrong taxel), but only if least squares does not suffice; its documentation shows what
//!    each stage contributes.
//! 5. Covariances of all taxels by selected inversion. The absolute pose of a component without
//!    contacts is arbitrary; its covariances are those in the centroid gauge ([`Marginals`]).
//! 6. [`calibrated_skin`] meshes the taxels.
//!
//! Guaranteed: the same result on any number of threads, covariances right to first order for the
//! stated noise, observations that do not determine a taxel are an error that names it. Not
//! guaranteed: the global minimum, for poses or with outliers.
//!
//! In reading order: `observations`, `geometry` (poses, alignment), `options`, `solve` (`residual`,
//! `normal_equations`, `levenberg_marquardt`, `gauge`, `marginals`), `calibration`, `robust`,
//! `calibrate`, `skin`; `simulate` and `compare` stand next to them.

mod calibrate;
mod calibration;
mod compare;
mod error;
mod geometry;
mod observations;
mod options;
mod robust;
mod simulate;
mod skin;
mod solve;

pub use calibrate::calibrate;
pub use calibration::{Calibration, GoodnessOfFit, ObservationDiagnostics};
pub use compare::{Comparison, compare};
pub use error::CalibError;
pub use geometry::pose::Pose;
pub use observations::information::Information;
pub use observations::per_observation::PerObservation;
pub use observations::{
    ContactMeasurement, ContactObservation, ContactObservationId, Displacement, DisplacementId,
    DisplacementMeasurement, Model, Observations, PoseMeasurement, TaxelVariable,
};
pub use options::{CalibOptions, Initialization, ResidualConvention};
pub use simulate::{SimulateOptions, Simulation, simulate};
pub use skin::{CalibratedSkin, calibrated_skin};
pub use solve::gauge::FreeComponent;
pub use solve::levenberg_marquardt::{Iteration, Termination};
pub use solve::loss::{Loss, Verdict};
pub use solve::marginals::Marginals;

pub(in crate::calib) use observations::graph::{
    Component, Poses, components, edges_of_taxels, predicted_pose,
};
pub(in crate::calib) use solve::{
    gauge::{FreeBody, GaugeFreedom, RigidMotion},
    layout::BlockLayout,
    levenberg_marquardt::{Iterate, Solver},
    linear_system::LinearSystem,
    loss::{INLIER_SHARE, LossFunctions, SMALLEST_WEIGHT, Weighting},
    normal_equations::Problem,
};
