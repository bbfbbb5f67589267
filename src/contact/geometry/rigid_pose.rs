//! The pose of a link, and its inverse.

use glam::{DAffine3, DQuat, DVec3};

use crate::mesh::rotation_defect;

/// How far the axes of a pose may be from unit length and right angles: glTF stores poses in `f32`,
/// and a chain of links multiplies a few of them.
const RIGID_TOLERANCE: f64 = 1e-5;

/// A rigid frame with the way there and back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::contact) struct RigidPose {
    to_world: DAffine3,
    from_world: DAffine3,
}

impl RigidPose {
    /// The frame of a pose that rotates and translates; its axes are made exactly orthonormal, so
    /// distances in the frame are those of the world. `None` if the pose does anything else.
    pub(in crate::contact) fn new(pose: &DAffine3) -> Option<Self> {
        if !pose.is_finite() {
            return None;
        }
        let axes = pose.matrix3;
        if rotation_defect(&axes) > RIGID_TOLERANCE || axes.determinant() < 0.0 {
            return None;
        }
        let rotation = DQuat::from_mat3(&axes).normalize();
        let to_world = DAffine3::from_rotation_translation(rotation, pose.translation);
        Some(Self { to_world, from_world: to_world.inverse() })
    }

    /// The pose that was given, made exactly rigid.
    pub(in crate::contact) fn pose(&self) -> DAffine3 {
        self.to_world
    }

    pub(in crate::contact) fn to_world(self, point: DVec3) -> DVec3 {
        self.to_world.transform_point3(point)
    }

    pub(in crate::contact) fn to_local(self, point: DVec3) -> DVec3 {
        self.from_world.transform_point3(point)
    }
}
