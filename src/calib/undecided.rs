use crate::{
    calib::{Observations, normal_equations::PerObservation, reconsider::edges_of_taxels},
    id::VertexId,
};

/// Weight of every edge of a taxel whose edges contradict each other and nothing decides between them: too small to
/// bend its neighbours, large enough to leave the system well conditioned, and a covariance as wide as the
/// contradiction.
const UNDECIDED: f64 = 1e-3;

/// An observation whose weight is below this counts as rejected.
pub(super) const REJECTED: f64 = 0.5;

/// Weights with every choice taken back that was made by chance; `None` if there is no such choice.
///
/// A taxel that hangs on one kept edge, while others of it were rejected, could as well hang on one of those: each
/// explains itself perfectly. Choosing costs more on average than the mean of all, so all its edges get the same small weight.
/// A kept edge to such a taxel decides nothing about its other end either, so this goes on until every taxel is held
/// twice or was never in doubt.
pub(super) fn without_chance(
    observations: &Observations,
    weights: &PerObservation,
) -> Option<PerObservation> {
    let edges_of = edges_of_taxels(observations);
    let mut held = observations.taxels.map(|t| t.fixed);
    for (id, contact) in observations.contacts.enumerate() {
        held[contact.taxel] |= weights.contacts[id] >= REJECTED;
    }
    let mut kept = weights.edges.map(|&w| w >= REJECTED);
    let mut out = weights.clone();
    let mut changed = false;
    let mut open: Vec<VertexId> = observations.taxels.ids().rev().collect();
    while let Some(v) = open.pop() {
        let edges = &edges_of[v];
        let support = edges.iter().filter(|&&e| kept[e]).count();
        let doubted = edges.iter().any(|&e| weights.edges[e] < REJECTED);
        let done = edges.iter().all(|&e| out.edges[e] == UNDECIDED);
        if held[v] || support > 1 || !doubted || done {
            continue;
        }
        changed = true;
        for &e in edges {
            out.edges[e] = UNDECIDED;
            if kept[e] {
                kept[e] = false;
                let edge = &observations.edges[e];
                open.push(if edge.from == v { edge.to } else { edge.from });
            }
        }
    }
    changed.then_some(out)
}
