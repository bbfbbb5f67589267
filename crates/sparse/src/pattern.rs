//! Where a symmetric matrix has entries.

use std::ops::Range;

/// Which entries a matrix with a symmetric pattern has: row by row, columns ascending, the diagonal
/// always.
///
/// Both triangles are stored, so that rows can be assembled and multiplied in parallel.
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
    pub fn new(rows: usize, pairs: impl IntoIterator<Item = (usize, usize)>) -> Self {
        let index = |i: usize| u32::try_from(i).expect("more than 2^32 entries");
        let check = |(i, j): (usize, usize)| {
            assert!(i.max(j) < rows, "entry ({i}, {j}) of a pattern of {rows} rows");
            [index(i), index(j)]
        };
        let pairs: Vec<[u32; 2]> = pairs.into_iter().map(check).collect();
        // Every row with its repeated entries; rows are short, so each is sorted alone.
        let mut ends = vec![1; rows];
        pairs.as_flattened().iter().for_each(|&i| ends[i as usize] += 1);
        let mut total = 0_usize;
        for end in &mut ends {
            total += std::mem::replace(end, total);
        }
        let mut columns = vec![0; total];
        let mut put = |row: u32, column: u32| {
            let at = &mut ends[row as usize];
            columns[*at] = column;
            *at += 1;
        };
        (0..index(rows)).for_each(|i| put(i, i));
        for &[i, j] in &pairs {
            put(i, j);
            put(j, i);
        }
        let mut starts = Vec::with_capacity(rows + 1);
        starts.push(0);
        let (mut kept, mut from) = (0, 0);
        for to in ends {
            columns[from..to].sort_unstable();
            let first = kept;
            for k in from..to {
                if kept == first || columns[kept - 1] != columns[k] {
                    columns[kept] = columns[k];
                    kept += 1;
                }
            }
            starts.push(index(kept));
            from = to;
        }
        columns.truncate(kept);
        Self { starts, columns }
    }

    /// Number of rows, and of columns.
    pub fn rows(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of entries, the diagonal and both triangles.
    pub(crate) fn entries(&self) -> usize {
        self.columns.len()
    }

    /// The slots of `row`: positions of its entries in [`crate::Matrix::values`].
    #[inline]
    pub fn slots(&self, row: usize) -> Range<usize> {
        self.starts[row] as usize..self.starts[row + 1] as usize
    }

    /// The columns of `row`, ascending.
    #[inline]
    pub fn columns(&self, row: usize) -> &[u32] {
        &self.columns[self.slots(row)]
    }

    /// The slot of one entry, if the pattern has it.
    #[inline]
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
