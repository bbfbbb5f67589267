//! Tables of lookups, written one by one.

use std::{io::Write, path::Path};

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

/// Writes lookups as a table with columns
/// `contact,level,patch,face,b0,b1,b2,u,v,px,py,field,taxel_id,distance`; errors call it `path`.
///
/// `rows` gets a function that writes one row, so that memory does not grow with the table.
/// Decimals are the shortest that read back as the same `f64`.
///
/// # Errors
/// If `output` fails, and whatever `rows` returns.
pub fn write_lookups(
    path: &Path,
    output: impl Write,
    rows: impl FnOnce(&mut dyn FnMut(&LookupRow<'_>) -> Result<(), IoError>) -> Result<(), IoError>,
) -> Result<(), IoError> {
    let fail = |e| table_write_error(path, e);
    let mut table = csv::Writer::from_writer(output);
    table.write_record(COLUMNS).map_err(fail)?;
    rows(&mut |row| {
        let ([b0, b1, b2], [px, py], DVec2 { x: u, y: v }) = (row.barycentric, row.pixel, row.map);
        let (level, face, field) = (row.level.raw(), row.face.raw(), row.field.raw());
        // The crate prints numbers without allocating, and faster than `format!`.
        let cells =
            (row.contact, level, row.patch, face, b0, b1, b2, u, v, px, py, field, row.taxel.0, row.distance);
        table.serialize(cells).map_err(fail)
    })?;
    table.flush().map_err(|source| IoError::Write { path: path.into(), source })
}
