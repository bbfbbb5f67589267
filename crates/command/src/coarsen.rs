//! `coarsen`: the pyramid alone.

use std::process::ExitCode;

use dermatome::Error;
use dermatome::io::{IoError, write_pyramids};
use dermatome::mesh::Adjacency;
use dermatome::pyramid::{Level, Pyramid, coarsen};
use dermatome::run::Run;
use dermatome::skin::{AssembleOptions, Patch, Skin};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::console::notes::note_rounding;
use crate::console::print::{plain, print_json, print_table};
use crate::files::input::{ReadSkin, read_good_patches};
use crate::files::outputs;
use crate::options::{AcuityArgs, CoarsenArgs, Common, InPath, OutFile, PatchArgs, ReadArgs};

/// Arguments of `coarsen`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The skin: .glb, .gltf, .json, .obj, .off, .ply, .stl, .dae, .3mf, .urdf, .xml, .npz, .csv or
    /// .txt
    skin: InPath,
    /// File for the levels, as in a map file but without maps: .glb
    #[arg(short, long, value_name = "OUT.glb")]
    output: OutFile,
    #[command(flatten)]
    coarsen: CoarsenArgs,
    #[command(flatten)]
    acuity: AcuityArgs,
    /// Print the levels as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    read: ReadArgs,
    #[command(flatten)]
    chosen: PatchArgs,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    if outputs::kind(&args.output) != "glb" {
        let (path, known) = ((&args.output).into(), "glb");
        return Err(Error::from(IoError::UnknownKind { path, known }).into());
    }
    let assemble =
        AssembleOptions { fill_holes: args.coarsen.fill_holes(), ..args.read.options(&[&args.skin]) };
    let files = [(&args.skin).into()];
    let ReadSkin { mut skin, others, .. } =
        read_good_patches(&files, &args.read, &args.chosen, &assemble, common)?;
    args.acuity.apply(&mut skin, &others, common)?;
    let options = args.coarsen.options();
    let coarsen = |patch: &Patch| {
        let coarsened = coarsen(&patch.mesh, &patch.taxels, &options, Run::default()).map_err(Error::from);
        coarsened.map_err(|source| Error::Patch { patch: patch.name.clone(), source: source.into() })
    };
    let made: Vec<_> = skin.patches.as_slice().par_iter().map(coarsen).collect();
    let pyramids: Vec<Pyramid> = made.into_iter().collect::<Result<_, _>>()?;
    write_pyramids(common.outputs.file(&args.output), &skin, &pyramids).map_err(Error::from)?;
    outputs::publish(common)?;
    note_rounding(&skin, common);
    let (summary, rows) = summarise(&skin, &pyramids)?;
    if args.json {
        print_json("dermatome.coarsen/1", &summary)?;
    } else if !common.quiet {
        print_table(1, &rows)?;
    }
    Ok(ExitCode::SUCCESS)
}

type LevelRow = [(&'static str, String); 4];

/// The patches as `report.json` lists them, with what is known without a map, and the levels as
/// rows of a table.
fn summarise(skin: &Skin, pyramids: &[Pyramid]) -> Result<(Value, Vec<LevelRow>), Error> {
    let (mut patches, mut rows) = (Vec::new(), Vec::new());
    for (Patch { name, link, .. }, pyramid) in skin.patches.iter().zip(pyramids) {
        let mut levels = Vec::new();
        // Removals neither open nor close a loop, so the coarsest level has those of all.
        let coarsest = pyramid.levels.iter().last().map(|level| Adjacency::new(&level.mesh)).transpose()?;
        let loops = coarsest.map_or(0, |adjacency| adjacency.boundary_loops().len());
        for (id, Level { mesh, .. }) in pyramid.levels.enumerate() {
            let (vertices, faces) = (mesh.positions.len(), mesh.triangles.len());
            let counts = [("vertices", vertices), ("faces", faces), ("loops", loops)];
            let [a, b, c] = counts.map(|(title, count)| (title, count.to_string()));
            rows.push([("level", format!("{}/{id:?}", plain(name))), a, b, c]);
            levels.push(json!({
                "level": id.index(), "vertices": vertices, "faces": faces, "boundary_loops": loops,
            }));
        }
        patches.push(json!({ "name": name, "link": skin.links[*link].name, "levels": levels }));
    }
    Ok((json!({ "patches": patches }), rows))
}
