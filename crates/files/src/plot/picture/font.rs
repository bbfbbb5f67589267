//! Outlines of letters, from a font in the crate: no font of the machine is used, so that a PNG is the same
//! everywhere.

use tiny_skia::{Path, PathBuilder};
use ttf_parser::{Face, GlyphId, OutlineBuilder};

/// Ubuntu Light, which has Latin, Greek and Cyrillic letters.
pub(crate) struct Font(Face<'static>);

impl Font {
    pub(crate) fn new() -> Self {
        Self(Face::parse(epaint_default_fonts::UBUNTU_LIGHT, 0).expect("the font is part of the program"))
    }

    /// The outline of a line of text that begins at the origin, y down, and its width, in pixels.
    /// Letters are not kerned; a letter that the font lacks is drawn as its replacement glyph.
    pub(crate) fn outline(&self, text: &str, em: f64) -> (Option<Path>, f32) {
        let Self(face) = self;
        #[expect(clippy::cast_possible_truncation, reason = "pixels")]
        let scale = em as f32 / f32::from(face.units_per_em());
        let mut pen = Pen { path: PathBuilder::new(), x: 0.0, scale };
        for letter in text.chars() {
            let glyph = face.glyph_index(letter).unwrap_or(GlyphId(0));
            face.outline_glyph(glyph, &mut pen);
            pen.x += scale * f32::from(face.glyph_hor_advance(glyph).unwrap_or_default());
        }
        (pen.path.finish(), pen.x)
    }
}

/// Writes a glyph's outline, which is in units of its font with y up.
struct Pen {
    path: PathBuilder,
    x: f32,
    scale: f32,
}

impl Pen {
    fn at(&self, x: f32, y: f32) -> (f32, f32) {
        (self.x + self.scale * x, -self.scale * y)
    }
}

impl OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.path.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.path.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.at(x1, y1), self.at(x, y));
        self.path.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) = (self.at(x1, y1), self.at(x2, y2), self.at(x, y));
        self.path.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.path.close();
    }
}
