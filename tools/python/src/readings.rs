//! Readings: read, joined to a map, conditioned and summed, and those of simulated touches.

use std::{collections::HashSet, path::PathBuf, sync::Arc};

use dermatome::{
    io::{
        KnownRest, Readings, ReadingsLayout, ReadingsReader, StatementSource, SummaryCell, summary_rows,
        summary_step_rows,
    },
    recording::{Fill, Recording, RecordingOptions, in_order},
    signal::{
        Channel, ConditionOptions, Quantity, Response, Summary, Touch, TouchOptions, TouchSimulation,
        TrackerOptions, Zero, unit_ratio,
    },
    skin::{Presence, TaxelId},
};
use numpy::{IntoPyArray, PyArray1, PyArrayDyn, PyUntypedArrayMethods};
use pyo3::{
    prelude::*,
    types::{PyDict, PyList},
};

use crate::{
    arguments::{arg, object, object_or_none},
    arrays::{bad_shape, floats, matrix, one_each, one_number_each, shaped, vector},
    errors::{bad, error},
    jobs::{Stop, run, run_here},
    map::PyMap,
    options::{count, probe, word},
    pool::field_level,
    response::PyResponse,
    skin::PySkin,
};

/// Readings as arrays: values (T, C, N), ids, times, names and units of the channels.
fn arrays(py: Python<'_>, readings: Readings) -> PyResult<Bound<'_, PyDict>> {
    let Readings { ids, channels, width, times, values, rest } = readings;
    let arrays = PyDict::new(py);
    arrays.set_item("values", shaped(py, [times.len(), channels.len(), width], values)?)?;
    arrays.set_item("ids", ids.map(|ids| vector(py, ids.into_iter().map(|id| id.0))))?;
    arrays.set_item("timestamps", vector(py, times))?;
    for (key, of) in [("channels", (|c| &c.name) as fn(&Channel) -> &String), ("units", |c| &c.unit)] {
        arrays.set_item(key, channels.iter().map(of).collect::<Vec<_>>())?;
    }
    arrays.set_item("kinds", kinds_of(&channels))?;
    arrays.set_item("rest", (rest_of(&rest, &channels), rest.threshold))?;
    Ok(arrays)
}

/// The kinds of channels, where names and units do not tell them.
pub(crate) fn kinds_of(channels: &[Channel]) -> Option<Vec<String>> {
    let is_told = channels.iter().all(Channel::is_usual);
    (!is_told).then(|| channels.iter().map(|channel| channel.kind.to_string()).collect())
}

/// Of each channel whether readings are about 0.
pub(crate) fn rest_of(rest: &KnownRest, channels: &[Channel]) -> Vec<bool> {
    (0..channels.len()).map(|channel| rest.is_zero_in(channel)).collect()
}

/// Channels of these names and units, and kinds, where these are stated.
pub(crate) fn channels_of(
    names: &[String],
    units: &[String],
    kinds: Option<&[String]>,
) -> PyResult<Vec<Channel>> {
    if let Some(kinds) = kinds.filter(|kinds| kinds.len() != names.len()) {
        return Err(bad("kinds", kinds.len(), format!("{}, one for each channel", names.len())));
    }
    let one = |(k, (name, unit)): (usize, (&String, &String))| {
        let channel = Channel::new(name, unit).map_err(error)?;
        let Some(kind) = kinds.map(|kinds| &kinds[k]) else { return Ok(channel) };
        let needed = "touch, tangential or other";
        Ok(Channel { kind: kind.parse().map_err(|_| bad("kinds", format!("{kind:?}"), needed))?, ..channel })
    };
    names.iter().zip(units).enumerate().map(one).collect()
}

/// The arrays of a recording: `values` (T, C, n), `ids` (n,) or None, `timestamps` (T,) in s, `channels`, `units`; and
/// `kinds` of the channels, None where names and units tell them; `rest`, of each channel whether readings are about 0 where nothing
/// touches, and the threshold that is stated.
#[pyfunction]
#[pyo3(signature = (path, layout="tnc"))]
pub(crate) fn read_readings<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = arg)] path: PathBuf,
    #[pyo3(from_py_with = arg)] layout: &str,
) -> PyResult<Bound<'py, PyDict>> {
    let known = [("tnc", ReadingsLayout::TaxelsFirst), ("tcn", ReadingsLayout::ChannelsFirst)];
    let layout = word("layout", layout, &known)?;
    let read = move |stop: &Stop| Readings::collect(ReadingsReader::open(&path, layout)?, || stop.check());
    arrays(py, run(py, 0, read)?.map_err(error)?)
}

