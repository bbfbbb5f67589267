//! Boxes along the axes of the world.

use glam::DVec3;

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
}
