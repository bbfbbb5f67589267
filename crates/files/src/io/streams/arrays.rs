//! Arrays of numpy with any axes: one `.npy`, or one of an `.npz` whose times and zero are other arrays of it. One of the axes
//! may count episodes, which are read one after the other, or one of them.

use std::path::{Path, PathBuf};

use crate::io::IoError;
use crate::io::arrays::npy::ElementType;
use crate::io::arrays::read::{Storage, StoredArray, find_array, list_arrays};
use crate::io::arrays::rows::{ArrayRows, MAX_WHOLE};
use crate::io::file::invalid;
use crate::io::file::times::time_column;
use crate::io::layout::{Layout, StreamFacts, TimeUnit};
use crate::io::readings::arrays::{REST, ids_of, read_rest};
use crate::io::streams::frames::{FileTime, Frames, OpenStream, Wanted};
use crate::signal::Channel;

struct Arrays {
    path: PathBuf,
    values: Values,
    times: ArrayTimes,
    zeros: Zeros,
    /// Frames of an episode, and the episodes that are read.
    frames: usize,
    episodes: std::ops::Range<usize>,
    /// Frames that were read.
    done: usize,
    bytes: Vec<u8>,
}

enum ArrayTimes {
    /// As they come, of one episode.
    Rows(ArrayRows),
    /// Those of all episodes, or of each the same.
    Whole(Vec<FileTime>),
    None,
}

/// Zeros that are not one for all frames.
enum Zeros {
    None,
    /// Beside each frame, and those of the frame that was read last.
    Frames(Values, Vec<f64>),
    /// Of each episode, and how many there are in one.
    Episodes(Vec<f64>, usize),
}

enum Values {
    /// Frame after frame, as they are.
    Rows(ArrayRows),
    /// All bytes: the last index is not the fastest, or frames are not the first axis.
    Whole { bytes: Vec<u8>, elements: ElementType, strides: [usize; 2], cells: Vec<usize> },
}

pub(super) fn open(path: &Path, wanted: Wanted<'_>) -> Result<OpenStream, IoError> {
    let storage = Storage::disk(path);
    let is_archive = !is_npy(path)?;
    let arrays = if is_archive { list_arrays(storage)? } else { vec![find_array(storage)?] };
    let candidates = candidates(path, &arrays, wanted.layout)?;
    let axis = wanted.layout.map_or(0, Layout::frame_axis);
    let episode_axis = wanted.layout.and_then(Layout::episode_axis);
    let mut streams = Vec::new();
    for array in &candidates {
        let sides = array.header.shape.iter().map(|&side| usize::try_from(side).unwrap_or(usize::MAX));
        let cells = sides.enumerate().filter(|(k, _)| *k != axis && Some(*k) != episode_axis);
        streams.push((array.name.clone(), cells.map(|(_, side)| side).collect::<Vec<_>>()));
    }
    let place = wanted.choose(path, &streams)?;
    let (array, (stream, cells)) = (candidates[place], streams.swap_remove(place));
    let sides = array.header.shape.len();
    if sides <= axis.max(episode_axis.unwrap_or(0)) {
        let needed = match wanted.layout {
            Some(layout) => format!(
                "{} axes, {:?}, as {} states",
                layout.axes().len(),
                layout.axes(),
                layout.name().display()
            ),
            None => "frames along the first axis".to_owned(),
        };
        return Err(invalid(path, "axes", format!("{} axes, {}", sides, array.header.describe()), needed));
    }
    let has_halves = array.header.elements.is_real() && array.header.elements.size() == 2;
    let mut facts = StreamFacts { stream, cells, has_halves, ..StreamFacts::default() };
    let chosen = Chosen { path, arrays: &arrays, layout: wanted.layout, array, axis, episode_axis };
    let episodes = wanted.episodes(path, chosen.episodes(), &mut facts)?;
    let times = chosen.times(&mut facts)?;
    let zeros = chosen.zeros(&mut facts)?;
    chosen.find_facts(&mut facts)?;
    let frames = array.header.shape[axis];
    let total = frames.saturating_mul(episodes.len() as u64);
    let source = Arrays {
        path: path.into(),
        values: Values::open(path, array, axis, episode_axis)?,
        times,
        zeros,
        frames: usize::try_from(frames).unwrap_or(usize::MAX),
        episodes,
        done: 0,
        bytes: Vec::new(),
    };
    Ok(OpenStream { facts, frames: Some(total), sheet: None, source: Box::new(source) })
}

