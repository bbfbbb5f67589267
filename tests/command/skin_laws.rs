//! What must not matter to a skin, tried on every command that takes its map: the frame, the unit, the size, the order of rows,
//! faces and files, names. What comes out is the same, or turned and scaled as the skin is. The skin is uneven on purpose: two
//! links, two patches that share ids, 41 x 9 and 5 x 24 taxels at uneven distances, one of them absent, names with spaces.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::fs;
use std::io::Read as _;
use std::ops::Range;
use std::path::Path;

use base64::Engine as _;
use dermatome::io::read_map;
use dermatome::map::SkinMap;
use dermatome::skin::PatchId;
use glam::{DMat3, DQuat, DVec3};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;
use serde_json::Value;

use crate::common::{dermatome, json};

/// Taxels along u and v of the two patches.
const SHEETS: [(usize, usize); 2] = [(41, 9), (5, 24)];
const SPACING: f64 = 0.005;
/// How far taxels are off the lattice along each axis, so that no tie of distances is left to rounding. Which of two equal
/// fillings of a star is taken follows from numbers along a curve through space: of most such skins the coarser levels
/// change with the frame. Of this one they do not, so that whatever else does is seen.
const UNEVEN: f64 = 0.0002;
/// The taxel of the first patch that is absent, counted from 0.
const ABSENT: usize = 200;
const FRAMES: usize = 240;

/// What is done to a skin.
#[derive(Clone, Copy)]
struct Law {
    name: &'static str,
    /// A turn about an axis without a lattice direction, in rad, and with it a shift.
    turn: f64,
    scale: f64,
    /// The unit of the files, and how many of it are a metre.
    unit: Option<(&'static str, f64)>,
    /// The order of rows and of faces, if it is another one.
    order: Option<u128>,
    names: Names,
    /// Each patch in a file of its own, the second one first.
    is_split: bool,
}

#[derive(Clone, Copy, PartialEq)]
enum Names {
    Given,
    Others,
    /// Those that are given, but one link.
    OneLink,
    None,
}

const SAME: Law = Law {
    name: "as it is",
    turn: 0.0,
    scale: 1.0,
    unit: None,
    order: None,
    names: Names::Given,
    is_split: false,
};

/// Those after a law that is a reference are compared with it.
const LAWS: [(bool, Law); 11] = [
    (true, SAME),
    (false, Law { name: "turned", turn: 1.1, ..SAME }),
    (false, Law { name: "3 times as large", scale: 3.0, ..SAME }),
    (false, Law { name: "1000 times as small, in mm", scale: 1e-3, unit: Some(("mm", 1e3)), ..SAME }),
    (false, Law { name: "in inches", unit: Some(("in", 1.0 / 0.0254)), ..SAME }),
    (false, Law { name: "in another order", order: Some(5), ..SAME }),
    (false, Law { name: "in two files", is_split: true, ..SAME }),
    (false, Law { name: "with other names", names: Names::Others, ..SAME }),
    (
        false,
        Law {
            name: "all at once",
            turn: 1.1,
            scale: 3.0,
            unit: Some(("mm", 1e3)),
            order: Some(9),
            names: Names::Others,
            is_split: true,
        },
    ),
    (true, Law { name: "on one link", names: Names::OneLink, ..SAME }),
    (false, Law { name: "without names", names: Names::None, turn: 0.5, order: Some(7), ..SAME }),
];

impl Law {
    fn turned(&self, direction: DVec3) -> DVec3 {
        DQuat::from_axis_angle(DVec3::new(0.3, -0.5, 0.8).normalize(), self.turn) * direction
    }

    fn shift(&self) -> DVec3 {
        if self.turn == 0.0 { DVec3::ZERO } else { DVec3::new(0.1, -0.2, 0.3) }
    }

    fn moved(&self, position: DVec3) -> DVec3 {
        self.scale * (self.turned(position) + self.shift())
    }

    /// Where the law takes what it moved from, and likewise of directions.
    fn back(&self, position: DVec3) -> DVec3 {
        self.turned_back(position / self.scale - self.shift())
    }

    fn turned_back(&self, direction: DVec3) -> DVec3 {
        let columns = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| self.turned(axis));
        DMat3::from_cols(columns[0], columns[1], columns[2]).transpose() * direction
    }

    /// A position as the files have it.
    fn written(&self, position: DVec3) -> String {
        let p = self.moved(position) * self.per_metre();
        format!("{},{},{}", p.x, p.y, p.z)
    }

    fn per_metre(&self) -> f64 {
        self.unit.map_or(1.0, |(_, per_metre)| per_metre)
    }

    fn unit(&self) -> String {
        self.unit.map_or(String::new(), |(name, _)| format!("--unit {name}"))
    }

