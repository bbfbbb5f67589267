//! Where the charts of a skin lie in its images: one image per patch and level, or one per level
//! with all patches packed.
//!
//! Packed charts stand on shelves, one for each depth of the tree of links: the root's patches at
//! the bottom, patches of its children on the shelf above, and so on, a shelf that is too long
//! continued on the next one. On a shelf they stand in the order in which a walk through the tree,
//! children in their order, meets them. Each chart is turned by quarter turns so that the distal
//! end of its link is up: neighbours on the body become neighbours in the image. Shelves are a
//! *heuristic*: a packer that minimises area would place charts anywhere. For one to
//! thirteen caps of different sizes on one link they fill 81 to 98 % of the image with rectangles of
//! charts, of a fixed canvas half or more.

use glam::{DMat2, DVec2, DVec3};

use crate::atlas::AtlasError;
use crate::atlas::rasterize::MAX_SIDE;
use crate::id::IdVec;
use crate::map::{ImageFrame, PatchMap, SkinMap};
use crate::numeric::order_by;
use crate::pyramid::LevelId;
use crate::skin::{Link, LinkId, PatchId};

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

/// `p` after `turns` quarter turns, counter-clockwise.
pub(super) fn turned(p: DVec2, turns: u8) -> DVec2 {
    match turns {
        0 => p,
        1 => DVec2::new(-p.y, p.x),
        2 => -p,
        _ => DVec2::new(p.y, -p.x),
    }
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

/// A rectangle of a turned map, in m.
#[derive(Clone, Copy)]
struct Extent {
    lo: DVec2,
    hi: DVec2,
}

impl Extent {
    fn around<'a>(positions: impl IntoIterator<Item = &'a DVec2>, turns: u8) -> Self {
        let start = Self { lo: DVec2::INFINITY, hi: DVec2::NEG_INFINITY };
        let grow = |Self { lo, hi }: Self, p: DVec2| Self { lo: lo.min(p), hi: hi.max(p) };
        positions.into_iter().map(|&p| turned(p, turns)).fold(start, grow)
    }

    /// All levels of a patch.
    fn of(patch: &PatchMap, turns: u8) -> Self {
        Self::around(patch.levels.iter().flat_map(|level| &level.uv), turns)
    }

    /// Width and height; 0 for no positions.
    fn size(&self) -> DVec2 {
        (self.hi - self.lo).max(DVec2::ZERO)
    }
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

/// Pixels around a chart that show nothing, and between two charts of a packed image.
const MARGIN: u32 = 1;
const GAP: u64 = 2;

/// A chart to be packed.
struct Item {
    patch: PatchId,
    turns: u8,
    extent: Extent,
    /// Depth of its link in the tree.
    depth: usize,
}

impl Item {
    /// Width and height in pixels, without margins.
    fn size_px(&self, pixel: f64) -> [u64; 2] {
        let count = (self.extent.size() / pixel).ceil().max(DVec2::ONE);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "`as` saturates; images that large are refused"
        )]
        let size = [count.x, count.y].map(|n| (n as u64).min(u64::from(u32::MAX)));
        size
    }
}

/// One image per level: the patches in the order of the tree of links.
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
    let sizes: Vec<[u64; 2]> = items.iter().map(|item| item.size_px(pixel)).collect();
    let width = match canvas {
        Some([_, width]) => u64::from(width) - 2 * u64::from(MARGIN),
        None => width_of(&sizes),
    };
    let shelves = Shelves::new(&items, &sizes, width);
    let total = shelves.size.map(|n| u32::try_from(n + 2 * u64::from(MARGIN)).unwrap_or(u32::MAX));
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
    let places: Vec<ChartPosition> = items.iter().zip(&shelves.positions).map(place).collect();
    let levels = map.patches.iter().map(|patch| patch.levels.len()).max().unwrap_or(0);
    let part = |level: LevelId| {
        let has_it = |place: &&ChartPosition| map.patches[place.patch].levels.get(level).is_some();
        let places = places.iter().filter(has_it).copied().collect();
        PartLayout { name: format!("L{level}"), level, frame, places }
    };
    Ok((0..levels).map(LevelId::new).map(part).collect())
}

/// The charts of a map in the order of the tree of links.
fn items(map: &SkinMap) -> Vec<Item> {
    let mut items = Vec::new();
    // Links whose turn comes, the next one last.
    let of_parent = |parent: Option<LinkId>| {
        map.links.enumerate().rev().filter(move |(_, link)| link.parent == parent).map(|(id, _)| id)
    };
    let mut open: Vec<(LinkId, usize)> = of_parent(None).map(|id| (id, 0)).collect();
    while let Some((link, depth)) = open.pop() {
        open.extend(of_parent(Some(link)).map(|id| (id, depth + 1)));
        for (id, patch) in map.patches.enumerate().filter(|(_, patch)| patch.link == link) {
            let turns = distal_up(&map.links, patch);
            items.push(Item { patch: id, turns, extent: Extent::of(patch, turns), depth });
        }
    }
    items
}

