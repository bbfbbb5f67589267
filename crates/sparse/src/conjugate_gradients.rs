//! Conjugate gradients for matrices of 2 x 2 blocks, in single or double precision.

use std::iter::Sum;
use std::ops::{Add, AddAssign, Mul};

use glam::{DMat2, DVec2, Mat2, Vec2};
use rayon::prelude::*;

use crate::{Entry, Matrix};

/// Rows that one task handles; fixed, so that sums do not depend on the number of threads.
const ROWS_PER_TASK: usize = 4096;

/// A 2 x 2 block in single or double precision.
///
/// The iteration is bound by memory, not by arithmetic: single precision halves its time. Scalar products are
/// summed in double precision.
pub trait Block: Entry + AddAssign + Mul<Self::Vector, Output = Self::Vector> {
    /// Two unknowns.
    type Vector: Copy + Send + Sync + Add<Output = Self::Vector> + Sum;

    /// The block in this precision.
    fn of(block: DMat2) -> Self;

    /// The block in double precision.
    fn widened(self) -> DMat2;

    /// The vector in this precision.
    fn narrow(vector: DVec2) -> Self::Vector;

    /// The vector in double precision.
    fn widen(vector: Self::Vector) -> DVec2;

    /// `factor v`.
    fn scaled(factor: f64, v: Self::Vector) -> Self::Vector;
}

impl Block for Mat2 {
    type Vector = Vec2;

    #[inline]
    fn of(block: DMat2) -> Self {
        block.as_mat2()
    }

    #[inline]
    fn widened(self) -> DMat2 {
        self.as_dmat2()
    }

    #[inline]
    fn narrow(vector: DVec2) -> Vec2 {
        vector.as_vec2()
    }

    #[inline]
    fn widen(vector: Vec2) -> DVec2 {
        vector.as_dvec2()
    }

    #[inline]
    #[expect(clippy::cast_possible_truncation, reason = "a step of the iteration may round")]
    fn scaled(factor: f64, v: Vec2) -> Vec2 {
        factor as f32 * v
    }
}

impl Block for DMat2 {
    type Vector = DVec2;

    #[inline]
    fn of(block: DMat2) -> Self {
        block
    }

    #[inline]
    fn widened(self) -> DMat2 {
        self
    }

    #[inline]
    fn narrow(vector: DVec2) -> DVec2 {
        vector
    }

    #[inline]
    fn widen(vector: DVec2) -> DVec2 {
        vector
    }

    #[inline]
    fn scaled(factor: f64, v: DVec2) -> DVec2 {
        factor * v
    }
}

