//! Tables of displacements and of contacts.

use std::io::BufRead;

use crate::calib::{
    ContactMeasurement, ContactObservation, DisplacementMeasurement, Information, Model, Observations,
};
use crate::io::error::Result;
use crate::io::file::{Lines, OutPath, excerpt, invalid, unfit};
use crate::io::observations::builder::{ObservationsBuilder, ReadObservations, SIGMA_RANGE, information_of};
use crate::io::observations::touch_columns::{self, TOUCH, TOUCH_COLUMNS, TouchColumns};
use crate::io::table::cells::{Cells, Separator};
use crate::io::table::touch_log::is_of_joint;
use crate::io::table::writer::{header_of, write_table};
use crate::io::table::{Columns, Row, Table, TimeColumn};

/// Uncertainty where a table gives none, in m per axis: that of the source paper's experiment.
const DEFAULT_SIGMA: f64 = 1e-3;

/// Uncertainty of a normal where a table gives none, in rad: of a fingertip on a 5 mm taxel.
const DEFAULT_NORMAL_SIGMA: f64 = 0.035;

// Columns: a displacement, in m.
const OFFSET: [&str; 3] = ["dx", "dy", "dz"];
// A contact, and the standard deviation of its normal, in rad.
const POSITION: [&str; 3] = ["x", "y", "z"];
const NORMAL: [&str; 3] = ["nx", "ny", "nz"];
const NORMAL_SIGMA: &str = "sigma_n";
// The standard deviation in every direction or of each axis, in m, or the information, in the order
// of the upper triangle, in 1/m^2.
const SIGMA: &str = "sigma";
const SIGMAS: [&str; 3] = ["sx", "sy", "sz"];
/// When a row was observed.
const TIME: &str = "time";
const INFORMATION: [&str; 6] = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];

/// What a table may contain, for messages.
pub(super) const TABLES: &str = "i,j,dx,dy,dz or i,x,y,z[,nx,ny,nz[,sigma_n]], then sigma or sx,sy,sz or \
                      ixx,ixy,ixz,iyy,iyz,izz; also time; of contacts also touch, contact, weight, qx,qy,qz,qw, px,py,pz,radius, outx,outy,outz, pathx,pathy,pathz, vx,vy,vz, dx:JOINT,dy:JOINT,dz:JOINT, separated by commas";

/// Whether a line is the header of a table, whatever separates its words: g2o has no such words.
pub(super) fn is_header(line: &str) -> bool {
    let is_name = |name: &str| {
        let known =
            [&["i", "j", SIGMA, NORMAL_SIGMA][..], &OFFSET, &POSITION, &NORMAL, &SIGMAS, &INFORMATION];
        known.iter().any(|names| names.contains(&name))
    };
    let mut cells = Cells::default();
    [',', ';', '\t'].into_iter().any(|sign| {
        cells.split(line, Separator::Sign(sign), true);
        cells.iter().any(|cell| is_name(&cell.to_ascii_lowercase()))
    })
}

pub(super) struct ColumnIndices {
    taxel: usize,
    subject: Subject,
    uncertainty: Uncertainty,
    touch: Option<TouchColumns>,
    /// The number of the touch of a row.
    pub(super) group: Option<usize>,
    /// The time of a row.
    pub(super) time: Option<TimeColumn>,
}

#[derive(Clone, Copy)]
enum Subject {
    Displacement { other: usize, offset: [usize; 3] },
    ContactObservation { position: [usize; 3], normal: Option<([usize; 3], Option<usize>)> },
}

enum Uncertainty {
    Assumed,
    Sigmas([usize; 3]),
    Information([usize; 6]),
}

