//! Least energy on one level: from a map without flips, or from scratch.

use crate::flatten::distortion::FAR;
use crate::flatten::domain::FlattenDomain;
use crate::flatten::energy::elements::{ElementMesh, Uv};
use crate::flatten::energy::newton::{Ended, NewtonLimits, Solver};
use crate::flatten::energy::objective::{Objective, dirichlet};
use crate::flatten::fillers::Fillers;
use crate::flatten::overlap::{has_no_branch_points, is_one_to_one, keeps_holes, overlaps};
use crate::flatten::start::conformal::spectral_conformal;
use crate::flatten::start::tutte::{equal_springs, tutte};
use crate::flatten::start::untangle::untangle;
use crate::flatten::{Convergence, Energy, FlattenError, Overlap};
use crate::run::Run;
use crate::sparse::SparseError;

/// Systems up to this size are factored. Above, conjugate gradients reach the same energy sooner if
/// they start from the optimum of the next coarser level (at 5000 vertices in half of the time); from any
/// other map, or with fillers, they take ten times as long (measured on a star of 20k faces).
const FACTORED: usize = 3000;

/// Newton steps with a factored system: 3 to 10 are usual from a conformal start, 30 to 80 from a
/// convex one.
const EXACT: NewtonLimits = NewtonLimits { rest: 1e-16, steps: 200, gain: ENOUGH, most: f64::INFINITY };

/// Newton steps on a larger level. From the optimum of the next coarser level two to eight end
/// within 1e-6 of the optimum (measured from 10k to a million faces); a convex start needs many more.
const TRUNCATED: NewtonLimits = NewtonLimits { rest: 5e-7, steps: 100, gain: ENOUGH, most: f64::INFINITY };

/// A start of more energy than this at its best scale is worse than the one inside a circle: the
/// conformal map of a bunny with holes has 1e4, and Newton needs 40 steps from it instead of 8.
const BAD_START: f64 = FAR;

/// A map of more energy than this at its best scale is poor, and a face has collapsed on it if it is
/// stretched this many times more in one direction than in the other.
const POOR: f64 = 10.0;
const COLLAPSED: f64 = 1000.0;

/// How much the rest shape of a face may be stretched in a gradual descent, at most, its steps between new rest shapes,
/// and how often they are made at most.
const GRADUAL: f64 = 2.0;
const GRADUAL_STEPS: NewtonLimits = NewtonLimits { rest: 1e-3, steps: 3, gain: ENOUGH, most: f64::INFINITY };
const GRADUAL_ROUNDS: usize = 60;

/// Weights of all fillers together, round by round, of a surface that weighs 1: heavy fillers make
/// room early, light ones do not hinder a rim that slides. The last one stays.
const WEIGHTS: [f64; 3] = [1e-2, 1e-3, 1e-4];

/// Newton steps between fillers that are made anew, without and with a frame around the map, which
/// has to follow its growth.
const ROUND: usize = 6;
const FRAMED_ROUND: usize = 2;

/// Relative decrease of the energy in a round at which the minimisation with fillers ends. Rims
/// slide along each other for long after, invisibly: five long tubes that meet would end
/// at 21.73 instead of 21.76, in a third more time.
const ENOUGH: f64 = 1e-3;

/// What the intrinsic method minimises, and what it must keep.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Goal {
    pub(crate) energy: Energy,
    pub(crate) overlap: Overlap,
}

/// What keeps a map from overlapping itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Scaffold {
    /// Nothing: its free boundary does not.
    #[default]
    None,
    /// Fillers in the holes.
    Holes,
    /// Fillers in the holes and around the outer loop.
    Framed,
}

impl Scaffold {
    /// The fillers of the map `uv`; none where a loop crosses itself.
    pub(crate) fn fillers(self, domain: &FlattenDomain<'_>, uv: &Uv) -> Option<Fillers> {
        match self {
            Self::None => Some(Fillers::default()),
            Self::Holes | Self::Framed => Fillers::new(&domain.disk.loops, uv, self == Self::Framed).ok(),
        }
    }
}

