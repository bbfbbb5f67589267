//! Lines of a text of observations, and what errors call them.

use std::{
    io::{BufRead, Read},
    path::Path,
};

use crate::{
    io::{
        IoError,
        file::source::{excerpt, invalid},
    },
    skin::TaxelId,
};

/// Longest line that is read: a line of an edge has 31 numbers of at most 25 characters.
const LONGEST_LINE: u64 = 1 << 16;

/// A text line by line, without the lines that are blank or a comment after `#`, and without a byte order mark.
pub(crate) struct Lines<'a, R> {
    input: R,
    text: String,
    at: Place<'a>,
    ended: bool,
}

impl<'a, R: BufRead> Lines<'a, R> {
    /// Stands on the first line.
    pub(crate) fn new(input: R, path: &'a Path) -> Result<Self, IoError> {
        let mut lines = Self { input, text: String::new(), at: Place { path, line: 0 }, ended: false };
        lines.advance()?;
        Ok(lines)
    }

    /// The line without blanks around it, and where it is; `None` after the last one.
    pub(crate) fn current(&self) -> Option<(&str, Place<'a>)> {
        (!self.ended).then(|| (self.text.trim(), self.at))
    }

    /// Goes on to the next line.
    pub(crate) fn advance(&mut self) -> Result<(), IoError> {
        loop {
            self.at.line += 1;
            self.read()?;
            let text = self.text.trim_start();
            if self.ended || !(text.is_empty() || text.starts_with('#')) {
                return Ok(());
            }
        }
    }

    fn read(&mut self) -> Result<(), IoError> {
        let at = self.at;
        self.text.clear();
        let mut bytes = std::mem::take(&mut self.text).into_bytes();
        let read = (&mut self.input).take(LONGEST_LINE).read_until(b'\n', &mut bytes);
        let read = read.map_err(|source| IoError::Read { path: at.path.to_owned(), source })?;
        if read as u64 == LONGEST_LINE {
            return Err(at.invalid("a line of more than 65536 bytes", "a line of text"));
        }
        self.ended = read == 0;
        self.text =
            String::from_utf8(bytes).map_err(|_| at.invalid("bytes that are no text", "text in UTF-8"))?;
        if at.line == 1 && self.text.starts_with(BYTE_ORDER_MARK) {
            self.text.drain(..BYTE_ORDER_MARK.len_utf8());
        }
        Ok(())
    }
}

/// What some editors put at the start of a text.
const BYTE_ORDER_MARK: char = '\u{feff}';

/// A line of a file, for messages.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place<'a> {
    pub(crate) path: &'a Path,
    pub(crate) line: usize,
}

impl Place<'_> {
    pub(crate) fn invalid(&self, found: impl Into<String>, needed: impl Into<String>) -> IoError {
        invalid(self.path, format!("line {}", self.line), found, needed)
    }

    /// A finite number.
    pub(crate) fn number(&self, word: &str) -> Result<f64, IoError> {
        match word.parse::<f64>() {
            Ok(x) if x.is_finite() => Ok(x),
            _ => Err(self.invalid(excerpt(word), "a finite number")),
        }
    }

    /// The number of a taxel.
    pub(crate) fn taxel(&self, word: &str) -> Result<TaxelId, IoError> {
        let needed = "the number of a taxel, 0 to 4294967295";
        word.parse().map(TaxelId).map_err(|_| self.invalid(excerpt(word), needed))
    }
}
