//! What `calibrate` writes: its paths are checked before the solve, and all of it is written or
//! nothing.

use std::path::Path;

use dermatome::Error;
use dermatome::calib::{Calibration, calibrated_skin};
use dermatome::io::{IoError, write_calibration, write_inliers, write_observations, write_skin};
use dermatome::skin::Skin;

use crate::calibrate::args::Args;
use crate::calibrate::inputs::Inputs;
use crate::console::errors::advise;
use crate::console::notes::{note, note_count, note_remarks, remark_lost};
use crate::files::outputs;
use crate::options::Common;

#[derive(Debug, Clone, Copy)]
pub(super) enum OutputKind {
    Table,
    /// The observations, from where the taxels are.
    Graph,
    Skin,
}

impl OutputKind {
    fn of(path: &Path) -> Result<Self, IoError> {
        match outputs::kind(path).as_str() {
            "csv" => Ok(Self::Table),
            "g2o" => Ok(Self::Graph),
            "glb" | "gltf" | "json" | "obj" | "off" | "ply" | "stl" => Ok(Self::Skin),
            _ => Err(IoError::UnknownKind {
                path: path.to_owned(),
                known: ".csv, .g2o, .glb, .gltf, .json, .obj, .off, .ply, .stl",
            }),
        }
    }
}

/// Refuses what cannot succeed, by the command line alone.
pub(super) fn check(args: &Args) -> anyhow::Result<Vec<(&Path, OutputKind)>> {
    let outputs: Vec<_> =
        args.output.iter().map(|path| Ok((&**path, OutputKind::of(path)?))).collect::<Result<_, Error>>()?;
    args.inliers.as_deref().map_or(Ok(()), outputs::check_table)?;
    let observations = || std::iter::once(&args.observations).chain(&args.contacts);
    for (k, path) in args.contacts.iter().enumerate() {
        if observations().take(k + 1).any(|other| outputs::is_same(other, path)) {
            return Err(advise(
                format!("{} is given twice: its observations would count double", path.display()),
                "name every file of observations once",
            ));
        }
    }
    Ok(outputs)
}

/// Writes every output, or none if one of them cannot be made.
pub(super) fn write(
    paths: &[(&Path, OutputKind)],
    found: &Calibration,
    inputs: &Inputs,
    args: &Args,
    common: &Common,
) -> anyhow::Result<()> {
    let file = |path: &Path| common.outputs.file(path);
    let mut skin = None;
    for &(path, kind) in paths {
        match kind {
            OutputKind::Table => {
                write_calibration(file(path), found).map_err(Error::from)?;
                outputs::drop_triangles(path, common)?;
            }
            OutputKind::Graph => {
                let mut solved = inputs.observations.clone();
                for (taxel, pose) in solved.taxels.iter_mut().zip(&found.poses) {
                    taxel.initial = Some(*pose);
                }
                write_observations(file(path), &solved).map_err(Error::from)?;
            }
            OutputKind::Skin => {
                let made = match &skin {
                    Some(made) => made,
                    None => skin.insert(mesh(found, inputs, common)?),
                };
                write_skin(file(path), made).map_err(Error::from)?;
                remark_lost(path, made, common);
            }
        }
    }
    if let Some(path) = &args.inliers {
        write_inliers(file(path), &inputs.observations, found).map_err(Error::from)?;
    }
    Ok(outputs::publish(common)?)
}

/// Makes the skin, and prints what was left out or assumed.
fn mesh(found: &Calibration, inputs: &Inputs, common: &Common) -> anyhow::Result<Skin> {
    let made =
        calibrated_skin(found, &inputs.observations, inputs.triangles.as_deref()).map_err(Error::from)?;
    if made.assumed > 0 {
        let (assumed, patches) = (made.assumed, made.skin.patches.len());
        let sides =
            format!("neither frames nor normals determine the outside of {assumed} of {patches} patches");
        note!(common, "{sides}: away from the origin is assumed; --triangles decides");
    }
    if made.turned > 0 {
        let turned = made.turned;
        note!(
            common,
            "the triangles of {turned} patches contradicted the taxels' frames or normals and were reversed"
        );
    }
    note_remarks(&made.remarks, common);
    let how = "in no triangle and left out of the skin";
    note_count(common, made.left_out.len() as u64, "taxels", how);
    Ok(made.skin)
}
