//! `Renderer`, `ContactTracker`, `read_readings` and `touch`: values on taxels, and images of them.

use std::{
    collections::HashSet,
    path::PathBuf,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use dermatome::{
    SkinMap,
    atlas::{Atlas, AtlasOptions, Chart, Pack, Resolution},
    contact::{ContactError, MapPlace},
    id::VertexId,
    image::{BatchRenderer, Interpolation, RenderOptions, Renderer},
    io::{Readings, ReadingsLayout, ReadingsReader, SummaryCell, summary_rows},
    pyramid::LevelId,
    recording::{Fill, Recording, RecordingOptions},
    signal::{
        Channel, ConditionOptions, ContactEvent, ContactRegion, ContactTracker, Duplicates, Frame, Join,
        Probe, Quantity, Response, Restrictor, Summary, Touch, TouchOptions, TouchSimulation, TrackerOptions,
        TrackerState, Zero,
    },
    skin::{PatchId, Presence, TaxelId},
};
use glam::DVec2;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::{
    exceptions::PyTypeError,
    prelude::*,
    types::{PyDict, PyList},
};
use rayon::prelude::*;

use crate::{
    arrays::{
        Reals, Reduced, bad_shape, floats, made_by, matrix, one_each, one_number_each, reals, shaped, vector,
        zeros,
    },
    errors::{bad, error},
    index::PyHits,
    jobs::{Stop, run, run_here},
    map::{PyMap, mask_too_large, starts},
    matrix::{PyMatrix, Rows},
    options::{Extensive, channels, count, level, positive, probe, word},
    response::PyResponse,
    skin::PySkin,
};

/// Draws frames of readings as tactile images of one level: `renderer(values, threads=0)`.
///
/// Made by `Map.renderer`. `values` are readings in the order of the map, NaN where there is none: (..., C, N), or (N,) and
/// (T, N) of one channel. The images are a float32 array (..., C, H, W), or (1, H, W) and (T, 1, H, W), the first row on
/// top; C + 1 channels with `mask`. They are `fill` (NaN by default) where nothing is known; amounts, as forces, are drawn
/// per m^2 of the map. `threads` is 0 for one per processor. Images are those of `dermatome render`, in any batch and with
/// any number of threads. A renderer never changes; it is pickled as its map and its options.
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
    map: Py<PyMap>,
    args: RenderArgs,
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
    /// Channels that are drawn at once.
    channels: usize,
    fill: f32,
    has_mask: bool,
    level: LevelId,
    /// Where the values of each patch begin among those of the level.
    starts: Vec<usize>,
    charts: Vec<Chart>,
    /// What each pixel shows: a patch, and the nearest vertex of its level.
    shown: Vec<Option<(PatchId, VertexId)>>,
}

impl Plan {
    /// Draws readings, `parts` frames of them for each image.
    fn draw<T: Copy + Into<f64> + Sync>(&self, values: &[T], images: &mut [f32], parts: usize, stop: &Stop) {
        let (pixels, width) = (self.shown.len(), self.channels * self.taxels);
        let drawn = parts * self.channels * pixels;
        let size = drawn + if self.has_mask { pixels } else { 0 };
        if images.is_empty() || parts == 0 {
            return;
        }
        let share = (images.len() / size).div_ceil(4 * rayon::current_num_threads()).max(1);
        images.par_chunks_mut(share * size).zip(values.par_chunks(share * parts * width)).for_each_init(
            || {
                let Self { restrictor, renderer, frame, .. } = self;
                (BatchRenderer::new(restrictor.clone(), renderer.clone(), frame.clone()), Vec::new())
            },
            |(batch, bare), (images, values)| {
                let fill = |k: usize, frame: &mut Frame| {
                    stop.check();
                    self.join.fill(&values[k * width..(k + 1) * width], frame);
                    mask_too_large(frame);
                };
                // Infinite is what overflows.
                let known = |x: f32| if x.is_finite() { x } else { self.fill };
                if !self.has_mask {
                    batch.render(fill, images);
                    images.iter_mut().for_each(|x| *x = known(*x));
                    return;
                }
                bare.resize(images.len() / size * drawn, 0.0);
                batch.render(fill, bare);
                for (image, bare) in images.chunks_mut(size).zip(bare.chunks(drawn)) {
                    let (image, mask) = image.split_at_mut(drawn);
                    image.iter_mut().zip(bare).for_each(|(x, &bare)| *x = known(bare));
                    for (pixel, is_known) in mask.iter_mut().enumerate() {
                        let all = bare.iter().skip(pixel).step_by(pixels).all(|x| x.is_finite());
                        *is_known = f32::from(u8::from(all));
                    }
                }
            },
        );
    }
}

