//! Tables of calibrated taxels, of their truth, and of triangles between them.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use glam::{DQuat, DVec3};

use crate::calib::{CadSkin, CalibratedTaxel, Calibration, Observations, Pose, Verdict};
use crate::id::{IdVec, VertexId};
use crate::io::IoError;
use crate::io::error::Result;
use crate::io::file::{OutPath, Source};
use crate::io::table::writer::write_table;
use crate::io::table::{Columns, Row, Table};
use crate::skin::TaxelId;

/// Writes calibrated taxels: `id,x,y,z,qx,qy,qz,qw,sigma,cxx,cxy,cxz,cyy,cyz,czz`.
///
/// Metres; `sigma` is the square root of the trace of the position covariance, whose upper triangle
/// follows. These seven cells are empty if no covariance was computed. Decimals are the shortest
/// that read back as the same `f64`.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
pub fn write_calibration(path: impl Into<OutPath>, calibration: &Calibration) -> Result<(), IoError> {
    const HEADER: &str = "id,x,y,z,qx,qy,qz,qw,sigma,cxx,cxy,cxz,cyy,cyz,czz";
    let covariances = calibration.marginals.as_ref().map(|m| &m.positions);
    write_table(&path.into(), HEADER, |table| {
        for (v, pose) in calibration.poses.enumerate() {
            table.whole(calibration.ids[v].0);
            table.decimals(pose.position.to_array().into_iter().chain(pose.rotation.to_array()));
            match covariances.map(|covariances| covariances[v]) {
                Some(c) => table.decimals([c.sigma()].into_iter().chain(<[f64; 6]>::from(c))),
                None => table.empty(7),
            }
            table.end_row()?;
        }
        Ok(())
    })
}

/// Writes the taxels of a drawing where touches place them:
/// `id,x,y,z,nx,ny,nz,patch,module,sigma,cxx,cxy,cxz,cyy,cyz,czz`, in m; cells of normals are empty where the drawing has
/// none, and there is no such column if no taxel has one.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
pub fn write_bodies(
    path: impl Into<OutPath>,
    cad: &CadSkin,
    taxels: &IdVec<VertexId, CalibratedTaxel>,
) -> Result<(), IoError> {
    let has_normals = taxels.iter().any(|taxel| taxel.normal.is_some());
    let normals = if has_normals { ",nx,ny,nz" } else { "" };
    let header = format!("id,x,y,z{normals},patch,module,sigma,cxx,cxy,cxz,cyy,cyz,czz");
    write_table(&path.into(), &header, |table| {
        for (taxel, drawn) in taxels.iter().zip(&cad.taxels) {
            let module = &cad.modules[drawn.module];
            table.whole(taxel.id.0);
            table.decimals(taxel.position.to_array());
            match taxel.normal {
                Some(normal) => table.decimals(normal.to_array()),
                None if has_normals => table.empty(3),
                None => {}
            }
            table.cell(&cad.patches[module.patch]);
            table.cell(&module.name);
            let covariance = taxel.covariance;
            table.decimals([covariance.sigma()].into_iter().chain(<[f64; 6]>::from(covariance)));
            table.end_row()?;
        }
        Ok(())
    })
}

/// Writes where taxels truly are: `id,x,y,z,nx,ny,nz,qx,qy,qz,qw`.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
pub fn write_truth(
    path: impl Into<OutPath>,
    ids: &IdVec<VertexId, TaxelId>,
    truth: &IdVec<VertexId, Pose>,
) -> Result<(), IoError> {
    const HEADER: &str = "id,x,y,z,nx,ny,nz,qx,qy,qz,qw";
    write_table(&path.into(), HEADER, |table| {
        for (id, pose) in ids.iter().zip(truth) {
            table.whole(id.0);
            let normal = (pose.rotation * DVec3::Z).to_array();
            table
                .decimals(pose.position.to_array().into_iter().chain(normal).chain(pose.rotation.to_array()));
            table.end_row()?;
        }
        Ok(())
    })
}

/// Writes triangles between taxels by their ids: `id0,id1,id2`, counter-clockwise seen from outside.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
pub fn write_triangles(
    path: impl Into<OutPath>,
    ids: &IdVec<VertexId, TaxelId>,
    triangles: &[[VertexId; 3]],
) -> Result<(), IoError> {
    write_table(&path.into(), &BY_ID.join(","), |table| {
        for corners in triangles {
            corners.iter().filter_map(|&v| ids.get(v)).for_each(|id| table.whole(id.0));
            table.end_row()?;
        }
        Ok(())
    })
}

