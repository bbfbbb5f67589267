//! `build`: from a skin to its maps.

use std::{path::PathBuf, sync::Arc};

use dermatome::{
    Skin, SkinMap,
    cut::Cut,
    id::{IdVec, VertexId},
    io::{map_hash, map_to_bytes, read_landmarks},
    pipeline::{BuildOptions, BuildRemark, Built, MagnifyOver, build_with},
    pyramid::CoarsenOptions,
    registration::{Landmarks, Onto, Registered, carried_seams},
    run::{Progress, Run, Stage},
    skin::{TaxelId, Taxels},
};
use pyo3::prelude::*;

use crate::{
    arguments::arg,
    arrays::pairs,
    errors::{bad, error, warn},
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
/// boundary : {"free", "circle"}
///     What outline a map has: that of least distortion, or a circle.
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
/// atlas : Map, optional
///     Draw the map on that of another skin, so that both have the same pixels; needs landmarks.
/// landmarks : (k, 2) array_like of int, str or os.PathLike, optional
///     What is the same on both skins: ids of taxels of the skin and of the atlas, a file with columns
///     taxel_id,atlas_taxel_id, or "regions" for the centres of regions of one name; four or more in each patch.
/// mirror : bool
///     The skin is that of the other hand: draw it on the mirror image of the atlas.
/// threads : int
///     0 for one per processor. The result does not depend on it.
/// progress : callable, optional
///     Called with the stage ("coarsen" or "flatten"), the number of patches that are done and that of all. What it raises
///     ends the build.
///
/// Returns
/// -------
/// Map
///     Its `remarks` are the notes of the command.
///
/// Warns
/// -----
/// DermatomeWarning
///     If patches, levels or landmarks were left out, a map is poor or overlaps itself, or an option could not be kept.
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
    max_area_ratio=None, seam_side=None, across=None, pixel=None, keep_going=false, acuity=None,
    atlas=None, landmarks=None, mirror=false, threads=0, progress=None))]
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
    atlas: Option<&Bound<'_, PyAny>>,
    landmarks: Option<&Bound<'_, PyAny>>,
    #[pyo3(from_py_with = arg)] mirror: bool,
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
    let (skin, said) = match skin.cast::<PySkin>() {
        Ok(skin) => (Arc::clone(&skin.get().skin), skin.get().remarks.clone()),
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
            let read = read.cast::<PySkin>()?.get();
            (Arc::clone(&read.skin), read.remarks.clone())
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
    let onto = on_atlas(atlas, landmarks, mirror)?;
    let made = run(py, count("threads", threads)?, move |stop| -> Result<_, dermatome::Error> {
        let mut options = options;
        if let Some(onto) = onto.as_ref().filter(|_| options.cut == Cut::Auto) {
            let landmarks = onto.landmarks(skin.patches.iter().map(|patch| (&*patch.name, &patch.taxels)))?;
            let seams = carried_seams(&skin, &onto.onto(&landmarks)?)?;
            if seams.iter().any(|edges| !edges.is_empty()) {
                options.cut = Cut::Edges(seams);
            }
        }
        let mut built = build_with(&skin, &options, stop.run().telling(&|told| tell(told, stop)))?;
        let registered = match onto {
            Some(onto) => onto.register(&mut built, &skin, &options, stop.run())?,
            None => Registered::default(),
        };
        let mut remarks = BuildRemark::of_skin(&skin);
        remarks.extend(built.remarks(&options));
        // What a file holds, so that a map is the same whether it was built, read or unpickled.
        Ok((PyMap::of_file(map_to_bytes(&built.map)?)?, remarks, registered))
    })?;
    let (map, remarks, registered) = made.map_err(error)?;
    let lost = registered.remarks();
    let doubts = remarks.iter().filter(|remark| remark.is_doubt()).map(ToString::to_string);
    doubts.chain(lost.iter().cloned()).try_for_each(|doubt| warn(py, &doubt))?;
    let placed = registered.patches.iter().map(ToString::to_string);
    let said = said.into_iter().chain(remarks.iter().map(ToString::to_string)).chain(lost).chain(placed);
    Ok(map.with_remarks(said.collect()))
}

