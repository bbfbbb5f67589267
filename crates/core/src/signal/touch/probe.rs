//! What presses, and how a taxel senses it: a sphere or an ellipsoid, on a disc below a cover that spreads pressures.
//!
//! A sphere on a bare disc is integrated exactly. Anything else is the mean of the depth over [`POINTS`] points,
//! distributed as the sum of a point of the disc and one of the normal distribution of the blur.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use crate::signal::touch::sphere::Sphere;
use crate::signal::touch::{TouchOptions, TouchShape};

/// A sphere, an ellipsoid that is longer along one axis, a finger or a palm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Probe {
    /// The sphere; of an ellipsoid the largest that is inside it.
    pub(super) sphere: Sphere,
    /// What it is.
    pub(super) shape: TouchShape,
    /// Half the length of the segment of a finger, or the radius of a palm, in m.
    pub(super) extent: f64,
    /// The point of the skin below the centre, and its depth there, in m.
    pub(super) foot: DVec3,
    pub(super) pressed: f64,
    /// A unit vector along the long axis; of a palm the normal below it.
    pub(super) axis: DVec3,
    /// The ratio of the radii of curvature where it touches across that axis: the square of the ratio of the axes.
    pub(super) aspect: f64,
}

impl Probe {
    /// The depth to which it presses the skin at `point` along this unit normal, in m; 0 where it does not touch.
    pub(super) fn depth(&self, point: DVec3, normal: DVec3) -> f64 {
        match self.shape {
            TouchShape::Sphere => {}
            TouchShape::Finger => {
                let along = (point - self.sphere.centre).dot(self.axis).clamp(-self.extent, self.extent);
                let centre = self.sphere.centre + along * self.axis;
                return Sphere { centre, ..self.sphere }.depth(point, normal);
            }
            TouchShape::Palm => {
                // A skin that faces away is the other side of a thin body.
                let is_facing = normal.dot(self.axis) > PALM_COSINE;
                let inside = (self.extent - point.distance(self.foot)) / PALM_RIM;
                return if is_facing { self.pressed * inside.clamp(0.0, 1.0) } else { 0.0 };
            }
        }
        if self.aspect <= 1.0 {
            return self.sphere.depth(point, normal);
        }
        // Shortened along its axis the ellipsoid is the sphere; the line of the normal stays a line.
        let shorten = |v: DVec3| v + (self.aspect.sqrt().recip() - 1.0) * v.dot(self.axis) * self.axis;
        let q = point - self.sphere.centre;
        if q.dot(normal) >= 0.0 {
            return 0.0;
        }
        let (q, n) = (shorten(q), shorten(normal));
        let (along, squared) = (q.dot(n), n.length_squared());
        let inside = self.sphere.radius * self.sphere.radius - q.length_squared();
        let root = (along * along + squared * inside).max(0.0).sqrt();
        ((along + root) / squared).max(0.0)
    }

    /// No point of it is farther from its centre, in m.
    pub(super) fn reach(&self) -> f64 {
        match self.shape {
            TouchShape::Sphere => self.sphere.radius * self.aspect.sqrt(),
            TouchShape::Finger | TouchShape::Palm => self.sphere.radius + self.extent,
        }
    }
}

/// Width of the rim of a palm, in m, and the least cosine of the angle between its normal and that of skin it touches.
const PALM_RIM: f64 = 0.008;
const PALM_COSINE: f64 = -0.2;

/// Points of a taxel.
const POINTS: usize = 48;

/// Sampled distances for each of these.
const SAMPLES: usize = 256;

/// Where a taxel senses, in its tangent plane.
#[derive(Debug, Clone)]
pub(super) struct Sensor {
    /// Radius of its disc, in m.
    disc: f64,
    /// Standard deviation of the blur along each axis, in m.
    blur: f64,
    /// Points of equal weight, in m; none if the disc is bare.
    points: Vec<[f64; 2]>,
    /// No point is farther from the taxel, in m.
    reach: f64,
}

impl Sensor {
    pub(super) fn new(options: &TouchOptions) -> Self {
        let (disc, blur) = (options.taxel_radius, options.blur);
        if blur == 0.0 && options.aspect <= 1.0 && options.shape == TouchShape::Sphere {
            return Self { disc, blur, points: Vec::new(), reach: disc };
        }
        // Distances from the taxel, of points that fill the space of disc and distribution evenly: the multiples of
        // four numbers without a common measure (the additive recurrence of Roberts 2018).
        let root = (0..30).fold(1.0_f64, |x, _| (1.0 + x).powf(0.2));
        let distance = |k: usize| {
            let even = |power: i32| (0.5 + (k + 1) as f64 * root.powi(-power)).fract();
            let (inner, outer) = (disc * even(1).sqrt(), blur * (-2.0 * (1.0 - even(2)).ln()).sqrt());
            let angle = TAU * even(3);
            (inner + outer * angle.cos()).hypot(outer * angle.sin())
        };
        let mut distances: Vec<f64> = (0..POINTS * SAMPLES).map(distance).collect();
        distances.sort_by(f64::total_cmp);
        let radii = distances.chunks(SAMPLES).map(|part| part.iter().sum::<f64>() / SAMPLES as f64);
        // The golden angle spreads them evenly around the taxel.
        let spread = |(k, radius): (usize, f64)| {
            let angle = PI * (3.0 - 5.0_f64.sqrt()) * k as f64;
            [radius * angle.cos(), radius * angle.sin()]
        };
        let mut points: Vec<[f64; 2]> = radii.enumerate().map(spread).collect();
        let mean = |k: usize| points.iter().map(|p| p[k]).sum::<f64>() / POINTS as f64;
        let centre = [mean(0), mean(1)];
        points.iter_mut().for_each(|p| *p = [p[0] - centre[0], p[1] - centre[1]]);
        let square = points.iter().map(|[x, y]| x * x + y * y).sum::<f64>() / POINTS as f64;
        let factor = ((0.5 * disc * disc + 2.0 * blur * blur) / square).sqrt();
        points.iter_mut().flatten().for_each(|x| *x *= factor);
        let reach = points.iter().map(|[x, y]| x.hypot(*y)).fold(0.0, f64::max);
        Self { disc, blur, points, reach }
    }

