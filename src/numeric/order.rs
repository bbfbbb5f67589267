//! Numbers in their order.

use std::cmp::Ordering;

/// The places of `count` things in rising order; equal ones keep theirs.
///
/// Compiled once: for each type and closure a sort of the standard library is 5 to 15 kB of program.
pub(crate) fn order_by(count: usize, compare: &dyn Fn(usize, usize) -> Ordering) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|&a, &b| compare(a, b));
    order
}

/// The places of numbers in rising order; equal ones keep theirs. For falling order give the
/// negatives.
pub(crate) fn argsort(numbers: &[f64]) -> Vec<usize> {
    order_by(numbers.len(), &|a, b| numbers[a].total_cmp(&numbers[b]))
}

/// The chains that `next` leads along from each of `count` things, none of them twice: a cycle from its
/// smallest member, a chain with an end from the smallest member that no chain before it reached.
pub(crate) fn chains(count: usize, next: impl Fn(usize) -> Option<usize>) -> Vec<Vec<usize>> {
    let mut is_used = vec![false; count];
    let mut chains = Vec::new();
    for first in 0..count {
        let (mut chain, mut at) = (Vec::new(), Some(first));
        while let Some(k) = at.filter(|&k| !std::mem::replace(&mut is_used[k], true)) {
            chain.push(k);
            at = next(k);
        }
        if !chain.is_empty() {
            chains.push(chain);
        }
    }
    chains
}

/// The number that `rank` others precede in ascending order; `None` if there are fewer.
pub(crate) fn nth_smallest(mut numbers: Vec<f64>, rank: usize) -> Option<f64> {
    (rank < numbers.len()).then(|| *numbers.select_nth_unstable_by(rank, f64::total_cmp).1)
}

/// The median, of an even number the upper one; `None` without numbers.
pub(crate) fn median(numbers: impl Iterator<Item = f64>) -> Option<f64> {
    let numbers: Vec<f64> = numbers.collect();
    let middle = numbers.len() / 2;
    nth_smallest(numbers, middle)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_numbers_keep_their_order() {
        assert_eq!(argsort(&[2.0, 1.0, 2.0, -3.0, 1.0]), [3, 1, 4, 0, 2]);
    }

    #[test]
    fn a_permutation_falls_into_its_cycles() {
        let next = [2, 1, 4, 5, 0, 3];
        assert_eq!(chains(6, |k| Some(next[k])), [vec![0, 2, 4], vec![1], vec![3, 5]]);
        assert_eq!(chains(3, |k| (k > 0).then(|| k - 1)), [[0], [1], [2]], "what is reached ends a chain");
    }
}
