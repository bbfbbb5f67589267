//! Tables of displacements and of contacts.

use std::{io::BufRead, path::Path};

use glam::DVec3;

use crate::{
    calib::{ContactMeasurement, DisplacementMeasurement, Information, Model, Observations},
    id::VertexId,
    io::{
        IoError,
        file::{
            lines::{LineLocation, Lines},
            source::{excerpt, invalid},
        },
        observations::{
            builder::{ObservationsBuilder, SIGMA_RANGE, information_of},
            types::ReadObservations,
        },
        table::csv_table::{Columns, Row, Table, decimals, write_table},
    },
};

/// Uncertainty where a table gives none, in m per axis: that of the source paper's experiment.
const DEFAULT_SIGMA: f64 = 1e-3;

/// Uncertainty of a normal where a table gives none, in rad: two degrees, a fingertip on a 5 mm
/// taxel.
const DEFAULT_NORMAL_SIGMA: f64 = 0.035;

/// Columns of a displacement.
const OFFSET: [&str; 3] = ["dx", "dy", "dz"];

/// Columns of the position of a contact.
const POSITION: [&str; 3] = ["x", "y", "z"];

/// Columns of the normal of a contact.
const NORMAL: [&str; 3] = ["nx", "ny", "nz"];

/// Column of the standard deviation of the normal, in rad.
const NORMAL_SIGMA: &str = "sigma_n";

/// Column of the standard deviation in every direction, in m.
const SIGMA: &str = "sigma";

/// Columns of the standard deviation of each axis, in m.
const SIGMAS: [&str; 3] = ["sx", "sy", "sz"];

/// Columns of the information, in the order of the upper triangle, in 1/m^2.
const INFORMATION: [&str; 6] = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];

/// What a table may hold, for messages.
const TABLES: &str = "i,j,dx,dy,dz or i,x,y,z[,nx,ny,nz[,sigma_n]], then sigma or sx,sy,sz or \
                      ixx,ixy,ixz,iyy,iyz,izz, separated by commas";

/// Whether a line is the header of a table, whatever separates its words: g2o has no such words.
pub(super) fn is_header(line: &str) -> bool {
    let is_name = |name: &str| {
        let known =
            [&["i", "j", SIGMA, NORMAL_SIGMA][..], &OFFSET, &POSITION, &NORMAL, &SIGMAS, &INFORMATION];
        known.iter().any(|names| names.contains(&name))
    };
    line.split([',', ';', '\t']).any(|word| is_name(&cell(word).to_ascii_lowercase()))
}

/// A cell without blanks and quotes around it.
fn cell(text: &str) -> &str {
    let text = text.trim();
    text.strip_prefix('"').and_then(|t| t.strip_suffix('"')).map_or(text, str::trim)
}

/// Where the columns of a table are.
struct ColumnIndices {
    taxel: usize,
    subject: Subject,
    uncertainty: Uncertainty,
}

/// What the rows observe.
#[derive(Clone, Copy)]
enum Subject {
    Displacement { other: usize, offset: [usize; 3] },
    ContactObservation { position: [usize; 3], normal: Option<([usize; 3], Option<usize>)> },
}

/// How the rows give their uncertainty.
enum Uncertainty {
    Assumed,
    Sigma(usize),
    Sigmas([usize; 3]),
    Information([usize; 6]),
}

