//! The path of a rolling sphere: straight ahead over the triangles of a skin, each unfolded into the plane of
//! the one before (a straightest geodesic, `(polthier1998)`, except for paths through a vertex); a boundary
//! reflects it.

use glam::DVec3;

use crate::id::FaceId;
use crate::mesh::{Adjacency, Halfedge, TriMesh};
use crate::numeric::Random;

/// A point on a mesh and its direction of motion.
#[derive(Debug, Clone, Copy)]
pub(super) struct Walker {
    pub(super) face: FaceId,
    pub(super) point: DVec3,
    /// A unit vector in the plane of the face.
    direction: DVec3,
}

/// Most edges crossed in one step, so that a path around a vertex ends.
const MOST_CROSSINGS: usize = 10_000;

impl Walker {
    /// A random point on the mesh, uniform by area, and a random direction. `None` if the mesh has
    /// no area.
    pub(super) fn random(mesh: &TriMesh, random: &mut Random) -> Option<Self> {
        let mut left = random.uniform() * mesh.area();
        let has_area = |&face: &FaceId| mesh.face_area(face) > 0.0;
        let faces = || mesh.triangles.ids().filter(has_area);
        let hit = faces().find(|&face| {
            left -= mesh.face_area(face);
            left < 0.0
        });
        let face = hit.or_else(|| faces().next_back())?;
        let [a, b, c] = mesh.corners(face);
        let (mut u, mut v) = (random.uniform(), random.uniform());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        let (x, normal) = ((b - a).try_normalize()?, mesh.face_cross(face).try_normalize()?);
        let angle = std::f64::consts::TAU * random.uniform();
        let direction = angle.cos() * x + angle.sin() * normal.cross(x);
        Some(Self { face, point: a + u * (b - a) + v * (c - a), direction })
    }

    /// Moves `distance` metres ahead.
    pub(super) fn advance(&mut self, mesh: &TriMesh, adjacency: &Adjacency, distance: f64) {
        let mut left = distance;
        for _ in 0..MOST_CROSSINGS {
            let Some((side, inward, length)) = self.next_edge(mesh) else { return };
            self.point += self.direction * length.min(left);
            left -= length;
            if left <= 0.0 {
                return;
            }
            let outward = -self.direction.dot(inward);
            let along = self.direction + outward * inward;
            let turned = match adjacency.twin(Halfedge::new(self.face, side)) {
                None => along + outward * inward,
                Some(twin) => {
                    let Some(ahead) = inward_of(mesh, twin.face(), twin.side()) else { return };
                    self.face = twin.face();
                    along + outward * ahead
                }
            };
            let Some(direction) = turned.try_normalize() else { return };
            self.direction = direction;
        }
    }

    /// The side of the face ahead, its normal into the face, and its distance.
    fn next_edge(&self, mesh: &TriMesh) -> Option<(usize, DVec3, f64)> {
        let corners = mesh.corners(self.face);
        let mut nearest: Option<(usize, DVec3, f64)> = None;
        for (side, corner) in corners.into_iter().enumerate() {
            let inward = inward_of(mesh, self.face, side)?;
            let speed = -self.direction.dot(inward);
            if speed > 1e-12 {
                let length = ((self.point - corner).dot(inward) / speed).max(0.0);
                if nearest.is_none_or(|(_, _, best)| length < best) {
                    nearest = Some((side, inward, length));
                }
            }
        }
        nearest
    }

    /// Weights of the corners of the face.
    pub(super) fn barycentric(&self, mesh: &TriMesh) -> [f64; 3] {
        let [a, b, c] = mesh.corners(self.face);
        let normal = mesh.face_cross(self.face);
        let total = normal.length_squared();
        let share =
            |p: DVec3, q: DVec3| ((p - self.point).cross(q - self.point).dot(normal) / total).clamp(0.0, 1.0);
        [share(b, c), share(c, a), share(a, b)]
    }
}

/// The unit normal of a side of a face, in the face's plane and into it. `None` without an area.
fn inward_of(mesh: &TriMesh, face: FaceId, side: usize) -> Option<DVec3> {
    let corners = mesh.corners(face);
    let edge = corners[(side + 1) % 3] - corners[side];
    mesh.face_cross(face).cross(edge).try_normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    fn inside(walker: &Walker, mesh: &TriMesh) {
        let weights = walker.barycentric(mesh);
        let there: DVec3 = mesh.corners(walker.face).into_iter().zip(weights).map(|(p, w)| w * p).sum();
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-6, "{weights:?}");
        assert!(there.distance(walker.point) < 1e-9, "{walker:?} is not in its face");
    }

    /// On a plane the path is a straight line, reflected by the boundary.
    #[test]
    fn a_path_on_a_plane_is_straight() {
        let mesh = shapes::lattice(20, 20, 0.005);
        let adjacency = Adjacency::new(&mesh).unwrap();
        let mut random = Random::new(3, 0);
        for _ in 0..50 {
            let mut walker = Walker::random(&mesh, &mut random).unwrap();
            let (start, direction) = (walker.point, walker.direction);
            let (x, y) = (start.x, start.y);
            let free = (x - 0.0025).min(0.095 - x).min(y).min(0.082 - y).max(0.0);
            walker.advance(&mesh, &adjacency, free);
            assert!(walker.point.distance(start + free * direction) < 1e-12, "{free} m from {start}");
            for _ in 0..20 {
                walker.advance(&mesh, &adjacency, 0.013);
                inside(&walker, &mesh);
            }
        }
    }

    /// On a tube a path is a helix: its height grows evenly.
    #[test]
    fn a_path_on_a_tube_is_a_helix() {
        let mesh = shapes::tube(24, 40, 0.03, 0.4);
        let adjacency = Adjacency::new(&mesh).unwrap();
        let mut walker = Walker::random(&mesh, &mut Random::new(1, 0)).unwrap();
        let slope = walker.direction.z;
        let places = || mesh.positions.iter().copied();
        let middle = 0.5 * (places().reduce(DVec3::min).unwrap() + places().reduce(DVec3::max).unwrap());
        walker.direction *= if (walker.point.z > middle.z) == (slope > 0.0) { -1.0 } else { 1.0 };
        let rate = walker.direction.z;
        let mut last = walker.point.z;
        for _ in 0..10 {
            walker.advance(&mesh, &adjacency, 0.01);
            inside(&walker, &mesh);
            assert!((walker.point.z - last - 0.01 * rate).abs() < 1e-9);
            last = walker.point.z;
        }
    }
}
