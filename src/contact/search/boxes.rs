//! Boxes along the axes of the world.

use glam::DVec3;

use crate::contact::geometry::Ray;

/// What rounding may add to a coordinate of a box or of a ray, as a part of the largest: some hundred
/// roundings.
const ROUNDING: f64 = 1e-13;

/// A box along the axes, in m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Aabb {
    pub(super) lo: DVec3,
    pub(super) hi: DVec3,
}

impl Aabb {
    /// The smallest box around `points`.
    pub(super) fn around(points: impl IntoIterator<Item = DVec3>) -> Self {
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (lo, hi) = points.into_iter().fold(empty, |(lo, hi), p| (lo.min(p), hi.max(p)));
        Self { lo, hi }
    }

    /// Whether a ray may enter the box before a distance (m) along it.
    pub(super) fn is_met(&self, ray: &Ray, longest: f64) -> bool {
        let size = self.lo.abs().max(self.hi.abs()).max_element() + ray.origin.abs().max_element();
        let margin = DVec3::splat(ROUNDING * size);
        let (lo, hi) = (self.lo - margin - ray.origin, self.hi + margin - ray.origin);
        let (mut enter, mut leave) = (0.0_f64, longest + margin.x);
        for k in 0..3 {
            if ray.direction[k] != 0.0 {
                let (a, b) = (lo[k] / ray.direction[k], hi[k] / ray.direction[k]);
                (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
            } else if lo[k] > 0.0 || hi[k] < 0.0 {
                return false;
            }
        }
        enter <= leave
    }
}
