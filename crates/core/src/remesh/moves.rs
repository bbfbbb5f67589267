//! Smoothing: vertices move to the centre of their neighbours, and back to the surface or their line.

use glam::DVec3;
use rayon::prelude::*;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Halfedge, HalfedgeMesh};
use crate::parallel::par_ids;
use crate::remesh::rounds::{Freedom, Rounds};
use crate::remesh::surface::Projection;

/// Steps of smoothing in each round.
const STEPS: usize = 3;

impl Rounds<'_> {
    /// Moves every vertex to the centre of its neighbours in a few steps, and back to the surface or its
    /// line. A free vertex that cannot reach the surface without turning a face over returns to its old
    /// position.
    pub(super) fn smooth(&mut self) {
        let before = self.positions.clone();
        for _ in 0..STEPS {
            self.move_all(Self::relaxed);
        }
        let goals = self.move_all(Self::projected);
        for (v, goal) in goals.enumerate() {
            if self.freedom[v] == Freedom::Surface && *goal != Some(self.positions[v]) {
                self.positions[v] = before[v];
            }
        }
        self.move_back(&before);
    }

    /// Moves the vertices as far as their faces allow; returns the target of each.
    fn move_all(
        &mut self,
        to: impl Fn(&Self, VertexId) -> Option<Projection> + Sync,
    ) -> IdVec<VertexId, Option<DVec3>> {
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
        self.move_back(&old);
        moved.map(|moved| moved.as_ref().map(|moved| moved.point))
    }

    /// Moves the corners of faces that have turned over or become thin back to their old positions; repeats,
    /// since this may turn neighbouring faces over, until no face has.
    fn move_back(&mut self, old: &IdVec<VertexId, DVec3>) {
        loop {
            let is_bad = |&face: &FaceId| {
                let corners = self.mesh.corners(face);
                let [was, is] = [old, &self.positions].map(|all| corners.map(|v| all[v]));
                self.mesh.is_alive(face) && was != is && !self.fits(was, is)
            };
            let faces = (0..self.mesh.face_count()).into_par_iter().map(FaceId::new);
            let bad: Vec<FaceId> = faces.filter(is_bad).collect();
            if bad.is_empty() {
                return;
            }
            for v in bad.into_iter().flat_map(|face| self.mesh.corners(face)) {
                self.positions[v] = old[v];
            }
        }
    }

    /// For a free vertex the centre of the faces around it, in its tangent plane; on a line the midpoint of
    /// its two neighbours.
    fn relaxed(&self, v: VertexId) -> Option<Projection> {
        let from = self.positions[v];
        match self.freedom[v] {
            Freedom::Fixed => None,
            Freedom::Surface => {
                let (mut sum, mut total, mut normal) = (DVec3::ZERO, 0.0, DVec3::ZERO);
                for h in self.mesh.leaving(v) {
                    let cross = self.cross(h.face());
                    let corners = [self.mesh.target(h), self.mesh.apex(h)].map(|w| self.positions[w]);
                    // Centres of the faces, weighted by their areas, even out the sizes of faces.
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
                // Where lines have merged, the line along which it may move is ambiguous.
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
        self.surface.nearest(self.positions[v], self.normal(v), self.near[v])
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
