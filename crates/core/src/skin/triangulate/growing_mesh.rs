//! A mesh that grows triangle by triangle and stays an oriented manifold.

use glam::DVec2;

use crate::id::{FaceId, IdVec, VertexId};
use crate::skin::triangulate::neighbours::PointCloud;

/// Smallest cosine between a face and the normals of its corners. A face may be almost perpendicular to the
/// surface, since noise puts taxels almost above each other: at 0.1, noise of a fifth of the spacing leaves
/// twice as many holes.
const LEAST_COSINE: f64 = 0.02;

/// Directions are equal if the sine between them is smaller.
const SAME_DIRECTION: f64 = 1e-9;

const END: u32 = u32::MAX;

/// A mesh to which triangles are added one by one if they fit.
///
/// The faces around a taxel are sectors of its tangent plane. A face fits if it faces outward at all corners,
/// its edges are within the gap, no edge gets a second face in one direction, and no two sectors of a taxel
/// overlap. So the mesh is always an oriented manifold, except that fans of faces may touch in a point.
#[derive(Debug)]
pub(super) struct GrowingMesh<'a> {
    cloud: &'a PointCloud<'a>,
    triangles: IdVec<FaceId, [VertexId; 3]>,
    /// The first corner `3 face + side` of each taxel, and for each corner the next one of the same
    /// taxel.
    first: IdVec<VertexId, u32>,
    next: Vec<u32>,
}

/// A sector of a taxel's tangent plane without faces: between two fans, or between the ends of one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Opening {
    /// The last neighbour of the fan before it, counter-clockwise.
    pub from: VertexId,
    /// The first neighbour of the fan after it.
    pub to: VertexId,
}

impl<'a> GrowingMesh<'a> {
    pub(super) fn new(cloud: &'a PointCloud<'a>) -> Self {
        let first = IdVec::filled(END, cloud.positions.len());
        Self { cloud, triangles: IdVec::default(), first, next: Vec::new() }
    }

    pub(super) fn into_triangles(self) -> IdVec<FaceId, [VertexId; 3]> {
        // Removed faces have three equal corners.
        self.triangles.into_iter().filter(|t| t[0] != t[1]).collect()
    }

    /// Adds the face if it fits; returns whether it did.
    pub(super) fn try_insert(&mut self, t: [VertexId; 3]) -> bool {
        let fits = self.faces_outward(t)
            && (0..3).all(|side| {
                let [v, a, b] = [0, 1, 2].map(|k| t[(side + k) % 3]);
                self.cloud.is_within_gap(v, a) && self.is_free(v, a, b)
            });
        if fits {
            self.insert(t);
        }
        fits
    }

    fn insert(&mut self, t: [VertexId; 3]) {
        let face = self.triangles.push(t);
        for (side, &v) in (0..).zip(&t) {
            self.next.push(self.first[v]);
            self.first[v] = 3 * face.raw() + side;
        }
    }

    /// Replaces a face by three around `v`, if all of them fit.
    pub(super) fn split(&mut self, face: FaceId, v: VertexId) -> bool {
        let [a, b, c] = self.triangles[face];
        self.remove(face);
        let first = self.triangles.len();
        let fits = [[v, a, b], [v, b, c], [v, c, a]].into_iter().all(|t| self.try_insert(t));
        if !fits {
            (first..self.triangles.len()).for_each(|part| self.remove(FaceId::new(part)));
            self.insert([a, b, c]);
        }
        fits
    }

    /// The sectors of `v` from the one that begins at `from` to the end of their fan.
    pub(super) fn fan(&self, v: VertexId, from: VertexId) -> Vec<(FaceId, VertexId, VertexId)> {
        let mut fan: Vec<(FaceId, VertexId, VertexId)> = Vec::new();
        let mut at = from;
        while let Some(sector) = self.sectors(v).find(|&(_, a, _)| a == at) {
            if fan.first() == Some(&sector) {
                break;
            }
            at = sector.2;
            fan.push(sector);
        }
        fan
    }

    pub(super) fn remove(&mut self, face: FaceId) {
        let t = self.triangles[face];
        for (side, &v) in (0..).zip(&t) {
            let corner = 3 * face.raw() + side;
            let after = self.next[corner as usize];
            if self.first[v] == corner {
                self.first[v] = after;
                continue;
            }
            let mut at = self.first[v];
            while self.next[at as usize] != corner {
                at = self.next[at as usize];
            }
            self.next[at as usize] = after;
        }
        self.triangles[face] = [t[0]; 3];
    }

