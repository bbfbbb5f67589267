//! Information matrices: inverse covariances, which may be singular.

use glam::DMat3;

use crate::numeric::{Matrix6, symmetric_eigen};

/// How far below zero an eigenvalue of a matrix with ones on its diagonal may be: files round exactly
/// semi-definite matrices.
const EIGENVALUE_ROUNDING: f64 = 1e-8;

/// How far below zero an entry on the diagonal may be, over the largest entry: the rounding of an inverted
/// covariance.
const DIAGONAL_ROUNDING: f64 = 1e-13;

/// If the absolute sums of all rows are at most this multiple of the diagonal, correlations do not remove a direction.
const MAX_WEAK_SUM: f64 = 1.5;

/// A direction counts as observed if its eigenvalue is above this in the matrix with ones on its
/// diagonal.
const RANK_TOLERANCE: f64 = 1e-9;

/// The inverse of a covariance: a symmetric matrix of `N` rows.
///
/// Zero information is allowed: that direction was not observed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Information<const N: usize>(pub [[f64; N]; N]);

impl<const N: usize> Information<N> {
    /// Independent directions.
    pub fn diagonal(values: [f64; N]) -> Self {
        let mut rows = [[0.0; N]; N];
        for (i, value) in values.into_iter().enumerate() {
            rows[i][i] = value;
        }
        Self(rows)
    }

    /// From the upper triangle, row by row, as files write it; `None` unless there are `N (N + 1) /
    /// 2` numbers.
    #[doc(hidden)]
    pub fn from_upper(upper: &[f64]) -> Option<Self> {
        if upper.len() != N * (N + 1) / 2 {
            return None;
        }
        let mut rows = [[0.0; N]; N];
        let places = (0..N).flat_map(|i| (i..N).map(move |j| (i, j)));
        for ((i, j), &value) in places.zip(upper) {
            (rows[i][j], rows[j][i]) = (value, value);
        }
        Some(Self(rows))
    }

    #[doc(hidden)]
    pub fn upper(&self) -> impl Iterator<Item = f64> {
        (0..N).flat_map(move |i| (i..N).map(move |j| self.0[i][j]))
    }

    /// Its value in every direction, if that is the same and nothing is correlated.
    pub(crate) fn as_isotropic(&self) -> Option<f64> {
        let value = self.0[0][0];
        (*self == Self::diagonal([value; N])).then_some(value)
    }

    pub(crate) fn quadratic_form(&self, e: &[f64; N]) -> f64 {
        let row = |i: usize| (0..N).map(|j| self.0[i][j] * e[j]).sum::<f64>();
        (0..N).map(|i| e[i] * row(i)).sum()
    }

    /// The eigenvalues, ascending.
    ///
    /// Cyclic Jacobi rotations, which keep small eigenvalues accurate.
    pub(crate) fn eigenvalues(&self) -> [f64; N] {
        let mut values = symmetric_eigen(&self.0).0;
        values.sort_unstable_by(f64::total_cmp);
        values
    }

    /// The matrix with its diagonal scaled to one, which removes the units: metres and radians may differ by
    /// any factor. Rows that observe nothing become zero. `None` if a diagonal entry is negative, or an entry
    /// is not finite.
    fn correlations(&self) -> Option<[[f64; N]; N]> {
        let m = &self.0;
        let largest = m.iter().flatten().fold(0.0_f64, |most, x| most.max(x.abs()));
        if !m.iter().flatten().all(|x| x.is_finite()) {
            return None;
        }
        let mut scale = [0.0; N];
        for (i, row) in m.iter().enumerate() {
            if row[i] > 0.0 {
                scale[i] = row[i].sqrt().recip();
            } else if row[i] < -DIAGONAL_ROUNDING * largest
                || row.iter().any(|x| x.abs() > EIGENVALUE_ROUNDING * largest)
            {
                return None;
            }
        }
        Some(std::array::from_fn(|i| std::array::from_fn(|j| m[i][j] * scale[i] * scale[j])))
    }

    /// Whether it is symmetric up to a file's rounding.
    pub(super) fn is_symmetric(&self) -> bool {
        let m = &self.0;
        (0..N).all(|i| {
            (0..i).all(|j| {
                let scale = (m[i][i] * m[j][j]).sqrt().max(m[i][j].abs());
                // Numbers that are not finite are refused as indefinite.
                let difference = (m[i][j] - m[j][i]).abs();
                difference.is_nan() || difference <= EIGENVALUE_ROUNDING * scale
            })
        })
    }

    /// Whether all entries are finite and no eigenvalue is negative by more than a file's rounding.
    #[doc(hidden)]
    pub fn is_positive_semidefinite(&self) -> bool {
        // A diagonally dominant matrix needs no eigenvalues; most matrices of files are.
        let is_dominant = |i: usize| {
            let sum = self.0[i].iter().map(|x| x.abs()).sum::<f64>();
            sum.is_finite() && 2.0 * self.0[i][i] >= sum
        };
        (0..N).all(is_dominant)
            || self
                .correlations()
                .is_some_and(|c| symmetric_eigen(&c).0.iter().all(|&x| x >= -EIGENVALUE_ROUNDING))
    }

    /// Whether it is finite, but not positive semi-definite.
    pub(super) fn is_indefinite(&self) -> bool {
        self.0.iter().flatten().all(|x| x.is_finite()) && !self.is_positive_semidefinite()
    }

    /// The nearest positive semi-definite matrix: negative eigenvalues become zero.
    pub(crate) fn clipped(&self) -> Self {
        let (values, vectors) = symmetric_eigen(&self.0);
        let entry = |i: usize, j: usize| {
            (0..N).map(|k| values[k].max(0.0) * (vectors[i][k] * vectors[j][k])).sum::<f64>()
        };
        Self(std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j))))
    }

    /// Number of directions that are observed.
    pub(crate) fn rank(&self) -> usize {
        if let Some(value) = self.as_isotropic() {
            return if value > 0.0 { N } else { 0 };
        }
        let Some(c) = self.correlations() else { return 0 };
        // Weak correlations do not reduce the rank (Gershgorin); most matrices of files have no others.
        let is_weak = |i: usize| (0..N).map(|j| c[i][j].abs()).sum::<f64>() <= MAX_WEAK_SUM * c[i][i];
        if (0..N).all(is_weak) {
            return (0..N).filter(|&i| c[i][i] > 0.0).count();
        }
        symmetric_eigen(&c).0.iter().filter(|&&x| x > RANK_TOLERANCE).count()
    }
}

impl Information<6> {
    pub(crate) fn matrix(&self) -> Matrix6 {
        Matrix6::from_rows(&self.0)
    }
}

impl Information<3> {
    pub(crate) fn matrix(&self) -> DMat3 {
        DMat3::from_cols(self.0[0].into(), self.0[1].into(), self.0[2].into())
    }
}
