use glam::{DMat2, DVec2};

use crate::flatten::{Energy, FlattenOptions, jacobian::Singular};

/// Energy of a face per unit of its area, as a function of the singular values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Density {
    /// `angle (s1/s2 + s2/s1)/2 + area (s1 s2 + 1/(s1 s2))/2`.
    Sum {
        /// Weight of the angle term.
        angle: f64,
        /// Weight of the area term.
        area: f64,
    },
    /// `s1^2 + s2^2 + 1/s1^2 + 1/s2^2`.
    SymmetricDirichlet,
    /// `(s1^2 + s2^2)/chi(s1 s2)` with `chi(d) = (d + sqrt(d^2 + 4 e^2))/2`: finite for flipped faces too.
    Untangling {
        /// `e`: about how deep a flipped face may lie.
        softness: f64,
    },
}

/// `chi`, and its first and second derivative.
fn chi(d: f64, softness: f64) -> [f64; 3] {
    let root = d.hypot(2.0 * softness);
    // For negative areas the sum cancels; the product of both roots is `e^2`.
    let value = if d >= 0.0 { 0.5 * (d + root) } else { 2.0 * softness * softness / (root - d) };
    [value, value / root, 2.0 * softness * softness / (root * root * root)]
}

/// First derivatives, and the Hessian on the four directions that diagonalise every isotropic energy in
/// 2-D (Smith, de Goes and Kim 2019): the two stretches, turning and shearing.
#[derive(Debug, Clone, Copy)]
struct Derivatives {
    gradient: [f64; 2],
    /// Second derivatives by the singular values: 11, 22, 12.
    stretch: [f64; 3],
    /// `(g1 + g2)/(s1 + s2)`.
    turn: f64,
    /// `(g1 - g2)/(s1 - s2)`, written out so that nothing cancels where they are equal.
    shear: f64,
}

impl Density {
    pub(crate) fn new(options: &FlattenOptions) -> Self {
        match options.energy {
            Energy::Sum => Self::Sum { angle: options.angle, area: options.area },
            Energy::SymmetricDirichlet => Self::SymmetricDirichlet,
        }
    }

    /// The value; infinite for a flipped or collapsed face.
    pub(crate) fn value(&self, s: &Singular) -> f64 {
        let (s1, s2) = (s.s1, s.s2);
        let d = s1 * s2;
        if self.has_barrier() && (s2.is_nan() || s2 <= 0.0) {
            return f64::INFINITY;
        }
        match *self {
            Self::Sum { angle, area } => 0.5 * (angle * (s1 / s2 + s2 / s1) + area * (d + 1.0 / d)),
            Self::SymmetricDirichlet => s1 * s1 + s2 * s2 + (s1 * s1 + s2 * s2) / (d * d),
            Self::Untangling { softness } => (s1 * s1 + s2 * s2) / chi(d, softness)[0],
        }
    }

    /// Whether flipped faces cost infinitely much.
    pub(crate) fn has_barrier(&self) -> bool {
        !matches!(self, Self::Untangling { .. })
    }

    fn derivatives(&self, s: &Singular) -> Derivatives {
        let (s1, s2) = (s.s1, s.s2);
        let (i1, i2) = (1.0 / s1, 1.0 / s2);
        let (squares, i) = (s1 * s1 + s2 * s2, i1 * i2);
        match *self {
            Self::Sum { angle, area } => {
                let (a, b) = (0.5 * angle, 0.5 * area);
                let d = s1 * s2;
                Derivatives {
                    gradient: [
                        a * (i2 - s2 * i1 * i1) + b * (s2 - i * i1),
                        a * (i1 - s1 * i2 * i2) + b * (s1 - i * i2),
                    ],
                    stretch: [
                        2.0 * i1 * i1 * (a * s2 * i1 + b * i),
                        2.0 * i2 * i2 * (a * s1 * i2 + b * i),
                        -a * (i1 * i1 + i2 * i2) + b * (1.0 + i * i),
                    ],
                    turn: a * (i - (squares - d) * i * i) + b * (1.0 - i * i),
                    shear: a * (i + (squares + d) * i * i) + b * (i * i - 1.0),
                }
            }
            Self::SymmetricDirichlet => {
                let cube = |x: f64| x * x * x;
                let d = s1 * s2;
                Derivatives {
                    gradient: [2.0 * (s1 - cube(i1)), 2.0 * (s2 - cube(i2))],
                    stretch: [2.0 + 6.0 * i1 * cube(i1), 2.0 + 6.0 * i2 * cube(i2), 0.0],
                    turn: 2.0 - 2.0 * (squares - d) * cube(i),
                    shear: 2.0 + 2.0 * (squares + d) * cube(i),
                }
            }
            Self::Untangling { softness } => {
                let d = s1 * s2;
                let [c, c1, c2] = chi(d, softness);
                // Slope and curvature of 1/chi.
                let (slope, bend) = (-c1 / (c * c), 2.0 * c1 * c1 / (c * c * c) - c2 / (c * c));
                let own = |s: f64, t: f64| 2.0 / c + 4.0 * s * t * slope + squares * t * t * bend;
                Derivatives {
                    gradient: [2.0 * s1 / c + squares * s2 * slope, 2.0 * s2 / c + squares * s1 * slope],
                    stretch: [own(s1, s2), own(s2, s1), 3.0 * squares * slope + squares * d * bend],
                    turn: 2.0 / c + squares * slope,
                    shear: 2.0 / c - squares * slope,
                }
            }
        }
    }
}

