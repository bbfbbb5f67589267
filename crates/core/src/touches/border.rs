//! The delay of the readings as one more unknown of the bundle adjustment.
//!
//! A reading that is late by `d` is of where the body was `d` earlier: in the frame of the link it is off by `d v`, `v` the
//! velocity of the body there. So the arm says of a frame `c = p - d v`, in place of `c = p`. Touches that go in several
//! directions determine `d`; of one direction it is a motion of all taxels. It borders the normal equations of the taxels, so
//! that it costs one more right side. Velocities are those of the adjusted positions, since those of the arm are noisier and
//! would make the delay too small. A log is then fitted again with poses interpolated at their times, until nothing is left.
//!
//! The standard deviation is from the scatter of the touches ("sandwich", `(huber1967)`), since the errors of the frames of a touch
//! are not independent, times [`SCATTER`]. *Heuristic*: a delay is said and taken off beyond five of them
//! ([`LogDelay::is_significant`]). Play of joints reads as a delay.

use glam::DVec3;

use crate::touches::bundle::{Bundle, Frame, Reduced, SIZE, Term};
use crate::touches::delay::LogDelay;

/// The errors of the delay of 45 simulated logs were 1.4 times as large as the scatter of the touches.
const SCATTER: f64 = 1.6;

/// Least standard deviation, in s: a twentieth of a frame at 50 Hz. Logs without noise are late by less, and poses between frames
/// are no better.
const LEAST_SIGMA: f64 = 1e-3;

/// A velocity is that of so many frames before and after.
const FRAMES: usize = 2;

/// Frames farther apart in time than this have no velocity, in s.
const LONGEST: f64 = 0.5;

/// With fewer touches their scatter says nothing.
const LEAST_TOUCHES: f64 = 5.0;

/// What the delay adds to the normal equations: its column next to the taxels, its own entry and its right side.
struct Border {
    column: Vec<f64>,
    own: f64,
    right: f64,
}

impl Border {
    fn new(unknowns: usize) -> Self {
        Self { column: vec![0.0; unknowns], own: 0.0, right: 0.0 }
    }

    /// The terms of a frame whose position is eliminated, with the velocity `v`.
    fn add(&mut self, frame: &Frame, reduced: &Reduced, v: DVec3) {
        let weighted = reduced.arm * v;
        let eliminated = reduced.root.transpose() * weighted;
        self.own += weighted.dot(v) - eliminated.length_squared();
        self.right -= weighted.dot(frame.centre - frame.believed) - eliminated.dot(reduced.along);
        for term in &reduced.felt {
            let both = -term.q.dot(eliminated);
            let column = &mut self.column[SIZE * term.taxel.index()..][..SIZE];
            column.iter_mut().zip(term.row).for_each(|(cell, a)| *cell += both * a);
        }
    }
}

