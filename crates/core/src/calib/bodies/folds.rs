//! How well contacts that were held back are predicted, when the skin moves as one body, by patches or by modules:
//! which level the touches support, and whether the fit can be believed.

use glam::DVec3;

use super::options::{BodyLevel, Folds};
use super::placement::{BodyId, Hierarchy, Placement};
use super::solve::{Solved, continued};
use super::start::down_to;
use super::touches::{Touch, Touches};
use crate::calib::CalibError;
use crate::numeric::{Random, argsort, median, nth_smallest};
use crate::run::Run;

/// How well one level predicts contacts that were held back.
#[derive(Debug, Clone, PartialEq)]
pub struct LevelScore {
    /// The last level that moved.
    pub level: BodyLevel,
    /// Median distance of a touch from its prediction, in m; every touch counts.
    pub median: f64,
    /// 90 % of the distances are below this, in m.
    pub most: f64,
    /// Median over contacts of the mean distance of their touches, in m.
    pub contact_median: f64,
    /// Mean over contacts of the same, in m.
    pub contact_mean: f64,
}

/// Scores of the levels, and the last level that predicts better than those before.
#[derive(Debug, Clone, PartialEq)]
pub struct HeldBack {
    /// One for each level up to that of the options.
    pub scores: Vec<LevelScore>,
    /// The last level whose mean over contacts is lower than that of the supported level before it by more than two
    /// standard errors of the difference. The result is the fit down to this level.
    pub supported: BodyLevel,
    /// Median distance of the touches from where the drawing predicts them, in m.
    pub drawn_median: f64,
    /// 90 % of these distances are below this, in m.
    pub drawn_most: f64,
    /// `1 - (d / s)^2`: `d` is the median distance of held-back touches from their prediction at the supported level, `s` that of the touches
    /// from their middle.
    pub explained: f64,
    /// The same of the touches of each patch alone, in the order of the patches: the share of the whole says little of taxels that are
    /// exchanged within a patch on a long link. `None` of a patch with few touches, or whose drawn taxels are nearly as close together as
    /// touches are exact.
    pub explained_of_patches: Vec<Option<f64>>,
    /// How much nearer the fit predicts held-back contacts than the drawing, in standard errors of the difference.
    pub gain: f64,
}

/// Standard errors by which a further level must predict better. Of 24 simulated skins the mean error after this choice is
/// 0.71 mm; with one standard error it is 0.80, and always with modules 0.88.
const LEVEL_ERRORS: f64 = 2.0;

/// When levels are compared, a distance counts at most this many medians, so that wrong touches do not decide.
const MOST_MEDIANS: f64 = 3.0;

/// A patch with fewer touches is not judged.
const LEAST_TOUCHES: usize = 10;

/// The squared spread of the drawn taxels that felt them over that of the touches of a patch, below which noise decides.
const LEAST_PREDICTED: f64 = 0.5;

/// Distances at one level, or of the drawing.
struct Distances {
    /// In the order in which they are predicted, with the touch.
    touches: Vec<f64>,
    of: Vec<Touch>,
    /// Mean of each contact.
    contacts: Vec<f64>,
}

/// Predicts each group of contacts from the others.
pub(super) fn score(
    folds: Folds,
    fitted: &Solved,
    hierarchy: &Hierarchy,
    touches: &Touches,
    run: Run<'_>,
) -> Result<HeldBack, CalibError> {
    if folds.count > touches.contacts {
        let (option, needed) = ("the number of folds", "at most the number of contacts");
        return Err(CalibError::BadOption { option, found: folds.count as f64, needed });
    }
    let mut random = Random::new(folds.seed, 0);
    let keys: Vec<f64> = (0..touches.contacts).map(|_| random.uniform()).collect();
    let mut fold_of = vec![0; touches.contacts];
    for (rank, contact) in argsort(&keys).into_iter().enumerate() {
        fold_of[contact] = rank % folds.count;
    }
    let levels: Vec<BodyLevel> =
        BodyLevel::ALL.into_iter().filter(|level| *level <= fitted.learned.level).collect();
    let empty = || Distances { touches: Vec::new(), of: Vec::new(), contacts: vec![0.0; touches.contacts] };
    let mut all: Vec<Distances> = levels.iter().map(|_| empty()).collect();
    let mut drawn = empty();
    let drawing = Placement::drawn(hierarchy);
    touches.all.iter().for_each(|touch| drawn.add(&drawing, hierarchy, touch));
    for fold in 0..folds.count {
        let kept = touches.of_contacts(|contact| fold_of[contact] != fold);
        let held_back = touches.of_contacts(|contact| fold_of[contact] == fold);
        for (distances, level) in all.iter_mut().zip(&levels) {
            let from = down_to(hierarchy, &fitted.placement, *level);
            let found = continued(fitted, *level, hierarchy, &kept, from, run)?;
            held_back.all.iter().for_each(|touch| distances.add(&found, hierarchy, touch));
        }
    }
    let mut supported = 0;
    let most = MOST_MEDIANS * all[0].median();
    for k in 1..all.len() {
        if all[k].gain_over(&all[supported], most) > LEVEL_ERRORS {
            supported = k;
        }
    }
    let spread = spread(touches.all.iter().map(|touch| touch.position));
    let best = &all[supported];
    Ok(HeldBack {
        supported: levels[supported],
        drawn_median: drawn.median(),
        drawn_most: tenths(&drawn.touches, 9),
        explained: 1.0 - (best.median() / spread).powi(2),
        explained_of_patches: best.explained_of_patches(hierarchy),
        gain: best.gain_over(&drawn, MOST_MEDIANS * drawn.median()),
        scores: levels.into_iter().zip(&all).map(|(level, distances)| distances.score(level)).collect(),
    })
}

