//! One press in the normal equations: its own unknowns are eliminated, and what is left is of its taxels and of the
//! two numbers that all presses share (the Schur complement of a bundle adjustment, `(triggs2000)`).

use crate::numeric::{dense_cholesky, solve_dense};
use crate::response::contact::{Pose, Shape, UNKNOWNS, sensed};
use crate::response::press::Press;

/// The numbers that all presses share.
pub(super) const SHARED: usize = 2;

/// The unknowns of one press.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub(super) poses: Vec<Pose>,
    pub(super) shape: Shape,
}

/// What all presses share, and what is assumed about each.
#[derive(Debug, Clone, Copy)]
pub(super) struct Common {
    /// The logarithm of the blur in m.
    pub(super) log_blur: f64,
    /// Readings grow with this power of the depth.
    pub(super) power: f64,
    /// Mean of the logarithm of the depth of a press, and its standard deviation.
    pub(super) depth: [f64; 2],
}

/// Standard deviations before anything is known: of a position in m, of the change of the logarithm of the depth from
/// frame to frame, of the logarithm of the radius, and of the shape.
const POSITION: f64 = 6e-3;
const DEPTH_STEP: f64 = 0.15;
const LOG_RADIUS: f64 = 0.6;
const OVAL: f64 = 0.3;

/// The usual radius of curvature of what presses, in m.
pub(super) const USUAL_RADIUS: f64 = 0.015;

/// Error of the contact model: a share of the prediction, or of the reading if that is larger.
const MODEL_ERROR: f64 = 0.05;
const READING_SHARE: f64 = 0.7;

/// Residuals beyond this many standard deviations count less (Huber).
const HUBER: f64 = 2.5;

/// Relative damping of the unknowns of a press; a hundred times as much doubles the number of steps.
const DAMPING: f64 = 1e-5;

/// The step of the logarithm of the blur that gives its derivative.
const BLUR_STEP: f64 = 0.03;

/// Powers are of the depth over this, in m.
const UNIT_DEPTH: f64 = 1e-3;

/// The depth in m below which readings fall linearly, so that powers of it have derivatives.
const LINEAR_DEPTH: f64 = 1e-6;

/// The equations of a press without its own unknowns.
#[derive(Debug, Clone)]
pub(super) struct Reduced {
    /// Rows and columns of the taxels, then of the shared numbers; row by row.
    pub(super) matrix: Vec<f64>,
    /// The gradient.
    pub(super) gradient: Vec<f64>,
    /// How the unknowns of the press answer: one row each, one column for each other unknown, then the own step.
    answers: Vec<f64>,
    /// Sum of the squared residuals over their standard deviations, as far as they count, and their number.
    pub(super) misfit: [f64; 2],
}

impl Reduced {
    /// Rows of the reduced equations.
    pub(super) fn rows(&self) -> usize {
        self.gradient.len()
    }

    /// The step of the unknowns of the press, after a step of its taxels and the shared numbers.
    pub(super) fn step(&self, others: &[f64]) -> Vec<f64> {
        let row = |row: &[f64]| row[others.len()] - row.iter().zip(others).map(|(a, x)| a * x).sum::<f64>();
        self.answers.chunks_exact(others.len() + 1).map(row).collect()
    }
}

