//! The halfedges along every edge, found by bucket sort; the edges and the boundary that follow from them,
//! and the corners around each vertex. All connectivity starts here. Triangles need not be manifold, but
//! their corners must exist.

use std::marker::PhantomData;

use crate::id::{FaceId, Id, IdVec, VertexId};
use crate::mesh::{Halfedge, MeshError, TriMesh};
use crate::numeric::{Csr, chains};

/// Visits the halfedges along every undirected edge of `triangles`, whose corners must all be below
/// `vertices`.
///
/// Takes time linear in their number. Edges come in the order of their smaller, then their larger
/// vertex; the halfedges of one edge in the order of their faces. Nothing is promised about
/// manifoldness: an edge may have any number of halfedges, in either direction.
///
/// Halfedges are dropped into one bucket per smaller vertex; they are sorted only within a bucket, which has
/// the few edges of one vertex. No hash map, so memory and order are predictable.
pub(crate) fn each_edge(
    triangles: &IdVec<FaceId, [VertexId; 3]>,
    vertices: usize,
    mut visit: impl FnMut(&[Halfedge]),
) {
    let ends = |t: &[VertexId; 3], side: usize| (t[side], t[(side + 1) % 3]);
    let mut cursor = vec![0_usize; vertices + 1];
    for t in triangles {
        for side in 0..3 {
            let (p, q) = ends(t, side);
            cursor[p.min(q).index() + 1] += 1;
        }
    }
    for i in 0..vertices {
        cursor[i + 1] += cursor[i];
    }
    let bucket_starts = cursor.clone();
    // Larger vertex, then halfedge: one integer, so that sorting a bucket compares one word.
    let mut packed = vec![0_u64; 3 * triangles.len()];
    for (face, t) in triangles.enumerate() {
        for side in 0..3 {
            let (p, q) = ends(t, side);
            let at = &mut cursor[p.min(q).index()];
            packed[*at] = u64::from(p.max(q).raw()) << 32 | u64::from(Halfedge::new(face, side).raw());
            *at += 1;
        }
    }
    let mut halfedges = Vec::new();
    for range in bucket_starts.windows(2) {
        let bucket = &mut packed[range[0]..range[1]];
        bucket.sort_unstable();
        for along in bucket.chunk_by(|a, b| a >> 32 == b >> 32) {
            #[expect(clippy::cast_possible_truncation, reason = "the lower half is the halfedge")]
            let halfedge = |packed: &u64| Halfedge::from_raw(*packed as u32);
            halfedges.clear();
            halfedges.extend(along.iter().map(halfedge));
            visit(&halfedges);
        }
    }
}

/// The halfedges along every edge, kept; see [`each_edge`] for their order.
#[derive(Debug, Clone)]
pub(crate) struct Edges(Csr<Halfedge>);

impl Edges {
    /// Groups the halfedges of `triangles`, whose corners must all be below `vertices`.
    pub(crate) fn new(triangles: &IdVec<FaceId, [VertexId; 3]>, vertices: usize) -> Self {
        let mut edges = Csr::with_capacity(0, 3 * triangles.len());
        each_edge(triangles, vertices, |along| edges.push(along.iter().copied()));
        Self(edges)
    }

    pub(crate) fn iter(&self) -> impl ExactSizeIterator<Item = &[Halfedge]> {
        self.0.iter()
    }
}

/// The error of the first edge of more than two faces, or of two in the same direction.
pub(crate) fn first_crowded(mesh: &TriMesh) -> Option<MeshError> {
    let mut error = None;
    each_edge(&mesh.triangles, mesh.positions.len(), |along| {
        let is_sound = matches!(*along, [_]) || matches!(*along, [a, b] if a.start(mesh) != b.start(mesh));
        if !is_sound {
            error.get_or_insert_with(|| same_direction(&mesh.triangles, along));
        }
    });
    error
}

/// The first two halfedges of an edge with the same direction; of three, two always have it.
fn same_direction(triangles: &IdVec<FaceId, [VertexId; 3]>, along: &[Halfedge]) -> MeshError {
    let start = |h: Halfedge| triangles[h.face()][h.side()];
    let (from, to) = (start(along[0]), start(along[0].next()));
    let forward = along.iter().filter(|h| start(**h) == from).count();
    let (from, to) = if forward >= 2 { (from, to) } else { (to, from) };
    let mut faces = along.iter().filter(|h| start(**h) == from).map(|h| h.face());
    let (first, second) = (faces.next().unwrap_or_default(), faces.next().unwrap_or_default());
    MeshError::NonManifoldEdge { from, to, first, second }
}

/// Every undirected edge once, smaller vertex first, sorted.
#[doc(hidden)]
pub fn edges(mesh: &TriMesh) -> Vec<[VertexId; 2]> {
    let mut edges = Vec::new();
    each_edge(&mesh.triangles, mesh.positions.len(), |along| {
        let h = along[0];
        let [a, b] = [h.start(mesh), h.end(mesh)];
        edges.push([a.min(b), a.max(b)]);
    });
    edges
}

