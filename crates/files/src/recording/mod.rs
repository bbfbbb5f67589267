//! A recording on a map: readings as they come, made comparable, on every level, as images, and what touches the skin.
//!
//! [`Recording::open`] joins readings to a map. Each call of [`Recording::next_step`] reads a frame and passes it
//! through these, in this order; those that were not asked for are left out:
//!
//! 1. `join`: columns become taxels ([`Join`](crate::signal::Join)); a missing reading is NaN from here on.
//! 2. `stages`, which see every frame: baseline, gain, bounds and filters ([`Conditioner`](crate::signal::Conditioner)).
//!    What estimates zeros, faults or responses is a [`Stage`] here.
//! 3. `frames`: from here on there are only the frames asked for. None of what follows depends on those left out.
//! 4. `fill`: missing readings from their neighbours ([`Filler`](crate::signal::Filler)).
//! 5. levels, their contrast or their edges ([`Recording::carry`]), and images of them ([`Recording::draw`]);
//! 6. contacts ([`Recording::follow_contacts`]), a stage that changes nothing, and sums ([`Recording::summarise`]).
//!
//! Many frames at once, of which none depends on another, are a [`Batch`].

mod batch;
mod examine;
mod intake;
mod levels;
mod options;
mod order;
mod respond;

use std::collections::VecDeque;
use std::sync::Arc;

use crate::Error;
use crate::atlas::Atlas;
use crate::body::FieldLevel;
use crate::image::{Renderer, TactileImage};
use crate::io::{KnownRest, ReadingsReader, Statement};
use crate::map::SkinMap;
use crate::pyramid::LevelId;
use crate::recording::intake::Intake;
use crate::recording::levels::{Levels, check_fields};
use crate::signal::{
    Channel, ContactRegion, ContactTracker, Frame, LevelFrame, SignalError, Stage, Summary, TrackerOptions,
    main_channel,
};

pub use batch::{Batch, BatchImages, in_order};
pub use examine::examine;
pub use levels::Carried;
pub use options::{Fill, FrameRange, RecordingOptions, RecordingReport};
pub use order::{find_order, map_signals};
pub use respond::{Reference, ResponseReport, respond};

/// Takes the unit of the channel that counts of one of several recordings.
fn same_unit(unit: &mut Option<String>, number: usize, channel: &Channel) -> Result<(), Error> {
    let first = unit.get_or_insert_with(|| channel.unit.clone());
    if *first == channel.unit {
        return Ok(());
    }
    let (found, first) = (channel.unit.clone(), first.clone());
    Err(SignalError::Units { number: number + 1, found, first }.into())
}

/// One frame of a recording, and what follows from it.
#[derive(Debug, Clone, Copy)]
pub struct Step<'r> {
    /// Its number in the recording, from 0 on.
    pub number: usize,
    /// The number of its episode. With the first frame of another one everything begins anew: zeros, thresholds, contacts.
    pub episode: u64,
    /// The readings of the taxels.
    pub frame: &'r Frame,
    /// The values of every level, if they are [carried](Recording::carry).
    pub levels: Option<&'r LevelFrame>,
    /// Images of these, in the order of the atlas, if they are [drawn](Recording::draw).
    pub images: &'r [TactileImage],
    /// What touches the skin, if that is [followed](Recording::follow_contacts).
    pub contacts: &'r [ContactRegion],
    /// What has found them.
    pub tracker: Option<&'r ContactTracker>,
}

