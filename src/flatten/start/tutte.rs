//! A start without flips for every disk with holes: the outer loop on a circle (`(tutte1963)`,
//! `(floater2003)`).
//!
//! In exact arithmetic no face flips and no vertex has more than one turn of faces. In 64 bits
//! faces of a long thin part may end without area.

use glam::DVec2;

use crate::{
    flatten::{
        FlattenError,
        domain::elements::{Uv, keeps_orientation},
        domain::flatten_domain::FlattenDomain,
        start::conformal::circle,
    },
    id::{FaceId, VertexId},
    sparse::{Cholesky, Matrix, Pattern, SparseError},
};

/// Cotangent weights below this share of the mean are lifted to it: any positive weight keeps the
/// map free of flips, but tiny ones let faces shrink below what 64 bits can tell apart.
const LEAST_WEIGHT: f64 = 0.1;

/// How edges pull on their ends.
#[derive(Debug, Clone, Copy)]
enum Weights {
    /// Cotangents, lifted to be positive: close to harmonic, keeps the faces' shapes.
    Cotangent,
    /// All equal.
    Uniform,
}

/// Every vertex off the circle lies at the weighted mean of its neighbours; holes are closed by a
/// virtual vertex in the middle of each.
///
/// Faces can still become too small for 64-bit numbers; then equal weights are tried.
///
/// # Errors
/// [`FlattenError::NoStart`] when both fail.
pub(crate) fn tutte(domain: &FlattenDomain<'_>) -> Result<Uv, FlattenError> {
    let failed = |source| FlattenError::System { method: "convex", source };
    let mut worst = None;
    for weights in [Weights::Cotangent, Weights::Uniform] {
        let uv = solve(domain, weights).map_err(failed)?;
        let flipped = domain.elements.map_areas(&uv).position(|area| !keeps_orientation(area));
        match flipped {
            None => return Ok(uv),
            Some(face) => worst = Some(FaceId::new(face)),
        }
    }
    Err(FlattenError::NoStart { face: worst.unwrap_or_default() })
}

/// Pull of every edge on its ends: pairs of rows and weights, virtual vertices behind the real
/// ones.
fn springs(domain: &FlattenDomain<'_>, weights: Weights) -> Vec<(usize, usize, f64)> {
    let vertices = domain.vertices();
    let mut pull = Matrix::<f64>::zero(&domain.elements.pattern);
    for e in &domain.elements.faces {
        for k in 0..3 {
            let (i, j) = (e.corners[k], e.corners[(k + 1) % 3]);
            let cotangent = -e.stiffness(k, (k + 1) % 3);
            *pull.at(i.index().max(j.index()), i.index().min(j.index())) += cotangent;
        }
    }
    let mut springs = Vec::new();
    for i in 0..vertices {
        for (&j, slot) in domain.elements.pattern.columns(i).iter().zip(domain.elements.pattern.slots(i)) {
            if (j as usize) < i {
                springs.push((i, j as usize, pull.values()[slot]));
            }
        }
    }
    let mean = springs.iter().map(|s| s.2.abs()).sum::<f64>() / springs.len().max(1) as f64;
    for spring in &mut springs {
        spring.2 = match weights {
            // The upper bound keeps a sliver from gluing its corners together.
            Weights::Cotangent => spring.2.clamp(LEAST_WEIGHT * mean, mean / LEAST_WEIGHT),
            Weights::Uniform => mean,
        };
    }
    for (hole, walk) in domain.disk.loops[1..].iter().enumerate() {
        springs.extend(walk.iter().map(|v| (vertices + hole, v.index(), mean)));
    }
    springs
}

fn solve(domain: &FlattenDomain<'_>, weights: Weights) -> Result<Uv, SparseError> {
    let springs = springs(domain, weights);
    let vertices = domain.vertices();
    let all = vertices + domain.disk.loops.len() - 1;
    let mut fixed = vec![None; all];
    for (&v, at) in domain.disk.loops[0].iter().zip(circle(domain)) {
        fixed[v.index()] = Some(at);
    }
    // Free vertices, numbered; the middle of a hole is put near the hole.
    let mut row_of = vec![usize::MAX; all];
    let mut coordinates = Vec::new();
    for i in (0..all).filter(|&i| fixed[i].is_none()) {
        row_of[i] = coordinates.len();
        let near = if i < vertices { VertexId::new(i) } else { domain.disk.loops[1 + i - vertices][0] };
        coordinates.push(domain.mesh.positions[near]);
    }
    let free = |&&(i, j, _): &&(usize, usize, f64)| row_of[i] != usize::MAX && row_of[j] != usize::MAX;
    let pattern =
        Pattern::new(coordinates.len(), springs.iter().filter(free).map(|&(i, j, _)| (row_of[i], row_of[j])));
    let mut matrix = Matrix::<f64>::zero(&pattern);
    let mut rhs = [vec![0.0; coordinates.len()], vec![0.0; coordinates.len()]];
    for &(i, j, w) in &springs {
        for (i, j) in [(i, j), (j, i)] {
            let row = row_of[i];
            if row == usize::MAX {
                continue;
            }
            *matrix.at(row, row) += w;
            match fixed[j] {
                Some(at) => {
                    rhs[0][row] += w * at.x;
                    rhs[1][row] += w * at.y;
                }
                None => *matrix.at(row, row_of[j]) -= w,
            }
        }
    }
    if !coordinates.is_empty() {
        let cholesky = Cholesky::new(&pattern, &coordinates)?;
        let factor = cholesky.factor(&matrix)?;
        factor.solve(&mut rhs[0])?;
        factor.solve(&mut rhs[1])?;
    }
    Ok((0..vertices)
        .map(|i| fixed[i].unwrap_or_else(|| DVec2::new(rhs[0][row_of[i]], rhs[1][row_of[i]])))
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{TriMesh, shapes};

    fn check(mesh: &TriMesh) {
        let domain = FlattenDomain::new(mesh).unwrap();
        for weights in [Weights::Cotangent, Weights::Uniform] {
            let uv = solve(&domain, weights).unwrap();
            assert!(domain.elements.is_flip_free(&uv), "{weights:?} on {} faces", mesh.triangles.len());
        }
    }

    #[test]
    fn nothing_flips_inside_a_circle() {
        check(&shapes::triangle());
        check(&shapes::square());
        check(&shapes::cap(900, 0.1, 2.5));
        check(&shapes::saddle(20));
    }

    #[test]
    fn holes_are_closed_by_a_vertex_each() {
        check(&shapes::tube(16, 8, 0.05, 0.2));
    }
}
