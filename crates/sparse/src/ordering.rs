//! The order in which rows are eliminated, which determines the fill of the factor.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::FaerError;
use faer::sparse::linalg::amd;
use glam::DVec3;

use crate::{Pattern, lower::Lower};

/// From this many rows on the order comes from coordinates: the minimum degree order of faer takes
/// longer than the factorization there (measured on cotangent Laplacians, 0.18 s against 0.06 s at
/// 100 000 rows).
const DISSECTION_ROWS: usize = 20_000;

/// Sets of this size are not split further: below it a separator costs more fill than it saves.
const LEAF: usize = 48;

/// Rows with more columns than this times the root of the number of rows come last: eliminated
/// earlier, a vertex with thousands of neighbours would join all of them.
const DENSE: f64 = 10.0;

/// Label of rows that lie in a separator already placed.
const SEPARATOR: u32 = u32::MAX;

/// A fill-reducing order: `order[k]` is the row eliminated in step `k`.
///
/// Nested dissection where there are many rows and `coordinates` for all of them, else approximate
/// minimum degree.
pub(crate) fn order_rows(pattern: &Pattern, coordinates: &[DVec3]) -> Result<Vec<u32>, FaerError> {
    if pattern.rows() >= DISSECTION_ROWS && coordinates.len() == pattern.rows() {
        Ok(dissect(pattern, coordinates))
    } else {
        minimum_degree(pattern)
    }
}

/// Fill-reducing order by geometric nested dissection `(george1973)`: the rows are halved at the
/// median of their longest coordinate, rows of the lower half that touch the upper one become the
/// separator and come last, and both halves are treated alike.
///
/// On surfaces it is as good as a graph partitioner at a fraction of the cost.
fn dissect(pattern: &Pattern, coordinates: &[DVec3]) -> Vec<u32> {
    let rows = u32::try_from(pattern.rows()).expect("a pattern has at most 2^32 entries");
    let most = DENSE * f64::from(rows).sqrt();
    let (mut order, dense): (Vec<u32>, Vec<u32>) =
        (0..rows).partition(|&i| pattern.columns(i as usize).len() as f64 <= most);
    let mut open = Vec::from([std::ops::Range { start: 0, end: order.len() }]);
    // The set of each row: every split gives its upper half a new number.
    let mut part = vec![0_u32; pattern.rows()];
    for &i in &dense {
        part[i as usize] = SEPARATOR;
    }
    order.extend(dense);
    let mut upper = 0;
    let mut lower = Vec::new();
    let mut separator = Vec::new();
    while let Some(range) = open.pop() {
        if range.len() <= LEAF {
            continue;
        }
        let rows = &mut order[range.clone()];
        let axis = longest_axis(rows, coordinates);
        let middle = rows.len() / 2;
        rows.select_nth_unstable_by(middle, |&i, &j| {
            let at = |i: u32| coordinates[i as usize][axis];
            at(i).total_cmp(&at(j)).then(i.cmp(&j))
        });
        upper += 1;
        for &i in &rows[middle..] {
            part[i as usize] = upper;
        }
        lower.clear();
        separator.clear();
        for &i in &rows[..middle] {
            let touches = pattern.columns(i as usize).iter().any(|&j| part[j as usize] == upper);
            if touches { separator.push(i) } else { lower.push(i) }
        }
        for &i in &separator {
            part[i as usize] = SEPARATOR;
        }
        rows.copy_within(middle.., lower.len());
        rows[..lower.len()].copy_from_slice(&lower);
        let end = rows.len() - separator.len();
        rows[end..].copy_from_slice(&separator);
        let start = range.start;
        open.push(start..start + lower.len());
        open.push(start + lower.len()..start + end);
    }
    order
}

fn longest_axis(rows: &[u32], coordinates: &[DVec3]) -> usize {
    let (lo, hi) = rows.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), &i| {
        (lo.min(coordinates[i as usize]), hi.max(coordinates[i as usize]))
    });
    (hi - lo).max_position()
}

/// Approximate minimum degree order of the rows `(amestoy1996)`.
fn minimum_degree(pattern: &Pattern) -> Result<Vec<u32>, FaerError> {
    let rows = pattern.rows();
    let (mut order, mut inverse) = (vec![0_u32; rows], vec![0_u32; rows]);
    let upper = Lower::new(pattern, 1).ok_or(FaerError::IndexOverflow)?;
    let scratch = amd::order_maybe_unsorted_scratch::<u32>(rows, upper.indices.len());
    let mut memory = MemBuffer::try_new(scratch).map_err(FaerError::from)?;
    amd::order_maybe_unsorted(
        &mut order,
        &mut inverse,
        upper.symbolic(),
        Default::default(),
        MemStack::new(&mut memory),
    )?;
    Ok(order)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(n: usize) -> (Pattern, Vec<DVec3>) {
        let at = |i: usize, j: usize| j * n + i;
        let right = (0..n).flat_map(|j| (1..n).map(move |i| (at(i - 1, j), at(i, j))));
        let up = (1..n).flat_map(|j| (0..n).map(move |i| (at(i, j - 1), at(i, j))));
        let coordinates = (0..n * n).map(|k| DVec3::new((k % n) as f64, (k / n) as f64, 0.0)).collect();
        (Pattern::new(n * n, right.chain(up)), coordinates)
    }

    #[test]
    fn every_row_comes_once_and_the_separator_last() {
        let (pattern, coordinates) = grid(24);
        let order = dissect(&pattern, &coordinates);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().enumerate().all(|(i, &r)| i == r as usize), "a permutation");
        // The last rows are the first separator: a line of the grid, which cuts it in two.
        let line: Vec<_> = order[24 * 24 - 24..].iter().map(|&r| r as usize % 24).collect();
        assert!(line.iter().all(|&i| i == line[0]), "one column of the grid: {line:?}");
    }

    /// A wheel: its hub touches both halves wherever it is cut.
    #[test]
    fn a_row_that_touches_thousands_comes_last() {
        let n = 4000;
        let rim = (0..n).map(|i| (i + 1, (i + 1) % n + 1));
        let pattern = Pattern::new(n + 1, rim.chain((0..n).map(|i| (0, i + 1))));
        let at = |i: usize| DVec3::new((i as f64 * 0.01).cos(), (i as f64 * 0.01).sin(), 0.0);
        let coordinates: Vec<DVec3> = (0..=n).map(at).collect();
        assert_eq!(dissect(&pattern, &coordinates).last(), Some(&0));
    }

    #[test]
    fn coincident_points_are_ordered_too() {
        let (pattern, _) = grid(20);
        let order = dissect(&pattern, &vec![DVec3::ONE; 400]);
        assert_eq!(order.iter().map(|&r| r as usize).sum::<usize>(), 400 * 399 / 2, "a permutation");
    }
}
