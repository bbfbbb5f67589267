use glam::DVec2;

use crate::{
    flatten::{
        bijective::barrier::Barrier,
        domain::elements::Net,
        energy::density::Density,
        energy::newton::{Limits, Solver},
        energy::objective::Problem,
    },
    id::{IdVec, VertexId},
    sparse::SparseError,
};

/// Newton steps until it is looked up anew which vertices repel each other: about as many as they stay the same for.
const ROUND: usize = 6;

/// Vertices are coupled in the Hessian up to this multiple of the distance at which they repel each other, for those
/// that come closer within a round.
const AHEAD: f64 = 2.0;

/// Decrease of the energy in a round, over its value, at which a map is good enough. Newton with an active set that
/// changes is not quadratic, and no one sees the rest.
const ENOUGH: f64 = 1e-7;

/// Minimises the energy as [`Problem::minimise`] does, with a boundary that never crosses itself.
///
/// The map to start from must have no flips and a boundary that does not cross itself. The map that comes out has
/// neither, even where `limits` end before the optimum.
pub(crate) fn minimise_apart(
    net: &Net,
    density: Density,
    perimeter: f64,
    uv: &mut IdVec<VertexId, DVec2>,
    solver: Solver,
    limits: Limits,
) -> Result<(), SparseError> {
    let barrier = Barrier::new(net);
    let mut energy = f64::INFINITY;
    for _ in 0..limits.steps.div_ceil(ROUND) {
        let coupled = net.coupled(&barrier.couplings(uv, AHEAD));
        let problem = Problem::new(&coupled, density, perimeter).with_barrier(barrier.clone());
        problem.minimise(uv, solver, Limits { steps: ROUND, ..limits })?;
        let reached = problem.energy(uv);
        if !reached.is_finite() || energy - reached <= ENOUGH.max(limits.decrement) * reached {
            break;
        }
        energy = reached;
    }
    Ok(())
}
