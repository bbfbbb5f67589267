//! Which patches may be nearest to a point of the world: a tree over the boxes of all patches as
//! they are posed.

use glam::DVec3;

use super::{
    boxes::Aabb,
    fit::{Points, put},
    frame::Frame,
    lanes::Simd,
    rounding::FAR_ROUND_UP,
    tree::{Primitive, Tree, distinct},
};
use crate::{contact::geometry::Ray, skin::PatchId};

/// The boxes of all patches as the robot is posed now, in the world.
#[derive(Debug, Clone, Default)]
pub(crate) struct PosedBoxes {
    boxes: Vec<Aabb>,
    /// `None` where there are too few patches for a tree to be worth its walk.
    tree: Option<(Tree, Frame)>,
}

/// Up to this many boxes are compared one by one, which takes about as long as the walk down a tree
/// and needs none to be made anew for every pose.
const FEW: usize = 64;

impl PosedBoxes {
    /// Takes the boxes as they are now, `posed(patch)` for each patch; without allocation where it
    /// took as many before: a tree keeps its shape and is fitted to them.
    pub(crate) fn update(&mut self, patches: usize, posed: impl Fn(PatchId) -> Aabb) {
        let before = self.boxes.len();
        self.boxes.clear();
        self.boxes.extend((0..patches).map(|p| posed(PatchId::new(p))));
        let Self { boxes, tree } = self;
        if patches <= FEW {
            *tree = None;
            return;
        }
        let around = Frame::around(boxes.iter().flat_map(|b| [b.lo, b.hi]));
        let ends = |id: u32| [boxes[id as usize].lo, boxes[id as usize].hi].map(|p| around.point(p));
        // Boxes have no direction in which they are thin.
        let primitive = |id: u32| {
            let [lo, hi] = ends(id);
            Primitive { centre: lo.midpoint(hi), area: DVec3::ZERO }
        };
        let known = tree.take().filter(|_| before == patches);
        #[expect(clippy::cast_possible_truncation, reason = "patches have ids of 32 bits")]
        let new = || Tree::new(&(0..patches as u32).map(primitive).collect::<Vec<_>>());
        let mut fitted = known.map_or_else(new, |(tree, _)| tree);
        fitted.fit(Simd::detect(), |_, ids, points: &mut Points<2>| {
            ids.iter().enumerate().for_each(|(lane, &id)| put(points, lane, ends(id)));
            DVec3::ZERO
        });
        *tree = Some((fitted, around));
    }

    /// Calls `visit(patch)` for every patch that may be nearer to `q` (m, in the world) than the
    /// distance `visit` returned last, in m; the one with the nearest box first.
    pub(crate) fn each_within(&self, q: DVec3, distance: f64, mut visit: impl FnMut(PatchId) -> f64) {
        if let [_] = self.boxes.as_slice() {
            visit(PatchId::new(0));
            return;
        }
        let mut reach = distance;
        let Some((tree, frame)) = &self.tree else {
            let mut keys = [f64::INFINITY; FEW];
            let (mut first, mut least) = (0, f64::INFINITY);
            for (id, (key, b)) in keys.iter_mut().zip(&self.boxes).enumerate() {
                *key = b.least_distance(q);
                if *key < least {
                    (first, least) = (id, *key);
                }
            }
            for id in std::iter::once(first).chain((0..self.boxes.len()).filter(|&id| id != first)) {
                if keys[id] <= reach {
                    reach = visit(PatchId::new(id));
                }
            }
            return;
        };
        let centre = frame.point(q);
        tree.walk(
            reach * frame.scale * FAR_ROUND_UP,
            |node| node.point_gaps(centre),
            |packet| {
                let mut order = [(f64::INFINITY, 0); 8];
                for (slot, id) in order.iter_mut().zip(distinct(packet)) {
                    *slot = (self.boxes[id as usize].least_distance(q), id);
                }
                order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
                for &(key, id) in &order {
                    // Empty slots are infinitely far.
                    if key <= reach && key < f64::INFINITY {
                        reach = visit(PatchId::from(id));
                    }
                }
                reach * frame.scale * FAR_ROUND_UP
            },
        );
    }