    /// Faces around `v`, each with the neighbours at which its sector begins and ends, counter-clockwise.
    pub(super) fn sectors(&self, v: VertexId) -> impl Iterator<Item = (FaceId, VertexId, VertexId)> {
        let mut corner = self.first[v];
        std::iter::from_fn(move || {
            if corner == END {
                return None;
            }
            let (face, side) = (FaceId::from(corner / 3), corner as usize % 3);
            let t = self.triangles[face];
            corner = self.next[corner as usize];
            Some((face, t[(side + 1) % 3], t[(side + 2) % 3]))
        })
    }

    pub(super) fn is_used(&self, v: VertexId) -> bool {
        self.first[v] != END
    }

    /// How many edges of `t` have a face on the other side.
    pub(super) fn adjacent_faces(&self, t: [VertexId; 3]) -> usize {
        (0..3).filter(|&side| self.has_edge(t[(side + 1) % 3], t[side])).count()
    }

    /// Whether a face has the edge from `v` to `w`, in this direction.
    fn has_edge(&self, v: VertexId, w: VertexId) -> bool {
        self.sectors(v).any(|(_, a, _)| a == w)
    }

    /// The openings around `v`, counter-clockwise from the first; none if its fan is closed.
    pub(super) fn openings(&self, v: VertexId) -> Vec<Opening> {
        let ends: Vec<VertexId> = self.sectors(v).map(|s| s.2).filter(|&b| !self.has_edge(v, b)).collect();
        if ends.is_empty() {
            return Vec::new();
        }
        let begins: Vec<VertexId> =
            self.sectors(v).map(|s| s.1).filter(|&a| !self.sectors(v).any(|s| s.2 == a)).collect();
        let opening = |&from: &VertexId| {
            let turn = |&to: &VertexId| self.turn(v, from, to);
            let nearest = |a: &VertexId, b: &VertexId| turn(a).total_cmp(&turn(b)).then(a.cmp(b));
            Some(Opening { from, to: begins.iter().copied().min_by(nearest)? })
        };
        let mut openings: Vec<Opening> = ends.iter().filter_map(opening).collect();
        openings.sort_unstable_by_key(|o| (o.to, o.from));
        openings
    }

    /// The angle at `v` counter-clockwise from `from` to `to`, in 0..2 pi.
    fn turn(&self, v: VertexId, from: VertexId, to: VertexId) -> f64 {
        let angle = self.tangent_direction(v, from).angle_to(self.tangent_direction(v, to));
        if angle < 0.0 { angle + std::f64::consts::TAU } else { angle }
    }

    fn faces_outward(&self, t: [VertexId; 3]) -> bool {
        let normal = self.cloud.normal(t);
        t.iter().all(|&v| normal.dot(self.cloud.normals[v]) >= LEAST_COSINE)
    }

    /// Whether no face of `v` overlaps the sector from `a` to `b`.
    fn is_free(&self, v: VertexId, a: VertexId, b: VertexId) -> bool {
        let new = self.sector(v, a, b);
        self.sectors(v).all(|(_, c, d)| a != c && b != d && !new.overlaps(&self.sector(v, c, d)))
    }

    fn sector(&self, v: VertexId, from: VertexId, to: VertexId) -> Sector {
        let directions = [from, to].map(|w| self.tangent_direction(v, w));
        Sector { ends: [from, to], from: directions[0], to: directions[1] }
    }

    /// The unit direction of `w` in the tangent plane of `v`.
    fn tangent_direction(&self, v: VertexId, w: VertexId) -> DVec2 {
        let (e, f) = self.cloud.normals[v].any_orthonormal_pair();
        let d = self.cloud.positions[w] - self.cloud.positions[v];
        DVec2::new(d.dot(e), d.dot(f)).normalize_or_zero()
    }
}

/// The directions between two neighbours of a taxel, counter-clockwise, less than half a turn.
#[derive(Debug, Clone, Copy)]
struct Sector {
    ends: [VertexId; 2],
    from: DVec2,
    to: DVec2,
}

impl Sector {
    /// Whether two sectors that begin and end at different neighbours overlap. Sectors that share a side, the
    /// end of one and the beginning of the other, do not overlap there.
    fn overlaps(&self, other: &Self) -> bool {
        let begins_at_end = self.ends[0] == other.ends[1];
        let ends_at_begin = self.ends[1] == other.ends[0];
        (!begins_at_end && (other.contains(self.from) || self.contains(other.to)))
            || (!ends_at_begin && (other.contains(self.to) || self.contains(other.from)))
            || other.contains(self.middle())
            || self.contains(other.middle())
    }

    /// Whether a direction lies inside, not on a side.
    fn contains(&self, x: DVec2) -> bool {
        self.from.perp_dot(x) > SAME_DIRECTION && x.perp_dot(self.to) > SAME_DIRECTION
    }

    fn middle(&self) -> DVec2 {
        (self.from + self.to).normalize_or_zero()
    }
}
