//! Laws of recordings: what a recording passes on is what its stages give one by one, whatever frames are asked for.

use std::sync::Arc;

use crate::maps::{skin, square_pyramid};
use dermatome::Error;
use dermatome::atlas::{Atlas, AtlasOptions};
use dermatome::id::VertexId;
use dermatome::image::Renderer;
use dermatome::io::{Block, IoError, Readings, ReadingsReader};
use dermatome::map::SkinMap;
use dermatome::recording::{Carried, Fill, FrameRange, Recording, RecordingOptions, Reference, respond};
use dermatome::run::Run;
use dermatome::signal::{
    Channel, ConditionOptions, Conditioner, ContactEvent, ContactTracker, Duplicates, Filler, Frame, Join,
    Response, Restrictor, Scale, SignalError, Stage, Zero,
};
use dermatome::skin::PatchId;

fn palm() -> Arc<SkinMap> {
    Arc::new(skin(vec![square_pyramid("palm", &[13, 7, 4], 0.06, 0.001)]))
}

/// Thirty frames of 169 taxels in two channels: a touch that moves, with a taxel that comes and goes.
fn readings() -> Readings {
    let value = |k: u32| {
        let (frame, channel, taxel) = (k / 338, k / 169 % 2, k % 169);
        let touched = frame > 8 && taxel.abs_diff(5 * frame) < 4;
        let noise = f64::from((k * 7919) % 101) / 1000.0;
        match (taxel, frame % 3) {
            (80, 0) => f64::NAN,
            _ => noise + if touched { 40.0 } else { f64::from(channel) },
        }
    };
    Readings {
        channels: ["a", "b"].map(|name| Channel::new(name, "Pa").unwrap()).to_vec(),
        width: 169,
        times: (0..30).map(|k| 0.05 * f64::from(k)).collect(),
        values: (0..30 * 338).map(value).collect(),
        ..Readings::default()
    }
}

/// Some of these frames.
fn part(frames: std::ops::Range<usize>) -> Readings {
    let whole = readings();
    Readings {
        times: whole.times[frames.clone()].to_vec(),
        values: whole.values[338 * frames.start..338 * frames.end].to_vec(),
        ..whole
    }
}

fn open(map: &Arc<SkinMap>, options: &RecordingOptions) -> Recording {
    Recording::open(map, ReadingsReader::memory(readings()).unwrap(), options).unwrap()
}

#[test]
fn a_recording_is_its_stages_one_after_the_other() {
    let (map, readings) = (palm(), readings());
    let condition =
        ConditionOptions { zero: Zero::First(6), split_hz: Some(3.0), ..ConditionOptions::default() };
    let fill = Fill::Neighbours;
    let mut recording =
        open(&map, &RecordingOptions { condition: condition.clone(), fill, ..RecordingOptions::default() });
    let atlas = Atlas::new(&map, &AtlasOptions::default()).unwrap();
    recording.draw(&atlas).unwrap();
    let tracking = recording.tracker_options(1);
    recording.follow_contacts(&tracking).unwrap();

    let join = Join::new(&map, None, 169, Duplicates::Refuse).unwrap();
    let mut conditioner = Conditioner::new(&map, &readings.channels, &condition).unwrap();
    let channels = conditioner.channels().to_vec();
    let mut filler = Filler::new(&map, &channels);
    let mut restrictor = Restrictor::new(&map, &channels);
    let mut renderer = Renderer::new(&map, &atlas, &channels, None).unwrap();
    let mut tracker = ContactTracker::new(&map, &channels[1], &tracking).unwrap();
    let frame = |(values, &time): (&[f64], &f64)| {
        let mut frame = Frame { time, ..Frame::new(&map, 2) };
        join.fill(values, &mut frame);
        frame
    };
    let frames: Vec<Frame> = readings.values.chunks(338).zip(&readings.times).map(frame).collect();
    frames[..6].iter().for_each(|frame| conditioner.learn(frame));
    conditioner.settle();
    assert_eq!(recording.frames(), Some(30));
    let mut touched = 0;
    let frames: Vec<Frame> =
        frames.iter().map(|frame| filler.apply(conditioner.apply(frame)).clone()).collect();
    frames[..tracker.frames_to_learn()].iter().for_each(|frame| tracker.learn(frame));
    tracker.settle();
    for (number, frame) in frames.iter().enumerate() {
        let step = recording.next_step().unwrap().unwrap();
        assert_eq!((step.number, step.frame), (number, frame));
        let levels = restrictor.restrict(frame);
        assert_eq!(step.levels, Some(levels));
        let bits = |x: &f32| x.to_bits();
        for (a, b) in step.images.iter().zip(renderer.render(levels)) {
            assert!(a.values.iter().map(bits).eq(b.values.iter().map(bits)));
        }
        let contacts = tracker.track(frame);
        assert_eq!(step.contacts, contacts);
        touched += contacts.len();
    }
    assert!(recording.next_step().unwrap().is_none() && touched > 10);
    assert_eq!(
        (recording.report().read, recording.report().frames, recording.report().missing),
        (30, 30, 20)
    );
}

