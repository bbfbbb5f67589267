//! Layouts: which are refused and why, which cell becomes which taxel, and what the numbers of a file become.

use std::path::Path;

use dermatome::io::{Decoder, IoError, Layout, StatementSource, StreamFacts, TimeUnit, Times};
use dermatome::skin::TaxelId;
use serde_json::{Value, json};

/// A layout of a grid of 2 x 3 counts.
fn grid() -> Value {
    json!({"dermatome_layout": 1, "axes": ["frame", "row", "col"], "time": {"rate": 10},
        "channels": [{"name": "pressure", "unit": "count"}], "press": "raises", "zero": 0,
        "taxels": {"shape": [2, 3], "first_id": 1}})
}

/// The grid with other values at some paths; null takes a key away.
fn with(changes: &[(&str, Value)]) -> Value {
    let mut json = grid();
    for (path, value) in changes {
        let (parent, key) = path.rsplit_once('/').unwrap_or(("", path));
        let parent = json.pointer_mut(parent).unwrap().as_object_mut().unwrap();
        match value {
            Value::Null => drop(parent.remove(key)),
            value => drop(parent.insert(key.into(), value.clone())),
        }
    }
    json
}

fn parse(json: &Value) -> Result<Layout, IoError> {
    Layout::parse(Path::new("l.json"), &json.to_string())
}

fn facts(cells: &[usize]) -> StreamFacts {
    StreamFacts { cells: cells.to_vec(), ..StreamFacts::default() }
}

fn decoder(json: &Value, facts: &StreamFacts) -> Result<Decoder, IoError> {
    Decoder::new(&parse(json)?, Path::new("file"), facts)
}

fn decode(decoder: &mut Decoder, raw: &[f64], times: Times<'_>) -> Result<(Vec<f64>, Vec<f64>), IoError> {
    let (mut values, mut seconds) = (Vec::new(), Vec::new());
    decoder.decode(raw, times, 0, &mut values, &mut seconds)?;
    Ok((values, seconds))
}

#[test]
fn layouts_with_wrong_keys_are_refused() {
    let one = |component| json!({"name": "a", "unit": "N", "component": component});
    for (changes, expected) in [
        (vec![("dermatome_layout", json!(2))], "dermatome_layout: found \"2\""),
        (vec![("presses", json!("raises"))], "keys: found \"presses\""),
        (vec![("press", Value::Null)], "press: found none; needed: the key \"press\""),
        (vec![("zero", Value::Null)], "zero: found none"),
        (vec![("time", json!({"rate": null}))], "time, rate: found null; needed: a value"),
        (vec![("press", json!("up"))], "press: found"),
        (vec![("zero", json!({"first": 0}))], "zero: found first 0"),
        (vec![("zero", json!("none"))], "zero: found"),
        (vec![("zero", json!({"first": 2, "last": 3}))], "zero: found"),
        (vec![("time", json!({"rate": 0}))], "time: found"),
        (vec![("time", json!({"rate": 10, "unit": "s"}))], "time: found"),
        (vec![("time", json!({"stream": "t"}))], "time: found"),
        (vec![("time", json!({"unit": "min"}))], "time: found"),
        (vec![("time", json!({"unit": "s", "between": [5, 1]}))], "time, between: found"),
        (vec![("axes", json!(["row", "col"]))], "axes: found"),
        (vec![("axes", json!(["frame", "row", "row"]))], "axes: found \"row\" again"),
        (vec![("channels", json!([]))], "channels: found 0 channels"),
        (vec![("channels", json!([{"name": "a"}]))], "missing field `unit`"),
        (vec![("channels", json!([{"name": "a", "unit": "stone"}]))], "channels, 0: found stone"),
        (vec![("channels", json!([{"name": "a", "unit": "N", "scale": 0}]))], "scale 0"),
        (vec![("channels", json!([{"name": "a", "unit": "N", "sign": 1}]))], "unknown field `sign`"),
        (vec![("channels", json!([one(0)]))], "needed: `component` in each channel if"),
        (
            vec![("channels", json!([one(0), one(1)])), ("axes", json!(["frame", "component", "col"]))],
            "again",
        ),
        (vec![("missing", json!("none"))], "missing: found"),
        (vec![("taxels", json!({"ids": "all"}))], "taxels: found"),
        (vec![("taxels", json!({"ids": [1, -1]}))], "taxels, ids: found"),
        (vec![("taxels", json!({"shape": [2, 3], "rotate": 45}))], "taxels, rotate: found 45"),
        (vec![("taxels", json!({"shape": [2, 3], "mirror": true}))], "unknown field `mirror`"),
        (
            vec![("taxels", json!({"shape": [2, 3], "flip": ["row", "row"]}))],
            "taxels, flip: found \"row\" again",
        ),
        (vec![("taxels", json!({"columns": ""}))], "taxels, columns: found"),
        (vec![("taxels", json!({"columns": []}))], "needed: the name of a column with {id}"),
        (vec![("taxels", json!({"columns": ["a{id}", "b"]}))], "taxels, columns: found"),
        (vec![("taxels", json!({"columns": "{id}", "shape": [6]}))], "taxels, columns: found"),
        (vec![("episode", json!(-1))], "episode: found"),
    ] {
        let error = parse(&with(&changes)).unwrap_err().to_string();
        assert!(error.starts_with("l.json: ") && error.contains(expected), "{changes:?}: {error}");
    }
    let broken = Layout::parse(Path::new("l.json"), &"[".repeat(100_000)).unwrap_err().to_string();
    assert!(broken.contains("file: found recursion limit"), "{broken}");
}

