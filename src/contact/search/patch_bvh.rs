//! Level 0 of one patch with its tree, in the frame of its link.

use glam::DVec3;
use obvhs::aabb::Aabb;

use super::{
    bvh8::{Bvh8, MAX_FACES, enclose},
    rounding::{LARGEST, slack},
};
use crate::{
    contact::ContactError,
    id::{FaceId, IdVec},
    mesh::{Closest, TriMesh, VertexCorners, closest_point},
};

#[derive(Debug, Clone)]
pub(crate) struct PatchBvh {
    pub(crate) mesh: TriMesh,
    pub(crate) corners: VertexCorners,
    pub(super) tree: Bvh8,
    /// Centre of the patch's box, in m.
    pub(super) origin: DVec3,
    /// What makes metres into the units of the tree, in which the patch's radius is between 1/2 and
    /// 1: a power of two, so that it rounds nothing.
    pub(super) scale: f64,
    /// The patch's box in the link's frame, `(min, max)` in m.
    pub(super) bounds: (DVec3, DVec3),
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
        let far = mesh.positions.enumerate().find(|(_, p)| p.abs().max_element() > LARGEST);
        if let Some((vertex, position)) = far {
            return Err(ContactError::TooLarge { patch: name(), vertex, position: position.to_array() });
        }
        let used = || mesh.triangles.ids().flat_map(|f| mesh.corners(f));
        let bounds =
            used().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)));
        if faces == 0 {
            return Err(ContactError::NoSkin);
        }
        let origin = bounds.0.midpoint(bounds.1);
        let radius = used().map(|p| p.distance(origin)).fold(0.0, f64::max);
        let scale = unit_scale(radius);
        let triangles: IdVec<FaceId, _> =
            mesh.triangles.ids().map(|f| mesh.corners(f).map(|p| (p - origin) * scale)).collect();
        let tree = Bvh8::new(&triangles);
        Ok(Self {
            corners: VertexCorners::new(mesh.triangles.iter().copied(), mesh.positions.len()),
            mesh: mesh.clone(),
            tree,
            origin,
            scale,
            bounds,
        })
    }

    /// A distance, in m, that no face is nearer to `q` (m, the link's frame): that to the patch's
    /// box, less what rounding may have added to it.
    pub(crate) fn least_distance(&self, q: DVec3) -> f64 {
        let (lo, hi) = self.bounds;
        let radius = 1.0 / self.scale;
        q.distance(q.clamp(lo, hi)) - slack(q.distance(self.origin), radius)
    }

    /// The nearest point of one face, measured on the vertices of the map.
    #[inline]
    pub(crate) fn measure(&self, q: DVec3, face: FaceId) -> Closest {
        closest_point(q, self.mesh.corners(face), self.mesh.triangles[face])
    }

    /// The corners of the patch's box moved by `place`, as a box.
    pub(crate) fn posed_box(&self, place: impl Fn(DVec3) -> DVec3) -> Aabb {
        let (lo, hi) = self.bounds;
        enclose((0..8).map(|k| {
            let pick = |bit: usize, lo: f64, hi: f64| if k >> bit & 1 == 0 { lo } else { hi };
            place(DVec3::new(pick(0, lo.x, hi.x), pick(1, lo.y, hi.y), pick(2, lo.z, hi.z)))
        }))
    }
}

/// The power of two that brings `radius` between 1/2 and 1; 1 for a point.
fn unit_scale(radius: f64) -> f64 {
    /// `f64` has no powers of two beyond; a smaller patch is a point for every purpose.
    const LEAST_EXPONENT: f64 = -1000.0;
    if radius > 0.0 { (-(radius.log2().ceil().max(LEAST_EXPONENT))).exp2() } else { 1.0 }
}