/// A touch is a contact in the first frames and in a short recording as in any other, and whether it is does not depend
/// on what came before.
#[test]
fn contacts_depend_on_no_earlier_touch() {
    let map = palm();
    let contacts = |heights: &[f64], noise: f64| {
        let value = |(k, height): (usize, &f64)| -> Vec<f64> {
            let near = |taxel: usize| [45, 46, 58, 59].contains(&taxel);
            let noise = |taxel: usize| noise * ((taxel * 31 + k * 17) % 7) as f64;
            (0..169).map(|taxel| noise(taxel) + if near(taxel) { *height } else { 0.0 }).collect()
        };
        let readings = Readings {
            channels: vec![Channel::new("pressure", "Pa").unwrap()],
            width: 169,
            times: (0..heights.len()).map(|k| 0.1 * k as f64).collect(),
            values: heights.iter().enumerate().flat_map(value).collect(),
            ..Readings::default()
        };
        let reader = ReadingsReader::memory(readings).unwrap();
        let mut recording = Recording::open(&map, reader, &RecordingOptions::default()).unwrap();
        recording.follow_contacts(&recording.tracker_options(0)).unwrap();
        let mut found = Vec::new();
        while let Some(step) = recording.next_step().unwrap() {
            found.push(step.contacts.iter().filter(|region| region.event != ContactEvent::Release).count());
        }
        (found, recording.threshold())
    };
    // Without noise every reading above rest is a touch.
    let (before, threshold) = contacts(&[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 5000.0, 0.0, 1.0], 0.0);
    assert_eq!((before, threshold), (vec![0, 0, 0, 0, 0, 1, 0, 1, 0, 1], Some(0.0)));
    // In the fourth frame of five from which the noise is estimated, and in a recording of three.
    let (early, _) = contacts(&[0.0, 0.0, 0.0, 900.0, 0.0, 0.0, 0.0], 1.0);
    assert_eq!(early[3], 1, "{early:?}");
    let (short, threshold) = contacts(&[0.0, 0.0, 900.0], 1.0);
    assert!(short[2] == 1 && threshold.is_some(), "{short:?}");
    assert_eq!(contacts(&[900.0], 1.0), (vec![0], None), "one frame does not tell its noise");
}

#[test]
fn frames_that_are_left_out_change_no_other() {
    let map = palm();
    let all = |frames: FrameRange, baseline: usize| {
        let condition = ConditionOptions {
            zero: Zero::First(baseline),
            split_hz: Some(3.0),
            ..ConditionOptions::default()
        };
        let mut recording =
            open(&map, &RecordingOptions { condition, frames, ..RecordingOptions::default() });
        let (count, mut found) = (recording.frames().unwrap(), Vec::new());
        while let Some(step) = recording.next_step().unwrap() {
            found.push((step.number, step.frame.values[PatchId::new(0)][0][VertexId::new(3)]));
        }
        assert_eq!(count, found.len() as u64, "{frames:?}");
        found
    };
    // A baseline of more frames than there are is the mean of those that there are.
    for baseline in [0, 4, 99] {
        let whole = all(FrameRange::default(), baseline);
        assert_eq!(whole.len(), 30);
        for (from, to, every) in
            [(0, Some(2), 1), (3, None, 4), (7, Some(20), 5), (29, None, 1), (40, None, 1), (5, Some(2), 1)]
        {
            let expected = |(number, _): &(usize, f64)| {
                *number >= from && to.is_none_or(|to| *number <= to) && (number - from) % every == 0
            };
            let expected: Vec<_> = whole.iter().copied().filter(expected).collect();
            assert_eq!(all(FrameRange { from, to, every }, baseline), expected, "{from}, {to:?}, {every}");
        }
    }
    assert_eq!(all(FrameRange::one(7), 0).len(), 1);
}

