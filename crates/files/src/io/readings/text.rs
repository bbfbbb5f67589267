//! Readings as lines of numbers, with names in the first or without: CySkin's text (`index time value...` below a line of ids), logs of YARP, CSV; and
//! as a long table, `time,taxel_id,value`, with a row for each reading, sorted by time. The rows of one time are a frame there.
//!
//! A row is read as soon as its line has ended, so that a pipe delivers frame by frame. Which taxels a
//! long table has is known at its end only: a file is read twice, and a stream is refused.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use crate::io::IoError;
use crate::io::file::lines::{LineLocation, Lines, POINT_NEEDED, has_decimal_comma};
use crate::io::file::times::{seconds, time_column};
use crate::io::file::{cannot_read, excerpt};
use crate::io::layout::columns::listed;
use crate::io::layout::{KnownRest, Layout, Statement, StatementSource, StreamFacts};
use crate::io::readings::arrays::{REST, stated_rest};
use crate::io::readings::header::{
    About, Cell, Header, MAX_NUMBERS, SHAPES, bare_header, named_header, parse_header,
};
use crate::io::table::cells::{Cells, Separator};
use crate::signal::Channel;
use crate::skin::TaxelId;

/// Longest line, in bytes: half a million numbers. Without a bound, a stream that never ends its
/// line would fill the memory.
const LONGEST_LINE: usize = 1 << 24;

pub(super) struct TextLines {
    lines: Lines<BufReader<Box<dyn Read + Send>>>,
    separator: Separator,
    pub(super) words: Cells,
    /// The lines with `#` above the names of the columns.
    comments: Vec<String>,
}

impl TextLines {
    /// Reads the first line; errors call the text `path`. Cells are between commas if there are any
    /// in that line, else between semicolons, else between tabs if it is a `.csv` or names a time, else between blanks.
    pub(super) fn open(path: &Path, input: Box<dyn Read + Send>, is_csv: bool) -> Result<Self, IoError> {
        let mut lines = Lines::new(BufReader::with_capacity(1 << 16, input), path, Some(b'#'));
        lines.longest = LONGEST_LINE;
        lines.kept_comments = Some(Vec::new());
        lines.advance()?;
        let comments = lines.kept_comments.take().unwrap_or_default();
        let Some((line, _)) = lines.current()? else {
            return Err(lines.at().invalid("an empty file", SHAPES));
        };
        // Names stand between tabs in a table of them; the ids of CySkin's text have neither a time nor tabs.
        let has_tabs =
            is_csv || line.split('\t').any(|name| name.trim().to_ascii_lowercase().starts_with("time"));
        let signs = if has_tabs { &[',', ';', '\t'][..] } else { &[',', ';'] };
        let other = if is_csv { Separator::Sign(',') } else { Separator::Blanks };
        let separator = Separator::of(line, signs).unwrap_or(other);
        let mut words = Cells::default();
        words.split(line, separator, true);
        Ok(Self { lines, separator, words, comments })
    }

    /// What lines `# is_tared: 1` and `# threshold: X` above the names state of readings where nothing touches; other lines with
    /// `#` are comments.
    fn rest(&self, channels: &[Channel]) -> (KnownRest, Vec<Statement>) {
        let mut rest = KnownRest::default();
        for line in &self.comments {
            let Some((key, value)) = line.trim_start_matches('#').split_once(':') else { continue };
            match (key.trim(), value.trim()) {
                (key, "1") if key == REST[0] => rest.is_zero = KnownRest::tared(channels).is_zero,
                (key, value) if key == REST[1] => {
                    rest.threshold = value.parse().ok().filter(|x: &f64| x.is_finite() && *x > 0.0);
                }
                _ => {}
            }
        }
        stated_rest(rest, channels)
    }

