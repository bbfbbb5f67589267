//! [`calibrate`]: the steps of a calibration in their order.

use std::time::Instant;

use crate::calib::{
    CalibError, CalibOptions, Calibration, GaugeFreedom, Iteration, Loss, LossFunctions,
    ObservationDiagnostics, Observations, PerObservation, Poses, Problem, Solver,
    robust::{Solution, automatic, goodness_of_fit::goodness_of_fit, robust_fit},
    solve::{initial::initial_poses, marginals::marginals},
};

/// Finds the taxel poses that explain the observations best: `min 1/2 sum e' Omega e`, equation 1
/// of the source paper, with robust estimation and covariances.
///
/// A component that contacts do not fully constrain has gauge freedom: its gauge taxel keeps its
/// initial pose along the unconstrained motions ([`Calibration::free`]). Cost, shape and
/// covariances do not depend on that choice. `watch` is called after every iteration, with its
/// number. The result does not depend on the number of threads.
///
/// ```
/// use dermatome::calib::{CalibOptions, SimulateOptions, calibrate, compare, simulate};
///
/// let simulation = simulate(&SimulateOptions { taxels: 50, ..SimulateOptions::default() })?;
/// let found = calibrate(&simulation.observations, &CalibOptions::default(), &|_, _| {})?;
/// assert!(found.termination.is_converged());
/// let rmse = compare(&found.poses, &simulation.truth)?.rigid;
/// assert!(rmse < 2e-3, "{rmse} m");
/// # Ok::<(), dermatome::calib::CalibError>(())
/// ```
///
/// # Errors
/// Observations that break a promise ([`Observations::validate`]) or do not determine the pose of a
/// taxel. A solve that does not converge is not an error: see [`Calibration::termination`].
pub fn calibrate(
    observations: &Observations,
    options: &CalibOptions,
    watch: &dyn Fn(usize, &Iteration),
) -> Result<Calibration, CalibError> {
    observations.validate()?;
    options.validate()?;
    let clock = Instant::now();
    let start = initial_poses(observations, options.initialization)?;
    let problem = Problem::new(observations, options.residual)?;
    let gauge = GaugeFreedom::new(&problem, &start);
    let mut solver = Solver { problem: &problem, gauge: &gauge, options, iterations: Vec::new(), watch };
    let solution = estimate(&mut solver, start)?;
    let fit = goodness_of_fit(&solver, &solution);
    let iterations = solver.iterations;
    let Solution { iterate, weights, losses, termination, .. } = &solution;
    let free = gauge.free_under(&problem, &iterate.poses, weights);
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
    // Least squares rejects nothing; what it would have to reject is reported all the same.
    let beyond = (losses.loss == Loss::Squared)
        .then(|| LossFunctions::new(&problem.dimensions, Loss::Truncated).verdicts(&iterate.chi2));
    let weighed = iterate.chi2.zip(weights, |chi2, weight| (chi2, weight));
    let diagnosed = |(chi2, weight), verdict| ObservationDiagnostics { chi2, weight, verdict };
    weighed.zip(beyond.as_ref().unwrap_or(verdicts), diagnosed)
}