/// The arrays that may be readings: of numbers, with the axes of the layout or with two and more, if there are some.
fn candidates<'a>(
    path: &Path,
    arrays: &'a [StoredArray],
    layout: Option<&Layout>,
) -> Result<Vec<&'a StoredArray>, IoError> {
    let axes = layout.map(|layout| layout.axes().len());
    let numbers = arrays.iter().filter(|array| array.header.elements.is_number());
    let fits = |array: &&StoredArray| {
        let shape = &array.header.shape;
        shape.len() > 1 && axes.is_none_or(|axes| shape.len() == axes)
    };
    let fitting: Vec<&StoredArray> = numbers.clone().filter(fits).collect();
    // Without any, the decoder reports what is wrong with the axes.
    let all = if fitting.is_empty() { numbers.collect() } else { fitting };
    if all.is_empty() {
        let found: Vec<String> =
            arrays.iter().map(|array| format!("{} {}", array.element(), array.header.describe())).collect();
        let found = if found.is_empty() { "none".to_owned() } else { found.join(", ") };
        return Err(invalid(path, "arrays", found, "an array of numbers: numpy.stack makes one of objects"));
    }
    Ok(all)
}

/// All times of an array.
fn read_ticks(path: &Path, times: &StoredArray) -> Result<Vec<FileTime>, IoError> {
    let count: u64 = times.header.shape.iter().product();
    if times.header.is_fortran && times.header.shape.len() > 1 {
        return Err(invalid(path, times.element(), times.header.describe(), "times in C order"));
    }
    let mut rows = ArrayRows::open(path, times, 1)?;
    (0..count).map(|_| Ok(rows.read_tick(path)?.map_or_else(FileTime::Real, FileTime::Whole))).collect()
}

fn is_npy(path: &Path) -> Result<bool, IoError> {
    use std::io::Read;
    let mut magic = [0; 1];
    let read = std::fs::File::open(path).and_then(|mut file| file.read(&mut magic));
    read.map(|_| magic == *b"\x93").map_err(crate::io::file::cannot_read(path))
}

/// The array of readings, and those beside it.
struct Chosen<'a> {
    path: &'a Path,
    arrays: &'a [StoredArray],
    layout: Option<&'a Layout>,
    array: &'a StoredArray,
    /// The axes of frames and of episodes.
    axis: usize,
    episode_axis: Option<usize>,
}

