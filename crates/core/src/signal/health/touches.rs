//! The second pass, taxel by taxel: the touches of each, and whether those around it feel them too.

use crate::signal::health::around::Around;
use crate::signal::health::survey::Survey;
use crate::signal::health::window::{HALF, View};

/// Frames without contact that do not end a touch.
const GAP: u32 = 6;

/// Peak of a touch over the threshold from which on it is judged.
const STRONG: f64 = 1.25;

/// The ring of a taxel is quiet below this many standard deviations, or this share of the peak.
const QUIET: f64 = 4.0;
const QUIET_SHARE: f64 = 0.12;

/// A touch is at home if the ring feels this share of its peak within [`HOME`] frames.
const HOME_SHARE: f64 = 0.3;
const HOME: usize = 3;

/// A jump is a rise within one frame by this many standard deviations and thresholds.
const JUMP: f64 = 20.0;
const JUMP_THRESHOLDS: f64 = 2.0;

/// A lone change, in thresholds; those of the neighbours are at most this share of it. Where few neighbours work, quick
/// touches change by less.
const LONE_THRESHOLDS: f64 = 2.0;
const LONE_SHARE: f64 = 0.3;

/// Touched neighbours that surround a taxel; it does not react if its mean is below this share of theirs, or below this
/// many standard deviations of its noise: so far off are zeros.
const SURROUNDED: usize = 3;
pub(super) const ABSENT_SHARE: f64 = 0.08;
const ABSENT_NOISE: f64 = 1.0;

/// What the touches of a taxel show.
#[derive(Debug, Clone, Default)]
pub(super) struct Touches {
    /// Touches, and those with a strong peak.
    pub(super) all: u32,
    pub(super) own: u32,
    /// Strong ones of which the ring feels so much more that this taxel does not react.
    pub(super) weak: u32,
    /// Strong ones in which the ring is quiet, and in which it feels them.
    pub(super) away: u32,
    pub(super) home: u32,
    /// Contacts without pauses, and those that begin with a jump.
    pub(super) contacts: u32,
    pub(super) jumps: u32,
    /// Lone changes within one frame.
    pub(super) lone: u32,
    /// Touches of all around it, and those in which it does not react.
    pub(super) surrounded: u32,
    pub(super) absent: u32,
    /// Over the frames of the latter: how many there are, and the sums of its readings and of the mean of those around it.
    frames: f64,
    readings: f64,
    around: f64,
    is_hot: bool,
    touch: Option<Touch>,
    over: Option<Surrounded>,
}

#[derive(Debug, Clone)]
struct Touch {
    last: u32,
    peak: f64,
    /// The largest excess of the ring around its frames, and around those since the last one.
    wide: f64,
    near: f64,
    wide_since: f64,
    near_since: f64,
}

#[derive(Debug, Clone)]
struct Surrounded {
    last: u32,
    own: f64,
    frames: f64,
    others: f64,
    count: f64,
}

impl Touches {
    /// Sees a frame of a taxel that works; `hot` is whether each taxel is touched.
    pub(super) fn see(
        &mut self,
        taxel: usize,
        view: &View<'_>,
        hot: &[bool],
        around: &Around,
        survey: &Survey,
    ) {
        let (x, sigma, now) = (view.x()[taxel], survey.sigma[taxel], view.number);
        let was_hot = std::mem::replace(&mut self.is_hot, hot[taxel]);
        let change = view.change(taxel);
        if change.abs() > LONE_THRESHOLDS * survey.threshold
            && around.of(taxel).all(|other| {
                // A missing change of a neighbour contradicts nothing.
                !(survey.is_ok[other] && view.change(other).abs() >= LONE_SHARE * change.abs())
            })
        {
            self.lone += 1;
        }
        if hot[taxel] {
            if !was_hot {
                self.contacts += 1;
                let is_quiet = || view.ring(taxel, HALF) < (QUIET * sigma).max(QUIET_SHARE * change);
                if change > (JUMP * sigma).max(JUMP_THRESHOLDS * survey.threshold) && is_quiet() {
                    self.jumps += 1;
                }
            }
            self.all += u32::from(self.touch.is_none());
        }
        if hot[taxel] || self.touch.is_some() {
            let none = f64::NEG_INFINITY;
            let touch = self.touch.get_or_insert(Touch {
                last: now,
                peak: none,
                wide: none,
                near: none,
                wide_since: none,
                near_since: none,
            });
            touch.wide_since = touch.wide_since.max(view.ring(taxel, HALF));
            touch.near_since = touch.near_since.max(view.ring(taxel, HOME));
            if hot[taxel] {
                (touch.last, touch.peak) = (now, touch.peak.max(x));
                touch.wide = touch.wide.max(touch.wide_since);
                touch.near = touch.near.max(touch.near_since);
                (touch.wide_since, touch.near_since) = (none, none);
            } else if now - touch.last > GAP {
                self.end_touch(taxel, survey);
            }
        }
        let touched = around.of(taxel).filter(|&other| hot[other]);
        if touched.clone().count() >= SURROUNDED
            && around.is_surrounded(taxel, |other| hot[other])
            && x.is_finite()
        {
            let over = self.over.get_or_insert(Surrounded {
                last: now,
                own: 0.0,
                frames: 0.0,
                others: 0.0,
                count: 0.0,
            });
            over.last = now;
            over.own += x;
            over.frames += 1.0;
            for other in touched {
                over.others += view.x()[other];
                over.count += 1.0;
            }
        } else if self.over.as_ref().is_some_and(|over| now - over.last > GAP) {
            self.end_surrounded(taxel, survey);
        }
    }

    fn end_touch(&mut self, taxel: usize, survey: &Survey) {
        let Some(touch) = self.touch.take() else { return };
        if touch.peak < STRONG * survey.threshold {
            return;
        }
        self.own += 1;
        self.weak += u32::from(touch.peak < ABSENT_SHARE * touch.near);
        self.away += u32::from(touch.wide < (QUIET * survey.sigma[taxel]).max(QUIET_SHARE * touch.peak));
        self.home += u32::from(touch.near > survey.threshold.max(HOME_SHARE * touch.peak));
    }

    fn end_surrounded(&mut self, taxel: usize, survey: &Survey) {
        let Some(over) = self.over.take() else { return };
        self.surrounded += 1;
        let most = (ABSENT_SHARE * over.others / over.count).max(ABSENT_NOISE * survey.sigma[taxel]);
        self.absent += u32::from(over.own / over.frames < most);
        self.frames += over.frames;
        self.readings += over.own;
        self.around += over.frames * over.others / over.count;
    }

    /// What it reads where touches surround it, over what those around it read: over all of them, since a touch of few frames
    /// may show noise alone. 0 where that is less than how far off zeros are.
    pub(super) fn share(&self, sigma: f64) -> f64 {
        let is_of_zero = self.readings < ABSENT_NOISE * sigma * self.frames;
        if is_of_zero { 0.0 } else { self.readings / self.around }
    }

    pub(super) fn end_recording(&mut self, taxel: usize, survey: &Survey) {
        self.end_touch(taxel, survey);
        self.end_surrounded(taxel, survey);
        self.is_hot = false;
    }
}
