//! Tables as text: the one way in which numbers and texts are written to them.
//!
//! Every function appends a cell and the comma behind it; [`end_row`] turns the last comma into the
//! end of a line.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::io::error::Result;
use crate::io::file::outputs::Replacement;
use crate::io::file::{OutPath, cannot_write, replace_file};

/// Bytes of rows that are kept before they are written.
const KEPT: usize = 1 << 16;

/// Appends a number: the shortest digits that read back as the same bits, as `1.0` and `1e-7`.
#[inline]
pub(crate) fn push_number(text: &mut Vec<u8>, number: f64) {
    text.extend_from_slice(zmij::Buffer::new().format(number).as_bytes());
    text.push(b',');
}

/// Appends a number in the shortest digits, as `1`; below `least`, and from 1e17 on, with an exponent:
/// without one 1e-300 would be 300 zeros.
pub(crate) fn push_decimal(text: &mut Vec<u8>, number: f64, least: f64) {
    let is_plain = number == 0.0 || !number.is_finite() || (least..1e17).contains(&number.abs());
    // Writing to memory cannot fail.
    let _ = if is_plain { write!(text, "{number},") } else { write!(text, "{number:e},") };
}

#[inline]
pub(crate) fn push_whole(text: &mut Vec<u8>, number: u64) {
    text.extend_from_slice(itoa::Buffer::new().format(number).as_bytes());
    text.push(b',');
}

/// Appends a text, in quotes where it would else be several cells.
pub(crate) fn push_cell(text: &mut Vec<u8>, cell: &str) {
    if cell.contains([',', '"', '\n', '\r']) {
        text.push(b'"');
        for part in cell.split_inclusive('"') {
            text.extend_from_slice(part.as_bytes());
            if part.ends_with('"') {
                text.push(b'"');
            }
        }
        text.push(b'"');
    } else {
        text.extend_from_slice(cell.as_bytes());
    }
    text.push(b',');
}

/// The names of columns as the first line of a table, without its end.
pub(crate) fn header_of<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let mut text = Vec::new();
    names.into_iter().for_each(|name| push_cell(&mut text, name));
    text.pop();
    String::from_utf8_lossy(&text).into_owned()
}

pub(crate) fn end_row(text: &mut Vec<u8>) {
    text.pop();
    text.push(b'\n');
}

pub(crate) struct TableWriter<W> {
    path: PathBuf,
    output: W,
    pub(crate) text: Vec<u8>,
}

impl<W: Write> TableWriter<W> {
    /// Begins a table with the names of its columns, between commas; errors call it `path`.
    pub(crate) fn new(path: &Path, output: W, names: &str) -> Self {
        Self { path: path.into(), output, text: format!("{names}\n").into_bytes() }
    }

    /// Adds a column before the others; there is no row yet.
    pub(crate) fn add_first_column(&mut self, name: &str) {
        self.text.splice(0..0, format!("{name},").into_bytes());
    }

    /// Puts lines before the names of the columns; there is no row yet.
    pub(crate) fn put_first(&mut self, lines: &str) {
        self.text.splice(0..0, lines.bytes());
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Appends numbers, plain down to 1e-20.
    pub(crate) fn decimals(&mut self, numbers: impl IntoIterator<Item = f64>) {
        numbers.into_iter().for_each(|x| push_decimal(&mut self.text, x, 1e-20));
    }

    pub(crate) fn numbers(&mut self, numbers: impl IntoIterator<Item = f64>) {
        numbers.into_iter().for_each(|x| push_number(&mut self.text, x));
    }

    pub(crate) fn whole(&mut self, number: impl Into<u64>) {
        push_whole(&mut self.text, number.into());
    }

    pub(crate) fn cell(&mut self, cell: &str) {
        push_cell(&mut self.text, cell);
    }

    /// Appends a number, or an empty cell.
    pub(crate) fn number_if_any(&mut self, number: Option<f64>) {
        match number {
            Some(number) => push_number(&mut self.text, number),
            None => self.empty(1),
        }
    }

    /// Appends cells without content.
    pub(crate) fn empty(&mut self, cells: usize) {
        self.text.extend(std::iter::repeat_n(b',', cells));
    }

    pub(crate) fn end_row(&mut self) -> Result<()> {
        end_row(&mut self.text);
        if self.text.len() >= KEPT { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<()> {
        self.output.write_all(&self.text).map_err(cannot_write(&self.path))?;
        self.text.clear();
        Ok(())
    }

    pub(crate) fn finish(mut self) -> Result<W> {
        self.flush()?;
        Ok(self.output)
    }
}

impl TableWriter<Replacement> {
    /// Begins a table that appears in the place of its file when it is [finished](Self::publish).
    pub(crate) fn create(path: &OutPath, names: &str) -> Result<Self> {
        Ok(Self::new(path, Replacement::open(path)?, names))
    }

    /// Ends the table, and puts the file in its place.
    pub(crate) fn publish(self) -> Result<()> {
        self.finish()?.finish()
    }
}

/// Writes a table as a file, whole or not at all.
pub(crate) fn write_table(
    path: &OutPath,
    names: &str,
    rows: impl FnOnce(&mut TableWriter<&mut BufWriter<&File>>) -> Result<()>,
) -> Result<()> {
    replace_file(path, |out| {
        let mut table = TableWriter::new(path, out, names);
        rows(&mut table)?;
        table.finish().map(drop)
    })
}
