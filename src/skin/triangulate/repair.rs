//! What growing leaves: small holes, fans that touch in a point, and lonely taxels.

use crate::{
    id::{FaceId, VertexId},
    skin::triangulate::{
        growing_mesh::{Front, Opening},
        point_cloud::Surroundings,
    },
};

/// The faces that close a hole turn no more than 73 degrees from the normals of their corners: those that lie across the mouth of
/// a sleeve stand on edge.
const LEAST_COSINE: f64 = 0.3;

/// Closes small holes that stayed because corners disagreed, ear by ear: those whose taxels all lie within the gap of each other.
/// Wider ones are openings of the skin.
pub(super) fn close_leftovers(front: &mut Front<'_>, around: &Surroundings<'_>) {
    for walk in loops(front, around) {
        let is_small = walk.iter().all(|&v| walk.iter().all(|&w| around.is_within_gap(v, w)));
        if is_small {
            close(front, walk, around);
        }
    }
}

/// A boundary edge from `to` to `at`, with nothing on its left; `from` comes next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Step {
    at: VertexId,
    to: VertexId,
    from: VertexId,
}

/// The boundary loops, with the hole on the left.
fn loops(front: &Front<'_>, around: &Surroundings<'_>) -> Vec<Vec<VertexId>> {
    let openings =
        |v: VertexId| front.openings(v).into_iter().map(move |o| Step { at: v, to: o.to, from: o.from });
    let mut steps: Vec<Step> = around.positions.ids().flat_map(openings).collect();
    steps.sort_unstable();
    let next = |step: Step| steps.binary_search_by_key(&(step.from, step.at), |s| (s.at, s.to)).ok();
    let mut seen = vec![false; steps.len()];
    let mut loops = Vec::new();
    for start in 0..steps.len() {
        let mut walk = Vec::new();
        let mut at = Some(start);
        while let Some(k) = at.filter(|&k| !std::mem::replace(&mut seen[k], true)) {
            walk.push(steps[k].at);
            at = next(steps[k]);
        }
        if walk.len() > 2 {
            loops.push(walk);
        }
    }
    loops
}

/// Cuts ears off a hole, the smallest circles first, until it is closed or none fits.
fn close(front: &mut Front<'_>, mut walk: Vec<VertexId>, around: &Surroundings<'_>) {
    let lies_flat =
        |t: [VertexId; 3]| t.iter().all(|&v| around.normal(t).dot(around.normals[v]) >= LEAST_COSINE);
    while walk.len() > 2 {
        let count = walk.len();
        let ear = |k: usize| [walk[k], walk[(k + 1) % count], walk[(k + count - 1) % count]];
        let mut ears: Vec<(f64, usize)> = (0..count).map(|k| (around.circle(ear(k)), k)).collect();
        ears.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        // One pass takes ears that do not touch each other; the next one sees the hole that is left.
        let mut keep = vec![true; count];
        let mut touched = vec![false; count];
        for (_, k) in ears {
            let [before, after] = [(k + count - 1) % count, (k + 1) % count];
            if !touched[k] && !touched[before] && !touched[after] && lies_flat(ear(k)) && front.take(ear(k)) {
                keep[k] = false;
                [before, k, after].into_iter().for_each(|k| touched[k] = true);
                if count == 3 {
                    return;
                }
            }
        }
        if keep.iter().all(|&k| k) {
            return;
        }
        let mut keep = keep.into_iter();
        walk.retain(|_| keep.next().unwrap_or(true));
    }
}

/// Makes one fan of the faces around every taxel: openings between two fans are closed where an ear fits, and of the fans that
/// still touch in a point the one of most faces stays.
pub(super) fn part_fans(front: &mut Front<'_>, around: &Surroundings<'_>) {
    let mut pinched: Vec<VertexId> =
        around.positions.ids().filter(|&v| front.openings(v).len() > 1).collect();
    for &v in &pinched {
        for Opening { from, to } in front.openings(v) {
            if front.openings(v).len() > 1 {
                front.take([v, from, to]);
            }
        }
    }
    while let Some(v) = pinched.pop() {
        let fans = front.openings(v);
        if fans.len() < 2 {
            continue;
        }
        let mut fans: Vec<(usize, VertexId)> =
            fans.iter().map(|o| (front.fan(v, o.to).len(), o.to)).collect();
        fans.sort_unstable_by_key(|&(faces, to)| (usize::MAX - faces, to));
        for &(_, to) in &fans[1..] {
            for (face, a, b) in front.fan(v, to) {
                front.take_out(face);
                pinched.extend([a, b]);
            }
        }
    }
}

/// Gives a face to taxels that have none: the one of the smallest circle with a boundary edge nearby, else three instead of
/// the face under which the taxel lies.
pub(super) fn take_in(front: &mut Front<'_>, around: &Surroundings<'_>) {
    let mut lonely: Vec<VertexId> = around.positions.ids().filter(|&v| !front.is_used(v)).collect();
    loop {
        let before = lonely.len();
        lonely.retain(|&v| !join_to_boundary(front, v, around) && !split_a_face(front, v, around));
        // A taxel that was taken in may be the boundary that another one needs.
        if lonely.len() == before {
            return;
        }
    }
}

fn join_to_boundary(front: &mut Front<'_>, v: VertexId, around: &Surroundings<'_>) -> bool {
    let mut faces: Vec<(f64, [VertexId; 3])> = Vec::new();
    for &w in around.neighbours.of(v) {
        // The hole lies left of the edge from `w` to `from`.
        faces.extend(front.openings(w).iter().map(|o| [v, w, o.from]).map(|t| (around.circle(t), t)));
    }
    faces.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    faces.iter().any(|&(_, t)| front.take(t))
}

fn split_a_face(front: &mut Front<'_>, v: VertexId, around: &Surroundings<'_>) -> bool {
    around.neighbours.of(v).iter().any(|&w| {
        let faces: Vec<FaceId> = front.sectors(w).map(|sector| sector.0).collect();
        faces.into_iter().any(|face| front.split(face, v))
    })
}
