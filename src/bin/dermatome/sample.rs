//! `dermatome sample MAP.glb IMAGE -o OUT.csv`: tactile images back to taxels and receptive fields.

use std::{
    collections::BTreeSet,
    io::stdout,
    path::{Path, PathBuf},
    process::ExitCode,
};

use dermatome::{
    Error,
    atlas::Atlas,
    image::{RenderOptions, Renderer, Sampled, TactileImage, sample},
    io::{ImageLayer, read_images, read_map, replace_file, write_values},
    map::{ImageFrame, SkinMap},
    pyramid::LevelId,
    signal::Channel,
    skin::PatchId,
};
use glam::DVec2;
use serde_json::json;

use crate::{
    console::{
        errors::advise,
        notes::note,
        print::{plain, print, print_json},
    },
    files::outputs::{self, is_stream},
    options::Common,
    render::PixelArgs,
};

/// Carry tactile images back to the taxels and receptive fields that they show.
///
/// The values are those whose drawing comes nearest to the pixels, in the sense of least squares;
/// the round-trip residual is what their drawing misses the pixels by. Give the options of `render`
/// that the images were drawn with. A taxel that had no reading gets what the pixels around it show;
/// the cell of one that no pixel shows is empty.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The map, written by `dermatome build`
    #[arg(value_name = "MAP.glb")]
    map: PathBuf,
    /// Images of one moment: .exr of one or several images, or .npy of one, (H, W) or (C, H, W)
    #[arg(value_name = "IMAGE", required = true)]
    images: Vec<PathBuf>,
    /// Table of the values: patch,level,vertex,taxel_id and a column for each channel; `-`: standard
    /// output
    #[arg(short, long, value_name = "OUT.csv")]
    output: PathBuf,
    /// The image that the file shows, as PATCH/L0, if the file does not say so; of a file with
    /// several the one to take
    #[arg(long, value_name = "PATCH/Lk")]
    image: Option<String>,
    /// Take this channel; may be given more than once; of a .npy 0, 1, ... [default: those that the file
    /// says are readings, else all but Y and A]
    #[arg(long = "channel", value_name = "NAME")]
    channels: Vec<String>,
    /// Unit of the values of each channel; force, charge and other amounts are per area in images, and
    /// summed [default: what the file says]
    #[arg(long = "unit", value_name = "UNIT", value_delimiter = ',')]
    units: Vec<String>,
    /// Print what was sampled as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    pixels: PixelArgs,
}

pub(crate) fn run(args: &Args, common: &Common) -> anyhow::Result<ExitCode> {
    if is_stream(&args.output) {
        if args.json {
            return Err(advise(
                "--json and -o - would both use standard output",
                "write the table to a file",
            ));
        }
    } else {
        outputs::check_table(&args.output)?;
    }
    let map = read_map(&args.map).map_err(Error::from)?;
    let atlas = Atlas::new(&map, &args.pixels.atlas_options()).map_err(Error::from)?;
    let layers = read_layers(args)?;
    let channels = channels(args, &layers)?;
    let options = RenderOptions { interpolation: args.pixels.interpolation(), level: None };
    let renderer = Renderer::new(&map, &atlas, &channels, &options).map_err(Error::from)?;
    let images: Vec<_> = layers.iter().map(|layer| image(&renderer, layer, &channels)).collect();
    let sampled = sample(&renderer, &images).map_err(Error::from)?;
    let levels = levels(&atlas, &images);
    let write = |out: &mut dyn std::io::Write, path: &Path| {
        write_values(path, out, &map, (&sampled.values, &channels), &levels)
    };
    if is_stream(&args.output) {
        write(&mut stdout().lock(), Path::new("standard output")).map_err(Error::from)?;
    } else {
        replace_file(&args.output, |file| write(file, &args.output)).map_err(Error::from)?;
        outputs::wrote([args.output.as_path()], common);
    }
    report(args, &map, &sampled, (&channels, &levels), &images, common)?;
    Ok(ExitCode::SUCCESS)
}

/// The images of all files, each with its name.
fn read_layers(args: &Args) -> anyhow::Result<Vec<ImageLayer>> {
    let mut layers = Vec::new();
    let mut names = BTreeSet::new();
    for path in &args.images {
        let mut of_file = read_images(path, &args.channels).map_err(Error::from)?;
        let found: Vec<String> = of_file.iter().map(|layer| layer.name.clone()).collect();
        if let Some(wanted) = &args.image {
            of_file.retain(|layer| layer.name.is_empty() || layer.name == *wanted);
            of_file.iter_mut().for_each(|layer| layer.name.clone_from(wanted));
        }
        if of_file.is_empty() {
            let what = args.image.as_deref().unwrap_or_default();
            return Err(advise(
                format!("{} has no image {what:?}; it has {found:?}", path.display()),
                "name one of them with --image, or leave it out to take them all",
            ));
        }
        for layer in &of_file {
            if layer.name.is_empty() {
                return Err(advise(
                    format!("{} does not say which image it is", path.display()),
                    "name it with --image, as in --image palm/L0; with --pack, --image L0",
                ));
            }
            if !names.insert(layer.name.clone()) {
                return Err(advise(
                    format!("{}: image {:?} is given twice", path.display(), layer.name),
                    "give the images of one frame, each once",
                ));
            }
        }
        layers.extend(of_file);
    }
    Ok(layers)
}

