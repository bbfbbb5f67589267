//! [`PatchBvh`]: the mesh of one level of a patch with its tree, in the frame of its link.

use std::hint::black_box;

use glam::DVec3;

use crate::bvh::{Aabb, Nearest, Ray, RayHit, Refitting, Start, TriangleTree};
use crate::contact::ContactError;
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Closest, Feature, TriMesh, VertexCorners, closest_point, is_within_reach};
use crate::skin::PatchId;

#[derive(Debug, Clone)]
pub(crate) struct PatchBvh {
    pub(crate) mesh: TriMesh,
    pub(crate) corners: VertexCorners,
    tree: TriangleTree,
}

/// The nearest face of some patches to a point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Best {
    pub(crate) patch: PatchId,
    pub(crate) face: FaceId,
    pub(crate) closest: Closest,
}

impl Best {
    /// Squared distance of the nearest face known, in m^2.
    #[inline(always)]
    pub(crate) fn squared(best: Option<&Self>) -> f64 {
        match best {
            Some(best) => best.closest.squared,
            None => f64::INFINITY,
        }
    }

    /// A bound without a face: only a face nearer than this distance (m) replaces it.
    pub(crate) fn bound(distance: f64) -> Self {
        let (squared, face) = (distance.max(0.0).powi(2), FaceId::from(u32::MAX));
        let closest = Closest { squared, barycentric: [0.0; 3], feature: Feature::Inside, is_flat: false };
        Self { patch: PatchId::new(0), face, closest }
    }

    /// Whether it is a [bound](Self::bound), not a face.
    pub(crate) fn is_bound(&self) -> bool {
        self.face == FaceId::from(u32::MAX)
    }

    /// Keeps the nearer of the two; of equally near ones the first patch's first face with area.
    #[inline(always)]
    pub(crate) fn offer(best: &mut Option<Self>, patch: PatchId, face: FaceId, closest: Closest) {
        let nearer = match best {
            None => true,
            Some(b) => {
                let (old, new) = (b.closest.squared, closest.squared);
                let key = |closest: &Closest, patch, face| (closest.is_flat, patch, face);
                new < old || (new == old && key(&closest, patch, face) < key(&b.closest, b.patch, b.face))
            }
        };
        if nearer {
            *best = Some(Self { patch, face, closest });
        }
    }
}

impl PatchBvh {
    /// # Errors
    /// If there are too many faces, or a coordinate is too large or not a number. There must be a face.
    pub(crate) fn new(patch: &str, mesh: &TriMesh) -> Result<Self, ContactError> {
        let faces = mesh.triangles.len();
        if faces > TriangleTree::MOST {
            let last = FaceId::new(TriangleTree::MOST - 1);
            return Err(ContactError::TooManyFaces { patch: patch.to_owned(), faces, last });
        }
        check(patch, &mesh.positions)?;
        let tree =
            TriangleTree::new(mesh.positions.as_slice(), corners(mesh)).map_err(|_| ContactError::NoSkin)?;
        let around = VertexCorners::new(mesh.triangles.iter().copied(), mesh.positions.len());
        Ok(Self { mesh: mesh.clone(), corners: around, tree })
    }

    /// Buffers for [`Self::refit`].
    pub(super) fn refitting(&self) -> Refitting {
        self.tree.refitting(self.mesh.positions.len(), corners(&self.mesh))
    }

    /// Moves the vertices, one position (m, in the link's frame; finite, within 1e12) per vertex
    /// of the mesh, and fits the tree to them. Leaves the old positions in `positions`. Nothing is
    /// allocated.
    pub(super) fn refit(&mut self, positions: &mut IdVec<VertexId, DVec3>, refitting: &mut Refitting) {
        debug_assert_eq!(positions.len(), self.mesh.positions.len());
        std::mem::swap(&mut self.mesh.positions, positions);
        self.tree.refit(self.mesh.positions.as_slice(), refitting);
    }

    /// The box of its faces, in m in the link's frame.
    pub(super) fn bounds(&self) -> Aabb {
        self.tree.bounds()
    }

    /// Offers the face nearest to `q` (m, in the link's frame), unless `best` is nearer; of equally near ones
    /// the first. The search begins at `start`; returns the packet of the nearest face if that is in this
    /// patch.
    #[inline(always)]
    pub(crate) fn nearest(
        &self,
        id: PatchId,
        q: DVec3,
        start: Start,
        best: &mut Option<Best>,
    ) -> Option<u32> {
        let (found, packet) = self.tree.nearest(q, start, Search { patch: self, id, q, best: *best });
        *best = found.best;
        packet
    }

    /// Calls `visit` with every face no farther than `radius` from a point (m, in the link's frame), in
    /// no order, and possibly with a few others.
    pub(super) fn each_around(&self, q: DVec3, radius: f64, mut visit: impl FnMut(FaceId)) {
        self.tree.each_around(q, radius, |face| visit(FaceId::from(face)));
    }

