//! Keeps the triangles of a map upright when its positions are rounded to f32: a needle may be
//! thinner than the spacing of f32 numbers.
//!
//! *Heuristic*: a corner of a triangle that rounding turned over moves by a few units of rounding, to
//! the nearest place where all triangles around it are upright. A thin plate of CAD with 3548 faces
//! whose needles have aspects up to 2e7 could not be written for such a triangle, and can.

use crate::{
    id::{FaceId, VertexId},
    mesh::{TriMesh, VertexCorners},
};

/// Spacing of f32 numbers just below 1.
const UNIT: f32 = f32::EPSILON / 2.0;

/// Units that a corner moves, at most, in both directions.
const REACH: i16 = 6;

/// Times that each triangle is tried: the neighbour of one may be in its way.
const PASSES: usize = 4;

/// Moves corners of triangles that are not `upright` as little as it takes, where that helps.
pub(super) fn keep_upright(
    texture: &mut [[f32; 2]],
    mesh: &TriMesh,
    upright: &dyn Fn(FaceId, &[[f32; 2]]) -> bool,
) {
    let mut fallen: Vec<FaceId> = mesh.triangles.ids().filter(|&face| !upright(face, texture)).collect();
    if fallen.is_empty() {
        return;
    }
    let corners = VertexCorners::new(mesh.triangles.iter().copied(), mesh.positions.len());
    let all = || (-REACH..=REACH).flat_map(|i| (-REACH..=REACH).map(move |j| [i, j]));
    let at_square = |square: i16| all().filter(move |[i, j]| i * i + j * j == square);
    let offsets: Vec<[i16; 2]> = (0..=2 * REACH * REACH).flat_map(at_square).collect();
    for _ in 0..PASSES {
        for &face in &fallen {
            for v in mesh.triangles[face] {
                let around: Vec<FaceId> = corners.of(v).iter().map(|corner| corner.face()).collect();
                move_corner(texture, v, &offsets, &|texture| {
                    around.iter().filter(|&&face| !upright(face, texture)).count()
                });
            }
        }
        fallen.retain(|&face| !upright(face, texture));
    }
}

/// Moves a corner by the first of the `offsets` that leaves the fewest triangles `fallen`.
fn move_corner(
    texture: &mut [[f32; 2]],
    corner: VertexId,
    offsets: &[[i16; 2]],
    fallen: &dyn Fn(&[[f32; 2]]) -> usize,
) {
    let at = texture[corner.index()];
    let (mut best, mut least) = (at, fallen(texture));
    for [i, j] in offsets {
        if least == 0 {
            break;
        }
        let moved = [at[0] + f32::from(*i) * UNIT, at[1] + f32::from(*j) * UNIT];
        if moved.iter().all(|x| (0.0..=1.0).contains(x)) {
            texture[corner.index()] = moved;
            let count = fallen(texture);
            if count < least {
                (best, least) = (moved, count);
            }
        }
    }
    texture[corner.index()] = best;
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, DVec3};

    use super::*;

    /// The tip of a needle lies below its base by less than the spacing of f32 numbers.
    #[test]
    fn a_needle_that_rounding_turned_over_stands_up() {
        let mut texture = [[0.1, 0.5], [0.9, 0.9], [0.5, 0.7 - UNIT], [0.2, 0.95], [0.8, 0.1]];
        let faces = [[0, 1, 2], [2, 1, 3], [0, 2, 3], [0, 4, 1]];
        let mesh = TriMesh::from_arrays(vec![DVec3::ZERO; 5], &faces);
        let upright = |face: FaceId, texture: &[[f32; 2]]| {
            let [a, b, c] =
                mesh.triangles[face].map(|v| DVec2::from_array(texture[v.index()].map(f64::from)));
            (b - a).perp_dot(c - a) > 0.0
        };
        let fallen = |texture: &[[f32; 2]]| mesh.triangles.ids().find(|&face| !upright(face, texture));
        let before = texture;
        assert_eq!(fallen(&texture), Some(FaceId::new(0)));
        keep_upright(&mut texture, &mesh, &upright);
        assert_eq!(fallen(&texture), None, "{texture:?}");
        let moved = texture.iter().flatten().zip(before.iter().flatten()).map(|(a, b)| (a - b).abs());
        assert!(moved.fold(0.0, f32::max) <= 2.0 * UNIT, "{texture:?}");
    }
}
