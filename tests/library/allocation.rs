//! The steady state allocates nothing: every step of a live stream, for frames that change as a whole,
//! in part or not at all.

use std::sync::Arc;

use dermatome::atlas::{Atlas, AtlasOptions};
use dermatome::id::VertexId;
use dermatome::image::Renderer;
use dermatome::io::{Readings, ReadingsReader};
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::pipeline::{BuildOptions, build};
use dermatome::recording::{Carried, Fill, Recording, RecordingOptions};
use dermatome::signal::{
    Channel, ConditionOptions, ContactEvent, ContactTracker, EventDetector, EventOptions, Frame, Probe,
    Quantity, Restrictor, TouchOptions, TouchSimulation, TrackerOptions, Zero,
};
use dermatome::skin::{LinkId, Patch, PatchId, Skin};

fn skin() -> Skin {
    let mut skin = Skin::from_mesh("palm", shapes::cap(600, 0.05, 0.9));
    skin.patches.push(Patch::from_mesh("back", LinkId::new(0), shapes::cap(200, 0.03, 1.0)));
    skin
}

fn allocations(work: impl FnOnce()) -> u64 {
    allocation_counter::measure(work).count_total
}

/// What the counter says of nothing and of something, for the other tests to mean anything.
#[test]
fn allocations_are_counted() {
    assert_eq!(allocations(|| ()), 0);
    assert_eq!(allocations(|| drop(std::hint::black_box(Box::new(1)))), 1);
}

/// A recording of touches with noise, twice: what the first time has made room for is enough for the
/// second. Frames of noise change every taxel.
#[test]
fn whole_frames_allocate_nothing() {
    let skin = skin();
    let map = Arc::new(build(&skin, &BuildOptions::default()).unwrap());
    let touches = TouchOptions {
        presses: 4,
        touches: 2,
        rate: 40.0,
        noise: 100.0,
        dead: 0.05,
        ..TouchOptions::default()
    };
    stream(&map, &skin, &touches);
}

/// Without noise only the touched taxels change, and in a pause none does.
#[test]
fn partial_changes_allocate_nothing() {
    let skin = skin();
    let map = Arc::new(build(&skin, &BuildOptions::default()).unwrap());
    for quantity in [Quantity::Intensive, Quantity::Extensive] {
        let touches = TouchOptions { presses: 4, rate: 40.0, quantity, ..TouchOptions::default() };
        stream(&map, &skin, &touches);
    }
}

/// Readings of a simulation, played twice.
fn readings(skin: &Skin, touches: &TouchOptions) -> Readings {
    let mut all = Readings::default();
    for _ in 0..2 {
        let mut simulation = TouchSimulation::new(skin, touches).unwrap();
        all.channels = vec![simulation.channel().clone()];
        while let Some((frame, _)) = simulation.next_frame() {
            all.times.push(all.times.len() as f64 / touches.rate);
            all.values.extend(frame.values.iter().flat_map(|patch| patch[0].iter()));
        }
    }
    all.width = skin.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
    all
}

/// Every stage, on a recording that is played twice: counts in the second time.
fn stream(map: &Arc<SkinMap>, skin: &Skin, touches: &TouchOptions) {
    let atlas = Atlas::new(map, &AtlasOptions::default()).unwrap();
    let readings = readings(skin, touches);
    for (carried, fill, zero) in [
        (Carried::Values, Fill::None, Zero::First(3)),
        (Carried::Values, Fill::Neighbours, Zero::Follow),
        (Carried::Contrast, Fill::Neighbours, Zero::First(3)),
        (Carried::Edges, Fill::None, Zero::First(3)),
    ] {
        let reader = ReadingsReader::memory(readings.clone()).unwrap();
        let condition = ConditionOptions {
            zero,
            split_hz: Some(5.0),
            clip: Some([-1e9, 1e9]),
            ..ConditionOptions::default()
        };
        let options = RecordingOptions { condition, fill, ..RecordingOptions::default() };
        let mut recording = Recording::open(map, reader, &options).unwrap();
        recording.carry(carried, None);
        recording.draw(&atlas).unwrap();
        // Above what is left of earlier touches in the slow part.
        let threshold = Some(0.05 * readings.values.iter().copied().fold(0.0, f64::max));
        recording.follow_contacts(&TrackerOptions { threshold, ..TrackerOptions::default() }).unwrap();
        let mut regions = 0;
        for number in 0..readings.times.len() {
            let found = allocations(|| {
                let step = recording.next_step().unwrap().unwrap();
                assert_eq!((step.number, step.images.len()), (number, atlas.parts.len()));
                regions += step.contacts.len();
            });
            let is_first = number < readings.times.len() / 2;
            assert!(is_first || found == 0, "{found} allocations of {carried:?} in frame {number}");
        }
        assert!(recording.next_step().unwrap().is_none());
        assert!(regions > 100, "{regions} regions of {carried:?} with {zero:?} are enough to see something");
    }
}

