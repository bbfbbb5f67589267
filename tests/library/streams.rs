//! Recordings of other programs: what each reader gives, the samples with their truth, and which damaged files are refused.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::data;
use dermatome::io::{
    IoError, Layout, ReadOptions, ReadingsReader, Statement, StatementSource, TimeUnit, read_draft,
};
use serde_json::{Value, json};

/// A recording that was read whole.
struct Recorded {
    ids: Vec<u32>,
    times: Vec<f64>,
    /// Frame after frame.
    values: Vec<Vec<f64>>,
    statements: Vec<Statement>,
}

impl Recorded {
    fn sum(&self, frame: usize) -> f64 {
        self.values[frame].iter().filter(|x| !x.is_nan()).sum()
    }

    fn states(&self, what: &str, source: StatementSource) -> Option<&str> {
        let mut all = self.statements.iter();
        all.find(|s| s.what == what && s.source == source).map(|s| s.value.as_str())
    }
}

fn read_with(path: &Path, layout: Option<Layout>, stream: Option<&str>) -> Result<Recorded, IoError> {
    let options = ReadOptions { layout, stream: stream.map(str::to_owned), ..ReadOptions::default() };
    let mut reader = ReadingsReader::open(path, options)?;
    let ids = reader.ids.iter().flatten().map(|id| id.0).collect();
    let (mut times, mut values) = (Vec::new(), Vec::new());
    let (mut frame, mut time) = (Vec::new(), 0.0);
    while reader.read(&mut frame, &mut time)? {
        times.push(time);
        values.push(frame.clone());
    }
    if let Some(frames) = reader.frames {
        assert_eq!(frames, values.len() as u64, "the number of frames is known");
    }
    Ok(Recorded { ids, times, values, statements: reader.statements() })
}

fn read(path: &Path) -> Result<Recorded, IoError> {
    read_with(path, None, None)
}

/// A grid of this shape of pressures, as a layout.
fn layout_of(shape: &[usize], unit: &str, time: Value) -> Layout {
    let axes: Vec<String> =
        std::iter::once("frame".into()).chain((0..shape.len()).map(|k| format!("axis{k}"))).collect();
    let json = json!({"dermatome_layout": 1, "axes": axes, "time": time, "channels": [{"name": "p", "unit": unit}],
        "press": "raises", "zero": 0, "taxels": {"shape": shape}});
    Layout::parse(Path::new("l.json"), &json.to_string()).unwrap()
}

/// The pressure of a cell of a frame; the first row has a cell without a sensor.
fn pressure(frame: usize, cell: usize) -> f64 {
    ((frame + 1) * cell) as f64 * 0.5
}

fn tekscan() -> String {
    let mut text = "DATA_TYPE MOVIE\nVERSION x\u{e9}\nSENSOR_TYPE F\nROWS 2\nCOLS 3\nROW_SPACING 5.08 mm\nCOL_SPACING 0.508 \
                    centimeters\nSECONDS_PER_FRAME 0.1\nSTART_FRAME 7\nEND_FRAME 9\nUNITS raw\nMIRROR_ROW 0\nMIRROR_COL \
                    0\nASCII_DATA @@\n\n"
        .to_owned();
    for frame in 0..3 {
        let p = |cell| pressure(frame, cell);
        let sum: f64 = (1..6).map(p).sum();
        text += &format!(
            "Frame {}, {},,,Raw Sum=,,{sum}\nB,{},{}\n{},{},{}\n\n",
            frame + 7,
            4.0 + 0.1 * frame as f64,
            p(1),
            p(2),
            p(3),
            p(4),
            p(5)
        );
    }
    text + "@@\n"
}

fn xsensor() -> String {
    let mut text = "\u{feff}File:,\"walk.XSN\",,\n,,,\nUnits:,kPa,,\n,,,\nThreshold:,1\n".to_owned();
    for frame in 0..3 {
        text +=
            &format!("FRAME,{}\n,,,\nDate, 2026 Jan 31\nTime, 23:59:59.{}\n,,,\n", frame + 5, 2 * frame + 1);
        for (k, foot) in ["left", "right"].iter().enumerate() {
            let p = |cell| pressure(frame, cell + k);
            let load: f64 = (0..4).map(p).sum::<f64>() * 1e3 * 1e-4;
            text += &format!(
                "SENSOR,{foot}\n,,,\nRows,2\nColumns,2\nSensel Width (cm),1\nSensel Height (cm),1\nEst. Load (N),{load:.3}\n,,,\nSENSELS\n"
            );
            text += &format!(",,,\n{},{},,\n,,,\n{},{},,\n,,,\n", p(0), p(1), p(2), p(3));
            text += "Name,Heel\nCells,2\nEst. Load (N),99\n";
        }
    }
    text
}

fn emed() -> Vec<u8> {
    let mut text = "\n\t\tPage 1\n\n\tFile: 2.dat \tMatrix: 64x95 \n\tSensor area: 1 cmM-2\tTime/picture:10.0 ms\n\tSensor size: 1.0x1.0 \
                    cm\n"
        .to_owned();
    for frame in 0..3 {
        // The last picture is cropped to its second row.
        let rows = if frame == 2 { 1..2 } else { 0..2 };
        text += &format!(
            "\tPict-No.: {}  Force[N]=sum*sensor_area in row/column\n\n\t26\t27\tForce\n",
            frame + 1
        );
        let mut force = 0.0;
        for row in rows {
            let [a, b] = [pressure(frame, 2 * row), pressure(frame, 2 * row + 1)];
            force += 0.1 * (a + b);
            text += &format!("{}\t{a:.2}\t{b:.2}\t{:.2}\n", 30 + row, 0.1 * (a + b));
        }
        text += &format!("Force\t0.0\t0.0\t{force:.2}\n\u{c}\n\t\tPage {}\n", frame + 2);
    }
    text += "\tMaximum pressure picture\n\t26\t27\n30\t99\t99\n";
    // A square in Latin-1.
    text.replace("cmM-2", "cm\u{b2}").chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect()
}

fn pedar() -> String {
    let mut text = "file name:  a.sol\tdate/time 1\nsensor type:  y-1\ntotal time [secs]: 0.03\ttime per frame [secs]: \
                    0.01\tscanning rate [Hz]: 100\npressure values in kPa\nleft insole: 1,2,\nright insole: 1,2,\n\ntime[secs]\t1\t2\t1\t2\n"
        .to_owned();
    for frame in 0..3 {
        let p = |cell| pressure(frame, cell);
        text += &format!("  {:.5}\t{}\t{}\t{}\t{}\n", 0.01 * (frame + 1) as f64, p(0), p(1), p(2), p(3));
    }
    text
}

fn pliance() -> String {
    let mut text = "file name: a.mat\nmat type s21\ntotal times [secs]: 1 time per frame [secs]: 0.5 scanning rate [Hz]: \
                    2\npressure values in kPa\n\ntime[secs] 4 9\n"
        .to_owned();
    let mut forces = String::new();
    for frame in 0..3 {
        let time = 5.0 + 0.5 * frame as f64;
        let p = |cell| pressure(frame, cell);
        text += &format!(" {time:.5} {} {}\n", p(1), p(2));
        forces += &format!(" {time:.5} {:.3} 0 0\n", 0.1 * p(1) + 0.2 * p(2));
    }
    text + " MPP 9 9\n\n time[secs] force[N] x[cm] y[cm]\n\n"
        + &forces
        + "\nsensor 4 9\nx[c] 0 1.5\ny[c] 2 2\narea 1 2\n"
}