impl ColumnIndices {
    fn new(columns: &Columns, path: &Path, line: u64) -> Result<Self, IoError> {
        let mut used = vec!["i"];
        let has = |name: &str| columns.find(name).is_some();
        let Some(taxel) = columns.find("i") else {
            return Err(invalid(path, format!("line {line}"), columns.describe(), TABLES));
        };
        let subject = if has("j") || OFFSET.iter().any(|name| has(name)) {
            used.extend(["j"].into_iter().chain(OFFSET));
            Subject::Displacement { other: columns.need("j")?, offset: columns.need_vector(OFFSET)? }
        } else {
            used.extend(POSITION);
            let position = columns.need_vector(POSITION)?;
            let normal = columns.find_vector(NORMAL)?;
            if normal.is_some() {
                used.extend(NORMAL.into_iter().chain([NORMAL_SIGMA]));
            }
            Subject::ContactObservation {
                position,
                normal: normal.map(|columns_of_normal| (columns_of_normal, columns.find(NORMAL_SIGMA))),
            }
        };
        let uncertainty = if let Some(column) = columns.find(SIGMA) {
            used.push(SIGMA);
            Uncertainty::Sigma(column)
        } else if let Some(three) = columns.find_vector(SIGMAS)? {
            used.extend(SIGMAS);
            Uncertainty::Sigmas(three)
        } else if let Some(six) = columns.find_vector(INFORMATION)? {
            used.extend(INFORMATION);
            Uncertainty::Information(six)
        } else {
            Uncertainty::Assumed
        };
        // Unknown columns are an error, so that a misspelt name is not silently ignored.
        used.retain(|name| columns.find(name).is_some());
        if let Some((_, name)) = columns.unknown(&used).next() {
            let found = format!("a column {}, which says nothing next to {}", excerpt(name), used.join(","));
            return Err(invalid(path, format!("line {line}"), found, TABLES));
        }
        Ok(Self { taxel, subject, uncertainty })
    }
}

pub(super) fn read(lines: Lines<'_, impl BufRead>, path: &Path) -> Result<ReadObservations, IoError> {
    let mut builder = ObservationsBuilder::new(path);
    if lines.current()?.is_none() {
        return Err(invalid(path, "the file", "an empty file, or comments alone", TABLES));
    }
    let table = Table::open(path, lines)?;
    let columns = ColumnIndices::new(&table.columns, path, table.row().line)?;
    if matches!(columns.uncertainty, Uncertainty::Assumed) {
        builder.assumed_sigma = Some(DEFAULT_SIGMA);
    }
    table.each_row(&mut |row| {
        let line = usize::try_from(row.line).unwrap_or(usize::MAX);
        Observation { row, at: LineLocation { path, line } }.read(&columns, &mut builder)
    })?;
    builder.finish()
}

/// One row of a table.
struct Observation<'a> {
    row: Row<'a>,
    at: LineLocation<'a>,
}

impl Observation<'_> {
    fn read(&self, columns: &ColumnIndices, builder: &mut ObservationsBuilder<'_>) -> Result<(), IoError> {
        let (row, at) = (&self.row, &self.at);
        let id = row.taxel(columns.taxel)?;
        let information = self.information(&columns.uncertainty)?;
        match columns.subject {
            Subject::Displacement { other, offset } => {
                let ids = [id, row.taxel(other)?];
                let offset = row.vector(offset)?;
                builder.set_model(Model::Positions, at)?;
                builder.edge(ids, DisplacementMeasurement::Offset { offset, information }, at)
            }
            Subject::ContactObservation { position, normal } => {
                let position = row.vector(position)?;
                let touch = match normal {
                    None => ContactMeasurement::Position { position, information },
                    Some((columns, sigma)) => {
                        let normal = self.normal(columns)?;
                        let assumed = || Ok(DEFAULT_NORMAL_SIGMA.powi(-2));
                        let normal_information = sigma.map_or_else(assumed, |k| self.sigma(k))?;
                        ContactMeasurement::PositionNormal {
                            position,
                            information,
                            normal,
                            normal_information,
                        }
                    }
                };
                builder.contact(id, touch, at)
            }
        }
    }

    fn information(&self, uncertainty: &Uncertainty) -> Result<Information<3>, IoError> {
        Ok(match uncertainty {
            Uncertainty::Assumed => Information::diagonal([DEFAULT_SIGMA.powi(-2); 3]),
            Uncertainty::Sigma(k) => Information::diagonal([self.sigma(*k)?; 3]),
            Uncertainty::Sigmas([x, y, z]) => {
                Information::diagonal([self.sigma(*x)?, self.sigma(*y)?, self.sigma(*z)?])
            }
            Uncertainty::Information([xx, xy, xz, yy, yz, zz]) => {
                let row = |columns| self.row.vector(columns).map(|v| v.to_array());
                Information([row([*xx, *xy, *xz])?, row([*xy, *yy, *yz])?, row([*xz, *yz, *zz])?])
            }
        })
    }

    /// The information of a standard deviation.
    fn sigma(&self, column: usize) -> Result<f64, IoError> {
        let needed = || format!("a sigma of {:e} to {:e}", SIGMA_RANGE.start(), SIGMA_RANGE.end());
        information_of(self.row.number(column)?).ok_or_else(|| self.row.invalid(column, needed()))
    }

    fn normal(&self, columns: [usize; 3]) -> Result<DVec3, IoError> {
        let found = self.row.vector(columns)?;
        let needed = "a normal with a direction";
        found.try_normalize().ok_or_else(|| self.at.invalid(format!("the normal {found}"), needed))
    }
}

