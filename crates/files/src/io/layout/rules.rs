//! The values of the keys of a layout.

use std::path::Path;

use serde::de::{DeserializeOwned, Error};
use serde::{Deserialize, Deserializer};
use serde_json::Value;

use crate::io::IoError;
use crate::io::file::{excerpt, invalid};
use crate::io::layout::facts::TimeUnit;
use crate::signal::ChannelKind;
use crate::skin::TaxelId;

/// A channel, and where its numbers are.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ChannelRule {
    pub(super) name: String,
    pub(super) unit: String,
    pub(super) component: Option<usize>,
    /// Whether it has both signs, as a shear; what pressing does to the number does not concern it.
    #[serde(default)]
    pub(super) signed: bool,
    /// What it measures, where name and unit do not tell.
    #[serde(default, deserialize_with = "channel_kind")]
    pub(super) kind: Option<ChannelKind>,
    /// What the numbers are multiplied by to be in its unit.
    pub(super) scale: Option<f64>,
}

impl ChannelRule {
    pub(super) const KEYS: &'static str = "a list of channels with `name` and `unit`, and if needed `component`, `signed`, `scale` and `kind` \
         (touch, tangential or other)";
}

fn channel_kind<'de, D: Deserializer<'de>>(text: D) -> Result<Option<ChannelKind>, D::Error> {
    let found = String::deserialize(text)?;
    let needed = || D::Error::custom(format!("found {found:?}; needed: touch, tangential or other"));
    found.parse().map(Some).map_err(|_| needed())
}

/// What pressing does to the number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Press {
    Raises,
    Lowers,
}

impl Press {
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Raises => "raises",
            Self::Lowers => "lowers",
        }
    }
}

/// The number at rest.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged, deny_unknown_fields)]
pub(super) enum ZeroRule {
    Number(f64),
    First { first: usize },
    Stream { stream: String },
    Word(ZeroWord),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum ZeroWord {
    Taken,
}

impl ZeroRule {
    pub(super) fn of(name: &Path, value: &Value) -> Result<Self, IoError> {
        let needed = "a number, {\"first\": N} frames with N of 1 or more, {\"stream\": NAME} or \"taken\"";
        let zero = typed(name, "zero", value, needed)?;
        match zero {
            Self::First { first: 0 } => Err(invalid(name, "zero", "first 0", needed)),
            zero => Ok(zero),
        }
    }

    pub(super) fn describe(&self) -> String {
        match self {
            Self::Number(zero) => zero.to_string(),
            Self::First { first } => format!("the mean of the first {first} frames"),
            Self::Stream { stream } => format!("the stream {stream}"),
            Self::Word(ZeroWord::Taken) => "taken: zero is subtracted already".into(),
        }
    }
}

/// When frames were taken.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum TimeRule {
    /// This many frames per second, in Hz.
    Rate(f64),
    Stream {
        stream: Option<String>,
        unit: TimeUnit,
        /// The fewest and the most frames per second.
        between: [f64; 2],
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TimeKeys {
    rate: Option<f64>,
    stream: Option<String>,
    unit: Option<TimeUnit>,
    between: Option<[f64; 2]>,
}

impl TimeRule {
    pub(super) fn of(name: &Path, value: &Value) -> Result<Self, IoError> {
        let needed = "{\"rate\": HZ}, or {\"stream\": NAME, \"unit\": \"s\", \"ms\", \"us\" or \"ns\"} and if needed \
                      \"between\": [LEAST, MOST] frames per second";
        let keys: TimeKeys = typed(name, "time", value, needed)?;
        let is_positive = |x: f64| x > 0.0 && x.is_finite();
        match keys {
            TimeKeys { rate: Some(rate), stream: None, unit: None, between: None } if is_positive(rate) => {
                Ok(Self::Rate(rate))
            }
            TimeKeys { rate: None, stream, unit: Some(unit), between } => {
                let between = between.unwrap_or([1.0, 2000.0]);
                match between {
                    [least, most] if is_positive(least) && least <= most => {
                        Ok(Self::Stream { stream, unit, between })
                    }
                    _ => Err(invalid(name, "time, between", format!("{between:?}"), needed)),
                }
            }
            _ => Err(invalid(name, "time", value.to_string(), needed)),
        }
    }
}

/// Which cell is which taxel.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum TaxelRule {
    /// A table of the columns of the axes, `taxel_id` and if needed `weight` and `gain`.
    Table(String),
    /// The file states the taxel of each cell.
    File,
    /// Ids of the cells in their order.
    Ids(Vec<TaxelId>),
    /// The name of a column has the id of its taxel: a pattern for each component.
    Columns(Vec<Pattern>),
    Grid(Grid),
}

/// A name of columns with the id of a taxel in it, as `ele{id}`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Pattern {
    before: String,
    after: String,
}

