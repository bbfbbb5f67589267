//! Which patches may be nearest to a point of the world: the boxes of all patches as they are
//! posed.

use glam::DVec3;
use obvhs::aabb::Aabb;
use wide::f32x8;

use super::{
    bvh8::Node8,
    lanes::{LANES, lanes, least_lane, splat},
    rounding::{slack, squared_bound_f32},
};
use crate::skin::PatchId;

/// The boxes of all patches as the robot is posed now, in the world.
///
/// Robots have tens of patches: eight boxes at a time are compared faster than a tree is walked.
#[derive(Debug, Clone, Default)]
pub(crate) struct PosedBoxes {
    rows: Vec<Node8>,
    /// What the boxes are relative to, in m.
    origin: DVec3,
    /// Largest distance of a box from the origin, in m.
    radius: f64,
}

impl PosedBoxes {
    /// `posed(patch, origin)`: the box of a patch relative to `origin`.
    pub(crate) fn new(patches: usize, posed: impl Fn(PatchId, DVec3) -> Aabb) -> Self {
        let around = |origin| (0..patches).map(move |p| (PatchId::new(p), origin));
        let all = around(DVec3::ZERO).map(|(p, o)| posed(p, o)).reduce(|a, b| a.union(&b));
        let origin = all.map_or(DVec3::ZERO, |b| b.center().as_dvec3());
        let boxes: Vec<Aabb> = around(origin).map(|(p, o)| posed(p, o)).collect();
        let reach = |b: &Aabb| f64::from(b.min.abs().max(b.max.abs()).length());
        let radius = boxes.iter().map(reach).fold(0.0, f64::max);
        Self { rows: Node8::rows(&boxes), origin, radius }
    }

    /// Calls `visit(patch, distance)` for every patch that may be nearer to `q` (m, in the world)
    /// than the distance `visit` returned last, in m; the one with the nearest box first.
    pub(crate) fn each_within(&self, q: DVec3, distance: f64, mut visit: impl FnMut(PatchId) -> f64) {
        let local = q - self.origin;
        let slack = slack(local.length(), self.radius);
        let wide = splat(local.as_vec3());
        let patch = |row: usize, lane: usize| PatchId::new(row * LANES + lane);
        let mut nearest = (f32::INFINITY, 0, 0);
        for (row, node) in self.rows.iter().enumerate() {
            let squared = node.distance_squared(&wide);
            let lane = least_lane(squared);
            let squared = squared.as_array()[lane];
            if squared < nearest.0 {
                nearest = (squared, row, lane);
            }
        }
        let mut bound = squared_bound_f32(distance, slack);
        let (squared, first_row, first_lane) = nearest;
        if squared <= bound {
            bound = squared_bound_f32(visit(patch(first_row, first_lane)), slack);
        }
        for (row, node) in self.rows.iter().enumerate() {
            let squared = node.distance_squared(&wide);
            // Empty slots are infinitely far.
            let mut mask = squared.simd_le(f32x8::splat(bound)).to_bitmask();
            if row == first_row {
                mask &= !(1 << first_lane);
            }
            for lane in lanes(mask) {
                if squared.as_array()[lane] <= bound {
                    bound = squared_bound_f32(visit(patch(row, lane)), slack);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::search::bvh8::enclose;

    /// Unit cubes in a row, three apart, far from the origin: more than fit into one node.
    #[test]
    fn all_patches_within_the_distance_are_visited_the_nearest_first() {
        let corner = |patch: PatchId| DVec3::new(1e6 + 3.0 * patch.index() as f64, 0.0, 0.0);
        let boxes = PosedBoxes::new(20, |patch, origin| {
            enclose([corner(patch) - origin, corner(patch) + DVec3::ONE - origin])
        });
        let q = corner(PatchId::new(11)) + DVec3::new(0.5, 0.5, 2.0);
        let mut visited = Vec::new();
        boxes.each_within(q, f64::INFINITY, |patch| {
            visited.push(patch.index());
            4.0
        });
        assert_eq!(visited[0], 11, "its box is nearest");
        visited.sort_unstable();
        assert_eq!(visited, [10, 11, 12], "boxes within 4 m");
        boxes.each_within(q, 0.5, |patch| unreachable!("{patch} is 1 m away"));
    }
}
