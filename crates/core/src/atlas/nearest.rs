//! The vertex of a level nearest to a point of its surface.
//!
//! Distances are straight lines in space. The search follows edges from the corners of the point's face
//! through the vertices that are at most twice as far as the nearest one so far: vertices that are near in
//! space but far on the skin, as on the other side of a finger, are not reached. *Heuristic*: following edges
//! only to nearer vertices misses the nearest one for a pixel in a thousand on a cap of 500 taxels.

use glam::DVec3;

use crate::id::{IdVec, VertexId};
use crate::mesh::{TriMesh, edges};
use crate::numeric::Csr;

#[derive(Debug, Clone)]
#[doc(hidden)]
pub struct NearestVertices {
    positions: IdVec<VertexId, DVec3>,
    neighbours: Csr<VertexId>,
}

impl NearestVertices {
    #[doc(hidden)]
    pub fn new(mesh: &TriMesh) -> Self {
        let edges = edges(mesh);
        let pairs = edges.iter().flat_map(|&[a, b]| [(a.index(), b), (b.index(), a)]);
        let neighbours = Csr::from_pairs(mesh.positions.len(), pairs);
        Self { positions: mesh.positions.clone(), neighbours }
    }

    /// The vertex nearest to a point of a face; of equally near ones the first. `seen` is a buffer.
    #[doc(hidden)]
    pub fn find(&self, corners: [VertexId; 3], weights: [f64; 3], seen: &mut Vec<VertexId>) -> VertexId {
        /// Most vertices that one search visits.
        const MAX_SEEN: usize = 64;
        let p: DVec3 = corners.iter().zip(weights).map(|(&v, w)| self.positions[v] * w).sum();
        let near = |v: VertexId| (p.distance_squared(self.positions[v]), v);
        let nearer = |a: (f64, VertexId), b: (f64, VertexId)| if b < a { b } else { a };
        let mut best = corners.map(near).into_iter().fold(near(corners[0]), nearer);
        seen.clear();
        seen.extend(corners);
        let mut next = 0;
        while let Some(&v) = seen.get(next).filter(|_| seen.len() < MAX_SEEN) {
            next += 1;
            if next > 3 && near(v).0 > 4.0 * best.0 {
                continue;
            }
            for &other in &self.neighbours[v.index()] {
                if !seen.contains(&other) {
                    seen.push(other);
                    best = nearer(best, near(other));
                }
            }
        }
        best.1
    }
}