#[test]
fn files_that_state_something_else_are_refused() {
    let of = |change: fn(&mut StreamFacts)| {
        let mut facts = facts(&[2, 3]);
        change(&mut facts);
        facts
    };
    let times = ("time", json!({"stream": "stamp", "unit": "ms"}));
    for (changes, facts, expected) in [
        (
            vec![],
            of(|f| f.cells = vec![3, 2]),
            "cells of a frame: found [3, 2]; needed: [2, 3], as l.json states",
        ),
        (vec![], of(|f| f.cells = vec![6]), "axes: found frames of the shape [6]; needed: 3 axes"),
        (vec![], of(|f| f.axes = vec!["col".into(), "row".into()]), "axes: found [\"col\", \"row\"]"),
        (
            vec![],
            of(|f| f.units = vec!["kPa".into()]),
            "unit: found the unit kPa of pressure; needed: count, as",
        ),
        (vec![], of(|f| f.rate_hz = Some(60.0)), "rate: found 60 frames a second; needed: 10"),
        (vec![], of(|f| f.may_be_mirrored = true), "needed: `flip` in `taxels`"),
        (vec![times.clone()], of(|f| f.time_unit = Some(TimeUnit::Seconds)), "found times in s; needed: ms"),
        (vec![times], of(|f| f.time_names = vec!["time".into()]), "found times called time; needed: stamp"),
        (vec![("zero", json!({"stream": "rest"}))], of(|_| ()), "zero: found no stream rest"),
        (vec![("taxels", json!({"ids": "file"}))], of(|_| ()), "taxels: found no ids of taxels"),
        (vec![("taxels", json!({"ids": [1, 2, 3]}))], of(|_| ()), "taxels, ids: found 3 ids; needed: 6"),
        (vec![("taxels", json!({"ids": [1, 2, 3, 4, 5, 5]}))], of(|_| ()), "taxel 5 in two cells"),
        (vec![("taxels", json!({"shape": [2, 3], "flip": ["pad"]}))], of(|_| ()), "flip \"pad\""),
        (vec![("taxels", json!({"shape": [2, 3], "first_id": 4_294_967_295_u32}))], of(|_| ()), "ids below"),
        (
            vec![
                ("channels", json!([{"name": "a", "unit": "count", "component": 3}])),
                ("axes", json!(["frame", "taxel", "component"])),
                ("taxels", json!({"shape": [2]})),
            ],
            of(|_| ()),
            "3 components; needed: component 3",
        ),
        (vec![], of(|f| f.sensors = vec![false; 6]), "taxels: found none"),
        (
            vec![],
            of(|f| f.ids = Some([1, 2, 4, 3, 5, 6].map(TaxelId).to_vec())),
            "ids, column 3: found taxel 4; needed: taxel 3, as l.json states",
        ),
        (
            vec![("taxels", json!({"ids": [1, 2, 3, 4, 5, 7]}))],
            of(|f| f.ids = Some([1, 2, 3, 4, 5, 6].map(TaxelId).to_vec())),
            "ids, column 6: found taxel 6; needed: taxel 7",
        ),
        (
            vec![("taxels", json!({"columns": "a{id}"}))],
            of(|_| ()),
            "needed: a table with columns called a{id}",
        ),
        (vec![], of(|f| f.cells = vec![5, 2, 3]), "an axis of trials is called \"episode\""),
    ] {
        let error = decoder(&with(&changes), &facts).unwrap_err().to_string();
        assert!(error.contains(expected), "{changes:?}: {error}");
    }
    // Another name of the unit is the same unit; a scale converts one.
    for (stated, unit, scale, fits) in [
        ("KPa", "kPa", json!(1), true),
        ("raw", "count", json!(1), true),
        ("PSI", "kPa", json!(6.894_757_293_168_361), true),
        ("PSI", "kPa", json!(7), false),
        ("count", "kPa", json!(0.5), true),
        ("N", "kPa", json!(1), true),
        ("odd", "kPa", Value::Null, false),
    ] {
        let mut channel = json!({"name": "a", "unit": unit});
        if !scale.is_null() {
            channel["scale"] = scale;
        }
        let found = decoder(&with(&[("channels", json!([channel]))]), &{
            let mut facts = facts(&[2, 3]);
            facts.units = vec![stated.into()];
            facts
        });
        assert_eq!(found.is_ok(), fits, "{stated} as {unit}: {:?}", found.err().map(|e| e.to_string()));
    }
}

