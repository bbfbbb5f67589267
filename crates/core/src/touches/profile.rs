//! What a taxel reads where a sphere presses: the mean depth of the skin on its disc, as a table, and the distance of
//! a sphere's centre from those positions where the reading would be exactly as it is.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use crate::signal::Sphere;

/// The deepest press in the table, in radii of the sphere.
const DEEPEST: f64 = 0.7;

/// Steps of the table along the depth and along the offset: positions are then exact to a micrometre.
const DEPTHS: usize = 48;
const OFFSETS: usize = 72;

/// Most steps to the nearest position.
const MOST_STEPS: usize = 12;

/// A step smaller than this ends the search, in radii of the sphere.
const SMALLEST_STEP: f64 = 1e-4;

/// The mean depth of the skin on the disc of a taxel, in m, as a function of the position of the sphere.
///
/// Positions have two coordinates: the offset of the sphere's centre from the normal line of the taxel, and
/// its height above the tangent plane, in m.
#[derive(Debug, Clone)]
pub(super) struct Profile {
    pub(super) radius: f64,
    /// Row after row of equal depth.
    values: Vec<f64>,
    steps: DVec2,
}

/// A value of a profile, and its derivatives along the offset and the height.
#[derive(Debug, Clone, Copy)]
pub(super) struct Value {
    pub(super) depth: f64,
    pub(super) gradient: DVec2,
}

/// Where the nearest position with a given reading is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nearest {
    /// The signed distance to it, in m: positive from outside, where the reading would be smaller.
    pub(super) distance: f64,
    /// The unit vector along which the distance grows: offset and height.
    pub(super) outward: DVec2,
    /// How fast the mean depth falls along it.
    pub(super) slope: f64,
}

impl Profile {
    /// The profile of a sphere of this radius and a taxel of radius `disc`, in m.
    pub(super) fn new(radius: f64, disc: f64) -> Self {
        let widest = radius * (1.0 - (1.0 - DEEPEST) * (1.0 - DEEPEST)).sqrt() + disc;
        let steps = DVec2::new(widest / (OFFSETS - 1) as f64, DEEPEST * radius / (DEPTHS - 1) as f64);
        let sphere = Sphere { centre: DVec3::ZERO, radius };
        let value = |k: usize| {
            let (row, column) = (k / OFFSETS, k % OFFSETS);
            let point = DVec3::new(column as f64 * steps.x, 0.0, row as f64 * steps.y - radius);
            sphere.volume_under_disc(point, DVec3::Z, disc) / (PI * disc * disc)
        };
        Self { radius, values: (0..DEPTHS * OFFSETS).map(value).collect(), steps }
    }

    /// The mean depth where the sphere's centre has this offset and height, in m; presses deeper than the
    /// table continue in a straight line.
    pub(super) fn at(&self, offset: f64, height: f64) -> Value {
        let depth = self.radius - height;
        let most = DEEPEST * self.radius;
        if depth > most {
            let last = self.at(offset, self.radius - most);
            return Value { depth: last.depth - last.gradient.y * (depth - most), ..last };
        }
        if depth <= 0.0 {
            return Value { depth: 0.0, gradient: DVec2::ZERO };
        }
        let (row, v) = cell(depth / self.steps.y, DEPTHS);
        let (column, u) = cell(offset.abs() / self.steps.x, OFFSETS);
        if column + 2 > OFFSETS {
            return Value { depth: 0.0, gradient: DVec2::ZERO };
        }
        let (along, slope_along) = (cubic(u), cubic_slope(u));
        let (down, slope_down) = (cubic(v), cubic_slope(v));
        let (mut value, mut dx, mut dy) = (0.0, 0.0, 0.0);
        for j in 0..4 {
            let (mut line, mut line_slope) = (0.0, 0.0);
            for i in 0..4 {
                let z = self.sample(column + i, row + j);
                line += along[i] * z;
                line_slope += slope_along[i] * z;
            }
            value += down[j] * line;
            dx += down[j] * line_slope;
            dy += slope_down[j] * line;
        }
        Value { depth: value.max(0.0), gradient: DVec2::new(dx / self.steps.x, -dy / self.steps.y) }
    }

    /// The number of column and row, counted from one before the first: offsets have a mirror, above the table is
    /// nothing, and below and beside it the last values.
    fn sample(&self, column: usize, row: usize) -> f64 {
        let column = if column == 0 { 1 } else { (column - 1).min(OFFSETS - 1) };
        if row == 0 { 0.0 } else { self.values[(row - 1).min(DEPTHS - 1) * OFFSETS + column] }
    }

    /// The position nearest to this one at which the mean depth is `depth` (positive, in m).
    pub(super) fn nearest(&self, offset: f64, height: f64, depth: f64) -> Nearest {
        let start = DVec2::new(offset, height);
        // From outside and from the rim there is no slope to follow: begin where the sphere presses in the middle.
        let mut here = start;
        if self.at(here.x, here.y).depth < 0.5 * depth {
            here = DVec2::new(0.5 * offset.min(self.radius), (self.radius - 2.0 * depth).min(height));
        }
        let mut value = self.at(here.x, here.y);
        let longest = 0.25 * self.radius;
        for _ in 0..MOST_STEPS {
            let squared = value.gradient.length_squared();
            if squared <= f64::MIN_POSITIVE {
                here = DVec2::new(0.5 * here.x, here.y.min(self.radius - 2.0 * depth));
                value = self.at(here.x, here.y);
                continue;
            }
            let along = (value.gradient.dot(here - start) + depth - value.depth) / squared;
            let step = (start + along * value.gradient - here).clamp_length_max(longest);
            let next = here + step;
            here = DVec2::new(next.x.abs(), next.y);
            value = self.at(here.x, here.y);
            if step.length_squared() < (SMALLEST_STEP * self.radius).powi(2) {
                break;
            }
        }
        let slope = value.gradient.length();
        let outward = if slope > 0.0 { -value.gradient / slope } else { DVec2::Y };
        let missing = if slope > 0.0 { (value.depth - depth) / slope } else { 0.0 };
        Nearest { distance: (start - here).dot(outward) - missing, outward, slope }
    }
}

/// The cell of a table in which a coordinate is, and the share of the cell before it.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to the number of cells")]
fn cell(x: f64, count: usize) -> (usize, f64) {
    let k = x.max(0.0).floor().min(count as f64);
    (k as usize, x - k)
}

/// Weights of four values for the cubic through the middle two (Catmull and Rom 1974).
fn cubic(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        0.5 * (2.0 * t2 - t3 - t),
        0.5 * (3.0 * t3 - 5.0 * t2 + 2.0),
        0.5 * (4.0 * t2 - 3.0 * t3 + t),
        0.5 * (t3 - t2),
    ]
}

/// Derivatives of [`cubic`].
fn cubic_slope(t: f64) -> [f64; 4] {
    let t2 = t * t;
    [
        0.5 * (4.0 * t - 3.0 * t2 - 1.0),
        0.5 * (9.0 * t2 - 10.0 * t),
        0.5 * (8.0 * t - 9.0 * t2 + 1.0),
        0.5 * (3.0 * t2 - 2.0 * t),
    ]
}
