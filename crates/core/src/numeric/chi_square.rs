//! The chi-square distribution, tail probability and quantile, and the tail of the F distribution.

/// Chance that a chi-square variable of `degrees` degrees of freedom is above `x`: the upper
/// regularised incomplete gamma function `Q(degrees / 2, x / 2)`.
///
/// Series below the mean, continued fraction above it (`(abramowitz1964)`, 6.5.29 and 6.5.31).
pub(crate) fn chi_square_tail(x: f64, degrees: f64) -> f64 {
    let (a, x) = (0.5 * degrees, 0.5 * x);
    if x <= 0.0 || a <= 0.0 {
        return 1.0;
    }
    if !x.is_finite() {
        return if x.is_nan() { x } else { 0.0 };
    }
    let front = (a * x.ln() - x - libm::lgamma(a)).exp();
    if x < a + 1.0 { 1.0 - front * lower_series(a, x) } else { front * upper_fraction(a, x) }
}

/// Chance that a ratio of two mean squares, of `above` and of `below` degrees of freedom, is above `x`: the regularised
/// incomplete beta function `I_z(below / 2, above / 2)` at `z = below / (below + above x)` (`(abramowitz1964)`, 26.5.8 and
/// 26.6.2).
pub(crate) fn f_tail(x: f64, above: f64, below: f64) -> f64 {
    if x.is_nan() || x <= 0.0 {
        return if x.is_nan() { x } else { 1.0 };
    }
    let (a, b, z) = (0.5 * below, 0.5 * above, below / (below + above * x));
    let front = libm::lgamma(a + b) - libm::lgamma(a) - libm::lgamma(b) + a * z.ln() + b * (-z).ln_1p();
    // The fraction converges fast below the mean.
    if z < (a + 1.0) / (a + b + 2.0) {
        front.exp() / a * beta_fraction(z, a, b)
    } else {
        1.0 - front.exp() / b * beta_fraction(1.0 - z, b, a)
    }
}

/// Modified Lentz.
fn beta_fraction(z: f64, a: f64, b: f64) -> f64 {
    const TINY: f64 = 1e-300;
    let guard = |y: f64| if y.abs() < TINY { TINY } else { y };
    let mut c = 1.0;
    let mut d = 1.0 / guard(1.0 - (a + b) * z / (a + 1.0));
    let mut h = d;
    for i in 1..=most_terms(a + b) {
        let m = f64::from(i);
        let even = m * (b - m) * z / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        let odd = -(a + m) * (a + b + m) * z / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        let mut factor = 1.0;
        for numerator in [even, odd] {
            d = 1.0 / guard(1.0 + numerator * d);
            c = guard(1.0 + numerator / c);
            factor = c * d;
            h *= factor;
        }
        if (factor - 1.0).abs() < f64::EPSILON {
            break;
        }
    }
    h
}

/// Terms after which either expansion has converged: it takes about `sqrt(a)` of them.
fn most_terms(a: f64) -> u32 {
    #[expect(clippy::cast_possible_truncation, reason = "saturates, and stays positive")]
    let terms = (20.0 * a.sqrt()) as u32;
    terms.saturating_add(200)
}

fn lower_series(a: f64, x: f64) -> f64 {
    let mut term = 1.0 / a;
    let mut sum = term;
    let mut n = a;
    for _ in 0..most_terms(a) {
        n += 1.0;
        term *= x / n;
        sum += term;
        if term < sum * f64::EPSILON {
            break;
        }
    }
    sum
}

/// Modified Lentz.
fn upper_fraction(a: f64, x: f64) -> f64 {
    /// Takes the place of 0 in the fraction: any number far below its terms serves.
    const TINY: f64 = 1e-300;
    let guard = |y: f64| if y.abs() < TINY { TINY } else { y };
    let mut b = x + 1.0 - a;
    let mut c = 1.0 / TINY;
    let mut d = 1.0 / guard(b);
    let mut h = d;
    for i in 1..=most_terms(a) {
        let i = f64::from(i);
        let numerator = -i * (i - a);
        b += 2.0;
        d = 1.0 / guard(numerator * d + b);
        c = guard(b + numerator / c);
        let factor = c * d;
        h *= factor;
        if (factor - 1.0).abs() < f64::EPSILON {
            break;
        }
    }
    h
}

/// The value that a chi-square variable stays below with chance `share`.
pub(crate) fn quantile(share: f64, degrees: f64) -> f64 {
    let (mut low, mut high) = (0.0, degrees + 10.0);
    while 1.0 - chi_square_tail(high, degrees) < share {
        high *= 2.0;
    }
    // Halving until the bracket is one rounding wide.
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if 1.0 - chi_square_tail(middle, degrees) < share { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_degrees_of_freedom_are_an_exponential() {
        for x in [0.01, 1.0, 3.0, 10.0, 50.0] {
            let (found, expected) = (chi_square_tail(x, 2.0), (-0.5 * x).exp());
            assert!((found - expected).abs() < 1e-14, "Q({x}) = {found}, not {expected}");
        }
        assert_eq!(chi_square_tail(f64::INFINITY, 2.0), 0.0);
        assert!(chi_square_tail(f64::NAN, 2.0).is_nan());
    }

    /// With 2 degrees above, the tail is a power; with many below, that of chi-square; with 1 and 1, an arctangent.
    #[test]
    fn the_tail_of_f_is_that_of_known_laws() {
        for x in [0.01, 0.7, 3.0, 40.0, 3000.0] {
            for below in [1.0, 8.8, 330.0] {
                let (found, expected) = (f_tail(x, 2.0, below), (1.0 + 2.0 * x / below).powf(-0.5 * below));
                assert!((found / expected - 1.0).abs() < 1e-10, "{x}, {below}: {found}, not {expected}");
            }
            let (found, expected) = (f_tail(x, 3.0, 1e9), chi_square_tail(3.0 * x, 3.0));
            assert!(
                (found - expected).abs() < 1e-6 * expected.max(1e-300) + 1e-12,
                "{x}: {found}, {expected}"
            );
            let (found, expected) = (f_tail(x, 1.0, 1.0), 1.0 - 2.0 / std::f64::consts::PI * x.sqrt().atan());
            assert!((found - expected).abs() < 1e-12, "{x}: {found}, not {expected}");
        }
        assert_eq!(f_tail(0.0, 3.0, 9.0), 1.0);
        assert!(f_tail(f64::NAN, 3.0, 9.0).is_nan());
        assert_eq!(f_tail(f64::INFINITY, 3.0, 9.0), 0.0);
    }

    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (share, degrees, expected) in
            [(0.95, 1.0, 3.841), (0.95, 3.0, 7.815), (0.99, 3.0, 11.345), (0.99, 6.0, 16.812)]
        {
            let found = quantile(share, degrees);
            assert!((found - expected).abs() < 1e-3, "{share} of {degrees}: {found} is not {expected}");
        }
    }

    #[test]
    fn many_degrees_of_freedom_tend_to_a_normal_variable() {
        let n = 1.2e6;
        let half = chi_square_tail(n, n);
        assert!((half - 0.5).abs() < 1e-3, "{half}");
        // Two standard deviations above the mean.
        let tail = chi_square_tail(n + 2.0 * (2.0 * n).sqrt(), n);
        assert!((tail - 0.02275).abs() < 2e-4, "{tail}");
    }
}
