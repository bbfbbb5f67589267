//! `Map`: the maps of a skin as arrays.

use std::{
    collections::{HashMap, hash_map::DefaultHasher},
    fs,
    hash::{Hash, Hasher},
    io::Write,
    path::PathBuf,
    sync::{Arc, Mutex, OnceLock, PoisonError},
};

use dermatome::{
    SkinMap,
    body::FieldLevel,
    contact::{IndexOptions, MapIndex},
    id::VertexId,
    io::{
        ExportOptions, IoError, export_map, file_kind, map_from_bytes, map_to_bytes, read_map, read_regions,
        replace_file, share_plane,
    },
    map::{FieldRegions, PatchMap},
    pyramid::LevelId,
    report::measure,
    signal::{Carry, Channel, GroupPool, Quantity},
    skin::{PatchId, Presence},
};
use glam::DVec3;
use numpy::{PyArray1, PyArray2, PyArrayDyn};
use pyo3::{
    prelude::*,
    types::{PyBytes, PyDict, PyMapping, PyTuple},
};

use crate::{
    arguments::{arg, found},
    arrays::{bad_shape, bytes_of, matrix, one_each, places, vector},
    errors::{bad, error, warn},
    index::PyIndex,
    jobs::run,
    level::PyPatch,
    matrix::{PyMatrix, Rows},
    options::{PackArg, PerChannel, channel, count, level},
    plot::{PlotArgs, PyPicture},
    pool::{
        FieldArrays, LevelArg, MapLevel, NamedLevel, Pooling, fields_of, pool_fields, pool_groups,
        pooling_of, pooling_of_fields, starts,
    },
    renderer::{PyRenderer, RenderArgs},
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
    /// What `build` said of it.
    remarks: Vec<String>,
    back: OnceLock<Arc<MapIndex>>,
    regions: OnceLock<FieldRegions>,
    /// The levels without a mesh, ready for contacts.
    named: Mutex<Vec<(FieldLevel, Arc<NamedLevel>)>>,
}

impl PyMap {
    fn new(map: SkinMap, file: Vec<u8>) -> Self {
        let (map, file, remarks) = (Arc::new(map), file.into(), Vec::new());
        let named = Mutex::default();
        Self { map, file, remarks, back: OnceLock::new(), regions: OnceLock::new(), named }
    }

    /// The map of a file.
    pub(crate) fn of_file(file: Vec<u8>) -> Result<Self, IoError> {
        Ok(Self::new(map_from_bytes(file.clone())?, file))
    }

