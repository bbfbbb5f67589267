//! The search for the nearest face: over the patches' boxes, then down the tree of each patch that
//! may hold it.

mod bvh8;
mod lanes;
mod nearest;
mod patch_bvh;
mod posed_boxes;
mod rounding;
mod triangle8;

pub(super) use nearest::{Best, Search};
pub(super) use patch_bvh::PatchBvh;
pub(super) use posed_boxes::PosedBoxes;
pub(super) use rounding::LARGEST;
