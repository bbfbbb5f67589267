//! The linear map: conformal and authalic rows mixed, two vertices pinned or the outer boundary prescribed, one
//! sparse solve (`(desbrun2002)`).
//!
//! Nothing guarantees a map without flips or overlaps: see
//! [`Method::Linear`](crate::flatten::Method::Linear).

use glam::{DVec2, DVec3};

use crate::flatten::FlattenError;
use crate::flatten::domain::FlattenDomain;
use crate::flatten::energy::elements::Uv;
use crate::flatten::start::conformal::conformal_matrix;
use crate::id::VertexId;
use crate::mesh::cotangent;
use crate::sparse::{Matrix, solve_unsymmetric};

/// Cotangents are clamped as if no angle were under a thousandth of a degree: one sliver would
/// otherwise outweigh every ring.
const MAX_COTAN: f64 = 57_296.0;

/// Authalic weight of the edge `i -> j` in the face `i, j, k`, in 1/m^2: the cotangent of the angle
/// **at `j`** over the squared length. The two faces of an edge together give `(cot g + cot d) /
/// |x_i - x_j|^2`.
///
/// The source paper's equations (7) and (8) print the angles opposite to the edge instead; with those a
/// planar one-ring is not reproduced (`(desbrun2002)` has the angles at `j`).
fn authalic_weight(i: DVec3, j: DVec3, k: DVec3) -> f64 {
    cotangent(j, i, k).clamp(-MAX_COTAN, MAX_COTAN) / i.distance_squared(j)
}

/// The authalic rows `sum_j w_ij (u_j - u_i) = 0`; not symmetric.
fn authalic_matrix<'s>(domain: &'s FlattenDomain<'_>) -> Matrix<'s, DVec2> {
    let mut matrix = Matrix::<DVec2>::zero(domain.elements.pattern());
    for e in &domain.elements.faces {
        for k in 0..3 {
            let around = [e.corners[k], e.corners[(k + 1) % 3], e.corners[(k + 2) % 3]];
            let [i, j, l] = around.map(|v| domain.position(v));
            for (to, weight) in [(around[1], authalic_weight(i, j, l)), (around[2], authalic_weight(i, l, j))]
            {
                let weight = if weight.is_finite() { weight } else { 0.0 };
                matrix.at(around[0].index(), to.index()).x -= weight;
                matrix.at(around[0].index(), around[0].index()).x += weight;
            }
        }
    }
    matrix
}

/// Linear mix of conformal and authalic rows inside, natural conformal rows on the boundary, two boundary
/// vertices pinned (`(desbrun2002)`; equations (7) and (8) of the source paper). Where the outer boundary is
/// prescribed, its vertices are pinned instead (its equation (2) with (6) and (8)).
///
/// Both kinds of rows are scaled to the same mean diagonal before they are mixed `angle : area`. Conformal
/// rows are real except on the boundary, so one complex unknown per vertex represents both coordinates.
pub(crate) fn linear(domain: &FlattenDomain<'_>, angle: f64, area: f64) -> Result<Uv, FlattenError> {
    let mut matrix = conformal_matrix(domain);
    let authalic = authalic_matrix(domain);
    let inner: Vec<usize> = domain
        .mesh
        .positions
        .ids()
        .filter(|&v| !domain.disk.adjacency.is_boundary(v))
        .map(VertexId::index)
        .collect();
    let mean = |m: &Matrix<'_, DVec2>| inner.iter().map(|&i| m.diagonal(i).x.abs()).sum::<f64>();
    let (of_angle, of_area) = (mean(&matrix), mean(&authalic));
    let same_size = if of_area > 0.0 { of_angle / of_area } else { 1.0 };
    let total = angle + area;
    let (angle, area) = (angle / total, area / total * same_size);
    for &i in &inner {
        for slot in domain.elements.pattern().slots(i) {
            let mixed = matrix.values()[slot] * angle + authalic.values()[slot] * area;
            matrix.values_mut()[slot] = mixed;
        }
    }
    let mut uv = vec![DVec2::ZERO; domain.vertices()];
    let places = domain.mesh.positions.ids().zip(&domain.prescribed);
    let mut pins: Vec<_> = places.filter_map(|(v, place)| Some((v, (*place)?))).collect();
    if pins.is_empty() {
        pins = far_apart(domain).into_iter().zip([DVec2::ZERO, DVec2::X]).collect();
    }
    for (pin, at) in pins {
        for slot in domain.elements.pattern().slots(pin.index()) {
            matrix.values_mut()[slot] = DVec2::ZERO;
        }
        *matrix.at(pin.index(), pin.index()) = DVec2::X;
        uv[pin.index()] = at;
    }
    solve_unsymmetric(&matrix, &mut uv)
        .map_err(|source| FlattenError::System { method: "linear", source })?;
    Ok(uv.into())
}

/// Two vertices of the outer loop: the one farthest from the centre of its vertices, and the one farthest
/// from that. Pins that are close together ruin the map, and these do not depend on the numbering.
fn far_apart(domain: &FlattenDomain<'_>) -> [VertexId; 2] {
    let outer = &domain.disk.loops[0];
    let at = |v: VertexId| domain.mesh.positions[v];
    let middle = outer.iter().map(|&v| at(v)).sum::<DVec3>() / outer.len() as f64;
    let farthest = |from: DVec3, but: Option<VertexId>| {
        let others = outer.iter().copied().filter(|&v| Some(v) != but);
        let closer = |a: &VertexId, b: &VertexId| {
            at(*a).distance_squared(from).total_cmp(&at(*b).distance_squared(from))
        };
        others.max_by(closer).unwrap_or(outer[0])
    };
    let first = farthest(middle, None);
    [first, farthest(at(first), Some(first))]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    /// Linear precision: the authalic row reproduces a planar one-ring. With the
    /// angles opposite to the edge, as printed in the source paper, the residual is of order 1.
    #[test]
    fn a_planar_ring_is_reproduced_by_the_authalic_row() {
        let mut mesh = shapes::fan(7);
        mesh.positions[VertexId::new(0)] = DVec3::new(0.21, -0.13, 0.0);
        mesh.positions[VertexId::new(3)] *= 1.4;
        let domain = FlattenDomain::new(&mesh).unwrap();
        let matrix = authalic_matrix(&domain);
        let row: DVec2 = domain
            .elements
            .pattern()
            .slots(0)
            .zip(domain.elements.pattern().columns(0))
            .map(|(slot, &j)| matrix.values()[slot].x * mesh.positions[VertexId::from(j)].truncate())
            .sum();
        let size = matrix.diagonal(0).x;
        assert!(row.length() < 1e-15 * size, "residual {row} of a diagonal {size}");
    }
}
