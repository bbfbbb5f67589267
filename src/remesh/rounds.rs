//! The rounds of remeshing: edges of one length, six neighbours, and vertices amid their neighbours, on the surface.

use glam::DVec3;
use rayon::prelude::*;

use crate::remesh::editable::{Editable, NONE};
use crate::remesh::surface::{Place, Surface};

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
const MOST_ROUNDS: usize = 24;
const CLOSE: f64 = 0.03;
/// The first round after which the target follows the mean length, and how much it may change in one.
const SETTLING: usize = 1;
const MOST_CHANGE: f64 = 1.2;
/// In rounds that are added the target follows by this power: where all edges are alike, they split or collapse
/// all at once, so that the mean swings.
const GENTLE: f64 = 0.3;
/// A mean length that is off by less stays.
const OFF: f64 = 0.01;
/// The largest angle of a face that is nearly a line: the cosine of 170 degrees.
const CAP: f64 = -0.985;
/// Steps of smoothing in each round.
const STEPS: usize = 3;

/// Where a vertex may go.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Over the surface.
    Free,
    /// Along a sharp edge or a rim.
    Line,
    /// Nowhere.
    Corner,
}

/// A mesh on its way to edges of one length.
pub(super) struct Rounds<'a> {
    pub(super) mesh: Editable,
    pub(super) kinds: Vec<Kind>,
    pub(super) surface: &'a Surface,
    pub(super) lines: Option<&'a Surface>,
    /// The mean length that edges are to have, in m, and what each is measured by for that.
    pub(super) spacing: f64,
    pub(super) target: f64,
    /// Where the last search of each vertex ended.
    pub(super) near: Vec<Option<u32>>,
    /// Halfedges around the vertex at hand.
    pub(super) around: Vec<u32>,
}

