//! The energy of one face: its value, its exact derivatives, and a convex quadratic model of it.
//!
//! # One formula
//!
//! With `J` the Jacobian of the face from the skin to the plane, `s1 >= |s2|` its signed singular
//! values, `d = s1 s2` (the ratio of the areas) and `S = s1^2 + s2^2`, every energy here is
//!
//! ```text
//! E = p(d) S + q(d)
//! ```
//!
//! | energy | `p` | `q` |
//! |---|---|---|
//! | sum of angle and area (eq. 4 of `(cannata)`) | `angle/(2 d)` | `area (d + 1/d)/2` |
//! | symmetric Dirichlet (`(smith2015)`) | `1 + 1/d^2` | 0 |
//! | untangling (`(garanzha2021)`) | `1/chi(d)` | 0 |
//!
//! since `s1/s2 + s2/s1 = S/d` and `1/s1^2 + 1/s2^2 = S/d^2`. So a new energy needs `p` and `q`
//! with two derivatives each, as the test `coefficients` has them, and a name in the options.
//!
//! # Derivatives
//!
//! `d` changes with `s1` by `s2`, and `S` by `2 s1`. With `A = p' S + q'` and `B = p'' S + q''`
//! (primes are derivatives by `d`):
//!
//! ```text
//! g1  = 2 p s1 + A s2
//! h11 = 2 p + 4 d p' + B s2^2
//! h12 = 2 p' S + A + B d
//! ```
//!
//! and `g2`, `h22` with `s1` and `s2` exchanged. On paper: `A` changes with `s1` by
//! `B s2 + 2 p' s1` and with `s2` by `B s1 + 2 p' s2`, so that
//!
//! ```text
//! h11 = 2 p + 2 s1 p' s2 + s2 (B s2 + 2 p' s1)
//! h12 = 2 s1 p' s1 + A + s2 (B s1 + 2 p' s2)
//! ```
//!
//! These are the derivatives along the two *stretches*. Any energy of the singular values alone has
//! two more eigenvectors (`(smith2019)`): the *twist* turns the face, the *flip* shears it, and
//! their curvatures are
//!
//! ```text
//! twist = (g1 + g2)/(s1 + s2) = 2 p + A
//! flip  = (g1 - g2)/(s1 - s2) = 2 p - A
//! ```
//!
//! The two energies with a barrier repeat these five lines multiplied out, because there the terms
//! of `h11` cancel: with `p = a/d` the largest are `(2 - 4 + 2) a/d`. The formula then loses
//! `(s1/s2)^2` units of rounding, 1e-8 of `h11` on a face stretched 1 : 10 000, the written-out
//! form none. A test compares the two.
//!
//! # Convex model
//!
//! Newton needs a positive semi-definite Hessian: the four curvatures (the two of the stretches
//! after a rotation that makes `h12` vanish) are clamped to at least 0 (`(teran2005)`). Near a
//! minimum the whole Hessian is positive although some faces are not, and clamping only makes steps
//! too short: a share of the negative curvatures can be kept.

use glam::{DMat2, DVec2};

use crate::{
    flatten::{Energy, energy::elements::outer},
    mesh::SingularValues,
};

/// Energy of a face per unit of its area, as a function of the singular values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum DistortionEnergy {
    /// `angle (s1/s2 + s2/s1)/2 + area (s1 s2 + 1/(s1 s2))/2`.
    Sum { angle: f64, area: f64 },
    /// `s1^2 + s2^2 + 1/s1^2 + 1/s2^2`.
    SymmetricDirichlet,
    /// `(s1^2 + s2^2)/chi(s1 s2)` with `chi(d) = (d + sqrt(d^2 + 4 e^2))/2`: finite for flipped
    /// faces too.
    Untangling {
        /// `e`: about how deep a flipped face may lie.
        softness: f64,
    },
}

impl From<Energy> for DistortionEnergy {
    fn from(energy: Energy) -> Self {
        match energy {
            Energy::Sum { angle, area, perimeter: _ } => Self::Sum { angle, area },
            Energy::SymmetricDirichlet => Self::SymmetricDirichlet,
        }
    }
}

impl DistortionEnergy {
    /// Whether flipped faces cost infinitely much.
    pub(crate) fn has_barrier(&self) -> bool {
        !matches!(self, Self::Untangling { .. })
    }

