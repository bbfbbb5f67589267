//! Tables with a line of column names, the one way to read and write CSV: on the `csv` crate, which
//! splits and quotes.
//!
//! Columns are found by name, in any order. Errors name the line and the column.

use std::{
    collections::HashSet,
    io::{self, BufRead, Read},
    path::{Path, PathBuf},
};

use csv::{StringRecord, Writer};
use glam::{DQuat, DVec3};

use crate::{
    io::{
        IoError,
        file::{
            lines::{Lines, finite},
            replace::replace_file,
            source::{excerpt, invalid},
        },
    },
    skin::TaxelId,
};

/// Where a table comes from.
pub(crate) trait Input: Read {
    /// Whether the names of columns may be in capitals.
    const IGNORES_CASE: bool = false;

    /// Called before each row.
    fn begin_row(&mut self) {}

    /// The line of the row that was just read, if the input counts lines itself.
    fn line(&self) -> Option<u64> {
        None
    }
}

impl Input for &[u8] {}

impl<R: BufRead> Input for Lines<'_, R> {
    const IGNORES_CASE: bool = true;

    fn line(&self) -> Option<u64> {
        Some(Lines::line(self) as u64)
    }
}

/// Longest row of a stream, in bytes. A stream has no length to be checked; without a bound, one
/// that never ends its line, or never closes a quote, would fill the memory.
const MAX_ROW: usize = 1 << 20;

/// A stream of which `left` bytes may still be read before the next row is done.
#[derive(Debug)]
pub(crate) struct Bounded<R> {
    input: R,
    left: usize,
}

impl<R> Bounded<R> {
    pub(crate) fn new(input: R) -> Self {
        Self { input, left: MAX_ROW }
    }
}

impl<R: Read> Read for Bounded<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.left == 0 {
            let found = format!("more than {MAX_ROW} bytes");
            return Err(io::Error::new(io::ErrorKind::InvalidData, found));
        }
        let wanted = buffer.len().min(self.left);
        let count = self.input.read(&mut buffer[..wanted])?;
        self.left -= count;
        Ok(count)
    }
}

impl<R: Read> Input for Bounded<R> {
    fn begin_row(&mut self) {
        self.left = MAX_ROW;
    }
}

/// A table that is read row by row.
#[derive(Debug)]
pub(crate) struct Table<R> {
    reader: csv::Reader<R>,
    path: PathBuf,
    pub(crate) columns: Columns,
    cells: StringRecord,
    line: u64,
    ended: bool,
}

impl<R: Input> Table<R> {
    /// Reads the names of the columns; errors call the table `path`.
    ///
    /// # Errors
    /// If there are none, or one comes twice.
    pub(crate) fn open(path: &Path, input: R) -> Result<Self, IoError> {
        let mut reader = csv::Reader::from_reader(input);
        let names = |name: &str| match R::IGNORES_CASE {
            true => name.trim().to_ascii_lowercase(),
            false => name.trim().to_owned(),
        };
        let names: Vec<String> = match reader.headers() {
            Ok(header) => header.iter().map(names).collect(),
            Err(error) => return Err(table_error(path, reader.get_ref().line(), error)),
        };
        let line = reader.get_ref().line().unwrap_or(1);
        let columns = Columns::new(path, line, names)?;
        Ok(Self { reader, path: path.into(), columns, cells: StringRecord::new(), line, ended: false })
    }

    /// Reads the next row; false at the end. After an error about a row the next one may be read; a
    /// stream that failed has ended.
    ///
    /// # Errors
    /// If it cannot be read, or has another number of cells than the header.
    pub(crate) fn advance(&mut self) -> Result<bool, IoError> {
        if self.ended {
            return Ok(false);
        }
        self.reader.get_mut().begin_row();
        let read = self.reader.read_record(&mut self.cells);
        let line = self.reader.get_ref().line();
        match read {
            Ok(more) => {
                self.ended = !more;
                self.line = line.or(self.cells.position().map(csv::Position::line)).unwrap_or(self.line);
                Ok(more)
            }
            Err(error) => {
                self.ended = error.is_io_error();
                Err(table_error(&self.path, line, error))
            }
        }
    }

