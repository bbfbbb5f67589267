//! Laws of the health of taxels: faults that a recording shows are found with what shows them, and healthy taxels
//! are not accused.

mod common;

use std::sync::Arc;

use dermatome::Error;
use dermatome::id::VertexId;
use dermatome::io::{Readings, ReadingsReader};
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::recording::{Recording, RecordingOptions, examine};
use dermatome::signal::{
    Channel, ConditionOptions, FaultCounts, HealthFinding, HealthOptions, HealthReport, Quantity,
    ReadoutOptions, Response, SignalError, TaxelState, TouchOptions, TouchSimulation, Zero,
};
use dermatome::skin::{PatchId, Skin, TaxelId};

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

/// Detection rates and false findings, printed by kind: `cargo test --test health -- --ignored table --nocapture`. 324
/// taxels 6 mm apart and 200 presses a recording: as many for each taxel as 400 on a cover of 642.
#[test]
#[ignore = "a measurement of minutes"]
fn table_of_detections_and_false_findings() {
    let skin = Skin::from_mesh("sheet", shapes::lattice(18, 18, 0.006));
    let usual = |seed| TouchOptions {
        radii: vec![0.012, 0.02, 0.03],
        depths: [0.001, 0.003],
        presses: 200,
        ..presses(FaultCounts::default(), seed)
    };
    let taps = |seed| TouchOptions { roll: 0.0, duration: 0.4, pause: 0.2, ..usual(seed) };
    let two = |seed| TouchOptions { touches: 2, presses: 100, ..usual(seed) };
    let real = |seed| TouchOptions {
        aspect: 2.5,
        wobble: 0.1,
        blur: 0.0015,
        exponent: 0.85,
        hysteresis: 0.05,
        ..usual(seed)
    };
    let (mut false_in_clean, mut clean) = (0_usize, 0);
    type Cell<'a> = (&'a str, u64, &'a dyn Fn(u64) -> TouchOptions);
    let cells: [Cell<'_>; 4] =
        [("rolled", 10, &usual), ("taps", 4, &taps), ("two at once", 4, &two), ("ellipsoids", 4, &real)];
    for (name, seeds, options) in cells {
        for seed in 1000..1000 + seeds {
            let (readings, _) = record(&skin, &options(seed));
            let report = judge(&skin, &[readings], &HealthOptions::default()).unwrap();
            println!("clean, {name}, seed {seed}: {} false, {} tested", report.findings.len(), report.tested);
            report.findings.iter().for_each(|finding| println!("    {finding}"));
            (false_in_clean, clean) = (false_in_clean + report.findings.len(), clean + 1);
        }
    }
    let counts = [
        (TaxelState::Dead, 4),
        (TaxelState::Silent, 4),
        (TaxelState::Stuck, 4),
        (TaxelState::Noisy, 4),
        (TaxelState::Jumping, 3),
        (TaxelState::Chattering, 2),
        (TaxelState::Saturated, 3),
        (TaxelState::Swapped, 3),
        (TaxelState::Crosstalk, 2),
    ];
    let faults = counts.iter().fold(FaultCounts::default(), |all, &(kind, count)| all.with(kind, count));
    let (mut false_in_faulty, mut wrong_directions) = (0, 0);
    let mut totals = [[0_usize; 2]; 9];
    for seed in 2000..2008 {
        let options = usual(seed);
        let options = TouchOptions { readout: ReadoutOptions { faults, ..options.readout }, ..options };
        let (readings, truth) = record(&skin, &options);
        let report = judge(&skin, &[readings], &HealthOptions::default()).unwrap();
        let of = |id: TaxelId| truth.taxels.iter().find(|known| known.taxel == id).unwrap();
        for ((kind, _), total) in counts.iter().zip(&mut totals) {
            let hits = found(&report, *kind).filter(|finding| of(finding.taxels[0]).state == *kind).count();
            let injected = truth.taxels.iter().filter(|known| known.state == *kind).count();
            *total = [total[0] + hits, total[1] + injected];
        }
        for finding in &report.findings {
            let known = of(finding.taxels[0]);
            if known.state == TaxelState::Ok {
                println!("    false, seed {seed}: {finding}");
                false_in_faulty += 1;
            } else if known.state != finding.kind {
                println!("    other, seed {seed}: {finding} instead of {}", known.state);
            } else if finding.kind == TaxelState::Crosstalk && finding.other != known.other {
                println!("    direction, seed {seed}: {finding}");
                wrong_directions += 1;
            }
        }
    }
    for ((kind, _), [hits, injected]) in counts.iter().zip(totals) {
        println!("{kind}: {hits} of {injected}");
    }
    println!(
        "{false_in_clean} false in {clean} clean, {false_in_faulty} in 8 faulty, {wrong_directions} wrong directions"
    );
    assert!(false_in_clean <= 1 && 4 * false_in_faulty <= 8, "false findings");
    assert_eq!(wrong_directions, 0);
}