    /// The value; infinite for a flipped or collapsed face if there is a barrier.
    pub(crate) fn value(&self, s: &SingularValues) -> f64 {
        let (s1, s2) = (s.s1, s.s2);
        if self.has_barrier() && (s2.is_nan() || s2 <= 0.0) {
            return f64::INFINITY;
        }
        let d = s1 * s2;
        match *self {
            Self::Sum { angle, area } => 0.5 * (angle * (s1 / s2 + s2 / s1) + area * (d + 1.0 / d)),
            Self::SymmetricDirichlet => s1 * s1 + s2 * s2 + (s1 * s1 + s2 * s2) / (d * d),
            Self::Untangling { softness } => untangling(d, softness).value(s),
        }
    }

    fn derivatives(&self, s: &SingularValues) -> Derivatives {
        match *self {
            Self::Sum { angle, area } => sum_derivatives(angle, area, s),
            Self::SymmetricDirichlet => symmetric_dirichlet_derivatives(s),
            Self::Untangling { softness } => untangling(s.s1 * s.s2, softness).derivatives(s),
        }
    }
}

/// `chi`, and its first and second derivative.
fn chi(d: f64, softness: f64) -> [f64; 3] {
    let root = d.hypot(2.0 * softness);
    // For negative areas the sum cancels; the product of both roots is `e^2`.
    let value = if d >= 0.0 { 0.5 * (d + root) } else { 2.0 * softness * softness / (root - d) };
    [value, value / root, 2.0 * softness * softness / (root * root * root)]
}

/// `p` and `q` of the untangling energy.
fn untangling(d: f64, softness: f64) -> Coefficients {
    let [c, c1, c2] = chi(d, softness);
    Coefficients { inverse_p: c, p: [-c1 / (c * c), 2.0 * c1 * c1 / (c * c * c) - c2 / (c * c)], q: [0.0; 3] }
}

/// `p` and `q` of an energy at one `d`, with derivatives by `d`.
#[derive(Debug, Clone, Copy)]
struct Coefficients {
    /// `1/p`: a division by it rounds once where `p` itself is a quotient.
    inverse_p: f64,
    /// `p'`, `p''`.
    p: [f64; 2],
    /// `q`, `q'`, `q''`.
    q: [f64; 3],
}

impl Coefficients {
    fn value(&self, s: &SingularValues) -> f64 {
        (s.s1 * s.s1 + s.s2 * s.s2) / self.inverse_p + self.q[0]
    }

    /// The formulas of the module's page, term by term.
    fn derivatives(&self, s: &SingularValues) -> Derivatives {
        let ([p1, p2], [_, q1, q2], twice_p) = (self.p, self.q, 2.0 / self.inverse_p);
        let (s1, s2) = (s.s1, s.s2);
        let (d, squares) = (s1 * s2, s1 * s1 + s2 * s2);
        let slope = |own: f64, other: f64| 2.0 * own / self.inverse_p + squares * other * p1 + q1 * other;
        let curvature =
            |other: f64| twice_p + 4.0 * d * p1 + squares * other * other * p2 + q2 * other * other;
        let a = squares * p1 + q1;
        Derivatives {
            gradient: [slope(s1, s2), slope(s2, s1)],
            stretch: [curvature(s2), curvature(s1), 3.0 * squares * p1 + squares * d * p2 + (q1 + q2 * d)],
            twist: twice_p + a,
            flip: twice_p - a,
        }
    }
}

/// First derivatives, and the Hessian in the directions of the module's page.
#[derive(Debug, Clone, Copy)]
struct Derivatives {
    /// `g1`, `g2`.
    gradient: [f64; 2],
    /// `h11`, `h22`, `h12`.
    stretch: [f64; 3],
    twist: f64,
    flip: f64,
}

/// [`Coefficients::derivatives`] for `p = a/d`, `q = b (d + 1/d)`, multiplied out so that nothing
/// cancels on a sliver.
fn sum_derivatives(angle: f64, area: f64, s: &SingularValues) -> Derivatives {
    let (s1, s2) = (s.s1, s.s2);
    let (i1, i2) = (1.0 / s1, 1.0 / s2);
    let (a, b) = (0.5 * angle, 0.5 * area);
    let (d, i, squares) = (s1 * s2, i1 * i2, s1 * s1 + s2 * s2);
    Derivatives {
        gradient: [a * (i2 - s2 * i1 * i1) + b * (s2 - i * i1), a * (i1 - s1 * i2 * i2) + b * (s1 - i * i2)],
        stretch: [
            2.0 * i1 * i1 * (a * s2 * i1 + b * i),
            2.0 * i2 * i2 * (a * s1 * i2 + b * i),
            -a * (i1 * i1 + i2 * i2) + b * (1.0 + i * i),
        ],
        twist: a * (i - (squares - d) * i * i) + b * (1.0 - i * i),
        flip: a * (i + (squares + d) * i * i) + b * (i * i - 1.0),
    }
}

