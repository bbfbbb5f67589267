//! [`ContactTracker`]: finds, measures and tracks the regions of each frame.

use crate::body::BodyTaxel;
use crate::id::{IdVec, VertexId};
use crate::map::{PatchMap, SkinMap};
use crate::mesh::{VertexCorners, neighbours};
use crate::numeric::{Csr, storable};
use crate::pyramid::LevelId;
use crate::signal::clock::{FRAMES_AHEAD, visit_count};
use crate::signal::contacts::ContactRegion;
use crate::signal::contacts::at_once::AtOnce;
use crate::signal::contacts::find::Finder;
use crate::signal::contacts::fingers::{Fingers, HIGH, Limits};
use crate::signal::contacts::join::join_near;
use crate::signal::contacts::joined::Joined;
use crate::signal::contacts::noise::Threshold;
use crate::signal::contacts::place::Pressed;
use crate::signal::contacts::split::TaxelReadings;
use crate::signal::contacts::tracks::Tracks;
use crate::signal::{
    Channel, Clock, ContactEvent, Frame, Probe, Quantity, Rest, SignalError, Stage, Tick, TrackerOptions,
};
use crate::skin::PatchId;

/// Where the threshold is estimated, a contact is seen at once from this many times the limit of noise on, else in its second
/// frame: electronics have spikes that neighbours share, to 1.4 times the limit in recordings of an untouched cover, half of which
/// had a contact of one frame. A touch of a finger is over three times the limit.
const SURE: f64 = 2.0;

/// Finds contacts in frames of readings and tracks them from frame to frame.
///
/// It owns its buffers: it allocates only when a frame has more contacts, or a larger one, than all earlier
/// frames; with [`Probe::Finger`] also where a contact has taxels that had none before.
///
/// ```
/// use dermatome::{
///     id::VertexId,
///     map::SkinMap,
///     mesh::shapes,
///     signal::{Channel, ContactEvent, ContactTracker, Frame, TrackerOptions},
///     skin::PatchId,
/// };
///
/// let map = SkinMap::flat(shapes::lattice(30, 20, 0.004), 1e-3);
/// let options = TrackerOptions { threshold: Some(100.0), ..TrackerOptions::default() };
/// let mut tracker = ContactTracker::new(&map, &Channel::new("pressure", "Pa")?, &options)?;
/// let mut frame = Frame::new(&map, 1);
/// let pressure = &mut frame.values[PatchId::new(0)][0];
/// for taxel in [310, 311] {
///     pressure[VertexId::new(taxel)] = 2000.0;
/// }
/// let regions = tracker.track(&frame);
/// assert_eq!(regions.len(), 1);
/// assert_eq!((regions[0].event, regions[0].taxels.len()), (ContactEvent::Onset, 2));
/// # Ok::<(), dermatome::signal::SignalError>(())
/// ```
#[derive(Debug, Clone)]
pub struct ContactTracker {
    /// The patches with level 0 alone.
    patches: IdVec<PatchId, PatchMap>,
    /// The faces around each taxel.
    around: IdVec<PatchId, VertexCorners>,
    quantity: Quantity,
    /// Newtons in a unit of force of the channel.
    newtons: f64,
    options: TrackerOptions,
    noise: Threshold,
    /// All patches as one graph.
    joined: Joined,
    /// The taxels next to each one, patch after patch.
    neighbours: Csr<u32>,
    /// The readings that regions are found in, patch after patch: `values`, or those of fingers, smoothed.
    all: IdVec<VertexId, f64>,
    /// Whether taxels next to each other moved together while it was estimated.
    is_moving: bool,
    /// The readings of untouched taxels, and the readings of this frame above them.
    rest: IdVec<PatchId, IdVec<VertexId, f64>>,
    values: IdVec<PatchId, IdVec<VertexId, f64>>,
    finder: Finder,
    /// With [`Probe::Finger`].
    fingers: Option<Fingers>,
    at_once: AtOnce,
    clock: Clock,
    /// Frames that were learned from.
    ahead: usize,
    /// What the time of the last frame said.
    tick: Tick,
    tracks: Tracks,
    /// The regions of the last frame that may go on, and those that end because times jump.
    last: Vec<ContactRegion>,
    ended: Vec<ContactRegion>,
    /// The regions of this frame: first `shown` reported ones, with the released ones last, then those that
    /// have not lasted long enough.
    found: Vec<ContactRegion>,
    shown: usize,
    /// Number of the next contact.
    next: u64,
    /// The threshold by now.
    high: Option<f64>,
    /// Frames with several taxels far below the rest that was learned, or one that stays there; and for how many frames each
    /// taxel has been there.
    below: usize,
    below_for: IdVec<PatchId, IdVec<VertexId, u32>>,
}

