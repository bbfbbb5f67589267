use std::sync::Arc;

use resvg::{tiny_skia, usvg};

use crate::report::{ReportError, layout::MAX_SIDE};

/// Letters of the pictures, in the order in which they are tried: no font of the machine is, so that a picture is the
/// same everywhere. Together they have Latin, Greek and Cyrillic.
const FONTS: [&[u8]; 2] = [epaint_default_fonts::UBUNTU_LIGHT, epaint_default_fonts::HACK_REGULAR];

/// Family name of the first of [`FONTS`].
pub(super) const FONT_FAMILY: &str = "Ubuntu";

/// Turns an SVG picture into a PNG of the size that the picture says, on a white ground.
///
/// # Errors
/// If the text is no SVG, or larger than 16384 pixels a side.
pub fn render_png(svg: &str) -> Result<Vec<u8>, ReportError> {
    let fail = |e: &dyn std::fmt::Display| ReportError::Render { message: e.to_string() };
    let mut fonts = usvg::fontdb::Database::new();
    for font in FONTS {
        fonts.load_font_source(usvg::fontdb::Source::Binary(Arc::new(font)));
    }
    fonts.set_sans_serif_family(FONT_FAMILY);
    let options = usvg::Options {
        font_family: FONT_FAMILY.to_owned(),
        fontdb: Arc::new(fonts),
        ..usvg::Options::default()
    };
    let tree = usvg::Tree::from_str(svg, &options).map_err(|e| fail(&e))?;
    let size = tree.size().to_int_size();
    let (width, height) = (size.width(), size.height());
    if width > MAX_SIDE || height > MAX_SIDE {
        return Err(ReportError::Size { width, height, least: 1, most: MAX_SIDE });
    }
    let mut pixels =
        tiny_skia::Pixmap::new(width, height).ok_or_else(|| fail(&"there is not enough memory for it"))?;
    pixels.fill(tiny_skia::Color::WHITE);
    resvg::render(&tree, tiny_skia::Transform::identity(), &mut pixels.as_mut());
    pixels.encode_png().map_err(|e| fail(&e))
}
