//! Frames as they come: read, joined to the map, conditioned, chosen and filled.

use std::collections::{HashSet, VecDeque};

use crate::Error;
use crate::io::{KnownRest, ReadingsReader, Statement, StatementSource};
use crate::map::SkinMap;
use crate::recording::options::{Fill, FrameRange, RecordingOptions, RecordingReport};
use crate::signal::{
    Channel, ChannelKind, Clock, ConditionOptions, ConditionReport, Conditioner, Filler, Frame, Join, Rest,
    SignalError, Stage, Tick, Zero, main_channel, unit_ratio,
};
use crate::skin::TaxelId;

pub(super) struct Intake {
    reader: ReadingsReader,
    join: Join,
    conditioner: Conditioner,
    /// Its options, for the next episode, and what it did in those before.
    condition: ConditionOptions,
    before: ConditionReport,
    filler: Option<Filler>,
    range: FrameRange,
    /// Which channels of the reader are about 0 at rest.
    at_zero: Vec<bool>,
    /// The threshold that is stated, and the channel that it is of.
    threshold: Option<(usize, f64)>,
    rate_hz: Option<f64>,
    /// A rate that is given for readings with times.
    unused_hz: Option<f64>,
    /// Whether the zeros of the response are subtracted although none was asked for.
    has_stored_zeros: bool,
    /// Whether times move on.
    moves_on: bool,
    /// Whether the options name the units.
    has_units: bool,
    /// The frame that was read last, or that comes next of those that were kept.
    frame: Frame,
    values: Vec<f64>,
    /// The first frames, from which stages have learned.
    kept: VecDeque<Frame>,
    has_learned: bool,
    clock: Clock,
    /// The episode of the frames, and how many of it were read.
    episode: u64,
    of_episode: usize,
    /// The time of the first frame of the next episode, whose readings are `values`.
    ahead: Option<f64>,
    /// Number of the next frame.
    next: usize,
    report: RecordingReport,
}

impl Intake {
    pub(super) fn new(
        map: &SkinMap,
        mut reader: ReadingsReader,
        options: &RecordingOptions,
    ) -> Result<Self, SignalError> {
        let is_tared: Vec<bool> = (0..reader.channels.len()).map(|k| reader.rest.is_zero_in(k)).collect();
        name_channels(&mut reader.channels, &options.names, &options.units)?;
        if let Some(hz) = options.rate_hz.filter(|hz| !(hz.is_finite() && *hz > 0.0)) {
            return Err(SignalError::option("the rate of frames in Hz", hz, "a positive number"));
        }
        let all = map.patches.iter().flat_map(|patch| patch.taxels.ids.iter());
        reader.settle_first_line(all.copied());
        let has_times = reader.has_times || options.rate_hz.is_some();
        if options.condition.split_hz.is_some() && !has_times {
            return Err(SignalError::NoTimes);
        }
        let mut join = Join::new(map, reader.ids.as_deref(), reader.width, options.duplicates)?;
        join.follow(map, &reader.channels);
        let main = main_channel(reader.channels.iter().map(|channel| channel.kind));
        let is_main_tared = is_tared.get(main).copied().unwrap_or(false);
        let mut condition = options.condition.clone();
        let has_stored_zeros = !is_main_tared && takes_stored_zeros(map, &condition)?;
        if has_stored_zeros {
            condition.zero = Zero::Stored;
        }
        let conditioner = Conditioner::new(map, &reader.channels, &condition)?;
        let at_zero = reader.channels.iter().zip(&is_tared).map(|(channel, is_tared)| {
            let has_zero = match condition.zero {
                Zero::Taken | Zero::First(0) => false,
                Zero::Stored => channel.kind == ChannelKind::Touch,
                Zero::At(_) | Zero::First(_) | Zero::Follow => true,
            };
            channel.kind.is_of_touch() && (*is_tared || has_zero)
        });
        let at_zero = at_zero.collect();
        let is_as_stated = is_main_tared
            && options.units.is_empty()
            && options.condition.response.is_none()
            && options.condition.gains.is_empty()
            && options.condition.split_hz.is_none();
        let threshold = reader.rest.threshold.filter(|_| is_as_stated);
        let is_filled = options.fill == Fill::Neighbours;
        Ok(Self {
            filler: is_filled.then(|| Filler::new(map, conditioner.channels())),
            range: options.frames,
            at_zero,
            threshold: threshold.map(|threshold| (main, threshold)),
            has_stored_zeros,
            moves_on: false,
            has_units: !options.units.is_empty(),
            rate_hz: options.rate_hz.filter(|_| !reader.has_times),
            unused_hz: options.rate_hz.filter(|_| reader.has_times),
            frame: Frame::new(map, reader.channels.len()),
            values: Vec::new(),
            kept: VecDeque::new(),
            has_learned: false,
            clock: Clock::new(),
            episode: 0,
            of_episode: 0,
            ahead: None,
            next: 0,
            report: RecordingReport {
                channels: reader.channels.len(),
                of_touch: reader.channels.iter().filter(|channel| channel.kind.is_of_touch()).count(),
                has_times,
                join: join.report().clone(),
                ..RecordingReport::default()
            },
            reader,
            join,
            conditioner,
            condition,
            before: ConditionReport::default(),
        })
    }

