//! Eight triangles side by side, and their squared distances to a point in `f32`.

use glam::DVec3;

use super::{
    fit::Points,
    lanes::{Kernel, LANES, Lanes, Simd},
};

/// Sides shorter than this (in the tree's units, squared) count as points: nothing is divided by
/// zero.
const SHORTEST_SQUARED: f32 = 1e-30;

/// Lengths below this (in the tree's units) have no direction.
const SHORTEST: f64 = 1e-100;

/// Up to eight triangles, side by side, in 384 bytes; empty lanes repeat the last one.
///
/// Each is stored in a frame of its own: `x` along its longest side from `start`, `y` towards the
/// third corner, `z` normal. In that frame the triangle is `(0, 0), (base, 0), apex`, and the
/// distance to it needs no product that cancels: whatever its shape, the error is a few roundings of
/// the coordinates.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C, align(64))]
pub(super) struct Triangle8 {
    /// Start, `x`, `y` (three rows each), base and apex (two rows).
    rows: [[f32; LANES]; 12],
}

impl Triangle8 {
    /// Sets eight triangles by their corners, in the tree's units.
    pub(super) fn set(&mut self, simd: Simd, corners: &Points<3>) {
        simd.run(Framing(corners, &mut self.rows));
    }

    /// Squared distances of `q` to the triangles, wrong by less than the search's slack.
    #[inline(always)]
    pub(super) fn distance_squared<L: Lanes>(&self, l: L, q: [f32; 3]) -> L::F {
        let (r, zero) = (&self.rows, l.splat(0.0));
        let p = [
            l.sub(l.splat(q[0]), l.load(&r[0])),
            l.sub(l.splat(q[1]), l.load(&r[1])),
            l.sub(l.splat(q[2]), l.load(&r[2])),
        ];
        let along_x = [l.load(&r[3]), l.load(&r[4]), l.load(&r[5])];
        let along_y = [l.load(&r[6]), l.load(&r[7]), l.load(&r[8])];
        let along_z = cross(l, &along_x, &along_y);
        let (x, y, z) = (dot(l, &p, &along_x), dot(l, &p, &along_y), dot(l, &p, &along_z));
        let (base, apex_x, apex_y) = (l.load(&r[9]), l.load(&r[10]), l.load(&r[11]));

        let beside = l.sub(x, l.min(l.max(x, zero), base));
        let to_base = l.mul_add(beside, beside, l.mul(y, y));
        let (from_end, side_x) = (l.sub(x, base), l.sub(apex_x, base));
        let to_left = to_side(l, [x, y], [apex_x, apex_y]);
        let to_right = to_side(l, [from_end, y], [side_x, apex_y]);
        let around = l.min(l.min(to_base, to_left), to_right);

        // Above the triangle. Without the first condition a point beyond the tip of a needle could
        // seem to be inside.
        let inside = [
            (l.max(beside, l.sub(zero, beside)), zero),
            (zero, y),
            (l.mul(apex_x, y), l.mul(apex_y, x)),
            (l.mul(apex_y, from_end), l.mul(side_x, y)),
        ];
        let squared = l.mul(z, z);
        l.select(inside, squared, l.mul_add(z, z, around))
    }
}

#[inline(always)]
fn corner(point: &[[f64; LANES]; 3], lane: usize) -> DVec3 {
    DVec3::new(point[0][lane], point[1][lane], point[2][lane])
}

/// The corners in the same cyclic order, the first two being ends of the longest side.
#[inline(always)]
fn longest_side_first(a: DVec3, b: DVec3, c: DVec3) -> (DVec3, DVec3, DVec3) {
    let (ab, bc, ca) = (a.distance_squared(b), b.distance_squared(c), c.distance_squared(a));
    if ab >= bc && ab >= ca {
        (a, b, c)
    } else if bc >= ca {
        (b, c, a)
    } else {
        (c, a, b)
    }
}

/// `v` without its part along the unit vector `x`.
#[inline(always)]
fn reject(v: DVec3, x: DVec3) -> DVec3 {
    v - x * v.dot(x)
}

#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "rounding is part of the search's slack")]
fn put(rows: &mut [[f32; LANES]; 12], first: usize, lane: usize, v: DVec3) {
    rows[first][lane] = v.x as f32;
    rows[first + 1][lane] = v.y as f32;
    rows[first + 2][lane] = v.z as f32;
}

/// The frames of eight triangles, side by side: without a branch, so that the compiler may compute
/// several at a time.
struct Framing<'a>(&'a Points<3>, &'a mut [[f32; LANES]; 12]);

impl Kernel for Framing<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        let Self(corners, rows) = self;
        for lane in 0..LANES {
            let (a, b, c) = longest_side_first(
                corner(&corners[0], lane),
                corner(&corners[1], lane),
                corner(&corners[2], lane),
            );
            let (side, base) = (b - a, a.distance(b));
            let x = if base > SHORTEST { side * (1.0 / base) } else { DVec3::X };
            // Twice: what the first rejection left along `x` matters in a sliver.
            let across = reject(reject(c - a, x), x);
            let height = across.length();
            let y = if height > SHORTEST { across * (1.0 / height) } else { x.any_orthonormal_vector() };
            let y = reject(y, x);
            let y = y * (1.0 / y.length());
            let apex_x = (c - a).dot(x);
            let apex_y = (c - a).dot(y);
            let apex_y = if apex_y > 0.0 { apex_y } else { 0.0 };
            put(rows, 0, lane, a);
            put(rows, 3, lane, x);
            put(rows, 6, lane, y);
            put(rows, 9, lane, DVec3::new(base, apex_x, apex_y));
        }
    }
}

