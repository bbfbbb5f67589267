//! Exact measurements in `f64`: nearest points of triangles, rays, volumes, sides of a surface,
//! poses.

mod pseudo_normal;
mod ray;
mod rigid_pose;
mod segment;
mod volume;

pub(super) use pseudo_normal::pseudo_normal;
pub(super) use ray::{Meeting, Ray, meet, unit};
pub(super) use rigid_pose::RigidPose;
pub(super) use volume::Volume;
