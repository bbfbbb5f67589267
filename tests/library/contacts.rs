//! Laws of contacts: what presses the skin is found, measured and followed, and nothing else.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::{PI, TAU};
use std::path::Path;
use std::sync::Arc;

use crate::common::data;
use dermatome::id::VertexId;
use dermatome::io::{ReadingsLayout, ReadingsReader, RegionWriter, read_draft};
use dermatome::map::SkinMap;
use dermatome::mesh::{Adjacency, TriMesh, mean_edge_length, shapes};
use dermatome::pipeline::{BuildOptions, build};
use dermatome::pyramid::LevelId;
use dermatome::recording::{Recording, RecordingOptions};
use dermatome::signal::{
    Channel, ConditionOptions, ContactEvent, ContactRegion, ContactTracker, Duplicates, Frame, Quantity,
    Rest, Touch, TouchOptions, TouchSimulation, TrackerOptions, Zero,
};
use dermatome::skin::{AssembleOptions, PatchId, Skin, assemble};
use glam::{DVec2, DVec3};

const SKIN: usize = 0;

fn patch() -> PatchId {
    PatchId::new(SKIN)
}

/// A flat skin of 60 x 60 taxels, 4 mm apart, and its map.
fn plane() -> SkinMap {
    SkinMap::flat(shapes::lattice(60, 60, SPACING), 1e-3)
}

const SPACING: f64 = 0.004;

/// A pressure in Pa.
fn pascals() -> Channel {
    Channel::new("pressure", "Pa").unwrap()
}

fn given(threshold: f64) -> TrackerOptions {
    TrackerOptions { threshold: Some(threshold), ..TrackerOptions::default() }
}

/// Pressures that fall off from their centres as bells of 8 mm, in Pa.
fn bells(map: &SkinMap, bells: &[(DVec2, f64)]) -> Frame {
    let mut frame = Frame::new(map, 1);
    let uv = map.patches[patch()].levels[LevelId::new(0)].opened_uv();
    let pressure = |at: DVec2| {
        bells
            .iter()
            .map(|(centre, height)| height * (-0.5 * (at - *centre).length_squared() / 64e-6).exp())
            .sum()
    };
    frame.values[patch()][0] = uv.map(|&at| pressure(at));
    frame
}

/// Frame `k` of noise about what three taxels next to each other, and all others, read.
fn noisy(map: &SkinMap, k: u32, reading: impl Fn(bool) -> f64) -> Frame {
    let mut frame = Frame::new(map, 1);
    for (taxel, x) in (0_u32..).zip(frame.values[patch()][0].iter_mut()) {
        let noise = f64::from((k * 7919 + taxel * 104_729) % 997) / 997.0;
        *x = noise + reading([70, 71, 130].contains(&taxel));
    }
    frame
}

fn tracks(regions: &[ContactRegion]) -> Vec<(u64, ContactEvent)> {
    regions.iter().map(|region| (region.track, region.event)).collect()
}

/// The contacts of a simulated recording, frame by frame, with what truly happens.
fn contacts_of(
    skin: &Skin,
    map: &SkinMap,
    simulated: &TouchOptions,
    options: &TrackerOptions,
) -> Vec<(Vec<ContactRegion>, Vec<Touch>)> {
    let mut simulation = TouchSimulation::new(skin, simulated).unwrap();
    let mut tracker = ContactTracker::new(map, simulation.channel(), options).unwrap();
    let mut all = Vec::new();
    while let Some((frame, touches)) = simulation.next_frame() {
        all.push((tracker.track(frame).to_vec(), touches.to_vec()));
    }
    all
}

fn present(regions: &[ContactRegion]) -> impl Iterator<Item = &ContactRegion> {
    regions.iter().filter(|region| region.event != ContactEvent::Release)
}

