//! Taxels and receptive fields near a point or in a sphere.

use glam::DVec3;

use crate::bvh::PointTree;
use crate::contact::index::SAME_DISTANCE;
use crate::contact::{ContactError, ContactIndex, FieldHit, Query};
use crate::id::VertexId;
use crate::pyramid::LevelId;
use crate::skin::PatchId;

impl ContactIndex {
    /// The fields of a level, of a patch without it those of its coarsest, whose centre lies within `radius` (m) of a query, ordered by patch and field.
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
        self.links.check(0, &query)?;
        if radius < 0.0 || radius.is_nan() {
            return Err(ContactError::NoDistance { distance: radius });
        }
        let (mut hits, mut found) = (Vec::new(), Vec::new());
        self.each_points(&query, level, radius, |id, level, points, centre| {
            found.clear();
            points.within(centre, radius, &mut found);
            hits.extend(found.iter().map(|&(field, away)| self.field_hit(&query, id, level, field, away)));
            radius
        })?;
        hits.sort_unstable_by_key(|hit| (hit.patch, hit.field));
        Ok(hits)
    }

    /// The `count` fields of a level, of patches without it of their coarsest, whose centres are nearest to a query, the nearest first; of
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
        self.links.check(0, &query)?;
        let mut hits: Vec<FieldHit> = Vec::new();
        // Usually enough for all results: growing step by step takes longer than the rest of the search.
        let mut found = Vec::with_capacity(64);
        self.each_points(&query, level, f64::INFINITY, |id, level, points, q| {
            let farthest = |hits: &[FieldHit]| match hits.last() {
                Some(last) if hits.len() >= count => last.distance,
                _ => f64::INFINITY,
            };
            found.clear();
            // Equally far ones count, although rounding may make their squares differ.
            points.nearest(q, count, farthest(&hits) * SAME_DISTANCE, &mut found);
            let hit = |&(field, squared): &(_, f64)| self.field_hit(&query, id, level, field, squared.sqrt());
            hits.extend(found.iter().map(hit));
            let key = |hit: &FieldHit| (hit.patch, hit.field);
            hits.sort_by(|a, b| a.distance.total_cmp(&b.distance).then(key(a).cmp(&key(b))));
            hits.truncate(count);
            farthest(&hits)
        })?;
        Ok(hits)
    }

    /// Calls `visit` with the centres of fields of each patch that may be within the distance it returned
    /// last, and their level.
    fn each_points(
        &self,
        query: &Query,
        level: LevelId,
        reach: f64,
        mut visit: impl FnMut(PatchId, LevelId, &PointTree, DVec3) -> f64,
    ) -> Result<(), ContactError> {
        if !self.options.fields {
            return Err(ContactError::NotIndexed { what: "fields" });
        }
        let mut last = reach;
        self.each_patch(query, reach, |id, q| {
            let fields = &self.patches[id].fields;
            let level = level.min(LevelId::new(fields.len().saturating_sub(1)));
            last = visit(id, level, &fields[level.index()], q);
            last
        });
        Ok(())
    }

    fn field_hit(
        &self,
        query: &Query,
        id: PatchId,
        level: LevelId,
        field: VertexId,
        distance: f64,
    ) -> FieldHit {
        let patch = &self.patches[id];
        let (points, origins) = (&patch.fields[level.index()], &patch.origins[level.index()]);
        let (here, normal) = (points.points()[field.index()], patch.normals[origins[field]]);
        let (position, normal) = self.links.answered(patch.link, query, here, normal);
        let taxel = patch.cells.taxel(level, field);
        FieldHit { patch: id, link: patch.link, level, field, taxel, distance, position, normal }
    }
}
