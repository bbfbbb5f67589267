//! The rounds of remeshing: edges of one length, six neighbours, and vertices in the middle of their neighbours, on
//! the surface.

use glam::DVec3;
use rayon::prelude::*;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Halfedge, HalfedgeMesh, triangle_cross};
use crate::parallel::par_ids;
use crate::remesh::surface::{Projection, Surface};

/// Edges longer than this part of the target are split, shorter than that collapsed: after either, an edge is
/// nearer to the target than before (botsch2004).
const LONG: f64 = 4.0 / 3.0;
const SHORT: f64 = 4.0 / 5.0;

/// Sharp edges, rims and their corners nearer to each other than this part of the target are details that
/// taxels do not follow: they may merge.
const DETAIL: f64 = 0.5;

/// Faces may turn by this much when an edge collapses or turns: the cosine of 75 degrees.
const TURN: f64 = 0.26;

/// Long edges of CAD triangles are split from the longest down, each pass to this part: halves of a sliver are
/// better than its ends.
const SHORTER: f64 = 0.7;

/// Least rounds, and most where the mean length of the edges is still off by more than [`CLOSE`].
const ROUNDS: usize = 6;
const MAX_ROUNDS: usize = 24;
const CLOSE: f64 = 0.03;
/// The first round after which the target follows the mean length, and how much it may change in one.
const SETTLING: usize = 1;
const MAX_CHANGE: f64 = 1.2;
/// In rounds that are added the target follows by this power: where all edges are alike, they split or collapse
/// all at once, so that the mean swings.
const GENTLE: f64 = 0.3;
/// A mean length that is off by less stays.
const OFF: f64 = 0.01;
/// The largest angle of a face that is nearly a line: the cosine of 170 degrees.
const CAP: f64 = -0.985;
/// Steps of smoothing in each round.
const STEPS: usize = 3;

/// Where a vertex may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Freedom {
    /// Over the surface.
    Surface,
    /// Along a sharp edge or a rim.
    Line,
    /// Nowhere: it is a corner.
    Fixed,
}

/// A mesh that is changed until its edges have one length.
pub(super) struct Rounds<'a> {
    pub(super) mesh: HalfedgeMesh,
    pub(super) positions: IdVec<VertexId, DVec3>,
    /// Whether the edge of each halfedge is a sharp one or a rim.
    pub(super) sharp: IdVec<FaceId, [bool; 3]>,
    pub(super) freedom: IdVec<VertexId, Freedom>,
    pub(super) surface: &'a Surface,
    pub(super) lines: Option<&'a Surface>,
    /// The mean length that edges are to have, in m, and the length that makes it so.
    pub(super) spacing: f64,
    pub(super) target: f64,
    /// Where the last search of each vertex ended.
    pub(super) near: IdVec<VertexId, Option<u32>>,
}

