//! Frames carried to all levels, contacts and zeros followed, on caps of 642, 4336 (in 13 patches) and
//! 100 000 taxels of 6 mm. `track` takes frames in which a share of the taxels is pressed, one
//! contact on each patch. `fingers` has none, one and five fingers on 651 taxels 7 mm apart: their contacts with either
//! probe, and the events of these.
#![allow(clippy::cast_possible_truncation, reason = "counts of a bench are small")]

use std::f64::consts::TAU;
use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{BatchSize, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dermatome::{
    map::{PatchMap, SkinMap},
    mesh::shapes,
    pyramid::{CoarsenOptions, LevelId, coarsen},
    run::Run,
    signal::{
        Channel, ContactTracker, EventDetector, EventOptions, Frame, Probe, Restrictor, Stage,
        TrackerOptions, ZeroTracker,
    },
    skin::{LinkId, Patch, PatchId, Skin},
};

/// Patches of caps with this many taxels in all. Map positions are those seen along z: nothing here
/// looks at them.
fn caps(patches: u32, taxels: u32) -> SkinMap {
    let area = f64::from(taxels / patches) * 6e-3_f64.powi(2) * 0.75_f64.sqrt();
    let radius = (area / TAU / (1.0 - 0.8_f64.cos())).sqrt();
    let mesh = shapes::cap(2 * (taxels / patches) as usize - 60, radius, 0.8);
    let patches = (0..patches).map(|k| {
        let patch = Patch::from_mesh(format!("p{k}"), LinkId::new(0), mesh.clone());
        let pyramid =
            coarsen(&patch.mesh, &patch.taxels, &CoarsenOptions::default(), Run::default()).unwrap();
        let maps = pyramid.levels.map(|level| level.mesh.positions.map(|x| x.truncate()));
        PatchMap::new(&patch, pyramid, maps, 1e-3)
    });
    SkinMap {
        links: Skin::from_mesh("p", mesh.clone()).links,
        patches: patches.collect(),
        ..SkinMap::default()
    }
}

/// Two frames of noise of size 1 that differ by `rise` in the taxels nearest to one of each patch.
fn frames(map: &SkinMap, share: f64, rise: f64) -> [Frame; 2] {
    let mut one = Frame::new(map, 1);
    for (x, k) in one.values.iter_mut().flatten().flat_map(|x| x.iter_mut()).zip(0..) {
        *x = (f64::from(k) * 0.37).sin();
    }
    let mut other = one.clone();
    for (id, patch) in map.patches.enumerate() {
        let at = &patch.levels[LevelId::new(0)].level.mesh.positions;
        let mut near: Vec<_> = at.ids().collect();
        let centre = at[near[near.len() / 3]];
        near.sort_by(|&a, &b| at[a].distance_squared(centre).total_cmp(&at[b].distance_squared(centre)));
        let count = (share * near.len() as f64).ceil() as usize;
        near.iter().take(count).for_each(|&v| other.values[id][0][v] += rise);
    }
    [one, other]
}

fn restrict(c: &mut Criterion) {
    let mut group = c.benchmark_group("restrict");
    group.measurement_time(Duration::from_secs(1)).warm_up_time(Duration::from_millis(300));
    for (patches, taxels) in [(1, 642), (13, 4336), (1, 100_000)] {
        let map = caps(patches, taxels);
        group.throughput(Throughput::Elements(u64::from(taxels)));
        let (frames, mut k) = (frames(&map, 1.0, 1.0), 0);
        let mut restrictor = Restrictor::new(&map, &[Channel::default()]);
        group.bench_function(BenchmarkId::from_parameter(taxels), |b| {
            b.iter(|| {
                k += 1;
                black_box(restrictor.restrict(&frames[k % 2]));
            });
        });
    }
    group.finish();
}

/// Every frame has all contacts of the one before, in other strength.
fn track(c: &mut Criterion) {
    let mut group = c.benchmark_group("track");
    group.measurement_time(Duration::from_secs(1)).warm_up_time(Duration::from_millis(300));
    for (patches, taxels) in [(1, 642), (13, 4336), (1, 100_000)] {
        let map = caps(patches, taxels);
        group.throughput(Throughput::Elements(u64::from(taxels)));
        for (name, share) in [("all", 1.0), ("1%", 0.01), ("none", 0.0)] {
            let frames = [50.0, 60.0].map(|rise| frames(&map, share, rise)[1].clone());
            let options = TrackerOptions { threshold: Some(10.0), least: 1, ..TrackerOptions::default() };
            let mut tracker = ContactTracker::new(&map, &Channel::default(), &options).unwrap();
            let contacts = if share > 0.0 { patches as usize } else { 0 };
            assert_eq!(tracker.track(&frames[0]).len(), contacts);
            let mut k = 0;
            group.bench_function(BenchmarkId::new(name, taxels), |b| {
                b.iter(|| {
                    k += 1;
                    black_box(tracker.track(&frames[k % 2]));
                });
            });
        }
    }
    group.finish();
}

fn zero(c: &mut Criterion) {
    let mut group = c.benchmark_group("zero");
    group.measurement_time(Duration::from_secs(1)).warm_up_time(Duration::from_millis(300));
    for (patches, taxels) in [(1, 642), (26, 8448), (1, 100_000)] {
        let map = caps(patches, taxels);
        group.throughput(Throughput::Elements(u64::from(taxels)));
        let mut frames = frames(&map, 0.01, 50.0);
        let (mut tracker, mut k) = (ZeroTracker::new(&map, &[Channel::default()]), 0_u32);
        group.bench_function(BenchmarkId::from_parameter(taxels), |b| {
            b.iter(|| {
                k += 1;
                // A touch of a second every three.
                let frame = &mut frames[usize::from(k % 30 < 10)];
                frame.time = 0.1 * f64::from(k);
                black_box(tracker.apply(frame));
            });
        });
    }
    group.finish();
}

/// Fingers laid side by side, 26 mm apart, with noise, at 100 Hz, in the second in which they are pressed and later.
fn fingers(c: &mut Criterion) {
    let mut group = c.benchmark_group("fingers");
    group.measurement_time(Duration::from_secs(1)).warm_up_time(Duration::from_millis(300));
    let map = SkinMap::flat(shapes::lattice(21, 31, 0.007_26), 1e-3);
    let at = map.patches[PatchId::new(0)].levels[LevelId::new(0)].level.mesh.positions.clone();
    let channel = Channel::new("pressure", "Pa").unwrap();
    for (probe, name) in [(Probe::Any, "any"), (Probe::Finger, "finger")] {
        for count in [0, 1, 5] {
            let options = TrackerOptions { probe, low: probe.low(), ..TrackerOptions::default() };
            let mut tracker = ContactTracker::new(&map, &channel, &options).unwrap();
            let mut detector = EventDetector::new(&map, EventOptions::default()).unwrap();
            let (mut frame, mut number) = (Frame::new(&map, 1), 0_u32);
            let mut next = |frame: &mut Frame| {
                frame.time = 0.01 * f64::from(number);
                let rise = (5.0 * (frame.time - 0.5)).clamp(0.0, 1.0);
                for ((v, x), k) in at.enumerate().zip(0_u32..) {
                    let finger = |finger: u32| {
                        let (along, across) = (x.y - 0.06, x.x - 0.02 - 0.026 * f64::from(finger));
                        let beyond = (along.abs() - 0.015).max(0.0);
                        (-0.5 * (across * across + beyond * beyond) / 0.0045_f64.powi(2)).exp()
                    };
                    let noise = (f64::from(k.wrapping_mul(7919).wrapping_add(number.wrapping_mul(104_729)))
                        * 0.37)
                        .sin();
                    let pressure = 30e3 * rise * (0..count).map(finger).sum::<f64>();
                    frame.values[PatchId::new(0)][0][v] = 500.0 * noise + pressure;
                }
                number += 1;
            };
            for _ in 0..70 {
                next(&mut frame);
                tracker.track(&frame);
                detector.see(frame.time, &tracker).unwrap();
            }
            group.bench_function(BenchmarkId::new(format!("contacts, {name}"), count), |b| {
                // A frame that comes again has no noise, and is all contacts then.
                b.iter_custom(|rounds| {
                    let mut taken = Duration::ZERO;
                    for _ in 0..rounds {
                        next(&mut frame);
                        let begin = Instant::now();
                        black_box(tracker.track(&frame).len());
                        taken += begin.elapsed();
                    }
                    taken
                });
            });
            // They do not depend on the probe.
            if probe == Probe::Finger {
                continue;
            }
            group.bench_function(BenchmarkId::new("events", count), |b| {
                b.iter_batched(
                    || {
                        next(&mut frame);
                        tracker.track(&frame);
                        (frame.time, tracker.clone())
                    },
                    |(time, tracker)| black_box(detector.see(time, &tracker).unwrap().len()),
                    BatchSize::PerIteration,
                );
            });
        }
    }
    group.finish();
}

criterion_group!(benches, restrict, track, zero, fingers);
criterion_main!(benches);
