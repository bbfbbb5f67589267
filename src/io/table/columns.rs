use std::{collections::HashSet, io, path::Path};

use csv::StringRecord;
use glam::DVec3;

use crate::io::{
    IoError,
    file::source::{excerpt, invalid},
};

/// The columns of a table, found by the names in its first line.
#[derive(Debug)]
pub(crate) struct Columns {
    names: Vec<String>,
}

impl Columns {
    /// Takes the names from the first line of the table `path`.
    ///
    /// # Errors
    /// If there are none, or one comes twice.
    pub(crate) fn new(path: &Path, header: &StringRecord) -> Result<Self, IoError> {
        let names: Vec<String> = header.iter().map(|name| name.trim().to_owned()).collect();
        if names.iter().all(String::is_empty) {
            return Err(invalid(path, "line 1", "nothing", "the names of the columns"));
        }
        let mut seen = HashSet::new();
        for (k, name) in names.iter().enumerate() {
            if !seen.insert(name) {
                let element = format!("line 1, column {}", k + 1);
                return Err(invalid(path, element, format!("{} again", excerpt(name)), "a name of its own"));
            }
        }
        Ok(Self { names })
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
    pub(crate) fn need(&self, path: &Path, name: &str) -> Result<usize, IoError> {
        self.find(name).ok_or_else(|| {
            let found = format!("columns {}", excerpt(&self.names.join(",")));
            invalid(path, "line 1", found, format!("a column `{name}`"))
        })
    }

    /// Columns that come together or not at all.
    ///
    /// # Errors
    /// If some of them are there and some are not.
    pub(crate) fn find_vector<const N: usize>(
        &self,
        path: &Path,
        names: [&str; N],
    ) -> Result<Option<[usize; N]>, IoError> {
        if names.iter().all(|name| self.find(name).is_none()) {
            return Ok(None);
        }
        self.need_vector(path, names).map(Some)
    }

    /// Columns that the table must have.
    ///
    /// # Errors
    /// If one is not there.
    pub(crate) fn need_vector<const N: usize>(
        &self,
        path: &Path,
        names: [&str; N],
    ) -> Result<[usize; N], IoError> {
        let mut places = [0; N];
        for (place, name) in places.iter_mut().zip(names) {
            *place = self.need(path, name)?;
        }
        Ok(places)
    }
}

/// One line of a table, and where it is.
#[derive(Clone, Copy)]
pub(crate) struct Row<'a> {
    pub(crate) path: &'a Path,
    pub(crate) columns: &'a Columns,
    pub(crate) cells: &'a StringRecord,
}

impl<'a> Row<'a> {
    /// An error about the cell in `column`.
    pub(crate) fn invalid(&self, column: usize, needed: impl Into<String>) -> IoError {
        let line = self.cells.position().map_or(0, csv::Position::line);
        let element = format!("line {line}, column `{}`", self.columns.names[column]);
        invalid(self.path, element, excerpt(self.text(column)), needed)
    }

    /// The cell without blanks around it.
    pub(crate) fn text(&self, column: usize) -> &'a str {
        self.cells.get(column).unwrap_or("").trim()
    }

    /// A finite number.
    pub(crate) fn number(&self, column: usize) -> Result<f64, IoError> {
        let value = self.text(column).parse().ok().filter(|x: &f64| x.is_finite());
        value.ok_or_else(|| self.invalid(column, "a finite number"))
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
}

/// What the csv crate found, as an error about the table `path`.
pub(crate) fn table_error(path: &Path, error: csv::Error) -> IoError {
    let line = error.position().map_or_else(|| "table".into(), |p| format!("line {}", p.line()));
    match error.into_kind() {
        csv::ErrorKind::Io(source) if source.kind() == io::ErrorKind::InvalidData => {
            invalid(path, line, source.to_string(), "a table of short lines")
        }
        csv::ErrorKind::Io(source) => IoError::Read { path: path.into(), source },
        csv::ErrorKind::Utf8 { err, .. } => {
            invalid(path, format!("{line}, column {}", err.field() + 1), "no UTF-8", "text in UTF-8")
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
