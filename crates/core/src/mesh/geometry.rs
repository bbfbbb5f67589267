//! Angles and lengths of triangles, normals of surfaces, polygons in the plane, and which poses are rigid.

use glam::{DAffine3, DMat3, DVec2, DVec3};

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Adjacency, TriMesh};

/// How far the columns of a matrix may be from orthonormal: rounding.
const ROTATION_ROUNDING: f64 = 1e-9;

/// How far the axes of a pose may be from unit length and right angles: files store poses in `f32`,
/// and a chain of links multiplies a few of them.
const RIGID_TOLERANCE: f64 = 1e-5;

/// Angle at `at` in the triangle `at`, `b`, `c`, in rad; accurate for slivers too.
pub(crate) fn angle(at: DVec3, b: DVec3, c: DVec3) -> f64 {
    let (u, v) = (b - at, c - at);
    u.cross(v).length().atan2(u.dot(v))
}

/// Cotangent of the angle at `at` in the triangle `at`, `b`, `c`; infinite for a zero angle.
pub(crate) fn cotangent(at: DVec3, b: DVec3, c: DVec3) -> f64 {
    let (u, v) = (b - at, c - at);
    u.dot(v) / u.cross(v).length()
}

/// Length of a closed walk along vertices, in m.
pub(crate) fn loop_length(mesh: &TriMesh, walk: &[VertexId]) -> f64 {
    let next = walk.iter().cycle().skip(1);
    walk.iter().zip(next).map(|(&a, &b)| mesh.positions[a].distance(mesh.positions[b])).sum()
}

/// Unit normals from the faces around each vertex; where these have no direction, from the neighbouring
/// vertices.
pub(crate) fn surface_normals(mesh: &TriMesh) -> IdVec<VertexId, DVec3> {
    let mut normals = mesh.vertex_normals();
    if !normals.as_slice().contains(&DVec3::ZERO) {
        return normals;
    }
    // Where opposite faces cancel, and where squares of areas underflow, take any face.
    for (face, corners) in mesh.triangles.enumerate() {
        for &v in corners {
            if normals[v] == DVec3::ZERO {
                normals[v] = face_direction(mesh, face);
            }
        }
    }
    // In each pass the neighbours of vertices with a direction get one.
    while normals.as_slice().contains(&DVec3::ZERO) {
        let mut around = IdVec::<VertexId, DVec3>::filled(DVec3::ZERO, normals.len());
        for corners in &mesh.triangles {
            let sum: DVec3 = corners.iter().map(|&v| normals[v]).sum();
            corners.iter().for_each(|&v| around[v] += sum);
        }
        let mut is_done = true;
        for (normal, around) in normals.iter_mut().zip(&around).filter(|(normal, _)| **normal == DVec3::ZERO)
        {
            *normal = around.normalize_or_zero();
            is_done &= *normal == DVec3::ZERO;
        }
        if is_done {
            break;
        }
    }
    normals
}

fn face_direction(mesh: &TriMesh, face: FaceId) -> DVec3 {
    let [a, b, c] = mesh.corners(face);
    (b - a).normalize_or_zero().cross((c - a).normalize_or_zero()).normalize_or_zero()
}

/// The smallest rectangle around points, `(min, max)`; the origin if none is finite.
#[doc(hidden)]
pub fn rectangle_around(places: impl Iterator<Item = DVec2>) -> (DVec2, DVec2) {
    let grow = |(lo, hi): (DVec2, DVec2), p: DVec2| (lo.min(p), hi.max(p));
    let (lo, hi) = places.fold((DVec2::INFINITY, DVec2::NEG_INFINITY), grow);
    if lo.is_finite() && hi.is_finite() { (lo, hi) } else { (DVec2::ZERO, DVec2::ZERO) }
}

/// Mean length of all edges, in m; zero without edges.
pub fn mean_edge_length(mesh: &TriMesh, adjacency: &Adjacency) -> f64 {
    let (mut sum, mut count) = (0.0, 0_usize);
    for v in mesh.positions.ids() {
        for &w in adjacency.ring(v) {
            if v < w {
                sum += mesh.positions[v].distance(mesh.positions[w]);
                count += 1;
            }
        }
    }
    if count == 0 { 0.0 } else { sum / count as f64 }
}

/// Whether a pose is finite and only rotates and translates.
pub fn is_rigid(pose: &DAffine3) -> bool {
    let axes = &pose.matrix3;
    pose.is_finite() && rotation_defect(axes) <= RIGID_TOLERANCE && axes.determinant() > 0.0
}

/// Whether a matrix neither scales nor mirrors.
#[doc(hidden)]
pub fn is_rotation(matrix: &DMat3) -> bool {
    rotation_defect(matrix) <= ROTATION_ROUNDING && matrix.determinant() > 0.0
}

/// Largest entry of `M' M - I`: 0 for a rotation, infinite where an entry is not a number.
#[doc(hidden)]
pub fn rotation_defect(matrix: &DMat3) -> f64 {
    let defect = matrix.transpose() * *matrix - DMat3::IDENTITY;
    let size = |x: f64| if x.is_nan() { f64::INFINITY } else { x.abs() };
    defect.to_cols_array().into_iter().map(size).fold(0.0, f64::max)
}

/// The parts of a triangle that is cut in the middle of some of its sides: corners 0 to 2, and 3 to 5 in the middle of the
/// sides that begin there.
pub(crate) fn parts(is_cut: [bool; 3]) -> Vec<[usize; 3]> {
    let turned = |by: usize, part: [usize; 3]| part.map(|k| k / 3 * 3 + (k % 3 + by) % 3);
    let first = |cut: bool| (0..3).find(|&k| is_cut[k] == cut).unwrap_or(0);
    match is_cut.iter().filter(|cut| **cut).count() {
        0 => vec![[0, 1, 2]],
        // Side 0 is cut.
        1 => [[0, 3, 2], [3, 1, 2]].map(|part| turned(first(true), part)).to_vec(),
        // All but side 2 are.
        2 => [[3, 1, 4], [0, 3, 4], [0, 4, 2]].map(|part| turned(first(false) + 1, part)).to_vec(),
        _ => vec![[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]],
    }
}
