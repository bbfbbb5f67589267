//! `dermatome bench MAP.glb`: what answers on each level of a map cost here, and how exact they are.

use std::{path::PathBuf, process::ExitCode};

use dermatome::{Error, contact::measure, io::read_map};

use crate::console::print::{print, print_json};

/// Measure lookups on a map: time, error bound and true error on each level.
///
/// Contacts lie 0 to 3 mm off the skin. It prints tables in Markdown: of exact answers, alone, on a path, in a
/// batch and from the map back to the skin; and of the answers of each coarser level alone, as `lookup
/// --reactive` gives them. At a million triangles it takes a minute.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The map, written by `dermatome build`
    #[arg(value_name = "MAP.glb")]
    map: PathBuf,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let map = read_map(&args.map).map_err(Error::from)?;
    let costs = measure(&map).map_err(Error::from)?;
    if args.json { print_json("dermatome.bench/1", &costs) } else { print(&costs.to_markdown()) }?;
    Ok(ExitCode::SUCCESS)
}
