//! `dermatome bench MAP.glb`: what answers on a map cost here, and how exact they are.

mod measure;

use std::process::ExitCode;

use dermatome::Error;

use crate::console::print::{print, print_json};
use crate::files::input::read_map_first;
use crate::options::InPath;

/// Measure lookups on a map: time, interval and true error, by distance from the skin and level.
///
/// It prints tables in Markdown, of contacts on both sides of the skin: of exact answers 0 to 3 mm off it, alone, on a path, in a
/// batch and from the map back to the skin; and of intervals, as `lookup --reactive` gives them, 0 to 3, 3 to 10, 10 to 20 and
/// 20 to 50 mm off it: alone, and with the cell on each level. At a million triangles it takes a minute.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The map, written by `dermatome build`
    #[arg(value_name = "MAP.glb")]
    map: InPath,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let map = read_map_first(&args.map)?;
    let costs = measure::measure(&map).map_err(Error::from)?;
    if args.json { print_json("dermatome.bench/2", &costs) } else { print(&costs.to_markdown()) }?;
    Ok(ExitCode::SUCCESS)
}
