//! `Index`, `Hits` and `Fields`: what is near points of space, on the skin and on its maps.

use std::sync::Arc;

use dermatome::{
    SkinMap,
    contact::{Cell, ContactError, ContactIndex, FieldHit, Hit, Hits, IndexOptions, Query, Refine},
    id::FaceId,
    mesh::is_rigid,
    pyramid::LevelId,
    signal::{Press, SignalError, Spreader},
    skin::{LinkId, Motion, MotionFrame, PatchId},
};
use glam::{DAffine3, DMat3, DVec3};
use numpy::{PyArray1, PyArray2, PyUntypedArrayMethods};
use pyo3::{prelude::*, types::PyDict};
use rayon::prelude::*;

use crate::{
    arrays::{
        Reduced, bad_shape, floats, integers, made_by, matrix, one_each, points, reduced, rows, vector,
    },
    errors::{bad, error},
    jobs::{Stop, run},
    map::{PyMap, starts},
    matrix::{PyMatrix, Rows},
    options::{count, level},
};

/// A map made ready for contacts: what of the skin is near a point, and where that lies on the map.
///
/// Points are in m, in the world unless `link` names the link in whose frame they are. Answers are the same one by
/// one and in a batch, with any number of threads. An index never changes; it is pickled as its map and its poses.
///
/// Examples
/// --------
/// >>> import dermatome
/// >>> grid = [[0.005 * x, 0.005 * y, 0] for y in range(12) for x in range(12)]
/// >>> skin = dermatome.Skin.from_arrays(grid, outside=(0, 0, 1))
/// >>> hits = dermatome.build(skin).index().locate([[0.0201, 0.0202, 0.003]])
/// >>> int(hits.taxel_id[0]), round(float(hits.distance[0]), 6)
/// (53, 0.003)
#[pyclass(frozen, module = "dermatome", name = "Index")]
#[derive(Debug)]
pub(crate) struct PyIndex {
    index: Arc<ContactIndex>,
    map: Py<PyMap>,
    options: IndexOptions,
    /// The links that were posed, and where.
    posed: Vec<(LinkId, DAffine3)>,
}

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
    /// (k, 2) float64 array or None: Place on the map of the level, in m.
    pub(crate) uv: Option<Py<PyArray2<f64>>>,
    /// (k, 2) uint32 array or None: Row (from the top) and column of its pixel.
    pixel: Option<Py<PyArray2<u32>>>,
    /// (k,) int64 array or None: The receptive field with the largest weight, a vertex of the level; on level 0 a taxel.
    field: Option<Py<PyArray1<i64>>>,
    /// (k,) uint32 array or None: Id of the taxel at its centre.
    taxel_id: Option<Py<PyArray1<u32>>>,
    /// (k,) int32 array or None: Number of the named region of that field in `Map.regions`, -1 for none.
    region: Option<Py<PyArray1<i32>>>,
    /// Matrix or None: Weights of all fields of the level, (k, fields of the whole map in its order).
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
struct Answers {
    hits: Hits,
    /// Which queries have none.
    missing: Vec<bool>,
    ranges: Option<[Vec<f64>; 2]>,
    /// With the level that was asked for; patches that do not reach up to it may have cells on their coarsest.
    cells: Option<(LevelId, Vec<Option<Cell>>)>,
}

/// Answers as the numbers of arrays.
#[derive(Debug)]
struct Columns {
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
    fn into_columns(self, map: &SkinMap) -> Columns {
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

impl CellColumns {
    fn new(level: LevelId, cells: &[Option<Cell>], patches: &[PatchId], map: &SkinMap) -> Self {
        fn column<T: Send>(cells: &[Option<Cell>], of: impl Fn(Option<&Cell>) -> T + Sync) -> Vec<T> {
            cells.par_iter().with_min_len(FEW).map(|cell| of(cell.as_ref())).collect()
        }
        let starts = starts(map, level);
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
            level: column(cells, |cell| cell.map_or(-1, |cell| cell.level.raw() as i32)),
            uv: column(cells, |cell| cell.map_or([f64::NAN; 2], |cell| cell.uv.to_array())),
            pixel: column(cells, |cell| {
                cell.map_or([u32::MAX; 2], |&Cell { pixel: [column, row], .. }| [row, column])
            }),
            field: column(cells, |cell| cell.map_or(-1, |cell| i64::from(cell.field.raw()))),
            taxel: column(cells, |cell| cell.map_or(u32::MAX, |cell| cell.taxel.0)),
            weights,
            fields: starts.last().copied().unwrap_or(0),
        }
    }
}

impl PyIndex {
    pub(crate) fn new(map: &Bound<'_, PyMap>, options: IndexOptions, threads: usize) -> PyResult<Self> {
        let of = Arc::clone(&map.get().map);
        let index = run(map.py(), threads, move |_| ContactIndex::with_options(&of, &options))?;
        let index = Arc::new(index.map_err(error)?);
        Ok(Self { index, map: map.clone().unbind(), options, posed: Vec::new() })
    }

