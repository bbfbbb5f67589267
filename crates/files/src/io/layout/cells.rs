//! Which cells of a frame each taxel has, and how much each of them counts.

use std::path::{Path, PathBuf};

use crate::io::IoError;
use crate::io::file::{Source, invalid};
use crate::io::layout::facts::StreamFacts;
use crate::io::layout::keys::Layout;
use crate::io::layout::rules::{Grid, TaxelRule};
use crate::io::table::{Row, Table};
use crate::skin::TaxelId;

/// Most cells of a frame: with more, a file is not what it seems.
pub(super) const MAX_CELLS: usize = 1 << 24;

/// A cell of a taxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Member {
    pub(super) id: TaxelId,
    /// Its number, counted through the axes of cells.
    pub(super) cell: usize,
    pub(super) weight: f64,
    pub(super) gain: f64,
}

impl Layout {
    /// The cells of all taxels, sorted by id, then by cell; and those that the table names and that are no taxels.
    pub(super) fn members(
        &self,
        file: &Path,
        facts: &StreamFacts,
        shape: &[usize],
    ) -> Result<(Vec<Member>, Vec<usize>), IoError> {
        let mut no_taxels = Vec::new();
        let count = shape.iter().product::<usize>();
        let member = |(cell, id): (usize, TaxelId)| Member { id, cell, weight: 1.0, gain: 1.0 };
        let one_each = |ids: &[TaxelId], whose: &Path| match ids.len() == count {
            true => Ok(ids.iter().copied().enumerate().map(member).collect()),
            false => {
                let needed = format!("{count}, one for each of the cells {shape:?}");
                Err(invalid(whose, "taxels, ids", format!("{} ids", ids.len()), needed))
            }
        };
        let mut members: Vec<Member> = match &self.taxels {
            TaxelRule::Table(_) | TaxelRule::Columns(_) if facts.has_named_columns => {
                one_each(facts.ids.as_deref().unwrap_or_default(), file)?
            }
            TaxelRule::Columns(_) => {
                let needed = format!("a table with columns called {}", self.taxels.describe());
                return Err(invalid(file, "taxels", "no columns with names", needed));
            }
            TaxelRule::Table(table) => self.read_table(table, shape, &mut no_taxels)?,
            TaxelRule::Ids(ids) => one_each(ids, &self.name)?,
            TaxelRule::File => match &facts.ids {
                Some(ids) => one_each(ids, file)?,
                None => {
                    let needed = "ids in the file, or `taxels` of the layout with a shape or a table";
                    return Err(invalid(file, "taxels", "no ids of taxels", needed));
                }
            },
            TaxelRule::Grid(grid) => {
                if grid.shape != shape {
                    let needed = self.says(format_args!("{:?}", grid.shape));
                    return Err(invalid(file, "cells of a frame", format!("{shape:?}"), needed));
                }
                grid.ids(&self.name, &self.cell_axes())?.into_iter().enumerate().map(member).collect()
            }
        };
        self.check_ids(file, facts, &members, count)?;
        let has_sensor = |member: &Member| facts.sensors.get(member.cell).copied().unwrap_or(true);
        match &self.taxels {
            TaxelRule::Table(table) => {
                if let Some(member) = members.iter().find(|member| !has_sensor(member)) {
                    let found = format!("taxel {} in a cell without a sensor", member.id);
                    let needed = format!("a cell with a sensor, or {table} without this row");
                    return Err(invalid(file, format!("cell {}", member.cell), found, needed));
                }
            }
            _ => members.retain(has_sensor),
        }
        if members.is_empty() {
            return Err(invalid(file, "taxels", "none", "at least one cell with a sensor"));
        }
        members.sort_by_key(|member| (member.id, member.cell));
        let may_share = matches!(self.taxels, TaxelRule::Table(_));
        if let Some(pair) = members.windows(2).find(|pair| pair[0].id == pair[1].id && !may_share) {
            let found = format!("taxel {} in two cells", pair[0].id);
            return Err(invalid(&self.name, "taxels", found, "an id of its own for each cell"));
        }
        Ok((members, no_taxels))
    }