/// Skins of many shapes, taxels 3.5 to 7 mm apart: flat, curved one way and both, tapered with holes.
fn skins() -> Vec<(&'static str, TriMesh)> {
    let forearm = Path::new(env!("CARGO_MANIFEST_DIR")).join("meshes/forearm.glb");
    let forearm = assemble(&read_draft(&forearm).unwrap(), &AssembleOptions::default()).unwrap().skin;
    vec![
        ("plane", shapes::lattice(60, 60, SPACING)),
        ("cap", shapes::cap(4000, 0.1, 0.9)),
        ("tube", shapes::tube(60, 40, 0.05, 0.2)),
        ("saddle", shapes::saddle(50)),
        ("forearm", forearm.patches[patch()].mesh.clone()),
    ]
}

/// How far the centres are from the truth, in taxel spacings: of all contacts of presses of more than
/// three taxels, and of ten and more.
#[derive(Default)]
struct Errors {
    all: Vec<f64>,
    large: Vec<f64>,
}

/// With the threshold estimated from the noise: every press of more than three taxels is one contact
/// from its onset to its release, nothing else is one, and the centre of pressure is near the truth.
#[test]
fn every_press_of_more_than_three_taxels_is_found_and_nothing_else() {
    for (name, mesh) in skins() {
        let spacing = mean_edge_length(&mesh, &Adjacency::new(&mesh).unwrap());
        let skin = Skin::from_mesh("skin", mesh.clone());
        let map = SkinMap::flat(mesh, 1e-3);
        for (quantity, noise, dead, seed) in [
            (Quantity::Intensive, 400.0, 0.0, 5),
            (Quantity::Extensive, 400.0, 0.0, 6),
            (Quantity::Extensive, 0.0, 0.0, 7),
            (Quantity::Intensive, 800.0, 0.05, 8),
            (Quantity::Extensive, 200.0, 0.1, 9),
        ] {
            // Where taxels are far apart a small sphere is between them at times, and felt by none or one.
            let radius = f64::max(0.015, 4.0 * spacing);
            let simulated = TouchOptions {
                quantity,
                noise,
                dead,
                radii: vec![radius],
                presses: 12,
                rate: 50.0,
                seed,
                ..TouchOptions::default()
            };
            let frames = contacts_of(&skin, &map, &simulated, &TrackerOptions::default());
            let what = format!("{name}, {quantity:?}, noise {noise} Pa, {dead} dead, seed {seed}");
            let Errors { all, large } = one_contact_for_each_press(&frames, spacing, &what);
            let mean = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len() as f64;
            println!(
                "{what}: centre off by {:.3} spacings, {:.3} in {} frames from ten taxels on",
                mean(&all),
                mean(&large),
                large.len()
            );
            assert!(all.len() > 200, "{what}: {} frames", all.len());
            assert!(mean(&all) < 1.0, "{what}: {} spacings", mean(&all));
            let is_near = large.is_empty() || mean(&large) < 0.5;
            assert!(is_near, "{what}: {} spacings, of ten taxels or more", mean(&large));
        }
    }
}

/// Checks that presses and contacts belong together.
fn one_contact_for_each_press(
    frames: &[(Vec<ContactRegion>, Vec<Touch>)],
    spacing: f64,
    what: &str,
) -> Errors {
    let (mut most, mut found) = (BTreeMap::<usize, usize>::new(), BTreeMap::<usize, BTreeSet<u64>>::new());
    let mut errors = Errors::default();
    for (regions, touches) in frames {
        let [touch] = touches[..] else {
            assert_eq!(present(regions).count(), 0, "{what}: nothing is touched: {regions:?}");
            continue;
        };
        let taxels = most.entry(touch.press).or_default();
        *taxels = (*taxels).max(touch.taxels);
        assert!(present(regions).count() <= 1, "{what}: one press, at {} s: {regions:?}", touch.time);
        for region in present(regions) {
            found.entry(touch.press).or_default().insert(region.track);
            let error = region.centre.distance(touch.centre) / spacing;
            assert!(error < 3.0, "{what}: {error} spacings from the truth, {} taxels", touch.taxels);
            (touch.taxels > 3).then(|| errors.all.push(error));
            (touch.taxels >= 10).then(|| errors.large.push(error));
        }
    }
    for (press, taxels) in most.into_iter().filter(|(_, taxels)| *taxels > 3) {
        let tracks = found.get(&press).map_or(0, BTreeSet::len);
        assert_eq!(tracks, 1, "{what}: contacts of press {press} of {taxels} taxels");
    }
    errors
}

