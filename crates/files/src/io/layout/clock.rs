//! The seconds of frames, from times of a file or from a rate.

use crate::io::file::times::LATEST;
use crate::io::layout::facts::{Statement, StatementSource, StreamFacts, TimeUnit, Times};
use crate::io::layout::rules::TimeRule;
use crate::signal::{Clock, Tick};

/// What is wrong with the times: element, found, needed.
pub(super) type Fault = [String; 3];

fn fault(element: &str, found: String, needed: &str) -> Fault {
    [element.to_owned(), found, needed.to_owned()]
}

/// The usual step, over that of a stated rate, lies between these: clocks of sensors are off by some percent, and a rate that
/// is another one by a fourth or more.
const OF_RATE: [f64; 2] = [0.8, 1.25];

#[derive(Debug, Clone)]
pub(super) struct FrameClock {
    rule: TimeRule,
    /// What the file states: frames per second, and the unit of its times.
    stated_hz: Option<f64>,
    stated_unit: Option<TimeUnit>,
    /// The first time of an episode in the file, where the layout states a rate; and how many times were not compared.
    began: Option<f64>,
    unread: u64,
    episode: u64,
    /// Frames of all episodes, and where this one began.
    frames: u64,
    start: u64,
    first: Option<i64>,
    last: f64,
    clock: Clock,
    /// The first times of an episode, until they show the rate.
    early: Vec<f64>,
    is_rate_checked: bool,
    gaps: u64,
    /// The longest step, in s, and the frame after it.
    longest: (f64, u64),
}

impl FrameClock {
    pub(super) fn new(rule: TimeRule, facts: &StreamFacts) -> Self {
        Self {
            rule,
            stated_hz: facts.rate_hz,
            stated_unit: facts.time_unit,
            began: None,
            unread: 0,
            episode: 0,
            frames: 0,
            start: 0,
            first: None,
            last: f64::NEG_INFINITY,
            clock: Clock::new(),
            early: Vec::new(),
            is_rate_checked: false,
            gaps: 0,
            longest: (0.0, 0),
        }
    }

    /// Frames so far.
    pub(super) fn frames(&self) -> u64 {
        self.frames
    }

    /// Appends the seconds of the next `count` frames.
    pub(super) fn seconds(
        &mut self,
        times: Times<'_>,
        count: usize,
        episode: u64,
        seconds: &mut Vec<f64>,
    ) -> Result<(), Fault> {
        if episode < self.episode {
            let found = format!("episode {episode} after {}", self.episode);
            return Err(fault("episodes", found, "episodes in ascending order"));
        }
        if episode > self.episode {
            (self.episode, self.start, self.first, self.last) =
                (episode, self.frames, None, f64::NEG_INFINITY);
            self.early.clear();
            self.clock.settle();
            self.began = None;
        }
        let (unit, between) = match &self.rule {
            &TimeRule::Rate(rate) => {
                self.compare(rate, times)?;
                let start = self.frames - self.start;
                seconds.extend((0..count as u64).map(|k| (start + k) as f64 / rate));
                self.frames += count as u64;
                return Ok(());
            }
            TimeRule::Stream { unit, between, .. } => (*unit, *between),
        };
        let at = seconds.len();
        self.take(times, count, unit, seconds)?;
        self.early.extend_from_slice(&seconds[at..]);
        if !self.is_rate_checked && self.early.len() > 2 {
            self.is_rate_checked = true;
            self.check_rate(unit, between)?;
        }
        if self.is_rate_checked {
            let first = self.frames - self.early.len() as u64;
            for (time, frame) in self.early.drain(..).zip(first..) {
                if let Tick::Gap(length) = self.clock.see(time) {
                    self.gaps += 1;
                    if length > self.longest.0 {
                        self.longest = (length, frame);
                    }
                }
            }
        }
        Ok(())
    }

