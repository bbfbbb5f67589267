//! Eight triangles or points side by side, and their squared distances to a point in `f32`.

use glam::DVec3;

use crate::lanes::{Kernel, LANES, Lanes};
use crate::tree::Points;

/// Sides shorter than this (in the tree's units, squared) count as points: nothing is divided by
/// zero.
const SHORTEST_SQUARED: f32 = 1e-30;

/// A third corner nearer than this to the line through the others, as a fraction of its distance from their
/// start (squared), lies on that line: the direction across the line is rounding noise then, and may even be
/// along it.
const FLATTEST_SQUARED: f32 = f32::EPSILON * f32::EPSILON;

/// Up to eight triangles, side by side, in 384 bytes; empty lanes repeat the last one.
///
/// Each is stored in a frame of its own: `x` along its longest side from `start`, `y` towards the third
/// corner, `z` normal. In that frame the triangle is `(0, 0), (base, 0), apex`, and the distance to it needs
/// no product that cancels: for every shape the error is a few roundings of the coordinates.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C, align(64))]
pub(crate) struct Triangle8 {
    /// Start, `x`, `y` (three rows each), base and apex (two rows).
    rows: [[f32; LANES]; 12],
}

impl Triangle8 {
    /// Squared distances of `q` to the triangles, wrong by less than the search's slack.
    #[inline(always)]
    pub(crate) fn distance_squared<L: Lanes>(&self, l: L, q: [f32; 3]) -> L::F {
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

/// Sets eight triangles by their corners, in the tree's units: the sum of their [normals](Normals). Rounding
/// of their frames moves their corners by a few units of the coordinates, however thin they are.
pub(crate) struct Framing<'a>(pub(crate) &'a Points<3>, pub(crate) &'a mut Triangle8);

impl Kernel for Framing<'_> {
    type Output = DVec3;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> DVec3 {
        let Self(corners, Triangle8 { rows }) = self;
        let (zero, one, shortest) = (l.splat(0.0), l.splat(1.0), l.splat(SHORTEST_SQUARED));
        let always = (zero, zero);
        let (a, b, c) = (load(l, &corners[0]), load(l, &corners[1]), load(l, &corners[2]));
        let (ab, bc, ca) = (minus(l, &b, &a), minus(l, &c, &b), minus(l, &a, &c));
        let (ab, bc, ca) = (dot(l, &ab, &ab), dot(l, &bc, &bc), dot(l, &ca, &ca));
        // The corners in the same cyclic order, the longest side first.
        let (is_ab, is_bc) = ([(bc, ab), (ca, ab), always, always], [(ca, bc), always, always, always]);
        let start = select(l, is_ab, &a, &select(l, is_bc, &b, &c));
        let end = select(l, is_ab, &b, &select(l, is_bc, &c, &a));
        let apex = select(l, is_ab, &c, &select(l, is_bc, &a, &b));

        let (side, third) = (minus(l, &end, &start), minus(l, &apex, &start));
        let squared = dot(l, &side, &side);
        let base = l.sqrt(squared);
        let unit = scaled(l, &side, l.div(one, l.max(base, l.sqrt(shortest))));
        let x = select(l, [(shortest, squared), always, always, always], &unit, &[one, zero, zero]);
        // Twice: in a sliver the first rejection leaves too much along `x`.
        let across = reject(l, &reject(l, &third, &x), &x);
        let height = dot(l, &across, &across);
        let unit = scaled(l, &across, l.div(one, l.sqrt(l.max(height, shortest))));
        let flattest = l.mul(l.splat(FLATTEST_SQUARED), dot(l, &third, &third));
        let is_raised = [(shortest, height), (flattest, height), always, always];
        let y = select(l, is_raised, &unit, &any_across(l, &x));
        let y = reject(l, &y, &x);
        let y = scaled(l, &y, l.div(one, l.sqrt(dot(l, &y, &y))));
        put(l, rows, 0, &start);
        put(l, rows, 3, &x);
        put(l, rows, 6, &y);
        put(l, rows, 9, &[base, dot(l, &third, &x), l.max(dot(l, &third, &y), zero)]);
        Normals(corners).run(l)
    }
}

/// The sum of the normals of eight triangles, each twice as long as its area.
pub(crate) struct Normals<'a>(pub(crate) &'a Points<3>);

impl Kernel for Normals<'_> {
    type Output = DVec3;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> DVec3 {
        let (a, b, c) = (load(l, &self.0[0]), load(l, &self.0[1]), load(l, &self.0[2]));
        let normals = cross(l, &minus(l, &b, &a), &minus(l, &c, &a));
        let mut sum = DVec3::ZERO;
        for k in 0..3 {
            let [a, b, c, d, e, f, g, h] = l.store(normals[k]);
            sum[k] = f64::from(((a + e) + (b + f)) + ((c + g) + (d + h)));
        }
        sum
    }
}

#[inline(always)]
fn load<L: Lanes>(l: L, point: &[[f32; LANES]; 3]) -> [L::F; 3] {
    [l.load(&point[0]), l.load(&point[1]), l.load(&point[2])]
}

