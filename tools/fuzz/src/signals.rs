//! Readings with arbitrary values through conditioning, levels, contacts and images; graphs through calibration.
//!
//! An input is the seed of its random numbers.

use std::sync::{Arc, LazyLock};

use dermatome::atlas::{Atlas, AtlasOptions};
use dermatome::calib::{
    CalibOptions, ContactMeasurement, ContactObservation, Displacement, DisplacementMeasurement, Information,
    Initialization, Loss, Model, Observations, Pose, PoseMeasurement, ResidualConvention, TaxelVariable,
};
use dermatome::id::VertexId;
use dermatome::io::{Readings, ReadingsReader};
use dermatome::least_squares::Options;
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::recording::{Carried, Fill, Recording, RecordingOptions};
use dermatome::signal::{Channel, ConditionOptions, TrackerOptions, Zero};
use dermatome::skin::TaxelId;
use dermatome::{BuildOptions, Skin, build, calibrate};
use glam::{DQuat, DVec3};
use mutate::Random;

use crate::{Counts, Outcome, in_two_threads, text};

#[rustfmt::skip]
const VALUES: [f64; 18] = [
    0.0, -0.0, 1.0, -1.0, 1e-300, 5e-324, 1e300, -1e300, f64::MAX, f64::MIN, 3.4e38, 3.5e38, -3.5e38, 1e38, 1e-30,
    f64::NAN, f64::INFINITY, f64::NEG_INFINITY,
];

pub(crate) fn generate(random: &mut Random) -> (String, Vec<u8>) {
    ("seed".to_owned(), random.next().to_le_bytes().to_vec())
}

/// The random numbers of an input.
fn random_of(bytes: &[u8]) -> Random {
    Random::new(bytes.iter().rev().fold(0, |seed, &byte| seed << 8 | u64::from(byte)))
}

fn value(random: &mut Random, wild: f64) -> f64 {
    if random.chance(wild) { *random.pick(&VALUES) } else { 10.0 * random.unit() }
}

/// Small skins: one taxel a corner, a flat one, and a bent one of several levels, with their images.
static MAPS: LazyLock<Vec<(Arc<SkinMap>, Atlas)>> = LazyLock::new(|| {
    let cap = build(&Skin::from_mesh("cap", shapes::cap(60, 0.05, 1.0)), &BuildOptions::default());
    let flat = [SkinMap::flat(shapes::triangle(), 0.1), SkinMap::flat(shapes::lattice(8, 8, 0.01), 0.004)];
    let with_atlas = |map| Some((Atlas::new(&map, &AtlasOptions::default()).ok()?, map));
    flat.into_iter().chain(cap).filter_map(with_atlas).map(|(atlas, map)| (Arc::new(map), atlas)).collect()
});

pub(crate) fn check_signals(_: &str, bytes: &[u8], _: &mut Random, counts: &mut Counts) -> Outcome {
    let random = &mut random_of(bytes);
    let (map, atlas) = random.pick(&MAPS);
    let units = ["Pa", "N", "kPa", "K", "", "mN", "N/m^2"];
    let channels: Vec<Channel> = (0..=random.below(3))
        .filter_map(|_| Channel::new("force", random.pick::<&str>(&units)).ok())
        .collect();
    let width: usize = map.patches.iter().map(|patch| patch.taxels.ids.len()).sum();
    let (wild, count) = (*random.pick(&[0.0, 0.02, 0.3, 0.9]), 1 + random.below(9));
    let times =
        (0..count).map(|k| if random.chance(0.1) { value(random, 0.9) } else { 0.1 * k as f64 }).collect();
    let values = (0..width * channels.len() * count).map(|_| value(random, wild)).collect();
    let readings = Readings { channels, width, times, values, ..Readings::default() };
    let options = RecordingOptions {
        condition: ConditionOptions {
            zero: *random.pick(&[Zero::Taken, Zero::At(1.0), Zero::First(2), Zero::First(5), Zero::Follow]),
            gains: (0..random.below(3)).map(|_| (TaxelId(1), value(random, 0.4))).collect(),
            clip: random.chance(0.3).then(|| [0.0, value(random, 0.4).abs()]),
            split_hz: random.chance(0.3).then(|| value(random, 0.4)),
            response: None,
        },
        fill: *random.pick(&[Fill::None, Fill::Neighbours]),
        ..RecordingOptions::default()
    };
    let reader = ReadingsReader::memory(readings).map_err(text)?;
    let Ok(mut recording) = Recording::open(map, reader, &options) else { return Ok(()) };
    recording.carry(*random.pick(&[Carried::Values, Carried::Contrast, Carried::Edges]), None);
    recording.draw(atlas).map_err(text)?;
    let tracked = TrackerOptions {
        channel: random.below(recording.channels().len()),
        threshold: random.chance(0.6).then(|| value(random, 0.1)),
        low: *random.pick(&[0.5, 1.0, 1e-9, 2.0]),
        least: random.below(12),
        prominence: *random.pick(&[0.5, 1.0, 1e-9]),
        part: random.below(6),
        noise_frames: 2 + random.below(3),
        lasting: random.below(4),
        ..TrackerOptions::default()
    };
    let _ = recording.follow_contacts(&tracked);
    while let Some(step) = recording.next_step().map_err(text)? {
        *counts.entry("frames").or_default() += 1;
        let most = f64::from(f32::MAX);
        let is_large = |x: &f64| x.abs() > most;
        if step.frame.values.iter().flatten().flatten().any(is_large) {
            return Err("a reading beyond f32".into());
        }
        let levels = step.levels.ok_or("no levels")?;
        if levels.values.iter().flatten().flatten().flatten().any(is_large) {
            return Err("a value of a level beyond f32".into());
        }
        if step.images.iter().any(|image| image.values.iter().any(|x| x.is_infinite())) {
            return Err("an infinite pixel".into());
        }
        for region in step.contacts {
            // A force is NaN where the unit is of none.
            let numbers = [region.area, region.major, region.minor, region.angle];
            if region.force.is_infinite()
                || !(numbers.iter().all(|x| x.is_finite())
                    && region.centre.is_finite()
                    && region.map.is_finite())
            {
                return Err("a region that is not finite".into());
            }
            if region.taxels.windows(2).any(|pair| pair[0] >= pair[1]) {
                return Err("a region with a taxel twice".into());
            }
        }
    }
    Ok(())
}

