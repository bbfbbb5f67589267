//! Covariances of positions.

use glam::DMat3;

/// The covariance of a position: a symmetric matrix of 3 x 3, in m^2.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Covariance {
    /// Variance of `x`.
    pub xx: f64,
    /// Covariance of `x` and `y`.
    pub xy: f64,
    /// Covariance of `x` and `z`.
    pub xz: f64,
    /// Variance of `y`.
    pub yy: f64,
    /// Covariance of `y` and `z`.
    pub yz: f64,
    /// Variance of `z`.
    pub zz: f64,
}

impl Covariance {
    /// `M C M'`: the covariance of `M x`.
    pub(crate) fn conjugate(self, m: &DMat3) -> Self {
        (*m * DMat3::from(self) * m.transpose()).into()
    }

    /// Square root of the trace, in m: the root mean square distance from the mean.
    pub fn sigma(self) -> f64 {
        (self.xx + self.yy + self.zz).max(0.0).sqrt()
    }
}

/// From `xx xy xz yy yz zz`, the upper triangle row by row, as files write it.
impl From<[f64; 6]> for Covariance {
    fn from([xx, xy, xz, yy, yz, zz]: [f64; 6]) -> Self {
        Self { xx, xy, xz, yy, yz, zz }
    }
}

/// `xx xy xz yy yz zz`.
impl From<Covariance> for [f64; 6] {
    fn from(Covariance { xx, xy, xz, yy, yz, zz }: Covariance) -> Self {
        [xx, xy, xz, yy, yz, zz]
    }
}

/// From the upper triangle of a matrix that is symmetric up to rounding.
impl From<DMat3> for Covariance {
    fn from(m: DMat3) -> Self {
        let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
        Self { xx: x.x, xy: y.x, xz: z.x, yy: y.y, yz: z.y, zz: z.z }
    }
}

impl From<Covariance> for DMat3 {
    fn from(Covariance { xx, xy, xz, yy, yz, zz }: Covariance) -> Self {
        Self::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz])
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn covariance() -> Covariance {
        [4.0, 1.0, 0.5, 3.0, 0.25, 2.0].into()
    }

    #[test]
    fn a_rotation_keeps_the_size_of_a_covariance() {
        let turned = covariance().conjugate(&DMat3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.1));
        assert!((turned.sigma() - 3.0).abs() < 1e-14, "sigma {}", turned.sigma());
        assert!((turned.xx - covariance().xx).abs() > 0.1, "but the axes change");
        let rounded = Covariance::from([-1e-30, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(rounded.sigma(), 0.0, "rounding below zero has no size");
    }

    /// Stretching x by 2 doubles the covariances of x, and quadruples its variance.
    #[test]
    fn a_stretch_acts_on_both_sides_of_a_covariance() {
        let stretched = covariance().conjugate(&DMat3::from_diagonal(DVec3::new(2.0, 1.0, 1.0)));
        assert_eq!(<[f64; 6]>::from(stretched), [16.0, 2.0, 1.0, 3.0, 0.25, 2.0]);
    }
}