/// The most numbers of an image: a GiB.
const MOST_NUMBERS: usize = 1 << 28;

/// How images are drawn, from arguments.
#[derive(Debug, Clone)]
pub(crate) struct RenderArgs {
    pub(crate) level: i64,
    pub(crate) patch: Option<String>,
    pub(crate) channels: Option<i64>,
    pub(crate) extensive: Extensive,
    pub(crate) interpolate: String,
    pub(crate) size: Option<[u32; 2]>,
    pub(crate) pixel: Option<f64>,
    pub(crate) pack: Option<Pack>,
    pub(crate) fill: Option<f32>,
    pub(crate) mask: bool,
}

impl RenderArgs {
    /// How many channels readings have, if that is given.
    fn channels(&self) -> PyResult<Option<usize>> {
        let count = match (self.channels, &self.extensive) {
            (Some(given), _) => self::count("channels", given)?,
            (None, Extensive::Each(all)) => all.len(),
            (None, Extensive::All(_)) => return Ok(None),
        };
        if (1..=MOST_NUMBERS).contains(&count) {
            Ok(Some(count))
        } else {
            Err(bad("channels", count, "1 or more"))
        }
    }
}

impl PyRenderer {
    pub(crate) fn new(of: &Bound<'_, PyMap>, args: RenderArgs) -> PyResult<Self> {
        let (py, map) = (of.py(), of.get());
        let level = level("level", args.level, map.levels())?;
        let patch = match &args.patch {
            Some(_) if args.pack.is_some() => return Err(bad("patch", "patch and pack", "one of the two")),
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
        let extensive = args.extensive.of_channels(args.channels()?)?;
        let count = extensive.len();
        let known = [("linear", Interpolation::Linear), ("nearest", Interpolation::Nearest)];
        let interpolation = word("interpolate", &args.interpolate, &known)?;
        let resolution = match (args.size, args.pixel) {
            (None, None) => Resolution::Map,
            (Some(size), None) => Resolution::Canvas(size),
            (None, Some(side)) => Resolution::Pixel(positive("pixel", side)?),
            (Some(_), Some(_)) => return Err(bad("pixel", "size and pixel", "one of the two")),
        };
        let options = AtlasOptions { resolution, pack: args.pack };
        let (map, fill, has_mask) = (Arc::clone(&map.map), args.fill.unwrap_or(f32::NAN), args.mask);
        let plan = run(py, 0, move |_| -> Result<Option<Plan>, dermatome::Error> {
            let mut atlas = Atlas::new(&map, &options)?;
            let of_patch = |chart: &Chart| patch.is_none_or(|patch| chart.patch == patch);
            atlas.parts.retain(|part| part.level == level && part.charts.iter().any(of_patch));
            let taxels: usize = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
            let pixels = |[width, height]: [u32; 2]| width as usize * height as usize;
            let size = atlas.parts.first().map(|part| pixels(part.frame.size_px).max(taxels));
            if size.is_none_or(|size| size.saturating_mul(count) > MOST_NUMBERS) {
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
                has_mask,
                level,
                starts: starts(&map, level),
                shown: atlas.parts[0].vertices(&map),
                charts: std::mem::take(&mut atlas.parts[0].charts),
            }))
        })?;
        let needed = "a level that the patch has, and images of less than 2^28 numbers";
        let found = || format!("level {}, {count} channels", args.level);
        let plan = plan.map_err(error)?.ok_or_else(|| bad("renderer", found(), needed))?;
        let frame = plan.renderer.images()[0].frame;
        let [width, height] = frame.size_px;
        let pixel = (frame.size.y / f64::from(height), frame.size.x / f64::from(width));
        let shape = (height as usize, width as usize);
        Ok(Self { plan: Arc::new(plan), map: of.clone().unbind(), args, shape, pixel })
    }

    fn map(&self) -> &SkinMap {
        &self.map.get().map
    }

    /// An array (H, W) of what each pixel shows.
    fn pixels<'py, T: numpy::Element + Clone>(
        &self,
        py: Python<'py>,
        none: T,
        of: impl Fn(PatchId, VertexId) -> T,
    ) -> PyResult<Bound<'py, PyArray2<T>>> {
        let all = self.plan.shown.iter();
        let of = |shown: &Option<(PatchId, VertexId)>| shown.map_or_else(|| none.clone(), |(p, v)| of(p, v));
        shaped(py, [self.shape.0, self.shape.1], all.map(of).collect())
    }
}

