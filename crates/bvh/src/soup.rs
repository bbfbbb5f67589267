//! Random triangles for tests, with slivers, needles and points among them; and sheets.

use glam::{DVec2, DVec3};
use proptest::{prelude::*, test_runner::RngSeed};

/// A triangle with coordinates within 1; its third corner may be near a side, near a corner or on it, and its
/// first side along an axis or in a plane of them.
pub(crate) fn triangle() -> impl Strategy<Value = [DVec3; 3]> {
    let corner = || prop::array::uniform3(-1.0_f64..1.0).prop_map(DVec3::from);
    let flat = prop_oneof![3 => Just(1.0), 1 => Just(1e-3), 1 => Just(1e-7), 1 => Just(0.0)];
    let small = prop_oneof![4 => Just(1.0), 1 => Just(1e-4), 1 => Just(0.0)];
    let free = prop_oneof![2 => Just(DVec3::ONE), 1 => Just(DVec3::X), 1 => Just(DVec3::new(0.0, 1.0, 1.0))];
    let corners = (corner(), corner(), corner(), free);
    (corners, flat, small, prop::bool::ANY).prop_map(|((a, b, c, free), flat, small, needle)| {
        let b = a + (b - a) * free;
        let foot = if needle { a } else { a.lerp(b, 0.4) };
        [a, a + (b - a) * small, a + (foot + (c - foot) * flat - a) * small]
    })
}

/// This many triangles, then copies of the first of them, which are equally near.
pub(crate) fn triangles(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<[DVec3; 3]>> {
    let copies = prop_oneof![2 => Just(0_usize), 1 => 1..20_usize];
    (prop::collection::vec(triangle(), count), copies).prop_map(|(mut triangles, copies)| {
        let first = triangles.len();
        triangles.extend_from_within(..copies.min(first));
        triangles.extend_from_within(..copies.min(first) / 2);
        triangles
    })
}

/// The triangles of a sheet of squares of side 1, each cut in two, moved by `place`.
pub(crate) fn sheet(columns: u32, rows: u32, place: impl Fn(DVec2) -> DVec3) -> Vec<[DVec3; 3]> {
    let at = |i: u32, j: u32| place(DVec2::new(i.into(), j.into()));
    let square = |i: u32, j: u32| {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [[a, b, c], [a, c, d]]
    };
    (0..columns).flat_map(|i| (0..rows).flat_map(move |j| [(i, j)])).flat_map(|(i, j)| square(i, j)).collect()
}

/// Distance of `q` to a triangle: to its inside or to one of its sides.
pub(crate) fn distance(q: DVec3, corners: [DVec3; 3]) -> f64 {
    let to_side = |a: DVec3, b: DVec3| {
        let t = (q - a).dot(b - a) / (b - a).length_squared();
        // For a side of length 0, `t` is NaN.
        q.distance(a.lerp(b, if t > 0.0 { t.min(1.0) } else { 0.0 }))
    };
    let [a, b, c] = corners;
    let around = to_side(a, b).min(to_side(b, c)).min(to_side(c, a));
    let cross = (b - a).cross(c - a);
    let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
    if cross.length() <= 1e-9 * longest {
        return around; // a segment: its normal is noise
    }
    let normal = cross.normalize();
    let inner = |a: DVec3, b: DVec3| (b - a).cross(q - a).dot(normal) > 0.0;
    let is_above = inner(a, b) && inner(b, c) && inner(c, a);
    if is_above { (q - a).dot(normal).abs().min(around) } else { around }
}

/// The same `cases` in every run.
pub(crate) fn fixed(cases: u32, seed: u64) -> ProptestConfig {
    ProptestConfig { cases, rng_seed: RngSeed::Fixed(seed), failure_persistence: None, ..Default::default() }
}
