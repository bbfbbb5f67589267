//! Readings that their taxel does not give: far above what the other readings of the taxel and of the frame allow, or
//! far from what the fit expects. They are left out and named.
//!
//! *Heuristic*: a spike moves its frame, and with it the residuals of all readings of the frame. So in a frame that does not
//! fit, each reading in turn is left out and the frame placed by the others; the one whose absence costs least goes, if it
//! is far from what the others say of it, and then the next. They are spikes only if the others are then explained, and at
//! most half of a frame: else its pose or its taxels are wrong, which `calibrate` judges. One reading of 29,000, ten times as large as
//! it should be, is the only one that is left out; of logs without spikes none is.

use glam::{DMat3, DVec3};

use crate::id::VertexId;
use crate::numeric::nth_smallest;
use crate::parallel::par_map;
use crate::skin::TaxelId;
use crate::touches::bundle::{Bundle, Frame, HUBER_OF_ARM};
use crate::touches::gather::{Sample, Samples};
use crate::touches::log::TouchLog;

/// A reading that was left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeftOutReading {
    /// The row of its frame: [`TouchFrame::row`](crate::touches::TouchFrame::row).
    pub row: usize,
    /// Its taxel.
    pub taxel: TaxelId,
    /// The reading.
    pub reading: f64,
}

/// The largest reading of a taxel is taken from this share of its readings: the rest may be spikes.
const USUAL: f64 = 0.9;

/// Before the fit a reading is a spike if, over the usual largest one of its taxel, it is so many times larger than 1 and
/// than those of the other taxels of the frame. Presses of 0.5 and 4 mm in one log differ by eight.
const GROSS: f64 = 10.0;

/// After the fit a reading is a spike beyond so many standard deviations: of 1e14 normal ones one is.
const MOST_SIGMAS: f64 = 8.0;

/// Standard deviation of what is expected of a reading, for the profile is a model: a share of the reading, and so many times
/// the least noise of readings. Within eight of them, 40 % and a quarter of a typical reading, the loss of the fit is enough.
const MODEL_SHARE: f64 = 0.05;
const MODEL_FLOOR: f64 = 30.0;

/// Steps that place a frame without one of its readings.
const STEPS: usize = 5;

/// The usual largest reading of a taxel; 0 without a reading.
pub(super) fn usual_largest(samples: &[Sample]) -> f64 {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a length")]
    let rank = (USUAL * samples.len() as f64) as usize;
    nth_smallest(samples.iter().map(|sample| sample.reading).collect(), rank).unwrap_or(0.0)
}

/// Leaves out gross spikes, before anything is fitted.
pub(super) fn drop_gross(samples: &mut Samples, log: &TouchLog) -> Vec<LeftOutReading> {
    let usual = samples.of.map(|of| usual_largest(of));
    let share = |v: VertexId, sample: &Sample| sample.reading / usual[v];
    // The two largest shares of each frame.
    let mut largest = vec![[0.0_f64; 2]; log.frames.len()];
    for (v, of) in samples.of.enumerate() {
        for sample in of {
            let (share, [first, second]) = (share(v, sample), &mut largest[sample.frame]);
            (*first, *second) = (first.max(share), second.max(share.min(*first)));
        }
    }
    leave_out(samples, log, |v, sample| {
        let share = share(v, sample);
        share >= largest[sample.frame][0] && share > GROSS * largest[sample.frame][1].max(1.0)
    })
}

/// Leaves out the spikes of each frame.
pub(super) fn drop_unfit(
    samples: &mut Samples,
    log: &TouchLog,
    spikes: &[Vec<VertexId>],
) -> Vec<LeftOutReading> {
    leave_out(samples, log, |v, sample| spikes[sample.frame].contains(&v))
}

