//! The readings of `render`, `plot` and `report`: how they are read, which frames are taken, and the pass that
//! joins them to a map and conditions them.

use std::path::{Path, PathBuf};

use dermatome::{
    Error,
    io::{IoError, ReadingsLayout, ReadingsReader, read_gains},
    map::SkinMap,
    signal::{
        Channel, ConditionOptions, ConditionReport, Conditioner, Duplicates, Filler, Frame, Join, JoinReport,
    },
};

use crate::console::errors::advise;
use crate::console::notes::{note, note_count};
use crate::files::outputs::is_stream;
use crate::files::signals::live_input;
use crate::options::{Choice, Common, number, one_of};

/// How readings are read and made comparable.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Readings")]
// Any of them needs the argument `readings`, which `render` has and `plot` may have.
#[group(requires = "readings")]
pub(crate) struct ReadingsArgs {
    /// Order of the axes of an array with three
    #[arg(long, value_parser = one_of(&LAYOUTS), default_value = "tnc")]
    layout: ReadingsLayout,
    /// Names of the channels, one each: of a .npy, which has none, or instead of those of the file
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    channels: Vec<String>,
    /// Unit of the readings; force, charge and other amounts are summed over receptive fields, all
    /// else is averaged; several channels: one unit each
    #[arg(long = "readings-unit", value_name = "UNIT", value_delimiter = ',')]
    units: Vec<String>,
    /// Frames per second, for readings without times
    #[arg(long, value_name = "HZ", value_parser = positive)]
    rate: Option<f64>,
    /// What to do with a taxel id that several columns have
    #[arg(long, value_parser = one_of(&DUPLICATES), default_value = "refuse", hide = true)]
    duplicates: Duplicates,
    /// Subtract the mean of the first N frames from each taxel
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) baseline: usize,
    /// Multiply the readings of each taxel: a table with columns id,gain
    #[arg(long, value_name = "F.csv")]
    gain: Option<PathBuf>,
    /// Clip readings to these bounds; the number of clipped readings is printed
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true)]
    clip: Option<[f64; 2]>,
    /// Split each channel into a slow and a fast part at this frequency
    #[arg(long, value_name = "HZ", value_parser = positive)]
    split: Option<f64>,
    /// What takes the place of missing readings
    #[arg(long, value_parser = one_of(&FILLS), default_value = "none")]
    fill: Fill,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fill {
    None,
    Neighbours,
}

const FILLS: [Choice<Fill>; 2] = [
    ("none", Fill::None, "Nothing"),
    (
        "neighbours",
        Fill::Neighbours,
        "The weighted mean of the taxels around each; `valid` in a .npz is 0 there",
    ),
];

/// Which frames are taken.
#[derive(Debug, Clone, Copy, clap::Args)]
#[command(next_help_heading = "Readings")]
pub(crate) struct FramesArgs {
    /// The first frame, counted from 0
    #[arg(long, value_name = "N", default_value_t = 0)]
    from: usize,
    /// The last frame
    #[arg(long, value_name = "N")]
    to: Option<usize>,
    /// Take every Nth frame only
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
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
    number(text, "a positive number", |x| x > 0.0)
}

/// Two numbers, the lower one first.
pub(crate) fn range(text: &str) -> Result<[f64; 2], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|x| x.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[low, high]) if low < high && f64::is_finite(low) && f64::is_finite(high) => Ok([low, high]),
        _ => Err("needed: two numbers, the lower one first, as in 0,1000".into()),
    }
}

#[derive(Debug, Clone, Default)]
pub(crate) struct Tally {
    pub(crate) read: usize,
    pub(crate) frames: usize,
    pub(crate) channels: usize,
    pub(crate) has_times: bool,
    /// Readings of matched taxels that are missing, NaN or infinite.
    pub(crate) missing: usize,
    /// How columns and taxels fit each other.
    pub(crate) join: JoinReport,
    pub(crate) condition: ConditionReport,
}

