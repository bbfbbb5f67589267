//! How far every point of a triangle is at most from a mesh.
//!
//! The distance to one triangle is convex, so it is largest at a corner; the distance to a mesh is
//! at most that to any of its triangles. A triangle that no single face of the mesh bounds well is
//! therefore divided in four, until its parts are. Parts over an edge of the mesh only become small:
//! there the bound exceeds the distance by up to their size (*heuristic*: [`DEEPEST`] keeps the
//! median bound on a smooth cap under five times the largest error of 2000 contacts, which
//! `tests/contact_levels.rs` checks).

use glam::DVec3;

use crate::{
    contact::search::{Best, PatchBvh, Search},
    id::FaceId,
    mesh::closest_point,
    skin::PatchId,
};

/// A bound that exceeds the distance at a corner by at most this part is good enough.
const RATIO: f64 = 1.1;

/// How often a triangle is halved at most, besides the halvings down to the size of the mesh's faces.
pub(super) const DEEPEST: u32 = 3;

/// Bounds are enlarged by this part of the coordinates they follow from: some hundred roundings.
pub(super) const ROUND_UP: f64 = 1e-13;

/// A mesh that triangles are measured against.
pub(super) struct Target<'a> {
    pub(super) tree: &'a PatchBvh,
    /// What each face adds to the distance to it, in m.
    pub(super) more: &'a (dyn Fn(FaceId) -> f64 + Sync),
    /// Errors below this do not matter, in m.
    pub(super) tolerance: f64,
}

/// A corner of a part, the face that is nearest to it and their distance, in m.
type Corner = (DVec3, FaceId, f64);

impl Target<'_> {
    /// Passes a face and a distance (m) to `offer` for each part of a triangle: no point of the part
    /// is farther from the face. `offer` says whether the part must not be divided further, since
    /// its bound changes nothing.
    pub(super) fn measure(
        &self,
        corners: [DVec3; 3],
        halvings: u32,
        offer: &mut dyn FnMut(FaceId, f64, bool) -> bool,
    ) {
        self.part(corners.map(|p| self.corner(p)), halvings, offer);
    }

    fn corner(&self, p: DVec3) -> Corner {
        let mut best = None;
        Search::new(self.tree, PatchId::new(0), p).run(&mut best);
        best.map_or((p, FaceId::default(), f64::INFINITY), |best: Best| {
            (p, best.face, best.closest.squared.sqrt())
        })
    }

    fn part(&self, corners: [Corner; 3], halvings: u32, offer: &mut dyn FnMut(FaceId, f64, bool) -> bool) {
        let mesh = &self.tree.mesh;
        let bound_of = |face: FaceId| {
            let ids = mesh.triangles[face];
            let away = |(p, ..): &Corner| closest_point(*p, mesh.corners(face), ids).squared;
            corners.iter().map(away).fold(0.0, f64::max).sqrt() + (self.more)(face)
        };
        let faces = corners.map(|(_, face, _)| face);
        let bounds = faces.map(bound_of);
        let best = (0..3).min_by(|&a, &b| bounds[a].total_cmp(&bounds[b])).unwrap_or(0);
        let (face, bound) = (faces[best], bounds[best]);
        let least = corners.iter().map(|&(_, face, d)| d + (self.more)(face)).fold(0.0, f64::max);
        let is_good = halvings == 0 || bound <= least * RATIO + self.tolerance;
        if offer(face, bound, is_good) || is_good {
            return;
        }
        let [a, b, c] = corners;
        let between = |(p, ..): Corner, (q, ..): Corner| self.corner(p.midpoint(q));
        let (ab, bc, ca) = (between(a, b), between(b, c), between(c, a));
        for part in [[ab, bc, ca], [a, ab, ca], [ab, b, bc], [ca, bc, c]] {
            self.part(part, halvings - 1, offer);
        }
    }
}
