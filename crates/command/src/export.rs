//! `export`: one level of a map for a simulator, a robot description or a table.

use std::process::ExitCode;

use dermatome::Error;
use dermatome::body::Body;
use dermatome::io::{ExportOptions, IoError, export_map};
use dermatome::pyramid::LevelId;
use glob::Pattern;

use crate::console::errors::advise;
use crate::console::notes::note;
use crate::files::input::{read_map_first, select_patches};
use crate::files::outputs::{self, kind};
use crate::options::{Common, InPath, OutFile, pattern};

/// Arguments of `export`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The map, written by `dermatome build`
    #[arg(value_name = "MAP.glb")]
    map: InPath,
    /// The file to write: .xml (MuJoCo: a tactile sensor for each patch, depth in m, slip in m/s), .usda
    /// (USD: a mesh for each patch), .csv or .npz (a table of taxels or fields), .json (probes for
    /// Genesis) or .urdf (the robot of --robot, with a tactile sensor for each patch)
    #[arg(short, long, value_name = "OUT")]
    output: OutFile,
    /// The level: 0 has the taxels, further ones have the fields
    #[arg(long, value_name = "K", default_value_t = 0)]
    level: u32,
    /// Export the patches of this name only, in which * and ? stand for any characters; may be given
    /// more than once [default: all patches]
    #[arg(long = "patch", value_name = "NAME", value_parser = pattern)]
    patches: Vec<Pattern>,
    /// The description of the robot that carries the skin, for a .urdf; it is kept as it is, and written
    /// with the sensors
    #[arg(long, value_name = "ROBOT.urdf")]
    robot: Option<InPath>,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let wants_robot = kind(&args.output) == "urdf";
    if wants_robot != args.robot.is_some() {
        let what = if wants_robot { "a .urdf needs a robot" } else { "only a .urdf is written with a robot" };
        return Err(advise(what, "give --robot ROBOT.urdf with -o OUT.urdf, and with no other kind of file"));
    }
    let mut map = read_map_first(&args.map)?;
    let patches = map.patches.into_iter().collect();
    // What joins patches is not exported, and numbers all of them.
    map.body = Body::default();
    map.patches = select_patches(&args.map, patches, &args.patches, |patch| &patch.name)?.into();
    for patch in map.patches.iter().filter(|patch| patch.taxels.joints.is_some()) {
        let (name, link) = (&patch.name, &map.links[patch.link].name);
        note!(common, "patch {name} follows several links; it is exported at rest, on the link {link}");
    }
    let options =
        ExportOptions { level: LevelId::from(args.level), robot: args.robot.as_ref().map(Into::into) };
    export_map(common.outputs.file(&args.output), &map, &options).map_err(|e| {
        let help = match &e {
            IoError::UnknownKind { .. } => "name a file of one of these kinds",
            IoError::Unfit { .. } => "give another --level, or leave such patches out with --patch",
            IoError::Invalid { .. } => "correct --robot, or leave patches out with --patch",
            _ => return Error::from(e).into(),
        };
        advise(e, help)
    })?;
    outputs::publish(common)?;
    Ok(ExitCode::SUCCESS)
}
