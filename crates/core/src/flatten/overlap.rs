//! Whether a map overlaps itself: crossings of the boundary, branch points inside, excess angles on
//! the boundary.
//!
//! The only test of overlap, for the solver that must prevent it and for the measures of
//! [`Distortion`](crate::flatten::Distortion).

use glam::DVec2;

use crate::delaunay::orientation;
use crate::flatten::crossings::{MAX_CROSSINGS, boundary_crosses_itself, boundary_crossings};
use crate::flatten::domain::FlattenDomain;
use crate::flatten::energy::elements::{Uv, keeps_orientation};
use crate::flatten::{FlattenError, Overlap};
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{TriMesh, boundary_edges, face_components, loops_of};
use crate::parallel::{par_each, par_sum};

/// The faces at a boundary vertex overlap if their angles on the map exceed a full turn by more than this, in
/// rad. A smaller excess is rounding: both sides of a slit may meet.
const BEYOND_A_TURN: f64 = 1e-6;

/// Number of overlaps of a map: pairs of boundary edges without a common vertex
/// that cross or touch, vertices about which the map winds more than once, and loops inside out.
///
/// A map without flips and without these is one to one. Flips and crossings alone are not enough: a sleeve
/// whose hole is turned inside out has neither, but two inner vertices with two full turns of faces, or as
/// many on its boundary (Gauss and Bonnet). If [`MAX_CROSSINGS`] pairs of edges cross, the rest is not
/// counted. A component inside another one is not counted either.
pub(crate) fn overlaps(mesh: &TriMesh, uv: &Uv) -> usize {
    let edges = boundary_edges(mesh);
    let crossings = boundary_crossings(&edges, uv);
    if crossings >= MAX_CROSSINGS {
        return crossings;
    }
    let mut on_boundary = IdVec::filled(false, uv.len());
    edges.iter().flatten().for_each(|&v| on_boundary[v] = true);
    let outer = loops_of(&edges).iter().filter(|walk| is_counter_clockwise(walk, uv)).count();
    crossings
        + outer.saturating_sub(face_components(&mesh.triangles, mesh.positions.len()).count)
        + count_branch_points(&mesh.triangles, &on_boundary, uv)
        + count_angle_excess(&mesh.triangles, &on_boundary, uv)
}

/// Whether the map winds once about every inner vertex. No step of a solver that flips no face
/// changes that.
pub(crate) fn has_no_branch_points(domain: &FlattenDomain<'_>, uv: &Uv) -> bool {
    let mut on_boundary = IdVec::filled(false, uv.len());
    domain.disk.loops.iter().flatten().for_each(|&v| on_boundary[v] = true);
    count_branch_points(&domain.mesh.triangles, &on_boundary, uv) == 0
}

/// Whether one boundary loop runs counter-clockwise, and every other one, around a hole, clockwise
/// and not across itself.
pub(crate) fn keeps_holes(loops: &[Vec<VertexId>], uv: &Uv) -> bool {
    let is_outer = |walk: &&Vec<VertexId>| is_counter_clockwise(walk, uv);
    // The only loop of a disk is the outer one, even if it crosses itself.
    loops.len() == 1
        || (loops.iter().filter(is_outer).count() == 1
            && loops.iter().all(|walk| is_outer(&walk) || !boundary_crosses_itself(&loop_edges(walk), uv)))
}

/// Whether a map without flips and branch points is one to one.
pub(crate) fn is_one_to_one(loops: &[Vec<VertexId>], uv: &Uv) -> bool {
    let edges: Vec<[VertexId; 2]> = loops.iter().flat_map(|walk| loop_edges(walk)).collect();
    keeps_holes(loops, uv) && !boundary_crosses_itself(&edges, uv)
}

/// Checks the guarantees of the intrinsic method for the map of a disk with these loops, exactly: no face is
/// flipped, holes stay holes, and it does not overlap itself if it must not.
///
/// # Errors
/// [`FlattenError::NotInjective`].
pub(crate) fn check_map(
    mesh: &TriMesh,
    loops: &[Vec<VertexId>],
    overlap: Overlap,
    uv: &Uv,
) -> Result<(), FlattenError> {
    let is_flipped = |face: FaceId| !keeps_orientation(mesh.triangles[face].map(|v| uv[v]));
    let flips = par_sum(mesh.triangles.len(), |face| usize::from(is_flipped(FaceId::new(face))));
    let is_legal = match overlap {
        Overlap::Allow => keeps_holes(loops, uv),
        Overlap::Prevent => is_one_to_one(loops, uv),
    };
    if flips == 0 && is_legal {
        return Ok(());
    }
    Err(FlattenError::NotInjective { flips, overlaps: overlaps(mesh, uv) })
}

