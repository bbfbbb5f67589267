//! Tables of a quantity over time: steps of a pressure, forces.

use std::path::Path;

use crate::io::IoError;
use crate::io::file::Source;
use crate::io::table::{Row, Table};
use crate::signal::unit_ratio;

/// A quantity over time, and the names of columns that are not used.
pub type Series = (Vec<[f64; 2]>, Vec<String>);

/// Reads a table of a quantity over time: a column of times (`time`, or as in `time[ms]`) and one with the name of
/// the quantity, in `unit`, or in the one that it names, as `pressure[kPa]`. Returns rows of a time in s and a value in
/// `unit`, in their order.
///
/// # Errors
/// If the file cannot be read, has no row, a column is missing or in a unit of something else, or a cell is not a
/// finite number.
pub fn read_series(path: &Path, quantity: &str, unit: &str) -> Result<Series, IoError> {
    let source = Source::open(path)?;
    let table = Table::of(&source)?;
    let columns = &table.columns;
    let named = |name: &str| {
        name.split_once('[').map_or(name, |(name, _)| name).trim().eq_ignore_ascii_case(quantity)
    };
    let found = columns.names.iter().position(|name| named(name));
    let value = match found {
        Some(value) => value,
        None => columns.need(quantity)?,
    };
    let given = columns.names[value].split_once('[').map(|(_, unit)| unit.trim_end_matches(']').trim());
    let Some(ratio) = given.map_or(Some(1.0), |given| unit_ratio(given, unit)) else {
        let needed = format!("a unit of {quantity}, as {quantity}[{unit}]");
        return Err(columns.at().invalid(columns.describe(), needed));
    };
    let Some(time) = columns.find_time()? else {
        return Err(columns.at().invalid(columns.describe(), "a column `time`"));
    };
    let known = ["time", &columns.names[value]];
    let unused = columns.unused(&known);
    let read = |row: Row<'_>| Ok([row.time(time)?, ratio * row.number(value)?]);
    Ok((table.some_rows("rows of times", read)?, unused))
}
