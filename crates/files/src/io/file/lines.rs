//! Text line by line, and what errors call a line.

use std::fmt::Display;
use std::io::{self, BufRead, Read};
use std::path::{Path, PathBuf};

use crate::io::IoError;
use crate::io::file::{Source, excerpt, invalid};
use crate::skin::TaxelId;

/// Longest row of a table, which may have several lines. Without a bound, a stream that never ends
/// its line, or never closes a quote, would fill the memory.
pub(crate) const LONGEST: usize = 1 << 20;

/// Most bytes of a longer line that are passed over to go on with the next one; a stream may never
/// end its line.
const MOST_SKIPPED: u64 = 1 << 28;

/// Most lines of comments that are kept.
const MOST_COMMENTS: usize = 64;

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
    pub(crate) fn invalid(&self, found: impl Into<String>, needed: impl Into<String>) -> IoError {
        invalid(self.path, (self.line, ""), found, needed)
    }

    pub(crate) fn invalid_part(
        &self,
        part: impl Display,
        found: impl Into<String>,
        needed: impl Into<String>,
    ) -> IoError {
        invalid(self.path, (self.line, part.to_string()), found, needed)
    }

    pub(crate) fn number(&self, word: &str) -> Result<f64, IoError> {
        finite(word).ok_or_else(|| self.invalid(excerpt(word), number_needed(word)))
    }

    pub(crate) fn taxel(&self, word: &str) -> Result<TaxelId, IoError> {
        let needed = "the number of a taxel, 0 to 4294967295";
        word.parse().map(TaxelId).map_err(|_| self.invalid(excerpt(word), needed))
    }
}

/// What is needed instead of a number with a decimal comma.
pub(crate) const POINT_NEEDED: &str = "a number with a decimal point, not a comma";

/// Whether a word would be a number with a point for its comma.
pub(crate) fn has_decimal_comma(word: &str) -> bool {
    word.split_once(',')
        .is_some_and(|(whole, rest)| !rest.contains(',') && finite(&format!("{whole}.{rest}")).is_some())
}

/// What is needed instead of a word that is not a finite number.
pub(crate) fn number_needed(word: &str) -> &'static str {
    if has_decimal_comma(word) { POINT_NEEDED } else { "a finite number" }
}

pub(crate) fn finite(word: &str) -> Option<f64> {
    word.parse().ok().filter(|x: &f64| x.is_finite())
}

impl Source {
    pub(crate) fn lines(&self) -> Result<impl Iterator<Item = (LineLocation<'_>, &str)>, IoError> {
        let at = |line| LineLocation { path: self.path(), line };
        let text = self.text()?;
        // Some old programs end lines with a carriage return alone.
        let end = if text.contains('\n') { '\n' } else { '\r' };
        let lines = text.split_terminator(end).map(|line| line.strip_suffix('\r').unwrap_or(line));
        Ok(lines.zip(1..).map(move |(text, line)| (at(line), text)))
    }
}

/// A stream of text, line by line, without blank lines and without a byte order mark.
#[derive(Debug)]
pub(crate) struct Lines<R> {
    input: R,
    path: PathBuf,
    /// What begins a line that is passed over.
    pub(crate) comment: Option<u8>,
    /// The first lines that were passed over, while they are kept.
    pub(crate) kept_comments: Option<Vec<String>>,
    bytes: Vec<u8>,
    line: usize,
    ended: bool,
    /// Whether a row is one line, so that a bad one costs the rows after it nothing: one that is too long
    /// is passed over.
    pub(crate) has_row_per_line: bool,
    is_cut: bool,
    /// Longest line, in bytes.
    pub(crate) longest: usize,
}

impl<R: BufRead> Lines<R> {
    /// Stands before the first line.
    pub(crate) fn new(input: R, path: &Path, comment: Option<u8>) -> Self {
        let (path, bytes) = (path.to_owned(), Vec::new());
        // Numbers of an edge fill 775 bytes; a cell of a table may be a text.
        let longest = if comment.is_some() { 1 << 16 } else { LONGEST };
        Self {
            input,
            path,
            comment,
            kept_comments: None,
            bytes,
            line: 0,
            ended: false,
            has_row_per_line: false,
            is_cut: false,
            longest,
        }
    }

    /// The line, and where it is; `None` after the last one.
    pub(crate) fn current(&self) -> Result<Option<(&str, LineLocation<'_>)>, IoError> {
        let at = self.at();
        if self.ended {
            return Ok(None);
        }
        if self.is_cut {
            return Err(at.invalid(too_long(self.longest).to_string(), "a short line"));
        }
        let text = std::str::from_utf8(&self.bytes);
        let text = text.map_err(|_| at.invalid("bytes that are not text", "text in UTF-8"))?;
        Ok(Some((text.trim_end_matches(['\r', '\n']), at)))
    }

    pub(crate) fn advance(&mut self) -> Result<(), IoError> {
        self.step().map_err(|source| match source.kind() {
            io::ErrorKind::InvalidData => self.at().invalid(source.to_string(), "a line of text"),
            _ => IoError::Read { path: self.path.clone(), source },
        })
    }

    fn step(&mut self) -> io::Result<()> {
        let longest = self.longest;
        loop {
            self.bytes.clear();
            self.is_cut = false;
            let read = (&mut self.input).take(longest as u64).read_until(b'\n', &mut self.bytes)?;
            if read == 0 {
                self.ended = true;
                return Ok(());
            }
            self.line += 1;
            if read == longest && !self.bytes.ends_with(b"\n") {
                self.cut()?;
            }
            if self.line == 1 && self.bytes.starts_with(BYTE_ORDER_MARK) {
                self.bytes.drain(..BYTE_ORDER_MARK.len());
            }
            let first = self.bytes.trim_ascii_start().first();
            if first.is_some() && first != self.comment.as_ref() {
                return Ok(());
            }
            if let Some(kept) = self.kept_comments.as_mut().filter(|kept| kept.len() < MOST_COMMENTS) {
                kept.push(String::from_utf8_lossy(self.bytes.trim_ascii()).into_owned());
            }
        }
    }

    /// Passes over the rest of a line that is too long.
    fn cut(&mut self) -> io::Result<()> {
        let mut rest = (&mut self.input).take(MOST_SKIPPED);
        if !self.has_row_per_line || rest.skip_until(b'\n')? as u64 == MOST_SKIPPED {
            return Err(too_long(self.longest));
        }
        self.is_cut = true;
        Ok(())
    }
}

impl<R> Lines<R> {
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn has_ended(&self) -> bool {
        self.ended
    }

    pub(crate) fn at(&self) -> LineLocation<'_> {
        LineLocation { path: &self.path, line: self.line }
    }
}

fn too_long(longest: usize) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, format!("more than {longest} bytes"))
}
