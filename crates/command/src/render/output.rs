//! Where `render` puts its frames: a folder of pictures, arrays, or a pipe.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::ValueEnum;
use dermatome::Error;
use dermatome::atlas::{Atlas, LevelImage};
use dermatome::body::FieldLevel;
use dermatome::io::{
    FrameContent, IoError, OutPath, Outputs, RecordingLayout, RecordingWriter, write_frame, write_raw_frame,
};
use dermatome::map::SkinMap;
use dermatome::plot::{ImageOptions, image_png};
use dermatome::pyramid::LevelId;
use dermatome::recording::Step;
use dermatome::signal::Channel;

use crate::console::errors::advise;
use crate::console::notes::note_count;
use crate::console::print::{STANDARD_OUTPUT, StandardOutput, is_harmless};
use crate::files::outputs::{self, is_stream, make_folder, write_bytes};
use crate::options::Common;
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
pub(super) enum ImagesKind {
    Folder(Pictures),
    Array(Array),
    Pipe,
}

impl ImagesKind {
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
    /// Values at the ends of the colour scale of PNG pictures, in the unit of the readings, of a force per m^2
    /// [default: around those of the images, for each channel; needed for a stream]
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true)]
    pub(super) range: Option<[f64; 2]>,
}

impl ColourArgs {
    /// Refuses pictures of a stream without a scale of colours.
    pub(super) fn check(&self, kind: ImagesKind, is_stream: bool) -> anyhow::Result<()> {
        if kind == ImagesKind::Folder(Pictures::Png) && self.range.is_none() && is_stream {
            return Err(advise(
                "--pictures png of a stream needs the values at the ends of its colour scale",
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
    /// The level without a mesh that is drawn alone.
    pub(super) fields: Option<FieldLevel>,
    /// Whether EXR files also have the channels that say what pixels show.
    pub(super) has_static: bool,
}

pub(super) enum Output<'a> {
    Folder {
        sequence: Sequence,
        shown: Vec<LevelImage>,
    },
    /// With options for each channel.
    Pictures {
        sequence: Sequence,
        options: Vec<ImageOptions>,
    },
    Array(Box<RecordingWriter>),
    Pipe(StandardOutput<'a>),
}

/// Files of a folder, those of a frame together.
pub(super) struct Sequence {
    folder: PathBuf,
    files: Outputs,
    /// Frames that are written.
    written: usize,
    names: BTreeSet<String>,
    /// Beginnings of the names, before the number of the frame.
    series: BTreeSet<String>,
    extension: &'static str,
}

impl Sequence {
    fn file(&mut self, image: &str, of: &str, number: usize) -> OutPath {
        let series = format!("{}{of}", series_name(image));
        let name = format!("{series}.{number:06}.{}", self.extension);
        let path = self.files.file(self.folder.join(&name));
        self.series.insert(series);
        self.names.insert(name);
        path
    }

    fn publish(&mut self) -> Result<(), IoError> {
        self.files.publish()?;
        self.written += 1;
        Ok(())
    }

    /// An error in the middle of the sequence, which says what is there.
    fn after(&self, error: Error) -> anyhow::Error {
        let frames = if self.written == 1 { "1 frame is" } else { &*format!("{} frames are", self.written) };
        anyhow::Error::new(error).context(format!("{frames} written; the next one could not be"))
    }

    /// Removes the frames of an earlier run that this one did not replace.
    fn finish(self, common: &Common) -> Result<(), Error> {
        let fail = |source| outputs::cannot_write(&self.folder, source);
        let mut stale = 0;
        for entry in self.folder.read_dir().map_err(fail)? {
            let entry = entry.map_err(fail)?;
            let Ok(name) = entry.file_name().into_string() else { continue };
            let series = name.strip_suffix(self.extension).and_then(|name| name.strip_suffix('.'));
            let series = series.and_then(|name| name.rsplit_once('.'));
            let is_frame = |(series, number): (&str, &str)| {
                self.series.contains(series)
                    && number.len() >= 6
                    && number.bytes().all(|b| b.is_ascii_digit())
            };
            if series.is_some_and(is_frame) && !self.names.contains(&name) && entry.path().is_file() {
                common.outputs.remove(&entry.path())?;
                stale += 1;
            }
        }
        note_count(common, stale, "files", "removed: frames of an earlier run that this one does not have");
        Ok(())
    }
}

impl<'a> Output<'a> {
    /// `ranges` are those of the colours of each channel, for PNG pictures.
    pub(super) fn open(
        path: &Path,
        kind: ImagesKind,
        ranges: &[[f64; 2]],
        content: &Content<'_>,
        outputs: &'a Outputs,
    ) -> Result<Self, Error> {
        let Content { map, atlas, channels, level, fields, has_static } = *content;
        if let ImagesKind::Folder(_) = kind {
            make_folder(path)?;
        }
        let sequence = |extension| Sequence {
            folder: path.to_owned(),
            files: outputs.nested(),
            written: 0,
            names: BTreeSet::new(),
            series: BTreeSet::new(),
            extension,
        };
        Ok(match kind {
            ImagesKind::Pipe => Self::Pipe(StandardOutput::new(outputs)),
            ImagesKind::Array(_) => {
                let layout = RecordingLayout { channels, atlas, values: true, level, fields };
                Self::Array(Box::new(RecordingWriter::create(outputs.file(path), map, &layout)?))
            }
            ImagesKind::Folder(Pictures::Exr) => {
                let shown = atlas.filter(|_| has_static).map(|atlas| atlas.images(map, level));
                Self::Folder { sequence: sequence("exr"), shown: shown.unwrap_or_default() }
            }
            ImagesKind::Folder(Pictures::Png) => {
                let packed = atlas.and_then(|atlas| atlas.parts.first()).filter(|part| part.charts.len() > 1);
                let labels = packed.map(|part| part.labels(map));
                let sides = atlas.iter().flat_map(|atlas| &atlas.parts).flat_map(|part| part.frame.size_px);
                // Four pixels for each, unless the picture were larger than a PNG may be here.
                let magnification = (16384 / sides.max().unwrap_or(1).max(1)).clamp(1, 4);
                let labels = labels.unwrap_or_default();
                let options = |&range| ImageOptions { range, magnification, labels: labels.clone() };
                Self::Pictures { sequence: sequence("png"), options: ranges.iter().map(options).collect() }
            }
        })
    }

    /// The frames that follow are of this episode.
    pub(super) fn begin_episode(&mut self, number: u64) -> Result<(), Error> {
        if let Self::Array(writer) = self { Ok(writer.begin_episode(number)?) } else { Ok(()) }
    }

    /// Writes a frame.
    pub(super) fn write(&mut self, step: &Step<'_>, channels: &[Channel]) -> anyhow::Result<()> {
        let Step { number, frame, levels, images, .. } = *step;
        match self {
            Self::Folder { sequence, shown } => {
                for (k, image) in images.iter().enumerate() {
                    let content = FrameContent { channels, time: frame.time, shown: shown.get(k) };
                    let file = sequence.file(&image.name, "", number);
                    write_frame(file, image, &content).map_err(|e| sequence.after(e.into()))?;
                }
                sequence.publish().map_err(|e| sequence.after(e.into()))?;
            }
            Self::Pictures { sequence, options } => {
                for (image, (k, channel)) in
                    images.iter().flat_map(|image| channels.iter().enumerate().map(move |c| (image, c)))
                {
                    // Only the slash of the image divides patch and level.
                    let several = match channels.len() {
                        1 => String::new(),
                        _ => format!(".{}", harmless(&channel.name)),
                    };
                    let file = sequence.file(&image.name, &several, number);
                    let png = image_png(image, k, &options[k]).map_err(Error::from);
                    let written = png.and_then(|png| Ok(write_bytes(&file, &png)?));
                    written.map_err(|e| sequence.after(e))?;
                }
                sequence.publish().map_err(|e| sequence.after(e.into()))?;
            }
            Self::Array(writer) => {
                let levels = levels.expect("values are carried to levels");
                writer.write(levels, images).map_err(Error::from)?;
            }
            Self::Pipe(pipe) => write_raw_frame(pipe, images)
                .map_err(|source| Error::from(IoError::Write { path: STANDARD_OUTPUT.into(), source }))?,
        }
        Ok(())
    }

    /// Completes arrays and sequences.
    pub(super) fn finish(self, common: &Common) -> Result<(), Error> {
        match self {
            Self::Array(writer) => Ok(writer.finish()?),
            Self::Folder { sequence, .. } | Self::Pictures { sequence, .. } => sequence.finish(common),
            Self::Pipe(_) => Ok(()),
        }
    }
}

/// How the files of an image begin: `palm.L0` for `palm/L0`, as in `palm.L0.000123.exr` for frame 123. What
/// file systems do not allow in a name is written as `%` and two hexadecimal digits for each byte.
fn series_name(image: &str) -> String {
    harmless(
        &image.rsplit_once('/').map_or_else(|| image.to_owned(), |(patch, level)| format!("{patch}.{level}")),
    )
}

fn harmless(text: &str) -> String {
    let mut name = String::new();
    for c in text.chars() {
        if !is_harmless(c) || r#"/\:*?"<>|%"#.contains(c) {
            name.extend(c.encode_utf8(&mut [0; 4]).bytes().map(|byte| format!("%{byte:02X}")));
        } else {
            name.push(c);
        }
    }
    name
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_are_allowed_everywhere() {
        assert_eq!(series_name("palm/L0"), "palm.L0");
        assert_eq!(series_name("L2"), "L2");
        assert_eq!(series_name("hand\u{2013}left/L0"), "hand\u{2013}left.L0");
        assert_eq!(series_name("a\u{202e}\u{9b}/L0"), "a%E2%80%AE%C2%9B.L0");
        assert_eq!(series_name("../a b/c%\u{e9}/L1"), "..%2Fa b%2Fc%25\u{e9}.L1");
    }
}
