use crate::{
    calib::{
        Observations, attribution::LogOdds, normal_equations::PerObservation, reconsider::edges_of_taxels,
    },
    id::VertexId,
};

/// Weight of every edge of a taxel whose edges contradict each other and nothing decides between them: too small to
/// bend its neighbours, large enough to leave the system well conditioned, and a covariance as wide as the
/// contradiction.
const UNDECIDED: f64 = 1e-3;

/// Log odds by which a kept edge must beat the rejected ones of its taxel to count as chosen for a reason: 20 to 1.
const DECISIVE: f64 = 3.0;

/// Takes back every choice that was made by chance, in the weights and in what is `kept`; returns whether there was any.
///
/// A taxel that hangs on one kept edge, while others of it were rejected, could as well hang on one of those: each
/// explains itself perfectly. Choosing costs more on average than the mean of all, so all its edges get the same small
/// weight, unless the `odds` speak for the kept one. A kept edge to such a taxel decides nothing about its other end
/// either, so this goes on until every taxel is held twice or was never in doubt.
pub(super) fn take_back_chance(
    observations: &Observations,
    weights: &mut PerObservation,
    kept: &mut PerObservation<bool>,
    odds: Option<&LogOdds>,
) -> bool {
    let edges_of = edges_of_taxels(observations);
    let mut held = observations.taxels.map(|t| t.fixed);
    for (id, contact) in observations.contacts.enumerate() {
        held[contact.taxel] |= kept.contacts[id];
    }
    let doubtful = kept.edges.map(|k| !k);
    let mut changed = false;
    let mut open: Vec<VertexId> = observations.taxels.ids().rev().collect();
    while let Some(v) = open.pop() {
        let edges = &edges_of[v];
        let support = edges.iter().filter(|&&e| kept.edges[e]).count();
        let doubted = edges.iter().any(|&e| doubtful[e]);
        let done = edges.iter().all(|&e| weights.edges[e] == UNDECIDED);
        let best = |keeps: bool| {
            let of_kind = edges.iter().filter(|&&e| kept.edges[e] == keeps);
            of_kind.map(|&e| odds.map_or(0.0, |odds| odds[e])).fold(f64::NEG_INFINITY, f64::max)
        };
        let decided = support == 1 && best(true) - best(false) > DECISIVE;
        if held[v] || support > 1 || !doubted || done || decided {
            continue;
        }
        changed = true;
        for &e in edges {
            weights.edges[e] = UNDECIDED;
            if kept.edges[e] {
                kept.edges[e] = false;
                let edge = &observations.edges[e];
                open.push(if edge.from == v { edge.to } else { edge.from });
            }
        }
    }
    changed
}
