use crate::calib::{
    CalibError, CalibOptions, Iteration, Robust, Termination,
    robust::ambiguity::take_back_chance,
    robust::coordinate_descent::reconsider,
    robust::goodness_of_fit::{fit, middle, stands_out},
    robust::length_prior::{LogOdds, attribution_odds},
    solve::gauge::Anchoring,
    solve::levenberg_marquardt::{Linear, Point, Weighting, minimise},
    solve::loss::{Kernels, Scale},
    solve::normal_equations::{PerObservation, Problem, State},
};

/// The optimisation with its robust schedule.
pub(crate) struct Search<'s, 'o> {
    pub(crate) problem: &'s Problem<'o>,
    pub(crate) anchoring: &'s Anchoring,
    pub(crate) options: &'s CalibOptions,
    pub(crate) iterations: Vec<Iteration>,
    pub(crate) watch: &'s dyn Fn(usize, &Iteration),
}

/// Growth of the control of graduated non-convexity from step to step. The paper's 1.4 takes three times the steps of
/// these two numbers to the same accuracy, at 5, 20 and 30 % wrong edges.
const GRADUATION: f64 = 2.0;

/// Control at which an error of a million bounds still counts: wronger ones may be let go at once.
const FIRST_CONTROL: f64 = 1e-12;

/// Where the search ended.
pub(crate) struct Found {
    pub(crate) point: Point,
    pub(crate) weights: PerObservation,
    pub(crate) kept: PerObservation<bool>,
    /// What was done about observations that do not fit.
    pub(crate) kernels: Kernels,
    pub(crate) termination: Termination,
}

impl Search<'_, '_> {
    pub(crate) fn run(&mut self, begin: State) -> Result<Found, CalibError> {
        let robust = self.options.robust;
        match robust {
            Robust::Automatic => {
                let plain = self.least_squares(begin)?;
                if !self.is_doubtful(&plain) {
                    return Ok(plain);
                }
                match self.without_wrong(&plain) {
                    // A taxel that hangs on what was let go: then there was no telling.
                    Err(CalibError::Undetermined { .. }) => Ok(plain),
                    found => Ok(found?.unwrap_or(plain)),
                }
            }
            Robust::Graduated | Robust::Tukey | Robust::GemanMcClure => {
                self.let_go(begin, &Kernels::new(&self.problem.ranks, robust))
            }
            Robust::Huber | Robust::Cauchy => {
                self.with_kernels(begin, &Kernels::new(&self.problem.ranks, robust))
            }
            Robust::None => self.least_squares(begin),
        }
    }

    /// Whether least squares leave more than the stated noise explains, or one observation stands out.
    fn is_doubtful(&self, plain: &Found) -> bool {
        if !plain.termination.is_converged() {
            return true;
        }
        let squares = &plain.point.squares;
        // Where every square is within its bound there is nothing to let go.
        if Kernels::new(&self.problem.ranks, Robust::Graduated).worst(squares) <= 1.0 {
            return false;
        }
        let fit = fit(self.problem, self.anchoring, plain);
        // Fitting makes the squares of all smaller.
        fit.is_too_large()
            || fit.degrees > 0 && stands_out(&self.problem.ranks, fit.redundancy(), squares, &plain.kept)
    }

    /// What is found when wrong observations are let go, if some are: truncated least squares.
    ///
    /// Where much is let go, either much is wrong or the noise is understated. Then the scale of most errors decides: bounds
    /// that are wider by it let go of less, which widens the scale, until it stays. The smallest scale that
    /// explains itself is the one to believe.
    fn without_wrong(&mut self, plain: &Found) -> Result<Option<Found>, CalibError> {
        let begin = || plain.point.state.clone();
        let stated = Kernels::new(&self.problem.ranks, Robust::Graduated);
        let mut found = self.let_go(begin(), &stated)?;
        if found.termination == Termination::OutOfIterations {
            // There is doubt, and no means to resolve it.
            return Ok(Some(found));
        }
        if !is_few(&found, SUSPICIOUS) {
            let mut scale = self.scale(&found);
            for _ in 0..RESCALINGS {
                let wide = self.graduate(begin(), &stated.scaled(scale))?;
                let wider = self.scale(&wide).most(scale);
                let steady = wider.edges <= STEADY * scale.edges && wider.contacts <= STEADY * scale.contacts;
                scale = wider;
                if steady {
                    break;
                }
            }
            if !scale.is_as_stated() {
                let wide = self.let_go(begin(), &stated.scaled(scale))?;
                let mut both = wide.kept.edges.iter().zip(&found.kept.edges);
                // Contacts that contradict each other tear edges apart that agree without them.
                if scale.is_as_stated_of_edges() && both.any(|(wide, stated)| !wide && *stated) {
                    return Ok(None);
                }
                found = wide;
            }
        }
        Ok(self.is_better(&found, plain).then_some(found))
    }

    /// How much larger the squares of most observations are than their stated noise lets expect.
    fn scale(&self, found: &Found) -> Scale {
        let fit = fit(self.problem, self.anchoring, found);
        let middle = middle(&self.problem.ranks, &found.point.squares);
        // Fitting makes squares smaller.
        let scale = |middle: f64| (middle * fit.redundancy()).max(1.0);
        Scale { edges: scale(middle.edges), contacts: scale(middle.contacts) }
    }

