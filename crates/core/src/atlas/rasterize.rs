//! The rasteriser: triangles of snapped corners to runs of pixels, with exact integer edge functions, so that
//! no pixel is missed or covered twice along an edge. Bands of rows are filled in parallel; the result does
//! not depend on the number of threads.

use std::ops::Range;

use rayon::prelude::*;

use crate::cut::PlaceId;
use crate::id::{FaceId, IdVec};
use crate::numeric::Csr;

/// Largest width or height of an image, in pixels: the limit of viewers, graphics cards and the exact
/// arithmetic.
pub(super) const MAX_SIDE: u32 = 16_384;

/// A pixel that no face covers.
const UNCOVERED: u32 = u32::MAX;

/// Fractional bits of a snapped coordinate: 15 nm at 1 mm per pixel.
///
/// Edge functions of coordinates below `2^14` pixels then stay below `2^62`: they are exact in an
/// `i64`, so no pixel is missed at a shared edge or a vertex, however thin the triangles are.
pub(super) const SUBPIXEL_BITS: u32 = 16;

/// One pixel in snapped units.
pub(super) const PIXEL: i64 = 1 << SUBPIXEL_BITS;

/// Rows that one task fills. Triangles are a few pixels tall, so few of them lie in two bands, and
/// a small image still has several bands.
const BAND_ROWS: usize = 32;

/// A point in units of `1 / PIXEL` pixels: right, and down from the upper edge.
pub(super) type Snapped = [i64; 2];

/// Neighbouring pixels of one row that show one face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Span {
    pub(crate) face: FaceId,
    /// Column of the first pixel.
    pub(crate) column: u16,
    pub(crate) length: u16,
}

/// The spans of an image, row by row from the top, each row from the left.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Spans {
    rows: Csr<Span>,
    /// How often a pixel centre was in a further face.
    pub(super) overlaps: usize,
}

impl Spans {
    /// One pixel that shows a face, in an image of this height; `column` and `row` count from the upper left.
    pub(super) fn of_pixel(face: FaceId, [column, row]: [u32; 2], height: u32) -> Self {
        let span = Span { face, column: u16::try_from(column).unwrap_or(u16::MAX), length: 1 };
        let mut rows = Csr::default();
        (0..height).for_each(|r| rows.push((r == row).then_some(span)));
        Self { rows, overlaps: 0 }
    }

    /// The pixels for which `is_free(row, column)`, called in their order.
    pub(super) fn where_free(&self, mut is_free: impl FnMut(usize, usize) -> bool) -> Self {
        let mut rows = Csr::with_capacity(self.rows.len(), self.rows.items().len());
        for (row, spans) in self.rows.iter().enumerate() {
            let mut kept: Vec<Span> = Vec::with_capacity(spans.len());
            for span in spans {
                for column in span.column..span.column + span.length {
                    if !is_free(row, usize::from(column)) {
                        continue;
                    }
                    match kept.last_mut() {
                        Some(last) if last.face == span.face && last.column + last.length == column => {
                            last.length += 1;
                        }
                        _ => kept.push(Span { face: span.face, column, length: 1 }),
                    }
                }
            }
            rows.push(kept);
        }
        Self { rows, overlaps: self.overlaps }
    }

    /// The spans of a row; none if it lies outside of the image.
    pub(super) fn row(&self, row: u32) -> &[Span] {
        let row = row as usize;
        if row < self.rows.len() { &self.rows[row] } else { &[] }
    }

    /// Number of pixels that show a face.
    pub(super) fn pixels(&self) -> usize {
        self.rows.items().iter().map(|span| usize::from(span.length)).sum()
    }
}

/// The face that each pixel centre lies in; sides are at most [`MAX_SIDE`].
///
/// A centre on a shared edge belongs to the face in which it would be if it were moved infinitesimally right
/// and down. Where faces overlap the smallest id wins.
pub(super) fn rasterize(
    points: &IdVec<PlaceId, Snapped>,
    triangles: &IdVec<FaceId, [PlaceId; 3]>,
    [width, height]: [usize; 2],
) -> Spans {
    let bands = bands(points, triangles, height);
    let parts: Vec<Spans> = (0..bands.len())
        .into_par_iter()
        .map(|band| {
            let rows = band * BAND_ROWS..height.min((band + 1) * BAND_ROWS);
            let mut pixels = vec![UNCOVERED; rows.len() * width];
            let fill = |&face: &FaceId| {
                let triangle = Triangle::new(triangles[face].map(|v| points[v]));
                triangle.map_or(0, |t| t.fill(face, &mut pixels, rows.clone(), width))
            };
            let overlaps = bands[band].iter().map(fill).sum();
            Spans { rows: runs(&pixels, width), overlaps }
        })
        .collect();
    let count = parts.iter().map(|part| part.rows.items().len()).sum();
    let mut spans = Spans { rows: Csr::with_capacity(height, count), overlaps: 0 };
    for part in parts {
        spans.rows.append(part.rows);
        spans.overlaps += part.overlaps;
    }
    spans
}