/// Taxels far below rest, from which on something touched the skin while it was learned, or frames in a row of one taxel: on a
/// coarse skin a touch may load no more. *Heuristic*: spikes come alone, and last a frame or two.
const BELOW: usize = 3;
const BELOW_FRAMES: u32 = 10;

impl ContactTracker {
    /// A tracker for frames of this map, which uses this channel.
    ///
    /// # Errors
    /// [`SignalError::Option`], or [`SignalError::NoTouch`] for a threshold or fingers in a channel that does not measure
    /// touches.
    pub fn new(map: &SkinMap, channel: &Channel, options: &TrackerOptions) -> Result<Self, SignalError> {
        options.validate(map.patches.iter().map(|patch| patch.taxels.ids.len()).sum())?;
        let is_of_touch = options.probe == Probe::Finger || options.threshold.is_some();
        if is_of_touch && !channel.kind.is_of_touch() {
            return Err(SignalError::NoTouch { known: vec![channel.name.clone()] });
        }
        let joined = Joined::new(map);
        let fingers = (options.probe == Probe::Finger).then(|| Fingers::new(map, &joined, channel, options));
        let around = map.patches.map(|patch| {
            let mesh = &patch.levels[LevelId::new(0)].level.mesh;
            VertexCorners::new(mesh.triangles.iter().copied(), mesh.positions.len())
        });
        let zeros = map.patches.map(|patch| IdVec::filled(0.0, patch.taxels.ids.len()));
        Ok(Self {
            patches: map.patches.map(with_level_0),
            around,
            quantity: channel.quantity,
            newtons: channel.newtons().unwrap_or(f64::NAN),
            options: TrackerOptions { lasting: options.lasting.max(1), ..*options },
            noise: Threshold::new(options),
            neighbours: neighbours(map.patches.iter().map(|patch| &patch.levels[LevelId::new(0)].level.mesh)),
            all: IdVec::filled(0.0, joined.mesh.positions.len()),
            is_moving: false,
            rest: zeros.clone(),
            below_for: zeros.map(|patch| IdVec::filled(0, patch.len())),
            values: zeros,
            finder: Finder::new(joined.mesh.positions.len()),
            joined,
            fingers,
            at_once: AtOnce::new(map),
            clock: Clock::new(),
            ahead: 0,
            tick: Tick::First,
            tracks: Tracks::default(),
            last: Vec::new(),
            ended: Vec::new(),
            found: Vec::new(),
            shown: 0,
            next: 0,
            high: options.threshold,
            below: 0,
        })
    }

    /// The threshold in the unit of the channel, given or estimated; `None` while it is not known. That of fingers
    /// follows the noise, unless it is given.
    pub fn threshold(&self) -> Option<f64> {
        self.high
    }

    /// Whether taxels next to each other moved together in the frames from which zero and noise were taken.
    pub fn was_moving(&self) -> bool {
        self.is_moving
    }

    /// Frames in which three taxels or more are as far below the rest that was learned as contacts are above it, or one has
    /// been for ten frames.
    pub fn frames_below(&self) -> usize {
        self.below
    }

    /// Keeps a frame from which zero and noise are learned; true once there are enough of them.
    #[doc(hidden)]
    pub fn learn_from(&mut self, frame: &Frame) -> bool {
        self.clock.learn(frame.time);
        self.ahead += 1;
        self.noise.learn(frame, &self.options, self.neighbours.len()) && self.ahead >= FRAMES_AHEAD
    }

    /// How many contacts the strongest touch so far had at once. A touch is what happens on a link until nothing
    /// touches it for 0.15 s; its frames vote for their number of contacts with the sum of their twelve largest readings in
    /// contact, if that is at least 0.7 of the largest. 0 if no touch lasted two frames.
    pub fn at_once(&self) -> usize {
        self.at_once.strongest()
    }

