//! `flatten`: one mesh to the plane, as level 0 of a `build`.

use std::path::Path;
use std::process::ExitCode;

use anyhow::Context;
use dermatome::Error;
use dermatome::io::{IoError, write_flat};
use dermatome::mesh::FillHoles;
use dermatome::pattern::{Sheet, draw_pattern};
use dermatome::pipeline::{BuildOptions, build_finest};
use dermatome::pyramid::LevelId;
use dermatome::report::measure;
use dermatome::run::Run;
use dermatome::skin::{AssembleOptions, PatchId};

use crate::console::errors::advise;
use crate::console::notes::note_build;
use crate::console::print::{print_json, print_levels};
use crate::console::progress;
use crate::files::input::{ReadSkin, read_good_patches, select_patches};
use crate::files::outputs;
use crate::files::patterns::{check_sheet, pattern_kind, sheet, write_pattern};
use crate::options::{AcuityArgs, Common, FlattenArgs, InPath, OutFile, PatchArgs, ReadArgs};

/// Arguments of `flatten`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The mesh: .glb, .gltf, .json, .obj, .off, .ply, .stl, .dae, .3mf, .urdf, .xml, .npz, .csv or
    /// .txt, with one connected sheet
    mesh: InPath,
    /// Output file: .obj with texture coordinates, or .npz with V, F and UV in f64; where the mesh is
    /// cut, V has the vertices of the seam once for each of their places; .svg or .dxf: the pattern at 1:1, to
    /// print or cut; may be given more than once
    #[arg(short, long, value_name = "OUT", required = true)]
    output: Vec<OutFile>,
    /// Write the pattern OUT.svg on sheets of paper with crosses to join them, as OUT-1.svg, OUT-2.svg, ...:
    /// A4, A3, or width and height in mm
    #[arg(long, value_name = "A4|A3|W,H", value_parser = sheet)]
    sheet: Option<Sheet>,
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
    args.output.iter().try_for_each(|path| check_kind(path))?;
    check_sheet(args.sheet, args.output.iter().map(|path| &**path))?;
    args.flatten.options()?;
    let assemble = AssembleOptions { fill_holes: FillHoles::PinHoles, ..args.read.options(&[&args.mesh]) };
    let files = [(&args.mesh).into()];
    let ReadSkin { mut skin, others, .. } =
        read_good_patches(&files, &args.read, &args.chosen, &assemble, common)?;
    args.acuity.apply(&mut skin, &others, common)?;
    if skin.patches.len() > 1 && !args.chosen.patches.is_empty() {
        // A piece of a sheet may have the name of the sheet.
        let patches = skin.patches.into_iter().collect();
        skin.patches = select_patches(&args.mesh, patches, &args.chosen.patches, |patch| &patch.name)?.into();
    }
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
    let mut cut = args.flatten.cut(common)?;
    args.flatten.keep_seams(&mut cut, &others, common);
    let options = BuildOptions {
        cut,
        seam_side: args.flatten.seam_side,
        flatten: args.flatten.options_for(&skin, common)?,
        ..BuildOptions::default()
    };
    let bar = progress::bar(common);
    bar.set_message("flattening");
    let built = build_finest(&skin, &options, Run::default().counting(&common.steps))
        .with_context(|| format!("cannot flatten {}", args.mesh.display()))?;
    bar.finish_and_clear();
    let map = &built.map;
    let patch = &map.patches[PatchId::new(0)];
    let finest = &patch.levels[LevelId::new(0)];
    let mut mesh = finest.opened().into_owned();
    // What closes pin-holes is no skin.
    let skin_faces = mesh.triangles.len() - patch.filled;
    mesh.triangles = mesh.triangles.into_iter().take(skin_faces).collect();
    let (patterns, flat): (Vec<_>, Vec<_>) =
        args.output.iter().partition(|path| pattern_kind(path).is_some());
    for path in flat {
        write_flat(common.outputs.file(path), &mesh, &finest.opened_uv()).map_err(Error::from)?;
    }
    if !patterns.is_empty() {
        let drawing = draw_pattern(map, &[]).map_err(Error::from)?;
        patterns.iter().try_for_each(|path| write_pattern(path, &drawing, args.sheet, common))?;
    }
    outputs::publish(common)?;
    let report = measure(map);
    note_build(&built.remarks(&options), &options, common);
    if args.json {
        print_json("dermatome.flatten/1", &report[0].levels[0])?;
    } else if !common.quiet {
        print_levels(&report)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Refuses, before any work, a file of unknown kind.
fn check_kind(path: &Path) -> Result<(), Error> {
    match outputs::kind(path).as_str() {
        "obj" | "npz" | "svg" | "dxf" => Ok(()),
        _ => Err(IoError::UnknownKind { path: path.to_owned(), known: "obj, npz, svg, dxf" }.into()),
    }
}
