//! `Patch` and `Level`: the parts of a map as arrays.

use std::collections::BTreeSet;

use dermatome::{
    SkinMap,
    id::VertexId,
    map::{MapLevel, PatchMap},
    pyramid::{Level, LevelId},
    skin::PatchId,
};
use glam::DVec3;
use numpy::{PyArray1, PyArray2};
use pyo3::{prelude::*, types::PyTuple};

use crate::{
    arrays::{Reduced, made_by, map_frame, matrix, vector},
    map::{PyMap, json},
    matrix::{PyMatrix, Rows},
};

/// One patch of a map.
#[pyclass(frozen, module = "dermatome", name = "Patch")]
#[derive(Debug)]
pub(crate) struct PyPatch {
    pub(crate) map: Py<PyMap>,
    pub(crate) id: PatchId,
    /// int: The number of its first taxel among those of the map.
    #[pyo3(get)]
    pub(crate) start: usize,
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

    /// MapFrame: The rectangle of the map that the image shows.
    #[getter]
    fn frame<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        map_frame(py, &self.of_map().frame)
    }

    /// dict: How faithful the map is.
    #[getter]
    fn distortion<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        json(py, &self.of_map().distortion)
    }

    /// How the vertices depend on those of the next coarser level: (n, vertices of that level), or None on the
    /// coarsest.
    ///
    /// Going up level by level is another law than that of `Map.pooling`, `Map.pool`, the images and the files, which
    /// carry the taxels to each level at once: the product of these matrices over two levels or more is not
    /// `Map.pooling(level)`, though the rows of both have the sum 1 and both keep sums. `dermatome.torch.Pool` and
    /// `Map.pool` follow `pooling`; a network that goes level by level has numbers of its own.
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
