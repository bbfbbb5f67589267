//! `dermatome report MAP.glb [READINGS] -o report.html`: the skin, its map and a recording as one page.

use std::path::Path;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::Context;
use clap::builder::Resettable;
use dermatome::Error;
use dermatome::io::{IoError, read_map};
use dermatome::map::SkinMap;
use dermatome::page::{LiveServer, Page};
use dermatome::recording::Recording;

use crate::console::notes::note;
use crate::console::print::{plain, print};
use crate::console::progress;
use crate::files::input::read_map_first;
use crate::files::outputs::{self, is_stream, write_bytes};
use crate::options::{Common, InPath, OutFile, RegionsArgs};
use crate::readings::{FramesArgs, Played, ReadingsArgs, TouchArgs, remark_join};

/// Write a page that shows the skin, its map and a recording in a browser, without a network.
///
/// The skin unfolds into its map; what the pointer touches lights on both. A recording plays, with its
/// contacts and, on the time line, the events that `render --events` writes. With --atlas the page shows two skins, and
/// clicks on both make the landmarks of `build --atlas`.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("played").args(["readings", "live"]).multiple(true))]
#[command(mut_group("ReadingsArgs", |group| group.requires(Resettable::<clap::Id>::Reset).requires("played")))]
#[command(mut_group("TouchArgs", |group| group.requires(Resettable::<clap::Id>::Reset).requires("played")))]
pub(crate) struct Args {
    /// The map, written by `dermatome build`
    #[arg(value_name = "MAP.glb")]
    map: InPath,
    /// Readings to play: text with a line of taxel ids, .csv, .npy or .npz; `-`: text or CSV on standard
    /// input
    #[arg(value_name = "READINGS")]
    readings: Option<InPath>,
    /// Show readings while they come: the page is served to this machine alone, at an address that is
    /// printed, until they end [default readings: standard input]
    #[arg(long, conflicts_with = "output")]
    live: bool,
    /// Show the map of another skin, too, and take landmarks: places that are the same on both (docs/atlas.md)
    #[arg(long, value_name = "MAP", conflicts_with = "live")]
    atlas: Option<InPath>,
    /// Output file: .html; `-`: standard output [default: report.html next to the map]
    #[arg(short, long, value_name = "OUT.html")]
    output: Option<OutFile>,
    /// The channel that is shown [default: the first that measures touches]
    #[arg(long, value_name = "NAME", requires = "played")]
    channel: Option<String>,
    /// Title of the page [default: the name of the map's folder or file]
    #[arg(long, value_name = "TEXT")]
    title: Option<String>,
    #[command(flatten)]
    regions: RegionsArgs,
    #[command(flatten)]
    readings_args: ReadingsArgs,
    #[command(flatten)]
    touch: TouchArgs,
    #[command(flatten)]
    frames: FramesArgs,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let beside = || args.map.with_file_name("report.html");
    let output = &args.output.as_ref().map_or_else(beside, PathBuf::from);
    if !is_stream(output) && outputs::kind(output) != "html" {
        return Err(Error::from(IoError::UnknownKind { path: output.clone(), known: ".html" }).into());
    }
    outputs::guard(std::slice::from_ref(output), &common.outputs)?;
    args.frames.range()?;
    let mut map = read_map_first(&args.map)?;
    args.regions.apply(&mut map, common)?;
    let map = Arc::new(map);
    let title = args.title.clone().unwrap_or_else(|| title_of(&args.map));
    let atlas =
        args.atlas.as_ref().map(|path| read_map(path).map(|map| (map, title_of(path)))).transpose()?;
    let mut page = Page::new(&map, title)?;
    if let Some((atlas, name)) = &atlas {
        page.onto(atlas, name)?;
    }
    if args.live {
        return serve(args, &map, page, common);
    }
    let recorded = match &args.readings {
        Some(readings) => record(args, readings, &map, &mut page, common)?,
        None => Ok(()),
    };
    let html = page.to_html()?;
    if is_stream(output) {
        print(&html)?;
        return recorded.map(|()| ExitCode::SUCCESS);
    }
    write_bytes(&common.outputs.file(output), html.as_bytes()).map_err(Error::from)?;
    outputs::publish(common)?;
    recorded.map(|()| ExitCode::SUCCESS)
}

/// Shows readings while they come.
fn serve(args: &Args, map: &Arc<SkinMap>, page: Page<'_>, common: &Common) -> anyhow::Result<ExitCode> {
    let path = args.readings.as_deref().unwrap_or(Path::new("-"));
    let mut recording = args.readings_args.open(args.frames.range()?, path, map, common)?;
    ReadingsArgs::check_one_episode(&recording, path)?;
    let shown = recording.channel(args.channel.as_deref()).map_err(Error::from)?;
    let options = args.touch.options(&recording, shown);
    let (html, mut frames) = page.to_live_html(&mut recording, &options)?;
    let server = LiveServer::start(html).context("cannot serve the page to this machine")?;
    print(&format!("{}\n", server.address()))?;
    remark_join(&recording, path, common);
    remark_shown(args, &recording, shown, common);
    let ended = loop {
        match recording.next_step() {
            Ok(Some(step)) => server.show(frames.next(&step).map_err(Error::from)?),
            ended => break ended.map(|_| ()),
        }
    };
    server.end(frames.finish());
    ended?;
    args.readings_args.remark(&recording, common);
    args.touch.remark(&recording, shown, common);
    Ok(ExitCode::SUCCESS)
}

/// Plays readings into a page; the inner error is that of a stream that ended badly after some frames, which
/// are kept: they will not come again.
fn record(
    args: &Args,
    path: &Path,
    map: &Arc<SkinMap>,
    page: &mut Page<'_>,
    common: &Common,
) -> anyhow::Result<anyhow::Result<()>> {
    let mut recording = args.readings_args.open(args.frames.range()?, path, map, common)?;
    ReadingsArgs::check_one_episode(&recording, path)?;
    let shown = recording.channel(args.channel.as_deref()).map_err(Error::from)?;
    remark_join(&recording, path, common);
    let bar = progress::frames(common, recording.frames(), is_stream(path));
    let options = args.touch.options(&recording, shown);
    let ended = page.play(&mut recording, &options, || bar.inc(1)).map_err(anyhow::Error::from);
    bar.finish_and_clear();
    let ended = Played::new(path, page.frames() as u64, ended)?.end("kept", common);
    if ended.is_err() {
        return Ok(ended);
    }
    args.frames.check_any(&recording.report())?;
    args.readings_args.remark(&recording, common);
    args.touch.remark(&recording, shown, common);
    remark_shown(args, &recording, shown, common);
    Ok(Ok(()))
}

/// Says which of several channels the page shows, unless one was named.
fn remark_shown(args: &Args, recording: &Recording, shown: usize, common: &Common) {
    let channels = recording.channels();
    if channels.len() > 1 && args.channel.is_none() {
        let count = channels.len();
        note!(
            common,
            "of {count} channels the page shows {}; --channel names another",
            plain(&channels[shown].name)
        );
    }
}

/// `forearm` for `forearm.map/map.glb` and for `forearm.glb`.
pub(crate) fn title_of(map: &Path) -> String {
    let stem = map.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let folder = map.parent().and_then(Path::file_stem);
    match folder {
        Some(folder) if stem == "map" => folder.to_string_lossy().into_owned(),
        _ => stem,
    }
}
