//! `dermatome render MAP.glb READINGS -o OUT`: a recording or a live stream as tactile images on every
//! level, arrays for learning and contact regions.

mod contacts;
mod output;
mod pixels;
mod readings_args;
mod rows;
mod source;

use std::{f64::consts::PI, path::PathBuf, process::ExitCode};

use dermatome::{
    Error,
    atlas::Atlas,
    image::{RenderOptions, Renderer},
    io::read_map,
    map::SkinMap,
    plot::ValueRange,
    pyramid::LevelId,
    signal::{Channel, Contrast, Edges, Frame, LevelFrame, Quantity, Restrictor},
};
use serde_json::json;

use crate::{
    common::Common,
    errors::advise,
    notes::note,
    outputs::{self, is_stream},
    print::print_json,
    progress,
    render::{
        contacts::ContactsArgs,
        output::{Array, Colours, Kind, Output, Pictures},
    },
};

pub(crate) use pixels::PixelArgs;
pub(crate) use readings_args::{FramesArgs, ReadingsArgs, range};
pub(crate) use source::Readings;

/// Draw readings as tactile images on every level: a recording, or a live stream.
///
/// The output is a folder with one file per frame and image (OpenEXR, or PNG with --pictures png), a
/// .npy with the frames of one image, a .npz with images and values of all levels, or `-`: raw f32
/// frames on standard output, image by image as they would be in a folder, flushed after each frame.
/// Missing readings are NaN, not zero.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The map, written by `dermatome build`
    #[arg(value_name = "MAP.glb")]
    map: PathBuf,
    /// The readings: text with a line of taxel ids, .csv, .npy or .npz; `-`: text or CSV on standard
    /// input
    #[arg(value_name = "READINGS")]
    readings: PathBuf,
    /// A folder, a .npy, a .npz, or `-` for raw frames on standard output
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
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
    frames: FramesArgs,
}

/// What is drawn.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Images")]
struct ImageArgs {
    /// Write the values of taxels and receptive fields into a .npz, and no images
    #[arg(long)]
    values_only: bool,
    /// Draw this level only [default: all]
    #[arg(long, value_name = "K")]
    level: Option<u32>,
    /// Draw what each level shows beyond the next coarser one
    #[arg(long)]
    contrast: bool,
    /// Draw the edges of the values: the size of their gradient on the map and its direction, an angle
    /// from the u axis towards the v axis
    #[arg(long, conflicts_with = "contrast")]
    edges: bool,
    /// Write into every EXR file also what its pixels show: places, normals, ids and stretch
    #[arg(long = "static")]
    is_static: bool,
    /// Refuse images that need more memory than this
    #[arg(long, value_name = "MB", default_value_t = 4096)]
    max_memory: u64,
}