/// Linearises the readings of a press and eliminates its unknowns. `logs` are the logarithms of readings over depth,
/// `noise` the standard deviations of readings, of the taxels of the press. `None` if its equations are singular.
pub(super) fn reduce(
    press: &Press,
    state: &State,
    common: &Common,
    logs: &[f64],
    noise: &[f64],
) -> Option<Reduced> {
    let frames = press.frames.len();
    let (own, taxels) = (3 * frames + 3, press.taxels.len());
    let others = taxels + SHARED;
    let mut hessian = vec![0.0; own * own];
    // Columns of the other unknowns, then the gradient.
    let mut mixed = vec![0.0; own * (others + 1)];
    let mut reduced = Reduced {
        matrix: vec![0.0; others * others],
        gradient: vec![0.0; others],
        answers: Vec::new(),
        misfit: [0.0; 2],
    };
    let blur = common.log_blur.exp();
    for (t, (frame, pose)) in press.frames.iter().zip(&state.poses).enumerate() {
        // Where the unknowns of the depth stand among those of the press.
        let place = |k: usize| if k < 3 { 3 * t + k } else { 3 * frames + k - 3 };
        for (m, (view, &reading)) in frame.views.iter().zip(&frame.readings).enumerate() {
            if reading.is_nan() {
                continue;
            }
            let (depth, by) = sensed(view, pose, &state.shape, blur);
            let (response, slope) = power(depth, common.power);
            let scale = logs[m].exp();
            let predicted = scale * response;
            let error = MODEL_ERROR * predicted.max(READING_SHARE * reading.max(0.0));
            let sigma = noise[m].hypot(error);
            let residual = reading - predicted;
            let size = (residual / sigma).abs();
            let weight = if size > HUBER { HUBER / size } else { 1.0 } / (sigma * sigma);
            reduced.misfit[0] += size.min(HUBER).powi(2);
            reduced.misfit[1] += 1.0;
            let own_by: [f64; UNKNOWNS] = by.map(|x| scale * slope * x);
            let wider = sensed(view, pose, &state.shape, (common.log_blur + BLUR_STEP).exp()).0;
            let shared_by = [
                scale * slope * (wider - depth) / BLUR_STEP,
                predicted * (depth.max(LINEAR_DEPTH) / UNIT_DEPTH).ln(),
            ];
            for (j, x) in own_by.iter().enumerate() {
                let row = place(j);
                for (k, y) in own_by.iter().enumerate() {
                    hessian[row * own + place(k)] += weight * x * y;
                }
                let row = &mut mixed[row * (others + 1)..][..=others];
                row[m] += weight * x * predicted;
                for (k, y) in shared_by.iter().enumerate() {
                    row[taxels + k] += weight * x * y;
                }
                row[others] += weight * x * residual;
            }
            reduced.matrix[m * others + m] += weight * predicted * predicted;
            reduced.gradient[m] += weight * predicted * residual;
            for (k, x) in shared_by.iter().enumerate() {
                let k = taxels + k;
                reduced.matrix[m * others + k] += weight * predicted * x;
                reduced.matrix[k * others + m] += weight * predicted * x;
                for (l, y) in shared_by.iter().enumerate() {
                    reduced.matrix[k * others + taxels + l] += weight * x * y;
                }
                reduced.gradient[k] += weight * x * residual;
            }
        }
    }
    add_priors(state, common, &mut hessian, &mut mixed, others);
    (0..own).for_each(|k| hessian[k * own + k] *= 1.0 + DAMPING);
    let right = mixed.clone();
    solve_dense(&dense_cholesky(&hessian, own)?, &mut mixed, others + 1);
    for (own_row, answer) in right.chunks_exact(others + 1).zip(mixed.chunks_exact(others + 1)) {
        for (j, x) in own_row[..others].iter().enumerate().filter(|(_, x)| **x != 0.0) {
            let row = &mut reduced.matrix[j * others..][..others];
            row.iter_mut().zip(answer).for_each(|(s, y)| *s -= x * y);
            reduced.gradient[j] -= x * answer[others];
        }
    }
    reduced.answers = mixed;
    Some(reduced)
}

/// What is known of a press before it is seen.
fn add_priors(state: &State, common: &Common, hessian: &mut [f64], mixed: &mut [f64], others: usize) {
    let frames = state.poses.len();
    let own = 3 * frames + 3;
    let mut pull = |row: usize, precision: f64, away: f64| {
        hessian[row * own + row] += precision;
        mixed[row * (others + 1) + others] -= precision * away;
    };
    for (t, pose) in state.poses.iter().enumerate() {
        (0..2).for_each(|k| pull(3 * t + k, POSITION.powi(-2), pose.at[k]));
        pull(3 * t + 2, 1e-6, 0.0);
    }
    let Shape { log_radius, oval } = state.shape;
    pull(3 * frames, LOG_RADIUS.powi(-2), log_radius - USUAL_RADIUS.ln());
    (0..2).for_each(|k| pull(3 * frames + 1 + k, OVAL.powi(-2), oval[k]));
    // The mean of the logarithms of depths is that of other presses, and they change slowly.
    let depths = || state.poses.iter().map(|pose| pose.log_depth);
    let share = (frames as f64).recip();
    let away = share * depths().sum::<f64>() - common.depth[0];
    let precision = common.depth[1].powi(-2);
    for t in 0..frames {
        let row = 3 * t + 2;
        (0..frames).for_each(|s| hessian[row * own + 3 * s + 2] += precision * share * share);
        mixed[row * (others + 1) + others] -= precision * share * away;
    }
    let precision = DEPTH_STEP.powi(-2);
    for (t, (before, after)) in depths().zip(depths().skip(1)).enumerate() {
        let (i, j) = (3 * t + 2, 3 * t + 5);
        hessian[i * own + i] += precision;
        hessian[j * own + j] += precision;
        hessian[i * own + j] -= precision;
        hessian[j * own + i] -= precision;
        mixed[i * (others + 1) + others] += precision * (after - before);
        mixed[j * (others + 1) + others] -= precision * (after - before);
    }
}

