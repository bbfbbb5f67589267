//! Laws of time, on an uneven skin: what must not matter for sums and events, and what gaps and times that go back change.

use std::fmt::Write as _;
use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

use dermatome::io::ReadingsReader;
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::recording::{Recording, RecordingOptions};
use dermatome::signal::{
    Channel, ConditionOptions, ContactTracker, Event, EventDetector, EventOptions, Frame, Group, Phase,
    Totals, TrackerOptions, Word, Zero,
};
use dermatome::skin::{Link, LinkId, Patch, PatchId, Presence, Skin};
use glam::{DAffine3, DVec3};

/// A sheet of 41 x 9 taxels on one link and one of 5 x 24 on another, with the same ids; one taxel is absent.
fn uneven() -> Arc<SkinMap> {
    let link = |name: &str| Link { name: name.into(), parent: None, pose: DAffine3::IDENTITY };
    let patch = |name: &str, link: usize, columns, rows| {
        Patch::from_mesh(name, LinkId::new(link), shapes::lattice(columns, rows, 0.005))
    };
    let mut skin = Skin {
        links: vec![link("hand"), link("arm")].into(),
        patches: vec![patch("wide", 0, 41, 9), patch("long", 1, 5, 24)].into(),
        ..Skin::default()
    };
    skin.patches[PatchId::new(0)].taxels.presence[200.into()] = Presence::Absent;
    Arc::new(SkinMap::of_taxels(&skin))
}

/// A press on the hand from 0.5 s on, a stroke along it from 2 s on, and one that is held on the arm from 2.5 s on.
fn readings(map: &SkinMap, time: f64) -> Vec<f64> {
    let mut all = Vec::new();
    let touches = |at: [f64; 2], [begin, end]: [f64; 2], x: DVec3| {
        let depth = 0.002 * ((time - begin) / 0.1).min((end - time) / 0.1).min(1.0);
        let around = (x.x - at[0]).powi(2) + (x.y - at[1]).powi(2);
        (depth - around / 0.04).max(0.0) * 2e7
    };
    for (id, patch) in map.patches.enumerate() {
        for x in patch.levels[0.into()].level.mesh.positions.iter() {
            all.push(if id == PatchId::new(0) {
                let along = 0.05 + 0.06 * (time - 2.0);
                touches([0.15, 0.02], [0.5, 1.4], *x) + touches([along, 0.02], [2.0, 3.2], *x)
            } else {
                touches([0.01, 0.06], [2.5, 5.0], *x)
            });
        }
    }
    all
}

/// A recording as CSV: the name of its times, each as it stands there, and the time at which readings are taken.
fn csv(map: &SkinMap, name: &str, frames: impl Iterator<Item = (String, f64)>) -> String {
    let mut text = name.to_owned();
    readings(map, 0.0).iter().for_each(|_| text += ",.pressure[Pa]");
    for (said, time) in frames {
        text += "\n";
        text += &said;
        readings(map, time).iter().for_each(|x| write!(text, ",{x}").unwrap());
    }
    text + "\n"
}

/// Every 30 ms, but for one frame.
fn times() -> Vec<f64> {
    (0..200).filter(|k| *k != 40).map(|k| 0.03 * f64::from(k)).collect()
}

struct Found {
    whole: Totals,
    contacts: usize,
    gaps: usize,
    events: Vec<Event>,
}

impl Found {
    /// Words with their begins since `start`, and durations, impulses, rounded: what must not matter does not change them.
    fn said(&self, start: f64) -> Vec<(Word, i64, i64, i64)> {
        #[expect(clippy::cast_possible_truncation, reason = "small numbers")]
        let round = |x: f64| (1e5 * x).round() as i64;
        let ended = self.events.iter().filter(|event| event.phase == Phase::End && event.word != Word::Gap);
        let said = ended.map(|event| {
            let impulse = event.contact.as_ref().map_or(0.0, |contact| contact.impulse);
            (event.word, round(event.begin - start), round(event.duration), round(impulse))
        });
        said.collect()
    }

