//! `dermatome plot MAP.glb -o OUT.svg|.png`: levels of a map side by side, with their receptive fields.

use std::{
    io::{Write, stdout},
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::ValueEnum;
use dermatome::{
    Error,
    id::LevelId,
    io::{IoError, read_map, replace_file},
    report::{Paint, PlotOptions, plot_map, render_png},
};

use crate::Common;

/// Draw levels of a map side by side, all at one scale, with their receptive fields or their distortion.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The map, as `dermatome build` writes it.
    #[arg(value_name = "MAP.glb")]
    map: PathBuf,
    /// Where to write: `.svg` or `.png`; `-`: SVG on standard output. May be given more than once.
    #[arg(short, long = "output", required = true, value_name = "OUT")]
    outputs: Vec<PathBuf>,
    /// Draw this patch only; may be given more than once. Without: all, one below the other.
    #[arg(long = "patch", value_name = "NAME")]
    patches: Vec<String>,
    /// Draw this level; may be given more than once. Without: the finest three.
    #[arg(long = "level", value_name = "K")]
    levels: Vec<u32>,
    /// What the colours say
    #[arg(long, value_enum, default_value_t = Show::Fields)]
    show: Show,
    /// Width of the picture, in pixels.
    #[arg(long, value_name = "PX", default_value_t = PlotOptions::default().width_px)]
    width: u32,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Show {
    /// The receptive field that each taxel belongs to most
    Fields,
    /// How far from conformal each triangle is: the ratio of its stretches
    Angle,
    /// How much larger each triangle is on the map than on the skin
    Area,
    /// The taxels' ids, from the lowest to the highest
    Taxel,
}

impl From<Show> for Paint {
    fn from(show: Show) -> Self {
        match show {
            Show::Fields => Self::Fields,
            Show::Angle => Self::Angle,
            Show::Area => Self::Area,
            Show::Taxel => Self::Taxel,
        }
    }
}

/// Kinds of pictures.
#[derive(Clone, Copy)]
enum Kind {
    Svg,
    Png,
}

pub(crate) fn run(args: &Args, _: &Common) -> anyhow::Result<ExitCode> {
    let outputs: Vec<_> =
        args.outputs.iter().map(|path| Ok((path, kind(path)?))).collect::<Result<_, Error>>()?;
    let map = read_map(&args.map).map_err(Error::from)?;
    let options = PlotOptions {
        patches: args.patches.clone(),
        levels: args.levels.iter().copied().map(LevelId::from).collect(),
        paint: args.show.into(),
        width_px: args.width,
    };
    let svg = plot_map(&map, &options).map_err(Error::from)?;
    for (path, kind) in outputs {
        match kind {
            Kind::Svg => write(path, svg.as_bytes())?,
            Kind::Png => write(path, &render_png(&svg).map_err(Error::from)?)?,
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn is_stream(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// The extension decides; standard output is a text.
fn kind(path: &Path) -> Result<Kind, IoError> {
    if is_stream(path) {
        return Ok(Kind::Svg);
    }
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("svg") => Ok(Kind::Svg),
        Some("png") => Ok(Kind::Png),
        _ => Err(IoError::UnknownKind { path: path.to_owned(), known: ".svg, .png" }),
    }
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    if is_stream(path) {
        stdout().lock().write_all(bytes)?;
        return Ok(());
    }
    let fail = |source| IoError::Write { path: path.to_owned(), source };
    replace_file(path, |file| file.write_all(bytes).map_err(fail)).map_err(Error::from)?;
    Ok(())
}
