//! [`EventDetector`]: contacts of frames in, events out.

use crate::id::IdVec;
use crate::map::SkinMap;
use crate::mesh::edges;
use crate::pyramid::LevelId;
use crate::signal::events::contact::{Followed, PatchLimits};
use crate::signal::events::groups::Groups;
use crate::signal::events::history::History;
use crate::signal::events::{Event, EventOptions, Phase, Word};
use crate::signal::{ContactEvent, ContactRegion, ContactTracker, SignalError};
use crate::skin::PatchId;

/// Frames that are this many mean intervals apart, and this long in s, have a gap between them.
const GAP_INTERVALS: f64 = 10.0;
const GAP_S: f64 = 0.5;

/// The mean interval is that of the latest frames: this many.
const INTERVAL_FRAMES: f64 = 50.0;

/// Finds events in the contacts of frames, which a [`ContactTracker`](crate::signal::ContactTracker) finds.
///
/// It allocates only when a contact begins, and for the events that it reports.
///
/// ```
/// use dermatome::{
///     map::SkinMap,
///     mesh::shapes,
///     signal::{ContactTracker, EventDetector, EventOptions, Phase, TouchOptions, TouchSimulation, TrackerOptions, Word},
///     skin::Skin,
/// };
///
/// let skin = Skin::from_mesh("palm", shapes::lattice(30, 30, 0.004));
/// let map = SkinMap::flat(skin.patches.iter().next().unwrap().mesh.clone(), 1e-3);
/// let touches = TouchOptions { presses: 1, roll: 0.0, ..TouchOptions::default() };
/// let mut simulation = TouchSimulation::new(&skin, &touches)?;
/// let mut tracker = ContactTracker::new(&map, simulation.channel(), &TrackerOptions::default())?;
/// let mut detector = EventDetector::new(&map, EventOptions::default())?;
/// let mut words = Vec::new();
/// while let Some((frame, _)) = simulation.next_frame() {
///     tracker.track(frame);
///     for event in detector.see(frame.time, &tracker)? {
///         words.push((event.word, event.phase));
///     }
/// }
/// words.extend(detector.finish().iter().map(|event| (event.word, event.phase)));
/// assert_eq!(words, [(Word::Touch, Phase::Begin), (Word::Press, Phase::End)]);
/// # Ok::<(), dermatome::signal::SignalError>(())
/// ```
#[derive(Debug, Clone)]
pub struct EventDetector {
    options: EventOptions,
    limits: IdVec<PatchId, PatchLimits>,
    time: Option<f64>,
    interval: f64,
    frames: f64,
    /// Contacts that go on or may be continued, in the order of their numbers.
    open: Vec<Followed>,
    next: u64,
    groups: Groups,
    history: History,
    events: Vec<Event>,
    /// Regions without a contact, contacts that they may continue, and their distance.
    pairs: Vec<(f64, usize, usize)>,
    is_taken: Vec<bool>,
}

impl EventDetector {
    /// A detector of events on a map.
    ///
    /// # Errors
    /// [`SignalError::Option`]: a limit is no number, or contradicts another.
    pub fn new(map: &SkinMap, options: EventOptions) -> Result<Self, SignalError> {
        options.validate()?;
        let limits = map.patches.map(|patch| {
            let mesh = &patch.levels[LevelId::new(0)].level.mesh;
            let edges = edges(mesh);
            let length = |[a, b]: &[crate::id::VertexId; 2]| mesh.positions[*a].distance(mesh.positions[*b]);
            let mean = edges.iter().map(length).sum::<f64>() / edges.len().max(1) as f64;
            let stroke = options.stroke_m.max(options.stroke_spacings * mean);
            PatchLimits { stroke, taxels: patch.taxels.ids.len() }
        });
        Ok(Self {
            options,
            limits,
            time: None,
            interval: 0.0,
            frames: 0.0,
            open: Vec::new(),
            next: 0,
            groups: Groups::default(),
            history: History::new(&map.patches.map(|patch| patch.taxels.ids.len())),
            events: Vec::new(),
            pairs: Vec::new(),
            is_taken: Vec::new(),
        })
    }

    /// The limits.
    pub fn options(&self) -> &EventOptions {
        &self.options
    }

    /// Takes the frame that a tracker of the same map has seen last; returns the events that are known with it.
    ///
    /// # Errors
    /// [`SignalError::NoEventTime`] if the frame has no time.
    pub fn see(&mut self, time: f64, tracker: &ContactTracker) -> Result<&[Event], SignalError> {
        self.start(time)?;
        self.follow(time, tracker.contacts());
        self.history.keep(time, tracker.values());
        Ok(self.report(time))
    }

    /// Takes the contacts of the next frame from elsewhere, whose begin and end are not dated back; returns the events
    /// that are known with them.
    ///
    /// # Errors
    /// [`SignalError::NoEventTime`] if the frame has no time.
    pub fn see_contacts(&mut self, time: f64, regions: &[ContactRegion]) -> Result<&[Event], SignalError> {
        self.start(time)?;
        self.follow(time, regions);
        Ok(self.report(time))
    }

