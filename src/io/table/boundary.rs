//! Tables of the places of a boundary on its map.

use std::path::Path;

use glam::DVec2;

use crate::{
    io::{IoError, file::source::Source, table::csv_table::Table},
    skin::TaxelId,
};

/// Reads the places of boundary taxels: columns `taxel_id,u,v`, map positions in m.
///
/// # Errors
/// If the file cannot be read, a column is missing or unknown, or a cell is not an id or a finite
/// number.
pub fn read_boundary(path: &Path) -> Result<Vec<(TaxelId, DVec2)>, IoError> {
    let source = Source::open(path)?;
    let table = Table::of(&source)?;
    table.refuse_unknown(&["taxel_id", "u", "v"])?;
    let id = table.columns.need("taxel_id")?;
    let uv = [table.columns.need("u")?, table.columns.need("v")?];
    let mut places = Vec::new();
    table.each_row(&mut |row| {
        places.push((row.taxel(id)?, DVec2::from_array(row.numbers(uv)?)));
        Ok(())
    })?;
    Ok(places)
}