fn stappone() -> String {
    let rows = (0..3).map(|k| {
        format!("1,{},0,{},{},{}\n", 1_768_494_979_568_u64 + 16 * k, 350 + k, 474, u8::from(k == 1))
    });
    "sole_id,timestamp,accel_x,pressure_01,pressure_02,corrupt\n".to_owned() + &rows.collect::<String>()
}

fn xela() -> String {
    let message = |k: u64| {
        format!(
            "{{\"message\": {}, \"time\": {}, \"sensors\": 1, \"1\": {{\"data\": \"0{k}00,8000,FFFF,0001,0002,0003\", \"taxels\": 2, \"model\": \"XR\", \"calibrated\": null}}}}\n",
            780 + k,
            1.6e9 + 0.01 * k as f64
        )
    };
    "{\"message\": \"Welcome\", \"time\": 1.0}\n".to_owned() + &(0..3).map(message).collect::<String>()
}

fn xela_layout() -> Layout {
    let channel = |name: &str, k: usize, signed: bool| json!({"name": name, "unit": "count", "component": k, "signed": signed});
    let json = json!({"dermatome_layout": 1, "stream": "1", "axes": ["frame", "taxel", "component"],
        "time": {"stream": "time", "unit": "s"}, "channels": [channel("shear.x", 0, true), channel("normal", 2, false)],
        "press": "raises", "zero": 0, "taxels": {"shape": [2]}});
    Layout::parse(Path::new("x.json"), &json.to_string()).unwrap()
}

/// Writes a file and reads it.
fn read_text(
    folder: &Path,
    name: &str,
    content: impl AsRef<[u8]>,
    layout: Option<Layout>,
) -> Result<Recorded, IoError> {
    let path = folder.join(name);
    fs::write(&path, content).unwrap();
    read_with(&path, layout, None)
}

#[test]
fn each_kind_is_known_by_its_content_and_read() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let p = |frame: usize, cells: &[usize]| -> Vec<f64> {
        cells.iter().map(|&cell| pressure(frame, cell)).collect()
    };
    let found = read_text(folder, "a.dat", tekscan(), None).unwrap();
    assert_eq!(
        (found.ids, &found.values[2], found.times),
        (vec![2, 3, 4, 5, 6], &p(2, &[1, 2, 3, 4, 5]), vec![4.0, 4.1, 4.2])
    );
    let found = read_text(folder, "a.lst", emed(), None).unwrap();
    assert_eq!((&found.values[1], found.times), (&p(1, &[0, 1, 2, 3]), vec![0.0, 0.01, 0.02]));
    assert_eq!(found.values[2], [0.0, 0.0, pressure(2, 2), pressure(2, 3)], "what is cropped is not loaded");
    assert_eq!(found.statements.iter().find(|s| s.what == "unit").unwrap().source, StatementSource::Checked);
    let found = read_text(folder, "pedar.asc", pedar(), None).unwrap();
    assert_eq!(
        (found.ids, &found.values[1], found.times),
        (vec![1, 2, 3, 4], &p(1, &[0, 1, 2, 3]), vec![0.01, 0.02, 0.03])
    );
    let one_foot = pedar()
        .replace("right insole: 1,2,\n", "")
        .replace("\t1\t2\t1\t2\n", "\t1\t2\t3\t4\n")
        .replace("left insole: 1,2,", "left insole: 1,2,3,4");
    let left = read_text(folder, "one.asc", &one_foot, None).unwrap();
    assert_eq!(
        (left.ids.as_slice(), left.states("foot", StatementSource::File)),
        (&[1, 2, 3, 4][..], Some("left, by its list of sensors"))
    );
    let right = read_text(folder, "one.asc", one_foot.replace("left", "right"), None).unwrap();
    assert_eq!(
        (right.ids, right.values),
        (vec![5, 6, 7, 8], left.values),
        "taxels of a right foot follow those of a left one"
    );
    let capital = one_foot.replace("left insole", "Right Insole");
    assert_eq!(
        read_text(folder, "one.asc", capital, None).unwrap().ids,
        [5, 6, 7, 8],
        "whatever the case of its letters"
    );
    let found = read_text(folder, "pliance.asc", pliance(), None).unwrap();
    assert_eq!((&found.ids, &found.values[2]), (&vec![4, 9], &p(2, &[1, 2])));
    assert!(found.states("forces", StatementSource::Checked).unwrap().contains("3 frames"));
    let found = read_text(folder, "soles.csv", stappone(), None).unwrap();
    assert_eq!((&found.values[2], &found.times), (&vec![352.0, 474.0], &vec![0.0, 0.016, 0.032]));
    assert!(found.values[1].iter().all(|x| x.is_nan()));
    assert!(found.states("corrupt", StatementSource::File).unwrap().starts_with("1 frames"));
    assert_eq!(found.states("unit", StatementSource::File), Some("none in the file"));
    let found = read_text(folder, "a.jsonl", xela(), Some(xela_layout())).unwrap();
    assert_eq!(found.values[1], [256.0, 1.0, 65535.0, 3.0]);
    let path = folder.join("feet.csv");
    fs::write(&path, xsensor()).unwrap();
    let error = read(&path).map(|_| ()).unwrap_err().to_string();
    assert!(
        error.contains("found 2 streams; needed: one of \"left\" of [2, 2], \"right\" of [2, 2]"),
        "{error}"
    );
    let found = read_with(&path, None, Some("right")).unwrap();
    assert_eq!(found.values[1], p(1, &[1, 2, 3, 4]));
    assert!(found.times.iter().zip([0.0, 0.2, 0.4]).all(|(t, x)| (t - x).abs() < 1e-6), "{:?}", found.times);
}