/// Readings of columns with these ids as readings of the taxels of a map, (T, C, n) to (T, C, N), and how they fit; `names` and
/// `units` are those of the channels.
#[pyfunction]
pub(crate) fn join_readings<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = object)] map: &Bound<'py, PyMap>,
    values: &Bound<'py, PyAny>,
    ids: &Bound<'py, PyAny>,
    #[pyo3(from_py_with = arg)] names: Vec<String>,
    #[pyo3(from_py_with = arg)] units: Vec<String>,
) -> PyResult<(Bound<'py, PyAny>, Vec<String>)> {
    let values = floats("values", values)?;
    let &[frames, count, width] = values.shape() else {
        return Err(bad_shape("values", values.shape(), "shape (T, C, n)"));
    };
    let channels = channels_of(&names, &units, None)?;
    if channels.len() != count {
        return Err(bad_shape("values", values.shape(), format!("shape (T, {}, n)", channels.len())));
    }
    let ids: Vec<TaxelId> = one_number_each("ids", ids, width)?.into_iter().map(TaxelId).collect();
    let (map, numbers) = (&map.get().map, values.as_slice()?);
    let joined = run_here(py, 1, |stop| in_order(map, &ids, &channels, numbers, || stop.check()))?;
    let (joined, report) = joined.map_err(error)?;
    let taxels = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
    Ok((shaped(py, [frames, count, taxels], joined)?.into_any(), report.remarks()))
}

/// The arrays of a recording: values (T, C, N), timestamps, names, units and kinds of channels, and the ids of the columns;
/// None: all taxels of a map, in their order.
pub(crate) type RecordingArrays<'py> = (
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Vec<String>,
    Vec<String>,
    Option<Vec<String>>,
    Option<Bound<'py, PyAny>>,
);

pub(crate) fn readings_of(
    (values, timestamps, channels, units, kinds, ids): RecordingArrays<'_>,
) -> PyResult<Readings> {
    let (values, timestamps) = (&values, &timestamps);
    let values = floats("values", values)?;
    let needed = [timestamps.len()?, channels.len(), units.len()];
    let &[frames, of_channels, width] = values.shape() else {
        return Err(bad_shape("values", values.shape(), "shape (T, C, N)"));
    };
    if [frames, of_channels, of_channels] != needed {
        let [frames, channels, _] = needed;
        return Err(bad_shape("values", values.shape(), format!("shape ({frames}, {channels}, N)")));
    }
    let ids = ids.map(|ids| one_number_each("ids", &ids, width)).transpose()?;
    Ok(Readings {
        ids: ids.map(|ids| ids.into_iter().map(TaxelId).collect()),
        channels: channels_of(&channels, &units, kinds.as_deref())?,
        width,
        times: one_each("timestamps", timestamps, frames)?,
        values: values.as_slice()?.to_vec(),
        rest: KnownRest::default(),
    })
}

