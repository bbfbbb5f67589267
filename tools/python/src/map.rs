//! `build`, `Map`, `Patch` and `Level`: the maps of a skin as arrays.

use std::{
    collections::{BTreeSet, HashMap, hash_map::DefaultHasher},
    fs,
    hash::{Hash, Hasher},
    io::Write,
    path::PathBuf,
    sync::{Arc, OnceLock},
};

use dermatome::{
    SkinMap,
    contact::{IndexOptions, MapIndex},
    id::VertexId,
    io::{
        ExportOptions, IoError, export_map, file_kind, map_from_bytes, map_to_bytes, read_map, read_regions,
        replace_file,
    },
    map::{FieldRegions, MapLevel, PatchMap},
    pipeline::{BuildOptions, MagnifyOver, build_with},
    pyramid::{CoarsenOptions, Level, LevelId},
    report::measure,
    run::{Progress, Stage},
    signal::{Contrast, Duplicates, Frame, GroupPool, Join, Quantity, Restrictor},
    skin::{PatchId, Presence, Skin},
};
use glam::DVec3;
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::{
    prelude::*,
    types::{PyBytes, PyDict, PyMapping, PyTuple},
};
use rayon::prelude::*;

use crate::{
    arrays::{Reduced, bad_shape, bytes_of, floats, made_by, matrix, one_each, places, vector, zeros},
    errors::{bad, error},
    index::PyIndex,
    jobs::{Stop, run, run_here},
    matrix::{PyMatrix, Rows},
    options::{
        Extensive, FlattenArgs, PackArg, acuities, channels, count, cut, direction, level, positive, word,
    },
    plot::{PlotArgs, PyPicture},
    signal::{PyRenderer, RenderArgs},
    skin::PySkin,
};

/// The maps of a skin, as `map.glb` holds them: every patch on every level, its map, and the receptive fields.
///
/// Lengths are in m. Arrays of the whole map are in the order of its taxels: patch after patch, the taxels of each
/// in the order of its level 0. A map is the same whether it was built, read or unpickled. It never changes, can be
/// pickled (by its bytes) and compared.
///
/// Examples
/// --------
/// >>> import dermatome
/// >>> grid = [[0.005 * x, 0.005 * y, 0] for y in range(12) for x in range(12)]
/// >>> skin_map = dermatome.build(dermatome.Skin.from_arrays(grid, patch="palm"))
/// >>> skin_map.n_taxels, len(skin_map.patches["palm"].levels)
/// (144, 2)
#[pyclass(frozen, module = "dermatome", name = "Map")]
#[derive(Debug)]
pub(crate) struct PyMap {
    pub(crate) map: Arc<SkinMap>,
    /// The file that it was read from: what is written again has other last bits.
    file: Arc<[u8]>,
    back: OnceLock<Arc<MapIndex>>,
    regions: OnceLock<FieldRegions>,
}

/// Patch, level and index of each field.
type FieldArrays<'py> = (Bound<'py, PyArray1<i32>>, Bound<'py, PyArray1<i32>>, Bound<'py, PyArray1<i64>>);

/// The number of vertices of a level of a patch, or of its coarsest.
fn size_of(patch: &PatchMap, level: LevelId) -> usize {
    patch.levels[patch.nearest_level(level)].level.mesh.positions.len()
}

/// Where the vertices of each patch begin among those of a level of the whole map, and the end of the last.
pub(crate) fn starts(map: &SkinMap, level: LevelId) -> Vec<usize> {
    let mut starts = vec![0];
    let mut end = 0;
    for patch in &map.patches {
        end += size_of(patch, level);
        starts.push(end);
    }
    starts
}

impl PyMap {
    fn new(map: SkinMap, file: Vec<u8>) -> Self {
        Self { map: Arc::new(map), file: file.into(), back: OnceLock::new(), regions: OnceLock::new() }
    }

    /// The map of a file.
    fn of_file(file: Vec<u8>) -> Result<Self, IoError> {
        Ok(Self::new(map_from_bytes(file.clone())?, file))
    }

    pub(crate) fn levels(&self) -> usize {
        self.map.patches.iter().map(|patch| patch.levels.len()).max().unwrap_or(0)
    }

    pub(crate) fn patch_named(&self, name: &str) -> PyResult<PatchId> {
        let known = self.map.patches.enumerate().find(|(_, patch)| patch.name == name);
        known.map(|(id, _)| id).ok_or_else(|| {
            let names: Vec<_> = self.map.patches.iter().take(10).map(|patch| patch.name.as_str()).collect();
            bad("patch", format!("{name:?}"), format!("one of {names:?}"))
        })
    }

    /// What finds places on the maps; made when it is first needed.
    pub(crate) fn back(&self, py: Python<'_>) -> PyResult<Arc<MapIndex>> {
        if let Some(back) = self.back.get() {
            return Ok(Arc::clone(back));
        }
        let map = Arc::clone(&self.map);
        let made = run(py, 0, move |_| MapIndex::new(&map))?.map_err(error)?;
        Ok(Arc::clone(self.back.get_or_init(|| Arc::new(made))))
    }

    /// The regions of fields; found when they are first needed.
    pub(crate) fn field_regions(&self) -> &FieldRegions {
        self.regions.get_or_init(|| FieldRegions::new(&self.map))
    }

