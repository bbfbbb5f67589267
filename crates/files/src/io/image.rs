//! Images of maps and of frames of readings: multi-part OpenEXR files, and raw numbers for a pipe.

use std::fs::File;
use std::io::{self, Write};
use std::ops::Range;

use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock};
use exr::block::writer::ChunksWriter;
use exr::block::{BlockIndex, enumerate_ordered_header_block_indices};
use exr::meta::attribute::{self, AttributeValue, ChannelDescription, IntegerBounds, LineOrder, Text};
use exr::meta::header::Header;
use exr::meta::{BlockDescription, Headers};
use exr::prelude::{Compression, Vec2};
use flate2::{Compression as Effort, write::ZlibEncoder};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::atlas::{ImageRows, LevelImage, SampleType, Samples};
use crate::image::TactileImage;
use crate::io::IoError;
use crate::io::error::Result;
use crate::io::file::{OutPath, percent_coded, replace_file, unfit};
use crate::map::ImageFrame;
use crate::numeric::order_by;
use crate::signal::{Channel, Quantity};

/// The one custom attribute of each part. There must not be a second: the crate keeps attributes in
/// a hash map, and their order in the file would change from run to run.
const ATTRIBUTE: &str = "dermatome";

/// Blocks of 16 rows that are compressed before any of them is written, per thread: enough that no
/// thread waits long for the last one.
const BLOCKS_PER_THREAD: usize = 8;

/// Bytes of samples in the blocks that are compressed at once, whatever the number of threads; the
/// work on a block takes up to four times its samples.
const IN_FLIGHT: usize = 1 << 26;

/// Largest width or height: far from where the format's 32-bit coordinates end.
const MAX_SIDE: u32 = 1 << 24;

/// Writes images as one multi-part OpenEXR file: scan lines from the top, ZIP compression in blocks
/// of 16 rows.
///
/// Parts are named as the images (bytes beyond printable ASCII, and `%`, as `%` and two hexadecimal
/// digits), channels are sorted by name, every data window starts at (0, 0), and all parts share a
/// display window of the largest. The attribute `dermatome` of each part is a JSON text:
/// `version` of the program, `name` of the image and `map`, with `origin` and `size` in m as in
/// `map.glb`.
///
/// Rows are computed and compressed block by block on the current threads; the bytes do not depend
/// on their number.
///
/// # Errors
/// If there is no image, an image has no pixels, two have the same name, or the file cannot be written.
pub fn write_images(path: impl Into<OutPath>, images: &[LevelImage]) -> Result<(), IoError> {
    let path = &path.into();
    let note = |image: &LevelImage| {
        let ImageFrame { origin, size, .. } = image.frame();
        let map = json!({ "origin": origin.to_array(), "size": size.to_array() });
        let (version, name) = (env!("CARGO_PKG_VERSION"), json!(image.name()));
        format!(r#"{{"version":"{version}","name":{name},"map":{map}}}"#)
    };
    let notes: Vec<_> = images.iter().map(note).collect();
    let images: Vec<_> = images.iter().map(|image| image as &dyn ImageRows).collect();
    write_parts(path, &images, &notes)
}

/// [`write_images`], with the JSON text of each part's attribute.
pub(super) fn write_parts(path: &OutPath, images: &[&dyn ImageRows], notes: &[String]) -> Result<()> {
    let fail = |source: io::Error| match source.kind() {
        io::ErrorKind::InvalidInput => {
            unfit(path, "an image", source.to_string(), "images that fit their layout")
        }
        _ => IoError::Write { path: path.into(), source },
    };
    let parts: Vec<_> =
        images.iter().map(|&image| ExrPart::new(image)).collect::<Result<_, _>>().map_err(fail)?;
    let display = parts.iter().fold(Vec2(1, 1), |Vec2(w, h), part| {
        let Vec2(x, y) = part.size();
        Vec2(w.max(x), h.max(y))
    });
    let headers: Headers = parts.iter().zip(notes).map(|(part, note)| part.header(display, note)).collect();
    if headers.is_empty() {
        return Err(fail(invalid("there is no image to write".into())));
    }
    replace_file(path, |file: &mut io::BufWriter<&File>| {
        exr::block::write(file, headers, true, |meta, writer| {
            let blocks: Vec<_> = enumerate_ordered_header_block_indices(&meta.headers).collect();
            let largest = parts.iter().map(ExrPart::block_bytes).max().unwrap_or(1);
            let at_once = (IN_FLIGHT / largest).clamp(1, BLOCKS_PER_THREAD * rayon::current_num_threads());
            for batch in blocks.chunks(at_once) {
                let compress =
                    |&(at, block): &(usize, BlockIndex)| Ok((at, parts[block.layer].chunk(block)?));
                let chunks: Vec<_> = batch.par_iter().map(compress).collect::<exr::error::Result<_>>()?;
                for (at, chunk) in chunks {
                    writer.write_chunk(at, chunk)?;
                }
            }
            Ok(())
        })
        .map_err(|e| fail(to_io(e)))
    })
}

/// An image with its channels in the order of the file.
struct ExrPart<'a> {
    image: &'a dyn ImageRows,
    channels: Vec<(String, SampleType)>,
    /// Channels sorted by name, as positions in `channels`.
    order: Vec<usize>,
}

