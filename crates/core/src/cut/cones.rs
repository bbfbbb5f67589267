//! Cones: where the skin must stretch most unless the seam reaches them.
//!
//! A conformal map has the conformal factor `u`, the logarithm of its stretch, with `L u = K`: the
//! cotangent Laplacian and the Gauss curvature of each vertex. On a seam and at a boundary curvature
//! is free, and `u` is zero. The vertex of the largest `|u|` is what the seam reaches next
//! (`(benchen2008)`, with the seam instead of single cones).

use std::f64::consts::TAU;

use glam::DVec3;

use crate::id::{IdVec, VertexId};
use crate::mesh::{FlatTriangle, TriMesh, angle};
use crate::sparse::{Cholesky, Matrix, Pattern};

/// Two vertices stretch equally if they differ by less than this share: the one of the smaller number is
/// taken, however the surface is turned.
const EQUAL: f64 = 1e-6;

/// The equation of the conformal factor on a mesh.
#[derive(Debug)]
pub(super) struct ConformalFactor {
    pattern: Pattern,
    cholesky: Cholesky,
    /// Rows, columns and entries of the cotangent Laplacian.
    laplacian: Vec<(usize, usize, f64)>,
    /// Gauss curvature of each vertex, in rad.
    curvature: Vec<f64>,
    /// Share of each vertex in the area.
    shares: Vec<f64>,
}

impl ConformalFactor {
    /// `None` if the equation cannot be set up.
    pub(super) fn new(mesh: &TriMesh) -> Option<Self> {
        let count = mesh.positions.len();
        let unit = mesh.area().sqrt();
        let scaled: Vec<DVec3> = mesh.positions.iter().map(|&p| p / unit).collect();
        let sides = mesh.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
        let pattern = Pattern::new(count, sides.map(|(a, b)| (a.index(), b.index())));
        let cholesky = Cholesky::new(&pattern, &scaled).ok()?;
        let (mut laplacian, mut curvature, mut shares) = (Vec::new(), vec![TAU; count], vec![0.0; count]);
        for corners in &mesh.triangles {
            let corners = corners.map(VertexId::index);
            let [a, b, c] = corners.map(|v| scaled[v]);
            let flat = FlatTriangle::new([a, b, c]);
            let (area, gradients) = (flat.area(), flat.gradients());
            // A face without area stretches nothing.
            if !(area > 0.0 && gradients.iter().all(|g| g.is_finite())) {
                continue;
            }
            for (i, at) in [angle(a, b, c), angle(b, c, a), angle(c, a, b)].into_iter().enumerate() {
                curvature[corners[i]] -= at;
                shares[corners[i]] += area / 3.0;
                for j in 0..3 {
                    laplacian.push((corners[i], corners[j], area * gradients[i].dot(gradients[j])));
                }
            }
        }
        Some(Self { pattern, cholesky, laplacian, curvature, shares })
    }

    /// The conformal factor where it is zero at the vertices that are `fixed`; if none is, that of evenly
    /// spread curvature, with mean zero.
    fn solve(&self, fixed: &IdVec<VertexId, bool>) -> Option<Vec<f64>> {
        let is_closed = !fixed.iter().any(|&is| is);
        let total: f64 = if is_closed { self.curvature.iter().sum() } else { 0.0 };
        let is_free = |v: usize| if is_closed { v > 0 } else { !fixed[VertexId::new(v)] };
        let mut matrix = Matrix::<f64>::zero(&self.pattern);
        for &(row, column, entry) in self.laplacian.iter().filter(|x| is_free(x.0) && is_free(x.1)) {
            *matrix.at(row, column) += entry;
        }
        let mut u = vec![0.0; self.curvature.len()];
        for (v, at) in u.iter_mut().enumerate() {
            // A vertex between faces without area counts as fixed.
            if is_free(v) && matrix.diagonal(v) > 0.0 {
                *at = self.curvature[v] - total * self.shares[v];
            } else {
                *matrix.at(v, v) = 1.0;
            }
        }
        self.cholesky.factor(&matrix).ok()?.solve(&mut u).ok()?;
        if is_closed {
            let mean: f64 = u.iter().zip(&self.shares).map(|(u, share)| u * share).sum();
            u.iter_mut().for_each(|u| *u -= mean);
        }
        u.iter().all(|u| u.is_finite()).then_some(u)
    }

    /// The vertex that a seam through the vertices that are `fixed` should reach next, and the size of the
    /// conformal factor there; `None` if that is zero everywhere.
    pub(super) fn next_cone(&self, fixed: &IdVec<VertexId, bool>) -> Option<(VertexId, f64)> {
        let u = self.solve(fixed)?;
        let most = u.iter().fold(0.0_f64, |most, u| most.max(u.abs()));
        let first = u.iter().position(|u| *u != 0.0 && u.abs() >= most * (1.0 - EQUAL));
        first.map(|v| (VertexId::new(v), most))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    /// Cones are added until all curvature is at them: on a box at its eight corners. Flat skin needs none.
    #[test]
    fn the_cones_of_a_box_are_its_corners() {
        let mesh = shapes::frame(0, 4, 0.01);
        let factor = ConformalFactor::new(&mesh).unwrap();
        let mut fixed = IdVec::filled(false, mesh.positions.len());
        let mut cones = Vec::new();
        while let Some((cone, most)) = factor.next_cone(&fixed).filter(|(_, most)| *most > 1e-9) {
            assert!(most > 0.1 && cones.len() < 8, "{most} at cone {}", cones.len());
            fixed[cone] = true;
            cones.push(mesh.positions[cone]);
        }
        assert_eq!(cones.len(), 8);
        let centre: DVec3 = cones.iter().sum::<DVec3>() / 8.0;
        let corner = mesh.positions.iter().fold(DVec3::ZERO, |most, &p| most.max((p - centre).abs()));
        assert!(cones.iter().all(|p| (*p - centre).abs().distance(corner) < 1e-12), "{cones:?}");
    }

    #[test]
    fn a_flat_sheet_has_no_cones() {
        let mesh = shapes::lattice(5, 5, 0.01);
        let factor = ConformalFactor::new(&mesh).unwrap();
        let on_boundary = |v: VertexId| {
            let p = mesh.positions[v];
            mesh.positions.iter().filter(|q| q.distance(p) < 0.0101).count() < 7
        };
        let fixed = mesh.positions.ids().map(on_boundary).collect();
        assert!(factor.next_cone(&fixed).is_none_or(|(_, most)| most < 1e-12));
    }
}