/// Readings (T, C, N) of the taxels of a map, made comparable: the arrays of a recording with values (T, C, N);
/// `measured`, which of these are readings and not filled; and `remarks`. `ids` are those of the columns that the readings
/// had before they were joined to the map: other taxels have none, which is no remark. `tared` says which channels are about 0 where
/// nothing touches.
#[pyfunction]
#[pyo3(signature = (map, values, ids, timestamps, channels, units, *, kinds=None, tared=Vec::new(), baseline=0, zero=None, gains=Vec::new(),
    response=None, clip=None, split_hz=None, fill="none"))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub(crate) fn condition_readings<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = object)] map: &Bound<'py, PyMap>,
    values: &Bound<'py, PyAny>,
    ids: Option<&Bound<'py, PyAny>>,
    timestamps: &Bound<'py, PyAny>,
    #[pyo3(from_py_with = arg)] channels: Vec<String>,
    #[pyo3(from_py_with = arg)] units: Vec<String>,
    #[pyo3(from_py_with = arg)] kinds: Option<Vec<String>>,
    tared: Vec<bool>,
    #[pyo3(from_py_with = arg)] baseline: i64,
    #[pyo3(from_py_with = arg)] zero: Option<&str>,
    gains: Vec<(u32, f64)>,
    #[pyo3(from_py_with = object_or_none)] response: Option<&Bound<'py, PyResponse>>,
    #[pyo3(from_py_with = arg)] clip: Option<[f64; 2]>,
    #[pyo3(from_py_with = arg)] split_hz: Option<f64>,
    #[pyo3(from_py_with = arg)] fill: &str,
) -> PyResult<Bound<'py, PyDict>> {
    let fill = word("fill", fill, &[("none", Fill::None), ("neighbours", Fill::Neighbours)])?;
    let mut readings = readings_of((values.clone(), timestamps.clone(), channels, units, kinds, None))?;
    readings.rest.is_zero = tared;
    let ids = ids.map(|ids| one_number_each("ids", ids, ids.len()?)).transpose()?;
    let gains = gains.into_iter().map(|(id, gain)| (TaxelId(id), gain)).collect();
    let zero = match zero {
        None => Zero::First(count("baseline", baseline)?),
        Some(zero) => word("zero", zero, &[("follow", Zero::Follow), ("stored", Zero::Stored)])?,
    };
    if zero == Zero::Stored && response.is_none() {
        return Err(bad("zero", "\"stored\" without a response", "response, which has the zeros"));
    }
    let response = response.map(|response| Response::clone(&response.get().response));
    let condition = ConditionOptions { zero, gains, response, clip, split_hz };
    let options = RecordingOptions { condition, fill, ..RecordingOptions::default() };
    let map = Arc::clone(&map.get().map);
    let made = run(py, 0, move |stop| -> Result<_, dermatome::Error> {
        let frames = readings.times.len();
        let mut recording = Recording::open(&map, ReadingsReader::memory(readings)?, &options)?;
        let width = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
        let mut out = Readings { channels: recording.channels().to_vec(), width, ..Readings::default() };
        let numbers = frames * out.channels.len() * width;
        out.values.reserve(numbers);
        let mut measured: Vec<bool> = Vec::with_capacity(numbers);
        while let Some(step) = recording.next_step()? {
            stop.check();
            out.times.push(step.frame.time);
            for channel in 0..out.channels.len() {
                for (values, filled) in step.frame.values.iter().zip(&step.frame.filled) {
                    let first = measured.len();
                    out.values.extend_from_slice(values[channel].as_slice());
                    measured.extend(values[channel].iter().map(|x| x.is_finite()));
                    filled[channel].iter().for_each(|taxel| measured[first + taxel.index()] = false);
                }
            }
        }
        let mut report = recording.report();
        if let Some(ids) = ids {
            let ids: HashSet<u32> = ids.into_iter().collect();
            let has_none = |(id, presence): &(&TaxelId, &Presence)| {
                **presence == Presence::Present && !ids.contains(&id.0)
            };
            let taxels = map.patches.iter().flat_map(|p| p.taxels.ids.iter().zip(&p.taxels.presence));
            let without_column = taxels.filter(has_none).count();
            report.join.masked += without_column;
            report.missing = report.missing.saturating_sub(without_column * report.channels * report.read);
        }
        out.rest = recording.known_rest();
        let checked =
            recording.statements().into_iter().filter(|known| known.source == StatementSource::Checked);
        let mut remarks: Vec<String> =
            checked.map(|known| format!("{}: {}", known.what, known.value)).collect();
        remarks.extend(report.remarks(zero));
        Ok((out, measured, remarks))
    })?;
    let (readings, measured, remarks) = made.map_err(error)?;
    let measured = shaped(py, [readings.times.len(), readings.channels.len(), readings.width], measured)?;
    let conditioned = arrays(py, readings)?;
    conditioned.set_item("measured", measured)?;
    conditioned.set_item("remarks", remarks)?;
    Ok(conditioned)
}

