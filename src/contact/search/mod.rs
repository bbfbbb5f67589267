//! The search for the nearest face: over the patches' boxes, then down the tree of each patch that
//! may hold it.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod descent;
mod first_hit;
mod fit;
mod frame;
mod lanes;
mod nearest;
mod node8;
mod patch_bvh;
mod point8;
mod points;
mod rounding;
mod tree;
mod triangle8;
mod walk;
mod within;

pub(super) use nearest::{Best, Search, Start};
pub(super) use patch_bvh::{PatchBvh, Refitting, check};
pub(super) use points::PointTree;
pub(super) use rounding::LARGEST;
