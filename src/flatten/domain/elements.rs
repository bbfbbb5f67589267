//! The faces of a surface as finite elements: what the energies, the linear maps and the repairs
//! compute with.

use glam::{DVec2, DVec3};

use crate::{
    id::{FaceId, IdVec, VertexId},
    sparse::Pattern,
};

/// One face as the energies see it, in units of the square root of the whole area.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Element {
    pub(crate) corners: [VertexId; 3],
    /// Gradients of the three hat functions in the plane of the face.
    pub(crate) gradients: [DVec2; 3],
    /// Share of the whole area.
    pub(crate) weight: f64,
}

impl Element {
    /// Area times the scalar product of two hat gradients: an entry of the cotangent Laplacian,
    /// whatever the scale.
    pub(crate) fn stiffness(&self, k: usize, l: usize) -> f64 {
        let [_, g1, g2] = self.gradients;
        0.5 * self.gradients[k].dot(self.gradients[l]) / g1.perp_dot(g2)
    }
}

/// Whether a face of this signed area keeps its orientation; NaN does not.
pub(crate) fn keeps_orientation(area: f64) -> bool {
    area > 0.0
}

/// A boundary edge between movable vertices.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BoundaryEdge {
    /// Its vertices; the face is on the left.
    pub(crate) ends: [VertexId; 2],
    /// Its length on the skin.
    pub(crate) length: f64,
}

/// Faces that share vertices, some of which may move: a whole surface, or a part of one inside a
/// fixed rim.
#[derive(Debug, Clone)]
pub(crate) struct ElementMesh {
    pub(crate) faces: IdVec<FaceId, Element>,
    /// Movable vertices that share an edge. They are numbered before the fixed ones.
    pub(crate) pattern: Pattern,
    /// Positions of the movable vertices on the skin, in m: they order large systems.
    pub(crate) positions: Vec<DVec3>,
    /// Boundary edges, loop by loop, the outer loop first; none for a part inside a fixed rim.
    pub(crate) boundary: Vec<BoundaryEdge>,
    /// Mean length of all edges.
    pub(crate) mean_edge: f64,
}

impl ElementMesh {
    /// The first vertices, those with a position, may move.
    pub(crate) fn new(faces: IdVec<FaceId, Element>, positions: Vec<DVec3>) -> Self {
        let free = positions.len();
        let edges = faces
            .iter()
            .flat_map(|e| {
                let [a, b, c] = e.corners.map(VertexId::index);
                [(a, b), (b, c), (c, a)]
            })
            .filter(|&(a, b)| a < free && b < free);
        let pattern = Pattern::new(free, edges);
        Self { faces, pattern, positions, boundary: Vec::new(), mean_edge: 0.0 }
    }

    /// The same with additional `pairs` of movable vertices coupled in the Hessian.
    pub(crate) fn coupled(&self, pairs: &[[VertexId; 2]]) -> Self {
        let old = &self.pattern;
        let edges = (0..old.rows()).flat_map(|i| old.columns(i).iter().map(move |&j| (i, j as usize)));
        let more = pairs.iter().map(|[a, b]| (a.index(), b.index()));
        let pattern = Pattern::new(old.rows(), edges.filter(|(i, j)| j < i).chain(more));
        Self { pattern, ..self.clone() }
    }

    /// Number of vertices that may move.
    pub(crate) fn free(&self) -> usize {
        self.pattern.rows()
    }

    /// Signed area of the map of each face.
    pub(crate) fn map_areas<'a>(&'a self, uv: &'a IdVec<VertexId, DVec2>) -> impl Iterator<Item = f64> + 'a {
        self.faces.iter().map(|e| {
            let [a, b, c] = e.corners.map(|v| uv[v]);
            0.5 * (b - a).perp_dot(c - a)
        })
    }

    /// Whether every face keeps its orientation on the map.
    pub(crate) fn is_flip_free(&self, uv: &IdVec<VertexId, DVec2>) -> bool {
        self.map_areas(uv).all(keeps_orientation)
    }
}

/// Slot of a [`Corner`] whose other vertex is fixed: there is no unknown to couple with.
pub(crate) const FIXED: u32 = u32::MAX;

/// One corner of a face at a vertex, and the slots of the vertex's matrix row that its blocks go
/// to.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Corner {
    pub(crate) face: FaceId,
    pub(crate) corner: u8,
    /// Slots of the vertex itself, the next and the previous corner.
    pub(crate) slots: [u32; 3],
}

/// The corners around every movable vertex, so that the rows of the Hessian are summed in parallel,
/// always in the same order.
#[derive(Debug)]
pub(crate) struct CornerSlots {
    starts: Vec<u32>,
    corners: Vec<Corner>,
}

impl CornerSlots {
    pub(crate) fn new(net: &ElementMesh) -> Self {
        let free = net.free();
        let mut starts = vec![0_u32; free + 1];
        for v in net.faces.iter().flat_map(|e| e.corners).filter(|v| v.index() < free) {
            starts[v.index() + 1] += 1;
        }
        for i in 0..free {
            starts[i + 1] += starts[i];
        }
        let mut cursor = starts.clone();
        let mut corners = vec![Corner::default(); starts[free] as usize];
        for (face, e) in net.faces.enumerate() {
            for corner in [0_u8, 1, 2] {
                let k = corner as usize;
                let around = [e.corners[k], e.corners[(k + 1) % 3], e.corners[(k + 2) % 3]];
                let row = around[0].index();
                if row >= free {
                    continue;
                }
                let slot = |v: VertexId| {
                    net.pattern.slot(row, v.index()).and_then(|s| u32::try_from(s).ok()).unwrap_or(FIXED)
                };
                corners[cursor[row] as usize] = Corner { face, corner, slots: around.map(slot) };
                cursor[row] += 1;
            }
        }
        Self { starts, corners }
    }

    /// The corners at the vertex of `row`.
    pub(crate) fn of(&self, row: usize) -> &[Corner] {
        &self.corners[self.starts[row] as usize..self.starts[row + 1] as usize]
    }
}
