//! Laws of channels: zeros, responses and thresholds concern what measures touches, whatever the prefix of its unit, and
//! readings of other kinds stay what they are; one zero, from the file or from frames at rest.

use std::sync::Arc;

use dermatome::id::VertexId;
use dermatome::io::{KnownRest, Readings, ReadingsReader};
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::recording::{Fill, Recording, RecordingOptions, Reference, respond};
use dermatome::run::Run;
use dermatome::signal::{
    Channel, ConditionOptions, Filler, Frame, Group, Response, Rest, Scale, SignalError, Stage,
    TaxelResponse, TaxelState, TrackerOptions, Zero,
};
use dermatome::skin::{PatchId, Presence, TaxelId};

fn patch() -> PatchId {
    PatchId::new(0)
}

/// A sheet of 9 x 7 taxels; the taxel 40 is absent.
fn sheet() -> Arc<SkinMap> {
    let mut map = SkinMap::flat(shapes::lattice(9, 7, 0.004), 1e-3);
    map.patches[patch()].taxels.presence[VertexId::new(40)] = Presence::Absent;
    Arc::new(map)
}

/// Each taxel reads 200 and 0.07 more, sheared by 3, at 30.01 degrees; all of the same unit but for the temperature.
fn readings(units: [&str; 3]) -> Readings {
    let names = ["pressure", "shear.x", "temp"];
    let channels = names.iter().zip(units).map(|(name, unit)| Channel::new(name, unit).unwrap()).collect();
    let values = [200.07, 3.0, 30.01].into_iter().flat_map(|x| [x; 63]);
    Readings {
        channels,
        width: 63,
        times: (0..4).map(|k| 0.1 * f64::from(k)).collect(),
        values: values.collect::<Vec<f64>>().repeat(4),
        ..Readings::default()
    }
}

fn response(unit: &str) -> Response {
    let taxel = |id: u32| TaxelResponse {
        zero: Some(200.0),
        gain: Some(1000.0),
        state: if id == 12 { TaxelState::Dead } else { TaxelState::Ok },
        ..TaxelResponse::unknown(TaxelId(id))
    };
    Response {
        unit: unit.into(),
        scale: Some(Scale::Pascals),
        taxels: (1..=63).map(taxel).collect(),
        ..Response::default()
    }
}

fn condition(
    map: &Arc<SkinMap>,
    readings: Readings,
    options: ConditionOptions,
) -> Result<Frame, SignalError> {
    let reader = ReadingsReader::memory(readings).unwrap();
    let options = RecordingOptions { condition: options, ..RecordingOptions::default() };
    let mut recording = Recording::open(map, reader, &options)?;
    let mut last = Frame::default();
    while let Some(step) = recording.next_step().unwrap() {
        last = step.frame.clone();
    }
    Ok(last)
}

#[test]
fn zero_and_response_change_channels_of_touch_alone() {
    let map = sheet();
    for unit in ["V", "mV", "F", "pF", "Ohm", "kOhm", "count", "nA"] {
        for zero in [Zero::Taken, Zero::At(200.0), Zero::First(2), Zero::Follow, Zero::Stored] {
            let response = (zero == Zero::Stored).then(|| response(unit));
            let options = ConditionOptions { zero, response, ..ConditionOptions::default() };
            let frame = condition(&map, readings([unit, unit, "degC"]), options).unwrap();
            let of = |channel: usize, taxel: usize| frame.values[patch()][channel][VertexId::new(taxel)];
            assert_eq!(of(2, 0), 30.01, "the temperature, {zero:?}, {unit}");
            let pressure = match zero {
                Zero::Taken => 200.07,
                Zero::At(_) => 0.07,
                Zero::Stored => 70.0,
                _ => 0.0,
            };
            assert!((of(0, 0) - pressure).abs() < 1e-9, "{zero:?}, {unit}: {}", of(0, 0));
            let shear = match zero {
                Zero::Taken | Zero::Stored => 3.0,
                Zero::At(zero) => 3.0 - zero,
                _ => 0.0,
            };
            assert_eq!(of(1, 0), shear, "{zero:?}, {unit}");
            let is_masked = (0..3).map(|channel| of(channel, 11).is_nan());
            assert!(is_masked.eq([zero == Zero::Stored; 3]), "a faulty taxel is masked in all channels");
        }
    }
}