/// Each line: what of a file is replaced by what, and what the error says, or `+` and what is stated.
#[test]
fn damaged_files_are_refused_or_stated() {
    let folder = tempfile::tempdir().unwrap();
    let pad = |unit: &str| layout_of(&[2, 3], unit, json!({"unit": "s"}));
    let failed = std::cell::RefCell::new(Vec::new());
    let check = |name: &str, content: &[u8], layout: Option<Layout>, edits: &[(&str, &str, &str)]| {
        let whole = read_text(folder.path(), name, content, layout.clone());
        assert!(whole.is_ok(), "{name} as it is: {:?}", whole.err());
        let mut wrong = Vec::new();
        for (from, to, expected) in edits {
            // Bytes of Latin-1 stay bytes.
            let text: String = content.iter().map(|&byte| char::from(byte)).collect();
            let changed = text.replacen(from, to, 1);
            if changed == text {
                wrong.push(format!("{from:?} is not in {name}"));
                continue;
            }
            let changed: Vec<u8> = changed.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect();
            match (expected.strip_prefix('+'), read_text(folder.path(), name, &changed, layout.clone())) {
                (Some(stated), Ok(found)) => {
                    let all: Vec<_> =
                        found.statements.iter().map(|s| format!("{}: {}", s.what, s.value)).collect();
                    if !all.iter().any(|statement| statement.contains(stated)) {
                        wrong.push(format!("{to:?}: {stated} is not in {all:?}"));
                    }
                }
                (None, Err(error)) => {
                    let error = error.to_string();
                    if !(error.contains(name) && error.contains(expected)) {
                        wrong.push(format!("{to:?}: {error}, and not {expected}"));
                    }
                }
                (_, found) => {
                    wrong.push(format!(
                        "{to:?}: {:?}",
                        found.map(|f| f.statements).map_err(|e| e.to_string())
                    ));
                }
            }
        }
        failed.borrow_mut().extend(wrong.into_iter().map(|wrong| format!("{name}: {wrong}")));
    };
    let half = |text: &str| text[text.len() / 2..].to_owned();
    check(
        "t.asf",
        tekscan().as_bytes(),
        Some(pad("raw")),
        &[
            ("UNITS raw\n", "", "a line UNITS"),
            ("UNITS raw", "UNITS PSI", "found the unit psi"),
            ("ROWS 2", "ROWS 3", "found the end of a frame; needed: 3 cells in row 2 of 3"),
            ("ROWS 2", "ROWS 99999999", "found ROWS"),
            ("COLS 3", "COLS 4", "found 3 cells; needed: 4"),
            ("1.5,2,2.5", "1.5,2", "found 2 cells; needed: 3"),
            ("0.5,1\n", "0.5,1,,,\n", "+taxels: 5 of 6 cells"),
            ("0.5,1\n", "0.5,1,7\n", "more than 3 cells in row 0"),
            ("B,0.5", "0,0.5", "needed: a sensor or none in a cell"),
            ("B,0.5,1\n", "B;0,5;1\n", "column 1: found \"B;0\""),
            ("0.5,1\n", "0.5,x\n", "column 3: found \"x\"; needed: a number"),
            ("SECONDS_PER_FRAME 0.1", "SECONDS_PER_FRAME 0,1", "needed: a number with a decimal point"),
            (
                "SECONDS_PER_FRAME 0.1",
                "SECONDS_PER_FRAME 1e-320",
                "needed: the seconds from a frame to the next",
            ),
            ("5.08 mm", "5,08 mm", "needed: a number with a decimal point"),
            ("5.08 mm", "5.08 ells", "a number above 0 and mm"),
            ("Raw Sum=,,7.5", "Raw Sum=,,9", "frame 7: found cells of the sum 7.5; needed: 9, the Raw Sum"),
            ("END_FRAME 9", "END_FRAME 10", "found 3 frames; needed: 4"),
            ("START_", "SENSEL_AREA 10 mm2\nSTART_", "found SENSEL_AREA 10 mm2; needed: 25.806400 mm2"),
            ("START_", "SENSEL_AREA 0.258064 cm2\nSTART_", "+sums: the Raw Sum of 3 frames"),
            ("SENSOR_TYPE F", "SENSOR_TYPE F\nTIME 3 d\u{e9}c.", "+recorded: 3 d\u{e9}c."),
            ("FRAME 0.1", "FRAME 0.2", "found frames 0.100000 s apart; needed: 0.200000 s, as the 5 frames"),
            ("Frame 8", "Frame 9", "needed: frame 8: none is left out"),
            ("MIRROR_COL 0", "MIRROR_COL 1", "needed: `flip` in `taxels`"),
            (&half(&tekscan()), "", "found the end of the file"),
        ],
    );
    check(
        "e.lst",
        &emed(),
        None,
        &[
            ("2.00\t3.00", "2.00\t9.00", "picture 2: found cells that are"),
            ("Pict-No.: 2", "Pict-No.: 3", "picture 3: found picture 3 after 1"),
            ("Force\t0.0\t0.0\t0.30", "Fin\t0.0\t0.0\t0.30", "picture 1: found no force"),
            ("1.0x1.0", "1,0x1,0", "needed: the size of a sensor"),
            ("31\t1.00\t1.50\t0.25", "31\t1.00\t0.25", "found 2 numbers in row 31; needed: 3"),
            ("Time/picture:10.0 ms", "Time/picture:0 ms", "the time of a picture"),
        ],
    );
    check(
        "p.asc",
        pedar().as_bytes(),
        None,
        &[
            ("values in kPa", "values in stone", "found the unit \"stone\""),
            (
                "\t1\t2\t1\t2\n",
                "\t1\t2\n",
                "found 2 columns of sensors; needed: those of the left insole (2), then",
            ),
            ("\t1\t2\t1\t2\n", "\t1\t2\t1\t1\n", "found 4 columns"),
            ("0.02000\t0\t1", "0.02000\t1", "found 3 pressures; needed: 4"),
            ("  0.02000", "x 0.02000", "needed: frames without other lines between them"),
            ("  0.03000", "? 0.03000", "needed: frames without other lines between them"),
            ("0.02000", "0.01000", "frame 1: found 0.01 s after 0.01 s"),
            ("[Hz]: 100", "[Hz]: 50", "found frames 0.010000 s apart; needed: 0.020000 s, as the 50 frames"),
            ("0.5", "0,5", "needed: a number with a decimal point"),
        ],
    );
    check(
        "m.asc",
        pliance().as_bytes(),
        None,
        &[
            (
                "values in kPa",
                "values in mmHg",
                "frame 0: found pressures that are 0.033 N in mmHg; needed: 0.25 N",
            ),
            (
                " 5.50000 0.500",
                " 5.60000 0.500",
                "frame 1: found the force of the time 5.6 s; needed: one for 5.5 s",
            ),
            (" 5.50000 0.500 0 0\n", "", "found forces of 2 frames; needed: 3"),
            ("area 1 2", "area 1", "found 1 numbers of area; needed: 2"),
            ("time[secs] 4 9", "time[secs] 4 4", "a number of its own for each sensor"),
        ],
    );
    check(
        "s.csv",
        stappone().as_bytes(),
        None,
        &[
            (
                "1,1768494979584",
                "2,1768494979584",
                "found 2 streams; needed: one of \"sole 1\" of [2], \"sole 2\"",
            ),
            ("1768494979584", "1768494979.584", "needed: a whole number of ms"),
            ("1768494979584", "1768494979500", "frame 1: found"),
            ("350,474,0", "350,474", "found 5 cells; needed: 6"),
            ("350,474,0", ",474,0", "+missing: 3 readings"),
            ("accel_x,", "pressure_sum,", "+columns not read: pressure_sum"),
            ("pressure_01", "pressure_02", "column 5: found sensor 2 again"),
            ("pressure_01", "pressure_09", "+taxels: 2 of 2 cells"),
            (
                "1,1768494979584",
                "sole_id,timestamp,a,b,c,d\n1,1768494979584",
                "line 3: found the names of the columns again",
            ),
        ],
    );
    check(
        "x.jsonl",
        xela().as_bytes(),
        Some(xela_layout()),
        &[
            ("\"message\": 781", "\"message\": 780", "found message 780 after 780"),
            ("\"message\": 782", "\"message\": 785", "+lost messages: 3 messages"),
            ("\"taxels\": 2", "\"taxels\": 3", "cells of a frame: found [3]"),
            ("8000,FFFF", "8000", "found 5 numbers; needed: 6"),
            ("FFFF", "FFFFF", "needed: four hexadecimal digits"),
            ("FFFF", "FFF", "found \"FFF\"; needed: four hexadecimal digits"),
            ("FFFF", "+80F", "needed: four hexadecimal digits"),
            (
                "781, \"time\": 1600000000.01, \"sensors\": 1, \"1\": {\"data\": \"0100,8000,FFFF,0001,0002,0003\", \"taxels\": 2",
                "781, \"time\": 1600000000.01, \"sensors\": 1, \"1\": {\"data\": \"0100,8000,FFFF\", \"taxels\": 1",
                "found 1 taxels of the sensor XR; needed: 2 taxels of the sensor XR, as in the messages before",
            ),
            ("\"XR\"", "\"XR\", \"calibrated\": [1]", "+sensor: XR"),
            ("}\n{\"message\": 781", "\n{\"message\": 781", "needed: a message as one JSON object"),
            ("\"1\": {", "\"2\": {", "streams: found no stream \"1\"; needed: one of \"2\""),
        ],
    );
    let left = xsensor().replace("right", "spare");
    let of_left = {
        let mut json: Value =
            serde_json::from_str(layout_of(&[2, 2], "kPa", json!({"unit": "s"})).text()).unwrap();
        json["stream"] = "left".into();
        Layout::parse(Path::new("l.json"), &json.to_string()).unwrap()
    };
    check(
        "x.csv",
        left.as_bytes(),
        Some(of_left),
        &[
            ("Units:,kPa", "Units:,mmHg", "found the unit mmHg"),
            (
                "Est. Load (N),0.300",
                "Est. Load (N),9",
                "frame 5: found cells of left that are 0.30 N in kPa; needed: 9 N",
            ),
            ("SENSOR,left", "SENSOR,spare2", "+sensor missing: 1 frames"),
            ("FRAME,6", "FRAME,5", "found frame 5 again"),
            ("Rows,2", "Rows,0", "found Rows"),
            ("0,0.5,,", "0,0.5,1,", "more than 2 cells in row 0"),
            ("0,0.5,,", ",0.5,,", "+missing: 1 readings"),
            ("23:59:59.3", "23.59", "needed: a time as"),
            (
                "Rows,2",
                "Total Area (cm\u{b2}),3\nRows,2",
                "+cells without a sensor: 1 of 4 cells are no sensors",
            ),
            (
                "Rows,2",
                "Total Area (cm\u{b2}),5\nRows,2",
                "found a Total Area of 5 cm2 of left; needed: at most 4.00 cm2",
            ),
            (
                "Jan 31\nTime, 23:59:59.5",
                "Feb 1\nTime, 23:59:59.5",
                "+gap: 86400.200000 s without frames before frame 2; not filled",
            ),
            ("Jan 31\nTime, 23:59:59.3", "f\u{e9}v. 1\nTime, 23:59:59.3", "needed: dates as 2026 Jan 31"),
        ],
    );
    let failed = failed.into_inner();
    assert!(failed.is_empty(), "{failed:#?}");
}

