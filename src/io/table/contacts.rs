//! Tables of contacts, read one by one.

use std::{io::Read, path::Path};

use glam::DVec3;

use crate::io::{
    IoError,
    table::csv_table::{Bounded, Columns, Table},
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
/// columns may be empty.
///
/// Memory does not grow with the table. After an error about a line the iterator goes on with the
/// next one; it ends when the stream fails.
#[derive(Debug)]
pub struct ContactReader<R> {
    table: Table<Bounded<R>>,
    indices: ColumnIndices,
}

/// Where the columns are.
#[derive(Debug)]
struct ColumnIndices {
    position: [usize; 3],
    normal: Option<[usize; 3]>,
    force: Option<usize>,
    radius: Option<usize>,
    link: Option<usize>,
    time: Option<usize>,
}

impl ColumnIndices {
    fn new(columns: &Columns) -> Result<Self, IoError> {
        Ok(Self {
            position: columns.need_vector(["x", "y", "z"])?,
            normal: columns.find_vector(["nx", "ny", "nz"])?,
            force: columns.find("force"),
            radius: columns.find("radius"),
            link: columns.find("link"),
            time: columns.find("time"),
        })
    }
}

impl<R: Read> ContactReader<R> {
    /// Reads the names of the columns; errors call the table `path`.
    ///
    /// # Errors
    /// If a name comes twice, `x`, `y` or `z` is missing, or only a part of `nx,ny,nz` is there.
    pub fn new(path: &Path, input: R) -> Result<Self, IoError> {
        let table = Table::open(path, Bounded::new(input))?;
        let indices = ColumnIndices::new(&table.columns)?;
        Ok(Self { table, indices })
    }

    /// Names of columns that are not read.
    pub fn unknown_columns(&self) -> impl Iterator<Item = &str> {
        self.table.columns.unknown(&COLUMNS).map(|(_, name)| name)
    }

    fn read_row(&self) -> Result<ContactRow, IoError> {
        let (row, indices) = (self.table.row(), &self.indices);
        let number = |column: Option<usize>| column.map_or(Ok(None), |c| row.number_if_any(c));
        let radius = number(indices.radius)?;
        if let (Some(column), true) = (indices.radius, radius.is_some_and(|r| r < 0.0)) {
            return Err(row.invalid(column, "a radius of at least 0 m"));
        }
        Ok(ContactRow {
            position: row.vector(indices.position)?,
            normal: indices.normal.map_or(Ok(None), |c| row.vector_if_any(c))?,
            force: number(indices.force)?,
            radius,
            link: indices.link.map(|c| row.text(c)).filter(|name| !name.is_empty()).map(str::to_owned),
            time: number(indices.time)?,
            line: row.line,
        })
    }
}

impl<R: Read> Iterator for ContactReader<R> {
    type Item = Result<ContactRow, IoError>;

    fn next(&mut self) -> Option<Self::Item> {
        match self.table.advance() {
            Ok(true) => Some(self.read_row()),
            Ok(false) => None,
            Err(error) => Some(Err(error)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Vec<Result<ContactRow, IoError>> {
        ContactReader::new(Path::new("-"), text.as_bytes()).unwrap().collect()
    }

    fn message<T: std::fmt::Debug>(result: Result<T, IoError>) -> String {
        result.unwrap_err().to_string()
    }

    #[test]
    fn columns_come_in_any_order_and_cells_may_be_empty() {
        let text = "\u{feff}time, z ,link,y,x,radius,force,nz,ny,nx\r\n0.5,3,\"left, arm\",2,1e0,,-2,1,0,0\r\n,0,,0,0,,,,,\r\n";
        let rows: Vec<ContactRow> = read(text).into_iter().map(Result::unwrap).collect();
        let full = ContactRow {
            position: DVec3::new(1.0, 2.0, 3.0),
            normal: Some(DVec3::Z),
            force: Some(-2.0),
            radius: None,
            link: Some("left, arm".into()),
            time: Some(0.5),
            line: rows[0].line,
        };
        let bare = ContactRow {
            position: DVec3::ZERO,
            normal: None,
            force: None,
            radius: None,
            link: None,
            time: None,
            line: rows[1].line,
        };
        assert_eq!(rows, [full, bare]);
        let lines = read(&text.replace("\r\n", "\n")).into_iter().map(|row| row.unwrap().line);
        assert_eq!(lines.collect::<Vec<_>>(), [2, 3]);
    }

    #[test]
    fn unknown_columns_are_listed() {
        let reader = ContactReader::new(Path::new("-"), &b"x,y,z,colour\n"[..]).unwrap();
        assert_eq!(reader.unknown_columns().collect::<Vec<_>>(), ["colour"]);
    }

    #[test]
    fn a_broken_line_is_named_and_the_next_one_read() {
        let rows = read("x,y,z,nx,ny,nz,radius\n0,0,NaN,,,,\n0,0,0,1,,0,\n0,0,0,,,,-1\n0,0\n1,2,3,,,,\n");
        let places = [
            "line 2, column `z`: found \"NaN\"",
            "line 3, column `ny`",
            "line 4, column `radius`",
            "line 5: found 2 cells",
        ];
        let mut rows = rows.into_iter();
        for place in places {
            let found = message(rows.next().unwrap());
            assert!(found.contains(place), "{place:?} is named in {found:?}");
        }
        let last = rows.next().unwrap().unwrap();
        assert_eq!((last.position, last.line), (DVec3::new(1.0, 2.0, 3.0), 6));
        assert!(rows.next().is_none());
    }

    #[test]
    fn headers_without_a_position_or_with_a_name_twice_are_refused() {
        for (header, place) in [
            ("", "the names of the columns"),
            ("x,y\n", "a column `z`"),
            ("x,y,z,x\n", "line 1, column 4"),
            ("x,y,z,nx,nz\n", "a column `ny`"),
            ("x,y,\u{fffd}\n", "a column `z`"),
        ] {
            let found = message(ContactReader::new(Path::new("-"), header.as_bytes()));
            assert!(found.contains(place), "{place:?} is named in {found:?}");
        }
        let latin = message(ContactReader::new(Path::new("-"), &b"x,y,z,\xfc\n"[..]));
        assert!(latin.contains("UTF-8"), "{latin}");
    }

    /// A line without end, and a quote that is never closed, end the table instead of filling the
    /// memory.
    #[test]
    fn an_endless_line_is_refused() {
        for start in ["", "\""] {
            let endless = format!("x,y,z\n{start}").into_bytes();
            let input = endless.as_slice().chain(std::io::repeat(b'1'));
            let mut rows = ContactReader::new(Path::new("-"), input).unwrap();
            let found = message(rows.next().unwrap());
            assert!(found.contains("more than 1048576 bytes"), "{found}");
            assert!(rows.next().is_none(), "the stream is given up");
        }
    }

    #[test]
    fn a_long_table_passes_though_its_lines_together_are_long() {
        let line = format!("0,0,0,{}\n", "l".repeat(1000));
        let text = "x,y,z,link\n".to_owned() + &line.repeat(3000);
        assert_eq!(read(&text).into_iter().filter(Result::is_ok).count(), 3000);
    }
}
