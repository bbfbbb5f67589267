//! Modules, taxels with common electronics: steps of all their readings, and modules that are mounted turned.

use glam::{DQuat, DVec3};

use crate::numeric::{Csr, median};
use crate::signal::health::around::Around;
use crate::signal::health::survey::Survey;

/// A module has a step in a frame if this share of its taxels is over the threshold, up or down, and this share of those
/// around it is under a third of it, or under this many standard deviations of the noise; and in a recording, if it is so in
/// this share of the frames.
const STEPPED: f64 = 0.75;
const CALM: f64 = 0.8;
const CALM_THRESHOLD: f64 = 1.0 / 3.0;
const CALM_NOISE: f64 = 3.0;
const STEPPED_FRAMES: f64 = 0.25;

/// Taxels around a module, at least.
const LEAST_OUTER: usize = 3;

/// Angles by which a module may be turned, in degrees.
const TURNS: [f64; 5] = [60.0, 120.0, 180.0, 240.0, 300.0];

/// How far a turned taxel may be from the place of another one, over the distance of neighbours in the module.
const SAME_PLACE: f64 = 0.3;

/// Likeness to the taxels around the module that is won by a turn, at least, and over that without the turn; and how many
/// taxels must have such neighbours.
const LEAST_WON: f64 = 0.5;
const WON_SHARE: f64 = 0.5;
const LEAST_JUDGED: usize = 3;

/// The taxels of one module.
#[derive(Debug, Clone)]
pub(super) struct Module {
    pub(super) taxels: Vec<usize>,
    /// Taxels of no or another module next to it.
    outer: Vec<usize>,
    stepped: u32,
    frames: u32,
    /// Recordings in which it has a step, and all of them.
    pub(super) steps: u32,
    pub(super) recordings: u32,
}

impl Module {
    pub(super) fn new(taxels: Vec<usize>, around: &Around) -> Self {
        let mut outer: Vec<usize> = taxels
            .iter()
            .flat_map(|&taxel| around.of(taxel))
            .filter(|other| !taxels.contains(other))
            .collect();
        outer.sort_unstable();
        outer.dedup();
        Self { taxels, outer, stepped: 0, frames: 0, steps: 0, recordings: 0 }
    }

    pub(super) fn see(&mut self, x: &[f64], survey: &Survey) {
        let share = |taxels: &[usize], is_so: &dyn Fn(f64) -> bool| {
            let known = taxels.iter().map(|&taxel| x[taxel]).filter(|x| x.is_finite());
            let (count, so) =
                known.fold((0, 0), |(count, so), x| (count + 1, so + usize::from(is_so(x.abs()))));
            (count, so as f64 / count.max(1) as f64)
        };
        self.frames += 1;
        let (count, stepped) = share(&self.taxels, &|x| x > survey.threshold);
        if count < LEAST_OUTER || stepped < STEPPED {
            return;
        }
        let least = (CALM_THRESHOLD * survey.threshold).max(CALM_NOISE * survey.median_sigma);
        let (count, calm) = share(&self.outer, &|x| x < least);
        self.stepped += u32::from(count >= LEAST_OUTER && calm >= CALM);
    }

    pub(super) fn end_recording(&mut self) {
        self.recordings += u32::from(self.frames > 0);
        let is_step = self.stepped > 0 && f64::from(self.stepped) >= STEPPED_FRAMES * f64::from(self.frames);
        self.steps += u32::from(is_step);
        (self.frames, self.stepped) = (0, 0);
    }

    /// By how many degrees the module is turned, as its signals show, and the likeness that the turn wins.
    pub(super) fn turn(
        &self,
        around: &Around,
        likeness: &Csr<(u32, f64)>,
        is_judged: &[bool],
    ) -> Option<(f64, f64)> {
        // Of one taxel to those around the place of another one, outside the module.
        let outside = |taxel: usize, place: usize| {
            let others = around.of(place).filter(|other| is_judged[*other] && !self.taxels.contains(other));
            others.map(|other| of_pair(likeness, taxel, other)).sum::<f64>()
        };
        let has_outside =
            |&&taxel: &&usize| around.of(taxel).any(|o| is_judged[o] && !self.taxels.contains(&o));
        if self.taxels.iter().filter(has_outside).count() < LEAST_JUDGED {
            return None;
        }
        let own: f64 = self.taxels.iter().map(|&taxel| outside(taxel, taxel)).sum();
        let turned = TURNS.iter().filter_map(|&degrees| {
            let places = self.turned(around, degrees)?;
            let turned: f64 =
                self.taxels.iter().zip(places).map(|(&taxel, place)| outside(taxel, place)).sum();
            Some((degrees, turned - own))
        });
        let best = turned.max_by(|a, b| a.1.total_cmp(&b.1))?;
        (best.1 > LEAST_WON && best.1 > WON_SHARE * own).then_some(best)
    }

    /// The places that the taxels have if the module is turned; `None` if it then has other places.
    fn turned(&self, around: &Around, degrees: f64) -> Option<Vec<usize>> {
        let place = |taxel: usize| around.positions[taxel];
        let count = self.taxels.len() as f64;
        let centre = self.taxels.iter().map(|&taxel| place(taxel)).sum::<DVec3>() / count;
        let normal = self.taxels.iter().map(|&taxel| around.normals[taxel]).sum::<DVec3>().try_normalize()?;
        let nearest = |from: DVec3, but: Option<usize>| {
            let others = self.taxels.iter().copied().filter(|&other| Some(other) != but);
            let distances = others.map(|other| (place(other).distance(from), other));
            distances.min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let apart = median(self.taxels.iter().filter_map(|&k| Some(nearest(place(k), Some(k))?.0)))?;
        let turn = DQuat::from_axis_angle(normal, degrees.to_radians());
        let mut places = Vec::with_capacity(self.taxels.len());
        for &taxel in &self.taxels {
            let (distance, found) = nearest(centre + turn * (place(taxel) - centre), None)?;
            if distance > SAME_PLACE * apart || places.contains(&found) {
                return None;
            }
            places.push(found);
        }
        Some(places)
    }
}

/// The likeness of two taxels; 0 if they were never touched at once.
pub(super) fn of_pair(likeness: &Csr<(u32, f64)>, a: usize, b: usize) -> f64 {
    let others = &likeness[a];
    let found = others.binary_search_by(|&(other, _)| (other as usize).cmp(&b));
    found.map_or(0.0, |k| others[k].1)
}
