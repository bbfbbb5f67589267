//! Where `render` puts its frames: a folder of pictures, arrays, or a pipe.

use std::io::{Stdout, Write, stdout};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::ValueEnum;
use dermatome::Error;
use dermatome::atlas::{Atlas, LevelImage};
use dermatome::image::TactileImage;
use dermatome::io::{
    FrameContent, IoError, RecordingLayout, RecordingWriter, replace_file, write_frame, write_raw_frame,
};
use dermatome::map::SkinMap;
use dermatome::plot::{ImageOptions, image_png};
use dermatome::pyramid::LevelId;
use dermatome::signal::{Channel, LevelFrame};

use crate::console::errors::advise;
use crate::console::print::is_harmless;
use crate::files::outputs::{self, is_stream};
use crate::readings::range;

/// What a folder holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Pictures {
    /// OpenEXR: values in their unit, as f32
    Exr,
    /// PNG: colours
    Png,
}

/// Kinds of files with arrays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Array {
    Npy,
    Npz,
}

/// The kind of output that a path asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Folder(Pictures),
    Array(Array),
    Pipe,
}

impl Kind {
    /// The kind of `output`, refused before any work if it cannot be written.
    pub(super) fn of(output: &Path, pictures: Pictures) -> anyhow::Result<Self> {
        if is_stream(output) {
            return Ok(Self::Pipe);
        }
        match outputs::kind(output).as_str() {
            kind @ ("npy" | "npz") => {
                outputs::check_file(output)?;
                if kind == "npz" {
                    outputs::check_file(&output.with_extension("features.json"))?;
                }
                Ok(Self::Array(if kind == "npy" { Array::Npy } else { Array::Npz }))
            }
            "" => {
                outputs::check_folder(output)?;
                Ok(Self::Folder(pictures))
            }
            _ if output.is_dir() => Ok(Self::Folder(pictures)),
            _ => Err(advise(
                format!("{} is not a kind of recording that is written", output.display()),
                "name a folder, a file that ends in .npy or .npz, or - for standard output",
            )),
        }
    }
}

/// How values become colours.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Pictures")]
pub(super) struct ColourArgs {
    /// What a folder holds
    #[arg(long, value_enum, default_value_t = Pictures::Exr)]
    pub(super) pictures: Pictures,
    /// Values at the ends of the colour scale of PNG pictures
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true)]
    range: Option<[f64; 2]>,
    /// Pixels of a picture for each pixel of an image
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=64))]
    zoom: u32,
}

impl ColourArgs {
    /// Refuses pictures without a scale of colours.
    pub(super) fn check(&self, kind: Kind) -> anyhow::Result<()> {
        if kind == Kind::Folder(Pictures::Png) && self.range.is_none() {
            return Err(advise(
                "--pictures png needs the values at the ends of its colour scale",
                "give them with --range LOW,HIGH, in the unit of the readings, of a force per m^2",
            ));
        }
        Ok(())
    }
}

pub(super) struct Content<'a> {
    pub(super) map: &'a Arc<SkinMap>,
    /// `None`: values without images.
    pub(super) atlas: Option<&'a Atlas>,
    pub(super) channels: &'a [Channel],
    pub(super) level: Option<LevelId>,
    /// Whether EXR files also have the channels that say what pixels show.
    pub(super) has_static: bool,
}

pub(super) enum Output {
    Folder { folder: PathBuf, shown: Vec<LevelImage>, written: usize },
    Pictures { folder: PathBuf, options: ImageOptions, written: usize },
    Array(Box<RecordingWriter>),
    Pipe(Stdout),
}

impl Output {
    pub(super) fn open(
        path: &Path,
        kind: Kind,
        colours: &ColourArgs,
        content: &Content<'_>,
    ) -> Result<Self, Error> {
        let Content { map, atlas, channels, level, has_static } = *content;
        if let Kind::Folder(_) = kind {
            outputs::make_folder(path)?;
        }
        let folder = path.to_owned();
        Ok(match kind {
            Kind::Pipe => Self::Pipe(stdout()),
            Kind::Array(_) => {
                let layout = RecordingLayout { channels, atlas, values: true, level };
                Self::Array(Box::new(RecordingWriter::create(path, map, &layout)?))
            }
            Kind::Folder(Pictures::Exr) => {
                let shown = atlas.filter(|_| has_static).map(|atlas| atlas.images(map, level));
                Self::Folder { folder, shown: shown.unwrap_or_default(), written: 0 }
            }
            Kind::Folder(Pictures::Png) => {
                let range = colours.range.unwrap_or(ImageOptions::default().range);
                let options = ImageOptions { range, magnification: colours.zoom };
                Self::Pictures { folder, options, written: 0 }
            }
        })
    }

