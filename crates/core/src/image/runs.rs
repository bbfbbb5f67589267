//! Runs of pixels that follow one plane each, and how they are filled.
//!
//! Within a row, the value of a face is linear in the column. So long runs are divided into blocks of sixteen
//! pixels and a rest of at most eight, and a piece is filled as `start + k step`. A rest fills eight pixels
//! at once: where the row continues without a gap, those beyond its end are overwritten by the next run.
//! Hence the order: first rests with eight pixels before a gap, from left to right, then the blocks, then the
//! rests next to gaps, pixel by pixel. All three compute a pixel by the same operations, so they agree bit by
//! bit.
//!
//! Small faces have runs of three or four pixels: the time depends on the number of runs, not of pixels. So
//! the lists contain only what filling needs, and its loops have no branch.

use crate::numeric::Csr;

/// Pixels of a block, and pixels that a rest fills at once.
const BLOCK_LENGTH: u16 = 16;
const REST_LENGTH: u16 = 8;
const BLOCK: usize = BLOCK_LENGTH as usize;
const REST: usize = REST_LENGTH as usize;

/// Pixels from the start of a piece.
const STEPS: [f32; BLOCK] =
    [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];

/// Frames that are drawn side by side.
pub(super) const AT_ONCE: usize = 16;

/// Pixels that are computed before they are copied to the images of these frames.
const STRIP: usize = 64;

/// A plane in each of these frames: values at the first pixel, steps right, and steps down.
pub(super) type PlanesAtOnce = [[f64; AT_ONCE]; 3];

/// Pixels of one row that follow one plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Run {
    /// Index of the first pixel in the image.
    pub(super) at: u32,
    /// The face whose plane it is.
    pub(super) source: u32,
    /// Column and row of the first pixel in the chart.
    pub(super) column: u16,
    pub(super) row: u16,
    pub(super) length: u16,
}

/// The data that fills a piece of fixed length.
#[derive(Debug, Clone, Copy)]
struct Lanes {
    at: u32,
    source: u32,
    /// Column and row: whole numbers below `2^14`, so exact.
    column: f32,
    row: f32,
}

impl Run {
    /// Its blocks and its rest.
    fn pieces(&self) -> impl Iterator<Item = Self> {
        let mut left = *self;
        std::iter::from_fn(move || {
            let length = match usize::from(left.length) {
                0 => return None,
                1..REST => left.length,
                REST..BLOCK => REST_LENGTH,
                _ => BLOCK_LENGTH,
            };
            let piece = Self { length, ..left };
            left.at += u32::from(length);
            left.column += length;
            left.length -= length;
            Some(piece)
        })
    }
}

/// The runs of a chart, row by row, and those of each source.
#[derive(Debug, Clone, Default)]
pub(super) struct Runs {
    pub(super) all: Vec<Run>,
    rests: Vec<Lanes>,
    blocks: Vec<Lanes>,
    /// The rests next to gaps, as positions in `all`.
    ends: Vec<u32>,
    /// The same runs source by source.
    by_source: Csr<Run>,
}

impl Runs {
    /// Runs of any length in the order of their pixels, of `sources` sources.
    pub(super) fn new(runs: &[Run], sources: usize) -> Self {
        let mut all: Vec<Run> = runs.iter().flat_map(Run::pieces).collect();
        all.shrink_to_fit();
        let (mut rests, mut blocks, mut ends) = (Vec::new(), Vec::new(), Vec::new());
        for (k, (run, room)) in all.iter().zip(rooms(&all)).enumerate() {
            let (column, row) = (f32::from(run.column), f32::from(run.row));
            let lanes = Lanes { at: run.at, source: run.source, column, row };
            match usize::from(run.length) {
                BLOCK => blocks.push(lanes),
                _ if room >= REST => rests.push(lanes),
                _ => ends.push(u32::try_from(k).unwrap_or(u32::MAX)),
            }
        }
        let by_source = Csr::from_pairs(sources, all.iter().map(|run| (run.source as usize, *run)));
        Self { all, rests, blocks, ends, by_source }
    }

    pub(super) fn of_source(&self, source: usize) -> &[Run] {
        &self.by_source[source]
    }

    pub(super) fn fill(&self, planes: &[Plane], pixels: &mut [f32]) {
        for rest in &self.rests {
            planes[rest.source as usize].fill::<REST>(rest, pixels);
        }
        for block in &self.blocks {
            planes[block.source as usize].fill::<BLOCK>(block, pixels);
        }
        for run in self.ends.iter().map(|&k| &self.all[k as usize]) {
            planes[run.source as usize].fill_alone(run, pixels);
        }
    }
}

