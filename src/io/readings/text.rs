//! Readings as lines of numbers: CySkin's text (`index time value...` below a line of ids) and CSV.
//!
//! A row is read as soon as its line has ended, so that a pipe delivers frame by frame.

use std::{
    io::{BufRead, BufReader, Read},
    path::{Path, PathBuf},
};

use crate::io::{
    IoError,
    file::{
        lines::{LineLocation, finite},
        source::excerpt,
    },
    readings::header::{Cell, Header, parse_header},
};

/// Longest line, in bytes: half a million numbers. Without a bound, a stream that never ends its
/// line would fill the memory.
const LONGEST_LINE: u64 = 1 << 24;

/// What stands between the cells of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Separator {
    Comma,
    Blanks,
}

/// Readings that are read line by line.
pub(super) struct TextReadings {
    path: PathBuf,
    input: BufReader<Box<dyn Read + Send>>,
    line: Vec<u8>,
    number: usize,
    separator: Separator,
    cells: Vec<Cell>,
    numbers: usize,
    has_rows: bool,
}

impl TextReadings {
    /// Reads the first line; errors call the text `path`. Cells are between commas if there are any
    /// in that line or the file is called `.csv`, else between blanks.
    pub(super) fn open(
        path: &Path,
        input: Box<dyn Read + Send>,
        is_csv: bool,
    ) -> Result<(Self, Header), IoError> {
        let input = BufReader::with_capacity(1 << 16, input);
        let mut text = Self {
            path: path.into(),
            input,
            line: Vec::new(),
            number: 0,
            separator: Separator::Blanks,
            cells: Vec::new(),
            numbers: 0,
            has_rows: false,
        };
        if !text.advance()? {
            return Err(text.at().invalid("an empty file", "a line of taxel ids, then rows of readings"));
        }
        if is_csv || text.line.contains(&b',') {
            text.separator = Separator::Comma;
        }
        let (at, line) = (text.at(), text.text()?);
        let header = match text.separator {
            Separator::Comma => parse_header(line.split(',').map(unquoted), false, at),
            Separator::Blanks => parse_header(line.split_ascii_whitespace(), true, at),
        }?;
        text.cells.clone_from(&header.cells);
        text.numbers = header.ids.len() * header.channels.len();
        Ok((text, header))
    }

    /// Reads the next row; false after the last one.
    pub(super) fn read(&mut self, values: &mut Vec<f64>, time: &mut f64) -> Result<bool, IoError> {
        if !self.advance()? {
            return match self.has_rows {
                true => Ok(false),
                false => Err(self.at().invalid("no row of readings", "at least one below the line of ids")),
            };
        }
        self.has_rows = true;
        values.clear();
        values.resize(self.numbers, f64::NAN);
        *time = f64::NAN;
        let line = self.text()?;
        match self.separator {
            Separator::Comma => self.take_row(line.split(',').map(unquoted), values, time),
            Separator::Blanks => self.take_row(line.split_ascii_whitespace(), values, time),
        }?;
        Ok(true)
    }

    /// Whether rows have a time.
    pub(super) fn has_times(&self) -> bool {
        self.cells.contains(&Cell::Time)
    }

    fn take_row<'t>(
        &self,
        mut words: impl Iterator<Item = &'t str>,
        values: &mut [f64],
        time: &mut f64,
    ) -> Result<(), IoError> {
        let wrong = |found: usize| {
            self.at().invalid(
                format!("{found} cells"),
                format!("{}, as the first line asks for", self.cells.len()),
            )
        };
        for (k, cell) in self.cells.iter().enumerate() {
            let word = words.next().ok_or_else(|| wrong(k))?;
            let invalid =
                |needed: &str| self.at().invalid_part(format!("column {}", k + 1), excerpt(word), needed);
            match *cell {
                Cell::Unused => {}
                Cell::Time => *time = finite(word).ok_or_else(|| invalid("a finite time, in s"))?,
                Cell::Reading(_) if word.is_empty() => {}
                Cell::Reading(place) => {
                    values[place] = word.parse().map_err(|_| invalid("a number, NaN or nothing"))?;
                }
            }
        }
        match words.count() {
            0 => Ok(()),
            more => Err(wrong(self.cells.len() + more)),
        }
    }

    fn at(&self) -> LineLocation<'_> {
        LineLocation { path: &self.path, line: self.number }
    }

    fn text(&self) -> Result<&str, IoError> {
        let text = std::str::from_utf8(&self.line);
        Ok(text.map_err(|_| self.at().invalid("bytes that are not text", "text in UTF-8"))?.trim())
    }

    /// Goes on to the next line that is neither blank nor a comment after `#`; false at the end.
    fn advance(&mut self) -> Result<bool, IoError> {
        loop {
            self.line.clear();
            let read = (&mut self.input).take(LONGEST_LINE).read_until(b'\n', &mut self.line);
            let read = read.map_err(|source| IoError::Read { path: self.path.clone(), source })?;
            if read == 0 {
                return Ok(false);
            }
            self.number += 1;
            if read as u64 == LONGEST_LINE {
                let found = format!("a line of at least {LONGEST_LINE} bytes");
                return Err(self.at().invalid(found, "shorter lines"));
            }
            if self.number == 1 && self.line.starts_with("\u{feff}".as_bytes()) {
                self.line.drain(..3);
            }
            let text = self.line.trim_ascii_start();
            if !(text.is_empty() || text.starts_with(b"#")) {
                return Ok(true);
            }
        }
    }
}

/// A cell without blanks and quotes around it; names and numbers have no commas in them.
fn unquoted(cell: &str) -> &str {
    let cell = cell.trim();
    cell.strip_prefix('"').and_then(|c| c.strip_suffix('"')).map_or(cell, str::trim)
}
