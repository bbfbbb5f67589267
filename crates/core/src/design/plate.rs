//! A plate that bends as a cylinder and does not stretch: where each point of it is.

use glam::{DAffine3, DMat3, DVec2, DVec3};

/// A module in space: a flat plate bent about lines of one direction. Its points keep their distances along it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plate {
    /// The frame of the module's drawing: x and y in its plane, z outward; lengths in m. A rigid motion.
    pub frame: DAffine3,
    /// Curvature of the cylinder, in 1/m; positive where the plate is convex seen from outside.
    pub curvature: f64,
    /// The direction in which it bends, as an angle from x in its drawing, in rad.
    pub direction: f64,
}

/// A curvature below this, in 1/m, is 0 in divisions: a plate of 1 m would be 0.1 um from flat.
const FLAT: f64 = 1e-6;

impl Plate {
    /// The place of a point of the drawing, in m.
    pub fn point(&self, at: DVec2) -> DVec3 {
        self.frame.transform_point3(self.bent(at))
    }

    /// The outward unit normal there.
    pub fn normal(&self, at: DVec2) -> DVec3 {
        self.tangents(at).z_axis
    }

    /// The plate that continues this one on the same cylinder: the frame of its drawing is `turn` rad from this one's, and
    /// its origin at `at` of it.
    pub(super) fn moved(&self, at: DVec2, turn: f64) -> Self {
        let [x, y, z] = self.tangents(at).to_cols_array_2d().map(DVec3::from_array);
        let (sin, cos) = turn.sin_cos();
        let matrix = DMat3::from_cols(x * cos + y * sin, y * cos - x * sin, z);
        let frame = DAffine3 { matrix3: matrix, translation: self.point(at) };
        Self { frame, direction: self.direction - turn, ..*self }
    }

    /// The point of the drawing that a point in space lies over, and its height over the plate, in m.
    pub fn unbent(&self, x: DVec3) -> (DVec2, f64) {
        let local = self.frame.inverse().transform_point3(x);
        let along = DVec2::from_angle(self.direction);
        let (u, v) = (local.truncate().dot(along), local.truncate().dot(along.perp()));
        if self.curvature.abs() < FLAT {
            return (along * u + along.perp() * v, local.z);
        }
        let radius = 1.0 / self.curvature;
        let side = radius.signum();
        let angle = (side * u).atan2(side * (radius + local.z));
        (along * (angle * radius) + along.perp() * v, side * u.hypot(radius + local.z) - radius)
    }

    /// A point of the drawing in the frame of the plate.
    fn bent(&self, at: DVec2) -> DVec3 {
        bend(at, self.curvature, self.direction)
    }

    /// The directions of x and y of the drawing at a point of it, and the normal.
    fn tangents(&self, at: DVec2) -> DMat3 {
        let along = DVec2::from_angle(self.direction);
        let (sin, cos) = (self.curvature * at.dot(along)).sin_cos();
        let tangent = (along * cos).extend(-sin);
        let across = along.perp().extend(0.0);
        let local = DMat3::from_cols(
            tangent * along.x - across * along.y,
            tangent * along.y + across * along.x,
            (along * sin).extend(cos),
        );
        self.frame.matrix3 * local
    }
}

/// A point of a drawing, bent about the z axis of its frame.
pub(super) fn bend(at: DVec2, curvature: f64, direction: f64) -> DVec3 {
    let along = DVec2::from_angle(direction);
    let (u, v) = (at.dot(along), at.dot(along.perp()));
    let curvature = if curvature.abs() < FLAT { FLAT } else { curvature };
    let angle = curvature * u;
    let half = (0.5 * angle).sin();
    (along * (angle.sin() / curvature) + along.perp() * v).extend(-2.0 * half * half / curvature)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plate() -> Plate {
        let frame = DAffine3::from_rotation_translation(
            glam::DQuat::from_scaled_axis(DVec3::new(0.3, -1.0, 0.2)),
            DVec3::new(1.0, 2.0, 3.0),
        );
        Plate { frame, curvature: 14.0, direction: 0.7 }
    }

    #[test]
    fn points_unbend_to_themselves() {
        for curvature in [14.0, -8.0, 0.0] {
            let plate = Plate { curvature, ..plate() };
            let at = DVec2::new(0.013, -0.02);
            let (back, height) = plate.unbent(plate.point(at) + plate.normal(at) * 1e-3);
            assert!(back.distance(at) < 1e-9 && (height - 1e-3).abs() < 1e-9, "{back} {height}");
        }
    }

    /// A plate that continues another has the same points, so a lattice of plates does not drift on a cylinder.
    #[test]
    fn plates_continue_on_the_same_cylinder() {
        let (plate, at, turn) = (plate(), DVec2::new(0.01, 0.02), 2.0);
        let next = plate.moved(at, turn);
        let p = DVec2::new(-0.005, 0.012);
        let there = at + DVec2::from_angle(turn).rotate(p);
        assert!(next.point(p).distance(plate.point(there)) < 1e-12);
        assert!(next.normal(p).distance(plate.normal(there)) < 1e-12);
    }
}