    fn impulse(&self) -> f64 {
        self.whole.impulse.unwrap()
    }
}

fn run(map: &Arc<SkinMap>, text: &str) -> Found {
    let readings = ReadingsReader::stream(Path::new("-"), Cursor::new(text.to_owned())).unwrap();
    let mut recording = Recording::open(map, readings, &RecordingOptions::default()).unwrap();
    let options = TrackerOptions { threshold: Some(2000.0), ..TrackerOptions::default() };
    recording.summarise(&options).unwrap();
    let mut detector = EventDetector::new(map, EventOptions::default()).unwrap();
    let mut events = Vec::new();
    while let Some(step) = recording.next_step().unwrap() {
        events.extend_from_slice(detector.see(step.frame.time, step.tracker.unwrap()).unwrap());
    }
    events.extend_from_slice(detector.finish());
    assert!(events.iter().all(|event| event.duration >= 0.0 && event.begin <= event.time), "{events:?}");
    let summary = recording.summary().unwrap();
    let is_contact = |group: Group| matches!(group, Group::Contact(_));
    let whole = summary.totals().next().unwrap().1.clone();
    let contacts = summary.totals().filter(|(group, _)| is_contact(*group)).count();
    Found { whole, contacts, gaps: summary.gaps(), events }
}

fn in_seconds(map: &SkinMap, frames: impl Iterator<Item = (f64, f64)>) -> String {
    csv(map, "time", frames.map(|(said, time)| (format!("{said}"), time)))
}

/// Times from another moment on, in ms or as dates are the same times.
#[test]
fn the_form_of_times_does_not_matter() {
    let map = uneven();
    let plain = run(&map, &in_seconds(&map, times().into_iter().map(|t| (t, t))));
    assert_eq!((plain.gaps, plain.contacts), (0, 3));
    let words: Vec<Word> = plain.said(0.0).iter().map(|said| said.0).collect();
    assert_eq!(words, [Word::Press, Word::Stroke, Word::Hold]);
    let date = |t: f64| format!("2026-01-31T23:59:{:06.3}Z", 50.0 + t);
    let dates = csv(&map, "Time", times().into_iter().map(|t| (date(t), t)));
    let ms = csv(&map, "t[ms]", times().into_iter().map(|t| (format!("{}", 1e3 * t), t)));
    let later = in_seconds(&map, times().into_iter().map(|t| (t + 1e6, t)));
    for (text, start) in [(dates, 1_769_903_990.0), (ms, 0.0), (later, 1e6)] {
        let found = run(&map, &text);
        assert_eq!(found.said(start), plain.said(0.0));
        assert!((found.impulse() - plain.impulse()).abs() < 1e-6 * plain.impulse());
        assert_eq!((found.gaps, found.contacts), (0, 3));
    }
}

/// Two recordings one after the other, of which the second begins anew or after a pause, are these two: also where something
/// touches at the end of the one and the begin of the other.
#[test]
fn two_recordings_in_one_are_two() {
    let map = uneven();
    for cut in [1.8, 2.8] {
        let (first, second): (Vec<f64>, Vec<f64>) = times().into_iter().partition(|t| *t < cut);
        let parts = [&first, &second].map(|part| run(&map, &in_seconds(&map, part.iter().map(|t| (*t, *t)))));
        for away in [-second[0], -1.0, 100.0, 1e5] {
            let all = first.iter().map(|t| (*t, *t)).chain(second.iter().map(|t| (*t + away, *t)));
            let joined = run(&map, &in_seconds(&map, all));
            assert_eq!(joined.gaps, 1, "{cut} s, {away} s");
            let sum = parts[0].impulse() + parts[1].impulse();
            assert!((joined.impulse() - sum).abs() < 1e-9 * sum, "{} is not {sum}", joined.impulse());
            let time = parts.iter().map(|part| part.whole.contact_time.unwrap()).sum::<f64>();
            assert!((joined.whole.contact_time.unwrap() - time).abs() < 1e-9);
            assert_eq!(joined.contacts, parts[0].contacts + parts[1].contacts);
            let moved = parts[1].said(-away);
            assert_eq!(joined.said(0.0), [parts[0].said(0.0), moved].concat(), "{cut} s, {away} s");
            let gaps: Vec<_> = joined.events.iter().filter(|event| event.word == Word::Gap).collect();
            assert_eq!(gaps.len(), 1);
            let expected = (second[0] + away - first[first.len() - 1]).max(0.0);
            assert!((gaps[0].duration - expected).abs() < 1e-9, "{expected}");
        }
    }
}