/// The vertices that edges join to each vertex. Vertices of several meshes are counted mesh after mesh.
pub(crate) fn neighbours<'m>(meshes: impl IntoIterator<Item = &'m TriMesh>) -> Csr<u32> {
    let (mut pairs, mut count) = (Vec::new(), 0_u32);
    for mesh in meshes {
        for edge in edges(mesh) {
            let [a, b] = edge.map(|v| count + v.raw());
            pairs.extend([(a as usize, b), (b as usize, a)]);
        }
        count += u32::try_from(mesh.positions.len()).unwrap_or(u32::MAX);
    }
    Csr::from_pairs(count as usize, pairs.iter().copied())
}

/// The edges of exactly one face, in the direction in which that face runs, sorted.
#[doc(hidden)]
pub fn boundary_edges(mesh: &TriMesh) -> Vec<[VertexId; 2]> {
    let mut edges = Vec::new();
    each_edge(&mesh.triangles, mesh.positions.len(), |along| {
        if let [h] = *along {
            edges.push([h.start(mesh), h.end(mesh)]);
        }
    });
    edges.sort_unstable();
    edges
}

/// The boundary as loops of vertices, faces on the left, each from its smallest vertex; where triangles are
/// not an oriented manifold, only loops that close.
#[doc(hidden)]
pub fn boundary_loops(mesh: &TriMesh) -> Vec<Vec<VertexId>> {
    loops_of(&boundary_edges(mesh))
}

/// The loops of directed edges; `edges` must be sorted.
#[doc(hidden)]
pub fn loops_of(edges: &[[VertexId; 2]]) -> Vec<Vec<VertexId>> {
    let next = |k: usize| {
        let end = edges[k][1];
        let place = edges.partition_point(|edge| edge[0] < end);
        edges.get(place).is_some_and(|edge| edge[0] == end).then_some(place)
    };
    let vertices = |walk: Vec<usize>| walk.into_iter().map(|k| edges[k][0]).collect();
    chains(edges.len(), next).into_iter().map(vertices).collect()
}

/// The corners around each vertex, in the order of their faces, for any set of triangles, manifold
/// or not; or around each place of a map. A corner is named by the halfedge that leaves it.
#[derive(Debug, Clone)]
#[doc(hidden)]
pub struct VertexCorners<V = VertexId>(Csr<Halfedge>, PhantomData<V>);

impl<V: Id> VertexCorners<V> {
    /// Lists the corners of the first `vertices` vertices; those of others are left out.
    #[doc(hidden)]
    pub fn new(triangles: impl Iterator<Item = [V; 3]> + Clone, vertices: usize) -> Self {
        let corners = triangles.enumerate().flat_map(|(face, t)| {
            let face = FaceId::new(face);
            [0, 1, 2].map(|side| (t[side].index(), Halfedge::new(face, side)))
        });
        Self(Csr::from_pairs(vertices, corners.filter(move |&(v, _)| v < vertices)), PhantomData)
    }

    #[inline]
    #[doc(hidden)]
    pub fn of(&self, v: V) -> &[Halfedge] {
        &self.0[v.index()]
    }

    /// The faces around `v`, smallest id first.
    #[inline]
    #[doc(hidden)]
    pub fn faces(&self, v: V) -> impl Iterator<Item = FaceId> + Clone {
        self.of(v).iter().map(|h| h.face())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Adjacency, shapes};

    #[test]
    fn loops_are_those_of_the_adjacency() {
        for mesh in [shapes::fan(5), shapes::lattice(7, 6, 1.0), shapes::tube(5, 4, 1.0, 2.0)] {
            let adjacency = Adjacency::new(&mesh).unwrap();
            assert_eq!(boundary_loops(&mesh), adjacency.boundary_loops());
            assert_eq!(edges(&mesh).len(), adjacency.rings.edges());
        }
    }

    #[test]
    fn an_edge_of_three_faces_is_not_on_the_boundary() {
        let book = TriMesh::from_arrays(vec![glam::DVec3::ZERO; 5], &[[0, 1, 2], [0, 1, 3], [1, 0, 4]]);
        let found = boundary_edges(&book);
        assert!(!found.contains(&[0, 1].map(VertexId::new)), "{found:?}");
        assert_eq!(found.len(), 6);
    }

    #[test]
    fn every_corner_is_listed_at_its_vertex() {
        let mesh = shapes::fan(5);
        let corners = VertexCorners::new(mesh.triangles.iter().copied(), 3);
        for v in [0, 1, 2].map(VertexId::new) {
            assert!(corners.of(v).iter().all(|h| h.start(&mesh) == v), "corners of {v}");
            assert!(corners.faces(v).is_sorted(), "faces of {v}");
            assert_eq!(corners.of(v).len(), if v.index() == 0 { 5 } else { 2 });
        }
    }
}
