//! Boxes along the axes, rays, and the intersection of rays with boxes and triangles, in `f64` and without
//! gaps between triangles that share a side `(woop2013)`.

use glam::{DVec2, DVec3};

/// Bound of the rounding error of a coordinate of a box or of a ray, as a fraction of the largest: some
/// hundred roundings.
const ROUNDING: f64 = 1e-13;

/// Lower bounds of distances from boxes are reduced by this fraction of the distance and of the point's
/// distance from the origin: some hundred roundings.
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
    pub(crate) const EMPTY: Self = Self { lo: DVec3::INFINITY, hi: DVec3::NEG_INFINITY };

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
    pub fn touches(&self, other: &Self) -> bool {
        !(self.lo.cmpgt(other.hi).any() || other.lo.cmpgt(self.hi).any())
    }

    /// A lower bound of the distance from `q` to the box, rounding included.
    #[inline]
    pub fn least_distance(&self, q: DVec3) -> f64 {
        q.distance(q.clamp(self.lo, self.hi)) * (1.0 - MARGIN) - MARGIN * q.length()
    }

    /// A lower bound of the distance along a ray at which it enters the box; infinite if it does not enter it
    /// within `longest`.
    #[inline]
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

/// A ray from a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where it begins.
    pub origin: DVec3,
    /// Of unit length.
    pub direction: DVec3,
    /// Its length; infinite for a whole ray.
    pub longest: f64,
}

impl Ray {
    /// `None` if a number is not finite, the direction has no length, or `longest` is negative
    /// or not a number. The direction need not be of unit length.
    pub fn new(origin: DVec3, direction: DVec3, longest: f64) -> Option<Self> {
        let direction = unit(direction)?;
        (origin.is_finite() && longest >= 0.0).then_some(Self { origin, direction, longest })
    }

    /// The ray transformed by `point` and `vector`, which keep lengths.
    pub fn moved(&self, point: impl Fn(DVec3) -> DVec3, vector: impl Fn(DVec3) -> DVec3) -> Self {
        Self { origin: point(self.origin), direction: vector(self.direction).normalize_or_zero(), ..*self }
    }
}

/// A direction with length 1; `None` if it has no length or is not finite.
fn unit(direction: DVec3) -> Option<DVec3> {
    // Scaled first: the square of a very long or short direction is not a number.
    (direction / direction.abs().max_element()).try_normalize()
}

/// The intersection of a ray and a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Meeting {
    /// Distance from the origin, in lengths of the direction.
    pub along: f64,
    /// Barycentric coordinates in the triangle.
    pub barycentric: [f64; 3],
}

/// The intersection of the line from `origin` along `direction` with a triangle, sides and corners included,
/// in front of the origin or behind it; `None` also for a triangle that contains the direction.
///
/// The corners are sheared into a frame whose axis is the line. There the deciding signs are those of
/// products of two coordinates, which are the same for two triangles that share a side: a line through the
/// side meets at least one of them.
pub fn meet(origin: DVec3, direction: DVec3, corners: [DVec3; 3]) -> Option<Meeting> {
    let z = direction.abs().max_position();
    let (x, y) = ((z + 1) % 3, (z + 2) % 3);
    let (shear_x, shear_y) = (direction[x] / direction[z], direction[y] / direction[z]);
    let [a, b, c] = corners.map(|p| {
        let p = p - origin;
        [p[x] - shear_x * p[z], p[y] - shear_y * p[z], p[z]]
    });
    let weights = [c[0] * b[1] - c[1] * b[0], a[0] * c[1] - a[1] * c[0], b[0] * a[1] - b[1] * a[0]];
    if weights.iter().any(|&w| w < 0.0) && weights.iter().any(|&w| w > 0.0) {
        return None;
    }
    let sum: f64 = weights.iter().sum();
    // Adding 0 makes -0 the same.
    let barycentric = weights.map(|w| w / sum + 0.0);
    let along = (barycentric[0] * a[2] + barycentric[1] * b[2] + barycentric[2] * c[2]) / direction[z];
    // A sum of 0 (a triangle without area, or seen from its edge) makes them infinite or no number.
    (along.is_finite() && barycentric.iter().all(|w| w.is_finite())).then_some(Meeting { along, barycentric })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_ray_meets_inside_sides_and_corners_but_no_triangle_without_area() {
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        for (x, y, expected) in
            [(0.25, 0.25, true), (0.5, 0.0, true), (0.0, 0.0, true), (1.0, 0.0, true), (0.6, 0.6, false)]
        {
            let met = meet(DVec3::new(x, y, -2.0), DVec3::Z, triangle);
            assert_eq!(met.is_some_and(|m| m.along == 2.0), expected, "at {x}, {y}");
        }
        assert_eq!(meet(DVec3::new(0.5, 0.0, -2.0), DVec3::Z, [DVec3::ZERO, DVec3::X, DVec3::X]), None);
        assert_eq!(meet(-DVec3::X, DVec3::X, triangle), None, "seen from its edge");
    }

    #[test]
    fn invalid_rays_are_refused() {
        let ok = |origin, direction, longest| Ray::new(origin, direction, longest).is_some();
        assert!(ok(DVec3::ZERO, DVec3::X * 1e-300, f64::INFINITY) && ok(DVec3::ZERO, DVec3::X * 1e300, 0.0));
        for (origin, direction, longest) in [
            (DVec3::ZERO, DVec3::ZERO, 1.0),
            (DVec3::ZERO, DVec3::NAN, 1.0),
            (DVec3::ZERO, DVec3::INFINITY, 1.0),
            (DVec3::NAN, DVec3::X, 1.0),
            (DVec3::ZERO, DVec3::X, -1.0),
            (DVec3::ZERO, DVec3::X, f64::NAN),
        ] {
            assert!(!ok(origin, direction, longest), "{origin} {direction} {longest}");
        }
    }

    proptest! {
        #![proptest_config(crate::soup::fixed(2000, 22))]

        /// A ray at a point of the side that two triangles share meets one of them: no gap.
        #[test]
        fn there_is_no_gap_along_a_side(
            p in prop::array::uniform4(prop::array::uniform3(-1.0_f64..1.0)),
            origin in prop::array::uniform3(-2.0_f64..2.0),
            t in 0.0_f64..1.0,
        ) {
            let [a, b, c, d] = p.map(DVec3::from);
            let origin = DVec3::from(origin);
            let direction = (a.lerp(b, t) - origin).normalize();
            // The side lies between the two as seen along the ray, or the second is turned over it.
            let normal = (b - a).cross(direction);
            let [beside_c, beside_d] = [c, d].map(|p| (p - a).dot(normal));
            prop_assume!(beside_c.abs() > 1e-9 && beside_d.abs() > 1e-9);
            let d = if beside_c * beside_d < 0.0 { d } else { a + b - d };
            let meets = |corners| meet(origin, direction, corners).is_some();
            prop_assert!(meets([a, b, c]) || meets([b, a, d]));
        }
    }
}
