//! The test that a mesh can be flattened at all: one component, at least one boundary loop, no
//! handle.

use crate::{
    flatten::FlattenError,
    id::VertexId,
    mesh::{Adjacency, TriMesh},
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
        let mut loops = adjacency.boundary_loops();
        let (euler, components) = (adjacency.euler_characteristic(), adjacency.components().1);
        let holes_explain = i64::try_from(loops.len()).is_ok_and(|n| euler == 2 - n);
        if components != 1 || loops.is_empty() || !holes_explain {
            return Err(FlattenError::NotADisk { euler, loops: loops.len(), components });
        }
        let length = |walk: &[VertexId]| -> f64 {
            let next = walk.iter().cycle().skip(1);
            walk.iter().zip(next).map(|(&a, &b)| mesh.positions[a].distance(mesh.positions[b])).sum()
        };
        // A stable sort: loops of equal length stay in the order of their smallest vertices.
        loops.sort_by(|a, b| length(b).total_cmp(&length(a)));
        Ok(Self { adjacency, loops })
    }

    /// The boundary edges, faces on the left, loop by loop.
    pub(crate) fn boundary_edges(&self) -> impl Iterator<Item = [VertexId; 2]> + '_ {
        self.loops.iter().flat_map(|walk| walk.iter().zip(walk.iter().cycle().skip(1)).map(|(&a, &b)| [a, b]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn a_sphere_a_torus_and_two_pieces_are_refused_with_their_numbers() {
        let found = |mesh: &TriMesh| Disk::new(mesh).err();
        assert_eq!(
            found(&shapes::tetrahedron()),
            Some(FlattenError::NotADisk { euler: 2, loops: 0, components: 1 })
        );
        let torus = shapes::torus(8, 6, 0.1, 0.03);
        assert_eq!(found(&torus), Some(FlattenError::NotADisk { euler: 0, loops: 0, components: 1 }));
        let mut two = shapes::triangle();
        let more = two.positions.iter().map(|&p| p + 1.0).collect::<Vec<_>>();
        for p in more {
            two.positions.push(p);
        }
        two.triangles.push([3, 4, 5].map(VertexId::new));
        assert_eq!(found(&two), Some(FlattenError::NotADisk { euler: 2, loops: 2, components: 2 }));
        assert_eq!(
            found(&TriMesh::default()),
            Some(FlattenError::NotADisk { euler: 0, loops: 0, components: 0 })
        );
    }

    /// A torus with one hole has a loop, but a handle too.
    #[test]
    fn a_handle_is_refused() {
        let mut torus = shapes::torus(8, 6, 0.1, 0.03);
        torus.triangles = torus.triangles.into_iter().skip(1).collect();
        let found = Disk::new(&torus).err();
        assert_eq!(found, Some(FlattenError::NotADisk { euler: -1, loops: 1, components: 1 }));
    }

    #[test]
    fn the_outer_loop_comes_first() {
        let tube = shapes::tube(12, 5, 0.05, 0.1);
        let disk = Disk::new(&tube).unwrap();
        assert_eq!(disk.loops.len(), 2);
        assert_eq!(disk.boundary_edges().count(), 24);
    }
}
