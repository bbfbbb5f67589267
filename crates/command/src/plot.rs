//! `dermatome plot MAP.glb -o OUT.svg|.png`: levels of a map side by side, with their receptive
//! fields, or with a frame of readings, and the skin in space.

use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

use dermatome::Error;
use dermatome::io::IoError;
use dermatome::map::SkinMap;
use dermatome::pattern::{Sheet, draw_pattern, write_svg};
use dermatome::plot::{
    Paint, Picture, PlotOptions, Viewpoint, plot_frame, plot_map, plot_signals, plot_skin,
};
use dermatome::recording::{Carried, FrameRange, map_signals};
use dermatome::signal::Zero;
use glob::Pattern;

use crate::console::errors::advise;
use crate::console::notes::note;
use crate::console::print::print;
use crate::files::input::{read_map_if_any, read_skin, select_patches};
use crate::files::outputs::{self, is_stream};
use crate::files::patterns::{check_sheet, pattern_kind, sheet, write_pattern};
use crate::files::pictures::{picture_kind, write_picture};
use crate::options::{
    Choice, Common, InPath, LevelArg, OutFile, PatchArgs, ReadArgs, RegionsArgs, level, number, numbers,
    one_of, pattern,
};
use crate::readings::{ReadingsArgs, range, remark_channel, remark_join};

/// Draw levels of a map side by side, all at one scale, with their receptive fields or their
/// distortion, or with one frame of readings, and the skin in space.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The map, written by `dermatome build`; or a skin without a map, which is drawn in space
    #[arg(value_name = "MAP.glb")]
    map: InPath,
    /// Output file: .svg or .png, with --pattern .svg or .dxf; `-`: SVG on standard output; may be given more than
    /// once
    #[arg(short, long = "output", required = true, value_name = "OUT")]
    outputs: Vec<OutFile>,
    /// Draw the patches of this name only, in which * and ? stand for any characters; may be given more
    /// than once [default: all, one below the other]
    #[arg(long = "patch", value_name = "NAME", value_parser = pattern)]
    patches: Vec<Pattern>,
    /// Draw this level; may be given more than once [default: the finest three]. With --readings also body.L0, body.L1, ...
    /// of the whole body, and arm.thermal.L0 of a modality, at the taxels
    #[arg(long = "level", value_name = "K|NAME.LK", value_parser = level)]
    levels: Vec<LevelArg>,
    /// What the colours show
    #[arg(long, value_parser = one_of(&SHOWN), default_value = "fields")]
    show: Paint,
    /// Also draw the skin in space, with the colours of the first level drawn
    #[arg(long)]
    space: bool,
    /// Draw the skin in space from this viewpoint: angle from x towards y and angle above the xy
    /// plane, in degrees [default: from outside, tilted so that its shape is visible]
    #[arg(long, alias = "from", value_name = "AZIMUTH,ELEVATION", value_parser = viewpoint, allow_hyphen_values = true)]
    view: Option<Viewpoint>,
    /// Draw the skin as it unfolds into its map, at these times side by side: 0 is the skin in space, 1 its
    /// map
    #[arg(long, value_name = "T,T,...", value_delimiter = ',', value_parser = time, conflicts_with_all = ["readings", "space"], hide_short_help = true)]
    unfold: Vec<f64>,
    /// Values at the ends of the colour scale: of --show angle or area, of --show sigma in mm, of
    /// --readings in the unit of the channel, of a force per m^2 [default: those of what is drawn]
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true)]
    range: Option<[f64; 2]>,
    /// Draw the pattern of level 0 at 1:1, to print or cut: rims, seams with ticks, taxels with ids, and strain
    #[arg(long, conflicts_with_all = ["levels", "show", "space", "view", "unfold", "range", "width", "sources", "readings"])]
    pattern: bool,
    /// Write the pattern OUT.svg on sheets of paper with crosses to join them, as OUT-1.svg, OUT-2.svg, ...:
    /// A4, A3, or width and height in mm
    #[arg(long, value_name = "A4|A3|W,H", value_parser = sheet, requires = "pattern")]
    sheet: Option<Sheet>,
    /// Width of the picture, in pixels
    #[arg(long, value_name = "PX", default_value_t = PlotOptions::default().width_px, hide_short_help = true)]
    width: u32,
    #[command(flatten)]
    regions: RegionsArgs,
    #[command(flatten)]
    read: ReadArgs,
    #[command(flatten)]
    frame: FrameArgs,
    #[command(flatten)]
    readings_args: ReadingsArgs,
}

