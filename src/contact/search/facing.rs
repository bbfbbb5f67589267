//! The nearest face among those that a contact can have touched: on one side, or facing one way.

use glam::DVec3;

use super::{nearest::Best, patch_bvh::PatchBvh, rounding::FAR_ROUND_UP};
use crate::skin::PatchId;

/// A side of the skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Where the normals point.
    Outer,
    /// Behind the skin.
    Inner,
}

/// Which faces may be the answer; by default all.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(in crate::contact) struct Facing {
    /// The point must lie on this side of the face's plane, or in the plane.
    pub(in crate::contact) side: Option<Side>,
    /// A unit vector, in the link's frame, and the least cosine between it and the normal of the
    /// face.
    pub(in crate::contact) normal: Option<(DVec3, f64)>,
}

impl Facing {
    /// Whether every face may be the answer.
    pub(in crate::contact) fn is_any(&self) -> bool {
        self.side.is_none() && self.normal.is_none()
    }

    /// Whether a face may be the answer for the point `q`; one without area may not if anything is
    /// asked of its normal.
    fn admits(&self, q: DVec3, [a, b, c]: [DVec3; 3]) -> bool {
        if self.is_any() {
            return true;
        }
        let Some(normal) = (b - a).cross(c - a).try_normalize() else { return false };
        let height = (q - a).dot(normal);
        let on_side = match self.side {
            None => true,
            Some(Side::Outer) => height >= 0.0,
            Some(Side::Inner) => height <= 0.0,
        };
        on_side && self.normal.is_none_or(|(direction, cosine)| normal.dot(direction) >= cosine)
    }
}

impl PatchBvh {
    /// Offers the nearest face to `q` (m, in the link's frame) that `facing` admits, if it is
    /// neither farther than `reach` (m, infinite for no limit) nor than `best`; of equally near
    /// ones the first.
    pub(in crate::contact) fn nearest_facing(
        &self,
        id: PatchId,
        q: DVec3,
        reach: f64,
        facing: &Facing,
        best: &mut Option<Best>,
    ) {
        let local = self.frame.point(q);
        // Squares round below the smallest numbers: `reach` itself is compared with the distance.
        let bound = |best: &Option<Best>| {
            Best::squared(best.as_ref()).sqrt().min(reach) * self.frame.scale * FAR_ROUND_UP
        };
        self.tree.walk(
            bound(best),
            |node| node.point_gaps(local),
            |packet| {
                for face in self.faces(packet) {
                    if facing.admits(q, self.mesh.corners(face)) {
                        let closest = self.measure(q, face);
                        if closest.squared.sqrt() <= reach {
                            Best::offer(best, id, face, closest);
                        }
                    }
                }
                bound(best)
            },
        );
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{contact::soup, mesh::shapes};

    /// Two sheets a millimetre apart, back to back: the side decides which of them was touched.
    #[test]
    fn a_thin_plate_has_two_sides() {
        let sheet = shapes::lattice(8, 8, 0.01);
        let mut mesh = sheet.clone();
        for p in &sheet.positions {
            mesh.positions.push(*p - DVec3::Z * 0.001);
        }
        let count = u32::try_from(sheet.positions.len()).unwrap();
        for [a, b, c] in &sheet.triangles {
            let below = |v: crate::id::VertexId| crate::id::VertexId::from(v.raw() + count);
            mesh.triangles.push([below(*a), below(*c), below(*b)]);
        }
        let patch = PatchBvh::new("plate", &mesh).unwrap();
        let faces = sheet.triangles.len();
        // Pressed in by 0.6 of the plate's thickness: the back is nearer.
        let q = DVec3::new(0.031, 0.027, -0.0006);
        let upward = sheet.face_cross(crate::id::FaceId::from(0)).z > 0.0;
        let ask = |facing: &Facing| {
            let mut best = None;
            patch.nearest_facing(PatchId::new(0), q, 0.01, facing, &mut best);
            best.unwrap().face.index() < faces
        };
        assert!(!ask(&Facing::default()), "the back is nearer");
        let front = if upward { DVec3::Z } else { -DVec3::Z };
        assert!(ask(&Facing { normal: Some((front, 0.5)), side: None }), "the front faces upwards");
        let mut best = None;
        let facing = Facing { side: Some(Side::Outer), normal: None };
        patch.nearest_facing(PatchId::new(0), q, 0.01, &facing, &mut best);
        assert!(best.is_none(), "inside of both");
    }

    proptest! {
        #![proptest_config(soup::fixed(300, 33))]

        #[test]
        fn the_nearest_admitted_face_is_that_of_brute_force(
            triangles in soup::triangles(1..80),
            q in prop::array::uniform3(-2.0_f64..2.0),
            away in prop_oneof![4 => Just(1.0), 1 => Just(1e4), 1 => Just(1e9), 1 => Just(1e11)],
            direction in prop::array::uniform3(-1.0_f64..1.0),
            side in prop_oneof![Just(None), Just(Some(Side::Outer)), Just(Some(Side::Inner))],
            cosine in prop_oneof![Just(None), Just(Some(-0.5)), Just(Some(0.7))],
            reach in prop_oneof![2 => Just(f64::INFINITY), 1 => Just(0.3), 1 => Just(0.0)],
        ) {
            let mesh = soup::mesh(&triangles);
            let patch = PatchBvh::new("patch", &mesh).unwrap();
            let q = DVec3::from(q) * away;
            let direction = DVec3::from(direction).normalize_or(DVec3::X);
            let facing = Facing { side, normal: cosine.map(|c| (direction, c)) };
            let (mut expected, mut found) = (None, None);
            for face in mesh.triangles.ids().filter(|&f| facing.admits(q, mesh.corners(f))) {
                let closest = patch.measure(q, face);
                if closest.squared.sqrt() <= reach {
                    Best::offer(&mut expected, PatchId::new(0), face, closest);
                }
            }
            patch.nearest_facing(PatchId::new(0), q, reach, &facing, &mut found);
            prop_assert_eq!(found.map(|b| (b.face, b.closest)), expected.map(|b| (b.face, b.closest)));
        }
    }
}