impl Pattern {
    fn parse(text: &str) -> Option<Self> {
        let (before, after) = text.split_once("{id}")?;
        let is_plain = !after.contains(['{', '}']) && !before.contains(['{', '}']);
        is_plain.then(|| Self { before: before.trim_start().into(), after: after.trim_end().into() })
    }

    /// The id in a name.
    pub(super) fn id_in(&self, name: &str) -> Option<TaxelId> {
        let digits = name.strip_prefix(&self.before)?.strip_suffix(&self.after)?;
        digits.bytes().all(|b| b.is_ascii_digit()).then_some(())?;
        digits.parse().ok().map(TaxelId)
    }
}

impl std::fmt::Display for Pattern {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}{{id}}{}", self.before, self.after)
    }
}

/// Ids that count through a grid of cells.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Grid {
    /// The cells of a frame, as the file has them.
    pub(super) shape: Vec<usize>,
    #[serde(default = "one")]
    pub(super) first_id: u32,
    /// Whether ids count down the last axis but one first.
    #[serde(default)]
    pub(super) transpose: bool,
    /// By how many degrees the ids are turned in the plane of the last two axes, counter-clockwise, as `numpy.rot90` does.
    #[serde(default)]
    pub(super) rotate: u32,
    /// The axes along which ids count backwards.
    pub(super) flip: Option<Vec<String>>,
}

fn one() -> u32 {
    1
}

impl TaxelRule {
    /// What it calls columns.
    pub(super) fn describe(&self) -> String {
        match self {
            Self::Columns(patterns) => {
                patterns.iter().map(ToString::to_string).collect::<Vec<_>>().join(" or ")
            }
            Self::Table(table) => format!("as in {table}"),
            _ => "by the ids of taxels".into(),
        }
    }

    pub(super) fn of(name: &Path, value: &Value) -> Result<Self, IoError> {
        let needed = "the name of a table (.csv), {\"ids\": \"file\"}, {\"ids\": [...]}, {\"columns\": \"NAME{id}\"}, or \
                      {\"shape\": [...]} and if needed `first_id`, `flip`, `transpose` and `rotate` (90, 180 or 270)";
        if let Value::String(table) = value {
            return Ok(Self::Table(table.clone()));
        }
        if let Some(ids) = value.get("ids") {
            let is_alone = value.as_object().is_some_and(|keys| keys.len() == 1);
            return match (is_alone, ids) {
                (true, Value::String(word)) if word == "file" => Ok(Self::File),
                (true, Value::Array(_)) => {
                    let ids: Vec<u32> = typed(name, "taxels, ids", ids, "ids of taxels, 0 to 4294967295")?;
                    Ok(Self::Ids(ids.into_iter().map(TaxelId).collect()))
                }
                _ => Err(invalid(name, "taxels", value.to_string(), needed)),
            };
        }
        if let Some(columns) = value.get("columns") {
            let texts = match columns {
                Value::String(one) => vec![one.as_str()],
                Value::Array(all) => all.iter().map(|text| text.as_str().unwrap_or_default()).collect(),
                _ => Vec::new(),
            };
            let patterns: Option<Vec<Pattern>> = texts.iter().map(|text| Pattern::parse(text)).collect();
            let is_alone = value.as_object().is_some_and(|keys| keys.len() == 1);
            let patterns = patterns.filter(|patterns| is_alone && !patterns.is_empty());
            return patterns.map(Self::Columns).ok_or_else(|| {
                let needed = "the name of a column with {id} for the number of its taxel, as \"ele{id}\"; for several \
                              components a list, as [\"p{id}_x\", \"p{id}_y\"]";
                invalid(name, "taxels, columns", excerpt(&value.to_string()), needed)
            });
        }
        let grid: Grid = typed(name, "taxels", value, needed)?;
        let flips = grid.flip.as_deref().unwrap_or_default();
        if let Some((_, axis)) = flips.iter().enumerate().find(|(k, axis)| flips[..*k].contains(axis)) {
            return Err(invalid(name, "taxels, flip", format!("{axis:?} again"), "each axis once"));
        }
        match grid.rotate {
            0 | 90 | 180 | 270 => Ok(Self::Grid(grid)),
            other => Err(invalid(name, "taxels, rotate", other.to_string(), needed)),
        }
    }
}

/// The value of a key as a type; `needed` is what an error states as needed.
pub(super) fn typed<T: DeserializeOwned>(
    name: &Path,
    key: &str,
    value: &Value,
    needed: &str,
) -> Result<T, IoError> {
    T::deserialize(value).map_err(|e| {
        let found = format!("{} ({e})", excerpt(&value.to_string()));
        invalid(name, key, found, needed)
    })
}
