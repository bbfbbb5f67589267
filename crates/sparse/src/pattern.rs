//! Where a symmetric matrix has entries.

use std::ops::Range;

/// Which entries a matrix with a symmetric pattern has: row by row, columns ascending, the diagonal
/// always.
///
/// Both triangles are kept: rows can then be assembled and multiplied side by side.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern {
    starts: Vec<u32>,
    columns: Vec<u32>,
}

impl Pattern {
    /// The pattern of `rows` rows whose off-diagonal entries are `pairs` and their mirror images;
    /// repeated pairs count once.
    ///
    /// # Panics
    /// If a pair names a row that does not exist, or there are more than 2^32 entries.
    #[must_use]
    pub fn new(rows: usize, pairs: impl IntoIterator<Item = (usize, usize)>) -> Self {
        let index = |i: usize| u32::try_from(i).expect("more than 2^32 entries");
        let mut entries: Vec<(u32, u32)> = (0..index(rows)).map(|i| (i, i)).collect();
        for (i, j) in pairs {
            assert!(i.max(j) < rows, "entry ({i}, {j}) of a pattern of {rows} rows");
            entries.extend([(index(i), index(j)), (index(j), index(i))]);
        }
        entries.sort_unstable();
        entries.dedup();
        let mut starts = vec![0_u32; rows + 1];
        for &(i, _) in &entries {
            starts[i as usize + 1] += 1;
        }
        for i in 0..rows {
            starts[i + 1] += starts[i];
        }
        index(entries.len());
        Self { starts, columns: entries.into_iter().map(|e| e.1).collect() }
    }

    /// Number of rows, and of columns.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of entries, the diagonal and both triangles.
    #[must_use]
    pub fn entries(&self) -> usize {
        self.columns.len()
    }

    /// The slots of `row`: positions of its entries in [`crate::Matrix::values`].
    #[inline]
    #[must_use]
    pub fn slots(&self, row: usize) -> Range<usize> {
        self.starts[row] as usize..self.starts[row + 1] as usize
    }

    /// The columns of `row`, ascending.
    #[inline]
    #[must_use]
    pub fn columns(&self, row: usize) -> &[u32] {
        &self.columns[self.slots(row)]
    }

    /// The slot of one entry, if the pattern has it.
    #[inline]
    #[must_use]
    pub fn slot(&self, row: usize, column: usize) -> Option<usize> {
        let slots = self.slots(row);
        let column = u32::try_from(column).ok()?;
        self.columns[slots.clone()].binary_search(&column).ok().map(|k| slots.start + k)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_is_found_from_both_sides_and_counts_once() {
        let path = Pattern::new(3, [(0, 1), (2, 1), (1, 0)]);
        assert_eq!(path.entries(), 7, "three on the diagonal, two pairs");
        assert_eq!(path.columns(1), [0, 1, 2]);
        assert_eq!(path.slot(2, 1), Some(5));
        assert_eq!(path.slot(0, 2), None, "0 and 2 are no pair");
    }
}