#[pymethods]
impl PyRenderer {
    /// Draw frames of readings.
    #[pyo3(signature = (values, *, threads=0))]
    fn __call__<'py>(
        &self,
        py: Python<'py>,
        values: &Bound<'py, PyAny>,
        threads: i64,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let Plan { taxels, channels: at_once, has_mask, .. } = *self.plan;
        let values = reals("values", values)?;
        let given = self.args.channels()?;
        let (frames, channels) = match (values.shape(), given) {
            (&[ref frames @ .., n], None | Some(1)) if frames.len() < 2 && n == taxels => (frames, 1),
            (&[ref frames @ .., c, n], None) if n == taxels => (frames, c),
            (&[ref frames @ .., c, n], Some(given)) if (c, n) == (given, taxels) => (frames, c),
            (shape, given) => {
                let channels = given.map_or("C".to_owned(), |given| given.to_string());
                return Err(bad_shape("values", shape, format!("shape (..., {channels}, {taxels})")));
            }
        };
        let image = [channels + usize::from(has_mask), self.shape.0, self.shape.1];
        let images = zeros(py, &[frames, &image].concat())?;
        let (mut drawn, threads, parts) =
            (images.readwrite(), count("threads", threads)?, channels / at_once);
        let drawn = drawn.as_slice_mut()?;
        match &values {
            Reals::Single(values) => {
                let values = values.as_slice()?;
                run_here(py, threads, |stop| self.plan.draw(values, drawn, parts, stop))?;
            }
            Reals::Double(values) => {
                let values = values.as_slice()?;
                run_here(py, threads, |stop| self.plan.draw(values, drawn, parts, stop))?;
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

    /// (H, W) int32 array: Number of the patch that each pixel shows; -1 where there is none.
    #[getter]
    fn patch<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i32>>> {
        self.pixels(py, -1, |patch, _| patch.raw() as i32)
    }

    /// (H, W) int64 array: The field nearest to each pixel, a number among those of the level of the whole map
    /// (`Map.fields`); on level 0 the taxel. -1 where there is none.
    #[getter]
    fn field<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        self.pixels(py, -1, |patch, vertex| (self.plan.starts[patch.index()] + vertex.index()) as i64)
    }

    /// (H, W) uint32 array: Id of the taxel nearest to each pixel, above level 0 the number of the field in its patch;
    /// 4294967295 where there is none.
    #[getter]
    fn taxel_id<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        self.pixels(py, u32::MAX, |patch, vertex| {
            let patch = &self.map().patches[patch];
            let is_taxel = patch.nearest_level(self.plan.level) == LevelId::default();
            if is_taxel { patch.taxels.ids[vertex].0 } else { vertex.raw() }
        })
    }

    /// (H, W) int32 array: Number of the named region in `Map.regions` of the field nearest to each pixel, -1 for none.
    #[getter]
    fn region<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i32>>> {
        let regions = self.map.get().field_regions();
        self.pixels(py, -1, |patch, vertex| {
            let level = self.map().patches[patch].nearest_level(self.plan.level);
            regions.region(patch, level, vertex).map_or(-1, |region| region.raw() as i32)
        })
    }

