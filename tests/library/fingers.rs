//! Laws of the number of contacts: fingers, palms and spheres, counted over a touch.

use std::sync::Arc;

use dermatome::id::VertexId;
use dermatome::io::{Readings, ReadingsReader, read_draft};
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::pipeline::{BuildOptions, build};
use dermatome::pyramid::LevelId;
use dermatome::recording::{Recording, RecordingOptions};
use dermatome::signal::{
    Channel, ConditionOptions, ContactTracker, Duplicates, Frame, Group, Probe, Quantity, ReadoutOptions,
    Touch, TouchOptions, TouchShape, TouchSimulation, TrackerOptions, Zero,
};
use dermatome::skin::{AssembleOptions, PatchId, Skin, assemble};
use glam::DVec2;

use crate::common;

/// The number of contacts of the strongest touch of a recording.
fn at_once(map: &Arc<SkinMap>, readings: Readings, probe: Probe) -> usize {
    let reader = ReadingsReader::memory(readings).unwrap();
    let options = RecordingOptions { duplicates: Duplicates::First, ..RecordingOptions::default() };
    let mut recording = Recording::open(map, reader, &options).unwrap();
    let options = TrackerOptions { probe, low: probe.low(), ..recording.tracker_options(0) };
    recording.follow_contacts(&options).unwrap();
    while recording.next_step().unwrap().is_some() {}
    recording.at_once().unwrap()
}

/// Counts the recordings of 0 to 5 fingers on a real cover whose number is in `is_wanted`.
fn count_fingers(is_wanted: impl Fn(usize) -> bool) -> Option<[[usize; 8]; 6]> {
    let (skin, path) =
        common::data("cyskin/curved_gesture_patch_isomap.json").zip(common::data("cyskin/fingers.npz"))?;
    let skin = assemble(&read_draft(&skin).unwrap(), &AssembleOptions::default()).unwrap().skin;
    let map = Arc::new(build(&skin, &BuildOptions::default()).unwrap());
    let mut found = [[0; 8]; 6];
    for (name, readings) in common::fingers(&path) {
        let (fingers, number) = name.split_once('_').unwrap();
        if is_wanted(number.parse().unwrap()) {
            let count = at_once(&map, readings, Probe::Finger);
            found[fingers.parse::<usize>().unwrap()][count.min(7)] += 1;
        }
    }
    Some(found)
}

/// Shares of the recordings counted right, and right within one.
fn shares(found: &[[usize; 8]; 6]) -> [f64; 2] {
    let all: usize = found.iter().flatten().sum();
    let within = |most: usize| {
        let counts = |(fingers, row): (usize, &[usize; 8])| {
            row.iter().enumerate().filter(|(n, _)| n.abs_diff(fingers) <= most).map(|(_, x)| x).sum::<usize>()
        };
        found.iter().enumerate().map(counts).sum::<usize>() as f64 / all as f64
    };
    [within(0), within(1)]
}

/// A part of the recordings, with the zero, the noise and the faults as they are found.
#[test]
fn fingers_are_counted() {
    let Some(found) = count_fingers(|number| number % 8 == 5) else { return };
    let [right, near] = shares(&found);
    println!("right {right:.3}, within one {near:.3}: {found:?}");
    assert!(right >= 0.6 && near >= 0.85, "{found:?}");
    assert_eq!(found[0][1..], [0; 7], "nothing touches");
}

/// All of them but the numbers that end in 7: odd and even numbers.
#[test]
#[ignore = "takes minutes: run it after a change of how contacts are counted"]
fn all_fingers_are_counted() {
    for (name, odd, least) in [("odd", 1, 0.73), ("even", 0, 0.68)] {
        let Some(found) = count_fingers(|number| number % 10 != 7 && number % 2 == odd) else { return };
        let [right, near] = shares(&found);
        println!("{name}: right {right:.3}, within one {near:.3}: {found:?}");
        assert!(right >= least && near >= 0.94, "{name}: {found:?}");
        assert_eq!(found[0][1..], [0; 7], "nothing touches");
    }
}

/// Readings of presses on a plane, taxels 7.26 mm apart, with uneven gains and dead taxels.
fn pressed(shape: TouchShape) -> TouchOptions {
    TouchOptions {
        shape,
        presses: 1,
        roll: 0.0,
        rate: 20.0,
        pause: 0.5,
        depths: [0.0015, 0.0025],
        quantity: Quantity::Intensive,
        dead: 0.05,
        readout: ReadoutOptions { gain_spread: 0.4, ..ReadoutOptions::default() },
        ..TouchOptions::default()
    }
}

