//! `build`: the main job.

use std::{
    fs,
    io::ErrorKind,
    path::{Path, PathBuf},
    process::ExitCode,
    time::Instant,
};

use anyhow::Context;
use dermatome::{
    Error,
    atlas::skin_images,
    io::{IoError, temporary_prefix, write_images, write_json, write_map},
    pipeline::{BuildOptions, Stage, build},
    report::{Report, Stages, measure},
    skin::AssembleOptions,
};
use tempfile::TempDir;

use crate::{
    common::Common,
    input::read_skin,
    memory::peak_memory_bytes,
    notes::note_overlaps,
    options::{BareArgs, CoarsenArgs, FlattenArgs, length_mm},
    print::{print_json, print_levels},
    progress,
    signals::clean_when_stopped,
};

/// Arguments of `build`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The skin: .glb, .gltf, .json, .obj, .ply, .stl, .csv or .txt
    skin: PathBuf,
    /// Folder for map.glb, map.exr and report.json; made if it does not exist
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    coarsen: CoarsenArgs,
    #[command(flatten)]
    flatten: FlattenArgs,
    /// Side of a pixel of the images, in mm on the map
    #[arg(long, value_name = "MM", default_value_t = 1.0, value_parser = length_mm, help_heading = "Images")]
    pixel_mm: f64,
    /// Print report.json
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    bare: BareArgs,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let mut seconds = Stages::default();
    let options = args.options()?;
    let mut lap = Lap::start();
    let assemble = AssembleOptions { fill_holes: args.coarsen.fill_holes, ..args.bare.options() };
    let skin = read_skin(&args.skin, &assemble, common)?;
    check_output(&args.output)?;
    seconds.read = lap.seconds();

    let bar = progress::bar(common);
    let watch = |stage: Stage, done: usize, total: usize| {
        bar.set_message(match stage {
            Stage::Coarsen => "coarsening",
            Stage::Flatten => "flattening",
        });
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    };
    let (map, spent) =
        build(&skin, &options, &watch).with_context(|| format!("cannot map {}", args.skin.display()))?;
    (seconds.coarsen, seconds.flatten) = (spent.coarsen, spent.flatten);
    drop(skin);

    lap = Lap::start();
    bar.set_message("rasterising");
    let images = skin_images(&map).map_err(Error::from)?;
    seconds.rasterise = lap.seconds();
    bar.set_message("writing");
    let outputs = Outputs::new(&args.output)?;
    outputs.write("map.glb", |path| write_map(path, &map))?;
    outputs.write("map.exr", |path| write_images(path, &images))?;
    seconds.write = lap.seconds();
    bar.finish_and_clear();

    let report = Report {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        input: args.skin.display().to_string(),
        seconds,
        peak_memory_bytes: peak_memory_bytes(),
        patches: measure(&map),
    };
    outputs.write("report.json", |path| write_json(path, &report))?;
    outputs.publish()?;
    note_overlaps(&report.patches, &options.flatten, common);
    if args.json {
        print_json(&report)?;
    } else if !common.quiet {
        print_levels(&report.patches)?;
    }
    Ok(ExitCode::SUCCESS)
}

impl Args {
    fn options(&self) -> anyhow::Result<BuildOptions> {
        Ok(BuildOptions {
            coarsen: self.coarsen.options(),
            flatten: self.flatten.options()?,
            pixel: self.pixel_mm * 1e-3,
        })
    }
}

/// Makes the folder, and refuses before any work what would fail after it.
fn check_output(folder: &Path) -> Result<(), Error> {
    fs::create_dir_all(folder)
        .map_err(|source| Error::from(IoError::Write { path: folder.to_owned(), source }))?;
    if let Some(path) = FILES.iter().map(|name| folder.join(name)).find(|path| path.is_dir()) {
        return Err(cannot_write(&path, ErrorKind::IsADirectory));
    }
    // A file without a name: nothing of it can be left behind.
    tempfile::tempfile_in(folder).map_err(|e| cannot_write(folder, e.kind()))?;
    Ok(())
}

/// The kind alone: what else the system says may name a temporary file.
fn cannot_write(path: &Path, why: ErrorKind) -> Error {
    IoError::Write { path: path.to_owned(), source: why.into() }.into()
}

/// What a build writes.
const FILES: [&str; 3] = ["map.glb", "map.exr", "report.json"];

/// A folder whose files change together: they are written into a hidden folder inside it, then renamed.
struct Outputs {
    folder: PathBuf,
    staging: TempDir,
}

impl Outputs {
    fn new(folder: &Path) -> Result<Self, Error> {
        clean_when_stopped(folder);
        let staging = tempfile::Builder::new()
            .prefix(temporary_prefix())
            .tempdir_in(folder)
            .map_err(|e| cannot_write(folder, e.kind()))?;
        Ok(Self { folder: folder.to_owned(), staging })
    }

    fn write(&self, name: &str, write: impl FnOnce(&Path) -> Result<(), IoError>) -> Result<(), Error> {
        Ok(write(&self.staging.path().join(name)).map_err(|e| e.about(&self.folder.join(name)))?)
    }

    fn publish(self) -> anyhow::Result<()> {
        for name in FILES {
            let path = self.folder.join(name);
            fs::rename(self.staging.path().join(name), &path)
                .map_err(|source| Error::from(IoError::Write { path, source }))?;
        }
        Ok(())
    }
}

/// Seconds since the last look.
struct Lap(Instant);

impl Lap {
    fn start() -> Self {
        Self(Instant::now())
    }

    fn seconds(&mut self) -> f64 {
        let spent = self.0.elapsed().as_secs_f64();
        self.0 = Instant::now();
        spent
    }
}
