//! `Renderer`: readings as tactile images of a level.

use std::{
    path::PathBuf,
    sync::{Arc, OnceLock},
};

use dermatome::{
    SkinMap,
    atlas::{Atlas, AtlasOptions, AtlasPart, Pack, Resolution},
    contact::{ContactError, MapPlace},
    id::{IdVec, VertexId},
    image::Renderer,
    io::share_plane,
    pyramid::LevelId,
    recording::{Batch, BatchImages, Carried},
    signal::Quantity,
    skin::PatchId,
};
use glam::DVec2;
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::{
    prelude::*,
    types::{PyDict, PyList, PyTuple},
};

use crate::{
    arguments::{arg, object},
    arrays::{
        Reals, Reduced, bad_shape, floats, made_by, map_frame, matrix, one_each, reals, shaped, vector, zeros,
    },
    errors::{bad, error},
    hits::PyHits,
    jobs::{Stop, run, run_here},
    map::PyMap,
    matrix::{PyMatrix, Rows},
    options::{PerChannel, channel, count, level, positive, quantity},
    pool::starts,
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
    /// The map whose canvas it draws on, if that is another one.
    canvas: Option<Py<PyMap>>,
    args: RenderArgs,
    /// tuple of int: Height and width of the images, in pixels.
    #[pyo3(get)]
    shape: (usize, usize),
    /// tuple of float: Height and width of a pixel, in m on the map.
    #[pyo3(get)]
    pixel: (f64, f64),
    /// Of each channel, whether it is an amount.
    extensive: Vec<bool>,
}

/// What draws a frame, before the first one.
#[derive(Debug)]
struct Plan {
    batch: Batch,
    renderer: Renderer,
    taxels: usize,
    /// Channels that are drawn at once.
    channels: usize,
    fill: f32,
    has_mask: bool,
    level: LevelId,
    /// Where the values of each patch begin among those of the level.
    starts: Vec<usize>,
    part: AtlasPart,
    shown: OnceLock<Shown>,
    taxel_ids: OnceLock<Vec<u32>>,
}

/// What each pixel shows: a patch, and the nearest vertex of its level.
type Shown = Vec<Option<(PatchId, VertexId)>>;

impl Plan {
    /// What each pixel shows; found when it is first asked for.
    fn shown(&self, map: &SkinMap) -> &Shown {
        self.shown.get_or_init(|| self.part.vertices(map))
    }

    /// Which values of the level readings of a channel ever have: for each patch one for each vertex, NaN for none.
    fn present(&self, map: &SkinMap, channel: usize) -> IdVec<PatchId, IdVec<VertexId, f64>> {
        let mut batch = self.batch.clone();
        let values = batch.levels(&vec![0.0; self.channels * self.taxels]).values.enumerate();
        values.map(|(patch, of)| of[channel][map.patches[patch].nearest_level(self.level)].clone()).collect()
    }

    /// The matrix of a channel, row by row.
    fn rows(
        &self,
        quantity: Quantity,
        present: Option<&IdVec<PatchId, IdVec<VertexId, f64>>>,
        stop: &Stop,
    ) -> Rows {
        let [width, height] = self.part.frame.size_px.map(|n| n as usize);
        let mut pixels = vec![Vec::new(); width * height];
        let is_live = |patch, v| present.is_none_or(|present| !present[patch][v].is_nan());
        self.renderer.each_pixel(0, quantity, is_live, |patch, pixel, weights| {
            stop.check();
            let start = self.starts[patch.index()];
            let kept = weights.iter().filter(|(_, w)| present.is_none() || *w != 0.0);
            pixels[pixel as usize].extend(kept.map(|&(v, w)| (start + v as usize, w)));
        });
        let mut rows = Rows::new();
        pixels.into_iter().for_each(|row| rows.push(row));
        rows
    }

