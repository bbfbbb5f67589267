//! The linear assignment problem: rows to different columns, at the least sum of costs.

/// The column of each row, such that the sum of `costs[row * columns + column]` is the least; there are no more rows
/// than columns. Shortest augmenting paths `(jonker1987)`, in at most `rows^2 columns` steps.
///
/// # Panics
/// If there are fewer columns than rows.
pub(crate) fn assign(costs: &[f64], columns: usize) -> Vec<usize> {
    const FREE: usize = usize::MAX;
    let rows = costs.len() / columns.max(1);
    assert!(rows <= columns, "an assignment of {rows} rows to {columns} columns");
    let cost = |row: usize, column: usize| costs[row * columns + column];
    // Prices of columns are at most 0, and 0 of free ones; a row is worth its least cost less prices.
    let (mut of_row, mut of_column) = (vec![FREE; rows], vec![FREE; columns]);
    let (mut worths, mut prices) = (vec![0.0; rows], vec![0.0; columns]);
    for (row, own) in costs.chunks_exact(columns).enumerate() {
        let (mut best, mut least) = (0, f64::INFINITY);
        for (column, &x) in own.iter().enumerate() {
            if x < least {
                (best, least) = (column, x);
            }
        }
        worths[row] = least;
        if of_column[best] == FREE {
            (of_row[row], of_column[best]) = (best, row);
        }
    }
    let mut lengths = vec![0.0; columns];
    let mut parents = vec![FREE; columns];
    let mut open: Vec<usize> = Vec::with_capacity(columns);
    let mut closed: Vec<usize> = Vec::with_capacity(columns);
    for start in 0..rows {
        if of_row[start] != FREE {
            continue;
        }
        lengths.fill(f64::INFINITY);
        open.clear();
        open.extend(0..columns);
        closed.clear();
        let (mut row, mut length) = (start, 0.0);
        let end = loop {
            let (mut best, mut least) = (0, f64::INFINITY);
            let offset = length - worths[row];
            for (slot, &column) in open.iter().enumerate() {
                let x = offset + cost(row, column) - prices[column];
                if x < lengths[column] {
                    (lengths[column], parents[column]) = (x, row);
                }
                let x = lengths[column];
                // Of equally near columns a free one ends the search.
                if x < least || (x == least && of_column[column] == FREE) {
                    (best, least) = (slot, x);
                }
            }
            length = least;
            let column = open.swap_remove(best);
            if of_column[column] == FREE {
                break column;
            }
            closed.push(column);
            row = of_column[column];
        };
        worths[start] += length;
        for &column in &closed {
            worths[of_column[column]] += length - lengths[column];
            prices[column] -= length - lengths[column];
        }
        let mut column = end;
        loop {
            let row = parents[column];
            of_column[column] = row;
            column = std::mem::replace(&mut of_row[row], column);
            if row == start {
                break;
            }
        }
    }
    of_row
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::Random;

    /// The least cost of all assignments.
    fn least(costs: &[f64], columns: usize, row: usize, used: &mut Vec<bool>) -> f64 {
        if row * columns == costs.len() {
            return 0.0;
        }
        let mut best = f64::INFINITY;
        for column in 0..columns {
            if !std::mem::replace(&mut used[column], true) {
                best = best.min(costs[row * columns + column] + least(costs, columns, row + 1, used));
                used[column] = false;
            }
        }
        best
    }

    #[test]
    fn no_assignment_costs_less() {
        let mut random = Random::new(3, 0);
        for (rows, columns) in [(0, 3), (1, 1), (3, 3), (4, 6), (6, 6)] {
            for digits in [1.0, 3.0, 1e9] {
                let costs: Vec<f64> =
                    (0..rows * columns).map(|_| (digits * (random.uniform() - 0.5)).round()).collect();
                let found = assign(&costs, columns);
                let mut used = vec![false; columns];
                found.iter().for_each(|&column| assert!(!std::mem::replace(&mut used[column], true)));
                let sum: f64 = found.iter().enumerate().map(|(k, &column)| costs[k * columns + column]).sum();
                let needed = least(&costs, columns, 0, &mut vec![false; columns]);
                assert!((sum - needed).abs() < 1e-9 * needed.abs().max(1.0), "{sum}, {needed}: {costs:?}");
            }
        }
    }
}
