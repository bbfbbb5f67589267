//! A finished map, bent so that its landmarks come to given places.

use glam::DVec2;

use crate::flatten::{crossing_vertices, distortion, keeps_orientation};
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{TriMesh, boundary_edges};
use crate::registration::field::Bending;
use crate::sparse::SparseError;

/// In how many steps a map is bent: in one where that folds nothing, else in more, each on the map of the last.
/// *Heuristic*: of 48 maps of hands whose fingers were 0.5 to 2.2 times as long, 4 had flips after one step, and none
/// after eight.
const STEPS: [u32; 4] = [1, 2, 4, 8];

/// How a map came out.
pub(super) enum Bent {
    /// One to one as before, with the number of steps.
    Done(IdVec<VertexId, DVec2>, u32),
    /// It folds, first near this place.
    Folds(DVec2),
}

/// Bends a map of a mesh, which has no flips, so that each held vertex comes to its place.
pub(super) fn bend(
    mesh: &TriMesh,
    map: &IdVec<VertexId, DVec2>,
    held: &[(VertexId, DVec2)],
) -> Result<Bent, SparseError> {
    let vertices: Vec<VertexId> = held.iter().map(|&(v, _)| v).collect();
    let bending = Bending::new(&mesh.triangles, map, &vertices)?;
    let crossings = distortion(mesh, map).crossings;
    let mut folds = None;
    for steps in STEPS {
        let (mut uv, mut fold) = (map.clone(), None);
        for step in 0..steps {
            let share = 1.0 / f64::from(steps - step);
            let moves: Vec<_> = held.iter().map(|&(v, to)| (v, share * (to - uv[v]))).collect();
            // A system that cannot be factored is that of a map that nearly folds.
            match bending.displacement(&uv, &moves) {
                Ok(by) => uv.iter_mut().zip(&by).for_each(|(at, by)| *at += *by),
                Err(SparseError::NotPositiveDefinite { .. } | SparseError::NotFinite { .. }) => {
                    fold = Some(held[0].1);
                    break;
                }
                Err(other) => return Err(other),
            }
            fold = first_flip(mesh, &uv);
            if fold.is_some() {
                break;
            }
        }
        // The last step is exact but for rounding.
        held.iter().for_each(|&(v, to)| uv[v] = to);
        match fold.or_else(|| first_flip(mesh, &uv)) {
            None if distortion(mesh, &uv).crossings <= crossings => return Ok(Bent::Done(uv, steps)),
            None => {
                let crossing = crossing_vertices(&boundary_edges(mesh), &uv);
                folds = Some(crossing.first().map_or(held[0].1, |&v| uv[v]));
            }
            Some(at) => folds = Some(at),
        }
    }
    Ok(Bent::Folds(folds.unwrap_or_default()))
}

/// The middle of the first face that does not keep its orientation.
pub(super) fn first_flip(mesh: &TriMesh, uv: &IdVec<VertexId, DVec2>) -> Option<DVec2> {
    let corners = |face: FaceId| mesh.triangles[face].map(|v| uv[v]);
    let flipped = mesh.triangles.ids().map(corners).find(|corners| !keeps_orientation(*corners))?;
    Some(flipped.into_iter().sum::<DVec2>() / 3.0)
}
