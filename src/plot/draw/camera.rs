//! The camera that a skin in space is seen with.

use glam::{DAffine3, DVec2, DVec3};

use crate::{mesh::TriMesh, plot::Viewpoint};

/// How far the default viewpoint leans from the outside of the skin towards [`SIDE`]: enough for a
/// cap to show its bulge and little enough to see all of it. Below 1, so that the two never cancel.
const LEAN: f64 = 0.85;

/// Where the default viewpoint leans to: the front, a little to the right and above.
const SIDE: DVec3 = DVec3::new(0.4, -0.87, 0.3);

/// An orthographic camera: lengths in the picture plane are true, so one scale bar holds
/// everywhere.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Camera {
    /// Unit axes of the picture in the frame of the mesh; `toward` points to the viewer.
    right: DVec3,
    up: DVec3,
    toward: DVec3,
    /// The direction in whole degrees, azimuth and elevation.
    pub(crate) degrees: [f64; 2],
}

impl Camera {
    /// Looks at a mesh that `pose` places in the world; z is up.
    pub(crate) fn new(viewpoint: Viewpoint, mesh: &TriMesh, pose: DAffine3) -> Self {
        let degrees = match viewpoint {
            // Whole degrees, so that the direction in a caption gives the same picture.
            Viewpoint::Outside => outside(mesh, pose).map(|angle| angle.to_degrees().round()),
            Viewpoint::From { azimuth, elevation } => [azimuth, elevation].map(f64::to_degrees),
        };
        let [azimuth, elevation] = degrees.map(f64::to_radians);
        let level = DVec3::new(azimuth.cos(), azimuth.sin(), 0.0);
        let toward = elevation.cos() * level + elevation.sin() * DVec3::Z;
        // From straight above the picture's upper edge is where the viewer would be from a little
        // below.
        let up = elevation.cos() * DVec3::Z - elevation.sin() * level;
        let into_link = pose.matrix3.transpose();
        let [right, up, toward] = [up.cross(toward), up, toward].map(|axis| into_link * axis);
        Self { right, up, toward, degrees }
    }

    /// A point on the picture plane, in m, right and up.
    pub(crate) fn project(&self, at: DVec3) -> DVec2 {
        DVec2::new(self.right.dot(at), self.up.dot(at))
    }

    /// How near a point is to the viewer, in m; larger is nearer.
    pub(crate) fn nearness(&self, at: DVec3) -> f64 {
        self.toward.dot(at)
    }

    /// How much light a surface with this unit normal sends to the viewer, 0 to 1: the lamp is at
    /// the viewer's upper left.
    pub(crate) fn light(&self, normal: DVec3) -> f64 {
        let lamp = (self.toward + 0.3 * self.up - 0.3 * self.right).normalize_or_zero();
        lamp.dot(normal).max(0.0)
    }

    /// Whether a surface with this normal shows its outside.
    pub(crate) fn sees(&self, normal: DVec3) -> bool {
        self.toward.dot(normal) > 0.0
    }
}

/// The default direction: azimuth and elevation, in radians.
fn outside(mesh: &TriMesh, pose: DAffine3) -> [f64; 2] {
    let sum: DVec3 = mesh.triangles.ids().map(|face| mesh.face_cross(face)).sum();
    let toward = pose.transform_vector3(sum).normalize_or_zero() + LEAN * SIDE.normalize();
    [toward.y.atan2(toward.x), toward.z.atan2(toward.truncate().length())]
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use glam::DQuat;

    use crate::mesh::shapes;

    use super::*;

    fn camera(azimuth: f64, elevation: f64) -> Camera {
        let viewpoint = Viewpoint::From { azimuth, elevation };
        Camera::new(viewpoint, &shapes::triangle(), DAffine3::IDENTITY)
    }

    #[test]
    fn lengths_in_the_picture_plane_are_kept() {
        for (azimuth, elevation) in
            [(0.0, 0.0), (0.3, -1.1), (-2.5, 0.7), (1.0, FRAC_PI_2), (4.0, -FRAC_PI_2)]
        {
            let camera = camera(azimuth, elevation);
            for (x, y) in [(1.0, 0.0), (0.0, 2.0), (-3.0, 4.0)] {
                let point = x * camera.right + y * camera.up + 7.0 * camera.toward;
                assert!(
                    (camera.project(point) - DVec2::new(x, y)).length() < 1e-12,
                    "{point} from {camera:?}"
                );
                assert!((camera.nearness(point) - 7.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn the_viewer_is_where_the_angles_say() {
        let front = camera(-FRAC_PI_2, 0.0);
        assert!((front.project(DVec3::X) - DVec2::X).length() < 1e-12, "x is right when seen from -y");
        assert!((front.project(DVec3::Z) - DVec2::Y).length() < 1e-12, "z is up");
        let above = camera(-FRAC_PI_2, FRAC_PI_2);
        assert!((above.project(DVec3::new(1.0, 2.0, 3.0)) - DVec2::new(1.0, 2.0)).length() < 1e-12, "a plan");
    }

    #[test]
    fn a_posed_mesh_looks_as_its_moved_copy() {
        let mesh = shapes::cap(100, 0.1, 1.0);
        let pose =
            DAffine3::from_rotation_translation(DQuat::from_rotation_x(0.7), DVec3::new(0.1, 2.0, 3.0));
        let moved = TriMesh {
            positions: mesh.positions.map(|&p| pose.transform_point3(p)),
            triangles: mesh.triangles.clone(),
        };
        let posed = Camera::new(Viewpoint::Outside, &mesh, pose);
        let plain = Camera::new(Viewpoint::Outside, &moved, DAffine3::IDENTITY);
        assert_eq!(posed.degrees, plain.degrees);
        let shift = plain.project(pose.translation);
        for (a, b) in mesh.positions.iter().zip(&moved.positions) {
            let (a, b) = (posed.project(*a), plain.project(*b));
            assert!((a + shift - b).length() < 1e-12, "{a} and {b}");
        }
    }

    #[test]
    fn the_default_sees_the_outside() {
        for rotation in [DQuat::IDENTITY, DQuat::from_rotation_x(1.5), DQuat::from_rotation_y(3.1)] {
            let mesh = shapes::cap(200, 0.1, 0.6);
            let camera = Camera::new(Viewpoint::Outside, &mesh, DAffine3::from_quat(rotation));
            assert!(mesh.triangles.ids().all(|f| camera.sees(mesh.face_cross(f))), "all of a shallow cap");
        }
    }
}