/// Spheres that press one link at once are as many contacts, each near its own truth, and none takes
/// over the number of another.
#[test]
fn several_touches_at_once_are_as_many_contacts() {
    for (name, mesh) in skins().into_iter().filter(|(name, _)| ["plane", "cap"].contains(name)) {
        let skin = Skin::from_mesh("skin", mesh.clone());
        let map = SkinMap::flat(mesh, 1e-3);
        for (touches, seed) in [(2, 1), (2, 2), (3, 3)] {
            let simulated = TouchOptions {
                touches,
                seed,
                presses: 5,
                rate: 50.0,
                noise: 200.0,
                ..TouchOptions::default()
            };
            let frames = contacts_of(&skin, &map, &simulated, &TrackerOptions::default());
            let mut tracks = BTreeMap::<usize, BTreeSet<u64>>::new();
            let mut together = 0;
            for (regions, now) in &frames {
                let large = now.iter().filter(|touch| touch.taxels > 10);
                let found = present(regions).count();
                let what = format!("{name}, {touches} touches, seed {seed}: {found} regions of {now:?}");
                assert!(found <= now.len() && found >= large.count(), "{what}");
                together += usize::from(found == touches);
                for region in present(regions) {
                    let distance = |touch: &&Touch| region.centre.distance(touch.centre);
                    let nearest = now.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
                    assert!(distance(&nearest) < 0.01, "{what}: {region:?}");
                    tracks.entry(nearest.press).or_default().insert(region.track);
                }
            }
            let all: BTreeSet<u64> = tracks.values().flatten().copied().collect();
            assert!(tracks.values().all(|tracks| tracks.len() == 1), "one contact a press: {tracks:?}");
            assert_eq!(all.len(), tracks.len(), "{name}, seed {seed}: a contact for each press");
            assert!(together > 100, "{name}, seed {seed}: {together} frames of {touches} contacts");
        }
    }
}

#[test]
fn noise_alone_is_no_contact() {
    let mesh = shapes::lattice(30, 30, SPACING);
    let (skin, map) = (Skin::from_mesh("skin", mesh.clone()), SkinMap::flat(mesh, 1e-3));
    for seed in 0..3 {
        let simulated =
            TouchOptions { presses: 0, pause: 20.0, noise: 100.0, seed, ..TouchOptions::default() };
        let frames = contacts_of(&skin, &map, &simulated, &TrackerOptions::default());
        assert!(frames.len() >= 2000);
        let found: Vec<_> = frames.iter().filter(|(regions, _)| !regions.is_empty()).collect();
        assert!(found.is_empty(), "{found:?}");
    }
}

/// Force, centre, axes and angle of a bell are those of its integral.
#[test]
fn a_bell_has_its_force_centre_and_axes() {
    let map = plane();
    let uv = map.patches[patch()].levels[LevelId::new(0)].opened_uv();
    let (centre, turn, [long, short]) = (DVec2::new(0.11, 0.1), 0.5_f64, [0.014, 0.007]);
    let mut frame = Frame::new(&map, 1);
    frame.values[patch()][0] = uv.map(|&at| {
        let along = DVec2::from_angle(-turn).rotate(at - centre) / DVec2::new(long, short);
        3000.0 * (-0.5 * along.length_squared()).exp()
    });
    let options = TrackerOptions { low: 1e-9, ..given(2000.0) };
    let mut tracker = ContactTracker::new(&map, &pascals(), &options).unwrap();
    let regions = tracker.track(&frame);
    let [region] = regions else { panic!("{regions:?}") };
    let near = |what: &str, found: f64, expected: f64, error: f64| {
        assert!((found - expected).abs() <= error * expected, "{what} {found} is not {expected}");
    };
    near("force", region.force, 3000.0 * TAU * long * short, 1e-4);
    near("major axis", region.major, long, 1e-3);
    near("minor axis", region.minor, short, 1e-3);
    near("angle", region.angle, turn, 1e-3);
    assert!(region.map.distance(centre) < 1e-6 && region.centre.distance(centre.extend(0.0)) < 1e-6);
    assert!((region.normal - DVec3::Z).length() < 1e-12);
    let peak = uv.ids().max_by(|&a, &b| frame.values[patch()][0][a].total_cmp(&frame.values[patch()][0][b]));
    assert_eq!(Some(region.peak_taxel), peak);
    assert_eq!(region.peak, frame.values[patch()][0][region.peak_taxel]);
}

