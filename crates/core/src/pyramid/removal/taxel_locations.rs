//! The locations of taxels that are no longer vertices: the face, and the weights in it.

use glam::DVec2;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Halfedge, HalfedgeMesh};
use crate::parallel::par_map;
use crate::pyramid::removal::star::Star;

/// End of a list of taxels.
const NONE: u32 = u32::MAX;

/// The location of a taxel that is no longer a vertex.
#[derive(Debug, Clone, Copy)]
struct TaxelLocation {
    face: FaceId,
    /// Weights of the face's corners, in its order.
    weights: [f64; 3],
}

/// The locations of all taxels of level 0 on the current level: on a vertex, or inside a face that lists
/// them.
#[derive(Debug, Clone)]
pub(crate) struct TaxelLocations {
    /// By level-0 vertex; meaningless for those that are still vertices.
    locations: IdVec<VertexId, TaxelLocation>,
    next: Vec<u32>,
    heads: IdVec<FaceId, u32>,
}

/// A taxel with its new location: a filling triangle and the weights of its corners.
#[derive(Debug, Clone, Copy)]
pub(super) struct Move {
    pub(super) taxel: VertexId,
    pub(super) triangle: u8,
    pub(super) weights: [f64; 3],
}

impl TaxelLocations {
    /// All taxels on vertices.
    pub(crate) fn new(taxels: usize, faces: usize) -> Self {
        let nowhere = TaxelLocation { face: FaceId::default(), weights: [1.0, 0.0, 0.0] };
        Self {
            locations: IdVec::filled(nowhere, taxels),
            next: vec![NONE; taxels],
            heads: IdVec::filled(NONE, faces),
        }
    }

    fn inside(&self, face: FaceId) -> impl Iterator<Item = VertexId> {
        let mut at = self.heads[face];
        std::iter::from_fn(move || {
            let taxel = (at != NONE).then(|| VertexId::from(at))?;
            at = self.next[taxel.index()];
            Some(taxel)
        })
    }

    /// New locations for the taxels inside `star`, whose vertex is the taxel `centre`, in the triangles that
    /// fill it.
    pub(super) fn plan(&self, star: &Star, centre: VertexId, filling: &[[u8; 3]], moves: &mut Vec<Move>) {
        moves.push(locate(star, filling, centre, DVec2::ZERO));
        self.plan_inside(star, filling, moves);
    }

    /// As [`Self::plan`], without the vertex of the star.
    pub(super) fn plan_inside(&self, star: &Star, filling: &[[u8; 3]], moves: &mut Vec<Move>) {
        for (i, side) in star.halfedges.iter().enumerate() {
            let (a, b) = (star.flat[i], star.flat[(i + 1) % star.flat.len()]);
            for taxel in self.inside(side.face()) {
                // The side starts at the star's vertex, which is at zero.
                let weights = self.locations[taxel].weights;
                let (p, q) = (weights[side.next().side()], weights[side.previous().side()]);
                moves.push(locate(star, filling, taxel, a * p + b * q));
            }
        }
    }

    /// Applies the moves of one star, whose faces become its filling, in order.
    pub(super) fn carry(&mut self, star: &[Halfedge], moves: &[Move]) {
        for side in star {
            self.heads[side.face()] = NONE;
        }
        for &Move { taxel, triangle, weights } in moves {
            let face = star[usize::from(triangle)].face();
            self.locations[taxel] = TaxelLocation { face, weights };
            self.next[taxel.index()] = self.heads[face];
            self.heads[face] = taxel.raw();
        }
    }

    /// Follows [`HalfedgeMesh::compact`].
    pub(crate) fn compact(&mut self, faces: &IdVec<FaceId, FaceId>, count: usize) {
        let mut heads = IdVec::filled(NONE, count);
        for (old, &head) in self.heads.enumerate() {
            if head != NONE {
                heads[faces[old]] = head;
            }
        }
        for at in self.locations.iter_mut() {
            at.face = faces[at.face];
        }
        self.heads = heads;
    }

    /// The corners and weights on `surface` of `taxels`, the taxels here in another order, whose vertices are
    /// the taxels `origins`. All three indices of a row are the corners of one face, also where one weight is
    /// 1.
    pub(crate) fn rows(
        &self,
        surface: &HalfedgeMesh,
        taxels: &IdVec<VertexId, VertexId>,
        origins: &IdVec<VertexId, VertexId>,
    ) -> (IdVec<VertexId, [VertexId; 3]>, IdVec<VertexId, [f64; 3]>) {
        let mut indices =
            IdVec::from(par_map(taxels.as_slice(), |&taxel| surface.corners(self.locations[taxel].face)));
        let mut weights = IdVec::from(par_map(taxels.as_slice(), |&taxel| self.locations[taxel].weights));
        for (v, &taxel) in origins.enumerate() {
            let side = surface.leaving[v];
            let corners = surface.corners(side.face());
            indices[taxel] = [0, 1, 2].map(|k| corners[(side.side() + k) % 3]);
            weights[taxel] = [1.0, 0.0, 0.0];
        }
        (indices, weights)
    }
}

/// The triangle of `filling` that contains `point` (up to rounding), and the weights of `point` in it.
#[inline]
fn locate(star: &Star, filling: &[[u8; 3]], taxel: VertexId, point: DVec2) -> Move {
    let mut best = (f64::NEG_INFINITY, 0, [1.0, 0.0, 0.0]);
    for (triangle, corners) in (0_u8..).zip(filling) {
        let [a, b, c] = corners.map(|i| star.flat[usize::from(i)]);
        let area = (b - a).perp_dot(c - a);
        let wa = (b - point).perp_dot(c - point) / area;
        let wb = (c - point).perp_dot(a - point) / area;
        let weights = [wa, wb, 1.0 - wa - wb];
        let least = weights[0].min(weights[1]).min(weights[2]);
        if least > best.0 {
            best = (least, triangle, weights);
        }
        if least >= 0.0 {
            break;
        }
    }
    let clamped = best.2.map(|w| w.max(0.0));
    let sum: f64 = clamped.iter().sum();
    Move { taxel, triangle: best.1, weights: clamped.map(|w| w / sum) }
}