/// The number of contacts of a simulated touch, and for each body how many taxels read more than the threshold of the
/// tracker because of it alone, without noise.
fn count_of(touches: &TouchOptions, probe: Probe) -> (usize, Vec<usize>) {
    let mesh = shapes::lattice(30, 34, 0.00726);
    let skin = Skin::from_mesh("skin", mesh.clone());
    let map = SkinMap::flat(mesh.clone(), 1e-3);
    let mut simulation = TouchSimulation::new(&skin, touches).unwrap();
    let mut without_noise =
        TouchSimulation::new(&skin, &TouchOptions { noise: 0.0, ..touches.clone() }).unwrap();
    let options = TrackerOptions { probe, low: probe.low(), ..TrackerOptions::default() };
    let mut tracker = ContactTracker::new(&map, simulation.channel(), &options).unwrap();
    let mut most = vec![0; touches.touches];
    while let Some((frame, _)) = simulation.next_frame() {
        tracker.track(frame);
        let (clean, now) = without_noise.next_frame().unwrap();
        let mut above = vec![0; touches.touches];
        for (taxel, at) in mesh.positions.enumerate() {
            let distance = |touch: &&Touch| touch.centre.distance_squared(*at);
            let nearest = now.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
            if let Some((touch, threshold)) = nearest.zip(tracker.threshold()) {
                let reading = clean.values[PatchId::new(0)][0][taxel];
                above[touch.press] += usize::from(reading > threshold);
            }
        }
        most.iter_mut().zip(above).for_each(|(most, now)| *most = now.max(*most));
    }
    (tracker.at_once(), most)
}

/// How many of simulated touches, with noise of 1, 3 and 5 kPa, are counted right, of how many that are visible: two
/// taxels or more of each body above the threshold.
fn right_of(touches: &TouchOptions, probe: Probe, each: u64) -> [usize; 2] {
    let mut sums = [0; 2];
    for seed in 0..3 * each {
        let noise = [1000.0, 3000.0, 5000.0][usize::try_from(seed % 3).unwrap()];
        let touches = TouchOptions { noise, seed: 1 + seed, ..touches.clone() };
        let (found, above) = count_of(&touches, probe);
        if above.iter().all(|&taxels| taxels >= 2) {
            sums[0] += usize::from(found == touches.touches);
            sums[1] += 1;
        }
    }
    sums
}

/// Two bodies far apart are two, one is one, and noise is none.
#[test]
fn simulated_fingers_and_palms_are_counted() {
    let finger = TouchOptions { length: 0.03, radii: vec![0.007], ..pressed(TouchShape::Finger) };
    let palm = TouchOptions { length: 0.06, ..pressed(TouchShape::Palm) };
    let two = TouchOptions { touches: 2, apart: Some(0.04), ..pressed(TouchShape::Sphere) };
    for (name, touches) in [("finger", finger), ("palm", palm), ("two spheres", two)] {
        let [right, of] = right_of(&touches, Probe::Finger, 2);
        assert!(of >= 4 && right == of, "{name}: {right} of {of}");
    }
    // Noise alone is no contact.
    let untouched = TouchOptions { presses: 0, pause: 2.0, noise: 5000.0, ..pressed(TouchShape::Sphere) };
    for probe in [Probe::Any, Probe::Finger] {
        assert_eq!(count_of(&untouched, probe).0, 0, "{probe:?}");
    }
}

/// Contacts with these centres on a long plane, as bells of 5 mm and these heights, that are within 12 cm of its corner.
fn contacts_near_the_corner(bells: &[(DVec2, f64)]) -> Vec<Vec<VertexId>> {
    let map = SkinMap::flat(shapes::lattice(60, 34, 0.00726), 1e-3);
    let patch = PatchId::new(0);
    let mut frame = Frame::new(&map, 1);
    let positions = map.patches[patch].levels[LevelId::new(0)].level.mesh.positions.clone();
    let bell = |at: DVec2, (centre, height): &(DVec2, f64)| {
        height * (-0.5 * (at - *centre).length_squared() / 25e-6).exp()
    };
    frame.values[patch][0] = positions.map(|at| bells.iter().map(|one| bell(at.truncate(), one)).sum());
    let options =
        TrackerOptions { probe: Probe::Finger, threshold: Some(100.0), ..TrackerOptions::default() };
    let mut tracker = ContactTracker::new(&map, &Channel::new("pressure", "Pa").unwrap(), &options).unwrap();
    (0..10).for_each(|_| drop(tracker.track(&frame).to_vec()));
    let near = tracker.contacts().iter().filter(|contact| contact.centre.truncate().length() < 0.12);
    near.map(|contact| contact.taxels.clone()).collect()
}

/// What touches the skin 20 cm away, be it a hundred times as strong, changes no contact.
#[test]
fn a_touch_elsewhere_changes_no_contact() {
    let fingers =
        [(DVec2::new(0.05, 0.05), 1000.0), (DVec2::new(0.08, 0.06), 400.0), (DVec2::new(0.06, 0.1), 700.0)];
    let alone = contacts_near_the_corner(&fingers);
    assert_eq!(alone.len(), 3);
    let elsewhere = [fingers.to_vec(), vec![(DVec2::new(0.32, 0.15), 1e5)]].concat();
    assert_eq!(contacts_near_the_corner(&elsewhere), alone);
    // Next to them a weak contact is none.
    let beside = [fingers.to_vec(), vec![(DVec2::new(0.1, 0.1), 1e5)]].concat();
    assert!(contacts_near_the_corner(&beside).len() < 3);
}

