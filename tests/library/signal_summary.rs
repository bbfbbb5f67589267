//! Sums of a trial: what they are on a sheet whose loads are known, and on the samples of vendors.

use std::path::Path;
use std::sync::Arc;

use dermatome::id::VertexId;
use dermatome::io::{
    Layout, ReadOptions, Readings, ReadingsReader, SummaryCell, read_draft, read_draft_of_stream,
    summary_rows, summary_step_rows, write_summary,
};
use dermatome::map::SkinMap;
use dermatome::mesh::shapes;
use dermatome::recording::{Recording, RecordingOptions};
use dermatome::signal::{Channel, Group, Totals, TrackerOptions};
use dermatome::skin::{AssembleOptions, PatchId, assemble};

use crate::common;

const AREA: f64 = 0.004 * 0.004;

/// A sheet of 9 x 7 taxels of one area; taxels 30 and up are the region `upper`.
fn sheet() -> SkinMap {
    let mut map = SkinMap::flat(shapes::lattice(9, 7, 0.004), 1e-3);
    let id = PatchId::new(0);
    let patch = &mut map.patches[id];
    patch.taxels.areas.iter_mut().for_each(|area| *area = AREA);
    for level in patch.levels.iter_mut() {
        level.level.areas = patch.taxels.areas.clone();
    }
    let taxels: Vec<_> = patch.taxels.ids.ids().skip(30).map(|v| (id, v)).collect();
    map.set_regions(taxels, "upper").unwrap();
    map
}

/// A recording of frames in which some taxels have a pressure in Pa, all others 0.
fn recording(map: &Arc<SkinMap>, frames: &[(f64, &[(usize, f64)])], threshold: f64) -> Recording {
    let mut recording = recording_of(map, frames, threshold, false);
    while recording.next_step().unwrap().is_some() {}
    recording
}

/// The same, not read yet, with steps or without.
fn recording_of(
    map: &Arc<SkinMap>,
    frames: &[(f64, &[(usize, f64)])],
    threshold: f64,
    has_steps: bool,
) -> Recording {
    let width = map.patches[PatchId::new(0)].taxels.ids.len();
    let mut values = vec![0.0; width * frames.len()];
    for (row, (_, pressed)) in values.chunks_mut(width).zip(frames) {
        pressed.iter().for_each(|&(taxel, value)| row[taxel] = value);
    }
    let times = frames.iter().map(|frame| frame.0).collect();
    let channels = vec![Channel::new("pressure", "Pa").unwrap()];
    let readings = Readings { channels, width, times, values, ..Readings::default() };
    let readings = ReadingsReader::memory(readings).unwrap();
    let mut recording = Recording::open(map, readings, &RecordingOptions::default()).unwrap();
    let options = TrackerOptions { threshold: Some(threshold), least: 1, ..TrackerOptions::default() };
    match has_steps {
        true => recording.summarise_steps(&options).unwrap(),
        false => recording.summarise(&options).unwrap(),
    }
    recording
}

fn totals(recording: &Recording, wanted: Group) -> Totals {
    let summary = recording.summary().unwrap();
    summary.totals().find(|(group, _)| *group == wanted).unwrap().1.clone()
}

fn assert_near(found: Option<f64>, wanted: f64, what: &str) {
    assert!(
        found.is_some_and(|x| (x - wanted).abs() <= 1e-12 * wanted.abs().max(1e-9)),
        "{what}: {found:?}, not {wanted}"
    );
}

