//! The events of a recording, as a page marks them on its time line; of a live page as they end.

use serde::Serialize;

use crate::map::SkinMap;
use crate::recording::Step;
use crate::signal::{Event, EventDetector, EventOptions, EventPlace, Phase, SignalError, Word};

/// Finds the events of the frames of a page.
#[derive(Debug)]
pub(super) struct EventRecorder {
    /// `None` from the first frame without a time on: events are dated.
    detector: Option<EventDetector>,
    rows: Vec<EventRow>,
}

/// An event that has ended, in m, s and N.
#[derive(Debug, Serialize)]
pub(super) struct EndedEvent {
    word: &'static str,
    /// Numbers of its contacts.
    contacts: Vec<u64>,
    begin: f64,
    duration: f64,
    /// `None` of a gap.
    contact: Option<ContactRow>,
}

/// The same, with the frames at its begin and end.
#[derive(Debug, Serialize)]
pub(super) struct EventRow {
    #[serde(flatten)]
    event: EndedEvent,
    first: usize,
    last: usize,
}

#[derive(Debug, Serialize)]
struct ContactRow {
    patch: usize,
    from: [f64; 2],
    to: [f64; 2],
    /// Largest and mean force and impulse, where the unit of the channel gives forces.
    force: Option<[f64; 3]>,
    area: f64,
    length: f64,
    direction: Option<f64>,
    taxels: usize,
    peak: u32,
}

impl EventRecorder {
    pub(super) fn new(map: &SkinMap) -> Result<Self, SignalError> {
        Ok(Self { detector: Some(EventDetector::new(map, EventOptions::default())?), rows: Vec::new() })
    }

    /// Takes the frame whose time is the last of `times`.
    pub(super) fn record(&mut self, step: &Step<'_>, times: &[f64]) -> Result<(), SignalError> {
        if !step.frame.time.is_finite() {
            self.rows.clear();
        }
        let known = self.see(step)?.iter();
        let rows: Vec<_> = known.filter(is_ended).map(|event| row(event, times)).collect();
        self.rows.extend(rows);
        Ok(())
    }

    /// Takes a frame; the events that have ended by then, as JSON.
    pub(super) fn ended(&mut self, step: &Step<'_>) -> Result<Vec<String>, SignalError> {
        Ok(as_json(self.see(step)?))
    }

    /// Those that end with the last frame, as JSON.
    pub(super) fn last(&mut self) -> Vec<String> {
        as_json(self.detector.as_mut().map_or(&[], EventDetector::finish))
    }

    fn see(&mut self, step: &Step<'_>) -> Result<&[Event], SignalError> {
        if !step.frame.time.is_finite() {
            self.detector = None;
        }
        match (&mut self.detector, step.tracker) {
            (Some(detector), Some(tracker)) => detector.see(step.frame.time, tracker),
            _ => Ok(&[]),
        }
    }

    /// The events in the order of their begins.
    pub(super) fn finish(mut self, times: &[f64]) -> Vec<EventRow> {
        if let Some(detector) = &mut self.detector {
            self.rows.extend(detector.finish().iter().filter(is_ended).map(|event| row(event, times)));
        }
        self.rows.sort_by(|a, b| a.first.cmp(&b.first).then(a.event.begin.total_cmp(&b.event.begin)));
        self.rows
    }
}

fn is_ended(event: &&Event) -> bool {
    event.phase == Phase::End
}

fn as_json(events: &[Event]) -> Vec<String> {
    let text = |event: &Event| serde_json::to_string(&ended(event)).expect("numbers and texts are JSON");
    events.iter().filter(is_ended).map(text).collect()
}

fn row(event: &Event, times: &[f64]) -> EventRow {
    let [first, last] = frames(event, times);
    EventRow { event: ended(event), first, last }
}

fn ended(event: &Event) -> EndedEvent {
    let at = |place: EventPlace| place.map.to_array();
    let contact = event.contact.as_ref().map(|contact| ContactRow {
        patch: contact.patch.index(),
        from: at(contact.from),
        to: at(contact.to),
        force: contact.force_peak.is_finite().then_some([
            contact.force_peak,
            contact.force_mean,
            contact.impulse,
        ]),
        area: contact.area,
        length: contact.length,
        direction: contact.direction,
        taxels: contact.taxels.len() + contact.beyond.len(),
        peak: contact.peak_taxel.raw(),
    });
    let (begin, duration, contacts) = (event.begin, event.duration, event.contacts.clone());
    EndedEvent { word: event.word.into(), contacts, begin, duration, contact }
}

/// The frames at the begin and the end of an event: those before it was known, back to where times jump.
fn frames(event: &Event, times: &[f64]) -> [usize; 2] {
    let known = times.iter().rposition(|&time| time == event.time).unwrap_or_default();
    if event.word == Word::Gap {
        return [known.saturating_sub(1), known];
    }
    let back_to = |from: usize, time: f64| {
        let mut at = from;
        while at > 0 && times[at] > time && times[at - 1] <= times[at] {
            at -= 1;
        }
        at
    };
    let last = back_to(known, event.begin + event.duration);
    [back_to(last, event.begin), last]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(word: Word, time: f64, begin: f64, duration: f64) -> Event {
        Event { word, phase: Phase::End, contacts: vec![0], time, begin, duration, contact: None }
    }

    #[test]
    fn an_event_has_the_frames_of_its_begin_and_end() {
        let times = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5];
        assert_eq!(frames(&event(Word::Tap, 0.5, 0.12, 0.2), &times), [1, 3]);
        assert_eq!(frames(&event(Word::Tap, 0.5, -1.0, 0.5), &times), [0, 0]);
    }

    #[test]
    fn frames_before_a_jump_of_times_belong_to_no_event_after_it() {
        let times = [5.0, 5.1, 0.0, 0.1, 0.2];
        assert_eq!(frames(&event(Word::Tap, 0.2, -0.02, 0.1), &times), [2, 2]);
        assert_eq!(frames(&event(Word::Tap, 5.1, 5.0, 0.1), &times), [0, 1]);
        assert_eq!(frames(&event(Word::Gap, 0.0, 0.0, 0.0), &times), [1, 2]);
    }
}
