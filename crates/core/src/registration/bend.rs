//! A finished map, bent so that its landmarks come to given places.

use glam::DVec2;

use crate::flatten::{crossing_vertices, distortion, keeps_orientation};
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{TriMesh, VertexCorners, boundary_edges};
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
    /// It folds near these places, first near the first.
    Folds(Vec<DVec2>),
}

/// Bends a map of a mesh, which has no flips, so that each landmark and each vertex of `banks` comes to its place. Those of
/// the banks may be moved further where rims cross.
pub(super) fn bend(
    mesh: &TriMesh,
    map: &IdVec<VertexId, DVec2>,
    landmarks: &[(VertexId, DVec2)],
    banks: &[(VertexId, DVec2)],
) -> Result<Bent, SparseError> {
    let held = [landmarks, banks].concat();
    let vertices: Vec<VertexId> = held.iter().map(|&(v, _)| v).collect();
    let bending = Bending::new(&mesh.triangles, map, &vertices)?;
    let crossings = distortion(mesh, map).crossings;
    let mut folds = Vec::new();
    for steps in STEPS {
        let (mut uv, mut found) = (map.clone(), Vec::new());
        for step in 0..steps {
            let share = 1.0 / f64::from(steps - step);
            let moves: Vec<_> = held.iter().map(|&(v, to)| (v, share * (to - uv[v]))).collect();
            // A system that cannot be factored is that of a map that nearly folds.
            match bending.displacement(&uv, &moves) {
                Ok(by) => uv.iter_mut().zip(&by).for_each(|(at, by)| *at += *by),
                Err(SparseError::NotPositiveDefinite { .. } | SparseError::NotFinite { .. }) => {
                    found = vec![held[0].1];
                    break;
                }
                Err(other) => return Err(other),
            }
            found = flips(mesh, &uv).collect();
            if !found.is_empty() {
                break;
            }
        }
        // The last step is exact but for rounding.
        held.iter().for_each(|&(v, to)| uv[v] = to);
        if found.is_empty() {
            found = flips(mesh, &uv).collect();
        }
        match found[..] {
            [] if distortion(mesh, &uv).crossings <= crossings => return Ok(Bent::Done(uv, steps)),
            [] if moved_apart(mesh, &mut uv, &vertices[..landmarks.len()])?
                && distortion(mesh, &uv).crossings <= crossings =>
            {
                return Ok(Bent::Done(uv, steps));
            }
            [] => {
                folds = crossing_vertices(&boundary_edges(mesh), &uv).into_iter().map(|v| uv[v]).collect();
                if folds.is_empty() {
                    folds.push(held[0].1);
                }
            }
            _ => folds = found,
        }
    }
    Ok(Bent::Folds(folds))
}

/// How often rims that cross are moved apart, each time by half an edge at most.
const ROUNDS: usize = 16;

/// Moves rims that cross each other apart, as those of two fingers that came too near: their vertices move inwards, the
/// landmarks stay, and the field continues it. Whether none crosses another then; no face is flipped.
///
/// *Heuristic*: of 24 hard pairs of hands with 13 landmarks, two had rims that crossed. With fewer landmarks, as many as cross
/// no more, taxels of one missed their places by 36 mm in 95 %.
fn moved_apart(
    mesh: &TriMesh,
    uv: &mut IdVec<VertexId, DVec2>,
    landmarks: &[VertexId],
) -> Result<bool, SparseError> {
    let rim = boundary_edges(mesh);
    let corners = VertexCorners::new(mesh.triangles.iter().copied(), uv.len());
    let mut apart = uv.clone();
    for _ in 0..ROUNDS {
        let crossing = crossing_vertices(&rim, &apart);
        if crossing.is_empty() {
            *uv = apart;
            return Ok(true);
        }
        let inwards = |v: VertexId| {
            let around = corners.faces(v).flat_map(|face| mesh.triangles[face]).map(|w| apart[w] - apart[v]);
            let (sum, count) = around
                .filter(|by| *by != DVec2::ZERO)
                .fold((DVec2::ZERO, 0), |(sum, count), by| (sum + by, count + 1));
            0.5 * sum / f64::from(count.max(1))
        };
        let moves: Vec<(VertexId, DVec2)> = crossing
            .into_iter()
            .filter(|v| !landmarks.contains(v))
            .map(|v| (v, inwards(v)))
            .chain(landmarks.iter().map(|&v| (v, DVec2::ZERO)))
            .collect();
        let held: Vec<VertexId> = moves.iter().map(|&(v, _)| v).collect();
        let bending = Bending::new(&mesh.triangles, &apart, &held)?;
        let Ok(by) = bending.displacement(&apart, &moves) else { return Ok(false) };
        apart.iter_mut().zip(&by).for_each(|(at, by)| *at += *by);
        if first_flip(mesh, &apart).is_some() {
            return Ok(false);
        }
    }
    Ok(false)
}

