//! Answers in constant time: [`ContactIndex::reactive`] reads the [octrees](crate::contact::coarse) of the links.

use glam::DVec3;

use crate::bvh::Start;
use crate::contact::coarse::skins::ReactiveSkin;
use crate::contact::coarse::{Interval, Octree};
use crate::contact::patch_bvh::Best;
use crate::contact::{ContactError, ContactIndex, Hit, Query, Reactive, Refine};
use crate::mesh::SurfacePoint;

/// Most steps of a walk from the face of an answer.
const MOST_STEPS: usize = 24;

/// Relative error of a distance.
const DISTANCE_ROUNDING: f64 = 1e-12;

impl ContactIndex {
    /// The distance of a query from the skin as a guaranteed interval, the side and a face near the query, in
    /// constant time: some ten times faster than [`ContactIndex::locate`], especially far from the skin. Up
    /// to 50 mm from it the interval is usually a fraction of a millimetre wide; farther away it is wide.
    /// Patches that follow several links are searched exactly. Needs an index with [reactive
    /// answers](crate::contact::IndexOptions::reactive).
    ///
    /// # Errors
    /// As [`ContactIndex::locate`], and if the index has no reactive answers.
    pub fn reactive(&self, query: impl Into<Query>) -> Result<Reactive, ContactError> {
        let query = query.into();
        self.links.check(0, &query)?;
        let reactive = self.reactive.as_ref().ok_or(ContactError::NotIndexed { what: "reactive answers" })?;
        let world = self.links.in_world(&query);
        // Skins whose box is farther than `most` cannot be nearer.
        let (mut nearest, mut of) = (Interval::UNKNOWN, None);
        let mut visit = |skin| {
            let found = self.interval(skin, &query, world, nearest.most);
            let least = nearest.least.min(found.least);
            if found.most < nearest.most {
                (nearest, of) = (found, Some(skin));
            }
            nearest.least = least;
            nearest.most
        };
        match query.only_link {
            None => reactive.each_near(world, visit),
            Some(link) => {
                reactive.skins.iter().filter(|skin| skin.link == link).for_each(|skin| _ = visit(skin))
            }
        }
        let skin = of.ok_or(ContactError::NoSkin)?;
        let Interval { face, least, most, is_outside } = nearest;
        let ((patch, face), away) = (skin.face(face), 0.5 * (least + most));
        let distance = if is_outside { away } else { -away };
        Ok(Reactive { patch, link: skin.link, face, distance, least, most })
    }

    /// The interval of the distance from one skin; unknown if its vertices follow several links and it is no nearer than `most`.
    #[inline(always)]
    fn interval(&self, skin: &ReactiveSkin, query: &Query, world: DVec3, most: f64) -> Interval {
        let q = self.links.in_link(skin.link, query, world);
        if let Some(octree) = &skin.octree {
            return octree.interval(q, |face| {
                let (patch, face) = skin.face(face);
                self.patches[patch].tree.mesh.corners(face)
            });
        }
        let (id, _) = skin.patches[0];
        let mut best = (most < f64::INFINITY).then(|| Best::bound(most));
        self.patches[id].tree.nearest(id, q, Start::Root, &mut best);
        best.filter(|best| !best.is_bound()).map_or(Interval::UNKNOWN, |best| {
            let Hit { point, distance, .. } = self.hit(query, &best);
            let away = distance.abs();
            Interval { face: point.face.raw(), least: away, most: away, is_outside: distance >= 0.0 }
        })
    }

    /// Memory of the octrees of [reactive answers](ContactIndex::reactive), in bytes.
    pub fn reactive_bytes(&self) -> usize {
        let skins = self.reactive.iter().flat_map(|reactive| reactive.skins.iter());
        skins.filter_map(|skin| skin.octree.as_ref()).map(Octree::bytes).sum()
    }

    /// The point of the skin for a [reactive answer](ContactIndex::reactive) to a query; it has a
    /// [cell](ContactIndex::cell) on any level. Its distance is at most `most` of the answer, but not always
    /// the least one. `None` if the answer is not from this index.
    pub fn hit_of(&self, query: impl Into<Query>, answer: &Reactive, refine: Refine) -> Option<Hit> {
        let query = query.into();
        self.links.check(0, &query).ok()?;
        let patch = self.patches.get(answer.patch)?;
        patch.tree.mesh.triangles.get(answer.face)?;
        let q = self.links.in_link(patch.link, &query, self.links.in_world(&query));
        let walked = |steps: usize| Best { patch: answer.patch, ..patch.tree.walk(q, answer.face, steps) };
        let mut best = walked(0);
        // The bound is that of the skin, and the face is only near: where it is farther, the skin is searched.
        if best.closest.squared.sqrt() > answer.most * (1.0 + DISTANCE_ROUNDING) {
            return self.locate(Query { only_link: Some(patch.link), ..query }).ok();
        }
        if refine == Refine::Walk {
            best = walked(MOST_STEPS);
        }
        if refine == Refine::Walk {
            return Some(self.hit(&query, &best));
        }
        // The normal is that of the face: the pseudo-normal at its rim takes as long as the rest.
        let point = SurfacePoint { face: best.face, barycentric: best.closest.barycentric };
        let normal = patch.tree.mesh.face_cross(best.face).normalize_or_zero();
        let (position, normal) =
            self.links.answered(patch.link, &query, patch.tree.mesh.point(&point), normal);
        let distance = best.closest.squared.sqrt().copysign(answer.distance);
        Some(Hit { patch: answer.patch, link: patch.link, point, distance, position, normal })
    }
}
