//! Tables of landmarks: which taxels of two skins are at the same place.

use std::path::Path;

use crate::io::IoError;
use crate::io::file::invalid;
use crate::io::table::by_taxel::{Homes, TaxelTable};
use crate::io::table::each_row_of;
use crate::map::SkinMap;
use crate::registration::Landmark;
use crate::skin::Taxels;

/// Reads landmarks: columns `taxel_id,atlas_taxel_id`, a taxel of a skin, whose patches are `own`, and the taxel of its atlas
/// at the same place.
///
/// # Errors
/// If the file cannot be read, a column is missing or there is no row, or a cell is not the id of exactly one taxel.
/// Errors name the line.
pub fn read_landmarks<'a>(
    path: &Path,
    own: impl IntoIterator<Item = &'a Taxels>,
    atlas: &SkinMap,
) -> Result<TaxelTable<Landmark>, IoError> {
    let homes = Homes::new(own.into_iter());
    let of_atlas = Homes::new(atlas.patches.iter().map(|patch| &patch.taxels));
    let mut rows = Vec::new();
    let unused = each_row_of(path, ["taxel_id", "atlas_taxel_id"], &mut |row, [id, other]| {
        let name = format!("line {} of {}", row.at.line, path.display());
        rows.push(Landmark { name, taxel: homes.of(row, id)?, atlas: of_atlas.of(row, other)? });
        Ok(())
    })?;
    match rows.is_empty() {
        true => Err(invalid(path, "table", "no row", "a row for each landmark, four or more in a patch")),
        false => Ok(TaxelTable { rows, unused }),
    }
}
