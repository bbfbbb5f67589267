//! All faces within a sphere.

use glam::DVec3;

use super::{
    descent::{Descent, Visitor},
    lanes::{Kernel, LANES, Lanes},
    patch_bvh::PatchBvh,
    rounding::{FAR, FAR_ROUND_UP, slack, squared_bound_f32},
};
use crate::{id::FaceId, mesh::Closest};

impl PatchBvh {
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
        let squared = self.patch.triangles[packet].distance_squared(l, point);
        let within = l.le(squared, l.splat(*bound));
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
    use glam::DVec3;
    use proptest::prelude::*;

    use super::*;
    use crate::contact::soup;

    proptest! {
        #![proptest_config(soup::fixed(300, 32))]

        #[test]
        fn faces_around_are_those_of_brute_force(
            triangles in soup::triangles(1..80),
            a in prop::array::uniform3(-1.0_f64..1.0),
            radius in prop_oneof![Just(0.0), Just(0.1), Just(0.7), Just(1e9)],
        ) {
            let mesh = soup::mesh(&triangles);
            let a = DVec3::from(a);
            let patch = PatchBvh::new("patch", &mesh).unwrap();
            for q in [a, triangles[0][0], a * 1e4, a * 1e11] {
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
