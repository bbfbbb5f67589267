//! `dermatome render MAP.glb READINGS -o OUT`: a recording or a live stream as tactile images on every
//! level, arrays for learning and contact regions.

mod contacts;
mod events;
mod output;

use std::{path::Path, process::ExitCode, sync::Arc};

use clap::builder::Resettable;
use dermatome::Error;
use dermatome::atlas::{Atlas, AtlasOptions, AtlasPart, Pack, Resolution};
use dermatome::body::FieldLevel;
use dermatome::io::{Statement, share_plane};
use dermatome::map::SkinMap;
use dermatome::plot::colour_range;
use dermatome::pyramid::LevelId;
use dermatome::recording::{Carried, Recording, RecordingReport};
use dermatome::signal::Channel;
use serde_json::{Map, Value, json};

use crate::console::errors::advise;
use crate::console::notes::note;
use crate::console::print::{plain, print_json};
use crate::files::input::read_map_first;
use crate::files::outputs::{self, is_read_once, is_stream};
use crate::options::{
    Choice, Common, InPath, LevelArg, OutFolder, RegionsArgs, field_level, level, one_of, side_mm,
};
use crate::readings::{FramesArgs, Played, ReadingsArgs, remark_join};
use crate::render::contacts::ContactsArgs;
use crate::render::events::EventsArgs;
use crate::render::output::{Array, ColourArgs, Content, ImagesKind, Output, Pictures};

/// Draw readings as tactile images on every level: a recording, or a live stream.
///
/// The output is a folder with one file per frame and image (OpenEXR, or PNG with --pictures png), a
/// .npy with the frames of one image, a .npz with images and values of all levels, or `-`: raw f32
/// frames on standard output, image by image as they would be in a folder, flushed after each frame.
/// Missing readings are NaN, not zero.
#[derive(Debug, clap::Args)]
// `--unit` was the name of `--readings-unit`, and is the unit of lengths everywhere else.
#[command(mut_arg("units", |arg| arg.alias("unit")))]
#[command(mut_group("TouchArgs", |group| group.requires(Resettable::<clap::Id>::Reset).requires("found")))]
pub(crate) struct Args {
    /// The map, written by `dermatome build`
    #[arg(value_name = "MAP.glb")]
    map: InPath,
    /// The readings: text with a line of taxel ids, .csv (`time,ID,ID,...` or `time,taxel_id,value`),
    /// .npy or .npz, or a recording of Tekscan, XSENSOR, novel, Stappone, XELA or YARP; `-`: text or CSV on standard input
    #[arg(value_name = "READINGS")]
    readings: InPath,
    /// A folder, a .npy, a .npz, or `-` for raw frames on standard output
    #[arg(short, long, value_name = "OUT")]
    output: OutFolder,
    /// Print what was read and written as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    images: ImageArgs,
    #[command(flatten)]
    pixels: PixelArgs,
    #[command(flatten)]
    colours: ColourArgs,
    #[command(flatten)]
    readings_args: ReadingsArgs,
    #[command(flatten)]
    contacts: ContactsArgs,
    #[command(flatten)]
    events: EventsArgs,
    #[command(flatten)]
    regions: RegionsArgs,
    #[command(flatten)]
    frames: FramesArgs,
}

