//! `Picture`: maps as SVG or PNG.

use std::{fs, path::PathBuf, sync::Arc};

use dermatome::{
    io::{IoError, file_kind},
    plot::{Paint, Picture, PlotOptions, Viewpoint, plot_frame, plot_map, value_colour},
    pyramid::LevelId,
    recording::{Batch, Carried},
};
use numpy::{PyArray3, PyArray4, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::{
    prelude::*,
    types::{PyBytes, PyDict},
};

use crate::{
    arguments::arg,
    arrays::{Reduced, made_by, shaped, vector},
    errors::{bad, error},
    jobs::run,
    map::PyMap,
    options::{channel, word},
};

/// A picture; notebooks show it. It is pickled as its map and what was asked of it.
///
/// Examples
/// --------
/// >>> import dermatome
/// >>> palm = dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(12) for x in range(12)])
/// >>> dermatome.build(palm).plot(width=600).array().shape[1:]
/// (600, 3)
#[pyclass(frozen, module = "dermatome", name = "Picture")]
pub(crate) struct PyPicture {
    picture: Arc<Picture>,
    map: Py<PyMap>,
    values: Option<Vec<f64>>,
    /// The other arguments of `Map.plot`.
    options: Py<PyDict>,
}

/// What to draw, from arguments.
pub(crate) struct PlotArgs<'a> {
    pub(crate) patches: Vec<String>,
    pub(crate) levels: Vec<LevelId>,
    pub(crate) show: &'a str,
    pub(crate) space: bool,
    pub(crate) view: Option<[f64; 2]>,
    pub(crate) unfold: Vec<f64>,
    pub(crate) range: Option<[f64; 2]>,
    pub(crate) width: u32,
    pub(crate) extensive: bool,
    pub(crate) modality: Option<String>,
}

impl PlotArgs<'_> {
    fn options(&self, py: Python<'_>) -> PyResult<Py<PyDict>> {
        let Self { patches, levels, show, space, view, unfold, range, width, extensive, modality } = self;
        let options = PyDict::new(py);
        options.set_item("patches", patches)?;
        options.set_item("levels", levels.iter().map(|level| level.index()).collect::<Vec<_>>())?;
        options.set_item("show", show)?;
        options.set_item("space", space)?;
        options.set_item("view", view)?;
        options.set_item("unfold", unfold)?;
        options.set_item("range", range)?;
        options.set_item("width", width)?;
        options.set_item("extensive", extensive)?;
        options.set_item("modality", modality)?;
        Ok(options.unbind())
    }
}

impl PyPicture {
    pub(crate) fn new(of: &Bound<'_, PyMap>, values: Option<Vec<f64>>, args: PlotArgs<'_>) -> PyResult<Self> {
        let (py, given) = (of.py(), args.options(of.py())?);
        let known = [
            ("fields", Paint::Fields),
            ("angle", Paint::Angle),
            ("area", Paint::Area),
            ("sigma", Paint::Sigma),
            ("regions", Paint::Regions),
        ];
        if let Some(angle) = args.view.iter().flatten().find(|angle| !angle.is_finite()) {
            return Err(bad("view", angle, "two angles"));
        }
        let view = args.view.map(|angles| angles.map(f64::to_radians));
        let view = view.map(|[azimuth, elevation]| Viewpoint::From { azimuth, elevation });
        if let Some(time) = args.unfold.iter().find(|time| !(0.0..=1.0).contains(*time)) {
            return Err(bad("unfold", time, "times from 0 to 1"));
        }
        if !args.unfold.is_empty() && values.is_some() {
            return Err(bad("unfold", "times and values", "one of the two"));
        }
        let options = PlotOptions {
            patches: args.patches,
            levels: args.levels,
            field_levels: Vec::new(),
            paint: word("show", args.show, &known)?,
            unfold: args.unfold,
            space: view.or(args.space.then_some(Viewpoint::Outside)),
            range: args.range,
            width_px: args.width,
        };
        let channel = channel(&of.get().map, args.extensive, args.modality.as_deref())?;
        let (map, shown) = (Arc::clone(&of.get().map), values.clone());
        let picture = run(py, 0, move |_| -> Result<Picture, dermatome::Error> {
            let Some(values) = shown else { return Ok(plot_map(&map, &options)?) };
            let channels = [channel];
            let mut batch = Batch::new(&map, &channels, Carried::Values, None)?;
            Ok(plot_frame(&map, batch.levels(&values), &channels, 0, &options)?)
        })?;
        let picture = Arc::new(picture.map_err(error)?);
        Ok(Self { picture, map: of.clone().unbind(), values, options: given })
    }

