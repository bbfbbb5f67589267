//! `convert`: a skin or mesh of any kind into any other.

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use dermatome::{Error, io::write_skin, skin::Skin};

use crate::{Common, input::read_skin, options::BareArgs, outputs};

/// Arguments of `convert`; the extensions name the kinds.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The skin or mesh to read: .glb, .gltf, .json, .obj, .ply, .stl, .csv or .txt
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// The file to write: .glb, .gltf, .json, .obj, .ply, .stl or .csv
    #[arg(value_name = "OUT")]
    output: PathBuf,
    #[command(flatten)]
    bare: BareArgs,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    outputs::check([args.output.as_path()])?;
    let skin = read_skin(&args.input, &args.bare, common)?;
    write_skin(&args.output, &skin).map_err(Error::from)?;
    remark_lost(&args.output, &skin, common);
    Ok(ExitCode::SUCCESS)
}

/// Tells what a skin loses in the kind of file that a path names.
pub(crate) fn remark_lost(path: &Path, skin: &Skin, common: &Common) {
    for lost in lost(path, skin).into_iter().filter(|_| !common.quiet) {
        eprintln!("note: {}: {lost}; .glb keeps everything", path.display());
    }
}

/// What a skin loses there: its frames and names, and its covariances.
fn lost(path: &Path, skin: &Skin) -> Vec<&'static str> {
    let kind = path.extension().and_then(|e| e.to_str()).map(str::to_lowercase).unwrap_or_default();
    let covariances = matches!(kind.as_str(), "json" | "obj" | "ply" | "stl")
        && skin.patches.iter().any(|patch| patch.covariances.is_some());
    let covariances = covariances.then_some("how uncertain the taxels are is lost");
    lost_frames(&kind, skin).into_iter().chain(covariances).collect()
}

fn lost_frames(kind: &str, skin: &Skin) -> Option<&'static str> {
    let is_one_body = skin.patches.iter().all(|patch| patch.link == skin.patches[0.into()].link);
    let is_bare = skin.links.len() <= 1
        && skin.links.iter().all(|l| l.name.is_empty() && l.pose.abs_diff_eq(glam::DAffine3::IDENTITY, 0.0));
    match kind {
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
