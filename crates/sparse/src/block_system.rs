//! Symmetric matrices of blocks of any size, their factors and selected inverses.

use faer::sparse::linalg::cholesky::{SymbolicCholeskyRaw, supernodal::SupernodalLltRef};

use crate::selected_inverse::{SelectedInverse, invert};
use crate::{Cholesky, Pattern, SparseError};

/// A pivot this far below its diagonal entry is rounding, not information: the matrix is singular
/// there.
const SMALLEST_PIVOT: f64 = 1e-13;

/// Symmetric matrices of small square blocks, all on one [`Pattern`]: order, symbolic factor and
/// layout.
///
/// The order is found on the pattern of blocks, which is much smaller than that of the entries, and
/// the symbolic factor is computed once. Entries are assembled in place: there is no list of
/// triplets.
#[derive(Debug)]
pub struct BlockSystem {
    cholesky: Cholesky,
    pattern: Pattern,
    size: usize,
}

/// The position of a block on or below the diagonal in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlockSlot {
    column: u32,
    /// 0 for the block on the diagonal, then counting downwards.
    rank: u32,
}

impl BlockSlot {
    /// The block on the diagonal of `row`.
    pub const fn diagonal(row: u32) -> Self {
        Self { column: row, rank: 0 }
    }
}

impl BlockSystem {
    /// Orders and analyses `pattern` for blocks of `size` rows.
    ///
    /// # Errors
    /// [`SparseError::TooLarge`].
    pub fn new(pattern: Pattern, size: usize) -> Result<Self, SparseError> {
        let cholesky = Cholesky::analyse(&pattern, &[], size)?;
        Ok(Self { cholesky, pattern, size })
    }

    /// Rows of one block.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Number of block rows.
    pub fn blocks(&self) -> usize {
        self.pattern.rows()
    }

    /// The slot of block (`row`, `column`), `row >= column`, if the pattern has it.
    pub fn slot(&self, row: usize, column: usize) -> Option<BlockSlot> {
        let at = |row| self.pattern.slot(column, row);
        let rank = at(row)?.checked_sub(at(column)?)?;
        Some(BlockSlot { column: u32::try_from(column).ok()?, rank: u32::try_from(rank).ok()? })
    }

    /// The zero matrix.
    pub fn zero(&self) -> BlockMatrix<'_> {
        BlockMatrix { system: self, values: vec![0.0; self.cholesky.lower().indices.len()] }
    }

    /// Where column `b` of a block below the diagonal starts; above it in the column are `rank`
    /// blocks, of which the one on the diagonal lacks its first `b` rows.
    fn offset(&self, slot: BlockSlot, b: usize) -> usize {
        let start = self.cholesky.lower().starts[self.size * slot.column as usize + b] as usize;
        start + self.size * slot.rank as usize - b
    }
}

/// A symmetric matrix of blocks; only its lower triangle is stored.
#[derive(Debug, Clone)]
pub struct BlockMatrix<'s> {
    system: &'s BlockSystem,
    values: Vec<f64>,
}

impl<'s> BlockMatrix<'s> {
    /// Adds `entry(a, b)` to row `a` and column `b` of a block. For a block on the diagonal, `entry` is
    /// called only on and below the diagonal.
    #[inline]
    pub fn add(&mut self, slot: BlockSlot, entry: impl Fn(usize, usize) -> f64) {
        let size = self.system.size;
        if slot.rank == 0 {
            let starts = &self.system.cholesky.lower().starts[size * slot.column as usize..];
            for (b, &start) in starts.iter().enumerate().take(size) {
                let column = &mut self.values[start as usize..][..size - b];
                for (k, value) in column.iter_mut().enumerate() {
                    *value += entry(b + k, b);
                }
            }
        } else {
            for b in 0..size {
                let start = self.system.offset(slot, b);
                for (a, value) in self.values[start..start + size].iter_mut().enumerate() {
                    *value += entry(a, b);
                }
            }
        }
    }

    /// The entries on the diagonal.
    pub fn diagonal(&self) -> Vec<f64> {
        let starts = &self.system.cholesky.lower().starts;
        starts[..starts.len() - 1].iter().map(|&s| self.values[s as usize]).collect()
    }

