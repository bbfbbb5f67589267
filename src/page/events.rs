//! The events of a recording, as a page marks them on its time line.

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
pub(super) struct EventRow {
    word: &'static str,
    /// Numbers of its contacts.
    contacts: Vec<u64>,
    begin: f64,
    duration: f64,
    /// The frames at its begin and end.
    first: usize,
    last: usize,
    /// `None` of a gap.
    contact: Option<ContactRow>,
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
            self.detector = None;
            self.rows.clear();
        }
        if let (Some(detector), Some(tracker)) = (&mut self.detector, step.tracker) {
            let ended = detector.see(step.frame.time, tracker)?.iter().filter(|e| e.phase == Phase::End);
            self.rows.extend(ended.map(|event| row(event, times)));
        }
        Ok(())
    }

    /// The events in the order of their begins.
    pub(super) fn finish(mut self, times: &[f64]) -> Vec<EventRow> {
        if let Some(detector) = &mut self.detector {
            let ended = detector.finish().iter().filter(|e| e.phase == Phase::End);
            self.rows.extend(ended.map(|event| row(event, times)));
        }
        self.rows.sort_by(|a, b| a.first.cmp(&b.first).then(a.begin.total_cmp(&b.begin)));
        self.rows
    }
}

fn row(event: &Event, times: &[f64]) -> EventRow {
    let [first, last] = frames(event, times);
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
        taxels: contact.taxels.len(),
        peak: contact.peak_taxel.raw(),
    });
    let (begin, duration, contacts) = (event.begin, event.duration, event.contacts.clone());
    EventRow { word: event.word.into(), contacts, begin, duration, first, last, contact }
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
        assert_eq!(frames(&event(Word::Gap, 0.0, 5.1, -5.1), &times), [1, 2]);
    }
}
