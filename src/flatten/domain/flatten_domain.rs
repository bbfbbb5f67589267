use crate::{
    flatten::{
        FlattenError,
        domain::disk::Disk,
        domain::elements::{Element, Net},
        jacobian::FlatTriangle,
    },
    id::{FaceId, IdVec, VertexId},
    mesh::TriMesh,
};

/// Height of a triangle over its longest edge, at least. Flatter ones are treated as if they were that high: exact
/// slivers still flatten to themselves down to a millionth, and a face without area still has an
/// orientation to keep, at a weight that nothing else notices.
const LEAST_HEIGHT: f64 = 1e-6;

/// A disk with holes, laid out face by face: all that flattening needs to know about the skin.
///
/// Lengths are in units of the square root of the whole area, so that tolerances mean the same for a
/// fingertip and a torso.
#[derive(Debug)]
pub(crate) struct Surface<'m> {
    pub(crate) mesh: &'m TriMesh,
    pub(crate) disk: Disk,
    /// The unit, in m.
    pub(crate) unit: f64,
    /// The faces and how they hang together. Its boundary runs loop by loop, the outer one first.
    pub(crate) net: Net,
}

impl<'m> Surface<'m> {
    pub(crate) fn new(mesh: &'m TriMesh) -> Result<Self, FlattenError> {
        let disk = Disk::new(mesh)?;
        let mut flat = Vec::with_capacity(mesh.triangles.len());
        for face in mesh.triangles.ids() {
            let healed = FlatTriangle::new(mesh.corners(face)).healed(mesh.corners(face), LEAST_HEIGHT);
            flat.push(healed.ok_or(FlattenError::PointFace { face })?);
        }
        let total: f64 = flat.iter().map(FlatTriangle::area).sum();
        if !(total.is_finite() && total > 0.0) {
            return Err(FlattenError::Size { area: total });
        }
        let unit = total.sqrt();
        let elements = mesh
            .triangles
            .iter()
            .zip(&flat)
            .map(|(&corners, flat)| Element {
                corners,
                gradients: flat.gradients().map(|g| g * unit),
                weight: flat.area() / total,
            })
            .collect();
        let distance = |a: VertexId, b: VertexId| mesh.positions[a].distance(mesh.positions[b]) / unit;
        let boundary =
            disk.boundary_edges().map(|[a, b]| ([a, b], distance(a, b).max(LEAST_HEIGHT))).collect();
        let mut net = Net::new(elements, mesh.positions.as_slice().to_vec());
        net.boundary = boundary;
        net.mean_edge = crate::mesh::mean_edge_length(mesh, &disk.adjacency) / unit;
        Ok(Self { mesh, disk, unit, net })
    }

    /// The same with energies that aim at `factors` times the true area of each face.
    ///
    /// The faces' weights stay: a magnified face does not count more than it did.
    pub(crate) fn magnified(mut self, factors: &IdVec<FaceId, f64>) -> Self {
        for (e, factor) in self.net.elements.iter_mut().zip(factors) {
            let shrink = factor.sqrt().recip();
            e.gradients = e.gradients.map(|g| g * shrink);
        }
        self
    }

    /// Number of vertices.
    pub(crate) fn vertices(&self) -> usize {
        self.mesh.positions.len()
    }
}
