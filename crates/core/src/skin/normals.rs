//! Normals and tangents of taxels: which of the file's normals are reliable, and the
//! x axes of the taxels' frames in the tangent planes.
//!
//! *Heuristic*: thresholds were chosen on real covers and on placeholders that vendors write.
//! Shared by assembling, checking, triangulating, reading and mapping.

use glam::DVec3;

use crate::id::{IdVec, VertexId};
use crate::mesh::TriMesh;
use crate::skin::UnreliableNormals;

/// A normal is a unit vector if its length is this close to 1: tables print three digits.
const NORMAL_LENGTH_TOLERANCE: f64 = 0.01;

/// Normals within about 0.1 degrees of each other are the same.
pub(super) const SAME_DIRECTION: f64 = 1.0 - 1e-6;

/// A component is flat if the area-weighted mean of its unit face normals is this long; on a spherical cap of
/// 23 degrees across it is 0.99.
const FLAT_MEAN_NORMAL: f64 = 0.99;

/// Normals determine the outside if the absolute value of their mean cosine with the faces, weighted by area,
/// is this large. Real covers reach 0.97, placeholders on closed surfaces 0.
const AGREEMENT: f64 = 0.5;

pub(super) fn is_unit(n: DVec3) -> bool {
    // False for NaN as well.
    (n.length() - 1.0).abs() <= NORMAL_LENGTH_TOLERANCE
}

/// How reliable the normals of the taxels of one component are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NormalQuality {
    /// They determine the outside: the faces are wound with them.
    Outward,
    /// They determine the outside: the faces are wound against them.
    Inward,
    /// They are not used.
    Unreliable(UnreliableNormals),
}

/// How well the normals of the taxels of one component agree with its faces, added up face by face.
#[derive(Debug, Clone, Default)]
pub(super) struct NormalConsensus {
    /// Twice the area.
    area: f64,
    /// Twice the vector area; its length is twice the area on a flat component.
    direction: DVec3,
    /// Cosines between faces and the normals of their corners, weighted by twice the area.
    agreement: f64,
    /// The value of `agreement` if all cosines were 1.
    weight: f64,
    corners: usize,
    unit_corners: usize,
    first: Option<DVec3>,
    differs: bool,
}

impl NormalConsensus {
    /// The consensus of a component and the normals of its taxels.
    pub(super) fn of(mesh: &TriMesh, normals: &IdVec<VertexId, DVec3>) -> Self {
        let mut this = Self::default();
        for (corners, cross) in mesh.triangles.iter().zip(mesh.face_crosses()) {
            this.add(cross, corners.map(|v| normals[v]));
        }
        this
    }

    /// Adds a face with vector `cross` (twice its area) and the normals of its corners; zero where
    /// there is none.
    pub(super) fn add(&mut self, cross: DVec3, normals: [DVec3; 3]) {
        let area = cross.length();
        self.area += area;
        self.direction += cross;
        for n in normals {
            self.corners += 1;
            if n == DVec3::ZERO {
                continue;
            }
            self.unit_corners += 1;
            self.agreement += cross.dot(n);
            self.weight += area;
            let first = *self.first.get_or_insert(n);
            self.differs |= first.dot(n) < SAME_DIRECTION;
        }
    }

    pub(super) fn quality(&self) -> NormalQuality {
        if 2 * self.unit_corners < self.corners {
            NormalQuality::Unreliable(UnreliableNormals::NotUnit)
        } else if !self.differs && self.direction.length() < FLAT_MEAN_NORMAL * self.area {
            NormalQuality::Unreliable(UnreliableNormals::Constant)
        } else if self.agreement >= AGREEMENT * self.weight {
            NormalQuality::Outward
        } else if self.agreement <= -AGREEMENT * self.weight {
            NormalQuality::Inward
        } else {
            NormalQuality::Unreliable(UnreliableNormals::Unrelated)
        }
    }
}

/// Unit normals, or tangents, of the taxels: the mean of the unit vectors of all file vertices of a taxel,
/// zero where there is none; then those of copies, as in the file.
pub(super) fn mean_directions(
    directions: &[DVec3],
    taxel: &IdVec<VertexId, VertexId>,
    copied: &[VertexId],
) -> IdVec<VertexId, DVec3> {
    let mut sums = IdVec::<VertexId, DVec3>::filled(DVec3::ZERO, taxel.len() + copied.len());
    for ((_, &v), &n) in taxel.enumerate().zip(directions) {
        if is_unit(n) {
            sums[v] += n;
        }
    }
    for (copy, v) in copied.iter().enumerate() {
        let n = directions[v.index()];
        sums[VertexId::new(taxel.len() + copy)] += if is_unit(n) { n } else { DVec3::ZERO };
    }
    sums.map(|n| n.normalize_or_zero())
}

/// A direction less than 0.06 degrees (as a sine) from the normal has no direction in the tangent plane: it
/// would be rounding noise.
const LEAST_SINE: f64 = 1e-3;

/// The unit vector of `direction`, of any length, in the tangent plane of a unit normal; `None` for
/// a direction that is zero or along the normal.
#[doc(hidden)]
pub fn in_tangent_plane(direction: DVec3, normal: DVec3) -> Option<DVec3> {
    let unit = direction.normalize_or_zero();
    let tangent = unit - unit.dot(normal) * normal;
    (tangent.length() > LEAST_SINE).then(|| tangent.normalize())
}

/// Projects directions of any length, one per vertex, to the tangent planes of unit normals, as unit vectors;
/// also returns how many were replaced since they are zero or along the normal.
///
/// The replacement is the mean direction of the neighbours; without one, a direction computed from the normal
/// alone.
pub(crate) fn tangents_along(
    mesh: &TriMesh,
    normals: &IdVec<VertexId, DVec3>,
    directions: &IdVec<VertexId, DVec3>,
) -> (IdVec<VertexId, DVec3>, usize) {
    let found: IdVec<VertexId, Option<DVec3>> =
        directions.enumerate().map(|(v, &direction)| in_tangent_plane(direction, normals[v])).collect();
    let missing = found.iter().filter(|tangent| tangent.is_none()).count();
    let mut around = IdVec::<VertexId, DVec3>::filled(DVec3::ZERO, found.len());
    if missing > 0 {
        for corners in &mesh.triangles {
            let sum: DVec3 = corners.iter().filter_map(|&v| found[v]).sum();
            corners.iter().for_each(|&v| around[v] += sum);
        }
    }
    let tangent = |(v, found): (VertexId, &Option<DVec3>)| {
        let replaced = || in_tangent_plane(around[v], normals[v]);
        found.or_else(replaced).unwrap_or_else(|| normals[v].any_orthonormal_vector())
    };
    (found.enumerate().map(tangent).collect(), missing)
}