/// Ids of a grid that is transposed, turned and flipped, as numpy computes them.
#[test]
fn grids_are_transposed_then_turned_then_flipped() {
    for (keys, expected) in [
        (json!({}), [1, 2, 3, 4, 5, 6]),
        (json!({"flip": ["row"]}), [4, 5, 6, 1, 2, 3]),
        (json!({"flip": ["row", "col"]}), [6, 5, 4, 3, 2, 1]),
        (json!({"transpose": true}), [1, 3, 5, 2, 4, 6]),
        (json!({"rotate": 90}), [2, 4, 6, 1, 3, 5]),
        (json!({"rotate": 180}), [6, 5, 4, 3, 2, 1]),
        (json!({"rotate": 270}), [5, 3, 1, 6, 4, 2]),
        (json!({"transpose": true, "rotate": 90}), [4, 5, 6, 1, 2, 3]),
        (json!({"transpose": true, "rotate": 180, "flip": ["col"]}), [2, 4, 6, 1, 3, 5]),
    ] {
        let mut taxels = json!({"shape": [2, 3]});
        taxels.as_object_mut().unwrap().extend(keys.as_object().unwrap().clone());
        let mut decoder = decoder(&with(&[("taxels", taxels)]), &facts(&[2, 3])).unwrap();
        assert_eq!(decoder.ids(), [1, 2, 3, 4, 5, 6].map(TaxelId));
        let raw = [10.0, 20.0, 30.0, 40.0, 50.0, 60.0];
        let (values, _) = decode(&mut decoder, &raw, Times::None).unwrap();
        let of_cells: Vec<f64> = expected.iter().map(|&id: &usize| values[id - 1]).collect();
        assert_eq!(of_cells, raw, "{keys}");
    }
}

#[test]
fn tables_join_cells_with_weights_and_gains() {
    let folder = tempfile::tempdir().unwrap();
    let read = |rows: &str, unit: &str, raw: &[f64]| {
        std::fs::write(folder.path().join("cells.csv"), rows).unwrap();
        let json =
            with(&[("taxels", json!("cells.csv")), ("channels", json!([{"name": "a", "unit": unit}]))]);
        let layout = Layout::parse(&folder.path().join("l.json"), &json.to_string())?;
        let mut decoder = Decoder::new(&layout, Path::new("file"), &facts(&[2, 3]))?;
        let (values, _) = decode(&mut decoder, raw, Times::None)?;
        Ok::<_, IoError>((decoder.ids().iter().map(|id| id.0).collect::<Vec<_>>(), values))
    };
    let raw = [1.0, 2.0, 4.0, 8.0, f64::NAN, 32.0];
    let rows = "row,col,taxel_id,weight,gain\n0,1,7,,\n0,0,3,3,\n0,2,3,1,10\n1,0,9,1,\n1,0,8,3,\n1,1,9,1,\n";
    // An average of what is there; amounts of a cell are shared by its taxels.
    let (ids, values) = read(rows, "count", &raw).unwrap();
    assert_eq!((ids, values), (vec![3, 7, 8, 9], vec![(3.0 + 40.0) / 4.0, 2.0, 8.0, 8.0]));
    let (_, values) = read(rows, "N", &raw).unwrap();
    assert_eq!(values, [1.0 + 40.0, 2.0, 6.0, 2.0]);
    for (rows, expected) in [
        ("row,taxel_id\n0,1\n", "a column `col`"),
        ("row,col,taxel_id,wieght\n0,0,1,1\n", "column 4: found wieght"),
        ("row,col,taxel_id\n0,3,1\n", "needed: 0 to 2, as the file has"),
        ("row,col,taxel_id\n0,-1,1\n", "needed: 0 to 2, as the file has"),
        ("row,col,taxel_id,gain\n0,0,1,0\n", "needed: a number above 0"),
        ("row,col,taxel_id\n0,0,1\n0,0,1\n", "cell 0 of taxel 1 again"),
        ("row,col,taxel_id\n", "taxels: found none"),
    ] {
        let error = read(rows, "N", &raw).unwrap_err().to_string();
        assert!(error.contains(expected), "{rows}: {error}");
    }
}