    /// list of dict: Where each patch lies in the image: `patch`, its name, and `level`; `corner`, row and column of its
    /// upper left pixel, and `shape`, height and width in pixels; `origin`, the lower left corner of that rectangle in m
    /// on the map turned by `angle` (rad, counter-clockwise), and `size`, height and width in m.
    #[getter]
    fn charts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let charts = PyList::empty(py);
        for chart in &self.plan.charts {
            let about = PyDict::new(py);
            about.set_item("patch", &self.map().patches[chart.patch].name)?;
            about.set_item("level", chart.level.index())?;
            let ([column, row], [width, height]) = (chart.corner_px, chart.frame.size_px);
            about.set_item("corner", (row, column))?;
            about.set_item("shape", (height, width))?;
            about.set_item("origin", (chart.frame.origin.x, chart.frame.origin.y))?;
            about.set_item("size", (chart.frame.size.y, chart.frame.size.x))?;
            about.set_item("angle", f64::from(chart.turns) * std::f64::consts::FRAC_PI_4)?;
            charts.append(about)?;
        }
        Ok(charts)
    }

    /// Find where points of the skin are in the images.
    ///
    /// Parameters
    /// ----------
    /// hits : Hits
    ///     The points, found with the level of this renderer: `index.locate(points, level=...)`.
    ///
    /// Returns
    /// -------
    /// (k, 2) float64 array
    ///     Row and column, whole at the centres of pixels: `numpy.rint` gives the pixel. NaN for a query without an
    ///     answer and for patches that are not drawn.
    ///
    /// Examples
    /// --------
    /// >>> import dermatome
    /// >>> palm = dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(12) for x in range(12)])
    /// >>> skin_map = dermatome.build(palm)
    /// >>> renderer, hits = skin_map.renderer(size=(32, 32)), skin_map.index().locate(palm.positions[40:43])
    /// >>> rows, columns = renderer.pixels(hits).T
    /// >>> patch, points, normals, off_chart = renderer.to_skin(rows, columns)
    /// >>> bool(abs(points - hits.point).max() < 1e-9)
    /// True
    #[pyo3(name = "pixels")]
    fn pixels_of<'py>(
        &self,
        py: Python<'py>,
        hits: &Bound<'py, PyHits>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (hits, wanted) = (hits.get(), self.plan.level.index());
        let refuse =
            |found: String| bad("hits", found, format!("hits on the map: locate(..., level={wanted})"));
        let (Some(levels), Some(uv)) = (&hits.level, &hits.uv) else {
            return Err(refuse("hits without places".into()));
        };
        let (patches, levels, uv) =
            (hits.patch.bind(py).readonly(), levels.bind(py).readonly(), uv.bind(py).readonly());
        let places = patches.as_slice()?.iter().zip(levels.as_slice()?).zip(uv.as_slice()?.as_chunks().0);
        let mut found = Vec::with_capacity(patches.len());
        for (k, ((&patch, &level), &at)) in places.enumerate() {
            let charts = self.plan.charts.iter();
            let chart = usize::try_from(patch)
                .ok()
                .and_then(|patch| charts.clone().find(|c| c.patch.index() == patch));
            found.push(match chart {
                Some(chart) if usize::try_from(level) != Ok(chart.level.index()) => {
                    return Err(refuse(format!("level {level} of hit {k}")));
                }
                Some(chart) => {
                    let at = chart.image_position(DVec2::from_array(at));
                    [at.y, at.x]
                }
                None => [f64::NAN; 2],
            });
        }
        matrix(py, found)
    }

    /// Find the points of the skin that are at places of the images.
    ///
    /// Parameters
    /// ----------
    /// rows, columns : (k,) array_like
    ///     Row (from the top) and column of each place, whole at the centres of pixels.
    ///
    /// Returns
    /// -------
    /// patch : (k,) int32 array
    ///     Number of the patch.
    /// points : (k, 3) float64 array
    ///     In m, in the frame of the patch's link: on level 0 of the skin, above on the mesh of the level.
    /// normals : (k, 3) float64 array
    ///     Outward unit normals there.
    /// off_chart : (k,) float64 array
    ///     How far outside of all maps the place is, in m; the point is then that of the nearest place of one.
    fn to_skin<'py>(
        &self,
        py: Python<'py>,
        rows: &Bound<'py, PyAny>,
        columns: &Bound<'py, PyAny>,
    ) -> PyResult<OnSkin<'py>> {
        let rows = floats("rows", rows)?;
        let rows = one_each("rows", rows.as_any(), rows.len())?;
        let columns = one_each("columns", columns, rows.len())?;
        for (name, all) in [("rows", &rows), ("columns", &columns)] {
            if let Some(k) = all.iter().position(|x| x.is_nan() || x.abs() >= LARGEST_PLACE) {
                return Err(bad(&format!("{name}[{k}]"), all[k], "a place near the image"));
            }
        }
        let (plan, back, width) = (Arc::clone(&self.plan), self.map.get().back(py)?, self.shape.1);
        let found = run(py, 0, move |stop| -> Result<Vec<MapPlace>, ContactError> {
            let mut places = Vec::new();
            let mut nearest = |(&row, &column): (&f64, &f64)| {
                stop.check();
                places.clear();
                // On the image the chart that the pixel shows, elsewhere the nearest one.
                let pixel = (row.round().max(-1.0), column.round().max(-1.0));
                let is_inside = pixel.0 >= 0.0 && pixel.1 >= 0.0 && pixel.1 < width as f64;
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "whole, 0 or more"
                )]
                let shown = is_inside.then(|| plan.shown.get(pixel.0 as usize * width + pixel.1 as usize));
                let shown = shown.flatten().copied().flatten().map(|(patch, _)| patch);
                for chart in plan.charts.iter().filter(|chart| shown.is_none_or(|shown| shown == chart.patch))
                {
                    back.places(
                        chart.patch,
                        chart.level,
                        chart.map_position(DVec2::new(column, row)),
                        &mut places,
                    )?;
                }
                let first =
                    places.iter().copied().reduce(|a, b| if b.off_chart < a.off_chart { b } else { a });
                first.ok_or(ContactError::NoSkin)
            };
            rows.iter().zip(&columns).map(&mut nearest).collect()
        })?;
        let found = found.map_err(error)?;
        Ok((
            vector(py, found.iter().map(|place| place.patch.raw() as i32)),
            matrix(py, found.iter().map(|place| place.position.to_array()))?,
            matrix(py, found.iter().map(|place| place.normal.to_array()))?,
            vector(py, found.iter().map(|place| place.off_chart)),
        ))
    }

    /// Write a recording as a video or an animation. Needs the package imageio, for videos with ffmpeg.
    ///
    /// Parameters
    /// ----------
    /// values : (T, N) or (T, C, N) array_like
    ///     Readings, as for the images.
    /// path : str or os.PathLike
    ///     `.mp4`, `.gif` or another kind that imageio writes.
    /// channel : int
    ///     The channel that is shown.
    /// rate : float
    ///     Frames per second.
    /// range : (2,) sequence of float, optional
    ///     Values at the ends of the scale of colours; by default the smallest and the largest, from 0 on if none is
    ///     negative.
    /// magnification : int
    ///     Pixels of the video for each pixel of the images, in each direction.
    #[pyo3(signature = (values, path, *, channel=0, rate=30.0, range=None, magnification=4))]
    fn video(
        slf: &Bound<'_, Self>,
        values: &Bound<'_, PyAny>,
        path: PathBuf,
        channel: i64,
        rate: f64,
        range: Option<[f64; 2]>,
        magnification: i64,
    ) -> PyResult<()> {
        let numbers = (
            count("channel", channel)?,
            positive("rate", rate)?,
            count("magnification", magnification)?.max(1),
        );
        slf.py().import("dermatome._shown")?.call_method1("video", (slf, values, path, numbers, range))?;
        Ok(())
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

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        let RenderArgs { level, patch, channels, extensive, interpolate, size, pixel, pack, fill, mask } =
            &self.args;
        let options = PyDict::new(py);
        options.set_item("level", level)?;
        options.set_item("patch", patch)?;
        options.set_item("channels", channels)?;
        match extensive {
            Extensive::All(one) => options.set_item("extensive", one)?,
            Extensive::Each(all) => options.set_item("extensive", all)?,
        }
        options.set_item("interpolate", interpolate)?;
        options.set_item("size", size)?;
        options.set_item("pixel", pixel)?;
        options.set_item("pack", pack.map(|pack| if pack == Pack::Body { "body" } else { "tight" }))?;
        options.set_item("fill", fill)?;
        options.set_item("mask", mask)?;
        made_by(py, "renderer", (self.map.clone_ref(py), options))
    }

    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    fn __repr__(&self) -> String {
        format!("<dermatome.Renderer: {} x {} pixels>", self.shape.0, self.shape.1)
    }
}