/// A map without flips after Newton steps, in units of its domain.
#[derive(Debug, Clone)]
pub(crate) struct Relaxed {
    pub(crate) uv: Uv,
    pub(crate) scaffold: Scaffold,
    pub(crate) convergence: Convergence,
}

impl Relaxed {
    /// Whether the map is poor because faces of it have collapsed: no step gets past them, so another start may
    /// lead to a better one.
    pub(crate) fn is_caught(&self, domain: &FlattenDomain<'_>) -> bool {
        let mut singular = domain.elements.faces.iter().map(|e| e.singular_values(&self.uv));
        dirichlet(&domain.elements, &self.uv).energy() >= POOR
            && singular.any(|s| s.s1 >= COLLAPSED * s.s2.abs())
    }
}

/// Whether `map` overlaps itself less than `other` or has less energy.
pub(crate) fn is_better(domain: &FlattenDomain<'_>, goal: Goal, map: &Relaxed, other: &Relaxed) -> bool {
    let objective = Objective::new(&domain.elements, goal.energy);
    let rank = |map: &Relaxed| (overlaps(domain.mesh, &map.uv), objective.energy(&map.uv));
    rank(map) < rank(other)
}

/// The conformal map, or one inside a circle where that is a bad start; with prescribed places one within them.
pub(crate) fn start_from_scratch(domain: &FlattenDomain<'_>) -> Result<Uv, FlattenError> {
    if !domain.prescribed.is_empty() {
        return start_within(domain);
    }
    let conformal = spectral_conformal(domain)?;
    let is_good = domain.elements.is_flip_free(&conformal)
        && has_no_branch_points(domain, &conformal)
        && keeps_holes(&domain.disk.loops, &conformal)
        && dirichlet(&domain.elements, &conformal).energy() < BAD_START;
    if is_good { Ok(conformal) } else { tutte(domain) }
}

/// A start within a prescribed boundary: by springs, which a convex one keeps apart; else the flips
/// are removed.
fn start_within(domain: &FlattenDomain<'_>) -> Result<Uv, FlattenError> {
    if let Ok(uv) = tutte(domain) {
        return Ok(uv);
    }
    let mut uv = equal_springs(domain).map_err(failed)?;
    untangle(domain, &mut uv).map_err(failed)?;
    domain.elements.first_flip(&uv).map_or(Ok(uv), |face| Err(FlattenError::NoRoom { face }))
}

/// Removes flips locally if that is possible, else starts again inside a circle.
///
/// Flipped faces can be turned back so that the map winds twice about some vertices (branch
/// points), and so does the conformal map of a coarse tube. Newton steps, which flip nothing, would
/// keep it so: that is not a start either.
pub(crate) fn make_locally_injective(domain: &FlattenDomain<'_>, mut uv: Uv) -> Result<Uv, FlattenError> {
    let is_flip_free = untangle(domain, &mut uv).map_err(failed)?;
    if is_flip_free && has_no_branch_points(domain, &uv) { Ok(uv) } else { tutte(domain) }
}

/// A map without flips to start from.
#[derive(Debug)]
pub(crate) enum Start {
    /// Far from the optimum.
    Far(Uv),
    /// Far from it, with faces so collapsed that they would stop each step: rest shapes change gradually from those
    /// on the map to those of the skin.
    Gradual(Uv),
    /// From the optimum of a coarser level, with the scaffold that it needed.
    Near(Uv, Scaffold),
}