    /// Takes the times of `count` frames, which must ascend.
    fn take(
        &mut self,
        times: Times<'_>,
        count: usize,
        unit: TimeUnit,
        seconds: &mut Vec<f64>,
    ) -> Result<(), Fault> {
        let at = seconds.len();
        let per_second = unit.per_second() as f64;
        let mut latest = 0.0_f64;
        match times {
            Times::None => {
                let needed = "times, or `time` of the layout as {\"rate\": HZ}";
                return Err(fault("times", "none".into(), needed));
            }
            Times::Whole(_) if unit == TimeUnit::Seconds => {
                let needed = "{\"rate\": HZ}, or a smaller unit, as `time` of the layout";
                return Err(fault("times", "whole numbers in s, as frame numbers are".into(), needed));
            }
            Times::Whole(ticks) => {
                self.first = self.first.or_else(|| ticks.first().copied());
                // As integers: 1.7e18 ns are not exact as a float.
                let since = |t: &i64| t.saturating_sub(self.first.unwrap_or(*t));
                seconds.extend(ticks.iter().map(|t| since(t) as f64 / per_second));
                latest = ticks.iter().map(|t| (*t as f64 / per_second).abs()).fold(latest, f64::max);
            }
            Times::Real(times) => {
                seconds.extend(times.iter().map(|t| t / per_second));
                let size = |t: &f64| if t.is_finite() { t.abs() } else { f64::INFINITY };
                latest = seconds[at..].iter().map(size).fold(latest, f64::max);
            }
        }
        let new = &seconds[at..];
        if new.len() != count {
            return Err(fault("times", format!("{} for {count} frames", new.len()), "one for each frame"));
        }
        if latest > LATEST {
            let found = format!("a time of {latest:e} s with times in {}", unit.name());
            return Err(fault("times", found, "finite times, and the unit that they have in the file"));
        }
        for (frame, &time) in (self.frames..).zip(new) {
            if time <= self.last {
                let found = format!("{time} s after {} s", self.last);
                return Err(fault(&format!("frame {frame}"), found, "ascending times, or one episode alone"));
            }
            self.last = time;
        }
        self.frames += count as u64;
        Ok(())
    }

    /// Refuses first times whose rate is not between these, or not the one that the file states.
    fn check_rate(&mut self, unit: TimeUnit, between: [f64; 2]) -> Result<(), Fault> {
        self.early.iter().for_each(|&time| self.clock.learn(time));
        self.clock.settle();
        let rate = self.clock.usual().map_or(between[0], f64::recip);
        if !(between[0]..=between[1]).contains(&rate) {
            let found = format!("{rate:.6} frames a second with times in {}", unit.name());
            let needed = format!("{} to {}, `between` of the layout", between[0], between[1]);
            return Err(fault("times", found, &needed));
        }
        match self.stated_hz.zip(self.clock.usual()) {
            Some((hz, step)) if !is_of_rate(step, hz) => {
                let found = format!("frames {step:.6} s apart");
                let needed = format!("{:.6} s, as the {hz} frames a second that the file states", 1.0 / hz);
                Err(fault("times", found, &needed))
            }
            _ => Ok(()),
        }
    }

    /// Refuses times of the file that are not those of the rate that is stated.
    fn compare(&mut self, rate: f64, times: Times<'_>) -> Result<(), Fault> {
        let Some(unit) = self.stated_unit else {
            self.unread += match times {
                Times::None => 0,
                Times::Whole(times) => times.len() as u64,
                Times::Real(times) => times.len() as u64,
            };
            return Ok(());
        };
        let seconds: Vec<f64> = match times {
            Times::None => return Ok(()),
            Times::Whole(times) => {
                let first = *self.first.get_or_insert(times.first().copied().unwrap_or_default());
                let since = |t: &i64| t.saturating_sub(first) as f64 / unit.per_second() as f64;
                times.iter().map(since).collect()
            }
            Times::Real(times) => times.iter().map(|t| t / unit.per_second() as f64).collect(),
        };
        for (k, time) in (self.frames - self.start..).zip(seconds) {
            let since = time - *self.began.get_or_insert(time);
            let expected = k as f64 / rate;
            // Measured times may be late by half a frame. NaN is no time.
            if time.is_finite() && (since - expected).abs() > 0.5 / rate + 1e-6 * expected {
                let found = format!("{since:.6} s after the first in the file");
                let needed = format!(
                    "{expected:.6} s, by the rate {rate} of the layout; or a `unit` for `time` there, which reads the times \
                     of the file"
                );
                return Err([format!("frame {}", self.start + k), found, needed]);
            }
        }
        Ok(())
    }

    /// What was noticed.
    pub(super) fn statements(&self) -> Vec<Statement> {
        let value = "times in the file, in a unit that it does not state, are not read: a rate is stated";
        let unread = (self.unread > 0).then(|| Statement::new("times", value, StatementSource::Checked));
        unread.into_iter().chain(self.gap_statement()).collect()
    }

    fn gap_statement(&self) -> Option<Statement> {
        let (length, frame) = self.longest;
        let value = match self.gaps {
            0 => return None,
            1 => format!("{length:.6} s without frames before frame {frame}; not filled"),
            gaps => format!("{gaps} gaps, the longest of {length:.6} s before frame {frame}; not filled"),
        };
        Some(Statement::new("gap", value, StatementSource::Checked))
    }
}

/// Whether a step in s is that of a rate.
fn is_of_rate(step: f64, hz: f64) -> bool {
    (OF_RATE[0]..=OF_RATE[1]).contains(&(step * hz))
}
