//! `Renderer`, `ContactTracker`, `read_readings` and `touch`: values on taxels, and images of them.

use std::{
    path::PathBuf,
    sync::{Arc, Mutex, PoisonError},
};

use dermatome::{
    SkinMap,
    atlas::{Atlas, AtlasOptions, Pack, Resolution},
    image::{BatchRenderer, Interpolation, RenderOptions, Renderer},
    io::{Readings, ReadingsLayout, ReadingsReader},
    recording::{Fill, Recording, RecordingOptions},
    signal::{
        Channel, ConditionOptions, ContactEvent, ContactRegion, ContactTracker, Duplicates, Frame, Join,
        Quantity, Restrictor, Touch, TouchOptions, TouchSimulation, TrackerOptions, Zero,
    },
    skin::TaxelId,
};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::{
    prelude::*,
    types::{PyDict, PyList},
};
use rayon::prelude::*;

use crate::{
    arrays::{Reals, bad_shape, floats, matrix, one_each, one_number_each, reals, shaped, vector, zeros},
    errors::{bad, error},
    jobs::{Stop, run, run_here},
    map::{PyMap, starts},
    matrix::{PyMatrix, Rows},
    options::{channels, count, extensive, level, positive, word},
    skin::PySkin,
};

/// Draws frames of readings as tactile images of one level.
///
/// Made by `Map.renderer`. Images are the same as those of `dermatome render`, in any batch and with any number of
/// threads.
///
/// Examples
/// --------
/// >>> import dermatome, numpy as np
/// >>> grid = [[0.005 * x, 0.005 * y, 0] for y in range(12) for x in range(12)]
/// >>> renderer = dermatome.build(dermatome.Skin.from_arrays(grid)).renderer(size=(32, 32))
/// >>> images = renderer(np.full((5, 144), 2.5))
/// >>> images.shape, bool((images[0, 0][renderer.mask] == 2.5).all())
/// ((5, 1, 32, 32), True)
#[pyclass(frozen, module = "dermatome", name = "Renderer")]
#[derive(Debug)]
pub(crate) struct PyRenderer {
    plan: Arc<Plan>,
    /// tuple of int: Height and width of the images, in pixels.
    #[pyo3(get)]
    shape: (usize, usize),
    /// tuple of float: Height and width of a pixel, in m on the map.
    #[pyo3(get)]
    pixel: (f64, f64),
}

/// What draws a frame, before the first one.
#[derive(Debug)]
struct Plan {
    join: Join,
    restrictor: Restrictor,
    renderer: Renderer,
    frame: Frame,
    taxels: usize,
    channels: usize,
    fill: f32,
    /// Where the values of each patch begin among those of the level.
    starts: Vec<usize>,
    /// The id that each pixel shows.
    taxel_ids: Vec<u32>,
}

impl Plan {
    /// Draws frames of readings.
    fn draw<T: Copy + Into<f64> + Sync>(&self, values: &[T], images: &mut [f32], stop: &Stop) {
        let (size, width) = (self.renderer.images()[0].values.len(), self.channels * self.taxels);
        let share = (images.len() / size).div_ceil(4 * rayon::current_num_threads()).max(1);
        images.par_chunks_mut(share * size).zip(values.par_chunks(share * width)).for_each_init(
            || {
                let Self { restrictor, renderer, frame, .. } = self;
                BatchRenderer::new(restrictor.clone(), renderer.clone(), frame.clone())
            },
            |batch, (images, values)| {
                let fill = |k: usize, frame: &mut Frame| {
                    stop.check();
                    self.join.fill(&values[k * width..(k + 1) * width], frame);
                };
                batch.render(fill, images);
                if !self.fill.is_nan() {
                    images.iter_mut().for_each(|x| *x = if x.is_nan() { self.fill } else { *x });
                }
            },
        );
    }
}

/// The most numbers of an image: a GiB.
const MOST_NUMBERS: usize = 1 << 28;

