//! The bottom of a sphere: the simulated experiment of Cannata, Denei and Mastrogiovanni.

use std::collections::HashMap;

use dermatome::{mesh::TriMesh, skin::Skin};
use glam::{DVec2, DVec3};

use crate::grid::snapped;

/// Number of taxels.
const TAXELS: usize = 500;
/// Their distance, in m.
const SPACING: f64 = 0.005;
/// Radius of the sphere, in m.
const RADIUS: f64 = 0.1;
/// Centre of the disk of lattice points that are taken, in spacings: off every symmetry, so that no
/// two are equally far.
const CENTRE: DVec2 = DVec2::new(0.13, 0.07);

/// 500 taxels, 5 mm apart, around the south pole of a sphere of 0.1 m radius.
pub fn sphere_cap() -> Skin {
    Skin::from_mesh("sphere_cap", snapped(lifted_lattice()))
}

/// The points of the triangular lattice nearest to [`CENTRE`], lifted to the sphere by Lambert's
/// equal-area projection.
fn lifted_lattice() -> TriMesh {
    let place = |(a, b): (i32, i32)| {
        let (a, b) = (f64::from(a), f64::from(b));
        DVec2::new(a + 0.5 * b, 0.75_f64.sqrt() * b) - CENTRE
    };
    let mut points: Vec<(i32, i32)> = (-60..=60).flat_map(|a| (-60..=60).map(move |b| (a, b))).collect();
    points.sort_by(|&p, &q| place(p).length_squared().total_cmp(&place(q).length_squared()));
    points.truncate(TAXELS);
    points.sort_by_key(|&(a, b)| (b, a));
    let number: HashMap<(i32, i32), u32> = points.iter().copied().zip(0..).collect();
    let mut triangles = Vec::new();
    for &(a, b) in &points {
        let at = |a: i32, b: i32| number.get(&(a, b)).copied();
        // Clockwise in the plane, seen from above: counter-clockwise seen from outside, below.
        for corners in [[at(a, b), at(a, b + 1), at(a + 1, b)], [at(a, b), at(a + 1, b), at(a + 1, b - 1)]] {
            if let [Some(p), Some(q), Some(r)] = corners {
                triangles.push([p, q, r]);
            }
        }
    }
    let lift = |p: DVec2| {
        // Sine and cosine of half the polar angle: the projection needs no others.
        let sin = p.length() / (2.0 * RADIUS);
        let cos = (1.0 - sin * sin).sqrt();
        DVec3::new(p.x * cos, p.y * cos, RADIUS * (2.0 * sin * sin - 1.0))
    };
    TriMesh::from_arrays(points.iter().map(|&p| lift(SPACING * place(p))).collect(), &triangles)
}

#[cfg(test)]
mod tests {
    use dermatome::mesh::Adjacency;

    use super::*;

    #[test]
    fn the_cap_is_that_of_the_simulated_experiment() {
        let mesh = lifted_lattice();
        let adjacency = Adjacency::new(&mesh).unwrap();
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (500, 920));
        assert_eq!(adjacency.euler_characteristic(), 1, "so there are 1419 edges");
        assert_eq!(adjacency.boundary_loops().iter().map(Vec::len).collect::<Vec<_>>(), [78]);
        let edge = mesh.positions.iter().map(|p| (-p.z / RADIUS).acos().to_degrees()).fold(0.0, f64::max);
        assert!(
            (33.0..35.0).contains(&edge),
            "half-angle about 34.1 degrees, the outermost taxel is at {edge}"
        );
        assert!(mesh.positions.iter().all(|p| (p.length() - RADIUS).abs() < 1e-15), "on the sphere");
    }
}
