//! Laws of tactile images: what a pixel shows, and what the sum of pixels is.
#![allow(clippy::cast_possible_truncation, reason = "counts of a test are small")]

use crate::maps::{self, level_id};
use dermatome::atlas::{Atlas, AtlasOptions, Chart, Pack, Resolution};
use dermatome::id::{IdVec, VertexId};
use dermatome::image::{BatchRenderer, ImageError, Renderer, TactileImage};
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::pipeline::{BuildOptions, build};
use dermatome::signal::{Channel, Frame, LevelFrame, Quantity, Restrictor};
use dermatome::skin::{LinkId, Patch, PatchId, Skin};
use glam::{DVec2, DVec3};
use proptest::prelude::*;

/// A curved cover of a few hundred taxels on several levels, a small one, and a sleeve that is mapped
/// cut open.
fn cover() -> SkinMap {
    let mut skin = Skin::from_mesh("cover", shapes::cap(500, 0.06, 0.9));
    let mut finger = skin.patches[PatchId::new(0)].clone();
    finger = dermatome::skin::Patch::from_mesh("finger", finger.link, shapes::cap(120, 0.02, 1.1));
    let sleeve = dermatome::skin::Patch::from_mesh("sleeve", finger.link, shapes::tube(16, 10, 0.02, 0.06));
    skin.patches.push(finger);
    skin.patches.push(sleeve);
    build(&skin, &BuildOptions::default()).unwrap()
}

fn channel(quantity: Quantity) -> Channel {
    Channel { quantity, ..Channel::default() }
}

/// A number in -1..1 that looks random.
fn hash(k: u32) -> f64 {
    let x = k.wrapping_mul(0x9E37_79B9) ^ 0x85EB_CA6B;
    let x = (x ^ (x >> 15)).wrapping_mul(0x2C1B_3C6D);
    f64::from((x ^ (x >> 12)).wrapping_mul(0x297A_2D39) >> 8) / f64::from(1 << 23) - 1.0
}

/// A frame of values on every vertex of every level, one channel.
fn on_levels(map: &SkinMap, value: impl Fn(DVec2, u32) -> f64) -> LevelFrame {
    let mut frame = LevelFrame::new(map, 1);
    for (patch, channels) in frame.values.iter_mut().enumerate() {
        for (level, values) in channels[0].iter_mut().enumerate() {
            let uv = &map.patches[PatchId::new(patch)].levels[level_id(level)].uv;
            for ((x, at), k) in values.iter_mut().zip(uv).zip(0..) {
                *x = value(*at, k);
            }
        }
    }
    frame
}

/// One in `n` taxels is dead.
fn kill(frame: &mut LevelFrame, n: u32) {
    for values in frame.values.iter_mut().flatten().flat_map(|levels| levels.iter_mut()) {
        values
            .iter_mut()
            .zip(0_u32..)
            .filter(|(_, k)| k.wrapping_mul(7) % n == 3)
            .for_each(|(x, _)| *x = f64::NAN);
    }
}

fn atlas(map: &SkinMap, resolution: Resolution, packed: bool) -> Atlas {
    Atlas::new(map, &AtlasOptions { resolution, pack: packed.then_some(Pack::Tight) }).unwrap()
}

fn renderer(map: &SkinMap, atlas: &Atlas, quantity: Quantity) -> Renderer {
    Renderer::new(map, atlas, &[channel(quantity)], None).unwrap()
}

/// The values of covered pixels.
fn covered(image: &TactileImage) -> impl Iterator<Item = f32> {
    image.values.iter().zip(&image.coverage).filter(|(_, c)| **c == 1).map(|(x, _)| *x)
}

fn pixel_area(image: &TactileImage) -> f64 {
    image.frame.size.x * image.frame.size.y
        / f64::from(image.frame.size_px[0])
        / f64::from(image.frame.size_px[1])
}

/// Bits of all pixels; every NaN is the same.
fn bits(images: &[TactileImage]) -> Vec<u32> {
    let bits = |x: &f32| if x.is_nan() { u32::MAX } else { x.to_bits() };
    images.iter().flat_map(|image| &image.values).map(bits).collect()
}

