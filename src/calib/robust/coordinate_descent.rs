use crate::{
    calib::{
        DisplacementId, DisplacementMeasurement, Observations, Pose,
        solve::loss::Kernels,
        solve::normal_equations::{Problem, State},
    },
    id::{IdVec, VertexId},
};

/// Places tried for one taxel: where more edges disagree, every so many are asked.
const MOST_PLACES: usize = 100;

/// Moves every taxel, one after the other, to where one of its edges puts it, if more of its observations agree there;
/// returns whether any moved.
///
/// Truncated least squares has many minima, and graduated non-convexity ends in one of the better ones only where most
/// of a taxel's edges are right. With its neighbours held, the truncated cost of one taxel has at most one minimum
/// for each set of edges that agree, and every set but the present one has an edge in it that disagrees here:
/// trying the places that those name finds the best. A set that wins among more than [`MOST_PLACES`] of them is so
/// large that it has many of those asked.
pub(crate) fn reconsider(problem: &Problem<'_>, state: &mut State, kernels: &Kernels) -> bool {
    let observations = problem.observations;
    let edges_of = edges_of_taxels(observations);
    let mut contacts_of: IdVec<VertexId, Vec<_>> = observations.taxels.map(|_| Vec::new());
    for (contact, kernel) in observations.contacts.iter().zip(&kernels.contacts) {
        contacts_of[contact.taxel].push((contact, kernel));
    }
    let mut moved = false;
    for v in observations.taxels.ids().filter(|&v| problem.rows[v].is_some()) {
        // The cost at `state`, or some number above `most` if it is above it.
        let cost = |state: &State, most: f64| {
            let contacts =
                contacts_of[v].iter().map(|(c, k)| k.cost(problem.touch_square(&c.measurement, &state[v])));
            let edges = edges_of[v].iter().map(|&e| kernels.edges[e].cost(problem.edge_square(e, state)));
            let mut sum = 0.0;
            for cost in contacts.chain(edges) {
                sum += cost;
                if sum > most {
                    break;
                }
            }
            sum
        };
        let disagrees = |e: &DisplacementId| !kernels.edges[*e].keeps(problem.edge_square(*e, state));
        let asked: Vec<DisplacementId> = edges_of[v].iter().copied().filter(disagrees).collect();
        if asked.is_empty() {
            continue;
        }
        let here = state[v];
        let (mut best, mut lowest) = (here, cost(state, f64::INFINITY));
        for &e in asked.iter().step_by(asked.len().div_ceil(MOST_PLACES)) {
            state[v] = named_by(observations, e, v, state);
            let there = cost(state, lowest);
            // Rounding must not send a taxel back and forth.
            if there < lowest * (1.0 - 1e-9) {
                (best, lowest) = (state[v], there);
            }
        }
        moved |= best != here;
        state[v] = best;
    }
    moved
}

/// The edges of every taxel, ascending.
pub(crate) fn edges_of_taxels(observations: &Observations) -> IdVec<VertexId, Vec<DisplacementId>> {
    let mut edges_of: IdVec<VertexId, Vec<DisplacementId>> = observations.taxels.map(|_| Vec::new());
    for (id, edge) in observations.edges.enumerate() {
        edges_of[edge.from].push(id);
        edges_of[edge.to].push(id);
    }
    edges_of
}

/// Where `edge` puts `v`, its other end being where it is.
pub(crate) fn named_by(
    observations: &Observations,
    edge: DisplacementId,
    v: VertexId,
    state: &State,
) -> Pose {
    let edge = &observations.edges[edge];
    let forward = edge.to == v;
    let other = &state[if forward { edge.from } else { edge.to }];
    match &edge.measurement {
        DisplacementMeasurement::Offset { offset, .. } => {
            Pose { position: other.position + if forward { *offset } else { -*offset }, ..*other }
        }
        DisplacementMeasurement::Relative(m) => *other * if forward { m.pose } else { m.pose.inverse() },
    }
}
