//! The model of a contact: the depth that a taxel senses below an ellipsoid.
//!
//! In the tangent plane where a frame of a press has its contact, a taxel is at `v` (along two axes and the normal), and
//! the skin rises there with the slope `t`. The ellipsoid is a paraboloid at `(a, b)`, with the depth `d`, the radius of
//! curvature `R` and the shape `(alpha, beta)`. With `A = v - (a, b)`
//!
//! ```text
//! u = d + v_3 - Q / 2,   Q = [(1 + alpha) A_1^2 + 2 beta A_1 A_2 + (1 - alpha) A_2^2] / R
//! ```
//!
//! is the depth at a point of the skin. The taxel senses its positive part on a disc, below a cover that spreads it by
//! `s`: the mean over seven points at the distance `1.6 s`, each with the mean of `max(u + w t, 0)` over `t` distributed
//! as chords of a disc, `w = 1.2 s |grad u|`.

use std::f64::consts::{FRAC_PI_3, PI};

/// The distance of the outer points, and the half width of the discs around all, over the blur.
const DISTANCE: f64 = 1.6;
const HALF_WIDTH: f64 = 1.2;

/// The least squared slope: on a plane parallel to the skin the edge of a contact is not sharp.
const LEAST_SLOPE: f64 = 1e-4;

/// Where a taxel is, as the contact of a frame sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct View {
    /// Along the two axes of the tangent plane, and its normal, in m.
    pub(super) at: [f64; 3],
    /// How the skin rises along the two axes.
    pub(super) slope: [f64; 2],
}

/// Where a body is in a frame of its press.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pose {
    /// Along the two axes of the tangent plane, in m.
    pub(super) at: [f64; 2],
    /// The logarithm of the depth in m.
    pub(super) log_depth: f64,
}

/// The shape of the body of a press.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shape {
    /// The logarithm of the radius of curvature in m.
    pub(super) log_radius: f64,
    /// How much more it curves along one axis than along the other, and along one diagonal than along the other.
    pub(super) oval: [f64; 2],
}

/// Unknowns of the depth: a pose, then a shape.
pub(super) const UNKNOWNS: usize = 6;

/// The mean of `max(u + w t, 0)` over `t` in -1 to 1 with the density `2 sqrt(1 - t^2) / pi`, and its derivative by `u`.
fn soft(u: f64, w: f64) -> (f64, f64) {
    let z = u / w;
    if z <= -1.0 {
        return (0.0, 0.0);
    }
    if z >= 1.0 {
        return (u, 1.0);
    }
    let root = (1.0 - z * z).sqrt();
    let share = 0.5 + (z * root + z.asin()) / PI;
    (u * share + w * 2.0 / (3.0 * PI) * root.powi(3), share)
}

/// The depth that a taxel senses, in m, and its derivatives by the unknowns.
pub(super) fn sensed(view: &View, pose: &Pose, shape: &Shape, blur: f64) -> (f64, [f64; UNKNOWNS]) {
    let curvature = (-shape.log_radius).exp();
    let depth = pose.log_depth.exp();
    let ([p, q], [t1, t2]) = (shape.oval, view.slope);
    let (mut sum, mut derivatives) = (0.0, [0.0; UNKNOWNS]);
    for point in 0..7_u32 {
        let (x, y, weight) = if point == 0 {
            (0.0, 0.0, 0.5)
        } else {
            let angle = FRAC_PI_3 * f64::from(point);
            (DISTANCE * blur * angle.cos(), DISTANCE * blur * angle.sin(), 1.0 / 12.0)
        };
        let (a, b) = (view.at[0] - pose.at[0] + x, view.at[1] - pose.at[1] + y);
        let s1 = curvature * ((1.0 + p) * a + q * b);
        let s2 = curvature * (q * a + (1.0 - p) * b);
        let bowl = 0.5 * (s1 * a + s2 * b);
        let u = depth + view.at[2] + x * t1 + y * t2 - bowl;
        let w = HALF_WIDTH * blur * ((s1 - t1).powi(2) + (s2 - t2).powi(2) + LEAST_SLOPE).sqrt();
        let (mean, share) = soft(u, w);
        if share > 0.0 {
            sum += weight * mean;
            let by = [s1, s2, depth, bowl, -0.5 * curvature * (a * a - b * b), -curvature * a * b];
            derivatives.iter_mut().zip(by).for_each(|(total, x)| *total += weight * share * x);
        }
    }
    (sum, derivatives)
}

#[cfg(test)]
mod tests {
    use super::*;

    const VIEW: View = View { at: [0.003, -0.002, -1e-4], slope: [0.05, -0.02] };
    const POSE: Pose = Pose { at: [1e-4, 2e-4], log_depth: -6.2 };
    const SHAPE: Shape = Shape { log_radius: -4.2, oval: [0.1, -0.2] };

    /// The mean over chords, against a sum.
    #[test]
    fn the_soft_edge_is_the_mean_over_chords() {
        for u in [-1.2, -0.7, 0.0, 0.4, 0.9, 1.3] {
            let n = 100_000;
            let chord = |k: i32| (2.0 * f64::from(k) + 1.0) / f64::from(n) - 1.0;
            let weight = |t: f64| 2.0 / PI * (1.0 - t * t).sqrt() * 2.0 / f64::from(n);
            let sum: f64 = (0..n).map(chord).map(|t| weight(t) * (u + 0.8 * t).max(0.0)).sum();
            assert!((soft(u, 0.8).0 - sum).abs() < 1e-6, "{u}");
        }
    }

    /// Without the change of the width of edges, which steps leave out, differences are derivatives.
    #[test]
    fn derivatives_are_those_of_the_depth() {
        let (blur, step) = (1e-6, 1e-7);
        let (_, derivatives) = sensed(&VIEW, &POSE, &SHAPE, blur);
        let moved = |k: usize, by: f64| {
            let (mut pose, mut shape) = (POSE, SHAPE);
            match k {
                0 | 1 => pose.at[k] += by,
                2 => pose.log_depth += by,
                3 => shape.log_radius += by,
                _ => shape.oval[k - 4] += by,
            }
            sensed(&VIEW, &pose, &shape, blur).0
        };
        for (k, derivative) in derivatives.into_iter().enumerate() {
            let found = (moved(k, step) - moved(k, -step)) / (2.0 * step);
            assert!(
                (found - derivative).abs() < 1e-4 * derivative.abs().max(1e-4),
                "{k}: {found}, {derivative}"
            );
        }
    }

    /// A cover spreads a deep contact's edge and leaves its middle as it is on a slope.
    #[test]
    fn blur_rounds_the_edge() {
        let centre = View { at: [0.0; 3], slope: [0.0; 2] };
        let edge = View { at: [0.009, 0.0, 0.0], ..centre };
        let depth = |view: &View, blur: f64| sensed(view, &POSE, &SHAPE, blur).0;
        assert!(depth(&edge, 2e-3) > depth(&edge, 1e-4));
        assert!(depth(&centre, 2e-3) < depth(&centre, 1e-4));
    }
}