/// On curved skin the centre of pressure lies on the skin, and its place on the map is that of the
/// same point.
#[test]
fn the_centre_of_pressure_lies_on_the_skin() {
    let map = build(&Skin::from_mesh("palm", shapes::cap(800, 0.05, 1.0)), &BuildOptions::default()).unwrap();
    let level = &map.patches[patch()].levels[LevelId::new(0)];
    let mut tracker = ContactTracker::new(&map, &pascals(), &given(1000.0)).unwrap();
    for (seed, at) in level.opened_uv().enumerate().step_by(17) {
        let frame = bells(&map, &[(*at, 5000.0)]);
        let regions = tracker.track(&frame);
        let region = regions.iter().find(|region| region.taxels.contains(&seed)).unwrap();
        let distance = region.centre.length() - 0.05;
        assert!(distance.abs() < 2e-4, "{distance} m from the sphere");
        assert!(region.normal.dot(region.centre.normalize()) > 0.99, "{region:?}");
        // The map of a cap is nearly isometric.
        let off = region.map.distance(*at) - region.centre.distance(level.level.mesh.positions[seed]);
        assert!(off.abs() < 1e-3, "{off} m");
        assert!(region.angle > -PI / 2.0 && region.angle <= PI / 2.0);
    }
}

/// Two touches on one link stay two, also while they move round each other.
#[test]
fn two_touches_on_one_link_stay_two() {
    let map = plane();
    let mut tracker = ContactTracker::new(&map, &pascals(), &given(1000.0)).unwrap();
    for step in 0..200 {
        let arm = 0.025 * DVec2::from_angle(0.05 * f64::from(step));
        let centres = [DVec2::new(0.12, 0.1) + arm, DVec2::new(0.12, 0.1) - arm];
        let regions = tracker.track(&bells(&map, &[(centres[0], 4000.0), (centres[1], 5000.0)]));
        assert_eq!(regions.len(), 2, "step {step}");
        let event = if step == 0 { ContactEvent::Onset } else { ContactEvent::Move };
        for region in regions {
            assert_eq!(region.event, event);
            let track = if region.map.distance(centres[0]) < SPACING { 0 } else { 1 };
            assert!(region.map.distance(centres[track]) < SPACING, "step {step}");
            let first = if step == 0 { region.track } else { 0 };
            assert!(first < 2 && region.track < 2, "step {step}");
        }
        assert_ne!(regions[0].track, regions[1].track);
    }
}

