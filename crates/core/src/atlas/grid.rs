//! The free cells of an image, as bits: the positions at which a chart covers no cell of another one.

use glam::DVec2;

use crate::atlas::turn::{Extent, stand_in, turned};
use crate::map::{ImageFrame, PatchMap};

/// Distance from a pixel's centre within which a triangle may be rounded onto it, in pixels.
const PIXEL_ROUNDING: f64 = 1e-3;

/// A chart with a smaller area, in pixels, may cover the centre of none: a line a hundredth of a pixel wide across the
/// largest image has 164.
const MAY_COVER_NONE: f64 = 200.0;

/// The cells that a turned chart covers.
pub(super) struct Mask {
    pub(super) turns: u8,
    /// The frame of the turned map.
    pub(super) frame: ImageFrame,
    /// Width and height in cells.
    pub(super) size: [usize; 2],
    /// Whether every level covers a cell.
    pub(super) shows: bool,
    /// Runs of covered cells of each row, from the bottom: the first cell, and the one after the last.
    rows: Vec<Vec<[usize; 2]>>,
    /// The same of the cells with a pixel within the gap around covered ones; they begin `margin` cells lower and
    /// farther left.
    taken: Vec<Vec<[usize; 2]>>,
    margin: usize,
}

/// Cells of a mask, as bits.
struct Bits {
    size: [usize; 2],
    words: usize,
    bits: Vec<u64>,
}

impl Bits {
    fn new(size: [usize; 2]) -> Self {
        let words = size[0].div_ceil(64);
        Self { size, words, bits: vec![0; words * size[1]] }
    }

    fn set(&mut self, column: usize, row: usize) {
        self.bits[row * self.words + column / 64] |= 1 << (column % 64);
    }

    fn runs(&self) -> Vec<Vec<[usize; 2]>> {
        self.bits.chunks(self.words).map(|row| runs(row, self.size[0])).collect()
    }

    /// Sets the cells of `cell` pixels, from `margin` cells before the first on, that have the centre of a pixel within
    /// a triangle, or nearer to it than `gap` pixels along either axis; returns whether there is one.
    fn add(&mut self, corners: &[DVec2; 3], cell: usize, [margin, gap]: [usize; 2]) -> bool {
        let (side, gap) = (cell as f64, PIXEL_ROUNDING + gap as f64);
        let range = |[low, high]: [f64; 2], count: usize| {
            let first = (low - gap + 0.5) / side - 1.0 + margin as f64;
            let last = (high + gap - 0.5) / side + margin as f64;
            ceil_to_index(first).min(count)..to_index(last + 1.0).min(count)
        };
        let mut shows = false;
        for row in range(span(&corners.map(|p| p.y)), self.size[1]) {
            let lowest = (row * cell) as f64 - (margin * cell) as f64;
            let columns = within(corners, [lowest + 0.5 - gap, lowest + side - 0.5 + gap]);
            for column in range(columns, self.size[0]) {
                self.set(column, row);
                shows = true;
            }
        }
        shows
    }
}