impl Runs {
    /// Fills images that begin `stride` numbers apart.
    pub(super) fn fill_at_once(&self, planes: &[PlanesAtOnce], images: &mut [f32], stride: usize) {
        let mut strip = [[0.0; AT_ONCE]; STRIP];
        let (mut begin, mut length) = (0, 0);
        let mut put = |strip: &[[f32; AT_ONCE]], begin: usize| {
            for (k, image) in images.chunks_mut(stride).enumerate() {
                let pixels = image[begin..].iter_mut().zip(strip);
                pixels.for_each(|(pixel, of_frames)| *pixel = of_frames[k]);
            }
        };
        for run in &self.all {
            let (at, count) = (run.at as usize, usize::from(run.length));
            if at != begin + length || length + count > STRIP {
                put(&strip[..length], begin);
                (begin, length) = (at, 0);
            }
            let [base, right, down] = &planes[run.source as usize];
            let (column, row) = (f64::from(run.column), f64::from(run.row));
            let (mut start, mut step) = ([0.0; AT_ONCE], [0.0; AT_ONCE]);
            for k in 0..AT_ONCE {
                (start[k], step[k]) = Plane([base[k], right[k], down[k], 0.0]).along(column, row);
            }
            for (pixel, x) in strip[length..length + count].iter_mut().zip(STEPS) {
                (0..AT_ONCE).for_each(|k| pixel[k] = start[k] + step[k] * x);
            }
            length += count;
        }
        put(&strip[..length], begin);
    }
}

/// The number of pixels from the start of each run to the next gap in its row.
fn rooms(all: &[Run]) -> Vec<usize> {
    let mut rooms = vec![0; all.len()];
    for (k, run) in all.iter().enumerate().rev() {
        let goes_on = |next: &Run| next.row == run.row && next.column == run.column + run.length;
        let beyond = if all.get(k + 1).is_some_and(goes_on) { rooms[k + 1] } else { 0 };
        rooms[k] = usize::from(run.length) + beyond;
    }
    rooms
}

/// A linear function of column and row of a chart: its value at the first pixel, the steps right and down,
/// and 0, since four numbers are computed at once.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Plane(pub(super) [f64; 4]);

impl Plane {
    pub(super) const fn constant(value: f64) -> Self {
        Self([value, 0.0, 0.0, 0.0])
    }

    /// Value at a pixel, and the step to the next.
    #[inline]
    #[expect(clippy::cast_possible_truncation, reason = "images are 32-bit floats")]
    fn along(&self, column: f64, row: f64) -> (f32, f32) {
        let [base, right, down, _] = self.0;
        ((base + right * column + down * row) as f32, right as f32)
    }

    /// Fills `N` pixels.
    #[inline]
    fn fill<const N: usize>(&self, lanes: &Lanes, pixels: &mut [f32]) {
        let (start, step) = self.along(f64::from(lanes.column), f64::from(lanes.row));
        let pixels = pixels.get_mut(lanes.at as usize..).and_then(<[f32]>::first_chunk_mut::<N>);
        if let Some(pixels) = pixels {
            for (pixel, k) in pixels.iter_mut().zip(STEPS) {
                *pixel = start + step * k;
            }
        }
    }

    /// Fills a run and nothing else.
    pub(super) fn fill_alone(&self, run: &Run, pixels: &mut [f32]) {
        let (start, step) = self.along(f64::from(run.column), f64::from(run.row));
        let pixels = &mut pixels[run.at as usize..];
        if run.length == BLOCK_LENGTH
            && let Some(block) = pixels.first_chunk_mut::<BLOCK>()
        {
            block.iter_mut().zip(STEPS).for_each(|(pixel, k)| *pixel = start + step * k);
        } else if let Some(rest) = pixels.first_chunk_mut::<REST>() {
            // All eight at once: those beyond the end are written as they are.
            let length = f32::from(run.length);
            for (pixel, k) in rest.iter_mut().zip(STEPS) {
                *pixel = if k < length { start + step * k } else { *pixel };
            }
        } else {
            let pixels = pixels.iter_mut().take(run.length.into());
            pixels.zip(STEPS).for_each(|(pixel, k)| *pixel = start + step * k);
        }
    }
}
