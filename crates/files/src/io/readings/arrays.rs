//! Readings as arrays of numpy: one array of values, and in an `.npz` more about them.

use std::path::{Path, PathBuf};

use crate::io::IoError;
use crate::io::arrays::read::{Storage, StoredArray, find_array, list_arrays, only};
use crate::io::arrays::rows::{ArrayRows, MAX_WHOLE};
use crate::io::file::times::{LATEST, time_column};
use crate::io::file::{excerpt, invalid};
use crate::io::layout::{KnownRest, Statement, StatementSource};
use crate::io::readings::header::{About, MAX_NUMBERS};
use crate::signal::Channel;
use crate::skin::TaxelId;

/// What the axes of an array of three axes are; the first is the time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ReadingsLayout {
    /// `(T, N, C)`: the channels of each taxel stand together.
    #[default]
    TaxelsFirst,
    /// `(T, C, N)`: the taxels of each channel stand together, as MuJoCo gives them.
    ChannelsFirst,
}

/// The names of the numbers that state what is known where nothing touches.
pub(in crate::io) const REST: [&str; 2] = ["is_tared", "threshold"];

/// Whether an array is about the values.
fn is_about(name: &str) -> bool {
    ["ids", "taxel_ids", "channels", "units", "kinds"].contains(&name) || time_column(name).is_some()
}

pub(super) struct ArrayReadings {
    path: PathBuf,
    values: ArrayRows,
    /// The times, and how many of their units are a second.
    times: Option<(ArrayRows, f64)>,
    layout: ReadingsLayout,
    channels: usize,
    row: Vec<f64>,
}

impl ArrayReadings {
    /// Opens a `.npy`, or an `.npz`.
    pub(super) fn open(
        path: &Path,
        is_archive: bool,
        layout: ReadingsLayout,
    ) -> Result<(Self, About), IoError> {
        let storage = Storage::disk(path);
        let arrays = if is_archive { list_arrays(storage)? } else { vec![find_array(storage)?] };
        let values = find_values(path, &arrays)?;
        let (frames, width, channels) = check_shape(path, values, layout)?;
        let others =
            || arrays.iter().map(|array| (&array.name, array)).filter(|(name, _)| **name != values.name);
        let about = |names: &[&str]| only(path, others().filter(|(name, _)| names.contains(&name.as_str())));
        let ids =
            about(&["ids", "taxel_ids"])?.map(|array| read_ids(path, array, values, width)).transpose()?;
        let channels =
            read_channels(path, ["channels", "units", "kinds"].map(|name| about(&[name])), channels)?;
        let times = only(path, others().filter(|(name, _)| time_column(name).is_some()))?;
        let times = times.map(|array| {
            need_shape(path, array, frames, "one for each frame")?;
            if !array.header.elements.is_number() {
                return Err(invalid(path, array.element(), array.header.describe(), "numbers or dates"));
            }
            let per_second = time_column(&array.name).unwrap_or(Ok(1));
            let per_second =
                per_second.map_err(|needed| invalid(path, array.element(), array.name.as_str(), needed))?;
            // Dates state their unit, whatever the array is called.
            let per_second = array.header.elements.dates_per_second().map_or(per_second, |_| 1);
            Ok((ArrayRows::open(path, array, 1)?, f64::from(per_second)))
        });
        let times = times.transpose()?;
        let has_times = times.is_some();
        // Other arrays of more than one number that have these names are about something else.
        let number = |name: &str| {
            let is_one = |array: &StoredArray| {
                let of_channels = name == REST[0] && array.header.shape == [channels.len() as u64];
                of_channels || array.header.shape.iter().all(|&side| side == 1)
            };
            others().find(|(known, array)| *known == name && is_one(array)).map(|(_, array)| array)
        };
        let (rest, notes) = read_rest(path, REST.map(number), &channels)?;
        let readings = Self {
            path: path.into(),
            values: ArrayRows::open(path, values, width * channels.len())?,
            times,
            layout,
            channels: channels.len(),
            row: Vec::new(),
        };
        let frames = Some(frames);
        Ok((readings, About { ids, channels, width, frames, has_times, rest, notes, ..About::default() }))
    }

