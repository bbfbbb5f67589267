//! Lines of texts that need not be UTF-8, and their numbers.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use crate::io::IoError;
use crate::io::file::lines::{LineLocation, POINT_NEEDED, has_decimal_comma};
use crate::io::file::{cannot_read, excerpt};

/// The longest line, in bytes.
const LONGEST_LINE: usize = 1 << 24;

/// The most lines of a header.
const LONGEST_HEADER: usize = 10_000;

/// A text, line by line.
pub(super) struct TextLines {
    input: BufReader<File>,
    path: PathBuf,
    line: Vec<u8>,
    number: usize,
    /// Whether the line is given once more.
    is_held: bool,
}

impl TextLines {
    pub(super) fn open(path: &Path) -> Result<Self, IoError> {
        let file = File::open(path).map_err(cannot_read(path))?;
        let input = BufReader::with_capacity(1 << 18, file);
        Ok(Self { input, path: path.into(), line: Vec::new(), number: 0, is_held: false })
    }

    /// Goes to the next line; false after the last one. Its end is left out.
    pub(super) fn advance(&mut self) -> Result<bool, IoError> {
        if std::mem::take(&mut self.is_held) {
            return Ok(true);
        }
        self.line.clear();
        let read = (&mut self.input).take(LONGEST_LINE as u64).read_until(b'\n', &mut self.line);
        let read = read.map_err(cannot_read(&self.path))?;
        if read == 0 {
            return Ok(false);
        }
        self.number += 1;
        if read == LONGEST_LINE {
            return Err(self.at().invalid(format!("more than {LONGEST_LINE} bytes"), "a line of text"));
        }
        while self.line.last().is_some_and(|byte| matches!(byte, b'\n' | b'\r')) {
            self.line.pop();
        }
        if self.number == 1 && self.line.starts_with("\u{feff}".as_bytes()) {
            self.line.drain(..3);
        }
        Ok(true)
    }

    /// Goes to the next line that is not blank; commas alone are blank.
    pub(super) fn advance_to_content(&mut self) -> Result<bool, IoError> {
        while self.advance()? {
            if self.line.iter().any(|byte| !byte.is_ascii_whitespace() && *byte != b',') {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Gives this line once more.
    pub(super) fn hold(&mut self) {
        self.is_held = true;
    }

    pub(super) fn bytes(&self) -> &[u8] {
        &self.line
    }

    /// The line as text; what is not UTF-8 is Latin-1.
    pub(super) fn text(&self) -> String {
        match std::str::from_utf8(&self.line) {
            Ok(text) => text.into(),
            Err(_) => self.line.iter().map(|&byte| char::from(byte)).collect(),
        }
    }

    pub(super) fn at(&self) -> LineLocation<'_> {
        LineLocation { path: &self.path, line: self.number }
    }

    /// Refuses a header that does not end.
    pub(super) fn check_header(&self, end: &str) -> Result<(), IoError> {
        let is_long = self.number > LONGEST_HEADER;
        if is_long {
            Err(self.at().invalid("a header without an end", format!("{end} after it")))
        } else {
            Ok(())
        }
    }

    /// An error about a file that has ended.
    pub(super) fn ended(&self, needed: &str) -> IoError {
        self.at().invalid("the end of the file", needed)
    }

    /// The number in a cell; `part` names it.
    pub(super) fn number(&self, cell: &[u8], part: impl Fn() -> String) -> Result<f64, IoError> {
        number(cell).ok_or_else(|| {
            let word = String::from_utf8_lossy(cell);
            let needed = if has_decimal_comma(&word) { POINT_NEEDED } else { "a number" };
            self.at().invalid_part(part(), excerpt(&word), needed)
        })
    }
}

/// Digits whose value is exact as a float.
const EXACT_DIGITS: usize = 15;

/// A finite number; digits with at most one point are read without the library.
pub(super) fn number(cell: &[u8]) -> Option<f64> {
    const POWERS: [f64; EXACT_DIGITS + 1] =
        [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15];
    let cell = cell.trim_ascii();
    if cell.is_empty() {
        return None;
    }
    if cell.len() <= EXACT_DIGITS {
        let (mut whole, mut digits, mut point) = (0_u64, 0, None);
        for &byte in cell {
            match byte {
                b'0'..=b'9' => (whole, digits) = (10 * whole + u64::from(byte - b'0'), digits + 1),
                b'.' if point.is_none() => point = Some(digits),
                _ => return slow(cell),
            }
        }
        // Both are exact, so that the quotient is the nearest number.
        return (digits > 0).then(|| whole as f64 / POWERS[digits - point.unwrap_or(digits)]);
    }
    slow(cell)
}

fn slow(cell: &[u8]) -> Option<f64> {
    let text = std::str::from_utf8(cell).ok()?;
    // Words such as `inf` are no readings of these programs.
    let is_number = text.bytes().all(|b| b.is_ascii_digit() || b"+-.eE".contains(&b));
    text.parse().ok().filter(|x: &f64| is_number && x.is_finite())
}

/// The cells of a line between signs.
pub(super) fn cells(line: &[u8], sign: u8) -> impl Iterator<Item = &[u8]> {
    line.split(move |&byte| byte == sign).map(<[u8]>::trim_ascii)
}

/// The words of a line between blanks.
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_the_library() {
        for text in
            ["0", "12.5", "0.000", "1514.73", ".5", "5.", "-3", "1e3", "123456789012345", "0.1234567890123"]
        {
            assert_eq!(number(text.as_bytes()), text.parse().ok(), "{text}");
        }
        for text in ["", ".", "1.2.3", "inf", "nan", "1,5", "B", "1e999", "-", "0x10"] {
            assert_eq!(number(text.as_bytes()), None, "{text}");
        }
    }
}