    /// Shows it on axes of matplotlib: one patch, by its name or the only one, and level in map coordinates; or the pixels.
    pub(crate) fn show_on(
        &self,
        ax: &Bound<'_, PyAny>,
        one: Option<(Option<String>, usize)>,
    ) -> PyResult<()> {
        let py = ax.py();
        let Some((patch, level)) = one else {
            ax.call_method1("imshow", (self.array(py)?,))?;
            ax.call_method1("axis", ("off",))?;
            return Ok(());
        };
        let values = self.values.as_ref().map(|values| vector(py, values.iter().copied()));
        let args = (ax, self.map.bind(py), patch, level, values, self.options.bind(py));
        py.import("dermatome._shown")?.call_method1("on_axes", args)?;
        Ok(())
    }
}

#[pymethods]
impl PyPicture {
    /// The picture as SVG.
    fn svg(&self) -> String {
        self.picture.to_svg()
    }

    fn _repr_svg_(&self) -> String {
        self.picture.to_svg()
    }

    /// The picture as PNG.
    fn png<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let picture = Arc::clone(&self.picture);
        Ok(PyBytes::new(py, &run(py, 0, move |_| picture.to_png())?.map_err(error)?))
    }

    /// The picture as an array.
    ///
    /// Returns
    /// -------
    /// (H, W, 3) uint8 array
    ///     Red, green and blue, the first row on top.
    pub(crate) fn array<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let picture = Arc::clone(&self.picture);
        let [width, height] = self.picture.size_px();
        let pixels = run(py, 0, move |_| picture.to_pixels())?.map_err(error)?;
        shaped(py, [height as usize, width as usize, 3], pixels.into_flattened())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        let values = self.values.as_ref().map(|values| vector(py, values.iter().copied()));
        made_by(py, "picture", (self.map.clone_ref(py), values, self.options.clone_ref(py)))
    }

    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    fn __repr__(&self) -> String {
        let [width, height] = self.picture.size_px();
        format!("<dermatome.Picture: {height} x {width} pixels>")
    }

    /// Write the picture to a file .svg or .png.
    ///
    /// Raises
    /// ------
    /// FileError
    ///     If it cannot be written.
    /// DataError
    ///     If the extension is another than .svg or .png.
    fn save(&self, py: Python<'_>, #[pyo3(from_py_with = arg)] path: PathBuf) -> PyResult<()> {
        let picture = Arc::clone(&self.picture);
        let bytes = match file_kind(&path).as_str() {
            "svg" => picture.to_svg().into_bytes(),
            "png" => run(py, 0, move |_| picture.to_png())?.map_err(error)?,
            _ => return Err(bad("path", path.display(), "a file .svg or .png")),
        };
        fs::write(&path, bytes).map_err(|source| error(IoError::Write { path, source }))
    }
}

/// Values (T, H, W) as colours (T, H, W, 3): white where `mask` (H, W) is False, a hatch where they are NaN.
#[pyfunction]
pub(crate) fn colours<'py>(
    py: Python<'py>,
    values: PyReadonlyArray3<'py, f32>,
    mask: PyReadonlyArray2<'py, bool>,
    #[pyo3(from_py_with = arg)] range: [f64; 2],
) -> PyResult<Bound<'py, PyArray4<u8>>> {
    if !(range[0] < range[1] && range.iter().all(|x| x.is_finite())) {
        return Err(bad("range", format!("{range:?}"), "two numbers, the lower one first"));
    }
    let (values, mask) = (values.as_array(), mask.as_array());
    let (frames, height, width) = values.dim();
    if mask.dim() != (height, width) {
        return Err(bad("mask", format!("{:?}", mask.dim()), format!("shape ({height}, {width})")));
    }
    let colour = |((_, y, x), &value): ((usize, usize, usize), &f32)| match mask[(y, x)] {
        true => value_colour(value.into(), range, x + y),
        false => [255; 3],
    };
    let pixels: Vec<[u8; 3]> = values.indexed_iter().map(colour).collect();
    shaped(py, [frames, height, width, 3], pixels.into_flattened())
}
