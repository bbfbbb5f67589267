//! What must not matter to a recording, tried on every command that reads one: the prefix of a unit, the order of
//! columns, rows and files, a further channel or patch, the origin and the unit of time, a stream or a container in place of a file.
//! The skin and the recording are uneven on purpose: two links, two patches that share ids, 41 x 9 and 5 x 24 taxels, one
//! of them absent, names with spaces, three channels, a pause and times that restart.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;

use dermatome::io::{ReadingsColumns, ReadingsWriter, read_map};
use dermatome::signal::{Channel, Frame};
use dermatome::skin::PatchId;

use crate::common::dermatome;

/// Taxels along u and v of the two patches.
const SHEETS: [(usize, usize); 2] = [(41, 9), (5, 24)];
const SPACING: f64 = 0.005;
/// Frames after which times pause for 2.5 s, and after which they begin again at 0.
const PARTS: [usize; 3] = [300, 600, 800];
/// The taxel of the first patch that is absent, counted from 0.
const ABSENT: usize = 200;

/// Position in m and normal of each taxel: the first patch is bent round a cylinder of 80 mm, the second is flat.
fn taxels(patch: usize) -> Vec<[f64; 6]> {
    let (width, height) = SHEETS[patch];
    let place = |k: usize| {
        let (i, j) = ((k % width) as f64, (k / width) as f64);
        let (x, y) = (SPACING * (i + 0.5 * (j % 2.0)), SPACING * j * 0.75_f64.sqrt());
        let angle = y / 0.08;
        match patch {
            0 => [x, 0.08 * angle.sin(), 0.08 * (angle.cos() - 1.0), 0.0, angle.sin(), angle.cos()],
            _ => [x + 0.3, y, 0.0, 0.0, 0.0, 1.0],
        }
    };
    (0..width * height).map(place).collect()
}

/// Writes the patches that are named as `NAME.csv` and builds their map in the folder `NAME`.
fn build(folder: &Path, name: &str, patches: &[usize]) {
    let mut rows = String::from("id,x,y,z,nx,ny,nz,patch,on_link,present\n");
    let mut triangles = String::from("row0,row1,row2\n");
    let mut first = 0;
    for &patch in patches {
        let (width, height) = SHEETS[patch];
        let names = ["upper arm,arm 1", "left palm,palm 2"][patch];
        for (k, at) in taxels(patch).into_iter().enumerate() {
            let cells: Vec<_> = at.iter().map(f64::to_string).collect();
            let present = u8::from(patch == 1 || k != ABSENT);
            writeln!(rows, "{},{},{names},{present}", k + 1, cells.join(",")).unwrap();
        }
        for (i, j) in (0..height - 1).flat_map(|j| (0..width - 1).map(move |i| (i, j))) {
            let a = first + j * width + i;
            let (b, c, d) = (a + 1, a + width, a + width + 1);
            let two = if j % 2 == 0 { [[a, b, c], [b, d, c]] } else { [[a, b, d], [a, d, c]] };
            two.iter().for_each(|t| writeln!(triangles, "{},{},{}", t[0], t[1], t[2]).unwrap());
        }
        first += width * height;
    }
    fs::write(folder.join(format!("{name}.csv")), rows).unwrap();
    fs::write(folder.join(format!("{name}.triangles.csv")), triangles).unwrap();
    dermatome(folder, &format!("build {name}.csv -o {name}")).assert().success();
}