fn information<const N: usize>(random: &mut Random) -> Information<N> {
    let mut matrix = [[0.0; N]; N];
    let scale = *random.pick(&[0.0, 1e4, 1e4, 1e4, 1e-12, 1e12]);
    let row: [f64; N] = [0; N].map(|_| random.signed());
    let is_rank_one = random.chance(0.1);
    for i in 0..N {
        for j in 0..N {
            matrix[i][j] = if is_rank_one { row[i] * row[j] } else { f64::from(u8::from(i == j)) * scale };
        }
    }
    Information(matrix)
}

fn pose(random: &mut Random) -> Pose {
    let [x, y, z, w] = [0; 4].map(|_| random.signed());
    let position = DVec3::new(random.signed(), random.signed(), random.signed()) * 0.1;
    Pose { position, rotation: DQuat::from_xyzw(x, y, z, w + 1e-9).normalize() }
}

fn graph(random: &mut Random) -> (Observations, CalibOptions) {
    let (count, model) = (1 + random.below(9), *random.pick(&[Model::Poses, Model::Positions]));
    let truth: Vec<Pose> = (0..count).map(|_| pose(random)).collect();
    let wild = *random.pick(&[0.0, 0.0, 0.03, 0.3]);
    let mut found = Observations { model, ..Observations::default() };
    for (k, id) in (0..count).zip(0..) {
        let initial = random.chance(0.5).then_some(truth[k]);
        found.taxels.push(TaxelVariable { id: TaxelId(id), initial, fixed: random.chance(0.08) });
    }
    for _ in 0..random.below(3 * count + 1) {
        let (a, b) = (random.below(count), random.below(count));
        let offset = truth[b].position - truth[a].position;
        let inverse = truth[a].rotation.inverse();
        let measurement = if model == Model::Poses {
            let relative = Pose { position: inverse * offset, rotation: inverse * truth[b].rotation };
            let pose = if random.chance(0.15) { pose(random) } else { relative };
            DisplacementMeasurement::Relative(Box::new(PoseMeasurement {
                pose,
                information: information(random),
            }))
        } else {
            let offset = if random.chance(wild) { DVec3::splat(value(random, 0.8)) } else { offset };
            DisplacementMeasurement::Offset { offset, information: information(random) }
        };
        found.edges.push(Displacement { from: VertexId::new(a), to: VertexId::new(b), measurement });
    }
    for _ in 0..random.below(count + 1) {
        let at = random.below(count);
        let position =
            if random.chance(wild) { DVec3::splat(value(random, 0.9)) } else { truth[at].position };
        let measurement = ContactMeasurement::Position { position, information: information(random) };
        found.contacts.push(ContactObservation { taxel: VertexId::new(at), measurement });
    }
    let options = CalibOptions {
        residual: *random.pick(&[
            ResidualConvention::Split,
            ResidualConvention::Log,
            ResidualConvention::Quaternion,
        ]),
        robust: *random.pick(&[
            None,
            None,
            Some(Loss::Squared),
            Some(Loss::Huber),
            Some(Loss::Tukey),
            Some(Loss::Truncated),
        ]),
        initialization: *random.pick(&[Initialization::Chordal, Initialization::InitialValues]),
        limits: Options { max_iterations: 1 + random.below(30), ..Options::default() },
        covariances: random.chance(0.7),
    };
    (found, options)
}

pub(crate) fn check_calibration(_: &str, bytes: &[u8], _: &mut Random, counts: &mut Counts) -> Outcome {
    let random = &mut random_of(bytes);
    let (observations, options) = graph(random);
    let Ok(found) = calibrate(&observations, &options) else { return Ok(()) };
    *counts.entry("calibrated").or_default() += 1;
    if !found.cost.is_finite()
        || found.poses.iter().any(|p| !(p.position.is_finite() && p.rotation.is_finite()))
    {
        return Err(format!("a pose or cost that is not finite, {:?}", found.termination));
    }
    if found
        .marginals
        .iter()
        .flat_map(|all| all.positions.iter())
        .any(|matrix| format!("{matrix:?}").contains("NaN"))
    {
        return Err("a covariance is NaN".into());
    }
    if random.chance(0.05) {
        let again = in_two_threads(|| calibrate(&observations, &options))?.map_err(text)?;
        if again.poses != found.poses || again.marginals != found.marginals {
            return Err("two threads calibrate otherwise".into());
        }
    }
    Ok(())
}
