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