/// The first step is a gap if those after it are much shorter, and nothing is dated before the first frame.
#[test]
fn a_first_step_can_be_a_gap() {
    let map = uneven();
    // The last of these is held from the first frame on.
    for begin in [0.6, 2.9] {
        let after = times().into_iter().filter(|t| *t >= begin).map(|t| (t, t));
        let plain = run(&map, &in_seconds(&map, after.clone()));
        let first = run(&map, &in_seconds(&map, [(begin - 100.0, begin)].into_iter().chain(after)));
        assert_eq!((first.gaps, plain.gaps), (1, 0));
        assert_eq!(first.impulse(), plain.impulse());
        assert_eq!(first.said(0.0), plain.said(0.0));
        assert!(plain.events.iter().all(|event| event.begin >= begin), "{:?}", plain.events);
    }
}

/// A zero is followed on after times that go back.
#[test]
fn zeros_are_followed_over_a_restart() {
    let map = uneven();
    let taxels = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum::<usize>();
    let mut text = String::from("time");
    (0..taxels).for_each(|_| text += ",.pressure[count]");
    for k in 0..800 {
        let noise = |taxel: usize| if (k + taxel).is_multiple_of(2) { 1.0 } else { -1.0 };
        write!(text, "\n{}", 0.1 * (k % 400) as f64).unwrap();
        (0..taxels).for_each(|taxel| write!(text, ",{}", 900.0 + 0.01 * k as f64 + noise(taxel)).unwrap());
    }
    let condition = ConditionOptions { zero: Zero::Follow, ..ConditionOptions::default() };
    let options = RecordingOptions { condition, ..RecordingOptions::default() };
    let readings = ReadingsReader::stream(Path::new("-"), Cursor::new(text.to_owned())).unwrap();
    let mut recording = Recording::open(&map, readings, &options).unwrap();
    let mut worst = 0.0_f64;
    while let Some(step) = recording.next_step().unwrap() {
        let of_all = step.frame.values.iter().flat_map(|channels| channels[0].iter());
        worst = worst.max(of_all.filter(|x| x.is_finite()).sum::<f64>().abs() / taxels as f64);
    }
    assert!(worst < 1.0, "the mean is {worst} counts off");
}

/// A tracker ends all contacts where times go back or frames are missing.
#[test]
fn contacts_end_before_a_gap() {
    let map = uneven();
    let options = TrackerOptions { threshold: Some(2000.0), ..TrackerOptions::default() };
    let mut tracker = ContactTracker::new(&map, &Channel::new("", "Pa").unwrap(), &options).unwrap();
    let mut frame = Frame::new(&map, 1);
    let mut tracks = Vec::new();
    for (time, at) in [(0.0, 1.0), (0.1, 1.0), (60.0, 1.0), (60.1, 1.0), (2.0, 1.0), (2.1, 1.0)] {
        let all = readings(&map, at);
        let mut values = all.into_iter();
        for channels in frame.values.iter_mut() {
            channels[0].iter_mut().zip(&mut values).for_each(|(to, x)| *to = x);
        }
        frame.time = time;
        tracks.push(
            tracker.track(&frame).iter().map(|region| (region.track, region.event)).collect::<Vec<_>>(),
        );
    }
    use dermatome::signal::ContactEvent::{Move, Onset, Release};
    let expected = [
        vec![(0, Onset)],
        vec![(0, Move)],
        vec![(1, Onset), (0, Release)],
        vec![(1, Move)],
        vec![(2, Onset), (1, Release)],
        vec![(2, Move)],
    ];
    assert_eq!(tracks, expected);
}