#[test]
fn arrays_of_any_axes_are_read_by_a_layout() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    // Frames 4, pads 2, cells 3, in both orders and with the frames last.
    let number = |f: usize, p: usize, c: usize| i16::try_from(100 * f + 10 * p + c).unwrap();
    let all = |order: &[usize; 3], sizes: [usize; 3]| -> Vec<i16> {
        let mut out = Vec::new();
        for a in 0..sizes[order[0]] {
            for b in 0..sizes[order[1]] {
                for c in 0..sizes[order[2]] {
                    let mut at = [0; 3];
                    (at[order[0]], at[order[1]], at[order[2]]) = (a, b, c);
                    out.push(number(at[0], at[1], at[2]));
                }
            }
        }
        out
    };
    let write = |shape: &str, is_fortran: &str, order: &str, numbers: &[i16]| {
        let header = format!("{{'descr': '{order}i2', 'fortran_order': {is_fortran}, 'shape': {shape}, }}");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend_from_slice(&u16::try_from(header.len()).unwrap().to_le_bytes());
        bytes.extend_from_slice(header.as_bytes());
        for x in numbers {
            bytes.extend_from_slice(&if order == ">" { x.to_be_bytes() } else { x.to_le_bytes() });
        }
        fs::write(&path, bytes).unwrap();
    };
    let layout = |axes: [&str; 3]| {
        let json = json!({"dermatome_layout": 1, "axes": axes, "time": {"rate": 2}, "channels": [{"name": "p", "unit": "count"}],
            "press": "raises", "zero": 0, "taxels": {"shape": [2, 3], "first_id": 0}});
        Layout::parse(Path::new("l.json"), &json.to_string()).unwrap()
    };
    let expected: Vec<Vec<f64>> =
        (0..4).map(|f| (0..6).map(|k| f64::from(number(f, k / 3, k % 3))).collect()).collect();
    for (shape, is_fortran, order, axes, numbers) in [
        ("(4, 2, 3)", "False", "<", ["frame", "pad", "cell"], all(&[0, 1, 2], [4, 2, 3])),
        ("(4, 2, 3)", "False", ">", ["frame", "pad", "cell"], all(&[0, 1, 2], [4, 2, 3])),
        ("(4, 2, 3)", "True", "<", ["frame", "pad", "cell"], all(&[2, 1, 0], [4, 2, 3])),
        ("(2, 3, 4)", "False", "<", ["pad", "cell", "frame"], all(&[1, 2, 0], [4, 2, 3])),
        ("(2, 4, 3)", "False", "<", ["pad", "frame", "cell"], all(&[1, 0, 2], [4, 2, 3])),
        ("(2, 4, 3)", "True", ">", ["pad", "frame", "cell"], all(&[2, 0, 1], [4, 2, 3])),
    ] {
        write(shape, is_fortran, order, &numbers);
        let found = read_with(&path, Some(layout(axes)), None).unwrap();
        assert_eq!(
            (found.values, found.times),
            (expected.clone(), vec![0.0, 0.5, 1.0, 1.5]),
            "{shape} {is_fortran} {axes:?}"
        );
    }
    for (shape, axes, wanted) in [
        ("(4, 6)", ["frame", "pad", "cell"], "axes: found frames of the shape [6]"),
        ("(4, 3, 2)", ["frame", "pad", "cell"], "cells of a frame: found [3, 2]"),
        ("(4, 2, 99999999999)", ["frame", "pad", "cell"], "bytes for it"),
        ("(0, 2, 3)", ["frame", "pad", "cell"], "at least one number"),
    ] {
        write(shape, "False", "<", if shape.starts_with("(0") { &[] } else { &[0; 24] });
        let error = read_with(&path, Some(layout(axes)), None).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(wanted), "{shape}: {error}");
    }
    // An axis of episodes: each after the other with its own times, or one of them.
    let episodes = |axes: [&str; 3], episode: Option<u64>| {
        let mut json: Value = serde_json::from_str(layout(["frame", "pad", "cell"]).text()).unwrap();
        (json["axes"], json["taxels"]) = (json!(axes), json!({"shape": [3]}));
        episode.into_iter().for_each(|k| json["episode"] = k.into());
        let layout = Layout::parse(Path::new("l.json"), &json.to_string()).unwrap();
        read_with(&path, Some(layout), None)
    };
    for (shape, axes, order) in [
        ("(2, 4, 3)", ["episode", "frame", "cell"], [1, 0, 2]),
        ("(4, 3, 2)", ["frame", "cell", "episode"], [0, 2, 1]),
    ] {
        write(shape, "False", "<", &all(&order, [4, 2, 3]));
        let rows =
            |p: usize| (0..4).map(move |f| (0..3).map(|c| f64::from(number(f, p, c))).collect::<Vec<_>>());
        let found = episodes(axes, None).unwrap();
        assert_eq!(found.values, rows(0).chain(rows(1)).collect::<Vec<_>>(), "{axes:?}");
        assert_eq!(found.times, [0.0, 0.5, 1.0, 1.5, 0.0, 0.5, 1.0, 1.5]);
        assert!(
            found.states("episodes", StatementSource::File).unwrap().starts_with("2, one after the other")
        );
        assert_eq!(episodes(axes, Some(1)).unwrap().values, rows(1).collect::<Vec<_>>());
        let error = episodes(axes, Some(2)).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains("episode: found 2; needed: 0 to 1"), "{error}");
    }
    fs::write(&path, {
        let header = "{'descr': '|O', 'fortran_order': False, 'shape': (1,), }";
        [b"\x93NUMPY\x01\x00", &u16::try_from(header.len()).unwrap().to_le_bytes()[..], header.as_bytes()]
            .concat()
    })
    .unwrap();
    let error =
        read_with(&path, Some(layout(["frame", "pad", "cell"])), None).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("arrays: found the array (1,) objects; needed: an array of numbers"), "{error}");
    write("(4, 2, 3)", "False", "<", &[0; 24]);
    let draft: Value = serde_json::from_str(&ReadingsReader::draft_layout(&path, None).unwrap()).unwrap();
    assert_eq!((&draft["axes"], &draft["time"]["rate"]), (&json!(["frame", null, null]), &Value::Null));
    let has_help = |key: &str| draft["note"][key].is_string();
    assert_eq!(["axes", "time", "press", "taxels"].map(has_help), [true, true, true, false], "of each null");
}

