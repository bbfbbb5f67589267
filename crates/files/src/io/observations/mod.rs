//! Observations for the calibration, g2o text or CSV tables, by the extension of their file.

pub(super) mod builder;
mod csv;
mod g2o;
mod touch_columns;
mod touch_stream;

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

use crate::calib::{ContactMeasurement, ContactObservation, Displacement, Observations};
use crate::id::VertexId;
use crate::io::IoError;
use crate::io::file::{Lines, OutPath, cannot_read, exists, file_kind, invalid, replace_file};
use crate::io::observations::builder::{ObservationRemark, ReadObservations};
use crate::skin::TaxelId;

pub use touch_stream::{TouchStream, touches_from_stream};

/// What files of observations may end in.
const KINDS: &str = ".g2o, .csv";

/// Reads observations: `.g2o`, or a table `.csv`.
///
/// The header of a table names its columns, in any order. A table of displacements has
/// `i,j,dx,dy,dz`; one of contacts `i,x,y,z`, or `i,x,y,z,nx,ny,nz` with normals and, if known,
/// their standard deviation `sigma_n` in rad (else 0.035). Either gives its uncertainty in one of
/// three ways: `sigma`, the standard deviation of every axis in m; `sx,sy,sz`, one for each axis;
/// or `ixx,ixy,ixz,iyy,iyz,izz`, the information in 1/m^2. Without any, 1 mm per axis is assumed
/// and remarked. No cell may be empty, and no other column is allowed: a misspelt name is not
/// silently ignored. Contacts may have the columns of [`TouchRow`](crate::calib::TouchRow): `touch` and `contact`,
/// whole numbers, `weight`, above 0, `qx,qy,qz,qw`, `px,py,pz,radius`, `outx,outy,outz` and `pathx,pathy,pathz`. Lines after `#` are comments.
///
/// The observations of `more` files are appended, as contacts come in a table of their own. A pose
/// that one of them fixes is fixed; its initial value is used where there is none yet.
///
/// Returns the observations, and what was changed, left out or assumed. Information that is not
/// positive semi-definite is returned as it is, with a remark: [`Observations::validate`] refuses it,
/// and [`Observations::clip_information`] repairs it.
///
/// # Errors
/// The first line that breaks a rule of its format, with its number; a further file that observes
/// or fixes a taxel the first one does not have, or has another model. Lengths above 1e12 m,
/// information above 1e18 and standard deviations outside 1e-9 to 1e9 are refused: their squares
/// are redundant then.
pub fn read_observations(
    path: &Path,
    more: &[PathBuf],
) -> Result<(Observations, Vec<ObservationRemark>), IoError> {
    with_more(read(path)?, more)
}

/// As [`read_observations`], with the first ones from a stream of either kind; errors call it `name`.
///
/// # Errors
/// As [`read_observations`].
pub fn observations_from_stream(
    input: impl BufRead + 'static,
    name: &Path,
    more: &[PathBuf],
) -> Result<(Observations, Vec<ObservationRemark>), IoError> {
    with_more(read_lines(Box::new(input), name, None)?, more)
}

fn with_more(
    (mut observations, mut remarks): ReadObservations,
    more: &[PathBuf],
) -> Result<ReadObservations, IoError> {
    for path in more {
        let (other, others_remarks) = read(path)?;
        append(&mut observations, other, path)?;
        remarks.extend(others_remarks);
    }
    Ok((observations, remarks))
}

fn read(path: &Path) -> Result<ReadObservations, IoError> {
    exists(path)?;
    let kind = file_kind(path);
    if !matches!(kind.as_str(), "g2o" | "csv") {
        return Err(IoError::UnknownKind { path: path.to_owned(), known: KINDS });
    }
    let file = File::open(path).map_err(cannot_read(path))?;
    read_lines(Box::new(BufReader::new(file)), path, Some(kind == "csv"))
}

/// Reads a table, g2o text, or whichever of them the first line looks like.
fn read_lines(
    input: Box<dyn BufRead>,
    path: &Path,
    is_table: Option<bool>,
) -> Result<ReadObservations, IoError> {
    let mut lines = Lines::new(input, path, Some(b'#'));
    lines.advance()?;
    let has_header = || Ok::<_, IoError>(lines.current()?.is_some_and(|(line, _)| csv::is_header(line)));
    if is_table.map_or_else(has_header, Ok)? { csv::read(lines) } else { g2o::read(lines) }
}