/// What has a row of a summary.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Rows {
    Groups,
    Steps,
}

/// The sums of readings (T, N) of one channel in the order of a map: a dict for each group, or with `by="step"` for each loading of a
/// patch or a region; the threshold, and the number of gaps. Without a threshold it is estimated from the first frames, whose mean is subtracted.
#[pyfunction]
#[pyo3(signature = (map, values, timestamps, channel, unit, *, kind=None, threshold=None, is_tared=false, stated=None, probe="any", level=None,
    by="group"))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub(crate) fn summarise_readings<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = object)] map: &Bound<'py, PyMap>,
    values: &Bound<'py, PyAny>,
    timestamps: &Bound<'py, PyAny>,
    #[pyo3(from_py_with = arg)] channel: &str,
    #[pyo3(from_py_with = arg)] unit: &str,
    #[pyo3(from_py_with = arg)] kind: Option<String>,
    #[pyo3(from_py_with = arg)] threshold: Option<f64>,
    #[pyo3(from_py_with = arg)] is_tared: bool,
    #[pyo3(from_py_with = arg)] stated: Option<f64>,
    #[pyo3(from_py_with = arg)] probe: &str,
    #[pyo3(from_py_with = arg)] level: Option<&str>,
    #[pyo3(from_py_with = arg)] by: &str,
) -> PyResult<(Bound<'py, PyList>, Option<f64>, usize)> {
    let values = floats("values", values)?;
    let &[frames, width] = values.shape() else {
        return Err(bad_shape("values", values.shape(), "shape (T, N)"));
    };
    let readings = Readings {
        ids: None,
        channels: channels_of(&[channel.into()], &[unit.into()], kind.map(|kind| vec![kind]).as_deref())?,
        width,
        times: one_each("timestamps", timestamps, frames)?,
        values: values.as_slice()?.to_vec(),
        rest: KnownRest { is_zero: vec![is_tared], threshold: stated },
    };
    let probe = self::probe(probe)?;
    let by = word("by", by, &[("group", Rows::Groups), ("step", Rows::Steps)])?;
    // Contacts need a threshold above 0.
    let threshold = threshold.map(|x| if x == 0.0 { f64::MIN_POSITIVE } else { x });
    let map = Arc::clone(&map.get().map);
    let level = level.map(|name| field_level(&map, name)).transpose()?;
    if by == Rows::Steps && level.is_some() {
        return Err(bad("level", "a level and by=\"step\"", "one of the two"));
    }
    let made = run(py, 0, move |stop| -> Result<_, dermatome::Error> {
        let mut recording =
            Recording::open(&map, ReadingsReader::memory(readings)?, &RecordingOptions::default())?;
        let known = recording.tracker_options(0);
        let threshold = threshold.or(known.threshold);
        let options = TrackerOptions { threshold, probe, low: probe.low(), ..known };
        match level {
            Some(level) => recording.summarise_fields(&options, level),
            None if by == Rows::Steps => recording.summarise_steps(&options),
            None => recording.summarise(&options),
        }?;
        while recording.next_step()?.is_some() {
            stop.check();
        }
        let summary = recording.summary();
        let rows = summary.map_or_else(Vec::new, |summary| match by {
            Rows::Groups => summary_rows(&map, summary),
            Rows::Steps => summary_step_rows(&map, summary, ""),
        });
        Ok((rows, recording.threshold(), summary.map_or(0, Summary::gaps)))
    })?;
    let (rows, threshold, gaps) = made.map_err(error)?;
    let list = PyList::empty(py);
    for row in rows {
        let dict = PyDict::new(py);
        for (name, cell) in row {
            match cell {
                SummaryCell::Text(text) => dict.set_item(name, text)?,
                SummaryCell::Number(number) => dict.set_item(name, number)?,
                SummaryCell::Count(count) => dict.set_item(name, count)?,
            }
        }
        list.append(dict)?;
    }
    Ok((list, threshold, gaps))
}