    /// Takes the next line; false after the last one.
    pub(super) fn advance(&mut self) -> Result<bool, IoError> {
        self.lines.advance()?;
        let Some((line, _)) = self.lines.current()? else { return Ok(false) };
        self.words.split(line, self.separator, true);
        Ok(true)
    }

    pub(super) fn at(&self) -> LineLocation<'_> {
        self.lines.at()
    }
}

/// Whether the second line of a file has as many words as the first: no line of ids, which are fewer.
pub(super) fn has_row_first(path: &Path, is_csv: bool) -> Result<bool, IoError> {
    let file = File::open(path).map_err(cannot_read(path))?;
    let mut lines = TextLines::open(path, Box::new(file), is_csv)?;
    let count = lines.words.len();
    Ok(lines.advance()? && lines.words.len() == count)
}

/// Lines of a file that are neither blank nor comments.
pub(super) fn count_rows(path: &Path) -> Result<u64, IoError> {
    let file = File::open(path).map_err(cannot_read(path))?;
    let mut lines = Lines::new(BufReader::with_capacity(1 << 16, file), path, Some(b'#'));
    lines.longest = LONGEST_LINE;
    let mut count = 0;
    loop {
        lines.advance()?;
        if lines.has_ended() {
            return Ok(count);
        }
        count += 1;
    }
}

pub(super) struct TextReadings {
    lines: TextLines,
    cells: Vec<Cell>,
    numbers: usize,
    has_rows: bool,
    /// Whether the line read last is a row that is still to be taken.
    is_ahead: bool,
    /// The number of the last packet, and how many are missing.
    packet: Option<i64>,
    lost: i64,
}

/// How the first line of a text is read.
#[derive(Clone, Copy, Default)]
pub(super) struct FirstLine<'a> {
    /// Whether cells are between commas, whatever the line has.
    pub(super) is_csv: bool,
    /// Whether the first line has numbers as all others do, so that it may be a frame.
    pub(super) is_row: bool,
    pub(super) layout: Option<&'a Layout>,
    /// Whether it is read for a draft of a layout.
    pub(super) is_draft: bool,
}

impl TextReadings {
    /// Reads the first line; errors call the text `path`.
    pub(super) fn open(
        path: &Path,
        input: Box<dyn Read + Send>,
        how: FirstLine<'_>,
    ) -> Result<(Self, About), IoError> {
        let lines = TextLines::open(path, input, how.is_csv)?;
        let words: Vec<&str> = lines.words.iter().collect();
        if let Some(layout) = how.layout
            && let Some((cells, about)) = named_header(&words, layout, lines.at())?
        {
            let numbers = about.width;
            return Ok((Self::of(lines, cells, numbers), about));
        }
        let leading = lines.separator == Separator::Blanks;
        if let Some((Header { width, channels, cells, .. }, first_line)) =
            bare_header(&words).filter(|_| how.is_row || !leading)
        {
            let (rest, notes) = lines.rest(&channels);
            let about = About { channels, width, first_line, rest, notes, ..About::default() };
            return Ok((Self { is_ahead: true, ..Self::of(lines, cells, width) }, about));
        }
        let header = parse_header(words.iter().copied(), leading, lines.at());
        if header.is_err()
            && how.is_draft
            && let named @ Some(_) = StreamFacts::of_columns(&words)
        {
            return Ok((Self::of(lines, Vec::new(), 0), About { named, ..About::default() }));
        }
        let Header { width, ids, channels, cells } = header?;
        let time = cells.iter().find_map(|cell| match cell {
            Cell::Time { per_second } => Some(*per_second),
            _ => None,
        });
        let (has_times, per_second) = (time.is_some(), time.unwrap_or(1));
        let numbers = width * channels.len();
        let (rest, notes) = lines.rest(&channels);
        let about = About { ids, channels, width, has_times, per_second, rest, notes, ..About::default() };
        Ok((Self::of(lines, cells, numbers), about))
    }

