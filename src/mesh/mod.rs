//! Triangle meshes: positions and corners, who borders whom, and small named shapes.
//!
//! A [`TriMesh`] is plain data. An [`Adjacency`] is computed from its triangles once and answers
//! every question about neighbours; it exists only for oriented manifold meshes, so code that
//! holds one need not ask again.

mod connectivity;
mod error;
mod fill_holes;
mod geometry;
mod rigid;
pub mod shapes;
mod surface_point;
mod tri_mesh;
mod triangle_map;

pub use connectivity::{adjacency::Adjacency, halfedge::Halfedge};
pub(crate) use connectivity::{
    boundary::{boundary_edges, boundary_loops, edges},
    edges::Edges,
    halfedge_mesh::{HalfedgeMesh, MAX_RING, diagonals},
    rings::Rings,
    vertex_corners::VertexCorners,
};
pub use error::MeshError;
pub use fill_holes::fill_holes;
pub(crate) use geometry::cotangent;
pub use geometry::{angle, mean_edge_length};
pub(crate) use rigid::{is_rigid, is_rotation, rotation_defect};
pub use surface_point::SurfacePoint;
pub use tri_mesh::TriMesh;
pub(crate) use tri_mesh::smallest_first;
pub(crate) use triangle_map::{FlatTriangle, SingularValues};