    /// Draws readings, `parts` frames of them for each image.
    fn draw<T: Copy + Into<f64> + Sync>(&self, values: &[T], images: &mut [f32], parts: usize, stop: &Stop) {
        let how = BatchImages { parts, fill: self.fill, has_mask: self.has_mask };
        self.batch.draw(&self.renderer, values, images, how, || stop.check());
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
    pub(crate) extensive: PerChannel<bool>,
    pub(crate) modality: PerChannel<Option<String>>,
    pub(crate) size: Option<[u32; 2]>,
    pub(crate) pixel: Option<f64>,
    pub(crate) pack: Option<Pack>,
    pub(crate) fill: Option<f32>,
    pub(crate) mask: bool,
}

impl RenderArgs {
    /// How many channels readings have, if that is given.
    fn channels(&self) -> PyResult<Option<usize>> {
        let each = self.extensive.count().or(self.modality.count());
        let Some(count) = self.channels.map(|given| self::count("channels", given)).transpose()?.or(each)
        else {
            return Ok(None);
        };
        if (1..=MOST_NUMBERS).contains(&count) {
            Ok(Some(count))
        } else {
            Err(bad("channels", count, "1 or more"))
        }
    }
}

impl PyRenderer {
    /// Draws `of`, on the canvas of another map if there is one.
    pub(crate) fn new(of: &Bound<'_, PyMap>, args: RenderArgs, canvas: Option<Py<PyMap>>) -> PyResult<Self> {
        let (py, map) = (of.py(), of.get());
        let shown = canvas.as_ref().map_or(map, |canvas| canvas.get());
        let level = level("level", args.level, shown.levels())?;
        let patch = match &args.patch {
            Some(_) if args.pack.is_some() => return Err(bad("patch", "patch and pack", "one of the two")),
            Some(name) => Some(shown.patch_named(name)?),
            None if args.pack.is_some() || shown.map.patches.len() == 1 => None,
            None => {
                return Err(bad(
                    "patch",
                    format!("None of {}", shown.map.patches.len()),
                    "a name, or pack=\"tight\"",
                ));
            }
        };
        let count = args.channels()?.unwrap_or(1);
        let extensive = args.extensive.of_channels("extensive", count)?;
        let modalities = args.modality.of_channels("modality", count)?;
        let of_each = extensive.iter().zip(&modalities);
        let channels = of_each.map(|(&extensive, of)| channel(&map.map, extensive, of.as_deref()));
        let channels = channels.collect::<PyResult<Vec<_>>>()?;
        let resolution = match (args.size, args.pixel) {
            (None, None) => Resolution::Map,
            (Some(size), None) => Resolution::Canvas(size),
            (None, Some(side)) => Resolution::Pixel(positive("pixel", side)?),
            (Some(_), Some(_)) => return Err(bad("pixel", "size and pixel", "one of the two")),
        };
        let options = AtlasOptions { resolution, pack: args.pack };
        // A part is named by its patch, or alone in its level.
        let name = patch.map(|patch| format!("{}/L{level}", shown.map.patches[patch].name));
        let onto = canvas.as_ref().map(|canvas| Arc::clone(&canvas.get().map));
        let (map, fill, has_mask) = (Arc::clone(&map.map), args.fill.unwrap_or(f32::NAN), args.mask);
        let plan = run(py, 0, move |_| -> Result<Option<Plan>, dermatome::Error> {
            let mut atlas = match onto {
                None => Atlas::new(&map, &options)?,
                Some(canvas) if share_plane(&map, &canvas)? => Atlas::onto(&map, &canvas, &options)?,
                Some(_) => return Ok(None),
            };
            let is_named = |part: &AtlasPart| name.as_ref().is_none_or(|name| part.name == *name);
            atlas.parts.retain(|part| part.level == level && is_named(part) && !part.charts.is_empty());
            let taxels: usize = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
            let pixels = |[width, height]: [u32; 2]| width as usize * height as usize;
            let size = atlas.parts.first().map(|part| pixels(part.frame.size_px).max(taxels));
            if size.is_none_or(|size| size.saturating_mul(count) > MOST_NUMBERS) {
                return Ok(None);
            }
            Ok(Some(Plan {
                batch: Batch::new(&map, &channels, Carried::Values, Some(level))?,
                renderer: Renderer::new(&map, &atlas, &channels, Some(level))?,
                taxels,
                channels: channels.len(),
                fill,
                has_mask,
                level,
                starts: starts(&map, level),
                part: atlas.parts.swap_remove(0),
                shown: OnceLock::new(),
                taxel_ids: OnceLock::new(),
            }))
        })?;
        let needed = match &canvas {
            None => "a level that the patch has, and images of less than 2^28 numbers",
            Some(_) => {
                "an atlas that this map is drawn on, or one on the same, a patch of it that this map covers, and images of \
                 less than 2^28 numbers"
            }
        };
        let found = || format!("level {}, {count} channels", args.level);
        let plan = plan.map_err(error)?.ok_or_else(|| bad("renderer", found(), needed))?;
        let frame = plan.renderer.images()[0].frame;
        let [width, height] = frame.size_px;
        let pixel = (frame.size.y / f64::from(height), frame.size.x / f64::from(width));
        let shape = (height as usize, width as usize);
        Ok(Self { plan: Arc::new(plan), map: of.clone().unbind(), canvas, args, shape, pixel, extensive })
    }