/// Writes observations, in numbers that read back to the same bits: `.g2o`, or as a table `.csv`
/// displacements alone, `i,j,dx,dy,dz`, or contacts alone, `i,x,y,z[,nx,ny,nz,sigma_n]`, with their
/// information.
///
/// A table has no initial values and no taxels but those of its rows; a graph has no touches.
///
/// # Errors
/// [`IoError::Write`]; [`IoError::Unfit`] for contacts with normals, which g2o has no line for, and
/// in a table for contacts next to displacements, fixed taxels and rotations;
/// [`IoError::UnknownKind`].
pub fn write_observations(path: impl Into<OutPath>, observations: &Observations) -> Result<(), IoError> {
    let path = &path.into();
    match file_kind(path).as_str() {
        "g2o" => replace_file(path, |out| g2o::write(out, observations, path)),
        "csv" => csv::write(observations, path),
        _ => Err(IoError::UnknownKind { path: path.into(), known: KINDS }),
    }
}

/// Writes observations to a stream as g2o text; errors call it `name`.
///
/// # Errors
/// As [`write_observations`].
pub fn observations_to_stream(
    output: &mut dyn Write,
    name: &Path,
    observations: &Observations,
) -> Result<(), IoError> {
    g2o::write(output, observations, name)
}

/// Appends the observations of the file `path`, as contacts come in a table of their own.
///
/// Taxel data are merged: a pose fixed in `other` is fixed in the result; an initial value from
/// `other` is used if `into` has none.
fn append(into: &mut Observations, other: Observations, path: &Path) -> Result<(), IoError> {
    check_model(into, &other, path)?;
    let is_torn = !other.touches.is_empty() && !into.contacts.is_empty()
        || !into.touches.is_empty() && !other.contacts.is_empty();
    if is_torn {
        let needed = "all contacts in one table: the numbers of touches are those of their table";
        return Err(invalid(
            path,
            "the file",
            "contacts next to those of another table with touches",
            needed,
        ));
    }
    if !other.touches.is_empty() {
        into.joints.clone_from(&other.joints);
    }
    other.touches.iter().for_each(|row| {
        into.touches.push(row.clone());
    });
    let known: HashMap<TaxelId, VertexId> = into.taxels.enumerate().map(|(v, t)| (t.id, v)).collect();
    let taxels = &other.taxels;
    let place = |v: VertexId| {
        let id = taxels[v].id;
        let refuse =
            || invalid(path, format!("taxel {id}"), "an observation of it", "a taxel of the other file");
        known.get(&id).copied().ok_or_else(refuse)
    };
    for (v, taxel) in taxels.enumerate().filter(|(_, t)| t.initial.is_some()) {
        let Some(here) = known.get(&taxel.id).map(|&v| &mut into.taxels[v]) else {
            if taxel.fixed {
                place(v)?;
            }
            continue;
        };
        if taxel.fixed && here.fixed && here.initial != taxel.initial {
            let (found, needed) = ("another fixed position of it", "that of the other file");
            return Err(invalid(path, format!("taxel {}", taxel.id), found, needed));
        }
        // Where a taxel is fixed it is known; any other value is a guess, and the first one counts.
        if taxel.fixed || here.initial.is_none() {
            here.initial = taxel.initial;
        }
        here.fixed |= taxel.fixed;
    }
    for ContactObservation { taxel, measurement } in other.contacts {
        into.contacts.push(ContactObservation { taxel: place(taxel)?, measurement });
    }
    for Displacement { from, to, measurement } in other.edges {
        into.edges.push(Displacement { from: place(from)?, to: place(to)?, measurement });
    }
    Ok(())
}

/// Contacts with positions fit every model; all else has one.
fn check_model(into: &Observations, other: &Observations, path: &Path) -> Result<(), IoError> {
    let has_model = !other.edges.is_empty()
        || other.taxels.iter().any(|t| t.initial.is_some())
        || other.contacts.iter().any(|c| matches!(c.measurement, ContactMeasurement::Pose { .. }));
    if has_model && other.model != into.model {
        let found = format!("observations of the {} model", other.model);
        let needed = format!("{}, as in the other file", into.model);
        return Err(invalid(path, "the file", found, needed));
    }
    Ok(())
}
