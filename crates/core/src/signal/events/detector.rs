//! [`EventDetector`]: contacts of frames in, events out.

use crate::id::IdVec;
use crate::map::SkinMap;
use crate::mesh::edges;
use crate::pyramid::LevelId;
use crate::signal::events::bridges::Bridges;
use crate::signal::events::contact::{Followed, PatchLimits, Waiting};
use crate::signal::events::groups::Groups;
use crate::signal::events::history::History;
use crate::signal::events::{Event, EventOptions, Phase, Word};
use crate::signal::{Clock, ContactEvent, ContactRegion, ContactTracker, SignalError, Tick};
use crate::skin::PatchId;

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
    bridges: Bridges,
    limits: IdVec<PatchId, PatchLimits>,
    /// Of the last frame.
    time: Option<f64>,
    /// Of contacts from elsewhere; a tracker has its own.
    clock: Clock,
    /// Contacts of the last frame, in the order of their numbers.
    open: Vec<Followed>,
    /// Those that have ended, unless a new track continues them.
    waiting: Vec<Waiting>,
    next: u64,
    groups: Groups,
    history: History,
    events: Vec<Event>,
    /// Regions without a contact, contacts that they may continue, and their distance.
    pairs: Vec<(f64, usize, u64)>,
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
            bridges: Bridges::new(map),
            limits,
            time: None,
            clock: Clock::new(),
            open: Vec::new(),
            waiting: Vec::new(),
            next: 0,
            groups: Groups::default(),
            history: History::new(&map.patches.map(|patch| patch.taxels.ids.len())),
            events: Vec::new(),
            pairs: Vec::new(),
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
        self.start(time, tracker.tick())?;
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
        let tick = self.clock.see(time);
        self.start(time, tick)?;
        self.follow(time, regions);
        Ok(self.report(time))
    }

    /// Ends all contacts where times go back or frames are missing.
    fn start(&mut self, time: f64, tick: Tick) -> Result<(), SignalError> {
        if !time.is_finite() {
            return Err(SignalError::NoEventTime);
        }
        self.events.clear();
        if let Some(last) = self.time.replace(time).filter(|_| tick.is_cut()) {
            self.end_contacts(last, true);
            self.groups.finish(last, &self.options, &mut self.events);
            self.history.clear();
            // Where times go back nobody knows how long it was.
            let begin = last.min(time);
            let duration = time - begin;
            let (word, phase, contacts) = (Word::Gap, Phase::End, Vec::new());
            self.events.push(Event { word, phase, contacts, time, begin, duration, contact: None });
        }
        Ok(())
    }

    fn report(&mut self, time: f64) -> &[Event] {
        self.end_contacts(time, false);
        self.report_changes(time);
        self.groups.grasp(time, &mut self.open, (&self.options, &self.bridges), &mut self.events);
        let going_on = || self.open.iter().chain(self.waiting.iter().map(Waiting::contact));
        self.groups.end_pats(time, going_on, &self.options, &mut self.events);
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

    /// Finds the contact of each region: that of its track, one that it continues, or a new one.
    fn follow(&mut self, time: f64, regions: &[ContactRegion]) {
        let here = || regions.iter().filter(|region| region.event != ContactEvent::Release);
        let Self { open, waiting, options, bridges, limits, history, next, pairs, .. } = self;
        let gone = open.extract_if(.., |contact| {
            let region = here().find(|region| region.track == contact.track);
            // The history does not have this frame yet: it is that of the last frame of the contact.
            if region.is_none() || contact.is_risen(time) {
                contact.date_begin(history);
            }
            region.inspect(|region| contact.see(time, region, bridges)).is_none()
        });
        waiting.extend(gone.map(Waiting::new));
        let is_new = |region: &ContactRegion| open.iter().all(|contact| contact.track != region.track);
        pairs.clear();
        for (k, region) in here().enumerate().filter(|(_, region)| is_new(region)) {
            let near = waiting.iter().filter_map(|contact| contact.distance(time, region, options, bridges));
            pairs.extend(near.map(|(distance, number)| (distance, k, number)));
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        for &(_, k, number) in &*pairs {
            let region = here().nth(k).filter(|region| open.iter().all(|other| other.track != region.track));
            let place = waiting.iter().position(|contact| contact.contact().number == number);
            if let (Some(region), Some(place)) = (region, place) {
                open.push(waiting.remove(place).go_on(time, region, bridges));
            }
        }
        for region in here() {
            if open.iter().all(|contact| contact.track != region.track) {
                let possible = history.possible(region, time);
                let mut contact = Followed::new(*next, time, possible, region, limits[region.patch]);
                contact.see(time, region, bridges);
                *next += 1;
                open.push(contact);
            }
        }
        open.sort_unstable_by_key(|contact| contact.number);
    }

    /// Ends contacts that nothing can continue any more, or all.
    fn end_contacts(&mut self, time: f64, all: bool) {
        let Self { open, waiting, options, bridges, events, groups, history, .. } = self;
        if all {
            waiting.extend(open.drain(..).map(Waiting::new));
        }
        waiting.sort_unstable_by_key(|contact| contact.contact().number);
        waiting.retain_mut(|contact| {
            if !all && contact.may_go_on(time, options) {
                return true;
            }
            let contact = contact.end();
            if contact.is_lasting(options) {
                contact.close();
                contact.date_begin(history);
                contact.date_end(history);
                let word = contact.word_now(options, true);
                if contact.word.is_none() {
                    events.push(contact.event(Word::Touch, Phase::Begin, time, (options, bridges)));
                }
                let event = contact.event(word, Phase::End, time, (options, bridges));
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
        let Self { open, options, bridges, events, history, .. } = self;
        for contact in open {
            match contact.word {
                None if contact.is_lasting(options) => {
                    contact.date_begin(history);
                    contact.word = Some(Word::Touch);
                    events.push(contact.event(Word::Touch, Phase::Begin, time, (options, bridges)));
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
                        events.push(contact.event(word, Phase::Change, time, (options, bridges)));
                    }
                }
                _ => {}
            }
        }
    }
}
