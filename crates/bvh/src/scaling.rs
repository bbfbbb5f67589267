//! [`Scaling`]: a frame in which coordinates are small enough for `f32`.

use glam::DVec3;

use crate::{Aabb, Ray};

/// From this many radii away a ray is first moved along itself, near the tree: the numbers that are
/// compared are then of the tree's size.
const FAR: f64 = 4.0;

/// Where the numbers of a tree are at most about 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scaling {
    /// The centre of the box around everything.
    pub(crate) origin: DVec3,
    /// What makes lengths into the units of the tree, in which the radius is between 1/2 and 1: a power
    /// of two, so that it rounds nothing.
    pub(crate) scale: f64,
    /// The box around everything.
    pub(crate) bounds: Aabb,
}

impl Scaling {
    /// For what lies in `bounds`, none of it farther than `radius` from their centre.
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

    /// A ray as it begins near the tree, and how far along it that is.
    pub(crate) fn nearby(&self, ray: &Ray) -> (Ray, f64) {
        let along = (self.origin - ray.origin).dot(ray.direction);
        let skipped = along - FAR / self.scale;
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
    /// `f64` has no powers of two beyond; a smaller tree is a point for every purpose.
    const LEAST_EXPONENT: f64 = -1000.0;
    if radius > 0.0 { (-(radius.log2().ceil().max(LEAST_EXPONENT))).exp2() } else { 1.0 }
}
