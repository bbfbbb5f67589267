//! Inputs that break tactile images first: the smallest and the largest skins and canvases, skins
//! without any reading, numbers at the ends of what a float holds, maps that overlap themselves.

use dermatome::{
    atlas::{Atlas, AtlasError, AtlasOptions, Resolution},
    image::{Renderer, TactileImage},
    map::SkinMap,
    mesh::{TriMesh, shapes},
    pipeline::{BuildOptions, build},
    pyramid::LevelId,
    signal::{Channel, ContactTracker, Contrast, Edges, Frame, Quantity, Restrictor, TrackerOptions},
    skin::{PatchId, Skin},
};

use crate::maps;

const QUANTITIES: [Quantity; 2] = [Quantity::Intensive, Quantity::Extensive];

fn patch() -> PatchId {
    PatchId::new(0)
}

fn built(mesh: TriMesh) -> SkinMap {
    build(&Skin::from_mesh("skin", mesh), &BuildOptions::default()).unwrap()
}

/// A frame with the same readings on every patch.
fn frame(map: &SkinMap, reading: impl Fn(usize) -> f64) -> Frame {
    let mut frame = Frame::new(map, 1);
    for values in frame.values.iter_mut().flatten() {
        values.iter_mut().enumerate().for_each(|(v, x)| *x = reading(v));
    }
    frame
}

/// Every step on a stream of frames. Each image is that of a renderer that has seen nothing else, bit by
/// bit but for the kind of NaN. Passes on the last images of each quantity.
fn every_step(
    map: &SkinMap,
    resolution: Resolution,
    frames: &[Frame],
    mut look: impl FnMut(&[TactileImage]),
) {
    let atlas = Atlas::new(map, &AtlasOptions { resolution, ..AtlasOptions::default() }).unwrap();
    for quantity in QUANTITIES {
        let channels = [Channel { quantity, ..Channel::default() }];
        let new = || Renderer::new(map, &atlas, &channels, None).unwrap();
        let (mut restrictor, mut renderer) = (Restrictor::new(map, &channels), new());
        let (mut contrast, mut edges) = (Contrast::new(map, &channels), Edges::new(map, &channels));
        let given = TrackerOptions { threshold: Some(1.0), least: 1, ..TrackerOptions::default() };
        let mut trackers =
            [given, TrackerOptions::default()].map(|o| ContactTracker::new(map, &channels[0], &o).unwrap());
        for frame in frames {
            let levels = restrictor.restrict(frame);
            let bits = |images: &[TactileImage]| -> Vec<u32> {
                let bits = |x: &f32| if x.is_nan() { u32::MAX } else { x.to_bits() };
                images.iter().flat_map(|image| &image.values).map(bits).collect()
            };
            let whole = bits(new().render(levels));
            assert!(bits(renderer.render(levels)) == whole, "{quantity:?}");
            assert!(!renderer.images().iter().any(|image| image.values.iter().any(|x| x.is_infinite())));
            for of in [levels, contrast.of(levels), edges.of(levels)] {
                let mut values = of.values.iter().flatten().flatten().flatten();
                assert!(!values.any(|x| x.abs() > f64::from(f32::MAX)), "{quantity:?}");
            }
            for region in trackers.iter_mut().flat_map(|tracker| tracker.track(frame)) {
                assert!(!region.taxels.is_empty() && region.major.is_finite() && !region.force.is_infinite());
            }
        }
        look(renderer.images());
    }
}

#[test]
fn a_single_triangle_is_a_skin() {
    let map = SkinMap::flat(shapes::triangle(), 0.05);
    let frames = [[1.0, 2.0, 3.0], [f64::NAN, 2.0, 3.0], [f64::NAN, f64::NAN, 5.0], [0.0, 0.0, 0.0]]
        .map(|values| frame(&map, |v| values[v]));
    every_step(&map, Resolution::Map, &frames, |images| {
        let known = images[0].values.iter().zip(&images[0].coverage).filter(|(_, covered)| **covered == 1);
        assert!(known.into_iter().all(|(x, _)| *x == 0.0));
    });
}

