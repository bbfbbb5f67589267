//! The colour scales of pictures.

use std::{f64::consts::PI, fs, path::Path};

use dermatome::{
    map::SkinMap,
    plot::ValueRange,
    signal::{Channel, Quantity},
};

use crate::{
    console::errors::advise,
    files::outputs::is_stream,
    render::{
        output::{Colours, Pictures},
        readings_args::range,
        shown::{Shown, Values, shown_channels},
        source::Readings,
    },
};

/// How values become colours.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Pictures")]
pub(super) struct ColourArgs {
    /// What a folder holds
    #[arg(long, value_enum, default_value_t = Pictures::Exr)]
    pub(super) pictures: Pictures,
    /// Values at the ends of the colour scale [default: the percentiles of the recording]
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true)]
    range: Option<[f64; 2]>,
    /// Percentiles of the recording at the ends of the colour scale
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, default_value = "1,100")]
    percentiles: [f64; 2],
    /// Pixels of a picture for each pixel of an image
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=64))]
    zoom: u32,
}

impl ColourArgs {
    /// The colour scale of each channel: what the user says, or percentiles of the whole recording.
    pub(super) fn scales(
        &self,
        path: &Path,
        readings: &Readings<'_>,
        map: &SkinMap,
        (read, shown): (&[Channel], Shown),
    ) -> anyhow::Result<Colours> {
        let channels = shown_channels(read, shown);
        let magnification = self.zoom;
        if let Some(range) = self.range {
            return Ok(Colours { ranges: vec![range; channels.len()], magnification });
        }
        if is_stream(path) || !fs::metadata(path).is_ok_and(|about| about.is_file()) {
            return Err(advise(
                "the colours of a stream cannot follow from percentiles of what is not there yet",
                "give the values at the ends of the scale with --range LOW,HIGH",
            ));
        }
        let ranges = value_ranges(readings, map, (read, shown), &channels)?;
        let ends = |(range, channel): (&ValueRange, &Channel)| self.ends(range, channel, shown);
        Ok(Colours { ranges: ranges.iter().zip(&channels).map(ends).collect(), magnification })
    }

    /// The values at the ends of the scale of a channel with these values.
    fn ends(&self, range: &ValueRange, channel: &Channel, shown: Shown) -> [f64; 2] {
        let [low, high] = self.percentiles;
        match shown {
            _ if channel.quantity == Quantity::Direction => [-PI, PI],
            // Contrast has two signs, and most of it is zero.
            Shown::Contrast => {
                let [low, high] = range.percentiles(low.min(100.0 - high), high).unwrap_or([-1.0, 1.0]);
                let most = high.max(-low);
                [-most, most]
            }
            Shown::Readings | Shown::Edges => balanced(range.percentiles(low, high).unwrap_or([0.0, 1.0])),
        }
    }
}

/// The values of each channel in the whole recording, as they are drawn.
fn value_ranges(
    readings: &Readings<'_>,
    map: &SkinMap,
    (read, shown): (&[Channel], Shown),
    channels: &[Channel],
) -> anyhow::Result<Vec<ValueRange>> {
    let mut ranges = vec![ValueRange::default(); channels.len()];
    let mut values = Values::new(map, read, shown);
    readings.open()?.run(|_, frame| {
        let levels = values.of(frame);
        for (patch, of_patch) in map.patches.iter().zip(&levels.values) {
            for ((range, channel), of_channel) in ranges.iter_mut().zip(channels).zip(of_patch) {
                for (level, x) in patch.levels.iter().zip(of_channel) {
                    match channel.quantity {
                        Quantity::Intensive | Quantity::Direction => range.extend(x.iter().copied()),
                        // Amounts are drawn per area.
                        Quantity::Extensive => {
                            range.extend(x.iter().zip(&level.level.areas).map(|(x, a)| x / a))
                        }
                    }
                }
            }
        }
        Ok(true)
    })?;
    Ok(ranges)
}

/// Ends of a scale that do not mislead: noise below zero does not make a scale of two signs, and a scale
/// of two signs has zero in its middle.
fn balanced([low, high]: [f64; 2]) -> [f64; 2] {
    if low >= 0.0 || high <= 0.0 {
        [low, high]
    } else if -low < NOISE * high {
        [0.0, high]
    } else {
        let most = high.max(-low);
        [-most, most]
    }
}

/// Share of the highest value down to which values below zero count as noise.
const NOISE: f64 = 0.25;
