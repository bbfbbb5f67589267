//! Lines and dots, and from which size on they are drawn.

use crate::plot::{
    colour::Colour,
    picture::{INK, Path, Shape, Stroke},
};

/// Triangles are drawn if their edges are at least this long on the picture, in pixels; shorter
/// lines would only grey it.
const LEAST_LINE_PX: f64 = 6.0;

/// Dots are drawn if their distance on the picture is at least this, in pixels.
const LEAST_DOT_PX: f64 = 7.0;

/// Lines between triangles whose edges are this long on the picture, in pixels, if they are drawn.
pub(crate) fn triangle_lines(path: Path, edge_px: f64) -> Option<Shape> {
    let stroke = Stroke { colour: Colour(0, 0, 0), width: 0.7, opacity: 0.28 };
    (edge_px >= LEAST_LINE_PX).then_some(Shape::Path { path, fill: None, stroke: Some(stroke) })
}

/// The line around a skin.
pub(crate) fn boundary_line(path: Path) -> Shape {
    let stroke = Stroke { colour: INK, width: 2.0, opacity: 1.0 };
    Shape::Path { path, fill: None, stroke: Some(stroke) }
}

/// Radius of dots between edges this long, in pixels; `None` where they would touch.
pub(crate) fn dot_radius(edge_px: f64) -> Option<f64> {
    (edge_px >= LEAST_DOT_PX).then_some((0.13 * edge_px).min(4.0))
}
