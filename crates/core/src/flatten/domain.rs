//! The surface to be flattened: a disk with holes, laid out face by face, in units of its own size.

use glam::{DVec2, DVec3};

use crate::flatten::FlattenError;
use crate::flatten::energy::elements::{BoundaryEdge, Element, ElementMesh, Uv};
use crate::flatten::magnification::Magnification;
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Adjacency, FlatTriangle, Topology, TriMesh, loop_length, mean_edge_length};
use crate::numeric::argsort;
use crate::parallel::{par_collect, par_ids, par_sum};

/// Least height of a triangle over its longest edge. Flatter ones are treated as if they had this height:
/// slivers down to a hundred-millionth are still mapped exactly, and a face without area still has an
/// orientation to keep, at a negligible weight.
const LEAST_HEIGHT: f64 = 1e-8;

/// Least area of a mesh over its area with flat triangles treated so: smaller areas are rounding noise.
const LEAST_AREA: f64 = 1e-6;

/// A disk with holes and its finite elements.
///
/// Lengths of the elements and of maps are in units of the square root of the whole area, so that
/// tolerances mean the same for a fingertip and a torso; [`Self::to_units`] and [`Self::to_metres`]
/// convert.
#[derive(Debug)]
pub(crate) struct FlattenDomain<'m> {
    pub(crate) mesh: &'m TriMesh,
    pub(crate) disk: Disk,
    /// The unit, in m.
    pub(crate) unit: f64,
    pub(crate) elements: ElementMesh,
    /// Prescribed positions, in units; empty for a free boundary.
    pub(crate) prescribed: Vec<Option<DVec2>>,
}

impl<'m> FlattenDomain<'m> {
    pub(crate) fn new(mesh: &'m TriMesh) -> Result<Self, FlattenError> {
        let disk = Disk::new(mesh)?;
        let count = mesh.triangles.len();
        let flat: IdVec<FaceId, Option<FlatTriangle>> = par_ids(count, |face| {
            FlatTriangle::new(mesh.corners(face)).healed(mesh.corners(face), LEAST_HEIGHT)
        });
        if let Some((face, _)) = flat.enumerate().find(|(_, flat)| flat.is_none()) {
            return Err(FlattenError::PointFace { face });
        }
        let total: f64 = flat.iter().flatten().map(FlatTriangle::area).sum();
        let area = par_sum(count, |face| mesh.face_area(FaceId::new(face)));
        if !(total.is_finite() && area > LEAST_AREA * total) {
            return Err(FlattenError::Size { area });
        }
        let unit = total.sqrt();
        let element = |face: FaceId| {
            let flat = flat[face]?;
            let gradients = flat.gradients().map(|g| g * unit);
            Some(Element { corners: mesh.triangles[face], gradients, weight: flat.area() / total })
        };
        let faces = par_collect(count, |faces, out| out.extend(faces.map(FaceId::new).filter_map(element)));
        let distance = |a: VertexId, b: VertexId| mesh.positions[a].distance(mesh.positions[b]) / unit;
        let boundary_edge =
            |[a, b]: [VertexId; 2]| BoundaryEdge { ends: [a, b], length: distance(a, b).max(LEAST_HEIGHT) };
        let mut elements = ElementMesh::new(faces.into(), mesh.positions.as_slice().to_vec());
        elements.boundary = disk.boundary_edges().map(boundary_edge).collect();
        elements.mean_edge = mean_edge_length(mesh, &disk.adjacency) / unit;
        Ok(Self { mesh, disk, unit, elements, prescribed: Vec::new() })
    }

    /// The domain with energies that aim at the areas of `magnification`, and weight the distortion of each
    /// face by it.
    ///
    /// Magnification alone does not change the weight of a face.
    pub(crate) fn magnified(mut self, magnification: &Magnification) -> Self {
        let faces = &mut self.elements.faces;
        for (e, factor) in faces.iter_mut().zip(magnification.area_factors(self.mesh).iter().flatten()) {
            let shrink = factor.sqrt().recip();
            e.gradients = e.gradients.map(|g| g * shrink);
        }
        for (e, weight) in faces.iter_mut().zip(magnification.face_weights(self.mesh).iter().flatten()) {
            e.weight *= weight;
        }
        self
    }

    /// The domain with prescribed positions of vertices (m).
    pub(crate) fn prescribed(mut self, places: impl Iterator<Item = Option<DVec2>>) -> Self {
        self.prescribed = places.map(|place| place.map(|p| p / self.unit)).collect();
        let held = self.prescribed.iter().map(Option::is_some).collect();
        self.elements = self.elements.holding(held);
        self
    }

    pub(crate) fn vertices(&self) -> usize {
        self.mesh.positions.len()
    }

    /// Position of a vertex on the skin, in units.
    pub(crate) fn position(&self, vertex: VertexId) -> DVec3 {
        self.mesh.positions[vertex] / self.unit
    }

    /// A map in m as one in units.
    pub(crate) fn to_units(&self, metres: &Uv) -> Uv {
        metres.map(|&p| p / self.unit)
    }

    /// A map in units as one in m.
    pub(crate) fn to_metres(&self, units: &Uv) -> Uv {
        units.map(|&p| p * self.unit)
    }
}

/// A disk with holes: the neighbours of its vertices, and its boundary loops.
#[derive(Debug)]
pub(crate) struct Disk {
    pub(crate) adjacency: Adjacency,
    /// Boundary loops, faces on the left; the longest one first, that is the outer one.
    pub(crate) loops: Vec<Vec<VertexId>>,
}

impl Disk {
    /// Checks that `mesh` is one component with at least one boundary loop and no handle.
    pub(crate) fn new(mesh: &TriMesh) -> Result<Self, FlattenError> {
        if mesh.triangles.is_empty() {
            return Err(FlattenError::NotADisk { euler: 0, loops: 0, components: 0 });
        }
        let adjacency = Adjacency::new(mesh)?;
        let topology = adjacency.topology();
        if !topology.is_disk() {
            let Topology { components, loops, euler } = topology;
            return Err(FlattenError::NotADisk { euler, loops, components });
        }
        let loops = adjacency.boundary_loops();
        // The longest first; loops of equal length stay in the order of their smallest vertices.
        let lengths: Vec<f64> = loops.iter().map(|walk| -loop_length(mesh, walk)).collect();
        let loops = argsort(&lengths).into_iter().map(|k| loops[k].clone()).collect();
        Ok(Self { adjacency, loops })
    }

    /// The boundary edges, faces on the left, loop by loop.
    pub(crate) fn boundary_edges(&self) -> impl Iterator<Item = [VertexId; 2]> + '_ {
        self.loops.iter().flat_map(|walk| walk.iter().zip(walk.iter().cycle().skip(1)).map(|(&a, &b)| [a, b]))
    }
}
