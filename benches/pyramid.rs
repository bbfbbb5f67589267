//! Time of one coarsening to about a quarter and of whole pyramids, in triangles per second.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dermatome::{
    mesh::shapes,
    pyramid::{CoarsenOptions, coarsen},
    run::Run,
    skin::{LinkId, Patch},
};

/// Names and triangle counts of the inputs.
const SIZES: [(&str, usize); 5] =
    [("500", 500), ("10k", 10_000), ("100k", 100_000), ("200k", 200_000), ("1M", 1_000_000)];

fn bench(c: &mut Criterion) {
    for (name, levels) in [("one_level", Some(1)), ("pyramid", None)] {
        let mut group = c.benchmark_group(name);
        group.sample_size(10);
        let options = CoarsenOptions { levels, ..CoarsenOptions::default() };
        for (size, faces) in SIZES {
            let mesh = shapes::cap(faces, 0.1, 110_f64.to_radians());
            group.throughput(Throughput::Elements(mesh.triangles.len() as u64));
            let patch = Patch::from_mesh("cap", LinkId::default(), mesh);
            group.bench_with_input(BenchmarkId::new("cap", size), &patch, |b, patch| {
                b.iter(|| coarsen(&patch.mesh, &patch.taxels, &options, Run::default()));
            });
        }
        group.finish();
    }
}

criterion_group!(benches, bench);
criterion_main!(benches);
