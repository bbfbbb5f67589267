//! Tekscan `.asf` and `.csv`: a header of keys, then frames of rows of cells between commas; `B` is a cell without a sensor.
//! A file of raw counts may have the sum of each frame and one of pressures its force, which are compared.

use std::collections::BTreeMap;
use std::path::Path;

use crate::io::IoError;
use crate::io::file::excerpt;
use crate::io::layout::{Statement, StatementSource, StreamFacts, TimeUnit};
use crate::io::streams::frames::{FileTime, Frames, OpenStream, Sheet, Wanted};
use crate::io::streams::lines::{TextLines, cells as split, number};
use crate::io::streams::numbers::{is_interval, is_sum, length, pascals, unit};

/// Keys of the header that are stated as they are.
const NOTES: [(&str, &str); 6] = [
    ("SENSOR_TYPE", "sensor"),
    ("SATURATION_PRESSURE", "saturates at"),
    ("NOISE_THRESHOLD", "noise threshold"),
    ("CALIBRATION_POINT_1", "calibration"),
    ("SENSITIVITY", "sensitivity"),
    ("TIME", "recorded"),
];

pub(super) struct Tekscan {
    lines: TextLines,
    shape: [usize; 2],
    /// Whether there is a sensor in each cell; empty before the first frame.
    sensors: Vec<bool>,
    seconds_per_frame: f64,
    /// Numbers of the first and the last frame, as the header has them.
    numbers: Option<[u64; 2]>,
    is_raw: bool,
    /// The force of a cell with a pressure of 1, in N; `None` if the unit is none of pressure.
    cell_newtons: Option<f64>,
    /// The first frame, which is read at once.
    first: Option<(Vec<f64>, FileTime)>,
    last: Option<u64>,
    frames: u64,
    sums: u64,
    has_ended: bool,
}

type TekscanHeader = BTreeMap<String, String>;

pub(super) fn open(path: &Path, wanted: Wanted<'_>) -> Result<OpenStream, IoError> {
    let mut lines = TextLines::open(path)?;
    let header = read_header(&mut lines)?;
    let need = |key: &str| {
        let needed = format!("a line {key}");
        header.get(key).map(String::as_str).ok_or_else(|| lines.at().invalid("the end of the header", needed))
    };
    let whole = |key: &str, most: usize| {
        let text = need(key)?;
        let number = text.parse().ok().filter(|n| (1..=most).contains(n));
        number.ok_or_else(|| lines.at().invalid(format!("{key} {}", excerpt(text)), format!("1 to {most}")))
    };
    let shape = [whole("ROWS", 1 << 12)?, whole("COLS", 1 << 12)?];
    wanted.choose(path, &[(String::new(), shape.to_vec())])?;
    let pitch = [length(&lines, need("ROW_SPACING")?)?, length(&lines, need("COL_SPACING")?)?];
    if let Some(area) = header.get("SENSEL_AREA") {
        check_area(&lines, area, pitch)?;
    }
    let unit = unit(need("UNITS")?);
    let seconds_per_frame =
        lines.number(need("SECONDS_PER_FRAME")?.as_bytes(), || "SECONDS_PER_FRAME".into())?;
    if !is_interval(seconds_per_frame) {
        let needed = "the seconds from a frame to the next, as 0.01";
        return Err(lines.at().invalid(format!("SECONDS_PER_FRAME {seconds_per_frame}"), needed));
    }
    let number = |key: &str| header.get(key).and_then(|text| text.parse::<u64>().ok());
    let numbers = number("START_FRAME").zip(number("END_FRAME")).map(|(first, last)| [first, last]);
    if let Some([first, last]) = numbers.filter(|[first, last]| first > last) {
        let needed = "a last frame that is not before the first";
        return Err(lines.at().invalid(format!("START_FRAME {first} and END_FRAME {last}"), needed));
    }
    let is_mirrored = |key: &str| header.get(key).is_some_and(|value| value != "0");
    let notes = NOTES
        .iter()
        .filter_map(|(key, what)| Some(Statement::new(*what, header.get(*key)?, StatementSource::File)));
    let mut notes: Vec<Statement> = notes.collect();
    notes.push(Sheet::pitch_note(pitch));
    let mut reader = Tekscan {
        is_raw: unit == "raw",
        cell_newtons: pascals(&unit).map(|pascals| pascals * pitch[0] * pitch[1]),
        lines,
        shape,
        sensors: Vec::new(),
        seconds_per_frame,
        numbers,
        first: None,
        last: None,
        frames: 0,
        sums: 0,
        has_ended: false,
    };
    let (mut cells, mut time) = (Vec::new(), FileTime::None);
    if !reader.read_frame(&mut cells, &mut time)? {
        return Err(reader.lines.ended("at least one frame"));
    }
    reader.sensors = cells.iter().map(|x| !x.is_nan()).collect();
    let dead = reader.sensors.iter().filter(|sensor| !**sensor).count();
    notes.push(Statement::new("cells without a sensor", dead.to_string(), StatementSource::File));
    reader.first = Some((cells, time));
    let facts = StreamFacts {
        cells: shape.to_vec(),
        usual_axes: vec!["row", "col"],
        units: vec![unit],
        rate_hz: Some(1.0 / seconds_per_frame),
        time_names: vec!["frames".into(), "time".into()],
        time_unit: Some(TimeUnit::Seconds),
        sensors: reader.sensors.clone(),
        threshold: header.get("NOISE_THRESHOLD").and_then(|text| text.parse().ok()),
        has_pressures: true,
        may_be_mirrored: is_mirrored("MIRROR_ROW") || is_mirrored("MIRROR_COL"),
        notes,
        ..StreamFacts::default()
    };
    Ok(OpenStream {
        sheet: Some(Sheet::grid(shape, pitch, &reader.sensors)),
        facts,
        frames: numbers.map(|[first, last]| (last - first).saturating_add(1)),
        source: Box::new(reader),
    })
}