#[test]
fn options_that_do_not_fit_the_readings_are_refused() {
    let map = palm();
    let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
    let none = RecordingOptions::default;
    let channels = || ["a", "b"].map(|name| Channel::new(name, "").unwrap()).to_vec();
    let without_units = || Readings { channels: channels(), ..readings() };
    let split = ConditionOptions { split_hz: Some(1.0), ..ConditionOptions::default() };
    for (options, has_times, expected) in [
        (RecordingOptions { names: names(&["a"]), ..none() }, true, "1 names for 2 channels (a, b)"),
        (RecordingOptions { units: names(&["N", "K", "s"]), ..none() }, true, "3 units for 2 channels"),
        (RecordingOptions { names: names(&["a", "a"]), ..none() }, true, "two channels are called \"a\""),
        (RecordingOptions { units: names(&["N", "stone"]), ..none() }, true, "not a known unit"),
        (RecordingOptions { rate_hz: Some(0.0), ..none() }, true, "the rate of frames"),
        (RecordingOptions { condition: split.clone(), ..none() }, false, "need times"),
    ] {
        let mut readings = without_units();
        readings.times.iter_mut().filter(|_| !has_times).for_each(|time| *time = f64::NAN);
        let found = Recording::open(&map, ReadingsReader::memory(readings).unwrap(), &options).err().unwrap();
        assert!(found.to_string().contains(expected), "{found}");
    }
    let given = RecordingOptions { units: names(&["N", "K"]), ..none() };
    let mut recording =
        Recording::open(&map, ReadingsReader::memory(without_units()).unwrap(), &given).unwrap();
    assert_eq!((recording.channel(Some("b")).unwrap(), recording.channels()[1].unit.as_str()), (1, "K"));
    assert!(matches!(recording.channel(Some("heat")), Err(SignalError::NoChannel { .. })));
    assert!(recording.follow_contacts(&recording.tracker_options(2)).is_err());
    recording.carry(Carried::Edges, None);
    assert_eq!(recording.level_channels()[2].name, "b.gradient.u");
    let short = Readings { values: vec![0.0], ..readings() };
    assert!(matches!(ReadingsReader::memory(short).map_err(Error::from), Err(Error::Io(_))));
    // Readings without times get them from the rate.
    let mut readings = readings();
    readings.times.fill(f64::NAN);
    let options = RecordingOptions { rate_hz: Some(50.0), condition: split, ..none() };
    let mut recording = Recording::open(&map, ReadingsReader::memory(readings).unwrap(), &options).unwrap();
    recording.next_step().unwrap();
    assert_eq!(recording.next_step().unwrap().unwrap().frame.time, 0.02);
}

/// A recording of two episodes is what each of them is by itself, one after the other, whatever stage has a memory; blocks
/// may divide episodes anywhere. Blocks of another recording are refused.
#[test]
fn the_border_of_an_episode_resets_everything() {
    let map = palm();
    let whole = readings();
    let block = |episode: u64, readings: Readings| Ok(Block { episode, readings, statements: Vec::new() });
    let blocks =
        || [block(3, part(0..4)), block(3, part(4..18)), block(5, part(18..21)), block(5, part(21..30))];
    for zero in [Zero::Taken, Zero::First(6), Zero::Follow] {
        let condition = ConditionOptions { zero, split_hz: Some(3.0), ..ConditionOptions::default() };
        let options = RecordingOptions { condition, fill: Fill::Neighbours, ..RecordingOptions::default() };
        // Episode, time, values and contacts of each frame, and the gaps, remarks and contacts of each episode.
        let passed = |reader: ReadingsReader| {
            let mut recording = Recording::open(&map, reader, &options).unwrap();
            let tracking = recording.tracker_options(1);
            recording.summarise(&tracking).unwrap();
            let mut frames = Vec::new();
            while let Some(step) = recording.next_step().unwrap() {
                // Without its number, which differs, and with what is missing as text.
                frames.push((step.episode, format!("{:?} {:?}", step.frame, step.contacts)));
            }
            let sums: Vec<_> = recording.summaries().iter().map(|(_, sums)| format!("{sums:?}")).collect();
            (frames, sums, recording.report().condition)
        };
        let both = passed(ReadingsReader::blocks("two".as_ref(), &[18, 12], blocks().into_iter()).unwrap());
        let [first, second] = [(3, 0..18), (5, 18..30)].map(|(episode, frames)| {
            let alone = [block(episode, part(frames))].into_iter();
            passed(ReadingsReader::blocks("one".as_ref(), &[], alone).unwrap())
        });
        assert_eq!(both.0, [first.0, second.0].concat(), "{zero:?}");
        assert_eq!(both.1, [first.1, second.1].concat(), "{zero:?}");
        assert_eq!(both.2.backwards, 0, "times that begin again in another episode do not go back");
    }
    let other = Readings {
        channels: whole.channels[..1].to_vec(),
        values: whole.values[..169].to_vec(),
        times: vec![0.0],
        ..part(0..0)
    };
    for wrong in
        [block(5, other), block(2, part(4..8)), block(3, Readings { values: vec![0.0; 5], ..part(4..5) })]
    {
        let blocks = [block(3, part(0..4)), wrong].into_iter();
        let mut reader = ReadingsReader::blocks("two".as_ref(), &[], blocks).unwrap();
        let (mut values, mut time) = (Vec::new(), 0.0);
        (0..4).for_each(|_| assert!(reader.read(&mut values, &mut time).unwrap()));
        assert!(matches!(reader.read(&mut values, &mut time), Err(IoError::Invalid { .. })));
    }
    assert!(ReadingsReader::blocks("none".as_ref(), &[], std::iter::empty()).is_err());
}