    /// The entries on the diagonal of one block row.
    pub fn diagonal_of(&self, row: u32) -> Vec<f64> {
        let size = self.system.size;
        let starts = &self.system.cholesky.lower().starts[size * row as usize..];
        starts[..size].iter().map(|&s| self.values[s as usize]).collect()
    }

    /// Adds one number per row to the diagonal.
    ///
    /// # Panics
    /// If there are fewer numbers than rows.
    pub fn add_diagonal(&mut self, numbers: &[f64]) {
        let starts = &self.system.cholesky.lower().starts;
        for (row, &start) in starts[..starts.len() - 1].iter().enumerate() {
            self.values[start as usize] += numbers[row];
        }
    }

    /// Factors the matrix.
    ///
    /// # Errors
    /// [`SparseError::NotFinite`], [`SparseError::NotPositiveDefinite`] with the block row, also where a
    /// pivot is positive only by rounding, or [`SparseError::TooLarge`].
    pub fn factor(&self) -> Result<BlockFactor<'s>, SparseError> {
        let system = self.system;
        if let Some(k) = self.values.iter().position(|x| !x.is_finite()) {
            return Err(SparseError::NotFinite {
                row: system.cholesky.lower().indices[k] as usize / system.size,
            });
        }
        let factor = BlockFactor { system, values: system.cholesky.factor_values(&self.values)? };
        factor.check_pivots(&self.diagonal())?;
        Ok(factor)
    }
}

/// A factored matrix of blocks.
#[derive(Debug)]
pub struct BlockFactor<'s> {
    system: &'s BlockSystem,
    values: Vec<f64>,
}

