//! Tables of contacts and of places on maps, read one by one.

use std::io::{BufReader, Read};
use std::path::Path;

use glam::{DVec2, DVec3};

use crate::io::IoError;
use crate::io::file::lines::Lines;
use crate::io::table::lookups::OFF_SKIN;
use crate::io::table::{Row, Table, TableRows};

const COLUMNS: [&str; 11] = ["x", "y", "z", "nx", "ny", "nz", "force", "radius", "link", "only_link", "time"];

/// Columns that make a table one of answers. One of them does not: a `frame` may also be the number of an
/// image.
const OF_ANSWERS: [&str; 2] = ["contact", "frame"];

/// A table of which each row is one line: there may be many, and a bad one must not cost the others.
fn open<R: Read>(path: &Path, input: R) -> Result<Table<BufReader<R>>, IoError> {
    let mut lines = Lines::new(BufReader::new(input), path, None);
    lines.has_row_per_line = true;
    lines.advance()?;
    Table::open(lines)
}

/// The contacts of a table.
pub type ContactRows<R> = TableRows<BufReader<R>, ContactRow>;

/// The places of a table.
pub type MapPlaceRows<R> = TableRows<BufReader<R>, MapPlaceRow>;

/// One contact of a table.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactRow {
    /// Where it is, in m; in `frame`, without one in that of `link`, and in the world without either.
    /// `None`: nowhere, since the contact of this row of a lookup was off the skin.
    pub position: Option<DVec3>,
    /// Direction, as given.
    pub normal: Option<DVec3>,
    /// Force, in N.
    pub force: Option<f64>,
    /// Radius of the touching sphere, in m.
    pub radius: Option<f64>,
    /// The frame it is in, if it is an answer of a lookup: `world`, or the name of a link.
    pub frame: Option<String>,
    /// Name of the link in whose frame it is.
    pub link: Option<String>,
    /// Name of the link whose skin alone it can be on.
    pub only_link: Option<String>,
    /// When it was, in s.
    pub time: Option<f64>,
    /// Line of the table it stands in, from 1.
    pub line: u64,
}

/// Reads contacts one by one from a table whose first line names the columns: `x,y,z` and
/// optionally `nx,ny,nz`, `force`, `radius`, `link`, `only_link` and `time`, in any order. Cells of optional
/// columns may be empty. A table of answers, which has columns `contact` and `frame`, has its contacts in
/// `frame`: there `link` is the one that was touched, and is not read. In a table of contacts of readings, which has a column `event`,
/// the force of a `release` is 0. Returns the names of columns that
/// are not read, and the contacts; errors call the table `path`.
///
/// Memory does not grow with the table. After an error about a line the iterator goes on with the
/// next one; it ends when the stream fails.
///
/// # Errors
/// If a name comes twice, `x`, `y` or `z` is missing, or only a part of `nx,ny,nz` is there.
pub fn read_contacts<R: Read>(path: &Path, input: R) -> Result<(Vec<String>, ContactRows<R>), IoError> {
    let table = open(path, input)?;
    let columns = &table.columns;
    let is_answers = OF_ANSWERS.iter().all(|name| columns.find(name).is_some());
    let frame_or_link = if is_answers { "frame" } else { "link" };
    let is_unread = |name: &str| name == "link" && name != frame_or_link;
    let known: Vec<&str> =
        COLUMNS.into_iter().chain([frame_or_link]).filter(|name| !is_unread(name)).collect();
    let event = columns.find("event");
    let known: Vec<&str> = known.into_iter().chain(event.map(|_| "event")).collect();
    let unknown = columns.unused(&known);
    let position = columns.need_vector(["x", "y", "z"])?;
    let normal = columns.find_vector(["nx", "ny", "nz"])?;
    let [force, radius] = ["force", "radius"].map(|name| columns.find(name));
    let time = columns.find_time()?;
    let [name, only_link] = [frame_or_link, "only_link"].map(|name| columns.find(name));
    let patch = columns.find("patch").filter(|_| is_answers);
    let contact = move |row: Row<'_>| {
        let number = |column: Option<usize>| column.map_or(Ok(None), |c| row.number_if_any(c));
        let text = |column: Option<usize>| {
            column.map(|c| row.text(c)).filter(|name| !name.is_empty()).map(str::to_owned)
        };
        let name = text(name);
        let (frame, link) = if is_answers { (name, None) } else { (None, name) };
        let has_ended = |row: Row<'_>| event.is_some_and(|c| row.text(c) == "release");
        let is_off = patch.is_some_and(|c| is_off_skin(row, c, &position));
        let reach = number(radius)?;
        if let (Some(column), true) = (radius, reach.is_some_and(|r| r < 0.0)) {
            return Err(row.invalid(column, "a radius of at least 0 m"));
        }
        Ok(ContactRow {
            position: if is_off { None } else { Some(row.vector(position)?) },
            normal: normal.map_or(Ok(None), |c| row.numbers_if_any(c))?.map(DVec3::from_array),
            force: number(force)?.map(|force| if has_ended(row) { 0.0 } else { force }),
            radius: reach,
            frame,
            link,
            only_link: text(only_link),
            time: row.time_if_any(time)?,
            line: row.at.line as u64,
        })
    };
    Ok((unknown, table.into_rows(contact)))
}