impl<'a> ExrPart<'a> {
    fn new(image: &'a dyn ImageRows) -> io::Result<Self> {
        let size = image.frame().size_px;
        if !size.iter().all(|n| (1..=MAX_SIDE).contains(n)) {
            let [width, height] = size;
            return Err(invalid(format!(
                "image {:?} has {width} x {height} pixels; 1 to {MAX_SIDE} a side can be written",
                image.name()
            )));
        }
        let channels = image.channels();
        let order = order_by(channels.len(), &|a, b| channels[a].0.cmp(&channels[b].0));
        Ok(Self { image, channels, order })
    }

    fn size(&self) -> Vec2<usize> {
        let [width, height] = self.image.frame().size_px;
        Vec2(width as usize, height as usize)
    }

    /// Bytes of the samples of 16 rows.
    fn block_bytes(&self) -> usize {
        16 * self.size().x() * 4 * self.channels.len()
    }

    fn header(&self, display: Vec2<usize>, note: &str) -> Header {
        let describe = |&at: &usize| {
            let (name, sample_type) = &self.channels[at];
            let sample_type = match sample_type {
                SampleType::F32 => attribute::SampleType::F32,
                SampleType::U32 => attribute::SampleType::U32,
            };
            let (name, sampling) = (ascii(name), Vec2(1, 1));
            ChannelDescription { name, sample_type, quantize_linearly: false, sampling }
        };
        let name = ascii(self.image.name());
        let channels = self.order.iter().map(describe).collect();
        let mut header = Header::new(name, self.size(), channels)
            .with_encoding(Compression::ZIP16, BlockDescription::ScanLines, LineOrder::Increasing)
            .with_display_window(IntegerBounds::from_dimensions(display));
        let note = AttributeValue::Text(Text::from_slice_unchecked(note.as_bytes()));
        header.own_attributes.other.insert(ascii(ATTRIBUTE), note);
        header
    }

    fn chunk(&self, index: BlockIndex) -> exr::error::Result<Chunk> {
        let (Vec2(_, top), Vec2(width, count)) = (index.pixel_position, index.pixel_size);
        let row = |y: usize| u32::try_from(y).unwrap_or(u32::MAX);
        let bands = self.image.rows(row(top)..row(top + count));
        let mut data = vec![0; 4 * width * count * bands.len()];
        let places = (0..count).flat_map(|line| self.order.iter().map(move |&channel| (line, channel)));
        for ((line, channel), row) in places.zip(data.chunks_exact_mut(4 * width)) {
            let columns = line * width..(line + 1) * width;
            let out = row.as_chunks_mut().0.iter_mut();
            match &bands[channel] {
                Samples::F32(x) => out.zip(&x[columns]).for_each(|(out, x)| *out = x.to_le_bytes()),
                Samples::U32(x) => out.zip(&x[columns]).for_each(|(out, x)| *out = x.to_le_bytes()),
            }
        }
        let y = i32::try_from(top).map_err(|_| exr::error::Error::Invalid("row number".into()))?;
        let compressed_pixels_le = compress(data)?;
        let block = CompressedScanLineBlock { y_coordinate: y, compressed_pixels_le };
        Ok(Chunk { layer_index: index.layer, compressed_block: CompressedBlock::ScanLine(block) })
    }
}

