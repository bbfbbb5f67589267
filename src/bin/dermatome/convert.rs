//! `convert`: a skin or mesh of any kind into any other.

use std::process::ExitCode;

use dermatome::Error;
use dermatome::io::{IoError, write_skin};

use crate::options::{InPath, OutFile};
use crate::{
    console::{errors::advise, notes::remark_lost},
    files::{input::read_skin, outputs},
    options::{Common, PatchArgs, ReadArgs},
};

/// Arguments of `convert`; the extensions determine the formats.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The skin or mesh to read: .glb, .gltf, .json, .obj, .off, .ply, .stl, .dae, .urdf, .xml, .npz, .csv or
    /// .txt; or a recording of Tekscan, XSENSOR, emed or pliance, whose sensors are a flat skin
    #[arg(value_name = "IN")]
    input: InPath,
    /// The file to write: .glb, .gltf, .json, .obj, .off, .ply, .stl or .csv
    #[arg(value_name = "OUT")]
    output: OutFile,
    #[command(flatten)]
    read: ReadArgs,
    #[command(flatten)]
    chosen: PatchArgs,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let skin = read_skin(&args.input, &args.read, &args.chosen, &args.read.options(&[&args.input]), common)?;
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