/// The keys of the header, up to the data.
fn read_header(lines: &mut TextLines) -> Result<TekscanHeader, IoError> {
    let mut header = TekscanHeader::new();
    while lines.advance()? {
        let text = lines.text();
        if text.starts_with("ASCII_DATA") {
            return Ok(header);
        }
        let (key, value) = text.split_once(char::is_whitespace).unwrap_or((&text, ""));
        header.entry(key.trim_end_matches(':').into()).or_insert_with(|| value.trim().into());
        lines.check_header("ASCII_DATA")?;
    }
    Err(lines.ended("a line ASCII_DATA"))
}

/// Refuses an area of a cell that is not the product of its sides, in m.
fn check_area(lines: &TextLines, text: &str, pitch: [f64; 2]) -> Result<(), IoError> {
    /// Areas are printed with four digits at least.
    const TOLERANCE: f64 = 2e-3;
    let (number, unit) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    let of_unit = match unit.trim() {
        "mm2" | "mm\u{b2}" => 1e-6,
        "cm2" | "cm\u{b2}" => 1e-4,
        "in2" => 0.0254 * 0.0254,
        "m2" => 1.0,
        _ => return Ok(()),
    };
    let stated = lines.number(number.as_bytes(), || "SENSEL_AREA".into())? * of_unit;
    let product = pitch[0] * pitch[1];
    if is_sum(stated, product, 0.0, TOLERANCE) {
        return Ok(());
    }
    let needed = format!("{:.6} mm2, the product of ROW_SPACING and COL_SPACING", 1e6 * product);
    Err(lines.at().invalid(format!("SENSEL_AREA {text}"), needed))
}

impl Tekscan {
    /// Reads a frame from its title on; false at the end of the data.
    fn read_frame(&mut self, cells: &mut Vec<f64>, time: &mut FileTime) -> Result<bool, IoError> {
        if self.has_ended || !self.lines.advance_to_content()? || self.lines.bytes().starts_with(b"@@") {
            if !std::mem::replace(&mut self.has_ended, true) && self.lines.advance_to_content()? {
                let needed = "the end of the file behind @@: write a file for each export";
                return Err(self.lines.at().invalid(excerpt(&self.lines.text()), needed));
            }
            return self.check_count().map(|()| false);
        }
        let [sum, force] = self.read_title(time)?;
        cells.clear();
        for row in 0..self.shape[0] {
            if !self.lines.advance()? {
                return Err(self.lines.ended(&format!("row {row} of {} of the frame", self.shape[0])));
            }
            self.read_row(row, cells)?;
        }
        if let Some(stated) = sum.filter(|_| self.is_raw) {
            let found: f64 = cells.iter().filter(|x| !x.is_nan()).sum();
            if !is_sum(found, stated, 0.5, 0.0) {
                let frame = self.last.unwrap_or_default();
                let needed = format!("{stated}, the Raw Sum of the frame");
                return Err(self.lines.at().invalid_part(
                    format!("frame {frame}"),
                    format!("cells of the sum {found}"),
                    needed,
                ));
            }
            self.sums += 1;
        }
        if let Some((stated, newtons)) = force.zip(self.cell_newtons) {
            /// A force is printed with three digits at least.
            const TOLERANCE: f64 = 5e-3;
            let found = newtons * cells.iter().filter(|x| !x.is_nan()).sum::<f64>();
            if !is_sum(found, stated, 0.05, TOLERANCE) {
                let part = format!("frame {}", self.last.unwrap_or_default());
                let needed = format!("{stated} N, the force in its title");
                return Err(self.lines.at().invalid_part(
                    part,
                    format!("cells that are {found:.3} N"),
                    needed,
                ));
            }
            self.sums += 1;
        }
        self.frames += 1;
        Ok(true)
    }

