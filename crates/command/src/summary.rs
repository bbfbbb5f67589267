//! `dermatome summary MAP.glb READINGS -o T.csv`: the sums of a trial.

use std::process::ExitCode;
use std::sync::Arc;

use dermatome::Error;
use dermatome::body::FieldLevel;
use dermatome::io::{
    LoadWriter, Statement, StatementSource, SummaryCell, SummaryRow, summary_rows, summary_step_rows,
    write_summary, write_summary_steps,
};
use dermatome::map::SkinMap;
use dermatome::signal::{Group, OutsideSteps, Summary};
use serde_json::{Map, Value, json};

use crate::console::errors::advise;
use crate::console::notes::{note, note_count};
use crate::console::print::{plain, print_json};
use crate::files::input::read_map_first;
use crate::files::outputs;
use crate::options::{Common, InPath, LevelArg, OutFile, RegionsArgs, field_level, level};
use crate::readings::{FramesArgs, Played, ReadingsArgs, TouchArgs, remark_join};

/// Add up a recording by region, patch, link, contact and for the whole skin, or step by step.
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
    /// What has a row. group: the whole skin, each link, patch, region and contact; step: each loading of a patch or a
    /// region from begin to end, as the steps of a gait; body.L2, arm.thermal.L0: the groups, and each field of this
    /// level of the whole body or of a modality
    #[arg(long, value_name = "group|step|body.LK", value_parser = rows, default_value = "group")]
    by: Rows,
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

/// What has a row of the table.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Rows {
    Groups,
    Steps,
    /// The groups, and the fields of this level of the whole body, or of a modality.
    Fields(String),
}

fn rows(text: &str) -> Result<Rows, String> {
    match text {
        "group" => Ok(Rows::Groups),
        "step" => Ok(Rows::Steps),
        _ => match level(text) {
            Ok(LevelArg::Fields(name)) => Ok(Rows::Fields(name)),
            _ => {
                Err("needed: group, step, body.L0, ... of the whole body, or as arm.thermal.L0 of a modality"
                    .into())
            }
        },
    }
}

