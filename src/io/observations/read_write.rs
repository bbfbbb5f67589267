//! Observations for the calibration: g2o text and CSV tables.

use std::{
    collections::HashMap,
    fmt,
    fs::File,
    io::{BufReader, BufWriter, Write},
    path::Path,
};

use crate::{
    calib::{ContactMeasurement, ContactObservation, Displacement, Observations},
    id::VertexId,
    io::{
        IoError,
        file::{extension::kind, lines::Lines, replace::replace_file, source::invalid},
        observations::{csv, g2o},
    },
    skin::TaxelId,
};

/// Observations as a file tells them, and what had to be changed to read them.
#[derive(Debug, Clone, PartialEq)]
pub struct ReadObservations {
    /// The observations.
    pub observations: Observations,
    /// What was changed, left out or assumed.
    pub remarks: Vec<ObservationRemark>,
}

/// Something about a file of observations that a user should know; `Display` tells it in a sentence.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum ObservationRemark {
    /// Lines of a kind that is not known here.
    UnknownTag {
        /// First word of the lines.
        tag: String,
        /// How many there are.
        lines: usize,
    },
    /// Quaternions that were not of unit length.
    Normalised {
        /// How many.
        quaternions: usize,
        /// The length farthest from 1.
        worst: f64,
    },
    /// A table gives no uncertainty.
    AssumedSigma {
        /// The standard deviation assumed instead, in m.
        sigma: f64,
    },
}

impl fmt::Display for ObservationRemark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownTag { tag, lines } => {
                let (s, were) = if *lines == 1 { ("", "was") } else { ("s", "were") };
                write!(f, "{lines} line{s} of the unknown kind {tag} {were} left out")
            }
            Self::Normalised { quaternions, worst } => {
                write!(f, "{quaternions} quaternions were normalised, the worst had length {worst}")
            }
            Self::AssumedSigma { sigma } => {
                write!(f, "the table gives no uncertainty; {} mm per axis was assumed", sigma * 1e3)
            }
        }
    }
}

/// What files of observations may end in.
const KINDS: &str = ".g2o, .csv";

