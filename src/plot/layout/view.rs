//! From the plane of a panel, in m, to the pixels of the picture.

use glam::DVec2;

/// Position of a panel on the picture, and its scale.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    /// Pixels per metre.
    pub(crate) scale: f64,
    /// Upper left corner of the panel on the picture, in whole pixels.
    pub(crate) corner: DVec2,
    /// The same corner on the plane, in m.
    pub(crate) origin: DVec2,
    /// Width and height of the panel, in whole pixels.
    pub(crate) size: DVec2,
}

impl View {
    /// A point of the plane on the picture, in pixels.
    pub(crate) fn to_pixels(self, at: DVec2) -> DVec2 {
        self.corner + DVec2::new(at.x - self.origin.x, self.origin.y - at.y) * self.scale
    }
}
