//! `build`: the main job.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use anyhow::Context;
use dermatome::Error;
use dermatome::atlas::skin_images;
use dermatome::cut::Cut;
use dermatome::io::{Outputs, write_images, write_map};
use dermatome::map::{OnAtlas, SkinMap};
use dermatome::page::Page;
use dermatome::pipeline::{BuildOptions, BuildRemark, MagnifyOver, build_with};
use dermatome::pyramid::LevelId;
use dermatome::report::{PatchReport, measure};
use dermatome::run::Run;
use dermatome::skin::AssembleOptions;
use indicatif::ProgressBar;
use serde::Serialize;

use crate::console::errors::{INCOMPLETE, advise};
use crate::console::notes::{note, note_build};
use crate::console::print::{json, print_json, print_levels};
use crate::console::progress;
use crate::files::input::{ReadSkin, names, read_good_patches, skin_files};
use crate::files::outputs::{self, cannot_write, write_bytes};
use crate::options::{
    AcuityArgs, AtlasArgs, Choice, CoarsenArgs, Common, FlattenArgs, InPath, OutFolder, PatchArgs, ReadArgs,
    RegionsArgs, length_or_0, one_of, side_mm,
};

/// Arguments of `build`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The skin: .glb, .gltf, .json, .obj, .off, .ply, .stl, .dae, .3mf, .urdf, .xml, .npz, .csv or
    /// .txt; several files, or
    /// folders of meshes, are one skin
    #[arg(required = true)]
    skin: Vec<InPath>,
    /// Folder for map.glb, map.exr, report.json, report.html and timings.json; created if it does not exist
    /// [default: that of the skin, as forearm.map for forearm.glb; needed with several files]
    #[arg(short, long, value_name = "DIR")]
    output: Option<OutFolder>,
    #[command(flatten)]
    coarsen: CoarsenArgs,
    #[command(flatten)]
    acuity: AcuityArgs,
    #[command(flatten)]
    flatten: FlattenArgs,
    #[command(flatten)]
    regions: RegionsArgs,
    #[command(flatten)]
    atlas: AtlasArgs,
    /// Densities of --magnify and --acuity are relative to the mean of: [default: skin]
    #[arg(long, value_parser = one_of(&MAGNIFY_OVER), help_heading = "Map")]
    magnify_over: Option<MagnifyOver>,
    /// Widest gap between patches that contacts go on over, as in 20mm; 0: none [default: 3.5 spacings]
    #[arg(long, value_name = "LENGTH|0", value_parser = length_or_0, allow_hyphen_values = true, help_heading = "Body", hide_short_help = true)]
    across: Option<f64>,
    /// Side of a pixel of the images, in mm on the map [default: 1, or larger where that would make
    /// more than 256 pixels a taxel, or 4 million in all]
    #[arg(long = "pixel-mm", value_name = "MM", value_parser = side_mm, help_heading = "Images")]
    pixel: Option<f64>,
    /// Map the patches that can be mapped; exit code 1 if others were left out
    #[arg(long)]
    keep_going: bool,
    /// Print report.json on standard output
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    read: ReadArgs,
    #[command(flatten)]
    chosen: PatchArgs,
}

