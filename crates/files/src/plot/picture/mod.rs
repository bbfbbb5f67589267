//! A picture as a list of shapes, which is written as SVG text or drawn as a PNG.
//!
//! Both forms show the same shapes at the same positions, in pixels to the right and down. Texts remain texts
//! in an SVG and are drawn with the font of the crate in a PNG, so that a PNG has the same bytes on every
//! machine. Later shapes cover earlier ones.

mod font;
mod path;
mod png;
mod svg;

pub(crate) use path::Path;
pub(crate) use png::{encode_with_alpha, write_labels};

use glam::DVec2;

use crate::plot::colour::{Colour, INK};

/// Largest width or height of a picture, in pixels.
pub(crate) const MAX_SIDE: u32 = 16_384;

/// A picture of a map or a skin, as [`crate::plot::plot_map`] and [`crate::plot::plot_skin`] draw
/// it.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    pub(crate) title: String,
    pub(crate) size_px: [u32; 2],
    /// Height of the letters, in pixels.
    pub(crate) em: f64,
    /// Shapes that belong together, for those who edit the SVG.
    pub(crate) groups: Vec<Vec<Shape>>,
}

impl Picture {
    /// Width and height, in pixels.
    pub fn size_px(&self) -> [u32; 2] {
        self.size_px
    }
}

/// An element of a picture; lengths are pixels.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Shape {
    /// Straight lines and the areas inside of them.
    Path { path: Path, fill: Option<Colour>, stroke: Option<Stroke> },
    /// Discs, with a rim of ink or without.
    Dots { centres: Vec<DVec2>, radius: f64, colour: Colour, has_rim: bool },
    /// A line of text; `at` is on its base line.
    Text { text: String, at: DVec2, anchor: Anchor, is_bold: bool },
    /// Pixels, as fine as those of the picture or finer.
    Image { corner: DVec2, size: DVec2, pixels: Pixels },
    /// A rectangle with a scale of colours from left to right.
    Scale { corner: DVec2, size: DVec2, colours: Vec<Colour> },
}

impl Shape {
    /// A line of text that is not bold.
    pub(crate) fn text(text: impl Into<String>, at: DVec2, anchor: Anchor) -> Self {
        Self::Text { text: text.into(), at, anchor, is_bold: false }
    }
}

/// The style of the lines of a path. Joins and ends are round.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stroke {
    pub(crate) colour: Colour,
    pub(crate) width: f64,
    pub(crate) opacity: f64,
}

impl Stroke {
    /// The frame of the scale of a legend.
    const FRAME: Self = Self { colour: INK, width: 0.8, opacity: 1.0 };

    /// The rim of dots.
    const RIM: Self = Self { colour: INK, width: 1.0, opacity: 1.0 };

    /// The stroke that makes letters of this height bold.
    fn bold(em: f64) -> Self {
        Self { colour: INK, width: 0.03 * em, opacity: 1.0 }
    }
}

/// The point of a text that is at its position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Anchor {
    Start,
    Middle,
    End,
}

/// Opaque pixels, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Pixels {
    pub(crate) size: [usize; 2],
    pub(crate) colours: Vec<Colour>,
}