    fn map(&self) -> &Arc<SkinMap> {
        &self.map.get().map
    }

    fn link_named(&self, argument: &str, name: &str) -> PyResult<LinkId> {
        let known = self.map().links.enumerate().find(|(_, link)| link.name == name);
        known.map(|(id, _)| id).ok_or_else(|| {
            let names: Vec<_> = self.map().links.iter().take(10).map(|link| link.name.as_str()).collect();
            bad(argument, format!("{name:?}"), format!("one of {names:?}"))
        })
    }

    fn queries(
        &self,
        name: &str,
        points: &Bound<'_, PyAny>,
        link: Option<&str>,
        only_link: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Vec<Query>> {
        let array = floats(name, points)?;
        let points: &[[f64; 3]] = rows(name, &array)?;
        if let Some(k) = points.iter().position(|point| !point.iter().all(|x| x.abs() <= FARTHEST)) {
            return Err(bad(
                &format!("{name}[{k}]"),
                format!("{:?}", points[k]),
                "finite coordinates within 1e12 m",
            ));
        }
        let link = link.map(|name| self.link_named("link", name)).transpose()?;
        let only_links = self.only_links(only_link, points.len())?;
        let query = |(&point, only_link): (&[f64; 3], Option<LinkId>)| Query {
            point: DVec3::from_array(point),
            link,
            only_link,
        };
        Ok(points.iter().zip(only_links).map(query).collect())
    }

    /// The link of each query whose patches alone are searched: one name for all, or for each a name or a number.
    fn only_links(&self, value: Option<&Bound<'_, PyAny>>, count: usize) -> PyResult<Vec<Option<LinkId>>> {
        let find = |name: &str| self.link_named("only_link", name);
        let Some(value) = value else { return Ok(vec![None; count]) };
        if let Ok(name) = value.extract::<String>() {
            return Ok(vec![Some(find(&name)?); count]);
        }
        let links: Vec<Option<LinkId>> = match value.extract::<Vec<Option<String>>>() {
            Ok(names) => {
                names.iter().map(|name| name.as_deref().map(find).transpose()).collect::<PyResult<_>>()?
            }
            Err(_) => {
                let (numbers, links) = (integers("only_link", value)?, self.map().links.len());
                let link = |(k, &found): (usize, &i64)| match usize::try_from(found) {
                    Ok(number) if number < links => Ok(Some(LinkId::new(number))),
                    Err(_) if found == -1 => Ok(None),
                    _ => Err(bad(
                        &format!("only_link[{k}]"),
                        found,
                        format!("-1 to {}", links.saturating_sub(1)),
                    )),
                };
                numbers.as_slice()?.iter().enumerate().map(link).collect::<PyResult<_>>()?
            }
        };
        if links.len() == count {
            Ok(links)
        } else {
            Err(bad("only_link", format!("{} links", links.len()), format!("one, or {count}")))
        }
    }

    /// Refuses what the index was made without.
    fn need(&self, what: &str, has_it: bool) -> PyResult<()> {
        if has_it {
            Ok(())
        } else {
            Err(bad("index", format!("no {what}"), format!("Map.index({what}=True)")))
        }
    }

    fn level(&self, found: i64) -> PyResult<LevelId> {
        level("level", found, self.map().patches.iter().map(|patch| patch.levels.len()).max().unwrap_or(0))
    }

    /// Finds answers, and makes arrays of them.
    fn hits(
        &self,
        py: Python<'_>,
        threads: i64,
        level: Option<LevelId>,
        find: impl FnOnce(&ContactIndex, &Stop) -> Result<Answers, ContactError> + Send + 'static,
    ) -> PyResult<PyHits> {
        let (index, map) = (Arc::clone(&self.index), Arc::clone(self.map()));
        let columns = run(py, count("threads", threads)?, move |stop| {
            let mut answers = find(&index, stop)?;
            answers.cells = level.map(|level| (level, cells(&index, &map, &answers, level)));
            Ok(answers.into_columns(&map))
        })?;
        let Columns { patch, link, face, barycentric, distance, point, normal, ranges, cells } =
            columns.map_err(|e: ContactError| error(e))?;
        let [least, most] = ranges.map_or([None, None], |ranges| ranges.map(Some));
        let patches = if level.is_some() { patch.clone() } else { Vec::new() };
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
        if let Some(CellColumns { level, uv, pixel, field, taxel, weights, fields }) = cells {
            let regions = self.map.get().field_regions();
            let region_of = |(&patch, (&level, &field)): (&i32, (&i32, &i64))| {
                let id = |number: i64| u32::try_from(number).ok();
                let region = Option::zip(id(patch.into()), Option::zip(id(level.into()), id(field)));
                let region = region.and_then(|(patch, (level, field))| {
                    regions.region(patch.into(), level.into(), field.into())
                });
                region.map_or(-1, |region| region.raw() as i32)
            };
            let places = patches.iter().zip(level.iter().zip(&field));
            found.region = Some(vector(py, places.map(region_of).collect::<Vec<_>>()).unbind());
            found.level = Some(vector(py, level).unbind());
            found.uv = Some(matrix(py, uv)?.unbind());
            found.pixel = Some(matrix(py, pixel)?.unbind());
            found.field = Some(vector(py, field).unbind());
            found.taxel_id = Some(vector(py, taxel).unbind());
            found.fields = Some(Py::new(py, weights.into_matrix(py, fields))?);
        }
        Ok(found)
    }

    fn fields_of(
        &self,
        py: Python<'_>,
        queries: Vec<Query>,
        threads: usize,
        find: impl Fn(&ContactIndex, Query) -> Result<Vec<FieldHit>, ContactError> + Send + Sync + 'static,
    ) -> PyResult<PyFields> {
        let index = Arc::clone(&self.index);
        let found = run(py, threads, move |stop| -> Result<Vec<Vec<FieldHit>>, ContactError> {
            queries
                .par_iter()
                .with_min_len(FEW)
                .inspect(|_| stop.check())
                .map(|query| find(&index, *query))
                .collect()
        })?;
        let found = found.map_err(error)?;
        let ends = found.iter().scan(0, |end, row| {
            *end += row.len() as i64;
            Some(*end)
        });
        let all = || found.iter().flatten();
        Ok(PyFields {
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

/// A pose as a matrix of four rows.
pub(crate) fn pose_array<'py>(py: Python<'py>, pose: &DAffine3) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (turn, at) = (pose.matrix3, pose.translation);
    let row = |k: usize| [turn.col(0)[k], turn.col(1)[k], turn.col(2)[k], at[k]];
    matrix(py, [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]])
}

/// A pose from a matrix of four rows, that of a rotation and a translation in m.
pub(crate) fn pose_of(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<DAffine3> {
    let array = floats(argument, value)?;
    if array.shape() != [4, 4] {
        return Err(bad_shape(argument, array.shape(), "shape (4, 4)"));
    }
    let rows: &[[f64; 4]] = array.as_slice()?.as_chunks().0;
    let column = |k: usize| DVec3::new(rows[0][k], rows[1][k], rows[2][k]);
    let turn = DMat3::from_cols(column(0), column(1), column(2));
    if rows[3] != [0.0, 0.0, 0.0, 1.0] {
        return Err(bad(argument, format!("a last row {:?}", rows[3]), "[0, 0, 0, 1]"));
    }
    let pose = DAffine3::from_mat3_translation(turn, column(3));
    if is_rigid(&pose) {
        Ok(pose)
    } else {
        Err(bad(argument, "no rigid pose", "a rotation and a finite translation"))
    }
}

/// What the taxels read, and which contacts touch one.
type Felt<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>);

/// Coordinates are at most this, in m, as the library wants them.
const FARTHEST: f64 = 1e12;

/// Fewest queries for a task.
const FEW: usize = 64;

/// Columns of hits that were found one by one.
fn columns(found: Vec<Option<Hit>>) -> Answers {
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

/// Where hits lie on the map of a level, of a patch without it on its coarsest.
fn cells(index: &ContactIndex, map: &SkinMap, answers: &Answers, level: LevelId) -> Vec<Option<Cell>> {
    let cell = |k: usize| {
        let hit = answers.hits.get(k).filter(|_| !answers.missing.get(k).copied().unwrap_or(false))?;
        index.cell(&hit, map.patches[hit.patch].nearest_level(level))
    };
    (0..answers.hits.patch.len()).into_par_iter().with_min_len(FEW).map(cell).collect()
}

#[pymethods]
impl PyIndex {
    /// Find the points of the skin nearest to points of space.
    ///
    /// Parameters
    /// ----------
    /// points : (k, 3) array_like
    ///     The points, in m.
    /// link : str, optional
    ///     The link in whose frame they and the answers are; by default the world.
    /// only_link : str, or (k,) sequence of str or int, optional
    ///     The link whose patches alone are searched: one for all points, or for each its name (None: all links) or number
    ///     (-1: all), as in `Hits.link`.
    /// level : int, optional
    ///     The level on whose map the points are found, of patches that do not reach up to it their coarsest; None for
    ///     the skin alone, which is quicker.
    /// threads : int
    ///     0 for one per processor.
    ///
    /// Returns
    /// -------
    /// Hits
    #[pyo3(signature = (points, *, link=None, only_link=None, level=0, threads=0))]
    fn locate(
        &self,
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        link: Option<&str>,
        only_link: Option<&Bound<'_, PyAny>>,
        level: Option<i64>,
        threads: i64,
    ) -> PyResult<PyHits> {
        let queries = self.queries("points", points, link, only_link)?;
        let level = level.map(|level| self.level(level)).transpose()?;
        self.hits(py, threads, level, move |index, stop| {
            Ok(Answers { hits: index.locate_all_with(&queries, stop.run())?, ..Answers::default() })
        })
    }

    /// Find the first points of the skin that rays meet, from either side.
    ///
    /// Parameters
    /// ----------
    /// origins, directions : (k, 3) array_like
    ///     Where the rays begin, in m, and where they go; directions need not have unit length.
    /// longest : float, optional
    ///     How far the rays reach, in m; by default without end.
    /// link, only_link, level, threads
    ///     As in `locate`.
    ///
    /// Returns
    /// -------
    /// Hits
    ///     `distance` is that from the origin. A ray that meets nothing has the patch -1.
    #[pyo3(signature = (origins, directions, *, longest=None, link=None, only_link=None, level=0,
        threads=0))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn ray(
        &self,
        py: Python<'_>,
        origins: &Bound<'_, PyAny>,
        directions: &Bound<'_, PyAny>,
        longest: Option<f64>,
        link: Option<&str>,
        only_link: Option<&Bound<'_, PyAny>>,
        level: Option<i64>,
        threads: i64,
    ) -> PyResult<PyHits> {
        let queries = self.queries("origins", origins, link, only_link)?;
        let directions = points("directions", directions)?;
        if directions.len() != queries.len() {
            return Err(bad(
                "directions",
                format!("{} rows", directions.len()),
                format!("{} rows", queries.len()),
            ));
        }
        let longest = longest.unwrap_or(f64::INFINITY);
        let level = level.map(|level| self.level(level)).transpose()?;
        self.hits(py, threads, level, move |index, stop| {
            let rays = queries.par_iter().zip(&directions).with_min_len(FEW).inspect(|_| stop.check());
            let hit = |(query, direction): (&Query, &DVec3)| index.first_hit(*query, *direction, longest);
            Ok(columns(rays.map(hit).collect::<Result<_, _>>()?))
        })
    }

    /// Find between which distances the skin is from points of space, in constant time: the skin is within `r` for sure where
    /// `Hits.most <= r`, and farther where `Hits.least > r`; `Hits.distance` is their mean, negative inside. `Hits.point` is a
    /// point of the skin at most `Hits.most` away, not always the nearest. Needs an index with `reactive`.
    ///
    /// Parameters
    /// ----------
    /// points : (k, 3) array_like
    ///     The points, in m.
    /// level : int or None
    ///     The level of the places on the map; patches that do not reach up to it give those of their coarsest. None: no
    ///     places.
    /// link, only_link, threads
    ///     As in `locate`.
    ///
    /// Returns
    /// -------
    /// Hits
    #[pyo3(signature = (points, level=None, *, link=None, only_link=None, threads=0))]
    fn reactive(
        &self,
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        level: Option<i64>,
        link: Option<&str>,
        only_link: Option<&Bound<'_, PyAny>>,
        threads: i64,
    ) -> PyResult<PyHits> {
        self.need("reactive", self.options.reactive)?;
        let queries = self.queries("points", points, link, only_link)?;
        let level = level.map(|level| self.level(level)).transpose()?;
        self.hits(py, threads, level, move |index, stop| {
            let answer = |query: &Query| {
                let answer = index.reactive(*query)?;
                let hit = index.hit_of(*query, &answer, Refine::Walk).ok_or(ContactError::NoSkin)?;
                let answer = answer.narrowed(&hit);
                Ok((Hit { distance: answer.distance, ..hit }, answer.least, answer.most))
            };
            let queries = queries.par_iter().with_min_len(FEW).inspect(|_| stop.check());
            let found = queries.map(answer).collect::<Result<Vec<_>, ContactError>>()?;
            let mut answers = columns(found.iter().map(|&(hit, ..)| Some(hit)).collect());
            answers.ranges = Some([
                found.iter().map(|found| found.1).collect(),
                found.iter().map(|found| found.2).collect(),
            ]);
            Ok(answers)
        })
    }

    /// Find the taxels or receptive fields nearest to points of space. Needs an index with `fields`.
    ///
    /// Parameters
    /// ----------
    /// points : (k, 3) array_like
    ///     The points, in m.
    /// count : int
    ///     How many for each of them, at most.
    /// level : int
    ///     The level of the fields, of patches that do not reach up to it their coarsest; 0 for taxels.
    /// link, only_link, threads
    ///     As in `locate`.
    ///
    /// Returns
    /// -------
    /// Fields
    ///     The nearest first.
    #[pyo3(signature = (points, count=1, *, level=0, link=None, only_link=None, threads=0))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn nearest(
        &self,
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        count: i64,
        level: i64,
        link: Option<&str>,
        only_link: Option<&Bound<'_, PyAny>>,
        threads: i64,
    ) -> PyResult<PyFields> {
        self.need("fields", self.options.fields)?;
        let queries = self.queries("points", points, link, only_link)?;
        let (most, level) = (self::count("count", count)?, self.level(level)?);
        let find = move |index: &ContactIndex, query: Query| index.nearest_fields(query, most, level);
        self.fields_of(py, queries, self::count("threads", threads)?, find)
    }

