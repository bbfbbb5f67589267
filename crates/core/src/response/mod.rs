//! How much each taxel shows of the pressure on it, from recordings: of ordinary touches, of a pressure that is the
//! same everywhere, and of touches of known force.
//!
//! **From touches alone** ([`GainEstimator`]). A hand or an object presses here and there, and rolls a little: neighbouring
//! taxels see the same body from different places, and what they disagree about, press after press, is their gain. It is
//! the bundle adjustment of photogrammetry `(triggs2000)`: taxels are cameras, presses are points. Unknown are all
//! bodies, their paths, the blur of the cover and the gains, and what fits all readings best is found at once. The gains
//! are relative: touches say nothing of pascals, nor of the exponent of a response curve, which the contact law hides.
//!
//! **From steps of pressure** ([`StepEstimator`]): gain and exponent of each taxel, in pascals.
//!
//! **From touches of known force** ([`ScaleEstimator`]): the scale of relative gains.

mod bundle;
mod collect;
mod contact;
mod elimination;
mod error;
mod press;
mod scale;
mod steps;

use crate::id::{IdVec, VertexId};
use crate::numeric::median_of;
use crate::response::collect::Collector;
use crate::response::press::Press;
use crate::run::Run;
use crate::signal::Frame;
use crate::skin::{Patch, PatchId, Skin};

pub use bundle::GainReport;
pub use collect::Spike;
pub use error::ResponseError;
pub use scale::{EXPONENT_TOUCHES, SCALE_TOUCHES, ScaleEstimator, ScaleReport};
pub use steps::{Curves, StepEstimator, StepReport, TaxelCurve};

/// Presses that are needed at least.
const LEAST_PRESSES: usize = 20;

/// The share of readings of touched taxels that may be saturated.
const MOST_SATURATED: f64 = 0.5;

/// How much of the differences of typical readings are gains, at the start.
const START_SHARE: f64 = 0.6;

/// Estimates relative gains from recordings of touches, frame by frame.
pub struct GainEstimator<'s> {
    skin: &'s Skin,
    collector: Collector<'s>,
}

/// What is known of a taxel from touches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TaxelGain {
    /// Pressure over reading, relative to the geometric mean of the skin, to which that of a patch is known as far as bodies press
    /// all patches alike; NaN where no press determines it to
    /// a fifth.
    pub gain: f64,
    /// The standard deviation of its logarithm.
    pub sigma: f64,
    /// Presses that touched it.
    pub presses: usize,
}

/// Gains of all taxels, and how they were found.
pub type Gains = (IdVec<PatchId, IdVec<VertexId, TaxelGain>>, GainReport);

impl<'s> GainEstimator<'s> {
    /// An estimator of the taxels of a skin.
    ///
    /// # Errors
    /// If the skin is not valid.
    pub fn new(skin: &'s Skin) -> Result<Self, ResponseError> {
        skin.validate()?;
        Ok(Self { skin, collector: Collector::new(skin) })
    }

    /// Takes the next frame: the first channel, with zeros subtracted.
    ///
    /// # Panics
    /// If it does not have the patches and taxels of the skin.
    pub fn see(&mut self, frame: &Frame) {
        self.collector.see(frame);
    }

    /// Ends an episode of a recording: what comes next is not the same touch.
    pub fn end_episode(&mut self) {
        self.collector.end_episode();
    }

    /// Ends a recording: what comes next is not the same touch.
    pub fn end_recording(&mut self) {
        self.collector.end_recording();
    }

    /// The gains.
    ///
    /// # Errors
    /// If there are too few presses, most readings are saturated, or the contacts are not those of a soft cover.
    pub fn solve(self, run: Run<'_>) -> Result<Gains, ResponseError> {
        let (presses, noise, tally) = self.collector.finish();
        if presses.len() < LEAST_PRESSES {
            let (found, touches) = (presses.len(), tally.touches);
            return Err(ResponseError::TooFewPresses { found, touches, needed: LEAST_PRESSES });
        }
        if tally.saturated as f64 > MOST_SATURATED * tally.hot as f64 {
            return Err(ResponseError::Saturated { saturated: tally.saturated, readings: tally.hot });
        }
        let start = start(&presses, &noise, self.skin);
        let of_patch =
            |(number, patch): (usize, &Patch)| std::iter::repeat_n(number, patch.mesh.positions.len());
        let patches: Vec<usize> = self.skin.patches.iter().enumerate().flat_map(of_patch).collect();
        let (logs, sigma, report) = bundle::adjust(&presses, start, &noise, &patches, run)?;
        bundle::check_bounds(&report)?;
        let mut seen = vec![0; noise.len()];
        presses.iter().flat_map(|press| press.hot_taxels(&noise)).for_each(|taxel| seen[taxel] += 1);
        let mut next = 0;
        let gains = self.skin.patches.map(|patch| {
            let taxels = patch.mesh.positions.ids().map(|_| {
                let k = next;
                next += 1;
                let is_known = sigma[k] < bundle::USABLE && seen[k] > 0;
                let gain = if is_known { (-logs[k]).exp() } else { f64::NAN };
                TaxelGain { gain, sigma: sigma[k], presses: seen[k] }
            });
            taxels.collect()
        });
        Ok((
            gains,
            GainReport {
                several: tally.several,
                small: tally.small,
                spikes: tally.spikes,
                first_spike: tally.first_spike,
                ..report
            },
        ))
    }
}

/// First guesses of the logarithms of reading over depth: the typical largest reading of a taxel in a press, of which
/// a part is its gain; and a depth at which usual bodies touch as many taxels as these do.
fn start(presses: &[Press], noise: &[f64], skin: &Skin) -> Vec<f64> {
    let mut peaks: Vec<Vec<f64>> = vec![Vec::new(); noise.len()];
    let mut scales = Vec::new();
    let area: f64 = skin.patches.iter().map(|patch| patch.mesh.area()).sum::<f64>() / noise.len() as f64;
    for press in presses {
        let largest = |k: usize| press.frames.iter().map(|frame| frame.readings[k]).fold(f64::NAN, f64::max);
        for (k, &taxel) in press.taxels.iter().enumerate() {
            let largest = largest(k);
            if largest > press::HOT * noise[taxel as usize] {
                peaks[taxel as usize].push(largest.ln());
            }
        }
        for frame in &press.frames {
            let hot = |(x, &v): (&f64, &u32)| (*x > press::HOT * noise[v as usize]).then_some(*x);
            let hot: Vec<f64> = frame.readings.iter().zip(&press.taxels).filter_map(hot).collect();
            let peak = hot.iter().copied().fold(0.0, f64::max);
            // A body of radius R touches a disc of 2 pi R d at the depth d.
            let depth = hot.len() as f64 * area / (std::f64::consts::TAU * elimination::USUAL_RADIUS);
            if peak > 0.0 {
                scales.push((peak / depth).ln());
            }
        }
    }
    let typical: Vec<Option<f64>> = peaks.iter_mut().map(|peaks| median_of(peaks)).collect();
    let mut known: Vec<f64> = typical.iter().flatten().copied().collect();
    let middle = median_of(&mut known).unwrap_or(0.0);
    let scale = median_of(&mut scales).unwrap_or(0.0);
    typical.iter().map(|peak| scale + START_SHARE * (peak.unwrap_or(middle) - middle)).collect()
}
