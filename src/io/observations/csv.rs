//! Tables of displacements and of contacts.

use std::{
    fmt::Write as _,
    io::{self, BufRead, Write},
    path::Path,
};

use glam::DVec3;

use crate::{
    calib::{ContactMeasurement, DisplacementMeasurement, Information, Model, Observations},
    id::VertexId,
    io::{
        IoError,
        file::{
            lines::{Lines, Place},
            source::{excerpt, invalid},
        },
        observations::{
            builder::{Builder, SIGMA_RANGE, information_of},
            read_write::ReadObservations,
        },
    },
    skin::TaxelId,
};

/// Uncertainty where a table gives none, in m per axis: that of the source paper's experiment.
const DEFAULT_SIGMA: f64 = 1e-3;

/// Uncertainty of a normal where a table gives none, in rad: two degrees, a fingertip on a 5 mm taxel.
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
struct Columns {
    names: Vec<String>,
    taxel: usize,
    subject: Subject,
    uncertainty: Uncertainty,
}

/// What the rows tell.
enum Subject {
    Displacement { other: usize, offset: [usize; 3] },
    ContactObservation { position: [usize; 3], normal: Option<([usize; 3], Option<usize>)> },
}

/// How the rows tell how well it was observed.
enum Uncertainty {
    Assumed,
    Sigma(usize),
    Sigmas([usize; 3]),
    Information([usize; 6]),
}

impl Columns {
    fn new(header: &str, at: &Place<'_>) -> Result<Self, IoError> {
        let names: Vec<String> = header.split(',').map(|n| cell(n).to_ascii_lowercase()).collect();
        if let Some(k) = (0..names.len()).find(|&k| names[..k].contains(&names[k])) {
            return Err(at.invalid(format!("two columns {}", excerpt(&names[k])), "every column once"));
        }
        let mut finder = Finder { names: &names, found: Vec::new(), at };
        let taxel = finder.need(["i"])?[0];
        let is_displacement = names.iter().any(|n| n == "j" || OFFSET.contains(&n.as_str()));
        let subject = if is_displacement {
            Subject::Displacement { other: finder.need(["j"])?[0], offset: finder.need(OFFSET)? }
        } else {
            let position = finder.need(POSITION)?;
            let normal = match finder.find(NORMAL)? {
                Some(normal) => Some((normal, finder.find([NORMAL_SIGMA])?.map(|[k]| k))),
                None => None,
            };
            Subject::ContactObservation { position, normal }
        };
        let uncertainty = if let Some([k]) = finder.find([SIGMA])? {
            Uncertainty::Sigma(k)
        } else if let Some(three) = finder.find(SIGMAS)? {
            Uncertainty::Sigmas(three)
        } else if let Some(six) = finder.find(INFORMATION)? {
            Uncertainty::Information(six)
        } else {
            Uncertainty::Assumed
        };
        finder.refuse_the_others()?;
        Ok(Self { taxel, subject, uncertainty, names })
    }
}

/// Finds columns, and remembers which were found.
struct Finder<'a> {
    names: &'a [String],
    found: Vec<usize>,
    at: &'a Place<'a>,
}

impl Finder<'_> {
    /// Columns that the table must have.
    fn need<const N: usize>(&mut self, group: [&str; N]) -> Result<[usize; N], IoError> {
        let mut places = [0; N];
        for (place, name) in places.iter_mut().zip(group) {
            let found = self.names.iter().position(|n| n == name);
            *place = found.ok_or_else(|| {
                let among = excerpt(&self.names.join(","));
                self.at.invalid(format!("no column {name:?} among {among}"), TABLES)
            })?;
        }
        self.found.extend(places);
        Ok(places)
    }

    /// Columns that come together or not at all.
    fn find<const N: usize>(&mut self, group: [&str; N]) -> Result<Option<[usize; N]>, IoError> {
        let is_there = self.names.iter().any(|n| group.contains(&n.as_str()));
        if is_there { self.need(group).map(Some) } else { Ok(None) }
    }

    /// A column that nobody reads would be a user's error that nobody tells.
    fn refuse_the_others(&self) -> Result<(), IoError> {
        match self.names.iter().enumerate().find(|(k, _)| !self.found.contains(k)) {
            None => Ok(()),
            Some((_, name)) => {
                let beside: Vec<&str> = self.found.iter().map(|&k| self.names[k].as_str()).collect();
                let found =
                    format!("a column {}, which says nothing beside {}", excerpt(name), beside.join(","));
                Err(self.at.invalid(found, TABLES))
            }
        }
    }
}

