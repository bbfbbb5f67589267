//! Readings as lines of numbers: CySkin's text (`index time value...` below a line of ids), logs of YARP, CSV; and
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
use crate::io::readings::header::{About, Cell, Header, MAX_NUMBERS, SHAPES, parse_header};
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
}

impl TextLines {
    /// Reads the first line; errors call the text `path`. Cells are between commas if there are any
    /// in that line, else between semicolons, else between tabs if it is a `.csv` or names a time, else between blanks.
    pub(super) fn open(path: &Path, input: Box<dyn Read + Send>, is_csv: bool) -> Result<Self, IoError> {
        let mut lines = Lines::new(BufReader::with_capacity(1 << 16, input), path, Some(b'#'));
        lines.longest = LONGEST_LINE;
        lines.advance()?;
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
        Ok(Self { lines, separator, words })
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
}

impl TextReadings {
    /// Reads the first line; errors call the text `path`.
    pub(super) fn open(
        path: &Path,
        input: Box<dyn Read + Send>,
        is_csv: bool,
    ) -> Result<(Self, About), IoError> {
        let lines = TextLines::open(path, input, is_csv)?;
        let leading = lines.separator == Separator::Blanks;
        let Header { width, ids, channels, cells } = parse_header(lines.words.iter(), leading, lines.at())?;
        let has_times = cells.iter().any(|cell| matches!(cell, Cell::Time { .. }));
        let numbers = width * channels.len();
        let about = About { ids, channels, width, frames: None, has_times };
        Ok((Self { lines, cells, numbers, has_rows: false, is_ahead: false }, about))
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
        let cells = [Cell::Unused, Cell::Time { per_second: 1 }].into_iter();
        let cells = cells.chain((0..width).map(Cell::Reading)).collect();
        let about =
            About { ids: None, channels: vec![Channel::default()], width, frames: None, has_times: true };
        Ok((Self { lines, cells, numbers: width, has_rows: false, is_ahead: true }, about))
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
        take_row(&self.cells, self.lines.words.iter(), self.lines.at(), values, time)?;
        Ok(true)
    }
}

/// Puts the cells of a row where they belong.
fn take_row<'t>(
    cells: &[Cell],
    mut words: impl Iterator<Item = &'t str>,
    at: LineLocation<'_>,
    values: &mut [f64],
    time: &mut f64,
) -> Result<(), IoError> {
    let wrong =
        |found: usize| at.invalid(format!("{found} cells"), format!("{}, as in the first line", cells.len()));
    for (k, cell) in cells.iter().enumerate() {
        let word = words.next().ok_or_else(|| wrong(k))?;
        let invalid = |needed: &str| at.invalid_part(format!("column {}", k + 1), excerpt(word), needed);
        match *cell {
            Cell::Unused => {}
            Cell::Time { per_second } => *time = seconds(word, per_second).map_err(invalid)?,
            Cell::Reading(place) => {
                values[place] = reading(word).map_err(invalid)?;
            }
        }
    }
    match words.count() {
        0 => Ok(()),
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
}

impl LongReadings {
    /// Opens a file if the names in its first line are those of a long table.
    pub(super) fn open(path: &Path, is_csv: bool) -> Result<Option<(Self, About)>, IoError> {
        let Some((mut rows, channel)) = TextRows::open(path, is_csv)? else { return Ok(None) };
        // In the order in which they first come.
        let (mut ids, mut columns) = (Vec::new(), HashMap::new());
        while let Some(Reading { id, .. }) = rows.next()? {
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
        let about = About { ids, channels, width, frames: None, has_times: true };
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
        Ok(Some((Self { time, per_second, id, value, cells: names.len(), lines }, channel)))
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
