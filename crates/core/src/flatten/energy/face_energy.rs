//! The energy of one face: its value, its exact derivatives, and a convex quadratic model of it.
//!
//! # One formula
//!
//! With `J` the Jacobian of the face from the skin to the plane, `s1 >= |s2|` its signed singular
//! values, `d = s1 s2 = det J` (the ratio of the areas) and `S = s1^2 + s2^2 = |J|^2`, every energy here
//! is
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
//! with two derivatives each, and a name in the options.
//!
//! # Derivatives
//!
//! `d` changes with `s1` by `s2`, and `S` by `2 s1`. With `A = p' S + q'` and `B = p'' S + q''` (primes are
//! derivatives by `d`) the derivatives along the two *stretches* are
//!
//! ```text
//! g1  = 2 p s1 + A s2
//! h11 = 2 p + 4 d p' + B s2^2
//! h12 = 2 p' S + A + B d
//! ```
//!
//! and `g2`, `h22` with `s1` and `s2` exchanged. Any energy of the singular values alone has two more
//! eigenvectors (`(smith2019)`): the *twist* turns the face, the *flip* shears it, and their curvatures are
//! `2 p + A` and `2 p - A`.
//!
//! `J = R + N`, where `R` is a similarity and `N` a mirrored one; at unit length, the stretches are their sum and
//! their difference. The twist is the other direction of all similarities, the flip that of all mirrored ones.
//! So the Hessian is a multiple of the projections onto both, and a rest along the stretches.
//! Written in the directions of `R` and `N`, that rest needs no square root, but then every entry of it contains
//! the largest curvature of a needle, `6/s2^4`: rounding makes it indefinite.
//!
//! # Convex model
//!
//! Newton needs a positive semi-definite Hessian: negative curvatures are clamped to 0 (`(teran2005)`). Near
//! a minimum the whole Hessian is positive although those of some faces are not, and clamping only makes
//! steps too short: a share of the negative curvatures can be kept.

use glam::{DMat2, DVec2};

use crate::flatten::{Energy, energy::elements::outer};

