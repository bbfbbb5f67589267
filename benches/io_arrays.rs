//! Recordings written as arrays: every level's values of a cover of 642 taxels, and images, in
//! memory-backed files where the system has them.

use std::path::Path;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dermatome::{
    atlas::{Atlas, AtlasOptions},
    image::{Renderer, TactileImage},
    io::{RecordingLayout, RecordingWriter, write_raw_frame},
    map::SkinMap,
    mesh::shapes,
    pipeline::{BuildOptions, build},
    signal::{Channel, LevelFrame},
    skin::Skin,
};

/// A cover of 642 taxels at about 5 mm.
fn cover() -> SkinMap {
    let skin = Skin::from_mesh(
        "cover",
        shapes::sheet(107, 6, |i, j| {
            let x = f64::from(i) + 0.5 * f64::from(j % 2);
            glam::DVec3::new(0.005 * x, 0.0043 * f64::from(j), 0.0)
        }),
    );
    build(&skin, &BuildOptions::default()).expect("a map of a plane")
}

/// Images of 1 where they are covered, of one channel.
fn images_of(map: &SkinMap, atlas: &Atlas) -> Vec<TactileImage> {
    let renderer = Renderer::new(map, atlas, &[Channel::default()], None);
    let mut images = renderer.expect("images of a valid map").images().to_vec();
    for image in &mut images {
        image.values = image.coverage.iter().map(|&x| f32::from(x)).collect();
    }
    images
}

fn recordings(c: &mut Criterion) {
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
    let folder = folder.expect("a folder for the files");
    let map = cover();
    let channels = [Channel::default()];
    let frame = LevelFrame::new(&map, 1);
    let path = folder.path().join("values.npz");
    let mut group = c.benchmark_group("npz_values_642_taxels");
    group.sample_size(10);
    for frames in [100_u64, 1000, 10_000] {
        group.throughput(Throughput::Elements(frames));
        group.bench_function(BenchmarkId::new("frames", frames), |b| {
            b.iter(|| {
                let layout = RecordingLayout {
                    channels: &channels,
                    atlas: None,
                    values: true,
                    level: None,
                    fields: None,
                };
                let mut recording = RecordingWriter::create(&path, &map, &layout)?;
                (0..frames).try_for_each(|_| recording.write(&frame, &[]))?;
                recording.finish()
            });
        });
    }
    group.finish();

    let atlas = Atlas::new(&map, &AtlasOptions::default()).expect("an atlas");
    let images = images_of(&map, &atlas);
    let bytes: usize = images.iter().map(|image| 4 * image.values.len()).sum();
    let mut group = c.benchmark_group("images_642_taxels");
    group.sample_size(10);
    group.throughput(Throughput::Bytes(1000 * bytes as u64));
    group.bench_function("npz_1000_frames", |b| {
        b.iter(|| {
            let layout = RecordingLayout {
                channels: &channels,
                atlas: Some(&atlas),
                values: false,
                level: None,
                fields: None,
            };
            let mut recording = RecordingWriter::create(&path, &map, &layout)?;
            (0..1000).try_for_each(|_| recording.write(&frame, &images))?;
            recording.finish()
        });
    });
    group.bench_function("raw_1000_frames", |b| {
        let mut nothing = std::fs::File::create("/dev/null").expect("a place for bytes");
        b.iter(|| (0..1000).try_for_each(|_| write_raw_frame(&mut nothing, &images)));
    });
    group.finish();
}

criterion_group!(benches, recordings);
criterion_main!(benches);
