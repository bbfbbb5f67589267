//! Laws of the health of taxels: faults that a recording shows are found with what shows them, and healthy taxels
//! are not accused.

mod rates;

use std::sync::Arc;

use dermatome::Error;
use dermatome::id::VertexId;
use dermatome::io::{Readings, ReadingsReader};
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::recording::{Recording, RecordingOptions, examine};
use dermatome::signal::{
    Channel, ConditionOptions, FaultCounts, Frame, Health, HealthFinding, HealthOptions, HealthReport,
    Quantity, ReadoutOptions, Response, Scale, SignalError, TaxelResponse, TaxelState, TouchOptions,
    TouchSimulation, Zero,
};
use dermatome::skin::{PatchId, Skin, TaxelId};

use crate::common;

/// 144 taxels, 6 mm apart.
fn sheet() -> Skin {
    Skin::from_mesh("sheet", shapes::lattice(12, 12, 0.006))
}

/// 100 presses at 25 Hz on taxels whose gains differ.
fn presses(faults: FaultCounts, seed: u64) -> TouchOptions {
    TouchOptions {
        radii: vec![0.02],
        presses: 100,
        pause: 0.0,
        rate: 25.0,
        quantity: Quantity::Intensive,
        noise: 2000.0,
        seed,
        readout: ReadoutOptions { gain_spread: 0.3, faults, ..ReadoutOptions::default() },
        ..TouchOptions::default()
    }
}

fn record(skin: &Skin, options: &TouchOptions) -> (Readings, Response) {
    let mut simulation = TouchSimulation::new(skin, options).unwrap();
    let width = skin.patches.iter().map(|patch| patch.mesh.positions.len()).sum();
    let mut readings =
        Readings { channels: vec![simulation.channel().clone()], width, ..Readings::default() };
    while let Some((frame, _)) = simulation.next_frame() {
        readings.times.push(frame.time);
        readings.values.extend(frame.values.iter().flat_map(|patch| patch[0].iter().copied()));
    }
    (readings, simulation.response().clone())
}

fn judge(skin: &Skin, recordings: &[Readings], options: &HealthOptions) -> Result<HealthReport, Error> {
    let map = Arc::new(SkinMap::of_taxels(skin));
    examine(&map, options, recordings.len(), |number, zero| {
        let condition = ConditionOptions { zero, ..ConditionOptions::default() };
        let options = RecordingOptions { condition, ..RecordingOptions::default() };
        Ok(Recording::open(&map, ReadingsReader::memory(recordings[number].clone())?, &options)?)
    })
}

fn found(report: &HealthReport, kind: TaxelState) -> impl Iterator<Item = &HealthFinding> {
    report.findings.iter().filter(move |finding| finding.kind == kind)
}

#[test]
fn healthy_taxels_are_not_accused() {
    let skin = sheet();
    for seed in 0..2 {
        let (readings, _) = record(&skin, &presses(FaultCounts::default(), seed));
        let report = judge(&skin, &[readings], &HealthOptions::default()).unwrap();
        assert_eq!(report.findings, [], "seed {seed}");
        assert!(report.tested > 130 && report.taxels == 144, "{} tested", report.tested);
        assert!((7000.0..10_000.0).contains(&report.threshold), "{} Pa", report.threshold);
    }
}

