//! Who borders whom: one pairing of halfedges behind meshes that rest, meshes that change, and
//! lists of corners.

pub(super) mod adjacency;
pub(super) mod boundary;
pub(super) mod edges;
pub(super) mod halfedge;
pub(super) mod halfedge_mesh;
pub(super) mod rings;
pub(super) mod vertex_corners;