    fn taxels<'a, T: 'a>(&'a self, of: impl Fn(PatchId, &'a PatchMap) -> Vec<T>) -> Vec<T> {
        self.map.patches.enumerate().flat_map(|(id, patch)| of(id, patch)).collect()
    }
}

#[pymethods]
impl PyMap {
    /// Read a map from a file.
    ///
    /// Parameters
    /// ----------
    /// path : str or os.PathLike
    ///     A `map.glb` that `write` or the command wrote.
    ///
    /// Returns
    /// -------
    /// Map
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let read = run(py, 0, move |_| {
            let map = read_map(&path)?;
            let file = if file_kind(&path) == "glb" {
                fs::read(&path).map_err(|source| IoError::Read { path, source })?
            } else {
                map_to_bytes(&map)?
            };
            Ok(Self::new(map, file))
        })?;
        read.map_err(|e: IoError| error(e))
    }

    /// Read a map from the content of a file.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, data: &Bound<'_, PyAny>) -> PyResult<Self> {
        let file = bytes_of("data", data)?;
        run(py, 0, move |_| Self::of_file(file))?.map_err(error)
    }

    /// The content of the file that `write` writes.
    fn to_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.file)
    }

    /// Write the map to a file (.glb), whole or not at all.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        if file_kind(&path) != "glb" {
            return Err(bad("path", path.display(), "a file .glb"));
        }
        let file = Arc::clone(&self.file);
        run(py, 0, move |_| {
            replace_file(&path, |output| {
                output.write_all(&file).map_err(|source| IoError::Write { path: path.clone(), source })
            })
        })?
        .map_err(error)
    }

    /// Write one level of the map for another program: the extension of the file says which.
    ///
    /// Parameters
    /// ----------
    /// path : str or os.PathLike
    ///     `.xml`: tactile sensors of MuJoCo. `.usda`: meshes of USD. `.csv`, `.npz`: a table of the taxels, or above
    ///     level 0 of the fields. `.json`: probes for Genesis. `.urdf`: `robot` with tactile sensors.
    /// level : int
    ///     The level; a patch without it shows its coarsest.
    /// patch : str, optional
    ///     The patch; by default all.
    /// robot : str or os.PathLike, optional
    ///     The description of the robot that carries the skin, for a `.urdf`.
    ///
    /// Examples
    /// --------
    /// >>> import dermatome, pathlib, tempfile
    /// >>> grid = [[0.005 * x, 0.005 * y, 0] for y in range(12) for x in range(12)]
    /// >>> skin_map = dermatome.build(dermatome.Skin.from_arrays(grid))
    /// >>> path = pathlib.Path(tempfile.mkdtemp(), "taxels.csv")
    /// >>> skin_map.export(path)
    /// >>> path.read_text().splitlines()[0]
    /// 'patch,link,taxel_id,x,y,z,nx,ny,nz,tx,ty,tz,u,v,area,presence'
    #[pyo3(signature = (path, *, level=0, patch=None, robot=None))]
    fn export(
        &self,
        py: Python<'_>,
        path: PathBuf,
        level: i64,
        patch: Option<&str>,
        robot: Option<PathBuf>,
    ) -> PyResult<()> {
        let options = ExportOptions { level: self::level("level", level, self.levels())?, robot };
        let map = match patch {
            None => Arc::clone(&self.map),
            Some(name) => {
                let patches = vec![self.map.patches[self.patch_named(name)?].clone()].into();
                Arc::new(SkinMap { links: self.map.links.clone(), patches, ..SkinMap::default() })
            }
        };
        run(py, 0, move |_| export_map(&path, &map, &options))?.map_err(error)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        let py = slf.py();
        Ok((py.get_type::<Self>().getattr("from_bytes")?, (slf.get().to_bytes(py),)))
    }

    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    fn _repr_html_(slf: &Bound<'_, Self>) -> PyResult<Py<PyAny>> {
        Ok(slf.py().import("dermatome._shown")?.call_method1("table", (slf,))?.unbind())
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| self.file == other.get().file)
    }

    fn __hash__(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        self.file.hash(&mut hasher);
        hasher.finish()
    }

    fn __repr__(&self) -> String {
        let (patches, levels) = (self.map.patches.len(), self.levels());
        format!("<dermatome.Map: {} taxels, {patches} patches, {levels} levels>", self.n_taxels())
    }

    /// dict of str to Patch: The patches by their names, in the order of the map.
    #[getter]
    fn patches<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyDict>> {
        let (patches, map) = (PyDict::new(slf.py()), &slf.get().map);
        let starts = starts(map, LevelId::new(0));
        for ((id, patch), start) in map.patches.enumerate().zip(starts) {
            patches.set_item(&patch.name, PyPatch { map: slf.clone().unbind(), id, start })?;
        }
        Ok(patches)
    }

    /// tuple of str: Names of the links; a parent comes before its children.
    #[getter]
    fn links<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.map.links.iter().map(|link| &link.name))
    }

    /// int: Number of taxels, N.
    #[getter]
    fn n_taxels(&self) -> usize {
        self.map.patches.iter().map(|patch| patch.taxels.ids.len()).sum()
    }

    /// int: Number of levels of the patch that has most.
    #[getter]
    fn n_levels(&self) -> usize {
        self.levels()
    }

    /// (N,) uint32 array: Ids of the taxels.
    #[getter]
    fn ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        vector(py, self.taxels(|_, patch| patch.taxels.ids.iter().map(|id| id.0).collect()))
    }

    /// (N,) uint8 array: 1 a working taxel, 0 none, 2 a thermal pad.
    #[getter]
    fn present<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u8>> {
        let code = |presence: &Presence| match presence {
            Presence::Absent => 0,
            Presence::Present => 1,
            Presence::ThermalPad => 2,
        };
        vector(py, self.taxels(|_, patch| patch.taxels.presence.iter().map(code).collect()))
    }

    /// (N,) uint32 array: The number of each taxel's patch.
    #[getter]
    fn patch_of<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        vector(py, self.taxels(|id, patch| vec![id.raw(); patch.taxels.ids.len()]))
    }

    /// (N,) uint32 array: The number of each taxel's link.
    #[getter]
    fn link_of<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        vector(py, self.taxels(|_, patch| vec![patch.link.raw(); patch.taxels.ids.len()]))
    }

    /// tuple of str: Names of the regions, in the order of their first taxels.
    #[getter]
    fn regions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.map.regions().names.iter().map(|name| &**name))
    }

    /// (N,) int32 array: The number of each taxel's region in `regions`, -1 for none.
    #[getter]
    fn region_of<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i32>> {
        let regions = self.map.regions();
        let of_taxels = regions.of_taxels.iter().flat_map(|of| of.iter().copied());
        vector(py, of_taxels.map(|region| region.map_or(-1, |region| region.raw() as i32)))
    }

    /// The map with other named regions; taxels that are not named keep theirs.
    ///
    /// Parameters
    /// ----------
    /// regions : str, os.PathLike or mapping of str to sequence of int
    ///     "link" for the names of the links; a table with columns taxel_id,region (.csv); polygons on the maps (.json); or
    ///     the ids of the taxels of each region.
    ///
    /// Returns
    /// -------
    /// Map
    ///
    /// Examples
    /// --------
    /// >>> import dermatome
    /// >>> grid = [[0.005 * x, 0.005 * y, 0] for y in range(12) for x in range(12)]
    /// >>> skin_map = dermatome.build(dermatome.Skin.from_arrays(grid)).with_regions({"rim": range(1, 13)})
    /// >>> skin_map.regions, int((skin_map.region_of == 0).sum())
    /// (('rim',), 12)
    fn with_regions(&self, py: Python<'_>, regions: &Bound<'_, PyAny>) -> PyResult<Self> {
        let mut map = SkinMap::clone(&self.map);
        if let Ok(named) = regions.cast::<PyMapping>() {
            let homes: HashMap<u32, (PatchId, VertexId)> = map
                .patches
                .enumerate()
                .flat_map(|(id, patch)| {
                    patch.taxels.ids.enumerate().map(move |(v, taxel)| (taxel.0, (id, v)))
                })
                .collect();
            for item in named.items()?.iter() {
                let (name, ids): (String, Bound<'_, PyAny>) = item.extract()?;
                let ids: Vec<u32> = ids.try_iter()?.map(|id| id?.extract()).collect::<PyResult<_>>()?;
                let home = |id: &u32| {
                    homes.get(id).copied().ok_or_else(|| bad("regions", id, "the id of a taxel of the map"))
                };
                let taxels: Vec<_> = ids.iter().map(home).collect::<PyResult<_>>()?;
                map.set_regions(taxels, &name).map_err(error)?;
            }
        } else {
            let path: PathBuf = regions.extract()?;
            if path.as_os_str() == "link" {
                map.set_regions_by_link().map_err(error)?;
            } else {
                read_regions(&path, &mut map).map_err(error)?;
            }
        }
        run(py, 0, move |_| Self::of_file(map_to_bytes(&map)?))?.map_err(|e: IoError| error(e))
    }

    /// Carry readings of the taxels to the named regions.
    ///
    /// Parameters
    /// ----------
    /// values : (..., N) array_like
    ///     Readings in the order of the map; NaN where there is none.
    /// extensive : bool
    ///     Whether they are amounts, as forces, which are summed, and not averages, as pressures, which are weighted by the
    ///     areas of the taxels.
    ///
    /// Returns
    /// -------
    /// (..., R) float32 array
    ///     One value for each of `regions`; NaN where no taxel of a region has a reading.
    #[pyo3(signature = (values, *, extensive=false))]
    fn pool_regions<'py>(
        &self,
        py: Python<'py>,
        values: &Bound<'py, PyAny>,
        extensive: bool,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        self.pool_groups(py, values, &GroupPool::of_regions(&self.map), extensive)
    }

    /// As `pool_regions`, for groups of taxels with numbers below `count`, -1 for none.
    #[pyo3(signature = (values, groups, count, *, extensive=false))]
    fn _pool_groups<'py>(
        &self,
        py: Python<'py>,
        values: &Bound<'py, PyAny>,
        groups: Vec<i64>,
        count: usize,
        extensive: bool,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let needed = self.n_taxels();
        if groups.len() != needed {
            return Err(bad_shape("groups", &[groups.len()], format!("shape ({needed},)")));
        }
        let groups = groups.into_iter().map(|group| usize::try_from(group).ok());
        self.pool_groups(py, values, &GroupPool::new(&self.map, groups, count), extensive)
    }

    /// list of dict: The measures of every patch and level, as `report.json` has them.
    #[getter]
    fn report<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let map = Arc::clone(&self.map);
        json(py, &run(py, 0, move |_| measure(&map))?)
    }

    /// The number of fields of a level of the whole map; on level 0 of taxels.
    ///
    /// Parameters
    /// ----------
    /// level : int
    ///     The level; patches without it count those of their coarsest.
    ///
    /// Returns
    /// -------
    /// int
    fn n_fields(&self, level: i64) -> PyResult<usize> {
        let level = self::level("level", level, self.levels())?;
        Ok(starts(&self.map, level).last().copied().unwrap_or(0))
    }

    /// Which fields a level of the whole map has, in the order in which `pool`, `pooling`, `Hits.fields`,
    /// `Renderer.field` and `Renderer.matrix` have them: patch after patch.
    ///
    /// Parameters
    /// ----------
    /// level : int
    ///     The level; patches without it have those of their coarsest.
    ///
    /// Returns
    /// -------
    /// patch : (n,) int32 array
    ///     Number of the patch of each field.
    /// level : (n,) int32 array
    ///     The level that it is of, in that patch.
    /// index : (n,) int64 array
    ///     The vertex of that level.
    ///
    /// Examples
    /// --------
    /// >>> import dermatome
    /// >>> palm = dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(12) for x in range(12)])
    /// >>> skin_map = dermatome.build(palm)
    /// >>> patch, level, index = skin_map.fields(1)
    /// >>> len(patch) == skin_map.n_fields(1) == len(skin_map.patches["skin"].levels[1].positions)
    /// True
    fn fields<'py>(&self, py: Python<'py>, level: i64) -> PyResult<FieldArrays<'py>> {
        let level = self::level("level", level, self.levels())?;
        let of_patch = |(id, patch): (PatchId, &PatchMap)| {
            let on = patch.nearest_level(level).raw();
            (0..size_of(patch, level)).map(move |index| (id.raw(), on, index))
        };
        let all: Vec<(u32, u32, usize)> = self.map.patches.enumerate().flat_map(of_patch).collect();
        Ok((
            vector(py, all.iter().map(|field| field.0 as i32)),
            vector(py, all.iter().map(|field| field.1 as i32)),
            vector(py, all.iter().map(|field| field.2 as i64)),
        ))
    }

    /// How the taxels depend on the receptive fields of a level: the law of fields.
    ///
    /// Row `i` holds the weights, with sum 1, of at most three fields of taxel `i`. With `P` this matrix, `a` the
    /// areas of the taxels and `m` 1 where there is a reading, a pressure `p` becomes `P.T @ (a m p) / P.T @ (a m)`
    /// on the fields and a force `f` becomes `P.T @ (m f)`.
    ///
    /// Parameters
    /// ----------
    /// level : int
    ///     The level, 0 for the taxels themselves.
    /// patch : str, optional
    ///     The patch; by default all, whose taxels and fields follow each other in the order of the map. Patches
    ///     without this level have those of their coarsest.
    ///
    /// Returns
    /// -------
    /// Matrix
    ///     (taxels, fields).
    #[pyo3(signature = (level, *, patch=None))]
    fn pooling(&self, py: Python<'_>, level: i64, patch: Option<&str>) -> PyResult<PyMatrix> {
        let level = self::level("level", level, self.levels())?;
        let only = patch.map(|name| self.patch_named(name)).transpose()?;
        let (mut rows, mut first) = (Rows::new(), 0);
        for (_, patch) in self.map.patches.enumerate().filter(|(id, _)| only.is_none_or(|only| only == *id)) {
            let direct = &patch.levels[patch.nearest_level(level)].level.to_finest;
            for taxel in patch.taxels.ids.ids() {
                match direct {
                    Some(direct) => rows.push(direct.row(taxel).map(|(field, w)| (first + field.index(), w))),
                    None => rows.push([(first + taxel.index(), 1.0)]),
                }
            }
            first += size_of(patch, level);
        }
        Ok(rows.into_matrix(py, first))
    }

    /// Carry readings of the taxels to the receptive fields of a level.
    ///
    /// Parameters
    /// ----------
    /// values : (..., N) array_like
    ///     Readings in the order of the map; NaN where there is none. Taxels that are not present have none.
    /// level : int
    ///     The level.
    /// extensive : bool
    ///     Whether they are amounts, as forces, which are summed, and not averages, as pressures.
    /// contrast : bool
    ///     Whether what the level shows beyond the next coarser one is returned instead.
    /// threads : int
    ///     0 for one per processor.
    ///
    /// Returns
    /// -------
    /// (..., n) float32 array
    ///     One value for each field of the level, patch after patch; NaN where all taxels of a field have none.
    ///
    /// Examples
    /// --------
    /// >>> import dermatome, numpy as np
    /// >>> grid = [[0.005 * x, 0.005 * y, 0] for y in range(12) for x in range(12)]
    /// >>> skin_map = dermatome.build(dermatome.Skin.from_arrays(grid))
    /// >>> pooled = skin_map.pool(np.full((5, 144), 2.5), level=1)
    /// >>> len(pooled), bool(np.all(pooled == 2.5))
    /// (5, True)
    #[pyo3(signature = (values, level, *, extensive=false, contrast=false, threads=0))]
    fn pool<'py>(
        &self,
        py: Python<'py>,
        values: &Bound<'py, PyAny>,
        level: i64,
        extensive: bool,
        contrast: bool,
        threads: i64,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let level = self::level("level", level, self.levels())?;
        let values = floats("values", values)?;
        let needed = self.n_taxels();
        let Some((_, frames)) = values.shape().split_last().filter(|(last, _)| **last == needed) else {
            return Err(bad_shape("values", values.shape(), format!("shape (..., {needed})")));
        };
        let fields = starts(&self.map, level).last().copied().unwrap_or(0);
        let shape: Vec<usize> = frames.iter().copied().chain([fields]).collect();
        let (pooled, values) = (zeros(py, &shape)?, values.as_slice()?);
        let mut writer = pooled.readwrite();
        let (out, pooling) = (writer.as_slice_mut()?, Pooling { map: &self.map, level, extensive, contrast });
        run_here(py, count("threads", threads)?, |stop| pooling.pool(values, out, stop))?.map_err(error)?;
        Ok(pooled)
    }

    /// Make the map ready to be asked what is near a point.
    ///
    /// Parameters
    /// ----------
    /// reactive : bool
    ///     Whether `Index.reactive` is needed.
    /// fields : bool
    ///     Whether `Index.nearest` and `Index.within` are needed.
    /// threads : int
    ///     0 for one per processor.
    ///
    /// Returns
    /// -------
    /// Index
    #[pyo3(signature = (*, reactive=false, fields=false, threads=0))]
    fn index(slf: &Bound<'_, Self>, reactive: bool, fields: bool, threads: i64) -> PyResult<PyIndex> {
        PyIndex::new(slf, IndexOptions { reactive, fields }, count("threads", threads)?)
    }

    /// Make what draws readings as tactile images of one level.
    ///
    /// Parameters
    /// ----------
    /// level : int
    ///     The level.
    /// patch : str, optional
    ///     The patch; needed if the map has several and they are not packed.
    /// channels : int, optional
    ///     Number of channels of the readings, C; by default as many as `extensive` has, or any.
    /// extensive : bool, or a sequence of one for each channel
    ///     Whether readings are amounts, as forces, and not averages, as pressures; `Readings.extensive` says so.
    /// interpolate : {"linear", "nearest"}
    ///     How values are drawn between the taxels.
    /// size : (2,) sequence of int, optional
    ///     Height and width of the images, in pixels.
    /// pixel : float, optional
    ///     Side of a pixel, in m on the map; by default that of the map.
    /// pack : bool or {"tight", "body"}, optional
    ///     All patches in one image: "tight" (True) as large as they fit, in any direction; "body" in the order of the
    ///     body, distal ends up. By default each patch has its own.
    /// fill : float, optional
    ///     The value of pixels where nothing is known; by default NaN.
    /// mask : bool
    ///     Whether images have a channel more, the last: 1 where all others are known, 0 elsewhere.
    ///
    /// Returns
    /// -------
    /// Renderer
    #[pyo3(signature = (level=0, *, patch=None, channels=None, extensive=None, interpolate="linear", size=None,
        pixel=None, pack=None, fill=None, mask=false))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn renderer(
        slf: &Bound<'_, Self>,
        level: i64,
        patch: Option<String>,
        channels: Option<i64>,
        extensive: Option<&Bound<'_, PyAny>>,
        interpolate: &str,
        size: Option<[u32; 2]>,
        pixel: Option<f64>,
        pack: Option<PackArg>,
        fill: Option<f32>,
        mask: bool,
    ) -> PyResult<PyRenderer> {
        let (pack, extensive) = (pack.map(PackArg::read).transpose()?.flatten(), Extensive::read(extensive)?);
        let interpolate = interpolate.to_owned();
        let args =
            RenderArgs { level, patch, channels, extensive, interpolate, size, pixel, pack, fill, mask };
        PyRenderer::new(slf, args)
    }

    /// Draw the maps with their receptive fields, their distortion, or readings.
    ///
    /// Parameters
    /// ----------
    /// values : (N,) array_like, optional
    ///     Readings to show, in the order of the map.
    /// patches : sequence of str, optional
    ///     The patches, one row each; by default all.
    /// levels : sequence of int, optional
    ///     The levels, side by side; by default the finest three.
    /// show : {"fields", "angle", "area", "sigma"}
    ///     What the colours say.
    /// space : bool
    ///     Whether the skin in space is shown, too.
    /// view : (2,) sequence of float, optional
    ///     From where: the angle from x towards y and the angle above the xy plane, in degrees; by default from outside.
    /// unfold : sequence of float, optional
    ///     Draw the skin as it unfolds instead, at these times side by side: 0 is the skin in space, 1 its map.
    /// range : (2,) sequence of float, optional
    ///     Values at the ends of the scale of colours.
    /// width : int
    ///     Width of the picture, in pixels.
    /// extensive : bool
    ///     Whether readings are amounts, as forces.
    /// ax : matplotlib.axes.Axes, optional
    ///     Axes that show the picture, too.
    ///
    /// Returns
    /// -------
    /// Picture
    #[pyo3(signature = (values=None, *, patches=None, levels=None, show="fields", space=false, view=None, unfold=None,
        range=None, width=1600, extensive=false, ax=None))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn plot(
        slf: &Bound<'_, Self>,
        values: Option<&Bound<'_, PyAny>>,
        patches: Option<Vec<String>>,
        levels: Option<Vec<i64>>,
        show: &str,
        space: bool,
        view: Option<[f64; 2]>,
        unfold: Option<Vec<f64>>,
        range: Option<[f64; 2]>,
        width: u32,
        extensive: bool,
        ax: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyPicture> {
        let map = slf.get();
        let level = |&found: &i64| self::level("levels", found, map.levels());
        let levels = levels.unwrap_or_default().iter().map(level).collect::<PyResult<_>>()?;
        let values = values.map(|values| one_each("values", values, map.n_taxels())).transpose()?;
        let (patches, unfold) = (patches.unwrap_or_default(), unfold.unwrap_or_default());
        let args = PlotArgs { patches, levels, show, space, view, unfold, range, width, extensive };
        let picture = PyPicture::new(slf, values, args)?;
        if let Some(ax) = ax {
            ax.call_method1("imshow", (picture.array(slf.py())?,))?;
            ax.call_method1("axis", ("off",))?;
        }
        Ok(picture)
    }

    /// Measure lookups on this map and this machine, as `dermatome bench`: times, error bounds and true errors of each
    /// level.
    ///
    /// Returns
    /// -------
    /// dict
    fn bench<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let map = Arc::clone(&self.map);
        json(py, &run(py, 0, move |_| dermatome::contact::measure(&map))?.map_err(error)?)
    }

    /// Find the points of the skin at places on the map of a patch.
    ///
    /// Parameters
    /// ----------
    /// patch : str
    ///     The patch.
    /// uv : (k, 2) array_like
    ///     Places on the map, in m.
    /// level : int
    ///     The level whose map it is.
    ///
    /// Returns
    /// -------
    /// points : (k, 3) float64 array
    ///     In m, in the frame of the patch's link: on level 0 of the skin, above on the mesh of the level.
    /// normals : (k, 3) float64 array
    ///     Outward unit normals there.
    /// off_chart : (k,) float64 array
    ///     How far outside of the map the place is, in m; the point is then that of the nearest place on it.
    #[pyo3(signature = (patch, uv, *, level=0))]
    #[expect(clippy::type_complexity, reason = "a tuple of arrays")]
    fn to_skin<'py>(
        &self,
        py: Python<'py>,
        patch: &str,
        uv: &Bound<'py, PyAny>,
        level: i64,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>)> {
        let patch = self.patch_named(patch)?;
        let level = self::level("level", level, self.map.patches[patch].levels.len())?;
        let uv = places("uv", uv)?;
        let back = self.back(py)?;
        let found = run(py, 0, move |stop| {
            let mut found = Vec::new();
            let mut place = |uv| {
                stop.check();
                found.clear();
                back.places(patch, level, uv, &mut found)?;
                Ok(found.first().map(|place| (place.position, place.normal, place.off_chart)))
            };
            uv.into_iter().map(&mut place).collect::<Result<Vec<_>, dermatome::contact::ContactError>>()
        })?;
        let found = found.map_err(error)?;
        let nowhere = (DVec3::NAN, DVec3::NAN, f64::INFINITY);
        let column = || found.iter().map(|place| place.unwrap_or(nowhere));
        let points = matrix(py, column().map(|place| place.0.to_array()))?;
        let normals = matrix(py, column().map(|place| place.1.to_array()))?;
        Ok((points, normals, vector(py, column().map(|place| place.2))))
    }
}

