//! The layout of the charts of a skin in its images: one image per patch and level, or one per level with all
//! patches packed.
//!
//! `pack` computes the positions of charts in one image, `turn` their rotations.

use glam::{DVec2, DVec3};

use crate::atlas::AtlasError;
use crate::atlas::pack::{Items, Pack, PackedChart, Packing};
use crate::atlas::rasterize::MAX_SIDE;
use crate::atlas::turn::Extent;
use crate::map::{ImageFrame, PatchMap, SkinMap};
use crate::mesh::TriMesh;
use crate::pyramid::LevelId;
use crate::skin::PatchId;

/// The position of one chart in its image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ChartPosition {
    pub(super) patch: PatchId,
    pub(super) level: LevelId,
    pub(super) turns: u8,
    pub(super) frame: ImageFrame,
    pub(super) corner_px: [u32; 2],
}

/// An image with the positions of its charts.
pub(super) struct PartLayout {
    pub(super) name: String,
    pub(super) level: LevelId,
    pub(super) frame: ImageFrame,
    pub(super) places: Vec<ChartPosition>,
}

/// Patch and level as in files: `palm/L0`.
pub(super) fn image_name(patch: &PatchMap, level: LevelId) -> String {
    format!("{}/L{level}", patch.name)
}

/// The images of a map that is known to be valid.
/// Fails if the options are invalid or the charts do not fit into the canvas.
pub(super) fn layout(map: &SkinMap, options: &AtlasOptions) -> Result<Vec<PartLayout>, AtlasError> {
    if let Resolution::Pixel(side) = options.resolution {
        let finest = map.patches.iter().filter_map(|patch| patch.levels.get(LevelId::default()));
        check_pixel(side, finest.map(|finest| &finest.level.mesh))?;
    }
    match options.pack {
        Some(pack) => packed(map, pack, options.resolution),
        None => one_per_patch(map, options),
    }
}

/// Refuses the side of a pixel, in m, that is no length, or larger than every patch, as when it was given in mm.
#[doc(hidden)]
pub fn check_pixel<'m>(found: f64, patches: impl Iterator<Item = &'m TriMesh>) -> Result<(), AtlasError> {
    if !(found.is_finite() && found > 0.0) {
        return Err(AtlasError::PixelSize { found });
    }
    let across = |mesh: &TriMesh| {
        let corners = (DVec3::MAX, DVec3::MIN);
        let (low, high) = mesh.positions.iter().fold(corners, |(low, high), &p| (low.min(p), high.max(p)));
        (high - low).length()
    };
    match patches.map(across).reduce(f64::max) {
        Some(largest) if found > largest => Err(AtlasError::PixelBeyondPatches { found, largest }),
        _ => Ok(()),
    }
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
            let place = ChartPosition { patch: id, level, turns: 0, frame, corner_px: [0, 0] };
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

/// A pixel size, also for charts without a size, for which any is valid.
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

/// One image per level, with the charts in the order in which they are packed. A patch without the level shows its
/// coarsest.
fn packed(map: &SkinMap, pack: Pack, resolution: Resolution) -> Result<Vec<PartLayout>, AtlasError> {
    if map.patches.is_empty() {
        return Ok(Vec::new());
    }
    let items = Items::new(map, pack);
    let (packing, canvas) = match resolution {
        Resolution::Pixel(pixel) => (items.smallest(pixel), None),
        Resolution::Map => {
            let frame = map.patches[PatchId::new(0)].levels[LevelId::new(0)].frame;
            (items.smallest(frame.size.x / f64::from(frame.size_px[0])), None)
        }
        Resolution::Canvas(canvas) => (within_canvas(&items, canvas)?, Some(canvas)),
    };
    let px = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    let size_px = packing.size.map(|n| px(n).saturating_add(2 * MARGIN));
    let size_px = canvas.map_or(size_px, |[height, width]| [width, height]);
    let frame = ImageFrame {
        origin: DVec2::ZERO,
        size: DVec2::from_array(size_px.map(f64::from)) * packing.pixel,
        size_px,
    };
    let place = |chart: &PackedChart, level: LevelId| {
        let PackedChart { patch, turns, frame, corner: [left, bottom] } = *chart;
        let below = px(bottom).saturating_add(MARGIN).saturating_add(frame.size_px[1]);
        let corner_px = [px(left).saturating_add(MARGIN), size_px[1].saturating_sub(below)];
        ChartPosition { patch, level: map.patches[patch].nearest_level(level), turns, frame, corner_px }
    };
    let levels = map.patches.iter().map(|patch| patch.levels.len()).max().unwrap_or(0);
    let part = |level: LevelId| {
        let places = packing.charts.iter().map(|chart| place(chart, level)).collect();
        PartLayout { name: format!("L{level}"), level, frame, places }
    };
    Ok((0..levels).map(LevelId::new).map(part).collect())
}

/// Packs the charts into a canvas (height, width), at the largest scale that fits.
fn within_canvas(items: &Items<'_>, canvas: [u32; 2]) -> Result<Packing, AtlasError> {
    let coarse = positive(items.largest_side());
    // One pixel a chart.
    let least = items.smallest(coarse).size.map(|n| n as u64);
    let size = free(canvas, [1, 1])?.map(|n| n as usize);
    let margins = 2 * u64::from(MARGIN);
    let refused =
        || AtlasError::Canvas { canvas, least: [least[1] + margins, least[0] + margins], max_side: MAX_SIDE };
    items.largest_scale(size, coarse).ok_or_else(refused)
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
    /// How all patches of a level are packed into one image; `None` gives each its own. Packed images of
    /// different levels have the same layout, and a patch without a level shows its coarsest there.
    pub pack: Option<Pack>,
}

impl Default for AtlasOptions {
    fn default() -> Self {
        Self { resolution: Resolution::Map, pack: None }
    }
}
