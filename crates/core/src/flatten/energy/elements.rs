//! The faces of a surface as finite elements, for energies, linear maps and repairs.

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

/// One face as a finite element, in units of the square root of the whole area.
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

    /// The face with a rest shape between its own and that on the map: the singular values there, raised to a power
    /// that brings both within `most` and `1 / most`; `None` where both are.
    fn bounded(&self, uv: &Uv, most: f64) -> Option<Self> {
        let j = self.jacobian(uv);
        let SingularValues { s1, s2 } = SingularValues::of(&j);
        let largest = s1.max(s2.recip()).ln();
        if largest.is_nan() || largest.is_infinite() || largest <= most.ln() {
            return None;
        }
        let power = most.ln() / largest - 1.0;
        let turn = DVec2::new(j.x_axis.x + j.y_axis.y, j.x_axis.y - j.y_axis.x);
        let mirror = DVec2::new(j.x_axis.x - j.y_axis.y, j.x_axis.y + j.y_axis.x);
        let axis = DVec2::from_angle(0.5 * (mirror.to_angle() - turn.to_angle()));
        let [along, across] = [s1, s2].map(|s| s.powf(power));
        let stretch = |g: DVec2| axis * (along * axis.dot(g)) + axis.perp() * (across * axis.perp().dot(g));
        Some(Self { gradients: self.gradients.map(stretch), ..*self })
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

/// Whether a face with these corners keeps its orientation, exactly; false if a corner is not finite.
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

/// Faces that share vertices, some of which may move: a whole surface, or a region of one inside a fixed rim.
#[derive(Debug, Clone)]
pub(crate) struct ElementMesh {
    pub(crate) faces: IdVec<FaceId, Element>,
    /// See [`Self::pattern`].
    pattern: OnceLock<Pattern>,
    /// Positions of the movable vertices on the skin, in m: they order large systems. Movable vertices are numbered
    /// before the fixed ones.
    pub(crate) positions: Vec<DVec3>,
    /// Boundary edges, loop by loop, the outer loop first; none for a region inside a fixed rim.
    pub(crate) boundary: Vec<BoundaryEdge>,
    /// Mean length of all edges.
    pub(crate) mean_edge: f64,
    /// Whether each vertex that is numbered as movable is fixed nevertheless, always for whole boundary
    /// loops; empty for none.
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

    /// The elements with vertices and faces numbered along a space-filling curve, so that neighbours are near
    /// in memory, and the old id of each movable vertex.
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

    /// The elements with rest shapes that the map `uv` stretches by `most` in each direction, at most (the progressive
    /// reference of `(liu2018)`); `None` where it stretches no face more.
    pub(crate) fn bounded(&self, uv: &Uv, most: f64) -> Option<Self> {
        let bounded: Vec<Option<Element>> = par_map(self.faces.as_slice(), |e| e.bounded(uv, most));
        bounded.iter().any(Option::is_some).then(|| {
            let faces = self.faces.iter().zip(bounded).map(|(e, bounded)| bounded.unwrap_or(*e)).collect();
            Self { faces, ..self.clone() }
        })
    }

    pub(crate) fn is_held(&self, vertex: usize) -> bool {
        self.held.get(vertex) == Some(&true)
    }

    /// The elements with fixed vertices.
    pub(crate) fn holding(mut self, held: Vec<bool>) -> Self {
        self.held = held;
        self
    }

    /// The vertices that are fixed although they are numbered as movable.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A rest shape moves towards the map until both singular values are within the bound, along the same axes.
    #[test]
    fn bounded_rest_shapes_are_stretched_by_the_bound_at_most() {
        let corners = [0, 1, 2].map(VertexId::new);
        let face = Element { corners, gradients: [-DVec2::ONE, DVec2::X, DVec2::Y], weight: 1.0 };
        let mesh = ElementMesh::new(vec![face].into(), vec![DVec3::ZERO; 3]);
        for (s1, s2) in [(1.5, 0.7), (100.0, 20.0), (3.0, 1e-6), (1e-3, 1e-5)] {
            let j =
                DMat2::from_angle(0.4) * DMat2::from_diagonal(DVec2::new(s1, s2)) * DMat2::from_angle(1.1);
            let uv = [DVec2::ZERO, j.x_axis, j.y_axis].into_iter().collect();
            let found = mesh.bounded(&uv, 2.0).map(|mesh| mesh.faces[FaceId::new(0)].singular_values(&uv));
            let largest = [s1, s2].map(f64::ln).into_iter().fold(0.0, |most: f64, log| most.max(log.abs()));
            if largest <= 2.0_f64.ln() {
                assert!(found.is_none());
                continue;
            }
            let found = found.expect("it is stretched by more");
            let wanted = [s1, s2].map(|s: f64| s.powf(2.0_f64.ln() / largest));
            for (is, wanted) in [found.s1, found.s2].into_iter().zip(wanted) {
                assert!((is / wanted - 1.0).abs() < 1e-6, "{found:?} for {wanted}");
            }
        }
    }
}