/// How images are drawn, from arguments.
pub(crate) struct RenderArgs<'a> {
    pub(crate) level: i64,
    pub(crate) patch: Option<&'a str>,
    pub(crate) channels: i64,
    pub(crate) extensive: Option<&'a Bound<'a, PyAny>>,
    pub(crate) interpolate: &'a str,
    pub(crate) size: Option<(u32, u32)>,
    pub(crate) pixel: Option<f64>,
    pub(crate) pack: Option<Pack>,
    pub(crate) fill: Option<f32>,
}

impl PyRenderer {
    pub(crate) fn new(py: Python<'_>, map: &PyMap, args: &RenderArgs<'_>) -> PyResult<Self> {
        let level = level("level", args.level, map.levels())?;
        let patch = match args.patch {
            Some(name) => Some(map.patch_named(name)?),
            None if args.pack.is_some() || map.map.patches.len() == 1 => None,
            None => {
                return Err(bad(
                    "patch",
                    format!("None of {}", map.map.patches.len()),
                    "a name, or pack=\"tight\"",
                ));
            }
        };
        let count = count("channels", args.channels)?;
        if !(1..=MOST_NUMBERS).contains(&count) {
            return Err(bad("channels", count, "1 or more"));
        }
        let known = [("linear", Interpolation::Linear), ("nearest", Interpolation::Nearest)];
        let interpolation = word("interpolate", args.interpolate, &known)?;
        let resolution = match (args.size, args.pixel) {
            (None, None) => Resolution::Map,
            (Some((height, width)), None) => Resolution::Canvas([height, width]),
            (None, Some(side)) => Resolution::Pixel(positive("pixel", side)?),
            (Some(_), Some(_)) => return Err(bad("pixel", "size and pixel", "one of the two")),
        };
        let options = AtlasOptions { resolution, pack: args.pack };
        let (map, fill) = (Arc::clone(&map.map), args.fill.unwrap_or(f32::NAN));
        let extensive = extensive(args.extensive, count)?;
        let plan = run(py, 0, move |_| -> Result<Option<Plan>, dermatome::Error> {
            let mut atlas = Atlas::new(&map, &options)?;
            let of_patch = |chart: &dermatome::atlas::Chart| patch.is_none_or(|patch| chart.patch == patch);
            atlas.parts.retain(|part| part.level == level && part.charts.iter().any(of_patch));
            let taxels: usize = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
            let pixels = |[width, height]: [u32; 2]| width as usize * height as usize;
            let size = atlas.parts.first().map(|part| pixels(part.frame.size_px).max(taxels));
            if size.is_none_or(|size| size * count > MOST_NUMBERS) {
                return Ok(None);
            }
            let channels = channels(extensive);
            let render = RenderOptions { interpolation, level: Some(level) };
            Ok(Some(Plan {
                join: Join::new(&map, None, taxels, Duplicates::Refuse)?,
                restrictor: Restrictor::to_level(&map, &channels, level),
                renderer: Renderer::new(&map, &atlas, &channels, &render)?,
                frame: Frame::new(&map, channels.len()),
                taxels,
                channels: channels.len(),
                fill,
                starts: starts(&map, level),
                taxel_ids: atlas.parts[0].taxel_ids(&map),
            }))
        })?;
        let needed = "a level that the patch has, and images of less than 2^28 numbers";
        let found = || format!("level {}, {count} channels", args.level);
        let plan = plan.map_err(error)?.ok_or_else(|| bad("renderer", found(), needed))?;
        let frame = plan.renderer.images()[0].frame;
        let [width, height] = frame.size_px;
        let pixel = (frame.size.y / f64::from(height), frame.size.x / f64::from(width));
        Ok(Self { plan: Arc::new(plan), shape: (height as usize, width as usize), pixel })
    }
}