impl<'a> Chosen<'a> {
    fn named(&self, name: &str) -> Option<&'a StoredArray> {
        self.arrays.iter().find(|other| other.name == name && other.name != self.array.name)
    }

    fn episodes(&self) -> usize {
        usize::try_from(self.episode_axis.map_or(1, |axis| self.array.header.shape[axis]))
            .unwrap_or(usize::MAX)
    }

    /// The times of the frames, in the unit that becomes a fact.
    fn times(&self, facts: &mut StreamFacts) -> Result<ArrayTimes, IoError> {
        let has_rate = self.layout.is_some_and(|layout| layout.time().1.is_some());
        let frames = self.array.header.shape[self.axis];
        let is_of_frames = |times: &StoredArray| {
            times.header.shape == [frames]
                || self.episode_axis.is_some() && times.header.shape == [self.episodes() as u64, frames]
        };
        // Where a rate is stated, times are compared with it; other arrays may be called so, too.
        let times = self.stated_times()?.filter(|(times, _)| !has_rate || is_of_frames(times));
        let Some((times, unit)) = times else { return Ok(ArrayTimes::None) };
        if !is_of_frames(times) {
            let needed = format!("the shape ({frames},): one for each frame of {}", self.array.element());
            return Err(invalid(self.path, times.element(), times.header.describe(), needed));
        }
        facts.time_names = vec![times.name.clone()];
        // Numbers without a unit are s, but frame numbers are whole.
        let usual = (has_rate && times.header.elements.is_real()).then_some(TimeUnit::Seconds);
        facts.time_unit = unit.or(usual);
        Ok(match self.episode_axis {
            None => ArrayTimes::Rows(ArrayRows::open(self.path, times, 1)?),
            Some(_) => ArrayTimes::Whole(read_ticks(self.path, times)?),
        })
    }

    /// The array of times and the unit that it states: the one that the layout names, else one that is called a time.
    fn stated_times(&self) -> Result<Option<(&'a StoredArray, Option<TimeUnit>)>, IoError> {
        let is_other =
            |array: &&StoredArray| array.name != self.array.name && array.header.elements.is_number();
        let others = || self.arrays.iter().filter(is_other);
        let found = match self.layout.map(Layout::time) {
            Some((Some(name), _)) => {
                let names: Vec<&str> = others().map(|array| array.name.as_str()).collect();
                let needed = || format!("one of {}, or a rate in the layout", names.join(", "));
                let array = others().find(|array| array.name == name);
                let missing = || invalid(self.path, "times", format!("no array `{name}`"), needed());
                Some(array.ok_or_else(missing)?)
            }
            _ => others().find(|array| time_column(&array.name).is_some()),
        };
        Ok(found.map(|array| {
            let of_name = time_column(&array.name).filter(|_| array.name.contains('[')).and_then(Result::ok);
            let per_second = array.header.elements.dates_per_second().or(of_name);
            (array, per_second.and_then(TimeUnit::of))
        }))
    }

    /// What other arrays say of the readings: names, units, the taxels, and what is known at rest.
    fn find_facts(&self, facts: &mut StreamFacts) -> Result<(), IoError> {
        let texts = |name: &str| {
            let is_list = |array: &&StoredArray| {
                let elements = array.header.elements;
                let is_text = elements.is_read() && !elements.is_number();
                is_text && array.header.shape.len() == 1 && array.header.shape[0] > 0
            };
            let read = |list: &StoredArray| {
                ArrayRows::open(self.path, list, list.header.shape[0].min(64) as usize)?.texts(self.path)
            };
            self.named(name).filter(is_list).map_or(Ok(Vec::new()), read)
        };
        (facts.names, facts.units) = (texts("channels")?, texts("units")?);
        self.find_rest(facts)?;
        if let Some(ids) = self.named("ids").or_else(|| self.named("taxel_ids")) {
            // Those of another array, as of another sensor, are not of these cells.
            let count = usize::try_from(ids.header.shape.iter().product::<u64>()).unwrap_or(usize::MAX);
            let is_of_cells = facts.cells.contains(&count) || facts.cells.iter().product::<usize>() == count;
            if ids.header.shape.len() == 1 && ids.header.elements.is_read() && is_of_cells {
                facts.ids = Some(ids_of(self.path, ids, count)?);
            }
        }
        Ok(())
    }

    /// What is known at rest, as in recordings that need no layout: one number, or for `is_tared` one of each component.
    /// Arrays of more numbers are about something else.
    fn find_rest(&self, facts: &mut StreamFacts) -> Result<(), IoError> {
        let axis = self.layout.and_then(|layout| layout.frame_axes().position(|axis| axis == "component"));
        let components = axis.and_then(|axis| facts.cells.get(axis)).copied().unwrap_or(1);
        let is_one = |array: &StoredArray| array.header.shape.iter().all(|&side| side == 1);
        let is_each = |array: &StoredArray| array.header.shape == [components as u64];
        let numbers =
            |name: &str| self.named(name).filter(|array| is_one(array) || name == REST[0] && is_each(array));
        let count = numbers(REST[0]).filter(|array| is_each(array)).map_or(1, |_| components);
        let name = |k: usize| facts.names.get(k).cloned().unwrap_or_else(|| format!("component {k}"));
        let channels: Vec<Channel> =
            (0..count).map(|k| Channel { name: name(k), ..Channel::default() }).collect();
        let (rest, notes) = read_rest(self.path, REST.map(numbers), &channels)?;
        (facts.tared, facts.threshold) = (rest.is_zero, rest.threshold);
        facts.notes.extend(notes);
        Ok(())
    }

    /// The level of each number of a frame at rest becomes a fact: one for all frames, one beside each frame, one of each
    /// episode, or the mean of other rows.
    fn zeros(&self, facts: &mut StreamFacts) -> Result<Zeros, IoError> {
        let Some(array) = self.layout.and_then(|layout| self.named(layout.zero_stream()?)) else {
            return Ok(Zeros::None);
        };
        let (path, missing) = (self.path, self.layout.map_or(Vec::new(), Layout::missing_numbers));
        let width: usize = facts.cells.iter().product();
        let shape = &array.header.shape;
        let count: u64 = shape.iter().product();
        let is_number = array.header.elements.is_number();
        let fits = is_number && width > 0 && count > 0 && count.is_multiple_of(width as u64);
        let all = &self.array.header.shape;
        let without = |axis: usize| {
            let others = all.iter().enumerate().filter(move |(k, _)| *k != axis);
            others.map(|(_, side)| *side).collect::<Vec<u64>>()
        };
        // The axes of the readings, without that of the frames.
        let of_episodes = self.episode_axis.filter(|_| *shape == without(self.axis));
        if fits && shape == all {
            let values = Values::open(path, array, self.axis, self.episode_axis)?;
            facts.zero = Some(vec![0.0; width]);
            return Ok(Zeros::Frames(values, Vec::new()));
        }
        if fits && let Some(axis) = of_episodes {
            let axis = axis - usize::from(axis > self.axis);
            let mut values = Values::open(path, array, axis, None)?;
            let (mut rows, mut row) = (Vec::new(), Vec::new());
            for episode in 0..usize::try_from(shape[axis]).unwrap_or(usize::MAX) {
                values.read(path, 0, episode, &mut row, &mut Vec::new())?;
                rows.extend_from_slice(&row);
            }
            facts.zero = Some(vec![0.0; width]);
            return Ok(Zeros::Episodes(rows, width));
        }
        if !fits || array.header.is_fortran {
            let needed = format!("numbers of the shape {:?}, or rows of them, in C order", facts.cells);
            return Err(invalid(path, array.element(), array.header.describe(), needed));
        }
        let mut rows = ArrayRows::open(path, array, width)?;
        let (mut sum, mut count, mut row) = (vec![0.0; width], vec![0.0; width], vec![0.0; width]);
        while rows.read(path, &mut row)? {
            for ((sum, count), x) in sum.iter_mut().zip(&mut count).zip(&row) {
                if x.is_finite() && !missing.contains(x) {
                    (*sum, *count) = (*sum + x, *count + 1.0);
                }
            }
        }
        // 0 / 0 is NaN: such a cell has no zero.
        facts.zero = Some(sum.iter().zip(&count).map(|(sum, count)| sum / count).collect());
        Ok(Zeros::None)
    }
}

