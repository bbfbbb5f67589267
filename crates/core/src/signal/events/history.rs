//! The latest readings of all taxels, from which contacts are dated back to before they are above the threshold.
//!
//! A threshold lies above the noise of one taxel, and on a slow ramp far above zero. The sum of the readings of the taxels
//! of a contact is less noisy. The depth of a blunt body is proportional to the root of its force, so the root of the sum
//! rises evenly as the body comes nearer: a line through 0.4 and 0.8 of its largest value is zero where the contact began.

use crate::body::BodyTaxel;
use crate::id::{IdVec, VertexId};
use crate::signal::ContactRegion;
use crate::signal::clock::SAME_S;
use crate::skin::PatchId;

/// Frames that are kept, and the least time between them, in s.
const FRAMES: usize = 128;
const INTERVAL_S: f64 = 0.005;

/// Sums are averaged over frames up to this time before and after, in s: a line stays the same, and at 100 Hz the noise is
/// less than half. Of 0 / 10 / 20 / 40 ms, 20 was best: begin and end of 80 presses of 1 s with 2 kPa of noise within
/// 34 / 27 / 23 / 25 ms in 95 %, with 5 kPa within 555 / 112 / 64 / 75 ms. With [`AROUND_SHARE`], 20 gives 23 and 72.
const AROUND_S: f64 = 0.02;

/// And up to this share of the time that the contact lasts: the ramps of a tap are as short as such an average.
const AROUND_SHARE: f64 = 0.05;

/// Shares of the largest root through which the line goes.
const LOW: f64 = 0.4;
const HIGH: f64 = 0.8;

/// A taxel reads nothing in this many frames: below zero it is in half of the frames by noise, also where a slow contact has
/// begun. Of 1 / 3 / any number of frames, half of begins and ends of 60 presses of 3 s with 2 kPa of noise are off by 90 / 70 / 66
/// ms, and the worst of presses of 1 s by 50 / 32 / 47 ms.
const NOTHING: usize = 3;

/// A contact that moves leaves its first taxels, and may press them again and more: where the root falls below this share of
/// the largest so far, that has reached this share of the largest of all, what follows is not of the edge.
const PASSED: f64 = 0.5;

/// Which end of a contact is dated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Edge {
    Begin,
    End,
}

/// The taxels of a contact when it was largest in a stretch of time.
#[derive(Debug, Clone, Default)]
pub(super) struct Stretch {
    /// In s.
    pub(super) begin: f64,
    pub(super) peak: f64,
    pub(super) taxels: Vec<BodyTaxel>,
}

impl Stretch {
    /// Takes the contact in a frame.
    pub(super) fn add(&mut self, region: &ContactRegion) {
        if region.peak > self.peak {
            self.peak = region.peak;
            self.taxels.clear();
            self.taxels.extend(region.all_taxels());
        }
    }
}

/// A ring of frames.
#[derive(Debug, Clone)]
pub(super) struct History {
    /// The first taxel of each patch in a frame.
    starts: IdVec<PatchId, usize>,
    taxels: usize,
    values: Vec<f64>,
    times: Vec<f64>,
    /// The place of the next frame, and how many there are.
    next: usize,
    count: usize,
    /// The time of the first frame since times jumped.
    first: f64,
    /// Sums over the taxels of a contact that is dated.
    sums: Vec<f64>,
}

impl History {
    pub(super) fn new(taxels: &IdVec<PatchId, usize>) -> Self {
        let mut sum = 0;
        let starts = taxels.map(|count| {
            sum += count;
            sum - count
        });
        Self {
            starts,
            taxels: sum,
            values: Vec::new(),
            times: vec![0.0; FRAMES],
            next: 0,
            count: 0,
            first: f64::INFINITY,
            sums: Vec::with_capacity(FRAMES),
        }
    }

    /// The earliest time at which a contact that is first seen in this region and at this time may have begun: when its
    /// peak read nothing for the last time in [`NOTHING`] frames, or the first frame. The latter, if there is no frame before.
    pub(super) fn possible(&self, region: &ContactRegion, time: f64) -> f64 {
        let taxel = self.starts[region.patch] + region.peak_taxel.index();
        let reads = |k: usize| self.values[self.place(k) * self.taxels + taxel];
        let mut frames = 0..self.count;
        let at = frames.find(|&k| (k..self.count.min(k + NOTHING)).all(|k| reads(k) <= 0.0));
        at.map_or(self.first.min(time), |k| self.times[self.place(k)])
    }

