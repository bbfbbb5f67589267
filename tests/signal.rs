//! Laws of the values on taxels: what levels keep, what frames that change little cost nothing of.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use dermatome::{
    id::VertexId,
    map::SkinMap,
    mesh::shapes,
    pipeline::{BuildOptions, build},
    pyramid::LevelId,
    signal::{Channel, Contrast, Frame, LevelFrame, Quantity, Restrictor, reconstruct},
    skin::{PatchId, Skin},
};
use proptest::prelude::*;

/// A bent patch of about 320 taxels with three levels.
fn palm() -> SkinMap {
    build(&Skin::from_mesh("palm", shapes::cap(600, 0.1, 0.6)), &BuildOptions::default()).unwrap()
}

fn channels() -> [Channel; 2] {
    let channel =
        |name: &str, unit: &str, quantity| Channel { name: name.into(), unit: unit.into(), quantity };
    [channel("pressure", "Pa", Quantity::Intensive), channel("force", "N", Quantity::Extensive)]
}

/// A frame of pressures, and of the forces that they are.
fn pressures(map: &SkinMap, pressure: impl Fn(usize) -> f64) -> Frame {
    let mut frame = Frame::new(map, 2);
    for (id, patch) in map.patches.enumerate() {
        for (v, &area) in patch.taxels.areas.enumerate() {
            frame.values[id][0][v] = pressure(v.index());
            frame.values[id][1][v] = pressure(v.index()) * area;
        }
    }
    frame
}

