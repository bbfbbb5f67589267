//! What the columns of a text of readings are: the words of its first line.

use std::collections::HashMap;

use crate::io::IoError;
use crate::io::file::lines::LineLocation;
use crate::io::file::times::time_column;
use crate::io::file::{excerpt, invalid};
use crate::io::layout::columns::{listed, name_and_unit};
use crate::io::layout::{KnownRest, Layout, NamedColumns, Statement, StatementSource, StreamFacts, TimeUnit};
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
    /// What stands behind the separator at the end of a line: nothing.
    Empty,
    /// The number of a packet, which ascends.
    Packet,
    /// A reading, and its index in the frame: `channel * width + column`.
    Reading(usize),
}

/// The header of a file of readings.
#[derive(Default)]
pub(super) struct About {
    pub(super) ids: Option<Vec<TaxelId>>,
    pub(super) channels: Vec<Channel>,
    pub(super) width: usize,
    pub(super) frames: Option<u64>,
    pub(super) has_times: bool,
    /// How many of the units of the times in the file are a second.
    pub(super) per_second: u32,
    /// The ids that a first line of numbers alone may be; it is a frame if they are not those of a layout or a skin.
    pub(super) first_line: Option<Vec<TaxelId>>,
    /// What is known of readings where nothing touches.
    pub(super) rest: KnownRest,
    /// What else is known.
    pub(super) notes: Vec<Statement>,
    /// What a layout needs, where columns have names that are no ids.
    pub(super) named: Option<StreamFacts>,
}

impl About {
    /// What the file states, for a layout.
    pub(super) fn facts(&self) -> StreamFacts {
        if let Some(named) = &self.named {
            return named.clone();
        }
        let count = self.channels.len();
        let units: Vec<String> = self.channels.iter().map(|channel| channel.unit.clone()).collect();
        StreamFacts {
            cells: if count == 1 { vec![self.width] } else { vec![count, self.width] },
            usual_axes: if count == 1 { vec!["taxel"] } else { vec!["component", "taxel"] },
            units: if units.iter().all(String::is_empty) { Vec::new() } else { units },
            names: if count == 1 {
                Vec::new()
            } else {
                self.channels.iter().map(|c| c.name.clone()).collect()
            },
            tared: self.rest.is_zero.clone(),
            threshold: self.rest.threshold,
            time_unit: if self.has_times { TimeUnit::of(self.per_second) } else { None },
            ids: self.ids.clone(),
            notes: self.notes.clone(),
            ..StreamFacts::default()
        }
    }
}

/// Columns whose names a layout joins to taxels; `None` if it does not.
pub(super) fn named_header(
    words: &[&str],
    layout: &Layout,
    at: LineLocation<'_>,
) -> Result<Option<(Vec<Cell>, About)>, IoError> {
    let names: Vec<&str> = words.iter().map(|word| name_and_unit(word).0).collect();
    let Some(NamedColumns { ids, components, places }) = layout.named_columns(at.path, &names)? else {
        return Ok(None);
    };
    let (width, axes) = (ids.len(), layout.axes());
    let component = axes.iter().position(|axis| axis == "component");
    if axes.len() != 2 + usize::from(component.is_some()) {
        let needed = "\"frame\", an axis of taxels, and if they have several numbers \"component\"";
        return Err(invalid(layout.name(), "axes", format!("{axes:?}"), needed));
    }
    if component.is_none() && components > 1 {
        return Err(invalid(layout.name(), "axes", format!("{axes:?}"), "an axis \"component\" for them"));
    }
    let is_taxel_first = component == Some(2);
    let time = time_place(words, layout, at)?;
    let per_second = match (time.and_then(|(_, unit)| unit), layout.time_unit()) {
        (Some(unit), _) | (None, Some(unit)) => unit.in_a_second(),
        (None, None) => 1,
    };
    let mut units = vec![None; components];
    let (mut cells, mut unread) = (Vec::new(), Vec::new());
    for (k, place) in places.iter().enumerate() {
        let unit = name_and_unit(words[k]).1;
        cells.push(match *place {
            _ if time.is_some_and(|(at, _)| at == k) => Cell::Time { per_second },
            Some([component, taxel]) => {
                let first = *units[component].get_or_insert(unit);
                if first != unit {
                    let needed = format!("{first:?}, the unit given first");
                    return Err(at.invalid_part(format!("column {}", k + 1), excerpt(words[k]), needed));
                }
                Cell::Reading(if is_taxel_first {
                    taxel * components + component
                } else {
                    component * width + taxel
                })
            }
            None => {
                unread.push(words[k]);
                Cell::Unused
            }
        });
    }
    let note = || Statement::new("columns not read", listed(&unread), StatementSource::File);
    let notes = if unread.is_empty() { Vec::new() } else { vec![note()] };
    let units: Vec<String> = units.into_iter().map(|unit| unit.unwrap_or_default().to_owned()).collect();
    let facts = StreamFacts {
        cells: match component {
            None => vec![width],
            Some(_) if is_taxel_first => vec![width, components],
            Some(_) => vec![components, width],
        },
        units: if units.iter().all(String::is_empty) { Vec::new() } else { units },
        time_names: time.map(|(k, _)| names[k].to_owned()).into_iter().collect(),
        time_unit: time.and_then(|(_, unit)| unit),
        ids: Some(ids.clone()),
        has_named_columns: true,
        notes,
        ..StreamFacts::default()
    };
    let about = About {
        ids: Some(ids),
        width: width * components,
        has_times: time.is_some(),
        per_second,
        named: Some(facts),
        ..About::default()
    };
    Ok(Some((cells, about)))
}

/// The column of the times that a layout names, or that is called a time; and the unit in its name.
fn time_place(
    words: &[&str],
    layout: &Layout,
    at: LineLocation<'_>,
) -> Result<Option<(usize, Option<TimeUnit>)>, IoError> {
    let unit_of = |k: usize| TimeUnit::named(name_and_unit(words[k]).1);
    let place = match layout.time() {
        (Some(name), _) => {
            let place = words.iter().position(|word| *word == name || name_and_unit(word).0 == name);
            let needed = || format!("a column {name}, the times that {} names", layout.name().display());
            Some(place.ok_or_else(|| at.invalid(format!("columns {}", listed(words)), needed()))?)
        }
        (None, _) => words.iter().position(|word| time_column(word).is_some()),
    };
    Ok(place.map(|place| (place, unit_of(place))))
}

/// The columns of a first line of numbers alone, and the ids that they may be; empty cells are missing readings, but the
/// first, which is the name of a column of row numbers.
pub(super) fn bare_header(words: &[&str]) -> Option<(Header, Option<Vec<TaxelId>>)> {
    let numbers = words.strip_suffix(&[""]).unwrap_or(words);
    let is_number = |word: &str| word.parse::<f64>().is_ok();
    let is_bare = numbers.first().is_some_and(|word| is_number(word))
        && numbers.iter().all(|word| word.is_empty() || is_number(word));
    is_bare.then_some(())?;
    let ids = numbers.iter().map(|word| word.parse().ok().map(TaxelId)).collect();
    let cells = (0..numbers.len()).map(Cell::Reading);
    let cells = cells.chain((numbers.len()..words.len()).map(|_| Cell::Empty)).collect();
    Some((Header { width: numbers.len(), ids: None, channels: vec![Channel::default()], cells }, ids))
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
        let (name, unit) = name_and_unit(text);
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
