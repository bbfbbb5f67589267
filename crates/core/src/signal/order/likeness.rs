//! How alike the signals of columns are, as sums over frames.
//!
//! The likeness of two columns is the cosine of the square roots of their readings above the threshold: of two taxels at
//! the distance `d` under smooth rolling presses it falls as `exp(-d^2 / 2 l^2)`.

use crate::signal::health::pairs::is_crowded;
use crate::signal::health::survey::Survey;

/// Columns that are touched in fewer frames are not placed.
const LEAST_FRAMES: u32 = 3;

/// A touch begins when this many columns are touched, and ends when none is.
const LEAST_TOUCHED: usize = 2;

/// Sums over frames.
#[derive(Debug, Clone)]
pub(super) struct Sums {
    columns: usize,
    /// Sums of products, above the diagonal and on it, row by row of the whole matrix.
    products: Vec<f64>,
    touched: Vec<u32>,
    pub(super) frames: usize,
    /// Frames that were left out because too many columns were touched.
    pub(super) crowded: usize,
    pub(super) touches: usize,
    is_touched: bool,
    hot: Vec<(u32, f64)>,
}

/// How alike the signals of some columns are.
#[derive(Debug, Clone)]
pub(super) struct Likeness {
    /// The columns that are touched, in ascending order.
    pub(super) columns: Vec<usize>,
    /// The cosine of each two of them, row by row.
    pub(super) cosines: Vec<f64>,
}

impl Sums {
    pub(super) fn new(columns: usize) -> Self {
        Self {
            columns,
            products: vec![0.0; columns * columns],
            touched: vec![0; columns],
            frames: 0,
            crowded: 0,
            touches: 0,
            is_touched: false,
            hot: Vec::with_capacity(columns),
        }
    }

    /// Sees the readings of a frame, less their zeros.
    pub(super) fn see(&mut self, readings: impl Iterator<Item = f64>, survey: &Survey) {
        self.frames += 1;
        self.hot.clear();
        for (column, (k, x)) in (0_u32..).zip(readings.enumerate()) {
            let excess = x - survey.hot(k);
            if survey.is_ok[k] && excess > 0.0 {
                self.hot.push((column, excess.sqrt()));
            }
        }
        let begins = !self.is_touched && self.hot.len() >= LEAST_TOUCHED;
        self.touches += usize::from(begins);
        self.is_touched = begins || (self.is_touched && !self.hot.is_empty());
        if is_crowded(self.hot.len(), self.columns) {
            self.crowded += 1;
            return;
        }
        for &(column, _) in &self.hot {
            let count = &mut self.touched[column as usize];
            *count = count.saturating_add(1);
        }
        for (rank, &(a, x)) in self.hot.iter().enumerate() {
            let row = &mut self.products[a as usize * self.columns..][..self.columns];
            self.hot[rank..].iter().for_each(|&(b, y)| row[b as usize] += x * y);
        }
    }

    pub(super) fn end_recording(&mut self) {
        self.is_touched = false;
    }

    /// The likeness of the columns that are touched.
    pub(super) fn likeness(&self) -> Likeness {
        let product = |a: usize, b: usize| self.products[a.min(b) * self.columns + a.max(b)];
        let is_used = |&k: &usize| self.touched[k] >= LEAST_FRAMES && product(k, k) > 0.0;
        let columns: Vec<usize> = (0..self.columns).filter(is_used).collect();
        let cosine = |a: usize, b: usize| product(a, b) / (product(a, a) * product(b, b)).sqrt();
        let cosines = columns.iter().flat_map(|&a| columns.iter().map(move |&b| cosine(a, b))).collect();
        Likeness { columns, cosines }
    }
}

impl Likeness {
    pub(super) fn len(&self) -> usize {
        self.columns.len()
    }

    /// The likeness of one of the columns to all.
    pub(super) fn row(&self, k: usize) -> &[f64] {
        &self.cosines[k * self.len()..][..self.len()]
    }

    /// The same of some of its columns.
    pub(super) fn select(&self, kept: &[usize]) -> Self {
        Self {
            columns: kept.iter().map(|&k| self.columns[k]).collect(),
            cosines: kept.iter().flat_map(|&a| kept.iter().map(move |&b| self.row(a)[b])).collect(),
        }
    }
}
