use glam::{DMat2, DVec2};
use rayon::prelude::*;

use crate::{
    flatten::{
        bijective::barrier::Barrier,
        domain::elements::{Element, FIXED, Net, Stars},
        energy::density::{Density, LocalModel, outer},
        jacobian::Singular,
    },
    id::{IdVec, VertexId},
    sparse::Matrix,
};

/// Elements that one task handles; fixed, so that sums do not depend on the number of threads.
const FACES_PER_TASK: usize = 2048;

/// Share of the step to the first collapsed face that is taken at most.
const STEP_TO_COLLAPSE: f64 = 0.9;

/// The energy of a map of a net, with its gradient and a convex model of its Hessian.
#[derive(Debug)]
pub(crate) struct Problem<'n> {
    pub(crate) net: &'n Net,
    pub(crate) density: Density,
    /// Weight of the perimeter term, `l3`.
    pub(crate) perimeter: f64,
    /// Keeps the boundary from crossing itself, if there is one.
    barrier: Option<Barrier>,
    stars: Stars,
}

impl<'n> Problem<'n> {
    pub(crate) fn new(net: &'n Net, density: Density, perimeter: f64) -> Self {
        Self { net, density, perimeter, barrier: None, stars: Stars::new(net) }
    }

    /// The same with a boundary that must not cross itself.
    pub(crate) fn with_barrier(self, barrier: Barrier) -> Self {
        Self { barrier: Some(barrier), ..self }
    }

    /// `f` of every part of the faces, in order.
    fn each_part<T: Send>(&self, f: impl Fn(&[Element]) -> T + Sync + Send) -> Vec<T> {
        self.net.elements.as_slice().par_chunks(FACES_PER_TASK).map(f).collect()
    }

    /// The energy; infinite if a face is flipped and the density has a barrier, or if the boundary has one and crosses
    /// itself or turns a hole inside out.
    pub(crate) fn energy(&self, uv: &IdVec<VertexId, DVec2>) -> f64 {
        let face = |e: &Element| e.weight * self.density.value(&singular(e, uv));
        let parts = self.each_part(|part| part.iter().map(face).sum::<f64>());
        let repulsion = self.barrier.as_ref().map_or(0.0, |b| b.energy(uv));
        parts.iter().sum::<f64>() + self.perimeter_energy(uv) + repulsion
    }

    /// `l3 h sum_b L_b (r_b + 1/r_b)/2`.
    fn perimeter_energy(&self, uv: &IdVec<VertexId, DVec2>) -> f64 {
        if self.perimeter == 0.0 {
            return 0.0;
        }
        let scale = 0.5 * self.perimeter * self.net.mean_edge;
        let term = |&([a, b], length): &([VertexId; 2], f64)| {
            let r = uv[a].distance(uv[b]) / length;
            scale * length * (r + 1.0 / r)
        };
        self.net.boundary.iter().map(term).sum()
    }

    /// Gradient by the movable vertices, and projected Hessian, at `uv`.
    pub(crate) fn assemble(
        &self,
        uv: &IdVec<VertexId, DVec2>,
        hessian: &mut Matrix<'_, DMat2>,
    ) -> Vec<DVec2> {
        let model = |e: &Element| LocalModel::new(&self.density, &singular(e, uv), &e.gradients, e.weight);
        let models: Vec<LocalModel> =
            self.net.elements.as_slice().par_iter().with_min_len(FACES_PER_TASK).map(model).collect();
        let pattern = hessian.pattern();
        hessian.fill_rows(|row, blocks| {
            let first = pattern.slots(row).start;
            for corner in self.stars.of(row) {
                let (m, k) = (&models[corner.face.index()], corner.corner as usize);
                let of_corner = [m.diagonal[k], m.beside[k], m.beside[(k + 2) % 3].transpose()];
                for (slot, block) in corner.slots.into_iter().zip(of_corner) {
                    if slot != FIXED {
                        blocks[slot as usize - first] += block;
                    }
                }
            }
        });
        let force = |row: usize| -> DVec2 {
            self.stars.of(row).iter().map(|c| models[c.face.index()].gradient[c.corner as usize]).sum()
        };
        let mut gradient: Vec<DVec2> =
            (0..self.net.free()).into_par_iter().with_min_len(FACES_PER_TASK).map(force).collect();
        self.add_perimeter(uv, &mut gradient, hessian);
        if let Some(barrier) = &self.barrier {
            barrier.add(uv, &mut gradient, hessian);
        }
        gradient
    }

    fn add_perimeter(
        &self,
        uv: &IdVec<VertexId, DVec2>,
        gradient: &mut [DVec2],
        hessian: &mut Matrix<'_, DMat2>,
    ) {
        if self.perimeter == 0.0 {
            return;
        }
        let scale = 0.5 * self.perimeter * self.net.mean_edge;
        for &([a, b], length) in &self.net.boundary {
            let edge = uv[b] - uv[a];
            let stretched = edge.length();
            let (r, along) = (stretched / length, edge / stretched);
            // r + 1/r: slope and curvature along the edge, slope over length across it.
            let slope = scale * (1.0 - 1.0 / (r * r));
            let curvature = scale * 2.0 / (r * r * r) / length;
            let across = (slope / stretched).max(0.0);
            let block = outer(along, along) * (curvature - across) + DMat2::IDENTITY * across;
            let (a, b) = (a.index(), b.index());
            gradient[b] += slope * along;
            gradient[a] -= slope * along;
            *hessian.at(a, a) += block;
            *hessian.at(b, b) += block;
            *hessian.at(a, b) -= block;
            *hessian.at(b, a) -= block;
        }
    }

    /// The largest share of the step `d` of the movable vertices that collapses no face, at most 1.
    pub(crate) fn largest_step(&self, uv: &IdVec<VertexId, DVec2>, d: &[DVec2]) -> f64 {
        if !self.density.has_barrier() {
            return 1.0;
        }
        let parts =
            self.each_part(|part| part.iter().map(|e| collapse(e, uv, d)).fold(f64::INFINITY, f64::min));
        (STEP_TO_COLLAPSE * parts.into_iter().fold(f64::INFINITY, f64::min)).min(1.0)
    }
}

fn singular(e: &Element, uv: &IdVec<VertexId, DVec2>) -> Singular {
    let [a, b, c] = e.corners.map(|v| uv[v]);
    let [g0, g1, g2] = e.gradients;
    Singular::of(&(outer(a, g0) + outer(b, g1) + outer(c, g2)))
}

/// The smallest positive step along `d` at which the face's area is zero; infinite if there is none.
fn collapse(e: &Element, uv: &IdVec<VertexId, DVec2>, d: &[DVec2]) -> f64 {
    let [a, b, c] = e.corners.map(|v| uv[v]);
    let [da, db, dc] = e.corners.map(|v| d.get(v.index()).copied().unwrap_or(DVec2::ZERO));
    let (p, q, dp, dq) = (b - a, c - a, db - da, dc - da);
    // area(t) = c0 + c1 t + c2 t^2.
    let (c0, c1, c2) = (p.perp_dot(q), p.perp_dot(dq) + dp.perp_dot(q), dp.perp_dot(dq));
    let discriminant = c1 * c1 - 4.0 * c2 * c0;
    if discriminant < 0.0 {
        return f64::INFINITY;
    }
    let half = -0.5 * (c1 + discriminant.sqrt().copysign(c1));
    [half / c2, c0 / half].into_iter().filter(|t| *t > 0.0).fold(f64::INFINITY, f64::min)
}