#[test]
fn a_constant_pressure_is_a_constant_image() {
    let map = cover();
    for packed in [false, true] {
        let atlas = atlas(&map, Resolution::Map, packed);
        let mut renderer = renderer(&map, &atlas, Quantity::Intensive);
        let images = renderer.render(&on_levels(&map, |_, _| 2.5));
        assert_eq!(images.len(), atlas.parts.len());
        for (image, part) in images.iter().zip(&atlas.parts) {
            assert_eq!(image.name, part.name);
            assert!(covered(image).all(|x| (x - 2.5).abs() < 1e-6), "{}", image.name);
            let known = image.values.iter().filter(|x| !x.is_nan()).count();
            assert!(known > 0 && known == covered(image).count(), "values off the skin are NaN");
        }
    }
}

/// What the definition says, computed pixel by pixel from the chart alone.
fn by_definition(map: &SkinMap, atlas: &Atlas, frame: &LevelFrame, part: usize, at: [u32; 2]) -> Option<f64> {
    let chart = atlas.parts[part].charts.iter().find(|c| c.point(map, at[0], at[1]).is_some())?;
    let point = chart.point(map, at[0], at[1])?;
    let corners = map.patches[chart.patch].levels[chart.level].level.mesh.triangles[point.face];
    let values = &frame.values[chart.patch][0][chart.level];
    let live = || (0..3).filter(|&k| !values[corners[k]].is_nan());
    let sum: f64 = live().map(|k| point.barycentric[k]).sum();
    Some(live().map(|k| point.barycentric[k] / sum * values[corners[k]]).sum::<f64>())
        .filter(|_| live().next().is_some())
}

#[test]
fn linear_images_are_what_barycentric_weights_say() {
    let map = cover();
    for (resolution, packed, dead) in [
        (Resolution::Map, false, 0),
        (Resolution::Map, false, 4),
        (Resolution::Pixel(0.0023), true, 5),
        (Resolution::Canvas([200, 150]), true, 0),
    ] {
        let atlas = atlas(&map, resolution, packed);
        let mut frame = on_levels(&map, |_, k| hash(k));
        if dead > 0 {
            kill(&mut frame, dead);
        }
        let mut renderer = renderer(&map, &atlas, Quantity::Intensive);
        for (part, image) in renderer.render(&frame).iter().enumerate() {
            let width = image.frame.size_px[0];
            for (k, &value) in (0_u32..).zip(&image.values).filter(|(k, _)| image.coverage[*k as usize] == 1)
            {
                match by_definition(&map, &atlas, &frame, part, [k % width, k / width]) {
                    None => assert!(value.is_nan(), "pixel {k} of {} shows dead taxels alone", image.name),
                    // Centres on edges may lie 2^-17 pixels outside: of faces some pixels high.
                    Some(x) => assert!(
                        (f64::from(value) - x).abs() < 2e-5,
                        "pixel {k} of {}: {value}, not {x}",
                        image.name
                    ),
                }
            }
        }
    }
}

/// The nearest taxel is the nearest of all, on level 0 and above.
#[test]
fn nearest_is_the_nearest_vertex_of_the_level() {
    let map = cover();
    let atlas = atlas(&map, Resolution::Map, false);
    let (mut seen, mut beyond) = (0, 0);
    for part in &atlas.parts {
        let (chart, width) = (&part.charts[0], part.frame.size_px[0]);
        let patch = &map.patches[chart.patch];
        let mesh = &patch.levels[chart.level].level.mesh;
        let ids = &patch.taxels.ids;
        for (k, id) in (0_u32..).zip(part.taxel_ids(&map)) {
            let Some(at) = chart.point(&map, k % width, k / width) else { continue };
            let corners = mesh.triangles[at.face];
            let p: DVec3 = (0..3).map(|k| at.barycentric[k] * mesh.positions[corners[k]]).sum();
            let nearest = mesh.positions.iter().map(|q| p.distance(*q)).fold(f64::INFINITY, f64::min);
            let of_id = || ids.ids().find(|&v| ids[v].0 == id).unwrap();
            let shown = if chart.level == level_id(0) { of_id() } else { VertexId::new(id as usize) };
            let distance = p.distance(mesh.positions[shown]);
            assert!(distance <= nearest + 1e-9, "pixel {k} of {}: {distance} for {nearest} m", part.name);
            (seen, beyond) = (seen + 1, beyond + usize::from(!corners.contains(&shown)));
        }
    }
    assert!(seen > 1000 && beyond > 0, "of {seen} pixels {beyond} are nearest to no corner of their face");
}

