//! Exact measurements in `f64`: nearest points of triangles, rays, sides of a surface,
//! poses.

mod pseudo_normal;
mod ray;
mod rigid_pose;

pub(super) use pseudo_normal::pseudo_normal;
pub(super) use ray::{Meeting, Ray, meet};
pub(super) use rigid_pose::RigidPose;
