use std::time::Instant;

use crate::{
    calib::{
        CalibError, Ending, Iteration, Limits, Marginals, Method, Model, Motion, Observations, Pose,
        Residual, Robust, Start, Touch, chi_square_tail,
        gauge::{Free, free_components},
        marginals::marginals,
        normal_equations::{PerObservation, Problem, State},
        optimise::{Linear, Point, Weighting, minimise},
        reconsider::reconsider,
        robust::Kernel,
        start::start,
        undecided::{REJECTED, without_chance},
    },
    id::{ContactId, EdgeId, IdVec, TaxelId, VertexId},
};

/// Options of [`calibrate`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CalibOptions {
    /// How the error of a relative pose becomes numbers; without meaning for positions.
    pub residual: Residual,
    /// What to do about observations that do not fit.
    pub robust: Robust,
    /// Where to start.
    pub start: Start,
    /// How to step.
    pub method: Method,
    /// When to end.
    pub limits: Limits,
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

/// A component of the graph that the contacts do not hold.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeComponent {
    /// The taxel that keeps its start.
    pub gauge: TaxelId,
    /// Number of its taxels.
    pub taxels: usize,
    /// Independent motions of the whole that no contact determines.
    pub directions: usize,
}

/// Whether the stated noise is believable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// Sum of the squared whitened errors of the observations that were kept.
    pub chi2: f64,
    /// Degrees of freedom: observed numbers minus unknown numbers.
    pub degrees: usize,
    /// Chance of a larger sum if the stated noise is right. Near 0 the noise is understated (or something is wrong),
    /// near 1 overstated.
    pub p: f64,
}

impl Fit {
    /// What a user should think of it, as a sentence.
    #[must_use]
    pub fn verdict(&self) -> &'static str {
        // One calibration in a thousand is called wrong on either side.
        const DOUBTFUL: f64 = 5e-4;
        if self.degrees == 0 {
            "nothing was observed twice, so the noise cannot be judged"
        } else if self.p < DOUBTFUL {
            "the observations disagree by more than the stated noise: it is understated, or some are wrong"
        } else if self.p > 1.0 - DOUBTFUL {
            "the observations agree better than the stated noise lets expect: it is overstated, or they are not independent"
        } else {
            "the stated noise is believable"
        }
    }
}

/// How well one observation fits.
#[derive(Debug, Clone, PartialEq)]
pub struct Weights {
    /// Squared whitened error of every edge.
    pub edge_squares: IdVec<EdgeId, f64>,
    /// Weight of every edge in the result: 1 without robust kernel, near 0 if it was rejected.
    pub edges: IdVec<EdgeId, f64>,
    /// Squared whitened error of every contact.
    pub contact_squares: IdVec<ContactId, f64>,
    /// Weight of every contact.
    pub contacts: IdVec<ContactId, f64>,
}

impl Weights {
    /// The edges that were rejected.
    pub fn rejected_edges(&self) -> impl Iterator<Item = EdgeId> {
        self.edges.enumerate().filter(|(_, w)| **w < REJECTED).map(|(e, _)| e)
    }

    /// The contacts that were rejected.
    pub fn rejected_contacts(&self) -> impl Iterator<Item = ContactId> {
        self.contacts.enumerate().filter(|(_, w)| **w < REJECTED).map(|(c, _)| c)
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
    pub residual: Residual,
    /// Half of the sum of squared whitened errors, robust kernels applied.
    pub cost: f64,
    /// Goodness of fit.
    pub fit: Fit,
    /// How well every observation fits.
    pub weights: Weights,
    /// Components that nothing anchors.
    pub free: Vec<FreeComponent>,
    /// The steps taken.
    pub iterations: Vec<Iteration>,
    /// Why it ended.
    pub ending: Ending,
    /// Wall-clock seconds of the start, the optimisation and the covariances.
    pub seconds: [f64; 3],
}

/// Finds the taxel poses that explain the observations best: the source paper's equation 1,
/// `min 1/2 sum e' Omega e`, with a start, robust kernels and covariances around it.
///
/// Where no contact says where a connected component is, its gauge taxel keeps its start ([`FreeComponent`]); cost, shape and
/// covariances do not depend on that choice. `watch` is told every iteration. The result does not depend on the
/// number of threads.
///
/// # Errors
/// Observations that break a promise ([`Observations::validate`]) or leave the place of a taxel open. A solve that
/// does not converge is no error: see [`Calibration::ending`].
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
    let free = free_components(&problem, &begin);
    let mut search = Search { problem: &problem, free: &free, options, iterations: Vec::new(), watch };
    let (point, weights, ending) = search.run(begin)?;
    let iterations = search.iterations;
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
        fit: fit(&problem, &free, &point.squares, &weights),
        poses: point.state,
        weights: Weights {
            edge_squares: point.squares.edges,
            contact_squares: point.squares.contacts,
            edges: weights.edges,
            contacts: weights.contacts,
        },
        free: free.iter().map(|f| f.describe(observations)).collect(),
        iterations,
        ending,
        seconds,
    })
}

