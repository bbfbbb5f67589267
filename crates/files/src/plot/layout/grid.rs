//! The grid of a picture: a row for each patch, a column for each level, all at one scale.

use glam::DVec2;

use crate::plot::PlotError;
use crate::plot::layout::Caption;
use crate::plot::picture::{Anchor, MAX_SIDE, Shape};

/// Least width of a picture, in pixels: the letters still fit.
const MIN_WIDTH: u32 = 200;

/// Least width of a panel, in pixels: at six pixels high, a word of its caption still fits.
const MIN_COLUMN: f64 = 40.0;

/// Largest share of the width for all margins between panels, and the share of one margin if there are few panels.
const MARGINS: f64 = 0.15;
const MARGIN: f64 = 0.015;

/// Width of a panel over the height of its letters: the longest line of most captions fits.
const CAPTION_EMS: f64 = 28.0;

/// Least height of letters, in pixels: smaller ones are not legible.
const MIN_LETTERS: f64 = 6.0;

/// Distance of lines over the height of their letters, which are 1.13 high from top to tail.
const LINE_PITCH: f64 = 1.15;

/// Largest height of the letters over the width of the picture.
const LARGEST_LETTERS: f64 = 0.016;

/// A panel is at most this much higher than the picture is wide: a finger is longer than a screen.
const TALLEST: f64 = 0.8;

/// Position of a panel on the picture, and its scale.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    /// Pixels per metre.
    pub(crate) scale: f64,
    /// Upper left corner of the panel on the picture, in whole pixels.
    pub(crate) corner: DVec2,
    /// The same corner on the plane, in m.
    pub(crate) origin: DVec2,
    /// Width and height of the panel, in whole pixels.
    pub(crate) size: DVec2,
}

impl View {
    /// A point of the plane on the picture, in pixels.
    pub(crate) fn to_pixels(self, at: DVec2) -> DVec2 {
        self.corner + DVec2::new(at.x - self.origin.x, self.origin.y - at.y) * self.scale
    }
}

#[derive(Debug, Clone)]
pub(crate) struct Slot {
    /// Corners of the smallest rectangle around what it shows, in m.
    pub(crate) bounds: (DVec2, DVec2),
    pub(crate) caption: Caption,
}

/// The slots of a patch's panels; `None` where it lacks a level.
type SlotRow<'a> = Vec<Option<&'a Slot>>;

/// Panels row by row; `None` where a patch lacks a level.
type SlotRows<P> = Vec<Vec<Option<P>>>;

/// Height over width of a picture above which rows are placed side by side: two screens.
const TWO_SCREENS: f64 = 2.0 * 9.0 / 16.0;

/// Lays out rows of panels; if they make the picture higher than two screens, several are placed side by
/// side.
pub(crate) fn lay_out<P>(
    mut rows: SlotRows<P>,
    slot: impl Fn(&P) -> &Slot,
    width: u32,
) -> Result<(SlotRows<P>, Layout), PlotError> {
    let fits = |layout: &Layout| f64::from(layout.height) <= TWO_SCREENS * f64::from(width);
    let mut beside = 1;
    for count in 1..=rows.len() {
        match Layout::new(&blocks(&slots(&rows, &slot), count), width) {
            // More columns are narrower still.
            Err(PlotError::Width { .. }) => break,
            Ok(layout) if fits(&layout) => {
                beside = count;
                break;
            }
            _ => beside = count,
        }
    }
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    if beside > 1 {
        rows.iter_mut().for_each(|row| row.resize_with(columns, || None));
        let mut left = rows.into_iter().peekable();
        rows = Vec::new();
        while left.peek().is_some() {
            rows.push(left.by_ref().take(beside).flatten().collect());
        }
    }
    let layout = Layout::new(&slots(&rows, &slot), width)?;
    Ok((rows, layout))
}

pub(crate) fn slots<P>(rows: &[Vec<Option<P>>], slot: impl Fn(&P) -> &Slot) -> Vec<SlotRow<'_>> {
    rows.iter().map(|row| row.iter().map(|panel| panel.as_ref().map(&slot)).collect()).collect()
}

/// Rows with `beside` rows side by side in each.
fn blocks<'a>(rows: &[SlotRow<'a>], beside: usize) -> Vec<SlotRow<'a>> {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let padded = |row: &SlotRow<'a>| {
        let mut row = row.clone();
        row.resize(columns, None);
        row
    };
    rows.chunks(beside).map(|chunk| chunk.iter().flat_map(padded).collect()).collect()
}

/// Positions of all panels: a row per patch, a column per level, one scale.
pub(crate) struct Layout {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) em: f64,
    pub(crate) margin: f64,
    pub(crate) column: f64,
    /// Pixels per metre.
    pub(crate) scale: f64,
    rows: Vec<RowSpan>,
}

/// Position of a row of panels, in pixels.
struct RowSpan {
    /// Upper edge of its maps; the captions are above.
    top: f64,
    /// Height of its maps.
    height: f64,
    /// Lines of its longest caption.
    lines: usize,
}