    fn of(lines: TextLines, cells: Vec<Cell>, numbers: usize) -> Self {
        Self { lines, cells, numbers, has_rows: false, is_ahead: false, packet: None, lost: 0 }
    }

    /// Takes the first line for ids.
    pub(super) fn skip_first(&mut self) {
        self.is_ahead = false;
    }

    /// Whether the first line is a frame.
    pub(super) fn is_ahead(&self) -> bool {
        self.is_ahead
    }

    /// An error about a first line that may be ids or a frame.
    pub(super) fn ambiguous(&self) -> IoError {
        let needed = "a first line of names, as `time,7,9`; or a layout, whose `taxels` are {\"ids\": \"file\"} or a shape";
        self.lines.at().invalid("numbers alone, which may be ids of taxels or a frame", needed)
    }

    /// How many packets are missing by their numbers.
    pub(super) fn lost(&self) -> i64 {
        self.lost
    }

    /// Reads the first row of a log of `yarpdatadumper`: rows of `number time value...`, the values of all taxels in
    /// their order.
    pub(super) fn open_log(path: &Path, input: Box<dyn Read + Send>) -> Result<(Self, About), IoError> {
        let lines = TextLines::open(path, input, false)?;
        let width = lines.words.len().saturating_sub(2);
        if width == 0 || lines.words.iter().any(|word| word.parse::<f64>().is_err()) {
            let needed = "rows of numbers, `number time value...`, as yarpdatadumper writes them";
            let words: Vec<&str> = lines.words.iter().collect();
            return Err(lines.at().invalid(excerpt(&words.join(" ")), needed));
        }
        let cells = [Cell::Packet, Cell::Time { per_second: 1 }].into_iter();
        let cells = cells.chain((0..width).map(Cell::Reading)).collect();
        let channels = vec![Channel::default()];
        let about = About { channels, width, has_times: true, per_second: 1, ..About::default() };
        Ok((Self { is_ahead: true, ..Self::of(lines, cells, width) }, about))
    }

    /// Reads the next row; false after the last one.
    pub(super) fn read(&mut self, values: &mut Vec<f64>, time: &mut f64) -> Result<bool, IoError> {
        if !std::mem::take(&mut self.is_ahead) && !self.lines.advance()? {
            return match self.has_rows {
                true => Ok(false),
                false => {
                    Err(self.lines.at().invalid("no row of readings", "at least one below the line of ids"))
                }
            };
        }
        self.has_rows = true;
        values.clear();
        values.resize(self.numbers, f64::NAN);
        *time = f64::NAN;
        let packet = take_row(&self.cells, self.lines.words.iter(), self.lines.at(), values, time)?;
        if let (Some(number), Some(last)) = (packet, self.packet) {
            if number <= last {
                let found = format!("packet {number} after {last}");
                return Err(self.lines.at().invalid_part("column 1", found, "ascending numbers of packets"));
            }
            self.lost = self.lost.saturating_add(number.saturating_sub(last).saturating_sub(1));
        }
        self.packet = packet.or(self.packet);
        Ok(true)
    }
}

/// Puts the cells of a row where they belong, and returns the number of its packet.
fn take_row<'t>(
    cells: &[Cell],
    mut words: impl Iterator<Item = &'t str>,
    at: LineLocation<'_>,
    values: &mut [f64],
    time: &mut f64,
) -> Result<Option<i64>, IoError> {
    let mut packet = None;
    let wrong =
        |found: usize| at.invalid(format!("{found} cells"), format!("{}, as in the first line", cells.len()));
    for (k, cell) in cells.iter().enumerate() {
        let word = words.next().ok_or_else(|| wrong(k))?;
        let invalid = |needed: &str| at.invalid_part(format!("column {}", k + 1), excerpt(word), needed);
        match *cell {
            Cell::Unused => {}
            Cell::Empty if word.is_empty() => {}
            Cell::Empty => return Err(invalid("nothing, as behind the last separator of the first line")),
            Cell::Packet => {
                packet = Some(word.parse().map_err(|_| invalid("the number of a packet"))?);
            }
            Cell::Time { per_second } => *time = seconds(word, per_second).map_err(invalid)?,
            Cell::Reading(place) => {
                values[place] = reading(word).map_err(invalid)?;
            }
        }
    }
    match words.count() {
        0 => Ok(packet),
        more => Err(wrong(cells.len() + more)),
    }
}

