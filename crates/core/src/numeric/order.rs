//! Numbers in their order, and points along the Morton curve `(morton1966)`.

use std::cmp::Ordering;

use glam::DVec3;
use rayon::prelude::*;

/// The indices of `count` things in ascending order; equal ones keep their order.
///
/// Compiled once: for each type and closure a sort of the standard library is 5 to 15 kB of program.
#[doc(hidden)]
pub fn order_by(count: usize, compare: &dyn Fn(usize, usize) -> Ordering) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|&a, &b| compare(a, b));
    order
}

/// The indices of numbers in ascending order; equal ones keep their order. For descending order pass the
/// negatives.
pub(crate) fn argsort(numbers: &[f64]) -> Vec<usize> {
    order_by(numbers.len(), &|a, b| numbers[a].total_cmp(&numbers[b]))
}

/// The chains of `count` things along `next`; each thing is in one chain. A cycle starts at its smallest
/// member, a chain with an end at the smallest member that no earlier chain has reached.
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
    median_of(&mut numbers.collect::<Vec<_>>())
}

/// The median of numbers in memory, which it sorts in part; see [`median`].
#[doc(hidden)]
pub fn median_of(numbers: &mut [f64]) -> Option<f64> {
    let middle = numbers.len() / 2;
    (middle < numbers.len()).then(|| *numbers.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Bits of each coordinate: three times as many fit into a word.
const BITS: u32 = 21;

/// The position along the Morton curve of a point whose coordinates lie in `0..=1`: bits
/// interleaved, so that points near each other on the curve are near each other in space.
pub(crate) fn morton(unit: DVec3) -> u64 {
    let steps = f64::from((1_u32 << BITS) - 1);
    let spread = |x: f64| {
        #[expect(clippy::cast_possible_truncation, reason = "between 0 and 2^21, and `as` saturates")]
        let mut x = (x * steps) as u64 & ((1 << BITS) - 1);
        for (shift, mask) in [
            (32, 0x001f_0000_0000_ffff),
            (16, 0x001f_0000_ff00_00ff),
            (8, 0x100f_00f0_0f00_f00f),
            (4, 0x10c3_0c30_c30c_30c3),
            (2, 0x1249_2492_4924_9249),
        ] {
            x = (x | x << shift) & mask;
        }
        x
    };
    spread(unit.x) | spread(unit.y) << 1 | spread(unit.z) << 2
}

/// The indices of points in the order of a Morton curve, in which neighbours in space are near each other;
/// points at one position are in the order of their indices.
pub(crate) fn along_curve(points: &[DVec3]) -> Vec<usize> {
    let (lo, hi) =
        points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), &p| (lo.min(p), hi.max(p)));
    // One scale for all axes: the longest side has all steps.
    let side = (hi - lo).max_element().max(f64::MIN_POSITIVE);
    let mut order: Vec<(u64, usize)> =
        points.par_iter().enumerate().map(|(number, &p)| (morton((p - lo) / side), number)).collect();
    order.par_sort_unstable();
    order.into_iter().map(|(_, number)| number).collect()
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

    /// The eight corners of a cube in the order of the curve.
    #[test]
    fn octants_follow_each_other() {
        let corners = (0..8_u32).map(|k| {
            let bit = |at: u32| f64::from(k >> at & 1);
            morton(DVec3::new(bit(0), bit(1), bit(2)) * 0.6)
        });
        let corners: Vec<u64> = corners.collect();
        assert!(corners.is_sorted(), "{corners:?}");
    }
}
