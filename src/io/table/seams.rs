//! Tables of seams.

use std::path::Path;

use crate::{
    io::{IoError, file::source::Source, table::csv_table::Table},
    skin::TaxelId,
};

/// Reads a table of seams: columns `from,to`, the ids of the taxels that an edge joins.
///
/// # Errors
/// If the file cannot be read, a column is missing or unknown, a cell is not an id, or an edge has
/// one end twice.
pub fn read_seams(path: &Path) -> Result<Vec<[TaxelId; 2]>, IoError> {
    let source = Source::open(path)?;
    let table = Table::of(&source)?;
    table.refuse_unknown(&["from", "to"])?;
    let (from, to) = (table.columns.need("from")?, table.columns.need("to")?);
    let mut seams = Vec::new();
    table.each_row(&mut |row| {
        let ends = [row.taxel(from)?, row.taxel(to)?];
        if ends[0] == ends[1] {
            return Err(row.invalid(to, "another taxel than `from`"));
        }
        seams.push(ends);
        Ok(())
    })?;
    Ok(seams)
}