/// The total is kept at any size of the pixels, with dead taxels.
#[test]
fn the_matrix_of_an_image_draws_it() {
    let map = cover();
    let atlas = atlas(&map, Resolution::Map, true);
    for (quantity, missing) in [
        (Quantity::Intensive, 0),
        (Quantity::Extensive, 0),
        (Quantity::Intensive, 3),
        (Quantity::Extensive, 3),
    ] {
        let frame = on_levels(&map, |_, k| if missing > 0 && k % 7 < missing { f64::NAN } else { hash(k) });
        let mut renderer = renderer(&map, &atlas, quantity);
        renderer.render(&frame);
        for (part, image) in renderer.images().iter().enumerate() {
            let mut drawn = vec![f64::NAN; image.values.len()];
            let values =
                |patch: PatchId| &frame.values[patch][0][map.patches[patch].nearest_level(image.level)];
            let is_live = |patch, v| !values(patch)[v].is_nan();
            renderer.each_pixel(part, quantity, is_live, |patch, pixel, row| {
                let known = row.iter().filter(|(_, w)| *w != 0.0);
                let sum: f64 = known.map(|&(v, w)| w * values(patch)[VertexId::from(v)]).sum();
                let drawn = &mut drawn[pixel as usize];
                *drawn = if drawn.is_nan() { sum } else { *drawn + sum };
            });
            let known = image.values.iter().filter(|x| x.is_finite());
            let most = f64::from(known.fold(1.0, |most: f32, x| most.max(x.abs())));
            for (drawn, &shown) in drawn.iter().zip(&image.values) {
                let (error, limit) = ((drawn - f64::from(shown)).abs(), 1e-6 * most);
                let is_same = error < limit || drawn.is_nan() && shown.is_nan();
                assert!(is_same, "{drawn}, not {shown}, on {} with {quantity:?}", image.name);
            }
        }
    }
}

#[test]
fn amounts_keep_their_total() {
    let map = cover();
    let sizes =
        [Resolution::Map, Resolution::Pixel(0.004), Resolution::Pixel(0.011), Resolution::Canvas([40, 30])];
    for resolution in sizes {
        for (dead, packed) in [(0, false), (4, false), (10, true)] {
            let atlas = atlas(&map, resolution, packed);
            let mut frame = on_levels(&map, |_, k| 1.5 + hash(k));
            if dead > 0 {
                kill(&mut frame, dead);
            }
            let mut renderer = renderer(&map, &atlas, Quantity::Extensive);
            for image in renderer.render(&frame) {
                let drawn: f64 =
                    covered(image).filter(|x| !x.is_nan()).map(f64::from).sum::<f64>() * pixel_area(image);
                let patches = map
                    .patches
                    .enumerate()
                    .filter(|(_, patch)| packed || image.name.starts_with(&patch.name));
                let values =
                    patches.flat_map(|(id, patch)| &frame.values[id][0][patch.nearest_level(image.level)]);
                let total: f64 = values.filter(|x| !x.is_nan()).sum();
                assert!(
                    (drawn / total - 1.0).abs() < 1e-6,
                    "{resolution:?} {}, one in {dead} dead: {drawn} of {total}",
                    image.name
                );
            }
        }
    }
}

