//! The readings of `render`, `plot` and `report`: how they are read and conditioned, and which frames are taken.

use std::path::Path;
use std::sync::Arc;

use dermatome::Error;
use dermatome::io::{
    IoError, Layout, ReadOptions, ReadingsReader, StatementSource, read_gains, read_order, read_response,
};
use dermatome::map::SkinMap;
use dermatome::recording::{Fill, FrameRange, Recording, RecordingOptions, RecordingReport};
use dermatome::signal::{
    Channel, ChannelKind, ConditionOptions, Duplicates, Probe, Response, Rest, Scale, TrackerOptions, Zero,
};

use crate::console::errors::advise;
use crate::console::notes::{note, note_columns, note_count, rows_of};
use crate::console::progress;
use crate::files::outputs::is_stream;
use crate::files::signals::{live_input, stopped};
use crate::options::{Choice, Common, InPath, LayoutArg, PROBES, layout_arg, number, numbers, one_of};

/// How readings are read and made comparable.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Readings")]
// Any of them needs the argument `readings`, which `render` has and `plot` may have.
#[group(requires = "readings")]
pub(crate) struct ReadingsArgs {
    /// What the numbers mean: a layout (.json, docs/files.md), whose draft `dermatome layout` writes; or the order of
    /// the axes of an array with three, `tnc` (frames, taxels, channels) or `tcn` [default: tnc]
    #[arg(long, value_name = "L.json|tnc|tcn", value_parser = layout_arg)]
    layout: Option<LayoutArg>,
    /// Which stream of a file with several: an array, a sensor
    #[arg(long, value_name = "NAME", hide_short_help = true)]
    stream: Option<String>,
    /// Which episode of a file with several, counted from 0: a trial, a group [default: one after the other]
    #[arg(long, value_name = "N")]
    episode: Option<u64>,
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
    /// Which taxel each column is of, whatever the readings say: a table with columns column,taxel_id that `check --order`
    /// writes; columns are counted from 0, without frames and times
    #[arg(long, value_name = "ORDER.csv", hide_short_help = true)]
    columns: Option<InPath>,
    /// Subtract the zero of each taxel: `follow` (it drifts, and is followed where nothing touches), first=N (the mean
    /// of the first N frames), `stored` (that of --response), or a number
    #[arg(long, value_name = "follow|stored|first=N|NUMBER", value_parser = zero, allow_hyphen_values = true)]
    pub(crate) zero: Option<Zero>,
    /// Multiply the readings of each taxel: a table with columns id,gain
    #[arg(long, value_name = "F.csv", hide_short_help = true)]
    gain: Option<InPath>,
    /// Turn readings into pressures, and mask faulty taxels: a table that `dermatome response` writes
    #[arg(long, value_name = "F.csv", conflicts_with = "gain")]
    pub(crate) response: Option<InPath>,
    /// Clip readings to these bounds; the number of clipped readings is printed
    #[arg(long, value_name = "LOW,HIGH", value_parser = range, allow_hyphen_values = true, hide_short_help = true)]
    clip: Option<[f64; 2]>,
    /// Split each channel into a slow and a fast part at this frequency
    #[arg(long, value_name = "HZ", value_parser = positive, hide_short_help = true)]
    split: Option<f64>,
    /// What takes the place of missing readings
    #[arg(long, value_parser = one_of(&FILLS), default_value = "none")]
    fill: Fill,
}

/// Which readings are touches, in `render`, `summary` and `report` alike.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Contacts")]
#[group(requires = "readings")]
pub(crate) struct TouchArgs {
    /// What touches the skin, for contacts that are close to each other
    #[arg(long, value_parser = one_of(&PROBES), default_value = "any")]
    pub(crate) probe: Probe,
    /// A taxel above this is loaded, and a contact has one at least, in the unit of the channel; 0: above 0 [default: as
    /// the file states; else estimated from the first frames]
    #[arg(long, value_name = "X", value_parser = threshold)]
    threshold: Option<f64>,
}

fn threshold(text: &str) -> Result<f64, String> {
    // Contacts need a threshold above 0.
    number(text, "a number of at least 0", |x| x >= 0.0).map(|x| x.max(f64::MIN_POSITIVE))
}

