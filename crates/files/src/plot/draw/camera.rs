//! The camera for a skin in space.

use glam::{DAffine3, DMat3, DVec2, DVec3};

use crate::{id::VertexId, mesh::TriMesh, plot::Viewpoint};

/// How far the default viewpoint leans from the outside of the skin towards [`SIDE`]: enough to show the
/// bulge of a cap, and little enough to show all of it. Below 1, so that the two never cancel.
const LEAN: f64 = 0.85;

/// A body this many times taller along y than along z is assumed to stand on its xz plane, as in files with y
/// up.
const STANDING_RATIO: f64 = 1.5;

/// The turn from y up to z up.
const FROM_Y_UP: DMat3 = DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y);

/// The direction of the lean: the front, slightly to the right and above.
const SIDE: DVec3 = DVec3::new(0.4, -0.87, 0.3);

/// An orthographic camera: lengths in the picture plane are true, so one scale bar is valid everywhere.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Camera {
    /// Unit axes of the picture in the frame of the mesh; `toward` points to the viewer.
    right: DVec3,
    up: DVec3,
    toward: DVec3,
    /// The direction in whole degrees, azimuth and elevation.
    pub(crate) degrees: [f64; 2],
    has_y_up: bool,
}

impl Camera {
    /// Looks at a mesh with a seam that `pose` places in the world; z is up, or by default y if the mesh
    /// stands along it.
    pub(crate) fn new(viewpoint: Viewpoint, mesh: &TriMesh, pose: DAffine3, seam: &[[VertexId; 2]]) -> Self {
        let has_y_up = viewpoint == Viewpoint::Outside && stands_along_y(mesh, pose);
        let pose = if has_y_up { DAffine3::from_mat3(FROM_Y_UP) * pose } else { pose };
        let degrees = match viewpoint {
            // Whole degrees, so that the direction in a caption gives the same picture.
            Viewpoint::Outside => outside(mesh, pose, seam).map(|angle| angle.to_degrees().round()),
            Viewpoint::From { azimuth, elevation } => [azimuth, elevation].map(f64::to_degrees),
        };
        let [azimuth, elevation] = degrees.map(f64::to_radians);
        let level = DVec3::new(azimuth.cos(), azimuth.sin(), 0.0);
        let toward = elevation.cos() * level + elevation.sin() * DVec3::Z;
        // From straight above, up in the picture is as from slightly below.
        let up = elevation.cos() * DVec3::Z - elevation.sin() * level;
        let into_link = pose.matrix3.transpose();
        let [right, up, toward] = [up.cross(toward), up, toward].map(|axis| into_link * axis);
        Self { right, up, toward, degrees, has_y_up }
    }

    /// The suffix of the direction in a caption.
    pub(crate) fn stands_on(&self) -> &'static str {
        if self.has_y_up { ", y up" } else { "" }
    }

    /// The rotation from the plane z = 0 to the picture plane: x to the right, y up.
    pub(crate) fn picture_plane(&self) -> DMat3 {
        DMat3::from_cols(self.right, self.up, self.toward)
    }

    /// A point on the picture plane, in m, right and up.
    pub(crate) fn project(&self, at: DVec3) -> DVec2 {
        DVec2::new(self.right.dot(at), self.up.dot(at))
    }

    /// Depth of a point towards the viewer, in m; larger is nearer.
    pub(crate) fn nearness(&self, at: DVec3) -> f64 {
        self.toward.dot(at)
    }

    /// The light that a surface with this unit normal reflects, 0 to 1: the lamp is at the viewer's upper
    /// left.
    pub(crate) fn light(&self, normal: DVec3) -> f64 {
        let lamp = (self.toward + 0.3 * self.up - 0.3 * self.right).normalize_or_zero();
        lamp.dot(normal).max(0.0)
    }

    /// Whether a surface with this normal shows its outside.
    pub(crate) fn sees(&self, normal: DVec3) -> bool {
        self.toward.dot(normal) > 0.0
    }
}

/// The default direction, azimuth and elevation, in radians: where most of the seam is visible, or without a
/// seam most of the outside.
fn outside(mesh: &TriMesh, pose: DAffine3, seam: &[[VertexId; 2]]) -> [f64; 2] {
    let sum = if seam.is_empty() {
        mean_direction(mesh.triangles.ids().map(|face| mesh.face_cross(face)))
    } else {
        let normals = mesh.vertex_normals();
        let of_edge = |&[a, b]: &[VertexId; 2]| {
            mesh.positions[a].distance(mesh.positions[b]) * (normals[a] + normals[b])
        };
        mean_direction(seam.iter().map(of_edge))
    };
    let outside = pose.transform_vector3(sum);
    // From behind, if the seam is behind.
    let is_behind = !seam.is_empty() && outside.truncate().dot(SIDE.truncate()) < 0.0;
    let side = if is_behind { SIDE * DVec3::new(-1.0, -1.0, 1.0) } else { SIDE };
    let toward = outside + LEAN * side.normalize();
    [toward.y.atan2(toward.x), toward.z.atan2(toward.truncate().length())]
}

/// The direction of a sum; zero where it cancels up to rounding, as on a closed surface.
fn mean_direction(all: impl Iterator<Item = DVec3>) -> DVec3 {
    let (sum, length) = all.fold((DVec3::ZERO, 0.0), |(sum, length), x| (sum + x, length + x.length()));
    if sum.length() > 1e-6 * length { sum.normalize() } else { DVec3::ZERO }
}

/// *Heuristic*: whether a mesh is a body, with skin on all sides, that stands along y.
fn stands_along_y(mesh: &TriMesh, pose: DAffine3) -> bool {
    let crosses = || mesh.triangles.ids().map(|face| mesh.face_cross(face));
    let is_body = crosses().sum::<DVec3>().length() < 0.5 * crosses().map(DVec3::length).sum::<f64>();
    let places = || mesh.positions.iter().map(|&p| pose.transform_point3(p));
    let size = places().fold(DVec3::NEG_INFINITY, DVec3::max) - places().fold(DVec3::INFINITY, DVec3::min);
    is_body && size.y > STANDING_RATIO * size.z && size.y >= size.x
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{edges, shapes};

    /// A seam on the far side of a ball turns the default viewpoint to it.
    #[test]
    fn the_default_viewpoint_shows_the_seam() {
        let ball = shapes::ball(8, 0.1);
        let is_far = |&[a, _]: &[VertexId; 2]| SIDE.dot(ball.positions[a]) < -0.09;
        let seam: Vec<_> = edges(&ball).into_iter().filter(is_far).collect();
        let is_seen = |seam: &[[VertexId; 2]]| {
            let camera = Camera::new(Viewpoint::Outside, &ball, DAffine3::IDENTITY, seam);
            camera.sees(ball.positions[seam.first().map_or(VertexId::new(0), |edge| edge[0])])
        };
        assert!(!seam.is_empty() && is_seen(&seam));
        let camera = Camera::new(Viewpoint::Outside, &ball, DAffine3::IDENTITY, &[]);
        assert!(!camera.sees(ball.positions[seam[0][0]]), "without a seam it is behind");
    }
}
