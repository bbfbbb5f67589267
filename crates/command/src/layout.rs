//! `layout`: a draft of a layout of what a recording states.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::process::ExitCode;

use dermatome::Error;
use dermatome::io::{IoError, replace_file};

use crate::console::notes::note;
use crate::console::print::print;
use crate::files::outputs::{self, is_stream};
use crate::options::{Common, InPath, OutFile};

/// Draft a layout of a recording: what its file states, and null where somebody has to know.
///
/// The draft is complete when no null is left; docs/files.md describes the keys.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The recording: any that `render` reads
    #[arg(value_name = "READINGS")]
    readings: InPath,
    /// File for the layout, or `-`
    #[arg(short, long, value_name = "OUT.json", default_value = "-")]
    output: OutFile,
    /// Which stream of a file with several: an array, a sensor
    #[arg(long, value_name = "NAME")]
    stream: Option<String>,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let draft = common.containers.draft(&args.readings, args.stream.as_deref()).map_err(Error::from)?;
    if is_stream(&args.output) {
        print(&draft)?;
        return Ok(ExitCode::SUCCESS);
    }
    let write = |file: &mut BufWriter<&File>| {
        let path = args.output.to_path_buf();
        file.write_all(draft.as_bytes()).map_err(|source| IoError::Write { path, source })
    };
    replace_file(common.outputs.file(&args.output), write).map_err(Error::from)?;
    outputs::publish(common)?;
    let open = draft.lines().filter(|line| line.trim_end_matches(',').ends_with("null")).count();
    if open > 0 {
        note!(common, "{open} values are null: the file does not state them");
    }
    Ok(ExitCode::SUCCESS)
}
