//! The faces around one vertex, gathered and flattened, and whether their shape allows its removal.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use crate::id::{IdVec, VertexId};
use crate::mesh::{Halfedge, HalfedgeMesh, MAX_RING, triangle_cross};

#[expect(clippy::cast_possible_truncation, reason = "ring positions and fillings are below MAX_RING")]
pub(super) fn small(position: usize) -> u8 {
    position as u8
}

/// The direction of a corner of a star below this angle, in rad, is rounding noise; such a star is not
/// flattened.
const MIN_ANGLE: f64 = 1e-9;

/// How far a removal may change the surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    /// Cosine of the largest angle between a filling triangle and the star it replaces; positive.
    pub(super) min_cos_turn: f64,
    /// Largest distance of a removed boundary vertex from the new boundary edge, in lengths of that
    /// edge.
    pub(super) max_sagitta: f64,
    /// Squared sine of the smallest angle of a filling triangle, unless the star has a smaller one: between corners on a
    /// line a map may give a face any area.
    pub(super) min_squared_sine: f64,
}

/// Whether a triangle folds over its neighbour across an edge, both given by their cross products:
/// they turn away from each other by more than a right angle.
pub(super) fn folds_over(triangle: DVec3, neighbour: DVec3) -> bool {
    triangle.dot(neighbour) < 0.0
}

/// The squared sine of the smallest angle of a triangle, which lies between its two longest sides, from its cross product
/// and the squares of its sides.
pub(super) fn squared_sine(cross: DVec3, [x, y, z]: [f64; 3]) -> f64 {
    cross.length_squared() / (x * y).max(y * z).max(z * x)
}

#[derive(Debug, Clone, Default)]
pub(super) struct Star {
    pub(super) closed: bool,
    /// The neighbours, counter-clockwise.
    pub(super) ring: Vec<VertexId>,
    /// The side that leads to each neighbour; a boundary star's last neighbour has none.
    pub(super) halfedges: Vec<Halfedge>,
    /// Positions of the neighbours around the vertex in the plane, in m.
    pub(super) flat: Vec<DVec2>,
    /// Their positions in space, relative to the vertex, in m.
    pub(super) offsets: Vec<DVec3>,
    /// Sum of the faces' cross products: twice the star's area along its normal.
    pub(super) normal: DVec3,
    /// Squared sine of the smallest angle of its faces.
    pub(super) squared_sine: f64,
    /// Cross product of the face across each side of the ring; zero where there is none.
    pub(super) beyond: Vec<DVec3>,
}

impl Star {
    /// Gathers the star of `v` into the buffers of `self` and flattens it; `false` if its shape
    /// forbids the removal.
    pub(super) fn gather(
        &mut self,
        surface: &HalfedgeMesh,
        positions: &IdVec<VertexId, DVec3>,
        v: VertexId,
        limits: &Limits,
    ) -> bool {
        self.gather_ring(surface, v) && self.prepare(surface, positions, v, limits)
    }

    /// The neighbours and the sides that lead to them; `false` if they are too few or too many.
    pub(super) fn gather_ring(&mut self, surface: &HalfedgeMesh, v: VertexId) -> bool {
        self.ring.clear();
        self.halfedges.clear();
        self.closed = !surface.on_boundary[v];
        // A boundary vertex of one face alone would leave no polygon to fill. Vertices with more
        // than [`MAX_RING`] neighbours stay for now: filling their star costs the cube of that
        // number, and they are tried again when neighbours are removed.
        if !(3..=MAX_RING).contains(&(surface.degree[v] as usize)) {
            return false;
        }
        let mut ring = surface.ring(v);
        loop {
            let side = ring.halfedge();
            let Some(w) = ring.next() else { break };
            self.ring.push(w);
            if side != Halfedge::NONE {
                self.halfedges.push(side);
            }
        }
        true
    }

    /// Gathers the `sides` of the closed star `whole` of `v`, as if `v` were on a boundary; `false` if their
    /// shape forbids the removal.
    pub(super) fn gather_part(
        &mut self,
        whole: &Self,
        sides: std::ops::Range<usize>,
        surface: &HalfedgeMesh,
        positions: &IdVec<VertexId, DVec3>,
        (v, limits): (VertexId, &Limits),
    ) -> bool {
        let last = whole.ring[sides.end % whole.ring.len()];
        self.closed = false;
        self.ring.clear();
        self.ring.extend_from_slice(&whole.ring[sides.clone()]);
        self.ring.push(last);
        self.halfedges.clear();
        self.halfedges.extend_from_slice(&whole.halfedges[sides]);
        self.ring.len() >= 3 && self.prepare(surface, positions, v, limits)
    }

