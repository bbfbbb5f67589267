//! novel `.asc` of pedar insoles and pliance mats: a head, a line of ids, a row of times and pressures for each frame. pliance
//! has then the force of each frame, which is compared, and corners, centre and area of each sensor.

use std::path::Path;

use glam::DVec3;

use crate::io::IoError;
use crate::io::file::excerpt;
use crate::io::layout::{Statement, StatementSource, StreamFacts, TimeUnit};
use crate::io::streams::frames::{FileTime, Frames, OpenStream, Sheet, Wanted};
use crate::io::streams::lines::{TextLines, number, words};
use crate::io::streams::numbers::{is_sum, pascals, unit};
use crate::skin::TaxelId;

/// A force may differ from the sum of cells by this share of it, and by this many N.
const FORCE_TOLERANCE: [f64; 2] = [2e-3, 0.02];

/// Times of a frame in two tables are printed with five decimals.
const TIME_TOLERANCE: f64 = 2e-5;

/// The head of a file.
#[derive(Debug, Default)]
struct Head {
    is_mat: bool,
    sensor: String,
    unit: String,
    rate_hz: Option<f64>,
    /// Sensors of the left and of the right insole, if the file lists them.
    insoles: [Option<usize>; 2],
    ids: Vec<u32>,
}

/// What stands after the frames.
#[derive(Debug, Default)]
struct Tail {
    /// Time and force of each frame, in s and N.
    forces: Vec<[f64; 2]>,
    /// Centres, in cm, and areas, in cm^2.
    x: Vec<f64>,
    y: Vec<f64>,
    areas: Vec<f64>,
}

struct Novel {
    lines: TextLines,
    unit: String,
    width: usize,
    tail: Tail,
    frames: usize,
    checked: u64,
}

pub(super) fn open(path: &Path, wanted: Wanted<'_>) -> Result<OpenStream, IoError> {
    let mut lines = TextLines::open(path)?;
    let head = read_head(&mut lines)?;
    let (cells, usual_axes) = cells_of(&lines, &head)?;
    wanted.choose(path, &[(String::new(), cells.clone())])?;
    let mut frames = 0;
    while lines.advance()? && is_frame(&lines) {
        frames += 1;
    }
    if frames == 0 {
        return Err(lines.at().invalid("no frame", "at least one row of a time and pressures"));
    }
    lines.hold();
    let tail = read_tail(&mut lines, head.ids.len())?;
    if !tail.forces.is_empty() && tail.forces.len() != frames {
        let needed = format!("{frames}, one for each frame");
        return Err(lines.at().invalid(format!("forces of {} frames", tail.forces.len()), needed));
    }
    let sheet = (!tail.x.is_empty() && !tail.areas.is_empty()).then(|| Sheet {
        ids: head.ids.iter().map(|&id| TaxelId(id)).collect(),
        centres: tail.x.iter().zip(&tail.y).map(|(x, y)| 1e-2 * DVec3::new(*x, *y, 0.0)).collect(),
        areas: tail.areas.iter().map(|area| 1e-4 * area).collect(),
    });
    let mut notes = vec![Statement::new("sensor", head.sensor, StatementSource::File)];
    let feet = match head.insoles {
        _ if head.is_mat || cells.len() > 1 => None,
        [Some(_), None] => Some(("left, by its list of sensors", StatementSource::File, 1)),
        // Taxels of a right foot follow those of a left one.
        [None, Some(count)] => Some(("right, by its list of sensors", StatementSource::File, count + 1)),
        _ => Some(("not stated; taxels from 1 on, as of a left one", StatementSource::Checked, 1)),
    };
    notes.extend(feet.map(|(foot, source, _)| Statement::new("foot", foot, source)));
    let facts = StreamFacts {
        first_id: feet.and_then(|(.., first)| u32::try_from(first).ok()),
        ids: head.is_mat.then(|| head.ids.iter().map(|&id| TaxelId(id)).collect()),
        cells,
        usual_axes,
        units: vec![head.unit.clone()],
        rate_hz: head.rate_hz,
        time_names: vec!["time[secs]".into(), "time".into(), "frames".into()],
        time_unit: Some(TimeUnit::Seconds),
        has_pressures: true,
        notes,
        ..StreamFacts::default()
    };
    let mut lines = TextLines::open(path)?;
    read_head(&mut lines)?;
    let source = Novel { lines, unit: head.unit, width: head.ids.len(), tail, frames: 0, checked: 0 };
    Ok(OpenStream { facts, frames: Some(frames as u64), sheet, source: Box::new(source) })
}