pub(super) fn read(mut lines: Lines<'_, impl BufRead>, path: &Path) -> Result<ReadObservations, IoError> {
    let mut builder = Builder::new(path);
    let Some((header, at)) = lines.current() else {
        return Err(invalid(path, "the file", "an empty file, or comments alone", TABLES));
    };
    let columns = Columns::new(header, &at)?;
    if matches!(columns.uncertainty, Uncertainty::Assumed) {
        builder.assumed_sigma = Some(DEFAULT_SIGMA);
    }
    lines.advance()?;
    while let Some((line, at)) = lines.current() {
        let words: Vec<&str> = line.split(',').map(cell).collect();
        if words.len() != columns.names.len() {
            let needed = format!("{}, as the header has", columns.names.len());
            return Err(at.invalid(format!("{} values", words.len()), needed));
        }
        Row { columns: &columns, words: &words, at: &at }.read(&mut builder)?;
        lines.advance()?;
    }
    builder.finish()
}

/// One line of a table.
struct Row<'a> {
    columns: &'a Columns,
    words: &'a [&'a str],
    at: &'a Place<'a>,
}

impl Row<'_> {
    fn read(&self, builder: &mut Builder<'_>) -> Result<(), IoError> {
        let Columns { taxel, subject, uncertainty, .. } = self.columns;
        let id = self.taxel(*taxel)?;
        let information = self.information(uncertainty)?;
        match subject {
            Subject::Displacement { other, offset } => {
                let ids = [id, self.taxel(*other)?];
                let offset = self.vector(*offset)?;
                builder.set_model(Model::Positions, self.at)?;
                builder.edge(ids, DisplacementMeasurement::Offset { offset, information }, self.at)
            }
            Subject::ContactObservation { position, normal } => {
                let position = self.vector(*position)?;
                let touch = match normal {
                    None => ContactMeasurement::Position { position, information },
                    Some((columns, sigma)) => {
                        let normal = self.normal(*columns)?;
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
                builder.contact(id, touch, self.at)
            }
        }
    }

    fn information(&self, uncertainty: &Uncertainty) -> Result<Information<3>, IoError> {
        Ok(match uncertainty {
            Uncertainty::Assumed => Information::isotropic(DEFAULT_SIGMA.powi(-2)),
            Uncertainty::Sigma(k) => Information::isotropic(self.sigma(*k)?),
            Uncertainty::Sigmas([x, y, z]) => {
                Information::diagonal([self.sigma(*x)?, self.sigma(*y)?, self.sigma(*z)?])
            }
            Uncertainty::Information([xx, xy, xz, yy, yz, zz]) => {
                let row = |columns| self.vector(columns).map(|v| v.to_array());
                Information([row([*xx, *xy, *xz])?, row([*xy, *yy, *yz])?, row([*xz, *yz, *zz])?])
            }
        })
    }

    /// The information of a standard deviation.
    fn sigma(&self, column: usize) -> Result<f64, IoError> {
        let needed = || format!("a sigma of {:e} to {:e}", SIGMA_RANGE.start(), SIGMA_RANGE.end());
        information_of(self.number(column)?).ok_or_else(|| self.refuse(column, &needed()))
    }

    fn normal(&self, columns: [usize; 3]) -> Result<DVec3, IoError> {
        let found = self.vector(columns)?;
        let needed = "a normal with a direction";
        found.try_normalize().ok_or_else(|| self.at.invalid(format!("the normal {found}"), needed))
    }

    fn vector(&self, [x, y, z]: [usize; 3]) -> Result<DVec3, IoError> {
        Ok(DVec3::new(self.number(x)?, self.number(y)?, self.number(z)?))
    }

    fn number(&self, column: usize) -> Result<f64, IoError> {
        self.at.number(self.words[column]).map_err(|_| self.refuse(column, "a finite number"))
    }

    fn taxel(&self, column: usize) -> Result<TaxelId, IoError> {
        let needed = "the number of a taxel, 0 to 4294967295";
        self.at.taxel(self.words[column]).map_err(|_| self.refuse(column, needed))
    }

    /// An error about a cell.
    fn refuse(&self, column: usize, needed: &str) -> IoError {
        let found = match self.words[column] {
            "" => "an empty cell".to_owned(),
            word => excerpt(word),
        };
        self.at.invalid(format!("{found} in column `{}`", self.columns.names[column]), needed)
    }
}

/// Writes displacements; the table has no place for anything else.
pub(super) fn write_edges(
    out: &mut impl Write,
    observations: &Observations,
    path: &Path,
) -> Result<(), IoError> {
    let fail = |source: io::Error| IoError::Write { path: path.to_owned(), source };
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
            "a contact beside displacements",
            "write a .g2o file, or the contacts to a table of their own",
        ));
    }
    if let Some(fixed) = observations.taxels.iter().find(|t| t.fixed) {
        return Err(unsupported(format!("taxel {}", fixed.id), "a fixed place", "write a .g2o file"));
    }
    writeln!(out, "i,j,{},{}", OFFSET.join(","), INFORMATION.join(",")).map_err(fail)?;
    for edge in &observations.edges {
        let (from, to) = (id(edge.from), id(edge.to));
        let DisplacementMeasurement::Offset { offset, information } = &edge.measurement else {
            return Err(unsupported(format!("edge {from} to {to}"), "a rotation", "write a .g2o file"));
        };
        let mut line = format!("{from},{to}");
        for x in offset.to_array().into_iter().chain(information.upper()) {
            write!(line, ",{x}").expect("writing into a string cannot fail");
        }
        writeln!(out, "{line}").map_err(fail)?;
    }
    Ok(())
}

