//! Tables of which column of a recording is of which taxel.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use crate::io::IoError;
use crate::io::file::{OutPath, Source};
use crate::io::table::Table;
use crate::io::table::by_taxel::TaxelTable;
use crate::io::table::writer::write_table;
use crate::signal::Order;
use crate::skin::TaxelId;

/// Reads which column of a recording is of which taxel: columns `column`, counted from 0 without frames and times, and
/// `taxel_id` (or `id`), empty where it is of none.
///
/// # Errors
/// If the file cannot be read, a column is missing or a cell is not what it must be, or a column or a taxel comes twice.
/// Errors name the line.
pub fn read_order(path: &Path) -> Result<TaxelTable<(usize, TaxelId)>, IoError> {
    let source = Source::open(path)?;
    let table = Table::of(&source)?;
    let (column, id) = (table.columns.need("column")?, table.columns.need("taxel_id")?);
    let unused = table.columns.unused(&["column", "taxel_id", "support"]);
    let mut rows: Vec<(usize, TaxelId)> = Vec::new();
    let (mut columns, mut taxels) = (HashSet::new(), HashSet::new());
    table.each_row(&mut |row| {
        let number = row.text(column).parse().ok().filter(|number: &u32| *number < u32::MAX);
        let number = number.ok_or_else(|| row.invalid(column, "the number of a column, counted from 0"))?;
        if !columns.insert(number) {
            return Err(row.invalid(column, "each column once"));
        }
        if row.text(id).is_empty() {
            return Ok(());
        }
        let taxel = row.taxel(id)?;
        if !taxels.insert(taxel) {
            return Err(row.invalid(id, "each taxel once"));
        }
        rows.push((number as usize, taxel));
        Ok(())
    })?;
    Ok(TaxelTable { rows, unused })
}

/// Writes which column is of which taxel, as [`read_order`] reads it, and the support of each. Taxels that share an id
/// cannot be named: their columns have an empty cell, and their number is returned.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
pub fn write_order(path: impl Into<OutPath>, order: &Order) -> Result<usize, IoError> {
    let mut counts = HashMap::new();
    order
        .columns
        .iter()
        .filter_map(|column| column.taxel)
        .for_each(|(.., id)| *counts.entry(id).or_insert(0) += 1);
    let is_named = |id: &TaxelId| counts.get(id) == Some(&1);
    write_table(&path.into(), "column,taxel_id,support", |table| {
        for (number, column) in (0_u32..).zip(&order.columns) {
            table.whole(number);
            match column.taxel.map(|(.., id)| id).filter(is_named) {
                Some(id) => table.whole(id.0),
                None => table.empty(1),
            }
            table.number_if_any(Some(column.support).filter(|support| support.is_finite()));
            table.end_row()?;
        }
        Ok(())
    })?;
    Ok(counts.values().filter(|&&count| count > 1).sum())
}