/// Energy of a face per unit of its area, as a function of its Jacobian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum DistortionEnergy {
    /// `angle (s1/s2 + s2/s1)/2 + area (s1 s2 + 1/(s1 s2))/2`.
    Sum { angle: f64, area: f64 },
    /// `s1^2 + s2^2 + 1/s1^2 + 1/s2^2`.
    SymmetricDirichlet,
    /// `(s1^2 + s2^2)/chi(s1 s2)` with `chi(d) = (d + sqrt(d^2 + 4 e^2))/2`: finite for flipped
    /// faces too.
    Untangling {
        /// `e`: about how negative the area of a flipped face may be.
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

/// `p` and `q` of an energy at one `d`, and their first and second derivatives by `d`.
struct Coefficients {
    p: [f64; 3],
    q: [f64; 3],
}

impl DistortionEnergy {
    /// Whether the energy of flipped faces is infinite.
    pub(crate) fn has_barrier(&self) -> bool {
        !matches!(self, Self::Untangling { .. })
    }

    #[inline(always)]
    fn coefficients(&self, d: f64) -> Coefficients {
        match *self {
            Self::Sum { angle, area } => {
                let (i, a, b) = (1.0 / d, 0.5 * angle, 0.5 * area);
                let (p, cube) = (a * i, i * i * i);
                Coefficients {
                    p: [p, -p * i, 2.0 * a * cube],
                    q: [b * (d + i), b * (1.0 - i * i), 2.0 * b * cube],
                }
            }
            Self::SymmetricDirichlet => {
                let i = 1.0 / d;
                let square = i * i;
                Coefficients { p: [1.0 + square, -2.0 * square * i, 6.0 * square * square], q: [0.0; 3] }
            }
            Self::Untangling { softness } => {
                let [c, c1, c2] = chi(d, softness);
                let p = 1.0 / c;
                Coefficients { p: [p, -c1 * p * p, (2.0 * c1 * c1 * p - c2) * p * p], q: [0.0; 3] }
            }
        }
    }

    /// The value; infinite for a flipped or collapsed face if there is a barrier.
    #[inline(always)]
    pub(crate) fn value(&self, j: &DMat2) -> f64 {
        let d = j.determinant();
        if self.has_barrier() && (d.is_nan() || d <= 0.0) {
            return f64::INFINITY;
        }
        let Coefficients { p, q } = self.coefficients(d);
        p[0] * (j.x_axis.length_squared() + j.y_axis.length_squared()) + q[0]
    }
}

/// `chi`, and its first and second derivative.
fn chi(d: f64, softness: f64) -> [f64; 3] {
    let root = d.hypot(2.0 * softness);
    // For negative areas the sum cancels; the product of both roots is `e^2`.
    let value = if d >= 0.0 { 0.5 * (d + root) } else { 2.0 * softness * softness / (root - d) };
    [value, value / root, 2.0 * softness * softness / (root * root * root)]
}

/// The derivatives of the energy of a face, and its hat gradients along the two stretches.
struct Derivatives {
    /// The first and the second stretch, of unit Frobenius norm, applied to each hat gradient.
    stretches: [[DVec2; 3]; 2],
    /// `g1`, `g2`.
    slopes: [f64; 2],
    /// `h11`, `h22`, `h12`.
    block: [f64; 3],
    twist: f64,
    flip: f64,
}

impl Derivatives {
    #[inline(always)]
    fn new(energy: &DistortionEnergy, j: &DMat2, hats: &[DVec2; 3]) -> Self {
        let (x, y) = (j.x_axis, j.y_axis);
        let (d, square) = (j.determinant(), x.length_squared() + y.length_squared());
        let Coefficients { p: [p, p1, p2], q: [_, q1, q2] } = energy.coefficients(d);
        let (a, b) = (p1 * square + q1, p2 * square + q2);
        // `[r.x, -r.y; r.y, r.x]/2` is `R`, `[n.x, n.y; n.y, -n.x]/2` is `N`.
        let (r, n) = (DVec2::new(x.x + y.y, x.y - y.x), DVec2::new(x.x - y.y, x.y + y.x));
        let unit =
            |v: DVec2, length: f64| if length > 0.0 { v * (0.5 / length) } else { DVec2::new(0.5, 0.0) };
        let (of_r, of_n) = (r.length(), n.length());
        let (r, n) = (unit(r, of_r), unit(n, of_n));
        let s1 = 0.5 * (of_r + of_n);
        // Not the difference of the two lengths: that has the digits of `s1`.
        let s2 = if s1 > 0.0 { d / s1 } else { 0.0 };
        let applied = hats.map(|g| (r.rotate(g), DVec2::new(n.dot(g), g.perp_dot(n))));
        let curvature = 2.0 * p + 4.0 * d * p1;
        Self {
            stretches: [applied.map(|(r, n)| r + n), applied.map(|(r, n)| r - n)],
            slopes: [2.0 * p * s1 + a * s2, 2.0 * p * s2 + a * s1],
            block: [curvature + b * s2 * s2, curvature + b * s1 * s1, 2.0 * p1 * square + a + b * d],
            twist: 2.0 * p + a,
            flip: 2.0 * p - a,
        }
    }

    /// The gradient of a face of this weight, by corner.
    #[inline(always)]
    fn gradient(&self, weight: f64) -> [DVec2; 3] {
        let [first, second] = &self.stretches;
        let [g1, g2] = self.slopes.map(|g| weight * g);
        [0, 1, 2].map(|k| g1 * first[k] + g2 * second[k])
    }
}

/// The matrix `[x, z; z, y]` with a share `kept` of its negative eigenvalues.
#[inline(always)]
fn clamped([x, y, z]: [f64; 3], kept: f64) -> [f64; 3] {
    let determinant = x * y - z * z;
    if determinant >= 0.0 && x + y >= 0.0 {
        return [x, y, z];
    }
    let half = 0.5 * (x - y);
    let radius = (half * half + z * z).sqrt();
    let largest = 0.5 * (x + y) + radius;
    if largest <= 0.0 || determinant >= 0.0 {
        return [x, y, z].map(|h| kept * h);
    }
    // The negative eigenvalue is `determinant/largest`; the projection onto its direction is the difference of
    // `largest` and the matrix, over that of the eigenvalues.
    let removed = (1.0 - kept) * determinant / (largest * 2.0 * radius);
    [x - removed * (largest - x), y - removed * (largest - y), z + removed * z]
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
    /// The model of a face of weight `weight` with hat gradients `hats` and the Jacobian `j`, with the share
    /// `kept` of its negative curvatures.
    #[inline(always)]
    pub(crate) fn new(
        energy: &DistortionEnergy,
        j: &DMat2,
        hats: &[DVec2; 3],
        weight: f64,
        kept: f64,
    ) -> Self {
        let derivatives = Derivatives::new(energy, j, hats);
        let [twist, flip] = [derivatives.twist, derivatives.flip].map(|c| weight * c.max(kept * c.min(0.0)));
        let (even, odd) = (0.5 * (twist + flip), 0.5 * (twist - flip));
        let [h11, h22, h12] = clamped(derivatives.block, kept).map(|h| weight * h);
        let (h11, h22, h12) = (h11 - even, h22 - even, h12 - odd);
        let [first, second] = &derivatives.stretches;
        let block = |k: usize, l: usize| {
            let (dot, cross) = (even * hats[k].dot(hats[l]), odd * hats[k].perp_dot(hats[l]));
            outer(first[k], h11 * first[l] + h12 * second[l])
                + outer(second[k], h12 * first[l] + h22 * second[l])
                + DMat2::from_cols(DVec2::new(dot, -cross), DVec2::new(cross, dot))
        };
        Self {
            gradient: derivatives.gradient(weight),
            diagonal: [block(0, 0), block(1, 1), block(2, 2)],
            off_diagonal: [block(0, 1), block(1, 2), block(2, 0)],
        }
    }
}

/// Gradient of one face by corner; see [`LocalModel::new`].
pub(crate) fn face_gradient(
    energy: &DistortionEnergy,
    j: &DMat2,
    hats: &[DVec2; 3],
    weight: f64,
) -> [DVec2; 3] {
    Derivatives::new(energy, j, hats).gradient(weight)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::symmetric_eigen;

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

    /// Unflipped, stretched and turned.
    const UV: [DVec2; 3] = [DVec2::new(0.1, 0.0), DVec2::new(0.9, 0.35), DVec2::new(-0.1, 0.8)];

    #[track_caller]
    fn assert_gradient(energy: &DistortionEnergy, uv: &[DVec2; 3]) {
        let value = |uv: &[DVec2; 3]| 0.7 * energy.value(&jacobian(uv));
        let found = face_gradient(energy, &jacobian(uv), &HATS, 0.7);
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

    /// With these hats the positions of the second and third corner are the columns of the Jacobian.
    const UNIT: [DVec2; 3] = [DVec2::new(-1.0, -1.0), DVec2::X, DVec2::Y];

    /// The model by the four entries of the Jacobian.
    fn by_entries(energy: &DistortionEnergy, j: &DMat2, kept: f64) -> [[f64; 4]; 4] {
        let m = LocalModel::new(energy, j, &UNIT, 1.0, kept);
        let blocks = [[m.diagonal[1], m.off_diagonal[1]], [m.off_diagonal[1].transpose(), m.diagonal[2]]];
        std::array::from_fn(|i| std::array::from_fn(|k| blocks[i / 2][k / 2].col(k % 2)[i % 2]))
    }

    /// Isometric, turned, sheared, stretched, flat, nearly collapsed, and shrunk.
    fn jacobians() -> impl Iterator<Item = DMat2> {
        let stretches =
            [[1.0, 1.0], [1.1, 0.9], [3.0, 0.2], [0.4, 0.3], [7.0, 5.0], [1.0, 1e-2], [2.0, 1e-3]];
        stretches.into_iter().flat_map(|[s1, s2]| {
            [0.0, 0.7, 2.9].map(|angle| {
                let stretch = DMat2::from_diagonal(DVec2::new(s1, s2));
                DMat2::from_angle(angle) * stretch * DMat2::from_angle(1.0 - 2.0 * angle)
            })
        })
    }

    /// A face with a smaller area counts as flat on the map.
    const NO_AREA: f64 = 1e-4;

    #[track_caller]
    fn assert_model(energy: &DistortionEnergy, j: &DMat2) {
        let hessian = by_entries(energy, j, 1.0);
        let largest = hessian.as_flattened().iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        let slope = |k: usize, by: f64| {
            let mut moved = j.to_cols_array();
            moved[k] += by;
            let [_, a, b] = face_gradient(energy, &DMat2::from_cols_array(&moved), &UNIT, 1.0);
            [a.x, a.y, b.x, b.y]
        };
        let step = 1e-5 * j.determinant().abs().max(NO_AREA) / j.x_axis.length().max(j.y_axis.length());
        for k in 0..4 {
            let slopes = slope(k, step).into_iter().zip(slope(k, -step));
            for (row, (up, down)) in hessian.iter().zip(slopes) {
                let difference = (up - down) / (2.0 * step);
                let error = (row[k] - difference).abs();
                assert!(error < 1e-6 * largest, "{energy:?} at {j}: {} is {difference}", row[k]);
            }
        }
        let (curvatures, directions) = symmetric_eigen(&hessian);
        for kept in [0.0, 0.3] {
            let model = by_entries(energy, j, kept);
            for i in 0..4 {
                for k in 0..4 {
                    let along = |m: usize| directions[i][m] * directions[k][m];
                    let expected: f64 =
                        (0..4).map(|m| curvatures[m].max(kept * curvatures[m]) * along(m)).sum();
                    let error = (model[i][k] - expected).abs();
                    assert!(error < 1e-13 * largest, "{energy:?} at {j}, {kept} kept: {error}");
                }
            }
        }
    }

    /// The model has the directions of curvature of the energy itself, and the given share of its negative
    /// curvatures.
    #[test]
    fn the_model_is_the_hessian_with_negative_curvatures_scaled() {
        for energy in &ENERGIES {
            jacobians().for_each(|j| assert_model(energy, &j));
        }
        for j in jacobians() {
            let mirrored = DMat2::from_cols(j.x_axis, -j.y_axis);
            assert_model(&DistortionEnergy::Untangling { softness: 0.3 }, &mirrored);
        }
        assert_model(&DistortionEnergy::Untangling { softness: 0.3 }, &DMat2::from_cols(DVec2::X, DVec2::X));
    }

    #[test]
    fn turning_and_moving_a_face_costs_nothing() {
        for energy in &ENERGIES {
            let gradient = face_gradient(energy, &jacobian(&UV), &HATS, 0.7);
            let sum: DVec2 = gradient.iter().sum();
            assert!(sum.length() < 1e-14, "no force on the whole face");
            let torque: f64 = UV.iter().zip(&gradient).map(|(p, g)| p.perp_dot(*g)).sum();
            assert!(torque.abs() < 1e-14, "no torque on the whole face");
        }
    }

    #[test]
    fn a_barrier_makes_the_energy_of_a_flipped_face_infinite() {
        let mirrored = UV.map(|p| DVec2::new(-p.x, p.y));
        for energy in &ENERGIES {
            let value = energy.value(&jacobian(&mirrored));
            assert_eq!(value.is_infinite(), energy.has_barrier(), "{energy:?}");
        }
    }
}