/// Two presses so near that their regions touch are two as long as each rises by half of its height
/// above the saddle; their taxels are those of the whole region.
#[test]
fn touches_that_touch_are_split_at_the_saddle() {
    let map = plane();
    let near = |apart: f64, heights: [f64; 2]| {
        let at = |side: f64| DVec2::new(0.11 + side * apart / 2.0, 0.1);
        bells(&map, &[(at(-1.0), heights[0]), (at(1.0), heights[1])])
    };
    let regions = |frame: &Frame, prominence: f64| {
        let options = TrackerOptions { prominence, ..given(1000.0) };
        let mut tracker = ContactTracker::new(&map, &pascals(), &options).unwrap();
        tracker.track(frame).to_vec()
    };
    // The saddle is at 0.3 of the lower peak.
    let frame = near(0.032, [5000.0, 4000.0]);
    let whole = regions(&frame, 1.0);
    assert_eq!(whole.len(), 1, "one region above the lower threshold");
    let parts = regions(&frame, 0.5);
    assert_eq!(parts.len(), 2);
    let mut taxels: Vec<_> = parts.iter().flat_map(|part| part.taxels.clone()).collect();
    taxels.sort_unstable();
    assert_eq!(taxels, whole[0].taxels, "every taxel is in one part");
    for side in [-1.0, 1.0] {
        let centre = DVec2::new(0.11 + side * 0.016, 0.1);
        let off = parts.iter().map(|part| part.map.distance(centre)).fold(f64::INFINITY, f64::min);
        assert!(off < 0.5 * SPACING, "{off} m from the press");
    }
    assert_eq!(regions(&frame, 0.8).len(), 1, "a rise of 0.7 is not 0.8");
    assert_eq!(regions(&near(0.024, [5000.0, 4000.0]), 0.5).len(), 1, "the saddle is at 0.7 of the peak");
    // A part that is too small leaves nothing of itself in the regions of later frames.
    let least = parts.iter().map(|part| part.taxels.len()).max().unwrap();
    let options = TrackerOptions { least, ..given(1000.0) };
    let mut tracker = ContactTracker::new(&map, &pascals(), &options).unwrap();
    let first: Vec<_> = present(tracker.track(&frame)).map(|part| part.taxels.clone()).collect();
    assert_eq!(first.len(), 1, "the other part is too small");
    for _ in 0..3 {
        assert!(present(tracker.track(&frame)).map(|part| &part.taxels).eq(&first));
    }
    // A spike beside a press is no contact of its own, however high it is.
    let mut frame = near(0.0, [2000.0, 2000.0]);
    let uv = map.patches[patch()].levels[LevelId::new(0)].opened_uv();
    let off = |v: &VertexId| uv[*v].distance(DVec2::new(0.124, 0.1));
    let spike = uv.ids().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap();
    assert!(frame.values[patch()][0][spike] > 500.0, "at the flank of the press");
    for height in [3900.0, 1e5] {
        frame.values[patch()][0][spike] = height;
        assert_eq!(regions(&frame, 0.5).len(), 1, "a spike of {height} Pa");
    }
}

/// Where two contacts merge, the larger one goes on and the other ends; where one splits, its larger
/// part goes on and the other is new. What has ended says how it was.
#[test]
fn contacts_merge_split_and_end() {
    let map = plane();
    let mut tracker = ContactTracker::new(&map, &pascals(), &given(1000.0)).unwrap();
    let at = |x: f64| DVec2::new(x, 0.1);
    let two = |apart: f64| bells(&map, &[(at(0.11 - apart / 2.0), 3000.0), (at(0.11 + apart / 2.0), 9000.0)]);
    use ContactEvent::{Move, Onset, Release};
    let start = tracker.track(&two(0.06)).to_vec();
    assert_eq!(start.iter().map(|r| r.event).collect::<Vec<_>>(), [Onset, Onset]);
    let large = start.iter().max_by_key(|region| region.taxels.len()).unwrap().track;
    let small = 1 - large;
    assert_eq!(tracks(tracker.track(&two(0.02))), [(large, Move), (small, Release)]);
    assert_eq!(tracks(tracker.track(&two(0.02))), [(large, Move)], "an end is reported once");
    let split = tracker.track(&two(0.06)).to_vec();
    let events: BTreeSet<_> =
        split.iter().map(|r| (r.track, r.event == Onset, r.taxels.len() > 20)).collect();
    assert_eq!(
        events,
        BTreeSet::from([
            (large, false, true),
            (2, true, split.iter().any(|r| r.track == 2 && r.taxels.len() > 20))
        ])
    );
    let ended = tracker.track(&bells(&map, &[])).to_vec();
    let expected: Vec<_> =
        split.iter().map(|region| ContactRegion { event: Release, ..region.clone() }).collect();
    assert_eq!(ended, expected, "how they were in the frame before");
    assert!(tracker.track(&bells(&map, &[])).is_empty());
}