#[pymethods]
impl PyRenderer {
    /// Draw frames of readings.
    ///
    /// Parameters
    /// ----------
    /// values : (T, C, N) or, with one channel, (T, N) array_like
    ///     Readings in the order of the map; NaN where there is none.
    /// threads : int
    ///     0 for one per processor.
    ///
    /// Returns
    /// -------
    /// (T, C, H, W) float32 array
    ///     The images, the first row on top; `fill` (NaN by default) where nothing is known. Forces are drawn per
    ///     m^2 of the map.
    #[pyo3(signature = (values, *, threads=0))]
    fn __call__<'py>(
        &self,
        py: Python<'py>,
        values: &Bound<'py, PyAny>,
        threads: i64,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let Plan { channels, taxels, .. } = *self.plan;
        let values = reals("values", values)?;
        let frames = match *values.shape() {
            [frames, c, n] if (c, n) == (channels, taxels) => frames,
            [frames, n] if (1, n) == (channels, taxels) => frames,
            ref shape => return Err(bad_shape("values", shape, format!("shape (T, {channels}, {taxels})"))),
        };
        let images = zeros(py, &[frames, channels, self.shape.0, self.shape.1])?;
        let (mut drawn, threads) = (images.readwrite(), count("threads", threads)?);
        let drawn = drawn.as_slice_mut()?;
        match values {
            Reals::Single(values) => {
                let values = values.as_slice()?;
                run_here(py, threads, |stop| self.plan.draw(values, drawn, stop))?;
            }
            Reals::Double(values) => {
                let values = values.as_slice()?;
                run_here(py, threads, |stop| self.plan.draw(values, drawn, stop))?;
            }
        }
        Ok(images)
    }

    /// (H, W) bool array: Which pixels show the skin.
    #[getter]
    fn mask<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<bool>>> {
        let covered = self.plan.renderer.images()[0].coverage.iter().map(|&covered| covered == 1);
        shaped(py, [self.shape.0, self.shape.1], covered.collect())
    }

    /// (H, W) uint32 array: Id of the taxel nearest to each pixel, above level 0 the number of the field in its patch;
    /// 4294967295 where there is none.
    #[getter]
    fn taxel_id<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        shaped(py, [self.shape.0, self.shape.1], self.plan.taxel_ids.clone())
    }

    /// The matrix that draws values of the level where none is missing: (H W, values of the level of the whole map).
    /// Rows of pixels that do not show the skin are empty.
    ///
    /// Returns
    /// -------
    /// Matrix
    fn matrix(&self, py: Python<'_>) -> PyMatrix {
        let Plan { renderer, starts, .. } = &*self.plan;
        let mut pixels = vec![Vec::new(); self.shape.0 * self.shape.1];
        renderer.each_pixel(0, |patch, pixel, weights| {
            let start = starts[patch.index()];
            pixels[pixel as usize] = weights.iter().map(|&(v, w)| (start + v as usize, w)).collect();
        });
        let mut rows = Rows::new();
        pixels.into_iter().for_each(|row| rows.push(row));
        rows.into_matrix(py, starts.last().copied().unwrap_or(0))
    }

    fn __repr__(&self) -> String {
        format!("<dermatome.Renderer: {} x {} pixels>", self.shape.0, self.shape.1)
    }
}

/// Finds what touches the skin in frames of readings, and follows it from frame to frame.
///
/// Parameters
/// ----------
/// map : Map
///     The map.
/// unit : str
///     Unit of the readings, as "Pa" or "N"; forces are known for units of pressure and force.
/// threshold : float, optional
///     A contact has a taxel above this, in the unit of the readings; by default estimated from the first frames,
///     in which nothing should touch the skin.
/// low : float
///     Its other taxels are above this share of the threshold.
/// least : int
///     A contact has at least this many taxels.
/// prominence : float
///     A region with several peaks is split where a part rises above the saddle by this share of its height.
/// part : int
///     Such a part has at least this many taxels above the saddle.
/// noise_frames : int
///     From how many frames the threshold is estimated.
/// reach : float
///     How far a contact may move from a frame to the next, in m.
/// lasting : int
///     How many frames a contact lasts at least.
#[pyclass(frozen, module = "dermatome", name = "ContactTracker")]
#[derive(Debug)]
pub(crate) struct PyContactTracker {
    tracker: Mutex<(ContactTracker, Frame)>,
    join: Join,
    taxels: usize,
    map: Arc<SkinMap>,
}

