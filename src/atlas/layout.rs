//! Where the charts of a skin lie in its images: one image per patch and level, or one per level
//! with all patches packed.
//!
//! Neighbours on the body are neighbours in a packed image, with distal links above proximal ones (`pack`), and
//! each chart is turned so that the distal end of its link is up (`turn`).

use glam::DVec2;

use crate::atlas::AtlasError;
use crate::atlas::pack::{Item, Packing, items};
use crate::atlas::rasterize::MAX_SIDE;
use crate::atlas::turn::Extent;
use crate::map::{ImageFrame, PatchMap, SkinMap};
use crate::pyramid::LevelId;
use crate::skin::PatchId;

/// Where one chart lies in its image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ChartPosition {
    pub(super) patch: PatchId,
    pub(super) turns: u8,
    pub(super) frame: ImageFrame,
    pub(super) corner_px: [u32; 2],
}

/// An image with the places of its charts.
pub(super) struct PartLayout {
    pub(super) name: String,
    pub(super) level: LevelId,
    pub(super) frame: ImageFrame,
    pub(super) places: Vec<ChartPosition>,
}

/// Patch and level as files name them: `palm/L0`.
pub(super) fn image_name(patch: &PatchMap, level: LevelId) -> String {
    format!("{}/L{level}", patch.name)
}

/// The images of a map that is known to be valid.
/// Fails if the options make no sense or the charts do not fit into the canvas.
pub(super) fn layout(map: &SkinMap, options: &AtlasOptions) -> Result<Vec<PartLayout>, AtlasError> {
    if let Resolution::Pixel(found) = options.resolution
        && !(found.is_finite() && found > 0.0)
    {
        return Err(AtlasError::PixelSize { found });
    }
    if options.packed { packed(map, options) } else { one_per_patch(map, options) }
}

/// One image per patch and level: patch by patch, finest level first.
fn one_per_patch(map: &SkinMap, options: &AtlasOptions) -> Result<Vec<PartLayout>, AtlasError> {
    let mut parts = Vec::new();
    for (id, patch) in map.patches.enumerate() {
        let canvas = match options.resolution {
            Resolution::Canvas(canvas) => Some(centred(Extent::of(patch, 0), canvas)?),
            _ => None,
        };
        for (level, at) in patch.levels.enumerate() {
            let frame = match (options.resolution, canvas) {
                (_, Some(frame)) => frame,
                (Resolution::Pixel(pixel), _) => {
                    let Extent { lo, hi } = Extent::around(&at.uv, 0);
                    ImageFrame::around_box(lo, hi, pixel, MARGIN)
                }
                _ => at.frame,
            };
            let place = ChartPosition { patch: id, turns: 0, frame, corner_px: [0, 0] };
            parts.push(PartLayout { name: image_name(patch, level), level, frame, places: vec![place] });
        }
    }
    Ok(parts)
}

/// The frame of a whole canvas around an extent, at the largest scale that fits.
fn centred(extent: Extent, canvas: [u32; 2]) -> Result<ImageFrame, AtlasError> {
    let [width, height] = free(canvas, [1, 1])?.map(f64::from);
    let size = extent.size();
    let pixel = positive((size.x / width).max(size.y / height));
    let size_px = [canvas[1], canvas[0]];
    let size = DVec2::from_array(size_px.map(f64::from)) * pixel;
    let middle = (extent.lo + extent.hi) / 2.0;
    let middle = if middle.is_finite() { middle } else { DVec2::ZERO };
    Ok(ImageFrame { origin: middle - size / 2.0, size, size_px })
}

/// A pixel size for charts without a size: any will do.
fn positive(pixel: f64) -> f64 {
    if pixel > 0.0 { pixel } else { 1e-3 }
}

/// Width and height of a canvas (height, width) within its margins.
/// Fails if that is less than `least` (width, height) or more than an image may have.
fn free(canvas: [u32; 2], least: [u64; 2]) -> Result<[u32; 2], AtlasError> {
    let margins = 2 * u64::from(MARGIN);
    let fits = |side: u32, least: u64| side <= MAX_SIDE && u64::from(side) >= least + margins;
    let [height, width] = canvas;
    if fits(width, least[0]) && fits(height, least[1]) {
        return Ok([width - 2 * MARGIN, height - 2 * MARGIN]);
    }
    let least = [least[1] + margins, least[0] + margins];
    Err(AtlasError::Canvas { canvas, least, max_side: MAX_SIDE })
}

/// Pixels around a chart that show nothing, and around all of a packed image.
const MARGIN: u32 = 1;

