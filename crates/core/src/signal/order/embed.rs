//! Points in the plane whose distances are as given: the map of columns from their signals alone, and that of taxels from
//! the skin.
//!
//! Isomap `(tenenbaum2000)`: lengths of edges between the most alike, shortest paths, classical scaling
//! `(torgerson1952)`; then steps that lower the weighted stress `(deleeuw1977)`.

use glam::DVec2;

use crate::id::VertexId;
use crate::numeric::{Csr, DisjointSets, dense_cholesky, distances_from, solve_dense, symmetric_eigen};
use crate::parallel::par_rows;
use crate::signal::order::likeness::Likeness;

/// Each column is connected with this many of the columns most like it, if their likeness is greater than this.
const NEIGHBOURS: usize = 8;
const LEAST_LIKENESS: f64 = 0.1;

/// Equal signals are this far apart, in lengths `l` of the likeness.
const LEAST_LENGTH: f64 = 1e-3;

/// Steps that lower the stress, and the distance up to which all pairs have the same weight.
const STRESS_STEPS: usize = 25;
const EQUAL_WEIGHT: f64 = 0.3;

/// Vectors that are iterated for the two largest eigenvalues, most iterations, and the relative residual at their end.
const VECTORS: usize = 6;
const ITERATIONS: usize = 1000;
const RESIDUAL: f64 = 1e-9;

/// Columns that are connected by likeness, in the plane.
#[derive(Debug, Clone)]
pub(super) struct Embedding {
    /// The largest set of connected columns, as numbers in the likeness.
    pub(super) members: Vec<usize>,
    /// Their points, in lengths `l` of the likeness; turned and mirrored arbitrarily.
    pub(super) points: Vec<DVec2>,
}

/// The map of columns from their signals.
pub(super) fn embed(likeness: &Likeness) -> Embedding {
    let count = likeness.len();
    let mut pairs = Vec::with_capacity(2 * NEIGHBOURS * count);
    let mut sets = DisjointSets::<VertexId>::new(count);
    for a in 0..count {
        let row = likeness.row(a);
        let mut others: Vec<usize> = (0..count).filter(|&b| b != a && row[b] > LEAST_LIKENESS).collect();
        others.sort_by(|&b, &c| row[c].total_cmp(&row[b]));
        for &b in others.iter().take(NEIGHBOURS) {
            let length = (-2.0 * row[b].min(1.0).ln()).sqrt().max(LEAST_LENGTH);
            let [from, to] = [a, b].map(VertexId::new);
            pairs.extend([(a, (to.raw(), length)), (b, (from.raw(), length))]);
            sets.join(from, to);
        }
    }
    let labels = sets.labels();
    let mut sizes = vec![0; labels.count];
    labels.of.iter().for_each(|&set| sizes[set] += 1);
    let largest = (0..labels.count).rev().max_by_key(|&set| sizes[set]).unwrap_or(0);
    let members: Vec<usize> = (0..count).filter(|&k| labels.of[VertexId::new(k)] == largest).collect();
    let graph = Csr::from_pairs(count, pairs.iter().copied());
    let row = VertexId::new(members.len()).raw();
    let starts: Vec<u32> = (0..=row).map(|k| k * row).collect();
    let distances = par_rows(&starts, |k, out: &mut [f64]| {
        let mut all = vec![0.0; count];
        distances_from(&graph, members[k], &mut all);
        out.iter_mut().zip(&members).for_each(|(x, &to)| *x = all[to]);
    });
    let points = lower_stress(scale(&distances, members.len()), &distances);
    Embedding { members, points }
}

/// Classical scaling: the points whose distances are nearest to those of `count` things, row by row, with the mean 0.
pub(super) fn scale(distances: &[f64], count: usize) -> Vec<DVec2> {
    let n = count as f64;
    let mut products: Vec<f64> = distances.iter().map(|d| -0.5 * d * d).collect();
    let means: Vec<f64> = products.chunks(count.max(1)).map(|row| row.iter().sum::<f64>() / n).collect();
    let mean = means.iter().sum::<f64>() / n;
    for (k, x) in products.iter_mut().enumerate() {
        *x += mean - means[k / count] - means[k % count];
    }
    let landmarks = landmarks(distances, count);
    let mut vectors: Vec<[f64; VECTORS]> =
        (0..count).map(|k| std::array::from_fn(|j| products[k * count + landmarks[j]])).collect();
    let rows: Vec<u32> = (0..=VertexId::new(count).raw()).collect();
    let mut values = [0.0; 2];
    orthonormalise(&mut vectors);
    for _ in 0..ITERATIONS {
        let images: Vec<[f64; VECTORS]> = par_rows(&rows, |k, out: &mut [[f64; VECTORS]]| {
            let row = &products[k * count..][..count];
            let mut sum = [0.0; VECTORS];
            for (x, vector) in row.iter().zip(&vectors) {
                sum.iter_mut().zip(vector).for_each(|(sum, y)| *sum += x * y);
            }
            out[0] = sum;
        });
        let mut small = [[0.0; VECTORS]; VECTORS];
        for (x, y) in vectors.iter().zip(&images) {
            for (i, row) in small.iter_mut().enumerate() {
                row.iter_mut().enumerate().for_each(|(j, sum)| *sum += 0.5 * (x[i] * y[j] + x[j] * y[i]));
            }
        }
        let (found, turn) = symmetric_eigen(&small);
        let mut order: [usize; VECTORS] = std::array::from_fn(|k| k);
        order.sort_by(|&a, &b| found[b].total_cmp(&found[a]));
        let turned = |x: &[f64; VECTORS]| -> [f64; VECTORS] {
            std::array::from_fn(|k| (0..VECTORS).map(|j| x[j] * turn[j][order[k]]).sum())
        };
        let (mut residual, mut size) = (0.0, 0.0);
        values = [found[order[0]], found[order[1]]];
        let mut next = Vec::with_capacity(count);
        for (x, y) in vectors.iter_mut().zip(&images) {
            *x = turned(x);
            let y = turned(y);
            for k in 0..2 {
                residual += (y[k] - values[k] * x[k]).powi(2);
                size += y[k].powi(2);
            }
            next.push(y);
        }
        if residual <= RESIDUAL * RESIDUAL * size {
            break;
        }
        vectors = next;
        orthonormalise(&mut vectors);
    }
    let lengths = values.map(|value| value.max(0.0).sqrt());
    vectors.iter().map(|x| DVec2::new(lengths[0] * x[0], lengths[1] * x[1])).collect()
}