/// The table of shapes, sizes and distances: counted right of those that are visible.
#[test]
#[ignore = "takes minutes: run it after a change of how contacts are counted"]
fn shapes_sizes_and_distances_are_counted() {
    const EACH: u64 = 16;
    let sphere = |radius| TouchOptions { radii: vec![radius], ..pressed(TouchShape::Sphere) };
    let finger = |length| TouchOptions { length, radii: vec![0.007], ..pressed(TouchShape::Finger) };
    let palm = |length| TouchOptions { length, ..pressed(TouchShape::Palm) };
    let radii = vec![0.008, 0.012, 0.015];
    let two = |apart| TouchOptions {
        touches: 2,
        apart: Some(apart),
        radii: radii.clone(),
        ..pressed(TouchShape::Sphere)
    };
    // A row, and the least share with either probe; large spheres are as wide as two fingers.
    let rows = [
        ("sphere 12 mm", sphere(0.012), [0.94, 0.94]),
        ("sphere 20 mm", sphere(0.02), [0.94, 0.94]),
        ("sphere 30 mm", sphere(0.03), [0.85, 0.0]),
        ("sphere 40 mm", sphere(0.04), [0.85, 0.0]),
        ("finger 20 mm", finger(0.02), [0.94, 0.94]),
        ("finger 40 mm", finger(0.04), [0.94, 0.8]),
        ("finger 60 mm", finger(0.06), [0.85, 0.6]),
        ("palm 40 mm", palm(0.04), [0.75, 0.7]),
        ("palm 60 mm", palm(0.06), [1.0, 1.0]),
        ("two 15 mm apart", two(0.015), [0.0, 0.0]),
        ("two 20 mm apart", two(0.02), [0.8, 0.8]),
        ("two 30 mm apart", two(0.03), [0.95, 0.95]),
        ("two 40 mm apart", two(0.04), [0.95, 0.95]),
    ];
    let mut missed = Vec::new();
    for (name, touches, least) in &rows {
        let counts = [Probe::Any, Probe::Finger].map(|probe| right_of(touches, probe, EACH));
        let [[any, any_of], [finger, finger_of]] = counts;
        println!("| {name} | {any} of {any_of} | {finger} of {finger_of} |");
        let share = |[right, of]: [usize; 2]| right as f64 / of as f64;
        if counts.iter().zip(least).any(|(count, least)| share(*count) < *least) {
            missed.push(name);
        }
    }
    assert!(missed.is_empty(), "{missed:?}");
}

/// Readings that are at zero at rest stay what they are, with fingers as without: a finger that presses from the first frame on
/// is neither noise nor zero, and has all of its impulse.
#[test]
fn fingers_of_readings_at_zero_have_all_of_their_impulse() {
    let map = Arc::new(SkinMap::flat(shapes::lattice(20, 20, 0.00726), 1e-3));
    let positions = map.patches[PatchId::new(0)].levels[LevelId::new(0)].level.mesh.positions.clone();
    let middle = positions[VertexId::new(10 * 20 + 10)];
    let pressed: Vec<bool> = positions.iter().map(|x| x.distance(middle) < 0.012).collect();
    let noise = |k: usize| ((k * 7919) % 601) as f64 - 300.0;
    let width = pressed.len();
    let readings = Readings {
        channels: vec![Channel::new("pressure", "Pa").unwrap()],
        width,
        times: (0..200).map(|k| 0.05 * f64::from(k)).collect(),
        values: (0..200 * width)
            .map(|k| noise(k) + if pressed[k % width] && k / width < 150 { 3e4 } else { 0.0 })
            .collect(),
        ..Readings::default()
    };
    let impulse = |probe: Probe| {
        let condition = ConditionOptions { zero: Zero::At(0.0), ..ConditionOptions::default() };
        let options = RecordingOptions { condition, ..RecordingOptions::default() };
        let reader = ReadingsReader::memory(readings.clone()).unwrap();
        let mut recording = Recording::open(&map, reader, &options).unwrap();
        let options = TrackerOptions { probe, low: probe.low(), ..recording.tracker_options(0) };
        recording.summarise(&options).unwrap();
        while recording.next_step().unwrap().is_some() {}
        let summary = recording.summary().unwrap();
        let whole = summary.totals().find(|(group, _)| *group == Group::Whole).unwrap();
        whole.1.impulse.unwrap()
    };
    let [any, finger] = [Probe::Any, Probe::Finger].map(impulse);
    assert!(any > 1.0 && (finger / any - 1.0).abs() < 0.05, "{any} N s, {finger} N s of a finger");
}
