//! Exports of a map to simulators, robots and tables.
//!
//! `part` is what every writer takes: one level of each patch, uncut, in the frame of its link. `mjcf`, `usd`,
//! `table`, `probes` and `urdf` write one kind each.

mod mjcf;
mod part;
mod probes;
mod table;
#[cfg(feature = "robots")]
mod urdf;
mod usd;

use std::path::PathBuf;

use crate::io::IoError;
use crate::io::export::part::parts_of;
use crate::io::file::{OutPath, file_kind, unfit};
use crate::map::SkinMap;
use crate::pyramid::LevelId;

/// What of a map [`export_map`] writes.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ExportOptions {
    /// The level; a patch without it shows its coarsest.
    pub level: LevelId,
    /// The description of the robot that carries the skin: needed for `.urdf`, and for nothing else.
    pub robot: Option<PathBuf>,
}

/// Writes one level of a map for another program, in the format of the extension.
///
/// | extension | content |
/// |---|---|
/// | `xml` | MJCF: a tactile sensor of `MuJoCo` for each patch |
/// | `usda` | USD: a mesh for each patch |
/// | `csv`, `npz` | a table of the taxels, or above level 0 of the fields |
/// | `json` | probes as Genesis takes them: one for each vertex, and one for each pixel of a canvas |
/// | `urdf` | the robot of the options with a tactile sensor for each patch |
///
/// Vertices are those of the uncut level, in its order: where a map is cut, each is there once. Numbers are in m, in
/// the frame of the link. MJCF, USD and JSON round to `f32`.
///
/// ```
/// use dermatome::{
///     io::{ExportOptions, export_map},
///     map::SkinMap,
///     mesh::shapes,
/// };
///
/// let map = SkinMap::flat(shapes::lattice(5, 4, 0.004), 1e-3);
/// let path = std::env::temp_dir().join("dermatome-export.csv");
/// export_map(&path, &map, &ExportOptions::default())?;
/// assert_eq!(std::fs::read_to_string(&path)?.lines().count(), 1 + 20);
/// # std::fs::remove_file(&path)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// If the map breaks a rule of [`SkinMap::validate`], has no tangents, or no patch has the level; if the robot
/// cannot be read, has no link of the name of a patch's link, or has a sensor of a patch's name; if a name or a size
/// does not fit the format, or the file cannot be written.
pub fn export_map(path: impl Into<OutPath>, map: &SkinMap, options: &ExportOptions) -> Result<(), IoError> {
    let path = &path.into();
    let kind = file_kind(path);
    if !["xml", "usda", "csv", "npz", "json", "urdf"].contains(&&*kind) {
        let known = ".xml, .usda, .csv, .npz, .json, .urdf";
        return Err(IoError::UnknownKind { path: path.into(), known });
    }
    let parts = parts_of(path, map, options.level)?;
    match (&*kind, &options.robot) {
        #[cfg(feature = "robots")]
        ("urdf", Some(robot)) => urdf::write(path, robot, &parts),
        ("urdf", None) => Err(unfit(path, "the robot", "none", "its description, which gets the sensors")),
        (_, Some(robot)) => {
            Err(unfit(path, "the robot", robot.display().to_string(), "none: only .urdf is written into one"))
        }
        ("xml", None) => mjcf::write(path, &parts),
        ("usda", None) => usd::write(path, &parts),
        ("csv", None) => table::write_csv(path, &parts),
        ("npz", None) => table::write_npz(path, &parts),
        _ => probes::write(path, map, &parts),
    }
}
