//! The links that new taxels follow, from those of the old ones.

use std::collections::BTreeMap;

use crate::bvh::BvhError;
use crate::id::VertexId;
use crate::parallel::par_ids;
use crate::remesh::surface::Surface;
use crate::skin::{Joints, LinkId, Patch};

/// Lets the taxels of `fresh`, a new mesh of the surface of `old`, follow the links of the old ones: with their weights,
/// interpolated linearly over the old triangle that is nearest on the same side. Of more than four links those of the
/// largest weights count.
pub(super) fn follow_links(fresh: &mut Patch, old: &Patch) -> Result<(), BvhError> {
    fresh.taxels.binds.clone_from(&old.taxels.binds);
    let Some(joints) = &old.taxels.joints else { return Ok(()) };
    let surface = Surface::new(old.mesh.clone())?;
    let mut fixed = Joints::default();
    fixed[0] = (fresh.link, 1.0);
    let followed = par_ids(fresh.mesh.positions.len(), |v: VertexId| {
        let found = surface.corners_at(fresh.mesh.positions[v], fresh.taxels.normals[v]);
        found.map_or(fixed, |(corners, weights)| {
            blend(corners.iter().map(|&corner| &joints[corner]).zip(weights))
        })
    });
    fresh.taxels.joints = Some(followed);
    Ok(())
}

/// The mean of joints with these weights.
pub(super) fn blend<'a>(all: impl Iterator<Item = (&'a Joints, f64)>) -> Joints {
    let mut sums: BTreeMap<LinkId, f64> = BTreeMap::new();
    for (joints, share) in all {
        for &(link, weight) in joints {
            *sums.entry(link).or_default() += share.max(0.0) * weight;
        }
    }
    let mut sums: Vec<(LinkId, f64)> = sums.into_iter().filter(|(_, weight)| *weight > 0.0).collect();
    // Stable: of equal weights the first links stay.
    sums.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut blended = Joints::default();
    let total: f64 = sums.iter().take(blended.len()).map(|(_, weight)| weight).sum();
    for (slot, (link, weight)) in blended.iter_mut().zip(sums) {
        *slot = (link, weight / total);
    }
    blended
}
