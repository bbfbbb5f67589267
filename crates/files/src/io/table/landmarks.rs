//! Tables of landmarks: which taxels of two skins are at the same place.

use std::collections::HashMap;
use std::path::Path;

use crate::id::VertexId;
use crate::io::error::Result;
use crate::io::file::{Source, excerpt, invalid};
use crate::io::table::by_taxel::{Homes, NotInSkin, TaxelTable, Unused};
use crate::io::table::{Row, Table};
use crate::map::SkinMap;
use crate::registration::Landmark;
use crate::skin::{PatchId, Taxels};

/// The columns of a table of landmarks; the last three may be absent.
const COLUMNS: [&str; 5] = ["taxel_id", "atlas_taxel_id", "name", "patch", "atlas_patch"];

/// Reads landmarks: columns `taxel_id,atlas_taxel_id`, a taxel of a skin, whose patches are `own` with their names, and the
/// taxel of its atlas at the same place. Where patches share ids, columns `patch` and `atlas_patch` say in which one the
/// taxel is; a column `name` is for notes and errors. Cells of these three may be empty.
///
/// # Errors
/// If the file cannot be read, a column is missing or there is no row, or a cell is not the id of exactly one taxel.
/// Errors name the line.
pub fn read_landmarks<'a>(
    path: &Path,
    own: impl IntoIterator<Item = (&'a str, &'a Taxels)>,
    atlas: &SkinMap,
) -> Result<TaxelTable<Landmark>> {
    let (rows, unused) = read_landmarks_with(path, own, atlas, &NotInSkin::default())?;
    Ok(TaxelTable { rows, unused: unused.columns })
}

/// As [`read_landmarks`]; rows of taxels that the file of the skin has and the skin has not are counted, and not used.
///
/// # Errors
/// As [`read_landmarks`].
pub fn read_landmarks_with<'a>(
    path: &Path,
    own: impl IntoIterator<Item = (&'a str, &'a Taxels)>,
    atlas: &SkinMap,
    others: &NotInSkin,
) -> Result<(Vec<Landmark>, Unused)> {
    let source = Source::open(path)?;
    let table = Table::of(&source)?;
    let [id, other] = table.columns.need_vector([COLUMNS[0], COLUMNS[1]])?;
    let [called, patch, other_patch] = [2, 3, 4].map(|k: usize| table.columns.find(COLUMNS[k]));
    let columns = table.columns.unused(&COLUMNS);
    let skin = Ids::new(own, patch, "the skin");
    let of_atlas =
        Ids::new(atlas.patches.iter().map(|patch| (&*patch.name, &patch.taxels)), other_patch, "the atlas");
    let rows = table.rows(|row| {
        let line = format!("line {} of {}", row.at.line, path.display());
        let called = called.map(|column| row.text(column)).filter(|name| !name.is_empty());
        let name = called.map_or_else(|| line.clone(), |name| format!("{line} ({})", excerpt(name)));
        let on_atlas = of_atlas.of(row, other)?;
        Ok(skin.of_or_other(row, id, others)?.map(|taxel| Landmark { name, taxel, atlas: on_atlas }))
    })?;
    let all = rows.len();
    let rows: Vec<Landmark> = rows.into_iter().flatten().collect();
    match rows.is_empty() {
        true => Err(invalid(path, "table", "no row", "a row for each landmark, four or more in a patch")),
        false => {
            let unused = Unused { columns, rows: all - rows.len() };
            Ok((rows, unused))
        }
    }
}

/// The taxels of a skin by their ids; where the table has a column of patches, also by those.
struct Ids<'a> {
    all: Homes,
    patches: HashMap<&'a str, Homes>,
    column: Option<usize>,
    whose: &'static str,
}

impl<'a> Ids<'a> {
    fn new(
        patches: impl IntoIterator<Item = (&'a str, &'a Taxels)>,
        column: Option<usize>,
        whose: &'static str,
    ) -> Self {
        let patches: Vec<(PatchId, (&str, &Taxels))> =
            patches.into_iter().enumerate().map(|(k, patch)| (PatchId::new(k), patch)).collect();
        let all = Homes::new(patches.iter().map(|(id, (_, taxels))| (*id, *taxels)));
        let named = patches.iter().filter(|_| column.is_some());
        let patches = named.map(|&(id, (name, taxels))| (name, Homes::new([(id, taxels)]))).collect();
        Self { all, patches, column, whose }
    }

    fn of(&self, row: Row<'_>, id: usize) -> Result<(PatchId, VertexId)> {
        let needed = || row.invalid(id, format!("the id of a taxel of {}", self.whose));
        self.of_or_other(row, id, &NotInSkin::default())?.ok_or_else(needed)
    }

    /// The taxel of a row; none if it is of `others`.
    fn of_or_other(
        &self,
        row: Row<'_>,
        id: usize,
        others: &NotInSkin,
    ) -> Result<Option<(PatchId, VertexId)>> {
        let Some((column, name)) =
            self.column.map(|column| (column, row.text(column))).filter(|(_, name)| !name.is_empty())
        else {
            return self.all.of_or_other(row, id, self.whose, others);
        };
        match self.patches.get(name) {
            Some(patch) => patch.of_or_other(row, id, self.whose, others),
            None if others.patches.contains(name) => Ok(None),
            None => Err(row.invalid(column, "the name of a patch")),
        }
    }
}
