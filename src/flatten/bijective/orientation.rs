//! On which side of a line a point lies, exactly (`(shewchuk1997)`).
//!
//! Crossings and flips are judged with it, so that a map of thin faces is judged as it is and not as
//! it is rounded.

use glam::DVec2;

/// Rounding error of the determinant over the sum of its terms, at most (the paper's first filter).
const FILTER: f64 = (3.0 + 16.0 * f64::EPSILON / 2.0) * f64::EPSILON / 2.0;

/// 1 if the corners run counter-clockwise, -1 if clockwise, 0 if they lie on one line; NaN if one is
/// not finite.
pub(crate) fn orientation([a, b, c]: [DVec2; 3]) -> f64 {
    let (left, right) = ((b.x - a.x) * (c.y - a.y), (b.y - a.y) * (c.x - a.x));
    let area = left - right;
    let sign = |x: f64| if x == 0.0 { 0.0 } else { x.signum() };
    // The negation keeps what is not finite here.
    if area.abs() > FILTER * (left.abs() + right.abs()) || !area.is_finite() {
        return sign(area);
    }
    let products =
        [(a.x, b.y), (-a.y, b.x), (b.x, c.y), (-b.y, c.x), (c.x, a.y), (-c.y, a.x)].map(|(x, y)| {
            let product = x * y;
            [product, x.mul_add(y, -product)]
        });
    sign(leading_term(products.as_flattened()))
}

/// The largest part of the exact sum, which has its sign.
fn leading_term(terms: &[f64]) -> f64 {
    let mut expansion: Vec<f64> = Vec::with_capacity(terms.len());
    for &term in terms {
        let mut carry = term;
        for part in &mut expansion {
            let sum = carry + *part;
            let other = sum - carry;
            *part = (carry - (sum - other)) + (*part - other);
            carry = sum;
        }
        expansion.push(carry);
    }
    expansion.into_iter().rev().find(|&x| x != 0.0).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points near a line, one unit of the last place apart: the rounded determinant is wrong for
    /// many of them.
    #[test]
    fn the_sign_is_that_of_integers() {
        let unit = 2_f64.powi(-52);
        let at = |i: i64, j: i64| DVec2::new(0.5 + i as f64 * unit, 0.5 + j as f64 * unit);
        let (from, to) = (DVec2::splat(12.0), DVec2::splat(24.0));
        let mut wrong = 0;
        for i in 0..32 {
            for j in 0..32 {
                let p = at(i, j);
                let expected = (j - i).signum() as f64;
                assert_eq!(orientation([from, to, p]), expected, "{i} {j}");
                assert_eq!(orientation([to, from, p]), -expected, "{i} {j}");
                wrong += usize::from((to - from).perp_dot(p - from).signum() != expected);
            }
        }
        assert!(wrong > 0, "rounding matters here");
    }

    #[test]
    fn what_is_not_finite_has_no_side() {
        assert!(orientation([DVec2::NAN, DVec2::X, DVec2::Y]).is_nan());
    }
}