/// [`Coefficients::derivatives`] for `p = 1 + 1/d^2`, `q = 0`, multiplied out so that nothing
/// cancels on a sliver.
fn symmetric_dirichlet_derivatives(s: &SingularValues) -> Derivatives {
    let (s1, s2) = (s.s1, s.s2);
    let (i1, i2) = (1.0 / s1, 1.0 / s2);
    let (d, i, squares) = (s1 * s2, i1 * i2, s1 * s1 + s2 * s2);
    let cube = |x: f64| x * x * x;
    Derivatives {
        gradient: [2.0 * (s1 - cube(i1)), 2.0 * (s2 - cube(i2))],
        stretch: [2.0 + 6.0 * i1 * cube(i1), 2.0 + 6.0 * i2 * cube(i2), 0.0],
        twist: 2.0 - 2.0 * (squares - d) * cube(i),
        flip: 2.0 + 2.0 * (squares + d) * cube(i),
    }
}

/// Gradient of one face and its Hessian, projected towards a positive semi-definite one, by corner.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LocalModel {
    pub(crate) gradient: [DVec2; 3],
    /// Blocks of the corner pairs (0,0), (1,1), (2,2).
    pub(crate) diagonal: [DMat2; 3],
    /// Blocks of the corner pairs (0,1), (1,2), (2,0): row first.
    pub(crate) off_diagonal: [DMat2; 3],
}

impl LocalModel {
    /// The model of a face of weight `weight` with hat gradients `hats`, with this share of its negative
    /// curvatures.
    pub(crate) fn new(
        energy: &DistortionEnergy,
        s: &SingularValues,
        hats: &[DVec2; 3],
        weight: f64,
        kept: f64,
    ) -> Self {
        let d = energy.derivatives(s);
        // Modes applied to each hat gradient, of unit Frobenius norm: stretch along the first and
        // second singular direction, twist, flip.
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let stretch = stretches(s, hats);
        let flip = quarter_turn(s.reflection);
        let twists = hats.map(|g| half * quarter_turn(s.rotation.rotate(g)));
        let flips = hats.map(|g| half * reflect(flip, g));

        let [h11, h22, h12] = d.stretch;
        let (mean, difference) = (0.5 * (h11 + h22), 0.5 * (h11 - h22));
        let radius = difference.hypot(h12);
        let (cos, sin) = half_angle(difference, h12);
        let first = stretch.map(|[d1, d2]| cos * d1 + sin * d2);
        let second = stretch.map(|[d1, d2]| cos * d2 - sin * d1);

        // `DMat2::default()` is the identity.
        let mut model =
            Self { gradient: [DVec2::ZERO; 3], diagonal: [DMat2::ZERO; 3], off_diagonal: [DMat2::ZERO; 3] };
        let modes = [(mean + radius, first), (mean - radius, second), (d.twist, twists), (d.flip, flips)];
        for (curvature, mode) in modes {
            let c = weight * curvature.max(kept * curvature.min(0.0));
            for k in 0..3 {
                model.diagonal[k] += outer(c * mode[k], mode[k]);
                model.off_diagonal[k] += outer(c * mode[k], mode[(k + 1) % 3]);
            }
        }
        model.gradient = gradient(&d, &stretch, weight);
        model
    }
}

/// Gradient of one face by corner; see [`LocalModel::new`].
pub(crate) fn face_gradient(
    energy: &DistortionEnergy,
    s: &SingularValues,
    hats: &[DVec2; 3],
    weight: f64,
) -> [DVec2; 3] {
    gradient(&energy.derivatives(s), &stretches(s, hats), weight)
}

fn gradient(d: &Derivatives, stretch: &[[DVec2; 2]; 3], weight: f64) -> [DVec2; 3] {
    stretch.map(|[d1, d2]| weight * (d.gradient[0] * d1 + d.gradient[1] * d2))
}

