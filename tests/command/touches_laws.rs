//! What must not matter to the log of a robot that touches its skin, tried on `touches`, `calibrate --cad` and `check`: the order of rows
//! and columns, rows of other links, units of time, names, numbers and ids, where the robot stands, a further patch of the drawing,
//! whether readings are in the log or in a file of their own, the order of contacts.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use dermatome::io::read_truth;
use glam::{DQuat, DVec3};

use crate::common::{dermatome, json};
use crate::touches::{cut_touches, drawing_of_modules};

/// A table as cells.
#[derive(Clone)]
struct Cells {
    names: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Cells {
    fn read(path: &Path) -> Self {
        let text = fs::read_to_string(path).unwrap();
        let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
        Self { names: lines.next().unwrap(), rows: lines.collect() }
    }

    fn write(&self, path: &Path, between: &str, end: &str) {
        let lines = std::iter::once(&self.names).chain(&self.rows);
        let text: String = lines.map(|cells| cells.join(between) + end).collect();
        fs::write(path, text).unwrap();
    }

    fn column(&self, name: &str) -> usize {
        self.names.iter().position(|other| other == name).unwrap()
    }

    /// Changes the cells of a column.
    fn change(&mut self, name: &str, new: impl Fn(&str) -> String) {
        let column = self.column(name);
        self.rows.iter_mut().for_each(|row| row[column] = new(&row[column]));
    }

    fn numbers<const N: usize>(&self, row: usize, names: [&str; N]) -> [f64; N] {
        names.map(|name| self.rows[row][self.column(name)].parse().unwrap())
    }

    fn set<const N: usize>(&mut self, row: usize, names: [&str; N], numbers: [f64; N]) {
        for (name, number) in names.into_iter().zip(numbers) {
            let column = self.column(name);
            self.rows[row][column] = number.to_string();
        }
    }
}

/// What a law changes: the log, readings that are not in it, the drawing, the contacts, and words of `touches`.
#[derive(Clone)]
struct Trial {
    log: Cells,
    readings: Option<Cells>,
    drawing: Cells,
    contacts: fn(&mut Cells),
    words: &'static str,
    between: &'static str,
    end: &'static str,
}

const POSITION: [&str; 3] = ["x", "y", "z"];
const ROTATION: [&str; 4] = ["qx", "qy", "qz", "qw"];
const SPHERE: [&str; 3] = ["px", "py", "pz"];

/// Readings `id:value` with other ids or values.
fn felt(cell: &str, id: impl Fn(u32) -> u32, factor: f64) -> String {
    let one = |felt: &str| {
        let (own, value) = felt.split_once(':').unwrap();
        format!("{}:{}", id(own.parse().unwrap()), factor * value.parse::<f64>().unwrap())
    };
    cell.split(';').map(one).collect::<Vec<_>>().join(";")
}

type Law = (&'static str, fn(&mut Trial));

const LAWS: [Law; 19] = [
    ("nothing", |_| {}),
    ("order of touches", |trial| {
        let touch = trial.log.column("touch");
        trial.log.rows.sort_by_key(|row| (row[touch].parse::<u64>().unwrap() * 37 % 101, row[touch].clone()));
    }),
    ("order of columns", |trial| {
        trial.log.names.reverse();
        trial.log.rows.iter_mut().for_each(|row| row.reverse());
    }),
    ("rows of another link", |trial| {
        let link = trial.log.column("link");
        let with_other = |(k, row): (usize, Vec<String>)| {
            let mut other = row.clone();
            other[link] = "hand".into();
            [Some(row), (k % 7 == 3).then_some(other)]
        };
        let rows = std::mem::take(&mut trial.log.rows);
        trial.log.rows = rows.into_iter().enumerate().flat_map(with_other).flatten().collect();
        trial.words = " --link end_effector";
    }),
    ("unit of time", |trial| {
        let time = trial.log.column("time");
        trial.log.change("time", |cell| (1e3 * cell.parse::<f64>().unwrap()).to_string());
        trial.log.names[time] = "time[ms]".into();
    }),
    ("origin of time", |trial| {
        trial.log.change("time", |cell| (1.7e9 + cell.parse::<f64>().unwrap()).to_string())
    }),
    ("name of the link", |trial| trial.log.change("link", |_| "Left arm".into())),
    ("names of modules and patches", |trial| {
        trial.drawing.change("module", |cell| format!("M {cell}"));
        trial.drawing.change("patch", |_| "a patch".into());
    }),
    ("numbers of touches", |trial| {
        trial.log.change("touch", |cell| (7 * cell.parse::<u64>().unwrap() + 3).to_string())
    }),
    ("ids of taxels", |trial| {
        trial.log.change("taxels", |cell| felt(cell, |id| id + 1000, 1.0));
        trial.drawing.change("taxel_id", |cell| (cell.parse::<u32>().unwrap() + 1000).to_string());
    }),
    ("unit of readings", |trial| trial.log.change("taxels", |cell| felt(cell, |id| id, 1024.0))),
    ("sign of quaternions", |trial| {
        for row in (0..trial.log.rows.len()).step_by(2) {
            let q = trial.log.numbers(row, ROTATION);
            trial.log.set(row, ROTATION, q.map(|x| -x));
        }
    }),
    ("place of the robot", |trial| {
        let (turn, move_by) =
            (DQuat::from_scaled_axis(DVec3::new(0.3, -1.2, 0.7)), DVec3::new(1.5, -0.5, 0.25));
        for row in 0..trial.log.rows.len() {
            for names in [POSITION, SPHERE] {
                let at = DVec3::from_array(trial.log.numbers(row, names));
                trial.log.set(row, names, (turn * at + move_by).to_array());
            }
            let q = turn * DQuat::from_array(trial.log.numbers(row, ROTATION));
            trial.log.set(row, ROTATION, q.normalize().to_array());
        }
    }),
    ("signs between cells, ends of lines, a column that is not used", |trial| {
        trial.log.names.push("operator".into());
        trial.log.rows.iter_mut().for_each(|row| row.push("NN".into()));
        let taxels = trial.log.column("taxels");
        trial.log.rows.iter_mut().for_each(|row| row[taxels] = row[taxels].replace(';', " "));
        (trial.between, trial.end) = (";", "\r\n");
    }),
    ("order of the drawing", |trial| trial.drawing.rows.reverse()),
    ("a further patch that nothing touches", |trial| {
        let row = |k: u32| {
            let (module, [x, y]) = (90 + k / 6, [k % 6, k / 6].map(|along| 0.3 + 0.006 * f64::from(along)));
            format!("{},{module},far,{x},{y},0.2,0,0,1", 500 + k).split(',').map(str::to_owned).collect()
        };
        trial.drawing.rows.extend((0..18).map(row));
    }),
    ("readings in a file of their own", |trial| {
        let [time, taxels] = ["time", "taxels"].map(|name| trial.log.column(name));
        let cells = |row: &Vec<String>| -> BTreeMap<u32, String> {
            let one = |felt: &str| felt.split_once(':').map(|(id, x)| (id.parse().unwrap(), x.to_owned()));
            row[taxels].split(';').filter_map(one).collect()
        };
        let frames: Vec<BTreeMap<u32, String>> = trial.log.rows.iter().map(cells).collect();
        let ids: BTreeSet<u32> = frames.iter().flat_map(|frame| frame.keys().copied()).collect();
        let reading = |frame: &BTreeMap<u32, String>, id| frame.get(id).map_or("0".into(), String::clone);
        let row = |(row, frame): (&Vec<String>, &BTreeMap<u32, String>)| {
            let own = ids.iter().map(|id| reading(frame, id));
            std::iter::once(row[time].clone()).chain(own).collect()
        };
        let rows = trial.log.rows.iter().zip(&frames).map(row).collect();
        let names = std::iter::once("time".into()).chain(ids.iter().map(u32::to_string)).collect();
        trial.readings = Some(Cells { names, rows });
        trial.log.names.remove(taxels);
        trial.log.rows.iter_mut().for_each(|row| drop(row.remove(taxels)));
        trial.words = " --readings readings.csv --threshold 1e-12";
    }),
    ("order of the rows of contacts", |trial| {
        trial.contacts = |contacts| {
            let rows = contacts.rows.len();
            contacts.rows = (0..rows).map(|k| contacts.rows[k * 389 % rows].clone()).collect();
        }
    }),
    ("order of the columns of contacts", |trial| {
        trial.contacts = |contacts| {
            contacts.names.reverse();
            contacts.rows.iter_mut().for_each(|row| row.reverse());
        }
    }),
];

/// Where `calibrate` places the taxels, and what `check` finds, which reads no readings next to a log.
fn result(folder: &Path, trial: &Trial) -> (BTreeMap<u32, DVec3>, Option<Vec<String>>) {
    trial.log.write(&folder.join("log.csv"), trial.between, trial.end);
    if let Some(readings) = &trial.readings {
        readings.write(&folder.join("readings.csv"), ",", "\n");
    }
    trial.drawing.write(&folder.join("drawing.csv"), ",", "\n");
    let words = format!("touches log.csv --skin drawing.csv -o c.csv{}", trial.words);
    dermatome(folder, &words).assert().success();
    let mut contacts = Cells::read(&folder.join("c.csv"));
    (trial.contacts)(&mut contacts);
    contacts.write(&folder.join("c.csv"), ",", "\n");
    dermatome(folder, "calibrate c.csv --cad drawing.csv -o s.csv").assert().success();
    let positions = read_truth(&folder.join("s.csv")).unwrap();
    let positions = positions.into_iter().map(|(id, pose)| (id.0 % 1000, pose.position)).collect();
    if trial.readings.is_some() {
        return (positions, None);
    }
    let found = dermatome(folder, &format!("check log.csv --json{}", trial.words)).output().unwrap();
    let found = json(&found.stdout)["findings"].clone();
    let mut kinds: Vec<String> =
        found.as_array().unwrap().iter().map(|one| one["kind"].to_string()).collect();
    kinds.sort();
    (positions, Some(kinds))
}

#[test]
fn what_must_not_matter_to_a_log_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let words = "simulate --arm --taxels 70 --arm-noise-mm 0.5 --reading-noise-kpa 0.5 --seed 4 -o log.csv --truth t.csv";
    dermatome(folder, words).assert().success();
    drawing_of_modules(folder);
    cut_touches(folder);
    let [log, drawing] = ["log.csv", "drawing.csv"].map(|name| Cells::read(&folder.join(name)));
    let base = Trial { log, readings: None, drawing, contacts: |_| {}, words: "", between: ",", end: "\n" };
    let (positions, kinds) = result(folder, &base);
    let mut broken = Vec::new();
    for (name, change) in LAWS {
        let mut trial = base.clone();
        change(&mut trial);
        let (moved, found) = result(folder, &trial);
        let far = positions.iter().map(|(id, at)| moved[id].distance(*at)).fold(0.0, f64::max);
        println!("{name}: {:.2e} m, {found:?}", far);
        if far > 1e-6 || found.is_some() && found != kinds {
            broken.push(format!("{name}: {far} m, {found:?}"));
        }
    }
    assert!(broken.is_empty(), "of {kinds:?}: {broken:#?}");
}