#[test]
fn files_with_positions_are_flat_skins() {
    let folder = tempfile::tempdir().unwrap();
    for (name, content, ids, first) in [
        ("t.asf", tekscan().into_bytes(), vec![2, 3, 4, 5, 6], [5.08e-3, 0.0]),
        ("e.lst", emed(), vec![1, 2, 3, 4], [0.0, 0.0]),
        ("m.asc", pliance().into_bytes(), vec![4, 9], [0.0, 0.02]),
    ] {
        let path = folder.path().join(name);
        fs::write(&path, content).unwrap();
        let draft = read_draft(&path).unwrap();
        let sheet = &draft.sheets[0];
        let found: Vec<u32> = sheet.ids.iter().flatten().map(|id| id.0).collect();
        assert_eq!(found, ids, "{name}");
        assert!(
            (sheet.positions[0].x - first[0]).abs() < 1e-9 && (sheet.positions[0].y - first[1]).abs() < 1e-9
        );
        let recorded = read(&path).unwrap();
        assert_eq!(recorded.ids, ids, "{name}: the taxels of the recording are those of the skin");
    }
    fs::write(folder.path().join("p.asc"), pedar()).unwrap();
    let error = read_draft(&folder.path().join("p.asc")).unwrap_err().to_string();
    assert!(error.contains("no pitch and no positions"), "{error}");
}

/// The samples by the real programs, with their truth.
#[test]
fn samples_equal_their_truth() {
    let Some(folder) = data("recordings") else { return };
    let truth: Value = serde_json::from_str(&fs::read_to_string(folder.join("truth.json")).unwrap()).unwrap();
    let layout = |name: &str| Some(Layout::read(&folder.join("layouts").join(name)).unwrap());
    let open = |name: &str, layout: Option<Layout>, stream: Option<&str>| {
        read_with(&folder.join(name), layout, stream).unwrap_or_else(|e| panic!("{e}"))
    };
    let near = |a: f64, b: &Value| (a - b.as_f64().unwrap()).abs() <= 1e-6 * (1.0 + a.abs());
    for (name, layout_name, cells, area) in [
        ("vendor/fscan_testL.asf", Some("fscan.json"), 60 * 21 - 305, 25.8064e-6),
        ("vendor/fscan_testL.asf", None, 60 * 21 - 305, 25.8064e-6),
        ("vendor/iscan_test.csv", Some("iscan.json"), 28 * 28 - 300, f64::NAN),
        ("vendor/emed_test.lst", None, 54 * 22, 25e-6),
        ("vendor/pliance_test.asc", None, 812, f64::NAN),
        ("vendor/pedar_example.asc", None, 198, f64::NAN),
        ("vendor/stappone_example.csv", None, 12, f64::NAN),
    ] {
        let found = open(name, layout_name.and_then(layout), None);
        let truth = &truth[name];
        assert_eq!(
            (found.values.len() as u64, found.ids.len()),
            (truth["shape"][0].as_u64().unwrap(), cells),
            "{name}"
        );
        // The times of I-Scan are those of its frames, one of which is late.
        if let Some(dt) = truth["dt"].as_f64().filter(|_| !name.contains("iscan")) {
            let step = (found.times[found.times.len() - 1] - found.times[0]) / (found.times.len() - 1) as f64;
            assert!((step - dt).abs() < 1e-4, "{name}: {step}");
        }
        for (frame, force) in
            truth["force_N"].as_array().into_iter().flatten().enumerate().filter(|_| !area.is_nan())
        {
            let newtons = found.sum(frame) * 1e3 * area;
            assert!((newtons - force.as_f64().unwrap()).abs() < 0.06, "{name} {frame}: {newtons} {force}");
        }
        for (frame, sum) in truth["raw_sum"].as_array().into_iter().flatten().enumerate() {
            assert!(near(found.sum(frame), sum), "{name} {frame}");
        }
        for (value, first) in found.values[0].iter().zip(truth["first"].as_array().into_iter().flatten()) {
            assert!(near(*value, first), "{name}");
        }
        if let Some(max) = truth.get("max") {
            assert!(near(found.values.iter().flatten().fold(0.0, |a, &b| f64::max(a, b)), max), "{name}");
        }
        if let Some(first) = truth.get("first_time_s") {
            assert!(near(found.times[0], first), "{name}");
        }
    }
    let name = "vendor/xsensor_data.csv";
    for (sensor, loads) in truth[name]["load_N"].as_object().unwrap() {
        let found = open(name, None, Some(sensor));
        assert_eq!((found.values.len(), found.ids.len()), (8, 31 * 11), "{sensor}");
        for (frame, load) in loads.as_array().unwrap().iter().enumerate() {
            let newtons = found.sum(frame) * 133.322_387_415 * 0.0086 * 0.0086;
            assert!((newtons - load.as_f64().unwrap()).abs() < 0.9, "{sensor}: {newtons} {load}");
            assert!(near(found.times[frame], &truth[name]["times_s"][frame]));
        }
    }
    let found = open("xela/xr1944.jsonl", layout("xela_xr1944.json"), None);
    assert_eq!((found.values.len(), found.ids.len(), found.values[0].len()), (30, 16, 48));
    let rise = found.values[29][32 + 5] - found.values[19][32 + 5];
    assert!((rise - 400.0).abs() < 20.0, "taxel 6, z: {rise}");
    let found = open("yarp/skin/data.log", layout("icub_forearm.json"), None);
    assert_eq!((found.values.len(), found.ids.len()), (30, 160));
    let falling = (0..160).max_by(|&a, &b| found.values[29][a].total_cmp(&found.values[29][b])).unwrap();
    assert_eq!(found.ids[falling], 38, "channel 37 is taxel 38 and is pressed");
    let found = open("numpy/pads.npy", layout("pad_pair.json"), None);
    assert_eq!((found.values.len(), found.ids.len()), (48, 768));
    let found = open("numpy/pads.npy", layout("pad_turned.json"), None);
    assert_eq!(
        found.values[0][found.ids.iter().position(|&id| id == 1 + 10 * 32 + 5).unwrap()],
        777.0,
        "row 1 of 12, flipped"
    );
    let mut glove: Value =
        serde_json::from_str(&fs::read_to_string(folder.join("layouts/opentouch.json")).unwrap()).unwrap();
    glove["stream"] = "pressure".into();
    glove["time"] = json!({"stream": "stamp_ms", "unit": "ms"});
    let glove = Layout::parse(&folder.join("layouts/glove.json"), &glove.to_string()).unwrap();
    assert_eq!(open("numpy/glove.npz", Some(glove), None).values[0].len(), 169);
}

