//! Ordering, factoring and solving of shifted Laplacians of caps.
#![allow(missing_docs, reason = "criterion's macros make undocumented items")]

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use dermatome::{
    mesh::{TriMesh, shapes},
    sparse::{Cholesky, Matrix, Pattern},
};

fn pattern_of(mesh: &TriMesh) -> Pattern {
    let edges = mesh.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
    Pattern::new(mesh.positions.len(), edges.map(|(a, b)| (a.index(), b.index())))
}

/// Graph Laplacian plus a little of the identity.
fn laplacian(pattern: &Pattern) -> Matrix<'_, f64> {
    let mut matrix = Matrix::zero(pattern);
    matrix.fill_rows(|row, entries| {
        let degree = entries.len() as f64 - 1.0;
        for (entry, &column) in entries.iter_mut().zip(pattern.columns(row)) {
            *entry = if column as usize == row { degree + 1e-3 } else { -1.0 };
        }
    });
    matrix
}

fn bench(c: &mut Criterion) {
    for (size, faces) in [("10k", 10_000), ("100k", 100_000)] {
        let mesh = shapes::cap(faces, 0.1, 110_f64.to_radians());
        let pattern = pattern_of(&mesh);
        let matrix = laplacian(&pattern);
        let mut group = c.benchmark_group("sparse");
        group.sample_size(10);
        group.bench_function(BenchmarkId::new("analyse", size), |b| {
            b.iter(|| Cholesky::new(black_box(&pattern), mesh.positions.as_slice()));
        });
        if let Ok(cholesky) = Cholesky::new(&pattern, mesh.positions.as_slice()) {
            group.bench_function(BenchmarkId::new("factor", size), |b| {
                b.iter(|| cholesky.factor(black_box(&matrix)));
            });
            if let Ok(factor) = cholesky.factor(&matrix) {
                group.bench_function(BenchmarkId::new("solve", size), |b| {
                    let rhs = vec![1.0; mesh.positions.len()];
                    b.iter(|| {
                        let mut x = rhs.clone();
                        factor.solve(black_box(&mut x)).map(|()| x)
                    });
                });
            }
        }
        group.finish();
    }
}

criterion_group!(benches, bench);
criterion_main!(benches);
