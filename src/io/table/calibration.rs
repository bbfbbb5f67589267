//! Tables of calibrated taxels, of their truth, and of triangles between them.

use std::{
    collections::{HashMap, HashSet},
    path::Path,
};

use csv::{StringRecord, Writer};
use glam::{DQuat, DVec3};

use crate::{
    calib::{Calibration, Observations, Pose},
    id::{IdVec, VertexId},
    io::{
        IoError,
        file::{replace::replace_file, source::Source},
        table::columns::{Columns, Row, table_error, table_write_error},
    },
    skin::TaxelId,
};

/// Writes calibrated taxels: `id,x,y,z,qx,qy,qz,qw,sigma,cxx,cxy,cxz,cyy,cyz,czz`.
///
/// Metres; `sigma` is the square root of the trace of the position covariance, whose upper triangle follows. These
/// seven cells are empty if no covariance was computed. Decimals are the shortest that read back as the same `f64`.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
pub fn write_calibration(path: &Path, calibration: &Calibration) -> Result<(), IoError> {
    const HEADER: [&str; 15] =
        ["id", "x", "y", "z", "qx", "qy", "qz", "qw", "sigma", "cxx", "cxy", "cxz", "cyy", "cyz", "czz"];
    let sigmas = calibration.marginals.as_ref().map(|m| (m.position_rms(), &m.positions));
    write_table(path, &HEADER, |row, k| {
        let v = VertexId::new(k);
        let pose = calibration.poses.get(v)?;
        row.push(calibration.ids[v].to_string());
        let numbers = pose.position.to_array().into_iter().chain(pose.rotation.to_array());
        row.extend(numbers.map(|x| x.to_string()));
        match &sigmas {
            Some((sigmas, covariances)) => {
                row.push(sigmas[v].to_string());
                row.extend(covariances[v].map(|x| x.to_string()));
            }
            None => row.resize(HEADER.len(), String::new()),
        }
        Some(())
    })
}

/// Writes where taxels truly are: `id,x,y,z,nx,ny,nz,qx,qy,qz,qw`.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
pub fn write_truth(
    path: &Path,
    ids: &IdVec<VertexId, TaxelId>,
    truth: &IdVec<VertexId, Pose>,
) -> Result<(), IoError> {
    const HEADER: [&str; 11] = ["id", "x", "y", "z", "nx", "ny", "nz", "qx", "qy", "qz", "qw"];
    write_table(path, &HEADER, |row, k| {
        let (id, pose) = (ids.get(VertexId::new(k))?, truth.get(VertexId::new(k))?);
        row.push(id.to_string());
        let normal = (pose.rotation * DVec3::Z).to_array();
        let numbers = pose.position.to_array().into_iter().chain(normal).chain(pose.rotation.to_array());
        row.extend(numbers.map(|x| x.to_string()));
        Some(())
    })
}

/// Writes triangles between taxels by their ids: `i,j,k`, counter-clockwise seen from outside.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
pub fn write_triangles(
    path: &Path,
    ids: &IdVec<VertexId, TaxelId>,
    triangles: &[[VertexId; 3]],
) -> Result<(), IoError> {
    write_table(path, &["i", "j", "k"], |row, k| {
        let corners = triangles.get(k)?;
        row.extend(corners.iter().filter_map(|&v| ids.get(v)).map(ToString::to_string));
        Some(())
    })
}

/// Writes how well every observation fits: `i,j,sigmas,weight,inlier`, edges first, then contacts with an empty `j`.
///
/// `sigmas` is the length of the whitened error, `weight` what the robust kernel left of it, `inlier` 1 where noise
/// explains it and 0 where it does not.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
pub fn write_inliers(
    path: &Path,
    observations: &Observations,
    calibration: &Calibration,
) -> Result<(), IoError> {
    let fits = &calibration.weights;
    let id = |v: VertexId| observations.taxels[v].id.to_string();
    let edges = observations.edges.enumerate().map(|(e, edge)| {
        (id(edge.from), id(edge.to), fits.edge_squares[e], fits.edges[e], fits.edge_kept[e])
    });
    let contacts = observations.contacts.enumerate().map(|(c, contact)| {
        let (square, weight) = (fits.contact_squares[c], fits.contacts[c]);
        (id(contact.taxel), String::new(), square, weight, fits.contact_kept[c])
    });
    let mut rows = edges.chain(contacts);
    write_table(path, &["i", "j", "sigmas", "weight", "inlier"], |row, _| {
        let (i, j, square, weight, kept) = rows.next()?;
        row.extend([i, j, square.sqrt().to_string(), weight.to_string(), u8::from(kept).to_string()]);
        Some(())
    })
}