    fn start(&mut self, time: f64) -> Result<(), SignalError> {
        if !time.is_finite() {
            return Err(SignalError::NoEventTime);
        }
        self.events.clear();
        self.check_gap(time);
        Ok(())
    }

    fn report(&mut self, time: f64) -> &[Event] {
        self.end_contacts(time, false);
        self.report_changes(time);
        self.groups.grasp(time, &mut self.open, &self.options, &mut self.events);
        self.groups.end_pats(time, &self.open, &self.options, &mut self.events);
        &self.events
    }

    /// Ends what goes on, after the last frame.
    pub fn finish(&mut self) -> &[Event] {
        self.events.clear();
        if let Some(time) = self.time {
            self.end_contacts(time, true);
            self.groups.finish(time, &self.options, &mut self.events);
        }
        &self.events
    }

    /// Ends all contacts where times jump back or frames are missing.
    fn check_gap(&mut self, time: f64) {
        let Some(last) = self.time.replace(time) else { return };
        let step = time - last;
        let is_gap = step < 0.0 || (self.frames > 0.0 && step > GAP_S.max(GAP_INTERVALS * self.interval));
        if is_gap {
            self.end_contacts(last, true);
            self.groups.finish(last, &self.options, &mut self.events);
            self.history.clear();
            let [begin, duration] = [last, step];
            let (word, phase, contacts) = (Word::Gap, Phase::End, Vec::new());
            self.events.push(Event { word, phase, contacts, time, begin, duration, contact: None });
        } else {
            self.frames = (self.frames + 1.0).min(INTERVAL_FRAMES);
            self.interval += (step - self.interval) / self.frames;
        }
    }

    /// Finds the contact of each region: that of its track, one that it continues, or a new one.
    fn follow(&mut self, time: f64, regions: &[ContactRegion]) {
        let is_there = |region: &&ContactRegion| region.event != ContactEvent::Release;
        let here = || regions.iter().filter(is_there);
        let history = &mut self.history;
        for contact in &mut self.open {
            let region = here().find(|region| Some(region.track) == contact.track);
            // The history does not have this frame yet: it is that of the last frame of the contact.
            if region.is_none() || contact.is_risen(time) {
                contact.date_begin(history);
            }
            match region {
                Some(region) => contact.see(time, region),
                None => contact.track = None,
            }
        }
        self.pairs.clear();
        let open = &self.open;
        let is_new = |region: &ContactRegion| open.iter().all(|contact| contact.track != Some(region.track));
        for (k, region) in here().enumerate().filter(|(_, region)| is_new(region)) {
            for (at, contact) in open.iter().enumerate().filter(|(_, contact)| contact.track.is_none()) {
                let distance = contact.centre.distance(region.centre);
                let is_soon = time - contact.last <= self.options.join_s + 1e-9;
                if contact.link == region.link && is_soon && distance <= self.options.join_m {
                    self.pairs.push((distance, k, at));
                }
            }
        }
        self.pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        self.is_taken.clear();
        self.is_taken.resize(here().count(), false);
        for &(_, k, at) in &self.pairs {
            if let Some(region) = here().nth(k).filter(|_| !self.is_taken[k])
                && self.open[at].track.is_none()
            {
                self.is_taken[k] = true;
                self.open[at].track = Some(region.track);
                self.open[at].see(time, region);
            }
        }
        for region in here() {
            if self.open.iter().all(|contact| contact.track != Some(region.track)) {
                let mut contact = Followed::new(self.next, time, region, self.limits[region.patch]);
                contact.see(time, region);
                self.next += 1;
                self.open.push(contact);
            }
        }
    }

    /// Ends contacts that nothing can continue any more, or all.
    fn end_contacts(&mut self, time: f64, all: bool) {
        let Self { open, options, events, groups, history, .. } = self;
        open.retain_mut(|contact| {
            if !all && (contact.track.is_some() || time - contact.last <= options.join_s + 1e-9) {
                return true;
            }
            if contact.is_lasting(options) {
                contact.close();
                contact.date_begin(history);
                contact.date_end(history);
                let word = contact.word_now(options, true);
                if contact.word.is_none() {
                    events.push(contact.event(Word::Touch, Phase::Begin, time, options));
                }
                let event = contact.event(word, Phase::End, time, options);
                events.push(event.clone());
                if word == Word::Tap {
                    groups.tap(&event, options, events);
                }
            }
            false
        });
    }

    /// Reports contacts that have begun, and those that are something else by now.
    fn report_changes(&mut self, time: f64) {
        let Self { open, options, events, history, .. } = self;
        for contact in open.iter_mut().filter(|contact| contact.track.is_some()) {
            match contact.word {
                None if contact.is_lasting(options) => {
                    contact.date_begin(history);
                    contact.word = Some(Word::Touch);
                    events.push(contact.event(Word::Touch, Phase::Begin, time, options));
                }
                Some(before) if contact.may_be_more_than(before, options) => {
                    if contact.may_be_hold(options) {
                        contact.date_begin(history);
                    }
                    let word = contact.word_now(options, false);
                    // A stroke that comes back stays one.
                    if word > before {
                        contact.date_begin(history);
                        contact.word = Some(word);
                        events.push(contact.event(word, Phase::Change, time, options));
                    }
                }
                _ => {}
            }
        }
    }
}