/// The stretches along the first and second singular direction, applied to each hat gradient.
fn stretches(s: &SingularValues, hats: &[DVec2; 3]) -> [[DVec2; 2]; 3] {
    hats.map(|g| {
        let (r, m) = (s.rotation.rotate(g), reflect(s.reflection, g));
        [0.5 * (r + m), 0.5 * (r - m)]
    })
}

fn quarter_turn(v: DVec2) -> DVec2 {
    DVec2::new(-v.y, v.x)
}

/// `[c, s; s, -c] g` of `m = (c, s)`.
fn reflect(m: DVec2, g: DVec2) -> DVec2 {
    DVec2::new(m.dot(g), DVec2::new(m.y, -m.x).dot(g))
}

/// Cosine and sine of half the angle of the vector `(x, y)`.
fn half_angle(x: f64, y: f64) -> (f64, f64) {
    let length = x.hypot(y);
    if length == 0.0 {
        return (1.0, 0.0);
    }
    // The larger of the two by the square root, the other one by division: nothing cancels.
    if x >= 0.0 {
        let cos = (0.5 * (1.0 + x / length)).sqrt();
        (cos, 0.5 * y / (length * cos))
    } else {
        let sin = (0.5 * (1.0 - x / length)).sqrt() * if y < 0.0 { -1.0 } else { 1.0 };
        (0.5 * y / (length * sin), sin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HATS: [DVec2; 3] = [DVec2::new(-1.2, -0.3), DVec2::new(1.0, -0.7), DVec2::new(0.2, 1.0)];
    const ENERGIES: [DistortionEnergy; 4] = [
        DistortionEnergy::Untangling { softness: 0.1 },
        DistortionEnergy::Sum { angle: 1.0, area: 0.0 },
        DistortionEnergy::Sum { angle: 0.3, area: 1.0 },
        DistortionEnergy::SymmetricDirichlet,
    ];

    fn jacobian(uv: &[DVec2; 3]) -> DMat2 {
        (0..3).map(|k| outer(uv[k], HATS[k])).fold(DMat2::ZERO, |a, b| a + b)
    }

    fn model(energy: &DistortionEnergy, uv: &[DVec2; 3]) -> LocalModel {
        LocalModel::new(energy, &SingularValues::of(&jacobian(uv)), &HATS, 0.7, 0.0)
    }

    /// Unflipped, stretched and turned.
    const UV: [DVec2; 3] = [DVec2::new(0.1, 0.0), DVec2::new(0.9, 0.35), DVec2::new(-0.1, 0.8)];

    #[track_caller]
    fn assert_gradient(energy: &DistortionEnergy, uv: &[DVec2; 3]) {
        let value = |uv: &[DVec2; 3]| 0.7 * energy.value(&SingularValues::of(&jacobian(uv)));
        let found = model(energy, uv).gradient;
        for k in 0..3 {
            for (axis, step) in [DVec2::X, DVec2::Y].into_iter().enumerate() {
                let (mut up, mut down) = (*uv, *uv);
                up[k] += 1e-6 * step;
                down[k] -= 1e-6 * step;
                let difference = (value(&up) - value(&down)) / 2e-6;
                assert!(
                    (found[k][axis] - difference).abs() < 1e-6,
                    "{energy:?}: {} is {difference}",
                    found[k]
                );
            }
        }
    }

    /// The untangling energy is used on flipped faces, so its derivatives must hold there.
    #[test]
    fn the_gradient_is_the_derivative_of_the_value() {
        ENERGIES.iter().for_each(|energy| assert_gradient(energy, &UV));
        let mirrored = UV.map(|p| DVec2::new(-p.x, p.y));
        assert_gradient(&DistortionEnergy::Untangling { softness: 0.3 }, &mirrored);
    }

    /// Near the isometry no curvature is negative, so nothing is clamped and the model is the
    /// Hessian.
    #[test]
    fn the_model_is_the_hessian_where_that_is_positive() {
        // Corners that make the Jacobian nearly the identity: hats and positions are dual.
        let inverse = DMat2::from_cols(HATS[1], HATS[2]).transpose().inverse();
        let uv = [DVec2::ZERO, inverse.x_axis * 1.001, inverse.y_axis + DVec2::new(5e-4, 0.0)];
        for energy in &ENERGIES[2..] {
            let hessian = model(energy, &uv);
            for k in 0..3 {
                let mut moved = uv;
                moved[1] += DVec2::new(1e-6, 0.0);
                let up = model(energy, &moved).gradient[k];
                moved[1] -= DVec2::new(2e-6, 0.0);
                let down = model(energy, &moved).gradient[k];
                let difference = (up - down) / 2e-6;
                let block =
                    [hessian.off_diagonal[0], hessian.diagonal[1], hessian.off_diagonal[1].transpose()][k];
                // One curvature (turning) is slightly negative or positive, of the order of the
                // strain.
                let error = (block.x_axis - difference).length();
                assert!(error < 2e-3, "{energy:?}: {} is {difference}", block.x_axis);
            }
        }
    }

    /// `p` and `q` at the area ratio `d`: the definition of each energy.
    fn coefficients(energy: &DistortionEnergy, d: f64) -> Coefficients {
        let i = 1.0 / d;
        match *energy {
            DistortionEnergy::Sum { angle, area } => {
                let (a, b) = (0.5 * angle, 0.5 * area);
                Coefficients {
                    inverse_p: d / a,
                    p: [-a * i * i, 2.0 * a * i * i * i],
                    q: [b * (d + i), b * (1.0 - i * i), 2.0 * b * i * i * i],
                }
            }
            DistortionEnergy::SymmetricDirichlet => Coefficients {
                inverse_p: 1.0 / (1.0 + i * i),
                p: [-2.0 * i * i * i, 6.0 * i * i * i * i],
                q: [0.0; 3],
            },
            DistortionEnergy::Untangling { softness } => untangling(d, softness),
        }
    }

    /// The written-out derivatives are those of the formula; on slivers the formula alone loses
    /// digits.
    #[test]
    fn every_energy_follows_from_its_two_coefficients() {
        for energy in &ENERGIES {
            for [s1, s2] in [[1.0, 1.0], [1.1, 0.9], [3.0, 0.2], [0.4, 0.3], [7.0, 5.0]] {
                let s = SingularValues::of(&DMat2::from_cols_array(&[s1, 0.0, 0.0, s2]));
                let coefficients = coefficients(energy, s1 * s2);
                let value = coefficients.value(&s);
                assert!((energy.value(&s) - value).abs() <= 1e-14 * value, "{energy:?} at {s1}, {s2}");
                let flat = |d: Derivatives| {
                    let ([g1, g2], [h11, h22, h12]) = (d.gradient, d.stretch);
                    [g1, g2, h11, h22, h12, d.twist, d.flip]
                };
                let (exact, formula) = (flat(energy.derivatives(&s)), flat(coefficients.derivatives(&s)));
                let largest = formula.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
                for (x, y) in exact.into_iter().zip(formula) {
                    assert!(
                        (x - y).abs() <= 1e-14 * largest,
                        "{energy:?} at {s1}, {s2}: {exact:?}, {formula:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn the_written_out_curvature_is_exact_on_a_sliver() {
        let s = SingularValues::of(&DMat2::from_cols_array(&[1.0, 0.0, 0.0, 1e-6]));
        let [h11, ..] = DistortionEnergy::Sum { angle: 1.0, area: 0.0 }.derivatives(&s).stretch;
        assert!((h11 / (s.s2 / s.s1.powi(3)) - 1.0).abs() < 1e-14, "angle s2/s1^3, found {h11}");
        let [h11, ..] = DistortionEnergy::SymmetricDirichlet.derivatives(&s).stretch;
        assert!((h11 - 8.0).abs() < 1e-14, "2 + 6/s1^4, found {h11}");
    }

    #[test]
    fn turning_and_moving_a_face_costs_nothing() {
        for energy in &ENERGIES {
            let m = model(energy, &UV);
            let sum: DVec2 = m.gradient.iter().sum();
            assert!(sum.length() < 1e-14, "no force on the whole face");
            let torque: f64 = UV.iter().zip(&m.gradient).map(|(p, g)| p.perp_dot(*g)).sum();
            assert!(torque.abs() < 1e-14, "no torque on the whole face");
        }
    }

    #[test]
    fn a_flipped_face_costs_infinitely_much_where_there_is_a_barrier() {
        let mirrored = UV.map(|p| DVec2::new(-p.x, p.y));
        for energy in &ENERGIES {
            let value = energy.value(&SingularValues::of(&jacobian(&mirrored)));
            assert_eq!(value.is_infinite(), energy.has_barrier(), "{energy:?}");
        }
    }
}