/// A reading, NaN where there is none; an error states what is needed.
fn reading(word: &str) -> Result<f64, &'static str> {
    let needed = if has_decimal_comma(word) { POINT_NEEDED } else { "a number, NaN or nothing" };
    if word.is_empty() { Ok(f64::NAN) } else { word.parse().map_err(|_| needed) }
}

/// A long table that is read frame by frame.
pub(super) struct LongReadings {
    rows: TextRows,
    columns: HashMap<TaxelId, usize>,
    /// The first row of the next frame.
    ahead: Option<Reading>,
}

#[derive(Clone, Copy)]
struct Reading {
    time: f64,
    id: TaxelId,
    value: f64,
}

struct TextRows {
    lines: TextLines,
    /// Indices of the columns, and the unit of time.
    time: usize,
    per_second: u32,
    id: usize,
    value: usize,
    cells: usize,
    /// The column that says of which device a taxel is, and the names of all that are not read.
    device: Option<usize>,
    unread: Vec<String>,
}

/// What a column of a long table is called that says of which device a reading is.
const DEVICES: [&str; 11] = [
    "device",
    "device_id",
    "sensor",
    "sensor_id",
    "board",
    "board_id",
    "node",
    "port",
    "side",
    "hand",
    "foot",
];

impl LongReadings {
    /// Opens a file if the names in its first line are those of a long table.
    pub(super) fn open(path: &Path, is_csv: bool) -> Result<Option<(Self, About)>, IoError> {
        let Some((mut rows, channel)) = TextRows::open(path, is_csv)? else { return Ok(None) };
        // In the order in which they first come.
        let (mut ids, mut columns) = (Vec::new(), HashMap::new());
        let mut devices: HashMap<TaxelId, String> = HashMap::new();
        while let Some(Reading { id, .. }) = rows.next()? {
            if let Some(column) = rows.device {
                let device = rows.lines.words.get(column).unwrap_or_default();
                let first = devices.entry(id).or_insert_with(|| device.to_owned());
                if first != device {
                    let found = format!("taxel {id} of {} after {}", excerpt(device), excerpt(first));
                    let needed = "taxels of one device, or ids of their own: write a table for each device";
                    return Err(rows.lines.at().invalid_part(
                        format!("column {}", column + 1),
                        found,
                        needed,
                    ));
                }
            }
            columns.entry(id).or_insert_with(|| {
                ids.push(id);
                ids.len() - 1
            });
            if ids.len() > MAX_NUMBERS {
                let needed = format!("at most {MAX_NUMBERS} taxels");
                return Err(rows.lines.at().invalid(format!("{} taxels", ids.len()), needed));
            }
        }
        if ids.is_empty() {
            return Err(rows.lines.at().invalid("no row of readings", "at least one below the names"));
        }
        let Some((mut rows, _)) = TextRows::open(path, is_csv)? else { return Ok(None) };
        let ahead = rows.next()?;
        let (width, ids, channels) = (ids.len(), Some(ids), vec![channel]);
        let unread: Vec<&str> = rows.unread.iter().map(String::as_str).collect();
        let note = || Statement::new("columns not read", listed(&unread), StatementSource::File);
        let (rest, mut notes) = rows.lines.rest(&channels);
        notes.extend((!unread.is_empty()).then(note));
        let per_second = rows.per_second;
        let about =
            About { ids, channels, width, has_times: true, per_second, rest, notes, ..About::default() };
        Ok(Some((Self { rows, columns, ahead }, about)))
    }

