//! Spatial search: trees over boxes in space or in the plane.
//!
//! | have | need | take |
//! |---|---|---|
//! | boxes | pairs that touch, those near a point or on a ray | [`BoxTree`] |
//! | points | the nearest few, all in a sphere | [`PointTree`] |
//! | triangles | the nearest one, all in a sphere, the first on a ray | [`TriangleTree`] |
//!
//! Coordinates are `f64` of any origin, and of any size as long as the squares of distances stay finite (up
//! to about 1e154). Inside, boxes are `f32`, rounded outwards: they only select candidates. Results are
//! decided in `f64`, so answers are exact, and the same on every processor.
//!
//! Files in reading order: `geometry` (boxes and rays), `scaling` (to `f32`, and bounds of rounding);
//! `box_tree`, whose topology is obvhs'; `tree`, `node8`, `packets` (eight oriented boxes a node over packets of
//! eight), `lanes` and `avx2` (eight numbers at a time), `descent` (the walk); `point_tree`, `triangle_tree`
//! (the searches).
//!
//! Boxes are not thin along any direction, so obvhs' surface-area heuristic suits them. Points and triangles
//! of a skin are: their tree is halved by count, with boxes along the mean normal, which is 1.2 to 1.8 times
//! as fast for the nearest triangle as a tree of obvhs' topology with the same nodes.
//!
//! This is the only crate that uses obvhs, pulp and wide.
#![warn(missing_docs, clippy::print_stdout, clippy::unwrap_used)]

#[cfg(target_arch = "x86_64")]
mod avx2;
mod box_tree;
mod descent;
mod geometry;
mod lanes;
mod node8;
mod packets;
mod point_tree;
mod scaling;
#[cfg(test)]
mod soup;
mod tree;
mod triangle_tree;

pub use box_tree::BoxTree;
pub use geometry::{Aabb, Meeting, Ray, meet};
pub use point_tree::{Id, PointTree};
pub use triangle_tree::{Nearest, RayHit, Refitting, Start, TriangleTree};

/// Why there is no tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum BvhError {
    #[error("box {index} is not finite or has a negative side")]
    NotABox { index: usize },
    #[error("vertex {vertex} is too far from the origin, or not finite")]
    TooFar { vertex: usize },
    /// More elements than a tree can number, or none where there must be one.
    #[error("a tree over {count} elements is not possible; at most {most} are")]
    TooMany { count: usize, most: usize },
}
