//! Laws of events: contacts become words that are true by definition.

use dermatome::id::VertexId;
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::signal::{
    BodyWord, Channel, ContactEvent, ContactRegion, ContactTracker, Event, EventDetector, EventOptions,
    Frame, Phase, Probe, SignalError, Touch, TouchOptions, TouchSimulation, TrackerOptions, Word,
};
use dermatome::skin::{LinkId, PatchId, Skin};
use glam::{DVec2, DVec3};

/// A flat skin of taxels 4 mm apart, and its map.
fn plane() -> SkinMap {
    SkinMap::flat(shapes::lattice(30, 30, 0.004), 1e-3)
}

fn detector(options: EventOptions) -> EventDetector {
    EventDetector::new(&plane(), options).unwrap()
}

/// A contact with this centre along x in m, and this force.
fn region(track: u64, x: f64, force: f64) -> ContactRegion {
    ContactRegion {
        track,
        event: ContactEvent::Move,
        taxels: vec![VertexId::new(3), VertexId::new(4)],
        area: 1e-4,
        force,
        centre: DVec3::new(x, 0.0, 0.0),
        normal: DVec3::Z,
        map: DVec2::new(x, 0.0),
        peak_taxel: VertexId::new(3),
        peak: 1000.0 * force,
        ..ContactRegion::default()
    }
}

/// The events of frames at this rate, and those at their end.
fn events_of(
    detector: &mut EventDetector,
    rate: f64,
    frames: usize,
    contacts: impl Fn(f64) -> Vec<ContactRegion>,
) -> Vec<Event> {
    let mut all = Vec::new();
    for frame in 0..frames {
        let time = frame as f64 / rate;
        all.extend_from_slice(detector.see_contacts(time, &contacts(time)).unwrap());
    }
    all.extend_from_slice(detector.finish());
    all
}

fn words(events: &[Event]) -> Vec<(Word, Phase)> {
    events.iter().map(|event| (event.word, event.phase)).collect()
}

const BEGINS: (Word, Phase) = (Word::Touch, Phase::Begin);

/// How far a contact has moved along x, in m, by the share of its time.
type Way = fn(f64) -> f64;