pub(super) fn write_contacts(
    out: &mut impl Write,
    observations: &Observations,
    path: &Path,
) -> Result<(), IoError> {
    let fail = |source: io::Error| IoError::Write { path: path.to_owned(), source };
    let with_normals = observations
        .contacts
        .iter()
        .any(|c| matches!(c.measurement, ContactMeasurement::PositionNormal { .. }));
    let normals = if with_normals { ",nx,ny,nz,sigma_n" } else { "" };
    writeln!(out, "i,x,y,z{normals},{}", INFORMATION.join(",")).map_err(fail)?;
    let mut line = String::new();
    for contact in &observations.contacts {
        let id = observations.taxels[contact.taxel].id;
        let unsupported = |feature: &str, remedy: &str| IoError::Unsupported {
            path: path.to_owned(),
            element: format!("the contact of taxel {id}"),
            feature: feature.into(),
            remedy: remedy.into(),
        };
        line.clear();
        let (position, information, normal) = match &contact.measurement {
            ContactMeasurement::Position { .. } if with_normals => {
                return Err(unsupported("no normal, as others do", "give all contacts a normal, or none"));
            }
            ContactMeasurement::Position { position, information } => (position, information, None),
            ContactMeasurement::PositionNormal { position, information, normal, normal_information } => {
                (position, information, Some((normal, normal_information)))
            }
            ContactMeasurement::Pose(_) => return Err(unsupported("a full pose", "write a .g2o file")),
        };
        let sigma = normal.map(|(n, info)| n.to_array().into_iter().chain([info.sqrt().recip()]));
        let numbers =
            position.to_array().into_iter().chain(sigma.into_iter().flatten()).chain(information.upper());
        for x in numbers {
            write!(line, ",{x}").expect("writing into a string cannot fail");
        }
        writeln!(out, "{id}{line}").map_err(fail)?;
    }
    Ok(())
}