impl Mask {
    /// The mask of all levels of a map; a pixel has the side `pixel` (m), a cell `cell` pixels, and `gap` pixels around
    /// it show no other chart. A cell is
    /// covered if a triangle meets the rectangle around the centres of its pixels, or if it has the pixel that
    /// stands for a level that may cover none. `None` if it is
    /// larger than `most` cells: a long thin map can be larger than memory.
    pub(super) fn new(
        patch: &PatchMap,
        turns: u8,
        pixel: f64,
        [cell, gap]: [usize; 2],
        most: [usize; 2],
    ) -> Option<Self> {
        let Extent { lo, hi } = Extent::of(patch, turns);
        let frame = ImageFrame::around_box(lo, hi, pixel, 0);
        let size = frame.size_px.map(|n| (n as usize).div_ceil(cell));
        if size[0] > most[0] || size[1] > most[1] {
            return None;
        }
        // In cells of several pixels a margin of whole cells would be too wide.
        let (margin, is_fine) = (gap.div_ceil(cell), cell == 1);
        let (mut covered, mut taken) = (Bits::new(size), Bits::new(size.map(|n| n + 2 * margin)));
        let mut shows = true;
        for level in &patch.levels {
            let (mut shows_level, mut area) = (false, 0.0);
            for face in level.level.mesh.triangles.ids() {
                let corners = level.uv_of(face).map(|uv| (turned(uv, turns) - frame.origin) / pixel);
                let [a, b, c] = corners;
                area += 0.5 * (b - a).perp_dot(c - a).abs();
                shows_level |= covered.add(&corners, cell, [0, 0]);
                if !is_fine {
                    taken.add(&corners, cell, [margin, gap]);
                }
            }
            shows &= shows_level;
            if area < MAY_COVER_NONE
                && let Some((_, at)) = stand_in(level, turns, &frame)
            {
                let at = at.map(|n| n as usize);
                covered.set(at[0] / cell, at[1] / cell);
                let centre = DVec2::new(at[0] as f64 + 0.5, at[1] as f64 + 0.5);
                taken.add(&[centre; 3], cell, [margin, gap]);
            }
        }
        let mut rows = covered.runs();
        let is_empty = rows.iter().all(Vec::is_empty);
        if is_empty {
            rows[0] = vec![[0, 1]];
        }
        let taken = if is_fine || is_empty { grown(&rows, margin) } else { taken.runs() };
        Some(Self { turns, frame, size, shows, rows, taken, margin })
    }
}

/// The runs with all cells within `margin` of theirs, which begin as much lower and farther left.
fn grown(rows: &[Vec<[usize; 2]>], margin: usize) -> Vec<Vec<[usize; 2]>> {
    let mut taken = vec![Vec::new(); rows.len() + 2 * margin];
    for (row, runs) in rows.iter().enumerate() {
        for around in &mut taken[row..=row + 2 * margin] {
            around.extend(runs.iter().map(|&[start, end]| [start, end + 2 * margin]));
        }
    }
    taken
}

/// An index from a number; 0 if it is negative.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
fn to_index(x: f64) -> usize {
    x as usize
}

/// The least index that is not below a number.
fn ceil_to_index(x: f64) -> usize {
    let index = to_index(x);
    if index as f64 >= x { index } else { index.saturating_add(1) }
}

/// The smallest and the largest value.
fn span(values: &[f64]) -> [f64; 2] {
    values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &x| [low.min(x), high.max(x)])
}

/// The range of x of a triangle between two values of y; empty (from infinity to minus infinity) if there is none.
fn within(corners: &[DVec2; 3], band: [f64; 2]) -> [f64; 2] {
    if corners.iter().all(|p| (band[0]..=band[1]).contains(&p.y)) {
        return span(&corners.map(|p| p.x));
    }
    let mut found = [f64::INFINITY, f64::NEG_INFINITY];
    let mut add = |x: f64| found = [found[0].min(x), found[1].max(x)];
    for (p, q) in [(corners[0], corners[1]), (corners[1], corners[2]), (corners[2], corners[0])] {
        if (band[0]..=band[1]).contains(&p.y) {
            add(p.x);
        }
        for y in band {
            if (p.y < y) != (q.y < y) {
                add(p.x + (q.x - p.x) * (y - p.y) / (q.y - p.y));
            }
        }
    }
    found
}

/// The runs of set bits among the first `count`.
fn runs(row: &[u64], count: usize) -> Vec<[usize; 2]> {
    let is_set = |k: usize| row[k / 64] >> (k % 64) & 1 == 1;
    let mut runs: Vec<[usize; 2]> = Vec::new();
    for k in (0..count).filter(|&k| is_set(k)) {
        match runs.last_mut() {
            Some([_, end]) if *end == k => *end += 1,
            _ => runs.push([k, k + 1]),
        }
    }
    runs
}

/// The taken cells of an image of fixed width; it grows upwards with the charts.
pub(super) struct Grid {
    width: usize,
    words: usize,
    /// For each row from the bottom and each power of two: bit x is set if one of that many cells from x on is taken.
    rows: Vec<Vec<u64>>,
    /// For one row: the cells in which the lower left corner of a chart cannot be.
    blocked: Vec<u64>,
}