/// What is asked of some frames is not asked of episodes without any: they have no sums and no threshold of their own. A zero is
/// the mean of frames of one episode. Loadings need times.
#[test]
fn episodes_without_frames_have_no_sums() {
    let map = palm();
    let opened = |parts: &[std::ops::Range<usize>], frames: FrameRange, zero: Zero| {
        let block = |(episode, frames): (usize, &std::ops::Range<usize>)| {
            Ok(Block { episode: episode as u64, readings: part(frames.clone()), statements: Vec::new() })
        };
        let lengths: Vec<u64> = parts.iter().map(|frames| frames.len() as u64).collect();
        let blocks: Vec<_> = parts.iter().enumerate().map(block).collect();
        let reader = ReadingsReader::blocks("some".as_ref(), &lengths, blocks.into_iter()).unwrap();
        let condition = ConditionOptions { zero, ..ConditionOptions::default() };
        let options = RecordingOptions { condition, frames, ..RecordingOptions::default() };
        let mut recording = Recording::open(&map, reader, &options).unwrap();
        let tracking = recording.tracker_options(1);
        recording.summarise(&tracking).unwrap();
        while recording.next_step().unwrap().is_some() {}
        recording
    };
    let episodes = |recording: &Recording| {
        recording.summaries().iter().map(|(episode, _)| episode.unwrap()).collect::<Vec<_>>()
    };
    let until = |from: usize, to: Option<usize>| FrameRange { from, to, ..FrameRange::default() };
    let parts = [0..10, 10..20, 20..21];
    assert_eq!(episodes(&opened(&parts, until(0, None), Zero::Taken)), [0, 1, 2]);
    assert_eq!(episodes(&opened(&parts, until(0, Some(9)), Zero::First(12))), [0]);
    assert_eq!(episodes(&opened(&parts, until(10, Some(15)), Zero::Taken)), [1]);
    let all = opened(&parts, until(0, None), Zero::First(3));
    assert!(all.threshold().is_some(), "of the second episode, since the last has one frame");
    assert_eq!(all.report().zero_of, Some(1));
    let remarks = all.report().remarks(Zero::First(3));
    assert!(
        remarks.iter().any(|remark| remark.contains("the mean of 1 frames, there are no 3")),
        "{remarks:?}"
    );
    let without = Readings { times: vec![f64::NAN; 30], ..readings() };
    let reader = ReadingsReader::memory(without).unwrap();
    let mut recording = Recording::open(&map, reader, &RecordingOptions::default()).unwrap();
    let tracking = recording.tracker_options(1);
    assert_eq!(recording.summarise_steps(&tracking).unwrap_err(), SignalError::NoTimes);
}

/// Forces and steps of pressure are of one clock: recordings whose times begin again are refused.
#[test]
fn forces_and_steps_are_of_one_clock() {
    let map = palm();
    let relative = Response { scale: Some(Scale::Relative), ..Response::default() };
    let forces: Vec<[f64; 2]> = (0..30).map(|k| [0.05 * f64::from(k), 5.0]).collect();
    let refused = |reference: Reference<'_>, recordings: usize, readings: &dyn Fn() -> ReadingsReader| {
        let open = |_, _: Option<&Response>| {
            Ok::<_, Error>(Recording::open(&map, readings(), &RecordingOptions::default())?)
        };
        respond(&map, reference, recordings, open, |_| {}, Run::default())
            .map(|_| ())
            .unwrap_err()
            .to_string()
    };
    let whole = || ReadingsReader::memory(readings()).unwrap();
    let two = || {
        let block = |episode| Ok(Block { episode, readings: readings(), statements: Vec::new() });
        ReadingsReader::blocks("two".as_ref(), &[30, 30], [block(0), block(1)].into_iter()).unwrap()
    };
    let timeless = || ReadingsReader::memory(Readings { times: vec![f64::NAN; 30], ..readings() }).unwrap();
    let force = Reference::Force(&forces, &relative);
    assert!(refused(force, 1, &two).contains("times go back"));
    assert!(refused(force, 2, &whole).contains("times go back"));
    assert!(refused(force, 1, &timeless).contains("need times"));
    assert!(!refused(force, 1, &whole).contains("times go back"));
    let steps = Reference::Pressure(&[[0.0, 20_000.0], [0.5, 40_000.0]]);
    assert!(refused(steps, 1, &two).contains("one recording of one episode; 2 are given"));
}