/// A power of a depth, a depth again, and its derivative.
fn power(depth: f64, power: f64) -> (f64, f64) {
    let at = depth.max(LINEAR_DEPTH);
    let value = UNIT_DEPTH * (at / UNIT_DEPTH).powf(power);
    if depth >= LINEAR_DEPTH { (value, power * value / at) } else { (value * depth / at, value / at) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::response::contact::View;
    use crate::response::press::PressFrame;

    /// What is left of a press is a difference of sums. Errors of the model bound how exact readings are, so that rounding is far below
    /// the information of the prior of gains, 6: as from orthogonal columns (Gram and Schmidt, twice), which lose no digit. So the system of the taxels
    /// always has a factor.
    #[test]
    fn what_is_left_of_a_press_is_that_of_orthogonal_columns() {
        let common = Common { log_blur: libm::log(1.3e-3), power: 0.9, depth: [libm::log(1e-3), 0.2] };
        let shape = Shape { log_radius: libm::log(0.01), oval: [0.1, -0.05] };
        let along = |k: usize| 4e-3 * (k as f64 - 2.0);
        let view = |t: usize, m: usize| View {
            at: [along(m / 5) + 1e-3 * t as f64, along(m % 5), 1e-5 * m as f64],
            slope: [0.02, -0.01],
        };
        let pose =
            |t: usize| Pose { at: [3e-4, -2e-4 * t as f64], log_depth: libm::log(5e-4 + 4e-4 * t as f64) };
        let state = State { poses: (0..4).map(pose).collect(), shape };
        let logs: Vec<f64> = (0..25).map(|m| libm::log(1e3) + 0.3 * libm::sin(m as f64)).collect();
        let blur = libm::exp(common.log_blur);
        let read = |t: usize, m: usize| {
            libm::exp(logs[m]) * power(sensed(&view(t, m), &pose(t), &shape, blur).0, common.power).0
        };
        let frame = |t: usize| PressFrame {
            views: (0..25).map(|m| view(t, m)).collect(),
            readings: (0..25).map(|m| read(t, m)).collect(),
        };
        let press = Press { taxels: (0..25).collect(), frames: (0..4).map(frame).collect() };
        for noise in [2e-3, 1e-12] {
            let reduced = reduce(&press, &state, &common, &logs, &[noise; 25]).unwrap();
            // One column for each unknown of the press, then of the others.
            let (own, others) = (15, 25 + SHARED);
            let mut rows: Vec<Vec<f64>> = Vec::new();
            let mut row = |cells: &[(usize, f64)]| {
                let mut row = vec![0.0; own + others];
                cells.iter().for_each(|&(k, x)| row[k] = x);
                rows.push(row);
            };
            for (t, m) in (0..4).flat_map(|t| (0..25).map(move |m| (t, m))) {
                let (depth, by) = sensed(&view(t, m), &pose(t), &shape, blur);
                let (response, slope) = power(depth, common.power);
                let (scale, predicted) = (libm::exp(logs[m]), libm::exp(logs[m]) * response);
                let root = noise.hypot(MODEL_ERROR * predicted).recip();
                let wider = sensed(&view(t, m), &pose(t), &shape, libm::exp(common.log_blur + BLUR_STEP)).0;
                let mut cells: Vec<(usize, f64)> = by
                    .iter()
                    .enumerate()
                    .map(|(k, x)| (if k < 3 { 3 * t + k } else { 12 + k - 3 }, root * scale * slope * x))
                    .collect();
                cells.push((own + m, root * predicted));
                cells.push((own + 25, root * scale * slope * (wider - depth) / BLUR_STEP));
                let log = libm::log(depth.max(LINEAR_DEPTH) / UNIT_DEPTH);
                cells.push((own + 26, root * predicted * log));
                row(&cells);
            }
            for t in 0..4 {
                (0..2).for_each(|k| row(&[(3 * t + k, POSITION.recip())]));
                row(&[(3 * t + 2, 1e-3)]);
                if t > 0 {
                    row(&[(3 * t - 1, -DEPTH_STEP.recip()), (3 * t + 2, DEPTH_STEP.recip())]);
                }
            }
            row(&[2, 5, 8, 11].map(|k| (k, 0.25 / common.depth[1])));
            row(&[(12, LOG_RADIUS.recip())]);
            (13..15).for_each(|k| row(&[(k, OVAL.recip())]));
            for k in 0..own {
                let squares: f64 = rows.iter().map(|row| row[k] * row[k]).sum();
                let mut damped = vec![0.0; own + others];
                damped[k] = (DAMPING * squares).sqrt();
                rows.push(damped);
            }
            for k in 0..own + others {
                for j in (0..own.min(k)).chain(0..own.min(k)) {
                    let both: f64 = rows.iter().map(|row| row[j] * row[k]).sum();
                    rows.iter_mut().for_each(|row| row[k] -= both * row[j]);
                }
                if k < own {
                    let length = rows.iter().map(|row| row[k] * row[k]).sum::<f64>().sqrt();
                    rows.iter_mut().for_each(|row| row[k] /= length);
                }
            }
            let exact = |a: usize, b: usize| rows.iter().map(|row| row[own + a] * row[own + b]).sum::<f64>();
            let pairs = (0..others).flat_map(|a| (0..others).map(move |b| (a, b)));
            let off = pairs.map(|(a, b)| (reduced.matrix[a * others + b] - exact(a, b)).abs());
            let worst = off.fold(0.0, f64::max);
            assert!(worst < 1e-5, "{worst} with a noise of {noise}");
        }
    }

    #[test]
    fn powers_have_their_derivatives() {
        for depth in [5e-7, 1e-5, 1e-3, 3e-3] {
            let slope = (power(depth + 1e-9, 0.8).0 - power(depth - 1e-9, 0.8).0) / 2e-9;
            assert!((slope / power(depth, 0.8).1 - 1.0).abs() < 1e-4, "{depth}");
        }
        assert_eq!(power(2e-3, 1.0).0, 2e-3);
    }
}
