//! `build`: from a skin to its maps.

use std::{path::PathBuf, sync::Arc};

use dermatome::{
    Skin,
    io::map_to_bytes,
    pipeline::{BuildOptions, MagnifyOver, build_with},
    pyramid::CoarsenOptions,
    run::{Progress, Stage},
};
use pyo3::prelude::*;

use crate::{
    arguments::arg,
    errors::{bad, error},
    jobs::{Stop, run},
    map::PyMap,
    options::{FlattenArgs, acuities, count, cut, direction, positive, word},
    skin::PySkin,
};

/// Build the maps of a skin: coarsen every patch into levels of receptive fields and map each level to the plane.
///
/// Parameters
/// ----------
/// skin : Skin, str or os.PathLike
///     The skin, or a file that `Skin.read` reads.
/// ratio : float, optional
///     Number of vertices of a level over that of the next coarser one, a ratio; by default about 4.
/// levels : int, optional
///     At most this many levels above level 0.
/// coarsest : int
///     Stop at about this many vertices per patch.
/// method : {"intrinsic", "conformal", "linear"}
///     How maps are computed.
/// energy : {"sum", "symmetric-dirichlet"}
///     What the intrinsic method minimises. Of a patch whose map is absurd by the default sum (symmetric Dirichlet above 15) the
///     map is that of "symmetric-dirichlet" if it is better.
/// angle, area, perimeter : float
///     Weights of the terms of the sum, without a unit.
/// magnify : float
///     A share: 0 true to the area, 1 equal map area per taxel.
/// magnify_over : {"skin", "patch"}
///     Over what densities are compared.
/// overlap : {"prevent", "allow"}
///     What happens where the map of least distortion overlaps itself.
/// boundary : str
///     "free", "circle", "rectangle" or "rectangle:WIDTH:HEIGHT".
/// cut : {"auto", "none", "all"} or (k, 2) array_like of int
///     Where to cut first; pairs are ids of taxels that an edge joins.
/// max_area_ratio : float, optional
///     Cut until no triangle of the map is larger or smaller than on the skin by more than this factor.
/// seam_side : (3,) array_like, optional
///     The way that skin faces where seams are preferred, as the inside of limbs, in the frame of the skin; of any length, without a unit.
/// across : float, optional
///     Widest gap between patches that contacts go on over, in m; 0 for none; 3.5 spacings by default.
/// pixel : float, optional
///     Side of a pixel of the images, in m.
/// keep_going : bool
///     Leave out patches that cannot be mapped.
/// acuity : (N,) array_like, optional
///     How many times finer the fields are at each taxel of the skin, and lengths on the map longer, than elsewhere, as at
///     fingertips; 0.01 to 100.
/// threads : int
///     0 for one per processor. The result does not depend on it.
/// progress : callable, optional
///     Called with the stage ("coarsen" or "flatten"), the number of patches that are done and that of all. What it raises
///     ends the build.
///
/// Returns
/// -------
/// Map
///
/// Raises
/// ------
/// MissingFileError, FileError
///     If it does not exist, or cannot be read.
/// DataError
///     If the skin cannot be mapped, or an option is unknown or out of its range: the message says which patch or
///     option.
/// KeyboardInterrupt
///     Within a twentieth of a second.
///
/// Examples
/// --------
/// >>> import dermatome
/// >>> grid = [[0.005 * x, 0.005 * y, 0] for y in range(12) for x in range(12)]
/// >>> skin_map = dermatome.build(dermatome.Skin.from_arrays(grid), coarsest=10)
/// >>> [level.positions.shape for level in skin_map.patches["skin"].levels][0]
/// (144, 3)
#[pyfunction]
#[pyo3(signature = (skin, *, ratio=None, levels=None, coarsest=32, method="intrinsic", energy="sum", angle=1.0,
    area=1.0, perimeter=0.0, magnify=0.0, magnify_over="skin", overlap="prevent", boundary="free", cut=None,
    max_area_ratio=None, seam_side=None, across=None, pixel=None, keep_going=false, acuity=None, threads=0, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub(crate) fn build(
    py: Python<'_>,
    skin: &Bound<'_, PyAny>,
    #[pyo3(from_py_with = arg)] ratio: Option<f64>,
    #[pyo3(from_py_with = arg)] levels: Option<i64>,
    #[pyo3(from_py_with = arg)] coarsest: i64,
    #[pyo3(from_py_with = arg)] method: &str,
    #[pyo3(from_py_with = arg)] energy: &str,
    #[pyo3(from_py_with = arg)] angle: f64,
    #[pyo3(from_py_with = arg)] area: f64,
    #[pyo3(from_py_with = arg)] perimeter: f64,
    #[pyo3(from_py_with = arg)] magnify: f64,
    #[pyo3(from_py_with = arg)] magnify_over: &str,
    #[pyo3(from_py_with = arg)] overlap: &str,
    #[pyo3(from_py_with = arg)] boundary: &str,
    cut: Option<&Bound<'_, PyAny>>,
    #[pyo3(from_py_with = arg)] max_area_ratio: Option<f64>,
    seam_side: Option<&Bound<'_, PyAny>>,
    #[pyo3(from_py_with = arg)] across: Option<f64>,
    #[pyo3(from_py_with = arg)] pixel: Option<f64>,
    #[pyo3(from_py_with = arg)] keep_going: bool,
    acuity: Option<&Bound<'_, PyAny>>,
    #[pyo3(from_py_with = arg)] threads: i64,
    progress: Option<Py<PyAny>>,
) -> PyResult<PyMap> {
    let flatten = FlattenArgs { method, energy, angle, area, perimeter, magnify, overlap, boundary };
    let options = BuildOptions {
        cut: self::cut(cut, max_area_ratio)?,
        seam_side: seam_side.map(|side| direction("seam_side", side)).transpose()?,
        coarsen: CoarsenOptions {
            ratio,
            levels: levels.map(|levels| count("levels", levels)).transpose()?,
            coarsest: count("coarsest", coarsest)?,
        },
        flatten: flatten.options()?,
        across: match across {
            Some(0.0) | None => across,
            Some(most) => Some(positive("across", most)?),
        },
        pixel: pixel.map(|side| positive("pixel", side)).transpose()?,
        magnify_over: word(
            "magnify_over",
            magnify_over,
            &[("skin", MagnifyOver::Skin), ("patch", MagnifyOver::Patch)],
        )?,
        keep_going,
    };
    let skin = match skin.cast::<PySkin>() {
        Ok(skin) => Arc::clone(&skin.get().skin),
        Err(_) if skin.hasattr("vertices")? || skin.hasattr("points")? => {
            let found = skin.get_type().name()?;
            return Err(bad("skin", found, "a Skin or a file: Skin.from_mesh(mesh) is a Skin"));
        }
        Err(_) if skin.extract::<Vec<PathBuf>>().is_err() && skin.extract::<PathBuf>().is_err() => {
            let found = skin.get_type().name()?;
            return Err(bad("skin", found, "a Skin or a file: Skin.from_arrays makes a Skin of positions"));
        }
        Err(_) => {
            let read = py.get_type::<PySkin>().call_method1("read", (skin,))?;
            Arc::clone(&read.cast::<PySkin>()?.get().skin)
        }
    };
    let skin = match acuity {
        Some(acuity) => Arc::new(with_acuity(&skin, acuity)?),
        None => skin,
    };
    if let Some(progress) = progress.as_ref().map(|progress| progress.bind(py)).filter(|f| !f.is_callable()) {
        return Err(bad("progress", progress.get_type().name()?, "a function"));
    }
    let tell = move |told: Progress, stop: &Stop| {
        let Some(progress) = progress.as_ref().filter(|_| !stop.run().is_cancelled()) else { return };
        let stage = match told.stage {
            Stage::Coarsen => "coarsen",
            Stage::Flatten => "flatten",
        };
        let raised = Python::attach(|py| progress.call1(py, (stage, told.done, told.total)).err());
        raised.into_iter().for_each(|exception| stop.raise(exception));
    };
    let map = run(py, count("threads", threads)?, move |stop| -> Result<PyMap, dermatome::Error> {
        let built = build_with(&skin, &options, stop.run().telling(&|told| tell(told, stop)))?;
        // What a file holds, so that a map is the same whether it was built, read or unpickled.
        Ok(PyMap::of_file(map_to_bytes(&built.map)?)?)
    })?;
    map.map_err(error)
}

/// A skin with other acuities.
fn with_acuity(skin: &Skin, acuity: &Bound<'_, PyAny>) -> PyResult<Skin> {
    let mut skin = skin.clone();
    let count = skin.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
    let mut acuities = acuities(acuity, count)?.into_iter();
    for patch in skin.patches.iter_mut() {
        patch.taxels.acuities = Some(acuities.by_ref().take(patch.taxels.ids.len()).collect());
    }
    Ok(skin)
}