impl Grid {
    pub(super) fn new(width: usize) -> Self {
        let words = width.div_ceil(64).max(1);
        Self { width, words, rows: Vec::new(), blocked: vec![0; words] }
    }

    /// The cell of least cost for the lower left corner of a mask, from row `floor` on and below `height`, if
    /// it costs less than `below`. `cost` of column and row grows with the row, and is at least `least` of
    /// the row.
    pub(super) fn place(
        &mut self,
        mask: &Mask,
        [floor, height]: [usize; 2],
        below: f64,
        least: impl Fn(usize) -> f64,
        cost: impl Fn(usize, usize) -> f64,
    ) -> Option<(f64, [usize; 2])> {
        let columns = (self.width + 1).checked_sub(mask.size[0])?;
        let last = (height.checked_sub(mask.size[1])?).min(self.rows.len().max(floor));
        let mut best: Option<(f64, [usize; 2])> = None;
        for y in floor..=last {
            let to_beat = best.map_or(below, |(cost, _)| cost);
            if least(y) >= to_beat {
                break;
            }
            self.block(mask, y, columns);
            let free = (0..columns).filter(|x| self.blocked[x / 64] >> (x % 64) & 1 == 0);
            let found = free.map(|x| (cost(x, y), [x, y])).min_by(|a, b| a.0.total_cmp(&b.0));
            best = found.filter(|found| found.0 < to_beat).or(best);
        }
        best
    }

    /// Marks the columns, of the first ones, in which a mask would cover taken cells if its lowest row were `y`.
    fn block(&mut self, mask: &Mask, y: usize, columns: usize) {
        let Self { words, rows, blocked, .. } = self;
        blocked.fill(0);
        let (full, rest) = (columns / 64, columns % 64);
        let all_blocked = |blocked: &[u64]| {
            blocked[..full].iter().all(|&bits| bits == u64::MAX)
                && (rest == 0 || blocked[full].trailing_ones() as usize >= rest)
        };
        for (row, runs) in rows[y.min(rows.len())..].iter().zip(&mask.rows) {
            // In the lower rows few charts find a place.
            if all_blocked(blocked) {
                return;
            }
            for &[start, end] in runs {
                let power = (end - start).ilog2() as usize;
                let any = &row[power * *words..][..*words];
                add_shifted(blocked, any, start);
                add_shifted(blocked, any, end - (1 << power));
            }
        }
    }

    /// Takes the cells of a mask at a position, with the gap around it.
    pub(super) fn take(&mut self, mask: &Mask, [x, y]: [usize; 2]) {
        let powers = self.width.max(1).ilog2() as usize + 1;
        let (margin, top) = (mask.margin, y + mask.size[1] + mask.margin);
        if self.rows.len() < top {
            self.rows.resize_with(top, || vec![0; powers * self.words]);
        }
        for (row, runs) in (y..).zip(&mask.taken).filter(|(row, _)| *row >= margin) {
            for &[start, end] in runs {
                for cell in
                    (x + start).saturating_sub(margin)..(x + end).saturating_sub(margin).min(self.width)
                {
                    self.rows[row - margin][cell / 64] |= 1 << (cell % 64);
                }
            }
        }
        for row in &mut self.rows[y.saturating_sub(margin)..top] {
            for power in 1..powers {
                let (shorter, longer) = row.split_at_mut(power * self.words);
                let shorter = &shorter[(power - 1) * self.words..];
                longer[..self.words].copy_from_slice(shorter);
                add_shifted(&mut longer[..self.words], shorter, 1 << (power - 1));
            }
        }
    }
}

/// Sets bit x where bit x + `by` is set.
fn add_shifted(bits: &mut [u64], from: &[u64], by: usize) {
    let (skipped, shift) = (by / 64, by % 64);
    for (k, bits) in bits.iter_mut().enumerate() {
        let word = |k: usize| from.get(k).copied().unwrap_or(0);
        let low = word(k + skipped) >> shift;
        *bits |= if shift == 0 { low } else { low | word(k + skipped + 1) << (64 - shift) };
    }
}
