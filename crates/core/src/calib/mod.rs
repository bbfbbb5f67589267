//! Calibration: from noisy contacts to taxel poses with covariances.
//!
//! The method of Cannata, Denei and Mastrogiovanni, "On Internal Models for Representing Tactile
//! Information" `(cannata)`, section III-A. A robot that touches its skin observes, for pairs
//! of taxels `i` and `j`, the displacement `delta_ji` with information (inverse covariance)
//! `Omega_ji`. The unknown poses `t_i` are those that minimise equation 1 of that paper,
//!
//! ```text
//! H(t) = 1/2 sum e_ji' Omega_ji e_ji,     e_ji = h_ji(t) - delta_ji
//! ```
//!
//! with `h_ji = t_j - t_i` for positions ([`Model::Positions`]: linear, one solve) or `T_i^-1 T_j` for poses
//! in SE(3) ([`Model::Poses`]: Gauss-Newton). Contacts with objects at known positions add absolute terms of
//! one taxel.
//!
//! ```text
//! Observations -- initial poses --> Gauss-Newton on J' W Omega J x = -J' W Omega e --> Calibration --> Skin
//!                                        ^ weights W       | residuals             covariances
//!                                        +---- robust -----+
//! ```
//!
//! 1. [`Observations`] are plain data, from a file or from [`simulate()`].
//! 2. Initial poses: chordal relaxation (a spanning tree if that fails), or given.
//! 3. Levenberg and Marquardt on sparse blocks, undamped while the cost falls ([`least_squares`](crate::least_squares)).
//! 4. Robust estimation: truncated least squares finds the outliers (contacts that were attributed to a wrong
//!    taxel), but only if least squares does not suffice; `robust` has a table of what each stage
//!    contributes.
//! 5. Covariances of all taxels by selected inversion. The absolute pose of a component without
//!    contacts is arbitrary; its covariances are those in the centroid gauge ([`Marginals`]).
//! 6. [`calibrated_skin`] meshes the taxels.
//!
//! Guaranteed: the same result on any number of threads, covariances correct to first order for the stated
//! noise, and an error with the taxel if observations do not determine it. Not guaranteed: the global
//! minimum, for poses or with outliers.
//!
//! In reading order: `observations`, `pose`, `align`, `options`, `solve` (`residual`,
//! `normal_equations`, `solver`, `gauge`, `marginals`), `calibration`, `robust`, `skin`;
//! [`calibrate()`] calls them in this order. `simulate` is separate. `follow` calibrates touch by touch, and `bodies` moves
//! the rigid bodies of a drawn skin ([`fit_bodies()`]).

mod align;
mod bodies;
mod calibration;
mod error;
mod follow;
mod observations;
mod options;
mod pose;
mod robust;
mod sensor_layout;
mod simulate;
mod skin;
mod solve;

use std::time::Instant;

pub use crate::least_squares::Termination;
pub use align::{Comparison, compare};
pub(crate) use align::{Correlation, nearest_rotation};
pub use bodies::{
    BodyCalibration, BodyFit, BodyFollower, BodyLevel, BodyOptions, CadModule, CadSkin, CadTaxel,
    CalibratedTaxel, Folds, HeldBack, JointOffset, LevelScore, Misassembled, Misassembly, ModuleId,
    ModuleNames, ModulePose, MotionTest, NamedTaxel, ProbeOffset, Tolerance, TouchDelay, TouchId,
    TurnedModule, fit_bodies, fit_bodies_with,
};
pub use calibration::{Calibration, GoodnessOfFit, ObservationDiagnostics};
pub use error::{CalibError, SheetDefect};
pub use follow::{FollowedSolve, FollowedTouch, Follower, Innovation};
pub use observations::information::Information;
pub use observations::{
    ContactMeasurement, ContactObservation, ContactObservationId, Displacement, DisplacementId,
    DisplacementMeasurement, JointMotion, Model, ObservationId, Observations, PerObservation,
    PoseMeasurement, TaxelVariable, TouchJoint, TouchRow, TouchingBody,
};
pub use options::{CalibOptions, Initialization, ResidualConvention};
pub use pose::Pose;
pub(crate) use pose::{exp, outer};
pub(crate) use sensor_layout::SensorLayout;
pub use simulate::{SimulateOptions, Simulation, simulate, simulate_with};
pub use skin::{CalibratedSkin, calibrated_skin};
pub use solve::gauge::FreeComponent;
pub use solve::loss::{Loss, Verdict};
pub use solve::marginals::Marginals;
pub use solve::solver::Iteration;

