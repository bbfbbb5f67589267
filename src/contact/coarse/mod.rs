//! Coarse levels that are searched alone.
//!
//! `distance` measures how far a triangle is from a mesh; `level` keeps a level with its own tree,
//! and how far each of its faces and the skin are apart.

mod distance;
mod level;

pub(super) use level::{CoarseLevel, coarse_levels, mean_side};
