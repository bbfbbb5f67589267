//! Where `render` gets its frames from: readings that are read, joined to the map and conditioned.

use std::{
    io::stdin,
    path::{Path, PathBuf},
    sync::{Arc, Condvar, Mutex, PoisonError},
    thread,
};

use clap::ValueEnum;
use dermatome::{
    Error,
    io::{IoError, ReadingsLayout, ReadingsReader, read_gains},
    map::SkinMap,
    signal::{Channel, ConditionOptions, ConditionReport, Conditioner, Duplicates, Frame, Join, JoinReport},
};

use crate::{common::Common, errors::advise, notes::note, outputs::is_stream};

/// How readings are read and made comparable.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Readings")]
pub(crate) struct ReadingsArgs {
    /// Order of the axes of an array with three
    #[arg(long, value_enum, default_value_t = LayoutArg::Tnc, requires = "readings")]
    layout: LayoutArg,
    /// Unit of the readings; force, charge and other amounts are summed over receptive fields, all
    /// else is averaged; several channels: one unit each
    #[arg(long = "unit", value_name = "UNIT", value_delimiter = ',', requires = "readings")]
    units: Vec<String>,
    /// Frames per second, for readings without times
    #[arg(long, value_name = "HZ", value_parser = positive, requires = "readings")]
    rate: Option<f64>,
    /// What to do with a taxel id that several columns have
    #[arg(long, value_enum, default_value_t = DuplicatesArg::Refuse, requires = "readings")]
    duplicates: DuplicatesArg,
    /// Subtract the mean of the first N frames from each taxel
    #[arg(long, value_name = "N", default_value_t = 0, requires = "readings")]
    pub(crate) baseline: usize,
    /// Multiply the readings of each taxel: a table with columns id,gain
    #[arg(long, value_name = "F.csv", requires = "readings")]
    gain: Option<PathBuf>,
    /// Clip readings to these bounds; the number of clipped readings is printed
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true, requires = "readings")]
    clip: Option<[f64; 2]>,
    /// Split each channel into a slow and a fast part at this frequency
    #[arg(long, value_name = "HZ", value_parser = positive, requires = "readings")]
    split: Option<f64>,
}

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
    /// Drop frames of a live stream that come faster than they are drawn; their number is printed
    #[arg(long)]
    drop: bool,
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

    /// Refuses readings that end before the first frame.
    pub(crate) fn check_any(&self, tally: &Tally) -> anyhow::Result<()> {
        if tally.frames > 0 {
            return Ok(());
        }
        Err(advise(
            format!("the readings have {} frames, none of them from frame {} on", tally.read, self.from),
            "name an earlier frame with --from; frames are counted from 0",
        ))
    }

    /// One frame alone.
    pub(crate) fn one(number: usize) -> Self {
        Self { from: number, to: Some(number), every: 1, drop: false }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum LayoutArg {
    /// Frames, taxels, channels
    Tnc,
    /// Frames, channels, taxels
    Tcn,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum DuplicatesArg {
    /// Refuse the readings
    Refuse,
    /// Use the first column
    First,
    /// Use the mean of the columns
    Mean,
}

/// A positive number.
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

/// What became of the readings.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tally {
    /// Frames that were read.
    pub(crate) read: usize,
    /// Frames that were passed on.
    pub(crate) frames: usize,
    /// Channels of the readings.
    pub(crate) channels: usize,
    /// Whether frames have a time.
    pub(crate) has_times: bool,
    /// Readings of matched taxels that are missing, NaN or infinite.
    pub(crate) missing: usize,
    /// Frames of a live stream that came too fast.
    pub(crate) dropped: usize,
    /// How columns and taxels fit each other.
    pub(crate) join: JoinReport,
    /// What was done to the readings.
    pub(crate) condition: ConditionReport,
}

/// Readings of a map.
pub(crate) struct Readings<'a> {
    args: &'a ReadingsArgs,
    frames: FramesArgs,
    path: &'a Path,
    map: &'a SkinMap,
}