impl PyMap {
    fn pool_groups<'py>(
        &self,
        py: Python<'py>,
        values: &Bound<'py, PyAny>,
        groups: &GroupPool,
        extensive: bool,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let values = floats("values", values)?;
        let needed = self.n_taxels();
        let Some((_, frames)) = values.shape().split_last().filter(|(last, _)| **last == needed) else {
            return Err(bad_shape("values", values.shape(), format!("shape (..., {needed})")));
        };
        let shape: Vec<usize> = frames.iter().copied().chain([groups.count()]).collect();
        let (pooled, values) = (zeros(py, &shape)?, values.as_slice()?);
        let quantity = if extensive { Quantity::Extensive } else { Quantity::Intensive };
        let mut writer = pooled.readwrite();
        let frames =
            writer.as_slice_mut()?.chunks_mut(groups.count().max(1)).zip(values.chunks(needed.max(1)));
        for (out, values) in frames {
            out.iter_mut().zip(groups.pool(values, quantity)).for_each(|(out, value)| *out = narrow(value));
        }
        Ok(pooled)
    }
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

/// How frames are carried to the fields of a level.
struct Pooling<'a> {
    map: &'a SkinMap,
    level: LevelId,
    extensive: bool,
    contrast: bool,
}

impl Pooling<'_> {
    /// Carries frames of readings one after the other.
    fn pool(&self, values: &[f64], pooled: &mut [f32], stop: &Stop) -> Result<(), dermatome::Error> {
        let Self { map, level, extensive, contrast } = *self;
        let fields = starts(map, level).last().copied().unwrap_or(0);
        let width: usize = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
        if pooled.is_empty() {
            return Ok(());
        }
        let join = Join::new(map, None, width, Duplicates::Refuse)?;
        let channels = channels([extensive]);
        let (restrictor, contrast) = if contrast {
            (Restrictor::new(map, &channels), Some(Contrast::new(map, &channels)))
        } else {
            (Restrictor::to_level(map, &channels, level), None)
        };
        let share = (pooled.len() / fields).div_ceil(4 * rayon::current_num_threads());
        let shares = pooled.par_chunks_mut(share * fields).zip(values.par_chunks(share * width));
        shares.for_each_init(
            || (restrictor.clone(), contrast.clone(), Frame::new(map, 1)),
            |(restrictor, contrast, frame), (out, values)| {
                for (out, values) in out.chunks_mut(fields).zip(values.chunks(width)) {
                    stop.check();
                    join.fill(values, frame);
                    mask_too_large(frame);
                    let mut on_levels = restrictor.restrict(frame);
                    if let Some(contrast) = contrast {
                        on_levels = contrast.of(on_levels);
                    }
                    let patches = on_levels.values.iter().zip(&map.patches);
                    let of_patches =
                        patches.map(|(channels, patch)| &channels[0][patch.nearest_level(level)]);
                    for (out, &value) in out.iter_mut().zip(of_patches.flat_map(|values| values.iter())) {
                        *out = narrow(value);
                    }
                }
            },
        );
        Ok(())
    }
}

