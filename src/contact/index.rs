//! [`ContactIndex`]: the trees and maps of all patches, the poses of all links, and the answer to one query.

use glam::{DAffine3, DVec3};

use crate::{
    contact::{
        Cell, ContactError, Hit, Query,
        cell::PatchCells,
        geometry::{RigidPose, pseudo_normal},
        search::{Best, LARGEST, PatchBvh, PosedBoxes, Search},
    },
    id::{FaceId, IdVec},
    map::SkinMap,
    mesh::SurfacePoint,
    parallel::par_map,
    pyramid::LevelId,
    skin::{LinkId, PatchId},
};

/// A map made ready for contacts.
///
/// It owns what it needs of the map, and asking changes nothing in it: share it among threads as
/// you like.
#[derive(Debug, Clone)]
pub struct ContactIndex {
    links: IdVec<LinkId, IndexedLink>,
    patches: IdVec<PatchId, IndexedPatch>,
    boxes: PosedBoxes,
}

#[derive(Debug, Clone)]
struct IndexedLink {
    name: String,
    parent: Option<LinkId>,
    pose: RigidPose,
    patches: Vec<PatchId>,
}

#[derive(Debug, Clone)]
struct IndexedPatch {
    link: LinkId,
    tree: PatchBvh,
    cells: PatchCells,
}

impl ContactIndex {
    /// An index of all patches and levels of a map, its links posed as the map says.
    ///
    /// # Errors
    /// If the map is not valid or has no triangle, if a row of a prolongation lies in no face, if a
    /// coordinate is too large, or if the pose of a link is not rigid.
    pub fn new(map: &SkinMap) -> Result<Self, ContactError> {
        map.validate()?;
        let patches = par_map(map.patches.as_slice(), |patch| {
            let tree = PatchBvh::new(&patch.name, &patch.levels[LevelId::new(0)].level.mesh)?;
            Ok(IndexedPatch { link: patch.link, tree, cells: PatchCells::new(patch)? })
        });
        let patches: IdVec<PatchId, _> =
            patches.into_iter().collect::<Result<Vec<_>, ContactError>>()?.into();
        if patches.is_empty() {
            return Err(ContactError::NoSkin);
        }
        let mut links = IdVec::new();
        let mut world = IdVec::<LinkId, DAffine3>::new();
        for link in &map.links {
            let pose = link.parent.map_or(link.pose, |parent| world[parent] * link.pose);
            world.push(pose);
            let (name, parent, pose) = (link.name.clone(), link.parent, rigid(&link.name, &pose)?);
            links.push(IndexedLink { name, parent, pose, patches: Vec::new() });
        }
        for (id, patch) in patches.enumerate() {
            links[patch.link].patches.push(id);
        }
        let mut index = Self { links, patches, boxes: PosedBoxes::default() };
        index.update_posed_boxes();
        Ok(index)
    }

    /// Moves the links: one pose in the world per link of the map, in m. Nothing is rebuilt.
    ///
    /// # Errors
    /// If there is not one pose per link, or one of them is not rigid; then no link has moved.
    pub fn set_poses(&mut self, poses: &IdVec<LinkId, DAffine3>) -> Result<(), ContactError> {
        if poses.len() != self.links.len() {
            return Err(ContactError::PoseCount { found: poses.len(), needed: self.links.len() });
        }
        let poses = self.links.iter().zip(poses).map(|(link, pose)| rigid(&link.name, pose));
        let poses = poses.collect::<Result<Vec<_>, _>>()?;
        for (link, pose) in self.links.iter_mut().zip(poses) {
            link.pose = pose;
        }
        self.update_posed_boxes();
        Ok(())
    }

    /// Moves some links to poses in the world, in m; links that hang from a moved one follow it, as
    /// a hand follows its arm. Of several poses of one link the last counts.
    ///
    /// # Errors
    /// If a link does not exist, or a pose is not rigid; then no link has moved.
    pub fn move_links(&mut self, moved: &[(LinkId, DAffine3)]) -> Result<(), ContactError> {
        let mut given = IdVec::<LinkId, Option<DAffine3>>::filled(None, self.links.len());
        for &(link, pose) in moved {
            if link.index() >= given.len() {
                return Err(ContactError::PoseCount { found: link.index() + 1, needed: self.links.len() });
            }
            given[link] = Some(pose);
        }
        let old = self.poses();
        let mut poses = IdVec::<LinkId, DAffine3>::new();
        for (link, IndexedLink { parent, .. }) in self.links.enumerate() {
            let followed = parent.map_or(old[link], |p| poses[p] * old[p].inverse() * old[link]);
            poses.push(given[link].unwrap_or(followed));
        }
        self.set_poses(&poses)
    }

    /// The poses of the links in the world, in m.
    #[must_use]
    pub fn poses(&self) -> IdVec<LinkId, DAffine3> {
        self.links.map(|link| link.pose.pose())
    }

    fn update_posed_boxes(&mut self) {
        let posed = |patch: PatchId| {
            let patch = &self.patches[patch];
            let pose = &self.links[patch.link].pose;
            patch.tree.posed_box(|corner| pose.to_world(corner))
        };
        self.boxes = PosedBoxes::new(self.patches.len(), posed);
    }

    /// The point of the skin nearest to a query: a point of the world, or [`Query::on_link`].
    ///
    /// # Errors
    /// If the point is not finite, or the link does not exist or carries no patch.
    pub fn locate(&self, query: impl Into<Query>) -> Result<Hit, ContactError> {
        let query = query.into();
        self.check(0, &query)?;
        self.answer(&query, None)
    }

