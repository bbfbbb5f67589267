//! The energy of a whole map, and the quadratic model of it that a Newton step minimises.
//!
//! ```text
//! E(uv) = sum over faces of A E_face(s1, s2)
//!       + l3 h sum over boundary edges of L (r + 1/r)/2
//! ```
//!
//! with `A` the share of the area, `L` the length of an edge and `r` its stretch, `h` the mean edge (so that
//! the perimeter term does not grow as a mesh is refined); eq. (4) of `(cannata)`. Sums run in fixed groups,
//! so results do not depend on the number of threads.

use std::ops::Range;

use glam::{DMat2, DVec2};

use crate::flatten::Energy;
use crate::flatten::energy::assembly::Assembly;
use crate::flatten::energy::elements::{BoundaryEdge, Element, ElementMesh, Uv, outer};
use crate::flatten::energy::face_energy::{DistortionEnergy, LocalModel, face_gradient};
use crate::id::FaceId;
use crate::mesh::SymmetricDirichlet;
use crate::parallel::{par_each, par_parts, par_sum};
use crate::sparse::{Block, Matrix, dot};

/// Largest share of the step to the first collapsed face that is taken.
const STEP_TO_COLLAPSE: f64 = 0.9;

/// Slightly above the inverse of [`STEP_TO_COLLAPSE`]: a face that keeps its area up to this multiple of the
/// step does not limit it.
const NO_COLLAPSE: f64 = 1.12;

/// The energy of a map, with its gradient and a convex model of its Hessian.
#[derive(Debug)]
pub(crate) struct Objective<'e> {
    pub(crate) elements: &'e ElementMesh,
    energy: DistortionEnergy,
    /// Weight of the perimeter term, `l3`.
    perimeter: f64,
}

impl<'e> Objective<'e> {
    /// The energy of the options.
    pub(crate) fn new(elements: &'e ElementMesh, energy: Energy) -> Self {
        let perimeter = match energy {
            Energy::Sum { perimeter, .. } => perimeter,
            Energy::SymmetricDirichlet => 0.0,
        };
        Self { perimeter, ..Self::of_faces(elements, energy.into()) }
    }

    pub(crate) fn of_faces(elements: &'e ElementMesh, energy: DistortionEnergy) -> Self {
        Self { elements, energy, perimeter: 0.0 }
    }

