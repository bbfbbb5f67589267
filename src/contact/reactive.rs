//! The answer of a coarse level alone, and its error bound.

use crate::{
    bvh::Start,
    contact::{ContactError, ContactIndex, Query, Reactive, patch_bvh::Best},
    mesh::SurfacePoint,
    pyramid::LevelId,
};

impl ContactIndex {
    /// The point of a level nearest to a query, which searches that level alone: several times
    /// faster than [`ContactIndex::locate`], and as exact as its `least` and `most` say. On patches without
    /// that level their coarsest is searched; on those that follow several links it is level 0, since
    /// how far a coarse face is from the skin changes as the skin bends. Needs an index with
    /// [levels](crate::contact::IndexOptions::levels).
    ///
    /// # Errors
    /// As [`ContactIndex::locate`], and if the index has no levels above level 0.
    pub fn reactive(&self, query: impl Into<Query>, level: LevelId) -> Result<Reactive, ContactError> {
        let query = query.into();
        self.links.check(0, &query)?;
        if !self.options.levels && level.index() > 0 {
            return Err(ContactError::NotIndexed { what: "levels" });
        }
        // The skin of the patches searched so far is at least and at most this far from the query, in m.
        let (mut best, mut least, mut most) = (None, f64::INFINITY, f64::INFINITY);
        self.each_patch(&query, f64::INFINITY, |id, q| {
            let before = Best::squared(best.as_ref()).sqrt();
            let (tree, coarse) = self.patches[id].on_level(level);
            tree.nearest(id, q, Start::Root, &mut best);
            let away = Best::squared(best.as_ref()).sqrt();
            let range = match (coarse, best.as_ref().filter(|best| best.patch == id)) {
                (Some(coarse), Some(best)) => coarse.range(q, best),
                (Some(coarse), None) => [before - coarse.most, f64::INFINITY],
                (None, found) => [found.map_or(before, |_| away), found.map_or(f64::INFINITY, |_| away)],
            };
            (least, most) = (least.min(range[0]), most.min(range[1]));
            // Patches that are not searched are farther than `least`.
            away.max(least)
        });
        let Some(best) = best else { return Err(ContactError::NoSkin) };
        let patch = &self.patches[best.patch];
        let (tree, _) = patch.on_level(level);
        let (distance, position, normal) = self.placed(tree, patch.link, &query, &best);
        Ok(Reactive {
            level: patch.nearest_level(level),
            patch: best.patch,
            link: patch.link,
            point: SurfacePoint { face: best.face, barycentric: best.closest.barycentric },
            distance,
            least: least.max(0.0),
            most,
            position,
            normal,
        })
    }
}
