//! Spheres, capsules and boxes, and their distances to points and triangles, in `f64`.

use glam::{DQuat, DVec3};

use super::segment::{closest, segment_to_segment, segment_to_triangle};

/// All points within a radius of a core: a point (sphere), a segment (capsule) or a box.
///
/// Distances are those to the core: 0 inside it, at most the radius inside the volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::contact) struct Volume {
    /// Centre of the core, in m.
    pub(in crate::contact) centre: DVec3,
    /// Unit vectors at right angles, along the sides of the core.
    axes: [DVec3; 3],
    /// Half the core's sides, in m: all zero for a sphere, all but one for a capsule.
    half: DVec3,
    /// In m.
    pub(in crate::contact) radius: f64,
}

/// Cut points of a triangle that lie this far outside of a face count as on it, in roundings of the
/// coordinates: a flat box is as thick as the rounding.
const ON_FACE: f64 = 16.0 * f64::EPSILON;

impl Volume {
    /// A sphere. `None` if a number is not finite or the radius (m) is negative.
    pub(in crate::contact) fn sphere(centre: DVec3, radius: f64) -> Option<Self> {
        Self { centre, axes: DVec3::AXES, half: DVec3::ZERO, radius }.checked()
    }

    /// A capsule around the segment between two points. `None` if a number is not finite or the
    /// radius (m) is negative.
    pub(in crate::contact) fn capsule([from, to]: [DVec3; 2], radius: f64) -> Option<Self> {
        let x = (to - from).normalize_or(DVec3::X);
        let (y, z) = x.any_orthonormal_pair();
        let half = DVec3::X * (0.5 * from.distance(to));
        Self { centre: from.midpoint(to), axes: [x, y, z], half, radius }.checked()
    }

    /// A box, turned by `turn`, of the given half sides (m). `None` if a number is not finite, a
    /// side is negative, or `turn` is not a rotation.
    pub(in crate::contact) fn cuboid(centre: DVec3, turn: DQuat, half: DVec3) -> Option<Self> {
        /// A rotation read from a file has rounded numbers.
        const UNIT: f64 = 1e-3;
        if !((turn.length() - 1.0).abs() <= UNIT && half.cmpge(DVec3::ZERO).all()) {
            return None;
        }
        let axes = DVec3::AXES.map(|axis| turn.normalize() * axis);
        Self { centre, axes, half, radius: 0.0 }.checked()
    }

    fn checked(self) -> Option<Self> {
        let finite = self.centre.is_finite() && self.half.is_finite() && self.radius.is_finite();
        (finite && self.radius >= 0.0).then_some(self)
    }

    /// The same volume in another frame, by the way of its points and of its directions, which must
    /// keep lengths and angles.
    pub(in crate::contact) fn moved(
        &self,
        point: impl Fn(DVec3) -> DVec3,
        vector: impl Fn(DVec3) -> DVec3,
    ) -> Self {
        Self { centre: point(self.centre), axes: self.axes.map(vector), ..*self }
    }

    /// From the centre to the faces of the core, in m.
    pub(in crate::contact) fn sides(&self) -> [DVec3; 3] {
        [self.axes[0] * self.half.x, self.axes[1] * self.half.y, self.axes[2] * self.half.z]
    }

    /// Distance of a point from the core, in m.
    pub(in crate::contact) fn distance_to_point(&self, p: DVec3) -> f64 {
        let offset = p - self.centre;
        let along = DVec3::from(self.axes.map(|axis| offset.dot(axis)));
        if self.half == DVec3::ZERO {
            offset.length()
        } else {
            (along.abs() - self.half).max(DVec3::ZERO).length()
        }
    }

    /// Distance of a triangle from the core, in m; 0 where they touch.
    pub(in crate::contact) fn distance_to_triangle(&self, corners: [DVec3; 3]) -> f64 {
        let sides = self.sides();
        let mut long = sides.into_iter().filter(|&side| side != DVec3::ZERO);
        match (long.next(), long.next()) {
            (None, _) => closest(self.centre, corners).squared.sqrt(),
            (Some(side), None) => {
                segment_to_triangle([self.centre - side, self.centre + side], corners).sqrt()
            }
            _ if self.overlaps(corners) => 0.0,
            _ => self.distance_of_features(sides, corners),
        }
    }

    /// Distance of a triangle outside of a box: one of a corner and a face, or of two edges.
    fn distance_of_features(&self, [x, y, z]: [DVec3; 3], corners: [DVec3; 3]) -> f64 {
        let corner = |k: usize| {
            let sign = |bit: usize| if k >> bit & 1 == 0 { -1.0 } else { 1.0 };
            self.centre + x * sign(0) + y * sign(1) + z * sign(2)
        };
        let mut nearest = corners.iter().map(|&p| self.distance_to_point(p)).fold(f64::INFINITY, f64::min);
        for k in 0..8 {
            nearest = nearest.min(closest(corner(k), corners).squared.sqrt());
            for other in [1, 2, 4].map(|bit| k | bit).into_iter().filter(|&other| other != k) {
                for side in 0..3 {
                    let side = [corners[side], corners[(side + 1) % 3]];
                    nearest = nearest.min(segment_to_segment([corner(k), corner(other)], side).sqrt());
                }
            }
        }
        nearest
    }

