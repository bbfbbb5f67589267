//! XSENSOR `.csv`: frames with a block for each sensor, whose rows of cells have blank lines between them. Blocks `Name`
//! repeat cells as regions and are left out. The estimated load of each block is compared.

use std::path::Path;

use crate::io::IoError;
use crate::io::file::excerpt;
use crate::io::layout::{Statement, StatementSource, StreamFacts, TimeUnit};
use crate::io::streams::frames::{Frames, OpenStream, Sheet, Tick, Wanted};
use crate::io::streams::lines::{TextLines, cells as split};
use crate::io::streams::numbers::{is_sum, pascals, unit};

/// A load may differ from the sum of cells by this share of it, and by this many N.
const LOAD_TOLERANCE: [f64; 2] = [0.01, 0.5];

/// A sensor of the file.
#[derive(Debug, Clone, PartialEq)]
struct Sensor {
    name: String,
    shape: [usize; 2],
    /// Height and width of a cell, in m.
    pitch: [f64; 2],
}

/// The reader, which stands before a frame.
struct Xsensor {
    lines: TextLines,
    sensor: Sensor,
    unit: String,
    frame: Option<u64>,
    day: i64,
    /// The first and the last time of day, in s.
    first: Option<f64>,
    last: f64,
    loads: u64,
    absent: u64,
}

/// A block of a frame.
struct Block {
    sensor: Sensor,
    load: Option<f64>,
    cells: Vec<f64>,
}

/// What a line is.
enum Item {
    Frame(u64),
    Time(f64),
    Threshold(f64),
    Block(Block),
    End,
}

pub(super) fn open(path: &Path, wanted: Wanted<'_>) -> Result<OpenStream, IoError> {
    let mut lines = TextLines::open(path)?;
    let (mut notes, mut threshold) = (Vec::new(), None);
    let unit = loop {
        if !lines.advance_to_content()? {
            return Err(lines.ended("a line Units:"));
        }
        let (key, value) = key_of(&lines);
        if key == "Units:" {
            break unit(&value);
        }
        if key == "FRAME" {
            return Err(lines.at().invalid("a frame", "a line Units: before it"));
        }
        lines.check_header("Units:")?;
    };
    let (mut sensors, mut frames): (Vec<Sensor>, u64) = (Vec::new(), 0);
    loop {
        match next_item(&mut lines, None)? {
            Item::Threshold(stated) => threshold = Some(stated),
            Item::Frame(_) => frames += 1,
            Item::Time(_) => {}
            Item::End => break,
            Item::Block(Block { sensor, .. }) => match sensors.iter().find(|known| known.name == sensor.name)
            {
                Some(known) if *known == sensor => {}
                Some(known) => {
                    let needed = format!("{:?} as in the frames before", known.shape);
                    return Err(lines
                        .at()
                        .invalid(format!("{:?} cells of {}", sensor.shape, sensor.name), needed));
                }
                None => sensors.push(sensor),
            },
        }
    }
    let streams: Vec<_> = sensors.iter().map(|s| (s.name.clone(), s.shape.to_vec())).collect();
    if streams.is_empty() {
        return Err(lines.ended("a frame with a block SENSOR"));
    }
    let sensor = sensors.swap_remove(wanted.choose(path, &streams)?);
    let [height, width] = sensor.pitch.map(|side| 1e3 * side);
    notes.push(Statement::new("sensor", &sensor.name, StatementSource::File));
    let stated = threshold.map(|x| Statement::new("threshold", format!("{x} {unit}"), StatementSource::File));
    notes.extend(stated);
    notes.push(Statement::new("pitch", format!("{height} x {width} mm"), StatementSource::File));
    let facts = StreamFacts {
        stream: sensor.name.clone(),
        cells: sensor.shape.to_vec(),
        usual_axes: vec!["row", "col"],
        units: vec![unit.clone()],
        time_names: vec!["Time".into(), "time".into()],
        time_unit: Some(TimeUnit::Seconds),
        threshold,
        has_pressures: true,
        notes,
        ..StreamFacts::default()
    };
    let sheet = Some(Sheet::grid(sensor.shape, sensor.pitch, &[]));
    let lines = TextLines::open(path)?;
    let source =
        Xsensor { lines, sensor, unit, frame: None, day: 0, first: None, last: 0.0, loads: 0, absent: 0 };
    Ok(OpenStream { facts, frames: Some(frames), sheet, source: Box::new(source) })
}