    fn map(&self) -> &SkinMap {
        &self.map.get().map
    }

    /// What each pixel shows; while it is found, other threads of Python run.
    fn shown(&self, py: Python<'_>) -> PyResult<&Shown> {
        if self.plan.shown.get().is_none() {
            let (plan, map) = (Arc::clone(&self.plan), Arc::clone(&self.map.get().map));
            run(py, 1, move |_| _ = plan.shown(&map))?;
        }
        Ok(self.plan.shown(self.map()))
    }

    /// An array (H, W) of what each pixel shows.
    fn pixels<'py, T: numpy::Element + Clone>(
        &self,
        py: Python<'py>,
        none: T,
        of: impl Fn(PatchId, VertexId) -> T,
    ) -> PyResult<Bound<'py, PyArray2<T>>> {
        let all = self.shown(py)?.iter();
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
        #[pyo3(from_py_with = arg)] threads: i64,
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

    /// tuple of bool: Which channels are amounts, as forces, and drawn per m^2 of the map.
    #[getter]
    fn extensive<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, &self.extensive)
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
        let id = |(patch, vertex): (PatchId, VertexId)| {
            let patch = &self.map().patches[patch];
            let is_taxel = patch.nearest_level(self.plan.level) == LevelId::default();
            if is_taxel { patch.taxels.ids[vertex].0 } else { vertex.raw() }
        };
        let shown = self.shown(py)?;
        let ids = self
            .plan
            .taxel_ids
            .get_or_init(|| shown.iter().map(|shown| shown.map_or(u32::MAX, id)).collect());
        shaped(py, [self.shape.0, self.shape.1], ids.clone())
    }

    /// (H, W) int32 array: Number of the named region in `Map.regions` of the field nearest to each pixel, -1 for none.
    #[getter]
    fn region<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i32>>> {
        let regions = self.map.get().regions_of_fields();
        self.pixels(py, -1, |patch, vertex| {
            let level = self.map().patches[patch].nearest_level(self.plan.level);
            regions.region(patch, level, vertex).map_or(-1, |region| region.raw() as i32)
        })
    }

    /// list of dict: Where each patch lies in the image: `patch`, its name, and `level`; `corner`, row and column of its
    /// upper left pixel; `frame`, a `MapFrame`, on the map turned by `angle` (rad, counter-clockwise).
    #[getter]
    fn charts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let charts = PyList::empty(py);
        for chart in &self.plan.part.charts {
            let about = PyDict::new(py);
            about.set_item("patch", &self.map().patches[chart.patch].name)?;
            about.set_item("level", chart.level.index())?;
            let [column, row] = chart.corner_px;
            about.set_item("corner", (row, column))?;
            about.set_item("frame", map_frame(py, &chart.frame)?)?;
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
    /// Raises
    /// ------
    /// DataError
    ///     If they are of another level or map.
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
        #[pyo3(from_py_with = object)] hits: &Bound<'py, PyHits>,
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
            let charts = self.plan.part.charts.iter();
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
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If shapes differ, or a number is not finite.
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
        let map = Arc::clone(&self.map.get().map);
        let found = run(py, 0, move |stop| -> Result<Vec<MapPlace>, ContactError> {
            let all_shown = plan.shown(&map);
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
                let shown = is_inside.then(|| all_shown.get(pixel.0 as usize * width + pixel.1 as usize));
                let shown = shown.flatten().copied().flatten().map(|(patch, _)| patch);
                for chart in
                    plan.part.charts.iter().filter(|chart| shown.is_none_or(|shown| shown == chart.patch))
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
    ///     Values at the ends of the scale of colours, in the unit of the values; by default the smallest and the largest, from 0 on if none is
    ///     negative.
    /// magnification : int
    ///     Pixels of the video for each pixel of the images, in each direction.
    ///
    /// Raises
    /// ------
    /// FileError
    ///     If it cannot be written.
    /// DataError
    ///     If the shape is another, or channel, rate, range or magnification is out of its range.
    /// ImportError
    ///     If imageio is not installed.
    #[pyo3(signature = (values, path, *, channel=0, rate=30.0, range=None, magnification=4))]
    fn video(
        slf: &Bound<'_, Self>,
        values: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = arg)] path: PathBuf,
        #[pyo3(from_py_with = arg)] channel: i64,
        #[pyo3(from_py_with = arg)] rate: f64,
        #[pyo3(from_py_with = arg)] range: Option<[f64; 2]>,
        #[pyo3(from_py_with = arg)] magnification: i64,
    ) -> PyResult<()> {
        let numbers = (
            count("channel", channel)?,
            positive("rate", rate)?,
            count("magnification", magnification)?.max(1),
        );
        slf.py().import("dermatome._shown")?.call_method1("video", (slf, values, path, numbers, range))?;
        Ok(())
    }

    /// The matrix that draws values of the level, as `Map.pool` gives them, where no reading is missing: (H W, values of
    /// the level of the whole map). Rows of pixels that show no value are empty, as are columns of fields without a taxel
    /// that is present. Entries of a channel that is an amount are in 1/m^2: the sum of a column times the area of a pixel
    /// is 1.
    ///
    /// Parameters
    /// ----------
    /// channel : int
    ///     The channel, which decides between amounts and averages.
    ///
    /// Returns
    /// -------
    /// Matrix
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If there is no such channel.
    #[pyo3(signature = (channel=0))]
    fn matrix(&self, py: Python<'_>, #[pyo3(from_py_with = arg)] channel: i64) -> PyResult<PyMatrix> {
        let number = usize::try_from(channel).ok();
        let known = number.and_then(|number| Some((number, *self.extensive.get(number)?)));
        let needed = || format!("a channel from 0 to {}", self.extensive.len() - 1);
        let (number, extensive) = known.ok_or_else(|| bad("channel", channel, needed()))?;
        let quantity = quantity(extensive);
        let (plan, map) = (Arc::clone(&self.plan), Arc::clone(&self.map.get().map));
        let rows = run(py, 1, move |stop| plan.rows(quantity, Some(&plan.present(&map, number)), stop))?;
        Ok(rows.into_matrix(py, self.plan.starts.last().copied().unwrap_or(0)))
    }

    /// The matrix for averages of which none is missing, also of taxels that are not present, for `dermatome.torch`; and for
    /// each value of the level the pixel that gets its amount where no pixel shows it, -1 for none.
    fn _marks<'py>(&self, py: Python<'py>) -> PyResult<(PyMatrix, Bound<'py, PyArray1<i64>>)> {
        let plan = Arc::clone(&self.plan);
        let (rows, nearest) = run(py, 1, move |stop| {
            let of_patch = |(patch, ends): (usize, &[usize])| -> Vec<i64> {
                let pixel = |v| plan.renderer.nearest_pixel(0, PatchId::new(patch), VertexId::new(v));
                let all = (0..ends[1] - ends[0]).inspect(|_| stop.check());
                all.map(|v| pixel(v).map_or(-1, i64::from)).collect()
            };
            let nearest: Vec<i64> = plan.starts.windows(2).enumerate().flat_map(of_patch).collect();
            (plan.rows(Quantity::Intensive, None, stop), nearest)
        })?;
        Ok((rows.into_matrix(py, nearest.len()), vector(py, nearest)))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        let RenderArgs { level, patch, channels, extensive, modality, size, pixel, pack, fill, mask } =
            &self.args;
        let options = PyDict::new(py);
        options.set_item("level", level)?;
        options.set_item("patch", patch)?;
        options.set_item("channels", channels)?;
        match modality {
            PerChannel::All(one) => options.set_item("modality", one)?,
            PerChannel::Each(each) => options.set_item("modality", each)?,
        }
        match extensive {
            PerChannel::All(one) => options.set_item("extensive", one)?,
            PerChannel::Each(each) => options.set_item("extensive", each)?,
        }
        options.set_item("size", size)?;
        options.set_item("pixel", pixel)?;
        options.set_item("pack", pack.map(|pack| if pack == Pack::Body { "body" } else { "tight" }))?;
        options.set_item("fill", fill)?;
        options.set_item("mask", mask)?;
        options.set_item("atlas", self.canvas.as_ref().map(|canvas| canvas.clone_ref(py)))?;
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