impl ColumnIndices {
    pub(super) fn new(columns: &Columns) -> Result<Self> {
        let mut used = vec!["i", TIME];
        let has = |name: &str| columns.find(name).is_some();
        let Some(taxel) = columns.find("i") else {
            return Err(columns.at().invalid(columns.describe(), TABLES));
        };
        let mut touch = None;
        let subject = if has("j") || OFFSET.iter().any(|name| has(name)) {
            used.extend(["j", TOUCH].into_iter().chain(OFFSET));
            Subject::Displacement { other: columns.need("j")?, offset: columns.need_vector(OFFSET)? }
        } else {
            used.extend(POSITION);
            let position = columns.need_vector(POSITION)?;
            touch = TouchColumns::find(columns)?;
            used.extend(TOUCH_COLUMNS);
            used.extend(columns.names().filter(|name| is_of_joint(name)));
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
            Uncertainty::Sigmas([column; 3])
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
        let time = columns.find_time()?;
        used.retain(|name| if *name == TIME { time.is_some() } else { columns.find(name).is_some() });
        if let Some((_, name)) = columns.unknown(&used).next() {
            let found = format!("a column {}, which is redundant next to {}", excerpt(name), used.join(","));
            return Err(columns.at().invalid(found, TABLES));
        }
        Ok(Self { taxel, subject, uncertainty, touch, group: columns.find(TOUCH), time })
    }

    /// The standard deviation that is assumed, if the table gives none.
    pub(super) fn assumed_sigma(&self) -> Option<f64> {
        matches!(self.uncertainty, Uncertainty::Assumed).then_some(DEFAULT_SIGMA)
    }
}

/// Reads from the line on which `lines` stands.
pub(super) fn read(lines: Lines<impl BufRead>) -> Result<ReadObservations> {
    let mut builder = ObservationsBuilder::new(lines.path());
    if lines.current()?.is_none() {
        let found = "an empty file, or comments alone";
        return Err(invalid(lines.path(), "the file", found, TABLES));
    }
    let table = Table::open(lines)?;
    let columns = ColumnIndices::new(&table.columns)?;
    builder.assumed_sigma = columns.assumed_sigma();
    table.each_row(&mut |row| read_row(row, &columns, &mut builder))?;
    builder.finish()
}

pub(super) fn read_row(
    row: Row<'_>,
    columns: &ColumnIndices,
    builder: &mut ObservationsBuilder,
) -> Result<()> {
    let (id, at) = (row.taxel(columns.taxel)?, &row.at);
    let information = information(row, &columns.uncertainty)?;
    if let Some(touch) = &columns.touch {
        builder.touch(touch.read(row)?, &touch.joints);
    }
    match columns.subject {
        Subject::Displacement { other, offset } => {
            let ids = [id, row.taxel(other)?];
            let offset = row.vector(offset)?;
            builder.set_model(Model::Positions, at)?;
            builder.edge(ids, DisplacementMeasurement::Offset { offset, information }, at)
        }
        Subject::ContactObservation { position, normal: None } => {
            let position = row.vector(position)?;
            builder.contact(id, ContactMeasurement::Position { position, information }, at)
        }
        Subject::ContactObservation { position, normal: Some((columns, sigma)) } => {
            let (position, given) = (row.vector(position)?, row.vector(columns)?);
            let odd = || at.invalid(format!("the normal {given}"), "a normal with a direction");
            let normal = given.try_normalize().ok_or_else(odd)?;
            let assumed = || Ok(DEFAULT_NORMAL_SIGMA.powi(-2));
            let normal_information = sigma.map_or_else(assumed, |column| of_sigma(row, column))?;
            let touch =
                ContactMeasurement::PositionNormal { position, information, normal, normal_information };
            builder.contact(id, touch, at)
        }
    }
}

fn information(row: Row<'_>, uncertainty: &Uncertainty) -> Result<Information<3>> {
    Ok(match *uncertainty {
        Uncertainty::Assumed => Information::diagonal([DEFAULT_SIGMA.powi(-2); 3]),
        Uncertainty::Sigmas([x, y, z]) => {
            Information::diagonal([of_sigma(row, x)?, of_sigma(row, y)?, of_sigma(row, z)?])
        }
        Uncertainty::Information(columns) => {
            let [xx, xy, xz, yy, yz, zz] = row.numbers(columns)?;
            Information([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        }
    })
}

fn of_sigma(row: Row<'_>, column: usize) -> Result<f64> {
    let needed = || format!("a sigma of {:e} to {:e}", SIGMA_RANGE.start(), SIGMA_RANGE.end());
    information_of(row.number(column)?).ok_or_else(|| row.invalid(column, needed()))
}

pub(super) fn write(observations: &Observations, path: &OutPath) -> Result<()> {
    let Observations { taxels, edges, contacts, .. } = observations;
    if edges.is_empty() && !contacts.is_empty() {
        return write_contacts(observations, path);
    }
    if let Some(contact) = contacts.iter().next() {
        let element = format!("taxel {}", taxels[contact.taxel].id);
        let needed = "a g2o file, or a table of its own for contacts";
        return Err(unfit(path, element, "a contact among displacements", needed));
    }
    if let Some(fixed) = taxels.iter().find(|t| t.fixed) {
        return Err(unfit(path, format!("taxel {}", fixed.id), "a fixed position", "a g2o file"));
    }
    let header: Vec<&str> = ["i", "j"].into_iter().chain(OFFSET).chain(INFORMATION).collect();
    write_table(path, &header.join(","), |table| {
        for edge in edges {
            let ids = [edge.from, edge.to].map(|v| taxels[v].id);
            let DisplacementMeasurement::Offset { offset, information } = &edge.measurement else {
                let element = format!("edge {} to {}", ids[0], ids[1]);
                return Err(unfit(path, element, "a rotation", "a g2o file"));
            };
            ids.into_iter().for_each(|id| table.whole(id.0));
            table.decimals(offset.to_array().into_iter().chain(information.upper()));
            table.end_row()?;
        }
        Ok(())
    })
}

fn write_contacts(observations: &Observations, path: &OutPath) -> Result<()> {
    let has_normal =
        |c: &ContactObservation| matches!(c.measurement, ContactMeasurement::PositionNormal { .. });
    let with_normals = observations.contacts.iter().any(has_normal);
    let normals: &[&str] = if with_normals { &["nx", "ny", "nz", NORMAL_SIGMA] } else { &[] };
    let touches = touch_columns::written(observations);
    let header = ["i"].into_iter().chain(POSITION).chain(normals.iter().copied());
    let header = header.chain(touches.iter().map(String::as_str)).chain(INFORMATION);
    write_table(path, &header_of(header), |table| {
        for (number, contact) in observations.contacts.enumerate() {
            let id = observations.taxels[contact.taxel].id;
            let refuse =
                |found: &str, needed| Err(unfit(path, format!("the contact of taxel {id}"), found, needed));
            let (position, information, normal) = match &contact.measurement {
                ContactMeasurement::Position { .. } if with_normals => {
                    return refuse("no normal", "a normal of every contact, or of none");
                }
                ContactMeasurement::Position { position, information } => (position, information, None),
                ContactMeasurement::PositionNormal { position, information, normal, normal_information } => {
                    (position, information, Some((normal, normal_information)))
                }
                ContactMeasurement::Pose { .. } => return refuse("a full pose", "a g2o file"),
            };
            let normal = normal.map(|(n, info)| n.to_array().into_iter().chain([info.sqrt().recip()]));
            let normal = normal.into_iter().flatten();
            table.whole(id.0);
            table.decimals(position.to_array().into_iter().chain(normal));
            if !touch_columns::write(&touches, &observations.touch_of(number), table) {
                return refuse("a touch without a number that others have", "the same columns in every row");
            }
            table.decimals(information.upper());
            table.end_row()?;
        }
        Ok(())
    })
}
