use crate::calib::{
    CalibError, CalibOptions, Ending, Iteration, Robust,
    attribution::{LogOdds, attribution_odds},
    fit::{fit, stands_out},
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

/// Growth of the control of graduated non-convexity from step to step. The paper's 1.4 takes three times the steps of
/// these two numbers to the same accuracy, at 5, 20 and 30 % wrong edges.
const GRADUATION: f64 = 2.0;

/// Control at which an error of a million bounds still counts: wronger ones may be let go at once.
const FIRST_CONTROL: f64 = 1e-12;

/// Where the search ended.
pub(super) struct Found {
    pub(super) point: Point,
    pub(super) weights: PerObservation,
    pub(super) kept: PerObservation<bool>,
    /// Squares up to which observations are kept.
    pub(super) bounds: PerObservation,
    /// What was done about observations that do not fit.
    pub(super) robust: Robust,
    pub(super) ending: Ending,
}

impl Search<'_, '_> {
    pub(super) fn run(&mut self, begin: State) -> Result<Found, CalibError> {
        match self.options.robust {
            Robust::Automatic => {
                let plain = self.least_squares(begin)?;
                if !self.is_doubtful(&plain) {
                    return Ok(plain);
                }
                let found = self.let_go(plain.point.state.clone(), Robust::Graduated)?;
                // What lets go of nothing is least squares.
                let robust = if found.kept.iter().all(|kept| kept) { Robust::None } else { found.robust };
                Ok(if self.is_better(&found, &plain) { Found { robust, ..found } } else { plain })
            }
            robust @ (Robust::Graduated | Robust::Tukey | Robust::GemanMcClure) => self.let_go(begin, robust),
            robust @ (Robust::Huber | Robust::Cauchy) => {
                self.with_kernels(begin, &Kernels::new(self.problem.observations, robust, None))
            }
            Robust::None => self.least_squares(begin),
        }
    }

    /// Whether least squares leave more than the stated noise explains, or one observation stands out.
    fn is_doubtful(&self, plain: &Found) -> bool {
        if !plain.ending.is_converged() {
            return true;
        }
        let observations = self.problem.observations;
        let squares = &plain.point.squares;
        // Where every square is within its bound there is nothing to let go.
        if Kernels::new(observations, Robust::Graduated, None).worst(squares) <= 1.0 {
            return false;
        }
        let fit = fit(self.problem, self.free, plain);
        // Fitting makes the squares of all smaller.
        fit.is_too_large()
            || fit.degrees > 0 && stands_out(observations, fit.redundancy(), squares, &plain.kept)
    }

    /// Whether letting go found something that is wrong, and left enough to tell. Where nothing is wrong but the stated
    /// noise, what is let go does not stand out.
    fn is_better(&self, found: &Found, plain: &Found) -> bool {
        let fit = fit(self.problem, self.free, found);
        let rejected = found.kept.map(|kept| !kept);
        let few = rejected.iter().filter(|&r| r).count() <= rejected.iter().count() / 2;
        // Fitting makes the squares of the others smaller, and those of what was let go as much larger.
        let lever = fit.redundancy() * fit.redundancy();
        let stands_out = || stands_out(self.problem.observations, lever, &found.point.squares, &rejected);
        found.ending.is_converged()
            && few
            && fit.degrees > 0
            && (!plain.ending.is_converged() || stands_out())
    }

    /// Solves with a kernel that lets go, learns from what it let go, solves again, and takes back what was
    /// decided by chance.
    fn let_go(&mut self, begin: State, robust: Robust) -> Result<Found, CalibError> {
        let observations = self.problem.observations;
        let mut found = self.reject(begin.clone(), robust, None)?;
        let odds = attribution_odds(observations, &found.kept);
        if odds.is_some() && found.ending.is_converged() {
            found = self.reject(begin, robust, odds.as_ref())?;
        }
        if found.ending.is_converged()
            && take_back_chance(observations, &mut found.weights, &mut found.kept, odds.as_ref())
        {
            let weighting = Weighting::Fixed(&found.weights);
            (found.point, found.ending) = self.minimise(weighting, found.point.state)?;
        }
        Ok(found)
    }

    fn least_squares(&mut self, begin: State) -> Result<Found, CalibError> {
        let ones = self.problem.squares(&begin).map(|_| 1.0);
        let (point, ending) = self.minimise(Weighting::Fixed(&ones), begin)?;
        let (kept, bounds) = (ones.map(|_| true), ones.map(|_| f64::INFINITY));
        Ok(Found { point, weights: ones, kept, bounds, robust: Robust::None, ending })
    }

    fn reject(&mut self, begin: State, robust: Robust, odds: Option<&LogOdds>) -> Result<Found, CalibError> {
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
        Ok(Found { point, weights, kept, bounds: kernels.bounds(), robust: kernels.robust, ending })
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
        // Nothing moves, or everything fits: nothing to reject. Or not even the worst has a number.
        if self.problem.moving() == 0 || worst <= 1.0 || !worst.is_finite() {
            return Ok(Found { robust: kernels.robust, ..found });
        }
        let mut point = found.point;
        let mut mu = (2.0 * worst - 1.0).recip().max(FIRST_CONTROL);
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

/// Control at which the graduated cost and the truncated one differ for one observation in thirty.
const LAST_CONTROL: f64 = 30.0;