/// How values become colours.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Pictures")]
struct ColourArgs {
    /// What a folder holds
    #[arg(long, value_enum, default_value_t = Pictures::Exr)]
    pictures: Pictures,
    /// Values at the ends of the colour scale [default: the percentiles of the recording]
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true)]
    range: Option<[f64; 2]>,
    /// Percentiles of the recording at the ends of the colour scale
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, default_value = "1,100")]
    percentiles: [f64; 2],
    /// Pixels of a picture for each pixel of an image
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=64))]
    zoom: u32,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let kind = Kind::of(&args.output, args.colours.pictures)?;
    if args.images.is_static && kind != Kind::Folder(Pictures::Exr) {
        return Err(advise(
            "--static adds channels to OpenEXR files, and none is written",
            "name a folder as output, without --pictures png; a .npz has mask and taxel_id anyway",
        ));
    }
    if args.json && is_stream(&args.output) {
        return Err(advise("--json and -o - would both use standard output", "write the frames to a file"));
    }
    let inputs = [args.map.as_path(), args.readings.as_path()];
    if matches!(kind, Kind::Array(_)) {
        outputs::check_inputs([args.output.as_path()], inputs)?;
    }
    args.contacts.check(inputs)?;
    args.frames.check()?;
    if args.images.values_only && kind != Kind::Array(Array::Npz) {
        return Err(advise("--values-only makes a .npz", "name a file that ends in .npz"));
    }
    let map = read_map(&args.map).map_err(Error::from)?;
    let atlas = Atlas::new(&map, &args.pixels.atlas_options()).map_err(Error::from)?;
    let readings = Readings::new(&args.readings_args, args.frames, &args.readings, &map);
    let pass = readings.open()?;
    let read = pass.channels().to_vec();
    let shown = match (args.images.contrast, args.images.edges) {
        (true, _) => Shown::Contrast,
        (_, true) => Shown::Edges,
        _ => Shown::Readings,
    };
    let channels = shown_channels(&read, shown);
    let level = args.images.level.map(LevelId::from);
    if kind == Kind::Array(Array::Npy) {
        check_one_image(&atlas, level)?;
    }
    check_memory(&atlas, channels.len(), level, args.images.max_memory)?;
    let from =
        if is_stream(&args.readings) { "standard input".into() } else { args.readings.display().to_string() };
    pass.remark(&from, common);
    let options = RenderOptions { interpolation: args.pixels.interpolation(), level };
    let mut renderer = Renderer::new(&map, &atlas, &channels, &options).map_err(Error::from)?;
    let colours = match kind {
        Kind::Folder(Pictures::Png) => Some(colours(args, &readings, &map, &read, shown)?),
        _ => None,
    };
    let mut values = Values::new(&map, &read, shown);
    let mut contacts = args.contacts.open(&map, &read, &args.readings_args)?;
    let mut output = Output::open(
        &args.output,
        kind,
        &map,
        &atlas,
        (&channels, &options),
        (colours, args.images.is_static, !args.images.values_only),
    )?;
    let bar = progress::frames(common, pass.frames(), is_stream(&args.readings));
    let tally = pass.run(|number, frame| {
        let levels = values.of(frame);
        let images = if args.images.values_only { &[] } else { renderer.render(levels) };
        output.write(number, levels, images, &channels)?;
        if let Some(contacts) = &mut contacts {
            contacts.track(number, frame)?;
        }
        bar.inc(1);
        Ok(true)
    })?;
    bar.finish_and_clear();
    args.frames.check_any(tally.read, tally.frames)?;
    output.finish()?;
    outputs::wrote([args.output.as_path()], common);
    let found = contacts.map(contacts::Contacts::finish).transpose()?;
    tally.remark(args.readings_args.baseline, common);
    if let Some((count, Some(threshold))) = found {
        note(common, format_args!("{count} contacts above {threshold:.4}"));
    }
    if args.json {
        let size: serde_json::Map<_, _> = renderer
            .images()
            .iter()
            .map(|image| (image.name.clone(), json!([image.size_px[1], image.size_px[0]])))
            .collect();
        let mut report = json!({
            "frames": tally.frames,
            "channels": channels.iter().map(|c| json!({ "name": c.name, "unit": c.unit })).collect::<Vec<_>>(),
            "size": size,
            "matched": tally.join.matched,
            "unknown": tally.join.unknown,
            "masked": tally.join.masked,
            "missing": tally.missing,
            "clipped": tally.condition.clipped,
            "backwards": if tally.has_times { tally.condition.backwards } else { 0 },
            "dropped": tally.dropped,
        });
        if let Some((contacts, threshold)) = found {
            report["contacts"] = json!(contacts);
            report["threshold"] = json!(threshold);
        }
        print_json("dermatome.render/1", &report)?;
    }
    Ok(ExitCode::SUCCESS)
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

/// What is drawn of the readings.
#[derive(Debug, Clone, Copy)]
enum Shown {
    Readings,
    Contrast,
    Edges,
}

/// Values on all levels: the readings, their contrast or their edges.
struct Values<'a> {
    restrictor: Restrictor<'a>,
    derived: Derived<'a>,
}

