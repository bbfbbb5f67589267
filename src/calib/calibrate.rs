use std::time::Instant;

use crate::{
    calib::{
        CalibError, ContactObservationId, DisplacementId, GoodnessOfFit, Initialization, Iteration,
        Marginals, Method, Model, Observations, Pose, ResidualConvention, Robust, StopCriteria, Termination,
        robust::automatic::{Found, Search},
        robust::goodness_of_fit::fit,
        solve::gauge::{Anchoring, Free},
        solve::initial::start,
        solve::loss::Kernels,
        solve::marginals::marginals,
        solve::normal_equations::Problem,
    },
    id::{IdVec, VertexId},
    skin::TaxelId,
};

/// Options of [`calibrate`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CalibOptions {
    /// How the error of a relative pose becomes numbers; without meaning for positions.
    pub residual: ResidualConvention,
    /// What to do about observations that do not fit.
    pub robust: Robust,
    /// Where to start.
    pub start: Initialization,
    /// How to step.
    pub method: Method,
    /// When to end.
    pub limits: StopCriteria,
    /// Whether to compute covariances.
    pub uncertainty: Uncertainty,
}

/// Whether to compute covariances.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Uncertainty {
    /// Of every taxel.
    #[default]
    Marginals,
    /// Of none.
    Skip,
}

/// A component of the graph that the contacts do not hold, or not in every direction.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeComponent {
    /// The taxel that keeps its start if nothing at all was observed of where the component is.
    pub gauge: TaxelId,
    /// Number of its taxels.
    pub taxels: usize,
    /// Independent motions of the whole that no contact determines.
    pub directions: usize,
    /// Contacts of its taxels that were let go and determine nothing.
    pub let_go: usize,
}

/// How well every observation fits, and what it counts for.
#[derive(Debug, Clone, PartialEq)]
pub struct Weights {
    /// Squared whitened error of every edge.
    pub edge_squares: IdVec<DisplacementId, f64>,
    /// Weight of every edge in the result: 1 without robust kernel, near 0 if the kernel let go of it.
    pub edges: IdVec<DisplacementId, f64>,
    /// Whether the stated noise explains the edge, and its length does not speak against it.
    pub edge_kept: IdVec<DisplacementId, bool>,
    /// Squared whitened error of every contact.
    pub contact_squares: IdVec<ContactObservationId, f64>,
    /// Weight of every contact.
    pub contacts: IdVec<ContactObservationId, f64>,
    /// Whether the stated noise explains the contact.
    pub contact_kept: IdVec<ContactObservationId, bool>,
}

impl Weights {
    /// The edges that count less because noise does not explain them, or whose taxel nothing else holds.
    pub fn rejected_edges(&self) -> impl Iterator<Item = DisplacementId> {
        self.edge_kept.enumerate().filter(|(e, kept)| !**kept && self.edges[*e] < 1.0).map(|(e, _)| e)
    }

    /// Number of edges and contacts that count less.
    #[must_use]
    pub fn rejected(&self) -> usize {
        self.rejected_edges().count() + self.rejected_contacts().count()
    }

    /// The contacts that count less because noise does not explain them.
    pub fn rejected_contacts(&self) -> impl Iterator<Item = ContactObservationId> {
        self.contact_kept.enumerate().filter(|(c, kept)| !**kept && self.contacts[*c] < 1.0).map(|(c, _)| c)
    }
}

/// Where the taxels are.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// What was unknown of every taxel.
    pub model: Model,
    /// The ids of the taxels.
    pub ids: IdVec<VertexId, TaxelId>,
    /// Their poses; in the positions model the rotation is the identity.
    pub poses: IdVec<VertexId, Pose>,
    /// Their covariances, if wanted.
    pub marginals: Option<Marginals>,
    /// The convention of `cost` and `fit`.
    pub residual: ResidualConvention,
    /// What was done about observations that do not fit; never [`Robust::Automatic`].
    pub robust: Robust,
    /// Half of the sum of squared whitened errors, robust kernels applied.
    pub cost: f64,
    /// Goodness of fit.
    pub fit: GoodnessOfFit,
    /// How well every observation fits.
    pub weights: Weights,
    /// Components that nothing anchors.
    pub free: Vec<FreeComponent>,
    /// The steps taken.
    pub iterations: Vec<Iteration>,
    /// Why it ended.
    pub termination: Termination,
    /// Wall-clock seconds of the start, the optimisation and the covariances.
    pub seconds: [f64; 3],
}

