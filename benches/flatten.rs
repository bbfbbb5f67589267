//! Flattening of caps of 110 degrees: the shape that PEERS and the README compare on.
//!
//! `DERMATOME_BENCH_LARGE=1` adds a million faces.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use dermatome::{
    flatten::{Energy, FlattenOptions, Method, distortion, flatten},
    mesh::shapes,
    run::Run,
};

fn caps() -> Vec<(&'static str, dermatome::mesh::TriMesh)> {
    let half_angle = 110_f64.to_radians();
    let mut sizes = vec![("500", 500), ("10k", 10_000), ("100k", 100_000)];
    if std::env::var_os("DERMATOME_BENCH_LARGE").is_some() {
        sizes.push(("1M", 1_000_000));
    }
    sizes.into_iter().map(|(name, faces)| (name, shapes::cap(faces, 0.1, half_angle))).collect()
}

fn bench(c: &mut Criterion) {
    let methods = [
        ("sum", FlattenOptions::default()),
        ("symmetric-dirichlet", Energy::SymmetricDirichlet.into()),
        ("conformal", Method::Conformal.into()),
        ("linear", Method::Linear { angle: 1.0, area: 1.0 }.into()),
    ];
    let caps = caps();
    let mut group = c.benchmark_group("flatten");
    group.sample_size(10);
    for (size, mesh) in &caps {
        for (name, options) in &methods {
            group.bench_with_input(BenchmarkId::new(*name, size), mesh, |b, mesh| {
                b.iter(|| flatten(black_box(mesh), None, options, Run::default()));
            });
        }
    }
    group.finish();
    let mut group = c.benchmark_group("distortion");
    for (size, mesh) in &caps {
        if let Ok(map) = flatten(mesh, None, &methods[2].1, Run::default()) {
            group.bench_with_input(BenchmarkId::from_parameter(size), mesh, |b, mesh| {
                b.iter(|| distortion(black_box(mesh), &map.uv));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
