//! Dense symmetric positive definite systems.

/// The lower triangle of a matrix whose product with its transpose is a symmetric positive definite matrix `a` of `n`
/// rows, row by row; `None` if `a` is not positive definite.
pub(crate) fn dense_cholesky(a: &[f64], n: usize) -> Option<Vec<f64>> {
    let mut l = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let (above, own) = l.split_at(i * n);
            let other = if j == i { own } else { &above[j * n..] };
            let sum: f64 = own[..j].iter().zip(&other[..j]).map(|(x, y)| x * y).sum();
            let rest = a[i * n + j] - sum;
            l[i * n + j] =
                if j < i { rest / l[j * n + j] } else { Some(rest.sqrt()).filter(|x| *x > 0.0)? };
        }
    }
    Some(l)
}

/// Solves a system by its [`dense_cholesky`] for several right-hand sides, row by row in `rhs`, in place.
pub(crate) fn solve_dense(l: &[f64], rhs: &mut [f64], columns: usize) {
    let n = rhs.len() / columns;
    let subtract =
        |from: &mut [f64], x: f64, y: &[f64]| from.iter_mut().zip(y).for_each(|(sum, y)| *sum -= x * y);
    for i in 0..n {
        let (known, rest) = rhs.split_at_mut(i * columns);
        let own = &mut rest[..columns];
        l[i * n..].iter().zip(known.chunks_exact(columns)).for_each(|(&x, row)| subtract(own, x, row));
        own.iter_mut().for_each(|y| *y /= l[i * n + i]);
    }
    for i in (0..n).rev() {
        let (above, rest) = rhs.split_at_mut(i * columns);
        let own = &mut rest[..columns];
        own.iter_mut().for_each(|y| *y /= l[i * n + i]);
        l[i * n..].iter().zip(above.chunks_exact_mut(columns)).for_each(|(&x, row)| subtract(row, x, own));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solutions_satisfy_the_system() {
        const N: usize = 5;
        // A Hilbert matrix.
        let a: Vec<f64> = (0..N * N).map(|k| 1.0 / (k / N + k % N + 1) as f64).collect();
        let l = dense_cholesky(&a, N).unwrap();
        let rhs = [[1.0, 0.0], [2.0, 1.0], [-1.0, 0.5], [0.0, 3.0], [4.0, -2.0]];
        let mut x = rhs;
        solve_dense(&l, x.as_flattened_mut(), 2);
        for (row, needed) in rhs.iter().enumerate() {
            for k in 0..2 {
                let found: f64 = (0..N).map(|j| a[row * N + j] * x[j][k]).sum();
                assert!((found - needed[k]).abs() < 1e-8, "{found} and {}", needed[k]);
            }
        }
        assert_eq!(dense_cholesky(&[1.0, 2.0, 2.0, 1.0], 2), None);
    }
}
