//! Cholesky factorization, supernodal, of real symmetric and complex Hermitian matrices.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltError;
use faer::perm::PermRef;
use faer::sparse::SparseColMatRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::traits::ComplexField;
use faer::{MatMut, Par, Side};
use glam::DVec3;

use crate::lower::{Lower, Numbers};
use crate::ordering::order_rows;
use crate::{Matrix, Pattern, SparseError};

/// The order and the symbolic factor of a [`Pattern`], good for every positive definite [`Matrix`]
/// on it.
///
/// `L L*` without pivoting, supernodal. It runs on the calling thread: faer's own threads cost more
/// than they gain on the small supernodes of meshes.
#[derive(Debug)]
pub struct Cholesky {
    symbolic: SymbolicCholesky<u32>,
    lower: Lower,
    /// Unknowns in a row of the pattern.
    block: usize,
}

impl Cholesky {
    /// Analyses `pattern` for one real or complex unknown a row. `coordinates` (one per row) order
    /// large systems.
    ///
    /// # Errors
    /// [`SparseError::TooLarge`].
    pub fn new(pattern: &Pattern, coordinates: &[DVec3]) -> Result<Self, SparseError> {
        Self::analyse(pattern, coordinates, 1)
    }

    /// Analyses `pattern` for 2 x 2 blocks.
    ///
    /// # Errors
    /// [`SparseError::TooLarge`].
    pub fn of_blocks(pattern: &Pattern, coordinates: &[DVec3]) -> Result<Self, SparseError> {
        Self::analyse(pattern, coordinates, 2)
    }

    pub(super) fn analyse(
        pattern: &Pattern,
        coordinates: &[DVec3],
        block: usize,
    ) -> Result<Self, SparseError> {
        let too_large = |_| SparseError::TooLarge { rows: pattern.rows() };
        let lower = Lower::new(pattern, block).ok_or(SparseError::TooLarge { rows: pattern.rows() })?;
        let order = order_rows(pattern, coordinates).map_err(too_large)?;
        let index = |k: usize| u32::try_from(k).expect("`Lower` has no more than 2^32 entries");
        let size = index(block);
        let forward: Vec<u32> = order.iter().flat_map(|&i| (0..size).map(move |a| size * i + a)).collect();
        let mut inverse = vec![0; forward.len()];
        for (k, &i) in forward.iter().enumerate() {
            inverse[i as usize] = index(k);
        }
        let symbolic = factorize_symbolic_cholesky(
            lower.symbolic(),
            Side::Lower,
            SymmetricOrdering::Custom(PermRef::new_checked(&forward, &inverse, forward.len())),
            CholeskySymbolicParams {
                supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
                ..Default::default()
            },
        )
        .map_err(too_large)?;
        Ok(Self { symbolic, lower, block })
    }

    /// Factors a symmetric matrix on the pattern that was analysed, a Hermitian one if its entries are complex;
    /// only its lower triangle is read.
    ///
    /// # Errors
    /// [`SparseError::NotPositiveDefinite`], [`SparseError::NotFinite`] or [`SparseError::TooLarge`].
    ///
    /// # Panics
    /// If the matrix has another pattern, or entries of another size.
    pub fn factor<T: Numbers>(&self, matrix: &Matrix<'_, T>) -> Result<Factor<'_, T>, SparseError> {
        assert_eq!(self.block, T::UNKNOWNS, "unknowns in a row of what was analysed");
        assert_eq!(self.lower.rows, self.block * matrix.pattern().rows(), "the pattern that was analysed");
        let values = self.factor_values(&self.lower.gather(matrix)?)?;
        Ok(Factor { of: self, values })
    }

    /// The values of the factor of a matrix whose lower triangle is `values`, in the order of
    /// [`Lower`].
    pub(super) fn factor_values<T: ComplexField>(&self, values: &[T]) -> Result<Vec<T>, SparseError> {
        let rows = self.lower.rows;
        let matrix = SparseColMatRef::new(self.lower.symbolic(), values);
        let too_large = SparseError::TooLarge { rows };
        let mut factor = Vec::new();
        factor.try_reserve_exact(self.symbolic.len_val()).map_err(|_| too_large.clone())?;
        factor.resize(self.symbolic.len_val(), T::zero_impl());
        let scratch = self.symbolic.factorize_numeric_llt_scratch::<T>(Par::Seq, Default::default());
        let mut memory = MemBuffer::try_new(scratch).map_err(|_| too_large.clone())?;
        let done = self.symbolic.factorize_numeric_llt(
            &mut factor,
            matrix,
            Side::Lower,
            Default::default(),
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        );
        match done {
            Ok(_) => Ok(factor),
            Err(LltError::NonPositivePivot { index }) => {
                // faer counts pivots in the order of elimination.
                let order = self.symbolic.perm().map(|p| p.arrays().0);
                let row = order.and_then(|o| o.get(index)).map_or(index, |&i| i as usize) / self.block;
                Err(SparseError::NotPositiveDefinite { row })
            }
        }
    }

    /// Solves for several right-hand sides, one after the other in `rhs`.
    pub(super) fn solve_columns<T: ComplexField + Copy>(
        &self,
        factor: &[T],
        rhs: &mut [T],
        columns: usize,
    ) -> Result<(), SparseError> {
        let rows = self.lower.rows;
        let scratch = self.symbolic.solve_in_place_scratch::<T>(columns, Par::Seq);
        let mut memory = MemBuffer::try_new(scratch).map_err(|_| SparseError::TooLarge { rows })?;
        LltRef::new(&self.symbolic, factor).solve_in_place_with_conj(
            faer::Conj::No,
            MatMut::from_column_major_slice_mut(rhs, rows, columns),
            Par::Seq,
            MemStack::new(&mut memory),
        );
        Ok(())
    }

    pub(super) fn symbolic(&self) -> &SymbolicCholesky<u32> {
        &self.symbolic
    }

    pub(super) fn lower(&self) -> &Lower {
        &self.lower
    }
}

/// A factored matrix.
#[derive(Debug)]
pub struct Factor<'c, T: Numbers> {
    of: &'c Cholesky,
    values: Vec<T::Number>,
}

