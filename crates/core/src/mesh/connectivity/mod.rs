//! Connectivity: one pairing of halfedges, from which meshes that do not change, meshes that do, and lists of
//! corners follow.
//!
//! | have a mesh | need | take |
//! |---|---|---|
//! | any | one side of one face, in four bytes | `Halfedge` |
//! | any | all faces along each edge | `Edges`, or `each_edge` to visit them once |
//! | any | all faces around a vertex | `VertexCorners` |
//! | any | edges, boundary edges, boundary loops | `edges`, `boundary_edges`, `boundary_loops` |
//! | any | its components, by faces; each of them as a mesh | `face_components`; `separate` |
//! | manifold, any winding | Euler characteristic and loops of each component | `Topology::of_components` |
//! | oriented manifold | faces across sides, one-rings, topology | [`Adjacency`](crate::mesh::Adjacency) |
//! | oriented manifold | the corners that are one vertex, where some edges are cut | `joined_corners` |
//! | oriented manifold | one-rings alone, in sweeps | `Rings` |
//! | oriented manifold that changes | the same, while vertices are removed | `HalfedgeMesh` |

pub(super) mod adjacency;
pub(super) mod edges;
pub(super) mod halfedge;
pub(super) mod halfedge_mesh;
pub(super) mod topology;
