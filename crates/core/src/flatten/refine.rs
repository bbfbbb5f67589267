//! From the map of a coarse level to that of the next finer one, with an alternative to each step that may
//! fail.
//!
//! ```text
//! step     | first                | what may be wrong                   | then
//! ---------+----------------------+-------------------------------------+------------------------
//! insert   | all vertices at once | one has no position without a flip  | in stages of 1.5 times
//!          |                      |                                     | the vertices, each relaxed
//! unflip   | untangle around the  | flips or branch points are left     | inside a circle (Tutte)
//!          | flipped faces        |                                     |
//! minimise | with a free boundary | a hole is not kept, or the map      | with fillers in the holes, with
//!          |                      | overlaps but must not               | a frame too, from the last map
//!          |                      |                                     | without that fault
//! keep     | the inherited map    | it may be a bad local minimum: the  | the best legal map of the
//!          |                      | level is small, or faces collapsed  | attempts, also from scratch
//!          |                      |                                     | and with gradual rest shapes
//! ```
//!
//! The second and third row are [`relax`](super::relax), also for a map from scratch. In the fourth every attempt is
//! judged alike: a map with a flip, a hole inside out or an unwanted overlap is not legal, and an attempt that fails
//! does not lose what another one has reached. The sizes are *heuristic*, measured on the skins of `meshes/` and on
//! tubes.
//!
//! What each step earns: 31 runs of `tools/compare/ablate.py` (19 shapes, and 8 meshes of CAD and of `meshes/`) with
//! one step left out. Named are the runs whose worst symmetric Dirichlet energy changes by more than 2 % or that lose
//! a map.
//!
//! ```text
//! left out                                | effect
//! ----------------------------------------+-----------------------------------------------
//! from the last map with holes            | thin tube +5 %
//! from the last map apart                 | thin tube +5 %
//! heavy fillers first (1e-4 at once)      | ball with holes, cut, +212 %
//! expected rest (the decrement instead)   | ball with holes, cut, +2 %
//! its change of ratio                     | ball with holes, cut, +2 %
//! untangle (always inside a circle)       | thin tube +5 %
//! in stages; springs by edges; concave    | a finger 40 radii long loses two coarse levels
//! levels too coarse to start from         | none; a star of 20,000 faces takes 124 s, not 0.4 s
//! also from scratch, if small             | none
//! two steps to a round with a frame       | none
//! from scratch, if collapsed              | none
//! gradual rest shapes, if collapsed       | none; two CAD bodies of 14 handles and 51 loops have no map
//! ```
//!
//! What had no effect at all was left out: starts with fatter needles, by the symmetric Dirichlet energy or from the
//! untangled conformal map, six steps until holes are holes, an end of the fillers where a map begins to overlap
//! itself, and two tests before the end of a minimisation.

use crate::flatten::domain::FlattenDomain;
use crate::flatten::energy::elements::Uv;
use crate::flatten::energy::newton::NewtonLimits;
use crate::flatten::insertion::Insertion;
use crate::flatten::magnification::Magnification;
use crate::flatten::overlap::check_map;
use crate::flatten::relax::{
    Goal, Relaxed, Scaffold, Start, is_better, make_locally_injective, relax, start_from_scratch,
};
use crate::flatten::start::{conformal::spectral_conformal, linear::linear};
use crate::flatten::{Convergence, FlattenError, FlattenOptions, Method, Overlap};
use crate::run::Run;

/// Newton steps between two stages of an insertion: they only have to make room.
const STAGE: NewtonLimits = NewtonLimits { rest: 1e-3, steps: 12, gain: 1e-3, most: f64::INFINITY };

/// Vertices of a stage over those of the one before, where a level cannot be inserted at once.
const STAGE_GROWTH: f64 = 1.5;

/// Levels up to this size are also flattened from scratch: the coarsest level of a tube may fold
/// into a local minimum that every finer level would inherit, and a few dozen milliseconds find
/// out (a ball with five holes: 8.21 instead of 8.00).
const RESTARTED: usize = 1500;

