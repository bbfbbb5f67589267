//! Recordings and live streams of readings, frame by frame, in memory that does not depend on their
//! length.

pub(super) mod arrays;
pub(super) mod blocks;
mod header;
mod laid;
mod text;
pub(super) mod writer;

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use crate::io::IoError;
use crate::io::file::{cannot_read, exists, file_kind, invalid};
use crate::io::layout::{KnownRest, Layout, Statement, StatementSource, StreamFacts};
use crate::io::readings::arrays::{ArrayReadings, ReadingsLayout};
use crate::io::readings::blocks::{Block, BlockReadings, Readings};
use crate::io::readings::header::About;
use crate::io::readings::laid::LaidReadings;
use crate::io::readings::text::{FirstLine, LongReadings, TextReadings, count_rows, has_row_first};
use crate::io::streams::{self, FileTime, Frames, OpenStream, Wanted};
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
/// | `.npy` | numbers of the shape `(T, N)`, or `(T, N, C)` or `(T, C, N)`, by [`ReadingsLayout`] |
/// | `.npz` | these as the array `values` or `readings`, or the only one that can be them; optionally `ids` or `taxel_ids` `(N,)`, `timestamps` or `time` `(T,)`, in s, as dates or as in `time[ms]`, the texts `channels` and `units` `(C,)`, and the numbers `is_tared` and `threshold` ([`KnownRest`]) |
///
/// A time may be a date of ISO 8601, then counted from 1970 on. An empty cell, NaN and infinities are readings that are missing. The unit and name of a channel
/// determine its quantity ([`Channel::new`]).
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
    /// What is read of each taxel. A caller may give other names and units.
    pub channels: Vec<Channel>,
    /// Number of columns: taxels of a frame.
    pub width: usize,
    /// Number of frames, if it is known from the beginning.
    pub frames: Option<u64>,
    /// Whether frames have a time.
    pub has_times: bool,
    /// What is known of readings where nothing touches.
    pub rest: KnownRest,
    source: Source,
    chosen: Option<Chosen>,
    /// The ids that a first line of numbers alone may be, until a skin says whether it is.
    first_line: Option<Vec<TaxelId>>,
    notes: Vec<Statement>,
}

/// Columns of a source that are read, in their order.
struct Chosen {
    columns: Vec<usize>,
    /// Number of columns of the source.
    width: usize,
    values: Vec<f64>,
}

enum Source {
    Text(TextReadings),
    Long(LongReadings),
    Arrays(ArrayReadings),
    Laid(Box<LaidReadings>),
    Memory(Readings, usize),
    Blocks(Box<BlockReadings>),
}

/// How a file of readings is read.
#[derive(Debug, Clone, Default)]
pub struct ReadOptions {
    /// The axes of an array of three, without a layout.
    pub axes: ReadingsLayout,
    /// What the numbers mean, where the file does not state it.
    pub layout: Option<Layout>,
    /// Which stream of the file; by default that of the layout, or the only one.
    pub stream: Option<String>,
    /// Which episode, where the layout has an axis of them; by default that of the layout, or one after the other.
    pub episode: Option<u64>,
}

impl From<ReadingsLayout> for ReadOptions {
    fn from(axes: ReadingsLayout) -> Self {
        Self { axes, ..Self::default() }
    }
}

impl Source {
    /// Opens a file by its extension.
    fn open(path: &Path, axes: ReadingsLayout, how: FirstLine<'_>) -> Result<(Self, About), IoError> {
        exists(path)?;
        match file_kind(path).as_str() {
            kind @ ("txt" | "csv") => {
                let is_file = std::fs::metadata(path).is_ok_and(|about| about.is_file());
                let long = if is_file { LongReadings::open(path, kind == "csv")? } else { None };
                if let Some((long, about)) = long {
                    return Ok((Self::Long(long), about));
                }
                let is_csv = kind == "csv";
                let is_row = is_file && !is_csv && has_row_first(path, is_csv)?;
                let file = File::open(path).map_err(cannot_read(path))?;
                let how = FirstLine { is_csv, is_row, ..how };
                let (text, mut about) = TextReadings::open(path, Box::new(file), how)?;
                if is_file {
                    about.frames = Some(count_rows(path)?.saturating_sub(u64::from(!text.is_ahead())));
                }
                Ok((Self::Text(text), about))
            }
            "log" => {
                let file = File::open(path).map_err(cannot_read(path))?;
                let (text, about) = TextReadings::open_log(path, Box::new(file))?;
                Ok((Self::Text(text), about))
            }
            kind @ ("npy" | "npz") => {
                let (arrays, about) = ArrayReadings::open(path, kind == "npz", axes)?;
                Ok((Self::Arrays(arrays), about))
            }
            _ => {
                let known = ".txt, .log, .csv, .npy, .npz, Tekscan, XSENSOR, novel, Stappone, XELA";
                Err(IoError::UnknownKind { path: path.into(), known })
            }
        }
    }

