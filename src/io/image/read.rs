//! Reads images back: OpenEXR of this program or another, or `.npy`.
//!
//! The headers are read first; sizes that cannot be meant are refused before memory is taken for
//! pixels.

use std::{collections::BTreeMap, io::Cursor, path::Path};

use exr::{
    io::Tracking,
    meta::{
        MetaData,
        attribute::{AttributeValue, Text},
        header::Header,
    },
    prelude::{AnyChannels, FlatSamples, Image, Layer, ReadChannels, ReadLayers, read},
};

use crate::{
    io::{
        IoError,
        arrays::read::whole::read_npy,
        file::source::{Source, invalid, kind},
        image::{exr::ATTRIBUTE, frame::channel_of},
    },
    signal::Channel,
};

/// Some channels of one image of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageLayer {
    /// Its name, as `palm/L0`; empty where the file has none.
    pub name: String,
    /// Width and height in pixels.
    pub size_px: [u32; 2],
    /// The channels, as they are sorted in the file: name and values, row by row from the top.
    pub channels: BTreeMap<String, Vec<f32>>,
    /// Those that show readings, with units, if the file says so; named as in `channels`.
    pub signals: Vec<Channel>,
}

/// Largest number of samples that are read: 4 GiB of them.
const MAX_SAMPLES: u64 = 1 << 30;

/// No compression of OpenEXR makes more of a byte: zlib up to 1032, with some room.
const MOST_OF_A_BYTE: u64 = 1100;

/// Reads the channels of these names of every image of an `.exr`, or an array `(H, W)`, `(C, H, W)`
/// or `(T, C, H, W)` from a `.npy`; without names all channels.
///
/// A `.npy` has no names: its channels are `0`, `1` and so on, of a recording those of the first
/// frame.
///
/// # Errors
/// If the file cannot be read, its sizes do not fit the bytes that are there, or an image lacks a
/// channel.
pub fn read_images(path: &Path, channels: &[String]) -> Result<Vec<ImageLayer>, IoError> {
    let mut layers = match kind(path).as_str() {
        "exr" => read_exr(&Source::open(path)?)?,
        "npy" => vec![read_npy_image(path)?],
        _ => return Err(IoError::UnknownKind { path: path.into(), known: ".exr, .npy" }),
    };
    if channels.is_empty() {
        return Ok(layers);
    }
    for layer in &mut layers {
        if let Some(lacking) = channels.iter().find(|name| !layer.channels.contains_key(*name)) {
            let names: Vec<&str> = layer.channels.keys().map(String::as_str).collect();
            let found = format!("the channels {}", names.join(", "));
            let needed = format!("channel {lacking}");
            return Err(invalid(path, format!("image {:?}", layer.name), found, needed));
        }
        layer.channels.retain(|name, _| channels.contains(name));
        layer.signals.retain(|signal| channels.contains(&signal.name));
    }
    Ok(layers)
}

fn read_exr(source: &Source) -> Result<Vec<ImageLayer>, IoError> {
    let fail = |e: exr::error::Error| source.invalid("the file", e.to_string(), "a sound OpenEXR file");
    // As the crate wraps its readers: one type of reader is compiled once.
    let head = Tracking::new(Cursor::new(source.bytes()));
    let meta = MetaData::read_from_buffered(head, false).map_err(fail)?;
    check_sizes(source, &meta.headers)?;
    let reader =
        read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes();
    // In one thread: what is read does not depend on their number, and neither does an error.
    let image: Image<_> = reader.non_parallel().from_buffered(Cursor::new(source.bytes())).map_err(fail)?;
    Ok(image.layer_data.into_iter().map(layer_of).collect())
}

/// The image of the last two indices of an array; of a recording that of the first frame.
fn read_npy_image(path: &Path) -> Result<ImageLayer, IoError> {
    let (shape, elements) = read_npy(path)?;
    let (count, size) = match shape[..] {
        [height, width] => (1, [width, height]),
        [count, height, width] | [_, count, height, width] => (count, [width, height]),
        _ => {
            let needed = "(H, W), (C, H, W) or (T, C, H, W)";
            return Err(invalid(path, "the array", format!("the shape {shape:?}"), needed));
        }
    };
    let size_px = size.map(|n| u32::try_from(n).unwrap_or(u32::MAX));
    let pixels = size_px.map(|n| n as usize).into_iter().product::<usize>();
    let channels = (0..count).zip(elements.chunks(pixels.max(1)));
    let channels = channels.map(|(k, values)| (k.to_string(), values.to_vec())).collect();
    Ok(ImageLayer { name: String::new(), size_px, channels, signals: Vec::new() })
}

