//! The options that say how `render` and `plot` read readings, and which frames they take.

use std::path::PathBuf;

use dermatome::{io::ReadingsLayout, signal::Duplicates};

use crate::{
    console::errors::advise,
    options::{Choice, one_of},
};

/// How readings are read and made comparable.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Readings")]
// Any of them needs the argument `readings`, which `render` has and `plot` may have.
#[group(requires = "readings")]
pub(crate) struct ReadingsArgs {
    /// Order of the axes of an array with three
    #[arg(long, value_parser = one_of(&LAYOUTS), default_value = "tnc")]
    pub(super) layout: ReadingsLayout,
    /// Unit of the readings; force, charge and other amounts are summed over receptive fields, all
    /// else is averaged; several channels: one unit each
    #[arg(long = "readings-unit", value_name = "UNIT", value_delimiter = ',')]
    pub(super) units: Vec<String>,
    /// Frames per second, for readings without times
    #[arg(long, value_name = "HZ", value_parser = positive)]
    pub(super) rate: Option<f64>,
    /// What to do with a taxel id that several columns have
    #[arg(long, value_parser = one_of(&DUPLICATES), default_value = "refuse", hide = true)]
    pub(super) duplicates: Duplicates,
    /// Subtract the mean of the first N frames from each taxel
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) baseline: usize,
    /// Multiply the readings of each taxel: a table with columns id,gain
    #[arg(long, value_name = "F.csv")]
    pub(super) gain: Option<PathBuf>,
    /// Clip readings to these bounds; the number of clipped readings is printed
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true)]
    pub(super) clip: Option<[f64; 2]>,
    /// Split each channel into a slow and a fast part at this frequency
    #[arg(long, value_name = "HZ", value_parser = positive)]
    pub(super) split: Option<f64>,
}

/// Which frames are taken.
#[derive(Debug, Clone, Copy, clap::Args)]
#[command(next_help_heading = "Readings")]
pub(crate) struct FramesArgs {
    /// The first frame, counted from 0
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(super) from: usize,
    /// The last frame
    #[arg(long, value_name = "N")]
    pub(super) to: Option<usize>,
    /// Take every Nth frame only
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) every: u32,
}

impl FramesArgs {
    /// Refuses a range without frames.
    pub(crate) fn check(&self) -> anyhow::Result<()> {
        match self.to {
            Some(to) if to < self.from => Err(advise(
                format!("--to {to} is before --from {}", self.from),
                "name the first and the last frame, counted from 0",
            )),
            _ => Ok(()),
        }
    }

    /// Refuses readings that end before the first frame: of `read` frames, `taken` were taken.
    pub(crate) fn check_any(&self, read: usize, taken: usize) -> anyhow::Result<()> {
        if taken > 0 {
            return Ok(());
        }
        Err(advise(
            format!("the readings have {read} frames, none of them from frame {} on", self.from),
            "name an earlier frame with --from; frames are counted from 0",
        ))
    }

    /// One frame alone.
    pub(crate) fn one(number: usize) -> Self {
        Self { from: number, to: Some(number), every: 1 }
    }
}

const LAYOUTS: [Choice<ReadingsLayout>; 2] = [
    ("tnc", ReadingsLayout::TaxelsFirst, "Frames, taxels, channels"),
    ("tcn", ReadingsLayout::ChannelsFirst, "Frames, channels, taxels"),
];

const DUPLICATES: [Choice<Duplicates>; 2] = [
    ("refuse", Duplicates::Refuse, "Refuse the readings"),
    ("first", Duplicates::First, "Use the first column"),
];

pub(crate) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && x > 0.0 => Ok(x),
        _ => Err("needed: a positive number".into()),
    }
}

/// Two numbers, the lower one first.
pub(crate) fn range(text: &str) -> Result<[f64; 2], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|x| x.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[low, high]) if low < high && f64::is_finite(low) && f64::is_finite(high) => Ok([low, high]),
        _ => Err("needed: two numbers, the lower one first, as in 0,1000".into()),
    }
}