    /// The same as [`Self::locate`], faster where the query is near the one that `last` answers:
    /// along a path, pass each hit to the next search.
    ///
    /// # Errors
    /// As [`Self::locate`].
    pub fn locate_from(&self, last: &Hit, query: impl Into<Query>) -> Result<Hit, ContactError> {
        let query = query.into();
        self.check(0, &query)?;
        self.answer(&query, Some((last.patch, last.point.face)))
    }

    /// Whether a contact can be answered; `number` is its place in its batch.
    pub(super) fn check(&self, number: usize, contact: &Query) -> Result<(), ContactError> {
        let Query { point, link } = *contact;
        // Also false for NaN.
        if !(point.abs().max_element() <= LARGEST && point.is_finite()) {
            return Err(ContactError::NotFinite { contact: number, point: point.to_array() });
        }
        let Some(id) = link else { return Ok(()) };
        let count = self.links.len();
        let link =
            self.links.get(id).ok_or(ContactError::UnknownLink { contact: number, link: id, count })?;
        if link.patches.is_empty() {
            return Err(ContactError::BareLink { contact: number, name: link.name.clone() });
        }
        Ok(())
    }

    /// Where a contact lies in the world, in m. The contact must have been checked.
    pub(super) fn in_world(&self, contact: &Query) -> DVec3 {
        contact.link.map_or(contact.point, |link| self.links[link].pose.to_world(contact.point))
    }

    /// The answer to a query that has been checked; `near` is measured first.
    pub(super) fn answer(&self, query: &Query, near: Option<(PatchId, FaceId)>) -> Result<Hit, ContactError> {
        let mut best = near.and_then(|(patch, face)| self.seed(query, patch, face));
        let reached = |best: &Option<Best>| Best::squared(best.as_ref()).sqrt();
        match query.link {
            None => {
                let distance = reached(&best);
                self.boxes.each_within(query.point, distance, |id| {
                    let patch = &self.patches[id];
                    let q = self.links[patch.link].pose.to_local(query.point);
                    Search::new(&patch.tree, id, q).run(&mut best);
                    reached(&best)
                });
            }
            Some(link) => self.search_link(link, query.point, &mut best),
        }
        best.map(|best| self.hit(query, &best)).ok_or(ContactError::NoSkin)
    }

    /// Searches the patches of one link, the one with the nearest box first.
    fn search_link(&self, link: LinkId, q: DVec3, best: &mut Option<Best>) {
        let patches = &self.links[link].patches;
        let away = |id: &PatchId| self.patches[*id].tree.least_distance(q);
        let first = patches.iter().copied().min_by(|a, b| away(a).total_cmp(&away(b)));
        let rest = patches.iter().copied().filter(|&id| Some(id) != first);
        for id in first.into_iter().chain(rest) {
            if away(&id) <= Best::squared(best.as_ref()).sqrt() {
                Search::new(&self.patches[id].tree, id, q).run(best);
            }
        }
    }

    /// A face measured before the search, if it exists and the contact may lie on it.
    fn seed(&self, contact: &Query, id: PatchId, face: FaceId) -> Option<Best> {
        let patch = self.patches.get(id)?;
        if contact.link.is_some_and(|link| link != patch.link)
            || face.index() >= patch.tree.mesh.triangles.len()
        {
            return None;
        }
        let q = self.in_link(patch.link, contact);
        Some(Best { patch: id, face, closest: patch.tree.measure(q, face) })
    }

    fn in_link(&self, link: LinkId, contact: &Query) -> DVec3 {
        if contact.link == Some(link) { contact.point } else { self.links[link].pose.to_local(contact.point) }
    }

    fn hit(&self, contact: &Query, best: &Best) -> Hit {
        let Best { patch: id, face, closest } = *best;
        let patch = &self.patches[id];
        let PatchBvh { mesh, corners, .. } = &patch.tree;
        let q = self.in_link(patch.link, contact);
        let point = SurfacePoint { face, barycentric: closest.barycentric };
        let here = mesh.point(&point);
        let outward = pseudo_normal(corners, mesh, face, closest.feature);
        let length = closest.squared.sqrt();
        let distance = if (q - here).dot(outward) < 0.0 { -length } else { length };
        let position = if contact.link.is_some() { here } else { self.links[patch.link].pose.to_world(here) };
        Hit { patch: id, point, distance, position }
    }

    /// Where a hit lies on the map of `level`; `None` if its patch does not reach up to that level,
    /// or the hit is not one of this index.
    #[must_use]
    pub fn cell(&self, hit: &Hit, level: LevelId) -> Option<Cell> {
        let patch = self.patches.get(hit.patch)?;
        let mesh = &patch.tree.mesh;
        let corners = *mesh.triangles.get(hit.point.face)?;
        let here = mesh.point(&hit.point);
        let mut nearest = corners[0];
        for v in corners {
            let key = |v| (mesh.positions[v].distance_squared(here), v);
            let ((old, first), (new, other)) = (key(nearest), key(v));
            if new < old || (new == old && other < first) {
                nearest = v;
            }
        }
        patch.cells.cell(level, &hit.point, corners, nearest)
    }

    /// Where a hit lies on the maps of all levels of its patch, finest first.
    pub fn cells(&self, hit: &Hit) -> impl Iterator<Item = Cell> + '_ {
        let hit = *hit;
        let levels = self.patches.get(hit.patch).map_or(0, |patch| patch.cells.len());
        (0..levels).filter_map(move |level| self.cell(&hit, LevelId::new(level)))
    }
}

fn rigid(name: &str, pose: &DAffine3) -> Result<RigidPose, ContactError> {
    let near = pose.translation.abs().max_element() <= LARGEST;
    let rigid = RigidPose::new(pose).filter(|_| near);
    rigid.ok_or_else(|| ContactError::NotRigid { name: name.to_owned() })
}
