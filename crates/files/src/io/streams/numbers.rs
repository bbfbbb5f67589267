//! Lengths and units as vendors write them, and forces that follow from pressures.

use crate::io::IoError;
use crate::io::streams::lines::TextLines;
use crate::signal::{Channel, parse_unit};

/// A length such as `5.08 mm`, in m.
pub(super) fn length(lines: &TextLines, text: &str) -> Result<f64, IoError> {
    let (number, unit) = text.trim().split_once(char::is_whitespace).unwrap_or((text, ""));
    let unit = match unit.trim() {
        "mm" | "millimeters" => 1e-3,
        "cm" | "centimeters" => 1e-2,
        "in" | "inches" => 0.0254,
        "m" | "meters" => 1.0,
        _ => f64::NAN,
    };
    let length = lines.number(number.as_bytes(), || "the length".into())? * unit;
    if length > 0.0 {
        return Ok(length);
    }
    Err(lines.at().invalid(format!("the length {text}"), "a number above 0 and mm, cm, in or m"))
}

/// Whether a number can be the seconds from a frame to the next: a recording has at most a billion frames a second.
pub(super) fn is_interval(seconds: f64) -> bool {
    (1e-9..f64::INFINITY).contains(&seconds)
}

/// A unit as a vendor spells it, as it is known here.
pub(super) fn unit(text: &str) -> String {
    parse_unit(text.trim()).map_or_else(|| text.trim().to_owned(), |unit| unit.name)
}

/// What a pressure of 1 of this unit is in Pa; `None` if it is no unit of pressure.
pub(super) fn pascals(unit: &str) -> Option<f64> {
    Channel::new("pressure", unit).ok()?.newtons()
}

/// Whether a sum is the one that the file states.
pub(super) fn is_sum(found: f64, stated: f64, absolute: f64, relative: f64) -> bool {
    (found - stated).abs() <= absolute + relative * stated.abs()
}
