//! JSON lines of the server of XELA sensors: a message a line with a block for each sensor, whose data are hexadecimal
//! numbers of 16 bits, x, y and z of each taxel.

use std::path::Path;

use serde_json::{Map, Value};

use crate::io::IoError;
use crate::io::file::excerpt;
use crate::io::layout::{Statement, StatementSource, StreamFacts, TimeUnit};
use crate::io::streams::frames::{FileTime, Frames, OpenStream, Wanted};
use crate::io::streams::lines::TextLines;

/// The most lines without data, as the welcome of the server.
const MOST_GREETINGS: usize = 1000;

struct Xela {
    lines: TextLines,
    sensor: String,
    about: XelaAbout,
    /// The number of the last message, and how many are missing.
    message: Option<i64>,
    lost: i64,
}

/// What each block of a sensor repeats.
#[derive(Debug, Clone, PartialEq)]
struct XelaAbout {
    taxels: usize,
    model: String,
}

pub(super) fn open(path: &Path, wanted: Wanted<'_>) -> Result<OpenStream, IoError> {
    let mut lines = TextLines::open(path)?;
    let mut greetings = 0;
    let message = loop {
        let Some(message) = next_message(&mut lines)? else {
            return Err(lines.ended("at least one message with data of a sensor"));
        };
        if blocks(&message).next().is_some() {
            break message;
        }
        greetings += 1;
        if greetings > MOST_GREETINGS {
            return Err(lines.at().invalid(format!("{greetings} messages without data"), "data of a sensor"));
        }
    };
    let mut streams = Vec::new();
    for (name, block) in blocks(&message) {
        streams.push((name.clone(), vec![about_of(&lines, name, block)?.taxels, 3]));
    }
    let place = wanted.choose(path, &streams)?;
    let (sensor, cells) = streams.swap_remove(place);
    let block = message.get(&sensor).and_then(Value::as_object).cloned().unwrap_or_default();
    let about = about_of(&lines, &sensor, &block)?;
    let mut notes = vec![Statement::new("sensor", &about.model, StatementSource::File)];
    if block.get("calibrated").is_some_and(|calibrated| !calibrated.is_null()) {
        let value = "raw numbers are read; the file has calibrated ones, too";
        notes.push(Statement::new("calibrated", value, StatementSource::File));
    }
    let facts = StreamFacts {
        stream: sensor.clone(),
        cells,
        usual_axes: vec!["taxel", "component"],
        time_names: vec!["time".into()],
        time_unit: Some(TimeUnit::Seconds),
        notes,
        ..StreamFacts::default()
    };
    let mut frames = 1;
    while lines.advance_to_content()? {
        frames += u64::from(lines.bytes().windows(6).any(|word| word == b"\"data\""));
    }
    let source = Xela { lines: TextLines::open(path)?, sensor, about, message: None, lost: 0 };
    Ok(OpenStream { facts, frames: Some(frames), sheet: None, source: Box::new(source) })
}

impl XelaAbout {
    fn describe(&self) -> String {
        let model = if self.model.is_empty() { "without a model" } else { &self.model };
        format!("{} taxels of the sensor {model}", self.taxels)
    }
}

type Message = Map<String, Value>;

fn next_message(lines: &mut TextLines) -> Result<Option<Message>, IoError> {
    if !lines.advance_to_content()? {
        return Ok(None);
    }
    let message = serde_json::from_slice(lines.bytes());
    message.map(Some).map_err(|e| lines.at().invalid(e.to_string(), "a message as one JSON object"))
}

/// The blocks of sensors.
fn blocks(message: &Message) -> impl Iterator<Item = (&String, &Message)> {
    let blocks = message.iter().filter_map(|(name, value)| Some((name, value.as_object()?)));
    blocks.filter(|(_, block)| block.contains_key("data"))
}

fn about_of(lines: &TextLines, name: &str, block: &Message) -> Result<XelaAbout, IoError> {
    let taxels = block.get("taxels").and_then(Value::as_u64).filter(|n| (1..=1 << 16).contains(n));
    let taxels = taxels.and_then(|taxels| usize::try_from(taxels).ok());
    let taxels = taxels.ok_or_else(|| {
        lines.at().invalid_part(format!("sensor {name}"), "no number of taxels", "`taxels`, 1 to 65536")
    })?;
    let model = block.get("model").and_then(Value::as_str).unwrap_or_default();
    Ok(XelaAbout { taxels, model: model.into() })
}

impl Frames for Xela {
    fn read(&mut self, cells: &mut Vec<f64>, time: &mut FileTime) -> Result<bool, IoError> {
        cells.clear();
        loop {
            let Some(message) = next_message(&mut self.lines)? else { return Ok(false) };
            let (lines, name) = (&self.lines, &self.sensor);
            let part = || format!("sensor {name}");
            let wrong = |found: String, needed: String| Err(lines.at().invalid_part(part(), found, needed));
            let Some(number) = message.get("message").and_then(Value::as_i64) else {
                match blocks(&message).next() {
                    None => continue,
                    Some(_) => return wrong("no number of the message".into(), "`message`".into()),
                }
            };
            if let Some(last) = self.message {
                if number <= last {
                    return wrong(
                        format!("message {number} after {last}"),
                        "ascending numbers of messages".into(),
                    );
                }
                self.lost = self.lost.saturating_add(number.saturating_sub(last).saturating_sub(1));
            }
            self.message = Some(number);
            let Some(block) = message.get(name).and_then(Value::as_object) else {
                let found = "no block of the sensor".to_owned();
                return wrong(found, format!("its data in each message, of {} taxels", self.about.taxels));
            };
            let about = about_of(lines, name, block)?;
            if about != self.about {
                return wrong(
                    about.describe(),
                    format!("{}, as in the messages before", self.about.describe()),
                );
            }
            let seconds = message.get("time").and_then(Value::as_f64);
            *time = FileTime::Real(seconds.ok_or_else(|| lines.at().invalid("no time", "`time` in s"))?);
            let data = block.get("data").and_then(Value::as_str).unwrap_or_default();
            for word in data.split(',') {
                let digits = word.trim();
                let is_whole = digits.len() == 4 && digits.bytes().all(|b| b.is_ascii_hexdigit());
                let value = u16::from_str_radix(digits, 16).ok().filter(|_| is_whole);
                let value = value.ok_or_else(|| {
                    lines.at().invalid_part(part(), excerpt(word), "four hexadecimal digits")
                })?;
                cells.push(f64::from(value));
            }
            return match cells.len() {
                found if found == 3 * about.taxels => Ok(true),
                found => {
                    wrong(format!("{found} numbers"), format!("{}, three for each taxel", 3 * about.taxels))
                }
            };
        }
    }

    fn statements(&self) -> Vec<Statement> {
        let value = format!("{} messages, by their numbers; not filled", self.lost);
        let stated =
            (self.lost > 0).then(|| Statement::new("lost messages", value, StatementSource::Checked));
        stated.into_iter().collect()
    }
}
