//! What a ray meets first.

use glam::DVec3;

use crate::{
    bvh::Ray,
    contact::{ContactError, ContactIndex, Hit, Query, patch_bvh::Best},
    id::FaceId,
    mesh::{Closest, Feature},
    skin::PatchId,
};

/// Rounding parts the distances of equally far hits by a smaller part of them.
const SAME_DISTANCE: f64 = 1.0 + 1e-12;

impl ContactIndex {
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
            ray.moved(|p| pose.to_world(p), |v| pose.turned(v))
        });
        let mut first: Option<(f64, Best)> = None;
        let mut visit = |id: PatchId| {
            let patch = &self.patches[id];
            let pose = self.links.pose(patch.link);
            let local = if query.link == Some(patch.link) {
                ray
            } else {
                world.moved(|p| pose.to_local(p), |v| pose.turned_back(v))
            };
            // Equally far hits count, though rounding may part them.
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
}
