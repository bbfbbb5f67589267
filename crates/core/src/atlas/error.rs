//! Why a level has no image.

use glam::DVec2;

use crate::{cut::PlaceId, map::MapError};

/// Why a level has no image.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum AtlasError {
    #[error(transparent)]
    Map(#[from] MapError),
    #[error(
        "the image of {image} would have {} x {} pixels for a map of {:.3} x {:.3} m; at most {max_side} a side and \
         {max_pixels} in all are drawn; pixels of {fits_mm} mm fit",
        size_px[0], size_px[1], size.x, size.y
    )]
    TooLarge {
        /// Patch and level, as `palm/L0`.
        image: String,
        size: DVec2,
        size_px: [u32; 2],
        max_side: u32,
        max_pixels: u64,
        fits_mm: f64,
    },
    #[error(
        "the {images} {} of the skin would have {pixels} pixels together, {bytes} bytes of samples; at most \
         {max_pixels} pixels are drawn for its number of taxels; pixels of {fits_mm} mm fit",
        if *images == 1 { "image" } else { "images" }
    )]
    TooManyPixels {
        /// Number of images: patches times levels.
        images: usize,
        pixels: u64,
        /// Bytes of their samples before compression.
        bytes: u64,
        max_pixels: u64,
        fits_mm: f64,
    },
    #[error("place {place} of {image} lies at ({}, {}) m on the map, outside of the level's frame", at.x, at.y)]
    OutsideFrame {
        /// Patch and level, as `palm/L0`.
        image: String,
        place: PlaceId,
        at: DVec2,
    },
    #[error(
        "the map lies on patches called {}, the canvas on {}; a map that is drawn on the canvas needs one of these",
        found.join(", "), needed.join(", ")
    )]
    OtherPlane { found: Vec<String>, needed: Vec<String> },
    #[error("a pixel of {found} m cannot be drawn; its side must be a positive number of metres")]
    PixelSize { found: f64 },
    #[error(
        "pixels of {} mm are larger than the largest patch, which is {:.3} mm across; smaller ones are needed",
        1e3 * found, 1e3 * largest
    )]
    PixelBeyondPatches {
        /// Side of a pixel, in m.
        found: f64,
        /// Diagonal of the bounding box of the largest patch, in m.
        largest: f64,
    },
    #[error(
        "the charts with their margins do not fit into a canvas of {} x {} pixels (height x width); at least {} x {} \
         are needed, and at most {max_side} a side are drawn",
        canvas[0], canvas[1], least[0], least[1]
    )]
    Canvas {
        canvas: [u32; 2],
        /// Height and width that are enough for one pixel of each chart.
        least: [u64; 2],
        max_side: u32,
    },
}
