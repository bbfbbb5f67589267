use std::path::Path;

use csv::{ReaderBuilder, StringRecord, Trim};
use glam::{DAffine3, DQuat};

use crate::io::{
    IoError,
    file::source::Source,
    table::columns::{Columns, Row, table_error},
};

/// How far a quaternion may be from unit length: three decimals are enough for a user to mean a rotation.
const UNIT_TOLERANCE: f64 = 1e-3;

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

/// Reads a table of link poses: columns `link,x,y,z,qx,qy,qz,qw` in any order, metres and unit quaternions.
///
/// # Errors
/// If the file cannot be read, a column is missing, a cell is no finite number, a quaternion is not of unit
/// length, or a link comes twice.
pub fn read_poses(path: &Path) -> Result<Vec<LinkPose>, IoError> {
    let source = Source::open(path)?;
    let mut table = ReaderBuilder::new().trim(Trim::All).from_reader(source.text()?.as_bytes());
    let columns = Columns::new(path, table.headers().map_err(|e| table_error(path, e))?)?;
    let link = columns.need(path, "link")?;
    let place = columns.need_vector(path, ["x", "y", "z"])?;
    let imaginary = columns.need_vector(path, ["qx", "qy", "qz"])?;
    let real = columns.need(path, "qw")?;
    let mut poses: Vec<LinkPose> = Vec::new();
    let mut seen = std::collections::HashSet::new();
    let mut cells = StringRecord::new();
    while table.read_record(&mut cells).map_err(|e| table_error(path, e))? {
        let row = Row { path, columns: &columns, cells: &cells };
        let rotation = DQuat::from_vec4(row.vector(imaginary)?.extend(row.number(real)?));
        if (rotation.length() - 1.0).abs() > UNIT_TOLERANCE {
            return Err(
                row.invalid(real, format!("a quaternion of length 1 instead of {}", rotation.length()))
            );
        }
        let name = row.text(link).to_owned();
        if !seen.insert(name.clone()) {
            return Err(row.invalid(link, "each link once"));
        }
        let pose = DAffine3::from_rotation_translation(rotation.normalize(), row.vector(place)?);
        poses.push(LinkPose { link: name, pose, line: cells.position().map_or(1, csv::Position::line) });
    }
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