    pub(super) fn channels(&self) -> &[Channel] {
        self.conditioner.channels()
    }

    pub(super) fn has_readings(&self) -> impl Iterator<Item = bool> + '_ {
        self.join.is_matched()
    }

    pub(super) fn has_ids(&self) -> bool {
        self.reader.ids.is_some()
    }

    /// What is known about the readings, and by whom.
    pub(super) fn statements(&self) -> Vec<Statement> {
        let argument = |what: &str, value: String| Statement::new(what, value, StatementSource::Argument);
        let mut all = self.reader.statements();
        for channel in self.reader.channels.iter().filter(|_| self.has_units) {
            let what = format!("unit of {}", channel.name);
            all.retain(|known| known.what != what);
            all.push(argument(&what, channel.unit.clone()));
        }
        if let Some(rate) = self.rate_hz {
            all.retain(|known| known.what != "time");
            all.push(argument("time", format!("{rate} frames a second")));
        }
        if let Some(rate) = self.unused_hz {
            let value = format!("those of the readings; the rate of {rate} frames a second is not used");
            all.push(Statement::new("times", value, StatementSource::Checked));
        }
        if self.report.read > 1 && self.report.has_times && !self.moves_on {
            let value = "no frame is later than the first, so that nothing is summed over time; a rate gives frames times";
            all.push(Statement::new("times", value, StatementSource::Checked));
        }
        if self.has_stored_zeros {
            all.push(Statement::new("zero", "that of the response, subtracted", StatementSource::Checked));
        }
        let frames = self.conditioner.frames_to_learn();
        if frames > 0 {
            all.push(argument("zero", format!("the mean of the first {frames} frames, subtracted")));
        }
        for channel in self.conditioner.pressures() {
            let what = format!("unit of {}", channel.name);
            all.retain(|known| known.what != what);
            let unit = if channel.unit.is_empty() { "none: its response is relative" } else { &channel.unit };
            all.push(argument(&what, unit.to_owned()));
        }
        all
    }

    pub(super) fn baseline(&self) -> usize {
        self.conditioner.frames_to_learn()
    }

    /// Whether readings of channels that measure touches are about 0 where nothing touches.
    pub(super) fn is_tared(&self) -> bool {
        let mut of_touch =
            self.reader.channels.iter().zip(&self.at_zero).filter(|(c, _)| c.kind.is_of_touch());
        self.at_zero.contains(&true) && of_touch.all(|(_, at_zero)| *at_zero)
    }

    /// What is known of each channel that is passed on, but a threshold.
    pub(super) fn known_rest(&self) -> KnownRest {
        let channels = 0..self.channels().len();
        let is_zero = channels.map(|channel| self.rest(channel).0 == Rest::AtZero).collect();
        KnownRest { is_zero, threshold: None }
    }

    /// What readings of a channel are at rest, and the threshold that is stated for it.
    pub(super) fn rest(&self, channel: usize) -> (Rest, Option<f64>) {
        // A channel of the reader may have been split.
        let parts = self.channels().len() / self.at_zero.len().max(1);
        let at_zero = self.at_zero.get(channel / parts.max(1)).copied().unwrap_or(false);
        (
            if at_zero { Rest::AtZero } else { Rest::Learned },
            self.threshold.filter(|(main, _)| *main == channel).map(|(_, threshold)| threshold),
        )
    }

    pub(super) fn zeros(&self) -> Vec<f64> {
        self.conditioner.zeros()
    }

    pub(super) fn frames(&self) -> Option<u64> {
        Some(self.range.count(self.reader.frames?))
    }

    pub(super) fn report(&self) -> RecordingReport {
        RecordingReport {
            interval: self.clock.usual(),
            condition: self.conditioner.report().after(&self.before),
            ..self.report.clone()
        }
    }

    /// How many episodes are read, and the one of the frame that was passed on last.
    pub(super) fn episodes(&self) -> u64 {
        self.reader.episodes()
    }

    pub(super) fn episode(&self) -> u64 {
        self.episode
    }

    /// The frame that was passed on last.
    pub(super) fn latest(&self) -> &Frame {
        self.filler.as_ref().map_or(self.conditioner.latest(), Filler::latest)
    }

    /// Puts lines that agree with them at this pressure in the place of the curves of the response; before the first frame.
    pub(super) fn linearise(&mut self, map: &SkinMap, pressure: f64) -> Result<(), SignalError> {
        let Some(response) = &mut self.condition.response else { return Ok(()) };
        if response.taxels.iter().any(|taxel| taxel.exponent.is_some()) {
            *response = response.linear_at(pressure);
            self.conditioner = Conditioner::new(map, &self.reader.channels, &self.condition)?;
        }
        Ok(())
    }

    /// Goes on to the next episode, if there is one: nothing is known of it from those before.
    pub(super) fn begin_episode(&mut self, map: &SkinMap) -> Result<bool, Error> {
        if self.range.ends_before(self.next) {
            return Ok(false);
        }
        let Some(time) = self.ahead.take() else { return Ok(false) };
        self.before = self.conditioner.report().after(&self.before);
        self.conditioner = Conditioner::new(map, &self.reader.channels, &self.condition)?;
        if let Some(filler) = &mut self.filler {
            *filler = Filler::new(map, self.conditioner.channels());
        }
        (self.clock, self.has_learned) = (Clock::new(), false);
        (self.episode, self.of_episode) = (self.reader.episode(), 0);
        self.take(time);
        self.kept.push_back(self.frame.clone());
        Ok(true)
    }

    /// Goes on to the next frame of the episode that is wanted; returns its number.
    pub(super) fn advance(&mut self) -> Result<Option<usize>, Error> {
        if !self.has_learned {
            self.learn()?;
        }
        loop {
            if self.range.ends_before(self.next) {
                return Ok(None);
            }
            match self.kept.pop_front() {
                Some(frame) => self.frame = frame,
                None if self.read()? => {}
                None => return Ok(None),
            }
            self.next += 1;
            if self.range.contains(self.next - 1) {
                break;
            }
            self.conditioner.apply(&self.frame);
        }
        self.report.frames += 1;
        let frame = self.conditioner.apply(&self.frame);
        if let Some(filler) = &mut self.filler {
            filler.apply(frame);
        }
        Ok(Some(self.next - 1))
    }

    /// Keeps the first frames until the stages have learned from them.
    fn learn(&mut self) -> Result<(), Error> {
        self.settle_rate()?;
        let count = self.conditioner.frames_to_learn();
        self.kept.iter().take(count).for_each(|frame| self.conditioner.learn(frame));
        while self.kept.len() < count && self.read()? {
            self.conditioner.learn(&self.frame);
            self.kept.push_back(self.frame.clone());
        }
        if count > 0 {
            self.conditioner.settle();
            let learned = self.kept.len().min(count);
            let fewest = self.report.zero_of.map_or(learned, |before| before.min(learned));
            self.report.zero_of = Some(fewest);
        }
        self.has_learned = true;
        Ok(())
    }

    /// Takes the rate that is given for the times, if those of the first frames are all the same.
    fn settle_rate(&mut self) -> Result<(), Error> {
        let Some(rate) = self.unused_hz else { return Ok(()) };
        let stands = |kept: &VecDeque<Frame>| kept.iter().all(|frame| frame.time == kept[0].time);
        while self.kept.len() < STANDING_FRAMES && stands(&self.kept) && self.read()? {
            self.kept.push_back(self.frame.clone());
        }
        if self.kept.len() > 1 && stands(&self.kept) {
            (self.rate_hz, self.unused_hz, self.clock) = (Some(rate), None, Clock::new());
            for (k, frame) in self.kept.iter_mut().enumerate() {
                frame.time = k as f64 / rate;
                self.clock.see(frame.time);
            }
            self.moves_on = true;
        }
        Ok(())
    }

    /// Reads the next frame; false after the last one of the episode.
    fn read(&mut self) -> Result<bool, Error> {
        let mut time = f64::NAN;
        if self.ahead.is_some() || !self.reader.read(&mut self.values, &mut time)? {
            return Ok(false);
        }
        if self.report.read > 0 && self.reader.episode() != self.episode {
            self.ahead = Some(time);
            return Ok(false);
        }
        self.episode = self.reader.episode();
        self.take(time);
        Ok(true)
    }

    /// Takes the frame of `values`.
    fn take(&mut self, time: f64) {
        self.frame.time = self.rate_hz.map_or(time, |rate| self.of_episode as f64 / rate);
        let tick = self.clock.see(self.frame.time);
        self.moves_on |= matches!(tick, Tick::After(step) if step > 0.0) || tick.is_cut();
        self.of_episode += 1;
        self.report.read += 1;
        self.report.missing += self.join.fill(&self.values, &mut self.frame);
    }
}