impl Values {
    fn open(
        path: &Path,
        array: &StoredArray,
        axis: usize,
        episode_axis: Option<usize>,
    ) -> Result<Self, IoError> {
        let header = &array.header;
        let shape: Vec<usize> =
            header.shape.iter().map(|&side| usize::try_from(side).unwrap_or(usize::MAX)).collect();
        let frames = shape.get(axis).copied().unwrap_or(0);
        // The product of the shape was compared with the bytes that are there.
        let count: usize = shape.iter().product();
        if count == 0 {
            return Err(invalid(path, array.element(), header.describe(), "at least one number"));
        }
        if axis == 0 && episode_axis.is_none() && !header.is_fortran {
            return Ok(Self::Rows(ArrayRows::open(path, array, count / frames)?));
        }
        let total = header.total_bytes().unwrap_or(u64::MAX);
        if total > MAX_WHOLE {
            let needed =
                format!("at most {MAX_WHOLE} bytes, or C order with frames first: numpy.ascontiguousarray");
            return Err(invalid(path, array.element(), format!("{total} bytes in another order"), needed));
        }
        let bytes = ArrayRows::open_flat(path, array, count)?.into_bytes(path)?;
        let mut strides = vec![1; shape.len()];
        let order: Vec<usize> =
            if header.is_fortran { (0..shape.len()).collect() } else { (0..shape.len()).rev().collect() };
        for pair in order.windows(2) {
            strides[pair[1]] = strides[pair[0]] * shape[pair[0]];
        }
        let mut cells = vec![0];
        for k in (0..shape.len()).filter(|&k| k != axis && Some(k) != episode_axis) {
            cells = cells
                .iter()
                .flat_map(|at| (0..shape[k]).map(move |i| (at, i)))
                .map(|(at, i)| at + i * strides[k])
                .collect();
        }
        let strides = [episode_axis.map_or(0, |axis| strides[axis]), strides[axis]];
        Ok(Self::Whole { bytes, elements: header.elements, strides, cells })
    }

