//! Options that several subcommands share, and what they mean to the library.

mod coarsen;
mod flatten;
mod patches;
mod paths;
mod read;
mod regions;
mod robot;
mod values;

use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use clap::ValueEnum;
use dermatome::io::Outputs;

pub(crate) use coarsen::{AcuityArgs, CoarsenArgs};
pub(crate) use flatten::{BoundaryArg, CutArg, FlattenArgs};
pub(crate) use patches::{PatchArgs, pattern};
pub(crate) use paths::{
    InPath, LayoutArg, MayRead, ModulesArg, OutFile, OutFolder, SkipArg, layout_arg, modules_arg, skip_arg,
};
pub(crate) use read::{ReadArgs, Spacing, Unit};
pub(crate) use regions::{RegionSource, RegionsArgs};
pub(crate) use robot::{JointsArg, RobotArgs, joints};
pub(crate) use values::{Choice, PROBES, length, length_mm, length_or_0, number, one_of, side_mm, word_of};

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
    /// Steps of iterations so far.
    #[arg(skip)]
    pub(crate) steps: Arc<AtomicU64>,
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
