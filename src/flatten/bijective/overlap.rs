//! Whether a map overlaps itself: crossings of the boundary, branch points inside, excess angles on
//! the boundary.
//!
//! This is the only judge of overlap, for the solver that must prevent it and for the measures of
//! [`Distortion`](crate::flatten::Distortion).

use glam::DVec2;

use crate::{
    flatten::{
        bijective::{
            crossings::{
                MAX_CROSSINGS, boundary_crosses_itself, boundary_crossings, each_in_a_box, each_to_the_right,
            },
            orientation::orientation,
        },
        domain::elements::Uv,
        domain::flatten_domain::FlattenDomain,
    },
    id::{IdVec, VertexId},
    mesh::{Parts, TriMesh, boundary_edges, loops_of},
};

/// The faces at a boundary vertex overlap if their angles on the map add up to a full turn and more
/// than this, in rad. What is less is rounding: both sides of a slit may meet.
const BEYOND_A_TURN: f64 = 1e-6;

/// Number of places where a map overlaps itself: pairs of boundary edges without a common vertex
/// that cross or touch, vertices about which the map winds more than once, and loops inside out.
///
/// A map without flips and without these is one to one. Flips and crossings alone are not enough: a
/// sleeve whose hole is turned inside out has neither, but two inner vertices with two full turns
/// of faces, or as many on its boundary (Gauss and Bonnet). Where [`MAX_CROSSINGS`] pairs of edges
/// cross, nothing more is counted.
pub(crate) fn overlaps(mesh: &TriMesh, uv: &Uv) -> usize {
    let edges = boundary_edges(mesh);
    let crossings = boundary_crossings(&edges, uv);
    if crossings >= MAX_CROSSINGS {
        return crossings;
    }
    let mut on_boundary = IdVec::filled(false, uv.len());
    edges.iter().flatten().for_each(|&v| on_boundary[v] = true);
    let faces = || mesh.triangles.iter().copied();
    let outer = loops_of(&edges).iter().filter(|walk| is_counter_clockwise(walk, uv)).count();
    let parts = Parts::of_components(mesh);
    crossings
        + outer.saturating_sub(parts.len())
        + count_covered(&edges, &parts, uv)
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
    let loops = &domain.disk.loops;
    let is_outer = |walk: &&Vec<VertexId>| is_counter_clockwise(walk, uv);
    // A disk's only loop is the outer one, even where it runs across itself.
    loops.len() == 1
        || (loops.iter().filter(is_outer).count() == 1
            && loops.iter().all(|walk| is_outer(&walk) || !boundary_crosses_itself(&loop_edges(walk), uv)))
}

/// Whether a map without flips and branch points is one to one.
pub(crate) fn is_one_to_one(domain: &FlattenDomain<'_>, uv: &Uv) -> bool {
    let edges: Vec<[VertexId; 2]> = domain.disk.boundary_edges().collect();
    keeps_holes(domain, uv) && !boundary_crosses_itself(&edges, uv)
}

/// Number of components that lie within another one, by one place of each: all of it does where the
/// boundaries do not cross.
///
/// A boundary is closed, so it passes a place outside its box as often upwards as downwards. Only
/// components with the place in their box are counted, and no edge beyond these boxes is visited.
fn count_covered(edges: &[[VertexId; 2]], parts: &Parts, uv: &Uv) -> usize {
    if parts.len() == 1 {
        return 0;
    }
    let mut places = vec![None; parts.len()];
    let mut boxes = vec![[DVec2::INFINITY, DVec2::NEG_INFINITY]; parts.len()];
    for &[v, _] in edges {
        let part = parts.of[v];
        let [low, high] = boxes[part];
        places[part] = Some(v);
        boxes[part] = [low.min(uv[v]), high.max(uv[v])];
    }
    let around: Vec<(VertexId, [DVec2; 2])> =
        places.into_iter().zip(&boxes).filter_map(|(v, &corners)| v.map(|v| (v, corners))).collect();
    let mut right = IdVec::<VertexId, f64>::filled(f64::NEG_INFINITY, uv.len());
    each_in_a_box(&around, uv, &mut |v, high| right[v] = right[v].max(high.x));
    let lines: Vec<(VertexId, f64)> =
        around.iter().map(|&(v, _)| (v, right[v])).filter(|(_, right)| right.is_finite()).collect();
    // Boundaries of others that pass on the right, upwards less downwards.
    let mut passes = IdVec::<VertexId, i32>::filled(0, uv.len());
    each_to_the_right(&lines, edges, uv, &mut |v, [a, b]| {
        let (p, [low, high]) = (uv[v], boxes[parts.of[a]]);
        if parts.of[a] == parts.of[v] || p.cmplt(low).any() || p.cmpgt(high).any() {
            return;
        }
        passes[v] += pass(p, [uv[a], uv[b]]);
    });
    lines.into_iter().filter(|&(v, _)| passes[v] != 0).count()
}

/// 1 if an edge passes a place on its right upwards, -1 if downwards, else 0.
fn pass(p: DVec2, [a, b]: [DVec2; 2]) -> i32 {
    match (a.y > p.y, b.y > p.y) {
        (false, true) if orientation([a, b, p]) > 0.0 => 1,
        (true, false) if orientation([b, a, p]) > 0.0 => -1,
        _ => 0,
    }
}

