//! `flatten` and `coarsen`: one mesh, without a skin.

use std::sync::Arc;

use dermatome::{
    Skin,
    cut::Cut,
    flatten::{Convergence, Distortion, distortion},
    id::VertexId,
    mesh::TriMesh,
    pipeline::{BuildOptions, BuildRemark, build_finest},
    pyramid::{CoarsenOptions, Level, LevelId, Prolongation, Pyramid},
    skin::{PatchId, TaxelId, Taxels},
};
use glam::DVec3;
use numpy::{PyArray1, PyArray2, PyUntypedArrayMethods};
use pyo3::{prelude::*, types::PyList};

use crate::{
    arguments::arg,
    arrays::{Reduced, floats, matrix, one_each, one_number_each, points, reduced, rows, triangles, vector},
    errors::{bad, error, warn},
    jobs::run,
    map::json,
    matrix::{PyMatrix, Rows},
    options::{FlattenArgs, acuities, count, cut},
};

/// A mesh on the plane.
#[pyclass(frozen, get_all, module = "dermatome", name = "Flattening")]
#[derive(Debug, FromPyObject)]
pub(crate) struct PyFlattening {
    /// (p, 2) float64 array: Where the places of the map lie, in m. Without a cut they are the vertices.
    uv: Py<PyArray2<f64>>,
    /// (m, 3) uint32 array: The triangles, whose corners are places.
    faces: Py<PyArray2<u32>>,
    /// (p,) uint32 array: The vertex that each place is.
    vertex_of_place: Py<PyArray1<u32>>,
    /// dict: How faithful the map is.
    distortion: Py<PyAny>,
    /// bool or None: Whether the energy is at its minimum; None for methods without one.
    converged: Option<bool>,
}

