//! Newton with the [`Barrier`]: a map that does not overlap stays so.

use glam::DVec2;

use crate::{
    flatten::{
        Energy,
        bijective::barrier::Barrier,
        domain::elements::ElementMesh,
        energy::{
            newton::{NewtonLimits, Solver},
            objective::Objective,
        },
    },
    id::{IdVec, VertexId},
    sparse::SparseError,
};

/// Newton steps between updates of the active set of close vertex-edge pairs; the set is stable for
/// about this many steps.
const ROUND: usize = 6;

/// Vertices are coupled in the Hessian up to this multiple of the distance at which they repel each
/// other, for those that come closer within a round.
const AHEAD: f64 = 2.0;

/// Relative decrease of the energy in a round at which the minimisation ends. With a changing
/// active set Newton does not converge quadratically; a smaller decrease is not visible.
const ENOUGH: f64 = 1e-7;

/// Minimises the energy as [`Objective::minimise`] does, with a boundary that never crosses itself.
///
/// The map to start from must have no flips and a boundary that does not cross itself. The
/// resulting map has neither, even where `limits` end before the optimum.
pub(crate) fn minimise_bijective(
    elements: &ElementMesh,
    energy: Energy,
    uv: &mut IdVec<VertexId, DVec2>,
    solver: Solver,
    limits: NewtonLimits,
) -> Result<(), SparseError> {
    let barrier = Barrier::new(elements);
    let mut last = f64::INFINITY;
    for _ in 0..limits.steps.div_ceil(ROUND) {
        let coupled = elements.coupled(&barrier.couplings(uv, AHEAD));
        let objective = Objective::new(&coupled, energy).with_boundary_term(&barrier);
        objective.minimise(uv, solver, NewtonLimits { steps: ROUND, ..limits })?;
        let reached = objective.energy(uv);
        if !reached.is_finite() || last - reached <= ENOUGH.max(limits.decrement) * reached {
            break;
        }
        last = reached;
    }
    Ok(())
}
