//! Where `render` puts its frames: a folder of pictures, arrays, or a pipe.

use std::{
    io::{Stdout, Write, stdout},
    path::{Path, PathBuf},
};

use clap::ValueEnum;
use dermatome::{
    Error,
    atlas::{Atlas, LevelImage},
    image::{RenderOptions, TactileImage, static_images},
    io::{
        FrameContent, IoError, RecordingLayout, RecordingWriter, replace_file, write_frame, write_raw_frame,
    },
    map::SkinMap,
    plot::{ImageOptions, image_png},
    signal::{Channel, LevelFrame, Quantity},
};

use crate::{
    console::errors::advise,
    files::outputs::{self, is_stream},
};

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

/// Colours of PNG pictures.
#[derive(Debug, Clone)]
pub(super) struct Colours {
    /// Of each channel, the values at the ends of its scale.
    pub(super) ranges: Vec<[f64; 2]>,
    /// Pixels of the picture for each pixel of the image.
    pub(super) magnification: u32,
}

/// Frames on their way out.
pub(super) enum Output<'a> {
    Folder { folder: PathBuf, shown: Vec<LevelImage<'a>>, written: usize },
    Pictures { folder: PathBuf, colours: Colours, written: usize },
    Array(Box<RecordingWriter>),
    Pipe(Stdout),
}

impl<'a> Output<'a> {
    /// Opens the output; `colours` are those of PNG pictures, and with `is_static` EXR files have the
    /// static channels too. Arrays may go without images.
    pub(super) fn open(
        path: &Path,
        kind: Kind,
        map: &'a SkinMap,
        atlas: &'a Atlas,
        (channels, options): (&[Channel], &RenderOptions),
        (colours, is_static, has_images): (Option<Colours>, bool, bool),
    ) -> Result<Self, Error> {
        Ok(match (kind, colours) {
            (Kind::Pipe, _) => Self::Pipe(stdout()),
            (Kind::Array(_), _) => {
                let RenderOptions { interpolation, level } = *options;
                let layout = RecordingLayout {
                    channels,
                    atlas: has_images.then_some(atlas),
                    interpolation,
                    values: true,
                    level,
                };
                Self::Array(Box::new(RecordingWriter::create(path, map, &layout)?))
            }
            (Kind::Folder(_), colours) => {
                outputs::make_folder(path)?;
                let folder = path.to_owned();
                match colours {
                    Some(colours) => Self::Pictures { folder, colours, written: 0 },
                    None => {
                        let shown = if is_static { static_images(map, atlas, options) } else { Vec::new() };
                        Self::Folder { folder, shown, written: 0 }
                    }
                }
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
            Self::Pictures { folder, colours, written } => {
                for image in images {
                    for (k, channel) in channels.iter().enumerate() {
                        write_picture(folder, number, image, (k, channel, channels.len()), colours, *written)
                            .map_err(|e| after(*written, e))?;
                    }
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

/// One channel of one image as a PNG file; that of the first frame has a colour bar.
fn write_picture(
    folder: &Path,
    number: usize,
    image: &TactileImage,
    (k, channel, channels): (usize, &Channel, usize),
    colours: &Colours,
    written: usize,
) -> Result<(), Error> {
    let name = if channels > 1 { format!("{}.{}", image.name, channel.name) } else { image.name.clone() };
    let bar = (written == 0).then(|| match (channel.quantity, channel.pixel_unit().as_str()) {
        (Quantity::Extensive, unit) => format!("{} per area, {unit}", channel.name),
        (_, "") => channel.name.clone(),
        (_, unit) => format!("{}, {unit}", channel.name),
    });
    let options = ImageOptions { range: colours.ranges[k], bar, magnification: colours.magnification };
    let bytes = image_png(image, k, &options)?;
    let path = folder.join(frame_file_name(&name, number, "png"));
    replace_file(&path, |file| {
        file.write_all(&bytes).map_err(|source| IoError::Write { path: path.clone(), source })
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
        if c.is_ascii_control() || r#"/\:*?"<>|%"#.contains(c) {
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
        assert_eq!(frame_file_name("../a b/c%\u{e9}/L1", 0, "exr"), "..%2Fa b%2Fc%25\u{e9}.L1.000000.exr");
    }
}
