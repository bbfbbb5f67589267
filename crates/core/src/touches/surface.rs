//! The surface through points that are not joined: spacing, neighbours, normals.
//!
//! *Heuristic*: each normal is that of a quadric through the neighbours within [`REACH`] spacings. A plane
//! is wrong by 1 degree at the rim of a skin of 0.1 m radius, since its neighbours are on one side; a quadric is not.

use std::collections::BTreeMap;

use glam::{DVec3, IVec3};

use crate::id::{IdVec, VertexId};
use crate::numeric::{median, nth_smallest, solve_system, symmetric_eigen};
use crate::parallel::par_ids;

/// Neighbours within this many spacings determine a normal.
const REACH: f64 = 4.5;

/// A quadric needs this many neighbours; with fewer a plane is fitted.
const LEAST_FOR_QUADRIC: usize = 9;

/// Bends are damped as if each neighbourhood had this many more points on its plane.
const DAMPING: f64 = 0.02;

/// Points by the cube in which they are.
pub(super) struct Cubes<'a> {
    points: &'a IdVec<VertexId, DVec3>,
    side: f64,
    cubes: BTreeMap<[i32; 3], Vec<VertexId>>,
}

impl<'a> Cubes<'a> {
    pub(super) fn new(points: &'a IdVec<VertexId, DVec3>, side: f64) -> Self {
        let mut cubes: BTreeMap<[i32; 3], Vec<VertexId>> = BTreeMap::new();
        for (v, &point) in points.enumerate() {
            cubes.entry(Self::cube(point, side).to_array()).or_default().push(v);
        }
        Self { points, side, cubes }
    }

    fn cube(point: DVec3, side: f64) -> IVec3 {
        (point / side).floor().as_ivec3()
    }

    /// The other points within one side of a cube, by their numbers.
    pub(super) fn around(&self, v: VertexId) -> Vec<VertexId> {
        let mut found = self.near(self.points[v]);
        found.retain(|u| *u != v);
        found
    }

    /// The points within one side of a cube of a place, by their numbers.
    fn near(&self, here: DVec3) -> Vec<VertexId> {
        let cube = Self::cube(here, self.side);
        let steps = (0..27).map(|k| IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1));
        let near = steps.filter_map(|step| self.cubes.get(&cube.saturating_add(step).to_array())).flatten();
        let is_near = |u: &VertexId| self.points[*u].distance(here) <= self.side;
        let mut found: Vec<VertexId> = near.copied().filter(is_near).collect();
        found.sort_unstable();
        found
    }
}

/// The spacing of points over the median distance of the sixth nearest one. That is 1 on a triangular lattice, 0.71 on a square one, and
/// 0.78 where errors have spread the points evenly: the nearest point is then at half a spacing.
/// The least of these keeps the spacing of exact lattices.
const SIXTH: f64 = 0.7;

/// The median distance of a point from its nearest other one, in m; `None` below two points or if they coincide.
pub(super) fn spacing(points: &IdVec<VertexId, DVec3>) -> Option<f64> {
    distance_of_nearest(points, 1)
}

/// The spacing of points that may be off by half of it and more.
pub(super) fn spacing_of_guesses(points: &IdVec<VertexId, DVec3>) -> Option<f64> {
    let sixth = distance_of_nearest(points, 6).map_or(0.0, |distance| SIXTH * distance);
    spacing(points).map(|nearest| nearest.max(sixth))
}

/// The median distance of a point from the nearest other one, or the second nearest and so on; `None` if there is none.
fn distance_of_nearest(points: &IdVec<VertexId, DVec3>, rank: usize) -> Option<f64> {
    let [least, most] = [DVec3::min, DVec3::max].map(|of| points.iter().copied().reduce(of));
    let size = (most? - least?).max_element();
    let mut side = size / (points.len() as f64).sqrt();
    // Cubes grow until most points have a neighbour in them.
    for _ in 0..64 {
        if side.is_nan() || side <= 0.0 {
            return None;
        }
        let cubes = Cubes::new(points, side);
        let nearest = |v: VertexId| {
            let others = cubes.around(v).into_iter();
            let distances: Vec<f64> = others.map(|u| points[u].distance(points[v])).collect();
            nth_smallest(distances, rank - 1)
        };
        let found: Vec<f64> = points.ids().filter_map(nearest).collect();
        if 4 * found.len() >= 3 * points.len() {
            return median(found.into_iter()).filter(|&spacing| spacing > 0.0);
        }
        side *= 1.5;
    }
    None
}

/// The points within `reach` (m) of each.
pub(super) fn neighbours(points: &IdVec<VertexId, DVec3>, reach: f64) -> IdVec<VertexId, Vec<VertexId>> {
    let cubes = Cubes::new(points, reach);
    points.ids().map(|v| cubes.around(v)).collect()
}

/// Unit normals of the surface through points, to no particular side; `None` where fewer than three are near.
pub(super) fn normals(points: &IdVec<VertexId, DVec3>, spacing: f64) -> IdVec<VertexId, Option<DVec3>> {
    normals_at(points, points, spacing)
}

/// Unit normals of the surface through points, at some places.
pub(super) fn normals_at(
    places: &IdVec<VertexId, DVec3>,
    points: &IdVec<VertexId, DVec3>,
    spacing: f64,
) -> IdVec<VertexId, Option<DVec3>> {
    let cubes = Cubes::new(points, REACH * spacing);
    par_ids(places.len(), |v: VertexId| normal(points, places[v], &cubes.near(places[v]), spacing))
}

/// The normal of the quadric through points around a place, there.
fn normal(points: &IdVec<VertexId, DVec3>, here: DVec3, around: &[VertexId], spacing: f64) -> Option<DVec3> {
    if around.len() < 3 {
        return None;
    }
    let mean = around.iter().map(|&u| points[u]).sum::<DVec3>() / around.len() as f64;
    let mut scatter = [[0.0; 3]; 3];
    for q in around.iter().map(|&u| points[u] - mean) {
        let q = q.to_array();
        for (row, a) in scatter.iter_mut().zip(q) {
            row.iter_mut().zip(q).for_each(|(cell, b)| *cell += a * b);
        }
    }
    let (values, vectors) = symmetric_eigen(&scatter);
    let least = (0..3).min_by(|&a, &b| values[a].total_cmp(&values[b]))?;
    let plane = DVec3::from_array([0, 1, 2].map(|row| vectors[row][least])).try_normalize()?;
    if around.len() <= LEAST_FOR_QUADRIC {
        return Some(plane);
    }
    let x = plane.any_orthonormal_vector();
    let y = plane.cross(x);
    // z = c0 + c1 u + c2 v + c3 u^2 + c4 u v + c5 v^2, in spacings.
    let mut system = [[0.0; 7]; 6];
    for q in around.iter().map(|&u| points[u] - here) {
        let (u, v, z) = (q.dot(x) / spacing, q.dot(y) / spacing, q.dot(plane) / spacing);
        let row = [1.0, u, v, u * u, u * v, v * v, z];
        let weight = (1.0 - (u * u + v * v) / (REACH * REACH)).max(0.0).powi(2);
        for (line, a) in system.iter_mut().zip(row) {
            line.iter_mut().zip(row).for_each(|(cell, b)| *cell += weight * a * b);
        }
    }
    for (k, line) in system.iter_mut().enumerate().skip(3) {
        line[k] += DAMPING;
    }
    let solved = solve_system(system)?;
    (plane - solved[1] * x - solved[2] * y).try_normalize()
}
