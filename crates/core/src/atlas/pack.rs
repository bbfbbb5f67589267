//! Packs charts one after the other, each on free pixels, so that small charts fill the holes and bays of
//! large ones. On ten robots (Panda, UR10, Talos, TIAGo, Go1, Solo, Baxter, Allegro, Kinova, Romeo) at the default pixel
//! 66 to 75 % of the image are filled; packing by outlines (horizons; `(levy2002)`) fills 26 to 30 %.
//!
//! [`Pack::Tight`] places larger charts first, each with the best of eight turns, as low and as far left as
//! possible. [`Pack::Body`] places proximal links first, turns the distal end of each link up, and chooses a
//! low position near the neighbouring chart on the body, above the centre of the charts of the parent link.

use std::collections::BTreeMap;

use glam::DVec3;
use rayon::prelude::*;

use crate::atlas::grid::{Grid, Mask};
use crate::atlas::turn::{Extent, TURNS, distal_turns};
use crate::id::IdVec;
use crate::map::{ImageFrame, MapLevel, PatchMap, SkinMap};
use crate::numeric::order_by;
use crate::skin::{LinkId, PatchId, world_pose};

/// How the charts of all patches of a level are packed into one image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pack {
    /// As large as they fit, turned by eighths of a turn: for a network that reads the image.
    Tight,
    /// In the order of the body, turned by quarters: the distal end of each link up, distal links above
    /// proximal ones and neighbours near each other, provided that two fifths of the image are filled: for
    /// human readers.
    Body,
}

impl Pack {
    /// Pixels between two charts that show nothing.
    fn gap(self) -> usize {
        match self {
            Self::Tight => 1,
            Self::Body => 2,
        }
    }
}

/// Most cells along the longer side of an image; charts are moved by cells of one pixel or several.
const CELLS: usize = 384;

/// Cost of a pixel of distance from the neighbouring chart, in pixels of height: values from 0.1 to 0.3 fill
/// about as much; with 0 neighbours are twice as far from each other.
const DISTANCE_COST: f64 = 0.2;

/// Weight of the distance of centres, relative to that of boxes, in the distance of patches: overlapping
/// boxes have distance 0.
const CENTRE_WEIGHT: f64 = 0.1;

/// Cost of a column, in rows, when charts are packed tightly into a square of fixed size, which they fill 1 % more with
/// it. With it an image of free height would be filled 3 to 11 % less.
const COLUMN_COST: f64 = 0.5;

/// Lowest position of the charts of a link, as a share of the centre height of the charts of its parent: the
/// first value that fills [`ENOUGH_FILL`] of the image is used, or the one that fills most.
const FLOORS: [f64; 4] = [1.0, 0.6, 0.3, 0.0];
const ENOUGH_FILL: f64 = 0.4;

/// Tried widths, over the side of a square that the charts would fill.
const WIDTHS: [f64; 6] = [1.0, 1.1, 1.2, 1.3, 1.4, 1.6];

/// Factor between tried scales, and how often the last step is halved: to 0.4 %.
const STEP: f64 = 1.12;
const HALVINGS: usize = 5;

/// An image that charts are packed into.
#[derive(Clone, Copy)]
struct Space {
    /// Width and height in pixels; the height `usize::MAX` is free.
    size: [usize; 2],
    /// The side of a cell in pixels, and how many cells there are along each side.
    cell: usize,
    cells: [usize; 2],
}

impl Space {
    fn new(size: [usize; 2]) -> Self {
        let [width, height] = size;
        let longer = if height == usize::MAX { width } else { width.max(height) };
        let cell = longer.div_ceil(CELLS).max(1);
        let cells = [width / cell, if height == usize::MAX { height } else { height / cell }];
        Self { size, cell, cells }
    }
}

/// A chart to be packed.
struct Item<'a> {
    id: PatchId,
    patch: &'a PatchMap,
    /// The turns to try, in eighths.
    turns: Vec<u8>,
    /// The nearest ancestor of its link that has charts.
    below: Option<LinkId>,
    /// An earlier chart that it should be near.
    near: Option<usize>,
}

/// The charts of a map in the order in which they are packed.
pub(super) struct Items<'a> {
    all: Vec<Item<'a>>,
    pack: Pack,
    /// In m^2.
    area: f64,
}

