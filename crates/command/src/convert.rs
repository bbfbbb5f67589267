//! `convert`: a skin or mesh of any kind into any other.

use std::process::ExitCode;

use dermatome::Error;
use dermatome::design::{Module, skin_draft};
use dermatome::io::{IoError, read_draft_of_stream, read_placed_modules, write_skin};
use dermatome::skin::{Draft, assemble};

use crate::options::{InPath, ModuleArg, OutFile, module_arg};
use crate::{
    console::{
        errors::advise,
        notes::{note_columns, note_remarks, remark_lost},
    },
    files::{input::read_skin, outputs},
    options::{Common, PatchArgs, ReadArgs},
};

/// Arguments of `convert`; the extensions determine the formats.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The skin or mesh to read: .glb, .gltf, .json, .obj, .off, .ply, .stl, .dae, .3mf, .urdf, .xml, .npz, .csv or
    /// .txt; or a recording of Tekscan, XSENSOR, emed or pliance, whose sensors are a flat skin
    #[arg(value_name = "IN")]
    input: InPath,
    /// The file to write: .glb, .gltf, .json, .obj, .off, .ply, .stl or .csv
    #[arg(value_name = "OUT")]
    output: OutFile,
    /// Which sensor of a recording with several
    #[arg(long, value_name = "NAME", conflicts_with = "unit")]
    stream: Option<String>,
    /// IN is a table of poses of modules, as CAD exports them, module,x,y,z,qx,qy,qz,qw: what a module is, as
    /// triangle:32.2mm, hexagon:L, rectangle:W:H, or a table kind,x,y of its outline and taxels
    #[arg(long, value_name = "MODULE", value_parser = module_arg,
        conflicts_with_all = ["stream", "patches", "materials", "bounds", "facing", "spacing", "outer", "weld", "seams"])]
    module: Option<ModuleArg>,
    #[command(flatten)]
    read: ReadArgs,
    #[command(flatten)]
    chosen: PatchArgs,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let options = args.read.options(&[&args.input]);
    let skin = match (&args.stream, &args.module) {
        (None, Some(module)) => {
            let draft = draft_of_modules(args, &module.read()?, common)?;
            let assembled = assemble(&draft, &options).map_err(Error::from)?;
            note_remarks(&assembled.remarks, common);
            assembled.skin
        }
        (None, None) => read_skin(&args.input, &args.read, &args.chosen, &options, common)?,
        (Some(stream), _) => {
            let draft = read_draft_of_stream(&args.input, stream).map_err(Error::from)?;
            let assembled = assemble(&draft, &options).map_err(Error::from)?;
            note_remarks(&assembled.remarks, common);
            assembled.skin
        }
    };
    write_skin(common.outputs.file(&args.output), &skin).map_err(|e| match e {
        IoError::UnknownKind { .. } => {
            advise(e, "write .glb, .obj, .ply or .stl, which other programs convert")
        }
        e => Error::from(e).into(),
    })?;
    outputs::publish(common)?;
    remark_lost(&args.output, &skin, common);
    Ok(ExitCode::SUCCESS)
}

/// The taxels of the modules whose poses the input has.
fn draft_of_modules(args: &Args, module: &Module, common: &Common) -> anyhow::Result<Draft> {
    let mut placed = read_placed_modules(&args.input, module.block()).map_err(Error::from)?;
    note_columns(&args.input, &placed.unused, common);
    let metres = args.read.unit.metres();
    for placed in &mut placed.modules {
        placed.plate.frame.translation *= metres;
        placed.plate.curvature /= metres;
    }
    Ok(skin_draft(module, &placed.modules, placed.links))
}
