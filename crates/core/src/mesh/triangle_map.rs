//! The normal of a triangle, and its map from space to the plane: layout, Jacobian and signed singular
//! values.

use glam::{DMat2, DVec2, DVec3};

/// The normal of a triangle, twice as long as its area, in m^2.
#[inline]
#[doc(hidden)]
pub fn triangle_cross([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

/// Signed area of a triangle of the plane, positive if it runs counter-clockwise.
pub(crate) fn signed_area([a, b, c]: [DVec2; 3]) -> f64 {
    0.5 * (b - a).perp_dot(c - a)
}

/// A triangle laid flat: corner 0 at the origin, corner 1 at `(base, 0)`, corner 2 at `apex`
/// with `apex.y >= 0`, in m.
#[derive(Debug, Clone, Copy, PartialEq)]
#[doc(hidden)]
pub struct FlatTriangle {
    pub(crate) base: f64,
    pub(crate) apex: DVec2,
}

impl FlatTriangle {
    /// The triangle as it is; not finite if its first edge has no length.
    #[doc(hidden)]
    pub fn new([a, b, c]: [DVec3; 3]) -> Self {
        let (e1, e2) = (b - a, c - a);
        let base = e1.length();
        Self { base, apex: DVec2::new(e1.dot(e2), e1.cross(e2).length()) / base }
    }

    #[doc(hidden)]
    pub fn area(&self) -> f64 {
        0.5 * self.base * self.apex.y
    }

    /// The triangle itself, or, if its height is less than `least` times its longest edge, one of that height
    /// over the same edge. `None` if all corners coincide.
    pub(crate) fn healed(self, corners: [DVec3; 3], least: f64) -> Option<Self> {
        let side = |k: usize| corners[k].distance(corners[(k + 1) % 3]);
        let k = (1..3).fold(0, |best, k| if side(k) > side(best) { k } else { best });
        let longest = side(k);
        if longest.is_nan() || longest <= 0.0 {
            return None;
        }
        if 2.0 * self.area() >= least * longest * longest {
            return Some(self);
        }
        let (from, to, over) = (corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]);
        let foot = (over - from).dot((to - from) / longest);
        let mut at = [DVec2::ZERO; 3];
        at[(k + 1) % 3] = DVec2::new(longest, 0.0);
        at[(k + 2) % 3] = DVec2::new(foot, least * longest);
        let (e1, e2) = (at[1] - at[0], at[2] - at[0]);
        let base = e1.length();
        Some(Self { base, apex: DVec2::new(e1.dot(e2), e1.perp_dot(e2)) / base })
    }

    /// Gradients of the three hat functions, in 1/m.
    pub(crate) fn gradients(&self) -> [DVec2; 3] {
        let g1 = DVec2::new(1.0, -self.apex.x / self.apex.y) / self.base;
        let g2 = DVec2::new(0.0, 1.0 / self.apex.y);
        [-g1 - g2, g1, g2]
    }

    /// Jacobian of the linear map that takes the triangle to `uv`.
    #[doc(hidden)]
    pub fn jacobian(&self, [a, b, c]: [DVec2; 3]) -> DMat2 {
        let x = (b - a) / self.base;
        let y = (c - a - x * self.apex.x) / self.apex.y;
        DMat2::from_cols(x, y)
    }
}

/// Signed singular values of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
#[doc(hidden)]
pub struct SingularValues {
    /// Larger singular value, non-negative.
    #[doc(hidden)]
    pub s1: f64,
    /// Smaller one, `s1 >= |s2|`, negative for a mirrored map.
    #[doc(hidden)]
    pub s2: f64,
}

impl SingularValues {
    #[inline(always)]
    #[doc(hidden)]
    pub fn of(j: &DMat2) -> Self {
        let (a, b, c, d) = (j.x_axis.x, j.y_axis.x, j.x_axis.y, j.y_axis.y);
        let (turn, mirror) = (DVec2::new(a + d, c - b), DVec2::new(a - d, c + b));
        let (p, q) = (0.5 * turn.length(), 0.5 * mirror.length());
        Self { s1: p + q, s2: p - q }
    }
}

/// The symmetric Dirichlet energy of a map at its best scale: the mean of `s1^2 + s2^2 + 1/s1^2 + 1/s2^2`.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct SymmetricDirichlet {
    area: f64,
    squares: f64,
    inverse: f64,
}

impl SymmetricDirichlet {
    /// The energy of an isometry.
    pub(crate) const ISOMETRY: f64 = 4.0;

    /// Adds a face of this area on the skin.
    pub(crate) fn add(&mut self, area: f64, s1: f64, s2: f64) {
        self.area += area;
        self.squares += area * (s1 * s1 + s2 * s2);
        self.inverse += area * (1.0 / (s1 * s1) + 1.0 / (s2 * s2));
    }

    /// The energy at the best scale; infinite or NaN where a face has no area on the map.
    pub(crate) fn energy(&self) -> f64 {
        2.0 * ((self.squares / self.area) * (self.inverse / self.area)).sqrt()
    }

    pub(crate) fn scale(&self) -> f64 {
        (self.inverse / self.squares).powf(0.25)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn singular_values_have_the_norm_and_the_determinant_of_the_map() {
        let j = DMat2::from_cols_array(&[1.5, -0.25, 0.75, 2.0]);
        let s = SingularValues::of(&j);
        let norm = j.x_axis.length_squared() + j.y_axis.length_squared();
        assert!((s.s1 * s.s1 + s.s2 * s.s2 - norm).abs() < 1e-15 * norm, "{s:?}");
        assert!((s.s1 * s.s2 - j.determinant()).abs() < 1e-15 * norm, "{s:?}");
    }

    #[test]
    fn a_triangle_maps_to_its_own_layout_by_the_identity() {
        let corners = [DVec3::new(0.1, 0.2, 0.3), DVec3::new(0.4, 0.1, 0.7), DVec3::new(-0.2, 0.5, 0.1)];
        let flat = FlatTriangle::new(corners);
        let j = flat.jacobian([DVec2::ZERO, DVec2::new(flat.base, 0.0), flat.apex]);
        assert!((j - DMat2::IDENTITY).to_cols_array().iter().all(|x| x.abs() < 1e-15), "{j}");
    }
}
