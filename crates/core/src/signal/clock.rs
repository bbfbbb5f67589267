//! The clock of a recording: what the time of each frame says of the step from the frame before.
//!
//! All that depends on time has a clock of its own, and this one rule of what a gap is: sums add nothing over one, contacts
//! and events end before it. Usual is the median of the latest steps, which pauses do not move as they move a mean. The first
//! step is judged by those after it where a recording is read ahead ([`Clock::learn`]).

/// A gap is longer than this many usual steps, and than this time in s: a bus that hands over its frames in bursts, or one
/// dropped packet at a kilohertz, ends no contact.
const GAP_STEPS: f64 = 10.0;
const GAP_S: f64 = 0.5;

/// Number of the latest steps whose median is usual: half as many slower ones in a row are a new rate.
const STEPS: usize = 50;

/// Frames to read ahead, so that a first step that is a gap is one: two steps, of which the shorter is usual.
pub(super) const FRAMES_AHEAD: usize = 3;

/// Times that differ by less than this are the same, in s: limits are often whole numbers of steps, and what is compared with
/// them must not depend on the rounding of times, which in seconds since 1970 is 0.24 us.
pub(in crate::signal) const SAME_S: f64 = 1e-6;

/// The step of frames without times, in s.
const UNKNOWN_STEP_S: f64 = 0.1;

/// What the time of a frame says.
#[derive(Debug, Clone, Copy, PartialEq)]
#[doc(hidden)]
pub enum Tick {
    /// It is the first frame with a time.
    First,
    /// It follows the frame before after this time in s, 0 or more.
    After(f64),
    /// Frames are missing, for this time in s.
    Gap(f64),
    /// It is earlier than the frame before: another recording, or a clock that was set.
    Back,
    /// It has no time.
    Untimed,
}

impl Tick {
    /// Whether nothing goes on from the frame before.
    #[doc(hidden)]
    pub fn is_cut(self) -> bool {
        matches!(self, Self::Gap(_) | Self::Back)
    }

    /// The time to integrate over, in s.
    pub(crate) fn step(self) -> Option<f64> {
        if let Self::After(step) = self { Some(step) } else { None }
    }
}

/// Judges the times of frames, one after the other.
#[derive(Debug, Clone)]
#[doc(hidden)]
pub struct Clock {
    last: Option<f64>,
    /// The latest positive steps in a ring, and how many there were.
    steps: [f64; STEPS],
    count: usize,
}

impl Clock {
    #[doc(hidden)]
    pub fn new() -> Self {
        Self { last: None, steps: [0.0; STEPS], count: 0 }
    }

    /// What the time of the next frame says.
    #[doc(hidden)]
    pub fn see(&mut self, time: f64) -> Tick {
        if !time.is_finite() {
            return Tick::Untimed;
        }
        let Some(last) = self.last.replace(time) else { return Tick::First };
        let step = time - last;
        if step < 0.0 {
            return Tick::Back;
        }
        let is_longer = |usual: f64| step > GAP_STEPS * (usual + SAME_S);
        let is_gap = step > GAP_S + SAME_S && self.usual().is_some_and(is_longer);
        if step > 0.0 {
            self.steps[self.count % STEPS] = step;
            self.count += 1;
        }
        if is_gap { Tick::Gap(step) } else { Tick::After(step) }
    }

    /// The time by which what follows frames moves on, in s: for times that go back, or none, the usual step.
    pub(crate) fn elapsed(&self, tick: Tick) -> f64 {
        match tick {
            Tick::After(step) | Tick::Gap(step) => step,
            Tick::First | Tick::Back | Tick::Untimed => self.usual().unwrap_or(UNKNOWN_STEP_S),
        }
    }

    /// Takes the time of one of the first frames, which [`Self::see`] will see again after [`Self::settle`].
    #[doc(hidden)]
    pub fn learn(&mut self, time: f64) {
        self.see(time);
    }

    /// Ends learning: the next frame is the first.
    #[doc(hidden)]
    pub fn settle(&mut self) {
        self.last = None;
    }

    /// All that it remembers, number by number, to be read or set.
    pub(in crate::signal) fn visit(&mut self, visit: &mut dyn FnMut(&mut f64)) {
        let mut last = self.last.unwrap_or(f64::NAN);
        visit(&mut last);
        self.last = last.is_finite().then_some(last);
        self.steps.iter_mut().for_each(&mut *visit);
        visit_count(&mut self.count, visit);
    }

    /// The median of the latest steps, in s; of two the shorter.
    #[doc(hidden)]
    pub fn usual(&self) -> Option<f64> {
        let known = self.count.min(STEPS);
        let mut steps = self.steps;
        let middle = known.checked_sub(1)? / 2;
        Some(*steps[..known].select_nth_unstable_by(middle, f64::total_cmp).1)
    }
}

/// A count as a number, to be read or set.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "set to whole numbers from 0 to 2^52"
)]
pub(in crate::signal) fn visit_count(count: &mut usize, visit: &mut dyn FnMut(&mut f64)) {
    let mut number = *count as f64;
    visit(&mut number);
    *count = number.clamp(0.0, 2.0_f64.powi(52)) as usize;
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ticks(clock: &mut Clock, times: &[f64]) -> Vec<Tick> {
        times.iter().map(|&time| clock.see(time)).collect()
    }

    #[test]
    fn gaps_are_judged_by_usual_steps() {
        let mut clock = Clock::new();
        let found = ticks(&mut clock, &[5.0, 5.25, 5.25, 5.5, f64::NAN, 45.5, 45.75, 1.0, 1.25]);
        let step = Tick::After(0.25);
        let expected = [
            Tick::First,
            step,
            Tick::After(0.0),
            step,
            Tick::Untimed,
            Tick::Gap(40.0),
            step,
            Tick::Back,
            step,
        ];
        assert_eq!(found, expected);
        assert_eq!(clock.usual(), Some(0.25));
        // A frame in a minute is no gap among such frames, and becomes usual after others.
        assert_eq!(ticks(&mut Clock::new(), &[0.0, 60.0, 120.0])[1..], [Tick::After(60.0); 2]);
        let slower: Vec<f64> = (0..40).map(|k| 2.0 + 60.0 * f64::from(k)).collect();
        assert_eq!(ticks(&mut clock, &slower).last(), Some(&Tick::After(60.0)));
        // At a kilohertz 0.4 s are bridged.
        assert_eq!(ticks(&mut Clock::new(), &[0.0, 0.001, 0.401])[2], Tick::After(0.4));
    }

    /// The first step can be a gap for who reads ahead; two steps are enough.
    #[test]
    fn first_steps_are_judged_by_those_that_follow() {
        let times = [0.0, 100.0, 100.02];
        let mut clock = Clock::new();
        times.iter().for_each(|&time| clock.learn(time));
        clock.settle();
        assert_eq!(ticks(&mut clock, &times)[..2], [Tick::First, Tick::Gap(100.0)]);
    }
}
