//! Tables of contacts, read one by one.

use std::{
    io::{BufReader, Read},
    iter,
    path::Path,
};

use glam::DVec3;

use crate::io::{
    IoError,
    file::lines::Lines,
    table::csv_table::{Row, Table},
};

/// Columns of a table of contacts.
const COLUMNS: [&str; 10] = ["x", "y", "z", "nx", "ny", "nz", "force", "radius", "link", "time"];

/// One contact of a table.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactRow {
    /// Where it is, in m; in the frame of `link`, or in the world without one.
    pub position: DVec3,
    /// Direction, as given.
    pub normal: Option<DVec3>,
    /// Force, in N.
    pub force: Option<f64>,
    /// Radius of the touching sphere, in m.
    pub radius: Option<f64>,
    /// Name of the link it is relative to.
    pub link: Option<String>,
    /// When it was, in s.
    pub time: Option<f64>,
    /// Line of the table it stands in, from 1.
    pub line: u64,
}

/// Reads contacts one by one from a table whose first line names the columns: `x,y,z` and
/// optionally `nx,ny,nz`, `force`, `radius`, `link` and `time`, in any order. Cells of optional
/// columns may be empty. Returns the names of columns that are not read, and the contacts; errors
/// call the table `path`.
///
/// Memory does not grow with the table. After an error about a line the iterator goes on with the
/// next one; it ends when the stream fails.
///
/// # Errors
/// If a name comes twice, `x`, `y` or `z` is missing, or only a part of `nx,ny,nz` is there.
pub fn read_contacts<R: Read>(
    path: &Path,
    input: R,
) -> Result<(Vec<String>, impl Iterator<Item = Result<ContactRow, IoError>> + use<R>), IoError> {
    let mut table = Table::open(Lines::new(BufReader::new(input), path, None))?;
    let columns = &table.columns;
    let unknown = columns.unknown(&COLUMNS).map(|(_, name)| name.to_owned()).collect();
    let position = columns.need_vector(["x", "y", "z"])?;
    let normal = columns.find_vector(["nx", "ny", "nz"])?;
    let [force, radius, link, time] = ["force", "radius", "link", "time"].map(|name| columns.find(name));
    let contact = move |row: Row<'_>| {
        let number = |column: Option<usize>| column.map_or(Ok(None), |c| row.number_if_any(c));
        let reach = number(radius)?;
        if let (Some(column), true) = (radius, reach.is_some_and(|r| r < 0.0)) {
            return Err(row.invalid(column, "a radius of at least 0 m"));
        }
        Ok(ContactRow {
            position: row.vector(position)?,
            normal: normal.map_or(Ok(None), |c| row.numbers_if_any(c))?.map(DVec3::from_array),
            force: number(force)?,
            radius: reach,
            link: link.map(|c| row.text(c)).filter(|name| !name.is_empty()).map(str::to_owned),
            time: number(time)?,
            line: row.at.line as u64,
        })
    };
    let rows = iter::from_fn(move || match table.advance() {
        Ok(more) => more.then(|| contact(table.row())),
        Err(error) => Some(Err(error)),
    });
    Ok((unknown, rows))
}