/// What `spoil.py` beside the samples does to files of vendors and to arrays.
#[test]
fn spoiled_samples_are_refused_or_stated() {
    let Some(folder) = data("recordings") else { return };
    let out = tempfile::tempdir().unwrap();
    let layout = |name: &str| Layout::read(&folder.join("layouts").join(name));
    let spoil = |name: &str, change: &dyn Fn(&str) -> String| -> PathBuf {
        let bytes = fs::read(folder.join(name)).unwrap();
        let text: String = bytes.iter().map(|&byte| char::from(byte)).collect();
        let changed = change(&text);
        assert_ne!(changed, text, "{name}");
        let path = out.path().join(Path::new(name).file_name().unwrap());
        fs::write(&path, changed.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect::<Vec<u8>>())
            .unwrap();
        path
    };
    let one = |from: &'static str, to: &'static str| move |text: &str| text.replacen(from, to, 1);
    let fscan = "vendor/fscan_testL.asf";
    let without_frame = |text: &str| {
        let (start, end) = (text.find("Frame 40").unwrap(), text.find("Frame 41").unwrap());
        text[..start].to_owned() + &text[end..]
    };
    let wrong_cell = |text: &str| {
        let start = text.find("\nFrame 45").unwrap();
        let row = text[start + 1..].match_indices('\n').nth(9).unwrap().0 + start + 1;
        text[..row].to_owned() + &text[row..].replacen(",0,", ",90,", 1)
    };
    type Change<'a> = &'a dyn Fn(&str) -> String;
    for (name, change, layout_name, expected) in [
        (fscan, &one("UNITS KPa\n", "") as Change<'_>, Some("fscan.json"), "UNITS"),
        (fscan, &one("UNITS KPa", "UNITS PSI"), Some("fscan.json"), "the unit psi"),
        (fscan, &one("ROWS 60", "ROWS 61"), Some("fscan.json"), "needed: 21 cells in row 60 of 61"),
        ("vendor/iscan_test.csv", &wrong_cell, Some("iscan.json"), "frame 45: found cells of the sum"),
        (fscan, &|text: &str| text[..34_000].to_owned(), Some("fscan.json"), "line 760"),
        (fscan, &without_frame, Some("fscan.json"), "frame 40: none is left out"),
        (fscan, &one("MIRROR_ROW 0", "MIRROR_ROW 1"), Some("fscan.json"), "mirrored"),
        ("vendor/emed_test.lst", &one("\t65.00", "\t95.00"), None, "the Force of the page"),
        (
            "vendor/pliance_test.asc",
            &one("pressure values in kPa", "pressure values in mmHg"),
            None,
            "force[N] of the frame",
        ),
        ("vendor/xsensor_data.csv", &one("Units:,mmHg", "Units:,kPa"), None, "streams: found 2"),
    ] {
        let path = spoil(name, change);
        let layout = layout_name.map(|name| layout(name).unwrap());
        let error = read_with(&path, layout, None).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(expected), "{name}: {error}");
    }
    let path = spoil("vendor/xsensor_data.csv", &one("Units:,mmHg", "Units:,kPa"));
    let error =
        read_with(&path, None, Some("HX210.11.31.M11-DFM-LF S0073")).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("Est. Load"), "{error}");
    let corrupt = |text: &str| text.replacen(",0\n1,1768", ",1\n1,1768", 3);
    let found = read(&spoil("vendor/stappone_example.csv", &corrupt)).unwrap();
    assert!(found.states("corrupt", StatementSource::File).unwrap().starts_with("3 frames"));
    let error = read(&folder.join("numpy/pads.npy")).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("(48, 2, 12, 32)"), "{error}");
    let error = layout("no_press.json").unwrap_err().to_string();
    assert!(error.contains("press: found none"), "{error}");
    assert_eq!(TimeUnit::named("ms"), Some(TimeUnit::Milliseconds));
}

/// A layout of frames and taxels at 10 Hz with another rule for taxels, axes and time.
fn layout_by(taxels: Value, axes: Value, time: Value) -> Layout {
    let json = json!({"dermatome_layout": 1, "axes": axes, "time": time, "channels": [{"name": "p", "unit": "count"}],
        "press": "raises", "zero": 0, "taxels": taxels});
    Layout::parse(Path::new("l.json"), &json.to_string()).unwrap()
}