/// Every fault that changes all readings is found, most of those that only touches show, and none elsewhere.
#[test]
fn faults_are_found_where_they_are() {
    let skin = sheet();
    let counts = [
        (TaxelState::Dead, 2),
        (TaxelState::Silent, 2),
        (TaxelState::Stuck, 2),
        (TaxelState::Noisy, 2),
        (TaxelState::Jumping, 2),
        (TaxelState::Chattering, 1),
        (TaxelState::Saturated, 2),
        (TaxelState::Swapped, 2),
        (TaxelState::Crosstalk, 1),
    ];
    let faults = counts.iter().fold(FaultCounts::default(), |all, &(kind, count)| all.with(kind, count));
    let (readings, truth) = record(&skin, &presses(faults, 5));
    let report = judge(&skin, &[readings], &HealthOptions::default()).unwrap();
    let is_true = |finding: &HealthFinding| {
        let mut own = truth.taxels.iter().filter(|known| finding.taxels.contains(&known.taxel));
        own.all(|known| known.state == finding.kind)
    };
    for finding in &report.findings {
        assert!(is_true(finding), "{finding}");
        assert!(finding.evidence.iter().all(|(_, x)| x.is_finite()) && !finding.evidence.is_empty());
    }
    for (kind, count) in counts {
        let (least, most) = match kind {
            TaxelState::Swapped => (2, 2 * count),
            TaxelState::Jumping => (1, count),
            // Few taxels are surrounded by touches often enough.
            TaxelState::Silent => (0, count),
            _ => (count, count),
        };
        let found = found(&report, kind).count();
        assert!((least..=most).contains(&found), "{found} of {most} {kind}: {:?}", report.findings);
    }
    let other = |id: TaxelId| truth.taxels.iter().find(|known| known.taxel == id).unwrap().other;
    for leak in found(&report, TaxelState::Crosstalk) {
        assert_eq!(leak.other, other(leak.taxels[0]), "the direction of {leak}");
        assert!(
            (0.2..1.5).contains(&leak.evidence("share").unwrap()),
            "half, times the ratio of gains: {leak}"
        );
    }
    let state = |id: TaxelId| report.response.taxels.iter().find(|known| known.taxel == id).unwrap().state;
    assert!(report.findings.iter().all(|finding| state(finding.taxels[0]) >= finding.kind));
}

/// A step of a module is one finding, and so is a module that is mounted turned; both need to know the modules.
#[test]
fn modules_are_judged_as_a_whole() {
    let skin = sheet();
    let step = presses(FaultCounts::default().with(TaxelState::ModuleStep, 1), 3);
    let (readings, truth) = record(&skin, &step);
    let members = truth.taxels.iter().filter(|known| known.state == TaxelState::ModuleStep);
    let modules: Vec<_> = members.map(|known| (known.taxel, "5".to_owned())).collect();
    let report = judge(&skin, &[readings], &HealthOptions { modules, ..HealthOptions::default() }).unwrap();
    assert_eq!(report.findings.len(), 1, "{:?}", report.findings);
    assert_eq!((report.findings[0].kind, report.findings[0].taxels.len()), (TaxelState::ModuleStep, 12));

    // The seven taxels of a hexagon; turned by 120 degrees, each of the outer ones reads at the place of another one.
    let mesh = &skin.patches[PatchId::new(0)].mesh;
    let distance =
        |k: &usize| mesh.positions[VertexId::new(*k)].distance(mesh.positions[VertexId::new(12 * 6 + 5)]);
    let mut hexagon: Vec<usize> = (0..144).filter(|k| distance(k) < 0.0065).collect();
    let angle = |k: &usize| {
        let away = mesh.positions[VertexId::new(*k)] - mesh.positions[VertexId::new(12 * 6 + 5)];
        away.y.atan2(away.x)
    };
    hexagon.retain(|k| *k != 12 * 6 + 5);
    hexagon.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    assert_eq!(hexagon.len(), 6);
    let ids = &skin.patches[PatchId::new(0)].taxels.ids;
    let module = hexagon.iter().chain(&[12 * 6 + 5]).map(|&k| (ids[VertexId::new(k)], "a".to_owned()));
    let options = HealthOptions { modules: module.collect(), ..HealthOptions::default() };
    let (plain, _) = record(&skin, &presses(FaultCounts::default(), 4));
    let report = judge(&skin, std::slice::from_ref(&plain), &options).unwrap();
    assert_eq!(report.findings, []);
    let mut turned = plain.clone();
    for (own, was) in turned.values.chunks_exact_mut(144).zip(plain.values.chunks_exact(144)) {
        (0..6).for_each(|k| own[hexagon[k]] = was[hexagon[(k + 2) % 6]]);
    }
    let report = judge(&skin, &[turned], &options).unwrap();
    assert_eq!(report.findings.len(), 1, "{:?}", report.findings);
    assert_eq!(report.findings[0].kind, TaxelState::Turned);
    assert_eq!(report.findings[0].evidence("degrees"), Some(120.0));
}

