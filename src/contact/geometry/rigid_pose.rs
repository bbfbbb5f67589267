//! The pose of a link, and its inverse.

use glam::{DAffine3, DQuat, DVec3};

use crate::mesh::is_rigid;

/// A rigid frame with the way there and back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RigidPose {
    to_world: DAffine3,
    from_world: DAffine3,
}

impl RigidPose {
    /// The frame of a pose that rotates and translates; its axes are made exactly orthonormal, so
    /// distances in the frame are those of the world. `None` if the pose does anything else.
    pub(crate) fn new(pose: &DAffine3) -> Option<Self> {
        if !is_rigid(pose) {
            return None;
        }
        let rotation = DQuat::from_mat3(&pose.matrix3).normalize();
        let to_world = DAffine3::from_rotation_translation(rotation, pose.translation);
        Some(Self { to_world, from_world: to_world.inverse() })
    }

    /// The pose that was given, made exactly rigid.
    pub(crate) fn pose(&self) -> DAffine3 {
        self.to_world
    }

    #[inline]
    pub(crate) fn to_world(self, point: DVec3) -> DVec3 {
        self.to_world.transform_point3(point)
    }

    /// A direction of the frame, in the world.
    #[inline]
    pub(crate) fn turned(self, direction: DVec3) -> DVec3 {
        self.to_world.transform_vector3(direction)
    }

    /// A direction of the world, in the frame.
    #[inline]
    pub(crate) fn turned_back(self, direction: DVec3) -> DVec3 {
        self.from_world.transform_vector3(direction)
    }

    #[inline]
    pub(crate) fn to_local(self, point: DVec3) -> DVec3 {
        self.from_world.transform_point3(point)
    }
}
