//! Triangles without any order, for tests: slivers, needles and points among them.

use glam::DVec3;
use proptest::{prelude::*, test_runner::RngSeed};

use crate::mesh::TriMesh;

/// A triangle with coordinates within 1; its third corner may be near a side, near a corner or on
/// it.
pub(crate) fn triangle() -> impl Strategy<Value = [DVec3; 3]> {
    let corner = || prop::array::uniform3(-1.0_f64..1.0).prop_map(DVec3::from);
    let flat = prop_oneof![3 => Just(1.0), 1 => Just(1e-3), 1 => Just(1e-7), 1 => Just(0.0)];
    let small = prop_oneof![4 => Just(1.0), 1 => Just(1e-4), 1 => Just(0.0)];
    (corner(), corner(), corner(), flat, small, prop::bool::ANY).prop_map(|(a, b, c, flat, small, needle)| {
        let foot = if needle { a } else { a.lerp(b, 0.4) };
        [a, a + (b - a) * small, a + (foot + (c - foot) * flat - a) * small]
    })
}

/// As many triangles, and then copies of the first of them: equally near ones.
pub(crate) fn triangles(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<[DVec3; 3]>> {
    let copies = prop_oneof![2 => Just(0_usize), 1 => 1..20_usize];
    (prop::collection::vec(triangle(), count), copies).prop_map(|(mut triangles, copies)| {
        let first = triangles.len();
        triangles.extend_from_within(..copies.min(first));
        triangles.extend_from_within(..copies.min(first) / 2);
        triangles
    })
}

/// The triangles as a mesh, no two of which share a vertex.
pub(crate) fn mesh(triangles: &[[DVec3; 3]]) -> TriMesh {
    let corners: Vec<_> = (0_u32..).take(triangles.len()).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    TriMesh::from_arrays(triangles.iter().flatten().copied().collect(), &corners)
}

/// The same `cases` in every run.
pub(crate) fn fixed(cases: u32, seed: u64) -> ProptestConfig {
    ProptestConfig { cases, rng_seed: RngSeed::Fixed(seed), failure_persistence: None, ..Default::default() }
}
