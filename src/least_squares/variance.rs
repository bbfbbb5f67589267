//! Components of variance: what residuals say about the noise.

/// The share of the variance `noise` that a fit leaves in a residual of weight `weight` (1: it counts fully), where the
/// fit predicts that residual with the variance `prediction`: `1 + (1 - 2 weight) prediction / noise`.
pub(crate) fn share_left(weight: f64, prediction: f64, noise: f64) -> f64 {
    1.0 + (1.0 - 2.0 * weight) * prediction / noise
}

/// Weighted sums for two components of the variance of residuals, `a + b f` with known factors `f`, by least squares of
/// their squares.
#[derive(Debug, Default)]
pub(crate) struct VarianceComponents {
    ones: f64,
    factors: f64,
    squares: f64,
    by_one: f64,
    by_factor: f64,
}

impl VarianceComponents {
    /// Adds a squared residual with its factor `f`; `weight` is one over the square of its expected variance.
    pub(crate) fn add(&mut self, square: f64, factor: f64, weight: f64) {
        self.ones += weight;
        self.factors += weight * factor;
        self.squares += weight * factor * factor;
        self.by_one += weight * square;
        self.by_factor += weight * factor * square;
    }

    /// The components `a` and `b`, none negative; the first may be known.
    pub(crate) fn solve(&self, first: Option<f64>) -> (f64, f64) {
        let second = |first: f64| ((self.by_factor - first * self.factors) / self.squares).max(0.0);
        if let Some(first) = first {
            return (first, second(first));
        }
        let determinant = self.ones * self.squares - self.factors * self.factors;
        if determinant <= 1e-9 * self.ones * self.squares {
            // All factors are the same, so that the two are one.
            return (self.by_one / self.ones.max(f64::MIN_POSITIVE), 0.0);
        }
        let a = (self.by_one * self.squares - self.by_factor * self.factors) / determinant;
        let b = (self.by_factor * self.ones - self.by_one * self.factors) / determinant;
        if a <= 0.0 {
            (0.0, second(0.0))
        } else if b <= 0.0 {
            (self.by_one / self.ones, 0.0)
        } else {
            (a, b)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Squares that are exactly `2 + 3 f` have these components, and none is negative.
    #[test]
    fn components_are_found_and_never_negative() {
        let of = |a: f64, b: f64, factors: &[f64]| {
            let mut sums = VarianceComponents::default();
            factors.iter().for_each(|f| sums.add(a + b * f, *f, (1.0 + f).powi(-2)));
            sums
        };
        let (a, b) = of(2.0, 3.0, &[0.5, 1.0, 4.0]).solve(None);
        assert!((a - 2.0).abs() < 1e-12 && (b - 3.0).abs() < 1e-12, "{a}, {b}");
        assert!((of(2.0, 3.0, &[0.5, 1.0, 4.0]).solve(Some(2.0)).1 - 3.0).abs() < 1e-12);
        let (a, b) = of(5.0, -1.0, &[0.5, 1.0, 4.0]).solve(None);
        assert!(a > 0.0 && b == 0.0, "{a}, {b}");
        let (a, b) = of(-1.0, 2.0, &[0.6, 1.0, 4.0]).solve(None);
        assert!(a == 0.0 && b > 0.0, "{a}, {b}");
        let (a, b) = of(2.0, 3.0, &[1.0, 1.0]).solve(None);
        assert!((a - 5.0).abs() < 1e-12 && b == 0.0, "one factor: {a}, {b}");
    }
}
