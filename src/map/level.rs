//! One level of a patch with its map.

use glam::DVec2;

use crate::{
    flatten::{Distortion, distortion},
    id::{IdVec, VertexId},
    map::ImageFrame,
    pyramid::Level,
};

/// One level of a patch with its map.
#[derive(Debug, Clone, PartialEq)]
pub struct MapLevel {
    /// The level: its mesh in the link's frame, and how it is joined to the others.
    pub level: Level,
    /// Map positions, in m.
    pub uv: IdVec<VertexId, DVec2>,
    /// The rectangle its image shows.
    pub frame: ImageFrame,
    /// How faithful the map is.
    pub distortion: Distortion,
}

impl MapLevel {
    /// A level with its map `uv` (m), which is measured; images have `pixel` metres per pixel.
    ///
    /// # Panics
    /// If the map has not one position per vertex, or a triangle names a vertex that does not
    /// exist.
    #[must_use]
    pub fn new(level: Level, uv: IdVec<VertexId, DVec2>, pixel: f64) -> Self {
        let frame = ImageFrame::around(&uv, pixel);
        Self { distortion: distortion(&level.mesh, &uv), level, uv, frame }
    }
}