impl TouchArgs {
    /// The options of contacts in a channel of a recording.
    pub(crate) fn options(&self, recording: &Recording, channel: usize) -> TrackerOptions {
        let defaults = recording.tracker_options(channel);
        TrackerOptions {
            probe: self.probe,
            low: self.probe.low(),
            threshold: self.threshold.or(defaults.threshold),
            ..defaults
        }
    }

    /// Notes about the threshold and the zero that contacts were measured from.
    pub(crate) fn remark(&self, recording: &Recording, channel: usize, common: &Common) {
        let TrackerOptions { threshold: stated, rest, .. } = recording.tracker_options(channel);
        match recording.threshold() {
            None => {
                note!(common, "no contacts: the noise cannot be estimated from one frame; give --threshold")
            }
            Some(_) if self.threshold.is_some() => {}
            Some(threshold) => {
                let digits = if (1e-3..1e6).contains(&threshold) || threshold == 0.0 {
                    format!("{threshold:.4}")
                } else {
                    format!("{threshold:.1e}")
                };
                let how = match (stated, rest) {
                    (Some(_), _) => "as the file states",
                    (None, Rest::AtZero) => "estimated from noise about zero",
                    (None, Rest::Learned) => "estimated from frames at rest, whose mean is subtracted",
                };
                note!(common, "loaded is above {digits}, {how}; --threshold sets it");
            }
        }
        for remark in recording.contact_remarks() {
            note!(common, "{remark}: --zero follow, or --zero N");
        }
    }
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
    /// The frames, refused if there can be none.
    pub(crate) fn range(&self) -> anyhow::Result<FrameRange> {
        match self.to {
            Some(to) if to < self.from => Err(advise(
                format!("--to {to} is before --from {}", self.from),
                "name the first and the last frame, counted from 0",
            )),
            _ => Ok(FrameRange { from: self.from, to: self.to, every: self.every as usize }),
        }
    }

    /// Refuses readings that end before the first frame.
    pub(crate) fn check_any(&self, report: &RecordingReport) -> anyhow::Result<()> {
        if report.frames > 0 {
            return Ok(());
        }
        Err(advise(
            format!("the readings have {} frames, none of them from frame {} on", report.read, self.from),
            "name an earlier frame with --from; frames are counted from 0",
        ))
    }
}

const DUPLICATES: [Choice<Duplicates>; 2] = [
    ("refuse", Duplicates::Refuse, "Refuse the readings"),
    ("first", Duplicates::First, "Use the first column"),
];

/// Frames farther apart than this, in s, have their times in another unit, as it seems.
const SLOW_S: f64 = 5.0;

pub(crate) fn positive(text: &str) -> Result<f64, String> {
    number(text, "a positive number", |x| x > 0.0)
}

/// A parser of a [`Zero`].
fn zero(text: &str) -> Result<Zero, String> {
    let first = |frames: &str| frames.parse().ok().filter(|&n| n > 0).map(Zero::First);
    let number = || text.parse().ok().filter(|x: &f64| x.is_finite()).map(Zero::At);
    let zero = match text.strip_prefix("first=") {
        Some(frames) => first(frames),
        None if text == "follow" => Some(Zero::Follow),
        None if text == "stored" => Some(Zero::Stored),
        None => number(),
    };
    zero.ok_or_else(|| "needed: follow, stored, first=N with N frames, or a number".into())
}

/// Two numbers, the lower one first.
pub(crate) fn range(text: &str) -> Result<[f64; 2], String> {
    let range = numbers(text).filter(|[low, high]| low < high);
    range.ok_or_else(|| "needed: two numbers, the lower one first, as in 0,1000".into())
}

impl ReadingsArgs {
    /// The zero that is asked for.
    pub(crate) fn zero(&self) -> Option<Zero> {
        self.zero
    }

    /// Opens all frames of a file with another zero.
    pub(crate) fn open_at(
        &self,
        zero: Zero,
        path: &Path,
        map: &Arc<SkinMap>,
        common: &Common,
    ) -> anyhow::Result<Recording> {
        Self { zero: Some(zero), ..self.clone() }.open(FrameRange::default(), path, map, common)
    }

    /// Opens readings on a map: those of a file, or of standard input.
    pub(crate) fn open(
        &self,
        frames: FrameRange,
        path: &Path,
        map: &Arc<SkinMap>,
        common: &Common,
    ) -> anyhow::Result<Recording> {
        let response = self.response(common)?;
        self.open_with(response, frames, path, map, common)
    }

