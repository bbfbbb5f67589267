//! All faces within a sphere, a capsule or a box.

use super::patch_bvh::PatchBvh;
use crate::{contact::geometry::Volume, id::FaceId};

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
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};
    use proptest::prelude::*;

    use super::*;
    use crate::contact::soup;

    proptest! {
        #![proptest_config(soup::fixed(300, 32))]

        #[test]
        fn faces_within_are_those_of_brute_force(
            triangles in prop::collection::vec(soup::triangle(), 1..80),
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
        }
    }
}
