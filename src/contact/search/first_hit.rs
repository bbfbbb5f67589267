//! The first face that a ray meets.

use glam::DVec3;

use super::patch_bvh::PatchBvh;
use crate::{
    bvh::{Meeting, Ray, meet},
    id::FaceId,
};

/// Where a ray meets a face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::contact) struct RayHit {
    pub(in crate::contact) face: FaceId,
    /// From the ray's origin, in m.
    pub(in crate::contact) distance: f64,
    pub(in crate::contact) barycentric: [f64; 3],
}

impl PatchBvh {
    /// The first face that a ray (m, in the link's frame) meets from either side; of equally far
    /// ones the first. Rays start at distance zero and leave no gap between faces that share a
    /// side. A triangle without area is never met.
    pub(in crate::contact) fn first_hit(&self, ray: &Ray) -> Option<RayHit> {
        let (near, start) = self.frame.nearby(ray);
        let local = self.frame.ray(&near);
        let mut best: Option<RayHit> = None;
        self.tree.walk(
            local.longest,
            |node| node.entries(&local),
            |packet| {
                for face in self.faces(packet) {
                    if let Some(hit) = hit_face(&near, start, face, self.mesh.corners(face)) {
                        offer(&mut best, hit);
                    }
                }
                best.map_or(local.longest, |hit| (hit.distance - start) * self.frame.scale)
            },
        );
        best
    }
}

fn hit_face(ray: &Ray, start: f64, face: FaceId, corners: [DVec3; 3]) -> Option<RayHit> {
    let Meeting { along, barycentric } = meet(ray.origin, ray.direction, corners)?;
    (along >= 0.0 && along <= ray.longest).then_some(RayHit { face, distance: start + along, barycentric })
}

fn offer(best: &mut Option<RayHit>, hit: RayHit) {
    let nearer =
        |old: &RayHit| hit.distance < old.distance || (hit.distance == old.distance && hit.face < old.face);
    if best.as_ref().is_none_or(nearer) {
        *best = Some(hit);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{
        contact::soup,
        mesh::{TriMesh, shapes},
    };

    fn assert_first(mesh: &TriMesh, ray: &Ray) {
        let patch = PatchBvh::new("patch", mesh).unwrap();
        let (near, start) = patch.frame.nearby(ray);
        let mut expected = None;
        for face in mesh.triangles.ids() {
            if let Some(hit) = hit_face(&near, start, face, mesh.corners(face)) {
                offer(&mut expected, hit);
            }
        }
        assert_eq!(patch.first_hit(ray), expected, "{ray:?}");
    }

    #[test]
    fn a_ray_hits_from_any_distance() {
        let mesh = shapes::cap(2000, 0.1, 1.2);
        let patch = PatchBvh::new("patch", &mesh).unwrap();
        for (away, tolerance) in [(1e-9, 1e-15), (1e-5, 1e-12), (1.0, 1e-12), (1e9, 1e-6)] {
            let origin = DVec3::new(0.0, 0.0, -0.1 - away);
            let hit = patch.first_hit(&Ray::new(origin, DVec3::Z, f64::INFINITY).unwrap()).unwrap();
            assert!((hit.distance - away).abs() <= tolerance, "{} from {away} m", hit.distance);
            assert_eq!(patch.first_hit(&Ray::new(origin, -DVec3::Z, f64::INFINITY).unwrap()), None);
            assert_eq!(patch.first_hit(&Ray::new(origin, DVec3::Z, 0.5 * away).unwrap()), None);
        }
    }

    /// Rays from inside of a closed surface at its vertices and sides never slip through it.
    #[test]
    fn a_closed_surface_has_no_gap() {
        let mesh = shapes::torus(24, 12, 1.0, 0.3);
        let patch = PatchBvh::new("patch", &mesh).unwrap();
        for p in &mesh.positions {
            for q in mesh.positions.iter().step_by(17) {
                let inside = DVec3::new(1.01, 0.02, 0.03);
                for target in [*p, p.midpoint(*q)] {
                    let ray = Ray::new(inside, target - inside, f64::INFINITY).unwrap();
                    assert!(patch.first_hit(&ray).is_some(), "slips past {target}");
                }
            }
        }
    }

    proptest! {
        #![proptest_config(soup::fixed(300, 31))]

        #[test]
        fn the_first_hit_is_that_of_brute_force(
            triangles in soup::triangles(1..80),
            from in prop::array::uniform3(-1.5_f64..1.5),
            weights in prop::array::uniform3(0.0_f64..1.0),
            away in prop_oneof![Just(1.0), Just(1e3), Just(1e7)],
            flat in prop::bool::ANY,
            longest in prop_oneof![3 => Just(f64::INFINITY), 1 => Just(1.0)],
        ) {
            let mesh = soup::mesh(&triangles);
            let [a, b, c] = triangles[0];
            let target = (a * weights[0] + b * weights[1] + c * weights[2]) / weights.iter().sum::<f64>().max(1e-9);
            let from = DVec3::from(from) * away;
            // Also along an axis, where boxes have no thickness to divide by.
            let direction = if flat { DVec3::X } else { target - from };
            prop_assume!(direction != DVec3::ZERO);
            assert_first(&mesh, &Ray::new(from, direction, longest).unwrap());
        }
    }
}
