//! Laws of the values on taxels: what levels keep, what frames that change little cost nothing of.

use dermatome::id::{IdVec, VertexId};
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::pipeline::{BuildOptions, build};
use dermatome::pyramid::LevelId;
use dermatome::signal::{Channel, Contrast, Edges, Frame, LevelFrame, Restrictor, reconstruct};
use dermatome::skin::{PatchId, Skin};
use glam::DVec2;
use proptest::prelude::*;

/// A bent patch of about 320 taxels with three levels.
fn palm() -> SkinMap {
    build(&Skin::from_mesh("palm", shapes::cap(600, 0.1, 0.6)), &BuildOptions::default()).unwrap()
}

fn channels() -> [Channel; 2] {
    [("pressure", "Pa"), ("force", "N")].map(|(name, unit)| Channel::new(name, unit).unwrap())
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
    for (k, level) in patch.levels.enumerate().skip(1) {
        let rows = level.level.to_finest.as_ref().unwrap();
        for channel in levels {
            let mut is_live = vec![false; rows.coarse_len];
            for v in rows.indices.ids().filter(|&v| !channel[LevelId::new(0)][v].is_nan()) {
                rows.row(v).for_each(|(field, _)| is_live[field.index()] = true);
            }
            for (field, live) in is_live.into_iter().enumerate() {
                let value = channel[k][VertexId::new(field)];
                assert_eq!(live, value.is_finite(), "field {field} of level {k:?}: {value}");
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
        for (k, level) in patch.levels.enumerate() {
            let force = live_sum(&|v| levels[1][k][v], levels[1][k].len());
            prop_assert!((force - total).abs() <= 1e-12 * total, "{} is {} on {:?}", force, total, k);
            let areas = patch.taxels.areas.enumerate();
            let served: IdVec<VertexId, f64> = areas.map(|(v, &a)| if levels[0][LevelId::new(0)][v].is_nan() { 0.0 } else { a }).collect();
            let areas = level.level.to_finest.as_ref().map_or_else(|| served.clone(), |rows| rows.restrict(&served));
            let force = live_sum(&|v| areas[v] * levels[0][k][v], levels[0][k].len());
            prop_assert!((force - total).abs() <= 1e-12 * total, "{} is {} on {:?}", force, total, k);
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

/// What is carried to one level alone has the bits that it has among all.
#[test]
fn one_level_has_the_bits_of_all() {
    let map = palm();
    for k in (0..5).map(LevelId::new) {
        let mut alone = Restrictor::to_level(&map, &channels(), k);
        for seed in 0..3 {
            let frame = pressures(&map, |v| if noise(v, seed) < 0.1 { f64::NAN } else { noise(v, seed + 9) });
            let all = Restrictor::new(&map, &channels()).restrict(&frame).clone();
            let one = alone.restrict(&frame);
            let of = |levels: &IdVec<LevelId, IdVec<VertexId, f64>>| {
                levels.get(k).map(|x| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>())
            };
            for (all, one) in [(&all.values, &one.values), (&all.areas, &one.areas)] {
                let [all, one] =
                    [all, one].map(|levels| levels[PatchId::new(PALM)].iter().map(of).collect::<Vec<_>>());
                assert_eq!(all, one, "level {k:?}");
            }
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

/// Gradients are exact for readings that are linear on the map of a level, at its rim too and whatever
/// taxels are dead; there is none where no face has a value at all of its corners.
#[test]
fn edges_are_exact_for_linear_fields() {
    let (map, channels, patch) = (palm(), channels(), PatchId::new(PALM));
    let slope = DVec2::new(-30.0, 12.0);
    let levels = &map.patches[patch].levels;
    for dead in [0.0, 0.1, 0.5] {
        let mut edges = Edges::new(&map, &channels);
        for (k, level) in levels.enumerate() {
            let on_level = level.opened_uv().map(|at| 40.0 + slope.dot(*at));
            let linear =
                level.level.to_finest.as_ref().map_or_else(|| on_level.clone(), |q| q.apply(&on_level));
            let pressure = |v: usize| if noise(v, 4) < dead { f64::NAN } else { linear[VertexId::new(v)] };
            let frame = Restrictor::new(&map, &channels).restrict(&pressures(&map, pressure)).clone();
            let steep = &edges.of(&frame).values[patch];
            let mut known = 0;
            for v in level.level.mesh.positions.ids() {
                for [along_u, along_v] in [[0, 1], [2, 3]].map(|pair| pair.map(|c| steep[c][k][v])) {
                    if along_u.is_nan() {
                        continue;
                    }
                    known += 1;
                    let found = DVec2::new(along_u, along_v);
                    assert!((found - slope).length() < 1e-6, "{found} at {v} of {k:?}, {dead} dead");
                }
            }
            let all = 2 * level.level.mesh.positions.len();
            assert!(known > 0 && (known == all || dead > 0.0), "{known} of {all} on {k:?}");
        }
    }
    // A constant pressure has no edge, nor have its forces.
    let frame = pressures(&map, |v| if v % 5 == 0 { f64::NAN } else { 70.0 });
    let mut edges = Edges::new(&map, &channels);
    let steep = edges.of(Restrictor::new(&map, &channels).restrict(&frame));
    let largest = steep.values[patch].iter().flatten().flatten().filter(|x| x.is_finite());
    assert!(largest.fold(0.0_f64, |m, x| m.max(x.abs())) < 1e-6);
}

/// The weights of a field are those that a lookup of a contact names: hat functions of its level.
#[test]
fn a_field_collects_by_the_weights_of_lookups() {
    let map = palm();
    let patch = &map.patches[PatchId::new(PALM)];
    for k in 0..patch.taxels.ids.len() {
        let taxel = VertexId::new(k);
        let frame = pressures(&map, |v| if v == k { 1.0 } else { 0.0 });
        let forces =
            &Restrictor::new(&map, &channels()).restrict(&frame).values[PatchId::new(PALM)][1].clone();
        for (level, of_level) in patch.levels.enumerate().skip(1) {
            let rows = of_level.level.to_finest.as_ref().unwrap();
            let mut left = forces[level].clone();
            rows.row(taxel).for_each(|(field, w)| left[field] -= w * patch.taxels.areas[taxel]);
            assert!(left.iter().all(|x| x.abs() < 1e-18), "taxel {k} on level {level:?}");
        }
    }
}
