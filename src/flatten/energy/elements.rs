//! The faces of a surface as finite elements: what the energies, the linear maps and the repairs
//! compute with.

use std::sync::OnceLock;

use glam::{DMat2, DVec2, DVec3};
use rayon::prelude::*;

use crate::delaunay::orientation;
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{SingularValues, signed_area};
use crate::numeric::along_curve;
use crate::parallel::{par_ids, par_map};
use crate::sparse::Pattern;

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

    /// The Jacobian of the map of this face.
    #[inline(always)]
    pub(crate) fn jacobian(&self, uv: &Uv) -> DMat2 {
        let [a, b, c] = self.corners.map(|v| uv[v]);
        let [_, g1, g2] = self.gradients;
        outer(b - a, g1) + outer(c - a, g2)
    }

    /// Singular values of the map of this face.
    pub(crate) fn singular_values(&self, uv: &Uv) -> SingularValues {
        SingularValues::of(&self.jacobian(uv))
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
    /// See [`Self::pattern`].
    pattern: OnceLock<Pattern>,
    /// Positions of the movable vertices on the skin, in m: they order large systems. Movable vertices are numbered
    /// before the fixed ones.
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
        let pattern = OnceLock::new();
        Self { faces, pattern, positions, boundary: Vec::new(), mean_edge: 0.0, held: Vec::new() }
    }

    /// Movable vertices that share an edge.
    pub(crate) fn pattern(&self) -> &Pattern {
        self.pattern.get_or_init(|| {
            let free = self.free();
            let sides = |e: &Element| {
                let [a, b, c] = e.corners.map(VertexId::index);
                [(a, b), (b, c), (c, a)]
            };
            let edges = self.faces.iter().flat_map(sides);
            Pattern::new(free, edges.filter(|&(a, b)| a < free && b < free))
        })
    }

    /// The elements with vertices and faces numbered along a curve that fills space, and the vertex that each of
    /// the movable ones was: what is near in space is near in memory.
    pub(crate) fn along_curve(&self) -> (Self, IdVec<VertexId, VertexId>) {
        let order: IdVec<VertexId, VertexId> =
            along_curve(&self.positions).into_iter().map(VertexId::new).collect();
        let mut number: IdVec<VertexId, VertexId> = order.clone();
        order.enumerate().for_each(|(new, &old)| number[old] = new);
        let new = |v: VertexId| number.get(v).copied().unwrap_or(v);
        let first = |face| self.faces[face].corners.map(new).into_iter().min();
        let mut faces: Vec<(Option<VertexId>, FaceId)> =
            par_ids::<FaceId, _>(self.faces.len(), |face| (first(face), face)).into_iter().collect();
        faces.par_sort_unstable();
        let renumbered = |&(_, face): &(_, FaceId)| {
            let e = self.faces[face];
            Element { corners: e.corners.map(new), ..e }
        };
        let boundary = self.boundary.iter().map(|edge| BoundaryEdge { ends: edge.ends.map(new), ..*edge });
        let elements = Self {
            boundary: boundary.collect(),
            mean_edge: self.mean_edge,
            held: order.iter().filter_map(|v| self.held.get(v.index()).copied()).collect(),
            ..Self::new(
                par_map(&faces, renumbered).into(),
                order.iter().map(|v| self.positions[v.index()]).collect(),
            )
        };
        (elements, order)
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
        self.positions.len()
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
