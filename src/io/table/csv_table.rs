//! Tables with a line of column names, read and written with the `csv` crate, which splits and quotes.
//! Only recordings, which may be live streams, are read elsewhere: line by line, in `readings/text`.
//!
//! Columns are found by name, in any order. Errors name the line and the column.

use std::{
    collections::HashSet,
    io::{self, BufRead},
    path::{Path, PathBuf},
};

use csv::{StringRecord, Writer};
use glam::{DQuat, DVec3};

use crate::{
    io::{
        IoError,
        error::Result,
        file::{LONGEST, LineLocation, Lines, Source, cannot_write, excerpt, finite, replace_file},
    },
    skin::TaxelId,
};

/// A table that is read row by row.
#[derive(Debug)]
pub(crate) struct Table<R> {
    reader: csv::Reader<Lines<R>>,
    pub(crate) columns: Columns,
    cells: StringRecord,
    ended: bool,
}

impl<'a> Table<&'a [u8]> {
    pub(crate) fn of(source: &'a Source) -> Result<Self> {
        Self::open(Lines::new(source.bytes(), source.path(), None))
    }
}

impl<R: BufRead> Table<R> {
    /// Reads the names of the columns; where lines may be comments, names may be in capitals.
    pub(crate) fn open(input: Lines<R>) -> Result<Self> {
        let ignores_case = input.comment.is_some();
        let mut reader = csv::Reader::from_reader(input);
        let name = |name: &str| {
            if ignores_case { name.trim().to_ascii_lowercase() } else { name.trim().to_owned() }
        };
        let names = reader.headers().map(|header| header.iter().map(name).collect());
        let at = reader.get_ref().at();
        reader.get_ref().check_length()?;
        let columns = Columns::new(at.path, at.line.max(1), names.map_err(|e| table_error(at, e))?)?;
        Ok(Self { reader, columns, cells: StringRecord::new(), ended: false })
    }

    /// Reads the next row; false at the end. After an error about a row the next one may be read.
    pub(crate) fn advance(&mut self) -> Result<bool> {
        if self.ended {
            return Ok(false);
        }
        self.reader.get_mut().left = LONGEST;
        let read = self.reader.read_record(&mut self.cells);
        self.ended = !read.as_ref().map_or_else(|error| !error.is_io_error(), |more| *more);
        let lines = self.reader.get_ref();
        lines.check_length()?;
        read.map_err(|error| table_error(lines.at(), error))
    }

    pub(crate) fn row(&self) -> Row<'_> {
        Row { at: self.reader.get_ref().at(), columns: &self.columns, cells: &self.cells }
    }

    pub(crate) fn each_row(mut self, visit: &mut dyn FnMut(Row<'_>) -> Result<()>) -> Result<()> {
        while self.advance()? {
            visit(self.row())?;
        }
        Ok(())
    }

    /// Refuses columns that are not `known`, so that a misspelt name is not silently ignored.
    pub(crate) fn refuse_unknown(&self, known: &[&str]) -> Result<()> {
        match self.columns.unknown(known).next() {
            None => Ok(()),
            Some((k, name)) => {
                let (part, needed) = (format!("column {}", k + 1), format!("one of {}", known.join(",")));
                Err(self.columns.at().invalid_part(part, excerpt(name), needed))
            }
        }
    }
}

pub(crate) fn write_table(
    path: &Path,
    header: &[&str],
    rows: &mut dyn Iterator<Item = Result<Vec<String>>>,
) -> Result<()> {
    let fail = |e| table_write_error(path, e);
    replace_file(path, |out| {
        let mut table = Writer::from_writer(out);
        table.write_record(header).map_err(fail)?;
        for row in rows {
            table.write_record(row?).map_err(fail)?;
        }
        table.flush().map_err(cannot_write(path))
    })
}

/// The shortest decimals that read back as the same numbers.
pub(crate) fn decimals(numbers: impl IntoIterator<Item = f64>) -> impl Iterator<Item = String> {
    numbers.into_iter().map(|x| x.to_string())
}

pub(crate) fn labelled<const N: usize>(
    ids: [TaxelId; N],
    numbers: impl IntoIterator<Item = f64>,
) -> Vec<String> {
    ids.iter().map(ToString::to_string).chain(decimals(numbers)).collect()
}

/// The columns of a table, found by the names in its first line.
#[derive(Debug)]
pub(crate) struct Columns {
    path: PathBuf,
    /// The line of the names.
    line: usize,
    names: Vec<String>,
}

impl Columns {
    fn new(path: &Path, line: usize, names: Vec<String>) -> Result<Self> {
        let at = LineLocation { path, line };
        if names.iter().all(String::is_empty) {
            return Err(at.invalid("nothing", "the names of the columns"));
        }
        if let Some((found, needed)) = unlike_names(&names) {
            return Err(at.invalid(found, needed));
        }
        let mut seen = HashSet::new();
        // Spreadsheets write columns without a name behind the others.
        if let Some(k) = names.iter().position(|name| !name.is_empty() && !seen.insert(name)) {
            let found = format!("{} again", excerpt(&names[k]));
            return Err(at.invalid_part(format!("column {}", k + 1), found, "a name of its own"));
        }
        Ok(Self { path: path.into(), line, names })
    }

