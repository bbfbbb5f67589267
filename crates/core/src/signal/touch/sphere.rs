//! A rigid sphere pressed into an elastic foundation (`(johnson1985)`, section 4.3): under each point of the skin
//! is an independent spring along the normal, and the pressure is the stiffness times the depth to which the
//! sphere presses it in.
//!
//! On a plane at distance `h` from the centre of a sphere of radius `R` the depth at distance `s` from the
//! foot of the centre is `sqrt(R^2 - s^2) - h`; the whole force is the stiffness times the volume of the cap
//! below the plane, `pi d^2 (R - d/3)` with `d = R - h`. Springs do not affect their neighbours: unlike an
//! elastic half space (Hertz), the skin is not deformed next to the contact.

use std::f64::consts::PI;

use glam::DVec3;

/// A sphere in the frame of the skin that it touches.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sphere {
    /// Its centre, in m.
    pub(crate) centre: DVec3,
    /// Its radius, in m.
    pub(crate) radius: f64,
}

/// Points of the midpoint rule over the circles that the rim of a disc cuts: the mean depth is then exact to
/// a millionth of the largest depth.
const STEPS: u32 = 64;

impl Sphere {
    /// The depth to which it presses the skin at `point` with this unit normal, in m; 0 where it does not
    /// touch.
    pub(crate) fn depth(&self, point: DVec3, normal: DVec3) -> f64 {
        let q = point - self.centre;
        let below = -q.dot(normal);
        // A skin that faces away would be touched from inside: it is the other side of a thin body.
        if below <= 0.0 {
            return 0.0;
        }
        let lateral = q.length_squared() - below * below;
        ((self.radius * self.radius - lateral).max(0.0).sqrt() - below).max(0.0)
    }

    /// Integral of the depth over a disc of radius `disc` around `point`, in the plane of this unit
    /// normal: the volume of the skin that the sphere displaces there, in m^3.
    pub(crate) fn volume_under_disc(&self, point: DVec3, normal: DVec3, disc: f64) -> f64 {
        let q = point - self.centre;
        let plane = -q.dot(normal);
        if plane <= 0.0 || plane >= self.radius {
            return 0.0;
        }
        let (squared, contact) =
            (self.radius * self.radius, (self.radius * self.radius - plane * plane).sqrt());
        let offset = (q + plane * normal).length();
        if offset - disc >= contact {
            return 0.0;
        }
        // Circles around the foot of the centre that are completely in the disc.
        let whole = (disc - offset).max(0.0).min(contact);
        let cube = squared.powf(1.5) - (squared - whole * whole).powf(1.5);
        let inner = 2.0 * PI * (cube / 3.0 - 0.5 * plane * whole * whole);
        // Circles that its rim cuts.
        let (from, to) = ((disc - offset).abs(), (disc + offset).min(contact));
        if to <= from {
            return inner;
        }
        let cut = |k: u32| {
            // Denser at both ends, where the angle behaves like a square root.
            let t = (f64::from(k) + 0.5) / f64::from(STEPS);
            let s = from + (to - from) * t.powi(3) * (10.0 - 15.0 * t + 6.0 * t * t);
            let step = (to - from) * 30.0 * (t * (1.0 - t)).powi(2) / f64::from(STEPS);
            let cosine = (s * s + offset * offset - disc * disc) / (2.0 * s * offset);
            let angle = cosine.clamp(-1.0, 1.0).acos();
            2.0 * s * angle * ((squared - s * s).max(0.0).sqrt() - plane) * step
        };
        inner + (0..STEPS).map(cut).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPHERE: Sphere = Sphere { centre: DVec3::new(0.0, 0.0, 0.013), radius: 0.015 };

    /// A large disc senses exactly the cap below the plane.
    #[test]
    fn a_large_disc_senses_the_whole_cap() {
        let depth: f64 = 0.002;
        let cap = PI * depth * depth * (SPHERE.radius - depth / 3.0);
        for x in [0.0, 0.001, 0.02] {
            let found = SPHERE.volume_under_disc(DVec3::new(x, 0.0, 0.0), DVec3::Z, 0.05);
            assert!((found / cap - 1.0).abs() < 1e-12, "{found} of {cap} at {x}");
        }
    }

    /// Against a sum over a fine grid.
    #[test]
    fn a_disc_senses_its_mean_depth() {
        let normal = DVec3::new(0.1, -0.2, 1.0).normalize();
        let (across, along) =
            (normal.any_orthonormal_vector(), normal.cross(normal.any_orthonormal_vector()));
        for x in [0.0, 0.0005, 0.002, 0.005, 0.007, 0.009] {
            let (at, disc) = (DVec3::new(x, -0.3 * x, 1e-4), 0.002);
            let n = 1000;
            let place = |k: i32| disc * (f64::from(2 * k + 1) / f64::from(n) - 1.0);
            let grid = (0..n).flat_map(|i| (0..n).map(move |j| (place(i), place(j))));
            let cell = (2.0 * disc / f64::from(n)).powi(2);
            let inside = grid.filter(|(u, v)| u * u + v * v < disc * disc);
            let sum: f64 =
                inside.map(|(u, v)| SPHERE.depth(at + u * across + v * along, normal) * cell).sum();
            let found = SPHERE.volume_under_disc(at, normal, disc);
            assert!((found - sum).abs() < 2e-4 * PI * disc * disc * 0.002, "{found}, {sum} at {x}");
        }
    }

    #[test]
    fn discs_that_face_away_or_are_far_sense_nothing() {
        assert_eq!(SPHERE.depth(DVec3::ZERO, -DVec3::Z), 0.0);
        assert_eq!(SPHERE.volume_under_disc(DVec3::ZERO, -DVec3::Z, 0.002), 0.0);
        assert_eq!(SPHERE.depth(DVec3::X, DVec3::Z), 0.0);
        assert_eq!(SPHERE.volume_under_disc(0.01 * DVec3::X, DVec3::Z, 0.002), 0.0);
        assert!((SPHERE.depth(DVec3::ZERO, DVec3::Z) - 0.002).abs() < 1e-15);
    }
}