/// Taxels that die one after the other until there is none, and come back.
#[test]
fn all_taxels_may_be_dead() {
    let map = built(shapes::cap(150, 0.03, 0.9));
    let dead = |n: usize| frame(&map, |v| if v < n { f64::NAN } else { 1.0 + v as f64 });
    let all = map.patches[patch()].taxels.ids.len();
    every_step(&map, Resolution::Map, &[dead(all), dead(all - 1), dead(all)], |images| {
        assert!(images.iter().flat_map(|image| &image.values).all(|x| x.is_nan()));
    });
    every_step(&map, Resolution::Map, &[dead(all), dead(0), dead(all), dead(0)], |images| {
        let shown = images.iter().flat_map(|image| image.values.iter().zip(&image.coverage));
        assert!(shown.filter(|(_, covered)| **covered == 1).all(|(x, _)| x.is_finite()));
    });
}

/// A canvas of one pixel shows something or is refused; larger ones keep the total.
#[test]
fn canvases_may_be_tiny() {
    let map = built(shapes::cap(150, 0.03, 0.9));
    let presses = [frame(&map, |v| v as f64), frame(&map, |v| if v == 7 { 5.0 } else { v as f64 })];
    for size in [[1, 1], [1, 2], [2, 2], [3, 3], [5, 4], [1, 50]] {
        let resolution = Resolution::Canvas(size);
        match Atlas::new(&map, &AtlasOptions { resolution, ..AtlasOptions::default() }) {
            Ok(atlas) if atlas.parts.iter().all(|part| part.charts.iter().all(|c| c.covered() > 0)) => {
                every_step(&map, resolution, &presses, |images| {
                    assert!(images.iter().all(|image| image.frame.size_px == [size[1], size[0]]));
                    assert!(images.iter().flat_map(|image| &image.values).any(|x| x.is_finite()));
                });
            }
            Ok(_) | Err(AtlasError::Canvas { .. }) => {}
            Err(error) => panic!("{size:?}: {error}"),
        }
    }
}

/// Negative readings are drawn as they are. Numbers beyond an f32 are unknown, on levels, in contrast and
/// edges, and in images; they do not spoil the frames after them.
#[test]
fn readings_may_be_negative_and_huge() {
    let map = built(shapes::cap(150, 0.03, 0.9));
    let hash = |v: usize| ((v * 7919) % 101) as f64 - 50.0;
    let scaled = |scale: f64| frame(&map, |v| scale * hash(v));
    let mixed = |huge: f64| frame(&map, |v| if v % 7 == 0 { huge * hash(v).signum() } else { hash(v) });
    let last = scaled(-1.0);
    let frames = [
        scaled(1.0),
        scaled(1e30),
        mixed(f64::MAX),
        mixed(1e300),
        mixed(3.4e38),
        scaled(1e-320),
        mixed(f64::INFINITY),
        mixed(-0.0),
        last.clone(),
    ];
    every_step(&map, Resolution::Map, &frames, |images| {
        let shown = images[0].values.iter().zip(&images[0].coverage);
        let known: Vec<f32> = shown.filter(|(_, covered)| **covered == 1).map(|(x, _)| *x).collect();
        assert!(known.iter().all(|x| x.is_finite()) && known.iter().any(|x| *x < 0.0));
    });
    let mut restrictor =
        Restrictor::new(&map, &[Channel { quantity: Quantity::Extensive, ..Channel::default() }]);
    frames.iter().for_each(|frame| {
        restrictor.restrict(frame);
    });
    let levels = restrictor.restrict(&last).values[patch()][0].clone();
    let total = |k: usize| levels[LevelId::new(k)].iter().sum::<f64>();
    for k in 1..levels.len() {
        assert!((total(k) - total(0)).abs() < 1e-9 * 5e3, "{} and {}", total(k), total(0));
    }
}

/// A map that lies on itself: every pixel shows one of its places, and amounts keep their total.
#[test]
fn maps_may_overlap_themselves() {
    // A roll: the map comes back over its beginning.
    let mesh = shapes::lattice(24, 10, 0.005);
    let uv = mesh.positions.map(|p| (0.03 + p.y) * glam::DVec2::from_angle(-p.x / 0.015));
    let map = maps::skin(vec![maps::patch("roll", vec![maps::mapped_level(mesh, uv, 2e-3)])]);
    map.validate().unwrap();
    let frames = [frame(&map, |v| v as f64), frame(&map, |v| if v == 3 { f64::NAN } else { 2.0 })];
    every_step(&map, Resolution::Pixel(2e-3), &frames, |images| {
        let shown = images[0].values.iter().zip(&images[0].coverage);
        assert!(shown.filter(|(_, covered)| **covered == 1).all(|(x, _)| x.is_finite()));
    });
}
