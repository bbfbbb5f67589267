//! A layout of what a file states, with null where it does not.

use std::path::Path;

use serde_json::{Map, Value, json};

use crate::io::IoError;
use crate::io::file::invalid;
use crate::io::layout::facts::{StatementSource, StreamFacts};
use crate::io::layout::keys::{Layout, first_null};

/// What takes the place of null.
const HELP: [(&str, &str); 6] = [
    ("axes", "what each axis of the numbers counts: frame, component, and cells as taxel, row, col, pad"),
    ("time", "rate: frames a second; or stream: the name of the times, and unit: s, ms, us or ns"),
    ("channels", "name: pressure, force, shear.x; unit: Pa, kPa, N, count; \"\" if nobody knows the unit"),
    ("press", "raises or lowers: whether pressing makes the numbers larger or smaller"),
    (
        "zero",
        "the number of no touch; {\"first\": N}: the mean of the first N frames; \"taken\": subtracted already",
    ),
    ("taxels", "flip: axes that run the other way, [] for none"),
];

impl Layout {
    /// The text of a layout of what `file` states of a stream: JSON with null where it states nothing.
    pub fn draft(file: &Path, facts: &StreamFacts) -> String {
        let mut json = of_facts(facts);
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        json["about"] = format!("drafted from {name}; replace each null by the value of the sensor").into();
        let open = HELP.iter().filter(|(key, _)| json.get(key).and_then(first_null).is_some());
        let help: Map<String, Value> = open.map(|(key, help)| ((*key).into(), (*help).into())).collect();
        if !help.is_empty() {
            json["note"] = help.into();
        }
        let text = serde_json::to_string_pretty(&json).unwrap_or_default();
        text + "\n"
    }

    /// The layout of a file that states all that is needed.
    pub(in crate::io) fn of_file(file: &Path, facts: &StreamFacts) -> Result<Self, IoError> {
        let mut json = of_facts(facts);
        // What the unit of pressures is changes none of them.
        if facts.has_pressures && json["channels"][0]["unit"].is_null() {
            json["channels"][0]["unit"] = "".into();
        }
        if let Some(path) = first_null(&json) {
            let found = format!("no statement about {path}");
            let needed = "a layout; a draft of one has what the file states";
            return Err(invalid(file, "file", found, needed));
        }
        Self::from_json(file, &json.to_string(), &json, StatementSource::File)
    }
}

fn of_facts(facts: &StreamFacts) -> Value {
    let StreamFacts { cells, units, .. } = facts;
    let stated = facts.axes.iter().map(String::as_str).filter(|axis| *axis != "frame");
    let axes: Vec<&str> = if facts.axes.is_empty() { facts.usual_axes.clone() } else { stated.collect() };
    let name = |k: usize| match (axes.get(k), cells.len()) {
        (Some(axis), _) => json!(axis),
        (None, 1) => json!("taxel"),
        _ => Value::Null,
    };
    let names: Vec<Value> = std::iter::once(json!("frame")).chain((0..cells.len()).map(name)).collect();
    let component = axes.iter().position(|axis| *axis == "component");
    let channel = |k: usize| {
        let unit = units.get(k).or_else(|| units.first().filter(|_| units.len() == 1));
        let name = if facts.has_pressures { json!("pressure") } else { Value::Null };
        let mut channel = json!({"name": name, "unit": unit});
        if component.is_some() {
            channel["component"] = k.into();
        }
        channel
    };
    let count = component.map_or(1, |axis| cells[axis]);
    let shape: Vec<usize> =
        cells.iter().enumerate().filter(|(k, _)| Some(*k) != component).map(|(_, size)| *size).collect();
    let time = match (facts.time_unit, facts.rate_hz) {
        (Some(unit), _) => match facts.time_names.first() {
            Some(name) => json!({"stream": name, "unit": unit.name()}),
            None => json!({"unit": unit.name()}),
        },
        (None, Some(rate)) => json!({"rate": rate}),
        (None, None) => match facts.time_names.first() {
            Some(name) => json!({"stream": name, "unit": null}),
            None => json!({"rate": null}),
        },
    };
    let (press, zero) =
        if facts.has_pressures { (json!("raises"), json!(0)) } else { (Value::Null, Value::Null) };
    let taxels = match (&facts.ids, facts.columns.as_slice()) {
        (Some(_), _) => json!({"ids": "file"}),
        (None, []) => json!({"shape": shape, "first_id": facts.first_id.unwrap_or(1)}),
        (None, [one]) => json!({"columns": one}),
        (None, several) => json!({"columns": several}),
    };
    let mut json = json!({
        "dermatome_layout": 1,
        "axes": names,
        "time": time,
        "channels": (0..count).map(channel).collect::<Vec<_>>(),
        "press": press,
        "zero": zero,
        "taxels": taxels,
    });
    if !facts.stream.is_empty() {
        json["stream"] = facts.stream.as_str().into();
    }
    if facts.may_be_mirrored {
        json["taxels"]["flip"] = Value::Null;
    }
    json
}