/// Writes how well every observation fits: `i,j,sigmas,weight,inlier`, edges first, then contacts
/// with an empty `j`.
///
/// `sigmas` is the length of the whitened residual, `weight` how much the observation counts,
/// `inlier` 1 for an inlier and 0 for an outlier.
///
/// # Errors
/// [`IoError::Write`]; an older file stays as it was.
pub fn write_inliers(
    path: impl Into<OutPath>,
    observations: &Observations,
    calibration: &Calibration,
) -> Result<(), IoError> {
    let fits = &calibration.diagnostics;
    let id = |v: VertexId| observations.taxels[v].id.0;
    let edges = observations.edges.iter().zip(&fits.edges);
    let edges = edges.map(|(edge, fit)| (id(edge.from), Some(id(edge.to)), fit));
    let contacts = observations.contacts.iter().zip(&fits.contacts);
    let contacts = contacts.map(|(contact, fit)| (id(contact.taxel), None, fit));
    write_table(&path.into(), "i,j,sigmas,weight,inlier", |table| {
        for (i, j, fit) in edges.chain(contacts) {
            table.whole(i);
            match j {
                Some(j) => table.whole(j),
                None => table.empty(1),
            }
            table.decimals([fit.chi2.sqrt(), fit.weight]);
            table.whole(u8::from(fit.verdict == Verdict::Inlier));
            table.end_row()?;
        }
        Ok(())
    })
}

/// Reads triangles between taxels that are named by their ids (`id0,id1,id2`) or rows
/// (`row0,row1,row2`, counted from 0).
///
/// # Errors
/// The first cell that names no taxel, by line and column.
pub fn read_triangles(path: &Path, ids: &IdVec<VertexId, TaxelId>) -> Result<Vec<[VertexId; 3]>, IoError> {
    let taxels = Taxels::new(ids.len(), ids.iter().copied());
    let source = Source::open(path)?;
    let table = Table::of(&source)?;
    let corners = Corners::new(&table.columns)?;
    table.rows(|row| Ok(corners.rows_of(row, &taxels)?.map(VertexId::new)))
}

/// Reads where taxels truly are: `id,x,y,z` and, if there, `qx,qy,qz,qw`; other columns are left
/// alone.
///
/// # Errors
/// If a column is missing, or only a part of `qx,qy,qz,qw` is there; the first broken cell, or id
/// that comes twice, by line and column.
pub fn read_truth(path: &Path) -> Result<Vec<(TaxelId, Pose)>, IoError> {
    let mut seen = HashSet::new();
    let source = Source::open(path)?;
    let table = Table::of(&source)?;
    let id_column = table.columns.need("id")?;
    let position_columns = table.columns.need_vector(["x", "y", "z"])?;
    let rotation_columns = table.columns.find_vector(["qx", "qy", "qz", "qw"])?;
    table.rows(|row| {
        let id = row.taxel(id_column)?;
        if !seen.insert(id) {
            return Err(row.invalid(id_column, "every taxel once"));
        }
        let position = row.vector(position_columns)?;
        let rotation = rotation_columns.map_or(Ok(DQuat::IDENTITY), |columns| row.rotation(columns))?;
        Ok((id, Pose { position, rotation }))
    })
}

/// Corners named by the ids of their taxels.
pub(in crate::io) const BY_ID: [&str; 3] = ["id0", "id1", "id2"];

/// Corners named by the rows of their taxels, counted from 0.
pub(in crate::io) const BY_ROW: [&str; 3] = ["row0", "row1", "row2"];

/// How a table names the corners of its triangles.
pub(in crate::io) struct Corners {
    by_id: bool,
    pub(in crate::io) names: [&'static str; 3],
    pub(in crate::io) columns: [usize; 3],
}

impl Corners {
    pub(in crate::io) fn new(columns: &Columns) -> Result<Self> {
        for (by_id, names) in [(true, BY_ID), (false, BY_ROW)] {
            if names.iter().any(|name| columns.find(name).is_some()) {
                return Ok(Self { by_id, names, columns: columns.need_vector(names)? });
            }
        }
        let needed =
            format!("columns {} (ids of taxels) or {} (their rows)", BY_ID.join(","), BY_ROW.join(","));
        Err(columns.at().invalid(columns.describe(), needed))
    }

    /// The rows of the taxels that a triangle joins, of as many as `ids` has; rows count from 0.
    pub(in crate::io) fn rows_of(&self, row: Row<'_>, taxels: &Taxels) -> Result<[usize; 3]> {
        let find = |column| {
            let number = row.text(column).parse::<u32>().ok();
            if !self.by_id {
                let place = number.map(|k| k as usize).filter(|&k| k < taxels.count);
                let needed = || format!("the row of one of {} taxels, counted from 0", taxels.count);
                return place.ok_or_else(|| row.invalid(column, needed()));
            }
            match number.and_then(|id| taxels.rows.get(&TaxelId(id))) {
                Some(&(place, 1)) => Ok(place),
                Some((_, many)) => {
                    let needed = format!("an id of one taxel, not of {many}; {} name rows", BY_ROW.join(","));
                    Err(row.invalid(column, needed))
                }
                None => Err(row.invalid(column, "the id of a taxel of the table")),
            }
        };
        let [a, b, c] = self.columns.map(find);
        Ok([a?, b?, c?])
    }
}

pub(in crate::io) struct Taxels {
    count: usize,
    /// The first row of each id, and how many there are.
    rows: HashMap<TaxelId, (usize, usize)>,
}

impl Taxels {
    /// `count` taxels, which have these ids, if any.
    pub(in crate::io) fn new(count: usize, ids: impl IntoIterator<Item = TaxelId>) -> Self {
        let mut rows = HashMap::with_capacity(count);
        for (row, id) in ids.into_iter().enumerate() {
            rows.entry(id).or_insert((row, 0)).1 += 1;
        }
        Self { count, rows }
    }
}