#[test]
fn the_steady_state_keeps_its_buffers() {
    let map = cover();
    let atlas = atlas(&map, Resolution::Map, false);
    let mut renderer = renderer(&map, &atlas, Quantity::Extensive);
    let place = |images: &[TactileImage]| -> Vec<_> {
        images.iter().map(|image| (image.values.as_ptr(), image.values.capacity())).collect()
    };
    let before = place(renderer.images());
    for k in 0..5 {
        assert_eq!(place(renderer.render(&on_levels(&map, |p, v| p.x * f64::from(k) + hash(v)))), before);
    }
}

/// Forty frames: sixteen at a time with the same dead taxels, then some with others.
#[test]
fn a_batch_has_the_bits_of_the_stream() {
    let map = cover();
    let channels = [Quantity::Intensive, Quantity::Extensive].map(channel);
    let read = |k: usize, frame: &mut Frame| {
        for (values, at) in frame.values.iter_mut().flatten().zip(0_u32..) {
            for (x, v) in values.iter_mut().zip(0_u32..) {
                let is_dead = v % 11 == 3 || (k == 20 && v % 5 == 1);
                let is_vast = k == 35 && v == 7;
                let value = hash(v.wrapping_mul(31) ^ at.wrapping_mul(977) ^ k as u32);
                let value = if is_vast { 1e300 } else { value };
                *x = if is_dead { f64::INFINITY } else { value };
            }
        }
    };
    for (packed, level, resolution) in [
        (true, 0, Resolution::Canvas([60, 50])),
        (true, 1, Resolution::Canvas([16, 16])),
        (false, 0, Resolution::Map),
    ] {
        let atlas = atlas(&map, resolution, packed);
        let mut renderer = Renderer::new(&map, &atlas, &channels, Some(level_id(level))).unwrap();
        let mut restrictor = Restrictor::new(&map, &channels);
        let mut frame = Frame::new(&map, 2);
        let mut batch = BatchRenderer::new(restrictor.clone(), renderer.clone(), frame.clone());
        let size = renderer.images()[0].values.len();
        let mut images = vec![0.0; 40 * size];
        batch.render(read, &mut images);
        for (k, image) in images.chunks(size).enumerate() {
            read(k, &mut frame);
            let one = &renderer.render(restrictor.restrict(&frame))[0];
            let batched = TactileImage { values: image.to_vec(), ..one.clone() };
            assert_eq!(bits(&[batched]), bits(std::slice::from_ref(one)), "{level}, frame {k}");
        }
    }
}

#[test]
fn any_number_of_threads_draws_the_same() {
    let map = cover();
    let frame = on_levels(&map, |_, k| hash(k));
    let draw = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let atlas = atlas(&map, Resolution::Map, true);
            bits(renderer(&map, &atlas, Quantity::Extensive).render(&frame))
        })
    };
    assert_eq!(draw(1), draw(3));
}

#[test]
fn other_maps_unknown_levels_and_charts_without_pixel_are_refused() {
    let map = cover();
    let other = SkinMap::flat(shapes::square(), 0.1);
    let atlas = Atlas::new(&map, &AtlasOptions::default()).unwrap();
    let channels = [Channel::default()];
    let error = Renderer::new(&other, &atlas, &channels, None).unwrap_err();
    assert!(matches!(error, ImageError::Atlas { .. }), "{error}");
    let deep = Some(level_id(40));
    assert!(matches!(Renderer::new(&map, &atlas, &channels, deep).unwrap_err(), ImageError::Level { .. }));
    let renderer = Renderer::new(&map, &atlas, &channels, Some(level_id(1))).unwrap();
    assert!(renderer.images().iter().all(|image| image.level == level_id(1)));
    // A triangle between the centres of four pixels.
    let mut point = shapes::triangle();
    point.positions.iter_mut().for_each(|p| *p *= 1e-9);
    let point = SkinMap::flat(point, 1.0);
    let options = AtlasOptions { resolution: Resolution::Pixel(1.4e-9), ..AtlasOptions::default() };
    let atlas = Atlas::new(&point, &options).unwrap();
    let force = [channel(Quantity::Extensive)];
    assert_eq!(atlas.parts[0].charts[0].covered(), 1, "one pixel stands for it");
    Renderer::new(&point, &atlas, &force, None).unwrap();
    // Without an area there is no place for it.
    let mut line = shapes::triangle();
    line.positions.iter_mut().for_each(|p| p.y = 0.0);
    let line = SkinMap::flat(line, 1.0);
    let atlas = Atlas::new(&line, &AtlasOptions::default()).unwrap();
    let error = Renderer::new(&line, &atlas, &force, None).unwrap_err();
    assert!(matches!(error, ImageError::NoPixel { .. }), "{error}");
}

