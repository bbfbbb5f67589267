//! Pictures as PNG images.

use glam::DVec2;
use tiny_skia::{
    Color, FillRule, FilterQuality, GradientStop, LineCap, LineJoin, LinearGradient, Paint, PathBuilder,
    Pixmap, PixmapPaint, Point, PremultipliedColorU8, Rect, Shader, SpreadMode, Transform,
};

use crate::atlas::Label;
use crate::plot::PlotError;
use crate::plot::colour::Colour;
use crate::plot::picture::font::Font;
use crate::plot::picture::{Anchor, INK, MAX_SIDE, Path, Picture, Pixels, Shape, Stroke};

impl Picture {
    /// The picture as the bytes of a PNG file, the same on every machine.
    ///
    /// # Errors
    /// If the picture has no pixels or more than fit into memory.
    pub fn to_png(&self) -> Result<Vec<u8>, PlotError> {
        Ok(encode(self.size_px.map(|n| n as usize), &self.colours()?))
    }

    /// The pixels of the picture, red, green and blue, row by row from the top.
    ///
    /// # Errors
    /// As [`Self::to_png`].
    pub fn to_pixels(&self) -> Result<Vec<[u8; 3]>, PlotError> {
        Ok(self.colours()?.into_iter().map(|c| [c.0, c.1, c.2]).collect())
    }

    fn colours(&self) -> Result<Vec<Colour>, PlotError> {
        let [width, height] = self.size_px;
        let pixels =
            Pixmap::new(width, height).ok_or(PlotError::Size { width, height, least: 1, most: MAX_SIDE })?;
        let mut canvas = Canvas { pixels, font: Font::new(), em: self.em };
        canvas.pixels.fill(Color::WHITE);
        self.groups.iter().flatten().for_each(|shape| canvas.draw(shape));
        let colour = |p: &PremultipliedColorU8| Colour(p.red(), p.green(), p.blue());
        Ok(canvas.pixels.pixels().iter().map(colour).collect())
    }
}

/// Pixels as a PNG file; there is at least one.
pub(crate) fn encode(size: [usize; 2], colours: &[Colour]) -> Vec<u8> {
    // In a drawing pixels repeat, which compresses better than differences.
    let size = size.map(|x| u32::try_from(x).unwrap_or(u32::MAX));
    let data: Vec<u8> = colours.iter().flat_map(|c| [c.0, c.1, c.2]).collect();
    write(size, png::ColorType::Rgb, png::Filter::NoFilter, &data)
}

/// Pixels of red, green, blue and opacity as a PNG file; there is at least one.
pub(crate) fn encode_with_alpha(size: [u32; 2], pixels: &[[u8; 4]]) -> Vec<u8> {
    write(size, png::ColorType::Rgba, png::Filter::Adaptive, pixels.as_flattened())
}

/// Height of the letters of labels, in pixels.
const LABEL_EM: f64 = 13.0;

