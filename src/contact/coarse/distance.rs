//! How far every point of a triangle is at most from a mesh.
//!
//! The distance to one triangle is convex, so over a part of a triangle it is largest at a corner; the distance to a mesh is
//! at most that to any of its triangles. A part that the face nearest to its centre does not bound well is cut in two.

use glam::DVec3;

use crate::bvh::Start;
use crate::contact::patch_bvh::{Best, PatchBvh};
use crate::skin::PatchId;

/// A bound that exceeds the distance of the centre of a part by at most this part is good enough.
const RATIO: f64 = 1.1;

/// A part of a triangle.
pub(super) struct Part {
    corners: [DVec3; 3],
    /// Its points are nowhere farther from the mesh, in m.
    bound: f64,
    /// Where the search for the face nearest to it begins.
    start: Start,
}

impl Part {
    /// All of a triangle.
    pub(super) fn new(corners: [DVec3; 3]) -> Self {
        Self { corners, bound: f64::INFINITY, start: Start::Root }
    }

    /// Raises `most` (m), if need be, so that no point of the part is farther from the mesh. Cuts the part at most
    /// `cuts` times in depth.
    pub(super) fn raise(&self, mesh: &PatchBvh, cuts: u32, most: &mut f64) {
        let [a, b, c] = self.corners;
        let mut best = None;
        let packet = mesh.nearest(PatchId::new(0), (a + b + c) / 3.0, self.start, &mut best);
        let Some(Best { face, closest, .. }) = best else { return };
        let away = |p: DVec3| mesh.measure(p, face).squared;
        let bound = away(a).max(away(b)).max(away(c)).sqrt().min(self.bound);
        if bound <= *most {
            return;
        }
        if cuts == 0 || bound <= RATIO * closest.squared.sqrt() {
            *most = bound;
            return;
        }
        let sides = [[a, b, c], [b, c, a], [c, a, b]];
        let by_length = |x: &&[DVec3; 3], y: &&[DVec3; 3]| {
            x[0].distance_squared(x[1]).total_cmp(&y[0].distance_squared(y[1]))
        };
        let [p, q, r] = *sides.iter().max_by(by_length).unwrap_or(&sides[0]);
        let start = packet.map_or(self.start, Start::Packet);
        for corners in [[p, p.midpoint(q), r], [p.midpoint(q), q, r]] {
            Self { corners, bound, start }.raise(mesh, cuts - 1, most);
        }
    }
}
