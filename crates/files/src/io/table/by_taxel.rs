//! Tables about single taxels: how sharp they are, how much their readings are
//! multiplied, where they lie on the boundary of a map, and which edges between them are a seam.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use glam::DVec2;

use crate::id::{IdVec, VertexId};
use crate::io::IoError;
use crate::io::file::{Source, file_kind};
use crate::io::table::{Row, Table, each_row_of};
use crate::skin::{PatchId, Skin, TaxelId, Taxels};

/// No skin is sharper: a fingertip distinguishes two points at a tenth of the distance that a forearm
/// needs.
const FACTORS: std::ops::RangeInclusive<f64> = 0.01..=100.0;

/// A table about taxels.
#[derive(Debug, Clone, PartialEq)]
pub struct TaxelTable<T> {
    /// The values of the rows, in their order.
    pub rows: Vec<T>,
    /// Names of columns that are not used.
    pub unused: Vec<String>,
}

/// What the file of a skin has and the skin has not, as patches that were not chosen or could not be used: a table about
/// the file may name it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NotInSkin {
    /// Ids of taxels.
    pub taxels: HashSet<TaxelId>,
    /// Names of patches.
    pub patches: HashSet<String>,
}

/// What of a table about the taxels of a skin is not used.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Unused {
    /// Names of columns.
    pub columns: Vec<String>,
    /// How many rows, or polygons, are of taxels and patches [that are not in the skin](NotInSkin).
    pub rows: usize,
}

/// Reads a table of acuities, columns `taxel_id,factor`, into the taxels of a skin; those that it does
/// not name have the factor 1, and a patch of which all have it has no acuities. Returns the names of columns that are not
/// used.
///
/// # Errors
/// If the file cannot be read, a column is missing, a factor is not a number from 0.01 to 100, or
/// an id is named twice or is not that of exactly one taxel. Errors name the line.
pub fn read_acuities(path: &Path, skin: &mut Skin) -> Result<Vec<String>, IoError> {
    read_acuities_with(path, skin, &NotInSkin::default()).map(|unused| unused.columns)
}

/// As [`read_acuities`]; rows of taxels that the file of the skin has and the skin has not are counted, and not used.
///
/// # Errors
/// As [`read_acuities`].
pub fn read_acuities_with(path: &Path, skin: &mut Skin, others: &NotInSkin) -> Result<Unused, IoError> {
    let mut rows = 0;
    let homes = Homes::new(skin.patches.enumerate().map(|(id, patch)| (id, &patch.taxels)));
    let mut acuities = skin.patches.map(|patch| IdVec::filled(None, patch.taxels.ids.len()));
    let columns = each_row_of(path, ["taxel_id", "factor"], &mut |row, [id, factor]| {
        let found = row.number(factor)?;
        if !FACTORS.contains(&found) {
            return Err(row.invalid(factor, "a number from 0.01 to 100"));
        }
        let Some((patch, vertex)) = homes.of_or_other(row, id, "the skin", others)? else {
            rows += 1;
            return Ok(());
        };
        match acuities[patch][vertex].replace(found) {
            None => Ok(()),
            Some(_) => Err(row.invalid(id, "an id that no earlier line names")),
        }
    })?;
    for (patch, acuities) in skin.patches.iter_mut().zip(acuities) {
        let acuities = acuities.map(|acuity| acuity.unwrap_or(1.0));
        patch.taxels.acuities = Some(acuities).filter(|all| all.iter().any(|acuity| *acuity != 1.0));
    }
    Ok(Unused { columns, rows })
}

/// Where the taxel of each id is.
pub(super) struct Homes(HashMap<TaxelId, (PatchId, VertexId, usize)>);