/// Gradient of one face and its Hessian, projected to be positive semi-definite, by corner.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LocalModel {
    pub(crate) gradient: [DVec2; 3],
    /// Blocks of the corner pairs (0,0), (1,1), (2,2).
    pub(crate) diagonal: [DMat2; 3],
    /// Blocks of the corner pairs (0,1), (1,2), (2,0): row first.
    pub(crate) beside: [DMat2; 3],
}

impl LocalModel {
    /// The model of a face of weight `weight` with hat gradients `hats`.
    pub(crate) fn new(density: &Density, s: &Singular, hats: &[DVec2; 3], weight: f64) -> Self {
        let d = density.derivatives(s);
        let turned = |v: DVec2| DVec2::new(-v.y, v.x);
        let rotate = |g: DVec2| s.rotation.rotate(g);
        // [c, s; s, -c] g, and the same for the vector turned by a quarter.
        let reflect = |m: DVec2, g: DVec2| DVec2::new(m.dot(g), DVec2::new(m.y, -m.x).dot(g));
        let shear = turned(s.reflection);
        // Modes applied to each hat gradient, of unit Frobenius norm: stretch along the first and
        // second singular direction, turn, shear.
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let stretch = hats.map(|g| {
            let (r, m) = (rotate(g), reflect(s.reflection, g));
            [0.5 * (r + m), 0.5 * (r - m)]
        });
        let turns = hats.map(|g| half * turned(rotate(g)));
        let shears = hats.map(|g| half * reflect(shear, g));

        let [h11, h22, h12] = d.stretch;
        let (mean, difference) = (0.5 * (h11 + h22), 0.5 * (h11 - h22));
        let radius = difference.hypot(h12);
        let (cos, sin) = half_angle(difference, h12);
        let first = stretch.map(|[d1, d2]| cos * d1 + sin * d2);
        let second = stretch.map(|[d1, d2]| cos * d2 - sin * d1);

        // `DMat2::default()` is the identity.
        let mut model =
            Self { gradient: [DVec2::ZERO; 3], diagonal: [DMat2::ZERO; 3], beside: [DMat2::ZERO; 3] };
        let modes = [(mean + radius, first), (mean - radius, second), (d.turn, turns), (d.shear, shears)];
        for (curvature, mode) in modes {
            let c = weight * curvature.max(0.0);
            for k in 0..3 {
                model.diagonal[k] += outer(c * mode[k], mode[k]);
                model.beside[k] += outer(c * mode[k], mode[(k + 1) % 3]);
            }
        }
        model.gradient = stretch.map(|[d1, d2]| weight * (d.gradient[0] * d1 + d.gradient[1] * d2));
        model
    }
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

/// `a b'`.
pub(crate) fn outer(a: DVec2, b: DVec2) -> DMat2 {
    DMat2::from_cols(a * b.x, a * b.y)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HATS: [DVec2; 3] = [DVec2::new(-1.2, -0.3), DVec2::new(1.0, -0.7), DVec2::new(0.2, 1.0)];
    const DENSITIES: [Density; 4] = [
        Density::Untangling { softness: 0.1 },
        Density::Sum { angle: 1.0, area: 0.0 },
        Density::Sum { angle: 0.3, area: 1.0 },
        Density::SymmetricDirichlet,
    ];

    fn jacobian(uv: &[DVec2; 3]) -> DMat2 {
        (0..3).map(|k| outer(uv[k], HATS[k])).fold(DMat2::ZERO, |a, b| a + b)
    }

    fn model(density: &Density, uv: &[DVec2; 3]) -> LocalModel {
        LocalModel::new(density, &Singular::of(&jacobian(uv)), &HATS, 0.7)
    }

    /// Unflipped, stretched and turned.
    const UV: [DVec2; 3] = [DVec2::new(0.1, 0.0), DVec2::new(0.9, 0.35), DVec2::new(-0.1, 0.8)];

    #[test]
    fn the_gradient_is_the_derivative_of_the_value() {
        for density in &DENSITIES {
            let value = |uv: &[DVec2; 3]| 0.7 * density.value(&Singular::of(&jacobian(uv)));
            let found = model(density, &UV).gradient;
            for k in 0..3 {
                for (axis, step) in [DVec2::X, DVec2::Y].into_iter().enumerate() {
                    let (mut up, mut down) = (UV, UV);
                    up[k] += 1e-6 * step;
                    down[k] -= 1e-6 * step;
                    let difference = (value(&up) - value(&down)) / 2e-6;
                    assert!(
                        (found[k][axis] - difference).abs() < 1e-7,
                        "{density:?}: {} is {difference}",
                        found[k]
                    );
                }
            }
        }
    }

    /// Near the isometry no curvature is negative, so nothing is clamped and the model is the Hessian.
    #[test]
    fn the_model_is_the_hessian_where_that_is_positive() {
        // Corners that make the Jacobian nearly the identity: hats and positions are dual.
        let inverse = DMat2::from_cols(HATS[1], HATS[2]).transpose().inverse();
        let uv = [DVec2::ZERO, inverse.x_axis * 1.001, inverse.y_axis + DVec2::new(5e-4, 0.0)];
        for density in &DENSITIES[2..] {
            let hessian = model(density, &uv);
            for k in 0..3 {
                let mut moved = uv;
                moved[1] += DVec2::new(1e-6, 0.0);
                let up = model(density, &moved).gradient[k];
                moved[1] -= DVec2::new(2e-6, 0.0);
                let down = model(density, &moved).gradient[k];
                let difference = (up - down) / 2e-6;
                let block = [hessian.beside[0], hessian.diagonal[1], hessian.beside[1].transpose()][k];
                // One curvature (turning) is slightly negative or positive, of the order of the strain.
                let error = (block.x_axis - difference).length();
                assert!(error < 2e-3, "{density:?}: {} is {difference}", block.x_axis);
            }
        }
    }

    #[test]
    fn turning_and_moving_a_face_costs_nothing() {
        for density in &DENSITIES {
            let m = model(density, &UV);
            let sum: DVec2 = m.gradient.iter().sum();
            assert!(sum.length() < 1e-14, "no force on the whole face");
            let torque: f64 = UV.iter().zip(&m.gradient).map(|(p, g)| p.perp_dot(*g)).sum();
            assert!(torque.abs() < 1e-14, "no torque on the whole face");
        }
    }

    #[test]
    fn a_flipped_face_costs_infinitely_much_where_there_is_a_barrier() {
        let mirrored = UV.map(|p| DVec2::new(-p.x, p.y));
        for density in &DENSITIES {
            let value = density.value(&Singular::of(&jacobian(&mirrored)));
            assert_eq!(value.is_infinite(), density.has_barrier(), "{density:?}");
        }
    }

    /// The untangling energy is used on flipped faces, so its derivatives must hold there.
    #[test]
    fn the_gradient_holds_for_a_flipped_face() {
        let density = Density::Untangling { softness: 0.3 };
        let mirrored = UV.map(|p| DVec2::new(-p.x, p.y));
        let value = |uv: &[DVec2; 3]| 0.7 * density.value(&Singular::of(&jacobian(uv)));
        let found = model(&density, &mirrored).gradient;
        for k in 0..3 {
            for (axis, step) in [DVec2::X, DVec2::Y].into_iter().enumerate() {
                let (mut up, mut down) = (mirrored, mirrored);
                up[k] += 1e-6 * step;
                down[k] -= 1e-6 * step;
                let difference = (value(&up) - value(&down)) / 2e-6;
                assert!((found[k][axis] - difference).abs() < 1e-6, "{} is {difference}", found[k]);
            }
        }
    }
}
