//! Arrays row by row, in memory that does not depend on their length.

use std::io::{ErrorKind, Read};
use std::path::Path;

use crate::io::IoError;
use crate::io::arrays::npy::ElementType;
use crate::io::arrays::read::{Storage, StoredArray};
use crate::io::file::invalid;

/// Most bytes of an array that is held in memory, as one in Fortran order, whose first frame ends near its end.
pub(in crate::io) const MAX_WHOLE: u64 = 1 << 30;

/// An array that is read row by row.
pub(in crate::io) struct ArrayRows {
    element: String,
    input: Box<dyn Read + Send>,
    elements: ElementType,
    row: usize,
    left: u64,
    done: u64,
    bytes: Vec<u8>,
    /// The whole array if it is in Fortran order, column by column.
    columns: Option<Vec<u8>>,
}

impl ArrayRows {
    /// Rows of `row` elements.
    pub(in crate::io) fn open(path: &Path, array: &StoredArray, row: usize) -> Result<Self, IoError> {
        let elements = array.header.elements;
        // The product of the shape was compared with the bytes that are there.
        let count: u64 = array.header.shape.iter().product();
        let left = count / row.max(1) as u64;
        let mut rows = Self {
            element: array.element(),
            input: array.open(Storage::disk(path))?,
            elements,
            row,
            left,
            done: 0,
            bytes: Vec::new(),
            columns: None,
        };
        if array.header.is_fortran && array.header.shape.len() > 1 {
            let count = usize::try_from(left).unwrap_or(usize::MAX);
            rows.fetch(path, elements.size().saturating_mul(row).saturating_mul(count))?;
            rows.columns = Some(std::mem::take(&mut rows.bytes));
        }
        Ok(rows)
    }

    /// All elements as one row, in the order of the file.
    pub(in crate::io) fn open_flat(path: &Path, array: &StoredArray, count: usize) -> Result<Self, IoError> {
        let (elements, input) = (array.header.elements, array.open(Storage::disk(path))?);
        let element = array.element();
        Ok(Self { element, input, elements, row: count, left: 1, done: 0, bytes: Vec::new(), columns: None })
    }

    /// The bytes of the next row.
    pub(in crate::io) fn into_bytes(mut self, path: &Path) -> Result<Vec<u8>, IoError> {
        self.take(path)?;
        Ok(self.bytes)
    }

    /// What errors call it.
    pub(in crate::io) fn element(&self) -> &str {
        &self.element
    }

    /// Rows that were read.
    pub(in crate::io) fn done(&self) -> u64 {
        self.done
    }

    /// Elements of a row.
    pub(in crate::io) fn width(&self) -> usize {
        self.row
    }

    /// Whether the first index is the fastest, so that a row is gathered from columns.
    pub(in crate::io) fn is_by_columns(&self) -> bool {
        self.columns.is_some()
    }

    /// Reads a number: whole if all of the array are, else a float. NaN after the last one.
    pub(in crate::io) fn read_tick(&mut self, path: &Path) -> Result<Result<i64, f64>, IoError> {
        let mut number = [f64::NAN];
        if !self.read(path, &mut number)? {
            return Ok(Err(f64::NAN));
        }
        Ok(self.elements.whole(&self.bytes).ok_or(number[0]))
    }

    /// Reads a row of numbers; false after the last one.
    pub(in crate::io) fn read(&mut self, path: &Path, out: &mut [f64]) -> Result<bool, IoError> {
        if self.left == 0 {
            return Ok(false);
        }
        self.take(path)?;
        self.elements.numbers(&self.bytes, out);
        Ok(true)
    }

    /// The texts of the next row.
    pub(in crate::io) fn texts(&mut self, path: &Path) -> Result<Vec<String>, IoError> {
        self.take(path)?;
        let mut texts = self.elements.texts(&self.bytes);
        texts.resize(self.row, String::new());
        Ok(texts)
    }

    /// Takes the bytes of the next row.
    fn take(&mut self, path: &Path) -> Result<(), IoError> {
        let size = self.elements.size();
        match &self.columns {
            Some(columns) => {
                let start = usize::try_from(self.done).unwrap_or(usize::MAX) * size;
                self.bytes.clear();
                for column in columns.chunks_exact(columns.len() / self.row) {
                    self.bytes.extend_from_slice(&column[start..start + size]);
                }
            }
            None => self.fetch(path, size * self.row)?,
        }
        self.left = self.left.saturating_sub(1);
        self.done += 1;
        Ok(())
    }

    /// Reads `size` bytes.
    fn fetch(&mut self, path: &Path, size: usize) -> Result<(), IoError> {
        // The sizes in an archive may be wrong: memory grows with the bytes that are there.
        self.bytes.clear();
        let read = (&mut self.input).take(size as u64).read_to_end(&mut self.bytes);
        let element = || format!("{}, row {}", self.element, self.done);
        match read {
            Ok(count) if count == size => {}
            Ok(count) => {
                let found = format!("an end after {count} of its {size} bytes");
                return Err(invalid(path, element(), found, "as many rows as its header states"));
            }
            Err(source) if matches!(source.kind(), ErrorKind::InvalidData | ErrorKind::InvalidInput) => {
                return Err(invalid(path, element(), source.to_string(), "an archive without damage"));
            }
            Err(source) => return Err(IoError::Read { path: path.into(), source }),
        }
        Ok(())
    }
}