/// Masks readings beyond the range of 32-bit numbers, as `Readings.condition` does.
pub(crate) fn mask_too_large(frame: &mut Frame) {
    for x in frame.values.iter_mut().flatten().flat_map(|values| values.iter_mut()) {
        if x.abs() > f64::from(f32::MAX) {
            *x = f64::NAN;
        }
    }
}

/// A number of a result, in 32 bits; NaN beyond their range.
#[expect(clippy::cast_possible_truncation, reason = "readings are given in fewer digits")]
fn narrow(value: f64) -> f32 {
    let value = value as f32;
    if value.is_finite() { value } else { f32::NAN }
}

/// A value as the objects of Python that its JSON stands for.
pub(crate) fn json<'py>(py: Python<'py>, value: &impl serde::Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(value).map_err(|e| bad("report", e, "numbers"))?;
    py.import("json")?.call_method1("loads", (text,))
}

/// One patch of a map.
#[pyclass(frozen, module = "dermatome", name = "Patch")]
#[derive(Debug)]
pub(crate) struct PyPatch {
    map: Py<PyMap>,
    id: PatchId,
    /// int: The number of its first taxel among those of the map.
    #[pyo3(get)]
    start: usize,
}

impl PyPatch {
    fn map(&self) -> &SkinMap {
        &self.map.get().map
    }