    /// The time of the latest frame.
    pub(super) fn latest(&self) -> Option<f64> {
        (self.count > 0).then(|| self.times[self.place(0)])
    }

    /// Keeps a frame.
    pub(super) fn keep(&mut self, time: f64, values: &IdVec<PatchId, IdVec<VertexId, f64>>) {
        match self.latest() {
            Some(last) if time - last < INTERVAL_S - SAME_S => return,
            Some(_) => {}
            None => self.first = time,
        }
        self.values.resize(FRAMES * self.taxels, 0.0);
        let frame = &mut self.values[self.next * self.taxels..][..self.taxels];
        let all = values.iter().flat_map(|patch| patch.iter());
        frame.iter_mut().zip(all).for_each(|(to, &x)| *to = if x.is_finite() { x } else { 0.0 });
        self.times[self.next] = time;
        self.next = (self.next + 1) % FRAMES;
        self.count = (self.count + 1).min(FRAMES);
    }

    /// Forgets all frames, where times jump.
    pub(super) fn clear(&mut self) {
        self.count = 0;
        self.first = f64::INFINITY;
    }

    /// The place of the frame that is `back` frames before the last.
    fn place(&self, back: usize) -> usize {
        (self.next + 2 * FRAMES - 1 - back) % FRAMES
    }

    /// Number of frames on each side over which sums are averaged.
    fn around(&self, lasted: f64) -> usize {
        let span = self.times[self.place(0)] - self.times[self.place(self.count.saturating_sub(1))];
        let interval = span / self.count.saturating_sub(1).max(1) as f64;
        // Kept frames have a least distance.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`as` saturates")]
        let around = ((AROUND_S.min(AROUND_SHARE * lasted) + SAME_S) / interval.max(INTERVAL_S)) as usize;
        around
    }

    /// When the contact of these taxels began or ended, that was above the threshold from one time to another, and in
    /// all for `lasted`, in s; `None` if that is not known.
    pub(super) fn date(
        &mut self,
        edge: Edge,
        taxels: &[BodyTaxel],
        span: [f64; 2],
        lasted: f64,
    ) -> Option<f64> {
        let mut sums = std::mem::take(&mut self.sums);
        let back = |k: usize| if edge == Edge::Begin { k } else { self.count - 1 - k };
        sums.clear();
        sums.extend((0..self.count).map(|k| {
            let frame = &self.values[self.place(back(k)) * self.taxels..];
            taxels.iter().map(|at| frame[self.starts[at.patch] + at.taxel.index()]).sum::<f64>()
        }));
        let around = self.around(lasted);
        let step = |k: usize| {
            let around = around.min(k).min(self.count - 1 - k);
            let sum: f64 = sums[k - around..=k + around].iter().sum();
            [self.times[self.place(back(k))], (sum / (2 * around + 1) as f64).max(0.0).sqrt()]
        };
        let found = zero_of_line(self.count, step, span);
        self.sums = sums;
        found
    }
}

/// Where the line through the root is zero, from its largest value in a span of time outward.
fn zero_of_line(count: usize, step: impl Fn(usize) -> [f64; 2], span: [f64; 2]) -> Option<f64> {
    let inside = |[time, _]: [f64; 2]| (span[0]..=span[1]).contains(&time);
    // Inward, up to where the contact has moved on; of several largest ones the outermost.
    let inward = || (0..count).rev().filter(|&k| inside(step(k))).map(|k| (k, step(k)[1]));
    let largest = inward().fold(0.0, |most: f64, (_, root)| most.max(root));
    let (mut top, mut most) = (0, 0.0);
    for (k, root) in inward() {
        if root < PASSED * most && most >= PASSED * largest {
            break;
        }
        if root > most {
            (top, most) = (k, root);
        }
    }
    if most <= 0.0 {
        return None;
    }
    let crossing = |share: f64| {
        let level = share * most;
        let k = (top..count).find(|&k| step(k)[1] < level)?;
        let ([after, high], [before, low]) = (step(k - 1), step(k));
        Some(before + (after - before) * (level - low) / (high - low))
    };
    let (low, high) = (crossing(LOW)?, crossing(HIGH)?);
    Some(low - (high - low) * LOW / (HIGH - LOW))
}
