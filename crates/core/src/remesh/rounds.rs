//! The rounds of remeshing: edges of one length and six neighbours.

use glam::DVec3;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Halfedge, HalfedgeMesh, triangle_cross};
use crate::remesh::faces::{FLAT, THIN, Thin, keeps_side, keeps_side_around, largest_cosine};
use crate::remesh::surface::Surface;

/// Edges longer than `LONG` times the target are split, shorter than `SHORT` times it collapsed: either
/// brings an edge nearer to the target `(botsch2004)`.
const LONG: f64 = 4.0 / 3.0;
const SHORT: f64 = 4.0 / 5.0;

/// Sharp edges, rims and their corners nearer to each other than this fraction of the target are details that
/// taxels do not follow: they may merge.
const DETAIL: f64 = 0.5;

/// Long edges of CAD triangles are split from the longest down, and each pass lowers the limit by this
/// factor: so slivers are halved, not cut near their ends.
const SHORTER: f64 = 0.7;

/// Number of rounds, and the largest number while the mean length of the edges is off by more than
/// [`MAX_LENGTH_ERROR`].
const ROUNDS: usize = 6;
const MAX_ROUNDS: usize = 24;
const MAX_LENGTH_ERROR: f64 = 0.03;
/// Rounds before the target is first corrected by the mean length, and how much it may change in one round.
const UNCORRECTED_ROUNDS: usize = 1;
const MAX_CHANGE: f64 = 1.2;
/// Exponent of the correction in additional rounds: edges of one length split or collapse all at once, so
/// that the mean oscillates.
const LATE_EXPONENT: f64 = 0.3;
/// A mean length that is off by less is not corrected.
const MIN_LENGTH_ERROR: f64 = 0.01;
/// Most passes of splitting in a round: the halves of an edge may be longer once its midpoint has moved to
/// the surface.
const MAX_PASSES: usize = 4;
/// The midpoint of an edge is on the surface if it is nearer to it than `ON_SURFACE` times the target, and
/// the edge bridges a gap if it is farther than `ACROSS_GAP` times the edge.
const ON_SURFACE: f64 = 1e-3;
const ACROSS_GAP: f64 = 0.4;
/// Faces that are still lower than this fraction of the target at the end lose an edge however long it is.
const LOW: f64 = 0.03;

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
#[derive(Clone)]
pub(super) struct Rounds<'a> {
    pub(super) mesh: HalfedgeMesh,
    pub(super) positions: IdVec<VertexId, DVec3>,
    /// Whether the edge of each halfedge is a sharp one or a rim.
    pub(super) sharp: IdVec<FaceId, [bool; 3]>,
    pub(super) freedom: IdVec<VertexId, Freedom>,
    pub(super) surface: &'a Surface,
    pub(super) lines: Option<&'a Surface>,
    /// The wanted mean length of edges, in m, and the target length that yields it.
    pub(super) spacing: f64,
    pub(super) target: f64,
    /// The packet in which the last search of each vertex ended.
    pub(super) near: IdVec<VertexId, Option<u32>>,
}

impl<'a> Rounds<'a> {
    /// A mesh on `surface` before the first round, without sharp edges.
    pub(super) fn new(
        mesh: HalfedgeMesh,
        positions: IdVec<VertexId, DVec3>,
        surface: &'a Surface,
        spacing: f64,
    ) -> Self {
        Self {
            sharp: IdVec::filled([false; 3], mesh.triangles().len()),
            freedom: positions.map(|_| Freedom::Surface),
            near: positions.map(|_| None),
            mesh,
            positions,
            surface,
            lines: None,
            spacing,
            target: spacing,
        }
    }

    /// Splits the long edges of the surface, before the first round.
    pub(super) fn split_surface(&mut self) {
        self.split_long(true);
    }

    pub(super) fn run(&mut self) {
        for round in 0..MAX_ROUNDS {
            if round > 0 {
                self.split_long(false);
            }
            self.collapse_short();
            self.compact();
            self.flip_edges(Self::evens_degrees);
            self.smooth();
            let off = self.length_ratio();
            if round + 1 >= ROUNDS && (off - 1.0).abs() <= MAX_LENGTH_ERROR {
                break;
            }
            if round >= UNCORRECTED_ROUNDS && (off - 1.0).abs() > MIN_LENGTH_ERROR {
                let off = if round + 1 < ROUNDS { off } else { off.powf(LATE_EXPONENT) };
                self.target *= off.clamp(MAX_CHANGE.recip(), MAX_CHANGE);
            }
        }
        for _ in 0..2 {
            self.flip_edges(Self::opens_angles);
            self.smooth();
        }
        self.flip_edges(Self::opens_angles);
        self.remove_last_thin();
        // A loop of two edges is none to cut.
        self.split_all_second_edges();
        self.cut_tunnels();
        self.raise_thin(LOW * self.target);
        self.compact();
        self.split_all_second_edges();
    }

