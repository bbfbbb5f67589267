//! Frames drawn on caps of 642, 4336 (in 13 patches) and 100 000 taxels of 6 mm at 1 mm a pixel, on
//! all levels. `frame` restricts and draws a frame in which all taxels change, `one_percent` one in
//! which a hundredth of those of each patch does, neighbours of each other, `one_contact` as many in
//! all, on one patch, `one_percent_apart` every hundredth; the share of the pixels that this changes is
//! printed. `draw` only draws, `draw_L0` level 0 alone; `natural` and `field` draw in
//! these ways. The same of maps whose files DERMATOME_MAPS names, separated as in PATH, by the name
//! of their folder. `rasterise` is an atlas of a million triangles in 2048 x 2048 pixels.
#![allow(clippy::cast_possible_truncation, reason = "counts of a bench are small")]

use std::{env, f64::consts::TAU, hint::black_box, time::Duration};

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dermatome::{
    atlas::{Atlas, AtlasOptions, Resolution},
    image::{Interpolation, RenderOptions, Renderer, TactileImage},
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

/// Which taxels change.
#[derive(Clone, Copy)]
enum Change {
    All,
    /// The first hundredth of the taxels of each patch, neighbours of each other.
    OfEach,
    /// As many as a hundredth of all taxels, the first of the first patch.
    OfOne,
    /// Every hundredth taxel.
    Apart,
}

/// Two frames that differ in these taxels.
fn frames(map: &SkinMap, change: Change) -> [Frame; 2] {
    let mut one = Frame::new(map, 1);
    for (x, k) in one.values.iter_mut().flatten().flat_map(|x| x.iter_mut()).zip(0..) {
        *x = (f64::from(k) * 0.37).sin();
    }
    let mut other = one.clone();
    let all = other.values.iter().map(|patch| patch[0].len()).sum::<usize>();
    let patches = match change {
        Change::OfOne => 1,
        Change::All | Change::OfEach | Change::Apart => other.values.len(),
    };
    for values in other.values.iter_mut().take(patches).map(|patch| &mut patch[0]) {
        let (count, step) = match change {
            Change::All => (values.len(), 1),
            Change::OfEach => (values.len().div_ceil(100), 1),
            Change::OfOne => (all.div_ceil(100), 1),
            Change::Apart => (values.len(), 100),
        };
        values.iter_mut().take(count).step_by(step).for_each(|x| *x += 1.0);
    }
    [one, other]
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
    let renderer = |interpolation, level| {
        let options = RenderOptions { interpolation, level };
        Renderer::new(map, &atlas, &channels, &options).unwrap()
    };
    for (what, change) in [
        ("frame", Change::All),
        ("one_percent", Change::OfEach),
        ("one_contact", Change::OfOne),
        ("one_percent_apart", Change::Apart),
    ] {
        let (mut restrictor, mut renderer) =
            (Restrictor::new(map, &channels), renderer(Interpolation::Linear, None));
        let frames = frames(map, change);
        let drawn = [0, 1].map(|k| renderer.render(restrictor.restrict(&frames[k])).to_vec());
        println!("image/{what}/{name}: {:.1} % of the pixels change", 100.0 * changed(&drawn));
        let mut k = 0;
        group.bench_function(BenchmarkId::new(what, name), |b| {
            b.iter(|| {
                k += 1;
                black_box(renderer.render(restrictor.restrict(&frames[k % 2])));
            });
        });
    }
    let levels = frames(map, Change::All).map(|f| Restrictor::new(map, &channels).restrict(&f).clone());
    for (what, interpolation, level) in [
        ("draw", Interpolation::Linear, None),
        ("draw_L0", Interpolation::Linear, Some(LevelId::new(0))),
        ("natural", Interpolation::Natural, None),
    ] {
        if interpolation == Interpolation::Natural && taxels > 10_000 {
            continue;
        }
        let mut renderer = renderer(interpolation, level);
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

/// Share of the covered pixels that differ.
fn changed([one, other]: &[Vec<TactileImage>; 2]) -> f64 {
    let (mut changed, mut all) = (0.0, 0.0);
    for (a, b) in one.iter().zip(other) {
        for ((x, y), _) in a.values.iter().zip(&b.values).zip(&a.coverage).filter(|(_, c)| **c == 1) {
            all += 1.0;
            changed += f64::from(u8::from(x != y));
        }
    }
    changed / all
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