    /// The first face that a ray (m, in the link's frame) meets from either side; of equally far ones the
    /// first.
    pub(super) fn first_hit(&self, ray: &Ray) -> Option<RayHit> {
        self.tree.first_hit(ray, |face| self.mesh.corners(FaceId::from(face)))
    }

    /// Walks from a face to neighbours that are nearer to a point (m, in the link's frame), in at most `steps` steps.
    pub(crate) fn walk(&self, q: DVec3, face: FaceId, steps: usize) -> Best {
        /// Most faces around a vertex that are compared.
        const MOST_AROUND: usize = 64;
        let id = PatchId::new(0);
        let mut best = Some(Best { patch: id, face, closest: self.measure(q, face) });
        let mut from = face;
        for _ in 0..steps {
            let Some(Best { face, closest, .. }) = best else { break };
            let ids = self.mesh.triangles[face];
            let (vertex, other) = match closest.feature {
                Feature::Inside => break,
                Feature::Side(side) => (ids[side], Some(ids[(side + 1) % 3])),
                Feature::Corner(corner) => (ids[corner], None),
            };
            let is_across = |&f: &FaceId| other.is_none_or(|other| self.mesh.triangles[f].contains(&other));
            for beside in self.corners.faces(vertex).take(MOST_AROUND).filter(is_across) {
                if beside != face && beside != from {
                    Best::offer(&mut best, id, beside, self.measure(q, beside));
                }
            }
            if best.is_some_and(|best| best.face == face) {
                break;
            }
            from = face;
        }
        best.unwrap_or(Best::bound(f64::INFINITY))
    }

    /// Mean length of the sides of its faces, in m.
    pub(super) fn spacing(&self) -> f64 {
        let around = |[a, b, c]: [DVec3; 3]| a.distance(b) + b.distance(c) + c.distance(a);
        let faces = self.mesh.triangles.ids();
        let count = 3 * faces.len();
        faces.map(|face| around(self.mesh.corners(face))).sum::<f64>() / count as f64
    }

    /// The nearest point of one face, measured on the vertices of the map.
    #[inline(always)]
    pub(crate) fn measure(&self, q: DVec3, face: FaceId) -> Closest {
        closest_point(q, self.mesh.corners(face), self.mesh.triangles[face])
    }
}

/// One search for the face of a patch nearest to a point.
#[derive(Clone, Copy)]
struct Search<'a> {
    patch: &'a PatchBvh,
    id: PatchId,
    q: DVec3,
    best: Option<Best>,
}

impl Nearest for Search<'_> {
    #[inline(always)]
    fn squared(&self) -> f64 {
        Best::squared(self.best.as_ref())
    }

    #[inline(always)]
    fn offer(&mut self, face: u32) -> bool {
        let face = FaceId::from(face);
        Best::offer(&mut self.best, self.id, face, self.patch.measure(self.q, face));
        self.best.is_some_and(|best| best.face == face && best.patch == self.id)
    }

    #[inline(always)]
    fn prefetch(&self, face: u32) {
        black_box(self.patch.mesh.triangles[FaceId::from(face)][0]);
    }
}

fn corners(mesh: &TriMesh) -> impl Iterator<Item = [u32; 3]> + Clone + '_ {
    mesh.triangles.iter().map(|corners| corners.map(VertexId::raw))
}

/// Whether all coordinates are finite and small enough.
pub(super) fn check(patch: &str, positions: &IdVec<VertexId, DVec3>) -> Result<(), ContactError> {
    let far = positions.enumerate().find(|(_, p)| !is_within_reach(**p));
    let Some((vertex, position)) = far else { return Ok(()) };
    Err(ContactError::TooLarge { patch: patch.to_owned(), vertex, position: position.to_array() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    fn nearest(patch: &PatchBvh, q: DVec3) -> Option<(FaceId, Closest)> {
        let mut best: Option<Best> = None;
        patch.nearest(PatchId::new(0), q, Start::Root, &mut best);
        best.map(|b| (b.face, b.closest))
    }

    /// A sheet rolled up: the tree of the sheet, fitted to the roll, answers as a tree of the roll.
    #[test]
    fn a_refitted_tree_answers_as_a_new_one() {
        let sheet = shapes::lattice(40, 30, 0.01);
        let rolled = TriMesh {
            positions: sheet.positions.map(|p| DVec3::new((8.0 * p.x).sin(), p.y + 7.0, (8.0 * p.x).cos())),
            ..sheet.clone()
        };
        let new = PatchBvh::new("roll", &rolled).unwrap();
        let mut fitted = PatchBvh::new("sheet", &sheet).unwrap();
        let (mut positions, mut refitting) = (rolled.positions.clone(), fitted.refitting());
        let allocated = allocation_counter::measure(|| fitted.refit(&mut positions, &mut refitting));
        assert_eq!(allocated.count_total, 0, "a refit allocates nothing");
        assert_eq!(positions, sheet.positions);
        for k in 0..500_u32 {
            let q = rolled.positions[VertexId::from(k)] * (1.0 + 0.01 * f64::from(k % 7)) - DVec3::X * 0.003;
            assert_eq!(nearest(&fitted, q), nearest(&new, q), "from {q}");
        }
    }
}