/// What is drawn.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Images")]
struct ImageArgs {
    /// Write the values of taxels and receptive fields into a .npz, and no images
    #[arg(long)]
    values_only: bool,
    /// Draw this level only [default: all]; body.L0 and arm.thermal.L0 are drawn at the taxels
    #[arg(long, value_name = "K|NAME.LK", value_parser = level)]
    level: Option<LevelArg>,
    /// Draw what each level shows beyond the next coarser one
    #[arg(long)]
    contrast: bool,
    /// Draw edges of the values: their gradient on the map, along u and v
    #[arg(long, conflicts_with = "contrast")]
    edges: bool,
    /// Write into EXR files also what pixels show: places, normals, ids, stretch
    #[arg(long = "static")]
    is_static: bool,
    /// Refuse images that need more memory than this
    #[arg(long, value_name = "MB", default_value_t = 4096, hide = true)]
    max_memory: u64,
    /// Refuse recordings that need more space on the disk than this
    #[arg(long, value_name = "MB", default_value_t = 4096, hide = true)]
    max_disk: u64,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let kind = args.check()?;
    let mut map = read_map_first(&args.map)?;
    args.regions.apply(&mut map, common)?;
    let map = Arc::new(map);
    let pack = if kind == ImagesKind::Folder(Pictures::Png) { Pack::Body } else { Pack::Tight };
    let options = args.pixels.atlas_options(pack);
    let atlas = match &args.pixels.atlas {
        Some(path) => Atlas::onto(&map, &read_canvas(&map, &args.map, path)?, &options),
        None => Atlas::new(&map, &options),
    };
    let atlas = atlas.map_err(Error::from)?;
    let (level, fields) = match &args.images.level {
        Some(LevelArg::Fields(name)) => (None, Some(field_level(name, Some(&map))?.0)),
        Some(LevelArg::Patches(level)) => (Some(*level), None),
        None => (None, None),
    };
    let atlas = if let Some(at) = fields { atlas.of_fields(&map, at) } else { atlas };
    let shown = Shown { atlas: &atlas, level, fields };
    let drawn = |part: &&AtlasPart| level.is_none_or(|level| part.level == level);
    let parts: Vec<&AtlasPart> = atlas.parts.iter().filter(drawn).collect();
    if let Some(part) = parts.first().filter(|_| args.pixels.pack.is_some() && !args.images.values_only) {
        let [width, height] = part.frame.size_px;
        let (fill, name) = (100.0 * part.fill(), &part.name);
        let count = part.charts.len();
        let charts = if count == 1 { "chart" } else { "charts" };
        note!(
            common,
            "{count} {charts} in one image: {fill:.0} % of the {width} x {height} pixels of {name} show skin"
        );
    }
    let mut recording = args.readings_args.open(args.frames.range()?, &args.readings, &map, common)?;
    let images = &args.images;
    carry(&mut recording, images, &shown)?;
    let channels = recording.level_channels().to_vec();
    if kind == ImagesKind::Array(Array::Npy) {
        check_one_image(&atlas, level)?;
    }
    if !images.values_only {
        check_memory(&atlas, channels.len(), level, images.max_memory)?;
        recording.draw(&atlas)?;
    }
    remark_join(&recording, &args.readings, common);
    let content = Content {
        map: &map,
        atlas: (!images.values_only).then_some(&atlas),
        channels: &channels,
        level,
        fields,
        has_static: images.is_static,
    };
    let ranges = match args.colours.range {
        Some(range) => vec![range; channels.len()],
        None if kind == ImagesKind::Folder(Pictures::Png) => {
            let ranges = ranges_of_images(args, &map, &shown, common)?;
            let number = |x: f64| {
                if x == 0.0 || x.abs() >= 1e-3 { format!("{x:.4}") } else { format!("{x:.1e}") }
            };
            for (channel, range) in channels.iter().zip(&ranges) {
                let [low, high] = range.map(number);
                let of =
                    if channels.len() > 1 { format!(" of {}", plain(&channel.name)) } else { String::new() };
                note!(
                    common,
                    "the colours{of} go from {low} to {high}, around the values; --range LOW,HIGH sets them"
                );
            }
            ranges
        }
        None => Vec::new(),
    };
    let mut output = Output::open(&args.output, kind, &ranges, &content, &common.outputs)?;
    let mut contacts = args.contacts.open(&map, &mut recording, &args.events, common)?;
    let mut events = args.events.open(&map, common)?;
    let has_episodes = recording.episodes() > 1;
    let space = Space::new(args, kind, &map, &shown, channels.len());
    space.check(recording.frames().unwrap_or(0))?;
    space.announce(recording.frames().unwrap_or(0), args, common);
    let played = Played::each(&mut recording, &args.readings, common, |recording, written| {
        let Some(step) = recording.next_step()? else { return Ok(false) };
        space.check(written + 1)?;
        if has_episodes {
            output.begin_episode(step.episode)?;
            contacts.iter_mut().for_each(|contacts| contacts.begin_episode(step.episode));
            events.iter_mut().try_for_each(|events| events.begin_episode(step.episode))?;
        }
        output.write(&step, &channels)?;
        contacts.iter_mut().try_for_each(|contacts| contacts.write(&step))?;
        events.iter_mut().try_for_each(|events| events.write(&step))?;
        Ok(true)
    })?;
    let (report, threshold) = (recording.report(), recording.threshold());
    args.frames.check_any(&report)?;
    output.finish(common)?;
    let found = contacts.map(|contacts| contacts.finish()).transpose().map_err(Error::from)?;
    let event_count = events.map(|events| events.finish(common)).transpose()?;
    if matches!(kind, ImagesKind::Folder(_)) {
        outputs::wrote(&[(&args.output).into()], common);
    }
    outputs::publish(common)?;
    played.end("written", common)?;
    args.readings_args.remark(&recording, common);
    let found = found.map(|count| (count, threshold));
    if let Some((count, Some(threshold))) = found {
        let contacts = if count == 1 { "contact" } else { "contacts" };
        let digits = if threshold < 1e-3 { format!("{threshold:.1e}") } else { format!("{threshold:.4}") };
        note!(common, "{count} {contacts} above {digits}");
    }
    if found.is_some() {
        args.contacts.remark(&recording, common)?;
    }
    if args.json {
        let mut json = json_report(&report, &channels, &parts, found);
        if let Some(at_once) = recording.at_once() {
            json["at_once"] = json!(at_once);
        }
        if let Some(events) = event_count {
            json["events"] = json!(events);
        }
        let statement = |Statement { what, value, source }: Statement| json!({ "what": what, "value": value, "source": <&str>::from(source) });
        json["statements"] = recording.statements().into_iter().map(statement).collect();
        print_json("dermatome.render/1", &json)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Which images are drawn.
struct Shown<'a> {
    atlas: &'a Atlas,
    /// This level of the patches alone.
    level: Option<LevelId>,
    /// This level without a mesh alone.
    fields: Option<FieldLevel>,
}

/// Carries frames to the levels that are drawn.
fn carry(recording: &mut Recording, images: &ImageArgs, shown: &Shown<'_>) -> anyhow::Result<()> {
    if let Some(at) = shown.fields {
        recording.carry_fields(at).map_err(Error::from)?;
    } else {
        recording.carry(images.carried(), shown.level);
    }
    Ok(())
}

/// The colour scale of each channel around the values of all images of a recording, which is read once more.
fn ranges_of_images(
    args: &Args,
    map: &Arc<SkinMap>,
    shown: &Shown<'_>,
    common: &Common,
) -> anyhow::Result<Vec<[f64; 2]>> {
    let common = Common { quiet: true, ..common.clone() };
    let mut recording = args.readings_args.open(args.frames.range()?, &args.readings, map, &common)?;
    carry(&mut recording, &args.images, shown)?;
    recording.draw(shown.atlas)?;
    let mut extremes = vec![[f64::INFINITY, f64::NEG_INFINITY]; recording.level_channels().len()];
    while let Some(step) = recording.next_step()? {
        for image in step.images {
            let of_channels = image.values.chunks_exact(image.coverage.len().max(1));
            for ([low, high], values) in extremes.iter_mut().zip(of_channels) {
                for value in values.iter().filter(|value| value.is_finite()).map(|value| f64::from(*value)) {
                    (*low, *high) = (low.min(value), high.max(value));
                }
            }
        }
    }
    Ok(extremes.into_iter().map(|extremes| colour_range(extremes, 1.0)).collect())
}

impl Args {
    /// Refuses, before any work, options that contradict each other and files that cannot be written;
    /// returns the kind of the output.
    fn check(&self) -> anyhow::Result<ImagesKind> {
        let kind = ImagesKind::of(&self.output, self.colours.pictures)?;
        if self.images.is_static && kind != ImagesKind::Folder(Pictures::Exr) {
            return Err(advise(
                "--static adds channels to OpenEXR files, and none is written",
                "name a folder as output, without --pictures png; a .npz has mask and taxel_id anyway",
            ));
        }
        self.colours.check(kind, is_read_once(&self.readings))?;
        self.events.check()?;
        self.frames.range()?;
        if self.images.carried() != Carried::Values && matches!(self.images.level, Some(LevelArg::Fields(_)))
        {
            return Err(advise(
                "levels of the whole body and of modalities have no map of their own: no contrast and no edges",
                "leave --contrast and --edges out, or name a level of the patches",
            ));
        }
        if self.images.values_only && kind != ImagesKind::Array(Array::Npz) {
            return Err(advise("--values-only makes a .npz", "name a file that ends in .npz"));
        }
        Ok(kind)
    }
}

impl ImageArgs {
    fn carried(&self) -> Carried {
        match (self.contrast, self.edges) {
            (true, _) => Carried::Contrast,
            (_, true) => Carried::Edges,
            _ => Carried::Values,
        }
    }
}

/// What `--json` prints; `found` is the number of contacts and their threshold.
fn json_report(
    read: &RecordingReport,
    channels: &[Channel],
    images: &[&AtlasPart],
    found: Option<(usize, Option<f64>)>,
) -> Value {
    let of_images = |value: &dyn Fn(&AtlasPart) -> Value| -> Map<String, Value> {
        images.iter().map(|image| (image.name.clone(), value(image))).collect()
    };
    let mut report = json!({
        "frames": read.frames,
        "channels": channels.iter().map(|c| json!({ "name": c.name, "unit": c.unit })).collect::<Vec<_>>(),
        "size": of_images(&|image| json!([image.frame.size_px[1], image.frame.size_px[0]])),
        "fill": of_images(&|image| json!(image.fill())),
        "matched": read.join.matched,
        "unknown": read.join.unknown,
        "masked": read.join.masked,
        "missing": read.missing,
        "clipped": read.condition.clipped,
        "backwards": if read.has_times { read.condition.backwards } else { 0 },
    });
    if let Some((contacts, threshold)) = found {
        report["contacts"] = json!(contacts);
        report["threshold"] = json!(threshold);
    }
    report
}

/// A `.npy` holds one array.
fn check_one_image(atlas: &Atlas, level: Option<LevelId>) -> anyhow::Result<()> {
    match atlas.parts.iter().filter(|part| level.is_none_or(|level| part.level == level)).count() {
        1 => Ok(()),
        found => Err(advise(
            format!("a .npy holds one image per frame, and here are {found}"),
            "choose a level with --level, draw several patches into one image with --pack, or write a .npz",
        )),
    }
}

/// Bytes that a pixel takes besides its values: coverage, spans and weights.
const BYTES_PER_PIXEL: u64 = 48;

/// Outputs of more megabytes are announced before they are written.
const LARGE_MB: u64 = 100;

/// The space that frames of a file take on the disk: a few bytes of an array or a table can ask for
/// many images.
struct Space {
    bytes_per_frame: u64,
    max_mb: u64,
}

impl Space {
    fn new(args: &Args, kind: ImagesKind, map: &SkinMap, shown: &Shown<'_>, channels: usize) -> Self {
        let is_drawn = |k: LevelId| shown.level.is_none_or(|level| k == level);
        let parts = shown.atlas.parts.iter().filter(|part| is_drawn(part.level) && !args.images.values_only);
        let pixels: u64 = parts.map(|part| part.frame.size_px.map(u64::from).iter().product::<u64>()).sum();
        let levels = map.patches.iter().flat_map(|patch| patch.levels.enumerate());
        let values = levels.filter(|(k, _)| is_drawn(*k) && matches!(kind, ImagesKind::Array(_)));
        let values: u64 = values.map(|(_, level)| level.level.mesh.positions.len() as u64).sum();
        // The frames of a stream come in their own time, and a pipe takes no space.
        let is_bounded = kind != ImagesKind::Pipe && !is_stream(&args.readings);
        let bytes_per_frame = if is_bounded { 4 * channels as u64 * (pixels + values) } else { 0 };
        Self { bytes_per_frame, max_mb: args.images.max_disk }
    }