/// Finds the taxel poses that explain the observations best: the source paper's equation 1,
/// `min 1/2 sum e' Omega e`, with a start, robust kernels and covariances around it.
///
/// Where no contact says where a connected component is, its gauge taxel keeps its start, and where the contacts leave some of
/// its motions open, it stays as near as they let it ([`FreeComponent`]); cost, shape and covariances do not depend on
/// that choice. `watch` is told every iteration. The result does not depend on the
/// number of threads.
///
/// # Errors
/// Observations that break a promise ([`Observations::validate`]) or leave the place of a taxel open. A solve that
/// does not converge is no error: see [`Calibration::termination`].
pub fn calibrate(
    observations: &Observations,
    options: &CalibOptions,
    watch: &dyn Fn(usize, &Iteration),
) -> Result<Calibration, CalibError> {
    observations.validate()?;
    options.validate()?;
    let clock = Instant::now();
    let begin = start(observations, options.start)?;
    let started = clock.elapsed().as_secs_f64();

    let problem = Problem::new(observations, options.residual)?;
    let anchoring = Anchoring::new(&problem, &begin);
    let mut search =
        Search { problem: &problem, anchoring: &anchoring, options, iterations: Vec::new(), watch };
    let found = search.run(begin)?;
    let iterations = search.iterations;
    let fit = fit(&problem, &anchoring, &found);
    let free = anchoring.free_under(&problem, &found.point.state, &found.weights);
    let Found { point, weights, mut kept, kernels, termination } = found;
    let robust = kernels.robust;
    if robust == Robust::None {
        kept = Kernels::new(&problem.ranks, Robust::Graduated).keep(&point.squares);
    }
    let solved = clock.elapsed().as_secs_f64();

    let marginals = match options.uncertainty {
        Uncertainty::Marginals => Some(marginals(&problem, &free, &point.state, &weights)?),
        Uncertainty::Skip => None,
    };
    let seconds = [started, solved - started, clock.elapsed().as_secs_f64() - solved];
    Ok(Calibration {
        model: observations.model,
        ids: observations.taxels.map(|t| t.id),
        marginals,
        residual: options.residual,
        cost: point.cost,
        robust,
        fit,
        poses: point.state,
        weights: Weights {
            edge_squares: point.squares.edges,
            contact_squares: point.squares.contacts,
            edges: weights.edges,
            contacts: weights.contacts,
            edge_kept: kept.edges,
            contact_kept: kept.contacts,
        },
        free: free.iter().map(|f| f.describe(observations)).collect(),
        iterations,
        termination,
        seconds,
    })
}

impl CalibOptions {
    fn validate(&self) -> Result<(), CalibError> {
        let StopCriteria { iterations, relative_decrease } = self.limits;
        if iterations == 0 {
            let needed = "at least 1";
            return Err(CalibError::BadOption {
                option: "the number of iterations",
                found: "0".into(),
                needed,
            });
        }
        if !(0.0..1.0).contains(&relative_decrease) {
            let found = relative_decrease.to_string();
            return Err(CalibError::BadOption { option: "the relative decrease", found, needed: "0 to 1" });
        }
        Ok(())
    }
}

impl Free {
    fn describe(&self, observations: &Observations) -> FreeComponent {
        FreeComponent {
            gauge: observations.taxels[self.component.gauge].id,
            taxels: self.component.taxels.len(),
            directions: self.directions,
            let_go: self.let_go,
        }
    }
}
