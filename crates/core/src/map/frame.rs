//! The rectangle of the map plane that an image shows, and how pixels lie in it.

use glam::DVec2;

use crate::mesh::rectangle_around;

/// The rectangle of the map plane that the image of a level shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageFrame {
    /// Lower left corner, in m.
    pub origin: DVec2,
    /// Width and height, in m: whole pixels.
    pub size: DVec2,
    /// Width and height of the image, in pixels.
    pub size_px: [u32; 2],
}

impl ImageFrame {
    /// The smallest frame of whole pixels around `positions` with one pixel of margin on each side,
    /// `pixel` metres per pixel.
    pub(crate) fn around<'a>(positions: impl IntoIterator<Item = &'a DVec2>, pixel: f64) -> Self {
        let (lo, hi) = rectangle_around(positions.into_iter().copied());
        Self::around_box(lo, hi, pixel, 1)
    }

    /// The smallest frame of whole pixels around a box, with `margin` pixels on each side.
    pub(crate) fn around_box(mut lo: DVec2, mut hi: DVec2, pixel: f64, margin: u32) -> Self {
        if !lo.is_finite() || !hi.is_finite() {
            (lo, hi) = (DVec2::ZERO, DVec2::ZERO);
        }
        let inner = ((hi - lo) / pixel).ceil().max(DVec2::ONE);
        let count = inner + 2.0 * f64::from(margin);
        let size = count * pixel;
        let origin = (lo + hi) / 2.0 - size / 2.0;
        #[expect(clippy::cast_possible_truncation, reason = "saturates; the rasteriser refuses such images")]
        let size_px = [count.x as u32, count.y as u32];
        Self { origin, size, size_px }
    }

    /// Whether it is a finite rectangle with an area and at least one pixel.
    pub(crate) fn is_valid(&self) -> bool {
        let size = self.size.is_finite() && self.size.min_element() > 0.0;
        size && self.origin.is_finite() && !self.size_px.contains(&0)
    }

    /// A map position (m) in the unit square of the image; `v` runs down, as in glTF.
    #[doc(hidden)]
    pub fn to_texture(self, at: DVec2) -> DVec2 {
        let unit = (at - self.origin) / self.size;
        DVec2::new(unit.x, 1.0 - unit.y)
    }

    /// The map position (m) of a point of the unit square.
    #[doc(hidden)]
    pub fn map_position(self, texture: DVec2) -> DVec2 {
        self.origin + DVec2::new(texture.x, 1.0 - texture.y) * self.size
    }

    /// The map position (m) of the centre of a pixel (column, row from the top).
    pub fn centre(&self, pixel: [u32; 2]) -> DVec2 {
        let share = |k: usize| (f64::from(pixel[k]) + 0.5) / f64::from(self.size_px[k]);
        self.map_position(DVec2::new(share(0), share(1)))
    }

    /// The pixel (column, row from the top) that contains a map position; the border of the image belongs to it.
    pub fn pixel(&self, at: DVec2) -> [u32; 2] {
        PixelGrid::new(*self).pixel(at)
    }
}

/// The pixels of a frame, prepared for many positions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PixelGrid {
    /// The lower left corner of the frame, in m and in pixels.
    origin: DVec2,
    origin_px: DVec2,
    /// Pixels per m; rows run down.
    scale: DVec2,
    last: [u32; 2],
}

impl PixelGrid {
    pub(crate) fn new(frame: ImageFrame) -> Self {
        let [columns, rows] = frame.size_px;
        let size_px = DVec2::new(f64::from(columns), f64::from(rows));
        Self {
            origin: frame.origin,
            origin_px: DVec2::new(0.0, size_px.y),
            scale: size_px / frame.size * DVec2::new(1.0, -1.0),
            last: [columns.saturating_sub(1), rows.saturating_sub(1)],
        }
    }

    /// See [`ImageFrame::pixel`].
    #[inline(always)]
    #[expect(
        clippy::cast_possible_truncation,
        reason = "rounds down, and saturates left of and above the image"
    )]
    pub(crate) fn pixel(&self, at: DVec2) -> [u32; 2] {
        let at = self.origin_px + (at - self.origin) * self.scale;
        [(at.x as u32).min(self.last[0]), (at.y as u32).min(self.last[1])]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_outside_of_the_image_have_its_nearest_pixel() {
        let [columns, rows] = [7, 3];
        let frame = ImageFrame {
            origin: DVec2::new(-0.3, 0.1),
            size: DVec2::new(0.7, 0.3),
            size_px: [columns, rows],
        };
        for (column, row) in (0..columns).flat_map(|column| (0..rows).map(move |row| (column, row))) {
            let centre = frame.centre([column, row]);
            for x in [-0.049, 0.0, 0.049] {
                assert_eq!(frame.pixel(centre + DVec2::splat(x)), [column, row], "{x} from {centre}");
            }
        }
        let (low, high) = (frame.origin, frame.origin + frame.size);
        assert_eq!(frame.pixel(low), [0, rows - 1], "the border belongs inside");
        assert_eq!(frame.pixel(high), [columns - 1, 0]);
        assert_eq!(frame.pixel(low - 1e9), [0, rows - 1], "the nearest pixel");
        assert_eq!(frame.pixel(high + 1e9), [columns - 1, 0]);
        assert_eq!(frame.pixel(DVec2::NAN), [0, 0]);
    }
}