    /// Reads `Frame 41, 4.04,, DATE,,,Raw Sum=,,823`, and gives the raw sum and the force, in N, that there are.
    fn read_title(&mut self, time: &mut FileTime) -> Result<[Option<f64>; 2], IoError> {
        let (lines, line) = (&self.lines, self.lines.bytes());
        let wrong = |needed: String| lines.at().invalid(excerpt(&String::from_utf8_lossy(line)), needed);
        let mut parts = split(line, b',');
        let title = parts.next().and_then(|title| title.strip_prefix(b"Frame"));
        let frame = title.and_then(|title| std::str::from_utf8(title.trim_ascii()).ok()?.parse::<u64>().ok());
        let frame = frame.ok_or_else(|| wrong("`Frame` and its number, or @@ at the end".into()))?;
        let next = self.last.map(|last| last.saturating_add(1)).or(self.numbers.map(|[first, _]| first));
        if next.is_some_and(|next| next != frame) {
            return Err(wrong(format!("frame {}: none is left out", next.unwrap_or_default())));
        }
        self.last = Some(frame);
        let stated = parts.next().and_then(number);
        *time = FileTime::Real(stated.unwrap_or(self.frames as f64 * self.seconds_per_frame));
        let of_name = |name: &[u8]| {
            let mut cells = split(line, b',').skip_while(|cell| !cell.starts_with(name));
            let (head, rest) = (cells.next()?, cells.find(|cell| !cell.is_empty()));
            let own = head.iter().position(|&b| b == b'=').map(|at| head[at + 1..].trim_ascii());
            Some(own.filter(|own| !own.is_empty()).or(rest).and_then(number))
        };
        let mut found = [None; 2];
        for (found, name) in found.iter_mut().zip(["Raw Sum", "Force"]) {
            *found = match of_name(name.as_bytes()) {
                None => None,
                Some(Some(number)) => Some(number),
                Some(None) => return Err(wrong(format!("a number after {name}"))),
            };
        }
        Ok(found)
    }

    fn read_row(&self, row: usize, cells: &mut Vec<f64>) -> Result<(), IoError> {
        let (lines, cols, start) = (&self.lines, self.shape[1], cells.len());
        if lines.bytes().trim_ascii().is_empty() || lines.bytes().starts_with(b"Frame") {
            let needed = format!("{cols} cells in row {row} of {}", self.shape[0]);
            return Err(lines.at().invalid("the end of a frame", needed));
        }
        for (k, cell) in split(lines.bytes(), b',').enumerate() {
            if k >= cols {
                if cell.is_empty() {
                    continue;
                }
                let found = format!("more than {cols} cells in row {row}");
                return Err(lines
                    .at()
                    .invalid(found, format!("{cols}, numbers with a decimal point between commas")));
            }
            let is_dead = cell == b"B";
            let place = start + k;
            let was_dead = self.sensors.get(place).map(|sensor| !sensor);
            if was_dead.is_some_and(|was| was != is_dead) {
                let found = format!("{} in column {}", excerpt(&String::from_utf8_lossy(cell)), k + 1);
                return Err(lines.at().invalid(found, "a sensor or none in a cell, the same in all frames"));
            }
            cells.push(if is_dead {
                f64::NAN
            } else {
                lines.number(cell, || format!("column {}", k + 1))?
            });
        }
        match cells.len() - start {
            found if found == cols => Ok(()),
            found => {
                let needed = format!("{cols} in row {row} of {}", self.shape[0]);
                Err(lines.at().invalid(format!("{found} cells"), needed))
            }
        }
    }

    /// Refuses fewer frames than the header states.
    fn check_count(&self) -> Result<(), IoError> {
        let Some([first, last]) = self.numbers else { return Ok(()) };
        let needed = (last - first).saturating_add(1);
        if self.frames == needed {
            return Ok(());
        }
        let needed = format!("{needed}, from START_FRAME {first} to END_FRAME {last}");
        Err(self.lines.at().invalid(format!("{} frames", self.frames), needed))
    }
}

impl Frames for Tekscan {
    fn read(&mut self, cells: &mut Vec<f64>, time: &mut FileTime) -> Result<bool, IoError> {
        match self.first.take() {
            Some(first) => {
                (*cells, *time) = first;
                Ok(true)
            }
            None => self.read_frame(cells, time),
        }
    }

    fn statements(&self) -> Vec<Statement> {
        let what = if self.is_raw { "Raw Sum" } else { "force" };
        let value = format!("the {what} of {} frames is that of their cells", self.sums);
        let stated = (self.sums > 0).then(|| Statement::new("sums", value, StatementSource::Checked));
        stated.into_iter().collect()
    }
}
