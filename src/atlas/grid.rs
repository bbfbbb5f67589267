//! The free cells of an image, as bits: the positions at which a chart covers no cell of another one.

use glam::DVec2;

use crate::atlas::turn::{Extent, stand_in, turned};
use crate::map::{ImageFrame, PatchMap};

/// Distance from a pixel's centre within which a triangle may be rounded onto it, in pixels.
const ROUNDING: f64 = 1e-3;

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
}

impl Mask {
    /// The mask of all levels of a map; a pixel has the side `pixel` (m), a cell `cell` pixels. A cell is
    /// covered if a triangle meets the rectangle around the centres of its pixels, or if it has the pixel that
    /// stands for a level that may cover none. `None` if it is
    /// larger than `most` cells: a long thin map can be larger than memory.
    pub(super) fn new(
        patch: &PatchMap,
        turns: u8,
        pixel: f64,
        cell: usize,
        most: [usize; 2],
    ) -> Option<Self> {
        let Extent { lo, hi } = Extent::of(patch, turns);
        let frame = ImageFrame::around_box(lo, hi, pixel, 0);
        let size = frame.size_px.map(|n| (n as usize).div_ceil(cell));
        if size[0] > most[0] || size[1] > most[1] {
            return None;
        }
        let words = size[0].div_ceil(64);
        let mut bits = vec![0_u64; words * size[1]];
        let range = |[low, high]: [f64; 2], count: usize| {
            let cell = cell as f64;
            let first = ((low - ROUNDING + 0.5) / cell - 1.0).ceil();
            let last = ((high + ROUNDING - 0.5) / cell).floor();
            to_index(first).min(count)..to_index(last + 1.0).min(count)
        };
        let mut shows = true;
        for level in &patch.levels {
            let (mut shows_level, mut area) = (false, 0.0);
            for face in level.level.mesh.triangles.ids() {
                let corners = level.uv_of(face).map(|uv| (turned(uv, turns) - frame.origin) / pixel);
                let [a, b, c] = corners;
                area += 0.5 * (b - a).perp_dot(c - a).abs();
                for row in range(span(&corners.map(|p| p.y)), size[1]) {
                    let band = [0.5, cell as f64 - 0.5].map(|y| (row * cell) as f64 + y);
                    let columns = within(&corners, [band[0] - ROUNDING, band[1] + ROUNDING]);
                    for column in range(columns, size[0]) {
                        bits[row * words + column / 64] |= 1 << (column % 64);
                        shows_level = true;
                    }
                }
            }
            shows &= shows_level;
            if area < MAY_COVER_NONE
                && let Some((_, at)) = stand_in(level, turns, &frame)
            {
                let [column, row] = at.map(|n| n as usize / cell);
                bits[row * words + column / 64] |= 1 << (column % 64);
            }
        }
        let mut rows: Vec<Vec<[usize; 2]>> = bits.chunks(words).map(|row| runs(row, size[0])).collect();
        if rows.iter().all(Vec::is_empty) {
            rows[0] = vec![[0, 1]];
        }
        Some(Self { turns, frame, size, shows, rows })
    }
}

/// An index from a number; 0 if it is negative.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
fn to_index(x: f64) -> usize {
    x as usize
}

/// The smallest and the largest value.
fn span(values: &[f64]) -> [f64; 2] {
    values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &x| [low.min(x), high.max(x)])
}

/// The range of x of a triangle between two values of y; empty (from infinity to minus infinity) if there is none.
fn within(corners: &[DVec2; 3], band: [f64; 2]) -> [f64; 2] {
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
            self.block(mask, y);
            let free = (0..columns).filter(|x| self.blocked[x / 64] >> (x % 64) & 1 == 0);
            let found = free.map(|x| (cost(x, y), [x, y])).min_by(|a, b| a.0.total_cmp(&b.0));
            best = found.filter(|found| found.0 < to_beat).or(best);
        }
        best
    }

    /// Marks the columns in which a mask would cover taken cells if its lowest row were `y`.
    fn block(&mut self, mask: &Mask, y: usize) {
        let Self { words, rows, blocked, .. } = self;
        blocked.fill(0);
        for (row, runs) in rows[y.min(rows.len())..].iter().zip(&mask.rows) {
            for &[start, end] in runs {
                let power = (end - start).ilog2() as usize;
                let any = &row[power * *words..][..*words];
                add_shifted(blocked, any, start);
                add_shifted(blocked, any, end - (1 << power));
            }
        }
    }

    /// Takes the cells of a mask at a position, and those within `gap` of them.
    pub(super) fn take(&mut self, mask: &Mask, [x, y]: [usize; 2], gap: usize) {
        let powers = self.width.max(1).ilog2() as usize + 1;
        let top = y + mask.size[1] + gap;
        if self.rows.len() < top {
            self.rows.resize_with(top, || vec![0; powers * self.words]);
        }
        for (row, runs) in (y..).zip(&mask.rows) {
            for around in row.saturating_sub(gap)..=row + gap {
                for &[start, end] in runs {
                    for cell in (x + start).saturating_sub(gap)..(x + end + gap).min(self.width) {
                        self.rows[around][cell / 64] |= 1 << (cell % 64);
                    }
                }
            }
        }
        for row in &mut self.rows[y.saturating_sub(gap)..top] {
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