    /// Reads the next frame; false after the last one.
    pub(super) fn read(&mut self, values: &mut Vec<f64>, time: &mut f64) -> Result<bool, IoError> {
        let Some(first) = self.ahead.take() else { return Ok(false) };
        values.clear();
        values.resize(self.columns.len(), f64::NAN);
        *time = first.time;
        let mut seen = vec![false; self.columns.len()];
        let mut row = Some(first);
        while let Some(reading) = row.filter(|reading| reading.time == first.time) {
            let Some(&column) = self.columns.get(&reading.id) else {
                return Err(self
                    .rows
                    .lines
                    .at()
                    .invalid("a new taxel", "a file that does not change while it is read"));
            };
            if std::mem::replace(&mut seen[column], true) {
                let found = format!("taxel {} again at the time {} s", reading.id, first.time);
                return Err(self.rows.lines.at().invalid(found, "one reading of a taxel at a time"));
            }
            values[column] = reading.value;
            row = self.rows.next()?;
        }
        if let Some(next) = row.filter(|next| next.time < first.time) {
            let found = format!("the time {} s after {} s", next.time, first.time);
            return Err(self.rows.lines.at().invalid(found, "rows sorted by time"));
        }
        self.ahead = row;
        Ok(true)
    }
}

impl TextRows {
    fn open(path: &Path, is_csv: bool) -> Result<Option<(Self, Channel)>, IoError> {
        let file = File::open(path).map_err(cannot_read(path))?;
        let lines = TextLines::open(path, Box::new(file), is_csv)?;
        let names: Vec<String> = lines.words.iter().map(str::to_ascii_lowercase).collect();
        let find = |known: &[&str]| {
            names.iter().position(|name| known.contains(&name.split('[').next().unwrap_or_default().trim()))
        };
        let mut times = names.iter().enumerate().filter_map(|(k, name)| Some((k, time_column(name)?.ok()?)));
        let places = [find(&["taxel_id", "taxel", "id"]), find(&["value"])];
        let (Some((time, per_second)), [Some(id), Some(value)]) = (times.next(), places) else {
            return Ok(None);
        };
        let name = lines.words.get(value).unwrap_or_default();
        let unit = name.split_once('[').map_or("", |(_, unit)| unit.trim_end_matches(']').trim());
        let channel = Channel::new("", unit).map_err(|e| lines.at().invalid(excerpt(name), e.to_string()))?;
        let is_read = |k: usize| [time, id, value].contains(&k);
        let is_counter = |name: &str| ["", "frame", "index"].contains(&name);
        let unread = lines.words.iter().zip(&names).enumerate();
        let unread = unread.filter(|(k, (_, lower))| !is_read(*k) && !is_counter(lower));
        let unread = unread.map(|(_, (name, _))| name.to_owned()).collect();
        let device = find(&DEVICES).filter(|k| !is_read(*k));
        Ok(Some((Self { time, per_second, id, value, cells: names.len(), device, unread, lines }, channel)))
    }

    fn next(&mut self) -> Result<Option<Reading>, IoError> {
        if !self.lines.advance()? {
            return Ok(None);
        }
        let (words, at) = (&self.lines.words, self.lines.at());
        if words.len() != self.cells {
            let needed = format!("{}, as the first line has", self.cells);
            return Err(at.invalid(format!("{} cells", words.len()), needed));
        }
        let word = |k| words.get(k).unwrap_or_default();
        let wrong = |k: usize, needed| at.invalid_part(format!("column {}", k + 1), excerpt(word(k)), needed);
        let value = reading(word(self.value)).map_err(|needed| wrong(self.value, needed))?;
        let time = seconds(word(self.time), self.per_second).map_err(|needed| wrong(self.time, needed))?;
        Ok(Some(Reading { time, id: at.taxel(word(self.id))?, value }))
    }
}
