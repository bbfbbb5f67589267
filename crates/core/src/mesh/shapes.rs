//! Small named shapes: the meshes of tests and examples.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use crate::{id::VertexId, mesh::TriMesh};

/// One right triangle with legs of 1 m in the plane z = 0.
pub fn triangle() -> TriMesh {
    TriMesh::from_arrays(vec![DVec3::ZERO, DVec3::X, DVec3::Y], &[[0, 1, 2]])
}

/// The unit square in the plane z = 0, cut along a diagonal.
pub fn square() -> TriMesh {
    TriMesh::from_arrays(
        vec![DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y],
        &[[0, 1, 2], [0, 2, 3]],
    )
}

/// A vertex at the origin with `n >= 3` neighbours on the unit circle in the plane z = 0.
pub fn fan(n: u32) -> TriMesh {
    let rim = (0..n).map(|k| {
        let (sin, cos) = (TAU * f64::from(k) / f64::from(n)).sin_cos();
        DVec3::new(cos, sin, 0.0)
    });
    let triangles: Vec<_> = (0..n).map(|k| [0, 1 + k, 1 + (k + 1) % n]).collect();
    TriMesh::from_arrays(std::iter::once(DVec3::ZERO).chain(rim).collect(), &triangles)
}

/// A regular tetrahedron: closed, Euler characteristic 2.
pub fn tetrahedron() -> TriMesh {
    TriMesh::from_arrays(
        vec![
            DVec3::new(1.0, 1.0, 1.0),
            DVec3::new(-1.0, -1.0, 1.0),
            DVec3::new(-1.0, 1.0, -1.0),
            DVec3::new(1.0, -1.0, -1.0),
        ],
        &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
    )
}

/// A flat triangular lattice of `columns x rows` vertices, `spacing` metres apart: every inner
/// triangle is equilateral.
pub fn lattice(columns: u32, rows: u32, spacing: f64) -> TriMesh {
    sheet(columns, rows, |i, j| {
        let x = f64::from(i) + 0.5 * f64::from(j % 2);
        DVec3::new(x * spacing, f64::from(j) * spacing * 0.75_f64.sqrt(), 0.0)
    })
}

/// A lattice of `columns x rows` vertices placed by `position(column, row)`, as one disk.
pub fn sheet(columns: u32, rows: u32, position: impl Fn(u32, u32) -> DVec3) -> TriMesh {
    let positions = (0..rows).flat_map(|j| (0..columns).map(move |i| (i, j)));
    let triangles = between_rows(columns, rows, columns.saturating_sub(1));
    TriMesh::from_arrays(positions.map(|(i, j)| position(i, j)).collect(), &triangles)
}

/// The triangles between rows of vertices, odd ones shifted by half a spacing, `cells` pairs
/// between two rows; if `cells` is `columns`, the rows are closed.
fn between_rows(columns: u32, rows: u32, cells: u32) -> Vec<[u32; 3]> {
    let mut triangles = Vec::new();
    for j in 0..rows.saturating_sub(1) {
        for i in 0..cells {
            let [a, b] = [j * columns + i, j * columns + (i + 1) % columns];
            let [c, d] = [a + columns, b + columns];
            let pair = if j % 2 == 0 { [[a, b, c], [b, d, c]] } else { [[a, b, d], [a, d, c]] };
            triangles.extend(pair);
        }
    }
    triangles
}

/// A tube open at both ends around the z axis: two boundary loops, Euler characteristic 0.
pub fn tube(around: u32, along: u32, radius: f64, height: f64) -> TriMesh {
    let positions = (0..along).flat_map(|j| {
        (0..around).map(move |i| {
            let turn = f64::from(i) + 0.5 * f64::from(j % 2);
            let (sin, cos) = (TAU * turn / f64::from(around)).sin_cos();
            let z = height * f64::from(j) / f64::from(along - 1);
            DVec3::new(radius * cos, radius * sin, z)
        })
    });
    TriMesh::from_arrays(positions.collect(), &between_rows(around, along, around))
}

