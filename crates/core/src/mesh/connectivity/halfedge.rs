//! One side of one face, in four bytes.

use std::fmt;

use crate::id::{FaceId, Id, VertexId};
use crate::mesh::TriMesh;
use crate::mesh::error::MAX_FACES;

/// One side of a face: halfedge `k` of a face runs from its corner `k` to its corner `k + 1`.
///
/// It also represents the corner that it leaves.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[doc(hidden)]
pub struct Halfedge(u32);

impl Halfedge {
    /// No face on the other side, or no halfedge at all.
    pub(crate) const NONE: Self = Self(u32::MAX);

    /// Side `side` of `face`.
    /// Panics if `side` is not 0, 1 or 2. Meshes with more than 2^30 faces are refused by
    /// [`TriMesh::validate`].
    #[inline]
    pub(crate) fn new(face: FaceId, side: usize) -> Self {
        debug_assert!(face.index() < MAX_FACES, "refused by `TriMesh::validate`");
        Self(face.raw() << 2 | [0, 1, 2][side])
    }

    /// The sides of a face.
    #[inline]
    pub(crate) fn of_face(face: FaceId) -> [Self; 3] {
        [0, 1, 2].map(|side| Self::new(face, side))
    }

    #[inline]
    #[doc(hidden)]
    pub fn face(self) -> FaceId {
        FaceId::from(self.0 >> 2)
    }

    /// Which side of the face it is: 0, 1 or 2.
    #[inline]
    pub(crate) const fn side(self) -> usize {
        (self.0 & 3) as usize
    }

    /// The side of the same face that starts where this one ends.
    #[inline]
    pub(crate) const fn next(self) -> Self {
        Self(if self.0 & 3 == 2 { self.0 - 2 } else { self.0 + 1 })
    }

    /// The side of the same face that ends where this one starts; across it lies the next face
    /// counter-clockwise around that vertex.
    #[inline]
    pub(crate) const fn previous(self) -> Self {
        Self(if self.0 & 3 == 0 { self.0 + 2 } else { self.0 - 1 })
    }

    #[inline]
    pub(crate) fn start(self, mesh: &TriMesh) -> VertexId {
        mesh.triangles[self.face()][self.side()]
    }

    #[inline]
    pub(crate) fn end(self, mesh: &TriMesh) -> VertexId {
        mesh.triangles[self.face()][self.next().side()]
    }

    /// The packed number, by which halfedges are sorted.
    #[inline]
    pub(crate) const fn raw(self) -> u32 {
        self.0
    }

    #[inline]
    pub(crate) const fn from_raw(raw: u32) -> Self {
        Self(raw)
    }
}

impl Default for Halfedge {
    fn default() -> Self {
        Self::NONE
    }
}

/// Arrays of halfedges have four entries for each face; the last is unused.
impl Id for Halfedge {
    fn new(index: usize) -> Self {
        Self(u32::try_from(index).expect("more than 2^30 faces"))
    }

    fn index(self) -> usize {
        self.0 as usize
    }
}

impl fmt::Debug for Halfedge {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == Self::NONE { f.write_str("none") } else { write!(f, "{:?}.{}", self.face(), self.side()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_sides_follow_each_other() {
        let face = FaceId::new(MAX_FACES - 1);
        for side in 0..3 {
            let h = Halfedge::new(face, side);
            assert_eq!((h.face(), h.side(), h.next().side()), (face, side, (side + 1) % 3));
            assert_eq!(h.next().previous(), h);
            assert_ne!(h, Halfedge::NONE);
        }
        assert_eq!(format!("{:?}", Halfedge::new(FaceId::new(7), 1)), "f7.1");
    }
}
