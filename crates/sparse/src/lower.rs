//! The lower triangle of a matrix, as faer reads it, and the numbers that faer computes with.

use faer::{sparse::SymbolicSparseColMatRef, traits::ComplexField};
use glam::{DMat2, DVec2};

use crate::{Entry, Matrix, Pattern, SparseError};

/// The lower triangle of a pattern, blocks expanded, column by column as faer reads it.
#[derive(Debug)]
pub(crate) struct Lower {
    pub(crate) rows: usize,
    pub(crate) starts: Vec<u32>,
    pub(crate) indices: Vec<u32>,
}

impl Lower {
    /// `None` if it has more than 2^32 entries.
    pub(crate) fn new(pattern: &Pattern, block: usize) -> Option<Self> {
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

    pub(crate) fn symbolic(&self) -> SymbolicSparseColMatRef<'_, u32> {
        SymbolicSparseColMatRef::new_checked(self.rows, self.rows, &self.starts, None, &self.indices)
    }

    /// The numbers of the lower triangle in this order.
    pub(crate) fn gather<T: Numbers>(&self, matrix: &Matrix<'_, T>) -> Result<Vec<T::Number>, SparseError> {
        let pattern = matrix.pattern();
        let mut values = Vec::with_capacity(self.indices.len());
        for j in 0..pattern.rows() {
            for b in 0..T::UNKNOWNS {
                // Entry (i, j) below the diagonal: found from row i, so that only the lower
                // triangle is read.
                for &i in pattern.columns(j).iter().filter(|&&i| i as usize >= j) {
                    let slot = pattern.slot(i as usize, j).expect("patterns are symmetric");
                    // Of a block on the diagonal the rows on and below its diagonal.
                    for a in if i as usize == j { b } else { 0 }..T::UNKNOWNS {
                        let value = matrix.values()[slot].number(a, b);
                        if !ComplexField::is_finite_impl(&value) {
                            return Err(SparseError::NotFinite { row: i as usize });
                        }
                        values.push(value);
                    }
                }
            }
        }
        Ok(values)
    }
}

/// An [`Entry`] that can be factored, as numbers.
pub trait Numbers: Entry {
    /// The type of number that faer computes with.
    type Number: ComplexField + Copy;
    /// The unknowns of a row, or its right-hand side.
    type Row: Copy;
    /// Numbers in a row.
    const UNKNOWNS: usize;
    /// Row `a` and column `b` of the entry.
    fn number(self, a: usize, b: usize) -> Self::Number;
    /// The numbers of a row.
    fn numbers(row: Self::Row) -> impl Iterator<Item = Self::Number>;
    /// The row of some numbers.
    fn row(numbers: &[Self::Number]) -> Self::Row;
}

impl Numbers for f64 {
    type Number = Self;
    type Row = Self;
    const UNKNOWNS: usize = 1;

    fn number(self, _: usize, _: usize) -> Self {
        self
    }

    fn numbers(row: Self) -> impl Iterator<Item = Self> {
        [row].into_iter()
    }

    fn row(numbers: &[Self]) -> Self {
        numbers[0]
    }
}

impl Numbers for DVec2 {
    type Number = Complex;
    type Row = Self;
    const UNKNOWNS: usize = 1;

    fn number(self, _: usize, _: usize) -> Complex {
        Complex::new(self.x, self.y)
    }

    fn numbers(row: Self) -> impl Iterator<Item = Complex> {
        [row.number(0, 0)].into_iter()
    }

    fn row(numbers: &[Complex]) -> Self {
        Self::new(numbers[0].re, numbers[0].im)
    }
}

impl Numbers for DMat2 {
    type Number = f64;
    type Row = DVec2;
    const UNKNOWNS: usize = 2;

    fn number(self, a: usize, b: usize) -> f64 {
        self.col(b)[a]
    }

    fn numbers(row: DVec2) -> impl Iterator<Item = f64> {
        row.to_array().into_iter()
    }

    fn row(numbers: &[f64]) -> DVec2 {
        DVec2::from_slice(numbers)
    }
}

pub(crate) type Complex = faer::c64;
