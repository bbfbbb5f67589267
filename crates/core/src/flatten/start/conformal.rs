//! The spectral natural conformal map: least angle distortion, free boundary, no pinned vertex
//! (`(mullen2008)`, `(desbrun2002)`).
//!
//! One of the methods, and the start of the intrinsic method. It may flip faces and wind twice about a
//! vertex.

use std::f64::consts::TAU;

use glam::DVec2;

use crate::flatten::FlattenError;
use crate::flatten::domain::FlattenDomain;
use crate::flatten::energy::elements::{BoundaryEdge, Uv};
use crate::id::{IdVec, VertexId};
use crate::sparse::{Cholesky, Matrix, SparseError};

/// Share of the boundary mass that is added to the matrix, which is singular (translations) and on a flat
/// mesh doubly so. A shift by the mass does not change the eigenvectors. The share is far below the other
/// eigenvalues, which are of order 1, and far above rounding.
const SHIFT: f64 = 1e-4;

/// How much the shift grows when rounding still makes a pivot negative.
const SHIFT_GROWTH: f64 = 10.0;

/// Inverse iteration ends when the eigenvalue changes by less than this, relatively: the error of
/// the map is about its square root.
const TOLERANCE: f64 = 1e-13;

/// Most iterations; 5 to 20 are usual. Two nearly equal eigenvalues need more, and either map is as good.
const ITERATIONS: usize = 60;

/// The conformal energy `E_D - A` of a map given as complex numbers, as a Hermitian matrix: `z* M z
/// / 2`.
///
/// The Dirichlet energy is the cotangent Laplacian; the area enclosed is a sum over boundary edges and adds
/// the only imaginary entries. One complex unknown per vertex instead of two real ones makes the factor four
/// times smaller (natural conformal map of `(desbrun2002)`).
pub(crate) fn conformal_matrix<'s>(domain: &'s FlattenDomain<'_>) -> Matrix<'s, DVec2> {
    let mut matrix = Matrix::<DVec2>::zero(domain.elements.pattern());
    for e in &domain.elements.faces {
        for k in 0..3 {
            for l in 0..3 {
                let entry = e.stiffness(k, l);
                matrix.at(e.corners[k].index(), e.corners[l].index()).x += entry;
            }
        }
    }
    for &BoundaryEdge { ends: [a, b], .. } in &domain.elements.boundary {
        matrix.at(a.index(), b.index()).y += 0.5;
        matrix.at(b.index(), a.index()).y -= 0.5;
    }
    matrix
}

/// Spectral natural conformal map (`(mullen2008)`): the map of least
/// conformal energy among those whose boundary has mass one and mean zero.
///
/// Departure from the paper: boundary vertices are weighted by their share of the boundary's length instead
/// of 1, so that the map does not depend on how densely the boundary is sampled.
pub(crate) fn spectral_conformal(domain: &FlattenDomain<'_>) -> Result<Uv, FlattenError> {
    let failed = |source| FlattenError::System { method: "conformal", source };
    let cholesky =
        Cholesky::new(domain.elements.pattern(), domain.mesh.positions.as_slice()).map_err(failed)?;
    let mut matrix = conformal_matrix(domain);
    let mass = boundary_mass(domain);
    let (mut shift, mut added) = (SHIFT, 0.0);
    loop {
        for (v, m) in mass.enumerate() {
            matrix.at(v.index(), v.index()).x += (shift - added) * m;
        }
        match cholesky.factor(&matrix) {
            Ok(factor) => {
                return inverse_iteration(outer_circle(domain), &mass, |z| factor.solve(z)).map_err(failed);
            }
            Err(SparseError::NotPositiveDefinite { .. }) if shift < 1.0 => {
                (shift, added) = (shift * SHIFT_GROWTH, shift);
            }
            Err(other) => return Err(failed(other)),
        }
    }
}

/// Each boundary vertex's share of the boundary, half of both its edges.
fn boundary_mass(domain: &FlattenDomain<'_>) -> IdVec<VertexId, f64> {
    let mut mass = IdVec::filled(0.0, domain.vertices());
    let total: f64 = domain.elements.boundary.iter().map(|b| b.length).sum();
    for &BoundaryEdge { ends, length } in &domain.elements.boundary {
        for v in ends {
            mass[v] += 0.5 * length / total;
        }
    }
    mass
}

/// The outer loop on a circle by arc length: counter-clockwise, so never orthogonal to the
/// eigenvector that is wanted.
fn outer_circle(domain: &FlattenDomain<'_>) -> Uv {
    let mut z = IdVec::filled(DVec2::ZERO, domain.vertices());
    for (&v, at) in domain.disk.loops[0].iter().zip(circle(domain)) {
        z[v] = at;
    }
    z
}

/// Positions of the outer loop's vertices on the unit circle, by arc length.
pub(crate) fn circle(domain: &FlattenDomain<'_>) -> Vec<DVec2> {
    let outer = domain.disk.loops[0].len();
    // The boundary list runs loop by loop, the outer one first.
    let edges = &domain.elements.boundary[..outer];
    let total: f64 = edges.iter().map(|e| e.length).sum();
    let mut along = 0.0;
    edges
        .iter()
        .map(|e| {
            let at = DVec2::from_angle(TAU * along / total);
            along += e.length;
            at
        })
        .collect()
}

/// The eigenvector of `M z = mu B z` with the least `mu` among those with mean zero on the
/// boundary.
fn inverse_iteration(
    mut z: Uv,
    mass: &IdVec<VertexId, f64>,
    solve: impl Fn(&mut [DVec2]) -> Result<(), SparseError>,
) -> Result<Uv, SparseError> {
    let weighted = |z: &Uv| -> Uv { z.iter().zip(mass).map(|(&z, &m)| z * m).collect() };
    let normalise = |z: &mut Uv| {
        let mean: DVec2 = weighted(z).into_iter().sum();
        z.iter_mut().for_each(|z| *z -= mean);
        let norm = z.iter().zip(mass).map(|(z, m)| z.length_squared() * m).sum::<f64>().sqrt();
        z.iter_mut().for_each(|z| *z /= norm);
        norm
    };
    normalise(&mut z);
    let mut last = 0.0;
    for _ in 0..ITERATIONS {
        let mut next = weighted(&z);
        solve(next.as_mut_slice())?;
        z = next;
        // The norm tends to 1/mu.
        let growth = normalise(&mut z);
        if !growth.is_finite() {
            return Err(SparseError::Singular { rows: z.len() });
        }
        let change = (growth - last).abs();
        last = growth;
        if change <= TOLERANCE * growth {
            break;
        }
    }
    Ok(z)
}
