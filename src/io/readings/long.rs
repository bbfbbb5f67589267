//! Readings as a long table: `time,taxel_id,value`, a row for each reading. Rows of one time that
//! follow each other are a frame.
//!
//! Which taxels there are is known at its end only: a file is read twice, and a stream is refused.

use std::{collections::HashMap, fs::File, path::Path};

use crate::{
    io::{
        IoError,
        readings::{
            header::{MAX_NUMBERS, per_second, seconds},
            text::TextLines,
        },
    },
    signal::Channel,
    skin::TaxelId,
};

/// A long table that is read frame by frame.
pub(super) struct LongReadings {
    rows: Rows,
    columns: HashMap<TaxelId, usize>,
    /// The first row of the next frame.
    ahead: Option<Reading>,
}

/// What the table says about its readings.
pub(super) struct About {
    /// The taxels, in the order in which they first come.
    pub(super) ids: Vec<TaxelId>,
    pub(super) channel: Channel,
}

#[derive(Clone, Copy)]
struct Reading {
    time: f64,
    id: TaxelId,
    value: f64,
}

struct Rows {
    lines: TextLines,
    /// Places of the columns, and what the time is counted in.
    time: usize,
    per_second: u32,
    id: usize,
    value: usize,
    cells: usize,
}

impl LongReadings {
    /// Opens a file if the names in its first line are those of a long table.
    pub(super) fn open(path: &Path, is_csv: bool) -> Result<Option<(Self, About)>, IoError> {
        let Some((mut rows, channel)) = Rows::open(path, is_csv)? else { return Ok(None) };
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
        let Some((mut rows, _)) = Rows::open(path, is_csv)? else { return Ok(None) };
        let ahead = rows.next()?;
        Ok(Some((Self { rows, columns, ahead }, About { ids, channel })))
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
                    .invalid("a new taxel", "a file that nobody writes meanwhile"));
            };
            if std::mem::replace(&mut seen[column], true) {
                let found = format!("taxel {} again at the time {} s", reading.id, first.time);
                return Err(self.rows.lines.at().invalid(found, "one reading of a taxel at a time"));
            }
            values[column] = reading.value;
            row = self.rows.next()?;
        }
        self.ahead = row;
        Ok(true)
    }
}

impl Rows {
    fn open(path: &Path, is_csv: bool) -> Result<Option<(Self, Channel)>, IoError> {
        let file = File::open(path).map_err(|source| IoError::Read { path: path.into(), source })?;
        let lines = TextLines::open(path, Box::new(file), is_csv)?;
        let names: Vec<String> = lines.words.iter().map(str::to_ascii_lowercase).collect();
        let find = |known: &[&str]| {
            names.iter().position(|name| known.contains(&name.split('[').next().unwrap_or_default().trim()))
        };
        let places = [find(&["time", "timestamp"]), find(&["taxel_id", "taxel"]), find(&["value"])];
        let [Some(time), Some(id), Some(value)] = places else { return Ok(None) };
        let Some(per_second) = per_second(&names[time]) else { return Ok(None) };
        let name = lines.words.get(value).unwrap_or_default();
        let unit = name.split_once('[').map_or("", |(_, unit)| unit.trim_end_matches(']').trim());
        let channel = Channel::new("", unit);
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
        let value = match word(self.value) {
            "" => f64::NAN,
            text => text.parse().map_err(|_| at.invalid(text, "a number, NaN or nothing"))?,
        };
        let time = seconds(word(self.time), self.per_second, self.time, at)?;
        Ok(Some(Reading { time, id: at.taxel(word(self.id))?, value }))
    }
}
