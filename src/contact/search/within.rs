//! All faces within a sphere, a capsule or a box.

use arrayvec::ArrayVec;
use glam::DVec3;

use super::{
    descent::{BRANCHES, Branch, Descent, Visitor},
    lanes::{Kernel, LANES, Lanes},
    node8::Child,
    patch_bvh::PatchBvh,
    rounding::{FAR, FAR_ROUND_UP, slack, squared_bound_f32},
};
use crate::{contact::geometry::Volume, id::FaceId, mesh::Closest};

impl PatchBvh {
    /// Appends every face that reaches into a volume (m, in the link's frame) with its distance
    /// from the volume's core, in m; in the order of the faces.
    pub(in crate::contact) fn faces_within(&self, volume: &Volume, found: &mut Vec<(FaceId, f64)>) {
        let before = found.len();
        let (centre, sides) = self.frame.core(volume);
        let bound = volume.radius * self.frame.scale;
        self.tree.walk(
            bound,
            |node| node.gaps(centre, &sides),
            |packet| {
                for face in self.faces(packet) {
                    let distance = volume.distance_to_triangle(self.mesh.corners(face));
                    if distance <= volume.radius {
                        found.push((face, distance));
                    }
                }
                bound
            },
        );
        found[before..].sort_unstable_by_key(|&(face, _)| face);
    }

    /// The lowest boxes that hold every face that reaches into a volume (m, in the link's frame), in at
    /// most [`BRANCHES`] nodes; none if these are all boxes of the root.
    pub(in crate::contact) fn branches_around(&self, volume: &Volume) -> ArrayVec<Branch, BRANCHES> {
        let (centre, sides) = self.frame.core(volume);
        let bound = volume.radius * self.frame.scale;
        let reached = |&node: &u32| {
            let gaps = self.tree.nodes[node as usize].gaps(centre, &sides);
            let lanes = (0..LANES).filter(|&lane| gaps[lane] <= bound).map(|lane| 1 << lane).sum();
            Branch { node, lanes }
        };
        let below = |Branch { node, lanes }: &Branch| {
            let node = &self.tree.nodes[*node as usize];
            let lanes = *lanes;
            (0..LANES).filter(move |lane| lanes >> lane & 1 != 0).map(|lane| node.child(lane))
        };
        let mut nodes = ArrayVec::<u32, BRANCHES>::from_iter([0]);
        loop {
            let branches: ArrayVec<_, BRANCHES> = nodes.iter().map(reached).collect();
            let children = branches.iter().flat_map(below);
            if children.clone().count() > BRANCHES || children.clone().any(Child::is_packet) {
                return if nodes[..] == [0] { ArrayVec::new() } else { branches };
            }
            nodes = children.map(|child| child.0).collect();
        }
    }

    /// Calls `visit` with every face no farther than `radius` from a point (m, in the link's frame), in
    /// no order, and the point of it that is nearest.
    pub(in crate::contact) fn each_around(
        &self,
        q: DVec3,
        radius: f64,
        mut visit: impl FnMut(FaceId, Closest),
    ) {
        let mut offer = |face: FaceId| {
            let closest = self.measure(q, face);
            if closest.squared <= radius * radius {
                visit(face, closest);
            }
        };
        let (local, reach) = (self.frame.point(q), radius * self.frame.scale);
        if local.length() <= FAR {
            return self.simd.run(Around { patch: self, local, reach, offer: &mut offer });
        }
        let bound = reach * FAR_ROUND_UP;
        self.tree.walk(
            bound,
            |node| node.point_gaps(local),
            |packet| {
                self.faces(packet).for_each(&mut offer);
                bound
            },
        );
    }
}

/// The walk to all faces within `reach`, with eight lanes.
struct Around<'a, F> {
    patch: &'a PatchBvh,
    /// The point and the distance in the tree's frame and units.
    local: DVec3,
    reach: f64,
    offer: &'a mut F,
}

impl<F: FnMut(FaceId)> Kernel for Around<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(mut self, l: L) {
        let bound = squared_bound_f32(self.reach, slack(self.local.length(), 1.0));
        Descent::new(l, &self.patch.tree, self.local.as_vec3().to_array(), bound).run(&mut self);
    }
}

impl<L: Lanes, F: FnMut(FaceId)> Visitor<L> for Around<'_, F> {
    /// Offers what is within the bound, which stays as it is.
    #[inline(always)]
    fn visit(&mut self, l: L, point: [f32; 3], packet: usize, bound: &mut f32) {
        let faces = &self.patch.tree.packets[packet];
        let within = match self.patch.triangles.get(packet) {
            Some(triangles) => l.le(triangles.distance_squared(l, point), l.splat(*bound)),
            None => 0xff,
        };
        if within != 0 {
            for lane in 0..LANES {
                let is_repeated = lane > 0 && faces[lane] == faces[lane - 1];
                if within >> lane & 1 != 0 && !is_repeated {
                    (self.offer)(FaceId::from(faces[lane]));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};
    use proptest::prelude::*;

    use super::*;
    use crate::contact::{search::Packing, soup};

    proptest! {
        #![proptest_config(soup::fixed(300, 32))]

        #[test]
        fn faces_within_are_those_of_brute_force(
            triangles in soup::triangles(1..80),
            p in prop::array::uniform2(prop::array::uniform3(-1.0_f64..1.0)),
            half in prop::array::uniform3(prop_oneof![2 => 0.0_f64..0.4, 1 => Just(0.0)]),
            radius in prop_oneof![Just(0.0), Just(0.1), Just(0.7), Just(1e9)],
        ) {
            let mesh = soup::mesh(&triangles);
            let patch = PatchBvh::new("patch", &mesh).unwrap();
            let [a, b] = p.map(DVec3::from);
            for volume in [
                Volume::sphere(a, radius),
                Volume::sphere(triangles[0][0], radius),
                Volume::capsule([a, b], radius),
                Volume::cuboid(a, DQuat::from_scaled_axis(b * 3.0), DVec3::from(half)),
            ] {
                let volume = volume.unwrap();
                let all = mesh.triangles.ids().map(|f| (f, volume.distance_to_triangle(mesh.corners(f))));
                let expected: Vec<_> = all.filter(|&(_, distance)| distance <= volume.radius).collect();
                let mut found = Vec::new();
                patch.faces_within(&volume, &mut found);
                prop_assert_eq!(found, expected);
            }
            for (q, packing) in [(a, Packing::Fast), (triangles[0][0], Packing::Compact), (a * 1e4, Packing::Fast), (a * 1e11, Packing::Fast)] {
                let patch = PatchBvh::packed("patch", &mesh, packing).unwrap();
                let all = mesh.triangles.ids().map(|f| (f, patch.measure(q, f)));
                let expected: Vec<_> = all.filter(|(_, closest)| closest.squared <= radius * radius).collect();
                let mut found = Vec::new();
                patch.each_around(q, radius, |face, closest| found.push((face, closest)));
                found.sort_unstable_by_key(|(face, _)| *face);
                prop_assert_eq!(found, expected, "around {}", q);
            }
        }
    }
}
