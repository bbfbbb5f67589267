//! Readings as lines of numbers: CySkin's text (`index time value...` below a line of ids) and CSV.
//!
//! A row is read as soon as its line has ended, so that a pipe delivers frame by frame.

use std::{
    io::{BufReader, Read},
    path::Path,
};

use crate::io::{
    IoError,
    file::{
        lines::{LineLocation, Lines, finite},
        source::excerpt,
    },
    readings::header::{Cell, Header, parse_header},
};

/// Longest line, in bytes: half a million numbers. Without a bound, a stream that never ends its
/// line would fill the memory.
const LONGEST_LINE: usize = 1 << 24;

/// What stands between the cells of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Separator {
    Sign(char),
    Blanks,
}

/// Readings that are read line by line.
pub(super) struct TextReadings {
    lines: Lines<BufReader<Box<dyn Read + Send>>>,
    separator: Separator,
    cells: Vec<Cell>,
    numbers: usize,
    has_rows: bool,
}

impl TextReadings {
    /// Reads the first line; errors call the text `path`. Cells are between commas if there are any
    /// in that line, else between semicolons, else in a `.csv` between tabs, else between blanks.
    pub(super) fn open(
        path: &Path,
        input: Box<dyn Read + Send>,
        is_csv: bool,
    ) -> Result<(Self, Header), IoError> {
        let mut lines = Lines::new(BufReader::with_capacity(1 << 16, input), path, Some(b'#'));
        lines.longest = LONGEST_LINE;
        lines.advance()?;
        let Some((line, at)) = lines.current()? else {
            let needed = "a line of taxel ids, then rows of readings";
            return Err(lines.at().invalid("an empty file", needed));
        };
        let signs = if is_csv { &[',', ';', '\t'][..] } else { &[',', ';'] };
        let separator = match signs.iter().find(|&&sign| line.contains(sign)) {
            Some(&sign) => Separator::Sign(sign),
            None if is_csv => Separator::Sign(','),
            None => Separator::Blanks,
        };
        let header = match separator {
            Separator::Sign(sign) => parse_header(line.split(sign).map(unquoted), false, at),
            Separator::Blanks => parse_header(line.split_ascii_whitespace(), true, at),
        }?;
        let numbers = header.ids.len() * header.channels.len();
        let cells = header.cells.clone();
        Ok((Self { lines, separator, cells, numbers, has_rows: false }, header))
    }

    /// Reads the next row; false after the last one.
    pub(super) fn read(&mut self, values: &mut Vec<f64>, time: &mut f64) -> Result<bool, IoError> {
        self.lines.advance()?;
        let Some((line, at)) = self.lines.current()? else {
            return match self.has_rows {
                true => Ok(false),
                false => {
                    Err(self.lines.at().invalid("no row of readings", "at least one below the line of ids"))
                }
            };
        };
        self.has_rows = true;
        values.clear();
        values.resize(self.numbers, f64::NAN);
        *time = f64::NAN;
        match self.separator {
            Separator::Sign(sign) => take_row(&self.cells, line.split(sign).map(unquoted), at, values, time),
            Separator::Blanks => take_row(&self.cells, line.split_ascii_whitespace(), at, values, time),
        }?;
        Ok(true)
    }

    /// Whether rows have a time.
    pub(super) fn has_times(&self) -> bool {
        self.cells.iter().any(|cell| matches!(cell, Cell::Time { .. }))
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
    let wrong = |found: usize| {
        at.invalid(format!("{found} cells"), format!("{}, as the first line asks for", cells.len()))
    };
    for (k, cell) in cells.iter().enumerate() {
        let word = words.next().ok_or_else(|| wrong(k))?;
        let invalid = |needed: &str| at.invalid_part(format!("column {}", k + 1), excerpt(word), needed);
        match *cell {
            Cell::Unused => {}
            Cell::Time { per_second } => {
                let number = finite(word).ok_or_else(|| invalid("a finite time"))?;
                *time = number / f64::from(per_second);
            }
            Cell::Reading(_) if word.is_empty() => {}
            Cell::Reading(place) => {
                values[place] = word.parse().map_err(|_| invalid("a number, NaN or nothing"))?;
            }
        }
    }
    match words.count() {
        0 => Ok(()),
        more => Err(wrong(cells.len() + more)),
    }
}

/// A cell without blanks and quotes around it; names and numbers have no separators in them.
fn unquoted(cell: &str) -> &str {
    let cell = cell.trim();
    cell.strip_prefix('"').and_then(|c| c.strip_suffix('"')).map_or(cell, str::trim)
}