/// Writes displacements; the table has no place for anything else.
pub(super) fn write_edges(observations: &Observations, path: &Path) -> Result<(), IoError> {
    let unsupported = |element: String, feature: &str, remedy: &str| IoError::Unsupported {
        path: path.to_owned(),
        element,
        feature: feature.into(),
        remedy: remedy.into(),
    };
    let id = |v: VertexId| observations.taxels[v].id;
    if let Some(contact) = observations.contacts.iter().next() {
        return Err(unsupported(
            format!("taxel {}", id(contact.taxel)),
            "a contact among displacements",
            "write a .g2o file, or the contacts to a table of their own",
        ));
    }
    if let Some(fixed) = observations.taxels.iter().find(|t| t.fixed) {
        return Err(unsupported(format!("taxel {}", fixed.id), "a fixed place", "write a .g2o file"));
    }
    let header: Vec<&str> = ["i", "j"].into_iter().chain(OFFSET).chain(INFORMATION).collect();
    let mut rows = observations.edges.iter().map(|edge| {
        let (from, to) = (id(edge.from), id(edge.to));
        let DisplacementMeasurement::Offset { offset, information } = &edge.measurement else {
            return Err(unsupported(format!("edge {from} to {to}"), "a rotation", "write a .g2o file"));
        };
        let numbers = offset.to_array().into_iter().chain(information.upper());
        Ok([from, to].map(|id| id.to_string()).into_iter().chain(decimals(numbers)).collect())
    });
    write_table(path, &header, &mut rows)
}

/// Writes contacts, with their normals if they have any.
pub(super) fn write_contacts(observations: &Observations, path: &Path) -> Result<(), IoError> {
    let with_normals = observations
        .contacts
        .iter()
        .any(|c| matches!(c.measurement, ContactMeasurement::PositionNormal { .. }));
    let normals: &[&str] = if with_normals { &["nx", "ny", "nz", NORMAL_SIGMA] } else { &[] };
    let header = ["i"].into_iter().chain(POSITION).chain(normals.iter().copied()).chain(INFORMATION);
    let mut rows = observations.contacts.iter().map(|contact| {
        let id = observations.taxels[contact.taxel].id;
        let unsupported = |feature: &str, remedy: &str| IoError::Unsupported {
            path: path.to_owned(),
            element: format!("the contact of taxel {id}"),
            feature: feature.into(),
            remedy: remedy.into(),
        };
        let (position, information, normal) = match &contact.measurement {
            ContactMeasurement::Position { .. } if with_normals => {
                return Err(unsupported("no normal, as others do", "give all contacts a normal, or none"));
            }
            ContactMeasurement::Position { position, information } => (position, information, None),
            ContactMeasurement::PositionNormal { position, information, normal, normal_information } => {
                (position, information, Some((normal, normal_information)))
            }
            ContactMeasurement::Pose { .. } => return Err(unsupported("a full pose", "write a .g2o file")),
        };
        let normal = normal.map(|(n, info)| n.to_array().into_iter().chain([info.sqrt().recip()]));
        let numbers =
            position.to_array().into_iter().chain(normal.into_iter().flatten()).chain(information.upper());
        Ok([id.to_string()].into_iter().chain(decimals(numbers)).collect())
    });
    write_table(path, &header.collect::<Vec<_>>(), &mut rows)
}
