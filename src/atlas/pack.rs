//! Where packed charts lie: one after the other, proximal links first, comes to rest on those that lie already, where
//! that is low and near the chart next to it on the body.
//!
//! Charts rest on each other by their outlines (horizons; levy2002), above the middle of the charts of the link that
//! theirs hangs from: distal links are above proximal ones. *Heuristic*: with rectangles on a shelf for each depth
//! of the tree, the charts of three humanoids (iCub, G1, Alex; 103 to 470 patches) filled 12 to 20 % of the image
//! instead of 40 to 48 %, and linked ones were one and a half to four times as far from each other.

use glam::{DVec2, DVec3};

use crate::atlas::turn::{Extent, distal_turns, turned};
use crate::id::IdVec;
use crate::map::{ImageFrame, PatchMap, SkinMap};
use crate::numeric::order_by;
use crate::pyramid::LevelId;
use crate::skin::{LinkId, PatchId, world_pose};

/// Pixels between two charts that show nothing.
const GAP: u64 = 2;

/// Slices of a chart's outline.
const SLICES: usize = 128;

/// Columns of the image in which charts come to rest, at most.
const COLUMNS: u64 = 512;

/// How much lower a chart may lie for being a pixel nearer, in pixels: 0.1 to 0.3 fill about as much, with 0
/// neighbours are twice as far from each other.
const NEARNESS: f64 = 0.2;

/// Distance of centres over distance of boxes, where that says how near patches are: boxes in each other have none.
const CENTRES: f64 = 0.1;

/// A chart to be packed.
pub(super) struct Item {
    pub(super) patch: PatchId,
    pub(super) turns: u8,
    /// All levels of the turned map.
    pub(super) extent: Extent,
    /// Lowest and highest place in each slice of it from the left, in m from its lower edge.
    slices: Vec<[f64; 2]>,
    link: LinkId,
    /// The nearest link with charts that its own hangs from.
    below: Option<LinkId>,
    /// An earlier chart that it should be near.
    near: Option<usize>,
}

impl Item {
    fn new(patch: PatchId, map: &PatchMap, turns: u8, below: Option<LinkId>) -> Self {
        let extent = Extent::of(map, turns);
        let mut slices = vec![[f64::INFINITY, f64::NEG_INFINITY]; SLICES];
        let width = extent.size().x / SLICES as f64;
        for level in &map.levels {
            for face in level.level.mesh.triangles.ids() {
                let corners = level.uv_of(face).map(|uv| turned(uv, turns) - extent.lo);
                let [a, b, c] = corners;
                for (p, q) in [(a, b), (b, c), (c, a)] {
                    add_edge(&mut slices, width, p, q);
                }
            }
        }
        Self { patch, turns, extent, slices, link: map.link, below, near: None }
    }

    /// Width and height in pixels, without margins.
    pub(super) fn size_px(&self, pixel: f64) -> [u64; 2] {
        ImageFrame::around_box(self.extent.lo, self.extent.hi, pixel, 0).size_px.map(u64::from)
    }

    /// In m^2, the outline filled.
    fn area(&self) -> f64 {
        let width = self.extent.size().x / SLICES as f64;
        self.slices.iter().map(|[low, high]| (high - low).max(0.0) * width).sum()
    }

    /// Lowest row and the first free one above in columns of some pixels from the left; charts are [`GAP`] apart
    /// if none is lower than the free row of one before.
    fn rows(&self, pixel: f64, column: u64) -> Vec<[u64; 2]> {
        let size = self.size_px(pixel);
        let mut rows = vec![[u64::MAX, 0]; index((size[0] + GAP) / column) + 1];
        let width = self.extent.size().x / SLICES as f64 / pixel;
        // The extent lies in the middle of the chart's pixels.
        let [left, bottom] = [0, 1].map(|k| 0.5 * (size[k] as f64 - self.extent.size()[k] / pixel).max(0.0));
        for (k, [low, high]) in self.slices.iter().enumerate().filter(|(_, [low, high])| low <= high) {
            let at = |k: usize| to_count(left + k as f64 * width);
            let last = ((at(k + 1) + GAP) / column).min(rows.len() as u64 - 1);
            for row in &mut rows[index((at(k) / column).min(last))..=index(last)] {
                row[0] = row[0].min(to_count(bottom + low / pixel));
                row[1] = row[1].max(to_count((bottom + high / pixel).ceil()) + GAP);
            }
        }
        rows
    }
}

/// A count of pixels from a number that is not negative.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "`as` saturates; images that large are refused"
)]
fn to_count(x: f64) -> u64 {
    (x as u64).min(u64::from(u32::MAX))
}

/// The place of a column; there are far fewer than can be counted.
fn index(column: u64) -> usize {
    usize::try_from(column).unwrap_or(usize::MAX)
}

/// Lets the slices that an edge crosses hold it.
fn add_edge(slices: &mut [[f64; 2]], width: f64, p: DVec2, q: DVec2) {
    let (p, q) = if p.x <= q.x { (p, q) } else { (q, p) };
    let place = |x: f64| index(to_count(x / width)).min(SLICES - 1);
    let at =
        |x: f64| if q.x > p.x { p.y + (q.y - p.y) * ((x - p.x) / (q.x - p.x)).clamp(0.0, 1.0) } else { q.y };
    for (k, slice) in slices.iter_mut().enumerate().take(place(q.x) + 1).skip(place(p.x)) {
        // A vertical edge is in one slice.
        let [left, right] = [k, k + 1].map(|k| at(width * k as f64));
        let ends = if p.x == q.x { [p.y, q.y] } else { [left, right] };
        *slice = [slice[0].min(ends[0].min(ends[1])), slice[1].max(ends[0].max(ends[1]))];
    }
}

