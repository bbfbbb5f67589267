//! What is known about a recording, and by whom.

use serde::Deserialize;

use crate::signal::Channel;
use crate::skin::TaxelId;

/// Something that is known about a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Statement {
    /// What it is about, as `unit` or `zero`.
    pub what: String,
    /// What is stated.
    pub value: String,
    /// Who states it.
    pub source: StatementSource,
}

impl Statement {
    /// A statement.
    pub fn new(what: impl Into<String>, value: impl Into<String>, source: StatementSource) -> Self {
        Self { what: what.into(), value: value.into(), source }
    }
}

/// Who makes a statement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, strum::IntoStaticStr)]
#[strum(serialize_all = "lowercase")]
pub enum StatementSource {
    /// The file of the recording.
    File,
    /// The layout.
    #[default]
    Layout,
    /// An option or an argument.
    Argument,
    /// It follows from the numbers themselves.
    Checked,
}

/// What a file states about a stream of frames.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StreamFacts {
    /// The name of the stream; empty if it has none.
    pub stream: String,
    /// The shape of one frame, without the axis of frames.
    pub cells: Vec<usize>,
    /// The names of these axes; none if the file does not name them.
    pub axes: Vec<String>,
    /// What these axes are usually called, for drafts.
    pub usual_axes: Vec<&'static str>,
    /// The unit of all readings, or one for each component; none if the file does not state it, empty where it does not.
    pub units: Vec<String>,
    /// The names of the components; none if the file does not state them.
    pub names: Vec<String>,
    /// Whether the zero is subtracted already: of all components, or of each; none: the file does not state it.
    pub tared: Vec<bool>,
    /// Whether its numbers are floats of 16 bits, to which numbers of `missing` are rounded.
    pub has_halves: bool,
    /// Whether the units follow from sums in the file, and are not written in it.
    pub has_checked_units: bool,
    /// Frames per second.
    pub rate_hz: Option<f64>,
    /// What the times are called; none: by any name.
    pub time_names: Vec<String>,
    /// The unit of the times.
    pub time_unit: Option<TimeUnit>,
    /// The taxel of each cell.
    pub ids: Option<Vec<TaxelId>>,
    /// Whether these are of columns that a layout found by their names.
    pub has_named_columns: bool,
    /// What names of columns are alike, for drafts, with `{id}` for a number.
    pub columns: Vec<String>,
    /// The id of the first cell, for drafts; none: 1.
    pub first_id: Option<u32>,
    /// Whether there is a sensor in each cell; none: in all.
    pub sensors: Vec<bool>,
    /// The level of each number of a frame at rest, where a layout takes it from another stream.
    pub zero: Option<Vec<f64>>,
    /// The number above which a cell is loaded.
    pub threshold: Option<f64>,
    /// Whether its numbers are pressures, so that pressing raises the numbers and zero is no pressure.
    pub has_pressures: bool,
    /// Whether rows or columns may be stored mirrored: a layout has to state which are flipped.
    pub may_be_mirrored: bool,
    /// What else the file states.
    pub notes: Vec<Statement>,
}

/// What is known of readings where nothing touches.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct KnownRest {
    /// Of each channel whether they are about 0: its zero is stated and it is a pressure or force, or one is subtracted already;
    /// empty: of none.
    pub is_zero: Vec<bool>,
    /// The reading above which a taxel is loaded, in the unit of the first channel that is of touch.
    pub threshold: Option<f64>,
}

impl KnownRest {
    /// Readings that are about 0 in all channels that measure touches.
    pub fn tared(channels: &[Channel]) -> Self {
        Self { is_zero: channels.iter().map(|channel| channel.kind.is_of_touch()).collect(), threshold: None }
    }

    /// Whether readings of a channel are about 0.
    pub fn is_zero_in(&self, channel: usize) -> bool {
        self.is_zero.get(channel).copied().unwrap_or(false)
    }
}

/// What times are counted in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, strum::IntoStaticStr, strum::EnumString)]
pub enum TimeUnit {
    /// Seconds.
    #[serde(rename = "s")]
    #[strum(serialize = "s")]
    Seconds,
    /// Milliseconds.
    #[serde(rename = "ms")]
    #[strum(serialize = "ms")]
    Milliseconds,
    /// Microseconds.
    #[serde(rename = "us")]
    #[strum(serialize = "us")]
    Microseconds,
    /// Nanoseconds.
    #[serde(rename = "ns")]
    #[strum(serialize = "ns")]
    Nanoseconds,
}

impl TimeUnit {
    /// Its name in a layout.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The unit of this name.
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "\u{b5}s" | "\u{3bc}s" => Some(Self::Microseconds),
            name => name.parse().ok(),
        }
    }

    /// The unit of which this many are a second.
    pub(in crate::io) fn of(per_second: u32) -> Option<Self> {
        let all = [Self::Seconds, Self::Milliseconds, Self::Microseconds, Self::Nanoseconds];
        all.into_iter().find(|unit| unit.per_second() == i64::from(per_second))
    }

    /// How many of them are a second.
    pub(in crate::io) fn in_a_second(self) -> u32 {
        u32::try_from(self.per_second()).unwrap_or(u32::MAX)
    }

    pub(super) const fn per_second(self) -> i64 {
        match self {
            Self::Seconds => 1,
            Self::Milliseconds => 1000,
            Self::Microseconds => 1_000_000,
            Self::Nanoseconds => 1_000_000_000,
        }
    }
}

/// The times of some frames, as a file has them.
#[derive(Debug, Clone, Copy)]
pub enum Times<'a> {
    /// There are none.
    None,
    /// Whole numbers of the unit of the layout. Seconds are counted from the first one of an episode.
    Whole(&'a [i64]),
    /// Numbers of the unit of the layout.
    Real(&'a [f64]),
}
