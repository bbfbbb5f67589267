//! Tables with a line of column names, between commas, semicolons or tabs: the one engine that reads and writes them.
//! Recordings, which may be live streams, are read in `readings/text` with the same [`Cells`].
//!
//! Columns are found by name, in any order and in capitals too; `id` and `taxel_id` are one name. Errors name the line and the column.

pub(super) mod body_words;
pub(super) mod by_taxel;
pub(super) mod calibration;
pub(super) mod cells;
pub(super) mod contacts;
pub(super) mod design;
pub(super) mod diff;
#[cfg(feature = "robots")]
pub(super) mod joints;
pub(super) mod landmarks;
pub(super) mod lookups;
pub(super) mod motion;
pub(super) mod order;
pub(super) mod region_writer;
pub(super) mod response;
pub(super) mod regions;
pub(super) mod series;
pub(super) mod summary;
pub(super) mod touch_log;
pub(super) mod writer;

use std::collections::HashSet;
use std::io::BufRead;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};

use self::cells::{Cells, Separator};

use crate::io::IoError;
use crate::io::error::Result;
use crate::io::file::lines::number_needed;
use crate::io::file::times::{seconds, time_column};
use crate::io::file::{LONGEST, LineLocation, Lines, Source, excerpt, finite, invalid};
use crate::skin::TaxelId;

/// Most lines of a row, which is split again with every line of a text in quotes.
const MOST_LINES: usize = 1000;

/// A table that is read row by row.
#[derive(Debug)]
pub(crate) struct Table<R> {
    lines: Lines<R>,
    pub(crate) columns: Columns,
    cells: Cells,
    separator: Separator,
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
        let separator = Separator::of(lines.current()?.map_or("", |(line, _)| line), &[',', ';', '\t']);
        let separator = separator.unwrap_or(Separator::Sign(','));
        read_row(&mut lines, &mut cells, separator)?;
        let ignores_case = lines.comment.is_some();
        // What follows a colon is the name of something, as in `dx:Elbow`.
        let name = |name: &str| match name.split_once(':') {
            Some((before, of)) if ignores_case => format!("{}:{of}", before.to_ascii_lowercase()),
            _ if ignores_case => name.to_ascii_lowercase(),
            _ => name.to_owned(),
        };
        let at = lines.at();
        let columns = Columns::new(at.path, at.line.max(1), cells.iter().map(name).collect())?;
        Ok(Self { lines, columns, cells, separator, ended: false })
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
        read_row(&mut self.lines, &mut self.cells, self.separator)?;
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

