//! Fans: the faces around a vertex that are connected across edges. Each gets a vertex of its own.

use std::{cmp::Reverse, collections::HashMap};

use crate::id::{IdVec, VertexId};
use crate::mesh::{Halfedge, TriMesh};
use crate::numeric::DisjointSets;

/// Joins the corners at both ends of two halfedges along one edge.
pub(in crate::skin) fn join(
    mesh: &TriMesh,
    corners: &mut DisjointSets<Halfedge>,
    first: Halfedge,
    other: Halfedge,
) {
    let [a, b] = [first, first.next()];
    let [mut c, mut d] = [other, other.next()];
    if first.start(mesh) != other.start(mesh) {
        (c, d) = (d, c);
    }
    corners.join(a, c);
    corners.join(b, d);
}

/// The changes at vertices with several fans of faces.
#[derive(Debug, Default)]
pub(in crate::skin) struct Split {
    /// The corners at such vertices, and their new vertices.
    pub corners: Vec<(Halfedge, VertexId)>,
    /// Vertices of the file, and the vertices that replace them.
    pub names: Vec<(VertexId, VertexId)>,
    /// The vertex of the file that each new one is a copy of; they are numbered after all others.
    pub copied: Vec<VertexId>,
    /// Vertices of the file that several fans share.
    pub touching: Vec<VertexId>,
}

/// Gives every fan around a vertex with several of them a vertex of its own: one of those that it
/// has in the file (`in_file`), or a copy.
pub(in crate::skin) fn split_fans(
    mesh: &TriMesh,
    fans: &mut DisjointSets<Halfedge>,
    in_file: impl Fn(Halfedge) -> VertexId,
) -> Split {
    let mut fans_of_vertex = IdVec::<VertexId, u32>::filled(0, mesh.positions.len());
    for (face, t) in mesh.triangles.enumerate() {
        for (corner, &v) in Halfedge::of_face(face).into_iter().zip(t) {
            fans_of_vertex[v] += u32::from(fans.root(corner) == corner);
        }
    }
    let mut split = Split::default();
    if fans_of_vertex.iter().all(|&n| n <= 1) {
        return split;
    }
    // The welded vertex, the vertex of the file, the fan, each corner of it.
    let mut corners: Vec<(VertexId, VertexId, Halfedge, Halfedge)> = Vec::new();
    for (face, t) in mesh.triangles.enumerate() {
        for (corner, &v) in Halfedge::of_face(face).into_iter().zip(t) {
            if fans_of_vertex[v] > 1 {
                corners.push((v, in_file(corner), fans.root(corner), corner));
            }
        }
    }
    corners.sort_unstable();
    for around in corners.chunk_by(|a, b| a.0 == b.0) {
        split.vertex(around, mesh.positions.len());
    }
    split.touching.sort_unstable();
    split.touching.dedup();
    split
}

impl Split {
    /// Splits one vertex; `around` are its corners by vertex of the file, then fan.
    fn vertex(&mut self, around: &[(VertexId, VertexId, Halfedge, Halfedge)], count: usize) {
        // A fan gets the first vertex of the file that no earlier fan has.
        let mut names: HashMap<Halfedge, VertexId> = HashMap::new();
        for of_vertex in around.chunk_by(|a, b| a.1 == b.1) {
            let v = of_vertex[0].1;
            let mut owner = None;
            for &(_, _, fan, _) in of_vertex {
                if owner.is_none() && !names.contains_key(&fan) {
                    names.insert(fan, v);
                    owner = Some(fan);
                }
            }
            if of_vertex.windows(2).any(|pair| pair[0].2 != pair[1].2) {
                self.touching.push(v);
            }
        }
        for &(_, v, fan, corner) in around {
            let name = *names.entry(fan).or_insert_with(|| {
                self.copied.push(v);
                VertexId::new(count + self.copied.len() - 1)
            });
            self.corners.push((corner, name));
        }
        // The last entry of a vertex counts: the one with its own name, if there is one.
        let mut of_file: Vec<(VertexId, Reverse<bool>, VertexId)> =
            around.iter().map(|&(_, v, fan, _)| (v, Reverse(names[&fan] != v), names[&fan])).collect();
        of_file.sort_unstable();
        of_file.dedup();
        self.names.extend(of_file.into_iter().map(|(v, _, name)| (v, name)));
    }
}
