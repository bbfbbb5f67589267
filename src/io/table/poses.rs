//! Tables of link poses.

use std::{collections::HashSet, path::Path};

use glam::DAffine3;

use crate::io::{IoError, file::source::Source, table::csv_table::Table};

/// The pose of one link in the world.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkPose {
    /// Name of the link.
    pub link: String,
    /// Its frame in the world, in m.
    pub pose: DAffine3,
    /// Line of the table it stands in, from 1.
    pub line: u64,
}

/// Reads a table of link poses: columns `link,x,y,z,qx,qy,qz,qw` in any order, metres and unit
/// quaternions.
///
/// # Errors
/// If the file cannot be read, a column is missing, a cell is not a finite number, a quaternion is
/// not of unit length, or a link comes twice.
pub fn read_poses(path: &Path) -> Result<Vec<LinkPose>, IoError> {
    let source = Source::open(path)?;
    let table = Table::open(path, source.text()?.as_bytes())?;
    let link = table.columns.need("link")?;
    let position = table.columns.need_vector(["x", "y", "z"])?;
    let rotation = table.columns.need_vector(["qx", "qy", "qz", "qw"])?;
    let mut poses: Vec<LinkPose> = Vec::new();
    let mut seen = HashSet::new();
    table.each_row(&mut |row| {
        let rotation = row.rotation(rotation)?;
        let name = row.text(link).to_owned();
        if !seen.insert(name.clone()) {
            return Err(row.invalid(link, "each link once"));
        }
        let pose = DAffine3::from_rotation_translation(rotation, row.vector(position)?);
        poses.push(LinkPose { link: name, pose, line: row.line });
        Ok(())
    })?;
    Ok(poses)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use glam::DVec3;

    use super::*;

    fn read(text: &str) -> Result<Vec<LinkPose>, IoError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("poses.csv");
        fs::write(&path, text).unwrap();
        read_poses(&path)
    }

    #[test]
    fn a_quarter_turn_about_z_takes_x_to_y() {
        let poses = read("qw, qx, qy, qz, link, x, y, z\n0.70711, 0, 0, 0.70711, arm, 1, 2, 3\n").unwrap();
        assert_eq!((poses.len(), poses[0].link.as_str(), poses[0].line), (1, "arm", 2));
        let moved = poses[0].pose.transform_point3(DVec3::X);
        assert!(moved.distance(DVec3::new(1.0, 3.0, 3.0)) < 1e-12, "{moved}");
    }

    #[test]
    fn what_is_no_pose_is_refused_with_its_line() {
        let header = "link,x,y,z,qx,qy,qz,qw\n";
        for (rows, expected) in [
            ("a,0,0,0,0,0,0,1\na,0,0,0,0,0,0,1\n", "line 3"),
            ("a,0,0,0,0,0,0,0.5\n", "length 1"),
            ("a,0,0,0,0,0,0,NaN\n", "column `qw`"),
            ("a,0,,0,0,0,0,1\n", "column `y`"),
            ("a,0\n", "line 2"),
        ] {
            let error = read(&format!("{header}{rows}")).unwrap_err().to_string();
            assert!(error.contains(expected), "{rows:?}: {error}");
        }
        assert!(read("link,x,y,z\na,0,0,0\n").unwrap_err().to_string().contains("qx"));
        assert!(read("").is_err());
    }
}