    /// Writes frame `number` of the recording.
    pub(super) fn write(
        &mut self,
        number: usize,
        levels: &LevelFrame,
        images: &[TactileImage],
        channels: &[Channel],
    ) -> anyhow::Result<()> {
        match self {
            Self::Folder { folder, shown, written } => {
                for (k, image) in images.iter().enumerate() {
                    let path = folder.join(frame_file_name(&image.name, number, "exr"));
                    let content = FrameContent { channels, time: levels.time, shown: shown.get(k) };
                    write_frame(&path, image, &content).map_err(|e| after(*written, Error::from(e)))?;
                }
                *written += 1;
            }
            Self::Pictures { folder, options, written } => {
                for (image, (k, channel)) in
                    images.iter().flat_map(|image| channels.iter().enumerate().map(move |c| (image, c)))
                {
                    let several =
                        if channels.len() > 1 { format!(".{}", channel.name) } else { String::new() };
                    let name = frame_file_name(&format!("{}{several}", image.name), number, "png");
                    write_picture(&folder.join(name), image, k, options).map_err(|e| after(*written, e))?;
                }
                *written += 1;
            }
            Self::Array(writer) => writer.write(levels, images).map_err(Error::from)?,
            Self::Pipe(pipe) => write_raw_frame(&mut pipe.lock(), images)
                .map_err(|source| Error::from(IoError::Write { path: "standard output".into(), source }))?,
        }
        Ok(())
    }

    /// Completes arrays.
    pub(super) fn finish(self) -> Result<(), IoError> {
        match self {
            Self::Array(writer) => writer.finish(),
            Self::Folder { .. } | Self::Pictures { .. } | Self::Pipe(_) => Ok(()),
        }
    }
}

/// One channel of one image as a PNG file.
fn write_picture(
    path: &Path,
    image: &TactileImage,
    channel: usize,
    options: &ImageOptions,
) -> Result<(), Error> {
    let bytes = image_png(image, channel, options)?;
    replace_file(path, |file| {
        file.write_all(&bytes).map_err(|source| IoError::Write { path: path.into(), source })
    })?;
    Ok(())
}

/// An error in the middle of a sequence, which says what is there.
fn after(written: usize, error: Error) -> anyhow::Error {
    let frames = if written == 1 { "1 frame is" } else { &*format!("{written} frames are") };
    anyhow::Error::new(error).context(format!("{frames} written; the next one could not be"))
}

/// The name of a file of a sequence: `palm.L0.000123.exr` for frame 123 of `palm/L0`. What file
/// systems do not allow in a name is written as `%` and two hexadecimal digits.
fn frame_file_name(image: &str, frame: usize, extension: &str) -> String {
    let mut name = String::new();
    let image =
        image.rsplit_once('/').map_or_else(|| image.to_owned(), |(patch, level)| format!("{patch}.{level}"));
    for c in image.chars() {
        if !is_harmless(c) || r#"/\:*?"<>|%"#.contains(c) {
            name += &format!("%{:02X}", u32::from(c));
        } else {
            name.push(c);
        }
    }
    format!("{name}.{frame:06}.{extension}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_are_allowed_everywhere() {
        assert_eq!(frame_file_name("palm/L0", 123, "exr"), "palm.L0.000123.exr");
        assert_eq!(frame_file_name("L2", 1_234_567, "png"), "L2.1234567.png");
        assert_eq!(frame_file_name("a\u{202e}\u{9b}/L0", 0, "png"), "a%202E%9B.L0.000000.png");
        assert_eq!(frame_file_name("../a b/c%\u{e9}/L1", 0, "exr"), "..%2Fa b%2Fc%25\u{e9}.L1.000000.exr");
    }
}
