//! Lists of items, one after the other in memory (compressed sparse rows).

use std::ops::{Index, Range};

use crate::parallel::par_rows;

/// Several lists of items: the faces around each vertex, the entries of each row.
#[derive(Debug, Clone, PartialEq, Eq)]
#[doc(hidden)]
pub struct Csr<T> {
    /// Where each list begins, and where the last one ends.
    starts: Vec<u32>,
    items: Vec<T>,
}

impl<T> Csr<T> {
    /// No lists yet; allocates memory for this many lists and items.
    pub(crate) fn with_capacity(lists: usize, items: usize) -> Self {
        let mut starts = Vec::with_capacity(lists + 1);
        starts.push(0);
        Self { starts, items: Vec::with_capacity(items) }
    }

    /// `lists` lists from pairs of list and item, by a counting sort: a list keeps the order of its pairs.
    /// Panics if a pair names a list beyond the last, or if there are more than 2^32 items.
    #[doc(hidden)]
    pub fn from_pairs(lists: usize, pairs: impl Iterator<Item = (usize, T)> + Clone) -> Self
    where
        T: Copy,
    {
        let mut starts = vec![0_u32; lists + 1];
        let mut total = 0_usize;
        // Not by `for`, which makes nested iterators several times slower.
        pairs.clone().for_each(|(list, _)| {
            // Wraps only if the total is refused below.
            starts[list + 1] = starts[list + 1].wrapping_add(1);
            total += 1;
        });
        let _ = offset(total);
        for list in 0..lists {
            starts[list + 1] += starts[list];
        }
        let mut next = starts.clone();
        let mut items = pairs.clone().next().map_or_else(Vec::new, |(_, item)| vec![item; total]);
        pairs.for_each(|(list, item)| {
            let slot = &mut next[list];
            items[*slot as usize] = item;
            *slot += 1;
        });
        Self { starts, items }
    }

    /// Lists of these lengths, which `fill` writes in parallel; it takes the number of the list.
    /// Panics if there are more than 2^32 items.
    pub(crate) fn filled(lengths: &[u32], fill: impl Fn(usize, &mut [T]) + Sync) -> Self
    where
        T: Send + Clone + Default,
    {
        let mut starts = Vec::with_capacity(lengths.len() + 1);
        let mut end = 0_u32;
        starts.push(end);
        for &length in lengths {
            end = end.checked_add(length).expect("more than 2^32 items");
            starts.push(end);
        }
        let items = par_rows(&starts, fill);
        Self { starts, items }
    }

    /// Appends a list.
    /// Panics if there are then more than 2^32 items.
    pub(crate) fn push(&mut self, list: impl IntoIterator<Item = T>) {
        self.items.extend(list);
        self.starts.push(offset(self.items.len()));
    }

    /// Appends the lists of another.
    /// Panics if there are then more than 2^32 items.
    pub(crate) fn append(&mut self, mut other: Self) {
        let before = offset(self.items.len());
        self.items.append(&mut other.items);
        let _ = offset(self.items.len());
        self.starts.extend(other.starts[1..].iter().map(|start| before + start));
    }

    pub(crate) fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// The items of all lists, one list after the other.
    #[inline]
    pub(crate) fn items(&self) -> &[T] {
        &self.items
    }

    #[doc(hidden)]
    pub fn items_mut(&mut self) -> &mut [T] {
        &mut self.items
    }

    /// The range of a list within [`Self::items`].
    #[inline]
    pub(crate) fn range(&self, list: usize) -> Range<usize> {
        self.starts[list] as usize..self.starts[list + 1] as usize
    }

    #[doc(hidden)]
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[T]> + Clone {
        self.starts.windows(2).map(|range| &self.items[range[0] as usize..range[1] as usize])
    }
}

impl<T> Default for Csr<T> {
    fn default() -> Self {
        Self::with_capacity(0, 0)
    }
}

impl<T> Index<usize> for Csr<T> {
    type Output = [T];

    #[inline]
    fn index(&self, list: usize) -> &[T] {
        &self.items[self.range(list)]
    }
}

/// A number of items as it is stored.
fn offset(items: usize) -> u32 {
    u32::try_from(items).expect("more than 2^32 items")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_from_pairs_and_one_by_one_agree() {
        let pairs = [(2, 'a'), (0, 'b'), (2, 'c'), (0, 'd'), (2, 'a')];
        let sorted = Csr::from_pairs(4, pairs.into_iter());
        let lists = [vec!['b', 'd'], vec![], vec!['a', 'c', 'a'], vec![]];
        let mut pushed = Csr::default();
        lists[..2].iter().for_each(|list| pushed.push(list.iter().copied()));
        let mut rest = Csr::with_capacity(2, 3);
        lists[2..].iter().for_each(|list| rest.push(list.iter().copied()));
        pushed.append(rest);
        assert_eq!(sorted, pushed);
        assert!(sorted.iter().eq(lists.iter()), "{sorted:?}");
        assert_eq!((&sorted[2], sorted.range(2), sorted.len()), (&['a', 'c', 'a'][..], 2..5, 4));
        assert_eq!(Csr::<u8>::from_pairs(0, std::iter::empty()), Csr::default());
    }
}
