//! Small systems of equations, by elimination with pivots.

/// The solution of a system of equations, whose right side is the last column; `None` if it is singular.
pub(crate) fn solve_system<const N: usize, const M: usize>(mut system: [[f64; M]; N]) -> Option<[f64; N]> {
    for k in 0..N {
        let pivot = (k..N).max_by(|&a, &b| system[a][k].abs().total_cmp(&system[b][k].abs()))?;
        system.swap(k, pivot);
        let top = system[k];
        if top[k].abs() <= f64::MIN_POSITIVE || !top[k].is_finite() {
            return None;
        }
        for line in &mut system[k + 1..] {
            let factor = line[k] / top[k];
            line.iter_mut().zip(top).skip(k).for_each(|(cell, above)| *cell -= factor * above);
        }
    }
    let mut solution = [0.0; N];
    for k in (0..N).rev() {
        let known: f64 = (k + 1..N).map(|j| system[k][j] * solution[j]).sum();
        solution[k] = (system[k][M - 1] - known) / system[k][k];
    }
    Some(solution)
}

#[cfg(test)]
mod tests {
    use super::solve_system;

    /// `y = 2` and `x + y = 5`: the first pivot is in the second row.
    #[test]
    fn pivots_are_found_and_singular_systems_have_no_solution() {
        assert_eq!(solve_system([[0.0, 1.0, 2.0], [1.0, 1.0, 5.0]]), Some([3.0, 2.0]));
        assert_eq!(solve_system([[1.0, 1.0, 2.0], [1.0, 1.0, 5.0]]), None);
        assert_eq!(solve_system([[f64::NAN, 1.0, 2.0], [1.0, 1.0, 5.0]]), None);
    }
}