/// The inverse of a diagonal block, as a preconditioner; for a block that cannot be inverted, the identity
/// divided by its largest entry.
fn inverted(block: DMat2) -> DMat2 {
    let inverse = block.inverse();
    if block.determinant() > 0.0 && inverse.is_finite() {
        inverse
    } else {
        let largest = block.x_axis.abs().max(block.y_axis.abs()).max_element();
        DMat2::IDENTITY * if largest > 0.0 { 1.0 / largest } else { 1.0 }
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
pub fn dot(a: &[DVec2], b: &[DVec2]) -> f64 {
    let parts: Vec<f64> = a
        .par_chunks(ROWS_PER_TASK)
        .zip(b.par_chunks(ROWS_PER_TASK))
        .map(|(a, b)| a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum())
        .collect();
    parts.iter().sum()
}

/// Conjugate gradients from zero for a positive semi-definite matrix, preconditioned by the inverses of the
/// diagonal blocks.
///
/// Returns the solution so far; every iterate lowers the quadratic `x' M x / 2 - b' x`, so stopping early
/// still gives a direction of descent. Stops as soon as the matrix is not positive along a direction.
///
/// # Panics
/// If `rhs` does not have one entry per row.
#[must_use]
pub fn conjugate_gradients<B: Block>(
    matrix: &Matrix<'_, B>,
    rhs: &[DVec2],
    options: CgOptions,
) -> (Vec<DVec2>, CgReport) {
    let pattern = matrix.pattern();
    assert_eq!(rhs.len(), pattern.rows(), "one entry per row");
    // Scales into the range of single precision.
    let scale = rhs.iter().fold(0.0_f64, |most, v| most.max(v.abs().max_element()));
    let scale = if scale > 0.0 { scale } else { 1.0 };
    let rows = 0..rhs.len();
    let inverse: Vec<B> =
        rows.into_par_iter().map(|row| B::of(inverted(matrix.diagonal(row).widened()))).collect();
    let product = |a: B::Vector, b: B::Vector| B::widen(a).dot(B::widen(b));
    let zero = B::narrow(DVec2::ZERO);
    let (mut x, mut q) = (vec![zero; rhs.len()], vec![zero; rhs.len()]);
    let mut r: Vec<B::Vector> = rhs.iter().map(|v| B::narrow(*v / scale)).collect();
    let mut z: Vec<B::Vector> = r.iter().zip(&inverse).map(|(r, m)| *m * *r).collect();
    let mut p = z.clone();
    let first: f64 = r.iter().zip(&z).map(|(r, z)| product(*r, *z)).sum();
    let (mut rz, mut iterations) = (first, 0);
    let relative = |rz: f64| if first > 0.0 { (rz / first).max(0.0).sqrt() } else { 0.0 };
    while iterations < options.iterations && relative(rz) > options.relative_residual {
        let multiply = |(task, q): (usize, &mut [B::Vector])| {
            let mut sum = 0.0;
            for (row, q) in (task * ROWS_PER_TASK..).zip(q) {
                let blocks = matrix.values()[pattern.slots(row)].iter();
                *q = pattern.columns(row).iter().zip(blocks).map(|(&j, m)| *m * p[j as usize]).sum();
                sum += product(p[row], *q);
            }
            sum
        };
        let curvatures: Vec<f64> = q.par_chunks_mut(ROWS_PER_TASK).enumerate().map(multiply).collect();
        let curvature: f64 = curvatures.iter().sum();
        if curvature.is_nan() || curvature <= 0.0 {
            break;
        }
        let step = rz / curvature;
        let vectors = x.par_chunks_mut(ROWS_PER_TASK).zip(r.par_chunks_mut(ROWS_PER_TASK));
        let vectors = vectors.zip(z.par_chunks_mut(ROWS_PER_TASK)).enumerate();
        let advanced = vectors.map(|(task, ((x, r), z))| {
            let mut sum = 0.0;
            for (row, ((x, r), z)) in (task * ROWS_PER_TASK..).zip(x.iter_mut().zip(r).zip(z)) {
                *x = *x + B::scaled(step, p[row]);
                *r = *r + B::scaled(-step, q[row]);
                *z = inverse[row] * *r;
                sum += product(*r, *z);
            }
            sum
        });
        let squares: Vec<f64> = advanced.collect();
        let next: f64 = squares.iter().sum();
        let keep = next / rz;
        p.par_chunks_mut(ROWS_PER_TASK).zip(z.par_chunks(ROWS_PER_TASK)).for_each(|(p, z)| {
            for (p, z) in p.iter_mut().zip(z) {
                *p = *z + B::scaled(keep, *p);
            }
        });
        (rz, iterations) = (next, iterations + 1);
    }
    let x = x.into_iter().map(|v| B::widen(v) * scale).collect();
    (x, CgReport { relative_residual: relative(rz), iterations })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Pattern;

    #[track_caller]
    fn assert_solves<B: Block>(tolerance: f64) {
        let pattern = Pattern::new(6, (1..6).map(|i| (i - 1, i)));
        let mut m = Matrix::<B>::zero(&pattern);
        let (own, next) =
            (DMat2::from_cols_array(&[4.0, 1.0, 1.0, 3.0]), DMat2::from_diagonal(DVec2::new(-1.0, -0.5)));
        let truth: Vec<_> = (0..6).map(|i| 1e-50 * DVec2::new(f64::from(i), 1.0)).collect();
        let mut rhs: Vec<DVec2> = truth.iter().map(|x| own * *x).collect();
        for i in 0..6 {
            *m.at(i, i) = B::of(own);
            if i > 0 {
                (*m.at(i, i - 1), *m.at(i - 1, i)) = (B::of(next), B::of(next));
                rhs[i] += next * truth[i - 1];
                rhs[i - 1] += next * truth[i];
            }
        }
        let options = CgOptions { relative_residual: tolerance, iterations: 12 };
        let (x, report) = conjugate_gradients(&m, &rhs, options);
        assert!(report.relative_residual <= tolerance, "{report:?}");
        assert!(x.iter().zip(&truth).all(|(a, b)| a.distance(*b) < 1e-49 * tolerance), "{x:?} is {truth:?}");
    }

    /// Also for numbers outside the range of single precision.
    #[test]
    fn as_many_iterations_as_unknowns_solve_exactly() {
        assert_solves::<DMat2>(1e-14);
        assert_solves::<Mat2>(1e-6);
    }

    #[test]
    fn iteration_stops_along_a_direction_that_is_not_positive() {
        let pattern = Pattern::new(2, [(0, 1)]);
        let mut m = Matrix::<DMat2>::zero(&pattern);
        (*m.at(0, 0), *m.at(1, 1)) = (-DMat2::IDENTITY, -DMat2::IDENTITY);
        let options = CgOptions { relative_residual: 1e-9, iterations: 9 };
        assert_eq!(conjugate_gradients(&m, &[DVec2::ONE; 2], options).1.iterations, 0);
    }

    #[test]
    fn a_zero_right_hand_side_needs_no_iteration() {
        let pattern = Pattern::new(2, [(0, 1)]);
        let mut m = Matrix::<DMat2>::zero(&pattern);
        (*m.at(0, 0), *m.at(1, 1)) = (DMat2::IDENTITY, DMat2::IDENTITY);
        let options = CgOptions { relative_residual: 0.0, iterations: 9 };
        let (x, report) = conjugate_gradients(&m, &[DVec2::ZERO; 2], options);
        assert_eq!((x, report.iterations), (vec![DVec2::ZERO; 2], 0));
    }
}