/// A taxel and those around it that are turned together are one finding, by the angle of the truth.
#[test]
fn turned_modules_are_named() {
    let skin = sheet();
    let patch = &skin.patches[PatchId::new(0)];
    for seed in [1, 2, 3] {
        let (readings, truth) =
            record(&skin, &presses(FaultCounts::default().with(TaxelState::Turned, 1), seed));
        let members: Vec<_> = truth.taxels.iter().filter(|known| known.state == TaxelState::Turned).collect();
        let place = |id: TaxelId| {
            let mut of_ids = patch.taxels.ids.enumerate();
            patch.mesh.positions[of_ids.find(|(_, other)| **other == id).unwrap().0]
        };
        let centre = members.iter().map(|known| place(known.taxel)).sum::<glam::DVec3>() / 7.0;
        let moved = members.iter().find_map(|known| Some((known.taxel, known.other?))).unwrap();
        let [from, to] = [moved.0, moved.1].map(|id| place(id) - centre);
        let degrees = from.cross(to).z.atan2(from.dot(to)).to_degrees().rem_euclid(360.0);
        let modules = members.iter().map(|known| (known.taxel, "a".to_owned())).collect();
        let options = HealthOptions { modules, ..HealthOptions::default() };
        let report = judge(&skin, &[readings], &options).unwrap();
        assert_eq!(report.findings.len(), 1, "seed {seed}: {:?}", report.findings);
        let finding = &report.findings[0];
        assert_eq!((finding.kind, finding.taxels.len()), (TaxelState::Turned, 7), "seed {seed}");
        let found = finding.evidence("degrees").unwrap();
        assert!((found - degrees).abs() < 1.0, "seed {seed}: {found} of {degrees}");
    }
}

/// Silent taxels that touches reach are found, and swapped ones are never called silent.
#[test]
fn silent_and_swapped_taxels_are_told_apart() {
    let skin = sheet();
    let [mut silent, mut swapped] = [0, 0];
    for seed in 20..24 {
        let faults = FaultCounts::default().with(TaxelState::Silent, 4).with(TaxelState::Swapped, 4);
        let (readings, truth) = record(&skin, &TouchOptions { presses: 150, ..presses(faults, seed) });
        let report = judge(&skin, &[readings], &HealthOptions::default()).unwrap();
        for finding in &report.findings {
            let known = truth.taxels.iter().find(|known| finding.taxels == [known.taxel]).unwrap();
            assert_eq!(known.state, finding.kind, "seed {seed}: {finding}");
        }
        silent += found(&report, TaxelState::Silent).count();
        swapped += found(&report, TaxelState::Swapped).count();
    }
    // Three touches on both sides of one are needed; a third of the taxels is at the boundary.
    assert!(silent >= 5 && swapped >= 26, "{silent} of 16 silent, {swapped} of 32 swapped");
}

/// The result does not depend on how frames are divided into recordings, but for touches that are divided.
#[test]
fn recordings_add_up() {
    let skin = sheet();
    let faults = FaultCounts::default().with(TaxelState::Swapped, 2).with(TaxelState::Dead, 2);
    let (whole, _) = record(&skin, &presses(faults, 7));
    let part = |range: std::ops::Range<usize>| Readings {
        times: whole.times[range.clone()].to_vec(),
        values: whole.values[144 * range.start..144 * range.end].to_vec(),
        ..whole.clone()
    };
    let frames = whole.times.len();
    let parts = [part(0..frames / 2), part(frames / 2..frames)];
    let kinds = |report: &HealthReport| {
        report.findings.iter().map(|f| (f.kind, f.taxels.clone(), f.other)).collect::<Vec<_>>()
    };
    let [one, two] =
        [&[whole.clone()][..], &parts].map(|all| judge(&skin, all, &HealthOptions::default()).unwrap());
    assert_eq!(kinds(&one), kinds(&two));
    assert_eq!((one.frames, one.recordings, two.frames, two.recordings), (frames, 1, frames, 2));
}

