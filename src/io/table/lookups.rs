//! Tables of lookups, written some rows at a time.

use std::{fmt::Write as _, io::Write, path::Path};

use glam::{DVec2, DVec3};

use crate::{contact::Cell, io::IoError, parallel::par_collect, pyramid::LevelId};

/// Columns of a table of lookups.
const COLUMNS: [&str; 22] = [
    "contact", "level", "patch", "face", "b0", "b1", "b2", "u", "v", "px", "py", "field", "taxel_id",
    "distance", "link", "x", "y", "z", "nx", "ny", "nz", "fields",
];

/// What stands in the column `patch` of a contact that touches none.
const OFF_SKIN: &str = "off skin";

/// Where one contact is on one level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LookupRow<'a> {
    /// Place of the contact in its table, counted from 0.
    pub contact: u64,
    /// The level.
    pub level: LevelId,
    /// Signed distance from the skin, in m, positive outside.
    pub distance: f64,
    /// The frame that the contact was given in, `world` or the name of a link; its answer is in the
    /// same.
    pub frame: &'a str,
    /// Where it touches; `None`: it is off the skin.
    pub place: Option<LookupPlace<'a>>,
    /// The number in the table's last column, if it has one of its own.
    pub extra: f64,
}

/// A place on the skin and on the map of one level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LookupPlace<'a> {
    /// Name of the patch.
    pub patch: &'a str,
    /// Name of its link.
    pub link: &'a str,
    /// Where it is on the map of the level.
    pub cell: Cell,
    /// The point on the skin, in m, in the frame of the contact.
    pub position: DVec3,
    /// The unit normal of the skin there, in the same frame.
    pub normal: DVec3,
}

/// Writes a table of lookups with columns
/// `contact,level,patch,face,b0,b1,b2,u,v,px,py,field,taxel_id,distance,link,x,y,z,nx,ny,nz,fields`
/// and `frame`, then the one that a table adds.
///
/// `fields` has `vertex:weight` for each receptive field that the contact lies in, with `;` between
/// them. A contact off the skin has `off skin` as its patch, and otherwise only its distance. Decimals
/// are the shortest that read back as the same `f64`.
#[derive(Debug)]
pub struct LookupWriter<'a, W> {
    path: &'a Path,
    output: W,
    has_extra: bool,
}

impl<'a, W: Write> LookupWriter<'a, W> {
    /// Begins a table, with a last column of a name that it adds; errors call it `path`.
    ///
    /// # Errors
    /// If `output` fails.
    pub fn new(path: &'a Path, mut output: W, extra: Option<&str>) -> Result<Self, IoError> {
        let columns = COLUMNS.into_iter().chain(["frame"]).chain(extra);
        let header = columns.collect::<Vec<_>>().join(",") + "\n";
        output.write_all(header.as_bytes()).map_err(|source| IoError::Write { path: path.into(), source })?;
        Ok(Self { path, output, has_extra: extra.is_some() })
    }

    /// Writes the rows of `contacts` contacts in their order; `rows` passes the rows of the contact
    /// with a number below that to its second argument. It is called in parallel.
    ///
    /// # Errors
    /// If `output` fails.
    pub fn write(
        &mut self,
        contacts: usize,
        rows: impl Fn(usize, &mut dyn FnMut(&LookupRow<'_>)) + Sync,
    ) -> Result<(), IoError> {
        let has_extra = self.has_extra;
        let text = par_collect(contacts, |range, text: &mut Vec<u8>| {
            let mut table = csv::Writer::from_writer(text);
            let mut fields = String::new();
            for contact in range {
                // Writing to memory does not fail.
                rows(contact, &mut |row| _ = write_row(&mut table, &mut fields, row, has_extra));
            }
        });
        let fail = |source| IoError::Write { path: self.path.into(), source };
        self.output.write_all(&text).map_err(fail)
    }

    /// Ends the table.
    ///
    /// # Errors
    /// If `output` fails.
    pub fn finish(mut self) -> Result<(), IoError> {
        self.output.flush().map_err(|source| IoError::Write { path: self.path.into(), source })
    }
}

fn write_row(
    table: &mut csv::Writer<&mut Vec<u8>>,
    fields: &mut String,
    row: &LookupRow<'_>,
    has_extra: bool,
) -> csv::Result<()> {
    let extra: &[f64] = if has_extra { &[row.extra] } else { &[] };
    let level = row.level.raw();
    let Some(LookupPlace { patch, link, cell, position, normal }) = row.place else {
        let (before, after) = ([""; 10], [""; 8]);
        return table.serialize((
            row.contact,
            level,
            OFF_SKIN,
            before,
            row.distance,
            after,
            row.frame,
            extra,
        ));
    };
    fields.clear();
    for (field, weight) in cell.weights.iter() {
        let separator = if fields.is_empty() { "" } else { ";" };
        _ = write!(fields, "{separator}{}:{weight:?}", field.raw());
    }
    let DVec2 { x: u, y: v } = cell.uv;
    let (face, field) = (cell.point.face.raw(), cell.field.raw());
    let map = (face, cell.point.barycentric, u, v, cell.pixel, field, cell.taxel.0);
    let skin = (position.to_array(), normal.to_array(), fields.as_str());
    // The crate prints numbers without allocating, and faster than `format!`.
    table.serialize((row.contact, level, patch, map, row.distance, link, skin, row.frame, extra))
}