    /// The variance along each axis of the points where a taxel senses, in m^2.
    pub(super) fn variance(&self) -> f64 {
        0.25 * self.disc * self.disc + self.blur * self.blur
    }

    /// The mean depth of the skin below a probe on the disc of a taxel, spread by the cover, in m.
    pub(super) fn depth(&self, probe: &Probe, at: DVec3, normal: DVec3) -> f64 {
        let reach = probe.reach() + self.reach;
        if at.distance_squared(probe.sphere.centre) >= reach * reach {
            return 0.0;
        }
        if self.points.is_empty() {
            return probe.sphere.volume_under_disc(at, normal, self.disc) / (PI * self.disc * self.disc);
        }
        let across = normal.any_orthonormal_vector();
        let along = normal.cross(across);
        let depth = |[x, y]: &[f64; 2]| probe.depth(at + *x * across + *y * along, normal);
        self.points.iter().map(depth).sum::<f64>() / self.points.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ball(sphere: Sphere) -> Probe {
        let (shape, axis, foot) = (TouchShape::Sphere, DVec3::X, DVec3::ZERO);
        Probe { sphere, shape, extent: 0.0, foot, pressed: 0.002, axis, aspect: 1.0 }
    }

    /// Along its segment a finger is as deep as in its middle, beside it as a sphere is, and a palm is flat but for its rim.
    #[test]
    fn fingers_and_palms_have_their_depths() {
        let sphere = Sphere { centre: DVec3::new(0.0, 0.0, 0.005), radius: 0.007 };
        let at = |probe: &Probe, x: f64, y: f64| probe.depth(DVec3::new(x, y, 0.0), DVec3::Z);
        let finger = Probe { shape: TouchShape::Finger, extent: 0.02, ..ball(sphere) };
        for x in [0.0, 0.01, 0.02] {
            assert!((at(&finger, x, 0.003) - at(&ball(sphere), 0.0, 0.003)).abs() < 1e-15, "{x}");
        }
        assert_eq!(at(&finger, 0.027, 0.0), 0.0);
        let palm = Probe { shape: TouchShape::Palm, extent: 0.03, axis: DVec3::Z, ..ball(sphere) };
        assert_eq!([at(&palm, 0.0, 0.0), at(&palm, 0.022, 0.0)], [0.002; 2]);
        assert!((at(&palm, 0.0, 0.026) - 0.001).abs() < 1e-15 && at(&palm, 0.0, 0.031) == 0.0);
    }

    /// Without a blur the points of an ellipsoid that is almost a sphere give what the sphere gives.
    #[test]
    fn points_agree_with_the_exact_mean() {
        let sphere = Sphere { centre: DVec3::new(0.0, 0.0, 0.013), radius: 0.015 };
        let exact = Sensor::new(&TouchOptions::default());
        let points = Sensor::new(&TouchOptions { aspect: 2.0, ..TouchOptions::default() });
        for x in [0.0, 0.002, 0.004, 0.006, 0.008, 0.012] {
            let depth = |sensor: &Sensor, aspect: f64| {
                let probe = Probe { axis: DVec3::Y, aspect, ..ball(sphere) };
                sensor.depth(&probe, DVec3::new(x, 0.0, 0.0), DVec3::Z)
            };
            let (a, b) = (depth(&exact, 1.0), depth(&points, 1.0 + 1e-9));
            assert!((a - b).abs() < 2e-5, "{a} m, {b} m at {x}");
            assert!(depth(&points, 2.0) >= b, "the longer body touches all that the sphere touches");
        }
    }

    /// A flat pressure stays flat, and a cover lowers a peak and keeps the sum.
    #[test]
    fn a_cover_spreads_and_keeps_the_sum() {
        let probe = ball(Sphere { centre: DVec3::new(0.0, 0.0, 0.013), radius: 0.015 });
        let step = 2e-4;
        let of = |blur: f64| {
            let sensor = Sensor::new(&TouchOptions { blur, ..TouchOptions::default() });
            let depth = |i: i32, j: i32| {
                let at = DVec3::new(step * f64::from(i), step * f64::from(j), 0.0);
                sensor.depth(&probe, at, DVec3::Z)
            };
            let sum: f64 =
                (-90..=90).flat_map(|i| (-90..=90).map(move |j| (i, j))).map(|(i, j)| depth(i, j)).sum();
            (depth(0, 0), sum * step * step)
        };
        let ((sharp, volume), (blurred, spread)) = (of(0.0), of(0.0015));
        assert!(blurred < 0.95 * sharp, "{blurred} m, {sharp} m");
        assert!((spread / volume - 1.0).abs() < 0.02, "{spread} of {volume}");
    }
}