/// Without evidence taxels are untested, which is not a fault; what cannot be judged is refused.
#[test]
fn nothing_is_judged_without_evidence() {
    let skin = sheet();
    let all = |value: &dyn Fn(usize) -> f64| Readings {
        channels: vec![Channel::new("pressure", "Pa").unwrap()],
        width: 144,
        times: (0..200).map(|k| 0.04 * f64::from(k)).collect(),
        values: (0..200 * 144).map(value).collect(),
        ..Readings::default()
    };
    let noise = |k: usize| ((k * 7919) % 1009) as f64;
    let options = HealthOptions::default();
    let touched = |k: usize| (60..80).contains(&(k % 144));
    let cases = [
        ("no touch", all(&noise)),
        ("one touch for ever", all(&|k| noise(k) + if touched(k) { 3e4 } else { 0.0 })),
        ("all saturated", all(&|_| 65_535.0)),
        ("one touch", all(&|k| noise(k) + if touched(k) && k / 144 > 100 { 3e4 } else { 0.0 })),
    ];
    for (name, readings) in cases {
        let report = judge(&skin, &[readings], &options).unwrap();
        assert_eq!(report.findings, [], "{name}");
        assert_eq!((report.tested, report.taxels), (0, 144), "{name}");
        assert!(report.response.taxels.iter().all(|known| known.state == TaxelState::Untested), "{name}");
    }
    let inverted = TouchOptions {
        readout: ReadoutOptions { is_inverted: true, ..ReadoutOptions::default() },
        ..presses(FaultCounts::default(), 9)
    };
    let report = judge(&skin, &[record(&skin, &inverted).0], &options).unwrap();
    assert_eq!(report.findings, [], "falling readings, {} tested", report.tested);
    let missing = judge(&skin, &[all(&|_| f64::NAN)], &options).unwrap();
    assert_eq!(found(&missing, TaxelState::Dead).count(), 144);
    let empty = Readings { times: vec![], values: vec![], ..all(&noise) };
    assert!(matches!(judge(&skin, &[empty], &options), Err(Error::Signal(SignalError::NoFrames))));
    assert!(matches!(judge(&skin, &[], &options), Err(Error::Signal(SignalError::NoFrames))));
    let warm = Readings { channels: vec![Channel::new("temperature", "degC").unwrap()], ..all(&noise) };
    assert!(matches!(judge(&skin, &[warm], &options), Err(Error::Signal(SignalError::NoTouch { .. }))));
    let foreign = Readings { ids: Some((5000..5144).map(TaxelId).collect()), ..all(&noise) };
    assert!(matches!(
        judge(&skin, &[foreign], &options),
        Err(Error::Signal(SignalError::NoneMatched { .. }))
    ));
    let few = Readings {
        ids: Some(vec![TaxelId(5)]),
        width: 1,
        values: (0..200).map(noise).collect(),
        ..all(&noise)
    };
    let report = judge(&skin, &[few], &options).unwrap();
    assert_eq!((report.taxels, report.without_readings, report.findings.len()), (1, 143, 0));
    for bad in [
        HealthOptions { threshold: Some(0.0), ..options.clone() },
        HealthOptions { threshold: Some(f64::NAN), ..options.clone() },
        HealthOptions { modules: vec![(TaxelId(9999), "a".into())], ..options.clone() },
    ] {
        assert!(matches!(judge(&skin, &[all(&noise)], &bad), Err(Error::Signal(SignalError::Option { .. }))));
    }
}

