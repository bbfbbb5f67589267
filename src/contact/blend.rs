//! Patches whose vertices follow several links: a linear blend of the motions of the links, to which
//! the tree of the patch is fitted whenever links move.

use glam::{DAffine3, DVec3};

use crate::{
    contact::search::{LARGEST, Refitting},
    id::{IdVec, VertexId},
    skin::{Joints, LinkId},
};

/// How the vertices of a patch follow links.
#[derive(Debug, Clone)]
pub(super) struct Blend {
    /// The vertices as they are in the map, in m in the frame of the patch's link.
    pub(super) rest: IdVec<VertexId, DVec3>,
    pub(super) joints: IdVec<VertexId, Joints>,
    /// From the frame of the patch's link to that of each link, both as they are in the map.
    pub(super) to_joint: IdVec<LinkId, DAffine3>,
    /// Where each link takes what it carries, in the frame of the patch's link.
    pub(super) carried: IdVec<LinkId, DAffine3>,
    /// The vertices where the links take them, in the same frame, until the tree is fitted to them.
    pub(super) positions: IdVec<VertexId, DVec3>,
    pub(super) refitting: Refitting,
}

impl Blend {
    /// Moves the vertices to where the links move next, by their poses in the world; `own` is the link
    /// of the patch.
    ///
    /// # Errors
    /// The first vertex that is too far away.
    pub(super) fn follow(
        &mut self,
        own: LinkId,
        next: impl Fn(LinkId) -> DAffine3,
    ) -> Result<(), (VertexId, DVec3)> {
        let from_world = next(own).inverse();
        for (link, to_joint) in self.to_joint.enumerate() {
            // Rounding must not move what the patch's own link carries.
            self.carried[link] =
                if link == own { DAffine3::IDENTITY } else { from_world * next(link) * *to_joint };
        }
        for ((vertex, position), (rest, joints)) in
            self.positions.iter_mut().enumerate().zip(self.rest.iter().zip(&self.joints))
        {
            let part =
                |&(joint, weight): &(LinkId, f64)| weight * self.carried[joint].transform_point3(*rest);
            *position = joints.iter().filter(|joint| joint.1 > 0.0).map(part).sum();
            if !position.is_finite() || position.abs().max_element() > LARGEST {
                return Err((VertexId::new(vertex), *position));
            }
        }
        Ok(())
    }
}
