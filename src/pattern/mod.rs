//! Patterns at 1:1: drawings in millimetres that are printed, cut and joined.
//!
//! A [`Drawing`] has layers of lines, points and texts; [`write_svg`] and [`write_dxf`] write it.

mod drawing;
mod dxf;
mod strips;
mod svg;

pub use drawing::{Anchor, Drawing, Layer, Shape};
pub use dxf::write_dxf;
pub use strips::strip_drawing;
pub use svg::write_svg;
