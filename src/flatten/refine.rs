//! From the map of a coarse level to that of the next finer one, with a way out wherever a step may
//! fail.
//!
//! ```text
//! step     | first                | what may be wrong                   | then
//! ---------+----------------------+-------------------------------------+------------------------
//! insert   | all vertices at once | one has no place without a flip     | in stages of 1.5 times
//!          |                      |                                     | the vertices, each relaxed
//! unflip   | untangle around the  | flips or branch points are left     | inside a circle (Tutte)
//!          | flipped faces        |                                     |
//! minimise | with a free boundary | a hole is not kept, or the map      | with fillers in the holes, with
//!          |                      | overlaps but must not               | a frame too, from the last map
//!          |                      |                                     | without that fault
//! keep     | the inherited map    | it may be a bad local minimum: the  | the better `Candidate` of
//!          |                      | level is small                      | it and a map from scratch
//! ```
//!
//! The second and third row are [`relax`](super::relax), also for a map from scratch. After the
//! third row a map has no flips, and no overlaps if it must not have any; the fourth never makes it
//! worse. The sizes are *heuristic*, measured on the skins of `meshes/` and on tubes.

use crate::flatten::FlattenError;
use crate::flatten::domain::FlattenDomain;
use crate::flatten::energy::elements::Uv;
use crate::flatten::energy::newton::NewtonLimits;
use crate::flatten::insertion::Insertion;
use crate::flatten::magnification::Magnification;
use crate::flatten::relax::{
    Goal, Relaxed, Scaffold, Start, better, make_locally_injective, minimise_from_scratch, past_needles,
    relax,
};

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

/// The map of least energy of a level, in units of `domain`, from `start`, the map (m) of the next
/// coarser level. `magnification` is the level's, and `domain` has it already: only the stages
/// between two levels need it.
pub(crate) fn refine(
    domain: &FlattenDomain<'_>,
    start: Insertion<'_>,
    scaffold: Scaffold,
    magnification: &Magnification,
    goal: Goal,
) -> Result<Relaxed, FlattenError> {
    let inserted = insert(start, scaffold, magnification, goal)?;
    let start = make_locally_injective(domain, domain.to_units(&inserted))?;
    let (inherited, anew) = rayon::join(
        || past_needles(domain, goal, None, &|_| Ok(Start::Near(start.clone(), scaffold))),
        || (domain.vertices() <= RESTARTED).then(|| minimise_from_scratch(domain, goal, Some(ANEW))),
    );
    match (inherited, anew) {
        (Ok(inherited), Some(anew)) => Ok(better(domain, goal, inherited, anew?)),
        (inherited, _) => inherited,
    }
}

/// All vertices of a level on the map (m) of the next coarser level: at once if every one has a
/// place, else in stages.
fn insert(
    start: Insertion<'_>,
    scaffold: Scaffold,
    magnification: &Magnification,
    goal: Goal,
) -> Result<Uv, FlattenError> {
    let mut at_once = start.clone();
    if at_once.undo_until(0) == 0 {
        return Ok(at_once.finished());
    }
    let mut insertion = start;
    while insertion.left > 0 {
        insert_stage(&mut insertion, scaffold, magnification, goal)?;
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
    let relaxed = relax(&domain, Start::Near(start, scaffold), goal, Some(STAGE))?;
    let uv = domain.to_metres(&relaxed.uv);
    insertion.place(&vertices, &uv, &scaffold.fillers(&domain, &uv).unwrap_or_default());
    Ok(())
}
