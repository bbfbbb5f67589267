//! Stage 2, *heuristic*: moves one taxel at a time to the pose that one of its rejected edges
//! predicts, if the truncated cost falls (coordinate descent over discrete candidates).
//!
//! Truncated least squares has many minima, and graduated non-convexity ends in one of the better
//! ones only where most of a taxel's edges are right. With its neighbours held, the cost of one
//! taxel has at most one minimum for each set of inliers, and every better set contains an edge
//! that is rejected here. A second round gains nothing up to 20 % wrong edges, and 0.3 % at 40 %.

use crate::{
    calib::{
        CalibError, DisplacementId, LossFunctions, Poses, Problem, Solver, Termination, edges_of_taxels,
        predicted_pose, robust::solution::Solution,
    },
    id::{IdVec, VertexId},
};

/// Candidates of one taxel: of more rejected edges an even sample is tried. A
/// better set of inliers is then large enough that several of its edges are in the sample.
const MAX_CANDIDATES: usize = 100;

/// Share of the cost by which a candidate must lower it: rounding must not send a taxel back and
/// forth.
const LEAST_GAIN: f64 = 1e-9;

/// Improves a minimum of truncated least squares taxel by taxel, and minimises again if any moved.
pub(crate) fn coordinate_descent(
    solver: &mut Solver<'_>,
    solution: Solution,
) -> Result<Solution, CalibError> {
    if matches!(solution.termination, Termination::OutOfIterations | Termination::Overflow) {
        return Ok(solution);
    }
    let mut poses = solution.iterate.poses.clone();
    if move_taxels(solver.problem, &mut poses, &solution.losses) {
        Solution::of_losses(solver, poses, &solution.losses)
    } else {
        Ok(solution)
    }
}

/// Moves every taxel, one after the other, to the best of its candidates; returns whether any
/// moved.
fn move_taxels(problem: &Problem<'_>, poses: &mut Poses, losses: &LossFunctions) -> bool {
    let observations = problem.observations;
    let edges_of = edges_of_taxels(observations);
    let mut contacts_of: IdVec<VertexId, Vec<_>> = observations.taxels.map(|_| Vec::new());
    for (contact, loss) in observations.contacts.iter().zip(&losses.of.contacts) {
        contacts_of[contact.taxel].push((contact, loss));
    }
    let mut moved = false;
    for v in observations.taxels.ids().filter(|&v| problem.rows[v].is_some()) {
        // The cost at `poses`, or some number above `most` if it is above it.
        let cost = |poses: &Poses, most: f64| {
            let contacts = contacts_of[v]
                .iter()
                .map(|(c, loss)| loss.cost(problem.contact_chi2(&c.measurement, &poses[v])));
            let edges = edges_of[v]
                .iter()
                .map(|&e| losses.of.edges[e].cost(problem.edge_chi2(&observations.edges[e], poses)));
            let mut sum = 0.0;
            for cost in contacts.chain(edges) {
                sum += cost;
                if sum > most {
                    break;
                }
            }
            sum
        };
        let is_outlier = |e: &DisplacementId| {
            !losses.of.edges[*e].is_inlier(problem.edge_chi2(&observations.edges[*e], poses))
        };
        let outliers: Vec<DisplacementId> = edges_of[v].iter().copied().filter(is_outlier).collect();
        if outliers.is_empty() {
            continue;
        }
        let here = poses[v];
        let (mut best, mut lowest) = (here, cost(poses, f64::INFINITY));
        for &e in outliers.iter().step_by(outliers.len().div_ceil(MAX_CANDIDATES)) {
            poses[v] = predicted_pose(observations, e, v, poses);
            let there = cost(poses, lowest);
            if there < lowest * (1.0 - LEAST_GAIN) {
                (best, lowest) = (poses[v], there);
            }
        }
        moved |= best != here;
        poses[v] = best;
    }
    moved
}