#[test]
fn sign_zero_scale_and_missing_apply_to_each_channel() {
    let json = with(&[
        ("axes", json!(["frame", "component", "taxel"])),
        (
            "channels",
            json!([
                {"name": "shear", "unit": "N", "component": 1, "signed": true, "scale": 0.5},
                {"name": "normal", "unit": "N", "component": 0},
            ]),
        ),
        ("press", json!("lowers")),
        ("zero", json!({"first": 2})),
        ("missing", json!([-1])),
        ("taxels", json!({"shape": [2], "first_id": 0})),
    ]);
    let mut of_layout = decoder(&json, &facts(&[2, 2])).unwrap();
    assert!(of_layout.frames_to_learn() >= 2);
    let raw = [10.0, 20.0, 1.0, 2.0, 12.0, 20.0, 1.0, -1.0, 5.0, -1.0, 3.0, f64::INFINITY];
    let (values, seconds) = decode(&mut of_layout, &raw, Times::None).unwrap();
    assert!(values[9].is_nan() && values[11].is_nan(), "{values:?}");
    assert_eq!((values[8], values[10]), (1.0, 6.0), "half of the shear; a press lowers the normal number");
    assert_eq!(seconds, [0.0, 0.1, 0.2]);
    let stated = of_layout.statements();
    let missing = stated.iter().find(|s| s.source == StatementSource::Checked).unwrap();
    assert_eq!(
        (missing.what.as_str(), &missing.value[..34]),
        ("missing", "3 readings, the first in frame 1; ")
    );
    let error = decode(&mut decoder(&json, &facts(&[2, 2])).unwrap(), &raw[..4], Times::None).unwrap_err();
    assert!(error.to_string().contains("zero: found 1 frames; needed: the first 2"), "{error}");
    let error = decode(&mut decoder(&json, &facts(&[2, 2])).unwrap(), &raw[..5], Times::None).unwrap_err();
    assert!(error.to_string().contains("found 5 numbers; needed: 4 for each frame"), "{error}");
}

#[test]
fn times_become_seconds_or_are_refused() {
    let of_unit = |unit: &str| with(&[("time", json!({"stream": "t", "unit": unit}))]);
    let times = |unit: &str, times: Times<'_>| {
        let frames = match times {
            Times::Whole(t) => t.len(),
            Times::Real(t) => t.len(),
            Times::None => 1,
        };
        let mut decoder = decoder(&of_unit(unit), &facts(&[2, 3])).unwrap();
        decode(&mut decoder, &vec![0.0; 6 * frames], times).map(|found| (found.1, decoder.statements()))
    };
    let at = 1_700_000_000_000_000_001;
    let (seconds, _) = times("ns", Times::Whole(&[at, at + 10_000_000, at + 20_000_000])).unwrap();
    assert_eq!(seconds, [0.0, 0.01, 0.02], "the first is subtracted as an integer");
    assert_eq!(times("ms", Times::Real(&[5.0, 15.5])).unwrap().0, [0.005, 0.0155]);
    let (_, stated) = times("s", Times::Real(&[0.0, 0.1, 0.2, 2.9, 3.0])).unwrap();
    assert!(stated.iter().any(|s| s.what == "gap" && s.value.contains("before frame 3")), "{stated:?}");
    let nan = f64::NAN;
    for (unit, given, expected) in [
        ("s", Times::None, "times: found none"),
        ("s", Times::Whole(&[0, 1, 2]), "as frame numbers are"),
        ("s", Times::Real(&[1.75e12, 1.75e12 + 33.0]), "a time of 1.750000000033e12 s"),
        ("s", Times::Real(&[0.0, nan]), "a time of inf s"),
        ("ns", Times::Whole(&[0, 30_000, 60_000]), "33333.333333 frames a second"),
        ("ms", Times::Whole(&[0, 30, 30]), "frame 2: found 0.03 s after 0.03 s"),
        ("ms", Times::Whole(&[i64::MAX, i64::MIN]), "a time of"),
    ] {
        let error = times(unit, given).unwrap_err().to_string();
        assert!(error.starts_with("file: ") && error.contains(expected), "{unit}: {error}");
    }
    // A file that has times and a rate states one thing twice, and so do its times and the rate of a layout.
    let with_rate = |rate: f64, unit: Option<TimeUnit>, changes: &[(&str, Value)], given: &[f64]| {
        let facts = StreamFacts { rate_hz: Some(rate), time_unit: unit, ..facts(&[2, 3]) };
        let mut decoder = decoder(&with(changes), &facts).unwrap();
        let found = decode(&mut decoder, &vec![0.0; 6 * given.len()], Times::Real(given));
        found.map(|(_, seconds)| (seconds, decoder.statements())).map_err(|e| e.to_string())
    };
    let times = ("time", json!({"stream": "t", "unit": "s"}));
    let late = [0.0, 0.101, 0.202, 0.303];
    assert_eq!(with_rate(10.0, None, std::slice::from_ref(&times), &late).unwrap().0, late);
    let error = with_rate(20.0, None, &[times], &late).unwrap_err();
    assert!(error.contains("found frames 0.101000 s apart; needed: 0.050000 s, as the 20 frames"), "{error}");
    let seconds = Some(TimeUnit::Seconds);
    assert_eq!(with_rate(10.0, seconds, &[], &[5.0, 5.101, 5.202]).unwrap().0, [0.0, 0.1, 0.2]);
    let error = with_rate(10.0, seconds, &[], &[5.0, 5.02]).unwrap_err();
    assert!(
        error.contains("frame 1: found 0.020000 s after the first in the file; needed: 0.100000 s"),
        "{error}"
    );
    let (_, stated) = with_rate(10.0, None, &[], &[5.0, 5.02]).unwrap();
    assert!(
        stated.iter().any(|s| s.value.contains("in a unit that it does not state, are not read")),
        "{stated:?}"
    );
    let mut episodes = decoder(&of_unit("ms"), &facts(&[2, 3])).unwrap();
    let mut run = |times: &[i64], episode| {
        let (mut values, mut seconds) = (Vec::new(), Vec::new());
        let raw = vec![0.0; 6 * times.len()];
        episodes.decode(&raw, Times::Whole(times), episode, &mut values, &mut seconds).map(|()| seconds)
    };
    assert_eq!(run(&[10, 20], 0).unwrap(), [0.0, 0.01]);
    assert_eq!(run(&[5, 15], 1).unwrap(), [0.0, 0.01], "times begin again");
    assert!(run(&[30], 0).unwrap_err().to_string().contains("episode 0 after 1"));
    assert!(run(&[12], 1).unwrap_err().to_string().contains("frame 4: found"));
}

