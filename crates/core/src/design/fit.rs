//! The plate nearest to a surface, for the largest distance of its points.
//!
//! Gauss-Newton steps over the pose, the curvature and its direction, on distances along the normals of the nearest
//! points; then the same with weights that grow with the distance, which tends to the least largest distance; the best
//! plate on the way is the answer. *Heuristic*: with least squares alone a sphere needed 1.5 times the tolerance, and
//! a forearm with eight holes took 7 modules instead of 28.

use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::design::Plate;
use crate::design::plate::bend;
use crate::design::surface::{Foot, Surface};
use crate::numeric::solve_system;

/// Rounds of nearest points without weights, and with them; steps in each round. *Heuristic*: those of the experiments that
/// the numbers above are from; not varied.
const ROUNDS: usize = 4;
const WEIGHTED_ROUNDS: usize = 3;
const STEPS: usize = 3;

/// A point may hang over a rim by this much, in m: the accuracy of a cut by hand.
pub(super) const MAX_SLIP: f64 = 3e-4;

/// What all plates of a design share.
pub(super) struct Shape<'a> {
    pub(super) surface: &'a Surface,
    /// Points of the module whose distance counts: along the outline, then the taxels.
    pub(super) points: Vec<DVec2>,
    /// Points along the outline at which a plate that is fitted is measured again.
    pub(super) fine: Vec<DVec2>,
    /// Largest distance from the surface, in m.
    pub(super) tolerance: f64,
    /// Largest size of the curvature, in 1/m; 0 for rigid modules.
    pub(super) max_curvature: f64,
}

/// Where a point of a plate is drawn to, and how strongly, relative to its distance from the surface.
pub(super) struct Anchors<'a> {
    /// Each number of a point has this place, with this weight.
    pub(super) strong: &'a [(usize, DVec3, f64)],
    /// The weight of the places where the other points began.
    pub(super) weak: f64,
}

/// A plate, and how far its points are from the surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fitted {
    pub(super) plate: Plate,
    /// Largest distance of a point, in m.
    pub(super) gap: f64,
    /// Largest distance over a rim, in m.
    pub(super) slip: f64,
}

impl Fitted {
    fn cost(&self) -> f64 {
        // Plates that hang over a rim are of no use however near they are.
        self.gap + 5.0 * (self.slip - MAX_SLIP).max(0.0)
    }
}

