//! The options of an atlas.

/// How many pixels the images of an [`Atlas`](crate::atlas::Atlas) have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Resolution {
    /// The frames of the map itself: pixels are those of `map.exr`. Where charts are packed, the
    /// pixel size of the first patch's level 0.
    Map,
    /// This many metres per pixel.
    Pixel(f64),
    /// Images of this height and width in pixels, at the largest scale that fits: one scale for all
    /// levels of a patch, or for all patches where they are packed.
    Canvas([u32; 2]),
}

/// Options of [`Atlas::new`](crate::atlas::Atlas::new).
#[derive(Debug, Clone, PartialEq)]
pub struct AtlasOptions {
    /// How many pixels the images have. [`Resolution::Map`] by default.
    pub resolution: Resolution,
    /// Whether all patches of a level lie in one image; otherwise each has its own. Packed images
    /// of different levels have the same layout.
    pub packed: bool,
    /// Pixels that stay free around each chart, 1 by default. Not used by [`Resolution::Map`] where
    /// each patch has its own image: the map's frames have their own.
    pub margin_px: u32,
}

impl Default for AtlasOptions {
    fn default() -> Self {
        Self { resolution: Resolution::Map, packed: false, margin_px: 1 }
    }
}
