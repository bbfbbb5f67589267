use crate::calib::{
    CalibError, CalibOptions, Ending, Iteration, Robust,
    attribution::{LogOdds, attribution_odds},
    gauge::Free,
    normal_equations::{PerObservation, Problem, State},
    optimise::{Linear, Point, Weighting, minimise},
    reconsider::reconsider,
    robust::Kernels,
    undecided::take_back_chance,
};

/// The optimisation with its robust schedule.
pub(super) struct Search<'s, 'o> {
    pub(super) problem: &'s Problem<'o>,
    pub(super) free: &'s [Free],
    pub(super) options: &'s CalibOptions,
    pub(super) iterations: Vec<Iteration>,
    pub(super) watch: &'s dyn Fn(usize, &Iteration),
}

/// Growth of the control of graduated non-convexity from step to step (the paper's choice).
const GRADUATION: f64 = 1.4;

/// Where the search ended.
pub(super) struct Found {
    pub(super) point: Point,
    pub(super) weights: PerObservation,
    pub(super) kept: PerObservation<bool>,
    pub(super) ending: Ending,
}

impl Search<'_, '_> {
    pub(super) fn run(&mut self, begin: State) -> Result<Found, CalibError> {
        match self.options.robust {
            Robust::Graduated | Robust::Tukey | Robust::GemanMcClure => self.let_go(begin),
            robust @ (Robust::Huber | Robust::Cauchy) => {
                self.with_kernels(begin, &Kernels::new(self.problem.observations, robust, None))
            }
            Robust::None => self.least_squares(begin),
        }
    }

    /// Solves with a kernel that lets go, learns from what it let go, solves again, and takes back what was
    /// decided by chance.
    fn let_go(&mut self, begin: State) -> Result<Found, CalibError> {
        let observations = self.problem.observations;
        let mut found = self.reject(begin.clone(), None)?;
        let odds = attribution_odds(observations, &found.kept);
        if odds.is_some() && found.ending.is_converged() {
            found = self.reject(begin, odds.as_ref())?;
        }
        let Found { point, mut weights, mut kept, ending } = found;
        if ending.is_converged() && take_back_chance(observations, &mut weights, &mut kept, odds.as_ref()) {
            let (point, ending) = self.minimise(Weighting::Fixed(&weights), point.state)?;
            return Ok(Found { point, weights, kept, ending });
        }
        Ok(Found { point, weights, kept, ending })
    }

    fn least_squares(&mut self, begin: State) -> Result<Found, CalibError> {
        let ones = self.problem.squares(&begin).map(|_| 1.0);
        let (point, ending) = self.minimise(Weighting::Fixed(&ones), begin)?;
        Ok(Found { kept: ones.map(|_| true), point, weights: ones, ending })
    }

    fn reject(&mut self, begin: State, odds: Option<&LogOdds>) -> Result<Found, CalibError> {
        let robust = self.options.robust;
        let kernels = |robust| Kernels::new(self.problem.observations, robust, odds);
        let (kernels, huber) = (kernels(robust), kernels(Robust::Huber));
        if robust == Robust::Graduated {
            return self.graduate(begin, &kernels);
        }
        // Kernels that let go have many minima: start them from the one minimum of Huber's.
        let start = self.with_kernels(begin, &huber)?.point.state;
        self.with_kernels(start, &kernels)
    }

    fn with_kernels(&mut self, begin: State, kernels: &Kernels) -> Result<Found, CalibError> {
        let weighting = Weighting::Kernels(kernels);
        let (point, ending) = self.minimise(weighting, begin)?;
        let (weights, kept) = (kernels.weights(&point.squares), kernels.keep(&point.squares));
        Ok(Found { point, weights, kept, ending })
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
    fn truncate(&mut self, begin: State, kernels: &Kernels) -> Result<Found, CalibError> {
        let mut found = self.with_kernels(begin, kernels)?;
        for _ in 0..ROUNDS {
            let mut state = found.point.state.clone();
            if !reconsider(self.problem, &mut state, kernels) {
                break;
            }
            found = self.with_kernels(state, kernels)?;
        }
        Ok(found)
    }

    /// Yang, Antonante, Tzoumas and Carlone 2020, algorithm 1 with truncated least squares: one step per control
    /// value, then the observations that are left by plain least squares.
    fn graduate(&mut self, begin: State, kernels: &Kernels) -> Result<Found, CalibError> {
        let found = self.least_squares(begin)?;
        let worst = kernels.worst(&found.point.squares);
        // Nothing moves, or everything fits: nothing to reject.
        if self.problem.moving() == 0 || worst <= 1.0 {
            return Ok(found);
        }
        let mut point = found.point;
        let mut mu = 1.0 / (2.0 * worst - 1.0);
        while mu <= LAST_CONTROL {
            let weights = kernels.graduated_weights(mu, &point.squares);
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
        self.truncate(point.state, kernels)
    }
}

/// Rounds of [`reconsider`] after which truncated least squares is left as it is; each lowers the cost, and more than
/// three have not been seen.
const ROUNDS: usize = 10;

/// Control at which the graduated cost and the truncated one differ for one observation in thousands.
const LAST_CONTROL: f64 = 1e3;
