use faer::{
    MatMut, Par, Side,
    dyn_stack::{MemBuffer, MemStack},
    linalg::cholesky::llt::factor::LltError,
    perm::PermRef,
    sparse::{
        FaerError, SparseColMatRef, SymbolicSparseColMatRef,
        linalg::{
            LuError, SupernodalThreshold, amd,
            cholesky::{
                CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering,
                factorize_symbolic_cholesky,
            },
            lu::{NumericLu, factorize_symbolic_lu},
        },
    },
    traits::ComplexField,
};
use glam::{DMat2, DVec2, DVec3};

use crate::sparse::{Matrix, Pattern, SparseError, dissection::dissect};

type Complex = faer::c64;

/// From this many rows on the order comes from coordinates: the minimum degree order of faer takes longer than the
/// factorization there (measured on cotangent Laplacians, 0.18 s against 0.06 s at 100 000 rows).
const DISSECTION_ROWS: usize = 20_000;

/// The order and the symbolic factor of a [`Pattern`], good for every positive definite [`Matrix`] on it.
///
/// `L L*` without pivoting, supernodal. It runs on the calling thread: faer's own threads cost more than they
/// gain on the small supernodes of meshes.
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
        let order = if pattern.rows() >= DISSECTION_ROWS && coordinates.len() == pattern.rows() {
            dissect(pattern, coordinates)
        } else {
            minimum_degree(pattern).map_err(too_large)?
        };
        let lower = Lower::new(pattern, block).ok_or(SparseError::TooLarge { rows: pattern.rows() })?;
        let size = u32::try_from(block).unwrap_or(1);
        let forward: Vec<u32> = order.iter().flat_map(|&i| (0..size).map(move |a| size * i + a)).collect();
        let mut inverse = vec![0; forward.len()];
        for (k, &i) in forward.iter().enumerate() {
            inverse[i as usize] = u32::try_from(k).unwrap_or(u32::MAX);
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

    /// Factors a real symmetric matrix on the pattern that was analysed; only its lower triangle is read.
    ///
    /// # Errors
    /// [`SparseError::NotPositiveDefinite`], [`SparseError::NotFinite`] or [`SparseError::TooLarge`].
    ///
    /// # Panics
    /// If the matrix has another pattern.
    pub fn factor(&self, matrix: &Matrix<'_, f64>) -> Result<Factor<'_>, SparseError> {
        assert_eq!(self.block, 1, "analysed for blocks");
        self.numeric(|slot, _, _| matrix.values()[slot], matrix.pattern())
            .map(|values| Factor { of: self, values })
    }

    /// Factors a real symmetric matrix of 2 x 2 blocks; only its lower triangle is read.
    ///
    /// # Errors
    /// As [`Cholesky::factor`].
    ///
    /// # Panics
    /// If the matrix has another pattern.
    pub fn factor_blocks(&self, matrix: &Matrix<'_, DMat2>) -> Result<Factor<'_>, SparseError> {
        assert_eq!(self.block, 2, "analysed for single entries");
        self.numeric(|slot, a, b| matrix.values()[slot].col(b)[a], matrix.pattern())
            .map(|values| Factor { of: self, values })
    }

    /// Factors a complex Hermitian matrix; only its lower triangle is read.
    ///
    /// # Errors
    /// As [`Cholesky::factor`].
    ///
    /// # Panics
    /// If the matrix has another pattern.
    pub fn factor_hermitian(&self, matrix: &Matrix<'_, DVec2>) -> Result<HermitianFactor<'_>, SparseError> {
        assert_eq!(self.block, 1, "analysed for blocks");
        self.numeric(|slot, _, _| complex(matrix.values()[slot]), matrix.pattern())
            .map(|values| HermitianFactor { of: self, values })
    }

    /// The values of the factor; `entry(slot, a, b)` is row `a` and column `b` of the block in `slot`.
    fn numeric<T: ComplexField + Copy + Finite>(
        &self,
        entry: impl Fn(usize, usize, usize) -> T,
        pattern: &Pattern,
    ) -> Result<Vec<T>, SparseError> {
        assert_eq!(self.lower.rows, self.block * pattern.rows(), "the pattern that was analysed");
        self.factor_values(&self.lower.gather(pattern, self.block, entry)?)
    }

    /// The values of the factor of a matrix whose lower triangle is `values`, in the order of [`Lower`].
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

    fn solve<T: ComplexField + Copy>(&self, factor: &[T], rhs: &mut [T]) -> Result<(), SparseError> {
        assert_eq!(rhs.len(), self.lower.rows, "one right-hand side per unknown");
        self.solve_columns(factor, rhs, 1)
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

/// A factored real matrix.
#[derive(Debug)]
pub struct Factor<'c> {
    of: &'c Cholesky,
    values: Vec<f64>,
}

impl Factor<'_> {
    /// Solves for one right-hand side, in place: one entry per row, or two where the matrix has blocks.
    ///
    /// # Errors
    /// [`SparseError::TooLarge`] without memory for a copy of `rhs`.
    ///
    /// # Panics
    /// If `rhs` has another length.
    pub fn solve(&self, rhs: &mut [f64]) -> Result<(), SparseError> {
        self.of.solve(&self.values, rhs)
    }
}

/// A factored complex Hermitian matrix.
#[derive(Debug)]
pub struct HermitianFactor<'c> {
    of: &'c Cholesky,
    values: Vec<Complex>,
}

impl HermitianFactor<'_> {
    /// Solves for one right-hand side of complex numbers (real, imaginary), in place.
    ///
    /// # Errors
    /// [`SparseError::TooLarge`] without memory for a copy of `rhs`.
    ///
    /// # Panics
    /// If `rhs` has not one entry per row.
    pub fn solve(&self, rhs: &mut [DVec2]) -> Result<(), SparseError> {
        let mut x: Vec<Complex> = rhs.iter().map(|&z| complex(z)).collect();
        self.of.solve(&self.values, &mut x)?;
        for (out, z) in rhs.iter_mut().zip(x) {
            *out = DVec2::new(z.re, z.im);
        }
        Ok(())
    }
}

/// Solves one system with any complex matrix on a symmetric pattern by LU with partial pivoting, in place.
///
/// # Errors
/// [`SparseError::Singular`], [`SparseError::NotFinite`] or [`SparseError::TooLarge`].
///
/// # Panics
/// If `rhs` has not one entry per row.
pub fn solve_unsymmetric(matrix: &Matrix<'_, DVec2>, rhs: &mut [DVec2]) -> Result<(), SparseError> {
    let pattern = matrix.pattern();
    let rows = pattern.rows();
    assert_eq!(rhs.len(), rows, "one right-hand side per row");
    let (mut starts, mut indices, mut values) = (vec![0_u32], Vec::new(), Vec::new());
    for column in 0..rows {
        // The pattern is symmetric, so a row tells where the column's entries are.
        for &row in pattern.columns(column) {
            let slot = pattern.slot(row as usize, column).ok_or(SparseError::Singular { rows })?;
            let value = complex(matrix.values()[slot]);
            if !value.finite() {
                return Err(SparseError::NotFinite { row: row as usize });
            }
            indices.push(row);
            values.push(value);
        }
        starts.push(u32::try_from(indices.len()).map_err(|_| SparseError::TooLarge { rows })?);
    }
    let shape = SymbolicSparseColMatRef::new_checked(rows, rows, &starts, None, &indices);
    let mut x: Vec<Complex> = rhs.iter().map(|&z| complex(z)).collect();
    lower_upper(SparseColMatRef::new(shape, &values), &mut x).map_err(|e| match e {
        LuError::SymbolicSingular { .. } => SparseError::Singular { rows },
        LuError::Generic(_) => SparseError::TooLarge { rows },
    })?;
    for (out, z) in rhs.iter_mut().zip(x) {
        if !z.finite() {
            return Err(SparseError::Singular { rows });
        }
        *out = DVec2::new(z.re, z.im);
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

/// The lower triangle of a pattern, blocks expanded, column by column as faer reads it.
#[derive(Debug)]
pub(super) struct Lower {
    rows: usize,
    pub(super) starts: Vec<u32>,
    pub(super) indices: Vec<u32>,
}

impl Lower {
    /// `None` if it has more than 2^32 entries.
    fn new(pattern: &Pattern, block: usize) -> Option<Self> {
        let (mut starts, mut indices) = (vec![0], Vec::new());
        for j in 0..pattern.rows() {
            for b in 0..block {
                let column = block * j + b;
                let below =
                    pattern.columns(j).iter().flat_map(|&i| (0..block).map(move |a| block * i as usize + a));
                for row in below.filter(|&row| row >= column) {
                    indices.push(u32::try_from(row).ok()?);
                }
                starts.push(u32::try_from(indices.len()).ok()?);
            }
        }
        Some(Self { rows: block * pattern.rows(), starts, indices })
    }

    fn symbolic(&self) -> SymbolicSparseColMatRef<'_, u32> {
        SymbolicSparseColMatRef::new_checked(self.rows, self.rows, &self.starts, None, &self.indices)
    }

    /// The entries of the lower triangle in this order.
    fn gather<T: Finite>(
        &self,
        pattern: &Pattern,
        block: usize,
        entry: impl Fn(usize, usize, usize) -> T,
    ) -> Result<Vec<T>, SparseError> {
        let mut values = Vec::with_capacity(self.indices.len());
        for j in 0..pattern.rows() {
            for b in 0..block {
                // Entry (i, j) below the diagonal: found from row i, so that only the lower triangle is read.
                for &i in pattern.columns(j).iter().filter(|&&i| i as usize >= j) {
                    let slot = pattern.slot(i as usize, j).ok_or(SparseError::NotFinite { row: j })?;
                    for a in 0..block {
                        if block * i as usize + a >= block * j + b {
                            let value = entry(slot, a, b);
                            if !value.finite() {
                                return Err(SparseError::NotFinite { row: i as usize });
                            }
                            values.push(value);
                        }
                    }
                }
            }
        }
        Ok(values)
    }
}

/// Approximate minimum degree order of the rows.
fn minimum_degree(pattern: &Pattern) -> Result<Vec<u32>, FaerError> {
    let rows = pattern.rows();
    let (mut order, mut inverse) = (vec![0_u32; rows], vec![0_u32; rows]);
    let upper = Lower::new(pattern, 1).ok_or(FaerError::IndexOverflow)?;
    let scratch = amd::order_maybe_unsorted_scratch::<u32>(rows, upper.indices.len());
    let mut memory = MemBuffer::try_new(scratch).map_err(FaerError::from)?;
    amd::order_maybe_unsorted(
        &mut order,
        &mut inverse,
        upper.symbolic(),
        Default::default(),
        MemStack::new(&mut memory),
    )?;
    Ok(order)
}

fn complex(z: DVec2) -> Complex {
    Complex::new(z.x, z.y)
}

/// Numbers that can be asked whether they are finite.
trait Finite {
    fn finite(&self) -> bool;
}

impl Finite for f64 {
    fn finite(&self) -> bool {
        self.is_finite()
    }
}

impl Finite for Complex {
    fn finite(&self) -> bool {
        self.re.is_finite() && self.im.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The path of `n` rows with 2 on the diagonal and -1 beside it, the one matrix everyone can invert.
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
        cholesky.factor_hermitian(&m).unwrap().solve(&mut x).unwrap();
        assert!(x.iter().zip(&truth).all(|(a, b)| a.distance(*b) < 1e-12), "{x:?} is {truth:?}");
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

    #[test]
    fn a_singular_unsymmetric_matrix_is_refused() {
        let pattern = path(3);
        let mut x = vec![DVec2::X; 3];
        let found = solve_unsymmetric(&Matrix::zero(&pattern), &mut x);
        assert_eq!(found, Err(SparseError::Singular { rows: 3 }));
    }
}