#[test]
fn what_applies_to_no_channel_is_refused() {
    let map = sheet();
    let temperatures = || Readings {
        channels: ["temp", "acc.x", "strain"].map(|name| Channel::new(name, "K").unwrap()).to_vec(),
        ..readings(["K", "K", "K"])
    };
    let gains = ConditionOptions { gains: vec![(TaxelId(1), 2.0)], ..ConditionOptions::default() };
    let responds = ConditionOptions { response: Some(response("")), ..ConditionOptions::default() };
    let zeros = [Zero::At(200.0), Zero::First(2), Zero::Follow];
    let zeros = zeros.map(|zero| ConditionOptions { zero, ..ConditionOptions::default() });
    for options in zeros.into_iter().chain([gains, responds]) {
        let found = condition(&map, temperatures(), options.clone());
        assert!(matches!(found, Err(SignalError::NoTouch { .. })), "{options:?}: {found:?}");
    }
    assert!(condition(&map, temperatures(), ConditionOptions::default()).is_ok());
    // Temperatures have sums, but neither contacts nor a threshold.
    let open = || {
        let reader = ReadingsReader::memory(temperatures()).unwrap();
        Recording::open(&map, reader, &RecordingOptions::default()).unwrap()
    };
    let stated = TrackerOptions { threshold: Some(1.0), ..TrackerOptions::default() };
    assert!(matches!(open().follow_contacts(&TrackerOptions::default()), Err(SignalError::NoTouch { .. })));
    assert!(matches!(open().summarise(&stated), Err(SignalError::NoTouch { .. })));
    assert_eq!(open().summarise(&TrackerOptions::default()), Ok(()));
}

/// Taxels without a reading are filled from others, slots without a taxel are not, nor does a value cross them.
#[test]
fn absent_taxels_are_never_filled() {
    let map = sheet();
    let mut frame = Frame::new(&map, 1);
    frame.values[patch()][0].iter_mut().for_each(|x| *x = 1.0);
    for taxel in [20, 40] {
        frame.values[patch()][0][VertexId::new(taxel)] = f64::NAN;
    }
    let filled = Filler::new(&map, &[Channel::default()]).apply(&frame).clone();
    assert_eq!(filled.values[patch()][0][VertexId::new(20)], 1.0);
    assert!(filled.values[patch()][0][VertexId::new(40)].is_nan());
    assert_eq!(filled.filled[patch()][0], [VertexId::new(20)]);
}

/// Frames of noise and a load of three taxels: what each frame reads, and noise of some size.
fn loaded(load: impl Fn(usize) -> f64, rest: f64, noise: f64, unit: &str) -> Readings {
    let value = |k: usize| {
        let (frame, taxel) = (k / 63, k % 63);
        let pressed = if [22, 23, 31, 32].contains(&taxel) { load(frame) } else { 0.0 };
        let random = ((k * 7919 + k * k * 31) % 1009) as f64 / 504.5 - 1.0;
        rest * (1.0 + taxel as f64) + pressed + noise * random
    };
    Readings {
        channels: vec![Channel::new("pressure", unit).unwrap()],
        width: 63,
        times: (0..60).map(|k| 0.05 * f64::from(k)).collect(),
        values: (0..60 * 63).map(value).collect(),
        ..Readings::default()
    }
}

/// The largest sum of a frame, the threshold, and remarks.
fn summary(map: &Arc<SkinMap>, readings: Readings, zero: Zero) -> (f64, f64, Vec<String>) {
    let condition = ConditionOptions { zero, ..ConditionOptions::default() };
    let options = RecordingOptions { condition, fill: Fill::None, ..RecordingOptions::default() };
    let reader = ReadingsReader::memory(readings).unwrap();
    let mut recording = Recording::open(map, reader, &options).unwrap();
    recording.summarise(&recording.tracker_options(0)).unwrap();
    while recording.next_step().unwrap().is_some() {}
    let summary = recording.summary().unwrap();
    let (_, totals) = summary.totals().find(|(group, _)| *group == Group::Whole).unwrap();
    (totals.peak.unwrap(), recording.threshold().unwrap(), recording.contact_remarks())
}

/// What is tared is not zeroed, also where a recording begins under load, and its threshold is that of the file, else of its
/// noise about 0.
#[test]
fn tared_readings_are_summed_as_they_are() {
    let map = sheet();
    for noise in [0.0, 10.0] {
        for (stated, zero) in [(None, Zero::Taken), (Some(30.0), Zero::Taken), (None, Zero::At(0.0))] {
            let mut readings = loaded(|frame| if frame < 40 { 1000.0 } else { 0.0 }, 0.0, noise, "Pa");
            readings.rest = KnownRest { is_zero: vec![zero == Zero::Taken], threshold: stated };
            let (peak, threshold, remarks) = summary(&map, readings, zero);
            assert!((peak - 1000.0).abs() <= noise, "{peak}");
            let expected = stated.map_or([noise * 2.0, noise * 5.0], |stated| [stated; 2]);
            assert!((expected[0]..=expected[1].max(1e-2)).contains(&threshold), "{threshold}, noise {noise}");
            assert!(remarks.is_empty(), "{remarks:?}");
        }
    }
}