/// Things far from each other: the one farthest from all, then always the farthest one from these.
fn landmarks(distances: &[f64], count: usize) -> [usize; VECTORS] {
    let sum = |k: usize| distances[k * count..][..count].iter().sum::<f64>();
    let farthest =
        |far: &dyn Fn(usize) -> f64| (0..count).max_by(|&a, &b| far(a).total_cmp(&far(b))).unwrap_or(0);
    let mut found = [farthest(&sum); VECTORS];
    for k in 1..VECTORS {
        let known = found;
        let nearest = |at: usize| {
            known[..k].iter().map(|&other| distances[at * count + other]).fold(f64::INFINITY, f64::min)
        };
        found[k] = farthest(&nearest);
    }
    found
}

/// Makes columns orthonormal, in their order; those that depend on earlier ones become 0.
fn orthonormalise(vectors: &mut [[f64; VECTORS]]) {
    /// What is left of a column, over its square before, where it depends on earlier ones up to rounding.
    const DEPENDENT: f64 = 1e-12;
    for k in 0..VECTORS {
        let before: f64 = vectors.iter().map(|x| x[k] * x[k]).sum();
        // Twice is enough.
        for _ in 0..2 {
            for j in 0..k {
                let product: f64 = vectors.iter().map(|x| x[j] * x[k]).sum();
                vectors.iter_mut().for_each(|x| x[k] -= product * x[j]);
            }
        }
        let square: f64 = vectors.iter().map(|x| x[k] * x[k]).sum();
        let factor = if square > DEPENDENT * before { 1.0 / square.sqrt() } else { 0.0 };
        vectors.iter_mut().for_each(|x| x[k] *= factor);
    }
}

/// Steps of majorisation that lower the sum of `((|x_i - x_j| - d_ij) / d_ij)^2`.
fn lower_stress(mut points: Vec<DVec2>, distances: &[f64]) -> Vec<DVec2> {
    let count = points.len();
    if count < 3 {
        return points;
    }
    let weight = |d: f64| d.max(EQUAL_WEIGHT).powi(-2);
    // The last point is held, else the system is singular.
    let n = count - 1;
    let mut laplacian = vec![0.0; n * n];
    for i in 0..n {
        let row = &distances[i * count..][..count];
        let own = &mut laplacian[i * n..][..n];
        own.iter_mut().zip(row).for_each(|(x, &d)| *x = -weight(d));
        own[i] = row.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, &d)| weight(d)).sum();
    }
    let Some(factor) = dense_cholesky(&laplacian, n) else { return points };
    for _ in 0..STRESS_STEPS {
        let mut rhs = Vec::with_capacity(2 * n);
        for (i, &x) in points[..n].iter().enumerate() {
            let row = &distances[i * count..][..count];
            let pull = |(&y, &d): (&DVec2, &f64)| weight(d) * d / x.distance(y).max(1e-6) * (x - y);
            rhs.extend(points.iter().zip(row).map(pull).sum::<DVec2>().to_array());
        }
        solve_dense(&factor, &mut rhs, 2);
        points = rhs.chunks_exact(2).map(DVec2::from_slice).chain([DVec2::ZERO]).collect();
        let mean = points.iter().sum::<DVec2>() / count as f64;
        points.iter_mut().for_each(|x| *x -= mean);
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Distances of points in the plane give the points back, turned and mirrored.
    #[test]
    fn distances_in_the_plane_are_kept() {
        let points: Vec<DVec2> = (0..40_i32)
            .map(|k| DVec2::new(f64::from(k % 8), 1.3 * f64::from(k / 8) + 0.1 * f64::from(k % 3)))
            .collect();
        let distances: Vec<f64> = points.iter().flat_map(|a| points.iter().map(|b| a.distance(*b))).collect();
        for found in [scale(&distances, 40), lower_stress(scale(&distances, 40), &distances)] {
            for (k, d) in distances.iter().enumerate() {
                let own = found[k / 40].distance(found[k % 40]);
                assert!((own - d).abs() < 1e-6, "pair {k}: {own} and {d}");
            }
        }
    }
}
