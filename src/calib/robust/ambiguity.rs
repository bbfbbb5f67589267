use crate::{
    calib::{
        Observations,
        observations::graph::{component_of_taxels, components},
        robust::automatic::Found,
        robust::coordinate_descent::edges_of_taxels,
        robust::length_prior::LogOdds,
        solve::loss::{Kernels, SMALLEST_WEIGHT},
    },
    id::{IdVec, VertexId},
};

/// Weight of every edge of a taxel whose edges contradict each other and nothing decides between them: too small to
/// bend its neighbours, large enough to leave the system well conditioned, and a covariance as wide as the
/// contradiction.
const UNDECIDED: f64 = 1e-3;

/// Log odds by which a kept edge must beat the rejected ones of its taxel to count as chosen for a reason: 20 to 1.
const DECISIVE: f64 = 3.0;

/// Takes back every choice that was made by chance, in the weights and in what is kept; returns whether there was any.
///
/// A taxel that hangs on one kept edge, while others of it were rejected, could as well hang on one of those: each
/// explains itself perfectly. Choosing costs more on average than the mean of all, so all its edges get the same small
/// weight, unless the `odds` speak for the kept one. A kept edge to such a taxel decides nothing about its other end
/// either, so this goes on until every taxel is held twice or was never in doubt. Then the same for whole pieces, which
/// are left without any edge: those that agree by the bounds of `kernels`, whatever their lengths, are kept after all.
pub(crate) fn take_back_chance(
    observations: &Observations,
    found: &mut Found,
    odds: Option<&LogOdds>,
    kernels: &Kernels,
) -> bool {
    let mut held = observations.taxels.map(|t| t.fixed);
    for (id, contact) in observations.contacts.enumerate() {
        held[contact.taxel] |= found.kept.contacts[id];
    }
    let taxels = free_taxels(observations, found, odds, &held);
    let pieces = join_pieces(observations, found, kernels, &held);
    taxels || pieces
}

fn free_taxels(
    observations: &Observations,
    found: &mut Found,
    odds: Option<&LogOdds>,
    held: &IdVec<VertexId, bool>,
) -> bool {
    let (weights, kept) = (&mut found.weights.edges, &mut found.kept.edges);
    let edges_of = edges_of_taxels(observations);
    let doubtful = kept.map(|k| !k);
    let mut changed = false;
    let mut open: Vec<VertexId> = observations.taxels.ids().rev().collect();
    while let Some(v) = open.pop() {
        let edges = &edges_of[v];
        let support = edges.iter().filter(|&&e| kept[e]).count();
        let doubted = edges.iter().any(|&e| doubtful[e]);
        let done = edges.iter().all(|&e| weights[e] == UNDECIDED);
        let best = |keeps: bool| {
            let of_kind = edges.iter().filter(|&&e| kept[e] == keeps);
            of_kind.map(|&e| odds.map_or(0.0, |odds| odds[e])).fold(f64::NEG_INFINITY, f64::max)
        };
        let decided = support == 1 && best(true) - best(false) > DECISIVE;
        if held[v] || support > 1 || !doubted || done || decided {
            continue;
        }
        changed = true;
        for &e in edges {
            weights[e] = UNDECIDED;
            if kept[e] {
                kept[e] = false;
                let edge = &observations.edges[e];
                open.push(if edge.from == v { edge.to } else { edge.from });
            }
        }
    }
    changed
}

fn join_pieces(
    observations: &Observations,
    found: &mut Found,
    kernels: &Kernels,
    held: &IdVec<VertexId, bool>,
) -> bool {
    let pieces = components(observations, |e| found.weights.edges[e] > SMALLEST_WEIGHT);
    let of_taxel = component_of_taxels(&pieces, observations.taxels.len());
    let held: Vec<bool> = pieces.iter().map(|p| p.taxels.iter().any(|&v| held[v])).collect();
    let mut changed = false;
    for (e, edge) in observations.edges.enumerate() {
        let (from, to) = (of_taxel[edge.from], of_taxel[edge.to]);
        if from == to || held[from] && held[to] || !edge.is_observed() {
            continue;
        }
        changed = true;
        let agrees = kernels.edges[e].keeps(found.point.squares.edges[e]);
        found.kept.edges[e] = agrees;
        found.weights.edges[e] = if agrees { 1.0 } else { UNDECIDED };
    }
    changed
}