    /// Find the taxels or receptive fields whose centres are within a distance of points of space. Needs an index
    /// with `fields`.
    ///
    /// Parameters
    /// ----------
    /// points : (k, 3) array_like
    ///     The points, in m.
    /// radius : float
    ///     The distance, in m.
    /// level, link, only_link, threads
    ///     As in `nearest`.
    ///
    /// Returns
    /// -------
    /// Fields
    ///     By patch and field.
    #[pyo3(signature = (points, radius, *, level=0, link=None, only_link=None, threads=0))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn within(
        &self,
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        radius: f64,
        level: i64,
        link: Option<&str>,
        only_link: Option<&Bound<'_, PyAny>>,
        threads: i64,
    ) -> PyResult<PyFields> {
        self.need("fields", self.options.fields)?;
        let queries = self.queries("points", points, link, only_link)?;
        let level = self.level(level)?;
        let find = move |index: &ContactIndex, query: Query| index.fields_within(query, radius, level);
        self.fields_of(py, queries, count("threads", threads)?, find)
    }

    /// Spread the forces of contacts over the taxels that they touch, as what these read at one moment. Needs an index with
    /// `fields`.
    ///
    /// Parameters
    /// ----------
    /// points : (k, 3) array_like
    ///     The points that press, or the centres of spheres, in m.
    /// force : (k,) array_like
    ///     Their forces, in N.
    /// radius : (k,) array_like, optional
    ///     The radii of the spheres, in m; 0, the default, for points.
    /// taxel_radius : float
    ///     Radius of the discs on which taxels feel, in m.
    /// max_distance : float, optional
    ///     How far from the skin a point presses, in m; by default ten spacings of the taxels.
    /// link, only_link
    ///     As in `locate`.
    ///
    /// Returns
    /// -------
    /// readings : (N,) float64 array
    ///     In N, in the order of the map; NaN where no taxel works.
    /// felt : (k,) bool array
    ///     Which contacts touch a taxel.
    ///
    /// Examples
    /// --------
    /// >>> import dermatome
    /// >>> grid = [[0.005 * x, 0.005 * y, 0] for y in range(12) for x in range(12)]
    /// >>> index = dermatome.build(dermatome.Skin.from_arrays(grid, outside=(0, 0, 1))).index(fields=True)
    /// >>> readings, felt = index.readings([[0.02, 0.02, 0.009]], [1.5], [0.01])
    /// >>> float(readings.sum()), felt.tolist()
    /// (1.5, [True])
    #[pyo3(signature = (points, force, radius=None, *, taxel_radius=0.002, max_distance=None, link=None, only_link=None))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn readings<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
        force: &Bound<'py, PyAny>,
        radius: Option<&Bound<'py, PyAny>>,
        taxel_radius: f64,
        max_distance: Option<f64>,
        link: Option<&str>,
        only_link: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Felt<'py>> {
        self.need("fields", self.options.fields)?;
        let queries = self.queries("points", points, link, only_link)?;
        let forces = one_each("force", force, queries.len())?;
        let radii = radius
            .map_or(Ok(vec![0.0; queries.len()]), |radius| one_each("radius", radius, queries.len()))?;
        let (index, spreader) = (Arc::clone(&self.index), Spreader { disc: taxel_radius, max_distance });
        let spread = run(py, 1, move |stop| -> Result<_, SignalError> {
            let mut frame = spreader.frame(&index, 0.0);
            let mut felt = Vec::with_capacity(queries.len());
            for ((at, force), radius) in queries.into_iter().zip(forces).zip(radii) {
                stop.check();
                felt.push(spreader.add(&index, &Press { at, radius, force }, &mut frame)?);
            }
            Ok((frame, felt))
        })?;
        let (frame, felt) = spread.map_err(error)?;
        Ok((
            vector(py, frame.values.iter().flatten().flat_map(|values| values.iter().copied())),
            vector(py, felt),
        ))
    }

    /// The same skin with its links elsewhere. The new index shares the trees of this one; patches with joints alone
    /// have their own.
    ///
    /// Parameters
    /// ----------
    /// poses : dict of str to (4, 4) array_like
    ///     Of each link that moves, its frame in the world: a rotation and a translation in m. Other links keep the
    ///     pose relative to their parent that they have in the map.
    ///
    /// Returns
    /// -------
    /// Index
    fn posed(&self, py: Python<'_>, poses: &Bound<'_, PyDict>) -> PyResult<Self> {
        let (mut motion, mut moved) = (Motion::default(), Vec::new());
        for (name, value) in poses {
            let name: String =
                name.extract().map_err(|_| bad("poses", "a key that is no str", "the name of a link"))?;
            let link = self.link_named("poses", &name)?;
            let pose = pose_of(&format!("poses[{name:?}]"), &value)?;
            moved.push((link, pose));
            motion.set(link, MotionFrame::World, &[(0.0, pose)]).map_err(error)?;
        }
        let index = Arc::clone(&self.index);
        let posed = run(py, 0, move |_| {
            let mut posed = ContactIndex::clone(&index);
            posed.set_motion(&motion, 0.0).map(|()| posed)
        })?;
        let index = Arc::new(posed.map_err(error)?);
        Ok(Self { index, map: self.map.clone_ref(py), options: self.options, posed: moved })
    }

    /// dict of str to (4, 4) float64 array: The frames of the links in the world.
    #[getter]
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let poses = PyDict::new(py);
        for (link, pose) in self.map().links.iter().zip(&self.index.poses()) {
            poses.set_item(&link.name, pose_array(py, pose)?)?;
        }
        Ok(poses)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        let poses = PyDict::new(py);
        for (link, pose) in &self.posed {
            poses.set_item(&self.map().links[*link].name, pose_array(py, pose)?)?;
        }
        let IndexOptions { reactive, fields } = self.options;
        made_by(py, "index", (self.map.clone_ref(py), reactive, fields, poses))
    }

    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    fn __repr__(&self) -> String {
        format!("<dermatome.Index: {} patches>", self.map().patches.len())
    }
}