/// Writes names over pixels of red, green, blue and opacity, ink with a white rim; positions are in pixels of
/// the image before magnification. Labels that would cover an earlier one are left out.
pub(crate) fn write_labels(
    pixels: &mut [[u8; 4]],
    [width, height]: [u32; 2],
    labels: &[Label],
    magnification: f64,
) {
    let canvas = Pixmap::new(width, height).filter(|_| !labels.is_empty());
    let Some(mut canvas) = canvas.map(|pixels| Canvas { pixels, font: Font::new(), em: LABEL_EM }) else {
        return;
    };
    let mut taken: Vec<[DVec2; 2]> = Vec::new();
    for label in labels {
        let (path, length) = canvas.font.outline(&label.text, LABEL_EM);
        let half = DVec2::new(0.5 * f64::from(length), 0.5 * LABEL_EM);
        // Within the picture, if it is wide enough.
        let [most_x, most_y] = [f64::from(width) - half.x, f64::from(height) - half.y];
        let at = magnification * label.at;
        let at = DVec2::new(at.x.min(most_x).max(half.x), at.y.min(most_y).max(half.y));
        let own = [at - half, at + half];
        let covers = |other: &[DVec2; 2]| own[0].cmplt(other[1]).all() && other[0].cmplt(own[1]).all();
        if taken.iter().any(covers) {
            continue;
        }
        taken.push(own);
        let to = Transform::from_translate(f32_of(own[0].x), f32_of(at.y + 0.35 * LABEL_EM));
        let rim = Stroke { colour: Colour(255, 255, 255), width: 3.0, opacity: 1.0 };
        canvas.draw_path(path.as_ref(), None, Some(&rim), to);
        canvas.draw_path(path.as_ref(), Some(INK), None, to);
    }
    for (pixel, over) in pixels.iter_mut().zip(canvas.pixels.pixels()) {
        let over = over.demultiply();
        let alpha = u32::from(over.alpha());
        let under = (255 - alpha) * u32::from(pixel[3]) / 255;
        let total = (alpha + under).max(1);
        let mix = |over: u8, under_colour: u8| {
            u8::try_from((alpha * u32::from(over) + under * u32::from(under_colour)) / total)
                .unwrap_or(u8::MAX)
        };
        if alpha > 0 {
            let [red, green, blue, _] = *pixel;
            let opacity = u8::try_from(alpha + under).unwrap_or(u8::MAX);
            *pixel = [mix(over.red(), red), mix(over.green(), green), mix(over.blue(), blue), opacity];
        }
    }
}

fn write([width, height]: [u32; 2], colours: png::ColorType, filter: png::Filter, data: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_color(colours);
    encoder.set_compression(png::Compression::High);
    encoder.set_filter(filter);
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(data));
    written.expect("pixels of this size, written to memory");
    bytes
}

struct Canvas {
    pixels: Pixmap,
    font: Font,
    em: f64,
}

impl Canvas {
    fn draw(&mut self, shape: &Shape) {
        match shape {
            Shape::Path { path, fill, stroke } => {
                let path = to_skia(path);
                self.draw_path(path.as_ref(), *fill, stroke.as_ref(), Transform::identity());
            }
            Shape::Dots { centres, radius, colour, has_rim } => {
                let mut path = PathBuilder::new();
                for at in centres {
                    let [x, y, r] = [at.x, at.y, *radius].map(f32_of);
                    path.push_circle(x, y, r);
                }
                let rim = has_rim.then_some(&Stroke::RIM);
                self.draw_path(path.finish().as_ref(), Some(*colour), rim, Transform::identity());
            }
            Shape::Text { text, at, anchor, is_bold } => {
                let (path, width) = self.font.outline(text, self.em);
                let share = match anchor {
                    Anchor::Start => 0.0,
                    Anchor::Middle => 0.5,
                    Anchor::End => 1.0,
                };
                let to = Transform::from_translate(f32_of(at.x) - share * width, f32_of(at.y));
                let stroke = is_bold.then(|| Stroke::bold(self.em));
                self.draw_path(path.as_ref(), Some(INK), stroke.as_ref(), to);
            }
            Shape::Image { corner, size, pixels } => self.draw_image(*corner, *size, pixels),
            Shape::Scale { corner, size, colours } => self.draw_scale(*corner, *size, colours),
        }
    }

    fn draw_path(
        &mut self,
        path: Option<&tiny_skia::Path>,
        fill: Option<Colour>,
        stroke: Option<&Stroke>,
        to: Transform,
    ) {
        let Some(path) = path else { return };
        if let Some(fill) = fill {
            self.pixels.fill_path(path, &paint(fill, 1.0), FillRule::Winding, to, None);
        }
        if let Some(stroke) = stroke {
            let paint = paint(stroke.colour, stroke.opacity);
            let line = tiny_skia::Stroke {
                width: f32_of(stroke.width),
                line_cap: LineCap::Round,
                line_join: LineJoin::Round,
                ..Default::default()
            };
            self.pixels.stroke_path(path, &paint, &line, to, None);
        }
    }

