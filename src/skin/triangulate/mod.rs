//! Triangulating: taxels without triangles become a mesh.
//!
//! The method is the tangential Delaunay complex (boissonnat2014): every taxel triangulates its
//! neighbours in its tangent plane, and the triangles on which corners agree form the mesh. The
//! files in the order of the algorithm:
//!
//! 1. `points/unique_points`, with `coincident` and `kd_tree`: each position once, in an order of its
//!    own;
//! 2. `points/neighbours`: the local spacing and who may be joined;
//! 3. `normals`, then `orient_normals`: tangent planes, turned to one side (hoppe1992),
//!    (konig2009);
//! 4. `candidates`, with `delaunay_star`, for each point of the
//!    `points/point_cloud`: triangles by the votes
//!    of their corners;
//! 5. `growing_mesh`: takes candidates that keep an oriented manifold, the best first;
//! 6. `repair`: small holes, touching fans, isolated taxels;
//! 7. `orient_outward`: which side is outside;
//! 8. `triangulate_taxels`: these steps, sheet by sheet, with their remarks.
//!
//! Not guaranteed: that the mesh is the surface between the taxels. Where parts lie closer than the
//! spacing and no normals tell them apart, they are joined.

mod candidates;
mod delaunay_star;
mod growing_mesh;
mod normals;
mod orient_normals;
mod orient_outward;
mod points;
mod repair;
mod triangulate_taxels;

pub(super) use points::unique_points::UniquePoints;
pub(super) use triangulate_taxels::triangulate_taxels;