impl BlockFactor<'_> {
    /// Solves in place for `columns` right-hand sides, one after the other in `rhs`.
    ///
    /// # Errors
    /// [`SparseError::TooLarge`] without memory for a copy of `rhs`.
    ///
    /// # Panics
    /// If `rhs` has another length than `columns` times the number of rows.
    pub fn solve(&self, rhs: &mut [f64], columns: usize) -> Result<(), SparseError> {
        assert_eq!(rhs.len(), columns * self.system.blocks() * self.system.size, "right-hand sides");
        self.system.cholesky.solve_columns(&self.values, rhs, columns)
    }

    /// The entries of the inverse on the pattern of the factor, which includes that of the matrix.
    pub fn selected_inverse(&self) -> SelectedInverse {
        let order = self.system.cholesky.symbolic().perm().map(|p| p.arrays().1);
        let positions = order.map_or_else(|| (0..self.rows()).collect(), |o| o.to_vec());
        invert(self.supernodes(), positions, self.system.size)
    }

    fn rows(&self) -> u32 {
        u32::try_from(self.system.blocks() * self.system.size).expect("`Lower` has no more than 2^32 entries")
    }

    fn supernodes(&self) -> SupernodalLltRef<'_, u32, f64> {
        match self.system.cholesky.symbolic().raw() {
            SymbolicCholeskyRaw::Supernodal(symbolic) => SupernodalLltRef::new(symbolic, &self.values),
            SymbolicCholeskyRaw::Simplicial(_) => unreachable!("the analysis is forced to be supernodal"),
        }
    }

    fn check_pivots(&self, diagonal: &[f64]) -> Result<(), SparseError> {
        let factor = self.supernodes();
        let order = self.system.cholesky.symbolic().perm().map(|p| p.arrays().0);
        for s in 0..factor.symbolic().n_supernodes() {
            let supernode = factor.supernode(s);
            for k in 0..supernode.val().ncols() {
                let at = supernode.start() + k;
                let row = order.map_or(at, |o| o[at] as usize);
                let pivot = supernode.val()[(k, k)];
                if pivot.is_nan() || pivot * pivot <= SMALLEST_PIVOT * diagonal[row] {
                    return Err(SparseError::NotPositiveDefinite { row: row / self.system.size });
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Gauss-Jordan without pivoting: enough for small matrices that are positive definite.
    fn dense_inverse(a: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let n = a.len();
        let unit = |i: usize| (0..n).map(move |j| f64::from(u8::from(i == j)));
        let mut m: Vec<Vec<f64>> =
            a.iter().enumerate().map(|(i, row)| row.iter().copied().chain(unit(i)).collect()).collect();
        for k in 0..n {
            let pivot = m[k].clone();
            for (i, row) in m.iter_mut().enumerate() {
                let factor = if i == k { 1.0 - 1.0 / pivot[k] } else { row[k] / pivot[k] };
                row.iter_mut().zip(&pivot).for_each(|(x, p)| *x -= factor * p);
            }
        }
        m.into_iter().map(|row| row[n..].to_vec()).collect()
    }

    /// A graph Laplacian of blocks, made definite: `pairs` of `blocks` rows, couplings drawn from
    /// `values`.
    fn random(blocks: usize, size: usize, pairs: &[(usize, usize)], values: &[f64]) -> Vec<Vec<f64>> {
        let n = blocks * size;
        let mut dense = vec![vec![0.0; n]; n];
        for (k, &(i, j)) in pairs.iter().enumerate() {
            for a in 0..size {
                for b in 0..size {
                    let x = values[(k * 7 + a * 3 + b) % values.len()];
                    dense[i * size + a][j * size + b] = x;
                    dense[j * size + b][i * size + a] = x;
                }
            }
        }
        for (i, row) in dense.iter_mut().enumerate() {
            row[i] = 0.5 + row.iter().map(|x: &f64| x.abs()).sum::<f64>();
        }
        dense
    }

    proptest! {
        #[test]
        fn solutions_and_selected_entries_are_those_of_the_dense_inverse(
            size in prop_oneof![Just(1_usize), Just(3), Just(6)],
            raw in proptest::collection::vec((0_usize..12, 0_usize..12), 1..30),
            values in proptest::collection::vec(-1.0..1.0_f64, 5..20),
        ) {
            let mut pairs: Vec<_> = raw.into_iter().filter(|(i, j)| i > j).collect();
            pairs.sort_unstable();
            pairs.dedup();
            let dense = random(12, size, &pairs, &values);
            let system = BlockSystem::new(Pattern::new(12, pairs.iter().copied()), size).unwrap();
            let mut matrix = system.zero();
            for (i, j) in pairs.iter().copied().chain((0..12).map(|i| (i, i))) {
                matrix.add(system.slot(i, j).unwrap(), |a, b| dense[i * size + a][j * size + b]);
            }
            let inverse = dense_inverse(&dense);
            let n = 12 * size;
            let rhs: Vec<f64> = (0..2 * n).map(|i| i as f64 - 3.0).collect();
            let mut x = rhs.clone();
            let factor = matrix.factor().unwrap();
            factor.solve(&mut x, 2).unwrap();
            for k in 0..2 {
                for (i, row) in dense.iter().enumerate() {
                    let back: f64 = row.iter().zip(&x[k * n..]).map(|(a, x)| a * x).sum();
                    prop_assert!((back - rhs[k * n + i]).abs() < 1e-9, "row {i} of column {k}");
                }
            }
            let selected = factor.selected_inverse();
            for (i, j) in pairs.iter().copied().chain((0..12).map(|i| (i, i))) {
                for a in 0..size {
                    for b in 0..size {
                        let found = selected.entry(i, j, a, b).unwrap();
                        let expected = inverse[i * size + a][j * size + b];
                        prop_assert!((found - expected).abs() < 1e-12, "({i},{j}) ({a},{b}): {found} is not {expected}");
                    }
                }
            }
        }
    }

    #[test]
    fn matrices_that_are_singular_up_to_rounding_are_refused() {
        // A chain of springs without any support.
        let system = BlockSystem::new(Pattern::new(50, (1..50).map(|i| (i - 1, i))), 1).unwrap();
        let mut matrix = system.zero();
        for i in 1..50 {
            let stiffness = 1.0 / 3.0 + i as f64 * 0.1;
            for (row, column, sign) in [(i, i, 1.0), (i - 1, i - 1, 1.0), (i, i - 1, -1.0)] {
                matrix.add(system.slot(row, column).unwrap(), |_, _| sign * stiffness);
            }
        }
        let found = matrix.factor().err();
        assert!(matches!(found, Some(SparseError::NotPositiveDefinite { .. })), "{found:?}");
    }

    #[test]
    fn slots_exist_for_the_lower_triangle_of_the_pattern() {
        let system = BlockSystem::new(Pattern::new(3, [(0, 2)]), 3).unwrap();
        assert!(system.slot(2, 0).is_some() && system.slot(1, 1).is_some());
        assert_eq!(system.slot(0, 2), None, "above the diagonal");
        assert_eq!(system.slot(1, 0), None, "not in the pattern");
    }
}
