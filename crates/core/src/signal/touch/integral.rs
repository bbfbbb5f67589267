//! Force and centre of pressure of a body on the patches of a link: its pressure integrated over the smooth skin.

use glam::DVec3;

use crate::signal::touch::TouchOptions;
use crate::signal::touch::probe::Probe;
use crate::signal::touch::surface::{mix, normals, rounded};
use crate::skin::Patch;

/// Triangles are divided until their edges are shorter than this share of the contact's radius; the
/// force of a press on a plane is then exact to 0.2 %.
const FINENESS: f64 = 1.0 / 16.0;

/// Most divisions of an edge, for triangles much larger than the contact.
const MOST_PARTS: f64 = 256.0;

/// Force and centre of pressure of the whole contact on these patches, at most this deep; `None` if nothing is touched.
pub(super) fn contact<'p>(
    probe: &Probe,
    depth: f64,
    patches: impl Iterator<Item = &'p Patch>,
    options: &TouchOptions,
) -> Option<(f64, DVec3)> {
    let (mut volume, mut moment) = (0.0, DVec3::ZERO);
    for patch in patches {
        let of_patch = pressed_volume(probe, depth, patch);
        volume += of_patch.0;
        moment += of_patch.1;
    }
    (volume > 0.0).then(|| (options.stiffness * volume, moment / volume))
}

/// The volume that a body presses out of a patch, in m^3, and its first moment, in m^4.
fn pressed_volume(probe: &Probe, depth: f64, patch: &Patch) -> (f64, DVec3) {
    let mesh = &patch.mesh;
    let (centre, reach) = (probe.sphere.centre, probe.reach());
    let radius = (depth * (2.0 * probe.sphere.radius - depth)).max(0.0).sqrt();
    let (mut volume, mut moment) = (0.0, DVec3::ZERO);
    for face in mesh.triangles.ids() {
        let corners = mesh.corners(face);
        let longest =
            (0..3).map(|k| corners[k].distance_squared(corners[(k + 1) % 3])).fold(0.0, f64::max).sqrt();
        if corners[0].distance_squared(centre) > (reach + 1.5 * longest).powi(2) {
            continue;
        }
        let normals = normals(patch, face);
        let parts = (longest / (FINENESS * radius)).ceil().clamp(1.0, MOST_PARTS);
        let area = mesh.face_area(face) / (parts * parts);
        for weights in parts_of_a_triangle(parts) {
            let point = rounded(&corners, &normals, weights);
            let depth = probe.depth(point, mix(&normals, weights).normalize_or_zero());
            volume += area * depth;
            moment += area * depth * point;
        }
    }
    (volume, moment)
}

/// Barycentric coordinates of the centres of the `parts` squared equal triangles into which one is divided.
fn parts_of_a_triangle(parts: f64) -> impl Iterator<Item = [f64; 3]> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 256")]
    let n = parts as u32;
    (0..n).flat_map(move |i| (0..n - i).map(move |j| (i, j))).flat_map(move |(i, j)| {
        let weights = move |shift: f64| {
            let (u, v) = ((f64::from(i) + shift) / parts, (f64::from(j) + shift) / parts);
            [1.0 - u - v, u, v]
        };
        // The small triangle with the orientation of the whole, and its neighbour with the opposite one.
        let other = (i + j + 1 < n).then(|| weights(2.0 / 3.0));
        std::iter::once(weights(1.0 / 3.0)).chain(other)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_have_the_centre_of_the_whole() {
        for n in 1..6 {
            let parts: Vec<_> = parts_of_a_triangle(f64::from(n)).collect();
            assert_eq!(parts.len(), (n * n) as usize);
            for k in 0..3 {
                let mean = parts.iter().map(|w| w[k]).sum::<f64>() / f64::from(n * n);
                assert!((mean - 1.0 / 3.0).abs() < 1e-12, "{n} {k} {mean}");
            }
        }
    }
}
