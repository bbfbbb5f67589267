//! [`ContactIndex`]: the trees and maps of all patches, the poses of all links, and the answer to one query.

use glam::{DAffine3, DVec3};

use crate::{
    bvh::{Aabb, BoxTree},
    contact::{
        ContactError, Hit, Query,
        geometry::{RigidPose, pseudo_normal},
        patch::IndexedPatch,
        search::{Best, LARGEST, PatchBvh, Search, Start},
    },
    id::{IdVec, VertexId},
    map::SkinMap,
    mesh::{SurfacePoint, TriMesh},
    parallel::par_map,
    skin::{LinkId, PatchId, Presence},
};

/// Up to this many [spacings](ContactIndex::spacing) of its taxels a point is on the skin, unless a
/// distance is given.
pub const ON_SKIN_SPACINGS: f64 = 10.0;

/// What an index is made ready for, besides the nearest point of the skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct IndexOptions {
    /// [Reactive](ContactIndex::reactive) answers: every level has a tree of its own, and is measured
    /// against the skin, which takes several times longer than the rest.
    pub levels: bool,
    /// Searches for taxels and receptive fields.
    pub fields: bool,
}

/// A map made ready for contacts.
///
/// It owns what it needs of the map, and asking changes nothing in it: share it among threads as
/// you like.
#[derive(Debug, Clone)]
pub struct ContactIndex {
    pub(super) links: IdVec<LinkId, IndexedLink>,
    pub(super) patches: IdVec<PatchId, IndexedPatch>,
    /// The boxes of all patches as the robot is posed now, in the world.
    pub(super) boxes: BoxTree,
    pub(super) options: IndexOptions,
}

#[derive(Debug, Clone)]
pub(super) struct IndexedLink {
    name: String,
    parent: Option<LinkId>,
    /// Its pose in the map, relative to its parent.
    pub(super) rest: DAffine3,
    pub(super) pose: RigidPose,
    /// Where it moves next.
    pub(super) next: RigidPose,
    pub(super) patches: Vec<PatchId>,
}

/// Where the last search of a batch ended: the patch, and the packet of its tree.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Cursor(Option<(PatchId, u32)>);

impl ContactIndex {
    /// An index of all patches and levels of a map, its links posed as the map says.
    ///
    /// # Errors
    /// If the map is not valid or has no triangle, if a row of a prolongation lies in no face, if a
    /// coordinate is too large, or if the pose of a link is not rigid.
    pub fn new(map: &SkinMap) -> Result<Self, ContactError> {
        Self::with_options(map, &IndexOptions::default())
    }

