//! The surface that modules lie on: nearest points, points spread evenly over its area, and how it curves.

use glam::{DVec2, DVec3};

use crate::bvh::BvhError;
use crate::design::Plate;
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Feature, TriMesh, boundary_edges, boundary_loops, surface_normals};
use crate::nearest::NearestFaces;
use crate::numeric::{Random, solve_system};

/// Triangles, and the search for the one nearest to a point.
pub(super) struct Surface {
    faces: NearestFaces,
    normals: IdVec<VertexId, DVec3>,
    /// Which sides of faces, from a corner to the next, are on a rim, and which vertices.
    rims: IdVec<FaceId, [bool; 3]>,
    on_rim: IdVec<VertexId, bool>,
}

/// A point of the surface.
#[derive(Clone, Copy)]
pub(super) struct Foot {
    pub(super) point: DVec3,
    /// Smooth over edges.
    pub(super) normal: DVec3,
    pub(super) is_on_rim: bool,
}

impl Surface {
    pub(super) fn new(mesh: TriMesh) -> Result<Self, BvhError> {
        let edges = boundary_edges(&mesh);
        let mut on_rim = IdVec::filled(false, mesh.positions.len());
        edges.iter().flatten().for_each(|&v| on_rim[v] = true);
        let is_rim = |a: VertexId, b: VertexId| edges.binary_search(&[a, b]).is_ok();
        let rims =
            mesh.triangles.iter().map(|&[a, b, c]| [is_rim(a, b), is_rim(b, c), is_rim(c, a)]).collect();
        Ok(Self { normals: surface_normals(&mesh), rims, on_rim, faces: NearestFaces::new(mesh)? })
    }

    /// The point nearest to `q` on faces that do not face away from `facing`: the other side of a wall does not count. The
    /// search begins at the packet `near`, and leaves that of the point there.
    pub(super) fn nearest(&self, q: DVec3, facing: DVec3, near: &mut Option<u32>) -> Option<Foot> {
        let mesh = &self.faces.mesh;
        let (face, closest) = self.faces.nearest(q, facing, near)?;
        let (corners, weights) = (mesh.triangles[face], closest.barycentric);
        let is_on_rim = match closest.feature {
            Feature::Inside => false,
            Feature::Side(side) => self.rims[face][side],
            Feature::Corner(corner) => self.on_rim[corners[corner]],
        };
        let [point, normal] = [&mesh.positions, &self.normals]
            .map(|of| (0..3).map(|k| of[corners[k]] * weights[k]).sum::<DVec3>());
        let normal = normal.try_normalize().unwrap_or_else(|| self.faces.crosses[face].normalize_or_zero());
        Some(Foot { point, normal, is_on_rim })
    }

    /// Points spread evenly over the area, with the normals of their faces.
    pub(super) fn samples(&self, count: usize, seed: u64) -> Vec<(DVec3, DVec3)> {
        let whole: f64 = self.faces.crosses.iter().map(|cross| cross.length()).sum();
        let mut random = Random::new(seed, 3);
        let (mut samples, mut sum) = (Vec::with_capacity(count), 0.0);
        for (face, cross) in self.faces.crosses.enumerate() {
            sum += cross.length();
            while samples.len() < count && (samples.len() as f64 + 0.5) * whole < sum * count as f64 {
                let (mut s, mut t) = (random.uniform(), random.uniform());
                if s + t > 1.0 {
                    (s, t) = (1.0 - s, 1.0 - t);
                }
                let [a, b, c] = self.faces.mesh.corners(face);
                samples.push((a + (b - a) * s + (c - a) * t, cross.normalize_or_zero()));
            }
        }
        samples
    }

    /// The rims, each as positions from vertex to vertex with the surface on their left.
    pub(super) fn rim_loops(&self) -> Vec<Vec<DVec3>> {
        let positions =
            |walk: Vec<VertexId>| walk.into_iter().map(|v| self.faces.mesh.positions[v]).collect();
        boundary_loops(&self.faces.mesh).into_iter().map(positions).collect()
    }

    /// How the surface curves below the points of a drawing that a plate lays out; `None` where too few lie on it.
    pub(super) fn curvature(&self, plate: &Plate, points: &[DVec2]) -> Option<Curvature> {
        let into = plate.frame.inverse();
        let mut near = None;
        let feet = points.iter().filter_map(|&at| {
            let q = plate.point(at);
            self.nearest(q, plate.normal(at), &mut near)
                .filter(|foot| !foot.is_on_rim || foot.point.distance(q) < 1e-4)
        });
        let feet: Vec<DVec3> = feet.map(|foot| into.transform_point3(foot.point)).collect();
        let size = feet.iter().map(|p| p.truncate().length()).fold(0.0, f64::max);
        if feet.len() < 8 || size == 0.0 {
            return None;
        }
        // Heights as a quadric, in units of the size.
        let mut system = [[0.0; 7]; 6];
        for p in feet {
            let (x, y) = (p.x / size, p.y / size);
            let row = [x * x, x * y, y * y, x, y, 1.0, p.z / size];
            for (line, factor) in system.iter_mut().zip(row) {
                line.iter_mut().zip(row).for_each(|(cell, value)| *cell += factor * value);
            }
        }
        // Points on a line leave some coefficients open.
        (0..6).for_each(|k| system[k][k] += 1e-9);
        let [xx, xy, yy, ..] = solve_system(system)?;
        // Curves away from the normal where it is convex.
        let (mean, half, twist) = (-(xx + yy) / size, -(xx - yy) / size, -xy / size);
        let spread = half.hypot(twist);
        let direction = 0.5 * twist.atan2(half);
        Some(if mean >= 0.0 {
            Curvature { most: mean + spread, least: mean - spread, direction }
        } else {
            let direction = direction + std::f64::consts::FRAC_PI_2;
            Curvature { most: mean - spread, least: mean + spread, direction }
        })
    }
}

/// Principal curvatures, in 1/m, positive where the surface is convex.
#[derive(Debug, Clone, Copy)]
pub(super) struct Curvature {
    /// The one of larger size, and its direction as an angle in the drawing, in rad.
    pub(super) most: f64,
    pub(super) direction: f64,
    /// The one of smaller size.
    pub(super) least: f64,
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::*;
    use crate::mesh::shapes;

    /// A plate that touches a tube sees curvature 1/R around it and none along it.
    #[test]
    fn a_tube_curves_around() {
        let mut mesh = shapes::tube(120, 40, 0.05, 0.1);
        mesh.positions.iter_mut().for_each(|p| *p += DVec3::X);
        let surface = Surface::new(mesh).unwrap();
        let (around, along) = (DVec3::Y, DVec3::Z);
        let top = DVec3::new(1.05, 0.0, 0.05);
        let frame = DAffine3 { matrix3: glam::DMat3::from_cols(around, along, DVec3::X), translation: top };
        let plate = Plate { frame, curvature: 0.0, direction: 0.0 };
        let points: Vec<DVec2> = crate::design::Module::triangle(0.03).taxels;
        let found = surface.curvature(&plate, &points).unwrap();
        assert!((found.most - 20.0).abs() < 1.0 && found.least.abs() < 0.5, "{found:?}");
        assert!(found.direction.sin().abs() < 0.05, "{found:?}");
    }
}