/// Patches, points, normals and distances from the maps.
type OnSkin<'py> = (
    Bound<'py, PyArray1<i32>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
);

/// Rows and columns are less, beyond any image.
const LARGEST_PLACE: f64 = 1e9;

/// Finds what touches the skin in frames of readings, and follows it from frame to frame.
///
/// Parameters
/// ----------
/// map : Map
///     The map.
/// unit : str
///     Unit of the readings, as "Pa" or "N"; forces are known for units of pressure and force.
/// probe : str
///     What touches the skin: "any", or "finger" for fingers side by side. A tracker of fingers cannot be pickled.
/// threshold : float, optional
///     A contact has a taxel above this, in the unit of the readings; by default estimated from the first frames,
///     in which nothing should touch the skin.
/// low : float, optional
///     Its other taxels are above this share of the threshold; by default 0.5, of fingers 0.625.
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
///
/// Two taxels next to the same taxel without a reading (NaN) count as neighbours, so that a dead taxel does not cut a
/// contact in two. A tracker that is pickled or copied goes on with what it has learned and follows.
#[pyclass(frozen, module = "dermatome", name = "ContactTracker")]
#[derive(Debug)]
pub(crate) struct PyContactTracker {
    tracker: Mutex<(ContactTracker, Frame)>,
    join: Join,
    taxels: usize,
    map: Py<PyMap>,
    unit: String,
    options: TrackerOptions,
}

