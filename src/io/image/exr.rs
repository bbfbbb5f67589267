//! Images as one multi-part OpenEXR file.

use std::{
    fs::File,
    io::{self, Write},
    path::Path,
};

use exr::{
    block::{
        BlockIndex,
        chunk::{Chunk, CompressedBlock, CompressedScanLineBlock},
        enumerate_ordered_header_block_indices,
        writer::ChunksWriter,
    },
    meta::{
        BlockDescription, Headers,
        attribute::{self, AttributeValue, ChannelDescription, IntegerBounds, LineOrder, Text},
        header::Header,
    },
    prelude::{Compression, Vec2},
};
use flate2::{Compression as Effort, write::ZlibEncoder};
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    atlas::{ImageRows, LevelImage, SampleType, Samples},
    io::{
        IoError,
        error::Result,
        file::{replace_file, unfit},
    },
    numeric::order_by,
};

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
/// display window that holds the largest. The attribute `dermatome` of each part is a JSON text:
/// `version` of the program, `name` of the image and `map`, with `origin` and `size` in m as in
/// `map.glb`.
///
/// Rows are asked for and compressed block by block on the current threads; the bytes do not depend
/// on their number.
///
/// # Errors
/// If there is no image, an image has no pixels, two have the same name, or the file cannot be written.
pub fn write_images(path: &Path, images: &[LevelImage]) -> Result<(), IoError> {
    let note = |image: &LevelImage| {
        let frame = image.frame();
        let map = Rectangle { origin: frame.origin.to_array(), size: frame.size.to_array() };
        serde_json::to_string(&Note { version: env!("CARGO_PKG_VERSION"), name: image.name(), map })
    };
    let notes: Vec<_> = images
        .iter()
        .map(note)
        .collect::<Result<_, _>>()
        .map_err(|e| IoError::Write { path: path.to_owned(), source: e.into() })?;
    let images: Vec<_> = images.iter().map(|image| image as &dyn ImageRows).collect();
    write_parts(path, &images, &notes)
}

/// [`write_images`], with the JSON text of each part's attribute.
pub(super) fn write_parts(path: &Path, images: &[&dyn ImageRows], notes: &[String]) -> Result<()> {
    let fail = |source: io::Error| match source.kind() {
        io::ErrorKind::InvalidInput => {
            unfit(path, "an image", source.to_string(), "images that fit their layout")
        }
        _ => IoError::Write { path: path.to_owned(), source },
    };
    let parts: Vec<_> =
        images.iter().map(|&image| Part::new(image)).collect::<Result<_, _>>().map_err(fail)?;
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
            let largest = parts.iter().map(Part::block_bytes).max().unwrap_or(1);
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
struct Part<'a> {
    image: &'a dyn ImageRows,
    channels: Vec<(String, SampleType)>,
    /// Channels sorted by name, as positions in `channels`.
    order: Vec<usize>,
}

impl<'a> Part<'a> {
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
        let mut data = Vec::with_capacity(4 * width * count * bands.len());
        for line in 0..count {
            let columns = line * width..(line + 1) * width;
            for &channel in &self.order {
                match &bands[channel] {
                    Samples::F32(x) => data.extend(x[columns.clone()].iter().flat_map(|x| x.to_le_bytes())),
                    Samples::U32(x) => data.extend(x[columns.clone()].iter().flat_map(|x| x.to_le_bytes())),
                }
            }
        }
        let y = i32::try_from(top).map_err(|_| exr::error::Error::Invalid("row number".into()))?;
        let compressed_pixels_le = compress(data)?;
        let block = CompressedScanLineBlock { y_coordinate: y, compressed_pixels_le };
        Ok(Chunk { layer_index: index.layer, compressed_block: CompressedBlock::ScanLine(block) })
    }
}

#[derive(Serialize)]
struct Note<'a> {
    version: &'static str,
    name: &'a str,
    map: Rectangle,
}

#[derive(Serialize)]
struct Rectangle {
    origin: [f64; 2],
    size: [f64; 2],
}

/// A name as it is written in an EXR file, whose names are bytes that every program reads as it
/// likes: printable ASCII as it is, any other byte of the UTF-8 text, and `%` itself, as `%` and
/// two hexadecimal digits.
fn ascii(name: &str) -> Text {
    let mut bytes = Vec::with_capacity(name.len());
    for byte in name.bytes() {
        match byte {
            b' '..=b'~' if byte != b'%' => bytes.push(byte),
            _ => bytes.extend(format!("%{byte:02X}").into_bytes()),
        }
    }
    Text::from_slice_unchecked(&bytes)
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
/// zlib. A block that does not shrink stays as it is, as the format wants it.
///
/// Written here because the exr crate's own deflate takes three times as long, and most of the time
/// of an image.
fn compress(block: Vec<u8>) -> io::Result<Vec<u8>> {
    let mut bytes: Vec<u8> =
        block.iter().step_by(2).chain(block.iter().skip(1).step_by(2)).copied().collect();
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