    /// The same energy on other elements.
    pub(crate) fn on<'f>(&self, elements: &'f ElementMesh) -> Objective<'f> {
        Objective { elements, ..*self }
    }

    /// The energy; infinite if a face is flipped and the energy has a barrier.
    pub(crate) fn energy(&self, uv: &Uv) -> f64 {
        let faces = &self.elements.faces;
        let of_faces: f64 = par_sum(faces.len(), |face| {
            let e = &faces[FaceId::new(face)];
            e.weight * self.energy.value(&e.jacobian(uv))
        });
        of_faces + self.perimeter_energy(uv)
    }

    /// `l3 h sum_b L_b (r_b + 1/r_b)/2`.
    fn perimeter_energy(&self, uv: &Uv) -> f64 {
        if self.perimeter == 0.0 {
            return 0.0;
        }
        let scale = 0.5 * self.perimeter * self.elements.mean_edge;
        let term = |&BoundaryEdge { ends: [a, b], length }: &BoundaryEdge| {
            let r = uv[a].distance(uv[b]) / length;
            scale * length * (r + 1.0 / r)
        };
        self.elements.boundary.iter().map(term).sum()
    }

    /// Minus the gradient by the movable vertices at `uv`; `hessian` gets the Hessian, with a share `kept` of
    /// the negative curvatures of the faces.
    pub(crate) fn assemble<B: Block>(
        &self,
        uv: &Uv,
        assembly: &Assembly,
        hessian: &mut Matrix<'_, B>,
        kept: f64,
    ) -> Vec<DVec2> {
        let model =
            |e: &Element| LocalModel::new(&self.energy, &e.jacobian(uv), &e.gradients, e.weight, kept);
        let mut downhill = assembly.sum(&self.elements.faces, model, hessian);
        for (ends @ [a, b], force, block) in self.perimeter_terms(uv) {
            for i in ends {
                *hessian.at(i, i) += B::of(block);
            }
            *hessian.at(a, b) += B::of(-block);
            *hessian.at(b, a) += B::of(-block);
            downhill[b] -= force;
            downhill[a] += force;
        }
        // The rows of held vertices are empty: these do not move.
        for i in self.elements.held_vertices() {
            *hessian.at(i, i) = B::of(DMat2::IDENTITY);
        }
        downhill
    }

    /// Gradient by the movable vertices alone.
    fn gradient(&self, uv: &Uv) -> Vec<DVec2> {
        let mut gradient = vec![DVec2::ZERO; self.elements.free()];
        let faces = &self.elements.faces;
        let of_face = |face| {
            let e: &Element = &faces[face];
            face_gradient(&self.energy, &e.jacobian(uv), &e.gradients, e.weight)
        };
        par_each(faces.len(), of_face, |face, forces| {
            for (v, force) in faces[face].corners.into_iter().zip(forces) {
                if let Some(sum) = gradient.get_mut(v.index()) {
                    *sum += force;
                }
            }
        });
        for ([a, b], force, _) in self.perimeter_terms(uv) {
            gradient[b] += force;
            gradient[a] -= force;
        }
        self.elements.held_vertices().for_each(|i| gradient[i] = DVec2::ZERO);
        gradient
    }

    /// Length of the gradient at `uv` over the energy: 0 at a minimum. Lengths are those of the
    /// elements.
    pub(crate) fn relative_gradient(&self, uv: &Uv) -> f64 {
        let gradient = self.gradient(uv);
        dot(&gradient, &gradient).sqrt() / self.energy(uv)
    }

    /// The contribution of each boundary edge to the perimeter term: its ends, the force on its second end
    /// (that on the first is opposite), and the block of the Hessian for each end.
    fn perimeter_terms(&self, uv: &Uv) -> impl Iterator<Item = ([usize; 2], DVec2, DMat2)> {
        let scale = 0.5 * self.perimeter * self.elements.mean_edge;
        // Loops are held as a whole, so their length is constant.
        let is_free = |edge: &&BoundaryEdge| !self.elements.is_held(edge.ends[0].index());
        let edges = self.elements.boundary.iter().filter(|_| self.perimeter != 0.0).filter(is_free);
        edges.map(move |&BoundaryEdge { ends: [a, b], length }| {
            let edge = uv[b] - uv[a];
            let stretched = edge.length();
            let (r, along) = (stretched / length, edge / stretched);
            // r + 1/r: slope and curvature along the edge, slope over length across it.
            let slope = scale * (1.0 - 1.0 / (r * r));
            let curvature = scale * 2.0 / (r * r * r) / length;
            let across = (slope / stretched).max(0.0);
            let block = outer(along, along) * (curvature - across) + DMat2::IDENTITY * across;
            ([a.index(), b.index()], slope * along, block)
        })
    }

    /// The largest share of the step `d` of the movable vertices that collapses no face, at most 1.
    pub(crate) fn largest_step(&self, uv: &Uv, d: &[DVec2]) -> f64 {
        if !self.energy.has_barrier() {
            return 1.0;
        }
        let faces: &[Element] = self.elements.faces.as_slice();
        let first =
            |part: Range<usize>| faces[part].iter().map(|e| collapse(e, uv, d)).fold(f64::INFINITY, f64::min);
        let parts = par_parts(faces.len(), first);
        (STEP_TO_COLLAPSE * parts.into_iter().fold(f64::INFINITY, f64::min)).min(1.0)
    }
}

/// The symmetric Dirichlet energy of a map.
pub(crate) fn dirichlet(elements: &ElementMesh, uv: &Uv) -> SymmetricDirichlet {
    let mut sums = SymmetricDirichlet::default();
    for e in &elements.faces {
        let s = e.singular_values(uv);
        sums.add(e.weight, s.s1, s.s2);
    }
    sums
}