#[pymethods]
impl PyContactTracker {
    #[new]
    #[pyo3(signature = (map, *, unit="Pa", probe="any", threshold=None, low=None, least=2, prominence=0.4, part=4,
        noise_frames=5, reach=0.01, lasting=1))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn new(
        map: &Bound<'_, PyMap>,
        unit: &str,
        probe: &str,
        threshold: Option<f64>,
        low: Option<f64>,
        least: i64,
        prominence: f64,
        part: i64,
        noise_frames: i64,
        reach: f64,
        lasting: i64,
    ) -> PyResult<Self> {
        let (of, map) = (map, &map.get().map);
        let probe = self::probe(probe)?;
        let options = TrackerOptions {
            probe,
            channel: 0,
            threshold,
            low: low.unwrap_or(probe.low()),
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
        let tracker = Mutex::new((tracker, Frame::new(map, 1)));
        Ok(Self { tracker, join, taxels, map: of.clone().unbind(), unit: unit.to_owned(), options })
    }

    /// Find the contacts of the next frame.
    ///
    /// Parameters
    /// ----------
    /// values : (N,) array_like
    ///     Readings in the order of the map; NaN where there is none.
    /// time : float, optional
    ///     Time of the frame, in s; without times frames count as 0.1 s apart, for `probe="finger"` and `at_once`.
    ///
    /// Returns
    /// -------
    /// list of dict
    ///     For each contact its `track`, `event` ("onset", "move" or "release"), `age`, `patch`, `link`, `taxels`,
    ///     `area` (m^2), `force` (N), `centre` and `normal` (m, frame of the link), `uv` (m on the map), `major`,
    ///     `minor` (m), `angle` (rad), `peak_taxel` and `peak`.
    #[pyo3(signature = (values, time=None))]
    fn track<'py>(
        &self,
        py: Python<'py>,
        values: &Bound<'py, PyAny>,
        time: Option<f64>,
    ) -> PyResult<Bound<'py, PyList>> {
        let values = floats("values", values)?;
        if values.shape() != [self.taxels] {
            return Err(bad_shape("values", values.shape(), format!("shape ({},)", self.taxels)));
        }
        let values = values.as_slice()?.to_vec();
        let regions = py.detach(|| {
            let (tracker, frame) = &mut *self.lock();
            self.join.fill(&values, frame);
            frame.time = time.unwrap_or(f64::NAN);
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
        self.lock().0.threshold()
    }

    /// int: How many contacts the strongest touch so far had at once, voted over its frames.
    #[getter]
    fn at_once(&self) -> usize {
        self.lock().0.at_once()
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        if self.options.probe == Probe::Finger {
            return Err(PyTypeError::new_err("cannot pickle a ContactTracker of fingers: it follows zeros"));
        }
        let TrackerState { threshold, learned, rest, contacts, next } = self.lock().0.state();
        let state = PyDict::new(py);
        state.set_item("threshold", threshold)?;
        state.set_item("learned", vector(py, learned))?;
        state.set_item("rest", vector(py, rest))?;
        let contacts =
            contacts.iter().map(|region| self.contact(py, region)).collect::<PyResult<Vec<_>>>()?;
        state.set_item("contacts", contacts)?;
        state.set_item("next", next)?;
        let TrackerOptions {
            probe: _,
            channel: _,
            threshold,
            low,
            least,
            prominence,
            part,
            noise_frames,
            reach,
            lasting,
        } = self.options;
        let options = PyDict::new(py);
        options.set_item("unit", &self.unit)?;
        options.set_item("threshold", threshold)?;
        options.set_item("low", low)?;
        options.set_item("least", least)?;
        options.set_item("prominence", prominence)?;
        options.set_item("part", part)?;
        options.set_item("noise_frames", noise_frames)?;
        options.set_item("reach", reach)?;
        options.set_item("lasting", lasting)?;
        made_by(py, "tracker", (self.map.clone_ref(py), options, state))
    }

    fn _resume(&self, state: &Bound<'_, PyDict>) -> PyResult<()> {
        fn item<'py, T: FromPyObjectOwned<'py>>(of: &Bound<'py, PyDict>, name: &str) -> PyResult<T> {
            let found = of
                .get_item(name)?
                .ok_or_else(|| bad("state", format!("no {name:?}"), "that of a tracker"))?;
            found.extract().map_err(Into::into)
        }
        let numbers = |of: &Bound<'_, PyDict>, name| -> PyResult<Vec<f64>> {
            let array: Bound<'_, PyAny> = item(of, name)?;
            one_each(name, &array, array.len()?)
        };
        let vertices = |of: &Bound<'_, PyDict>| -> PyResult<Vec<VertexId>> {
            Ok(item::<Vec<u32>>(of, "taxels")?.into_iter().map(VertexId::from).collect())
        };
        let map = self.map.get();
        let region = |contact: &Bound<'_, PyDict>| -> PyResult<ContactRegion> {
            let patch = map.patch_named(&item::<String>(contact, "patch")?)?;
            let event: String = item(contact, "event")?;
            Ok(ContactRegion {
                track: item(contact, "track")?,
                event: word(
                    "event",
                    &event,
                    &[("onset", ContactEvent::Onset), ("move", ContactEvent::Move)],
                )?,
                age: item(contact, "age")?,
                patch,
                link: map.map.patches[patch].link,
                taxels: vertices(contact)?,
                area: item(contact, "area")?,
                force: item(contact, "force")?,
                centre: item::<[f64; 3]>(contact, "centre")?.into(),
                normal: item::<[f64; 3]>(contact, "normal")?.into(),
                map: item::<[f64; 2]>(contact, "uv")?.into(),
                major: item(contact, "major")?,
                minor: item(contact, "minor")?,
                angle: item(contact, "angle")?,
                peak_taxel: VertexId::from(item::<u32>(contact, "peak_taxel")?),
                peak: item(contact, "peak")?,
            })
        };
        let contacts: Vec<Bound<'_, PyDict>> = item(state, "contacts")?;
        let state = TrackerState {
            threshold: item(state, "threshold")?,
            learned: numbers(state, "learned")?,
            rest: numbers(state, "rest")?,
            contacts: contacts.iter().map(region).collect::<PyResult<_>>()?,
            next: item(state, "next")?,
        };
        self.lock().0.resume(state).map_err(error)
    }

    fn __repr__(&self) -> String {
        let (tracker, _) = &*self.lock();
        let threshold =
            tracker.threshold().map_or("not known yet".to_owned(), |x| format!("{x} {}", self.unit));
        format!("<dermatome.ContactTracker: {} contacts, threshold {threshold}>", tracker.contacts().len())
    }
}