    /// Reads the next row; false after the last one.
    pub(super) fn read(&mut self, values: &mut Vec<f64>, time: &mut f64) -> Result<bool, IoError> {
        let numbers = self.values.width();
        values.resize(numbers, f64::NAN);
        // In Fortran order the first of the two axes of a frame is the fast one.
        let taxels_first = (self.layout == ReadingsLayout::TaxelsFirst) != self.values.is_by_columns();
        let is_transposed = self.channels > 1 && taxels_first;
        let read = if is_transposed { &mut self.row } else { &mut *values };
        read.resize(numbers, f64::NAN);
        if !self.values.read(&self.path, read)? {
            return Ok(false);
        }
        if is_transposed {
            let width = numbers / self.channels;
            for (column, taxel) in self.row.chunks_exact(self.channels).enumerate() {
                taxel.iter().enumerate().for_each(|(channel, &x)| values[channel * width + column] = x);
            }
        }
        *time = f64::NAN;
        if let Some((times, per_second)) = &mut self.times {
            let mut number = [f64::NAN];
            times.read(&self.path, &mut number)?;
            *time = number[0] / *per_second;
            if time.is_nan() || time.abs() > LATEST {
                let element = format!("{}, row {}", times.element(), times.done() - 1);
                let needed = "a time in s; name the array `time[ms]`, `time[us]` or `time[ns]` if it is not";
                return Err(invalid(&self.path, element, time.to_string(), needed));
            }
        }
        Ok(true)
    }
}

/// What is known of readings where nothing touches: whether they are about 0, one number or one for each channel, and the
/// threshold.
pub(in crate::io) fn read_rest(
    path: &Path,
    [is_tared, threshold]: [Option<&StoredArray>; 2],
    channels: &[Channel],
) -> Result<(KnownRest, Vec<Statement>), IoError> {
    let invalid =
        |name: &str, found: f64, needed| invalid(path, format!("array `{name}`"), found.to_string(), needed);
    let is_tared = is_tared.map(|array| read_numbers(path, array)).transpose()?.unwrap_or_default();
    if let Some(flag) = is_tared.iter().find(|flag| ![0.0, 1.0].contains(*flag)) {
        return Err(invalid(REST[0], *flag, "0 or 1"));
    }
    let threshold = threshold.map(|array| read_numbers(path, array)).transpose()?.map(|all| all[0]);
    if let Some(found) = threshold.filter(|x| !(x.is_finite() && *x > 0.0)) {
        return Err(invalid(REST[1], found, "a positive number"));
    }
    // One number is of all channels.
    let flag = |k: usize| is_tared.get(if is_tared.len() == 1 { 0 } else { k }) == Some(&1.0);
    let is_zero: Vec<bool> =
        channels.iter().enumerate().map(|(k, channel)| channel.kind.is_of_touch() && flag(k)).collect();
    Ok(stated_rest(KnownRest { is_zero, threshold }, channels))
}

/// What a file states of readings where nothing touches, and its statements.
pub(super) fn stated_rest(mut rest: KnownRest, channels: &[Channel]) -> (KnownRest, Vec<Statement>) {
    if !rest.is_zero.contains(&true) {
        rest.is_zero.clear();
    }
    let unit = channels.iter().find(|channel| channel.kind.is_of_touch()).map_or("", |channel| &channel.unit);
    let of_touch = channels.iter().zip(&rest.is_zero).filter(|(channel, _)| channel.kind.is_of_touch());
    let tared: Vec<&str> =
        of_touch.clone().filter(|(_, is_zero)| **is_zero).map(|(channel, _)| &*channel.name).collect();
    let zero = (!tared.is_empty()).then(|| {
        let of =
            if tared.len() < of_touch.count() { format!(" in {}", tared.join(", ")) } else { String::new() };
        ("zero", format!("subtracted before{of}"))
    });
    let threshold = rest.threshold.map(|x| ("threshold", format!("{x} {unit}").trim().to_owned()));
    let stated = zero.into_iter().chain(threshold);
    let notes = stated.map(|(what, value)| Statement::new(what, value, StatementSource::File)).collect();
    (rest, notes)
}