#[pymethods]
impl PyContactTracker {
    #[new]
    #[pyo3(signature = (map, *, unit="Pa", threshold=None, low=0.5, least=2, prominence=0.5, part=4, noise_frames=5,
        reach=0.01, lasting=1))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn new(
        map: &Bound<'_, PyMap>,
        unit: &str,
        threshold: Option<f64>,
        low: f64,
        least: i64,
        prominence: f64,
        part: i64,
        noise_frames: i64,
        reach: f64,
        lasting: i64,
    ) -> PyResult<Self> {
        let map = &map.get().map;
        let options = TrackerOptions {
            channel: 0,
            threshold,
            low,
            least: count("least", least)?,
            prominence,
            part: count("part", part)?,
            noise_frames: count("noise_frames", noise_frames)?,
            reach,
            lasting: count("lasting", lasting)?,
        };
        let channel = Channel::new("", unit).map_err(error)?;
        let tracker = ContactTracker::new(map, &channel, &options).map_err(error)?;
        let taxels = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
        let join = Join::new(map, None, taxels, Duplicates::Refuse).map_err(error)?;
        Ok(Self { tracker: Mutex::new((tracker, Frame::new(map, 1))), join, taxels, map: Arc::clone(map) })
    }

    /// Find the contacts of the next frame.
    ///
    /// Parameters
    /// ----------
    /// values : (N,) array_like
    ///     Readings in the order of the map; NaN where there is none.
    ///
    /// Returns
    /// -------
    /// list of dict
    ///     For each contact its `track`, `event` ("onset", "move" or "release"), `age`, `patch`, `link`, `taxels`,
    ///     `area` (m^2), `force` (N), `centre` and `normal` (m, frame of the link), `uv` (m on the map), `major`,
    ///     `minor` (m), `angle` (rad), `peak_taxel` and `peak`.
    fn track<'py>(&self, py: Python<'py>, values: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyList>> {
        let values = floats("values", values)?;
        if values.shape() != [self.taxels] {
            return Err(bad_shape("values", values.shape(), format!("shape ({},)", self.taxels)));
        }
        let values = values.as_slice()?.to_vec();
        let regions = py.detach(|| {
            let (tracker, frame) = &mut *self.tracker.lock().unwrap_or_else(PoisonError::into_inner);
            self.join.fill(&values, frame);
            tracker.track(frame).to_vec()
        });
        let contacts = PyList::empty(py);
        for region in &regions {
            contacts.append(self.contact(py, region)?)?;
        }
        Ok(contacts)
    }

    /// float or None: The threshold, given or estimated; None while it is not known.
    #[getter]
    fn threshold(&self) -> Option<f64> {
        self.tracker.lock().unwrap_or_else(PoisonError::into_inner).0.threshold()
    }
}

impl PyContactTracker {
    fn contact<'py>(&self, py: Python<'py>, region: &ContactRegion) -> PyResult<Bound<'py, PyDict>> {
        let contact = PyDict::new(py);
        let event = match region.event {
            ContactEvent::Onset => "onset",
            ContactEvent::Move => "move",
            ContactEvent::Release => "release",
        };
        contact.set_item("track", region.track)?;
        contact.set_item("event", event)?;
        contact.set_item("age", region.age)?;
        contact.set_item("patch", &self.map.patches[region.patch].name)?;
        contact.set_item("link", &self.map.links[region.link].name)?;
        contact.set_item("taxels", vector(py, region.taxels.iter().map(|taxel| taxel.raw())))?;
        contact.set_item("area", region.area)?;
        contact.set_item("force", region.force)?;
        contact.set_item("centre", vector(py, region.centre.to_array()))?;
        contact.set_item("normal", vector(py, region.normal.to_array()))?;
        contact.set_item("uv", vector(py, region.map.to_array()))?;
        contact.set_item("major", region.major)?;
        contact.set_item("minor", region.minor)?;
        contact.set_item("angle", region.angle)?;
        contact.set_item("peak_taxel", region.peak_taxel.raw())?;
        contact.set_item("peak", region.peak)?;
        Ok(contact)
    }
}

