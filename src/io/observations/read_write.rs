//! Observations for the calibration: g2o text and CSV tables.

use std::{
    fs::File,
    io::{BufReader, BufWriter, Write},
    path::Path,
};

use crate::{
    calib::Observations,
    io::{
        IoError,
        file::{lines::Lines, replace::replace_file, source::kind},
        observations::{csv, g2o, types::ReadObservations},
    },
};

/// What files of observations may end in.
const KINDS: &str = ".g2o, .csv";

/// Reads observations: `.g2o`, or a table `.csv`; `-` is standard input, of either kind.
///
/// The header of a table names its columns, in any order. A table of displacements has
/// `i,j,dx,dy,dz`; one of contacts `i,x,y,z`, or `i,x,y,z,nx,ny,nz` with normals and, if known,
/// their standard deviation `sigma_n` in rad (else 0.035). Either gives its uncertainty in one of
/// three ways: `sigma`, the standard deviation of every axis in m; `sx,sy,sz`, one for each axis;
/// or `ixx,ixy,ixz,iyy,iyz,izz`, the information in 1/m^2. Without any, 1 mm per axis is assumed
/// and remarked. No cell may be empty, and no other column is allowed: a misspelt name is not
/// silently ignored. Lines after `#` are comments.
///
/// # Errors
/// The first line that breaks a rule of its format, with its number. Lengths above 1e9 m,
/// information above 1e18 and standard deviations outside 1e-9 to 1e9 are refused: their squares
/// say nothing any more.
pub fn read_observations(path: &Path) -> Result<ReadObservations, IoError> {
    if path == Path::new("-") {
        let path = Path::new("standard input");
        let lines = Lines::new(std::io::stdin().lock(), path)?;
        let is_table = lines.current()?.is_some_and(|(line, _)| csv::is_header(line));
        return if is_table { csv::read(lines, path) } else { g2o::read(lines, path) };
    }
    let read = match kind(path).as_str() {
        "g2o" => g2o::read,
        "csv" => csv::read,
        _ => return Err(IoError::UnknownKind { path: path.to_owned(), known: KINDS }),
    };
    let file = File::open(path).map_err(|source| IoError::Read { path: path.to_owned(), source })?;
    read(Lines::new(BufReader::new(file), path)?, path)
}

/// Writes observations, in numbers that read back to the same bits: `.g2o`, or displacements alone
/// as a table `.csv`, `i,j,dx,dy,dz` with their information; `-` is standard output, in g2o.
///
/// A table has no initial values and no taxels but those of its displacements.
///
/// # Errors
/// [`IoError::Write`]; [`IoError::Unsupported`] for contacts with normals, which g2o has no line
/// for, and in a table for contacts, fixed taxels and rotations; [`IoError::UnknownKind`].
pub fn write_observations(path: &Path, observations: &Observations) -> Result<(), IoError> {
    if path == Path::new("-") {
        let path = Path::new("standard output");
        let mut out = BufWriter::new(std::io::stdout().lock());
        g2o::write(&mut out, observations, path)?;
        return out.flush().map_err(|source| IoError::Write { path: path.to_owned(), source });
    }
    match kind(path).as_str() {
        "g2o" => replace_file(path, |out| g2o::write(out, observations, path)),
        "csv" => csv::write_edges(observations, path),
        _ => Err(IoError::UnknownKind { path: path.to_owned(), known: KINDS }),
    }
}

/// Writes the contacts alone as a table `i,x,y,z[,nx,ny,nz],...`.
///
/// # Errors
/// [`IoError::Write`]; [`IoError::Unsupported`] for full poses, which the table has no columns for.
pub fn write_contacts(path: &Path, observations: &Observations) -> Result<(), IoError> {
    csv::write_contacts(observations, path)
}