/// Counts whose first frames move are named, and those that begin under a constant load, when readings fall below.
#[test]
fn counts_that_begin_under_load_are_named() {
    let map = sheet();
    let ends = |frame: usize| if frame < 20 { 200.0 - 8.0 * frame as f64 } else { 0.0 };
    let (_, _, remarks) = summary(&map, loaded(ends, 30.0, 1.0, "count"), Zero::Taken);
    assert!(remarks.iter().any(|remark| remark.contains("move together")), "{remarks:?}");
    // A load that comes at once, within the frames, hides its motion in their mean.
    for first in 1..5 {
        let steps = |frame: usize| if frame < first { 0.0 } else { 200.0 };
        let (_, _, remarks) = summary(&map, loaded(steps, 30.0, 1.0, "count"), Zero::Taken);
        assert!(remarks.iter().any(|remark| remark.contains("move together")), "frame {first}: {remarks:?}");
    }
    let held = |frame: usize| if frame < 20 { 200.0 } else { 0.0 };
    let (_, _, remarks) = summary(&map, loaded(held, 30.0, 1.0, "count"), Zero::Taken);
    assert!(remarks.iter().any(|remark| remark.contains("far below")), "{remarks:?}");
    let untouched = |frame: usize| if frame < 20 { 0.0 } else { 200.0 };
    let (peak, _, remarks) = summary(&map, loaded(untouched, 30.0, 1.0, "count"), Zero::Taken);
    assert!((peak - 200.0).abs() < 5.0 && remarks.is_empty(), "{peak}, {remarks:?}");
    let options = Recording::open(
        &map,
        ReadingsReader::memory(loaded(untouched, 30.0, 1.0, "count")).unwrap(),
        &RecordingOptions::default(),
    );
    assert_eq!(options.unwrap().tracker_options(0).rest, Rest::Learned);
}

/// A force becomes the pressure of its name, unless there is one already; a response that names a channel is of this one.
#[test]
fn pressures_keep_the_names_apart() {
    let map = sheet();
    let names = |names: [&str; 3], of: &str| {
        let channels = names.map(|name| Channel::new(name, "count").unwrap()).to_vec();
        let response = Response { channel: of.into(), ..response("count") };
        let options = ConditionOptions { response: Some(response), ..ConditionOptions::default() };
        let readings = Readings { channels, ..readings(["count"; 3]) };
        let reader = ReadingsReader::memory(readings).unwrap();
        let options = RecordingOptions { condition: options, ..RecordingOptions::default() };
        let recording = Recording::open(&map, reader, &options).unwrap();
        recording
            .channels()
            .iter()
            .map(|channel| format!("{}[{}]", channel.name, channel.unit))
            .collect::<Vec<_>>()
    };
    assert_eq!(
        names(["force1", "force2", "force.x"], ""),
        ["pressure1[Pa]", "pressure2[Pa]", "force.x[count]"]
    );
    assert_eq!(names(["force", "pressure", "other"], ""), ["force[Pa]", "pressure[Pa]", "other[Pa]"]);
    assert_eq!(names(["pdc", "force", "pac"], "pac"), ["pdc[count]", "force[count]", "pac[Pa]"]);
    assert_eq!(names(["pdc", "force", "pac"], "none"), ["pdc[Pa]", "pressure[Pa]", "pac[Pa]"]);
}

