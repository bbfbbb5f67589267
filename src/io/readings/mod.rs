//! Recordings and live streams of readings, frame by frame, in memory that does not depend on their
//! length.
//!
//! In reading order: `text` reads lines of numbers (CySkin's text and CSV, from a file or a pipe),
//! `header` says what their columns are; `arrays` reads recordings of numpy's arrays; [`ReadingsReader`] is
//! the one type for all of them. `writer` writes recordings that it reads.

pub(super) mod arrays;
mod header;
mod text;
pub(super) mod writer;

use std::{fs::File, io::Read, path::Path};

use crate::io::IoError;
use crate::io::file::{cannot_read, file_kind};
use crate::io::readings::arrays::{ArrayReadings, ReadingsLayout};
use crate::io::readings::header::About;
use crate::io::readings::text::{LongReadings, TextReadings};
use crate::signal::Channel;
use crate::skin::TaxelId;

/// Reads a recording, or a live stream, frame by frame; memory does not depend on its length.
///
/// | file | content |
/// |---|---|
/// | `.txt` | a line of taxel ids, then rows of `index time value...` between blanks, as CySkin records |
/// | `.csv` | a line of names between commas, semicolons or tabs: `ID` or `ID.CHANNEL` or `ID.CHANNEL[UNIT]`; optionally `frame` and `time`, in s or as in `time[ms]` |
/// | `.txt`, `.csv` | a long table, `time,taxel_id,value` or `time,taxel_id,value[UNIT]`, with a row for each reading |
/// | `.npy` | numbers of the shape `(T, N)`, or `(T, N, C)` or `(T, C, N)` as [`ReadingsLayout`] says |
/// | `.npz` | these as the array `values` or `readings`, or the only one that can be them; optionally `ids` `(N,)`, `timestamps` `(T,)` in s, and the texts `channels` and `units` `(C,)` |
///
/// A time may be a date of ISO 8601, then counted from 1970 on. An empty cell, NaN and infinities are readings that are missing. The unit and name of a channel
/// say of what kind it is ([`Channel::new`]).
///
/// ```
/// use std::path::Path;
///
/// use dermatome::io::ReadingsReader;
///
/// let text = "time,7.pressure[Pa],9.pressure[Pa]\n0.0,100,\n0.1,120,80\n";
/// let mut reader = ReadingsReader::stream(Path::new("-"), text.as_bytes())?;
/// assert_eq!((reader.width, reader.channels[0].unit.as_str()), (2, "Pa"));
/// let (mut values, mut time) = (Vec::new(), 0.0);
/// while reader.read(&mut values, &mut time)? {
///     println!("{time}: {values:?}");
/// }
/// assert_eq!((values, time), (vec![120.0, 80.0], 0.1));
/// # Ok::<(), dermatome::io::IoError>(())
/// ```
pub struct ReadingsReader {
    /// The taxel that each column is of; `None`: all taxels in the order of the map. An id may come
    /// twice.
    pub ids: Option<Vec<TaxelId>>,
    /// What is read of each taxel. A caller that knows better may give other names and units.
    pub channels: Vec<Channel>,
    /// Number of columns: taxels of a frame.
    pub width: usize,
    /// Number of frames, if it is known from the beginning.
    pub frames: Option<u64>,
    /// Whether frames have a time.
    pub has_times: bool,
    source: Source,
}

enum Source {
    Text(TextReadings),
    Long(LongReadings),
    Arrays(ArrayReadings),
}

impl ReadingsReader {
    /// Opens a file; its kind follows from its extension.
    ///
    /// # Errors
    /// If it cannot be read, is of another kind, does not say what its columns are, is empty, or its
    /// arrays do not fit each other or the bytes that are there.
    pub fn open(path: &Path, layout: ReadingsLayout) -> Result<Self, IoError> {
        match file_kind(path).as_str() {
            kind @ ("txt" | "csv") => {
                let is_file = std::fs::metadata(path).is_ok_and(|about| about.is_file());
                let long = if is_file { LongReadings::open(path, kind == "csv")? } else { None };
                if let Some((long, about)) = long {
                    return Ok(Self::of(Source::Long(long), about));
                }
                let file = File::open(path).map_err(cannot_read(path))?;
                let (text, about) = TextReadings::open(path, Box::new(file), kind == "csv")?;
                Ok(Self::of(Source::Text(text), about))
            }
            kind @ ("npy" | "npz") => {
                let (arrays, about) = ArrayReadings::open(path, kind == "npz", layout)?;
                Ok(Self::of(Source::Arrays(arrays), about))
            }
            _ => Err(IoError::UnknownKind { path: path.into(), known: ".txt, .csv, .npy, .npz" }),
        }
    }

    fn of(source: Source, About { ids, channels, width, frames, has_times }: About) -> Self {
        Self { ids, channels, width, frames, has_times, source }
    }

    /// Reads a stream of text or CSV, which errors call `path`. A line is read as soon as it has
    /// ended.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn stream(path: &Path, input: impl Read + Send + 'static) -> Result<Self, IoError> {
        let (text, about) = TextReadings::open(path, Box::new(input), false)?;
        Ok(Self::of(Source::Text(text), about))
    }

    /// Reads the next frame: the number of column `n` and channel `c` is `values[c * width + n]`,
    /// the time is in s. False after the last frame. Without times `time` becomes NaN.
    ///
    /// # Errors
    /// If the row has another number of cells, a cell is not a number, the file has ended too early,
    /// or there is no row at all. After an error about a line the next one may be read.
    pub fn read(&mut self, values: &mut Vec<f64>, time: &mut f64) -> Result<bool, IoError> {
        match &mut self.source {
            Source::Text(text) => text.read(values, time),
            Source::Long(long) => long.read(values, time),
            Source::Arrays(arrays) => arrays.read(values, time),
        }
    }
}
