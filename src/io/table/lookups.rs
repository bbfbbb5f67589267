//! Tables of lookups, written one by one.

use std::{
    io::Write,
    path::{Path, PathBuf},
};

use glam::DVec2;

use crate::{
    id::{FaceId, VertexId},
    io::{IoError, table::csv_table::table_write_error},
    pyramid::LevelId,
    skin::TaxelId,
};

/// Columns of a table of lookups.
const COLUMNS: [&str; 14] = [
    "contact", "level", "patch", "face", "b0", "b1", "b2", "u", "v", "px", "py", "field", "taxel_id",
    "distance",
];

/// Where one contact is on one level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LookupRow<'a> {
    /// Place of the contact in its table, counted from 0.
    pub contact: u64,
    /// The level.
    pub level: LevelId,
    /// Name of the patch.
    pub patch: &'a str,
    /// The face of that level.
    pub face: FaceId,
    /// Barycentric coordinates in the face.
    pub barycentric: [f64; 3],
    /// Position on the map, in m, `v` up.
    pub map: DVec2,
    /// Column and row of the pixel; the first row is the top.
    pub pixel: [u32; 2],
    /// The receptive field: a vertex of that level.
    pub field: VertexId,
    /// Id of the taxel at the centre of the field.
    pub taxel: TaxelId,
    /// Signed distance from the skin, in m, positive outside.
    pub distance: f64,
}

/// Writes lookups one by one as a table with columns
/// `contact,level,patch,face,b0,b1,b2,u,v,px,py,field,taxel_id,distance`.
///
/// Decimals are the shortest that read back as the same `f64`. Rows are buffered: call
/// [`LookupWriter::finish`].
#[derive(Debug)]
pub struct LookupWriter<W: Write> {
    table: csv::Writer<W>,
    path: PathBuf,
}

impl<W: Write> LookupWriter<W> {
    /// Writes the names of the columns; errors call the table `path`.
    ///
    /// # Errors
    /// If `output` fails.
    pub fn new(path: &Path, output: W) -> Result<Self, IoError> {
        let mut table = csv::Writer::from_writer(output);
        table.write_record(COLUMNS).map_err(|e| table_write_error(path, e))?;
        Ok(Self { table, path: path.into() })
    }

    /// Writes one row.
    ///
    /// # Errors
    /// If the output fails.
    pub fn write(&mut self, row: &LookupRow<'_>) -> Result<(), IoError> {
        let ([b0, b1, b2], [px, py], DVec2 { x: u, y: v }) = (row.barycentric, row.pixel, row.map);
        let (level, face, field) = (row.level.raw(), row.face.raw(), row.field.raw());
        // The crate prints numbers without allocating, and faster than `format!`.
        let cells =
            (row.contact, level, row.patch, face, b0, b1, b2, u, v, px, py, field, row.taxel.0, row.distance);
        self.table.serialize(cells).map_err(|e| table_write_error(&self.path, e))
    }

    /// Writes what is still buffered, and returns the output.
    ///
    /// # Errors
    /// If the output fails.
    pub fn finish(self) -> Result<W, IoError> {
        let path = self.path;
        self.table.into_inner().map_err(|e| IoError::Write { path, source: e.into_error() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_has_a_cell_per_column_and_quotes_names() {
        let mut table = LookupWriter::new(Path::new("-"), Vec::new()).unwrap();
        table
            .write(&LookupRow {
                contact: 7,
                level: LevelId::new(1),
                patch: "arm, \"left\"",
                face: FaceId::new(3),
                barycentric: [0.25, 0.75, 0.0],
                map: DVec2::new(0.1, 1e-9),
                pixel: [12, 0],
                field: VertexId::new(5),
                taxel: TaxelId(u32::MAX),
                distance: -0.001,
            })
            .unwrap();
        let text = String::from_utf8(table.finish().unwrap()).unwrap();
        let wanted = "contact,level,patch,face,b0,b1,b2,u,v,px,py,field,taxel_id,distance\n\
                      7,1,\"arm, \"\"left\"\"\",3,0.25,0.75,0.0,0.1,1e-9,12,0,5,4294967295,-0.001\n";
        assert_eq!(text, wanted);
    }

    #[test]
    fn a_full_disk_is_an_error() {
        let mut nothing = [0; 10];
        let table = LookupWriter::new(Path::new("out.csv"), &mut nothing[..]).unwrap();
        let error = table.finish().unwrap_err().to_string();
        assert!(error.contains("cannot write out.csv"), "{error}");
    }
}