/// A skin with other acuities.
fn with_acuity(skin: &Skin, acuity: &Bound<'_, PyAny>) -> PyResult<Skin> {
    let mut skin = skin.clone();
    let count = skin.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
    let mut acuities = acuities(acuity, count)?.into_iter();
    for patch in skin.patches.iter_mut() {
        let of_patch: IdVec<VertexId, f64> = acuities.by_ref().take(patch.taxels.ids.len()).collect();
        // As in a table that does not name the taxels of a patch.
        patch.taxels.acuities = Some(of_patch).filter(|all| all.iter().any(|acuity| *acuity != 1.0));
    }
    Ok(skin)
}

/// The map of another skin that a map is drawn on.
struct OnAtlas {
    atlas: Arc<SkinMap>,
    landmarks: LandmarksArg,
    is_mirrored: bool,
}

enum LandmarksArg {
    Regions,
    File(PathBuf),
    Ids(Vec<[TaxelId; 2]>),
}

/// The atlas of the arguments, if there is one.
fn on_atlas(
    atlas: Option<&Bound<'_, PyAny>>,
    landmarks: Option<&Bound<'_, PyAny>>,
    is_mirrored: bool,
) -> PyResult<Option<OnAtlas>> {
    let (atlas, landmarks) = match (atlas, landmarks) {
        (Some(atlas), Some(landmarks)) => (atlas, landmarks),
        (None, None) if !is_mirrored => return Ok(None),
        (None, None) => return Err(bad("mirror", "True without an atlas", "the atlas, too")),
        (Some(_), None) => return Err(bad("landmarks", "None", "landmarks on the atlas")),
        (None, Some(_)) => return Err(bad("atlas", "None", "the map that the landmarks lie on")),
    };
    let Ok(atlas) = atlas.cast::<PyMap>() else {
        return Err(bad("atlas", atlas.get_type().name()?, "a Map: dermatome.Map.read reads a file"));
    };
    let landmarks = match landmarks.extract::<PathBuf>() {
        Ok(word) if word.as_os_str() == "regions" => LandmarksArg::Regions,
        Ok(path) => LandmarksArg::File(path),
        Err(_) => LandmarksArg::Ids(
            pairs("landmarks", landmarks)?.into_iter().map(|pair| pair.map(TaxelId)).collect(),
        ),
    };
    Ok(Some(OnAtlas { atlas: Arc::clone(&atlas.get().map), landmarks, is_mirrored }))
}

impl OnAtlas {
    /// What is the same on the atlas and on a skin with these patches.
    fn landmarks<'a>(
        &self,
        own: impl IntoIterator<Item = (&'a str, &'a Taxels)>,
    ) -> Result<Landmarks, dermatome::Error> {
        Ok(match &self.landmarks {
            LandmarksArg::Regions => Landmarks::Regions,
            LandmarksArg::File(path) => Landmarks::Taxels(read_landmarks(path, own, &self.atlas)?.rows),
            LandmarksArg::Ids(pairs) => {
                Landmarks::of_ids(own.into_iter().map(|(_, taxels)| taxels), &self.atlas, pairs)?
            }
        })
    }

    /// Draws a map that was built on the atlas.
    fn register(
        &self,
        built: &mut Built,
        skin: &Skin,
        options: &BuildOptions,
        run: Run<'_>,
    ) -> Result<Registered, dermatome::Error> {
        let map = Arc::clone(&built.map);
        let landmarks = self.landmarks(map.patches.iter().map(|patch| (&*patch.name, &patch.taxels)))?;
        built.register(skin, options, &self.onto(&landmarks)?, run)
    }

    fn onto<'a>(&'a self, landmarks: &'a Landmarks) -> Result<Onto<'a>, dermatome::Error> {
        let atlas = &*self.atlas;
        let name = atlas.patches.iter().next().map_or("", |patch| &patch.name);
        Ok(Onto { atlas, name, hash: map_hash(atlas)?, landmarks, is_mirrored: self.is_mirrored })
    }
}