/// The charts of a map in the order in which they are packed: those that hang from none first, taller ones first.
pub(super) fn items(map: &SkinMap) -> Vec<Item> {
    let mut carries = map.links.map(|_| false);
    map.patches.iter().for_each(|patch| carries[patch.link] = true);
    let mut below: IdVec<LinkId, Option<LinkId>> = IdVec::default();
    let mut depths: IdVec<LinkId, usize> = IdVec::default();
    for link in &map.links {
        let own = link.parent.and_then(|parent| if carries[parent] { Some(parent) } else { below[parent] });
        depths.push(own.map_or(0, |own| depths[own] + 1));
        below.push(own);
    }
    let turns = distal_turns(map);
    let all: Vec<Item> = map
        .patches
        .enumerate()
        .map(|(id, patch)| Item::new(id, patch, turns[id], below[patch.link]))
        .collect();
    let order = order_by(all.len(), &|a, b| {
        let height = |k: usize| all[k].extent.size().y;
        depths[all[a].link].cmp(&depths[all[b].link]).then(height(b).total_cmp(&height(a)))
    });
    let mut all: Vec<Option<Item>> = all.into_iter().map(Some).collect();
    let mut items: Vec<Item> = order.into_iter().filter_map(|k| all[k].take()).collect();
    let boxes: Vec<[DVec3; 2]> = items.iter().map(|item| box_of(map, &map.patches[item.patch])).collect();
    for k in 1..items.len() {
        let away = |j: usize| {
            let ([low, high], [other_low, other_high]) = (boxes[k], boxes[j]);
            let gap = (low - other_high).max(other_low - high).max(DVec3::ZERO).length();
            gap + CENTRES * (low + high).distance(other_low + other_high)
        };
        items[k].near = (0..k).min_by(|&a, &b| away(a).total_cmp(&away(b)));
    }
    items
}

/// The box around a patch in the world.
fn box_of(map: &SkinMap, patch: &PatchMap) -> [DVec3; 2] {
    let pose = world_pose(&map.links, patch.link);
    let positions = patch.levels[LevelId::new(0)].level.mesh.positions.iter();
    positions
        .map(|p| pose.transform_point3(*p))
        .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
}

/// Charts side by side, without the margin around them all.
pub(super) struct Packing {
    /// Left and lower edge of each chart, in pixels.
    pub(super) corners: Vec<[u64; 2]>,
    /// Width and height, in pixels.
    pub(super) size: [u64; 2],
}

impl Packing {
    /// The charts on a width in pixels; wider ones make it wider.
    pub(super) fn new(items: &[Item], pixel: f64, width: u64) -> Self {
        let column = width.div_ceil(COLUMNS).max(1);
        // The first free row in each column, and the highest middle of a chart of each link.
        let mut horizon: Vec<u64> = Vec::new();
        let mut middles: Vec<u64> = Vec::new();
        let mut this = Self { corners: Vec::with_capacity(items.len()), size: [0, 0] };
        let mut centres: Vec<f64> = Vec::with_capacity(items.len());
        for item in items {
            let [w, h] = item.size_px(pixel);
            let rows = item.rows(pixel, column);
            let starts = width.saturating_sub(w) / column + 1;
            horizon.resize(horizon.len().max(index(starts) + rows.len()), 0);
            let floor = item.below.and_then(|link| middles.get(link.index())).copied().unwrap_or(0);
            let rest = |start: u64| {
                let under = horizon[index(start)..].iter().zip(&rows);
                under.map(|(top, [low, _])| top.saturating_sub(*low)).fold(floor, u64::max)
            };
            let centre = |start: u64| (start * column) as f64 + 0.5 * w as f64;
            let cost = |start: u64| {
                let away = item.near.map_or(0.0, |near| (centre(start) - centres[near]).abs());
                rest(start) as f64 + NEARNESS * away
            };
            let start = (0..starts).map(|start| (cost(start), start)).min_by(|a, b| a.0.total_cmp(&b.0));
            let start = start.map_or(0, |(_, start)| start);
            let bottom = rest(start);
            for (top, [low, high]) in horizon[index(start)..].iter_mut().zip(&rows) {
                if low <= high {
                    *top = (*top).max(bottom + high);
                }
            }
            middles.resize(middles.len().max(item.link.index() + 1), 0);
            middles[item.link.index()] = middles[item.link.index()].max(bottom + h.div_ceil(2));
            centres.push(centre(start));
            this.corners.push([start * column, bottom]);
            this.size = [this.size[0].max(start * column + w), this.size[1].max(bottom + h)];
        }
        this
    }

    /// The smallest image of some widths about that of a square.
    pub(super) fn smallest(items: &[Item], pixel: f64) -> Self {
        let area: f64 = items.iter().map(Item::area).sum();
        let widest = items.iter().map(|item| item.size_px(pixel)[0]).max().unwrap_or(0);
        let packings = WIDTHS
            .map(|times| Self::new(items, pixel, widest.max(to_count((times * area.sqrt() / pixel).ceil()))));
        let pixels = |packing: &Self| packing.size[0].saturating_mul(packing.size[1]);
        let [first, others @ ..] = packings;
        others
            .into_iter()
            .fold(first, |best, other| if pixels(&other) < pixels(&best) { other } else { best })
    }
}

/// Widths that are tried over the side of a square that the charts would fill.
const WIDTHS: [f64; 6] = [0.9, 1.0, 1.1, 1.2, 1.35, 1.5];
