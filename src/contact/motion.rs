//! Links posed by a motion, and patches that follow several links.

use glam::DAffine3;

use crate::{
    contact::{ContactError, ContactIndex, blend::Blend},
    id::{IdVec, VertexId},
    skin::{Joints, Motion, MotionFrame, PatchId, scaled_joints},
};

impl ContactIndex {
    /// Moves the links to where a motion has them at a time (s). Links without poses keep the one
    /// that they have in the map relative to their parent. Nothing is rebuilt.
    ///
    /// # Errors
    /// If a pose is too far away; then links stay as they were.
    pub fn set_motion(&mut self, motion: &Motion, time: f64) -> Result<(), ContactError> {
        self.set_links(|id, link, parent| {
            let parent = parent.map_or(DAffine3::IDENTITY, |parent| parent.next.pose());
            match motion.pose(id, time) {
                None => parent * link.rest,
                Some((MotionFrame::Parent, pose)) => parent * pose,
                Some((MotionFrame::World, pose)) => pose,
            }
        })
    }

    /// Lets the vertices of a patch of a valid map follow its [joints](crate::skin::Taxels::joints) from
    /// now on (linear blend skinning): a vertex moves to the mean of where its links take it, by their
    /// weights, which are scaled to sum 1. Moving links fits the patch's tree to its vertices; that costs
    /// some 60 to 80 ns a vertex. Coarse levels of such a patch are not searched alone: level 0 gives their
    /// [reactive](Self::reactive) answers.
    ///
    /// # Errors
    /// If a link does not exist.
    pub(super) fn blend(
        &mut self,
        id: PatchId,
        joints: &IdVec<VertexId, Joints>,
    ) -> Result<(), ContactError> {
        let patch = &self.patches[id];
        let rest = patch.tree.mesh.positions.clone();
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
        let normals = patch.normals.clone();
        let blend = Blend::new((rest, normals), &scaled, to_joint, patch.tree.refitting());
        self.patches[id].blend = Some(Box::new(blend));
        Ok(())
    }
}
