//! Why a level has no image.

use glam::DVec2;

use crate::{cut::PlaceId, map::MapError};

/// Why a level has no image.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AtlasError {
    /// The map breaks a rule.
    #[error(transparent)]
    Map(#[from] MapError),
    /// More pixels than an image may have.
    #[error(
        "the image of {image} would have {} x {} pixels for a map of {:.3} x {:.3} m; at most {max_side} a side and \
         {max_pixels} in all are drawn, which {fits_mm} mm a pixel would keep to",
        size_px[0], size_px[1], size.x, size.y
    )]
    TooLarge {
        /// Patch and level, as `palm/L0`.
        image: String,
        /// Width and height of the map, in m.
        size: DVec2,
        /// Width and height the image would have.
        size_px: [u32; 2],
        /// Largest width or height.
        max_side: u32,
        /// Largest number of pixels.
        max_pixels: u64,
        /// A pixel size that fits, in mm.
        fits_mm: f64,
    },
    /// More pixels in all than a skin's images may have.
    #[error(
        "the {images} {} of the skin would have {pixels} pixels together, {bytes} bytes of samples; at most \
         {max_pixels} pixels are drawn for its number of taxels, which {fits_mm} mm a pixel would keep to",
        if *images == 1 { "image" } else { "images" }
    )]
    TooManyPixels {
        /// Number of images: patches times levels.
        images: usize,
        /// Pixels in all.
        pixels: u64,
        /// Bytes of their samples before compression.
        bytes: u64,
        /// Largest number of pixels.
        max_pixels: u64,
        /// A pixel size that fits, in mm.
        fits_mm: f64,
    },
    /// A place off the picture.
    #[error("place {place} of {image} lies at ({}, {}) m on the map, outside of the level's frame", at.x, at.y)]
    OutsideFrame {
        /// Patch and level, as `palm/L0`.
        image: String,
        /// The place.
        place: PlaceId,
        /// Its map position, in m.
        at: DVec2,
    },
    /// A pixel size that is not a length.
    #[error("a pixel of {found} m cannot be drawn; its side must be a positive number of metres")]
    PixelSize {
        /// The size asked for, in m.
        found: f64,
    },
    /// A margin that is larger than any image.
    #[error("a margin of {found} pixels is wider than any image; at most {max} are drawn")]
    Margin {
        /// The margin asked for.
        found: u32,
        /// Largest margin.
        max: u32,
    },
    /// A canvas that is too small for the charts, even at one pixel each, or too large to draw.
    #[error(
        "the charts with their margins do not fit into a canvas of {} x {} pixels (height x width); at least {} x {} \
         are needed, and at most {max_side} a side are drawn",
        canvas[0], canvas[1], least[0], least[1]
    )]
    Canvas {
        /// Height and width asked for.
        canvas: [u32; 2],
        /// Height and width that hold one pixel of each chart.
        least: [u64; 2],
        /// Largest height or width.
        max_side: u32,
    },
}
