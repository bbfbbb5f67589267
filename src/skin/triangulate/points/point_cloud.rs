//! The taxels of a sheet before there are triangles: points, normals, neighbours.

use glam::DVec3;

use crate::{
    id::{IdVec, VertexId},
    skin::triangulate::points::neighbours::Neighbours,
};

/// What is known about the taxels before there are triangles.
#[derive(Debug, Clone, Copy)]
pub(in crate::skin::triangulate) struct PointCloud<'a> {
    pub positions: &'a IdVec<VertexId, DVec3>,
    /// Unit normals; those of neighbours point to the same side.
    pub normals: &'a IdVec<VertexId, DVec3>,
    pub neighbours: &'a Neighbours,
    /// Longest edge allowed, over the spacing.
    pub gap: f64,
}

impl PointCloud<'_> {
    pub(in crate::skin::triangulate) fn is_within_gap(&self, v: VertexId, w: VertexId) -> bool {
        let spacing = 0.5 * (self.neighbours.spacing[v] + self.neighbours.spacing[w]);
        self.positions[v].distance(self.positions[w]) <= self.gap * spacing
    }

    /// Unit normal of a triangle; zero if it has no area.
    pub(in crate::skin::triangulate) fn normal(&self, t: [VertexId; 3]) -> DVec3 {
        let [a, b, c] = t.map(|v| self.positions[v]);
        (b - a).cross(c - a).normalize_or_zero()
    }

    pub(in crate::skin::triangulate) fn circumradius(&self, t: [VertexId; 3]) -> f64 {
        let [a, b, c] = t.map(|v| self.positions[v]);
        let (x, y, z) = (b - a, c - b, a - c);
        x.length() * y.length() * z.length() / (2.0 * x.cross(y).length())
    }
}
