//! Readings that their taxel does not give: far above what the other readings of the taxel and of the frame allow, or
//! far from its fitted profile. They are left out and named.
//!
//! *Heuristic*: of a frame at most the worst reading is left out in a round, since a spike also moves the frame, and with
//! it the residuals of its other readings.

use crate::id::{IdVec, VertexId};
use crate::numeric::nth_smallest;
use crate::skin::TaxelId;
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

/// Leaves out the worst reading of each frame whose residual, in standard deviations, is beyond the bound.
pub(super) fn drop_unfit(
    samples: &mut Samples,
    log: &TouchLog,
    sigmas: impl Fn(VertexId, &Sample) -> Option<f64>,
) -> Vec<LeftOutReading> {
    let of_taxel = |(v, of): (VertexId, &Vec<Sample>)| -> Vec<f64> {
        of.iter().map(|sample| sigmas(v, sample).unwrap_or(0.0).abs()).collect()
    };
    let found: IdVec<VertexId, Vec<f64>> = samples.of.enumerate().map(of_taxel).collect();
    let mut worst = vec![MOST_SIGMAS; log.frames.len()];
    for (of, found) in samples.of.iter().zip(&found) {
        for (sample, sigmas) in of.iter().zip(found) {
            worst[sample.frame] = worst[sample.frame].max(*sigmas);
        }
    }
    let mut next = found.map(|_| 0);
    leave_out(samples, log, |v, sample| {
        let sigmas = found[v][next[v]];
        next[v] += 1;
        sigmas > MOST_SIGMAS && sigmas >= worst[sample.frame]
    })
}

fn leave_out(
    samples: &mut Samples,
    log: &TouchLog,
    mut is_spike: impl FnMut(VertexId, &Sample) -> bool,
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
