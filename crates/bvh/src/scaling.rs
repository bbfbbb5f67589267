//! [`Scaling`]: a frame in which coordinates are small enough for `f32`; how far a distance computed there
//! may be from the true one, and the bounds that follow. `packets` tests that no triangle within a distance
//! ever seems to be beyond its bound.

use glam::DVec3;

use crate::{Aabb, Ray};

/// The origin of a ray that is this many radii away is first moved along the ray to the tree, so that the
/// compared numbers are of the tree's size.
const NEARBY: f64 = 4.0;

/// A frame in which the numbers of a tree are at most about 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scaling {
    /// The centre of the box around everything.
    pub(crate) origin: DVec3,
    /// Factor from lengths to the units of the tree, in which the radius is between 1/2 and 1: a power of
    /// two, so that it rounds nothing.
    pub(crate) scale: f64,
    /// The box around everything.
    pub(crate) bounds: Aabb,
}

impl Scaling {
    /// A scaling for points in `bounds`, none of them farther than `radius` from their centre.
    pub(crate) fn new(bounds: &Aabb, radius: f64) -> Self {
        let origin = if *bounds == Aabb::EMPTY { DVec3::ZERO } else { bounds.lo.midpoint(bounds.hi) };
        Self { origin, scale: unit_scale(radius), bounds: *bounds }
    }

    /// For finite points; there may be none.
    pub(crate) fn around(points: impl Iterator<Item = DVec3> + Clone) -> Self {
        let bounds = Aabb::around(points.clone());
        let centre = Self::new(&bounds, 0.0).origin;
        let radius = points.map(|p| p.distance_squared(centre)).fold(0.0, f64::max).sqrt();
        Self::new(&bounds, radius)
    }

    #[inline]
    pub(crate) fn point(&self, p: DVec3) -> DVec3 {
        (p - self.origin) * self.scale
    }

    /// The point that [`Self::point`] brings here.
    #[inline]
    pub(crate) fn world(&self, local: DVec3) -> DVec3 {
        local / self.scale + self.origin
    }

    /// A ray moved to begin near the tree, and the distance by which it was moved.
    pub(crate) fn nearby(&self, ray: &Ray) -> (Ray, f64) {
        let along = (self.origin - ray.origin).dot(ray.direction);
        let skipped = along - NEARBY / self.scale;
        if skipped <= 0.0 {
            return (*ray, 0.0);
        }
        let origin = ray.origin + ray.direction * skipped;
        (Ray { origin, longest: ray.longest - skipped, ..*ray }, (origin - ray.origin).length())
    }

    pub(crate) fn ray(&self, ray: &Ray) -> Ray {
        Ray { origin: self.point(ray.origin), longest: ray.longest * self.scale, ..*ray }
    }
}

/// The power of two that brings `radius` between 1/2 and 1; 1 for a point.
fn unit_scale(radius: f64) -> f64 {
    /// Near the smallest power of two of `f64`; a smaller tree is treated as a point.
    const LEAST_EXPONENT: f64 = -1000.0;
    if radius > 0.0 { (-(radius.log2().ceil().max(LEAST_EXPONENT))).exp2() } else { 1.0 }
}

/// Coordinates beyond this (in m) are refused: their squares still fit into `f32`.
pub(crate) const LARGEST: f64 = 1e12;

/// By how much a distance found in `f32` may be wrong, relative to the patch's radius plus the
/// distance of the contact from the patch's centre.
///
/// Rounding the contact, the corner and their difference: 3 units; three coordinates along axes
/// that are rounded themselves: 7; the side's projection and its squares: 8; the rounded triangle:
/// 6. Doubled, `48 * 2^-24`. Boxes take fewer: their ends are rounded along their axes (5) and to
/// steps (6), and the contact into steps (8).
const SLACK: f64 = 48.0 / 16_777_216.0;

/// From this many radii away `f64` is used: the slack of `f32` is larger than the differences of the
/// distances of a flat patch's faces.
pub(crate) const FAR: f64 = 16.0;

/// Bounds in `f64` from far away are enlarged by this: some hundred roundings.
pub(crate) const FAR_ROUND_UP: f64 = 1.0 + 1e-14;

/// Squares found in `f32` are compared with bounds enlarged by this, for the last roundings.
const ROUND_UP: f64 = 1.0 + 8.0 / 16_777_216.0;

/// Upper bound of the squared `f32` distance computed for any face or box whose true distance is at
/// most `distance`.
#[expect(clippy::cast_possible_truncation, reason = "rounding is part of ROUND_UP; clamped to finite")]
pub(crate) fn squared_bound_f32(distance: f64, slack: f64) -> f32 {
    let reach = distance + slack;
    // Infinity would admit the empty slots of nodes.
    (reach * reach * ROUND_UP).min(f64::from(f32::MAX)) as f32
}

/// The most by which a distance found in `f32` exceeds the true one, seen from `reach` away from
/// the centre of a scene of that `radius`, in the unit of both.
pub(crate) fn slack(reach: f64, radius: f64) -> f64 {
    SLACK * (reach + radius)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bound_is_above_the_square_and_at_most_a_few_roundings_above_it() {
        for k in 0..400 {
            let distance = 1e-12 * 1.17_f64.powi(k);
            let exact = (distance + slack(1.0, 1.0)).powi(2);
            let bound = f64::from(squared_bound_f32(distance, slack(1.0, 1.0)));
            assert!(bound >= exact && bound <= exact * (1.0 + 1e-6), "{bound:e} for {exact:e}");
        }
    }

    #[test]
    fn without_a_distance_the_bound_is_the_largest_finite_number() {
        assert_eq!(squared_bound_f32(f64::INFINITY, 0.0), f32::MAX, "empty slots are infinitely far");
    }
}