#[pymethods]
impl PyFlattening {
    #[staticmethod]
    fn _of(state: Self) -> Self {
        state
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py>> {
        reduced(slf, &["uv", "faces", "vertex_of_place", "distortion", "converged"])
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let (places, faces) = (self.uv.bind(py).shape()[0], self.faces.bind(py).shape()[0]);
        format!("<dermatome.Flattening: {places} places, {faces} faces>")
    }
}

/// A map before it becomes arrays.
struct Flat {
    uv: Vec<[f64; 2]>,
    faces: Vec<[u32; 3]>,
    vertices: Vec<u32>,
    distortion: Distortion,
    convergence: Option<Convergence>,
    /// What may be other than expected.
    doubts: Vec<String>,
}

fn mesh_of(vertices: &Bound<'_, PyAny>, faces: &Bound<'_, PyAny>) -> PyResult<TriMesh> {
    let positions = points("vertices", vertices)?;
    let faces = triangles("faces", faces, positions.len())?;
    Ok(TriMesh::from_arrays(positions, &faces))
}

/// Map one mesh to the plane, without a flip and with a free boundary.
///
/// Parameters
/// ----------
/// vertices : (n, 3) array_like
///     Positions, in m.
/// faces : (m, 3) array_like of int
///     Triangles, counter-clockwise from outside.
/// cut : {"auto", "none", "all"} or (k, 2) array_like of int
///     Where to cut first: "auto", the default, where that is needed or pays; pairs are vertices that an edge joins,
///     counted from 0 as in `faces`.
/// acuity : (n,) array_like, optional
///     How many times longer lengths on the map are at each vertex than elsewhere; 0.01 to 100.
/// max_area_ratio, method, energy, angle, area, perimeter, magnify, overlap, boundary, threads
///     As in `build`.
///
/// Returns
/// -------
/// Flattening
///
/// Raises
/// ------
/// DataError
///     If the mesh is not one surface that can be mapped, or an option is unknown or out of its range.
///
/// Examples
/// --------
/// >>> import dermatome
/// >>> bent = [[0, 0, 0], [1, 0, 0.2], [1, 1, 0], [0, 1, 0.2]]
/// >>> flat = dermatome.flatten(bent, [[0, 1, 2], [0, 2, 3]])
/// >>> flat.uv.shape, flat.distortion["flips"]
/// ((4, 2), 0)
#[pyfunction]
#[pyo3(signature = (vertices, faces, *, cut=None, max_area_ratio=None, method="intrinsic", energy="sum", angle=1.0,
    area=1.0, perimeter=0.0, magnify=0.0, overlap="prevent", boundary="free", acuity=None, threads=0))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub(crate) fn flatten(
    py: Python<'_>,
    vertices: &Bound<'_, PyAny>,
    faces: &Bound<'_, PyAny>,
    cut: Option<&Bound<'_, PyAny>>,
    #[pyo3(from_py_with = arg)] max_area_ratio: Option<f64>,
    #[pyo3(from_py_with = arg)] method: &str,
    #[pyo3(from_py_with = arg)] energy: &str,
    #[pyo3(from_py_with = arg)] angle: f64,
    #[pyo3(from_py_with = arg)] area: f64,
    #[pyo3(from_py_with = arg)] perimeter: f64,
    #[pyo3(from_py_with = arg)] magnify: f64,
    #[pyo3(from_py_with = arg)] overlap: &str,
    #[pyo3(from_py_with = arg)] boundary: &str,
    acuity: Option<&Bound<'_, PyAny>>,
    #[pyo3(from_py_with = arg)] threads: i64,
) -> PyResult<PyFlattening> {
    let mesh = mesh_of(vertices, faces)?;
    let acuity = acuity.map(|acuity| acuities(acuity, mesh.positions.len())).transpose()?;
    let args = FlattenArgs { method, energy, angle, area, perimeter, magnify, overlap, boundary };
    let options = args.options()?;
    // The taxels of a bare mesh have ids from 1 on.
    let vertices = mesh.positions.len();
    let id = |[a, b]: [TaxelId; 2]| match [a, b].into_iter().find(|v| v.0 as usize >= vertices) {
        Some(wrong) => {
            Err(bad("cut", format!("vertex {wrong}"), format!("0 to {}", vertices.saturating_sub(1))))
        }
        None => Ok([TaxelId(a.0 + 1), TaxelId(b.0 + 1)]),
    };
    let cut = match self::cut(cut, max_area_ratio)? {
        Cut::Along(pairs) => Cut::Along(pairs.into_iter().map(id).collect::<PyResult<_>>()?),
        cut => cut,
    };
    let flat = run(py, count("threads", threads)?, move |stop| -> Result<Flat, dermatome::Error> {
        mesh.validate()?;
        if cut == Cut::None {
            let taxels = acuity.map(|acuity| Taxels { acuities: Some(acuity.into()), ..Taxels::from(&mesh) });
            let map = dermatome::flatten::flatten(&mesh, taxels.as_ref(), &options, stop.run())?;
            return Ok(Flat {
                distortion: distortion(&mesh, &map.uv),
                convergence: Some(map.convergence),
                doubts: Vec::new(),
                uv: map.uv.iter().map(|at| at.to_array()).collect(),
                faces: mesh.triangles.iter().map(|corners| corners.map(VertexId::raw)).collect(),
                vertices: mesh.positions.ids().map(VertexId::raw).collect(),
            });
        }
        let mut skin = Skin::from_mesh("mesh", mesh);
        skin.patches[PatchId::new(0)].taxels.acuities = acuity.map(Into::into);
        skin.validate()?;
        let options = BuildOptions { cut, flatten: options, ..BuildOptions::default() };
        let built = build_finest(&skin, &options, stop.run())?;
        let doubts = built.remarks(&options).into_iter().filter(BuildRemark::is_doubt);
        let level = &built.map.patches[PatchId::new(0)].levels[LevelId::new(0)];
        Ok(Flat {
            distortion: level.distortion,
            convergence: level.convergence,
            doubts: doubts.map(|doubt| doubt.to_string()).collect(),
            uv: level.uv.iter().map(|at| at.to_array()).collect(),
            faces: level
                .level
                .mesh
                .triangles
                .ids()
                .map(|face| level.places(face).map(|place| place.raw()))
                .collect(),
            vertices: level.uv.ids().map(|place| level.vertex_of(place).raw()).collect(),
        })
    })?;
    let flat = flat.map_err(error)?;
    flat.doubts.iter().try_for_each(|doubt| warn(py, doubt))?;
    Ok(PyFlattening {
        uv: matrix(py, flat.uv)?.unbind(),
        faces: matrix(py, flat.faces)?.unbind(),
        vertex_of_place: vector(py, flat.vertices).unbind(),
        distortion: json(py, &flat.distortion)?.unbind(),
        converged: flat.convergence.map(|convergence| convergence.converged),
    })
}

/// A level of a mesh: its vertices are vertices of the mesh.
#[pyclass(frozen, module = "dermatome", name = "MeshLevel")]
#[derive(Debug)]
pub(crate) struct PyMeshLevel {
    level: Arc<Level>,
    number: usize,
}

/// Number, positions, faces, areas and origins of a level, and the rows of its prolongation to the mesh.
type LevelState<'py> = (
    usize,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Option<(Bound<'py, PyAny>, Bound<'py, PyAny>)>,
);