/// Frames of channels, each with a name, a unit and a reading for each taxel of the first patch.
#[derive(Clone)]
struct Recording {
    /// Name of the column of times, and the times.
    times: (&'static str, Vec<String>),
    channels: Vec<(&'static str, &'static str, Vec<Vec<f64>>)>,
}

impl Recording {
    /// Five presses on a skin with noise; temperatures; a force along the skin.
    fn new() -> Self {
        let mut random = Pcg64Mcg::new(7);
        let mut noise = |sigma: f64| {
            let uniform = |word: u64| (word >> 11) as f64 / (1_u64 << 53) as f64;
            // The sum of four uniform numbers is nearly normal.
            sigma * 3.0_f64.sqrt() * ((0..4).map(|_| uniform(random.next_u64())).sum::<f64>() - 2.0)
        };
        let places = taxels(0);
        // Of each: first frame, frames, taxel at its centre, peak.
        let presses: [(usize, usize, usize, f64); 5] = [
            (60, 50, 235, 20.0),
            (150, 50, 90, 12.0),
            (360, 60, 266, 25.0),
            (480, 40, 200, 15.0),
            (640, 60, 135, 18.0),
        ];
        let pressed = |frame: usize, taxel: usize| -> f64 {
            let of_one = |&(first, frames, centre, peak): &(usize, usize, usize, f64)| {
                let Some(k) = frame.checked_sub(first).filter(|&k| k < frames) else { return 0.0 };
                let squared: f64 =
                    (0..3).map(|axis| (places[taxel][axis] - places[centre][axis]).powi(2)).sum();
                let phase = std::f64::consts::PI * (k as f64 + 0.5) / frames as f64;
                peak * phase.sin().sqrt() * (-squared / 0.012_f64.powi(2)).exp()
            };
            presses.iter().map(of_one).sum()
        };
        let count = places.len();
        let frames = |of: &mut dyn FnMut(usize, usize) -> f64| -> Vec<Vec<f64>> {
            (0..PARTS[2]).map(|frame| (0..count).map(|taxel| of(frame, taxel)).collect()).collect()
        };
        let rounded = |x: f64| (x * 1e4).round() / 1e4;
        let pressures = frames(&mut |frame, taxel| rounded(pressed(frame, taxel) + noise(0.05)));
        let temperatures =
            frames(&mut |frame, taxel| rounded(30.0 + 0.01 * taxel as f64 + 0.001 * frame as f64));
        let forces = frames(&mut |frame, taxel| rounded(0.1 * pressed(frame, taxel) + 0.01));
        let seconds = |frame: usize| match frame {
            0..300 => 0.02 * frame as f64,
            300..600 => 2.5 + 0.02 * frame as f64,
            _ => 0.02 * (frame - PARTS[1]) as f64,
        };
        Self {
            times: ("time", (0..PARTS[2]).map(|frame| format!("{:.3}", seconds(frame))).collect()),
            channels: vec![
                ("pressure", "kPa", pressures),
                ("temperature", "degC", temperatures),
                ("force.x", "N", forces),
            ],
        }
    }

    fn scaled(&self, channel: usize, unit: &'static str, factor: f64) -> Self {
        let mut scaled = self.clone();
        scaled.channels[channel].1 = unit;
        scaled.channels[channel].2.iter_mut().flatten().for_each(|x| *x = (*x * factor * 1e7).round() / 1e7);
        scaled
    }

    fn with_times(&self, column: &'static str, text: impl Fn(f64) -> String) -> Self {
        let times = self.times.1.iter().map(|time| text(time.parse().unwrap())).collect();
        Self { times: (column, times), ..self.clone() }
    }

    fn channel(&self, k: usize) -> Self {
        Self { channels: vec![self.channels[k].clone()], ..self.clone() }
    }

    fn part(&self, frames: std::ops::Range<usize>) -> Self {
        let mut part = self.clone();
        part.times.1 = part.times.1[frames.clone()].to_vec();
        part.channels.iter_mut().for_each(|channel| channel.2 = channel.2[frames.clone()].to_vec());
        part
    }