/// Over what densities and acuities are compared.
const MAGNIFY_OVER: [Choice<MagnifyOver>; 2] = [
    ("skin", MagnifyOver::Skin, "The map of a denser patch is larger"),
    ("patch", MagnifyOver::Patch, "Every map is as large as its patch"),
];

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let folder = &match (&args.output, &args.skin[..]) {
        (Some(folder), _) => folder.into(),
        // `.` has no name of its own.
        (None, [skin]) if skin.file_name().is_none() => {
            let whole = skin.canonicalize().map_err(|source| cannot_write(skin, source))?;
            whole.with_extension("map")
        }
        (None, [skin]) => skin.with_extension("map"),
        (None, _) => return Err(advise("several files are one skin", "name its folder with -o DIR")),
    };
    let inputs = skin_files(&args.skin)?;
    let files: Vec<PathBuf> =
        FILES.into_iter().chain([REPORT, PAGE, TIMINGS]).map(|name| folder.join(name)).collect();
    if args.skin.iter().any(|path| path.is_dir() && outputs::is_same(path, folder)) {
        let what = format!("the map would go among the files of the skin, in {}", folder.display());
        return Err(advise(what, "name another folder with -o DIR"));
    }
    outputs::add_inputs(&inputs, &common.outputs);
    outputs::guard(&files, &common.outputs)?;
    let mut options = BuildOptions {
        cut: args.flatten.cut(common)?,
        seam_side: args.flatten.seam_side,
        coarsen: args.coarsen.options(),
        flatten: args.flatten.options()?,
        pixel: args.pixel,
        magnify_over: args.magnify_over.unwrap_or_default(),
        across: args.across,
        keep_going: args.keep_going,
    };
    let start = Instant::now();
    let assemble = AssembleOptions {
        fill_holes: args.coarsen.fill_holes(),
        keep_going: args.keep_going,
        ..args.read.options(&inputs)
    };
    let ReadSkin { mut skin, left_out, mut others } =
        read_good_patches(&inputs, &args.read, &args.chosen, &assemble, common)?;
    check_output(folder, &files)?;
    let atlas = args.atlas.read()?;
    args.acuity.apply(&mut skin, &others, common)?;
    args.regions.check(&skin, &others)?;
    args.flatten.keep_seams(&mut options.cut, &others, common);
    options.flatten = args.flatten.options_for(&skin, common)?;
    let read = start.elapsed().as_secs_f64();

    if let Some(atlas) = atlas.as_ref().filter(|_| options.cut == Cut::Auto)
        && let Some(seams) = args.atlas.seams(atlas, &skin, &others, common)?
    {
        options.cut = seams;
    }

    let bar = progress::bar(common);
    let on_progress = |progress| progress::show(&bar, progress);
    let mut built = build_with(&skin, &options, Run::default().telling(&on_progress).counting(&common.steps))
        .with_context(|| format!("cannot map {}", names(&inputs).display()))?;
    // Patches that could not be mapped are not in the map.
    others.taxels.extend(skin.patches.iter().flat_map(|patch| patch.taxels.ids.iter()));
    others.patches.extend(skin.patches.iter().map(|patch| patch.name.clone()));
    if !args.regions.is_empty() {
        args.regions.apply_with(Arc::make_mut(&mut built.map), &others, common)?;
    }
    if let Some(atlas) = &atlas {
        args.atlas.apply(atlas, &mut built, &skin, &options, &others, common)?;
    }
    let title = title(&args.skin, folder);
    let [rasterise, write] = write_files(&built.map, &title, folder, &common.outputs, &bar)?;
    bar.finish_and_clear();

    let report = Report {
        version: env!("CARGO_PKG_VERSION"),
        input: names(&args.skin).display().to_string(),
        atlas: built.map.atlas.clone(),
        patches: measure(&built.map),
    };
    let timings = Timings {
        seconds: Seconds {
            read,
            coarsen: built.coarsened_in.as_secs_f64(),
            flatten: built.flattened_in.as_secs_f64(),
            rasterise,
            write,
        },
        peak_memory_bytes: peak_memory_bytes(),
    };
    let texts = [(REPORT, json(SCHEMA, &report)?), (TIMINGS, json("dermatome.timings/1", &timings)?)];
    for (name, text) in texts {
        write_bytes(&common.outputs.file(folder.join(name)), text.as_bytes()).map_err(Error::from)?;
    }
    outputs::publish(common)?;
    let mut remarks = BuildRemark::of_skin(&skin);
    remarks.extend(built.remarks(&options));
    note_build(&remarks, &options, common);
    note_page(&built.map, common);
    if args.json {
        print_json(SCHEMA, &report)?;
    } else if !common.quiet {
        print_levels(&report.patches)?;
    }
    Ok(if left_out + built.failed.len() > 0 { ExitCode::from(INCOMPLETE) } else { ExitCode::SUCCESS })
}