/// What files call the names of their sensors, which may say left or right.
const SENSORS: [&str; 3] = ["sensor", "sole", "side"];

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    outputs::check_table(&args.output)?;
    args.over_time.as_deref().map_or(Ok(()), outputs::check_table)?;
    let frames = args.frames.range()?;
    let mut map = read_map_first(&args.map)?;
    args.regions.apply(&mut map, common)?;
    let fields: Option<FieldLevel> = match &args.by {
        Rows::Fields(name) => Some(field_level(name, Some(&map))?.0),
        Rows::Groups | Rows::Steps => None,
    };
    let map = Arc::new(map);
    let mut recording = args.readings_args.open(frames, &args.readings, &map, common)?;
    let channel = recording.channel(args.channel.as_deref()).map_err(Error::from)?;
    let tracker = args.touch.options(&recording, channel);
    match fields {
        Some(at) => recording.summarise_fields(&tracker, at),
        None if args.by == Rows::Steps => recording.summarise_steps(&tracker),
        None => recording.summarise(&tracker),
    }
    .map_err(Error::from)?;
    remark_join(&recording, &args.readings, common);
    let over_time = args.over_time.as_ref().map(|path| LoadWriter::create(common.outputs.file(path)));
    let mut over_time = over_time.transpose().map_err(Error::from)?;
    let has_episodes = recording.episodes() > 1;
    let played = Played::each(&mut recording, &args.readings, common, |recording, _| {
        let Some(step) = recording.next_step()? else { return Ok(false) };
        let (number, episode, time) = (step.number as u64, step.episode, step.frame.time);
        if let (Some(writer), Some(summary)) = (&mut over_time, recording.summary()) {
            if has_episodes {
                writer.begin_episode(episode);
            }
            writer.write(number, time, &map, summary).map_err(Error::from)?;
        }
        Ok(true)
    })?;
    let report = recording.report();
    args.frames.check_any(&report)?;
    let Some((summary, threshold)) = recording.summary().zip(recording.threshold()) else {
        played.ended?;
        return Err(advise("the noise cannot be estimated from one frame", "give --threshold"));
    };
    let is_name = |s: &Statement| s.source == StatementSource::File && SENSORS.contains(&&*s.what);
    let names: Vec<String> = recording.statements().into_iter().filter(is_name).map(|s| s.value).collect();
    let sensor = names.join(" ");
    let output = common.outputs.file(&args.output);
    match &args.by {
        Rows::Groups | Rows::Fields(_) => write_summary(output, &map, &recording.summaries()),
        Rows::Steps => write_summary_steps(output, &map, &recording.summaries(), &sensor),
    }
    .map_err(Error::from)?;
    over_time.map_or(Ok(()), LoadWriter::finish).map_err(Error::from)?;
    outputs::publish(common)?;
    played.end("added up", common)?;
    args.readings_args.remark(&recording, common);
    if summary.channel.newtons().is_none() {
        let unit = &summary.channel.unit;
        note!(common, "forces are left out: the unit {unit:?} is neither one of force nor one of pressure");
    }
    args.touch.remark(&recording, channel, common);
    let summaries = recording.summaries();
    let gaps: usize = summaries.iter().map(|(_, summary)| summary.gaps()).sum();
    note_count(common, gaps as u64, "gaps", "in the times, over which nothing is added up");
    for (episode, summary) in &summaries {
        summary
            .outside_steps()
            .iter()
            .for_each(|outside| note_outside(&map, *episode, summary, outside, common));
    }
    if args.json {
        let value = |cell: SummaryCell| match cell {
            SummaryCell::Text(text) => json!(text),
            SummaryCell::Number(number) => json!(number),
            SummaryCell::Count(count) => json!(count),
        };
        let object = |row: SummaryRow| -> Map<String, Value> {
            row.into_iter().map(|(name, cell)| (name.to_owned(), value(cell))).collect()
        };
        let (mut groups, mut steps, mut outside) = (Vec::new(), Vec::new(), Vec::new());
        let (mut contacts, mut cut_off) = (0, 0);
        for &(episode, summary) in &summaries {
            let of_episode = |mut object: Map<String, Value>| {
                object.extend(episode.map(|number| ("episode".to_owned(), json!(number))));
                object
            };
            groups.extend(summary_rows(&map, summary).into_iter().map(object).map(of_episode));
            steps.extend(summary_step_rows(&map, summary, &sensor).into_iter().map(object).map(of_episode));
            contacts += summary.totals().filter(|(group, _)| matches!(group, Group::Contact(_))).count();
            cut_off += summary.steps().map_or(0, |(_, cut_off)| cut_off);
            let beyond = summary.outside_steps();
            outside.extend(beyond.iter().map(|beyond| of_episode(outside_as_json(&map, summary, beyond))));
        }
        let mut json = json!({
            "frames": report.frames, "threshold": threshold, "contacts": contacts, "gaps": gaps,
            "at_once": recording.at_once(),
            "groups": groups,
        });
        if args.by == Rows::Steps {
            json["steps"] = json!(steps);
            json["cut_off"] = json!(cut_off);
            if !outside.is_empty() {
                json["outside"] = json!(outside);
            }
        }
        print_json("dermatome.summary/1", &json)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The word of a group, and its name.
fn named(map: &SkinMap, summary: &Summary, group: Group) -> (&'static str, String) {
    let word = if matches!(group, Group::Region(_)) { "region" } else { "patch" };
    (word, summary.names(map, group)[2].clone().into_owned())
}

/// Says what the steps of a group leave out of its sums.
fn note_outside(
    map: &SkinMap,
    episode: Option<u64>,
    summary: &Summary,
    outside: &OutsideSteps,
    common: &Common,
) {
    let (word, name) = named(map, summary, outside.group);
    let of_episode = episode.map_or_else(String::new, |number| format!("episode {number}, "));
    let mut amounts = Vec::new();
    amounts.extend(outside.impulse.map(|impulse| format!("{impulse:.4} N s")));
    amounts.extend(outside.contact_time.map(|time| format!("{time:.3} s of load")));
    let reasons = [
        (outside.cut_off, "cut off by the begin, the end or a gap of the recording"),
        (outside.weak, "below 5 % of the strongest"),
    ];
    let reasons = reasons.iter().filter(|(count, _)| *count > 0).map(|(count, how)| format!("{count} {how}"));
    note!(
        common,
        "{of_episode}{word} {}: {} are in no step; loadings that are none: {}",
        plain(&name),
        amounts.join(" and "),
        reasons.collect::<Vec<_>>().join(", ")
    );
}

fn outside_as_json(map: &SkinMap, summary: &Summary, outside: &OutsideSteps) -> Map<String, Value> {
    let (word, name) = named(map, summary, outside.group);
    let OutsideSteps { cut_off, weak, impulse, contact_time, .. } = outside;
    let pairs = [
        ("group", json!(word)),
        ("name", json!(name)),
        ("cut_off", json!(cut_off)),
        ("weak", json!(weak)),
        ("impulse", json!(impulse)),
        ("contact_time", json!(contact_time)),
    ];
    pairs.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
}
