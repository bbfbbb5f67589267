//! Exact measurements in `f64`: sides of a surface, poses.

mod pseudo_normal;
mod rigid_pose;

pub(super) use pseudo_normal::pseudo_normal;
pub(super) use rigid_pose::RigidPose;