/// A torus: closed, one handle, Euler characteristic 0.
pub fn torus(around: u32, across: u32, radius: f64, thickness: f64) -> TriMesh {
    let positions = (0..across).flat_map(|j| {
        (0..around).map(move |i| {
            let (sin, cos) = (TAU * f64::from(i) / f64::from(around)).sin_cos();
            let (up, out) = (TAU * f64::from(j) / f64::from(across)).sin_cos();
            let r = radius + thickness * out;
            DVec3::new(r * cos, r * sin, thickness * up)
        })
    });
    let mut triangles = Vec::new();
    for j in 0..across {
        for i in 0..around {
            let at = |i: u32, j: u32| (j % across) * around + i % around;
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
            triangles.extend([[a, b, d], [a, d, c]]);
        }
    }
    TriMesh::from_arrays(positions.collect(), &triangles)
}

/// A whole sphere: closed, Euler characteristic 2. An octahedron with `fine` edges along each of
/// its own, pushed out.
pub fn ball(fine: u32, radius: f64) -> TriMesh {
    let mut lattice = Lattice::default();
    let n = fine.cast_signed();
    for octant in 0..8 {
        let signs = [1, 2, 4].map(|bit| if octant & bit == 0 { 1 } else { -1 });
        let is_mirrored = signs.iter().product::<i32>() < 0;
        let corner = |i: i32, j: i32| [signs[0] * i, signs[1] * j, signs[2] * (n - i - j)];
        for (i, j) in (0..n).flat_map(|i| (0..n - i).map(move |j| (i, j))) {
            let [a, b, c] = [corner(i, j), corner(i + 1, j), corner(i, j + 1)];
            lattice.add(if is_mirrored { [a, c, b] } else { [a, b, c] });
            if i + j + 1 < n {
                let d = corner(i + 1, j + 1);
                lattice.add(if is_mirrored { [b, c, d] } else { [b, d, c] });
            }
        }
    }
    lattice.mesh(|p| radius * p.normalize())
}

/// A flat block with `windows` square holes through it in a row: closed, a handle for each window.
/// Every side of a window is `fine` edges of `edge` metres long, as are the bars around it.
pub fn frame(windows: u32, fine: u32, edge: f64) -> TriMesh {
    let (w, f) = (windows.cast_signed(), fine.cast_signed());
    let is_solid = |[x, y, z]: [i32; 3]| {
        let inside = x >= 0 && x < (2 * w + 1) * f && y >= 0 && y < 3 * f && z >= 0 && z < f;
        inside && !(x / f % 2 == 1 && y / f == 1)
    };
    blocks([(2 * w + 1) * f, 3 * f, f], edge, is_solid, |_| false)
}

/// Four square tubes that meet in a plane, open at their ends and twice as long as wide. Every side is
/// `fine` edges of `edge` metres.
pub fn cross(fine: u32, edge: f64) -> TriMesh {
    let f = fine.cast_signed();
    let is_solid = |[x, y, z]: [i32; 3]| {
        let is_inside = |p: i32, size: i32| p >= 0 && p < size * f;
        is_inside(x, 5) && is_inside(y, 5) && is_inside(z, 1) && (x / f == 2 || y / f == 2)
    };
    blocks([5 * f, 5 * f, f], edge, is_solid, |[x, y, _]| x.min(y) < 0 || x.max(y) >= 5 * f)
}

/// The surface of the solid cells of `edge` metres within `size`, without the sides towards open cells.
pub(crate) fn blocks(
    size: [i32; 3],
    edge: f64,
    is_solid: impl Fn([i32; 3]) -> bool,
    is_open: impl Fn([i32; 3]) -> bool,
) -> TriMesh {
    let mut lattice = Lattice::default();
    let cells =
        (0..size[0]).flat_map(|x| (0..size[1]).flat_map(move |y| (0..size[2]).map(move |z| [x, y, z])));
    for cell in cells.filter(|&cell| is_solid(cell)) {
        for axis in 0..3 {
            for (step, side) in [(1, 1), (-1, 0)] {
                let (mut beyond, mut from) = (cell, cell);
                beyond[axis] += step;
                from[axis] += side;
                if is_solid(beyond) || is_open(beyond) {
                    continue;
                }
                let corner = |along: i32, across: i32| {
                    let mut p = from;
                    p[(axis + 1) % 3] += along;
                    p[(axis + 2) % 3] += across;
                    p
                };
                let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                let [b, d] = if step > 0 { [b, d] } else { [d, b] };
                lattice.add([a, b, c]);
                lattice.add([a, c, d]);
            }
        }
    }
    lattice.mesh(|p| edge * p)
}