/// Whether a row of answers is that of a contact off the skin, and has no place.
fn is_off_skin(row: Row<'_>, patch: usize, place: &[usize]) -> bool {
    row.text(patch) == OFF_SKIN && place.iter().all(|&c| row.text(c).is_empty())
}

/// Columns of a table of places on maps.
const MAP_COLUMNS: [&str; 7] = ["patch", "level", "u", "v", "px", "py", "time"];

/// A place of a table, on the map of a level.
#[derive(Debug, Clone, PartialEq)]
pub struct MapPlaceRow {
    /// Name of the patch; empty if the table does not name it.
    pub patch: String,
    /// The level.
    pub level: usize,
    /// Where on its map; `None`: nowhere, since the contact of this row of a lookup was off the skin.
    pub position: Option<MapCoordinates>,
    /// The time of the robot's pose, in s.
    pub time: Option<f64>,
    /// Line of the table it stands in, from 1.
    pub line: u64,
}

/// Where on the map of a level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MapCoordinates {
    /// Map position, in m.
    Metres(DVec2),
    /// Column and row of a pixel of the level's image, the first row at the top.
    Pixel([u32; 2]),
}

/// Reads places on maps one by one from a table whose first line names the columns: `u,v` (m), or
/// else `px,py`, and optionally `patch`, `level` (0 where it is empty) and `time`, in any order: the
/// answers of a lookup are such a table. Returns the names of columns that are not read, and the places;
/// errors call the table `path`. It is read as [`read_contacts`] does.
///
/// # Errors
/// If a name comes twice, or neither `u,v` nor `px,py` is there.
pub fn read_map_places<R: Read>(path: &Path, input: R) -> Result<(Vec<String>, MapPlaceRows<R>), IoError> {
    let table = open(path, input)?;
    let columns = &table.columns;
    let (map, pixel) = (columns.find_vector(["u", "v"])?, columns.find_vector(["px", "py"])?);
    let is_read = |name: &&str| !(map.is_some() && ["px", "py"].contains(name));
    let known: Vec<&str> = MAP_COLUMNS.into_iter().filter(is_read).collect();
    let unknown = columns.unused(&known);
    let (place_columns, is_map) = match (map, pixel) {
        (Some(map), _) => (map, true),
        (None, Some(pixel)) => (pixel, false),
        (None, None) => return Err(columns.at().invalid(columns.describe(), "columns `u,v` or `px,py`")),
    };
    let [patch, level] = ["patch", "level"].map(|name| columns.find(name));
    let time = columns.find_time()?;
    let place = move |row: Row<'_>| {
        let whole = |column: usize| {
            row.text(column)
                .parse::<u32>()
                .map_err(|_| row.invalid(column, "a whole number, 0 to 4294967295"))
        };
        let level = level.filter(|&c| !row.text(c).is_empty()).map_or(Ok(0), whole)?;
        let position = if patch.is_some_and(|c| is_off_skin(row, c, &place_columns)) {
            None
        } else if is_map {
            Some(MapCoordinates::Metres(DVec2::from_array(row.numbers(place_columns)?)))
        } else {
            let [x, y] = place_columns;
            Some(MapCoordinates::Pixel([whole(x)?, whole(y)?]))
        };
        Ok(MapPlaceRow {
            patch: patch.map_or("", |c| row.text(c)).to_owned(),
            level: level as usize,
            position,
            time: row.time_if_any(time)?,
            line: row.at.line as u64,
        })
    };
    Ok((unknown, table.into_rows(place)))
}