/// Readings as arrays: values (T, C, N), ids, times, names and units of the channels.
fn arrays(py: Python<'_>, readings: Readings) -> PyResult<Bound<'_, PyDict>> {
    let Readings { ids, channels, width, times, values } = readings;
    let arrays = PyDict::new(py);
    arrays.set_item("values", shaped(py, [times.len(), channels.len(), width], values)?)?;
    arrays.set_item("ids", ids.map(|ids| vector(py, ids.into_iter().map(|id| id.0))))?;
    arrays.set_item("timestamps", vector(py, times))?;
    for (key, of) in [("channels", (|c| &c.name) as fn(&Channel) -> &String), ("units", |c| &c.unit)] {
        arrays.set_item(key, channels.iter().map(of).collect::<Vec<_>>())?;
    }
    Ok(arrays)
}

/// The arrays of a recording: `values` (T, C, n), `ids` (n,) or None, `timestamps` (T,) in s, `channels`, `units`.
#[pyfunction]
#[pyo3(signature = (path, layout="tnc"))]
pub(crate) fn read_readings<'py>(
    py: Python<'py>,
    path: PathBuf,
    layout: &str,
) -> PyResult<Bound<'py, PyDict>> {
    let known = [("tnc", ReadingsLayout::TaxelsFirst), ("tcn", ReadingsLayout::ChannelsFirst)];
    let layout = word("layout", layout, &known)?;
    let read = move |stop: &Stop| Readings::collect(ReadingsReader::open(&path, layout)?, || stop.check());
    arrays(py, run(py, 0, read)?.map_err(error)?)
}

/// Readings of columns with these ids as readings of the taxels of a map: (T, C, n) to (T, C, N).
#[pyfunction]
pub(crate) fn join_readings<'py>(
    py: Python<'py>,
    map: &Bound<'py, PyMap>,
    values: &Bound<'py, PyAny>,
    ids: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let values = floats("values", values)?;
    let &[frames, channels, width] = values.shape() else {
        return Err(bad_shape("values", values.shape(), "shape (T, C, n)"));
    };
    let ids: Vec<TaxelId> = one_number_each("ids", ids, width)?.into_iter().map(TaxelId).collect();
    let map = Arc::clone(&map.get().map);
    let join = Join::new(&map, Some(&ids), width, Duplicates::Refuse).map_err(error)?;
    let taxels: usize = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
    let mut joined: Vec<f64> = Vec::with_capacity(frames * channels * taxels);
    let mut frame = Frame::new(&map, 1);
    for row in values.as_slice()?.chunks_exact(width) {
        join.fill(row, &mut frame);
        joined.extend(frame.values.iter().flat_map(|channels| channels[0].iter()));
    }
    Ok(shaped(py, [frames, channels, taxels], joined)?.into_any())
}