    /// What `read` makes of the rows.
    pub(crate) fn rows<T>(mut self, mut read: impl FnMut(Row<'_>) -> Result<T>) -> Result<Vec<T>> {
        let mut rows = Vec::new();
        while self.advance()? {
            rows.push(read(self.row())?);
        }
        Ok(rows)
    }

    /// What `read` makes of the rows, of which there must be one; `needed` calls them.
    pub(crate) fn some_rows<T>(self, needed: &str, read: impl FnMut(Row<'_>) -> Result<T>) -> Result<Vec<T>> {
        let path = self.lines.path().to_owned();
        let rows = self.rows(read)?;
        let none = || invalid(&path, "the table", "no row below the names of its columns", needed);
        if rows.is_empty() { Err(none()) } else { Ok(rows) }
    }

    /// What `read` makes of each row, one after the other.
    pub(crate) fn into_rows<T>(
        self,
        read: impl Fn(Row<'_>) -> Result<T> + Send + 'static,
    ) -> TableRows<R, T> {
        TableRows { table: self, read: Box::new(read) }
    }
}

/// The rows of a table, one after the other. After an error about a row the next one follows; after another error
/// nothing does.
pub struct TableRows<R, T> {
    table: Table<R>,
    read: Box<dyn Fn(Row<'_>) -> Result<T> + Send>,
}

impl<R, T> TableRows<R, T> {
    /// Whether the table has a column of times; its cells may be empty.
    pub fn has_times(&self) -> bool {
        self.table.columns.time_place().is_some()
    }
}

impl<R: BufRead, T> Iterator for TableRows<R, T> {
    type Item = Result<T>;

    fn next(&mut self) -> Option<Result<T>> {
        match self.table.advance() {
            Ok(more) => more.then(|| (self.read)(self.table.row())),
            Err(error) => Some(Err(error)),
        }
    }
}

/// Visits the rows of a table that has these columns, each with their places; returns the names of other columns.
pub(crate) fn each_row_of<const N: usize>(
    path: &Path,
    names: [&str; N],
    visit: &mut dyn FnMut(Row<'_>, [usize; N]) -> Result<()>,
) -> Result<Vec<String>> {
    let source = Source::open(path)?;
    let table = Table::of(&source)?;
    let columns = table.columns.need_vector(names)?;
    let unused = table.columns.unused(&names);
    table.each_row(&mut |row| visit(row, columns))?;
    Ok(unused)
}

/// Splits the row that begins on the line where `lines` stands; it may have more of them.
fn read_row<R: BufRead>(lines: &mut Lines<R>, cells: &mut Cells, separator: Separator) -> Result<()> {
    let Some((line, _)) = lines.current()? else {
        cells.split("", separator, false);
        return Ok(());
    };
    if lines.has_row_per_line {
        cells.split(line, separator, line.matches('"').count().is_multiple_of(2));
        return Ok(());
    }
    if !cells.split(line, separator, true) {
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
        if !cells.split(&row, separator, true) {
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
        let word = self.text(column);
        finite(word).ok_or_else(|| self.invalid(column, number_needed(word)))
    }

    /// A time in s.
    pub(crate) fn time(&self, column: TimeColumn) -> Result<f64> {
        seconds(self.text(column.column), column.per_second)
            .map_err(|needed| self.invalid(column.column, needed))
    }

    /// A time in s, or an empty cell.
    pub(crate) fn time_if_any(&self, column: Option<TimeColumn>) -> Result<Option<f64>> {
        let column = column.filter(|time| !self.text(time.column).is_empty());
        column.map(|column| self.time(column)).transpose()
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
    /// Tables print rounded digits, so a length up to [`QUATERNION_TOLERANCE`] from 1 is scaled to 1;
    /// anything else is not meant as a rotation. (glTF has a narrower rule of its own, and graphs
    /// of g2o are scaled with a remark.)
    pub(crate) fn rotation(&self, columns: [usize; 4]) -> Result<DQuat> {
        let q = DQuat::from_array(self.numbers(columns)?);
        let off = (q.length() - 1.0).abs();
        if off.is_nan() || off > QUATERNION_TOLERANCE {
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
const QUATERNION_TOLERANCE: f64 = 1e-3;

/// A column of times, and how many of their unit are a second.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TimeColumn {
    column: usize,
    per_second: u32,
}

/// Names of the one column that has the ids of taxels.
const IDS: [&str; 2] = ["taxel_id", "id"];

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
        if names.iter().all(|name| name.parse::<f64>().is_ok()) {
            let found = format!("the numbers {}; the header is missing", excerpt(&names.join(",")));
            return Err(at.invalid(found, "a first line with the names of the columns"));
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
        let has_ids = IDS.iter().any(|name| known.contains(name));
        let time = self.time_place().filter(|_| known.contains(&"time"));
        let is_known = move |(k, name): &(usize, &str)| {
            known.iter().any(|known| *known != "time" && known.eq_ignore_ascii_case(name))
                || has_ids && IDS.contains(name)
                || time == Some(*k)
        };
        self.names.iter().map(String::as_str).enumerate().filter(move |column| !is_known(column))
    }

    /// The names of the columns that are not known.
    pub(crate) fn unused(&self, known: &[&str]) -> Vec<String> {
        self.unknown(known).map(|(_, name)| name.to_owned()).collect()
    }

    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        let find = |name: &str| {
            let exact = self.names.iter().position(|n| n == name);
            exact.or_else(|| self.names.iter().position(|n| n.eq_ignore_ascii_case(name)))
        };
        // The same column in each table, also where a table has both.
        if IDS.contains(&name) { IDS.into_iter().find_map(find) } else { find(name) }
    }

    /// Whether a column has exactly this name.
    #[cfg(feature = "robots")]
    pub(crate) fn is_called(&self, column: usize, name: &str) -> bool {
        self.names.get(column).is_some_and(|known| known == name)
    }

    /// The place of the column of times: `time` before other names of times.
    fn time_place(&self) -> Option<usize> {
        let is_time = |name: &str| time_column(name).is_some();
        let is_first =
            |name: &str| is_time(name) && name.get(..4).is_some_and(|name| name.eq_ignore_ascii_case("time"));
        let place = |is: &dyn Fn(&str) -> bool| self.names.iter().position(|name| is(name));
        place(&is_first).or_else(|| place(&is_time))
    }

    /// The column of times, `time` or another name of times, in s or as in `time[ms]`.
    pub(crate) fn find_time(&self) -> Result<Option<TimeColumn>> {
        let unit = |k: usize| Some((k, time_column(&self.names[k])?));
        let Some((column, unit)) = self.time_place().and_then(unit) else { return Ok(None) };
        let invalid = |needed| {
            self.at().invalid_part(format!("column {}", column + 1), excerpt(&self.names[column]), needed)
        };
        Ok(Some(TimeColumn { column, per_second: unit.map_err(invalid)? }))
    }

    pub(crate) fn need(&self, name: &str) -> Result<usize> {
        self.find(name).ok_or_else(|| self.at().invalid(self.describe(), format!("a column `{name}`")))
    }

    /// The names, in their order.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.names.iter().map(String::as_str)
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