/// A press that grows, moves by a taxel and ends: every sum by hand.
#[test]
fn sums_of_a_press_are_those_by_hand() {
    let map = Arc::new(sheet());
    let frames: [(f64, &[(usize, f64)]); 5] = [
        (0.0, &[]),
        (0.1, &[(31, 1000.0)]),
        (0.2, &[(31, 3000.0), (32, 1000.0)]),
        (0.3, &[(32, 4000.0)]),
        (0.4, &[]),
    ];
    let recording = recording(&map, &frames, 500.0);
    for group in [
        Group::Whole,
        Group::Region(0.into()),
        Group::Patch(PatchId::new(0)),
        Group::Link(0.into()),
        Group::Contact(0),
    ] {
        let found = totals(&recording, group);
        assert_near(found.peak, 4000.0, "peak");
        assert_near(found.peak_time, 0.3, "time of the peak");
        assert_eq!(found.peak_taxel, Some((PatchId::new(0), VertexId::new(32))));
        assert_near(found.force_peak, 4000.0 * AREA, "force");
        assert_near(found.force_peak_time, 0.2, "the first of equal forces");
        assert_near(found.force_mean(), 3000.0 * AREA, "mean force of three frames");
        assert_near(found.mean(), (1000.0 + 2000.0 + 4000.0) / 3.0, "mean");
        assert_near(Some(found.contact_area_peak), 2.0 * AREA, "area");
        assert_near(found.contact_area_mean(), 4.0 / 3.0 * AREA, "mean area");
        assert_near(found.first_contact, 0.1, "first contact");
        assert_near(found.last_contact, 0.3, "last contact");
        // The centre moves by a quarter of 4 mm, then by the rest.
        assert_near(found.path, 0.004, "path");
        assert_near(found.speed_mean(), 0.02, "speed");
        assert_near(found.speed_peak, 0.03, "largest speed");
        assert_near(found.impulse, 900.0 * AREA, "impulse");
        assert_near(found.pressure_time_integral, 800.0, "pressure-time integral");
        assert_near(found.contact_time, 0.3, "contact time");
    }
    let of_region = totals(&recording, Group::Region(0.into()));
    assert_eq!((of_region.taxels, of_region.frames, of_region.loaded_frames), (33, 5, 3));
    assert_eq!(recording.summary().unwrap().gaps(), 0);
}

/// Nothing is added up over a gap, nor where the clock jumps back.
#[test]
fn gaps_and_clocks_that_jump_back_add_nothing() {
    let map = Arc::new(sheet());
    let press: &[(usize, f64)] = &[(31, 1000.0)];
    let times = [0.0, 0.1, 0.2, 0.3, 9.0, 9.1, 5.0, 5.1];
    let recording = recording(&map, &times.map(|time| (time, press)), 500.0);
    let found = totals(&recording, Group::Whole);
    assert_eq!(recording.summary().unwrap().gaps(), 2);
    assert!((found.contact_time.unwrap() - 0.5).abs() < 1e-9, "{:?}", found.contact_time);
    assert!((found.impulse.unwrap() - 0.5 * 1000.0 * AREA).abs() < 1e-12);
}