/// The smallest positive step along `d` at which the face's area is zero; infinite if there is
/// none.
fn collapse(e: &Element, uv: &Uv, d: &[DVec2]) -> f64 {
    let [a, b, c] = e.corners.map(|v| uv[v]);
    let [da, db, dc] = e.corners.map(|v| d.get(v.index()).copied().unwrap_or(DVec2::ZERO));
    let (p, q, dp, dq) = (b - a, c - a, db - da, dc - da);
    // area(t) = c0 + c1 t + c2 t^2.
    let (c0, c1, c2) = (p.perp_dot(q), p.perp_dot(dq) + dp.perp_dot(q), dp.perp_dot(dq));
    // Nearly all faces: no root, no division.
    if c0 > NO_COLLAPSE * (c1.abs() + NO_COLLAPSE * c2.abs()) {
        return f64::INFINITY;
    }
    let discriminant = c1 * c1 - 4.0 * c2 * c0;
    if discriminant < 0.0 {
        return f64::INFINITY;
    }
    let half = -0.5 * (c1 + discriminant.sqrt().copysign(c1));
    [half / c2, c0 / half].into_iter().filter(|t| *t > 0.0).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{flatten::domain::FlattenDomain, id::VertexId, mesh::shapes};

    /// Far from an isometry, where many faces have negative curvatures.
    #[test]
    fn with_all_negative_curvatures_the_model_is_the_hessian() {
        let mesh = shapes::saddle(6);
        let domain = FlattenDomain::new(&mesh).unwrap();
        let uv: Uv = (0..domain.vertices())
            .map(|v| 0.6 * domain.position(VertexId::new(v)).truncate())
            .map(|p| p + 0.2 * DVec2::new(p.y * p.y, p.x * p.y))
            .collect();
        let objective = Objective::new(&domain.elements, Energy::SymmetricDirichlet);
        let assembly = Assembly::new(&domain.elements);
        let assembled = |uv: &Uv, kept: f64| {
            let mut hessian = Matrix::<DMat2>::zero(domain.elements.pattern());
            let downhill = objective.assemble(uv, &assembly, &mut hessian, kept);
            (downhill, hessian)
        };
        let (_, mut whole) = assembled(&uv, 1.0);
        let (_, mut clamped) = assembled(&uv, 0.0);
        let mut left_out = 0.0_f64;
        for v in (0..domain.vertices()).step_by(5).map(VertexId::new) {
            for axis in [DVec2::X, DVec2::Y] {
                let downhill = |by: f64| {
                    let mut moved = uv.clone();
                    moved[v] += by * axis;
                    assembled(&moved, 0.0).0[v.index()]
                };
                let curvature = (downhill(-1e-6) - downhill(1e-6)) / 2e-6;
                let found = *whole.at(v.index(), v.index()) * axis;
                assert!((found - curvature).length() < 1e-5 * found.length(), "{v}: {found} is {curvature}");
                left_out = left_out.max((*clamped.at(v.index(), v.index()) * axis - found).length());
            }
        }
        assert!(left_out > 0.1, "the convex model leaves out {left_out}");
    }

    /// A saddle, projected to the plane and sheared, so that nothing is stationary.
    #[test]
    fn gradient_and_hessian_are_those_of_differences() {
        let mesh = shapes::saddle(8);
        let domain = FlattenDomain::new(&mesh).unwrap();
        // Near an isometry the model is the Hessian except for the clamped curvatures, which are of the order
        // of the strain.
        let uv: Uv = (0..domain.vertices())
            .map(|v| domain.position(VertexId::new(v)).truncate())
            .map(|p| p + 0.05 * DVec2::new(p.y * p.y, p.x * p.y))
            .collect();
        for energy in [Energy::SymmetricDirichlet, Energy::Sum { angle: 1.0, area: 0.4, perimeter: 0.2 }] {
            let objective = Objective::new(&domain.elements, energy);
            let assembly = Assembly::new(&domain.elements);
            let mut hessian = Matrix::<DMat2>::zero(domain.elements.pattern());
            let downhill = objective.assemble(&uv, &assembly, &mut hessian, 0.0);
            let gradient = objective.gradient(&uv);
            assert!(
                downhill.iter().zip(&gradient).all(|(d, g)| *d == -*g),
                "{energy:?}: the same without the Hessian"
            );
            let scale = gradient.iter().map(|g| g.length()).fold(0.0, f64::max);
            let step = 1e-6;
            for v in (0..domain.vertices()).step_by(7).map(VertexId::new) {
                for axis in [DVec2::X, DVec2::Y] {
                    let moved = |by: f64| {
                        let mut moved = uv.clone();
                        moved[v] += by * axis;
                        moved
                    };
                    let slope =
                        (objective.energy(&moved(step)) - objective.energy(&moved(-step))) / (2.0 * step);
                    let found = gradient[v.index()].dot(axis);
                    assert!((found - slope).abs() < 1e-6 * scale, "{energy:?} {v}: {found} is {slope}");
                    let (up, down) = (objective.gradient(&moved(step)), objective.gradient(&moved(-step)));
                    let curvature = (up[v.index()] - down[v.index()]) / (2.0 * step);
                    let found = *hessian.at(v.index(), v.index()) * axis;
                    let size = found.length();
                    // Clamping only adds curvature.
                    let added = (found - curvature).dot(axis);
                    assert!(added > -1e-6 * size, "{energy:?} {v}: {found} is {curvature}");
                    assert!(added < 0.6 * size, "{energy:?} {v}: {found} is {curvature}");
                }
            }
        }
    }
}