    /// Bilinear interpolation at half the size is the mean of four pixels.
    fn draw_image(&mut self, corner: DVec2, size: DVec2, image: &Pixels) {
        let [width, height] = image.size;
        let [w, h] = image.size.map(|side| u32::try_from(side).unwrap_or(u32::MAX));
        let Some(mut pixels) = Pixmap::new(w, h) else { return };
        for (pixel, colour) in pixels.pixels_mut().iter_mut().zip(&image.colours) {
            *pixel = tiny_skia::ColorU8::from_rgba(colour.0, colour.1, colour.2, 255).premultiply();
        }
        let scale = size / DVec2::new(width as f64, height as f64);
        let to = Transform::from_translate(f32_of(corner.x), f32_of(corner.y))
            .pre_scale(f32_of(scale.x), f32_of(scale.y));
        let paint = PixmapPaint { quality: FilterQuality::Bilinear, ..PixmapPaint::default() };
        self.pixels.draw_pixmap(0, 0, pixels.as_ref(), &paint, to, None);
    }

    fn draw_scale(&mut self, corner: DVec2, size: DVec2, colours: &[Colour]) {
        let end = corner + size;
        let [left, top, right, bottom] = [corner.x, corner.y, end.x, end.y].map(f32_of);
        let last = colours.len().saturating_sub(1).max(1) as f64;
        let stop = |(k, c): (usize, &Colour)| GradientStop::new(f32_of(k as f64 / last), colour(*c));
        let stops = colours.iter().enumerate().map(stop).collect();
        let [from, to] = [left, right].map(|x| Point::from_xy(x, top));
        let gradient = LinearGradient::new(from, to, stops, SpreadMode::Pad, Transform::identity());
        let (Some(shader), Some(rect)) = (gradient, Rect::from_ltrb(left, top, right, bottom)) else {
            return;
        };
        let paint = Paint { shader, ..Paint::default() };
        self.pixels.fill_rect(rect, &paint, Transform::identity(), None);
        let frame = PathBuilder::from_rect(rect);
        self.draw_path(Some(&frame), None, Some(&Stroke::FRAME), Transform::identity());
    }
}

fn to_skia(path: &Path) -> Option<tiny_skia::Path> {
    let mut builder = PathBuilder::new();
    for (points, is_closed) in path.pieces() {
        for (k, p) in points.enumerate() {
            let [x, y] = [p.x, p.y].map(f32_of);
            if k == 0 { builder.move_to(x, y) } else { builder.line_to(x, y) }
        }
        if is_closed {
            builder.close();
        }
    }
    builder.finish()
}

fn colour(c: Colour) -> Color {
    Color::from_rgba8(c.0, c.1, c.2, 255)
}

fn paint(c: Colour, opacity: f64) -> Paint<'static> {
    let mut colour = colour(c);
    colour.set_alpha(f32_of(opacity));
    Paint { shader: Shader::SolidColor(colour), anti_alias: true, ..Paint::default() }
}

#[expect(clippy::cast_possible_truncation, reason = "pixels of a picture")]
fn f32_of(x: f64) -> f32 {
    x as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image with twice the pixels of the picture in each direction is averaged, not sampled.
    #[test]
    fn a_finer_image_is_averaged() {
        let grey = |k: u8| Colour(k, k, k);
        let colours = (0..16_u8).map(|k| grey(10 * k)).collect();
        let pixels = Pixels { size: [4, 4], colours };
        let image = Shape::Image { corner: DVec2::new(1.0, 0.0), size: DVec2::splat(2.0), pixels };
        let picture = Picture { title: String::new(), size_px: [4, 2], em: 10.0, groups: vec![vec![image]] };
        let png = picture.to_png().unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        let reds: Vec<u8> = bytes.chunks(3).map(|pixel| pixel[0]).collect();
        for (red, expected) in reds.iter().zip([255, 25, 45, 255, 255, 105, 125, 255]) {
            assert!(red.abs_diff(expected) <= 1, "{reds:?}");
        }
    }
}
