//! Positions and triangles, with the areas and normals that follow from them.

use glam::DVec3;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::error::{is_within_reach, too_many};
use crate::mesh::{MeshError, triangle_cross};
use crate::parallel::par_ids;

/// Positions in metres, and triangles that run counter-clockwise seen from outside.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriMesh {
    /// Vertex positions, in m.
    pub positions: IdVec<VertexId, DVec3>,
    /// The three corners of every face, counter-clockwise seen from outside.
    pub triangles: IdVec<FaceId, [VertexId; 3]>,
}

impl TriMesh {
    /// A mesh from plain arrays.
    pub fn from_arrays(positions: Vec<DVec3>, triangles: &[[u32; 3]]) -> Self {
        Self {
            positions: positions.into(),
            triangles: triangles.iter().map(|t| t.map(VertexId::from)).collect(),
        }
    }

    /// Checks that corners exist and differ, that positions are finite, and that all can be
    /// counted.
    ///
    /// # Errors
    /// The first face or vertex that breaks a rule. [`crate::mesh::Adjacency`] checks that the mesh is
    /// manifold.
    pub fn validate(&self) -> Result<(), MeshError> {
        let vertices = self.positions.len();
        if let Some(error) = too_many(vertices, self.triangles.len()) {
            return Err(error);
        }
        for (vertex, p) in self.positions.enumerate() {
            if !is_within_reach(*p) {
                return Err(MeshError::NotFinite { vertex, position: p.to_array() });
            }
        }
        for (face, &[a, b, c]) in self.triangles.enumerate() {
            for vertex in [a, b, c] {
                if vertex.index() >= self.positions.len() {
                    return Err(MeshError::CornerOutOfRange { face, vertex, vertices });
                }
            }
            if let Some(vertex) = [(a, b), (b, c), (c, a)].into_iter().find(|(p, q)| p == q) {
                return Err(MeshError::RepeatedCorner { face, vertex: vertex.0 });
            }
        }
        Ok(())
    }

    /// The positions of the three corners of `face`, in m.
    #[inline]
    pub fn corners(&self, face: FaceId) -> [DVec3; 3] {
        self.triangles[face].map(|v| self.positions[v])
    }

    /// Vector normal to `face` whose length is twice its area, in m^2.
    #[inline]
    pub fn face_cross(&self, face: FaceId) -> DVec3 {
        triangle_cross(self.corners(face))
    }

    /// Area of `face`, in m^2.
    #[inline]
    #[doc(hidden)]
    pub fn face_area(&self, face: FaceId) -> f64 {
        0.5 * self.face_cross(face).length()
    }

    /// Area of all faces, in m^2.
    pub fn area(&self) -> f64 {
        self.triangles.ids().map(|f| self.face_area(f)).sum()
    }

    /// Volume inside a closed surface, in m^3; negative if it is inside out.
    pub(crate) fn enclosed_volume(&self) -> f64 {
        let origin = self.positions.iter().next().copied().unwrap_or_default();
        let volume = |face| {
            let [a, b, c] = self.corners(face).map(|p| p - origin);
            a.dot(b.cross(c)) / 6.0
        };
        self.triangles.ids().map(volume).sum()
    }

    /// [`Self::face_cross`] of every face.
    pub(crate) fn face_crosses(&self) -> IdVec<FaceId, DVec3> {
        par_ids(self.triangles.len(), |face| self.face_cross(face))
    }

    /// A third of the area of the faces around each vertex, in m^2: together the area of the mesh. A vertex of
    /// degenerate faces gets a tiny positive area instead of 0.
    #[doc(hidden)]
    pub fn vertex_areas(&self) -> IdVec<VertexId, f64> {
        let mut areas = IdVec::filled(0.0, self.positions.len());
        for (corners, cross) in self.triangles.iter().zip(self.face_crosses()) {
            let third = 0.5 * cross.length() / 3.0;
            for &v in corners {
                areas[v] += third;
            }
        }
        let least = areas.iter().sum::<f64>() / self.positions.len() as f64 * f64::EPSILON;
        areas.iter_mut().for_each(|area| *area = area.max(least));
        areas
    }

    /// Unit normals, the area-weighted mean of the faces around each vertex; zero where that has no
    /// direction.
    #[doc(hidden)]
    pub fn vertex_normals(&self) -> IdVec<VertexId, DVec3> {
        let mut normals = IdVec::filled(DVec3::ZERO, self.positions.len());
        for (corners, cross) in self.triangles.iter().zip(self.face_crosses()) {
            for &v in corners {
                normals[v] += cross;
            }
        }
        normals.map(|n| n.normalize_or_zero())
    }

    /// The position of a point of the surface, in m.
    #[inline]
    pub fn point(&self, at: &SurfacePoint) -> DVec3 {
        let [a, b, c] = self.corners(at.face);
        a * at.barycentric[0] + b * at.barycentric[1] + c * at.barycentric[2]
    }
}

/// A point of a mesh: a face and barycentric coordinates in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// The face it lies on.
    pub face: FaceId,
    /// Weights of the face's corners, non-negative, sum 1.
    pub barycentric: [f64; 3],
}
