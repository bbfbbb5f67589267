//! The search for the nearest face: over the patches' boxes, then down the tree of each patch that
//! may hold it.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod boxes;
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
mod posed_boxes;
mod rounding;
mod tree;
mod triangle8;
mod walk;
mod within;

pub(super) use boxes::Aabb;
pub(super) use nearest::{Best, Search, Start};
pub(super) use patch_bvh::{Packing, PatchBvh, Refitting};
pub(super) use points::PointTree;
pub(super) use posed_boxes::PosedBoxes;
pub(super) use rounding::LARGEST;
