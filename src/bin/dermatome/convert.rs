//! `convert`: a skin or mesh of any kind into any other.

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use dermatome::{Error, io::write_skin, skin::Skin};

use crate::{Common, input::read_skin, options::BareArgs};

/// Arguments of `convert`; the extensions name the kinds.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The skin or mesh to read: .glb, .gltf, .json, .obj, .ply, .stl, .csv or .txt
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// The file to write, of any of these kinds
    #[arg(value_name = "OUT")]
    output: PathBuf,
    #[command(flatten)]
    bare: BareArgs,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let skin = read_skin(&args.input, &args.bare, common)?;
    write_skin(&args.output, &skin).map_err(Error::from)?;
    if let Some(lost) = lost(&args.output, &skin)
        && !common.quiet
    {
        eprintln!("note: {}: {lost}; .glb keeps everything", args.output.display());
    }
    Ok(ExitCode::SUCCESS)
}

/// What a skin loses in the kind of file that a path names.
fn lost(path: &Path, skin: &Skin) -> Option<&'static str> {
    let kind = path.extension()?.to_str()?.to_lowercase();
    let is_one_body = skin.patches.iter().all(|patch| patch.link == skin.patches[0.into()].link);
    let is_bare = skin.links.len() <= 1
        && skin.links.iter().all(|l| l.name.is_empty() && l.pose.abs_diff_eq(glam::DAffine3::IDENTITY, 0.0));
    match kind.as_str() {
        "json" if !is_one_body => Some("robotskinlib has one link: positions are in the world"),
        "json" if skin.patches.len() > 1 => Some("robotskinlib has one patch: its pieces lose their names"),
        "obj" => Some("OBJ keeps no taxel ids and no link frames: positions are in the world"),
        "ply" if !is_bare || skin.patches.len() > 1 => {
            Some("PLY keeps no names and no link frames: positions are in the world")
        }
        "stl" => Some("STL keeps positions alone, in the world and rounded to f32"),
        "csv" if !is_bare => Some("tables keep no link frames: positions are in the world"),
        _ => None,
    }
}