    /// Takes the first line for ids.
    fn skip_first(&mut self) {
        if let Self::Text(text) = self {
            text.skip_first();
        }
    }

    /// What reading has shown so far.
    fn statements(&self) -> Vec<Statement> {
        let lost = if let Self::Text(text) = self { text.lost() } else { 0 };
        let value = format!("{lost} packets, by their numbers; not filled");
        let stated = (lost > 0).then(|| Statement::new("lost packets", value, StatementSource::Checked));
        stated.into_iter().collect()
    }

    fn read(&mut self, values: &mut Vec<f64>, time: &mut f64) -> Result<bool, IoError> {
        match self {
            Self::Text(text) => text.read(values, time),
            Self::Long(long) => long.read(values, time),
            Self::Arrays(arrays) => arrays.read(values, time),
            Self::Laid(laid) => laid.read(values, time),
            Self::Blocks(blocks) => blocks.read(values, time),
            Self::Memory(readings, next) => {
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

/// Frames of a text for a layout: rows, or matrices of some rows each.
struct Rows {
    path: PathBuf,
    source: Source,
    /// How many of the units of its times are a second.
    per_second: f64,
    /// Rows of a frame, and one of them.
    count: usize,
    row: Vec<f64>,
}

impl Rows {
    /// Opens rows by a layout, which may fold their cells; `about` is what their text states.
    fn open(
        path: &Path,
        layout: &Layout,
        mut source: Source,
        mut about: About,
    ) -> Result<OpenStream, IoError> {
        if layout.frame_axis() != 0 {
            let found = format!("\"frame\" as axis {}", layout.frame_axis() + 1);
            return Err(invalid(
                layout.name(),
                "axes",
                found,
                "\"frame\" first: a line of a text is a frame",
            ));
        }
        if let Some(ids) = about.first_line.take()
            && layout.calls_ids(&ids)?
        {
            source.skip_first();
            about.frames = about.frames.map(|frames| frames.saturating_sub(1));
            about.ids = Some(ids);
        }
        let mut facts = about.facts();
        let mut count = 1;
        if let &[width] = facts.cells.as_slice()
            && layout.axes().len() > 2
            && let Some((cells, rows)) = layout.folded(width)
            && (rows == 1 || !about.has_times && facts.ids.is_none())
        {
            (facts.cells, count) = (cells, rows);
        }
        let frames = about.frames.map(|rows| rows / count as u64);
        let per_second = f64::from(about.per_second.max(1));
        let rows = Self { path: path.into(), source, per_second, count, row: Vec::new() };
        Ok(OpenStream { facts, frames, sheet: None, source: Box::new(rows) })
    }
}

impl Frames for Rows {
    fn read(&mut self, cells: &mut Vec<f64>, time: &mut FileTime) -> Result<bool, IoError> {
        let mut seconds = f64::NAN;
        let is_frame = self.source.read(cells, &mut seconds)?;
        for row in 1..self.count {
            if is_frame && !self.source.read(&mut self.row, &mut seconds)? {
                let found = format!("the end after {row} lines of a frame");
                let needed = format!("{}, as the shape in the layout has", self.count);
                return Err(invalid(&self.path, "frames", found, needed));
            }
            cells.extend_from_slice(&self.row);
        }
        *time = if seconds.is_nan() { FileTime::None } else { FileTime::Real(seconds * self.per_second) };
        Ok(is_frame)
    }

    fn statements(&self) -> Vec<Statement> {
        self.source.statements()
    }
}

impl Readings {
    /// Reads all frames; calls `progress` after each.
    ///
    /// # Errors
    /// As [`ReadingsReader::read`].
    pub fn collect(mut reader: ReadingsReader, mut progress: impl FnMut()) -> Result<Self, IoError> {
        let (ids, channels, width) = (reader.ids.take(), std::mem::take(&mut reader.channels), reader.width);
        let mut all =
            Self { ids, channels, width, rest: std::mem::take(&mut reader.rest), ..Self::default() };
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
    /// Opens a file; its kind follows from its content, or its extension.
    ///
    /// # Errors
    /// If it cannot be read, is of another kind, does not name its columns, is empty, or its
    /// arrays do not fit each other or the bytes that are there; if it has several streams and none is chosen, or states
    /// something else than the layout.
    pub fn open(path: &Path, options: impl Into<ReadOptions>) -> Result<Self, IoError> {
        let ReadOptions { axes, layout, stream, episode } = &options.into();
        exists(path)?;
        streams::refuse_stand_in(path)?;
        let is_vendor = streams::is_vendor(path);
        let axis = layout.as_ref().filter(|layout| layout.episode_axis().is_some());
        if axis.is_some() && !streams::is_arrays(path) {
            let needed = "axes without it: only an array of numpy has one";
            return Err(invalid(path, "axes", "an axis \"episode\" in the layout", needed));
        }
        if let Some(number) = episode.filter(|number| *number > 0 && axis.is_none()) {
            let needed = "0: this file is one episode; an array may have an axis of them";
            return Err(invalid(path, "episode", number.to_string(), needed));
        }
        if layout.is_none() && stream.is_none() && !is_vendor {
            let (source, about) = Source::open(path, *axes, FirstLine::default())?;
            return Ok(Self::of(source, about));
        }
        let wanted = Wanted { stream: stream.as_deref(), layout: layout.as_ref(), episode: *episode };
        let opened = if layout.is_some() || is_vendor { streams::open(path, wanted)? } else { None };
        let opened = match opened {
            Some(opened) => opened,
            None => {
                let how = FirstLine { layout: layout.as_ref(), ..FirstLine::default() };
                let (source, about) = Source::open(path, *axes, how)?;
                wanted.choose(path, &[(String::new(), about.facts().cells)])?;
                match layout {
                    Some(layout) => Rows::open(path, layout, source, about)?,
                    None => return Ok(Self::of(source, about)),
                }
            }
        };
        Self::laid(path, opened, layout.as_ref())
    }

    fn laid(path: &Path, opened: OpenStream, layout: Option<&Layout>) -> Result<Self, IoError> {
        let (laid, about) = LaidReadings::open(path, opened, layout)?;
        let rest = laid.rest();
        Ok(Self { rest, ..Self::of(Source::Laid(Box::new(laid)), about) })
    }

    /// How many episodes are read, one after the other; each has as many frames.
    pub fn episodes(&self) -> u64 {
        match &self.source {
            Source::Laid(laid) => laid.episodes(),
            Source::Blocks(blocks) => blocks.episodes,
            _ => 1,
        }
    }

    /// The episode of the frame that was read last.
    pub fn episode(&self) -> u64 {
        match &self.source {
            Source::Laid(laid) => laid.episode,
            Source::Blocks(blocks) => blocks.episode(),
            _ => 0,
        }
    }

    /// Whether a file is of a kind that is read here, by its content or its extension.
    pub fn is_known(path: &Path) -> bool {
        streams::is_vendor(path) || ["txt", "log", "csv", "npy", "npz"].contains(&file_kind(path).as_str())
    }

    /// What the file states of the stream, if it is read by a layout or as a recording of another program.
    pub fn facts(&self) -> Option<&StreamFacts> {
        if let Source::Laid(laid) = &self.source { Some(&laid.facts) } else { None }
    }

    /// The text of a layout of what a file states, with null where it states nothing.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn draft_layout(path: &Path, stream: Option<&str>) -> Result<String, IoError> {
        exists(path)?;
        streams::refuse_stand_in(path)?;
        let facts = match streams::open(path, Wanted { stream, ..Wanted::default() })? {
            Some(opened) => opened.facts,
            None => {
                let how = FirstLine { is_draft: true, ..FirstLine::default() };
                Source::open(path, ReadingsLayout::default(), how)?.1.facts()
            }
        };
        Ok(Layout::draft(path, &facts))
    }

    /// What is known about the readings, and by whom; reading adds to it.
    pub fn statements(&self) -> Vec<Statement> {
        if let Source::Laid(laid) = &self.source {
            let mut all = laid.statements();
            if self.chosen.is_some() {
                let taxels = all.iter_mut().filter(|statement| statement.what == "taxels");
                taxels.for_each(|taxels| taxels.value = "by a table of columns".to_owned());
            }
            return all;
        }
        if let Source::Blocks(blocks) = &self.source {
            return blocks.statements().to_vec();
        }
        let state = |what: &str, value: &str| Statement::new(what, value, StatementSource::File);
        let stated = |text: &str| if text.is_empty() { "none in the file" } else { text }.to_owned();
        let mut all: Vec<Statement> =
            self.channels.iter().map(|c| state(&format!("unit of {}", c.name), &stated(&c.unit))).collect();
        all.push(state("time", if self.has_times { "as in the file, in s" } else { "none in the file" }));
        let ids = match (&self.chosen, &self.ids) {
            (Some(_), _) => "by a table of columns",
            (None, Some(_)) => "by their ids",
            (None, None) => "in the order of the map",
        };
        all.push(state("taxels", ids));
        all.extend(self.notes.iter().cloned());
        all.extend(self.source.statements());
        all
    }

    fn of(source: Source, about: About) -> Self {
        let About { ids, channels, width, frames, has_times, first_line, rest, notes, .. } = about;
        Self { ids, channels, width, frames, has_times, rest, source, chosen: None, first_line, notes }
    }

    /// Says which taxels there are, in any order: a first line of numbers alone has the ids of the columns if it has each of
    /// these once, and is a frame otherwise. Readings with names in the first line stay as they are.
    pub fn settle_first_line(&mut self, known: impl IntoIterator<Item = TaxelId>) {
        let Some(ids) = self.first_line.take() else { return };
        let [mut line, mut known]: [Vec<TaxelId>; 2] = [ids.clone(), known.into_iter().collect()];
        line.sort_unstable();
        known.sort_unstable();
        let is_ids = line == known;
        let value = if is_ids {
            "ids: those of the skin"
        } else {
            "a frame: its numbers are not the ids of the skin"
        };
        self.notes.push(Statement::new("first line", value, StatementSource::Checked));
        if is_ids {
            self.source.skip_first();
            self.frames = self.frames.map(|frames| frames.saturating_sub(1));
            self.ids.get_or_insert(ids);
        }
    }

    /// Reads a stream of text or CSV, which errors call `path`. A line is read as soon as it has
    /// ended.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn stream(path: &Path, input: impl Read + Send + 'static) -> Result<Self, IoError> {
        let (text, about) = TextReadings::open(path, Box::new(input), FirstLine::default())?;
        Ok(Self::of(Source::Text(text), about))
    }

    /// Reads a stream by a layout. Frames from which the layout takes a zero, or with which it is checked, are kept first.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn stream_with(
        path: &Path,
        input: impl Read + Send + 'static,
        layout: &Layout,
    ) -> Result<Self, IoError> {
        let how = FirstLine { layout: Some(layout), ..FirstLine::default() };
        let (text, about) = TextReadings::open(path, Box::new(input), how)?;
        Wanted { layout: Some(layout), ..Wanted::default() }
            .choose(path, &[(String::new(), about.facts().cells)])?;
        Self::laid(path, Rows::open(path, layout, Source::Text(text), about)?, Some(layout))
    }

    /// Reads a recording in memory.
    ///
    /// # Errors
    /// If there is not one number for each frame, channel and column.
    pub fn memory(readings: Readings) -> Result<Self, IoError> {
        let Readings { ids, channels, width, times, values, rest } = &readings;
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
            rest: rest.clone(),
            ..About::default()
        };
        Ok(Self::of(Source::Memory(readings, 0), about))
    }

    /// Reads a recording of blocks that another program reads, as they come. Errors call it `path`; `lengths` are the frames of
    /// each episode, none if that is not known.
    ///
    /// ```
    /// use std::path::Path;
    ///
    /// use dermatome::io::{Block, Readings, ReadingsReader};
    /// use dermatome::signal::Channel;
    ///
    /// let block = |episode, value| Block {
    ///     episode,
    ///     readings: Readings {
    ///         channels: vec![Channel::default()],
    ///         width: 1,
    ///         times: vec![0.0],
    ///         values: vec![value],
    ///         ..Readings::default()
    ///     },
    ///     ..Block::default()
    /// };
    /// let blocks = [block(0, 3.0), block(1, 5.0)].map(Ok);
    /// let mut reader = ReadingsReader::blocks(Path::new("two"), &[1, 1], blocks.into_iter())?;
    /// let (mut values, mut time) = (Vec::new(), 0.0);
    /// while reader.read(&mut values, &mut time)? {
    ///     println!("episode {}: {values:?}", reader.episode());
    /// }
    /// assert_eq!((reader.episode(), values), (1, vec![5.0]));
    /// # Ok::<(), dermatome::io::IoError>(())
    /// ```
    ///
    /// # Errors
    /// If there is no block, or its numbers do not fit each other. Reading fails, too, where blocks differ in what they are of.
    pub fn blocks(
        path: &Path,
        lengths: &[u64],
        blocks: impl Iterator<Item = Result<Block, IoError>> + Send + 'static,
    ) -> Result<Self, IoError> {
        let (blocks, about) = BlockReadings::open(path, lengths, Box::new(blocks))?;
        let rest = blocks.rest();
        Ok(Self { rest, ..Self::of(Source::Blocks(Box::new(blocks)), about) })
    }

    /// Reads the next frame: the number of column `n` and channel `c` is `values[c * width + n]`,
    /// the time is in s. False after the last frame. Without times `time` becomes NaN.
    ///
    /// # Errors
    /// If the row has another number of cells, a cell is not a number, the file has ended too early,
    /// or there is no row at all. After an error about a line the next one may be read.
    pub fn read(&mut self, values: &mut Vec<f64>, time: &mut f64) -> Result<bool, IoError> {
        if let (Source::Text(text), Some(_), None) = (&self.source, &self.first_line, &self.chosen) {
            return Err(text.ambiguous());
        }
        let Some(Chosen { columns, width, values: all }) = &mut self.chosen else {
            return self.source.read(values, time);
        };
        if !self.source.read(all, time)? {
            return Ok(false);
        }
        values.clear();
        for channel in all.chunks_exact(*width) {
            values.extend(columns.iter().map(|&column| channel[column]));
        }
        Ok(true)
    }

    /// Reads these columns only, counted from 0, each as the readings of a taxel, whatever the file says; `table` says
    /// so, for errors.
    ///
    /// # Errors
    /// If there is none of them, or one is not a column of the readings.
    pub fn assign_columns(&mut self, table: &Path, columns: &[(usize, TaxelId)]) -> Result<(), IoError> {
        if columns.is_empty() {
            return Err(invalid(table, "rows", "no column with a taxel", "one at least"));
        }
        if let Some((column, _)) = columns.iter().find(|(column, _)| *column >= self.width) {
            let needed = format!("0 to {}, as the readings have", self.width.saturating_sub(1));
            return Err(invalid(table, "column", column.to_string(), needed));
        }
        let before = self.chosen.take();
        let source = |column: usize| before.as_ref().map_or(column, |chosen| chosen.columns[column]);
        self.chosen = Some(Chosen {
            columns: columns.iter().map(|(column, _)| source(*column)).collect(),
            width: before.as_ref().map_or(self.width, |chosen| chosen.width),
            values: Vec::new(),
        });
        self.ids = Some(columns.iter().map(|(_, taxel)| *taxel).collect());
        self.width = columns.len();
        Ok(())
    }
}