/// The channels that are sampled, which every image must have.
fn channels(args: &Args, layers: &[ImageLayer]) -> anyhow::Result<Vec<Channel>> {
    let names_of = |layer: &ImageLayer| -> Vec<String> {
        if !layer.signals.is_empty() {
            return layer.signals.iter().map(|signal| signal.name.clone()).collect();
        }
        let all: Vec<_> = layer.channels.keys().cloned().collect();
        let named: Vec<_> = all.iter().filter(|name| !["A", "Y"].contains(&name.as_str())).cloned().collect();
        if named.is_empty() { all.into_iter().filter(|name| name != "A").collect() } else { named }
    };
    let names = if args.channels.is_empty() {
        layers.first().map(&names_of).unwrap_or_default()
    } else {
        args.channels.clone()
    };
    if let Some(layer) =
        layers.iter().find(|l| names.is_empty() || args.channels.is_empty() && names_of(l) != names)
    {
        return Err(advise(
            format!(
                "image {:?} has the channels {:?}; those of the first are {names:?}",
                layer.name,
                names_of(layer)
            ),
            "name channels that all images have with --channel",
        ));
    }
    if !args.units.is_empty() && args.units.len() != names.len() {
        return Err(advise(
            format!("{} units for {} channels ({})", args.units.len(), names.len(), names.join(", ")),
            "give --unit one unit for each channel, as in --unit Pa,K",
        ));
    }
    let channel = |(k, name): (usize, &String)| match args.units.get(k) {
        Some(unit) => Ok(Channel::new(name, unit)),
        None => stated(name, layers),
    };
    names.iter().enumerate().map(channel).collect()
}

/// A channel with the unit that the files state, the same in all of them.
fn stated(name: &str, layers: &[ImageLayer]) -> anyhow::Result<Channel> {
    let found = |layer: &ImageLayer| layer.signals.iter().find(|signal| signal.name == name).cloned();
    let first = layers.first().and_then(found);
    let Some(other) = layers.iter().find(|layer| found(layer) != first) else {
        return Ok(first.unwrap_or_else(|| Channel::new(name, "")));
    };
    let unit =
        |channel: Option<Channel>| channel.map_or("none".into(), |channel| format!("{:?}", channel.unit));
    Err(advise(
        format!(
            "channel {name} of image {:?} has the unit {}, that of the first {}",
            other.name,
            unit(found(other)),
            unit(first)
        ),
        "sample images of one recording at a time, or name the units with --unit",
    ))
}

/// Where an image lies that the renderer does not know.
const NO_FRAME: ImageFrame = ImageFrame { origin: DVec2::ZERO, size: DVec2::ZERO, size_px: [0, 0] };

/// A layer as the image that the renderer draws under its name.
fn image(renderer: &Renderer<'_>, layer: &ImageLayer, channels: &[Channel]) -> TactileImage {
    let drawn = renderer.images().iter().find(|image| image.name == layer.name);
    let values = channels.iter().filter_map(|channel| layer.channels.get(&channel.name)).flatten();
    TactileImage {
        name: layer.name.clone(),
        level: drawn.map(|image| image.level).unwrap_or_default(),
        size_px: layer.size_px,
        frame: drawn.map_or(NO_FRAME, |image| image.frame),
        channels: channels.len(),
        values: values.copied().collect(),
        coverage: drawn.map(|image| image.coverage.clone()).unwrap_or_default(),
    }
}

/// The levels that the images show: patch by patch, finest first.
fn levels(atlas: &Atlas, images: &[TactileImage]) -> Vec<(PatchId, LevelId)> {
    let shown = atlas.parts.iter().filter(|part| images.iter().any(|image| image.name == part.name));
    let charts = shown.flat_map(|part| part.charts.iter().map(|chart| (chart.patch, part.level)));
    let mut levels = BTreeSet::new();
    levels.extend(charts);
    levels.into_iter().collect()
}

/// Prints the round-trip residuals.
fn report(
    args: &Args,
    map: &SkinMap,
    sampled: &Sampled,
    (channels, levels): (&[Channel], &[(PatchId, LevelId)]),
    images: &[TactileImage],
    common: &Common,
) -> anyhow::Result<()> {
    let mut lines = String::new();
    let mut of_channels = Vec::new();
    for (k, channel) in channels.iter().enumerate() {
        let values = || levels.iter().flat_map(|&(patch, level)| &sampled.values.values[patch][k][level]);
        let masked = values().filter(|x| x.is_nan()).count();
        let pixels = images.iter().flat_map(|image| {
            let covered = image.values.chunks(image.coverage.len()).nth(k).unwrap_or_default();
            covered.iter().zip(&image.coverage).filter(|(x, shown)| **shown == 1 && x.is_finite())
        });
        let largest = pixels.map(|(x, _)| f64::from(x.abs())).reduce(f64::max);
        let residual = sampled.residuals[k];
        lines += &format!(
            "{}: {} values, {masked} masked; round-trip residual {residual:.3e} (RMS) of pixels up to {:.3e} {}\n",
            plain(&channel.name),
            values().count() - masked,
            largest.unwrap_or(f64::NAN),
            plain(&channel.pixel_unit())
        );
        of_channels.push(json!({
            "name": channel.name,
            "unit": channel.unit,
            "pixel_unit": channel.pixel_unit(),
            "values": values().count() - masked,
            "masked": masked,
            "residual": residual,
            "largest_pixel": largest,
        }));
    }
    if args.json {
        let names: Vec<_> = images.iter().map(|image| &image.name).collect();
        let mut patches = BTreeSet::new();
        patches.extend(levels.iter().map(|(patch, _)| &map.patches[*patch].name));
        let report = json!({ "images": names, "patches": patches, "channels": of_channels });
        return print_json("dermatome.sample/1", &report);
    }
    if common.quiet {
        return Ok(());
    }
    if is_stream(&args.output) {
        lines.lines().for_each(|text| note(common, text));
        return Ok(());
    }
    print(&lines)
}
