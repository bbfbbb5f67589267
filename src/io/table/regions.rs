//! Contacts of a recording, written frame by frame: a table, or a JSON object per line.

use std::{
    fs::File,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};

use serde::Serialize;

use crate::{
    io::{
        IoError,
        file::{replace::Replacement, source::kind},
        table::csv_table::table_write_error,
    },
    map::SkinMap,
    signal::{ContactEvent, ContactRegion},
};

/// Columns of the table, and keys of the objects, in the order of [`Row`].
const COLUMNS: [&str; 22] = [
    "frame",
    "time",
    "track",
    "event",
    "patch",
    "link",
    "taxels",
    "area",
    "force",
    "x",
    "y",
    "z",
    "nx",
    "ny",
    "nz",
    "u",
    "v",
    "major",
    "minor",
    "angle",
    "peak_taxel_id",
    "peak",
];

/// One contact in one frame.
#[derive(Serialize)]
struct Row<'a> {
    frame: u64,
    time: f64,
    track: u64,
    event: &'a str,
    patch: &'a str,
    link: &'a str,
    taxels: usize,
    area: f64,
    force: f64,
    x: f64,
    y: f64,
    z: f64,
    nx: f64,
    ny: f64,
    nz: f64,
    u: f64,
    v: f64,
    major: f64,
    minor: f64,
    angle: f64,
    peak_taxel_id: u32,
    peak: f64,
}

/// Writes the contacts of a recording frame by frame: a table, or if the file ends in `.jsonl` a
/// JSON object per line with the same keys.
///
/// `frame,time,track,event,patch,link,taxels,area,force,x,y,z,nx,ny,nz,u,v,major,minor,angle,peak_taxel_id,peak`:
/// `event` is `onset`, `move` or `release`, `taxels` their number, `x` to `nz` the centre of pressure
/// and the normal there in the frame of the link, `u,v` the centre on the map; a row of a release
/// says how the contact was in the frame before. SI units; decimals are the shortest that read back
/// as the same `f64`. In JSON a time that is not known is `null`.
///
/// Nothing appears in the file's place before [`RegionWriter::finish`].
pub struct RegionWriter<'a> {
    path: PathBuf,
    map: &'a SkinMap,
    output: Output,
}

enum Output {
    Table(Box<csv::Writer<Destination>>),
    Lines(BufWriter<Destination>),
}

/// The file that is to be replaced, as something to write to.
struct Destination(Replacement);

impl Write for Destination {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut file: &File = self.0.file();
        file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl<'a> RegionWriter<'a> {
    /// Starts a file of contacts on this map.
    ///
    /// # Errors
    /// If the file is neither `.csv` nor `.jsonl`, or cannot be created.
    pub fn create(path: &Path, map: &'a SkinMap) -> Result<Self, IoError> {
        let kind = kind(path);
        if kind != "csv" && kind != "jsonl" {
            return Err(IoError::UnknownKind { path: path.into(), known: ".csv, .jsonl" });
        }
        let file = Destination(Replacement::open(path)?);
        let output = if kind == "jsonl" {
            Output::Lines(BufWriter::new(file))
        } else {
            let mut table = csv::WriterBuilder::new().has_headers(false).from_writer(file);
            table.write_record(COLUMNS).map_err(|e| table_write_error(path, e))?;
            Output::Table(Box::new(table))
        };
        Ok(Self { path: path.into(), map, output })
    }

    /// Writes the contacts of one frame.
    ///
    /// # Errors
    /// If the disk is full.
    ///
    /// # Panics
    /// If a contact is not one on this map.
    pub fn write(&mut self, frame: u64, time: f64, regions: &[ContactRegion]) -> Result<(), IoError> {
        for region in regions {
            let row = row(self.map, frame, time, region);
            match &mut self.output {
                Output::Table(table) => table.serialize(row).map_err(|e| table_write_error(&self.path, e))?,
                Output::Lines(lines) => serde_json::to_writer(&mut *lines, &row)
                    .map_err(io::Error::from)
                    .and_then(|()| lines.write_all(b"\n"))
                    .map_err(|source| IoError::Write { path: self.path.clone(), source })?,
            }
        }
        Ok(())
    }

    /// Puts the file in its place.
    ///
    /// # Errors
    /// If the disk is full.
    pub fn finish(self) -> Result<(), IoError> {
        let Self { path, output, .. } = self;
        let written = match output {
            Output::Table(table) => table.into_inner().map_err(|e| e.into_error()),
            Output::Lines(lines) => lines.into_inner().map_err(io::IntoInnerError::into_error),
        };
        written.map_err(|source| IoError::Write { path, source })?.0.finish()
    }
}

fn row<'a>(map: &'a SkinMap, frame: u64, time: f64, region: &ContactRegion) -> Row<'a> {
    let patch = &map.patches[region.patch];
    let ([x, y, z], [nx, ny, nz]) = (region.centre.to_array(), region.normal.to_array());
    let event = match region.event {
        ContactEvent::Onset => "onset",
        ContactEvent::Move => "move",
        ContactEvent::Release => "release",
    };
    Row {
        frame,
        time,
        track: region.track,
        event,
        patch: &patch.name,
        link: &map.links[region.link].name,
        taxels: region.taxels.len(),
        area: region.area,
        force: region.force,
        x,
        y,
        z,
        nx,
        ny,
        nz,
        u: region.map.x,
        v: region.map.y,
        major: region.major,
        minor: region.minor,
        angle: region.angle,
        peak_taxel_id: patch.taxels.ids[region.peak_taxel].0,
        peak: region.peak,
    }
}
