use glam::DVec2;

use crate::{
    id::{FaceId, IdVec, VertexId},
    skin::triangulate::point_cloud::Surroundings,
};

/// A face is seen from the outside of all its corners if the cosine with their normals is at least this: it may stand on edge, since
/// noise sets taxels almost above each other. At 0.1, noise of a fifth of the spacing leaves twice as many holes.
const LEAST_COSINE: f64 = 0.02;

/// Directions whose sine is smaller are one direction.
const SAME_DIRECTION: f64 = 1e-9;

/// No corner.
const END: u32 = u32::MAX;

/// A mesh that grows triangle by triangle and stays an oriented manifold, but that fans may still touch in a point.
///
/// Every taxel keeps its faces as sectors of its tangent plane: a face is taken only if it is seen from outside, no edge is used
/// twice in one direction and no two sectors of a taxel overlap.
#[derive(Debug)]
pub(super) struct Front<'a> {
    around: &'a Surroundings<'a>,
    triangles: IdVec<FaceId, [VertexId; 3]>,
    /// The first corner `3 face + side` of each taxel, and for each corner the next one of the same taxel.
    first: IdVec<VertexId, u32>,
    next: Vec<u32>,
}

/// The empty part of a taxel's surroundings between two fans of faces, or the ends of one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Opening {
    /// Where the boundary comes from: the last neighbour of the fan before, counter-clockwise.
    pub from: VertexId,
    /// The first neighbour of the fan after.
    pub to: VertexId,
}

impl<'a> Front<'a> {
    pub(super) fn new(around: &'a Surroundings<'a>) -> Self {
        let first = IdVec::filled(END, around.positions.len());
        Self { around, triangles: IdVec::new(), first, next: Vec::new() }
    }

    /// The faces.
    pub(super) fn into_triangles(self) -> IdVec<FaceId, [VertexId; 3]> {
        // Faces that were taken out have three equal corners.
        self.triangles.into_iter().filter(|t| t[0] != t[1]).collect()
    }

    /// Takes the face if nothing speaks against it.
    pub(super) fn take(&mut self, t: [VertexId; 3]) -> bool {
        let fits = self.is_seen_from_outside(t)
            && (0..3).all(|side| {
                let [v, a, b] = [0, 1, 2].map(|k| t[(side + k) % 3]);
                self.around.is_within_gap(v, a) && self.is_free(v, a, b)
            });
        if fits {
            self.put(t);
        }
        fits
    }

    fn put(&mut self, t: [VertexId; 3]) {
        let face = self.triangles.push(t);
        for (side, &v) in (0..).zip(&t) {
            self.next.push(self.first[v]);
            self.first[v] = 3 * face.raw() + side;
        }
    }

    /// Puts three faces around `v` in the place of one, if `v` lies under it and all three fit.
    pub(super) fn split(&mut self, face: FaceId, v: VertexId) -> bool {
        let [a, b, c] = self.triangles[face];
        self.take_out(face);
        let first = self.triangles.len();
        let fits = [[v, a, b], [v, b, c], [v, c, a]].into_iter().all(|t| self.take(t));
        if !fits {
            (first..self.triangles.len()).for_each(|part| self.take_out(FaceId::new(part)));
            self.put([a, b, c]);
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

    /// Takes a face out again.
    pub(super) fn take_out(&mut self, face: FaceId) {
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

    /// Faces around `v`, each with the neighbour where its sector begins and the one where it ends, counter-clockwise.
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

    /// Whether `v` has faces.
    pub(super) fn is_used(&self, v: VertexId) -> bool {
        self.first[v] != END
    }

    /// How many of the sides of `t` have a face on the other side.
    pub(super) fn sides_taken(&self, t: [VertexId; 3]) -> usize {
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
        let mut openings: Vec<Opening> = ends
            .iter()
            .filter_map(|&from| {
                let turn = |to: VertexId| {
                    let angle = self.seen(v, from).angle_to(self.seen(v, to));
                    if angle < 0.0 { angle + std::f64::consts::TAU } else { angle }
                };
                let to =
                    begins.iter().copied().min_by(|&a, &b| turn(a).total_cmp(&turn(b)).then(a.cmp(&b)))?;
                Some(Opening { from, to })
            })
            .collect();
        openings.sort_unstable_by_key(|o| (o.to, o.from));
        openings
    }

    fn is_seen_from_outside(&self, t: [VertexId; 3]) -> bool {
        let normal = self.around.normal(t);
        t.iter().all(|&v| normal.dot(self.around.normals[v]) >= LEAST_COSINE)
    }

    /// Whether the sector of `v` from `a` to `b` is empty.
    fn is_free(&self, v: VertexId, a: VertexId, b: VertexId) -> bool {
        let new = Sector::new(self.seen(v, a), self.seen(v, b));
        self.sectors(v).all(|(_, c, d)| {
            let old = || Sector::new(self.seen(v, c), self.seen(v, d));
            a != c && b != d && {
                let old = old();
                // A common edge is at the side of both.
                (a == d || !old.holds(new.from))
                    && (b == c || !old.holds(new.to))
                    && (a == d || !new.holds(old.to))
                    && (b == c || !new.holds(old.from))
                    && !old.holds(new.middle())
                    && !new.holds(old.middle())
            }
        })
    }

    /// The direction in which `v` sees `w` in its tangent plane.
    fn seen(&self, v: VertexId, w: VertexId) -> DVec2 {
        let (e, f) = self.around.normals[v].any_orthonormal_pair();
        let d = self.around.positions[w] - self.around.positions[v];
        DVec2::new(d.dot(e), d.dot(f)).normalize_or_zero()
    }
}

/// The directions between two, counter-clockwise, less than half a turn.
#[derive(Debug, Clone, Copy)]
struct Sector {
    from: DVec2,
    to: DVec2,
}

impl Sector {
    const fn new(from: DVec2, to: DVec2) -> Self {
        Self { from, to }
    }

    /// Whether a direction lies inside, not on a side.
    fn holds(&self, x: DVec2) -> bool {
        self.from.perp_dot(x) > SAME_DIRECTION && x.perp_dot(self.to) > SAME_DIRECTION
    }

    fn middle(&self) -> DVec2 {
        (self.from + self.to).normalize_or_zero()
    }
}