/// The numbers of a small array, one at least.
fn read_numbers(path: &Path, array: &StoredArray) -> Result<Vec<f64>, IoError> {
    if !array.header.elements.is_number() {
        return Err(invalid(path, array.element(), array.header.describe(), "a number"));
    }
    let count = usize::try_from(array.header.shape.iter().product::<u64>()).unwrap_or(usize::MAX);
    let mut numbers = vec![f64::NAN; count.max(1)];
    ArrayRows::open(path, array, count)?.read(path, &mut numbers)?;
    Ok(numbers)
}

/// The array of the readings: the one called `values` or `readings`, or the only one that can be.
fn find_values<'a>(path: &Path, arrays: &'a [StoredArray]) -> Result<&'a StoredArray, IoError> {
    let fits = |a: &&StoredArray| a.header.elements.is_number() && [2, 3].contains(&a.header.shape.len());
    let named = arrays.iter().map(|array| (&array.name, array));
    if let Some(named) =
        only(path, named.filter(|(name, _)| ["values", "readings"].contains(&name.as_str())))?
    {
        return Some(named).filter(fits).ok_or_else(|| {
            let needed = "numbers of the shape (T, N), (T, N, C) or (T, C, N)";
            invalid(path, named.element(), named.header.describe(), needed)
        });
    }
    let mut candidates = arrays.iter().filter(|a| !is_about(&a.name)).filter(fits);
    match (candidates.next(), candidates.next()) {
        (Some(only), None) => Ok(only),
        _ => {
            /// Arrays that an error lists.
            const LISTED: usize = 10;
            let names = arrays.iter().take(LISTED).map(|a| format!("{} {}", a.name, a.header.describe()));
            let more = if arrays.len() > LISTED { ", ..." } else { "" };
            let found = format!("{}{more}", names.collect::<Vec<_>>().join(", "));
            let needed = "an array `values` of numbers of the shape (T, N), (T, N, C) or (T, C, N), or one \
                          array alone that can be it";
            Err(invalid(path, "arrays", if found.is_empty() { "none".into() } else { found }, needed))
        }
    }
}

/// The numbers of frames, taxels and channels.
fn check_shape(
    path: &Path,
    values: &StoredArray,
    layout: ReadingsLayout,
) -> Result<(u64, usize, usize), IoError> {
    let found = || values.header.describe();
    let bytes = values.header.total_bytes().unwrap_or(u64::MAX);
    if values.header.is_fortran && bytes > MAX_WHOLE {
        let found = format!("{} in Fortran order, {bytes} bytes", found());
        let needed = format!("at most {MAX_WHOLE} bytes, or C order: write it with numpy.ascontiguousarray");
        return Err(invalid(path, values.element(), found, needed));
    }
    let (frames, width, channels) = match (values.header.shape.as_slice(), layout) {
        (&[frames, width], _) => (frames, width, 1),
        (&[frames, width, channels], ReadingsLayout::TaxelsFirst)
        | (&[frames, channels, width], ReadingsLayout::ChannelsFirst) => (frames, width, channels),
        _ => return Err(invalid(path, values.element(), found(), "two or three axes")),
    };
    if frames == 0 || width == 0 || channels == 0 {
        return Err(invalid(path, values.element(), found(), "at least one frame, taxel and channel"));
    }
    let numbers = width.checked_mul(channels).filter(|&n| n <= MAX_NUMBERS as u64);
    match (numbers, usize::try_from(width), usize::try_from(channels)) {
        (Some(_), Ok(width), Ok(channels)) => Ok((frames, width, channels)),
        _ => {
            let needed = format!("at most {MAX_NUMBERS} readings in a frame");
            Err(invalid(path, values.element(), found(), needed))
        }
    }
}

