//! Tables with a line of column names, between commas: the one engine that reads and writes them.
//! Recordings, which may be live streams with other separators, are read in `readings/text` with the
//! same [`Cells`].
//!
//! Columns are found by name, in any order. Errors name the line and the column.

pub(super) mod by_taxel;
pub(super) mod calibration;
pub(super) mod cells;
pub(super) mod contacts;
#[cfg(feature = "robots")]
pub(super) mod joints;
pub(super) mod lookups;
pub(super) mod motion;
pub(super) mod region_writer;
pub(super) mod writer;

use std::collections::HashSet;
use std::io::BufRead;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};

use self::cells::{Cells, Separator};

use crate::io::IoError;
use crate::io::error::Result;
use crate::io::file::{LONGEST, LineLocation, Lines, Source, excerpt, finite};
use crate::skin::TaxelId;

/// Most lines of a row, which is split again with every line of a text in quotes.
const MOST_LINES: usize = 1000;

/// A table that is read row by row.
#[derive(Debug)]
pub(crate) struct Table<R> {
    lines: Lines<R>,
    pub(crate) columns: Columns,
    cells: Cells,
    ended: bool,
}

impl<'a> Table<&'a [u8]> {
    pub(crate) fn of(source: &'a Source) -> Result<Self> {
        let mut lines = Lines::new(source.bytes(), source.path(), None);
        lines.advance()?;
        Self::open(lines)
    }
}

impl<R: BufRead> Table<R> {
    /// Reads the names of the columns on the line where `lines` stands; where lines may be comments,
    /// names may be in capitals.
    pub(crate) fn open(mut lines: Lines<R>) -> Result<Self> {
        let mut cells = Cells::default();
        read_row(&mut lines, &mut cells)?;
        let ignores_case = lines.comment.is_some();
        let name = |name: &str| if ignores_case { name.to_ascii_lowercase() } else { name.to_owned() };
        let at = lines.at();
        let columns = Columns::new(at.path, at.line.max(1), cells.iter().map(name).collect())?;
        Ok(Self { lines, columns, cells, ended: false })
    }

    /// Reads the next row; false at the end. After an error about a row the next one may be read.
    pub(crate) fn advance(&mut self) -> Result<bool> {
        if self.ended {
            return Ok(false);
        }
        self.ended = true;
        self.lines.advance()?;
        self.ended = self.lines.has_ended();
        if self.ended {
            return Ok(false);
        }
        read_row(&mut self.lines, &mut self.cells)?;
        let (found, needed) = (self.cells.len(), self.columns.names.len());
        if found != needed {
            let needed = format!("{needed}, as the first line has");
            return Err(self.lines.at().invalid(format!("{found} cells"), needed));
        }
        Ok(true)
    }

    pub(crate) fn row(&self) -> Row<'_> {
        Row { at: self.lines.at(), columns: &self.columns, cells: &self.cells }
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

    /// What `read` makes of each row, one after the other. After an error about a row the next one follows;
    /// after another error nothing does.
    pub(crate) fn into_rows<T>(
        mut self,
        read: impl Fn(Row<'_>) -> Result<T>,
    ) -> impl Iterator<Item = Result<T>> {
        std::iter::from_fn(move || match self.advance() {
            Ok(more) => more.then(|| read(self.row())),
            Err(error) => Some(Err(error)),
        })
    }
}

/// Visits the rows of a table that has these columns and no others, each with their places.
pub(crate) fn each_row_of<const N: usize>(
    path: &Path,
    names: [&str; N],
    visit: &mut dyn FnMut(Row<'_>, [usize; N]) -> Result<()>,
) -> Result<()> {
    let source = Source::open(path)?;
    let table = Table::of(&source)?;
    table.refuse_unknown(&names)?;
    let columns = table.columns.need_vector(names)?;
    table.each_row(&mut |row| visit(row, columns))
}

/// Splits the row that begins on the line where `lines` stands; it may have more of them.
fn read_row<R: BufRead>(lines: &mut Lines<R>, cells: &mut Cells) -> Result<()> {
    let comma = Separator::Sign(',');
    let Some((line, _)) = lines.current()? else {
        cells.split("", comma, false);
        return Ok(());
    };
    if lines.has_row_per_line {
        cells.split(line, comma, line.matches('"').count().is_multiple_of(2));
        return Ok(());
    }
    if !cells.split(line, comma, true) {
        return Ok(());
    }
    let mut row = line.to_owned();
    for _ in 0..MOST_LINES {
        lines.advance()?;
        let Some((line, at)) = lines.current()? else { break };
        if row.len() + line.len() > LONGEST {
            return Err(at.invalid(format!("more than {LONGEST} bytes"), "a table of short lines"));
        }
        row.push('\n');
        row.push_str(line);
        if !cells.split(&row, comma, true) {
            return Ok(());
        }
    }
    Err(lines.at().invalid("a quote that is not closed", "a table of short lines"))
}

/// One line of a table, and where it is.
#[derive(Clone, Copy)]
pub(crate) struct Row<'a> {
    pub(crate) at: LineLocation<'a>,
    columns: &'a Columns,
    cells: &'a Cells,
}

impl<'a> Row<'a> {
    pub(crate) fn invalid(&self, column: usize, needed: impl Into<String>) -> IoError {
        let name = excerpt(&self.columns.names[column]);
        let part = format!("column `{}`", name.trim_matches('"'));
        self.at.invalid_part(part, excerpt(self.text(column)), needed)
    }

    /// The cell without blanks around it.
    pub(crate) fn text(&self, column: usize) -> &'a str {
        self.cells.get(column).unwrap_or_default()
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
        self.numbers_if_any(columns)?.map(|_| self.rotation(columns)).transpose()
    }
}

/// How far a quaternion may be from unit length: three decimals are enough to mean a rotation.
const UNIT_TOLERANCE: f64 = 1e-3;

/// The columns of a table, found by the names in its first line.
#[derive(Debug)]
pub(crate) struct Columns {
    path: PathBuf,
    line: usize,
    pub(super) names: Vec<String>,
}

impl Columns {
    pub(super) fn new(path: &Path, line: usize, names: Vec<String>) -> Result<Self> {
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