    /// Refuses ids that are not those that the file states.
    fn check_ids(
        &self,
        file: &Path,
        facts: &StreamFacts,
        members: &[Member],
        count: usize,
    ) -> Result<(), IoError> {
        // Those of one axis of several are not of each cell.
        let Some(stated) = facts.ids.as_ref().filter(|ids| ids.len() == count) else { return Ok(()) };
        let Some(other) = members.iter().find(|member| stated[member.cell] != member.id) else {
            return Ok(());
        };
        let found = format!("taxel {}", stated[other.cell]);
        let name = self.name.display();
        let needed = format!("taxel {}, as {name} states; or {{\"ids\": \"file\"}} there", other.id);
        Err(invalid(file, format!("ids, column {}", other.cell + 1), found, needed))
    }

    /// The ids that the layout itself states, in the order of the cells as far as it has one; `None` if it states none.
    pub(in crate::io) fn own_ids(&self) -> Result<Option<Vec<TaxelId>>, IoError> {
        Ok(match &self.taxels {
            TaxelRule::Ids(ids) => Some(ids.clone()),
            TaxelRule::Grid(grid) => {
                let count = grid.shape.iter().try_fold(1_usize, |count, &size| count.checked_mul(size));
                let is_countable = count.is_some_and(|count| count <= MAX_CELLS);
                is_countable.then(|| grid.ids(&self.name, &self.cell_axes())).transpose()?
            }
            TaxelRule::Table(table) => {
                let source = Source::open(&self.beside(table))?;
                let table = Table::of(&source)?;
                let (id, mut ids) = (table.columns.need("taxel_id")?, Vec::new());
                table.each_row(&mut |row| {
                    if !row.text(id).is_empty() {
                        ids.push(row.taxel(id)?);
                    }
                    Ok(())
                })?;
                Some(ids)
            }
            TaxelRule::File | TaxelRule::Columns(_) => None,
        })
    }

    /// A file in the folder of the layout.
    pub(super) fn beside(&self, name: &str) -> PathBuf {
        self.name.parent().unwrap_or(Path::new("")).join(name)
    }

    /// Whether it states which axes are flipped, or names each cell.
    pub(super) fn states_flips(&self) -> bool {
        match &self.taxels {
            TaxelRule::Grid(grid) => grid.flip.is_some(),
            TaxelRule::Table(_) | TaxelRule::Ids(_) | TaxelRule::Columns(_) => true,
            TaxelRule::File => false,
        }
    }

    /// The axes that are neither frames, episodes nor components.
    pub(super) fn cell_axes(&self) -> Vec<&str> {
        self.frame_axes().filter(|axis| *axis != "component").collect()
    }

    /// The axes of one frame.
    pub(in crate::io) fn frame_axes(&self) -> impl Iterator<Item = &str> {
        self.axes.iter().map(String::as_str).filter(|axis| !["frame", "episode"].contains(axis))
    }