fn loop_edges(walk: &[VertexId]) -> Vec<[VertexId; 2]> {
    (0..walk.len()).map(|k| [walk[k], walk[(k + 1) % walk.len()]]).collect()
}

/// Whether a loop encloses a positive area.
fn is_counter_clockwise(walk: &[VertexId], uv: &Uv) -> bool {
    // Relative to a vertex of the loop, so that a small one is not lost in rounding.
    let origin = walk.first().map_or(DVec2::ZERO, |&v| uv[v]);
    let sides = walk.iter().zip(walk.iter().cycle().skip(1));
    sides.map(|(&a, &b)| (uv[a] - origin).perp_dot(uv[b] - origin)).sum::<f64>() > 0.0
}

/// Number of inner vertices about which the faces wind more than once.
///
/// Counts the edges opposite to a vertex that pass it on its right, by signs of differences and of exact
/// areas, so nothing is rounded.
fn count_branch_points(
    triangles: &IdVec<FaceId, [VertexId; 3]>,
    on_boundary: &IdVec<VertexId, bool>,
    uv: &Uv,
) -> usize {
    let mut winding = IdVec::<VertexId, i32>::filled(0, uv.len());
    let below = |a: VertexId, b: VertexId| (uv[a].y, uv[a].x) < (uv[b].y, uv[b].x);
    // A face passes at most one of its corners.
    let passed = |face: FaceId| {
        let [a, b, c] = triangles[face];
        let side = orientation([uv[a], uv[b], uv[c]]);
        [[a, b, c], [b, c, a], [c, a, b]].into_iter().find_map(|[v, from, to]| {
            let turn = if side > 0.0 && below(from, v) && below(v, to) {
                1
            } else if side < 0.0 && below(to, v) && below(v, from) {
                -1
            } else {
                return None;
            };
            Some((v, turn))
        })
    };
    par_each(triangles.len(), passed, |_, passed| {
        passed.into_iter().for_each(|(v, turn)| winding[v] += turn)
    });
    winding.iter().zip(on_boundary).filter(|&(&w, &on_boundary)| w > 1 && !on_boundary).count()
}

/// Number of boundary vertices with more than a full turn of faces.
fn count_angle_excess(
    triangles: &IdVec<FaceId, [VertexId; 3]>,
    on_boundary: &IdVec<VertexId, bool>,
    uv: &Uv,
) -> usize {
    let mut turn = IdVec::<VertexId, f64>::filled(0.0, uv.len());
    for &[a, b, c] in triangles {
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
    use super::*;
    use crate::flatten::domain::Disk;
    use crate::mesh::shapes;

    /// Rounding or an attempt may turn faces of a map over, or place some over others.
    #[test]
    fn illegal_maps_are_refused() {
        let holed = shapes::tube(8, 3, 0.01, 0.02);
        let ring = |p: glam::DVec3, r: f64| (0.02 + r * p.z) * DVec2::new(p.x, p.y).normalize();
        let outward = holed.positions.map(|&p| ring(p, -0.5));
        let through = holed.positions.map(|&p| ring(p, -1.5));
        let strip = shapes::lattice(9, 2, 0.01);
        let flat = strip.positions.map(|p| DVec2::new(p.x, p.y));
        let wound = strip.positions.map(|p| (1.0 - 0.2 * p.y / 0.01) * DVec2::from_angle(100.0 * p.x));
        let turned = flat.map(|p| DVec2::new(-p.x, p.y));
        for (name, mesh, uv, prevent, allow) in [
            ("ring", &holed, &outward, true, true),
            ("ring turned through itself", &holed, &through, false, false),
            ("strip", &strip, &flat, true, true),
            ("strip over itself", &strip, &wound, false, true),
            ("strip turned over", &strip, &turned, false, false),
        ] {
            let loops = Disk::new(mesh).unwrap().loops;
            for (overlap, legal) in [(Overlap::Prevent, prevent), (Overlap::Allow, allow)] {
                let found = check_map(mesh, &loops, overlap, uv);
                assert_eq!(found.is_ok(), legal, "{name}, {overlap:?}: {found:?}");
            }
        }
    }
}