    fn split_all_second_edges(&mut self) {
        for _ in 0..MAX_PASSES {
            if !self.split_second_edges() {
                break;
            }
        }
    }

    /// Removes the thin faces and the short edges of the mesh that the rounds have made.
    pub(super) fn remove_last_thin(&mut self) {
        let [height, short, longest] = [THIN, DETAIL, 2.0].map(|part| part * self.target);
        self.remove_thin(Thin { height, short, longest, is_last: true });
        // The remaining thin faces may change the shape more.
        self.remove_thin(Thin {
            height: LOW * self.target,
            short: longest,
            longest: 1.5 * longest,
            is_last: true,
        });
    }

    /// Splits second edges between the same two vertices, as the sides of a flat body of two faces have when both are
    /// split: triangles know an edge by its ends. Returns whether there was one.
    fn split_second_edges(&mut self) -> bool {
        let mut is_split = false;
        for face in (0..self.mesh.face_count()).map(FaceId::new) {
            for h in [0, 1, 2].map(|side| Halfedge::new(face, side)) {
                let (a, b) = (self.mesh.origin(h), self.mesh.target(h));
                if self.mesh.is_edge(h) && self.mesh.ring(a).filter(|&v| v == b).count() > 1 {
                    let middle = self.positions[a].midpoint(self.positions[b]);
                    let at = self.split_point(h, middle).unwrap_or(middle);
                    self.split(h, at);
                    is_split = true;
                }
            }
        }
        is_split
    }

    /// Removes the dead vertices and faces; the others keep their order.
    pub(super) fn compact(&mut self) {
        let alive = self.mesh.face_ids().filter(|&face| self.mesh.is_alive(face));
        self.sharp = alive.map(|face| self.sharp[face]).collect();
        let compacted = self.mesh.compact();
        let kept = compacted.old_vertices;
        self.positions = kept.map(|&v| self.positions[v]);
        self.freedom = kept.map(|&v| self.freedom[v]);
        self.near = kept.map(|&v| self.near[v]);
        self.mesh = compacted.mesh;
    }

    pub(super) fn length(&self, h: Halfedge) -> f64 {
        self.positions[self.mesh.origin(h)].distance(self.positions[self.mesh.target(h)])
    }

    pub(super) fn cross(&self, face: FaceId) -> DVec3 {
        self.mesh.face_cross(face, &self.positions)
    }

    pub(super) fn is_sharp(&self, h: Halfedge) -> bool {
        self.sharp[h.face()][h.side()]
    }

    /// The edges of living faces, each by one of its halfedges.
    pub(super) fn edges(&self) -> impl Iterator<Item = Halfedge> {
        self.mesh.halfedges().filter(|&h| self.mesh.is_edge(h))
    }

    /// Copies the marks of the sides of changed faces from the faces around them.
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

    /// Flips an edge if that is possible and neither face turns away from the normal `old`.
    fn flip(&mut self, h: Halfedge, old: DVec3) {
        let [a, b, c, d] = self.mesh.diamond(h).map(|v| self.positions[v]);
        let new = [[c, a, d], [d, b, c]].map(triangle_cross);
        if self.mesh.can_flip(h) && new.iter().all(|&cross| keeps_side(old, cross)) {
            self.flip_inner(h);
        }
    }

    pub(super) fn flip_inner(&mut self, h: Halfedge) {
        let faces = [h.face(), self.mesh.twin(h).face()];
        self.mesh.flip(h);
        self.update_sharp(&faces);
    }

    /// The spacing over the mean length of the edges that can change. Edges within the bounds of splitting
    /// and collapsing are left alone, so the mean differs from the target by up to a sixth; the target is
    /// corrected by this ratio. Edges between vertices of lines and corners are not counted: most of them
    /// cannot change.
    fn length_ratio(&self) -> f64 {
        let can_change = |&h: &Halfedge| {
            [self.mesh.origin(h), self.mesh.target(h)].iter().any(|&v| self.freedom[v] == Freedom::Surface)
        };
        let lengths = self.edges().filter(can_change).map(|h| self.length(h));
        let (count, sum) = lengths.fold((0.0, 0.0), |(n, sum), length| (n + 1.0, sum + length));
        let ratio: f64 = self.spacing * count / sum;
        if ratio.is_finite() { ratio } else { 1.0 }
    }

    fn split_long(&mut self, is_first: bool) {
        let mut limit = self.edges().map(|h| self.length(h)).fold(0.0, f64::max);
        loop {
            limit = (limit * SHORTER).max(LONG * self.target);
            // Halves are at most half as long as the longest edge left.
            let passes = if is_first { usize::MAX } else { MAX_PASSES };
            let _ = (0..passes).try_for_each(|_| self.split_longer(limit, is_first).then_some(()));
            if limit <= LONG * self.target {
                return;
            }
        }
    }