/// Numbers in a first line are ids where a layout says so; else they are a frame, and no frame is lost.
#[test]
fn a_first_line_of_numbers_is_a_frame_or_ids() {
    let folder = tempfile::tempdir().unwrap();
    let read = |name: &str, text: &str, taxels: Value, axes: Value| {
        let layout = layout_by(taxels, axes, json!({"rate": 10}));
        read_text(folder.path(), name, text, Some(layout)).map(|found| (found.ids, found.values))
    };
    let flat = || json!(["frame", "taxel"]);
    let grid = |shape: &[usize]| json!({"shape": shape, "first_id": 1});
    let all = |rows: &[[f64; 4]]| rows.iter().map(|row| row.to_vec()).collect::<Vec<_>>();
    let ids = vec![1, 2, 3, 4];
    for (name, text, rows) in [
        ("a.csv", "2,1,1,0\n0,7,9,5\n", all(&[[2.0, 1.0, 1.0, 0.0], [0.0, 7.0, 9.0, 5.0]])),
        ("a.csv", "7,8,9,6,\n0,7,9,5,\n", all(&[[7.0, 8.0, 9.0, 6.0], [0.0, 7.0, 9.0, 5.0]])),
        ("a.txt", "7 8 9 6\n0 7 9 5\n", all(&[[7.0, 8.0, 9.0, 6.0], [0.0, 7.0, 9.0, 5.0]])),
        ("a.csv", "0.5,8,9,6\n0,7,9,5\n", all(&[[0.5, 8.0, 9.0, 6.0], [0.0, 7.0, 9.0, 5.0]])),
        // The ids that the layout states.
        ("a.csv", "1,2,3,4\n0,7,9,5\n", all(&[[0.0, 7.0, 9.0, 5.0]])),
    ] {
        assert_eq!(read(name, text, grid(&[4]), flat()).unwrap(), (ids.clone(), rows), "{text}");
    }
    let by_file = read("a.csv", "7,8,9,6\n0,7,9,5\n", json!({"ids": "file"}), flat()).unwrap();
    assert_eq!(
        by_file,
        (vec![6, 7, 8, 9], vec![vec![5.0, 0.0, 7.0, 9.0]]),
        "the layout says that they are ids"
    );
    // Cells of a line have the shape of the layout, or lines are the rows of a frame.
    let square = || json!(["frame", "row", "col"]);
    let text = "2,1,1,0\n0,7,9,5\n";
    assert_eq!(read("a.csv", text, grid(&[2, 2]), square()).unwrap().1.len(), 2);
    let (_, rows) = read("a.csv", text, grid(&[2, 4]), square()).unwrap();
    assert_eq!(rows, [[2.0, 1.0, 1.0, 0.0, 0.0, 7.0, 9.0, 5.0]]);
    for (name, text, shape, axes, expected) in [
        ("a.csv", "4,3,2,1\n0,7,9,5\n", &[4][..], flat(), "ids, column 1: found taxel 4; needed: taxel 1"),
        ("a.csv", "2,1\n0,7\n2,3\n", &[2, 2], square(), "found the end after 1 lines of a frame; needed: 2"),
        ("a.csv", "2,1,1,\n0,7,9,5\n", &[3], flat(), "line 2, column 4: found \"5\"; needed: nothing"),
        (
            "a.csv",
            "2,1,1\n0,7,9\n",
            &[3],
            json!(["taxel", "frame"]),
            "found \"frame\" as axis 2; needed: \"frame\" first",
        ),
        (
            "a.csv",
            "2,1,1\n",
            &[1, 3],
            json!(["episode", "frame", "row", "col"]),
            "only an array of numpy has one",
        ),
    ] {
        let error = read(name, text, grid(shape), axes).unwrap_err().to_string();
        assert!(error.contains(expected), "{text}: {error}");
    }
    // Without a layout a skin says what they are.
    let open = |text: &str| {
        fs::write(folder.path().join("b.csv"), text).unwrap();
        ReadingsReader::open(&folder.path().join("b.csv"), ReadOptions::default()).unwrap()
    };
    for (text, frames, ids) in [
        ("7,9\n1,2\n", 1, Some(vec![7, 9])),
        ("9,8\n1,2\n", 2, None),
        ("0.5,9\n1,2\n", 2, None),
        ("9,9\n1,2\n", 2, None),
    ] {
        let mut reader = open(text);
        reader.settle_first_line([9, 7].map(dermatome::skin::TaxelId));
        let (mut values, mut time, mut count) = (Vec::new(), 0.0, 0);
        while reader.read(&mut values, &mut time).unwrap() {
            count += 1;
        }
        let found = reader.ids.as_ref().map(|ids| ids.iter().map(|id| id.0).collect::<Vec<_>>());
        assert_eq!((count, reader.frames, found), (frames, Some(frames), ids), "{text}");
    }
    let error = open("7,9\n1,2\n").read(&mut Vec::new(), &mut 0.0).unwrap_err().to_string();
    assert!(error.contains("line 1: found numbers alone, which may be ids"), "{error}");
}

/// A table of another program: columns are taxels by their names, and others are not read.
#[test]
fn columns_are_found_by_their_names() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let read = |text: &str, taxels: Value, axes: Value, time: Value| {
        let json = layout_by(taxels, axes, time).text().to_owned();
        let layout = Layout::parse(&at.join("l.json"), &json).unwrap();
        read_text(at, "a.csv", text, Some(layout))
    };
    let (flat, rate) = (|| json!(["frame", "taxel"]), || json!({"rate": 10}));
    let text = "stamp,temp,ele2,ele10,ele1\n5.5,100,2,3,1\n5.6,101,20,30,10\n";
    let times = json!({"stream": "stamp", "unit": "s"});
    let by_name = read(text, json!({"columns": "ele{id}"}), flat(), times.clone()).unwrap();
    assert_eq!((by_name.ids.as_slice(), &by_name.times), (&[1, 2, 10][..], &vec![5.5, 5.6]));
    assert_eq!(by_name.values, [[1.0, 2.0, 3.0], [10.0, 20.0, 30.0]]);
    assert_eq!(by_name.states("columns not read", StatementSource::File), Some("temp"));
    fs::write(at.join("c.csv"), "column,taxel_id\nele10,7\nele1,\nele2,9\n").unwrap();
    let by_table = read(text, json!("c.csv"), flat(), times).unwrap();
    assert_eq!((by_table.ids.as_slice(), &by_table.values[0]), (&[7, 9][..], &vec![3.0, 2.0]));
    assert_eq!(by_table.states("columns not read", StatementSource::File), Some("temp, ele1"));
    let ms = json!({"stream": "timestamp", "unit": "ms"});
    assert_eq!(
        read("timestamp,a1[count]\n1500,1\n1600,1\n", json!({"columns": "a{id}"}), flat(), ms).unwrap().times,
        [1.5, 1.6]
    );
    // Several numbers of a taxel.
    let json = json!({"dermatome_layout": 1, "axes": ["frame", "taxel", "component"], "time": {"rate": 10},
        "channels": [{"name": "x", "unit": "N", "component": 0, "signed": true}, {"name": "z", "unit": "N", "component": 1}],
        "press": "raises", "zero": 0, "taxels": {"columns": ["p{id}_x", "p{id}_z"]}});
    let layout = Layout::parse(Path::new("l.json"), &json.to_string()).unwrap();
    let text = "p0_x,p0_z,p1_x,p1_z\n1,2,3,4\n";
    assert_eq!(read_text(at, "a.csv", text, Some(layout)).unwrap().values, [[1.0, 3.0, 2.0, 4.0]]);
    for (text, taxels, time, expected) in [
        (
            "ele1,ele01\n1,2\n",
            json!({"columns": "ele{id}"}),
            rate(),
            "column 2 (ele01): found taxel 1 again, which ele1 has",
        ),
        (
            "ele1,temp\n1,2\n",
            json!({"columns": "S{id}"}),
            rate(),
            "found columns ele1, temp; needed: columns called S{id}",
        ),
        (
            "x1,x2,y1\n1,2,3\n",
            json!({"columns": ["x{id}", "y{id}"]}),
            rate(),
            "no column of component 1 of taxel 2",
        ),
        (
            "ele1,temp\n1,2\n",
            json!({"columns": "ele{id}"}),
            json!({"stream": "tdc", "unit": "s"}),
            "needed: a column tdc",
        ),
        (
            "ele1,b\n1,2\n",
            json!("c.csv"),
            rate(),
            "c.csv: line 2, column `column`: found \"ele10\"; needed: a column of",
        ),
        (
            "time,ele1\n0,2\n0.1,2\n0.2,2\n",
            json!({"columns": "ele{id}"}),
            json!({"unit": "ms"}),
            "frames a second",
        ),
        (
            "time[s],ele1\n0,2\n1,2\n",
            json!({"columns": "ele{id}"}),
            json!({"unit": "ms"}),
            "found times in s; needed: ms",
        ),
        (
            "time[s],ele1\n0,2\n0.02,2\n",
            json!({"columns": "ele{id}"}),
            rate(),
            "frame 1: found 0.020000 s after the first",
        ),
        (
            "ele1[kPa],ele2[N]\n1,2\n",
            json!({"columns": "ele{id}"}),
            rate(),
            "needed: \"kPa\", the unit given first",
        ),
        ("ele1[kPa]\n1\n", json!({"columns": "ele{id}"}), rate(), "found the unit kPa of p; needed: count"),
    ] {
        let error = read(text, taxels, flat(), time).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(expected), "{text}: {error}");
    }
    // A draft has the pattern of the header.
    fs::write(at.join("a.csv"), "timestamp,temp,ele1,ele2\n1,2,3,4\n").unwrap();
    let draft: Value =
        serde_json::from_str(&ReadingsReader::draft_layout(&at.join("a.csv"), None).unwrap()).unwrap();
    assert_eq!(
        (&draft["taxels"], &draft["time"], &draft["axes"]),
        (
            &json!({"columns": "ele{id}"}),
            &json!({"stream": "timestamp", "unit": null}),
            &json!(["frame", "taxel"])
        )
    );
}

