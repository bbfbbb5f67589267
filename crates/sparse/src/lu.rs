//! LU factorization of complex matrices that are not Hermitian.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::LuError;
use faer::sparse::linalg::lu::{NumericLu, factorize_symbolic_lu};
use faer::sparse::{FaerError, SparseColMatRef, SymbolicSparseColMatRef};
use faer::{MatMut, Par};
use glam::DVec2;

use crate::lower::{Complex, Numbers};
use crate::{Matrix, SparseError};

/// Solves one system with any complex matrix on a symmetric pattern by LU with partial pivoting, in
/// place.
///
/// # Errors
/// [`SparseError::Singular`], [`SparseError::NotFinite`] or [`SparseError::TooLarge`].
///
/// # Panics
/// If `rhs` does not have one entry per row.
pub fn solve_unsymmetric(matrix: &Matrix<'_, DVec2>, rhs: &mut [DVec2]) -> Result<(), SparseError> {
    let pattern = matrix.pattern();
    let rows = pattern.rows();
    assert_eq!(rhs.len(), rows, "one right-hand side per row");
    let (mut starts, mut indices, mut values) = (vec![0_u32], Vec::new(), Vec::new());
    for column in 0..rows {
        // The pattern is symmetric, so the entries of a row give those of the column.
        for &row in pattern.columns(column) {
            let slot = pattern.slot(row as usize, column).expect("patterns are symmetric");
            let value = matrix.values()[slot].number(0, 0);
            if !value.is_finite() {
                return Err(SparseError::NotFinite { row: row as usize });
            }
            indices.push(row);
            values.push(value);
        }
        starts.push(u32::try_from(indices.len()).map_err(|_| SparseError::TooLarge { rows })?);
    }
    let shape = SymbolicSparseColMatRef::new_checked(rows, rows, &starts, None, &indices);
    let mut x: Vec<Complex> = rhs.iter().map(|z| z.number(0, 0)).collect();
    lower_upper(SparseColMatRef::new(shape, &values), &mut x).map_err(|e| match e {
        LuError::SymbolicSingular { .. } => SparseError::Singular { rows },
        LuError::Generic(_) => SparseError::TooLarge { rows },
    })?;
    for (out, z) in rhs.iter_mut().zip(x) {
        if !z.is_finite() {
            return Err(SparseError::Singular { rows });
        }
        *out = DVec2::row(&[z]);
    }
    Ok(())
}

fn lower_upper(matrix: SparseColMatRef<'_, u32, Complex>, x: &mut [Complex]) -> Result<(), LuError> {
    let symbolic = factorize_symbolic_lu(matrix.symbolic(), Default::default())?;
    let mut numeric = NumericLu::new();
    let scratch = symbolic.factorize_numeric_lu_scratch::<Complex>(Par::Seq, Default::default());
    let mut memory = MemBuffer::try_new(scratch).map_err(FaerError::from)?;
    let factor = symbolic.factorize_numeric_lu(
        &mut numeric,
        matrix,
        Par::Seq,
        MemStack::new(&mut memory),
        Default::default(),
    )?;
    let scratch = symbolic.solve_in_place_scratch::<Complex>(1, Par::Seq);
    let mut memory = MemBuffer::try_new(scratch).map_err(FaerError::from)?;
    let rows = x.len();
    factor.solve_in_place_with_conj(
        faer::Conj::No,
        MatMut::from_column_major_slice_mut(x, rows, 1),
        Par::Seq,
        MemStack::new(&mut memory),
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Pattern;

    /// The path of `n` rows with 2 on the diagonal and -1 next to it, the one matrix everyone can
    /// invert.
    fn path(n: usize) -> Pattern {
        Pattern::new(n, (1..n).map(|i| (i - 1, i)))
    }

    #[test]
    fn an_unsymmetric_system_gives_back_its_solution() {
        let pattern = path(4);
        let mut m = Matrix::<DVec2>::zero(&pattern);
        for i in 0..4 {
            *m.at(i, i) = DVec2::X;
            if i > 0 {
                *m.at(i, i - 1) = DVec2::new(0.0, 2.0);
            }
        }
        let mut x = vec![DVec2::X; 4];
        solve_unsymmetric(&m, &mut x).unwrap();
        // x_i = 1 - 2i x_{i-1}.
        assert_eq!(x[1], DVec2::new(1.0, -2.0));
        assert_eq!(x[2], DVec2::new(-3.0, -2.0));
    }

    #[test]
    fn a_singular_unsymmetric_matrix_is_refused() {
        let pattern = path(3);
        let mut x = vec![DVec2::X; 3];
        let found = solve_unsymmetric(&Matrix::zero(&pattern), &mut x);
        assert_eq!(found, Err(SparseError::Singular { rows: 3 }));
    }
}
