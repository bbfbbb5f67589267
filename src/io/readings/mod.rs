//! Recordings and live streams of readings, frame by frame, in memory that does not depend on their
//! length.
//!
//! In reading order: `text` reads lines of numbers (CySkin's text and CSV, from a file or a pipe),
//! `header` says what their columns are; `arrays` reads recordings of numpy's arrays; [`ReadingsReader`] is
//! the one type for all of them, and for those in memory ([`Readings`]). `writer` writes recordings that it reads.

pub(super) mod arrays;
mod header;
mod text;
pub(super) mod writer;

use std::{fs::File, io::Read, path::Path};

use crate::io::IoError;
use crate::io::file::{cannot_read, file_kind, invalid};
use crate::io::readings::arrays::{ArrayReadings, ReadingsLayout};
use crate::io::readings::header::About;
use crate::io::readings::text::{LongReadings, TextReadings, count_rows};
use crate::signal::Channel;
use crate::skin::TaxelId;

/// Reads a recording, or a live stream, frame by frame; memory does not depend on its length.
///
/// | file | content |
/// |---|---|
/// | `.txt` | a line of taxel ids, then rows of `index time value...` between blanks, as CySkin records |
/// | `.log` | rows of `number time value...`, the taxels in the order of the map, as `yarpdatadumper` records |
/// | `.csv` | a line of names between commas, semicolons or tabs: `ID` or `ID.CHANNEL` or `ID.CHANNEL[UNIT]`; optionally `frame` and `time`, in s or as in `time[ms]` |
/// | `.txt`, `.csv` | a long table, `time,taxel_id,value` or `time,taxel_id,value[UNIT]`, with a row for each reading |
/// | `.npy` | numbers of the shape `(T, N)`, or `(T, N, C)` or `(T, C, N)` as [`ReadingsLayout`] says |
/// | `.npz` | these as the array `values` or `readings`, or the only one that can be them; optionally `ids` or `taxel_ids` `(N,)`, `timestamps` or `time` `(T,)`, in s, as dates or as in `time[ms]`, and the texts `channels` and `units` `(C,)` |
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
    Memory(Readings, usize),
}

/// A whole recording in memory.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Readings {
    /// The taxel that each column is of; `None`: all taxels in the order of the map.
    pub ids: Option<Vec<TaxelId>>,
    /// What is read of each taxel.
    pub channels: Vec<Channel>,
    /// Number of columns: taxels of a frame.
    pub width: usize,
    /// When each frame was taken, in s; NaN where that is not known.
    pub times: Vec<f64>,
    /// Frame after frame, channel after channel: one number per column.
    pub values: Vec<f64>,
}

impl Readings {
    /// Reads all frames; calls `progress` after each.
    ///
    /// # Errors
    /// As [`ReadingsReader::read`].
    pub fn collect(mut reader: ReadingsReader, mut progress: impl FnMut()) -> Result<Self, IoError> {
        let (ids, channels, width) = (reader.ids.take(), std::mem::take(&mut reader.channels), reader.width);
        let mut all = Self { ids, channels, width, ..Self::default() };
        let (mut values, mut time) = (Vec::new(), f64::NAN);
        while reader.read(&mut values, &mut time)? {
            all.values.extend_from_slice(&values);
            all.times.push(time);
            progress();
        }
        Ok(all)
    }
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
                let (text, mut about) = TextReadings::open(path, Box::new(file), kind == "csv")?;
                if is_file {
                    about.frames = Some(count_rows(path)?.saturating_sub(1));
                }
                Ok(Self::of(Source::Text(text), about))
            }
            "log" => {
                let file = File::open(path).map_err(cannot_read(path))?;
                let (text, about) = TextReadings::open_log(path, Box::new(file))?;
                Ok(Self::of(Source::Text(text), about))
            }
            kind @ ("npy" | "npz") => {
                let (arrays, about) = ArrayReadings::open(path, kind == "npz", layout)?;
                Ok(Self::of(Source::Arrays(arrays), about))
            }
            _ => Err(IoError::UnknownKind { path: path.into(), known: ".txt, .log, .csv, .npy, .npz" }),
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

    /// Reads a recording in memory.
    ///
    /// # Errors
    /// If there is not one number for each frame, channel and column.
    pub fn memory(readings: Readings) -> Result<Self, IoError> {
        let Readings { ids, channels, width, times, values } = &readings;
        let needed = times.len().saturating_mul(channels.len()).saturating_mul(*width);
        if values.len() != needed {
            let needed = format!("{needed}, one for each frame, channel and column");
            let path = Path::new("readings in memory");
            return Err(invalid(path, "values", format!("{} numbers", values.len()), needed));
        }
        let about = About {
            ids: ids.clone(),
            channels: channels.clone(),
            width: *width,
            frames: Some(times.len() as u64),
            has_times: times.iter().any(|time| time.is_finite()),
        };
        Ok(Self::of(Source::Memory(readings, 0), about))
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
            Source::Memory(readings, next) => {
                let Some(&at) = readings.times.get(*next) else { return Ok(false) };
                let count = readings.channels.len() * readings.width;
                values.clear();
                values.extend_from_slice(&readings.values[*next * count..][..count]);
                (*time, *next) = (at, *next + 1);
                Ok(true)
            }
        }
    }
}
