use crate::{
    calib::{
        Motion, Observations, Pose,
        normal_equations::{Problem, State},
        robust::Kernels,
    },
    id::{EdgeId, IdVec, VertexId},
};

/// Moves every taxel, one after the other, to where one of its edges puts it, if more of its observations agree there;
/// returns whether any moved.
///
/// Truncated least squares has many minima, and graduated non-convexity ends in one of the better ones only where most
/// of a taxel's edges are right. With its neighbours held, the truncated cost of one taxel has at most one minimum
/// for each set of edges that agree, so trying the place each edge names finds the best.
pub(super) fn reconsider(problem: &Problem<'_>, state: &mut State, kernels: &Kernels) -> bool {
    let observations = problem.observations;
    let edges_of = edges_of_taxels(observations);
    let mut contacts_of: IdVec<VertexId, Vec<_>> = observations.taxels.map(|_| Vec::new());
    for (contact, kernel) in observations.contacts.iter().zip(&kernels.contacts) {
        contacts_of[contact.taxel].push((contact, kernel));
    }
    let mut moved = false;
    for v in observations.taxels.ids().filter(|&v| problem.rows[v].is_some()) {
        let cost = |state: &State| {
            let edges: f64 =
                edges_of[v].iter().map(|&e| kernels.edges[e].cost(problem.edge_square(e, state))).sum();
            let contacts =
                contacts_of[v].iter().map(|(c, k)| k.cost(problem.touch_square(&c.touch, &state[v])));
            edges + contacts.sum::<f64>()
        };
        let here = state[v];
        let (mut best, mut lowest) = (here, cost(state));
        // A taxel whose observations all agree cannot be better off.
        let agrees = |&e: &EdgeId| kernels.edges[e].keeps(problem.edge_square(e, state));
        let all_agree = edges_of[v].iter().all(agrees);
        if all_agree {
            continue;
        }
        for &e in &edges_of[v] {
            state[v] = named_by(observations, e, v, state);
            let there = cost(state);
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
pub(super) fn edges_of_taxels(observations: &Observations) -> IdVec<VertexId, Vec<EdgeId>> {
    let mut edges_of: IdVec<VertexId, Vec<EdgeId>> = observations.taxels.map(|_| Vec::new());
    for (id, edge) in observations.edges.enumerate() {
        edges_of[edge.from].push(id);
        edges_of[edge.to].push(id);
    }
    edges_of
}

/// Where `edge` puts `v`, its other end being where it is.
pub(super) fn named_by(observations: &Observations, edge: EdgeId, v: VertexId, state: &State) -> Pose {
    let edge = &observations.edges[edge];
    let forward = edge.to == v;
    let other = &state[if forward { edge.from } else { edge.to }];
    match &edge.motion {
        Motion::Offset { offset, .. } => {
            Pose { position: other.position + if forward { *offset } else { -*offset }, ..*other }
        }
        Motion::Relative(m) => *other * if forward { m.pose } else { m.pose.inverse() },
    }
}
