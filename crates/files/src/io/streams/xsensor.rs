//! XSENSOR `.csv`: frames with a block for each sensor, whose rows of cells have blank lines between them. Blocks `Name`
//! repeat cells as regions and are left out. The estimated load of each block is compared.

use std::path::Path;

use crate::io::IoError;
use crate::io::file::excerpt;
use crate::io::file::times::days;
use crate::io::layout::{Statement, StatementSource, StreamFacts, TimeUnit};
use crate::io::streams::frames::{FileTime, Frames, OpenStream, Sheet, Wanted};
use crate::io::streams::lines::{TextLines, cells as split};
use crate::io::streams::numbers::{is_sum, pascals, unit};

/// A load may differ from the sum of cells by this share of it, and by this many N.
const LOAD_TOLERANCE: [f64; 2] = [0.01, 0.5];

/// Areas are printed in cm^2 with two decimals.
const AREA_TOLERANCE: [f64; 2] = [2e-3, 0.01];

/// A sensor of the file.
#[derive(Debug, Clone, PartialEq)]
struct Sensor {
    name: String,
    shape: [usize; 2],
    /// Height and width of a cell, in m.
    pitch: [f64; 2],
    /// The area of all its cells, in m^2.
    area: Option<f64>,
}

impl Sensor {
    /// Compares the area with that of the cells, of which some may be no sensors.
    fn area_note(&self, lines: &TextLines) -> Result<Option<Statement>, IoError> {
        let Some(area) = self.area else { return Ok(None) };
        let (cell, count) = (self.pitch[0] * self.pitch[1], self.shape[0] * self.shape[1]);
        let [stated, all] = [area, cell * count as f64].map(|area| 1e4 * area);
        if stated > all && !is_sum(stated, all, AREA_TOLERANCE[1], AREA_TOLERANCE[0]) {
            let needed = format!("at most {all:.2} cm2, that of {count} cells");
            return Err(lines.at().invalid(format!("a Total Area of {stated} cm2 of {}", self.name), needed));
        }
        // Rounded to cells.
        let none = count as f64 - (area / cell).round();
        let value = format!(
            "{none} of {count} cells are no sensors, by the Total Area of {stated:.2} cm2; the file does not state which: \
             those that read 0 in all frames are among them"
        );
        Ok((none > 0.0).then(|| Statement::new("cells without a sensor", value, StatementSource::Checked)))
    }
}

/// The reader, which stands before a frame.
struct Xsensor {
    lines: TextLines,
    sensor: Sensor,
    unit: String,
    frame: Option<u64>,
    /// Midnights that have passed since the first frame.
    day: i64,
    /// The text of the last date, and its days since 1970 if it has any.
    date: Option<(String, Option<i64>)>,
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
    Date(String),
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
            Item::Time(_) | Item::Date(_) => {}
            Item::End => break,
            Item::Block(Block { sensor, .. }) => match sensors.iter().find(|known| known.name == sensor.name)
            {
                Some(known) if known.shape == sensor.shape && known.pitch == sensor.pitch => {}
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
    notes.extend(sensor.area_note(&lines)?);
    notes.push(Statement::new("sensor", &sensor.name, StatementSource::File));
    let stated = threshold.map(|x| Statement::new("threshold", format!("{x} {unit}"), StatementSource::File));
    notes.extend(stated);
    notes.push(Sheet::pitch_note(sensor.pitch));
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
    let source = Xsensor {
        lines,
        sensor,
        unit,
        frame: None,
        day: 0,
        date: None,
        first: None,
        last: 0.0,
        loads: 0,
        absent: 0,
    };
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
            "Date" => return Ok(Item::Date(value)),
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

/// Days since 1970 of `2026 Jan 31` or `2026-01-31`.
fn days_of(text: &str) -> Option<i64> {
    const MONTHS: [&str; 12] =
        ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"];
    let mut parts = text.split([' ', '-', '/']).filter(|part| !part.is_empty());
    let (year, month, day) = (parts.next()?, parts.next()?.to_ascii_lowercase(), parts.next()?);
    let named = MONTHS.iter().position(|name| month.starts_with(name)).map(|k| format!("{:02}", k + 1));
    (year.len() == 4 && parts.next().is_none()).then_some(())?;
    days(&format!("{year}-{}-{day}", named.unwrap_or(month)))
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
    let (mut shape, mut pitch, mut load, mut total) = ([0_usize; 2], [f64::NAN; 2], None, None);
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
            // The square of cm is written in several encodings.
            _ if key.starts_with("Total Area (cm") => total = Some(1e-4 * number()?),
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
    Ok(Block { sensor: Sensor { name, shape, pitch, area: total }, load, cells })
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
    /// Counts the days from the last date to this one.
    fn take_date(&mut self, text: String) -> Result<(), IoError> {
        let days = days_of(&text);
        match &self.date {
            Some((last, _)) if *last == text => return Ok(()),
            Some((_, Some(last))) if days.is_some() => self.day += days.unwrap_or_default() - last,
            Some((last, _)) => {
                let found = format!("the date {} after {}", excerpt(&text), excerpt(last));
                return Err(self
                    .lines
                    .at()
                    .invalid(found, "dates as 2026 Jan 31, whose days can be counted"));
            }
            None => {}
        }
        self.date = Some((text, days));
        Ok(())
    }

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
    fn read(&mut self, cells: &mut Vec<f64>, time: &mut FileTime) -> Result<bool, IoError> {
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
                Item::Date(text) => self.take_date(text)?,
                Item::Time(seconds) => {
                    // After midnight, where dates do not say so.
                    let has_days = matches!(self.date, Some((_, Some(_))));
                    if seconds + 43_200.0 < self.last && !has_days {
                        self.day += 1;
                    }
                    self.last = seconds;
                    let first = *self.first.get_or_insert(seconds);
                    *time = FileTime::Real(86_400.0 * self.day as f64 + seconds - first);
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