    /// The contacts of the next frame, by patch and first taxel, then those that have ended. All end where times go back
    /// or frames are missing. If the threshold
    /// is estimated and the tracker has not [learned](Stage::learn) yet, it learns from the first frames,
    /// which have no contacts.
    ///
    /// # Panics
    /// If the frame does not have the patches, the channel and the taxels that the tracker was made for.
    pub fn track(&mut self, frame: &Frame) -> &[ContactRegion] {
        assert_eq!(frame.values.len(), self.patches.len(), "one entry per patch");
        self.tick = self.clock.see(frame.time);
        let elapsed = self.clock.elapsed(self.tick);
        self.keep_last();
        self.high = self.noise.known();
        if let Some(fingers) = &mut self.fingers {
            let time = (self.tick, elapsed);
            self.high = fingers.see(frame, time, self.options.channel, self.high);
        }
        if let Some(high) = self.high {
            self.find(frame, high);
            self.finder.make_room(&mut self.found, &mut self.last);
        } else if self.noise.learn(frame, &self.options, self.neighbours.len()) {
            self.settle_noise();
        }
        self.finder.number(&self.found, &self.joined);
        let reach = self.options.reach;
        self.tracks.join(&self.last, &mut self.found, (&self.finder, &self.joined), reach);
        self.finder.clear();
        let is_learned = self.options.threshold.is_none() && self.fingers.is_none();
        for (k, region) in self.found.iter_mut().enumerate() {
            let sure = SURE * self.high.unwrap_or_default();
            let is_sure = || {
                let sum: f64 = region.all_taxels().map(|at| self.values[at.patch][at.taxel]).sum();
                let count = region.taxels.len() + region.beyond.len();
                region.peak > sure || sum > sure * (count as f64).sqrt()
            };
            if is_learned && self.tracks.is_new(k) && !is_sure() {
                continue;
            }
            region.age += 1;
            if region.age == self.options.lasting {
                (region.track, self.next) = (self.next, self.next + 1);
            } else if region.age > self.options.lasting {
                region.event = ContactEvent::Move;
            }
        }
        for (mut region, goes_on) in self.last.drain(..).zip(self.tracks.goes_on()) {
            if *goes_on || region.age < self.options.lasting {
                self.finder.recycle(region);
            } else {
                region.event = ContactEvent::Release;
                self.found.push(region);
            }
        }
        self.found.append(&mut self.ended);
        let lasting = self.options.lasting;
        let rank = |region: &ContactRegion| match region.event {
            _ if region.age < lasting => 2,
            ContactEvent::Release => 1,
            ContactEvent::Onset | ContactEvent::Move => 0,
        };
        self.found.sort_unstable_by_key(|region| (rank(region), region.place()));
        self.shown = self.found.partition_point(|region| rank(region) < 2);
        let (fingers, values) = (&self.fingers, &self.values);
        let values = |patch| fingers.as_ref().map_or(&values[patch], |fingers| fingers.smooth(patch));
        self.at_once.see(self.tick, elapsed, &self.found[..self.shown], values);
        &self.found[..self.shown]
    }

    /// The contacts of the last frame, as returned by [`Self::track`].
    pub fn contacts(&self) -> &[ContactRegion] {
        &self.found[..self.shown]
    }

    /// What the time of the last frame said.
    #[doc(hidden)]
    pub fn tick(&self) -> Tick {
        self.tick
    }

    /// The readings of the last frame above those at rest: what contacts are measured from.
    pub(in crate::signal) fn values(&self) -> &IdVec<PatchId, IdVec<VertexId, f64>> {
        &self.values
    }

    fn settle_noise(&mut self) {
        self.is_moving = self.noise.settle(&mut self.rest, &self.options, &self.neighbours);
        self.high = self.noise.known();
    }

    /// Stores the found regions as those of the last frame, from which none goes on where times jump.
    fn keep_last(&mut self) {
        for mut region in self.found.drain(..) {
            let is_cut = self.tick.is_cut();
            if region.event == ContactEvent::Release || (is_cut && region.age < self.options.lasting) {
                self.finder.recycle(region);
            } else if is_cut {
                region.event = ContactEvent::Release;
                self.ended.push(region);
            } else {
                self.last.push(region);
            }
        }
    }