/// The number of the channel that is meant where none is named.
#[pyfunction]
#[pyo3(signature = (channels, units, kinds=None))]
pub(crate) fn main_channel(
    #[pyo3(from_py_with = arg)] channels: Vec<String>,
    #[pyo3(from_py_with = arg)] units: Vec<String>,
    #[pyo3(from_py_with = arg)] kinds: Option<Vec<String>>,
) -> PyResult<usize> {
    let channels = channels_of(&channels, &units, kinds.as_deref())?;
    Ok(dermatome::signal::main_channel(channels.iter().map(|channel| channel.kind)))
}

/// Whether a channel of this name and unit is an amount, as a force, and not an average.
#[pyfunction]
pub(crate) fn is_extensive(
    #[pyo3(from_py_with = arg)] name: &str,
    #[pyo3(from_py_with = arg)] unit: &str,
) -> PyResult<bool> {
    Ok(Channel::new(name, unit).map_err(error)?.quantity == Quantity::Extensive)
}

/// Whether a channel of this name and unit measures touches, so that zeros and gains concern it.
#[pyfunction]
#[pyo3(signature = (name, unit, kind=None))]
pub(crate) fn is_of_touch(
    #[pyo3(from_py_with = arg)] name: &str,
    #[pyo3(from_py_with = arg)] unit: &str,
    #[pyo3(from_py_with = arg)] kind: Option<String>,
) -> PyResult<bool> {
    let kinds = kind.map(|kind| vec![kind]);
    let channels = channels_of(&[name.into()], &[unit.into()], kinds.as_deref())?;
    Ok(channels.iter().all(|channel| channel.kind.is_of_touch()))
}

/// What readings have by two statements of their units, which must be the same.
#[pyfunction]
pub(crate) fn is_same_unit(
    #[pyo3(from_py_with = arg)] unit: &str,
    #[pyo3(from_py_with = arg)] other: &str,
) -> bool {
    unit_ratio(unit, other) == Some(1.0)
}

/// An argument as an array of real numbers, or an error that names it.
#[pyfunction]
pub(crate) fn as_floats<'py>(
    #[pyo3(from_py_with = arg)] name: &str,
    value: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    Ok(floats(name, value)?.as_array().to_owned().into_pyarray(value.py()))
}

/// An argument as an array of `count` whole numbers from 0 on, or an error that names it.
#[pyfunction]
pub(crate) fn as_numbers<'py>(
    #[pyo3(from_py_with = arg)] name: &str,
    value: &Bound<'py, PyAny>,
    #[pyo3(from_py_with = arg)] count: usize,
) -> PyResult<Bound<'py, PyArray1<u32>>> {
    Ok(vector(value.py(), one_number_each(name, value, count)?))
}

