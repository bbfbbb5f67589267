//! Tables of displacements and contacts.

use std::{
    fmt::Write as _,
    io::{self, BufRead, Write},
    path::Path,
};

use glam::DVec3;

use crate::{
    calib::{Information, Model, Motion, Observations, Touch},
    io::{
        IoError,
        observations::{Builder, Place, ReadObservations, next_line},
    },
};

/// Uncertainty where a table gives none, in m per axis: that of the source paper's experiment.
const DEFAULT_SIGMA: f64 = 1e-3;

/// Uncertainty of a normal where a table gives none, in rad: two degrees, a fingertip on a 5 mm taxel.
const DEFAULT_NORMAL_SIGMA: f64 = 0.035;

/// Names of the six information columns, in the order of the upper triangle.
const INFORMATION: [&str; 6] = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];

/// Every name a column may have.
const COLUMNS: &str =
    "i,j,dx,dy,dz or i,x,y,z[,nx,ny,nz], then sigma or ixx,ixy,ixz,iyy,iyz,izz, and sigma_n";

/// Where the columns of a table are.
struct Columns {
    taxel: usize,
    /// Second taxel: the table holds displacements.
    other: Option<usize>,
    vector: [usize; 3],
    normal: Option<[usize; 3]>,
    sigma: Option<usize>,
    information: Option<[usize; 6]>,
    normal_sigma: Option<usize>,
    count: usize,
}

impl Columns {
    fn new(header: &str, at: &Place<'_>) -> Result<Self, IoError> {
        let names: Vec<String> = header.split(',').map(|n| n.trim().to_ascii_lowercase()).collect();
        let known = ["i", "j", "dx", "dy", "dz", "x", "y", "z", "nx", "ny", "nz", "sigma", "sigma_n"];
        for (k, name) in names.iter().enumerate() {
            if !known.contains(&name.as_str()) && !INFORMATION.contains(&name.as_str()) {
                return Err(at.invalid(format!("a column {name:?}"), COLUMNS));
            }
            if names[..k].contains(name) {
                return Err(at.invalid(format!("two columns {name:?}"), "every column once"));
            }
        }
        let find = |name: &str| names.iter().position(|n| n == name);
        let need = |name: &str| find(name).ok_or_else(|| at.invalid(format!("no column {name:?}"), COLUMNS));
        let all = |group: &[&str]| group.iter().any(|n| find(n).is_some());
        let other = find("j");
        let axes = if other.is_some() { ["dx", "dy", "dz"] } else { ["x", "y", "z"] };
        let three = |names: [&str; 3]| Ok::<_, IoError>([need(names[0])?, need(names[1])?, need(names[2])?]);
        let mut information = None;
        if all(&INFORMATION) {
            let mut columns = [0; 6];
            for (column, name) in columns.iter_mut().zip(INFORMATION) {
                *column = need(name)?;
            }
            information = Some(columns);
        }
        let has_normal = other.is_none() && all(&["nx", "ny", "nz"]);
        Ok(Self {
            taxel: need("i")?,
            other,
            vector: three(axes)?,
            normal: if has_normal { Some(three(["nx", "ny", "nz"])?) } else { None },
            sigma: find("sigma"),
            information,
            normal_sigma: find("sigma_n"),
            count: names.len(),
        })
    }
}

pub(super) fn read(mut input: impl BufRead, path: &Path) -> Result<ReadObservations, IoError> {
    let mut builder = Builder::new(path);
    let mut line = String::new();
    let mut at = Place { path, line: 1 };
    if !next_line(&mut input, &mut line, &at)? {
        return Err(at.invalid("an empty file", COLUMNS));
    }
    let columns = Columns::new(line.trim().trim_start_matches('\u{feff}'), &at)?;
    if columns.sigma.is_none() && columns.information.is_none() {
        builder.assumed_sigma = Some(DEFAULT_SIGMA);
    }
    at.line += 1;
    while next_line(&mut input, &mut line, &at)? {
        let row = line.trim();
        if !row.is_empty() && !row.starts_with('#') {
            let words: Vec<&str> = row.split(',').map(str::trim).collect();
            if words.len() != columns.count {
                return Err(at.invalid(format!("{} values", words.len()), columns.count.to_string()));
            }
            read_row(&columns, &words, &mut builder, &at)?;
        }
        at.line += 1;
    }
    builder.finish()
}

fn read_row(
    columns: &Columns,
    words: &[&str],
    builder: &mut Builder<'_>,
    at: &Place<'_>,
) -> Result<(), IoError> {
    let id = at.taxel(words[columns.taxel])?;
    let vector = |c: [usize; 3]| {
        Ok::<_, IoError>(DVec3::new(
            at.number(words[c[0]])?,
            at.number(words[c[1]])?,
            at.number(words[c[2]])?,
        ))
    };
    let value = vector(columns.vector)?;
    let information = match (columns.information, columns.sigma) {
        (Some(c), _) => {
            let mut upper = [0.0; 6];
            for (x, k) in upper.iter_mut().zip(c) {
                *x = at.number(words[k])?;
            }
            Information::from_upper(&upper).unwrap_or(Information::isotropic(0.0))
        }
        (None, Some(c)) => Information::isotropic(positive(words[c], at)?.powi(-2)),
        (None, None) => Information::isotropic(DEFAULT_SIGMA.powi(-2)),
    };
    if let Some(other) = columns.other {
        let ids = [id, at.taxel(words[other])?];
        builder.set_model(Model::Positions, at)?;
        return builder.edge(ids, Motion::Offset { offset: value, information }, at);
    }
    let touch = match columns.normal {
        None => Touch::Position { position: value, information },
        Some(c) => {
            let found = vector(c)?;
            let normal = found
                .try_normalize()
                .ok_or_else(|| at.invalid(format!("the normal {found}"), "a normal with a direction"))?;
            let sigma = columns.normal_sigma.map_or(Ok(DEFAULT_NORMAL_SIGMA), |k| positive(words[k], at))?;
            Touch::PositionNormal { position: value, information, normal, normal_information: sigma.powi(-2) }
        }
    };
    builder.contact(id, touch, at)
}

fn positive(word: &str, at: &Place<'_>) -> Result<f64, IoError> {
    let x = at.number(word)?;
    if x > 0.0 { Ok(x) } else { Err(at.invalid(format!("a sigma of {x}"), "a positive number")) }
}

pub(super) fn write_contacts(
    out: &mut impl Write,
    observations: &Observations,
    path: &Path,
) -> Result<(), IoError> {
    let fail = |source: io::Error| IoError::Write { path: path.to_owned(), source };
    let with_normals = observations.contacts.iter().any(|c| matches!(c.touch, Touch::PositionNormal { .. }));
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
        let (position, information, normal) = match &contact.touch {
            Touch::Position { .. } if with_normals => {
                return Err(unsupported("no normal, as others do", "give all contacts a normal, or none"));
            }
            Touch::Position { position, information } => (position, information, None),
            Touch::PositionNormal { position, information, normal, normal_information } => {
                (position, information, Some((normal, normal_information)))
            }
            Touch::Pose(_) => return Err(unsupported("a full pose", "write a .g2o file")),
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
