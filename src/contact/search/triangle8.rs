//! Eight triangles side by side, and their squared distances to a point in `f32`.

use glam::DVec3;
use wide::f32x8;

use super::lanes::{LANES, Wide3};
use crate::id::FaceId;

/// Sides shorter than this (in units of the patch's radius, squared) count as points; their inverse
/// would overflow.
const SHORTEST_SQUARED: f64 = 1e-30;

fn dot(a: &Wide3, b: &Wide3) -> f32x8 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Up to eight triangles, side by side.
///
/// Each is stored in a frame of its own: `x` along its longest side from `start`, `y` towards the
/// third corner, `z` normal. In that frame the triangle is `(0, 0), (base, 0), apex`, and the
/// distance to it needs no division and no product that cancels: whatever its shape, the error is a
/// few roundings of the coordinates.
#[derive(Debug, Clone, Copy)]
pub(super) struct Triangle8 {
    start: Wide3,
    x: Wide3,
    y: Wide3,
    z: Wide3,
    base: f32x8,
    apex: [f32x8; 2],
    /// Inverse squared lengths of the sides from the start and the end of the base to the apex; 0
    /// for a point.
    inverse: [f32x8; 2],
    pub(super) faces: [FaceId; LANES],
    /// One bit for each lane in use.
    pub(super) used: u32,
}

struct Framed {
    start: DVec3,
    axes: [DVec3; 3],
    base: f64,
    apex: [f64; 2],
}

impl Framed {
    fn new(corners: [DVec3; 3]) -> Self {
        let [a, b, c] = longest_side_first(corners);
        let x = (b - a).try_normalize().unwrap_or(DVec3::X);
        let across = (c - a).reject_from_normalized(x);
        // Once more: what the first rejection left along `x` matters in a sliver.
        let across = across.reject_from_normalized(x);
        let y = across.try_normalize().unwrap_or_else(|| x.any_orthonormal_vector());
        let y = y.reject_from_normalized(x).normalize_or(x.any_orthonormal_vector());
        let apex = [(c - a).dot(x), (c - a).dot(y).max(0.0)];
        Self { start: a, axes: [x, y, x.cross(y)], base: a.distance(b), apex }
    }
}

