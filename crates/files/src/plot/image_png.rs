//! Tactile images as pictures: one pixel or a block of them for each pixel of a tactile image,
//! in a scale of colours that every kind of colour vision can read.
//!
//! The picture is transparent where the image does not show skin, and hatched in greys, which no scale has,
//! where values are unknown.

use crate::atlas::Label;
use crate::image::TactileImage;
use crate::plot::PlotError;
use crate::plot::colour::{Scale, hatch};
use crate::plot::picture::{MAX_SIDE, encode_with_alpha, write_labels};

/// Options of colours.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageOptions {
    /// The values at the two ends of the scale; those beyond have the colour of the end.
    pub range: [f64; 2],
    /// Pixels of the picture for each pixel of the image, in each direction.
    pub magnification: u32,
    /// Names that are written over the image; a name that would cover an earlier one is left out.
    pub labels: Vec<Label>,
}

impl Default for ImageOptions {
    fn default() -> Self {
        Self { range: [0.0, 1.0], magnification: 1, labels: Vec::new() }
    }
}

/// Draws one channel of a frame as the bytes of a PNG file.
///
/// A range on both sides of zero has a diverging scale, blue below and red above, whose middle is
/// zero if the range is symmetric; any other has viridis.
///
/// # Errors
/// If the image has no such channel, the range has no length, or the picture would be larger than
/// 16384 pixels a side.
///
/// ```no_run
/// # fn draw(image: &dermatome::image::TactileImage) -> Result<(), Box<dyn std::error::Error>> {
/// use dermatome::plot::{ImageOptions, image_png};
///
/// let options = ImageOptions { range: [0.0, 20e3], magnification: 4, ..ImageOptions::default() };
/// std::fs::write("frame.png", image_png(image, 0, &options)?)?;
/// # Ok(())
/// # }
/// ```
pub fn image_png(image: &TactileImage, channel: usize, options: &ImageOptions) -> Result<Vec<u8>, PlotError> {
    let [low, high] = options.range;
    let has_length = low.is_finite() && high.is_finite() && low < high;
    if channel >= image.channels || !has_length {
        return Err(PlotError::Channel { channel, channels: image.channels, range: options.range });
    }
    let size = image.frame.size_px.map(|n| n.saturating_mul(options.magnification.max(1)));
    if size.iter().any(|side| !(1..=MAX_SIDE).contains(side)) {
        return Err(PlotError::Size { width: size[0], height: size[1], least: 1, most: MAX_SIDE });
    }
    let mut pixels = vec![[0; 4]; size[0] as usize * size[1] as usize];
    let values = &image.values[channel * image.coverage.len()..][..image.coverage.len()];
    let columns = image.frame.size_px[0] as usize;
    let zoom = options.magnification.max(1) as usize;
    for (y, row) in pixels.chunks_mut(size[0] as usize).enumerate() {
        for (x, pixel) in row.iter_mut().enumerate() {
            let at = (y / zoom) * columns + x / zoom;
            if image.coverage[at] == 0 {
                continue;
            }
            let [red, green, blue] = value_colour(f64::from(values[at]), options.range, x + y);
            *pixel = [red, green, blue, 255];
        }
    }
    write_labels(&mut pixels, size, &options.labels, f64::from(options.magnification.max(1)));
    Ok(encode_with_alpha(size, &pixels))
}

/// The colour of a value as red, green and blue, as [`image_png`] draws it; where it is NaN that of a hatch on this
/// diagonal of the pixels, the sum of row and column.
pub fn value_colour(value: f64, range: [f64; 2], diagonal: usize) -> [u8; 3] {
    let [low, high] = range;
    let colour = match value.is_nan() {
        true => hatch(diagonal),
        false => Scale::of_range(range).at((value - low) / (high - low)),
    };
    [colour.0, colour.1, colour.2]
}