/// Triangles between points with integer coordinates; each point is one vertex.
#[derive(Default)]
struct Lattice {
    points: Vec<[i32; 3]>,
    numbers: std::collections::BTreeMap<[i32; 3], u32>,
    triangles: Vec<[u32; 3]>,
}

impl Lattice {
    fn add(&mut self, corners: [[i32; 3]; 3]) {
        self.triangles.push(corners.map(|p| {
            *self.numbers.entry(p).or_insert_with(|| {
                self.points.push(p);
                VertexId::new(self.points.len() - 1).raw()
            })
        }));
    }

    fn mesh(self, position: impl Fn(DVec3) -> DVec3) -> TriMesh {
        let positions = self.points.iter().map(|p| position(DVec3::from_array(p.map(f64::from))));
        TriMesh::from_arrays(positions.collect(), &self.triangles)
    }
}

/// The bottom of a sphere of `radius` metres up to `half_angle` rad from its south pole, with
/// about `faces` triangles: concentric rings of nearly equal spacing, outward normals.
pub fn cap(faces: usize, radius: f64, half_angle: f64) -> TriMesh {
    let area = TAU * (1.0 - half_angle.cos());
    let spacing = (area / faces as f64 * 4.0 / 3.0_f64.sqrt()).sqrt();
    let rings = ring_sizes(half_angle, spacing);
    let mut positions = vec![DVec3::new(0.0, 0.0, -radius)];
    for (k, &n) in rings.iter().enumerate() {
        let polar = half_angle * (k + 1) as f64 / rings.len() as f64;
        for i in 0..n {
            // Clockwise seen from above is counter-clockwise seen from outside, below.
            let turn = -TAU * (f64::from(i) + 0.5 * (k % 2) as f64) / f64::from(n);
            let flat = DVec2::from_angle(turn) * polar.sin();
            positions.push(radius * flat.extend(-polar.cos()));
        }
    }
    let mut triangles: Vec<[u32; 3]> = (0..rings[0]).map(|i| [0, 1 + i, 1 + (i + 1) % rings[0]]).collect();
    let mut inner_start = 1;
    for (k, pair) in rings.windows(2).enumerate() {
        stitch(&mut triangles, inner_start, pair[0], pair[1], k);
        inner_start += pair[0];
    }
    TriMesh::from_arrays(positions, &triangles)
}

/// Vertices of each ring of [`cap`], on the unit sphere.
fn ring_sizes(half_angle: f64, spacing: f64) -> Vec<u32> {
    let mut sizes = Vec::new();
    let count = (half_angle / (spacing * 0.75_f64.sqrt())).round().max(1.0);
    let mut k = 1.0;
    while k <= count {
        let around = TAU * (half_angle * k / count).sin() / spacing;
        let mut n = 6;
        while f64::from(n) + 0.5 < around {
            n += 1;
        }
        sizes.push(n);
        k += 1.0;
    }
    sizes
}

/// Joins ring `k` (`n` vertices from `start`) with the next one (`m` vertices): always with the diagonal
/// whose end has the smaller angle.
fn stitch(triangles: &mut Vec<[u32; 3]>, start: u32, n: u32, m: u32, k: usize) {
    let phase = |k: usize| 0.5 * (k % 2) as f64;
    let inner = |i: u32| start + i % n;
    let outer = |i: u32| start + n + i % m;
    let turn = |i: u32, n: u32, k: usize| (f64::from(i) + phase(k)) / f64::from(n);
    let (mut i, mut j) = (0, 0);
    while i < n || j < m {
        let step_inner = j >= m || (i < n && turn(i + 1, n, k) < turn(j + 1, m, k + 1));
        if step_inner {
            triangles.push([inner(i), outer(j), inner(i + 1)]);
            i += 1;
        } else {
            triangles.push([inner(i), outer(j), outer(j + 1)]);
            j += 1;
        }
    }
}

/// A strongly curved disk of `columns x columns` vertices and 0.2 m side: a saddle with bumps.
pub fn saddle(columns: u32) -> TriMesh {
    sheet(columns, columns, |i, j| {
        let step = 2.0 / f64::from(columns - 1);
        let (x, y) = (f64::from(i) * step - 1.0, f64::from(j) * step - 1.0);
        let z = 0.5 * (x * x - y * y) + 0.15 * (PI * 1.5 * x).sin() * (PI * 1.5 * y).cos();
        0.1 * DVec3::new(x, y, z)
    })
}
