//! Ordering, factoring and solving of shifted Laplacians of triangular lattices on a cylinder.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use dermatome_sparse::{Cholesky, Matrix, Pattern};
use glam::DVec3;

/// A lattice of `n` x `n` rows, each joined to six neighbours, and their coordinates.
fn lattice(n: usize) -> (Pattern, Vec<DVec3>) {
    let at = |i: usize, j: usize| j * n + i;
    let steps = [(0, 1), (1, 0), (1, 1)];
    let cells = (0..n).flat_map(|j| (0..n).map(move |i| (i, j)));
    let pairs = cells.clone().flat_map(|(i, j)| steps.map(|(x, y)| (i, j, i + x, j + y)));
    let inside = pairs.filter(|&(_, _, x, y)| x < n && y < n);
    let pattern = Pattern::new(n * n, inside.map(|(i, j, x, y)| (at(i, j), at(x, y))));
    let place = |(i, j): (usize, usize)| {
        let (sin, cos) = (i as f64 / n as f64).sin_cos();
        DVec3::new(sin, j as f64 / n as f64, cos)
    };
    (pattern, cells.map(place).collect())
}

/// Graph Laplacian plus a small multiple of the identity.
fn laplacian(pattern: &Pattern) -> Matrix<'_, f64> {
    let mut matrix = Matrix::zero(pattern);
    for (row, entries) in matrix.parts_mut(1).into_iter().enumerate() {
        let degree = entries.len() as f64 - 1.0;
        for (entry, &column) in entries.iter_mut().zip(pattern.columns(row)) {
            *entry = if column as usize == row { degree + 1e-3 } else { -1.0 };
        }
    }
    matrix
}

fn bench(c: &mut Criterion) {
    for (size, side) in [("5k", 70), ("50k", 224)] {
        let (pattern, places) = lattice(side);
        let matrix = laplacian(&pattern);
        let mut group = c.benchmark_group("sparse");
        group.sample_size(10);
        group.bench_function(BenchmarkId::new("analyse", size), |b| {
            b.iter(|| Cholesky::new(black_box(&pattern), &places));
        });
        if let Ok(cholesky) = Cholesky::new(&pattern, &places) {
            group.bench_function(BenchmarkId::new("factor", size), |b| {
                b.iter(|| cholesky.factor(black_box(&matrix)));
            });
            if let Ok(factor) = cholesky.factor(&matrix) {
                group.bench_function(BenchmarkId::new("solve", size), |b| {
                    let rhs = vec![1.0; places.len()];
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