    fn read_table(
        &self,
        name: &str,
        shape: &[usize],
        no_taxels: &mut Vec<usize>,
    ) -> Result<Vec<Member>, IoError> {
        let path = self.beside(name);
        let source = Source::open(&path)?;
        let table = Table::of(&source)?;
        let axes = self.cell_axes();
        let known: Vec<&str> = axes.iter().copied().chain(["taxel_id", "weight", "gain"]).collect();
        if let Some((k, name)) = table.columns.unknown(&known).next() {
            let part = format!("column {}", k + 1);
            return Err(table.columns.at().invalid_part(part, name, format!("one of {}", known.join(","))));
        }
        let places = axes.iter().map(|axis| table.columns.need(axis)).collect::<Result<Vec<_>, _>>()?;
        let id = table.columns.need("taxel_id")?;
        let [weight, gain] = ["weight", "gain"].map(|name| table.columns.find(name));
        let mut members = Vec::new();
        table.each_row(&mut |row| {
            let mut cell = 0;
            for (&column, &size) in places.iter().zip(shape) {
                let index = row.text(column).parse().ok().filter(|index: &usize| *index < size);
                let needed = || format!("0 to {}, as the file has", size.saturating_sub(1));
                cell = cell * size + index.ok_or_else(|| row.invalid(column, needed()))?;
            }
            if row.text(id).is_empty() {
                no_taxels.push(cell);
                return Ok(());
            }
            let factor =
                |row: &Row<'_>, column: Option<usize>| match column.map(|c| (c, row.number_if_any(c))) {
                    Some((c, Ok(Some(x)))) if x <= 0.0 => Err(row.invalid(c, "a number above 0")),
                    Some((_, x)) => Ok(x?.unwrap_or(1.0)),
                    None => Ok(1.0),
                };
            let (weight, gain) = (factor(&row, weight)?, factor(&row, gain)?);
            members.push(Member { id: row.taxel(id)?, cell, weight, gain });
            Ok(())
        })?;
        let mut pairs: Vec<(usize, TaxelId)> = members.iter().map(|m| (m.cell, m.id)).collect();
        pairs.sort_unstable();
        if let Some(pair) = pairs.windows(2).find(|pair| pair[0] == pair[1]) {
            let found = format!("cell {} of taxel {} again", pair[0].0, pair[0].1);
            return Err(invalid(&path, "rows", found, "one row for each cell of a taxel"));
        }
        let has_taxel = |cell: usize| pairs.binary_search_by_key(&cell, |pair| pair.0).is_ok();
        if let Some(cell) = no_taxels.iter().find(|cell| has_taxel(**cell)) {
            let found = format!("cell {cell} with a taxel and without one");
            return Err(invalid(&path, "rows", found, "rows with a `taxel_id`, or one row without"));
        }
        Ok(members)
    }
}

impl Grid {
    /// The id of each cell: ids count through the axes, are transposed, then turned, then flipped.
    fn ids(&self, name: &Path, axes: &[&str]) -> Result<Vec<TaxelId>, IoError> {
        let wrong = |found: String, needed: String| Err(invalid(name, "taxels", found, needed));
        let count = self.shape.iter().product::<usize>();
        if u32::try_from(count).ok().and_then(|count| count.checked_add(self.first_id)).is_none() {
            return wrong(format!("{count} cells from id {}", self.first_id), "ids below 4294967296".into());
        }
        let flips = self.flip.iter().flatten();
        let flipped = flips.map(|axis| axes.iter().position(|known| known == axis).ok_or(axis));
        let flipped = match flipped.collect::<Result<Vec<_>, _>>() {
            Ok(flipped) => flipped,
            Err(axis) => {
                return wrong(format!("flip {axis:?}"), format!("axes of cells: {}", axes.join(", ")));
            }
        };
        if (self.transpose || self.rotate != 0) && self.shape.len() < 2 {
            return wrong(format!("shape {:?}", self.shape), "two axes to transpose or rotate".into());
        }
        let id_of = |cell: usize| {
            let mut index = vec![0; self.shape.len()];
            let mut rest = cell;
            for (place, size) in index.iter_mut().zip(&self.shape).rev() {
                (*place, rest) = (rest % size, rest / size);
            }
            flipped.iter().for_each(|&axis| index[axis] = self.shape[axis] - 1 - index[axis]);
            let mut size = self.shape.clone();
            if let ([.., height, width], [.., row, col]) = (size.as_mut_slice(), index.as_mut_slice()) {
                for _ in 0..self.rotate / 90 {
                    (*row, *col) = (*col, *height - 1 - *row);
                    std::mem::swap(height, width);
                }
                if self.transpose {
                    std::mem::swap(row, col);
                    std::mem::swap(height, width);
                }
            }
            let number = index.iter().zip(&size).fold(0, |number, (place, size)| number * size + place);
            // The count was compared with the ids that are left.
            TaxelId(self.first_id.saturating_add(u32::try_from(number).unwrap_or(u32::MAX)))
        };
        Ok((0..count).map(id_of).collect())
    }
}