/// Noise in 0..1 that depends on nothing but its two numbers.
fn noise(a: usize, b: usize) -> f64 {
    let mut x = (a as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ (b as u64 + 7).wrapping_mul(0xd1b5_4a32_d192_ed03);
    x ^= x >> 29;
    x = x.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    ((x ^ (x >> 32)) % 1_000_003) as f64 / 1_000_003.0
}

fn bits(levels: &LevelFrame) -> Vec<u64> {
    levels.values.iter().flatten().flatten().flatten().map(|x| x.to_bits()).collect()
}

const PALM: usize = 0;

#[test]
fn a_constant_is_the_same_on_every_level_whatever_taxels_are_dead() {
    let map = palm();
    assert!(map.patches[PatchId::new(PALM)].levels.len() > 2);
    let mut restrictor = Restrictor::new(&map, &channels());
    for dead in [0.0, 0.1, 0.9] {
        let frame = pressures(&map, |v| if noise(v, 1) < dead { f64::NAN } else { 3.25 });
        let levels = restrictor.restrict(&frame);
        for value in levels.values[PatchId::new(PALM)][0].iter().flatten().filter(|x| !x.is_nan()) {
            assert!((value - 3.25).abs() < 1e-12, "{value} with {dead} of the taxels dead");
        }
    }
}

#[test]
fn a_field_has_no_value_if_and_only_if_all_its_taxels_have_none() {
    let map = palm();
    let patch = &map.patches[PatchId::new(PALM)];
    let frame = pressures(&map, |v| if noise(v, 2) < 0.93 { f64::INFINITY } else { noise(v, 3) });
    let mut restrictor = Restrictor::new(&map, &channels());
    let levels = &restrictor.restrict(&frame).values[PatchId::new(PALM)];
    let mut empty = 0;
    for (k, fine) in patch.levels.enumerate().take(patch.levels.len() - 1) {
        let up = fine.level.from_coarser.as_ref().unwrap();
        for channel in levels {
            let mut is_live = vec![false; up.coarse_len];
            for v in up.indices.ids().filter(|&v| !channel[k][v].is_nan()) {
                up.row(v).for_each(|(field, _)| is_live[field.index()] = true);
            }
            for (field, live) in is_live.into_iter().enumerate() {
                let value = channel[LevelId::new(k.index() + 1)][VertexId::new(field)];
                assert_eq!(live, value.is_finite(), "field {field} above level {k:?}: {value}");
                empty += usize::from(!live);
            }
        }
    }
    assert!(empty > 0, "some fields must be dead for this to say anything");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    /// The total force of the live taxels is that of every level, for both kinds of channel.
    #[test]
    fn total_force_is_kept_on_every_level(seed in 0_usize..1000, dead in 0.0..0.8) {
        let map = palm();
        let patch = &map.patches[PatchId::new(PALM)];
        let pressure = |v| if noise(v, seed) < dead { f64::NAN } else { 1e4 * noise(v, seed + 1) };
        let mut restrictor = Restrictor::new(&map, &channels());
        let levels = &restrictor.restrict(&pressures(&map, pressure)).values[PatchId::new(PALM)];
        let live_sum = |values: &dyn Fn(VertexId) -> f64, count| -> f64 {
            (0..count).map(|v| values(VertexId::new(v))).filter(|x| !x.is_nan()).sum()
        };
        let total = live_sum(&|v| levels[1][LevelId::new(0)][v], patch.taxels.ids.len());
        let mut areas = patch.taxels.areas.enumerate().map(|(v, &a)| if levels[0][LevelId::new(0)][v].is_nan() { 0.0 } else { a }).collect::<dermatome::id::IdVec<_, _>>();
        for (k, level) in patch.levels.enumerate() {
            let force = live_sum(&|v| levels[1][k][v], levels[1][k].len());
            prop_assert!((force - total).abs() <= 1e-12 * total, "{} is {} on {:?}", force, total, k);
            let force = live_sum(&|v| areas[v] * levels[0][k][v], levels[0][k].len());
            prop_assert!((force - total).abs() <= 1e-12 * total, "{} is {} on {:?}", force, total, k);
            if let Some(up) = &level.level.from_coarser {
                areas = up.restrict(&areas);
            }
        }
    }

    /// A restrictor that has seen other frames gives the same bits as a new one.
    #[test]
    fn a_stream_gives_the_bits_of_single_frames(changes in proptest::collection::vec((0_usize..320, 1_usize..40, 0.0..1.5), 1..12)) {
        let map = palm();
        let count = map.patches[PatchId::new(PALM)].taxels.ids.len();
        let mut frame = pressures(&map, |v| noise(v, 5));
        let mut restrictor = Restrictor::new(&map, &channels());
        for (begin, many, value) in changes {
            for v in begin..(begin + many).min(count) {
                let value = if value > 1.0 { f64::NAN } else { value };
                frame.values[PatchId::new(PALM)].iter_mut().for_each(|channel| channel[VertexId::new(v)] = value);
            }
            let found = bits(restrictor.restrict(&frame));
            prop_assert_eq!(found, bits(Restrictor::new(&map, &channels()).restrict(&frame)));
        }
    }
}

/// The contrast sums back to the frame, and a constant pressure has none but on the coarsest level,
/// also with dead taxels and for its forces.
#[test]
fn contrast_sums_back_and_a_constant_has_none() {
    let map = palm();
    let coarsest = map.patches[PatchId::new(PALM)].levels.len() - 1;
    for (dead, constant) in [(0.0, false), (0.3, false), (0.0, true), (0.3, true)] {
        let pressure = |v| if constant { 5.0 } else { noise(v, 8) };
        let frame = pressures(&map, |v| if noise(v, 9) < dead { f64::NAN } else { pressure(v) });
        let levels = Restrictor::new(&map, &channels()).restrict(&frame).clone();
        let mut contrast = Contrast::new(&map, &channels());
        let detail = contrast.of(&levels);
        let back = reconstruct(&map, &channels(), detail);
        for channel in 0..2 {
            let of = |frame: &LevelFrame| frame.values[PatchId::new(PALM)][channel].clone();
            let (levels, detail, back) = (of(&levels), of(detail), of(&back));
            for (k, values) in levels.enumerate() {
                let largest = values.iter().filter(|x| !x.is_nan()).fold(0.0_f64, |m, x| m.max(x.abs()));
                for (v, &value) in values.enumerate() {
                    assert_eq!(value.is_nan(), back[k][v].is_nan(), "{v} of {k:?}");
                    assert!(value.is_nan() || (back[k][v] - value).abs() <= 1e-12 * largest, "{v} of {k:?}");
                    let none = !constant || k.index() == coarsest || value.is_nan();
                    assert!(none || detail[k][v].abs() <= 1e-12 * largest, "contrast of {v} of {k:?}");
                }
            }
        }
    }
}