    /// What is said of the response of taxels, if anything is.
    pub(crate) fn response(&self, common: &Common) -> anyhow::Result<Option<Response>> {
        let Some(path) = &self.response else {
            if self.zero == Some(Zero::Stored) {
                return Err(advise("--zero stored takes the zeros of a response", "name it with --response"));
            }
            return Ok(None);
        };
        let (response, unused) = read_response(path).map_err(Error::from)?;
        note_columns(path, &unused, common);
        if response.taxels.iter().any(|taxel| taxel.gain.is_some())
            && response.taxels.iter().all(|taxel| taxel.exponent.is_none())
        {
            note!(common, "{}: no exponent is known; pressures are proportional to readings", path.display());
        }
        if response.scale == Some(Scale::Relative) {
            note!(common, "{}: its gains are relative; pressures have no unit", path.display());
        }
        Ok(Some(response))
    }

    /// [`Self::open`] with another response.
    pub(crate) fn open_with(
        &self,
        response: Option<Response>,
        frames: FrameRange,
        path: &Path,
        map: &Arc<SkinMap>,
        common: &Common,
    ) -> anyhow::Result<Recording> {
        let readings = self.reader(path, common)?;
        let options = self.recording_options(common)?;
        let condition = ConditionOptions { response, ..options.condition };
        let options = RecordingOptions { condition, frames, ..options };
        let in_recording = |e| Error::Recording { recording: shown(path), source: Box::new(Error::from(e)) };
        Ok(Recording::open(map, readings, &options).map_err(in_recording)?)
    }

    /// Opens readings without a map: those of a file, or of standard input.
    pub(crate) fn reader(&self, path: &Path, common: &Common) -> anyhow::Result<ReadingsReader> {
        let read = self.read_options()?;
        let mut readings = if is_stream(path) {
            if read.stream.is_some() || read.episode.is_some() {
                return Err(advise(
                    "standard input is one stream of text",
                    "leave out --stream and --episode, or name the file of the readings",
                ));
            }
            let name = Path::new("standard input");
            let fail = |source| IoError::Read { path: name.to_owned(), source };
            let input = live_input().map_err(fail).map_err(Error::from)?;
            match &read.layout {
                Some(layout) => ReadingsReader::stream_with(name, input, layout),
                None => ReadingsReader::stream(name, input),
            }
            .map_err(Error::from)?
        } else {
            common.containers.open(path, read).map_err(Error::from)?
        };
        if let Some(path) = &self.columns {
            let columns = rows_of(path, read_order(path), common)?;
            readings.assign_columns(path, &columns).map_err(Error::from)?;
        }
        Ok(readings)
    }

    /// How readings are made comparable, without a response.
    pub(crate) fn recording_options(&self, common: &Common) -> anyhow::Result<RecordingOptions> {
        let gains = self.gain.as_ref().map(|path| rows_of(path, read_gains(path), common)).transpose()?;
        Ok(RecordingOptions {
            names: self.channels.clone(),
            units: self.units.clone(),
            rate_hz: self.rate,
            duplicates: self.duplicates,
            condition: ConditionOptions {
                zero: self.zero.unwrap_or_default(),
                gains: gains.unwrap_or_default(),
                response: None,
                clip: self.clip,
                split_hz: self.split,
            },
            fill: self.fill,
            frames: FrameRange::default(),
        })
    }

    fn read_options(&self) -> anyhow::Result<ReadOptions> {
        let (stream, episode) = (self.stream.clone(), self.episode);
        let file = match &self.layout {
            None => return Ok(ReadOptions { stream, episode, ..ReadOptions::default() }),
            Some(LayoutArg::Axes(axes)) => {
                return Ok(ReadOptions { axes: *axes, stream, episode, ..ReadOptions::default() });
            }
            Some(LayoutArg::File(file)) => file,
        };
        let given = [
            (!self.channels.is_empty(), "--channels"),
            (!self.units.is_empty(), "--readings-unit"),
            (self.rate.is_some(), "--rate"),
        ];
        if let Some((_, option)) = given.iter().find(|(is_given, _)| *is_given) {
            let what = format!("{option} and the layout {} state the same thing", file.display());
            return Err(advise(what, format!("leave out {option}, or correct the layout")));
        }
        let layout = Layout::read(file).map_err(Error::from)?;
        Ok(ReadOptions { layout: Some(layout), stream, episode, ..ReadOptions::default() })
    }

