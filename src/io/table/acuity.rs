//! Tables of acuities: how much finer than elsewhere the fields at some taxels are, and how much
//! longer lengths on their map.

use std::{collections::HashMap, path::Path};

use crate::{
    id::{IdVec, VertexId},
    io::{IoError, file::source::Source, table::csv_table::Table},
    skin::{PatchId, Skin, TaxelId},
};

/// No skin is sharper: a fingertip distinguishes two points at a tenth of the distance that a forearm
/// needs.
const FACTORS: std::ops::RangeInclusive<f64> = 0.01..=100.0;

/// Reads a table of acuities, columns `taxel_id,factor`, into the taxels of a skin; those that it does
/// not name get the factor 1.
///
/// # Errors
/// If the file cannot be read, a column is missing or unknown, a factor is not a number from 0.01 to 100, or
/// an id is named twice or is not that of exactly one taxel. Errors name the line.
pub fn read_acuities(path: &Path, skin: &mut Skin) -> Result<(), IoError> {
    let source = Source::open(path)?;
    let table = Table::of(&source)?;
    table.refuse_unknown(&["taxel_id", "factor"])?;
    let (id, factor) = (table.columns.need("taxel_id")?, table.columns.need("factor")?);
    let mut homes: HashMap<TaxelId, (PatchId, VertexId, usize)> = HashMap::new();
    for (patch, known) in skin.patches.enumerate() {
        for (vertex, id) in known.taxels.ids.enumerate() {
            homes.entry(*id).or_insert((patch, vertex, 0)).2 += 1;
        }
    }
    let mut acuities = skin.patches.map(|patch| IdVec::filled(None, patch.taxels.ids.len()));
    table.each_row(&mut |row| {
        let &(patch, vertex, count) =
            homes.get(&row.taxel(id)?).ok_or_else(|| row.invalid(id, "the id of a taxel of the skin"))?;
        if count > 1 {
            return Err(row.invalid(id, format!("the id of one taxel, not of {count}")));
        }
        let found = row.number(factor)?;
        if !FACTORS.contains(&found) {
            return Err(row.invalid(factor, "a number from 0.01 to 100"));
        }
        match acuities[patch][vertex].replace(found) {
            None => Ok(()),
            Some(_) => Err(row.invalid(id, "an id that no earlier line names")),
        }
    })?;
    for (patch, acuities) in skin.patches.iter_mut().zip(acuities) {
        patch.taxels.acuities = Some(acuities.map(|acuity| acuity.unwrap_or(1.0)));
    }
    Ok(())
}