    fn patch(&self) -> &PatchMap {
        &self.map().patches[self.id]
    }
}

#[pymethods]
impl PyPatch {
    /// str: Its name.
    #[getter]
    fn name(&self) -> &str {
        &self.patch().name
    }

    /// str: The link it is fixed to.
    #[getter]
    fn link(&self) -> &str {
        &self.map().links[self.patch().link].name
    }

    /// int: Number of its taxels.
    #[getter]
    fn n_taxels(&self) -> usize {
        self.patch().taxels.ids.len()
    }

    /// (n,) uint32 array: Ids of its taxels.
    #[getter]
    fn ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        vector(py, self.patch().taxels.ids.iter().map(|id| id.0))
    }

    /// tuple of Level: Its levels; 0 is the skin itself.
    #[getter]
    fn levels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let level = |level: LevelId| PyLevel { map: self.map.clone_ref(py), patch: self.id, id: level };
        PyTuple::new(
            py,
            self.patch()
                .levels
                .ids()
                .map(level)
                .map(|level| Py::new(py, level))
                .collect::<PyResult<Vec<_>>>()?,
        )
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        made_by(py, "patch", (self.map.clone_ref(py), self.name()))
    }

    fn __repr__(&self) -> String {
        format!(
            "<dermatome.Patch {:?}: {} taxels, {} levels>",
            self.name(),
            self.n_taxels(),
            self.patch().levels.len()
        )
    }
}