impl Layout {
    pub(crate) fn new(rows: &[SlotRow<'_>], width: u32) -> Result<Self, PlotError> {
        let panels = rows.iter().map(Vec::len).max().unwrap_or(0).max(1);
        let columns = panels as f64;
        #[expect(clippy::cast_possible_truncation, reason = "`as` saturates")]
        let least = (columns * MIN_COLUMN / (1.0 - MARGINS)).ceil() as u32;
        let least = least.max(MIN_WIDTH);
        if !(least..=MAX_SIDE).contains(&width) {
            return Err(PlotError::Width { width, panels, least, most: MAX_SIDE });
        }
        let total = f64::from(width);
        let margin = (total * MARGIN.min(MARGINS / (columns + 1.0))).floor();
        let column = (total - margin * (columns + 1.0)) / columns;
        let em = (column / CAPTION_EMS).min(LARGEST_LETTERS * total).round().max(MIN_LETTERS);
        let extents: Vec<DVec2> = rows.iter().map(row_extent).collect();
        let fit = |e: &DVec2| (column / e.x).min(TALLEST * total / e.y);
        let scale = extents.iter().map(fit).fold(f64::INFINITY, f64::min);
        let mut y = margin;
        let mut spans = Vec::new();
        let room = caption_room(column, margin, em);
        for (row, extent) in rows.iter().zip(&extents) {
            let lines = row.iter().flatten().map(|slot| slot.caption.lines(room).len()).max().unwrap_or(0);
            y += (0.75 * em).round() + pitch(em) * lines as f64;
            let height = (extent.y * scale).ceil();
            spans.push(RowSpan { top: y, height, lines });
            y += height + margin;
        }
        let height = y + (2.6 * em).round() + margin;
        #[expect(clippy::cast_possible_truncation, reason = "`as` saturates")]
        let height = height.ceil() as u32;
        if height > MAX_SIDE {
            return Err(PlotError::Size { width, height, least: MIN_WIDTH, most: MAX_SIDE });
        }
        Ok(Self { width, height, em, margin, column, scale, rows: spans })
    }

    /// The existing panels, row by row, each at the centre of its slot.
    pub(crate) fn views(&self, rows: &[SlotRow<'_>]) -> Vec<View> {
        let mut views = Vec::new();
        for (row, &RowSpan { top, height, .. }) in rows.iter().zip(&self.rows) {
            for (column, slot) in row.iter().enumerate() {
                let Some((lo, hi)) = slot.map(|slot| slot.bounds) else { continue };
                let size = ((hi - lo) * self.scale).ceil().max(DVec2::ONE);
                let left = self.margin + column as f64 * (self.column + self.margin);
                let middle = DVec2::new(left + 0.5 * (self.column - size.x), top + 0.5 * (height - size.y));
                let (corner, origin) = (middle.round(), DVec2::new(lo.x, hi.y));
                views.push(View { scale: self.scale, corner, origin, size });
            }
        }
        views
    }

    pub(crate) fn caption(&self, caption: &Caption, view: &View) -> Vec<Shape> {
        let x = view.corner.x + 0.5 * view.size.x;
        let row = self.rows.iter().rev().find(|row| row.top <= view.corner.y + 1.0);
        let (top, lines) = row.map_or((self.margin, 1), |row| (row.top, row.lines));
        let base = top - (0.8 * self.em).round() - pitch(self.em) * lines as f64;
        let texts = caption.lines(caption_room(self.column, self.margin, self.em)).into_iter().enumerate();
        let line = |(k, text): (usize, String)| {
            let at = DVec2::new(x, base + pitch(self.em) * (k + 1) as f64);
            // The first line is the name.
            Shape::Text { text, at, anchor: Anchor::Middle, is_bold: k == 0 }
        };
        texts.map(line).collect()
    }

    /// Vertical centre of the last line of the picture, with the scale bar and the legend.
    pub(crate) fn foot(&self) -> f64 {
        (f64::from(self.height) - self.margin - 1.3 * self.em).round()
    }
}

/// From one line of a caption to the next, in whole pixels.
fn pitch(em: f64) -> f64 {
    (LINE_PITCH * em).ceil()
}

/// Largest width of a caption over the height of its letters: half the space between panels stays free.
fn caption_room(column: f64, margin: f64, em: f64) -> f64 {
    (column + 0.5 * margin) / em
}

/// Width and height that fit each panel of a row, in m.
fn row_extent(row: &SlotRow<'_>) -> DVec2 {
    let extent = |slot: &&Slot| slot.bounds.1 - slot.bounds.0;
    let extent = row.iter().flatten().map(extent).fold(DVec2::ZERO, DVec2::max);
    // Points and lines also need an extent on the picture.
    let least = if extent == DVec2::ZERO { 1e-6 } else { 1e-6 * extent.max_element() };
    extent.max(DVec2::splat(least))
}
