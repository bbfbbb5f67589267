//! Consistent winding: the components of a sheet and which of their faces are turned over.

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::{Edges, TriMesh},
    numeric::{DisjointSets, Relation},
};

/// The components of a mesh across edges, and which faces to turn so that each is wound one way.
#[derive(Debug)]
pub(super) struct Winding {
    /// The component of every face, numbered in the order of their first faces.
    pub component: IdVec<FaceId, usize>,
    /// Number of components.
    pub components: usize,
    /// Whether each face is wound against the first face of its component.
    pub reversed: IdVec<FaceId, bool>,
    /// Edges whose two faces cannot be wound consistently: the component has only one side.
    pub conflicting_edges: Vec<[VertexId; 2]>,
}

impl Winding {
    /// Follows the edges of two faces; edges of more faces join components too, but say nothing
    /// about their winding.
    pub(super) fn new(mesh: &TriMesh, edges: &Edges) -> Self {
        let mut faces = DisjointSets::<FaceId, Relation>::new(mesh.triangles.len());
        let mut conflicting_edges = Vec::new();
        for uses in edges.iter() {
            if let &[a, b] = uses {
                let relation = Relation::reversed_if(a.start(mesh) == b.start(mesh));
                if !faces.join(a.face(), b.face(), relation) {
                    conflicting_edges.push([a.start(mesh), a.end(mesh)]);
                }
            }
        }
        for uses in edges.iter().filter(|uses| uses.len() > 2) {
            for other in &uses[1..] {
                let relation = Relation::reversed_if(uses[0].start(mesh) == other.start(mesh));
                let _ = faces.join(uses[0].face(), other.face(), relation);
            }
        }
        let (mut component, mut reversed) = (IdVec::<FaceId, usize>::new(), IdVec::new());
        let mut components = 0;
        for face in mesh.triangles.ids() {
            // The root is the first face of its component.
            let (root, relation) = faces.root(face);
            component.push(if root == face { components } else { component[root] });
            components += usize::from(root == face);
            reversed.push(relation.is_reversed());
        }
        Self { component, components, reversed, conflicting_edges }
    }
}
