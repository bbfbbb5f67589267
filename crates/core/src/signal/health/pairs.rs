//! The second pass, pair by pair: how alike the signals of two taxels are, and which react alone together.
//!
//! The likeness of two taxels is the cosine of the square roots of their readings where they are touched: of two at the
//! distance `d` under a smooth press it falls as `exp(-d^2 / 2 l^2)`.

use std::collections::HashMap;

use crate::numeric::Csr;
use crate::signal::health::around::Around;

/// Most pairs that are kept: 160 MB.
const MOST_PAIRS: usize = 4_000_000;

/// Frames in which more than this share of the taxels is touched say little of any pair; of small skins this many.
const CROWDED_SHARE: f64 = 0.25;
const CROWDED: usize = 64;

/// Whether so large a share of the taxels is touched that a frame says little of any pair.
pub(in crate::signal) fn is_crowded(touched: usize, taxels: usize) -> bool {
    touched as f64 > (CROWDED_SHARE * taxels as f64).max(CROWDED as f64)
}

/// What two taxels have in common, the smaller number first.
#[derive(Debug, Clone, Copy, Default)]
struct Pair {
    product: f64,
    /// Frames in which the second reacts alone while the first is touched, and the other way round.
    lone: [u32; 2],
}

#[derive(Debug, Clone)]
pub(super) struct Pairs {
    pairs: HashMap<(u32, u32), Pair>,
    squares: Vec<f64>,
    /// Frames that were left out because too many taxels were touched.
    pub(super) crowded: u32,
    /// Whether there were more pairs than are kept.
    pub(super) is_full: bool,
}

impl Pairs {
    pub(super) fn new(taxels: usize) -> Self {
        Self { pairs: HashMap::new(), squares: vec![0.0; taxels], crowded: 0, is_full: false }
    }

    /// Sees the taxels that are touched in a frame, in ascending order, with their excess, and those that react while
    /// nothing touches around them.
    pub(super) fn see(&mut self, touched: &[(u32, f64)], lone: &[u32], around: &Around) {
        if is_crowded(touched.len(), around.len()) {
            self.crowded += 1;
            return;
        }
        for (rank, &(a, x)) in touched.iter().enumerate() {
            self.squares[a as usize] += x;
            for &(b, y) in &touched[rank + 1..] {
                if let Some(pair) = self.pair(a, b) {
                    pair.product += (x * y).sqrt();
                }
            }
            for &b in lone.iter().filter(|&&b| b != a && !around.is_near(a, b)) {
                if let Some(pair) = self.pair(a.min(b), a.max(b)) {
                    pair.lone[usize::from(a > b)] += 1;
                }
            }
        }
    }

    fn pair(&mut self, a: u32, b: u32) -> Option<&mut Pair> {
        if self.pairs.len() >= MOST_PAIRS && !self.pairs.contains_key(&(a, b)) {
            self.is_full = true;
            return None;
        }
        Some(self.pairs.entry((a, b)).or_default())
    }

    /// The pairs in ascending order.
    fn sorted(&self) -> Vec<(u32, u32, Pair)> {
        let mut all: Vec<_> = self.pairs.iter().map(|(&(a, b), &pair)| (a, b, pair)).collect();
        all.sort_unstable_by_key(|&(a, b, _)| (a, b));
        all
    }

    /// The likeness of each taxel to others.
    pub(super) fn likeness(&self) -> Csr<(u32, f64)> {
        let cosine = |&(a, b, pair): &(u32, u32, Pair)| {
            let norm = (self.squares[a as usize] * self.squares[b as usize]).sqrt();
            (pair.product > 0.0).then(|| (a, b, pair.product / norm))
        };
        let all: Vec<_> = self.sorted().iter().filter_map(cosine).collect();
        let both = all.iter().flat_map(|&(a, b, c)| [(a as usize, (b, c)), (b as usize, (a, c))]);
        Csr::from_pairs(self.squares.len(), both)
    }

    /// Pairs `(from, into, frames)` in which the second reacted alone in `least` frames at least while the first was
    /// touched.
    pub(super) fn lone(&self, least: u32) -> Vec<(u32, u32, u32)> {
        let all = self.sorted();
        let both = all.iter().flat_map(|&(a, b, pair)| [(a, b, pair.lone[0]), (b, a, pair.lone[1])]);
        both.filter(|(.., frames)| *frames >= least).collect()
    }
}