/// The median distance of some places from their middle, in m.
fn spread(places: impl Iterator<Item = DVec3> + Clone) -> f64 {
    let along = |axis: usize| median(places.clone().map(|place| place[axis])).unwrap_or(0.0);
    let middle = DVec3::from_array([0, 1, 2].map(along));
    median(places.clone().map(|place| place.distance(middle))).unwrap_or(0.0)
}

/// The quantile of some numbers, in tenths.
fn tenths(numbers: &[f64], tenths: usize) -> f64 {
    let rank = numbers.len().saturating_sub(1) * tenths / 10;
    nth_smallest(numbers.to_vec(), rank).unwrap_or(f64::NAN)
}

impl Distances {
    fn add(&mut self, at: &Placement, hierarchy: &Hierarchy, touch: &Touch) {
        let distance = at.error(hierarchy, touch).0.length();
        self.touches.push(distance);
        self.of.push(touch.clone());
        self.contacts[touch.contact] += touch.weight * distance;
    }

    /// What is explained of the touches of each patch.
    fn explained_of_patches(&self, hierarchy: &Hierarchy) -> Vec<Option<f64>> {
        let patches = hierarchy.levels.enumerate().filter(|(_, level)| **level == BodyLevel::Patch);
        let explained = |patch: BodyId| {
            let is_own = |touch: &Touch| touch.taxels.iter().all(|&(v, _)| hierarchy.chain(v)[1] == patch);
            let own: Vec<(f64, &Touch)> =
                self.touches.iter().copied().zip(&self.of).filter(|(_, touch)| is_own(touch)).collect();
            let seen = spread(own.iter().map(|(_, touch)| touch.position));
            // Of the taxels one by one: means of taxels that are exchanged are closer together.
            let felt =
                own.iter().flat_map(|(_, touch)| touch.taxels.iter().map(|&(v, _)| hierarchy.positions[v]));
            let predicted = spread(felt);
            let is_judged = own.len() >= LEAST_TOUCHES && predicted.powi(2) > LEAST_PREDICTED * seen.powi(2);
            let distance = median(own.iter().map(|(distance, _)| *distance))?;
            is_judged.then(|| 1.0 - (distance / seen).powi(2))
        };
        patches.map(|(patch, _)| explained(patch)).collect()
    }

    fn median(&self) -> f64 {
        tenths(&self.touches, 5)
    }

    /// How much nearer its predictions of contacts are than those of another, distances counting at most as `most`, in
    /// standard errors of the difference.
    fn gain_over(&self, other: &Self, most: f64) -> f64 {
        let pairs = self.contacts.iter().zip(&other.contacts);
        let gains: Vec<f64> = pairs.map(|(a, b)| b.min(most) - a.min(most)).collect();
        let count = gains.len() as f64;
        let mean = gains.iter().sum::<f64>() / count;
        let variance = gains.iter().map(|gain| (gain - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
        if variance > 0.0 { mean / (variance / count).sqrt() } else { 0.0 }
    }

    fn score(&self, level: BodyLevel) -> LevelScore {
        LevelScore {
            level,
            median: self.median(),
            most: tenths(&self.touches, 9),
            contact_median: tenths(&self.contacts, 5),
            contact_mean: self.contacts.iter().sum::<f64>() / self.contacts.len() as f64,
        }
    }
}