impl Shape<'_> {
    /// Whether a plate is near enough to the surface and not over a rim.
    pub(super) fn accepts(&self, fitted: &Fitted) -> bool {
        fitted.gap <= self.tolerance && fitted.slip <= MAX_SLIP
    }

    /// The plate nearest to the surface that Gauss-Newton steps from `start` find; its curvature begins as that of the
    /// surface below. `None` where there is no surface.
    pub(super) fn fit(&self, start: Plate, anchors: &Anchors<'_>) -> Option<Fitted> {
        let mut plate = start;
        let bound = self.max_curvature;
        if bound > 0.0
            && let Some(found) = self.surface.curvature(&plate, &self.points)
        {
            (plate.curvature, plate.direction) = (found.most.clamp(-bound, bound), found.direction);
        } else {
            plate.curvature = plate.curvature.clamp(-bound, bound);
        }
        let begin: Vec<DVec3> = self.feet(&start)?.iter().map(|foot| foot.point).collect();
        let mut places: Vec<(DVec3, f64)> = begin.into_iter().map(|p| (p, anchors.weak)).collect();
        anchors.strong.iter().for_each(|&(k, place, weight)| places[k] = (place, weight));
        let mut weights = vec![1.0; self.points.len()];
        let mut best: Option<Fitted> = None;
        for round in 0..=ROUNDS + WEIGHTED_ROUNDS {
            let feet = self.feet(&plate)?;
            let fitted = self.measure(plate, &feet);
            // Far from the start the first rounds only find the place.
            if round >= 2 && best.is_none_or(|best| fitted.cost() < best.cost()) {
                best = Some(fitted);
            }
            let is_good = fitted.gap < 0.3 * self.tolerance && fitted.slip <= MAX_SLIP;
            let is_hopeless = fitted.cost() > 8.0 * self.tolerance + MAX_SLIP;
            if round >= 2 && (is_good || is_hopeless) {
                break;
            }
            if round >= ROUNDS {
                let far = fitted.gap.max(1e-9);
                for (weight, (at, foot)) in weights.iter_mut().zip(self.points.iter().zip(&feet)) {
                    let gap = (plate.point(*at) - foot.point).dot(foot.normal).abs();
                    *weight *= (0.05 + gap / far).powf(0.75);
                }
                let mean = weights.iter().sum::<f64>() / weights.len() as f64;
                weights.iter_mut().for_each(|weight| *weight /= mean);
            }
            for _ in 0..STEPS {
                plate = self.step(&plate, &feet, &places, &weights)?;
            }
        }
        best.map(|best| self.measured_again(best))
    }

    /// A plate that seems good, measured between the points that were fitted, too: an edge of the surface may be there.
    fn measured_again(&self, fitted: Fitted) -> Fitted {
        if !self.accepts(&fitted) {
            return fitted;
        }
        let plate = fitted.plate;
        let mut near = None;
        let gap = |at: &DVec2| {
            let point = plate.point(*at);
            let foot = self.surface.nearest(point, plate.normal(*at), &mut near);
            foot.map_or(f64::INFINITY, |foot| foot.point.distance(point))
        };
        Fitted { gap: self.fine.iter().map(gap).fold(fitted.gap, f64::max), ..fitted }
    }

    fn feet(&self, plate: &Plate) -> Option<Vec<Foot>> {
        let mut near = None;
        let foot = |&at: &DVec2| self.surface.nearest(plate.point(at), plate.normal(at), &mut near);
        self.points.iter().map(foot).collect()
    }

    fn measure(&self, plate: Plate, feet: &[Foot]) -> Fitted {
        let (mut gap, mut slip) = (0.0_f64, 0.0_f64);
        for (at, foot) in self.points.iter().zip(feet) {
            let off = plate.point(*at) - foot.point;
            gap = gap.max(off.length());
            if foot.is_on_rim {
                slip = slip.max(off.reject_from_normalized(foot.normal).length());
            }
        }
        Fitted { plate, gap, slip }
    }

    /// One step of the turn and shift of the frame, the curvature and its direction.
    fn step(&self, plate: &Plate, feet: &[Foot], places: &[(DVec3, f64)], weights: &[f64]) -> Option<Plate> {
        // Steps of the two derivatives by differences: a thousandth of common curvatures, and of a radian.
        const STEP: [f64; 2] = [1e-3, 1e-4];
        let mut system = [[0.0; 9]; 8];
        let mut add = |row: [f64; 9], weight: f64| {
            for (line, factor) in system.iter_mut().zip(row) {
                line.iter_mut().zip(row).for_each(|(cell, value)| *cell += weight * factor * value);
            }
        };
        for (k, (&at, foot)) in self.points.iter().zip(feet).enumerate() {
            let local = bend(at, plate.curvature, plate.direction);
            let change = |curvature: f64, direction: f64, step: f64| {
                plate.frame.matrix3 * ((bend(at, curvature, direction) - local) / step)
            };
            let by_curvature = change(plate.curvature + STEP[0], plate.direction, STEP[0]);
            let by_direction = change(plate.curvature, plate.direction + STEP[1], STEP[1]);
            let arm = plate.frame.matrix3 * local;
            let point = plate.frame.translation + arm;
            let row = |axis: DVec3, off: f64| {
                let turn = arm.cross(axis);
                let bends = [by_curvature.dot(axis), by_direction.dot(axis)];
                [turn.x, turn.y, turn.z, axis.x, axis.y, axis.z, bends[0], bends[1], -off]
            };
            add(row(foot.normal, (point - foot.point).dot(foot.normal)), weights[k] * weights[k]);
            let (place, weight) = places[k];
            for axis in DMat3::IDENTITY.to_cols_array_2d().map(DVec3::from_array) {
                add(row(axis, (point - place).dot(axis)), weight * weight);
            }
        }
        // So small that they only decide what the points leave open.
        const DAMPING: [f64; 8] = [1e-9, 1e-9, 1e-9, 1e-6, 1e-6, 1e-6, 1e-13, 1e-10];
        let is_rigid = self.max_curvature == 0.0;
        for (k, damping) in DAMPING.into_iter().enumerate() {
            system[k][k] += if is_rigid && k >= 6 { 1e9 } else { damping };
        }
        let [a, b, c, x, y, z, curvature, direction] = solve_system(system)?;
        let mut next = *plate;
        let turn = DQuat::from_scaled_axis(DVec3::new(a, b, c));
        // Without rounding that would stretch the plate.
        let frame = (turn * DQuat::from_mat3(&plate.frame.matrix3)).normalize();
        next.frame.matrix3 = DMat3::from_quat(frame);
        next.frame.translation += DVec3::new(x, y, z);
        let bound = self.max_curvature;
        next.curvature = (plate.curvature + curvature.clamp(-20.0, 20.0)).clamp(-bound, bound);
        next.direction += direction.clamp(-0.5, 0.5);
        next.frame.is_finite().then_some(next)
    }
}
