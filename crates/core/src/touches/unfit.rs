//! What of a log cannot be: lengths of another unit, and logs that are hardly used.

use std::collections::BTreeMap;

use glam::DVec3;

use crate::numeric::median;
use crate::skin::TaxelId;
use crate::touches::contacts::TouchContacts;
use crate::touches::error::TouchesError;
use crate::touches::log::{TouchFrame, TouchLog};

/// A body that stays within this of one place in the frame of the link touches one place, or its poses stand still, in m.
pub(super) const STILL: f64 = 2e-3;

/// Positions that spread over more than this are not in metres, in m: a skin is smaller.
const MOST_SPREAD: f64 = 5.0;

/// A radius beyond so many times that spread is in another unit. A sphere with ten times the radius of the skin is almost a plane.
const MOST_RADII: f64 = 10.0;

/// Noise of readings over the usual largest reading of a taxel, above which they are not those of the spheres: it is 0.001 to 0.1 on logs of
/// a sphere that rolls, 1 on those of presses at 1 mm of noise, 3 at 4 mm and 5 to 7 at 8 mm, 5 with a radius that is ten times too large.
const MOST_NOISE: f64 = 2.0;

/// A taxel with fewer touches has no check, and fewer touches are not judged.
pub(super) const LEAST_TOUCHES: usize = 3;

/// The mean position of the body in a touch, in the frame of the link.
pub(super) fn place(touch: &[TouchFrame]) -> DVec3 {
    let places = touch.iter().map(|frame| frame.link.inverse().apply(frame.body.point()));
    places.sum::<DVec3>() / touch.len() as f64
}

/// The largest distance of a place from the middle of all, in m.
pub(super) fn spread_of(places: &[DVec3]) -> f64 {
    let middle = places.iter().sum::<DVec3>() / places.len().max(1) as f64;
    places.iter().map(|place| place.distance(middle)).fold(0.0, f64::max)
}

/// Checks that lengths and radii can be those of a skin in m.
///
/// # Errors
/// [`TouchesError::Lengths`] if touches are farther apart than on a skin, [`TouchesError::Radius`] if the radius of a body is far larger
/// than the region that the touches cover.
pub(super) fn check_lengths(log: &TouchLog) -> Result<(), TouchesError> {
    let touches = log.frames.chunk_by(|a, b| a.touch == b.touch);
    let places: Vec<DVec3> = touches.map(place).collect();
    let spread = spread_of(&places);
    if spread > MOST_SPREAD {
        return Err(TouchesError::Lengths { spread });
    }
    let is_judged = places.len() >= LEAST_TOUCHES && spread > STILL;
    let most = if is_judged { MOST_RADII * spread } else { MOST_SPREAD };
    match log.frames.iter().find(|frame| frame.body.radius() > most) {
        Some(frame) => Err(TouchesError::Radius { row: frame.row, radius: frame.body.radius(), spread }),
        None => Ok(()),
    }
}

impl TouchContacts {
    /// Checks that most of a log is in its contacts, and that readings are those of spheres of its radii; a few touches are not judged.
    /// Noise of the arm of some millimetres makes readings unlike those of spheres, too: with a drawing the fit of bodies takes it,
    /// and judges itself.
    ///
    /// # Errors
    /// [`TouchesError::MostLeftOut`], and without a drawing [`TouchesError::Profile`].
    pub(super) fn check(&mut self, log: &TouchLog, is_drawn: bool) -> Result<(), TouchesError> {
        let summary = &mut self.summary;
        if summary.touches < LEAST_TOUCHES {
            return Ok(());
        }
        let left_out = [
            ("touches", summary.empty_touches, summary.touches),
            ("taxels", summary.lost_taxels, summary.taxels + summary.lost_taxels),
            ("readings", summary.lone + summary.spikes.len(), summary.readings),
        ];
        for (what, left_out, of) in left_out {
            if 2 * left_out > of {
                return Err(TouchesError::MostLeftOut { what, left_out, of });
            }
        }
        let mut largest: BTreeMap<TaxelId, f64> = BTreeMap::new();
        for &(id, reading) in log.frames.iter().flat_map(|frame| &frame.felt) {
            let most = largest.entry(id).or_default();
            *most = most.max(reading);
        }
        match (summary.reading_noise, median(largest.into_values())) {
            (Some(noise), Some(typical)) if noise > MOST_NOISE * typical => {
                summary.unlike_spheres = true;
                if is_drawn { Ok(()) } else { Err(TouchesError::Profile { noise, typical }) }
            }
            _ => Ok(()),
        }
    }
}
