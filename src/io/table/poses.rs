//! Tables of link poses.

use std::{collections::HashSet, path::Path};

use glam::DAffine3;

use crate::{
    io::{IoError, file::source::Source, table::csv_table::Table},
    skin::LinkId,
};

/// Reads a table of link poses in the world: columns `link,x,y,z,qx,qy,qz,qw` in any order, metres
/// and unit quaternions. `link_named` knows the links.
///
/// # Errors
/// If the file cannot be read, a column is missing, a cell is not a finite number, a quaternion is
/// not of unit length, or a link is unknown or comes twice.
pub fn read_poses(
    path: &Path,
    link_named: &dyn Fn(&str) -> Option<LinkId>,
) -> Result<Vec<(LinkId, DAffine3)>, IoError> {
    let source = Source::open(path)?;
    let table = Table::of(&source)?;
    let link = table.columns.need("link")?;
    let position = table.columns.need_vector(["x", "y", "z"])?;
    let rotation = table.columns.need_vector(["qx", "qy", "qz", "qw"])?;
    let mut poses = Vec::new();
    let mut seen = HashSet::new();
    table.each_row(&mut |row| {
        let pose = DAffine3::from_rotation_translation(row.rotation(rotation)?, row.vector(position)?);
        let found = link_named(row.text(link));
        let found = found.ok_or_else(|| row.invalid(link, "the name of a link of the map"))?;
        if !seen.insert(found) {
            return Err(row.invalid(link, "each link once"));
        }
        poses.push((found, pose));
        Ok(())
    })?;
    Ok(poses)
}