impl PyContactTracker {
    fn lock(&self) -> MutexGuard<'_, (ContactTracker, Frame)> {
        self.tracker.lock().unwrap_or_else(PoisonError::into_inner)
    }

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
        let map = &self.map.get().map;
        contact.set_item("patch", &map.patches[region.patch].name)?;
        contact.set_item("link", &map.links[region.link].name)?;
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

/// Readings of columns with these ids as readings of the taxels of a map, (T, C, n) to (T, C, N), and how they fit.
#[pyfunction]
pub(crate) fn join_readings<'py>(
    py: Python<'py>,
    map: &Bound<'py, PyMap>,
    values: &Bound<'py, PyAny>,
    ids: &Bound<'py, PyAny>,
) -> PyResult<(Bound<'py, PyAny>, Vec<String>)> {
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
    Ok((shaped(py, [frames, channels, taxels], joined)?.into_any(), join.report().remarks()))
}

/// The arrays of a recording on the taxels of a map: values (T, C, N), timestamps, names of channels, units.
pub(crate) type RecordingArrays<'a, 'py> =
    (&'a Bound<'py, PyAny>, &'a Bound<'py, PyAny>, Vec<String>, Vec<String>);

pub(crate) fn readings_of(
    (values, timestamps, channels, units): RecordingArrays<'_, '_>,
) -> PyResult<Readings> {
    let values = floats("values", values)?;
    let needed = [timestamps.len()?, channels.len(), units.len()];
    let &[frames, of_channels, width] = values.shape() else {
        return Err(bad_shape("values", values.shape(), "shape (T, C, N)"));
    };
    if [frames, of_channels, of_channels] != needed {
        let [frames, channels, _] = needed;
        return Err(bad_shape("values", values.shape(), format!("shape ({frames}, {channels}, N)")));
    }
    let channel = |(name, unit)| Channel { name, unit, ..Channel::default() };
    Ok(Readings {
        ids: None,
        channels: channels.into_iter().zip(units).map(channel).collect(),
        width,
        times: one_each("timestamps", timestamps, frames)?,
        values: values.as_slice()?.to_vec(),
    })
}

