//! The removals between two levels, in order, so that flattening can undo them on the map.

use crate::id::{FaceId, IdVec, VertexId};

/// One vertex removed from a level: its ring just before and the triangles that filled the hole.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Removal<'a> {
    /// The vertex removed.
    pub vertex: VertexId,
    /// Its neighbours just before, counter-clockwise; an open chain if it was on a boundary,
    /// from the next to the previous vertex of its loop.
    pub ring: &'a [VertexId],
    /// Whether it was on a boundary.
    pub boundary: bool,
    /// Triangles of ring positions that filled the hole, counter-clockwise.
    pub triangles: &'a [[u8; 3]],
}

impl<'a> Removal<'a> {
    /// The triangles that took their place.
    pub(crate) fn filling(&self) -> impl Iterator<Item = [VertexId; 3]> + use<'a> {
        let ring = self.ring;
        self.triangles.iter().map(move |t| t.map(|i| ring[usize::from(i)]))
    }
}

/// The removals that turned a level into the next coarser one, in order; all ids are the finer
/// level's.
///
/// Undone in reverse it puts each vertex back into its own star, on the skin or on a map.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RemovalLog {
    vertices: Vec<(VertexId, bool)>,
    ring_ends: Vec<u32>,
    rings: Vec<VertexId>,
    triangle_ends: Vec<u32>,
    triangles: Vec<[u8; 3]>,
}

impl RemovalLog {
    /// No removals yet; allocates memory for about this many, of stars of six faces.
    pub(crate) fn with_capacity(removals: usize) -> Self {
        Self {
            vertices: Vec::with_capacity(removals),
            ring_ends: Vec::with_capacity(removals),
            rings: Vec::with_capacity(6 * removals),
            triangle_ends: Vec::with_capacity(removals),
            triangles: Vec::with_capacity(4 * removals),
        }
    }

    pub(crate) fn push(&mut self, removal: &Removal<'_>) {
        self.vertices.push((removal.vertex, removal.boundary));
        self.rings.extend_from_slice(removal.ring);
        self.ring_ends.push(VertexId::new(self.rings.len()).raw());
        self.triangles.extend_from_slice(removal.triangles);
        self.triangle_ends.push(VertexId::new(self.triangles.len()).raw());
    }

    /// Renumbers every vertex.
    pub(crate) fn renumber(&mut self, number: impl Fn(VertexId) -> VertexId) {
        self.vertices.iter_mut().for_each(|(v, _)| *v = number(*v));
        self.rings.iter_mut().for_each(|v| *v = number(*v));
    }

    pub(crate) fn len(&self) -> usize {
        self.vertices.len()
    }

    /// The triangles of the finer level after its first `count` removals, in finer ids: all removals give the
    /// coarser level, none the finer one, and numbers between them the steps in which a map is refined.
    ///
    /// A triangle disappears exactly when the first of its corners is removed, so no search is needed.
    pub(crate) fn triangles_after(
        &self,
        finer: &IdVec<FaceId, [VertexId; 3]>,
        count: usize,
    ) -> IdVec<FaceId, [VertexId; 3]> {
        let last = finer.iter().flatten().map(|v| v.index() + 1).max().unwrap_or(0);
        let mut gone = IdVec::<VertexId, bool>::filled(false, last);
        for &(v, _) in self.vertices.iter().take(count) {
            if v.index() < last {
                gone[v] = true;
            }
        }
        let born = self.iter().take(count).flat_map(|removal| removal.filling());
        finer.iter().copied().chain(born).filter(|t| t.iter().all(|&v| gone.get(v) == Some(&false))).collect()
    }

    /// The removals, first to last.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = Removal<'_>> + ExactSizeIterator {
        let range = |ends: &[u32], i: usize| {
            let start = if i == 0 { 0 } else { ends[i - 1] as usize };
            start..ends[i] as usize
        };
        (0..self.vertices.len()).map(move |i| Removal {
            vertex: self.vertices[i].0,
            boundary: self.vertices[i].1,
            ring: &self.rings[range(&self.ring_ends, i)],
            triangles: &self.triangles[range(&self.triangle_ends, i)],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The middle of a square of four triangles is removed, then one of its corners, which is on the
    /// boundary.
    #[test]
    fn triangles_disappear_with_the_first_of_their_corners() {
        let v = |ids: [u32; 3]| ids.map(VertexId::from);
        let ring = [1, 2, 3, 4].map(VertexId::new);
        let mut log = RemovalLog::default();
        log.push(&Removal {
            vertex: VertexId::new(0),
            ring: &ring,
            boundary: false,
            triangles: &[[0, 1, 2], [0, 2, 3]],
        });
        let chain = [2, 3, 4].map(VertexId::new);
        log.push(&Removal {
            vertex: VertexId::new(1),
            ring: &chain,
            boundary: true,
            triangles: &[[0, 1, 2]],
        });
        let fine: IdVec<FaceId, _> = vec![v([0, 1, 2]), v([0, 2, 3]), v([0, 3, 4]), v([0, 4, 1])].into();
        let after = |count: usize| log.triangles_after(&fine, count);
        assert_eq!(after(0), fine);
        assert_eq!(after(1).as_slice(), [v([1, 2, 3]), v([1, 3, 4])]);
        assert_eq!(after(2).as_slice(), [v([2, 3, 4])]);
        assert_eq!(after(9), after(2), "no more than all");

        let removals: Vec<_> = log.iter().collect();
        assert_eq!(removals[1].filling().collect::<Vec<_>>(), [v([2, 3, 4])]);
    }
}