impl<'a> Items<'a> {
    pub(super) fn new(map: &'a SkinMap, pack: Pack) -> Self {
        let below = links_below(map);
        let distal = distal_turns(map);
        let areas = map.patches.map(area);
        let depth =
            |id: PatchId| std::iter::successors(below[map.patches[id].link], |&link| below[link]).count();
        let height = |id: PatchId| Extent::of(&map.patches[id], distal[id]).size().y;
        let order = order_by(map.patches.len(), &|a, b| {
            let [a, b] = [a, b].map(PatchId::new);
            match pack {
                Pack::Tight => areas[b].total_cmp(&areas[a]),
                Pack::Body => depth(a).cmp(&depth(b)).then(height(b).total_cmp(&height(a))),
            }
        });
        let item = |k: usize| {
            let id = PatchId::new(k);
            let turns = if pack == Pack::Tight { (0..TURNS).collect() } else { vec![distal[id]] };
            Item { id, patch: &map.patches[id], turns, below: below[map.patches[id].link], near: None }
        };
        let mut all: Vec<Item<'a>> = order.into_iter().map(item).collect();
        let boxes: Vec<[DVec3; 2]> = all.iter().map(|item| box_of(map, item.patch)).collect();
        for (k, item) in all.iter_mut().enumerate().filter(|_| pack == Pack::Body) {
            let away = |j: usize| {
                let ([low, high], [other_low, other_high]) = (boxes[k], boxes[j]);
                let gap = (low - other_high).max(other_low - high).max(DVec3::ZERO).length();
                gap + CENTRE_WEIGHT * (low + high).distance(other_low + other_high)
            };
            item.near = (0..k).min_by(|&a, &b| away(a).total_cmp(&away(b)));
        }
        Self { all, pack, area: areas.iter().sum() }
    }

    /// The largest side of a chart, in m.
    pub(super) fn largest_side(&self) -> f64 {
        let sides = self.all.iter().flat_map(|item| {
            item.turns.iter().map(|&turns| Extent::of(item.patch, turns).size().max_element())
        });
        sides.fold(0.0, f64::max)
    }

    /// Packs the charts into the smallest of some nearly square images; a pixel has the side `pixel`, in m.
    pub(super) fn smallest(&self, pixel: f64) -> Packing {
        let widest = to_count(self.largest_side() / pixel) + 2;
        let widths = WIDTHS.map(|times| widest.max(to_count(times * self.area.sqrt() / pixel)));
        // Most widths have cells of the same size, and masks take more time than their positions.
        let mut masks: BTreeMap<usize, Vec<Vec<Mask>>> = BTreeMap::new();
        for width in widths.into_iter().rev() {
            let space = Space::new([width, usize::MAX]);
            masks.entry(space.cell).or_insert_with(|| self.masks(pixel, &space));
        }
        let packings = self.first_that_fills(|floor| {
            let of_width = |width: usize| {
                let space = Space::new([width, usize::MAX]);
                self.packing(pixel, &space, masks.get(&space.cell)?, floor)
            };
            let all: Vec<Packing> = widths.into_par_iter().filter_map(of_width).collect();
            all.into_iter().min_by(|a, b| a.pixels().total_cmp(&b.pixels()))
        });
        packings.unwrap_or_default()
    }

    /// Packs the charts into an image of a width and a height in pixels, at the largest scale at which they
    /// fit; `coarse`, in m, is the side of a pixel as large as the largest chart. `None` if they do not fit
    /// even then.
    pub(super) fn largest_scale(&self, size: [usize; 2], coarse: f64) -> Option<Packing> {
        let full = (self.area / (size[0] as f64 * size[1] as f64)).sqrt();
        let space = Space::new(size);
        self.first_that_fills(|floor| {
            let packing = |pixel: f64| self.packing(pixel, &space, &self.masks(pixel, &space), floor);
            let mut fails = full.clamp(coarse * 1e-9, coarse);
            let mut fits = loop {
                let pixel = (fails * STEP).min(coarse);
                match packing(pixel) {
                    Some(packing) => break packing,
                    None if pixel < coarse => fails = pixel,
                    None => return None,
                }
            };
            for _ in 0..HALVINGS {
                let pixel = (fits.pixel * fails).sqrt();
                match packing(pixel) {
                    Some(packing) => fits = packing,
                    None => fails = pixel,
                }
            }
            Some(Packing { size, ..fits })
        })
    }

    /// The first packing that fills enough, of those for each of [`FLOORS`], or the fullest.
    fn first_that_fills(&self, packing: impl Fn(f64) -> Option<Packing>) -> Option<Packing> {
        let fill = |packing: &Packing| self.area / (packing.pixel * packing.pixel * packing.pixels());
        let mut best: Option<Packing> = None;
        let floors = if self.pack == Pack::Body { &FLOORS[..] } else { &[0.0] };
        for found in floors.iter().filter_map(|&floor| packing(floor)) {
            if fill(&found) >= ENOUGH_FILL {
                return Some(found);
            }
            if best.as_ref().is_none_or(|best| fill(&found) > fill(best)) {
                best = Some(found);
            }
        }
        best
    }

