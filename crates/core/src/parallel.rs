//! Parallel maps over items in memory.
//!
//! The iterators of rayon are compiled for each closure that they call, thousands of lines of machine code
//! each. The maps here share one parallel loop, which calls a closure once for each chunk of the items.
//! Results are in the order of the items, with any number of threads.

use std::iter::Sum;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use crate::id::{Id, IdVec};

/// Chunks for each thread: enough to balance chunks of different cost.
const CHUNKS_PER_THREAD: usize = 8;

/// Items of a partial sum; fixed, so that sums do not depend on the number of threads.
const PART: usize = 2048;

/// Items that [`par_each`] has in memory at once.
const BLOCK: usize = 1 << 16;

/// Calls `task` with the number and the range of each of the chunks of `0..count`.
fn for_each_chunk(count: usize, chunks: usize, task: &(dyn Fn(usize, Range<usize>) + Sync)) {
    (0..chunks).into_par_iter().for_each(|k| task(k, chunk(count, chunks, k)));
}

/// The range of chunk `k` of `chunks` of `0..count`.
fn chunk(count: usize, chunks: usize, k: usize) -> Range<usize> {
    let begin = |k: usize| k * (count / chunks) + k.min(count % chunks);
    begin(k)..begin(k + 1)
}

/// The items that `extend` appends for consecutive ranges of `0..count`, in order.
///
/// A range is one task, so `extend` may keep buffers from item to item; the items it appends must not depend
/// on the range.
#[doc(hidden)]
pub fn par_collect<U: Send>(count: usize, extend: impl Fn(Range<usize>, &mut Vec<U>) + Sync) -> Vec<U> {
    collect_chunks(count, &extend)
}

/// [`par_collect`], compiled once for each type of result.
fn collect_chunks<U: Send>(count: usize, extend: &(dyn Fn(Range<usize>, &mut Vec<U>) + Sync)) -> Vec<U> {
    let chunks = count.min(CHUNKS_PER_THREAD * rayon::current_num_threads());
    let parts: Vec<Mutex<Vec<U>>> = (0..chunks).map(|_| Mutex::default()).collect();
    for_each_chunk(count, chunks, &|k, range| {
        let mut part = Vec::with_capacity(range.len());
        extend(range, &mut part);
        *parts[k].lock().unwrap_or_else(PoisonError::into_inner) = part;
    });
    let parts = parts.into_iter().map(|part| part.into_inner().unwrap_or_else(PoisonError::into_inner));
    let mut all = Vec::with_capacity(count);
    parts.for_each(|mut part| all.append(&mut part));
    all
}

/// Consecutive rows of items, written by `fill`: row `k` from `starts[k]` to `starts[k + 1]`; `starts` begins
/// with 0.
pub(crate) fn par_rows<U: Send + Clone + Default>(
    starts: &[u32],
    fill: impl Fn(usize, &mut [U]) + Sync,
) -> Vec<U> {
    fill_rows(starts, &fill)
}

/// [`par_rows`], compiled once for each type of item.
fn fill_rows<U: Send + Clone + Default>(starts: &[u32], fill: &(dyn Fn(usize, &mut [U]) + Sync)) -> Vec<U> {
    let rows = starts.len() - 1;
    let mut all = vec![U::default(); starts[rows] as usize];
    let chunks = rows.min(CHUNKS_PER_THREAD * rayon::current_num_threads());
    let (mut tasks, mut rest) = (Vec::with_capacity(chunks), all.as_mut_slice());
    for range in (0..chunks).map(|k| chunk(rows, chunks, k)) {
        let (part, behind) = rest.split_at_mut((starts[range.end] - starts[range.start]) as usize);
        tasks.push((range, part));
        rest = behind;
    }
    tasks.into_par_iter().for_each(|(range, mut part)| {
        for row in range {
            let (items, behind) = part.split_at_mut((starts[row + 1] - starts[row]) as usize);
            fill(row, items);
            part = behind;
        }
    });
    all
}

/// `of` each item.
#[doc(hidden)]
pub fn par_map<T: Sync, U: Send>(items: &[T], of: impl Fn(&T) -> U + Sync) -> Vec<U> {
    par_collect(items.len(), |range, out| out.extend(items[range].iter().map(&of)))
}

/// `of` each of the first `count` ids.
pub(crate) fn par_ids<I: Id, U: Send>(count: usize, of: impl Fn(I) -> U + Sync) -> IdVec<I, U> {
    par_collect(count, |range, out| out.extend(range.map(I::new).map(&of))).into()
}

/// Calls `each` with the first `count` ids in their order, and with `of` each, which is computed in parallel,
/// a block at a time.
pub(crate) fn par_each<I: Id, U: Send>(count: usize, of: impl Fn(I) -> U + Sync, mut each: impl FnMut(I, U)) {
    for first in (0..count).step_by(BLOCK) {
        let ids = |range: Range<usize>| range.map(move |k| I::new(first + k));
        let block = BLOCK.min(count - first);
        let made = par_collect(block, |range, out| out.extend(ids(range).map(&of)));
        ids(0..block).zip(made).for_each(|(id, made)| each(id, made));
    }
}

/// `of` each range of `0..count`; the length of ranges does not depend on the number of threads.
pub(crate) fn par_parts<U: Send>(count: usize, of: impl Fn(Range<usize>) -> U + Sync) -> Vec<U> {
    let part = |k: usize| of(k * PART..count.min((k + 1) * PART));
    par_collect(count.div_ceil(PART), |parts, out| out.extend(parts.map(part)))
}

/// The sum of `of` each of `0..count`, the same with any number of threads.
pub(crate) fn par_sum<U: Send + Sum>(count: usize, of: impl Fn(usize) -> U + Sync) -> U {
    par_parts(count, |part| part.map(&of).sum::<U>()).into_iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_in_the_order_of_the_items() {
        for count in [0, 1, 2, 3, 17, 1000] {
            let items: Vec<usize> = (0..count).collect();
            let squares: Vec<usize> = items.iter().map(|k| k * k).collect();
            for threads in [1, 3] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                assert_eq!(pool.install(|| par_map(&items, |k| k * k)), squares, "{count} items");
            }
        }
        let twice = par_collect(100, |range, out| range.for_each(|k| out.extend([k, k])));
        assert_eq!(twice.len(), 200);
        assert!(twice.is_sorted());
    }
}
