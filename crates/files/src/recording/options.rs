//! What is done to a recording on its way to frames, and what was done.

use crate::signal::{ConditionOptions, ConditionReport, Duplicates, JoinReport, Zero};

/// How readings are joined to a map and made comparable.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RecordingOptions {
    /// Names of the channels, instead of those of the readings; none, or one for each.
    pub names: Vec<String>,
    /// Units of the channels, likewise.
    pub units: Vec<String>,
    /// Frames per second of readings that have no times.
    pub rate_hz: Option<f64>,
    /// What to do with an id that several columns have.
    pub duplicates: Duplicates,
    /// Baseline, gains, bounds and filters.
    pub condition: ConditionOptions,
    /// What takes the place of missing readings.
    pub fill: Fill,
    /// Which frames are wanted.
    pub frames: FrameRange,
}

/// What takes the place of missing readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Fill {
    /// Nothing: they stay missing.
    #[default]
    None,
    /// The weighted mean of the taxels around each, marked as [filled](crate::signal::Frame::filled).
    Neighbours,
}

/// Which frames of a recording are wanted, counted from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameRange {
    /// The first one.
    pub from: usize,
    /// The last one; `None`: that of the recording.
    pub to: Option<usize>,
    /// Every n-th of these; 0 as 1.
    pub every: usize,
}

impl Default for FrameRange {
    fn default() -> Self {
        Self { from: 0, to: None, every: 1 }
    }
}

impl FrameRange {
    /// One frame alone.
    pub fn one(number: usize) -> Self {
        Self { from: number, to: Some(number), every: 1 }
    }

    pub(super) fn contains(&self, number: usize) -> bool {
        number >= self.from
            && (number - self.from).is_multiple_of(self.every.max(1))
            && !self.ends_before(number)
    }

    pub(super) fn ends_before(&self, number: usize) -> bool {
        self.to.is_some_and(|to| number > to)
    }

    /// How many of `all` frames it has.
    pub(super) fn count(&self, all: u64) -> u64 {
        let end = self.to.map_or(all, |to| all.min((to as u64).saturating_add(1)));
        end.saturating_sub(self.from as u64).div_ceil(self.every.max(1) as u64)
    }
}

/// What was read so far, and what was done to it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RecordingReport {
    /// Frames that were read.
    pub read: usize,
    /// Frames that were passed on.
    pub frames: usize,
    /// How many first frames the zeros are the mean of, if they are; of several episodes the fewest.
    pub zero_of: Option<usize>,
    /// Channels of the readings.
    pub channels: usize,
    /// Those of them that measure touches.
    pub of_touch: usize,
    /// Whether frames have a time.
    pub has_times: bool,
    /// Usual time between two frames, in s, if they have times: the median of the latest.
    pub interval: Option<f64>,
    /// Readings of matched taxels that are missing, NaN or infinite.
    pub missing: usize,
    /// How columns and taxels fit each other.
    pub join: JoinReport,
    /// What was done to the readings.
    pub condition: ConditionReport,
}

impl RecordingReport {
    /// What is not as it should be, but for [`JoinReport::remarks`], a sentence each. `zero` is the one that was
    /// asked for.
    pub fn remarks(&self, zero: Zero) -> Vec<String> {
        let Self { zero_of, missing, condition, .. } = self;
        let mut remarks = Vec::new();
        if let (Zero::First(frames), Some(of)) = (zero, *zero_of)
            && of < frames
        {
            remarks.push(format!("the zero is the mean of {of} frames, there are no {frames}"));
        }
        // Masked taxels have none either, which is expected.
        let unknown_baselines = condition.without_baseline.saturating_sub(self.join.masked * self.of_touch);
        let counts = [
            (*missing as u64, "reading", "missing, NaN or infinite, and masked"),
            (condition.clipped, "reading", "clipped"),
            (condition.too_large, "reading", "beyond the range of 32-bit floats, and masked"),
            (if self.has_times { condition.backwards } else { 0 }, "frame", "earlier than the frame before"),
            (
                unknown_baselines as u64,
                "reading",
                "without a zero, since none of the first frames has one, and masked",
            ),
            (condition.unknown_gains as u64, "gain", "of no taxel of the map"),
            (condition.faulty as u64, "taxel", "faulty, as the response says, and masked"),
            (condition.without_gain as u64, "taxel", "without a gain in the response, and masked"),
            (condition.zero.retaken, "zero", "taken again, since it was taken in contact"),
            (
                condition.zero.replaced,
                "module",
                "replaced, since connected taxels jumped at once, and has zeros of its own",
            ),
        ];
        remarks.extend(counts.into_iter().filter(|(count, ..)| *count > 0).map(|(count, thing, how)| {
            match count {
                1 => format!("1 {thing} is {how}"),
                _ => format!("{count} {thing}s are {how}"),
            }
        }));
        remarks
    }
}
