//! `Index`: what is near points of space, on the skin and on its maps.

use std::sync::Arc;

use dermatome::{
    SkinMap,
    contact::{ContactError, ContactIndex, FieldHit, Hit, IndexOptions, Query, Refine},
    mesh::is_rigid,
    pyramid::LevelId,
    signal::{Press, SignalError, Spreader},
    skin::{LinkId, Motion, MotionFrame, link_named},
};
use glam::{DAffine3, DMat3, DVec3};
use numpy::{PyArray1, PyArray2, PyUntypedArrayMethods};
use pyo3::{prelude::*, types::PyDict};
use rayon::prelude::*;

use crate::{
    arguments::{arg, object},
    arrays::{Reduced, bad_shape, floats, integers, made_by, matrix, one_each, points, rows, vector},
    errors::{bad, error},
    hits::{Answers, FEW, PyFields, PyHits, cells, columns},
    jobs::{Stop, run},
    map::PyMap,
    options::{count, level},
    pool::{LevelArg, MapLevel},
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
        link_named(&self.map().links, name).map_err(|links| {
            if links > 1 {
                let found = format!("{name:?}, the name of {links} links");
                return bad(argument, found, "the name of one link of the map alone");
            }
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
    ) -> PyResult<Queries> {
        let array = floats(name, points)?;
        let points: &[[f64; 3]] = rows(name, &array)?;
        if let Some(k) = points.iter().position(|point| point.iter().any(|x| x.abs() > FARTHEST)) {
            return Err(bad(
                &format!("{name}[{k}]"),
                format!("{:?}", points[k]),
                "coordinates within 1e12 m, or NaN where there is no contact",
            ));
        }
        let link = link.map(|name| self.link_named("link", name)).transpose()?;
        let only_links = self.only_links(only_link, points.len())?;
        let known: Vec<bool> = points.iter().map(|point| !point.iter().any(|x| x.is_nan())).collect();
        let query = |((&point, &is_known), only_link): ((&[f64; 3], &bool), Option<LinkId>)| Query {
            point: if is_known { DVec3::from_array(point) } else { DVec3::ZERO },
            link,
            only_link,
        };
        let all = points.iter().zip(&known).zip(only_links).map(query).collect();
        Ok(Queries { all, known })
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
        level: Option<MapLevel>,
        Queries { all, known }: Queries,
        find: impl FnOnce(&ContactIndex, &[Query], &Stop) -> Result<Answers, ContactError> + Send + 'static,
    ) -> PyResult<PyHits> {
        let (index, map) = (Arc::clone(&self.index), Arc::clone(self.map()));
        let named = match level {
            Some(MapLevel::Fields(at)) => Some(self.map.get().named_level(at)),
            _ => None,
        };
        let columns = run(py, count("threads", threads)?, move |stop| {
            let mut answers = find(&index, &all, stop)?;
            answers.leave_out(&known);
            answers.cells =
                level.map(|level| (level, cells(&index, &map, &answers, (level, named.as_deref()))));
            Ok(answers.into_columns(&map))
        })?;
        columns.map_err(|e: ContactError| error(e))?.into_hits(py, self.map.get())
    }

    fn fields_of(
        &self,
        py: Python<'_>,
        Queries { all, known }: Queries,
        threads: usize,
        find: impl Fn(&ContactIndex, Query) -> Result<Vec<FieldHit>, ContactError> + Send + Sync + 'static,
    ) -> PyResult<PyFields> {
        let index = Arc::clone(&self.index);
        let found = run(py, threads, move |stop| -> Result<Vec<Vec<FieldHit>>, ContactError> {
            all.par_iter()
                .zip(&known)
                .with_min_len(FEW)
                .inspect(|_| stop.check())
                .map(|(query, is_known)| if *is_known { find(&index, *query) } else { Ok(Vec::new()) })
                .collect()
        })?;
        let found = found.map_err(error)?;
        PyFields::new(py, &found)
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
    if pose.is_finite() && is_rigid(&pose) {
        Ok(pose)
    } else {
        Err(bad(argument, "no rigid pose", "a rotation and a finite translation"))
    }
}

/// Queries, and which of them have a point; others have no answer.
struct Queries {
    all: Vec<Query>,
    known: Vec<bool>,
}

/// What the taxels read, and which contacts touch one.
type Felt<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>);

/// Coordinates are at most this, in m, as the library wants them.
const FARTHEST: f64 = 1e12;

#[pymethods]
impl PyIndex {
    /// Find the points of the skin nearest to points of space.
    ///
    /// Parameters
    /// ----------
    /// points : (k, 3) array_like
    ///     The points, in m; one that is NaN has no answer, here and in the other methods.
    /// link : str, optional
    ///     The link in whose frame they and the answers are; by default the world.
    /// only_link : str, or (k,) sequence of str or int, optional
    ///     The link whose patches alone are searched: one for all points, or for each its name (None: all links) or number
    ///     (-1: all), as in `Hits.link`.
    /// level : int or str, optional
    ///     The level on whose map the points are found, of patches that do not reach up to it their coarsest; or one of
    ///     `Map.field_levels`, as "body.L0", of which there are fields and no places. None for the skin alone, which is quicker.
    /// threads : int
    ///     0 for one per processor.
    ///
    /// Returns
    /// -------
    /// Hits
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If a coordinate is infinite, or a link or the level is unknown.
    #[pyo3(signature = (points, *, link=None, only_link=None, level=Some(LevelArg::FINEST), threads=0),
        text_signature = "(self, points, *, link=None, only_link=None, level=0, threads=0)")]
    fn locate(
        &self,
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = arg)] link: Option<&str>,
        only_link: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = arg)] level: Option<LevelArg>,
        #[pyo3(from_py_with = arg)] threads: i64,
    ) -> PyResult<PyHits> {
        let queries = self.queries("points", points, link, only_link)?;
        let level = level.map(|level| level.of(self.map())).transpose()?;
        self.hits(py, threads, level, queries, |index, queries, stop| {
            Ok(Answers { hits: index.locate_all(queries, stop.run())?, ..Answers::default() })
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
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If shapes differ, a direction is 0, a number is not finite, or a link or the level is unknown.
    #[pyo3(signature = (origins, directions, *, longest=None, link=None, only_link=None, level=Some(LevelArg::FINEST),
        threads=0),
        text_signature = "(self, origins, directions, *, longest=None, link=None, only_link=None, level=0, threads=0)")]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn ray(
        &self,
        py: Python<'_>,
        origins: &Bound<'_, PyAny>,
        directions: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = arg)] longest: Option<f64>,
        #[pyo3(from_py_with = arg)] link: Option<&str>,
        only_link: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = arg)] level: Option<LevelArg>,
        #[pyo3(from_py_with = arg)] threads: i64,
    ) -> PyResult<PyHits> {
        let mut queries = self.queries("origins", origins, link, only_link)?;
        let mut directions = points("directions", directions)?;
        let (found, needed) = (directions.len(), queries.all.len());
        if found != needed {
            return Err(bad("directions", format!("{found} rows"), format!("{needed} rows")));
        }
        for (k, (direction, is_known)) in directions.iter_mut().zip(&mut queries.known).enumerate() {
            *is_known &= !direction.is_nan();
            if *is_known && (*direction == DVec3::ZERO || !direction.is_finite()) {
                let found = format!("[{}, {}, {}]", direction.x, direction.y, direction.z);
                return Err(bad(&format!("directions[{k}]"), found, "a finite direction with a length"));
            }
            *direction = if *is_known { *direction } else { DVec3::X };
        }
        let longest = longest.unwrap_or(f64::INFINITY);
        let level = level.map(|level| level.of(self.map())).transpose()?;
        self.hits(py, threads, level, queries, move |index, queries, stop| {
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
    /// level : int, str or None
    ///     The level of the places on the map; patches that do not reach up to it give those of their coarsest. Or one of
    ///     `Map.field_levels`. None: no places.
    /// link, only_link, threads
    ///     As in `locate`.
    ///
    /// Returns
    /// -------
    /// Hits
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the index was made without `reactive`, a coordinate is infinite, or a link or the level is unknown.
    #[pyo3(signature = (points, level=None, *, link=None, only_link=None, threads=0))]
    fn reactive(
        &self,
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = arg)] level: Option<LevelArg>,
        #[pyo3(from_py_with = arg)] link: Option<&str>,
        only_link: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = arg)] threads: i64,
    ) -> PyResult<PyHits> {
        self.need("reactive", self.options.reactive)?;
        let queries = self.queries("points", points, link, only_link)?;
        let level = level.map(|level| level.of(self.map())).transpose()?;
        self.hits(py, threads, level, queries, |index, queries, stop| {
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
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the index was made without `fields`, a coordinate is infinite, or a link or the level is unknown.
    #[pyo3(signature = (points, count=1, *, level=0, link=None, only_link=None, threads=0))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn nearest(
        &self,
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = arg)] count: i64,
        #[pyo3(from_py_with = arg)] level: i64,
        #[pyo3(from_py_with = arg)] link: Option<&str>,
        only_link: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = arg)] threads: i64,
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
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the index was made without `fields`, the radius is no number from 0 on, a coordinate is infinite, or a
    ///     link or the level is unknown.
    #[pyo3(signature = (points, radius, *, level=0, link=None, only_link=None, threads=0))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn within(
        &self,
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = arg)] radius: f64,
        #[pyo3(from_py_with = arg)] level: i64,
        #[pyo3(from_py_with = arg)] link: Option<&str>,
        only_link: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = arg)] threads: i64,
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
    /// Raises
    /// ------
    /// DataError
    ///     If the index was made without `fields`, shapes differ, a force or radius cannot be used, or a link is
    ///     unknown.
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
        #[pyo3(from_py_with = arg)] taxel_radius: f64,
        #[pyo3(from_py_with = arg)] max_distance: Option<f64>,
        #[pyo3(from_py_with = arg)] link: Option<&str>,
        only_link: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Felt<'py>> {
        self.need("fields", self.options.fields)?;
        let queries = self.queries("points", points, link, only_link)?;
        let Queries { all, known } = queries;
        let forces = one_each("force", force, all.len())?;
        if let Some(k) = forces.iter().position(|force| !force.is_finite()) {
            return Err(bad(&format!("force[{k}]"), forces[k], "a finite number of N"));
        }
        let radii =
            radius.map_or(Ok(vec![0.0; all.len()]), |radius| one_each("radius", radius, all.len()))?;
        let (index, spreader) = (Arc::clone(&self.index), Spreader { disc: taxel_radius, max_distance });
        let spread = run(py, 1, move |stop| -> Result<_, SignalError> {
            let mut frame = spreader.frame(&index, 0.0);
            let mut felt = Vec::with_capacity(all.len());
            for (((at, force), radius), is_known) in all.into_iter().zip(forces).zip(radii).zip(known) {
                stop.check();
                felt.push(is_known && spreader.add(&index, &Press { at, radius, force }, &mut frame)?);
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
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If a pose is not a rotation and a translation, or of no link.
    fn posed(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = object)] poses: &Bound<'_, PyDict>,
    ) -> PyResult<Self> {
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
