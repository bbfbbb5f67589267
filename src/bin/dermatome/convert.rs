//! `convert`: a skin or mesh of any kind into any other.

use std::process::ExitCode;

use dermatome::Error;
use dermatome::io::{IoError, read_draft_of_stream, write_skin};
use dermatome::skin::assemble;

use crate::options::{InPath, OutFile};
use crate::{
    console::{
        errors::advise,
        notes::{note_remarks, remark_lost},
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
    #[command(flatten)]
    read: ReadArgs,
    #[command(flatten)]
    chosen: PatchArgs,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let options = args.read.options(&[&args.input]);
    let skin = match &args.stream {
        None => read_skin(&args.input, &args.read, &args.chosen, &options, common)?,
        Some(stream) => {
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
