//! [`ContactIndex`]: the trees and maps of all patches, the poses of all links; the nearest point to one
//! query or to many, the first on a ray, and the cells of results on the map.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use crate::bvh::{Aabb, BoxTree, Ray, Start};
use crate::contact::cell::Anchor;
use crate::contact::coarse::skins::ReactiveSkins;
use crate::contact::patch::IndexedPatch;
use crate::contact::patch_bvh::{Best, PatchBvh};
use crate::contact::posed_links::Links;
use crate::contact::query::RUN;
use crate::contact::{Cell, ContactError, Found, Hit, Hits, IndexOptions, Query};
use crate::id::{FaceId, IdVec, VertexId};
use crate::map::SkinMap;
use crate::mesh::{Closest, Feature, SurfacePoint, TriMesh, pseudo_normal};
use crate::numeric::along_curve;
use crate::parallel::par_map;
use crate::pyramid::LevelId;
use crate::run::Run;
use crate::skin::{LinkId, Motion, PatchId, Presence};

/// Default limit of the distance up to which a point is on the skin, in [spacings](ContactIndex::spacing) of
/// its taxels.
pub const ON_SKIN_SPACINGS: f64 = 10.0;

/// The relative difference between the rounded distances of equally far hits is smaller.
pub(super) const SAME_DISTANCE: f64 = 1.0 + 1e-12;

/// A map prepared for contacts.
///
/// It owns its data, and queries do not change it, so threads can share it. A clone shares its trees: to pose
/// the links differently for some queries, move a clone.
#[derive(Debug, Clone)]
pub struct ContactIndex {
    pub(super) links: Links,
    /// Patches with a blend are copied when a clone moves.
    pub(super) patches: IdVec<PatchId, Arc<IndexedPatch>>,
    /// The boxes of all patches in the current pose of the robot, in the world.
    pub(super) boxes: BoxTree,
    pub(super) options: IndexOptions,
    /// `None` if the index has no reactive answers.
    pub(super) reactive: Option<ReactiveSkins>,
}

/// The patch, and the packet of its tree, where the last search of a batch ended.
#[derive(Debug, Clone, Copy, Default)]
struct Cursor(Option<(PatchId, u32)>);

impl ContactIndex {
    /// An index of all patches and levels of a map, its links posed as in the map.
    ///
    /// # Errors
    /// If the map is not valid or has no triangle, if a row of a prolongation lies in no face, if a
    /// coordinate is too large, or if the pose of a link is not rigid.
    pub fn new(map: &SkinMap) -> Result<Self, ContactError> {
        Self::with_options(map, &IndexOptions::default())
    }

