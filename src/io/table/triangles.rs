//! Tables of triangles: what the names of their columns say about the corners.

use std::collections::HashMap;

use crate::{
    io::{
        error::Result,
        table::{Row, columns::Columns},
    },
    skin::TaxelId,
};

/// Corners named by the ids of their taxels.
pub(in crate::io) const BY_ID: [&str; 3] = ["id0", "id1", "id2"];

/// Corners named by the rows of their taxels, counted from 0.
pub(in crate::io) const BY_ROW: [&str; 3] = ["row0", "row1", "row2"];

/// How a table names the corners of its triangles.
pub(in crate::io) struct Corners {
    by_id: bool,
    /// The names of the columns, and where they are.
    pub(in crate::io) names: [&'static str; 3],
    pub(in crate::io) columns: [usize; 3],
}

impl Corners {
    pub(in crate::io) fn new(columns: &Columns) -> Result<Self> {
        for (by_id, names) in [(true, BY_ID), (false, BY_ROW)] {
            if names.iter().any(|name| columns.find(name).is_some()) {
                return Ok(Self { by_id, names, columns: columns.need_vector(names)? });
            }
        }
        let needed =
            format!("columns {} (ids of taxels) or {} (their rows)", BY_ID.join(","), BY_ROW.join(","));
        Err(columns.at().invalid(columns.describe(), needed))
    }

    /// The rows of the taxels that a triangle joins, of as many as `ids` has; rows count from 0.
    pub(in crate::io) fn rows_of(&self, row: Row<'_>, taxels: &Taxels) -> Result<[usize; 3]> {
        let find = |column| {
            let number = row.text(column).parse::<u32>().ok();
            if !self.by_id {
                let place = number.map(|k| k as usize).filter(|&k| k < taxels.count);
                let needed = || format!("the row of one of {} taxels, counted from 0", taxels.count);
                return place.ok_or_else(|| row.invalid(column, needed()));
            }
            match number.and_then(|id| taxels.rows.get(&TaxelId(id))) {
                Some(&(place, 1)) => Ok(place),
                Some((_, many)) => {
                    let needed = format!("an id of one taxel, not of {many}; {} name rows", BY_ROW.join(","));
                    Err(row.invalid(column, needed))
                }
                None => Err(row.invalid(column, "the id of a taxel of the table")),
            }
        };
        let [a, b, c] = self.columns.map(find);
        Ok([a?, b?, c?])
    }
}

/// Which rows the taxels have.
pub(in crate::io) struct Taxels {
    count: usize,
    /// The first row of each id, and how many there are.
    rows: HashMap<TaxelId, (usize, usize)>,
}

impl Taxels {
    /// `count` taxels, which have these ids, if any.
    pub(in crate::io) fn new(count: usize, ids: impl IntoIterator<Item = TaxelId>) -> Self {
        let mut rows = HashMap::with_capacity(count);
        for (row, id) in ids.into_iter().enumerate() {
            rows.entry(id).or_insert((row, 0)).1 += 1;
        }
        Self { count, rows }
    }
}