impl Bundle<'_> {
    /// The delay that explains the frames best, as far as it is not removed yet: one step of Gauss and Newton in which the
    /// taxels move as well. `solve` solves the normal equations of the taxels, `right` is their right side. `None` if the touches
    /// do not tell.
    pub(super) fn delay<E>(
        &self,
        reduced: &[Reduced],
        right: &[f64],
        solve: impl Fn(&mut [f64]) -> Result<(), E>,
    ) -> Result<Option<LogDelay>, E> {
        let velocities = self.velocities();
        let mut all = Border::new(right.len());
        for ((frame, reduced), v) in self.frames.iter().zip(reduced).zip(&velocities) {
            all.add(frame, reduced, *v);
        }
        self.add_guesses(&mut all, &velocities);
        let mut solved = all.column.clone();
        solve(&mut solved)?;
        let dot = |a: &[f64]| a.iter().zip(&solved).map(|(a, b)| a * b).sum::<f64>();
        let information = all.own - dot(&all.column);
        if information.is_nan() || information <= 1e-9 * all.own {
            return Ok(None);
        }
        let seconds = (all.right - dot(right)) / information;
        // What each touch says: its part of the gradient at the solution.
        let (mut squares, mut touches) = (0.0, 0.0);
        let mut one = Border::new(right.len());
        let frames: Vec<usize> = (0..self.frames.len()).filter(|k| velocities[*k] != DVec3::ZERO).collect();
        for touch in frames.chunk_by(|a, b| self.frames[*a].touch == self.frames[*b].touch) {
            one.column.fill(0.0);
            (one.own, one.right) = (0.0, 0.0);
            for &k in touch {
                one.add(&self.frames[k], &reduced[k], velocities[k]);
                one.right -= along(&reduced[k], &solved);
            }
            squares += (one.right - seconds * (one.own - dot(&one.column))).powi(2);
            touches += 1.0;
        }
        if touches < LEAST_TOUCHES {
            return Ok(None);
        }
        let scatter = squares * touches / (touches - 1.0);
        let sigma = (SCATTER * scatter.sqrt() / information).max(LEAST_SIGMA);
        Ok((seconds.is_finite() && sigma.is_finite()).then_some(LogDelay { seconds, sigma, removed: 0.0 }))
    }

    /// First guesses are means of where the body was, and late with it.
    fn add_guesses(&self, border: &mut Border, velocities: &[DVec3]) {
        let mut sums = vec![(DVec3::ZERO, 0.0_f64); self.estimates.len()];
        for (frame, v) in self.frames.iter().zip(velocities) {
            for (taxel, sample) in &frame.felt {
                let (sum, weight) = &mut sums[taxel.index()];
                (*sum, *weight) = (*sum + sample.reading * v, *weight + sample.reading);
            }
        }
        let weight = self.guess_sigma.powi(-2);
        for (v, at) in self.estimates.enumerate() {
            let (Some(at), (sum, total)) = (at, sums[v.index()]) else { continue };
            let mean = if total > 0.0 { weight * sum / total } else { DVec3::ZERO };
            border.own += mean.length_squared() / weight;
            border.right -= mean.dot(at.position - self.guesses[v]);
            let column = &mut border.column[SIZE * v.index()..];
            column.iter_mut().zip(mean.to_array()).for_each(|(cell, a)| *cell += a);
        }
    }

    /// The velocity of the body in the frame of the link in each frame, of its adjusted positions before and after; zero where
    /// it is not known. The position of the frame itself is left out: its error is in the residual.
    fn velocities(&self) -> Vec<DVec3> {
        let mut all = vec![DVec3::ZERO; self.frames.len()];
        let felt: Vec<usize> = (0..self.frames.len()).filter(|k| !self.frames[*k].felt.is_empty()).collect();
        for touch in felt.chunk_by(|a, b| self.frames[*a].touch == self.frames[*b].touch) {
            for (i, &k) in touch.iter().enumerate() {
                let reach = FRAMES.min(i).min(touch.len() - 1 - i);
                let others = touch[i - reach..=i + reach].iter().filter(|j| **j != k);
                let timed = others.map(|&j| Some((self.frames[j].time?, self.frames[j].centre)));
                let timed: Option<Vec<(f64, DVec3)>> = timed.collect();
                all[k] = timed.and_then(|timed| slope(&timed)).unwrap_or(DVec3::ZERO);
            }
        }
        all
    }
}

/// What the right side of a frame adds to that of the delay when the taxels are eliminated.
fn along(frame: &Reduced, solved: &[f64]) -> f64 {
    let one = |term: &Term| {
        let moved: f64 = term.row.iter().zip(&solved[SIZE * term.taxel.index()..]).map(|(a, b)| a * b).sum();
        -term.left * moved
    };
    frame.felt.iter().map(one).sum()
}

/// The velocity of a straight line through positions at some times.
fn slope(timed: &[(f64, DVec3)]) -> Option<DVec3> {
    let (first, last) = (timed.first()?.0, timed.last()?.0);
    let count = timed.len() as f64;
    let mean = timed.iter().map(|at| at.0).sum::<f64>() / count;
    let squares = timed.iter().map(|at| (at.0 - mean).powi(2)).sum::<f64>();
    let is_near = last > first && last - first <= LONGEST;
    is_near.then(|| timed.iter().map(|at| (at.0 - mean) * at.1).sum::<DVec3>() / squares)
}
