//! Contacts: connected regions of taxels that are pressed, followed from frame to frame.
//!
//! Regions live on the mesh of level 0. A region is a set of taxels above the lower threshold that
//! are joined by edges, and at least one of them is above the upper threshold (canny1986): noise at
//! the border of a contact neither splits it nor makes it flicker. Two taxels next to the same taxel
//! without a reading are joined too, so that a dead taxel does not cut a contact in two.
//!
//! In reading order: [`TrackerOptions`] has the thresholds, `noise` estimates them where none are given;
//! `find` finds the taxels of the regions of a frame ([`ContactRegion`]), `split` splits regions with
//! several peaks, `place` measures force, place and shape, `tracks` joins them to those of the last frame,
//! `tracker` does all of it ([`ContactTracker`]).
//!
//! Readings must be near 0 where nothing touches the skin. Where the threshold is estimated, the mean
//! of the same first frames is subtracted from each taxel; else subtract a baseline first
//! ([`Conditioner`](crate::signal::Conditioner)).

mod find;
mod noise;
mod place;
mod split;
mod tracker;
mod tracks;

use glam::{DVec2, DVec3};

use crate::id::VertexId;
use crate::signal::SignalError;
use crate::skin::{LinkId, PatchId};

pub use tracker::ContactTracker;

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
    /// skin, at least 2, or from those that there are. Their mean is subtracted from each taxel.
    ///
    /// The noise is the standard deviation of the readings of the noisiest taxels but for a
    /// twentieth. The threshold is the Gaussian quantile of this noise at which one taxel of the skin
    /// is above it by chance in a million frames. Readings without any noise, as simulated ones are, have a
    /// millionth of the largest reading of these frames as threshold: 0 where they are all 0, so that every reading
    /// above is a touch.
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
        let bad = |option: &str, found: f64, needed: &str| {
            Err(SignalError::option(format!("{option} of contacts"), found, needed))
        };
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

/// What happens to a contact in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ContactEvent {
    /// It is new.
    #[default]
    Onset,
    /// It was there in the last frame, too.
    Move,
    /// It is no longer there: the rest says how it was in the last frame.
    Release,
}

/// One contact in one frame: a region of the skin that is pressed.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ContactRegion {
    /// Number of the contact, from 0 on: the same in all frames.
    pub track: u64,
    /// What happens to it.
    pub event: ContactEvent,
    /// For how many frames it has been there, 1 for a new one.
    pub age: usize,
    /// The patch.
    pub patch: PatchId,
    /// The link of the patch.
    pub link: LinkId,
    /// The taxels, by their number.
    pub taxels: Vec<VertexId>,
    /// Area of the taxels, in m^2.
    pub area: f64,
    /// Force on the taxels, in N: the sum of the readings of a force, and of readings times areas of a
    /// pressure. NaN where the unit of the channel is of neither.
    pub force: f64,
    /// Centre of pressure, in m in the frame of the link: the mean of the taxels' positions, weighted
    /// by their force, moved to the nearest point of the skin around them.
    pub centre: DVec3,
    /// Unit normal of the skin there, outward.
    pub normal: DVec3,
    /// The centre on the map, in m.
    pub map: DVec2,
    /// Standard deviation of the positions, weighted by their force, along the longer principal axis
    /// in the tangent plane of the centre, in m.
    pub major: f64,
    /// That along the shorter principal axis, in m.
    pub minor: f64,
    /// Direction of the longer principal axis on the map, in rad, above -pi/2 and at most pi/2.
    pub angle: f64,
    /// The taxel with the largest reading; the first of them.
    pub peak_taxel: VertexId,
    /// The largest reading.
    pub peak: f64,
}

impl ContactRegion {
    /// Order of regions in a frame: by patch, then by the first taxel.
    pub(super) fn place(&self) -> (PatchId, Option<VertexId>) {
        (self.patch, self.taxels.first().copied())
    }
}
