//! The frame of a tree: its origin in the middle of the patch, its unit about the patch's radius.

use glam::DVec3;

use crate::bvh::{Aabb, Ray};

/// From this many radii away a ray is first moved along itself, near the tree: the numbers that are
/// compared are then of the tree's size.
const FAR: f64 = 4.0;

/// Where a tree's numbers are small enough for `f32`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Frame {
    /// Centre of the patch's box, in m.
    pub(super) origin: DVec3,
    /// What makes metres into the units of the tree, in which the patch's radius is between 1/2 and
    /// 1: a power of two, so that it rounds nothing.
    pub(super) scale: f64,
    /// The box of the patch, in m.
    pub(super) bounds: Aabb,
}

impl Frame {
    /// A frame for finite points.
    pub(super) fn around(points: impl Iterator<Item = DVec3> + Clone) -> Self {
        let bounds = Aabb::around(points.clone());
        let origin = if bounds == Aabb::EMPTY { DVec3::ZERO } else { bounds.lo.midpoint(bounds.hi) };
        let radius = points.map(|p| p.distance_squared(origin)).fold(0.0, f64::max).sqrt();
        Self { origin, scale: unit_scale(radius), bounds }
    }

    pub(super) fn point(&self, p: DVec3) -> DVec3 {
        (p - self.origin) * self.scale
    }

    /// A ray as it begins near the tree, and how far along it that is, in m.
    pub(super) fn nearby(&self, ray: &Ray) -> (Ray, f64) {
        let along = (self.origin - ray.origin).dot(ray.direction);
        let skipped = along - FAR * self.radius();
        if skipped <= 0.0 {
            return (*ray, 0.0);
        }
        let origin = ray.origin + ray.direction * skipped;
        (Ray { origin, longest: ray.longest - skipped, ..*ray }, (origin - ray.origin).length())
    }

    pub(super) fn ray(&self, ray: &Ray) -> Ray {
        Ray { origin: self.point(ray.origin), longest: ray.longest * self.scale, ..*ray }
    }

    /// Upper bound of the distance of a point of the patch from the origin, in m.
    pub(super) fn radius(&self) -> f64 {
        1.0 / self.scale
    }
}

/// The power of two that brings `radius` between 1/2 and 1; 1 for a point.
fn unit_scale(radius: f64) -> f64 {
    /// `f64` has no powers of two beyond; a smaller patch is a point for every purpose.
    const LEAST_EXPONENT: f64 = -1000.0;
    if radius > 0.0 { (-(radius.log2().ceil().max(LEAST_EXPONENT))).exp2() } else { 1.0 }
}