    /// As [`Self::new`], prepared for more queries than the nearest point of the skin.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_options(map: &SkinMap, options: &IndexOptions) -> Result<Self, ContactError> {
        map.validate()?;
        let patches =
            par_map(map.patches.as_slice(), |patch| IndexedPatch::new(patch, options).map(Arc::new));
        let patches: IdVec<PatchId, _> =
            patches.into_iter().collect::<Result<Vec<_>, ContactError>>()?.into();
        if patches.is_empty() {
            return Err(ContactError::NoSkin);
        }
        let links = Links::new(map)?;
        let mut index = Self { links, patches, boxes: BoxTree::default(), options: *options, reactive: None };
        for (id, patch) in map.patches.enumerate() {
            if let Some(joints) = &patch.taxels.joints {
                Arc::make_mut(&mut index.patches[id]).follow(
                    id,
                    (joints, &patch.taxels.binds),
                    &index.links,
                )?;
            }
        }
        if options.reactive {
            index.reactive = Some(ReactiveSkins::new(&index.links, &index.patches)?);
        }
        index.update_posed_boxes();
        Ok(index)
    }

    /// Moves the links to their poses in a motion at a time (s). Links without poses keep the one
    /// that they have in the map relative to their parent. Nothing is rebuilt or allocated; patches with
    /// [joints](crate::skin::Taxels::joints) are fitted to their links, which costs some 60 to 80 ns a vertex.
    ///
    /// # Errors
    /// If a pose, or a vertex that follows several links, is too far away; then the links do not move.
    pub fn set_motion(&mut self, motion: &Motion, time: f64) -> Result<(), ContactError> {
        self.links.aim(motion, time)?;
        for IndexedPatch { name, link, blend, .. } in blended(&mut self.patches) {
            if let Some(blend) = blend {
                let far = |(vertex, position): (VertexId, DVec3)| {
                    let patch = name.clone();
                    ContactError::TooLarge { patch, vertex, position: position.to_array() }
                };
                blend.follow(*link, |link| self.links.next(link)).map_err(far)?;
            }
        }
        self.links.commit();
        blended(&mut self.patches).for_each(IndexedPatch::bend);
        self.update_posed_boxes();
        Ok(())
    }

    /// The mean length of the edges of a patch's faces on level 0, in m: the spacing of its taxels. `None` if
    /// there is no such patch.
    pub fn spacing(&self, patch: PatchId) -> Option<f64> {
        self.patches.get(patch).map(|patch| patch.spacing)
    }

    /// The poses of the links in the world, in m.
    pub fn poses(&self) -> IdVec<LinkId, DAffine3> {
        self.links.poses()
    }

    fn update_posed_boxes(&mut self) {
        let Self { links, patches, boxes, reactive, .. } = self;
        if let Some(reactive) = reactive {
            reactive.pose(links, patches);
        }
        let posed = |patch: usize| {
            let patch = &patches[PatchId::new(patch)];
            let pose = links.pose(patch.link);
            patch.bounds.moved(|corner| pose.transform_point3(corner))
        };
        if boxes.is_empty() {
            let all: Vec<Aabb> = (0..patches.len()).map(posed).collect();
            *boxes = BoxTree::new(&all).expect("patches and poses are finite");
        } else {
            boxes.refit(posed);
        }
    }

    /// The point of the skin nearest to a query: a point of the world, or [`Query::in_link`].
    ///
    /// # Errors
    /// If the point is not finite or farther than 1e12 m, a link does not exist, or the only link that is
    /// searched carries no patch.
    pub fn locate(&self, query: impl Into<Query>) -> Result<Hit, ContactError> {
        let query = query.into();
        self.links.check(0, &query)?;
        self.answer(&query)
    }

    /// Answers many queries, in parallel; the same hits in the same order as one by one.
    ///
    /// They are visited along a Morton curve, so that each search finds the data of the last one in the
    /// cache.
    ///
    /// # Errors
    /// The first query that cannot be answered, or if the run is cancelled.
    pub fn locate_all(&self, queries: &[Query], run: Run<'_>) -> Result<Hits, ContactError> {
        /// Queries that share a curve: enough for it to pay, and few enough for their buffers to be reused.
        const BATCH: usize = 1 << 17;
        let checked = queries.par_iter().enumerate().with_min_len(RUN);
        let refused = checked.find_map_first(|(number, query)| self.links.check(number, query).err());
        if let Some(error) = refused {
            return Err(error);
        }
        let (mut hits, mut sorted) = (Hits::with_capacity(queries.len()), Vec::new());
        for batch in queries.chunks(BATCH) {
            run.check()?;
            let points: Vec<DVec3> =
                batch.par_iter().with_min_len(RUN).map(|query| self.links.in_world(query)).collect();
            let order = along_curve(&points);
            order
                .par_iter()
                .with_min_len(RUN)
                .map_with(Cursor::default(), |cursor, &number| self.answer_along(cursor, &batch[number]))
                .collect_into_vec(&mut sorted);
            if sorted.par_iter().with_min_len(RUN).any(Option::is_none) {
                return Err(ContactError::NoSkin);
            }
            let mut places = vec![0_usize; batch.len()];
            order.iter().enumerate().for_each(|(place, &number)| places[number] = place);
            hits.extend(&sorted, &places);
        }
        Ok(hits)
    }

    /// The first point of the skin that a ray meets, from either side, no farther than `longest` (m)
    /// from its origin; its `distance` is that from the origin. The direction is in the frame of the
    /// origin and need not be of unit length.
    ///
    /// # Errors
    /// As [`ContactIndex::locate`], and if the direction has no length or a number is not finite.
    pub fn first_hit(
        &self,
        origin: impl Into<Query>,
        direction: DVec3,
        longest: f64,
    ) -> Result<Option<Hit>, ContactError> {
        let query = origin.into();
        self.links.check(0, &query)?;
        let ray = Ray::new(query.point, direction, longest).ok_or(ContactError::NoRay)?;
        let world = query.link.map_or(ray, |link| {
            let pose = self.links.pose(link);
            ray.moved(|p| pose.transform_point3(p), |v| pose.transform_vector3(v))
        });
        let mut first: Option<(f64, Best)> = None;
        let mut visit = |id: PatchId| {
            let patch = &self.patches[id];
            let back = self.links.inverse(patch.link);
            let local = if query.link == Some(patch.link) {
                ray
            } else {
                world.moved(|p| back.transform_point3(p), |v| back.transform_vector3(v))
            };
            // Equally far hits count, although rounding may make them differ.
            let known = first.as_ref().map_or(longest, |(distance, _)| longest.min(distance * SAME_DISTANCE));
            if let Some(found) = patch.tree.first_hit(&Ray { longest: known, ..local }) {
                let feature = Feature::at(found.barycentric);
                let closest =
                    Closest { squared: 0.0, barycentric: found.barycentric, feature, is_flat: false };
                let best = Best { patch: id, face: FaceId::from(found.triangle), closest };
                if first
                    .as_ref()
                    .is_none_or(|(distance, best)| (found.distance, id) < (*distance, best.patch))
                {
                    first = Some((found.distance, best));
                }
            }
            first.as_ref().map_or(longest, |(distance, _)| *distance)
        };
        match query.only_link {
            Some(link) => self.links.patches(link).iter().for_each(|&id| _ = visit(id)),
            None => self.boxes.each_along(&world, |id| visit(PatchId::new(id))),
        }
        Ok(first.map(|(distance, best)| Hit { distance, ..self.hit(&query, &best) }))
    }

    /// The cell of a result on the map of `level`: of a hit on any level of its patch, of a field on its own
    /// level. `None` if its patch does not have that level, if a field is on another level or belongs to no
    /// face, or if the result is not from this index.
    pub fn cell<'a>(&self, found: impl Into<Found<'a>>, level: LevelId) -> Option<Cell> {
        match found.into() {
            Found::Hit(hit) => {
                let patch = self.patches.get(hit.patch)?;
                patch.cells.cell(level, &Anchor::new(&patch.tree.mesh, &hit.point)?)
            }
            Found::Field(field) => {
                let patch = self.patches.get(field.patch).filter(|_| field.level == level)?;
                patch.cells.field_cell(level, field.field)
            }
        }
    }

    /// The answer to a checked query.
    fn answer(&self, query: &Query) -> Result<Hit, ContactError> {
        let mut best = None;
        self.each_patch(query, f64::INFINITY, |id, q| {
            let patch = &self.patches[id];
            patch.tree.nearest(id, q, Start::Root, &mut best);
            Best::squared(best.as_ref()).sqrt()
        });
        best.map(|best| self.hit(query, &best)).ok_or(ContactError::NoSkin)
    }

    /// As [`Self::answer`], but the packet of the cursor is searched first.
    fn answer_along(&self, cursor: &mut Cursor, query: &Query) -> Option<Hit> {
        let is_searched = |patch: &Arc<IndexedPatch>| query.only_link.is_none_or(|link| link == patch.link);
        let first = cursor.0.filter(|&(id, _)| self.patches.get(id).is_some_and(is_searched));
        let mut best = None;
        let mut search = |id: PatchId, q: DVec3, start: Start| {
            let patch = &self.patches[id];
            if let Some(packet) = patch.tree.nearest(id, q, start, &mut best) {
                cursor.0 = Some((id, packet));
            }
            Best::squared(best.as_ref()).sqrt()
        };
        let mut reached = f64::INFINITY;
        if let Some((id, packet)) = first {
            let world = self.links.in_world(query);
            reached =
                search(id, self.links.in_link(self.patches[id].link, query, world), Start::Packet(packet));
        }
        let first = first.map(|(id, _)| id);
        self.each_patch(query, reached, |id, q| {
            if Some(id) != first {
                reached = search(id, q, Start::Root);
            }
            reached
        });
        best.map(|best| self.hit(query, &best))
    }

    /// Calls `visit(patch, point)` with every patch whose box may be nearer to a query than the value `visit`
    /// returned last, at first `distance`, in m; the one with the nearest box first. The point is that of the
    /// query in the frame of the patch's link.
    pub(super) fn each_patch(
        &self,
        query: &Query,
        mut distance: f64,
        mut visit: impl FnMut(PatchId, DVec3) -> f64,
    ) {
        let world = self.links.in_world(query);
        let Some(link) = query.only_link else {
            return self.boxes.each_near(world, distance, |id| {
                let id = PatchId::new(id);
                visit(id, self.links.in_link(self.patches[id].link, query, world))
            });
        };
        let (q, patches) = (self.links.in_link(link, query, world), self.links.patches(link));
        let away = |id: &PatchId| self.patches[*id].bounds.least_distance(q);
        let first = patches.iter().copied().min_by(|a, b| away(a).total_cmp(&away(b)));
        let rest = patches.iter().copied().filter(|&id| Some(id) != first);
        for id in first.into_iter().chain(rest) {
            if away(&id) <= distance {
                distance = visit(id, q);
            }
        }
    }

    /// The hit of a found face, in the frame of the query.
    pub(super) fn hit(&self, query: &Query, best: &Best) -> Hit {
        let IndexedPatch { tree: PatchBvh { mesh, corners, .. }, link, .. } = &*self.patches[best.patch];
        let point = SurfacePoint { face: best.face, barycentric: best.closest.barycentric };
        let q = self.links.in_link(*link, query, self.links.in_world(query));
        let here = mesh.point(&point);
        let outward =
            pseudo_normal(corners, &mesh.triangles, |v| mesh.positions[v], best.face, best.closest.feature);
        let length = best.closest.squared.sqrt();
        let distance = if (q - here).dot(outward) < 0.0 { -length } else { length };
        let (position, normal) = self.links.answered(*link, query, here, outward.normalize_or_zero());
        Hit { patch: best.patch, link: *link, point, distance, position, normal }
    }

    /// Which taxels work, patch by patch.
    pub(crate) fn presence(&self) -> impl Iterator<Item = &IdVec<VertexId, Presence>> + Clone {
        self.patches.iter().map(|patch| &patch.presence)
    }

    /// Whether a taxel of a patch of this index works.
    pub(crate) fn works(&self, patch: PatchId, taxel: VertexId) -> bool {
        self.patches[patch].presence[taxel] == Presence::Present
    }

    /// Level 0 of a patch of this index in the current pose of the robot, in m in the frame of its link.
    pub(crate) fn mesh(&self, patch: PatchId) -> &TriMesh {
        &self.patches[patch].tree.mesh
    }
}

/// The patches whose vertices follow several links, for this index alone.
fn blended(patches: &mut IdVec<PatchId, Arc<IndexedPatch>>) -> impl Iterator<Item = &mut IndexedPatch> {
    patches.iter_mut().filter(|patch| patch.blend.is_some()).map(Arc::make_mut)
}
