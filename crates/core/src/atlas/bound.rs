//! Limits on the pixels of images, checked before anything is rasterised. The limits are a *heuristic*: 16 x
//! 16 pixels per taxel are those of 1 mm at a spacing of 16 mm, which few skins exceed; without a limit one
//! distant taxel made 3.5 GB of images from a table of 9 kB.

use crate::atlas::AtlasError;
use crate::atlas::rasterize::MAX_SIDE;
use crate::map::{ImageFrame, SkinMap};

/// Largest number of pixels of all images together.
const MAX_PIXELS: u64 = 1 << 26;

/// The images of a map have at most this many pixels for each taxel, or [`FREE_PIXELS`].
const PIXELS_PER_TAXEL: u64 = 256;

/// Unless finer ones are asked for, of more pixels than this there are at most [`PIXELS_PER_TAXEL_BEYOND`] for each taxel: a
/// pixel takes some 34 bytes of a file, and these, with their margin, 115 MB; 25,600 taxels at 256 pixels took 183 MB.
const AMPLE_PIXELS: u64 = 4_000_000;
const PIXELS_PER_TAXEL_BEYOND: u64 = 64;

/// Pixels that the images of any map may have: a picture of a few triangles is still sharp.
const FREE_PIXELS: u64 = 1 << 20;

/// The suggested pixel size is at most this many times the one that just fits, for margins.
const MARGIN_FACTOR: f64 = 1.1;

/// Fails if an image exceeds the largest size, with a pixel size that would fit.
pub(super) fn check_size(frame: &ImageFrame, image: &str) -> Result<(), AtlasError> {
    let (size, size_px) = (frame.size, frame.size_px);
    let pixels = u64::from(size_px[0]) * u64::from(size_px[1]);
    if size_px.iter().any(|&n| n > MAX_SIDE) || pixels > MAX_PIXELS {
        let fits = side_that_fits(frame).max((size.x * size.y / MAX_PIXELS as f64).sqrt());
        return Err(AtlasError::TooLarge {
            image: image.into(),
            size,
            size_px,
            max_side: MAX_SIDE,
            max_pixels: MAX_PIXELS,
            fits_mm: two_digits_up(1e3 * MARGIN_FACTOR * fits),
        });
    }
    Ok(())
}

/// Fails if all images together exceed [`MAX_PIXELS`], with a pixel size that would fit; a pixel has
/// `samples`, of 4 bytes each.
pub(super) fn check_total<'a>(
    frames: impl Iterator<Item = &'a ImageFrame>,
    samples: u64,
) -> Result<(), AtlasError> {
    check(Sum::of(frames), MAX_PIXELS, samples)
}

/// Fails if the images of a map have more pixels than its taxels need, with a pixel size that would fit; a
/// pixel has `samples`, of 4 bytes each.
pub(super) fn check_map(map: &SkinMap, samples: u64) -> Result<(), AtlasError> {
    check(Sum::of(frames(map)), most_pixels(taxels_of(map)), samples)
}

/// The pixel size (mm) with which the images of a map keep to all limits, and to those of images that nobody asked to be finer;
/// `None` if they do now.
#[doc(hidden)]
pub fn fitting_pixel(map: &SkinMap) -> Option<f64> {
    let (sum, taxels) = (Sum::of(frames(map)), taxels_of(map));
    let most = most_by_default(most_pixels(taxels), taxels);
    let is_wide = frames(map).any(|frame| frame.size_px.iter().any(|&n| n > MAX_SIDE));
    if sum.pixels <= most && !is_wide {
        return None;
    }
    let by_side = frames(map).map(side_that_fits).fold(0.0, f64::max);
    let by_area = (sum.area / most as f64).sqrt();
    Some(two_digits_up(1e3 * MARGIN_FACTOR * by_side.max(by_area)))
}

#[doc(hidden)]
pub fn pixels_of(map: &SkinMap) -> u64 {
    Sum::of(frames(map)).pixels
}

fn frames(map: &SkinMap) -> impl Iterator<Item = &ImageFrame> {
    map.patches.iter().flat_map(|patch| patch.levels.iter().map(|level| &level.frame))
}

fn taxels_of(map: &SkinMap) -> u64 {
    map.patches.iter().map(|patch| patch.taxels.ids.len() as u64).sum()
}

fn most_pixels(taxels: u64) -> u64 {
    (PIXELS_PER_TAXEL * taxels).clamp(FREE_PIXELS, MAX_PIXELS)
}

/// The most pixels that are made without being asked for, of images that may have `most` for a number of taxels.
fn most_by_default(most: u64, taxels: u64) -> u64 {
    most.min(AMPLE_PIXELS.max(PIXELS_PER_TAXEL_BEYOND * taxels))
}

/// The total of some images.
struct Sum {
    images: usize,
    pixels: u64,
    /// In m^2.
    area: f64,
}

impl Sum {
    fn of<'a>(frames: impl Iterator<Item = &'a ImageFrame>) -> Self {
        frames.fold(Self { images: 0, pixels: 0, area: 0.0 }, |sum, frame| {
            let [width, height] = frame.size_px.map(u64::from);
            Self {
                images: sum.images + 1,
                pixels: sum.pixels.saturating_add(width.saturating_mul(height)),
                area: sum.area + frame.size.x * frame.size.y,
            }
        })
    }
}

fn check(sum: Sum, max_pixels: u64, samples: u64) -> Result<(), AtlasError> {
    let Sum { images, pixels, area } = sum;
    if pixels <= max_pixels {
        return Ok(());
    }
    let fits_mm = two_digits_up(1e3 * MARGIN_FACTOR * (area / max_pixels as f64).sqrt());
    let bytes = pixels.saturating_mul(4 * samples);
    Err(AtlasError::TooManyPixels { images, pixels, bytes, max_pixels, fits_mm })
}

/// The pixel size (m) with which an image just has the largest side.
fn side_that_fits(frame: &ImageFrame) -> f64 {
    frame.size.max_element() / f64::from(MAX_SIDE - 2)
}

/// The next number with two digits.
fn two_digits_up(x: f64) -> f64 {
    let exponent = x.log10().floor() - 1.0;
    let digits = (x / 10_f64.powf(exponent)).ceil();
    // Via text, to avoid 4.800000000000001.
    format!("{digits}e{exponent}").parse().unwrap_or(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_of_many_taxels_have_fewer_pixels_for_each() {
        let most = |taxels: u64| most_by_default(most_pixels(taxels), taxels);
        assert_eq!([100, 5000, 26_000].map(most), [1 << 20, 1_280_000, 4_000_000]);
        assert_eq!([100_000, 10_000_000].map(most), [6_400_000, 1 << 26]);
    }
}
