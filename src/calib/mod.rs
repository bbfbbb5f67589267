//! Calibration: from noisy touches to taxel poses that know their own uncertainty.
//!
//! The first half of the source paper (section III-A): unknown poses `t_i` of the taxels, observed displacements
//! `delta_ji` with information `Omega_ji`, and the poses that minimise `1/2 sum e_ji' Omega_ji e_ji`.
//!
//! ```text
//! Observations ─ start ─▶ poses ─ normal equations ─▶ step ─▶ ... ─▶ Calibration ─ triangles ─▶ Skin
//! edges, contacts  chordal    │    blocks of 1, 3 or 6  GN, LM, dogleg   covariances
//!                             └── robust kernels, graduated non-convexity
//! ```
//!
//! [`Observations`] are plain data, from a file or from [`simulate`]. [`calibrate`] does the whole job;
//! [`calibrated_skin`] makes a skin of its result. Two models share the code: positions, which is linear, and poses
//! in SE(3). Where no contact says where a sheet of taxels is, it stays where its first taxel started, and
//! covariances are those left after the best alignment ([`Marginals`]).

mod calibrate;
mod compare;
mod error;
mod geometry;
mod observations;
mod robust;
mod simulate;
mod skin;
mod solve;

pub use calibrate::{CalibOptions, Calibration, FreeComponent, Uncertainty, Weights, calibrate};
pub use compare::{Comparison, compare};
pub use error::CalibError;
pub use geometry::pose::Pose;
pub use observations::information::Information;
pub use observations::{
    ContactMeasurement, ContactObservation, ContactObservationId, Displacement, DisplacementId,
    DisplacementMeasurement, Model, Observations, PosePrior, RelativePose, TaxelVariable,
};
pub use robust::goodness_of_fit::GoodnessOfFit;
pub use simulate::{Probe, SimulateOptions, Simulation, simulate};
pub use skin::{CalibratedSkin, Outside, calibrated_skin};
pub use solve::initial::Initialization;
pub use solve::levenberg_marquardt::{Iteration, Method, StopCriteria, Termination};
pub use solve::loss::Robust;
pub use solve::marginals::Marginals;
pub use solve::residual::ResidualConvention;
