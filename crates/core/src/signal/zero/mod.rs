//! Follows the zero of each taxel, the reading of an untouched one, and only where nothing touches.
//!
//! Zeros of tactile sensors drift by many times their noise: with temperature, all in about the same direction, and each
//! by itself. A zero that follows readings at all times swallows a contact that is held. Here all zeros of a patch follow
//! the common drift of its untouched taxels, and each taxel follows its own readings while neither it nor a neighbour on the
//! mesh is *active*:
//!
//! 1. The noise `sigma` of a taxel is that of the differences of successive readings.
//! 2. A taxel is active from `5 sigma` above its zero on until it falls below `2.5 sigma` and 12 % of its peak. For a
//!    second after it, what the sensor has not yet released counts as zero.
//! 3. All zeros of a patch move with the mean excess of its untouched taxels: a fading memory of 1 s of its offset and its
//!    velocity, at most `0.6 sigma` a second, times a coefficient of each taxel. This is estimated while the taxel is untouched,
//!    from how far its zero and the common drift have moved since the zero was taken. Taxels whose sum with those next
//!    to them is `5 sigma` of that sum are left out: they may be touched weakly. A patch with fewer than 20 others moves
//!    with all patches, or not at all.
//! 4. Untouched taxels follow what is left: `zero += (1 - exp(-dt / 5 s)) x`, with the excess `x` limited to `2 sigma`; the
//!    mean of a zero that is younger than 5 s.
//! 5. A taxel `5 sigma` below its zero for five frames had its zero taken in contact: its zero is taken again. Where
//!    connected taxels jump at once and some fall below their zero, a module was replaced: all of theirs are.
//!
//! *Heuristic*; measured on simulated recordings with a drift of 1 % of the full scale a minute: a force error of 2 %
//! where the mean of the first frames has 40 %. Zeros that drift together by up to `0.4 sigma` a second make no contact; at
//! 0.6 some do. A module whose readings all rise at once looks like a touch, a touch that raises most taxels of a patch by
//! less than `5 sigma` fades in seconds, and a taxel whose readings cannot fall below zero keeps a zero that was taken in
//! contact.

mod common;
mod track;

use crate::id::{IdVec, VertexId};
use crate::map::SkinMap;
use crate::mesh::neighbours;
use crate::numeric::Csr;
use crate::pyramid::LevelId;
use crate::signal::zero::track::Track;
use crate::signal::{Channel, ChannelKind, Clock, Frame, Stage, main_channel};
use crate::skin::PatchId;

pub use track::ZeroReport;

/// The first zero is the mean of the frames of this time, in s, and of this many at least.
const START_S: f64 = 1.0;
const START_FRAMES: usize = 5;

/// Subtracts zeros that follow drift; owns its buffers, and allocates nothing.
///
/// It follows the channels of force, pressure, charge and counts, and leaves others as they are. Along a direction
/// within the skin (`shear.x`, `force.T`) touches have either sign, so that a zero taken in contact is not noticed there.
///
/// ```
/// use dermatome::{map::SkinMap, mesh::shapes, signal::{Channel, Frame, Stage, ZeroTracker}, skin::PatchId};
///
/// let map = SkinMap::flat(shapes::lattice(6, 6, 0.004), 1e-3);
/// let (mut tracker, mut frame) = (ZeroTracker::new(&map, &[Channel::default()]), Frame::new(&map, 1));
/// for k in 0..600 {
///     frame.time = 0.1 * f64::from(k);
///     // All readings rise, by 24 in the whole minute.
///     let noise = if k % 2 == 0 { 1.0 } else { -1.0 };
///     frame.values[PatchId::new(0)][0].iter_mut().for_each(|x| *x = 1000.0 + noise + 0.04 * f64::from(k));
///     assert!(tracker.apply(&frame).values[PatchId::new(0)][0].iter().all(|x| x.abs() < 5.0));
/// }
/// ```
#[derive(Debug, Clone)]
pub struct ZeroTracker {
    /// The taxels next to each one, patch after patch.
    neighbours: Csr<u32>,
    tracks: Vec<Option<Track>>,
    main: usize,
    clock: Clock,
    out: Frame,
}

impl ZeroTracker {
    /// A tracker of frames with these channels.
    pub fn new(map: &SkinMap, channels: &[Channel]) -> Self {
        Self::starting(map, channels, START_S, START_FRAMES)
    }

    /// A tracker whose first zeros are the means of the frames of this time, in s, and of this many frames.
    pub(crate) fn starting(map: &SkinMap, channels: &[Channel], seconds: f64, frames: usize) -> Self {
        let neighbours =
            neighbours(map.patches.iter().map(|patch| &patch.levels[LevelId::new(0)].level.mesh));
        let taxels = || map.patches.iter().map(|patch| patch.taxels.ids.len());
        let track = |channel: &Channel| {
            let is_signed = channel.kind == ChannelKind::Tangential;
            channel.kind.is_of_touch().then(|| Track::new(taxels(), is_signed, (seconds, frames)))
        };
        Self {
            neighbours,
            tracks: channels.iter().map(track).collect(),
            main: main_channel(channels.iter().map(|channel| channel.kind)),
            clock: Clock::new(),
            out: Frame::new(map, channels.len()),
        }
    }

    /// The frame that was passed on last.
    pub(crate) fn latest(&self) -> &Frame {
        &self.out
    }

    /// The zero of each taxel in the main channel, patch after patch; NaN where it is not known.
    pub(crate) fn zeros(&self) -> Vec<f64> {
        match self.tracks.get(self.main) {
            Some(Some(track)) => track.zeros().collect(),
            _ => vec![f64::NAN; self.out.values.iter().map(|channels| channels[0].len()).sum()],
        }
    }

    /// The noise of each untouched taxel in the main channel; NaN where it is not known.
    pub(crate) fn noise(&self) -> impl Iterator<Item = f64> {
        self.tracks.get(self.main).and_then(Option::as_ref).into_iter().flat_map(Track::noise)
    }

    /// What happened so far, in all channels.
    pub fn report(&self) -> ZeroReport {
        let reports = self.tracks.iter().flatten().map(|track| track.report);
        reports.fold(ZeroReport::default(), |sum, report| ZeroReport {
            retaken: sum.retaken + report.retaken,
            replaced: sum.replaced + report.replaced,
        })
    }
}

impl Stage for ZeroTracker {
    /// The frame less the zeros. Frames without times, or whose time goes back, count as the usual step, or a tenth of a
    /// second where none is known.
    fn apply<'f>(&'f mut self, frame: &'f Frame) -> &'f Frame {
        let tick = self.clock.see(frame.time);
        let interval = self.clock.elapsed(tick);
        self.out.time = frame.time;
        for (channel, track) in self.tracks.iter_mut().enumerate() {
            let read = |patch: PatchId| &frame.values[patch][channel];
            let Some(track) = track else {
                for patch in frame.values.ids() {
                    self.out.values[patch][channel].as_mut_slice().copy_from_slice(read(patch).as_slice());
                }
                continue;
            };
            track.see(frame.values.ids().flat_map(|patch| read(patch).iter().copied()), interval);
            track.follow(&self.neighbours, interval);
            let mut excess = track.excess.as_slice();
            for patch in frame.values.ids() {
                let out: &mut IdVec<VertexId, f64> = &mut self.out.values[patch][channel];
                let (own, others) = excess.split_at(out.len());
                out.as_mut_slice().copy_from_slice(own);
                excess = others;
            }
        }
        &self.out
    }
}
