use glam::DVec3;

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::{Edges, TriMesh},
};

/// A normal is a unit vector if its length is this close to 1: tables print three digits.
const UNIT_TOLERANCE: f64 = 0.01;

/// Normals within about 0.1 degrees of each other are the same.
pub(super) const SAME_DIRECTION: f64 = 1.0 - 1e-6;

/// A part is flat if the area-weighted mean of its unit face normals is this long; on a spherical cap of 23 degrees
/// across it is 0.99.
const FLAT: f64 = 0.99;

/// Normals tell the outside if, weighted by area, their mean cosine with the faces is this large, one way or the
/// other. Real covers reach 0.97 and placeholders on closed parts 0.
const AGREEMENT: f64 = 0.5;

/// Whether a taxel's normal is a unit vector.
pub(super) fn is_unit(n: DVec3) -> bool {
    // False for NaN as well.
    (n.length() - 1.0).abs() <= UNIT_TOLERANCE
}

/// What the taxels' normals of one piece of skin are worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Worth {
    /// They tell the outside: the faces are wound with them.
    Outward,
    /// They tell the outside: the faces are wound against them.
    Inward,
    /// Most are no unit vectors.
    NotUnit,
    /// All are the same although the piece is curved: a placeholder.
    Constant,
    /// They have nothing to do with the faces.
    Unrelated,
}

impl Worth {
    pub(super) const fn is_believable(self) -> bool {
        matches!(self, Self::Outward | Self::Inward)
    }
}

/// What the faces of one piece of skin say about its normals, added up face by face.
#[derive(Debug, Clone, Default)]
pub(super) struct Poll {
    /// Twice the area.
    area: f64,
    /// Twice the vector area; twice the area long on a flat piece.
    direction: DVec3,
    /// Cosines between faces and their corners' normals, weighted by twice the area.
    agreement: f64,
    /// What `agreement` would be if all cosines were 1.
    weight: f64,
    corners: usize,
    unit_corners: usize,
    first: Option<DVec3>,
    differs: bool,
}

impl Poll {
    /// Adds a face with vector `cross` (twice its area) and the normals of its corners; zero where there is none.
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

    /// The verdict.
    pub(super) fn worth(&self) -> Worth {
        if 2 * self.unit_corners < self.corners {
            Worth::NotUnit
        } else if !self.differs && self.direction.length() < FLAT * self.area {
            Worth::Constant
        } else if self.agreement >= AGREEMENT * self.weight {
            Worth::Outward
        } else if self.agreement <= -AGREEMENT * self.weight {
            Worth::Inward
        } else {
            Worth::Unrelated
        }
    }
}

/// The believable part of a taxel's normals: the mean of the unit normals of all file vertices that are this taxel,
/// zero where there is none.
pub(super) fn taxel_normals(normals: &[DVec3], taxel: &IdVec<VertexId, VertexId>) -> IdVec<VertexId, DVec3> {
    let mut sums = IdVec::<VertexId, DVec3>::filled(DVec3::ZERO, taxel.len());
    for ((_, &v), &n) in taxel.enumerate().zip(normals) {
        if is_unit(n) {
            sums[v] += n;
        }
    }
    sums.map(|n| n.normalize_or_zero())
}

/// Unit normals of the faces around each vertex, and zero only where these have no direction at all.
pub(super) fn surface_normals(mesh: &TriMesh) -> IdVec<VertexId, DVec3> {
    let mut normals = mesh.vertex_normals();
    // Where opposite faces cancel, and where areas are too small for their squares, one face is as good as another.
    for (face, corners) in mesh.triangles.enumerate() {
        for &v in corners {
            if normals[v] == DVec3::ZERO {
                normals[v] = face_direction(mesh, face);
            }
        }
    }
    normals
}

fn face_direction(mesh: &TriMesh, face: FaceId) -> DVec3 {
    let [a, b, c] = mesh.corners(face);
    (b - a).normalize_or_zero().cross((c - a).normalize_or_zero()).normalize_or_zero()
}

/// What the faces of a patch say about the normals of its taxels.
pub(super) fn poll(mesh: &TriMesh, normals: &IdVec<VertexId, DVec3>) -> Poll {
    let mut poll = Poll::default();
    for (face, corners) in mesh.triangles.enumerate() {
        poll.add(mesh.face_cross(face), corners.map(|v| normals[v]));
    }
    poll
}

/// Volume inside a closed piece, in m^3, negative if it is inside out; `None` for one with a boundary.
pub(super) fn enclosed_volume(mesh: &TriMesh) -> Option<f64> {
    if Edges::new(&mesh.triangles, mesh.positions.len()).iter().any(|uses| uses.len() == 1) {
        return None;
    }
    let origin = mesh.positions.iter().next().copied()?;
    let volume = |face| {
        let [a, b, c] = mesh.corners(face).map(|p| p - origin);
        a.dot(b.cross(c)) / 6.0
    };
    Some(mesh.triangles.ids().map(volume).sum())
}
