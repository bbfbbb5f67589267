//! The halfedges along every edge, found by bucket sort: all connectivity starts here.

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::{Halfedge, MeshError},
    numeric::Csr,
};

/// Visits the halfedges along every undirected edge of `triangles`, whose corners must all be below
/// `vertices`.
///
/// Takes time linear in their number. Edges come in the order of their smaller, then their larger
/// vertex; the halfedges of one edge in the order of their faces. Nothing is promised about
/// manifoldness: an edge may have any number of halfedges, in either direction.
///
/// Halfedges are dropped into one bucket per smaller vertex; only within a bucket, which holds the
/// few edges of one vertex, are they sorted. No hash map, so memory and order are predictable.
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

/// The halfedge on the other side of each, none on a boundary.
///
/// # Errors
/// If an edge has more than two faces or two that run the same way: of all such edges the first.
pub(crate) fn pair_halfedges(
    triangles: &IdVec<FaceId, [VertexId; 3]>,
    vertices: usize,
) -> Result<IdVec<FaceId, [Halfedge; 3]>, MeshError> {
    let mut twins = IdVec::<FaceId, _>::filled([Halfedge::NONE; 3], triangles.len());
    let mut error = None;
    let start = |h: Halfedge| triangles[h.face()][h.side()];
    each_edge(triangles, vertices, |along| match *along {
        [_] => {}
        [a, b] if start(a) != start(b) => {
            twins[a.face()][a.side()] = b;
            twins[b.face()][b.side()] = a;
        }
        _ => {
            error.get_or_insert_with(|| same_way(triangles, along));
        }
    });
    error.map_or(Ok(twins), Err)
}

/// The first two halfedges of an edge that run the same way; of three, two always do.
fn same_way(triangles: &IdVec<FaceId, [VertexId; 3]>, along: &[Halfedge]) -> MeshError {
    let start = |h: Halfedge| triangles[h.face()][h.side()];
    let (from, to) = (start(along[0]), start(along[0].next()));
    let forward = along.iter().filter(|h| start(**h) == from).count();
    let (from, to) = if forward >= 2 { (from, to) } else { (to, from) };
    let mut faces = along.iter().filter(|h| start(**h) == from).map(|h| h.face());
    let (first, second) = (faces.next().unwrap_or_default(), faces.next().unwrap_or_default());
    MeshError::NonManifoldEdge { from, to, first, second }
}