    /// A table; its columns follow `order`, numbers of taxels.
    fn csv(&self, order: &[usize]) -> String {
        let mut text = String::from(self.times.0);
        for (taxel, (name, unit, _)) in order.iter().flat_map(|t| self.channels.iter().map(move |c| (t, c))) {
            write!(text, ",{}.{name}[{unit}]", taxel + 1).unwrap();
        }
        for (frame, time) in self.times.1.iter().enumerate() {
            write!(text, "\n{time}").unwrap();
            for (&taxel, (.., frames)) in order.iter().flat_map(|t| self.channels.iter().map(move |c| (t, c)))
            {
                if taxel == ABSENT {
                    text.push(',')
                } else {
                    write!(text, ",{}", frames[frame][taxel]).unwrap()
                }
            }
        }
        text + "\n"
    }
}

/// How results may differ: factors of readings and of forces, and what is added to times.
#[derive(Clone, Copy)]
struct Change {
    readings: f64,
    forces: f64,
    seconds: f64,
    /// By how much numbers may differ.
    error: f64,
}

const SAME: Change = Change { readings: 1.0, forces: 1.0, seconds: 0.0, error: 2e-6 };

/// What a column of a table or a key of an event is.
fn changed(column: &str, number: f64, change: &Change) -> f64 {
    match column {
        "peak" | "mean" | "sum" | "sum_peak" | "pressure_time_integral" => number * change.readings,
        "force" | "force_peak" | "force_mean" | "impulse" => number * change.forces,
        "time" | "begin" | "peak_time" | "force_peak_time" | "first_contact" | "last_contact" => {
            number + change.seconds
        }
        _ => number,
    }
}

/// The cells of the rows of a table or of lines of JSON, by column.
type Rows = Vec<Vec<(String, String)>>;

fn table(path: &Path) -> Rows {
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_path(path).unwrap();
    let names: Vec<String> = reader.headers().unwrap().iter().map(Into::into).collect();
    let row = |row: csv::StringRecord| names.iter().cloned().zip(row.iter().map(Into::into)).collect();
    reader.records().map(|record| row(record.unwrap())).collect()
}

fn lines(path: &Path) -> Rows {
    let text = fs::read_to_string(path).unwrap();
    let row = |line: &str| {
        let object: serde_json::Map<String, serde_json::Value> = serde_json::from_str(line).unwrap();
        let of_key = |(key, value): (String, serde_json::Value)| match value {
            serde_json::Value::Object(inner) => {
                inner.into_iter().map(|(k, v)| (format!("{key}.{k}"), v)).collect()
            }
            other => vec![(key, other)],
        };
        object.into_iter().flat_map(of_key).map(|(key, value)| (key, value.to_string())).collect()
    };
    text.lines().map(row).collect()
}

/// Fails where `found` is not what `base` becomes by a change; columns `apart` from numbers may differ.
fn compare(law: &str, door: &str, base: &Rows, found: &Rows, change: &Change, apart: &[&str]) {
    assert_eq!(base.len(), found.len(), "{law}, {door}: rows");
    for (k, (old, new)) in base.iter().zip(found).enumerate() {
        let names = |row: &[(String, String)]| row.iter().map(|cell| cell.0.clone()).collect::<Vec<_>>();
        assert_eq!(names(old), names(new), "{law}, {door}, row {k}");
        for ((column, old), (_, new)) in
            old.iter().zip(new).filter(|((column, _), _)| !apart.contains(&&**column))
        {
            match (old.parse::<f64>(), new.parse::<f64>()) {
                (Ok(old), Ok(new)) => {
                    let needed = changed(column, old, change);
                    // Directions of fields that are nearly round, and lengths of paths, follow the rounding of readings.
                    let error = (new - needed).abs();
                    assert!(
                        error <= change.error * (1.0 + needed.abs()),
                        "{law}, {door}, row {k}, {column}: found {new}, needed {needed}"
                    );
                }
                _ => assert_eq!(old, new, "{law}, {door}, row {k}, {column}"),
            }
        }
    }
}

/// What all commands make of a recording: tables and events, by the name of the command.
fn results(
    folder: &Path,
    map: &str,
    readings: &str,
    input: Option<&str>,
    options: &str,
) -> Vec<(&'static str, Rows)> {
    let run = |words: String| {
        let mut command = dermatome(folder, &words);
        if let Some(text) = input {
            command.write_stdin(text);
        }
        command.assert().success();
    };
    let map = format!("{map}/map.glb");
    run(format!("summary {map} {readings} {options} -o sums.csv --over-time loads.csv"));
    run(format!(
        "render {map} {readings} {options} -o values.npz --values-only --contacts regions.csv --events events.jsonl"
    ));
    vec![
        ("summary", table(&folder.join("sums.csv"))),
        ("loads", table(&folder.join("loads.csv"))),
        ("contacts", table(&folder.join("regions.csv"))),
        ("events", lines(&folder.join("events.jsonl"))),
    ]
}

#[test]
fn what_must_not_matter_to_a_recording_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    build(folder, "both", &[0, 1]);
    let recording = Recording::new();
    let order: Vec<usize> = (0..SHEETS[0].0 * SHEETS[0].1).collect();
    let backwards: Vec<usize> = order.iter().rev().copied().collect();
    let write = |name: &str, text: &str| fs::write(folder.join(name), text).unwrap();
    write("base.csv", &recording.csv(&order));
    let base = results(folder, "both", "base.csv", None, "");
    assert!(base[3].1.len() > 10, "{} events", base[3].1.len());