/// One level of a patch: a mesh whose vertices are the centres of receptive fields, and its map.
///
/// `n` is the number of vertices, `m` of faces. Where the map is cut, a vertex of the seam has several places on
/// it; `p` is the number of places, elsewhere equal to `n`.
#[pyclass(frozen, module = "dermatome", name = "Level")]
#[derive(Debug)]
pub(crate) struct PyLevel {
    map: Py<PyMap>,
    patch: PatchId,
    id: LevelId,
}

impl PyLevel {
    fn patch(&self) -> &PatchMap {
        &self.map.get().map.patches[self.patch]
    }

    fn of_map(&self) -> &MapLevel {
        &self.patch().levels[self.id]
    }

    fn mesh(&self) -> &Level {
        &self.of_map().level
    }

    fn vectors<'py>(
        &self,
        py: Python<'py>,
        of: impl Fn(VertexId) -> DVec3,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, self.mesh().origins.iter().map(|&taxel| of(taxel).to_array()))
    }
}

#[pymethods]
impl PyLevel {
    /// int: Its number; 0 is the skin itself.
    #[getter]
    fn number(&self) -> usize {
        self.id.index()
    }

    /// (n, 3) float64 array: Positions in the frame of the link, in m.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, self.mesh().mesh.positions.iter().map(DVec3::to_array))
    }

    /// (n, 3) float64 array: Outward unit normals of the taxels at the centres.
    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let taxels = &self.patch().taxels;
        self.vectors(py, |taxel| taxels.normals[taxel])
    }

    /// (n, 3) float64 array or None: Unit tangents of the taxels at the centres, the x axes of their frames.
    #[getter]
    fn tangents<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let tangents = self.patch().taxels.tangents.as_ref();
        tangents.map(|tangents| self.vectors(py, |taxel| tangents[taxel])).transpose()
    }

    /// (m, 3) uint32 array: Triangles, counter-clockwise from outside.
    #[getter]
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        matrix(py, self.mesh().mesh.triangles.iter().map(|corners| corners.map(VertexId::raw)))
    }

    /// (e, 2) uint32 array: Pairs of vertices that a side of a face joins, each once, the smaller one first; sorted.
    #[getter]
    fn edges<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let corners = self.mesh().mesh.triangles.iter().map(|corners| corners.map(VertexId::raw));
        let sides = corners.flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]]);
        let edges: BTreeSet<[u32; 2]> = sides.map(|[a, b]| [a.min(b), a.max(b)]).collect();
        matrix(py, edges)
    }

    /// (n,) float64 array: Receptive areas, in m^2.
    #[getter]
    fn areas<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        vector(py, self.mesh().areas.iter().copied())
    }

    /// (n,) uint32 array: The vertex of level 0 that each vertex is.
    #[getter]
    fn origins<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        vector(py, self.mesh().origins.iter().map(|taxel| taxel.raw()))
    }

    /// (n,) uint32 array: Ids of the taxels at the centres.
    #[getter]
    fn taxel_ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        let ids = &self.patch().taxels.ids;
        vector(py, self.mesh().origins.iter().map(|&taxel| ids[taxel].0))
    }

    /// (p, 2) float64 array: Places on the map, in m.
    #[getter]
    fn uv<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, self.of_map().uv.iter().map(|at| at.to_array()))
    }

    /// (m, 3) uint32 array: The triangles as the map has them: their corners are places.
    #[getter]
    fn uv_faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let map = self.of_map();
        matrix(py, self.mesh().mesh.triangles.ids().map(|face| map.places(face).map(|place| place.raw())))
    }

    /// (p,) uint32 array: The vertex that each place is.
    #[getter]
    fn vertex_of_place<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        let map = self.of_map();
        vector(py, map.uv.ids().map(|place| map.vertex_of(place).raw()))
    }

    /// tuple of float: Lower left corner of the image on the map, in m.
    #[getter]
    fn origin(&self) -> (f64, f64) {
        self.of_map().frame.origin.into()
    }

    /// tuple of float: Height and width of the image, in m.
    #[getter]
    fn size(&self) -> (f64, f64) {
        let size = self.of_map().frame.size;
        (size.y, size.x)
    }

    /// tuple of int: Height and width of the image, in pixels.
    #[getter]
    fn pixels(&self) -> (u32, u32) {
        let [width, height] = self.of_map().frame.size_px;
        (height, width)
    }

    /// dict: How faithful the map is.
    #[getter]
    fn distortion<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        json(py, &self.of_map().distortion)
    }

    /// How the vertices depend on those of the next coarser level: (n, vertices of that level), or None on the
    /// coarsest.
    fn up(&self, py: Python<'_>) -> Option<PyMatrix> {
        let up = self.mesh().from_coarser.as_ref()?;
        let mut rows = Rows::new();
        up.indices.ids().for_each(|row| rows.push(up.row(row).map(|(v, w)| (v.index(), w))));
        Some(rows.into_matrix(py, up.coarse_len))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        made_by(py, "level", (self.map.clone_ref(py), &self.patch().name, self.number()))
    }

    fn __repr__(&self) -> String {
        let Level { mesh, .. } = self.mesh();
        let name = &self.patch().name;
        format!(
            "<dermatome.Level {} of {name:?}: {} vertices, {} faces>",
            self.id,
            mesh.positions.len(),
            mesh.triangles.len()
        )
    }
}

