//! The numbers that faer computes with.

use glam::DVec2;

pub(crate) type Complex = faer::c64;

/// The complex number with real part `z.x` and imaginary part `z.y`.
pub(crate) fn complex(z: DVec2) -> Complex {
    Complex::new(z.x, z.y)
}

/// Numbers that can be asked whether they are finite.
pub(crate) trait Finite {
    fn finite(&self) -> bool;
}

impl Finite for f64 {
    fn finite(&self) -> bool {
        self.is_finite()
    }
}

impl Finite for Complex {
    fn finite(&self) -> bool {
        self.re.is_finite() && self.im.is_finite()
    }
}