    /// Measures and flattens the gathered star of `v`; `false` if its shape forbids the removal.
    fn prepare(
        &mut self,
        surface: &HalfedgeMesh,
        positions: &IdVec<VertexId, DVec3>,
        v: VertexId,
        limits: &Limits,
    ) -> bool {
        self.offsets.clear();
        self.offsets.extend(self.ring.iter().map(|&w| positions[w] - positions[v]));
        let fits = if self.closed { self.has_depth(surface) } else { self.is_straight(surface, limits) };
        if !fits || !self.flatten() {
            return false;
        }
        self.look_beyond(surface, positions);
        true
    }

    /// Lays the ring around the vertex with the lengths of its edges and its angles scaled to a full turn, on
    /// a boundary to half a one (the conformal map `z^a` of `(lee1998)`, with `a` on the angles alone).
    fn flatten(&mut self) -> bool {
        let mut angles = [0.0; MAX_RING];
        let mut total = 0.0;
        self.normal = DVec3::ZERO;
        self.squared_sine = f64::INFINITY;
        for (i, angle) in angles.iter_mut().enumerate().take(self.halfedges.len()) {
            let (a, b) = (self.offsets[i], self.offsets[(i + 1) % self.ring.len()]);
            let cross = a.cross(b);
            *angle = cross.length().atan2(a.dot(b));
            if angle.is_nan() || *angle < MIN_ANGLE {
                return false;
            }
            total += *angle;
            self.normal += cross;
            let sides = [a.length_squared(), b.length_squared(), a.distance_squared(b)];
            self.squared_sine = self.squared_sine.min(squared_sine(cross, sides));
        }
        let scale = if self.closed { TAU } else { PI } / total;
        let mut turn = 0.0;
        self.flat.clear();
        for (p, angle) in self.offsets.iter().zip(angles) {
            self.flat.push(DVec2::from_angle(turn) * p.length());
            turn += angle * scale;
        }
        // A face of half a turn or more would have no inside in the plane.
        angles[..self.halfedges.len()].iter().all(|angle| angle * scale < PI - MIN_ANGLE)
    }

    /// Whether there is more than one face behind a closed star of three: filling it would close a
    /// pillow.
    fn has_depth(&self, surface: &HalfedgeMesh) -> bool {
        let behind = |i: usize| self.outside(surface, i);
        let [a, b] = [behind(0), behind(1)];
        self.ring.len() > 3 || a == Halfedge::NONE || b == Halfedge::NONE || a.face() != b.face()
    }

    /// Whether the boundary may run straight from the first neighbour to the last.
    fn is_straight(&self, surface: &HalfedgeMesh, limits: &Limits) -> bool {
        let last = self.ring.len() - 1;
        let (a, b) = (self.offsets[0], self.offsets[last]);
        let edge = b - a;
        let along = (-a.dot(edge) / edge.length_squared()).clamp(0.0, 1.0);
        let sagitta = (a + edge * along).length();
        // Written so that the NaN of an edge without length refuses.
        sagitta <= limits.max_sagitta * edge.length() && !surface.has_edge(self.ring[0], self.ring[last])
    }

    /// Sets the face across the closing edge of one side of the star `whole` of `v`: a triangle of its ring.
    pub(super) fn look_across(
        &mut self,
        triangle: Option<&[u8; 3]>,
        whole: &Self,
        positions: &IdVec<VertexId, DVec3>,
    ) {
        let (Some(t), Some(last)) = (triangle, self.ring.len().checked_sub(1)) else { return };
        self.beyond[last] = triangle_cross(t.map(|i| positions[whole.ring[usize::from(i)]]));
    }

    fn outside(&self, surface: &HalfedgeMesh, i: usize) -> Halfedge {
        surface.twin(self.halfedges[i].next())
    }

    /// Measures the faces around the star. A face that already folds over the star sets no limit: else the
    /// vertex could never be removed.
    fn look_beyond(&mut self, surface: &HalfedgeMesh, positions: &IdVec<VertexId, DVec3>) {
        self.beyond.clear();
        self.beyond.resize(self.ring.len(), DVec3::ZERO);
        for i in 0..self.halfedges.len() {
            let twin = self.outside(surface, i);
            if twin != Halfedge::NONE {
                let normal = surface.face_cross(twin.face(), positions);
                let own = self.offsets[i].cross(self.offsets[(i + 1) % self.ring.len()]);
                if own.dot(normal) > 0.0 {
                    self.beyond[i] = normal;
                }
            }
        }
    }
}