/// A contact that jumps by less than the reach is the same, one that jumps farther is not.
#[test]
fn a_contact_may_move_by_the_reach() {
    let map = plane();
    for (jump, is_same) in [(0.035, true), (0.045, false)] {
        let options = TrackerOptions { reach: 0.04, ..given(2900.0) };
        let mut tracker = ContactTracker::new(&map, &pascals(), &options).unwrap();
        tracker.track(&bells(&map, &[(DVec2::new(0.05, 0.1), 3000.0)]));
        let tracks = tracks(tracker.track(&bells(&map, &[(DVec2::new(0.05 + jump, 0.1), 3000.0)])));
        let moved = [(0, ContactEvent::Move)];
        let new = [(1, ContactEvent::Onset), (0, ContactEvent::Release)];
        assert_eq!(tracks, if is_same { &moved[..] } else { &new[..] }, "{jump} m");
    }
}

/// With `lasting`, short contacts are not reported at all, others from then on.
#[test]
fn short_contacts_are_not_reported_if_so_asked() {
    let map = plane();
    let options = TrackerOptions { lasting: 3, ..given(1000.0) };
    let mut tracker = ContactTracker::new(&map, &pascals(), &options).unwrap();
    let (pressed, free) = (bells(&map, &[(DVec2::new(0.1, 0.1), 3000.0)]), bells(&map, &[]));
    let mut events = Vec::new();
    for is_pressed in [true, true, false, true, true, true, true, false, false] {
        events.push(tracks(tracker.track(if is_pressed { &pressed } else { &free })));
    }
    use ContactEvent::{Move, Onset, Release};
    let none = Vec::new();
    let expected = [
        none.clone(),
        none.clone(),
        none.clone(),
        none.clone(),
        none.clone(),
        vec![(0, Onset)],
        vec![(0, Move)],
        vec![(0, Release)],
        none,
    ];
    assert_eq!(events, expected);
}

/// What is found in a frame does not depend on the frames before; a recording gives the same
/// contacts each time.
#[test]
fn regions_depend_on_their_frame_alone() {
    let mesh = shapes::lattice(40, 40, SPACING);
    let (skin, map) = (Skin::from_mesh("skin", mesh.clone()), SkinMap::flat(mesh, 1e-3));
    let simulated = TouchOptions { noise: 500.0, dead: 0.1, rate: 20.0, ..TouchOptions::default() };
    let options = given(0.02);
    let once = contacts_of(&skin, &map, &simulated, &options);
    assert_eq!(once, contacts_of(&skin, &map, &simulated, &options));
    let mut simulation = TouchSimulation::new(&skin, &simulated).unwrap();
    let channel = simulation.channel().clone();
    for (regions, _) in &once {
        let (frame, _) = simulation.next_frame().unwrap();
        let mut new = ContactTracker::new(&map, &channel, &options).unwrap();
        let alone = new.track(frame);
        let untracked = present(regions).zip(alone).map(|(region, other)| ContactRegion {
            track: other.track,
            event: other.event,
            age: other.age,
            ..region.clone()
        });
        assert!(untracked.eq(alone.iter().cloned()), "the same regions");
        assert_eq!(present(regions).count(), alone.len());
    }
}

/// Taxels without a reading belong to no region, but do not cut one in two.
#[test]
fn a_dead_taxel_does_not_cut_a_contact() {
    let map = plane();
    let mut frame = bells(&map, &[]);
    let pressure = &mut frame.values[patch()][0];
    let row: Vec<_> = (0..5).map(|k| VertexId::new(60 * 30 + 20 + k)).collect();
    row.iter().for_each(|&taxel| pressure[taxel] = 3000.0);
    pressure[row[2]] = f64::NAN;
    let mut tracker = ContactTracker::new(&map, &pascals(), &given(1000.0)).unwrap();
    let regions = tracker.track(&frame);
    assert_eq!(regions.len(), 1);
    assert_eq!(regions[0].taxels, [row[0], row[1], row[3], row[4]]);
    frame.values[patch()][0][row[3]] = f64::INFINITY;
    let regions = tracker.track(&frame);
    assert_eq!(present(regions).count(), 1, "two dead taxels are a gap, one taxel alone a spike");
    assert_eq!(regions[0].taxels, [row[0], row[1]]);
}

