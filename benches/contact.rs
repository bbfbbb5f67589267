//! Contacts 0 to 3 mm off a cap of 0.1 m radius: single queries, intervals, a path, a batch, making the index, and
//! bending the cap between two links; and on a robot of 30 links.

mod numbers;

use std::{hint::black_box, time::Duration};

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use dermatome::{
    contact::{ContactIndex, IndexOptions, Query},
    id::{IdVec, VertexId},
    map::SkinMap,
    mesh::{TriMesh, shapes},
    pyramid::LevelId,
    run::Run,
    skin::{Link, LinkId, Motion, MotionFrame, PatchId},
};
use glam::{DAffine3, DVec2, DVec3};
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

/// The index of a cap that follows two links, one of them less and less from its bottom up.
fn bending(mut map: SkinMap) -> ContactIndex {
    let base = LinkId::new(0);
    map.links.push(Link { name: "tip".into(), parent: Some(base), pose: DAffine3::IDENTITY });
    let taxels = &mut map.patches[PatchId::new(0)].taxels;
    let share = |v: usize| v as f64 / taxels.ids.len() as f64;
    let joints = |v: usize| [(base, share(v)), (LinkId::new(1), 1.0 - share(v)), (base, 0.0), (base, 0.0)];
    let joints: IdVec<VertexId, _> = (0..taxels.ids.len()).map(joints).collect();
    taxels.joints = Some(joints);
    ContactIndex::new(&map).unwrap()
}

const REACTIVE: IndexOptions = IndexOptions { reactive: true, fields: false };

/// Exact answers and intervals on a robot of 30 links with a cap each, side by side and turned.
fn robot(c: &mut Criterion) {
    let mut map = flat(shapes::cap(2000, RADIUS, HALF_ANGLE));
    let poses = |k: usize| {
        DAffine3::from_translation(DVec3::new(k as f64 % 6.0, k as f64 / 6.0, 0.0) * 0.21)
            * DAffine3::from_rotation_x(k as f64)
    };
    for k in 1..30 {
        let link = map.links.push(Link { name: format!("link {k}"), parent: None, pose: poses(k) });
        let mut patch = map.patches[PatchId::new(0)].clone();
        (patch.name, patch.link) = (format!("cap {k}"), link);
        map.patches.push(patch);
    }
    let index = ContactIndex::with_options(&map, &REACTIVE).unwrap();
    let contacts: Vec<DVec3> = scattered(CONTACTS)
        .iter()
        .enumerate()
        .map(|(k, query)| poses(k % 30).transform_point3(query.point))
        .collect();
    let mut group = c.benchmark_group("contact/30 links");
    group.sample_size(10);
    let mut next = contacts.iter().copied().cycle();
    group.bench_function("single", |b| b.iter(|| index.locate(next.next().unwrap()).unwrap()));
    group.bench_function("reactive", |b| b.iter(|| index.reactive(next.next().unwrap()).unwrap()));
    group.finish();
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
        let reactive = ContactIndex::with_options(&map, &REACTIVE).unwrap();
        group.bench_function("reactive", |b| {
            let mut next = scattered.iter().cycle();
            b.iter(|| reactive.reactive(black_box(next.next().unwrap().point)).unwrap());
        });
        let path = path(CONTACTS);
        group.bench_function("path", |b| {
            let mut next = path.iter().cycle();
            b.iter(|| index.locate(black_box(next.next().unwrap().point)).unwrap());
        });
        let hits: Vec<_> = index.locate_all(&path, Run::default()).unwrap().iter().collect();
        group.bench_function("cells", |b| {
            let mut next = hits.iter().cycle();
            b.iter(|| {
                let hit = next.next().unwrap();
                (0..).map_while(|k| index.cell(hit, LevelId::new(k))).for_each(|cell| _ = black_box(&cell));
            });
        });
        group.throughput(Throughput::Elements(scattered.len() as u64));
        group.bench_function("batch", |b| b.iter(|| index.locate_all(&scattered, Run::default()).unwrap()));
        if faces <= 100_000 {
            group.throughput(Throughput::Elements(faces as u64));
            group.bench_function("build", |b| {
                b.iter_batched(
                    || map.clone(),
                    |map| ContactIndex::new(&map).unwrap(),
                    BatchSize::PerIteration,
                );
            });
            group.bench_function("build with intervals", |b| {
                b.iter(|| ContactIndex::with_options(black_box(&map), &REACTIVE).unwrap());
            });
            let (mut index, mut turn) = (bending(map), 0.0);
            let mut motion = Motion::default();
            let key = |k: u32| (f64::from(k), DAffine3::from_rotation_x(f64::from(k)));
            motion.set(LinkId::new(1), MotionFrame::World, &(0..1000).map(key).collect::<Vec<_>>()).unwrap();
            group.bench_function("bend", |b| {
                b.iter(|| {
                    turn += 0.01;
                    index.set_motion(&motion, turn).unwrap();
                });
            });
        }
        group.finish();
    }
}

criterion_group!(benches, contacts, robot);
criterion_main!(benches);