/// Of several channels that of the normal force is judged, wherever it stands.
#[test]
fn forces_along_the_skin_are_not_judged() {
    let skin = sheet();
    let (pressed, truth) = record(&skin, &presses(FaultCounts::default().with(TaxelState::Dead, 2), 5));
    let along = |k: usize| ((k * 7919) % 1009) as f64;
    let rows = pressed.values.chunks(144).enumerate();
    let beside = rows
        .flat_map(|(frame, row)| (0..144).map(move |k| along(144 * frame + k)).chain(row.iter().copied()));
    let both = Readings {
        channels: vec![Channel::new("force.x", "N").unwrap(), pressed.channels[0].clone()],
        values: beside.collect(),
        ..pressed.clone()
    };
    let dead = |readings: Readings| {
        let report = judge(&skin, &[readings], &HealthOptions::default()).unwrap();
        found(&report, TaxelState::Dead).map(|finding| finding.taxels.clone()).collect::<Vec<_>>()
    };
    let expected = dead(pressed);
    assert_eq!(expected.len(), truth.taxels.iter().filter(|taxel| taxel.state == TaxelState::Dead).count());
    assert_eq!(dead(both), expected);
}

/// Real recordings with two known faults: the module of taxels 58848 to 58859 is stepped, and 59282 jumps alone.
#[test]
fn known_faults_of_a_real_cover_are_found() {
    let Some((skin, readings)) =
        common::data("cyskin/curved_gesture_patch_isomap.json").zip(common::data("cyskin/fingers.npz"))
    else {
        return;
    };
    let draft = dermatome::io::read_draft(&skin).unwrap();
    let skin = dermatome::skin::assemble(&draft, &dermatome::skin::AssembleOptions::default()).unwrap().skin;
    let arrays: Vec<_> = common::fingers(&readings).into_iter().map(|(_, readings)| readings).collect();
    let ids = skin.patches.iter().flat_map(|patch| patch.taxels.ids.iter().copied());
    let modules = ids.map(|id| (id, (id.0 >> 4).to_string())).collect();
    let options = HealthOptions { zero: Zero::At(0.0), threshold: Some(1500.0), modules };
    let report = judge(&skin, &arrays, &options).unwrap();
    let step: Vec<_> = found(&report, TaxelState::ModuleStep).collect();
    assert_eq!(step.len(), 1, "{:?}", report.findings);
    assert!(step[0].taxels.iter().all(|id| (58_848..=58_859).contains(&id.0)));
    assert!(found(&report, TaxelState::Chattering).any(|finding| finding.taxels == [TaxelId(59_282)]));
    let other =
        report.findings.iter().filter(|f| f.kind != TaxelState::ModuleStep && f.taxels != [TaxelId(59_282)]);
    assert!(other.count() * 200 <= report.taxels, "{:?}", report.findings);
}

/// A fifth of the skin that repeats one reading for ever is dead, unless that is what the others read at rest.
#[test]
fn constant_readings_are_a_fault_unless_others_rest_there() {
    let skin = sheet();
    let (plain, _) = record(&skin, &presses(FaultCounts::default(), 1));
    let with = |rest: f64, constant: f64| {
        let mut readings = plain.clone();
        for frame in readings.values.chunks_exact_mut(144) {
            frame.iter_mut().for_each(|x| *x = (*x + rest).max(0.0));
            frame[..40].fill(constant);
        }
        let report = judge(&skin, &[readings], &HealthOptions::default()).unwrap();
        found(&report, TaxelState::Dead).count()
    };
    assert_eq!(with(20_000.0, 255.0), 40, "no other taxel reads 255");
    assert_eq!(with(-3000.0, 0.0), 0, "readings are cut off at 0, and these were not touched");
    assert_eq!(with(-3000.0, 255.0), 40, "the others are cut off elsewhere");
}