/// Steps in which the scale of a canvas is found, from a range of 2^15: to a millionth.
const HALVINGS: usize = 24;

/// One image per level, with the charts in the order in which they are packed.
fn packed(map: &SkinMap, options: &AtlasOptions) -> Result<Vec<PartLayout>, AtlasError> {
    let items = items(map);
    if items.is_empty() {
        return Ok(Vec::new());
    }
    let (pixel, canvas) = match options.resolution {
        Resolution::Pixel(pixel) => (pixel, None),
        Resolution::Map => {
            let frame = map.patches[PatchId::new(0)].levels[LevelId::new(0)].frame;
            (frame.size.x / f64::from(frame.size_px[0]), None)
        }
        Resolution::Canvas(canvas) => (largest_scale(&items, canvas)?, Some(canvas)),
    };
    let packing = match canvas {
        Some([_, width]) => Packing::new(&items, pixel, u64::from(width) - 2 * u64::from(MARGIN)),
        None => Packing::smallest(&items, pixel),
    };
    let total = packing.size.map(|n| u32::try_from(n + 2 * u64::from(MARGIN)).unwrap_or(u32::MAX));
    let size_px = canvas.map_or(total, |[height, width]| [width, height]);
    let frame =
        ImageFrame { origin: DVec2::ZERO, size: DVec2::from_array(size_px.map(f64::from)) * pixel, size_px };
    let px = |n: u64| u32::try_from(n).unwrap_or(u32::MAX);
    let place = |(item, &[left, bottom]): (&Item, &[u64; 2])| {
        let frame = ImageFrame::around_box(item.extent.lo, item.extent.hi, pixel, 0);
        let below = px(bottom).saturating_add(MARGIN).saturating_add(frame.size_px[1]);
        let corner_px = [px(left).saturating_add(MARGIN), size_px[1].saturating_sub(below)];
        ChartPosition { patch: item.patch, turns: item.turns, frame, corner_px }
    };
    let places: Vec<ChartPosition> = items.iter().zip(&packing.corners).map(place).collect();
    let levels = map.patches.iter().map(|patch| patch.levels.len()).max().unwrap_or(0);
    let part = |level: LevelId| {
        let has_it = |place: &&ChartPosition| map.patches[place.patch].levels.get(level).is_some();
        let places = places.iter().filter(has_it).copied().collect();
        PartLayout { name: format!("L{level}"), level, frame, places }
    };
    Ok((0..levels).map(LevelId::new).map(part).collect())
}

/// The smallest pixel size at which the charts fit into a canvas (height, width).
fn largest_scale(items: &[Item], canvas: [u32; 2]) -> Result<f64, AtlasError> {
    let needed = |pixel: f64, width: u64| Packing::new(items, pixel, width).size;
    // One pixel a chart.
    let within = u64::from(canvas[1]).saturating_sub(2 * u64::from(MARGIN)).max(1);
    let largest = items.iter().map(|item| item.extent.size().max_element()).fold(0.0, f64::max);
    let coarse = positive(largest);
    let [width, height] = free(canvas, needed(coarse, within))?.map(u64::from);
    let (mut fits, mut fails) = (coarse, coarse / f64::from(2 * MAX_SIDE));
    for _ in 0..HALVINGS {
        let pixel = (fits * fails).sqrt();
        let [w, h] = needed(pixel, width);
        *if w <= width && h <= height { &mut fits } else { &mut fails } = pixel;
    }
    Ok(fits)
}

/// How many pixels the images of an [`Atlas`](crate::atlas::Atlas) have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Resolution {
    /// The frames of the map itself: pixels are those of `map.exr`. Where charts are packed, the
    /// pixel size of the first patch's level 0.
    Map,
    /// This many metres per pixel.
    Pixel(f64),
    /// Images of this height and width in pixels, at the largest scale that fits: one scale for all
    /// levels of a patch, or for all patches where they are packed.
    Canvas([u32; 2]),
}

/// Options of [`Atlas::new`](crate::atlas::Atlas::new).
#[derive(Debug, Clone, PartialEq)]
pub struct AtlasOptions {
    /// How many pixels the images have. [`Resolution::Map`] by default.
    pub resolution: Resolution,
    /// Whether all patches of a level lie in one image; otherwise each has its own. Packed images
    /// of different levels have the same layout.
    pub packed: bool,
}

impl Default for AtlasOptions {
    fn default() -> Self {
        Self { resolution: Resolution::Map, packed: false }
    }
}
