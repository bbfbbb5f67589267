//! `coarsen`: the pyramid alone.

use std::{path::PathBuf, process::ExitCode};

use dermatome::{
    Error,
    io::{IoError, kind, write_pyramids},
    mesh::Adjacency,
    pipeline::coarsen_patches,
    pyramid::{Level, LevelId, Pyramid},
    skin::{AssembleOptions, Patch, Skin},
};
use serde::Serialize;

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
    /// File for the levels, as in a map file but without maps: .glb
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
    let pyramids = coarsen_patches(&skin, &args.coarsen.options(), &|_| ())?;
    write_pyramids(&args.output, &skin, &pyramids).map_err(Error::from)?;
    let summary = Summary::new(&skin, &pyramids)?;
    if args.json {
        print_json(&summary)?;
    } else if !common.quiet {
        summary.print()?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The patches as `report.json` lists them, with what is known without a map.
#[derive(Serialize)]
struct Summary<'a> {
    patches: Vec<PatchSummary<'a>>,
}

#[derive(Serialize)]
struct PatchSummary<'a> {
    levels: Vec<LevelSummary>,
    link: &'a str,
    name: &'a str,
}

#[derive(Serialize)]
struct LevelSummary {
    boundary_loops: usize,
    faces: usize,
    level: usize,
    vertices: usize,
}

impl<'a> Summary<'a> {
    fn new(skin: &'a Skin, pyramids: &[Pyramid]) -> Result<Self, Error> {
        let level = |(id, level): (LevelId, &Level)| {
            Ok(LevelSummary {
                level: id.index(),
                vertices: level.mesh.positions.len(),
                faces: level.mesh.triangles.len(),
                boundary_loops: Adjacency::new(&level.mesh)?.boundary_loops().len(),
            })
        };
        let patch = |(patch, pyramid): (&'a Patch, &Pyramid)| {
            let levels = pyramid.levels.enumerate().map(level).collect::<Result<_, Error>>()?;
            Ok(PatchSummary { name: &patch.name, link: &skin.links[patch.link].name, levels })
        };
        Ok(Self { patches: skin.patches.iter().zip(pyramids).map(patch).collect::<Result<_, Error>>()? })
    }

    fn print(&self) -> anyhow::Result<()> {
        let levels =
            self.patches.iter().flat_map(|patch| patch.levels.iter().map(move |level| (patch, level)));
        let rows: Vec<_> = levels
            .map(|(patch, level)| {
                [
                    format!("{}/L{}", plain(patch.name), level.level),
                    level.vertices.to_string(),
                    level.faces.to_string(),
                    level.boundary_loops.to_string(),
                ]
            })
            .collect();
        print_table(["level", "vertices", "faces", "loops"], 1, &rows)
    }
}