/// Where patches share ids, a module is one of each patch: both have a step, and each is a finding of its patch.
#[test]
fn modules_of_shared_ids_are_judged_in_each_patch() {
    let mut skin = sheet();
    let pose = glam::DAffine3::IDENTITY;
    skin.links.push(dermatome::skin::Link { name: "right".into(), parent: None, pose });
    let mut right = skin.patches[PatchId::new(0)].clone();
    right.name = "right".into();
    right.link = dermatome::skin::LinkId::new(1);
    skin.patches.push(right);
    let map = SkinMap::of_taxels(&skin);
    let module: Vec<usize> = (5..8).flat_map(|row| (5..8).map(move |column| 12 * row + column)).collect();
    let ids = &skin.patches[PatchId::new(0)].taxels.ids;
    let modules = module.iter().map(|&k| (ids[VertexId::new(k)], "a".to_owned())).collect();
    let options = HealthOptions { modules, zero: Zero::At(0.0), ..HealthOptions::default() };
    for stepped in [[true, false], [false, true], [true, true]] {
        let mut health = Health::new(&map, &options).unwrap();
        for _ in 0..Health::PASSES {
            health.begin_recording(0, std::iter::repeat_n(true, 288));
            for number in 0..300_usize {
                let mut frame = Frame { time: 0.04 * number as f64, ..Frame::new(&map, 1) };
                for (patch, is_stepped) in stepped.into_iter().enumerate() {
                    let values = &mut frame.values[PatchId::new(patch)][0];
                    for (k, x) in values.iter_mut().enumerate() {
                        let step = if is_stepped && module.contains(&k) { 2e4 } else { 0.0 };
                        *x = step + (((number * 288 + 144 * patch + k) * 7919) % 1009) as f64 - 504.0;
                    }
                }
                health.see(&frame);
            }
            health.end_recording();
            health.end_pass();
        }
        let report = health.report();
        let patches: Vec<usize> =
            found(&report, TaxelState::ModuleStep).map(|finding| finding.patch.index()).collect();
        let expected: Vec<usize> = (0..2).filter(|&patch| stepped[patch]).collect();
        assert_eq!(patches, expected, "{:?}", report.findings);
    }
}

/// A response with exponents accuses nobody, whatever the zeros of raw readings are.
#[test]
fn curves_accuse_no_taxel() {
    let skin = sheet();
    let (plain, _) = record(&skin, &presses(FaultCounts::default(), 3));
    let map = Arc::new(SkinMap::of_taxels(&skin));
    let ids: Vec<TaxelId> = skin.patches.iter().flat_map(|patch| patch.taxels.ids.iter().copied()).collect();
    for (sign, exponent) in [(1.0, 1.0), (-1.0, 1.0), (1.0, 1.3), (-1.0, 0.8)] {
        // Readings to the exponent are pressures.
        let read = |x: f64| 5e3 * (x.abs() / 1e4).powf(f64::recip(exponent)) * x.signum();
        let values = plain.values.iter().map(|&x| 2e4 + sign * read(x)).collect();
        let channels = vec![Channel::new("raw", "count").unwrap()];
        let readings = Readings { channels, values, ..plain.clone() };
        let taxel = |&id: &TaxelId| TaxelResponse {
            gain: Some(sign * 1e4 * 5e3_f64.powf(-exponent)),
            exponent: Some(exponent),
            ..TaxelResponse::unknown(id)
        };
        let response = Response {
            unit: "count".into(),
            scale: Some(Scale::Pascals),
            taxels: ids.iter().map(taxel).collect(),
            ..Response::default()
        };
        // Zeros are followed where touches raise readings.
        let zero = if sign < 0.0 { Zero::At(2e4) } else { Zero::Follow };
        let options = HealthOptions { zero, ..HealthOptions::default() };
        let report = examine(&map, &options, 1, |_, zero| {
            let condition =
                ConditionOptions { zero, response: Some(response.clone()), ..ConditionOptions::default() };
            let options = RecordingOptions { condition, ..RecordingOptions::default() };
            Ok::<_, Error>(Recording::open(&map, ReadingsReader::memory(readings.clone())?, &options)?)
        })
        .unwrap();
        assert_eq!(report.findings, [], "gain {sign}, exponent {exponent}");
        assert!(report.tested > 130, "gain {sign}, exponent {exponent}: {} tested", report.tested);
    }
}