/// Each loading is a row, but for what the recording has only a part of, and for a touch of a few taxels; a moment without load ends
/// none. Integrals reach into the frames before and after.
#[test]
fn each_loading_is_a_step() {
    let map = Arc::new(sheet());
    let (none, weak, low, high): (&[_], &[_], &[_], &[_]) =
        (&[], &[(31, 600.0)], &[(31, 20_000.0)], &[(31, 20_000.0), (2, 10_000.0)]);
    let loads = [
        high, none, none, none, low, high, high, none, low, low, none, none, none, weak, none, none, none,
        high, none, none, none, high,
    ];
    let frames: Vec<_> = (0..).map(|k| 0.1 * f64::from(k)).zip(loads).collect();
    let mut recording = recording_of(&map, &frames, 500.0, true);
    while recording.next_step().unwrap().is_some() {}
    let (steps, cut_off) = recording.summary().unwrap().steps().unwrap();
    let found: Vec<_> = steps.iter().map(|step| (step.group, step.number)).collect();
    let [patch, region] = [Group::Patch(PatchId::new(0)), Group::Region(0.into())];
    assert_eq!(found, [(patch, 0), (region, 0), (patch, 1), (region, 1)]);
    assert_eq!(cut_off, 4);
    for (step, [force, time]) in steps.iter().zip([[120.0, 0.5], [100.0, 0.5], [30.0, 0.1], [20.0, 0.1]]) {
        assert_near(step.totals.first_contact, if step.number == 0 { 0.4 } else { 1.7 }, "begin");
        assert_near(step.totals.impulse, 0.1 * 1000.0 * force * AREA, "impulse");
        assert!((step.totals.contact_time.unwrap() - time).abs() < 1e-9, "{:?}", step.totals);
    }
    // With what is outside of steps, the sums are those of the whole.
    let summary = recording.summary().unwrap();
    let outside = summary.outside_steps();
    assert_eq!(
        outside.iter().map(|of| (of.group, of.cut_off, of.weak)).collect::<Vec<_>>(),
        [(patch, 2, 1), (region, 2, 1)]
    );
    for of in outside {
        let (_, whole) = summary.totals().find(|(group, _)| *group == of.group).unwrap();
        let of_steps = |value: fn(&Totals) -> Option<f64>| -> f64 {
            steps.iter().filter(|step| step.group == of.group).map(|step| value(&step.totals).unwrap()).sum()
        };
        assert_near(whole.impulse, of_steps(|totals| totals.impulse) + of.impulse.unwrap(), "impulse");
        let time = of_steps(|totals| totals.contact_time) + of.contact_time.unwrap();
        assert_near(whole.contact_time, time, "contact time");
    }
    let rows = summary_step_rows(&map, recording.summary().unwrap(), "the left sole");
    assert_eq!((rows.len(), &rows[0][0]), (4, &("step", SummaryCell::Count(0))));
    assert_eq!(rows[0][1], ("side", SummaryCell::Text("left".into())));
}

/// Nobody knows whether a load went on where there are no readings: what is before and after them is no whole step.
#[test]
fn a_loading_without_readings_within_is_cut_off() {
    let map = Arc::new(sheet());
    let taxels = map.patches[PatchId::new(0)].taxels.ids.len();
    let nothing: Vec<(usize, f64)> = (0..taxels).map(|taxel| (taxel, f64::NAN)).collect();
    for (silent, whole) in [(0, 1), (2, 1), (10, 0)] {
        let row = |k: usize| match k {
            30.. if k < 30 + silent => &nothing[..],
            10..60 => &[(20, 1000.0), (21, 1000.0)],
            _ => &[],
        };
        let frames: Vec<(f64, &[(usize, f64)])> = (0..80).map(|k| (0.05 * k as f64, row(k))).collect();
        let mut recording = recording_of(&map, &frames, 100.0, true);
        while recording.next_step().unwrap().is_some() {}
        let (steps, cut_off) = recording.summary().unwrap().steps().unwrap();
        let first = steps.first().map(|step| step.group);
        let of_all = steps.iter().filter(|step| Some(step.group) == first).count();
        assert_eq!((of_all, cut_off > 0), (whole, whole == 0), "{silent} frames without readings");
    }
}

/// Without times, a unit or a reading there are no numbers that need them; a table has empty cells.
#[test]
fn what_is_not_known_is_empty() {
    let map = Arc::new(sheet());
    let width = 63;
    let mut values = vec![f64::NAN; 2 * width];
    values[10] = 5.0;
    let readings = Readings {
        ids: None,
        channels: vec![Channel::default()],
        width,
        times: vec![f64::NAN; 2],
        values,
        ..Readings::default()
    };
    let mut recording =
        Recording::open(&map, ReadingsReader::memory(readings).unwrap(), &RecordingOptions::default())
            .unwrap();
    let options = TrackerOptions { threshold: Some(1.0), least: 1, ..TrackerOptions::default() };
    recording.summarise(&options).unwrap();
    while recording.next_step().unwrap().is_some() {}
    let whole = totals(&recording, Group::Whole);
    assert_eq!((whole.frames, whole.peak, whole.force_peak, whole.impulse), (1, Some(5.0), None, None));
    assert_eq!((whole.contact_time, whole.first_contact, whole.path), (None, None, None));
    assert_eq!(totals(&recording, Group::Region(0.into())).peak, None);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sums.csv");
    write_summary(&path, &map, &recording.summaries()).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 6, "names, whole, link, patch, region and contact");
    let column = |name: &str| rows[0].iter().position(|found| *found == name).unwrap();
    assert_eq!(rows[1][column("peak")], "5.0");
    assert_eq!((rows[1][column("impulse")], rows[4][column("peak")]), ("", ""));
    assert_eq!(rows[0].len(), summary_rows(&map, recording.summary().unwrap())[0].len());
}