/// Writes [`FILES`] and the page of a map side by side; returns the seconds until the map was rasterised, and the
/// rest.
fn write_files(
    map: &Arc<SkinMap>,
    title: &str,
    folder: &Path,
    outputs: &Outputs,
    bar: &ProgressBar,
) -> Result<[f64; 2], Error> {
    progress::step(bar, "writing", 0, map.patches.len());
    let (start, rasterised) = (Instant::now(), OnceLock::new());
    let [map_file, images_file, page_file] =
        [FILES[0], FILES[1], PAGE].map(|name| outputs.file(folder.join(name)));
    let write_map = || write_map(map_file, map);
    let write_images = || {
        let images = skin_images(map)?;
        rasterised.get_or_init(|| start.elapsed());
        Ok::<_, Error>(write_images(images_file, &images)?)
    };
    let write_page = || {
        if taxels(map) > MOST_SHOWN {
            return Ok(());
        }
        let page = Page::new(map, title)?.to_html()?;
        Ok::<_, Error>(write_bytes(&page_file, page.as_bytes())?)
    };
    let (map_written, (images_written, page_written)) =
        rayon::join(write_map, || rayon::join(write_images, write_page));
    map_written.map_err(Error::from).and(images_written).and(page_written)?;
    let rasterised = rasterised.into_inner().unwrap_or_default();
    Ok([rasterised, start.elapsed() - rasterised].map(|time| time.as_secs_f64()))
}

fn taxels(map: &SkinMap) -> usize {
    map.patches.iter().map(|patch| patch.levels[LevelId::new(0)].level.mesh.positions.len()).sum()
}

/// What the page is called: as the file of the skin, or as the folder where there are several.
fn title(skin: &[InPath], folder: &Path) -> String {
    let path = if let [skin] = skin { skin } else { folder };
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Prints that a map has too many taxels for its page.
fn note_page(map: &SkinMap, common: &Common) {
    let count = taxels(map);
    if count > MOST_SHOWN {
        note!(
            common,
            "{PAGE} is not written for {count} taxels, since a browser is slow with more than {MOST_SHOWN}; \
             `dermatome report` writes it"
        );
    }
}

/// What `report.json` holds: the same input gives the same report.
#[derive(Debug, Serialize)]
struct Report {
    /// Version of dermatome that made the map.
    version: &'static str,
    /// The file it was made from.
    input: String,
    /// The map of another skin that it is drawn on.
    #[serde(skip_serializing_if = "Option::is_none")]
    atlas: Option<OnAtlas>,
    patches: Vec<PatchReport>,
}

/// What `timings.json` holds: what differs from run to run.
#[derive(Debug, Serialize)]
struct Timings {
    /// By stage, in their order.
    seconds: Seconds,
    /// Largest resident memory of the process, where the system reports it.
    peak_memory_bytes: Option<u64>,
}

/// Wall-clock seconds of the stages of a build.
#[derive(Debug, Serialize)]
struct Seconds {
    /// Reading and assembling the skin.
    read: f64,
    coarsen: f64,
    flatten: f64,
    rasterise: f64,
    /// Writing the map, the images and the page, which begins while images are still drawn.
    write: f64,
}

/// The files of the map.
const FILES: [&str; 2] = ["map.glb", "map.exr"];

/// The file of measures, next to [`FILES`].
const REPORT: &str = "report.json";

/// The file that shows the map in a browser.
const PAGE: &str = "report.html";

/// Taxels of a map up to which [`PAGE`] is written: that of a million faces has 23 MB and took a fifth of the build.
const MOST_SHOWN: usize = 250_000;

/// What the keys of [`REPORT`] mean.
const SCHEMA: &str = "dermatome.build/1";

/// The file of what differs from run to run.
const TIMINGS: &str = "timings.json";

/// Makes the folder, and refuses before any work an output that could not be written after it.
fn check_output(folder: &Path, files: &[PathBuf]) -> Result<(), Error> {
    outputs::make_folder(folder)?;
    files.iter().try_for_each(|path| outputs::check_file(path))?;
    // A file without a name leaves nothing behind.
    tempfile::tempfile_in(folder).map_err(|e| cannot_write(folder, e.kind().into()))?;
    Ok(())
}

/// Largest resident memory of this process so far, in bytes; `None` where the system does not
/// report it.
fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(kibibytes * 1024)
}