    /// As [`Self::new`], made ready for more than the nearest point of the skin.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_options(map: &SkinMap, options: &IndexOptions) -> Result<Self, ContactError> {
        map.validate()?;
        let patches = par_map(&map.patches, |patch| IndexedPatch::new(patch, options));
        let patches: IdVec<PatchId, _> =
            patches.into_iter().collect::<Result<Vec<_>, ContactError>>()?.into();
        if patches.is_empty() {
            return Err(ContactError::NoSkin);
        }
        let mut links = IdVec::default();
        let mut world = IdVec::<LinkId, DAffine3>::default();
        for link in &map.links {
            let pose = link.parent.map_or(link.pose, |parent| world[parent] * link.pose);
            world.push(pose);
            let (name, parent, pose) = (link.name.clone(), link.parent, rigid(&link.name, &pose)?);
            links.push(IndexedLink { name, parent, rest: link.pose, pose, next: pose, patches: Vec::new() });
        }
        for (id, patch) in patches.enumerate() {
            links[patch.link].patches.push(id);
        }
        let mut index = Self { links, patches, boxes: BoxTree::default(), options: *options };
        for (id, patch) in map.patches.enumerate() {
            if let Some(joints) = &patch.taxels.joints {
                index.blend(id, joints)?;
            }
        }
        index.update_posed_boxes();
        Ok(index)
    }

    /// Moves every link to what `pose` makes of it and of its parent, which has its next pose by then.
    pub(super) fn set_links(
        &mut self,
        pose: impl Fn(LinkId, &IndexedLink, Option<&IndexedLink>) -> DAffine3,
    ) -> Result<(), ContactError> {
        for id in self.links.ids() {
            let link = &self.links[id];
            let parent = link.parent.map(|parent| &self.links[parent]);
            self.links[id].next = rigid(&link.name, &pose(id, link, parent))?;
        }
        for IndexedPatch { name, link, blend, .. } in self.patches.iter_mut() {
            if let Some(blend) = blend {
                let far = |(vertex, position): (VertexId, DVec3)| {
                    let patch = name.clone();
                    ContactError::TooLarge { patch, vertex, position: position.to_array() }
                };
                blend.follow(*link, |link| self.links[link].next.pose()).map_err(far)?;
            }
        }
        for link in self.links.iter_mut() {
            link.pose = link.next;
        }
        self.patches.iter_mut().for_each(IndexedPatch::bend);
        self.update_posed_boxes();
        Ok(())
    }

    /// The mean length of the edges of a patch's faces on level 0, in m: how far apart its taxels
    /// are. `None` if there is no such patch.
    #[must_use]
    pub fn spacing(&self, patch: PatchId) -> Option<f64> {
        self.patches.get(patch).map(|patch| patch.spacing)
    }

    /// The poses of the links in the world, in m.
    #[must_use]
    pub fn poses(&self) -> IdVec<LinkId, DAffine3> {
        self.links.map(|link| link.pose.pose())
    }

    fn update_posed_boxes(&mut self) {
        let Self { links, patches, boxes, .. } = self;
        let posed = |patch: usize| {
            let patch = &patches[PatchId::new(patch)];
            let pose = &links[patch.link].pose;
            patch.bounds.moved(|corner| pose.to_world(corner))
        };
        if boxes.is_empty() {
            let all: Vec<Aabb> = (0..patches.len()).map(posed).collect();
            *boxes = BoxTree::new(&all).expect("patches and poses are finite");
        } else {
            boxes.refit(posed);
        }
    }

    /// The point of the skin nearest to a query: a point of the world, or [`Query::on_link`].
    ///
    /// # Errors
    /// If the point is not finite, or the link does not exist or carries no patch.
    pub fn locate(&self, query: impl Into<Query>) -> Result<Hit, ContactError> {
        let query = query.into();
        self.check(0, &query)?;
        self.answer(&query)
    }

    /// Whether a contact can be answered; errors call it `number`, its place in its batch.
    ///
    /// # Errors
    /// If the point is not finite or farther than 1e12 m, or the link does not exist or carries no
    /// patch.
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

    /// The answer to a query that has been checked.
    pub(super) fn answer(&self, query: &Query) -> Result<Hit, ContactError> {
        let mut best = None;
        self.each_patch(query, f64::INFINITY, |id, q| {
            let patch = &self.patches[id];
            Search::new(&patch.tree, id, q).run(&mut best);
            Best::squared(best.as_ref()).sqrt()
        });
        best.map(|best| self.hit(query, &best)).ok_or(ContactError::NoSkin)
    }

    /// As [`Self::answer`], but what the cursor points to is searched first.
    pub(super) fn answer_along(&self, cursor: &mut Cursor, query: &Query) -> Result<Hit, ContactError> {
        let is_searched = |patch: &IndexedPatch| query.link.is_none_or(|link| link == patch.link);
        let first = cursor.0.filter(|&(id, _)| self.patches.get(id).is_some_and(is_searched));
        let mut best = None;
        let mut search = |id: PatchId, q: DVec3, start: Start| {
            let patch = &self.patches[id];
            if let Some(packet) = Search::new(&patch.tree, id, q).run_from(start, &mut best) {
                cursor.0 = Some((id, packet));
            }
            Best::squared(best.as_ref()).sqrt()
        };
        let mut reached = f64::INFINITY;
        if let Some((id, packet)) = first {
            reached = search(id, self.in_link(self.patches[id].link, query), Start::Packet(packet));
        }
        let first = first.map(|(id, _)| id);
        self.each_patch(query, reached, |id, q| {
            if Some(id) != first {
                reached = search(id, q, Start::Root);
            }
            reached
        });
        best.map(|best| self.hit(query, &best)).ok_or(ContactError::NoSkin)
    }

    /// Calls `visit(patch, point)` with every patch whose box may be nearer to a query than `visit`
    /// returned last, at first `distance`, in m; the one with the nearest box first. The point is
    /// that of the query in the frame of the patch's link.
    pub(super) fn each_patch(
        &self,
        query: &Query,
        mut distance: f64,
        mut visit: impl FnMut(PatchId, DVec3) -> f64,
    ) {
        let Some(link) = query.link else {
            self.boxes.each_near(query.point, distance, |id| {
                let id = PatchId::new(id);
                visit(id, self.links[self.patches[id].link].pose.to_local(query.point))
            });
            return;
        };
        let patches = &self.links[link].patches;
        let away = |id: &PatchId| self.patches[*id].bounds.least_distance(query.point);
        let first = patches.iter().copied().min_by(|a, b| away(a).total_cmp(&away(b)));
        let rest = patches.iter().copied().filter(|&id| Some(id) != first);
        for id in first.into_iter().chain(rest) {
            if away(&id) <= distance {
                distance = visit(id, query.point);
            }
        }
    }

    pub(super) fn in_link(&self, link: LinkId, contact: &Query) -> DVec3 {
        if contact.link == Some(link) { contact.point } else { self.links[link].pose.to_local(contact.point) }
    }

    pub(super) fn hit(&self, contact: &Query, best: &Best) -> Hit {
        let patch = &self.patches[best.patch];
        let (distance, position, normal) = self.placed(&patch.tree, patch.link, contact, best);
        let point = SurfacePoint { face: best.face, barycentric: best.closest.barycentric };
        Hit { patch: best.patch, link: patch.link, point, distance, position, normal }
    }

    /// Signed distance of a contact from the nearest point of a tree on a link, that point and the
    /// normal there, in the frame of the contact.
    pub(super) fn placed(
        &self,
        tree: &PatchBvh,
        link: LinkId,
        contact: &Query,
        best: &Best,
    ) -> (f64, DVec3, DVec3) {
        let PatchBvh { mesh, corners, .. } = tree;
        let q = self.in_link(link, contact);
        let here = mesh.point(&SurfacePoint { face: best.face, barycentric: best.closest.barycentric });
        let outward =
            pseudo_normal(corners, &mesh.triangles, |v| mesh.positions[v], best.face, best.closest.feature);
        let length = best.closest.squared.sqrt();
        let distance = if (q - here).dot(outward) < 0.0 { -length } else { length };
        let (normal, pose) = (outward.normalize_or_zero(), &self.links[link].pose);
        match contact.link {
            Some(_) => (distance, here, normal),
            None => (distance, pose.to_world(here), pose.turned(normal)),
        }
    }

    /// Which taxels work, patch by patch.
    pub(crate) fn presence(&self) -> impl Iterator<Item = &IdVec<VertexId, Presence>> + Clone {
        self.patches.iter().map(|patch| &patch.presence)
    }

    /// Whether a taxel of a patch of this index works.
    pub(crate) fn works(&self, patch: PatchId, taxel: VertexId) -> bool {
        self.patches[patch].presence[taxel] == Presence::Present
    }

    /// Level 0 of a patch of this index as the robot is posed, in m in the frame of its link.
    pub(crate) fn mesh(&self, patch: PatchId) -> &TriMesh {
        &self.patches[patch].tree.mesh
    }
}

fn rigid(name: &str, pose: &DAffine3) -> Result<RigidPose, ContactError> {
    let near = pose.translation.abs().max_element() <= LARGEST;
    let rigid = RigidPose::new(pose).filter(|_| near);
    rigid.ok_or_else(|| ContactError::NotRigid { name: name.to_owned() })
}