/// Readings (T, C, N) of the taxels of a map, made comparable: the arrays of a recording with values (T, C, N);
/// `measured`, which of these are readings and not filled; and `remarks`. `ids` are those of the columns that the readings
/// had before they were joined to the map: other taxels have none, which is no remark.
#[pyfunction]
#[pyo3(signature = (map, values, ids, timestamps, channels, units, *, baseline=0, zero=None, gains=Vec::new(),
    response=None, clip=None, split_hz=None, fill="none"))]
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
    zero: Option<&str>,
    gains: Vec<(u32, f64)>,
    response: Option<&Bound<'py, PyResponse>>,
    clip: Option<[f64; 2]>,
    split_hz: Option<f64>,
    fill: &str,
) -> PyResult<Bound<'py, PyDict>> {
    let fill = word("fill", fill, &[("none", Fill::None), ("neighbours", Fill::Neighbours)])?;
    let readings = readings_of((values, timestamps, channels, units))?;
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
        Ok((out, measured, report.remarks(zero)))
    })?;
    let (readings, measured, remarks) = made.map_err(error)?;
    let measured = shaped(py, [readings.times.len(), readings.channels.len(), readings.width], measured)?;
    let conditioned = arrays(py, readings)?;
    conditioned.set_item("measured", measured)?;
    conditioned.set_item("remarks", remarks)?;
    Ok(conditioned)
}

/// The sums of readings (T, N) of one channel in the order of a map: a dict for each group, the threshold, and the number of
/// gaps. Without a threshold it is estimated from the first frames, whose mean is subtracted.
#[pyfunction]
#[pyo3(signature = (map, values, timestamps, channel, unit, *, threshold=None))]
pub(crate) fn summarise_readings<'py>(
    py: Python<'py>,
    map: &Bound<'py, PyMap>,
    values: &Bound<'py, PyAny>,
    timestamps: &Bound<'py, PyAny>,
    channel: &str,
    unit: &str,
    threshold: Option<f64>,
) -> PyResult<(Bound<'py, PyList>, Option<f64>, usize)> {
    let values = floats("values", values)?;
    let &[frames, width] = values.shape() else {
        return Err(bad_shape("values", values.shape(), "shape (T, N)"));
    };
    let readings = Readings {
        ids: None,
        channels: vec![Channel::new(channel, unit).map_err(error)?],
        width,
        times: one_each("timestamps", timestamps, frames)?,
        values: values.as_slice()?.to_vec(),
    };
    // Contacts need a threshold above 0.
    let threshold = threshold.map(|x| if x == 0.0 { f64::MIN_POSITIVE } else { x });
    let map = Arc::clone(&map.get().map);
    let made = run(py, 0, move |stop| -> Result<_, dermatome::Error> {
        let mut recording =
            Recording::open(&map, ReadingsReader::memory(readings)?, &RecordingOptions::default())?;
        recording.summarise(&TrackerOptions { threshold, ..recording.tracker_options(0) })?;
        while recording.next_step()?.is_some() {
            stop.check();
        }
        let summary = recording.summary();
        let rows = summary.map_or_else(Vec::new, |summary| summary_rows(&map, summary));
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
