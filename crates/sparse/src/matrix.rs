//! Numbers on a pattern.

use glam::{DMat2, DVec2};
use rayon::prelude::*;

use crate::{Pattern, lower::Numbers};

/// Rows that one task multiplies; fixed, so that results do not depend on the number of threads.
const ROWS_PER_TASK: usize = 2048;

/// What can stand in a matrix.
///
/// Not `Default`: that of a `DMat2` is the identity.
pub trait Entry: Numbers + Send + Sync {
    /// The entry of the zero matrix.
    const ZERO: Self;
}

impl Entry for f64 {
    const ZERO: Self = 0.0;
}

impl Entry for DVec2 {
    const ZERO: Self = Self::ZERO;
}

impl Entry for DMat2 {
    const ZERO: Self = Self::ZERO;
}

/// Entries on a [`Pattern`]: `f64`, complex numbers as `DVec2` (real, imaginary), or real 2 x 2
/// blocks as `DMat2`.
#[derive(Debug, Clone)]
pub struct Matrix<'p, T> {
    pattern: &'p Pattern,
    values: Vec<T>,
}

impl<'p, T: Entry> Matrix<'p, T> {
    /// The zero matrix.
    #[must_use]
    pub fn zero(pattern: &'p Pattern) -> Self {
        Self { pattern, values: vec![T::ZERO; pattern.entries()] }
    }

    /// Which entries there are.
    #[must_use]
    pub fn pattern(&self) -> &'p Pattern {
        self.pattern
    }

    /// The entries, slot by slot.
    #[must_use]
    pub fn values(&self) -> &[T] {
        &self.values
    }

    /// The entries, slot by slot.
    #[must_use]
    pub fn values_mut(&mut self) -> &mut [T] {
        &mut self.values
    }

    /// The entry in `row` and `column`.
    ///
    /// # Panics
    /// If the pattern has no such entry.
    pub fn at(&mut self, row: usize, column: usize) -> &mut T {
        let slot = self.pattern.slot(row, column);
        &mut self.values[slot.expect("an entry of the pattern")]
    }

    /// The diagonal entry of `row`.
    #[must_use]
    pub fn diagonal(&self, row: usize) -> T {
        self.pattern.slot(row, row).map_or(T::ZERO, |slot| self.values[slot])
    }
}

impl<T: Entry> Matrix<'_, T> {
    /// Sets the matrix row by row: `fill(row, entries)` gets the entries of one row, all zero, in
    /// the order of [`Pattern::columns`]. Rows are filled side by side.
    pub fn fill_rows(&mut self, fill: impl Fn(usize, &mut [T]) + Sync) {
        let rows = self.pattern.rows();
        let mut tasks = Vec::with_capacity(rows / ROWS_PER_TASK + 1);
        let mut rest = self.values.as_mut_slice();
        for first in (0..rows).step_by(ROWS_PER_TASK) {
            let last = (first + ROWS_PER_TASK).min(rows);
            let count = self.pattern.slots(last - 1).end - self.pattern.slots(first).start;
            let (part, behind) = rest.split_at_mut(count);
            tasks.push((first..last, part));
            rest = behind;
        }
        tasks.into_par_iter().for_each(|(range, part)| {
            let offset = self.pattern.slots(range.start).start;
            part.fill(T::ZERO);
            for row in range {
                let slots = self.pattern.slots(row);
                fill(row, &mut part[slots.start - offset..slots.end - offset]);
            }
        });
    }
}

impl Matrix<'_, DMat2> {
    /// `out = M x`, two unknowns a row.
    ///
    /// # Panics
    /// If `x` or `out` has not one entry per row.
    pub(crate) fn multiply(&self, x: &[DVec2], out: &mut [DVec2]) {
        assert!(x.len() == self.pattern.rows() && out.len() == x.len(), "one entry per row");
        out.par_chunks_mut(ROWS_PER_TASK).enumerate().for_each(|(chunk, out)| {
            for (k, out) in out.iter_mut().enumerate() {
                let row = chunk * ROWS_PER_TASK + k;
                let blocks = &self.values[self.pattern.slots(row)];
                let columns = self.pattern.columns(row);
                *out = columns.iter().zip(blocks).map(|(&j, block)| *block * x[j as usize]).sum();
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `DMat2::default()` is the identity; a matrix that starts from it is far too stiff and
    /// nothing else shows it.
    #[test]
    fn the_zero_matrix_is_zero() {
        let pattern = Pattern::new(2, [(0, 1)]);
        let mut m = Matrix::<DMat2>::zero(&pattern);
        let mut out = [DVec2::ONE; 2];
        m.multiply(&[DVec2::ONE; 2], &mut out);
        assert_eq!(out, [DVec2::ZERO; 2]);
        m.fill_rows(|_, _| {});
        m.multiply(&[DVec2::ONE; 2], &mut out);
        assert_eq!(out, [DVec2::ZERO; 2], "rows are cleared before they are filled");
    }
}