/// Whether the pixels that the headers promise can be in the file.
fn check_sizes(source: &Source, headers: &[Header]) -> Result<(), IoError> {
    let most = MAX_SAMPLES.min(MOST_OF_A_BYTE.saturating_mul(source.bytes().len() as u64));
    let mut samples = 0_u64;
    for (part, header) in headers.iter().enumerate() {
        let element = format!("part {part}");
        if header.deep {
            return Err(source.invalid(element, "deep data", "one value for each pixel and channel"));
        }
        if let Some(channel) = header.channels.list.iter().find(|c| c.sampling.0 != 1 || c.sampling.1 != 1) {
            let found = format!("channel {} with a sampling of its own", channel.name);
            return Err(source.invalid(element, found, "a value for each pixel"));
        }
        let [width, height] = [header.layer_size.0, header.layer_size.1].map(|n| n as u64);
        let pixels = width.saturating_mul(height).saturating_mul(header.channels.list.len() as u64);
        samples = samples.saturating_add(pixels);
        if samples > most {
            let found = format!("{width} x {height} pixels of {} channels", header.channels.list.len());
            let needed = format!("at most {most} values in a file of {} bytes", source.bytes().len());
            return Err(source.invalid(element, found, needed));
        }
    }
    Ok(())
}

fn layer_of(layer: Layer<AnyChannels<FlatSamples>>) -> ImageLayer {
    let name = layer.attributes.layer_name.map(|name| decoded(&name.to_string())).unwrap_or_default();
    let mut channels = BTreeMap::new();
    for channel in layer.channel_data.list {
        let values = match channel.sample_data {
            FlatSamples::F32(x) => x,
            FlatSamples::F16(x) => x.into_iter().map(f32::from).collect(),
            FlatSamples::U32(x) => x.into_iter().map(approximate).collect(),
        };
        channels.insert(decoded(&channel.name.to_string()), values);
    }
    let size_px = [layer.size.0, layer.size.1].map(|n| u32::try_from(n).unwrap_or(u32::MAX));
    let note = layer.attributes.other.get(&Text::from(ATTRIBUTE)).and_then(|note| match note {
        AttributeValue::Text(text) => serde_json::from_str(&text.to_string()).ok(),
        _ => None,
    });
    let signals = note.map_or_else(Vec::new, |note| signals_of(&note, &channels));
    ImageLayer { name, size_px, channels, signals }
}

/// The channels that the attribute of a frame lists and that exist, by their names in the file.
fn signals_of(note: &serde_json::Value, channels: &BTreeMap<String, Vec<f32>>) -> Vec<Channel> {
    let listed = note.get("channels").and_then(|channels| channels.as_array());
    let named = |channel: Channel| {
        let names = [format!("signal.{}", channel.name), channel.name.clone()];
        let name = names.into_iter().find(|name| channels.contains_key(name))?;
        Some(Channel { name, ..channel })
    };
    listed.into_iter().flatten().filter_map(channel_of).filter_map(named).collect()
}

#[expect(clippy::cast_precision_loss, reason = "readings are measures; ids above 2^24 are not read as such")]
fn approximate(x: u32) -> f32 {
    x as f32
}

/// Undoes the escapes of names in files.
fn decoded(name: &str) -> String {
    let bytes = name.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        let code = bytes.get(at + 1..at + 3).and_then(|hex| std::str::from_utf8(hex).ok());
        match code.and_then(|hex| u8::from_str_radix(hex, 16).ok()).filter(|_| bytes[at] == b'%') {
            Some(byte) => {
                out.push(byte);
                at += 3;
            }
            None => {
                out.push(bytes[at]);
                at += 1;
            }
        }
    }
    String::from_utf8(out).unwrap_or_else(|_| name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_decoded() {
        assert_eq!(decoded("h%C3%A4nd%25/L0"), "h\u{e4}nd%/L0");
        assert_eq!(decoded("50%"), "50%");
        assert_eq!(decoded("%FF"), "%FF", "no UTF-8");
    }
}
