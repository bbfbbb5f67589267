//! [`Aabb`]: a box along the axes.

use glam::{DVec2, DVec3};

use crate::Ray;

/// What rounding may add to a coordinate of a box or of a ray, as a part of the largest: some hundred
/// roundings.
const ROUNDING: f64 = 1e-13;

/// Lower bounds of distances from boxes are reduced by this part of the distance and of the point's from
/// the origin: some hundred roundings.
const MARGIN: f64 = 1e-14;

/// A box along the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aabb {
    /// Its least coordinates.
    pub lo: DVec3,
    /// Its largest coordinates.
    pub hi: DVec3,
}

impl Aabb {
    /// The box of no point.
    pub const EMPTY: Self = Self { lo: DVec3::INFINITY, hi: DVec3::NEG_INFINITY };

    /// The smallest box around `points`.
    pub fn around(points: impl IntoIterator<Item = DVec3>) -> Self {
        let add = |b: Self, p: DVec3| Self { lo: b.lo.min(p), hi: b.hi.max(p) };
        points.into_iter().fold(Self::EMPTY, add)
    }

    /// The smallest box around points of the plane.
    pub fn flat(points: impl IntoIterator<Item = DVec2>) -> Self {
        Self::around(points.into_iter().map(|p| p.extend(0.0)))
    }

    /// The smallest box around both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self { lo: self.lo.min(other.lo), hi: self.hi.max(other.hi) }
    }

    /// The box around its corners moved by `place`.
    #[must_use]
    pub fn moved(&self, place: impl Fn(DVec3) -> DVec3) -> Self {
        Self::around((0..8).map(|k| {
            let pick = |bit: usize, lo: f64, hi: f64| if k >> bit & 1 == 0 { lo } else { hi };
            place(DVec3::new(
                pick(0, self.lo.x, self.hi.x),
                pick(1, self.lo.y, self.hi.y),
                pick(2, self.lo.z, self.hi.z),
            ))
        }))
    }

    /// Whether they have a common point.
    #[inline]
    #[must_use]
    pub fn touches(&self, other: &Self) -> bool {
        !(self.lo.cmpgt(other.hi).any() || other.lo.cmpgt(self.hi).any())
    }

    /// A distance that no point of the box is nearer to `q`.
    #[inline]
    #[must_use]
    pub fn least_distance(&self, q: DVec3) -> f64 {
        q.distance(q.clamp(self.lo, self.hi)) * (1.0 - MARGIN) - MARGIN * q.length()
    }

    /// How far along a ray the box begins, at least; infinite if the ray does not enter it before a
    /// distance along it.
    #[inline]
    #[must_use]
    pub fn entry(&self, ray: &Ray, longest: f64) -> f64 {
        let size = self.lo.abs().max(self.hi.abs()).max_element() + ray.origin.abs().max_element();
        let margin = DVec3::splat(ROUNDING * size);
        let (lo, hi) = (self.lo - margin - ray.origin, self.hi + margin - ray.origin);
        let (mut enter, mut leave) = (0.0_f64, longest + margin.x);
        for k in 0..3 {
            if ray.direction[k] != 0.0 {
                let (a, b) = (lo[k] / ray.direction[k], hi[k] / ray.direction[k]);
                (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
            } else if lo[k] > 0.0 || hi[k] < 0.0 {
                return f64::INFINITY;
            }
        }
        if enter <= leave { (enter - margin.x).max(0.0) } else { f64::INFINITY }
    }
}
