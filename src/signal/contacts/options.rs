//! What counts as a contact, and as the same contact in the next frame.

use crate::signal::SignalError;

/// What counts as a contact, and as the same contact in the next frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackerOptions {
    /// The channel that is looked at, counted from 0.
    pub channel: usize,
    /// A region has at least one taxel above this, in the unit of the channel. `None`: it is
    /// estimated from the first frames, see [`TrackerOptions::noise_frames`].
    pub threshold: Option<f64>,
    /// The other taxels of a region are above this share of the threshold, above 0 and at most 1.
    pub low: f64,
    /// A region has at least this many taxels. One taxel alone cannot be distinguished from a spike of
    /// that taxel.
    pub least: usize,
    /// A region with several peaks is split: a part of it is a contact of its own if its peak rises
    /// above the saddle to a higher peak by at least this share of its height, above 0; from 1 on no
    /// region is split.
    pub prominence: f64,
    /// Such a part has at least this many taxels above the saddle.
    pub part: usize,
    /// The threshold is estimated from this many first frames, in which nothing should touch the
    /// skin, and no region is reported; at least 2. Their mean is subtracted from each taxel.
    ///
    /// The noise is the standard deviation of the readings of the noisiest taxels but for a
    /// twentieth. The threshold is the Gaussian quantile of this noise at which one taxel of the skin
    /// is above it by chance in a million frames. Readings without any noise, as simulated ones are,
    /// have a hundredth of the largest reading so far as threshold.
    pub noise_frames: usize,
    /// How far the centre of a contact may move from a frame to the next, in m, if the two regions
    /// share no taxel.
    pub reach: f64,
    /// A contact is reported if it lasts at least this many frames; it begins with the last of them.
    pub lasting: usize,
}

impl Default for TrackerOptions {
    /// Estimated from five frames; half of the threshold as the lower one; at least two taxels; split
    /// where a peak of more than three taxels rises by half of its height; a reach of a centimetre,
    /// every contact reported at once.
    fn default() -> Self {
        Self {
            channel: 0,
            threshold: None,
            low: 0.5,
            least: 2,
            prominence: 0.5,
            part: 4,
            noise_frames: 5,
            reach: 0.01,
            lasting: 1,
        }
    }
}

/// Memory that the frames for the noise may take, in readings: 1 GiB.
const MAX_NOISE_READINGS: usize = 1 << 27;

impl TrackerOptions {
    /// Checks every number, for a skin of `taxels` taxels.
    pub(super) fn validate(&self, taxels: usize) -> Result<(), SignalError> {
        let bad = |option, found, needed| Err(SignalError::TrackerOption { option, found, needed });
        if let Some(found) = self.threshold.filter(|x| !(x.is_finite() && *x > 0.0)) {
            return bad("the threshold", found, "a positive number");
        }
        if !(self.low > 0.0 && self.low <= 1.0) {
            return bad("the lower over the upper threshold", self.low, "a share above 0 and at most 1");
        }
        if self.prominence.is_nan() || self.prominence <= 0.0 {
            return bad("the prominence of a part", self.prominence, "a share above 0");
        }
        if self.reach.is_nan() || self.reach < 0.0 {
            return bad("the reach in m", self.reach, "0 or a positive number");
        }
        let most = (MAX_NOISE_READINGS / taxels.max(1)).max(2);
        if self.threshold.is_none() && !(2..=most).contains(&self.noise_frames) {
            let found = self.noise_frames as f64;
            return bad("the number of frames for the noise", found, "2 or more, less than 1 GiB in all");
        }
        Ok(())
    }
}
