//! `Hits` and `Fields`: what was found near points of space, as arrays.

use dermatome::{
    SkinMap,
    contact::{Cell, ContactIndex, FieldHit, Hit, Hits},
    id::FaceId,
    pyramid::LevelId,
    skin::{LinkId, PatchId},
};
use glam::DVec3;
use numpy::{PyArray1, PyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::{
    arrays::{Reduced, matrix, reduced, vector},
    map::PyMap,
    matrix::{PyMatrix, Rows},
    pool::{MapLevel, NamedLevel, starts},
};

/// Fewest queries for a task.
pub(crate) const FEW: usize = 64;

/// The points of the skin that were found, one entry for each query in their order.
///
/// A query without an answer has the patch -1, and NaN in arrays of real numbers. What concerns the map is None if
/// it was asked for without a level.
#[pyclass(frozen, get_all, module = "dermatome", name = "Hits")]
#[derive(Debug, FromPyObject)]
pub(crate) struct PyHits {
    /// (k,) int32 array: Number of the patch.
    pub(crate) patch: Py<PyArray1<i32>>,
    /// (k,) int32 array: Number of its link.
    pub(crate) link: Py<PyArray1<i32>>,
    /// (k,) int64 array: The face, on level 0 of the patch.
    face: Py<PyArray1<i64>>,
    /// (k, 3) float64 array: Barycentric coordinates in the face.
    barycentric: Py<PyArray2<f64>>,
    /// (k,) float64 array: Distance from the skin, negative inside; of a ray that from its origin. In m.
    distance: Py<PyArray1<f64>>,
    /// (k, 3) float64 array: The point on the skin, in the frame of the query, in m.
    point: Py<PyArray2<f64>>,
    /// (k, 3) float64 array: The outward unit normal there, in the same frame.
    normal: Py<PyArray2<f64>>,
    /// (k,) float64 array or None: Of `Index.reactive`, at least how far the skin is, without sign, in m.
    least: Option<Py<PyArray1<f64>>>,
    /// (k,) float64 array or None: Of `Index.reactive`, at most how far the skin is, without sign, in m.
    most: Option<Py<PyArray1<f64>>>,
    /// (k,) int32 array or None: The level of what follows.
    pub(crate) level: Option<Py<PyArray1<i32>>>,
    /// (k, 2) float64 array or None: Place on the map of the level, in m; None for a level of the whole body or of a modality.
    pub(crate) uv: Option<Py<PyArray2<f64>>>,
    /// (k, 2) uint32 array or None: Row (from the top) and column of its pixel; None as for `uv`.
    pixel: Option<Py<PyArray2<u32>>>,
    /// (k,) int64 array or None: The receptive field with the largest weight, a vertex of the level; on level 0 a taxel. Of a level
    /// of the whole body or of a modality its number there, -1 where the patch has no such fields.
    field: Option<Py<PyArray1<i64>>>,
    /// (k,) uint32 array or None: Id of the taxel at its centre.
    taxel_id: Option<Py<PyArray1<u32>>>,
    /// (k,) int32 array or None: Number of the named region of that field in `Map.regions`, -1 for none.
    region: Option<Py<PyArray1<i32>>>,
    /// Matrix or None: Weights of all fields of the level, (k, fields of the whole map in its order, as `Map.pool` has them).
    fields: Option<Py<PyMatrix>>,
}

#[pymethods]
impl PyHits {
    fn __len__(&self, py: Python<'_>) -> usize {
        self.patch.bind(py).len()
    }

    #[staticmethod]
    fn _of(state: Self) -> Self {
        state
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py>> {
        let of_skin =
            ["patch", "link", "face", "barycentric", "distance", "point", "normal", "least", "most"];
        let of_map = ["level", "uv", "pixel", "field", "taxel_id", "region", "fields"];
        reduced(slf, &[&of_skin[..], &of_map[..]].concat())
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        format!("<dermatome.Hits: {} points>", self.__len__(py))
    }
}

/// The receptive fields near each query; on level 0 the taxels.
///
/// Those of query `i` are the entries `indptr[i]` to `indptr[i + 1]` of the other arrays.
#[pyclass(frozen, get_all, module = "dermatome", name = "Fields")]
#[derive(Debug, FromPyObject)]
pub(crate) struct PyFields {
    /// (k + 1,) int64 array: Where the fields of each query begin, and the end of the last.
    indptr: Py<PyArray1<i64>>,
    /// (j,) int32 array: Number of the patch.
    patch: Py<PyArray1<i32>>,
    /// (j,) int32 array: Its level.
    level: Py<PyArray1<i32>>,
    /// (j,) int64 array: The field, a vertex of the level; on level 0 a taxel.
    field: Py<PyArray1<i64>>,
    /// (j,) uint32 array: Id of the taxel at its centre.
    taxel_id: Py<PyArray1<u32>>,
    /// (j,) float64 array: Distance of its centre from the query, in m.
    distance: Py<PyArray1<f64>>,
    /// (j, 3) float64 array: Its centre, in the frame of the query, in m.
    point: Py<PyArray2<f64>>,
    /// (j, 3) float64 array: The outward unit normal there, in the same frame.
    normal: Py<PyArray2<f64>>,
}

#[pymethods]
impl PyFields {
    fn __len__(&self, py: Python<'_>) -> usize {
        self.indptr.bind(py).len() - 1
    }

    #[staticmethod]
    fn _of(state: Self) -> Self {
        state
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py>> {
        reduced(slf, &["indptr", "patch", "level", "field", "taxel_id", "distance", "point", "normal"])
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let (queries, fields) = (self.__len__(py), self.patch.bind(py).len());
        format!("<dermatome.Fields: {fields} of {queries} queries>")
    }
}

/// Answers as they come from the library, before they are arrays.
#[derive(Debug, Default)]
pub(crate) struct Answers {
    pub(crate) hits: Hits,
    /// Which queries have none.
    pub(crate) missing: Vec<bool>,
    pub(crate) ranges: Option<[Vec<f64>; 2]>,
    /// With the level that was asked for; patches that do not reach up to it may have cells on their coarsest.
    pub(crate) cells: Option<(MapLevel, Vec<Option<Cell>>)>,
}

/// Answers as the numbers of arrays.
#[derive(Debug)]
pub(crate) struct Columns {
    patch: Vec<i32>,
    link: Vec<i32>,
    face: Vec<i64>,
    barycentric: Vec<[f64; 3]>,
    distance: Vec<f64>,
    point: Vec<[f64; 3]>,
    normal: Vec<[f64; 3]>,
    ranges: Option<[Vec<f64>; 2]>,
    cells: Option<CellColumns>,
}

#[derive(Debug)]
struct CellColumns {
    of: MapLevel,
    level: Vec<i32>,
    uv: Vec<[f64; 2]>,
    pixel: Vec<[u32; 2]>,
    field: Vec<i64>,
    taxel: Vec<u32>,
    weights: Rows,
    /// How many the level has.
    fields: usize,
}

impl Answers {
    /// Takes the answers of queries that are not known.
    pub(crate) fn leave_out(&mut self, known: &[bool]) {
        self.missing.resize(known.len(), false);
        for (k, _) in known.iter().enumerate().filter(|(_, is_known)| !**is_known) {
            self.missing[k] = true;
            self.hits.barycentric[k] = [f64::NAN; 3];
            self.hits.distance[k] = f64::NAN;
            self.hits.position[k] = DVec3::NAN;
            self.hits.normal[k] = DVec3::NAN;
            self.ranges.iter_mut().flatten().for_each(|ends| ends[k] = f64::NAN);
        }
    }

    pub(crate) fn into_columns(self, map: &SkinMap) -> Columns {
        let Self { hits, missing, ranges, cells } = self;
        let cells = cells.map(|(level, cells)| CellColumns::new(level, &cells, &hits.patch, map));
        let is_missing = |k: usize| missing.get(k).copied().unwrap_or(false);
        let number = |(k, id): (usize, u32)| if is_missing(k) { -1 } else { id as i32 };
        let face = |(k, id): (usize, FaceId)| if is_missing(k) { -1 } else { i64::from(id.raw()) };
        let vectors = |from: Vec<DVec3>| from.into_iter().map(|p| p.to_array()).collect();
        let ((point, normal), ((patch, link), face)) = rayon::join(
            || rayon::join(|| vectors(hits.position), || vectors(hits.normal)),
            || {
                let patch = || hits.patch.into_iter().map(PatchId::raw).enumerate().map(number).collect();
                let link = || hits.link.into_iter().map(LinkId::raw).enumerate().map(number).collect();
                rayon::join(
                    || (patch(), link()),
                    || hits.face.into_par_iter().with_min_len(FEW).enumerate().map(face).collect(),
                )
            },
        );
        let (barycentric, distance) = (hits.barycentric, hits.distance);
        Columns { patch, link, face, barycentric, distance, point, normal, ranges, cells }
    }
}

impl Columns {
    /// The same as arrays.
    pub(crate) fn into_hits(self, py: Python<'_>, map: &PyMap) -> PyResult<PyHits> {
        let Self { patch, link, face, barycentric, distance, point, normal, ranges, cells } = self;
        let [least, most] = ranges.map_or([None, None], |ranges| ranges.map(Some));
        let patches = if cells.is_some() { patch.clone() } else { Vec::new() };
        let mut found = PyHits {
            patch: vector(py, patch).unbind(),
            link: vector(py, link).unbind(),
            face: vector(py, face).unbind(),
            barycentric: matrix(py, barycentric)?.unbind(),
            distance: vector(py, distance).unbind(),
            point: matrix(py, point)?.unbind(),
            normal: matrix(py, normal)?.unbind(),
            least: least.map(|least| vector(py, least).unbind()),
            most: most.map(|most| vector(py, most).unbind()),
            level: None,
            uv: None,
            pixel: None,
            field: None,
            taxel_id: None,
            region: None,
            fields: None,
        };
        if let Some(CellColumns { of, level, uv, pixel, field, taxel, weights, fields }) = cells {
            let regions = map.regions_of_fields();
            let region_of = |(&patch, (&level, &field)): (&i32, (&i32, &i64))| {
                let id = |number: i64| u32::try_from(number).ok();
                let region = Option::zip(id(patch.into()), Option::zip(id(level.into()), id(field)));
                let region = region.and_then(|(patch, (level, field))| {
                    regions.region(patch.into(), level.into(), field.into())
                });
                region.map_or(-1, |region| region.raw() as i32)
            };
            let places = patches.iter().zip(level.iter().zip(&field));
            let regions: Vec<i32> = match of {
                MapLevel::Patches(_) => places.map(region_of).collect(),
                MapLevel::Fields(at) => {
                    let named = map.named_level(at);
                    let of_field =
                        |&field: &i64| usize::try_from(field).ok().and_then(|k| named.regions.get(k));
                    field.iter().map(|field| of_field(field).copied().unwrap_or(-1)).collect()
                }
            };
            found.region = Some(vector(py, regions).unbind());
            found.level = Some(vector(py, level).unbind());
            if let MapLevel::Patches(_) = of {
                found.uv = Some(matrix(py, uv)?.unbind());
                found.pixel = Some(matrix(py, pixel)?.unbind());
            }
            found.field = Some(vector(py, field).unbind());
            found.taxel_id = Some(vector(py, taxel).unbind());
            found.fields = Some(Py::new(py, weights.into_matrix(py, fields))?);
        }
        Ok(found)
    }
}

impl CellColumns {
    fn new(of: MapLevel, cells: &[Option<Cell>], patches: &[PatchId], map: &SkinMap) -> Self {
        fn column<T: Send>(cells: &[Option<Cell>], of: impl Fn(Option<&Cell>) -> T + Sync) -> Vec<T> {
            cells.par_iter().with_min_len(FEW).map(|cell| of(cell.as_ref())).collect()
        }
        // Where the fields of each patch begin; those of the whole body or of a modality are numbered together.
        let (starts, fields) = match of {
            MapLevel::Patches(level) => {
                let starts = starts(map, level);
                let fields = starts.last().copied().unwrap_or(0);
                (starts, fields)
            }
            MapLevel::Fields(at) => {
                (vec![0; map.patches.len()], map.fields_of(at).map_or(0, |fields| fields.origins.len()))
            }
        };
        let mut weights = Rows::new();
        for (cell, patch) in cells.iter().zip(patches) {
            match cell {
                Some(cell) => {
                    weights.push(cell.weights.iter().map(|(v, w)| (starts[patch.index()] + v.index(), w)));
                }
                None => weights.push([]),
            }
        }
        Self {
            of,
            level: column(cells, |cell| cell.map_or(-1, |cell| cell.level.raw() as i32)),
            uv: column(cells, |cell| cell.map_or([f64::NAN; 2], |cell| cell.uv.to_array())),
            pixel: column(cells, |cell| {
                cell.map_or([u32::MAX; 2], |&Cell { pixel: [column, row], .. }| [row, column])
            }),
            field: column(cells, |cell| cell.map_or(-1, |cell| i64::from(cell.field.raw()))),
            taxel: column(cells, |cell| cell.map_or(u32::MAX, |cell| cell.taxel.0)),
            weights,
            fields,
        }
    }
}

/// Columns of hits that were found one by one.
pub(crate) fn columns(found: Vec<Option<Hit>>) -> Answers {
    let mut answers = Answers::default();
    for hit in found {
        answers.missing.push(hit.is_none());
        let hits = &mut answers.hits;
        hits.patch.push(hit.map_or(PatchId::new(0), |hit| hit.patch));
        hits.link.push(hit.map_or(LinkId::new(0), |hit| hit.link));
        hits.face.push(hit.map_or(FaceId::new(0), |hit| hit.point.face));
        hits.barycentric.push(hit.map_or([f64::NAN; 3], |hit| hit.point.barycentric));
        hits.distance.push(hit.map_or(f64::NAN, |hit| hit.distance));
        hits.position.push(hit.map_or(DVec3::NAN, |hit| hit.position));
        hits.normal.push(hit.map_or(DVec3::NAN, |hit| hit.normal));
    }
    answers
}

/// Where hits lie on the map of a level, of a patch without it on its coarsest; or in which fields of a level without a map.
pub(crate) fn cells(
    index: &ContactIndex,
    map: &SkinMap,
    answers: &Answers,
    level: (MapLevel, Option<&NamedLevel>),
) -> Vec<Option<Cell>> {
    let cell = |k: usize| {
        let hit = answers.hits.get(k).filter(|_| !answers.missing.get(k).copied().unwrap_or(false))?;
        match level {
            (MapLevel::Patches(level), _) => index.cell(&hit, map.patches[hit.patch].nearest_level(level)),
            (_, named) => named?.cells.cell(hit.patch, &index.cell(&hit, LevelId::default())?),
        }
    };
    (0..answers.hits.patch.len()).into_par_iter().with_min_len(FEW).map(cell).collect()
}

impl PyFields {
    /// The fields that each query found.
    pub(crate) fn new(py: Python<'_>, found: &[Vec<FieldHit>]) -> PyResult<Self> {
        let ends = found.iter().scan(0, |end, row| {
            *end += row.len() as i64;
            Some(*end)
        });
        let all = || found.iter().flatten();
        Ok(Self {
            indptr: vector(py, [0].into_iter().chain(ends)).unbind(),
            patch: vector(py, all().map(|hit| hit.patch.raw() as i32)).unbind(),
            level: vector(py, all().map(|hit| hit.level.raw() as i32)).unbind(),
            field: vector(py, all().map(|hit| i64::from(hit.field.raw()))).unbind(),
            taxel_id: vector(py, all().map(|hit| hit.taxel.0)).unbind(),
            distance: vector(py, all().map(|hit| hit.distance)).unbind(),
            point: matrix(py, all().map(|hit| hit.position.to_array()))?.unbind(),
            normal: matrix(py, all().map(|hit| hit.normal.to_array()))?.unbind(),
        })
    }
}
