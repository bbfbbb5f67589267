//! A table of observations that is read while it is written, touch by touch.

use std::io::{BufRead, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use crate::io::IoError;
use crate::io::error::Result;
use crate::io::file::{Lines, invalid};
use crate::io::observations::builder::{ObservationsBuilder, ReadObservations};
use crate::io::observations::csv::{self, ColumnIndices};
use crate::io::table::Table;

/// The touches of a table, one after the other: the rows with one number in the column `touch`, which follow each
/// other, or each row.
///
/// A touch is complete when the next one begins. A last line without an end is half a row and is not read.
pub struct TouchStream {
    path: PathBuf,
    table: Table<WatchedInput>,
    columns: ColumnIndices,
    /// Whether the table stands on a row that was not read.
    is_held: bool,
    last_byte: Arc<AtomicU8>,
    half_row: Option<usize>,
    time: Option<f64>,
    /// An error behind the rows of a touch.
    error: Option<IoError>,
    ended: bool,
}

/// Reads a table of observations from a stream, touch by touch; errors call it `name`.
///
/// Columns are those of [`read_observations`](crate::io::read_observations); displacements may have `touch`, too.
///
/// # Errors
/// If the stream cannot be read, or its first line does not name the columns of such a table.
pub fn touches_from_stream(input: impl BufRead + Send + 'static, name: &Path) -> Result<TouchStream> {
    let last_byte = Arc::new(AtomicU8::new(b'\n'));
    let input = WatchedInput { input: Box::new(input), last_byte: last_byte.clone() };
    let mut lines = Lines::new(input, name, Some(b'#'));
    lines.advance()?;
    if lines.current()?.is_none() {
        return Err(invalid(name, "the stream", "no line", csv::TABLES));
    }
    let table = Table::open(lines)?;
    let columns = ColumnIndices::new(&table.columns)?;
    let path = name.to_owned();
    Ok(TouchStream {
        path,
        table,
        columns,
        is_held: false,
        last_byte,
        half_row: None,
        time: None,
        error: None,
        ended: false,
    })
}

impl TouchStream {
    /// The line on which the stream ended within a row.
    pub fn half_row(&self) -> Option<usize> {
        self.half_row
    }

    /// The time of the last row of the last touch, in s, if the table has a column `time`.
    pub fn time(&self) -> Option<f64> {
        self.time
    }

    /// Moves to the next row; false at the end.
    fn advance(&mut self) -> Result<bool> {
        if std::mem::take(&mut self.is_held) {
            return Ok(true);
        }
        let found = self.table.advance();
        if !matches!(found, Ok(false)) && self.last_byte.load(Ordering::Relaxed) != b'\n' {
            self.half_row = Some(self.table.row().at.line);
            return Ok(false);
        }
        found
    }

    /// Reads the rows of a touch into `builder`; returns how many.
    fn read_touch(&mut self, builder: &mut ObservationsBuilder) -> Result<usize> {
        let mut first: Option<String> = None;
        let mut count = 0;
        while self.advance()? {
            let row = self.table.row();
            let number = self.columns.group.map(|column| row.text(column).to_owned());
            if count > 0 && (number.is_none() || number != first) {
                self.is_held = true;
                break;
            }
            let time = self.columns.time.map(|column| row.time(column)).transpose()?;
            csv::read_row(row, &self.columns, builder)?;
            self.time = time;
            first = number;
            count += 1;
            if first.is_none() {
                break;
            }
        }
        Ok(count)
    }
}

impl Iterator for TouchStream {
    type Item = Result<ReadObservations>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return self.error.take().map(Err);
        }
        let mut builder = ObservationsBuilder::new(&self.path);
        builder.assumed_sigma = self.columns.assumed_sigma();
        match self.read_touch(&mut builder) {
            Ok(0) => {
                self.ended = true;
                None
            }
            Ok(_) => Some(builder.finish()),
            Err(error) => {
                self.ended = true;
                // Rows of the touch before the bad one are still a touch.
                if builder.is_empty() {
                    return Some(Err(error));
                }
                self.error = Some(error);
                Some(builder.finish())
            }
        }
    }
}

/// A stream that remembers its last byte.
struct WatchedInput {
    input: Box<dyn BufRead + Send>,
    last_byte: Arc<AtomicU8>,
}

impl Read for WatchedInput {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.input.fill_buf()?.read(buffer)?;
        self.consume(count);
        Ok(count)
    }
}

impl BufRead for WatchedInput {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        self.input.fill_buf()
    }

    fn consume(&mut self, amount: usize) {
        // What is consumed is in the buffer.
        if let Some(last) = amount.checked_sub(1)
            && let Ok(buffer) = self.input.fill_buf()
            && let Some(&byte) = buffer.get(last)
        {
            self.last_byte.store(byte, Ordering::Relaxed);
        }
        self.input.consume(amount);
    }
}
