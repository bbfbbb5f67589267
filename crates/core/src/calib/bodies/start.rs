//! Where the fit begins: at the drawing, or where the motion of four touches places the skin as a whole.
//!
//! Samples of four touches give rigid motions `(fischler1981)`; those with the smallest median distance of all touches, and
//! the drawing, are refined with mount, probe and standoff, and the smallest median wins. So a drawing that is turned by 90
//! degrees or 60 mm off ends where the right one does.

use glam::DVec3;

use super::options::{BodyLevel, BodyOptions};
use super::placement::{BodyId, Hierarchy, Motion, Placement};
use super::solve::refined;
use super::touches::{Touch, Touches};
use crate::calib::CalibError;
use crate::calib::align::{Correlation, nearest_rotation};
use crate::id::IdVec;
use crate::numeric::{Random, argsort, median};
use crate::run::Run;

/// Samples, and how many of them are refined.
const SAMPLES: usize = 300;
const REFINED: usize = 4;

/// Touches of a sample. Fewer than twice as many in all leave nothing to judge a motion by.
const SAMPLE: usize = 4;

/// Another start must have a median distance below this share of that of the drawing, which is believed otherwise.
const BETTER: f64 = 0.97;

/// The start of a fit.
pub(super) fn start(
    options: &BodyOptions,
    hierarchy: &Hierarchy,
    touches: &Touches,
    run: Run<'_>,
) -> Result<Placement, CalibError> {
    let drawn = Placement::drawn(hierarchy);
    if touches.contacts < 2 * SAMPLE {
        return Ok(drawn);
    }
    let mut best: Option<(f64, Placement)> = None;
    for from in [drawn.clone()].into_iter().chain(sampled(hierarchy, touches, &drawn)) {
        let found = refined(options, hierarchy, touches, from, run)?;
        let error = |touch: &Touch| found.error(hierarchy, touch).0.length();
        let distance = median(touches.all.iter().map(error)).unwrap_or(f64::INFINITY);
        if best.as_ref().is_none_or(|(least, _)| distance < BETTER * least) {
            best = Some((distance, found));
        }
    }
    Ok(best.map_or(drawn, |(_, found)| found))
}

/// The best motions of samples of four touches.
fn sampled(hierarchy: &Hierarchy, touches: &Touches, drawn: &Placement) -> Vec<Placement> {
    let pair = |touch: &Touch| {
        let seen = touch.position;
        (seen - drawn.error(hierarchy, touch).0, seen)
    };
    let pairs: Vec<(DVec3, DVec3)> = touches.all.iter().map(pair).collect();
    // The first body is the mount.
    let mount = BodyId::new(0);
    let centre = hierarchy.centres[mount];
    let mut random = Random::new(0, 0);
    let mut motions = Vec::with_capacity(SAMPLES);
    for _ in 0..SAMPLES {
        let sample: [(DVec3, DVec3); SAMPLE] = std::array::from_fn(|_| pairs[random.below(pairs.len())]);
        let Correlation { from, to, matrix } = Correlation::new(&sample, None);
        let rotation = nearest_rotation(&matrix);
        let motion = Motion { translation: to + rotation * (centre - from) - centre, rotation };
        let away = |&(drawn, seen): &(DVec3, DVec3)| {
            (centre + motion.translation + motion.rotation * (drawn - centre)).distance(seen)
        };
        motions.push((median(pairs.iter().map(away)).unwrap_or(f64::INFINITY), motion));
    }
    let order = argsort(&motions.iter().map(|motion| motion.0).collect::<Vec<_>>());
    let placed = |k: usize| {
        let mut placement = drawn.clone();
        placement.motions[mount] = motions[k].1;
        placement
    };
    order.into_iter().take(REFINED).map(placed).collect()
}

/// A placement with the bodies below `level` as drawn.
pub(super) fn down_to(hierarchy: &Hierarchy, at: &Placement, level: BodyLevel) -> Placement {
    let motions: IdVec<BodyId, Motion> = hierarchy
        .levels
        .enumerate()
        .map(|(body, of)| if *of <= level { at.motions[body] } else { Motion::default() })
        .collect();
    Placement { motions, ..at.clone() }
}