/// Reads observations: `.g2o`, or a table `.csv`; `-` is standard input, of either kind.
///
/// The header of a table names its columns, in any order. A table of displacements has `i,j,dx,dy,dz`; one of contacts
/// `i,x,y,z`, or `i,x,y,z,nx,ny,nz` with normals and, if known, their standard deviation `sigma_n` in rad (else 0.035).
/// Either tells its uncertainty in one of three ways: `sigma`, the standard deviation of every axis in m; `sx,sy,sz`, one for
/// each axis; or `ixx,ixy,ixz,iyy,iyz,izz`, the information in 1/m^2. Without any, 1 mm per axis is assumed and remarked. No
/// cell may be empty, and no other column is allowed: nothing in a table is left unread. Lines after `#` are comments.
///
/// # Errors
/// The first line that breaks a rule of its format, with its number. Lengths above 1e9 m, information above 1e18 and
/// standard deviations outside 1e-9 to 1e9 are refused: their squares say nothing any more.
pub fn read_observations(path: &Path) -> Result<ReadObservations, IoError> {
    if path == Path::new("-") {
        let path = Path::new("standard input");
        let lines = Lines::new(std::io::stdin().lock(), path)?;
        let is_table = lines.current().is_some_and(|(line, _)| csv::is_header(line));
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

/// Writes observations, in numbers that read back to the same bits: `.g2o`, or displacements alone as a table
/// `.csv`, `i,j,dx,dy,dz` with their information; `-` is standard output, in g2o.
///
/// A table has no initial values and no taxels beside those of its displacements.
///
/// # Errors
/// [`IoError::Write`]; [`IoError::Unsupported`] for contacts with normals, which g2o has no line for, and in a table for
/// contacts, fixed taxels and rotations; [`IoError::UnknownKind`].
pub fn write_observations(path: &Path, observations: &Observations) -> Result<(), IoError> {
    if path == Path::new("-") {
        let path = Path::new("standard output");
        let mut out = BufWriter::new(std::io::stdout().lock());
        g2o::write(&mut out, observations, path)?;
        return out.flush().map_err(|source| IoError::Write { path: path.to_owned(), source });
    }
    match kind(path).as_str() {
        "g2o" => replace_file(path, |out| g2o::write(out, observations, path)),
        "csv" => replace_file(path, |out| csv::write_edges(out, observations, path)),
        _ => Err(IoError::UnknownKind { path: path.to_owned(), known: KINDS }),
    }
}

/// Writes the contacts alone as a table `i,x,y,z[,nx,ny,nz],...`.
///
/// # Errors
/// [`IoError::Write`]; [`IoError::Unsupported`] for full poses, which the table has no columns for.
pub fn write_contacts(path: &Path, observations: &Observations) -> Result<(), IoError> {
    replace_file(path, |out| csv::write_contacts(out, observations, path))
}

/// Appends the observations of another file, as contacts come in a table of their own.
///
/// What that file knows of the taxels is taken over, too: where it fixes one, that is where the taxel is; where only it has an
/// initial value, that is the start.
///
/// # Errors
/// [`IoError::Invalid`] if it observes or fixes a taxel that `into` does not have, fixes one elsewhere than `into`
/// does, or has another model.
pub fn append_observations(
    into: &mut ReadObservations,
    other: ReadObservations,
    path: &Path,
) -> Result<(), IoError> {
    check_model(&into.observations, &other.observations, path)?;
    let known: HashMap<TaxelId, VertexId> =
        into.observations.taxels.enumerate().map(|(v, t)| (t.id, v)).collect();
    let taxels = &other.observations.taxels;
    let place = |v: VertexId| {
        let id = taxels[v].id;
        let needed = "a taxel of the other file";
        known
            .get(&id)
            .copied()
            .ok_or_else(|| invalid(path, format!("taxel {id}"), "an observation of it", needed))
    };
    for (v, taxel) in taxels.enumerate().filter(|(_, t)| t.initial.is_some()) {
        let Some(here) = known.get(&taxel.id).map(|&v| &mut into.observations.taxels[v]) else {
            if taxel.fixed {
                place(v)?;
            }
            continue;
        };
        if taxel.fixed && here.fixed && here.initial != taxel.initial {
            let needed = "the place where the other file fixes it";
            return Err(invalid(
                path,
                format!("taxel {}", taxel.id),
                "another place where it is fixed",
                needed,
            ));
        }
        // Where a taxel is fixed it is known; any other value is a guess, and the first one counts.
        if taxel.fixed || here.initial.is_none() {
            here.initial = taxel.initial;
        }
        here.fixed |= taxel.fixed;
    }
    for contact in &other.observations.contacts {
        let taxel = place(contact.taxel)?;
        into.observations
            .contacts
            .push(ContactObservation { taxel, measurement: contact.measurement.clone() });
    }
    for edge in &other.observations.edges {
        let (from, to) = (place(edge.from)?, place(edge.to)?);
        into.observations.edges.push(Displacement { from, to, measurement: edge.measurement.clone() });
    }
    into.remarks.extend(other.remarks);
    Ok(())
}

/// Contacts with positions fit every model; all else has one.
fn check_model(into: &Observations, other: &Observations, path: &Path) -> Result<(), IoError> {
    let has_model = !other.edges.is_empty()
        || other.taxels.iter().any(|t| t.initial.is_some())
        || other.contacts.iter().any(|c| matches!(c.measurement, ContactMeasurement::Pose(_)));
    if has_model && other.model != into.model {
        let found = format!("observations of the {} model", other.model.name());
        let needed = format!("{}, as in the other file", into.model.name());
        return Err(invalid(path, "the file", found, needed));
    }
    Ok(())
}
