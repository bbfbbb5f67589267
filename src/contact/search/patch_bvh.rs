//! Level 0 of one patch with its tree, in the frame of its link.

use glam::DVec3;
use obvhs::aabb::Aabb;

use super::{
    bvh8::{Bvh8, MAX_FACES, enclose},
    frame::Frame,
    rounding::{LARGEST, slack},
};
use crate::{
    contact::ContactError,
    id::{FaceId, IdVec, VertexId},
    mesh::{Closest, TriMesh, VertexCorners, closest_point},
};

#[derive(Debug, Clone)]
pub(crate) struct PatchBvh {
    pub(crate) mesh: TriMesh,
    pub(crate) corners: VertexCorners,
    pub(super) tree: Bvh8,
    pub(super) frame: Frame,
}

impl PatchBvh {
    pub(crate) fn new(patch: &str, mesh: &TriMesh) -> Result<Self, ContactError> {
        let name = || patch.to_owned();
        let faces = mesh.triangles.len();
        if faces > MAX_FACES {
            return Err(ContactError::TooManyFaces {
                patch: name(),
                faces,
                last: FaceId::new(MAX_FACES - 1),
            });
        }
        check(patch, &mesh.positions)?;
        if faces == 0 {
            return Err(ContactError::NoSkin);
        }
        let frame = Frame::around(used(mesh));
        let triangles: IdVec<FaceId, _> =
            mesh.triangles.ids().map(|f| mesh.corners(f).map(|p| frame.point(p))).collect();
        let tree = Bvh8::new(&triangles);
        Ok(Self {
            corners: VertexCorners::new(mesh.triangles.iter().copied(), mesh.positions.len()),
            mesh: mesh.clone(),
            tree,
            frame,
        })
    }

    /// Moves the vertices, one position (m, in the link's frame) per vertex of the mesh, and fits the
    /// tree to them: the faces stay in the boxes they are in, which is cheaper than a new tree, and
    /// as fast to search as long as neighbours stay neighbours.
    ///
    /// # Errors
    /// If a coordinate is too large or not a number; then nothing has moved.
    ///
    /// # Panics
    /// If there is not one position per vertex.
    pub(in crate::contact) fn refit(
        &mut self,
        patch: &str,
        positions: &IdVec<VertexId, DVec3>,
    ) -> Result<(), ContactError> {
        check(patch, positions)?;
        self.mesh.positions.as_mut_slice().copy_from_slice(positions.as_slice());
        let (mesh, frame) = (&self.mesh, Frame::around(used(&self.mesh)));
        self.frame = frame;
        self.tree.refit(|face| mesh.corners(face).map(|p| frame.point(p)));
        Ok(())
    }

    /// A distance, in m, that no face is nearer to `q` (m, the link's frame): that to the patch's
    /// box, less what rounding may have added to it.
    pub(crate) fn least_distance(&self, q: DVec3) -> f64 {
        let (lo, hi) = self.frame.bounds;
        q.distance(q.clamp(lo, hi)) - slack(q.distance(self.frame.origin), self.frame.radius())
    }

    /// The nearest point of one face, measured on the vertices of the map.
    #[inline]
    pub(crate) fn measure(&self, q: DVec3, face: FaceId) -> Closest {
        closest_point(q, self.mesh.corners(face), self.mesh.triangles[face])
    }

    /// The corners of the patch's box moved by `place`, as a box.
    pub(crate) fn posed_box(&self, place: impl Fn(DVec3) -> DVec3) -> Aabb {
        let (lo, hi) = self.frame.bounds;
        enclose((0..8).map(|k| {
            let pick = |bit: usize, lo: f64, hi: f64| if k >> bit & 1 == 0 { lo } else { hi };
            place(DVec3::new(pick(0, lo.x, hi.x), pick(1, lo.y, hi.y), pick(2, lo.z, hi.z)))
        }))
    }
}

/// The corners of all faces.
fn used(mesh: &TriMesh) -> impl Iterator<Item = DVec3> + Clone + '_ {
    mesh.triangles.iter().flatten().map(|&v| mesh.positions[v])
}

fn check(patch: &str, positions: &IdVec<VertexId, DVec3>) -> Result<(), ContactError> {
    // Also true for NaN.
    let far = |p: &DVec3| !(p.is_finite() && p.abs().max_element() <= LARGEST);
    let Some((vertex, position)) = positions.enumerate().find(|(_, p)| far(p)) else { return Ok(()) };
    Err(ContactError::TooLarge { patch: patch.to_owned(), vertex, position: position.to_array() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        contact::search::{Best, Search},
        mesh::shapes,
        skin::PatchId,
    };

    /// A sheet rolled up: the tree of the sheet, fitted to the roll, answers as a tree of the roll.
    #[test]
    fn a_refitted_tree_answers_as_a_new_one() {
        let sheet = shapes::lattice(40, 30, 0.01);
        let rolled = TriMesh {
            positions: sheet.positions.map(|p| DVec3::new((8.0 * p.x).sin(), p.y + 7.0, (8.0 * p.x).cos())),
            ..sheet.clone()
        };
        let mut fitted = PatchBvh::new("sheet", &sheet).unwrap();
        fitted.refit("sheet", &rolled.positions).unwrap();
        let new = PatchBvh::new("roll", &rolled).unwrap();
        for k in 0..500 {
            let q = rolled.positions[VertexId::new(k)] * (1.0 + 0.01 * f64::from(k as u32 % 7))
                - DVec3::X * 0.003;
            let ask = |patch: &PatchBvh| {
                let mut best: Option<Best> = None;
                Search::new(patch, PatchId::new(0), q).run(&mut best);
                best.map(|b| (b.face, b.closest))
            };
            assert_eq!(ask(&fitted), ask(&new), "from {q}");
        }
        let mut broken = rolled.positions.clone();
        broken[VertexId::new(3)].y = f64::NAN;
        assert!(matches!(fitted.refit("sheet", &broken), Err(ContactError::TooLarge { .. })));
        assert_eq!(fitted.mesh.positions, rolled.positions, "nothing has moved");
    }
}
