//! Tactile images as pictures: one pixel or a block of them for each pixel of a tactile image,
//! in a scale of colours that every kind of colour vision can read, with a colour bar on request.
//!
//! Where the skin is not shown the picture is transparent. Where the skin is shown but nothing is
//! known it is hatched in greys, which no scale has.

use glam::DVec2;

use crate::{
    image::TactileImage,
    plot::{
        PlotError,
        colour::{Scale, hatch},
        layout::{printable, ticks},
        picture::{Anchor, MAX_SIDE, Picture, Shape, encode_with_alpha},
    },
};

/// How values become colours.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageOptions {
    /// The values at the two ends of the scale; those beyond have the colour of the end.
    pub range: [f64; 2],
    /// What the colour bar under the picture says, as `pressure, Pa`; `None`: no bar.
    pub bar: Option<String>,
    /// Pixels of the picture for each pixel of the image, in each direction.
    pub magnification: u32,
}

impl Default for ImageOptions {
    fn default() -> Self {
        Self { range: [0.0, 1.0], bar: None, magnification: 1 }
    }
}

/// Least width of a picture with a bar, in pixels: its numbers fit.
const BAR_PX: u32 = 220;

/// More than the mean width of a letter, in pixels.
const LETTER_PX: u32 = 8;

/// Height of the letters of a bar, in pixels.
const EM: f64 = 14.0;

/// Height of the strip with the bar, in pixels.
const STRIP_PX: u32 = 56;

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
/// let options = ImageOptions {
///     range: [0.0, 20e3],
///     bar: Some("pressure, Pa".into()),
///     magnification: 4,
/// };
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
    let scale = Scale::of_range(options.range);
    let [width, height] = image.frame.size_px.map(|n| n.saturating_mul(options.magnification.max(1)));
    let strip = options.bar.as_ref().map_or(0, |_| STRIP_PX);
    let letters = options.bar.as_ref().map_or(0, |label| printable(label).chars().count());
    let bar_px = u32::try_from(letters).unwrap_or(u32::MAX).saturating_mul(LETTER_PX).max(BAR_PX);
    let size = [if strip > 0 { width.max(bar_px) } else { width }, height.saturating_add(strip)];
    if size.iter().any(|side| !(1..=MAX_SIDE).contains(side)) {
        return Err(PlotError::Size { width: size[0], height: size[1], least: 1, most: MAX_SIDE });
    }
    let mut pixels = vec![[0; 4]; size[0] as usize * size[1] as usize];
    let values = &image.values[channel * image.coverage.len()..][..image.coverage.len()];
    let columns = image.frame.size_px[0] as usize;
    let zoom = options.magnification.max(1) as usize;
    for (y, row) in pixels.chunks_mut(size[0] as usize).take(height as usize).enumerate() {
        for (x, pixel) in row[..width as usize].iter_mut().enumerate() {
            let at = (y / zoom) * columns + x / zoom;
            if image.coverage[at] == 0 {
                continue;
            }
            let value = f64::from(values[at]);
            let colour = if value.is_nan() { hatch(x + y) } else { scale.at((value - low) / (high - low)) };
            *pixel = [colour.0, colour.1, colour.2, 255];
        }
    }
    if let Some(label) = &options.bar {
        let bar = bar(size[0], label, options.range, scale).to_pixels()?;
        let start = height as usize * size[0] as usize;
        for (pixel, c) in pixels[start..].iter_mut().zip(bar) {
            *pixel = [c.0, c.1, c.2, 255];
        }
    }
    Ok(encode_with_alpha(size, &pixels))
}

/// The strip with the bar, its ends, its middle and what it says.
fn bar(width: u32, label: &str, range: [f64; 2], scale: Scale) -> Picture {
    let margin = 2.5 * EM;
    let size = DVec2::new(f64::from(width) - 2.0 * margin, 0.8 * EM);
    let corner = DVec2::new(margin, 1.6 * EM);
    let text = |text: String, x: f64, y: f64| Shape::text(text, DVec2::new(x, y), Anchor::Middle);
    let mut shapes = vec![
        Shape::Scale { corner, size, colours: (0..=32).map(|k| scale.at(f64::from(k) / 32.0)).collect() },
        text(printable(label), 0.5 * f64::from(width), 1.2 * EM),
    ];
    for (value, share) in ticks(range, 1.0).into_iter().zip([0.0, 0.5, 1.0]) {
        shapes.push(text(value, margin + share * size.x, 3.5 * EM));
    }
    Picture { title: label.to_owned(), size_px: [width, STRIP_PX], em: EM, groups: vec![shapes] }
}
