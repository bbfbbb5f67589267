//! Text line by line, and what errors call a line.

use std::{
    fmt::Display,
    io::{self, BufRead, Read},
    path::Path,
};

use crate::{
    io::{
        IoError,
        file::source::{Source, excerpt, invalid},
    },
    skin::TaxelId,
};

/// Longest line of a stream: a line of an edge has 31 numbers of at most 25 characters.
const LONGEST_LINE: u64 = 1 << 16;

/// What some editors put at the start of a text.
const BYTE_ORDER_MARK: &[u8] = "\u{feff}".as_bytes();

/// A line of a file, for messages.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LineLocation<'a> {
    pub(crate) path: &'a Path,
    /// Counted from 1.
    pub(crate) line: usize,
}

impl LineLocation<'_> {
    /// An error about the line.
    pub(crate) fn invalid(&self, found: impl Into<String>, needed: impl Into<String>) -> IoError {
        invalid(self.path, format!("line {}", self.line), found, needed)
    }

    /// An error about a part of the line.
    pub(crate) fn invalid_part(
        &self,
        part: impl Display,
        found: impl Into<String>,
        needed: impl Into<String>,
    ) -> IoError {
        invalid(self.path, format!("line {}, {part}", self.line), found, needed)
    }

    /// A finite number.
    pub(crate) fn number(&self, word: &str) -> Result<f64, IoError> {
        finite(word).ok_or_else(|| self.invalid(excerpt(word), "a finite number"))
    }

    /// The number of a taxel.
    pub(crate) fn taxel(&self, word: &str) -> Result<TaxelId, IoError> {
        let needed = "the number of a taxel, 0 to 4294967295";
        word.parse().map(TaxelId).map_err(|_| self.invalid(excerpt(word), needed))
    }
}

/// A finite number, if the word is one.
pub(crate) fn finite(word: &str) -> Option<f64> {
    word.parse().ok().filter(|x: &f64| x.is_finite())
}

impl Source {
    /// The lines of a text, each with where it is.
    ///
    /// # Errors
    /// As [`Source::text`].
    pub(crate) fn lines(&self) -> Result<impl Iterator<Item = (LineLocation<'_>, &str)>, IoError> {
        let at = |line| LineLocation { path: self.path(), line };
        Ok(self.text()?.lines().zip(1..).map(move |(text, line)| (at(line), text)))
    }
}

/// A stream of text without the lines that are blank or a comment after `#`, and without a byte
/// order mark.
///
/// As a [`Read`] it hands out one line at a time, so that whoever reads from it knows by
/// [`Lines::line`] where it is.
pub(crate) struct Lines<'a, R> {
    input: R,
    bytes: Vec<u8>,
    at: LineLocation<'a>,
    ended: bool,
    /// Bytes of the line that were handed out.
    given: usize,
}

impl<'a, R: BufRead> Lines<'a, R> {
    /// Stands on the first line.
    pub(crate) fn new(input: R, path: &'a Path) -> Result<Self, IoError> {
        let at = LineLocation { path, line: 0 };
        let mut lines = Self { input, bytes: Vec::new(), at, ended: false, given: 0 };
        lines.advance()?;
        Ok(lines)
    }

    /// The line without blanks around it, and where it is; `None` after the last one.
    ///
    /// # Errors
    /// If it is not UTF-8.
    pub(crate) fn current(&self) -> Result<Option<(&str, LineLocation<'a>)>, IoError> {
        if self.ended {
            return Ok(None);
        }
        let text = std::str::from_utf8(&self.bytes);
        let text = text.map_err(|_| self.at.invalid("bytes that are not text", "text in UTF-8"))?;
        Ok(Some((text.trim(), self.at)))
    }

    /// Goes on to the next line.
    ///
    /// # Errors
    /// If it cannot be read, or is too long.
    pub(crate) fn advance(&mut self) -> Result<(), IoError> {
        self.step().map_err(|source| match source.kind() {
            io::ErrorKind::InvalidData => self.at.invalid(source.to_string(), "a line of text"),
            _ => IoError::Read { path: self.at.path.to_owned(), source },
        })
    }

    fn step(&mut self) -> io::Result<()> {
        loop {
            self.bytes.clear();
            self.given = 0;
            let read = (&mut self.input).take(LONGEST_LINE).read_until(b'\n', &mut self.bytes)?;
            if read == 0 {
                self.ended = true;
                return Ok(());
            }
            self.at.line += 1;
            if read as u64 == LONGEST_LINE {
                let found = format!("a line of more than {LONGEST_LINE} bytes");
                return Err(io::Error::new(io::ErrorKind::InvalidData, found));
            }
            if self.at.line == 1 && self.bytes.starts_with(BYTE_ORDER_MARK) {
                self.bytes.drain(..BYTE_ORDER_MARK.len());
            }
            let text = self.bytes.trim_ascii_start();
            if !(text.is_empty() || text.starts_with(b"#")) {
                return Ok(());
            }
        }
    }
}

impl<R> Lines<'_, R> {
    /// Number of the line that was read last, from 1.
    pub(crate) fn line(&self) -> usize {
        self.at.line
    }
}

impl<R: BufRead> Read for Lines<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.given == self.bytes.len() && !self.ended {
            self.step()?;
        }
        if self.ended {
            return Ok(0);
        }
        let rest = &self.bytes[self.given..];
        let count = rest.len().min(buffer.len());
        buffer[..count].copy_from_slice(&rest[..count]);
        self.given += count;
        Ok(count)
    }
}