/// A taxel that does not rest at zero is no contact, nor are its neighbours.
#[test]
fn taxels_that_do_not_rest_at_zero_are_no_contact() {
    let map = plane();
    let mut tracker = ContactTracker::new(&map, &pascals(), &TrackerOptions::default()).unwrap();
    for k in 0..40 {
        let frame = noisy(&map, k, |is_other| if is_other { 500.0 } else { 0.0 });
        assert_eq!(tracker.track(&frame).len(), 0, "frame {k}");
    }
}

/// Nobody knows where taxels are at rest that answer after the first frames: they are no contact.
#[test]
fn taxels_that_answer_late_are_no_contact() {
    let map = plane();
    let mut tracker = ContactTracker::new(&map, &pascals(), &TrackerOptions::default()).unwrap();
    for k in 0..40 {
        let frame = noisy(&map, k, |is_late| if is_late && k < 8 { f64::NAN } else { 3000.0 });
        assert_eq!(tracker.track(&frame).len(), 0, "frame {k}");
    }
}

/// A press with which a recording about zero begins is no noise: the threshold is what it is a second later.
#[test]
fn a_press_in_the_first_frames_is_no_noise() {
    let map = plane();
    let options = TrackerOptions { rest: Rest::AtZero, ..TrackerOptions::default() };
    for before in 0..6_u32 {
        let mut tracker = ContactTracker::new(&map, &pascals(), &options).unwrap();
        for k in 0..30_u32 {
            let height = 1e5 * (f64::from((k + 1).saturating_sub(before)) / 12.0).min(1.0);
            let mut frame = bells(&map, &[(DVec2::new(0.11, 0.1), height)]);
            frame.values[patch()][0].iter_mut().for_each(|x| *x = x.round());
            tracker.track(&frame);
        }
        let threshold = tracker.threshold().unwrap();
        assert!(threshold < 1.0, "{before} frames before: {threshold} Pa");
        assert_eq!(present(tracker.contacts()).count(), 1, "{before} frames before");
    }
}

/// Force is in newtons whatever the prefix, and unknown without a unit of force or pressure.
#[test]
fn force_follows_from_the_unit() {
    let map = plane();
    let force = |unit: &str, scale: f64| {
        let channel = Channel::new("pressure", unit).unwrap();
        let mut tracker = ContactTracker::new(&map, &channel, &given(1000.0 * scale)).unwrap();
        tracker.track(&bells(&map, &[(DVec2::new(0.1, 0.1), 3000.0 * scale)]))[0].force
    };
    let newtons = force("Pa", 1.0);
    assert!((force("kPa", 1e-3) / newtons - 1.0).abs() < 1e-12 && newtons > 0.0, "{newtons} N");
    assert!(force("", 1.0).is_nan() && force("count", 1.0).is_nan());
}

#[test]
fn invalid_options_are_refused() {
    let map = plane();
    for options in [
        given(0.0),
        given(f64::NAN),
        TrackerOptions { low: 0.0, ..given(1.0) },
        TrackerOptions { low: 1.5, ..given(1.0) },
        TrackerOptions { reach: f64::NAN, ..given(1.0) },
        TrackerOptions { prominence: 0.0, ..given(1.0) },
        TrackerOptions { prominence: f64::NAN, ..given(1.0) },
        TrackerOptions { noise_frames: 1, ..TrackerOptions::default() },
        TrackerOptions { noise_frames: usize::MAX, ..TrackerOptions::default() },
    ] {
        let error = ContactTracker::new(&map, &pascals(), &options).unwrap_err().to_string();
        assert!(error.contains("is needed"), "{error}");
    }
}