/// A patch far smaller than a pixel has one of its own in a packed image, on every level: amounts are kept.
#[test]
fn every_patch_has_a_pixel_of_a_packed_image() {
    let mut skin = Skin::from_mesh("palm", shapes::lattice(20, 20, 0.004));
    for (k, size) in [1e-5, 3e-5, 1e-4, 4e-4].into_iter().enumerate() {
        let mut crumb = shapes::lattice(4, 4, size);
        crumb.positions.iter_mut().for_each(|p| *p += DVec3::new(0.2 + 0.01 * k as f64, 0.0, 0.0));
        skin.patches.push(Patch::from_mesh(format!("crumb {k}"), LinkId::new(0), crumb));
    }
    let map = build(&skin, &BuildOptions::default()).unwrap();
    for pack in [Pack::Tight, Pack::Body] {
        for resolution in
            [Resolution::Pixel(2e-3), Resolution::Canvas([40, 30]), Resolution::Canvas([600, 500])]
        {
            let atlas = Atlas::new(&map, &AtlasOptions { pack: Some(pack), resolution }).unwrap();
            for part in &atlas.parts {
                let covered: usize = part.charts.iter().map(Chart::covered).sum();
                let shown = part.taxel_ids(&map).iter().filter(|&&id| id != u32::MAX).count();
                assert!(part.charts.iter().all(|chart| chart.covered() > 0), "{pack:?} {resolution:?}");
                assert_eq!(
                    covered, shown,
                    "no two charts share a pixel: {pack:?} {resolution:?} {}",
                    part.name
                );
            }
            let channels = [channel(Quantity::Extensive)];
            Renderer::new(&map, &atlas, &channels, None).unwrap();
        }
    }
}

/// What happens to a taxel between two frames.
fn change() -> impl Strategy<Value = Vec<(usize, Option<f64>)>> {
    let value =
        prop_oneof![3 => (-2.0..2.0_f64).prop_map(Some), 1 => Just(None), 1 => Just(Some(f64::INFINITY))];
    prop::collection::vec((0..700_usize, value), 1..5)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]

    /// What is drawn does not depend on the frames before, bit by bit.
    #[test]
    fn partial_updates_draw_what_a_whole_frame_draws(
        changes in prop::collection::vec(change(), 1..6),
        extensive in any::<bool>(), packed in any::<bool>(), coarse in any::<bool>(),
    ) {
        let map = maps::skin(vec![
            maps::square_pyramid("palm", &[25, 17, 13], 0.05, 0.0013),
            maps::square_pyramid("back", &[7, 4], 0.03, 0.0013),
        ]);
        let quantity = if extensive { Quantity::Extensive } else { Quantity::Intensive };
        let atlas = atlas(&map, Resolution::Pixel(if coarse { 0.006 } else { 0.0011 }), packed);
        let mut frame = on_levels(&map, |_, k| hash(k));
        let mut stream = renderer(&map, &atlas, quantity);
        stream.render(&frame);
        for step in changes {
            for values in frame.values.iter_mut().flatten().flat_map(|levels| levels.iter_mut()) {
                let values: &mut IdVec<VertexId, f64> = values;
                let count = values.len();
                for &(k, value) in step.iter().filter(|(k, _)| *k < count) {
                    values[VertexId::new(k)] = value.unwrap_or(f64::NAN);
                }
            }
            let whole = bits(renderer(&map, &atlas, quantity).render(&frame));
            prop_assert!(bits(stream.render(&frame)) == whole);
        }
    }
}