/// What is computed of the readings on all levels.
enum Derived<'a> {
    Readings,
    Contrast(Contrast<'a>),
    Edges(Edges<'a>),
}

impl<'a> Values<'a> {
    fn new(map: &'a SkinMap, channels: &[Channel], shown: Shown) -> Self {
        let derived = match shown {
            Shown::Readings => Derived::Readings,
            Shown::Contrast => Derived::Contrast(Contrast::new(map, channels)),
            Shown::Edges => Derived::Edges(Edges::new(map, channels)),
        };
        Self { restrictor: Restrictor::new(map, channels), derived }
    }

    fn of(&mut self, frame: &Frame) -> &LevelFrame {
        let levels = self.restrictor.restrict(frame);
        match &mut self.derived {
            Derived::Readings => levels,
            Derived::Contrast(contrast) => contrast.of(levels),
            Derived::Edges(edges) => edges.of(levels),
        }
    }
}

/// The channels of what is drawn: edges have two for each channel, their size and direction.
fn shown_channels(channels: &[Channel], shown: Shown) -> Vec<Channel> {
    let Shown::Edges = shown else { return channels.to_vec() };
    let of_edges = |channel: &Channel| {
        let part = |part: &str, unit: String, quantity: Quantity| Channel {
            name: format!("{}.{part}", channel.name),
            unit,
            quantity,
        };
        let unit = channel.pixel_unit();
        let size = if unit.is_empty() { unit } else { format!("{unit}/m") };
        [part("edge", size, Quantity::Intensive), part("direction", "rad".into(), Quantity::Direction)]
    };
    channels.iter().flat_map(of_edges).collect()
}

/// The colour scale of each channel: what the user says, or percentiles of the whole recording.
fn colours(
    args: &Args,
    readings: &Readings<'_>,
    map: &SkinMap,
    read: &[Channel],
    shown: Shown,
) -> anyhow::Result<Colours> {
    let channels = shown_channels(read, shown);
    let magnification = args.colours.zoom;
    if let Some(range) = args.colours.range {
        return Ok(Colours { ranges: vec![range; channels.len()], magnification });
    }
    let is_file = |path: &PathBuf| std::fs::metadata(path).is_ok_and(|about| about.is_file());
    if is_stream(&args.readings) || !is_file(&args.readings) {
        return Err(advise(
            "the colours of a stream cannot follow from percentiles of what is not there yet",
            "give the values at the ends of the scale with --range LOW,HIGH",
        ));
    }
    let mut ranges = vec![ValueRange::default(); channels.len()];
    let mut values = Values::new(map, read, shown);
    readings.open()?.run(|_, frame| {
        let levels = values.of(frame);
        for (patch, of_patch) in map.patches.iter().zip(&levels.values) {
            for ((range, channel), of_channel) in ranges.iter_mut().zip(&channels).zip(of_patch) {
                for (level, x) in patch.levels.iter().zip(of_channel) {
                    match channel.quantity {
                        Quantity::Intensive | Quantity::Direction => range.add(x.iter().copied()),
                        // Amounts are drawn per area.
                        Quantity::Extensive => {
                            range.add(x.iter().zip(&level.level.areas).map(|(x, a)| x / a))
                        }
                    }
                }
            }
        }
        Ok(true)
    })?;
    let [low, high] = args.colours.percentiles;
    let ends = |(range, channel): (&ValueRange, &Channel)| match shown {
        _ if channel.quantity == Quantity::Direction => [-PI, PI],
        // Contrast has two signs, and most of it is zero.
        Shown::Contrast => {
            let [low, high] = range.percentiles(low.min(100.0 - high), high).unwrap_or([-1.0, 1.0]);
            let most = high.max(-low);
            [-most, most]
        }
        Shown::Readings | Shown::Edges => balanced(range.percentiles(low, high).unwrap_or([0.0, 1.0])),
    };
    Ok(Colours { ranges: ranges.iter().zip(&channels).map(ends).collect(), magnification })
}

/// Ends of a scale that do not mislead: noise below zero does not make a scale of two signs, and a scale
/// of two signs has zero in its middle.
fn balanced([low, high]: [f64; 2]) -> [f64; 2] {
    if low >= 0.0 || high <= 0.0 {
        [low, high]
    } else if -low < NOISE * high {
        [0.0, high]
    } else {
        let most = high.max(-low);
        [-most, most]
    }
}

/// Share of the highest value down to which values below zero count as noise.
const NOISE: f64 = 0.25;
