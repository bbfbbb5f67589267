//! Which patches may be nearest to a point of the world: a tree over the boxes of all patches as
//! they are posed.

use glam::DVec3;

use super::{
    boxes::Aabb,
    fit::{Points, put},
    frame::Frame,
    lanes::Simd,
    tree::{Primitive, Tree, distinct},
};
use crate::skin::PatchId;

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

/// Distances to boxes are compared with bounds enlarged by this: some hundred roundings, of numbers
/// as large as the coordinates.
const MARGIN: f64 = 1e-14;

impl PosedBoxes {
    /// Takes the boxes as they are now, `posed(patch)` for each patch; without allocation where it
    /// took as many before and they are few.
    pub(crate) fn update(&mut self, patches: usize, posed: impl Fn(PatchId) -> Aabb) {
        self.boxes.clear();
        self.boxes.extend((0..patches).map(|p| posed(PatchId::new(p))));
        let boxes = &self.boxes;
        self.tree = (patches > FEW).then(|| {
            let frame = Frame::around(boxes.iter().flat_map(|b| [b.lo, b.hi]));
            let at = |id: u32| boxes[id as usize];
            // Boxes have no direction in which they are thin.
            let primitive =
                |id: u32| Primitive { centre: frame.point(at(id).lo.midpoint(at(id).hi)), area: DVec3::ZERO };
            #[expect(clippy::cast_possible_truncation, reason = "patches have ids of 32 bits")]
            let mut tree = Tree::new(&(0..patches as u32).map(primitive).collect::<Vec<_>>());
            let ends = |id: u32| [at(id).lo, at(id).hi].map(|p| frame.point(p));
            tree.fit(Simd::detect(), |_, ids, points: &mut Points<2>| {
                ids.iter().enumerate().for_each(|(lane, &id)| put(points, lane, ends(id)));
                DVec3::ZERO
            });
            (tree, frame)
        });
    }

    /// Calls `visit(patch)` for every patch that may be nearer to `q` (m, in the world) than the
    /// distance `visit` returned last, in m; the one with the nearest box first.
    pub(crate) fn each_within(&self, q: DVec3, distance: f64, mut visit: impl FnMut(PatchId) -> f64) {
        if let [_] = self.boxes.as_slice() {
            visit(PatchId::new(0));
            return;
        }
        let away = |b: &Aabb| q.distance(q.clamp(b.lo, b.hi)) * (1.0 - MARGIN) - MARGIN * q.length();
        let mut reach = distance;
        let Some((tree, frame)) = &self.tree else {
            let mut keys = [f64::INFINITY; FEW];
            let (mut first, mut least) = (0, f64::INFINITY);
            for (id, (key, b)) in keys.iter_mut().zip(&self.boxes).enumerate() {
                *key = away(b);
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
            reach * frame.scale,
            |node| node.gaps(centre, &[DVec3::ZERO; 3]),
            |packet| {
                let mut order = [(f64::INFINITY, 0); 8];
                for (slot, id) in order.iter_mut().zip(distinct(packet)) {
                    *slot = (away(&self.boxes[id as usize]), id);
                }
                order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
                for &(key, id) in &order {
                    // Empty slots are infinitely far.
                    if key <= reach && key < f64::INFINITY {
                        reach = visit(PatchId::from(id));
                    }
                }
                reach * frame.scale
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
}
