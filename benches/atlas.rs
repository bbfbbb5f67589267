//! Charts, images and EXR files of caps: 500 to a million triangles at about two pixels an edge.

#[path = "../tests/library/altered.rs"]
mod altered;
#[path = "../tests/library/maps/mod.rs"]
mod maps;

use std::{hint::black_box, sync::Arc, time::Duration};

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dermatome::{
    atlas::{Atlas, AtlasOptions, Pack, skin_images},
    io::write_images,
    mesh::shapes,
};
use exr::prelude::WritableImage;
use glam::DVec3;
use maps::flat_patch;

fn atlas(c: &mut Criterion) {
    for faces in [500, 10_000, 100_000, 1_000_000_u32] {
        let mesh = shapes::cap(faces as usize, 0.1, 1.0);
        // Twice the pixels that there are triangles.
        let pixel = (mesh.area() / f64::from(2 * faces)).sqrt();
        let map = Arc::new(maps::skin(vec![flat_patch("cap", mesh, pixel)]));
        let mut group = c.benchmark_group("atlas");
        group
            .throughput(Throughput::Elements(u64::from(faces)))
            .sample_size(10)
            .measurement_time(Duration::from_secs(3));
        group.bench_function(BenchmarkId::new("chart", faces), |b| {
            b.iter(|| black_box(Atlas::new(&map, &AtlasOptions::default()).unwrap()));
        });
        let images = skin_images(&map).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cap.exr");
        group.bench_function(BenchmarkId::new("exr", faces), |b| {
            b.iter(|| write_images(&path, &images).unwrap());
        });
        group.finish();
    }
}

/// A cover of 642 taxels at 6 mm with its coarser levels, 1 mm a pixel: what `build` writes for one
/// patch.
fn cover(c: &mut Criterion) {
    let patch = |faces: usize| flat_patch(&format!("cover {faces}"), shapes::cap(faces, 0.1, 1.0), 0.001);
    let map = Arc::new(maps::skin([1200, 300, 75].map(patch).into()));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.exr");
    c.bench_function("cover_642/images", |b| {
        b.iter(|| write_images(&path, &skin_images(&map).unwrap()).unwrap());
    });
}

/// A robot of 100 charts of many sizes, round and long, packed into one image: about as many taxels as a robot has at
/// 8 mm, one pixel for each 2.5 mm.
fn packed(c: &mut Criterion) {
    let patch = |k: u32| {
        let (name, wide) = (format!("chart {k}"), 5 + k * 7 % 23);
        let at = |i: u32, j: u32| {
            let (x, y) = (0.008 * f64::from(i), 0.008 * f64::from(j));
            DVec3::new(x, y + 0.03 * (20.0 * x).sin(), 0.0)
        };
        let mesh = match k % 3 {
            0 => shapes::sheet(wide, 4 + k * 5 % 17, at),
            _ => shapes::cap(100 + 41 * wide as usize, 0.01 * f64::from(wide).sqrt(), 1.0),
        };
        flat_patch(&name, mesh, 0.0025)
    };
    let map = Arc::new(maps::skin((0..100).map(patch).collect()));
    let mut group = c.benchmark_group("atlas_100_charts");
    group.sample_size(10).measurement_time(Duration::from_secs(5));
    for (name, pack) in [("tight", Pack::Tight), ("body", Pack::Body)] {
        let options = AtlasOptions { pack: Some(pack), ..AtlasOptions::default() };
        group.bench_function(name, |b| b.iter(|| black_box(Atlas::new(&map, &options).unwrap())));
    }
    group.finish();
}

/// All channels of a million triangles in 2048 x 2048 pixels as EXR: what is written of the map, and the
/// same pixels as the exr crate writes them by itself. Both on all threads.
fn floor(c: &mut Criterion) {
    let mesh = shapes::cap(1_000_000, 0.1, 1.0);
    let map = Arc::new(maps::skin(vec![flat_patch("cap", mesh, 2.0 * 0.1 * 1.0_f64.sin() / 2046.0)]));
    let images = skin_images(&map).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let [ours, theirs] = ["ours.exr", "theirs.exr"].map(|name| folder.path().join(name));
    write_images(&ours, &images).unwrap();
    let pixels = exr::prelude::read_all_data_from_file(&ours).unwrap();
    let mut group = c.benchmark_group("exr_2048");
    group.sample_size(10).measurement_time(Duration::from_secs(5));
    group.bench_function("images", |b| b.iter(|| write_images(&ours, &images).unwrap()));
    group.bench_function("floor", |b| b.iter(|| pixels.write().to_file(&theirs).unwrap()));
    group.finish();
    let bytes = [&ours, &theirs].map(|path| std::fs::metadata(path).unwrap().len());
    let part = &pixels.layer_data[0];
    println!(
        "{:?}, {} channels: {} bytes, floor {}",
        part.size,
        part.channel_data.list.len(),
        bytes[0],
        bytes[1]
    );
}

criterion_group!(benches, atlas, cover, packed, floor);
criterion_main!(benches);
