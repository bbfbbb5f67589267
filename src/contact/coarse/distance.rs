//! How far every point of a triangle is at most from a mesh.
//!
//! The distance to one triangle is convex, so over a convex part it is largest at a corner; the
//! distance to a mesh is at most that to any of its triangles. A part that no single face of the mesh
//! bounds well is therefore cut in two, by the plane at right angles to a face through one of its sides:
//! what lies over the face is then a part of its own. Where no side of the face divides the part, it is
//! cut halfway between two corners.

use glam::DVec3;

use crate::bvh::Start;
use crate::contact::patch_bvh::{Best, PatchBvh};
use crate::id::FaceId;
use crate::mesh::{closest_point, triangle_cross};
use crate::skin::PatchId;

/// A bound that exceeds the distance at a corner by at most this part is good enough.
const RATIO: f64 = 1.1;

/// How often a triangle is cut at most, besides the cuts down to the size of the mesh's faces: often
/// enough for the six faces around a vertex.
pub(super) const DEEPEST: u32 = 7;

/// Bounds are enlarged by this part of the coordinates they follow from: some hundred roundings.
pub(super) const ROUND_UP: f64 = 1e-13;

/// Nearer to a plane than this part of the size of a part, a corner lies on it.
const ON_PLANE: f64 = 1e-6;

/// How far the points lie inside of a triangle that say which faces are nearest to its corners, as a part
/// of the way to its centre.
const INWARD: f64 = 1e-3;

/// A mesh that triangles are measured against.
pub(super) struct Target<'a> {
    pub(super) tree: &'a PatchBvh,
    /// What each face adds to the distance to it, in m.
    pub(super) more: &'a (dyn Fn(FaceId) -> f64 + Sync),
    /// Errors below this do not matter, in m.
    pub(super) tolerance: f64,
}

/// A corner of a part.
#[derive(Debug, Clone, Copy)]
pub(super) struct Corner {
    point: DVec3,
    /// The face of the target that is nearest to it, and a packet of the tree that has it.
    face: FaceId,
    packet: Option<u32>,
    /// Their distance, in m.
    distance: f64,
}

/// `offer(face, bound, is_last) -> stop`: `bound` is an upper bound (m) of the distances of the points of a
/// part from `face`, `is_last` says that the part is not cut any further; `stop` that it need not be, since its
/// bound changes nothing.
pub(super) type Offer<'a> = &'a mut dyn FnMut(FaceId, f64, bool) -> bool;

impl Target<'_> {
    /// A triangle as a part to be measured.
    pub(super) fn part(&self, corners: [DVec3; 3]) -> [Corner; 3] {
        let centre = corners.into_iter().sum::<DVec3>() / 3.0;
        let mut near = None;
        corners.map(|p| {
            // Several faces may be nearest to a corner: the one below the triangle is meant.
            let inside = self.corner(p.lerp(centre, INWARD), near);
            near = inside.packet;
            Corner { point: p, distance: self.distance(p, inside.face), ..inside }
        })
    }

    fn corner(&self, point: DVec3, near: Option<u32>) -> Corner {
        let mut best = None;
        let start = near.map_or(Start::Root, Start::Packet);
        let packet = self.tree.nearest(PatchId::new(0), point, start, &mut best);
        let (face, distance) = best.map_or((FaceId::default(), f64::INFINITY), |best: Best| {
            (best.face, best.closest.squared.sqrt())
        });
        Corner { point, face, packet, distance }
    }

    fn distance(&self, point: DVec3, face: FaceId) -> f64 {
        let mesh = &self.tree.mesh;
        closest_point(point, mesh.corners(face), mesh.triangles[face]).squared.sqrt()
    }

    /// Offers a bound for each of the parts into which a convex part is cut at most `cuts` times.
    pub(super) fn measure(&self, part: &[Corner], cuts: u32, offer: Offer<'_>) {
        let mut best = (FaceId::default(), f64::INFINITY, Vec::new());
        for (k, &Corner { face, .. }) in part.iter().enumerate() {
            if part[..k].iter().all(|other| other.face != face) {
                let away: Vec<f64> = part.iter().map(|c| self.distance(c.point, face)).collect();
                let bound = away.iter().copied().fold(0.0, f64::max) + (self.more)(face);
                if bound < best.1 {
                    best = (face, bound, away);
                }
            }
        }
        let (face, bound, away) = best;
        let least = part.iter().map(|c| c.distance + (self.more)(c.face)).fold(0.0, f64::max);
        let is_good = cuts == 0 || bound <= least * RATIO + self.tolerance;
        if offer(face, bound, is_good) || is_good {
            return;
        }
        for half in self.halves(part, &self.heights(part, face, &away)) {
            self.measure(&half, cuts - 1, offer);
        }
    }

    /// The parts above and below the plane that cuts a part, by the heights of its corners above it.
    fn halves(&self, part: &[Corner], heights: &[f64]) -> [Vec<Corner>; 2] {
        let mut halves = [Vec::with_capacity(part.len() + 1), Vec::with_capacity(part.len() + 1)];
        for (k, corner) in part.iter().enumerate() {
            let next = (k + 1) % part.len();
            let (here, there) = (heights[k], heights[next]);
            if here >= 0.0 {
                halves[0].push(*corner);
            }
            if here <= 0.0 {
                halves[1].push(*corner);
            }
            if here * there < 0.0 {
                let between = corner.point.lerp(part[next].point, here / (here - there));
                let between = self.corner(between, corner.packet);
                halves.iter_mut().for_each(|half| half.push(between));
            }
        }
        halves
    }

    /// Heights of the corners above the plane that cuts a part, 0 for those on it: that through the side
    /// of `face` beyond which the corner lies that is farthest `away` from it, else the one halfway
    /// between that corner and the nearest.
    fn heights(&self, part: &[Corner], face: FaceId, away: &[f64]) -> Vec<f64> {
        let by_distance = |&i: &usize, &j: &usize| away[i].total_cmp(&away[j]);
        let far = (0..part.len()).max_by(by_distance).unwrap_or(0);
        let near = (0..part.len()).min_by(by_distance).unwrap_or(0);
        let (from, to) = (part[near].point, part[far].point);
        let least = ON_PLANE * from.distance(to);
        let above = |(origin, normal): (DVec3, DVec3)| -> Vec<f64> {
            let height = |c: &Corner| normal.dot(c.point - origin);
            part.iter().map(height).map(|h| if h.abs() <= least { 0.0 } else { h }).collect()
        };
        let [p, q, r] = self.tree.mesh.corners(face);
        let normal = triangle_cross([p, q, r]);
        let outward = |(a, b): (DVec3, DVec3)| Some((a, (b - a).cross(normal).try_normalize()?));
        let beyond = |heights: &Vec<f64>| heights[far] > 0.0 && heights.iter().any(|&h| h < 0.0);
        let sides = [(p, q), (q, r), (r, p)].into_iter().filter_map(outward).map(above).filter(beyond);
        sides
            .max_by(|a, b| a[far].total_cmp(&b[far]))
            .unwrap_or_else(|| above((from.midpoint(to), (to - from).normalize_or_zero())))
    }
}
