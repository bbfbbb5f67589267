//! The frames around one: each is looked at when those after it are known.

use std::collections::VecDeque;

use crate::signal::health::around::Around;
use crate::signal::health::survey::Survey;

/// Frames on each side.
pub(super) const HALF: usize = 5;

/// The last frames of a recording.
#[derive(Debug, Clone, Default)]
pub(super) struct Window {
    frames: VecDeque<Seen>,
    /// Frames of the recording that were looked at.
    pub(super) next: u32,
    spare: Vec<Seen>,
}

#[derive(Debug, Clone, Default)]
struct Seen {
    x: Vec<f64>,
    /// The largest excess of the neighbours that work; minus infinity without any.
    ring: Vec<f64>,
}

/// A frame, and those around it.
pub(super) struct View<'w> {
    window: &'w Window,
    /// Which of them it is.
    at: usize,
    pub(super) number: u32,
}

impl Window {
    /// Adds a frame, and looks at the one that is complete by it.
    pub(super) fn push(
        &mut self,
        x: impl Iterator<Item = f64>,
        around: &Around,
        survey: &Survey,
        look: impl FnMut(View<'_>),
    ) {
        let is_full = self.frames.len() == 2 * HALF + 1;
        let mut seen = if is_full { self.frames.pop_front() } else { self.spare.pop() }.unwrap_or_default();
        seen.x.clear();
        seen.x.extend(x);
        seen.ring.clear();
        let largest = |taxel: usize| {
            let others = around.of(taxel).filter(|&other| survey.is_ok[other]).map(|other| seen.x[other]);
            others.filter(|x| x.is_finite()).fold(f64::NEG_INFINITY, f64::max)
        };
        seen.ring.extend((0..around.len()).map(largest));
        self.frames.push_back(seen);
        if self.frames.len() > HALF {
            self.look(self.frames.len() - 1 - HALF, look);
        }
    }

    /// Looks at the last frames of a recording.
    pub(super) fn end(&mut self, mut look: impl FnMut(View<'_>)) {
        for at in self.frames.len().saturating_sub(HALF)..self.frames.len() {
            self.look(at, &mut look);
        }
        self.next = 0;
        self.spare.extend(self.frames.drain(..));
    }

    fn look(&mut self, at: usize, mut look: impl FnMut(View<'_>)) {
        look(View { window: self, at, number: self.next });
        self.next += 1;
    }
}

impl View<'_> {
    pub(super) fn x(&self) -> &[f64] {
        &self.window.frames[self.at].x
    }

    /// The change since the frame before; NaN in the first one.
    pub(super) fn change(&self, taxel: usize) -> f64 {
        let before = self.at.checked_sub(1).map_or(f64::NAN, |before| self.window.frames[before].x[taxel]);
        self.x()[taxel] - before
    }

    /// The largest excess of the neighbours of a taxel, up to `half` frames before and after.
    pub(super) fn ring(&self, taxel: usize, half: usize) -> f64 {
        let frames = &self.window.frames;
        let range = self.at.saturating_sub(half)..(self.at + half + 1).min(frames.len());
        frames.range(range).map(|seen| seen.ring[taxel]).fold(f64::NEG_INFINITY, f64::max)
    }
}