    /// Finds and measures the regions of a frame, by patch and first taxel.
    fn find(&mut self, frame: &Frame, high: f64) {
        // Smaller readings have no digits left for the centre of pressure.
        let high = high.max(f64::from(f32::MIN_POSITIVE));
        let Self {
            patches, around, options, rest, values, finder, found, fingers, last, joined, all, ..
        } = self;
        finder.follow(last, joined);
        // Fingers split regions themselves, and the parts of a foot are one.
        let prominence = if options.probe == Probe::Any { options.prominence } else { 1.0 };
        let options = &TrackerOptions { prominence, ..*options };
        for (id, patch) in patches.enumerate() {
            let (mesh, read) =
                (&patch.levels[LevelId::new(0)].level.mesh, &frame.values[id][options.channel]);
            assert_eq!(read.len(), mesh.positions.len(), "one reading per taxel of {}", patch.name);
            match fingers {
                Some(fingers) => values[id].as_mut_slice().copy_from_slice(fingers.excess(id).as_slice()),
                None => {
                    let beyond = read.iter().zip(&rest[id]).map(|(x, rest)| storable(x - rest));
                    values[id].iter_mut().zip(beyond).for_each(|(value, x)| *value = x);
                }
            }
            let values = fingers.as_ref().map_or(&values[id], |fingers| fingers.smooth(id));
            let start = joined.start(id);
            all.as_mut_slice()[start..start + values.len()].copy_from_slice(values.as_slice());
        }
        let is_estimated = fingers.is_none() && options.threshold.is_none();
        let least_seed = if is_estimated { options.low * high } else { high };
        finder.find(&TaxelReadings { joined, values: all, options, high, least_seed }, found);
        if options.probe == Probe::Foot {
            join_near(joined, found, finder);
        }
        if options.rest == Rest::Learned && options.threshold.is_none() && fingers.is_none() {
            let (mut now, mut longest) = (0, 0);
            let all = values
                .iter()
                .zip(self.below_for.iter_mut())
                .flat_map(|(values, frames)| values.iter().zip(frames.iter_mut()));
            for (x, frames) in all {
                let is_below = *x < -high;
                *frames = if is_below { *frames + 1 } else { 0 };
                (now, longest) = (now + usize::from(is_below), longest.max(*frames));
            }
            self.below += usize::from(now >= BELOW || longest >= BELOW_FRAMES);
        }
        if let Some(fingers) = fingers {
            let sigma = high / HIGH;
            let limits = Limits { patches, joined, smooth: all, low: options.low * high, sigma };
            fingers.split(&limits, found, finder);
            // A taxel without a reading has none of a contact either.
            let has_reading = |taxel: VertexId| {
                let BodyTaxel { patch, taxel } = joined.taxel(taxel);
                values[patch][taxel].is_finite()
            };
            found.iter_mut().for_each(|region| region.taxels.retain(|&taxel| has_reading(taxel)));
            found.retain_mut(|region| !region.taxels.is_empty());
        }
        let quantity = self.quantity;
        for region in found.iter_mut() {
            if joined.has_links() {
                region.beyond = finder.take_beyond();
            }
            joined.divide(region, |taxel| {
                let BodyTaxel { patch, taxel: own } = joined.taxel(taxel);
                quantity.weight(patches[patch].taxels.areas[own]) * all[taxel]
            });
            let (patch, around) = (&patches[region.patch], &around[region.patch]);
            let start = joined.start(region.patch);
            let values = &all.as_slice()[start..start + patch.taxels.ids.len()];
            Pressed { patch, around, values, quantity, patches, joined, all }.measure(region);
            region.force *= self.newtons;
        }
        found.sort_unstable_by_key(ContactRegion::place);
    }
}

/// What a [`ContactTracker`] has learned and follows: another one of the same map, channel and options goes on with it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TrackerState {
    /// The threshold, if it is known.
    pub threshold: Option<f64>,
    /// The readings of all taxels in the frames from which it is being estimated, one frame after the other.
    pub learned: Vec<f64>,
    /// The reading of each taxel at rest, patch after patch.
    pub rest: Vec<f64>,
    /// The contacts of the last frame that go on, also those that have not lasted long enough to be reported.
    pub contacts: Vec<ContactRegion>,
    /// Number of the next contact.
    pub next: u64,
    /// What else it remembers: steps of times, votes for the number of contacts, readings far below rest.
    pub memory: Vec<f64>,
}