    /// The same map, of which this was said when it was built.
    pub(crate) fn with_remarks(self, remarks: Vec<String>) -> Self {
        Self { remarks, ..self }
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
    pub(crate) fn regions_of_fields(&self) -> &FieldRegions {
        self.regions.get_or_init(|| FieldRegions::new(&self.map))
    }

    /// A level without a mesh, made ready when it is first needed.
    pub(crate) fn named_level(&self, at: FieldLevel) -> Arc<NamedLevel> {
        let mut made = self.named.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, known)) = made.iter().find(|(known, _)| *known == at) {
            return Arc::clone(known);
        }
        let level = Arc::new(NamedLevel::new(&self.map, at));
        made.push((at, Arc::clone(&level)));
        level
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
    ///
    /// Raises
    /// ------
    /// MissingFileError, FileError
    ///     If it does not exist, or cannot be read.
    /// DataError
    ///     If it is no map, or damaged.
    #[staticmethod]
    fn read(py: Python<'_>, #[pyo3(from_py_with = arg)] path: PathBuf) -> PyResult<Self> {
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
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the content is no map, or damaged.
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
    ///
    /// Raises
    /// ------
    /// FileError
    ///     If it cannot be written.
    /// DataError
    ///     If the extension is another than .glb.
    fn write(&self, py: Python<'_>, #[pyo3(from_py_with = arg)] path: PathBuf) -> PyResult<()> {
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
    /// Raises
    /// ------
    /// MissingFileError, FileError
    ///     If it does not exist, or cannot be read.
    /// FileError
    ///     If a file cannot be written.
    /// DataError
    ///     If the kind, the patch or the level is unknown, or the robot does not fit.
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
        #[pyo3(from_py_with = arg)] path: PathBuf,
        #[pyo3(from_py_with = arg)] level: i64,
        #[pyo3(from_py_with = arg)] patch: Option<&str>,
        #[pyo3(from_py_with = arg)] robot: Option<PathBuf>,
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

    /// tuple of str: What `build` said of this map and its skin, as the notes of the command: what was changed, left out or cut,
    /// and what is poor. Empty for a map that was read, unpickled or changed.
    #[getter]
    fn remarks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, &self.remarks)
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
    pub(crate) fn n_taxels(&self) -> usize {
        self.map.patches.iter().map(|patch| patch.taxels.ids.len()).sum()
    }

    /// int: Number of levels of the patch that has most.
    #[getter]
    fn n_levels(&self) -> usize {
        self.levels()
    }

    /// tuple of str: The names of the levels without a mesh: of the whole body, as "body.L0", and of modalities besides touch, as
    /// "arm.thermal.L0" and "body.thermal.L0".
    #[getter]
    fn field_levels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.map.field_levels().map(|(_, name)| name).collect::<Vec<_>>())
    }

    /// (N,) uint32 array: Ids of the taxels.
    #[getter]
    fn ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        vector(py, self.taxels(|_, patch| patch.taxels.ids.iter().map(|id| id.0).collect()))
    }

    /// (N,) uint8 array: 1 a working taxel, 0 none, 2 a thermal pad, 3 another sensor.
    #[getter]
    fn present<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u8>> {
        let code = |presence: &Presence| match presence {
            Presence::Absent => 0,
            Presence::Present => 1,
            Presence::ThermalPad => 2,
            Presence::Other => 3,
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
    /// Raises
    /// ------
    /// MissingFileError, FileError
    ///     If it does not exist, or cannot be read.
    /// DataError
    ///     If an id is of no taxel or of several, or a line of the table cannot be used.
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
            let mut homes: HashMap<u32, (PatchId, VertexId, usize)> = HashMap::new();
            for (id, patch) in map.patches.enumerate() {
                for (v, taxel) in patch.taxels.ids.enumerate() {
                    homes.entry(taxel.0).or_insert((id, v, 0)).2 += 1;
                }
            }
            for item in named.items()?.iter() {
                let (name, ids): (String, Bound<'_, PyAny>) =
                    item.extract().map_err(|_| bad("regions", found(&item), "names of regions"))?;
                let read = || ids.try_iter()?.map(|id| id?.extract()).collect::<PyResult<_>>();
                let ids: Vec<u32> =
                    read().map_err(|_| bad(&format!("regions[{name:?}]"), found(&ids), "ids of taxels"))?;
                let home = |id: &u32| match homes.get(id) {
                    Some(&(patch, v, 1)) => Ok((patch, v)),
                    Some((.., count)) => {
                        let needed = format!("the id of one taxel, not of {count}; polygons name them, too");
                        Err(bad("regions", id, needed))
                    }
                    None => Err(bad("regions", id, "the id of a taxel of the map")),
                };
                let taxels: Vec<_> = ids.iter().map(home).collect::<PyResult<_>>()?;
                map.set_regions(taxels, &name).map_err(error)?;
            }
        } else {
            let needed = "a mapping of names to ids of taxels, a table, or \"link\"";
            let path: PathBuf = regions.extract().map_err(|_| bad("regions", found(regions), needed))?;
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
    ///     Readings in the order of the map; NaN or infinite where there is none.
    /// extensive : bool
    ///     Whether they are amounts, as forces, which are summed, and not averages, as pressures, which are weighted by the
    ///     areas of the taxels.
    /// modality : str, optional
    ///     Of which modality besides touch they are, as "thermal" (`Readings.modalities` says so).
    ///
    /// Returns
    /// -------
    /// (..., R) float32 array
    ///     One value for each of `regions`; NaN where no taxel of a region has a reading.
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the shape is another.
    #[pyo3(signature = (values, *, extensive=false, modality=None))]
    fn pool_regions<'py>(
        &self,
        py: Python<'py>,
        values: &Bound<'py, PyAny>,
        #[pyo3(from_py_with = arg)] extensive: bool,
        #[pyo3(from_py_with = arg)] modality: Option<&str>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let channel = channel(&self.map, extensive, modality)?;
        pool_groups(py, &self.map, values, &GroupPool::of_regions(&self.map, &channel), channel.quantity)
    }

    /// As `pool_regions`, for groups of taxels with numbers below `count`, -1 for none.
    #[pyo3(signature = (values, groups, count, *, extensive=false, modality=None))]
    fn _pool_groups<'py>(
        &self,
        py: Python<'py>,
        values: &Bound<'py, PyAny>,
        groups: Vec<i64>,
        count: usize,
        extensive: bool,
        modality: Option<&str>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let needed = self.n_taxels();
        if groups.len() != needed {
            return Err(bad_shape("groups", &[groups.len()], format!("shape ({needed},)")));
        }
        let groups = groups.into_iter().map(|group| usize::try_from(group).ok());
        let channel = channel(&self.map, extensive, modality)?;
        let groups = GroupPool::new(&self.map, &channel, groups, count);
        pool_groups(py, &self.map, values, &groups, channel.quantity)
    }

    /// dict or None: The map of another skin that this one is drawn on: its "name" and "hash", and whether this one is
    /// "mirrored"; None for a free map.
    #[getter]
    fn atlas<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(on) = &self.map.atlas else { return Ok(None) };
        let atlas = PyDict::new(py);
        atlas.set_item("name", &on.name)?;
        atlas.set_item("hash", format!("{:016x}", on.hash))?;
        atlas.set_item("mirrored", on.is_mirrored)?;
        Ok(Some(atlas))
    }

    /// Make the matrix that carries readings to the taxels of another skin on the same atlas.
    ///
    /// One map is drawn on the other, or both on a third. Taxels that lie off the other skin are said by a DermatomeWarning, as
    /// are taxels of the other skin where none of this one lies: their row is empty.
    ///
    /// Parameters
    /// ----------
    /// other : Map
    ///     The map of the other skin.
    /// extensive : bool
    ///     Whether readings are amounts, as forces, whose sum is kept; or averages, as pressures, whose mean by area is.
    ///
    /// Returns
    /// -------
    /// Matrix
    ///     A row for each taxel of the other skin, a column for each of this one, both in the order of their maps.
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the maps are drawn on different ones.
    ///
    /// Examples
    /// --------
    /// >>> import dermatome
    /// >>> grid = [[0.005 * x, 0.005 * y, 0] for y in range(12) for x in range(9)]
    /// >>> palm = dermatome.build(dermatome.Skin.from_arrays(grid, patch="palm"))
    /// >>> palm.carry_to(palm, extensive=True).shape
    /// (108, 108)
    #[pyo3(signature = (other, *, extensive=false))]
    fn carry_to(
        &self,
        py: Python<'_>,
        other: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = arg)] extensive: bool,
    ) -> PyResult<PyMatrix> {
        let Ok(other) = other.cast::<PyMap>() else {
            return Err(bad("other", other.get_type().name()?, "a Map"));
        };
        let (from, to) = (Arc::clone(&self.map), Arc::clone(&other.get().map));
        let taxels: usize = from.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
        let made = run(py, 0, move |_| -> Result<_, dermatome::Error> {
            if !share_plane(&from, &to)? {
                return Ok(None);
            }
            Ok(Some(Carry::new(&from, &to)?))
        })?;
        let found = "a map that is drawn on another one";
        let needed = "a map on the same atlas: build(..., atlas=)";
        let carry = made.map_err(error)?.ok_or_else(|| bad("other", found, needed))?;
        let (outside, unreached) = (carry.outside().len(), carry.unreached());
        for (count, what) in [
            (outside, "taxels lie off the other skin: their readings are left out"),
            (unreached, "taxels of the other skin have no reading: no taxel of this one lies there"),
        ] {
            if count > 0 {
                warn(py, &format!("{count} {what}"))?;
            }
        }
        let mut rows = Rows::new();
        carry.weights(if extensive { Quantity::Extensive } else { Quantity::Intensive }).for_each(|row| {
            rows.push(row.into_iter().map(|(taxel, weight)| (taxel as usize, weight)));
        });
        Ok(rows.into_matrix(py, taxels))
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
    /// level : int or str
    ///     The level; patches without it count those of their coarsest. Or one of `Map.field_levels`, as "body.L0".
    ///
    /// Returns
    /// -------
    /// int
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the map has no such level.
    fn n_fields(&self, #[pyo3(from_py_with = arg)] level: LevelArg) -> PyResult<usize> {
        Ok(match level.of(&self.map)? {
            MapLevel::Patches(level) => starts(&self.map, level).last().copied().unwrap_or(0),
            MapLevel::Fields(at) => self.map.fields_of(at).map_or(0, |fields| fields.origins.len()),
        })
    }

    /// The named region of each field of a level: the one whose taxels have the largest sum of weights in it.
    ///
    /// Parameters
    /// ----------
    /// level : int or str
    ///     The level, or one of `Map.field_levels`, as "body.L0".
    ///
    /// Returns
    /// -------
    /// (n,) int32 array
    ///     Its number in `regions`, -1 for none, in the order of `pool`.
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the map has no such level.
    fn field_regions<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = arg)] level: LevelArg,
    ) -> PyResult<Bound<'py, PyArray1<i32>>> {
        let level = match level.of(&self.map)? {
            MapLevel::Fields(at) => return Ok(vector(py, self.named_level(at).regions.clone())),
            MapLevel::Patches(level) => level,
        };
        let regions = self.regions_of_fields();
        let of_patch = |id, patch: &PatchMap| {
            let level = patch.nearest_level(level);
            let region = |field| regions.region(id, level, field).map_or(-1, |region| region.raw() as i32);
            patch.levels[level].level.mesh.positions.ids().map(region).collect()
        };
        Ok(vector(py, self.taxels(of_patch)))
    }

    /// The name of a patch in the names of its levels, as the command writes them.
    fn _name_in_levels(&self, #[pyo3(from_py_with = arg)] patch: &str) -> String {
        self.map.name_in_levels(patch).into_owned()
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
    /// Raises
    /// ------
    /// DataError
    ///     If the map has no such level.
    ///
    /// Examples
    /// --------
    /// >>> import dermatome
    /// >>> palm = dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(12) for x in range(12)])
    /// >>> skin_map = dermatome.build(palm)
    /// >>> patch, level, index = skin_map.fields(1)
    /// >>> len(patch) == skin_map.n_fields(1) == len(skin_map.patches["skin"].levels[1].positions)
    /// True
    fn fields<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = arg)] level: i64,
    ) -> PyResult<FieldArrays<'py>> {
        let level = self::level("level", level, self.levels())?;
        Ok(fields_of(py, &self.map, level))
    }

    /// How the taxels depend on the receptive fields of a level: the law of fields.
    ///
    /// Row `i` holds the weights, with sum 1, of at most three fields of taxel `i`. This is the law from the taxels to
    /// each level at once, that of `pool`, the images and the files; the product of `Level.up` is another. With `P` this matrix, `a` the
    /// areas of the taxels and `m` 1 where there is a reading, a pressure `p` becomes `P.T @ (a m p) / P.T @ (a m)`
    /// on the fields and a force `f` becomes `P.T @ (m f)`.
    ///
    /// Parameters
    /// ----------
    /// level : int or str
    ///     The level, 0 for the taxels themselves, or one of the whole body, as "body.L0".
    /// patch : str, optional
    ///     The patch; by default all, whose taxels and fields follow each other in the order of the map. Patches
    ///     without this level have those of their coarsest.
    ///
    /// Returns
    /// -------
    /// Matrix
    ///     (taxels, fields).
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the map has no such level or patch.
    #[pyo3(signature = (level, *, patch=None))]
    fn pooling(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = arg)] level: LevelArg,
        #[pyo3(from_py_with = arg)] patch: Option<&str>,
    ) -> PyResult<PyMatrix> {
        let level = level.of(&self.map)?;
        let only = patch.map(|name| self.patch_named(name)).transpose()?;
        match level {
            MapLevel::Patches(level) => Ok(pooling_of(py, &self.map, level, only)),
            MapLevel::Fields(at) => pooling_of_fields(py, &self.map, at, only),
        }
    }

    /// Carry readings of the taxels to the receptive fields of a level.
    ///
    /// Parameters
    /// ----------
    /// values : (..., N) array_like
    ///     Readings in the order of the map; NaN or infinite where there is none. Taxels that are not present have none; of the level of
    ///     a modality those that are no sensors of it.
    /// level : int or str
    ///     The level, or one of `Map.field_levels`, as "body.L0" or "arm.thermal.L0", which have no contrast.
    /// extensive : bool
    ///     Whether they are amounts, as forces, which are summed, and not averages, as pressures.
    /// contrast : bool
    ///     Whether what the level shows beyond the next coarser one is returned instead.
    /// modality : str, optional
    ///     Of which modality besides touch they are, as "thermal" (`Readings.modalities` says so): on patches with sensors of it
    ///     these have readings, and no other taxel. A level of a modality has that.
    /// threads : int
    ///     0 for one per processor.
    ///
    /// Returns
    /// -------
    /// (..., n) float32 array
    ///     One value for each field of the level, patch after patch; NaN where all taxels of a field have none.
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the shape is another, or the map has no such level.
    ///
    /// Examples
    /// --------
    /// >>> import dermatome, numpy as np
    /// >>> grid = [[0.005 * x, 0.005 * y, 0] for y in range(12) for x in range(12)]
    /// >>> skin_map = dermatome.build(dermatome.Skin.from_arrays(grid))
    /// >>> pooled = skin_map.pool(np.full((5, 144), 2.5), level=1)
    /// >>> len(pooled), bool(np.all(pooled == 2.5))
    /// (5, True)
    #[pyo3(signature = (values, level, *, extensive=false, contrast=false, modality=None, threads=0))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn pool<'py>(
        &self,
        py: Python<'py>,
        values: &Bound<'py, PyAny>,
        #[pyo3(from_py_with = arg)] level: LevelArg,
        #[pyo3(from_py_with = arg)] extensive: bool,
        #[pyo3(from_py_with = arg)] contrast: bool,
        #[pyo3(from_py_with = arg)] modality: Option<&str>,
        #[pyo3(from_py_with = arg)] threads: i64,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let channel = channel(&self.map, extensive, modality)?;
        let level = match level.of(&self.map)? {
            MapLevel::Patches(level) => level,
            MapLevel::Fields(_) if contrast => {
                return Err(bad("contrast", "True", "False for a level of the whole body or of a modality"));
            }
            MapLevel::Fields(at) => {
                return pool_fields(py, &self.map, values, at, &channel, count("threads", threads)?);
            }
        };
        let (threads, pooling) =
            (count("threads", threads)?, Pooling { map: &self.map, level, channel, contrast });
        pooling.pool(py, values, threads)
    }

    /// Of which modality besides touch the readings of a channel are, as "thermal": one whose sensors the map has, by the name
    /// or the unit of the channel; else None.
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the unit is not known.
    #[pyo3(signature = (channel, unit=""))]
    fn modality(
        &self,
        #[pyo3(from_py_with = arg)] channel: &str,
        #[pyo3(from_py_with = arg)] unit: &str,
    ) -> PyResult<Option<String>> {
        let channel = Channel::new(channel, unit).map_err(error)?;
        Ok(channel.modality(&self.map).map(str::to_owned))
    }

    /// (N,) bool array: Which taxels the readings of a modality are of; of None, those of touch.
    #[pyo3(signature = (modality=None))]
    fn _read<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = arg)] modality: Option<&str>,
    ) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let is_read = channel(&self.map, false, modality)?.taxels(&self.map);
        Ok(vector(py, is_read.iter().flatten().copied()))
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
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the number of threads cannot be used.
    #[pyo3(signature = (*, reactive=false, fields=false, threads=0))]
    fn index(
        slf: &Bound<'_, Self>,
        #[pyo3(from_py_with = arg)] reactive: bool,
        #[pyo3(from_py_with = arg)] fields: bool,
        #[pyo3(from_py_with = arg)] threads: i64,
    ) -> PyResult<PyIndex> {
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
    ///     Number of channels of the readings, C; by default as many as `extensive` or `modality` has, or any.
    /// extensive : bool, or a sequence of one for each channel
    ///     Whether readings are amounts, as forces, and not averages, as pressures; `Readings.extensive` says so.
    /// modality : str, or a sequence of one or None for each channel, optional
    ///     Of which modality besides touch readings are, as "thermal"; `Readings.modalities` says so. On patches with sensors of
    ///     it these have readings, and no other taxel.
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
    /// atlas : Map, optional
    ///     Draw on the canvas of this map, with its patches, sizes and pixels: the one that this map is drawn on, or another
    ///     one on the same.
    ///
    /// Returns
    /// -------
    /// Renderer
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the map has no such level or patch, or size, pixel, channels, pack or fill cannot be used together.
    #[pyo3(signature = (level=0, *, patch=None, channels=None, extensive=None, modality=None, size=None,
        pixel=None, pack=None, fill=None, mask=false, atlas=None))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn renderer(
        slf: &Bound<'_, Self>,
        #[pyo3(from_py_with = arg)] level: i64,
        #[pyo3(from_py_with = arg)] patch: Option<String>,
        #[pyo3(from_py_with = arg)] channels: Option<i64>,
        extensive: Option<&Bound<'_, PyAny>>,
        modality: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = arg)] size: Option<[u32; 2]>,
        #[pyo3(from_py_with = arg)] pixel: Option<f64>,
        #[pyo3(from_py_with = arg)] pack: Option<PackArg>,
        #[pyo3(from_py_with = arg)] fill: Option<f32>,
        #[pyo3(from_py_with = arg)] mask: bool,
        atlas: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyRenderer> {
        let pack = pack.map(PackArg::read).transpose()?.flatten();
        let extensive = PerChannel::read("extensive", extensive, "True or False")?;
        let modality = PerChannel::read("modality", modality, "a name")?;
        let args = RenderArgs { level, patch, channels, extensive, modality, size, pixel, pack, fill, mask };
        let canvas = match atlas.map(|atlas| (atlas, atlas.cast::<PyMap>())) {
            None => None,
            Some((_, Ok(canvas))) => Some(canvas.clone().unbind()),
            Some((other, Err(_))) => return Err(bad("atlas", other.get_type().name()?, "a Map")),
        };
        PyRenderer::new(slf, args, canvas)
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
    ///     Values at the ends of the scale of colours, in the unit of the values.
    /// width : int
    ///     Width of the picture, in pixels.
    /// extensive : bool
    ///     Whether readings are amounts, as forces.
    /// modality : str, optional
    ///     Of which modality besides touch they are, as "thermal"; `Readings.modalities` says so.
    /// ax : matplotlib.axes.Axes, optional
    ///     Axes that show it, too: fields or readings of one patch and level (by default the finest) in map coordinates, in m,
    ///     so that what else is drawn there has its place; of several, and what `show`, `space` or `unfold` ask for, the picture.
    ///
    /// Returns
    /// -------
    /// Picture
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the shape is another, the map has no such patch or level, or a number is out of its range.
    #[pyo3(signature = (values=None, *, patches=None, levels=None, show="fields", space=false, view=None, unfold=None,
        range=None, width=1600, extensive=false, modality=None, ax=None))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn plot(
        slf: &Bound<'_, Self>,
        values: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = arg)] patches: Option<Vec<String>>,
        #[pyo3(from_py_with = arg)] levels: Option<Vec<i64>>,
        #[pyo3(from_py_with = arg)] show: &str,
        #[pyo3(from_py_with = arg)] space: bool,
        #[pyo3(from_py_with = arg)] view: Option<[f64; 2]>,
        #[pyo3(from_py_with = arg)] unfold: Option<Vec<f64>>,
        #[pyo3(from_py_with = arg)] range: Option<[f64; 2]>,
        #[pyo3(from_py_with = arg)] width: u32,
        #[pyo3(from_py_with = arg)] extensive: bool,
        #[pyo3(from_py_with = arg)] modality: Option<String>,
        ax: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyPicture> {
        if let Some(ax) = ax.filter(|ax| !ax.hasattr("imshow").unwrap_or(false)) {
            return Err(bad("ax", found(ax), "axes of matplotlib"));
        }
        let map = slf.get();
        let level = |&found: &i64| self::level("levels", found, map.levels());
        let levels: Vec<LevelId> = levels.unwrap_or_default().iter().map(level).collect::<PyResult<_>>()?;
        let values = values.map(|values| one_each("values", values, map.n_taxels())).transpose()?;
        let (patches, unfold) = (patches.unwrap_or_default(), unfold.unwrap_or_default());
        // What axes show in map coordinates.
        let is_plain = show == "fields" && !space && view.is_none() && unfold.is_empty();
        let one = match (&patches[..], &levels[..]) {
            ([_], []) => Some(0),
            ([], []) if map.map.patches.len() == 1 => Some(0),
            ([_], [level]) => Some(level.index()),
            ([], [level]) if map.map.patches.len() == 1 => Some(level.index()),
            _ => None,
        };
        let one = one.filter(|_| is_plain).map(|level| (patches.first().cloned(), level));
        let args = PlotArgs { patches, levels, show, space, view, unfold, range, width, extensive, modality };
        let picture = PyPicture::new(slf, values, args)?;
        if let Some(ax) = ax {
            picture.show_on(ax, one)?;
        }
        Ok(picture)
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
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the map has no such patch or level, or the shape is another.
    #[pyo3(signature = (patch, uv, *, level=0))]
    #[expect(clippy::type_complexity, reason = "a tuple of arrays")]
    fn to_skin<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = arg)] patch: &str,
        uv: &Bound<'py, PyAny>,
        #[pyo3(from_py_with = arg)] level: i64,
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

/// A value as the objects of Python that its JSON stands for.
pub(crate) fn json<'py>(py: Python<'py>, value: &impl serde::Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(value).map_err(|e| bad("report", e, "numbers"))?;
    py.import("json")?.call_method1("loads", (text,))
}
