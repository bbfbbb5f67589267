//! Links: the frames of a robot that patches are fixed to.

use glam::DAffine3;

use crate::id::{IdVec, define_id};

define_id!(
    /// A link of one robot.
    LinkId, "link"
);

/// A link of the robot: a frame that patches are fixed to.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Name, as the robot's model gives it; may be empty.
    pub name: String,
    /// The link it hangs from; always an earlier link.
    pub parent: Option<LinkId>,
    /// Its frame in that of its parent (or of the world), in m.
    pub pose: DAffine3,
}

/// The frame of `link` in the world.
#[must_use]
pub fn world_pose(links: &IdVec<LinkId, Link>, link: LinkId) -> DAffine3 {
    let mut pose = links[link].pose;
    let mut at = links[link].parent;
    while let Some(parent) = at {
        pose = links[parent].pose * pose;
        at = links[parent].parent;
    }
    pose
}

/// The links that do not come after their parent, as every link must.
pub(super) fn before_parents(links: &IdVec<LinkId, Link>) -> impl Iterator<Item = LinkId> {
    links.enumerate().filter(|(id, link)| link.parent.is_some_and(|parent| parent >= *id)).map(|(id, _)| id)
}
