//! Local distance of a vertex to its neighbours, measured or from stated densities; it sets how far
//! apart centres are.

use glam::DVec3;

use crate::{
    id::{IdVec, VertexId},
    mesh::Rings,
};

/// Rounds in which each spacing is replaced by the mean of itself and its neighbours': one short
/// edge must not make a place look dense.
const SMOOTHING_ROUNDS: usize = 2;

/// Smoothed distance of every vertex to its neighbours, in m.
pub(super) fn measured_spacing(rings: &Rings, positions: &IdVec<VertexId, DVec3>) -> IdVec<VertexId, f64> {
    let mut spacing = rings.map(|v, ring| {
        let sum: f64 = ring.iter().map(|&w| positions[v].distance(positions[w])).sum();
        sum / ring.len().max(1) as f64
    });
    for _ in 0..SMOOTHING_ROUNDS {
        spacing = rings.map(|v, ring| {
            let sum: f64 = ring.iter().map(|&w| spacing[w]).sum();
            (spacing[v] + sum) / (1 + ring.len()) as f64
        });
    }
    spacing
}

/// Spacing of a triangular lattice of `densities` (1/m^2), `sqrt(2 / (sqrt3 rho))`, times the
/// factor that makes its geometric mean that of the `measured` one, in m.
///
/// On level 0 of a skin that tells the truth about itself the factor is about 1. It grows with the
/// levels, and it lets a density that only weighs places against each other (an acuity) coarsen as
/// fast as any other.
pub(super) fn spacing_of_densities(
    densities: &IdVec<VertexId, f64>,
    measured: &IdVec<VertexId, f64>,
) -> IdVec<VertexId, f64> {
    let lattice = densities.map(|rho| (2.0 / (3.0_f64.sqrt() * rho)).sqrt());
    // Where vertices coincide the measured spacing may be zero: such places have no say.
    let (mut sum, mut count) = (0.0, 0.0);
    for (m, l) in measured.iter().zip(&lattice).filter(|(m, _)| **m > 0.0) {
        sum += (m / l).ln();
        count += 1.0;
    }
    let factor = if count > 0.0 { f64::exp(sum / count) } else { 1.0 };
    lattice.map(|l| l * factor)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{HalfedgeMesh, shapes};

    fn spacing(mesh: &crate::mesh::TriMesh) -> IdVec<VertexId, f64> {
        measured_spacing(&HalfedgeMesh::new(mesh).unwrap().1, &mesh.positions)
    }

    #[test]
    fn a_lattice_has_its_own_spacing() {
        assert!(spacing(&shapes::lattice(9, 8, 0.006)).iter().all(|h| (h - 0.006).abs() < 1e-12));
    }

    /// A lattice of spacing `h` has `2 / (sqrt3 h^2)` taxels per m^2.
    #[test]
    fn the_density_of_a_lattice_gives_its_spacing() {
        let measured = IdVec::filled(0.006, 4);
        let density = 2.0 / (3.0_f64.sqrt() * 0.006 * 0.006);
        let stated = spacing_of_densities(&IdVec::filled(density, 4), &measured);
        assert!(stated.iter().all(|h| (h - 0.006).abs() < 1e-12), "{stated:?}");
    }

    #[test]
    fn densities_weigh_places_against_each_other_in_any_unit() {
        let measured: IdVec<VertexId, f64> = vec![0.01, 0.01, 0.0].into();
        let stated = spacing_of_densities(&vec![1.0, 16.0, 1.0].into(), &measured);
        let [sparse, dense] = [stated[VertexId::new(0)], stated[VertexId::new(1)]];
        assert!((sparse / dense - 4.0).abs() < 1e-12, "16 times as dense, a quarter of the spacing");
        assert!((sparse * dense - 1e-4).abs() < 1e-12, "the geometric mean is the measured one");
    }
}