    /// Calls `visit(patch)` for every patch whose box a ray (m, in the world) enters before the distance
    /// that `visit` returned last, in m; in no order that matters.
    pub(crate) fn each_along(&self, ray: &Ray, mut visit: impl FnMut(PatchId) -> f64) {
        let mut longest = ray.longest;
        let Some((tree, frame)) = &self.tree else {
            for (id, posed) in self.boxes.iter().enumerate() {
                if posed.is_met(ray, longest) {
                    longest = visit(PatchId::new(id));
                }
            }
            return;
        };
        let (near, skipped) = frame.nearby(ray);
        let local = frame.ray(&near);
        let bound = |longest: f64| (longest - skipped) * frame.scale;
        tree.walk(
            bound(longest),
            |node| node.entries(&local),
            |packet| {
                for id in distinct(packet) {
                    if self.boxes[id as usize].is_met(ray, longest) {
                        longest = visit(PatchId::from(id));
                    }
                }
                bound(longest)
            },
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Unit cubes in a row, three apart, far from the origin: with a tree and without.
    #[test]
    fn all_patches_within_the_distance_are_visited_the_nearest_first() {
        let corner = |patch: PatchId| DVec3::new(1e6 + 3.0 * patch.index() as f64, 0.0, 0.0);
        for patches in [13, 20, 300] {
            let mut boxes = PosedBoxes::default();
            boxes.update(patches, |patch| Aabb::around([corner(patch), corner(patch) + DVec3::ONE]));
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

    /// The same boxes, and rays along the row, across it and beside it, from near and far.
    #[test]
    fn rays_visit_the_boxes_they_meet() {
        for (patches, shift) in [(13, 0.0), (300, 0.0), (300, 5.0)] {
            let corner = |patch: PatchId| DVec3::new(3.0 * patch.index() as f64, shift, 0.0);
            let mut boxes = PosedBoxes::default();
            for posed in [DVec3::ZERO, DVec3::Z] {
                let around =
                    |patch| Aabb::around([corner(patch) + posed, corner(patch) + posed + DVec3::ONE]);
                boxes.update(patches, around);
            }
            let visited = |origin: DVec3, direction: DVec3, longest: f64| {
                let ray = Ray::new(origin + DVec3::Z, direction, longest).unwrap();
                let mut visited = Vec::new();
                boxes.each_along(&ray, |patch| {
                    visited.push(patch.index());
                    longest
                });
                visited.sort_unstable();
                visited
            };
            let (middle, inf) = (DVec3::new(0.5, shift + 0.5, 0.5), f64::INFINITY);
            assert_eq!(visited(middle, DVec3::X, inf).len(), patches);
            assert_eq!(visited(middle - 1e9 * DVec3::X, DVec3::X, inf).len(), patches);
            assert_eq!(visited(middle, -DVec3::X, inf), [0]);
            assert_eq!(visited(middle - DVec3::X, DVec3::X, 7.0), [0, 1, 2]);
            assert_eq!(visited(middle + 9.0 * DVec3::X - DVec3::Y, DVec3::Y, inf), [3]);
            assert_eq!(visited(DVec3::new(6.0, shift, 9.0), -DVec3::Z, inf), [2], "along an edge");
            assert!(visited(middle + 2.0 * DVec3::Y, DVec3::X, inf).is_empty());
        }
    }

    #[test]
    fn boxes_that_move_allocate_nothing() {
        let corner = |patch: PatchId| DVec3::new((0.7 * patch.index() as f64).sin(), 0.1, 0.2);
        let mut boxes = PosedBoxes::default();
        let mut update = |shift: f64| {
            boxes.update(200, |patch| Aabb::around([corner(patch) * shift, corner(patch) + DVec3::ONE]));
        };
        update(1.0);
        assert_eq!(allocation_counter::measure(|| (2..9).for_each(|k| update(f64::from(k)))).count_total, 0);
    }
}