/// Frames of one time from which on times are known to stand still.
const STANDING_FRAMES: usize = 64;

/// Whether the zeros of the response have to be subtracted, since its gains are of readings above them and no zero is given.
fn takes_stored_zeros(map: &SkinMap, condition: &ConditionOptions) -> Result<bool, SignalError> {
    let response = condition.response.as_ref().filter(|response| response.has_gains());
    let (Some(response), Zero::Taken | Zero::First(0)) = (response, condition.zero) else { return Ok(false) };
    let ids: HashSet<TaxelId> =
        map.patches.iter().flat_map(|patch| patch.taxels.ids.iter().copied()).collect();
    let known = || response.taxels.iter().filter(|taxel| taxel.gain.is_some() && ids.contains(&taxel.taxel));
    let (taxels, known) = (known().count(), known().filter(|taxel| taxel.zero.is_some()).count());
    if known < taxels { Err(SignalError::ZerosUnknown { known, taxels }) } else { Ok(taxels > 0) }
}

/// Gives the channels other names and units, where there are any.
fn name_channels(channels: &mut [Channel], names: &[String], units: &[String]) -> Result<(), SignalError> {
    for (given, what) in [(names, "name"), (units, "unit")] {
        if !given.is_empty() && given.len() != channels.len() {
            let known = channels.iter().map(|channel| channel.name.clone()).collect();
            return Err(SignalError::ChannelCount { what, given: given.len(), known });
        }
    }
    if let Some((_, name)) = names.iter().enumerate().find(|(k, name)| names[..*k].contains(name)) {
        return Err(SignalError::ChannelTwice { name: name.clone() });
    }
    if names.is_empty() && units.is_empty() {
        return Ok(());
    }
    for (k, channel) in channels.iter_mut().enumerate() {
        // Readings without a name are called pressure until their unit says what they are.
        let old = if *channel == Channel::default() { "" } else { &channel.name };
        let (name, unit) = (names.get(k).map_or(old, String::as_str), units.get(k).unwrap_or(&channel.unit));
        let stated = &channel.unit;
        if !stated.is_empty() && !unit.is_empty() && unit_ratio(stated, unit) != Some(1.0) {
            let (channel, stated, given) = (channel.name.clone(), stated.clone(), unit.clone());
            return Err(SignalError::UnitTwice { channel, stated, given });
        }
        let kind = Some(channel.kind).filter(|_| names.is_empty() && !channel.is_usual());
        *channel = Channel::new(name, unit)?;
        channel.kind = kind.unwrap_or(channel.kind);
    }
    Ok(())
}
