//! What the columns of a text of readings are: the words of its first line.

use std::collections::HashMap;

use crate::io::IoError;
use crate::io::file::excerpt;
use crate::io::file::lines::LineLocation;
use crate::io::file::times::time_column;
use crate::signal::{Channel, SignalError, unit_ratio};
use crate::skin::TaxelId;

/// What the first line of a text of readings may be, for messages.
pub(super) const SHAPES: &str = "a first line that names a column for each taxel, as `time,7,9` or \
                                 `time,7.force[N],9.force[N]`, or in a file `time,taxel_id,value`; cells \
                                 between commas, semicolons or tabs, numbers with a decimal point";

/// Most numbers of a frame: with more, a file is not what it seems.
pub(super) const MAX_NUMBERS: usize = 1 << 24;

/// What stands in one cell of each row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cell {
    /// The time, in this fraction of a second.
    Time { per_second: u32 },
    /// A frame number, or another cell that is not read.
    Unused,
    /// A reading, and its index in the frame: `channel * width + column`.
    Reading(usize),
}

/// The header of a file of readings.
pub(super) struct About {
    pub(super) ids: Option<Vec<TaxelId>>,
    pub(super) channels: Vec<Channel>,
    pub(super) width: usize,
    pub(super) frames: Option<u64>,
    pub(super) has_times: bool,
}

/// The columns of a text of readings.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Header {
    /// Number of columns of each channel.
    pub(super) width: usize,
    /// The id of each column; `None` if they are all taxels in their order.
    pub(super) ids: Option<Vec<TaxelId>>,
    pub(super) channels: Vec<Channel>,
    pub(super) cells: Vec<Cell>,
}