/// Which readings are drawn.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Frame of readings")]
struct FrameArgs {
    /// Draw one frame of these readings: text with a line of taxel ids, .csv, .npy or .npz; `-`: text
    /// or CSV on standard input
    #[arg(long, visible_alias = "recording", value_name = "READINGS", conflicts_with = "show")]
    readings: Option<InPath>,
    /// Draw the map that follows from the signals of all these readings of touches, next to the true map, instead of a frame:
    /// the nearer two taxels, the more alike their signals. Colours are those of places on the true map
    #[arg(long, requires = "readings", conflicts_with_all = ["frame", "channel", "levels", "space", "view", "range"], hide_short_help = true)]
    signals: bool,
    /// The frame that is drawn, counted from 0
    #[arg(long, value_name = "K", default_value_t = 0, requires = "readings")]
    frame: usize,
    /// The channel that is drawn [default: the first that measures touches]
    #[arg(long, value_name = "NAME", requires = "readings")]
    channel: Option<String>,
}

const SHOWN: [Choice<Paint>; 5] = [
    ("fields", Paint::Fields, "The receptive field with the largest weight at each taxel"),
    ("angle", Paint::Angle, "Angle distortion of each triangle: the ratio of its stretches"),
    ("area", Paint::Area, "Area of each triangle on the map divided by that on the skin"),
    ("sigma", Paint::Sigma, "Standard deviation of each taxel's position, if the skin was calibrated"),
    ("regions", Paint::Regions, "The named regions, if it has some"),
];

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    if args.pattern {
        return plot_pattern(args, common);
    }
    args.outputs.iter().try_for_each(|path| picture_kind(path).map(|_| ()))?;
    let mut options = PlotOptions {
        patches: Vec::new(),
        levels: Vec::new(),
        field_levels: Vec::new(),
        paint: args.show,
        unfold: args.unfold.clone(),
        space: args.view.or(args.space.then(Viewpoint::default)),
        range: args
            .range
            .map(|range| if args.show == Paint::Sigma { range.map(|x| 1e-3 * x) } else { range }),
        width_px: args.width,
    };
    let mut map = read_map_if_any(&args.map)?;
    if let Some(map) = &mut map {
        args.regions.apply(map, common)?;
    } else if !args.regions.is_empty() {
        return Err(Error::from(IoError::NoMap { path: (&args.map).into() }).into());
    }
    let fields;
    (options.levels, fields) = LevelArg::sort(&args.levels, map.as_ref())?;
    options.field_levels = fields.into_iter().map(|(level, _)| level).collect();
    if args.frame.readings.is_none() && !options.field_levels.is_empty() {
        return Err(advise(
            "levels of the whole body and of modalities have no map of their own",
            "give --readings, whose values are drawn",
        ));
    }
    if let Some(map) = map.as_ref().filter(|_| !args.patches.is_empty()) {
        let names: Vec<String> = map.patches.iter().map(|patch| patch.name.clone()).collect();
        options.patches = select_patches(&args.map, names, &args.patches, |name| name)?;
    }
    let picture = match (map, &args.frame.readings) {
        (Some(map), Some(readings)) if args.frame.signals => {
            picture_of_signals(args, &Arc::new(map), readings, &options, common)?
        }
        (Some(map), Some(readings)) => picture_of_frame(args, &Arc::new(map), readings, &options, common)?,
        (Some(map), None) => plot_map(&map, &options).map_err(Error::from)?,
        (None, Some(_)) => return Err(Error::from(IoError::NoMap { path: (&args.map).into() }).into()),
        (None, None) => {
            let (read, chosen) = (args.read.options(&[&args.map]), PatchArgs::named(&args.patches));
            let skin = read_skin(&args.map, &args.read, &chosen, &read, common)?;
            plot_skin(&skin, &options).map_err(Error::from)?
        }
    };
    for path in args.outputs.iter().filter(|path| !is_stream(path)) {
        write_picture(path, &picture, common)?;
    }
    outputs::publish(common)?;
    if args.outputs.iter().any(|path| is_stream(path)) {
        print(&picture.to_svg())?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Writes the pattern of a map.
fn plot_pattern(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    let unknown = |path: &Path| IoError::UnknownKind { path: path.to_owned(), known: ".svg, .dxf" };
    if let Some(path) = args.outputs.iter().find(|path| pattern_kind(path).is_none()) {
        return Err(Error::from(unknown(path)).into());
    }
    check_sheet(args.sheet, args.outputs.iter().map(|path| &**path))?;
    let map = read_map_if_any(&args.map)?
        .ok_or_else(|| Error::from(IoError::NoMap { path: (&args.map).into() }))?;
    let names = map.patches.iter().map(|patch| patch.name.clone()).collect();
    let chosen = select_patches(&args.map, names, &args.patches, |name: &String| name)?;
    let drawing = draw_pattern(&map, &chosen).map_err(Error::from)?;
    for path in args.outputs.iter().filter(|path| !is_stream(path)) {
        write_pattern(path, &drawing, args.sheet, common)?;
    }
    outputs::publish(common)?;
    if args.outputs.iter().any(|path| is_stream(path)) {
        print(&write_svg(&drawing, "pattern"))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn picture_of_frame(
    args: &Args,
    map: &Arc<SkinMap>,
    path: &Path,
    options: &PlotOptions,
    common: &Common,
) -> anyhow::Result<Picture> {
    let FrameArgs { frame, channel, .. } = &args.frame;
    let mut recording = args.readings_args.open(FrameRange::one(*frame), path, map, common)?;
    let shown = recording.channel(channel.as_deref()).map_err(Error::from)?;
    remark_join(&recording, path, common);
    recording.carry(Carried::Values, None);
    let channels = recording.channels().to_vec();
    let levels = recording.next_step()?.and_then(|step| step.levels);
    let picture = levels.map(|levels| plot_frame(map, levels, &channels, shown, options));
    args.readings_args.remark(&recording, common);
    picture.transpose().map_err(Error::from)?.ok_or_else(|| {
        advise(
            format!("{} ends before frame {frame}", path.display()),
            "frames count from 0; give --frame a smaller number",
        )
    })
}

fn picture_of_signals(
    args: &Args,
    map: &Arc<SkinMap>,
    path: &Path,
    options: &PlotOptions,
    common: &Common,
) -> anyhow::Result<Picture> {
    if is_stream(path) {
        return Err(advise("recordings are read twice", "name a file, not -"));
    }
    let zero = args.readings_args.zero().unwrap_or(Zero::Follow);
    let mut is_known = false;
    let signals = map_signals(map, zero, 1, |_, zero| {
        let recording = args.readings_args.open_at(zero, path, map, common)?;
        if !is_known {
            remark_join(&recording, path, common);
            remark_channel(recording.channels(), path, common);
        }
        is_known = true;
        Ok::<_, anyhow::Error>(recording)
    })?;
    for (patch, found) in map.patches.iter().zip(&signals) {
        let known = found.iter().flat_map(|found| found.points.iter().flatten()).count();
        let missing = patch.taxels.ids.len() - known;
        if missing > 0 {
            note!(
                common,
                "{}: the signals of {missing} taxels are not connected with the others",
                patch.name
            );
        }
    }
    Ok(plot_signals(map, &signals, options).map_err(Error::from)?)
}

fn time(text: &str) -> Result<f64, String> {
    number(text.trim(), "numbers from 0 to 1, as in 0,0.25,0.5,0.75,1", |time| (0.0..=1.0).contains(&time))
}

fn viewpoint(text: &str) -> Result<Viewpoint, String> {
    match numbers(text) {
        Some([azimuth, elevation]) if elevation.abs() <= 90.0 => {
            Ok(Viewpoint::From { azimuth: azimuth.to_radians(), elevation: elevation.to_radians() })
        }
        _ => Err("needed: two angles in degrees, the second from -90 to 90, as in -65,-45".into()),
    }
}