/// The spans of whole rows of pixels.
fn runs(pixels: &[u32], width: usize) -> Csr<Span> {
    let mut rows = Csr::default();
    for row in pixels.chunks(width) {
        let mut end = 0_u16;
        rows.push(row.chunk_by(|a, b| a == b).filter_map(|run| {
            let (column, length) = (end, u16::try_from(run.len()).unwrap_or(u16::MAX));
            end = end.saturating_add(length);
            (run[0] != UNCOVERED).then(|| Span { face: run[0].into(), column, length })
        }));
    }
    rows
}

/// The faces that may touch each band of rows, in the order of their ids. Work and memory grow with the
/// faces and the bands each one touches.
fn bands(
    points: &IdVec<PlaceId, Snapped>,
    triangles: &IdVec<FaceId, [PlaceId; 3]>,
    height: usize,
) -> Csr<FaceId> {
    let touched = |corners: &[PlaceId; 3]| {
        let rows = rows_of(corners.map(|v| points[v][1]), 0..height);
        if rows.is_empty() { 0..0 } else { rows.start / BAND_ROWS..(rows.end - 1) / BAND_ROWS + 1 }
    };
    let pairs =
        triangles.enumerate().flat_map(|(face, corners)| touched(corners).map(move |band| (band, face)));
    Csr::from_pairs(height.div_ceil(BAND_ROWS), pairs)
}

/// The rows within `bounds` whose pixel centres lie between the smallest and the largest of `ys`.
fn rows_of(ys: [i64; 3], bounds: Range<usize>) -> Range<usize> {
    let (lo, hi) = (ys[0].min(ys[1]).min(ys[2]), ys[0].max(ys[1]).max(ys[2]));
    let first = -(PIXEL / 2 - lo).div_euclid(PIXEL);
    let last = (hi - PIXEL / 2).div_euclid(PIXEL);
    clamp(first, &bounds)..clamp(last + 1, &bounds)
}

/// The nearest index of `bounds`, its end included.
fn clamp(index: i64, bounds: &Range<usize>) -> usize {
    usize::try_from(index).map_or(bounds.start, |i| i.clamp(bounds.start, bounds.end))
}

/// An edge as the half-plane `step x + offset >= threshold` of each row, `x` the column.
struct PixelEdge {
    from: Snapped,
    direction: Snapped,
    /// 0 if pixel centres on the edge belong to this face, 1 if they belong to the one across it.
    threshold: i64,
}

impl PixelEdge {
    fn new(from: Snapped, to: Snapped) -> Self {
        let direction = [to[0] - from[0], to[1] - from[1]];
        // The sign of the edge function at a point moved by (e, e^2), e > 0 however small.
        let owned = direction[1] < 0 || (direction[1] == 0 && direction[0] > 0);
        Self { from, direction, threshold: i64::from(!owned) }
    }

    /// Narrows `columns` to those whose centres in the row at `y` lie inside.
    fn clip(&self, y: i64, columns: &mut Range<usize>) {
        let [dx, dy] = self.direction;
        let step = -dy * PIXEL;
        let excess = dx * (y - self.from[1]) - dy * (PIXEL / 2 - self.from[0]) - self.threshold;
        if step > 0 {
            columns.start = clamp(-excess.div_euclid(step), columns);
        } else if step < 0 {
            columns.end = clamp(excess.div_euclid(-step) + 1, columns);
        } else if excess < 0 {
            columns.end = columns.start;
        }
    }
}

/// Three edges with the inside on their positive side.
struct Triangle {
    edges: [PixelEdge; 3],
    ys: [i64; 3],
}

impl Triangle {
    /// `None` for a triangle without area. A mirrored one is turned over.
    fn new([a, b, c]: [Snapped; 3]) -> Option<Self> {
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        let [b, c] = if area < 0 { [c, b] } else { [b, c] };
        let edges = [PixelEdge::new(a, b), PixelEdge::new(b, c), PixelEdge::new(c, a)];
        (area != 0).then_some(Self { edges, ys: [a[1], b[1], c[1]] })
    }

    /// Assigns the free pixels inside to `face`; returns the number of pixels that were taken already.
    fn fill(&self, face: FaceId, pixels: &mut [u32], rows: Range<usize>, width: usize) -> usize {
        let mut taken = 0;
        for row in rows_of(self.ys, rows.clone()) {
            let y = i64::try_from(row).unwrap_or(i64::MAX >> SUBPIXEL_BITS) * PIXEL + PIXEL / 2;
            let mut columns = 0..width;
            for edge in &self.edges {
                edge.clip(y, &mut columns);
            }
            if columns.is_empty() {
                continue;
            }
            let start = (row - rows.start) * width;
            for pixel in &mut pixels[start + columns.start..start + columns.end] {
                if *pixel == UNCOVERED {
                    *pixel = face.raw();
                } else {
                    taken += 1;
                }
            }
        }
        taken
    }
}
