//! Frames drawn on caps of 642, 4336 (in 13 patches) and 100 000 taxels of 6 mm at 1 mm a pixel, on
//! all levels. `frame` restricts and draws a frame, `draw` only draws, `draw_L0` level 0 alone. The same of maps whose files DERMATOME_MAPS names, separated as in PATH, by the name
//! of their folder. `rasterise` is an atlas of a million triangles in 2048 x 2048 pixels.
#![allow(clippy::cast_possible_truncation, reason = "counts of a bench are small")]

use std::{env, f64::consts::TAU, hint::black_box, time::Duration};

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dermatome::{
    atlas::{Atlas, AtlasOptions, Resolution},
    image::Renderer,
    io::read_map,
    map::SkinMap,
    mesh::shapes,
    pipeline::{BuildOptions, build},
    pyramid::LevelId,
    signal::{Channel, Frame, Restrictor},
    skin::{LinkId, Patch, Skin},
};

/// Patches of caps with this many taxels in all.
fn caps(patches: u32, taxels: u32) -> SkinMap {
    let area = f64::from(taxels / patches) * 6e-3_f64.powi(2) * 0.75_f64.sqrt();
    let radius = (area / TAU / (1.0 - 0.8_f64.cos())).sqrt();
    let mesh = shapes::cap(2 * (taxels / patches) as usize - 60, radius, 0.8);
    let mut skin = Skin::from_mesh("p0", mesh.clone());
    for k in 1..patches {
        skin.patches.push(Patch::from_mesh(format!("p{k}"), LinkId::new(0), mesh.clone()));
    }
    build(&skin, &BuildOptions::default()).unwrap()
}

/// Two frames that differ in all taxels.
fn frames(map: &SkinMap) -> [Frame; 2] {
    [0.0, 1.0].map(|rise| {
        let mut frame = Frame::new(map, 1);
        for (x, k) in frame.values.iter_mut().flatten().flat_map(|x| x.iter_mut()).zip(0..) {
            *x = (f64::from(k) * 0.37).sin() + rise;
        }
        frame
    })
}

fn draw(c: &mut Criterion) {
    for (patches, taxels) in [(1, 642), (13, 4336), (1, 100_000)] {
        draw_map(c, &taxels.to_string(), &caps(patches, taxels));
    }
    let maps = env::var_os("DERMATOME_MAPS");
    for path in maps.iter().flat_map(env::split_paths) {
        let name = path.parent().unwrap().file_name().unwrap().to_str().unwrap();
        draw_map(c, name, &read_map(&path).unwrap());
    }
}

fn draw_map(c: &mut Criterion, name: &str, map: &SkinMap) {
    let atlas = Atlas::new(map, &AtlasOptions::default()).unwrap();
    let channels = [Channel::default()];
    let taxels: usize = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
    let mut group = c.benchmark_group("image");
    group.throughput(Throughput::Elements(taxels as u64)).measurement_time(Duration::from_secs(2));
    let renderer = |level| Renderer::new(map, &atlas, &channels, level).unwrap();
    let (mut restrictor, mut whole) = (Restrictor::new(map, &channels), renderer(None));
    let (frames, mut k) = (frames(map), 0);
    group.bench_function(BenchmarkId::new("frame", name), |b| {
        b.iter(|| {
            k += 1;
            black_box(whole.render(restrictor.restrict(&frames[k % 2])));
        });
    });
    let levels = frames.map(|f| restrictor.restrict(&f).clone());
    for (what, level) in [("draw", None), ("draw_L0", Some(LevelId::new(0)))] {
        let mut renderer = renderer(level);
        let mut k = 0;
        group.bench_function(BenchmarkId::new(what, name), |b| {
            b.iter(|| {
                k += 1;
                black_box(renderer.render(&levels[k % 2]));
            });
        });
    }
    group.finish();
}

fn rasterise(c: &mut Criterion) {
    let map = SkinMap::flat(shapes::cap(1_000_000, 0.1, 1.0), 1e-3);
    let options = AtlasOptions { resolution: Resolution::Canvas([2048, 2048]), ..AtlasOptions::default() };
    let mut group = c.benchmark_group("image");
    group.sample_size(10).measurement_time(Duration::from_secs(5));
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        group.bench_function(BenchmarkId::new("rasterise_1M", threads), |b| {
            b.iter(|| pool.install(|| black_box(Atlas::new(&map, &options).unwrap())));
        });
    }
    group.finish();
}

criterion_group!(benches, draw, rasterise);
criterion_main!(benches);
