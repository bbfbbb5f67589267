//! Runs of pixels that follow one plane each, and how they are filled.
//!
//! Within a row, the value of a face is linear in the column. So a run of pixels is filled as
//! `start + k step`, eight pixels at a time: those beyond its end are overwritten by the next run
//! where the row goes on without a gap, and runs near the end of a row are filled exactly. Both
//! ways compute each pixel by the same operations, so they agree bit by bit.

use crate::atlas::Chart;

/// Pixels that are filled at once.
const LANES: usize = 8;

/// Pixels of one row that follow one plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Run {
    /// Index of the first pixel in the image.
    pub(super) at: u32,
    /// Whose plane it is: a face, or a vertex.
    pub(super) source: u32,
    /// Column and row of the first pixel in the chart.
    pub(super) column: u16,
    pub(super) row: u16,
    /// Number of pixels.
    pub(super) length: u16,
    /// Number of pixels from the first one on that a later run may overwrite, or that are its own.
    room: u16,
}

impl Run {
    /// Pixel `k` of the run, of another source.
    pub(super) fn pixel(&self, k: u16, source: u32) -> Self {
        Self { at: self.at + u32::from(k), column: self.column + k, source, length: 1, ..*self }
    }
}

/// The runs of a chart, row by row, and those of each source.
#[derive(Debug, Clone, Default)]
pub(super) struct Runs {
    pub(super) all: Vec<Run>,
    /// Where the runs of each source begin in `of`; one more entry than sources.
    starts: Vec<u32>,
    of: Vec<u32>,
}

impl Runs {
    /// The runs of a chart by face, in an image of `width` columns.
    pub(super) fn of_faces(chart: &Chart, faces: usize, width: usize) -> Self {
        let mut all = Vec::new();
        for row in 0..chart.frame.size_px[1] {
            let at = row_start(chart, row, width);
            for span in chart.row(row) {
                let run = Run {
                    at: at + u32::from(span.column),
                    source: span.face.raw(),
                    column: span.column,
                    row: u16::try_from(row).unwrap_or(u16::MAX),
                    length: span.length,
                    room: 0,
                };
                all.push(run);
            }
        }
        Self::new(all, faces)
    }

    /// Runs in the order of their pixels, of `sources` sources.
    pub(super) fn new(mut all: Vec<Run>, sources: usize) -> Self {
        // From the right: what is left of a run's row without a gap.
        let mut right: Option<Run> = None;
        for run in all.iter_mut().rev() {
            run.room = run.length;
            if let Some(next) = right
                && next.row == run.row
                && next.column == run.column + run.length
            {
                run.room = run.length.saturating_add(next.room);
            }
            right = Some(*run);
        }
        let mut starts = vec![0_u32; sources + 1];
        all.iter().for_each(|run| starts[run.source as usize + 1] += 1);
        for k in 1..starts.len() {
            starts[k] += starts[k - 1];
        }
        let (mut next, mut of) = (starts.clone(), vec![0; all.len()]);
        for (run, k) in all.iter().zip(0..) {
            let slot = &mut next[run.source as usize];
            of[*slot as usize] = k;
            *slot += 1;
        }
        Self { all, starts, of }
    }

    /// Number of sources.
    pub(super) fn sources(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// The runs of one source.
    pub(super) fn of_source(&self, source: usize) -> impl Iterator<Item = &Run> {
        let range = self.starts[source] as usize..self.starts[source + 1] as usize;
        self.of[range].iter().map(|&k| &self.all[k as usize])
    }

    /// Fills all runs.
    pub(super) fn fill(&self, planes: &[Plane], pixels: &mut [f32]) {
        for run in &self.all {
            planes[run.source as usize].fill(run, pixels);
        }
    }
}

/// Index of the first pixel of a chart's row, in an image of `width` columns.
pub(super) fn row_start(chart: &Chart, row: u32, width: usize) -> u32 {
    let at = (chart.corner_px[1] + row) as usize * width + chart.corner_px[0] as usize;
    u32::try_from(at).unwrap_or(u32::MAX)
}

/// A linear function of column and row of a chart.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Plane {
    pub(super) base: f64,
    pub(super) right: f64,
    pub(super) down: f64,
}

impl Plane {
    pub(super) const fn constant(base: f64) -> Self {
        Self { base, right: 0.0, down: 0.0 }
    }

    /// Value of the first pixel of a run, and the step to the next.
    #[inline]
    #[expect(clippy::cast_possible_truncation, reason = "images are 32-bit floats")]
    fn along(&self, run: &Run) -> (f32, f32) {
        let start = self.base + self.right * f64::from(run.column) + self.down * f64::from(run.row);
        (start as f32, self.right as f32)
    }

    /// Fills a run, and maybe pixels that later runs fill.
    #[inline]
    fn fill(&self, run: &Run, pixels: &mut [f32]) {
        const STEPS: [f32; LANES] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
        let (start, step) = self.along(run);
        let (at, length, room) = (run.at as usize, usize::from(run.length), usize::from(run.room));
        let (mut done, mut first) = (0, 0.0_f32);
        while done < length && done + LANES <= room {
            let Some(lanes) = pixels[at + done..].first_chunk_mut::<LANES>() else { break };
            for (pixel, k) in lanes.iter_mut().zip(STEPS) {
                *pixel = start + step * (first + k);
            }
            done += LANES;
            first += LANES as f32;
        }
        if done < length {
            fill_rest(start, step, first, &mut pixels[at + done..at + length]);
        }
    }

    /// Fills a run and nothing else.
    pub(super) fn fill_alone(&self, run: &Run, pixels: &mut [f32]) {
        let (start, step) = self.along(run);
        let at = run.at as usize;
        fill_rest(start, step, 0.0, &mut pixels[at..at + usize::from(run.length)]);
    }
}

/// `start + k step` for `k` from `first` on. Columns are below `2^14`, so `k` is exact.
#[inline]
fn fill_rest(start: f32, step: f32, first: f32, pixels: &mut [f32]) {
    let mut k = first;
    for pixel in pixels {
        *pixel = start + step * k;
        k += 1.0;
    }
}