/// Newton steps of such a map: enough to see whether it is better.
const ANEW: NewtonLimits = NewtonLimits { rest: 1e-10, steps: 200, gain: 1e-3, most: f64::INFINITY };

/// The map of the next coarser level, as the start of that of a finer one.
pub(crate) struct Inherited<'a> {
    pub(crate) start: Insertion<'a>,
    pub(crate) scaffold: Scaffold,
    /// That of the finer level, whose domain has it already: only the stages between both need it.
    pub(crate) magnification: &'a Magnification,
}

/// The map of a level by the method of the options, in units of `domain`: for the intrinsic method the best legal
/// one of all attempts.
///
/// # Errors
/// That of the first attempt, if none has a legal map.
pub(crate) fn best_map(
    domain: &FlattenDomain<'_>,
    inherited: Option<Inherited<'_>>,
    options: &FlattenOptions,
    run: Run<'_>,
) -> Result<Relaxed, FlattenError> {
    let energy = match options.method {
        Method::Conformal => return spectral_conformal(domain).map(linear_map),
        Method::Linear { angle, area } => return linear(domain, angle, area).map(linear_map),
        Method::Intrinsic { energy, .. } => energy,
    };
    let goal = Goal { energy, overlap: options.overlap };
    let from_scratch = |limits| relax(domain, Start::Far(start_from_scratch(domain)?), goal, limits, run);
    let mut attempts = Attempts { domain, goal, best: None, failed: None };
    if let Some(inherited) = inherited {
        let is_small = domain.vertices() <= RESTARTED;
        let (inherited, anew) = rayon::join(
            || inherited.minimised(domain, goal, run),
            || is_small.then(|| from_scratch(Some(ANEW))),
        );
        std::iter::once(inherited).chain(anew).for_each(|map| attempts.take(map));
    }
    run.check()?;
    if attempts.are_poor() {
        attempts.take(from_scratch(None));
    }
    // A descent that collapsed faces have stopped goes on, and is tried from scratch.
    let gradually = |start| relax(domain, Start::Gradual(start), goal, None, run);
    if let Some(best) = attempts.best.as_ref().filter(|map| map.is_caught(domain)).map(|map| map.uv.clone()) {
        attempts.take(gradually(best));
    }
    if attempts.are_poor() {
        attempts.take(start_from_scratch(domain).and_then(gradually));
    }
    run.check()?;
    let Attempts { best, failed, .. } = attempts;
    best.ok_or_else(|| failed.unwrap_or(FlattenError::NotInjective { flips: 0, overlaps: 0 }))
}

fn linear_map(uv: Uv) -> Relaxed {
    let convergence = Convergence { converged: true, gradient: 0.0 };
    Relaxed { uv, scaffold: Scaffold::None, convergence }
}

/// The best legal map so far, and the first error.
struct Attempts<'d> {
    domain: &'d FlattenDomain<'d>,
    goal: Goal,
    best: Option<Relaxed>,
    failed: Option<FlattenError>,
}

impl Attempts<'_> {
    /// Whether there is no legal map yet, or only one with collapsed faces.
    fn are_poor(&self) -> bool {
        self.best.as_ref().is_none_or(|map| map.is_caught(self.domain))
    }

    fn take(&mut self, found: Result<Relaxed, FlattenError>) {
        let Self { domain, goal, .. } = *self;
        let overlap = if domain.prescribed.is_empty() { goal.overlap } else { Overlap::Allow };
        let legal =
            found.and_then(|map| check_map(domain.mesh, &domain.disk.loops, overlap, &map.uv).map(|()| map));
        match legal {
            Ok(map) => {
                if self.best.as_ref().is_none_or(|best| is_better(domain, goal, &map, best)) {
                    self.best = Some(map);
                }
            }
            Err(why) => {
                self.failed.get_or_insert(why);
            }
        }
    }
}

