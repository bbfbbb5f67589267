//! Contacts 0 to 3 mm off a cap of 0.1 m radius: single queries, a path, a batch, and making the
//! index.
#![allow(missing_docs, clippy::unwrap_used, reason = "benches")]

mod numbers;

use std::{hint::black_box, time::Duration};

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use dermatome::{
    contact::{ContactIndex, Cursor, Query},
    map::SkinMap,
    mesh::{TriMesh, shapes},
};
use glam::{DVec2, DVec3};
use numbers::numbers;

const RADIUS: f64 = 0.1;
const HALF_ANGLE: f64 = 1.92;
const SIZES: [usize; 3] = [20_000, 100_000, 1_000_000];

/// Contacts that are asked in turn.
const CONTACTS: usize = 1 << 15;

/// A map of one patch and one level; the map positions do not matter here.
fn flat(mesh: TriMesh) -> SkinMap {
    SkinMap::flat(mesh, 0.001)
}

fn at(polar: f64, turn: f64, height: f64) -> DVec3 {
    let flat = DVec2::from_angle(turn) * polar.sin();
    (RADIUS + height) * flat.extend(-polar.cos())
}

/// Contacts spread evenly over the cap.
fn scattered(count: usize) -> Vec<Query> {
    let mut number = numbers();
    let place = |_| {
        let polar = (1.0 - number() * (1.0 - HALF_ANGLE.cos())).acos();
        Query::from(at(polar, std::f64::consts::TAU * number(), 0.003 * number()))
    };
    (0..count).map(place).collect()
}

/// A spiral over the cap in steps of about half a millimetre.
fn path(count: usize) -> Vec<Query> {
    let mut number = numbers();
    let place = |k: usize| {
        let along = k as f64 / count as f64;
        Query::from(at(0.3 + 1.2 * along, 0.007 * k as f64, 0.001 + 0.0001 * number()))
    };
    (0..count).map(place).collect()
}

fn contacts(c: &mut Criterion) {
    for faces in SIZES {
        let map = flat(shapes::cap(faces, RADIUS, HALF_ANGLE));
        let index = ContactIndex::new(&map).unwrap();
        let mut group = c.benchmark_group(format!("contact/{faces}"));
        group
            .warm_up_time(Duration::from_millis(100))
            .measurement_time(Duration::from_millis(500))
            .sample_size(10);
        let scattered = scattered(CONTACTS);
        group.bench_function("single", |b| {
            let mut next = scattered.iter().cycle();
            b.iter(|| index.locate(black_box(next.next().unwrap().point)).unwrap());
        });
        let path = path(CONTACTS);
        group.bench_function("path", |b| {
            let mut next = path.iter().cycle();
            let mut cursor = Cursor::default();
            b.iter(|| index.locate_along(&mut cursor, black_box(*next.next().unwrap())).unwrap());
        });
        let hits = index.locate_all(&path).unwrap();
        group.bench_function("cells", |b| {
            let mut next = hits.iter().cycle();
            b.iter(|| index.cells(black_box(next.next().unwrap())).last().unwrap());
        });
        group.throughput(Throughput::Elements(scattered.len() as u64));
        group.bench_function("batch", |b| b.iter(|| index.locate_all(&scattered).unwrap()));
        if faces <= 100_000 {
            group.throughput(Throughput::Elements(faces as u64));
            group.bench_function("build", |b| {
                b.iter_batched(
                    || map.clone(),
                    |map| ContactIndex::new(&map).unwrap(),
                    BatchSize::PerIteration,
                );
            });
        }
        group.finish();
    }
}

criterion_group!(benches, contacts);
criterion_main!(benches);