impl Tally {
    /// Notes about readings that are not as they should be; `baseline` frames were asked for.
    pub(crate) fn remark(&self, baseline: usize, common: &Common) {
        let condition = &self.condition;
        let unknown_baselines = condition.without_baseline.saturating_sub(self.join.masked * self.channels);
        let backwards = if self.has_times { condition.backwards } else { 0 };
        if !self.has_times {
            note!(common, "the frames have no times; --rate HZ gives them some");
        }
        if self.read < baseline {
            let read = self.read;
            note!(common, "the baseline is the mean of {read} frames, there are no {baseline}");
        }
        let counts = [
            (self.missing as u64, "readings", "missing, NaN or infinite, and masked"),
            (condition.clipped, "readings", "clipped"),
            (condition.too_large, "readings", "beyond the range of 32-bit floats, and masked"),
            (backwards, "frames", "earlier than the frame before"),
            // Masked taxels have none either, which is expected.
            (unknown_baselines as u64, "readings", "without a baseline, and masked"),
            (condition.unknown_gains as u64, "gains", "of no taxel of the map"),
        ];
        for (count, things, how) in counts {
            note_count(common, count, things, how);
        }
    }
}

pub(crate) struct Pass<'a> {
    args: &'a ReadingsArgs,
    frames: FramesArgs,
    reader: ReadingsReader,
    join: Join,
    conditioner: Conditioner,
    filler: Option<Filler>,
    frame: Frame,
}

impl<'a> Pass<'a> {
    pub(crate) fn open(
        args: &'a ReadingsArgs,
        frames: FramesArgs,
        path: &Path,
        map: &SkinMap,
    ) -> anyhow::Result<Self> {
        let mut reader = if is_stream(path) {
            let name = Path::new("standard input");
            let fail = |source| IoError::Read { path: name.to_owned(), source };
            live_input().map_err(fail).and_then(|input| ReadingsReader::stream(name, input))
        } else {
            ReadingsReader::open(path, args.layout)
        }
        .map_err(Error::from)?;
        name_channels(&mut reader.channels, &args.channels, &args.units)?;
        if args.split.is_some() && !reader.has_times && args.rate.is_none() {
            return Err(advise(
                "--split needs times, and the readings have none",
                "say how many frames come in a second with --rate HZ",
            ));
        }
        let join =
            Join::new(map, reader.ids.as_deref(), reader.width, args.duplicates).map_err(Error::from)?;
        let gains = args.gain.as_deref().map_or(Ok(Vec::new()), read_gains).map_err(Error::from)?;
        let options =
            ConditionOptions { baseline: args.baseline, gains, clip: args.clip, split_hz: args.split };
        let conditioner = Conditioner::new(map, &reader.channels, &options).map_err(Error::from)?;
        let frame = Frame::new(map, reader.channels.len());
        let is_filled = args.fill == Fill::Neighbours;
        let filler = is_filled.then(|| Filler::new(map, conditioner.channels().len()));
        Ok(Pass { args, frames, reader, join, conditioner, filler, frame })
    }

    pub(crate) fn channels(&self) -> &[Channel] {
        self.conditioner.channels()
    }

    /// Number of frames that are passed on, if it is known.
    pub(crate) fn frames(&self) -> Option<u64> {
        let all = self.reader.frames?;
        let end = self.frames.to.map_or(all, |to| all.min(to as u64 + 1));
        Some(end.saturating_sub(self.frames.from as u64).div_ceil(u64::from(self.frames.every)))
    }

    /// Notes about columns and taxels that do not fit each other.
    pub(crate) fn remark(&self, path: &str, common: &Common) {
        let JoinReport { unknown, first_unknown, shared, duplicates, masked, matched } = self.join.report();
        if *unknown > 0 {
            let ids: Vec<String> = first_unknown.iter().map(ToString::to_string).collect();
            let more = if *unknown > ids.len() { ", ..." } else { "" };
            let ids = ids.join(", ");
            note!(common, "{path}: {unknown} columns are of no taxel of the map: {ids}{more}");
        }
        if *masked > 0 {
            note!(common, "{path}: {matched} taxels have readings, {masked} have none and are masked");
        }
        if *shared > 0 {
            note!(common, "{path}: {shared} ids belong to several taxels, which share the readings");
        }
        if *duplicates > 0 {
            note!(common, "{path}: {duplicates} columns have the id of an earlier one");
        }
    }