fn leave_out(
    samples: &mut Samples,
    log: &TouchLog,
    is_spike: impl Fn(VertexId, &Sample) -> bool,
) -> Vec<LeftOutReading> {
    let mut left_out = Vec::new();
    let Samples { ids, of, .. } = samples;
    for (k, of) in of.iter_mut().enumerate() {
        let v = VertexId::new(k);
        of.retain(|sample| {
            let is_spike = is_spike(v, sample);
            if is_spike {
                let row = log.frames[sample.frame].row;
                left_out.push(LeftOutReading { row, taxel: ids[v], reading: sample.reading });
            }
            !is_spike
        });
    }
    left_out
}

impl Bundle<'_> {
    /// The spikes of each frame.
    pub(super) fn spikes(&self) -> Vec<Vec<VertexId>> {
        par_map(&self.frames, |frame| self.spikes_of(frame))
    }

    fn spikes_of(&self, frame: &Frame) -> Vec<VertexId> {
        let is_near = frame.centre.distance(frame.believed) <= HUBER_OF_ARM * self.noise.arm;
        let (mut rest, mut spikes) = (frame.clone(), Vec::new());
        if is_near && self.is_explained(&rest) {
            return spikes;
        }
        while 2 * (spikes.len() + 1) <= frame.felt.len() {
            let tries = (0..rest.felt.len()).map(|k| (k, self.without(&rest, k)));
            let costs = tries.map(|(k, (frame, covariance))| (self.cost(&frame), k, frame, covariance));
            let Some((_, k, next, covariance)) = costs.min_by(|a, b| a.0.total_cmp(&b.0)) else { break };
            let (v, sample) = &rest.felt[k];
            if self.sigmas(*v, sample, next.centre, covariance) <= MOST_SIGMAS {
                break;
            }
            spikes.push(*v);
            rest = next;
            if self.is_explained(&rest) {
                return spikes;
            }
        }
        Vec::new()
    }

    /// A frame without one of its readings, placed by the others, and the covariance of its position.
    fn without(&self, frame: &Frame, k: usize) -> (Frame, DMat3) {
        let mut rest = frame.clone();
        rest.felt.remove(k);
        let mut reduced = self.reduce(&rest);
        for _ in 0..STEPS {
            rest.centre += reduced.step().clamp_length_max(self.guess_sigma);
            reduced = self.reduce(&rest);
        }
        (rest, reduced.covariance())
    }

    fn is_explained(&self, frame: &Frame) -> bool {
        let sigmas = |(v, sample): &(VertexId, Sample)| self.sigmas(*v, sample, frame.centre, DMat3::ZERO);
        frame.felt.iter().all(|felt| sigmas(felt) <= MOST_SIGMAS)
    }

    fn cost(&self, frame: &Frame) -> f64 {
        let sigmas = |(v, sample): &(VertexId, Sample)| self.sigmas(*v, sample, frame.centre, DMat3::ZERO);
        let readings: f64 = frame.felt.iter().map(|felt| sigmas(felt).min(MOST_SIGMAS).powi(2)).sum();
        readings + (frame.centre.distance(frame.believed) / self.noise.arm).powi(2)
    }

    /// How far a reading is from what is expected of it where the sphere's centre is there, in standard deviations; 0 if
    /// nothing is.
    fn sigmas(&self, v: VertexId, sample: &Sample, centre: DVec3, covariance: DMat3) -> f64 {
        let (Some(taxel), Some(at)) = (&self.taxels[v], &self.estimates[v]) else { return 0.0 };
        let here = Sample { centre, ..*sample };
        let Some((depth, gradient)) = taxel.pressed(&here, at) else { return 0.0 };
        let gain = libm::exp(at.log_gain);
        let floor = MODEL_FLOOR * self.noise.least_reading / libm::exp(self.gains.log_gain);
        let model = (MODEL_SHARE * depth).powi(2) + floor * floor + gradient.dot(covariance * gradient);
        (sample.reading / gain - depth).abs() / ((self.noise.reading / gain).powi(2) + model).sqrt()
    }
}
