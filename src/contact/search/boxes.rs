//! Boxes along the axes of the world.

use glam::DVec3;

use crate::contact::geometry::Ray;

/// What rounding may add to a coordinate of a box or of a ray, as a part of the largest: some hundred
/// roundings.
const ROUNDING: f64 = 1e-13;

/// Lower bounds of distances from boxes are reduced by this part of the distance and of the point's from
/// the origin: some hundred roundings.
const MARGIN: f64 = 1e-14;

/// A box along the axes, in m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Aabb {
    pub(super) lo: DVec3,
    pub(super) hi: DVec3,
}

impl Aabb {
    /// The box of no point.
    pub(super) const EMPTY: Self = Self { lo: DVec3::INFINITY, hi: DVec3::NEG_INFINITY };

    /// The smallest box around `points`.
    pub(super) fn around(points: impl IntoIterator<Item = DVec3>) -> Self {
        let add = |b: Self, p: DVec3| Self { lo: b.lo.min(p), hi: b.hi.max(p) };
        points.into_iter().fold(Self::EMPTY, add)
    }

    /// The smallest box around both.
    pub(in crate::contact) fn union(self, other: Self) -> Self {
        Self { lo: self.lo.min(other.lo), hi: self.hi.max(other.hi) }
    }

    /// The box around its corners moved by `place`.
    pub(in crate::contact) fn moved(&self, place: impl Fn(DVec3) -> DVec3) -> Self {
        Self::around((0..8).map(|k| {
            let pick = |bit: usize, lo: f64, hi: f64| if k >> bit & 1 == 0 { lo } else { hi };
            place(DVec3::new(
                pick(0, self.lo.x, self.hi.x),
                pick(1, self.lo.y, self.hi.y),
                pick(2, self.lo.z, self.hi.z),
            ))
        }))
    }

    /// A distance, in m, that no point of the box is nearer to `q` (m).
    #[inline]
    pub(in crate::contact) fn least_distance(&self, q: DVec3) -> f64 {
        q.distance(q.clamp(self.lo, self.hi)) * (1.0 - MARGIN) - MARGIN * q.length()
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