/// The corners in the same cyclic order, the first two being ends of the longest side.
fn longest_side_first([a, b, c]: [DVec3; 3]) -> [DVec3; 3] {
    let [ab, bc, ca] = [a.distance_squared(b), b.distance_squared(c), c.distance_squared(a)];
    if ab >= bc && ab >= ca {
        [a, b, c]
    } else if bc >= ca {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

#[expect(clippy::cast_possible_truncation, reason = "rounding is part of the search's slack")]
fn narrow(x: f64) -> f32 {
    x as f32
}

fn inverse_length_squared(x: f64, y: f64) -> f32 {
    let squared = x * x + y * y;
    if squared < SHORTEST_SQUARED { 0.0 } else { narrow(1.0 / squared) }
}

impl Triangle8 {
    /// A packet of the first eight of `triangles`, at least one: corners in units of the patch's
    /// radius.
    pub(super) fn new(triangles: &[(FaceId, [DVec3; 3])]) -> Self {
        let mut lanes = [[0.0_f32; LANES]; 17];
        let mut faces = [FaceId::default(); LANES];
        let mut used = 0;
        for (lane, &(face, corners)) in triangles.iter().take(LANES).enumerate() {
            let Framed { start, axes: [x, y, z], base, apex } = Framed::new(corners);
            let inverses =
                [inverse_length_squared(apex[0], apex[1]), inverse_length_squared(apex[0] - base, apex[1])];
            let columns = [start, x, y, z].into_iter().flat_map(|v| v.to_array());
            let columns = columns.chain([base, apex[0], apex[1]]).map(narrow).chain(inverses);
            for (row, value) in lanes.iter_mut().zip(columns) {
                row[lane] = value;
            }
            faces[lane] = face;
            used |= 1 << lane;
        }
        let row = |k: usize| f32x8::new(lanes[k]);
        let vector = |k: usize| [row(k), row(k + 1), row(k + 2)];
        Self {
            start: vector(0),
            x: vector(3),
            y: vector(6),
            z: vector(9),
            base: row(12),
            apex: [row(13), row(14)],
            inverse: [row(15), row(16)],
            faces,
            used,
        }
    }

    /// Squared distances of `q` to the triangles.
    ///
    /// Never more than the true distance by more than the search's slack. It may be less: a point
    /// beyond the tip of a needle can seem to lie inside.
    #[inline]
    pub(super) fn distance_squared(&self, q: &Wide3) -> f32x8 {
        let (zero, one) = (f32x8::ZERO, f32x8::ONE);
        let p = [q[0] - self.start[0], q[1] - self.start[1], q[2] - self.start[2]];
        let (x, y, z) = (dot(&p, &self.x), dot(&p, &self.y), dot(&p, &self.z));
        let [apex_x, apex_y] = self.apex;

        let beside = x - x.fast_max(zero).fast_min(self.base);
        let to_base = beside * beside + y * y;

        let t = ((x * apex_x + y * apex_y) * self.inverse[0]).fast_max(zero).fast_min(one);
        let (dx, dy) = (x - t * apex_x, y - t * apex_y);
        let to_left = dx * dx + dy * dy;

        let (from_end, side_x) = (x - self.base, apex_x - self.base);
        let t = ((from_end * side_x + y * apex_y) * self.inverse[1]).fast_max(zero).fast_min(one);
        let (dx, dy) = (from_end - t * side_x, y - t * apex_y);
        let to_right = dx * dx + dy * dy;

        let inside =
            y.simd_ge(zero) & (apex_x * y).simd_le(apex_y * x) & (side_x * y).simd_ge(apex_y * from_end);
        let sideways = to_base.fast_min(to_left).fast_min(to_right);
        z * z + (!inside & sideways)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{
        contact::{
            search::{
                lanes::splat,
                rounding::{slack, squared_bound_f32},
            },
            soup,
        },
        id::VertexId,
        mesh::closest_point,
    };

    fn packet(triangles: &[[DVec3; 3]]) -> Triangle8 {
        let numbered: Vec<_> = (0_u32..).map(FaceId::from).zip(triangles.iter().copied()).collect();
        Triangle8::new(&numbered)
    }

    fn distance(q: DVec3, corners: [DVec3; 3]) -> f64 {
        closest_point(q, corners, [0, 1, 2].map(VertexId::new)).squared.sqrt()
    }

    /// Coordinates that `f32` has exactly: above the inside, beside each side, beyond each corner.
    #[test]
    fn distances_to_a_right_triangle_are_exact() {
        let triangle = [DVec3::ZERO, DVec3::new(4.0, 0.0, 0.0), DVec3::new(0.0, 3.0, 0.0)];
        let packet = packet(&[triangle]);
        assert_eq!((packet.used, packet.faces[0]), (1, FaceId::from(0)));
        for (q, expected) in [
            (DVec3::new(1.0, 1.0, 2.0), 4.0),
            (DVec3::new(2.0, -1.0, 0.0), 1.0),
            (DVec3::new(-2.0, 1.0, 0.0), 4.0),
            (DVec3::new(-3.0, -4.0, 0.0), 25.0),
            (DVec3::new(7.0, 0.0, 4.0), 25.0),
            (DVec3::new(0.0, 5.0, 0.0), 4.0),
        ] {
            let found = f64::from(packet.distance_squared(&splat(q.as_vec3())).to_array()[0]);
            assert!((found - expected).abs() < 1e-5, "{found} instead of {expected} from {q}");
        }
    }

    proptest! {
        #![proptest_config(soup::fixed(2000, 9))]

        /// The promise of the slack: a triangle nearer than a bound never seems to be farther,
        /// whatever its shape.
        #[test]
        fn no_distance_is_overestimated_by_more_than_the_slack(
            triangles in prop::collection::vec(soup::triangle(), 1..=LANES),
            direction in prop::array::uniform3(-1.0_f64..1.0),
            away in prop_oneof![Just(0.0), Just(1e-6), Just(0.01), Just(1.0), Just(30.0), Just(900.0)],
        ) {
            // Units in which the radius is 1, as in a tree.
            let triangles: Vec<_> = triangles.iter().map(|t| t.map(|p| p * 0.5)).collect();
            let q = triangles[0][0] + DVec3::from(direction) * away;
            let found = packet(&triangles).distance_squared(&splat(q.as_vec3())).to_array();
            for (corners, found) in triangles.iter().zip(found) {
                let bound = squared_bound_f32(distance(q, *corners), slack(q.length(), 1.0));
                prop_assert!(found <= bound, "{found} above {bound} from {q} to {corners:?}");
            }
        }

        /// Only needles may seem nearer than they are; where the third corner is clear of the
        /// longest side the error is at most the slack in both directions.
        #[test]
        fn distances_to_well_shaped_triangles_are_within_the_slack(
            corners in prop::array::uniform3(prop::array::uniform3(-0.5_f64..0.5)),
            q in prop::array::uniform3(-2.0_f64..2.0),
        ) {
            let corners = corners.map(DVec3::from);
            let [a, b, c] = corners;
            let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
            prop_assume!((b - a).cross(c - a).length() > 0.1 * longest && longest > 0.01);
            let q = DVec3::from(q);
            let found = f64::from(packet(&[corners]).distance_squared(&splat(q.as_vec3())).to_array()[0]).sqrt();
            let error = (found - distance(q, corners)).abs();
            prop_assert!(error <= slack(q.length(), 1.0), "off by {error:e}");
        }
    }
}