    let times = Change { readings: 3.0, forces: 3.0, ..SAME };
    let alterations: Vec<(&str, String, Change)> = vec![
        ("nothing", recording.csv(&order), SAME),
        ("Pa for kPa", recording.scaled(0, "Pa", 1000.0).csv(&order), Change { readings: 1000.0, ..SAME }),
        ("N/cm^2 for kPa", recording.scaled(0, "N/cm^2", 0.1).csv(&order), Change { readings: 0.1, ..SAME }),
        ("mN for N in another channel", recording.scaled(2, "mN", 1000.0).csv(&order), SAME),
        ("order of columns", recording.csv(&backwards), SAME),
        ("one channel", recording.channel(0).csv(&order), SAME),
        ("readings times 3", recording.scaled(0, "kPa", 3.0).csv(&order), times),
        (
            "times shifted",
            recording.with_times("time", |t| format!("{:.3}", t + 1000.0)).csv(&order),
            Change { seconds: 1000.0, ..SAME },
        ),
        ("times in ms", recording.with_times("time[ms]", |t| format!("{:.0}", 1000.0 * t)).csv(&order), SAME),
        ("times in capitals", recording.with_times("TIME", |t| format!("{t:.3}")).csv(&order), SAME),
        ("dates", recording.with_times("time", |t| format!("1970-01-01T00:00:{t:06.3}Z")).csv(&order), SAME),
    ];
    for (law, text, change) in &alterations {
        write("altered.csv", text);
        let of_file = results(folder, "both", "altered.csv", None, "");
        for ((door, base), (_, found)) in base.iter().zip(&of_file) {
            compare(law, door, base, found, change, &["unit"]);
        }
        // A stream in place of a file.
        let of_stream = results(folder, "both", "-", Some(text), "");
        for ((door, of_file), (_, found)) in of_file.iter().zip(&of_stream) {
            compare(&format!("{law}, as a stream"), door, of_file, found, &SAME, &[]);
        }
    }
}

/// The rows of a patch, and of its link and contacts, are those of a map that has this patch alone.
#[test]
fn a_further_patch_changes_no_row_of_the_first() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    build(folder, "both", &[0, 1]);
    build(folder, "one", &[0]);
    let order: Vec<usize> = (0..SHEETS[0].0 * SHEETS[0].1).collect();
    fs::write(folder.join("base.csv"), Recording::new().csv(&order)).unwrap();
    let options = "--threshold 0.4";
    let [one, both] = ["one", "both"].map(|map| results(folder, map, "base.csv", None, options));
    let of_first = |rows: &Rows| -> Rows {
        let is_of_it = |row: &&Vec<(String, String)>| {
            row.iter().any(|(column, cell)| {
                matches!(&**column, "patch" | "link" | "name")
                    && matches!(cell.trim_matches('"'), "upper arm" | "arm 1")
            })
        };
        rows.iter().filter(is_of_it).cloned().collect()
    };
    for ((door, one), (_, both)) in one.iter().zip(&both).filter(|((door, _), _)| *door != "events") {
        // Contacts are numbered through all patches.
        compare(
            "a further patch",
            door,
            &of_first(one),
            &of_first(both),
            &SAME,
            &["track", "name", "contact"],
        );
    }
}