    /// Reads a frame, the next one of rows; false after the last one of these.
    fn read(
        &mut self,
        path: &Path,
        episode: usize,
        frame: usize,
        out: &mut Vec<f64>,
        kept: &mut Vec<u8>,
    ) -> Result<bool, IoError> {
        match self {
            Self::Rows(rows) => {
                out.resize(rows.width(), f64::NAN);
                rows.read(path, out)
            }
            Self::Whole { bytes, elements, strides, cells } => {
                let size = elements.size();
                kept.clear();
                for cell in cells.iter() {
                    let at = (cell + episode * strides[0] + frame * strides[1]) * size;
                    kept.extend_from_slice(&bytes[at..at + size]);
                }
                out.resize(cells.len(), f64::NAN);
                elements.numbers(kept, out);
                Ok(true)
            }
        }
    }
}

impl Frames for Arrays {
    fn read(&mut self, out: &mut Vec<f64>, time: &mut FileTime) -> Result<bool, IoError> {
        let (at, frame) = (self.done / self.frames.max(1), self.done % self.frames.max(1));
        let episode = self.episodes.start + at;
        if episode >= self.episodes.end
            || !self.values.read(&self.path, episode, frame, out, &mut self.bytes)?
        {
            return Ok(false);
        }
        if let Zeros::Frames(zeros, row) = &mut self.zeros {
            zeros.read(&self.path, episode, frame, row, &mut self.bytes)?;
        }
        self.done += 1;
        *time = match &mut self.times {
            ArrayTimes::Rows(times) => {
                times.read_tick(&self.path)?.map_or_else(FileTime::Real, FileTime::Whole)
            }
            // One row is that of each episode.
            ArrayTimes::Whole(times) if times.len() == self.frames => times[frame],
            ArrayTimes::Whole(times) => times.get(episode * self.frames + frame).copied().unwrap_or_default(),
            ArrayTimes::None => FileTime::None,
        };
        Ok(true)
    }

    fn zeros(&self) -> Option<&[f64]> {
        match &self.zeros {
            Zeros::None => None,
            Zeros::Frames(_, row) => Some(row),
            Zeros::Episodes(rows, width) => {
                let episode = usize::try_from(self.episode()).unwrap_or(usize::MAX);
                rows.chunks_exact(*width).nth(episode)
            }
        }
    }

    fn episodes(&self) -> u64 {
        self.episodes.len() as u64
    }

    fn episode(&self) -> u64 {
        (self.episodes.start + self.done.saturating_sub(1) / self.frames.max(1)) as u64
    }
}
