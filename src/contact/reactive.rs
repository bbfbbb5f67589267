//! The answer of a coarse level alone, and its error bound.

use crate::{
    bvh::Start,
    contact::{ContactError, ContactIndex, Query, Reactive, coarse::CoarseLevel, patch_bvh::Best},
    id::FaceId,
    mesh::SurfacePoint,
    pyramid::LevelId,
};

impl ContactIndex {
    /// The point of a level nearest to a query, which searches that level alone: several times
    /// faster than [`ContactIndex::locate`], and as exact as its `error` says. On patches without
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
        // `least`: no skin of the patches searched so far is nearer to the query, in m.
        let (mut best, mut least) = (None, f64::INFINITY);
        self.each_patch(&query, f64::INFINITY, |id, q| {
            let before = Best::squared(best.as_ref()).sqrt();
            let (tree, coarse) = self.patches[id].on_level(level);
            tree.nearest(id, q, Start::Root, &mut best);
            let found = best.as_ref().filter(|best| best.patch == id);
            let away = Best::squared(best.as_ref()).sqrt();
            let around = match (coarse, found) {
                (None, _) => 0.0,
                (Some(coarse), Some(best)) => around(coarse, best.face, away),
                (Some(coarse), None) => coarse.most,
            };
            least = least.min(before.min(away) - around);
            away
        });
        let Some(best) = best else { return Err(ContactError::NoSkin) };
        let patch = &self.patches[best.patch];
        let (tree, coarse) = patch.on_level(level);
        let (distance, position, normal) = self.placed(tree, patch.link, &query, &best);
        let face = coarse.map_or(0.0, |coarse| coarse.deviation(best.face).face);
        Ok(Reactive {
            level: patch.nearest_level(level),
            patch: best.patch,
            link: patch.link,
            point: SurfacePoint { face: best.face, barycentric: best.closest.barycentric },
            distance,
            error: face.max(distance.abs() - least).max(0.0),
            position,
            normal,
        })
    }
}

/// How much nearer the skin may be to a query whose nearest face of a level is `face`, at this
/// distance, in m.
fn around(level: &CoarseLevel, face: FaceId, away: f64) -> f64 {
    if away <= level.near { level.deviation(face).around } else { level.most }
}
