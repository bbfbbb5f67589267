//! Eigenvalues and eigenvectors of small symmetric matrices.

/// Sweeps after which Jacobi rotations have long converged: each squares the off-diagonal size near
/// the end.
const SWEEPS: usize = 30;

/// Eigenvalues, in no order, and, in the columns of the second matrix, unit eigenvectors of a
/// symmetric matrix.
///
/// Cyclic Jacobi rotations, which keep small eigenvalues accurate.
pub(crate) fn symmetric_eigen<const N: usize>(matrix: &[[f64; N]; N]) -> ([f64; N], [[f64; N]; N]) {
    let mut a = *matrix;
    let mut v = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 }));
    for _ in 0..SWEEPS {
        let mut off = 0.0;
        for p in 0..N {
            for q in p + 1..N {
                off += a[p][q] * a[p][q];
                rotate(&mut a, &mut v, p, q);
            }
        }
        if off == 0.0 {
            break;
        }
    }
    (std::array::from_fn(|i| a[i][i]), v)
}

/// One Jacobi rotation that makes `a[p][q]` zero.
fn rotate<const N: usize>(a: &mut [[f64; N]; N], v: &mut [[f64; N]; N], p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
    let c = 1.0 / t.hypot(1.0);
    let s = t * c;
    for row in a.iter_mut().chain(v.iter_mut()) {
        let (x, y) = (row[p], row[q]);
        (row[p], row[q]) = (c * x - s * y, s * x + c * y);
    }
    let (above, below) = (a[p], a[q]);
    a[p] = std::array::from_fn(|k| c * above[k] - s * below[k]);
    a[q] = std::array::from_fn(|k| s * above[k] + c * below[k]);
    (a[p][q], a[q][p]) = (0.0, 0.0);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvectors_diagonalise() {
        let mut m = [[0.0; 6]; 6];
        for (i, row) in m.iter_mut().enumerate() {
            for (j, x) in row.iter_mut().enumerate() {
                *x = 1.0 / (i + j + 1) as f64;
            }
        }
        let (values, v) = symmetric_eigen(&m);
        for k in 0..6 {
            for i in 0..6 {
                let image: f64 = (0..6).map(|j| m[i][j] * v[j][k]).sum();
                assert!((image - values[k] * v[i][k]).abs() < 1e-14, "vector {k}, row {i}");
            }
        }
    }
}
