//! Consistent winding: the components of a sheet and which of their faces are turned over.

use std::collections::VecDeque;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Edges, Halfedge, TriMesh};
use crate::numeric::{DisjointSets, Labels, Relation};

/// The components of a mesh across edges, and which faces to turn so that each is wound consistently.
#[derive(Debug)]
pub(in crate::skin) struct Winding {
    /// The component of every face, numbered in the order of their first faces.
    pub components: Labels<FaceId>,
    /// Whether each face is wound against the first face of its component.
    pub reversed: IdVec<FaceId, bool>,
    /// Edges whose two faces cannot be wound consistently: the component has only one side.
    pub conflicting_edges: Vec<[VertexId; 2]>,
}

impl Winding {
    /// Follows the edges of two faces; edges of more faces join components too, but do not relate their
    /// winding.
    pub(in crate::skin) fn new(mesh: &TriMesh, edges: &Edges) -> Self {
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
        // The root is the first face of its component.
        let reversed = mesh.triangles.ids().map(|face| faces.root(face).1.is_reversed()).collect();
        Self { components: faces.labels(), reversed, conflicting_edges }
    }
}

/// The shortest closed strip of neighbouring faces that reverses its winding once around. It passes through
/// an edge of `conflicting_edges`; empty without such a strip there.
pub(in crate::skin) fn one_sided_strip(mesh: &TriMesh, edges: &Edges, through: [VertexId; 2]) -> Vec<FaceId> {
    // Across each side of a face: the other face, and whether it is wound against this one.
    let mut across = IdVec::<FaceId, [Option<(FaceId, usize)>; 3]>::filled([None; 3], mesh.triangles.len());
    let mut start = None;
    for uses in edges.iter() {
        if let &[a, b] = uses {
            let turn = usize::from(a.start(mesh) == b.start(mesh));
            let mut join = |a: Halfedge, b: Halfedge| across[a.face()][a.side()] = Some((b.face(), turn));
            join(a, b);
            join(b, a);
            if [a.start(mesh), a.end(mesh)] == through {
                start = Some(a.face());
            }
        }
    }
    let Some(start) = start else { return Vec::new() };
    // The predecessor of each face, for both windings.
    let mut before = IdVec::<FaceId, [Option<(FaceId, usize)>; 2]>::filled([None; 2], mesh.triangles.len());
    let mut queue = VecDeque::from([(start, 0)]);
    while let Some((face, side)) = queue.pop_front() {
        for &(next, turn) in across[face].iter().flatten() {
            let seen = (next, side ^ turn);
            if seen != (start, 0) && before[next][seen.1].is_none() {
                before[next][seen.1] = Some((face, side));
                queue.push_back(seen);
            }
        }
    }
    let back = std::iter::successors(before[start][1], |&(face, side)| {
        before[face][side].filter(|_| (face, side) != (start, 0))
    });
    back.map(|(face, _)| face).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    /// A strip of seven squares, closed with half a turn: all its faces, once around.
    #[test]
    fn the_strip_goes_round_once() {
        let v = |k: u32| if k < 14 { k } else { [1, 0][(k - 14) as usize] };
        let squares = (0..7).map(|k| [2 * k, 2 * k + 1, 2 * k + 2, 2 * k + 3].map(v));
        let triangles: Vec<[u32; 3]> = squares.flat_map(|[a, b, c, d]| [[a, c, b], [b, c, d]]).collect();
        let mesh = TriMesh::from_arrays(vec![glam::DVec3::ZERO; 14], &triangles);
        let edges = Edges::new(&mesh.triangles, mesh.positions.len());
        let conflict = Winding::new(&mesh, &edges).conflicting_edges[0];
        let mut strip = one_sided_strip(&mesh, &edges, conflict);
        assert_eq!(strip.len(), 14);
        strip.sort_unstable();
        strip.dedup();
        assert_eq!(strip.len(), 14, "every face once");
        let square = shapes::square();
        let edges = Edges::new(&square.triangles, 4);
        assert_eq!(one_sided_strip(&square, &edges, [0, 1].map(VertexId::new)), []);
    }
}
