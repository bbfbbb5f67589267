//! Matrices of 6 x 6 for rigid motions: three numbers of translation, three of rotation.

use std::ops::Mul;

use glam::{DMat3, DVec3};

/// Translation, then rotation.
pub(crate) type Twist = [DVec3; 2];

/// `x' y`.
pub(crate) fn dot(x: Twist, y: Twist) -> f64 {
    x[0].dot(y[0]) + x[1].dot(y[1])
}

/// A matrix of 6 x 6 in four blocks: rows translation and rotation, columns likewise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Matrix6(pub(crate) [[DMat3; 2]; 2]);

impl Matrix6 {
    pub(crate) const ZERO: Self = Self([[DMat3::ZERO; 2]; 2]);

    pub(crate) fn from_rows(m: &[[f64; 6]; 6]) -> Self {
        let block = |r: usize, c: usize| {
            let column = |b: usize| DVec3::new(m[r][c + b], m[r + 1][c + b], m[r + 2][c + b]);
            DMat3::from_cols(column(0), column(1), column(2))
        };
        Self([[block(0, 0), block(0, 3)], [block(3, 0), block(3, 3)]])
    }

    pub(crate) fn transpose(&self) -> Self {
        let [[a, b], [c, d]] = self.0;
        Self([[a.transpose(), c.transpose()], [b.transpose(), d.transpose()]])
    }

    /// The entry of `row` and `column`, each from 0 to 5.
    #[inline]
    pub(crate) fn entry(&self, row: usize, column: usize) -> f64 {
        self.0[row / 3][column / 3].col(column % 3)[row % 3]
    }
}

impl Mul for Matrix6 {
    type Output = Self;

    #[inline]
    fn mul(self, other: Self) -> Self {
        let (x, y) = (&self.0, &other.0);
        let block = |r: usize, c: usize| x[r][0] * y[0][c] + x[r][1] * y[1][c];
        Self([[block(0, 0), block(0, 1)], [block(1, 0), block(1, 1)]])
    }
}

impl Mul<Twist> for Matrix6 {
    type Output = Twist;

    #[inline]
    fn mul(self, x: Twist) -> Twist {
        let m = &self.0;
        [m[0][0] * x[0] + m[0][1] * x[1], m[1][0] * x[0] + m[1][1] * x[1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some() -> ([[f64; 6]; 6], Matrix6) {
        let rows = std::array::from_fn(|i| std::array::from_fn(|j| ((i * 6 + j) * 7 % 11) as f64));
        (rows, Matrix6::from_rows(&rows))
    }

    #[test]
    fn blocks_multiply_like_the_whole() {
        let (rows, m) = some();
        let product = m * m.transpose();
        for i in 0..6 {
            for j in 0..6 {
                assert_eq!(m.entry(i, j), rows[i][j]);
                let expected: f64 = (0..6).map(|k| rows[i][k] * rows[j][k]).sum();
                assert_eq!(product.entry(i, j), expected, "whole numbers, so exact");
            }
        }
    }

    #[test]
    fn twists_are_columns() {
        let (rows, m) = some();
        let x = [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)];
        let y = m * x;
        for (i, row) in rows.iter().enumerate() {
            let expected: f64 = row.iter().enumerate().map(|(k, a)| a * x[k / 3][k % 3]).sum();
            assert_eq!(y[i / 3][i % 3], expected);
        }
        assert_eq!(dot(x, x), 91.0);
    }
}
