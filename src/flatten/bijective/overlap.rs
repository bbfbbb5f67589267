//! Whether a map overlaps itself: crossings of the boundary, branch points inside, excess angles on
//! the boundary.
//!
//! This is the only judge of overlap, for the solver that must prevent it and for the measures of
//! [`Distortion`](crate::flatten::Distortion).

use glam::DVec2;

use crate::{
    flatten::{
        bijective::crossings::boundary_crossings, domain::elements::Uv, domain::flatten_domain::FlattenDomain,
    },
    id::{IdVec, VertexId},
    mesh::{TriMesh, boundary_edges},
};

/// The faces at a boundary vertex overlap if their angles on the map add up to a full turn and more
/// than this, in rad. What is less is rounding: both sides of a slit may meet.
const BEYOND_A_TURN: f64 = 1e-6;

/// Number of places where a map overlaps itself: pairs of boundary edges without a common vertex
/// that cross or touch, and vertices about which the map winds more than once.
///
/// A map without flips and without these is one to one: the angles around its inner vertices leave
/// it no choice (Gauss and Bonnet) but to have one boundary loop that runs counter-clockwise, with
/// all others inside of it and clockwise. Flips and crossings alone are not enough: a sleeve whose
/// hole is turned inside out has neither, but two inner vertices with two full turns of faces.
pub(crate) fn overlaps(mesh: &TriMesh, uv: &Uv) -> usize {
    let edges = boundary_edges(mesh);
    let mut on_boundary = IdVec::filled(false, uv.len());
    edges.iter().flatten().for_each(|&v| on_boundary[v] = true);
    let faces = || mesh.triangles.iter().copied();
    boundary_crossings(&edges, uv)
        + count_branch_points(faces(), &on_boundary, uv)
        + count_angle_excess(faces(), &on_boundary, uv)
}

/// Whether the map winds once about every inner vertex. No step of a solver that flips no face
/// changes that.
pub(crate) fn has_no_branch_points(domain: &FlattenDomain<'_>, uv: &Uv) -> bool {
    let mut on_boundary = IdVec::filled(false, uv.len());
    domain.disk.loops.iter().flatten().for_each(|&v| on_boundary[v] = true);
    count_branch_points(domain.elements.faces.iter().map(|e| e.corners), &on_boundary, uv) == 0
}

/// Whether one boundary loop runs counter-clockwise, and every other one, around a hole, clockwise
/// and not across itself.
pub(crate) fn keeps_holes(domain: &FlattenDomain<'_>, uv: &Uv) -> bool {
    let edges: Vec<[VertexId; 2]> = domain.disk.boundary_edges().collect();
    let mut outer = 0;
    loops(&edges).all(|walk| {
        let is_outer = is_counter_clockwise(walk, uv);
        outer += usize::from(is_outer);
        is_outer || boundary_crossings(walk, uv) == 0
    }) && outer == 1
}

/// Number of loops that run counter-clockwise, among boundary edges listed loop by loop.
pub(crate) fn counter_clockwise_loops(edges: &[[VertexId; 2]], uv: &Uv) -> usize {
    loops(edges).filter(|walk| is_counter_clockwise(walk, uv)).count()
}

/// The loops among boundary edges that are listed loop by loop.
fn loops(edges: &[[VertexId; 2]]) -> impl Iterator<Item = &[[VertexId; 2]]> {
    edges.chunk_by(|[_, to], [from, _]| to == from)
}

/// Whether the edges of a loop enclose a positive area.
fn is_counter_clockwise(walk: &[[VertexId; 2]], uv: &Uv) -> bool {
    // Seen from a place on the loop, so that a small one is not lost in rounding.
    let origin = walk.first().map_or(DVec2::ZERO, |&[from, _]| uv[from]);
    walk.iter().map(|&[from, to]| (uv[from] - origin).perp_dot(uv[to] - origin)).sum::<f64>() > 0.0
}

/// Number of inner vertices about which the faces wind more than once.
///
/// Counted by the edges opposite to a vertex that pass it on its right: signs of differences, so
/// nothing is rounded.
fn count_branch_points(
    faces: impl Iterator<Item = [VertexId; 3]>,
    on_boundary: &IdVec<VertexId, bool>,
    uv: &Uv,
) -> usize {
    let mut winding = IdVec::<VertexId, i32>::filled(0, uv.len());
    let below = |a: VertexId, b: VertexId| (uv[a].y, uv[a].x) < (uv[b].y, uv[b].x);
    for [a, b, c] in faces {
        let area = (uv[b] - uv[a]).perp_dot(uv[c] - uv[a]);
        for [v, from, to] in [[a, b, c], [b, c, a], [c, a, b]] {
            if area > 0.0 && below(from, v) && below(v, to) {
                winding[v] += 1;
            } else if area < 0.0 && below(to, v) && below(v, from) {
                winding[v] -= 1;
            }
        }
    }
    winding.iter().zip(on_boundary).filter(|&(&w, &on_boundary)| w > 1 && !on_boundary).count()
}

/// Number of boundary vertices with more than a full turn of faces.
fn count_angle_excess(
    faces: impl Iterator<Item = [VertexId; 3]>,
    on_boundary: &IdVec<VertexId, bool>,
    uv: &Uv,
) -> usize {
    let mut turn = IdVec::<VertexId, f64>::filled(0.0, uv.len());
    for [a, b, c] in faces {
        for [v, from, to] in [[a, b, c], [b, c, a], [c, a, b]] {
            if on_boundary[v] {
                turn[v] += (uv[from] - uv[v]).angle_to(uv[to] - uv[v]);
            }
        }
    }
    turn.iter().filter(|&&t| t > std::f64::consts::TAU + BEYOND_A_TURN).count()
}
