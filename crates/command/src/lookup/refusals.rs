//! Rows of a table that are not answered: counted and listed, while the others are answered.

use std::{fmt::Display, path::PathBuf};

use dermatome::io::IoError;

use crate::console::errors::advise;
use crate::console::notes::note_count;
use crate::options::Common;

/// Refused rows that are quoted.
const QUOTED: usize = 5;

pub(super) struct Refusals {
    /// Name of the table in errors.
    pub(super) path: PathBuf,
    count: u64,
    refused: u64,
    /// Rows of answers whose contact was off the skin.
    pub(super) off_skin: u64,
    /// The first refused rows.
    quoted: Vec<IoError>,
}

impl Refusals {
    pub(super) fn new(path: PathBuf) -> Self {
        Self { path, count: 0, refused: 0, off_skin: 0, quoted: Vec::new() }
    }

    /// Counts the next row, and returns its place in the table and itself if it can be answered.
    pub(super) fn sort<T>(&mut self, row: Result<T, IoError>) -> Result<Option<(u64, T)>, IoError> {
        let number = self.count;
        self.count += 1;
        match row {
            Ok(row) => Ok(Some((number, row))),
            Err(error @ IoError::Invalid { .. }) => {
                self.refused += 1;
                if self.quoted.len() < QUOTED {
                    self.quoted.push(error);
                }
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }

    pub(super) fn invalid(&self, line: u64, part: &str, found: String, needed: &str) -> IoError {
        let element = (line, part).into();
        IoError::Invalid { path: self.path.clone(), element, found, needed: needed.into() }
    }

    /// An error if rows were refused and none answered: then nothing is written, and
    /// [`Refusals::explain`] lists the rows.
    pub(super) fn check_any(&self) -> Result<(), IoError> {
        if self.answered() > 0 || self.refused == 0 {
            return Ok(());
        }
        let (found, needed) = ("no row that can be answered".into(), "contacts".into());
        Err(IoError::Invalid { path: self.path.clone(), element: "all rows".into(), found, needed })
    }

    /// What became of the table of answers; the refused rows if it was not written for them.
    pub(super) fn explain(&self, written: anyhow::Result<()>) -> anyhow::Result<()> {
        if written.is_err() && self.answered() == 0 {
            self.finish()?;
        }
        written
    }

    /// Rows that were read and can be answered.
    pub(super) fn answered(&self) -> u64 {
        self.count - self.refused - self.off_skin
    }

    /// Says how many rows are of contacts off the skin.
    pub(super) fn note_off_skin(&self, common: &Common) {
        note_count(common, self.off_skin, "rows", "without an answer: contacts off the skin have none");
    }

    /// An error about the rows that were refused, if any were.
    pub(super) fn finish(&self) -> anyhow::Result<()> {
        if self.refused == 0 {
            return Ok(());
        }
        let (refused, count) = (self.refused, self.count);
        let quoted: Vec<_> = self.quoted.iter().map(ToString::to_string).collect();
        let mut what = format!("{refused} of {count} rows have no answer: {}", quoted.join("; "));
        if refused > self.quoted.len() as u64 {
            what.push_str("; ...");
        }
        let others = if self.answered() > 0 { "all others are answered" } else { "there are no others" };
        Err(advise(what, format!("correct or remove them; {others}")))
    }
}

/// Contacts are checked as they are read; what is left is an error about all of them.
pub(super) fn unanswered(error: impl Display) -> IoError {
    let (path, element, needed) = ("contacts".into(), "all".into(), "contacts that can be answered".into());
    IoError::Invalid { path, element, found: error.to_string(), needed }
}
