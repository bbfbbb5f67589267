//! How values are drawn between the taxels.

use crate::pyramid::LevelId;

/// How a pixel follows from the values around it. Only live vertices, those with a value, take
/// part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interpolation {
    /// Barycentric in the face that the pixel shows. Where a corner of the face has no value, the
    /// weights of the others are scaled to the sum 1; without any live corner the pixel is NaN.
    #[default]
    Linear,
    /// The value of the live corner with the largest weight: on equilateral faces the Voronoi cells
    /// of the vertices. NaN without any live corner.
    Nearest,
    /// Natural neighbours of the live vertices on the map (sibson1981): the area of a vertex
    /// without a value is taken over by its neighbours, so that no pixel of the chart is NaN. Linear
    /// fields are reproduced within the convex hull of the live vertices; a pixel outside of it has
    /// the value of the nearest one.
    Natural,
    /// The receptive fields of every level, drawn on the map of level 0: values go to the taxels by
    /// [`Level::to_finest`](crate::pyramid::Level::to_finest) and are drawn linearly between them.
    /// All levels of a patch have the same canvas, and layers of contrast add up pixel by pixel.
    Field,
}

/// Options of a [`Renderer`](crate::image::Renderer).
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RenderOptions {
    /// How values are drawn between the taxels.
    pub interpolation: Interpolation,
    /// The one level that is drawn; `None`: all.
    pub level: Option<LevelId>,
}