/// One, some and many taxels that change, on a flat skin.
#[test]
fn any_share_of_changes_allocates_nothing() {
    let map = build(&skin(), &BuildOptions::default()).unwrap();
    let atlas = Atlas::new(&map, &AtlasOptions::default()).unwrap();
    let channels = [Channel::default()];
    let mut restrictor = Restrictor::new(&map, &channels);
    let mut renderer = Renderer::new(&map, &atlas, &channels, None).unwrap();
    let mut frame = Frame::new(&map, 1);
    frame.values.iter_mut().flatten().flat_map(|x| x.iter_mut()).for_each(|x| *x = 1.0);
    renderer.render(restrictor.restrict(&frame));
    for share in [1, 3, 10, 30, 100, 300] {
        let taxels = &mut frame.values[PatchId::new(0)][0];
        (0..share.min(taxels.len())).for_each(|k| taxels[VertexId::new(k)] += 0.5);
        let found = allocations(|| {
            renderer.render(restrictor.restrict(&frame));
        });
        assert_eq!(found, 0, "{share} taxels changed");
    }
}

/// Contacts with either probe, several at once, and their events, while nothing begins or ends: in the third time, since
/// fingers make room for each taxel that is touched first, and zeros are followed.
#[test]
fn contacts_and_events_allocate_nothing() {
    let mesh = shapes::lattice(20, 20, 0.007);
    let (skin, map) = (Skin::from_mesh("palm", mesh.clone()), SkinMap::flat(mesh, 1e-3));
    for (probe, touches) in [(Probe::Any, 1), (Probe::Any, 3), (Probe::Finger, 3)] {
        let options = TouchOptions {
            presses: 2,
            touches,
            roll: 0.0,
            rate: 20.0,
            noise: 300.0,
            duration: 2.0,
            ..TouchOptions::default()
        };
        let mut simulation = TouchSimulation::new(&skin, &options).unwrap();
        let options = TrackerOptions { probe, low: probe.low(), ..TrackerOptions::default() };
        let mut tracker = ContactTracker::new(&map, simulation.channel(), &options).unwrap();
        let mut detector = EventDetector::new(&map, EventOptions::default()).unwrap();
        let mut frames = Vec::new();
        while let Some((frame, _)) = simulation.next_frame() {
            frames.push(frame.clone());
        }
        let (mut steady, mut most) = (0, 0);
        for round in 0..3 {
            for frame in &frames {
                let mut frame = frame.clone();
                frame.time += f64::from(round) * 10.0;
                let mut changes = false;
                let found = allocations(|| {
                    let contacts = tracker.track(&frame);
                    changes = contacts.iter().any(|contact| contact.event != ContactEvent::Move);
                    most = most.max(contacts.len());
                    changes |= !detector.see(frame.time, &tracker).unwrap().is_empty();
                });
                let is_steady = round == 2 && !changes;
                steady += usize::from(is_steady);
                assert!(!is_steady || found == 0, "{found} allocations at {} s, {probe:?}", frame.time);
            }
        }
        assert!(steady > 50 && most >= touches, "{steady} steady frames, {most} contacts, {probe:?}");
    }
}
