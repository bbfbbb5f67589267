//! Places of the outer loop that are known before the map: a circle or a rectangle as large as the
//! skin (eq. 2 of `(cannata)`, whose `m_j` of the boundary are given).
//!
//! *Heuristic*: the corners of a rectangle are the four most convex places of the loop, turning
//! summed over a part of it, so that a rounded corner counts like a sharp one.

use std::f64::consts::{PI, TAU};

use glam::DVec2;

use crate::{
    flatten::{Boundary, FlattenError, domain::disk::Disk},
    id::{IdVec, VertexId},
    mesh::{TriMesh, angle},
};

/// Part of the loop over which the turning of a corner is summed.
const CORNER: f64 = 1.0 / 40.0;

/// Least distance of two corners over the length of the loop.
const CORNERS_APART: f64 = 1.0 / 12.0;

/// Places (m) of the vertices of the outer loop, around the origin; none for a free boundary.
pub(crate) fn prescribed(
    mesh: &TriMesh,
    boundary: Boundary,
) -> Result<Option<IdVec<VertexId, Option<DVec2>>>, FlattenError> {
    if boundary == Boundary::Free {
        return Ok(None);
    }
    let disk = Disk::new(mesh)?;
    let mut walk = disk.loops[0].clone();
    let places = match boundary {
        Boundary::Free => Vec::new(),
        Boundary::Circle => {
            let radius = (mesh.area() / PI).sqrt();
            shares(mesh, &walk).iter().map(|&s| radius * DVec2::from_angle(TAU * s)).collect()
        }
        Boundary::Rectangle { width, height, corners } => {
            let scale = (mesh.area() / (width * height)).sqrt();
            let corners = match corners {
                Some(given) => given_corners(&walk, given)?,
                None => convex_corners(mesh, &walk).ok_or(FlattenError::Corners { found: walk.len() })?,
            };
            walk.rotate_left(corners[0]);
            let sides = corners.map(|c| c - corners[0]);
            on_rectangle(&shares(mesh, &walk), sides, scale * DVec2::new(width, height))
        }
    };
    let mut fixed = IdVec::filled(None, mesh.positions.len());
    for (&v, at) in walk.iter().zip(places) {
        fixed[v] = Some(at);
    }
    Ok(Some(fixed))
}

/// Length from the first vertex of a loop to each one, over the whole length.
fn shares(mesh: &TriMesh, walk: &[VertexId]) -> Vec<f64> {
    let mut along = 0.0;
    let mut shares: Vec<f64> = Vec::with_capacity(walk.len());
    for (k, &v) in walk.iter().enumerate() {
        shares.push(along);
        along += mesh.positions[v].distance(mesh.positions[walk[(k + 1) % walk.len()]]);
    }
    shares.iter_mut().for_each(|s| *s /= along);
    shares
}

/// Where the given corners lie in the loop, in its order from the first one.
fn given_corners(walk: &[VertexId], given: [VertexId; 4]) -> Result<[usize; 4], FlattenError> {
    let mut at = [0; 4];
    for (at, vertex) in at.iter_mut().zip(given) {
        let place = walk.iter().position(|&v| v == vertex);
        *at = place.ok_or(FlattenError::Corner { vertex })?;
    }
    let first = at[0];
    for place in &mut at {
        *place = (*place + walk.len() - first) % walk.len();
    }
    at[1..].sort_unstable();
    if at.windows(2).any(|pair| pair[0] == pair[1]) {
        return Err(FlattenError::Corners { found: walk.len() });
    }
    Ok(at.map(|place| place + first))
}

/// The four most convex places of the loop, in its order; `None` if there are not four apart.
fn convex_corners(mesh: &TriMesh, walk: &[VertexId]) -> Option<[usize; 4]> {
    let shares = shares(mesh, walk);
    let mut turning = IdVec::<VertexId, f64>::filled(PI, mesh.positions.len());
    for &[a, b, c] in &mesh.triangles {
        for [v, from, to] in [[a, b, c], [b, c, a], [c, a, b]] {
            turning[v] -= angle(mesh.positions[v], mesh.positions[from], mesh.positions[to]);
        }
    }
    let apart = |i: usize, j: usize| {
        let d = (shares[i] - shares[j]).abs();
        d.min(1.0 - d)
    };
    let convexity: Vec<f64> = (0..walk.len())
        .map(|i| {
            let near = (0..walk.len()).filter(|&j| apart(i, j) <= CORNER);
            near.map(|j| turning[walk[j]] * (1.0 - 0.5 * apart(i, j) / CORNER)).sum()
        })
        .collect();
    let mut order: Vec<usize> = (0..walk.len()).collect();
    order.sort_by(|&i, &j| convexity[j].total_cmp(&convexity[i]).then(i.cmp(&j)));
    let mut chosen: Vec<usize> = Vec::new();
    for i in order {
        if chosen.len() < 4 && chosen.iter().all(|&j| apart(i, j) >= CORNERS_APART) {
            chosen.push(i);
        }
    }
    chosen.sort_unstable();
    chosen.try_into().ok()
}

/// Places on the sides of a rectangle of this size around the origin, by length between corners,
/// counter-clockwise from its lower left one.
fn on_rectangle(shares: &[f64], corners: [usize; 4], size: DVec2) -> Vec<DVec2> {
    let half = 0.5 * size;
    let places = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|p| half * DVec2::from_array(p));
    let share = |k: usize| shares.get(k).copied().unwrap_or(1.0);
    (0..shares.len())
        .map(|k| {
            let side = corners.iter().rposition(|&c| c <= k).unwrap_or(0);
            let from = share(corners[side]);
            let to = share(corners.get(side + 1).copied().unwrap_or(shares.len()));
            places[side].lerp(places[(side + 1) % 4], (share(k) - from) / (to - from))
        })
        .collect()
}