/// What every command that takes readings makes of a file, byte by byte, does not depend on the form of the file: the order
/// of its columns, a row for each reading in any order, a container.
#[test]
fn every_command_gives_the_same_bytes_for_every_form_of_a_recording() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    build(folder, "one", &[0]);
    let recording = Recording::new().channel(0).part(0..PARTS[0]);
    let order: Vec<usize> = (0..SHEETS[0].0 * SHEETS[0].1).collect();
    let backwards: Vec<usize> = order.iter().rev().copied().collect();
    let frames = &recording.channels[0].2;
    let mut long = String::from("taxel_id,time,value[kPa]\n");
    for (k, (time, frame)) in recording.times.1.iter().zip(frames).enumerate() {
        // 369 and 83 have no common divisor: each taxel once, in an order that differs from frame to frame.
        for taxel in order.iter().map(|j| (j * 83 + k) % order.len()).filter(|taxel| *taxel != ABSENT) {
            writeln!(long, "{},{time},{}", taxel + 1, frame[taxel]).unwrap();
        }
    }
    let texts = [("table", recording.csv(&order)), ("backwards", recording.csv(&backwards)), ("long", long)];
    for (form, text) in &texts {
        fs::create_dir(folder.join(form)).unwrap();
        fs::write(folder.join(format!("{form}/pressure.csv")), text).unwrap();
    }
    let map = read_map(&folder.join("one/map.glb")).unwrap();
    let channel = Channel::new("pressure", "kPa").unwrap();
    fs::create_dir(folder.join("arrays")).unwrap();
    let path = folder.join("arrays/pressure.npz");
    let mut writer = ReadingsWriter::create(
        &path,
        map.patches.iter().map(|patch| &patch.taxels),
        ReadingsColumns { channels: std::slice::from_ref(&channel), has_times: true },
    )
    .unwrap();
    let mut frame = Frame::new(&map, 1);
    for (time, readings) in recording.times.1.iter().zip(frames) {
        frame.time = time.parse().unwrap();
        frame.values[PatchId::new(0)][0].as_mut_slice().copy_from_slice(readings);
        writer.write(&frame).unwrap();
    }
    writer.finish().unwrap();
    let outputs = |form: &str, file: &str| -> Vec<(&'static str, Vec<u8>)> {
        let commands = [
            ("sums.csv", format!("summary one/map.glb {form}/{file} -o sums.csv")),
            ("steps.csv", format!("summary one/map.glb {form}/{file} --by step -o steps.csv")),
            (
                "values.npz",
                format!("render one/map.glb {form}/{file} -o values.npz --values-only --events events.jsonl"),
            ),
            ("report.html", format!("report one/map.glb {form}/{file} -o report.html")),
            ("frame.svg", format!("plot one/map.glb --readings {form}/{file} --frame 80 -o frame.svg")),
            ("states.csv", format!("check one/map.glb --recording {form}/{file} -o states.csv")),
        ];
        let made = commands.into_iter().map(|(output, words)| {
            let _ = fs::remove_file(folder.join(output));
            // `check` has exit code 1 where it finds faults.
            dermatome(folder, &words).assert().code(vec![0, 1]);
            let bytes = fs::read(folder.join(output));
            (output, bytes.unwrap_or_else(|error| panic!("{words}: {error}")))
        });
        made.collect()
    };
    let base = outputs("table", "pressure.csv");
    for (form, file) in [("backwards", "pressure.csv"), ("long", "pressure.csv"), ("arrays", "pressure.npz")]
    {
        for ((output, base), (_, found)) in base.iter().zip(outputs(form, file)) {
            assert!(*base == found, "{output} of {form}/{file} differs");
        }
    }
}

/// What recordings say of a skin does not depend on their order, nor on whether one is cut where it pauses.
#[test]
fn recordings_of_one_skin_may_come_in_any_order() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    build(folder, "one", &[0]);
    let order: Vec<usize> = (0..SHEETS[0].0 * SHEETS[0].1).collect();
    let recording = Recording::new().channel(0);
    for (k, frames) in [0..PARTS[0], PARTS[0]..PARTS[1], PARTS[1]..PARTS[2]].into_iter().enumerate() {
        fs::write(folder.join(format!("part{k}.csv")), recording.part(frames).csv(&order)).unwrap();
    }
    let states = |files: &str| {
        dermatome(folder, &format!("check one/map.glb --recording {files} -o states.csv"))
            .assert()
            .code(vec![0, 1]);
        table(&folder.join("states.csv"))
    };
    let base = states("part0.csv part1.csv part2.csv");
    assert_eq!(base.len(), order.len() - 1, "a row for each taxel that is present");
    for files in ["part2.csv part0.csv part1.csv", "part1.csv part2.csv part0.csv"] {
        compare(files, "states", &base, &states(files), &SAME, &[]);
    }
}

/// Sums over a recording are the sums over its parts, where it pauses and where its times begin again.
#[test]
fn sums_of_a_recording_are_those_of_its_parts() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    build(folder, "one", &[0]);
    let order: Vec<usize> = (0..SHEETS[0].0 * SHEETS[0].1).collect();
    let sums = |frames: std::ops::Range<usize>| -> [f64; 2] {
        fs::write(folder.join("part.csv"), Recording::new().part(frames).csv(&order)).unwrap();
        dermatome(folder, "summary one/map.glb part.csv --threshold 0.4 -o sums.csv").assert().success();
        let rows = table(&folder.join("sums.csv"));
        let cell =
            |name: &str| rows[0].iter().find(|(column, _)| column == name).unwrap().1.parse::<f64>().unwrap();
        [cell("impulse"), cell("contact_time")]
    };
    let whole = sums(0..PARTS[2]);
    let parts = [sums(0..PARTS[0]), sums(PARTS[0]..PARTS[1]), sums(PARTS[1]..PARTS[2])];
    for (k, name) in ["impulse", "contact_time"].iter().enumerate() {
        let sum: f64 = parts.iter().map(|part| part[k]).sum();
        assert!((whole[k] - sum).abs() < 1e-9 * sum, "{name}: {} of the whole, {sum} of its parts", whole[k]);
    }
}