impl<'a> Readings<'a> {
    pub(crate) fn new(args: &'a ReadingsArgs, frames: FramesArgs, path: &'a Path, map: &'a SkinMap) -> Self {
        Self { args, frames, path, map }
    }

    /// Opens the readings, for one pass over them.
    pub(crate) fn open(&self) -> anyhow::Result<Pass<'a>> {
        let Self { args, frames, path, map } = *self;
        let layout = match args.layout {
            LayoutArg::Tnc => ReadingsLayout::TaxelsFirst,
            LayoutArg::Tcn => ReadingsLayout::ChannelsFirst,
        };
        let mut reader = if is_stream(path) {
            ReadingsReader::stream(Path::new("standard input"), stdin())
        } else {
            ReadingsReader::open(path, layout)
        }
        .map_err(Error::from)?;
        if !args.units.is_empty() {
            name_units(&mut reader.channels, &args.units)?;
        }
        if frames.drop && !is_stream(path) {
            return Err(advise(
                format!("--drop is for live streams, and {} is a file, which waits", path.display()),
                "leave --drop out, or take fewer frames with --every N",
            ));
        }
        if args.split.is_some() && !reader.has_times && args.rate.is_none() {
            return Err(advise(
                "--split needs times, and the readings have none",
                "say how many frames come in a second with --rate HZ",
            ));
        }
        let duplicates = match args.duplicates {
            DuplicatesArg::Refuse => Duplicates::Refuse,
            DuplicatesArg::First => Duplicates::First,
            DuplicatesArg::Mean => Duplicates::Mean,
        };
        let join = Join::new(map, reader.ids.as_deref(), reader.width, duplicates).map_err(Error::from)?;
        let gains = args.gain.as_deref().map_or(Ok(Vec::new()), read_gains).map_err(Error::from)?;
        let options =
            ConditionOptions { baseline: args.baseline, gains, clip: args.clip, split_hz: args.split };
        let conditioner = Conditioner::new(map, &reader.channels, &options).map_err(Error::from)?;
        let frame = Frame::new(map, reader.channels.len());
        Ok(Pass { args, frames, reader, join, conditioner, frame })
    }
}

/// Gives the channels the units that the user names.
fn name_units(channels: &mut [Channel], units: &[String]) -> anyhow::Result<()> {
    if units.len() != channels.len() {
        let names: Vec<&str> = channels.iter().map(|channel| channel.name.as_str()).collect();
        return Err(advise(
            format!(
                "{} units for {} channels ({})",
                units.len(),
                channels.len(),
                names.iter().take(10).copied().collect::<Vec<_>>().join(", ")
            ),
            "give --unit one unit for each channel, as in --unit Pa,K",
        ));
    }
    for (channel, unit) in channels.iter_mut().zip(units) {
        *channel = Channel::new(&channel.name, unit);
    }
    Ok(())
}

/// One pass over the readings.
pub(crate) struct Pass<'a> {
    args: &'a ReadingsArgs,
    frames: FramesArgs,
    reader: ReadingsReader,
    join: Join,
    conditioner: Conditioner,
    frame: Frame,
}