/// Reads up to the line of ids.
fn read_head(lines: &mut TextLines) -> Result<Head, IoError> {
    let mut head = Head::default();
    while lines.advance_to_content()? {
        let text = lines.text();
        let wrong = |needed: &str| lines.at().invalid(excerpt(&text), needed);
        for (key, is_mat) in [("mat type", true), ("sensor type", false)] {
            if let Some(sensor) = text.strip_prefix(key) {
                (head.is_mat, head.sensor) = (is_mat, sensor.trim_start_matches(':').trim().into());
            }
        }
        if let Some((_, value)) = text.split_once("pressure values in") {
            head.unit = unit(value);
        }
        if let Some((_, rate)) = text.split_once("scanning rate [Hz]:") {
            let rate = number(rate.trim().as_bytes()).filter(|hz| *hz > 0.0);
            head.rate_hz = Some(rate.ok_or_else(|| wrong("a rate above 0 Hz, with a decimal point"))?);
        }
        for (foot, key) in ["left insole:", "right insole:"].iter().enumerate() {
            if let Some(list) = text.get(key.len()..).filter(|_| text[..key.len()].eq_ignore_ascii_case(key))
            {
                head.insoles[foot] = Some(list.split(',').filter(|id| !id.trim().is_empty()).count());
            }
        }
        if let Some(ids) = text.strip_prefix("time[secs]") {
            let ids: Option<Vec<u32>> = ids.split_whitespace().map(|id| id.parse().ok()).collect();
            head.ids = ids.filter(|ids| !ids.is_empty()).ok_or_else(|| wrong("the numbers of sensors"))?;
            if pascals(&head.unit).is_none() {
                let needed = "a line `pressure values in` with a unit of pressure above it";
                return Err(lines.at().invalid(format!("the unit {}", excerpt(&head.unit)), needed));
            }
            return Ok(head);
        }
        lines.check_header("time[secs]")?;
    }
    Err(lines.ended("a line time[secs]"))
}

/// The shape of a frame: the sensors of a mat, or those of one insole or of two that are numbered alike.
fn cells_of(lines: &TextLines, head: &Head) -> Result<(Vec<usize>, Vec<&'static str>), IoError> {
    let ids = &head.ids;
    let refuse =
        |needed: String| Err(lines.at().invalid(format!("{} columns of sensors", ids.len()), needed));
    let is_ascending = |ids: &[u32]| ids.windows(2).all(|pair| pair[0] < pair[1]);
    let (left, right) = ids.split_at(ids.len() / 2);
    if head.is_mat {
        let mut sorted = ids.clone();
        sorted.sort_unstable();
        return match is_ascending(&sorted) {
            true => Ok((vec![ids.len()], vec!["taxel"])),
            false => refuse("a number of its own for each sensor".into()),
        };
    }
    match (left == right && is_ascending(left), is_ascending(ids), head.insoles) {
        (true, _, [None, None]) => Ok((vec![2, left.len()], vec!["foot", "taxel"])),
        (true, _, [Some(l), Some(r)]) if l == r && l == left.len() => Ok((vec![2, l], vec!["foot", "taxel"])),
        (_, true, [Some(one), None] | [None, Some(one)]) if one == ids.len() => {
            Ok((vec![one], vec!["taxel"]))
        }
        (_, true, [None, None]) => Ok((vec![ids.len()], vec!["taxel"])),
        (.., [l, r]) => {
            let [l, r] = [l, r].map(|count| count.map_or("none".to_owned(), |count| count.to_string()));
            refuse(format!(
                "those of the left insole ({l}), then those of the right one ({r}), as the head states"
            ))
        }
    }
}

/// Whether the line is that of a frame, and not one of means (`MPP`) or blank.
fn is_frame(lines: &TextLines) -> bool {
    words(lines.bytes()).next().is_some_and(|word| word[0].is_ascii_digit())
}

