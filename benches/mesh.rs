//! Who borders whom, for lattices of many sizes.

#[path = "../tests/library/altered.rs"]
mod altered;

use altered::renumbered;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dermatome::mesh::{Adjacency, TriMesh, shapes};

/// The same mesh with its vertices in no order, as files may have them.
fn shuffled(mesh: &TriMesh) -> TriMesh {
    let mut order: Vec<usize> = (0..mesh.positions.len()).collect();
    // Fibonacci hashing scatters neighbours over the whole range.
    order.sort_by_key(|&v| (v as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15));
    renumbered(mesh, &order)
}

fn adjacency(c: &mut Criterion) {
    let mut group = c.benchmark_group("adjacency");
    for faces in [500, 10_000, 100_000, 1_000_000] {
        group.throughput(Throughput::Elements(u64::from(faces)));
        group.sample_size(10);
        let side = (1..).find(|n| 2 * n * n >= faces).expect("some number is large enough") + 1;
        let mesh = shapes::lattice(side, side, 0.005);
        group.bench_with_input(BenchmarkId::new("in_order", faces), &mesh, |b, mesh| {
            b.iter(|| Adjacency::new(mesh));
        });
        let mesh = shuffled(&mesh);
        group.bench_with_input(BenchmarkId::new("shuffled", faces), &mesh, |b, mesh| {
            b.iter(|| Adjacency::new(mesh));
        });
    }
}

criterion_group!(benches, adjacency);
criterion_main!(benches);
