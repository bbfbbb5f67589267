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
    /// From `xx xy xz yy yz zz`, the upper triangle row by row, as files write it.
    #[must_use]
    pub const fn from_array([xx, xy, xz, yy, yz, zz]: [f64; 6]) -> Self {
        Self { xx, xy, xz, yy, yz, zz }
    }

    /// `xx xy xz yy yz zz`.
    #[must_use]
    pub const fn to_array(self) -> [f64; 6] {
        let Self { xx, xy, xz, yy, yz, zz } = self;
        [xx, xy, xz, yy, yz, zz]
    }

    /// From the upper triangle of a matrix that is symmetric up to rounding.
    pub(crate) fn from_matrix(m: &DMat3) -> Self {
        let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
        Self { xx: x.x, xy: y.x, xz: z.x, yy: y.y, yz: z.y, zz: z.z }
    }

    /// The whole matrix.
    #[must_use]
    pub fn to_matrix(self) -> DMat3 {
        let Self { xx, xy, xz, yy, yz, zz } = self;
        DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz])
    }

    /// `M C M'`: the covariance of `M x`.
    #[must_use]
    pub fn conjugate(self, m: &DMat3) -> Self {
        Self::from_matrix(&(*m * self.to_matrix() * m.transpose()))
    }

    /// Square root of the trace, in m: the root mean square distance from the mean.
    #[must_use]
    pub fn sigma(self) -> f64 {
        (self.xx + self.yy + self.zz).max(0.0).sqrt()
    }
}
