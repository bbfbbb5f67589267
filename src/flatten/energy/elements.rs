//! The faces of a surface as finite elements: what the energies, the linear maps and the repairs
//! compute with.

use glam::{DMat2, DVec2, DVec3};

use crate::{
    delaunay::orientation,
    id::{FaceId, IdVec, VertexId},
    mesh::{Halfedge, SingularValues, VertexCorners, signed_area},
    sparse::Pattern,
};

/// Map positions of the vertices.
pub(crate) type Uv = IdVec<VertexId, DVec2>;

/// One face as the energies see it, in units of the square root of the whole area.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Element {
    pub(crate) corners: [VertexId; 3],
    /// Gradients of the three hat functions in the plane of the face.
    pub(crate) gradients: [DVec2; 3],
    pub(crate) weight: f64,
}

impl Element {
    /// Area times the scalar product of two hat gradients: an entry of the cotangent Laplacian,
    /// whatever the scale.
    pub(crate) fn stiffness(&self, k: usize, l: usize) -> f64 {
        let [_, g1, g2] = self.gradients;
        0.5 * self.gradients[k].dot(self.gradients[l]) / g1.perp_dot(g2)
    }

    /// Singular values of the map of this face.
    #[inline(always)]
    pub(crate) fn singular_values(&self, uv: &Uv) -> SingularValues {
        let [a, b, c] = self.corners.map(|v| uv[v]);
        let [g0, g1, g2] = self.gradients;
        SingularValues::of(&(outer(a, g0) + outer(b, g1) + outer(c, g2)))
    }
}

/// `a b'`.
pub(crate) fn outer(a: DVec2, b: DVec2) -> DMat2 {
    DMat2::from_cols(a * b.x, a * b.y)
}

/// Whether a face with these corners keeps its orientation, exactly; what is not finite does not.
pub(crate) fn keeps_orientation(corners: [DVec2; 3]) -> bool {
    orientation(corners) > 0.0
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
    /// Vertices that stay where they are though they are numbered as movable, whole boundary loops; empty
    /// for none.
    held: Vec<bool>,
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
        Self { faces, pattern, positions, boundary: Vec::new(), mean_edge: 0.0, held: Vec::new() }
    }

    /// The elements with `more` faces, whose corners may be fixed: numbered after those that may move.
    pub(crate) fn with(&self, more: Vec<Element>) -> Self {
        let faces = self.faces.iter().copied().chain(more).collect();
        Self {
            boundary: self.boundary.clone(),
            mean_edge: self.mean_edge,
            held: self.held.clone(),
            ..Self::new(faces, self.positions.clone())
        }
    }

    pub(crate) fn is_held(&self, vertex: usize) -> bool {
        self.held.get(vertex) == Some(&true)
    }

    /// The elements with vertices that stay where they are.
    pub(crate) fn holding(mut self, held: Vec<bool>) -> Self {
        self.held = held;
        self
    }

    /// Which vertices stay where they are, though they are numbered as movable.
    pub(crate) fn held_vertices(&self) -> impl Iterator<Item = usize> + '_ {
        self.held.iter().enumerate().filter(|(_, held)| **held).map(|(v, _)| v)
    }

    /// Number of vertices that may move.
    pub(crate) fn free(&self) -> usize {
        self.pattern.rows()
    }

    /// Signed area of the map of each face.
    pub(crate) fn map_areas<'a>(&'a self, uv: &'a Uv) -> impl Iterator<Item = f64> + 'a {
        self.faces.iter().map(|e| signed_area(e.corners.map(|v| uv[v])))
    }

    /// Whether each face is flipped on the map or has no area there.
    pub(crate) fn flips<'a>(&'a self, uv: &'a Uv) -> impl Iterator<Item = bool> + 'a {
        self.faces.iter().map(|e| !keeps_orientation(e.corners.map(|v| uv[v])))
    }

    /// The first face that is flipped on the map or has no area there.
    pub(crate) fn first_flip(&self, uv: &Uv) -> Option<FaceId> {
        self.flips(uv).position(|is_flipped| is_flipped).map(FaceId::new)
    }

    pub(crate) fn is_flip_free(&self, uv: &Uv) -> bool {
        self.first_flip(uv).is_none()
    }
}

/// Slot of a [`Corner`] whose other vertex is fixed or held: there is no unknown to couple with.
pub(crate) const FIXED: u32 = u32::MAX;

/// One corner of a face at a vertex, and the slots of the vertex's matrix row that its blocks go
/// to.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Corner {
    /// The halfedge that leaves the corner.
    pub(crate) at: Halfedge,
    /// Slots of the vertex itself, the next and the previous corner.
    pub(crate) slots: [u32; 3],
}

/// The corners around every movable vertex, so that the rows of the Hessian are summed in parallel,
/// always in the same order.
#[derive(Debug)]
pub(crate) struct CornerSlots {
    corners: VertexCorners,
    /// Slots of each of its corners.
    slots: Vec<[u32; 3]>,
    /// Vertices without a row; empty for none.
    held: Vec<bool>,
}

impl CornerSlots {
    pub(crate) fn new(net: &ElementMesh) -> Self {
        let corners = VertexCorners::new(net.faces.iter().map(|e| e.corners), net.free());
        let slots_of = |h: &Halfedge| {
            let around = [*h, h.next(), h.previous()].map(|h| net.faces[h.face()].corners[h.side()].index());
            let slot = |column| {
                let slot = net.pattern.slot(around[0], column).filter(|_| !net.is_held(column));
                slot.and_then(|s| u32::try_from(s).ok())
            };
            around.map(|column| slot(column).unwrap_or(FIXED))
        };
        let slots = corners.all().iter().map(slots_of).collect();
        Self { corners, slots, held: net.held.clone() }
    }

    pub(crate) fn of(&self, row: usize) -> impl Iterator<Item = Corner> {
        let v = VertexId::new(row);
        let slots = &self.slots[self.corners.range(v)];
        let free = if self.held.get(row) == Some(&true) { &[] } else { slots };
        self.corners.of(v).iter().zip(free).map(|(&at, &slots)| Corner { at, slots })
    }
}