impl Inherited<'_> {
    /// The map of least energy of the finer level from here.
    fn minimised(
        self,
        domain: &FlattenDomain<'_>,
        goal: Goal,
        run: Run<'_>,
    ) -> Result<Relaxed, FlattenError> {
        let Self { start, scaffold, magnification } = self;
        let inserted = insert(start, scaffold, magnification, goal, run)?;
        let start = make_locally_injective(domain, domain.to_units(&inserted))?;
        relax(domain, Start::Near(start, scaffold), goal, None, run)
    }
}

/// All vertices of a level on the map (m) of the next coarser level: at once if every one has a
/// position without a flip, else in stages.
fn insert(
    start: Insertion<'_>,
    scaffold: Scaffold,
    magnification: &Magnification,
    goal: Goal,
    run: Run<'_>,
) -> Result<Uv, FlattenError> {
    let mut at_once = start.clone();
    if at_once.undo_until(0) == 0 {
        return Ok(at_once.finished());
    }
    let mut insertion = start;
    while insertion.left > 0 {
        insert_stage(&mut insertion, scaffold, magnification, goal, run)?;
    }
    Ok(insertion.finished())
}

/// Undoes a part of the removals and makes the map of what is there free of flips and roughly
/// optimal.
fn insert_stage(
    insertion: &mut Insertion<'_>,
    scaffold: Scaffold,
    magnification: &Magnification,
    goal: Goal,
    run: Run<'_>,
) -> Result<(), FlattenError> {
    let present = insertion.present();
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a fraction of a vertex count"
    )]
    let more = ((STAGE_GROWTH - 1.0) * present as f64).ceil() as usize;
    insertion.undo_until(insertion.left.saturating_sub(more.max(1)));
    if insertion.left == 0 {
        return Ok(());
    }
    let (mesh, vertices) = insertion.mesh();
    let domain = FlattenDomain::new(&mesh)?.magnified(&magnification.of_vertices(&vertices));
    let uv = domain.to_units(&vertices.iter().map(|&v| insertion.map[v]).collect());
    let start = make_locally_injective(&domain, uv)?;
    let relaxed = relax(&domain, Start::Near(start, scaffold), goal, Some(STAGE), run)?;
    let uv = domain.to_metres(&relaxed.uv);
    insertion.place(&vertices, &uv, &scaffold.fillers(&domain, &uv).unwrap_or_default());
    Ok(())
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::flatten::Energy;
    use crate::mesh::shapes;

    /// An attempt that fails, or whose map is not legal, does not lose what another one has reached.
    #[test]
    fn the_best_legal_attempt_is_kept() {
        let mesh = shapes::lattice(4, 4, 0.01);
        let domain = FlattenDomain::new(&mesh).unwrap();
        let goal = Goal { energy: Energy::default(), overlap: Overlap::Prevent };
        let flat = mesh.positions.map(|p| p.truncate() / domain.unit);
        let failed = || Err(FlattenError::NoStart { face: crate::id::FaceId::new(3) });
        let map = |scale: f64, turn: f64| Ok(linear_map(flat.map(|p| scale * DVec2::new(turn * p.x, p.y))));
        let mut attempts = Attempts { domain: &domain, goal, best: None, failed: None };
        for (found, best) in [(failed(), None), (map(2.0, 1.0), Some(2.0)), (failed(), Some(2.0))]
            .into_iter()
            .chain([(map(1.0, -1.0), Some(2.0)), (map(1.0, 1.0), Some(1.0)), (map(3.0, 1.0), Some(1.0))])
        {
            attempts.take(found);
            let scale = attempts.best.as_ref().map(|map| map.uv.iter().map(|p| p.x).sum::<f64>());
            let wanted = best.map(|scale| scale * flat.iter().map(|p| p.x).sum::<f64>());
            assert_eq!(scale, wanted);
        }
        assert!(matches!(attempts.failed, Some(FlattenError::NoStart { .. })), "the first error stays");
    }
}
