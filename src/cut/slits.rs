//! Where a slit into the surface may relieve its map: at peaks of distortion and of curvature.
//! *Heuristic*: with peaks of distortion alone a closed public shape ended at a symmetric Dirichlet
//! energy of 5.08 where peaks of curvature find 4.78; without the factor of distance all peaks lie
//! at the ends of the seam.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use crate::{
    cut::{
        PlaceId,
        seam_graph::{RESOLUTION, SeamGraph},
        trial::Trial,
    },
    id::{FaceId, IdVec, VertexId},
    mesh::{FlatTriangle, SymmetricDirichlet, TriMesh, angle},
    sparse::{Cholesky, Matrix, Pattern},
};

/// Peaks of each kind that are tried.
const PEAKS: usize = 2;
/// A slit ends at least 0.12 from boundary and seam, over the square root of the area, and ends of
/// slits are 0.25 apart.
pub(super) const LONG: [f64; 2] = [0.12, 0.25];
/// Such distances where one face may not be worse than a limit: short slits count too.
pub(super) const SHORT: [f64; 2] = [0.04, 0.1];
/// Rounds in which the distortion is averaged over neighbours.
const ROUNDS: usize = 6;
/// Time for which curvature spreads as heat, in areas of the surface: about 0.13 wide.
const TIME: f64 = 0.004;
/// Curvature of a peak, in rad, at least; a sphere has 4 pi in all.
const LEAST_CURVATURE: f64 = 0.3;
/// Peaks are as high as each other if they differ by less than this share: the smallest vertex is
/// taken, however the surface is turned.
const EQUAL: f64 = 1e-6;

/// Vertices of the mesh at which a slit may end, the most promising ones, at least `apart` from the
/// others and `least` from boundary and seam, over the square root of the area.
pub(super) fn slit_ends(
    graph: &SeamGraph<'_>,
    state: &Trial,
    curvature: &IdVec<VertexId, f64>,
    [least_length, apart]: [f64; 2],
) -> Vec<VertexId> {
    let own = |v: &VertexId| v.index() < graph.mesh.positions.len();
    let seam = graph.vertices(&state.seam).into_iter().filter(own);
    let taken = graph.distances(seam.chain(graph.loops.iter().flatten().copied()));
    let distance = |v: VertexId| taken[v] as f64 * RESOLUTION;
    let distortion = distortion(graph.mesh, state);
    let weighed = distortion.enumerate().map(|(v, d)| d * distance(v)).collect();
    let mut ends = Vec::new();
    for (mut height, least) in [(weighed, 0.0), (curvature.clone(), LEAST_CURVATURE)] {
        for (v, h) in (0..).map(VertexId::new).zip(height.iter_mut()) {
            if distance(v) <= least_length {
                *h = 0.0;
            }
        }
        for _ in 0..PEAKS {
            let Some(peak) = highest(&height).filter(|&v| height[v] > least) else { break };
            if !ends.contains(&peak) {
                ends.push(peak);
            }
            let around = graph.distances(std::iter::once(peak));
            for (v, h) in (0..).map(VertexId::new).zip(height.iter_mut()) {
                if (around[v] as f64) * RESOLUTION < apart {
                    *h = 0.0;
                }
            }
        }
    }
    ends
}

fn highest(height: &IdVec<VertexId, f64>) -> Option<VertexId> {
    let most = height.iter().copied().fold(0.0, f64::max);
    height.enumerate().find(|(_, h)| **h >= most * (1.0 - EQUAL)).map(|(v, _)| v)
}

/// Excess energy around each vertex of the mesh, averaged over a few rings of the cut mesh.
fn distortion(mesh: &TriMesh, state: &Trial) -> IdVec<VertexId, f64> {
    let cut = &state.cut;
    let areas: IdVec<FaceId, f64> = mesh.triangles.ids().map(|face| mesh.face_area(face)).collect();
    let mean = |of_face: &dyn Fn(FaceId) -> f64| {
        let mut sums = IdVec::<PlaceId, (f64, f64)>::filled((0.0, 0.0), cut.unsplit.len());
        for (face, corners) in cut.triangles.enumerate() {
            let (a, x) = (areas[face], of_face(face));
            for &v in corners {
                sums[v].0 += a * x;
                sums[v].1 += a;
            }
        }
        sums.map(|&(sum, area)| if area > 0.0 { sum / area } else { 0.0 })
    };
    let mut smooth = mean(&|face| state.faces.get(face).map_or(0.0, |e| e - SymmetricDirichlet::ISOMETRY));
    for _ in 0..ROUNDS {
        let before = smooth;
        smooth = mean(&|face| cut.triangles[face].iter().map(|&v| before[v]).sum::<f64>() / 3.0);
    }
    let mut most = IdVec::<VertexId, f64>::filled(0.0, mesh.positions.len());
    for (&v, &d) in cut.unsplit.iter().zip(&smooth) {
        most[v] = most[v].max(d);
    }
    most
}

/// Gauss curvature around each vertex, in rad: what lies on the inside, spread as heat. Zero
/// everywhere if the equation of heat cannot be solved.
pub(super) fn spread_curvature(graph: &SeamGraph<'_>) -> IdVec<VertexId, f64> {
    let mesh = graph.mesh;
    let count = mesh.positions.len();
    let mut curvature = vec![TAU; count];
    for corners in &mesh.triangles {
        for k in 0..3 {
            let [a, b, c] = [0, 1, 2].map(|j| mesh.positions[corners[(k + j) % 3]]);
            curvature[corners[k].index()] -= angle(a, b, c);
        }
    }
    for v in graph.loops.iter().flatten() {
        curvature[v.index()] = 0.0;
    }
    match spread(mesh, curvature) {
        Some(heat) => heat.into_iter().map(|h| (4.0 * PI * TIME * h).abs()).collect(),
        None => IdVec::filled(0.0, count),
    }
}

/// Solves `(M + t L) x = heat` with the mass matrix `M` and the cotangent Laplacian `L`, in units of
/// the area.
fn spread(mesh: &TriMesh, mut heat: Vec<f64>) -> Option<Vec<f64>> {
    let unit = mesh.area().sqrt();
    let sides = mesh.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
    let pattern = Pattern::new(heat.len(), sides.map(|(a, b)| (a.index(), b.index())));
    let mut matrix = Matrix::<f64>::zero(&pattern);
    let scaled: Vec<DVec3> = mesh.positions.iter().map(|&p| p / unit).collect();
    for corners in &mesh.triangles {
        let flat = FlatTriangle::new(corners.map(|v| scaled[v.index()]));
        let (area, gradients) = (flat.area(), flat.gradients());
        // A face without area carries no heat.
        if !(area > 0.0 && gradients.iter().all(|g| g.is_finite())) {
            continue;
        }
        for i in 0..3 {
            let row = corners[i].index();
            *matrix.at(row, row) += area / 3.0;
            for j in 0..3 {
                *matrix.at(row, corners[j].index()) += TIME * area * gradients[i].dot(gradients[j]);
            }
        }
    }
    // A vertex between faces without area.
    for row in 0..heat.len() {
        if *matrix.at(row, row) <= 0.0 {
            *matrix.at(row, row) = 1.0;
        }
    }
    let cholesky = Cholesky::new(&pattern, &scaled).ok()?;
    cholesky.factor(&matrix).ok()?.solve(&mut heat).ok()?;
    heat.iter().all(|h| h.is_finite()).then_some(heat)
}
