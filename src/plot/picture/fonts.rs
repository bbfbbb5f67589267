//! Outlines of letters, from the fonts that come with the crate: none of the machine is used, so
//! that a PNG is the same everywhere.

use tiny_skia::{Path, PathBuilder};
use ttf_parser::{Face, GlyphId, OutlineBuilder};

/// The fonts in the order in which they are tried. Together they have Latin, Greek and Cyrillic.
const FONTS: [&[u8]; 2] = [epaint_default_fonts::UBUNTU_LIGHT, epaint_default_fonts::HACK_REGULAR];

pub(crate) struct Fonts(Vec<Face<'static>>);

impl Fonts {
    pub(crate) fn new() -> Self {
        Self(FONTS.iter().filter_map(|data| Face::parse(data, 0).ok()).collect())
    }

    /// The outline of a line of text that begins at the origin, y down, and its width, in pixels.
    /// Letters are not kerned.
    pub(crate) fn outline(&self, text: &str, em: f64) -> (Option<Path>, f32) {
        let mut pen = Pen { path: PathBuilder::new(), x: 0.0, scale: 1.0 };
        for letter in text.chars() {
            let Some((face, glyph)) = self.glyph(letter) else { continue };
            #[expect(clippy::cast_possible_truncation, reason = "pixels")]
            let em = em as f32;
            pen.scale = em / f32::from(face.units_per_em());
            face.outline_glyph(glyph, &mut pen);
            pen.x += pen.scale * f32::from(face.glyph_hor_advance(glyph).unwrap_or_default());
        }
        (pen.path.finish(), pen.x)
    }

    /// A letter that no font has becomes the first font's sign for such letters.
    fn glyph(&self, letter: char) -> Option<(&Face<'static>, GlyphId)> {
        let find = |face| Some((face, Face::glyph_index(face, letter)?));
        self.0.iter().find_map(find).or_else(|| Some((self.0.first()?, GlyphId(0))))
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
