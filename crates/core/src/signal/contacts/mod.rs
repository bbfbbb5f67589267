//! Contacts: connected regions of taxels under pressure, tracked from frame to frame.
//!
//! A region is a set of taxels of level 0 above the lower threshold that are connected by edges, with at
//! least one above the upper threshold `(canny1986)`: noise at the border of a contact neither splits it nor
//! makes it flicker. Two taxels next to the same taxel without a reading are also connected, so that a dead
//! taxel does not split a contact.
//!
//! Where the threshold is estimated, the noise is known: connected taxels above the lower threshold are a region too if
//! their sum is above the upper one times the root of their number, as unlikely as one taxel above it; and a contact goes
//! on while it is above the lower threshold. A contact that is not twice as strong is seen in its second frame.
//!
//! Taxels that a [gap link](crate::body) joins are neighbours, too: what presses two patches over a gap is one contact, with a
//! part on each. Its patch is that with most of the force.
//!
//! Readings must be near 0 where nothing touches the skin. If the threshold is estimated, the mean of the
//! same first frames is subtracted from each taxel, unless [`TrackerOptions::rest`] says that it is 0; else subtract a
//! baseline first ([`Conditioner`](crate::signal::Conditioner)).

mod at_once;
mod fingers;
mod find;
mod join;
mod joined;
mod noise;
mod place;
mod split;
mod tracker;
mod tracks;

use glam::{DVec2, DVec3};

use crate::body::BodyTaxel;
use crate::id::VertexId;
use crate::signal::SignalError;
use crate::skin::{LinkId, PatchId};

pub use tracker::{ContactTracker, TrackerState};

/// What touches the skin: it decides how contacts that are close to each other are separated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Probe {
    /// Anything: a region is split where a peak rises above the saddle to a higher one
    /// ([`TrackerOptions::prominence`]).
    #[default]
    Any,
    /// Fingers of a hand: zero and noise are followed, readings smoothed with a time constant of 0.15 s, and a region
    /// is split into straight ridges of the width of a finger; a palm stays one contact.
    Finger,
    /// A foot, a seat, a lying body: regions of a patch at most 10 cm apart are one contact, as heel and ball of a foot with
    /// a high arch; no region is split.
    Foot,
}

/// What readings are where nothing touches the skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Rest {
    /// Anything: their mean in the frames of which the threshold is estimated is subtracted, if it is estimated.
    #[default]
    Learned,
    /// About 0: the sensor was tared, or a zero is subtracted already.
    AtZero,
}

/// Criteria for a contact, and for the same contact in the next frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackerOptions {
    /// What touches the skin.
    pub probe: Probe,
    /// The channel to use, counted from 0.
    pub channel: usize,
    /// A region has at least one taxel above this, in the unit of the channel. `None`: it is
    /// estimated from the first frames, see [`TrackerOptions::noise_frames`].
    pub threshold: Option<f64>,
    /// The other taxels of a region are above this share of the threshold, above 0 and at most 1.
    pub low: f64,
    /// A region has at least this many taxels. A single taxel cannot be distinguished from a spike.
    pub least: usize,
    /// A region with several peaks is split: the subregion of a peak is a separate contact if the peak rises
    /// above the saddle to a higher peak by at least this share of its height, above 0; from 1 on no region
    /// is split.
    pub prominence: f64,
    /// A separate contact has at least this many taxels above the saddle.
    pub part: usize,
    /// What readings are at rest.
    pub rest: Rest,
    /// The threshold is estimated from this many first frames, at least 2, in which nothing should touch the skin, or from
    /// all frames if there are fewer. Their mean is subtracted from each taxel if readings at rest are to be
    /// [learned](Rest::Learned).
    pub noise_frames: usize,
    /// How far the centre of a contact may move between frames, in m, if the two regions share no taxel.
    pub reach: f64,
    /// A contact is reported if it lasts at least this many frames; it begins with the last of them.
    pub lasting: usize,
}

impl Default for TrackerOptions {
    /// A threshold estimated from five frames, and half of it as the lower one; at least two taxels;
    /// splitting where a peak of more than three taxels rises by 0.4 of its height; a reach of a centimetre;
    /// every contact reported at once.
    fn default() -> Self {
        Self {
            probe: Probe::Any,
            channel: 0,
            threshold: None,
            low: 0.5,
            least: 2,
            prominence: 0.4,
            part: 4,
            rest: Rest::Learned,
            noise_frames: 5,
            reach: 0.01,
            lasting: 1,
        }
    }
}

impl Probe {
    /// The default of [`TrackerOptions::low`]: fingers have the upper threshold at 6 and the lower at 3.75 standard
    /// deviations of the noise.
    pub fn low(self) -> f64 {
        match self {
            Self::Any | Self::Foot => TrackerOptions::default().low,
            Self::Finger => 0.625,
        }
    }
}

/// Most readings of the frames for the noise: 1 GiB.
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

/// The event of a contact in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ContactEvent {
    /// It is new.
    #[default]
    Onset,
    /// It existed in the last frame.
    Move,
    /// It has ended: the other fields are those of the last frame.
    Release,
}

/// One contact in one frame: a region of the skin under pressure.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ContactRegion {
    /// Number of the contact, from 0 on: the same in all frames.
    pub track: u64,
    /// Its event.
    pub event: ContactEvent,
    /// Number of frames since its onset, 1 for a new one.
    pub age: usize,
    /// The patch; of several, which gaps lie between, the one with most of the force.
    pub patch: PatchId,
    /// The link of the patch.
    pub link: LinkId,
    /// The taxels on the patch, ascending.
    pub taxels: Vec<VertexId>,
    /// The taxels on other patches, ascending.
    pub beyond: Vec<BodyTaxel>,
    /// Area of all taxels, in m^2.
    pub area: f64,
    /// Force on all taxels, in N: the sum of the readings of a force, or of readings times areas of a
    /// pressure. NaN if the unit of the channel is neither.
    pub force: f64,
    /// Centre of pressure, in m in the frame of the link: the mean of the taxels' positions, weighted
    /// by their force, moved to the nearest point of the skin around those on the patch. Other links are at rest.
    pub centre: DVec3,
    /// Unit normal of the skin there, outward.
    pub normal: DVec3,
    /// The centre on the map, in m.
    pub map: DVec2,
    /// Standard deviation of the positions, weighted by their force, along the longer principal axis
    /// in the tangent plane of the centre, in m.
    pub major: f64,
    /// Standard deviation along the shorter principal axis, in m.
    pub minor: f64,
    /// Direction of the longer principal axis on the map, in rad, above -pi/2 and at most pi/2.
    pub angle: f64,
    /// The taxel on the patch with the largest reading; the first of them.
    pub peak_taxel: VertexId,
    /// The largest reading on the patch.
    pub peak: f64,
}

impl ContactRegion {
    /// The taxels on all patches, those of `patch` first.
    pub fn all_taxels(&self) -> impl Iterator<Item = BodyTaxel> + '_ {
        let own = self.taxels.iter().map(|&taxel| BodyTaxel { patch: self.patch, taxel });
        own.chain(self.beyond.iter().copied())
    }

    /// Its patches, ascending.
    pub fn patches(&self) -> Vec<PatchId> {
        let mut patches: Vec<_> = self.beyond.iter().map(|at| at.patch).chain([self.patch]).collect();
        patches.sort_unstable();
        patches.dedup();
        patches
    }

    /// Order of regions in a frame: by patch, then by the first taxel.
    pub(super) fn place(&self) -> (PatchId, Option<VertexId>) {
        (self.patch, self.taxels.first().copied())
    }
}