impl Rounds<'_> {
    pub(super) fn run(&mut self) {
        for round in 0..MAX_ROUNDS {
            self.split_long();
            self.collapse_short();
            self.compact();
            self.flip_edges(Self::evens_degrees);
            self.smooth();
            let off = self.length_ratio();
            if round + 1 >= ROUNDS && (off - 1.0).abs() <= CLOSE {
                break;
            }
            if round >= SETTLING && (off - 1.0).abs() > OFF {
                let off = if round + 1 < ROUNDS { off } else { off.powf(GENTLE) };
                self.target *= off.clamp(MAX_CHANGE.recip(), MAX_CHANGE);
            }
        }
        for _ in 0..2 {
            self.flip_edges(Self::opens_angles);
            self.smooth();
        }
        self.flip_edges(Self::opens_angles);
        self.flip_caps();
    }

    /// Removes the dead vertices and faces; the others keep their order.
    fn compact(&mut self) {
        let alive = self.mesh.face_ids().filter(|&face| self.mesh.is_alive(face));
        self.sharp = alive.map(|face| self.sharp[face]).collect();
        let compacted = self.mesh.compact();
        let kept = compacted.old_vertices;
        self.positions = kept.map(|&v| self.positions[v]);
        self.freedom = kept.map(|&v| self.freedom[v]);
        self.near = kept.map(|&v| self.near[v]);
        self.mesh = compacted.mesh;
    }

    fn length(&self, h: Halfedge) -> f64 {
        self.positions[self.mesh.origin(h)].distance(self.positions[self.mesh.target(h)])
    }

    fn cross(&self, face: FaceId) -> DVec3 {
        self.mesh.face_cross(face, &self.positions)
    }

    fn is_sharp(&self, h: Halfedge) -> bool {
        self.sharp[h.face()][h.side()]
    }

    /// The edges of living faces, each by one of its halfedges.
    fn edges(&self) -> impl Iterator<Item = Halfedge> {
        self.mesh.halfedges().filter(|&h| self.mesh.is_edge(h))
    }

    /// Takes the marks of the sides of changed faces from the faces around them.
    fn update_sharp(&mut self, changed: &[FaceId]) {
        for &face in changed {
            for h in [0, 1, 2].map(|side| Halfedge::new(face, side)) {
                let twin = self.mesh.twin(h);
                let is_sharp =
                    twin == Halfedge::NONE || !changed.contains(&twin.face()) && self.is_sharp(twin);
                self.sharp[face][h.side()] = is_sharp;
            }
        }
    }

    fn set_sharp(&mut self, h: Halfedge, is_sharp: bool) {
        for h in [h, self.mesh.twin(h)].into_iter().filter(|&h| h != Halfedge::NONE) {
            self.sharp[h.face()][h.side()] = is_sharp;
        }
    }

    /// Flips the long side of faces that are nearly a line, sharp or not: where lines have merged, or bend less than
    /// their vertices are apart, three vertices of one are a face.
    fn flip_caps(&mut self) {
        for h in self.mesh.halfedges() {
            if !self.mesh.is_alive(h.face()) || self.mesh.twin(h) == Halfedge::NONE {
                continue;
            }
            let [a, b, c, _] = self.mesh.diamond(h).map(|v| self.positions[v]);
            let is_cap = (a - c).normalize_or_zero().dot((b - c).normalize_or_zero()) < CAP;
            if is_cap {
                self.flip(h, self.cross(self.mesh.twin(h).face()));
            }
        }
    }

    /// Flips an edge if that is possible and neither face turns away from the normal `old`.
    fn flip(&mut self, h: Halfedge, old: DVec3) {
        let [a, b, c, d] = self.mesh.diamond(h).map(|v| self.positions[v]);
        let new = [[c, a, d], [d, b, c]].map(triangle_cross);
        if self.mesh.can_flip(h) && new.iter().all(|&cross| keeps_side(old, cross)) {
            let faces = [h.face(), self.mesh.twin(h).face()];
            self.mesh.flip(h);
            self.update_sharp(&faces);
        }
    }

    /// The spacing over the mean length of the edges that can change: an edge within the bounds of splitting and
    /// collapsing is left alone, so that the mean differs from the target by up to a sixth, which the target
    /// corrects. Edges between vertices of lines and corners are not counted: most of them cannot change.
    fn length_ratio(&self) -> f64 {
        let can_change = |&h: &Halfedge| {
            [self.mesh.origin(h), self.mesh.target(h)].iter().any(|&v| self.freedom[v] == Freedom::Surface)
        };
        let lengths = self.edges().filter(can_change).map(|h| self.length(h));
        let (count, sum) = lengths.fold((0.0, 0.0), |(n, sum), length| (n + 1.0, sum + length));
        let ratio: f64 = self.spacing * count / sum;
        if ratio.is_finite() { ratio } else { 1.0 }
    }

    fn split_long(&mut self) {
        let mut limit = self.edges().map(|h| self.length(h)).fold(0.0, f64::max);
        loop {
            limit = (limit * SHORTER).max(LONG * self.target);
            // Halves are as long as half of what is left at most: two passes at most see all of them.
            while self.split_longer(limit) {}
            if limit <= LONG * self.target {
                return;
            }
        }
    }

    fn split_longer(&mut self, limit: f64) -> bool {
        let (mut is_split, mut face) = (false, 0);
        // Added faces are checked too.
        while face < self.mesh.face_count() {
            for h in [0, 1, 2].map(|side| Halfedge::new(FaceId::new(face), side)) {
                if self.mesh.is_edge(h) && self.length(h) > limit {
                    self.split(h);
                    is_split = true;
                }
            }
            face += 1;
        }
        is_split
    }

    fn split(&mut self, h: Halfedge) {
        let is_sharp = self.is_sharp(h);
        let [a, b] = [self.mesh.origin(h), self.mesh.target(h)].map(|v| self.positions[v]);
        let (old, twin) = (self.mesh.face_count(), self.mesh.twin(h));
        self.mesh.split(h);
        self.positions.push(a.midpoint(b));
        self.freedom.push(if is_sharp { Freedom::Line } else { Freedom::Surface });
        self.near.push(None);
        let mut changed = vec![h.face()];
        changed.extend((twin != Halfedge::NONE).then(|| twin.face()));
        for face in (old..self.mesh.face_count()).map(FaceId::new) {
            self.sharp.push([false; 3]);
            changed.push(face);
        }
        self.update_sharp(&changed);
        if is_sharp {
            // The halves of the edge.
            self.set_sharp(Halfedge::new(h.face(), 0), true);
            self.set_sharp(Halfedge::new(FaceId::new(old), 0), true);
        }
    }

    fn collapse_short(&mut self) {
        loop {
            let mut count = 0;
            for h in self.mesh.halfedges() {
                if !self.mesh.is_edge(h) {
                    continue;
                }
                let (length, twin) = (self.length(h), self.mesh.twin(h));
                if length < SHORT * self.target
                    && (self.collapse(h, length) || twin != Halfedge::NONE && self.collapse(twin, length))
                {
                    count += 1;
                }
            }
            // What is left by a pass is little, and the next round sees it.
            if count * 50 <= self.mesh.face_count() {
                return;
            }
        }
    }

    /// Removes the origin of `h`, if that changes neither the shape nor a line, nor makes long edges.
    fn collapse(&mut self, h: Halfedge, length: f64) -> bool {
        let (a, b) = (self.mesh.origin(h), self.mesh.target(h));
        if !self.may_merge(h, length) || !self.mesh.can_collapse(h) {
            return false;
        }
        let (from, to) = (self.positions[a], self.positions[b]);
        let fits = self.mesh.leaving(a).all(|leaving| {
            let ends = [self.mesh.target(leaving), self.mesh.apex(leaving)];
            let [p, q] = ends.map(|v| self.positions[v]);
            let is_short = to.distance_squared(p).max(to.distance_squared(q)) <= (LONG * self.target).powi(2);
            ends.contains(&b)
                || is_short && keeps_side(triangle_cross([from, p, q]), triangle_cross([to, p, q]))
        });
        if fits {
            // The two other sides of a face that is removed become one edge.
            let merged =
                [h, self.mesh.twin(h)].into_iter().filter(|&side| side != Halfedge::NONE).map(|side| {
                    let sides = [side.next(), side.previous()];
                    (sides.map(|h| self.mesh.twin(h)), sides.iter().any(|&h| self.is_sharp(h)))
                });
            let merged: Vec<_> = merged.collect();
            self.mesh.collapse(h);
            for ([p, q], is_sharp) in merged {
                self.set_sharp(if p == Halfedge::NONE { q } else { p }, is_sharp);
            }
        }
        fits
    }

    /// Whether the origin of `h` may merge with its target, as far as lines are concerned.
    fn may_merge(&self, h: Halfedge, length: f64) -> bool {
        let [a, b] = [self.mesh.origin(h), self.mesh.target(h)];
        let is_detail = length < DETAIL * self.target;
        match (self.freedom[a], self.freedom[b]) {
            (Freedom::Surface, _) => true,
            (Freedom::Line, Freedom::Surface) => false,
            (Freedom::Line, _) => self.is_sharp(h) || is_detail,
            (Freedom::Fixed, Freedom::Fixed) => is_detail,
            (Freedom::Fixed, _) => false,
        }
    }

    fn flip_edges(&mut self, is_better: impl Fn(&Self, Halfedge) -> bool) {
        for h in self.mesh.halfedges() {
            let twin = self.mesh.twin(h);
            let is_inner = self.mesh.is_edge(h) && twin != Halfedge::NONE;
            if is_inner && !self.is_sharp(h) && is_better(self, h) {
                self.flip(h, self.cross(h.face()) + self.cross(twin.face()));
            }
        }
    }

    /// Whether the numbers of neighbours would be nearer to six, or four at a boundary.
    fn evens_degrees(&self, h: Halfedge) -> bool {
        let excess = |v: VertexId| {
            let ideal = if self.mesh.on_boundary[v] { 4 } else { 6 };
            self.mesh.degree[v].cast_signed() - ideal
        };
        let [a, b, c, d] = self.mesh.diamond(h).map(excess);
        let sum = |all: [i32; 4]| all.iter().map(|x| x * x).sum::<i32>();
        sum([a - 1, b - 1, c + 1, d + 1]) < sum([a, b, c, d])
    }

    /// Whether the smallest angle of its two faces would be larger.
    fn opens_angles(&self, h: Halfedge) -> bool {
        let [a, b, c, d] = self.mesh.diamond(h).map(|v| self.positions[v]);
        let least = |faces: [[DVec3; 3]; 2]| faces.map(largest_cosine).into_iter().fold(-1.0, f64::max);
        least([[c, a, d], [d, b, c]]) < least([[a, b, c], [b, a, d]]) - 1e-9
    }

    /// Moves every vertex into the middle of its neighbours, some steps, and back to the surface or its line.
    fn smooth(&mut self) {
        (0..STEPS).for_each(|_| self.move_all(Self::relaxed));
        self.move_all(Self::projected);
    }

    fn move_all(&mut self, to: impl Fn(&Self, VertexId) -> Option<Projection> + Sync) {
        let this = &*self;
        let is_alive = |v: VertexId| this.mesh.leaving[v] != Halfedge::NONE;
        let moved: IdVec<VertexId, Option<Projection>> =
            par_ids(this.positions.len(), |v| is_alive(v).then(|| to(this, v)).flatten());
        let old = self.positions.clone();
        for (v, moved) in moved.enumerate() {
            if let Some(Projection { point, near }) = *moved {
                (self.positions[v], self.near[v]) = (point, near);
            }
        }
        // Faces that would turn over keep their corners; their neighbours may turn over for that.
        for _ in 0..3 {
            let is_turned = |&face: &FaceId| {
                let [old, new] = [&old, &self.positions].map(|all| self.mesh.face_cross(face, all));
                self.mesh.is_alive(face) && !keeps_side(old, new)
            };
            let faces = (0..self.mesh.face_count()).into_par_iter().map(FaceId::new);
            let turned: Vec<FaceId> = faces.filter(is_turned).collect();
            if turned.is_empty() {
                return;
            }
            for v in turned.into_iter().flat_map(|face| self.mesh.corners(face)) {
                self.positions[v] = old[v];
            }
        }
    }

    /// The middle of the faces around a free vertex, in its tangent plane; on its line, that of its two neighbours.
    fn relaxed(&self, v: VertexId) -> Option<Projection> {
        let from = self.positions[v];
        match self.freedom[v] {
            Freedom::Fixed => None,
            Freedom::Surface => {
                let (mut sum, mut total, mut normal) = (DVec3::ZERO, 0.0, DVec3::ZERO);
                for h in self.mesh.leaving(v) {
                    let cross = self.cross(h.face());
                    let corners = [self.mesh.target(h), self.mesh.apex(h)].map(|w| self.positions[w]);
                    // The centres of the faces, weighted by their areas, make faces of one size.
                    let area = cross.length();
                    normal += cross;
                    sum += (from + corners[0] + corners[1]) * (area / 3.0);
                    total += area;
                }
                let normal = normal.normalize_or_zero();
                let step = if total > 0.0 { sum / total - from } else { DVec3::ZERO };
                Some(Projection { point: from + step - normal * normal.dot(step), near: self.near[v] })
            }
            Freedom::Line => {
                let mut sum = DVec3::ZERO;
                let mut count = 0;
                for w in sharp_neighbours(&self.mesh, &self.sharp, v) {
                    sum += self.positions[w];
                    count += 1;
                }
                // Where lines have merged it is not known along which it may move.
                let middle = (count == 2).then_some(0.5 * sum)?;
                self.lines?.nearest(middle, DVec3::ZERO, self.near[v])
            }
        }
    }

    /// The nearest point of the surface for a free vertex.
    fn projected(&self, v: VertexId) -> Option<Projection> {
        if self.freedom[v] != Freedom::Surface {
            return None;
        }
        let normal = self.mesh.leaving(v).map(|h| self.cross(h.face())).sum();
        self.surface.nearest(self.positions[v], normal, self.near[v])
    }
}