    /// The masks of each chart for its turns, but for those that are too large.
    fn masks(&self, pixel: f64, space: &Space) -> Vec<Vec<Mask>> {
        let of_item = |item: &Item<'_>| {
            let mask =
                |&turns: &u8| Mask::new(item.patch, turns, pixel, [space.cell, self.pack.gap()], space.cells);
            item.turns.iter().filter_map(mask).collect()
        };
        self.all.par_iter().map(of_item).collect()
    }

    /// Packs the charts, if they fit. `masks` are those of this space or of a wider one with cells of the same size.
    fn packing(&self, pixel: f64, space: &Space, masks: &[Vec<Mask>], floor: f64) -> Option<Packing> {
        let Space { size: [width, height], cell, cells } = *space;
        let mut grid = Grid::new(cells[0]);
        // In an image that grows upwards only the height counts.
        let column = if height == usize::MAX { 0.0 } else { COLUMN_COST * height as f64 / width as f64 };
        // For each chart the centre of its columns; for each link the highest centre of the rows of its charts.
        let mut centres: Vec<f64> = Vec::with_capacity(self.all.len());
        let mut middles: IdVec<LinkId, usize> = IdVec::default();
        let mut charts: Vec<PackedChart> = Vec::with_capacity(self.all.len());
        let mut size = [0, 0];
        for (item, masks) in self.all.iter().zip(masks) {
            let lowest =
                item.below.and_then(|link| middles.get(link)).map_or(0, |&row| to_count(floor * row as f64));
            let mut best: Option<(f64, [usize; 2], &Mask)> = None;
            // A chart as small as a pixel may cover no pixel centre in some turns; one that is too large covers some.
            let any_shows = masks.len() < item.turns.len()
                || masks.iter().any(|mask| mask.shows || mask.size[0] > cells[0]);
            for mask in masks.iter().filter(|mask| mask.shows || !any_shows) {
                let [w, h] = mask.size;
                let below = best.as_ref().map_or(f64::INFINITY, |(cost, ..)| *cost);
                let rows = [lowest, cells[1]];
                let found = match self.pack {
                    Pack::Tight => {
                        let least = |y: usize| (y + h) as f64 + column * w as f64;
                        grid.place(mask, rows, below, least, |x, y| least(y) + column * x as f64)
                    }
                    Pack::Body => {
                        let away = |x: usize| {
                            let centre = |near: usize| (x as f64 + 0.5 * w as f64 - centres[near]).abs();
                            item.near.map_or(0.0, centre)
                        };
                        grid.place(mask, rows, below, |y| y as f64, |x, y| y as f64 + DISTANCE_COST * away(x))
                    }
                };
                best = found.map(|(cost, at)| (cost, at, mask)).or(best);
            }
            let (_, [x, y], mask) = best?;
            grid.take(mask, [x, y]);
            centres.push(x as f64 + 0.5 * mask.size[0] as f64);
            let link = item.patch.link;
            while middles.len() <= link.index() {
                middles.push(0);
            }
            middles[link] = middles[link].max(y + mask.size[1].div_ceil(2));
            charts.push(PackedChart {
                patch: item.id,
                turns: mask.turns,
                frame: mask.frame,
                corner: [x, y].map(|n| n * cell),
            });
            let frame = mask.frame.size_px.map(|n| n as usize);
            size = [0, 1].map(|k| size[k].max(charts[charts.len() - 1].corner[k] + frame[k]));
        }
        Some(Packing { pixel, charts, size })
    }
}

/// A chart with its position in the image.
pub(super) struct PackedChart {
    pub(super) patch: PatchId,
    pub(super) turns: u8,
    pub(super) frame: ImageFrame,
    /// Left and lower edge, in pixels.
    pub(super) corner: [usize; 2],
}

/// Packed charts, without the margin around all of them.
#[derive(Default)]
pub(super) struct Packing {
    /// Side of a pixel, in m.
    pub(super) pixel: f64,
    pub(super) charts: Vec<PackedChart>,
    /// Width and height, in pixels.
    pub(super) size: [usize; 2],
}

impl Packing {
    fn pixels(&self) -> f64 {
        self.size[0] as f64 * self.size[1] as f64
    }
}

/// A count from a number that is not negative.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
fn to_count(x: f64) -> usize {
    (x.ceil() as usize).min(u32::MAX as usize)
}

/// For each link its nearest ancestor that has charts.
fn links_below(map: &SkinMap) -> IdVec<LinkId, Option<LinkId>> {
    let mut carries = map.links.map(|_| false);
    map.patches.iter().for_each(|patch| carries[patch.link] = true);
    let mut below: IdVec<LinkId, Option<LinkId>> = IdVec::default();
    for link in &map.links {
        below.push(link.parent.and_then(|parent| if carries[parent] { Some(parent) } else { below[parent] }));
    }
    below
}

/// The area of the finest level on the map, in m^2.
fn area(patch: &PatchMap) -> f64 {
    let of_level = |level: &MapLevel| {
        let of_face = |face| {
            let [a, b, c] = level.uv_of(face);
            0.5 * (b - a).perp_dot(c - a).abs()
        };
        level.level.mesh.triangles.ids().map(of_face).sum()
    };
    patch.levels.first().map_or(0.0, of_level)
}

/// The box around a patch in the world.
fn box_of(map: &SkinMap, patch: &PatchMap) -> [DVec3; 2] {
    let pose = world_pose(&map.links, patch.link);
    let positions = patch.levels.iter().take(1).flat_map(|level| &level.level.mesh.positions);
    positions
        .map(|p| pose.transform_point3(*p))
        .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
}