    /// Passes on the frames that were asked for, each with its number.
    pub(crate) fn run(
        mut self,
        mut pass_on: impl FnMut(usize, &Frame) -> anyhow::Result<()>,
    ) -> anyhow::Result<Tally> {
        let channels = self.reader.channels.len();
        let has_times = self.reader.has_times || self.args.rate.is_some();
        let mut tally = Tally { channels, has_times, join: self.join.report().clone(), ..Tally::default() };
        let FramesArgs { from, to, every } = self.frames;
        let rate = self.args.rate;
        let (mut number, mut filler) = (0, self.filler);
        let has_times = self.reader.has_times;
        // Ends with no error after the last frame that is wanted.
        let mut deliver = |frame: &Frame, frames: &mut usize| -> Result<(), Option<anyhow::Error>> {
            let is_asked = number >= from && (number - from) % every as usize == 0;
            if is_asked && to.is_none_or(|to| number <= to) {
                pass_on(number, filler.as_mut().map_or(frame, |filler| filler.fill(frame)))?;
                *frames += 1;
            }
            number += 1;
            if to.is_some_and(|to| number > to) { Err(None) } else { Ok(()) }
        };
        let (mut values, mut time, mut read) = (Vec::new(), f64::NAN, 0_usize);
        let ended = loop {
            match self.reader.read(&mut values, &mut time) {
                Ok(true) => {}
                Ok(false) => break Ok(()),
                Err(e) => break Err(Some(Error::from(e).into())),
            }
            self.frame.time = match rate {
                Some(rate) if !has_times => read as f64 / rate,
                _ => time,
            };
            read += 1;
            tally.missing += self.join.fill(&values, &mut self.frame);
            if let Err(e) = self.conditioner.push(&self.frame, |frame| deliver(frame, &mut tally.frames)) {
                break Err(e);
            }
        };
        let ended = ended.and_then(|()| self.conditioner.finish(|frame| deliver(frame, &mut tally.frames)));
        tally.read = read;
        tally.condition = self.conditioner.report().clone();
        match ended {
            Err(Some(e)) => Err(e),
            Err(None) | Ok(()) => Ok(tally),
        }
    }
}

/// Gives the channels the names and the units that the user names, if any.
fn name_channels(channels: &mut [Channel], known: &[String], units: &[String]) -> anyhow::Result<()> {
    for (given, what, example) in [(known, "name", "force.N,temperature"), (units, "unit", "Pa,K")] {
        if !given.is_empty() && given.len() != channels.len() {
            return Err(advise(
                format!("{} {what}s for {} channels ({})", given.len(), channels.len(), names(channels)),
                format!("give one {what} for each channel, as in {example}"),
            ));
        }
    }
    if let Some((_, name)) = known.iter().enumerate().find(|(k, name)| known[..*k].contains(name)) {
        return Err(advise(
            format!("two channels are called {name:?}"),
            "give each channel a name of its own",
        ));
    }
    if known.is_empty() && units.is_empty() {
        return Ok(());
    }
    for (k, channel) in channels.iter_mut().enumerate() {
        // Readings without a name are called pressure until their unit says what they are.
        let old = if *channel == Channel::default() { "" } else { &channel.name };
        let (name, unit) = (known.get(k).map_or(old, String::as_str), units.get(k).unwrap_or(&channel.unit));
        *channel = Channel::new(name, unit).map_err(Error::from)?;
    }
    Ok(())
}

pub(crate) fn find_channel(channels: &[Channel], name: &str) -> anyhow::Result<usize> {
    channels.iter().position(|channel| channel.name == name).ok_or_else(|| {
        let what = format!("the readings have no channel {name:?}; they have {}", names(channels));
        advise(what, "give --channel one of them, or leave it out to take the first")
    })
}

fn names(channels: &[Channel]) -> String {
    channels.iter().take(10).map(|channel| channel.name.as_str()).collect::<Vec<_>>().join(", ")
}
