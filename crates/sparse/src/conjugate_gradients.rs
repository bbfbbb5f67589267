//! Conjugate gradients for matrices of 2 x 2 blocks.

use glam::{DMat2, DVec2};
use rayon::prelude::*;

use crate::Matrix;

/// Entries that one task handles; fixed, so that sums do not depend on the number of threads.
const ENTRIES_PER_TASK: usize = 4096;

/// The inverses of the diagonal blocks: a preconditioner.
#[derive(Debug, Clone)]
pub struct BlockJacobi(Vec<DMat2>);

impl BlockJacobi {
    /// Inverts the diagonal blocks; a block that cannot be inverted becomes the identity over its
    /// largest entry.
    #[must_use]
    pub fn new(matrix: &Matrix<'_, DMat2>) -> Self {
        let invert = |row| {
            let block = matrix.diagonal(row);
            let inverse = block.inverse();
            if block.determinant() > 0.0 && inverse.is_finite() {
                inverse
            } else {
                let largest = block.x_axis.abs().max(block.y_axis.abs()).max_element();
                DMat2::IDENTITY * if largest > 0.0 { 1.0 / largest } else { 1.0 }
            }
        };
        Self((0..matrix.pattern().rows()).into_par_iter().map(invert).collect())
    }

    /// `out` = approximately `M^-1 r`.
    fn apply(&self, r: &[DVec2], out: &mut [DVec2]) {
        out.par_chunks_mut(ENTRIES_PER_TASK).enumerate().for_each(|(chunk, out)| {
            for (k, out) in out.iter_mut().enumerate() {
                let row = chunk * ENTRIES_PER_TASK + k;
                *out = self.0[row] * r[row];
            }
        });
    }
}

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CgOptions {
    /// The residual, over the right-hand side, in the norm of the preconditioner.
    pub relative_residual: f64,
    /// Number of iterations.
    pub iterations: usize,
}

/// How the iteration ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CgReport {
    /// The residual reached, over the right-hand side, in the norm of the preconditioner.
    pub relative_residual: f64,
    /// Iterations done.
    pub iterations: usize,
}

/// Sum of the scalar products of the entries, the same for any number of threads.
#[must_use]
pub fn dot(a: &[DVec2], b: &[DVec2]) -> f64 {
    let parts: Vec<f64> = a
        .par_chunks(ENTRIES_PER_TASK)
        .zip(b.par_chunks(ENTRIES_PER_TASK))
        .map(|(a, b)| a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum())
        .collect();
    parts.iter().sum()
}

/// `y += factor x`.
fn add_scaled(y: &mut [DVec2], factor: f64, x: &[DVec2]) {
    y.par_chunks_mut(ENTRIES_PER_TASK).zip(x.par_chunks(ENTRIES_PER_TASK)).for_each(|(y, x)| {
        for (y, x) in y.iter_mut().zip(x) {
            *y += factor * *x;
        }
    });
}

/// Preconditioned conjugate gradients for a positive semi-definite matrix of blocks, from zero.
///
/// Returns the solution so far; every iterate lowers the quadratic `x' M x / 2 - b' x`, so stopping
/// early still gives a direction of descent. Ends at once when the matrix turns out not to be
/// positive along a direction.
#[must_use]
pub fn conjugate_gradients(
    matrix: &Matrix<'_, DMat2>,
    preconditioner: &BlockJacobi,
    rhs: &[DVec2],
    options: CgOptions,
) -> (Vec<DVec2>, CgReport) {
    let zero = || vec![DVec2::ZERO; rhs.len()];
    let (mut x, mut r, mut z, mut q) = (zero(), rhs.to_vec(), zero(), zero());
    preconditioner.apply(&r, &mut z);
    let mut p = z.clone();
    let first = dot(&r, &z);
    let mut rz = first;
    let relative = |rz: f64| if first > 0.0 { (rz / first).max(0.0).sqrt() } else { 0.0 };
    let mut iterations = 0;
    while iterations < options.iterations && relative(rz) > options.relative_residual {
        matrix.multiply(&p, &mut q);
        let curvature = dot(&p, &q);
        if curvature.is_nan() || curvature <= 0.0 {
            break;
        }
        let step = rz / curvature;
        add_scaled(&mut x, step, &p);
        add_scaled(&mut r, -step, &q);
        preconditioner.apply(&r, &mut z);
        let next = dot(&r, &z);
        let keep = next / rz;
        p.par_chunks_mut(ENTRIES_PER_TASK).zip(z.par_chunks(ENTRIES_PER_TASK)).for_each(|(p, z)| {
            for (p, z) in p.iter_mut().zip(z) {
                *p = *z + keep * *p;
            }
        });
        rz = next;
        iterations += 1;
    }
    (x, CgReport { relative_residual: relative(rz), iterations })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Pattern;

    #[test]
    fn as_many_iterations_as_unknowns_solve_exactly() {
        let pattern = Pattern::new(6, (1..6).map(|i| (i - 1, i)));
        let mut m = Matrix::zero(&pattern);
        for i in 0..6 {
            *m.at(i, i) = DMat2::from_cols_array(&[4.0, 1.0, 1.0, 3.0]);
            if i > 0 {
                *m.at(i, i - 1) = DMat2::from_diagonal(DVec2::new(-1.0, -0.5));
                *m.at(i - 1, i) = DMat2::from_diagonal(DVec2::new(-1.0, -0.5));
            }
        }
        let truth: Vec<_> = (0..6).map(|i| DVec2::new(f64::from(i), 1.0)).collect();
        let mut rhs = vec![DVec2::ZERO; 6];
        m.multiply(&truth, &mut rhs);
        let options = CgOptions { relative_residual: 1e-14, iterations: 12 };
        let (x, report) = conjugate_gradients(&m, &BlockJacobi::new(&m), &rhs, options);
        assert!(report.iterations <= 12, "{report:?}");
        assert!(x.iter().zip(&truth).all(|(a, b)| a.distance(*b) < 1e-12), "{x:?} is {truth:?}");
    }

    #[test]
    fn a_zero_right_hand_side_needs_no_iteration() {
        let pattern = Pattern::new(2, [(0, 1)]);
        let mut m = Matrix::zero(&pattern);
        (*m.at(0, 0), *m.at(1, 1)) = (DMat2::IDENTITY, DMat2::IDENTITY);
        let options = CgOptions { relative_residual: 0.0, iterations: 9 };
        let (x, report) = conjugate_gradients(&m, &BlockJacobi::new(&m), &[DVec2::ZERO; 2], options);
        assert_eq!((x, report.iterations), (vec![DVec2::ZERO; 2], 0));
    }
}