    /// The line of the names.
    pub(crate) fn at(&self) -> LineLocation<'_> {
        LineLocation { path: &self.path, line: self.line }
    }

    pub(crate) fn unknown<'a>(&'a self, known: &'a [&str]) -> impl Iterator<Item = (usize, &'a str)> {
        self.names.iter().map(String::as_str).enumerate().filter(|(_, name)| !known.contains(name))
    }

    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|n| n == name)
    }

    pub(crate) fn need(&self, name: &str) -> Result<usize> {
        self.find(name).ok_or_else(|| self.at().invalid(self.describe(), format!("a column `{name}`")))
    }

    /// The names found, for messages.
    pub(crate) fn describe(&self) -> String {
        format!("columns {}", excerpt(&self.names.join(",")))
    }

    /// Columns that come together or not at all.
    pub(crate) fn find_vector<const N: usize>(&self, names: [&str; N]) -> Result<Option<[usize; N]>> {
        if names.iter().all(|name| self.find(name).is_none()) {
            return Ok(None);
        }
        self.need_vector(names).map(Some)
    }

    pub(crate) fn need_vector<const N: usize>(&self, names: [&str; N]) -> Result<[usize; N]> {
        let mut places = [0; N];
        for (place, name) in places.iter_mut().zip(names) {
            *place = self.need(name)?;
        }
        Ok(places)
    }
}

/// What is there instead of the names of columns, and what is needed: a row of numbers, or names with
/// another separator.
fn unlike_names(names: &[String]) -> Option<(String, &'static str)> {
    let line = excerpt(&names.join(","));
    if names.iter().all(|name| name.parse::<f64>().is_ok()) {
        let found = format!("the numbers {line}; the header is missing");
        return Some((found, "a first line with the names of the columns"));
    }
    let [all] = names else { return None };
    let separators = [('\t', "tabs"), (';', "semicolons")];
    let (_, word) = separators.into_iter().find(|(separator, _)| all.contains(*separator))?;
    Some((format!("columns that seem to be separated by {word}, {line}"), "columns separated by commas"))
}

/// One line of a table, and where it is.
#[derive(Clone, Copy)]
pub(crate) struct Row<'a> {
    pub(crate) at: LineLocation<'a>,
    columns: &'a Columns,
    cells: &'a StringRecord,
}

impl<'a> Row<'a> {
    pub(crate) fn invalid(&self, column: usize, needed: impl Into<String>) -> IoError {
        let name = excerpt(&self.columns.names[column]);
        let part = format!("column `{}`", name.trim_matches('"'));
        self.at.invalid_part(part, excerpt(self.text(column)), needed)
    }

    /// The cell without blanks around it.
    pub(crate) fn text(&self, column: usize) -> &'a str {
        self.cells.get(column).unwrap_or("").trim()
    }

    pub(crate) fn number(&self, column: usize) -> Result<f64> {
        finite(self.text(column)).ok_or_else(|| self.invalid(column, "a finite number"))
    }

    /// A finite number, or an empty cell.
    pub(crate) fn number_if_any(&self, column: usize) -> Result<Option<f64>> {
        Ok(self.numbers_if_any([column])?.map(|[x]| x))
    }

    pub(crate) fn numbers<const N: usize>(&self, columns: [usize; N]) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        for (number, column) in numbers.iter_mut().zip(columns) {
            *number = self.number(column)?;
        }
        Ok(numbers)
    }

    pub(crate) fn vector(&self, columns: [usize; 3]) -> Result<DVec3> {
        self.numbers(columns).map(DVec3::from_array)
    }

    /// Finite numbers, or empty cells throughout.
    pub(crate) fn numbers_if_any<const N: usize>(&self, columns: [usize; N]) -> Result<Option<[f64; N]>> {
        let is_empty = columns.iter().all(|&c| self.text(c).is_empty());
        if is_empty { Ok(None) } else { self.numbers(columns).map(Some) }
    }

    pub(crate) fn taxel(&self, column: usize) -> Result<TaxelId> {
        let id = self.text(column).parse().map(TaxelId);
        id.map_err(|_| self.invalid(column, "the number of a taxel, 0 to 4294967295"))
    }

    /// A rotation from the columns `qx,qy,qz,qw`.
    ///
    /// Tables print rounded digits, so a length up to [`UNIT_TOLERANCE`] from 1 is scaled to 1;
    /// anything else is not meant as a rotation. (glTF has a narrower rule of its own, and graphs
    /// of g2o are scaled with a remark.)
    pub(crate) fn rotation(&self, columns: [usize; 4]) -> Result<DQuat> {
        let q = DQuat::from_array(self.numbers(columns)?);
        let off = (q.length() - 1.0).abs();
        if off.is_nan() || off > UNIT_TOLERANCE {
            return Err(self.invalid(columns[3], format!("a unit quaternion: length 1, not {}", q.length())));
        }
        Ok(q.normalize())
    }

    /// The same, or nothing where all four cells are empty.
    pub(crate) fn rotation_if_any(&self, columns: [usize; 4]) -> Result<Option<DQuat>> {
        let is_empty = columns.iter().all(|&c| self.text(c).is_empty());
        if is_empty { Ok(None) } else { self.rotation(columns).map(Some) }
    }
}

/// How far a quaternion may be from unit length: three decimals are enough to mean a rotation.
const UNIT_TOLERANCE: f64 = 1e-3;

/// What the csv crate found, as an error about a line.
fn table_error(at: LineLocation<'_>, error: csv::Error) -> IoError {
    match error.into_kind() {
        csv::ErrorKind::Io(source) if source.kind() == io::ErrorKind::InvalidData => {
            at.invalid(source.to_string(), "a table of short lines")
        }
        csv::ErrorKind::Io(source) => IoError::Read { path: at.path.into(), source },
        csv::ErrorKind::Utf8 { err, .. } => {
            at.invalid_part(format!("column {}", err.field() + 1), "not UTF-8", "text in UTF-8")
        }
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            at.invalid(format!("{len} cells"), format!("{expected_len}, as the first line has"))
        }
        other => at.invalid(format!("{other:?}"), "a table of comma-separated values"),
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