impl Pass<'_> {
    /// The channels of the frames that are passed on.
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
            note(common, format_args!("{path}: {unknown} columns are of no taxel of the map: {ids}{more}"));
        }
        if *masked > 0 {
            note(
                common,
                format_args!("{path}: {matched} taxels have readings, {masked} have none and are masked"),
            );
        }
        if *shared > 0 {
            note(
                common,
                format_args!("{path}: {shared} ids belong to several taxels, which share the readings"),
            );
        }
        if *duplicates > 0 {
            note(common, format_args!("{path}: {duplicates} columns have the id of an earlier one"));
        }
    }

    /// Passes on the frames that were asked for, each with its number; `pass_on` returns false to
    /// stop.
    pub(crate) fn run(
        mut self,
        mut pass_on: impl FnMut(usize, &Frame) -> anyhow::Result<bool>,
    ) -> anyhow::Result<Tally> {
        let channels = self.reader.channels.len();
        let has_times = self.reader.has_times || self.args.rate.is_some();
        let mut tally = Tally { channels, has_times, join: self.join.report().clone(), ..Tally::default() };
        let FramesArgs { from, to, every, drop } = self.frames;
        let rate = self.args.rate;
        let (mut number, mut stopped) = (0_usize, false);
        let has_times = self.reader.has_times;
        let mut deliver = |frame: &Frame, frames: &mut usize| -> anyhow::Result<()> {
            let is_asked = number >= from && (number - from) % every as usize == 0;
            if is_asked && !stopped {
                stopped = !pass_on(number, frame)?;
                *frames += 1;
            }
            number += 1;
            stopped |= to.is_some_and(|to| number > to);
            if stopped { Err(anyhow::Error::new(Stop)) } else { Ok(()) }
        };
        let mut rows: Box<dyn Rows> =
            if drop { Box::new(Latest::new(self.reader)) } else { Box::new(Every(self.reader)) };
        let (mut values, mut time, mut read) = (Vec::new(), f64::NAN, 0_usize);
        let ended = loop {
            match rows.next(&mut values, &mut time) {
                Ok(true) => {}
                Ok(false) => break Ok(()),
                Err(e) => break Err(anyhow::Error::new(Error::from(e))),
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
        (tally.read, tally.dropped) = (read, rows.dropped());
        tally.condition = self.conditioner.report().clone();
        match ended {
            Err(e) if !e.is::<Stop>() => Err(e),
            _ => Ok(tally),
        }
    }
}

/// No further frame is wanted.
#[derive(Debug)]
struct Stop;

impl std::fmt::Display for Stop {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("no further frame is wanted")
    }
}

impl std::error::Error for Stop {}

/// Rows of readings, one after the other.
trait Rows {
    /// The next row; false after the last.
    fn next(&mut self, values: &mut Vec<f64>, time: &mut f64) -> Result<bool, IoError>;

    /// Number of rows that were dropped.
    fn dropped(&self) -> usize {
        0
    }
}

/// Every row there is.
struct Every(ReadingsReader);

impl Rows for Every {
    fn next(&mut self, values: &mut Vec<f64>, time: &mut f64) -> Result<bool, IoError> {
        self.0.read(values, time)
    }
}

/// The latest row, read by a thread of its own: rows that come while a frame is drawn replace each
/// other.
struct Latest {
    shared: Arc<(Mutex<Slot>, Condvar)>,
}

#[derive(Default)]
struct Slot {
    row: Option<(Vec<f64>, f64)>,
    ended: Option<Result<(), IoError>>,
    dropped: usize,
}

impl Latest {
    fn new(mut reader: ReadingsReader) -> Self {
        let shared = Arc::new((Mutex::new(Slot::default()), Condvar::new()));
        let theirs = Arc::clone(&shared);
        thread::spawn(move || {
            let (slot, changed) = &*theirs;
            let (mut values, mut time) = (Vec::new(), f64::NAN);
            loop {
                let read = reader.read(&mut values, &mut time);
                let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
                let ended = match read {
                    Ok(true) => {
                        let row = slot.row.replace((std::mem::take(&mut values), time));
                        slot.dropped += usize::from(row.is_some());
                        // The buffer of a dropped row is used again.
                        values = row.map_or_else(Vec::new, |(values, _)| values);
                        false
                    }
                    Ok(false) => {
                        slot.ended = Some(Ok(()));
                        true
                    }
                    Err(e) => {
                        slot.ended = Some(Err(e));
                        true
                    }
                };
                changed.notify_one();
                if ended {
                    return;
                }
            }
        });
        Self { shared }
    }
}

impl Rows for Latest {
    fn next(&mut self, values: &mut Vec<f64>, time: &mut f64) -> Result<bool, IoError> {
        let (slot, changed) = &*self.shared;
        let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            if let Some((row, at)) = slot.row.take() {
                (*values, *time) = (row, at);
                return Ok(true);
            }
            if let Some(ended) = slot.ended.take() {
                return ended.map(|()| false);
            }
            slot = changed.wait(slot).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn dropped(&self) -> usize {
        self.shared.0.lock().unwrap_or_else(PoisonError::into_inner).dropped
    }
}
