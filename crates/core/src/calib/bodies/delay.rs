//! How late the readings are next to the poses, as one unknown of the fit: a touch is where the body was, less its mean velocity times
//! the delay. Slides in several directions determine it.
//!
//! *Heuristic*: the standard deviation is from the scatter of the touches ("sandwich", `(huber1967)`) times [`SCATTER`], and a delay is taken off
//! beyond [`LEAST_SIGMAS`] of them, for play of joints and what the model of a press leaves look like one.

use super::options::{BodyLevel, BodyOptions};
use super::placement::Hierarchy;
use super::solve::{Solved, solve};
use super::system::BodySystem;
use super::touches::Touches;
use crate::calib::CalibError;
use crate::run::Run;

/// Errors of delays over the scatter of the touches, of 45 simulated logs.
const SCATTER: f64 = 1.6;

/// A delay is one beyond so many standard deviations.
const LEAST_SIGMAS: f64 = 5.0;

/// How late the readings are next to the poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchDelay {
    /// As the touches say, in s; below 0 the readings are early.
    pub seconds: f64,
    /// Its standard deviation, in s.
    pub sigma: f64,
    /// What was taken off, in s.
    pub removed: f64,
}

/// The delay of a fit that has it as an unknown; where it is not significant, the fit is made again without.
pub(super) fn judged(
    options: &BodyOptions,
    level: BodyLevel,
    hierarchy: &Hierarchy,
    touches: &mut Touches,
    solved: &mut Solved,
    run: Run<'_>,
) -> Result<Option<TouchDelay>, CalibError> {
    if !touches.has_delay {
        return Ok(None);
    }
    let scatter = {
        let system = BodySystem::new(&solved.learned, level, hierarchy, touches)?;
        let equations = system.linearise(&solved.placement, &solved.weights);
        let factor = system.factor(&equations)?;
        system.scatter(&factor, &solved.placement, &solved.weights, touches.joints.len())?
    };
    let seconds = solved.placement.linear.last().copied().unwrap_or_default();
    let (sigma, is_delay) = (SCATTER * scatter, seconds.abs() > LEAST_SIGMAS * SCATTER * scatter);
    if !is_delay {
        touches.has_delay = false;
        *solved = solve(options, level, hierarchy, touches, solved.placement.clone(), run)?;
    }
    Ok(Some(TouchDelay { seconds, sigma, removed: if is_delay { seconds } else { 0.0 } }))
}