    /// Refuses, for what shows one episode, a recording that has more.
    pub(crate) fn check_one_episode(recording: &Recording, path: &Path) -> anyhow::Result<()> {
        match recording.episodes() {
            0 | 1 => Ok(()),
            count => Err(advise(
                format!("{} has {count} episodes, each with its own times, and one is shown", path.display()),
                "choose it with --episode N, counted from 0",
            )),
        }
    }

    /// Notes about readings that are not as they should be.
    pub(crate) fn remark(&self, recording: &Recording, common: &Common) {
        for statement in recording.statements() {
            let is_checked = statement.source == StatementSource::Checked && statement.what != "missing";
            if is_checked || statement.what == "columns not read" {
                note!(common, "{}: {}", statement.what, statement.value);
            }
        }
        if recording.episodes() > 1 {
            let count = recording.episodes();
            note!(
                common,
                "{count} episodes, one after the other, each with its own times and zeros; --episode N reads one"
            );
        }
        let report = &recording.report();
        if !report.has_times {
            note!(common, "the frames have no times; --rate HZ gives them some");
        }
        if let Some(seconds) = report.interval.filter(|seconds| self.rate.is_none() && *seconds >= SLOW_S) {
            note!(common, "the frames are {seconds:.3} s apart; a column of times in ms is called time[ms]");
        }
        report.remarks(self.zero.unwrap_or_default()).iter().for_each(|remark| note!(common, "{remark}"));
    }
}

/// Frames that were read, and how they ended.
pub(crate) struct Played {
    frames: u64,
    pub(crate) ended: anyhow::Result<()>,
}

impl Played {
    /// Frames of a path that were read until the end or an error. Of a stream that ends badly, the frames before it are
    /// kept, since they will not come again.
    ///
    /// # Errors
    /// The error, if nothing is kept.
    pub(crate) fn new(path: &Path, frames: u64, ended: anyhow::Result<()>) -> anyhow::Result<Self> {
        if frames == 0 || !is_stream(path) {
            ended?;
            return Ok(Self { frames, ended: Ok(()) });
        }
        Ok(Self { frames, ended })
    }

    /// Calls `next` with the number of frames before until it returns that there is none.
    pub(crate) fn each(
        recording: &mut Recording,
        path: &Path,
        common: &Common,
        mut next: impl FnMut(&mut Recording, u64) -> anyhow::Result<bool>,
    ) -> anyhow::Result<Self> {
        let bar = progress::frames(common, recording.frames(), is_stream(path));
        let mut frames = 0;
        let ended = loop {
            match next(recording, frames) {
                Ok(true) => frames += 1,
                ended => break ended.map(|_| ()),
            }
            bar.inc(1);
        };
        bar.finish_and_clear();
        Self::new(path, frames, ended)
    }

    /// Notes what became of the frames of a stream that ended badly, and returns its error.
    pub(crate) fn end(self, done: &str, common: &Common) -> anyhow::Result<()> {
        if self.ended.is_err() {
            let how = if stopped().is_some() { "was stopped" } else { "ended badly" };
            note_count(common, self.frames, "frames", &format!("{done}; the stream {how}"));
        }
        self.ended
    }
}

/// A recording as messages name it.
fn shown(path: &Path) -> String {
    if is_stream(path) { "standard input".into() } else { path.display().to_string() }
}

/// Notes about columns of `path` and taxels that do not fit each other.
pub(crate) fn remark_join(recording: &Recording, path: &Path, common: &Common) {
    let path = shown(path);
    recording.report().join.remarks().iter().for_each(|remark| note!(common, "{path}: {remark}"));
}

/// Notes which channel is judged, where several measure touches.
pub(crate) fn remark_channel(channels: &[Channel], path: &Path, common: &Common) {
    let of_touch: Vec<&Channel> = channels.iter().filter(|channel| channel.kind.is_of_touch()).collect();
    if let [first, _, ..] = of_touch[..] {
        let used = of_touch.iter().find(|channel| channel.kind == ChannelKind::Touch).unwrap_or(&first);
        let (path, count) = (shown(path), of_touch.len());
        note!(common, "{path}: {count} channels measure touches, of which {} is used", used.name);
    }
}
