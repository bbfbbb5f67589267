//! [`Links`]: the poses of the links, and points and directions from the frame of one to that of another.

use glam::{DAffine3, DQuat, DVec3};

use crate::contact::{ContactError, Query};
use crate::id::IdVec;
use crate::map::SkinMap;
use crate::mesh::{is_rigid, is_within_reach};
use crate::skin::{LinkId, Motion, MotionFrame, PatchId};

/// A pose that rotates and translates by at most 1e12 m; its axes are made exactly orthonormal, so
/// distances in the frame are those of the world.
///
/// # Errors
/// If the pose of the link is not rigid or too far.
fn rigid(name: &str, pose: &DAffine3) -> Result<DAffine3, ContactError> {
    if !is_rigid(pose) || !is_within_reach(pose.translation) {
        return Err(ContactError::NotRigid { name: name.to_owned() });
    }
    let rotation = DQuat::from_mat3(&pose.matrix3).normalize();
    Ok(DAffine3::from_rotation_translation(rotation, pose.translation))
}

/// The links of a map in the current pose of the robot.
#[derive(Debug, Clone)]
pub(super) struct Links(IdVec<LinkId, Posed>);

#[derive(Debug, Clone)]
struct Posed {
    name: String,
    parent: Option<LinkId>,
    /// Its pose in the map, relative to its parent.
    rest: DAffine3,
    /// Its pose in the world, and the inverse.
    pose: DAffine3,
    inverse: DAffine3,
    /// Its next pose.
    next: DAffine3,
    patches: Vec<PatchId>,
}

impl Links {
    /// The links of a valid map, in the pose of the map.
    ///
    /// # Errors
    /// If a pose is not rigid or too far.
    pub(super) fn new(map: &SkinMap) -> Result<Self, ContactError> {
        let mut links = IdVec::<LinkId, Posed>::default();
        let mut world = IdVec::<LinkId, DAffine3>::default();
        for link in &map.links {
            let pose = link.parent.map_or(link.pose, |parent| world[parent] * link.pose);
            world.push(pose);
            let (name, parent, pose) = (link.name.clone(), link.parent, rigid(&link.name, &pose)?);
            let (rest, inverse) = (link.pose, pose.inverse());
            links.push(Posed { name, parent, rest, pose, inverse, next: pose, patches: Vec::new() });
        }
        for (id, patch) in map.patches.enumerate() {
            links[patch.link].patches.push(id);
        }
        Ok(Self(links))
    }

    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    /// Computes the next poses of the links from a motion at a time (s); links without poses keep the one
    /// that they have in the map relative to their parent.
    ///
    /// # Errors
    /// If a pose is too far.
    pub(super) fn aim(&mut self, motion: &Motion, time: f64) -> Result<(), ContactError> {
        for id in self.0.ids() {
            let Posed { name, parent, rest, .. } = &self.0[id];
            let parent = parent.map_or(DAffine3::IDENTITY, |parent| self.next(parent));
            let pose = match motion.pose(id, time) {
                None => parent * *rest,
                Some((MotionFrame::Parent, pose)) => parent * pose,
                Some((MotionFrame::World, pose)) => pose,
            };
            self.0[id].next = rigid(name, &pose)?;
        }
        Ok(())
    }

    /// Moves the links to the poses of [`Self::aim`].
    pub(super) fn commit(&mut self) {
        self.0.iter_mut().for_each(|link| (link.pose, link.inverse) = (link.next, link.next.inverse()));
    }

    /// The next pose of a link.
    pub(super) fn next(&self, link: LinkId) -> DAffine3 {
        self.0[link].next
    }

    /// The pose of a link in the world.
    #[inline]
    pub(super) fn pose(&self, link: LinkId) -> &DAffine3 {
        &self.0[link].pose
    }

    /// From the world to the frame of a link.
    #[inline]
    pub(super) fn inverse(&self, link: LinkId) -> &DAffine3 {
        &self.0[link].inverse
    }

    pub(super) fn poses(&self) -> IdVec<LinkId, DAffine3> {
        self.0.map(|link| link.pose)
    }

    /// The patches of a link.
    #[inline]
    pub(super) fn patches(&self, link: LinkId) -> &[PatchId] {
        &self.0[link].patches
    }

    /// Refuses a query that cannot be answered; `number` is its index in the batch, for the error.
    ///
    /// # Errors
    /// If the point is not finite or farther than 1e12 m, or a link does not exist, or the only link that is
    /// searched carries no patch.
    #[inline]
    pub(super) fn check(&self, number: usize, query: &Query) -> Result<(), ContactError> {
        let Query { point, link, only_link } = *query;
        if !is_within_reach(point) {
            return Err(ContactError::NotFinite { contact: number, point: point.to_array() });
        }
        let count = self.len();
        let known =
            |link: LinkId| self.0.get(link).ok_or(ContactError::UnknownLink { contact: number, link, count });
        link.map(known).transpose()?;
        match only_link.map(known).transpose()? {
            Some(only) if only.patches.is_empty() => {
                Err(ContactError::BareLink { contact: number, name: only.name.clone() })
            }
            _ => Ok(()),
        }
    }

    /// The point of a query in the world, in m.
    #[inline]
    pub(super) fn in_world(&self, query: &Query) -> DVec3 {
        query.link.map_or(query.point, |link| self.pose(link).transform_point3(query.point))
    }

    /// The point of a query, in the world at `world`, in the frame of a link, in m.
    #[inline]
    pub(super) fn in_link(&self, link: LinkId, query: &Query, world: DVec3) -> DVec3 {
        if query.link == Some(link) { query.point } else { self.inverse(link).transform_point3(world) }
    }

    /// Transforms a point (m) and a direction from the frame of a link to the frame of a query.
    #[inline]
    pub(super) fn answered(
        &self,
        link: LinkId,
        query: &Query,
        point: DVec3,
        normal: DVec3,
    ) -> (DVec3, DVec3) {
        if query.link == Some(link) {
            return (point, normal);
        }
        let pose = self.pose(link);
        let (point, normal) = (pose.transform_point3(point), pose.transform_vector3(normal));
        match query.link.map(|frame| self.inverse(frame)) {
            Some(back) => (back.transform_point3(point), back.transform_vector3(normal)),
            None => (point, normal),
        }
    }
}