#[inline(always)]
fn dot<L: Lanes>(l: L, a: &[L::F; 3], b: &[L::F; 3]) -> L::F {
    l.mul_add(a[0], b[0], l.mul_add(a[1], b[1], l.mul(a[2], b[2])))
}

#[inline(always)]
fn cross<L: Lanes>(l: L, a: &[L::F; 3], b: &[L::F; 3]) -> [L::F; 3] {
    [
        l.sub_mul(l.mul(a[1], b[2]), a[2], b[1]),
        l.sub_mul(l.mul(a[2], b[0]), a[0], b[2]),
        l.sub_mul(l.mul(a[0], b[1]), a[1], b[0]),
    ]
}

/// Squared distance of `p` to the side from the origin to `end`, in the plane.
#[inline(always)]
fn to_side<L: Lanes>(l: L, [x, y]: [L::F; 2], [end_x, end_y]: [L::F; 2]) -> L::F {
    let length = l.mul_add(end_x, end_x, l.mul(end_y, end_y));
    let t = l.div(l.mul_add(x, end_x, l.mul(y, end_y)), l.max(length, l.splat(SHORTEST_SQUARED)));
    let t = l.min(l.max(t, l.splat(0.0)), l.splat(1.0));
    let (dx, dy) = (l.sub_mul(x, t, end_x), l.sub_mul(y, t, end_y));
    l.mul_add(dx, dx, l.mul(dy, dy))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{
        contact::{
            search::{fit, lanes::Plain, rounding::slack},
            soup,
        },
        id::VertexId,
        mesh::closest_point,
    };

    struct Distances<'a>(&'a Triangle8, DVec3);

    impl Kernel for Distances<'_> {
        type Output = [f32; LANES];

        fn run<L: Lanes>(self, l: L) -> [f32; LANES] {
            l.store(self.0.distance_squared(l, self.1.as_vec3().to_array()))
        }
    }

    /// Distances to the triangles, computed in both ways.
    fn distances(triangles: &[[DVec3; 3]], q: DVec3) -> [[f32; LANES]; 2] {
        let mut corners = [[[0.0; LANES]; 3]; 3];
        (0..LANES).for_each(|lane| fit::put(&mut corners, lane, triangles[lane.min(triangles.len() - 1)]));
        let mut packet = Triangle8::default();
        packet.set(Simd::detect(), &corners);
        let squared = [Distances(&packet, q).run(Plain), Simd::detect().run(Distances(&packet, q))];
        squared.map(|row| row.map(f32::sqrt))
    }

    fn distance(q: DVec3, corners: [DVec3; 3]) -> f64 {
        closest_point(q, corners, [0, 1, 2].map(VertexId::new)).squared.sqrt()
    }

    /// Coordinates that `f32` has exactly: above the inside, beside each side, beyond each corner.
    #[test]
    fn distances_to_a_right_triangle_are_exact() {
        let triangle = [DVec3::ZERO, DVec3::new(4.0, 0.0, 0.0), DVec3::new(0.0, 3.0, 0.0)];
        for (q, expected) in [
            (DVec3::new(1.0, 1.0, 2.0), 4.0),
            (DVec3::new(2.0, -1.0, 0.0), 1.0),
            (DVec3::new(-2.0, 1.0, 0.0), 4.0),
            (DVec3::new(-3.0, -4.0, 0.0), 25.0),
            (DVec3::new(7.0, 0.0, 4.0), 25.0),
            (DVec3::new(0.0, 5.0, 0.0), 4.0),
        ] {
            for found in distances(&[triangle], q).map(|row| f64::from(row[7]).powi(2)) {
                assert!((found - expected).abs() < 1e-5, "{found} instead of {expected} from {q}");
            }
        }
    }

    proptest! {
        #![proptest_config(soup::fixed(2000, 9))]

        /// The promise of the slack: whatever the shape of a triangle, the distance found is neither
        /// larger nor smaller than the true one by more.
        #[test]
        fn distances_are_within_the_slack(
            triangles in prop::collection::vec(soup::triangle(), 1..=LANES),
            direction in prop::array::uniform3(-1.0_f64..1.0),
            away in prop_oneof![Just(0.0), Just(1e-6), Just(0.01), Just(1.0), Just(30.0), Just(900.0)],
        ) {
            // Units in which the radius is 1, as in a tree.
            let triangles: Vec<_> = triangles.iter().map(|t| t.map(|p| p * 0.5)).collect();
            let q = triangles[0][0] + DVec3::from(direction) * away;
            for row in distances(&triangles, q) {
                for (corners, found) in triangles.iter().zip(row) {
                    let error = f64::from(found) - distance(q, *corners);
                    prop_assert!(error.abs() <= slack(q.length(), 1.0), "{error:e} from {q} to {corners:?}");
                }
            }
        }
    }
}
