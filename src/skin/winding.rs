use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::{Edges, TriMesh},
    numeric::{DisjointSets, Relation},
};

/// The pieces of a mesh that hang together across edges, and which faces to turn so that each is wound one way.
#[derive(Debug)]
pub(super) struct Winding {
    /// The piece of every face, numbered in the order of their first faces.
    pub component: IdVec<FaceId, usize>,
    /// Number of pieces.
    pub components: usize,
    /// Whether each face is wound against the first face of its piece.
    pub against_first: IdVec<FaceId, bool>,
    /// Edges whose two faces no turning reconciles: a piece with one side only.
    pub contradictions: Vec<[VertexId; 2]>,
}

impl Winding {
    /// Follows the edges of two faces; edges of more faces join pieces too, but say nothing about their sides.
    pub(super) fn new(mesh: &TriMesh, edges: &Edges) -> Self {
        let mut faces = DisjointSets::<FaceId, Relation>::new(mesh.triangles.len());
        let mut contradictions = Vec::new();
        for uses in edges.iter() {
            if let &[a, b] = uses {
                let relation = Relation::reversed_if(a.start(mesh) == b.start(mesh));
                if !faces.join(a.face, b.face, relation) {
                    contradictions.push([a.start(mesh), a.end(mesh)]);
                }
            }
        }
        for uses in edges.iter().filter(|uses| uses.len() > 2) {
            for other in &uses[1..] {
                let relation = Relation::reversed_if(uses[0].start(mesh) == other.start(mesh));
                let _ = faces.join(uses[0].face, other.face, relation);
            }
        }
        let mut number = IdVec::<FaceId, usize>::filled(usize::MAX, mesh.triangles.len());
        let mut first_relation = Vec::new();
        let mut component = IdVec::new();
        let mut against_first = IdVec::new();
        for face in mesh.triangles.ids() {
            let (root, relation) = faces.root(face);
            if number[root] == usize::MAX {
                number[root] = first_relation.len();
                first_relation.push(relation);
            }
            component.push(number[root]);
            against_first.push(relation != first_relation[number[root]]);
        }
        Self { component, components: first_relation.len(), against_first, contradictions }
    }
}