/// The force of every frame of a vendor's file, summed on the map of its skin.
fn forces(path: &Path, layout: Option<&str>, stream: Option<&str>) -> (Vec<f64>, Vec<f64>) {
    let draft = stream.map_or_else(|| read_draft(path), |stream| read_draft_of_stream(path, stream)).unwrap();
    let skin = assemble(&draft, &AssembleOptions::default()).unwrap().skin;
    let map = Arc::new(dermatome::build(&skin, &dermatome::BuildOptions::default()).unwrap());
    let layout = layout.map(|text| Layout::parse("layout.json".as_ref(), text).unwrap());
    let read = ReadOptions { layout, stream: stream.map(str::to_owned), ..ReadOptions::default() };
    let readings = ReadingsReader::open(path, read).unwrap();
    let mut recording = Recording::open(&map, readings, &RecordingOptions::default()).unwrap();
    let options = TrackerOptions { threshold: Some(f64::MIN_POSITIVE), ..TrackerOptions::default() };
    recording.summarise(&options).unwrap();
    let (mut forces, mut sums) = (Vec::new(), Vec::new());
    while recording.next_step().unwrap().is_some() {
        let (_, whole) = recording.summary().unwrap().loads()[0];
        forces.push(whole.force);
        sums.push(whole.sum);
    }
    (forces, sums)
}

/// Forces, loads and raw sums that the vendors' programs wrote are those of the summary.
#[test]
fn sums_are_those_of_the_vendors() {
    let Some(data) = common::data("recordings") else { return };
    let truth: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(data.join("truth.json")).unwrap()).unwrap();
    for (file, key, error) in [
        ("vendor/emed_test.lst", "force_N", 0.006),
        ("vendor/fscan_testL.asf", "force_N", 0.06),
        ("vendor/pliance_test.asc", "force_N", 0.01),
    ] {
        let (forces, _) = forces(&data.join(file), None, None);
        let wanted = truth[file][key].as_array().unwrap();
        for (frame, wanted) in wanted.iter().enumerate() {
            let wanted = wanted.as_f64().unwrap();
            assert!(
                (forces[frame] - wanted).abs() <= error,
                "{file}, frame {frame}: {} N, not {wanted}",
                forces[frame]
            );
        }
    }
    let (_, sums) = forces(&data.join("vendor/iscan_test.csv"), None, None);
    let wanted: Vec<f64> = truth["vendor/iscan_test.csv"]["raw_sum"]
        .as_array()
        .unwrap()
        .iter()
        .map(|x| x.as_f64().unwrap())
        .collect();
    assert_eq!(sums[..wanted.len()], wanted);
    for (sensor, loads) in truth["vendor/xsensor_data.csv"]["load_N"].as_object().unwrap() {
        let (forces, _) = forces(&data.join("vendor/xsensor_data.csv"), None, Some(sensor));
        for (frame, wanted) in loads.as_array().unwrap().iter().enumerate() {
            let wanted = wanted.as_f64().unwrap();
            assert!(
                (forces[frame] / wanted - 1.0).abs() <= 0.004,
                "{sensor}, frame {frame}: {}, not {wanted}",
                forces[frame]
            );
        }
    }
}