/// Ids, times and devices that a file states are compared with a layout, or noted.
#[test]
fn what_is_stated_twice_is_compared() {
    let folder = tempfile::tempdir().unwrap();
    let read = |name: &str, text: &str, layout: Option<Layout>| {
        let found = read_text(folder.path(), name, text, layout);
        found.map(|found| {
            found.statements.iter().map(|s| format!("{}: {}", s.what, s.value)).collect::<Vec<_>>()
        })
    };
    let by = |time| Some(layout_by(json!({"shape": [2], "first_id": 1}), json!(["frame", "taxel"]), time));
    let long = |rows: &str| format!("time,device,taxel_id,value,quality\n{rows}");
    for (name, text, layout, expected) in [
        (
            "a.csv",
            "time,2,1\n0,1,1\n0.1,1,1\n".to_owned(),
            by(json!({"unit": "s"})),
            "ids, column 1: found taxel 2; needed: taxel 1",
        ),
        ("a.csv", "time,1,2\n0,1,1\n0.02,1,1\n".into(), by(json!({"rate": 99})), "frame 1: found 0.020000 s"),
        ("a.csv", "time[ms],1,2\n0,1,1\n".into(), by(json!({"unit": "s"})), "found times in ms; needed: s"),
        (
            "a.csv",
            long("0,A,1,5,1\n0.1,B,1,6,1\n"),
            None,
            "line 3, column 2: found taxel 1 of \"B\" after \"A\"",
        ),
        (
            "a.log",
            "1000 0.0 1 2\n1002 0.1 1 2\n1001 0.2 1 2\n".into(),
            None,
            "line 3, column 1: found packet 1001 after 1002",
        ),
    ] {
        let error = read(name, &text, layout).unwrap_err().to_string();
        assert!(error.contains(expected), "{text}: {error}");
    }
    for (name, text, layout, expected) in [
        (
            "a.csv",
            "time,1,2\n0,1,1\n0.1,1,1\n".to_owned(),
            by(json!({"rate": 10})),
            "time: 10 frames a second",
        ),
        ("a.csv", "time[ms],1,2\n0,1,1\n100,1,1\n".into(), by(json!({"unit": "ms"})), "time: times in ms"),
        ("a.csv", long("0,A,1,5,1\n0,B,2,6,1\n"), None, "columns not read: device, quality"),
        ("a.log", "1000 0.0 1 2\n1003 0.1 1 2\n".into(), None, "lost packets: 2 packets"),
    ] {
        let stated = read(name, &text, layout).unwrap();
        assert!(stated.iter().any(|s| s.contains(expected)), "{text}: {stated:?}");
    }
}

#[test]
fn files_that_stand_for_others_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let wide: Vec<u8> = tekscan().encode_utf16().flat_map(u16::to_le_bytes).collect();
    let mut marked = b"\xff\xfe".to_vec();
    marked.extend_from_slice(&wide);
    let array = format!("[{}]", xela().trim().replace('\n', ","));
    let pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12\n";
    for (name, content, expected) in [
        ("a.asf", wide, "file: found text in UTF-16"),
        ("a.asf", marked, "file: found text in UTF-16"),
        ("a.jsonl", array.into_bytes(), "file: found messages in one JSON array"),
        ("a.h5", pointer.into(), "file: found a pointer of Git LFS"),
    ] {
        let error = read_text(folder.path(), name, content, None).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(expected), "{name}: {error}");
    }
    let two = tekscan() + "\nDATA_TYPE MOVIE\n";
    let error = read_text(folder.path(), "a.asf", two, None).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("found \"DATA_TYPE MOVIE\"; needed: the end of the file behind @@"), "{error}");
}

/// Damaged bytes of every kind: an answer or an error, and never more than the file can hold.
#[test]
fn random_damage_never_breaks_a_reader() {
    let folder = tempfile::tempdir().unwrap();
    let pad = layout_of(&[2, 3], "raw", json!({"unit": "s"}));
    let kinds: [(&str, Vec<u8>, Option<Layout>); 7] = [
        ("a.asf", tekscan().into_bytes(), Some(pad)),
        ("b.csv", xsensor().into_bytes(), None),
        ("c.lst", emed(), None),
        ("d.asc", pedar().into_bytes(), None),
        ("e.asc", pliance().into_bytes(), None),
        ("f.csv", stappone().into_bytes(), None),
        ("g.jsonl", xela().into_bytes(), Some(xela_layout())),
    ];
    let mut state = 7_u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        usize::try_from(state >> 33).unwrap() % below.max(1)
    };
    let words: [&[u8]; 9] =
        [b"99999999999999999999", b"-1", b"nan", b"\xff\xfe\x00", b",", b"\n", b"1e308", b"", b"\x0c"];
    for (name, bytes, layout) in kinds {
        let (mut answers, mut errors) = (0, 0);
        for _ in 0..150 {
            let mut damaged = bytes.clone();
            for _ in 0..=random(3) {
                let (at, length) = (random(damaged.len()), random(6));
                let end = (at + length).min(damaged.len());
                match random(4) {
                    0 => damaged.truncate(at),
                    1 => drop(damaged.splice(at..end, words[random(words.len())].iter().copied())),
                    2 => {
                        let part = damaged[at..].to_vec();
                        damaged.extend(part);
                    }
                    _ if at < damaged.len() => damaged[at] = u8::try_from(random(256)).unwrap(),
                    _ => {}
                }
            }
            let stream = (name == "b.csv").then_some("left");
            let path = folder.path().join(name);
            fs::write(&path, &damaged).unwrap();
            match read_with(&path, layout.clone(), stream) {
                Ok(found) => {
                    assert!(found.values.len() <= damaged.len(), "{name}");
                    answers += 1;
                }
                Err(_) => errors += 1,
            }
            let _ = read_draft(&path).map(|draft| draft.sheets.len());
        }
        assert!(errors > 5, "{name}: {answers} answers, {errors} errors");
    }
}
