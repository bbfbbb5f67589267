//! `flatten`: one mesh to the plane, at full precision.

use std::{path::PathBuf, process::ExitCode};

use anyhow::Context;
use dermatome::{
    Error,
    flatten::distortion,
    io::write_flat,
    mesh::Adjacency,
    pipeline::flatten_patch,
    report::{LevelReport, PatchReport},
    skin::PatchId,
};

use crate::{
    console::{
        errors::advise,
        notes::{note_distortion, note_overlaps, note_seams},
        print::{print_json, print_levels},
        progress,
    },
    files::{
        input::read_skin,
        outputs::{self, Outputs},
    },
    options::{AcuityArgs, Common, FlattenArgs, PatchArgs, ReadArgs},
};

/// Arguments of `flatten`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The mesh: .glb, .gltf, .json, .obj, .off, .ply, .stl, .npz, .csv or .txt, with one connected sheet
    mesh: PathBuf,
    /// Output file: .obj, .ply, .off or .glb with texture coordinates, or .npz with V, F and UV in f64;
    /// where the mesh is
    /// cut, V has the vertices of the seam once for each of their places; may be given twice
    #[arg(short, long, value_name = "OUT", required = true)]
    output: Vec<PathBuf>,
    #[command(flatten)]
    flatten: FlattenArgs,
    #[command(flatten)]
    acuity: AcuityArgs,
    /// Print the measures of the map as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    read: ReadArgs,
    #[command(flatten)]
    chosen: PatchArgs,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    outputs::check(args.output.iter().map(PathBuf::as_path))?;
    outputs::check_inputs(args.output.iter().map(PathBuf::as_path), [args.mesh.as_path()])?;
    args.flatten.options()?;
    let mut skin = read_skin(&args.mesh, &args.read, &args.chosen, &args.read.options(), common)?;
    args.acuity.apply(&mut skin)?;
    if skin.patches.len() != 1 {
        let names: Vec<_> = skin.patches.iter().map(|p| p.name.as_str()).collect();
        return Err(advise(
            format!(
                "{} holds {} patches ({}); one is needed",
                args.mesh.display(),
                names.len(),
                names.join(", ")
            ),
            "take one with --patch NAME, or use `dermatome build`, which maps every patch",
        ));
    }
    let patch = &skin.patches[PatchId::new(0)];
    let options = args.flatten.options_for(&skin)?;
    let bar = progress::bar(common);
    bar.set_message("flattening");
    let flat = flatten_patch(patch, &args.flatten.cut()?, &options)
        .with_context(|| format!("cannot flatten {}", args.mesh.display()))?;
    bar.finish_and_clear();
    let mut outputs = Outputs::default();
    for path in &args.output {
        outputs.stage(path, |path| write_flat(path, &flat.mesh, &flat.uv))?;
    }
    outputs.publish(common)?;
    let level = LevelReport {
        level: 0,
        vertices: patch.mesh.positions.len(),
        faces: patch.mesh.triangles.len(),
        seam: flat.seam,
        charts: flat.charts,
        boundary_loops: Adjacency::new(&flat.mesh).map_err(Error::from)?.boundary_loops().len(),
        distortion: distortion(&flat.mesh, &flat.uv),
        convergence: Some(flat.convergence),
    };
    let link = skin.links[patch.link].name.clone();
    let report = [PatchReport { name: patch.name.clone(), link, levels: vec![level] }];
    note_seams(&report, common);
    note_overlaps(&report, &options, common);
    note_distortion(&report, common);
    if args.json {
        print_json("dermatome.flatten/1", &level)?;
    } else if !common.quiet {
        print_levels(&report)?;
    }
    Ok(ExitCode::SUCCESS)
}
