//! Links posed by a motion.

use glam::DAffine3;

use crate::{
    contact::{ContactError, ContactIndex},
    skin::{LinkId, Motion, MotionFrame},
};

impl ContactIndex {
    /// Moves the links to where a motion has them at a time (s). Links without poses keep the one
    /// that they have in the map relative to their parent. Nothing is rebuilt.
    ///
    /// # Errors
    /// If a pose is too far away; then links stay as they were.
    pub fn set_motion(&mut self, motion: &Motion, time: f64) -> Result<(), ContactError> {
        let pose = |link: LinkId, parent: Option<DAffine3>, rest: DAffine3| {
            let parent = parent.unwrap_or(DAffine3::IDENTITY);
            match motion.pose(link, time) {
                None => parent * rest,
                Some((MotionFrame::Parent, pose)) => parent * pose,
                Some((MotionFrame::World, pose)) => pose,
            }
        };
        self.set_links(pose)
    }
}
