//! Events of several contacts: pats, which are taps one after the other, and grasps, which are contacts at once.

use glam::DVec3;

use crate::signal::clock::SAME_S;
use crate::signal::events::bridges::Bridges;
use crate::signal::events::contact::Followed;
use crate::signal::events::{Event, EventContact, EventOptions, Phase, Word};
use crate::skin::LinkId;

/// Taps near each other, one after the other.
#[derive(Debug, Clone)]
struct Series {
    begin: f64,
    end: f64,
    centre: DVec3,
    contacts: Vec<u64>,
    last: EventContact,
}

/// A grasp of a link, or what may become one.
#[derive(Debug, Clone)]
struct Grasp {
    link: LinkId,
    since: f64,
    /// The last frame with its contacts at once, and for how long they were so, in s.
    last: f64,
    held: f64,
    is_reported: bool,
    contacts: Vec<u64>,
    force_peak: f64,
    force_sum: f64,
    impulse: f64,
    frames: f64,
    contact: EventContact,
}

/// Finds pats and grasps.
#[derive(Debug, Clone, Default)]
pub(super) struct Groups {
    series: Vec<Series>,
    grasps: Vec<Grasp>,
    /// Of the last frame.
    time: f64,
}

impl Groups {
    /// Takes a tap that has ended.
    pub(super) fn tap(&mut self, tap: &Event, options: &EventOptions, events: &mut Vec<Event>) {
        let Some(contact) = &tap.contact else { return };
        let centre = contact.to.point;
        let is_next = |series: &&mut Series| {
            series.last.link == contact.link
                && tap.begin - series.end < options.pat_s - SAME_S
                && series.centre.distance(centre) <= options.pat_m
        };
        let end = tap.begin + tap.duration;
        let Some(series) = self.series.iter_mut().find(is_next) else {
            let (contacts, last) = (tap.contacts.clone(), contact.clone());
            self.series.push(Series { begin: tap.begin, end, centre, contacts, last });
            return;
        };
        series.contacts.extend_from_slice(&tap.contacts);
        (series.end, series.centre, series.last) = (end, centre, contact.clone());
        if series.contacts.len() == options.pat_taps {
            events.push(series.event(Phase::Begin, tap.time));
        }
    }

    /// Ends the pats that no tap can continue: those of contacts that go on may.
    pub(super) fn end_pats<'f, C: Iterator<Item = &'f Followed>>(
        &mut self,
        time: f64,
        going_on: impl Fn() -> C,
        options: &EventOptions,
        events: &mut Vec<Event>,
    ) {
        self.series.retain(|series| {
            let may_continue = |contact: &Followed| {
                contact.link == series.last.link
                    && contact.onset - series.end < options.pat_s - SAME_S
                    && contact.last - contact.onset < options.tap_s - SAME_S
                    && contact.centre.distance(series.centre) <= options.pat_m
            };
            let goes_on = time - series.end < options.pat_s - SAME_S || going_on().any(may_continue);
            if !goes_on && series.contacts.len() >= options.pat_taps {
                events.push(series.event(Phase::End, time));
            }
            goes_on
        });
    }

    /// Takes the contacts of a frame, in the order of their numbers.
    pub(super) fn grasp(
        &mut self,
        time: f64,
        open: &mut [Followed],
        (options, bridges): (&EventOptions, &Bridges),
        events: &mut Vec<Event>,
    ) {
        for k in 0..open.len() {
            let first = &open[k];
            let is_first = open[..k].iter().all(|other| other.link != first.link);
            let of_link = || open.iter().filter(|contact| contact.link == first.link);
            let limit = options.grasp_rad.cos();
            let is_grasp = || of_link().any(|a| of_link().any(|b| a.normal.dot(b.normal) < limit));
            if !is_first || !is_grasp() {
                continue;
            }
            let place = self.grasps.iter().position(|grasp| grasp.link == first.link);
            let place = place.unwrap_or_else(|| {
                self.grasps.push(Grasp::new(time, &mut open[k], (options, bridges)));
                self.grasps.len() - 1
            });
            self.grasps[place].add(time, self.time, open, (options, bridges));
        }
        self.time = time;
        self.grasps.sort_by_key(|grasp| grasp.link);
        self.grasps.retain_mut(|grasp| {
            // One of its contacts may be continued.
            let goes_on = time - grasp.last <= options.join_s + SAME_S;
            if !grasp.is_reported && grasp.held >= options.grasp_s - SAME_S {
                grasp.is_reported = true;
                events.push(grasp.event(Phase::Begin, time));
            } else if !goes_on && grasp.is_reported {
                events.push(grasp.event(Phase::End, time));
            }
            goes_on
        });
    }

    /// Ends all.
    pub(super) fn finish(&mut self, time: f64, options: &EventOptions, events: &mut Vec<Event>) {
        self.end_pats(f64::INFINITY, std::iter::empty, options, events);
        events.iter_mut().filter(|event| event.time == f64::INFINITY).for_each(|event| event.time = time);
        for grasp in self.grasps.drain(..).filter(|grasp| grasp.is_reported) {
            events.push(grasp.event(Phase::End, time));
        }
    }
}

impl Series {
    fn event(&self, phase: Phase, time: f64) -> Event {
        Event {
            word: Word::Pat,
            phase,
            contacts: self.contacts.clone(),
            time,
            begin: self.begin,
            duration: self.end - self.begin,
            contact: Some(self.last.clone()),
        }
    }
}

impl Grasp {
    fn new(time: f64, first: &mut Followed, (options, bridges): (&EventOptions, &Bridges)) -> Self {
        Self {
            link: first.link,
            since: time,
            last: time,
            held: 0.0,
            is_reported: false,
            contacts: Vec::new(),
            force_peak: f64::NAN,
            force_sum: 0.0,
            impulse: 0.0,
            frames: 0.0,
            contact: first.contact(Word::Grasp, options, bridges),
        }
    }

    /// Takes those of these contacts that are on its link, and the time of the frame before.
    fn add(
        &mut self,
        time: f64,
        before: f64,
        open: &mut [Followed],
        (options, bridges): (&EventOptions, &Bridges),
    ) {
        let link = self.link;
        let of_link = || open.iter().filter(|contact| contact.link == link);
        let force: f64 = of_link().map(|contact| contact.force).sum();
        for contact in of_link() {
            if let Err(place) = self.contacts.binary_search(&contact.number) {
                self.contacts.insert(place, contact.number);
            }
        }
        if self.last == before {
            self.impulse += (time - self.last) * force;
            self.held += time - self.last;
        }
        self.force_peak = self.force_peak.max(force);
        self.force_sum += force;
        self.frames += 1.0;
        self.last = time;
        if !self.is_reported && self.held >= options.grasp_s - SAME_S {
            let of_link = open.iter_mut().filter(|contact| contact.link == link);
            let strongest = of_link.reduce(|a, b| if b.force > a.force { b } else { a });
            if let Some(strongest) = strongest {
                self.contact = strongest.contact(Word::Grasp, options, bridges);
            }
        }
    }

    fn event(&self, phase: Phase, time: f64) -> Event {
        Event {
            word: Word::Grasp,
            phase,
            contacts: self.contacts.clone(),
            time,
            begin: self.since,
            duration: self.last - self.since,
            contact: Some(EventContact {
                force_peak: self.force_peak,
                force_mean: self.force_sum / self.frames,
                impulse: self.impulse,
                ..self.contact.clone()
            }),
        }
    }
}