/// A name as it is written in an EXR file, whose names are bytes that every program reads as it
/// likes: printable ASCII as it is, any other byte of the UTF-8 text, and `%` itself, as `%` and
/// two hexadecimal digits.
fn ascii(name: &str) -> Text {
    Text::from_slice_unchecked(percent_coded(name, |c| !(' '..='~').contains(&c) || c == '%').as_bytes())
}

fn invalid(message: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, message)
}

fn to_io(error: exr::error::Error) -> io::Error {
    match error {
        exr::error::Error::Io(e) => e,
        other => invalid(other.to_string()),
    }
}

/// Effort of the deflate. The samples are mostly noise in their low bytes: level 1 already finds
/// what there is to find.
const EFFORT: Effort = Effort::new(1);

/// The ZIP compression of OpenEXR for one block of little-endian samples: even bytes before odd
/// ones, so that exponents stand beside exponents, then differences of neighbouring bytes, then
/// zlib. A block that does not shrink stays as it is, as the format requires.
///
/// Written here because the exr crate's own deflate takes three times as long, and most of the time
/// of an image.
fn compress(block: Vec<u8>) -> io::Result<Vec<u8>> {
    let pairs = block.as_chunks().0;
    let mut bytes: Vec<u8> =
        pairs.iter().map(|[even, _]| *even).chain(pairs.iter().map(|[_, odd]| *odd)).collect();
    let mut previous = 128_u8;
    for byte in &mut bytes {
        let this = *byte;
        // The first byte stays, the others become differences around 128.
        *byte = this.wrapping_sub(previous).wrapping_add(128);
        previous = this;
    }
    let mut encoder = ZlibEncoder::new(Vec::with_capacity(block.len() / 2), EFFORT);
    encoder.write_all(&bytes)?;
    let packed = encoder.finish()?;
    Ok(if packed.len() < block.len() { packed } else { block })
}

/// The metadata of a frame in a file.
#[derive(Debug, Clone, Copy)]
pub struct FrameContent<'a> {
    /// The channels of the image.
    pub channels: &'a [Channel],
    /// When it was, in s.
    pub time: f64,
    /// What its pixels show ([`Atlas::images`](crate::atlas::Atlas::images)), to be written too.
    pub shown: Option<&'a LevelImage>,
}

/// Writes a frame of readings as an OpenEXR image: `Y` the first channel, each channel under its
/// own name, `A` 1 where the skin is shown and every channel has a value. NaN where nothing is
/// known. On request also the channels of a [`LevelImage`] but its `Y` and `A`.
///
/// A channel called as one of the others is written as `signal.A`, `signal.Y` and so on. The
/// attribute `dermatome` is a JSON text: `version` of the program, `name` of the image, its `map`
/// rectangle and `metres_per_pixel`, the `time` in s, and `channels`, each with its `name`, the
/// `unit` of the pixels, the `value_unit` of the taxels and its `quantity`: the pixels of an
/// `extensive` one, times their area, add up to its values; `intensive` ones keep them.
///
/// # Errors
/// If the image has other channels or two of the same name, the pixels show something else, or the
/// file cannot be written.
pub fn write_frame(
    path: impl Into<OutPath>,
    image: &TactileImage,
    content: &FrameContent<'_>,
) -> Result<(), IoError> {
    let path = &path.into();
    let FrameContent { channels, time, shown } = *content;
    let pixels = image.coverage.len();
    if image.channels != channels.len() || image.values.len() != pixels * channels.len() {
        let found = format!("{} values of {} channels", image.values.len(), image.channels);
        let needed = format!("{} for each of {pixels} pixels", channels.len());
        return Err(unfit(path, format!("image {}", image.name), found, needed));
    }
    if let Some(shown) = shown.filter(|shown| shown.frame().size_px != image.frame.size_px) {
        let (found, needed) =
            (format!("{:?} pixels", image.frame.size_px), format!("{:?}", shown.frame().size_px));
        return Err(unfit(path, format!("image {}", image.name), found, needed));
    }
    let ImageFrame { origin, size, size_px } = image.frame;
    let about: Vec<_> = channels.iter().map(note_of).collect();
    let note = json!({
        "version": env!("CARGO_PKG_VERSION"),
        "name": image.name,
        "map": { "origin": origin.to_array(), "size": size.to_array() },
        "metres_per_pixel": size.x / f64::from(size_px[0]),
        "time": time,
        "channels": about,
    });
    write_parts(path, &[&FrameRows { image, channels, shown }], &[note.to_string()])
}