/// The columns that the words of a first line name: `time` (in s, or in `time[ms]`, `[us]` or
/// `[ns]`), `frame` or `index`, and `ID`,
/// `ID.CHANNEL` or `ID.CHANNEL[UNIT]`. With `leading`, rows have a number and a time before the
/// readings that the line does not name, unless it names a time itself.
///
/// An id that comes twice with the same channel is another column. Names without ids, `.CHANNEL`, are
/// all taxels in their order.
pub(super) fn parse_header<'t>(
    words: impl Iterator<Item = &'t str>,
    leading: bool,
    at: LineLocation<'_>,
) -> Result<Header, IoError> {
    let mut columns = HeaderColumns::default();
    let mut meanings = Vec::new();
    for (k, word) in words.enumerate() {
        let column = || format!("column {}", k + 1);
        if let Some(per_second) = time_column(word) {
            if meanings.iter().any(Meaning::is_time) {
                return Err(at.invalid_part(column(), "a second time", "one time"));
            }
            let per_second = per_second.map_err(|needed| at.invalid_part(column(), excerpt(word), needed))?;
            meanings.push(Meaning::Time { per_second });
            continue;
        }
        match word.split('[').next().unwrap_or_default().trim().to_ascii_lowercase().as_str() {
            "" | "frame" | "index" => meanings.push(Meaning::Unused),
            _ => meanings.push(columns.reading(word).map_err(|e| match e {
                Broken::NotAnId => at.invalid_part(column(), excerpt(word), SHAPES),
                Broken::Channel(error) => at.invalid_part(column(), excerpt(word), error.to_string()),
                Broken::Unit { first } => {
                    at.invalid_part(column(), excerpt(word), format!("{first:?}, the unit given first"))
                }
            })?),
        }
    }
    if columns.ids.is_empty() {
        return Err(at.invalid("no taxel id", SHAPES));
    }
    if columns.has_ids && columns.lacks_ids {
        return Err(at.invalid("columns with and without an id", SHAPES));
    }
    let (width, channels) = (columns.ids.len(), columns.channels.len());
    if width.saturating_mul(channels) > MAX_NUMBERS {
        let found = format!("{width} taxels and {channels} channels");
        return Err(at.invalid(found, format!("at most {MAX_NUMBERS} readings in a frame")));
    }
    if leading && !meanings.iter().any(Meaning::is_time) {
        meanings.splice(0..0, [Meaning::Unused, Meaning::Time { per_second: 1 }]);
    }
    let cell = |meaning: Meaning| match meaning {
        Meaning::Time { per_second } => Cell::Time { per_second },
        Meaning::Unused => Cell::Unused,
        Meaning::Reading { channel, column } => Cell::Reading(channel * width + column),
    };
    let cells = meanings.into_iter().map(cell).collect();
    let ids = columns.has_ids.then_some(columns.ids);
    Ok(Header { width, ids, channels: columns.channels, cells })
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Meaning {
    Time { per_second: u32 },
    Unused,
    Reading { channel: usize, column: usize },
}

impl Meaning {
    const fn is_time(&self) -> bool {
        matches!(self, Self::Time { .. })
    }
}

enum Broken {
    NotAnId,
    Unit { first: String },
    Channel(SignalError),
}

/// Columns and channels in the order in which they first come.
#[derive(Default)]
struct HeaderColumns {
    ids: Vec<TaxelId>,
    channels: Vec<Channel>,
    /// The column of the n-th time that an id comes with the same channel.
    column_of: HashMap<(TaxelId, usize), usize>,
    /// How often an id came with a channel.
    seen: HashMap<(TaxelId, usize), usize>,
    channel_of: HashMap<String, usize>,
    has_ids: bool,
    lacks_ids: bool,
}

impl HeaderColumns {
    fn reading(&mut self, word: &str) -> Result<Meaning, Broken> {
        let (id, channel) = word.split_once('.').map_or((word, ""), |(id, channel)| (id, channel.trim()));
        // `0.25` is a number of a file without a line of ids.
        if channel.starts_with(|c: char| c.is_ascii_digit()) {
            return Err(Broken::NotAnId);
        }
        let lacks_id = id.trim().is_empty() && !channel.is_empty();
        *(if lacks_id { &mut self.lacks_ids } else { &mut self.has_ids }) = true;
        let id = if lacks_id { 0 } else { id.trim().parse().map_err(|_| Broken::NotAnId)? };
        let id = TaxelId(id);
        let channel = self.channel(channel)?;
        let nth = self.seen.entry((id, channel)).or_default();
        let column = *self.column_of.entry((id, *nth)).or_insert_with(|| {
            self.ids.push(id);
            self.ids.len() - 1
        });
        *nth += 1;
        Ok(Meaning::Reading { channel, column })
    }

    /// The channel that `NAME` or `NAME[UNIT]` means; without a name the default one.
    fn channel(&mut self, text: &str) -> Result<usize, Broken> {
        let (name, unit) = match text.strip_suffix(']').and_then(|t| t.split_once('[')) {
            Some((name, unit)) => (name.trim(), unit.trim()),
            None => (text, ""),
        };
        if let Some(&known) = self.channel_of.get(name) {
            let first = &self.channels[known].unit;
            return if unit_ratio(first, unit) == Some(1.0) {
                Ok(known)
            } else {
                Err(Broken::Unit { first: first.clone() })
            };
        }
        self.channels.push(Channel::new(name, unit).map_err(Broken::Channel)?);
        self.channel_of.insert(name.into(), self.channels.len() - 1);
        Ok(self.channels.len() - 1)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn header(text: &str, leading: bool) -> Result<Header, String> {
        let at = LineLocation { path: Path::new("a.csv"), line: 1 };
        parse_header(text.split(','), leading, at).map_err(|e| e.to_string())
    }

    #[test]
    fn channels_and_columns_keep_their_order() {
        use Cell::{Reading, Time, Unused};
        let found = header("frame,Time [s],7.force.N[N],9.force.N[N],9.heat,7.force.N[N]", false).unwrap();
        assert_eq!(found.ids.unwrap(), [7, 9, 7].map(TaxelId), "an id twice is two columns");
        let names: Vec<_> = found.channels.iter().map(|c| (c.name.as_str(), c.unit.as_str())).collect();
        assert_eq!(names, [("force.N", "N"), ("heat", "")]);
        let time = |per_second| Time { per_second };
        assert_eq!(found.cells, [Unused, time(1), Reading(0), Reading(1), Reading(4), Reading(2)]);
        let found = header(".force[N],.heat,.force[N],.heat", false).unwrap();
        assert_eq!((found.ids, found.width), (None, 2), "two taxels in their order");
        assert_eq!(found.cells, [Reading(0), Reading(2), Reading(1), Reading(3)]);
        assert_eq!(header("5,6", true).unwrap().cells, [Unused, time(1), Reading(0), Reading(1)]);
        assert_eq!(header("timestamp[ms],5", false).unwrap().cells, [time(1000), Reading(0)]);
        assert_eq!(header("5,6", false).unwrap().cells, [Reading(0), Reading(1)]);
    }

    #[test]
    fn lines_that_name_no_taxels_are_refused() {
        for (text, place) in [
            ("time,frame", "no taxel id"),
            ("time,left", "column 2"),
            ("0,0.5,17", "column 2"),
            ("5.force,.force", "with and without"),
            ("-1", "\"-1\""),
            ("4294967296", "column 1"),
            ("time,5,time", "column 3: found a second time"),
            ("5,time[min]", "column 2: found \"time[min]\""),
            ("5.force[N],6.force[mN]", "\"N\", the unit"),
        ] {
            let error = header(text, false).unwrap_err();
            assert!(error.contains(place) && error.contains("line 1"), "{text}: {error}");
        }
    }
}
