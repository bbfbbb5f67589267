//! Patterns at 1:1: drawings in millimetres that are printed, cut and joined.
//!
//! A [`Drawing`] has layers of lines, points and texts; [`write_svg`], [`write_sheets`] and [`write_dxf`] write it.
//! [`draw_pattern`] draws the maps of a skin, for sheets that are laid on it: rims, seams with ticks on both banks,
//! taxels, and the [`SheetStrain`]; [`strip_drawing`] the modules of a chain.

mod draw;
mod drawing;
mod dxf;
mod error;
mod outline;
mod sheets;
mod strain;
mod strips;
mod svg;

pub use draw::draw_pattern;
pub use drawing::{Anchor, Drawing, Layer, Shape};
pub use dxf::write_dxf;
pub use error::PatternError;
pub use sheets::{Sheet, write_sheets};
pub use strain::{STRAINS, SheetStrain};
pub use strips::strip_drawing;
pub use svg::write_svg;