/// The middle of the first face that does not keep its orientation.
pub(super) fn first_flip(mesh: &TriMesh, uv: &IdVec<VertexId, DVec2>) -> Option<DVec2> {
    flips(mesh, uv).next()
}

/// The middles of the faces that do not keep their orientation.
fn flips(mesh: &TriMesh, uv: &IdVec<VertexId, DVec2>) -> impl Iterator<Item = DVec2> {
    let corners = |face: FaceId| mesh.triangles[face].map(|v| uv[v]);
    let flipped = mesh.triangles.ids().map(corners).filter(|corners| !keeps_orientation(*corners));
    flipped.map(|corners| corners.into_iter().sum::<DVec2>() / 3.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    /// Two prongs on a base, 3 mm apart.
    fn fork() -> TriMesh {
        let whole = shapes::lattice(24, 20, 0.003);
        let is_kept = |corners: &&[VertexId; 3]| {
            let at = corners.map(|v| whole.positions[v]);
            at.iter().all(|p| p.y < 0.016 || (p.x - 0.036).abs() > 0.003)
        };
        let faces: Vec<[VertexId; 3]> = whole.triangles.iter().filter(is_kept).copied().collect();
        let mut number: IdVec<VertexId, Option<VertexId>> = IdVec::filled(None, whole.positions.len());
        let mut mesh = TriMesh::default();
        for corners in faces {
            let own =
                corners.map(|v| *number[v].get_or_insert_with(|| mesh.positions.push(whole.positions[v])));
            mesh.triangles.push(own);
        }
        mesh
    }

    /// Landmarks on the axes of two prongs that bring their rims across each other: the rims move apart, and the landmarks
    /// lie at their places.
    #[test]
    fn rims_that_cross_are_moved_apart() {
        let mesh = fork();
        let map = mesh.positions.map(|p| p.truncate());
        let nearest = |at: DVec2| {
            let far = |v: &VertexId| map[*v].distance_squared(at);
            mesh.positions.ids().min_by(|a, b| far(a).total_cmp(&far(b))).unwrap()
        };
        let place = |x: f64, y: f64, by: f64| {
            let v = nearest(DVec2::new(x, y));
            (v, map[v] + DVec2::new(by, 0.0))
        };
        let held = [
            place(0.0, 0.0, 0.0),
            place(0.072, 0.0, 0.0),
            place(0.018, 0.025, 0.0035),
            place(0.054, 0.025, -0.0035),
            place(0.018, 0.05, 0.005),
            place(0.054, 0.05, -0.005),
        ];
        let vertices = held.map(|(v, _)| v);
        let field = Bending::new(&mesh.triangles, &map, &vertices).unwrap();
        let moves = held.map(|(v, to)| (v, to - map[v]));
        let by = field.displacement(&map, &moves).unwrap();
        let crossed: IdVec<VertexId, DVec2> = map.iter().zip(&by).map(|(at, by)| *at + *by).collect();
        assert!(distortion(&mesh, &crossed).crossings > 0, "the field alone makes the rims cross");
        let Bent::Done(uv, _) = bend(&mesh, &map, &held, &[]).unwrap() else { panic!("it folds") };
        let measured = distortion(&mesh, &uv);
        assert_eq!((measured.flips, measured.crossings), (0, 0));
        assert!(held.iter().all(|&(v, to)| uv[v].distance(to) < 1e-12));
    }
}