fn note_of(channel: &Channel) -> Value {
    let quantity = match channel.quantity {
        Quantity::Intensive => "intensive",
        Quantity::Extensive => "extensive",
    };
    json!({
        "name": channel.name,
        "unit": channel.pixel_unit(),
        "value_unit": channel.unit,
        "quantity": quantity,
    })
}

struct FrameRows<'a> {
    image: &'a TactileImage,
    channels: &'a [Channel],
    shown: Option<&'a LevelImage>,
}

/// The first two channels of a [`LevelImage`], `Y` and `A`, are those of the frame.
const OWN: usize = 2;

impl ImageRows for FrameRows<'_> {
    fn name(&self) -> &str {
        &self.image.name
    }

    fn frame(&self) -> &ImageFrame {
        &self.image.frame
    }

    fn channels(&self) -> Vec<(String, SampleType)> {
        let shown: Vec<_> = self.shown.iter().flat_map(|shown| shown.channels().split_off(OWN)).collect();
        let is_taken =
            |name: &str| ["A", "Y"].contains(&name) || shown.iter().any(|(other, _)| other == name);
        let named = self.channels.iter().map(|channel| match channel.name.as_str() {
            taken if is_taken(taken) => format!("signal.{taken}"),
            name => name.to_owned(),
        });
        let own = std::iter::once("Y".to_owned()).chain(named).chain(["A".to_owned()]);
        own.map(|name| (name, SampleType::F32)).chain(shown.iter().cloned()).collect()
    }

    fn rows(&self, rows: Range<u32>) -> Vec<Samples> {
        let shown = self.shown.iter().flat_map(|shown| shown.rows(rows.clone()).split_off(OWN));
        let TactileImage { frame, values, coverage, .. } = self.image;
        let [from, to] = [rows.start, rows.end].map(|row| row as usize * frame.size_px[0] as usize);
        let channel = |k: usize| &values[k * coverage.len()..][from..to];
        let count = self.channels.len();
        let is_known = |i: usize| (0..count).all(|k| !channel(k)[i].is_nan());
        let alpha = (from..to).map(|i| if coverage[i] == 1 && is_known(i - from) { 1.0 } else { 0.0 });
        let named = std::iter::once(0).chain(0..count).filter(|&k| k < count).map(|k| channel(k).to_vec());
        named.chain([alpha.collect()]).map(Samples::F32).chain(shown).collect()
    }
}

/// Writes the values of images to a pipe as little-endian `f32`, image by image as they are in
/// memory, and flushes it: whoever reads has the whole frame.
///
/// # Errors
/// Errors of `output`.
///
/// ```
/// let mut pipe = Vec::new();
/// dermatome::io::write_raw_frame(&mut pipe, &[])?;
/// assert!(pipe.is_empty());
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn write_raw_frame(output: &mut impl Write, images: &[TactileImage]) -> io::Result<()> {
    let mut bytes = [0; 1 << 14];
    for image in images {
        for values in image.values.chunks(bytes.len() / 4) {
            for (place, value) in bytes.chunks_exact_mut(4).zip(values) {
                place.copy_from_slice(&value.to_le_bytes());
            }
            output.write_all(&bytes[..4 * values.len()])?;
        }
    }
    output.flush()
}