/// A recording, or a live stream, on a map; frames come one by one.
///
/// It owns its buffers: while a stage learns, from the frames of a baseline or of the noise, frames are kept; after that
/// no stage allocates anything.
///
/// ```
/// use std::{path::Path, sync::Arc};
///
/// use dermatome::io::ReadingsReader;
/// use dermatome::map::SkinMap;
/// use dermatome::mesh::shapes;
/// use dermatome::recording::{Carried, Recording, RecordingOptions};
///
/// let map = Arc::new(SkinMap::flat(shapes::lattice(2, 2, 0.004), 1e-3));
/// let text = "time,1.force[N],3.force[N]\n0.0,0.5,\n0.1,0.75,0.25\n";
/// let readings = ReadingsReader::stream(Path::new("-"), text.as_bytes())?;
/// let mut recording = Recording::open(&map, readings, &RecordingOptions::default())?;
/// recording.carry(Carried::Values, None);
/// while let Some(step) = recording.next_step()? {
///     println!("{}: {:?}", step.frame.time, step.levels);
/// }
/// assert_eq!((recording.report().frames, recording.report().missing), (2, 1));
/// # Ok::<(), dermatome::Error>(())
/// ```
pub struct Recording {
    map: Arc<SkinMap>,
    intake: Intake,
    levels: Option<Levels>,
    renderer: Option<Renderer>,
    tracker: Option<ContactTracker>,
    /// Its options, for the next episode.
    touch: TrackerOptions,
    summary: Option<Summary>,
    /// The sums of episodes that have ended, and what was not as it should be in them.
    ended: Vec<(u64, Summary)>,
    remarks: Vec<String>,
    at_once: Option<usize>,
    /// The threshold of the episodes before, and how many frames of this one were passed on.
    threshold_before: Option<f64>,
    of_episode: usize,
    /// The first frames and their numbers, from which the tracker has learned.
    kept: VecDeque<(usize, Frame)>,
    has_learned: bool,
    /// Why reading ended among them: those before are passed on.
    failure: Option<Error>,
    /// The one of them that is passed on.
    current: Frame,
}

impl Recording {
    /// Joins readings to a map; nothing is read yet but what they say of themselves.
    ///
    /// # Errors
    /// If the columns do not fit the map, or the names, units or another option do not fit the readings.
    pub fn open(
        map: &Arc<SkinMap>,
        readings: ReadingsReader,
        options: &RecordingOptions,
    ) -> Result<Self, SignalError> {
        let intake = Intake::new(map, readings, options)?;
        Ok(Self {
            map: Arc::clone(map),
            intake,
            levels: None,
            renderer: None,
            tracker: None,
            touch: TrackerOptions::default(),
            summary: None,
            ended: Vec::new(),
            remarks: Vec::new(),
            at_once: None,
            threshold_before: None,
            of_episode: 0,
            kept: VecDeque::new(),
            has_learned: false,
            failure: None,
            current: Frame::default(),
        })
    }

    /// The channels of the frames.
    pub fn channels(&self) -> &[Channel] {
        self.intake.channels()
    }

    /// The number of the channel of this name; without a name the first that measures touches, other than a tangential
    /// one, if there is one.
    ///
    /// # Errors
    /// [`SignalError::NoChannel`].
    pub fn channel(&self, name: Option<&str>) -> Result<usize, SignalError> {
        let channels = self.channels();
        let Some(name) = name else { return Ok(main_channel(channels.iter().map(|channel| channel.kind))) };
        channels.iter().position(|channel| channel.name == name).ok_or_else(|| SignalError::NoChannel {
            name: name.into(),
            known: channels.iter().map(|channel| channel.name.clone()).collect(),
        })
    }

    /// The [channel](Self::channel) without a name.
    ///
    /// # Errors
    /// [`SignalError::NoTouch`] if it does not measure touches.
    pub(crate) fn touch_channel(&self) -> Result<usize, SignalError> {
        let channels = self.channels();
        let channel = main_channel(channels.iter().map(|channel| channel.kind));
        match channels.get(channel) {
            Some(found) if found.kind.is_of_touch() => Ok(channel),
            _ => Err(SignalError::NoTouch {
                known: channels.iter().map(|channel| channel.name.clone()).collect(),
            }),
        }
    }

    /// The zero of each taxel in the [channel](Self::channel) without a name, patch after patch, as far as it is known by now; NaN where it is
    /// not. Without a [zero](crate::signal::Zero) it is 0.
    pub fn zeros(&self) -> Vec<f64> {
        self.intake.zeros()
    }