/// A cell that has no number while the zero is taken has none later, and it is stated why.
#[test]
fn a_cell_without_a_zero_is_stated() {
    let layout = with(&[("zero", json!({"first": 2}))]);
    let mut decoder = decoder(&layout, &facts(&[2, 3])).unwrap();
    let mut raw = vec![1.0; 6 * 4];
    (raw[0], raw[6]) = (f64::NAN, f64::NAN);
    let (values, _) = decode(&mut decoder, &raw, Times::None).unwrap();
    assert!(values[18].is_nan() && values[19] == 0.0, "{values:?}");
    let stated = decoder.statements();
    assert!(stated.iter().any(|s| s.what == "zero" && s.value.starts_with("1 cells without")), "{stated:?}");
}

/// A call of no frame or of one at a time changes nothing.
#[test]
fn times_are_the_same_in_calls_of_any_length() {
    let read = |unit: &str, calls: &[&[i64]]| {
        let layout = with(&[("time", json!({"stream": "t", "unit": unit}))]);
        let mut decoder = decoder(&layout, &facts(&[2, 3])).unwrap();
        let (mut values, mut seconds) = (Vec::new(), Vec::new());
        for &times in calls {
            decoder.decode(&vec![0.0; 6 * times.len()], Times::Whole(times), 0, &mut values, &mut seconds)?;
        }
        Ok::<_, IoError>(seconds)
    };
    let at = 1_700_000_000_000_000_000;
    assert_eq!(read("ns", &[&[], &[at], &[at + 30_000_000]]).unwrap(), [0.0, 0.03]);
    let error = read("ns", &[&[0], &[30_000], &[60_000]]).unwrap_err().to_string();
    assert!(error.contains("33333.333333 frames a second"), "{error}");
}

/// A pad of 6 x 6 counts of which the last three rows are no sensors, at rest at 1000 but for noise; a press from frame 12
/// on changes the others by `press`.
fn pad(press: f64, is_transposed: bool) -> Vec<f64> {
    let cell = |frame: usize, k: usize| {
        let (row, col) = if is_transposed { (k % 6, k / 6) } else { (k / 6, k % 6) };
        let noise = ((frame * 7 + k * 13) % 5) as f64 - 2.0;
        1000.0 + noise + if frame >= 12 && row < 3 { press + col as f64 } else { 0.0 }
    };
    (0..20).flat_map(|frame| (0..36).map(move |k| cell(frame, k))).collect()
}