    /// The row that was read last.
    pub(crate) fn row(&self) -> Row<'_> {
        Row { path: &self.path, columns: &self.columns, cells: &self.cells, line: self.line }
    }

    /// Calls `visit` for every row.
    ///
    /// # Errors
    /// The first one.
    pub(crate) fn each_row(
        mut self,
        visit: &mut dyn FnMut(Row<'_>) -> Result<(), IoError>,
    ) -> Result<(), IoError> {
        while self.advance()? {
            visit(self.row())?;
        }
        Ok(())
    }

    /// Refuses columns that are not `known`, so that a misspelt name is not silently ignored.
    ///
    /// # Errors
    /// The first such column.
    pub(crate) fn refuse_unknown(&self, known: &[&str]) -> Result<(), IoError> {
        match self.columns.unknown(known).next() {
            None => Ok(()),
            Some((k, name)) => {
                let element = format!("line 1, column {}", k + 1);
                Err(invalid(&self.path, element, excerpt(name), format!("one of {}", known.join(","))))
            }
        }
    }
}

/// Writes a table.
///
/// # Errors
/// The first row that is one; if the file cannot be written, an older one stays as it was.
pub(crate) fn write_table(
    path: &Path,
    header: &[&str],
    rows: &mut dyn Iterator<Item = Result<Vec<String>, IoError>>,
) -> Result<(), IoError> {
    let fail = |e| table_write_error(path, e);
    replace_file(path, |out| {
        let mut table = Writer::from_writer(out);
        table.write_record(header).map_err(fail)?;
        for row in rows {
            table.write_record(row?).map_err(fail)?;
        }
        table.flush().map_err(|source| IoError::Write { path: path.to_owned(), source })
    })
}

/// The shortest decimals that read back as the same numbers.
pub(crate) fn decimals(numbers: impl IntoIterator<Item = f64>) -> impl Iterator<Item = String> {
    numbers.into_iter().map(|x| x.to_string())
}

/// The columns of a table, found by the names in its first line.
#[derive(Debug)]
pub(crate) struct Columns {
    path: PathBuf,
    /// The line of the names.
    line: u64,
    names: Vec<String>,
}

impl Columns {
    fn new(path: &Path, line: u64, names: Vec<String>) -> Result<Self, IoError> {
        if names.iter().all(String::is_empty) {
            return Err(invalid(path, format!("line {line}"), "nothing", "the names of the columns"));
        }
        let mut seen = HashSet::new();
        for (k, name) in names.iter().enumerate() {
            if !seen.insert(name) {
                let element = format!("line {line}, column {}", k + 1);
                return Err(invalid(path, element, format!("{} again", excerpt(name)), "a name of its own"));
            }
        }
        Ok(Self { path: path.into(), line, names })
    }

    /// Names that are not `known`.
    pub(crate) fn unknown<'a>(&'a self, known: &'a [&str]) -> impl Iterator<Item = (usize, &'a str)> {
        self.names.iter().map(String::as_str).enumerate().filter(|(_, name)| !known.contains(name))
    }

    /// Which column is called `name`.
    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|n| n == name)
    }

    /// Which column is called `name`, if the table must have it.
    ///
    /// # Errors
    /// If there is no such column.
    pub(crate) fn need(&self, name: &str) -> Result<usize, IoError> {
        self.find(name).ok_or_else(|| {
            invalid(&self.path, format!("line {}", self.line), self.describe(), format!("a column `{name}`"))
        })
    }

    /// The names found, for messages.
    pub(crate) fn describe(&self) -> String {
        format!("columns {}", excerpt(&self.names.join(",")))
    }

    /// Columns that come together or not at all.
    ///
    /// # Errors
    /// If some of them are there and some are not.
    pub(crate) fn find_vector<const N: usize>(
        &self,
        names: [&str; N],
    ) -> Result<Option<[usize; N]>, IoError> {
        if names.iter().all(|name| self.find(name).is_none()) {
            return Ok(None);
        }
        self.need_vector(names).map(Some)
    }

    /// Columns that the table must have.
    ///
    /// # Errors
    /// If one is not there.
    pub(crate) fn need_vector<const N: usize>(&self, names: [&str; N]) -> Result<[usize; N], IoError> {
        let mut places = [0; N];
        for (place, name) in places.iter_mut().zip(names) {
            *place = self.need(name)?;
        }
        Ok(places)
    }
}

/// One line of a table, and where it is.
#[derive(Clone, Copy)]
pub(crate) struct Row<'a> {
    path: &'a Path,
    columns: &'a Columns,
    cells: &'a StringRecord,
    /// Its line, from 1.
    pub(crate) line: u64,
}

