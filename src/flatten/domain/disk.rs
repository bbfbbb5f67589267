//! The test that a mesh can be flattened at all: one component, at least one boundary loop, no
//! handle.

use crate::{
    flatten::FlattenError,
    id::VertexId,
    mesh::{Adjacency, TriMesh, loop_length},
    numeric::argsort,
};

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
        let loops = adjacency.boundary_loops();
        let (euler, components) = (adjacency.euler_characteristic(), adjacency.component_count());
        let holes_explain = i64::try_from(loops.len()).is_ok_and(|n| euler == 2 - n);
        if components != 1 || loops.is_empty() || !holes_explain {
            return Err(FlattenError::NotADisk { euler, loops: loops.len(), components });
        }
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
