//! Charts, images and EXR files of caps: 500 to a million triangles at about two pixels an edge.
#![allow(
    clippy::unwrap_used,
    missing_docs,
    reason = "a bench may stop, and criterion's macros have no comments"
)]

#[path = "../tests/maps/mod.rs"]
mod maps;

use std::{hint::black_box, time::Duration};

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dermatome::{
    atlas::{Atlas, AtlasOptions, skin_images},
    io::write_images,
    mesh::shapes,
};
use maps::{flat_patch, images::WholeImage};

fn atlas(c: &mut Criterion) {
    for faces in [500, 10_000, 100_000, 1_000_000_u32] {
        let mesh = shapes::cap(faces as usize, 0.1, 1.0);
        // Twice the pixels that there are triangles.
        let pixel = (mesh.area() / f64::from(2 * faces)).sqrt();
        let map = maps::skin(vec![flat_patch("cap", mesh, pixel)]);
        let mut group = c.benchmark_group("atlas");
        group
            .throughput(Throughput::Elements(u64::from(faces)))
            .sample_size(10)
            .measurement_time(Duration::from_secs(3));
        group.bench_function(BenchmarkId::new("chart", faces), |b| {
            b.iter(|| black_box(Atlas::new(&map, &AtlasOptions::default()).unwrap()));
        });
        let images = skin_images(&map).unwrap();
        group.bench_function(BenchmarkId::new("fill", faces), |b| {
            b.iter(|| black_box(WholeImage::of(&images[0])))
        });
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
    let map = maps::skin([1200, 300, 75].map(patch).into());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.exr");
    c.bench_function("cover_642/images", |b| {
        b.iter(|| write_images(&path, &skin_images(&map).unwrap()).unwrap());
    });
}

criterion_group!(benches, atlas, cover);
criterion_main!(benches);