    /// Whether a part of the triangle is inside the box: the triangle is cut off at one face after
    /// the other.
    fn overlaps(&self, corners: [DVec3; 3]) -> bool {
        /// Three corners, and one more for each of six cuts.
        const MOST: usize = 9;
        let offsets = corners.map(|p| p - self.centre);
        let largest = offsets.iter().map(|p| p.length()).fold(self.half.length(), f64::max);
        let (mut polygon, mut len) = ([DVec3::ZERO; MOST], 3);
        polygon[..3].copy_from_slice(&offsets);
        for face in 0..6 {
            let outward = if face < 3 { self.axes[face] } else { -self.axes[face - 3] };
            let above = |p: DVec3| p.dot(outward) - self.half[face % 3];
            let (mut kept, mut count) = ([DVec3::ZERO; MOST], 0);
            let mut keep = |p| {
                if count < MOST {
                    kept[count] = p;
                    count += 1;
                }
            };
            for k in 0..len {
                let (p, next) = (polygon[k], polygon[(k + 1) % len]);
                let (here, there) = (above(p), above(next));
                if here <= ON_FACE * largest {
                    keep(p);
                }
                if (here < 0.0 && there > 0.0) || (here > 0.0 && there < 0.0) {
                    keep(p.lerp(next, here / (here - there)));
                }
            }
            (polygon, len) = (kept, count);
        }
        len > 0
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::contact::soup;

    #[test]
    fn volumes_that_are_none_are_refused() {
        assert!(Volume::sphere(DVec3::ZERO, -1.0).is_none() && Volume::sphere(DVec3::NAN, 1.0).is_none());
        assert!(
            Volume::sphere(DVec3::ZERO, f64::NAN).is_none() && Volume::sphere(DVec3::ZERO, 0.0).is_some()
        );
        assert!(Volume::capsule([DVec3::ZERO, DVec3::INFINITY], 1.0).is_none());
        assert!(Volume::cuboid(DVec3::ZERO, DQuat::IDENTITY, -DVec3::X).is_none());
        assert!(Volume::cuboid(DVec3::ZERO, DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), DVec3::ONE).is_none());
    }

    #[test]
    fn a_box_around_a_triangle_or_cut_by_it_is_at_distance_zero() {
        let cube = Volume::cuboid(DVec3::ZERO, DQuat::from_rotation_z(0.3), DVec3::ONE).unwrap();
        let small = [DVec3::ZERO, DVec3::X * 0.1, DVec3::Y * 0.1];
        let large = [DVec3::new(-90.0, -50.0, 0.5), DVec3::new(90.0, -50.0, 0.5), DVec3::new(0.0, 90.0, 0.5)];
        assert_eq!([small, large].map(|t| cube.distance_to_triangle(t)), [0.0; 2]);
        let above = large.map(|p| p + DVec3::Z * 2.0);
        assert!((cube.distance_to_triangle(above) - 1.5).abs() < 1e-14);
    }

    proptest! {
        #![proptest_config(soup::fixed(300, 23))]

        /// No sample of the triangle is nearer to the core, and a fine sampling comes as near.
        #[test]
        fn no_point_of_the_triangle_is_nearer(
            corners in soup::triangle(),
            centre in prop::array::uniform3(-1.5_f64..1.5),
            turn in prop::array::uniform3(-3.0_f64..3.0),
            half in prop::array::uniform3(prop_oneof![3 => 0.0_f64..0.5, 1 => Just(0.0)]),
        ) {
            const STEPS: u32 = 40;
            let turn = DQuat::from_scaled_axis(DVec3::from(turn));
            let volume = Volume::cuboid(DVec3::from(centre), turn, DVec3::from(half)).unwrap();
            let found = volume.distance_to_triangle(corners);
            let [a, b, c] = corners;
            let mut sampled = f64::INFINITY;
            for (i, j) in (0..=STEPS).flat_map(|i| (0..=STEPS - i).map(move |j| (i, j))) {
                let [u, v] = [i, j].map(|k| f64::from(k) / f64::from(STEPS));
                sampled = sampled.min(volume.distance_to_point(a + (b - a) * u + (c - a) * v));
            }
            let step = 2.0 * (a.distance(b) + a.distance(c)) / f64::from(STEPS);
            prop_assert!(sampled >= found - 1e-7 && sampled <= found + step + 1e-12, "{found} but {sampled} by samples");
        }
    }
}
