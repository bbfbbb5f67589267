//! Points (taxels, fields) in a tree: the nearest few, and all within a volume.

use glam::DVec3;

use super::{
    frame::Frame,
    tree::{Primitive, Tree, distinct},
};
use crate::{
    contact::geometry::Volume,
    id::{IdVec, VertexId},
};

/// Points of one patch, in m in the frame of its link.
#[derive(Debug, Clone)]
pub(in crate::contact) struct PointTree {
    points: IdVec<VertexId, DVec3>,
    tree: Option<Tree>,
    frame: Frame,
}

impl PointTree {
    /// A tree over finite points; there may be none.
    pub(in crate::contact) fn new(points: &IdVec<VertexId, DVec3>) -> Self {
        let frame = Frame::around(points.iter().copied());
        let at = |id: u32| frame.point(points[VertexId::from(id)]);
        let primitive = |id: u32| Primitive { centre: at(id), area: DVec3::ZERO };
        let tree = (!points.is_empty()).then(|| {
            let primitives: Vec<_> = points.ids().map(|v| primitive(v.raw())).collect();
            let mut tree = Tree::new(&primitives);
            tree.fit(primitive, |id| [at(id)]);
            tree
        });
        Self { points: points.clone(), tree, frame }
    }

    /// Appends the `k` points nearest to `q`, none farther than `reach` (m, infinite for no limit),
    /// with their distances in m, the nearest first; of equally near ones the first.
    pub(in crate::contact) fn nearest(
        &self,
        q: DVec3,
        k: usize,
        reach: f64,
        found: &mut Vec<(VertexId, f64)>,
    ) {
        let Some(point) = Volume::sphere(q, 0.0).filter(|_| k > 0) else { return };
        let Some(tree) = &self.tree else { return };
        let (centre, sides) = self.frame.core(&point);
        let first = found.len();
        tree.walk(
            reach * self.frame.scale,
            |node| node.gaps(centre, &sides),
            |packet| {
                for vertex in distinct(packet).map(VertexId::from) {
                    let distance = self.points[vertex].distance(q);
                    let entry = (vertex, distance);
                    let before = |a: &(VertexId, f64)| (a.1, a.0) < (distance, vertex);
                    if distance <= reach {
                        let place = first + found[first..].partition_point(before);
                        if place < first + k {
                            found.truncate(first + k - 1);
                            found.insert(place, entry);
                        }
                    }
                }
                let worst = if found.len() == first + k { found[first + k - 1].1 } else { reach };
                worst * self.frame.scale
            },
        );
    }

    /// Appends every point in a volume (m, in the link's frame) with its distance from the volume's
    /// core, in m; in the order of the points.
    pub(in crate::contact) fn within(&self, volume: &Volume, found: &mut Vec<(VertexId, f64)>) {
        let Some(tree) = &self.tree else { return };
        let before = found.len();
        let (centre, sides) = self.frame.core(volume);
        let bound = volume.radius * self.frame.scale;
        tree.walk(
            bound,
            |node| node.gaps(centre, &sides),
            |packet| {
                for vertex in distinct(packet).map(VertexId::from) {
                    let distance = volume.distance_to_point(self.points[vertex]);
                    if distance <= volume.radius {
                        found.push((vertex, distance));
                    }
                }
                bound
            },
        );
        found[before..].sort_unstable_by_key(|&(vertex, _)| vertex);
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;
    use proptest::prelude::*;

    use super::*;
    use crate::contact::soup;

    proptest! {
        #![proptest_config(soup::fixed(300, 34))]

        #[test]
        fn nearest_and_contained_points_are_those_of_brute_force(
            points in prop::collection::vec(prop::array::uniform3(-1.0_f64..1.0), 0..300),
            copies in 0_usize..100,
            q in prop::array::uniform3(-2.0_f64..2.0),
            half in prop::array::uniform3(0.0_f64..0.4),
            k in 0_usize..20,
            reach in prop_oneof![2 => Just(f64::INFINITY), 1 => Just(0.3)],
        ) {
            let mut points: IdVec<VertexId, DVec3> = points.into_iter().map(DVec3::from).collect();
            for _ in 0..copies {
                points.push(DVec3::ONE * 0.5);
            }
            let (tree, q) = (PointTree::new(&points), DVec3::from(q));
            let mut expected: Vec<_> = points.enumerate().map(|(v, p)| (v, p.distance(q))).collect();
            expected.retain(|&(_, distance)| distance <= reach);
            expected.sort_by(|a, b| (a.1, a.0).partial_cmp(&(b.1, b.0)).unwrap());
            expected.truncate(k);
            let mut found = Vec::new();
            tree.nearest(q, k, reach, &mut found);
            prop_assert_eq!(&found, &expected);

            let turn = DQuat::from_scaled_axis(q);
            for volume in [Volume::sphere(q, 0.8), Volume::capsule([q, DVec3::ZERO], 0.2), Volume::cuboid(q * 0.5, turn, DVec3::from(half))] {
                let volume = volume.unwrap();
                let all = points.enumerate().map(|(v, p)| (v, volume.distance_to_point(*p)));
                let expected: Vec<_> = all.filter(|&(_, distance)| distance <= volume.radius).collect();
                found.clear();
                tree.within(&volume, &mut found);
                prop_assert_eq!(&found, &expected);
            }
        }
    }
}