impl Homes {
    pub(super) fn new<'a>(patches: impl IntoIterator<Item = (PatchId, &'a Taxels)>) -> Self {
        let mut homes: HashMap<TaxelId, (PatchId, VertexId, usize)> = HashMap::new();
        for (patch, taxels) in patches {
            for (vertex, id) in taxels.ids.enumerate() {
                homes.entry(*id).or_insert((patch, vertex, 0)).2 += 1;
            }
        }
        Self(homes)
    }

    /// The taxel whose id is in a cell, none if it is of `others`; `whose` taxels these are is said in errors.
    pub(super) fn of_or_other(
        &self,
        row: Row<'_>,
        id: usize,
        whose: &str,
        others: &NotInSkin,
    ) -> Result<Option<(PatchId, VertexId)>, IoError> {
        let taxel = row.taxel(id)?;
        match self.0.get(&taxel) {
            None if others.taxels.contains(&taxel) => Ok(None),
            None => Err(row.invalid(id, format!("the id of a taxel of {whose}"))),
            Some((patch, vertex, 1)) => Ok(Some((*patch, *vertex))),
            Some((_, _, count)) => Err(row.invalid(id, format!("the id of one taxel, not of {count}"))),
        }
    }
}

/// Reads a table of gains: columns `id,gain`.
///
/// # Errors
/// If the file cannot be read, a column is missing, a cell is not a number, or an id comes twice.
pub fn read_gains(path: &Path) -> Result<TaxelTable<(TaxelId, f64)>, IoError> {
    let (mut rows, mut seen) = (Vec::new(), HashSet::new());
    let unused = each_row_of(path, ["id", "gain"], &mut |row, [id, gain]| {
        let taxel = row.taxel(id)?;
        if !seen.insert(taxel) {
            return Err(row.invalid(id, "each id once"));
        }
        rows.push((taxel, row.number(gain)?));
        Ok(())
    })?;
    Ok(TaxelTable { rows, unused })
}

/// Reads a table of the modules of taxels: columns `taxel_id,module`.
///
/// # Errors
/// If the file cannot be read, a column is missing, a module has no name, or an id comes twice.
pub fn read_modules(path: &Path) -> Result<TaxelTable<(TaxelId, String)>, IoError> {
    let (mut rows, mut seen) = (Vec::new(), HashSet::new());
    let unused = each_row_of(path, ["taxel_id", "module"], &mut |row, [id, module]| {
        let taxel = row.taxel(id)?;
        if !seen.insert(taxel) {
            return Err(row.invalid(id, "each id once"));
        }
        if row.text(module).is_empty() {
            return Err(row.invalid(module, "the name of a module"));
        }
        rows.push((taxel, row.text(module).to_owned()));
        Ok(())
    })?;
    Ok(TaxelTable { rows, unused })
}

/// The modules that the table of a skin gives its taxels, in a column `module`; `None` without it.
///
/// # Errors
/// As [`read_modules`].
pub fn modules_of_skin(path: &Path) -> Result<Option<Vec<(TaxelId, String)>>, IoError> {
    let is_table = file_kind(path) == "csv";
    let has_modules = is_table && Table::of(&Source::open(path)?)?.columns.find("module").is_some();
    has_modules.then(|| Ok(read_modules(path)?.rows)).transpose()
}

/// Reads the places of boundary taxels: columns `taxel_id,u,v`, map positions in m.
///
/// # Errors
/// If the file cannot be read, a column is missing, or a cell is not an id or a finite
/// number.
pub fn read_boundary(path: &Path) -> Result<TaxelTable<(TaxelId, DVec2)>, IoError> {
    let mut rows = Vec::new();
    let unused = each_row_of(path, ["taxel_id", "u", "v"], &mut |row, [id, u, v]| {
        rows.push((row.taxel(id)?, DVec2::from_array(row.numbers([u, v])?)));
        Ok(())
    })?;
    Ok(TaxelTable { rows, unused })
}

/// Reads a table of seams: columns `from,to`, the ids of the taxels that an edge joins.
///
/// # Errors
/// If the file cannot be read, a column is missing, a cell is not an id, or an edge has
/// one end twice.
pub fn read_seams(path: &Path) -> Result<TaxelTable<[TaxelId; 2]>, IoError> {
    let mut rows = Vec::new();
    let unused = each_row_of(path, ["from", "to"], &mut |row, [from, to]| {
        let ends = [row.taxel(from)?, row.taxel(to)?];
        if ends[0] == ends[1] {
            return Err(row.invalid(to, "another taxel than `from`"));
        }
        rows.push(ends);
        Ok(())
    })?;
    Ok(TaxelTable { rows, unused })
}
