//! A glove: the closed surface of a palm with five fingers, wrist included.

use dermatome::{
    mesh::{Adjacency, TriMesh},
    skin::Skin,
};
use glam::DVec3;

use crate::grid::snapped;

/// Side of the cells in which the surface is found, in m: about the spacing of the taxels.
const CELL: f64 = 0.0026;
/// Corners of the box of cells, in m.
const BOX: [DVec3; 2] = [DVec3::new(-0.065, -0.012, -0.035), DVec3::new(0.105, 0.178, 0.025)];
/// About the width of the rounding between palm and fingers, in m.
const WIDTH: f64 = 0.010;
/// Rounds that even out the spacing.
const ROUNDS: usize = 12;

/// Middle of the palm and half its size less its rounding, in m.
const PALM: [DVec3; 2] = [DVec3::new(0.0, 0.042, 0.0), DVec3::new(0.028, 0.032, 0.002)];
/// Rounding of the palm, in m.
const ROUNDING: f64 = 0.012;

/// Thumb, index, middle, ring and little finger of a left hand, a little curled: where its axis
/// starts and ends, and its radius, in m.
const FINGERS: [(DVec3, DVec3, f64); 5] = [
    (DVec3::new(0.024, 0.030, 0.0), DVec3::new(0.082, 0.074, -0.014), 0.0105),
    (DVec3::new(0.028, 0.070, 0.0), DVec3::new(0.046, 0.144, -0.012), 0.0090),
    (DVec3::new(0.009, 0.074, 0.0), DVec3::new(0.016, 0.157, -0.014), 0.0090),
    (DVec3::new(-0.010, 0.074, 0.0), DVec3::new(-0.016, 0.151, -0.014), 0.0090),
    (DVec3::new(-0.028, 0.070, 0.0), DVec3::new(-0.046, 0.131, -0.012), 0.0085),
];

/// Some thousand taxels on a closed hand.
pub fn glove() -> Skin {
    Skin::from_mesh("glove", snapped(relaxed(surface())))
}

/// About the signed distance to the hand, in m, negative inside.
fn distance(p: DVec3) -> f64 {
    let beyond = (p - PALM[0]).abs() - PALM[1];
    let palm = beyond.max(DVec3::ZERO).length() + beyond.max_element().min(0.0) - ROUNDING;
    let finger = |&(root, tip, radius): &(DVec3, DVec3, f64)| {
        let axis: DVec3 = tip - root;
        let share = ((p - root).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
        p.distance(root + share * axis) - radius
    };
    // Polynomial smooth minimum (Quilez 2013).
    FINGERS.iter().map(finger).fold(palm, |a, b| {
        let near = (WIDTH - (a - b).abs()).max(0.0);
        a.min(b) - 0.25 * near * near / WIDTH
    })
}

/// The nearest place of the surface, by Newton steps.
fn on_surface(mut p: DVec3) -> DVec3 {
    for _ in 0..3 {
        let half = 0.1 * CELL;
        let slope = |axis: DVec3| (distance(p + half * axis) - distance(p - half * axis)) / (2.0 * half);
        let gradient = DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z));
        p -= distance(p) * gradient / gradient.length_squared();
    }
    p
}

/// A vertex in each cell that the surface passes through, and a quadrilateral across each edge of the
/// grid that it crosses (surface nets, Gibson 1998), split along its shorter diagonal.
fn surface() -> TriMesh {
    let [low, high] = BOX;
    let steps = ((high - low) / CELL).ceil();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some dozen cells a side")]
    let size = steps.to_array().map(|n| n as usize);
    let at = |[i, j, k]: [usize; 3]| low + CELL * DVec3::new(i as f64, j as f64, k as f64);
    let index = |[i, j, k]: [usize; 3]| (k * (size[1] + 1) + j) * (size[0] + 1) + i;
    let mut values = vec![0.0; (size[0] + 1) * (size[1] + 1) * (size[2] + 1)];
    each_cell(size.map(|n| n + 1), |corner| values[index(corner)] = distance(at(corner)));
    let mut positions = Vec::new();
    let mut vertex_of = vec![u32::MAX; values.len()];
    each_cell(size, |cell| {
        let corner = |c: usize| [0, 1, 2].map(|axis| cell[axis] + ((c >> axis) & 1));
        let (mut sum, mut count) = (DVec3::ZERO, 0.0);
        for (a, b) in (0..8).flat_map(|a| [1, 2, 4].map(|bit| (a, a | bit))).filter(|(a, b)| a != b) {
            let [u, v] = [a, b].map(|c| values[index(corner(c))]);
            if (u < 0.0) != (v < 0.0) {
                sum += at(corner(a)).lerp(at(corner(b)), u / (u - v));
                count += 1.0;
            }
        }
        if count > 0.0 {
            vertex_of[index(cell)] = u32::try_from(positions.len()).expect("some thousand vertices");
            positions.push(on_surface(sum / count));
        }
    });
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    each_cell(size, |cell| {
        for axis in 0..3 {
            let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
            let mut end = cell;
            end[axis] += 1;
            let [inside, beyond] = [cell, end].map(|corner| values[index(corner)] < 0.0);
            if inside == beyond {
                continue;
            }
            let around = [[1, 1], [0, 1], [0, 0], [1, 0]].map(|[du, dv]| {
                let mut beside = cell;
                (beside[u], beside[v]) = (cell[u] - du, cell[v] - dv);
                vertex_of[index(beside)]
            });
            let [a, b, c, d] = if inside { around } else { [around[3], around[2], around[1], around[0]] };
            let diagonal = |p: u32, q: u32| positions[p as usize].distance_squared(positions[q as usize]);
            triangles.extend(if diagonal(a, c) < diagonal(b, d) {
                [[a, b, c], [a, c, d]]
            } else {
                [[a, b, d], [b, c, d]]
            });
        }
    });
    TriMesh::from_arrays(positions, &triangles)
}

/// Visits every cell of a grid, x fastest.
fn each_cell([columns, rows, layers]: [usize; 3], mut visit: impl FnMut([usize; 3])) {
    for k in 0..layers {
        for j in 0..rows {
            (0..columns).for_each(|i| visit([i, j, k]));
        }
    }
}

/// The same with evenly spaced vertices: each moves towards the middle of its neighbours and back to
/// the surface, a few times.
fn relaxed(mut mesh: TriMesh) -> TriMesh {
    let adjacency = Adjacency::new(&mesh).expect("a surface net of a thick body is a manifold");
    for _ in 0..ROUNDS {
        let before = mesh.positions.clone();
        for (v, p) in before.enumerate() {
            let ring = adjacency.ring(v);
            let middle = ring.iter().map(|&w| before[w]).sum::<DVec3>() / ring.len() as f64;
            mesh.positions[v] = on_surface(p.lerp(middle, 0.5));
        }
    }
    mesh
}
