//! Tables of the response of taxels, `response.csv`: how readings become pressures, and which are faulty.

use std::collections::HashSet;
use std::path::Path;
use std::str::FromStr;

use crate::io::IoError;
use crate::io::error::Result;
use crate::io::file::{Lines, OutPath, Source, excerpt};
use crate::io::table::writer::write_table;
use crate::io::table::{Row, Table};
use crate::signal::{Response, TaxelResponse, TaxelState};
use crate::skin::TaxelId;

/// The columns with a number, in the order of the fields of [`TaxelResponse`].
const NUMBERS: [&str; 5] = ["zero", "gain", "exponent", "drift", "sigma"];

const STATES: &str = "ok, untested, or a fault: saturated, crosstalk, chattering, jumping, noisy, module-step, turned, \
                      swapped, silent, stuck or dead";

/// Reads the responses of taxels, and the names of columns that are not used: columns `taxel_id` (or `id`),
/// `zero`, `gain`, `exponent`, `drift`, `sigma`, `state` and `other`, all but the first and one other may be missing, and
/// empty cells are not known. Lines `# unit: count`, `# channel: pressure`, `# scale: relative` (or `Pa`) and `# method: ...` before the first
/// line are its facts; other lines with `#` are comments.
///
/// # Errors
/// If the file cannot be read, a column is missing, a cell is not what it must be, a gain is 0, an exponent is not
/// positive, a sigma is negative, or a taxel comes twice. Errors name the line.
pub fn read_response(path: &Path) -> Result<(Response, Vec<String>)> {
    let source = Source::open(path)?;
    let mut response = Response::default();
    for (at, line) in source.lines()? {
        let line = line.trim_start_matches('\u{feff}').trim();
        if !line.is_empty() && !line.starts_with('#') {
            break;
        }
        let Some((key, value)) = line.trim_start_matches('#').split_once(':') else { continue };
        let value = value.trim();
        match key.trim() {
            "unit" => value.clone_into(&mut response.unit),
            "channel" => value.clone_into(&mut response.channel),
            "method" => value.clone_into(&mut response.method),
            "scale" => {
                let known =
                    value.parse().map_err(|_| at.invalid_part("scale", excerpt(value), "relative or Pa"));
                response.scale = Some(known?);
            }
            _ => {}
        }
    }
    let mut lines = Lines::new(source.bytes(), path, Some(b'#'));
    lines.advance()?;
    let table = Table::open(lines)?;
    let columns = &table.columns;
    let id = columns.need("taxel_id")?;
    let numbers = NUMBERS.map(|name| columns.find(name));
    let [state, other] = ["state", "other"].map(|name| columns.find(name));
    if numbers.iter().flatten().next().is_none() && state.is_none() {
        let needed = format!("`taxel_id` and one of {} or state", NUMBERS.join(", "));
        return Err(columns.at().invalid(columns.describe(), needed));
    }
    let known = [&["taxel_id", "state", "other"][..], &NUMBERS].concat();
    let unused = columns.unused(&known);
    let mut seen = HashSet::new();
    table.each_row(&mut |row| {
        let taxel = row.taxel(id)?;
        if !seen.insert(taxel) {
            return Err(row.invalid(id, "each taxel once"));
        }
        let number = |k: usize, is_good: fn(f64) -> bool, needed: &str| match numbers[k] {
            Some(column) => match row.number_if_any(column)? {
                Some(x) if !is_good(x) => Err(row.invalid(column, needed)),
                found => Ok(found),
            },
            None => Ok(None),
        };
        response.taxels.push(TaxelResponse {
            taxel,
            zero: number(0, |_| true, "")?,
            gain: number(1, |x| x != 0.0, "a number that is not 0")?,
            exponent: number(2, |x| x > 0.0, "a positive number")?,
            drift: number(3, |_| true, "")?,
            sigma: number(4, |x| x >= 0.0, "a number from 0 on")?,
            state: cell_if_any(&row, state, STATES)?.unwrap_or_default(),
            other: cell_if_any::<u32>(&row, other, "the number of a taxel, 0 to 4294967295")?.map(TaxelId),
        });
        Ok(())
    })?;
    Ok((response, unused))
}

/// What a cell holds; `None` if it is empty.
fn cell_if_any<T: FromStr>(row: &Row<'_>, column: Option<usize>, needed: &str) -> Result<Option<T>> {
    let cell = column.map(|column| (column, row.text(column))).filter(|(_, text)| !text.is_empty());
    cell.map(|(column, text)| text.parse().map_err(|_| row.invalid(column, needed))).transpose()
}

/// Writes the responses of taxels, as [`read_response`] reads them.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
pub fn write_response(path: impl Into<OutPath>, response: &Response) -> Result<(), IoError> {
    let Response { unit, channel, scale, method, taxels } = response;
    let scale = scale.map(|scale| scale.to_string()).unwrap_or_default();
    let facts = [("unit", unit), ("channel", channel), ("scale", &scale), ("method", method)];
    // A fact is one line.
    let facts = facts.into_iter().filter(|(_, value)| !value.is_empty());
    let mut header: String =
        facts.map(|(key, value)| format!("# {key}: {}\n", value.replace(['\n', '\r'], " "))).collect();
    header += "taxel_id,zero,gain,exponent,drift,sigma,state";
    let has_others = taxels.iter().any(|taxel| taxel.other.is_some());
    header += if has_others { ",other" } else { "" };
    write_table(&path.into(), &header, |table| {
        for known in taxels {
            let TaxelResponse { taxel, zero, gain, exponent, drift, sigma, state, other } = *known;
            table.whole(taxel.0);
            [zero, gain, exponent, drift, sigma].into_iter().for_each(|x| table.number_if_any(x));
            table.cell(&TaxelState::to_string(&state));
            match other {
                Some(other) => table.whole(other.0),
                None => table.empty(usize::from(has_others)),
            }
            table.end_row()?;
        }
        Ok(())
    })
}