    /// Names of patches and links, by patch.
    fn names(&self) -> [[&'static str; 2]; 2] {
        match self.names {
            Names::Others => [["zz", "q link"], ["aa x", "b"]],
            Names::OneLink => [["upper arm", "arm link"], ["lower palm", "arm link"]],
            _ => [["upper arm", "arm link"], ["lower palm", "palm link"]],
        }
    }

    /// Numbers in an order of this law.
    fn order(&self, count: usize) -> Vec<usize> {
        let mut all: Vec<usize> = (0..count).collect();
        if let Some(seed) = self.order {
            let mut random = Pcg64Mcg::new(seed << 1 | 1);
            for k in (1..count).rev() {
                all.swap(k, below(&mut random, k + 1));
            }
        }
        all
    }
}

/// A uniform number of -1 to 1.
fn uniform(random: &mut Pcg64Mcg) -> f64 {
    (random.next_u64() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// Position in m and normal of each taxel: the first patch is bent round a cylinder of 80 mm, the second is nearly flat.
fn taxels(patch: usize) -> Vec<[DVec3; 2]> {
    let (width, height) = SHEETS[patch];
    let mut random = Pcg64Mcg::new(120 + patch as u128);
    let mut place = |k: usize| {
        let (i, j) = ((k % width) as f64, (k / width) as f64);
        let (x, y) = (SPACING * (i + 0.5 * (j % 2.0)), SPACING * j * 0.75_f64.sqrt());
        let angle = y / 0.08;
        let uneven = UNEVEN * DVec3::from_array(std::array::from_fn(|_| uniform(&mut random)));
        let [at, normal] = match patch {
            0 => [
                DVec3::new(x, 0.08 * angle.sin(), 0.08 * (angle.cos() - 1.0)),
                DVec3::new(0.0, angle.sin(), angle.cos()),
            ],
            _ => [DVec3::new(x + 0.23, y, 0.0), DVec3::Z],
        };
        [at + uneven, normal]
    };
    (0..width * height).map(&mut place).collect()
}

fn triangles(patch: usize) -> Vec<[usize; 3]> {
    let (width, height) = SHEETS[patch];
    let cells = (0..height - 1).flat_map(|j| (0..width - 1).map(move |i| (j, j * width + i)));
    let two = |(j, a): (usize, usize)| {
        let (b, c, d) = (a + 1, a + width, a + width + 1);
        if j % 2 == 0 { [[a, b, c], [b, d, c]] } else { [[a, b, d], [a, d, c]] }
    };
    cells.flat_map(two).collect()
}

/// Writes these patches as `NAME.csv` with their triangles.
fn write(folder: &Path, name: &str, law: &Law, patches: Range<usize>) {
    let (mut rows, mut faces) = (Vec::new(), Vec::new());
    let names = if law.names == Names::None { "" } else { ",patch,on_link" };
    for patch in patches {
        faces.extend(triangles(patch).into_iter().map(|t| t.map(|k| k + rows.len())));
        for (k, [at, normal]) in taxels(patch).into_iter().enumerate() {
            let n = law.turned(normal);
            let mut row = format!("{},{},{},{},{}", k + 1, law.written(at), n.x, n.y, n.z);
            write!(row, ",{}", u8::from(patch == 1 || k != ABSENT)).unwrap();
            if law.names != Names::None {
                let [name, link] = law.names()[patch];
                write!(row, ",{name},{link}").unwrap();
            }
            rows.push(row);
        }
    }
    let order = law.order(rows.len());
    let mut number = vec![0; rows.len()];
    order.iter().enumerate().for_each(|(new, &old)| number[old] = new);
    let rows: Vec<&str> = order.iter().map(|&k| &*rows[k]).collect();
    let table = format!("id,x,y,z,nx,ny,nz,present{names}\n{}\n", rows.join("\n"));
    fs::write(folder.join(format!("{name}.csv")), table).unwrap();
    let mut table = String::from("row0,row1,row2\n");
    for (k, face) in law.order(faces.len()).into_iter().enumerate() {
        let mut corners = faces[face].map(|old| number[old]);
        corners.rotate_left(if law.order.is_some() { k % 3 } else { 0 });
        writeln!(table, "{},{},{}", corners[0], corners[1], corners[2]).unwrap();
    }
    fs::write(folder.join(format!("{name}.triangles.csv")), table).unwrap();
}

/// Contacts near taxels of both patches, on both sides, and some that are off the skin.
fn write_contacts(folder: &Path, law: &Law) {
    let mut random = Pcg64Mcg::new(23);
    let mut text = String::from("x,y,z,nx,ny,nz,force,radius,time\n");
    for k in 0..40 {
        let all = taxels(k % 2);
        let [at, normal] = all[below(&mut random, all.len())];
        let aside = DVec3::from_array(std::array::from_fn(|_| uniform(&mut random)));
        let off = if k < 36 { 0.0015 + 0.0045 * uniform(&mut random) } else { 0.2 };
        let n = law.turned((0.2 * aside - normal).normalize());
        let at = law.written(at + 0.0012 * aside + off * normal);
        let (force, radius) = (1.0 + 0.1 * k as f64, 0.004 * law.scale * law.per_metre());
        writeln!(text, "{at},{},{},{},{force},{radius},{}", n.x, n.y, n.z, 0.02 * k as f64).unwrap();
    }
    fs::write(folder.join("contacts.csv"), text).unwrap();
}

/// Presses on the taxels of the first patch, whose ids the second one has, too.
fn write_readings(folder: &Path) {
    let all = taxels(0);
    let mut random = Pcg64Mcg::new(7);
    let mut text = String::from("time");
    (1..=all.len()).for_each(|id| write!(text, ",{id}.pressure[kPa]").unwrap());
    // Of each: first frame, frames, taxel at its centre, peak.
    let presses = [(60, 50, 235, 20.0), (130, 30, 90, 12.0), (180, 40, 266, 25.0)];
    for frame in 0..FRAMES {
        write!(text, "\n{:.3}", 0.02 * frame as f64).unwrap();
        for (k, [at, _]) in all.iter().enumerate() {
            let noise = 0.05 * (0..3).map(|_| uniform(&mut random)).sum::<f64>();
            let of_one = |&(first, frames, centre, peak): &(usize, usize, usize, f64)| {
                let phase = std::f64::consts::PI * (frame as f64 - first as f64 + 0.5) / frames as f64;
                let squared = at.distance_squared(all[centre][0]) / 0.012_f64.powi(2);
                let is_on = (first..first + frames).contains(&frame);
                if is_on { peak * phase.sin().sqrt() * (-squared).exp() } else { 0.0 }
            };
            let reading = noise + presses.iter().map(of_one).sum::<f64>();
            if k == ABSENT { text.push(',') } else { write!(text, ",{reading:.4}").unwrap() }
        }
    }
    fs::write(folder.join("readings.csv"), text + "\n").unwrap();
}

/// A bag that presses all taxels of the first patch, which have gains of their own, in steps.
fn write_steps(folder: &Path) {
    let mut random = Pcg64Mcg::new(17);
    let gains: Vec<f64> = taxels(0).iter().map(|_| (0.3 * uniform(&mut random)).exp()).collect();
    let (mut steps, mut text) = (String::from("time,pressure[kPa]\n"), String::from("time"));
    (1..=gains.len()).for_each(|id| write!(text, ",{id}.pressure[kPa]").unwrap());
    let pressures = [0.0, 0.0, 5.0, 20.0, 60.0, 20.0, 5.0, 0.0, 5.0, 20.0, 60.0, 20.0, 5.0, 0.0];
    for (step, pressure) in pressures.into_iter().enumerate() {
        writeln!(steps, "{},{pressure}", step).unwrap();
        for frame in 0..FRAMES_OF_STEP {
            write!(text, "\n{:.3}", step as f64 + frame as f64 / FRAMES_OF_STEP as f64).unwrap();
            for (k, gain) in gains.iter().enumerate() {
                let noise = 0.05 * (0..3).map(|_| uniform(&mut random)).sum::<f64>();
                let reading = noise + gain * pressure;
                if k == ABSENT { text.push(',') } else { write!(text, ",{reading:.4}").unwrap() }
            }
        }
    }
    fs::write(folder.join("steps.csv"), steps).unwrap();
    fs::write(folder.join("pressed_in_steps.csv"), text + "\n").unwrap();
}

const FRAMES_OF_STEP: usize = 12;

/// The surface of the first patch, for modules.
fn write_surface(folder: &Path, law: &Law) {
    let mut text = String::new();
    let (all, faces) = (taxels(0), triangles(0));
    let order = law.order(all.len());
    let mut number = vec![0; all.len()];
    order.iter().enumerate().for_each(|(new, &old)| number[old] = new);
    order.iter().for_each(|&k| writeln!(text, "v {}", law.written(all[k][0]).replace(',', " ")).unwrap());
    for face in law.order(faces.len()) {
        let [a, b, c] = faces[face].map(|old| number[old] + 1);
        writeln!(text, "f {a} {b} {c}").unwrap();
    }
    fs::write(folder.join("surface.obj"), text).unwrap();
}

/// Columns with whole numbers, which are the same or not.
const COUNTS: [&str; 8] =
    ["contact", "level", "taxel_id", "live_taxel_id", "peak_taxel_id", "frame", "frames", "taxels"];

/// A row of what a command says: what must be the same, and numbers that must be so but for rounding.
type Row = (String, Vec<f64>);

/// A number below `count`.
fn below(random: &mut Pcg64Mcg, count: usize) -> usize {
    usize::try_from(random.next_u64() % count as u64).expect("less than a usize")
}

/// A skin to which something was done, and its map.
struct Built {
    folder: tempfile::TempDir,
    law: Law,
    map: SkinMap,
}

impl Built {
    fn new(law: Law) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path();
        if law.is_split {
            write(path, "s", &law, 0..1);
            write(path, "second", &law, 1..2);
        } else {
            write(path, "s", &law, 0..2);
        }
        write_contacts(path, &law);
        write_readings(path);
        write_steps(path);
        write_surface(path, &law);
        let files = if law.is_split { "second.csv s.csv" } else { "s.csv" };
        let pixel = 5.0 * law.scale;
        let words = format!("build {files} -o m --pixel-mm {pixel} {}", law.unit());
        dermatome(path, &words).assert().success();
        let map = read_map(&path.join("m/map.glb")).unwrap();
        Self { folder, law, map }
    }

    /// The number of a patch of the map, as the fixture counts them.
    fn number(&self, patch: PatchId) -> usize {
        usize::from(self.map.patches[patch].taxels.ids.len() == SHEETS[1].0 * SHEETS[1].1)
    }

    /// What a patch or a link is called, by its name, if it is one.
    fn patch(&self, name: &str) -> Option<PatchId> {
        self.map.patches.ids().find(|&id| self.map.patches[id].name == name)
    }

    fn link(&self, name: &str) -> Option<String> {
        let links = self.map.links.ids().filter(|&id| {
            let own = &self.map.links[id].name;
            own == name || own.is_empty() && name == format!("link{}", id.index())
        });
        let of = |id| {
            let patches = self.map.patches.ids().filter(|&p| self.map.patches[p].link == id);
            let mut numbers: Vec<usize> = patches.map(|p| self.number(p)).collect();
            numbers.sort_unstable();
            format!("link of {numbers:?}")
        };
        links.map(of).next()
    }

    /// What anything may be called.
    fn title(&self, name: &str) -> Option<String> {
        self.patch(name).map(|id| format!("P{}", self.number(id)))
    }

    /// The taxel at the centre of each field of a level of a patch or of the whole body, as a number.
    fn centres(&self, patch: Option<PatchId>, level: &str) -> Vec<f64> {
        let id =
            |p: PatchId, v| f64::from(self.map.patches[p].taxels.ids[v].0) + 1000.0 * self.number(p) as f64;
        if let Some(level) = level.strip_prefix("body.L") {
            let levels = self.map.body.levels.as_slice();
            let level = &levels[level.parse::<usize>().unwrap()];
            return level.origins.iter().map(|at| id(at.patch, at.taxel)).collect();
        }
        let patch = patch.unwrap();
        let level = &self.map.patches[patch].levels.as_slice()[level.parse::<usize>().unwrap()];
        level.level.origins.iter().map(|&v| id(patch, v)).collect()
    }

    /// A row of a table or the keys of an event, without the columns in `left_out`.
    fn row(&self, cells: &[(String, String)], left_out: &[&str]) -> Row {
        let (mut text, mut numbers) = (String::new(), Vec::new());
        let cell = |name: &str| cells.iter().find(|(column, _)| column == name).map(|(_, cell)| &**cell);
        let (length, area) = (self.law.scale, self.law.scale * self.law.scale);
        let vector = |[x, y, z]: [&str; 3]| {
            let of = |name| cell(name)?.parse::<f64>().ok();
            Some(DVec3::new(of(x)?, of(y)?, of(z)?))
        };
        let group = cell("group").unwrap_or_default();
        for (column, found) in cells.iter().filter(|(column, _)| !left_out.contains(&&**column)) {
            let found = found.trim_matches('"');
            let number = found.parse::<f64>().ok();
            match &**column {
                // Where on the map: it is laid out anew; which face: they are numbered anew.
                "u" | "v" | "px" | "py" | "face" | "b0" | "b1" | "b2" | "angle" | "tx" | "ty" | "tz" => (),
                "from.u" | "from.v" | "to.u" | "to.v" => (),
                // Contacts are numbered through all patches.
                "track" => (),
                "name" if group == "contact" => (),
                "y" | "z" | "ny" | "nz" => (),
                "from.y" | "from.z" | "to.y" | "to.z" => (),
                "x" => numbers.extend(vector(["x", "y", "z"]).map_or([0.0; 3], |p| self.law.back(p).into())),
                "from.x" | "to.x" => {
                    let axes =
                        ["x", "y", "z"].map(|axis| format!("{}.{axis}", column.split('.').next().unwrap()));
                    let at = vector(axes.each_ref().map(|axis| &**axis));
                    numbers.extend(at.map_or([0.0; 3], |p| self.law.back(p).into()));
                }
                "nx" => numbers
                    .extend(vector(["nx", "ny", "nz"]).map_or([0.0; 3], |n| self.law.turned_back(n).into())),
                "patch" | "name" | "link" | "only_link" | "patches" => {
                    let titles = found.split(';').map(|name| {
                        match &**column {
                            "link" | "only_link" => self.link(name),
                            "name" if group == "link" => self.link(name),
                            _ => self.title(name),
                        }
                        .unwrap_or_else(|| name.to_owned())
                    });
                    let mut titles: Vec<String> = titles.collect();
                    titles.sort();
                    write!(text, "{column} {titles:?}, ").unwrap();
                }
                "field" => {
                    let patch = cell("patch").and_then(|name| self.patch(name));
                    let centre = found.parse::<usize>().ok();
                    let centre = centre.map(|field| self.centres(patch, cell("level").unwrap_or("0"))[field]);
                    write!(text, "{column} {centre:?}, ").unwrap();
                }
                // A field has a number that does not depend on order; weights are compared by their mean of it.
                "fields" => {
                    let centres = if found.is_empty() {
                        Vec::new()
                    } else {
                        self.centres(cell("patch").and_then(|name| self.patch(name)), cell("level").unwrap())
                    };
                    let weighted = found.split(';').filter_map(|pair| pair.split_once(':'));
                    let sums = weighted.map(|(field, weight)| {
                        let weight: f64 = weight.parse().unwrap();
                        DVec3::new(weight, weight * centres[field.parse::<usize>().unwrap()] / 1000.0, 0.0)
                    });
                    let sum: DVec3 = sums.sum();
                    numbers.extend([sum.x, sum.y]);
                }
                "taxels" if found.starts_with('[') => {
                    let mut ids: Vec<u64> = serde_json::from_str(found).unwrap();
                    ids.sort_unstable();
                    write!(text, "{column} {ids:?}, ").unwrap();
                }
                _ => {
                    let law = match &**column {
                        "distance" | "radius" | "off_chart" | "major" | "minor" | "path" => length,
                        name if name.starts_with("speed") => length,
                        "area" | "impulse" => area,
                        name if ["force", "contact_area"].iter().any(|of| name.starts_with(of))
                            && !name.ends_with("_time") =>
                        {
                            area
                        }
                        _ => 1.0,
                    };
                    match number {
                        Some(x) if !COUNTS.contains(&&**column) => numbers.push(x / law),
                        _ => {
                            write!(text, "{column} {:?}, ", self.link(found).unwrap_or(found.into())).unwrap()
                        }
                    }
                }
            }
        }
        (text, numbers)
    }

    fn table(&self, name: &str, left_out: &[&str]) -> Vec<Row> {
        let mut reader = csv::ReaderBuilder::new()
            .comment(Some(b'#'))
            .from_path(self.folder.path().join(name))
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        let names: Vec<String> = reader.headers().unwrap().iter().map(Into::into).collect();
        let row = |record: csv::StringRecord| {
            let cells: Vec<_> = names.iter().cloned().zip(record.iter().map(Into::into)).collect();
            self.row(&cells, left_out)
        };
        reader.records().map(|record| row(record.unwrap())).collect()
    }

    /// A recording, whose columns are the time and the taxels of the map: the rows are those of its columns.
    fn columns(&self, name: &str) -> Vec<Row> {
        let mut reader = csv::ReaderBuilder::new();
        let mut reader = reader.comment(Some(b'#')).from_path(self.folder.path().join(name)).unwrap();
        let of_patch = |id| self.centres(Some(id), "0").into_iter().map(|taxel| format!("taxel {taxel}"));
        let taxels = self.map.patches.ids().flat_map(of_patch);
        let mut all: Vec<Row> =
            std::iter::once("time".into()).chain(taxels).map(|name| (name, Vec::new())).collect();
        for record in reader.records() {
            let record = record.unwrap();
            assert_eq!(record.len(), all.len());
            // Absent taxels read NaN.
            let number = |cell: &str| cell.parse::<f64>().ok().filter(|x| x.is_finite()).unwrap_or(-1.0);
            all.iter_mut().zip(&record).for_each(|(row, cell)| row.1.push(number(cell)));
        }
        all
    }

    fn lines(&self, name: &str, left_out: &[&str]) -> Vec<Row> {
        let text = fs::read_to_string(self.folder.path().join(name)).unwrap();
        let row = |line: &str| {
            let object: serde_json::Map<String, Value> = serde_json::from_str(line).unwrap();
            let cells = object.into_iter().flat_map(|(key, value)| match value {
                Value::Object(inner) => {
                    inner.into_iter().map(|(k, v)| (format!("{key}.{k}"), v.to_string())).collect()
                }
                other => vec![(key, other.to_string())],
            });
            self.row(&cells.collect::<Vec<_>>(), left_out)
        };
        text.lines().map(row).collect()
    }

    /// An array of a .npz.
    fn array<T: npyz::Deserialize>(&self, file: &str, name: &str) -> Vec<T> {
        let file = fs::File::open(self.folder.path().join(file)).unwrap();
        let mut archive = zip::ZipArchive::new(file).unwrap();
        let entry = archive.by_name(&format!("{name}.npy")).unwrap();
        npyz::NpyFile::new(entry).unwrap().into_vec().unwrap()
    }

    /// The values of every tenth frame of each level, taxels and fields by the ids of their centres.
    fn arrays(&self, file: &str) -> Vec<Row> {
        let mut rows = Vec::new();
        let patches = self.map.patches.enumerate().flat_map(|(id, patch)| {
            let level = move |level: usize| (format!("{}.L{level}", patch.name), Some(id), level.to_string());
            (0..patch.levels.len()).map(level)
        });
        let body = (0..self.map.body.levels.len()).map(|k| format!("body.L{k}"));
        let body = body.map(|name| (name.clone(), None, name));
        for (name, patch, level) in patches.chain(body) {
            let (values, centres) =
                (self.array::<f32>(file, &format!("{name}.values")), self.centres(patch, &level));
            rows.extend(centres.iter().enumerate().map(|(field, centre)| {
                let of_field = values.iter().skip(field).step_by(10 * centres.len());
                let of_field = of_field.map(|x| if x.is_nan() { -1.0 } else { f64::from(*x) });
                (format!("level {level} field {centre}"), of_field.collect())
            }));
        }
        rows
    }

    /// Whether the interval of each reactive answer has the distance of the exact one, and its point is as near as it says. The
    /// intervals are those of cells along the axes of the link.
    fn reactive(&self, name: &str) -> Vec<Row> {
        let read = |name: &str| {
            let mut reader = csv::ReaderBuilder::new()
                .comment(Some(b'#'))
                .from_path(self.folder.path().join(name))
                .unwrap();
            reader.deserialize().map(Result::unwrap).collect::<Vec<HashMap<String, String>>>()
        };
        let number = |row: &HashMap<String, String>, column: &str| row[column].parse().unwrap_or(f64::NAN);
        let vector = |row: &HashMap<String, String>| {
            DVec3::from_array(["x", "y", "z"].map(|column| number(row, column)))
        };
        let (contacts, exact) = (read("contacts.csv"), read("answers.csv"));
        let error = 1e-7 * self.law.scale;
        let holds = |row: HashMap<String, String>| {
            let contact = &row["contact"];
            let is_same = |other: &&HashMap<String, String>| &other["contact"] == contact;
            let distance = number(exact.iter().find(is_same).unwrap(), "distance").abs();
            let is_hit = !row["patch"].is_empty();
            let [least, most] = ["least", "most"].map(|column| number(&row, column));
            let at = vector(&contacts[contact.parse::<usize>().unwrap()]) / self.law.per_metre();
            let is_near = vector(&row).distance(at) <= most + error;
            let is_within = (least - error..=most + error).contains(&distance);
            (format!("contact {contact} {is_hit} {}", !is_hit || is_near && is_within), Vec::new())
        };
        read(name).into_iter().map(holds).collect()
    }

    /// How often a picture has each element in each colour.
    fn picture(&self, name: &str) -> Vec<Row> {
        let text = fs::read_to_string(self.folder.path().join(name)).unwrap();
        let picture = roxmltree::Document::parse(&text).unwrap();
        let mut all: Vec<String> = picture
            .descendants()
            // Ticks and scales have round lengths.
            .filter(|node| node.is_element() && !["text", "line", "tspan"].contains(&node.tag_name().name()))
            .map(|node| format!("{} {:?}", node.tag_name().name(), node.attribute("fill")))
            .collect();
        all.sort();
        all.chunk_by(|a, b| a == b).map(|same| (format!("{} {}", same.len(), same[0]), Vec::new())).collect()
    }

    /// How many numbers a file has.
    fn sizes(&self, name: &str) -> Vec<Row> {
        let text = fs::read_to_string(self.folder.path().join(name)).unwrap();
        let words = text.split(|c: char| c.is_whitespace() || ",\"'()[]{}<>:=/".contains(c));
        vec![(format!("{} numbers", words.filter(|word| word.parse::<f64>().is_ok()).count()), Vec::new())]
    }

    /// What a page shows: the levels of patches, with the ends of their areas, and the recording.
    fn page(&self, name: &str) -> Vec<Row> {
        let text = fs::read_to_string(self.folder.path().join(name)).unwrap();
        let data = text.split("id=\"data\">").nth(1).unwrap().split('<').next().unwrap();
        let packed = base64::engine::general_purpose::STANDARD.decode(data.trim()).unwrap();
        let mut bytes = Vec::new();
        flate2::read::GzDecoder::new(&packed[..]).read_to_end(&mut bytes).unwrap();
        let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
        let page = json(&bytes[4..4 + length]);
        let area = self.law.scale * self.law.scale;
        let of = |patch: &Value| {
            let levels =
                patch["levels"].as_array().unwrap().iter().map(|level| level["vertices"].to_string());
            let ends = ["lo", "hi"].map(|end| patch["areas"][end].as_f64().unwrap() / area);
            (format!("{} taxels, {:?}", patch["taxels"], levels.collect::<Vec<_>>()), ends.to_vec())
        };
        let mut rows: Vec<Row> = page["patches"].as_array().unwrap().iter().map(of).collect();
        let recording = &page["recording"];
        let frames = recording["times"].as_array().unwrap().len();
        let ends = ["lo", "hi", "threshold"].map(|key| recording[key].as_f64().unwrap());
        rows.push((format!("{frames} frames"), ends.to_vec()));
        rows
    }

    /// The counts of levels, of commands that print them as JSON.
    fn levels(&self, output: &[u8]) -> Vec<Row> {
        let patches = json(output)["patches"].clone();
        let of = |patch: &Value| {
            let levels = patch["levels"].as_array().unwrap().iter().map(|level| {
                ["vertices", "faces", "boundary_loops"].map(|key| level[key].to_string()).join(" ")
            });
            (levels.collect::<Vec<_>>().join(", "), Vec::new())
        };
        patches.as_array().unwrap().iter().map(of).collect()
    }

    /// The lengths of the edges of a flat mesh, by the places of their ends.
    fn flat(&self, name: &str) -> Vec<Row> {
        let (at, uv) = (self.array::<f64>(name, "V"), self.array::<f64>(name, "UV"));
        let faces = self.array::<i64>(name, "F");
        let mut edges = Vec::new();
        for corners in faces.chunks(3) {
            for side in 0..3 {
                let ends = [corners[side], corners[(side + 1) % 3]].map(|v| usize::try_from(v).unwrap());
                let middle: DVec3 =
                    ends.iter().map(|&v| 0.5 * self.law.back(DVec3::from_slice(&at[3 * v..]))).sum();
                let [a, b] = ends.map(|v| glam::DVec2::from_slice(&uv[2 * v..]));
                edges.push((
                    String::new(),
                    vec![middle.x, middle.y, middle.z, a.distance(b) / self.law.scale],
                ));
            }
        }
        edges
    }
}

/// How what a command wrote is read: its file, and the columns that may differ.
enum Output {
    Table(&'static str, &'static [&'static str]),
    Columns(&'static str),
    Reactive(&'static str),
    Lines(&'static str, &'static [&'static str]),
    Arrays(&'static str),
    Picture(&'static str),
    Sizes(&'static str),
    Page(&'static str),
    Flat(&'static str),
    /// The levels that it prints.
    Levels,
}

use Output::{Arrays, Columns, Flat, Levels, Lines, Page, Picture, Reactive, Sizes, Table};

/// What speaks of contacts, which are apart by 10 mm, and of their paths, in steps of 4 mm: a skin of another size has others.
const IN_MM: [&str; 4] = ["regions.csv", "events.jsonl", "sums.csv", "body_sums.csv"];

/// Each command with what it writes. `{8mm}` in m, and `{1}`, `{2}` and so on in mm, are as large as the skin, `{stiff}` makes
/// pressures those of any size, and `{unit}` is said where files have another one than m.
const DOORS: [(&str, &[Output]); 28] = [
    ("coarsen m/map.glb -o levels.glb --json", &[Levels]),
    ("flatten s.csv {unit} -o flat.npz", &[Flat("flat.npz")]),
    ("lookup m/map.glb contacts.csv {unit} -o answers.csv", &[Table("answers.csv", &[])]),
    ("lookup m/map.glb contacts.csv {unit} -o far.csv --max-distance inf", &[Table("far.csv", &[])]),
    ("lookup m/map.glb contacts.csv {unit} -o nearest.csv --nearest 4", &[Table("nearest.csv", &[])]),
    ("lookup m/map.glb contacts.csv {unit} -o within.csv --within {8mm}", &[Table("within.csv", &[])]),
    ("lookup m/map.glb contacts.csv {unit} -o rays.csv --ray", &[Table("rays.csv", &[])]),
    (
        "lookup m/map.glb contacts.csv {unit} -o reactive.csv --reactive --level 0",
        &[Reactive("reactive.csv")],
    ),
    (
        "touch m/map.glb -o touch.csv --truth truth.csv --presses 4 --rate-hz 20 --reads pressure --stiffness-kpa {stiff} \
         --sphere-mm {15} --depth-mm {2} --roll-mm {20} --taxel-mm {2}",
        &[Columns("touch.csv"), Table("truth.csv", &["sphere_x", "sphere_y", "sphere_z"])],
    ),
    ("carry m/map.glb readings.csv --to m/map.glb -o carried.csv", &[Columns("carried.csv")]),
    (
        "response m/map.glb pressed_in_steps.csv --pressure steps.csv -o response.csv",
        &[Table("response.csv", &[])],
    ),
    (
        "design surface.obj {unit} -o design --module triangle:{20}mm --tolerance {1}mm --chain 6",
        &[Table("design/modules.csv", &["module", "qx", "qy", "qz", "qw"])],
    ),
    (
        "lookup m/map.glb contacts.csv {unit} -o body.csv --level 1 --level body.L0 --level body.L1",
        &[Table("body.csv", &[])],
    ),
    ("lookup m/map.glb answers.csv -o back.csv --from-map", &[Table("back.csv", &["contact"])]),
    (
        "lookup m/map.glb contacts.csv {unit} -o a.csv --readings pressed.csv --taxel-radius-mm {2}",
        &[Columns("pressed.csv")],
    ),
    (
        "render m/map.glb readings.csv -o values.npz --values-only --contacts regions.csv --events events.jsonl",
        &[Arrays("values.npz"), Table("regions.csv", &[]), Lines("events.jsonl", &["contact"])],
    ),
    (
        "summary m/map.glb readings.csv -o sums.csv --over-time loads.csv",
        &[Table("sums.csv", &[]), Table("loads.csv", &[])],
    ),
    ("summary m/map.glb readings.csv -o steps.csv --by step", &[Table("steps.csv", &["step"])]),
    ("summary m/map.glb readings.csv -o body_sums.csv --by body.L0", &[Table("body_sums.csv", &["name"])]),
    ("plot m/map.glb -o plot.svg", &[Picture("plot.svg")]),
    ("plot m/map.glb --space --level 1 -o space.svg", &[Picture("space.svg")]),
    ("plot m/map.glb --readings readings.csv --frame 80 -o frame.svg", &[Picture("frame.svg")]),
    ("export m/map.glb -o skin.csv", &[Table("skin.csv", &[])]),
    ("export m/map.glb -o fields.csv --level 1", &[Table("fields.csv", &[])]),
    ("export m/map.glb -o skin.xml", &[Sizes("skin.xml")]),
    ("export m/map.glb -o skin.usda --level 1", &[Sizes("skin.usda")]),
    ("report m/map.glb readings.csv -o page.html", &[Page("page.html")]),
    ("check m/map.glb --recording readings.csv -o states.csv", &[Table("states.csv", &[])]),
];

impl Built {
    /// What a command writes, sorted.
    fn results(&self, words: &str, outputs: &[Output]) -> Vec<Vec<Row>> {
        let scale = self.law.scale;
        let words = words
            .replace("{unit}", &self.law.unit())
            .replace("{8mm}", &(0.008 * scale).to_string())
            .replace("{stiff}", &(20.0 / scale).to_string());
        let words = [1, 2, 15, 20].iter().fold(words, |words, &mm| {
            words.replace(&format!("{{{mm}}}"), &(f64::from(mm) * scale).to_string())
        });
        let has_order = self.law.order.is_some() || self.law.is_split;
        let may_differ = match words.split(' ').next() {
            // Places of simulated touches are drawn from the faces in their order.
            Some("touch") => has_order,
            // Cuts and gaps between modules have lengths of their own; which modules come first follows the faces.
            Some("design") => has_order || scale != 1.0,
            // Of taxels that share an id the first has the row.
            Some("response") => self.law.is_split,
            _ => false,
        };
        if may_differ {
            return outputs.iter().map(|_| Vec::new()).collect();
        }
        let mut command = dermatome(self.folder.path(), &words);
        if words.starts_with("flatten") && !self.law.is_split {
            let first = self.map.patches.ids().find(|&id| self.number(id) == 0).unwrap();
            command.args(["--patch", &self.map.patches[first].name]);
        }
        // `check` has exit code 1 where it finds faults.
        let run = command.assert().code(vec![0, 1]);
        let read = |output: &Output| {
            let is_in_mm = matches!(output, Table(name, _) | Lines(name, _) if IN_MM.contains(name));
            if scale != 1.0 && is_in_mm {
                return Vec::new();
            }
            let mut rows = match output {
                Table(name, left_out) => self.table(name, left_out),
                Columns(name) => self.columns(name),
                Reactive(name) => self.reactive(name),
                Lines(name, left_out) => self.lines(name, left_out),
                Arrays(name) => self.arrays(name),
                Picture(name) => self.picture(name),
                Sizes(name) => self.sizes(name),
                Page(name) => self.page(name),
                Flat(name) => self.flat(name),
                Levels => self.levels(&run.get_output().stdout),
            };
            let is_before = |a: &Row, b: &Row| a.0.cmp(&b.0).then(rounded(&a.1).cmp(&rounded(&b.1)));
            rows.sort_by(is_before);
            rows
        };
        outputs.iter().map(read).collect()
    }

    /// The taxels of each level of the map and of the body, their areas, and how faithful it is.
    fn own(&self) -> Vec<Row> {
        let area = self.law.scale * self.law.scale;
        let mut rows = Vec::new();
        for (id, patch) in self.map.patches.enumerate() {
            for (k, level) in patch.levels.enumerate() {
                let distortion = [level.distortion.area_max, level.distortion.symmetric_dirichlet];
                let faces = level.level.mesh.triangles.len();
                rows.push((format!("P{} {k:?}: {faces} faces", self.number(id)), distortion.to_vec()));
                let centres = self.centres(Some(id), &k.index().to_string());
                let fields = centres.iter().zip(&level.level.areas);
                rows.extend(fields.map(|(centre, a)| (format!("{k:?} {centre}"), vec![a / area])));
            }
        }
        for k in 0..self.map.body.levels.len() {
            let centres = self.centres(None, &format!("body.L{k}"));
            rows.extend(centres.iter().map(|centre| (format!("body {k} {centre}"), Vec::new())));
        }
        rows.sort_by(|a, b| a.0.cmp(&b.0));
        rows
    }
}

/// Numbers in the order in which rows of equal text stand.
fn rounded(numbers: &[f64]) -> Vec<i64> {
    #[expect(clippy::cast_possible_truncation, reason = "numbers of a table")]
    numbers.iter().map(|x| (x * 1e5).round() as i64).collect()
}

/// Where rows differ, if they do: numbers by more than a thousandth of the largest of their row that are of this size.
fn difference(expected: &[Row], found: &[Row], error: f64) -> Option<String> {
    if found.is_empty() {
        return None;
    }
    if expected.len() != found.len() {
        return Some(format!("{} rows in place of {}", found.len(), expected.len()));
    }
    let is_near = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-3 * a.abs() + error;
    let differs = |(old, new): &(&Row, &Row)| {
        old.0 != new.0 || old.1.len() != new.1.len() || !old.1.iter().zip(&new.1).all(is_near)
    };
    let all: Vec<_> = expected.iter().zip(found).filter(differs).collect();
    let (old, new) = all.first()?;
    Some(format!("{} of {} rows: {new:?} in place of {old:?}", all.len(), expected.len()))
}

#[test]
fn what_must_not_matter_to_a_skin_does_not() {
    let mut wrong = Vec::new();
    // The rows of the map, and those of each output of each door.
    type Results = (Vec<Row>, Vec<Vec<Vec<Row>>>);
    let mut reference: Option<Results> = None;
    for (is_reference, law) in LAWS {
        let built = Built::new(law);
        let (own, of_doors) = (
            built.own(),
            DOORS.iter().map(|(words, outputs)| built.results(words, outputs)).collect::<Vec<_>>(),
        );
        if is_reference {
            reference = Some((own, of_doors));
            continue;
        }
        let (expected, expected_of_doors) = reference.as_ref().unwrap();
        wrong.extend(difference(expected, &own, 1e-6).map(|what| format!("{}, build: {what}", law.name)));
        for (((words, outputs), old), new) in DOORS.iter().zip(expected_of_doors).zip(&of_doors) {
            for ((old, new), output) in old.iter().zip(new).zip(*outputs) {
                let error = match output {
                    // Readings of 25 kPa with a noise of 0.05 kPa; middles of noisy places, axis by axis.
                    Arrays(_) => 1e-3,
                    Lines(..) => 1e-4,
                    // Pressures of 6000 Pa of taxels that a sphere just touches.
                    Columns("touch.csv") => 1.0,
                    _ => 1e-5,
                };
                wrong
                    .extend(difference(old, new, error).map(|what| format!("{}, {words}: {what}", law.name)));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