/// The arrays of a simulated recording: as `read_readings`, and `truth`.
#[pyfunction]
#[pyo3(signature = (skin, *, presses=5, touches=1, radius=0.015, depth=0.002, stiffness=2e7, roll=0.02, duration=1.0,
    pause=0.25, rate=100.0, taxel_radius=0.002, extensive=true, noise=0.0, drift=0.0, dead=0.0, seed=0))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub(crate) fn simulate_touch<'py>(
    py: Python<'py>,
    skin: &Bound<'py, PyAny>,
    #[pyo3(from_py_with = arg)] presses: i64,
    #[pyo3(from_py_with = arg)] touches: i64,
    #[pyo3(from_py_with = arg)] radius: f64,
    #[pyo3(from_py_with = arg)] depth: f64,
    #[pyo3(from_py_with = arg)] stiffness: f64,
    #[pyo3(from_py_with = arg)] roll: f64,
    #[pyo3(from_py_with = arg)] duration: f64,
    #[pyo3(from_py_with = arg)] pause: f64,
    #[pyo3(from_py_with = arg)] rate: f64,
    #[pyo3(from_py_with = arg)] taxel_radius: f64,
    #[pyo3(from_py_with = arg)] extensive: bool,
    #[pyo3(from_py_with = arg)] noise: f64,
    #[pyo3(from_py_with = arg)] drift: f64,
    #[pyo3(from_py_with = arg)] dead: f64,
    #[pyo3(from_py_with = arg)] seed: u64,
) -> PyResult<Bound<'py, PyDict>> {
    let skin = match (skin.cast::<PySkin>(), skin.cast::<PyMap>()) {
        (Ok(skin), _) => Arc::clone(&skin.get().skin),
        (_, Ok(map)) => Arc::new(map.get().map.skin()),
        _ => return Err(bad("skin", skin.get_type().name()?, "a Skin or a Map")),
    };
    let options = TouchOptions {
        radii: vec![radius],
        depths: [depth; 2],
        stiffness,
        presses: count("presses", presses)?,
        touches: count("touches", touches)?,
        roll,
        duration,
        pause,
        rate,
        taxel_radius,
        quantity: if extensive { Quantity::Extensive } else { Quantity::Intensive },
        noise,
        drift,
        dead,
        seed,
        ..TouchOptions::default()
    };
    let names: Vec<String> = skin.patches.iter().map(|patch| patch.name.clone()).collect();
    let made = run(py, 0, move |stop| -> Result<(Readings, Vec<Touch>), dermatome::Error> {
        let mut simulation = TouchSimulation::new(&skin, &options)?;
        let taxels = skin.patches.iter().map(|patch| &patch.taxels.ids);
        let ids: Vec<TaxelId> = taxels.flat_map(|ids| ids.iter().copied()).collect();
        let channels = vec![simulation.channel().clone()];
        // Where patches share ids the order of the map says which taxel a column is of.
        let width = ids.len();
        let is_unique = ids.iter().collect::<HashSet<_>>().len() == width;
        let ids = is_unique.then_some(ids);
        let mut recording = Readings { width, channels, ids, ..Readings::default() };
        let mut truth = Vec::new();
        while let Some((frame, touches)) = simulation.next_frame() {
            stop.check();
            recording.values.extend(frame.values.iter().flat_map(|channels| channels[0].iter()));
            recording.times.push(frame.time);
            truth.extend_from_slice(touches);
        }
        Ok((recording, truth))
    })?;
    let (recording, truth) = made.map_err(error)?;
    let arrays = arrays(py, recording)?;
    let columns = PyDict::new(py);
    let whole = |of: fn(&Touch) -> usize| vector(py, truth.iter().map(move |touch| of(touch) as i64));
    columns.set_item("frame", whole(|touch| touch.frame))?;
    columns.set_item("press", whole(|touch| touch.press))?;
    columns.set_item("taxels", whole(|touch| touch.taxels))?;
    columns.set_item("time", vector(py, truth.iter().map(|touch| touch.time)))?;
    columns.set_item("force", vector(py, truth.iter().map(|touch| touch.force)))?;
    columns.set_item(
        "patch",
        truth.iter().map(|touch| names[touch.patch.index()].as_str()).collect::<Vec<_>>(),
    )?;
    columns.set_item("sphere", matrix(py, truth.iter().map(|touch| touch.sphere.to_array()))?)?;
    columns.set_item("centre", matrix(py, truth.iter().map(|touch| touch.centre.to_array()))?)?;
    arrays.set_item("truth", columns)?;
    Ok(arrays)
}
