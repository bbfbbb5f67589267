//! Places a finished map: centred, turned to its main direction, as large as the skin.
//!
//! A map may be moved, turned and scaled without a change of its shape; this fixes the choice, independent of
//! the numbering of the vertices if the shape has a direction of its own.

use std::iter::Sum;

use glam::{DVec2, DVec3};

use crate::flatten::energy::elements::Uv;
use crate::id::{FaceId, IdVec};
use crate::mesh::{TriMesh, signed_area};
use crate::parallel::par_sum;

/// Moments closer than this, relatively, are equal: such a shape has no direction of its own.
const NO_DIRECTION: f64 = 1e-6;

/// Moments of the map, weighted with areas on the skin: the same for every numbering of the
/// vertices.
struct Moments {
    centre: DVec2,
    /// The whole area on the skin.
    area: f64,
    /// Second moments about the centre: xx, yy, xy.
    second: DVec3,
}

/// The sum of `visit(mass, position)` over points that carry the area: the midpoints of the faces' sides, a
/// third of the face each, which integrates second moments exactly.
fn sum_of_masses<T: Send + Sum>(mesh: &TriMesh, uv: &Uv, visit: impl Fn(f64, DVec2) -> T + Sync) -> T {
    par_sum(mesh.triangles.len(), |face| {
        let face = FaceId::new(face);
        let [a, b, c] = mesh.triangles[face].map(|v| uv[v]);
        let mass = mesh.face_area(face) / 3.0;
        [a + b, b + c, c + a].into_iter().map(|twice| visit(mass, twice / 2.0)).sum()
    })
}

/// The centre, and the whole area on the skin.
fn centre(mesh: &TriMesh, uv: &Uv) -> (DVec2, f64) {
    let sums = sum_of_masses(mesh, uv, |m, p| m * p.extend(1.0));
    (sums.truncate() / sums.z, sums.z)
}

fn moments(mesh: &TriMesh, uv: &Uv) -> Moments {
    let (centre, area) = centre(mesh, uv);
    let second = sum_of_masses(mesh, uv, |m, p| {
        let q = p - centre;
        m / area * DVec3::new(q.x * q.x, q.y * q.y, q.x * q.y)
    });
    Moments { centre, area, second }
}

/// The direction on the map that is turned to x.
///
/// It is the longer principal axis, towards the side where the map extends farther (third moment). A shape
/// without such an axis or side, like a disk, turns so that its first vertex off the centre lies on the
/// positive x axis or side.
pub(super) fn main_direction(mesh: &TriMesh, uv: &Uv) -> DVec2 {
    let Moments { centre, area, second } = moments(mesh, uv);
    let [xx, yy, xy] = second.to_array();
    let spread = xx + yy;
    let radius = spread.max(0.0).sqrt();
    // The first vertex that is neither at the centre nor, along an axis, level with it.
    let first = |along: &dyn Fn(DVec2) -> f64| {
        uv.iter().map(|&p| p - centre).find(|&q| along(q).abs() > 1e-3 * radius)
    };
    let difference = DVec2::new(xx - yy, 2.0 * xy);
    if difference.length() <= NO_DIRECTION * spread {
        return first(&|q| q.length()).map_or(DVec2::X, DVec2::normalize_or_zero);
    }
    let axis = DVec2::from_angle(0.5 * difference.to_angle());
    let third = sum_of_masses(mesh, uv, |m, p| m / area * (p - centre).dot(axis).powi(3));
    let towards = if third.abs() > NO_DIRECTION * radius.powi(3) {
        third
    } else {
        first(&|q| q.dot(axis)).map_or(1.0, |q| q.dot(axis))
    };
    if towards < 0.0 { -axis } else { axis }
}

/// Moves, turns and scales a map, in m: its centre at the origin, `direction` along x, as large as
/// the skin, where faces count by their weights.
pub(super) fn normalise_map(
    mesh: &TriMesh,
    uv: &Uv,
    direction: DVec2,
    weights: Option<&IdVec<FaceId, f64>>,
) -> Uv {
    let areas = par_sum(mesh.triangles.len(), |face| {
        let face = FaceId::new(face);
        let weight = weights.map_or(1.0, |weights| weights[face]);
        let on_map = signed_area(mesh.triangles[face].map(|v| uv[v])).abs();
        weight * DVec2::new(mesh.face_area(face), on_map)
    });
    let scale = if areas.y > 0.0 { (areas.x / areas.y).sqrt() } else { 1.0 };
    let (centre, _) = centre(mesh, uv);
    let back = DVec2::new(direction.x, -direction.y);
    uv.map(|&p| back.rotate(p - centre) * scale)
}

/// The direction on a map that must be turned to x to align it with another one. `pairs` are positions of the
/// same points, first on the map to be turned, then on the other.
pub(super) fn direction_like<'a>(pairs: impl Iterator<Item = (&'a DVec2, &'a DVec2)> + Clone) -> DVec2 {
    let count = pairs.clone().count() as f64;
    let (sum_a, sum_b) = pairs.clone().fold((DVec2::ZERO, DVec2::ZERO), |(s, t), (a, b)| (s + *a, t + *b));
    // Least squares (Procrustes in the plane): the angle of sum conj(b) a.
    let turn: DVec2 = pairs
        .map(|(a, b)| {
            let (a, b) = (*a - sum_a / count, *b - sum_b / count);
            DVec2::new(b.dot(a), b.perp_dot(a))
        })
        .sum();
    turn.try_normalize().unwrap_or(DVec2::X)
}