/// The key of a line and its value.
fn key_of(lines: &TextLines) -> (String, String) {
    let text = lines.text();
    let (key, value) = text.split_once(',').unwrap_or((&text, ""));
    (key.trim().into(), value.trim_end_matches([',', ' ']).trim().into())
}

/// The next frame, time or block; the numbers of cells are read for the sensor `wanted` alone.
fn next_item(lines: &mut TextLines, wanted: Option<&str>) -> Result<Item, IoError> {
    let mut is_region = false;
    while lines.advance_to_content()? {
        if lines.bytes()[0].is_ascii_digit() || lines.bytes()[0] == b',' {
            continue;
        }
        let (key, value) = key_of(lines);
        match key.as_str() {
            "FRAME" => {
                let needed = "the number of a frame";
                let frame = value.parse().map_err(|_| lines.at().invalid(excerpt(&value), needed))?;
                return Ok(Item::Frame(frame));
            }
            "Time" => {
                let needed = "a time as 08:21:17.982";
                let time = time_of_day(&value).ok_or_else(|| lines.at().invalid(excerpt(&value), needed))?;
                return Ok(Item::Time(time));
            }
            "Threshold:" => {
                return lines.number(value.as_bytes(), || key.clone()).map(Item::Threshold);
            }
            "SENSOR" => return read_block(lines, value, wanted).map(Item::Block),
            "Name" => is_region = true,
            "SENSELS" if !is_region => return Err(lines.at().invalid("cells", "a line SENSOR before them")),
            _ => {}
        }
    }
    Ok(Item::End)
}

/// Seconds of `08:21:17.982`.
fn time_of_day(text: &str) -> Option<f64> {
    let parts: Option<Vec<f64>> = text.splitn(3, ':').map(|part| part.trim().parse().ok()).collect();
    match parts?.as_slice() {
        &[h, m, s] if (0.0..24.0).contains(&h) && (0.0..60.0).contains(&m) && (0.0..61.0).contains(&s) => {
            Some(3600.0 * h + 60.0 * m + s)
        }
        _ => None,
    }
}

fn read_block(lines: &mut TextLines, name: String, wanted: Option<&str>) -> Result<Block, IoError> {
    let (mut shape, mut pitch, mut load) = ([0_usize; 2], [f64::NAN; 2], None);
    loop {
        if !lines.advance_to_content()? {
            return Err(lines.ended(&format!("the cells of {name}")));
        }
        let (key, value) = key_of(lines);
        let number = || lines.number(value.as_bytes(), || key.clone());
        match key.as_str() {
            "Rows" | "Columns" => {
                let most = 1 << 12;
                let size = value.parse().ok().filter(|n| (1..=most).contains(n));
                let wrong =
                    || lines.at().invalid(format!("{key} {}", excerpt(&value)), format!("1 to {most}"));
                shape[usize::from(key == "Columns")] = size.ok_or_else(wrong)?;
            }
            "Sensel Height (cm)" => pitch[0] = 1e-2 * number()?,
            "Sensel Width (cm)" => pitch[1] = 1e-2 * number()?,
            "Est. Load (N)" => load = Some(number()?),
            "SENSELS" => break,
            "FRAME" | "SENSOR" | "Name" => {
                return Err(lines.at().invalid(excerpt(&key), format!("SENSELS, the cells of {name}")));
            }
            _ => {}
        }
    }
    let is_known = shape.iter().all(|size| *size > 0) && pitch.iter().all(|side| *side > 0.0);
    if !is_known {
        let needed = "Rows, Columns, Sensel Width (cm) and Sensel Height (cm) before the cells";
        return Err(lines.at().invalid(format!("cells of {name}"), needed));
    }
    let is_wanted = wanted == Some(name.as_str());
    let mut cells = Vec::new();
    for row in 0..shape[0] {
        if !lines.advance()? {
            return Err(lines.ended(&format!("row {row} of {} of {name}", shape[0])));
        }
        // One blank line is between two rows; a row may be blank itself, as each of its cells.
        if lines.bytes().iter().all(|byte| byte.is_ascii_whitespace() || *byte == b',') && !lines.advance()? {
            return Err(lines.ended(&format!("row {row} of {} of {name}", shape[0])));
        }
        if is_wanted {
            read_row(lines, row, shape, &mut cells)?;
        } else if lines.bytes().first().is_some_and(u8::is_ascii_alphabetic) {
            let needed = format!("row {row} of {} of {name}", shape[0]);
            return Err(lines.at().invalid(excerpt(&lines.text()), needed));
        }
    }
    Ok(Block { sensor: Sensor { name, shape, pitch }, load, cells })
}

