//! The taxels before there are triangles: each place once, who is near whom, and how far apart.

pub(super) mod coincident;
pub(super) mod kd_tree;
pub(super) mod neighbours;
pub(super) mod point_cloud;
pub(super) mod unique_points;