    /// In the first round all edges lie on the surface, and new ones are split in the same pass.
    fn split_longer(&mut self, limit: f64, is_first: bool) -> bool {
        let (mut is_split, mut face, known) = (false, 0, self.mesh.face_count());
        while face < if is_first { self.mesh.face_count() } else { known } {
            for h in [0, 1, 2].map(|side| Halfedge::new(FaceId::new(face), side)) {
                if self.mesh.is_edge(h) && self.length(h) > limit {
                    let middle =
                        self.positions[self.mesh.origin(h)].midpoint(self.positions[self.mesh.target(h)]);
                    let at = if is_first { Some(middle) } else { self.split_point(h, middle) };
                    at.into_iter().for_each(|at| self.split(h, at));
                    is_split |= at.is_some();
                }
            }
            face += 1;
        }
        is_split
    }

    /// The point of the surface, or of its lines, nearest to the midpoint of an edge; `None` if the edge is
    /// not split, since a face would turn over or become thin, or the edge bridges a gap.
    fn split_point(&self, h: Halfedge, middle: DVec3) -> Option<DVec3> {
        let sides = || [h, self.mesh.twin(h)].into_iter().filter(|&h| h != Halfedge::NONE);
        let near = self.near[self.mesh.origin(h)];
        let at = if self.is_sharp(h) {
            self.lines?.nearest(middle, DVec3::ZERO, near)?.point
        } else {
            self.surface.nearest(middle, sides().map(|h| self.cross(h.face())).sum(), near)?.point
        };
        let off = at.distance(middle);
        let fits = |h: Halfedge| {
            let [p, q, c] =
                [self.mesh.origin(h), self.mesh.target(h), self.mesh.apex(h)].map(|v| self.positions[v]);
            [[p, at, c], [at, q, c]].into_iter().all(|new| self.fits([p, q, c], new))
        };
        (off < ON_SURFACE * self.target || off < ACROSS_GAP * self.length(h) && sides().all(fits))
            .then_some(at)
    }

    fn split(&mut self, h: Halfedge, at: DVec3) {
        let is_sharp = self.is_sharp(h);
        let (old, twin) = (self.mesh.face_count(), self.mesh.twin(h));
        self.mesh.split(h);
        self.positions.push(at);
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
            // Few short edges are left; the next round collapses them.
            if count * 50 <= self.mesh.face_count() {
                return;
            }
        }
    }

    /// Removes the origin of `h`, if that preserves shape and lines and makes no long edge.
    fn collapse(&mut self, h: Halfedge, length: f64) -> bool {
        let (a, b) = (self.mesh.origin(h), self.mesh.target(h));
        if !self.may_merge(h, length) || !self.mesh.can_collapse(h) {
            return false;
        }
        let (from, to) = (self.positions[a], self.positions[b]);
        let around = self.normal(a);
        let fits = self.mesh.leaving(a).all(|leaving| {
            let ends = [self.mesh.target(leaving), self.mesh.apex(leaving)];
            let [p, q] = ends.map(|v| self.positions[v]);
            let is_short = to.distance_squared(p).max(to.distance_squared(q)) <= (LONG * self.target).powi(2);
            ends.contains(&b)
                || is_short && keeps_side_around([from, p, q], [to, p, q], FLAT * self.target, around)
        });
        if fits {
            self.remove_origin(h);
        }
        fits
    }

    /// Shrinks the edge of `h` to its target. The two other sides of a face that is removed become one edge.
    pub(super) fn remove_origin(&mut self, h: Halfedge) {
        let merged = [h, self.mesh.twin(h)].into_iter().filter(|&side| side != Halfedge::NONE).map(|side| {
            let sides = [side.next(), side.previous()];
            (sides.map(|h| self.mesh.twin(h)), sides.iter().any(|&h| self.is_sharp(h)))
        });
        let merged: Vec<_> = merged.collect();
        self.mesh.collapse(h);
        for ([p, q], is_sharp) in merged {
            self.set_sharp(if p == Halfedge::NONE { q } else { p }, is_sharp);
        }
    }

    /// Whether the lines allow the origin of `h` to merge with its target.
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

    /// Whether a flip brings the numbers of neighbours nearer to six, or to four at a boundary.
    fn evens_degrees(&self, h: Halfedge) -> bool {
        let excess = |v: VertexId| {
            let ideal = if self.mesh.on_boundary[v] { 4 } else { 6 };
            self.mesh.degree[v].cast_signed() - ideal
        };
        let [a, b, c, d] = self.mesh.diamond(h).map(excess);
        let sum = |all: [i32; 4]| all.iter().map(|x| x * x).sum::<i32>();
        sum([a - 1, b - 1, c + 1, d + 1]) < sum([a, b, c, d])
    }

    /// Whether a flip enlarges the smallest angle of the two faces.
    fn opens_angles(&self, h: Halfedge) -> bool {
        let [a, b, c, d] = self.mesh.diamond(h).map(|v| self.positions[v]);
        let least = |faces: [[DVec3; 3]; 2]| faces.map(largest_cosine).into_iter().fold(-1.0, f64::max);
        least([[c, a, d], [d, b, c]]) < least([[a, b, c], [b, a, d]]) - 1e-9
    }
}