#[test]
fn first_frames_that_contradict_the_layout_are_refused() {
    let of = |press: &str, zero: f64| {
        json!({"dermatome_layout": 1, "axes": ["frame", "row", "col"], "time": {"rate": 10},
            "channels": [{"name": "pressure", "unit": "count"}], "press": press, "zero": zero, "taxels": "half.csv"})
    };
    let folder = tempfile::tempdir().unwrap();
    let rows: String = (0..18).map(|k| format!("{},{},{k}\n", k / 6, k % 6)).collect();
    std::fs::write(folder.path().join("half.csv"), format!("row,col,taxel_id\n{rows}")).unwrap();
    let run = |json: Value, raw: &[f64]| {
        let layout = Layout::parse(&folder.path().join("l.json"), &json.to_string()).unwrap();
        let mut decoder = Decoder::new(&layout, Path::new("file"), &facts(&[6, 6])).unwrap();
        decode(&mut decoder, raw, Times::None).map(|_| decoder.statements())
    };
    assert!(run(of("raises", 1000.0), &pad(300.0, false)).is_ok());
    assert!(run(of("lowers", 1000.0), &pad(-300.0, false)).is_ok());
    assert!(run(of("raises", 998.0), &pad(300.0, false)).is_ok(), "a zero that has drifted a little");
    for (json, raw, expected) in [
        (of("lowers", 1000.0), pad(300.0, false), "zero: found 18 taxels below it and 0 above"),
        (of("raises", 0.5), pad(300.0, false), "the middle at"),
        (of("raises", 1000.0), pad(300.0, true), "axes: found 9 cells that move and are no taxels"),
    ] {
        let error = run(json, &raw).unwrap_err().to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
    // A table may name cells that move and are no taxels; where there is one axis of cells, none can be swapped.
    let others: String = (18..36).map(|k| format!("{},{},\n", k / 6, k % 6)).collect();
    let table = |rows: String| std::fs::write(folder.path().join("half.csv"), rows).unwrap();
    table(format!("row,col,taxel_id\n{rows}{others}"));
    run(of("raises", 1000.0), &pad(300.0, true)).unwrap();
    table(format!("row,col,taxel_id\n{rows}0,0,\n"));
    let layout = Layout::parse(&folder.path().join("l.json"), &of("raises", 1000.0).to_string()).unwrap();
    let error =
        Decoder::new(&layout, Path::new("file"), &facts(&[6, 6])).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("rows: found cell 0 with a taxel and without one"), "{error}");
    table(format!("taxel,taxel_id\n{}", (0..18).map(|k| format!("{k},{k}\n")).collect::<String>()));
    let mut json = of("raises", 1000.0);
    json["axes"] = json!(["frame", "taxel"]);
    let layout = Layout::parse(&folder.path().join("l.json"), &json.to_string()).unwrap();
    let mut decoder = Decoder::new(&layout, Path::new("file"), &facts(&[36])).unwrap();
    decode(&mut decoder, &pad(300.0, true), Times::None).unwrap();
    let stated = decoder.statements();
    assert!(stated.iter().any(|s| s.value.starts_with("9 cells that move are none in")), "{stated:?}");
    table(format!("row,col,taxel_id\n{rows}"));
    // Without a stated zero the sign is only a remark: a recording may begin under load.
    let stated = run(of("lowers", 0.0), &pad(300.0, false)).unwrap();
    assert!(stated.iter().any(|s| s.what == "press" && s.source == StatementSource::Checked), "{stated:?}");
}

#[test]
fn drafts_state_what_the_file_does_and_are_refused_until_complete() {
    let facts = StreamFacts {
        stream: "pads".into(),
        cells: vec![2, 12, 32],
        rate_hz: Some(30.0),
        ..StreamFacts::default()
    };
    let draft = Layout::draft(Path::new("some/pads.npy"), &facts);
    let mut json: Value = serde_json::from_str(&draft).unwrap();
    assert_eq!((&json["time"], &json["taxels"]["shape"]), (&json!({"rate": 30.0}), &json!([2, 12, 32])));
    let null = |json: &Value| Layout::parse(Path::new("d.json"), &json.to_string()).unwrap_err().to_string();
    assert!(null(&json).contains("needed: a value"), "{}", null(&json));
    json["axes"] = json!(["frame", "pad", "row", "col"]);
    json["channels"] = json!([{"name": "pressure", "unit": "count"}]);
    json["zero"] = json!({"first": 4});
    assert!(null(&json).contains("press: found null"), "{}", null(&json));
    json["press"] = json!("raises");
    assert_eq!(parse(&json).unwrap().stream(), Some("pads"));
}

