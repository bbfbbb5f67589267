//! Patches whose vertices follow several links: a linear blend of the motions of the links, to which
//! the tree of the patch is fitted whenever links move.

use glam::{DAffine3, DVec3};

use crate::{
    bvh::Refitting,
    contact::patch_bvh::LARGEST,
    id::{IdVec, VertexId},
    skin::{Joints, LinkId},
};

/// How the vertices of a patch follow links.
#[derive(Debug, Clone)]
pub(super) struct Blend {
    /// The vertices as they are in the map, in m in the frame of the patch's link.
    rest: IdVec<VertexId, DVec3>,
    /// The links that each vertex follows and their weights, none of them 0, one vertex after the
    /// other: fewer bytes to read than [`Joints`].
    joints: Vec<(LinkId, f64)>,
    /// How many links each vertex follows.
    counts: Vec<u8>,
    /// From the frame of the patch's link to that of each link, both as they are in the map.
    to_joint: IdVec<LinkId, DAffine3>,
    /// Where each link takes what it carries, in the frame of the patch's link.
    carried: IdVec<LinkId, DAffine3>,
    /// The vertices where the links take them, in the same frame, until the tree is fitted to them.
    pub(super) positions: IdVec<VertexId, DVec3>,
    /// The normals of the taxels as they are in the map, in the same frame; none if the index has no
    /// fields.
    rest_normals: IdVec<VertexId, DVec3>,
    /// The same where the links turn them.
    pub(super) normals: IdVec<VertexId, DVec3>,
    pub(super) refitting: Refitting,
}

impl Blend {
    /// A blend of vertices at `rest` and of normals, if there are any, by joints whose weights have the sum 1.
    #[expect(clippy::cast_possible_truncation, reason = "at most four")]
    pub(super) fn new(
        rest: IdVec<VertexId, DVec3>,
        rest_normals: IdVec<VertexId, DVec3>,
        joints: &IdVec<VertexId, Joints>,
        to_joint: IdVec<LinkId, DAffine3>,
        refitting: Refitting,
    ) -> Self {
        let weighty = |row: &Joints| row.iter().copied().filter(|joint| joint.1 > 0.0).collect::<Vec<_>>();
        Self {
            counts: joints.iter().map(|row| weighty(row).len() as u8).collect(),
            joints: joints.iter().flat_map(weighty).collect(),
            carried: to_joint.map(|_| DAffine3::IDENTITY),
            positions: rest.clone(),
            rest,
            normals: rest_normals.clone(),
            rest_normals,
            to_joint,
            refitting,
        }
    }

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
        let Self { joints, counts, carried, .. } = self;
        let rows = counts.iter().scan(joints.as_slice(), |left, &count| {
            let (row, others) = left.split_at(usize::from(count));
            *left = others;
            Some(row)
        });
        let moved = self.positions.iter_mut().enumerate().zip(&self.rest);
        for (((vertex, position), rest), row) in moved.zip(rows.clone()) {
            let part = |&(joint, weight): &(LinkId, f64)| weight * carried[joint].transform_point3(*rest);
            *position = row.iter().map(part).sum();
            // Not true for NaN either.
            if !position.abs().cmple(DVec3::splat(LARGEST)).all() {
                return Err((VertexId::new(vertex), *position));
            }
        }
        for ((normal, rest), row) in self.normals.iter_mut().zip(&self.rest_normals).zip(rows) {
            let part = |&(joint, weight): &(LinkId, f64)| weight * carried[joint].transform_vector3(*rest);
            *normal = row.iter().map(part).sum::<DVec3>().normalize_or(*rest);
        }
        Ok(())
    }
}
