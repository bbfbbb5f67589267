//! The meshes of boxes, cylinders, capsules, ellipsoids and spheres, fine enough to look like them.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::DVec3;

use crate::mesh::{TriMesh, shapes};
use crate::robot::Geometry;

/// Edges around a cylinder, and along the longest side of a box.
const AROUND: u32 = 48;
const ALONG: f64 = 16.0;

/// The closed surface of a shape that needs no file.
#[doc(hidden)]
pub fn triangles_of(geometry: &Geometry) -> Option<TriMesh> {
    match *geometry {
        Geometry::Mesh { .. } => None,
        Geometry::Box { size } => Some(block(size)),
        Geometry::Triangles { ref mesh } => Some(mesh.clone()),
        Geometry::Cylinder { radius, length } => Some(cylinder(radius, length)),
        Geometry::Capsule { radius, length } => Some(capsule(radius, length)),
        Geometry::Ellipsoid { radii } => {
            let mut mesh = shapes::ball(AROUND / 4, 1.0);
            mesh.positions.iter_mut().for_each(|p| *p *= radii);
            Some(mesh)
        }
        Geometry::Sphere { radius } => Some(shapes::ball(AROUND / 4, radius)),
    }
}

/// A box: a lattice on each side, whose edges are as equal in length as possible.
fn block(size: DVec3) -> TriMesh {
    let edge = size.max_element() / ALONG;
    let cells = size.to_array().map(|side| cells(side, edge));
    let solid = |p: [i32; 3]| (0..3).all(|axis| p[axis] >= 0 && p[axis] < cells[axis]);
    let step = size / DVec3::from_array(cells.map(f64::from));
    let mut mesh = shapes::blocks(cells, 1.0, solid, |_| false);
    mesh.positions.iter_mut().for_each(|p| *p = *p * step - 0.5 * size);
    mesh
}

/// How many edges fit along a side, at least one.
fn cells(side: f64, edge: f64) -> i32 {
    let mut count = 1;
    while f64::from(count) < ALONG && f64::from(count + 1) * edge <= side * (1.0 + 1e-9) {
        count += 1;
    }
    count
}

/// A cylinder with rings of [`AROUND`] vertices, and a fan at either end.
fn cylinder(radius: f64, length: f64) -> TriMesh {
    let rings = rings(radius, length);
    let mut mesh = shapes::tube(AROUND, rings, radius, length);
    mesh.positions.iter_mut().for_each(|p| p.z -= 0.5 * length);
    with_ends(&mesh, rings, 0.5 * length)
}

/// Rings of a cylinder that make its triangles about as long as they are wide.
fn rings(radius: f64, length: f64) -> u32 {
    let edge = TAU * radius / f64::from(AROUND);
    cells(length, edge.max(length / ALONG)).cast_unsigned() + 1
}

/// A capsule: a cylinder, and rings of half a sphere at either end.
fn capsule(radius: f64, length: f64) -> TriMesh {
    let steps = AROUND / 4;
    let middle = rings(radius, length);
    let mut rows: Vec<[f64; 2]> = Vec::new();
    let bow = |k: u32| FRAC_PI_2 * f64::from(k) / f64::from(steps);
    let end = |k: u32, side: f64| [bow(k).cos(), side * (0.5 * length + radius * bow(k).sin())];
    rows.extend((1..steps).rev().map(|k| end(k, -1.0)));
    rows.extend((0..middle).map(|k| [1.0, length * (f64::from(k) / f64::from(middle - 1) - 0.5)]));
    rows.extend((1..steps).map(|k| end(k, 1.0)));
    let mut mesh = shapes::tube(AROUND, middle + 2 * (steps - 1), radius, 1.0);
    let rows = rows.iter().flat_map(|row| std::iter::repeat_n(row, AROUND as usize));
    for (p, &[width, z]) in mesh.positions.iter_mut().zip(rows) {
        *p = DVec3::new(p.x * width, p.y * width, z);
    }
    with_ends(&mesh, middle + 2 * (steps - 1), 0.5 * length + radius)
}

/// A tube of [`AROUND`] vertices a ring, closed by a fan at either end, at this height and its opposite.
fn with_ends(mesh: &TriMesh, rings: u32, height: f64) -> TriMesh {
    let mut triangles: Vec<[u32; 3]> = mesh.triangles.iter().map(|t| t.map(|v| v.raw())).collect();
    let [bottom, top] = [AROUND * rings, AROUND * rings + 1];
    let last = AROUND * (rings - 1);
    triangles.extend((0..AROUND).flat_map(|i| {
        let next = (i + 1) % AROUND;
        [[next, i, bottom], [last + i, last + next, top]]
    }));
    let ends = [-height, height].map(|z| DVec3::Z * z);
    TriMesh::from_arrays(mesh.positions.iter().copied().chain(ends).collect(), &triangles)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::mesh::Adjacency;

    fn volume(mesh: &TriMesh) -> f64 {
        let six = mesh.triangles.ids().map(|face| {
            let [a, b, c] = mesh.corners(face);
            a.dot(b.cross(c))
        });
        six.sum::<f64>() / 6.0
    }

    /// A closed surface with its normals outwards encloses the volume of the shape.
    #[test]
    fn primitives_are_closed_and_enclose_their_volume() {
        let size = DVec3::new(0.3, 0.02, 0.1);
        for (geometry, expected, error) in [
            (Geometry::Box { size }, 0.3 * 0.02 * 0.1, 1e-12),
            (
                Geometry::Capsule { radius: 0.05, length: 0.2 },
                PI * 0.05 * 0.05 * (0.2 + 4.0 / 3.0 * 0.05),
                0.01,
            ),
            (Geometry::Ellipsoid { radii: 0.5 * size }, PI / 6.0 * 0.3 * 0.02 * 0.1, 0.02),
            (Geometry::Cylinder { radius: 0.05, length: 0.2 }, PI * 0.05 * 0.05 * 0.2, 0.01),
            (Geometry::Cylinder { radius: 0.5, length: 1e-3 }, PI * 0.25 * 1e-3, 0.01),
            (Geometry::Sphere { radius: 0.1 }, 4.0 / 3.0 * PI * 1e-3, 0.02),
        ] {
            let mesh = triangles_of(&geometry).unwrap();
            assert_eq!(Adjacency::new(&mesh).unwrap().euler_characteristic(), 2, "{geometry:?}");
            let found = volume(&mesh);
            assert!((found / expected - 1.0).abs() <= error, "{geometry:?}: volume {found}, not {expected}");
        }
    }
}