pub(in crate::calib) use observations::{Component, Poses, components};
pub(in crate::calib) use solve::gauge::{FreeBody, RigidMotion, free_components, free_under};
pub(in crate::calib) use solve::loss::{LossFunctions, Weighting};
pub(in crate::calib) use solve::normal_equations::{BlockLayout, Problem};
pub(in crate::calib) use solve::solver::{Iterate, Solver, normal_equations};

use crate::run::Run;
use robust::{Solution, automatic, goodness_of_fit::goodness_of_fit, robust_fit};
use solve::{initial::initial_poses, marginals::marginals};

/// Finds the taxel poses that explain the observations best: `min 1/2 sum e' Omega e`, equation 1
/// of the source paper, with robust estimation and covariances.
///
/// A component that contacts do not fully constrain has gauge freedom: its gauge taxel keeps its
/// initial pose along the unconstrained motions ([`Calibration::free`]). Cost, shape and
/// covariances do not depend on that choice. The result does not depend on the number of threads.
///
/// ```
/// use dermatome::calib::{CalibOptions, SimulateOptions, calibrate, compare, simulate};
///
/// let simulation = simulate(&SimulateOptions { taxels: 50, ..SimulateOptions::default() })?;
/// let found = calibrate(&simulation.observations, &CalibOptions::default())?;
/// assert!(found.termination.is_converged());
/// let rmse = compare(&found.poses, &simulation.truth)?.rigid;
/// assert!(rmse < 2e-3, "{rmse} m");
/// # Ok::<(), dermatome::calib::CalibError>(())
/// ```
///
/// # Errors
/// If observations break a rule ([`Observations::validate`]) or do not determine the pose of a taxel. A solve
/// that does not converge is not an error: see [`Calibration::termination`].
pub fn calibrate(observations: &Observations, options: &CalibOptions) -> Result<Calibration, CalibError> {
    calibrate_with(observations, options, Run::default())
}

/// As [`calibrate`], in a [`Run`].
///
/// # Errors
/// As [`calibrate`], and if it is cancelled.
pub fn calibrate_with(
    observations: &Observations,
    options: &CalibOptions,
    run: Run<'_>,
) -> Result<Calibration, CalibError> {
    observations.validate()?;
    options.validate()?;
    let clock = Instant::now();
    let start = initial_poses(observations, options.initialization)?;
    let problem = Problem::new(observations, options.residual)?;
    let mut solver = Solver { problem: &problem, options, run, iterations: Vec::new() };
    let solution = estimate(&mut solver, start)?;
    let fit = goodness_of_fit(&solver, &solution);
    let iterations = solver.iterations;
    let Solution { iterate, weights, losses, termination, .. } = &solution;
    let free = free_under(&problem, &iterate.poses, weights);
    let marginals =
        options.covariances.then(|| marginals(&problem, &free, &iterate.poses, weights)).transpose()?;
    Ok(Calibration {
        model: observations.model,
        ids: observations.taxels.map(|t| t.id),
        marginals,
        residual: options.residual,
        loss: losses.loss,
        cost: iterate.cost,
        fit,
        diagnostics: diagnostics(&problem, &solution),
        free: free.iter().map(|body| body.describe(observations)).collect(),
        iterations,
        termination: *termination,
        seconds: clock.elapsed().as_secs_f64(),
        poses: solution.iterate.poses,
    })
}

fn estimate(solver: &mut Solver<'_>, start: Poses) -> Result<Solution, CalibError> {
    let Some(loss) = solver.options.robust else { return automatic(solver, start) };
    let losses = LossFunctions::new(&solver.problem.dimensions, loss);
    match loss {
        Loss::Squared => Solution::least_squares(solver, start),
        Loss::Huber => Solution::of_losses(solver, start, &losses),
        Loss::Tukey | Loss::Truncated => robust_fit(solver, start, &losses),
    }
}

fn diagnostics(problem: &Problem<'_>, solution: &Solution) -> PerObservation<ObservationDiagnostics> {
    let Solution { iterate, weights, verdicts, losses, .. } = solution;
    // Least squares rejects nothing, but observations beyond the outlier bound are reported.
    let beyond = (losses.loss == Loss::Squared)
        .then(|| LossFunctions::new(&problem.dimensions, Loss::Truncated).verdicts(&iterate.chi2));
    let weighed = iterate.chi2.zip(weights, |chi2, weight| (chi2, weight));
    let diagnosed = |(chi2, weight), verdict| ObservationDiagnostics { chi2, weight, verdict };
    weighed.zip(beyond.as_ref().unwrap_or(verdicts), diagnosed)
}
