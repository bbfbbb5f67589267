use std::sync::Arc;

use resvg::{tiny_skia, usvg};

use crate::plot::{PlotError, layout::grid::MAX_SIDE, palette::Palette};

/// Letters of the pictures, in the order in which they are tried: no font of the machine is, so that a picture is the
/// same everywhere. Together they have Latin, Greek and Cyrillic.
const FONTS: [&[u8]; 2] = [epaint_default_fonts::UBUNTU_LIGHT, epaint_default_fonts::HACK_REGULAR];

/// Family name of the first of [`FONTS`].
pub(crate) const FONT_FAMILY: &str = "Ubuntu";

/// Turns an SVG picture into a PNG of the size that the picture says, on a white ground.
///
/// A drawing of few colours gets a palette, which makes it a quarter as large; mixtures along its edges may then be off by 6
/// of 255.
///
/// # Errors
/// If the text is no SVG, or larger than 16384 pixels a side.
pub fn render_png(svg: &str) -> Result<Vec<u8>, PlotError> {
    let fail = |e: &dyn std::fmt::Display| PlotError::Render { message: e.to_string() };
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
        return Err(PlotError::Size { width, height, least: 1, most: MAX_SIDE });
    }
    let mut pixels =
        tiny_skia::Pixmap::new(width, height).ok_or_else(|| fail(&"there is not enough memory for it"))?;
    pixels.fill(tiny_skia::Color::WHITE);
    resvg::render(&tree, tiny_skia::Transform::identity(), &mut pixels.as_mut());
    encode(&pixels).map_err(|e| fail(&e))
}

/// Writes opaque pixels, by the numbers of their colours if those are few.
fn encode(pixels: &tiny_skia::Pixmap) -> Result<Vec<u8>, png::EncodingError> {
    let colours = || pixels.pixels().iter().map(|p| [p.red(), p.green(), p.blue()]);
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, pixels.width(), pixels.height());
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    // In a drawing pixels repeat those before; differences would hide it.
    encoder.set_filter(png::Filter::NoFilter);
    let data: Vec<u8> = if let Some(palette) = Palette::new(colours()) {
        encoder.set_color(png::ColorType::Indexed);
        encoder.set_palette(palette.colours.concat());
        colours().map(|colour| palette.number(colour)).collect()
    } else {
        encoder.set_color(png::ColorType::Rgb);
        colours().flatten().collect()
    };
    encoder.write_header()?.write_image_data(&data)?;
    Ok(bytes)
}