    /// Whether letting go found something that is wrong, and left enough to tell. Where nothing is wrong but the stated
    /// noise, what is let go does not stand out.
    fn is_better(&self, found: &Found, plain: &Found) -> bool {
        let fit = fit(self.problem, self.anchoring, found);
        let rejected = found.kept.map(|kept| !kept);
        // Fitting makes the squares of the others smaller, and those of what was let go as much larger.
        let lever = fit.redundancy() * fit.redundancy();
        let stands_out = || stands_out(&self.problem.ranks, lever, &found.point.squares, &rejected);
        found.termination.is_converged()
            && is_few(found, MOST)
            && fit.degrees > 0
            && (!plain.termination.is_converged() || stands_out())
    }

    /// Solves with kernels that let go, learns from what they let go, solves again, and takes back what was decided by
    /// chance.
    fn let_go(&mut self, begin: State, kernels: &Kernels) -> Result<Found, CalibError> {
        let observations = self.problem.observations;
        let mut found = self.reject(begin.clone(), kernels, None)?;
        let odds = attribution_odds(observations, &found.kept);
        if let Some(odds) = odds.as_ref().filter(|_| found.termination.is_converged()) {
            found = self.reject(begin, &kernels.with_odds(odds), Some(odds))?;
        }
        if found.termination.is_converged()
            && take_back_chance(observations, &mut found, odds.as_ref(), kernels)
        {
            let weighting = Weighting::Fixed(&found.weights);
            (found.point, found.termination) = self.minimise(weighting, found.point.state)?;
            // The cost of one kernel, whoever decided.
            found.point.cost = Weighting::Kernels(&found.kernels).cost(&found.point.squares);
        }
        Ok(found)
    }

    fn least_squares(&mut self, begin: State) -> Result<Found, CalibError> {
        let kernels = Kernels::new(&self.problem.ranks, Robust::None);
        let ones = self.problem.ranks.map(|_| 1.0);
        let (point, termination) = self.minimise(Weighting::Fixed(&ones), begin)?;
        Ok(Found { point, kept: ones.map(|_| true), weights: ones, kernels, termination })
    }

    fn reject(
        &mut self,
        begin: State,
        kernels: &Kernels,
        odds: Option<&LogOdds>,
    ) -> Result<Found, CalibError> {
        if kernels.robust == Robust::Graduated {
            return self.graduate(begin, kernels);
        }
        // Kernels that let go have many minima: start them from the one minimum of Huber's.
        let huber = Kernels::new(&self.problem.ranks, Robust::Huber);
        let huber = odds.map_or_else(|| huber.clone(), |odds| huber.with_odds(odds));
        let start = self.with_kernels(begin, &huber)?.point.state;
        self.with_kernels(start, kernels)
    }

    fn with_kernels(&mut self, begin: State, kernels: &Kernels) -> Result<Found, CalibError> {
        let (point, termination) = self.minimise(Weighting::Kernels(kernels), begin)?;
        let (weights, kept) = (kernels.weights(&point.squares), kernels.keep(&point.squares));
        Ok(Found { point, weights, kept, kernels: kernels.clone(), termination })
    }

    fn minimise(
        &mut self,
        weighting: Weighting<'_>,
        begin: State,
    ) -> Result<(Point, Termination), CalibError> {
        let Self { problem, anchoring, options, iterations, watch } = self;
        let mut note = |iteration: Iteration| {
            iterations.push(iteration);
            watch(iterations.len(), &iteration);
        };
        minimise(problem, anchoring, weighting, begin, options.method, options.limits, &mut note)
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
            return Ok(Found { kernels: kernels.clone(), ..found });
        }
        let mut point = found.point;
        let mut mu = (2.0 * worst - 1.0).recip().max(FIRST_CONTROL);
        let mut steps = 0;
        while mu <= LAST_CONTROL {
            if steps == self.options.limits.iterations {
                let weights = kernels.graduated_weights(mu, &point.squares);
                let kept = kernels.keep(&point.squares);
                point.cost = Weighting::Kernels(kernels).cost(&point.squares);
                let (kernels, termination) = (kernels.clone(), Termination::OutOfIterations);
                return Ok(Found { point, weights, kept, kernels, termination });
            }
            steps += 1;
            let weights = kernels.graduated_weights(mu, &point.squares);
            let free = self.anchoring.free_under(self.problem, &point.state, &weights);
            let linear = Linear::new(self.problem, &free, &point.state, &weights);
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

/// Share of the edges, or of the contacts, that can be wrong for the others to tell.
const MOST: f64 = 0.5;

/// Share of them that is let go if noise that is understated by half, at least, is all that is wrong.
const SUSPICIOUS: f64 = 0.1;

/// Whether no more than this `share` of edges was let go, and of contacts.
fn is_few(found: &Found, share: f64) -> bool {
    let few = |kept: &[bool]| kept.iter().filter(|&&k| !k).count() as f64 <= share * kept.len() as f64;
    few(found.kept.edges.as_slice()) && few(found.kept.contacts.as_slice())
}

/// Rounds of [`Search::without_wrong`] that widen the scale; three have been enough.
const RESCALINGS: usize = 6;

/// A scale that grows by less than this factor stays.
const STEADY: f64 = 1.3;

/// Rounds of [`reconsider`] after which truncated least squares is left as it is; each lowers the cost, and more than
/// three have not been seen.
const ROUNDS: usize = 10;

/// Control at which the graduated cost and the truncated one differ for one observation in thirty.
const LAST_CONTROL: f64 = 30.0;