/// The neighbours of `v` along sharp edges; rims are sharp.
pub(super) fn sharp_neighbours(
    mesh: &HalfedgeMesh,
    sharp: &IdVec<FaceId, [bool; 3]>,
    v: VertexId,
) -> impl Iterator<Item = VertexId> {
    let mut ring = mesh.ring(v);
    std::iter::from_fn(move || {
        loop {
            let h = ring.halfedge();
            let w = ring.next()?;
            if h == Halfedge::NONE || sharp[h.face()][h.side()] {
                return Some(w);
            }
        }
    })
}

/// Whether a face stays on its side; one that had no area may become anything.
fn keeps_side(old: DVec3, new: DVec3) -> bool {
    let lengths = (old.length_squared() * new.length_squared()).sqrt();
    old == DVec3::ZERO || old.dot(new) > TURN * lengths
}

/// The cosine of the smallest angle of a triangle, whose largest it is; 1 for one without area.
fn largest_cosine(corners: [DVec3; 3]) -> f64 {
    let cosine = |k: usize| {
        let [at, p, q] = [0, 1, 2].map(|j| corners[(j + k) % 3]);
        let (u, v) = (p - at, q - at);
        u.dot(v) / (u.length_squared() * v.length_squared()).sqrt()
    };
    let largest = [0, 1, 2].map(cosine).into_iter().fold(-1.0, f64::max);
    if largest.is_nan() { 1.0 } else { largest }
}
