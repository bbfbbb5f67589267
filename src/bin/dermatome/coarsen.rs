//! `coarsen`: the pyramid alone.

use std::{path::PathBuf, process::ExitCode};

use dermatome::{
    Error,
    io::{IoError, kind, write_pyramids},
    mesh::Adjacency,
    pyramid::{Pyramid, coarsen},
    skin::{AssembleOptions, Skin},
};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::{
    common::Common,
    input::read_skin,
    options::{BareArgs, CoarsenArgs},
    outputs,
    print::{plain, print_json, print_table},
};

/// Arguments of `coarsen`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The skin: .glb, .gltf, .json, .obj, .ply, .stl, .csv or .txt
    skin: PathBuf,
    /// Where to write the levels, as in a map file but without maps: .glb
    #[arg(short, long, value_name = "OUT.glb")]
    output: PathBuf,
    #[command(flatten)]
    coarsen: CoarsenArgs,
    /// Print the levels as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    bare: BareArgs,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    if kind(&args.output) != "glb" {
        let (path, known) = (args.output.clone(), "glb");
        return Err(Error::from(IoError::UnknownKind { path, known }).into());
    }
    outputs::check([args.output.as_path()])?;
    let assemble = AssembleOptions { fill_holes: args.coarsen.fill_holes, ..args.bare.options() };
    let skin = read_skin(&args.skin, &assemble, common)?;
    let options = args.coarsen.options();
    let pyramids: Vec<_> = skin
        .patches
        .as_slice()
        .par_iter()
        .map(|patch| {
            coarsen(&patch.mesh, &patch.taxels, &options).map_err(|e| Error::from(e).in_patch(&patch.name))
        })
        .collect();
    let pyramids = pyramids.into_iter().collect::<Result<Vec<_>, _>>()?;
    write_pyramids(&args.output, &skin, &pyramids).map_err(Error::from)?;
    let patches = levels(&skin, &pyramids)?;
    if args.json {
        print_json(&json!({ "patches": patches }))?;
    } else if !common.quiet {
        let rows: Vec<_> = patches.iter().flat_map(rows).collect();
        print_table(["level", "vertices", "faces", "loops"], 1, &rows)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The patches as `report.json` tells them, with what is known without a map.
fn levels(skin: &Skin, pyramids: &[Pyramid]) -> Result<Vec<Value>, Error> {
    let level = |(k, level): (dermatome::pyramid::LevelId, &dermatome::pyramid::Level)| {
        Ok(json!({
            "level": k.index(),
            "vertices": level.mesh.positions.len(),
            "faces": level.mesh.triangles.len(),
            "boundary_loops": Adjacency::new(&level.mesh)?.boundary_loops().len(),
        }))
    };
    skin.patches
        .iter()
        .zip(pyramids)
        .map(|(patch, pyramid)| {
            let levels = pyramid.levels.enumerate().map(level).collect::<Result<Vec<_>, Error>>()?;
            Ok(json!({ "name": patch.name, "link": skin.links[patch.link].name, "levels": levels }))
        })
        .collect()
}

fn rows(patch: &Value) -> Vec<[String; 4]> {
    let name = patch["name"].as_str().unwrap_or_default();
    let levels = patch["levels"].as_array().map_or(&[][..], Vec::as_slice);
    let number = |level: &Value, key: &str| level[key].to_string();
    levels
        .iter()
        .map(|l| {
            [
                format!("{}/L{}", plain(name), l["level"]),
                number(l, "vertices"),
                number(l, "faces"),
                number(l, "boundary_loops"),
            ]
        })
        .collect()
}