impl<'a> Row<'a> {
    /// An error about the cell in `column`.
    pub(crate) fn invalid(&self, column: usize, needed: impl Into<String>) -> IoError {
        let element = format!("line {}, column `{}`", self.line, self.columns.names[column]);
        invalid(self.path, element, excerpt(self.text(column)), needed)
    }

    /// The cell without blanks around it.
    pub(crate) fn text(&self, column: usize) -> &'a str {
        self.cells.get(column).unwrap_or("").trim()
    }

    /// A finite number.
    pub(crate) fn number(&self, column: usize) -> Result<f64, IoError> {
        finite(self.text(column)).ok_or_else(|| self.invalid(column, "a finite number"))
    }

    /// A finite number, or an empty cell.
    pub(crate) fn number_if_any(&self, column: usize) -> Result<Option<f64>, IoError> {
        if self.text(column).is_empty() { Ok(None) } else { self.number(column).map(Some) }
    }

    /// A vector of finite numbers.
    pub(crate) fn vector(&self, [x, y, z]: [usize; 3]) -> Result<DVec3, IoError> {
        Ok(DVec3::new(self.number(x)?, self.number(y)?, self.number(z)?))
    }

    /// Finite numbers, or empty cells throughout.
    pub(crate) fn numbers_if_any<const N: usize>(
        &self,
        columns: [usize; N],
    ) -> Result<Option<[f64; N]>, IoError> {
        if columns.iter().all(|&c| self.text(c).is_empty()) {
            return Ok(None);
        }
        let mut numbers = [0.0; N];
        for (number, column) in numbers.iter_mut().zip(columns) {
            *number = self.number(column)?;
        }
        Ok(Some(numbers))
    }

    /// A vector of finite numbers, or three empty cells.
    pub(crate) fn vector_if_any(&self, columns: [usize; 3]) -> Result<Option<DVec3>, IoError> {
        Ok(self.numbers_if_any(columns)?.map(DVec3::from_array))
    }

    /// The number of a taxel.
    pub(crate) fn taxel(&self, column: usize) -> Result<TaxelId, IoError> {
        let id = self.text(column).parse().map(TaxelId);
        id.map_err(|_| self.invalid(column, "the number of a taxel, 0 to 4294967295"))
    }

    /// A rotation from the columns `qx,qy,qz,qw`.
    ///
    /// Tables print rounded digits, so a length up to [`UNIT_TOLERANCE`] from 1 is scaled to 1;
    /// anything else is not meant as a rotation. (glTF has a narrower rule of its own, and graphs
    /// of g2o are scaled with a remark.)
    pub(crate) fn rotation(&self, columns: [usize; 4]) -> Result<DQuat, IoError> {
        let [x, y, z, w] = columns.map(|column| self.number(column));
        let q = DQuat::from_xyzw(x?, y?, z?, w?);
        let off = (q.length() - 1.0).abs();
        if off.is_nan() || off > UNIT_TOLERANCE {
            return Err(self.invalid(columns[3], format!("a unit quaternion: length 1, not {}", q.length())));
        }
        Ok(q.normalize())
    }
}

/// How far a quaternion of a table may be from unit length: three decimals are enough to mean a
/// rotation.
const UNIT_TOLERANCE: f64 = 1e-3;

/// What the csv crate found, as an error about the table `path`.
fn table_error(path: &Path, line: Option<u64>, error: csv::Error) -> IoError {
    let line = line.or(error.position().map(csv::Position::line));
    let line = line.map_or_else(|| "table".into(), |line| format!("line {line}"));
    match error.into_kind() {
        csv::ErrorKind::Io(source) if source.kind() == io::ErrorKind::InvalidData => {
            invalid(path, line, source.to_string(), "a table of short lines")
        }
        csv::ErrorKind::Io(source) => IoError::Read { path: path.into(), source },
        csv::ErrorKind::Utf8 { err, .. } => {
            invalid(path, format!("{line}, column {}", err.field() + 1), "not UTF-8", "text in UTF-8")
        }
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            invalid(path, line, format!("{len} cells"), format!("{expected_len}, as the first line has"))
        }
        other => invalid(path, line, format!("{other:?}"), "a table of comma-separated values"),
    }
}

/// Why the table `path` could not be written.
pub(crate) fn table_write_error(path: &Path, error: csv::Error) -> IoError {
    let source = match error.into_kind() {
        csv::ErrorKind::Io(source) => source,
        other => io::Error::other(format!("{other:?}")),
    };
    IoError::Write { path: path.into(), source }
}
