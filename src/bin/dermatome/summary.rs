//! `dermatome summary MAP.glb READINGS -o T.csv`: the sums of a trial.

use std::process::ExitCode;
use std::sync::Arc;

use dermatome::Error;
use dermatome::io::{LoadWriter, SummaryCell, summary_rows, write_summary};
use dermatome::signal::Group;
use serde_json::{Map, Value, json};

use crate::console::errors::advise;
use crate::console::notes::{note, note_count};
use crate::console::print::print_json;
use crate::console::progress;
use crate::files::input::read_map_first;
use crate::files::outputs::{self, is_stream};
use crate::options::{Common, InPath, OutFile, RegionsArgs};
use crate::readings::{FramesArgs, ReadingsArgs, TouchArgs, remark_join};

/// Add up a recording by region, patch, link, contact and for the whole skin.
///
/// One row for each: peak and mean, force, impulse, contact area and contact time, and the path of the centre of
/// pressure, as in pressure mapping; docs/terms.md defines the columns. SI units; readings are in the unit of the
/// channel. A taxel is loaded if its reading is above the threshold.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The map, written by `dermatome build`
    #[arg(value_name = "MAP.glb")]
    map: InPath,
    /// The readings: any that `render` reads; `-`: text or CSV on standard input
    #[arg(value_name = "READINGS")]
    readings: InPath,
    /// Table of the sums
    #[arg(short, long, value_name = "T.csv")]
    output: OutFile,
    /// Also write the loads of every frame: a table
    #[arg(long, value_name = "OUT.csv")]
    over_time: Option<OutFile>,
    #[command(flatten)]
    touch: TouchArgs,
    /// The channel that is added up [default: the first that measures touches]
    #[arg(long, value_name = "NAME")]
    channel: Option<String>,
    /// Print the sums as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    regions: RegionsArgs,
    #[command(flatten)]
    readings_args: ReadingsArgs,
    #[command(flatten)]
    frames: FramesArgs,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    outputs::check_table(&args.output)?;
    args.over_time.as_deref().map_or(Ok(()), outputs::check_table)?;
    let frames = args.frames.range()?;
    let mut map = read_map_first(&args.map)?;
    args.regions.apply(&mut map, common)?;
    let map = Arc::new(map);
    let mut recording = args.readings_args.open(frames, &args.readings, &map, common)?;
    let channel = recording.channel(args.channel.as_deref()).map_err(Error::from)?;
    let tracker = args.touch.options(&recording, channel);
    recording.summarise(&tracker).map_err(Error::from)?;
    remark_join(&recording, &args.readings, common);
    let over_time = args.over_time.as_ref().map(|path| LoadWriter::create(common.outputs.file(path)));
    let mut over_time = over_time.transpose().map_err(Error::from)?;
    let bar = progress::frames(common, recording.frames(), is_stream(&args.readings));
    loop {
        let step = recording.next_step()?;
        let Some((number, time)) = step.map(|step| (step.number as u64, step.frame.time)) else { break };
        if let (Some(writer), Some(summary)) = (&mut over_time, recording.summary()) {
            writer.write(number, time, &map, summary).map_err(Error::from)?;
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let report = recording.report();
    args.frames.check_any(&report)?;
    let Some((summary, threshold)) = recording.summary().zip(recording.threshold()) else {
        return Err(advise("the noise cannot be estimated from one frame", "give --threshold"));
    };
    write_summary(common.outputs.file(&args.output), &map, summary).map_err(Error::from)?;
    over_time.map_or(Ok(()), LoadWriter::finish).map_err(Error::from)?;
    outputs::publish(common)?;
    args.readings_args.remark(&recording, common);
    if summary.channel.newtons().is_none() {
        let unit = &summary.channel.unit;
        note!(common, "forces are left out: the unit {unit:?} is neither one of force nor one of pressure");
    }
    args.touch.remark(&recording, channel, common);
    note_count(common, summary.gaps() as u64, "gaps", "in the times, over which nothing is added up");
    if args.json {
        let value = |cell: SummaryCell| match cell {
            SummaryCell::Text(text) => json!(text),
            SummaryCell::Number(number) => json!(number),
            SummaryCell::Count(count) => json!(count),
        };
        let object = |row: Vec<(&str, SummaryCell)>| -> Map<String, Value> {
            row.into_iter().map(|(name, cell)| (name.to_owned(), value(cell))).collect()
        };
        let groups: Vec<_> = summary_rows(&map, summary).into_iter().map(object).collect();
        let contacts = summary.totals().filter(|(group, _)| matches!(group, Group::Contact(_))).count();
        let json = json!({
            "frames": report.frames, "threshold": threshold, "contacts": contacts, "gaps": summary.gaps(),
            "at_once": recording.at_once(),
            "groups": groups,
        });
        print_json("dermatome.summary/1", &json)?;
    }
    Ok(ExitCode::SUCCESS)
}
