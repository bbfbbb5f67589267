//! `Picture`: maps as SVG or PNG.

use std::{fs, path::PathBuf, sync::Arc};

use dermatome::{
    SkinMap,
    io::{IoError, file_kind},
    plot::{Paint, Picture, PlotOptions, Viewpoint, plot_frame, plot_map},
    pyramid::LevelId,
    signal::{Duplicates, Frame, Join, Restrictor},
};
use pyo3::{prelude::*, types::PyBytes};

use crate::{
    errors::{bad, error},
    jobs::run,
    options::{channels, word},
};

/// A picture; notebooks show it.
#[pyclass(frozen, module = "dermatome", name = "Picture")]
pub(crate) struct PyPicture(Arc<Picture>);

/// What to draw, from arguments.
pub(crate) struct PlotArgs<'a> {
    pub(crate) patches: Vec<String>,
    pub(crate) levels: Vec<LevelId>,
    pub(crate) paint: &'a str,
    pub(crate) space: bool,
    pub(crate) range: Option<[f64; 2]>,
    pub(crate) width: u32,
    pub(crate) extensive: bool,
}

impl PyPicture {
    pub(crate) fn new(
        py: Python<'_>,
        map: &Arc<SkinMap>,
        values: Option<Vec<f64>>,
        args: PlotArgs<'_>,
    ) -> PyResult<Self> {
        let known = [
            ("fields", Paint::Fields),
            ("angle", Paint::Angle),
            ("area", Paint::Area),
            ("sigma", Paint::Sigma),
        ];
        let options = PlotOptions {
            patches: args.patches,
            levels: args.levels,
            paint: word("paint", args.paint, &known)?,
            space: args.space.then_some(Viewpoint::Outside),
            range: args.range,
            width_px: args.width,
            ..PlotOptions::default()
        };
        let (map, extensive) = (Arc::clone(map), args.extensive);
        let picture = run(py, 0, move |_| -> Result<Picture, dermatome::Error> {
            let Some(values) = values else { return Ok(plot_map(&map, &options)?) };
            let channels = channels(1, extensive);
            let mut frame = Frame::new(&map, 1);
            Join::new(&map, None, values.len(), Duplicates::Refuse)?.fill(&values, &mut frame);
            let mut restrictor = Restrictor::new(&map, &channels);
            Ok(plot_frame(&map, restrictor.restrict(&frame), &channels, 0, &options)?)
        })?;
        Ok(Self(Arc::new(picture.map_err(error)?)))
    }
}

#[pymethods]
impl PyPicture {
    /// The picture as SVG.
    fn svg(&self) -> String {
        self.0.to_svg()
    }

    fn _repr_svg_(&self) -> String {
        self.0.to_svg()
    }

    /// The picture as PNG.
    fn png<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let picture = Arc::clone(&self.0);
        Ok(PyBytes::new(py, &run(py, 0, move |_| picture.to_png())?.map_err(error)?))
    }

    /// Write the picture to a file .svg or .png.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let picture = Arc::clone(&self.0);
        let bytes = match file_kind(&path).as_str() {
            "svg" => picture.to_svg().into_bytes(),
            "png" => run(py, 0, move |_| picture.to_png())?.map_err(error)?,
            _ => return Err(bad("path", path.display(), "a file .svg or .png")),
        };
        fs::write(&path, bytes).map_err(|source| error(IoError::Write { path, source }))
    }
}