/// Zero, sign and threshold are those of channels that measure touches, in whatever order channels are; a unit is that of the
/// component.
#[test]
fn a_temperature_beside_a_force_stays_what_it_is() {
    let (warm, force) = (json!({"name": "temperature", "unit": "C"}), json!({"name": "force", "unit": "N"}));
    for order in [[&warm, &force], [&force, &warm]] {
        let mut channels = Vec::new();
        for (component, channel) in order.into_iter().enumerate() {
            let mut channel = channel.clone();
            channel["component"] = component.into();
            channels.push(channel);
        }
        let at = usize::from(order[0]["name"] == "temperature");
        let changes = |zero: Value| {
            with(&[
                ("axes", json!(["frame", "component", "cell"])),
                ("channels", json!(channels)),
                ("press", json!("lowers")),
                ("zero", zero),
                ("taxels", json!({"shape": [2]})),
            ])
        };
        let facts = StreamFacts { threshold: Some(15.0), ..facts(&[2, 2]) };
        // Two frames at rest at 25 C and 10 N, and one with a touch of 4 N at 26 C.
        let frame = |warm: f64, force: f64| {
            let mut both = [[warm; 2], [force; 2]];
            both.rotate_left(1 - at);
            both.concat()
        };
        let raw = [frame(25.0, 10.0), frame(25.0, 10.0), frame(26.0, 6.0)].concat();
        for zero in [json!(10), json!({"first": 2})] {
            let mut decoder = decoder(&changes(zero.clone()), &facts).unwrap();
            let (values, _) = decode(&mut decoder, &raw, Times::None).unwrap();
            let of =
                |channel: usize| values.chunks_exact(4).map(|frame| frame[2 * channel]).collect::<Vec<_>>();
            assert_eq!(
                (of(at), of(1 - at)),
                (vec![0.0, 0.0, 4.0], vec![25.0, 25.0, 26.0]),
                "{zero} {order:?}"
            );
            let rest = decoder.rest(&facts);
            assert!(rest.is_zero_in(at) && !rest.is_zero_in(1 - at), "{rest:?}");
            // That of the file is of its own numbers.
            assert_eq!(rest.threshold, Some(if zero == json!(10) { 5.0 } else { 15.0 }));
        }
    }
    let of_unit = |unit: &str| {
        let channel = json!([{"name": "y", "unit": unit, "component": 1}]);
        let changes = [
            ("axes", json!(["frame", "component", "cell"])),
            ("channels", channel),
            ("taxels", json!({"shape": [2]})),
        ];
        let facts = StreamFacts { units: vec!["N".into(), "count".into()], ..facts(&[2, 2]) };
        decoder(&with(&changes), &facts).map(|_| ()).map_err(|error| error.to_string())
    };
    assert_eq!(of_unit("count"), Ok(()));
    assert!(of_unit("N").unwrap_err().contains("found the unit count of y; needed: N"));
}

/// Each episode has the zero of its own first frames.
#[test]
fn the_zero_of_an_episode_is_its_own() {
    let mut decoder = decoder(&with(&[("zero", json!({"first": 2}))]), &facts(&[2, 3])).unwrap();
    let mut run = |frames: &[f64], episode| {
        let (mut values, mut seconds) = (Vec::new(), Vec::new());
        let raw: Vec<f64> = frames.iter().flat_map(|&x| [x; 6]).collect();
        decoder.decode(&raw, Times::None, episode, &mut values, &mut seconds).map(|()| values)
    };
    let first = |values: Vec<f64>| values.chunks_exact(6).map(|frame| frame[0]).collect::<Vec<_>>();
    assert_eq!(first(run(&[100.0, 100.0, 107.0], 0).unwrap()), [0.0, 0.0, 7.0]);
    assert_eq!(first(run(&[108.0], 0).unwrap()), [8.0]);
    assert_eq!(first(run(&[200.0, 202.0, 207.0], 1).unwrap()), [-1.0, 1.0, 6.0]);
    assert!(run(&[5.0], 2).unwrap_err().to_string().contains("found 1 frames; needed: the first 2"));
}

/// Nothing is known of counts at rest, whatever the channel beside them is.
#[test]
fn each_channel_has_a_rest_of_its_own() {
    let channel = |name: &str, unit: &str, component: usize| json!({"name": name, "unit": unit, "component": component});
    for at in [0, 1] {
        let channels = json!([channel("pressure", "kPa", at), channel("raw", "count", 1 - at)]);
        let json = with(&[
            ("axes", json!(["frame", "taxel", "component"])),
            ("channels", channels),
            ("zero", json!("taken")),
            ("taxels", json!({"shape": [3]})),
        ]);
        let facts = facts(&[3, 2]);
        assert_eq!(decoder(&json, &facts).unwrap().rest(&facts).is_zero, [true, false], "component {at}");
    }
}