fn read_ids(
    path: &Path,
    array: &StoredArray,
    values: &StoredArray,
    width: usize,
) -> Result<Vec<TaxelId>, IoError> {
    let needed = match values.header.shape.len() {
        3 => format!(
            "one for each of the {width} taxels of {}; or the other order of its taxels and channels",
            values.header.describe()
        ),
        _ => "one for each taxel".into(),
    };
    need_shape(path, array, width as u64, &needed)?;
    ids_of(path, array, width)
}

/// The ids of an array of `width` numbers or texts.
pub(in crate::io) fn ids_of(path: &Path, array: &StoredArray, width: usize) -> Result<Vec<TaxelId>, IoError> {
    let invalid_id = |k: usize, found: String| {
        let element = format!("{}, element {k}", array.element());
        invalid(path, element, found, "the number of a taxel, 0 to 4294967295")
    };
    let mut rows = ArrayRows::open(path, array, width)?;
    if !array.header.elements.is_number() {
        let texts = rows.texts(path)?;
        let id = |(k, text): (usize, &String)| {
            text.trim().parse().map(TaxelId).map_err(|_| invalid_id(k, excerpt(text)))
        };
        return texts.iter().enumerate().map(id).collect();
    }
    let mut ids = vec![0.0; width];
    rows.read(path, &mut ids)?;
    let id = |(k, &x): (usize, &f64)| {
        #[expect(clippy::cast_possible_truncation, reason = "whole and in range")]
        let id = (x.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&x)).then_some(TaxelId(x as u32));
        id.ok_or_else(|| invalid_id(k, x.to_string()))
    };
    ids.iter().enumerate().map(id).collect()
}

/// The channels: named by an array of texts, else by their number; their units, and their kinds where name and unit do not tell.
fn read_channels(
    path: &Path,
    [names, units, kinds]: [Result<Option<&StoredArray>, IoError>; 3],
    count: usize,
) -> Result<Vec<Channel>, IoError> {
    let texts = |array: Option<&StoredArray>| {
        let texts = array.map(|array| {
            need_shape(path, array, count as u64, "one for each channel")?;
            if array.header.elements.is_number() {
                return Err(invalid(path, array.element(), array.header.describe(), "strings"));
            }
            ArrayRows::open(path, array, count)?.texts(path)
        });
        texts.transpose()
    };
    let names = texts(names?)?.unwrap_or_else(|| match count {
        1 => vec![String::new()],
        _ => (0..count).map(|k| format!("channel{k}")).collect(),
    });
    let units = texts(units?)?.unwrap_or_else(|| vec![String::new(); count]);
    let channel = |(name, unit): (&String, &String)| Channel::new(name, unit);
    let channels = names.iter().zip(&units).map(channel).collect::<Result<Vec<Channel>, _>>();
    let mut channels = channels.map_err(|e| invalid(path, "units", units.join(", "), e.to_string()))?;
    for (channel, kind) in channels.iter_mut().zip(texts(kinds?)?.unwrap_or_default()) {
        let known = kind.parse();
        channel.kind = known.map_err(|_| {
            invalid(path, "array `kinds`", excerpt(&kind), "touch, tangential or other, for each channel")
        })?;
    }
    Ok(channels)
}

/// Refuses an array of another shape than `(count,)`.
fn need_shape(path: &Path, array: &StoredArray, count: u64, why: &str) -> Result<(), IoError> {
    if array.header.shape == [count] && array.header.elements.is_read() {
        return Ok(());
    }
    let needed = format!("the shape ({count},): {why}");
    Err(invalid(path, array.element(), array.header.describe(), needed))
}