/// Minimises the energy; `limits` instead of the usual ones for the size.
///
/// First with a free boundary. Where a hole does not stay a hole, the descent goes on with fillers
/// from the last map that kept it; where the map overlaps itself although it must not, with a frame
/// from the last map that did not. A hole cannot be left to the energy alone: the rim of a long
/// tube's hole is pressed together, and gains by sliding through itself until the map around it
/// overlaps the rest. A frame from the start would hinder the growth of the outer loop.
pub(crate) fn relax(
    domain: &FlattenDomain<'_>,
    start: Start,
    goal: Goal,
    limits: Option<NewtonLimits>,
    run: Run<'_>,
) -> Result<Relaxed, FlattenError> {
    let is_large = domain.vertices() > FACTORED;
    let is_gradual = matches!(start, Start::Gradual(_));
    let (start, scaffold, solver) = match start {
        Start::Near(uv, Scaffold::None) if is_large => (uv, Scaffold::None, Solver::Iterative),
        Start::Near(uv, scaffold) => (uv, scaffold, Solver::Direct),
        Start::Far(uv) | Start::Gradual(uv) => (uv, Scaffold::None, Solver::Direct),
    };
    let limits = limits.unwrap_or(if is_large { TRUNCATED } else { EXACT });
    let objective = Objective::new(&domain.elements, goal.energy);
    let descent = Descent { domain, objective, goal, solver, limits, is_gradual, run };
    let mut reached = descent.free(start, scaffold)?;
    if reached.is_hopeless {
        return Ok(reached.relaxed);
    }
    if scaffold != Scaffold::Framed && !keeps_holes(&domain.disk.loops, &reached.relaxed.uv) {
        let from = reached.kept.take().map_or_else(|| tutte(domain), Ok)?;
        reached = descent.scaffolded(from, Scaffold::Holes)?;
    }
    let is_free = domain.prescribed.is_empty();
    if is_free && goal.overlap == Overlap::Prevent && !is_one_to_one(&domain.disk.loops, &reached.relaxed.uv)
    {
        let from = match reached.apart.take() {
            Some(uv) => uv,
            None => descent.free(tutte(domain)?, Scaffold::Framed)?.last_apart(),
        };
        reached = descent.scaffolded(from, Scaffold::Framed)?;
        // A frame whose triangles rounding has left without area prevents nothing.
        if !is_one_to_one(&domain.disk.loops, &reached.relaxed.uv)
            && let Some(apart) = reached.apart.take()
        {
            reached.relaxed.uv = apart;
            reached.relaxed.convergence.converged = false;
        }
    }
    Ok(reached.relaxed)
}

/// A minimisation on one level.
struct Descent<'d> {
    domain: &'d FlattenDomain<'d>,
    objective: Objective<'d>,
    goal: Goal,
    solver: Solver,
    limits: NewtonLimits,
    is_gradual: bool,
    run: Run<'d>,
}

/// Where a descent ended, and the last maps before it with holes and without overlap, which the end may have lost.
struct Reached {
    relaxed: Relaxed,
    /// The last map whose holes were holes.
    kept: Option<Uv>,
    /// The last map that did not overlap itself, where that matters.
    apart: Option<Uv>,
    /// Whether it ended because its map cannot be used.
    is_hopeless: bool,
}

impl Reached {
    fn last_apart(self) -> Uv {
        self.apart.unwrap_or(self.relaxed.uv)
    }
}

impl<'d> Descent<'d> {
    fn start(&self, uv: Uv, scaffold: Scaffold) -> Reached {
        let relaxed = Relaxed {
            uv: Uv::default(),
            scaffold,
            convergence: Convergence { converged: false, gradient: f64::NAN },
        };
        let mut reached = Reached { relaxed, kept: None, apart: None, is_hopeless: false };
        self.note(&uv, &mut reached.kept, &mut reached.apart);
        reached.relaxed.uv = uv;
        reached
    }

    /// Stores a copy of the map (without the posts of the scaffold at the end) in `kept` if it keeps its
    /// holes, and in `apart` if it does not overlap itself; returns whether either is so.
    fn note(&self, uv: &Uv, kept: &mut Option<Uv>, apart: &mut Option<Uv>) -> [bool; 2] {
        let domain = self.domain;
        let own = || Some(uv.iter().take(domain.vertices()).copied().collect());
        let is_kept = keeps_holes(&domain.disk.loops, uv);
        if is_kept {
            *kept = own();
        }
        let is_apart = self.goal.overlap == Overlap::Prevent && is_one_to_one(&domain.disk.loops, uv);
        if is_apart {
            *apart = own();
        }
        [is_kept, is_apart]
    }

