//! Options that several subcommands share, and what they mean to the library.

mod atlas;
mod coarsen;
mod flatten;
mod patches;
mod paths;
mod read;
mod regions;
mod robot;
mod values;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use clap::ValueEnum;
use dermatome::io::{IoError, Outputs, ReadOptions, ReadingsReader};

pub(crate) use atlas::AtlasArgs;
pub(crate) use coarsen::{AcuityArgs, CoarsenArgs};
pub(crate) use flatten::{BoundaryArg, CutArg, FlattenArgs};
pub(crate) use patches::{PatchArgs, pattern};
pub(crate) use paths::{
    InPath, LandmarkSource, LayoutArg, MayRead, ModuleArg, ModulesArg, OutFile, OutFolder, SkipArg,
    layout_arg, module_arg, modules_arg, skip_arg,
};
pub(crate) use read::{ReadArgs, Spacing, Unit};
pub(crate) use regions::{RegionSource, RegionsArgs};
pub(crate) use robot::{JointValues, JointsArg, RobotArgs, joints};
pub(crate) use values::{
    Choice, LevelArg, PROBES, field_level, length, length_mm, length_or_0, level, number, numbers, one_of,
    side_mm, whole, word_of,
};

/// Options that every subcommand takes.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Global options")]
pub(crate) struct Common {
    /// Number of worker threads; 0: one per processor. The result does not depend on it.
    #[arg(long, global = true, hide_short_help = true, default_value_t = 0, value_name = "N", value_parser = threads)]
    pub(crate) threads: usize,
    /// Print errors only: no progress and no notes.
    #[arg(long, short, global = true, hide_short_help = true)]
    pub(crate) quiet: bool,
    /// Print every note by itself; with `calibrate` also every iteration and outlier.
    #[arg(long, short, global = true, hide_short_help = true, conflicts_with = "quiet")]
    pub(crate) verbose: bool,
    /// When to use colours.
    #[arg(long, global = true, hide_short_help = true, default_value = "auto", value_name = "WHEN")]
    pub(crate) color: ColorChoice,
    /// The files that this run writes, and those that it reads.
    #[arg(skip)]
    pub(crate) outputs: Outputs,
    /// Who reads files that the library does not.
    #[arg(skip)]
    pub(crate) containers: Containers,
    /// Steps of iterations so far.
    #[arg(skip)]
    pub(crate) steps: Arc<AtomicU64>,
}

/// Opens a recording that the library does not read itself; `None` if this is none that is read there.
pub type OpenContainer = dyn Fn(&Path, &ReadOptions) -> Option<Result<ReadingsReader, IoError>> + Send + Sync;

/// Drafts a layout of one stream of such a recording, or of the only one; `None` if this is none that is read there.
pub type DraftContainer = dyn Fn(&Path, Option<&str>) -> Option<Result<String, IoError>> + Send + Sync;

/// Who reads files that the library does not: Zarr, LeRobot, HDF5 and bags, in the Python package. Files are tried with it
/// first.
#[derive(Clone, Default)]
pub struct Containers {
    /// Opens a recording.
    pub open: Option<Arc<OpenContainer>>,
    /// Drafts a layout.
    pub draft: Option<Arc<DraftContainer>>,
}

impl Containers {
    pub(crate) fn open(&self, path: &Path, options: ReadOptions) -> Result<ReadingsReader, IoError> {
        let opened = self.open.as_ref().and_then(|open| open(path, &options));
        opened.unwrap_or_else(|| ReadingsReader::open(path, options))
    }

    pub(crate) fn draft(&self, path: &Path, stream: Option<&str>) -> Result<String, IoError> {
        let drafted = self.draft.as_ref().and_then(|draft| draft(path, stream));
        drafted.unwrap_or_else(|| ReadingsReader::draft_layout(path, stream))
    }
}

impl std::fmt::Debug for Containers {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Containers").field(&self.open.is_some()).field(&self.draft.is_some()).finish()
    }
}

impl Common {
    /// The number of worker threads: `--threads`, else the environment's; 0: one per processor.
    pub(crate) fn workers(&self) -> Result<usize, String> {
        match std::env::var(THREADS_VARIABLE) {
            Ok(text) if self.threads == 0 && !text.is_empty() => {
                threads(&text).map_err(|needed| format!("{THREADS_VARIABLE} is {text:?}; {needed}"))
            }
            _ => Ok(self.threads),
        }
    }
}

/// The variable that rayon reads for itself, without a limit.
const THREADS_VARIABLE: &str = "RAYON_NUM_THREADS";

/// More threads than any machine gains from, and few enough that making them takes no time.
const MOST_THREADS: usize = 512;

fn threads(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n) if n <= MOST_THREADS => Ok(n),
        _ => Err(format!("needed: a number from 0 to {MOST_THREADS}")),
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ColorChoice {
    Auto,
    Always,
    Never,
}