/// Build the maps of a skin: coarsen every patch into levels of receptive fields and map each level to the plane.
///
/// Parameters
/// ----------
/// skin : Skin, str or os.PathLike
///     The skin, or a file that `Skin.read` reads.
/// ratio : float, optional
///     Number of vertices of a level over that of the next coarser one; by default about 4.
/// levels : int, optional
///     At most this many levels above level 0.
/// coarsest : int
///     Stop at about this many vertices per patch.
/// method : {"intrinsic", "conformal", "linear"}
///     How maps are computed.
/// energy : {"sum", "symmetric-dirichlet"}
///     What the intrinsic method minimises.
/// angle, area, perimeter : float
///     Weights of the terms of the sum.
/// magnify : float
///     0 true to the area, 1 equal map area per taxel.
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
///     The way that skin faces where seams are preferred, as the inside of limbs.
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
    max_area_ratio=None, seam_side=None, pixel=None, keep_going=false, acuity=None, threads=0, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub(crate) fn build(
    py: Python<'_>,
    skin: &Bound<'_, PyAny>,
    ratio: Option<f64>,
    levels: Option<i64>,
    coarsest: i64,
    method: &str,
    energy: &str,
    angle: f64,
    area: f64,
    perimeter: f64,
    magnify: f64,
    magnify_over: &str,
    overlap: &str,
    boundary: &str,
    cut: Option<&Bound<'_, PyAny>>,
    max_area_ratio: Option<f64>,
    seam_side: Option<&Bound<'_, PyAny>>,
    pixel: Option<f64>,
    keep_going: bool,
    acuity: Option<&Bound<'_, PyAny>>,
    threads: i64,
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
        Err(_) if skin.hasattr("vertices")? => {
            let found = skin.get_type().name()?;
            return Err(bad("skin", found, "a Skin or a file: dermatome.trimesh.skin(mesh) is a Skin"));
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
