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
        lines::{LineLocation, Lines},
        source::excerpt,
    },
    readings::header::{Cell, Header, SHAPES, parse_header, seconds},
    table::cells::{Cells, Separator},
};

/// Longest line, in bytes: half a million numbers. Without a bound, a stream that never ends its
/// line would fill the memory.
const LONGEST_LINE: usize = 1 << 24;

/// Lines of a text and their cells.
pub(super) struct TextLines {
    lines: Lines<BufReader<Box<dyn Read + Send>>>,
    separator: Separator,
    /// The cells of the line.
    pub(super) words: Cells,
}

impl TextLines {
    /// Reads the first line; errors call the text `path`. Cells are between commas if there are any
    /// in that line, else between semicolons, else in a `.csv` between tabs, else between blanks.
    pub(super) fn open(path: &Path, input: Box<dyn Read + Send>, is_csv: bool) -> Result<Self, IoError> {
        let mut lines = Lines::new(BufReader::with_capacity(1 << 16, input), path, Some(b'#'));
        lines.longest = LONGEST_LINE;
        lines.advance()?;
        let Some((line, _)) = lines.current()? else {
            return Err(lines.at().invalid("an empty file", SHAPES));
        };
        let signs = if is_csv { &[',', ';', '\t'][..] } else { &[',', ';'] };
        let separator = match signs.iter().find(|&&sign| line.contains(sign)) {
            Some(&sign) => Separator::Sign(sign),
            None if is_csv => Separator::Sign(','),
            None => Separator::Blanks,
        };
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

/// Readings that are read line by line.
pub(super) struct TextReadings {
    lines: TextLines,
    cells: Vec<Cell>,
    numbers: usize,
    has_rows: bool,
}

impl TextReadings {
    /// Reads the first line; errors call the text `path`.
    pub(super) fn open(
        path: &Path,
        input: Box<dyn Read + Send>,
        is_csv: bool,
    ) -> Result<(Self, Header), IoError> {
        let lines = TextLines::open(path, input, is_csv)?;
        let header = parse_header(lines.words.iter(), lines.separator == Separator::Blanks, lines.at())?;
        let numbers = header.width * header.channels.len();
        let cells = header.cells.clone();
        Ok((Self { lines, cells, numbers, has_rows: false }, header))
    }

    /// Reads the next row; false after the last one.
    pub(super) fn read(&mut self, values: &mut Vec<f64>, time: &mut f64) -> Result<bool, IoError> {
        if !self.lines.advance()? {
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
            Cell::Time { per_second } => *time = seconds(word, per_second, k, at)?,
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