impl<T: Numbers> Factor<'_, T> {
    /// Solves for one right-hand side, in place: one entry per row, a vector where the matrix has blocks or
    /// complex numbers.
    ///
    /// # Errors
    /// [`SparseError::TooLarge`] without memory for a copy of `rhs`.
    ///
    /// # Panics
    /// If `rhs` has another length.
    pub fn solve(&self, rhs: &mut [T::Row]) -> Result<(), SparseError> {
        let mut x: Vec<T::Number> = rhs.iter().flat_map(|&row| T::numbers(row)).collect();
        assert_eq!(x.len(), self.of.lower.rows, "one right-hand side per row");
        self.of.solve_columns(&self.values, &mut x, 1)?;
        for (row, numbers) in rhs.iter_mut().zip(x.chunks_exact(T::UNKNOWNS)) {
            *row = T::row(numbers);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;

    /// The path of `n` rows with 2 on the diagonal and -1 next to it, the one matrix everyone can
    /// invert.
    fn path(n: usize) -> Pattern {
        Pattern::new(n, (1..n).map(|i| (i - 1, i)))
    }

    #[test]
    fn the_second_difference_of_a_parabola_is_constant() {
        let pattern = path(50);
        let mut m = Matrix::zero(&pattern);
        for i in 0..50 {
            *m.at(i, i) = 2.0;
            if i > 0 {
                *m.at(i, i - 1) = -1.0;
            }
        }
        let cholesky = Cholesky::new(&pattern, &[]).unwrap();
        let mut x = vec![2.0; 50];
        cholesky.factor(&m).unwrap().solve(&mut x).unwrap();
        for (i, x) in x.iter().enumerate() {
            let (k, n) = (i as f64 + 1.0, 51.0);
            assert!((x - k * (n - k)).abs() < 1e-10, "x[{i}] = {x}, k (n - k) = {}", k * (n - k));
        }
    }

    #[test]
    fn a_hermitian_system_gives_back_its_solution() {
        let pattern = path(9);
        let mut m = Matrix::<DVec2>::zero(&pattern);
        for i in 0..9 {
            *m.at(i, i) = DVec2::new(3.0, 0.0);
            if i > 0 {
                *m.at(i, i - 1) = DVec2::new(-1.0, 0.5);
            }
        }
        let truth: Vec<DVec2> = (0..9).map(|i| DVec2::from_angle(f64::from(i)) * f64::from(i + 1)).collect();
        let conj = |z: DVec2| DVec2::new(z.x, -z.y);
        let below = DVec2::new(-1.0, 0.5);
        let mut x: Vec<DVec2> = (0..9)
            .map(|i| {
                let mut sum = 3.0 * truth[i];
                if i > 0 {
                    sum += below.rotate(truth[i - 1]);
                }
                if i < 8 {
                    sum += conj(below).rotate(truth[i + 1]);
                }
                sum
            })
            .collect();
        let cholesky = Cholesky::new(&pattern, &[]).unwrap();
        cholesky.factor(&m).unwrap().solve(&mut x).unwrap();
        assert!(x.iter().zip(&truth).all(|(a, b)| a.distance(*b) < 1e-12), "{x:?} is {truth:?}");
    }

    #[test]
    fn an_indefinite_matrix_is_refused_with_its_row() {
        let pattern = Pattern::new(1, []);
        let mut m = Matrix::zero(&pattern);
        *m.at(0, 0) = -1.0;
        let found = Cholesky::new(&pattern, &[]).unwrap().factor(&m).err();
        assert_eq!(found, Some(SparseError::NotPositiveDefinite { row: 0 }));
    }

    #[test]
    fn nan_is_refused_with_its_row() {
        let pattern = path(3);
        let mut m = Matrix::zero(&pattern);
        *m.at(2, 1) = f64::NAN;
        let found = Cholesky::new(&pattern, &[]).unwrap().factor(&m).err();
        assert_eq!(found, Some(SparseError::NotFinite { row: 2 }));
    }
}