impl Rounds<'_> {
    pub(super) fn run(&mut self) {
        for round in 0..MOST_ROUNDS {
            self.split_long();
            self.collapse_short();
            let kept = self.mesh.compact();
            self.kinds = kept.iter().map(|&v| self.kinds[v]).collect();
            self.near = kept.iter().map(|&v| self.near[v]).collect();
            self.flip_edges(Self::evens_degrees);
            self.smooth();
            let off = self.off();
            if round + 1 >= ROUNDS && (off - 1.0).abs() <= CLOSE {
                break;
            }
            if round >= SETTLING && (off - 1.0).abs() > OFF {
                let off = if round + 1 < ROUNDS { off } else { off.powf(GENTLE) };
                self.target *= off.clamp(MOST_CHANGE.recip(), MOST_CHANGE);
            }
        }
        for _ in 0..2 {
            self.flip_edges(Self::opens_angles);
            self.smooth();
        }
        self.flip_edges(Self::opens_angles);
        self.turn_caps();
    }

    /// Turns the long side of faces that are nearly a line, sharp or not: where lines have merged, or bend less than
    /// their vertices are apart, three vertices of one are a face.
    fn turn_caps(&mut self) {
        for h in 0..self.mesh.halfedges() {
            let twin = self.mesh.twin(h);
            if self.mesh.faces[(h / 3) as usize][0] == NONE || twin == NONE {
                continue;
            }
            let [a, b, c, d] = self.corners(h);
            let [pa, pb, pc, pd] = [a, b, c, d].map(|v| self.mesh.at(v));
            let is_cap = (pa - pc).normalize_or_zero().dot((pb - pc).normalize_or_zero()) < CAP;
            let thin = |v: u32| self.mesh.degree[v as usize] <= 3;
            let across = self.mesh.cross(twin / 3);
            let new = [(pa - pc).cross(pd - pc), (pb - pd).cross(pc - pd)];
            if is_cap
                && !(thin(a) || thin(b) || self.mesh.has_edge(c, d))
                && new.iter().all(|&cross| keeps_side(across, cross))
            {
                self.mesh.flip(h);
            }
        }
    }

    /// The spacing over the mean length of the edges, which within the bounds stay as they are, so that their mean
    /// is off the target by up to a sixth: the target makes up for that.
    fn off(&self) -> f64 {
        let edges = (0..self.mesh.halfedges()).filter(|&h| self.mesh.edge(h));
        let (count, sum) = edges.fold((0.0, 0.0), |(n, sum), h| (n + 1.0, sum + self.mesh.length(h)));
        let off: f64 = self.spacing * count / sum;
        if off.is_finite() { off } else { 1.0 }
    }

    fn split_long(&mut self) {
        let edges = (0..self.mesh.halfedges()).filter(|&h| self.mesh.edge(h));
        let mut limit = edges.map(|h| self.mesh.length(h)).fold(0.0, f64::max);
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
        let (mut h, mut is_split) = (0, false);
        while h < self.mesh.halfedges() {
            if self.mesh.edge(h) && self.mesh.length(h) > limit {
                let kind = if self.mesh.is_sharp(h) { Kind::Line } else { Kind::Free };
                self.mesh.split(h);
                self.kinds.push(kind);
                self.near.push(None);
                is_split = true;
            }
            h += 1;
        }
        is_split
    }

    fn collapse_short(&mut self) {
        loop {
            let mut count = 0;
            for h in 0..self.mesh.halfedges() {
                if !self.mesh.edge(h) {
                    continue;
                }
                let length = self.mesh.length(h);
                if length < SHORT * self.target && (self.collapse(h, length) || self.collapse_back(h, length))
                {
                    count += 1;
                }
            }
            // What is left by a pass is little, and the next round sees it.
            if count * 50 <= self.mesh.faces.len() {
                return;
            }
        }
    }

    fn collapse_back(&mut self, h: u32, length: f64) -> bool {
        let twin = self.mesh.twin(h);
        twin != NONE && self.collapse(twin, length)
    }

    /// Removes the origin of `h`, if that harms neither the shape nor a line, nor makes long edges.
    fn collapse(&mut self, h: u32, length: f64) -> bool {
        let (a, b) = (self.mesh.origin(h), self.mesh.target(h));
        if !self.may_merge(h, length) || !self.mesh.can_collapse(h) {
            return false;
        }
        self.around.clear();
        let around = &mut self.around;
        self.mesh.each_leaving(a, |h| around.push(h));
        let to = self.mesh.at(b);
        let fits = self.around.iter().all(|&leaving| {
            let (p, q) = (self.mesh.target(leaving), self.mesh.apex(leaving));
            if p == b || q == b {
                return true;
            }
            let (from, p, q) = (self.mesh.at(a), self.mesh.at(p), self.mesh.at(q));
            let old = (p - from).cross(q - from);
            let new = (p - to).cross(q - to);
            let is_short = to.distance_squared(p).max(to.distance_squared(q)) <= (LONG * self.target).powi(2);
            is_short && keeps_side(old, new)
        });
        if fits {
            self.mesh.collapse(h, &self.around);
        }
        fits
    }

    /// Whether the origin of `h` may go to its target, as far as lines are concerned.
    fn may_merge(&self, h: u32, length: f64) -> bool {
        let [a, b] = [self.mesh.origin(h), self.mesh.target(h)].map(|v| v as usize);
        let is_rim = self.mesh.twin(h) == NONE;
        if self.mesh.on_boundary[a] && !is_rim {
            return false;
        }
        let is_detail = length < DETAIL * self.target;
        match (self.kinds[a], self.kinds[b]) {
            (Kind::Free, _) => true,
            (Kind::Line, Kind::Free) => false,
            (Kind::Line, _) => self.mesh.is_sharp(h) || is_detail,
            (Kind::Corner, Kind::Corner) => is_detail,
            (Kind::Corner, _) => false,
        }
    }

    fn flip_edges(&mut self, is_better: impl Fn(&Self, u32) -> bool) {
        for h in 0..self.mesh.halfedges() {
            let twin = if self.mesh.edge(h) { self.mesh.twin(h) } else { NONE };
            if twin == NONE || self.mesh.is_sharp(h) || !is_better(self, h) {
                continue;
            }
            let [a, b, c, d] = self.corners(h);
            let thin = |v: u32| self.mesh.degree[v as usize] <= 3;
            if thin(a) || thin(b) || self.mesh.has_edge(c, d) {
                continue;
            }
            let [pa, pb, pc, pd] = [a, b, c, d].map(|v| self.mesh.at(v));
            let old = self.mesh.cross(h / 3) + self.mesh.cross(twin / 3);
            let new = [(pa - pc).cross(pd - pc), (pb - pd).cross(pc - pd)];
            if new.iter().all(|&cross| keeps_side(old, cross)) {
                self.mesh.flip(h);
            }
        }
    }

    /// The ends of an edge, and the corners across it on either side.
    fn corners(&self, h: u32) -> [u32; 4] {
        let twin = self.mesh.twin(h);
        [self.mesh.origin(h), self.mesh.target(h), self.mesh.apex(h), self.mesh.apex(twin)]
    }

    /// Whether the numbers of neighbours would be nearer to six, or four at a boundary.
    fn evens_degrees(&self, h: u32) -> bool {
        let excess = |v: u32| {
            let ideal = if self.mesh.on_boundary[v as usize] { 4 } else { 6 };
            self.mesh.degree[v as usize].cast_signed() - ideal
        };
        let [a, b, c, d] = self.corners(h).map(excess);
        let sum = |all: [i32; 4]| all.iter().map(|x| x * x).sum::<i32>();
        sum([a - 1, b - 1, c + 1, d + 1]) < sum([a, b, c, d])
    }

    /// Whether the smallest angle of its two faces would be larger.
    fn opens_angles(&self, h: u32) -> bool {
        let [a, b, c, d] = self.corners(h).map(|v| self.mesh.at(v));
        let least = |faces: [[DVec3; 3]; 2]| faces.map(largest_cosine).into_iter().fold(-1.0, f64::max);
        least([[c, a, d], [d, b, c]]) < least([[a, b, c], [b, a, d]]) - 1e-9
    }

    /// Moves every vertex amid its neighbours, some steps, and back to the surface or its line.
    fn smooth(&mut self) {
        (0..STEPS).for_each(|_| self.move_all(Self::relaxed));
        self.move_all(Self::projected);
    }

    fn move_all(&mut self, to: impl Fn(&Self, usize, u32) -> Option<Place> + Sync) {
        let this = &*self;
        let alive = |v: usize| u32::try_from(v).ok().filter(|&id| this.mesh.is_alive(id));
        let moved = (0..self.mesh.positions.len()).into_par_iter().map(|v| to(this, v, alive(v)?));
        let moved: Vec<Option<Place>> = moved.collect();
        let old = self.mesh.positions.clone();
        for (v, place) in moved.into_iter().enumerate() {
            if let Some(Place { point, near }) = place {
                (self.mesh.positions[v], self.near[v]) = (point, near);
            }
        }
        // Faces that would turn over keep their corners; their neighbours may turn over for that.
        for _ in 0..3 {
            let cross = |face: &[u32; 3], positions: &[DVec3]| {
                let [a, b, c] = face.map(|v| positions[v as usize]);
                (b - a).cross(c - a)
            };
            let is_turned = |face: &&[u32; 3]| {
                face[0] != NONE && !keeps_side(cross(face, &old), cross(face, &self.mesh.positions))
            };
            let turned: Vec<&[u32; 3]> = self.mesh.faces.par_iter().filter(is_turned).collect();
            if turned.is_empty() {
                return;
            }
            turned.iter().copied().flatten().for_each(|&v| self.mesh.positions[v as usize] = old[v as usize]);
        }
    }

    /// Amid the faces around a free vertex, in its tangent plane; amid the neighbours of one on a line, on that.
    fn relaxed(&self, v: usize, id: u32) -> Option<Place> {
        let from = self.mesh.positions[v];
        match self.kinds[v] {
            Kind::Corner => None,
            Kind::Free => {
                let (mut sum, mut total, mut normal) = (DVec3::ZERO, 0.0, DVec3::ZERO);
                self.mesh.each_leaving(id, |h| {
                    let cross = self.mesh.cross(h / 3);
                    let corners = [self.mesh.target(h), self.mesh.apex(h)].map(|w| self.mesh.at(w));
                    // The centres of the faces, weighted by their areas, make faces of one size.
                    let area = cross.length();
                    normal += cross;
                    sum += (from + corners[0] + corners[1]) * (area / 3.0);
                    total += area;
                });
                let normal = normal.normalize_or_zero();
                let step = if total > 0.0 { sum / total - from } else { DVec3::ZERO };
                Some(Place { point: from + step - normal * normal.dot(step), near: self.near[v] })
            }
            Kind::Line => {
                let (mut sum, mut count) = (DVec3::ZERO, 0);
                self.mesh.each_neighbour(id, |w, is_sharp| {
                    if is_sharp {
                        sum += self.mesh.at(w);
                        count += 1;
                    }
                });
                // Where lines have merged there is no telling along which it may go.
                let middle = (count == 2).then_some(0.5 * sum)?;
                self.lines?.nearest(middle, DVec3::ZERO, self.near[v])
            }
        }
    }

    /// The nearest point of the surface for a free vertex.
    fn projected(&self, v: usize, id: u32) -> Option<Place> {
        if self.kinds[v] != Kind::Free {
            return None;
        }
        let mut normal = DVec3::ZERO;
        self.mesh.each_leaving(id, |h| normal += self.mesh.cross(h / 3));
        self.surface.nearest(self.mesh.positions[v], normal, self.near[v])
    }
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