fn loop_edges(walk: &[VertexId]) -> Vec<[VertexId; 2]> {
    (0..walk.len()).map(|k| [walk[k], walk[(k + 1) % walk.len()]]).collect()
}

/// Whether a loop encloses a positive area.
fn is_counter_clockwise(walk: &[VertexId], uv: &Uv) -> bool {
    // Seen from a place on the loop, so that a small one is not lost in rounding.
    let origin = walk.first().map_or(DVec2::ZERO, |&v| uv[v]);
    let sides = walk.iter().zip(walk.iter().cycle().skip(1));
    sides.map(|(&a, &b)| (uv[a] - origin).perp_dot(uv[b] - origin)).sum::<f64>() > 0.0
}

/// Number of inner vertices about which the faces wind more than once.
///
/// Counted by the edges opposite to a vertex that pass it on its right: signs of differences and of
/// exact areas, so nothing is rounded.
fn count_branch_points(
    faces: impl Iterator<Item = [VertexId; 3]>,
    on_boundary: &IdVec<VertexId, bool>,
    uv: &Uv,
) -> usize {
    let mut winding = IdVec::<VertexId, i32>::filled(0, uv.len());
    let below = |a: VertexId, b: VertexId| (uv[a].y, uv[a].x) < (uv[b].y, uv[b].x);
    for [a, b, c] in faces {
        let side = orientation([uv[a], uv[b], uv[c]]);
        for [v, from, to] in [[a, b, c], [b, c, a], [c, a, b]] {
            if side > 0.0 && below(from, v) && below(v, to) {
                winding[v] += 1;
            } else if side < 0.0 && below(to, v) && below(v, from) {
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A component is covered if its first vertex lies in another one: here squares, some of them around
    /// others, some side by side.
    fn covered(squares: &[([u32; 2], u32)]) -> (usize, usize) {
        let (mut uv, mut triangles) = (Vec::new(), Vec::new());
        for (k, ([x, y], size)) in (0_u32..).zip(squares) {
            let lo = DVec2::new(f64::from(*x), f64::from(*y)) + DVec2::splat(0.01 * f64::from(k));
            let size = f64::from(*size);
            let corners = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
            uv.extend(corners.map(|corner| lo + size * corner));
            triangles.extend([[4 * k, 4 * k + 1, 4 * k + 2], [4 * k, 4 * k + 2, 4 * k + 3]]);
        }
        let uv: Uv = uv.into();
        let mesh = TriMesh::from_arrays(uv.iter().map(|p| p.extend(0.0)).collect(), &triangles);
        let edges = boundary_edges(&mesh);
        let parts = Parts::of_components(&mesh);
        let expected = (0..squares.len()).filter(|&k| {
            let last = edges.iter().rev().find(|[v, _]| v.index() / 4 == k).map(|[v, _]| uv[*v]);
            let is_in = |other: usize| {
                let [lo, hi] = [4 * other, 4 * other + 2].map(|v| uv[VertexId::new(v)]);
                last.is_some_and(|p| other != k && p.cmpgt(lo).all() && p.cmplt(hi).all())
            };
            (0..squares.len()).any(is_in)
        });
        (count_covered(&edges, &parts, &uv), expected.count())
    }

    /// Triangles of corners on a grid, some flat or inside out, as separate components.
    fn soup(corners: &[[[i32; 2]; 3]]) -> (Vec<[VertexId; 2]>, Parts, Uv) {
        let uv: Uv = corners.as_flattened().iter().map(|&[x, y]| DVec2::new(x.into(), y.into())).collect();
        let triangles: Vec<[u32; 3]> =
            (0_u32..).zip(corners).map(|(k, _)| [0, 1, 2].map(|i| 3 * k + i)).collect();
        let mesh = TriMesh::from_arrays(uv.iter().map(|p| p.extend(0.0)).collect(), &triangles);
        (boundary_edges(&mesh), Parts::of_components(&mesh), uv)
    }

    /// What [`count_covered`] counts: every edge of the others, for the last place of each component.
    fn covered_by_any(edges: &[[VertexId; 2]], parts: &Parts, uv: &Uv) -> usize {
        let covers = |part: &usize| {
            let own = |v: &VertexId| parts.of[*v] == *part;
            let p = edges.iter().rev().find(|[v, _]| own(v)).map_or(DVec2::NAN, |[v, _]| uv[*v]);
            edges.iter().filter(|[a, _]| !own(a)).map(|&ends| pass(p, ends.map(|v| uv[v]))).sum::<i32>() != 0
        };
        (0..parts.len()).filter(covers).count()
    }

    /// A grid of this few corners has many places on edges, on corners and on borders of boxes.
    fn corner() -> impl Strategy<Value = [i32; 2]> {
        [0..8_i32, 0..8_i32]
    }

    proptest! {
        #[test]
        fn covered_components_are_those_that_begin_in_another_one(
            squares in prop::collection::vec(((0..9_u32, 0..9_u32).prop_map(|(x, y)| [x, y]), 1..6_u32), 2..40),
        ) {
            let (found, expected) = covered(&squares);
            prop_assert_eq!(found, expected);
        }

        #[test]
        fn boxes_change_no_count(corners in prop::collection::vec([corner(), corner(), corner()], 2..40)) {
            let (edges, parts, uv) = soup(&corners);
            prop_assert_eq!(count_covered(&edges, &parts, &uv), covered_by_any(&edges, &parts, &uv));
        }
    }
}
