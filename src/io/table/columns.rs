//! The columns of a table, found by their names.

use std::{
    collections::HashSet,
    path::{Path, PathBuf},
};

use crate::io::{
    error::Result,
    file::{LineLocation, excerpt},
};

/// The columns of a table, found by the names in its first line.
#[derive(Debug)]
pub(crate) struct Columns {
    path: PathBuf,
    /// The line of the names.
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