    /// With a free boundary, for as long as the map keeps its holes, and with `scaffold` around it also that it does
    /// not overlap itself if the start did not.
    fn free(&self, start: Uv, scaffold: Scaffold) -> Result<Reached, FlattenError> {
        let mut reached = self.start(start, Scaffold::None);
        let Reached { relaxed, kept, apart, is_hopeless } = &mut reached;
        let must_be_apart = scaffold == Scaffold::Framed && apart.is_some();
        let mut go_on = |uv: &Uv| {
            let [is_kept, is_apart] = self.note(uv, kept, apart);
            is_kept && (is_apart || !must_be_apart) && self.run.step().is_ok()
        };
        for _ in 0..GRADUAL_ROUNDS {
            let Some(elements) = self.bounded(&relaxed.uv) else { break };
            let objective = self.objective.on(&elements);
            let ended = objective.minimise(&mut relaxed.uv, Solver::Direct, GRADUAL_STEPS, &mut go_on);
            if ended.map_err(failed)? == Ended::Stopped {
                break;
            }
        }
        let ended = self.objective.minimise(&mut relaxed.uv, self.solver, self.limits, &mut go_on);
        let ended = ended.map_err(failed)?;
        self.run.check()?;
        *is_hopeless = ended == Ended::Hopeless;
        relaxed.convergence.converged = ended == Ended::Converged;
        relaxed.convergence.gradient = self.objective.relative_gradient(&relaxed.uv);
        Ok(reached)
    }

    /// The elements of a gradual descent at a map; `None` where they are those of the skin.
    fn bounded(&self, uv: &Uv) -> Option<ElementMesh> {
        self.is_gradual.then(|| self.domain.elements.bounded(uv, GRADUAL)).flatten()
    }

    /// With fillers, made anew every few steps.
    fn scaffolded(&self, start: Uv, scaffold: Scaffold) -> Result<Reached, FlattenError> {
        let mut reached = self.start(start, scaffold);
        let Reached { relaxed, kept, apart, .. } = &mut reached;
        let round = if scaffold == Scaffold::Framed { FRAMED_ROUND } else { ROUND };
        let mut before = self.objective.energy(&relaxed.uv);
        let mut last = None;
        for k in 0..self.limits.steps.div_ceil(round) {
            let Some(fillers) = scaffold.fillers(self.domain, &relaxed.uv) else { break };
            let weight = WEIGHTS[(k * round / ROUND).min(WEIGHTS.len() - 1)];
            let mut uv = fillers.with_posts(&relaxed.uv);
            let bounded = self.bounded(&relaxed.uv);
            let own = bounded.as_ref().unwrap_or(self.objective.elements);
            let elements = own.with(fillers.elements(&uv, weight));
            let objective = Objective::new(&elements, self.goal.energy);
            let limits = NewtonLimits { steps: round, ..self.limits };
            let mut go_on = |uv: &Uv| {
                self.note(uv, kept, apart);
                self.run.step().is_ok()
            };
            let ended = objective.minimise(&mut uv, Solver::Direct, limits, &mut go_on).map_err(failed)?;
            self.run.check()?;
            relaxed.uv = uv.iter().take(self.domain.vertices()).copied().collect();
            let energy = self.objective.energy(&relaxed.uv);
            let is_gained = before - energy > self.limits.gain * energy;
            relaxed.convergence.converged = bounded.is_none() && !is_gained;
            last = Some((elements, uv));
            if relaxed.convergence.converged || matches!(ended, Ended::Stopped | Ended::Hopeless) {
                break;
            }
            before = energy;
        }
        if let Some((elements, uv)) = last {
            relaxed.convergence.gradient = Objective::new(&elements, self.goal.energy).relative_gradient(&uv);
            // From a bad map, small steps are those that needles stop.
            relaxed.convergence.converged &= before < BAD_START || relaxed.convergence.gradient < ENOUGH;
        }
        Ok(reached)
    }
}

fn failed(source: SparseError) -> FlattenError {
    FlattenError::System { method: "intrinsic", source }
}
