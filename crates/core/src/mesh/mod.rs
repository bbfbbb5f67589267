//! Triangle meshes: positions and corners, adjacency, and small named shapes.
//!
//! A [`TriMesh`] is plain data. An [`Adjacency`] is computed from its triangles once and has all neighbours;
//! it exists only for oriented manifold meshes, so code that has one need not check again.

mod along_curve;
mod closest_point;
mod connectivity;
mod error;
mod fill_holes;
mod geometry;
pub mod shapes;
mod tri_mesh;
mod triangle_map;

pub(crate) use along_curve::AlongCurve;
pub(crate) use closest_point::{Closest, Feature, closest_point, pseudo_normal};
pub use connectivity::adjacency::Adjacency;
pub(crate) use connectivity::adjacency::Rings;
pub(crate) use connectivity::edges::{Edges, neighbours};
pub use connectivity::edges::{VertexCorners, boundary_edges, boundary_loops, edges, loops_of};
pub(crate) use connectivity::halfedge::Halfedge;
pub(crate) use connectivity::halfedge_mesh::{HalfedgeMesh, MAX_RING, diagonals};
pub(crate) use connectivity::topology::{Part, Topology, face_components, joined_corners, separate};
pub use error::FARTHEST;
pub use error::MeshError;
pub(crate) use error::{is_within_reach, too_many};
pub use fill_holes::FillHoles;
pub use fill_holes::triangles_of_least_area;
pub(crate) use fill_holes::{fill_holes, fillings};
#[cfg(feature = "robots")]
pub(crate) use fill_holes::{fill_loops, fill_shorter};
pub(crate) use geometry::{angle, cotangent, loop_length, parts, surface_normals};
pub use geometry::{is_rigid, mean_edge_length};
pub use geometry::{is_rotation, rectangle_around, rotation_defect};
pub use tri_mesh::{SurfacePoint, TriMesh};
pub use triangle_map::{FlatTriangle, SingularValues, triangle_cross};
pub(crate) use triangle_map::{SymmetricDirichlet, signed_area};
