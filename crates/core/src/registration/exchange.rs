//! Whether two landmarks are exchanged: the energy of bending with and without their exchange.

use glam::DVec2;

use crate::numeric::{dense_cholesky, solve_dense};

/// The two pairs whose second points, exchanged, leave least of the energy of the thin-plate spline through all pairs
/// `(bookstein1989)`, and the share that is left; `None` where there is no such energy.
pub(super) fn best_exchange(pairs: &[[DVec2; 2]]) -> Option<([usize; 2], f64)> {
    let count = pairs.len();
    let energy = bending_energy(&pairs.iter().map(|pair| pair[0]).collect::<Vec<_>>())?;
    let entry = |i: usize, j: usize| energy[i * count + j];
    let pulls: Vec<DVec2> = (0..count).map(|i| (0..count).map(|j| entry(i, j) * pairs[j][1]).sum()).collect();
    let whole: f64 = pulls.iter().zip(pairs).map(|(pull, pair)| pull.dot(pair[1])).sum();
    let mut best = None;
    for j in 0..count {
        for i in 0..j {
            let by = pairs[j][1] - pairs[i][1];
            let change = 2.0 * by.dot(pulls[i] - pulls[j])
                + by.length_squared() * (entry(i, i) + entry(j, j) - 2.0 * entry(i, j));
            let share = (whole + change) / whole;
            if best.is_none_or(|(_, least)| share < least) {
                best = Some(([i, j], share));
            }
        }
    }
    best.filter(|(_, share)| share.is_finite())
}

/// The matrix of the energy of the thin-plate spline that has given values at points: a quadratic form of the values,
/// zero for those of a linear function.
fn bending_energy(points: &[DVec2]) -> Option<Vec<f64>> {
    let count = points.len();
    let middle = points.iter().sum::<DVec2>() / count as f64;
    let size = points.iter().map(|p| p.distance(middle)).fold(0.0, f64::max);
    let at: Vec<DVec2> = points.iter().map(|&p| (p - middle) / size).collect();
    // An orthonormal basis: first of the linear functions, then of what is orthogonal to them.
    let linear = [vec![1.0; count], at.iter().map(|p| p.x).collect(), at.iter().map(|p| p.y).collect()];
    let unit = |k: usize| (0..count).map(|i| f64::from(u8::from(i == k))).collect::<Vec<f64>>();
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for mut vector in linear.into_iter().chain((0..count).map(unit)) {
        // Twice, so that what is left is orthogonal to rounding.
        for _ in 0..2 {
            for known in &basis {
                let along = dot(known, &vector);
                vector.iter_mut().zip(known).for_each(|(x, y)| *x -= along * y);
            }
        }
        let length = dot(&vector, &vector).sqrt();
        if length > 1e-6 && basis.len() < count {
            basis.push(vector.into_iter().map(|x| x / length).collect());
        }
    }
    let others = basis.get(3..)?;
    let kernel = |i: usize, j: usize| {
        let squared = at[i].distance_squared(at[j]);
        if squared > 0.0 { squared * squared.ln() } else { 0.0 }
    };
    let times: Vec<Vec<f64>> = others
        .iter()
        .map(|vector| (0..count).map(|i| (0..count).map(|j| kernel(i, j) * vector[j]).sum()).collect())
        .collect();
    let size = others.len();
    let reduced: Vec<f64> = (0..size * size).map(|k| dot(&others[k / size], &times[k % size])).collect();
    let factor = dense_cholesky(&reduced, size)?;
    let mut columns: Vec<f64> = others.concat();
    solve_dense(&factor, &mut columns, count);
    let mut energy = vec![0.0; count * count];
    for (vector, solved) in others.iter().zip(columns.chunks_exact(count)) {
        for (i, x) in vector.iter().enumerate() {
            energy[i * count..][..count].iter_mut().zip(solved).for_each(|(sum, y)| *sum += x * y);
        }
    }
    Some(energy)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points() -> Vec<DVec2> {
        (0..9).map(|k| DVec2::new(f64::from(k % 3) + 0.1 * f64::from(k), f64::from(k / 3) * 1.3)).collect()
    }

    /// The energy of linear functions is zero, of others positive.
    #[test]
    fn linear_functions_do_not_bend() {
        let points = points();
        let energy = bending_energy(&points).unwrap();
        let of = |f: &dyn Fn(DVec2) -> f64| {
            let values: Vec<f64> = points.iter().map(|&p| f(p)).collect();
            let rows = energy.chunks_exact(points.len()).map(|row| dot(row, &values));
            rows.zip(&values).map(|(x, y)| x * y).sum::<f64>()
        };
        assert!(of(&|p| 3.0 + 2.0 * p.x - p.y).abs() < 1e-9);
        assert!(of(&|p| p.x * p.y) > 1e-3);
    }

    #[test]
    fn two_exchanged_points_are_found() {
        let bent = |p: DVec2| DVec2::new(p.x * 1.2 + 0.1 * p.y * p.y, p.y * 0.9 - 0.05 * p.x * p.y);
        let mut pairs: Vec<[DVec2; 2]> = points().into_iter().map(|p| [p, bent(p)]).collect();
        let (_, share) = best_exchange(&pairs).unwrap();
        assert!(share > 1.0, "right pairs: {share}");
        let (a, b) = (pairs[2][1], pairs[7][1]);
        (pairs[2][1], pairs[7][1]) = (b, a);
        let (found, share) = best_exchange(&pairs).unwrap();
        assert_eq!(found, [2, 7]);
        assert!(share < 0.2, "{share}");
    }
}
