//! Frames of readings as images: OpenEXR, and raw numbers for a pipe.

use std::{
    io::{self, Write},
    ops::Range,
    path::Path,
};

use serde_json::{Value, json};

use crate::{
    atlas::{ImageRows, LevelImage, SampleType, Samples},
    image::TactileImage,
    io::{IoError, file::source::unfit, image::exr::write_parts},
    map::ImageFrame,
    signal::{Channel, Quantity},
};

/// What a file says of a frame besides its pixels.
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
pub fn write_frame(path: &Path, image: &TactileImage, content: &FrameContent<'_>) -> Result<(), IoError> {
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

/// What the attribute says of a channel.
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

/// An image with the channels that it has in a file.
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
/// Whatever `output` says.
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
