//! Repairs after growing: small holes, fans that touch in a point, and isolated taxels.
//!
//! *Heuristic*: greedy, the smallest circumcircle first.

use crate::id::{FaceId, VertexId};
use crate::numeric::{argsort, chains, order_by};
use crate::skin::triangulate::candidates::size_class;
use crate::skin::triangulate::growing_mesh::{GrowingMesh, Opening};
use crate::skin::triangulate::neighbours::PointCloud;

/// Smallest cosine between a face that fills a hole and the normals of its corners (73 degrees):
/// faces across the mouth of a sleeve are perpendicular to the surface.
const LEAST_COSINE: f64 = 0.3;

/// Fills the holes that are left where corners disagreed, if all taxels of the hole are within the gap of
/// each other. Wider holes are openings of the skin.
pub(super) fn fill_small_holes(mesh: &mut GrowingMesh<'_>, cloud: &PointCloud<'_>) {
    for rim in boundary_loops(mesh, cloud) {
        let is_small = rim.iter().all(|&v| rim.iter().all(|&w| cloud.is_within_gap(v, w)));
        if is_small {
            fill(mesh, rim, cloud);
        }
    }
}

/// A step along the boundary with the hole on the left: from `to` to `at`; `from` comes next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Step {
    at: VertexId,
    to: VertexId,
    from: VertexId,
}

/// The boundary loops, with the hole on the left.
fn boundary_loops(mesh: &GrowingMesh<'_>, cloud: &PointCloud<'_>) -> Vec<Vec<VertexId>> {
    let openings =
        |v: VertexId| mesh.openings(v).into_iter().map(move |o| Step { at: v, to: o.to, from: o.from });
    let mut steps: Vec<Step> = cloud.positions.ids().flat_map(openings).collect();
    steps.sort_unstable();
    let next = |step: Step| steps.binary_search_by_key(&(step.from, step.at), |s| (s.at, s.to)).ok();
    let rim = |walk: Vec<usize>| walk.into_iter().map(|k| steps[k].at).collect();
    chains(steps.len(), |k| next(steps[k]))
        .into_iter()
        .map(rim)
        .filter(|rim: &Vec<_>| rim.len() > 2)
        .collect()
}

/// Cuts ears off a hole, the smallest circumcircle first, until it is filled or none fits.
fn fill(mesh: &mut GrowingMesh<'_>, mut rim: Vec<VertexId>, cloud: &PointCloud<'_>) {
    let lies_flat =
        |t: [VertexId; 3]| t.iter().all(|&v| cloud.normal(t).dot(cloud.normals[v]) >= LEAST_COSINE);
    while rim.len() > 2 {
        let count = rim.len();
        let ear = |k: usize| [rim[k], rim[(k + 1) % count], rim[(k + count - 1) % count]];
        let radii: Vec<f64> = (0..count).map(|k| cloud.circumradius(ear(k))).collect();
        // One pass cuts ears that do not touch each other; the next pass fills the remaining hole.
        let mut keep = vec![true; count];
        let mut touched = vec![false; count];
        for k in argsort(&radii) {
            let [before, after] = [(k + count - 1) % count, (k + 1) % count];
            if !touched[k]
                && !touched[before]
                && !touched[after]
                && lies_flat(ear(k))
                && mesh.try_insert(ear(k))
            {
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
        rim.retain(|_| keep.next().unwrap_or(true));
    }
}

/// Keeps one fan of faces around every taxel: the one of smaller circles, of equal ones that with most faces. So a
/// corner of a module keeps the faces of its module, not those across the gap to the next.
pub(super) fn remove_extra_fans(mesh: &mut GrowingMesh<'_>, cloud: &PointCloud<'_>) {
    let mut non_manifold: Vec<VertexId> =
        cloud.positions.ids().filter(|&v| mesh.openings(v).len() > 1).collect();
    while let Some(v) = non_manifold.pop() {
        let fans = mesh.openings(v);
        if fans.len() < 2 {
            continue;
        }
        let size = |o: &Opening| {
            let fan = mesh.fan(v, o.to);
            let radii = fan.iter().map(|&(_, a, b)| cloud.circumradius([v, a, b]));
            (size_class(radii.sum::<f64>() / fan.len() as f64), usize::MAX - fan.len())
        };
        let sizes: Vec<(i64, usize)> = fans.iter().map(size).collect();
        let smallest_first = order_by(fans.len(), &|a, b| sizes[a].cmp(&sizes[b]));
        for to in smallest_first[1..].iter().map(|&k| fans[k].to) {
            for (face, a, b) in mesh.fan(v, to) {
                mesh.remove(face);
                non_manifold.extend([a, b]);
            }
        }
    }
}

/// Gives faces to taxels that have none: the face of smallest circumcircle with a boundary edge nearby, else
/// three that replace the face under or over the taxel.
pub(super) fn attach_isolated(mesh: &mut GrowingMesh<'_>, cloud: &PointCloud<'_>) {
    let mut isolated: Vec<VertexId> = cloud.positions.ids().filter(|&v| !mesh.is_used(v)).collect();
    loop {
        let before = isolated.len();
        isolated.retain(|&v| {
            let attached = join_to_boundary(mesh, v, cloud) || split_a_face(mesh, v, cloud);
            !attached
        });
        // Another taxel may now be attached to the new boundary.
        if isolated.len() == before {
            return;
        }
    }
}

fn join_to_boundary(mesh: &mut GrowingMesh<'_>, v: VertexId, cloud: &PointCloud<'_>) -> bool {
    let mut faces: Vec<(f64, [VertexId; 3])> = Vec::new();
    for &w in cloud.neighbours.of(v) {
        // The hole lies left of the edge from `w` to `from`.
        faces.extend(mesh.openings(w).iter().map(|o| [v, w, o.from]).map(|t| (cloud.circumradius(t), t)));
    }
    let order = order_by(faces.len(), &|a, b| {
        let (a, b) = (&faces[a], &faces[b]);
        a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
    });
    order.into_iter().any(|k| mesh.try_insert(faces[k].1))
}

fn split_a_face(mesh: &mut GrowingMesh<'_>, v: VertexId, cloud: &PointCloud<'_>) -> bool {
    cloud.neighbours.of(v).iter().any(|&w| {
        let faces: Vec<FaceId> = mesh.sectors(w).map(|sector| sector.0).collect();
        faces.into_iter().any(|face| mesh.split(face, v))
    })
}
