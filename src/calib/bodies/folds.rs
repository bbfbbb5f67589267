//! How well contacts that were held back are predicted, when the skin moves as one body, by patches or by modules:
//! which level the touches support.

use super::cad::CadSkin;
use super::misassembly::Assembled;
use super::options::{BodyLevel, BodyOptions, Folds};
use super::solve::solve;
use super::touches::Touches;
use crate::calib::CalibError;
use crate::numeric::{Random, argsort, nth_smallest};
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
    /// The last level whose mean over contacts is lower than that of the supported level before it by more than the
    /// standard error of the difference.
    pub supported: BodyLevel,
}

/// Distances at one level.
struct Distances {
    level: BodyLevel,
    touches: Vec<f64>,
    /// Mean of each contact that could be predicted.
    contacts: Vec<Option<f64>>,
}

/// Predicts each group of contacts from the others.
pub(super) fn score(
    options: &BodyOptions,
    folds: Folds,
    cad: &CadSkin,
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
    let levels = BodyLevel::ALL.into_iter().filter(|level| *level <= options.level);
    let empty = |level| Distances { level, touches: Vec::new(), contacts: vec![None; touches.contacts] };
    let mut all: Vec<Distances> = levels.map(empty).collect();
    for fold in 0..folds.count {
        let kept = touches.of_contacts(|contact| fold_of[contact] != fold);
        let held_back = touches.of_contacts(|contact| fold_of[contact] == fold);
        let assembled = Assembled::new(options, cad, &kept, run)?;
        for distances in &mut all {
            let fit = solve(options, distances.level, &assembled.hierarchy, &kept, run)?;
            for touch in &held_back.all {
                let distance = fit.placement.error(&assembled.hierarchy, touch).0.length();
                distances.touches.push(distance);
                *distances.contacts[touch.contact].get_or_insert(0.0) += touch.weight * distance;
            }
        }
    }
    let mut supported = 0;
    for k in 1..all.len() {
        if is_better(&all[k], &all[supported]) {
            supported = k;
        }
    }
    let supported = all[supported].level;
    Ok(HeldBack { scores: all.into_iter().map(Distances::score).collect(), supported })
}

/// Whether `one` predicts contacts better than `other`, by more than the standard error of the difference.
fn is_better(one: &Distances, other: &Distances) -> bool {
    let pairs = one.contacts.iter().zip(&other.contacts);
    let gains: Vec<f64> = pairs.filter_map(|(a, b)| Some((*b)? - (*a)?)).collect();
    let count = gains.len() as f64;
    let mean = gains.iter().sum::<f64>() / count;
    let variance = gains.iter().map(|gain| (gain - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    mean > (variance / count).sqrt()
}

impl Distances {
    fn score(self) -> LevelScore {
        let contacts: Vec<f64> = self.contacts.iter().flatten().copied().collect();
        let contact_mean = contacts.iter().sum::<f64>() / contacts.len() as f64;
        let tenths = |numbers: &[f64], tenths: usize| {
            let rank = numbers.len().saturating_sub(1) * tenths / 10;
            nth_smallest(numbers.to_vec(), rank).unwrap_or(f64::NAN)
        };
        LevelScore {
            level: self.level,
            median: tenths(&self.touches, 5),
            most: tenths(&self.touches, 9),
            contact_median: tenths(&contacts, 5),
            contact_mean,
        }
    }
}
