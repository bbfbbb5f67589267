//! The third pass: crosstalk. The readings of a taxel where nothing touches around it are regressed on those of another
//! one, far away, that is touched, over all frames and touch by touch.

use crate::numeric::Csr;
use crate::signal::health::window::View;

/// Frames in which two react together from which on they are looked at, and how many taxels for each at most.
pub(super) const LEAST_FRAMES: u32 = 3;
const MOST_SOURCES: usize = 8;

/// Frames without contact that do not end a touch.
const GAP: u32 = 6;

/// A leak is at least this share, this many standard errors, and explains this share of what the taxel reads alone.
const LEAST: f64 = 0.04;
const ERRORS: f64 = 6.0;
const EXPLAINED: f64 = 0.3;
const FRAMES: f64 = 4.0;

/// A touch counts if the leak would be this many standard errors; it agrees within this share of the leak or this many
/// standard errors, and is this many itself.
const TOUCH_ERRORS: f64 = 3.0;
const AGREES_SHARE: f64 = 0.5;
const AGREES_ERRORS: f64 = 1.5;
/// The least number of touches that agree, and their least share of the touches that count.
const AGREE: u32 = 3;
const AGREE_SHARE: f64 = 0.75;

/// Noise of what is left, over the noise of the taxel, and over what leaks; the ratio that is allowed, and the one for
/// a taxel whose signals would also fit another place.
const LEFT_NOISE: f64 = 1.5;
const LEFT_SHARE: f64 = 0.2;
const MOST_LEFT: f64 = 0.95;
const MOST_LEFT_IF_SWAPPED: f64 = 0.7;

/// Sums over frames in which a taxel is touched and nothing touches around another one.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    xx: f64,
    xy: f64,
    yy: f64,
    frames: f64,
}

/// A taxel whose readings may leak into another one.
#[derive(Debug, Clone)]
struct Suspect {
    from: u32,
    into: u32,
    all: Sums,
    touch: Sums,
    touches: Vec<Sums>,
}

/// Readings of one taxel that leak into another one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Leak {
    pub(super) from: u32,
    pub(super) into: u32,
    pub(super) share: f64,
    pub(super) errors: f64,
    pub(super) touches: u32,
}

#[derive(Debug, Clone)]
pub(super) struct Leaks {
    suspects: Vec<Suspect>,
    /// Suspects by the taxel that they may leak from, and its last touched frame.
    by_source: Csr<u32>,
    last: Vec<Option<u32>>,
}

impl Leaks {
    /// Pairs `(from, into, frames)`, of which those with most frames are looked at.
    pub(super) fn new(taxels: usize, mut pairs: Vec<(u32, u32, u32)>) -> Self {
        pairs.sort_unstable_by_key(|&(from, into, frames)| (into, std::cmp::Reverse(frames), from));
        let first = pairs.chunk_by(|a, b| a.1 == b.1).flat_map(|of_one| of_one.iter().take(MOST_SOURCES));
        let suspects: Vec<Suspect> = first
            .map(|&(from, into, _)| {
                let none = Sums::default();
                Suspect { from, into, all: none, touch: none, touches: Vec::new() }
            })
            .collect();
        let by_source = Csr::from_pairs(taxels, (0..).zip(&suspects).map(|(k, s)| (s.from as usize, k)));
        Self { suspects, by_source, last: vec![None; taxels] }
    }

    /// Sees the taxels that are touched in a frame, with their excess.
    pub(super) fn see(&mut self, touched: &[(u32, f64)], view: &View<'_>, is_quiet: impl Fn(usize) -> bool) {
        for &(from, x) in touched {
            let last = self.last[from as usize].replace(view.number);
            let is_new = last.is_some_and(|last| view.number - last > GAP);
            for &k in &self.by_source[from as usize] {
                let suspect = &mut self.suspects[k as usize];
                if is_new {
                    suspect.end_touch();
                }
                let y = view.x()[suspect.into as usize];
                if y.is_finite() && is_quiet(suspect.into as usize) {
                    suspect.touch.add(Sums { xx: x * x, xy: x * y, yy: y * y, frames: 1.0 });
                }
            }
        }
    }

    pub(super) fn end_recording(&mut self) {
        self.suspects.iter_mut().for_each(Suspect::end_touch);
        self.last.fill(None);
    }

    /// What leaks into which taxel; `energy` is what each reads alone in all frames.
    pub(super) fn found(&self, sigma: &[f64], energy: &[f64], is_swapped: &[bool]) -> Vec<Leak> {
        let of_one = self.suspects.chunk_by(|a, b| a.into == b.into);
        let strongest = of_one.filter_map(|suspects| {
            let known = suspects.iter().filter_map(|s| Some((s, s.regression(sigma[s.into as usize])?)));
            known.max_by(|a, b| (a.1.explained.total_cmp(&b.1.explained)).then(b.0.from.cmp(&a.0.from)))
        });
        let judged = strongest.filter_map(|(suspect, regression)| {
            let into = suspect.into as usize;
            let Regression { share, errors, explained, residual } = regression;
            let (agree, count) = suspect.touches_that_agree(share, sigma[into]);
            let left = residual
                / (LEFT_NOISE * sigma[into]).hypot(LEFT_SHARE * (explained / suspect.all.frames).sqrt());
            let most_left = if is_swapped[into] { MOST_LEFT_IF_SWAPPED } else { MOST_LEFT };
            let is_found = agree >= AGREE
                && f64::from(agree) >= AGREE_SHARE * f64::from(count)
                && explained > EXPLAINED * energy[into]
                && left < most_left;
            is_found.then_some(Leak { from: suspect.from, into: suspect.into, share, errors, touches: agree })
        });
        judged.collect()
    }
}

struct Regression {
    share: f64,
    errors: f64,
    explained: f64,
    residual: f64,
}

impl Sums {
    fn add(&mut self, other: Self) {
        self.xx += other.xx;
        self.xy += other.xy;
        self.yy += other.yy;
        self.frames += other.frames;
    }
}

impl Suspect {
    fn end_touch(&mut self) {
        let touch = std::mem::take(&mut self.touch);
        if touch.frames > 0.0 {
            self.all.add(touch);
            self.touches.push(touch);
        }
    }

    fn regression(&self, sigma: f64) -> Option<Regression> {
        let Sums { xx, xy, yy, frames } = self.all;
        let share = xy / xx;
        let explained = share * xy;
        let residual = ((yy - explained).max(0.0) / (frames - 1.0).max(1.0)).sqrt();
        let errors = share * xx.sqrt() / residual.max(sigma);
        let is_known = frames >= FRAMES && share > LEAST && errors > ERRORS;
        is_known.then_some(Regression { share, errors, explained, residual })
    }

    /// How many touches agree with a leak, of how many that would show it.
    fn touches_that_agree(&self, share: f64, sigma: f64) -> (u32, u32) {
        let (mut agree, mut count) = (0, 0);
        for touch in &self.touches {
            let norm = touch.xx.sqrt();
            if share * norm < TOUCH_ERRORS * sigma {
                continue;
            }
            let own = touch.xy / touch.xx;
            let is_near = (own - share).abs() < (AGREES_SHARE * share).max(TOUCH_ERRORS * sigma / norm);
            count += 1;
            agree += u32::from(is_near && own * norm > AGREES_ERRORS * sigma);
        }
        (agree, count)
    }
}