/// Writes rows until `fill`, which is told how many there are before, has none left.
fn write_table(
    path: &Path,
    header: &[&str],
    mut fill: impl FnMut(&mut Vec<String>, usize) -> Option<()>,
) -> Result<(), IoError> {
    let fail = |e| table_write_error(path, e);
    replace_file(path, |out| {
        let mut table = Writer::from_writer(out);
        table.write_record(header).map_err(fail)?;
        let mut row = Vec::with_capacity(header.len());
        for k in 0.. {
            row.clear();
            if fill(&mut row, k).is_none() {
                break;
            }
            table.write_record(&row).map_err(fail)?;
        }
        table.flush().map_err(|source| IoError::Write { path: path.to_owned(), source })
    })
}

/// Reads triangles `i,j,k` between taxels that are named by their ids.
///
/// # Errors
/// The first cell that names no taxel, by line and column.
pub fn read_triangles(path: &Path, ids: &IdVec<VertexId, TaxelId>) -> Result<Vec<[VertexId; 3]>, IoError> {
    let known: HashMap<TaxelId, VertexId> = ids.enumerate().map(|(v, &id)| (id, v)).collect();
    let mut triangles = Vec::new();
    let table = Table::open(path)?;
    let places = table.columns.need_vector(path, ["i", "j", "k"])?;
    table.each_row(|row| {
        let mut corners = [VertexId::default(); 3];
        for (corner, column) in corners.iter_mut().zip(places) {
            let vertex = row.text(column).parse().ok().and_then(|id| known.get(&TaxelId(id)));
            *corner = *vertex.ok_or_else(|| row.invalid(column, "the id of a taxel that was observed"))?;
        }
        triangles.push(corners);
        Ok(())
    })?;
    Ok(triangles)
}

/// Reads where taxels truly are: `id,x,y,z` and, if there, `qx,qy,qz,qw`; other columns are left alone.
///
/// # Errors
/// If a column is missing, or only a part of `qx,qy,qz,qw` is there; the first broken cell, or id that comes twice, by line
/// and column.
pub fn read_truth(path: &Path) -> Result<Vec<(TaxelId, Pose)>, IoError> {
    let mut truth = Vec::new();
    let mut seen = HashSet::new();
    let table = Table::open(path)?;
    let id_column = table.columns.need(path, "id")?;
    let position_columns = table.columns.need_vector(path, ["x", "y", "z"])?;
    let rotation_columns = table.columns.find_vector(path, ["qx", "qy", "qz", "qw"])?;
    table.each_row(|row| {
        let parsed = row.text(id_column).parse().map(TaxelId);
        let id = parsed.map_err(|_| row.invalid(id_column, "the number of a taxel"))?;
        if !seen.insert(id) {
            return Err(row.invalid(id_column, "every taxel once"));
        }
        let position = row.vector(position_columns)?;
        let rotation = rotation_columns.map_or(Ok(DQuat::IDENTITY), |columns| rotation(row, columns))?;
        truth.push((id, Pose { position, rotation }));
        Ok(())
    })?;
    Ok(truth)
}

/// A unit quaternion, as exact as the digits of a table are.
fn rotation(row: Row<'_>, columns: [usize; 4]) -> Result<DQuat, IoError> {
    let [x, y, z, w] = columns.map(|column| row.number(column));
    let q = DQuat::from_xyzw(x?, y?, z?, w?);
    let off = (q.length() - 1.0).abs();
    if off.is_nan() || off > 1e-3 {
        return Err(row.invalid(columns[3], "a unit quaternion"));
    }
    Ok(q.normalize())
}

/// A table with its columns found, so that a wrong header is told of even where no row follows.
struct Table<'a> {
    path: &'a Path,
    source: Source,
    columns: Columns,
}

impl<'a> Table<'a> {
    fn open(path: &'a Path) -> Result<Self, IoError> {
        let source = Source::open(path)?;
        let mut reader = csv::Reader::from_reader(source.bytes());
        let columns = Columns::new(path, reader.headers().map_err(|e| table_error(path, e))?)?;
        Ok(Self { path, source, columns })
    }

    fn each_row(&self, mut visit: impl FnMut(Row<'_>) -> Result<(), IoError>) -> Result<(), IoError> {
        let Self { path, source, columns } = self;
        let mut reader = csv::Reader::from_reader(source.bytes());
        let mut cells = StringRecord::new();
        while reader.read_record(&mut cells).map_err(|e| table_error(path, e))? {
            visit(Row { path, columns, cells: &cells })?;
        }
        Ok(())
    }
}
