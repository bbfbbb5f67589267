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
//! minimise | with a free boundary | the map overlaps but must not, or   | with a barrier, from the
//!          |                      | a hole is not kept                  | same start, or inside a
//!          |                      |                                     | circle if that overlaps
//! keep     | the inherited map    | it may be a bad local minimum: the  | the better `Candidate` of
//!          |                      | level is small, the map overlaps,   | it and a map from scratch
//!          |                      | or a hole needed the barrier        |
//! ```
//!
//! The second and third row are [`relax`](super::relax), also for a map from scratch. After the
//! third row a map has no flips, and no overlaps if it must not have any; the fourth never makes it
//! worse. The sizes are *heuristic*, measured on the skins of `meshes/` and on tubes.

use crate::flatten::{
    FlattenError,
    bijective::overlap::overlaps,
    domain::{elements::Uv, flatten_domain::FlattenDomain, magnification::Magnification},
    energy::{newton::NewtonLimits, objective::Objective},
    levels::{
        insertion::Insertion,
        relax::{Goal, make_locally_injective, minimise_from_scratch, relax},
    },
};

/// Newton steps between two stages of an insertion: they only have to make room.
const STAGE: NewtonLimits = NewtonLimits { decrement: 1e-3, steps: 12 };

/// Vertices of a stage over those of the one before, where a level cannot be inserted at once.
const STAGE_GROWTH: f64 = 1.5;

/// Levels up to this size are also flattened from scratch: the coarsest level of a tube may fold
/// into a local minimum that every finer level would inherit, and a few dozen milliseconds find
/// out.
const RESTARTED: usize = 3000;

/// The map of least energy of a level, in units of `domain`, from `start`, the map (m) of the next
/// coarser level. `magnification` is the level's, and `domain` has it already: only the stages
/// between two levels need it.
pub(crate) fn refine(
    domain: &FlattenDomain<'_>,
    start: Insertion<'_>,
    magnification: &Magnification,
    goal: Goal,
) -> Result<Uv, FlattenError> {
    let inserted = insert(start, magnification, goal)?;
    let start = make_locally_injective(domain, domain.to_units(&inserted))?;
    let inherited = relax(domain, start, goal, None)?;
    // With a barrier the rim of a hole may get stuck: one tapered tube ended at an energy of 16.8
    // instead of 9.6.
    let suspect_local_minimum = inherited.used_barrier && domain.disk.loops.len() > 1;
    if domain.vertices() > RESTARTED && !suspect_local_minimum && overlaps(domain.mesh, &inherited.uv) == 0 {
        return Ok(inherited.uv);
    }
    let objective = Objective::new(&domain.elements, goal.energy);
    let inherited = Candidate::new(domain, &objective, inherited.uv);
    let fresh = Candidate::new(domain, &objective, minimise_from_scratch(domain, goal)?);
    Ok(if fresh.is_better_than(&inherited) { fresh.uv } else { inherited.uv })
}

struct Candidate {
    uv: Uv,
    overlaps: usize,
    /// Without any barrier.
    energy: f64,
}

impl Candidate {
    fn new(domain: &FlattenDomain<'_>, objective: &Objective<'_>, uv: Uv) -> Self {
        Self { overlaps: overlaps(domain.mesh, &uv), energy: objective.energy(&uv), uv }
    }

    /// Fewer overlaps, or as many and less energy.
    fn is_better_than(&self, other: &Self) -> bool {
        (self.overlaps, self.energy) < (other.overlaps, other.energy)
    }
}

/// All vertices of a level on the map (m) of the next coarser level: at once if every one has a
/// place, else in stages.
fn insert(start: Insertion<'_>, magnification: &Magnification, goal: Goal) -> Result<Uv, FlattenError> {
    let mut at_once = start.clone();
    if at_once.undo_until(0) == 0 {
        return Ok(at_once.map);
    }
    let mut insertion = start;
    while insertion.left > 0 {
        insert_stage(&mut insertion, magnification, goal)?;
    }
    Ok(insertion.map)
}

/// Undoes a part of the removals and makes the map of what is there free of flips and roughly
/// optimal.
fn insert_stage(
    insertion: &mut Insertion<'_>,
    magnification: &Magnification,
    goal: Goal,
) -> Result<(), FlattenError> {
    let present = insertion.map.len() - insertion.left;
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
    let factors = magnification.of_vertices(&vertices).of_faces(&mesh);
    let domain = FlattenDomain::new(&mesh)?.magnified(&factors);
    let uv = domain.to_units(&vertices.iter().map(|&v| insertion.map[v]).collect());
    let start = make_locally_injective(&domain, uv)?;
    let relaxed = relax(&domain, start, goal, Some(STAGE))?;
    for (&v, &p) in vertices.iter().zip(&domain.to_metres(&relaxed.uv)) {
        insertion.map[v] = p;
    }
    Ok(())
}
