//! Numbers on a pattern.

use glam::{DMat2, DVec2, Mat2};

use crate::Pattern;

/// The type of the entries of a matrix.
///
/// Not `Default`: that of a `DMat2` is the identity.
pub trait Entry: Copy + Send + Sync {
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

impl Entry for Mat2 {
    const ZERO: Self = Self::ZERO;
}

/// Entries on a [`Pattern`]: `f64`, complex numbers as `DVec2` (real, imaginary), or real 2 x 2
/// blocks as `DMat2` or `Mat2`.
#[derive(Debug, Clone)]
pub struct Matrix<'p, T> {
    pattern: &'p Pattern,
    values: Vec<T>,
}

impl<'p, T: Entry> Matrix<'p, T> {
    /// The zero matrix.
    pub fn zero(pattern: &'p Pattern) -> Self {
        Self { pattern, values: vec![T::ZERO; pattern.entries()] }
    }

    /// Which entries there are.
    pub fn pattern(&self) -> &'p Pattern {
        self.pattern
    }

    /// The entries, slot by slot.
    pub fn values(&self) -> &[T] {
        &self.values
    }

    /// The entries, slot by slot.
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
    pub fn diagonal(&self, row: usize) -> T {
        self.pattern.slot(row, row).map_or(T::ZERO, |slot| self.values[slot])
    }
}

impl<T: Entry> Matrix<'_, T> {
    /// The entries of the first `rows` rows, of the next ones, and so on, to set them in parallel.
    pub fn parts_mut(&mut self, rows: usize) -> Vec<&mut [T]> {
        let count = self.pattern.rows();
        let mut rest = self.values.as_mut_slice();
        let mut parts = Vec::with_capacity(count.div_ceil(rows));
        for first in (0..count).step_by(rows) {
            let last = (first + rows).min(count) - 1;
            let (part, behind) =
                rest.split_at_mut(self.pattern.slots(last).end - self.pattern.slots(first).start);
            parts.push(part);
            rest = behind;
        }
        parts
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
        assert_eq!(Matrix::<DMat2>::zero(&pattern).values(), [DMat2::ZERO; 4]);
    }

    #[test]
    fn parts_are_whole_rows() {
        let pattern = Pattern::new(5, [(0, 1), (2, 4)]);
        let mut m = Matrix::<f64>::zero(&pattern);
        let lengths: Vec<usize> = m.parts_mut(2).iter().map(|part| part.len()).collect();
        assert_eq!(lengths, [4, 3, 2]);
    }
}