/// Readings (T, C, n) on the taxels of a map, made comparable: the arrays of a recording with values (T, C, N), and
/// `measured`, which of these are readings and not filled.
#[pyfunction]
#[pyo3(signature = (map, values, ids, timestamps, channels, units, *, baseline=0, gains=Vec::new(), clip=None, split_hz=None,
    rate_hz=None, fill="none"))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub(crate) fn condition_readings<'py>(
    py: Python<'py>,
    map: &Bound<'py, PyMap>,
    values: &Bound<'py, PyAny>,
    ids: Option<&Bound<'py, PyAny>>,
    timestamps: &Bound<'py, PyAny>,
    channels: Vec<String>,
    units: Vec<String>,
    baseline: i64,
    gains: Vec<(u32, f64)>,
    clip: Option<[f64; 2]>,
    split_hz: Option<f64>,
    rate_hz: Option<f64>,
    fill: &str,
) -> PyResult<Bound<'py, PyDict>> {
    let fill = word("fill", fill, &[("none", Fill::None), ("neighbours", Fill::Neighbours)])?;
    let values = floats("values", values)?;
    let needed = [timestamps.len()?, channels.len(), units.len()];
    let &[frames, of_channels, width] = values.shape() else {
        return Err(bad_shape("values", values.shape(), "shape (T, C, n)"));
    };
    if [frames, of_channels, of_channels] != needed {
        let [frames, channels, _] = needed;
        return Err(bad_shape("values", values.shape(), format!("shape ({frames}, {channels}, n)")));
    }
    let ids = ids.map(|ids| one_number_each("ids", ids, width)).transpose()?;
    let channel = |(name, unit)| Channel { name, unit, ..Channel::default() };
    let readings = Readings {
        ids: ids.map(|ids| ids.into_iter().map(TaxelId).collect()),
        channels: channels.into_iter().zip(units).map(channel).collect(),
        width,
        times: one_each("timestamps", timestamps, frames)?,
        values: values.as_slice()?.to_vec(),
    };
    let gains = gains.into_iter().map(|(id, gain)| (TaxelId(id), gain)).collect();
    let condition =
        ConditionOptions { zero: Zero::First(count("baseline", baseline)?), gains, clip, split_hz };
    let options = RecordingOptions { rate_hz, condition, fill, ..RecordingOptions::default() };
    let map = Arc::clone(&map.get().map);
    let made = run(py, 0, move |stop| -> Result<_, dermatome::Error> {
        let mut recording = Recording::open(&map, ReadingsReader::memory(readings)?, &options)?;
        let width = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
        let mut out = Readings { channels: recording.channels().to_vec(), width, ..Readings::default() };
        let mut measured: Vec<bool> = Vec::new();
        while let Some(step) = recording.next_step()? {
            stop.check();
            out.times.push(step.frame.time);
            for channel in 0..out.channels.len() {
                for (values, filled) in step.frame.values.iter().zip(&step.frame.filled) {
                    let first = measured.len();
                    out.values.extend_from_slice(&values[channel]);
                    measured.extend(values[channel].iter().map(|x| x.is_finite()));
                    filled[channel].iter().for_each(|taxel| measured[first + taxel.index()] = false);
                }
            }
        }
        Ok((out, measured))
    })?;
    let (readings, measured) = made.map_err(error)?;
    let measured = shaped(py, [readings.times.len(), readings.channels.len(), readings.width], measured)?;
    let conditioned = arrays(py, readings)?;
    conditioned.set_item("measured", measured)?;
    Ok(conditioned)
}

/// Whether a channel of this name and unit is an amount, as a force, and not an average.
#[pyfunction]
pub(crate) fn is_extensive(name: &str, unit: &str) -> PyResult<bool> {
    Ok(Channel::new(name, unit).map_err(error)?.quantity == Quantity::Extensive)
}

/// An argument as an array of real numbers, or an error that names it.
#[pyfunction]
pub(crate) fn as_floats<'py>(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    Ok(floats(name, value)?.as_array().to_owned().into_pyarray(value.py()))
}

/// An argument as an array of `count` whole numbers from 0 on, or an error that names it.
#[pyfunction]
pub(crate) fn as_numbers<'py>(
    name: &str,
    value: &Bound<'py, PyAny>,
    count: usize,
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
    presses: i64,
    touches: i64,
    radius: f64,
    depth: f64,
    stiffness: f64,
    roll: f64,
    duration: f64,
    pause: f64,
    rate: f64,
    taxel_radius: f64,
    extensive: bool,
    noise: f64,
    drift: f64,
    dead: f64,
    seed: u64,
) -> PyResult<Bound<'py, PyDict>> {
    let skin = match (skin.cast::<PySkin>(), skin.cast::<PyMap>()) {
        (Ok(skin), _) => Arc::clone(&skin.get().skin),
        (_, Ok(map)) => Arc::new(map.get().map.skin()),
        _ => return Err(bad("skin", skin.get_type().name()?, "a Skin or a Map")),
    };
    let options = TouchOptions {
        radius,
        depth,
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
    };
    let names: Vec<String> = skin.patches.iter().map(|patch| patch.name.clone()).collect();
    let made = run(py, 0, move |stop| -> Result<(Readings, Vec<Touch>), dermatome::Error> {
        let mut simulation = TouchSimulation::new(&skin, &options)?;
        let taxels = skin.patches.iter().map(|patch| &patch.taxels.ids);
        let ids: Vec<TaxelId> = taxels.flat_map(|ids| ids.iter().copied()).collect();
        let channels = vec![simulation.channel().clone()];
        let mut recording = Readings { width: ids.len(), channels, ids: Some(ids), ..Readings::default() };
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