/// Reads a row; cells that are blank have no reading.
fn read_row(lines: &TextLines, row: usize, shape: [usize; 2], cells: &mut Vec<f64>) -> Result<(), IoError> {
    let end = cells.len() + shape[1];
    for (k, cell) in split(lines.bytes(), b',').enumerate() {
        match (cell.is_empty(), k < shape[1]) {
            (true, true) => cells.push(f64::NAN),
            (true, false) => {}
            (false, true) => cells.push(lines.number(cell, || format!("row {row}, column {}", k + 1))?),
            (false, false) => {
                let needed = format!("{}, numbers with a decimal point between commas", shape[1]);
                return Err(lines.at().invalid(format!("more than {} cells in row {row}", shape[1]), needed));
            }
        }
    }
    cells.resize(end, f64::NAN);
    Ok(())
}

impl Xsensor {
    /// Refuses a load that is not the sum of the cells.
    fn check_load(&mut self, block: &Block) -> Result<(), IoError> {
        let (Some(stated), Some(pascals)) = (block.load, pascals(&self.unit)) else { return Ok(()) };
        let area = self.sensor.pitch[0] * self.sensor.pitch[1];
        let found = block.cells.iter().filter(|x| !x.is_nan()).sum::<f64>() * pascals * area;
        if is_sum(found, stated, LOAD_TOLERANCE[1], LOAD_TOLERANCE[0]) {
            self.loads += 1;
            return Ok(());
        }
        let found = format!("cells of {} that are {found:.2} N in {}", self.sensor.name, self.unit);
        let part = format!("frame {}", self.frame.unwrap_or_default());
        Err(self.lines.at().invalid_part(part, found, format!("{stated} N, their Est. Load")))
    }
}

impl Frames for Xsensor {
    fn read(&mut self, cells: &mut Vec<f64>, time: &mut Tick) -> Result<bool, IoError> {
        let (mut is_in, mut is_found) = (false, false);
        let [rows, cols] = self.sensor.shape;
        cells.clear();
        loop {
            let item = next_item(&mut self.lines, Some(&self.sensor.name))?;
            match item {
                Item::Frame(_) if is_in => {
                    self.lines.hold();
                    break;
                }
                Item::Frame(frame) => {
                    if self.frame.is_some_and(|last| frame <= last) {
                        let needed = "frames in ascending order";
                        return Err(self.lines.at().invalid(format!("frame {frame} again"), needed));
                    }
                    (self.frame, is_in) = (Some(frame), true);
                }
                Item::Time(seconds) => {
                    // After midnight.
                    if seconds + 43_200.0 < self.last {
                        self.day += 1;
                    }
                    self.last = seconds;
                    let first = *self.first.get_or_insert(seconds);
                    *time = Tick::Real(86_400.0 * self.day as f64 + seconds - first);
                }
                Item::Block(block) if block.sensor.name == self.sensor.name => {
                    if is_found {
                        return Err(self
                            .lines
                            .at()
                            .invalid(format!("{} again", self.sensor.name), "one block a frame"));
                    }
                    self.check_load(&block)?;
                    (*cells, is_found) = (block.cells, true);
                }
                Item::Block(_) | Item::Threshold(_) => {}
                Item::End if is_in => break,
                Item::End => return Ok(false),
            }
        }
        if !is_found {
            self.absent += 1;
            cells.resize(rows * cols, f64::NAN);
        }
        Ok(true)
    }

    fn statements(&self) -> Vec<Statement> {
        let loads = format!("the load of {} frames is that of their cells", self.loads);
        let absent = format!("{} frames without the sensor; they have no readings", self.absent);
        let all = [(self.loads, "loads", loads), (self.absent, "sensor missing", absent)];
        let of =
            |(count, what, value)| (count > 0).then(|| Statement::new(what, value, StatementSource::Checked));
        all.into_iter().filter_map(of).collect()
    }
}
