//! Links posed by a motion, and patches that follow several links.

use glam::DAffine3;

use crate::{
    contact::{ContactError, ContactIndex, blend::Blend},
    id::{IdVec, VertexId},
    pyramid::LevelId,
    skin::{Joints, LinkId, Motion, MotionFrame, PatchId, scaled_joints},
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

    /// Lets the vertices of a patch follow up to four links each from now on (linear blend skinning), as
    /// those of a map with [joints](crate::skin::Taxels::joints) do from the start:
    /// a vertex moves to the mean of where its links take it, by their weights. Moving links fits the
    /// patch's tree to its vertices; that costs some 60 ns a vertex. Coarse levels of such a patch are
    /// not searched alone: level 0 gives their [reactive](Self::reactive) answers.
    ///
    /// The links must be where the map has them, and so are the vertices. Weights are scaled to sum 1.
    ///
    /// # Errors
    /// If there is no such patch, not one row per vertex of its level 0, a link does not exist, or the
    /// weights of a vertex are negative, not finite or do not sum to 1 within 0.02.
    pub fn blend(&mut self, id: PatchId, joints: &IdVec<VertexId, Joints>) -> Result<(), ContactError> {
        let Some(patch) = self.patches.get(id) else {
            return Err(ContactError::NoMap { patch: id, level: LevelId::new(0) });
        };
        let rest = patch.tree.mesh.positions.clone();
        let (found, needed) = (joints.len(), rest.len());
        if found != needed {
            return Err(ContactError::JointCount { patch: id, found, needed });
        }
        let links = self.links.len();
        let mut scaled = joints.clone();
        for (vertex, row) in joints.enumerate() {
            let is_known = |row: &Joints| row.iter().all(|joint| joint.0.index() < links);
            scaled[vertex] = scaled_joints(row).filter(is_known).ok_or(ContactError::Joints {
                patch: id,
                vertex,
                joints: *row,
                links,
            })?;
        }
        let own = self.links[patch.link].pose.pose();
        let to_joint = self.links.map(|link| link.pose.pose().inverse() * own);
        let blend = Blend::new(rest, &scaled, to_joint, patch.tree.refitting());
        let patch = &mut self.patches[id];
        patch.blend = Some(Box::new(blend));
        patch.coarse.clear();
        Ok(())
    }
}
