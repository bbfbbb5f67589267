//! More than the nearest point: the fields near a contact or in a sphere, and what a ray meets first.

use glam::DVec3;

use crate::{
    bvh::Ray,
    contact::{
        ContactError, ContactIndex, Hit, Query,
        search::{Best, PointTree},
    },
    id::VertexId,
    mesh::Feature,
    pyramid::LevelId,
    skin::{LinkId, PatchId, TaxelId},
};

/// Rounding parts the distances of equally far hits by a smaller part of them.
const SAME_DISTANCE: f64 = 1.0 + 1e-12;

/// A receptive field near a contact; on level 0 a taxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldHit {
    /// Its patch.
    pub patch: PatchId,
    /// The link of that patch.
    pub link: LinkId,
    /// Its level.
    pub level: LevelId,
    /// The field: a vertex of that level.
    pub field: VertexId,
    /// Vendor id of the taxel at its centre.
    pub taxel: TaxelId,
    /// Distance of its centre from the point, in m.
    pub distance: f64,
    /// Its centre, in m, in the frame of the query.
    pub position: DVec3,
    /// The outward unit normal of the taxel at its centre, in the same frame. On a patch that follows
    /// several links it is turned as its vertices are moved: by the weighted mean of the rotations.
    pub normal: DVec3,
}

impl ContactIndex {
    /// The fields of a level whose centre lies within `radius` (m) of a query, ordered by patch and field.
    /// Needs an index with [fields](crate::contact::IndexOptions::fields).
    ///
    /// # Errors
    /// As [`ContactIndex::locate`], if the radius is negative or not a number, or if the index has no
    /// fields.
    pub fn fields_within(
        &self,
        query: impl Into<Query>,
        radius: f64,
        level: LevelId,
    ) -> Result<Vec<FieldHit>, ContactError> {
        let query = query.into();
        self.check(0, &query)?;
        if radius < 0.0 || radius.is_nan() {
            return Err(ContactError::NoDistance { distance: radius });
        }
        let (mut hits, mut found) = (Vec::new(), Vec::new());
        self.each_points(&query, level, radius, |id, points, centre| {
            found.clear();
            points.within(centre, radius, &mut found);
            hits.extend(found.iter().map(|&found| self.field_hit(&query, (id, level), points, found)));
            radius
        })?;
        hits.sort_unstable_by_key(|hit| (hit.patch, hit.field));
        Ok(hits)
    }

    /// The `count` fields of a level whose centres are nearest to a query, the nearest first; of
    /// equally near ones the first of the first patch. Needs an index with
    /// [fields](crate::contact::IndexOptions::fields).
    ///
    /// # Errors
    /// As [`ContactIndex::locate`], and if the index has no fields.
    pub fn nearest_fields(
        &self,
        query: impl Into<Query>,
        count: usize,
        level: LevelId,
    ) -> Result<Vec<FieldHit>, ContactError> {
        let query = query.into();
        self.check(0, &query)?;
        let mut hits: Vec<FieldHit> = Vec::new();
        // Room for what is left of a walk as a rule: growing step by step takes longer than the rest of it.
        let mut found = Vec::with_capacity(64);
        self.each_points(&query, level, f64::INFINITY, |id, points, q| {
            let farthest = |hits: &[FieldHit]| match hits.last() {
                Some(last) if hits.len() >= count => last.distance,
                _ => f64::INFINITY,
            };
            found.clear();
            points.nearest(q, count, farthest(&hits), &mut found);
            hits.extend(found.iter().map(|&found| self.field_hit(&query, (id, level), points, found)));
            let key = |hit: &FieldHit| (hit.patch, hit.field);
            hits.sort_by(|a, b| a.distance.total_cmp(&b.distance).then(key(a).cmp(&key(b))));
            hits.truncate(count);
            farthest(&hits)
        })?;
        Ok(hits)
    }

    /// Calls `visit` with the centres of fields of each patch that may be within what it returned
    /// last.
    fn each_points(
        &self,
        query: &Query,
        level: LevelId,
        reach: f64,
        mut visit: impl FnMut(PatchId, &PointTree, DVec3) -> f64,
    ) -> Result<(), ContactError> {
        if !self.options.fields {
            return Err(ContactError::NotIndexed { what: "fields" });
        }
        let mut last = reach;
        self.each_patch(query, reach, |id, q| {
            if let Some(points) = self.patches[id].fields.get(level.index()) {
                last = visit(id, points, q);
            }
            last
        });
        Ok(())
    }

    fn field_hit(
        &self,
        query: &Query,
        (id, level): (PatchId, LevelId),
        points: &PointTree,
        (field, distance): (VertexId, f64),
    ) -> FieldHit {
        let patch = &self.patches[id];
        let (here, normal) = (points.point(field), patch.normals[patch.origins[level.index()][field]]);
        let pose = &self.links[patch.link].pose;
        let (position, normal) = match query.link {
            Some(_) => (here, normal),
            None => (pose.to_world(here), pose.turned(normal)),
        };
        let taxel = patch.cells.taxel(level, field);
        FieldHit { patch: id, link: patch.link, level, field, taxel, distance, position, normal }
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
        self.check(0, &query)?;
        let ray = Ray::new(query.point, direction, longest).ok_or(ContactError::NoRay)?;
        let mut first: Option<(f64, Best)> = None;
        let mut visit = |id: PatchId| {
            let patch = &self.patches[id];
            let pose = &self.links[patch.link].pose;
            let local = match query.link {
                Some(_) => ray,
                None => ray.moved(|p| pose.to_local(p), |v| pose.turned_back(v)),
            };
            // Equally far hits count, though rounding may part them.
            let known = first.as_ref().map_or(longest, |(distance, _)| longest.min(distance * SAME_DISTANCE));
            if let Some(found) = patch.tree.first_hit(&Ray { longest: known, ..local }) {
                let feature = Feature::at(found.barycentric);
                let closest = crate::mesh::Closest {
                    squared: 0.0,
                    barycentric: found.barycentric,
                    feature,
                    is_flat: false,
                };
                let best = Best { patch: id, face: found.face, closest };
                if first
                    .as_ref()
                    .is_none_or(|(distance, best)| (found.distance, id) < (*distance, best.patch))
                {
                    first = Some((found.distance, best));
                }
            }
            first.as_ref().map_or(longest, |(distance, _)| *distance)
        };
        match query.link {
            Some(link) => self.links[link].patches.iter().for_each(|&id| _ = visit(id)),
            None => self.boxes.each_along(&ray, |id| visit(PatchId::new(id))),
        }
        Ok(first.map(|(distance, best)| Hit { distance, ..self.hit(&query, &best) }))
    }
}