impl CalibOptions {
    fn validate(&self) -> Result<(), CalibError> {
        let Limits { iterations, relative_decrease } = self.limits;
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
        }
    }
}

/// The optimisation with its robust schedule.
struct Search<'s, 'o> {
    problem: &'s Problem<'o>,
    free: &'s [Free],
    options: &'s CalibOptions,
    iterations: Vec<Iteration>,
    watch: &'s dyn Fn(usize, &Iteration),
}

/// Growth of the control of graduated non-convexity from step to step (the paper's choice).
const GRADUATION: f64 = 1.4;

impl Search<'_, '_> {
    fn run(&mut self, begin: State) -> Result<(Point, PerObservation, Ending), CalibError> {
        match self.options.robust {
            Robust::Graduated => {
                let found = self.graduate(begin)?;
                self.doubt(found)
            }
            // Kernels that let go have many minima: start them from the one minimum of Huber's.
            Robust::Tukey | Robust::GemanMcClure => {
                let (point, _, _) = self.with_kernels(begin, Robust::Huber)?;
                let found = self.with_kernels(point.state, self.options.robust)?;
                self.doubt(found)
            }
            Robust::Huber | Robust::Cauchy => self.with_kernels(begin, self.options.robust),
            Robust::None => {
                let ones = self.problem.squares(&begin).map(|_| 1.0);
                let (point, ending) = self.minimise(Weighting::Fixed(&ones), begin)?;
                Ok((point, ones, ending))
            }
        }
    }

    /// Takes back what a kernel that lets go decided by chance.
    fn doubt(
        &mut self,
        (point, weights, ending): (Point, PerObservation, Ending),
    ) -> Result<(Point, PerObservation, Ending), CalibError> {
        match without_chance(self.problem.observations, &weights) {
            Some(weights) if ending.is_converged() => {
                let (point, ending) = self.minimise(Weighting::Fixed(&weights), point.state)?;
                Ok((point, weights, ending))
            }
            _ => Ok((point, weights, ending)),
        }
    }

    fn with_kernels(
        &mut self,
        begin: State,
        robust: Robust,
    ) -> Result<(Point, PerObservation, Ending), CalibError> {
        let (edges, contacts) = self.kernels(robust);
        let weighting = Weighting::Kernels { edges, contacts: &contacts };
        let (point, ending) = self.minimise(weighting, begin)?;
        let weights = weighting.weights(&point.squares);
        Ok((point, weights, ending))
    }

    fn kernels(&self, robust: Robust) -> (Kernel, Vec<Kernel>) {
        let degrees = |touch: &Touch| match touch {
            Touch::Position { .. } => 3,
            Touch::PositionNormal { .. } => self.problem.observations.model.unknowns().min(5),
            Touch::Pose(_) => 6,
        };
        let contacts = &self.problem.observations.contacts;
        (
            Kernel::new(robust, self.problem.observations.model.unknowns()),
            contacts.iter().map(|c| Kernel::new(robust, degrees(&c.touch))).collect(),
        )
    }

    fn minimise(&mut self, weighting: Weighting<'_>, begin: State) -> Result<(Point, Ending), CalibError> {
        let Self { problem, free, options, iterations, watch } = self;
        let mut note = |iteration: Iteration| {
            iterations.push(iteration);
            watch(iterations.len(), &iteration);
        };
        minimise(problem, free, weighting, begin, options.method, options.limits, &mut note)
    }

    /// Truncated least squares from a good start: estimate, look at every taxel anew, and again.
    fn truncate(
        &mut self,
        begin: State,
        edge_kernel: &Kernel,
        contact_kernels: &[Kernel],
    ) -> Result<(Point, PerObservation, Ending), CalibError> {
        let mut found = self.with_kernels(begin, Robust::Graduated)?;
        for _ in 0..ROUNDS {
            let mut state = found.0.state.clone();
            if !reconsider(self.problem, &mut state, edge_kernel, contact_kernels) {
                break;
            }
            found = self.with_kernels(state, Robust::Graduated)?;
        }
        Ok(found)
    }