    /// Notes what will be written if that is large, and what makes it smaller.
    fn announce(&self, frames: u64, args: &Args, common: &Common) {
        let mb = self.bytes_per_frame.saturating_mul(frames) / 1_000_000;
        if mb < LARGE_MB {
            return;
        }
        let smaller = match args.images.values_only {
            true => "--level K writes one level, --every N fewer frames",
            false => "--values-only writes numbers alone, --level K one level, --size H W smaller images",
        };
        let packed =
            if outputs::kind(&args.output) == "npz" { ", less where they can be compressed" } else { "" };
        note!(common, "{frames} frames are up to {mb} MB{packed}; {smaller}");
    }

    fn check(&self, frames: u64) -> anyhow::Result<()> {
        let needed = self.bytes_per_frame.saturating_mul(frames).div_ceil(1_000_000);
        if needed <= self.max_mb {
            return Ok(());
        }
        let max_mb = self.max_mb;
        Err(advise(
            format!("{frames} frames need up to {needed} MB on the disk; at most {max_mb} MB are allowed"),
            "write fewer frames (--every, --to), one level (--level), larger pixels (--pixel-mm) or numbers alone \
             (--values-only), or allow more (--max-disk)",
        ))
    }
}

/// Refuses images that would need too much memory, before any of it is taken.
fn check_memory(atlas: &Atlas, channels: usize, level: Option<LevelId>, max_mb: u64) -> anyhow::Result<()> {
    let parts = atlas.parts.iter().filter(|part| level.is_none_or(|level| part.level == level));
    let pixels: u64 = parts.map(|part| part.frame.size_px.map(u64::from).iter().product::<u64>()).sum();
    let needed = pixels.saturating_mul(BYTES_PER_PIXEL + 8 * channels as u64).div_ceil(1_000_000);
    if needed <= max_mb {
        return Ok(());
    }
    Err(advise(
        format!("images of {pixels} pixels need {needed} MB; at most {max_mb} MB are allowed"),
        "draw larger pixels (--pixel-mm), one level (--level) or a smaller canvas (--size), or allow more (--max-memory)",
    ))
}

/// Which pixels images have.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Images")]
pub(crate) struct PixelArgs {
    /// Side of a pixel [default: that of the map]
    #[arg(long = "pixel-mm", value_name = "MM", value_parser = side_mm, conflicts_with = "size")]
    pixel: Option<f64>,
    /// Height and width of every image, in pixels; the map is drawn as large as fits
    #[arg(long, num_args = 2, value_names = ["H", "W"])]
    size: Option<Vec<u32>>,
    /// Draw all patches of a level into one image [a word may be left out: tight, for PNG pictures body]
    #[arg(long, value_name = "HOW", num_args = 0..=1, value_parser = one_of(&PACKINGS))]
    pack: Option<Option<Pack>>,
    /// Draw on the canvas of this map, with its names and pixels: the one that MAP.glb is drawn on (`build --atlas`), or
    /// another one on the same
    #[arg(long, value_name = "MAP")]
    atlas: Option<InPath>,
}

/// Reads a map that shares its plane with another one.
pub(crate) fn read_canvas(map: &SkinMap, path: &Path, of_canvas: &Path) -> anyhow::Result<SkinMap> {
    let canvas = read_map_first(of_canvas)?;
    if share_plane(map, &canvas).map_err(Error::from)? {
        return Ok(canvas);
    }
    let drawn = |map: &SkinMap| map.atlas.as_ref().map_or("itself".to_owned(), |on| format!("{:?}", on.name));
    let what = format!(
        "{} is drawn on {}, and {} on {}",
        path.display(),
        drawn(map),
        of_canvas.display(),
        drawn(&canvas)
    );
    Err(advise(what, "draw one on the other with build --atlas, or both on one map"))
}

const PACKINGS: [Choice<Pack>; 2] = [
    ("tight", Pack::Tight, "As large as they fit, in any direction: for networks"),
    (
        "body",
        Pack::Body,
        "Distal ends up, distal links above proximal ones, neighbours near each other: for people",
    ),
];

impl PixelArgs {
    /// `pack` is how patches are packed where no word says it.
    pub(crate) fn atlas_options(&self, pack: Pack) -> AtlasOptions {
        let resolution = match (&self.size, self.pixel) {
            (Some(size), _) => Resolution::Canvas([size[0], size[1]]),
            (None, Some(side)) => Resolution::Pixel(side),
            (None, None) => Resolution::Map,
        };
        AtlasOptions { resolution, pack: self.pack.map(|word| word.unwrap_or(pack)) }
    }
}