/// A number that stands for none is one in every type of floats: -999.9 is another number in 32 bits, and -1000 in 16.
#[test]
fn missing_numbers_are_those_of_the_type() {
    let json = with(&[
        ("missing", json!([-999.9])),
        ("taxels", json!({"shape": [1, 3]})),
        ("axes", json!(["frame", "row", "col"])),
    ]);
    let mut halves = decoder(&json, &StreamFacts { has_halves: true, ..facts(&[1, 3]) }).unwrap();
    let mut singles = decoder(&json, &facts(&[1, 3])).unwrap();
    let of_singles = |decoder: &mut Decoder, raw: &[f32]| {
        let (mut values, mut seconds) = (Vec::new(), Vec::new());
        decoder.decode(raw, Times::None, 0, &mut values, &mut seconds).unwrap();
        values.iter().map(|x: &f32| x.is_nan()).collect::<Vec<_>>()
    };
    assert_eq!(of_singles(&mut singles, &[-999.9, -1000.0, 5.0]), [true, false, false]);
    assert_eq!(of_singles(&mut halves, &[-999.9, -1000.0, 5.0]), [true, true, false]);
    let (values, _) = decode(&mut singles, &[-999.9, f64::from(-999.9_f32), 5.0], Times::None).unwrap();
    assert_eq!(values.iter().map(|x| x.is_nan()).collect::<Vec<_>>(), [true, true, false]);
}

/// A zero beside each frame concerns channels of touch, and a cell whose zero is missing has no reading.
#[test]
fn zeros_beside_frames_are_subtracted_frame_by_frame() {
    let json = with(&[
        ("axes", json!(["frame", "taxel", "component"])),
        (
            "channels",
            json!([{"name": "a", "unit": "count", "component": 0}, {"name": "temp", "unit": "degC", "component": 1}]),
        ),
        ("zero", json!({"stream": "rest"})),
        ("missing", json!([-1])),
        ("taxels", json!({"shape": [2]})),
    ]);
    let facts = StreamFacts { zero: Some(vec![0.0; 4]), ..facts(&[2, 2]) };
    let mut decoder = decoder(&json, &facts).unwrap();
    let (mut values, mut seconds) = (Vec::<f64>::new(), Vec::new());
    let raw = [12.0, 25.0, 13.0, 26.0, 14.0, 27.0, 15.0, 28.0];
    let zeros = [10.0, 3.0, 10.0, 3.0, 11.0, 3.0, -1.0, 3.0];
    decoder.decode_beside(&raw, &zeros, Times::None, 0, &mut values, &mut seconds).unwrap();
    assert_eq!((&values[..5], &values[6..]), (&[2.0, 3.0, 25.0, 26.0, 3.0][..], &[27.0, 28.0][..]));
    assert!(values[5].is_nan(), "{values:?}");
    let error =
        decoder.decode_beside(&raw, &zeros[..3], Times::None, 0, &mut values, &mut seconds).unwrap_err();
    assert!(error.to_string().contains("3 numbers in the stream of the zero"), "{error}");
}

/// The names of components and a zero that is subtracted, which a file states, are compared with the layout.
#[test]
fn names_and_a_subtracted_zero_are_compared() {
    let json = with(&[
        ("axes", json!(["frame", "taxel", "component"])),
        ("channels", json!([{"name": "pressure", "unit": "Pa", "component": 0}])),
        ("taxels", json!({"shape": [2]})),
    ]);
    let named = |names: [&str; 2]| StreamFacts { names: names.map(String::from).to_vec(), ..facts(&[2, 2]) };
    let error = decoder(&json, &named(["temp", "pressure"])).unwrap_err().to_string();
    assert!(error.contains("found pressure as component 1; needed: component 0"), "{error}");
    assert!(
        decoder(&json, &named(["pressure", "temp"])).is_ok() && decoder(&json, &named(["a", "b"])).is_ok()
    );
    let tared = StreamFacts { tared: vec![true], ..facts(&[2, 3]) };
    for (zero, fits) in
        [(json!(0), true), (json!("taken"), true), (json!(7), false), (json!({"first": 2}), false)]
    {
        let found = decoder(&with(&[("zero", zero.clone())]), &tared);
        assert_eq!(found.is_ok(), fits, "{zero}");
        // Counts, too, whose zero is subtracted.
        found.into_iter().for_each(|decoder| assert!(decoder.rest(&tared).is_zero_in(0)));
    }
}
