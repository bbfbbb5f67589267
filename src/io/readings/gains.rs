//! Tables of gains: by how much the readings of a taxel are multiplied.

use std::{collections::HashSet, path::Path};

use crate::{
    io::{IoError, file::source::Source, table::csv_table::Table},
    skin::TaxelId,
};

/// Reads a table of gains: columns `id,gain`.
///
/// # Errors
/// If the file cannot be read, a column is missing, a cell is not a number, or an id comes twice.
pub fn read_gains(path: &Path) -> Result<Vec<(TaxelId, f64)>, IoError> {
    let source = Source::open(path)?;
    let table = Table::of(&source)?;
    table.refuse_unknown(&["id", "gain"])?;
    let (id, gain) = (table.columns.need("id")?, table.columns.need("gain")?);
    let (mut gains, mut seen) = (Vec::new(), HashSet::new());
    table.each_row(&mut |row| {
        let taxel = row.taxel(id)?;
        if !seen.insert(taxel) {
            return Err(row.invalid(id, "each id once"));
        }
        gains.push((taxel, row.number(gain)?));
        Ok(())
    })?;
    Ok(gains)
}