impl ContactTracker {
    /// What it remembers besides threshold, rest and contacts, number by number, to be read or set.
    fn visit(&mut self, visit: &mut dyn FnMut(&mut f64)) {
        self.clock.visit(visit);
        self.at_once.visit(visit);
        visit_count(&mut self.ahead, visit);
        visit_count(&mut self.below, visit);
        let mut is_moving = usize::from(self.is_moving);
        visit_count(&mut is_moving, visit);
        self.is_moving = is_moving > 0;
        for frames in self.below_for.iter_mut().flat_map(|patch| patch.iter_mut()) {
            let mut count = *frames as usize;
            visit_count(&mut count, visit);
            *frames = u32::try_from(count).unwrap_or(u32::MAX / 2);
        }
    }

    /// What it has learned and follows.
    pub fn state(&self) -> TrackerState {
        let goes_on = |region: &&ContactRegion| region.event != ContactEvent::Release;
        let mut memory = Vec::new();
        self.clone().visit(&mut |number| memory.push(*number));
        TrackerState {
            threshold: self.noise.known(),
            learned: self.noise.kept().to_vec(),
            rest: self.rest.iter().flat_map(|patch| patch.iter().copied()).collect(),
            contacts: self.found.iter().filter(goes_on).cloned().collect(),
            next: self.next,
            memory,
        }
    }

    /// Goes on with what another tracker has learned and followed.
    ///
    /// # Errors
    /// [`SignalError::Option`] if it is not of a tracker of the same map, or this one is of fingers, whose zeros and
    /// smoothed readings a state does not have.
    pub fn resume(&mut self, state: TrackerState) -> Result<(), SignalError> {
        if self.fingers.is_some() {
            let needed = "0, that is a probe other than fingers,";
            return Err(SignalError::option("the number of contact states with fingers", 1.0, needed));
        }
        let mut numbers = 0;
        self.visit(&mut |_| numbers += 1);
        let taxels: usize = self.rest.iter().map(|patch| patch.len()).sum();
        let is_known = |region: &ContactRegion| {
            let patch = self.patches.get(region.patch);
            let count = patch.map_or(0, |patch| patch.taxels.ids.len());
            let known = |taxel: &VertexId| taxel.index() < count;
            let is_beyond = |at: &BodyTaxel| {
                self.patches.get(at.patch).is_some_and(|patch| at.taxel.index() < patch.taxels.ids.len())
            };
            region.beyond.iter().all(is_beyond)
                && patch.is_some_and(|patch| patch.link == region.link)
                && region.taxels.iter().chain([&region.peak_taxel]).all(known)
                && !region.taxels.is_empty()
        };
        let fits = state.rest.len() == taxels
            && state.memory.len() == numbers
            && state.learned.len().is_multiple_of(taxels.max(1))
            && state.contacts.iter().all(is_known);
        if !fits {
            let needed = "those of the map of this tracker,";
            return Err(SignalError::option(
                "the taxels of a state of contacts",
                state.rest.len() as f64,
                needed,
            ));
        }
        let mut rest = state.rest.into_iter();
        self.rest.iter_mut().flat_map(|patch| patch.iter_mut()).zip(&mut rest).for_each(|(to, x)| *to = x);
        let mut memory = state.memory.into_iter();
        self.visit(&mut |number| *number = memory.next().unwrap_or(*number));
        self.noise.resume(state.threshold, state.learned);
        self.high = self.noise.known();
        self.shown = state.contacts.iter().filter(|region| region.age >= self.options.lasting).count();
        (self.found, self.next) = (state.contacts, state.next);
        Ok(())
    }
}

impl Stage for ContactTracker {
    /// The frames from which the threshold is estimated, or the usual step of times is known.
    fn frames_to_learn(&self) -> usize {
        if self.options.threshold.is_some() { FRAMES_AHEAD } else { self.options.noise_frames }
    }

    fn learn(&mut self, frame: &Frame) {
        self.learn_from(frame);
    }

    fn settle(&mut self) {
        self.clock.settle();
        self.settle_noise();
    }

    /// The unchanged frame; see [`ContactTracker::contacts`].
    fn apply<'f>(&'f mut self, frame: &'f Frame) -> &'f Frame {
        self.track(frame);
        frame
    }
}

/// A patch without its coarse levels, which are not used.
fn with_level_0(patch: &PatchMap) -> PatchMap {
    PatchMap {
        name: patch.name.clone(),
        link: patch.link,
        filled: patch.filled,
        taxels: patch.taxels.clone(),
        levels: patch.levels.iter().take(1).cloned().collect(),
        atlas: None,
    }
}