/// The table has the columns of the documentation and a row for each contact of each frame.
#[test]
fn regions_are_written_as_a_table() {
    let map = Arc::new(plane());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("contacts.csv");
    let mut writer = RegionWriter::create(&path, &map).unwrap();
    let mut tracker = ContactTracker::new(&map, &pascals(), &given(1000.0)).unwrap();
    for (number, height) in [3000.0, 4000.0, 0.0, 0.0].into_iter().enumerate() {
        let regions = tracker.track(&bells(&map, &[(DVec2::new(0.1, 0.1), height)]));
        writer.write(number as u64, 0.25 * number as f64, regions).unwrap();
    }
    assert!(!path.exists(), "not before it is finished");
    writer.finish().unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let columns = "frame,time,track,event,patch,link,taxels,area,force,x,y,z,nx,ny,nz,u,v,major,minor,angle,\
                   peak_taxel_id,peak,region";
    assert_eq!(text.lines().next(), Some(columns));
    let events: Vec<_> = text.lines().skip(1).map(|row| row.split(',').nth(3).unwrap()).collect();
    assert_eq!(events, ["onset", "move", "release"]);
    let mut writer = RegionWriter::create(&path, &map).unwrap();
    let regions = tracker.track(&bells(&map, &[(DVec2::new(0.1, 0.1), 3000.0)]));
    writer.write(0, f64::NAN, regions).unwrap();
    writer.finish().unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains("\n0,,1,onset,"), "a time that is not known is an empty cell: {text}");
    assert!(RegionWriter::create(&folder.path().join("contacts.txt"), &map).is_err());
}

/// Recordings of 0 to 5 fingers on a real cover, if they are here: the share of frames in which as
/// many contacts are found as fingers press, with the same options for all. How regions are split was
/// chosen after these recordings were seen.
#[test]
fn fingers_on_a_real_cover() {
    let Some(folder) = data("cyskin") else { return };
    let draft = read_draft(&folder.join("curved_gesture_patch_isomap.json")).unwrap();
    let skin = assemble(&draft, &AssembleOptions::default()).unwrap().skin;
    let map = Arc::new(build(&skin, &BuildOptions::default()).unwrap());
    let (mut agree, mut of, mut recordings) = (0, 0, Vec::new());
    for fingers in 0..=5 {
        let path = folder.join(format!("recordings/{fingers}_finger_01.txt"));
        let counts = count_contacts(&path, &map);
        // Frames before and after the touch say nothing, but if nothing touches the cover all do.
        let looked_at = counts.iter().filter(|frame| fingers == 0 || !frame.is_empty());
        let right = looked_at.clone().filter(|frame| frame.len() == fingers).count();
        let all = looked_at.count();
        let numbers: Vec<_> = counts.iter().map(Vec::len).collect();
        println!("{fingers} fingers: {right} of {all} frames: {numbers:?}");
        (agree, of) = (agree + right, of + all);
        if 2 * right > all {
            recordings.push(fingers);
        }
        let largest = counts.iter().flatten().max().copied().unwrap_or(0);
        assert_eq!(largest > 3, fingers > 0, "{fingers} fingers: {largest} taxels");
    }
    println!("{agree} of {of} frames agree, and most of the frames of recordings {recordings:?}");
    // Three fingers side by side have two peaks, and five fingers touch with more than their tips.
    assert!(of == 85 && agree >= 52, "{agree} of {of} frames agree");
    assert_eq!(recordings, [0, 1, 4], "recordings most of whose frames agree");
}

/// Number of taxels of the contacts in each frame of a recording.
fn count_contacts(path: &Path, map: &Arc<SkinMap>) -> Vec<Vec<usize>> {
    let reader = ReadingsReader::open(path, ReadingsLayout::default()).unwrap();
    let options = RecordingOptions {
        duplicates: Duplicates::First,
        condition: ConditionOptions { zero: Zero::First(5), ..ConditionOptions::default() },
        ..RecordingOptions::default()
    };
    let mut recording = Recording::open(map, reader, &options).unwrap();
    assert_eq!(recording.report().join.matched, 634);
    recording.follow_contacts(&recording.tracker_options(0)).unwrap();
    let mut counts = Vec::new();
    while let Some(step) = recording.next_step().unwrap() {
        counts.push(present(step.contacts).map(|region| region.taxels.len()).collect());
    }
    println!("threshold {:.0}", recording.threshold().unwrap());
    counts
}