#[pymethods]
impl PyMeshLevel {
    /// (n, 3) float64 array: Positions, in m.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, self.level.mesh.positions.iter().map(DVec3::to_array))
    }

    /// (m, 3) uint32 array: Triangles.
    #[getter]
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        matrix(py, self.level.mesh.triangles.iter().map(|corners| corners.map(VertexId::raw)))
    }

    /// (n,) float64 array: Receptive areas, in m^2.
    #[getter]
    fn areas<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        vector(py, self.level.areas.iter().copied())
    }

    /// (n,) uint32 array: The vertex of the mesh that each vertex is.
    #[getter]
    fn origins<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        vector(py, self.level.origins.iter().map(|v| v.raw()))
    }

    /// How the vertices of the mesh depend on those of this level: (vertices of the mesh, n), at most three entries
    /// a row.
    fn pooling(&self, py: Python<'_>) -> PyMatrix {
        let level = &self.level;
        let mut rows = Rows::new();
        match &level.to_finest {
            Some(direct) => {
                direct.indices.ids().for_each(|row| rows.push(direct.row(row).map(|(v, w)| (v.index(), w))));
            }
            None => level.origins.iter().for_each(|v| rows.push([(v.index(), 1.0)])),
        }
        rows.into_matrix(py, level.mesh.positions.len())
    }

    #[staticmethod]
    fn _of(state: LevelState<'_>) -> PyResult<Self> {
        let (number, positions, faces, areas, origins, rows) = state;
        let mesh = mesh_of(&positions, &faces)?;
        let count = mesh.positions.len();
        let to_finest = rows.map(|(indices, weights)| -> PyResult<_> {
            let indices = triangles("state", &indices, count)?;
            let weights = floats("state", &weights)?;
            let weights = self::rows("state", &weights)?.to_vec();
            if weights.len() != indices.len() {
                return Err(bad("state", "indices and weights that do not fit", "those of a MeshLevel"));
            }
            let indices = indices.into_iter().map(|row| row.map(VertexId::from)).collect();
            Ok(Prolongation { indices, weights: weights.into(), coarse_len: count })
        });
        let level = Level {
            origins: one_number_each("state", &origins, count)?.into_iter().map(VertexId::from).collect(),
            areas: one_each("state", &areas, count)?.into(),
            from_coarser: None,
            to_finest: to_finest.transpose()?,
            mesh,
        };
        Ok(Self { level: Arc::new(level), number })
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py>> {
        let (py, Self { level, number }) = (slf.py(), slf.get());
        let rows = level.to_finest.as_ref().map(|rows| -> PyResult<_> {
            let indices = matrix(py, rows.indices.iter().map(|row| row.map(VertexId::raw)))?;
            Ok((indices.into_any(), matrix(py, rows.weights.iter().copied())?.into_any()))
        });
        let state: LevelState<'py> = (
            *number,
            slf.get().positions(py)?.into_any(),
            slf.get().faces(py)?.into_any(),
            slf.get().areas(py).into_any(),
            slf.get().origins(py).into_any(),
            rows.transpose()?,
        );
        Ok((py.get_type::<Self>().getattr("_of")?, (state,).into_pyobject(py)?))
    }

    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    fn __repr__(&self) -> String {
        let (mesh, number) = (&self.level.mesh, self.number);
        let (vertices, faces) = (mesh.positions.len(), mesh.triangles.len());
        format!("<dermatome.MeshLevel {number}: {vertices} vertices, {faces} faces>")
    }
}

/// Make the levels of a mesh, each about a quarter as fine as the one before; vertices are nested.
///
/// Parameters
/// ----------
/// vertices : (n, 3) array_like
///     Positions, in m.
/// faces : (m, 3) array_like of int
///     Triangles, counter-clockwise from outside.
/// ratio, levels, coarsest, threads
///     As in `build`.
/// acuity : (n,) array_like, optional
///     How many times finer the levels are at each vertex than elsewhere; 0.01 to 100.
///
/// Returns
/// -------
/// list of MeshLevel
///     The first is the mesh itself.
///
/// Raises
/// ------
/// DataError
///     If the mesh is no surface, or an option is out of its range.
///
/// Examples
/// --------
/// >>> import dermatome
/// >>> grid = dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(20) for x in range(20)])
/// >>> levels = dermatome.coarsen(grid.positions, grid.faces)
/// >>> len(levels[0].positions), len(levels) > 1
/// (400, True)
#[pyfunction]
#[pyo3(signature = (vertices, faces, *, ratio=None, levels=None, coarsest=32, acuity=None, threads=0))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub(crate) fn coarsen<'py>(
    py: Python<'py>,
    vertices: &Bound<'py, PyAny>,
    faces: &Bound<'py, PyAny>,
    #[pyo3(from_py_with = arg)] ratio: Option<f64>,
    #[pyo3(from_py_with = arg)] levels: Option<i64>,
    #[pyo3(from_py_with = arg)] coarsest: i64,
    acuity: Option<&Bound<'py, PyAny>>,
    #[pyo3(from_py_with = arg)] threads: i64,
) -> PyResult<Bound<'py, PyList>> {
    let mesh = mesh_of(vertices, faces)?;
    let acuity = acuity.map(|acuity| acuities(acuity, mesh.positions.len())).transpose()?;
    let levels = levels.map(|levels| count("levels", levels)).transpose()?;
    let options = CoarsenOptions { ratio, levels, coarsest: count("coarsest", coarsest)? };
    let pyramid = run(py, count("threads", threads)?, move |stop| -> Result<Pyramid, dermatome::Error> {
        mesh.validate()?;
        let taxels = Taxels { acuities: acuity.map(Into::into), ..Taxels::from(&mesh) };
        Ok(dermatome::pyramid::coarsen(&mesh, &taxels, &options, stop.run())?)
    })?;
    let levels = pyramid.map_err(error)?.levels.into_iter().enumerate();
    let levels = levels.map(|(number, level)| Py::new(py, PyMeshLevel { level: Arc::new(level), number }));
    PyList::new(py, levels.collect::<PyResult<Vec<_>>>()?)
}