/// A duration in s, a way, and the events after the begin.
type Case = (f64, Way, &'static [(Word, Phase)]);

#[test]
fn durations_and_paths_are_words() {
    let still: Way = |_| 0.0;
    let cases: [Case; 7] = [
        (0.2, still, &[(Word::Tap, Phase::End)]),
        (1.0, still, &[(Word::Press, Phase::End)]),
        (3.0, still, &[(Word::Hold, Phase::Change), (Word::Hold, Phase::End)]),
        (1.0, |s| 0.06 * s, &[(Word::Stroke, Phase::Change), (Word::Stroke, Phase::End)]),
        // To and fro twice.
        (
            1.0,
            |s| 0.03 * (2.0 * std::f64::consts::TAU * s).sin(),
            &[(Word::Stroke, Phase::Change), (Word::Rub, Phase::Change), (Word::Rub, Phase::End)],
        ),
        // Shorter than a contact must be, and shorter than a stroke.
        (0.015, still, &[]),
        (1.0, |s| 0.008 * s, &[(Word::Press, Phase::End)]),
    ];
    for (duration, way, expected) in cases {
        let events = events_of(&mut detector(EventOptions::default()), 100.0, 500, |time| {
            let t = time - 0.5;
            let is_here = (0.0..duration).contains(&t);
            if is_here { vec![region(7, way(t / duration), 2.0)] } else { Vec::new() }
        });
        let begins = if expected.is_empty() { vec![] } else { vec![BEGINS] };
        assert_eq!(words(&events), [begins, expected.to_vec()].concat(), "{duration} s");
        for event in &events {
            let contact = event.contact.as_ref().unwrap();
            assert_eq!(contact.force_peak, 2.0);
            let end = event.begin + event.duration;
            let is_all = event.phase != Phase::End || (event.duration - duration).abs() < 0.02;
            assert!(event.begin >= 0.49 && end <= event.time + 1e-9 && is_all, "{event:?}");
        }
    }
}

/// A stroke has the angle of its way, its speed, and the name of the nearest direction of its link.
#[test]
fn strokes_have_directions() {
    let body = |x: f64, y: f64, word: &str| BodyWord {
        link: LinkId::new(0),
        direction: DVec3::new(x, y, 0.0),
        word: word.into(),
    };
    let options = EventOptions {
        words: vec![body(5.0, 0.0, "down"), body(0.0, 1.0, "across")],
        ..EventOptions::default()
    };
    for (angle, word) in [(0.0_f64, Some(0)), (0.5, Some(0)), (0.8, None), (1.5, Some(1)), (3.0, None)] {
        let events = events_of(&mut detector(options.clone()), 100.0, 150, |time| {
            let way = 0.06 * time * DVec2::from_angle(angle);
            let at = ContactRegion { centre: way.extend(0.0), map: way, ..region(0, 0.0, 1.0) };
            if time < 1.0 { vec![at] } else { Vec::new() }
        });
        let stroke = events.last().unwrap();
        let contact = stroke.contact.as_ref().unwrap();
        assert_eq!((stroke.word, contact.body_word), (Word::Stroke, word), "{angle}");
        assert!((contact.direction.unwrap() - angle).abs() < 1e-6);
        assert!((contact.length - 0.055).abs() < 0.006, "{} m", contact.length);
    }
}

/// A contact whose tracks break off goes on, if the next begins soon and near; two at once are two.
#[test]
fn tracks_are_joined_over_gaps() {
    // The gap between two tracks in s, and how far apart they are.
    for (gap, away, expected) in [(0.1, 0.01, 1), (0.3, 0.01, 2), (0.1, 0.02, 2), (-0.2, 0.01, 2)] {
        let events = events_of(&mut detector(EventOptions::default()), 100.0, 300, |time| {
            let mut all = Vec::new();
            all.extend((0.1..0.6).contains(&time).then(|| region(0, 0.0, 1.0)));
            all.extend((0.6 + gap - 0.005..1.2).contains(&time).then(|| region(1, away, 1.0)));
            all
        });
        let ended = events.iter().filter(|event| event.phase == Phase::End).count();
        assert_eq!(ended, expected, "{gap} s, {away} m: {:?}", words(&events));
    }
}

#[test]
fn taps_one_after_the_other_are_a_pat() {
    for (taps, every, expected) in [(4, 0.4, true), (2, 0.4, false), (4, 0.9, false)] {
        let events = events_of(&mut detector(EventOptions::default()), 100.0, 600, |time| {
            let begun = (0_u32..taps).filter(|tap| time >= f64::from(*tap) * every).count() as u64;
            let tap = begun.saturating_sub(1) as f64;
            let is_here = time - tap * every < 0.1;
            if is_here { vec![region(begun, 0.002 * tap, 1.0)] } else { Vec::new() }
        });
        let pats: Vec<_> = events.iter().filter(|event| event.word == Word::Pat).collect();
        assert_eq!(pats.len(), if expected { 2 } else { 0 }, "{taps} every {every} s");
        if let [begin, end] = pats[..] {
            assert_eq!((begin.phase, end.phase), (Phase::Begin, Phase::End));
            assert_eq!((begin.contacts.len(), end.contacts.len()), (3, 4));
        }
    }
}

/// Contacts on two sides of a link at once are a grasp, those on one side are not.
#[test]
fn contacts_from_two_sides_are_a_grasp() {
    for (normal, is_grasp) in [(-DVec3::Z, true), (DVec3::new(0.0, 0.8, 0.6), false)] {
        let events = events_of(&mut detector(EventOptions::default()), 50.0, 200, |time| {
            let other = ContactRegion { normal, ..region(1, 0.05, 3.0) };
            if (1.0..2.0).contains(&time) { vec![region(0, 0.0, 2.0), other] } else { Vec::new() }
        });
        let grasps: Vec<_> = events.iter().filter(|event| event.word == Word::Grasp).collect();
        assert_eq!(grasps.len(), 2 * usize::from(is_grasp), "{:?}", words(&events));
        for grasp in grasps {
            assert_eq!((grasp.contact.as_ref().unwrap().force_peak, &grasp.contacts[..]), (5.0, &[0, 1][..]));
        }
    }
}

/// Contacts that are never there at once are no grasp, and neither are those that are so for too short a time; a contact that is
/// lost for a moment breaks none.
#[test]
fn a_grasp_counts_what_is_there_at_once() {
    let grasps = |is_here: fn(f64) -> [bool; 2]| {
        let events = events_of(&mut detector(EventOptions::default()), 50.0, 150, |time| {
            let [one, other] = is_here(time);
            let opposite = ContactRegion { normal: -DVec3::Z, ..region(1, 0.05, 2.0) };
            one.then(|| region(0, 0.0, 2.0)).into_iter().chain(other.then_some(opposite)).collect()
        });
        let ended = events.into_iter().filter(|event| (event.word, event.phase) == (Word::Grasp, Phase::End));
        ended.collect::<Vec<_>>()
    };
    assert_eq!(grasps(|t| [t % 0.2 < 0.09, t % 0.2 >= 0.09]), [], "by turns");
    assert_eq!(grasps(|t| [(0.5..1.0).contains(&t), (0.79..1.2).contains(&t)]), [], "0.2 s");
    let found = grasps(|t| [(0.5..1.5).contains(&t), (0.5..0.9).contains(&t) || (0.99..1.5).contains(&t)]);
    assert_eq!(found.len(), 1);
    let contact = found[0].contact.as_ref().unwrap();
    assert!((found[0].duration - 0.98).abs() < 1e-9 && contact.force_peak == 4.0, "{found:?}");
}

/// A contact that goes on over a gap between patches has the taxels, the peak and the patch of when it was largest; its ends
/// have the patches where they are, and no direction across two maps.
#[test]
fn contacts_over_two_patches_keep_the_patch_with_its_taxels() {
    let mut skin = Skin::from_mesh("a", shapes::lattice(6, 6, 0.004));
    let second = shapes::lattice(3, 3, 0.004);
    skin.patches.push(dermatome::skin::Patch::from_mesh("b", LinkId::new(0), second));
    let map = SkinMap::of_taxels(&skin);
    let [a, b] = [0, 1].map(PatchId::new);
    // The force is largest at the begin on patch a, in the second case at the end on patch b.
    for (grows, patch, taxels) in [(-1.0, a, [30, 31]), (1.0, b, [3, 4])] {
        let mut detector = EventDetector::new(&map, EventOptions::default()).unwrap();
        let events = events_of(&mut detector, 100.0, 150, |time| {
            let x = 0.04 * time;
            let at = region(u64::from(x > 0.02), x, 2.0 + grows * time);
            let of_a =
                ContactRegion { taxels: [30, 31].map(VertexId::new).to_vec(), peak_taxel: 30.into(), ..at };
            match time {
                _ if time >= 1.0 => vec![],
                _ if x > 0.02 => vec![ContactRegion {
                    patch: b,
                    map: DVec2::new(x - 0.02, 0.0),
                    ..region(1, x, 2.0 + grows * time)
                }],
                _ => vec![of_a],
            }
        });
        let stroke = events.last().unwrap();
        let contact = stroke.contact.as_ref().unwrap();
        assert_eq!((stroke.word, contact.direction, contact.patch), (Word::Stroke, None, patch));
        assert_eq!(contact.taxels, taxels.map(VertexId::new));
        assert!(contact.taxels.contains(&contact.peak_taxel));
        assert_eq!([contact.from.patch, contact.to.patch], [a, b]);
        assert!(contact.from.map.x < 0.005 && (contact.to.map.x - 0.018).abs() < 0.002, "{contact:?}");
        assert!((contact.to.point.x - 0.038).abs() < 0.002);
    }
}

/// Rubs from 15 mm on, from one end of their way or its middle on, are rubs; their begin is that of the contact.
#[test]
fn short_rubs_are_rubs() {
    for span in [0.015, 0.02, 0.03] {
        let ways: [fn(f64) -> f64; 2] = [
            |s| (3.0 * std::f64::consts::TAU * s).sin() / 2.0,
            |s| (6.0 * s).rem_euclid(2.0).min(2.0 - (6.0 * s).rem_euclid(2.0)),
        ];
        for way in ways {
            let events = events_of(&mut detector(EventOptions::default()), 100.0, 250, |time| {
                let share = (time - 0.5) / 1.5;
                if (0.0..1.0).contains(&share) { vec![region(0, span * way(share), 2.0)] } else { Vec::new() }
            });
            let last = events.last().unwrap();
            assert_eq!((last.word, last.phase), (Word::Rub, Phase::End), "{span} m");
        }
    }
    // To and fro on a skin, so that its first taxels are pressed again later and more.
    let map = plane();
    let channel = Channel::new("pressure", "Pa").unwrap();
    let options = TrackerOptions { threshold: Some(1500.0), ..TrackerOptions::default() };
    let mut tracker = ContactTracker::new(&map, &channel, &options).unwrap();
    let mut detector = EventDetector::new(&map, EventOptions::default()).unwrap();
    let mut frame = Frame::new(&map, 1);
    let mut events = Vec::new();
    for k in 0..250 {
        frame.time = 0.01 * f64::from(k);
        let share = (frame.time - 0.5) / 1.5;
        let at = 0.05 + 0.0075 * (3.0 * std::f64::consts::TAU * share).sin();
        let depth = 0.0015 * (share / 0.05).min((1.0 - share) / 0.05).min(1.0);
        let positions = &map.patches[PatchId::new(0)].levels[0.into()].level.mesh.positions;
        for (x, p) in frame.values[PatchId::new(0)][0].iter_mut().zip(positions) {
            let around = (p.x - at).powi(2) + (p.y - 0.051).powi(2);
            *x = (depth - around / 0.04).max(0.0) * 2.7e7;
        }
        tracker.track(&frame);
        events.extend_from_slice(detector.see(frame.time, &tracker).unwrap());
    }
    let rub = events.iter().find(|event| event.phase == Phase::End).unwrap();
    assert_eq!(rub.word, Word::Rub);
    assert!((rub.begin - 0.5).abs() < 0.04 && (rub.begin + rub.duration - 2.0).abs() < 0.04, "{rub:?}");
}

/// A force above the limit is a hit if it is reached at once.
#[test]
fn sudden_forces_are_hits() {
    let options = EventOptions { hit_n: Some(5.0), ..EventOptions::default() };
    for (rise, force, word) in [(0.02, 9.0, Word::Hit), (0.02, 4.0, Word::Tap), (0.12, 9.0, Word::Tap)] {
        let events = events_of(&mut detector(options.clone()), 200.0, 200, |time| {
            let t = time - 0.3;
            let share = (t / rise).min((0.2 - t) / 0.05).min(1.0);
            if share > 0.0 { vec![region(0, 0.0, force * share)] } else { Vec::new() }
        });
        assert_eq!(events.last().unwrap().word, word, "{force} N in {rise} s");
    }
}

/// Contacts end where times jump back or frames are missing, and the gap is reported; a frame without a time is refused.
#[test]
fn gaps_in_time_are_reported() {
    let times = |jump: f64| (0..100).map(move |k| 0.01 * f64::from(k) + if k < 50 { 0.0 } else { jump });
    for jump in [-0.3, 5.0] {
        let mut detector = detector(EventOptions::default());
        let mut all = Vec::new();
        for time in times(jump) {
            all.extend_from_slice(detector.see_contacts(time, &[region(0, 0.0, 1.0)]).unwrap());
        }
        all.extend_from_slice(detector.finish());
        let press = (Word::Press, Phase::End);
        let expected = [BEGINS, press, (Word::Gap, Phase::End), BEGINS, press];
        assert_eq!(words(&all), expected, "{jump} s");
        assert!((all[2].duration - (jump + 0.01).max(0.0)).abs() < 1e-9 && all[2].begin <= all[2].time);
    }
    let error = detector(EventOptions::default()).see_contacts(f64::NAN, &[]).map(<[Event]>::len);
    assert_eq!(error, Err(SignalError::NoEventTime));
}

/// The same words at a frame a second and at ten thousand.
#[test]
fn any_rate_gives_the_same_words() {
    for (rate, frames) in [(1.0, 20), (10_000.0, 60_000)] {
        let events = events_of(&mut detector(EventOptions::default()), rate, frames, |time| {
            if (1.0..4.5).contains(&time) { vec![region(0, 0.0, 1.0)] } else { Vec::new() }
        });
        let hold = |phase| (Word::Hold, phase);
        assert_eq!(words(&events), [BEGINS, hold(Phase::Change), hold(Phase::End)], "{rate} Hz");
    }
}

/// Where all taxels are masked nothing touches; a contact ends where they become so. At a frame a second and at ten
/// thousand, with any probe.
#[test]
fn masked_skins_have_no_events() {
    let map = plane();
    let channel = Channel::new("pressure", "Pa").unwrap();
    for (probe, rate, seconds) in [
        (Probe::Any, 1.0, 20.0),
        (Probe::Any, 10_000.0, 0.2),
        (Probe::Finger, 1.0, 20.0),
        (Probe::Finger, 10_000.0, 0.2),
    ] {
        for from in [0.0, 0.6] {
            let options = TrackerOptions { probe, threshold: Some(100.0), ..TrackerOptions::default() };
            let mut tracker = ContactTracker::new(&map, &channel, &options).unwrap();
            let mut detector = EventDetector::new(&map, EventOptions::default()).unwrap();
            let mut frame = Frame::new(&map, 1);
            let mut events = Vec::new();
            for k in (0_u32..).take_while(|k| f64::from(*k) < seconds * rate) {
                frame.time = f64::from(k) / rate;
                let readings = &mut frame.values[PatchId::new(0)][0];
                let is_masked = frame.time >= from * seconds;
                readings.iter_mut().for_each(|x| *x = if is_masked { f64::NAN } else { 0.0 });
                if !is_masked && frame.time > 0.2 * seconds {
                    for taxel in [400, 401, 430, 431] {
                        readings[VertexId::new(taxel)] = 5000.0;
                    }
                }
                tracker.track(&frame);
                events.extend_from_slice(detector.see(frame.time, &tracker).unwrap());
            }
            events.extend_from_slice(detector.finish());
            let ended = events.iter().filter(|event| event.phase == Phase::End).count();
            assert_eq!(ended, usize::from(from > 0.0), "{probe:?} at {rate} Hz: {:?}", words(&events));
        }
    }
}

#[test]
fn limits_that_contradict_each_other_are_refused() {
    let good = EventOptions::default();
    for options in [
        EventOptions { tap_s: 3.0, ..good.clone() },
        EventOptions { least_s: 0.5, ..good.clone() },
        EventOptions { pat_s: 0.1, ..good.clone() },
        EventOptions { stroke_m: 0.0, ..good.clone() },
        EventOptions { hold_s: f64::NAN, ..good.clone() },
        EventOptions { join_s: -1.0, ..good.clone() },
        EventOptions { hit_n: Some(0.0), ..good.clone() },
        EventOptions { pat_taps: 1, ..good.clone() },
        EventOptions { grasp_rad: 4.0, ..good.clone() },
    ] {
        let error = EventDetector::new(&plane(), options).unwrap_err().to_string();
        assert!(error.contains("needed"), "{error}");
    }
}

/// What simulated presses are, by their duration and how far they roll.
fn expected(duration: f64, roll: f64) -> Word {
    match duration {
        _ if roll > 0.012 => Word::Stroke,
        d if d < 0.3 => Word::Tap,
        d if d < 2.0 => Word::Press,
        _ => Word::Hold,
    }
}

/// The events of simulated presses on a plane of 21 x 21 cm, taxels 7 mm apart, and the begin and end of each touch.
fn simulated(touches: &TouchOptions) -> (Vec<Event>, Vec<[f64; 2]>) {
    let mesh = shapes::lattice(30, 34, 0.00726);
    let skin = Skin::from_mesh("skin", mesh.clone());
    let map = SkinMap::flat(mesh, 1e-3);
    let mut simulation = TouchSimulation::new(&skin, touches).unwrap();
    let mut tracker = ContactTracker::new(&map, simulation.channel(), &TrackerOptions::default()).unwrap();
    let mut detector = EventDetector::new(&map, EventOptions::default()).unwrap();
    let (mut events, mut truth) = (Vec::new(), Vec::<[f64; 2]>::new());
    let mut last = None;
    while let Some((frame, now)) = simulation.next_frame() {
        for Touch { press, time, .. } in now.iter().filter(|touch| touch.taxels > 0) {
            if last != Some(*press) {
                truth.push([*time; 2]);
            }
            last = Some(*press);
            truth.last_mut().unwrap()[1] = *time;
        }
        tracker.track(frame);
        events.extend_from_slice(detector.see(frame.time, &tracker).unwrap());
    }
    events.extend_from_slice(detector.finish());
    (events, truth)
}

/// What was found of simulated presses.
#[derive(Default)]
struct Judged {
    /// The words of presses that are one contact.
    words: Vec<Word>,
    right: usize,
    /// Presses without an event, and events without a press.
    missed: usize,
    wrong: usize,
    /// How far begins and ends are from the truth, in s.
    off: Vec<f64>,
}

/// Judges presses of this duration and roll, from the first frame in which a taxel feels them to the last.
fn judge(duration: f64, roll: f64, presses: usize, noise: f64, seed: u64) -> Judged {
    let touches =
        TouchOptions { duration, roll, presses, noise, seed, pause: 1.0, ..TouchOptions::default() };
    let (events, truth) = simulated(&touches);
    let ends: Vec<_> = events
        .iter()
        .filter(|event| event.phase == Phase::End && event.word != Word::Pat)
        .map(|event| (event.word, event.begin, event.begin + event.duration))
        .collect();
    let mut judged = Judged::default();
    for [from, to] in &truth {
        let here: Vec<_> = ends.iter().filter(|(_, begin, end)| begin < to && end > from).collect();
        match here[..] {
            [] => judged.missed += 1,
            [(word, begin, end)] => {
                judged.words.push(*word);
                judged.right += usize::from(*word == expected(duration, roll));
                judged.off.extend([begin - from, end - to]);
            }
            _ => {}
        }
    }
    let is_false =
        |(_, begin, end): &&(Word, f64, f64)| truth.iter().all(|[from, to]| begin >= to || end <= from);
    judged.wrong = ends.iter().filter(is_false).count();
    judged.off.iter_mut().for_each(|x| *x = x.abs());
    judged.off.sort_by(f64::total_cmp);
    judged
}

/// With noise: a word for each press, and begin and end within 30 ms.
#[test]
fn simulated_presses_have_their_words() {
    for (duration, roll, seed) in [(0.15, 0.0, 1), (1.0, 0.0, 2), (3.0, 0.0, 3), (1.0, 0.06, 4)] {
        let Judged { right, missed, wrong, off, .. } = judge(duration, roll, 3, 2000.0, seed);
        assert_eq!((right, missed, wrong), (3, 0, 0), "{duration} s, {roll} m");
        assert!(duration != 1.0 || roll > 0.0 || off[5] <= 0.03 + 1e-9, "{off:?}");
    }
}

/// The table of docs/recordings.md: words of 300 presses on fresh seeds, and those of presses near the limits.
#[test]
#[ignore = "takes minutes: run it after a change of events"]
fn words_of_many_presses() {
    const EACH: usize = 60;
    let kinds = [(0.15, 0.0), (1.0, 0.0), (3.0, 0.0), (1.0, 0.06), (3.0, 0.06)];
    for (noise, least) in [(2000.0, 300), (5000.0, 284)] {
        let mut sums = [0; 3];
        for (seed, (duration, roll)) in (7001_u64..).zip(kinds) {
            let Judged { right, missed, wrong, off, .. } = judge(duration, roll, EACH, noise, seed);
            sums.iter_mut().zip([right, missed, wrong]).for_each(|(sum, x)| *sum += x);
            let last = off.len() - 1;
            let [half, most, worst] = [last / 2, 19 * last / 20, last].map(|k| 1e3 * off[k]);
            assert!(noise > 2000.0 || (duration, roll) != (1.0, 0.0) || most <= 28.0, "{most} ms");
            println!(
                "{noise} Pa, {duration} s, {roll} m: {right} of {EACH} right, {missed} missed, {wrong} false; \
                 off {half:.0} ms, 95 % {most:.0} ms, worst {worst:.0} ms"
            );
        }
        println!("{noise} Pa: {} of 300 right, {} missed, {} false", sums[0], sums[1], sums[2]);
        assert!(sums[0] >= least && sums[2] == 0, "{sums:?}");
    }
    let durations = [0.2, 0.25, 0.3, 0.35, 0.4].map(|duration| (duration, 0.0));
    let lengths = [0.006, 0.009, 0.011, 0.013, 0.015, 0.02].map(|roll| (1.0, roll));
    for (seed, (duration, roll)) in (7101_u64..).zip(durations.into_iter().chain(lengths)) {
        let Judged { words, missed, wrong, .. } = judge(duration, roll, 20, 2000.0, seed);
        let count = |word: Word| words.iter().filter(|found| **found == word).count();
        let [tap, press, stroke] = [Word::Tap, Word::Press, Word::Stroke].map(count);
        println!(
            "{duration} s, {roll} m: {tap} taps, {press} presses, {stroke} strokes of 20, {missed} missed"
        );
        assert_eq!((tap + press + stroke, wrong), (20, 0), "{words:?}");
    }
}

/// What comes after missing frames begins after them, also where it presses from their first frame on.
#[test]
fn contacts_after_missing_frames_begin_after_them() {
    let map = plane();
    let options = TrackerOptions { threshold: Some(1000.0), ..TrackerOptions::default() };
    let mut tracker = ContactTracker::new(&map, &Channel::new("pressure", "Pa").unwrap(), &options).unwrap();
    let mut detector = EventDetector::new(&map, EventOptions::default()).unwrap();
    let mut events = Vec::new();
    let before = (0..150).map(|k| (0.02 * f64::from(k), 0.0));
    let ramp = |k: i32| if k < 125 { (0.1 + 0.012 * f64::from(k)).min(1.0).powi(2) } else { 0.0 };
    for (time, share) in before.chain((0..200).map(|k| (100.0 + 0.02 * f64::from(k), ramp(k)))) {
        let mut frame = Frame { time, ..Frame::new(&map, 1) };
        let values = &mut frame.values[PatchId::new(0)][0];
        values.iter_mut().for_each(|x| *x = 0.0);
        (10..15).flat_map(|row| (10..15).map(move |column| 30 * row + column)).for_each(|taxel| {
            values[VertexId::new(taxel)] = 4e5 * share;
        });
        tracker.track(&frame);
        events.extend_from_slice(detector.see(time, &tracker).unwrap());
    }
    events.extend_from_slice(detector.finish());
    let contacts: Vec<_> = events.iter().filter(|event| event.word != Word::Gap).collect();
    assert!(contacts.len() >= 2, "{events:?}");
    assert!(contacts.iter().all(|event| event.begin >= 100.0), "{contacts:?}");
}
