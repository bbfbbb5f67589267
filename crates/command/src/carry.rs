//! `dermatome carry A/map.glb READINGS --to B/map.glb -o OUT`: readings of one skin on the taxels of another.

use std::process::ExitCode;
use std::sync::Arc;

use dermatome::Error;
use dermatome::io::{ReadingsColumns, ReadingsWriter};
use dermatome::recording::FrameRange;
use dermatome::signal::{Carry, Frame};
use dermatome::skin::Presence;
use serde_json::json;

use crate::console::errors::advise;
use crate::console::notes::{note, note_count};
use crate::console::print::print_json;
use crate::files::input::read_map_first;
use crate::files::outputs;
use crate::options::{Common, InPath, OutFile};
use crate::readings::{Played, ReadingsArgs, remark_join};
use crate::render::read_canvas;

/// Carry readings from the taxels of one skin to those of another on the same atlas.
///
/// One map is drawn on the other, or both on a third (`build --atlas`). Forces and other amounts keep their sum;
/// pressures are means by area. What lies off the other skin is left out and counted.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The map of the skin that was touched
    #[arg(value_name = "MAP.glb")]
    map: InPath,
    /// Its readings: any that `render` reads; `-`: text or CSV on standard input
    #[arg(value_name = "READINGS")]
    readings: InPath,
    /// The map of the other skin
    #[arg(long, value_name = "MAP")]
    to: InPath,
    /// The readings of the other skin: .csv or .npz, as `render` reads them
    #[arg(short, long, value_name = "OUT")]
    output: OutFile,
    /// Print what was carried as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    readings_args: ReadingsArgs,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let map = Arc::new(read_map_first(&args.map)?);
    let to = read_canvas(&map, &args.map, &args.to)?;
    let carry = Carry::new(&map, &to).map_err(Error::from)?;
    let (outside, taxels) =
        (carry.outside().len(), map.patches.iter().map(|p| p.taxels.ids.len()).sum::<usize>());
    if outside == taxels {
        let what = format!("no taxel of {} lies on {}", args.map.display(), args.to.display());
        return Err(advise(what, "draw them on the same patches of one atlas with build --atlas"));
    }
    let mut recording = args.readings_args.open(FrameRange::default(), &args.readings, &map, common)?;
    if recording.episodes() > 1 {
        let what = format!("{} has {} episodes", args.readings.display(), recording.episodes());
        return Err(advise(what, "carry one at a time: --episode N"));
    }
    let channels = recording.channels().to_vec();
    remark_join(&recording, &args.readings, common);
    let others = map.patches.iter().flat_map(|patch| patch.taxels.presence.iter());
    let others =
        others.filter(|presence| **presence != Presence::Absent && !presence.reads_pressure()).count();
    note_count(common, others as u64, "taxels", "of another modality than pressure, which are not carried");
    let output = common.outputs.file(&args.output);
    let patches = to.patches.iter().map(|patch| &patch.taxels);
    let columns = ReadingsColumns { channels: &channels, has_times: recording.report().has_times };
    let mut writer = ReadingsWriter::create(output, patches, columns).map_err(Error::from)?;
    // A threshold is of the taxels of the skin that was touched.
    writer.state_rest(&recording.known_rest()).map_err(Error::from)?;
    let mut carried = Frame::new(&to, channels.len());
    let (mut lost, mut all) = (0.0, 0.0);
    let played = Played::each(&mut recording, &args.readings, common, |recording, _| {
        let Some(step) = recording.next_step()? else { return Ok(false) };
        carried.time = step.frame.time;
        carry.carry_frame(step.frame, &channels, &mut carried);
        writer.write(&carried).map_err(Error::from)?;
        // In terms of amounts: what is averaged counts by area.
        let amount = |patch, taxel| {
            let value: f64 = step.frame.values[patch][0][taxel];
            let weight = channels[0].quantity.weight(map.patches[patch].taxels.areas[taxel]);
            if value.is_finite() { weight * value.abs() } else { 0.0 }
        };
        lost += carry.outside().iter().map(|&(patch, taxel)| amount(patch, taxel)).sum::<f64>();
        for (patch, of) in map.patches.enumerate() {
            all += of.taxels.ids.ids().map(|taxel| amount(patch, taxel)).sum::<f64>();
        }
        Ok(true)
    })?;
    let report = recording.report();
    if report.frames == 0 {
        return Err(advise(
            format!("{} has no frame", args.readings.display()),
            "give readings with at least one",
        ));
    }
    writer.finish().map_err(Error::from)?;
    outputs::publish(common)?;
    played.end("carried", common)?;
    args.readings_args.remark(&recording, common);
    let share = if all > 0.0 { lost / all } else { 0.0 };
    if outside > 0 {
        let percent = 100.0 * share;
        note!(
            common,
            "{outside} of {taxels} taxels lie off the other skin: {percent:.2} % of channel {} is left out",
            channels[0].name
        );
    }
    if carry.unreached() > 0 {
        let unreached = carry.unreached();
        note!(
            common,
            "{unreached} taxels of the other skin have no reading: no taxel of this one lies there"
        );
    }
    if args.json {
        let report = json!({
            "frames": report.frames, "channels": channels.iter().map(|c| &c.name).collect::<Vec<_>>(),
            "taxels": taxels, "outside": outside, "left_out": share, "unreached": carry.unreached(),
        });
        print_json("dermatome.carry/1", &report)?;
    }
    Ok(ExitCode::SUCCESS)
}
