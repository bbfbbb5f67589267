use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::Halfedge,
};

/// Every undirected edge of a list of triangles, with the halfedges that run along it.
///
/// Nothing is promised about manifoldness: an edge may have any number of halfedges, in either direction. Edges come
/// in the order of their smaller, then their larger vertex; the halfedges of one edge in the order of their faces.
#[derive(Debug, Clone)]
pub(crate) struct Edges {
    halfedges: Vec<Halfedge>,
    /// Where each edge starts in `halfedges`; one more entry than edges.
    starts: Vec<usize>,
}

impl Edges {
    /// Groups the halfedges of `triangles`, whose corners must all be below `vertices`, in time linear in their number.
    ///
    /// Halfedges are dropped into one bucket per smaller vertex; only within a bucket, which holds the few edges of one
    /// vertex, are they sorted. No hash map, so memory and order are predictable.
    pub(crate) fn new(triangles: &IdVec<FaceId, [VertexId; 3]>, vertices: usize) -> Self {
        let mut cursor = vec![0_usize; vertices + 1];
        let ends = |t: &[VertexId; 3], side: usize| (t[side], t[(side + 1) % 3]);
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
        // Larger vertex, then slot: one integer, so that sorting a bucket compares one word.
        let mut packed = vec![0_u64; 3 * triangles.len()];
        for (face, t) in triangles.enumerate() {
            for side in 0..3 {
                let (p, q) = ends(t, side);
                let at = &mut cursor[p.min(q).index()];
                packed[*at] = u64::from(p.max(q).raw()) << 32 | (3 * face.index() + side) as u64;
                *at += 1;
            }
        }
        let mut edges = Self { halfedges: Vec::with_capacity(packed.len()), starts: vec![0] };
        for range in bucket_starts.windows(2) {
            let bucket = &mut packed[range[0]..range[1]];
            bucket.sort_unstable();
            for uses in bucket.chunk_by(|a, b| a >> 32 == b >> 32) {
                #[expect(clippy::cast_possible_truncation, reason = "the lower half is the slot")]
                let slot = |packed: &u64| *packed as u32 as usize;
                edges.halfedges.extend(uses.iter().map(|packed| Halfedge::from_slot(slot(packed))));
                edges.starts.push(edges.halfedges.len());
            }
        }
        edges
    }

    /// The halfedges along each edge.
    pub(crate) fn iter(&self) -> impl ExactSizeIterator<Item = &[Halfedge]> {
        self.starts.windows(2).map(|range| &self.halfedges[range[0]..range[1]])
    }
}