    /// Whether each taxel, patch after patch, has a column of the readings.
    pub fn has_readings(&self) -> impl Iterator<Item = bool> + '_ {
        self.intake.has_readings()
    }

    /// How many episodes are read, one after the other: trials of an array, groups of a container.
    pub fn episodes(&self) -> u64 {
        self.intake.episodes()
    }

    /// Number of frames that will be passed on in all, if it is known.
    pub fn frames(&self) -> Option<u64> {
        self.intake.frames()
    }

    /// What was read so far, and what was done to it.
    pub fn report(&self) -> RecordingReport {
        self.intake.report()
    }

    /// What is known about the readings, and by whom: the file, a layout, the options, or the numbers themselves.
    pub fn statements(&self) -> Vec<Statement> {
        self.intake.statements()
    }

    /// Puts lines in the place of the curves of the response; before the first frame.
    pub(super) fn linearise(&mut self, pressure: f64) -> Result<(), SignalError> {
        self.intake.linearise(&self.map, pressure)
    }

    /// Carries frames to every level, or of those above level 0 to `level` alone.
    pub fn carry(&mut self, carried: Carried, level: Option<LevelId>) {
        self.levels = Some(Levels::new(&self.map, self.intake.channels(), carried, level));
    }

    /// Carries frames to every level; of the levels that without a mesh at `at` is drawn, carried down to the taxels, on images
    /// [of it](Atlas::of_fields).
    ///
    /// # Errors
    /// If the map has no such level, or no channel is of its modality.
    pub fn carry_fields(&mut self, at: FieldLevel) -> Result<(), SignalError> {
        check_fields(&self.map, self.channels().iter(), at)?;
        self.levels = Some(Levels::of_fields(&self.map, self.intake.channels(), at));
        Ok(())
    }

    /// The channels of what is carried to levels and drawn: edges have two for each channel of the frames.
    pub fn level_channels(&self) -> &[Channel] {
        self.levels.as_ref().map_or(self.intake.channels(), |levels| &levels.channels)
    }

    /// Draws what is carried to levels: the readings on all of them, unless [`Self::carry`] was called before.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn draw(&mut self, atlas: &Atlas) -> Result<(), Error> {
        if self.levels.is_none() {
            self.carry(Carried::Values, None);
        }
        let level = self.levels.as_ref().and_then(|levels| levels.level);
        self.renderer = Some(Renderer::new(&self.map, atlas, self.level_channels(), level)?);
        Ok(())
    }

    /// The default options of contacts in a channel. Where the file or a layout states the zero of a pressure or force, or
    /// a zero is subtracted, readings are about 0 at rest; the threshold is the one that the file states, if it does. Else
    /// noise and rest are estimated from the first frames, those of the baseline if there is one.
    pub fn tracker_options(&self, channel: usize) -> TrackerOptions {
        let defaults = TrackerOptions::default();
        let noise_frames = match self.intake.baseline() {
            0 => defaults.noise_frames,
            frames => frames.max(2),
        };
        let (rest, threshold) = self.intake.rest(channel);
        TrackerOptions { channel, noise_frames, rest, threshold, ..defaults }
    }

    /// Whether readings of all channels that measure touches are about 0 where nothing touches: the zero of a pressure or force is
    /// stated, or one is subtracted.
    pub fn is_tared(&self) -> bool {
        self.intake.is_tared()
    }

    /// What is known of the readings of each channel where nothing touches, but a threshold.
    pub fn known_rest(&self) -> KnownRest {
        self.intake.known_rest()
    }

    /// Whether the columns of the readings have ids; else they are all taxels in the order of the map.
    pub(crate) fn has_ids(&self) -> bool {
        self.intake.has_ids()
    }

    /// Finds what touches the skin, and follows it from frame to frame. Where the threshold is estimated, the first
    /// step waits for the frames that it is estimated from.
    ///
    /// # Errors
    /// If an option is not usable, there is no such channel, or it does not measure touches.
    pub fn follow_contacts(&mut self, options: &TrackerOptions) -> Result<(), SignalError> {
        match self.channels().get(options.channel) {
            Some(channel) if !channel.kind.is_of_touch() => {
                Err(SignalError::NoTouch { known: vec![channel.name.clone()] })
            }
            _ => self.track(options),
        }
    }

    fn track(&mut self, options: &TrackerOptions) -> Result<(), SignalError> {
        let channels = self.channels();
        let channel = channels.get(options.channel).ok_or_else(|| SignalError::NoChannel {
            name: options.channel.to_string(),
            known: channels.iter().map(|channel| channel.name.clone()).collect(),
        })?;
        self.tracker = Some(ContactTracker::new(&self.map, channel, options)?);
        self.touch = *options;
        Ok(())
    }

    /// Adds up the readings of the channel of these options, and its contacts, which it [follows](Self::follow_contacts).
    ///
    /// # Errors
    /// As [`Self::follow_contacts`], but that a channel of something else has sums, too, unless a threshold is given.
    pub fn summarise(&mut self, options: &TrackerOptions) -> Result<(), SignalError> {
        self.track(options)?;
        self.summary = Some(Summary::new(&self.map, &self.channels()[options.channel]));
        Ok(())
    }

    /// As [`Self::summarise`], and follows each loading of a patch or a region ([`Summary::steps`]).
    ///
    /// # Errors
    /// As [`Self::follow_contacts`].
    pub fn summarise_steps(&mut self, options: &TrackerOptions) -> Result<(), SignalError> {
        if !self.intake.report().has_times {
            return Err(SignalError::NoTimes);
        }
        self.summarise(options)?;
        self.summary.iter_mut().for_each(Summary::follow_steps);
        Ok(())
    }

    /// As [`Self::summarise`], and adds up the fields of a level of the whole body, or of a modality
    /// ([`Summary::follow_fields`]).
    ///
    /// # Errors
    /// As [`Self::summarise`], and if the map has no such level, or the channel is of another modality.
    pub fn summarise_fields(&mut self, options: &TrackerOptions, at: FieldLevel) -> Result<(), SignalError> {
        let channel = self.channels().get(options.channel);
        check_fields(&self.map, channel.into_iter(), at)?;
        self.summarise(options)?;
        self.summary.iter_mut().for_each(|summary| summary.follow_fields(&self.map, at));
        Ok(())
    }

    /// What was added up so far, if that was [asked for](Self::summarise); of the last episode, if there are several.
    pub fn summary(&self) -> Option<&Summary> {
        self.summary.as_ref()
    }

    /// What was added up so far, each with the number of its episode where there are several.
    pub fn summaries(&self) -> Vec<(Option<u64>, &Summary)> {
        let number = |number: u64| (self.episodes() > 1).then_some(number);
        let ended = self.ended.iter().map(|(episode, summary)| (number(*episode), summary));
        ended.chain(self.summary.iter().map(|summary| (number(self.intake.episode()), summary))).collect()
    }

    /// The threshold of contacts, given or estimated, of the last episode that has one; `None` while it is not known.
    pub fn threshold(&self) -> Option<f64> {
        self.tracker.as_ref().and_then(ContactTracker::threshold).or(self.threshold_before)
    }

    /// What is not as it should be where zero and threshold of contacts were learned, a sentence each.
    pub fn contact_remarks(&self) -> Vec<String> {
        let Some(tracker) = &self.tracker else { return Vec::new() };
        let below = tracker.frames_below();
        let mut remarks = Vec::new();
        if tracker.was_moving() {
            remarks.push(
                "taxels next to each other move together in the first frames, so that something touched the skin while \
                 its zero was taken; a zero that is given or followed is needed"
                    .to_owned(),
            );
        }
        if below >= tracker.frames_to_learn().max(1) {
            remarks.push(format!(
                "{below} frames have readings far below the zero, so that something touched the skin while it was taken; \
                 a zero that is given or followed is needed"
            ));
        }
        let before = self.remarks.iter().filter(|remark| !remarks.contains(remark));
        let before: Vec<String> = before.cloned().collect();
        remarks.extend(before);
        remarks
    }

    /// How many contacts the strongest touch so far had at once ([`ContactTracker::at_once`]), of several episodes the most;
    /// `None` if contacts are not followed.
    pub fn at_once(&self) -> Option<usize> {
        self.at_once.max(self.tracker.as_ref().map(ContactTracker::at_once))
    }

    /// The next frame; `None` after the last one.
    ///
    /// # Errors
    /// If the readings cannot be read any further. What was passed on before stays valid, and so does
    /// [`Self::report`].
    pub fn next_step(&mut self) -> Result<Option<Step<'_>>, Error> {
        let (number, is_kept) = loop {
            if !self.has_learned {
                self.learn();
            }
            if let Some((number, frame)) = self.kept.pop_front() {
                self.current = frame;
                break (number, true);
            }
            if let Some(failure) = self.failure.take() {
                return Err(failure);
            }
            if let Some(number) = self.intake.advance()? {
                break (number, false);
            }
            if !self.begin_episode()? {
                return Ok(None);
            }
        };
        self.of_episode += 1;
        let frame = if is_kept { &self.current } else { self.intake.latest() };
        let levels = self.levels.as_mut().map(|levels| levels.of(frame));
        let images = match (&mut self.renderer, levels) {
            (Some(renderer), Some([_, drawn])) => renderer.render(drawn),
            _ => &[],
        };
        let levels = levels.map(|[levels, _]| levels);
        if let Some(tracker) = &mut self.tracker {
            tracker.track(frame);
            self.summary.iter_mut().for_each(|summary| summary.add(frame.time, tracker));
        }
        let tracker = self.tracker.as_ref();
        let contacts = tracker.map_or(&[][..], ContactTracker::contacts);
        let episode = self.intake.episode();
        Ok(Some(Step { number, episode, frame, levels, images, contacts, tracker }))
    }

    /// Passes all frames on, and `None` where an episode ends and another one begins. Returns how many episodes there are.
    fn each_frame(&mut self, mut see: impl FnMut(Option<&Frame>)) -> Result<u64, Error> {
        let (mut episode, mut count) = (None, 0);
        while let Some(step) = self.next_step()? {
            if episode.replace(step.episode) != Some(step.episode) {
                count += 1;
                if count > 1 {
                    see(None);
                }
            }
            see(Some(step.frame));
        }
        Ok(count)
    }

    /// Keeps the first frames of an episode until the tracker has learned from them.
    fn learn(&mut self) {
        self.has_learned = true;
        let Some(tracker) = &mut self.tracker else { return };
        let mut is_enough = tracker.frames_to_learn() == 0;
        while !is_enough {
            match self.intake.advance() {
                Ok(Some(number)) => {
                    let frame = self.intake.latest();
                    is_enough = tracker.learn_from(frame);
                    self.kept.push_back((number, frame.clone()));
                }
                Ok(None) => break,
                Err(error) => {
                    self.failure = Some(error);
                    break;
                }
            }
        }
        tracker.settle();
    }

    /// Goes on to the next episode, if there is one.
    fn begin_episode(&mut self) -> Result<bool, Error> {
        let ended = self.intake.episode();
        if !self.intake.begin_episode(&self.map)? {
            return Ok(false);
        }
        self.has_learned = false;
        if self.tracker.is_none() {
            return Ok(true);
        }
        (self.remarks, self.at_once) = (self.contact_remarks(), self.at_once());
        self.threshold_before = self.threshold();
        // An episode before the frames that are wanted has none.
        let summary = self.summary.take();
        let has_frames = std::mem::take(&mut self.of_episode) > 0;
        let options = self.touch;
        if let Some(summary) = &summary {
            match summary.field_level() {
                Some(at) => self.summarise_fields(&options, at),
                None if summary.follows_steps() => self.summarise_steps(&options),
                None => self.summarise(&options),
            }?;
        } else {
            self.follow_contacts(&options)?;
        }
        self.ended.extend(summary.filter(|_| has_frames).map(|summary| (ended, summary)));
        Ok(true)
    }
}