fn read_tail(lines: &mut TextLines, width: usize) -> Result<Tail, IoError> {
    let mut tail = Tail::default();
    let mut is_in_forces = false;
    while lines.advance_to_content()? {
        let mut all = words(lines.bytes());
        let first = all.next().unwrap_or_default();
        let rest: Vec<&[u8]> = all.collect();
        let is_row = !first.first().is_some_and(u8::is_ascii_alphabetic);
        if is_row && !is_in_forces {
            let needed = "frames without other lines between them, then MPP or the table of forces";
            return Err(lines.at().invalid(excerpt(&lines.text()), needed));
        }
        match (first, rest.first().copied()) {
            (b"time[secs]", Some(b"force[N]")) => is_in_forces = true,
            (b"sensor", _) => is_in_forces = false,
            (time, Some(force)) if is_in_forces => {
                let of = |word| lines.number(word, || "the force".into());
                tail.forces.push([of(time)?, of(force)?]);
            }
            (name @ (b"x[c]" | b"y[c]" | b"area"), _) => {
                let name = String::from_utf8_lossy(name).into_owned();
                let numbers =
                    rest.iter().enumerate().map(|(k, word)| lines.number(word, || format!("{name} {k}")));
                let numbers = numbers.collect::<Result<Vec<_>, _>>()?;
                if numbers.len() != width {
                    let needed = format!("{width}, one for each sensor");
                    return Err(lines.at().invalid(format!("{} numbers of {name}", numbers.len()), needed));
                }
                match name.as_str() {
                    "x[c]" => tail.x = numbers,
                    "y[c]" => tail.y = numbers,
                    _ => tail.areas = numbers,
                }
            }
            _ => {}
        }
    }
    if tail.x.len() != tail.y.len() {
        return Err(lines.ended("y[c] next to x[c]"));
    }
    Ok(tail)
}

impl Novel {
    /// Refuses a force that is not that of the pressures.
    fn check_force(&mut self, cells: &[f64], time: f64) -> Result<(), IoError> {
        let Some(&[at, stated]) = self.tail.forces.get(self.frames) else { return Ok(()) };
        let (areas, frame) = (&self.tail.areas, self.frames);
        let wrong =
            |found, needed| Err(self.lines.at().invalid_part(format!("frame {frame}"), found, needed));
        if (at - time).abs() > TIME_TOLERANCE {
            return wrong(format!("the force of the time {at} s"), format!("one for {time} s"));
        }
        if areas.is_empty() {
            return Ok(());
        }
        let pascals = pascals(&self.unit).unwrap_or(f64::NAN);
        let newtons = cells.iter().zip(areas).map(|(p, area)| p * pascals * 1e-4 * area).sum::<f64>();
        if is_sum(newtons, stated, FORCE_TOLERANCE[1], FORCE_TOLERANCE[0]) {
            self.checked += 1;
            return Ok(());
        }
        let found = format!("pressures that are {newtons:.3} N in {}", self.unit);
        wrong(found, format!("{stated} N, the force[N] of the frame"))
    }
}

impl Frames for Novel {
    fn read(&mut self, cells: &mut Vec<f64>, time: &mut FileTime) -> Result<bool, IoError> {
        if !self.lines.advance()? || !is_frame(&self.lines) {
            return Ok(false);
        }
        cells.clear();
        let mut seconds = f64::NAN;
        for (k, word) in words(self.lines.bytes()).enumerate() {
            let value = self.lines.number(word, || format!("column {}", k + 1))?;
            if k == 0 { seconds = value } else { cells.push(value) }
        }
        if cells.len() != self.width {
            let needed = format!("{}, one for each sensor", self.width);
            return Err(self.lines.at().invalid(format!("{} pressures", cells.len()), needed));
        }
        self.check_force(cells, seconds)?;
        *time = FileTime::Real(seconds);
        self.frames += 1;
        Ok(true)
    }

    fn statements(&self) -> Vec<Statement> {
        let value = format!("the force of {} frames is that of their pressures", self.checked);
        let stated = (self.checked > 0).then(|| Statement::new("forces", value, StatementSource::Checked));
        stated.into_iter().collect()
    }
}