/// The quarter turns that bring the distal end of a patch's link up on the map; 0 if the link has
/// no distal end.
///
/// Distal is the way from the link's origin to those of its children, or, for the last link of a
/// chain, to the middle of the patch. A link without parent and child has no distal end.
fn distal_up(links: &IdVec<LinkId, Link>, patch: &PatchMap) -> u8 {
    let Some(distal) = distal(links, patch) else { return 0 };
    let finest = &patch.levels[LevelId::new(0)];
    let (areas, uv, positions) = (&finest.level.areas, &finest.uv, &finest.level.mesh.positions);
    let total: f64 = areas.iter().sum();
    let middle = uv.iter().zip(areas).map(|(p, a)| *p * *a).sum::<DVec2>() / total;
    // The linear function of the map that is nearest to the distance along `distal`.
    let (mut matrix, mut right) = (DMat2::ZERO, DVec2::ZERO);
    for ((p, x), area) in uv.iter().zip(positions).zip(areas) {
        let d = *p - middle;
        matrix += DMat2::from_cols(d * d.x, d * d.y) * *area;
        right += d * x.dot(distal) * *area;
    }
    let gradient = matrix.inverse() * right;
    if !gradient.is_finite() {
        return 0;
    }
    let up = |turns: u8| turned(gradient, turns).y;
    (1..4).fold(0, |best, turns| if up(turns) > up(best) + 1e-9 { turns } else { best })
}

/// The unit vector to the distal end of a patch's link, in the link's frame.
fn distal(links: &IdVec<LinkId, Link>, patch: &PatchMap) -> Option<DVec3> {
    let children = links.iter().filter(|link| link.parent == Some(patch.link));
    let (sum, count) = children.fold((DVec3::ZERO, 0), |(sum, n), link| (sum + link.pose.translation, n + 1));
    if count > 0 {
        return sum.try_normalize();
    }
    links[patch.link].parent?;
    let positions = &patch.levels[LevelId::new(0)].level.mesh.positions;
    positions.iter().sum::<DVec3>().try_normalize()
}

/// Width of the shelves where none is asked for: about a square, and never less than a chart.
fn width_of(sizes: &[[u64; 2]]) -> u64 {
    let area: f64 = sizes.iter().map(|[w, h]| (*w + GAP) as f64 * (*h + GAP) as f64).sum();
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "positive, and `as` saturates"
    )]
    let square = (1.2 * area).sqrt().ceil() as u64;
    sizes.iter().map(|[w, _]| *w).max().unwrap_or(0).max(square)
}

/// The smallest pixel size whose shelves fit into a canvas (height, width).
fn largest_scale(items: &[Item], canvas: [u32; 2]) -> Result<f64, AtlasError> {
    let needed = |pixel: f64, width: u64| {
        let sizes: Vec<_> = items.iter().map(|item| item.size_px(pixel)).collect();
        Shelves::new(items, &sizes, width).size
    };
    // One pixel a chart.
    let within = u64::from(canvas[1]).saturating_sub(2 * u64::from(MARGIN)).max(1);
    let largest = items.iter().map(|item| item.extent.size().max_element()).fold(0.0, f64::max);
    let coarse = positive(largest);
    let [width, height] = free(canvas, needed(coarse, within))?.map(u64::from);
    let (mut fits, mut fails) = (coarse, coarse / f64::from(2 * MAX_SIDE));
    for _ in 0..64 {
        let pixel = (fits * fails).sqrt();
        let [w, h] = needed(pixel, width);
        *if w <= width && h <= height { &mut fits } else { &mut fails } = pixel;
    }
    Ok(fits)
}

/// Rectangles on shelves, without the margin around them all.
struct Shelves {
    /// Left and lower edge of each rectangle.
    positions: Vec<[u64; 2]>,
    size: [u64; 2],
}

impl Shelves {
    /// A new shelf begins with each depth, and where the next rectangle would end beyond `width`.
    fn new(items: &[Item], sizes: &[[u64; 2]], width: u64) -> Self {
        let mut positions = vec![[0, 0]; items.len()];
        let order = order_by(items.len(), &|a, b| items[a].depth.cmp(&items[b].depth));
        let (mut left, mut bottom, mut top, mut right) = (0, 0, 0, 0);
        let mut depth = None;
        for k in order {
            let [w, h] = sizes[k];
            if left > 0 && (depth != Some(items[k].depth) || left + w > width) {
                (left, bottom) = (0, top + GAP);
            }
            depth = Some(items[k].depth);
            positions[k] = [left, bottom];
            (right, top) = (right.max(left + w), top.max(bottom + h));
            left += w + GAP;
        }
        Self { positions, size: [right, top] }
    }
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