#[inline(always)]
fn put<L: Lanes>(l: L, rows: &mut [[f32; LANES]; 12], first: usize, v: &[L::F; 3]) {
    for k in 0..3 {
        rows[first + k] = l.store(v[k]);
    }
}

#[inline(always)]
fn minus<L: Lanes>(l: L, a: &[L::F; 3], b: &[L::F; 3]) -> [L::F; 3] {
    [l.sub(a[0], b[0]), l.sub(a[1], b[1]), l.sub(a[2], b[2])]
}

#[inline(always)]
fn scaled<L: Lanes>(l: L, a: &[L::F; 3], by: L::F) -> [L::F; 3] {
    [l.mul(a[0], by), l.mul(a[1], by), l.mul(a[2], by)]
}

/// `yes` where all four numbers are not above their partners, else `no`.
#[inline(always)]
fn select<L: Lanes>(l: L, le: [(L::F, L::F); 4], yes: &[L::F; 3], no: &[L::F; 3]) -> [L::F; 3] {
    [l.select(le, yes[0], no[0]), l.select(le, yes[1], no[1]), l.select(le, yes[2], no[2])]
}

/// The component of `v` across the unit vector `x`.
#[inline(always)]
fn reject<L: Lanes>(l: L, v: &[L::F; 3], x: &[L::F; 3]) -> [L::F; 3] {
    let along = dot(l, v, x);
    [l.sub_mul(v[0], x[0], along), l.sub_mul(v[1], x[1], along), l.sub_mul(v[2], x[2], along)]
}

/// A unit vector at right angles to the unit vector `x`.
#[inline(always)]
fn any_across<L: Lanes>(l: L, x: &[L::F; 3]) -> [L::F; 3] {
    let (zero, one) = (l.splat(0.0), l.splat(1.0));
    let sign = l.select([(zero, x[2]), (zero, zero), (zero, zero), (zero, zero)], one, l.splat(-1.0));
    let per = l.div(l.splat(-1.0), l.add(sign, x[2]));
    [l.mul(l.mul(x[0], x[1]), per), l.mul_add(l.mul(x[1], x[1]), per, sign), l.sub(zero, x[1])]
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

/// Up to eight points, side by side; empty lanes repeat the last one.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Point8 {
    /// One row for each coordinate.
    rows: [[f32; LANES]; 3],
}

impl Point8 {
    #[expect(clippy::cast_possible_truncation, reason = "rounding is part of the search's slack")]
    pub(crate) fn new(points: &[DVec3; LANES]) -> Self {
        Self { rows: [0, 1, 2].map(|k: usize| points.map(|p| p[k] as f32)) }
    }

    /// Squared distances of `q` to the points, wrong by less than the search's slack.
    #[inline(always)]
    pub(crate) fn distance_squared<L: Lanes>(&self, l: L, q: [f32; 3]) -> L::F {
        let x = l.sub(l.splat(q[0]), l.load(&self.rows[0]));
        let y = l.sub(l.splat(q[1]), l.load(&self.rows[1]));
        let z = l.sub(l.splat(q[2]), l.load(&self.rows[2]));
        l.mul_add(x, x, l.mul_add(y, y, l.mul(z, z)))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::lanes::{Plain, Simd};
    use crate::scaling::slack;
    use crate::soup::{self, distance};
    use crate::tree;

    struct Distances<'a>(&'a Triangle8, DVec3);

    impl Kernel for Distances<'_> {
        type Output = [f32; LANES];

        fn run<L: Lanes>(self, l: L) -> [f32; LANES] {
            l.store(self.0.distance_squared(l, self.1.as_vec3().to_array()))
        }
    }

    /// Distances to the triangles, computed by both back-ends.
    fn distances(triangles: &[[DVec3; 3]], q: DVec3) -> [[f32; LANES]; 2] {
        let mut corners = [[[0.0; LANES]; 3]; 3];
        (0..LANES).for_each(|lane| tree::put(&mut corners, lane, triangles[lane.min(triangles.len() - 1)]));
        let mut packet = Triangle8::default();
        Simd::detect().run(Framing(&corners, &mut packet));
        let squared = [Distances(&packet, q).run(Plain), Simd::detect().run(Distances(&packet, q))];
        squared.map(|row| row.map(f32::sqrt))
    }

    /// Coordinates that are exact in `f32`: above the inside, next to each side, beyond each corner.
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

    /// A collinear corner on a side along an axis: its direction across the side is rounding noise.
    #[test]
    fn a_face_without_area_is_a_segment() {
        let triangle = [-0.368_160_25, 0.635_239_7, 0.0792].map(|x| DVec3::new(x, -0.0025, 0.0));
        for k in 0..1000 {
            let shift = DVec3::X * f64::from(k) * 1e-4;
            let triangle = triangle.map(|p| p * (0.5 + f64::from(k) * 5e-4) + shift);
            let q = DVec3::new(0.2, 0.4, 0.1);
            for found in distances(&[triangle], q).map(|row| f64::from(row[0])) {
                let expected = distance(q, triangle);
                assert!(
                    (found - expected).abs() < slack(1.0, 1.0),
                    "{found}, not {expected}, from {triangle:?}"
                );
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
