//! From the answer of a coarse level to the exact one.
//!
//! The skin is at most `u = |distance| + error` from the contact. It belongs to faces of the level that
//! are no farther than `u` and their own deviation; the finer faces of these that are not farther
//! than `u` and theirs, and so on down to level 0. Whatever is left there holds the nearest point: that
//! is the certificate. Where many faces are left a search from the start is faster.

use super::Reactive;
use crate::{
    contact::{
        ContactError, ContactIndex, Hit, Query,
        coarse::CoarseLevel,
        geometry::Volume,
        search::{Best, PatchBvh},
    },
    id::FaceId,
    mesh::closest_point,
    pyramid::LevelId,
    skin::PatchId,
};

/// Faces that are measured before a search from the start is taken for faster (*heuristic*: one to two
/// microseconds, of which `benches/coarse_to_fine.rs` shows both).
const MOST_MEASURED: usize = 96;

/// What rounding may add to the distances that are compared, as a part of them.
const ROUNDING: f64 = 1e-9;

/// An exact answer, and how it was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refined {
    /// The same as [`ContactIndex::locate`] answers.
    pub hit: Hit,
    /// Whether the faces near the coarse answer were enough: the certificate held. Otherwise the
    /// whole skin was searched.
    pub certified: bool,
}

/// The search below one coarse answer.
struct Refinement<'a> {
    query: &'a Query,
    measured: usize,
    best: Option<Best>,
    /// Largest distance of the nearest point, in m.
    reach: f64,
}

impl ContactIndex {
    /// The exact answer to a query whose answer on a coarse level is known.
    ///
    /// # Errors
    /// As [`ContactIndex::reactive`].
    pub fn refine(&self, query: impl Into<Query>, answer: &Reactive) -> Result<Refined, ContactError> {
        let query = query.into();
        self.check(0, &query)?;
        let reach = (answer.distance.abs() + answer.error) * (1.0 + ROUNDING);
        let mut refinement = Refinement { query: &query, measured: 0, best: None, reach };
        let certified = self.certify(answer.level, &mut refinement);
        // An answer to another query, or in another pose, may reach less far.
        let is_reached = |best: &Best| certified && Best::squared(Some(best)).sqrt() <= reach;
        let best = refinement.best.filter(is_reached);
        let hit = best.map_or_else(|| self.answer(&query), |best| Ok(self.hit(&query, &best)))?;
        Ok(Refined { hit, certified: best.is_some() })
    }

    /// Whether all faces that may hold the nearest point were measured.
    fn certify(&self, level: LevelId, refinement: &mut Refinement<'_>) -> bool {
        let mut is_complete = self.options.levels && level.index() > 0;
        if !is_complete {
            return false;
        }
        let mut found = Vec::new();
        self.each_patch(refinement.query, refinement.reach, |id, q| {
            let patch = &self.patches[id];
            let (tree, coarse) = patch.on_level(level);
            let radius = refinement.reach + coarse.map_or(0.0, |level| level.most);
            found.clear();
            if let Some(sphere) = Volume::sphere(q, radius * (1.0 + ROUNDING)).filter(|_| is_complete) {
                tree.faces_within(&sphere, &mut found);
            }
            found.sort_by(|a, b| a.1.total_cmp(&b.1));
            let levels = &patch.coarse[..patch.nearest_level(level).index()];
            for &(face, distance) in &found {
                is_complete = is_complete && refinement.descend(&patch.tree, id, levels, q, face, distance);
            }
            if is_complete { refinement.reach } else { 0.0 }
        });
        is_complete
    }
}

impl Refinement<'_> {
    /// Measures the faces of level 0 below a face of the last of `levels` at this distance; false if
    /// they are too many.
    fn descend(
        &mut self,
        finest: &PatchBvh,
        patch: PatchId,
        levels: &[CoarseLevel],
        q: glam::DVec3,
        face: FaceId,
        distance: f64,
    ) -> bool {
        let Some((level, finer)) = levels.split_last() else {
            let closest = finest.measure(q, face);
            Best::offer(&mut self.best, patch, face, closest);
            let found = Best::squared(self.best.as_ref()).sqrt() * (1.0 + ROUNDING);
            self.reach = self.reach.min(found);
            return true;
        };
        if distance * (1.0 - ROUNDING) > self.reach + level.deviation(face).skin {
            return true;
        }
        let below = finer.last().map_or(&finest.mesh, |level| &level.tree.mesh);
        level.children(face).iter().all(|&child| {
            self.measured += 1;
            let distance = match finer {
                [] => 0.0,
                _ => closest_point(q, below.corners(child), below.triangles[child]).squared.sqrt(),
            };
            self.measured <= MOST_MEASURED && self.descend(finest, patch, finer, q, child, distance)
        })
    }
}