    /// Yang, Antonante, Tzoumas and Carlone 2020, algorithm 1 with truncated least squares: one step per control
    /// value, then the observations that are left by plain least squares.
    fn graduate(&mut self, begin: State) -> Result<(Point, PerObservation, Ending), CalibError> {
        let (edge_kernel, contact_kernels) = self.kernels(Robust::Graduated);
        let ones = self.problem.squares(&begin).map(|_| 1.0);
        let (mut point, ending) = self.minimise(Weighting::Fixed(&ones), begin)?;
        if self.problem.moving() == 0 {
            return Ok((point, ones, ending));
        }
        let excess = |kernel: &Kernel, square: f64| square / kernel.bound2();
        let worst = point.squares.edges.iter().map(|&s| excess(&edge_kernel, s));
        let contacts = point.squares.contacts.iter().zip(&contact_kernels).map(|(&s, k)| excess(k, s));
        let worst = worst.chain(contacts).fold(0.0_f64, f64::max);
        // Everything fits: nothing to reject.
        if worst <= 1.0 {
            return Ok((point, ones, ending));
        }
        let mut mu = 1.0 / (2.0 * worst - 1.0);
        loop {
            let weigh = |squares: &PerObservation| PerObservation {
                edges: squares.edges.map(|&s| edge_kernel.graduated_weight(mu, s)),
                contacts: squares
                    .contacts
                    .iter()
                    .zip(&contact_kernels)
                    .map(|(&s, k)| k.graduated_weight(mu, s))
                    .collect(),
            };
            let weights = weigh(&point.squares);
            if mu > LAST_CONTROL {
                return self.truncate(point.state, &edge_kernel, &contact_kernels);
            }
            let linear = Linear::new(self.problem, self.free, &point.state, &weights);
            let step = linear.newton_step(0.0).map_err(|e| self.problem.explain(e))?;
            let state = self.problem.advanced(&point.state, &step);
            point = Point::new(self.problem, &Weighting::Fixed(&weights), state);
            let step = step.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            let iteration = Iteration { cost: point.cost, step, control: mu };
            self.iterations.push(iteration);
            (self.watch)(self.iterations.len(), &iteration);
            mu *= GRADUATION;
        }
    }
}

/// Rounds of [`reconsider`] after which truncated least squares is left as it is; each lowers the cost, and more than
/// three have not been seen.
const ROUNDS: usize = 10;

/// Control at which the graduated cost and the truncated one differ for one observation in thousands.
const LAST_CONTROL: f64 = 1e3;

fn fit(problem: &Problem<'_>, free: &[Free], squares: &PerObservation, weights: &PerObservation) -> Fit {
    let observations = problem.observations;
    let (mut chi2, mut observed) = (0.0, 0);
    // A taxel all of whose observations were rejected is neither observed nor unknown.
    let mut seen = observations.taxels.map(|_| false);
    for (id, edge) in observations.edges.enumerate() {
        if weights.edges[id] >= REJECTED {
            chi2 += squares.edges[id];
            (seen[edge.from], seen[edge.to]) = (true, true);
            let moves = problem.rows[edge.from].is_some() || problem.rows[edge.to].is_some();
            observed += if moves { edge_rank(&edge.motion) } else { 0 };
        }
    }
    for (id, contact) in observations.contacts.enumerate() {
        if weights.contacts[id] >= REJECTED {
            chi2 += squares.contacts[id];
            seen[contact.taxel] = true;
            let moves = problem.rows[contact.taxel].is_some();
            observed += if moves { touch_rank(&contact.touch, observations.model) } else { 0 };
        }
    }
    let moving = seen.enumerate().filter(|(v, seen)| **seen && problem.rows[*v].is_some()).count();
    let unknown = moving * observations.model.unknowns();
    let unknown = unknown - free.iter().map(|f| f.directions).sum::<usize>().min(unknown);
    let degrees = observed.saturating_sub(unknown);
    Fit { chi2, degrees, p: chi_square_tail(chi2, degrees as f64) }
}

fn edge_rank(motion: &Motion) -> usize {
    match motion {
        Motion::Offset { information, .. } => information.rank(),
        Motion::Relative(m) => m.information.rank(),
    }
}

fn touch_rank(touch: &Touch, model: Model) -> usize {
    match touch {
        Touch::Position { information, .. } => information.rank(),
        Touch::PositionNormal { information, normal_information, .. } => {
            let normal = if model == Model::Poses && *normal_information > 0.0 { 2 } else { 0 };
            information.rank() + normal
        }
        Touch::Pose(prior) => prior.information.rank(),
    }
}