/// Two statements of one unit are compared, and the zeros of a response are subtracted where no other zero is known.
#[test]
fn units_and_zeros_of_a_response_are_those_that_are_stated() {
    let map = sheet();
    let open = |units: [&str; 3], options: &RecordingOptions| {
        Recording::open(&map, ReadingsReader::memory(readings(units)).unwrap(), options)
    };
    let given = |unit: &str| RecordingOptions {
        units: [unit, unit, "degC"].map(String::from).to_vec(),
        ..RecordingOptions::default()
    };
    let refused = open(["kPa", "kPa", "degC"], &given("Pa")).err().unwrap();
    assert!(matches!(refused, SignalError::UnitTwice { .. }), "{refused}");
    for unit in ["", "kPa"] {
        assert!(open([unit, unit, "degC"], &given("kPa")).is_ok(), "{unit:?}");
    }
    let with = |response: Response, zero: Zero| RecordingOptions {
        condition: ConditionOptions { zero, response: Some(response), ..ConditionOptions::default() },
        ..RecordingOptions::default()
    };
    let counts = ["count", "count", "degC"];
    let first = |mut recording: Recording| {
        recording.next_step().unwrap().unwrap().frame.values[patch()][0][VertexId::new(0)]
    };
    let taken = open(counts, &with(response("count"), Zero::Taken)).unwrap();
    assert!(taken.statements().iter().any(|known| known.value == "that of the response, subtracted"));
    assert_eq!(taken.tracker_options(0).rest, Rest::AtZero);
    let stored = first(open(counts, &with(response("count"), Zero::Stored)).unwrap());
    assert_eq!(first(taken), stored);
    let without = || {
        let mut response = response("count");
        response.taxels[5].zero = None;
        response
    };
    let refused = open(counts, &with(without(), Zero::Taken)).err().unwrap();
    assert!(matches!(refused, SignalError::ZerosUnknown { known: 62, taxels: 63 }), "{refused}");
    assert_eq!(first(open(counts, &with(without(), Zero::At(200.0))).unwrap()), stored);
}

/// A channel of counts beside a pressure learns its own rest, and the pressure does not.
#[test]
fn channels_beside_each_other_have_rests_of_their_own() {
    let map = sheet();
    let mut two = readings(["kPa", "count", "degC"]);
    two.channels[1] = Channel::new("raw", "count").unwrap();
    two.rest.is_zero = vec![true, false, false];
    let recording =
        Recording::open(&map, ReadingsReader::memory(two).unwrap(), &RecordingOptions::default()).unwrap();
    let rest = |channel| recording.tracker_options(channel).rest;
    assert_eq!([0, 1, 2].map(rest), [Rest::AtZero, Rest::Learned, Rest::Learned]);
    assert!(!recording.is_tared());
    assert_eq!(recording.known_rest().is_zero, [true, false, false]);
}

/// Times that stand still measure nothing: it is said, and a rate counts in their place.
#[test]
fn times_that_stand_still_are_none() {
    let map = sheet();
    let open = |rate_hz: Option<f64>| {
        let still = Readings {
            times: vec![7.0; 60],
            ..loaded(|frame| if frame > 20 { 500.0 } else { 0.0 }, 0.0, 1.0, "Pa")
        };
        let options = RecordingOptions { rate_hz, ..RecordingOptions::default() };
        let mut recording = Recording::open(&map, ReadingsReader::memory(still).unwrap(), &options).unwrap();
        recording.summarise(&recording.tracker_options(0)).unwrap();
        let mut times = Vec::new();
        while let Some(step) = recording.next_step().unwrap() {
            times.push(step.frame.time);
        }
        let totals = recording.summary().unwrap().totals().next().unwrap().1.clone();
        let said = recording.statements().iter().any(|known| known.value.contains("later than the first"));
        (times, totals.impulse, totals.contact_time, said)
    };
    let (times, impulse, contact_time, said) = open(None);
    assert_eq!((times[59], impulse, contact_time, said), (7.0, None, None, true));
    let (times, impulse, contact_time, said) = open(Some(10.0));
    assert_eq!(times, (0..60).map(|k| f64::from(k) / 10.0).collect::<Vec<_>>());
    assert!(impulse.unwrap() > 0.0 && contact_time.unwrap() > 3.0 && !said);
}

/// Patches that share ids have one response where readings come by ids, and are refused where each taxel has readings of its own.
#[test]
fn shared_ids_have_one_response() {
    let mut map = (*sheet()).clone();
    let mut other = map.patches[patch()].clone();
    other.name = "other".into();
    map.patches.push(other);
    let map = Arc::new(map);
    let open = |ids: Option<Vec<TaxelId>>| {
        let width = if ids.is_some() { 63 } else { 126 };
        let readings = Readings {
            channels: vec![Channel::new("pressure", "count").unwrap()],
            values: vec![1.0; 4 * width],
            ids,
            width,
            ..readings(["count"; 3])
        };
        let open = |_, _: Option<&Response>| {
            let reader = ReadingsReader::memory(readings.clone())?;
            Ok::<_, dermatome::Error>(Recording::open(&map, reader, &RecordingOptions::default())?)
        };
        respond(&map, Reference::Touches, 1, open, |_| {}, Run::default()).unwrap_err().to_string()
    };
    assert!(open(None).contains("patches share the taxel id"), "{}", open(None));
    let by_ids = open(Some((1..=63).map(TaxelId).collect()));
    assert!(!by_ids.contains("share"), "{by_ids}");
}
