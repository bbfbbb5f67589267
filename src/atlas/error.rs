use glam::DVec2;

use crate::{id::VertexId, mesh::MeshError, pyramid::LevelId};

/// Why a level has no image.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AtlasError {
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
        "the {images} images of the skin would have {pixels} pixels together; at most {max_pixels} are drawn, which \
         {fits_mm} mm a pixel would keep to"
    )]
    TooManyPixels {
        /// Number of images: patches times levels.
        images: usize,
        /// Pixels in all.
        pixels: u64,
        /// Largest number of pixels.
        max_pixels: u64,
        /// A pixel size that fits, in mm.
        fits_mm: f64,
    },
    /// A frame without pixels or without a size.
    #[error(
        "the frame of {image} is {} x {} m in {} x {} pixels; both must be positive and finite",
        size.x, size.y, size_px[0], size_px[1]
    )]
    Frame {
        /// Patch and level, as `palm/L0`.
        image: String,
        /// Width and height, in m.
        size: DVec2,
        /// Width and height, in pixels.
        size_px: [u32; 2],
    },
    /// A vertex off the picture.
    #[error("vertex {vertex} of {image} lies at ({}, {}) m on the map, outside of the level's frame", at.x, at.y)]
    OutsideFrame {
        /// Patch and level, as `palm/L0`.
        image: String,
        /// The vertex.
        vertex: VertexId,
        /// Its map position, in m.
        at: DVec2,
    },
    /// A mesh that cannot be drawn.
    #[error("{image}: {source}")]
    Mesh {
        /// Patch and level, as `palm/L0`.
        image: String,
        /// What is wrong with it.
        source: MeshError,
    },
    /// An array that does not fit to the mesh.
    #[error("{image} has {found} {what} for {needed} vertices")]
    Length {
        /// Patch and level, as `palm/L0`.
        image: String,
        /// Which array.
        what: &'static str,
        /// Entries found.
        found: usize,
        /// Entries needed.
        needed: usize,
    },
    /// A level that the patch does not have.
    #[error("patch {patch:?} has no level {level}; it has levels 0 to {last}")]
    NoSuchLevel {
        /// Name of the patch.
        patch: String,
        /// The level asked for.
        level: LevelId,
        /// The coarsest level there is.
        last: usize,
    },
}
